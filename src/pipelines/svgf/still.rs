//! Frames in which nothing moves: the mean of all samples, from which the result takes its detail.

use super::Current;
use crate::image::{Image, Pixels, Records};
use crate::kernels::judge::exposure::exposure;
use crate::kernels::merge::accumulate::{CHANNELS, Images, Samples, accumulate};
use crate::kernels::merge::converge::converge;
use crate::pipelines::correction::{history_factor, scale};
use crate::pipelines::recall::Recalled;
use crate::pixels::PixelsMut;

/// What goes from one such frame to the next.
pub struct Still {
    /// Frames since the last in which something moved.
    pub frames: u32,
    /// The samples as they were rendered, with texture: colour, moments and number. They are forgotten where the history is.
    mean: Records,
}

impl Still {
    /// Adds a frame's samples, before which all light has changed by a factor.
    pub fn add(before: Option<Self>, now: &Current, recalled: Option<&Recalled>) -> Self {
        let size = now.size();
        let (frames, mut mean) = match before {
            Some(still) => (still.frames, still.mean),
            None => (0, Records::new(size, CHANNELS)),
        };
        let change = recalled.map_or(1.0, |recalled| recalled.change);
        if change != 1.0 {
            let factors: [_; CHANNELS] =
                std::array::from_fn(|channel| history_factor(channel, change));
            scale(size.width, mean.data_mut(), &factors);
        }
        let gradient = recalled.and_then(|recalled| recalled.gradient.as_ref());
        let samples = Samples {
            size,
            color: &now.frame.color,
            weight: None,
            gradient: gradient.map(Image::view),
        };
        let known = Images {
            parts: parts(&mean),
            confidence: None,
        };
        let mut merged = Records::blank(size, CHANNELS);
        let bands = PixelsMut::bands(size, CHANNELS, merged.data_mut());
        let outs = bands.map(|all| [(0..CHANNELS, all)]);
        accumulate(samples, &known, now.accumulate, outs, std::iter::repeat(()));
        Self {
            frames: frames + 1,
            mean: merged,
        }
    }

    /// Mixes the mean into what is shown.
    pub fn show(&self, shown: &mut [f32]) {
        let bright = exposure(Pixels::records(self.mean.size, 3, shown));
        converge(shown, parts(&self.mean), bright);
    }
}

/// Colour, moments and number of samples.
fn parts(mean: &Records) -> [Pixels<'_>; 3] {
    [0..3, 3..5, 5..6].map(|part| mean.pixels().part(part))
}
