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
use crate::image::{BandMut, Image, Pixels, Run, SEGMENT, Size, bands_of, segments};
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
    /// Whether a pixel has its values.
    done: Lane<bool>,
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
            wide: WideLanes::new(),
            shares: [[0.0; SEGMENT]; 4],
            done: [false; SEGMENT],
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
        to.footprints.find(run, motion, nearest, &self.tests);
        for i in 0..len {
            to.coverage[i] = to.footprints.coverage[i].min(1.0);
            to.rejection[i] = to.footprints.failed[i] as u8;
        }
        match filter {
            Filter::Wide(kernel) if self.tests.accept_all() => {
                to.footprints.widen(kernel, len, &mut to.wide);
                for i in 0..len {
                    to.done[i] = to.wide.inside[i] != 0;
                }
                match kernel.has_corners() {
                    true => self.each_part(len, to, &Grid::<true> { dering }),
                    false => self.each_part(len, to, &Grid::<false> { dering }),
                }
            }
            Filter::Wide(_) => to.done[..len].fill(false),
            Filter::Nearest | Filter::Bilinear => {
                self.share(len, to);
                self.each_part(len, to, &Quad);
            }
        }
        for i in 0..len {
            if !to.done[i] {
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
        for i in 0..len {
            let enough = sums[i] >= MIN_COVERAGE;
            let scale = if enough { 1.0 / sums[i] } else { 0.0 };
            (sw[i], sx[i]) = (w[i] * scale, x[i] * scale);
            (sy[i], sz[i]) = (y[i] * scale, z[i] * scale);
            coverage[i] = if enough { coverage[i] } else { 0.0 };
            done[i] = enough | !self.params.fallback;
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
                let out = (&mut values[first..], stride);
                match part.channels {
                    1 => taps.average::<1>(len, average, out, done),
                    2 => taps.average::<2>(len, average, out, done),
                    3 | 4 => taps.average::<4>(len, average, out, done),
                    _ => taps.average::<WIDEST>(len, average, out, done),
                }
            }
        }
    }

    /// The values of pixel `i` where not all is as it mostly is: by a look at each tap.
    #[cold]
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
                    let tap = |row: usize, column: usize| {
                        [grid[row][column].map_or(0.0, |at| image.at(at, channel))]
                    };
                    let [mean] = match kernel.has_corners() {
                        true => wide_mean::<true, 1>(weights, tap),
                        false => wide_mean::<false, 1>(weights, tap),
                    };
                    let near = near.as_slice().iter().map(|&(at, _)| image.at(at, channel));
                    if self.params.dering {
                        held(mean, near)
                    } else {
                        mean
                    }
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

impl Surroundings<'_> {
    /// Writes the means, and whether they are numbers, of the pixels that are not ruled out.
    #[inline(always)]
    fn average<const N: usize>(
        &self,
        len: usize,
        average: &impl Average,
        (values, stride): (&mut [f32], usize),
        done: &mut Lane<bool>,
    ) {
        let done = &mut done[..len];
        for i in 0..len {
            let mean: Option<[f32; N]> = if done[i] { average.mean(self, i) } else { None };
            match mean {
                Some(mean) => values[i * stride..][..N].copy_from_slice(&mean),
                None => done[i] = false,
            }
        }
    }

    #[inline(always)]
    fn quad<const N: usize>(&self, i: usize) -> [[f32; N]; 4] {
        let at = self.footprints.at[i] as usize;
        let [dx, dy] = self.footprints.steps();
        [at, at + dx, at + dy, at + dy + dx].map(|at| self.image.record(at))
    }
}

/// How a pixel's taps become one; none where the mean is no number.
trait Average {
    fn mean<const N: usize>(&self, taps: &Surroundings, i: usize) -> Option<[f32; N]>;
}

/// 2×2 taps.
struct Quad;

impl Average for Quad {
    #[inline(always)]
    fn mean<const N: usize>(&self, taps: &Surroundings, i: usize) -> Option<[f32; N]> {
        let shares = taps.shares.each_ref().map(|lane| lane[i]);
        let mut mean = [-0.0; N];
        for (tap, share) in taps.quad::<N>(i).iter().zip(shares) {
            add(&mut mean, share, tap);
        }
        all_finite(&mean).then_some(mean)
    }
}

/// 4×4 taps.
struct Grid<const CORNERS: bool> {
    dering: bool,
}

impl<const CORNERS: bool> Average for Grid<CORNERS> {
    #[inline(always)]
    fn mean<const N: usize>(&self, taps: &Surroundings, i: usize) -> Option<[f32; N]> {
        let width = taps.footprints.steps()[1];
        let first = taps.footprints.at[i] as usize - width - 1;
        let [along, down] = [&taps.wide.along, &taps.wide.down];
        let weights = [along, down].map(|lanes| lanes.each_ref().map(|lane| lane[i]));
        let mean = wide_mean::<CORNERS, N>(weights, |row, column| {
            taps.image.record(first + row * width + column)
        });
        if !all_finite(&mean) {
            return None;
        }
        if !self.dering {
            return Some(mean);
        }
        // Taps of no weight do not count.
        let [[_, _, right, _], [_, _, below, _]] = weights;
        let [a, b, c, d] = taps.quad::<N>(i);
        let [b, d] = if right == 0.0 { [a, c] } else { [b, d] };
        let [c, d] = if below == 0.0 { [a, b] } else { [c, d] };
        let near = |k: usize| [a[k], b[k], c[k], d[k]].into_iter();
        Some(std::array::from_fn(|k| held(mean[k], near(k))))
    }
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

/// The weighted mean of 4×4 taps.
#[inline(always)]
fn wide_mean<const CORNERS: bool, const N: usize>(
    [along, down]: [[f32; 4]; 2],
    tap: impl Fn(usize, usize) -> [f32; N],
) -> [f32; N] {
    let mut sum = [-0.0; N];
    for row in 0..4 {
        let mut line = [-0.0; N];
        for column in Wide::columns(CORNERS, row) {
            add(&mut line, along[column], &tap(row, column));
        }
        add(&mut sum, down[row], &line);
    }
    sum
}

/// A value held to the range of the taps.
#[inline(always)]
fn held(value: f32, taps: impl Iterator<Item = f32>) -> f32 {
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    for tap in taps {
        low = if tap < low { tap } else { low };
        high = if tap > high { tap } else { high };
    }
    let value = if value < low { low } else { value };
    if value > high { high } else { value }
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
        let mut lanes = MotionLanes::new();
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
