//! Fits of the accumulated light to the features of its surfaces, block by block, and their accumulation.
//!
//! Blocks lie elsewhere in every frame, so that their borders average out: the N-th fit of a pixel joins those before with
//! the blend factor max(1/N, fitted_alpha). Emitters are left out of the fits: they shine by themselves, and a block
//! would spread their light as if it fell on its surfaces. Without albedo, light has texture that no feature
//! describes, and smaller blocks blur less of it.

use std::ops::Range;

use super::{FITS, LENGTH, Params};
use crate::image::{BandMut, Image, Pixels, Records, View};
use crate::kernels::merge::blend::{self, Alpha, blend};
use crate::kernels::smooth::regress::{self, Features, regress};
use crate::pixels::PixelsMut;
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

/// An emitter is a pixel whose albedo is no larger.
const BLACK: f32 = 1.0 / 1024.0;

/// Fits the accumulated light; `age` counts the frames of the sequence.
pub fn fit(
    light: Pixels,
    features: Features,
    albedo: Option<Pixels>,
    params: &Params,
    age: usize,
) -> Records {
    let size = light.size;
    let weight = albedo.map(|albedo| {
        let mut weight = Image::blank(size, 1);
        rows::run(&LeaveEmitters(albedo), size.height, weight.bands());
        weight
    });
    let usual = if albedo.is_some() { 16 } else { 8 };
    let block = params.block.unwrap_or(usual);
    let params = regress::Params {
        block,
        offset: OFFSETS[age % OFFSETS.len()].map(|eighths| eighths * block as i64 / 8),
        features: params.features,
    };
    let (mut fit, mut counts) = (Records::blank(size, 3), Image::blank(size, 1));
    let weight = weight.as_ref().map(Image::pixels);
    let (fitted, counts) = (fit.data_mut(), counts.data_mut());
    regress(light, features, weight, params, fitted, counts);
    fit
}

/// Writes a history's fits: a new fit, accumulated with those of the reprojected history.
pub fn accumulate_fits(fit: &Records, known: &Image, least: f32, history: &mut Image) {
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

/// The regression's weights: 1, or NaN for emitters.
struct LeaveEmitters<'a>(Pixels<'a>);

impl<'a> Kernel for LeaveEmitters<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: BandMut<'a>) {
        let width = self.0.size.width;
        for y in rows {
            for (x, weight) in out.row(0, y).iter_mut().enumerate() {
                let [r, g, b] = self.0.vector(y * width + x);
                let reflects = (r > BLACK) | (g > BLACK) | (b > BLACK);
                *weight = if reflects { 1.0 } else { f32::NAN };
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
