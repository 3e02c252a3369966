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

use super::guide::{Guide, Sigmas};
use super::variance::floored;
use crate::error::{Result, in_range, whole};
use crate::image::{BandMut, Image, Run, SEGMENT, Size, Tap, View};
use crate::math::{LOG2_E, exp2_weight, is_present, luminance};
use crate::rows::{self, Kernel};

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
/// luminance, which makes every weight with it zero.
const CHANNELS: usize = 5;
const LUMINANCE: usize = 4;

/// log₂ of 1, 2/3 and 1/6.
const LOG2_KERNEL: [f32; 3] = [0.0, -0.584_962_5, -2.584_962_5];

/// The filter's results.
pub struct Filtered {
    pub color: Image,
    pub variance: Image,
    /// The colour after the passes that were asked for.
    pub kept: [Option<Image>; 2],
}

/// `keep` names passes, counted from 1, after which the colour is wanted as well.
pub fn atrous(
    color: View,
    variance: View,
    guide: &Guide,
    params: Params,
    keep: [Option<u32>; 2],
) -> Filtered {
    let size = color.size;
    let mut image = Image::new(size, CHANNELS);
    rows::run(&Load { color, variance }, size.height, image.bands());
    let mut filtered = Image::new(size, CHANNELS);
    let mut kept = [None, None];
    for iteration in 0..params.iterations {
        let pass = Pass {
            image: &image,
            guide,
            params,
            step: 1 << iteration,
        };
        rows::run(&pass, size.height, filtered.bands());
        std::mem::swap(&mut image, &mut filtered);
        for (kept, pass) in kept.iter_mut().zip(keep) {
            if pass == Some(iteration + 1) {
                *kept = Some(unload(&image).0);
            }
        }
    }
    let (color, variance) = unload(&image);
    // A filter that ends before is kept as it ended.
    for (kept, pass) in kept.iter_mut().zip(keep) {
        if pass.is_some_and(|pass| pass > params.iterations) {
            *kept = Some(color.clone());
        }
    }
    Filtered {
        color,
        variance,
        kept,
    }
}

fn unload(image: &Image) -> (Image, Image) {
    let (mut color, mut variance) = (Image::new(image.size, 3), Image::new(image.size, 1));
    rows::run(
        &Unload { image },
        image.size.height,
        color.bands().zip(variance.bands()),
    );
    (color, variance)
}

struct Load<'a> {
    color: View<'a>,
    variance: View<'a>,
}

impl<'a> Kernel for Load<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: BandMut<'a>) {
        for y in rows {
            load(self.color.rows(y), self.variance.row(0, y), out.rows(y));
        }
    }
}

#[inline(always)]
fn load([r, g, b]: [&[f32]; 3], v: &[f32], [or, og, ob, ov, ol]: [&mut [f32]; CHANNELS]) {
    for x in 0..r.len() {
        let present = is_present([r[x], g[x], b[x]]);
        let keep = |c: f32| if present { c } else { 0.0 };
        (or[x], og[x], ob[x]) = (keep(r[x]), keep(g[x]), keep(b[x]));
        ol[x] = if present {
            luminance(r[x], g[x], b[x])
        } else {
            f32::NAN
        };
        ov[x] = if v[x].is_finite() { floored(v[x]) } else { 0.0 };
    }
}

struct Unload<'a> {
    image: &'a Image,
}

impl<'a> Kernel for Unload<'a> {
    type Out = (BandMut<'a>, BandMut<'a>);

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, (mut color, mut variance): Self::Out) {
        for y in rows {
            let [r, g, b, v, l] = self.image.view().rows::<CHANNELS>(y);
            variance.row(0, y).copy_from_slice(v);
            for (out, plane) in color.rows::<3>(y).into_iter().zip([r, g, b]) {
                for ((out, &value), &l) in out.iter_mut().zip(plane).zip(l) {
                    *out = if l.is_nan() { f32::NAN } else { value };
                }
            }
        }
    }
}

struct Pass<'a> {
    image: &'a Image,
    guide: &'a Guide,
    params: Params,
    step: usize,
}

/// What a run of pixels needs of itself, and what it collects from its taps.
struct Scratch {
    luminance: [f32; SEGMENT],
    /// log₂e over the luminance difference that counts as one; 0 where luminance is not to count.
    sharpness: [f32; SEGMENT],
    weight: [f32; SEGMENT],
    sums: [[f32; SEGMENT]; 4],
}

impl<'a> Kernel for Pass<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: BandMut<'a>) {
        let Size { width, .. } = self.image.size;
        for y in rows {
            for x in (0..width).step_by(SEGMENT) {
                let run = Run {
                    y,
                    x,
                    len: SEGMENT.min(width - x),
                };
                let scratch = self.collect(run);
                finish(&scratch, out.rows(y).map(|row| &mut row[x..][..run.len]));
            }
        }
    }
}

impl Pass<'_> {
    #[inline(always)]
    fn collect(&self, run: Run) -> Scratch {
        let mut scratch = Scratch {
            luminance: [0.0; SEGMENT],
            sharpness: [0.0; SEGMENT],
            weight: [0.0; SEGMENT],
            sums: [[0.0; SEGMENT]; 4],
        };
        self.sharpness(run, &mut scratch);
        for dy in -2..=2_isize {
            for dx in -2..=2_isize {
                let tap = Tap {
                    dx,
                    dy,
                    step: self.step,
                };
                let Some(here) = tap.inside(run, self.image.size) else {
                    continue;
                };
                let kernel = LOG2_KERNEL[dx.unsigned_abs()] + LOG2_KERNEL[dy.unsigned_abs()];
                let mut exponents = [kernel; SEGMENT];
                let exponents = &mut exponents[..here.len];
                self.guide
                    .subtract(exponents, &self.params.sigmas, here, tap);
                let at = here.x - run.x;
                let Scratch {
                    luminance,
                    sharpness,
                    weight,
                    sums,
                } = &mut scratch;
                let [r, g, b, v, l] = tap.of(here).rows(self.image);
                weigh(exponents, &luminance[at..], &sharpness[at..], l);
                add(
                    exponents,
                    &mut weight[at..],
                    sums.each_mut().map(|sum| &mut sum[at..]),
                    [r, g, b, v],
                );
            }
        }
        scratch
    }

    /// The centre's luminance, and how sharply differences from it count.
    #[inline(always)]
    fn sharpness(&self, run: Run, scratch: &mut Scratch) {
        let Size { height, width } = self.image.size;
        let rows = [run.y.saturating_sub(1), run.y, (run.y + 1).min(height - 1)];
        let [above, row, below] = rows.map(|y| self.image.view().row(3, y));
        // Column sums of the Gaussian first, at most one pixel beyond the run to either side.
        let column = |x: usize| 0.25 * above[x] + 0.5 * row[x] + 0.25 * below[x];
        let luminance = &self.image.view().row(LUMINANCE, run.y)[run.x..][..run.len];
        for (i, &l) in luminance.iter().enumerate() {
            let x = run.x + i;
            let (left, right) = (x.saturating_sub(1), (x + 1).min(width - 1));
            let variance = 0.25 * column(left) + 0.5 * column(x) + 0.25 * column(right);
            let unit = self.params.sigma_luminance * variance.sqrt() + 1e-3 * l.abs() + 1e-30;
            let missing = l.is_nan();
            scratch.luminance[i] = if missing { 0.0 } else { l };
            scratch.sharpness[i] = if missing { 0.0 } else { LOG2_E / unit };
        }
    }
}

/// Turns exponents into weights, luminance included.
#[inline(always)]
fn weigh(exponents: &mut [f32], here: &[f32], sharpness: &[f32], there: &[f32]) {
    let n = exponents.len();
    let (here, sharpness, there) = (&here[..n], &sharpness[..n], &there[..n]);
    for i in 0..n {
        exponents[i] = exp2_weight(exponents[i] - sharpness[i] * (here[i] - there[i]).abs());
    }
}

#[inline(always)]
fn add(weights: &[f32], weight: &mut [f32], sums: [&mut [f32]; 4], taps: [&[f32]; 4]) {
    let n = weights.len();
    let weight = &mut weight[..n];
    let [sr, sg, sb, sv] = sums.map(|sum| &mut sum[..n]);
    let [r, g, b, v] = taps.map(|tap| &tap[..n]);
    for i in 0..n {
        let w = weights[i];
        weight[i] += w;
        sr[i] += w * r[i];
        sg[i] += w * g[i];
        sb[i] += w * b[i];
        sv[i] += w * w * v[i];
    }
}

#[inline(always)]
fn finish(scratch: &Scratch, [r, g, b, v, l]: [&mut [f32]; CHANNELS]) {
    let [sr, sg, sb, sv] = &scratch.sums;
    for i in 0..r.len() {
        let w = scratch.weight[i];
        let some = w > 0.0;
        let mean = |sum: f32| if some { sum / w } else { 0.0 };
        (r[i], g[i], b[i]) = (mean(sr[i]), mean(sg[i]), mean(sb[i]));
        v[i] = floored(mean(mean(sv[i])));
        l[i] = if some {
            luminance(r[i], g[i], b[i])
        } else {
            f32::NAN
        };
    }
}
