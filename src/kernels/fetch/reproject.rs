//! Reprojection: history carried to the current frame along motion vectors.
//!
//! A pixel at (x, y) reads the previous frame at (x + mx, y + my). Each tap of the nearest or bilinear footprint counts
//! only if it lies inside, is finite in every channel, and shows the same surface (see [`super::super::judge`]); the
//! weights of those that count are renormalised, and their sum is the coverage. Where it is below 0.01, the mean of the
//! valid pixels of the 3×3 window takes over, with their share as coverage (Schied et al. 2017, *Spatiotemporal
//! Variance-Guided Filtering*, section 4.1). Where these fail as well, value and coverage are 0.
//!
//! The wide filters (Catmull-Rom, Lanczos) keep history sharp under repeated resampling. They serve where every one of
//! their taps is valid, bilinear elsewhere; dering holds them to the range of the 2×2 taps, beyond which their negative
//! lobes would ring.
//!
//! Inputs: any number of planes of history, motion (H, W, 2 or 3). Outputs: the planes, coverage in [0, 1], and the
//! mask of the tests that taps of the 2×2 footprint fail.

use std::ops::Range;

use super::footprint::{
    Filter, Footprints, MIN_COVERAGE, Motion, MotionLanes, Taps, Wide, WideLanes,
};
use crate::image::{BandMut, Image, Pixels, Run, SEGMENT, Size, bands_of, record, segments};
use crate::kernels::judge::surface::{Lane, Tests};
use crate::rows::{self, Kernel};

/// Channels that are fetched at once: a vector of most CPUs.
const WIDEST: usize = 8;

#[derive(Clone, Copy, Debug)]
pub struct Params {
    /// Bilinear.
    pub filter: Filter,
    /// Whether the 3×3 window stands in for an inconsistent footprint; true.
    pub fallback: bool,
    /// Whether wide filters are held to the range of the nearest 2×2 taps; true.
    pub dering: bool,
}

/// Where history is read, and what of it counts.
pub struct Fetch<'a> {
    size: Size,
    /// Channels side by side.
    history: Vec<Pixels<'a>>,
    tests: Tests<'a>,
    params: Params,
}

/// What a run of pixels fetches.
pub struct Fetched {
    footprints: Footprints,
    wide: WideLanes,
    /// The weights of the 2×2 taps, which sum to one.
    shares: [Lane; 4],
    /// 1 where a pixel has its values, or 0.
    done: Lane<u32>,
    /// Records of each part of the history.
    values: Vec<Vec<f32>>,
    pub coverage: Lane,
    pub rejection: Lane<u8>,
}

impl Fetched {
    /// The records of a part of the history.
    #[inline(always)]
    pub fn values(&self, part: usize) -> &[f32] {
        &self.values[part]
    }
}

impl<'a> Fetch<'a> {
    /// Images are taken as they are where their channels lie side by side, otherwise plane by plane.
    pub fn new(history: &[Pixels<'a>], size: Size, tests: Tests<'a>, params: Params) -> Self {
        let history = history.iter().flat_map(|image| image.side_by_side());
        Self {
            size,
            history: history.collect(),
            tests,
            params,
        }
    }

    /// Room for what runs fetch.
    pub fn room(&self) -> Fetched {
        let values = self.history.iter();
        Fetched {
            footprints: Footprints::new(self.size),
            wide: WideLanes::zeroed(),
            shares: [[0.0; SEGMENT]; 4],
            done: [0; SEGMENT],
            values: values
                .map(|image| vec![0.0; SEGMENT * image.channels + WIDEST])
                .collect(),
            coverage: [0.0; SEGMENT],
            rejection: [0; SEGMENT],
        }
    }

    /// Fetches what a run of pixels comes from.
    #[inline(always)]
    pub fn run(&self, run: Run, motion: Motion, to: &mut Fetched) {
        let len = run.len;
        let Params { filter, dering, .. } = self.params;
        let nearest = filter == Filter::Nearest;
        let has_grid = self.size.width >= 4 && self.size.height >= 4;
        to.footprints.find(run, motion, nearest, &self.tests);
        for i in 0..len {
            to.coverage[i] = to.footprints.coverage[i].min(1.0);
            to.rejection[i] = to.footprints.failed[i] as u8;
        }
        match filter {
            Filter::Wide(kernel) if self.tests.accept_all() && has_grid => {
                to.footprints.widen(kernel, len, &mut to.wide);
                to.done = to.wide.inside;
                match kernel.has_corners() {
                    true => self.each_part(len, to, &Grid::<true> { dering }),
                    false => self.each_part(len, to, &Grid::<false> { dering }),
                }
            }
            Filter::Wide(_) => to.done[..len].fill(0),
            Filter::Nearest | Filter::Bilinear => {
                self.share(len, to);
                self.each_part(len, to, &Quad);
            }
        }
        for i in 0..len {
            if to.done[i] == 0 {
                self.mend(i, to);
            }
        }
    }

    #[inline(always)]
    fn share(&self, len: usize, to: &mut Fetched) {
        let (weights, shares) = (&to.footprints.weights, &mut to.shares);
        let coverage = &mut to.coverage[..len];
        let [w, x, y, z] = weights.each_ref().map(|lane| &lane[..len]);
        let [sw, sx, sy, sz] = shares.each_mut().map(|lane| &mut lane[..len]);
        let sums = &to.footprints.coverage[..len];
        let done = &mut to.done[..len];
        let settled = !self.params.fallback;
        for i in 0..len {
            let enough = sums[i] >= MIN_COVERAGE;
            let scale = if enough { 1.0 / sums[i] } else { 0.0 };
            (sw[i], sx[i]) = (w[i] * scale, x[i] * scale);
            (sy[i], sz[i]) = (y[i] * scale, z[i] * scale);
            coverage[i] = if enough { coverage[i] } else { 0.0 };
            done[i] = (enough | settled).into();
        }
    }

    /// Averages the taps of each part of the history, up to [`WIDEST`] channels at once.
    #[inline(always)]
    fn each_part(&self, len: usize, to: &mut Fetched, average: &impl Average) {
        let Fetched {
            footprints,
            wide,
            shares,
            done,
            values,
            ..
        } = to;
        for (image, values) in self.history.iter().zip(values) {
            let stride = image.channels;
            // From behind, since what follows a record's last channel is written over.
            for first in (0..stride).step_by(WIDEST).rev() {
                let part = image.part(first..(first + WIDEST).min(stride));
                let taps = Surroundings {
                    image: part,
                    footprints,
                    wide,
                    shares,
                };
                let values = &mut values[first..];
                match part.channels {
                    1 => average.run::<1>(taps, len, values, stride, done),
                    2 => average.run::<2>(taps, len, values, stride, done),
                    3 | 4 => average.run::<4>(taps, len, values, stride, done),
                    _ => average.run::<WIDEST>(taps, len, values, stride, done),
                }
            }
        }
    }

    /// The values of pixel `i` where not all is as it mostly is: by a look at each tap.
    #[inline(always)]
    fn mend(&self, i: usize, to: &mut Fetched) {
        let usable = |at: usize| self.history.iter().all(|image| is_finite(image, at));
        let (tests, footprints) = (&self.tests, &to.footprints);
        let near = footprints.taps(i, usable);
        to.coverage[i] = near.weight().min(1.0);
        if let Filter::Wide(kernel) = self.params.filter
            && to.rejection[i] == 0
        {
            let (f, grid) = footprints.grid(i, tests, usable);
            let weights = kernel.weights(f);
            if all_count(kernel, &weights, &grid) {
                self.write(i, &mut to.values, |image, channel| {
                    let value = |at: Option<usize>| at.map_or(0.0, |at| image.at(at, channel));
                    let taps = grid.as_flattened().iter().map(|&at| value(at));
                    let taps: Vec<_> = taps.collect();
                    let mean: [f32; 1] = match kernel.has_corners() {
                        true => wide_mean::<true, 1>(&taps, 0, [1, 4], weights),
                        false => wide_mean::<false, 1>(&taps, 0, [1, 4], weights),
                    };
                    // Those that do not count are replaced by one that does.
                    let near = near.as_slice();
                    let near = [0, 1, 2, 3].map(|k| {
                        let &(at, _) = near.get(k).unwrap_or(&near[0]);
                        [image.at(at, channel)]
                    });
                    let [value] = if self.params.dering {
                        hold(mean, near)
                    } else {
                        mean
                    };
                    value
                });
                return;
            }
        }
        if near.weight() >= MIN_COVERAGE {
            return self.write_mean(i, &near, &mut to.values);
        }
        if self.params.fallback {
            let around = footprints.window(i, tests, usable);
            to.coverage[i] = around.weight().min(1.0);
            return self.write_mean(i, &around, &mut to.values);
        }
        to.coverage[i] = 0.0;
        self.write(i, &mut to.values, |_, _| 0.0);
    }

    #[inline(always)]
    fn write_mean<const N: usize>(&self, i: usize, taps: &Taps<N>, values: &mut [Vec<f32>]) {
        let weight = taps.weight();
        let scale = if weight > 0.0 { 1.0 / weight } else { 0.0 };
        self.write(i, values, |image, channel| {
            let taps = taps.as_slice().iter();
            taps.fold(0.0, |sum, &(at, weight)| {
                sum + weight * scale * image.at(at, channel)
            })
        });
    }

    fn write(&self, i: usize, values: &mut [Vec<f32>], value: impl Fn(&Pixels, usize) -> f32) {
        for (image, values) in self.history.iter().zip(values) {
            let record = &mut values[i * image.channels..][..image.channels];
            for (channel, to) in record.iter_mut().enumerate() {
                *to = value(image, channel);
            }
        }
    }
}

#[inline(always)]
fn is_finite(image: &Pixels, at: usize) -> bool {
    (0..image.channels).all(|channel| image.at(at, channel).is_finite())
}

/// Whether there is a pixel for each weight.
fn all_count(kernel: Wide, [along, down]: &[[f32; 4]; 2], grid: &[[Option<usize>; 4]; 4]) -> bool {
    (0..4).all(|row| {
        let mut columns = Wide::columns(kernel.has_corners(), row);
        columns
            .all(|column| grid[row][column].is_some() || along[column] == 0.0 || down[row] == 0.0)
    })
}

/// Up to [`WIDEST`] channels of history around where the pixels of a run come from.
struct Surroundings<'a> {
    image: Pixels<'a>,
    footprints: &'a Footprints,
    wide: &'a WideLanes,
    shares: &'a [Lane; 4],
}

/// How the taps of a run become its values.
trait Average {
    /// Writes `N` numbers for every record, of `stride` numbers; what is not finite is not done.
    fn run<const N: usize>(
        &self,
        taps: Surroundings,
        len: usize,
        values: &mut [f32],
        stride: usize,
        done: &mut [u32],
    );
}

/// 2×2 taps.
struct Quad;

impl Average for Quad {
    #[inline(always)]
    fn run<const N: usize>(
        &self,
        taps: Surroundings,
        len: usize,
        values: &mut [f32],
        stride: usize,
        done: &mut [u32],
    ) {
        let [w, x, y, z] = taps.shares.each_ref().map(|lane| &lane[..len]);
        let (at, done) = (&taps.footprints.at[..len], &mut done[..len]);
        let (data, step) = taps.image.numbers();
        let steps = taps.footprints.steps().map(|pixels| pixels * step);
        for i in 0..len {
            let mut mean = [-0.0; N];
            let quad = quad::<N>(data, at[i] as usize * step, steps);
            for (tap, share) in quad.iter().zip([w[i], x[i], y[i], z[i]]) {
                add(&mut mean, share, tap);
            }
            done[i] &= u32::from(all_finite(&mean));
            values[i * stride..][..N].copy_from_slice(&mean);
        }
    }
}

/// 4×4 taps.
struct Grid<const CORNERS: bool> {
    dering: bool,
}

impl<const CORNERS: bool> Average for Grid<CORNERS> {
    #[inline(always)]
    fn run<const N: usize>(
        &self,
        taps: Surroundings,
        len: usize,
        values: &mut [f32],
        stride: usize,
        done: &mut [u32],
    ) {
        let [a0, a1, a2, a3] = taps.wide.along.each_ref().map(|lane| &lane[..len]);
        let [d0, d1, d2, d3] = taps.wide.down.each_ref().map(|lane| &lane[..len]);
        let (at, done) = (&taps.wide.at[..len], &mut done[..len]);
        let (data, step) = taps.image.numbers();
        let line = taps.footprints.steps()[1] * step;
        for i in 0..len {
            let first = at[i] as usize * step;
            let weights = [[a0[i], a1[i], a2[i], a3[i]], [d0[i], d1[i], d2[i], d3[i]]];
            let mean = wide_mean::<CORNERS, N>(data, first, [step, line], weights);
            done[i] &= u32::from(all_finite(&mean));
            let mean = if self.dering {
                // Taps of no weight do not count.
                let [a, b, c, d] = quad::<N>(data, first + line + step, [step, line]);
                let [b, d] = if a2[i] == 0.0 { [a, c] } else { [b, d] };
                let [c, d] = if d2[i] == 0.0 { [a, b] } else { [c, d] };
                hold(mean, [a, b, c, d])
            } else {
                mean
            };
            values[i * stride..][..N].copy_from_slice(&mean);
        }
    }
}

/// The records of 2×2 pixels from one on, with the steps to the right and down.
#[inline(always)]
fn quad<const N: usize>(data: &[f32], start: usize, [dx, dy]: [usize; 2]) -> [[f32; N]; 4] {
    // Spelled out, since `map` is not always compiled into its caller.
    let (below, beside) = (start + dy, start + dx);
    [
        record(data, start),
        record(data, beside),
        record(data, below),
        record(data, below + dx),
    ]
}

/// Adds a weighted tap; a sum that begins with −0 keeps the bits of its first tap.
#[inline(always)]
fn add<const N: usize>(sum: &mut [f32; N], weight: f32, tap: &[f32; N]) {
    for (sum, tap) in sum.iter_mut().zip(tap) {
        *sum += weight * tap;
    }
}

#[inline(always)]
fn all_finite<const N: usize>(values: &[f32; N]) -> bool {
    values
        .iter()
        .fold(true, |all, value| all & value.is_finite())
}

/// The weighted mean of 4×4 taps from one on, with the steps to the right and down.
#[inline(always)]
fn wide_mean<const CORNERS: bool, const N: usize>(
    data: &[f32],
    start: usize,
    [dx, dy]: [usize; 2],
    [along, down]: [[f32; 4]; 2],
) -> [f32; N] {
    let mut sum = [-0.0; N];
    let line = line::<CORNERS, N>(data, start, dx, along);
    add(&mut sum, down[0], &line);
    let line = self::line::<true, N>(data, start + dy, dx, along);
    add(&mut sum, down[1], &line);
    let line = self::line::<true, N>(data, start + 2 * dy, dx, along);
    add(&mut sum, down[2], &line);
    let line = self::line::<CORNERS, N>(data, start + 3 * dy, dx, along);
    add(&mut sum, down[3], &line);
    sum
}

/// The weighted sum of a row of four taps, or of those in the middle.
#[inline(always)]
fn line<const ENDS: bool, const N: usize>(
    data: &[f32],
    start: usize,
    step: usize,
    weights: [f32; 4],
) -> [f32; N] {
    let mut sum = [-0.0; N];
    if ENDS {
        add(&mut sum, weights[0], &record(data, start));
    }
    add(&mut sum, weights[1], &record(data, start + step));
    add(&mut sum, weights[2], &record(data, start + 2 * step));
    if ENDS {
        add(&mut sum, weights[3], &record(data, start + 3 * step));
    }
    sum
}

/// Values held to the range of the taps.
#[inline(always)]
fn hold<const N: usize, const TAPS: usize>(values: [f32; N], taps: [[f32; N]; TAPS]) -> [f32; N] {
    let (mut low, mut high) = ([f32::INFINITY; N], [f32::NEG_INFINITY; N]);
    for tap in &taps {
        for k in 0..N {
            low[k] = if tap[k] < low[k] { tap[k] } else { low[k] };
            high[k] = if tap[k] > high[k] { tap[k] } else { high[k] };
        }
    }
    let mut held = values;
    for k in 0..N {
        held[k] = if held[k] < low[k] { low[k] } else { held[k] };
        held[k] = if held[k] > high[k] { high[k] } else { held[k] };
    }
    held
}

struct Reproject<'a> {
    fetch: Fetch<'a>,
    motion: Pixels<'a>,
}

impl<'a> Kernel for Reproject<'a> {
    /// The parts of the history, the coverage, and, if asked for, the rejection.
    type Out = (Vec<BandMut<'a>>, BandMut<'a>, Option<BandMut<'a, u8>>);

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, (mut values, mut coverage, mut rejection): Self::Out) {
        let mut lanes = MotionLanes::zeroed();
        let mut fetched = self.fetch.room();
        for run in rows.flat_map(|y| segments(y, self.motion.size.width)) {
            let motion = lanes.load(&self.motion, run);
            self.fetch.run(run, motion, &mut fetched);
            for (part, out) in values.iter_mut().enumerate() {
                let channels = self.fetch.history[part].channels;
                out.put(run, &fetched.values(part)[..run.len * channels], channels);
            }
            coverage.put(run, &fetched.coverage[..run.len], 1);
            if let Some(rejection) = &mut rejection {
                rejection.put(run, &fetched.rejection[..run.len], 1);
            }
        }
    }
}

/// History as it appears in the current frame.
pub struct Reprojected {
    /// All planes of all images, one after the other.
    pub values: Image,
    pub coverage: Image,
    pub rejection: Image<u8>,
}

impl Reprojected {
    /// What the first frame knows of those before.
    pub fn nothing(size: Size, channels: usize) -> Self {
        Self {
            values: Image::new(size, channels),
            coverage: Image::new(size, 1),
            rejection: Image::new(size, 1),
        }
    }
}

pub fn reproject(history: &[Pixels], motion: Pixels, tests: Tests, params: Params) -> Reprojected {
    let size = motion.size;
    let channels = history.iter().map(|image| image.channels).sum();
    let mut reprojected = Reprojected::nothing(size, channels);
    let fetch = Fetch::new(history, size, tests, params);
    let mut rest = reprojected.values.data_mut();
    let mut parts = vec![];
    for image in &fetch.history {
        let (part, others) = rest.split_at_mut(image.channels * size.pixels());
        parts.push(bands_of(part, size));
        rest = others;
    }
    let coverage = reprojected.coverage.bands();
    let rejection = reprojected.rejection.bands().map(Some);
    let outs = together(parts).zip(coverage).zip(rejection);
    let outs = outs.map(|((values, coverage), rejection)| (values, coverage, rejection));
    rows::run(&Reproject { fetch, motion }, size.height, outs);
    reprojected
}

/// The same on records, which it writes as well: for each image, and the coverage.
pub fn reproject_records(
    history: &[Pixels],
    motion: Pixels,
    tests: Tests,
    params: Params,
    values: Vec<&mut [f32]>,
    coverage: &mut [f32],
) {
    let size = motion.size;
    let fetch = Fetch::new(history, size, tests, params);
    let bands = values.into_iter().zip(history).map(|(values, image)| {
        // A record's channels lie one after the other, as if they were pixels.
        let width = size.width * image.channels;
        bands_of(values, Size { width, ..size })
    });
    let outs = together(bands.collect()).zip(bands_of(coverage, size));
    let outs = outs.map(|(values, coverage)| (values, coverage, None));
    rows::run(&Reproject { fetch, motion }, size.height, outs);
}

/// One item of each, again and again.
fn together<I: Iterator>(mut all: Vec<I>) -> impl Iterator<Item = Vec<I::Item>> {
    std::iter::from_fn(move || all.iter_mut().map(Iterator::next).collect())
}
