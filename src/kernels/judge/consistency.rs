//! Consistency: which tests a pixel's history fails, and the confidence in it.
//!
//! Over the bilinear footprint at the end of the motion vector: the mask has the bit of every test that any tap fails, and
//! the confidence is the fraction of the footprint's weight that passes all tests. The tests and their sources are those
//! of [`super::super::fetch::validate`].

use std::ops::Range;

use crate::image::{BandMut, Pixels, segments};
use crate::kernels::fetch::footprint::Footprints;
use crate::kernels::fetch::validate::Tests;
use crate::pixels::MotionLanes;
use crate::rows::{self, Kernel, Simd};

struct Consistency<'a> {
    motion: Pixels<'a>,
    tests: Tests<'a>,
}

/// Writes the mask of failed tests and the confidence in [0, 1].
pub fn consistency<'a>(
    motion: Pixels<'a>,
    tests: Tests<'a>,
    judged: impl Iterator<Item = (BandMut<'a, u8>, BandMut<'a>)>,
) {
    let kernel = Consistency { motion, tests };
    rows::run(&kernel, motion.size.height, judged);
}

impl<'a> Kernel for Consistency<'a> {
    type Out = (BandMut<'a, u8>, BandMut<'a>);

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, (mut rejection, mut confidence): Self::Out) {
        let size = self.motion.size;
        let mut lanes = MotionLanes::zeroed();
        let mut footprints = Footprints::new(size);
        for run in rows.flat_map(|y| segments(y, size.width)) {
            let motion = lanes.load(&self.motion, run);
            footprints.find(run, motion, false, &self.tests);
            let part = run.x..run.x + run.len;
            let (rejection, confidence) = (
                &mut rejection.row(0, run.y)[part.clone()],
                &mut confidence.row(0, run.y)[part],
            );
            for i in 0..run.len {
                rejection[i] = footprints.failed[i] as u8;
                confidence[i] = footprints.coverage[i].min(1.0);
            }
        }
    }
}
