//! How the history of a denoiser's output lags behind light that changes, found before the history is merged.
//!
//! Merging old and new colours takes many frames to follow a light. So the reprojected history h is corrected first, by the
//! innovation d of the new samples ([`crate::kernels::judge::innovation`]), of which it contains none yet:
//!   h ← clamp(h + d, min(h, c), max(h, c)).
//! It moves towards the new denoised colour c and no further: blocks of samples reach over edges, c does not.
//!
//! Samples are not compared with history of another surface (coverage up to [`COVERED`], or none according to the denoiser),
//! nor on lamps, other bright pixels ([`BRIGHT`]) and the sky, and one pixel around: beside these the edges are antialiased,
//! which makes them differ from single samples even where nothing changes. History there stays as it is.
//!
//! Inputs: history (4: colour, N), motion (2 or 3), samples (3), new colour (3), emission (3, optional), depth (1, optional),
//! confidence of the denoiser (1, optional). Outputs: the lag; evidence for the next frame (4, half size).

use std::ops::Range;

use crate::image::{BandMut, Image, Pixels, Run, SEGMENT, View, segments};
use crate::kernels::judge::innovation::{self, Innovation, corrected};
use crate::math::{is_present, larger, luminance, smaller};
use crate::pipelines::frame::Frame;
use crate::pixels::{Colors, Rolling, Row};
use crate::rows::{self, Kernel, Simd};

/// How the innovation tells a lag from noise. At a strictness of 3, the temporal error of `shallow_focus` and `brushed_metal`
/// grows by 1.6 %; at 5, the gains are a third smaller than at 3.
pub const PARAMS: innovation::Params = innovation::Params {
    strictness: 4.0,
    share: 0.7,
    ..innovation::Params::DEFAULT
};

/// Coverage above which the history is all of the pixel's surface.
const COVERED: f32 = 0.9;

/// Luminance, in times of the exposure, above which a pixel may show a lamp. With 16, `cornell_box` without emission has 11 %
/// more relMSE, at the edges of its lamp; with 6 it has less.
const BRIGHT: f32 = 6.0;

/// By how much the history lags: what new samples show to be wrong with it.
pub struct Lag {
    /// The reprojected history that they were compared with; NaN where they were not.
    known: Image,
    found: Innovation,
}

/// Scratch for one row.
pub struct Line {
    found: innovation::Line,
    known: [Row; 3],
}

impl Lag {
    pub fn new(known: Image, found: Innovation) -> Self {
        Self { known, found }
    }

    pub fn line(&self) -> Line {
        Line {
            found: self.found.line(),
            known: [[0.0; SEGMENT]; 3],
        }
    }

    #[inline(always)]
    pub fn go_to(&self, y: usize, line: &mut Line) {
        self.found.go_to(y, &mut line.found);
    }

    /// Corrects a run of the history, towards the new colours.
    #[inline(always)]
    pub fn catch_up(&self, run: Run, line: &mut Line, new: [&[f32]; 3], history: &mut [Row; 3]) {
        let known = &mut line.known;
        self.known.pixels().part(0..3).colors(run, known);
        let Some(found) = self.found.correction(&line.found, run, known) else {
            return;
        };
        let n = run.len;
        let [kr, kg, kb] = known.each_ref().map(|row| &row[..n]);
        let [nr, ng, nb] = new.map(|row| &row[..n]);
        let mut compared = [false; SEGMENT];
        for (i, compared) in compared[..n].iter_mut().enumerate() {
            *compared = is_present([kr[i], kg[i], kb[i]]) & is_present([nr[i], ng[i], nb[i]]);
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
    }
}

/// Makes those pixels of a reprojected history NaN with which samples are not to be compared.
pub fn leave_out(
    known: &mut Image,
    coverage: View,
    confidence: Option<View>,
    frame: &Frame,
    color: Pixels,
    exposure: f32,
) {
    let size = known.size;
    let kernel = LeaveOut {
        coverage,
        confidence,
        emission: frame.emission,
        depth: frame.surface.depth,
        color,
        bright: BRIGHT * exposure,
    };
    rows::run_jobs(&kernel, rows::tall_jobs(size.height, 1, known.bands()));
}

struct LeaveOut<'a> {
    coverage: View<'a>,
    confidence: Option<View<'a>>,
    color: Pixels<'a>,
    bright: f32,
    emission: Option<Pixels<'a>>,
    depth: Option<Pixels<'a>>,
}

impl LeaveOut<'_> {
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
                *mark = if depth.is_finite() { *mark } else { 1.0 };
            }
        }
    }
}

impl<'a> Kernel for LeaveOut<'a> {
    type Out = Vec<BandMut<'a>>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut known: Self::Out) {
        let size = self.coverage.size;
        let width = size.width;
        let mut marks = Rolling::<1>::within(width, 1, 0.0);
        let sure = vec![1.0; width];
        for y in rows.clone() {
            for due in marks.due(y, y == rows.start) {
                if let Some([row]) = marks.fresh(due, size) {
                    for run in segments(due as usize, width) {
                        self.mark(run, &mut row[run.x..][..run.len]);
                    }
                }
            }
            let band = &mut known[(y - rows.start) / rows::BAND];
            let coverage = self.coverage.row(0, y);
            let confidence = (self.confidence).map_or(&*sure, |confidence| confidence.row(0, y));
            let [above, own, below] =
                [-1, 0, 1].map(|dy| &marks.row(y as isize + dy)[0][..width + 2]);
            let [red, green, blue] = band.rows(y);
            for x in 0..width {
                let around = |row: &[f32]| row[x] + row[x + 1] + row[x + 2];
                let marked = around(above) + around(own) + around(below) > 0.0;
                let left_out = marked | (confidence[x] <= 0.0) | (coverage[x] <= COVERED);
                for row in [&mut *red, &mut *green, &mut *blue] {
                    row[x] = if left_out { f32::NAN } else { row[x] };
                }
            }
        }
    }
}
