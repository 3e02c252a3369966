//! Firefly suppression: samples far brighter than their surroundings are clamped, and their excess is redistributed.
//!
//! The limit comes from the weighted mean and standard deviation of luminance over the window, with guide weights w
//! ([`super::guide`]). The centre is left out, so that a firefly does not raise its own limit:
//!   limit = max(mean + t·deviation, (1 + t)·expected)
//! (NRD's anti-firefly has a 9×9 window and t = 2). `expected` is the luminance of history at the pixel: a sample that
//! history predicts, such as a highlight, is not a firefly. Discarding the excess e = l − limit would darken the image,
//! so it is distributed, in its own colour, over the window's pixels of the same surface, the centre included:
//!   out_q = c_q (1 − e_q / l_q) + Σ_p w_qp c_p (e_p / l_p) / W_p,   W_p = Σ_q w_pq.
//!
//! To be used before demodulation: spread as illumination, the excess of a dark texture would be multiplied by the
//! albedo of its brighter neighbours.
//!
//! Inputs: colour (3), expected colour (3, optional), guide. Outputs: colour (3), removed luminance (1): e. Missing
//! pixels stay missing, do not count and receive nothing. Where the weights without the centre sum to less than two
//! pixels, there is no limit.

use std::ops::Range;

use super::guide::{Comparison, Guide, Sigmas};
use crate::bordered::{Bordered, BorderedBand};
use crate::error::{Result, Whole, finite_from_0, whole};
use crate::image::{BandMut, Image, Pixels, Run, SEGMENT, segments};
use crate::lanes::Lanes;
use crate::math::{exp2_weight, is_present, luminance};
use crate::pixels::PixelsMut;
use crate::rows::{self, Kernel, Simd};

/// What counts as a firefly, and what becomes of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// t: standard deviations above the mean; ≥ 0; 2.
    pub threshold: f32,
    /// Radius of the window in pixels; 1 to 16; 4.
    pub radius: usize,
    /// True if the excess is redistributed, false if it is discarded; true.
    pub redistribute: bool,
    /// How far surfaces may differ.
    pub sigmas: Sigmas,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            threshold: 2.0,
            radius: 4,
            redistribute: true,
            sigmas: Sigmas::default(),
        }
    }
}

impl Params {
    pub(crate) fn radius(value: impl Whole<usize>) -> Result<usize> {
        whole("radius", value, "1 to 16 pixels", |n| (1..=16).contains(n))
    }

    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        Self::radius(self.radius)?;
        finite_from_0("threshold", self.threshold)?;
        self.sigmas.check()
    }
}

/// Tolerance of the limit: rounding must not turn equal pixels into fireflies.
const SLACK: f32 = 1.000_01;

/// Smallest sum of weights, in pixels, that sets a limit.
const MIN_WEIGHT: f32 = 2.0;

/// Writes the colours and returns the removed luminance. The guide must have a halo of the radius.
pub fn suppress_fireflies<'a>(
    color: Pixels<'a>,
    expected: Option<Pixels<'a>>,
    guide: &Guide,
    params: Params,
    held: impl Iterator<Item = PixelsMut<'a>>,
) -> Image {
    let size = color.size;
    let mut seen = Bordered::new(guide.layout, [0.0, 0.0, 0.0, 0.0, f32::NEG_INFINITY]);
    rows::run(&Load(color), size.height, seen.bands());
    let mut found = Found {
        removed: Image::blank(size, 1),
        kept: Image::blank(size, 1),
        excesses: Bordered::new(guide.layout, [0.0; 3]),
        any: vec![false; size.height],
    };
    let find = Find {
        seen: &seen,
        expected,
        guide: guide.compare(&params.sigmas, params.radius),
        params,
    };
    let outs = (found.removed.bands())
        .zip(found.kept.bands())
        .zip(found.excesses.bands())
        .zip(found.any.chunks_mut(rows::BAND))
        .map(|(((removed, kept), excesses), any)| FoundBand {
            removed,
            kept,
            excesses,
            any,
        });
    rows::run(&find, size.height, outs);
    let spread = Spread {
        seen: &seen,
        found: &found,
        guide: guide.compare(&params.sigmas, params.radius),
        params,
        color,
    };
    rows::run(&spread, size.height, held);
    found.removed
}

/// Channels of the input with a halo: colour and luminance, 0 where missing, then log₂ of each pixel's validity: 0 or
/// −∞.
const CHANNELS: usize = 5;
const LUMINANCE: usize = 3;
const OWN: usize = 4;

struct Load<'a>(Pixels<'a>);

impl<'a> Kernel for Load<'a> {
    type Out = BorderedBand<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut seen: BorderedBand<'a>) {
        let mut color = [[0.0; SEGMENT]; 3];
        for run in rows.flat_map(|y| segments(y, self.0.size.width)) {
            self.0.read_rows(run, &mut color);
            let [r, g, b] = color.each_ref().map(|row| &row[..run.len]);
            let [or, og, ob, light, own] =
                (seen.rows::<CHANNELS>(run.y)).map(|row| &mut row[run.x..][..run.len]);
            for x in 0..run.len {
                let present = is_present([r[x], g[x], b[x]]);
                let keep = |c: f32| if present { c } else { 0.0 };
                (or[x], og[x], ob[x]) = (keep(r[x]), keep(g[x]), keep(b[x]));
                light[x] = luminance(or[x], og[x], ob[x]);
                own[x] = if present { 0.0 } else { f32::NEG_INFINITY };
            }
        }
    }
}

/// The fireflies of an image.
struct Found {
    /// e: the luminance above the limit.
    removed: Image,
    /// limit / l: the factor on a firefly's own colour; 1 for other pixels.
    kept: Image,
    /// c (e / l) / W: the excess that a pixel scatters, per unit of guide weight; with a halo.
    excesses: Bordered,
    /// True for rows with at least one firefly.
    any: Vec<bool>,
}

struct FoundBand<'a> {
    removed: BandMut<'a>,
    kept: BandMut<'a>,
    excesses: BorderedBand<'a>,
    any: &'a mut [bool],
}

struct Find<'a> {
    seen: &'a Bordered,
    expected: Option<Pixels<'a>>,
    guide: Comparison<'a>,
    params: Params,
}

impl<'a> Kernel for Find<'a> {
    type Out = FoundBand<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, simd: S, rows: Range<usize>, mut out: FoundBand<'a>) {
        let layout = self.seen.layout;
        let planes = self.seen.planes::<CHANNELS>();
        let mut predicted = vec![0.0; layout.size.width + Lanes::<S>::COUNT];
        for (y, any) in rows::lines(rows, out.any, 1) {
            self.predict(y, &mut predicted);
            let taps = layout.taps(y, self.params.radius, 1);
            let (removed, kept) = (out.removed.row(0, y), out.kept.row(0, y));
            let [gr, gg, gb] = out.excesses.rows(y);
            for x in (0..removed.len()).step_by(Lanes::<S>::COUNT) {
                let at = layout.at(x, y);
                let center = self.guide.center(simd, x, y);
                let zero = Lanes::splat(simd, 0.0);
                let (mut count, mut first, mut second) = (zero, zero, zero);
                for tap in &taps {
                    if tap.first(at) == at {
                        continue;
                    }
                    let own = Lanes::load(simd, planes[OWN], tap.first(at));
                    let light = Lanes::load(simd, planes[LUMINANCE], tap.first(at));
                    let [likeness] = self.guide.exponents(simd, &center, tap, [0.0]);
                    let w = exp2_weight(likeness + own);
                    let weighted = w * light;
                    count = count + w;
                    first = first + weighted;
                    second = second + weighted * light;
                }
                let [r, g, b, light, own] = Lanes::load_all(simd, planes, at);
                let mean = first / count;
                let variance = at_least_zero(second / count - mean * mean);
                let ring = mean + variance.sqrt() * self.params.threshold;
                let expected = Lanes::load(simd, &predicted, x) * (1.0 + self.params.threshold);
                let limit = ring.when_else((ring - expected).at_least(0.0), expected) * SLACK;
                // No limit where the squares overflow; no excess where luminance is not positive.
                let limited = (count.at_least(MIN_WEIGHT))
                    .and(limit.is_finite())
                    .and(second.is_finite())
                    .and(light.above(0.0))
                    .and(own.is_finite());
                let excess = at_least_zero(light - limit).when_or(limited, 0.0);
                excess.store(removed, x);
                let firefly = excess.above(0.0);
                (limit / light).when_or(firefly, 1.0).store(kept, x);
                any[0] |= !(excess * -1.0).at_least(0.0).all();
                let fraction = (excess / light).when_or(firefly, 0.0) / (count + 1.0);
                (r * fraction).store(gr, x);
                (g * fraction).store(gg, x);
                (b * fraction).store(gb, x);
            }
        }
    }
}

impl Find<'_> {
    /// The expected luminance of a row; 0 where missing.
    #[inline(always)]
    fn predict(&self, y: usize, predicted: &mut [f32]) {
        let Some(expected) = self.expected else {
            return;
        };
        let mut color = [[0.0; SEGMENT]; 3];
        for run in segments(y, expected.size.width) {
            expected.read_rows(run, &mut color);
            let [r, g, b] = color.each_ref().map(|row| &row[..run.len]);
            for (x, predicted) in predicted[run.x..][..run.len].iter_mut().enumerate() {
                let color = [r[x], g[x], b[x]];
                let light = luminance(r[x], g[x], b[x]);
                *predicted = if is_present(color) { light } else { 0.0 };
            }
        }
    }
}

#[inline(always)]
fn at_least_zero<S: Simd>(x: Lanes<S>) -> Lanes<S> {
    x.when_or(x.above(0.0), 0.0)
}

/// Clamps fireflies and gathers the excess of their neighbours.
struct Spread<'s, 'a> {
    seen: &'s Bordered,
    found: &'s Found,
    guide: Comparison<'s>,
    params: Params,
    color: Pixels<'a>,
}

impl<'a> Kernel for Spread<'_, 'a> {
    type Out = PixelsMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, simd: S, rows: Range<usize>, mut out: PixelsMut<'a>) {
        let layout = self.seen.layout;
        let width = layout.size.width;
        let planes = self.seen.planes::<CHANNELS>();
        let excesses = self.found.excesses.planes::<3>();
        let kept = self.found.kept.view();
        let mut held = [(); 3].map(|()| vec![0.0; width + Lanes::<S>::COUNT]);
        for y in rows {
            let mut taps = layout.taps(y, self.params.radius, 1);
            taps.retain(|tap| self.found.any[y.wrapping_add_signed(tap.offset[1])]);
            let kept = kept.row(0, y);
            for x in (0..width).step_by(Lanes::<S>::COUNT) {
                let at = layout.at(x, y);
                let color = Lanes::load_all(simd, [planes[0], planes[1], planes[2]], at);
                let kept = Lanes::load_around(simd, kept, x as isize, 1.0);
                let mut sums = color.map(|c| c * kept);
                if self.params.redistribute && !taps.is_empty() {
                    let center = self.guide.center(simd, x, y);
                    for tap in &taps {
                        let [likeness] = self.guide.exponents(simd, &center, tap, [0.0]);
                        let w = exp2_weight(likeness);
                        let there = Lanes::load_all(simd, excesses, tap.first(at));
                        for (sum, excess) in sums.iter_mut().zip(there) {
                            *sum = *sum + w * excess;
                        }
                    }
                }
                for (held, sum) in held.iter_mut().zip(sums) {
                    sum.store(held, x);
                }
            }
            self.write(y, &held, &mut out);
        }
    }
}

impl Spread<'_, '_> {
    /// Writes a row; missing pixels keep their bits.
    #[inline(always)]
    fn write(&self, y: usize, held: &[Vec<f32>; 3], out: &mut PixelsMut) {
        let mut color = [[0.0; SEGMENT]; 3];
        for run in segments(y, self.color.size.width) {
            let Run { x, len, .. } = run;
            self.color.read_rows(run, &mut color);
            for i in 0..len {
                let present = is_present([color[0][i], color[1][i], color[2][i]]);
                for channel in 0..3 {
                    let (own, held) = (color[channel][i], held[channel][x + i]);
                    color[channel][i] = if present { held } else { own };
                }
            }
            out.write(run, &color);
        }
    }
}
