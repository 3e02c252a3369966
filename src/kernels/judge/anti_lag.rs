//! Anti-lag: history that was clipped by a large distance is shortened, so that it follows faster.
//!
//!   N′ = N / (1 + s·d·N),  d = |l(h) − l(k)| / max(|l(h)|, |l(k)|),
//!
//! with l the luminance of the history before (h) and after clipping (k). Where clipping changes nothing, N stays; where
//! it changes everything, about 1/s samples are left, so that the following samples count more (NRD's ReBLUR and ReLAX
//! shorten histories by the distance that clamping moves them, in a similar form).
//!
//! Inputs: length (1), history (3), clipped (3). Output: length (1). Where history is missing, N stays.

use std::ops::Range;

use crate::image::{Pixels, SEGMENT, View, segments};
use crate::math::{larger, luminance};
use crate::pixels::{PixelsMut, Row};
use crate::rows::{self, Kernel, Simd};

struct AntiLag<'a> {
    length: View<'a>,
    history: Pixels<'a>,
    clipped: Pixels<'a>,
    strength: f32,
}

/// Writes the shortened lengths.
pub fn anti_lag<'a>(
    length: View<'a>,
    history: Pixels<'a>,
    clipped: Pixels<'a>,
    strength: f32,
    shortened: impl Iterator<Item = PixelsMut<'a>>,
) {
    let height = length.size.height;
    let kernel = AntiLag {
        length,
        history,
        clipped,
        strength,
    };
    rows::run(&kernel, height, shortened);
}

impl<'a> Kernel for AntiLag<'a> {
    type Out = PixelsMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut shortened: PixelsMut<'a>) {
        let [mut history, mut clipped] = [[[0.0; SEGMENT]; 3]; 2];
        let mut out = [0.0; SEGMENT];
        for run in rows.flat_map(|y| segments(y, self.length.size.width)) {
            self.history.read_rows(run, &mut history);
            self.clipped.read_rows(run, &mut clipped);
            let out = &mut out[..run.len];
            out.copy_from_slice(self.length.run(0, run));
            shorten(out, &history, &clipped, self.strength);
            shortened.write(run, [&*out]);
        }
    }
}

/// Shortens the history lengths of a span.
#[inline(always)]
pub(crate) fn shorten(lengths: &mut [f32], history: &[Row; 3], clipped: &[Row; 3], strength: f32) {
    let n = lengths.len().min(SEGMENT);
    let [hr, hg, hb] = history.each_ref().map(|row| &row[..n]);
    let [kr, kg, kb] = clipped.each_ref().map(|row| &row[..n]);
    for x in 0..n {
        let h = luminance(hr[x], hg[x], hb[x]);
        let k = luminance(kr[x], kg[x], kb[x]);
        lengths[x] = shortened(lengths[x], h, k, strength);
    }
}

/// N′, from N and the luminances of history before and after clipping.
#[inline(always)]
pub(crate) fn shortened(length: f32, before: f32, clipped: f32, strength: f32) -> f32 {
    let distance = (before - clipped).abs() / larger(before.abs(), clipped.abs());
    // The distance is NaN if both are black or one is missing. Written as 1/(1/N + …), so that N may be infinite.
    let shortened = 1.0 / (1.0 / length + strength * distance);
    let moved = distance.is_finite() & (strength * distance > 0.0);
    if moved { shortened } else { length }
}
