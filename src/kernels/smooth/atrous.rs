//! The edge-avoiding à-trous wavelet filter, guided by variance.
//!
//! Pass i averages the 5×5 taps at multiples of 2^i pixels, or the 3×3. A tap's weight is the spline kernel, cubic
//! {1, 2/3, 1/6} ⊗ {1, 2/3, 1/6} or linear {1, 1/2} ⊗ {1, 1/2}, times the guide's weight (see [`super::guide`]) times
//!   exp(−|l − l′| / (σ·√g + |l|/1000)),
//! with l the luminance and g the variance blurred by a 3×3 Gaussian (borders replicated): differences count in units
//! of the noise. Colour becomes Σwc/Σw and variance Σw²v/(Σw)², which is how it falls when independent samples are
//! averaged (Dammertz et al. 2010, *Edge-Avoiding À-Trous Wavelet Transform for fast Global Illumination Filtering*;
//! Schied et al. 2017, section 4.3). The term |l|/1000 bounds the division where there is no variance, and scales with
//! the image, so that exposure does not matter.
//!
//! Missing pixels have weight 0 as taps; a missing centre is filled from its neighbours without regard to luminance,
//! and stays NaN where it has none. All weights are one exp2, whose argument is collected row by row.
//!
//! **Prediction.** Weights that depend on a sample's noise keep some of it. With a prediction of the luminance that has
//! not seen the newest samples, l is the prediction's, and the passes filter it along with the colour by the same
//! weights. The results are predictions of the samples, too, by which [`crate::kernels::judge::choice`] compares the
//! passes. Pixels without a prediction have their own luminance instead.
//!
//! **Noise relative to light.** Without guides, or with depth alone, an edge within the window that estimates the variance
//! looks like noise, and light leaks into the dark beside it. If the number N of samples behind each pixel is given, √g is
//! therefore at most k·L/√N, where k = `relative_noise`, and L is the luminance of the unfiltered colour, blurred by the same
//! 3×3 Gaussian: the noise of one sample is taken to be at most k times the light around it. The price: rare bright samples
//! are noisier than that, and less of their noise is filtered.
//!
//! **Brighter taps.** Light from a lamp, or from one lucky sample, harms the dark around it more than a lack of dark harms the
//! lamp. Where an exposure e is given, the weight of a tap whose luminance l′ before the first pass is above the centre's l is
//! multiplied by ((e + l) / (e + l′))². Not for pixels of fewer samples than `settled`: their noise has yet to be averaged, and a
//! filter that prefers the dark would darken it. Karis 2013 (*Tone mapping*) weighs samples by 1 / (1 + l) to the same end.
//!
//! Inputs: colour (3), variance (1) of its luminance, prediction (1) and number of samples (1), both optional, guide. Outputs:
//! the first three.

mod pass;

use std::ops::Range;

use self::pass::Pass;
use super::guide::{Guide, Sigmas};
use super::variance::floored;
use crate::bordered::{Bordered, BorderedBand, Layout};
use crate::error::{Result, Whole, finite_from_0, in_range, whole};
use crate::image::{BandMut, Pixels, Run, SEGMENT, Size, plane_bands, segments};
use crate::math::{is_present, larger, luminance};
use crate::pixels::{Colors, PixelsMut, Row};
use crate::rows::{self, Kernel, Simd};

/// Passes, and what stops them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// Passes; 0 to 16; 5.
    pub iterations: u32,
    /// Taps to each side; 1 or 2; 2.
    pub radius: usize,
    /// Luminance difference that counts as one, in standard deviations; > 0; 4.
    pub sigma_luminance: f32,
    /// Most standard deviation of one sample, in multiples of the light around it, where the numbers of samples are given;
    /// > 0, +∞ included; 2.5.
    pub relative_noise: f32,
    /// Fewest samples of pixels whose brighter taps weigh less; 3.5. Not a whole number, so that rounding of resampled lengths
    /// does not decide.
    pub settled: f32,
    /// How far surfaces may differ.
    pub sigmas: Sigmas,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            iterations: 5,
            radius: 2,
            sigma_luminance: 4.0,
            relative_noise: 2.5,
            settled: 3.5,
            sigmas: Sigmas::default(),
        }
    }
}

impl Params {
    /// Most passes.
    pub const MOST: u32 = 16;

    /// A number of passes.
    pub(crate) fn iterations(value: impl Whole<u32>) -> Result<u32> {
        whole("iterations", value, "0 to 16 passes", |&n| n <= Self::MOST)
    }

    /// Taps to each side.
    pub(crate) fn radius(value: impl Whole<usize>) -> Result<usize> {
        whole("radius", value, "1 or 2 taps", |n| (1..=2).contains(n))
    }

    /// Pixels from the farthest tap to the centre.
    pub(crate) fn reach(&self) -> usize {
        (self.radius << self.iterations) / 2
    }

    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        Self::iterations(self.iterations)?;
        Self::radius(self.radius)?;
        in_range(
            "sigma_luminance",
            self.sigma_luminance,
            "a number above 0",
            |v| v > 0.0,
        )?;
        in_range(
            "relative_noise",
            self.relative_noise,
            "a number above 0",
            |v| v > 0.0,
        )?;
        finite_from_0("settled", self.settled)?;
        self.sigmas.check()
    }
}

/// Channels between passes: colour (0 to 2), the luminance that is compared (3), and variance (4 or 5). Missing pixels
/// and the padding are black with NaN for luminance, which makes their weight as taps zero.
const LUMINANCE: usize = 3;
/// Channels that a pass overwrites in place. Variance alternates between two (ping-pong), because its 3×3 blur reads rows
/// of other jobs.
const IN_PLACE: usize = 4;
const VARIANCES: [usize; 2] = [4, 5];

/// What is filtered.
#[derive(Clone, Copy)]
pub struct Source<'a> {
    /// 3 channels.
    pub color: Pixels<'a>,
    /// Of its luminance.
    pub variance: Pixels<'a>,
    /// Of its luminance, without the newest samples; NaN where there is none.
    pub prediction: Option<Pixels<'a>>,
    /// Samples that a pixel is the mean of, if they limit the noise that is expected.
    pub samples: Option<Pixels<'a>>,
    /// The light above which brighter taps weigh less, with `samples`; +∞ if they do not.
    pub exposure: f32,
}

/// Writes the filtered colour and variance, and the prediction if there is one.
pub fn atrous<'a>(
    source: Source,
    guide: &Guide,
    params: Params,
    filtered: impl Iterator<Item = PixelsMut<'a>>,
    filtered_variance: &mut [f32],
    filtered_prediction: Option<&mut [f32]>,
) {
    let size = source.color.size;
    let weighs = source.samples.is_some() && source.exposure.is_finite();
    let mut image = Filtered::new(guide.layout, source.prediction.is_some(), weighs);
    let settled = params.settled;
    rows::run(&Load { source, settled }, size.height, image.bands());
    if let Some(samples) = source.samples
        && params.relative_noise.is_finite()
    {
        image.limit(source.color, samples, params.relative_noise);
    }
    for iteration in 0..params.iterations {
        image.filter(guide, params, iteration, &(), std::iter::repeat(()));
    }
    let variances = plane_bands(filtered_variance, size);
    let predictions = filtered_prediction.map(|prediction| plane_bands(prediction, size));
    let outs = filtered.zip(variances).zip(rows::optional(predictions));
    let outs = outs.map(|((color, variance), prediction)| Outs {
        color,
        variance,
        prediction,
    });
    rows::run(&Unload { image: &image }, size.height, outs);
}

/// An image between passes.
pub(crate) struct Filtered {
    image: Bordered,
    /// Channels of the current variance and of the next pass's.
    variances: [usize; 2],
    /// Whether the luminance that is compared is a prediction's.
    predicted: bool,
    /// The most that the standard deviation may be, if it is limited.
    limits: Option<Bordered>,
    /// 1 / (e + l) of the unfiltered luminance l and the exposure e, +∞ of pixels of few samples; if brighter taps weigh less.
    tones: Option<Bordered>,
}

impl Filtered {
    /// `weighs` if brighter taps shall weigh less.
    pub fn new(layout: Layout, predicted: bool, weighs: bool) -> Self {
        let mut beyond = [0.0; IN_PLACE + VARIANCES.len()];
        beyond[LUMINANCE] = f32::NAN;
        Self {
            image: Bordered::new(layout, beyond),
            variances: VARIANCES,
            predicted,
            limits: None,
            tones: weighs.then(|| Bordered::new(layout, [f32::INFINITY])),
        }
    }

    /// Limits the standard deviation that the passes expect of a pixel: to `relative_noise` times the light around it, over
    /// the square root of its number of samples.
    pub fn limit(&mut self, color: Pixels, samples: Pixels, relative_noise: f32) {
        let mut limits = Bordered::new(self.image.layout, [f32::INFINITY]);
        let find = Limits {
            color,
            samples,
            relative_noise,
        };
        rows::run(&find, color.size.height, limits.bands());
        self.limits = Some(limits);
    }

    pub fn size(&self) -> Size {
        self.image.layout.size
    }

    /// Bands, to be filled before the first pass.
    pub fn bands(&mut self) -> impl Iterator<Item = Band<'_>> {
        let tones = rows::optional(self.tones.as_mut().map(Bordered::bands));
        let bands = self.image.bands().zip(tones);
        bands.map(|(image, tones)| Band { image, tones })
    }

    /// Runs pass `iteration`, from 0. Each row goes to the sink as soon as it is filtered, with that row of its outputs.
    pub fn filter<K: Sink>(
        &mut self,
        guide: &Guide,
        params: Params,
        iteration: u32,
        sink: &K,
        outs: impl Iterator<Item = K::Row>,
    ) {
        let (step, predicted) = (1 << iteration, self.predicted);
        let (variance, jobs) = (self.image).in_place(step, params.radius, self.variances, outs);
        let pass = Pass {
            variance,
            guide,
            params,
            limits: self.limits.as_ref().map(|limits| limits.planes::<1>()[0]),
            tones: self.tones.as_ref().map(|tones| tones.planes::<1>()[0]),
            step,
            predicted,
            sink,
        };
        rows::run_jobs(&pass, jobs);
        self.variances.reverse();
    }

    #[inline(always)]
    pub fn row(&self, y: usize) -> FilteredRow<'_> {
        FilteredRow {
            channels: self.image.rows(y),
            variance: self.image.row(self.variances[0], y),
        }
    }
}

impl Colors for Filtered {
    #[inline(always)]
    fn colors(&self, run: Run, color: &mut [Row; 3]) {
        self.row(run.y).colors(run, color);
    }
}

/// A row of an image between passes.
pub(crate) struct FilteredRow<'a> {
    channels: [&'a [f32]; IN_PLACE],
    pub variance: &'a [f32],
}

impl FilteredRow<'_> {
    /// A part of the row; NaN where the image is missing.
    #[inline(always)]
    pub fn colors(&self, run: Run, color: &mut [Row; 3]) {
        let [r, g, b, l] = self.channels.map(|row| &row[run.x..][..run.len]);
        for (out, plane) in color.iter_mut().zip([r, g, b]) {
            for ((out, &value), &l) in out.iter_mut().zip(plane).zip(l) {
                *out = if l.is_nan() { f32::NAN } else { value };
            }
        }
    }

    /// The luminance that is compared, NaN where the image is missing.
    #[inline(always)]
    pub fn luminance(&self, run: Run) -> &[f32] {
        &self.channels[LUMINANCE][run.x..][..run.len]
    }
}

/// Reads each row that a pass has filtered, while it is still in cache, instead of in a sweep of its own.
pub(crate) trait Sink: Sync {
    /// One row of the sink's outputs.
    type Row: Send;

    fn take(&self, y: usize, filtered: FilteredRow, out: &mut Self::Row);
}

/// Takes nothing.
impl Sink for () {
    type Row = ();

    #[inline(always)]
    fn take(&self, _: usize, _: FilteredRow, (): &mut ()) {}
}

struct Load<'a> {
    source: Source<'a>,
    settled: f32,
}

impl<'a> Kernel for Load<'a> {
    type Out = Band<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: Band<'a>) {
        let source = &self.source;
        for y in rows {
            out.variance(y).copy_from_slice(source.variance.row(y));
            out.complete(source.color, source.prediction, y);
            if let Some(samples) = source.samples {
                out.weigh(samples, source.exposure, self.settled, y);
            }
        }
    }
}

/// Rows of an image before the first pass.
pub(crate) struct Band<'a> {
    image: BorderedBand<'a>,
    tones: Option<BorderedBand<'a>>,
}

impl Band<'_> {
    /// A row's variance, to be written first.
    #[inline(always)]
    pub fn variance(&mut self, y: usize) -> &mut [f32] {
        self.image.row(VARIANCES[0], y)
    }

    /// Completes a row whose variance has been written: sanitises the variance, and loads the colour and the luminance that
    /// is compared.
    #[inline(always)]
    pub fn complete(&mut self, color: Pixels, prediction: Option<Pixels>, y: usize) {
        let image = &mut self.image;
        for v in image.row(VARIANCES[0], y) {
            *v = if v.is_finite() { floored(*v) } else { 0.0 };
        }
        image.replicate(VARIANCES[0], y);
        let mut parts = [[0.0; SEGMENT]; 3];
        for run in segments(y, color.size.width) {
            color.read_rows(run, &mut parts);
            load(run, parts.each_ref().map(|row| &row[..run.len]), image);
            if let Some(prediction) = prediction {
                let luminances = &mut image.row(LUMINANCE, y)[run.x..][..run.len];
                let predicted = &prediction.row(y)[run.x..][..run.len];
                for (l, &predicted) in luminances.iter_mut().zip(predicted) {
                    let usable = predicted.is_finite() & !l.is_nan();
                    *l = if usable {
                        predicted.clamp(-MOST, MOST)
                    } else {
                        *l
                    };
                }
            }
        }
    }

    /// Stores 1 / (luminance + exposure) of a complete row's pixels, if brighter taps weigh less. Pixels of fewer than
    /// `settled` samples get infinity, which leaves all weights as they are.
    #[inline(always)]
    pub fn weigh(&mut self, samples: Pixels, exposure: f32, settled: f32, y: usize) {
        let Some(tones) = &mut self.tones else { return };
        let exposure = exposure.min(MOST);
        let (luminances, tones) = (self.image.row(LUMINANCE, y), tones.row(0, y));
        let mut counts = [0.0; SEGMENT];
        for run in segments(y, samples.size.width) {
            samples.load(run, 0, &mut counts[..run.len]);
            for (x, &count) in (run.x..).zip(&counts[..run.len]) {
                let tone = 1.0 / (exposure + larger(luminances[x], 0.0));
                let told = (count >= settled) & !luminances[x].is_nan();
                tones[x] = if told { tone } else { f32::INFINITY };
            }
        }
    }

    /// A row that is finished.
    #[inline(always)]
    pub fn ready(&mut self, y: usize) -> FilteredRow<'_> {
        let [r, g, b, l, v] = self.image.rows::<{ IN_PLACE + 1 }>(y);
        FilteredRow {
            channels: [r, g, b, l],
            variance: v,
        }
    }
}

/// Colours are clamped to ±2¹²⁰, so that sums over all taps stay finite.
const MOST: f32 = f32::from_bits((120 + 127) << 23);

/// Finds the most that the standard deviation of each pixel may be.
struct Limits<'a> {
    color: Pixels<'a>,
    samples: Pixels<'a>,
    relative_noise: f32,
}

impl<'a> Kernel for Limits<'a> {
    type Out = BorderedBand<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut limits: BorderedBand<'a>) {
        let Size { width, height } = self.color.size;
        // Blurred rows above, at and below the current one; rows outside the image repeat its first and last.
        let mut near = vec![0.0; 3 * width];
        let mut light = vec![0.0; width + 2];
        let mut samples = [0.0; SEGMENT];
        for y in rows.clone() {
            let due = if y == rows.start {
                y.saturating_sub(1)..=y + 1
            } else {
                y + 1..=y + 1
            };
            for y in due.filter(|&y| y < height) {
                self.blur(y, &mut light, &mut near[y % 3 * width..][..width]);
            }
            let [above, own, below] = [y.saturating_sub(1), y, (y + 1).min(height - 1)]
                .map(|y| &near[y % 3 * width..][..width]);
            let limits = limits.row(0, y);
            for run in segments(y, width) {
                self.samples.load(run, 0, &mut samples[..run.len]);
                for (x, &count) in (run.x..).zip(&samples[..run.len]) {
                    let around = above[x] * 0.25 + own[x] * 0.5 + below[x] * 0.25;
                    limits[x] =
                        self.relative_noise * larger(around, 0.0) / larger(count, 1.0).sqrt();
                }
            }
        }
    }
}

impl Limits<'_> {
    /// Blurs the luminance of a row along it. Missing pixels are black.
    #[inline(always)]
    fn blur(&self, y: usize, light: &mut [f32], blurred: &mut [f32]) {
        let width = blurred.len();
        let mut parts = [[0.0; SEGMENT]; 3];
        for run in segments(y, width) {
            self.color.read_rows(run, &mut parts);
            for (i, light) in light[1 + run.x..][..run.len].iter_mut().enumerate() {
                let color = parts.map(|row| row[i]);
                let [r, g, b] = color.map(|c| c.clamp(-MOST, MOST));
                *light = if is_present(color) {
                    luminance(r, g, b)
                } else {
                    0.0
                };
            }
        }
        (light[0], light[width + 1]) = (light[1], light[width]);
        for (blurred, near) in blurred.iter_mut().zip(light.windows(3)) {
            *blurred = near[0] * 0.25 + near[1] * 0.5 + near[2] * 0.25;
        }
    }
}

/// Loads the colour of a run, clamped, and its luminance.
#[inline(always)]
fn load(run: Run, [r, g, b]: [&[f32]; 3], out: &mut BorderedBand) {
    let rows = out.rows::<IN_PLACE>(run.y);
    let [or, og, ob, ol] = rows.map(|row| &mut row[run.x..][..run.len]);
    for x in 0..r.len() {
        let present = is_present([r[x], g[x], b[x]]);
        let keep = |c: f32| if present { c.clamp(-MOST, MOST) } else { 0.0 };
        (or[x], og[x], ob[x]) = (keep(r[x]), keep(g[x]), keep(b[x]));
        ol[x] = if present {
            luminance(or[x], og[x], ob[x])
        } else {
            f32::NAN
        };
    }
}

struct Unload<'a> {
    image: &'a Filtered,
}

struct Outs<'a> {
    color: PixelsMut<'a>,
    variance: BandMut<'a>,
    prediction: Option<BandMut<'a>>,
}

impl<'a> Kernel for Unload<'a> {
    type Out = Outs<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: Outs<'a>) {
        let mut values = [[0.0; SEGMENT]; 3];
        for y in rows {
            out.variance
                .row(0, y)
                .copy_from_slice(self.image.row(y).variance);
            for run in segments(y, self.image.size().width) {
                if let Some(prediction) = &mut out.prediction {
                    prediction.put(run, self.image.row(y).luminance(run));
                }
                self.image.colors(run, &mut values);
                out.color.write(run, &values);
            }
        }
    }
}
