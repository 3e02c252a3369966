//! Disocclusion: surfaces that were hidden in the previous frame, detected from the current frame alone.
//!
//! Every pixel's depth is scattered to its previous position, nearest depth wins: this reconstructs the previous depth
//! buffer, as far as its surfaces are still visible. A surface that lies behind the reconstructed depth was hidden, so its
//! history shows something else. Depth and motion are dilated over 3×3 pixels as in [`super::super::camera::dilate`], so
//! that edges move as one. With z′ the previous depth of a pixel, S the reconstructed depths, and w the bilinear weights
//! of the 2×2 pixels at its previous position:
//!   disocclusion = Σ w [S < (1 − separation) z′] / Σ w
//! (FSR 2's depth clip. There the separation is the resolution of a depth buffer after Akeley and Su 2006, *Minimum
//! Triangle Separation for Correct z-Buffer Occlusion*: 1.37e-5 of the depth for each pixel of half the image's width; ours
//! must also tolerate the depth change of a slope between pixels). Taps outside the image do not count.
//!
//! Inputs: depth (1), motion (2 or 3; the third is the change of depth). Output: (1) in [0, 1]; 1 where nothing is known.
//! The scatter takes minima, which do not depend on order, so that threads may scatter concurrently.

use std::ops::Range;

use crate::error::{Result, from_0_to_1};
use crate::image::{Pixels, Run, SEGMENT, Size, View, segments};
use crate::kernels::camera::dilate::{self, Choice, Dilation};
use crate::kernels::fetch::footprint::{Footprints, MIN_COVERAGE};
use crate::kernels::fetch::validate::Tests;
use crate::minima::Minima;
use crate::pixels::{MotionRun, PixelsMut, Row, lanes};
use crate::rows::{self, Kernel, Simd};

/// An error if a relative difference of depths is out of range; its default is 0.05.
pub fn check(separation: f32) -> Result<()> {
    from_0_to_1("separation", separation)
}

/// Writes how much of a pixel was hidden, 0 to 1.
pub fn disocclusion<'a>(
    depth: View<'a>,
    motion: Pixels<'a>,
    separation: f32,
    disoccluded: impl Iterator<Item = PixelsMut<'a>>,
) {
    let size = depth.size;
    let moved = Moved { depth, motion };
    let nearest = Minima::new(size.pixels());
    let scatter = Scatter {
        moved: &moved,
        nearest: &nearest,
    };
    rows::run(&scatter, size.height, rows::bands(size.height).map(|_| ()));
    let compare = Compare {
        moved: &moved,
        nearest: &nearest,
        nearer: 1.0 - separation,
    };
    rows::run(&compare, size.height, disoccluded);
}

struct Moved<'a> {
    depth: View<'a>,
    motion: Pixels<'a>,
}

/// Where the pixels of a run were: their previous depth, and the 2×2 pixels at their previous position.
struct Before {
    depth: Row,
    footprints: Footprints,
}

impl Before {
    fn new(size: Size) -> Self {
        Self {
            depth: [0.0; _],
            footprints: Footprints::new(size),
        }
    }

    /// The 2×2 pixels of pixel `i` of the run.
    #[inline(always)]
    fn pixels(&self, i: usize) -> [usize; 4] {
        let (at, [dx, dy]) = (self.footprints.at[i] as usize, self.footprints.steps());
        [at, at + dx, at + dy, at + dx + dy]
    }
}

impl<'a> Moved<'a> {
    fn dilation(&self) -> Dilation<'a> {
        Dilation::new(
            self.motion,
            Choice::Nearest {
                depth: self.depth,
                still: None,
            },
            dilate::Params::default(),
        )
    }

    /// Computes where the pixels of a run were.
    #[inline(always)]
    fn find(&self, dilation: &Dilation, run: Run, before: &mut Before) {
        let mut moved = [[0.0; SEGMENT]; 3];
        dilation.choose(run, &mut moved);
        dilation.nearest(run, &mut before.depth);
        let [x, y, change] = &moved;
        for (depth, change) in before.depth.iter_mut().zip(change) {
            *depth = (*depth + change).max(0.0);
        }
        let motion = MotionRun {
            x,
            y,
            depth: Some(change),
        };
        before.footprints.find(run, motion, false, &Tests::none());
    }
}

struct Scatter<'m> {
    moved: &'m Moved<'m>,
    /// The reconstructed depth buffer.
    nearest: &'m Minima,
}

impl Kernel for Scatter<'_> {
    type Out = ();

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, (): ()) {
        let mut dilation = self.moved.dilation();
        let mut before = Before::new(self.moved.depth.size);
        for y in rows.clone() {
            dilation.roll(y, y == rows.start);
            for run in segments(y, self.moved.depth.size.width) {
                self.moved.find(&dilation, run, &mut before);
                for i in 0..run.len {
                    for (k, pixel) in before.pixels(i).into_iter().enumerate() {
                        if before.footprints.weights[k][i] > MIN_COVERAGE {
                            self.nearest.lower(pixel, before.depth[i]);
                        }
                    }
                }
            }
        }
    }
}

struct Compare<'m, 'a> {
    moved: &'m Moved<'a>,
    nearest: &'m Minima,
    /// 1 − separation.
    nearer: f32,
}

impl<'a> Kernel for Compare<'_, 'a> {
    type Out = PixelsMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: PixelsMut<'a>) {
        let mut dilation = self.moved.dilation();
        let mut before = Before::new(self.moved.depth.size);
        let mut nearest = [[0.0; SEGMENT]; 4];
        let mut disoccluded = [0.0; SEGMENT];
        for y in rows.clone() {
            dilation.roll(y, y == rows.start);
            for run in segments(y, self.moved.depth.size.width) {
                self.moved.find(&dilation, run, &mut before);
                for i in 0..run.len {
                    for (k, pixel) in before.pixels(i).into_iter().enumerate() {
                        nearest[k][i] = self.nearest.get(pixel);
                    }
                }
                let Footprints {
                    weights, coverage, ..
                } = &before.footprints;
                for i in 0..lanes(run) {
                    let mut hidden = 0.0;
                    for k in 0..4 {
                        let behind = nearest[k][i] < self.nearer * before.depth[i];
                        hidden += if behind { weights[k][i] } else { 0.0 };
                    }
                    let share = hidden / coverage[i];
                    disoccluded[i] = if coverage[i] > 0.0 { share } else { 1.0 };
                }
                out.write(run, [&disoccluded[..]]);
            }
        }
    }
}
