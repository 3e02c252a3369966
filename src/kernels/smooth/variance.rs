//! Variance of luminance, from time where there is enough of it, from space where there is not.
//!
//! A history of at least `min_length` samples gives m₂ − m₁². A shorter one takes the means of both moments over a
//! window, weighted by the guide (no luminance: it is what is being estimated), and multiplies the variance by
//! min_length / N, so that young pixels are filtered boldly (Schied et al. 2017, section 4.2; Falcor's SVGFPass).
//!
//! Inputs: moments (2), history length (1), guide. Output: variance (1), squared luminance; below 1e-30 it is 0, since
//! subnormal numbers slow down every later filter. Pixels without moments do not count; where none does, it is 0.

use std::ops::Range;

use super::guide::{Guide, Sigmas};
use crate::error::{Result, in_range, whole};
use crate::image::{BandMut, Image, Run, SEGMENT, Size, Tap, View};
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

struct Estimate<'a> {
    size: Size,
    moments: [&'a [f32]; 2],
    length: &'a [f32],
    guide: &'a Guide,
    params: Params,
}

/// The variance of a history image's moments; planes as in [`crate::kernels::merge::accumulate`].
pub fn estimate_variance(moments: View, length: View, guide: &Guide, params: Params) -> Image {
    let size = length.size;
    let mut variance = Image::new(size, 1);
    let moments = [moments.plane(0), moments.plane(1)];
    let kernel = Estimate {
        size,
        moments,
        length: length.plane(0),
        guide,
        params,
    };
    rows::run(&kernel, size.height, variance.bands());
    variance
}

#[derive(Clone, Copy)]
struct Sums {
    weight: [f32; SEGMENT],
    first: [f32; SEGMENT],
    second: [f32; SEGMENT],
}

impl<'a> Kernel for Estimate<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut variance: BandMut<'a>) {
        for y in rows {
            for x in (0..self.size.width).step_by(SEGMENT) {
                let run = Run {
                    y,
                    x,
                    len: SEGMENT.min(self.size.width - x),
                };
                let (moments, length) = self.of(run);
                let out = &mut variance.row(0, y)[x..][..run.len];
                temporal(moments, out);
                if (0..run.len).any(|i| self.is_short(moments, length, i)) {
                    let sums = self.window(run);
                    for i in 0..run.len {
                        if self.is_short(moments, length, i) {
                            out[i] = self.spatial(&sums, length[i], i);
                        }
                    }
                }
            }
        }
    }
}

#[inline(always)]
fn temporal([m1, m2]: [&[f32]; 2], out: &mut [f32]) {
    for ((out, &m1), &m2) in out.iter_mut().zip(m1).zip(m2) {
        *out = floored(m2 - m1 * m1);
    }
}

impl<'a> Estimate<'a> {
    #[inline(always)]
    fn of(&self, run: Run) -> ([&'a [f32]; 2], &'a [f32]) {
        let pixels = |plane: &'a [f32]| &plane[run.y * self.size.width + run.x..][..run.len];
        (self.moments.map(pixels), pixels(self.length))
    }

    #[inline(always)]
    fn is_short(&self, [m1, m2]: [&[f32]; 2], length: &[f32], i: usize) -> bool {
        !((length[i] >= self.params.min_length) & m1[i].is_finite() & m2[i].is_finite())
    }

    /// Weighted sums of the moments around the pixels of a run.
    #[inline(always)]
    fn window(&self, run: Run) -> Sums {
        let mut sums = Sums {
            weight: [0.0; SEGMENT],
            first: [0.0; SEGMENT],
            second: [0.0; SEGMENT],
        };
        let radius = self.params.radius as isize;
        for dy in -radius..=radius {
            for dx in -radius..=radius {
                let tap = Tap { dx, dy, step: 1 };
                let Some(here) = tap.inside(run, self.size) else {
                    continue;
                };
                let mut exponents = [0.0; SEGMENT];
                let exponents = &mut exponents[..here.len];
                self.guide
                    .subtract(exponents, &self.params.sigmas, here, tap);
                let (moments, _) = self.of(tap.of(here));
                let at = here.x - run.x;
                let Sums {
                    weight,
                    first,
                    second,
                } = &mut sums;
                let part = [weight, first, second].map(|sum| &mut sum[at..][..here.len]);
                add(part, exponents, moments);
            }
        }
        sums
    }

    #[inline(always)]
    fn spatial(&self, sums: &Sums, length: f32, i: usize) -> f32 {
        if sums.weight[i] == 0.0 {
            return 0.0;
        }
        let (m1, m2) = (
            sums.first[i] / sums.weight[i],
            sums.second[i] / sums.weight[i],
        );
        let samples = if length > 1.0 { length } else { 1.0 };
        floored((m2 - m1 * m1) * (self.params.min_length / samples))
    }
}

#[inline(always)]
fn add([weight, first, second]: [&mut [f32]; 3], exponents: &[f32], [m1, m2]: [&[f32]; 2]) {
    let n = exponents.len();
    let (weight, first, second) = (&mut weight[..n], &mut first[..n], &mut second[..n]);
    let (m1, m2) = (&m1[..n], &m2[..n]);
    for i in 0..n {
        let known = m1[i].is_finite() & m2[i].is_finite();
        let w = if known {
            exp2_weight(exponents[i])
        } else {
            0.0
        };
        weight[i] += w;
        first[i] += if known { w * m1[i] } else { 0.0 };
        second[i] += if known { w * m2[i] } else { 0.0 };
    }
}
