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

use crate::image::{BandMut, Image, Pixels, Run, SEGMENT, Size, Tap, segments};
use crate::rows::{self, BAND, Kernel};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filter {
    Box,
    Tent,
    BlackmanHarris,
    Mitchell,
}

/// Pixels to each side that the widest filter reaches with offsets of up to half a pixel.
const REACH: isize = 2;

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
        let mut present = Image::new(size, self.channels + 1);
        let mut missing = vec![0; size.height.div_ceil(BAND)];
        let outs = present.bands().zip(&mut missing);
        rows::run(&Present { samples }, size.height, outs);
        let weights = offset
            .map(|d| std::array::from_fn(|i| self.filter.weight(i as f64 - REACH as f64 + d)));
        let kernel = Add {
            samples: &present,
            weights,
        };
        rows::run(&kernel, size.height, self.sums.bands());
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

/// Samples with 0 where missing, and whether they are there (1 or 0) as last channel.
struct Present<'a> {
    samples: Pixels<'a>,
}

impl<'a> Kernel for Present<'a> {
    type Out = (BandMut<'a>, &'a mut usize);

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, (mut out, missing): Self::Out) {
        let channels = self.samples.channels;
        for run in rows.flat_map(|y| segments(y, self.samples.size.width)) {
            let mut here = [1.0; SEGMENT];
            for channel in 0..channels {
                let out = &mut out.row(channel, run.y)[run.x..][..run.len];
                self.samples.load(run, channel, out);
                for (here, sample) in here.iter_mut().zip(out) {
                    *here = if sample.is_finite() { *here } else { 0.0 };
                }
            }
            for channel in 0..channels {
                let out = &mut out.row(channel, run.y)[run.x..][..run.len];
                for (out, here) in out.iter_mut().zip(here) {
                    *out = if here > 0.0 { *out } else { 0.0 };
                }
            }
            let here = &here[..run.len];
            out.row(channels, run.y)[run.x..][..run.len].copy_from_slice(here);
            *missing += here.iter().filter(|&&here| here == 0.0).count();
        }
    }
}

struct Add<'a> {
    samples: &'a Image,
    /// Along x and y, for pixels from −[`REACH`] to [`REACH`].
    weights: [[f64; 2 * REACH as usize + 1]; 2],
}

impl<'a> Kernel for Add<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut sums: BandMut<'a>) {
        let size = self.samples.size;
        let along = || (-REACH..=REACH).enumerate();
        for y in rows {
            for (j, dy) in along() {
                for (i, dx) in along() {
                    let weight = (self.weights[0][i] * self.weights[1][j]) as f32;
                    let tap = Tap { dx, dy, step: 1 };
                    let row = Run {
                        y,
                        x: 0,
                        len: size.width,
                    };
                    if weight != 0.0
                        && let Some(here) = tap.inside(row, size)
                    {
                        self.add(weight, here, tap.of(here), &mut sums);
                    }
                }
            }
        }
    }
}

impl Add<'_> {
    #[inline(always)]
    fn add(&self, weight: f32, here: Run, there: Run, sums: &mut BandMut) {
        for channel in 0..self.samples.channels {
            let samples = &self.samples.view().row(channel, there.y)[there.x..][..there.len];
            let sums = &mut sums.row(channel, here.y)[here.x..][..here.len];
            for (sum, &sample) in sums.iter_mut().zip(samples) {
                *sum += weight * sample;
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
