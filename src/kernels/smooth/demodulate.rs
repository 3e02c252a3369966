//! Demodulation: light without texture, so that filters smooth the one and keep the other.
//!
//!   illumination = (colour − emission) / max(albedo, 2⁻¹⁰),  colour = illumination · max(albedo, 2⁻¹⁰) + emission.
//!
//! The bound is a power of two, so that where albedo is black (emitters, background, metals) the round trip has the
//! colour's own bits; elsewhere it is right to the last place or two. Falcor's SVGFPass bounds at 0.001.
//!
//! Inputs: colour or illumination, albedo, emission (optional), of the same channels. NaN or infinity in albedo or emission counts
//! as 0, in colour it stays.

use std::ops::Range;

use crate::image::{Pixels, Run, SEGMENT, segments};
use crate::pixels::PixelsMut;
use crate::rows::{self, Kernel};

/// The least albedo that is divided by.
pub const LEAST: f32 = 1.0 / 1024.0;

/// What light falls on.
#[derive(Clone, Copy)]
pub struct Texture<'a> {
    pub albedo: Pixels<'a>,
    pub emission: Option<Pixels<'a>>,
}

/// Whether texture comes off or is put back.
#[derive(Clone, Copy)]
pub enum Way {
    Off,
    Back,
}

/// Illumination of colour, or colour of illumination: of images of `N` channels, texture included.
pub fn modulate<'a, const N: usize>(
    image: Pixels<'a>,
    texture: Texture<'a>,
    way: Way,
    out: impl Iterator<Item = PixelsMut<'a>>,
) {
    let kernel = Modulate::<N> {
        image,
        texture,
        way,
    };
    rows::run(&kernel, image.size.height, out);
}

struct Modulate<'a, const N: usize> {
    image: Pixels<'a>,
    texture: Texture<'a>,
    way: Way,
}

impl<'a, const N: usize> Kernel for Modulate<'a, N> {
    type Out = PixelsMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: PixelsMut<'a>) {
        let mut values = [[0.0; SEGMENT]; N];
        for run in rows.flat_map(|y| segments(y, self.image.size.width)) {
            self.image
                .read(run, values.each_mut().map(|row| &mut row[..]));
            self.texture.modulate(self.way, run, &mut values);
            out.write(run, values.each_ref().map(|row| &row[..]));
        }
    }
}

impl Texture<'_> {
    /// Changes a run's values.
    #[inline(always)]
    pub fn modulate<const N: usize>(&self, way: Way, run: Run, values: &mut [[f32; SEGMENT]; N]) {
        let mut albedo = [[0.0; SEGMENT]; N];
        self.albedo
            .read(run, albedo.each_mut().map(|row| &mut row[..]));
        let mut emission = [[0.0; SEGMENT]; N];
        if let Some(image) = self.emission {
            image.read(run, emission.each_mut().map(|row| &mut row[..]));
        }
        for ((values, albedo), emission) in values.iter_mut().zip(&albedo).zip(&emission) {
            let (values, albedo) = (&mut values[..run.len], &albedo[..run.len]);
            let emission = &emission[..run.len];
            match (way, self.emission.is_some()) {
                (Way::Off, false) => each(values, albedo, emission, |c, a, _| c / a),
                (Way::Off, true) => each(values, albedo, emission, |c, a, e| (c - e) / a),
                (Way::Back, false) => each(values, albedo, emission, |i, a, _| i * a),
                (Way::Back, true) => each(values, albedo, emission, |i, a, e| i * a + e),
            }
        }
    }
}

#[inline(always)]
fn each(values: &mut [f32], albedo: &[f32], emission: &[f32], f: impl Fn(f32, f32, f32) -> f32) {
    for ((value, &a), &e) in values.iter_mut().zip(albedo).zip(emission) {
        let a = if (a > LEAST) & (a < f32::INFINITY) {
            a
        } else {
            LEAST
        };
        *value = f(*value, a, if e.is_finite() { e } else { 0.0 });
    }
}
