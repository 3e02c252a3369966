//! The edge-avoiding à-trous wavelet filter, guided by variance.
//!
//! Pass i averages the 5×5 taps at multiples of 2^i pixels. A tap's weight is the B₃-spline kernel
//! {1, 2/3, 1/6} ⊗ {1, 2/3, 1/6} times the guide's weight (see [`super::guide`]) times
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
//! Inputs: colour (3), variance (1) of its luminance, guide. Outputs: the same.

use std::ops::Range;

use pulp::Simd;

use super::guide::{Comparison, Guide, Sigmas};
use super::variance::{floored, floored_all};
use crate::error::{Result, in_range, whole};
use crate::image::{BandMut, Pixels, Run, SEGMENT, Size, bands_of, segments};
use crate::lanes::{Bordered, BorderedBand, Lanes, Layout, Tap};
use crate::math::{LOG2_E, exp2_weight, is_present, luminance, luminances};
use crate::pixels::{PixelsMut, Row};
use crate::rows::{self, Kernel, LanesKernel};

#[derive(Clone, Copy, Debug)]
pub struct Params {
    /// Passes; 0 to 16; 5.
    pub iterations: u32,
    /// Luminance difference that counts as one, in standard deviations; > 0; 4.
    pub sigma_luminance: f32,
    pub sigmas: Sigmas,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            iterations: 5,
            sigma_luminance: 4.0,
            sigmas: Sigmas::default(),
        }
    }
}

impl Params {
    /// A number of passes.
    pub fn iterations(value: i64) -> Result<u32> {
        whole("iterations", value, "0 to 16 passes", |&n| n <= 16)
    }

    /// Pixels from the farthest tap to the centre.
    pub fn reach(&self) -> usize {
        1 << self.iterations
    }

    pub fn check(&self) -> Result<()> {
        in_range(
            "sigma_luminance",
            self.sigma_luminance,
            "a number above 0",
            |v| v > 0.0,
        )?;
        self.sigmas.check()
    }
}

/// Between passes an image has colour (0 to 2), variance (3) and luminance (4). A missing pixel is black with NaN for
/// luminance, which makes every weight with it zero; so is the border.
const CHANNELS: usize = 5;
const VARIANCE: usize = 3;
const LUMINANCE: usize = 4;

/// log₂ of 1, 2/3 and 1/6.
const LOG2_KERNEL: [f32; 3] = [0.0, -0.584_962_5, -2.584_962_5];

/// Writes the filtered colour and variance.
pub fn atrous<'a>(
    color: Pixels,
    variance: Pixels,
    guide: &Guide,
    params: Params,
    filtered: impl Iterator<Item = PixelsMut<'a>>,
    filtered_variance: &mut [f32],
) {
    let size = color.size;
    let mut image = Filtered::new(guide.layout);
    rows::run(&Load { color, variance }, size.height, image.bands());
    for iteration in 0..params.iterations {
        image.filter(guide, params, iteration);
    }
    let variances = bands_of(filtered_variance, size);
    let outs = (filtered.zip(variances)).map(|(color, variance)| Outs { color, variance });
    rows::run(&Unload { image: &image }, size.height, outs);
}

/// An image on its way through the passes.
pub struct Filtered {
    image: Bordered,
    /// That of the pass before, to be overwritten.
    spare: Option<Bordered>,
}

impl Filtered {
    pub fn new(layout: Layout) -> Self {
        Self {
            image: blank(layout),
            spare: None,
        }
    }

    pub fn size(&self) -> Size {
        self.image.layout.size
    }

    /// To be loaded.
    pub fn bands(&mut self) -> impl Iterator<Item = BorderedBand<'_>> {
        self.image.bands()
    }

    /// Runs pass `iteration`, from 0.
    pub fn filter(&mut self, guide: &Guide, params: Params, iteration: u32) {
        let mut filtered = self.spare.take().unwrap_or_else(|| blank(guide.layout));
        let pass = Pass {
            image: &self.image,
            guide,
            params,
            step: 1 << iteration,
        };
        rows::run_lanes(&pass, guide.layout.size.height, filtered.bands());
        self.spare = Some(std::mem::replace(&mut self.image, filtered));
    }

    /// A run's colour; NaN where it is missing.
    #[inline(always)]
    pub fn color(&self, run: Run, color: &mut [Row; 3]) {
        let rows = self.image.rows::<CHANNELS>(run.y);
        let [r, g, b, _, l] = rows.map(|row| &row[run.x..][..run.len]);
        for (out, plane) in color.iter_mut().zip([r, g, b]) {
            for ((out, &value), &l) in out.iter_mut().zip(plane).zip(l) {
                *out = if l.is_nan() { f32::NAN } else { value };
            }
        }
    }

    #[inline(always)]
    pub fn variance(&self, y: usize) -> &[f32] {
        self.image.rows::<CHANNELS>(y)[VARIANCE]
    }
}

fn blank(layout: Layout) -> Bordered {
    let mut beyond = [0.0; CHANNELS];
    beyond[LUMINANCE] = f32::NAN;
    Bordered::new(layout, beyond)
}

struct Load<'a> {
    color: Pixels<'a>,
    variance: Pixels<'a>,
}

impl<'a> Kernel for Load<'a> {
    type Out = BorderedBand<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: BorderedBand<'a>) {
        let mut color = [[0.0; SEGMENT]; 3];
        for y in rows {
            variance_of(&mut out, y).copy_from_slice(self.variance.row(y));
            settle_variance(y, &mut out);
            for run in segments(y, self.color.size.width) {
                self.color
                    .read(run, color.each_mut().map(Row::as_mut_slice));
                load(run, color.each_ref().map(|row| &row[..run.len]), &mut out);
            }
        }
    }
}

/// Where a row's variance belongs, to be settled when it is there.
#[inline(always)]
pub fn variance_of<'b>(image: &'b mut BorderedBand, y: usize) -> &'b mut [f32] {
    image.row(VARIANCE, y)
}

#[inline(always)]
pub fn settle_variance(y: usize, image: &mut BorderedBand) {
    for v in image.row(VARIANCE, y) {
        *v = if v.is_finite() { floored(*v) } else { 0.0 };
    }
    image.replicate(VARIANCE, y);
}

/// Puts a run's colour in place.
#[inline(always)]
pub fn load(run: Run, [r, g, b]: [&[f32]; 3], out: &mut BorderedBand) {
    let rows = out.rows::<CHANNELS>(run.y);
    let [or, og, ob, _, ol] = rows.map(|row| &mut row[run.x..][..run.len]);
    for x in 0..r.len() {
        let present = is_present([r[x], g[x], b[x]]);
        let keep = |c: f32| if present { c } else { 0.0 };
        (or[x], og[x], ob[x]) = (keep(r[x]), keep(g[x]), keep(b[x]));
        ol[x] = if present {
            luminance(r[x], g[x], b[x])
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
}

impl<'a> Kernel for Unload<'a> {
    type Out = Outs<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: Outs<'a>) {
        let mut values = [[0.0; SEGMENT]; 3];
        for y in rows {
            out.variance
                .row(0, y)
                .copy_from_slice(self.image.variance(y));
            for run in segments(y, self.image.size().width) {
                self.image.color(run, &mut values);
                out.color.write(run, values.each_ref().map(Row::as_slice));
            }
        }
    }
}

struct Pass<'a> {
    image: &'a Bordered,
    guide: &'a Guide,
    params: Params,
    step: usize,
}

impl<'a> LanesKernel for Pass<'a> {
    type Out = BorderedBand<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, simd: S, rows: Range<usize>, mut out: BorderedBand<'a>) {
        let layout = self.image.layout;
        let around = Around {
            layout,
            image: self.image.planes(),
            guide: self.guide.compare(&self.params.sigmas),
            sigma_luminance: self.params.sigma_luminance,
        };
        for y in rows {
            let taps: Vec<_> = (layout.taps(y, 2, self.step).into_iter())
                .map(|tap| (tap, tap_exponent(tap, self.step)))
                .collect();
            // The border continues the rows; above the first and below the last row, these do.
            let near = [y.saturating_sub(1), (y + 1).min(layout.size.height - 1)];
            for x in (0..layout.size.width).step_by(Lanes::<S>::COUNT) {
                let filtered = around.filter(simd, x, y, near, &taps);
                for (row, lanes) in out.rows::<CHANNELS>(y).into_iter().zip(filtered) {
                    lanes.store(row, x);
                }
            }
            out.replicate(VARIANCE, y);
        }
    }
}

/// log₂ of a tap's own weight.
fn tap_exponent(tap: Tap, step: usize) -> f32 {
    let [x, y] = tap.offset.map(|d| LOG2_KERNEL[d.unsigned_abs() / step]);
    x + y
}

/// What a pass reads.
struct Around<'a> {
    layout: Layout,
    image: [&'a [f32]; CHANNELS],
    guide: Comparison<'a>,
    sigma_luminance: f32,
}

impl Around<'_> {
    /// The pixels from (x, y) on.
    #[inline(always)]
    fn filter<S: Simd>(
        &self,
        simd: S,
        x: usize,
        y: usize,
        near: [usize; 2],
        taps: &[(Tap, f32)],
    ) -> [Lanes<S>; CHANNELS] {
        let at = self.layout.at(x, y);
        let center = self.guide.center(simd, x, y);
        let (here, sharpness) = self.sharpness(simd, x, y, near);
        let mut weight = Lanes::all(simd, 0.0);
        let [mut r, mut g, mut b, mut v] = [Lanes::all(simd, 0.0); 4];
        for &(tap, exponent) in taps {
            let guided = self.guide.exponents(simd, &center, tap, exponent);
            let [tr, tg, tb, tv, tl] = Lanes::load_all(simd, self.image, tap.of(at));
            let w = exp2_weight(guided - sharpness * (here - tl).abs());
            weight = weight + w;
            r = r + w * tr;
            g = g + w * tg;
            b = b + w * tb;
            v = v + w * w * tv;
        }
        let some = weight.above(0.0);
        let [r, g, b] = [r, g, b].map(|sum| (sum / weight).or_all(some, 0.0));
        let v = floored_all(v / weight / weight);
        let l = luminances(r, g, b).or_all(some, f32::NAN);
        [r, g, b, v, l]
    }

    /// The centres' luminance, and log₂e over the difference from it that counts as one; both 0 where it is missing, so that
    /// it does not count.
    #[inline(always)]
    fn sharpness<S: Simd>(
        &self,
        simd: S,
        x: usize,
        y: usize,
        [above, below]: [usize; 2],
    ) -> (Lanes<S>, Lanes<S>) {
        let above = blurred(simd, self.image[VARIANCE], self.layout.at(x, above));
        let own = blurred(simd, self.image[VARIANCE], self.layout.at(x, y));
        let below = blurred(simd, self.image[VARIANCE], self.layout.at(x, below));
        let deviation = (above * 0.25 + own * 0.5 + below * 0.25).sqrt();
        let luminance = Lanes::load(simd, self.image[LUMINANCE], self.layout.at(x, y));
        let unit = deviation * self.sigma_luminance + luminance.abs() * 1e-3 + 1e-30;
        let known = luminance.is_number();
        let sharpness = Lanes::all(simd, LOG2_E) / unit;
        (luminance.or_all(known, 0.0), sharpness.or_all(known, 0.0))
    }
}

/// Along a row.
#[inline(always)]
fn blurred<S: Simd>(simd: S, plane: &[f32], at: usize) -> Lanes<S> {
    let [left, own, right] = [
        Lanes::load(simd, plane, at - 1),
        Lanes::load(simd, plane, at),
        Lanes::load(simd, plane, at + 1),
    ];
    left * 0.25 + own * 0.5 + right * 0.25
}
