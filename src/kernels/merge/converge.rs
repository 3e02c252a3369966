//! Convergence of a still scene: between a result and the mean of all samples, by how far each is from the reference.
//!
//! A denoised image O is smooth from its first frame on, and keeps what its filters got wrong however many frames follow.
//! The mean M of N samples is right in the limit, and its variance is known, that of the samples over N. Of both, the
//! mixture O + s (M − O) has the least error with s = 1 − variance of M / mean of |M − O|² (James and Stein 1961, *Estimation
//! with Quadratic Loss*, who shrink a mean towards a fixed point; here, towards the denoised image).
//!
//! All is measured relative to the light l = max(luminance of O, 0) + e/16, e the exposure, so that dark and bright places
//! count alike:
//!   r = (M − O)/l, v = (m₂ − m₁²)/(N − 1)/l² · (1 + 4/N), with the moments m of the samples' luminance.
//! The last factor is for few samples of heavy-tailed noise, whose variance is underestimated more often than not. Tiles of
//! 8×8 pixels have one share each, interpolated bilinearly between their centres:
//!   s = max(0, 1 − ⟨v⟩/⟨|luminance of r − r̄|²⟩), shown = O + s (r − r̄) l,
//! with r̄ the mean of r, each r held to [−1, 1] before, over 9×9 tiles, interpolated likewise: what O and M differ by over
//! so wide a window is an error of M, whose samples are old where light changes, and O has been corrected by the newest
//! ([`crate::kernels::judge::innovation`]). Without it, slow changes of light lag. The bound is for lamps, of which one
//! pixel would decide for all others.
//!
//! Inputs: result (3), mean (3), moments (2), length N (1). Output: colour (3). A pixel with fewer than eight samples, or one
//! of whose values is not finite, shows the result.

use std::ops::Range;

use crate::image::{BandMut, Image, Pixels, Run, SEGMENT, Size, View, segments};
use crate::kernels::judge::choice::{Levels, TILE, tiles};
use crate::kernels::judge::innovation::black;
use crate::math::{larger, luminance, smaller};
use crate::pixels::Row;
use crate::rows::{self, BAND, Kernel, Simd};

use super::accumulate::{CHANNELS, load_history};

/// Fewer samples tell too little of their variance.
const FEWEST: f32 = 8.0;
/// The variance of few samples is taken for larger by 1 + 4/N.
const DOUBT: f32 = 4.0;
/// Bound of r in the means over wide windows.
const BOUND: f32 = 1.0;
/// Tiles to each side of the wide windows, in which the result's mean is kept.
const WIDE: usize = 4;

/// Mixes the mean of so many samples (colour, moments and length) into an interleaved result.
pub fn converge(shown: &mut [f32], history: [Pixels; 3], exposure: f32) {
    let size = history[0].size;
    let (grid, still) = (
        tiles(size),
        Still {
            history,
            black: black(exposure),
        },
    );
    let mut sums = Image::blank(grid, 4);
    let result = Pixels::records(size, 3, shown);
    rows::run(
        &Sums {
            still: &still,
            result,
        },
        grid.height,
        sums.bands(),
    );
    let mut wide = Image::blank(grid, 3);
    rows::run(&Widen(sums.view()), grid.height, wide.bands());
    let wide = Levels3::of(&wide);
    let mut shares = Image::blank(grid, 1);
    let decide = Decide {
        still: &still,
        result,
        wide,
    };
    rows::run(&decide, grid.height, shares.bands());
    let mix = Mix {
        still: &still,
        wide,
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
            let variance = larger(spread, 0.0) / (n - 1.0) / light / light * (1.0 + DOUBT / n);
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

/// Three planes of tiles.
#[derive(Clone, Copy)]
struct Levels3<'a>([View<'a>; 3]);

impl<'a> Levels3<'a> {
    fn of(image: &'a Image) -> Self {
        Self([0, 1, 2].map(|c| image.channels(c..c + 1)))
    }

    #[inline(always)]
    fn read(&self, run: Run, into: &mut [Row; 3]) {
        for (row, &plane) in into.iter_mut().zip(&self.0) {
            Levels(plane).read(run, &mut row[..run.len]);
        }
    }
}

/// Sums r over each tile, and the number of its known pixels.
struct Sums<'a> {
    still: &'a Still<'a>,
    result: Pixels<'a>,
}

impl<'a> Kernel for Sums<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut sums: BandMut<'a>) {
        let (mut result, mut apart) = ([[0.0; SEGMENT]; 3], Apart::zeroed());
        for row in rows {
            let mut sums: [&mut [f32]; 4] = sums.rows(row);
            sums.iter_mut().for_each(|row| row.fill(0.0));
            for run in runs(row, self.result.size) {
                self.result
                    .read(run, result.each_mut().map(Row::as_mut_slice));
                self.still.compare(run, &result, &mut apart);
                for x in 0..run.len {
                    let tile = (run.x + x) / TILE;
                    for (sum, row) in sums.iter_mut().zip(&apart.relative) {
                        sum[tile] += smaller(larger(row[x], -BOUND), BOUND);
                    }
                    sums[3][tile] += apart.known[x];
                }
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

/// Means over the tiles around each.
struct Widen<'a>(View<'a>);

impl<'a> Kernel for Widen<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut means: BandMut<'a>) {
        let Size { height, width } = self.0.size;
        let near = |at: usize, side: usize| at.saturating_sub(WIDE)..(at + WIDE + 1).min(side);
        let mut columns = [0, 1, 2, 3].map(|_| vec![0.0; width]);
        for y in rows {
            for (c, column) in columns.iter_mut().enumerate() {
                column.fill(0.0);
                for row in near(y, height).map(|y| self.0.row(c, y)) {
                    column
                        .iter_mut()
                        .zip(row)
                        .for_each(|(sum, value)| *sum += value);
                }
            }
            let mut means: [&mut [f32]; 3] = means.rows(y);
            for x in 0..width {
                let sum = |c: usize| columns[c][near(x, width)].iter().sum::<f32>();
                let count = larger(sum(3), 1.0);
                for (c, mean) in means.iter_mut().enumerate() {
                    mean[x] = sum(c) / count;
                }
            }
        }
    }
}

/// The share of the mean in each tile.
struct Decide<'a> {
    still: &'a Still<'a>,
    result: Pixels<'a>,
    wide: Levels3<'a>,
}

impl<'a> Kernel for Decide<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut shares: BandMut<'a>) {
        let (mut result, mut wide) = ([[0.0; SEGMENT]; 3], [[0.0; SEGMENT]; 3]);
        let mut apart = Apart::zeroed();
        let mut variances = vec![0.0; self.wide.0[0].size.width];
        for row in rows {
            let squares = shares.row(0, row);
            squares.fill(0.0);
            variances.fill(0.0);
            for run in runs(row, self.result.size) {
                self.result
                    .read(run, result.each_mut().map(Row::as_mut_slice));
                self.wide.read(run, &mut wide);
                self.still.compare(run, &result, &mut apart);
                for x in 0..run.len {
                    let tile = (run.x + x) / TILE;
                    let [r, g, b] = [0, 1, 2].map(|c| apart.relative[c][x] - wide[c][x]);
                    let detail = luminance(r, g, b);
                    squares[tile] += apart.known[x] * detail * detail;
                    variances[tile] += apart.variance[x];
                }
            }
            for (share, &variance) in squares.iter_mut().zip(&variances) {
                // 0/0 where both images are alike becomes 0.
                *share = larger(1.0 - variance / *share, 0.0);
            }
        }
    }
}

/// Mixes the mean into the result.
struct Mix<'a> {
    still: &'a Still<'a>,
    wide: Levels3<'a>,
    shares: Levels<'a>,
}

impl<'a> Kernel for Mix<'a> {
    type Out = &'a mut [f32];

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, shown: &'a mut [f32]) {
        let width = self.still.history[0].size.width;
        let (mut result, mut wide) = ([[0.0; SEGMENT]; 3], [[0.0; SEGMENT]; 3]);
        let (mut apart, mut shares) = (Apart::zeroed(), [0.0; SEGMENT]);
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
                self.wide.read(run, &mut wide);
                self.shares.read(run, &mut shares[..run.len]);
                for (x, pixel) in shown.iter_mut().enumerate() {
                    let scale = shares[x] * apart.light[x];
                    for (c, value) in pixel.iter_mut().enumerate() {
                        let detail = apart.relative[c][x] - wide[c][x];
                        let mixed = *value + scale * detail;
                        *value = if apart.known[x] > 0.0 { mixed } else { *value };
                    }
                }
            }
        }
    }
}
