//! Triple collocation: how much of an image's detail is noise, and which mixture of samples and results is nearest to the
//! reference, tile by tile.
//!
//! Comparing results with a frame's own samples needs the samples' noise, which no single frame tells from detail. Three
//! measurements of one signal with independent noise do (Stoffelen 1998): the new samples y, those p of the frame before
//! and those q of two frames before, which are all brought along the motion to where the new ones are. Of each, only detail
//! counts, d(x) = x minus the mean of its 3×3 pixels. With ⟨a b⟩ the mean of d(a) d(b) in a tile's surroundings,
//!   S = min(⟨y p⟩ ⟨p q⟩ / max(⟨y q⟩, κ √(⟨y y⟩ ⟨q q⟩)), ⟨p p⟩)
//! is the energy of the detail in p, and N = ⟨p p⟩ − S that of its noise. What resampling and imprecise motion lose from
//! frame to frame is lost in ⟨y q⟩ as well, and cancels. Of p's detail, the share r = ⟨y p⟩ / S is left in y, so that y / r
//! measures it, too, with noise that neither p nor a result of the frame before has.
//! **Two results** a and b of the frame before, brought along like p: b's squared error less a's is
//!   E = ⟨b b⟩ − ⟨a a⟩ − 2 (⟨y b⟩ − ⟨y a⟩) / r,
//! and the mixture m = b + λ (a − b) with the least error has λ = ½ + E / 2⟨(a − b)²⟩, from 0 to 1.
//! **Result and samples**: m + g (p − m) has the least error with
//!   g = 1 − (N − C) / ⟨(p − m)²⟩, C = ⟨p m⟩ − ⟨y m⟩ / r,
//! from 0 to 1. It is Wiener's share of p − m that is not noise; C, from 0 to N/2, is the noise that m shares with p, as one
//! of the samples that it was made of.
//!
//! **Evidence.** Tiles of 8×8 sum the products, weighted by 1 / (max(⟨y y⟩ + ⟨p p⟩, ⟨q q⟩/16, ⟨a a⟩/16, ⟨b b⟩/16) + (e/1024)²)
//! of the frame for the exposure e, and the number n of their pixels. So no single frame decides for long, not even one in
//! which a flash is gone from samples but not from results. It is carried and averaged as in [`super::choice`]. Where n is
//! below 16, λ and g are 0.
//!
//! Inputs: luminances of y, p, q, a and b (5), motion (2), coverage (1), evidence (14; of an eighth of the size). Outputs:
//! λ and g (2) and evidence, of an eighth of the size.

use std::ops::Range;

use super::choice::{MIN_COMPARISONS, TILE, average, carry, tiles};
use crate::image::{BandMut, Image, Interleaved, Pixels, Size, View, segments};
use crate::math::{larger, saturate, smaller};
use crate::pixels::Rolling;
use crate::rows::{self, BAND, Kernel, Simd};

/// Luminances of new samples, of samples one and two frames before, and of two results of the frame before.
pub const PLANES: usize = 5;
/// The products that a tile sums, by their factors' places among the planes.
const PAIRS: [[usize; 2]; 13] = [
    [0, 0],
    [0, 1],
    [0, 2],
    [1, 1],
    [1, 2],
    [2, 2],
    [0, 3],
    [1, 3],
    [3, 3],
    [0, 4],
    [1, 4],
    [4, 4],
    [3, 4],
];
/// Places in [`PAIRS`] of the planes' energies.
const ENERGIES: [usize; PLANES] = [0, 3, 5, 8, 11];
/// Channels of a tile's evidence: the products, and the number of pixels.
pub const CHANNELS: usize = PAIRS.len() + 1;
/// Of a tile's mixture: λ and g.
pub const SHARES: usize = 2;

/// κ: correlation of new samples with those of two frames before below which their product is chance. Measured on sequences
/// of 1 to 64 samples: with 0.05, those of 2 samples lose 0.2 dB at lamps; with 0.2, those of 64 lose 0.3 dB.
const LEAST: f32 = 0.1;
/// A frame counts for at most so many ordinary ones where earlier samples or results have more energy than the samples.
/// Measured: with 1, the relative error of `BMFR` on glossy plates grows by 14 %; without a bound, one flash decides for a
/// hundred frames.
const MOST: f32 = 16.0;
/// Of the exposure: detail below it is black.
const BLACK: f32 = 1.0 / 1024.0;

/// The default of β, the fraction of the evidence that decays per frame.
pub const SHARE: f32 = 0.2;

/// What is compared, row by row: an image, or a computation that needs no intermediate one.
pub trait Luminances: Sync {
    /// Columns and rows.
    fn size(&self) -> Size;
    /// Writes a row of each luminance, NaN where a pixel has none.
    fn read(&self, y: usize, rows: [&mut [f32]; PLANES]);
}

impl Luminances for Pixels<'_> {
    fn size(&self) -> Size {
        self.size
    }

    #[inline(always)]
    fn read(&self, y: usize, mut rows: [&mut [f32]; PLANES]) {
        for run in segments(y, self.size.width) {
            Pixels::read(self, run, rows.each_mut().map(|row| &mut row[run.x..]));
        }
    }
}

/// Adds a frame's products to the evidence. Pixels count where all luminances are finite in all of the 3×3.
pub fn collocate(luminances: &impl Luminances, exposure: f32, evidence: &mut Interleaved) {
    let Size { height, width } = evidence.size;
    let black = exposure * BLACK;
    let kernel = Collocate {
        luminances,
        quiet: (black * black).max(f32::MIN_POSITIVE),
    };
    let outs = evidence.data_mut().chunks_mut(BAND * width * CHANNELS);
    rows::run(&kernel, height, outs);
}

/// The evidence of the frames before where the tiles are now, and the mixtures by it.
pub fn shares(
    evidence: Pixels,
    motion: Pixels,
    coverage: View,
    share: f32,
) -> (Image, Interleaved) {
    let carried = carry(evidence, motion, coverage, share);
    let size = evidence.size;
    let mut shares = Image::blank(size, SHARES);
    let decide = Decide {
        evidence: carried.pixels(),
    };
    rows::run(&decide, size.height, shares.bands());
    (shares, carried)
}

/// The mixture that would have been best for all tiles together. Each tile's products are scaled by its samples' share of
/// the energy of samples and results: a result that keeps a lamp that has moved on may have a thousand times the energy of
/// the samples there, and a single tile must not decide for all.
pub fn share_of_all(evidence: &Interleaved) -> [f32; SHARES] {
    let mut sums = [0.0; CHANNELS];
    for tile in evidence.pixels().elements().0.chunks_exact(CHANNELS) {
        let [y, p, _, a, b] = ENERGIES.map(|k| f64::from(tile[k]));
        let share = (y + p) / (y + p + a + b);
        let share = if share.is_finite() { share } else { 1.0 };
        let (products, count) = sums.split_at_mut(PAIRS.len());
        for (sum, &value) in products.iter_mut().zip(tile) {
            *sum += share * f64::from(value);
        }
        count[0] += f64::from(tile[PAIRS.len()]);
    }
    mixture(&sums.map(|sum| sum as f32))
}

/// Evidence before any frame.
pub fn nothing(size: Size) -> Interleaved {
    Interleaved::new(tiles(size), CHANNELS)
}

struct Collocate<'a, L> {
    luminances: &'a L,
    quiet: f32,
}

impl<'a, L: Luminances> Kernel for Collocate<'a, L> {
    type Out = &'a mut [f32];

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, evidence: &'a mut [f32]) {
        let size = self.luminances.size();
        let Size { height, width } = size;
        let mut around = Rolling::<PLANES>::new(width, 1);
        let mut details: [_; PLANES] = std::array::from_fn(|_| vec![0.0; width]);
        let mut known = vec![0.0; width];
        let mut columns: [_; CHANNELS] = std::array::from_fn(|_| vec![0.0; width]);
        for (row, evidence) in rows::lines(rows, evidence, width.div_ceil(TILE) * CHANNELS) {
            columns.iter_mut().for_each(|sums| sums.fill(0.0));
            let top = TILE * row;
            for y in top..(top + TILE).min(height) {
                for y in around.due(y, y == top) {
                    if let Some(rows) = around.fresh(y, size) {
                        self.luminances.read(y as usize, rows);
                    }
                }
                find_details(&around, y, &mut details, &mut known);
                add(&details, &known, &mut columns);
            }
            let tiles = evidence.chunks_exact_mut(CHANNELS);
            for (start, evidence) in (0..width).step_by(TILE).zip(tiles) {
                let tile = start..(start + TILE).min(width);
                let sums = |sums: &Vec<f32>| sums[tile.clone()].iter().sum();
                self.weigh(&columns.each_ref().map(sums), evidence);
            }
        }
    }
}

/// Each plane's detail in a row, 0 where not all are known, and whether they are: 1 or 0.
#[inline(always)]
fn find_details(
    around: &Rolling<PLANES>,
    y: usize,
    details: &mut [Vec<f32>; PLANES],
    known: &mut [f32],
) {
    let y = y as isize;
    let [above, here, below] = [y - 1, y, y + 1].map(|y| around.row(y));
    known.fill(0.0);
    for (c, detail) in details.iter_mut().enumerate() {
        let width = detail.len();
        let [above, here, below] = [above, here, below].map(|rows| &rows[c][..width + 2]);
        for (x, (detail, known)) in detail.iter_mut().zip(known.iter_mut()).enumerate() {
            let column = |x: usize| above[x] + here[x] + below[x];
            *detail = here[x + 1] - (column(x) + column(x + 1) + column(x + 2)) / 9.0;
            // NaN if one of the nine is not finite, else 0.
            *known += 0.0 * *detail;
        }
    }
    for known in &mut *known {
        *known = if known.is_nan() { 0.0 } else { 1.0 };
    }
    for detail in details {
        for (detail, &known) in detail.iter_mut().zip(&*known) {
            *detail = if known > 0.0 { *detail } else { 0.0 };
        }
    }
}

/// Adds a row's products to the sums of its columns.
#[inline(always)]
fn add(details: &[Vec<f32>; PLANES], known: &[f32], columns: &mut [Vec<f32>; CHANNELS]) {
    let (products, count) = columns.split_at_mut(PAIRS.len());
    for (sums, [a, b]) in products.iter_mut().zip(PAIRS) {
        for ((sum, a), b) in sums.iter_mut().zip(&details[a]).zip(&details[b]) {
            *sum = a.mul_add(*b, *sum);
        }
    }
    for (sum, known) in count[0].iter_mut().zip(known) {
        *sum += known;
    }
}

impl<L> Collocate<'_, L> {
    /// Adds a frame's sums in a tile to its evidence, with their weight.
    #[inline(always)]
    fn weigh(&self, sums: &[f32; CHANNELS], evidence: &mut [f32]) {
        let (products, n) = (&sums[..PAIRS.len()], sums[PAIRS.len()]);
        let [y, p, q, a, b] = ENERGIES.map(|k| products[k]);
        let energy = larger(y + p, larger(q, larger(a, b)) / MOST);
        if n == 0.0 || energy.is_infinite() {
            return;
        }
        let weight = 1.0 / (energy / n + self.quiet);
        for (evidence, product) in evidence.iter_mut().zip(products) {
            *evidence += weight * product;
        }
        evidence[PAIRS.len()] += n;
    }
}

struct Decide<'a> {
    evidence: Pixels<'a>,
}

impl<'a> Kernel for Decide<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut shares: BandMut<'a>) {
        let mut mean = [0.0; CHANNELS];
        for y in rows {
            for x in 0..self.evidence.size.width {
                average(self.evidence, x, y, &mut mean);
                for (c, share) in mixture(&mean).into_iter().enumerate() {
                    shares.row(c, y)[x] = share;
                }
            }
        }
    }
}

/// λ and g.
#[inline(always)]
fn mixture(evidence: &[f32; CHANNELS]) -> [f32; SHARES] {
    let [yy, yp, yq, pp, pq, qq, ya, pa, aa, yb, pb, bb, ab, n] = *evidence;
    if !(n >= MIN_COMPARISONS) {
        return [0.0; SHARES];
    }
    let third = larger(yq, LEAST * (yy * qq).sqrt());
    let [signal, per] = if yp > 0.0 && pq > 0.0 && third > 0.0 {
        let signal = smaller(yp * pq / third, pp);
        [signal, signal / yp]
    } else {
        // No detail lasts: all of it is noise.
        [0.0; 2]
    };
    let noise = pp - signal;

    let gain = bb - aa - 2.0 * (yb - ya) * per;
    let apart = aa + bb - 2.0 * ab;
    let first = saturate(0.5 + 0.5 * gain / apart);

    let mix = |a: f32, b: f32| b + first * (a - b);
    let (ym, pm) = (mix(ya, yb), mix(pa, pb));
    let mm = mix(mix(aa, ab), mix(ab, bb));
    let shared = smaller(larger(pm - ym * per, 0.0), 0.5 * noise);
    let second = saturate(1.0 - (noise - shared) / (mm - 2.0 * pm + pp));
    [first, second]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tile_whose_result_keeps_a_lamp_does_not_decide() {
        let size = Size {
            height: 128,
            width: 128,
        };
        // The second result is the signal, the first has a quarter of the samples' noise.
        let tile = [
            2.0, 1.0, 1.0, 2.0, 1.0, 2.0, 1.0, 1.0, 1.25, 1.0, 1.0, 1.0, 1.0, 64.0,
        ];
        let mut evidence = nothing(size);
        for record in evidence.data_mut().chunks_exact_mut(CHANNELS) {
            record.copy_from_slice(&tile);
        }
        assert!(share_of_all(&evidence)[0] < 1e-6);
        evidence.data_mut()[11] = 1e6;
        assert!(share_of_all(&evidence)[0] < 0.25);
    }
}
