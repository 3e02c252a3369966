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
//! Inputs: colour (3), variance (1) of its luminance, guide. Outputs: the same.

use std::ops::Range;

use pulp::Simd;

use super::guide::{Comparison, Guide, Sigmas};
use super::variance::{floored, floored_all};
use crate::bordered::{Before, Bordered, BorderedBand, Chain, Columns, Layout, Link};
use crate::error::{Result, in_range, whole};
use crate::image::{BandMut, Pixels, Run, SEGMENT, Size, bands_of, segments};
use crate::lanes::Lanes;
use crate::math::{LOG2_E, exp2_weights, is_present, luminance, luminances};
use crate::pixels::{PixelsMut, Row};
use crate::rows::{self, Kernel, LanesKernel};

#[derive(Clone, Copy, Debug)]
pub struct Params {
    /// Passes; 0 to 16; 5.
    pub iterations: u32,
    /// Taps to each side; 1 or 2; 2.
    pub radius: usize,
    /// Luminance difference that counts as one, in standard deviations; > 0; 4.
    pub sigma_luminance: f32,
    pub sigmas: Sigmas,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            iterations: 5,
            radius: 2,
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

    /// Taps to each side.
    pub fn radius(value: i64) -> Result<usize> {
        whole("radius", value, "1 or 2 taps", |n| (1..=2).contains(n))
    }

    /// Pixels from the farthest tap to the centre.
    pub fn reach(&self) -> usize {
        (self.radius << self.iterations) / 2
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

/// Between passes an image has colour (0 to 2), luminance (3) and variance (4 or 5). A missing pixel is black with NaN for
/// luminance, which makes every weight with it zero; so is the border.
const LUMINANCE: usize = 3;
/// What a pass overwrites in its place. The variance it does not, as it is read in the rows above and below.
const IN_PLACE: usize = 4;
const VARIANCES: [usize; 2] = [4, 5];

/// log₂ of 1, 2/3 and 1/6.
const LOG2_CUBIC: [f32; 3] = [0.0, -0.584_962_5, -2.584_962_5];
/// log₂ of 1 and 1/2.
const LOG2_LINEAR: [f32; 2] = [0.0, -1.0];

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
    /// The channel of the variance, and that of the next.
    variances: [usize; 2],
}

impl Filtered {
    pub fn new(layout: Layout) -> Self {
        let mut beyond = [0.0; IN_PLACE + VARIANCES.len()];
        beyond[LUMINANCE] = f32::NAN;
        Self {
            image: Bordered::new(layout, beyond),
            variances: VARIANCES,
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
        let step = 1 << iteration;
        let (variance, chains) = self.image.chains(step, params.radius, self.variances);
        let pass = Pass {
            variance,
            guide,
            params,
            step,
        };
        let parts = chains.into_iter().map(|chain| (chain.range(), chain));
        rows::run_lane_parts(&pass, parts.collect());
        self.variances.reverse();
    }

    /// A run's colour; NaN where it is missing.
    #[inline(always)]
    pub fn color(&self, run: Run, color: &mut [Row; 3]) {
        let rows = self.image.rows::<IN_PLACE>(run.y);
        let [r, g, b, l] = rows.map(|row| &row[run.x..][..run.len]);
        for (out, plane) in color.iter_mut().zip([r, g, b]) {
            for ((out, &value), &l) in out.iter_mut().zip(plane).zip(l) {
                *out = if l.is_nan() { f32::NAN } else { value };
            }
        }
    }

    #[inline(always)]
    pub fn variance(&self, y: usize) -> &[f32] {
        self.image.row(self.variances[0], y)
    }
}

struct Load<'a> {
    color: Pixels<'a>,
    variance: Pixels<'a>,
}

impl<'a> Kernel for Load<'a> {
    type Out = BorderedBand<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: BorderedBand<'a>) {
        for y in rows {
            variance_of(&mut out, y).copy_from_slice(self.variance.row(y));
            settle(self.color, y, &mut out);
        }
    }
}

/// Where a row's variance belongs, to be settled when it is there.
#[inline(always)]
pub fn variance_of<'b>(image: &'b mut BorderedBand, y: usize) -> &'b mut [f32] {
    image.row(VARIANCES[0], y)
}

/// Makes a row's variance ready, and puts its colour in place.
#[inline(always)]
pub fn settle(color: Pixels, y: usize, image: &mut BorderedBand) {
    for v in image.row(VARIANCES[0], y) {
        *v = if v.is_finite() { floored(*v) } else { 0.0 };
    }
    image.replicate(VARIANCES[0], y);
    let mut parts = [[0.0; SEGMENT]; 3];
    for run in segments(y, color.size.width) {
        color.read(run, parts.each_mut().map(Row::as_mut_slice));
        load(run, parts.each_ref().map(|row| &row[..run.len]), image);
    }
}

/// Puts a run's colour in place.
#[inline(always)]
fn load(run: Run, [r, g, b]: [&[f32]; 3], out: &mut BorderedBand) {
    let rows = out.rows::<IN_PLACE>(run.y);
    let [or, og, ob, ol] = rows.map(|row| &mut row[run.x..][..run.len]);
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
    variance: &'a [f32],
    guide: &'a Guide,
    params: Params,
    step: usize,
}

impl<'a> LanesKernel for Pass<'a> {
    type Out = Chain<'a, IN_PLACE>;

    #[inline(always)]
    fn rows<S: Simd>(&self, simd: S, _: Range<usize>, chain: Self::Out) {
        match self.params.radius {
            1 => self.filter(simd, LOG2_LINEAR, Columns::<3>::new, chain),
            _ => self.filter(simd, LOG2_CUBIC, Columns::<5>::new, chain),
        }
    }
}

impl Pass<'_> {
    /// With the logarithm of the kernel's weights, and its columns for a step.
    #[inline(always)]
    fn filter<S: Simd, const N: usize, const HALF: usize>(
        &self,
        simd: S,
        kernel: [f32; HALF],
        columns: impl Fn(usize, usize) -> Columns<N>,
        chain: Chain<IN_PLACE>,
    ) {
        let layout = self.guide.layout;
        let around = Around {
            layout,
            variance: self.variance,
            guide: self.guide.compare(&self.params.sigmas),
            sigma_luminance: self.params.sigma_luminance,
            step: self.step,
            kernel,
        };
        // The first passes' steps as constants; each has memory for its taps.
        match self.step {
            1 => around.rows(simd, columns(1, usize::MAX), chain),
            2 => around.rows(simd, columns(2, usize::MAX), chain),
            4 => around.rows(simd, columns(4, usize::MAX), chain),
            8 => around.rows(simd, columns(8, usize::MAX), chain),
            16 => around.rows(simd, columns(16, usize::MAX), chain),
            step => around.rows(simd, columns(step, layout.farthest()), chain),
        }
    }
}

/// What a pass reads, but for what it overwrites.
struct Around<'a, const HALF: usize> {
    layout: Layout,
    variance: &'a [f32],
    guide: Comparison<'a>,
    sigma_luminance: f32,
    step: usize,
    /// log₂ of a tap's own weight, by its steps along each axis.
    kernel: [f32; HALF],
}

impl<const HALF: usize> Around<'_, HALF> {
    #[inline(always)]
    fn rows<S: Simd, const N: usize>(
        &self,
        simd: S,
        columns: Columns<N>,
        mut chain: Chain<IN_PLACE>,
    ) {
        let Size { width, height } = self.layout.size;
        for link in 0..chain.len {
            let Link {
                y,
                around,
                mut out,
                apart,
            } = chain.link(link);
            // The border continues the rows; above the first and below the last row, these do.
            let near = [y.saturating_sub(1), (y + 1).min(height - 1)];
            for x in (0..width).step_by(Lanes::<S>::COUNT) {
                let ([r, g, b, l], v) = self.filter(simd, x, y, near, &around, &columns);
                for (row, lanes) in out.iter_mut().zip([r, g, b, l]) {
                    lanes.store(row, x);
                }
                v.store(apart, x);
            }
        }
        chain.replicate();
    }

    /// The pixels from (x, y) on.
    #[inline(always)]
    fn filter<S: Simd, const N: usize>(
        &self,
        simd: S,
        x: usize,
        y: usize,
        near: [usize; 2],
        around: &[Before<IN_PLACE>],
        columns: &Columns<N>,
    ) -> ([Lanes<S>; IN_PLACE], Lanes<S>) {
        let at = self.layout.at(x, y);
        let center = self.guide.center(simd, x, y);
        let (own, of_row) = (self.layout.at(x, 0), self.layout.along(columns, 0));
        let here = around
            .iter()
            .find(|row| row.down == 0)
            .expect("a row is near itself");
        let here = Lanes::load(simd, here.channels[LUMINANCE], own);
        let (here, sharpness) = self.sharpness(simd, x, y, near, here);
        let mut weight = Lanes::all(simd, 0.0);
        let [mut r, mut g, mut b, mut v] = [Lanes::all(simd, 0.0); 4];
        for &Before { down, channels } in around {
            let taps = self.layout.along(columns, down);
            let mut exponents = [self.kernel[down.unsigned_abs() / self.step]; N];
            for k in 0..N {
                exponents[k] += self.kernel[k.abs_diff(N / 2)];
            }
            let load = |channel: usize| Lanes::load_taps(simd, channels[channel], own, &of_row);
            let mut exponents = self.guide.exponents(simd, &center, &taps, exponents);
            let luminance = load(LUMINANCE);
            for k in 0..N {
                exponents[k] = exponents[k] - sharpness * (here - luminance[k]).abs();
            }
            let w = exp2_weights(exponents);
            let [tr, tg, tb] = [load(0), load(1), load(2)];
            let tv = Lanes::load_taps(simd, self.variance, at, &taps);
            for k in 0..N {
                weight = weight + w[k];
                r = r + w[k] * tr[k];
                g = g + w[k] * tg[k];
                b = b + w[k] * tb[k];
                v = v + w[k] * w[k] * tv[k];
            }
        }
        let some = weight.above(0.0);
        // One division instead of five; weights are large enough.
        let share = Lanes::all(simd, 1.0) / weight;
        let r = (r * share).or_all(some, 0.0);
        let g = (g * share).or_all(some, 0.0);
        let b = (b * share).or_all(some, 0.0);
        let v = floored_all(v * share * share);
        let l = luminances(r, g, b).or_all(some, f32::NAN);
        ([r, g, b, l], v)
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
        luminance: Lanes<S>,
    ) -> (Lanes<S>, Lanes<S>) {
        let above = blurred(simd, self.variance, self.layout.at(x, above));
        let own = blurred(simd, self.variance, self.layout.at(x, y));
        let below = blurred(simd, self.variance, self.layout.at(x, below));
        let deviation = (above * 0.25 + own * 0.5 + below * 0.25).sqrt();
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
