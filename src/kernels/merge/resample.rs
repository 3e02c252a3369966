//! Resampling: an image's jittered samples on a grid of another size.
//!
//! Sample q of the image lies at q + offset. A pixel of the new grid, at x in the image's pixels, becomes
//!   Σ k(d.x) k(d.y) c / Σ k(d.x) k(d.y),  d = q + offset − x,
//! over the 4×4 samples around it, with k one of the filters of [`super::super::fetch`]: Lanczos with two lobes (as in
//! FSR 2), Catmull-Rom, or the tent of bilinear interpolation; "nearest" copies a sample. Deringing clamps the first
//! two to the range of the nearest 2×2 samples. The information that a frame has about a pixel depends on how near its
//! samples are:
//!   weight = Σ g(s·d.x) g(s·d.y),
//! with s the ratio of the new resolution to the image's and g the density of a normal distribution with standard
//! deviation 0.33: the weight is in samples per pixel, 1/s² on average (Karis 2014, *High Quality Temporal
//! Supersampling*, weights samples by a similar curve, twice as wide).
//!
//! Inputs: image of any channels, offset in its pixels. Outputs: image of the new size, weight (1). Missing samples do
//! not count ("nearest" copies them); NaN where the sum of the remaining filter weights is not positive. There is no
//! low-pass filter: downsampling aliases.

use std::ops::Range;

use crate::image::{Pixels, Run, SEGMENT, Size, segments};
use crate::kernels::fetch::footprint::{Filter, Wide};
use crate::math::{larger, smaller};
use crate::pixels::PixelsMut;
use crate::rows::{self, Kernel, Simd};

/// Names of the filters that serve here.
pub const FILTERS: [(&str, Filter); 4] = [
    ("nearest", Filter::Nearest),
    ("bilinear", Filter::Bilinear),
    ("catmull-rom", Filter::Wide(Wide::CatmullRom)),
    ("lanczos-2", Filter::Wide(Wide::Lanczos2)),
];

/// Standard deviation of g, in pixels of the new grid.
const DEVIATION: f64 = 0.33;

/// Taps along an axis, at −1, 0, 1 and 2 from the sample at or before the pixel.
const TAPS: usize = 4;

/// Precomputed taps along one axis, for every position of the new grid.
struct Axis {
    nearest: Vec<usize>,
    taps: Vec<Taps>,
}

#[derive(Clone, Copy)]
struct Taps {
    /// Sample indices, clamped to the image; taps outside have weight 0.
    at: [usize; TAPS],
    filter: [f32; TAPS],
    density: [f32; TAPS],
}

impl Axis {
    fn new(from: usize, to: usize, offset: f64, filter: Filter) -> Self {
        let scale = to as f64 / from as f64;
        let last = from as isize - 1;
        let peak = 1.0 / (DEVIATION * (2.0 * std::f64::consts::PI).sqrt());
        let taps = places(from, to, offset).map(|x| {
            let before = x.floor();
            let f = (x - before) as f32;
            let filter = match filter {
                Filter::Nearest | Filter::Bilinear => [0.0, 1.0 - f, f, 0.0],
                Filter::Wide(kernel) => {
                    let [along, [_, scale, ..]] = kernel.weights([f, 0.0]);
                    along.map(|weight| weight * scale)
                }
            };
            let tap = |k: usize| before as isize + k as isize - 1;
            let within = |k: usize, weight: f32| {
                if (0..=last).contains(&tap(k)) {
                    weight
                } else {
                    0.0
                }
            };
            Taps {
                at: std::array::from_fn(|k| tap(k).clamp(0, last) as usize),
                filter: std::array::from_fn(|k| within(k, filter[k])),
                density: std::array::from_fn(|k| {
                    let d = scale * (tap(k) as f64 - x) / DEVIATION;
                    within(k, (peak * libm::exp(-0.5 * d * d)) as f32)
                }),
            }
        });
        Self {
            nearest: nearest(from, to, offset),
            taps: taps.collect(),
        }
    }
}

/// Positions of the new grid's pixels along an axis, in units of samples from the first.
fn places(from: usize, to: usize, offset: f64) -> impl Iterator<Item = f64> {
    let (from, count) = (from as f64, to as f64);
    (0..to).map(move |i| (i as f64 + 0.5) * from / count - 0.5 - offset)
}

/// The nearest sample to each position of an axis.
pub(crate) fn nearest(from: usize, to: usize, offset: f64) -> Vec<usize> {
    places(from, to, offset)
        .map(|x| ((x + 0.5).floor().max(0.0) as usize).min(from - 1))
        .collect()
}

/// Writes the image resampled to `size`, and its weights.
pub fn resample<'a>(
    image: Pixels<'a>,
    size: Size,
    offset: [f64; 2],
    filter: Filter,
    dering: bool,
    resampled: impl Iterator<Item = PixelsMut<'a>>,
    weights: impl Iterator<Item = PixelsMut<'a>>,
) {
    let kernel = Resample {
        image,
        size,
        filter,
        dering: dering && matches!(filter, Filter::Wide(_)),
        columns: Axis::new(image.size.width, size.width, offset[0], filter),
        rows: Axis::new(image.size.height, size.height, offset[1], filter),
    };
    rows::run(&kernel, size.height, resampled.zip(weights));
}

struct Resample<'a> {
    image: Pixels<'a>,
    size: Size,
    filter: Filter,
    dering: bool,
    columns: Axis,
    rows: Axis,
}

/// Ring buffer of image rows: planar channels, 0 where missing, then validity, 1 or 0.
struct CachedRows {
    rows: [Option<usize>; TAPS],
    data: [Vec<Vec<f32>>; TAPS],
}

impl CachedRows {
    fn new(image: &Pixels) -> Self {
        let row = || vec![vec![0.0; image.size.width]; image.channels + 1];
        Self {
            rows: [None; TAPS],
            data: [row(), row(), row(), row()],
        }
    }

    /// Reads a row unless it is cached.
    #[inline(always)]
    fn load(&mut self, image: &Pixels, y: usize) {
        let place = y % TAPS;
        if self.rows[place].replace(y) == Some(y) {
            return;
        }
        let (here, channels) = self.data[place].split_last_mut().expect("at least one");
        here.fill(1.0);
        let run = Run::row(y, image.size.width);
        for (channel, row) in channels.iter_mut().enumerate() {
            image.load(run, channel, row);
            for (here, value) in here.iter_mut().zip(&*row) {
                *here = if value.is_finite() { *here } else { 0.0 };
            }
        }
        for row in channels {
            for (value, &here) in row.iter_mut().zip(&*here) {
                *value = if here > 0.0 { *value } else { 0.0 };
            }
        }
    }

    #[inline(always)]
    fn row(&self, y: usize) -> &[Vec<f32>] {
        &self.data[y % TAPS]
    }
}

impl<'a> Kernel for Resample<'a> {
    type Out = (PixelsMut<'a>, PixelsMut<'a>);

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, (mut resampled, mut weights): Self::Out) {
        let Pixels { size, channels, .. } = self.image;
        let mut cached = CachedRows::new(&self.image);
        let row = || vec![0.0; size.width];
        // Per input column, over the taps of this output row: filtered channels, sum of filter weights, density, and the
        // range of the two nearest rows.
        let mut sums = vec![row(); channels + 1];
        let mut density = row();
        let (mut lows, mut highs) = (vec![row(); channels], vec![row(); channels]);
        let mut out = vec![vec![0.0; SEGMENT]; channels];
        let mut weight = [0.0; SEGMENT];
        for y in rows {
            let taps = &self.rows.taps[y];
            for (k, &at) in taps.at.iter().enumerate() {
                cached.load(&self.image, at);
                let (filter, dense) = (taps.filter[k], taps.density[k]);
                for (sum, row) in sums.iter_mut().zip(cached.row(at)) {
                    add(sum, filter, row, k == 0);
                }
                add(&mut density, dense, &cached.row(at)[channels], k == 0);
            }
            if self.dering {
                for c in 0..channels {
                    let [above, below] = [1, 2].map(|k| {
                        let rows = cached.row(taps.at[k]);
                        (&rows[c], &rows[channels])
                    });
                    range(above, below, &mut lows[c], &mut highs[c]);
                }
            }
            for run in segments(y, self.size.width) {
                let columns = &self.columns.taps[run.x..][..run.len];
                for (i, taps) in columns.iter().enumerate() {
                    weight[i] = across(&density, &taps.at, &taps.density);
                    let total = across(&sums[channels], &taps.at, &taps.filter);
                    for c in 0..channels {
                        let mean = across(&sums[c], &taps.at, &taps.filter) / total;
                        let mut value = if total > 1e-6 { mean } else { f32::NAN };
                        if self.dering {
                            let [left, right] = [taps.at[1], taps.at[2]];
                            let low = smaller(lows[c][left], lows[c][right]);
                            let high = larger(highs[c][left], highs[c][right]);
                            // With all of the 2×2 missing, the range is empty and does not clamp.
                            let clamped = larger(smaller(value, high), low);
                            value = if (low <= high) & !value.is_nan() {
                                clamped
                            } else {
                                value
                            };
                        }
                        out[c][i] = value;
                    }
                }
                if self.filter == Filter::Nearest {
                    let start = self.rows.nearest[y] * size.width;
                    let columns = &self.columns.nearest[run.x..][..run.len];
                    for (c, out) in out.iter_mut().enumerate() {
                        for (value, x) in out.iter_mut().zip(columns) {
                            *value = self.image.at(start + x, c);
                        }
                    }
                }
                resampled.write(run, out.iter().map(Vec::as_slice));
                weights.write(run, [&weight[..]]);
            }
        }
    }
}

/// Adds a weighted row to a sum; the first one overwrites it.
#[inline(always)]
fn add(sum: &mut [f32], weight: f32, row: &[f32], first: bool) {
    for (sum, value) in sum.iter_mut().zip(row) {
        let before = if first { 0.0 } else { *sum };
        *sum = before + weight * value;
    }
}

#[inline(always)]
fn across(row: &[f32], at: &[usize; TAPS], weights: &[f32; TAPS]) -> f32 {
    let mut sum = 0.0;
    for k in 0..TAPS {
        sum += weights[k] * row[at[k]];
    }
    sum
}

/// Minimum and maximum of two rows' valid samples.
#[inline(always)]
fn range(
    (above, here): (&Vec<f32>, &Vec<f32>),
    (below, there): (&Vec<f32>, &Vec<f32>),
    low: &mut [f32],
    high: &mut [f32],
) {
    for x in 0..low.len() {
        let one = |value: f32, present: f32, none: f32| if present > 0.0 { value } else { none };
        let least = |value, present| one(value, present, f32::INFINITY);
        let most = |value, present| one(value, present, f32::NEG_INFINITY);
        low[x] = smaller(least(above[x], here[x]), least(below[x], there[x]));
        high[x] = larger(most(above[x], here[x]), most(below[x], there[x]));
    }
}
