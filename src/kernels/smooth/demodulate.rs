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

use crate::image::{BandMut, Image, View};
use crate::rows::{self, Kernel};

/// The least albedo that is divided by.
const LEAST: f32 = 1.0 / 1024.0;

struct Modulate<'a> {
    image: View<'a>,
    albedo: View<'a>,
    emission: Option<View<'a>>,
    back: bool,
}

/// Illumination of a colour image.
pub fn demodulate(color: View, albedo: View, emission: Option<View>) -> Image {
    modulate(Modulate {
        image: color,
        albedo,
        emission,
        back: false,
    })
}

/// Colour of an illumination image.
pub fn remodulate(illumination: View, albedo: View, emission: Option<View>) -> Image {
    modulate(Modulate {
        image: illumination,
        albedo,
        emission,
        back: true,
    })
}

fn modulate(kernel: Modulate) -> Image {
    let mut out = Image::new(kernel.image.size, kernel.image.channels);
    rows::run(&kernel, kernel.image.size.height, out.bands());
    out
}

impl<'a> Kernel for Modulate<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: BandMut<'a>) {
        for y in rows {
            for channel in 0..self.image.channels {
                let out = out.row(channel, y);
                let image = self.image.row(channel, y);
                let albedo = self.albedo.row(channel, y);
                match (
                    self.emission.map(|emission| emission.row(channel, y)),
                    self.back,
                ) {
                    (None, false) => each(out, image, albedo, albedo, |c, a, _| c / a),
                    (None, true) => each(out, image, albedo, albedo, |i, a, _| i * a),
                    (Some(emission), false) => {
                        each(out, image, albedo, emission, |c, a, e| (c - e) / a)
                    }
                    (Some(emission), true) => {
                        each(out, image, albedo, emission, |i, a, e| i * a + e)
                    }
                }
            }
        }
    }
}

#[inline(always)]
fn each(
    out: &mut [f32],
    image: &[f32],
    albedo: &[f32],
    emission: &[f32],
    f: impl Fn(f32, f32, f32) -> f32,
) {
    for (((out, &c), &a), &e) in out.iter_mut().zip(image).zip(albedo).zip(emission) {
        let a = if (a > LEAST) & (a < f32::INFINITY) {
            a
        } else {
            LEAST
        };
        *out = f(c, a, if e.is_finite() { e } else { 0.0 });
    }
}
