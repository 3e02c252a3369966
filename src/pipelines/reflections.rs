//! Reflections: histories fetched along virtual motion, where they predict the new samples better than the surface's own.
//!
//! What a glossy surface shows moves like a point behind it (see [`crate::kernels::camera::virtual_motion`]), at a distance
//! that renderers seldom tell. So a few are tried. Each is a prediction of the new sample that has not seen it, and
//! `prediction_gain` compares it with the prediction of the surface's own motion, without bias; averaged over frames,
//! the best one wins where it is better than the surface by a margin. What is compared is lightly filtered light.
//!
//! A candidate costs a gather and a window. Tiles where none has won lately stop asking, except in every eighth frame, and
//! are passed over by the gathers.

use std::ops::Range;

use pulp::Simd;

use super::frame::Frame;
use crate::image::{BandMut, Image, Pixels, Records, Run, SEGMENT, Size, Tiles, View, segments};
use crate::kernels::camera::motion::{Geometry, Shown};
use crate::kernels::camera::pinhole::Camera;
use crate::kernels::camera::virtual_motion::Mirrored;
use crate::kernels::fetch::footprint::{Filter, Motion};
use crate::kernels::fetch::reproject::{self, Fetch, Fetched};
use crate::kernels::judge::prediction::{Ids, mean, terms};
use crate::kernels::judge::surface::{self, Surface, Tests};
use crate::kernels::merge::accumulate::CHANNELS;
use crate::pixels::{Rolling, Row};
use crate::rows::{self, BAND, Kernel, LanesKernel};

/// A candidate's average gain has to be below this to win, in units of relative squared error.
const MARGIN: f32 = -0.02;
/// Share of a new gain in the average.
const SHARE: f32 = 0.3;
/// Pixels to each side of the window of a gain.
const RADIUS: usize = 3;
/// How often tiles that do not ask are asked all the same.
const PERIOD: usize = 8;

/// What one frame leaves to the next.
pub struct Memory {
    /// Lightly filtered light, as the next frame's prediction.
    pub light: Records,
    pub scores: Scores,
}

/// What choosing renews.
pub struct Scores {
    /// Average gain of each candidate.
    pub image: Records,
    asking: Tiles,
    age: usize,
}

impl Scores {
    pub fn new(size: Size, candidates: usize) -> Self {
        Self {
            image: Records::new(size, candidates),
            asking: Tiles::new(size),
            age: 0,
        }
    }
}

/// What [`reproject`] fetches of the history and of this memory, along the surface's motion.
pub struct Carried<'a> {
    pub history: &'a mut Image,
    pub coverage: &'a mut Image,
    pub light: View<'a>,
    pub scores: View<'a>,
}

/// Replaces history, and its coverage, by that of the best candidate, where one wins.
pub fn choose(
    memory: &Memory,
    history: Pixels,
    distances: &[f32],
    frame: &Frame,
    cameras: [&Camera; 2],
    before: Surface,
    color: View,
    carried: Carried,
) -> Option<Scores> {
    let geometry = frame.geometry()?;
    let sources: Vec<_> = match (frame.hit_distance, frame.surface.depth) {
        (Some(known), _) => vec![Source::Known(known)],
        (None, Some(depth)) => distances
            .iter()
            .map(|&multiple| Source::Depths(depth, multiple))
            .collect(),
        (None, None) => return None,
    };
    let size = color.size;
    let everywhere = memory.scores.age.is_multiple_of(PERIOD);
    let mut scores = Scores {
        image: Records::new(size, distances.len()),
        asking: Tiles::new(size),
        age: memory.scores.age + 1,
    };
    if !everywhere && !memory.scores.asking.any() {
        return Some(scores);
    }
    // Elsewhere on the mirror: depth says nothing about what it shows.
    let [now, before] = [frame.surface, before].map(|surface| Surface {
        depth: None,
        color: None,
        ..surface
    });
    let tests = Tests::new(now, before, None, &surface::Params::default());
    let params = reproject::Params {
        filter: Filter::Bilinear,
        fallback: false,
        dering: true,
    };
    let candidates = Candidates {
        geometry,
        camera: cameras[0],
        mirrored: Mirrored::new(cameras[0], cameras[1]),
        sources,
        asking: (!everywhere).then_some(&memory.scores.asking),
    };
    let mut errors = Image::blank(size, candidates.sources.len());
    let predict = Predict {
        candidates: &candidates,
        fetch: Fetch::new(&[memory.light.pixels()], size, tests, params),
        base: carried.light,
        coverage: carried.coverage.view(),
        color,
    };
    rows::run(&predict, size.height, errors.bands());
    let choose = Choose {
        candidates: &candidates,
        errors: &errors,
        ids: frame.surface.ids,
        fetch: Fetch::new(&[history], size, tests, params),
        before: carried.scores,
    };
    let band = BAND * size.width * distances.len();
    let outs = carried.history.bands().zip(carried.coverage.bands());
    let outs = outs
        .zip(scores.image.data_mut().chunks_mut(band))
        .zip(scores.asking.bands());
    let outs = outs.map(|(((history, coverage), scores), won)| Outs {
        history,
        coverage,
        scores,
        won,
    });
    rows::run_lanes(&choose, size.height, outs);
    scores.asking = scores.asking.grown();
    Some(scores)
}

/// Where distances to what is reflected come from.
#[derive(Clone, Copy)]
enum Source<'a> {
    Known(Pixels<'a>),
    /// So many times the depth.
    Depths(Pixels<'a>, f32),
}

struct Candidates<'a> {
    geometry: Geometry<'a>,
    camera: &'a Camera,
    mirrored: Mirrored<'a>,
    sources: Vec<Source<'a>>,
    /// Where; everywhere if there are none.
    asking: Option<&'a Tiles>,
}

/// Room for the motion of a candidate.
struct Room {
    hits: Row,
    shown: Shown,
    motion: [Row; 2],
}

impl Room {
    fn new() -> Self {
        Self {
            hits: [0.0; SEGMENT],
            shown: Shown::nothing(),
            motion: [[0.0; SEGMENT]; 2],
        }
    }
}

impl Candidates<'_> {
    /// The parts of a row that ask.
    #[inline(always)]
    fn runs(&self, y: usize, width: usize) -> impl Iterator<Item = Run> {
        segments(y, width).flat_map(|run| {
            let part = self.asking.map(|tiles| tiles.runs(run));
            let whole = part.is_none().then_some(run);
            part.into_iter().flatten().chain(whole)
        })
    }

    /// The motion of a run along a candidate; `room` has what the run shows.
    #[inline(always)]
    fn follow<'r>(&self, source: Source, run: Run, room: &'r mut Room) -> Motion<'r> {
        let hits = &mut room.hits[..run.len];
        match source {
            Source::Known(distance) => distance.load(run, 0, hits),
            Source::Depths(depth, multiple) => {
                depth.load(run, 0, hits);
                hits.iter_mut().for_each(|hit| *hit *= multiple);
            }
        }
        let [x, y] = room.motion.each_mut().map(|row| &mut row[..run.len]);
        self.mirrored.motion(&room.shown, hits, x, y);
        Motion { x, y, depth: None }
    }
}

/// The terms of each candidate's gain: not finite where they are not known, NaN where nothing was fetched.
struct Predict<'a> {
    candidates: &'a Candidates<'a>,
    fetch: Fetch<'a>,
    base: View<'a>,
    coverage: View<'a>,
    color: View<'a>,
}

impl<'a> Kernel for Predict<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut errors: BandMut<'a>) {
        let width = self.color.size.width;
        let (mut room, mut fetched) = (Room::new(), self.fetch.room());
        let (mut light, mut base) = ([[0.0; SEGMENT]; 3], [[0.0; SEGMENT]; 3]);
        for y in rows {
            if self.candidates.asking.is_some() {
                for k in 0..self.candidates.sources.len() {
                    errors.row(k, y).fill(f32::NAN);
                }
            }
            for run in self.candidates.runs(y, width) {
                let covered = &self.coverage.row(0, y)[run.x..][..run.len];
                let [color, known] = [self.color, self.base]
                    .map(|image| image.rows::<3>(y).map(|row| &row[run.x..][..run.len]));
                for (base, known) in base.iter_mut().zip(known) {
                    for i in 0..run.len {
                        base[i] = if covered[i] > 0.0 { known[i] } else { f32::NAN };
                    }
                }
                let Candidates {
                    geometry, camera, ..
                } = self.candidates;
                room.shown.find(*geometry, camera, run);
                for (k, &source) in self.candidates.sources.iter().enumerate() {
                    let motion = self.candidates.follow(source, run, &mut room);
                    self.fetch.run(run, motion, &mut fetched);
                    let records = fetched.values(0)[..3 * run.len].as_chunks::<3>().0;
                    let [r, g, b] = light.each_mut().map(|row| &mut row[..run.len]);
                    for i in 0..run.len {
                        [r[i], g[i], b[i]] = records[i];
                    }
                    let errors = &mut errors.row(k, y)[run.x..][..run.len];
                    let [light, base] =
                        [&light, &base].map(|rows| rows.each_ref().map(Row::as_slice));
                    terms(light, base, color, errors);
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

/// Averages the scores, which start anew where nobody asks, and takes the history of the best candidate where one wins.
struct Choose<'a> {
    candidates: &'a Candidates<'a>,
    errors: &'a Image,
    ids: Option<Pixels<'a, u32>>,
    fetch: Fetch<'a>,
    /// Scores so far.
    before: View<'a>,
}

struct Outs<'a> {
    history: BandMut<'a>,
    coverage: BandMut<'a>,
    scores: &'a mut [f32],
    /// Whether a candidate wins, tile by tile.
    won: &'a mut [bool],
}

impl<'a> LanesKernel for Choose<'a> {
    type Out = Outs<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, simd: S, rows: Range<usize>, mut out: Outs<'a>) {
        let Size { height, width } = self.errors.size;
        let (top, candidates) = (rows.start, self.candidates);
        let mut ids = Ids::new(self.ids, width, RADIUS);
        let around = candidates.sources.iter();
        let mut around: Vec<Rolling<1>> = around.map(|_| Rolling::new(width, RADIUS)).collect();
        let (mut room, mut fetched) = (Room::new(), self.fetch.room());
        let mut gain = [0.0; SEGMENT];
        for y in rows {
            ids.roll(y, y == top);
            for (k, around) in around.iter_mut().enumerate() {
                around.roll(self.errors.view().channel(k).into(), y, y == top);
            }
            for run in candidates.runs(y, width) {
                let mut best = [MARGIN; SEGMENT];
                let mut winner = [u32::MAX; SEGMENT];
                for (k, around) in around.iter().enumerate() {
                    mean(simd, run, height, around, &ids, &mut gain);
                    let old = &self.before.row(k, y)[run.x..][..run.len];
                    let [errors] = around.row(y as isize);
                    let errors = &errors[RADIUS + run.x..][..run.len];
                    let (best, winner) = (&mut best[..run.len], &mut winner[..run.len]);
                    let gain = &mut gain[..run.len];
                    for i in 0..run.len {
                        let score = old[i] + SHARE * (gain[i] - old[i]);
                        gain[i] = score;
                        let wins = (score < best[i]) & !errors[i].is_nan();
                        best[i] = if wins { score } else { best[i] };
                        winner[i] = if wins { k as u32 } else { winner[i] };
                    }
                    let scores = self.before.channels;
                    let first = ((y - top) * width + run.x) * scores;
                    let records = out.scores[first..].chunks_exact_mut(scores);
                    for (record, &score) in records.zip(&*gain) {
                        record[k] = score;
                    }
                }
                let winner = &winner[..run.len];
                if winner.iter().all(|&k| k == u32::MAX) {
                    continue;
                }
                let won = &mut out.won[run.x / Tiles::SIDE..];
                for (won, winner) in won.iter_mut().zip(winner.chunks(Tiles::SIDE)) {
                    *won |= winner.iter().any(|&k| k != u32::MAX);
                }
                self.replace(run, winner, &mut room, &mut fetched, &mut out);
            }
        }
    }
}

impl Choose<'_> {
    /// Takes what was carried along the winners' motion.
    #[inline(always)]
    fn replace(
        &self,
        run: Run,
        winner: &[u32],
        room: &mut Room,
        fetched: &mut Fetched,
        out: &mut Outs,
    ) {
        let [mut x, mut y] = [[f32::NAN; SEGMENT]; 2];
        let Candidates {
            geometry, camera, ..
        } = self.candidates;
        room.shown.find(*geometry, camera, run);
        for (k, &source) in self.candidates.sources.iter().enumerate() {
            let motion = self.candidates.follow(source, run, room);
            for (i, &winner) in winner.iter().enumerate() {
                if winner == k as u32 {
                    (x[i], y[i]) = (motion.x[i], motion.y[i]);
                }
            }
        }
        let motion = Motion {
            x: &x[..run.len],
            y: &y[..run.len],
            depth: None,
        };
        self.fetch.run(run, motion, fetched);
        let carried = &fetched.coverage[..run.len];
        let records = fetched.values(0)[..CHANNELS * run.len]
            .as_chunks::<CHANNELS>()
            .0;
        for channel in 0..CHANNELS {
            let values = &mut out.history.row(channel, run.y)[run.x..][..run.len];
            for i in 0..run.len {
                values[i] = if carried[i] > 0.0 {
                    records[i][channel]
                } else {
                    values[i]
                };
            }
        }
        for (coverage, &carried) in out.coverage.row(0, run.y)[run.x..][..run.len]
            .iter_mut()
            .zip(carried)
        {
            *coverage = if carried > 0.0 { carried } else { *coverage };
        }
    }
}
