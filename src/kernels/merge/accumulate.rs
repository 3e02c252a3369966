//! Temporal accumulation: an exponential moving average of colour and of two moments of luminance.
//!
//! With N the number of samples so far, as reprojected (a fraction where footprints mix), and l the luminance:
//!   N ← min(N + 1, 1/α),  a = 1/N,  c ← h + a (c − h),  (m₁, m₂) ← m + max(αₘ, 1/N) ((l, l²) − m).
//! So the first samples are averaged equally, until 1/N reaches α; without warm-up a = α and αₘ from the second sample
//! on (Schied et al. 2017, section 4.2; Yang, Liu and Salvi 2020, *A Survey of Temporal Antialiasing Techniques*).
//! Where a temporal gradient λ says that the light has changed, history is shortened before and its share falls:
//!   N ← N (1 − λ)¹⁰,  a ← lerp(a, 1, λ)
//! (Schied, Peters and Dachsbacher 2018, *Gradient Estimation for Real-Time Adaptive Temporal Filtering*; the exponent as in
//! Q2RTX); so it does for the moments. A colour that counts for less than a sample, such as one that neighbours lend, has a
//! weight w below 1:
//!   N ← min(N + w, 1/α),  a = w/N,  and max(w αₘ, w/N) for the moments.
//! Where the confidence κ in history is below 1, the sample's share rises: a ← lerp(a, 1, w (1 − κ)), and likewise for the
//! moments. So what is reconstructed helps where little is known, and hardly shows among samples. A pixel without history
//! starts at N = w. A sample with NaN or infinity, or without weight, is missing: history is kept as it is, and where there is
//! none, colour and moments are NaN and N = 0, the mark of a pixel without any sample so far.
//!
//! Inputs: colour (3), w (1) in [0, 1], optional; history: colour (3), moments (2), length (1); λ and κ (1) in [0, 1],
//! optional. Outputs: the history, and the number of missing samples.

use std::ops::Range;

use crate::error::{Error, Result, from_0_to_1};
use crate::image::{Pixels, Run, SEGMENT, Size, View, segments};
use crate::math::{is_present, larger, luminance, saturate, smaller};
use crate::pixels::{Colors, PixelsMut, Row};
use crate::rows::{self, Kernel, Simd};

/// Least weights of the new sample, and when history is shortened.
#[derive(Clone, Copy, Debug, PartialEq)]
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
    /// The same without forgetting: all samples are averaged.
    pub fn averaging(self) -> Self {
        Self {
            alpha: 0.0,
            moments_alpha: 0.0,
            ..self
        }
    }

    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        from_0_to_1("alpha", self.alpha)?;
        from_0_to_1("moments_alpha", self.moments_alpha)?;
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

/// Colour, moments and length of a history image.
pub(crate) fn parts(history: Pixels) -> [Pixels; 3] {
    [0..3, 3..5, 5..6].map(|part| history.part(part))
}

/// The source of a span's history: [`Images`], for other crates.
pub trait History: Sync {
    /// A band of outputs that are written while the history is read, such as its coverage.
    type Out: Send;
    /// Buffers that spans share.
    type Scratch;

    /// Buffers for [`History::read`].
    fn scratch(&self) -> Self::Scratch;

    /// Reads a run's history, and the confidence in it, which is 1 before.
    fn read(
        &self,
        run: Run,
        scratch: &mut Self::Scratch,
        history: &mut [Row; CHANNELS],
        confidence: &mut Row,
        out: &mut Self::Out,
    );
}

/// A history that lies in images: colour, moments and length.
pub struct Images<'a> {
    /// Colour, moments and length.
    pub parts: [Pixels<'a>; 3],
    /// 1 channel, 0 to 1; 1 without.
    pub confidence: Option<View<'a>>,
}

impl History for Images<'_> {
    type Out = ();
    type Scratch = ();

    fn scratch(&self) {}

    #[inline(always)]
    fn read(
        &self,
        run: Run,
        (): &mut (),
        history: &mut [Row; CHANNELS],
        confidence: &mut Row,
        (): &mut (),
    ) {
        load_history(self.parts, run, history);
        if let Some(image) = self.confidence {
            load_shares(image, run, confidence);
        }
    }
}

/// Loads a run of a history's colour, moments and length.
#[inline(always)]
pub(crate) fn load_history(
    [color, moments, lengths]: [Pixels; 3],
    run: Run,
    into: &mut [Row; CHANNELS],
) {
    let [r, g, b, first, second, length] = into.each_mut().map(Row::as_mut_slice);
    color.read(run, [r, g, b]);
    moments.read(run, [first, second]);
    lengths.read(run, [length]);
}

/// New samples, and what is known of them.
pub struct Samples<'a, C> {
    /// The size of all images.
    pub size: Size,
    /// 3 channels.
    pub color: &'a C,
    /// How much of a sample each is; 1 without.
    pub weight: Option<View<'a>>,
    /// How much the light has changed; 0 without.
    pub gradient: Option<View<'a>>,
}

/// Some of a history's channels, and where they go.
pub type Part<'a> = (Range<usize>, PixelsMut<'a>);

/// Writes parts of the history with the new samples merged in. Returns the number of missing samples.
pub fn accumulate<'a, C: Colors, H: History<Out: 'a>, const PARTS: usize>(
    samples: Samples<C>,
    history: &H,
    params: Params,
    merged: impl Iterator<Item = [Part<'a>; PARTS]>,
    known: impl Iterator<Item = H::Out>,
) -> usize {
    let height = samples.size.height;
    let mut missing = vec![0; rows::bands(height).count()];
    let kernel = Accumulate::<C, H, PARTS> {
        samples,
        history,
        params,
    };
    let outs = (merged.zip(known).zip(&mut missing)).map(|((merged, known), missing)| Outs {
        merged,
        known,
        missing,
    });
    rows::run(&kernel, height, outs);
    missing.iter().sum()
}

struct Accumulate<'a, C, H, const PARTS: usize> {
    samples: Samples<'a, C>,
    history: &'a H,
    params: Params,
}

struct Outs<'a, O, const PARTS: usize> {
    merged: [Part<'a>; PARTS],
    known: O,
    missing: &'a mut usize,
}

impl<'a, C: Colors, H: History<Out: 'a>, const PARTS: usize> Kernel
    for Accumulate<'a, C, H, PARTS>
{
    type Out = Outs<'a, H::Out, PARTS>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: Self::Out) {
        let mut colors = [[0.0; SEGMENT]; 3];
        let mut history = [[0.0; SEGMENT]; CHANNELS];
        let [mut weights, mut confidences] = [[1.0; SEGMENT]; 2];
        let mut changes = [0.0; SEGMENT];
        let mut scratch = self.history.scratch();
        let Samples {
            size,
            color,
            weight,
            gradient,
        } = self.samples;
        for run in rows.flat_map(|y| segments(y, size.width)) {
            color.colors(run, &mut colors);
            if let Some(weight) = weight {
                load_shares(weight, run, &mut weights);
                for (red, &weight) in colors[0].iter_mut().zip(&weights) {
                    *red = if weight > 0.0 { *red } else { f32::NAN };
                }
            }
            *out.missing += count_missing(colors.each_ref().map(|row| &row[..run.len]));
            let (confidence, known) = (&mut confidences, &mut out.known);
            (self.history).read(run, &mut scratch, &mut history, confidence, known);
            if let Some(gradient) = gradient {
                load_shares(gradient, run, &mut changes);
            }
            let how = [&weights, &changes, &confidences];
            self.params.merge(&colors, how, &mut history);
            for (channels, part) in &mut out.merged {
                part.write(run, &history[channels.clone()]);
            }
        }
    }
}

/// Loads a run, clamped to [0, 1].
#[inline(always)]
pub(crate) fn load_shares(image: View, run: Run, shares: &mut Row) {
    let values = image.run(0, run);
    for (share, &value) in shares.iter_mut().zip(values) {
        *share = saturate(value);
    }
}

/// Counts the pixels of a row that have no finite sample.
#[inline(always)]
pub(crate) fn count_missing([r, g, b]: [&[f32]; 3]) -> usize {
    r.iter()
        .zip(g)
        .zip(b)
        .filter(|&((&r, &g), &b)| !is_present([r, g, b]))
        .count()
}

/// Shortens the lengths of a history where its light has changed.
#[inline(always)]
pub(crate) fn shorten(lengths: &mut Row, changes: &Row) {
    for (length, &change) in lengths.iter_mut().zip(changes) {
        *length *= tenth_power(1.0 - change);
    }
}

#[inline(always)]
fn tenth_power(x: f32) -> f32 {
    let square = x * x;
    let fourth = square * square;
    fourth * fourth * square
}

impl Params {
    /// Merges new colours into a history. `weights` say how much of a sample each colour is, above 0 to 1; `changes` are the
    /// temporal gradient and `confidences` the trust in the history, both 0 to 1.
    #[inline(always)]
    pub(crate) fn merge(
        self,
        colors: &[Row; 3],
        [weights, changes, confidences]: [&Row; 3],
        history: &mut [Row; CHANNELS],
    ) {
        let longest = 1.0 / self.alpha;
        let [cr, cg, cb] = colors;
        let [hr, hg, hb, h1, h2, hn] = history;
        for x in 0..SEGMENT {
            let c = [cr[x], cg[x], cb[x]];
            let h = [hr[x], hg[x], hb[x]];
            let present = is_present(c);
            let (weight, change) = (weights[x], changes[x]);
            let before = hn[x] * tenth_power(1.0 - change);
            let remembered = is_present(h)
                & h1[x].is_finite()
                & h2[x].is_finite()
                & before.is_finite()
                & (before > 0.0);
            let before = if remembered { before } else { 0.0 };
            let counted = smaller(before + weight, longest);
            let inverse = weight / counted;
            let (alpha, moments_alpha) = (weight * self.alpha, weight * self.moments_alpha);
            let (a, am) = if self.warmup {
                (inverse, larger(inverse, moments_alpha))
            } else {
                (alpha, moments_alpha)
            };
            let (a, am) = (a + change * (1.0 - a), am + change * (1.0 - am));
            let doubt = weight * (1.0 - confidences[x]);
            let (a, am) = (a + doubt * (1.0 - a), am + doubt * (1.0 - am));
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
            hr[x] = mixed(h[0], c[0], a);
            hg[x] = mixed(h[1], c[1], a);
            hb[x] = mixed(h[2], c[2], a);
            h1[x] = mixed(h1[x], l, am);
            h2[x] = mixed(h2[x], l * l, am);
            let length = if remembered { counted } else { weight };
            hn[x] = if present { length } else { before };
        }
    }
}
