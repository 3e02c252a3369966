//! Resolve: jittered samples of several frames, reconstructed to one image.
//!
//! The sample that frame n took for pixel q lies at q + offset(n). Pixel p becomes the supersampling sum
//!   Σ f(d.x) f(d.y) c / Σ f(d.x) f(d.y),  d = q + offset(n) − p,
//! over all samples within the reach of the filter f:
//! - **box**: 1 for −½ ≤ d < ½: the pixel's own samples, equally;
//! - **tent**: 1 − |d|;
//! - **blackman-harris**: the four-term window of that name, 3.3 pixels wide (Karis 2014, *High Quality Temporal
//!   Supersampling*);
//! - **mitchell**: the cubic with B = C = ⅓ (Mitchell and Netravali 1988, *Reconstruction Filters in Computer
//!   Graphics*).
//!
//! Inputs: images of any channels, and an offset in pixels for each. Output: one image. Missing samples do not count;
//! NaN where the sum of the remaining weights is not positive.

use std::ops::Range;

use crate::error::{Error, Result};
use crate::image::{Pixels, Run, SEGMENT, segments};
use crate::lanes::LANES;
use crate::pixels::{Columns, PixelsMut, Rolling, lanes};
use crate::rows::{self, BAND, Kernel, Simd};

/// How samples weigh by their distance from the pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filter {
    /// The pixel itself.
    Box,
    /// Linear, two pixels wide.
    Tent,
    /// A window like a Gaussian, 3.3 pixels wide.
    BlackmanHarris,
    /// The cubic of Mitchell and Netravali, four pixels wide.
    Mitchell,
}

/// Radius of the widest filter in pixels, for offsets of up to half a pixel.
const REACH: usize = 2;

/// Taps along an axis.
const WINDOW: usize = 2 * REACH + 1;

impl Filter {
    /// Their names.
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

/// Whether samples may lie so far, right and down, beside their pixels' centres.
pub fn check(offset: [f64; 2]) -> Result<()> {
    if offset.iter().all(|d| d.abs() <= 0.5) {
        return Ok(());
    }
    let got = format!("{offset:?}");
    Err(Error::value("offsets", "pixels from -0.5 to 0.5", got))
}

/// Reconstructs one image from frames and their jitter offsets, at most half a pixel. Returns the number of missing
/// samples.
pub fn resolve<'a>(
    frames: &'a [(Pixels<'a>, [f64; 2])],
    filter: Filter,
    image: impl Iterator<Item = PixelsMut<'a>>,
) -> usize {
    let height = frames[0].0.size.height;
    let frames = frames.iter().map(|&(samples, offset)| Frame {
        samples,
        weights: offset
            .map(|d| std::array::from_fn(|i| filter.weight(i as f64 - REACH as f64 + d) as f32)),
    });
    let kernel = Resolve {
        frames: frames.collect(),
    };
    let mut missing = vec![0; rows::bands(height).count()];
    let outs = image
        .zip(&mut missing)
        .map(|(image, missing)| Outs { image, missing });
    let jobs = rows::tall_jobs(height, REACH, outs);
    rows::run_jobs(&kernel, jobs);
    drop(kernel);
    missing.iter().sum()
}

struct Resolve<'a> {
    frames: Vec<Frame<'a>>,
}

struct Frame<'a> {
    samples: Pixels<'a>,
    /// Filter weights along x and y, for taps from −[`REACH`] to [`REACH`].
    weights: [[f32; WINDOW]; 2],
}

struct Outs<'a> {
    image: PixelsMut<'a>,
    missing: &'a mut usize,
}

impl<'a> Kernel for Resolve<'a> {
    type Out = Vec<Outs<'a>>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, outs: Self::Out) {
        let Pixels { size, channels, .. } = self.frames[0].samples;
        // Planar: weighted sums of the channels, then the sum of weights.
        let mut sums = vec![0.0; (channels + 1) * BAND * size.width];
        // One sliding window per channel, 0 where missing, then one of validity, 1 or 0.
        let mut around: Vec<_> = (0..=channels)
            .map(|_| Rolling::<1>::new(size.width, REACH))
            .collect();
        for (top, out) in rows.clone().step_by(BAND).zip(outs) {
            let rows = top..(top + BAND).min(rows.end);
            sums.fill(0.0);
            for frame in &self.frames {
                *out.missing += frame.add(&rows, &mut around, &mut sums);
            }
            let mut image = out.image;
            for run in rows.flat_map(|y| segments(y, size.width)) {
                let start = (run.y - top) * size.width + run.x;
                let parts = sums.chunks_exact_mut(BAND * size.width);
                let mut parts: Vec<_> = parts.map(|sums| &mut sums[start..][..run.len]).collect();
                let (weights, parts) = parts.split_last_mut().expect("at least one");
                for part in &mut *parts {
                    for (sum, &weight) in part.iter_mut().zip(&**weights) {
                        // Negative lobes may cancel the rest: division by a tiny sum would amplify noise.
                        let mean = *sum / weight;
                        *sum = if weight > 1e-6 { mean } else { f32::NAN };
                    }
                }
                image.write(run, parts.iter().map(|part| &**part));
            }
        }
    }
}

impl Frame<'_> {
    /// Adds this frame's weighted samples to a band; returns the number of missing samples in the band.
    #[inline(always)]
    fn add(&self, rows: &Range<usize>, around: &mut [Rolling<1>], sums: &mut [f32]) -> usize {
        let width = self.samples.size.width;
        let mut missing = 0;
        for y in rows.clone() {
            let (here, samples) = around.split_last_mut().expect("at least one");
            for due in here.due(y, y == rows.start) {
                let there = self.load(due, samples, here);
                if rows.contains(&(due as usize)) {
                    missing += width - there;
                }
            }
            for run in segments(y, width) {
                let start = (y - rows.start) * width + run.x;
                for (around, sums) in around.iter().zip(sums.chunks_exact_mut(BAND * width)) {
                    self.add_run(around, run, &mut sums[start..][..run.len]);
                }
            }
        }
        missing
    }

    /// Reads a row into the windows; returns the number of valid samples.
    #[inline(always)]
    fn load(&self, y: isize, samples: &mut [Rolling<1>], here: &mut Rolling<1>) -> usize {
        let size = self.samples.size;
        let mut rows: Vec<_> = (samples.iter_mut())
            .filter_map(|samples| samples.fresh(y, size))
            .map(|[row]| row)
            .collect();
        if let [r, g, b] = &mut rows[..] {
            self.samples
                .read(Run::row(y as usize, size.width), [r, g, b]);
        } else {
            for (channel, row) in rows.into_iter().enumerate() {
                let run = Run::row(y as usize, size.width);
                self.samples.load(run, channel, row);
            }
        }
        let [here] = here.row_mut(y);
        here.fill(1.0);
        for samples in &*samples {
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

    /// Adds a span's weighted samples; separable, columns first.
    #[inline(always)]
    fn add_run(&self, around: &Rolling<1>, run: Run, sums: &mut [f32]) {
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
