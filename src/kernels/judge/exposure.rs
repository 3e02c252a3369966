//! Automatic exposure: the radiance that a frame's tone curves are scaled by, so that they act alike at every scale.
//!
//!   e = 8 (mean √l)², l the luminance, at least 0, of the valid pixels:
//! proportional to the frame's radiance, and determined by all of its pixels rather than by the few brightest. The factor
//! 8 puts e near 1 for images that are exposed like photographs. For a black frame, e = 1.
//!
//! A single broken pixel, of 1e20 or more, would still outweigh a whole frame. So no row's mean of √l counts for more than 4096
//! times that of the row which is brighter than nine tenths of them (16 million times in radiance: no lamp is so bright).
//!
//! Input: colour (3). Output: a number above 0.

use std::ops::Range;

use crate::error::{Result, finite_above_0};
use crate::image::{BandMut, Image, Pixels, SEGMENT, Size, segments};
use crate::lanes::LANES;
use crate::math::{is_present, luminance, smaller};
use crate::rows::{self, Kernel, Simd};

const FACTOR: f64 = 8.0;
/// Most that a row counts for, in times of one that is brighter than nine tenths of them.
const BOUND: f32 = 4096.0;

/// Whether a number can be the exposure of other kernels.
pub fn check(exposure: f32) -> Result<()> {
    finite_above_0("exposure", exposure)
}

/// The exposure of an image: its radiance that a tone curve takes for 1.
pub fn exposure(color: Pixels) -> f32 {
    let height = color.size.height;
    let mut sums = Image::new(Size { height, width: 1 }, 2);
    rows::run(&Sums { color }, height, sums.bands());
    let valid = || (sums.plane(0).iter().zip(sums.plane(1))).filter(|&(_, &count)| count > 0.0);
    let mut means: Vec<f32> = valid().map(|(sum, count)| sum / count).collect();
    means.sort_unstable_by(f32::total_cmp);
    let bound = (means.get(means.len() * 9 / 10)).map_or(0.0, |mean| BOUND * mean);
    let bounded = |(&sum, &count): (&f32, &f32)| {
        f64::from(if bound > 0.0 {
            smaller(sum, bound * count)
        } else {
            sum
        })
    };
    let pixels: f64 = valid().map(|(_, &count)| f64::from(count)).sum();
    let mean = valid().map(bounded).sum::<f64>() / pixels;
    let exposure = (FACTOR * mean * mean) as f32;
    if exposure >= f32::MIN_POSITIVE && exposure.is_finite() {
        exposure
    } else {
        1.0
    }
}

/// Writes, for each row, the sum of √l and the number of valid pixels.
struct Sums<'a> {
    color: Pixels<'a>,
}

impl<'a> Kernel for Sums<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut sums: BandMut<'a>) {
        let mut colors = [[0.0; SEGMENT]; 3];
        for y in rows {
            // One partial sum per lane: a single sum would be one chain of dependent additions.
            let (mut roots, mut counts) = ([0.0_f32; LANES], [0.0_f32; LANES]);
            for run in segments(y, self.color.size.width) {
                self.color.read_rows(run, &mut colors);
                let [r, g, b] = colors.each_mut();
                // Padding beyond the image's last pixel counts as missing.
                r[run.len..].fill(f32::NAN);
                for x in (0..run.len).step_by(LANES) {
                    for i in 0..LANES {
                        let rgb = [r[x + i], g[x + i], b[x + i]];
                        let present = is_present(rgb);
                        let root = luminance(rgb[0], rgb[1], rgb[2]).max(0.0).sqrt();
                        roots[i] += if present { root } else { 0.0 };
                        counts[i] += if present { 1.0 } else { 0.0 };
                    }
                }
            }
            sums.row(0, y)[0] = roots.iter().sum();
            sums.row(1, y)[0] = counts.iter().sum();
        }
    }
}
