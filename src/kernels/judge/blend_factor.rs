//! The share of the new sample, from the confidence in history and from speed.
//!
//!   α = lerp(α₀, 1, 1 − confidence),  α₀ = lerp(α_min, max(α_min, α_fast), (|motion| − s₀)/(s₁ − s₀)),
//!
//! the last clamped to [0, 1]: a doubtful history gives way smoothly, and so does one that came a long way, which
//! resampling has blurred and whose ghosts would be long. Without motion α₀ is α_min.
//!
//! Inputs: confidence (1) in [0, 1], motion (2 or 3), optional. Output: α (1) in [0, 1]; 1 where motion is not finite.

use std::ops::Range;

use super::surface::Threshold;
use crate::error::{Result, in_range};
use crate::image::{BandMut, Image, View};
use crate::math::saturate;
use crate::rows::{self, Kernel};

#[derive(Clone, Copy, Debug)]
pub struct Params {
    /// Share under full confidence and slow motion; 0 to 1; 0.05.
    pub alpha: f32,
    /// Share under full confidence and fast motion; 0 to 1; 0.2.
    pub fast_alpha: f32,
    /// Slow up to the first, fast from the second; pixels from 0; 0 and 1.
    pub speed: Threshold,
}

impl Params {
    pub fn check(&self) -> Result<()> {
        for (name, value) in [("alpha", self.alpha), ("fast_alpha", self.fast_alpha)] {
            in_range(name, value, "a share from 0 to 1", |v| {
                (0.0..=1.0).contains(&v)
            })?;
        }
        self.speed.check("speed", "pixels from 0", |v| v >= 0.0)
    }
}

struct BlendFactor<'a> {
    confidence: View<'a>,
    motion: Option<View<'a>>,
    params: Params,
}

pub fn blend_factor(confidence: View, motion: Option<View>, params: Params) -> Image {
    let mut alpha = Image::new(confidence.size, 1);
    let kernel = BlendFactor {
        confidence,
        motion,
        params,
    };
    rows::run(&kernel, confidence.size.height, alpha.bands());
    alpha
}

impl<'a> Kernel for BlendFactor<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut alpha: BandMut<'a>) {
        let Params {
            alpha: least,
            fast_alpha,
            speed,
        } = self.params;
        for y in rows {
            let out = alpha.row(0, y);
            out.fill(least);
            if let Some(motion) = self.motion {
                for (alpha, (&x, &y)) in out
                    .iter_mut()
                    .zip(motion.row(0, y).iter().zip(motion.row(1, y)))
                {
                    let length = (x * x + y * y).sqrt();
                    let haste = 1.0 - speed.trust(length, 1.0);
                    *alpha = least + haste * (fast_alpha.max(least) - least);
                }
                for channel in 0..motion.channels {
                    for (alpha, motion) in out.iter_mut().zip(motion.row(channel, y)) {
                        *alpha = if motion.is_finite() { *alpha } else { 1.0 };
                    }
                }
            }
            for (alpha, &confidence) in out.iter_mut().zip(self.confidence.row(0, y)) {
                let doubt = 1.0 - saturate(confidence);
                *alpha += doubt * (1.0 - *alpha);
            }
        }
    }
}
