//! Corrections of the result and of the history behind it: by the innovation ([`crate::kernels::judge::innovation`]), and by
//! what all light has changed by ([`crate::kernels::judge::light_change`]).

use std::ops::Range;

use crate::image::{Run, SEGMENT, Size, deinterleave, interleave, segments};
use crate::kernels::judge::innovation::{Innovation, corrected};
use crate::math::luminance;
use crate::pixels::{PixelsMut, Row};
use crate::rows::{self, BAND, Kernel, Simd};

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

/// Corrects a prediction, and the history behind it, both by the prediction's colour. The colour and the moments of a history
/// of fewer samples than `least` stay as they are.
pub fn correct<'a>(
    found: &'a Innovation,
    size: Size,
    least: f32,
    prediction: impl Iterator<Item = PixelsMut<'a>>,
    history: Option<impl Iterator<Item = PixelsMut<'a>>>,
) {
    let kernel = Correct {
        found,
        width: size.width,
        least,
    };
    rows::run(
        &kernel,
        size.height,
        prediction.zip(rows::optional(history)),
    );
}

struct Correct<'a> {
    found: &'a Innovation,
    width: usize,
    least: f32,
}

impl<'a> Kernel for Correct<'a> {
    type Out = (PixelsMut<'a>, Option<PixelsMut<'a>>);

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, (mut prediction, mut history): Self::Out) {
        let mut line = self.found.line();
        let mut predicted = [[0.0; SEGMENT]; 3];
        for y in rows {
            self.found.go_to(y, &mut line);
            for run in segments(y, self.width).filter(|run| self.found.corrects(&line, *run)) {
                prediction.load_colors(run, &mut predicted);
                let found = self.found.correction(&line, run, &predicted);
                correct_run(&found, run, &mut prediction);
                if let Some(history) = &mut history {
                    correct_grown(&found, self.least, run, history);
                }
            }
        }
    }
}

/// Channels of the widest history that is corrected: that of `BMFR`, with colour behind its length.
const MOST: usize = 9;

/// Corrects a run of an image: colour, and if it is a history of five channels and more, the moments of luminance, which move
/// with it while their variance stays, and further images of light behind its length.
#[inline(always)]
pub fn correct_run(found: &[Row; 3], run: Run, image: &mut PixelsMut) {
    correct_grown(found, 0.0, run, image);
}

/// The same, but for the colour and the moments of fewer samples than `least`.
#[inline(always)]
fn correct_grown(found: &[Row; 3], least: f32, run: Run, image: &mut PixelsMut) {
    let channels = image.channels();
    match image {
        PixelsMut::Planar(band) => correct_planes(found, least, band.parts(run)),
        PixelsMut::Interleaved(band) => {
            let mut planes = [[0.0; SEGMENT]; MOST];
            let planes = &mut planes[..channels];
            band.prefetch_ahead(run);
            let records = band.part(run);
            deinterleave(records, planes.iter_mut().map(|row| &mut row[..run.len]));
            let parts = planes.iter_mut().map(|row| &mut row[..run.len]);
            correct_planes(found, least, parts);
            interleave(planes.iter().map(|row| &row[..run.len]), records);
        }
    }
}

#[inline(always)]
fn correct_planes<'p>(
    found: &[Row; 3],
    least: f32,
    mut planes: impl Iterator<Item = &'p mut [f32]>,
) {
    let mut colors = [(); 3].map(|()| planes.next().expect("three channels of colour"));
    let moments = planes.next().zip(planes.next());
    let mut own = *found;
    if let Some(lengths) = planes.next().filter(|_| least > 0.0) {
        for found in &mut own {
            for (found, &mut length) in found.iter_mut().zip(lengths.iter_mut()) {
                *found = if length >= least { *found } else { 0.0 };
            }
        }
    }
    let mut moved = [[0.0; SEGMENT]; 3];
    for ((found, moved), plane) in own.iter().zip(&mut moved).zip(&mut colors) {
        for ((value, &found), moved) in plane.iter_mut().zip(found).zip(moved) {
            let before = *value;
            *value = corrected(before, found);
            *moved = *value - before;
        }
    }
    if let Some((first, second)) = moments {
        let [r, g, b] = &moved;
        let moved = r.iter().zip(g).zip(b);
        for ((first, second), ((r, g), b)) in first.iter_mut().zip(second).zip(moved) {
            // The moments of a luminance whose colour has moved.
            let moved = luminance(*r, *g, *b);
            *second += moved * (*first + *first + moved);
            *first += moved;
        }
    }
    for (plane, found) in planes.zip(found.iter().cycle()) {
        for (value, &found) in plane.iter_mut().zip(found) {
            *value = corrected(*value, found);
        }
    }
}
