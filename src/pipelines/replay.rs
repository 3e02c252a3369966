//! Replay: a correlated re-render corrects history where the light has changed.
//!
//! The last frame's samples c, rendered again with the same random numbers but this frame's light, become c*. Their
//! difference c* − c is the change of the light, without the noise of two independent renders. Before the history h is
//! fetched, it is corrected by the `innovation` of samples
//!   h + (c* − c) (h + b)/(c̃ + b),
//! with c̃ the mean of c over 31×31 pixels and b black: where light is scaled, c and c* have the same noise, and their ratio
//! has none. But the innovation averages over blocks, which miss the edges of shadows, and its means are of few samples. So
//! the history is shortened as well, by the gradient from c + d to c*, d being the correction, and by at least half the
//! gradient from c to c*.

use std::ops::Range;

use super::correction::correct_run;
use super::illumination::illumination;
use crate::image::{BandMut, Image, Interleaved, Pixels, Run, SEGMENT, segments};
use crate::kernels::fetch::validate::Surface;
use crate::kernels::judge::exposure::exposure;
use crate::kernels::judge::gradient::{self, find_gradient};
use crate::kernels::judge::innovation::{self, Innovation, corrected, innovation};
use crate::kernels::smooth::atrous::{self, Source, atrous};
use crate::kernels::smooth::demodulate::Texture;
use crate::kernels::smooth::guide::Guide;
use crate::math::{black_level, larger};
use crate::pixels::{Colors, PixelsMut, Row};
use crate::rows::{self, Kernel, Simd};

/// A copy of a frame's colour and texture, to be compared with the next frame's replay.
pub struct Before {
    color: Interleaved,
    albedo: Option<Interleaved>,
    emission: Option<Interleaved>,
    mask: Option<Interleaved<u8>>,
}

impl Before {
    pub fn of(color: Pixels, texture: Option<Texture>) -> Self {
        let emission = texture.and_then(|texture| texture.emission);
        let mask = texture.and_then(|texture| texture.mask);
        Self {
            color: color.to_interleaved(),
            albedo: texture.map(|texture| texture.albedo.to_interleaved()),
            emission: emission.map(Pixels::to_interleaved),
            mask: mask.map(Interleaved::of),
        }
    }

    /// A colour without this frame's texture.
    fn light(&self, color: Pixels) -> Image {
        let texture = self.albedo.as_ref().map(|albedo| Texture {
            albedo: albedo.pixels(),
            emission: self.emission.as_ref().map(Interleaved::pixels),
            mask: self.mask.as_ref().map(|mask| mask.pixels().plane()),
        });
        illumination(color, texture)
    }
}

/// Correlated renders have the same noise, so no part of their difference counts as noise, and small windows suffice.
const REPLAYED: gradient::Params = gradient::Params {
    noise: 0.0,
    passes: 2,
    widest: 2,
};

/// Returns the gradient by which the replay of the last frame shortens history. With `corrects`, first corrects the history and
/// the light by which reflections are compared; the gradient is then that of the change that is left.
pub fn relight(
    replay: Pixels,
    before: &Before,
    history: &mut Interleaved,
    light: Option<&mut Interleaved>,
    corrects: bool,
) -> Image {
    let [now, mut then] = [replay, before.color.pixels()].map(|color| before.light(color));
    let mut gradient = find_gradient([now.pixels(), then.pixels()], None, REPLAYED);
    if !corrects {
        return gradient;
    }

    let size = now.size;
    let known = history.pixels().part(0..3);
    // An infinite history length tells the innovation that no sample is part of its prediction; an infinite variance keeps
    // the luminance weight of the blur at 1.
    let mut endless = Image::blank(size, 1);
    endless.data_mut().fill(1e30);
    let bright = exposure(known);
    let fresh = Relit {
        history: known,
        change: [&now, &then],
        mean: &blurred(&then, endless.pixels()),
        black: black_level(bright),
    };
    let (found, _) = innovation(
        &fresh,
        None,
        &innovation::Predicted {
            colors: &known,
            lengths: endless.pixels(),
        },
        None,
        bright,
        innovation::Params {
            strictness: 1.0,
            ..Default::default()
        },
    );
    let correct = Relight {
        found: &found,
        width: size.width,
    };
    let lights = rows::optional(light.map(|light| light.pixels_mut()));
    let outs = history.pixels_mut().zip(then.bands()).zip(lights);
    rows::run(&correct, size.height, outs);

    let rest = find_gradient([now.pixels(), then.pixels()], None, REPLAYED);
    for (gradient, &rest) in gradient.data_mut().iter_mut().zip(rest.plane(0)) {
        *gradient = larger(0.5 * *gradient, rest);
    }
    gradient
}

/// The mean over 31×31 pixels: à-trous without any edge-stopping weight.
fn blurred(image: &Image, variance: Pixels) -> Image {
    let params = atrous::Params {
        iterations: 4,
        radius: 1,
        ..Default::default()
    };
    let guide = Guide::new(image.size, params.reach(), Surface::default(), None);
    let mut mean = Image::blank(image.size, 3);
    let mut rest = Image::blank(image.size, 1);
    let out = mean.pixels_mut();
    let source = Source {
        color: image.pixels(),
        variance,
        prediction: None,
        samples: None,
        exposure: f32::INFINITY,
    };
    atrous(source, &guide, params, out, rest.data_mut(), None);
    mean
}

/// The history with the change of its samples, from the second image of `change` to the first, scaled to its brightness.
struct Relit<'a> {
    history: Pixels<'a>,
    change: [&'a Image; 2],
    mean: &'a Image,
    black: f32,
}

impl Colors for Relit<'_> {
    #[inline(always)]
    fn colors(&self, run: Run, into: &mut [Row; 3]) {
        let [mut now, mut then, mut mean] = [[[0.0; SEGMENT]; 3]; 3];
        self.history.colors(run, into);
        self.change[0].pixels().colors(run, &mut now);
        self.change[1].pixels().colors(run, &mut then);
        self.mean.pixels().colors(run, &mut mean);
        for c in 0..3 {
            let (into, now, then, mean) = (&mut into[c], &now[c], &then[c], &mean[c]);
            for x in 0..SEGMENT {
                let scale =
                    (larger(into[x], 0.0) + self.black) / (larger(mean[x], 0.0) + self.black);
                into[x] += (now[x] - then[x]) * scale;
            }
        }
    }
}

/// Corrects the history and the light for reflections, and moves the last frame's light along with the history's.
struct Relight<'a> {
    found: &'a Innovation,
    width: usize,
}

impl<'a> Kernel for Relight<'a> {
    type Out = ((PixelsMut<'a>, BandMut<'a>), Option<PixelsMut<'a>>);

    #[inline(always)]
    fn rows<S: Simd>(
        &self,
        _: S,
        rows: Range<usize>,
        ((mut history, mut then), mut light): Self::Out,
    ) {
        let mut line = self.found.line();
        let mut before = [[0.0; SEGMENT]; 3];
        for y in rows {
            self.found.go_to(y, &mut line);
            for run in segments(y, self.width).filter(|run| self.found.corrects(&line, *run)) {
                history.load_colors(run, &mut before);
                let found = self.found.correction(&line, run, &before);
                correct_run(&found, run, &mut history);
                for ((then, before), found) in then.parts(run).zip(&before).zip(&found) {
                    for ((then, &before), &found) in then.iter_mut().zip(before).zip(found) {
                        *then += corrected(before, found) - before;
                    }
                }
                if let Some(light) = &mut light {
                    correct_run(&found, run, light);
                }
            }
        }
    }
}
