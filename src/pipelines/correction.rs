//! Corrections by the innovation ([`crate::kernels::judge::innovation`]), of the result and of the history behind it.

use super::frame::Motion;
use crate::image::{Pixels, Records};
use crate::kernels::judge::innovation::{self, Innovation, corrected, innovation};
use crate::math::luminance;
use crate::pixels::Colors;

/// What a frame's samples show to be wrong with a prediction of them, and the evidence for the next frame.
pub fn innovate(
    params: innovation::Params,
    fresh: &impl Colors,
    prediction: &impl Colors,
    length: Pixels,
    motion: &Motion,
    exposure: f32,
    evidence: Option<&Records>,
) -> (Innovation, Records) {
    let known = evidence.map(|evidence| innovation::Known {
        evidence: evidence.pixels(),
        motion: Some(motion.pixels()),
    });
    innovation(fresh, prediction, length, known, exposure, params)
}

/// Corrects the colour of one pixel's history. Its moments move with it, and their variance stays.
#[inline(always)]
pub fn correct_history(correction: [f32; 3], history: &mut [f32]) {
    let before = [history[0], history[1], history[2]];
    correct_light(correction, history);
    let [r, g, b] = before;
    let moved = luminance(history[0] - r, history[1] - g, history[2] - b);
    let first = history[3];
    history[3] += moved;
    history[4] += moved * (first + first + moved);
}

#[inline(always)]
pub fn correct_light(correction: [f32; 3], light: &mut [f32]) {
    for (light, correction) in light.iter_mut().zip(correction) {
        *light = corrected(*light, correction);
    }
}
