//! Block-wise regression: the light of a block of pixels as a linear combination of feature buffers (Koskela et al.
//! 2019, *Blockwise Multi-Order Feature Regression for Real-Time Path-Tracing Reconstruction*).
//!
//! Each block minimises Σ wᵢ |cᵢ − Σ βⱼ fⱼ(i)|² with features f of {1, normal, position, position²}, as far as they are
//! given and vary within the block. Positions are relative to the block's mean, in units of its extent; this does not
//! change the span of the features. The columns are orthogonalised one after the other (QR by modified Gram-Schmidt, in
//! double precision) together with the colours, whose rest is the residual. A column that the previous ones explain to
//! all but a fraction of [`RANK`] is rank-deficient (for instance the third coordinate on a plane): only rounding is
//! left of it, and it is skipped. The paper adds noise to the features instead.
//!
//! Column pivoting takes the feature with the largest rest until none is left; or, for the fewest features, the one that
//! reduces the residual S most, as long as that lowers the generalised cross-validation score (Craven and Wahba 1979)
//!   S / (1 − (1 + λ k)/n)²,
//! an estimate of the error at pixels outside the fit, with k features besides the constant, n = (Σw)²/Σw² samples, and
//! λ = [`PENALTY`].
//!
//! Blocks form a grid, displaced by an offset; a block that the image's border cuts to less than half is merged with its
//! neighbour. Fits are clamped to the range of the colours that went into them.
//!
//! Inputs: colour (3), normal (3), position (3) or depth with a camera's rays, weight (1). Outputs: the fitted colour
//! (3) and its number of features, 1 for the constant. A pixel with missing colour or weight 0 does not take part in
//! the fit but gets the fitted colour. A pixel without a surface (features not finite, zero normal) or with an invalid
//! weight (not finite, negative) keeps its colour and counts 0 features, and so do all pixels of a block without valid
//! samples.

use std::ops::Range;

use crate::error::{Result, Whole, whole};
use crate::image::{Pixels, Run, Size};
use crate::kernels::camera::motion::Geometry;
use crate::kernels::camera::pinhole::Rays;
use crate::math::is_present;
use crate::rows::{self, Kernel, Simd};

/// A column counts as rank-deficient below this fraction of its norm: feature buffers have about three significant
/// digits.
const RANK: f64 = 1e-2;

/// Features with a smaller standard deviation are constant: normals absolutely, coordinates relative to the block's
/// extent.
const FLAT: f64 = 1e-3;
/// A block's extent below this fraction of its coordinates is rounding.
const ROUNDING: f64 = 1e-6;

/// Ratio of squared residual to squared colour below which the residual is rounding.
const EXPLAINED: f64 = 1e-14;

/// λ: cost of a feature chosen among several, in degrees of freedom. Friedman 1991, *Multivariate Adaptive Regression
/// Splines*, has 3; so do our measurements, where 1 takes more features for the same error and 8 has a larger error.
const PENALTY: f64 = 3.0;

/// Which features a fit has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Choice {
    /// All that are known.
    All,
    /// As few as serve.
    Fewest,
}

/// Blocks and features.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// Side of a block in pixels; 4 to 256; 32.
    pub block: usize,
    /// Offset of the grid of blocks, right and down, in pixels; any; 0.
    pub offset: [i64; 2],
    /// Fewest.
    pub features: Choice,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            block: 32,
            offset: [0, 0],
            features: Choice::Fewest,
        }
    }
}

impl Params {
    /// Names of choices.
    pub const FEATURES: [(&str, Choice); 2] = [("fewest", Choice::Fewest), ("all", Choice::All)];

    pub(crate) fn block(value: impl Whole<usize>) -> Result<usize> {
        whole("block", value, "4 to 256 pixels", |n| (4..=256).contains(n))
    }

    /// Whether all are in range.
    pub fn check(&self) -> Result<()> {
        Self::block(self.block)?;
        Ok(())
    }

    /// Ranges of the blocks along one axis.
    fn cut(&self, length: usize, axis: usize) -> Vec<Range<usize>> {
        let first = self.offset[axis].rem_euclid(self.block as i64) as usize;
        let mut ends: Vec<_> = (first..length)
            .step_by(self.block)
            .filter(|&end| 2 * end >= self.block && 2 * (length - end) >= self.block)
            .collect();
        ends.push(length);
        let starts = std::iter::once(0).chain(ends.clone());
        starts.zip(ends).map(|(start, end)| start..end).collect()
    }
}

/// Feature buffers.
#[derive(Clone, Copy)]
pub struct Features<'a> {
    /// 3 channels.
    pub normal: Option<Pixels<'a>>,
    /// Where the points are.
    pub place: Option<Place<'a>>,
}

/// Positions, as a buffer or from depth.
#[derive(Clone, Copy)]
pub enum Place<'a> {
    /// World space (3).
    Position(Pixels<'a>),
    /// Depth along a camera's rays.
    Depth(Pixels<'a>, Rays),
}

impl<'a> Place<'a> {
    /// `None` for depth without rays.
    pub fn new(geometry: Geometry<'a>, rays: Option<Rays>) -> Option<Self> {
        match geometry {
            Geometry::Position(position) => Some(Self::Position(position)),
            Geometry::Depth(depth) => Some(Self::Depth(depth, rays?)),
        }
    }
}

/// Writes fitted colours (interleaved) and the numbers of features.
pub fn regress(
    color: Pixels,
    features: Features,
    weight: Option<Pixels>,
    params: Params,
    fitted: &mut [f32],
    used: &mut [u8],
) {
    let Size { height, width } = color.size;
    let kernel = Regress {
        color,
        features,
        weight,
        choice: params.features,
        columns: params.cut(width, 0),
    };
    let (mut fitted, mut used) = (fitted, used);
    let jobs = params
        .cut(height, 1)
        .into_iter()
        .map(|rows| {
            let pixels = rows.len() * width;
            let outs = (
                fitted
                    .split_off_mut(..3 * pixels)
                    .expect("a record for each pixel"),
                used.split_off_mut(..pixels)
                    .expect("a number for each pixel"),
            );
            (rows, outs)
        })
        .collect();
    rows::run_jobs(&kernel, jobs);
}

struct Regress<'a> {
    color: Pixels<'a>,
    features: Features<'a>,
    weight: Option<Pixels<'a>>,
    choice: Choice,
    columns: Vec<Range<usize>>,
}

impl<'a> Kernel for Regress<'a> {
    type Out = (&'a mut [f32], &'a mut [u8]);

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, (fitted, used): Self::Out) {
        let width = self.color.size.width;
        let widest = self.columns.iter().map(Range::len).max().unwrap_or(0);
        let mut block = Block::new(rows.len() * widest);
        for columns in &self.columns {
            block.load(self, &rows, columns);
            let count = block.fit(self.choice);
            for y in rows.clone() {
                let inner = (y - rows.start) * columns.len();
                let outer = (y - rows.start) * width + columns.start;
                let fitted = &mut fitted[3 * outer..][..3 * columns.len()];
                let used = &mut used[outer..][..columns.len()];
                block.store(inner, count, fitted, used);
            }
        }
    }
}

/// Partial sums per reduction: a fixed number, so that every instruction set adds in the same order.
const PARTS: usize = 16;

/// Normal, position, position².
const COLUMNS: usize = 9;

/// The least-squares problem of one block, structure of arrays.
struct Block {
    /// Pixels, padded to a multiple of [`PARTS`].
    length: usize,
    /// 0 for pixels that do not take part in the fit.
    weight: Vec<f64>,
    /// True where the pixel shows a surface.
    surface: Vec<bool>,
    color: [Vec<f32>; 3],
    /// Colours minus the features taken so far.
    residual: [Vec<f64>; 3],
    columns: [Vec<f64>; COLUMNS],
    /// Columns not yet taken.
    given: [bool; COLUMNS],
    /// Scratch: weight times the current column.
    weighted: Vec<f64>,
    lowest: [f32; 3],
    highest: [f32; 3],
    /// Scratch: one row of an input.
    row: [Vec<f32>; 3],
}

impl Block {
    fn new(pixels: usize) -> Self {
        let padded = pixels.next_multiple_of(PARTS);
        let numbers = || vec![0.0; padded];
        Self {
            length: 0,
            weight: numbers(),
            surface: vec![false; padded],
            color: [(); 3].map(|()| vec![0.0; padded]),
            residual: [(); 3].map(|()| numbers()),
            columns: [(); COLUMNS].map(|()| numbers()),
            given: [false; COLUMNS],
            weighted: numbers(),
            lowest: [0.0; 3],
            highest: [0.0; 3],
            row: [(); 3].map(|()| vec![0.0; padded]),
        }
    }

    #[inline(always)]
    fn load(&mut self, from: &Regress, rows: &Range<usize>, columns: &Range<usize>) {
        let across = columns.len();
        let pixels = rows.len() * across;
        self.length = pixels.next_multiple_of(PARTS);
        self.surface[..self.length].fill(true);
        self.surface[pixels..self.length].fill(false);
        let Features { normal, place } = from.features;
        self.given = std::array::from_fn(|j| {
            if j < 3 {
                normal.is_some()
            } else {
                place.is_some()
            }
        });
        for y in rows.clone() {
            let run = Run {
                y,
                x: columns.start,
                len: across,
            };
            let first = (y - rows.start) * across;
            let [r, g, b] = self.color.each_mut().map(|c| &mut c[first..][..across]);
            from.color.read(run, [r, g, b]);
            if let Some(normal) = normal {
                self.load_vectors(normal, run, first, 0);
                let [x, y, z] = [0, 1, 2].map(|j| &self.columns[j][first..][..across]);
                for (i, surface) in self.surface[first..][..across].iter_mut().enumerate() {
                    // A normal of zero tells no surface; a position of zero is one.
                    *surface &= [x[i], y[i], z[i]] != [0.0; 3];
                }
            }
            match place {
                Some(Place::Position(position)) => self.load_vectors(position, run, first, 3),
                Some(Place::Depth(depth, rays)) => self.load_points(depth, rays, run, first),
                None => {}
            }
            self.load_weights(from.weight, run, first);
        }
        self.settle(pixels);
    }

    /// Loads a run of normals or positions into the three columns from `column` on.
    #[inline(always)]
    fn load_vectors(&mut self, vectors: Pixels, run: Run, first: usize, column: usize) {
        let [x, y, z] = self.row.each_mut().map(|row| &mut row[..run.len]);
        vectors.read(run, [x, y, z]);
        let surface = &mut self.surface[first..][..run.len];
        for i in 0..run.len {
            let v = [x[i], y[i], z[i]];
            surface[i] &= is_present(v);
            for (column, v) in self.columns[column..].iter_mut().zip(v) {
                column[first + i] = v.into();
            }
        }
    }

    /// Loads the points that depth and camera tell. In double precision: rays rounded to float32 are those of a slightly
    /// different camera, but points rounded to float32 would not lie on planes.
    #[inline(always)]
    fn load_points(&mut self, depth: Pixels, rays: Rays, run: Run, first: usize) {
        let Rays { dx, dy, corner } = rays;
        let [dx, dy, corner] = [dx, dy, corner].map(|axis| axis.as_dvec3());
        let z = &mut self.row[0][..run.len];
        depth.load(run, 0, z);
        let surface = &mut self.surface[first..][..run.len];
        for i in 0..run.len {
            let [x, y] = [run.x + i, run.y].map(|at| at as f64 + 0.5);
            let p = (corner + dx * x + dy * y) * f64::from(z[i]);
            surface[i] &= (z[i] > 0.0) & (z[i] < f32::INFINITY);
            for (column, p) in self.columns[3..6].iter_mut().zip(p.to_array()) {
                column[first + i] = p;
            }
        }
    }

    #[inline(always)]
    fn load_weights(&mut self, weights: Option<Pixels>, run: Run, first: usize) {
        let weight = &mut self.weight[first..][..run.len];
        let Some(weights) = weights else {
            weight.fill(1.0);
            return;
        };
        let row = &mut self.row[0][..run.len];
        weights.load(run, 0, row);
        let surface = &mut self.surface[first..][..run.len];
        for i in 0..run.len {
            surface[i] &= (row[i] >= 0.0) & (row[i] < f32::INFINITY);
            weight[i] = if surface[i] { row[i].into() } else { 0.0 };
        }
    }

    /// Takes the weight of pixels that do not count, and finds the range of the colours of those that do.
    #[inline(always)]
    fn settle(&mut self, pixels: usize) {
        self.weight[pixels..self.length].fill(0.0);
        (self.lowest, self.highest) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for i in 0..self.length {
            let color = self.color.each_ref().map(|channel| channel[i]);
            let counts = is_present(color) & self.surface[i] & (self.weight[i] > 0.0);
            if !counts {
                self.weight[i] = 0.0;
            }
            for c in 0..3 {
                self.residual[c][i] = if counts { color[c].into() } else { 0.0 };
                if counts {
                    self.lowest[c] = self.lowest[c].min(color[c]);
                    self.highest[c] = self.highest[c].max(color[c]);
                }
            }
            if !self.surface[i] {
                for column in &mut self.columns {
                    column[i] = 0.0;
                }
            }
        }
    }

    /// Fits the colours; returns the number of features, 0 without valid samples.
    #[inline(always)]
    fn fit(&mut self, choice: Choice) -> u8 {
        let n = self.length;
        let total = sum(&self.weight[..n]);
        if total <= 0.0 {
            return 0;
        }
        let samples = total * total / dot(&self.weight[..n], &self.weight[..n]);
        let score = |unexplained: f64, count: u8| {
            let freedom = 1.0 - (1.0 + PENALTY * f64::from(count)) / samples;
            if freedom > 0.0 {
                unexplained / (freedom * freedom)
            } else {
                f64::INFINITY
            }
        };
        let [mut power, mut unexplained] = [0.0; 2];
        for residual in &mut self.residual {
            let (weight, residual) = (&self.weight[..n], &mut residual[..n]);
            power += weighted_square(weight, residual) / total;
            center(residual, weight, total);
            unexplained += weighted_square(weight, residual) / total;
        }
        self.prepare(total);

        // Updated instead of recomputed: the squared norm of each column's rest, and its products with the residual.
        let mut left = [1.0; COLUMNS];
        let mut products = [[0.0; 3]; COLUMNS];
        for j in (0..COLUMNS).filter(|&j| self.given[j]) {
            multiply(
                &self.weight[..n],
                &self.columns[j][..n],
                &mut self.weighted[..n],
            );
            for c in 0..3 {
                products[j][c] = dot(&self.weighted[..n], &self.residual[c][..n]) / total;
            }
        }
        let mut count = 0;
        loop {
            let (mut best, mut most, mut rest) = (None, 0.0, unexplained);
            for j in (0..COLUMNS).filter(|&j| self.given[j] && left[j] > RANK * RANK) {
                let [r, g, b] = products[j];
                let explains = (r * r + g * g + b * b) / left[j];
                let worth = match choice {
                    Choice::Fewest => explains,
                    Choice::All => left[j],
                };
                if worth > most {
                    (best, most, rest) = (Some(j), worth, unexplained - explains);
                }
            }
            let Some(j) = best else { break };
            // A residual at rounding level is not fitted further.
            let pays = score(rest, count + 1) < score(unexplained, count);
            if choice == Choice::Fewest && (unexplained <= EXPLAINED * power || !pays) {
                break;
            }
            (self.given[j], unexplained) = (false, rest);
            count += 1;

            let pivot = std::mem::take(&mut self.columns[j]);
            multiply(&self.weight[..n], &pivot[..n], &mut self.weighted[..n]);
            let weighted = &self.weighted[..n];
            let own = dot(weighted, &pivot[..n]);
            let mut slopes = [0.0; 3];
            for (slope, residual) in slopes.iter_mut().zip(&mut self.residual) {
                *slope = dot(weighted, &residual[..n]) / own;
                subtract(&mut residual[..n], *slope, &pivot[..n]);
            }
            for k in (0..COLUMNS).filter(|&k| self.given[k]) {
                let column = &mut self.columns[k][..n];
                let slope = dot(weighted, column) / own;
                subtract(column, slope, &pivot[..n]);
                let common = slope * own / total;
                left[k] -= slope * common;
                for c in 0..3 {
                    products[k][c] -= slopes[c] * common;
                }
            }
            self.columns[j] = pivot;
        }
        1 + count
    }

    /// Centres the columns, computes squares, scales all to unit variance and drops constant ones.
    #[inline(always)]
    fn prepare(&mut self, total: f64) {
        let n = self.length;
        let weight = &self.weight[..n];
        let mut means = [0.0; 6];
        for j in (0..6).filter(|&j| self.given[j]) {
            means[j] = center(&mut self.columns[j][..n], weight, total);
        }
        let mut spread = [0.0; COLUMNS];
        for j in (0..6).filter(|&j| self.given[j]) {
            spread[j] = weighted_square(weight, &self.columns[j][..n]) / total;
        }
        if self.given[3] {
            let largest = spread[3].max(spread[4]).max(spread[5]);
            let coordinate = means[3..]
                .iter()
                .fold(0.0, |most: f64, mean| most.max(mean.abs()));
            let varies = largest > ROUNDING * ROUNDING * coordinate * coordinate;
            for j in 3..6 {
                let (first, second) = self.columns.split_at_mut(6);
                let (position, square) = (&mut first[j][..n], &mut second[j - 3][..n]);
                if varies && spread[j] > FLAT * FLAT * largest {
                    let scale = 1.0 / spread[j].sqrt();
                    for (square, position) in square.iter_mut().zip(position) {
                        *position *= scale;
                        *square = *position * *position;
                    }
                    center(square, weight, total);
                    spread[3 + j] = weighted_square(weight, square) / total;
                    spread[j] = 1.0;
                } else {
                    (spread[j], spread[3 + j]) = (0.0, 0.0);
                }
            }
        }
        for j in 0..COLUMNS {
            self.given[j] &= spread[j] > FLAT * FLAT;
            if self.given[j] {
                let scale = 1.0 / spread[j].sqrt();
                self.columns[j][..n].iter_mut().for_each(|x| *x *= scale);
            }
        }
    }

    /// Writes one row of the block, which starts at its pixel `first`.
    #[inline(always)]
    fn store(&self, first: usize, count: u8, fitted: &mut [f32], used: &mut [u8]) {
        let pixels = fitted.as_chunks_mut::<3>().0.iter_mut().zip(used);
        for (i, (fitted, used)) in (first..).zip(pixels) {
            let fits = self.surface[i] && count > 0;
            *used = if fits { count } else { 0 };
            for c in 0..3 {
                let own = self.color[c][i];
                let known = if self.weight[i] > 0.0 {
                    f64::from(own)
                } else {
                    0.0
                };
                let fit = (known - self.residual[c][i]) as f32;
                let clamped = fit.max(self.lowest[c]).min(self.highest[c]);
                fitted[c] = if fits { clamped } else { own };
            }
        }
    }
}

#[inline(always)]
fn sum_of(parts: [f64; PARTS]) -> f64 {
    let mut parts = parts;
    let mut half = PARTS / 2;
    while half > 0 {
        for i in 0..half {
            parts[i] += parts[i + half];
        }
        half /= 2;
    }
    parts[0]
}

/// The sum of a term over the elements of columns.
#[inline(always)]
fn reduce<const N: usize>(columns: [&[f64]; N], term: impl Fn([f64; N]) -> f64) -> f64 {
    let columns = columns.map(|column| column.as_chunks::<PARTS>().0);
    let mut parts = [0.0; PARTS];
    for chunk in 0..columns[0].len() {
        let chunks = columns.map(|column| &column[chunk]);
        for (i, part) in parts.iter_mut().enumerate() {
            *part += term(chunks.map(|chunk| chunk[i]));
        }
    }
    sum_of(parts)
}

#[inline(always)]
fn sum(a: &[f64]) -> f64 {
    reduce([a], |[a]| a)
}

#[inline(always)]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    reduce([a, b], |[a, b]| a * b)
}

#[inline(always)]
fn weighted_square(weight: &[f64], a: &[f64]) -> f64 {
    reduce([weight, a], |[weight, a]| weight * a * a)
}

#[inline(always)]
fn multiply(a: &[f64], b: &[f64], product: &mut [f64]) {
    for ((product, &a), &b) in product.iter_mut().zip(a).zip(b) {
        *product = a * b;
    }
}

#[inline(always)]
fn subtract(from: &mut [f64], factor: f64, what: &[f64]) {
    for (from, &what) in from.iter_mut().zip(what) {
        *from -= factor * what;
    }
}

/// Subtracts the weighted mean and returns it.
#[inline(always)]
fn center(column: &mut [f64], weight: &[f64], total: f64) -> f64 {
    let mean = dot(weight, column) / total;
    column.iter_mut().for_each(|x| *x -= mean);
    mean
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_are_at_least_halves_and_cover_all() {
        for length in 1..100 {
            for offset in -40..40 {
                let params = Params {
                    offset: [offset, 0],
                    ..Default::default()
                };
                let parts = params.cut(length, 0);
                assert!(parts.iter().cloned().flatten().eq(0..length));
                assert!(
                    parts.len() == 1 || parts.iter().all(|part| (16..48).contains(&part.len()))
                );
            }
        }
    }
}
