//! The blend of history and new sample by a blend factor α for each pixel.
//!
//! - **none**: h + α (c − h).
//! - **tone**: each side also weighted by 1/(e + luminance), with e the exposure, so that no bright sample outweighs the
//!   rest (Karis 2014, *High Quality Temporal Supersampling*).
//! - **local tone**: the same with max(e, 4 l̄) for e, where l̄ is the mean luminance of the samples of 3×3 pixels. Along the
//!   edge of a lamp, the samples that hit it would count for too little, and the edge would become darker than it is.
//! - **luminance**: α grows up to fourfold where luminances differ, lerp(min(4α, 1), α, (1 − δ)²) with
//!   δ = |l − l′| / max(l, l′, 0.2 e) (Playdead 2016, *Temporal Reprojection Anti-Aliasing in INSIDE*).
//!
//! Against flicker, α may be reduced where history lies near the minimum or maximum luminance of the neighbourhood:
//! there it has most likely just been clipped, and the next frame would clip it to the other side (Karis 2014). With d
//! = min(l_h − l_min, l_max − l_h) / (½(l_max − l_min)) in [0, 1] and k = lerp(flicker, 1, d): α·k, but 1 stays 1.
//!
//! Inputs: colour (3), history (3), α (1). Output: colour (3). Where one side is missing, the other is copied.

use std::ops::Range;

use crate::error::{Result, from_0_to_1};
use crate::image::{Pixels, Run, SEGMENT, View, segments};
use crate::kernels::judge::exposure;
use crate::kernels::judge::neighborhood::{self, Window};
use crate::lanes::LANES;
use crate::math::{is_present, larger, luminance, saturate, smaller};
use crate::pixels::{Columns, PixelsMut, Rolling, Row, lanes};
use crate::rows::{self, BAND, Kernel, Simd};

/// What beside α weighs the two colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Weighting {
    /// Nothing.
    None,
    /// 1/(e + luminance).
    Tone,
    /// 1/(max(e, 4 l̄) + luminance), with l̄ the mean luminance around.
    LocalTone,
    /// The likeness of their luminances.
    Luminance,
}

/// Luminances up to so many times the local mean are not reduced.
const AROUND: f32 = 4.0;
/// Cap on luminances, so that sums cannot overflow.
const BRIGHTEST: f32 = 1e30;

/// How colours are weighed beside α.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// None.
    pub weighting: Weighting,
    /// Factor on α where history lies at the neighbourhood's extremes; 0 to 1; 1, which skips the neighbourhood.
    pub flicker: f32,
    /// The radiance that counts as 1; above 0; 1.
    pub exposure: f32,
}

impl Default for Params {
    fn default() -> Self {
        Self::PLAIN
    }
}

impl Params {
    /// By α alone.
    pub const PLAIN: Self = Self {
        weighting: Weighting::None,
        flicker: 1.0,
        exposure: 1.0,
    };

    /// Names of weightings.
    pub const WEIGHTINGS: [(&str, Weighting); 4] = [
        ("none", Weighting::None),
        ("tone", Weighting::Tone),
        ("local-tone", Weighting::LocalTone),
        ("luminance", Weighting::Luminance),
    ];

    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        from_0_to_1("flicker", self.flicker)?;
        exposure::check(self.exposure)
    }
}

/// Whether a number can be the share of the new sample.
pub fn check_alpha(share: f32) -> Result<()> {
    from_0_to_1("alpha", share)
}

/// One blend factor for all pixels, or one for each.
#[derive(Clone, Copy)]
pub enum Alpha<'a> {
    /// 0 to 1.
    Constant(f32),
    /// 0 to 1 for each pixel.
    Map(View<'a>),
}

impl Alpha<'_> {
    /// The blend factors of a span. NaN counts as 1: the sample alone.
    #[inline(always)]
    pub(crate) fn read(&self, run: Run, into: &mut [f32]) {
        let into = &mut into[..run.len];
        match self {
            Self::Constant(alpha) => into.fill(*alpha),
            Self::Map(map) => {
                let alphas = map.run(0, run);
                for (into, &alpha) in into.iter_mut().zip(alphas) {
                    *into = if alpha.is_nan() { 1.0 } else { saturate(alpha) };
                }
            }
        }
    }
}

struct Blend<'a> {
    color: Pixels<'a>,
    history: Pixels<'a>,
    alpha: Alpha<'a>,
    params: Params,
}

/// Writes the blended colours.
pub fn blend<'a>(
    color: Pixels<'a>,
    history: Pixels<'a>,
    alpha: Alpha<'a>,
    params: Params,
    blended: impl Iterator<Item = PixelsMut<'a>>,
) {
    let height = color.size.height;
    let kernel = Blend {
        color,
        history,
        alpha,
        params,
    };
    rows::run(&kernel, height, blended);
}

impl<'a> Kernel for Blend<'a> {
    type Out = PixelsMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: PixelsMut<'a>) {
        let Params {
            weighting,
            flicker,
            exposure,
        } = self.params;
        let size = self.color.size;
        let looks_around = flicker < 1.0 || weighting == Weighting::LocalTone;
        let mut colors = Rolling::new(size.width, if looks_around { 1 } else { 0 });
        let mut history = [[0.0; SEGMENT]; 3];
        let mut blended = [[0.0; SEGMENT]; 3];
        let mut alphas = [0.0; SEGMENT];
        for y in rows.clone() {
            colors.roll(self.color, y, y == rows.start);
            for run in segments(y, size.width) {
                self.history.read_rows(run, &mut history);
                self.alpha.read(run, &mut alphas);
                if flicker < 1.0 {
                    reduce_flicker(&colors, run, &history, flicker, &mut alphas);
                }
                if weighting == Weighting::LocalTone {
                    weigh_by_local_tone(&colors, run, &history, exposure, &mut alphas);
                }
                let own = colors.own(run);
                mix(own, &history, &alphas, weighting, exposure, &mut blended);
                out.write(run, &blended);
            }
        }
    }
}

struct ClipBlend<'a> {
    color: Pixels<'a>,
    history: Pixels<'a>,
    alpha: Alpha<'a>,
    clip: neighborhood::Params,
}

/// Clips history to the neighbourhood of `color`, then blends without weighting. Fused, so that clipped history never
/// leaves the cache.
pub fn clip_and_blend<'a>(
    color: Pixels<'a>,
    history: Pixels<'a>,
    alpha: Alpha<'a>,
    clip: neighborhood::Params,
    blended: impl Iterator<Item = PixelsMut<'a>>,
) {
    let height = color.size.height;
    let kernel = ClipBlend {
        color,
        history,
        alpha,
        clip,
    };
    let jobs = rows::tall_jobs(height, clip.radius as usize, blended);
    rows::run_jobs(&kernel, jobs);
}

impl<'a> Kernel for ClipBlend<'a> {
    type Out = Vec<PixelsMut<'a>>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut outs: Self::Out) {
        let size = self.color.size;
        let mut window = Window::new(size.width, self.clip);
        let mut clipped = [[0.0; SEGMENT]; 3];
        let mut blended = [[0.0; SEGMENT]; 3];
        let mut alphas = [0.0; SEGMENT];
        for y in rows.clone() {
            window.roll(self.color, y, y == rows.start);
            let out = &mut outs[(y - rows.start) / BAND];
            for run in segments(y, size.width) {
                self.history.read_rows(run, &mut clipped);
                window.clip(run, &mut clipped);
                self.alpha.read(run, &mut alphas);
                let own = window.colors.own(run);
                mix(own, &clipped, &alphas, Weighting::None, 1.0, &mut blended);
                out.write(run, &blended);
            }
        }
    }
}

/// Reduces α where history lies near the minimum or maximum luminance of the 3×3 neighbourhood.
#[inline(always)]
pub(crate) fn reduce_flicker(
    colors: &Rolling<3>,
    run: Run,
    history: &[Row; 3],
    flicker: f32,
    alphas: &mut Row,
) {
    let n = lanes(run);
    let mut lows: Columns = [f32::INFINITY; _];
    let mut highs: Columns = [f32::NEG_INFINITY; _];
    for dy in -1..=1 {
        let [r, g, b] = colors.columns(run, dy);
        for i in 0..n + LANES {
            let l = luminance(r[i], g[i], b[i]);
            let counts = is_present([r[i], g[i], b[i]]);
            lows[i] = if counts & (l < lows[i]) { l } else { lows[i] };
            highs[i] = if counts & (l > highs[i]) { l } else { highs[i] };
        }
    }
    let first = colors.radius - 1;
    let (lows, highs) = (&lows[first..][..n + 2], &highs[first..][..n + 2]);
    let [r, g, b] = history;
    for i in 0..n {
        let low = smaller(lows[i], smaller(lows[i + 1], lows[i + 2]));
        let high = larger(highs[i], larger(highs[i + 1], highs[i + 2]));
        let l = luminance(r[i], g[i], b[i]);
        let inside = (l - low).min(high - l) / (0.5 * (high - low));
        let inside = if high > low { saturate(inside) } else { 1.0 };
        let kept = flicker + (1.0 - flicker) * inside;
        alphas[i] *= kept + alphas[i] * (1.0 - kept);
    }
}

/// Weighs both sides by tone, relative to what is around, within α.
#[inline(always)]
pub(crate) fn weigh_by_local_tone(
    colors: &Rolling<3>,
    run: Run,
    history: &[Row; 3],
    exposure: f32,
    alphas: &mut Row,
) {
    let n = lanes(run);
    let (mut sums, mut counts): (Columns, Columns) = ([0.0; _], [0.0; _]);
    for dy in -1..=1 {
        let [r, g, b] = colors.columns(run, dy);
        for i in 0..n + LANES {
            let counted = is_present([r[i], g[i], b[i]]);
            let light = smaller(larger(luminance(r[i], g[i], b[i]), 0.0), BRIGHTEST);
            sums[i] += if counted { light } else { 0.0 };
            counts[i] += if counted { 1.0 } else { 0.0 };
        }
    }
    let first = colors.radius - 1;
    let [sums, counts] = [&sums, &counts].map(|columns| &columns[first..][..n + 2]);
    let ([cr, cg, cb], [hr, hg, hb]) = (colors.own(run), history);
    for i in 0..run.len {
        let sum = sums[i] + sums[i + 1] + sums[i + 2];
        let count = counts[i] + counts[i + 1] + counts[i + 2];
        let exposure = larger(exposure, AROUND * (sum / larger(count, 1.0)));
        let [new, old] = [
            luminance(cr[i], cg[i], cb[i]),
            luminance(hr[i], hg[i], hb[i]),
        ];
        alphas[i] = by_tone(alphas[i], new, old, exposure);
    }
}

/// Both weights folded into one effective α, the fraction expanded by both denominators.
#[inline(always)]
fn by_tone(alpha: f32, new: f32, old: f32, exposure: f32) -> f32 {
    let new_share = alpha * (exposure + old.max(0.0));
    let old_share = (1.0 - alpha) * (exposure + new.max(0.0));
    new_share / (new_share + old_share)
}

/// Blends a span. By local tone, α has its weights already.
#[inline(always)]
pub(crate) fn mix(
    color: [&[f32]; 3],
    history: &[Row; 3],
    alphas: &Row,
    weighting: Weighting,
    exposure: f32,
    blended: &mut [Row; 3],
) {
    match weighting {
        Weighting::None | Weighting::LocalTone => {
            mix_by(color, history, alphas, blended, |a, _, _| a);
        }
        Weighting::Tone => mix_by(color, history, alphas, blended, |a, c, h| {
            by_tone(a, c, h, exposure)
        }),
        Weighting::Luminance => mix_by(color, history, alphas, blended, |a, c, h| {
            let alike = (1.0 - (c - h).abs() / c.max(h).max(0.2 * exposure)).max(0.0);
            let most = (4.0 * a).min(1.0);
            most + alike * alike * (a - most)
        }),
    }
}

#[inline(always)]
fn mix_by(
    color: [&[f32]; 3],
    [hr, hg, hb]: &[Row; 3],
    alphas: &Row,
    [or, og, ob]: &mut [Row; 3],
    effective: impl Fn(f32, f32, f32) -> f32,
) {
    let n = color[0].len().min(SEGMENT);
    let [cr, cg, cb] = color.map(|row| &row[..n]);
    for x in 0..n {
        let (c, h) = ([cr[x], cg[x], cb[x]], [hr[x], hg[x], hb[x]]);
        let present = is_present(c);
        let remembered = is_present(h);
        let a = effective(
            alphas[x],
            luminance(c[0], c[1], c[2]),
            luminance(h[0], h[1], h[2]),
        );
        let mixed = |c: f32, h: f32| {
            let known = if remembered { h + a * (c - h) } else { c };
            let kept = if remembered { h } else { f32::NAN };
            if present { known } else { kept }
        };
        (or[x], og[x], ob[x]) = (mixed(c[0], h[0]), mixed(c[1], h[1]), mixed(c[2], h[2]));
    }
}
