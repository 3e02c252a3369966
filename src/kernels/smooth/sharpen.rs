//! Sharpening of images that resampling has blurred, without overshoot beyond the neighbours.
//!
//! In tone-mapped colours, c / (e + max(r, g, b)) with e the exposure, a pixel becomes
//!   (p + λ Σ n) / (1 + 4λ),  n its four neighbours,
//! with the strongest λ between −3/16 and 0 that keeps every channel in [0, 1] for a pixel like its neighbours:
//!   λ = strength · max(−3/16, max over channels of max(−min n / (4 max n), (1 − max n) / (4 min n − 4)))
//! (RCAS, robust contrast adaptive sharpening, of AMD's FSR 1). The result is clamped to the range of the five pixels,
//! so that edges become steep without halos.
//!
//! Input: colour (3). Output: colour. Missing neighbours and those outside the image are replaced by the pixel itself.
//! Missing pixels and pixels with λ = 0 keep their bits.

use std::ops::Range;

use crate::error::{Result, finite_above_0, from_0_to_1};
use crate::image::{Pixels, Run, SEGMENT, segments};
use crate::math::{inverse_tone_map, is_present, larger, max_channel, smaller, tone_map};
use crate::pixels::{PixelsMut, Rolling, Row};
use crate::rows::{self, Kernel, Simd};

/// How much is sharpened.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// Scale of λ; 0 (no change) to 1; 0.5.
    pub strength: f32,
    /// The radiance that the tone curve maps to ½; above 0; 1.
    pub exposure: f32,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            strength: 0.5,
            exposure: 1.0,
        }
    }
}

impl Params {
    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        from_0_to_1("strength", self.strength)?;
        finite_above_0("exposure", self.exposure)
    }
}

/// The strongest λ.
const LARGEST: f32 = -3.0 / 16.0;

/// Writes the sharpened colours.
pub fn sharpen<'a>(
    color: Pixels<'a>,
    params: Params,
    sharpened: impl Iterator<Item = PixelsMut<'a>>,
) {
    let height = color.size.height;
    rows::run(&Sharpen { color, params }, height, sharpened);
}

struct Sharpen<'a> {
    color: Pixels<'a>,
    params: Params,
}

impl<'a> Kernel for Sharpen<'a> {
    type Out = PixelsMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut sharpened: PixelsMut<'a>) {
        let mut colors = Rolling::new(self.color.size.width, 1);
        let mut out = [[0.0; SEGMENT]; 3];
        for y in rows.clone() {
            colors.roll(self.color, y, y == rows.start);
            for run in segments(y, self.color.size.width) {
                self.sharpen_run(&colors, run, &mut out);
                sharpened.write(run, &out);
            }
        }
    }
}

impl Sharpen<'_> {
    #[inline(always)]
    fn sharpen_run(&self, colors: &Rolling<3>, run: Run, out: &mut [Row; 3]) {
        let Params { strength, exposure } = self.params;
        let rows = [
            colors.columns(run, -1),
            colors.columns(run, 0),
            colors.columns(run, 1),
        ];
        // Loops instead of closures: a closure that is not inlined is compiled without the caller's instruction set.
        const PLACES: [[usize; 2]; 4] = [[0, 1], [1, 0], [1, 2], [2, 1]];
        for i in 0..run.len {
            let mut own = [0.0; 3];
            for c in 0..3 {
                own[c] = rows[1][c][i + 1];
            }
            let mut limit = max_channel(own);
            let toned = tone_map(own, exposure);
            let mut around = [[0.0; 3]; 4];
            for (around, [row, column]) in around.iter_mut().zip(PLACES) {
                let mut color = [0.0; 3];
                for c in 0..3 {
                    color[c] = rows[row][c][i + column];
                }
                let present = is_present(color);
                for c in 0..3 {
                    color[c] = if present { color[c] } else { own[c] };
                }
                limit = larger(max_channel(color), limit);
                *around = tone_map(color, exposure);
            }
            let mut lobe = f32::NEG_INFINITY;
            let [mut low, mut high, mut sum] = [[0.0; 3]; 3];
            for c in 0..3 {
                let [a, b, d, e] = [around[0][c], around[1][c], around[2][c], around[3][c]];
                sum[c] = (a + b) + (d + e);
                (low[c], high[c]) = (
                    smaller(smaller(a, b), smaller(d, e)),
                    larger(larger(a, b), larger(d, e)),
                );
                let down = -0.25 * low[c].max(0.0) / high[c];
                let up = 0.25 * (1.0 - high[c]) / (low[c] - 1.0);
                // 0/0: black neighbours allow no undershoot.
                let down = if high[c] > 0.0 { down } else { 0.0 };
                lobe = larger(larger(down, up), lobe);
            }
            let lobe = strength * smaller(larger(lobe, LARGEST), 0.0);
            let mut sharp = toned;
            for c in 0..3 {
                let value = (toned[c] + lobe * sum[c]) / (1.0 + 4.0 * lobe);
                sharp[c] = larger(
                    smaller(value, larger(high[c], toned[c])),
                    smaller(low[c], toned[c]),
                );
            }
            let sharp = inverse_tone_map(sharp, exposure, limit);
            for c in 0..3 {
                out[c][i] = if (lobe < 0.0) & is_present(own) & is_present(sharp) {
                    sharp[c]
                } else {
                    own[c]
                };
            }
        }
    }
}
