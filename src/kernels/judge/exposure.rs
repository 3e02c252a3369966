//! The radiance that a frame's tone curve takes for 1, so that curves do the same at every scale of radiance.
//!
//!   e = 8 (mean √l)², l the luminance, at least 0, of the pixels that are present:
//! proportional to the frame's radiance, and moved by all of its pixels rather than by the few brightest. The factor puts e
//! near 1 for images that are exposed as photographs are. Where all is black, e = 1.
//!
//! Input: colour (3). Output: a number above 0.

use std::ops::Range;

use crate::image::{BandMut, Image, Size, View};
use crate::math::{is_present, luminance};
use crate::rows::{self, Kernel};

const FACTOR: f64 = 8.0;

/// Sums beside each other: one would wait for itself.
const LANES: usize = 16;

pub fn exposure(color: View) -> f32 {
    let height = color.size.height;
    let mut sums = Image::new(Size { height, width: 1 }, 2);
    rows::run(&Sums { color }, height, sums.bands());
    let total = |channel: usize| {
        sums.plane(channel)
            .iter()
            .map(|&v| f64::from(v))
            .sum::<f64>()
    };
    let mean = total(0) / total(1);
    let exposure = (FACTOR * mean * mean) as f32;
    if exposure >= f32::MIN_POSITIVE && exposure.is_finite() {
        exposure
    } else {
        1.0
    }
}

/// For each row: the sum of the roots, and of the pixels.
struct Sums<'a> {
    color: View<'a>,
}

impl<'a> Kernel for Sums<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut sums: BandMut<'a>) {
        for y in rows {
            let [r, g, b] = self.color.rows(y);
            let (mut roots, mut counts) = ([0.0_f32; LANES], [0.0_f32; LANES]);
            for x in (0..r.len()).step_by(LANES) {
                let len = LANES.min(r.len() - x);
                let (r, g, b) = (&r[x..][..len], &g[x..][..len], &b[x..][..len]);
                for i in 0..len {
                    let present = is_present([r[i], g[i], b[i]]);
                    let root = luminance(r[i], g[i], b[i]).max(0.0).sqrt();
                    roots[i] += if present { root } else { 0.0 };
                    counts[i] += if present { 1.0 } else { 0.0 };
                }
            }
            sums.row(0, y)[0] = roots.iter().sum();
            sums.row(1, y)[0] = counts.iter().sum();
        }
    }
}
