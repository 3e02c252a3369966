//! Variance of luminance, from time where there is enough of it, from space where there is not.
//!
//! A history of at least `min_length` samples gives m₂ − m₁². A shorter one takes the means of both moments over a
//! window, weighted by the guide (no luminance: it is what is being estimated), and multiplies the variance by
//! min_length / N, so that young pixels are filtered boldly (Schied et al. 2017, section 4.2; Falcor's SVGFPass).
//!
//! Inputs: moments (2), history length (1), guide. Output: variance (1), squared luminance; below 1e-30 it is 0, since
//! subnormal numbers slow down every later filter. Pixels without moments do not count; where none does, it is 0.

use std::ops::Range;

use super::guide::{Center, Comparison, Guide, Sigmas};
use crate::error::{Result, Whole, in_range, whole};
use crate::image::{BandMut, Pixels, plane_bands, segments};
use crate::lanes::{LANES, Lanes, Mask, Tap};
use crate::math::exp2_weights;
use crate::pixels::Rolling;
use crate::rows::{self, Kernel, Simd};

/// Which variances are estimated in space, and over which window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// Samples from which the temporal variance is trusted; ≥ 1; 3.5: not a whole number, so that rounding of
    /// resampled lengths does not decide.
    pub min_length: f32,
    /// The window reaches so many pixels to each side; 0 to 16; 3.
    pub radius: usize,
    /// How far surfaces may differ.
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
    pub(crate) fn radius(value: impl Whole<usize>) -> Result<usize> {
        whole("radius", value, "0 to 16 pixels", |&n| n <= 16)
    }

    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        Self::radius(self.radius)?;
        in_range(
            "min_length",
            self.min_length,
            "a number of samples, 1 or more",
            |v| v >= 1.0,
        )?;
        self.sigmas.check()
    }
}

/// Taps whose weights are computed together.
const TOGETHER: usize = 4;

/// Smaller variances count as 0: subnormal numbers are slow.
pub(crate) const SMALLEST: f32 = 1e-30;

#[inline(always)]
pub(crate) fn floored(variance: f32) -> f32 {
    if variance >= SMALLEST { variance } else { 0.0 }
}

/// The variance of a history, estimated row by row.
pub struct Estimate<'a> {
    moments: Pixels<'a>,
    length: Pixels<'a>,
    guide: &'a Guide,
    params: Params,
}

/// Line buffers for the rows around one.
pub(crate) struct Around {
    moments: Rolling<2>,
    /// History length of the row's pixels.
    length: Vec<f32>,
}

/// Writes the variance.
pub fn estimate_variance(estimate: &Estimate, variance: &mut [f32]) {
    let size = estimate.moments.size;
    rows::run(estimate, size.height, plane_bands(variance, size));
}

impl<'a> Kernel for Estimate<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, simd: S, rows: Range<usize>, mut variance: BandMut<'a>) {
        let mut around = self.around();
        for y in rows.clone() {
            let first = y == rows.start;
            self.row(simd, y, first, &mut around, variance.row(0, y));
        }
    }
}

impl<'a> Estimate<'a> {
    /// The guide must reach as far as the window.
    pub fn new(moments: Pixels<'a>, length: Pixels<'a>, guide: &'a Guide, params: Params) -> Self {
        Self {
            moments,
            length,
            guide,
            params,
        }
    }

    /// Empty line buffers.
    #[inline(always)]
    pub(crate) fn around(&self) -> Around {
        let width = self.moments.size.width;
        Around {
            moments: Rolling::new(width, self.params.radius),
            length: vec![f32::INFINITY; width.next_multiple_of(LANES)],
        }
    }

    /// Estimates row `y`. Rows come in ascending order; `first` says that the line buffers are empty.
    #[inline(always)]
    pub(crate) fn row<S: Simd>(
        &self,
        simd: S,
        y: usize,
        first: bool,
        around: &mut Around,
        variance: &mut [f32],
    ) {
        let Around { moments, length } = around;
        moments.roll(self.moments, y, first);
        for run in segments(y, variance.len()) {
            self.length.load(run, 0, &mut length[run.x..][..run.len]);
        }
        let radius = self.params.radius as isize;
        let rows: Vec<_> = (-radius..=radius)
            .map(|dy| moments.row(y as isize + dy))
            .collect();
        let guide = self.guide.compare(&self.params.sigmas, self.params.radius);
        let taps = self.guide.layout.taps(y, self.params.radius, 1);
        for x in (0..variance.len()).step_by(Lanes::<S>::COUNT) {
            let length = Lanes::load(simd, length, x);
            let lanes = self.variance(simd, [x, y], &guide, &taps, &rows, length);
            lanes.store(variance, x);
        }
    }

    /// Estimates one register of pixels, from (x, y) on.
    #[inline(always)]
    fn variance<S: Simd>(
        &self,
        simd: S,
        at: [usize; 2],
        guide: &Comparison,
        taps: &[Tap],
        rows: &[[&[f32]; 2]],
        length: Lanes<S>,
    ) -> Lanes<S> {
        let radius = self.params.radius;
        let [m1, m2] = Lanes::load_all(simd, rows[radius], at[0] + radius);
        let temporal = floored_all(m2 - m1 * m1);
        let lasts = known(m1, m2).and(length.at_least(self.params.min_length));
        if lasts.all() {
            return temporal;
        }
        temporal.when_else(lasts, self.spatial(simd, at, guide, taps, rows, length))
    }

    #[inline(always)]
    fn spatial<S: Simd>(
        &self,
        simd: S,
        [x, y]: [usize; 2],
        guide: &Comparison,
        taps: &[Tap],
        rows: &[[&[f32]; 2]],
        length: Lanes<S>,
    ) -> Lanes<S> {
        let center = guide.center(simd, x, y);
        let mut sums = [Lanes::splat(simd, 0.0); 3];
        // Several taps at once hide the latency of each one's exponential.
        let (groups, rest) = taps.as_chunks::<TOGETHER>();
        for group in groups {
            self.add(simd, x, guide, &center, group, rows, &mut sums);
        }
        for tap in rest.as_chunks::<1>().0 {
            self.add(simd, x, guide, &center, tap, rows, &mut sums);
        }
        let [weight, first, second] = sums;
        let (m1, m2) = (first / weight, second / weight);
        let samples = length.when_or(length.above(1.0), 1.0);
        let young = Lanes::splat(simd, self.params.min_length) / samples;
        // Old pixels whose own moments are missing are no surer than others.
        let young = young.when_or(young.above(1.0), 1.0);
        floored_all((m2 - m1 * m1) * young).when_or(weight.above(0.0), 0.0)
    }

    /// Adds the weights and weighted moments of some taps.
    #[inline(always)]
    fn add<S: Simd, const N: usize>(
        &self,
        simd: S,
        x: usize,
        guide: &Comparison,
        center: &Center<S>,
        taps: &[Tap; N],
        rows: &[[&[f32]; 2]],
        [weight, first, second]: &mut [Lanes<S>; 3],
    ) {
        let mut exponents = [Lanes::splat(simd, 0.0); N];
        for (exponent, tap) in exponents.iter_mut().zip(taps) {
            [*exponent] = guide.exponents(simd, center, tap, [0.0]);
        }
        let weights = exp2_weights(exponents);
        for (&w, tap) in weights.iter().zip(taps) {
            let radius = self.params.radius;
            let [dx, dy] = tap.offset.map(|far| radius.wrapping_add_signed(far));
            let [m1, m2] = Lanes::load_all(simd, rows[dy], x + dx);
            let known = known(m1, m2);
            let w = w.when_or(known, 0.0);
            *weight = *weight + w;
            *first = w.mul_add(m1, *first).when_else(known, *first);
            *second = w.mul_add(m2, *second).when_else(known, *second);
        }
    }
}

#[inline(always)]
fn known<S: Simd>(m1: Lanes<S>, m2: Lanes<S>) -> Mask<S> {
    m1.is_finite().and(m2.is_finite())
}

/// [`floored`] for a register of pixels.
#[inline(always)]
pub(crate) fn floored_all<S: Simd>(variance: Lanes<S>) -> Lanes<S> {
    variance.when_or(variance.at_least(SMALLEST), 0.0)
}
