//! Fits of the accumulated light to the features of its surfaces, block by block, and their accumulation.
//!
//! Blocks lie elsewhere in every frame, so that their borders average out: the N-th fit of a pixel joins those before
//! with the blend factor max(1/N, fitted_alpha). Emitters are left out of the fits: they shine by themselves, and a
//! block would spread their light as if it fell on its surfaces. They are pixels with black albedo that have emission,
//! or whose light has no noise: √(m₂ − m₁²) ≤ m₁/10. Glass and mirrors, which renderers give black albedo as well, show
//! noisy light. Without albedo, light has texture that no feature describes, and smaller blocks blur less of it.
//! Emitters cannot be told then, and are fitted together with the dark around them, as are highlights and lamps whose
//! albedo is not black. Bright light therefore weighs less:
//!   w = 1 / (1 + x)²,  x = l / 2e without albedo, (l / 16e)² with it,
//! with l the mean luminance of the accumulated light over 3×3 pixels and e its exposure. The mean keeps bright noise from
//! being held down by itself. What new samples differ from the output by counts by the same weight when they correct it:
//! a lamp is far above a fit in which it weighs little, and its glow would come back through the blocks of the innovation.
//!
//! Highlights of a dark surface, and emission that no buffer tells, are divided by its small albedo although they do not
//! scale with it, and then outshine the light of the surfaces around. Where demodulation divides by d < 0.15, with 1/d the
//! luminance of 1/albedo, a pixel therefore weighs (d / 0.15)²: squared errors count as they do in colour. Without emission,
//! signs and screens on dark surfaces gain 2 to 4 dB (`neon_corridor`, `television`), and `black_plastic` gains 0.5 dB.
//!
//! The output is the fit plus the detail by which the accumulated light differs from it beyond noise
//! ([`restore_detail`]). The variance of the accumulated light is (m₂ − m₁²)/N, known from [`LEAST`] samples on. History is
//! first clipped to the range of the 3×3 new samples: without guide buffers it may belong to another surface. Where light
//! has a part in the weights, what the clipped light k exceeds both the own new sample y and the fit f by counts less, too:
//!   k ← b + (k − b) / (1 + x / 8)² if k > b,  b = max(y, f).
//! Resampled history beside a lamp contains some of it, and the range of the samples the lamp; a lamp's own samples are as
//! bright as it is. With the whole of x, all bright surfaces lose detail: up to 9 % FLIP in `glass_shelf`.
//!
//! The innovation corrects output and fits, and the accumulated light from [`LEAST`] samples on. Where there are fewer, no
//! detail of it is shown: what is wrong is the fit. If it is corrected nevertheless, light beside lamps becomes black, the
//! temporal gradient takes the next samples for a change, and the history stays too young to show detail: without emission,
//! `cornell_box` loses 4 dB.

use std::ops::Range;

use super::{FITS, LENGTH, LIGHT, MOMENTS};
use crate::box_sums::box_sums;
use crate::image::{BandMut, Image, Interleaved, Pixels, SEGMENT, View, segments};
use crate::kernels::judge::neighborhood::{self, Bounds, Response, Space, clip_history};
use crate::kernels::judge::repetition::luminances;
use crate::kernels::merge::blend::{self, Alpha, blend};
use crate::kernels::smooth::demodulate::{Texture, Way};
use crate::kernels::smooth::regress::{self, Features, regress};
use crate::kernels::smooth::restore::{self, restore_detail};
use crate::math::{larger, luminance};
use crate::pixels::{Colors, PixelsMut};
use crate::rows::{self, Kernel, Simd};

/// The blocks' offset, frame by frame, in eighths of their side.
const OFFSETS: [[i64; 2]; 8] = [
    [0, 0],
    [4, 4],
    [2, 6],
    [6, 2],
    [1, 3],
    [5, 7],
    [3, 1],
    [7, 5],
];

/// An emitter is a pixel whose albedo is no larger,
const BLACK: f32 = 1.0 / 1024.0;
/// and whose light varies no more, relative to the square of its mean.
const QUIET: f32 = 0.01;
/// The albedo below which surfaces count less in a fit.
const DARK: f32 = 0.15;

/// Samples from which the moments tell the variance. Not a whole number, so that rounding of resampled lengths does not decide.
pub const LEAST: f32 = 3.5;

/// The history is clipped to the range of 3×3 samples.
const RANGE: neighborhood::Params = neighborhood::Params {
    bounds: Bounds::MinMax,
    space: Space::Rgb,
    response: Response::Clamp,
    gamma: 1.0,
    radius: 1,
    exposure: 1.0,
};

/// What each pixel of the accumulated light, whose exposure is `bright`, counts by its brightness.
pub fn by_light(light: Pixels, bright: f32, textured: bool) -> Image {
    let luminance = luminances(light);
    let kernel = ByLight {
        luminance: luminance.view(),
        bright,
        textured,
    };
    let mut weight = Image::blank(light.size, 1);
    rows::run(&kernel, light.size.height, weight.bands());
    weight
}

/// Weights of a fit by texture: NaN for emitters, which it leaves out, elsewhere `weight`, or 1, and less for dark surfaces.
pub fn by_texture(texture: Texture, history: &Image, weight: Option<View>) -> Image {
    let size = texture.albedo.size;
    let mut weights = Image::blank(size, 1);
    let kernel = ByTexture {
        texture,
        moments: history.channels(MOMENTS),
        weight,
    };
    rows::run(&kernel, size.height, weights.bands());
    weights
}

/// Fits the accumulated light in blocks of a side in pixels; `age` counts the frames of the sequence.
pub fn fit(
    light: Pixels,
    features: Features,
    weight: Option<Pixels>,
    choice: regress::Choice,
    block: usize,
    age: usize,
) -> Interleaved {
    let params = regress::Params {
        block,
        offset: OFFSETS[age % OFFSETS.len()].map(|eighths| eighths * block as i64 / 8),
        features: choice,
    };
    let (mut fit, mut counts) = (
        Interleaved::blank(light.size, 3),
        Image::blank(light.size, 1),
    );
    let (fitted, counts) = (fit.data_mut(), counts.data_mut());
    regress(light, features, weight, params, fitted, counts);
    fit
}

/// Writes a history's fits: a new fit, accumulated with those of the reprojected history.
pub fn accumulate_fits(fit: &Interleaved, known: &Image, least: f32, history: &mut Image) {
    let size = fit.size;
    let mut factor = Image::blank(size, 1);
    let kernel = Factor {
        length: history.channels(LENGTH),
        least,
    };
    rows::run(&kernel, size.height, factor.bands());
    let fits = &mut history.data_mut()[FITS.start * size.pixels()..];
    let (known, out) = (known.pixels().part(FITS), PixelsMut::planar(size, fits));
    blend(
        fit.pixels(),
        known,
        Alpha::Map(factor.view()),
        blend::Params::PLAIN,
        out,
    );
}

/// The accumulated fits, with the detail of the accumulated light restored. `weight` is that of [`by_light`], if it is used.
pub fn restored(
    history: &Image,
    fresh: Pixels,
    weight: Option<View>,
    params: restore::Params,
) -> Image {
    let size = history.size;
    let all = history.pixels();
    let mut noisy = Image::blank(size, 3);
    clip_history(all.part(LIGHT), fresh, RANGE, noisy.pixels_mut());
    if let Some(weight) = weight {
        let hold = Hold {
            fresh,
            fit: history.channels(FITS),
            weight,
        };
        rows::run(&hold, size.height, noisy.bands());
    }
    let mut variance = Image::blank(size, 1);
    rows::run(
        &VarianceOfMean(history.view()),
        size.height,
        variance.bands(),
    );
    let mut restored = Image::blank(size, 3);
    let (smooth, noisy) = (all.part(FITS), noisy.pixels());
    let out = restored.pixels_mut();
    restore_detail(smooth, noisy, variance.view(), params, out);
    restored
}

/// Holds down light that is brighter than its fit and its new sample, in place.
struct Hold<'a> {
    fresh: Pixels<'a>,
    fit: View<'a>,
    weight: View<'a>,
}

impl<'a> Kernel for Hold<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut light: BandMut<'a>) {
        let mut fresh = [[0.0; SEGMENT]; 3];
        for run in rows.flat_map(|y| segments(y, self.fit.size.width)) {
            self.fresh.colors(run, &mut fresh);
            let span = run.x..run.x + run.len;
            let weight = &self.weight.row(0, run.y)[span.clone()];
            for (channel, fresh) in fresh.iter().enumerate() {
                let fit = &self.fit.row(channel, run.y)[span.clone()];
                let light = &mut light.row(channel, run.y)[span.clone()];
                for (i, light) in light.iter_mut().enumerate() {
                    let bound = if fresh[i] > fit[i] { fresh[i] } else { fit[i] };
                    let toned = 1.0 + (1.0 / weight[i].sqrt() - 1.0) / 8.0;
                    let held = bound + (*light - bound) / (toned * toned);
                    // What has no fit stays as it is.
                    let holds = (*light > bound) & held.is_finite();
                    *light = if holds { held } else { *light };
                }
            }
        }
    }
}

/// Writes the variance of the accumulated luminance; NaN where history is too short to tell.
struct VarianceOfMean<'a>(View<'a>);

impl<'a> Kernel for VarianceOfMean<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: BandMut<'a>) {
        for y in rows {
            let [first, second, length] = [MOMENTS.start, MOMENTS.start + 1, LENGTH.start]
                .map(|channel| self.0.row(channel, y));
            for (x, variance) in out.row(0, y).iter_mut().enumerate() {
                let one = larger(second[x] - first[x] * first[x], 0.0);
                *variance = if length[x] >= LEAST {
                    one / length[x]
                } else {
                    f32::NAN
                };
            }
        }
    }
}

/// Writes weights that are less where light is bright.
struct ByLight<'a> {
    /// Of the accumulated light.
    luminance: View<'a>,
    /// Its exposure.
    bright: f32,
    textured: bool,
}

impl<'a> Kernel for ByLight<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: BandMut<'a>) {
        let width = self.luminance.size.width;
        let (mut columns, mut numbers) = (vec![], vec![0.0; width]);
        let counts = |v: f32| (0.0..f32::INFINITY).contains(&v);
        let positive = |v: f32| if counts(v) { v } else { 0.0 };
        let one = |v: f32| if counts(v) { 1.0 } else { 0.0 };
        let brighter = if self.textured { 16.0 } else { 2.0 } * self.bright;
        for y in rows {
            let weights = out.row(0, y);
            box_sums(self.luminance, 0, y, 1, positive, &mut columns, weights);
            box_sums(self.luminance, 0, y, 1, one, &mut columns, &mut numbers);
            for (weight, number) in weights.iter_mut().zip(&numbers) {
                let mean = *weight / number.max(1.0);
                let times = mean / brighter;
                let toned = 1.0 + if self.textured { times * times } else { times };
                *weight = 1.0 / (toned * toned);
            }
        }
    }
}

/// Writes NaN for emitters, and elsewhere the weights of light, less for dark surfaces.
struct ByTexture<'a> {
    texture: Texture<'a>,
    moments: View<'a>,
    weight: Option<View<'a>>,
}

impl<'a> Kernel for ByTexture<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: BandMut<'a>) {
        let Texture {
            albedo, emission, ..
        } = self.texture;
        let reflectance = Texture {
            emission: None,
            ..self.texture
        };
        for run in rows.flat_map(|y| segments(y, albedo.size.width)) {
            let span = run.x..run.x + run.len;
            let weights = &mut out.row(0, run.y)[span.clone()];
            match self.weight {
                Some(weight) => weights.copy_from_slice(&weight.row(0, run.y)[span.clone()]),
                None => weights.fill(1.0),
            }
            let begin = run.y * albedo.size.width + run.x;
            let [first, second] =
                [0, 1].map(|channel| &self.moments.row(channel, run.y)[span.clone()]);
            let mut magnified = [[1.0; SEGMENT]; 3];
            reflectance.modulate(Way::Off, run, &mut magnified);
            let [r, g, b] = &magnified;
            for (i, weight) in weights.iter_mut().enumerate() {
                let exceeds = |[r, g, b]: [f32; 3], least| (r > least) | (g > least) | (b > least);
                let reflects = exceeds(albedo.vector(begin + i), BLACK);
                let emits = emission.is_some_and(|image| exceeds(image.vector(begin + i), 0.0));
                let square = first[i] * first[i];
                let noisy = second[i] - square > QUIET * square;
                let dark = larger(DARK * luminance(r[i], g[i], b[i]), 1.0);
                *weight = if reflects | (noisy & !emits) {
                    *weight * (1.0 / (dark * dark))
                } else {
                    f32::NAN
                };
            }
        }
    }
}

/// The blend factor of the N-th fit.
struct Factor<'a> {
    length: View<'a>,
    least: f32,
}

impl<'a> Kernel for Factor<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: BandMut<'a>) {
        for y in rows {
            for (factor, &length) in out.row(0, y).iter_mut().zip(self.length.row(0, y)) {
                *factor = self.least.max(1.0 / length);
            }
        }
    }
}
