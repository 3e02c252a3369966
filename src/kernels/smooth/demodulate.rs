//! Demodulation: light without texture, so that filters smooth the light and keep the texture.
//!
//!   illumination = (colour − emission) / d,  colour = illumination · d + emission,
//!   d = max(a, f), with the channel's albedo a held to [0, 1] and f = 1/32, where the albedo is a reflectance; else d = 1.
//!
//! [`reflectance`](super::reflectance) decides by surface id whether the albedo is a reflectance; without ids, an albedo
//! with any channel above 0 is one. From f up this divides by the albedo, as Falcor's SVGFPass does from 0.001 up. Most
//! light of a darker surface is not scaled by the albedo: highlights on black plastic, the background behind glass,
//! emission of lamps and sky. Divided by a thousandth, such light is a thousand times too bright, and wherever no guide
//! stops the filter, it leaks to neighbours of ordinary albedo. The bound f limits the gain to 32. An albedo above 1 counts
//! as 1.
//!
//! A smooth transition from f to 1 as albedo falls was tried and lost: it blurs dark texture, and where an albedo changes
//! with the view, the illumination changes as much from frame to frame.
//!
//! Where albedo is 0 or at least 1 and there is no emission, the round trip is exact; elsewhere it is right to one or two
//! units in the last place.
//!
//! Inputs: colour or illumination (3), albedo (3), emission (3, optional), mask (1, optional). NaN and infinity count as 0
//! in albedo and emission and are kept in colour.

use std::ops::Range;

use crate::image::{Pixels, Run, SEGMENT, View, segments};
use crate::math::{larger, smaller};
use crate::pixels::{PixelsMut, Row};
use crate::rows::{self, Kernel, Simd};

/// f: lower bound of the divisor.
const MIN_DIVISOR: f32 = 1.0 / 32.0;

/// The buffers that separate texture from illumination.
#[derive(Clone, Copy)]
pub struct Texture<'a> {
    /// 3 channels, 0 to 1.
    pub albedo: Pixels<'a>,
    /// 3 channels.
    pub emission: Option<Pixels<'a>>,
    /// 0 where the albedo is no reflectance ([`Surfaces::mask`](super::reflectance::Surfaces::mask)).
    pub mask: Option<View<'a, u8>>,
}

/// Direction: divide the texture out, or multiply it back in.
#[derive(Clone, Copy)]
pub enum Way {
    /// Colour becomes light.
    Off,
    /// Light becomes colour.
    Back,
}

/// Colour to illumination, or back.
pub fn modulate<'a>(
    image: Pixels<'a>,
    texture: Texture<'a>,
    way: Way,
    out: impl Iterator<Item = PixelsMut<'a>>,
) {
    let kernel = Modulate {
        image,
        texture,
        way,
    };
    rows::run(&kernel, image.size.height, out);
}

struct Modulate<'a> {
    image: Pixels<'a>,
    texture: Texture<'a>,
    way: Way,
}

impl<'a> Kernel for Modulate<'a> {
    type Out = PixelsMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: PixelsMut<'a>) {
        let mut values = [[0.0; SEGMENT]; 3];
        for run in rows.flat_map(|y| segments(y, self.image.size.width)) {
            self.image
                .read(run, values.each_mut().map(|row| &mut row[..]));
            self.texture.modulate(self.way, run, &mut values);
            out.write(run, &values);
        }
    }
}

impl Texture<'_> {
    /// Demodulates or remodulates a span in place.
    #[inline(always)]
    pub(crate) fn modulate(&self, way: Way, run: Run, values: &mut [Row; 3]) {
        let mut albedo = [[0.0; SEGMENT]; 3];
        self.albedo
            .read(run, albedo.each_mut().map(|row| &mut row[..]));
        match self.mask {
            Some(mask) => masked_divisors(&mut albedo, mask.run(0, run)),
            None => divisors(&mut albedo),
        }
        let mut emission = [[0.0; SEGMENT]; 3];
        if let Some(image) = self.emission {
            image.read(run, emission.each_mut().map(|row| &mut row[..]));
        }
        for ((values, divisors), emission) in values.iter_mut().zip(&albedo).zip(&emission) {
            let (values, divisors) = (&mut values[..run.len], &divisors[..run.len]);
            let emission = &emission[..run.len];
            match (way, self.emission.is_some()) {
                (Way::Off, false) => each(values, divisors, emission, |c, d, _| c / d),
                (Way::Off, true) => each(values, divisors, emission, |c, d, e| (c - e) / d),
                (Way::Back, false) => each(values, divisors, emission, |i, d, _| i * d),
                (Way::Back, true) => each(values, divisors, emission, |i, d, e| i * d + e),
            }
        }
    }
}

#[inline(always)]
fn each(values: &mut [f32], divisors: &[f32], emission: &[f32], f: impl Fn(f32, f32, f32) -> f32) {
    for ((value, &d), &e) in values.iter_mut().zip(divisors).zip(emission) {
        *value = f(*value, d, if e.is_finite() { e } else { 0.0 });
    }
}

/// Replaces each channel's albedo by its divisor d.
#[inline(always)]
fn divisors([r, g, b]: &mut [Row; 3]) {
    for x in 0..SEGMENT {
        let [ar, ag, ab] = [r[x], g[x], b[x]].map(reflectance);
        let least = if ar + ag + ab > 0.0 { MIN_DIVISOR } else { 1.0 };
        (r[x], g[x], b[x]) = (larger(ar, least), larger(ag, least), larger(ab, least));
    }
}

/// [`divisors`] where a mask tells what is a reflectance.
#[inline(always)]
fn masked_divisors(albedo: &mut [Row; 3], mask: &[u8]) {
    for row in albedo {
        for (value, &reflects) in row.iter_mut().zip(mask) {
            let divisor = larger(reflectance(*value), MIN_DIVISOR);
            *value = if reflects != 0 { divisor } else { 1.0 };
        }
    }
}

#[inline(always)]
fn reflectance(albedo: f32) -> f32 {
    let a = if albedo.is_finite() { albedo } else { 0.0 };
    smaller(larger(a, 0.0), 1.0)
}
