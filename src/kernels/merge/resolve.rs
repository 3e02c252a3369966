//! Resolve: jittered samples of several frames, reconstructed to one image.
//!
//! The sample that frame n took for pixel q lies at q + offset(n). Pixel p becomes the supersampling sum
//!   Σ f(d.x) f(d.y) c / Σ f(d.x) f(d.y),  d = q + offset(n) − p,
//! over all samples within the reach of the filter f:
//! - **box**: 1 for −½ ≤ d < ½: the pixel's own samples, equally;
//! - **tent**: 1 − |d|;
//! - **blackman-harris**: the four-term window of that name, 3.3 pixels wide (Karis 2014, *High Quality Temporal
//!   Supersampling*);
//! - **mitchell**: the cubic with B = C = ⅓ (Mitchell and Netravali 1988, *Reconstruction Filters in Computer Graphics*).
//!
//! Inputs: images of any channels, and an offset in pixels for each. Output: one image. Missing samples do not count;
//! NaN where the weights that do are not positive in sum.

use std::ops::Range;

use crate::image::{BandMut, Image, Pixels, Run, SEGMENT, Size, segments};
use crate::pixels::{Columns, LANES, Rolling, lanes};
use crate::rows::{self, BAND, Kernel};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filter {
    Box,
    Tent,
    BlackmanHarris,
    Mitchell,
}

/// Pixels to each side that the widest filter reaches with offsets of up to half a pixel.
const REACH: usize = 2;

/// So many of them, then.
const WINDOW: usize = 2 * REACH + 1;

impl Filter {
    pub const NAMES: [(&str, Self); 4] = [
        ("box", Self::Box),
        ("tent", Self::Tent),
        ("blackman-harris", Self::BlackmanHarris),
        ("mitchell", Self::Mitchell),
    ];

    fn weight(self, d: f64) -> f64 {
        let x = d.abs();
        match self {
            Self::Box => f64::from((-0.5..0.5).contains(&d)),
            Self::Tent => (1.0 - x).max(0.0),
            Self::BlackmanHarris if x >= 1.65 => 0.0,
            Self::BlackmanHarris => {
                let angle = std::f64::consts::PI * (x / 1.65 + 1.0);
                let term = |a: f64, k: f64| a * libm::cos(k * angle);
                0.35875 - term(0.48829, 1.0) + term(0.14128, 2.0) - term(0.01168, 3.0)
            }
            Self::Mitchell if x >= 2.0 => 0.0,
            Self::Mitchell if x < 1.0 => (7.0 * x * x * x - 12.0 * x * x + 16.0 / 3.0) / 6.0,
            Self::Mitchell => (-7.0 / 3.0 * x * x * x + 12.0 * x * x - 20.0 * x + 32.0 / 3.0) / 6.0,
        }
    }
}

/// Reconstructs samples that come one image at a time.
pub struct Resolve {
    filter: Filter,
    /// Weighted sums of the channels, and of the weights.
    sums: Image,
    channels: usize,
}

impl Resolve {
    pub fn new(size: Size, channels: usize, filter: Filter) -> Self {
        Self {
            filter,
            sums: Image::new(size, channels + 1),
            channels,
        }
    }

    /// Adds a frame whose samples lie `offset` beside their pixels' centres, by at most half a pixel. Returns how many are
    /// missing.
    pub fn add(&mut self, samples: Pixels, offset: [f64; 2]) -> usize {
        let size = self.sums.size;
        let weights = offset.map(|d| {
            std::array::from_fn(|i| self.filter.weight(i as f64 - REACH as f64 + d) as f32)
        });
        let mut missing = vec![0; size.height.div_ceil(BAND)];
        let outs = self.sums.bands().zip(&mut missing);
        rows::run(&Add { samples, weights }, size.height, outs);
        missing.iter().sum()
    }

    pub fn finish(self) -> Image {
        let mut image = Image::new(self.sums.size, self.channels);
        rows::run(
            &Divide { sums: &self.sums },
            image.size.height,
            image.bands(),
        );
        image
    }
}

struct Add<'a> {
    samples: Pixels<'a>,
    /// Along x and y, for pixels from −[`REACH`] to [`REACH`].
    weights: [[f32; WINDOW]; 2],
}

impl<'a> Kernel for Add<'a> {
    type Out = (BandMut<'a>, &'a mut usize);

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, (mut sums, missing): Self::Out) {
        let size = self.samples.size;
        let channels = self.samples.channels;
        // Samples, 0 where missing, and whether they are there, 1 or 0.
        let mut around: Vec<_> = (0..=channels)
            .map(|_| Rolling::<1>::new(size.width, REACH))
            .collect();
        for y in rows.clone() {
            let (here, around_samples) = around.split_last_mut().expect("at least one");
            for due in here.due(y, y == rows.start) {
                let there = self.load(due, around_samples, here);
                if rows.contains(&(due as usize)) {
                    *missing += size.width - there;
                }
            }
            for run in segments(y, size.width) {
                for (channel, around) in around.iter().enumerate() {
                    let sums = &mut sums.row(channel, y)[run.x..][..run.len];
                    self.add(around, run, sums);
                }
            }
        }
    }
}

impl Add<'_> {
    /// Reads a row, and returns how many of its samples are there.
    #[inline(always)]
    fn load(&self, y: isize, samples: &mut [Rolling<1>], here: &mut Rolling<1>) -> usize {
        let size = self.samples.size;
        let [here] = here.row_mut(y);
        here.fill(1.0);
        for (channel, samples) in samples.iter_mut().enumerate() {
            if let Some([row]) = samples.fresh(y, size) {
                for run in segments(y as usize, size.width) {
                    let row = &mut row[run.x..][..run.len];
                    self.samples.load(run, channel, row);
                }
            }
            let [row] = samples.row(y);
            for (here, sample) in here.iter_mut().zip(row) {
                *here = if sample.is_finite() { *here } else { 0.0 };
            }
        }
        for samples in samples {
            let [row] = samples.row_mut(y);
            for (sample, &here) in row.iter_mut().zip(&*here) {
                *sample = if here > 0.0 { *sample } else { 0.0 };
            }
        }
        here.iter().filter(|&&here| here > 0.0).count()
    }

    /// Adds the weighted samples around a run: down the columns first.
    #[inline(always)]
    fn add(&self, around: &Rolling<1>, run: Run, sums: &mut [f32]) {
        let [along, down] = self.weights;
        let rows: [&Columns; WINDOW] =
            std::array::from_fn(|i| around.columns(run, i as isize - REACH as isize)[0]);
        let mut columns: Columns = [0.0; _];
        for i in 0..lanes(run) + LANES {
            let mut sum = 0.0;
            for (row, weight) in rows.into_iter().zip(down) {
                sum += weight * row[i];
            }
            columns[i] = sum;
        }
        for i in 0..sums.len().min(SEGMENT) {
            for (dx, weight) in along.into_iter().enumerate() {
                sums[i] += weight * columns[i + dx];
            }
        }
    }
}

struct Divide<'a> {
    sums: &'a Image,
}

impl<'a> Kernel for Divide<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: BandMut<'a>) {
        let channels = self.sums.channels - 1;
        for y in rows {
            let weights = self.sums.view().row(channels, y);
            for channel in 0..channels {
                let sums = self.sums.view().row(channel, y);
                for ((out, &sum), &weight) in out.row(channel, y).iter_mut().zip(sums).zip(weights)
                {
                    // Where negative lobes outweigh the rest, nothing sensible is left.
                    *out = if weight > 1e-6 {
                        sum / weight
                    } else {
                        f32::NAN
                    };
                }
            }
        }
    }
}
