//! Variance of luminance, from time where there is enough of it, from space where there is not.
//!
//! A history of at least `min_length` samples gives m₂ − m₁². A shorter one takes the means of both moments over a
//! window, weighted by the guide (no luminance: it is what is being estimated), and multiplies the variance by
//! min_length / N, so that young pixels are filtered boldly (Schied et al. 2017, section 4.2; Falcor's SVGFPass).
//!
//! Inputs: moments (2), history length (1), guide. Output: variance (1), squared luminance; below 1e-30 it is 0, since
//! subnormal numbers slow down every later filter. Pixels without moments do not count; where none does, it is 0.

use std::ops::Range;

use super::guide::{Comparison, Guide, Sigmas};
use crate::error::{Result, in_range, whole};
use crate::image::{BandMut, Size, View, bands_of};
use crate::lanes::{LANES, Lanes, Tap};
use crate::math::exp2_weight;
use crate::rows::{self, Kernel};

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
    rows::run(estimate, size.height, bands_of(variance, size));
}

impl<'a> Kernel for Estimate<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut variance: BandMut<'a>) {
        for y in rows {
            self.row(y, variance.row(0, y));
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
    pub fn row(&self, y: usize, variance: &mut [f32]) {
        let guide = self.guide.compare(&self.params.sigmas);
        let taps = self.guide.layout.taps(y, self.params.radius as isize, 1);
        for x in (0..variance.len()).step_by(LANES) {
            self.variance(x, y, &guide, &taps).store(variance, x);
        }
    }

    /// Of the pixels from (x, y) on.
    #[inline(always)]
    fn variance(&self, x: usize, y: usize, guide: &Comparison, taps: &[Tap]) -> Lanes {
        let [m1, m2] = self.moments(x as isize, y);
        // Beyond the row there is nothing to estimate.
        let length = Lanes::load_around(self.length.row(0, y), x as isize, f32::INFINITY);
        let temporal = (m2 - m1 * m1).map(floored);
        let mut lasts = known(m1, m2);
        let mut all = true;
        for lane in 0..LANES.min(self.length.size.width - x) {
            lasts.0[lane] &= length.0[lane] >= self.params.min_length;
            all &= lasts.0[lane];
        }
        if all {
            return temporal;
        }
        let mut spatial = self.spatial(x, y, guide, taps, length);
        for lane in 0..LANES {
            spatial.0[lane] = if lasts.0[lane] {
                temporal.0[lane]
            } else {
                spatial.0[lane]
            };
        }
        spatial
    }

    #[inline(always)]
    fn moments(&self, x: isize, y: usize) -> [Lanes; 2] {
        let [m1, m2] = self.moments.rows(y);
        [m1, m2].map(|row| Lanes::load_around(row, x, f32::NAN))
    }

    #[inline(always)]
    fn spatial(
        &self,
        x: usize,
        y: usize,
        guide: &Comparison,
        taps: &[Tap],
        length: Lanes,
    ) -> Lanes {
        let center = guide.center(x, y);
        let [mut weight, mut first, mut second] = [Lanes::all(0.0); 3];
        for &tap in taps {
            let [dx, dy] = tap.offset;
            let [m1, m2] = self.moments(x as isize + dx, y.wrapping_add_signed(dy));
            let known = known(m1, m2);
            let w = exp2_weight(guide.exponents(&center, tap, 0.0));
            let w = w.or(known, 0.0);
            weight = weight + w;
            first = first + (w * m1).or(known, 0.0);
            second = second + (w * m2).or(known, 0.0);
        }
        let some = weight.map(|w| w > 0.0);
        let (m1, m2) = (first / weight, second / weight);
        let samples = length.map(|n| if n > 1.0 { n } else { 1.0 });
        let young = Lanes::all(self.params.min_length) / samples;
        ((m2 - m1 * m1) * young).map(floored).or(some, 0.0)
    }
}

#[inline(always)]
fn known(m1: Lanes, m2: Lanes) -> Lanes<bool> {
    m1.zip(m2, |a, b| a.is_finite() & b.is_finite())
}
