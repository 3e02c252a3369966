//! Shrinkage: how much of each level's means is more than chance, from coarse to fine.

use std::ops::Range;

use super::{CHANNELS, Params};
use crate::image::{BandMut, Size, View, segments};
use crate::math::larger;
use crate::pixels::PixelsMut;
use crate::rows::{Kernel, Simd};

/// Upsamples vertically: the coarse row interpolated at the height of fine row `y`, weights ¾ and ¼, with a halo of one
/// block on each side.
#[inline(always)]
pub fn upsample_rows(coarse: View, channel: usize, y: usize, into: &mut [f32]) {
    let Size { height, width } = coarse.size;
    let own = y / 2;
    let other = match y % 2 {
        0 => own.saturating_sub(1),
        _ => (own + 1).min(height - 1),
    };
    let [own, other] = [own, other].map(|y| coarse.row(channel, y));
    for ((into, &own), &other) in into[1..=width].iter_mut().zip(own).zip(other) {
        *into = 0.75 * own + 0.25 * other;
    }
    (into[0], into[width + 1]) = (into[1], into[width]);
}

/// Upsamples such a row horizontally, weights ¾ and ¼; `fine` begins at the start of a block.
#[inline(always)]
pub fn upsample_columns(row: &[f32], fine: &mut [f32]) {
    let (pairs, last) = fine.as_chunks_mut::<2>();
    let blocks = pairs.len();
    let (left, own, right) = (&row[..blocks], &row[1..][..blocks], &row[2..][..blocks]);
    for (i, pair) in pairs.iter_mut().enumerate() {
        let nearer = 0.75 * own[i];
        *pair = [nearer + 0.25 * left[i], nearer + 0.25 * right[i]];
    }
    if let [last] = last {
        *last = 0.75 * row[blocks + 1] + 0.25 * row[blocks];
    }
}

/// Upsamples the coarser levels' d, writes it, and subtracts it from E. Unknown blocks stay unknown.
pub struct Subtract<'a>(pub Option<View<'a>>);

impl<'a> Kernel for Subtract<'a> {
    type Out = (BandMut<'a>, BandMut<'a>);

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, (mut blocks, mut found): Self::Out) {
        let mut row = self
            .0
            .map_or(vec![], |coarse| vec![0.0; coarse.size.width + 2]);
        for y in rows {
            let [r, g, b, variances] = blocks.rows(y);
            for (channel, rest) in [r, g, b].into_iter().enumerate() {
                let found = found.row(channel, y);
                let Some(coarse) = self.0 else {
                    found.fill(0.0);
                    continue;
                };
                upsample_rows(coarse, channel, y, &mut row);
                upsample_columns(&row, found);
                for ((rest, found), variance) in rest.iter_mut().zip(found).zip(&*variances) {
                    *rest -= if variance.is_nan() { 0.0 } else { *found };
                }
            }
        }
    }
}

/// Adds this level's shrunk means s b to d. At the finest level, also writes the evidence for the next frame.
pub struct Shrink<'a> {
    /// E − d and V.
    pub blocks: View<'a>,
    /// False if all blocks are known.
    pub gaps: bool,
    pub params: Params,
}

impl<'a> Kernel for Shrink<'a> {
    type Out = (BandMut<'a>, Option<PixelsMut<'a>>);

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, (mut found, mut rest): Self::Out) {
        let mut blurred = Blurred::new(self.blocks.size.width);
        for y in rows {
            self.add_rows(y, &mut blurred);
            blurred.add_columns(self.gaps);
            blurred.shrink(self.params.strictness);
            let mut found = found.rows::<3>(y);
            for (found, steps) in found.iter_mut().zip(&blurred.steps) {
                for (found, step) in found.iter_mut().zip(steps) {
                    *found += step;
                }
            }
            if let Some(rest) = &mut rest {
                self.leave(y, &found, &mut blurred.steps, rest);
            }
        }
    }
}

/// Scratch: blocks of a row, blurred by the binomial 3×3 window.
struct Blurred {
    /// Sums over the window's rows: of means, of variances, and of the weights of known blocks, 4 in a full column. All have a
    /// halo of one block on each side.
    sums: [Vec<f32>; 3],
    variances: Vec<f32>,
    weights: Vec<f32>,
    /// Over the whole window.
    variance: Vec<f32>,
    /// 16 in a full window.
    weight: Vec<f32>,
    /// What is kept of the means.
    steps: [Vec<f32>; 3],
}

impl Blurred {
    fn new(width: usize) -> Self {
        let [wide, own] = [width + 2, width].map(|width| vec![0.0; width]);
        Self {
            sums: [(); 3].map(|()| wide.clone()),
            variances: wide,
            weights: vec![4.0; width + 2],
            variance: own.clone(),
            weight: vec![16.0; width],
            steps: [(); 3].map(|()| own.clone()),
        }
    }

    /// Sums variances and weights over the window's columns.
    #[inline(always)]
    fn add_columns(&mut self, gaps: bool) {
        let width = self.variance.len();
        if gaps {
            let [left, own, right] = columns(&self.weights, width);
            for (x, weight) in self.weight.iter_mut().enumerate() {
                *weight = larger((left[x] + right[x]) + (own[x] + own[x]), 1.0);
            }
        }
        let [left, own, right] = columns(&self.variances, width);
        for (x, variance) in self.variance.iter_mut().enumerate() {
            *variance = (left[x] + right[x]) + 4.0 * own[x];
        }
        for x in [0, width - 1] {
            let [before, here, after] = squared_weights(x, width);
            self.variance[x] = (before * left[x] + after * right[x]) + here * own[x];
        }
    }

    /// Keeps as much of the blurred means as is more than chance.
    #[inline(always)]
    fn shrink(&mut self, strictness: f32) {
        let width = self.variance.len();
        let sums = self.sums.each_ref().map(|sums| columns(sums, width));
        let [r, g, b] = self.steps.each_mut().map(|row| &mut row[..width]);
        let (variance, weight) = (&self.variance[..width], &self.weight[..width]);
        for x in 0..width {
            let per = 1.0 / weight[x];
            let blur =
                |[left, own, right]: [&[f32]; 3]| ((left[x] + right[x]) + (own[x] + own[x])) * per;
            let [br, bg, bb] = sums.map(blur);
            let square = br * br + bg * bg + bb * bb;
            let chance = strictness * (variance[x] * (per * per));
            let kept = larger(1.0 - chance / larger(square, 1e-12), 0.0);
            (r[x], g[x], b[x]) = (kept * br, kept * bg, kept * bb);
        }
    }
}

/// A row with a halo of one block: the blocks left of each, themselves, and right of each.
#[inline(always)]
fn columns(row: &[f32], width: usize) -> [&[f32]; 3] {
    [&row[..width], &row[1..][..width], &row[2..][..width]]
}

impl Shrink<'_> {
    /// Sums means, variances and weights over the window's rows.
    #[inline(always)]
    fn add_rows(&self, y: usize, blurred: &mut Blurred) {
        let Size { height, width } = self.blocks.size;
        let lines = [y.saturating_sub(1), y, (y + 1).min(height - 1)];
        for (channel, sums) in blurred.sums.iter_mut().enumerate() {
            let [above, own, below] = lines.map(|y| &self.blocks.row(channel, y)[..width]);
            let inner = &mut sums[1..][..width];
            for x in 0..width {
                inner[x] = (above[x] + below[x]) + (own[x] + own[x]);
            }
            (sums[0], sums[width + 1]) = (sums[1], sums[width]);
        }
        let [above, own, below] = lines.map(|y| &self.blocks.row(3, y)[..width]);
        let [before, here, after] = squared_weights(y, height);
        for (x, inner) in blurred.variances[1..][..width].iter_mut().enumerate() {
            let [above, own, below] = [above[x], own[x], below[x]].map(or_zero);
            *inner = (before * above + after * below) + here * own;
        }
        if self.gaps {
            let weights = &mut blurred.weights;
            for (x, inner) in weights[1..][..width].iter_mut().enumerate() {
                let [above, own, below] = [above[x], own[x], below[x]].map(known);
                *inner = (above + below) + (own + own);
            }
            (weights[0], weights[width + 1]) = (weights[1], weights[width]);
        }
    }

    /// Writes the next frame's evidence, less the correction if that is fed back into history. Overwrites the steps.
    #[inline(always)]
    fn leave(
        &self,
        y: usize,
        found: &[&mut [f32]],
        steps: &mut [Vec<f32>; 3],
        rest: &mut PixelsMut,
    ) {
        let rows = self.blocks.rows::<CHANNELS>(y);
        for ((step, own), found) in steps.iter_mut().zip(rows).zip(found) {
            let pixels = step.iter_mut().zip(own).zip(found.iter()).zip(rows[3]);
            for (((step, own), found), &variance) in pixels {
                let left = own - *step;
                let left = if self.params.fed_back {
                    left
                } else {
                    left + found
                };
                *step = if variance.is_nan() { 0.0 } else { left };
            }
        }
        for run in segments(y, self.blocks.size.width) {
            let [r, g, b] = steps.each_ref().map(|row| &row[run.x..][..run.len]);
            rest.write(run, [r, g, b, &rows[3][run.x..][..run.len]]);
        }
    }
}

/// The variance; 0 for unknown blocks.
#[inline(always)]
fn or_zero(variance: f32) -> f32 {
    if variance.is_nan() { 0.0 } else { variance }
}

/// 1 for known blocks, 0 for unknown ones.
#[inline(always)]
fn known(variance: f32) -> f32 {
    if variance.is_nan() { 0.0 } else { 1.0 }
}

/// Squares of the weights {1, 2, 1} along an axis. At a border, the replicated block's weights are added before
/// squaring.
#[inline(always)]
fn squared_weights(place: usize, count: usize) -> [f32; 3] {
    let (first, last) = (place == 0, place + 1 == count);
    match (first, last) {
        (false, false) => [1.0, 4.0, 1.0],
        (true, false) => [0.0, 9.0, 1.0],
        (false, true) => [1.0, 9.0, 0.0],
        (true, true) => [0.0, 16.0, 0.0],
    }
}
