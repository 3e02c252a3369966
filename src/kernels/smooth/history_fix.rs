//! History fix: pixels that have just come into view take the mean of their surface around them.
//!
//! Where history has fewer than a few samples, 5×5 taps, far apart at first and closer as samples arrive, are averaged
//! with the weights of a guide (see [`super::guide`]) and the number of samples that each tap has:
//!   c ← Σ w N c / Σ w N,  taps at multiples of max(1, ⌊stride/(1 + N) + ½⌋) pixels
//! (NRD's ReBLUR and ReLAX: stride 14, histories below 3). Taps that are older than the pixel itself weigh more.
//!
//! Inputs: colour (3), length (1), guide. Output: colour (3). Other pixels keep their bits; missing taps do not count.

use std::ops::Range;

use pulp::Simd;

use super::guide::{Guide, Sigmas};
use crate::error::{Result, in_range};
use crate::image::{BandMut, Image, View};
use crate::math::{exp2_weight, is_present};
use crate::rows::{self, LanesKernel};

#[derive(Clone, Copy, Debug)]
pub struct Params {
    /// Histories below this are fixed; ≥ 0; 3.
    pub max_length: f32,
    /// Distance of the taps, in pixels, for no history; 1 to 64; 14.
    pub stride: f32,
    pub sigmas: Sigmas,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            max_length: 3.0,
            stride: 14.0,
            sigmas: Sigmas::default(),
        }
    }
}

impl Params {
    /// Pixels from the farthest tap to the centre.
    pub fn reach(&self) -> usize {
        2 * (self.stride + 0.5) as usize
    }

    pub fn check(&self) -> Result<()> {
        in_range(
            "max_length",
            self.max_length,
            "a finite number from 0",
            |v| v >= 0.0 && v.is_finite(),
        )?;
        in_range("stride", self.stride, "1 to 64 pixels", |v| {
            (1.0..=64.0).contains(&v)
        })?;
        self.sigmas.check()
    }
}

struct Fix<'a> {
    color: View<'a>,
    length: View<'a>,
    guide: &'a Guide,
    params: Params,
}

pub fn fix_history(color: View, length: View, guide: &Guide, params: Params) -> Image {
    let mut fixed = Image::blank(color.size, 3);
    let kernel = Fix {
        color,
        length,
        guide,
        params,
    };
    rows::run_lanes(&kernel, color.size.height, fixed.bands());
    fixed
}

impl<'a> LanesKernel for Fix<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, simd: S, rows: Range<usize>, mut fixed: BandMut<'a>) {
        for y in rows {
            for channel in 0..3 {
                fixed
                    .row(channel, y)
                    .copy_from_slice(self.color.row(channel, y));
            }
            for (x, &length) in self.length.row(0, y).iter().enumerate() {
                if length < self.params.max_length
                    && let Some(mean) = self.mean(simd, x, y, length)
                {
                    for (channel, mean) in mean.into_iter().enumerate() {
                        fixed.row(channel, y)[x] = mean;
                    }
                }
            }
        }
    }
}

impl Fix<'_> {
    #[inline(always)]
    fn mean<S: Simd>(&self, simd: S, x: usize, y: usize, length: f32) -> Option<[f32; 3]> {
        let step = (self.params.stride / (1.0 + length.max(0.0)) + 0.5).max(1.0) as usize;
        let (mut weight, mut sum) = (0.0, [0.0; 3]);
        let guide = self.guide.compare(&self.params.sigmas);
        let center = guide.center(simd, x, y);
        for tap in self.guide.layout.taps(y, 2, step) {
            let [dx, dy] = tap.offset;
            let (x, y) = (x.wrapping_add_signed(dx), y.wrapping_add_signed(dy));
            if x >= self.color.size.width {
                continue;
            }
            let color = [0, 1, 2].map(|c| self.color.row(c, y)[x]);
            let samples = self.length.row(0, y)[x];
            if is_present(color) && samples > 0.0 {
                let weights = exp2_weight(guide.exponents(simd, &center, tap, 0.0));
                let w = weights.first() * samples;
                weight += w;
                for (sum, c) in sum.iter_mut().zip(color) {
                    *sum += w * c;
                }
            }
        }
        (weight > 0.0).then(|| sum.map(|sum| sum / weight))
    }
}
