//! The fused sweep of temporal antialiasing, from dilated motion to merged history.
//!
//! For a run of pixels at a time, in the first-level cache:
//!   dilate → reproject → (catch up) → clip → (hold) → (release) → (anti-lag) → (anti-lag for others) → blend factor
//!     → (flicker) → blend,
//! each as its kernel defines it. With N the samples in the reprojected history, λ the temporal gradient, α what
//! `blend_factor` gives and α₀ its least:
//!   N ← N (1 − λ)¹⁰,  N ← min(N + 1, 1/α₀),  a = lerp(max(α, 1/N), 1, λ).
//! So the first samples are averaged equally until 1/N reaches α₀. Where the colours of neighbourhoods alternate, part of
//! the history escapes the clip ([`hold`]), and so it does in tiles where it has predicted better without
//! ([`super::clip_choice`]).
//!
//! Beside an object that moves by itself, dilation may leave its motion out. The history of its edge is then lost, which shows
//! where the object is much brighter or darker than what it passes. So both are fetched, and that along the object's motion
//! is taken where it is far nearer to the mean colour of 3×3 pixels ([`NEARER`]).
//!
//! A denoiser that tests surfaces knows where it found no history of its own. History that has to be clipped there is another
//! surface's, and is shortened as by `anti_lag`, with the strength [`OTHERS`] · (l_k + e/16) / (max(l_c, l_k) + e/16): a new
//! colour c that is brighter than the clipped history k may be the one sample that hit a lamp. Pixels whose motion was dilated
//! keep theirs: they lie beside an edge, which it antialiases.
//!
//! Inputs: colour (3), motion (2 or 3), depth (1, optional), history (4: colour, N), its lag (optional), λ (1, optional), count
//! of returns (1, optional), confidence of a denoiser (1, optional), what tiles choose (1, optional; of an eighth of the size).
//! Outputs: history (4); colour (3), black where no sample was ever seen; two luminances and steadiness (3, optional); N,
//! coverage and rejection, optional.

use std::ops::Range;

use super::Params;
use super::clip_choice::PREDICTED;
use super::lag::Lag;
use crate::image::{Interleaved, Pixels, Run, SEGMENT, View, deinterleave, segments};
use crate::kernels::camera::dilate::{Choice, Dilation};
use crate::kernels::fetch::reproject::{Fetch, Fetched};
use crate::kernels::judge::alternation::hold;
use crate::kernels::judge::anti_lag;
use crate::kernels::judge::choice::Levels;
use crate::kernels::judge::neighborhood::Window;
use crate::kernels::merge::accumulate::{count_missing, load_shares, shorten};
use crate::kernels::merge::blend::{Weighting, mix, reduce_flicker, weigh_by_local_tone};
use crate::math::{Color, black_level, is_present, larger, luminance};
use crate::pipelines::frame::{Report, blacken_missing};
use crate::pixels::{MotionLanes, MotionRun, PixelsMut, Row, lanes};
use crate::rows::{self, BAND, Kernel, Simd};

/// Channels of the history: colour 0 to 2, length 3.
pub const CHANNELS: usize = 4;

/// How much nearer the history along a moving neighbour's motion must be than that of the still scene. With 1/2, dark creases
/// beside the bright rims of `carousel` lose 3 % relMSE, and with 1, 5 %.
const NEARER: f32 = 0.3;
/// Motions of less difference, in pixels, lead to the same history.
const APART: f32 = 0.05;

/// Strength of the anti-lag for history of other surfaces. In what an object uncovers, 4 leaves a sixth more error; 16 adds 1 %
/// to the temporal error of `passer_by` and `shallow_focus`.
const OTHERS: f32 = 8.0;

/// History that is not clipped differs from clipped history by no more than this share of its luminance, so that tiles that choose
/// wrongly err little. With 1, `caustics` gains another 0.07 dB, and `glossy_plates` loses 0.3 % relMSE instead of 0.2 %.
const APART_BY: f32 = 0.25;

pub struct Sweep<'a> {
    pub params: Params,
    pub color: Pixels<'a>,
    pub motion: Pixels<'a>,
    pub choice: Choice<'a>,
    /// None for a first frame.
    pub fetch: Option<Fetch<'a>>,
    /// What corrects history that lags behind the samples which the colour was made of.
    pub lag: Option<&'a Lag>,
    pub gradient: Option<View<'a>>,
    pub returns: Option<Pixels<'a>>,
    /// 0 where a denoiser found no history of the surface.
    pub confidence: Option<View<'a>>,
    /// Whether tiles choose between the clip and none.
    pub predicts: bool,
    /// What they choose, 0 or 1, and how steady history was in the frame before; none for the clip.
    pub chosen: Option<[View<'a>; 2]>,
}

/// What a sweep leaves.
pub struct Merged {
    /// The new history.
    pub history: Interleaved,
    /// Luminances with the clip and without, and where history is steady, if tiles choose.
    pub predicted: Option<Interleaved>,
    /// The number of missing samples.
    pub missing: usize,
}

/// A band of the outputs.
pub struct Outs<'a> {
    history: PixelsMut<'a>,
    merged: PixelsMut<'a>,
    predicted: Option<PixelsMut<'a>>,
    missing: &'a mut usize,
    report: Option<Report<'a>>,
}

impl Sweep<'_> {
    /// Writes the merged colour and the report.
    pub fn run<'a>(
        &self,
        merged: impl Iterator<Item = PixelsMut<'a>>,
        report: Option<Vec<Report>>,
    ) -> Merged {
        let size = self.color.size;
        let mut history = Interleaved::blank(size, CHANNELS);
        let mut predicted = (self.predicts).then(|| Interleaved::blank(size, PREDICTED));
        let predictions = predicted.as_mut().map(Interleaved::pixels_mut);
        let mut missing = vec![0; size.height.div_ceil(BAND)];
        let outs = history
            .pixels_mut()
            .zip(merged)
            .zip(rows::optional(predictions))
            .zip(&mut missing)
            .zip(rows::optional(report.map(Vec::into_iter)))
            .map(|((((history, merged), predicted), missing), report)| Outs {
                history,
                merged,
                predicted,
                missing,
                report,
            });
        let jobs = rows::tall_jobs(size.height, self.params.clip.radius as usize, outs);
        rows::run_jobs(self, jobs);
        Merged {
            history,
            predicted,
            missing: missing.iter().sum(),
        }
    }

    /// Clips the history of a run except where colours alternate, and shortens it where it was clipped.
    #[inline(always)]
    fn clip(
        &self,
        run: Run,
        motion: MotionRun,
        window: &mut Window,
        steady: &[bool],
        past: &mut Past,
    ) {
        let unclipped = past.color;
        window.clip(run, &mut past.color);
        if let Some(returns) = &self.returns {
            let mut holds = [0.0; SEGMENT];
            returns.load(run, 0, &mut holds[..run.len]);
            holds.iter_mut().for_each(|count| *count = hold(*count));
            let (clipped, before) = (past.color, unclipped.each_ref().map(Row::as_slice));
            let held = &mut past.color;
            mix(before, &clipped, &holds, Weighting::None, 1.0, held);
        }
        if self.predicts {
            self.release(run, &unclipped, steady, past);
        }
        if self.params.anti_lag > 0.0 {
            let length = &mut past.length[..run.len];
            anti_lag::shorten(length, &unclipped, &past.color, self.params.anti_lag);
        }
        self.shorten_others(run, motion, &unclipped, window, past);
    }

    /// Leaves as much of a run's history unclipped as its tiles choose, where it is steady. Keeps l(d).
    #[inline(always)]
    fn release(&self, run: Run, unclipped: &[Row; 3], steady: &[bool], past: &mut Past) {
        let levels = &mut past.level[..run.len];
        match self.chosen {
            Some([chosen, steady]) => {
                Levels(chosen).read(run, levels);
                for (level, steady) in levels.iter_mut().zip(steady.run(0, run)) {
                    *level *= steady;
                }
            }
            None => levels.fill(0.0),
        }
        let black = black_level(self.params.clip.exposure);
        for i in 0..run.len {
            let clipped = past.color.each_ref().map(|row| row[i]);
            let apart: Color = std::array::from_fn(|c| unclipped[c][i] - clipped[c]);
            let [light, bright] = [clipped, apart].map(|[r, g, b]| luminance(r, g, b));
            let (most, off) = (APART_BY * (light + black), bright.abs());
            let limit = if off > most { most / off } else { 1.0 };
            let apart = apart.map(|value| value * limit);
            let released = steady[i] & is_present(apart);
            let apart = if released { apart } else { [0.0; 3] };
            for (row, apart) in past.color.iter_mut().zip(apart) {
                row[i] += levels[i] * apart;
            }
            past.apart[i] = luminance(apart[0], apart[1], apart[2]);
            past.steady[i] = f32::from(released);
        }
    }

    /// Shortens history of other surfaces than a denoiser's.
    #[inline(always)]
    fn shorten_others(
        &self,
        run: Run,
        motion: MotionRun,
        unclipped: &[Row; 3],
        window: &Window,
        past: &mut Past,
    ) {
        let Some(confidence) = self.confidence.filter(|_| self.fetch.is_some()) else {
            return;
        };
        let confidence = confidence.run(0, run);
        if confidence.iter().all(|&known| known > 0.0) {
            return;
        }
        let least = black_level(self.params.clip.exposure);
        let colors = window.colors.own(run);
        let light = |rows: [&[f32]; 3], i: usize| luminance(rows[0][i], rows[1][i], rows[2][i]);
        for i in 0..run.len {
            if confidence[i] > 0.0 || !past.is_own(motion, i) {
                continue;
            }
            let before = light(unclipped.each_ref().map(Row::as_slice), i);
            let clipped = light(past.color.each_ref().map(Row::as_slice), i);
            let brighter = larger(light(colors, i), clipped);
            let strength = OTHERS * (clipped + least) / (brighter + least);
            past.length[i] = anti_lag::shortened(past.length[i], before, clipped, strength);
        }
    }

    /// The blend factors of a run. Turns the lengths of the reprojected history into those of the merged one.
    #[inline(always)]
    fn blend_factors(
        &self,
        run: Run,
        colors: [&[f32]; 3],
        motion: MotionRun,
        past: &mut Past,
        factors: &mut Row,
    ) {
        let Past {
            coverage, length, ..
        } = past;
        let params = &self.params.blend_factor;
        params.shares(&coverage[..run.len], Some(motion), factors);
        let mut changes = [0.0; SEGMENT];
        if let Some(gradient) = self.gradient {
            load_shares(gradient, run, &mut changes);
            shorten(length, &changes);
        }
        warm_up(colors, 1.0 / params.alpha, factors, length);
        if self.gradient.is_some() {
            for (factor, change) in factors.iter_mut().zip(&changes) {
                *factor += change * (1.0 - *factor);
            }
        }
    }
}

impl<'a> Kernel for Sweep<'a> {
    type Out = Vec<Outs<'a>>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut outs: Self::Out) {
        let Params { clip, blend, .. } = self.params;
        let size = self.color.size;
        let mut window = Window::new(size.width, clip);
        let mut past = Past::new(self);
        let mut own_motion = MotionLanes::zeroed();
        let (mut factors, mut merged) = ([0.0; SEGMENT], [[0.0; SEGMENT]; 3]);
        let mut lag = self.lag.map(|lag| (lag, lag.line()));
        let mut steady = [false; SEGMENT];
        for y in rows.clone() {
            let first = y == rows.start;
            if let Some((lag, line)) = &mut lag {
                lag.go_to(y, line);
            }
            window.roll(self.color, y, first);
            if let Some(dilation) = &mut past.dilation {
                dilation.roll(y, first);
            }
            let out = &mut outs[(y - rows.start) / BAND];
            for run in segments(y, size.width) {
                let motion = own_motion.load(&self.motion, run);
                past.fetch(run, motion, self.fetch.as_ref());
                past.follow_movers(run, motion, self.fetch.as_ref(), &window, clip.exposure);
                if let Some((lag, line)) = &mut lag {
                    let (new, steady) = (window.colors.own(run), &mut steady[..run.len]);
                    let (coverage, history) = (&past.coverage, &mut past.color);
                    lag.catch_up(run, line, new, coverage, self.confidence, history, steady);
                }
                self.clip(run, motion, &mut window, &steady, &mut past);
                let colors = window.colors.own(run);
                self.blend_factors(run, colors, motion, &mut past, &mut factors);
                past.weigh_apart(&factors);
                let old = &past.color;
                if blend.flicker < 1.0 {
                    reduce_flicker(&window.colors, run, old, blend.flicker, &mut factors);
                }
                let (weighting, bright) = (blend.weighting, blend.exposure);
                if weighting == Weighting::LocalTone {
                    weigh_by_local_tone(&window.colors, run, old, bright, &mut factors);
                }
                mix(colors, old, &factors, weighting, bright, &mut merged);
                if let Some(predicted) = &mut out.predicted {
                    predicted.write(run, &past.predict(&merged));
                }
                *out.missing += count_missing(colors.map(|row| &row[..run.len]));
                out.write(run, &past, &mut merged);
            }
        }
    }
}

/// The reprojected history of a run of pixels, and scratch to find it.
struct Past<'a> {
    dilation: Option<Dilation<'a>>,
    dilated: [Row; 3],
    fetched: Option<Fetched>,
    /// The same along the motion of neighbours that dilation leaves out, if it does.
    movers: Option<Movers>,
    color: [Row; 3],
    length: Row,
    coverage: Row,
    rejection: [u8; SEGMENT],
    /// Where tiles choose between the clip and none: s, l(d), and 1 where d may differ from 0.
    level: Row,
    apart: Row,
    steady: Row,
}

impl<'a> Past<'a> {
    #[inline(always)]
    fn new(sweep: &Sweep<'a>) -> Self {
        let dilation = (sweep.params.dilation()).filter(|_| sweep.fetch.is_some());
        let leaves_out = matches!(sweep.choice, Choice::Nearest { still: Some(_), .. });
        let movers = sweep.fetch.as_ref().filter(|_| leaves_out);
        Self {
            movers: movers.map(|fetch| Movers {
                dilated: [[0.0; SEGMENT]; 3],
                fetched: fetch.scratch(),
            }),
            dilation: dilation.map(|params| Dilation::new(sweep.motion, sweep.choice, params)),
            dilated: [[0.0; SEGMENT]; 3],
            fetched: sweep.fetch.as_ref().map(Fetch::scratch),
            color: [[0.0; SEGMENT]; 3],
            length: [0.0; SEGMENT],
            coverage: [0.0; SEGMENT],
            rejection: [0; SEGMENT],
            level: [0.0; SEGMENT],
            apart: [0.0; SEGMENT],
            steady: [0.0; SEGMENT],
        }
    }

    /// Turns l(d) into (1 − a) l(d).
    #[inline(always)]
    fn weigh_apart(&mut self, factors: &Row) {
        for (apart, factor) in self.apart.iter_mut().zip(factors) {
            *apart *= 1.0 - factor;
        }
    }

    /// The luminances of a result with the clip and without, and where it is steady.
    #[inline(always)]
    fn predict(&self, [r, g, b]: &[Row; 3]) -> [Row; PREDICTED] {
        let mut predicted = [[0.0; SEGMENT], [0.0; SEGMENT], self.steady];
        for i in 0..SEGMENT {
            let light = luminance(r[i], g[i], b[i]);
            let (level, apart) = (self.level[i], self.apart[i]);
            predicted[0][i] = light - level * apart;
            predicted[1][i] = light + (1.0 - level) * apart;
        }
        predicted
    }

    /// Reprojects a run along its dilated motion; zeros in a first frame.
    #[inline(always)]
    fn fetch(&mut self, run: Run, motion: MotionRun, fetch: Option<&Fetch>) {
        let n = run.len;
        let Some((fetch, fetched)) = fetch.zip(self.fetched.as_mut()) else {
            self.color = [[0.0; SEGMENT]; 3];
            self.length = [0.0; SEGMENT];
            return;
        };
        let from = match &self.dilation {
            Some(dilation) => {
                dilation.choose(run, &mut self.dilated);
                let [x, y, depth] = self.dilated.each_ref().map(|row| &row[..n]);
                let depth = motion.depth.map(|_| depth);
                MotionRun { x, y, depth }
            }
            None => motion,
        };
        fetch.run(run, from, fetched);
        let [r, g, b] = self.color.each_mut();
        let channels = [r, g, b, &mut self.length].map(|row| &mut row[..n]);
        deinterleave(&fetched.values(0)[..n * CHANNELS], channels.into_iter());
        self.coverage = fetched.coverage;
        self.rejection = fetched.rejection;
    }

    /// Whether a pixel's history is fetched along its own motion. Not if that is unknown.
    #[inline(always)]
    fn is_own(&self, motion: MotionRun, i: usize) -> bool {
        let [x, y, _] = &self.dilated;
        let near = ((x[i] - motion.x[i]).abs() <= APART) & ((y[i] - motion.y[i]).abs() <= APART);
        self.dilation.is_none() | near
    }

    /// Takes the history along the motion of neighbours that move by themselves, where it is far nearer to the colours around.
    #[inline(always)]
    fn follow_movers(
        &mut self,
        run: Run,
        motion: MotionRun,
        fetch: Option<&Fetch>,
        window: &Window,
        exposure: f32,
    ) {
        let (Some(dilation), Some(fetch)) = (&self.dilation, fetch) else {
            return;
        };
        let Some(movers) = (self.movers.as_mut()).filter(|_| dilation.leaves_out(run)) else {
            return;
        };
        let n = run.len;
        dilation.choose_of_all(run, &mut movers.dilated);
        let [x, y, depth] = movers.dilated.each_ref().map(|row| &row[..n]);
        let [still_x, still_y, _] = &self.dilated;
        let apart =
            |i: usize| ((x[i] - still_x[i]).abs() > APART) | ((y[i] - still_y[i]).abs() > APART);
        if !(0..n).any(apart) {
            return;
        }
        let depth = motion.depth.map(|_| depth);
        fetch.run(run, MotionRun { x, y, depth }, &mut movers.fetched);
        let rows = [-1, 0, 1].map(|dy| window.colors.columns(run, dy));
        let start = window.colors.radius - 1;
        let found = movers.fetched.values(0).as_chunks::<CHANNELS>().0;
        for i in (0..n).filter(|&i| apart(i) && movers.fetched.coverage[i] > 0.0) {
            let mean = [0, 1, 2].map(|c| {
                let taps = rows.iter().flat_map(|row| &row[c][start + i..][..3]);
                taps.sum::<f32>() / 9.0
            });
            let [r, g, b, length] = found[i];
            let old = self.color.each_ref().map(|row| row[i]);
            let distance = |color| distance(color, mean, exposure);
            if distance([r, g, b]) < NEARER * distance(old) {
                for (row, value) in self.color.iter_mut().zip([r, g, b]) {
                    row[i] = value;
                }
                self.length[i] = length;
                self.coverage[i] = movers.fetched.coverage[i];
            }
        }
    }
}

/// A fetch along other motion.
struct Movers {
    dilated: [Row; 3],
    fetched: Fetched,
}

/// Between two colours, each relative to its luminance and the exposure.
#[inline(always)]
fn distance(one: Color, other: Color, exposure: f32) -> f32 {
    let toned = |color: Color| {
        let bright = luminance(color[0], color[1], color[2]) + exposure;
        color.map(|value| value / bright)
    };
    let (one, other) = (toned(one), toned(other));
    let [r, g, b] = [0, 1, 2].map(|c| (one[c] - other[c]).abs());
    r + g + b
}

impl Outs<'_> {
    #[inline(always)]
    fn write(&mut self, run: Run, past: &Past, merged: &mut [Row; 3]) {
        let [r, g, b] = merged.each_ref().map(Row::as_slice);
        self.history.write(run, [r, g, b, &past.length]);
        for row in &mut *merged {
            blacken_missing(&mut row[..lanes(run)]);
        }
        self.merged.write(run, &*merged);
        if let Some(report) = &mut self.report {
            report.write(run, &past.length, &past.coverage, &past.rejection);
        }
    }
}

/// Raises the blend factor of the N-th sample to at least 1/N, up to the longest history. Turns the lengths before, 0
/// without history, into those after.
#[inline(always)]
fn warm_up([r, g, b]: [&[f32]; 3], longest: f32, factors: &mut Row, length: &mut Row) {
    let n = r.len().min(SEGMENT);
    let (r, g, b) = (&r[..n], &g[..n], &b[..n]);
    for i in 0..n {
        let present = is_present([r[i], g[i], b[i]]);
        let counted = (length[i] + 1.0).min(longest);
        factors[i] = factors[i].max(1.0 / counted);
        length[i] = if present { counted } else { length[i] };
    }
}
