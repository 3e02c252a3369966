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

use super::footprint::{Filter, MIN_COVERAGE, Motion, Taps, footprint, wide, window};
use crate::image::{BandMut, Image, Size, View};
use crate::kernels::judge::surface::Tests;
use crate::rows::{self, Kernel};

#[derive(Clone, Copy, Debug)]
pub struct Params {
    /// Bilinear.
    pub filter: Filter,
    /// Whether the 3×3 window stands in for an inconsistent footprint; true.
    pub fallback: bool,
    /// Whether wide filters are held to the range of the nearest 2×2 taps; true.
    pub dering: bool,
}

struct Reproject<'a> {
    history: Vec<&'a [f32]>,
    motion: Motion<'a>,
    tests: Tests<'a>,
    params: Params,
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

pub fn reproject(history: &[View], motion: View, tests: Tests, params: Params) -> Reprojected {
    let size = motion.size;
    let history: Vec<_> = history.iter().flat_map(View::planes).collect();
    let mut values = Image::new(size, history.len());
    let mut coverage = Image::new(size, 1);
    let mut rejection = Image::new(size, 1);
    let kernel = Reproject {
        history,
        motion: Motion::new(motion),
        tests,
        params,
    };
    rows::run(
        &kernel,
        size.height,
        values.bands().zip(coverage.bands().zip(rejection.bands())),
    );
    Reprojected {
        values,
        coverage,
        rejection,
    }
}

impl<'a> Kernel for Reproject<'a> {
    type Out = (BandMut<'a>, (BandMut<'a>, BandMut<'a, u8>));

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, (mut values, (mut coverage, mut rejection)): Self::Out) {
        for y in rows {
            for x in 0..self.motion.size().width {
                (coverage.row(0, y)[x], rejection.row(0, y)[x]) = self.pixel(x, y, &mut values);
            }
        }
    }
}

impl Reproject<'_> {
    #[inline(always)]
    fn pixel(&self, x: usize, y: usize, values: &mut BandMut) -> (f32, u8) {
        let origin = self.motion.origin(x, y, &self.tests);
        let size = self.motion.size();
        let finite = |i: usize| self.history.iter().all(|plane| plane[i].is_finite());
        let filter = self.params.filter;
        let (taps, failed) = footprint(size, &origin, &self.tests, filter, finite);
        if let Filter::Wide(kernel) = filter
            && failed == 0
            && let Some(wide) = wide(size, &origin, &self.tests, kernel, finite)
        {
            self.mean(&wide, x, y, values);
            if self.params.dering {
                self.hold(&taps, x, y, values);
            }
            return (taps.weight().min(1.0), failed);
        }
        if taps.weight() >= MIN_COVERAGE {
            return (self.mean(&taps, x, y, values), failed);
        }
        if self.params.fallback {
            return (
                self.mean(&window(size, &origin, &self.tests, finite), x, y, values),
                failed,
            );
        }
        (0.0, failed)
    }

    /// Writes the weighted mean of the taps and returns the sum of their weights.
    #[inline(always)]
    fn mean<const N: usize>(
        &self,
        taps: &Taps<N>,
        x: usize,
        y: usize,
        values: &mut BandMut,
    ) -> f32 {
        let weight = taps.weight();
        if weight > 0.0 {
            for (channel, plane) in self.history.iter().enumerate() {
                let sum: f32 = taps.as_slice().iter().map(|&(i, w)| w * plane[i]).sum();
                values.row(channel, y)[x] = sum / weight;
            }
        }
        weight.min(1.0)
    }

    /// Holds the values to the range of the taps.
    #[inline(always)]
    fn hold(&self, taps: &Taps<4>, x: usize, y: usize, values: &mut BandMut) {
        for (channel, plane) in self.history.iter().enumerate() {
            let [low, high] = taps
                .as_slice()
                .iter()
                .fold([f32::MAX, f32::MIN], |[low, high], &(i, _)| {
                    [low.min(plane[i]), high.max(plane[i])]
                });
            let value = &mut values.row(channel, y)[x];
            *value = value.clamp(low, high);
        }
    }
}
