//! The last sweep: the innovation corrects the filtered light and the history behind it, and the texture is put back.

use std::ops::Range;

use super::passes::Passes;
use super::{Current, Shown};
use crate::image::{
    BandMut, Image, Interleaved, Pixels, Run, SEGMENT, View, plane_bands, segments,
};
use crate::kernels::judge::innovation::{Innovation, corrected};
use crate::kernels::smooth::demodulate::{Texture, Way};
use crate::pipelines::correction::correct_run;
use crate::pipelines::frame::{Frame, blacken_missing};
use crate::pipelines::taa::{Input, Others, Stage};
use crate::pixels::{Colors, PixelsMut, Row};
use crate::rows::{self, Kernel, Simd};

/// Corrects history, and the light in which reflections are looked for, in place. Writes colour and variance if the frame is
/// shown. The output stage comes with the motion that it follows, if that is not the frame's; `confidence` is the history's.
pub fn finish(
    now: &Current,
    passes: Passes,
    innovation: Option<&Innovation>,
    history: &mut Interleaved,
    light: Option<&mut Interleaved>,
    antialias: Option<(&mut Stage, Option<Pixels>)>,
    confidence: View,
    shown: Option<&mut Shown>,
) {
    let size = now.size();
    let parts = shown.map(|shown| (&mut *shown.color, &mut *shown.variance));
    let (mut show, variance) = parts.unzip();
    let kernel = Finish {
        passes: &passes,
        innovation,
        texture: now.texture,
        // The output stage fills them with what it remembers.
        blacken: antialias.is_none(),
    };
    let mut aliased = (antialias.is_some()).then(|| Image::blank(size, 3));
    let colors: Option<Vec<_>> = match (&mut aliased, &mut show) {
        (Some(image), _) => Some(image.pixels_mut().collect()),
        (None, Some(color)) => Some(PixelsMut::bands(size, 3, color).collect()),
        (None, None) => None,
    };
    let colors = rows::optional(colors.map(Vec::into_iter));
    let variances = rows::optional(variance.map(|variance| plane_bands(variance, size)));
    let lights = rows::optional(light.map(|light| light.pixels_mut()));
    let outs = colors.zip(variances).zip(history.pixels_mut()).zip(lights);
    let outs = outs.map(|(((color, variance), history), light)| Outs {
        color,
        variance,
        history,
        light,
    });
    rows::run(&kernel, size.height, outs);
    // The next images take its place.
    drop(passes);
    if let Some((((stage, seen), color), show)) = antialias.zip(aliased).zip(show) {
        let frame = Frame {
            motion: seen.or(now.frame.motion),
            ..*now.frame
        };
        let motion = seen.unwrap_or(now.motion.pixels());
        let corrects = now.params.history.innovation.is_some();
        let others = Others::by_confidence(confidence);
        let input = Input {
            averaged: now.averages && now.frame.albedo.is_none(),
            ..Input::denoised(color.pixels(), corrects, now.repeats, others)
        };
        stage.show(&frame, now.before.as_ref(), motion, input, show);
    }
}

struct Finish<'a> {
    passes: &'a Passes,
    innovation: Option<&'a Innovation>,
    texture: Option<Texture<'a>>,
    /// Whether pixels of which neither history nor neighbours know anything become black.
    blacken: bool,
}

/// A band of each output.
struct Outs<'a> {
    color: Option<PixelsMut<'a>>,
    variance: Option<BandMut<'a>>,
    history: PixelsMut<'a>,
    light: Option<PixelsMut<'a>>,
}

impl<'a> Kernel for Finish<'a> {
    type Out = Outs<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: Outs<'a>) {
        let mut color = [[0.0; SEGMENT]; 3];
        let mut line = self.innovation.map(Innovation::line);
        let width = self.passes.size().width;
        for y in rows {
            if let Some(variance) = &mut out.variance {
                variance.row(0, y).copy_from_slice(self.passes.variance(y));
            }
            if let Some((innovation, line)) = self.innovation.zip(line.as_mut()) {
                innovation.go_to(y, line);
            }
            for run in segments(y, width) {
                self.passes.colors(run, &mut color);
                if let Some((innovation, line)) = self.innovation.zip(line.as_ref())
                    && innovation.corrects(line, run)
                {
                    let correction = innovation.correction(line, run, &color);
                    out.correct(run, &mut color, &correction);
                }
                let Some(shown) = &mut out.color else {
                    continue;
                };
                if let Some(texture) = &self.texture {
                    texture.modulate(Way::Back, run, &mut color);
                }
                if self.blacken {
                    color.iter_mut().for_each(|row| blacken_missing(row));
                }
                shown.write(run, &color);
            }
        }
    }
}

impl Outs<'_> {
    /// Corrects a run of the colour and of the images behind it.
    #[inline(always)]
    fn correct(&mut self, run: Run, color: &mut [Row; 3], correction: &[Row; 3]) {
        for (color, correction) in color.iter_mut().zip(correction) {
            for (color, &correction) in color.iter_mut().zip(correction) {
                *color = corrected(*color, correction);
            }
        }
        correct_run(correction, run, &mut self.history);
        if let Some(light) = &mut self.light {
            correct_run(correction, run, light);
        }
    }
}
