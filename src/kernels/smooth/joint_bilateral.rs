//! Joint bilateral reconstruction: colour for pixels that were not traced, from traced pixels nearby.
//!
//! A pixel takes Σwc/Σw over the samples up to r·s pixels to each side, each weighted by
//!   w = exp(−|Δ|² / (2 (σ s)²)) · guide,
//! Δ the distance in pixels and `guide` the similarity of the two surfaces (see [`super::guide`]). Guide buffers have
//! full resolution even where colour was traced at every s-th pixel of rows and columns, so that geometric edges stay
//! sharp (Kopf, Cohen, Lischinski and Uyttendaele 2007, *Joint Bilateral Upsampling*).
//!
//! - [`reconstruct`]: samples anywhere in a full image, s = 1; they keep their bits, and only missing pixels are filled.
//! - [`joint_bilateral_upsample`]: an image of ⌈H/s⌉×⌈W/s⌉ samples, one in each block of s×s pixels, which becomes H×W.
//!   Blocks cut by the border have their sample in the last pixel inside.
//!
//! Inputs: colour (3), the guide of the pixels, and that of the samples if it differs. Output: colour (3). Missing
//! samples do not count; a pixel without similar samples is missing, too.

use std::ops::Range;

use super::guide::{Comparison, Guide, Sigmas};
use crate::bordered::{Bordered, BorderedBand, Layout};
use crate::error::{Result, Whole, in_range, whole};
use crate::image::{BandMut, Image, Pixels, SEGMENT, Size, Value, segments};
use crate::lanes::{Lanes, Tap};
use crate::math::{LOG2_E, exp2_weight, is_present};
use crate::rows::{self, Kernel, Simd};

/// The window, and what stops it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// r: radius of the window, in samples; 1 to 16; 2.
    pub radius: usize,
    /// σ: standard deviation of the spatial weight, in samples; > 0; 1.
    pub sigma: f32,
    /// How far surfaces may differ.
    pub sigmas: Sigmas,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            radius: 2,
            sigma: 1.0,
            sigmas: Sigmas::default(),
        }
    }
}

impl Params {
    pub(crate) fn radius(value: impl Whole<usize>) -> Result<usize> {
        whole("radius", value, "1 to 16 samples", |&n| {
            (1..=16).contains(&n)
        })
    }

    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        Self::radius(self.radius)?;
        in_range("sigma", self.sigma, "a number above 0", |v| v > 0.0)?;
        self.sigmas.check()
    }
}

/// Positions of a low-resolution image's samples in the full image.
#[derive(Clone, Copy, Debug)]
pub struct Grid {
    /// The size of the full image.
    pub full: Size,
    /// s; 1 to 16.
    pub scale: usize,
    /// Offset of each sample, right and down, from the centre of its block's first pixel; 0 to s − 1.
    pub offset: [f32; 2],
}

impl Grid {
    pub(crate) fn scale(value: impl Whole<usize>) -> Result<usize> {
        whole("scale", value, "1 to 16 pixels", |&n| (1..=16).contains(&n))
    }

    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        Self::scale(self.scale)?;
        let last = self.scale as f32 - 1.0;
        let expected = format!("0 to {last} pixels right and down");
        (self.offset.into_iter())
            .try_for_each(|d| in_range("offset", d, &expected, |d| (0.0..=last).contains(&d)))
    }

    /// The low resolution: one sample a block.
    pub fn low(&self) -> Size {
        Size {
            height: self.full.height.div_ceil(self.scale),
            width: self.full.width.div_ceil(self.scale),
        }
    }

    /// The pixel of a block that contains its sample.
    fn pixel(&self) -> [usize; 2] {
        self.offset.map(|d| (d + 0.5) as usize)
    }

    /// The sample's position relative to that pixel's centre.
    fn subpixel(&self) -> [f32; 2] {
        let [x, y] = self.pixel();
        [self.offset[0] - x as f32, self.offset[1] - y as f32]
    }

    /// Scatters low-resolution values to the pixels that contain their samples; `outside` elsewhere.
    pub(crate) fn scatter<T: Value>(&self, low: Pixels<T>, outside: T) -> Image<T> {
        let mut image = Image::blank(self.full, low.channels);
        let kernel = Scatter {
            grid: *self,
            low,
            outside,
        };
        rows::run(&kernel, self.full.height, image.bands());
        image
    }
}

struct Scatter<'a, T> {
    grid: Grid,
    low: Pixels<'a, T>,
    outside: T,
}

impl<'a, T: Value> Kernel for Scatter<'a, T> {
    type Out = BandMut<'a, T>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: BandMut<'a, T>) {
        let Grid { full, scale, .. } = self.grid;
        let [right, down] = self.grid.pixel();
        for y in rows {
            let block = y / scale;
            let has_samples = y == (block * scale + down).min(full.height - 1);
            for channel in 0..self.low.channels {
                let row = out.row(channel, y);
                row.fill(self.outside);
                for x in 0..if has_samples { self.low.size.width } else { 0 } {
                    let sample = self.low.at(block * self.low.size.width + x, channel);
                    row[(x * scale + right).min(full.width - 1)] = sample;
                }
            }
        }
    }
}

/// Fills missing pixels. The guide must have a halo of the radius.
pub fn reconstruct(color: Pixels, guide: &Guide, params: Params) -> Image {
    let samples = Samples::new(color, guide.layout);
    let fill = Fill {
        samples: &samples,
        guide: guide.compare(&params.sigmas, params.radius),
        shown: guide.compare(&params.sigmas, params.radius),
        radius: params.radius,
        sigma: params.sigma,
        subpixel: [0.0; 2],
        keep: true,
    };
    fill.image()
}

/// Upsamples a low-resolution image. `guide` describes the full-resolution pixels, `shown` the samples: the same guide,
/// or low-resolution buffers scattered like the samples. Both must have a halo of radius · scale pixels.
pub fn joint_bilateral_upsample(
    low: Pixels,
    grid: Grid,
    [guide, shown]: [&Guide; 2],
    params: Params,
) -> Image {
    let color = grid.scatter(low, f32::NAN);
    let samples = Samples::new(color.pixels(), guide.layout);
    let radius = params.radius * grid.scale;
    let fill = Fill {
        samples: &samples,
        guide: guide.compare(&params.sigmas, radius),
        shown: shown.compare(&params.sigmas, radius),
        radius,
        sigma: params.sigma * grid.scale as f32,
        subpixel: grid.subpixel(),
        keep: false,
    };
    fill.image()
}

/// Colour with a halo, black where missing, and log₂ of each pixel's validity: 0 or −∞.
struct Samples {
    image: Bordered,
    /// True for rows with at least one sample.
    rows: Vec<bool>,
}

const CHANNELS: usize = 4;
const OWN: usize = 3;

impl Samples {
    fn new(color: Pixels, layout: Layout) -> Self {
        let mut image = Bordered::new(layout, [0.0, 0.0, 0.0, f32::NEG_INFINITY]);
        let mut rows = vec![false; layout.size.height];
        let outs = image.bands().zip(rows.chunks_mut(rows::BAND));
        rows::run(&Load(color), layout.size.height, outs);
        Self { image, rows }
    }
}

struct Load<'a>(Pixels<'a>);

impl<'a> Kernel for Load<'a> {
    type Out = (BorderedBand<'a>, &'a mut [bool]);

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, (mut image, any): Self::Out) {
        let mut color = [[0.0; SEGMENT]; 3];
        for (y, any) in rows::lines(rows, any, 1) {
            for run in segments(y, self.0.size.width) {
                self.0.read_rows(run, &mut color);
                let [r, g, b] = color.each_ref().map(|row| &row[..run.len]);
                let [or, og, ob, own] =
                    (image.rows::<CHANNELS>(y)).map(|row| &mut row[run.x..][..run.len]);
                let mut here = false;
                for x in 0..run.len {
                    let present = is_present([r[x], g[x], b[x]]);
                    let keep = |c: f32| if present { c } else { 0.0 };
                    (or[x], og[x], ob[x]) = (keep(r[x]), keep(g[x]), keep(b[x]));
                    own[x] = if present { 0.0 } else { f32::NEG_INFINITY };
                    here |= present;
                }
                any[0] |= here;
            }
        }
    }
}

struct Fill<'a> {
    samples: &'a Samples,
    guide: Comparison<'a>,
    /// Guide of the samples.
    shown: Comparison<'a>,
    /// Radius and standard deviation in pixels.
    radius: usize,
    sigma: f32,
    /// Position of the samples relative to their pixels' centres.
    subpixel: [f32; 2],
    /// True if traced pixels keep their bits.
    keep: bool,
}

impl<'a> Kernel for Fill<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, simd: S, rows: Range<usize>, mut out: BandMut<'a>) {
        for y in rows {
            let taps = self.taps(y);
            let [r, g, b] = out.rows(y);
            for x in (0..r.len()).step_by(Lanes::<S>::COUNT) {
                let [mr, mg, mb] = self.mean(simd, x, y, &taps);
                mr.store(r, x);
                mg.store(g, x);
                mb.store(b, x);
            }
        }
    }
}

impl Fill<'_> {
    fn image(&self) -> Image {
        let size = self.samples.image.layout.size;
        let mut image = Image::blank(size, 3);
        rows::run(self, size.height, image.bands());
        image
    }

    /// The taps of row `y` whose samples are in reach, with log₂ of their spatial weights.
    fn taps(&self, y: usize) -> Vec<(Tap, f32)> {
        let scale = LOG2_E / (2.0 * self.sigma * self.sigma);
        let mut taps = self.samples.image.layout.taps(y, self.radius, 1);
        taps.retain(|tap| self.samples.rows[y.wrapping_add_signed(tap.offset[1])]);
        let reach = self.radius as f32;
        let weigh = |mut tap: Tap| {
            tap.right[0] += self.subpixel[0];
            tap.down += self.subpixel[1];
            let ([x], y) = (tap.right, tap.down);
            let near = x.abs() <= reach && y.abs() <= reach;
            near.then_some((tap, -(x * x + y * y) * scale))
        };
        taps.into_iter().filter_map(weigh).collect()
    }

    /// Weighted means of the pixels from (x, y) on; NaN without similar samples.
    #[inline(always)]
    fn mean<S: Simd>(&self, simd: S, x: usize, y: usize, taps: &[(Tap, f32)]) -> [Lanes<S>; 3] {
        let at = self.samples.image.layout.at(x, y);
        let planes = self.samples.image.planes::<CHANNELS>();
        let sample = Lanes::load_all(simd, planes, at);
        let sampled = sample[OWN].is_finite();
        if self.keep && sampled.all() {
            return [sample[0], sample[1], sample[2]];
        }
        let center = self.guide.center(simd, x, y);
        let mut weight = Lanes::splat(simd, 0.0);
        let mut sums = [weight; 3];
        for &(tap, own) in taps {
            let there = Lanes::load_all(simd, planes, tap.first(at));
            let [likeness] = self.shown.exponents(simd, &center, &tap, [own]);
            let w = exp2_weight(likeness + there[OWN]);
            weight = weight + w;
            for (sum, &there) in sums.iter_mut().zip(&there) {
                *sum = *sum + w * there;
            }
        }
        let any = weight.above(0.0);
        let mut mean = sums;
        for (channel, mean) in mean.iter_mut().enumerate() {
            *mean = (*mean / weight).when_or(any, f32::NAN);
            if self.keep {
                *mean = sample[channel].when_else(sampled, *mean);
            }
        }
        mean
    }
}
