//! The blend of history and new sample, by a share α for each pixel.
//!
//! - **none**: h + α (c − h).
//! - **tone**: each side weighted by 1/(e + luminance) as well, with e the exposure, so that no bright sample outweighs the rest (Karis 2014,
//!   *High Quality Temporal Supersampling*).
//! - **luminance**: α grows to four times as much where the luminances differ, lerp(4α, α, (1 − δ)²) with
//!   δ = |l − l′| / max(l, l′, 0.2 e) (Playdead 2016, *Temporal Reprojection Anti-Aliasing in INSIDE*).
//!
//! Against flicker, α may fall where history lies near the border of the luminances that surround the pixel: there it
//! has most likely just been clipped, and the next frame would clip it to the other side (Karis 2014). With
//! d = min(l_h − l_min, l_max − l_h) / (½(l_max − l_min)) in [0, 1] and k = lerp(flicker, 1, d): α·k, but 1 stays 1.
//!
//! Inputs: colour (3), history (3), α (1). Output: colour (3). What is missing on one side comes from the other.

use std::ops::Range;

use crate::error::{Result, in_range};
use crate::image::{BandMut, Image, View};
use crate::math::{is_present, luminance, saturate};
use crate::rows::{self, Kernel};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Weighting {
    None,
    Tone,
    Luminance,
}

#[derive(Clone, Copy, Debug)]
pub struct Params {
    /// None.
    pub weighting: Weighting,
    /// What is left of α on the border of the neighbourhood; 0 to 1; 1, which asks for no neighbourhood.
    pub flicker: f32,
    /// The radiance that counts as 1; above 0; 1.
    pub exposure: f32,
}

impl Params {
    pub const WEIGHTINGS: [(&str, Weighting); 3] = [
        ("none", Weighting::None),
        ("tone", Weighting::Tone),
        ("luminance", Weighting::Luminance),
    ];

    pub fn check(&self) -> Result<()> {
        in_range("flicker", self.flicker, "a share from 0 to 1", |v| {
            (0.0..=1.0).contains(&v)
        })?;
        in_range("exposure", self.exposure, "a finite number above 0", |v| {
            v > 0.0 && v.is_finite()
        })
    }
}

/// One share for all pixels, or one for each.
#[derive(Clone, Copy)]
pub enum Alpha<'a> {
    Constant(f32),
    Map(View<'a>),
}

struct Blend<'a> {
    color: View<'a>,
    history: View<'a>,
    alpha: Alpha<'a>,
    params: Params,
}

pub fn blend(color: View, history: View, alpha: Alpha, params: Params) -> Image {
    let mut blended = Image::new(color.size, 3);
    let kernel = Blend {
        color,
        history,
        alpha,
        params,
    };
    rows::run(&kernel, color.size.height, blended.bands());
    blended
}

impl<'a> Kernel for Blend<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut blended: BandMut<'a>) {
        let width = self.color.size.width;
        let mut shares = vec![0.0; width];
        for y in rows {
            match self.alpha {
                Alpha::Constant(alpha) => shares.fill(alpha),
                Alpha::Map(map) => {
                    for (share, &alpha) in shares.iter_mut().zip(map.row(0, y)) {
                        *share = if alpha.is_nan() { 1.0 } else { saturate(alpha) };
                    }
                }
            }
            if self.params.flicker < 1.0 {
                self.calm(y, &mut shares);
            }
            let exposure = self.params.exposure;
            let (color, history, out) = (self.color.rows(y), self.history.rows(y), blended.rows(y));
            match self.params.weighting {
                Weighting::None => mix(color, history, &shares, out, |a, _, _| a),
                // The weights' ratio as one share.
                Weighting::Tone => mix(color, history, &shares, out, |a, c, h| {
                    let (new, old) = (
                        a / (exposure + c.max(0.0)),
                        (1.0 - a) / (exposure + h.max(0.0)),
                    );
                    new / (new + old)
                }),
                Weighting::Luminance => mix(color, history, &shares, out, |a, c, h| {
                    let alike = (1.0 - (c - h).abs() / c.max(h).max(0.2 * exposure)).max(0.0);
                    let most = (4.0 * a).min(1.0);
                    most + alike * alike * (a - most)
                }),
            }
        }
    }
}

impl Blend<'_> {
    /// Lessens the shares where history lies near the border of what surrounds the pixel.
    #[inline(always)]
    fn calm(&self, y: usize, shares: &mut [f32]) {
        let size = self.color.size;
        let rows = y.saturating_sub(1)..(y + 2).min(size.height);
        let [hr, hg, hb] = self.history.rows(y);
        for (x, share) in shares.iter_mut().enumerate() {
            let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
            for y in rows.clone() {
                let [r, g, b] = self.color.rows(y);
                for x in x.saturating_sub(1)..(x + 2).min(size.width) {
                    let l = luminance(r[x], g[x], b[x]);
                    let counts = is_present([r[x], g[x], b[x]]);
                    low = if counts { low.min(l) } else { low };
                    high = if counts { high.max(l) } else { high };
                }
            }
            let l = luminance(hr[x], hg[x], hb[x]);
            let inside = (l - low).min(high - l) / (0.5 * (high - low));
            let inside = if high > low { saturate(inside) } else { 1.0 };
            let kept = self.params.flicker + (1.0 - self.params.flicker) * inside;
            *share *= kept + *share * (1.0 - kept);
        }
    }
}

#[inline(always)]
fn mix(
    color: [&[f32]; 3],
    history: [&[f32]; 3],
    shares: &[f32],
    out: [&mut [f32]; 3],
    share: impl Fn(f32, f32, f32) -> f32,
) {
    let n = shares.len();
    let [cr, cg, cb] = color.map(|row| &row[..n]);
    let [hr, hg, hb] = history.map(|row| &row[..n]);
    let [or, og, ob] = out.map(|row| &mut row[..n]);
    for x in 0..n {
        let (c, h) = ([cr[x], cg[x], cb[x]], [hr[x], hg[x], hb[x]]);
        let present = is_present(c);
        let remembered = is_present(h);
        let a = share(
            shares[x],
            luminance(c[0], c[1], c[2]),
            luminance(h[0], h[1], h[2]),
        );
        let mixed = |c: f32, h: f32| {
            let known = if remembered { h + a * (c - h) } else { c };
            let kept = if remembered { h } else { f32::NAN };
            if present { known } else { kept }
        };
        or[x] = mixed(c[0], h[0]);
        og[x] = mixed(c[1], h[1]);
        ob[x] = mixed(c[2], h[2]);
    }
}
