//! Claims: which of the pixels that come from one place were there, as far as motion alone tells.
//!
//! What was seen at a pixel of the previous frame moves on about as it moved before. Of the pixels whose 2×2 footprints have
//! this tap, at most one surface's are right: those whose motion m differs least from the tap's own motion m′ in the previous
//! frame. With the claim
//!   c = min |m − m′| over these pixels, 0 if there is none,
//! another pixel's history is another surface's where |m − m′| − 2c exceeds a bound
//! ([`motion_difference`](super::validate::Params::motion_difference)). Speeds that change for the whole image,
//! as those of a camera in the hand, raise all claims alike, so that they are no reason to reject.
//!
//! SMAA's temporal mode trusts history by how far the lengths of both motions differ (Jimenez et al. 2012, *SMAA: Enhanced
//! Subpixel Morphological Antialiasing*); the least difference as the measure is ours.
//!
//! Inputs: motion (2 or 3), previous motion (2 or 3). Output: previous motion, and 2c (3); 0, 0 and infinity where the
//! previous motion is unknown. The scatter takes minima, which do not depend on order.

use std::ops::Range;

use super::footprint::Footprints;
use super::validate::Tests;
use crate::image::{Interleaved, Pixels, SEGMENT, segments};
use crate::math::distance;
use crate::minima::Minima;
use crate::pixels::{MotionLanes, PixelsMut};
use crate::rows::{self, Kernel, Simd};

/// The previous motion, and twice the least difference from it among the pixels that come from there.
pub fn claims(motion: Pixels, before: Pixels) -> Interleaved {
    let size = motion.size;
    let least = &Minima::new(size.pixels());
    let claim = Claim {
        motion,
        before,
        least,
    };
    rows::run(&claim, size.height, rows::bands(size.height).map(|_| ()));
    let mut claims = Interleaved::blank(size, 3);
    rows::run(&Tell { before, least }, size.height, claims.pixels_mut());
    claims
}

struct Claim<'a> {
    motion: Pixels<'a>,
    before: Pixels<'a>,
    least: &'a Minima,
}

impl Kernel for Claim<'_> {
    type Out = ();

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, (): ()) {
        let size = self.motion.size;
        let (mut lanes, mut footprints) = (MotionLanes::zeroed(), Footprints::new(size));
        for run in rows.flat_map(|y| segments(y, size.width)) {
            let motion = lanes.load(&self.motion, run);
            footprints.find(run, motion, false, &Tests::none());
            for i in 0..run.len {
                for &(at, _) in footprints.taps(i, |_| true).as_slice() {
                    let [x, y] = [0, 1].map(|channel| self.before.at(at, channel));
                    let difference = distance([motion.x[i], motion.y[i]], [x, y]);
                    if difference.is_finite() {
                        self.least.lower(at, difference);
                    }
                }
            }
        }
    }
}

struct Tell<'a> {
    before: Pixels<'a>,
    least: &'a Minima,
}

impl<'a> Kernel for Tell<'a> {
    type Out = PixelsMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut claims: PixelsMut<'a>) {
        let width = self.before.size.width;
        let mut told = [[0.0; SEGMENT]; 3];
        for run in rows.flat_map(|y| segments(y, width)) {
            for i in 0..run.len {
                let at = run.y * width + run.x + i;
                let [x, y] = [0, 1].map(|channel| self.before.at(at, channel));
                let least = self.least.get(at);
                let claim = if least.is_finite() { least } else { 0.0 };
                let known = x.is_finite() & y.is_finite();
                let told_here = if known {
                    [x, y, 2.0 * claim]
                } else {
                    [0.0, 0.0, f32::INFINITY]
                };
                for (lane, value) in told.iter_mut().zip(told_here) {
                    lane[i] = value;
                }
            }
            claims.write(run, &told);
        }
    }
}
