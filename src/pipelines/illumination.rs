//! A frame's illumination: its samples with the texture divided out ([`crate::kernels::smooth::demodulate`]).

use super::frame::Frame;
use crate::image::{Image, Pixels, Run};
use crate::kernels::fetch::validate::Surface;
use crate::kernels::smooth::demodulate::{Texture, Way, modulate};
use crate::kernels::smooth::fireflies::{self, suppress_fireflies};
use crate::kernels::smooth::guide::Guide;
use crate::kernels::smooth::reflectance::Surfaces;
use crate::pixels::{Colors, Row};

/// Demodulated when it is read.
#[derive(Clone, Copy)]
pub struct Illumination<'a> {
    color: Pixels<'a>,
    texture: Option<Texture<'a>>,
}

impl<'a> Illumination<'a> {
    pub fn of(color: Pixels<'a>, texture: Option<Texture<'a>>) -> Self {
        Self { color, texture }
    }
}

impl Colors for Illumination<'_> {
    #[inline(always)]
    fn colors(&self, run: Run, into: &mut [Row; 3]) {
        self.color.colors(run, into);
        if let Some(texture) = &self.texture {
            texture.modulate(Way::Off, run, into);
        }
    }
}

pub fn texture<'a>(frame: &Frame<'a>, surfaces: Option<&'a Surfaces>) -> Option<Texture<'a>> {
    frame.albedo.map(|albedo| Texture {
        albedo,
        emission: frame.emission,
        mask: surfaces.map(Surfaces::mask),
    })
}

pub fn illumination(color: Pixels, texture: Option<Texture>) -> Image {
    match texture {
        Some(texture) => modulated(color, texture, Way::Off),
        None => color.to_planes(),
    }
}

/// An image with its texture divided out, or put back.
pub fn modulated(image: Pixels, texture: Texture, way: Way) -> Image {
    let mut result = Image::blank(image.size, 3);
    modulate(image, texture, way, result.pixels_mut());
    result
}

/// Illumination without fireflies. They are held down and spread in what is seen: with texture, but without emission. `known`
/// is the history's illumination; the guide must reach as far as the window of `params`.
pub fn without_fireflies(
    illumination: &Image,
    known: Option<Pixels>,
    texture: Option<Texture>,
    guide: &Guide,
    params: fireflies::Params,
) -> Image {
    let Some(texture) = texture else {
        return held_down(illumination.pixels(), known, guide, params);
    };
    let texture = Texture {
        emission: None,
        ..texture
    };
    let seen = modulated(illumination.pixels(), texture, Way::Back);
    let expected = known.map(|known| modulated(known, texture, Way::Back));
    let expected = expected.as_ref().map(Image::pixels);
    let held = held_down(seen.pixels(), expected, guide, params);
    modulated(held.pixels(), texture, Way::Off)
}

/// Samples without fireflies, as they are seen. `known` is the history's colour.
pub fn samples_without_fireflies(
    samples: Pixels,
    known: Option<Pixels>,
    surface: Surface,
    params: fireflies::Params,
) -> Image {
    let guide = Guide::new(samples.size, params.radius, surface, None);
    held_down(samples, known, &guide, params)
}

fn held_down(
    seen: Pixels,
    expected: Option<Pixels>,
    guide: &Guide,
    params: fireflies::Params,
) -> Image {
    let mut held = Image::blank(seen.size, 3);
    suppress_fireflies(seen, expected, guide, params, held.pixels_mut());
    held
}
