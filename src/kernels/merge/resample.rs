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
    at: [u32; TAPS],
    filter: [f32; TAPS],
    density: [f32; TAPS],
}

impl Axis {
    fn new(from: usize, to: usize, offset: f64, filter: Filter) -> Self {
        let scale = to as f64 / from as f64;
        let last = from as isize - 1;
        let peak = 1.0 / (DEVIATION * (2.0 * std::f64::consts::PI).sqrt());
        let taps = places(from, to, offset).map(|x| {
            // Just before a sample, the distance from the sample before rounds to 1. It counts as none from the next one,
            // where the weights are exact.
            let (before, f) = match (x - x.floor()) as f32 {
                1.0 => (x.floor() + 1.0, 0.0),
                f => (x.floor(), f),
            };
            let filter = match filter {
                Filter::Nearest | Filter::Bilinear => [0.0, 1.0 - f, f, 0.0],
                Filter::Wide(kernel) => {
                    let [along, [_, scale, ..]] = kernel.weights([f, 0.0]);
                    along.map(|weight| weight * scale)
                }
            };
            let tap = |k: usize| (before as isize).saturating_add(k as isize - 1); // offsets may be huge
            let within = |k: usize, weight: f32| {
                if (0..=last).contains(&tap(k)) {
                    weight
                } else {
                    0.0
                }
            };
            Taps {
                at: std::array::from_fn(|k| tap(k).clamp(0, last) as u32),
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

/// Elements of a [`Texel`].
const TEXEL: usize = 4;

/// Channels in a texel.
const CHANNELS: usize = TEXEL - 1;

/// Up to three channels of a sample and its validity, 1 or 0: taps are gathered and summed as one vector.
type Texel = [f32; TEXEL];

/// Ring buffer of image rows, as texels: all that hold the first three channels, then those of the next three.
struct CachedRows {
    rows: [Option<usize>; TAPS],
    data: [CachedRow; TAPS],
    /// One row of the image, planar: three channels and validity.
    planar: [Vec<f32>; TEXEL],
}

struct CachedRow {
    /// 0 where missing.
    texels: Vec<Texel>,
    /// The same with ±infinity where missing, which leaves minima and maxima as they are; empty without deringing.
    bounds: [Vec<Texel>; 2],
    present: Vec<f32>,
}

impl CachedRows {
    fn new(image: &Pixels, dering: bool) -> Self {
        let width = image.size.width;
        let len = image.channels.div_ceil(CHANNELS) * width;
        let texels = |len: usize| vec![[0.0; TEXEL]; len];
        let row = |_| CachedRow {
            texels: texels(len),
            bounds: [(); 2].map(|()| texels(if dering { len } else { 0 })),
            present: vec![0.0; width],
        };
        Self {
            rows: [None; TAPS],
            data: std::array::from_fn(row),
            planar: [(); TEXEL].map(|()| vec![0.0; width]),
        }
    }

    /// Reads a row unless it is cached.
    #[inline(always)]
    fn load(&mut self, image: &Pixels, y: usize) {
        let place = y % TAPS;
        if self.rows[place].replace(y) == Some(y) {
            return;
        }
        let CachedRow {
            texels,
            bounds: [lows, highs],
            present,
        } = &mut self.data[place];
        let width = image.size.width;
        let run = Run::row(y, width);
        present.fill(1.0);
        let scratch = &mut self.planar[0];
        for channel in 0..image.channels {
            image.load(run, channel, scratch);
            for (here, value) in present.iter_mut().zip(&*scratch) {
                *here = if value.is_finite() { *here } else { 0.0 };
            }
        }
        let [rows @ .., here] = &mut self.planar;
        here.copy_from_slice(present);
        for (first, start) in (0..image.channels)
            .step_by(CHANNELS)
            .zip((0..).step_by(width))
        {
            for (row, channel) in rows.iter_mut().zip(first..) {
                if channel < image.channels {
                    image.load(run, channel, row);
                } else {
                    row.fill(0.0);
                }
            }
            let planes = rows.each_ref().map(|row| &row[..width]);
            pack(planes, here, 0.0, &mut texels[start..][..width]);
            if !lows.is_empty() {
                pack(planes, here, f32::INFINITY, &mut lows[start..][..width]);
                pack(
                    planes,
                    here,
                    f32::NEG_INFINITY,
                    &mut highs[start..][..width],
                );
            }
        }
    }

    #[inline(always)]
    fn row(&self, y: usize) -> &CachedRow {
        &self.data[y % TAPS]
    }
}

/// Interleaves channels and validity; missing samples become `missing`.
#[inline(always)]
fn pack([a, b, c]: [&[f32]; CHANNELS], here: &[f32], missing: f32, out: &mut [Texel]) {
    let n = out.len();
    let (a, b, c, here) = (&a[..n], &b[..n], &c[..n], &here[..n]);
    for x in 0..n {
        let keep = |value: f32| if here[x] > 0.0 { value } else { missing };
        out[x] = [keep(a[x]), keep(b[x]), keep(c[x]), here[x]];
    }
}

impl<'a> Kernel for Resample<'a> {
    type Out = (PixelsMut<'a>, PixelsMut<'a>);

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, (mut resampled, mut weights): Self::Out) {
        let Pixels { size, channels, .. } = self.image;
        let mut cached = CachedRows::new(&self.image, self.dering);
        let groups = channels.div_ceil(CHANNELS);
        let texels = || vec![[0.0; TEXEL]; groups * size.width];
        // Per input column, over the taps of this output row: filtered channels with the sum of filter weights, density,
        // and the range of the two nearest rows.
        let mut sums = texels();
        let mut density = vec![0.0; size.width];
        let (mut lows, mut highs) = (texels(), texels());
        let mut ranged = None;
        let mut values = [[0.0; TEXEL]; SEGMENT];
        let mut out = vec![vec![0.0; SEGMENT]; channels];
        let mut weight = [0.0; SEGMENT];
        for y in rows {
            let taps = &self.rows.taps[y];
            let [_, above, below, _] = taps.at;
            for (k, at) in taps.at.iter().map(|&at| at as usize).enumerate() {
                cached.load(&self.image, at);
                let (filter, dense) = (taps.filter[k], taps.density[k]);
                let row = cached.row(at);
                let first = k == 0;
                add(
                    sums.as_flattened_mut(),
                    filter,
                    row.texels.as_flattened(),
                    first,
                );
                add(&mut density, dense, &row.present, first);
            }
            // On a finer grid, several rows in succession lie between the same two rows of the image.
            if self.dering && ranged.replace([above, below]) != Some([above, below]) {
                let [above, below] = [above, below].map(|y| &cached.row(y as usize).bounds);
                combine(&above[0], &below[0], smaller, &mut lows);
                combine(&above[1], &below[1], larger, &mut highs);
            }
            for run in segments(y, self.size.width) {
                let columns = &self.columns.taps[run.x..][..run.len];
                for (weight, taps) in weight.iter_mut().zip(columns) {
                    *weight = 0.0;
                    for k in 0..TAPS {
                        *weight += taps.density[k] * density[taps.at[k] as usize];
                    }
                }
                for (group, out) in out.chunks_mut(CHANNELS).enumerate() {
                    let columns_of = group * size.width..(group + 1) * size.width;
                    let sums = &sums[columns_of.clone()];
                    let range = [&lows[columns_of.clone()], &highs[columns_of]];
                    for (value, taps) in values.iter_mut().zip(columns) {
                        *value = across(sums, taps);
                        let total = value[CHANNELS];
                        for mean in value.iter_mut() {
                            *mean = if total > 1e-6 {
                                *mean / total
                            } else {
                                f32::NAN
                            };
                        }
                        if self.dering {
                            clamp(range, taps, value);
                        }
                    }
                    for (c, out) in out.iter_mut().enumerate() {
                        for (out, value) in out.iter_mut().zip(&values) {
                            *out = value[c];
                        }
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

/// The weighted sum of a pixel's taps in a row.
#[inline(always)]
fn across(row: &[Texel], taps: &Taps) -> Texel {
    let mut sum = [0.0; TEXEL];
    for k in 0..TAPS {
        let texel = row[taps.at[k] as usize];
        for c in 0..TEXEL {
            sum[c] += taps.filter[k] * texel[c];
        }
    }
    sum
}

/// Clamps to the range of the two nearest columns. With all of the 2×2 missing, the range is empty and does not clamp.
#[inline(always)]
fn clamp([lows, highs]: [&[Texel]; 2], taps: &Taps, value: &mut Texel) {
    let [_, left, right, _] = taps.at;
    let (left, right) = (left as usize, right as usize);
    let (low, high) = ([lows[left], lows[right]], [highs[left], highs[right]]);
    for c in 0..TEXEL {
        let (low, high) = (
            smaller(low[0][c], low[1][c]),
            larger(high[0][c], high[1][c]),
        );
        let clamped = larger(smaller(value[c], high), low);
        let clamps = (low <= high) & !value[c].is_nan();
        value[c] = if clamps { clamped } else { value[c] };
    }
}

/// Combines two rows element by element.
#[inline(always)]
fn combine(above: &[Texel], below: &[Texel], of: impl Fn(f32, f32) -> f32, out: &mut [Texel]) {
    let (above, below) = (above.as_flattened(), below.as_flattened());
    for ((out, &above), &below) in out.as_flattened_mut().iter_mut().zip(above).zip(below) {
        *out = of(above, below);
    }
}
