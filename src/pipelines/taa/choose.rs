//! How much of the output stage each tile shows, by what would have predicted new samples best.
//!
//! Frames of many samples are antialiased as they come, and have little noise: what the stage still adds is then blur and lag,
//! and at some point the denoiser does no better. The candidates are, from least to most,
//!   the samples y, ½ (y + a), the denoised colour a, ½ (a + b), the stage's result b,
//! with b as the default. Their luminances of the frame before are fetched along the stage's dilated motion, bilinearly, and
//! judged by the new samples ([`mod@choice`]). In frames of one sample y is far worse than b, and the [`MARGIN`] keeps b. Where
//! fewer than one tile in [`FEWEST`] chooses another candidate, none does, and the next [`REST`] frames are not judged.
//!
//! Inputs: samples (3), denoised colour (3), motion (2 or 3), dilated motion, of the frame before: luminances (3), evidence (of
//! an eighth of the size). In place: result (3). Outputs: luminances, evidence.

use std::ops::Range;

use super::fetch;
use crate::image::{BandMut, Image, Pixels, Records, SEGMENT, Size, View, segments};
use crate::kernels::fetch::footprint::Filter;
use crate::kernels::fetch::validate::Tests;
use crate::kernels::judge::choice::{self, Levels, choice};
use crate::kernels::judge::exposure::exposure;
use crate::math::luminance;
use crate::pixels::{Colors, Row};
use crate::rows::{self, BAND, Kernel, Simd};

/// The candidates, of which every second is a mean of its neighbours.
const CANDIDATES: usize = 5;
const USUAL: usize = CANDIDATES - 1;
/// Of the samples, the denoised colour and the result.
const LUMINANCES: usize = 3;

/// By how much of the noise another candidate must be better. Measured on sequences of 1 to 64 samples: without a margin,
/// frames of one sample lose up to 0.7 dB where light moves, as a candidate of one frame ago has a frame's more lag; with 0.4,
/// frames of 16 samples lose a third of the gain.
const MARGIN: f32 = 0.3;
/// In frames of one sample, single tiles choose by chance.
const FEWEST: usize = 32;
/// With the three frames that it takes to ask again, one of eight.
const REST: u32 = 5;

/// What the next frame judges.
#[derive(Default)]
pub struct Candidates {
    luminances: Option<Records>,
    /// None until a second frame has judged the first.
    evidence: Option<Records>,
    /// Frames that are not judged.
    rest: u32,
}

impl Candidates {
    /// Whether this frame's samples judge them.
    pub fn are_judged(&self) -> bool {
        self.luminances.is_some()
    }
}

/// Mixes the candidates in place of the result. Returns what the next frame judges.
pub fn choose(
    before: Option<Candidates>,
    samples: Pixels,
    denoised: Pixels,
    motion: Pixels,
    dilated: Pixels,
    shown: &mut [f32],
) -> Candidates {
    let size = samples.size;
    let before = before.unwrap_or_default();
    if let Some(rest) = before.rest.checked_sub(1) {
        return Candidates {
            rest,
            ..Candidates::default()
        };
    }
    let (mut tiles, mut evidence) = (None, None);
    if let Some(luminances) = before.luminances {
        let (predicted, coverage) = predict(&luminances, dilated);
        let known = before.evidence.map(|evidence| {
            let params = choice::Params {
                margin: MARGIN,
                ..choice::Params::default()
            };
            choice(evidence.pixels(), motion, coverage.view(), USUAL, params)
        });
        let (chosen, carried) = known.unzip();
        if chosen.as_ref().is_some_and(hardly_choose) {
            return Candidates {
                rest: REST,
                ..Candidates::default()
            };
        }
        let empty = || Records::new(choice::tiles(size), choice::channels(CANDIDATES));
        let mut judged = carried.unwrap_or_else(empty);
        let views: Vec<_> = (0..CANDIDATES)
            .map(|c| predicted.channels(c..c + 1))
            .collect();
        let bright = exposure(Pixels::records(size, 3, shown));
        choice::compare(&samples, &views, bright, USUAL, &mut judged);
        (tiles, evidence) = (chosen, Some(judged));
    }
    let mut luminances = Records::blank(size, LUMINANCES);
    let kernel = Mix {
        samples,
        denoised,
        tiles: tiles.as_ref().map(Levels),
    };
    let band = BAND * size.width;
    let outs =
        (shown.chunks_mut(3 * band)).zip(luminances.data_mut().chunks_mut(LUMINANCES * band));
    rows::run(&kernel, size.height, outs);
    Candidates {
        luminances: Some(luminances),
        evidence,
        rest: 0,
    }
}

/// Whether fewer than one tile in [`FEWEST`] shows something else than the result.
fn hardly_choose(tiles: &Image) -> bool {
    let levels = tiles.plane(0);
    let others = levels.iter().filter(|&&level| level < USUAL as f32);
    others.count() * FEWEST < levels.len()
}

/// The candidates' luminances that were expected, NaN where the pixel was not there; and the coverage.
fn predict(luminances: &Records, dilated: Pixels) -> (Image, Image) {
    let size = dilated.size;
    let (fetched, coverage) = fetch(luminances, dilated, Tests::none(), Filter::Bilinear);
    let mut predicted = Image::blank(size, CANDIDATES);
    let kernel = Series {
        fetched: fetched.view(),
        coverage: coverage.view(),
    };
    rows::run(&kernel, size.height, predicted.bands());
    (predicted, coverage)
}

/// Makes the series of candidates of three.
struct Series<'a> {
    fetched: View<'a>,
    coverage: View<'a>,
}

impl<'a> Kernel for Series<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: BandMut<'a>) {
        for y in rows {
            let three: [_; LUMINANCES] = self.fetched.rows(y);
            let coverage = self.coverage.row(0, y);
            let series: [_; CANDIDATES] = out.rows(y);
            for (c, row) in series.into_iter().enumerate() {
                let (first, second) = (three[c / 2], three[c.div_ceil(2)]);
                let pairs = first.iter().zip(second).zip(coverage);
                for (out, ((&first, &second), &coverage)) in row.iter_mut().zip(pairs) {
                    let mean = first + 0.5 * (second - first);
                    *out = if coverage > 0.0 { mean } else { f32::NAN };
                }
            }
        }
    }
}

/// Mixes the candidates as the tiles chose.
struct Mix<'a> {
    samples: Pixels<'a>,
    denoised: Pixels<'a>,
    tiles: Option<Levels<'a>>,
}

impl<'a> Kernel for Mix<'a> {
    type Out = (&'a mut [f32], &'a mut [f32]);

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, (shown, luminances): Self::Out) {
        let Size { width, .. } = self.samples.size;
        let (mut sample, mut denoised) = ([[0.0; SEGMENT]; 3], [[0.0; SEGMENT]; 3]);
        let mut levels: Row = [USUAL as f32; SEGMENT];
        let shown = rows::lines(rows.clone(), shown, 3 * width);
        let luminances = rows::lines(rows, luminances, LUMINANCES * width);
        for ((y, shown), (_, luminances)) in shown.zip(luminances) {
            let shown = shown.as_chunks_mut::<3>().0;
            let luminances = luminances.as_chunks_mut::<LUMINANCES>().0;
            for run in segments(y, width) {
                self.samples.colors(run, &mut sample);
                self.denoised.colors(run, &mut denoised);
                if let Some(tiles) = &self.tiles {
                    tiles.read(run, &mut levels[..run.len]);
                }
                let pixels = shown[run.x..][..run.len].iter_mut();
                for (i, (shown, known)) in pixels.zip(&mut luminances[run.x..]).enumerate() {
                    let [y, a] = [&sample, &denoised].map(|rows| [0, 1, 2].map(|c| rows[c][i]));
                    let b = *shown;
                    *known = [y, a, b].map(|[r, g, b]| luminance(r, g, b));
                    let mixed = mix([y, a, b], levels[i]);
                    let whole = mixed.iter().all(|value| value.is_finite());
                    *shown = if levels[i] < USUAL as f32 && whole {
                        mixed
                    } else {
                        b
                    };
                }
            }
        }
    }
}

/// Between samples at level 0, denoised colour at 2, and result at 4.
#[inline(always)]
fn mix([y, a, b]: [[f32; 3]; 3], level: f32) -> [f32; 3] {
    let half = 0.5 * level;
    let (from, to, share) = match half < 1.0 {
        true => (y, a, half),
        false => (a, b, half - 1.0),
    };
    std::array::from_fn(|c| from[c] + share * (to[c] - from[c]))
}
