//! Combination of two independent histories of the same pixels, such as that of earlier frames and that of later ones.
//!
//! Each is a mean over its samples, so the mean over all of them has the lengths for weights: with N and N′ samples,
//!   N″ = N + N′,  w = N′/N″,  c ← c + w (c′ − c),  (m₁, m₂) ← m + w (m′ − m).
//! Where a temporal gradient λ says that the light of the second one has changed, it counts as fewer samples, as in
//! [`super::accumulate`]: N′ ← N′ (1 − λ)¹⁰. A history whose colour or length is not finite has no samples; where neither
//! has any, colour and moments are NaN and N″ = 0. Moments overflow before colours do: where their mean is not finite, it is
//! that of the first history, or of the second if the first one's is not finite either.
//!
//! With an exposure e, the sides check each other. A history is a spike where one of its samples has nearly all of its light:
//! of N samples of which one is not black, the mean square is N times the square of the mean, m₂ = N m₁². With l the luminance
//! of its colour and l′ that of the other history, of N′ samples, it is multiplied by
//!   min(1, 8 (max(l′, 0) + e/16) / l) where m₂ ≥ 0.7 max(N, 2.5) m₁², N′ ≥ 2.5 and l′ is finite,
//! (m₂ by the square): a firefly, which the other side does not confirm. A highlight that lasts is in several samples, and a
//! single sample is no spike, as it may be of a surface that has just come into view.
//!
//! Inputs: two histories: colour (3), moments (2), length (1); λ (1) in [0, 1], optional; e. Outputs: the history.

use std::ops::Range;

use super::accumulate::{CHANNELS, Part, load_history, load_shares, shorten};
use crate::image::{Pixels, SEGMENT, View, segments};
use crate::math::{black_level, is_present, larger, luminance};
use crate::pixels::Row;
use crate::rows::{self, Kernel, Simd};

/// A spike is held to so many times the light of the other history.
const MOST: f32 = 8.0;
/// Share of the mean square that a single sample would have.
const SPIKE: f32 = 0.7;
/// Histories of fewer samples neither show what is a spike nor that there is none.
const FEWEST: f32 = 2.5;

/// Combines two histories, each of colour, moments and length. λ is the second one's. With an exposure, spikes are held down.
pub fn combine<'a, const PARTS: usize>(
    first: [Pixels<'a>; 3],
    second: [Pixels<'a>; 3],
    gradient: Option<View<'a>>,
    exposure: Option<f32>,
    combined: impl Iterator<Item = [Part<'a>; PARTS]>,
) {
    let kernel = Combine::<PARTS> {
        first,
        second,
        gradient,
        black: exposure.map(black_level),
    };
    rows::run(&kernel, first[0].size.height, combined);
}

struct Combine<'a, const PARTS: usize> {
    first: [Pixels<'a>; 3],
    second: [Pixels<'a>; 3],
    gradient: Option<View<'a>>,
    black: Option<f32>,
}

impl<'a, const PARTS: usize> Kernel for Combine<'a, PARTS> {
    type Out = [Part<'a>; PARTS];

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: Self::Out) {
        let [mut first, mut second] = [[[0.0; SEGMENT]; CHANNELS]; 2];
        let mut changes = [0.0; SEGMENT];
        for run in rows.flat_map(|y| segments(y, self.first[0].size.width)) {
            load_history(self.first, run, &mut first);
            load_history(self.second, run, &mut second);
            if let Some(gradient) = self.gradient {
                load_shares(gradient, run, &mut changes);
            }
            shorten(&mut second[5], &changes);
            if let Some(black) = self.black {
                hold_spikes(black, &mut first, &mut second);
            }
            combine_rows(&second, &mut first);
            for (channels, part) in &mut out {
                part.write(run, &first[channels.clone()]);
            }
        }
    }
}

/// Holds the spikes of two histories to what the other one knows.
#[inline(always)]
pub(crate) fn hold_spikes(black: f32, first: &mut [Row; CHANNELS], second: &mut [Row; CHANNELS]) {
    let factors = [spikes(black, first, second), spikes(black, second, first)];
    for (history, factors) in [first, second].into_iter().zip(&factors) {
        let [r, g, b, mean, square, _] = history;
        for row in [r, g, b, mean, &mut *square] {
            for (value, factor) in row.iter_mut().zip(factors) {
                *value *= factor;
            }
        }
        for (value, factor) in square.iter_mut().zip(factors) {
            *value *= factor;
        }
    }
}

/// The factors of a history beside another one: 1 where it is no spike.
#[inline(always)]
fn spikes(black: f32, own: &[Row; CHANNELS], other: &[Row; CHANNELS]) -> Row {
    let mut factors = [1.0; SEGMENT];
    let [r, g, b, mean, square, length] = own;
    let [or, og, ob, _, _, samples] = other;
    for (x, factor) in factors.iter_mut().enumerate() {
        let light = luminance(r[x], g[x], b[x]);
        let seen = luminance(or[x], og[x], ob[x]);
        let most = MOST * (larger(seen, 0.0) + black);
        let single = SPIKE * larger(length[x], FEWEST) * (mean[x] * mean[x]);
        let known = (samples[x] >= FEWEST) & seen.is_finite();
        // False where one is NaN, and nothing is known.
        let spike = (square[x] >= single) & known & (light > most);
        *factor = if spike { most / light } else { 1.0 };
    }
    factors
}

/// Adds the second history to the first.
#[inline(always)]
pub(crate) fn combine_rows(second: &[Row; CHANNELS], first: &mut [Row; CHANNELS]) {
    for x in 0..SEGMENT {
        let samples = |history: &[Row; CHANNELS]| {
            let [r, g, b, n] = [0, 1, 2, 5].map(|c| history[c][x]);
            let known = is_present([r, g, b]) & n.is_finite() & (n > 0.0);
            if known { n } else { 0.0 }
        };
        let (mine, other) = (samples(first), samples(second));
        let total = mine + other;
        let share = other / total; // NaN if both are 0
        for c in 0..5 {
            let (a, b) = (first[c][x], second[c][x]);
            let mixed = a + share * (b - a);
            let both = (mine > 0.0) & (other > 0.0);
            let mine = if both { a.is_finite() } else { mine > 0.0 };
            let alone = if mine { a } else { b };
            let known = if both & mixed.is_finite() {
                mixed
            } else {
                alone
            };
            first[c][x] = if total > 0.0 { known } else { f32::NAN };
        }
        first[5][x] = total;
    }
}
