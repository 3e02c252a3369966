//! Dilated motion: each pixel takes the motion of the nearest surface around it.
//!
//! Along an edge, a pixel mixes foreground and background from frame to frame. If its history follows whichever it
//! shows just now, the edge is never antialiased; if it follows the foreground, the edge moves as one (Karis 2014,
//! *High Quality Temporal Supersampling*). The longest motion is what remains without depth.
//!
//! Inputs: motion (2 or 3), depth (1, optional). Output: motion. Motion that is not finite is nobody's choice, depth
//! that is NaN or not above 0 is infinitely far. Of equals the pixel itself wins, then the first from the top left.

use std::ops::Range;

use crate::image::{BandMut, Image, View};
use crate::rows::{self, Kernel};

/// The neighbours that are looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Window {
    /// 3×3.
    Square,
    /// The pixel and its four neighbours.
    Cross,
}

impl Window {
    pub const NAMES: [(&str, Self); 2] = [("3x3", Self::Square), ("cross", Self::Cross)];

    #[inline(always)]
    fn has(self, dx: isize, dy: isize) -> bool {
        self == Self::Square || dx == 0 || dy == 0
    }
}

/// Whose motion is taken.
#[derive(Clone, Copy, Debug)]
pub enum Choice<'a> {
    Nearest(View<'a>),
    Longest,
}

struct Dilate<'a> {
    motion: View<'a>,
    choice: Choice<'a>,
    window: Window,
}

pub fn dilate_motion(motion: View, choice: Choice, window: Window) -> Image {
    let mut dilated = Image::new(motion.size, motion.channels);
    rows::run(
        &Dilate {
            motion,
            choice,
            window,
        },
        motion.size.height,
        dilated.bands(),
    );
    dilated
}

impl<'a> Kernel for Dilate<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut dilated: BandMut<'a>) {
        for y in rows {
            for x in 0..self.motion.size.width {
                let chosen = self.chosen(x, y);
                for channel in 0..self.motion.channels {
                    dilated.row(channel, y)[x] = self.motion.plane(channel)[chosen];
                }
            }
        }
    }
}

impl Dilate<'_> {
    /// The index of the pixel whose motion (x, y) takes.
    #[inline(always)]
    fn chosen(&self, x: usize, y: usize) -> usize {
        let size = self.motion.size;
        let own = y * size.width + x;
        let mut best = (own, self.rank(own));
        for dy in -1..=1 {
            for dx in -1..=1 {
                let (x, y) = (x.wrapping_add_signed(dx), y.wrapping_add_signed(dy));
                if self.window.has(dx, dy) && x < size.width && y < size.height {
                    let i = y * size.width + x;
                    let rank = self.rank(i);
                    if rank < best.1 {
                        best = (i, rank);
                    }
                }
            }
        }
        best.0
    }

    /// The lowest is chosen: depth, or minus the squared length; NaN and infinity last.
    #[inline(always)]
    fn rank(&self, i: usize) -> (bool, f32) {
        let known =
            (0..self.motion.channels).all(|channel| self.motion.plane(channel)[i].is_finite());
        let rank = match self.choice {
            Choice::Nearest(depth) => {
                let z = depth.plane(0)[i];
                if z > 0.0 { z } else { f32::INFINITY }
            }
            Choice::Longest => {
                let (x, y) = (self.motion.plane(0)[i], self.motion.plane(1)[i]);
                -(x * x + y * y)
            }
        };
        (!known, if known { rank } else { 0.0 })
    }
}
