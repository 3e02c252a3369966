//! Reprojection: history carried to the current frame along motion vectors.
//!
//! A pixel at (x, y) reads the previous frame at (x + mx, y + my). Each tap of the nearest or bilinear footprint counts
//! only if it lies inside, is finite in every channel, and shows the same surface (see [`super::validate`]); the
//! weights of those that count are renormalised, and their sum is the coverage. Where it is below 0.01, the mean of the
//! valid pixels of the 3×3 window takes over, with their fraction as coverage (Schied et al. 2017, *Spatiotemporal
//! Variance-Guided Filtering*, section 4.1). Where these fail as well, value and coverage are 0.
//!
//! The wide filters (Catmull-Rom, Lanczos) keep history sharp under repeated resampling. They serve where every one of
//! their taps is valid, bilinear elsewhere; dering holds them to the range of the 2×2 taps, beyond which their negative
//! lobes would ring.
//!
//! Inputs: any number of images of history, interleaved or planar, and motion (2 or 3). Outputs: the images along the motion,
//! coverage in [0, 1], and the mask of the tests that taps of the 2×2 footprint fail.

mod average;

use std::ops::Range;

use self::average::{Average, Grid, Quad, Taken, hold, wide_mean};
use super::footprint::{Filter, Footprints, MIN_COVERAGE, Taps, Wide, WideLanes};
use super::spans::{Span, Spans};
use crate::image::{BandMut, Image, Pixels, Run, SEGMENT, Size, plane_bands, segments};
use crate::kernels::fetch::validate::Tests;
use crate::pixels::{MotionLanes, MotionRun, PixelsMut, Row};
use crate::rows::{self, Kernel, Outlined, Simd};
use crate::tiles::Tiles;

/// Most channels of a pixel that one gather fetches: a vector of most CPUs.
const WIDEST: usize = 8;

/// How [`reproject`] reads history.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// Bilinear.
    pub filter: Filter,
    /// Whether the 3×3 window stands in for an inconsistent footprint; true.
    pub fallback: bool,
    /// Whether wide filters are held to the range of the nearest 2×2 taps; true.
    pub dering: bool,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            filter: Filter::Bilinear,
            fallback: true,
            dering: true,
        }
    }
}

impl Params {
    /// Without the 3×3 window.
    pub(crate) const fn of(filter: Filter) -> Self {
        Self {
            filter,
            fallback: false,
            dering: true,
        }
    }
}

/// A fetch of history: the images, the tests that taps must pass, and the filter.
pub(crate) struct Fetch<'a> {
    size: Size,
    history: Vec<Source<'a>>,
    tests: Tests<'a>,
    params: Params,
}

/// An image of the history.
#[derive(Clone, Copy)]
pub(crate) struct Source<'a> {
    /// Its channels are contiguous.
    image: Pixels<'a>,
    /// The width, if each of its rows stands for two of the frame's.
    halved: Option<usize>,
}

impl Source<'_> {
    /// The pixel of this image that is `rows` rows below pixel `at` of the frame, where a row has `stride` pixels.
    #[inline(always)]
    fn below(&self, at: usize, rows: usize, stride: usize) -> usize {
        match self.halved {
            None => at + rows * stride,
            Some(width) => at % width + (at / width + rows * stride / width) / 2 * width,
        }
    }

    /// A channel at pixel `at` of the frame.
    #[inline(always)]
    fn at(&self, at: usize, channel: usize) -> f32 {
        self.image.at(self.below(at, 0, 0), channel)
    }

    #[inline(always)]
    fn is_finite(&self, at: usize) -> bool {
        (0..self.image.channels).all(|channel| self.at(at, channel).is_finite())
    }
}

/// Line buffers of a fetch, and its results for a run.
pub(crate) struct Fetched {
    footprints: Footprints,
    wide: WideLanes,
    /// Normalised weights of the 2×2 taps.
    normalized: [Row; 4],
    /// 1 where the wide kernel has an invalid tap, so that the bilinear one takes over; otherwise 0.
    bilinear: Row<u32>,
    /// 1 where the pixel's values are final, 0 where a slow path has to repair them.
    done: Row<u32>,
    /// Interleaved values of each image of the history.
    values: Vec<Vec<f32>>,
    pub coverage: Row,
    pub rejection: Row<u8>,
}

impl Fetched {
    /// The interleaved values of an image of the history.
    #[inline(always)]
    pub fn values(&self, part: usize) -> &[f32] {
        &self.values[part]
    }
}

impl<'a> Fetch<'a> {
    /// Interleaved images are fetched pixel by pixel, planar ones plane by plane.
    pub fn new(history: &[Pixels<'a>], size: Size, tests: Tests<'a>, params: Params) -> Self {
        let images = history.iter().flat_map(|image| image.contiguous());
        let whole = |image| Source {
            image,
            halved: None,
        };
        Self {
            size,
            history: images.map(whole).collect(),
            tests,
            params,
        }
    }

    /// Fetches an interleaved image, too, each row of which stands for two of the frame's.
    pub fn and_halved(mut self, image: Pixels<'a>) -> Self {
        self.history.push(Source {
            image,
            halved: Some(self.size.width),
        });
        self
    }

    /// Scratch for this fetch.
    pub fn scratch(&self) -> Fetched {
        let values = self.history.iter();
        Fetched {
            footprints: Footprints::new(self.size),
            wide: WideLanes::zeroed(),
            normalized: [[0.0; SEGMENT]; 4],
            bilinear: [0; SEGMENT],
            done: [0; SEGMENT],
            values: values
                .map(|source| vec![0.0; SEGMENT * source.image.channels + WIDEST])
                .collect(),
            coverage: [0.0; SEGMENT],
            rejection: [0; SEGMENT],
        }
    }

    /// Fetches the history of a run.
    #[inline(always)]
    pub fn run(&self, run: Run, motion: MotionRun, to: &mut Fetched) {
        rows::outline(FetchRun {
            fetch: self,
            run,
            motion,
            to,
        });
    }

    #[inline(always)]
    fn take(&self, run: Run, motion: MotionRun, to: &mut Fetched) {
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
            Filter::Nearest | Filter::Bilinear => to.wide.covers[..len].fill(0),
        }
        self.normalize(len, to);
        let Fetched {
            footprints,
            wide,
            normalized,
            bilinear,
            done,
            values,
            ..
        } = to;
        let quad = Quad {
            normalized: normalized.each_ref().map(|lane| &lane[..len]),
        };
        let (at, spans) = (&footprints.at[..len], &footprints.spans);
        let (steps, on) = (footprints.steps(), &bilinear[..len]);
        self.each_part(&quad, at, spans, steps, on, values, done);
        if let Filter::Wide(kernel) = filter {
            let weights = [&wide.along, &wide.down];
            let weights = weights.map(|side| side.each_ref().map(|lane| &lane[..len]));
            let (at, spans, on) = (&wide.at[..len], &wide.spans, &wide.covers[..len]);
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
                    self.repair(i, to);
                }
            }
        }
    }

    /// Bilinear weights for pixels without a valid 4×4 footprint; marks the pixels that need them.
    #[inline(always)]
    fn normalize(&self, len: usize, to: &mut Fetched) {
        let (weights, normalized) = (&to.footprints.weights, &mut to.normalized);
        let coverage = &mut to.coverage[..len];
        let [w, x, y, z] = weights.each_ref().map(|lane| &lane[..len]);
        let [sw, sx, sy, sz] = normalized.each_mut().map(|lane| &mut lane[..len]);
        let sums = &to.footprints.coverage[..len];
        let (covers, unsure) = (&to.wide.covers[..len], &to.wide.unsure[..len]);
        let (bilinear, done) = (&mut to.bilinear[..len], &mut to.done[..len]);
        // Without the fallback, a pixel of low coverage is final, too.
        let no_fallback = !self.params.fallback;
        for i in 0..len {
            let (enough, wide) = (sums[i] >= MIN_COVERAGE, covers[i] != 0);
            let scale = if enough { 1.0 / sums[i] } else { 0.0 };
            (sw[i], sx[i]) = (w[i] * scale, x[i] * scale);
            (sy[i], sz[i]) = (y[i] * scale, z[i] * scale);
            coverage[i] = if enough | wide { coverage[i] } else { 0.0 };
            bilinear[i] = (!wide).into();
            done[i] = (wide | ((enough | no_fallback) & (unsure[i] == 0))).into();
        }
    }

    /// Averages the taps of each image of the history, for the pixels that are `on`.
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
        for (source, values) in self.history.iter().zip(values) {
            for Span { part, contiguous } in spans.iter() {
                let all = on[part.clone()].iter().fold(1, |all, on| all & on) == 1;
                let any = on[part.clone()].iter().fold(0, |any, on| any | on) == 1;
                if !any {
                    continue;
                }
                let taps = Taken {
                    source: *source,
                    at,
                    steps,
                    part,
                };
                let fast = contiguous && all && source.halved.is_none();
                match source.image.channels {
                    1 if fast => taps.row::<_, 1>(average, values, done),
                    2 if fast => taps.row::<_, 2>(average, values, done),
                    3 if fast => taps.row::<_, 3>(average, values, done),
                    4 if fast => taps.row::<_, 4>(average, values, done),
                    6 if fast => taps.row::<_, 6>(average, values, done),
                    _ => taps.each(average, on, values, done),
                }
            }
        }
    }

    /// Slow path for pixel `i`: re-tests each tap where the fast result was not finite, and falls back to the 3×3 window.
    #[inline(always)]
    fn repair(&self, i: usize, to: &mut Fetched) {
        let usable = |at: usize| self.history.iter().all(|source| source.is_finite(at));
        let (tests, footprints) = (&self.tests, &to.footprints);
        let near = footprints.taps(i, usable);
        to.coverage[i] = near.weight().min(1.0);
        if let Filter::Wide(kernel) = self.params.filter
            && to.rejection[i] == 0
        {
            let (f, grid) = footprints.grid(i, tests, usable);
            let weights = kernel.weights(f);
            if all_count(kernel, &weights, &grid) {
                self.write(i, &mut to.values, |source, channel| {
                    let value = |at: usize| source.at(at, channel);
                    let tap = |column: usize, row: usize| [grid[row][column].map_or(0.0, value)];
                    let mean = match kernel.has_corners() {
                        true => wide_mean::<true, 1>(weights, tap),
                        false => wide_mean::<false, 1>(weights, tap),
                    };
                    // Fewer than four valid taps: repeat the first, which leaves the range as it is.
                    let near = near.as_slice();
                    let near = [0, 1, 2, 3].map(|k| {
                        let &(at, _) = near.get(k).unwrap_or(&near[0]);
                        [source.at(at, channel)]
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
        self.write(i, values, |source, channel| {
            let taps = taps.as_slice().iter();
            taps.fold(0.0, |sum, &(at, weight)| {
                (weight * scale).mul_add(source.at(at, channel), sum)
            })
        });
    }

    fn write(&self, i: usize, values: &mut [Vec<f32>], value: impl Fn(&Source, usize) -> f32) {
        for (source, values) in self.history.iter().zip(values) {
            let channels = source.image.channels;
            let record = &mut values[i * channels..][..channels];
            for (channel, to) in record.iter_mut().enumerate() {
                *to = value(source, channel);
            }
        }
    }
}

struct FetchRun<'f, 'a> {
    fetch: &'f Fetch<'a>,
    run: Run,
    motion: MotionRun<'f>,
    to: &'f mut Fetched,
}

impl Outlined for FetchRun<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        self.fetch.take(self.run, self.motion, self.to);
    }
}

/// True if every tap with a weight lies inside.
fn all_count(kernel: Wide, [along, down]: &[[f32; 4]; 2], grid: &[[Option<usize>; 4]; 4]) -> bool {
    (0..4).all(|row| {
        let mut columns = Wide::columns(kernel.has_corners(), row);
        columns
            .all(|column| grid[row][column].is_some() || along[column] == 0.0 || down[row] == 0.0)
    })
}

struct Reproject<'a> {
    fetch: Fetch<'a>,
    motion: Pixels<'a>,
    /// Where it is fetched, if not everywhere.
    tiles: Option<&'a Tiles>,
}

impl<'a> Kernel for Reproject<'a> {
    /// The images of the history, the coverage, and the rejection mask if it is wanted.
    type Out = (Vec<PixelsMut<'a>>, BandMut<'a>, Option<BandMut<'a, u8>>);

    #[inline(always)]
    fn rows<S: Simd>(
        &self,
        _: S,
        rows: Range<usize>,
        (mut values, mut coverage, mut rejection): Self::Out,
    ) {
        let mut lanes = MotionLanes::zeroed();
        let mut fetched = self.fetch.scratch();
        let parts = |run| {
            let whole = self.tiles.is_none().then_some(run);
            let some = self
                .tiles
                .into_iter()
                .flat_map(move |tiles| tiles.runs(run));
            whole.into_iter().chain(some)
        };
        let runs = rows.flat_map(|y| segments(y, self.motion.size.width));
        for run in runs.flat_map(parts) {
            let motion = lanes.load(&self.motion, run);
            self.fetch.run(run, motion, &mut fetched);
            for (part, out) in values.iter_mut().enumerate() {
                let channels = self.fetch.history[part].image.channels;
                out.put(run, &fetched.values(part)[..run.len * channels], channels);
            }
            coverage.put(run, &fetched.coverage);
            if let Some(rejection) = &mut rejection {
                rejection.put(run, &fetched.rejection);
            }
        }
    }
}

impl Reproject<'_> {
    fn run<'a>(
        &self,
        values: Vec<impl Iterator<Item = PixelsMut<'a>>>,
        coverage: &'a mut [f32],
        rejection: Option<&'a mut [u8]>,
    ) {
        let size = self.motion.size;
        let rejection = rows::optional(rejection.map(|rejection| plane_bands(rejection, size)));
        let outs = zip_all(values)
            .zip(plane_bands(coverage, size))
            .zip(rejection);
        let outs = outs.map(|((values, coverage), rejection)| (values, coverage, rejection));
        rows::run(self, size.height, outs);
    }
}

/// Returns the reprojected history: an image for every interleaved input, and for every plane of a planar one. Writes the
/// coverage, and the rejection mask if it is asked for.
pub fn reproject(
    history: &[Pixels],
    motion: Pixels,
    tests: Tests,
    params: Params,
    coverage: &mut [f32],
    rejection: Option<&mut [u8]>,
) -> Vec<Image> {
    let size = motion.size;
    let kernel = Reproject {
        fetch: Fetch::new(history, size, tests, params),
        motion,
        tiles: None,
    };
    let sources = kernel.fetch.history.iter();
    let mut values: Vec<_> = sources
        .map(|source| Image::blank(size, source.image.channels))
        .collect();
    kernel.run(planar(&mut values), coverage, rejection);
    values
}

/// Fetches again, with other tests, in some tiles of what [`reproject`] has returned and written.
pub fn reproject_again(
    tiles: &Tiles,
    history: &[Pixels],
    motion: Pixels,
    tests: Tests,
    params: Params,
    values: &mut [Image],
    coverage: &mut [f32],
    rejection: &mut [u8],
) {
    let kernel = Reproject {
        fetch: Fetch::new(history, motion.size, tests, params),
        motion,
        tiles: Some(tiles),
    };
    kernel.run(planar(values), coverage, Some(rejection));
}

/// [`reproject`] of interleaved images to interleaved outputs that the caller owns; writes no rejection mask. Panics if an
/// image of several channels is planar.
pub fn reproject_interleaved(
    history: &[Pixels],
    motion: Pixels,
    tests: Tests,
    params: Params,
    values: Vec<&mut [f32]>,
    coverage: &mut [f32],
) {
    let interleaved = |image: &Pixels| image.elements().1 == image.channels;
    assert!(history.iter().all(interleaved));
    let kernel = Reproject {
        fetch: Fetch::new(history, motion.size, tests, params),
        motion,
        tiles: None,
    };
    let values = values.into_iter().zip(history);
    let values =
        values.map(|(values, image)| PixelsMut::bands(motion.size, image.channels, values));
    kernel.run(values.collect(), coverage, None);
}

fn planar(images: &mut [Image]) -> Vec<impl Iterator<Item = PixelsMut<'_>>> {
    images.iter_mut().map(Image::pixels_mut).collect()
}

/// Zips any number of iterators.
fn zip_all<I: Iterator>(mut all: Vec<I>) -> impl Iterator<Item = Vec<I::Item>> {
    std::iter::from_fn(move || all.iter_mut().map(Iterator::next).collect())
}
