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

use crate::error::{Result, in_range};
use crate::image::{Pixels, Run, SEGMENT, Size, View, segments};
use crate::kernels::camera::dilate::{Choice, Dilation, Window};
use crate::kernels::fetch::footprint::MIN_COVERAGE;
use crate::pixels::{PixelsMut, Row};
use crate::rows::{self, Kernel, Simd};

/// A relative difference of depths; 0.05.
pub fn check(separation: f32) -> Result<()> {
    in_range("separation", separation, "a share from 0 to 1", |v| {
        (0.0..=1.0).contains(&v)
    })
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
    let nearest: Vec<_> = nearest
        .into_iter()
        .map(|bits| f32::from_bits(bits.into_inner()))
        .collect();
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

impl Moved<'_> {
    /// Calls `each` for every span with its pixels' previous positions: x, y and depth.
    #[inline(always)]
    fn each_run(&self, rows: Range<usize>, mut each: impl FnMut(Run, &[Row; 3])) {
        let choice = Choice::Nearest(self.depth);
        let mut dilation = Dilation::new(self.motion, choice, Window::Square);
        let mut moved = [[0.0; SEGMENT]; 3];
        let mut depth = [0.0; SEGMENT];
        for y in rows.clone() {
            dilation.roll(y, y == rows.start);
            for run in segments(y, self.depth.size.width) {
                dilation.choose(run, &mut moved);
                dilation.nearest(run, &mut depth);
                let [x, y, z] = &mut moved;
                for i in 0..run.len {
                    x[i] += (run.x + i) as f32;
                    y[i] += run.y as f32;
                    // The bit patterns of floats sort as the floats do only for numbers from 0 up.
                    z[i] = (depth[i] + z[i]).max(0.0);
                }
                each(run, &moved);
            }
        }
    }
}

/// The bilinear footprint at a position: pixel index and weight, 0 outside the image.
#[inline(always)]
fn taps(size: Size, x: f32, y: f32) -> [(usize, f32); 4] {
    let (left, top) = (x.floor(), y.floor());
    let (fx, fy) = (x - left, y - top);
    [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)].map(|(dx, dy)| {
        let (column, row) = (left + dx, top + dy);
        let inside = (column >= 0.0)
            & (row >= 0.0)
            & (column < size.width as f32)
            & (row < size.height as f32);
        let side = |f: f32, d: f32| if d > 0.0 { f } else { 1.0 - f };
        match inside {
            true => (
                row as usize * size.width + column as usize,
                side(fx, dx) * side(fy, dy),
            ),
            false => (0, 0.0),
        }
    })
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
        let size = self.moved.depth.size;
        self.moved.each_run(rows, |run, [x, y, z]| {
            for i in 0..run.len {
                for (at, weight) in taps(size, x[i], y[i]) {
                    if weight > MIN_COVERAGE {
                        self.nearest[at].fetch_min(z[i].to_bits(), Ordering::Relaxed);
                    }
                }
            }
        });
    }
}

struct Compare<'m, 'a> {
    moved: &'m Moved<'a>,
    nearest: &'m [f32],
    /// 1 − separation.
    nearer: f32,
}

impl<'a> Kernel for Compare<'_, 'a> {
    type Out = PixelsMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: PixelsMut<'a>) {
        let size = self.moved.depth.size;
        let mut disoccluded = [0.0; SEGMENT];
        self.moved.each_run(rows, |run, [x, y, z]| {
            for i in 0..run.len {
                let (mut hidden, mut all) = (0.0, 0.0);
                for (at, weight) in taps(size, x[i], y[i]) {
                    let behind = self.nearest[at] < self.nearer * z[i];
                    hidden += if behind { weight } else { 0.0 };
                    all += weight;
                }
                disoccluded[i] = if all > 0.0 { hidden / all } else { 1.0 };
            }
            out.write(run, [&disoccluded[..]]);
        });
    }
}
