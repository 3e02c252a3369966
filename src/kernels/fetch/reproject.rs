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
use crate::image::{
    BandMut, Image, Pixels, Run, SEGMENT, Size, Span, Spans, bands_of, record, segments,
};
use crate::kernels::judge::surface::{Lane, Tests};
use crate::memory::prefetch;
use crate::rows::{self, Kernel, Outlined, Simd};

/// Channels that are fetched at once: a vector of most CPUs.
const WIDEST: usize = 8;

/// How [`reproject`] reads history.
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
pub(crate) struct Fetch<'a> {
    size: Size,
    /// Channels side by side.
    history: Vec<Pixels<'a>>,
    tests: Tests<'a>,
    params: Params,
}

/// What a run of pixels fetches.
pub(crate) struct Fetched {
    footprints: Footprints,
    wide: WideLanes,
    /// The weights of the 2×2 taps, which sum to one.
    shares: [Lane; 4],
    /// 1 where no wide kernel serves, or 0.
    bilinear: Lane<u32>,
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
            bilinear: [0; SEGMENT],
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
        rows::outline(FetchRun {
            fetch: self,
            run,
            motion,
            to,
        });
    }

    #[inline(always)]
    fn take(&self, run: Run, motion: Motion, to: &mut Fetched) {
        let len = run.len;
        let Params { filter, dering, .. } = self.params;
        let nearest = filter == Filter::Nearest;
        to.footprints.find(run, motion, nearest, &self.tests);
        for i in 0..len {
            to.coverage[i] = to.footprints.coverage[i].min(1.0);
            to.rejection[i] = to.footprints.failed[i] as u8;
        }
        match filter {
            Filter::Wide(kernel) => {
                to.footprints.widen(kernel, len, &self.tests, &mut to.wide);
            }
            Filter::Nearest | Filter::Bilinear => to.wide.serves[..len].fill(0),
        }
        self.share(len, to);
        let Fetched {
            footprints,
            wide,
            shares,
            bilinear,
            done,
            values,
            ..
        } = to;
        let quad = Quad {
            shares: shares.each_ref().map(|lane| &lane[..len]),
        };
        let (at, spans) = (&footprints.at[..len], &footprints.spans);
        let (steps, on) = (footprints.steps(), &bilinear[..len]);
        self.each_part(&quad, at, spans, steps, on, values, done);
        if let Filter::Wide(kernel) = filter {
            let weights = [&wide.along, &wide.down];
            let weights = weights.map(|side| side.each_ref().map(|lane| &lane[..len]));
            let (at, spans, on) = (&wide.at[..len], &wide.spans, &wide.serves[..len]);
            match kernel.has_corners() {
                true => {
                    let grid = Grid::<true> { weights, dering };
                    self.each_part(&grid, at, spans, steps, on, values, done);
                }
                false => {
                    let grid = Grid::<false> { weights, dering };
                    self.each_part(&grid, at, spans, steps, on, values, done);
                }
            }
        }
        if to.done[..len].contains(&0) {
            for i in 0..len {
                if to.done[i] == 0 {
                    self.mend(i, to);
                }
            }
        }
    }

    /// The bilinear weights of those that no wide kernel serves, and whether they are what is wanted.
    #[inline(always)]
    fn share(&self, len: usize, to: &mut Fetched) {
        let (weights, shares) = (&to.footprints.weights, &mut to.shares);
        let coverage = &mut to.coverage[..len];
        let [w, x, y, z] = weights.each_ref().map(|lane| &lane[..len]);
        let [sw, sx, sy, sz] = shares.each_mut().map(|lane| &mut lane[..len]);
        let sums = &to.footprints.coverage[..len];
        let (serves, unsure) = (&to.wide.serves[..len], &to.wide.unsure[..len]);
        let (bilinear, done) = (&mut to.bilinear[..len], &mut to.done[..len]);
        let settled = !self.params.fallback;
        for i in 0..len {
            let (enough, wide) = (sums[i] >= MIN_COVERAGE, serves[i] != 0);
            let scale = if enough { 1.0 / sums[i] } else { 0.0 };
            (sw[i], sx[i]) = (w[i] * scale, x[i] * scale);
            (sy[i], sz[i]) = (y[i] * scale, z[i] * scale);
            coverage[i] = if enough | wide { coverage[i] } else { 0.0 };
            bilinear[i] = (!wide).into();
            done[i] = (wide | ((enough | settled) & (unsure[i] == 0))).into();
        }
    }

    /// Averages the taps of each part of the history for the pixels that are `on`.
    #[inline(always)]
    fn each_part(
        &self,
        average: &impl Average,
        at: &[u32],
        spans: &Spans,
        steps: [usize; 2],
        on: &[u32],
        values: &mut [Vec<f32>],
        done: &mut [u32],
    ) {
        let done = &mut done[..on.len()];
        for (image, values) in self.history.iter().zip(values) {
            for Span { part, together } in spans.iter() {
                let all = on[part.clone()].iter().fold(1, |all, on| all & on) == 1;
                let any = on[part.clone()].iter().fold(0, |any, on| any | on) == 1;
                if !any {
                    continue;
                }
                let taps = Taken {
                    image: *image,
                    at,
                    steps,
                    part,
                };
                match image.channels {
                    1 if together && all => taps.row::<_, 1>(average, values, done),
                    2 if together && all => taps.row::<_, 2>(average, values, done),
                    3 if together && all => taps.row::<_, 3>(average, values, done),
                    4 if together && all => taps.row::<_, 4>(average, values, done),
                    6 if together && all => taps.row::<_, 6>(average, values, done),
                    _ => taps.each(average, on, values, done),
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
                    let value = |at: usize| image.at(at, channel);
                    let tap = |column: usize, row: usize| [grid[row][column].map_or(0.0, value)];
                    let mean = match kernel.has_corners() {
                        true => wide_mean::<true, 1>(weights, tap),
                        false => wide_mean::<false, 1>(weights, tap),
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

struct FetchRun<'f, 'a> {
    fetch: &'f Fetch<'a>,
    run: Run,
    motion: Motion<'f>,
    to: &'f mut Fetched,
}

impl Outlined for FetchRun<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        self.fetch.take(self.run, self.motion, self.to);
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

/// Some of a run's pixels, and the history around where they come from.
struct Taken<'a> {
    image: Pixels<'a>,
    /// The upper left taps of the run.
    at: &'a [u32],
    /// From a pixel to that on its right, and to that below.
    steps: [usize; 2],
    part: Range<usize>,
}

impl Taken<'_> {
    /// The pixels that are `on`, one by one, up to [`WIDEST`] channels at once.
    #[inline(always)]
    fn each(&self, average: &impl Average, on: &[u32], values: &mut [f32], done: &mut [u32]) {
        let stride = self.image.channels;
        // From behind, since what follows a record's last channel is written over.
        for first in (0..stride).step_by(WIDEST).rev() {
            let image = self.image.part(first..(first + WIDEST).min(stride));
            let (part, values) = (
                Self {
                    image,
                    part: self.part.clone(),
                    ..*self
                },
                &mut values[first..],
            );
            match image.channels {
                1 => part.each_of::<1>(average, stride, on, values, done),
                2 => part.each_of::<2>(average, stride, on, values, done),
                3 | 4 => part.each_of::<4>(average, stride, on, values, done),
                _ => part.each_of::<WIDEST>(average, stride, on, values, done),
            }
        }
    }

    /// Writes `N` numbers for every record, of `stride` numbers; what is not finite is not done.
    #[inline(always)]
    fn each_of<const N: usize>(
        &self,
        average: &impl Average,
        stride: usize,
        on: &[u32],
        values: &mut [f32],
        done: &mut [u32],
    ) {
        let (data, step) = self.image.numbers();
        let [dx, dy] = self.steps.map(|pixels| pixels * step);
        for i in self.part.clone() {
            if on[i] != 0 {
                let start = self.at[i] as usize * step;
                let tap = |column, row| record(data, start + row * dy + column * dx);
                let mean: [f32; N] = average.mean(i, tap);
                done[i] &= u32::from(all_finite(&mean));
                // The first channels of the next record may be written over where they are yet to come.
                let due = on.get(i + 1).is_none_or(|&next| next != 0);
                let values = &mut values[i * stride..];
                if due {
                    values[..N].copy_from_slice(&mean);
                } else {
                    let count = self.image.channels;
                    values[..count].copy_from_slice(&mean[..count]);
                }
            }
        }
    }

    /// All pixels at once, which come from neighbours.
    #[inline(always)]
    fn row<A: Average, const C: usize>(&self, average: &A, values: &mut [f32], done: &mut [u32]) {
        let Range { start, end } = self.part;
        let len = end - start;
        let data = self.image.numbers().0;
        let [dx, dy] = self.steps;
        let first = self.at[start] as usize;
        let mut taps: [[&[[f32; C]]; 4]; 4] = [[&[]; 4]; 4];
        for row in 0..A::SIDE {
            for column in 0..A::SIDE {
                let from = (first + row * dy + column * dx) * C;
                taps[row][column] = data[from..][..len * C].as_chunks().0;
            }
        }
        let average = average.part(start, len);
        let means = &mut values[start * C..][..len * C].as_chunks_mut::<C>().0[..len];
        rows::outline(Means {
            average,
            taps,
            means: &mut *means,
        });
        // What is above the last row was asked for by the rows before.
        let next = first + len + (A::SIDE - 1) * dy;
        prefetch(data, next * C, len * C);
        let lost = |value: &f32| u32::from(!value.is_finite());
        let all = means.as_flattened().iter();
        if all.fold(0, |any, value| any | lost(value)) != 0 {
            for (done, mean) in done[start..end].iter_mut().zip(means) {
                *done &= u32::from(all_finite(mean));
            }
        }
    }
}

/// The averages of a row.
struct Means<'a, A, const C: usize> {
    average: A,
    taps: [[&'a [[f32; C]]; 4]; 4],
    means: &'a mut [[f32; C]],
}

impl<A: Average, const C: usize> Outlined for Means<'_, A, C> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self {
            average,
            mut taps,
            means,
        } = self;
        let len = means.len();
        let average = average.part(0, len);
        // Lengths that are known need no checks.
        for row in 0..A::SIDE {
            for column in 0..A::SIDE {
                taps[row][column] = &taps[row][column][..len];
            }
        }
        for i in 0..len {
            means[i] = average.mean(i, |column, row| taps[row][column][i]);
        }
    }
}

/// How the taps of a pixel become its value.
trait Average {
    /// Columns and rows of taps.
    const SIDE: usize;

    /// The same for some of the pixels.
    fn part(&self, start: usize, len: usize) -> Self;

    /// The value of pixel `i`; `tap` takes column and row.
    fn mean<const N: usize>(&self, i: usize, tap: impl Fn(usize, usize) -> [f32; N]) -> [f32; N];
}

/// 2×2 taps.
struct Quad<'a> {
    shares: [&'a [f32]; 4],
}

impl Average for Quad<'_> {
    const SIDE: usize = 2;

    #[inline(always)]
    fn part(&self, start: usize, len: usize) -> Self {
        Self {
            shares: self.shares.map(|lane| &lane[start..][..len]),
        }
    }

    #[inline(always)]
    fn mean<const N: usize>(&self, i: usize, tap: impl Fn(usize, usize) -> [f32; N]) -> [f32; N] {
        let [w, x, y, z] = self.shares;
        let mut mean = [-0.0; N];
        add(&mut mean, w[i], &tap(0, 0));
        add(&mut mean, x[i], &tap(1, 0));
        add(&mut mean, y[i], &tap(0, 1));
        add(&mut mean, z[i], &tap(1, 1));
        mean
    }
}

/// 4×4 taps, with or without the corners.
struct Grid<'a, const CORNERS: bool> {
    /// Of the columns and of the rows.
    weights: [[&'a [f32]; 4]; 2],
    dering: bool,
}

impl<'a, const CORNERS: bool> Average for Grid<'a, CORNERS> {
    const SIDE: usize = 4;

    #[inline(always)]
    fn part(&self, start: usize, len: usize) -> Self {
        let cut = |side: [&'a [f32]; 4]| side.map(|lane| &lane[start..][..len]);
        let [along, down] = self.weights;
        Self {
            weights: [cut(along), cut(down)],
            ..*self
        }
    }

    #[inline(always)]
    fn mean<const N: usize>(&self, i: usize, tap: impl Fn(usize, usize) -> [f32; N]) -> [f32; N] {
        let [[a0, a1, a2, a3], [d0, d1, d2, d3]] = self.weights;
        let along = [a0[i], a1[i], a2[i], a3[i]];
        let down = [d0[i], d1[i], d2[i], d3[i]];
        let mean = wide_mean::<CORNERS, N>([along, down], &tap);
        if self.dering {
            // Taps of no weight do not count.
            let [a, b, c, d] = [tap(1, 1), tap(2, 1), tap(1, 2), tap(2, 2)];
            let [b, d] = if along[2] == 0.0 { [a, c] } else { [b, d] };
            let [c, d] = if down[2] == 0.0 { [a, b] } else { [c, d] };
            let mut held = hold(mean, [a, b, c, d]);
            for k in 0..N {
                // What is missing must not look as if it were there.
                held[k] = if mean[k].is_finite() {
                    held[k]
                } else {
                    mean[k]
                };
            }
            held
        } else {
            mean
        }
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
    [along, [d0, d1, d2, d3]]: [[f32; 4]; 2],
    tap: impl Fn(usize, usize) -> [f32; N],
) -> [f32; N] {
    let mut sum = [-0.0; N];
    add(
        &mut sum,
        d0,
        &line::<CORNERS, N>(along, |column| tap(column, 0)),
    );
    add(
        &mut sum,
        d1,
        &line::<true, N>(along, |column| tap(column, 1)),
    );
    add(
        &mut sum,
        d2,
        &line::<true, N>(along, |column| tap(column, 2)),
    );
    add(
        &mut sum,
        d3,
        &line::<CORNERS, N>(along, |column| tap(column, 3)),
    );
    sum
}

/// The weighted sum of a row of four taps, or of those in the middle.
#[inline(always)]
fn line<const ENDS: bool, const N: usize>(
    [w0, w1, w2, w3]: [f32; 4],
    tap: impl Fn(usize) -> [f32; N],
) -> [f32; N] {
    let mut sum = [-0.0; N];
    if ENDS {
        add(&mut sum, w0, &tap(0));
    }
    add(&mut sum, w1, &tap(1));
    add(&mut sum, w2, &tap(2));
    if ENDS {
        add(&mut sum, w3, &tap(3));
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
    fn rows<S: Simd>(
        &self,
        _: S,
        rows: Range<usize>,
        (mut values, mut coverage, mut rejection): Self::Out,
    ) {
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

/// History as it appears in the current frame: an image for each, and for each plane of those that are planar. Writes the
/// coverage, and the rejection.
pub fn reproject(
    history: &[Pixels],
    motion: Pixels,
    tests: Tests,
    params: Params,
    coverage: &mut [f32],
    rejection: &mut [u8],
) -> Vec<Image> {
    let size = motion.size;
    let fetch = Fetch::new(history, size, tests, params);
    let values = (fetch.history.iter()).map(|image| Image::blank(size, image.channels));
    let mut values: Vec<_> = values.collect();
    let parts = values.iter_mut().map(Image::bands).collect();
    let (coverage, rejection) = (bands_of(coverage, size), bands_of(rejection, size));
    let outs = together(parts).zip(coverage).zip(rejection.map(Some));
    let outs = outs.map(|((values, coverage), rejection)| (values, coverage, rejection));
    rows::run(&Reproject { fetch, motion }, size.height, outs);
    values
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
