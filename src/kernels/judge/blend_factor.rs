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
use crate::image::{Pixels, SEGMENT, View, segments};
use crate::kernels::fetch::footprint::{Motion, MotionLanes};
use crate::math::saturate;
use crate::pixels::{PixelsMut, Row};
use crate::rows::{self, Kernel};

/// Weights of the new sample.
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
    /// An error if a parameter is out of range.
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
    fn rows(&self, rows: Range<usize>, mut alpha: PixelsMut<'a>) {
        let mut lanes = MotionLanes::zeroed();
        let mut shares = [0.0; SEGMENT];
        for run in rows.flat_map(|y| segments(y, self.confidence.size.width)) {
            let motion = self.motion.as_ref().map(|motion| lanes.load(motion, run));
            let confidence = &self.confidence.row(0, run.y)[run.x..][..run.len];
            self.params.shares(confidence, motion, &mut shares);
            alpha.write(run, [&shares[..]]);
        }
    }
}

impl Params {
    /// The shares of a run.
    #[inline(always)]
    pub(crate) fn shares(self, confidence: &[f32], motion: Option<Motion>, shares: &mut Row) {
        let Self {
            alpha: least,
            fast_alpha,
            speed,
        } = self;
        let n = confidence.len();
        let shares = &mut shares[..n];
        shares.fill(least);
        if let Some(motion) = motion {
            let (x, y) = (&motion.x[..n], &motion.y[..n]);
            for i in 0..n {
                let length = (x[i] * x[i] + y[i] * y[i]).sqrt();
                let haste = 1.0 - speed.trust(length, 1.0);
                let share = least + haste * (fast_alpha.max(least) - least);
                let known = x[i].is_finite() & y[i].is_finite();
                shares[i] = if known { share } else { 1.0 };
            }
            for (share, change) in shares.iter_mut().zip(motion.depth.unwrap_or_default()) {
                *share = if change.is_finite() { *share } else { 1.0 };
            }
        }
        for (share, &confidence) in shares.iter_mut().zip(confidence) {
            let doubt = 1.0 - saturate(confidence);
            *share += doubt * (1.0 - *share);
        }
    }
}
