//! Convergence of a still scene: between a result and the mean of all samples, by how far each is from the reference.
//!
//! A denoised image O is smooth from its first frame on, and keeps what its filters got wrong however many frames follow.
//! The mean M of N samples is right in the limit, and its variance is known, that of the samples over N. Of both, the
//! mixture O + s (M − O) has the least error with s = 1 − variance of M / mean of |M − O|² (James and Stein 1961, *Estimation
//! with Quadratic Loss*, who shrink a mean towards a fixed point; here, towards the denoised image).
//!
//! All is measured relative to the light l = max(luminance of O, 0) + e/16, e the exposure, so that dark and bright places
//! count alike:
//!   r = (M − O)/l, v = (m₂ − m₁²)/(N − 1) · (1 + 4/N)/l², with the moments m of the samples' luminance.
//! The last factor is for few samples of heavy-tailed noise, whose variance is underestimated more often than not. Tiles of
//! 8×8 pixels have one share each, interpolated bilinearly between their centres:
//!   s = max(0, 1 − c ⟨v⟩/⟨|luminance of r|²⟩), shown = O + s r l.
//! The strictness c is 1 if O is independent of M's noise. If O is made of the same samples, their difference has less noise.
//!
//! Inputs: result (3), mean (3), moments (2), length N (1). Output: colour (3). A pixel with fewer than eight samples, or one
//! of whose values is not finite, shows the result.

use std::ops::Range;

use crate::error::{Result, finite_from_0};
use crate::image::{BandMut, Image, Pixels, Run, SEGMENT, Size, segments};
use crate::kernels::judge::choice::{Levels, TILE, tiles};
use crate::math::{black_level, larger, luminance};
use crate::pixels::Row;
use crate::rows::{self, BAND, Kernel, Simd};

use super::accumulate::{CHANNELS, load_history};

/// Fewer samples tell too little of their variance.
const FEWEST: f32 = 8.0;
/// The variance of few samples is taken for larger by 1 + 4/N.
const DOUBT: f32 = 4.0;

/// The variance of the mean of so many samples of a luminance, by its moments.
#[inline(always)]
pub fn variance_of_mean(first: f32, second: f32, samples: f32) -> f32 {
    larger(second - first * first, 0.0) / larger(samples - 1.0, 1.0) * (1.0 + DOUBT / samples)
}

/// An error if a strictness is out of range.
pub fn check_strictness(strictness: f32) -> Result<()> {
    finite_from_0("strictness", strictness)
}

/// Mixes the mean of so many samples (colour, moments and length) into an interleaved result.
pub fn converge(shown: &mut [f32], history: [Pixels; 3], exposure: f32, strictness: f32) {
    let size = history[0].size;
    let (grid, still) = (
        tiles(size),
        Still {
            history,
            black: black_level(exposure),
        },
    );
    let result = Pixels::of_interleaved(size, 3, shown);
    let mut shares = Image::blank(grid, 1);
    let decide = Decide {
        still: &still,
        result,
        strictness,
    };
    rows::run(&decide, grid.height, shares.bands());
    let mix = Mix {
        still: &still,
        shares: Levels(shares.view()),
    };
    rows::run(&mix, size.height, shown.chunks_mut(BAND * 3 * size.width));
}

/// A still scene's samples.
struct Still<'a> {
    /// Mean, moments and number.
    history: [Pixels<'a>; 3],
    black: f32,
}

/// How far the mean is from the result, in units of the light.
struct Apart {
    history: [Row; CHANNELS],
    relative: [Row; 3],
    variance: Row,
    light: Row,
    /// 1 where there are enough samples, else 0, and so are difference and variance.
    known: Row,
}

impl Apart {
    fn zeroed() -> Self {
        Self {
            history: [[0.0; SEGMENT]; CHANNELS],
            relative: [[0.0; SEGMENT]; 3],
            variance: [0.0; SEGMENT],
            light: [0.0; SEGMENT],
            known: [0.0; SEGMENT],
        }
    }
}

impl Still<'_> {
    /// Compares a run of the result with the mean.
    #[inline(always)]
    fn compare(&self, run: Run, result: &[Row; 3], apart: &mut Apart) {
        load_history(self.history, run, &mut apart.history);
        for x in 0..run.len {
            let [mr, mg, mb, first, second, n] = apart.history.each_ref().map(|row| row[x]);
            let [r, g, b] = result.each_ref().map(|row| row[x]);
            let light = larger(luminance(r, g, b), 0.0) + self.black;
            let relative = [(mr - r) / light, (mg - g) / light, (mb - b) / light];
            let spread = second - first * first;
            let variance = variance_of_mean(first, second, n) / light / light;
            let sum = relative[0] + relative[1] + relative[2] + variance;
            let finite = sum.is_finite() & spread.is_finite() & n.is_finite();
            let known = finite & (n >= FEWEST);
            apart.light[x] = light;
            apart.known[x] = if known { 1.0 } else { 0.0 };
            apart.variance[x] = if known { variance } else { 0.0 };
            for (row, value) in apart.relative.iter_mut().zip(relative) {
                row[x] = if known { value } else { 0.0 };
            }
        }
    }
}

/// The runs of a row of tiles.
#[inline(always)]
fn runs(row: usize, size: Size) -> impl Iterator<Item = Run> {
    let rows = TILE * row..(TILE * (row + 1)).min(size.height);
    rows.flat_map(move |y| segments(y, size.width))
}

/// The share of the mean in each tile.
struct Decide<'a> {
    still: &'a Still<'a>,
    result: Pixels<'a>,
    strictness: f32,
}

impl<'a> Kernel for Decide<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut shares: BandMut<'a>) {
        let (mut result, mut apart) = ([[0.0; SEGMENT]; 3], Apart::zeroed());
        let mut variances = vec![0.0; tiles(self.result.size).width];
        for row in rows {
            let squares = shares.row(0, row);
            squares.fill(0.0);
            variances.fill(0.0);
            for run in runs(row, self.result.size) {
                self.result.read_rows(run, &mut result);
                self.still.compare(run, &result, &mut apart);
                for x in 0..run.len {
                    let tile = (run.x + x) / TILE;
                    let [r, g, b] = apart.relative.each_ref().map(|row| row[x]);
                    let detail = luminance(r, g, b);
                    squares[tile] += apart.known[x] * detail * detail;
                    variances[tile] += apart.variance[x];
                }
            }
            for (share, &variance) in squares.iter_mut().zip(&variances) {
                // 0/0 where both images are alike becomes 0.
                *share = larger(1.0 - self.strictness * variance / *share, 0.0);
            }
        }
    }
}

/// Mixes the mean into the result.
struct Mix<'a> {
    still: &'a Still<'a>,
    shares: Levels<'a>,
}

impl<'a> Kernel for Mix<'a> {
    type Out = &'a mut [f32];

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, shown: &'a mut [f32]) {
        let width = self.still.history[0].size.width;
        let (mut result, mut shares) = ([[0.0; SEGMENT]; 3], [0.0; SEGMENT]);
        let mut apart = Apart::zeroed();
        for (y, shown) in rows::lines(rows, shown, 3 * width) {
            let shown = shown.as_chunks_mut::<3>().0;
            for run in segments(y, width) {
                let shown = &mut shown[run.x..][..run.len];
                for (x, pixel) in shown.iter().enumerate() {
                    for (row, &value) in result.iter_mut().zip(pixel) {
                        row[x] = value;
                    }
                }
                self.still.compare(run, &result, &mut apart);
                self.shares.read(run, &mut shares[..run.len]);
                for (x, pixel) in shown.iter_mut().enumerate() {
                    let scale = shares[x] * apart.light[x];
                    for (c, value) in pixel.iter_mut().enumerate() {
                        let mixed = *value + scale * apart.relative[c][x];
                        *value = if apart.known[x] > 0.0 { mixed } else { *value };
                    }
                }
            }
        }
    }
}
