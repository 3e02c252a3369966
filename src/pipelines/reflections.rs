//! Reflections: histories fetched along virtual motion, where they predict the new samples better than the surface's own.
//!
//! What a glossy surface reflects moves like a point behind it (see [`crate::kernels::camera::virtual_motion`]), at a
//! distance that renderers seldom tell. So a few distances are tried, each a candidate. The history that a candidate fetches
//! predicts the new sample without having seen it, and `prediction_gain` compares its error with that of the surface's own
//! history, without bias. Averaged over frames, the gain tells the best candidate, and the standardized gain tells whether that
//! is chance. Both histories are lightly filtered light.
//!
//! Evaluating a candidate costs a gather and a window. So it is evaluated in every second row, by the mean of the samples in
//! that row and the next, as reflections that matter are larger than two rows. And as with one noisy sample per pixel some
//! candidate always wins somewhere by chance, each is evaluated only in tiles where it won a pixel beyond doubt in the last
//! frame and in the tiles around them. Elsewhere it is tried again in two frames of sixteen, in other rows of tiles each time,
//! so that no frame takes longer than others.
//!
//! What moves like a reflection in light does so in the image only where the surface has no texture of its own, which moves
//! with it: elsewhere the output stage follows the surface ([`Won::seen`]).

use std::ops::Range;

use super::frame::Frame;
use crate::image::{
    BandMut, Image, Interleaved, Pixels, Run, SEGMENT, Size, View, plane_bands, segments,
};
use crate::kernels::camera::motion::{Geometry, Shown};
use crate::kernels::camera::pinhole::Camera;
use crate::kernels::camera::virtual_motion::Mirrored;
use crate::kernels::fetch::footprint::Filter;
use crate::kernels::fetch::reproject::{self, Fetch, Fetched};
use crate::kernels::fetch::validate::{self, Surface, Tests};
use crate::kernels::judge::prediction::{Gains, Ids, average, terms};
use crate::kernels::merge::accumulate::CHANNELS;
use crate::math::{is_present, luminance};
use crate::pixels::{MotionLanes, MotionRun, PixelsMut, Rolling, Row};
use crate::rows::{self, BAND, Kernel, Simd};
use crate::tiles::{Tiles, runs_in};

/// A candidate wins only if its standardized gain, averaged over frames, is below this. If frames are independent, chance alone
/// does that to one pixel in nine, but only where both histories predict about equally well. A threshold of the gain itself
/// would ask too much where there is little noise, as on mirrors, and too little under caustics.
const SIGNIFICANT: f32 = -0.5;
/// Blend factor of a new gain in the average.
const SHARE: f32 = 0.3;
/// Pixels to each side of the window over which a gain is averaged.
const RADIUS: usize = 3;
/// The winner of pixels where no candidate wins.
const NONE: u32 = u32::MAX;
/// What a pixel's average standardized gain must be below for its candidate to be evaluated in the next frame, too. Chance
/// alone does that to one pixel in a hundred.
const BEYOND_DOUBT: f32 = -1.0;
/// Every row of tiles evaluates all candidates in [`TRIED`] successive frames of so many: after one, the running average, which
/// begins at 0, is still too small to decide.
const PERIOD: usize = 16;
const TRIED: usize = 2;
/// Candidates are evaluated in one of so many rows.
const ROWS: usize = 2;
/// Luminances of albedo that differ by more than this share are texture.
const TEXTURE: f32 = 0.1;

/// What one frame leaves to the next.
pub struct Memory {
    /// The lightly filtered light by which the next frame's candidates are compared.
    pub light: Interleaved,
    pub scores: Scores,
}

/// The candidates' record over the frames so far.
pub struct Scores {
    /// The average gain of each, then the average standardized gain of each, in the rows in which they are evaluated.
    image: Interleaved,
    /// The tiles in which the next frame evaluates each.
    evaluated: Vec<Tiles>,
    age: usize,
}

impl Scores {
    /// Of an image of this size, before its candidates have been evaluated.
    pub fn new(size: Size, candidates: usize) -> Self {
        Self::after(0, size, candidates, Interleaved::new)
    }

    /// After `age` frames.
    fn after(
        age: usize,
        size: Size,
        candidates: usize,
        image: impl FnOnce(Size, usize) -> Interleaved,
    ) -> Self {
        let tried = |row| age < TRIED || (age + TRIED * row) % PERIOD < TRIED;
        Self {
            image: image(rows_of(size), 2 * candidates),
            evaluated: vec![Tiles::rows(size, tried); candidates],
            age,
        }
    }
}

/// The rows in which candidates are evaluated.
fn rows_of(size: Size) -> Size {
    Size {
        height: size.height.div_ceil(ROWS),
        ..size
    }
}

/// What [`choose`] leaves beside the history.
pub struct Won {
    pub scores: Scores,
    /// The motion along which each pixel's history was fetched; None if it is the surface's own everywhere.
    pub motion: Option<Image>,
}

impl Won {
    /// The motion of what is seen, texture included: the surface's own where it has texture. None if it is so everywhere.
    /// Without albedo, the candidates were compared with their texture, so that the motion is that of what is seen.
    pub fn seen(&mut self, own: Pixels, albedo: Option<Pixels>) -> Option<&Image> {
        let motion = self.motion.as_mut()?;
        if let Some(albedo) = albedo {
            rows::run(&Seen { own, albedo }, own.size.height, motion.bands());
        }
        Some(motion)
    }
}

/// Puts a surface's own motion where it has texture: where the albedo of 3×3 pixels is not that of the pixel.
struct Seen<'a> {
    own: Pixels<'a>,
    albedo: Pixels<'a>,
}

impl<'a> Kernel for Seen<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut motion: BandMut<'a>) {
        let mut lanes = MotionLanes::zeroed();
        for y in rows {
            let [x, y_] = motion.rows::<2>(y);
            for run in segments(y, self.own.size.width) {
                let own = lanes.load(&self.own, run);
                let [x, y_] = [&mut *x, &mut *y_].map(|row| &mut row[run.x..][..run.len]);
                for i in 0..run.len {
                    let moved = (x[i] != own.x[i]) | (y_[i] != own.y[i]);
                    if moved && self.has_texture(run.x + i, y) {
                        (x[i], y_[i]) = (own.x[i], own.y[i]);
                    }
                }
            }
        }
    }
}

impl Seen<'_> {
    fn has_texture(&self, x: usize, y: usize) -> bool {
        let Size { height, width } = self.albedo.size;
        let at = |x: usize, y: usize| {
            let [r, g, b] = self.albedo.vector(y * width + x);
            luminance(r, g, b)
        };
        let own = at(x, y);
        let [columns, rows] =
            [(x, width), (y, height)].map(|(at, most)| at.saturating_sub(1)..(at + 2).min(most));
        let mut around = rows.flat_map(|y| columns.clone().map(move |x| at(x, y)));
        // The comparison fails where one is NaN.
        !around.all(|other| (other - own).abs() <= TEXTURE * own.max(other))
    }
}

/// How history is fetched along the surface's own motion.
pub struct Own<'a> {
    pub motion: Pixels<'a>,
    pub tests: Tests<'a>,
    pub params: reproject::Params,
}

/// Replaces the fetched history and its coverage by the best candidate's where one wins. None if nothing tells how far away
/// reflected points may be.
pub fn choose(
    memory: &Memory,
    history: Pixels,
    distances: &[f32],
    frame: &Frame,
    cameras: [&Camera; 2],
    before: Surface,
    own: Own,
    color: View,
    carried: &mut Image,
    coverage: &mut [f32],
) -> Option<Won> {
    let (size, past) = (color.size, &memory.scores);
    let geometry = frame.geometry()?;
    let sources = Source::all(frame, distances)?;
    let (count, age) = (distances.len(), past.age + 1);
    if !past.evaluated.iter().any(Tiles::any) {
        let scores = Scores::after(age, size, count, Interleaved::new);
        return Some(Won {
            scores,
            motion: None,
        });
    }
    let candidates = Candidates {
        geometry,
        camera: cameras[0],
        mirrored: Mirrored::new(cameras[0], cameras[1]),
        sources,
        evaluated: &past.evaluated,
        anywhere: Tiles::any_of(size, &past.evaluated),
        tests: mirrored_tests(frame.surface, before),
        distances: count,
    };
    let mut scores = Scores::after(age, size, count, Interleaved::blank);
    let errors = candidates.evaluate(memory, &own, color, &mut scores.image);
    let mut motion = own.motion.part(0..2).to_planes();
    candidates.take_winners(
        errors,
        history,
        frame.surface.ids,
        &mut motion,
        carried,
        coverage,
        &mut scores,
    );
    let motion = Some(motion);
    Some(Won { scores, motion })
}

/// The tests for a reflected point's history. It lies elsewhere on the mirror, whose depth there says nothing about it. What a
/// turning surface reflects depends on its normal in the world, not on the one in the object's own space.
fn mirrored_tests<'a>(now: Surface<'a>, before: Surface<'a>) -> Tests<'a> {
    let world = now.normal.is_some() && before.normal.is_some();
    let [now, before] = [now, before].map(|surface| Surface {
        depth: None,
        color: None,
        object_normal: surface.object_normal.filter(|_| !world),
        ..surface
    });
    Tests::new(now, before, None, &validate::Params::default())
}

const FETCH: reproject::Params = reproject::Params::of(Filter::Bilinear);

/// The distance from a surface to what it reflects, for one candidate.
#[derive(Clone, Copy)]
enum Source<'a> {
    Known(Pixels<'a>),
    /// A multiple of the depth.
    Depths(Pixels<'a>, f32),
}

impl<'a> Source<'a> {
    /// The frame's hit distance alone if there is one, else each multiple of the depth.
    fn all(frame: &Frame<'a>, multiples: &[f32]) -> Option<Vec<Self>> {
        if let Some(known) = frame.hit_distance {
            return Some(vec![Self::Known(known)]);
        }
        let depth = frame.surface.depth?;
        let sources = multiples.iter().map(|&k| Self::Depths(depth, k));
        Some(sources.collect())
    }
}

struct Candidates<'a> {
    geometry: Geometry<'a>,
    camera: &'a Camera,
    mirrored: Mirrored<'a>,
    sources: Vec<Source<'a>>,
    /// The tiles in which each is evaluated.
    evaluated: &'a [Tiles],
    /// Those in which any is.
    anywhere: Tiles,
    tests: Tests<'a>,
    /// Half of the channels of the scores.
    distances: usize,
}

impl<'a> Candidates<'a> {
    /// Returns the terms of the gains in the rows in which they are evaluated: NaN where nothing was fetched, infinite where a
    /// sample or a prediction is missing. Writes the scores so far.
    fn evaluate(&self, memory: &Memory, own: &Own, color: View, scores: &mut Interleaved) -> Image {
        let size = scores.size;
        let mut errors = Image::blank(size, self.sources.len());
        let light = memory.light.pixels();
        let base = Fetch::new(&[light], color.size, own.tests, own.params);
        let kernel = Evaluate {
            candidates: self,
            motion: own.motion,
            base: base.and_halved(memory.scores.image.pixels()),
            fetch: Fetch::new(&[light], color.size, self.tests, FETCH),
            color,
        };
        let outs = errors.bands().zip(scores.pixels_mut());
        rows::run(&kernel, size.height, outs);
        errors
    }

    /// Renews the scores, and writes the winners' history, coverage and motion over the surface's own.
    fn take_winners(
        &self,
        errors: Image,
        history: Pixels,
        ids: Option<Pixels<u32>>,
        motion: &mut Image,
        carried: &mut Image,
        coverage: &mut [f32],
        scores: &mut Scores,
    ) {
        let size = carried.size;
        let kernel = TakeWinners {
            candidates: self,
            errors,
            ids,
            fetch: Fetch::new(&[history], size, self.tests, FETCH),
            size,
        };
        let band = BAND / ROWS * size.width * 2 * self.distances;
        let mut certain = vec![Tiles::new(size); scores.evaluated.len()];
        let mut won: Vec<_> = certain.iter_mut().map(Tiles::bands).collect();
        let outs = carried.bands().zip(plane_bands(coverage, size));
        let outs = outs
            .zip(motion.bands())
            .zip(scores.image.data_mut().chunks_mut(band))
            .map(|(((history, coverage), motion), scores)| Outs {
                history,
                coverage,
                motion,
                scores,
                won: won.iter_mut().filter_map(Iterator::next).collect(),
            });
        rows::run(&kernel, size.height, outs);
        drop(won);
        for (evaluated, certain) in scores.evaluated.iter_mut().zip(&certain) {
            evaluated.add(&certain.grown());
        }
    }
}

/// Scratch for the motion of a candidate.
struct Scratch {
    hits: Row,
    shown: Shown,
    motion: [Row; 2],
}

impl Scratch {
    fn new() -> Self {
        Self {
            hits: [0.0; SEGMENT],
            shown: Shown::nothing(),
            motion: [[0.0; SEGMENT]; 2],
        }
    }
}

impl Candidates<'_> {
    /// The motion of a run along a candidate; `scratch` holds the surfaces from the column `left` on.
    #[inline(always)]
    fn follow<'s>(
        &self,
        source: Source,
        run: Run,
        left: usize,
        scratch: &'s mut Scratch,
    ) -> MotionRun<'s> {
        let hits = &mut scratch.hits[..run.len];
        match source {
            Source::Known(distance) => distance.load(run, 0, hits),
            Source::Depths(depth, multiple) => {
                depth.load(run, 0, hits);
                hits.iter_mut().for_each(|hit| *hit *= multiple);
            }
        }
        let [x, y] = scratch.motion.each_mut().map(|row| &mut row[..run.len]);
        let start = run.x - left;
        self.mirrored.motion(&scratch.shown, start, hits, x, y);
        MotionRun { x, y, depth: None }
    }
}

/// Writes [`Evaluated`].
struct Evaluate<'a> {
    candidates: &'a Candidates<'a>,
    motion: Pixels<'a>,
    /// Fetches light and scores along that motion.
    base: Fetch<'a>,
    /// Fetches light along a candidate's motion.
    fetch: Fetch<'a>,
    color: View<'a>,
}

impl<'a> Kernel for Evaluate<'a> {
    type Out = (BandMut<'a>, PixelsMut<'a>);

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, (mut errors, mut scores): Self::Out) {
        let width = self.color.size.width;
        let candidates = self.candidates;
        let mut scratch = Scratch::new();
        let channels = 2 * candidates.distances;
        let mut lanes = MotionLanes::zeroed();
        let (mut known, mut fetched) = (self.base.scratch(), self.fetch.scratch());
        let [mut light, mut base, mut color] = [[[0.0; SEGMENT]; 3]; 3];
        for row in rows {
            let y = ROWS * row;
            for k in 0..candidates.sources.len() {
                errors.row(k, row).fill(f32::NAN);
            }
            for run in segments(y, width).flat_map(|run| candidates.anywhere.runs(run)) {
                let motion = lanes.load(&self.motion, run);
                self.base.run(run, motion, &mut known);
                take_light(&known, run.len, &mut base);
                let there = Run { y: row, ..run };
                scores.put(there, &known.values(1)[..run.len * channels], channels);
                self.sample(run, &mut color);
                (scratch.shown).find(candidates.geometry, candidates.camera, run);
                for (k, &source) in candidates.sources.iter().enumerate() {
                    for part in candidates.evaluated[k].runs(run) {
                        let motion = candidates.follow(source, part, run.x, &mut scratch);
                        self.fetch.run(part, motion, &mut fetched);
                        take_light(&fetched, part.len, &mut light);
                        let start = part.x - run.x;
                        let [base, color] = [&base, &color]
                            .map(|rows| rows.each_ref().map(|row| &row[start..][..part.len]));
                        let errors = &mut errors.row(k, row)[part.x..][..part.len];
                        terms(light.each_ref().map(Row::as_slice), base, color, errors);
                        for (error, &covered) in errors.iter_mut().zip(&fetched.coverage) {
                            let known = if error.is_finite() {
                                *error
                            } else {
                                f32::INFINITY
                            };
                            *error = if covered > 0.0 { known } else { f32::NAN };
                        }
                    }
                }
            }
        }
    }
}

/// Copies the fetched light, NaN where none was fetched.
#[inline(always)]
fn take_light(fetched: &Fetched, len: usize, light: &mut [Row; 3]) {
    let records = fetched.values(0)[..3 * len].as_chunks::<3>().0;
    let coverage = &fetched.coverage[..len];
    let [r, g, b] = light.each_mut().map(|row| &mut row[..len]);
    for i in 0..len {
        let [red, green, blue] = records[i];
        let covered = coverage[i] > 0.0;
        r[i] = if covered { red } else { f32::NAN };
        g[i] = if covered { green } else { f32::NAN };
        b[i] = if covered { blue } else { f32::NAN };
    }
}

impl Evaluate<'_> {
    /// The mean of the new samples of a run and the run below; the one that is present if the other is missing.
    #[inline(always)]
    fn sample(&self, run: Run, color: &mut [Row; 3]) {
        let below = (run.y + 1).min(self.color.size.height - 1);
        let [own, below] =
            [run.y, below].map(|y| self.color.rows::<3>(y).map(|row| &row[run.x..][..run.len]));
        for i in 0..run.len {
            let here = is_present([own[0][i], own[1][i], own[2][i]]);
            let there = is_present([below[0][i], below[1][i], below[2][i]]);
            for channel in 0..3 {
                let (own, below) = (own[channel][i], below[channel][i]);
                let one = if here { own } else { below };
                color[channel][i] = if here & there {
                    0.5 * (own + below)
                } else {
                    one
                };
            }
        }
    }
}

/// Averages the gains, from 0 where a candidate was not evaluated in the last frame, and takes the winners' history.
struct TakeWinners<'a> {
    candidates: &'a Candidates<'a>,
    errors: Image,
    ids: Option<Pixels<'a, u32>>,
    /// Fetches history along the winners' motion.
    fetch: Fetch<'a>,
    size: Size,
}

struct Outs<'a> {
    history: BandMut<'a>,
    coverage: BandMut<'a>,
    motion: BandMut<'a>,
    /// Interleaved, one row for every [`ROWS`] of the frame. At first the averages over earlier frames, in tiles where a
    /// candidate is evaluated; at last the averages with this frame, and 0 elsewhere.
    scores: &'a mut [f32],
    /// Of each candidate, the tiles in which it won a pixel beyond doubt.
    won: Vec<&'a mut [bool]>,
}

impl<'a> Kernel for TakeWinners<'a> {
    type Out = Outs<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, simd: S, rows: Range<usize>, mut out: Outs<'a>) {
        let Size { height, width } = self.size;
        let (top, candidates) = (rows.start, self.candidates);
        let mut ids = Ids::new(self.ids, width, RADIUS, ROWS);
        let around = candidates.sources.iter();
        let mut around: Vec<Rolling<1>> = around.map(|_| Rolling::new(width, RADIUS)).collect();
        let mut gains = Gains::zeroed();
        let errors = &self.errors;
        let (mut scratch, mut fetched) = (Scratch::new(), self.fetch.scratch());
        let mut lead = Lead::new(width);
        let tiles = width.div_ceil(Tiles::SIDE);
        let mut any = vec![false; tiles];
        let mut certain = vec![vec![false; tiles]; candidates.sources.len()];
        let record = 2 * candidates.distances;
        let mut renewed = vec![0.0; width * record];
        let scores = std::mem::take(&mut out.scores).chunks_mut(width * record);
        for (y, scores) in rows.step_by(ROWS).zip(scores) {
            let row = y / ROWS;
            let lines = y..(y + ROWS).min(height);
            ids.roll(row, y == top);
            lead.clear();
            // Candidates that are not evaluated have no score.
            renewed.fill(0.0);
            for (k, around) in around.iter_mut().enumerate() {
                around.roll(errors.view().channel(k).into(), row, y == top);
                let evaluated = &candidates.evaluated[k];
                for run in segments(y, width).flat_map(|run| evaluated.runs(run)) {
                    let there = Run { y: row, ..run };
                    average(simd, there, errors.size.height, around, &ids, &mut gains);
                    let part = run.x * record..(run.x + run.len) * record;
                    self.remember(k, &scores[part.clone()], &mut renewed[part], &mut gains);
                    let [errors] = around.row(row as isize);
                    lead.take(run, k, &gains, &errors[RADIUS + run.x..][..run.len]);
                }
            }
            scores.copy_from_slice(&renewed);
            lead.tally(&mut any, &mut certain);
            for y in lines {
                for run in segments(y, width).flat_map(|run| runs_in(&any, run)) {
                    let motion = self.carry(run, &lead.winner, &mut scratch, &mut fetched);
                    replace(run, &lead.winner, &fetched, &motion, &mut out);
                }
            }
        }
        for (won, certain) in out.won.into_iter().zip(&certain) {
            won.copy_from_slice(certain);
        }
    }
}

/// The candidate that predicts each pixel of a row best.
struct Lead {
    winner: Vec<u32>,
    /// Its mean gain, and its standardized one.
    best: Vec<f32>,
    sure: Vec<f32>,
}

impl Lead {
    fn new(width: usize) -> Self {
        Self {
            winner: vec![NONE; width],
            best: vec![0.0; width],
            sure: vec![0.0; width],
        }
    }

    fn clear(&mut self) {
        self.winner.fill(NONE);
        self.best.fill(0.0);
    }

    /// Lets a candidate win where its gain is significant and larger. `errors` are NaN where it has no prediction.
    #[inline(always)]
    fn take(&mut self, run: Run, k: usize, gains: &Gains, errors: &[f32]) {
        let (best, winner) = (
            &mut self.best[run.x..][..run.len],
            &mut self.winner[run.x..][..run.len],
        );
        let sure = &mut self.sure[run.x..][..run.len];
        let [gain, standardized] = [&gains.mean, &gains.standardized].map(|row| &row[..run.len]);
        for i in 0..run.len {
            let significant = (standardized[i] < SIGNIFICANT) & !errors[i].is_nan();
            let wins = significant & (gain[i] < best[i]);
            best[i] = if wins { gain[i] } else { best[i] };
            winner[i] = if wins { k as u32 } else { winner[i] };
            sure[i] = if wins { standardized[i] } else { sure[i] };
        }
    }

    /// In which tiles any candidate wins, and in which each does beyond doubt in this row or one above it.
    fn tally(&self, any: &mut [bool], certain: &mut [Vec<bool>]) {
        let winners = self.winner.chunks(Tiles::SIDE);
        for (tile, (winners, sure)) in winners.zip(self.sure.chunks(Tiles::SIDE)).enumerate() {
            any[tile] = winners.iter().any(|&winner| winner != NONE);
            for (&winner, &sure) in winners.iter().zip(sure) {
                if winner != NONE && sure < BEYOND_DOUBT {
                    certain[winner as usize][tile] = true;
                }
            }
        }
    }
}

impl TakeWinners<'_> {
    /// Averages a candidate's gains with those of earlier frames, and writes them for the next.
    #[inline(always)]
    fn remember(&self, k: usize, old: &[f32], new: &mut [f32], gains: &mut Gains) {
        let distances = self.candidates.distances;
        for (channel, averages) in [
            (k, &mut gains.mean),
            (distances + k, &mut gains.standardized),
        ] {
            let records = old
                .chunks_exact(2 * distances)
                .zip(new.chunks_exact_mut(2 * distances));
            for (average, (old, new)) in averages.iter_mut().zip(records) {
                let before = old[channel];
                *average = before + SHARE * (*average - before);
                new[channel] = *average;
            }
        }
    }

    /// Fetches history along the winners' motion, and returns that motion. Pixels without a winner fetch along the first
    /// winner's, as neighbours whose taps are neighbours, too, are fetched faster.
    #[inline(always)]
    fn carry(
        &self,
        run: Run,
        winner: &[u32],
        scratch: &mut Scratch,
        fetched: &mut Fetched,
    ) -> [Row; 2] {
        let Candidates {
            geometry,
            camera,
            sources,
            ..
        } = self.candidates;
        let winner = &winner[run.x..][..run.len];
        let [mut x, mut y] = [[0.0; SEGMENT]; 2];
        scratch.shown.find(*geometry, camera, run);
        let mut first = true;
        for (k, &source) in (0..).zip(sources) {
            if winner.contains(&k) {
                let motion = self.candidates.follow(source, run, run.x, scratch);
                for (i, &winner) in winner.iter().enumerate() {
                    let wins = first | (winner == k);
                    x[i] = if wins { motion.x[i] } else { x[i] };
                    y[i] = if wins { motion.y[i] } else { y[i] };
                }
                first = false;
            }
        }
        let motion = MotionRun {
            x: &x[..run.len],
            y: &y[..run.len],
            depth: None,
        };
        self.fetch.run(run, motion, fetched);
        [x, y]
    }
}

/// Writes the winners' history, coverage and motion: pixel by pixel, as winners are mostly few.
#[inline(always)]
fn replace(run: Run, winner: &[u32], fetched: &Fetched, motion: &[Row; 2], out: &mut Outs) {
    let records = fetched.values(0).as_chunks::<CHANNELS>().0;
    let mut history = out.history.rows::<CHANNELS>(run.y);
    let coverage = out.coverage.row(0, run.y);
    let mut moved = out.motion.rows::<2>(run.y);
    for i in 0..run.len {
        let (x, carried) = (run.x + i, fetched.coverage[i]);
        if winner[x] != NONE && carried > 0.0 {
            for (row, &value) in history.iter_mut().zip(&records[i]) {
                row[x] = value;
            }
            coverage[x] = carried;
            for (moved, motion) in moved.iter_mut().zip(motion) {
                moved[x] = motion[i];
            }
        }
    }
}
