//! Parallax: what stands in for depth where only motion is known.
//!
//! Where the camera moves aside, near surfaces move faster than far ones: their speed in the image is proportional to the
//! inverse of depth. With the length |m| of a pixel's motion in pixels,
//!   Z = 1 / (s + |m|), s = 10 pixels,
//! tells surfaces apart in a filter that compares distances from the tangent plane
//! ([`guide`](crate::kernels::smooth::guide)). It is no depth: by s, surfaces differ where their motion differs by half a pixel
//! or so, a twentieth of s, however slowly all moves. Unknown motion counts as none.
//!
//! Input: motion (2 or 3). Output: (1).

use std::ops::Range;

use crate::image::{BandMut, Image, Pixels, segments};
use crate::math::distance;
use crate::pixels::MotionLanes;
use crate::rows::{self, Kernel, Simd};

/// s, in pixels.
const STILL: f32 = 10.0;

/// The stand-in for depth.
pub fn parallax(motion: Pixels) -> Image {
    let mut depth = Image::blank(motion.size, 1);
    rows::run(&Parallax(motion), motion.size.height, depth.bands());
    depth
}

struct Parallax<'a>(Pixels<'a>);

impl<'a> Kernel for Parallax<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut depth: Self::Out) {
        let Self(motion) = self;
        let mut lanes = MotionLanes::zeroed();
        for y in rows {
            let row = depth.row(0, y);
            for run in segments(y, motion.size.width) {
                let own = lanes.load(motion, run);
                for (i, depth) in row[run.x..][..run.len].iter_mut().enumerate() {
                    let speed = distance([own.x[i], own.y[i]], [0.0; 2]);
                    let known = if speed.is_finite() { speed } else { 0.0 };
                    *depth = 1.0 / (STILL + known);
                }
            }
        }
    }
}
