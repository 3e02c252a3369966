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

use super::frame::Frame;
use crate::image::{BandMut, Image, Pixels, Records, Size, Tiles, View};
use crate::kernels::camera::pinhole::Camera;
use crate::kernels::camera::virtual_motion::virtual_motion;
use crate::kernels::fetch::footprint::Filter;
use crate::kernels::fetch::reproject::{self, Reprojected, reproject};
use crate::kernels::judge::prediction::prediction_gain;
use crate::kernels::judge::surface::{self, Buffers, Tests};
use crate::rows::{self, Kernel};

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

/// Replaces history by that of the best candidate, where one wins.
///
/// `base` holds what [`reproject`] fetched along the surface's motion: the history image, then the light, then the scores;
/// of these, the history is replaced.
pub fn choose(
    memory: &Memory,
    history: Pixels,
    distances: &[f32],
    frame: &Frame,
    cameras: [&Camera; 2],
    before: Buffers,
    color: View,
    base: &mut Reprojected,
) -> Option<Scores> {
    let geometry = frame.geometry()?;
    let [known, depth] =
        [frame.hit_distance, frame.surface.depth].map(|image| image.map(Pixels::plane));
    let sources: Vec<_> = match (known, depth) {
        (Some(known), _) => vec![Source::Known(known)],
        (None, Some(depth)) => distances
            .iter()
            .map(|&multiple| Source::Depths(depth, multiple))
            .collect(),
        (None, None) => return None,
    };
    let size = color.size;
    let everywhere = memory.scores.age.is_multiple_of(PERIOD);
    let asking = (!everywhere).then_some(&memory.scores.asking);
    let mut scores = Image::new(size, distances.len());
    let mut best = Image::new(size, 1);
    best.data_mut().fill(MARGIN);
    if everywhere || memory.scores.asking.any() {
        // Elsewhere on the mirror: depth says nothing about what it shows.
        let [now, before] = [frame.surface, before].map(|surface| Buffers {
            depth: None,
            color: None,
            ..surface
        });
        let tests = Tests::new(now, before, None, &surface::Params::default());
        let fetch = |image: Pixels, motion: &Image| {
            let params = reproject::Params {
                filter: Filter::Bilinear,
                fallback: false,
                dering: true,
            };
            reproject(&[image], motion.pixels(), tests, params)
        };
        let first = history.channels;
        let mut light = base.values.channels(first..first + 3).to_image();
        forget_uncovered(&mut light, &base.coverage);
        let old = base.values.channels(first + 3..base.values.channels);
        let mut winner = Image::new(size, 2);
        winner.data_mut().fill(f32::NAN);
        for (k, source) in sources.into_iter().enumerate() {
            let mut hits = Image::new(size, 1);
            rows::run(&Hits { source, asking }, size.height, hits.bands());
            let motion = virtual_motion(geometry, hits.view(), cameras[0], cameras[1]);
            let mut candidate = fetch(memory.light.pixels(), &motion);
            forget_uncovered(&mut candidate.values, &candidate.coverage);
            let gain = prediction_gain(
                candidate.values.view(),
                light.view(),
                color,
                frame.surface.ids.map(Pixels::plane),
                RADIUS,
                asking,
            );
            let kernel = Rank {
                gain: gain.view(),
                old: old.channel(k),
                motion: motion.view(),
                coverage: candidate.coverage.view(),
                asking,
            };
            let mut score = Image::new(size, 1);
            let outs = winner.bands().zip(best.bands().zip(score.bands()));
            rows::run(&kernel, size.height, outs);
            scores.set_channels(k, score.view());
        }
        let carried = fetch(history, &winner);
        let kernel = Replace {
            carried: &carried,
            channels: history.channels,
        };
        let outs = base.values.bands().zip(base.coverage.bands());
        rows::run(&kernel, size.height, outs);
    }
    Some(Scores {
        image: Records::of(scores.view()),
        asking: around_winners(best.view()),
        age: memory.scores.age + 1,
    })
}

/// NaN where nothing was fetched, which 0 would pretend to be.
pub fn forget_uncovered(values: &mut Image, coverage: &Image) {
    let channels = values.channels;
    let kernel = Forget { coverage, channels };
    rows::run(&kernel, coverage.size.height, values.bands());
}

struct Forget<'a> {
    coverage: &'a Image,
    channels: usize,
}

impl<'a> Kernel for Forget<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut values: BandMut<'a>) {
        for y in rows {
            let coverage = self.coverage.view().row(0, y);
            for channel in 0..self.channels {
                for (value, &coverage) in values.row(channel, y).iter_mut().zip(coverage) {
                    *value = if coverage > 0.0 { *value } else { f32::NAN };
                }
            }
        }
    }
}

/// Where distances to what is reflected come from.
#[derive(Clone, Copy)]
enum Source<'a> {
    Known(View<'a>),
    /// So many times the depth.
    Depths(View<'a>, f32),
}

/// The distance to what is reflected; NaN where nobody asks.
struct Hits<'a> {
    source: Source<'a>,
    asking: Option<&'a Tiles>,
}

impl<'a> Kernel for Hits<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut hits: BandMut<'a>) {
        for y in rows {
            let hits = hits.row(0, y);
            match self.source {
                Source::Known(distance) => hits.copy_from_slice(distance.row(0, y)),
                Source::Depths(depth, multiple) => {
                    for (hit, &z) in hits.iter_mut().zip(depth.row(0, y)) {
                        *hit = z * multiple;
                    }
                }
            }
            if let Some(tiles) = self.asking {
                for (x, hit) in hits.iter_mut().enumerate() {
                    *hit = if tiles.at(x, y) { *hit } else { f32::NAN };
                }
            }
        }
    }
}

/// Averages the score, which starts anew where nobody asks, and keeps the motion of the best so far.
struct Rank<'a> {
    gain: View<'a>,
    old: View<'a>,
    motion: View<'a>,
    coverage: View<'a>,
    asking: Option<&'a Tiles>,
}

impl<'a> Kernel for Rank<'a> {
    type Out = (BandMut<'a>, (BandMut<'a>, BandMut<'a>));

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, (mut winner, (mut best, mut score)): Self::Out) {
        for y in rows {
            let (gain, old) = (self.gain.row(0, y), self.old.row(0, y));
            let coverage = self.coverage.row(0, y);
            let [mx, my] = self.motion.rows(y);
            let [wx, wy] = winner.rows(y);
            let (best, score) = (best.row(0, y), score.row(0, y));
            for x in 0..gain.len() {
                let asked = self.asking.is_none_or(|tiles| tiles.at(x, y));
                score[x] = if asked {
                    old[x] + SHARE * (gain[x] - old[x])
                } else {
                    0.0
                };
                if score[x] < best[x] && coverage[x] > 0.0 {
                    best[x] = score[x];
                    (wx[x], wy[x]) = (mx[x], my[x]);
                }
            }
        }
    }
}

/// Takes what was carried along the winners' motion.
struct Replace<'a> {
    carried: &'a Reprojected,
    channels: usize,
}

impl<'a> Kernel for Replace<'a> {
    type Out = (BandMut<'a>, BandMut<'a>);

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, (mut values, mut coverage): Self::Out) {
        for y in rows {
            let carried = self.carried.coverage.view().row(0, y);
            for channel in 0..self.channels {
                let from = self.carried.values.view().row(channel, y);
                for (x, value) in values.row(channel, y).iter_mut().enumerate() {
                    *value = if carried[x] > 0.0 { from[x] } else { *value };
                }
            }
            for (coverage, &carried) in coverage.row(0, y).iter_mut().zip(carried) {
                *coverage = if carried > 0.0 { carried } else { *coverage };
            }
        }
    }
}

/// The tiles in which, or beside which, a candidate has won.
fn around_winners(best: View) -> Tiles {
    let mut tiles = Tiles::new(best.size);
    for y in 0..best.size.height {
        for (x, &best) in best.row(0, y).iter().enumerate() {
            if best < MARGIN {
                tiles.switch_on_around(x, y);
            }
        }
    }
    tiles
}
