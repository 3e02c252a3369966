//! The temporal gradient: how far the light of a neighbourhood has changed, beyond what noise explains.
//!
//! For two images of the same pixels, δ = l − l′ is the difference of luminances and m = max(|l|, |l′|) the larger. Both,
//! and δ², are blurred by passes of {1, 2, 1}/4 ⊗ {1, 2, 1}/4 at steps of 1, 2, 4, …, over the pixels that both images
//! have (their share is w). Then, with the mean D = Σδ/w, the variance of δ, V = Σδ²/w − D², and K the sum of squares of
//! the composed kernel,
//!   λ = clamp((|D| − z √(V K / w)) w / Σm, 0, 1):
//! the change relative to the larger light, where it exceeds z standard errors. δ keeps its sign while it is blurred, so
//! that noise cancels (Schied, Peters and Dachsbacher 2018, *Gradient Estimation for Real-Time Adaptive Temporal
//! Filtering*). Two renders with the same random numbers have the same noise, and z = 0 gives their exact gradient; for a
//! new frame and a reprojected history the standard error keeps noise from counting as change. Small blurs tell where
//! light has changed, wide ones see a change that is everywhere but small: of several, the largest λ counts.
//!
//! Inputs: two images (3). Output: λ (1) in [0, 1]; 0 where nothing is known.

use std::ops::Range;

use crate::error::{Result, in_range, whole};
use crate::image::{BandMut, Image, Run, Tap, View};
use crate::math::{is_present, luminance, saturate};
use crate::rows::{self, Kernel};

#[derive(Clone, Copy, Debug)]
pub struct Params {
    /// z: standard errors that count as noise; ≥ 0; 2.
    pub noise: f32,
    /// Passes of the smallest blur; 0 to 8; 3.
    pub passes: u32,
    /// Passes of the widest blur; `passes` to 8; 3.
    pub widest: u32,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            noise: 2.0,
            passes: 3,
            widest: 3,
        }
    }
}

impl Params {
    pub fn passes(name: &str, value: i64) -> Result<u32> {
        whole(name, value, "0 to 8 passes", |&n| n <= 8)
    }

    pub fn check(&self) -> Result<()> {
        in_range("noise", self.noise, "a finite number from 0", |v| {
            v >= 0.0 && v.is_finite()
        })?;
        let known = format!("at least as many as passes, {}", self.passes);
        whole("widest", i64::from(self.widest), &known, |&n: &u32| {
            n >= self.passes
        })
        .map(|_| ())
    }
}

/// w, δ, δ² and m; all 0 where a pixel is missing.
const CHANNELS: usize = 4;

pub fn temporal_gradient(color: View, previous: View, params: Params) -> Image {
    let size = color.size;
    let mut sums = Image::new(size, CHANNELS);
    rows::run(&Differences { color, previous }, size.height, sums.bands());
    let mut along = Image::new(size, CHANNELS);
    let mut gradient = Image::new(size, 1);
    for pass in 0..=params.widest {
        if pass >= params.passes {
            let kernel = Gradient {
                sums: &sums,
                noise: params.noise,
                squares: sum_of_squares(pass),
            };
            rows::run(&kernel, size.height, gradient.bands());
        }
        if pass == params.widest {
            break;
        }
        let step = 1 << pass;
        for (dx, dy) in [(1, 0), (0, 1)] {
            let blur = Blur {
                sums: &sums,
                tap: Tap { dx, dy, step },
            };
            rows::run(&blur, size.height, along.bands());
            std::mem::swap(&mut sums, &mut along);
        }
    }
    gradient
}

/// Of the composed kernel's weights, over both axes.
fn sum_of_squares(passes: u32) -> f32 {
    let mut kernel = vec![1.0_f64];
    for pass in 0..passes {
        let step = 1 << pass;
        let mut wider = vec![0.0; kernel.len() + 2 * step];
        for (i, weight) in kernel.iter().enumerate() {
            wider[i] += 0.25 * weight;
            wider[i + step] += 0.5 * weight;
            wider[i + 2 * step] += 0.25 * weight;
        }
        kernel = wider;
    }
    let along: f64 = kernel.iter().map(|w| w * w).sum();
    (along * along) as f32
}

struct Differences<'a> {
    color: View<'a>,
    previous: View<'a>,
}

impl<'a> Kernel for Differences<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: BandMut<'a>) {
        for y in rows {
            let ([r, g, b], [pr, pg, pb]) = (self.color.rows(y), self.previous.rows(y));
            let [weight, delta, square, most] = out.rows(y);
            for x in 0..r.len() {
                let known = is_present([r[x], g[x], b[x]]) & is_present([pr[x], pg[x], pb[x]]);
                let l = luminance(r[x], g[x], b[x]);
                let other = luminance(pr[x], pg[x], pb[x]);
                let keep = |v: f32| if known { v } else { 0.0 };
                weight[x] = keep(1.0);
                delta[x] = keep(l - other);
                square[x] = keep((l - other) * (l - other));
                most[x] = keep(l.abs().max(other.abs()));
            }
        }
    }
}

/// {1, 2, 1}/4 along one axis, with nothing beyond the border.
struct Blur<'a> {
    sums: &'a Image,
    tap: Tap,
}

impl<'a> Kernel for Blur<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: BandMut<'a>) {
        let size = self.sums.size;
        for y in rows {
            let row = Run {
                y,
                x: 0,
                len: size.width,
            };
            for (out, &sum) in out
                .rows::<CHANNELS>(y)
                .into_iter()
                .flatten()
                .zip(self.sums.view().rows::<CHANNELS>(y).into_iter().flatten())
            {
                *out = 0.5 * sum;
            }
            for side in [-1, 1] {
                let tap = Tap {
                    dx: side * self.tap.dx,
                    dy: side * self.tap.dy,
                    step: self.tap.step,
                };
                let Some(here) = tap.inside(row, size) else {
                    continue;
                };
                let there: [&[f32]; CHANNELS] = tap.of(here).rows(self.sums);
                for (out, there) in out.rows::<CHANNELS>(y).into_iter().zip(there) {
                    for (out, &sum) in out[here.x..][..here.len].iter_mut().zip(there) {
                        *out += 0.25 * sum;
                    }
                }
            }
        }
    }
}

/// Raises a gradient to what one blur shows.
struct Gradient<'a> {
    sums: &'a Image,
    noise: f32,
    squares: f32,
}

impl<'a> Kernel for Gradient<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut gradient: BandMut<'a>) {
        for y in rows {
            let [weight, delta, square, most] = self.sums.view().rows(y);
            for (x, gradient) in gradient.row(0, y).iter_mut().enumerate() {
                let w = weight[x];
                let mean = delta[x] / w;
                let variance = (square[x] / w - mean * mean).max(0.0);
                let error = (variance * self.squares / w).sqrt();
                let change = (mean.abs() - self.noise * error) / (most[x] / w);
                // NaN where nothing is known or all is black.
                *gradient = gradient.max(saturate(change));
            }
        }
    }
}
