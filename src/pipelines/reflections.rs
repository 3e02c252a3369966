//! Reflections: histories fetched along virtual motion, where they predict the new samples better than the surface's own.
//!
//! What a glossy surface shows moves like a point behind it (see [`crate::kernels::camera::virtual_motion`]), at a distance
//! that renderers seldom tell. So a few are tried. Each is a prediction of the new sample that has not seen it, and
//! `prediction_gain` compares it with the prediction of the surface's own motion, without bias; averaged over frames,
//! the best one wins where it is better than the surface by a margin. What is compared is lightly filtered light.
//!
//! A candidate costs a gather and a window. Every second row is asked, for itself and the next, by the mean of what is sampled in
//! both: reflections that are worth it are larger than that. With one noisy sample a pixel, some win by chance, reflections or
//! not: a candidate goes on to be asked in tiles where it has won for many pixels and in those around them, elsewhere in every
//! eighth frame only.

use std::ops::Range;

use pulp::Simd;

use super::frame::Frame;
use crate::image::{
    BandMut, Image, Pixels, Records, Run, SEGMENT, Size, Tiles, View, bands_of, runs_in, segments,
};
use crate::kernels::camera::motion::{Geometry, Shown};
use crate::kernels::camera::pinhole::Camera;
use crate::kernels::camera::virtual_motion::Mirrored;
use crate::kernels::fetch::footprint::{Filter, Motion, MotionLanes};
use crate::kernels::fetch::reproject::{self, Fetch, Fetched};
use crate::kernels::judge::prediction::{Ids, mean, terms};
use crate::kernels::judge::surface::{self, Surface, Tests};
use crate::kernels::merge::accumulate::CHANNELS;
use crate::math::is_present;
use crate::pixels::{Rolling, Row};
use crate::rows::{self, BAND, Kernel, LanesKernel};

/// A candidate's average gain has to be below this to win, in units of relative squared error.
const MARGIN: f32 = -0.02;
/// Share of a new gain in the average.
const SHARE: f32 = 0.3;
/// Pixels to each side of the window of a gain.
const RADIUS: usize = 2;
/// Where no candidate wins.
const NONE: u32 = u32::MAX;
/// How often all tiles are asked.
const PERIOD: usize = 8;
/// Rows of which the first is asked.
const ROWS: usize = 2;
/// Pixels of a tile, of those that are asked, for which a candidate has to win to be asked again: a sixteenth.
const MANY: usize = Tiles::SIDE * Tiles::SIDE / ROWS / 16;

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
    /// Where each is asked.
    asking: Vec<Tiles>,
    age: usize,
}

impl Scores {
    pub fn new(size: Size, candidates: usize) -> Self {
        Self {
            image: Records::new(size, candidates),
            asking: vec![Tiles::new(size); candidates],
            age: 0,
        }
    }
}

/// What choosing finds.
pub struct Won {
    pub scores: Scores,
    /// The motion along which history was fetched; None if that was the surface's own everywhere.
    pub motion: Option<Image>,
}

/// How histories are fetched along the surface's own motion.
pub struct Own<'a> {
    pub motion: Pixels<'a>,
    pub tests: Tests<'a>,
    pub params: reproject::Params,
}

/// Replaces what was carried of history, and its coverage, by that of the best candidate, where one wins.
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
        age: memory.scores.age + 1,
        ..Scores::new(size, distances.len())
    };
    if !everywhere && !memory.scores.asking.iter().any(Tiles::any) {
        return Some(Won {
            scores,
            motion: None,
        });
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
    let asking = (!everywhere).then_some(&*memory.scores.asking);
    let candidates = Candidates {
        geometry,
        camera: cameras[0],
        mirrored: Mirrored::new(cameras[0], cameras[1]),
        sources,
        asking: asking.map(|each| (each, Tiles::any_of(size, each))),
    };
    let asked = Size {
        height: size.height.div_ceil(ROWS),
        ..size
    };
    let count = candidates.sources.len();
    let mut errors = Image::blank(asked, count);
    let mut before = Image::blank(asked, count);
    let light = memory.light.pixels();
    let known = [light, memory.scores.image.pixels()];
    let predict = Predict {
        candidates: &candidates,
        motion: own.motion,
        base: Fetch::new(&known, size, own.tests, own.params),
        fetch: Fetch::new(&[light], size, tests, params),
        color,
        scores: distances.len(),
    };
    let outs = errors.bands().zip(before.bands());
    rows::run(&predict, asked.height, outs);
    let choose = Choose {
        candidates: &candidates,
        errors: &errors,
        before: &before,
        ids: frame.surface.ids,
        fetch: Fetch::new(&[history], size, tests, params),
        size,
        scores: distances.len(),
    };
    let band = BAND * size.width * distances.len();
    let mut motion = own.motion.part(0..2).to_planes();
    let outs = carried.bands().zip(bands_of(coverage, size));
    let outs = outs.zip(motion.bands());
    let outs = outs.zip(scores.image.data_mut().chunks_mut(band));
    let mut won: Vec<_> = scores.asking.iter_mut().map(Tiles::bands).collect();
    let outs = outs.map(|(((history, coverage), motion), scores)| Outs {
        history,
        coverage,
        motion,
        scores,
        won: won.iter_mut().filter_map(Iterator::next).collect(),
    });
    rows::run_lanes(&choose, size.height, outs);
    drop(won);
    scores.asking = scores.asking.iter().map(Tiles::grown).collect();
    Some(Won {
        scores,
        motion: Some(motion),
    })
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
    /// Where each is asked, and any; everywhere if there are none.
    asking: Option<(&'a [Tiles], Tiles)>,
}

/// Room for the motion of a candidate.
struct Room {
    hits: Row,
    shown: Shown,
    motion: [Row; 2],
    /// That of each pixel's winner.
    won: [Row; 2],
}

impl Room {
    fn new() -> Self {
        Self {
            hits: [0.0; SEGMENT],
            shown: Shown::nothing(),
            motion: [[0.0; SEGMENT]; 2],
            won: [[0.0; SEGMENT]; 2],
        }
    }
}

impl Candidates<'_> {
    /// The parts of a run for which a candidate is asked, or any.
    #[inline(always)]
    fn runs(&self, candidate: Option<usize>, run: Run) -> impl Iterator<Item = Run> {
        let tiles = (self.asking.as_ref()).map(|(each, any)| candidate.map_or(any, |k| &each[k]));
        let part = tiles.map(|tiles| tiles.runs(run));
        let whole = part.is_none().then_some(run);
        part.into_iter().flatten().chain(whole)
    }

    /// The motion of a run along a candidate; `room` has what is shown from the column `left` on.
    #[inline(always)]
    fn follow<'r>(&self, source: Source, run: Run, left: usize, room: &'r mut Room) -> Motion<'r> {
        let hits = &mut room.hits[..run.len];
        match source {
            Source::Known(distance) => distance.load(run, 0, hits),
            Source::Depths(depth, multiple) => {
                depth.load(run, 0, hits);
                hits.iter_mut().for_each(|hit| *hit *= multiple);
            }
        }
        let [x, y] = room.motion.each_mut().map(|row| &mut row[..run.len]);
        let start = run.x - left;
        self.mirrored.motion(&room.shown, start, hits, x, y);
        Motion { x, y, depth: None }
    }
}

/// The terms of each candidate's gain in the rows that are asked, not finite where they are not known, NaN where nothing was
/// fetched; and its score so far, where it is asked.
struct Predict<'a> {
    candidates: &'a Candidates<'a>,
    motion: Pixels<'a>,
    /// Of the light and the scores, along that motion.
    base: Fetch<'a>,
    /// Of the light.
    fetch: Fetch<'a>,
    color: View<'a>,
    /// Numbers of a record of scores.
    scores: usize,
}

impl<'a> Kernel for Predict<'a> {
    type Out = (BandMut<'a>, BandMut<'a>);

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, (mut errors, mut scores): Self::Out) {
        let width = self.color.size.width;
        let candidates = self.candidates;
        let mut room = Room::new();
        let mut lanes = MotionLanes::zeroed();
        let (mut known, mut fetched) = (self.base.room(), self.fetch.room());
        let [mut light, mut base, mut color] = [[[0.0; SEGMENT]; 3]; 3];
        for row in rows {
            let y = ROWS * row;
            if candidates.asking.is_some() {
                for k in 0..candidates.sources.len() {
                    errors.row(k, row).fill(f32::NAN);
                }
            }
            for run in segments(y, width).flat_map(|run| candidates.runs(None, run)) {
                let motion = lanes.load(&self.motion, run);
                self.base.run(run, motion, &mut known);
                take_light(&known, run.len, &mut base);
                let there = Run { y: row, ..run };
                let records = &known.values(1)[..run.len * self.scores];
                for (k, part) in scores.parts(there).enumerate() {
                    for (score, record) in part.iter_mut().zip(records.chunks(self.scores)) {
                        *score = record[k];
                    }
                }
                self.sample(run, &mut color);
                room.shown.find(candidates.geometry, candidates.camera, run);
                for (k, &source) in candidates.sources.iter().enumerate() {
                    for part in candidates.runs(Some(k), run) {
                        let motion = candidates.follow(source, part, run.x, &mut room);
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

/// Light that was fetched; NaN where none was.
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

impl Predict<'_> {
    /// The mean of the new samples of a run and of that below, of which one may be missing.
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

/// Averages the scores, which start anew where nobody asks, and takes the history of the best candidates where they win.
struct Choose<'a> {
    candidates: &'a Candidates<'a>,
    errors: &'a Image,
    ids: Option<Pixels<'a, u32>>,
    fetch: Fetch<'a>,
    /// Scores so far, in the rows that are asked.
    before: &'a Image,
    size: Size,
    /// Numbers of a record of scores.
    scores: usize,
}

struct Outs<'a> {
    history: BandMut<'a>,
    coverage: BandMut<'a>,
    motion: BandMut<'a>,
    scores: &'a mut [f32],
    /// Whether each candidate wins, tile by tile.
    won: Vec<&'a mut [bool]>,
}

impl<'a> LanesKernel for Choose<'a> {
    type Out = Outs<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, simd: S, rows: Range<usize>, mut out: Outs<'a>) {
        let Size { height, width } = self.size;
        let (top, candidates) = (rows.start, self.candidates);
        let mut ids = Ids::new(self.ids, width, RADIUS, ROWS);
        let around = candidates.sources.iter();
        let mut around: Vec<Rolling<1>> = around.map(|_| Rolling::new(width, RADIUS)).collect();
        let mut gain = [0.0; SEGMENT];
        let (mut room, mut fetched) = (Room::new(), self.fetch.room());
        let (mut best, mut winner) = (vec![0.0; width], vec![0; width]);
        let tiles = width.div_ceil(Tiles::SIDE);
        let mut any = vec![false; tiles];
        let mut wins = vec![vec![0; tiles]; candidates.sources.len()];
        for y in rows.step_by(ROWS) {
            let row = y / ROWS;
            ids.roll(row, y == top);
            best.fill(MARGIN);
            winner.fill(NONE);
            any.fill(false);
            for (k, around) in around.iter_mut().enumerate() {
                around.roll(self.errors.view().channel(k).into(), row, y == top);
                for run in segments(y, width).flat_map(|run| candidates.runs(Some(k), run)) {
                    let there = Run { y: row, ..run };
                    mean(
                        simd,
                        there,
                        self.errors.size.height,
                        around,
                        &ids,
                        &mut gain,
                    );
                    let old = &self.before.view().row(k, row)[run.x..][..run.len];
                    let [errors] = around.row(row as isize);
                    let errors = &errors[RADIUS + run.x..][..run.len];
                    let best = &mut best[run.x..][..run.len];
                    let winner = &mut winner[run.x..][..run.len];
                    let gain = &mut gain[..run.len];
                    for i in 0..run.len {
                        let score = old[i] + SHARE * (gain[i] - old[i]);
                        gain[i] = score;
                        let wins = (score < best[i]) & !errors[i].is_nan();
                        best[i] = if wins { score } else { best[i] };
                        winner[i] = if wins { k as u32 } else { winner[i] };
                    }
                    for y in y..(y + ROWS).min(height) {
                        let first = ((y - top) * width + run.x) * self.scores;
                        let records = out.scores[first..].chunks_exact_mut(self.scores);
                        for (record, &score) in records.zip(&*gain) {
                            record[k] = score;
                        }
                    }
                }
            }
            for (k, wins) in (0..).zip(&mut wins) {
                for (tile, winner) in winner.chunks(Tiles::SIDE).enumerate() {
                    let count = winner.iter().filter(|&&winner| winner == k).count();
                    wins[tile] += count;
                    any[tile] |= count > 0;
                }
            }
            for y in y..(y + ROWS).min(height) {
                for run in segments(y, width).flat_map(|run| runs_in(&any, run)) {
                    self.carry(run, &winner, &mut room, &mut fetched);
                    replace(run, &winner, &fetched, &room.won, &mut out);
                }
            }
        }
        for (won, wins) in out.won.into_iter().zip(&wins) {
            for (won, &wins) in won.iter_mut().zip(wins) {
                *won = wins >= MANY;
            }
        }
    }
}

impl Choose<'_> {
    /// Fetches what was carried along the winners' motion, and something along with it where there are none: neighbours that
    /// come from neighbours are fetched faster.
    #[inline(always)]
    fn carry(&self, run: Run, winner: &[u32], room: &mut Room, fetched: &mut Fetched) {
        let Candidates {
            geometry,
            camera,
            sources,
            ..
        } = self.candidates;
        let winner = &winner[run.x..][..run.len];
        let [mut x, mut y] = [[0.0; SEGMENT]; 2];
        room.shown.find(*geometry, camera, run);
        let mut first = true;
        for (k, &source) in (0..).zip(sources) {
            if winner.contains(&k) {
                let motion = self.candidates.follow(source, run, run.x, room);
                for (i, &winner) in winner.iter().enumerate() {
                    let wins = first | (winner == k);
                    x[i] = if wins { motion.x[i] } else { x[i] };
                    y[i] = if wins { motion.y[i] } else { y[i] };
                }
                first = false;
            }
        }
        let motion = Motion {
            x: &x[..run.len],
            y: &y[..run.len],
            depth: None,
        };
        self.fetch.run(run, motion, fetched);
        room.won = [x, y];
    }
}

/// Takes what was fetched for winners, which mostly are few, and the motion along which it was.
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
