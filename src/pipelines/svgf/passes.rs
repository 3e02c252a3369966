//! Variance and the passes of the filter, and what is kept of each pass while its rows are in cache:
//!
//! - the result, for which every tile has chosen a number of passes ([`crate::kernels::judge::choice`]);
//! - the filtered prediction, one of the candidates that this frame's samples judge;
//! - the first pass as history, where the filter feeds back;
//! - the second as light, where the next frame looks for reflections.

use std::ops::Range;
use std::slice::ChunksMut;
use std::vec;

use super::super::frame::Guides;
use super::{Current, Reports};
use crate::image::{Image, Interleaved, Pixels, Run, SEGMENT, Size, View, segments};
use crate::kernels::judge::choice::{self, Levels};
use crate::kernels::merge::accumulate;
use crate::kernels::smooth::atrous::{self, Filtered, FilteredRow, Sink};
use crate::kernels::smooth::guide::Guide;
use crate::kernels::smooth::variance::Estimate;
use crate::lanes::LANES;
use crate::math::{larger, smaller};
use crate::memory::prefetch;
use crate::pixels::{Colors, Row, rows_of};
use crate::rows::{self, BAND, Kernel, Simd};

/// A frame's choice of how many passes each tile shows.
pub struct Choosing<'a> {
    /// None in a first frame: all show the usual number.
    tiles: Option<Image>,
    /// The number of each pixel, interpolated between tiles; written with the unfiltered image.
    levels: &'a mut [f32],
    /// The expected luminance after 0, 1, 2 … passes; the filter adds all but the first.
    candidates: Vec<Image>,
    evidence: Interleaved,
}

/// Chooses by the evidence of earlier frames. It is looked for along the motion by which history was fetched.
pub fn choose<'a>(
    now: &Current,
    prediction: Option<Image>,
    motion: Pixels,
    before: Option<Interleaved>,
    reports: &Reports,
    levels: Option<&'a mut [f32]>,
) -> Option<Choosing<'a>> {
    let params = now.params.choice?;
    // A step that only recalls history shows no passes, and has no prediction to judge them by.
    let (levels, prediction) = (levels?, prediction?);
    let usual = now.params.atrous.iterations as usize;
    let coverage = View::new(now.size(), 1, reports.confidence);
    let chosen =
        before.map(|before| choice::choice(before.pixels(), motion, coverage, usual, params));
    let (tiles, carried) = chosen.unzip();
    let candidates = now.params.passes() as usize + 1;
    Some(Choosing {
        tiles,
        levels,
        candidates: vec![prediction],
        evidence: carried.unwrap_or_else(|| {
            Interleaved::new(choice::tiles(now.size()), choice::channels(candidates))
        }),
    })
}

impl Choosing<'_> {
    /// The evidence for the next frame: what the samples say of the candidates is added.
    pub fn judge(mut self, now: &Current, exposure: f32) -> Interleaved {
        let candidates: Vec<_> = self.candidates.iter().map(Image::view).collect();
        let usual = now.params.atrous.iterations as usize;
        let evidence = &mut self.evidence;
        choice::compare(&now.fresh(), &candidates, exposure, usual, evidence);
        self.evidence
    }
}

/// What the passes make of a history.
pub struct Passes {
    filtered: Filtered,
    /// Colour and variance, each after as many passes as were chosen.
    shown: Option<Image>,
    /// Lightly filtered light, in which the next frame looks for reflections.
    pub light: Option<Interleaved>,
}

/// Estimates the variance of a history and filters its colour. The first pass may become the colour of the history that
/// goes on; `joined`, if there is one, is filtered instead of it, and has seen frames that the next frame must not know. Its
/// exposure is given.
pub fn filter(
    now: &Current,
    guide: &Guide,
    reports: &Reports,
    history: &mut Interleaved,
    mut joined: Option<Interleaved>,
    exposure: f32,
    mut choosing: Option<&mut Choosing>,
) -> Passes {
    let params = now.params;
    let (size, usual) = (now.size(), params.atrous.iterations);
    let feeds_back = params.feedback && joined.is_none();
    let most = (choosing.as_ref()).map_or(usual, |_| params.passes());
    let weighs = params.tap_exposure.is_finite();
    let mut filtered = Filtered::new(guide.layout, choosing.is_some(), weighs);
    let relative_noise = params.atrous.relative_noise;
    if relative_noise.is_finite() && !matches!(now.frame.guides(), Guides::More) {
        let source = joined.as_ref().unwrap_or(history).pixels();
        filtered.limit(source.part(0..3), source.part(5..6), relative_noise);
    }
    let mut shown = choosing.is_some().then(|| Image::blank(size, 4));
    // The next frame looks for reflections in it only if both frames have cameras.
    let reflects = !params.reflections.is_empty() && now.frame.camera.is_some();
    let mut light = reflects.then(|| Interleaved::blank(size, 3));
    for pass in 0..=most {
        let mut candidate = (choosing.is_some() && pass > 0).then(|| Image::blank(size, 1));
        let (mut tiles, mut prediction, mut levels) = (None, None, None);
        if let Some(choosing) = &mut choosing {
            (tiles, prediction) = (choosing.tiles.as_ref(), choosing.candidates.first());
            levels = Some(choosing.levels.chunks_mut(size.width));
        }
        let keep = Keep {
            pass,
            usual,
            most,
            confidence: View::new(size, 1, reports.confidence),
            length: View::new(size, 1, reports.history_length),
            textured: now.texture.is_some(),
            tiles: tiles.map(|tiles| Levels(tiles.view())),
        };
        let light = light.as_mut().filter(|_| pass == usual.min(2));
        let mut kept = KeptRows {
            levels,
            shown: shown.as_mut().map(|shown| rows_of(shown).into_iter()),
            candidate: (candidate.as_mut()).map(|image| image.data_mut().chunks_mut(size.width)),
            light: light.map(|light| light.data_mut().chunks_mut(3 * size.width)),
        };
        if pass == 0 {
            let source = joined.as_ref().unwrap_or(history).pixels();
            let [color, moments, length] = accumulate::parts(source);
            let begin = Begin {
                color,
                length,
                prediction: prediction.map(Image::pixels),
                variance: Estimate::new(moments, length, guide, params.variance),
                exposure: params.tap_exposure * exposure,
                settled: params.atrous.settled,
                longest: (joined.as_ref()).map(|_| 1.0 / now.accumulate.alpha),
                keep,
            };
            let mut rest = size.height;
            let outs = filtered.bands().map(|image| {
                let count = rest.min(BAND);
                rest -= count;
                (image, (0..count).map(|_| kept.next(None)).collect())
            });
            rows::run(&begin, size.height, outs);
            joined = None;
        } else {
            let row = size.width * accumulate::CHANNELS;
            let feedback = feeds_back && pass == usual.min(1);
            let mut colors = feedback.then(|| history.data_mut().chunks_mut(row));
            let outs =
                (0..size.height).map(|_| kept.next(colors.as_mut().and_then(Iterator::next)));
            filtered.filter(guide, params.atrous, pass - 1, &keep, outs);
        }
        if let Some((choosing, candidate)) = choosing.as_mut().zip(candidate) {
            choosing.candidates.push(candidate);
        }
    }
    Passes {
        filtered,
        shown,
        light,
    }
}

/// The images that a pass writes to, row by row from the top.
struct KeptRows<'a> {
    levels: Option<ChunksMut<'a, f32>>,
    shown: Option<vec::IntoIter<[&'a mut [f32]; 4]>>,
    candidate: Option<ChunksMut<'a, f32>>,
    light: Option<ChunksMut<'a, f32>>,
}

impl<'a> KeptRows<'a> {
    fn next(&mut self, history: Option<&'a mut [f32]>) -> Kept<'a> {
        fn next<I: Iterator>(rows: &mut Option<I>) -> Option<I::Item> {
            rows.as_mut()?.next()
        }
        let choice = next(&mut self.levels).zip(next(&mut self.shown));
        Kept {
            choice: choice.map(|(levels, image)| Shown { levels, image }),
            candidate: next(&mut self.candidate),
            history,
            light: next(&mut self.light),
        }
    }
}

/// Estimates the variance of a history, and makes its colour ready for the filter.
struct Begin<'a> {
    color: Pixels<'a>,
    length: Pixels<'a>,
    prediction: Option<Pixels<'a>>,
    variance: Estimate<'a>,
    /// The light above which brighter taps weigh less, if they do, and the fewest samples of which they do.
    exposure: f32,
    settled: f32,
    /// Samples that one side's history counts for at most. Of both sides' mean over more, the variance is less.
    longest: Option<f32>,
    keep: Keep<'a>,
}

impl<'a> Kernel for Begin<'a> {
    type Out = (atrous::Band<'a>, Vec<Kept<'a>>);

    #[inline(always)]
    fn rows<S: Simd>(&self, simd: S, rows: Range<usize>, (mut image, mut kept): Self::Out) {
        let mut around = self.variance.around();
        let mut lengths = [0.0; SEGMENT];
        for (y, kept) in rows.clone().zip(&mut kept) {
            let (first, variance) = (y == rows.start, image.variance(y));
            self.variance.row(simd, y, first, &mut around, variance);
            if let Some(longest) = self.longest {
                for run in segments(y, variance.len()) {
                    self.length.load(run, 0, &mut lengths[..run.len]);
                    let variances = variance[run.x..].iter_mut();
                    for (variance, length) in variances.zip(&lengths[..run.len]) {
                        *variance *= smaller(longest / length, 1.0);
                    }
                }
            }
            image.complete(self.color, self.prediction, y);
            image.weigh(self.length, self.exposure, self.settled, y);
            self.keep.take(y, image.ready(y), kept);
        }
    }
}

/// Stores the parts of a pass's result that later steps read.
struct Keep<'a> {
    pass: u32,
    usual: u32,
    /// Passes that are run.
    most: u32,
    /// Confidence of the history of earlier frames.
    confidence: View<'a>,
    /// History length, later frames included.
    length: View<'a>,
    /// Whether texture is divided out of the light.
    textured: bool,
    tiles: Option<Levels<'a>>,
}

/// Output rows of one pass.
struct Kept<'a> {
    choice: Option<Shown<'a>>,
    candidate: Option<&'a mut [f32]>,
    history: Option<&'a mut [f32]>,
    light: Option<&'a mut [f32]>,
}

struct Shown<'a> {
    /// Number of passes that each pixel shows, a fraction between tiles that differ. Written with the unfiltered image.
    levels: &'a mut [f32],
    image: [&'a mut [f32]; 4],
}

impl<'a> Sink for Keep<'a> {
    type Row = Kept<'a>;

    #[inline(always)]
    fn take(&self, y: usize, filtered: FilteredRow, kept: &mut Kept<'a>) {
        let width = filtered.variance.len();
        let mut color = [[0.0; SEGMENT]; 3];
        let pass = self.pass as f32;
        for run in segments(y, width) {
            let mut shows = false;
            if let Some(Shown { levels, .. }) = &mut kept.choice {
                prefetch(levels, run.ahead(), run.len);
                let levels = &mut levels[run.x..][..run.len];
                if self.pass == 0 {
                    self.find_levels(run, &filtered, levels);
                }
                // Most runs show another pass.
                shows = levels
                    .iter()
                    .fold(false, |any, level| any | ((level - pass).abs() < 1.0));
            }
            if shows || kept.history.is_some() || kept.light.is_some() {
                filtered.colors(run, &mut color);
            }
            if let Some(shown) = kept.choice.as_mut().filter(|_| shows) {
                shown.add(pass, run, &color, filtered.variance);
            }
            if let Some(candidate) = &mut kept.candidate {
                candidate[run.x..][..run.len].copy_from_slice(filtered.luminance(run));
            }
            if let Some(history) = &mut kept.history {
                let history = history.as_chunks_mut::<{ accumulate::CHANNELS }>().0;
                for (i, pixel) in history[run.x..][..run.len].iter_mut().enumerate() {
                    (pixel[0], pixel[1], pixel[2]) = (color[0][i], color[1][i], color[2][i]);
                }
            }
            if let Some(light) = &mut kept.light {
                let light = light.as_chunks_mut::<3>().0;
                for (i, pixel) in light[run.x..][..run.len].iter_mut().enumerate() {
                    *pixel = [color[0][i], color[1][i], color[2][i]];
                }
            }
        }
    }
}

impl Keep<'_> {
    /// Missing pixels get the usual number of passes, which fills them. A pixel whose only sample is this frame's gets one
    /// more than its tile, whose evidence is of pixels that have history; not where that would blur texture.
    #[inline(always)]
    fn find_levels(&self, run: Run, filtered: &FilteredRow, levels: &mut [f32]) {
        let (usual, most) = (self.usual as f32, self.most as f32);
        levels.fill(usual);
        let Some(tiles) = &self.tiles else { return };
        tiles.read(run, levels);
        let [confidence, length] = [self.confidence, self.length].map(|image| image.run(0, run));
        let luminance = filtered.luminance(run);
        for (i, level) in levels.iter_mut().enumerate() {
            let alone = self.textured & (confidence[i] == 0.0) & (length[i] < 1.5);
            let shown = smaller(*level + f32::from(u8::from(alone)), most);
            *level = if luminance[i].is_nan() { usual } else { shown };
        }
    }
}

impl Shown<'_> {
    /// Adds the image after one number of passes, weighted by its share in each pixel.
    #[inline(always)]
    fn add(&mut self, pass: f32, run: Run, color: &[Row; 3], variance: &[f32]) {
        let levels = &self.levels[run.x..][..run.len];
        let [r, g, b] = color.each_ref().map(|row| &row[..run.len]);
        let values = [r, g, b, &variance[run.x..][..run.len]];
        // Most parts of a row show another pass: their memory is left alone.
        for start in (0..run.len).step_by(LANES) {
            let levels = part(levels, start, pass - 1.0);
            let shares = levels.map(|level| larger(1.0 - (level - pass).abs(), 0.0));
            if shares == [0.0; LANES] {
                continue;
            }
            for (image, values) in self.image.iter_mut().zip(values) {
                let image = &mut image[run.x..][..run.len];
                let (mut shown, values) = (part(image, start, 0.0), part(values, start, 0.0));
                for i in 0..LANES {
                    // Of two images that are mixed, that of fewer passes comes first: added to −0, it keeps its bits.
                    let begun = if pass > levels[i] { shown[i] } else { -0.0 };
                    let mixed = begun + shares[i] * values[i];
                    shown[i] = if shares[i] > 0.0 { mixed } else { shown[i] };
                }
                match image[start..].first_chunk_mut() {
                    Some(whole) => *whole = shown,
                    None => image[start..].copy_from_slice(&shown[..run.len - start]),
                }
            }
        }
    }
}

/// A vector of a row, filled up where the row ends.
#[inline(always)]
fn part(row: &[f32], start: usize, beyond: f32) -> [f32; LANES] {
    match row[start..].first_chunk() {
        Some(whole) => *whole,
        None => {
            let mut part = [beyond; LANES];
            part[..row.len() - start].copy_from_slice(&row[start..]);
            part
        }
    }
}

impl Passes {
    pub fn size(&self) -> Size {
        self.filtered.size()
    }

    #[inline(always)]
    pub fn variance(&self, y: usize) -> &[f32] {
        match &self.shown {
            Some(shown) => shown.view().row(3, y),
            None => self.filtered.row(y).variance,
        }
    }
}

impl Colors for Passes {
    #[inline(always)]
    fn colors(&self, run: Run, into: &mut [Row; 3]) {
        match &self.shown {
            Some(shown) => shown.pixels().colors(run, into),
            None => self.filtered.colors(run, into),
        }
    }
}
