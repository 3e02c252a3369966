//! Anti-lag: a history that had to be clipped far is forgotten faster.
//!
//!   N′ = N / (1 + s·d·N),  d = |l(h) − l(k)| / max(|l(h)|, |l(k)|),
//!
//! with l the luminance of the history before (h) and after clipping (k): where clipping changes nothing N stays, where
//! it changes all, about 1/s samples are left, so that the following samples count more (NRD's ReBLUR and ReLAX
//! shorten histories by the distance that clamping moves them, in a similar form).
//!
//! Inputs: length (1), history (3), clipped (3). Output: length (1). Missing history has no distance.

use std::ops::Range;

use crate::error::{Result, in_range};
use crate::image::{BandMut, Image, View};
use crate::math::luminance;
use crate::rows::{self, Kernel};

struct AntiLag<'a> {
    length: View<'a>,
    history: View<'a>,
    clipped: View<'a>,
    strength: f32,
}

/// A strength from 0; 1.
pub fn check(strength: f32) -> Result<()> {
    in_range("strength", strength, "a finite number from 0", |v| {
        v >= 0.0 && v.is_finite()
    })
}

pub fn anti_lag(length: View, history: View, clipped: View, strength: f32) -> Image {
    let mut shortened = Image::new(length.size, 1);
    let kernel = AntiLag {
        length,
        history,
        clipped,
        strength,
    };
    rows::run(&kernel, length.size.height, shortened.bands());
    shortened
}

impl<'a> Kernel for AntiLag<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut shortened: BandMut<'a>) {
        for y in rows {
            let lengths = self.length.row(0, y);
            let [hr, hg, hb] = self.history.rows(y);
            let [kr, kg, kb] = self.clipped.rows(y);
            for (x, out) in shortened.row(0, y).iter_mut().enumerate() {
                let (h, k) = (
                    luminance(hr[x], hg[x], hb[x]),
                    luminance(kr[x], kg[x], kb[x]),
                );
                let distance = (h - k).abs() / h.abs().max(k.abs());
                // NaN where both are black, or one is missing. The quotient is right for lengths without end, too.
                let shortened = 1.0 / (1.0 / lengths[x] + self.strength * distance);
                let moved = distance.is_finite() & (self.strength * distance > 0.0);
                *out = if moved { shortened } else { lengths[x] };
            }
        }
    }
}
