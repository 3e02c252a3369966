//! Demodulation: light without texture, so that filters smooth the light and keep the texture.
//!
//!   illumination = (colour − emission) / d,  colour = illumination · d + emission,
//!   d = m + (1 − m) (1 − a / t)²₊,  m = max(a, f),  with the channel's albedo a held to [0, 1], f = 1/64, t = 1/512.
//!
//! From f on this divides by the albedo, as Falcor's SVGFPass does from 0.001 on. What is darker shines mostly by what albedo
//! does not scale: black plastic by its highlights, glass by what is behind it, lamps and the sky by themselves. Divided by
//! a thousandth, such light is a thousand times too bright, and wherever a filter has no guide to stop it, neighbours of
//! ordinary albedo get the excess. The bound f divides by 64 at most. Towards black, where nothing of the light can be told
//! from albedo, d passes smoothly to 1: colour is taken as it is. An albedo above 1 (gold in some renderers, a BSDF's value
//! at one pair of directions in others) is no reflectance and counts as 1.
//!
//! A higher f or t protects more, and flattens less of dark texture: on tiles of 0.003 and 0.75, light that is taken as it is
//! up to 0.1 costs 5 dB.
//!
//! Where albedo is 0 or at least 1, the round trip has the colour's own bits if there is no emission; elsewhere it is right
//! to the last place or two.
//!
//! Inputs: colour or illumination, albedo, emission (optional), of the same channels. NaN or infinity in albedo or emission counts
//! as 0, in colour it stays.

use std::ops::Range;

use crate::image::{Pixels, Run, SEGMENT, segments};
use crate::pixels::{PixelsMut, larger, smaller};
use crate::rows::{self, Kernel};

/// f: the least albedo that is divided by.
const LEAST: f32 = 1.0 / 64.0;

/// t: below, colour is taken more and more as it is.
const BLACK: f32 = 1.0 / 512.0;

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
        *value = f(*value, divisor(a), if e.is_finite() { e } else { 0.0 });
    }
}

/// d: what light is divided by, from f to 1.
#[inline(always)]
fn divisor(albedo: f32) -> f32 {
    let a = if albedo.is_finite() { albedo } else { 0.0 };
    let a = smaller(larger(a, 0.0), 1.0);
    let least = larger(a, LEAST);
    let black = larger(1.0 - a * (1.0 / BLACK), 0.0);
    least + (1.0 - least) * (black * black)
}
