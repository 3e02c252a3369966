//! Dilated motion: each pixel takes the motion of the nearest surface around it.
//!
//! Along an edge, a pixel mixes foreground and background from frame to frame. If its history follows whichever it
//! shows just now, the edge is never antialiased; if it follows the foreground, the edge moves as one (Karis 2014,
//! *High Quality Temporal Supersampling*). The longest motion is what remains without depth.
//!
//! Inputs: motion (2 or 3), depth (1, optional). Output: motion. Motion that is not finite is nobody's choice, depth
//! that is NaN or not above 0 is infinitely far. Of equals the pixel itself wins, then the first from the top left.

use std::ops::Range;

use crate::image::{BandMut, Image, Run, Tap, View};
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

pub fn dilate_motion(motion: View, choice: Choice, window: Window) -> Image {
    let size = motion.size;
    let mut ranks = Image::new(size, 1);
    rows::run(&Ranks { motion, choice }, size.height, ranks.bands());
    let mut dilated = Image::new(size, motion.channels);
    let kernel = Dilate {
        motion,
        ranks: &ranks,
        window,
    };
    rows::run(&kernel, size.height, dilated.bands());
    dilated
}

/// The lowest is chosen: depth, or minus the squared length. Infinite depth comes behind all others, and what is not
/// known, which is infinity here, behind that.
struct Ranks<'a> {
    motion: View<'a>,
    choice: Choice<'a>,
}

impl<'a> Kernel for Ranks<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut ranks: BandMut<'a>) {
        for y in rows {
            let ranks = ranks.row(0, y);
            match self.choice {
                Choice::Nearest(depth) => {
                    for (rank, &z) in ranks.iter_mut().zip(depth.row(0, y)) {
                        *rank = if z > 0.0 { z.min(f32::MAX) } else { f32::MAX };
                    }
                }
                Choice::Longest => {
                    let (x, y) = (self.motion.row(0, y), self.motion.row(1, y));
                    for (rank, (x, y)) in ranks.iter_mut().zip(x.iter().zip(y)) {
                        *rank = -(x * x + y * y);
                    }
                }
            }
            for channel in 0..self.motion.channels {
                for (rank, motion) in ranks.iter_mut().zip(self.motion.row(channel, y)) {
                    *rank = if motion.is_finite() {
                        *rank
                    } else {
                        f32::INFINITY
                    };
                }
            }
        }
    }
}

struct Dilate<'a> {
    motion: View<'a>,
    ranks: &'a Image,
    window: Window,
}

impl<'a> Kernel for Dilate<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut dilated: BandMut<'a>) {
        let size = self.motion.size;
        let mut best = vec![0.0; size.width];
        for y in rows {
            // The pixel's own first: of equals it wins.
            best.copy_from_slice(self.ranks.view().row(0, y));
            for channel in 0..self.motion.channels {
                let own = self.motion.row(channel, y);
                dilated.row(channel, y).copy_from_slice(own);
            }
            let row = Run {
                y,
                x: 0,
                len: size.width,
            };
            for dy in -1..=1 {
                for dx in -1..=1 {
                    let tap = Tap { dx, dy, step: 1 };
                    if self.window.has(dx, dy)
                        && let Some(here) = tap.inside(row, size)
                    {
                        self.take(here, tap.of(here), &mut best, &mut dilated);
                    }
                }
            }
        }
    }
}

impl Dilate<'_> {
    /// Takes the motion of the taps that rank lower than the best so far.
    #[inline(always)]
    fn take(&self, here: Run, there: Run, best: &mut [f32], dilated: &mut BandMut) {
        let best = &mut best[here.x..][..here.len];
        let [ranks]: [&[f32]; 1] = there.rows(self.ranks);
        for channel in 0..self.motion.channels {
            let motion = &self.motion.row(channel, there.y)[there.x..][..there.len];
            let dilated = &mut dilated.row(channel, here.y)[here.x..][..here.len];
            for i in 0..here.len {
                dilated[i] = if ranks[i] < best[i] {
                    motion[i]
                } else {
                    dilated[i]
                };
            }
        }
        for i in 0..here.len {
            best[i] = if ranks[i] < best[i] {
                ranks[i]
            } else {
                best[i]
            };
        }
    }
}
