//! Variance of luminance, from time where there is enough of it, from space where there is not.
//!
//! A history of at least `min_length` samples gives m₂ − m₁². A shorter one takes the means of both moments over a
//! window, weighted by the guide (no luminance: it is what is being estimated), and multiplies the variance by
//! min_length / N, so that young pixels are filtered boldly (Schied et al. 2017, section 4.2; Falcor's SVGFPass).
//!
//! Inputs: moments (2), history length (1), guide. Output: variance (1), squared luminance; below 1e-30 it is 0, since
//! subnormal numbers slow down every later filter. Pixels without moments do not count; where none does, it is 0.

use std::ops::Range;

use pulp::Simd;

use super::guide::{Comparison, Guide, Sigmas};
use crate::error::{Result, in_range, whole};
use crate::image::{BandMut, Size, View, bands_of};
use crate::lanes::{Lanes, Mask, Tap};
use crate::math::exp2_weight;
use crate::rows::{self, LanesKernel};

#[derive(Clone, Copy, Debug)]
pub struct Params {
    /// Samples from which the temporal variance is trusted; ≥ 1; 3.5: not a whole number, so that rounding of
    /// resampled lengths does not decide.
    pub min_length: f32,
    /// The window reaches so many pixels to each side; 0 to 16; 3.
    pub radius: usize,
    pub sigmas: Sigmas,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            min_length: 3.5,
            radius: 3,
            sigmas: Sigmas::default(),
        }
    }
}

impl Params {
    /// A window's radius.
    pub fn radius(value: i64) -> Result<usize> {
        whole("radius", value, "0 to 16 pixels", |&n| n <= 16)
    }

    pub fn check(&self) -> Result<()> {
        in_range(
            "min_length",
            self.min_length,
            "a number of samples, 1 or more",
            |v| v >= 1.0,
        )?;
        self.sigmas.check()
    }
}

/// Below this, a variance is 0.
pub const SMALLEST: f32 = 1e-30;

#[inline(always)]
pub fn floored(variance: f32) -> f32 {
    if variance >= SMALLEST { variance } else { 0.0 }
}

/// An estimate that can be made row by row.
pub struct Estimate<'a> {
    moments: View<'a>,
    length: View<'a>,
    guide: &'a Guide,
    params: Params,
}

pub fn estimate_variance(estimate: &Estimate, size: Size, variance: &mut [f32]) {
    rows::run_lanes(estimate, size.height, bands_of(variance, size));
}

impl<'a> LanesKernel for Estimate<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, simd: S, rows: Range<usize>, mut variance: BandMut<'a>) {
        for y in rows {
            self.row(simd, y, variance.row(0, y));
        }
    }
}

impl<'a> Estimate<'a> {
    /// Planes as in [`crate::kernels::merge::accumulate`]; a guide for at least the window's radius.
    pub fn new(moments: View<'a>, length: View<'a>, guide: &'a Guide, params: Params) -> Self {
        Self {
            moments,
            length,
            guide,
            params,
        }
    }

    #[inline(always)]
    pub fn row<S: Simd>(&self, simd: S, y: usize, variance: &mut [f32]) {
        let guide = self.guide.compare(&self.params.sigmas);
        let taps = self.guide.layout.taps(y, self.params.radius, 1);
        for x in (0..variance.len()).step_by(Lanes::<S>::COUNT) {
            self.variance(simd, x, y, &guide, &taps).store(variance, x);
        }
    }

    /// Of the pixels from (x, y) on.
    #[inline(always)]
    fn variance<S: Simd>(
        &self,
        simd: S,
        x: usize,
        y: usize,
        guide: &Comparison,
        taps: &[Tap],
    ) -> Lanes<S> {
        // Beyond the row there is nothing to estimate.
        let [m1, m2] = self.moments(simd, x as isize, y, 0.0);
        let length = Lanes::load_around(simd, self.length.row(0, y), x as isize, f32::INFINITY);
        let temporal = floored_all(m2 - m1 * m1);
        let lasts = known(m1, m2).and(length.at_least(self.params.min_length));
        if lasts.all() {
            return temporal;
        }
        temporal.or(lasts, self.spatial(simd, x, y, guide, taps, length))
    }

    #[inline(always)]
    fn moments<S: Simd>(&self, simd: S, x: isize, y: usize, outside: f32) -> [Lanes<S>; 2] {
        let (m1, m2) = (self.moments.row(0, y), self.moments.row(1, y));
        [
            Lanes::load_around(simd, m1, x, outside),
            Lanes::load_around(simd, m2, x, outside),
        ]
    }

    #[inline(always)]
    fn spatial<S: Simd>(
        &self,
        simd: S,
        x: usize,
        y: usize,
        guide: &Comparison,
        taps: &[Tap],
        length: Lanes<S>,
    ) -> Lanes<S> {
        let center = guide.center(simd, x, y);
        let [mut weight, mut first, mut second] = [Lanes::all(simd, 0.0); 3];
        for tap in taps {
            let [dx, dy] = tap.offset;
            let (x, y) = (x as isize + dx, y.wrapping_add_signed(dy));
            let [m1, m2] = self.moments(simd, x, y, f32::NAN);
            let known = known(m1, m2);
            let [exponent] = guide.exponents(simd, &center, tap, [0.0]);
            let w = exp2_weight(exponent).or_all(known, 0.0);
            weight = weight + w;
            first = first + (w * m1).or_all(known, 0.0);
            second = second + (w * m2).or_all(known, 0.0);
        }
        let (m1, m2) = (first / weight, second / weight);
        let samples = length.or_all(length.above(1.0), 1.0);
        let young = Lanes::all(simd, self.params.min_length) / samples;
        floored_all((m2 - m1 * m1) * young).or_all(weight.above(0.0), 0.0)
    }
}

#[inline(always)]
fn known<S: Simd>(m1: Lanes<S>, m2: Lanes<S>) -> Mask<S> {
    m1.is_finite().and(m2.is_finite())
}

/// The same of neighbouring pixels.
#[inline(always)]
pub fn floored_all<S: Simd>(variance: Lanes<S>) -> Lanes<S> {
    variance.or_all(variance.at_least(SMALLEST), 0.0)
}
