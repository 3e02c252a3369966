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
use std::sync::atomic::{AtomicU32, Ordering};

use crate::error::{Result, from_0_to_1};
use crate::image::{Pixels, Run, SEGMENT, Size, View, segments};
use crate::kernels::camera::dilate::{self, Choice, Dilation};
use crate::kernels::fetch::footprint::MIN_COVERAGE;
use crate::pixels::{PixelsMut, Row, lanes};
use crate::rows::{self, Kernel, Simd};

/// A relative difference of depths; 0.05.
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
    let nearest: Vec<_> = (0..size.pixels())
        .map(|_| AtomicU32::new(f32::INFINITY.to_bits()))
        .collect();
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

/// Where the pixels of a span were: their previous depth, and the 2×2 pixels at their previous position.
struct Before {
    depth: Row,
    /// Pixel indices.
    at: [Row<u32>; 4],
    /// Bilinear weights, 0 outside the image.
    weight: [Row; 4],
}

impl Before {
    fn new() -> Self {
        Self {
            depth: [0.0; _],
            at: [[0; _]; 4],
            weight: [[0.0; _]; 4],
        }
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

    /// Computes where the pixels of a span were.
    #[inline(always)]
    fn find(&self, dilation: &Dilation, run: Run, before: &mut Before) {
        let Size { height, width } = self.depth.size;
        let mut moved = [[0.0; SEGMENT]; 3];
        dilation.choose(run, &mut moved);
        dilation.nearest(run, &mut before.depth);
        let [x, y, z] = &moved;
        for i in 0..lanes(run) {
            // The bit patterns of floats sort as the floats do only for numbers from 0 up.
            before.depth[i] = (before.depth[i] + z[i]).max(0.0);
            // An unknown change of depth leads outside, too.
            let x = if z[i].is_finite() { x[i] } else { f32::NAN };
            let (x, y) = (x + (run.x + i) as f32, y[i] + run.y as f32);
            let (left, top) = (x.floor(), y.floor());
            let (fx, fy) = (x - left, y - top);
            for k in 0..4 {
                let (dx, dy) = ((k % 2) as f32, (k / 2) as f32);
                let (column, row) = (left + dx, top + dy);
                let inside = (column >= 0.0)
                    & (row >= 0.0)
                    & (column < width as f32)
                    & (row < height as f32);
                let (wx, wy) = (
                    if dx > 0.0 { fx } else { 1.0 - fx },
                    if dy > 0.0 { fy } else { 1.0 - fy },
                );
                let (column, row) = if inside { (column, row) } else { (0.0, 0.0) };
                before.at[k][i] = row as u32 * width as u32 + column as u32;
                before.weight[k][i] = if inside { wx * wy } else { 0.0 };
            }
        }
    }
}

struct Scatter<'m> {
    moved: &'m Moved<'m>,
    /// The reconstructed depth buffer, as bits of f32.
    nearest: &'m [AtomicU32],
}

impl Kernel for Scatter<'_> {
    type Out = ();

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, (): ()) {
        let mut dilation = self.moved.dilation();
        let mut before = Before::new();
        for y in rows.clone() {
            dilation.roll(y, y == rows.start);
            for run in segments(y, self.moved.depth.size.width) {
                self.moved.find(&dilation, run, &mut before);
                for i in 0..run.len {
                    let depth = before.depth[i].to_bits();
                    for k in 0..4 {
                        let nearest = &self.nearest[before.at[k][i] as usize];
                        // A plain load first: the atomic minimum is slow, and most taps find a nearer depth already.
                        let nearer = depth < nearest.load(Ordering::Relaxed);
                        if nearer & (before.weight[k][i] > MIN_COVERAGE) {
                            nearest.fetch_min(depth, Ordering::Relaxed);
                        }
                    }
                }
            }
        }
    }
}

struct Compare<'m, 'a> {
    moved: &'m Moved<'a>,
    nearest: &'m [AtomicU32],
    /// 1 − separation.
    nearer: f32,
}

impl<'a> Kernel for Compare<'_, 'a> {
    type Out = PixelsMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: PixelsMut<'a>) {
        let mut dilation = self.moved.dilation();
        let mut before = Before::new();
        let mut nearest = [[0.0; SEGMENT]; 4];
        let mut disoccluded = [0.0; SEGMENT];
        for y in rows.clone() {
            dilation.roll(y, y == rows.start);
            for run in segments(y, self.moved.depth.size.width) {
                self.moved.find(&dilation, run, &mut before);
                for k in 0..4 {
                    for i in 0..run.len {
                        let bits = &self.nearest[before.at[k][i] as usize];
                        nearest[k][i] = f32::from_bits(bits.load(Ordering::Relaxed));
                    }
                }
                for i in 0..lanes(run) {
                    let (mut hidden, mut all) = (0.0, 0.0);
                    for k in 0..4 {
                        let behind = nearest[k][i] < self.nearer * before.depth[i];
                        hidden += if behind { before.weight[k][i] } else { 0.0 };
                        all += before.weight[k][i];
                    }
                    let share = hidden / all;
                    disoccluded[i] = if all > 0.0 { share } else { 1.0 };
                }
                out.write(run, [&disoccluded[..]]);
            }
        }
    }
}
