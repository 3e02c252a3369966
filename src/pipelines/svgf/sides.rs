//! Both sides of time: what the frames before a frame expect of it, and those after it.
//!
//! A second run, backwards, leaves for every frame the history that its later frames make of its pixels. It joins the
//! history of the earlier frames, before the filter, by the lengths of both, and the new sample counts once. Each side
//! holds down fireflies of the other ([`crate::kernels::merge::combine`]). What goes on to the next frame is the earlier
//! frames' history alone: the next frame's own samples are in the later ones'.
//!
//! What is expected without the frame's sample is the prediction, whose luminance the filter compares
//! ([`crate::kernels::smooth::atrous`]), and by which passes are chosen ([`crate::kernels::judge::choice`]).

use std::ops::Range;

use super::{Current, Reports};
use crate::image::{
    BandMut, Image, Interleaved, Pixels, Run, SEGMENT, Size, View, plane_bands, segments,
};
use crate::kernels::judge::exposure::exposure;
use crate::kernels::merge::accumulate::{CHANNELS, load_shares, shorten};
use crate::kernels::merge::combine::{combine_rows, hold_spikes};
use crate::math::{black_level, larger, luminance, smaller};
use crate::pipelines::frame::History;
use crate::pipelines::recall::Recalled;
use crate::pixels::{PixelsMut, Row};
use crate::rows::{self, Kernel, Simd};

/// A prediction from fewer samples is not used: guided by its luminance, the filter would keep its noise. Not a whole number,
/// so that rounding of resampled lengths does not decide.
const FEWEST: f32 = 2.5;
/// Fewest samples of a prediction in partly traced frames. With a quarter of the pixels traced, hardly any history reaches
/// [`FEWEST`] in ten frames, and without albedo the passes of those frames blur texture: that costs more than a noisy guide.
const FEWEST_OF_A_PART: f32 = 0.9;
/// Where the new sample lifts the mean above the prediction by more standard deviations of samples than this, the prediction is
/// not used: the outlier keeps its own luminance, by which the filter does not spread it to its neighbours.
const MOST: f32 = 1.5;

/// What the filter works on, beside the history of the frames before.
#[derive(Default)]
pub struct Joined {
    /// The history of both sides, if there is one from later frames.
    pub history: Option<Interleaved>,
    /// The luminance that both sides expect, NaN where they know too little; if passes are chosen.
    pub prediction: Option<Image>,
}

/// Joins the later frames' history, and predicts. Writes the length of the joined history.
pub fn join(
    now: &Current,
    recalled: Option<&Recalled>,
    history: &Interleaved,
    later: Option<&History>,
    reports: &mut Reports,
) -> Joined {
    let size = now.size();
    let mut joined = later.map(|_| Interleaved::blank(size, CHANNELS));
    let chooses = now.params.choice.is_some();
    let mut prediction = chooses.then(|| Image::blank(size, 1));
    if later.is_none() && !chooses {
        return Joined::default();
    }
    let kernel = Join {
        size,
        expected: recalled.map(Expected::new),
        fewest: match now.params.lend {
            Some(_) => FEWEST_OF_A_PART,
            None => FEWEST,
        },
        longest: 1.0 / now.accumulate.alpha - 1.0,
        history: history.pixels(),
        later: later.map(|later| (later, black_level(exposure(history.pixels().part(0..3))))),
    };
    let histories = (joined.as_mut()).map(|all| all.pixels_mut());
    let outs = rows::optional(histories)
        .zip(rows::optional(prediction.as_mut().map(Image::bands)))
        .zip(plane_bands(reports.history_length, size));
    let outs = outs.map(|((history, prediction), length)| Outs {
        history,
        prediction,
        length,
    });
    rows::run(&kernel, size.height, outs);
    Joined {
        history: joined,
        prediction,
    }
}

/// Writes what history expects of a frame, shortened where the light has changed.
pub fn expect(recalled: Option<&Recalled>, size: Size, [color, moments, length]: [&mut [f32]; 3]) {
    let recalled = recalled.expect("history is recalled as an image");
    let outs = PixelsMut::bands(size, 3, color)
        .zip(PixelsMut::bands(size, 2, moments))
        .zip(PixelsMut::bands(size, 1, length));
    let outs = outs.map(|((color, moments), length)| [color, moments, length]);
    rows::run(&Expected::new(recalled), size.height, outs);
}

/// History at the pixels of a frame.
struct Expected<'a> {
    history: Pixels<'a>,
    gradient: Option<View<'a>>,
}

impl<'a> Expected<'a> {
    fn new(recalled: &'a Recalled) -> Self {
        Self {
            history: recalled.history.pixels(),
            gradient: recalled.gradient.as_ref().map(Image::view),
        }
    }

    #[inline(always)]
    fn read(&self, run: Run, changes: &mut Row, into: &mut [Row; CHANNELS]) {
        self.history.read_rows(run, into);
        if let Some(gradient) = self.gradient {
            load_shares(gradient, run, changes);
            shorten(&mut into[5], changes);
        }
    }
}

impl<'a> Kernel for Expected<'a> {
    type Out = [PixelsMut<'a>; 3];

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: Self::Out) {
        let (mut history, mut changes) = ([[0.0; SEGMENT]; CHANNELS], [0.0; SEGMENT]);
        for run in rows.flat_map(|y| segments(y, self.history.size.width)) {
            self.read(run, &mut changes, &mut history);
            for (part, out) in [0..3, 3..5, 5..6].into_iter().zip(&mut out) {
                out.write(run, &history[part]);
            }
        }
    }
}

struct Join<'a> {
    size: Size,
    /// None where nothing is known of earlier frames.
    expected: Option<Expected<'a>>,
    /// Samples that a prediction is made of at least.
    fewest: f32,
    /// Samples that a history counts for at most.
    longest: f32,
    history: Pixels<'a>,
    /// With the level of light that counts as black.
    later: Option<(&'a History<'a>, f32)>,
}

/// The luminance that is expected; NaN where that is not worth enough samples, or the new one is an outlier.
#[inline(always)]
fn predict(fewest: f32, expected: &[Row; CHANNELS], merged: &[Row; CHANNELS]) -> Row {
    let of = |[r, g, b, ..]: &[Row; CHANNELS], x: usize| luminance(r[x], g[x], b[x]);
    let [.., first, second, length] = expected;
    let mut predicted = [0.0; SEGMENT];
    for (x, predicted) in predicted.iter_mut().enumerate() {
        let l = of(expected, x);
        let deviation = larger(second[x] - first[x] * first[x], 0.0).sqrt();
        // A thousandth, as in the filter, so that rounding does not decide where there is no noise.
        let most = MOST * deviation + 1e-3 * l.abs();
        let usable = (length[x] >= fewest) & (of(merged, x) - l <= most);
        *predicted = if usable { l } else { f32::NAN };
    }
    predicted
}

/// Adds the later history, with the spikes of both held down.
#[inline(always)]
fn join_rows(black: f32, later: &[Row; CHANNELS], history: &mut [Row; CHANNELS]) {
    let mut later = *later;
    hold_spikes(black, history, &mut later);
    combine_rows(&later, history);
}

/// No history counts for more samples than accumulation leaves it beside a new one.
#[inline(always)]
fn limit(longest: f32, history: &mut [Row; CHANNELS]) {
    for length in &mut history[5] {
        *length = smaller(longest, *length); // NaN stays, and counts as none
    }
}

struct Outs<'a> {
    history: Option<PixelsMut<'a>>,
    prediction: Option<BandMut<'a>>,
    length: BandMut<'a>,
}

impl<'a> Kernel for Join<'a> {
    type Out = Outs<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: Outs<'a>) {
        let [mut expected, mut later, mut history] = [[[0.0; SEGMENT]; CHANNELS]; 3];
        let mut changes = [0.0; SEGMENT];
        for run in rows.flat_map(|y| segments(y, self.size.width)) {
            match &self.expected {
                Some(known) => known.read(run, &mut changes, &mut expected),
                None => expected[5].fill(0.0),
            }
            limit(self.longest, &mut expected);
            if let Some((known, black)) = self.later {
                known.read(run, &mut later);
                limit(self.longest, &mut later);
                join_rows(black, &later, &mut expected);
            }
            self.history.read_rows(run, &mut history);
            if let Some((joined, (_, black))) = out.history.as_mut().zip(self.later) {
                join_rows(black, &later, &mut history);
                joined.write(run, &history);
                out.length.put(run, &history[5]);
            }
            if let Some(out) = &mut out.prediction {
                out.put(run, &predict(self.fewest, &expected, &history));
            }
        }
    }
}
