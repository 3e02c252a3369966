//! Inverted motion: where the surface of each pixel is in the next frame, from the next frame's motion.
//!
//! A renderer writes where a surface was, not where it will be. Pixel q of the next frame knows both: its surface was at
//! p = q + m(q), at depth z(q) + m_z(q), and so moves by −m(q) from there. Every pixel is scattered to the pixel that
//! contains p, and the nearest surface stays. Pixels that nothing reaches are not seen in the next frame, or lie in a crack
//! where points move apart: they take the nearest surface among their neighbours' points less than a pixel
//! away along each axis.
//!
//! That is the motion of a point somewhere in the pixel. Where it differs by at most half a pixel from the motion of a
//! still scene, which cameras tell exactly, the latter is meant; it also holds where nothing else is known.
//!
//! Inputs: motion (2 or 3) and depth (1, optional: all alike) of the next frame; the still scene's motion from this frame
//! to the next (as many channels, optional). Output: motion to the next frame, with as many channels; NaN where nothing is
//! known. Points of equal depth: the first in rows counts. The scatter takes minima, which do not depend on order, so that
//! threads may scatter concurrently.

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::image::{Pixels, SEGMENT, Size, segments};
use crate::kernels::camera::motion::is_still;
use crate::pixels::{PixelsMut, Row, read_motion};
use crate::rows::{self, Kernel, Simd};

/// Writes the motion to the next frame.
pub fn invert_motion<'a>(
    motion: Pixels<'a>,
    depth: Option<Pixels<'a>>,
    still: Option<Pixels<'a>>,
    outs: impl Iterator<Item = PixelsMut<'a>>,
) {
    let size = motion.size;
    let points = Points { motion, depth };
    let nearest: Vec<_> = (0..size.pixels())
        .map(|_| AtomicU64::new(NOTHING))
        .collect();
    let scatter = Scatter {
        points,
        nearest: &nearest,
    };
    rows::run(&scatter, size.height, rows::bands(size.height).map(|_| ()));
    let gather = Gather {
        points,
        nearest: &nearest,
        still,
    };
    rows::run(&gather, size.height, outs);
}

/// A pixel that no point has reached. Others hold the bits of a depth, which sort as positive depths do, and below them
/// the index of the point.
const NOTHING: u64 = u64::MAX;

/// The next frame's pixels.
#[derive(Clone, Copy)]
struct Points<'a> {
    motion: Pixels<'a>,
    depth: Option<Pixels<'a>>,
}

impl Points<'_> {
    fn size(&self) -> Size {
        self.motion.size
    }

    /// Where the point of pixel (x, y) was: x, y and depth. NaN if it is unknown.
    #[inline(always)]
    fn place(&self, [x, y]: [usize; 2]) -> [f32; 3] {
        let index = y * self.size().width + x;
        let of = |channel| self.motion.at(index, channel);
        let z = match self.depth.map(|depth| depth.at(index, 0)) {
            Some(z) if !(z > 0.0) => f32::NAN,
            Some(z) if self.motion.channels == 3 => z + of(2),
            Some(z) => z,
            // What a change adds up to is unknown without depth.
            None => 1.0,
        };
        [x as f32 + of(0), y as f32 + of(1), z]
    }
}

struct Scatter<'s, 'a> {
    points: Points<'a>,
    nearest: &'s [AtomicU64],
}

impl Kernel for Scatter<'_, '_> {
    type Out = ();

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, (): ()) {
        let Size { height, width } = self.points.size();
        for (py, px) in rows.flat_map(|y| (0..width).map(move |x| (y, x))) {
            let [x, y, z] = self.points.place([px, py]);
            let (column, row) = ((x + 0.5).floor(), (y + 0.5).floor());
            let inside =
                (column >= 0.0) & (row >= 0.0) & (column < width as f32) & (row < height as f32);
            if inside & (z > 0.0) {
                let key = u64::from(z.to_bits()) << 32 | (py * width + px) as u64;
                let nearest = &self.nearest[row as usize * width + column as usize];
                // A comparison first: most exchanges of points behind others are saved.
                if key < nearest.load(Ordering::Relaxed) {
                    nearest.fetch_min(key, Ordering::Relaxed);
                }
            }
        }
    }
}

struct Gather<'s, 'a> {
    points: Points<'a>,
    nearest: &'s [AtomicU64],
    still: Option<Pixels<'a>>,
}

impl Gather<'_, '_> {
    /// The point that shows in a pixel, or in a crack of which the pixel is part.
    #[inline(always)]
    fn point(&self, x: usize, y: usize) -> Option<usize> {
        let Size { height, width } = self.points.size();
        let key = |x: usize, y: usize| self.nearest[y * width + x].load(Ordering::Relaxed);
        let mut best = key(x, y);
        if best == NOTHING {
            for row in y.saturating_sub(1)..(y + 2).min(height) {
                for column in x.saturating_sub(1)..(x + 2).min(width) {
                    let key = key(column, row);
                    if key < best && self.reaches(key, x, y) {
                        best = key;
                    }
                }
            }
        }
        (best != NOTHING).then_some(best as u32 as usize)
    }

    /// Whether a point lies less than a pixel away from the centre of another.
    #[inline(always)]
    fn reaches(&self, key: u64, x: usize, y: usize) -> bool {
        let (index, width) = (key as u32 as usize, self.points.size().width);
        let [px, py, _] = self.points.place([index % width, index / width]);
        (px - x as f32).abs() < 1.0 && (py - y as f32).abs() < 1.0
    }
}

impl<'a> Kernel for Gather<'_, 'a> {
    type Out = PixelsMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: PixelsMut<'a>) {
        let Pixels { size, channels, .. } = self.points.motion;
        let mut moved = [[0.0; SEGMENT]; 3];
        let mut still = [[f32::NAN; SEGMENT]; 3];
        for run in rows.flat_map(|y| segments(y, size.width)) {
            if let Some(image) = &self.still {
                read_motion(image, run, still.each_mut().map(Row::as_mut_slice));
            }
            for i in 0..run.len {
                let point = self.point(run.x + i, run.y);
                let back = |c| point.map_or(f32::NAN, |point| self.points.motion.at(point, c));
                let away = [-back(0), -back(1)];
                let known = [still[0][i], still[1][i]];
                // A crack is filled by the still scene too: NaN is no motion that differs.
                let differs = !away[0].is_nan() && !is_still(away, known);
                for c in 0..channels {
                    moved[c][i] = if differs { -back(c) } else { still[c][i] };
                }
            }
            out.write(run, &moved[..channels]);
        }
    }
}
