//! How the history of a denoiser's output lags behind light that changes, found before the history is merged.
//!
//! Merging old and new colours takes many frames to follow a light. So the reprojected history h is corrected first, by the
//! innovation of the new samples ([`crate::kernels::judge::innovation`]), of which it contains none yet:
//!   h ← clamp(h + d (max(h, 0) + e/16), min(h, c), max(h, c)).
//! It moves towards the new denoised colour c and no further: blocks of samples reach over edges, c does not. Samples are
//! compared with history fetched bilinearly along their own motion, as dilated motion would lead over edges.
//!
//! Samples are not compared with history of another surface (coverage up to [`COVERED`], or none according to the denoiser),
//! nor on lamps, other bright pixels ([`BRIGHT`]) and the sky, and one pixel around: beside these the edges are antialiased,
//! which makes them differ from single samples even where nothing changes. History there stays as it is.
//!
//! History is steady where it is compared, where this moves its luminance by no more than [`STEADY`] of that plus e/16, and where
//! the denoiser found history for all pixels up to [`NEAR`] away along each axis: beside what an object uncovers, the antialiased
//! edge still has the object's colours.
//!
//! Inputs: history (4: colour, N), motion (2 or 3), samples (3), new colour (3), emission (3, optional), depth (1, optional),
//! confidence of the denoiser (1, optional). Outputs: the lag; evidence for the next frame (4, half size).

use std::ops::Range;

use super::Input;
use crate::image::{
    BandMut, Image, Interleaved, Pixels, Run, SEGMENT, Size, View, deinterleave, segments,
};
use crate::kernels::fetch::footprint::Filter;
use crate::kernels::fetch::reproject::{self, Fetch, Fetched};
use crate::kernels::judge::innovation::{self, Innovation, Prediction, corrected, innovation};
use crate::math::{black_level, is_present, is_surface, larger, luminance, smaller};
use crate::pipelines::frame::Frame;
use crate::pixels::{Colors, MotionLanes, Rolling, Row};
use crate::rows::{self, Kernel, Simd};

/// How the innovation tells a lag from noise. At a strictness of 3, the temporal error of `shallow_focus` and `brushed_metal`
/// grows by 1.6 %; at 5, the gains are a third smaller than at 3.
pub const PARAMS: innovation::Params = innovation::Params {
    strictness: 4.0,
    share: 0.7,
    ..innovation::Params::DEFAULT
};

/// Coverage above which the history is all of the pixel's surface.
pub const COVERED: f32 = 0.9;

/// Steady history moves by no more than this share of its luminance. Without the test, `television` loses 3 % relMSE where its
/// light changes; with 0.1 %, `carousel` gains half as much by [`super::clip_choice`].
const STEADY: f32 = 0.01;
/// Distance in pixels from those without history. With 0, `passer_by` gains nothing by [`super::clip_choice`], and `confetti` a
/// quarter less.
const NEAR: usize = 2;

/// Marks a pixel whose samples are not compared with history, whatever its surface.
const UNLIKE: u8 = 1;
/// Marks a pixel near one without history.
const UNSTEADY: u8 = 2;

/// Luminance, in times of the exposure, above which a pixel may show a lamp. With 16, `cornell_box` without emission has 11 %
/// more relMSE, at the edges of its lamp; with 6 it has less.
const BRIGHT: f32 = 6.0;

/// By how much the history lags: what new samples show to be wrong with it.
pub struct Lag {
    found: Innovation,
    /// Sums of [`UNLIKE`] and [`UNSTEADY`].
    marks: Image<u8>,
    black: f32,
}

impl Lag {
    /// Compares the samples of a frame with history. Also returns the evidence for the next frame.
    pub fn find(
        frame: &Frame,
        motion: Pixels,
        history: &Interleaved,
        input: &Input,
        exposure: f32,
        evidence: Option<&Interleaved>,
    ) -> (Self, Interleaved) {
        let size = motion.size;
        let confidence = input.others.confidence;
        let marks = mark(frame, input.color, confidence, exposure);
        let (tests, bilinear) = (input.others.tests, reproject::Params::of(Filter::Bilinear));
        let predicted = Compared {
            fetch: Fetch::new(&[history.pixels()], size, tests, bilinear),
            motion,
            marks: marks.view(),
            confidence,
        };
        let known = innovation::Known::of(evidence, motion);
        let samples = &frame.color;
        let (found, rest) = innovation(samples, input.weight, &predicted, known, exposure, PARAMS);
        let black = black_level(exposure);
        let lag = Self {
            found,
            marks,
            black,
        };
        (lag, rest)
    }

    pub fn line(&self) -> innovation::Line {
        self.found.line()
    }

    #[inline(always)]
    pub fn go_to(&self, y: usize, line: &mut innovation::Line) {
        self.found.go_to(y, line);
    }

    /// Corrects a run of the reprojected history, towards the new colours, and finds where it is steady.
    #[inline(always)]
    pub fn catch_up(
        &self,
        run: Run,
        line: &innovation::Line,
        new: [&[f32]; 3],
        coverage: &[f32],
        confidence: Option<View>,
        history: &mut [Row; 3],
        steady: &mut [bool],
    ) {
        let n = run.len;
        let mut compared = [false; SEGMENT];
        let compared = &mut compared[..n];
        find_compared(run, self.marks.view(), coverage, confidence, compared);
        let marks = self.marks.view().run(0, run);
        for ((steady, &compared), mark) in steady.iter_mut().zip(&*compared).zip(marks) {
            *steady = compared & (mark & UNSTEADY == 0);
        }
        if !self.found.corrects(line, run) {
            return;
        }
        let found = self.found.correction(line, run, history);
        let mut before = [0.0; SEGMENT];
        luminances(history, &mut before[..n]);
        let [hr, hg, hb] = history.each_ref().map(|row| &row[..n]);
        let [nr, ng, nb] = new.map(|row| &row[..n]);
        for (i, compared) in compared.iter_mut().enumerate() {
            *compared &= is_present([hr[i], hg[i], hb[i]]) & is_present([nr[i], ng[i], nb[i]]);
        }
        for ((history, found), new) in history.iter_mut().zip(&found).zip([nr, ng, nb]) {
            let (history, found, compared) = (&mut history[..n], &found[..n], &compared[..n]);
            for i in 0..n {
                let (old, new) = (history[i], new[i]);
                let most = larger(old, new);
                let bounded = smaller(larger(corrected(old, found[i]), smaller(old, new)), most);
                history[i] = if compared[i] { bounded } else { old };
            }
        }
        let mut after = [0.0; SEGMENT];
        luminances(history, &mut after[..n]);
        for (i, steady) in steady.iter_mut().enumerate() {
            let moved = (after[i] - before[i]).abs();
            *steady &= moved <= STEADY * (after[i] + self.black);
        }
    }
}

/// The reprojected history, as far as samples are compared with it: missing elsewhere.
struct Compared<'a> {
    /// Of colour and length.
    fetch: Fetch<'a>,
    motion: Pixels<'a>,
    marks: View<'a, u8>,
    /// 0 where a denoiser found no history of the surface.
    confidence: Option<View<'a>>,
}

impl Prediction for Compared<'_> {
    type Line = (MotionLanes, Fetched);

    fn size(&self) -> Size {
        self.motion.size
    }

    fn line(&self) -> Self::Line {
        (MotionLanes::zeroed(), self.fetch.scratch())
    }

    #[inline(always)]
    fn read(
        &self,
        run: Run,
        (motion, fetched): &mut Self::Line,
        colors: &mut [Row; 3],
        lengths: &mut [f32],
    ) {
        let n = run.len;
        self.fetch.run(run, motion.load(&self.motion, run), fetched);
        let [r, g, b] = colors.each_mut().map(|row| &mut row[..n]);
        let channels = [r, g, b, lengths];
        deinterleave(
            &fetched.values(0)[..n * channels.len()],
            channels.into_iter(),
        );
        let mut compared = [false; SEGMENT];
        let compared = &mut compared[..n];
        find_compared(
            run,
            self.marks,
            &fetched.coverage,
            self.confidence,
            compared,
        );
        for row in colors {
            for (value, &compared) in row.iter_mut().zip(&*compared) {
                *value = if compared { *value } else { f32::NAN };
            }
        }
    }
}

/// Finds the pixels of a run whose samples are compared with history of this coverage.
#[inline(always)]
fn find_compared(
    run: Run,
    marks: View<u8>,
    coverage: &[f32],
    confidence: Option<View>,
    compared: &mut [bool],
) {
    let marks = marks.run(0, run);
    for ((compared, &mark), &coverage) in compared.iter_mut().zip(marks).zip(coverage) {
        *compared = (mark & UNLIKE == 0) & (coverage > COVERED);
    }
    if let Some(confidence) = confidence {
        let confidence = confidence.run(0, run);
        for (compared, &confidence) in compared.iter_mut().zip(confidence) {
            *compared &= confidence > 0.0;
        }
    }
}

/// Luminances of a run of colours.
#[inline(always)]
fn luminances([r, g, b]: &[Row; 3], into: &mut [f32]) {
    for (i, into) in into.iter_mut().enumerate() {
        *into = luminance(r[i], g[i], b[i]);
    }
}

/// Marks the lamps and the sky and what may be either, with one pixel around, and what is near pixels without history.
fn mark(frame: &Frame, color: Pixels, confidence: Option<View>, exposure: f32) -> Image<u8> {
    let mut marks = Image::blank(color.size, 1);
    let kernel = Mark {
        emission: frame.emission,
        depth: frame.surface.depth,
        confidence,
        color,
        bright: BRIGHT * exposure,
    };
    rows::run_jobs(
        &kernel,
        rows::tall_jobs(color.size.height, NEAR, marks.bands()),
    );
    marks
}

struct Mark<'a> {
    color: Pixels<'a>,
    bright: f32,
    emission: Option<Pixels<'a>>,
    depth: Option<Pixels<'a>>,
    confidence: Option<View<'a>>,
}

impl Mark<'_> {
    /// Writes 1 for pixels of a run that show a lamp or the sky, or may do so.
    #[inline(always)]
    fn mark(&self, run: Run, marks: &mut [f32]) {
        let mut colors = [[0.0; SEGMENT]; 3];
        self.color.colors(run, &mut colors);
        let [r, g, b] = colors.each_ref().map(|row| &row[..run.len]);
        for (i, mark) in marks.iter_mut().enumerate() {
            *mark = if luminance(r[i], g[i], b[i]) > self.bright {
                1.0
            } else {
                0.0
            };
        }
        let mut row = [0.0; SEGMENT];
        let row = &mut row[..run.len];
        if let Some(emission) = &self.emission {
            for channel in 0..3 {
                emission.load(run, channel, row);
                for (mark, &light) in marks.iter_mut().zip(&*row) {
                    *mark = if light > 0.0 { 1.0 } else { *mark };
                }
            }
        }
        if let Some(depth) = &self.depth {
            depth.load(run, 0, row);
            for (mark, depth) in marks.iter_mut().zip(&*row) {
                *mark = if is_surface(*depth) { *mark } else { 1.0 };
            }
        }
    }
}

/// Adds one row to another.
#[inline(always)]
fn add(sums: &mut [f32], row: &[f32]) {
    for (sum, value) in sums.iter_mut().zip(row) {
        *sum += value;
    }
}

impl<'a> Kernel for Mark<'a> {
    type Out = Vec<BandMut<'a, u8>>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: Self::Out) {
        let size = self.color.size;
        let width = size.width;
        let mut marks = Rolling::<2>::within(width, NEAR, 0.0);
        let (mut shine, mut unknown) = (vec![0.0; width + 2 * NEAR], vec![0.0; width + 2 * NEAR]);
        for y in rows.clone() {
            for due in marks.due(y, y == rows.start) {
                if let Some([shines, lacks]) = marks.fresh(due, size) {
                    for run in segments(due as usize, width) {
                        self.mark(run, &mut shines[run.x..][..run.len]);
                    }
                    if let Some(confidence) = self.confidence {
                        let known = confidence.row(0, due as usize);
                        for (lacks, &known) in lacks.iter_mut().zip(known) {
                            *lacks = if known > 0.0 { 0.0 } else { 1.0 };
                        }
                    }
                }
            }
            shine.fill(0.0);
            unknown.fill(0.0);
            for dy in -(NEAR as isize)..=NEAR as isize {
                let [shines, lacks] = marks.row(y as isize + dy);
                if dy.abs() <= 1 {
                    add(&mut shine, shines);
                }
                add(&mut unknown, lacks);
            }
            let out = out[(y - rows.start) / rows::BAND].row(0, y);
            for (x, out) in out.iter_mut().enumerate() {
                let [a, b, c, d, e] = std::array::from_fn(|k| unknown[x + k]);
                let shines = shine[x + 1] + shine[x + 2] + shine[x + 3] > 0.0;
                let unsteady = a + b + c + d + e > 0.0;
                *out = UNLIKE * u8::from(shines) + UNSTEADY * u8::from(unsteady);
            }
        }
    }
}
