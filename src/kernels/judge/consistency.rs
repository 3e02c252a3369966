//! Consistency: why a pixel's history is refused, and how much of it is not.
//!
//! Over the bilinear footprint at the end of the motion vector: the mask has the bit of every test that one of the taps
//! fails, and the confidence is the share of the footprint's weight that passes them all. The tests and their sources
//! are those of [`super::surface`].

use std::ops::Range;

use super::surface::Tests;
use crate::image::{BandMut, Image, View};
use crate::kernels::fetch::footprint::{Filter, Motion, footprint};
use crate::rows::{self, Kernel};

struct Consistency<'a> {
    motion: Motion<'a>,
    tests: Tests<'a>,
}

/// The mask of failed tests and the confidence in [0, 1].
pub fn consistency(motion: View, tests: Tests) -> (Image<u8>, Image) {
    let size = motion.size;
    let mut rejection = Image::new(size, 1);
    let mut confidence = Image::new(size, 1);
    let kernel = Consistency {
        motion: Motion::new(motion),
        tests,
    };
    rows::run(
        &kernel,
        size.height,
        rejection.bands().zip(confidence.bands()),
    );
    (rejection, confidence)
}

impl<'a> Kernel for Consistency<'a> {
    type Out = (BandMut<'a, u8>, BandMut<'a>);

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, (mut rejection, mut confidence): Self::Out) {
        let size = self.motion.size();
        for y in rows {
            let (rejection, confidence) = (rejection.row(0, y), confidence.row(0, y));
            for x in 0..size.width {
                let origin = self.motion.origin(x, y, &self.tests);
                let (taps, failed) =
                    footprint(size, &origin, &self.tests, Filter::Bilinear, |_| true);
                (rejection[x], confidence[x]) = (failed, taps.weight().min(1.0));
            }
        }
    }
}
