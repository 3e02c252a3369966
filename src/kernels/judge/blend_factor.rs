//! The blend factor α of the new sample, from the confidence in history and from speed.
//!
//!   α = lerp(α₀, 1, 1 − confidence),  α₀ = lerp(α_min, max(α_min, α_fast), (|motion| − s₀)/(s₁ − s₀)),
//!
//! the last clamped to [0, 1]: history gives way smoothly where confidence is low, and where motion is fast, because
//! resampling has blurred it and its ghosts would be long. Without motion α₀ is α_min.
//!
//! Inputs: confidence (1) in [0, 1], motion (2 or 3), optional. Output: α (1) in [0, 1]; 1 where motion is not finite.

use std::ops::Range;

use crate::error::{Result, from_0_to_1};
use crate::image::{Pixels, SEGMENT, View, segments};
use crate::kernels::fetch::validate::Threshold;
use crate::math::saturate;
use crate::pixels::{MotionLanes, MotionRun, PixelsMut, Row};
use crate::rows::{self, Kernel, Simd};

/// Weights of the new sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// α_min: for full confidence and slow motion; 0 to 1; 0.05.
    pub alpha: f32,
    /// α_fast: for full confidence and fast motion; 0 to 1; 0.2.
    pub fast_alpha: f32,
    /// s₀ and s₁ in pixels: slow up to the first, fast from the second; ≥ 0; 0 and 1.
    pub speed: Threshold,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            alpha: 0.05,
            fast_alpha: 0.2,
            speed: Threshold {
                full: 0.0,
                none: 1.0,
            },
        }
    }
}

impl Params {
    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        for (name, value) in [("alpha", self.alpha), ("fast_alpha", self.fast_alpha)] {
            from_0_to_1(name, value)?;
        }
        self.speed.check("speed", "pixels from 0", |v| v >= 0.0)
    }
}

struct BlendFactor<'a> {
    confidence: View<'a>,
    motion: Option<Pixels<'a>>,
    params: Params,
}

/// Writes the weight of the new sample.
pub fn blend_factor<'a>(
    confidence: View<'a>,
    motion: Option<Pixels<'a>>,
    params: Params,
    alpha: impl Iterator<Item = PixelsMut<'a>>,
) {
    let height = confidence.size.height;
    let kernel = BlendFactor {
        confidence,
        motion,
        params,
    };
    rows::run(&kernel, height, alpha);
}

impl<'a> Kernel for BlendFactor<'a> {
    type Out = PixelsMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut alpha: PixelsMut<'a>) {
        let mut lanes = MotionLanes::zeroed();
        let mut alphas = [0.0; SEGMENT];
        for run in rows.flat_map(|y| segments(y, self.confidence.size.width)) {
            let motion = self.motion.as_ref().map(|motion| lanes.load(motion, run));
            let confidence = self.confidence.run(0, run);
            self.params.shares(confidence, motion, &mut alphas);
            alpha.write(run, [&alphas[..]]);
        }
    }
}

impl Params {
    /// The blend factors of a span.
    #[inline(always)]
    pub(crate) fn shares(self, confidence: &[f32], motion: Option<MotionRun>, alphas: &mut Row) {
        let Self {
            alpha: least,
            fast_alpha,
            speed,
        } = self;
        let n = confidence.len();
        let alphas = &mut alphas[..n];
        alphas.fill(least);
        if let Some(motion) = motion {
            let (x, y) = (&motion.x[..n], &motion.y[..n]);
            for i in 0..n {
                let length = (x[i] * x[i] + y[i] * y[i]).sqrt();
                let haste = 1.0 - speed.trust(length, 1.0);
                let alpha = least + haste * (fast_alpha.max(least) - least);
                let known = x[i].is_finite() & y[i].is_finite();
                alphas[i] = if known { alpha } else { 1.0 };
            }
            for (alpha, change) in alphas.iter_mut().zip(motion.depth.unwrap_or_default()) {
                *alpha = if change.is_finite() { *alpha } else { 1.0 };
            }
        }
        for (alpha, &confidence) in alphas.iter_mut().zip(confidence) {
            let doubt = 1.0 - saturate(confidence);
            *alpha += doubt * (1.0 - *alpha);
        }
    }
}
