//! Whether the noise of a pipeline's frames repeats ([`crate::kernels::judge::repetition`]).

use crate::image::{Image, Pixels};
use crate::kernels::judge::repetition::{luminances, repetition};

/// Noise counts as repeated above this: between the values of sequences with independent noise and with one seed for all.
const REPEATS: f32 = 0.3;

/// What the next frame compares itself with.
pub struct Noise {
    luminance: Image,
    deviation: Option<Image>,
}

impl Noise {
    /// Compares the next frame's samples, best without texture, with those before. Also tells whether their noise is the same.
    pub fn compare(before: Option<Self>, samples: Pixels, motion: Pixels) -> (Self, bool) {
        let luminance = luminances(samples);
        let found = before.map(|before| {
            let known = before.deviation.as_ref().map(Image::view);
            repetition(luminance.view(), before.luminance.view(), motion, known)
        });
        let (share, deviation) = found.unzip();
        let seen = Self {
            luminance,
            deviation,
        };
        (seen, share.is_some_and(|share| share > REPEATS))
    }
}
