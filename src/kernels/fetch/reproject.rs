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

use glam::Vec2;

use super::footprint::{Filter, MIN_COVERAGE, Motion, Taps, bilinear, footprint, wide, window};
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
    /// Whether there are none.
    untested: bool,
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
        untested: tests.accept_all(),
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
        if self.untested
            && let Some(coverage) = self.inside(origin.from, x, y, values)
        {
            return (coverage, 0);
        }
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

    /// The same without a look at each tap, where nothing is tested: if all taps are inside, and finite, which their sum
    /// tells.
    #[inline(always)]
    fn inside(&self, from: Vec2, x: usize, y: usize, values: &mut BandMut) -> Option<f32> {
        let size = self.motion.size();
        let (before, after) = match self.params.filter {
            Filter::Nearest => return None,
            Filter::Bilinear => (0.0, 1.0),
            Filter::Wide(_) => (1.0, 2.0),
        };
        let corner = from.floor();
        let reaches = |at: f32, side: usize| at >= before && at + after < side as f32;
        if !(reaches(corner.x, size.width) && reaches(corner.y, size.height)) {
            return None;
        }
        let f = from - corner;
        let index = corner.y as usize * size.width + corner.x as usize;
        let near = bilinear(f);
        let weight = near[0] + near[1] + near[2] + near[3];
        let wide = match self.params.filter {
            Filter::Wide(kernel) => Some(kernel.matrix(f)),
            _ => None,
        };
        let mut finite = true;
        for (channel, plane) in self.history.iter().enumerate() {
            let tap = |dx: usize, dy: usize| plane[index + dy * size.width + dx];
            let taps = [tap(0, 0), tap(1, 0), tap(0, 1), tap(1, 1)];
            let mean = match &wide {
                Some(weights) => wide_mean(weights, &plane[index - size.width - 1..], size.width),
                None => {
                    let sum = (near.iter().zip(taps)).fold(0.0, |sum, (&weight, tap)| {
                        sum + if weight > 0.0 { weight * tap } else { 0.0 }
                    });
                    sum / weight
                }
            };
            finite &= mean.is_finite();
            values.row(channel, y)[x] = if wide.is_some() && self.params.dering {
                let counting = near.iter().zip(taps).filter(|&(&weight, _)| weight > 0.0);
                held(mean, counting.map(|(_, tap)| tap))
            } else {
                mean
            };
        }
        if !finite {
            for channel in 0..self.history.len() {
                values.row(channel, y)[x] = 0.0;
            }
            return None;
        }
        Some(weight.min(1.0))
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
                let taps = taps.as_slice().iter();
                let sum = taps.fold(0.0, |sum, &(i, w)| sum + w * plane[i]);
                values.row(channel, y)[x] = sum / weight;
            }
        }
        weight.min(1.0)
    }

    /// Holds the values to the range of the taps.
    #[inline(always)]
    fn hold(&self, taps: &Taps<4>, x: usize, y: usize, values: &mut BandMut) {
        for (channel, plane) in self.history.iter().enumerate() {
            let value = &mut values.row(channel, y)[x];
            *value = held(*value, taps.as_slice().iter().map(|&(i, _)| plane[i]));
        }
    }
}

/// The mean of 4×4 taps, of which the first begins `plane`.
#[inline(always)]
fn wide_mean(weights: &[[f32; 4]; 4], plane: &[f32], width: usize) -> f32 {
    let (mut sum, mut total) = (0.0, 0.0);
    for (row, weights) in weights.iter().enumerate() {
        for (weight, tap) in weights.iter().zip(&plane[row * width..][..4]) {
            sum += if *weight != 0.0 { weight * tap } else { 0.0 };
            total += weight;
        }
    }
    sum / total
}

/// A value held to the range of the taps.
#[inline(always)]
fn held(value: f32, taps: impl Iterator<Item = f32>) -> f32 {
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    for tap in taps {
        (low, high) = (low.min(tap), high.max(tap));
    }
    value.max(low).min(high)
}
