//! Corrections of the result and of the history behind it: by the innovation ([`crate::kernels::judge::innovation`]), and by
//! what all light has changed by ([`crate::kernels::judge::light_change`]).

use std::ops::Range;

use crate::image::{BandMut, Pixels, Records, SEGMENT, Size, bands_of, segments};
use crate::kernels::judge::innovation::{self, Innovation, corrected, innovation};
use crate::math::luminance;
use crate::pixels::{Colors, Row};
use crate::rows::{self, BAND, Kernel, Simd};

/// What a frame's samples show to be wrong with a prediction of them, and the evidence for the next frame.
pub fn innovate(
    params: innovation::Params,
    fresh: &impl Colors,
    prediction: &impl Colors,
    length: Pixels,
    motion: Pixels,
    exposure: f32,
    evidence: Option<&Records>,
) -> (Innovation, Records) {
    let known = evidence.map(|evidence| innovation::Known {
        evidence: evidence.pixels(),
        motion: Some(motion),
    });
    innovation(fresh, prediction, length, known, exposure, params)
}

/// Corrects the colour of one pixel's history. Its moments move with it, and their variance stays.
#[inline(always)]
pub fn correct_history(correction: [f32; 3], history: &mut [f32]) {
    let before = [history[0], history[1], history[2]];
    correct_light(correction, history);
    let [r, g, b] = before;
    let moved = luminance(history[0] - r, history[1] - g, history[2] - b);
    let first = history[3];
    history[3] += moved;
    history[4] += moved * (first + first + moved);
}

#[inline(always)]
pub fn correct_light(correction: [f32; 3], light: &mut [f32]) {
    for (light, correction) in light.iter_mut().zip(correction) {
        *light = corrected(*light, correction);
    }
}

/// The factor of a channel of history if its light changes by this one: colour, moments of luminance, length, and what comes
/// behind them, which is colour.
pub fn history_factor(channel: usize, change: f32) -> f32 {
    match channel {
        4 => change * change,
        5 => 1.0,
        _ => change,
    }
}

/// Multiplies the channels of interleaved pixels each by its factor.
pub fn scale(width: usize, pixels: &mut [f32], factors: &[f32]) {
    let row = width * factors.len();
    let height = pixels.len() / row;
    rows::run(&Scale(factors), height, pixels.chunks_mut(BAND * row));
}

struct Scale<'a>(&'a [f32]);

impl<'a> Kernel for Scale<'a> {
    type Out = &'a mut [f32];

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, _: Range<usize>, pixels: &'a mut [f32]) {
        for pixel in pixels.chunks_exact_mut(self.0.len()) {
            for (value, factor) in pixel.iter_mut().zip(self.0) {
                *value *= factor;
            }
        }
    }
}

/// Corrects the planes of a prediction, and those of a history: colour, and then moments if it has any. Both are corrected by
/// the prediction's colour.
pub fn correct(found: &Innovation, size: Size, prediction: &mut [f32], history: &mut [f32]) {
    let kernel = Correct {
        found,
        width: size.width,
    };
    let outs = bands_of(prediction, size).zip(bands_of(history, size));
    rows::run(&kernel, size.height, outs);
}

struct Correct<'a> {
    found: &'a Innovation,
    width: usize,
}

impl<'a> Kernel for Correct<'a> {
    type Out = (BandMut<'a>, BandMut<'a>);

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, (mut prediction, mut history): Self::Out) {
        let mut line = self.found.line();
        let mut predicted = [[0.0; SEGMENT]; 3];
        for y in rows {
            self.found.go_to(y, &mut line);
            for run in segments(y, self.width) {
                for (row, plane) in predicted.iter_mut().zip(prediction.parts(run)) {
                    row[..run.len].copy_from_slice(plane);
                }
                if let Some(found) = self.found.correction(&line, run, &predicted) {
                    correct_run(&found, prediction.parts(run));
                    correct_run(&found, history.parts(run));
                }
            }
        }
    }
}

/// Corrects the colour of a run, and moments if they follow: [`correct_history`], plane by plane.
#[inline(always)]
fn correct_run<'p>(found: &[Row; 3], mut planes: impl Iterator<Item = &'p mut [f32]>) {
    let mut moved = [[0.0; SEGMENT]; 3];
    for ((found, moved), plane) in found.iter().zip(&mut moved).zip(planes.by_ref()) {
        for ((value, &found), moved) in plane.iter_mut().zip(found).zip(moved) {
            let before = *value;
            *value = corrected(before, found);
            *moved = *value - before;
        }
    }
    if let (Some(first), Some(second)) = (planes.next(), planes.next()) {
        for (i, (first, second)) in first.iter_mut().zip(second).enumerate() {
            let moved = luminance(moved[0][i], moved[1][i], moved[2][i]);
            *second += moved * (*first + *first + moved);
            *first += moved;
        }
    }
}
