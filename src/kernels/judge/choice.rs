//! Choice: which of several predictions is best, tile by tile, judged by new samples that none of them has seen.
//!
//! The candidates p₀, p₁, … are the luminance of a series of images that history predicts, such as those after 0, 1, …
//! passes of a filter. The luminance y of a new sample is an unbiased estimate of the reference, and (a − y)² − (b − y)²
//! is linear in it (see [`super::prediction`]). With μ the default candidate, at least 0, s = μ + e/16 for the exposure
//! e, aₖ = (pₖ − μ)/s and r = clamp((y − μ)/s, ±8), step k from candidate k − 1 to k costs
//!   dₖ = (aₖ − aₖ₋₁)(aₖ + aₖ₋₁ − 2r),
//! negative where the step brings the image nearer to the reference.
//! **Evidence.** Tiles of 8×8 sum dₖ, dₖ² and the number n of pixels with a sample and all candidates. Each frame's sums
//! are weighted by w = 1 / √(Σₖ Σ dₖ² / n + 10⁻⁶), the inverse of their deviation, so that no single frame with a bright
//! sample or a change of light decides for those before and after it. The weighted sums of earlier frames are reprojected
//! by the motion of the tile's centre, interpolated bilinearly between tiles, and decay by 1 − β a frame.
//! **Decision.** With the sums G of w d, V of w² d², W of w and n averaged over neighbouring tiles by {1, 2, 1}/4 ⊗
//! {1, 2, 1}/4, the cost of candidate j relative to the default u is
//!   Σ ±Gₖ/W + c √(Σ Vₖ / (64/9 W²)),
//! k over the steps between u and j, + beyond u and − before it, 64/9 being the effective number of tiles in the average.
//! The cheapest candidate wins: one other than u must be better by c standard errors. Where n is below 16, u stays.
//! **Default.** What is best for the frame is the best guess for a tile that knows nothing. The costs of the whole frame, the
//! mean over its pixels, therefore decide first, in the same way but by c′ standard errors; of tiles in which n is at least 16,
//! they sum n/W G, (n/W)² V, n and n. For each tile, u is what they choose.
//!
//! A frame is decided by the evidence of the frames before it, so that one run of the filter makes both its result and
//! its candidates. The choice is interpolated between tile centres, and a fractional choice mixes two candidates, so
//! that tiles do not show. The clamp at ±8 keeps a single bright sample from deciding for a tile, at the price of a bias
//! where much of the light comes in rare samples brighter than that.
//!
//! Inputs: new samples (3), candidates (1 each), motion (2), coverage (1), evidence (2 steps + 2; of an eighth of the
//! size). Outputs: choice (1) and evidence, of an eighth of the size.

use std::ops::Range;

use crate::error::{Result, finite_from_0, from_0_to_1, in_range};
use crate::image::{BandMut, Image, Interleaved, Pixels, Run, SEGMENT, Size, View, segments};
use crate::math::{black_level, larger, luminance, smaller};
use crate::memory::prefetch;
use crate::pixels::{Colors, Row};
use crate::rows::{self, BAND, Kernel, Simd};

/// What it takes for another candidate than the usual one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// c: standard errors by which a candidate must beat the default; ≥ 0; 0.5.
    pub strictness: f32,
    /// c′: standard errors by which a candidate must beat the usual one over the whole frame to be the default there;
    /// ≥ 0, may be infinite; 3.
    pub frame_strictness: f32,
    /// β: fraction of the evidence that decays per frame; 0 to 1; 0.3.
    pub share: f32,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            strictness: 0.5,
            frame_strictness: 3.0,
            share: 0.3,
        }
    }
}

impl Params {
    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        finite_from_0("strictness", self.strictness)?;
        in_range(
            "frame_strictness",
            self.frame_strictness,
            "a number from 0",
            |v| v >= 0.0,
        )?;
        from_0_to_1("share", self.share)
    }
}

/// Side of a tile in pixels; divides [`SEGMENT`].
pub(crate) const TILE: usize = 8;

/// Bound of a sample's relative difference r.
const BOUND: f32 = 8.0;
/// With fewer comparisons the default stays.
pub(super) const MIN_COMPARISONS: f32 = 16.0;
/// Mean square of a tile's steps below which frames weigh the same.
const QUIET: f32 = 1e-6;
/// Effective number of tiles in the average over neighbours: one over the sum of its squared weights.
const TILES: f32 = 64.0 / 9.0;

/// The grid of tiles of an image.
pub fn tiles(size: Size) -> Size {
    Size {
        height: size.height.div_ceil(TILE),
        width: size.width.div_ceil(TILE),
    }
}

/// Channels of a tile's evidence: G and V of each step, W and n.
pub fn channels(candidates: usize) -> usize {
    2 * candidates
}

/// Decides by the evidence of the frames before: returns the choice of each tile, and the evidence where the tiles are now.
pub fn choice(
    evidence: Pixels,
    motion: Pixels,
    coverage: View,
    usual: usize,
    params: Params,
) -> (Image, Interleaved) {
    let carried = carry(evidence, motion, coverage, params.share);
    (decide(carried.pixels(), usual, params), carried)
}

/// The choice of each tile by this evidence.
pub(crate) fn decide(evidence: Pixels, usual: usize, params: Params) -> Image {
    let size = evidence.size;
    let mut chosen = Image::blank(size, 1);
    let frame = whole(evidence);
    let decide = Decide {
        evidence,
        usual: cheapest(&frame, 1.0, usual, params.frame_strictness),
        strictness: params.strictness,
    };
    rows::run(&decide, size.height, chosen.bands());
    chosen
}

/// Adds what a frame's samples say of the candidates to the evidence.
pub fn compare(
    fresh: &impl Colors,
    candidates: &[View],
    exposure: f32,
    usual: usize,
    evidence: &mut Interleaved,
) {
    let size = evidence.size;
    let band = BAND * size.width * channels(candidates.len());
    let compare = Compare {
        fresh,
        candidates,
        black: black_level(exposure),
        usual,
    };
    rows::run(&compare, size.height, evidence.data_mut().chunks_mut(band));
}

/// Evidence of the frames before, where the tiles are now, of which `share` decays.
pub(crate) fn carry(evidence: Pixels, motion: Pixels, coverage: View, share: f32) -> Interleaved {
    let size = evidence.size;
    let carry = Carry {
        evidence,
        motion,
        coverage,
        keep: 1.0 - share,
    };
    let mut carried = Interleaved::blank(size, evidence.channels);
    let band = BAND * size.width * evidence.channels;
    rows::run(&carry, size.height, carried.data_mut().chunks_mut(band));
    carried
}

struct Carry<'a> {
    evidence: Pixels<'a>,
    motion: Pixels<'a>,
    coverage: View<'a>,
    /// Decay of evidence per frame, 1 − β.
    keep: f32,
}

impl<'a> Kernel for Carry<'a> {
    type Out = &'a mut [f32];

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, carried: &'a mut [f32]) {
        let Pixels { size, channels, .. } = self.evidence;
        for (row, carried) in rows::lines(rows, carried, size.width * channels) {
            for (column, record) in carried.chunks_exact_mut(channels).enumerate() {
                self.carry(row, column, record);
            }
        }
    }
}

impl Carry<'_> {
    /// Reprojects and decays a tile's evidence.
    #[inline(always)]
    fn carry(&self, row: usize, column: usize, record: &mut [f32]) {
        record.fill(0.0);
        let before = self.evidence;
        let Size { height, width } = self.coverage.size;
        let middle = |tile: usize, side: usize| (TILE * tile + TILE / 2).min(side - 1);
        let centre = middle(row, height) * width + middle(column, width);
        let [dx, dy] = [0, 1].map(|c| self.motion.at(centre, c) / TILE as f32);
        let comes = self.coverage.plane(0)[centre] > 0.0 && dx.is_finite() && dy.is_finite();
        if !comes {
            return;
        }
        let place = |tile: usize, by: f32, count: usize| {
            let last = (count - 1) as f32;
            let at = (tile as f32 + by).clamp(0.0, last);
            let first = at.floor();
            (first as usize, (first + 1.0).min(last) as usize, at - first)
        };
        let (left, right, x) = place(column, dx, before.size.width);
        let (top, bottom, y) = place(row, dy, before.size.height);
        let corners = [(top, left), (top, right), (bottom, left), (bottom, right)]
            .map(|(row, column)| row * before.size.width + column);
        for (channel, value) in record.iter_mut().enumerate() {
            let [a, b, c, d] = corners.map(|tile| before.at(tile, channel));
            let (upper, lower) = (a + x * (b - a), c + x * (d - c));
            *value = self.keep * (upper + y * (lower - upper));
        }
        if record.iter().any(|value| !value.is_finite()) {
            record.fill(0.0);
        }
    }
}

/// Compares the candidates with the new samples.
struct Compare<'a, F> {
    fresh: &'a F,
    candidates: &'a [View<'a>],
    black: f32,
    usual: usize,
}

impl<'a, F: Colors> Kernel for Compare<'a, F> {
    type Out = &'a mut [f32];

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, evidence: &'a mut [f32]) {
        let Size { height, width } = self.candidates[0].size;
        let count = self.candidates.len();
        let numbers = channels(count);
        let mut steps = vec![[0.0; SEGMENT]; count - 1];
        let mut known = [0.0; SEGMENT];
        // Sums of the columns of a row of tiles, in the order of the evidence.
        let mut columns = vec![[0.0; SEGMENT]; numbers];
        let mut seen = vec![0.0; numbers];
        for (row, evidence) in rows::lines(rows, evidence, width.div_ceil(TILE) * numbers) {
            for run in segments(TILE * row, width) {
                columns.iter_mut().for_each(|sums| sums.fill(0.0));
                for y in run.y..(run.y + TILE).min(height) {
                    self.steps(Run { y, ..run }, &mut steps, &mut known);
                    add_columns(&steps, &known, &mut columns);
                }
                let tiles = evidence[run.x / TILE * numbers..].chunks_exact_mut(numbers);
                for (start, evidence) in (0..run.len).step_by(TILE).zip(tiles) {
                    let tile = start..(start + TILE).min(run.len);
                    for (seen, sums) in seen.iter_mut().zip(&columns) {
                        *seen = sums[tile.clone()].iter().sum();
                    }
                    add(&seen, evidence);
                }
            }
        }
    }
}

/// Adds the steps of a row, their squares, and whether its pixels are known, to the sums of its columns.
#[inline(always)]
fn add_columns(steps: &[Row], known: &Row, columns: &mut [Row]) {
    let (gains, rest) = columns.split_at_mut(steps.len());
    let (squares, counts) = rest.split_at_mut(steps.len());
    for ((gains, squares), steps) in gains.iter_mut().zip(squares).zip(steps) {
        for i in 0..SEGMENT {
            gains[i] += steps[i];
            squares[i] = steps[i].mul_add(steps[i], squares[i]);
        }
    }
    for (count, known) in counts[1].iter_mut().zip(known) {
        *count += known;
    }
}

/// Adds the sums of a frame, in which W is still missing, with their weight.
#[inline(always)]
fn add(seen: &[f32], evidence: &mut [f32]) {
    let (sums, counts) = seen.split_at(seen.len() - 2);
    let n = counts[1];
    if n == 0.0 {
        return;
    }
    let (gains, squares) = sums.split_at(sums.len() / 2);
    let weight = 1.0 / (squares.iter().sum::<f32>() / n + QUIET).sqrt();
    let (sums, counts) = evidence.split_at_mut(sums.len());
    let (all_gains, all_squares) = sums.split_at_mut(gains.len());
    for (sum, gain) in all_gains.iter_mut().zip(gains) {
        *sum += weight * gain;
    }
    for (sum, square) in all_squares.iter_mut().zip(squares) {
        *sum += weight * weight * square;
    }
    counts[0] += weight * n;
    counts[1] += n;
}

impl<'a, F: Colors> Compare<'a, F> {
    /// Computes dₖ of a run, and whether its pixels are known: 1 or 0. The others cost nothing.
    #[inline(always)]
    fn steps(&self, run: Run, steps: &mut [Row], known: &mut Row) {
        let mut fresh = [[0.0; SEGMENT]; 3];
        self.fresh.colors(run, &mut fresh);
        let row = |candidate: View<'a>| candidate.run(0, run);
        let [r, g, b] = &fresh;
        let mut sample = [0.0; SEGMENT];
        for i in 0..SEGMENT {
            sample[i] = luminance(r[i], g[i], b[i]);
            // 0 · x is NaN if x is not finite, else 0.
            known[i] = 0.0 * r[i] + 0.0 * g[i] + 0.0 * b[i];
        }
        for &candidate in self.candidates {
            for (known, &value) in known.iter_mut().zip(row(candidate)) {
                *known += 0.0 * value;
            }
            // Of a tile, the row below is read before the pixels on the right.
            let below = (run.y + 1) * candidate.size.width + run.x;
            prefetch(candidate.plane(0), below, run.len);
        }
        let (mut middle, mut per) = ([0.0; SEGMENT], [0.0; SEGMENT]);
        for (i, &usual) in row(self.candidates[self.usual]).iter().enumerate() {
            known[i] = if known[i].is_nan() { 0.0 } else { 1.0 };
            middle[i] = larger(usual, 0.0);
            per[i] = 1.0 / (middle[i] + self.black);
            let relative = (sample[i] - middle[i]) * per[i];
            sample[i] = smaller(larger(relative, -BOUND), BOUND);
        }
        let (middle, per) = (&middle[..run.len], &per[..run.len]);
        let (sample, known) = (&sample[..run.len], &known[..run.len]);
        for (pair, steps) in self.candidates.windows(2).zip(steps) {
            let [before, after] = [pair[0], pair[1]].map(row);
            let steps = &mut steps[..run.len];
            for i in 0..run.len {
                let before = (before[i] - middle[i]) * per[i];
                let after = (after[i] - middle[i]) * per[i];
                let gain = (after - before) * (after + before - 2.0 * sample[i]);
                steps[i] = if known[i] > 0.0 { gain } else { 0.0 };
            }
        }
    }
}

/// The mean of a tile's evidence and its neighbours', weighted {1, 2, 1}/4 along both axes.
#[inline(always)]
pub(super) fn average(evidence: Pixels, x: usize, y: usize, mean: &mut [f32]) {
    const WEIGHTS: [f32; 3] = [0.25, 0.5, 0.25];
    let Size { height, width } = evidence.size;
    let near = |at: usize, side: usize| [at.saturating_sub(1), at, (at + 1).min(side - 1)];
    mean.fill(0.0);
    for (row, wy) in near(y, height).into_iter().zip(WEIGHTS) {
        for (column, wx) in near(x, width).into_iter().zip(WEIGHTS) {
            let tile = row * width + column;
            for (channel, sum) in mean.iter_mut().enumerate() {
                *sum += wy * wx * evidence.at(tile, channel);
            }
        }
    }
}

/// The evidence of the whole frame as if it were one tile, without the tiles' weights: every pixel counts the same.
fn whole(evidence: Pixels) -> Vec<f32> {
    let mut sums = vec![0.0; evidence.channels];
    for tile in evidence.elements().0.chunks_exact(evidence.channels) {
        let (steps, counts) = tile.split_at(tile.len() - 2);
        let [weight, n] = [counts[0], counts[1]].map(f64::from);
        let scale = n / weight;
        if !(counts[1] >= MIN_COMPARISONS && scale.is_finite()) {
            continue;
        }
        let (gains, squares) = steps.split_at(steps.len() / 2);
        let gains = gains.iter().map(|&gain| scale * f64::from(gain));
        let squares = squares
            .iter()
            .map(|&square| scale * scale * f64::from(square));
        let values = gains.chain(squares).chain([n, n]);
        sums.iter_mut()
            .zip(values)
            .for_each(|(sum, value)| *sum += value);
    }
    sums.into_iter().map(|sum| sum as f32).collect()
}

struct Decide<'a> {
    evidence: Pixels<'a>,
    usual: usize,
    strictness: f32,
}

impl<'a> Kernel for Decide<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut chosen: BandMut<'a>) {
        let mut around = vec![0.0; self.evidence.channels];
        for y in rows {
            for x in 0..self.evidence.size.width {
                average(self.evidence, x, y, &mut around);
                chosen.row(0, y)[x] = cheapest(&around, TILES, self.usual, self.strictness) as f32;
            }
        }
    }
}

/// The candidate that costs least by the mean evidence of so many tiles.
#[inline(always)]
fn cheapest(evidence: &[f32], tiles: f32, usual: usize, strictness: f32) -> usize {
    let (sums, counts) = evidence.split_at(evidence.len() - 2);
    let (gains, squares) = sums.split_at(sums.len() / 2);
    let [weight, n] = [counts[0], counts[1]];
    if !(n >= MIN_COMPARISONS) {
        return usual;
    }
    let (mut best, mut least) = (usual, 0.0);
    let mut walk = |steps: &mut dyn Iterator<Item = usize>, sign: f32| {
        let (mut gain, mut variance) = (0.0, 0.0);
        for step in steps {
            gain += sign * (gains[step] / weight);
            variance += squares[step] / weight / (tiles * weight);
            let cost = gain + strictness * variance.sqrt();
            if cost < least {
                let beyond = usize::from(sign > 0.0);
                (best, least) = (step + beyond, cost);
            }
        }
    };
    walk(&mut (usual..gains.len()), 1.0);
    walk(&mut (0..usual).rev(), -1.0);
    best
}

/// The tiles' choice, interpolated at pixels.
pub(crate) struct Levels<'a>(pub View<'a>);

impl Levels<'_> {
    /// Interpolates the choice at a span that starts at a tile's border.
    #[inline(always)]
    pub fn read(&self, run: Run, into: &mut [f32]) {
        const PARTS: usize = 2 * TILE;
        let Size { height, width } = self.0.size;
        // In halves of a pixel from the centre of the first tile.
        let from = 2 * run.y as isize + 1 - TILE as isize;
        let down = from.rem_euclid(PARTS as isize) as f32 / PARTS as f32;
        let row = |row: isize| {
            let row = row.clamp(0, height as isize - 1);
            self.0.row(0, row as usize)
        };
        let above = from.div_euclid(PARTS as isize);
        let (upper, lower) = (row(above), row(above + 1));
        let tile = |column: isize| {
            let at = column.clamp(0, width as isize - 1) as usize;
            upper[at] + down * (lower[at] - upper[at])
        };
        let first = (run.x / TILE) as isize;
        let (half, mut left) = (TILE / 2, tile(first - 1));
        for (k, start) in (0..into.len() + half).step_by(TILE).enumerate() {
            let right = tile(first + k as isize);
            for part in 0..TILE {
                let across = (2 * part + 1) as f32 / PARTS as f32;
                if let Some(level) = (start + part)
                    .checked_sub(half)
                    .and_then(|i| into.get_mut(i))
                {
                    *level = left + across * (right - left);
                }
            }
            left = right;
        }
    }
}
