//! Demodulation: light without texture, so that filters smooth the light and keep the texture.
//!
//!   illumination = (colour − emission) / d,  colour = illumination · d + emission,
//!   d = a + (1 − a) (1 − a / t)²  for a < t,  d = a  for t ≤ a ≤ 1,  with the channel's albedo a held to [0, 1], t = 0.1.
//!
//! From t on this is Falcor's SVGFPass without its bound of 0.001. What is darker than t is mostly lit by something that
//! albedo does not scale: by its highlights if it is black plastic, by what is behind it if it is glass, by itself if it is a
//! lamp or the sky. Divided by a, that light would be up to a thousand times too bright, and a filter would hand the excess
//! to neighbours of ordinary albedo. So d passes smoothly to 1, where colour is taken as it is: no light is ever multiplied by
//! more than about 1 / t. The passage is steep enough that texture above t / 2 is still flattened. An albedo above 1 (gold in
//! some renderers, a BSDF's value at one pair of directions in others) is no reflectance and counts as 1.
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

/// t: from here to 1, light is divided by the albedo itself.
const DARK: f32 = 0.1;

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

/// d: what light is divided by, from nearly t to 1.
#[inline(always)]
fn divisor(albedo: f32) -> f32 {
    let a = if albedo.is_finite() { albedo } else { 0.0 };
    let a = smaller(larger(a, 0.0), 1.0);
    let dark = larger(1.0 - a * (1.0 / DARK), 0.0);
    a + (1.0 - a) * (dark * dark)
}
