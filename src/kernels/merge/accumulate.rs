//! Temporal accumulation: an exponential moving average of colour and of two moments of luminance.
//!
//! With N the number of samples so far, as reprojected (a fraction where footprints mix), and l the luminance:
//!   N ← min(N + 1, 1/α),  a = 1/N,  c ← h + a (c − h),  (m₁, m₂) ← m + max(αₘ, 1/N) ((l, l²) − m).
//! So the first samples are averaged equally, until 1/N reaches α; without warm-up a = α and αₘ from the second sample
//! on (Schied et al. 2017, section 4.2; Yang, Liu and Salvi 2020, *A Survey of Temporal Antialiasing Techniques*).
//! Where a temporal gradient λ says that the light has changed, history is shortened before and its share falls:
//!   N ← N (1 − λ)¹⁰,  a ← lerp(a, 1, λ)
//! (Schied, Peters and Dachsbacher 2018, *Gradient Estimation for Real-Time Adaptive Temporal Filtering*; the exponent
//! as in Q2RTX). A pixel without history starts at N = 1. A sample with NaN or infinity is missing: history is kept as it is, and
//! where there is none, colour and moments are NaN and N = 0, the mark of a pixel that nobody has seen.
//!
//! Inputs: colour (3), history: colour (3), moments (2), length (1), λ (1) in [0, 1], optional. Outputs: the same, and the number of missing samples.

use std::ops::Range;

use crate::error::{Error, Result, in_range};
use crate::image::{BandMut, Image, View};
use crate::math::{is_present, luminance, saturate};
use crate::rows::{self, Kernel};

#[derive(Clone, Copy, Debug)]
pub struct Params {
    /// Smallest share of the new sample; 0 to 1; 0.05.
    pub alpha: f32,
    /// The same for the moments; 0 to 1; 0.2.
    pub moments_alpha: f32,
    /// Whether the first samples are averaged equally; true.
    pub warmup: bool,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            alpha: 0.05,
            moments_alpha: 0.2,
            warmup: true,
        }
    }
}

impl Params {
    pub fn check(&self) -> Result<()> {
        in_range("alpha", self.alpha, "a share from 0 to 1", |v| {
            (0.0..=1.0).contains(&v)
        })?;
        in_range(
            "moments_alpha",
            self.moments_alpha,
            "a share from 0 to 1",
            |v| (0.0..=1.0).contains(&v),
        )?;
        if !self.warmup && (self.alpha == 0.0 || self.moments_alpha == 0.0) {
            return Err(Error::value(
                "alpha, moments_alpha",
                "above 0 without warm-up",
                0,
            ));
        }
        Ok(())
    }
}

/// Channels of a history image: colour 0 to 2, moments 3 and 4, length 5.
pub const CHANNELS: usize = 6;

struct Accumulate<'a> {
    color: View<'a>,
    history: [&'a [f32]; CHANNELS],
    gradient: Option<View<'a>>,
    params: Params,
}

/// The history image (of [`CHANNELS`]) with the new samples merged in, and the number of missing samples. The planes of
/// `history` are those of a history image in order.
pub fn accumulate(
    color: View,
    history: [&[f32]; CHANNELS],
    gradient: Option<View>,
    params: Params,
) -> (Image, usize) {
    let size = color.size;
    let mut merged = Image::new(size, CHANNELS);
    let mut missing = vec![0; rows::bands(size.height).count()];
    let kernel = Accumulate {
        color,
        history,
        gradient,
        params,
    };
    rows::run(&kernel, size.height, merged.bands().zip(missing.iter_mut()));
    (merged, missing.iter().sum())
}

impl<'a> Kernel for Accumulate<'a> {
    type Out = (BandMut<'a>, &'a mut usize);

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, (mut merged, missing): Self::Out) {
        let width = self.color.size.width;
        for y in rows {
            let color = self.color.rows(y);
            *missing += count_missing(color);
            let history = self.history.map(|plane| &plane[y * width..][..width]);
            let out = merged.rows(y);
            match self.gradient {
                None => merge(self.params, color, history, |_| 0.0, out),
                Some(gradient) => {
                    let gradient = &gradient.row(0, y)[..width];
                    let change = |x: usize| saturate(gradient[x]);
                    merge(self.params, color, history, change, out);
                }
            }
        }
    }
}

/// Pixels of a row whose sample is missing.
#[inline(always)]
pub fn count_missing([r, g, b]: [&[f32]; 3]) -> usize {
    r.iter()
        .zip(g)
        .zip(b)
        .filter(|&((&r, &g), &b)| !is_present([r, g, b]))
        .count()
}

#[inline(always)]
fn tenth_power(x: f32) -> f32 {
    let square = x * x;
    let fourth = square * square;
    fourth * fourth * square
}

#[inline(always)]
fn merge(
    params: Params,
    color: [&[f32]; 3],
    history: [&[f32]; CHANNELS],
    change: impl Fn(usize) -> f32,
    out: [&mut [f32]; CHANNELS],
) {
    let longest = 1.0 / params.alpha;
    let width = color[0].len();
    let [or, og, ob, o1, o2, on] = out.map(|row| &mut row[..width]);
    let [hr, hg, hb, h1, h2, hn] = history.map(|row| &row[..width]);
    let [cr, cg, cb] = color.map(|row| &row[..width]);
    for x in 0..width {
        let c = [cr[x], cg[x], cb[x]];
        let h = [hr[x], hg[x], hb[x]];
        let present = is_present(c);
        let change = change(x);
        let before = hn[x] * tenth_power(1.0 - change);
        let remembered = is_present(h)
            & h1[x].is_finite()
            & h2[x].is_finite()
            & before.is_finite()
            & (before > 0.0);
        let before = if remembered { before } else { 0.0 };
        let counted = before + 1.0;
        let counted = if counted < longest { counted } else { longest };
        let inverse = 1.0 / counted;
        let (a, am) = if params.warmup {
            (
                inverse,
                if inverse > params.moments_alpha {
                    inverse
                } else {
                    params.moments_alpha
                },
            )
        } else {
            (params.alpha, params.moments_alpha)
        };
        let (a, am) = (a + change * (1.0 - a), am + change * (1.0 - am));
        let l = luminance(c[0], c[1], c[2]);
        let mixed = |history: f32, new: f32, share: f32| {
            let merged = if remembered {
                history + share * (new - history)
            } else {
                new
            };
            let kept = if remembered { history } else { f32::NAN };
            if present { merged } else { kept }
        };
        or[x] = mixed(h[0], c[0], a);
        og[x] = mixed(h[1], c[1], a);
        ob[x] = mixed(h[2], c[2], a);
        o1[x] = mixed(h1[x], l, am);
        o2[x] = mixed(h2[x], l * l, am);
        let length = if remembered { counted } else { 1.0 };
        on[x] = if present { length } else { before };
    }
}
