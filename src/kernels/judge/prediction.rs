//! How much better one history predicts the new sample than another, measured without a reference.
//!
//! A new sample c is an unbiased estimate of the reference, independent of all history. For two predictions k and h,
//!   (k − c)² − (h − c)² = (k − h)(k + h − 2c)
//! equals, on average over c's noise, the difference of their true squared errors: it is linear in c, so that noise
//! averages out; a tone curve or a clamp would leave a bias. Relative to brightness and averaged over the neighbours of the
//! same object,
//!   d = mean of Σ (k − h)(k + h − 2c) / (Σ h² + 0.01),  sums over the channels:
//! negative where k is better. The standardized gain tells whether d is more than chance. It is Student's t with a standard
//! error of at least 0.01, so that differences too small to be seen do not count, however certain they are:
//!   t = d / √(s² / n + 0.01²),  s² the variance of the n terms in the window.
//!
//! Inputs: k (3), h (3), c (3), ids (1), optional. Output: d or t (1); 0 where nothing is known.

use std::ops::Range;

use crate::image::{BandMut, Pixels, Run, SEGMENT, Size, segments};
use crate::lanes::{Classes, Lanes};
use crate::pixels::{Rolling, Row};
use crate::rows::{self, Kernel, Simd};

/// The offset of relMSE, which bounds the weight of dark pixels.
const EPSILON: f32 = 0.01;

/// The standard error below which gains count as equally certain, squared.
const CERTAIN: f32 = 1e-4;
/// Most pixels of the window to each side.
pub const MOST: usize = 16;

/// Writes d of a candidate k against the base h, or t if it is to be standardized; `radius` is that of the window, 0 to
/// [`MOST`] pixels.
pub fn prediction_gain<'a>(
    candidate: Pixels<'a>,
    base: Pixels<'a>,
    color: Pixels<'a>,
    ids: Option<Pixels<'a, u32>>,
    radius: usize,
    standardized: bool,
    gain: impl Iterator<Item = BandMut<'a>>,
) {
    let kernel = Gain {
        images: [candidate, base, color],
        ids,
        radius,
        standardized,
    };
    rows::run(&kernel, color.size.height, gain);
}

/// d of single pixels before averaging; not finite where an input is missing.
#[inline(always)]
pub(crate) fn terms(
    candidate: [&[f32]; 3],
    base: [&[f32]; 3],
    color: [&[f32]; 3],
    terms: &mut [f32],
) {
    let len = terms.len();
    let [k, h, c] = [candidate, base, color].map(|image| image.map(|row| &row[..len]));
    for i in 0..len {
        let (mut term, mut size) = (0.0, EPSILON);
        for channel in 0..3 {
            let (k, h, c) = (k[channel][i], h[channel][i], c[channel][i]);
            term += (k - h) * (k + h - 2.0 * c);
            size += h * h;
        }
        terms[i] = term / size;
    }
}

/// Sliding window of ids, over every n-th row of an image.
pub(crate) struct Ids<'a> {
    ids: Option<Pixels<'a, u32>>,
    every: usize,
    rows: Rolling<1, u32>,
}

impl<'a> Ids<'a> {
    /// Without ids, all pixels count as one object.
    pub fn new(ids: Option<Pixels<'a, u32>>, width: usize, radius: usize, every: usize) -> Self {
        Self {
            ids,
            every,
            rows: Rolling::within(width, radius, 0),
        }
    }

    /// Centres the window on row `y`: the row after the previous call's, unless `first`.
    #[inline(always)]
    pub fn roll(&mut self, y: usize, first: bool) {
        let Some(ids) = self.ids else { return };
        let Size { height, width } = ids.size;
        let height = height.div_ceil(self.every);
        for y in self.rows.due(y, first) {
            if let Some([row]) = self.rows.fresh(y, Size { height, width }) {
                ids.load(Run::row(y as usize * self.every, width), 0, row);
            }
        }
    }
}

/// The gains of a run.
pub(crate) struct Gains {
    pub mean: Row,
    pub standardized: Row,
}

impl Gains {
    pub fn zeroed() -> Self {
        Self {
            mean: [0.0; SEGMENT],
            standardized: [0.0; SEGMENT],
        }
    }
}

/// Averages the terms over each pixel's window, same object only: 0 where no term is finite, and standardized where fewer than
/// two are or their variance overflows.
#[inline(always)]
pub(crate) fn average<S: Simd>(
    simd: S,
    run: Run,
    height: usize,
    terms: &Rolling<1>,
    ids: &Ids,
    gains: &mut Gains,
) {
    let (y, radius) = (run.y as isize, terms.radius as isize);
    let [own] = ids.rows.row(y);
    for start in (0..run.len).step_by(Lanes::<S>::COUNT) {
        let x = run.x + start;
        let own = Classes::load(simd, own, x + terms.radius);
        let [mut sum, mut squares, mut count] = [Lanes::splat(simd, 0.0); 3];
        for y in (y - radius).max(0)..=(y + radius).min(height as isize - 1) {
            let ([terms], [ids]) = (terms.row(y), ids.rows.row(y));
            for dx in 0..=2 * radius as usize {
                let term = Lanes::load(simd, terms, x + dx);
                let alike = own.equal(Classes::load(simd, ids, x + dx));
                let counts = alike.and(term.is_finite());
                let term = term.when_or(counts, -0.0);
                sum = sum + term;
                squares = squares + term * term;
                count = count + Lanes::splat(simd, 1.0).when_or(counts, 0.0);
            }
        }
        let mean = sum / count;
        let spread = squares - mean * sum;
        let spread = spread.when_or(spread.above(0.0), 0.0);
        let variance = spread / (count * (count - Lanes::splat(simd, 1.0)));
        let known = count.above(1.0).and(squares.is_finite());
        let t = mean / (variance + Lanes::splat(simd, CERTAIN)).sqrt();
        mean.when_or(count.above(0.0), 0.0)
            .store(&mut gains.mean, start);
        t.when_or(known, 0.0).store(&mut gains.standardized, start);
    }
}

struct Gain<'a> {
    /// k, h and c.
    images: [Pixels<'a>; 3],
    ids: Option<Pixels<'a, u32>>,
    radius: usize,
    standardized: bool,
}

impl<'a> Kernel for Gain<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, simd: S, rows: Range<usize>, mut out: BandMut<'a>) {
        let size = self.images[0].size;
        let mut ids = Ids::new(self.ids, size.width, self.radius, 1);
        let mut around = Rolling::new(size.width, self.radius);
        let mut colors = [[[0.0; SEGMENT]; 3]; 3];
        let mut gains = Gains::zeroed();
        for (nth, y) in rows.enumerate() {
            ids.roll(y, nth == 0);
            for y in around.due(y, nth == 0) {
                let Some([row]) = around.fresh(y, size) else {
                    continue;
                };
                for run in segments(y as usize, size.width) {
                    for (image, rows) in self.images.iter().zip(&mut colors) {
                        image.read_rows(run, rows);
                    }
                    let [k, h, c] = colors
                        .each_ref()
                        .map(|rows| rows.each_ref().map(Row::as_slice));
                    terms(k, h, c, &mut row[run.x..][..run.len]);
                }
            }
            for run in segments(y, size.width) {
                average(simd, run, size.height, &around, &ids, &mut gains);
                let gain = if self.standardized {
                    &gains.standardized
                } else {
                    &gains.mean
                };
                out.put(run, gain);
            }
        }
    }
}
