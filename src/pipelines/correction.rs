//! Correction: what new samples show to be wrong with a result is added to it, and to the history that it was made of.

use crate::image::{Pixels, Records};
use crate::kernels::judge::innovation::{self, Innovation, innovation};
use crate::pixels::Colors;

/// Finds what new samples show to be wrong with a prediction, by this frame's and by the evidence of frames before, which
/// comes along the motion. Returns it with the evidence for the next frame.
pub fn innovate(
    params: innovation::Params,
    fresh: &impl Colors,
    prediction: &impl Colors,
    length: Pixels,
    motion: Pixels,
    exposure: f32,
    evidence: Option<&Records>,
) -> (Innovation, Records) {
    let known = evidence.map(|evidence| innovation::Known {
        evidence: evidence.pixels(),
        motion: Some(motion),
    });
    innovation(fresh, prediction, length, known, exposure, params)
}
