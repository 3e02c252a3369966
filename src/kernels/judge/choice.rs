//! Choice: which of several predictions is best, tile by tile, judged by new samples that none of them has seen.
//!
//! The candidates p₀, p₁, … are a series, such as the images after 0, 1, … passes of a filter. A new sample y is an
//! unbiased estimate of the reference, and (a − y)² − (b − y)² is linear in it (see [`super::prediction`]). With μ the
//! mean of the default candidate's channels, at least 0, s = μ + e/16 for the exposure e, aₖ = (pₖ − μ)/s and r =
//! clamp((y − μ)/s, ±8), step k from candidate k − 1 to k costs
//!   dₖ = mean over channels of (aₖ − aₖ₋₁)(aₖ + aₖ₋₁ − 2r),
//! negative where the step brings the image nearer to the reference.
//! **Evidence.** The previous frame's candidates are stored at one pixel of each 2×2. Pixels of the new frame that have
//! history and whose motion ends nearest to a stored pixel are compared there. Tiles of 8×8 sum dₖ, dₖ² and their
//! number n. The sums of earlier frames are reprojected by the motion of the tile's centre, interpolated bilinearly
//! between tiles, and decay by 1 − β a frame.
//! **Decision.** With the sums G of d, V of d² and n averaged over neighbouring tiles by {1, 2, 1}/4 ⊗ {1, 2, 1}/4, the
//! cost of candidate j relative to the default u is
//!   Σ ±Gₖ/n + c √(Σ Vₖ/n / (64/9 n)),  k over the steps between u and j, + beyond u and − before it,
//! 64/9 being the effective number of tiles in the average. The cheapest candidate wins: one other than u must be
//! better by c standard errors, and where n is below 16, u stays.
//!
//! The choice is interpolated between tile centres, and a fractional choice mixes two candidates, so that tiles do not
//! show. Motion is rounded to the nearest pixel: resampling would blur sharp candidates more than smooth ones and bias
//! the comparison. The clamp at ±8 keeps a single bright sample from deciding for a tile, at the price of a bias where
//! much of the light comes in rare samples brighter than that.
//!
//! Inputs: new samples (3), candidates (3 each; of half the size), motion (2), coverage (1), evidence (2 steps + 1; of
//! an eighth of the size). Outputs: choice (1) and evidence, of an eighth of the size.

use std::ops::Range;

use super::innovation;
use crate::error::{Result, in_range};
use crate::image::{BandMut, Image, Pixels, Records, Run, SEGMENT, Size, View, segments};
use crate::lanes::LANES;
use crate::math::{larger, smaller};
use crate::pixels::{Colors, Row, rows_of};
use crate::rows::{self, BAND, Kernel, Simd};

/// What it takes for another candidate than the usual one.
#[derive(Clone, Copy, Debug)]
pub struct Params {
    /// c: standard errors by which a candidate must beat the default; ≥ 0; 0.5.
    pub strictness: f32,
    /// β: fraction of the evidence that decays per frame; 0 to 1; 0.1.
    pub share: f32,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            strictness: 0.5,
            share: 0.1,
        }
    }
}

impl Params {
    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        in_range(
            "strictness",
            self.strictness,
            "a finite number from 0",
            |v| v >= 0.0 && v.is_finite(),
        )?;
        in_range("share", self.share, "a share from 0 to 1", |v| {
            (0.0..=1.0).contains(&v)
        })
    }
}

/// Side of a tile in pixels; divides [`SEGMENT`].
const TILE: usize = 8;

/// Bound of a sample's relative difference r.
const BOUND: f32 = 8.0;
/// With fewer comparisons the default stays.
const MIN_COMPARISONS: f32 = 16.0;
/// Effective number of tiles in the average over neighbours: one over the sum of its squared weights.
const TILES: f32 = 64.0 / 9.0;

fn parts(size: Size, side: usize) -> Size {
    Size {
        height: size.height.div_ceil(side),
        width: size.width.div_ceil(side),
    }
}

/// The grid of tiles of an image.
pub fn tiles(size: Size) -> Size {
    parts(size, TILE)
}

/// The size of stored candidates: one pixel of each 2×2.
pub fn known_size(size: Size) -> Size {
    parts(size, 2)
}

/// Channels of a tile's evidence: Σd and Σd² of each step, and n.
pub fn channels(candidates: usize) -> usize {
    2 * (candidates - 1) + 1
}

/// Candidates stored for the next frame: one pixel of each 2×2, NaN where that pixel lies beyond the image.
pub(crate) struct Candidates {
    size: Size,
    /// One planar image per candidate.
    images: Vec<Image>,
    offset: [usize; 2],
}

/// A row of a stored candidate.
pub(crate) type CandidateRow<'a> = [&'a mut [f32]; 3];

impl Candidates {
    /// Empty, for frame `age` of a sequence. The stored pixel cycles through the 2×2 in the order in which sequences
    /// that trace a quarter of the pixels do, so that, without motion, it is the one that the next frame traces.
    pub fn none(age: usize, size: Size) -> Self {
        Self {
            size,
            images: vec![],
            offset: [[1, 1], [1, 0], [0, 1], [0, 0]][age % 4],
        }
    }

    /// The stored column of each two: 0 or 1.
    pub fn column(&self) -> usize {
        self.offset[0]
    }

    /// Adds a candidate; returns, for each row of the full image, the row to store its pixels in, if it is stored.
    pub fn add(&mut self) -> impl Iterator<Item = Option<CandidateRow<'_>>> {
        let (Size { height, width }, kept) = (self.size, known_size(self.size));
        self.images.push(Image::blank(kept, 3));
        let image = self.images.last_mut().expect("one was added");
        let mut rows = rows_of::<3>(image);
        let mine = self.offset[1];
        if kept.width * 2 > width && self.offset[0] == 1 {
            rows.iter_mut()
                .flatten()
                .for_each(|row| row[kept.width - 1] = f32::NAN);
        }
        if kept.height * 2 > height && mine == 1 {
            let last = rows.pop().expect("at least one row");
            last.into_iter().for_each(|row| row.fill(f32::NAN));
        }
        let mut rows = rows.into_iter();
        (0..height).map(move |y| (y % 2 == mine).then(|| rows.next()).flatten())
    }

    /// As an argument of [`choice`] for the next frame.
    pub fn known(&self) -> Known<'_> {
        Known {
            candidates: self.images.iter().map(Image::pixels).collect(),
            offset: self.offset,
        }
    }
}

/// Stores one column of each two of a span.
#[inline(always)]
pub(crate) fn keep(column: usize, run: Run, colors: &[Row; 3], row: &mut CandidateRow) {
    for (kept, colors) in row.iter_mut().zip(colors) {
        let colors = colors[..run.len].as_chunks::<2>();
        let kept = &mut kept[run.x / 2..];
        for (kept, pair) in kept.iter_mut().zip(colors.0) {
            *kept = pair[column];
        }
        if let (0, [last]) = (column, colors.1) {
            kept[colors.0.len()] = *last;
        }
    }
}

/// The previous frame's candidates.
pub struct Known<'a> {
    /// Images of [`known_size`].
    pub candidates: Vec<Pixels<'a>>,
    /// The stored pixel of each 2×2: x and y, 0 or 1.
    pub offset: [usize; 2],
}

/// Chooses a candidate for each tile; returns the choice and the evidence for the next frame.
pub fn choice(
    fresh: &impl Colors,
    known: Known,
    motion: Pixels,
    coverage: View,
    evidence: Option<Pixels>,
    exposure: f32,
    usual: usize,
    params: Params,
) -> (Image, Records) {
    let size = tiles(coverage.size);
    let numbers = channels(known.candidates.len());
    let compare = Compare {
        fresh,
        known,
        motion,
        coverage,
        evidence,
        black: innovation::black(exposure),
        usual,
        keep: 1.0 - params.share,
    };
    let mut after = Records::blank(size, numbers);
    let band = BAND * size.width * numbers;
    rows::run(&compare, size.height, after.data_mut().chunks_mut(band));
    let mut chosen = Image::blank(size, 1);
    let decide = Decide {
        evidence: after.pixels(),
        usual,
        strictness: params.strictness,
    };
    rows::run(&decide, size.height, chosen.bands());
    (chosen, after)
}

/// Compares the candidates with the new samples and updates the evidence.
struct Compare<'a, F> {
    fresh: &'a F,
    known: Known<'a>,
    motion: Pixels<'a>,
    coverage: View<'a>,
    evidence: Option<Pixels<'a>>,
    black: f32,
    usual: usize,
    /// Decay of evidence per frame, 1 − β.
    keep: f32,
}

/// Index of pixels that cannot be compared: their motion does not end at a stored pixel.
const NOWHERE: u32 = u32::MAX;

impl<'a, F: Colors> Kernel for Compare<'a, F> {
    type Out = &'a mut [f32];

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, evidence: &'a mut [f32]) {
        let Size { height, width } = self.coverage.size;
        let count = self.known.candidates.len();
        let numbers = channels(count);
        let line = tiles(self.coverage.size).width * numbers;
        let mut found = Found::new(count);
        for (row, evidence) in rows::lines(rows, evidence, line) {
            for (column, record) in evidence.chunks_exact_mut(numbers).enumerate() {
                self.carry(row, column, record);
            }
            for y in TILE * row..(TILE * (row + 1)).min(height) {
                for run in segments(y, width) {
                    let first = run.x / TILE * numbers;
                    self.compare(run, &mut found, &mut evidence[first..]);
                }
            }
        }
    }
}

impl<F: Colors> Compare<'_, F> {
    /// Reprojects and decays a tile's evidence.
    #[inline(always)]
    fn carry(&self, row: usize, column: usize, record: &mut [f32]) {
        record.fill(0.0);
        let Some(before) = self.evidence else { return };
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

    /// Adds a span's comparisons to the evidence of its tiles.
    #[inline(always)]
    fn compare(&self, run: Run, found: &mut Found, evidence: &mut [f32]) {
        let places = self.places(run);
        found.count = 0;
        for (x, &place) in places[..run.len].iter().enumerate() {
            if place != NOWHERE {
                (found.columns[found.count], found.places[found.count]) = (x, place);
                found.count += 1;
            }
        }
        if found.count == 0 {
            return;
        }
        let mut fresh = [[0.0; SEGMENT]; 3];
        self.fresh.colors(run, &mut fresh);
        self.steps(&fresh, found);
        let numbers = 2 * found.steps.len() + 1;
        for (i, &column) in found.columns[..found.count].iter().enumerate() {
            if found.missing[i].is_nan() {
                continue;
            }
            let record = &mut evidence[column / TILE * numbers..][..numbers];
            let (sums, count) = record.split_at_mut(numbers - 1);
            let (gains, squares) = sums.split_at_mut(found.steps.len());
            for ((gain, square), step) in gains.iter_mut().zip(squares).zip(&found.steps) {
                *gain += step[i];
                *square += step[i] * step[i];
            }
            count[0] += 1.0;
        }
    }

    /// Computes dₖ of the gathered pixels; `missing` marks pixels without a valid sample or candidate.
    #[inline(always)]
    fn steps(&self, fresh: &[Row; 3], found: &mut Found) {
        let Found {
            count,
            columns,
            places,
            steps,
            missing,
        } = found;
        let (columns, places) = (&columns[..*count], &places[..*count]);
        // Rounded up to whole vectors; the padding is not read.
        let filled = count.next_multiple_of(LANES).min(SEGMENT);
        let mut sample = [[0.0; SEGMENT]; 3];
        for (sample, fresh) in sample.iter_mut().zip(fresh) {
            for (sample, &column) in sample.iter_mut().zip(columns) {
                *sample = fresh[column];
            }
        }
        let mut next = [[0.0; SEGMENT]; 3];
        gather(self.known.candidates[self.usual], places, &mut next);
        let (mut middle, mut per) = ([0.0; SEGMENT], [0.0; SEGMENT]);
        for i in 0..filled {
            let mean = (next[0][i] + next[1][i] + next[2][i]) * (1.0 / 3.0);
            middle[i] = larger(mean, 0.0);
            per[i] = 1.0 / (middle[i] + self.black);
            missing[i] = 0.0;
        }
        for sample in &mut sample {
            for i in 0..filled {
                // 0 · x is NaN if x is not finite, else 0.
                missing[i] += 0.0 * sample[i];
                let relative = (sample[i] - middle[i]) * per[i];
                sample[i] = smaller(larger(relative, -BOUND), BOUND);
            }
        }
        let mut before = [[0.0; SEGMENT]; 3];
        for (k, &candidate) in self.known.candidates.iter().enumerate() {
            gather(candidate, places, &mut next);
            for next in &mut next {
                for i in 0..filled {
                    missing[i] += 0.0 * next[i];
                    next[i] = (next[i] - middle[i]) * per[i];
                }
            }
            if k > 0 {
                let step = &mut steps[k - 1];
                for i in 0..filled {
                    let gain = |c: usize| {
                        let (next, before) = (next[c][i], before[c][i]);
                        (next - before) * (next + before - 2.0 * sample[c][i])
                    };
                    step[i] = (gain(0) + gain(1) + gain(2)) * (1.0 / 3.0);
                }
            }
            before = next;
        }
    }

    /// For each pixel, the index of the stored pixel at the end of its motion, or [`NOWHERE`].
    #[inline(always)]
    fn places(&self, run: Run) -> [u32; SEGMENT] {
        let Size { height, width } = self.coverage.size;
        let mut motion = [[0.0; SEGMENT]; 2];
        self.motion
            .read(run, motion.each_mut().map(Row::as_mut_slice));
        let coverage = &self.coverage.row(0, run.y)[run.x..][..run.len];
        let mut places = [NOWHERE; SEGMENT];
        let (right, bottom) = (width as f32, height as f32);
        let [dx, dy] = self.known.offset.map(|d| d as u32);
        let blocks = known_size(self.coverage.size).width as u32;
        for x in 0..run.len {
            let tx = ((run.x + x) as f32 + motion[0][x] + 0.5).floor();
            let ty = (run.y as f32 + motion[1][x] + 0.5).floor();
            let inside = (tx >= 0.0) & (ty >= 0.0) & (tx < right) & (ty < bottom);
            let held = |at: f32| if inside { at as u32 } else { 0 };
            let (tx, ty) = (held(tx), held(ty));
            let known = inside & (tx & 1 == dx) & (ty & 1 == dy) & (coverage[x] > 0.0);
            let place = (ty >> 1) * blocks + (tx >> 1);
            places[x] = if known { place } else { NOWHERE };
        }
        places
    }
}

/// The comparable pixels of a span, compacted.
struct Found {
    count: usize,
    /// Position in the span.
    columns: [usize; SEGMENT],
    /// Index of the stored pixel.
    places: [u32; SEGMENT],
    /// dₖ.
    steps: Vec<Row>,
    /// NaN where the sample or a candidate is missing, else 0.
    missing: Row,
}

impl Found {
    fn new(candidates: usize) -> Self {
        Self {
            count: 0,
            columns: [0; SEGMENT],
            places: [0; SEGMENT],
            steps: vec![[0.0; SEGMENT]; candidates - 1],
            missing: [0.0; SEGMENT],
        }
    }
}

#[inline(always)]
fn gather(image: Pixels, places: &[u32], into: &mut [Row; 3]) {
    for (channel, row) in into.iter_mut().enumerate() {
        image.part(channel..channel + 1).gather(places, row);
    }
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
        let Size { height, width } = self.evidence.size;
        let mut around = vec![0.0; self.evidence.channels];
        let near = |at: usize, side: usize| [at.saturating_sub(1), at, (at + 1).min(side - 1)];
        const WEIGHTS: [f32; 3] = [0.25, 0.5, 0.25];
        for y in rows {
            for x in 0..width {
                around.fill(0.0);
                for (row, wy) in near(y, height).into_iter().zip(WEIGHTS) {
                    for (column, wx) in near(x, width).into_iter().zip(WEIGHTS) {
                        let tile = row * width + column;
                        for (channel, sum) in around.iter_mut().enumerate() {
                            *sum += wy * wx * self.evidence.at(tile, channel);
                        }
                    }
                }
                chosen.row(0, y)[x] = self.cheapest(&around) as f32;
            }
        }
    }
}

impl Decide<'_> {
    #[inline(always)]
    fn cheapest(&self, evidence: &[f32]) -> usize {
        let (sums, count) = evidence.split_at(evidence.len() - 1);
        let (gains, squares) = sums.split_at(sums.len() / 2);
        let (n, usual) = (count[0], self.usual);
        if !(n >= MIN_COMPARISONS) {
            return usual;
        }
        let (mut best, mut least) = (usual, 0.0);
        let mut walk = |steps: &mut dyn Iterator<Item = usize>, sign: f32| {
            let (mut gain, mut variance) = (0.0, 0.0);
            for step in steps {
                gain += sign * (gains[step] / n);
                variance += squares[step] / n / (TILES * n);
                let cost = gain + self.strictness * variance.sqrt();
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
}

/// The tiles' choice, interpolated at pixels.
pub(crate) struct Levels<'a>(pub &'a Image);

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
            self.0.view().row(0, row as usize)
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
