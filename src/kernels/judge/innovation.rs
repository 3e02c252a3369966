//! Innovation: what a prediction gets wrong, estimated from new samples that it has not seen.
//!
//! New samples y are noisy but unbiased; a prediction p is steady but lags and blurs. The mean of y − p is the error of
//! p. It is measured relative to the light, so that dark and bright places count alike, and bounded:
//!   r = clamp((y − p) / (l + e/16), ±50), l = max(p, 0), e the exposure.
//! Where samples are sparse, a prediction made of few of them is noisy itself, and dividing by it biases r: r is large
//! where p is dark by chance, small where p contains a bright sample. There l is the mean of max(p, 0) over blocks of
//! 4×4 pixels, interpolated bilinearly between their centres.
//! **Evidence.** Blocks of 2×2 pixels hold the mean r̄ of r over their valid samples and its variance v: the mean of
//! |r|² (1 + 4/N²) divided by the number of samples. N is the length of history, at least 1; the second factor accounts
//! for a short history that consists of those very samples. Uncorrected evidence of earlier frames is reprojected along
//! the motion, from the nearest block:
//!   E ← (1 − w) r̄ + w E′,  V ← (1 − w)² v + w² V′,  w = (1 − β) · mean of clamp(N − 1, 0, 1),
//! with β = 0 for blocks without samples. With sparse samples, a block without any keeps its evidence (w = 1). One that
//! has none to keep (w = 0) is unknown: its V is NaN, and all means below leave it out. Persistent differences are so
//! believed sooner than flickering ones.
//! **Shrinkage.** Each coarser level averages E over 2×2 blocks, and V with the squares of the same weights. From
//! coarse to fine, with d the correction found by coarser levels:
//!   b = ⟨E − d⟩,  s = max(0, 1 − c ⟨V⟩² / |b|²),  d ← d + s b,
//! where ⟨·⟩ is a blur by {1, 2, 1}/4 ⊗ {1, 2, 1}/4 with borders replicated, ⟨·⟩² that of a variance, by the squares of
//! these weights, and d is upsampled bilinearly from level to level. s is James and Stein's shrinkage factor: 0 for a
//! mean no larger than chance makes it, nearly 1 for one many times that. The correction is d (max(p, 0) + e/16), with
//! the pixel's own p; if another image of the same light is corrected instead, with that image's value. If the
//! correction is fed back into the history from which the next prediction is made, the evidence passed on is the rest,
//! E − d at the finest level, with its V; otherwise it is E, because the next prediction will have the same error.
//!
//! A single bright sample among many has |b|² no larger than its own variance, in its frame and the following ones, and
//! is not believed (James and Stein 1961, *Estimation with Quadratic Loss*; shrinkage by scales as in Donoho and
//! Johnstone 1994, *Ideal Spatial Adaptation by Wavelet Shrinkage*; y − p is the innovation of Kalman 1960, *A New
//! Approach to Linear Filtering and Prediction Problems*). Limits: light that comes in samples more than 50 times
//! brighter than the mean is underestimated. Where motion magnifies, several blocks fetch the same evidence and V
//! counts it as independent: at a magnification of a tenth per frame, one in seven samples of 30 times the light is
//! wrongly believed for a frame. Blocks know no surfaces: sums over each id alone were tried, and lost where light moves
//! over several of them, which is where the correction is needed.
//!
//! Inputs: new samples (3), prediction (3), N (1), motion (2), evidence of the previous frame (4: E, V; half size).
//! Outputs: correction (3), evidence. A pixel whose sample or prediction is missing adds no evidence.

mod evidence;
mod shrinkage;

use std::ops::Range;
use std::sync::atomic::AtomicBool;

use self::evidence::{Gather, LocalLight, Pool};
use self::shrinkage::{Shrink, Subtract, upsample_columns, upsample_rows};
use crate::error::{Result, Whole, finite_from_0, in_range, whole};
use crate::image::{Image, Interleaved, Pixels, Run, SEGMENT, Size, View, segments};
use crate::math::{black_level, larger, smaller};
use crate::pixels::{Colors, PixelsMut, Row};
use crate::rows::{self, Kernel, Simd};

/// What counts as wrong, and over which blocks it is looked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// c: multiple of the variance below which a difference counts as noise; ≥ 0; 3.
    pub strictness: f32,
    /// β: weight of the new frame in the evidence; above 0, up to 1; 0.5.
    pub share: f32,
    /// Levels of the pyramid of blocks; the finest has 2×2 pixels; 1 to 8; 6.
    pub levels: u32,
    /// True if the history of the next prediction is corrected too, so that later samples no longer show the difference;
    /// true.
    pub fed_back: bool,
    /// True if few pixels are sampled: predictions are noisy, and most blocks wait for their next sample; false.
    pub sparse: bool,
}

impl Default for Params {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl Params {
    /// The defaults, for constants.
    pub const DEFAULT: Self = Self {
        strictness: 3.0,
        share: 0.5,
        levels: 6,
        fed_back: true,
        sparse: false,
    };

    pub(crate) fn levels(value: impl Whole<u32>) -> Result<u32> {
        whole("levels", value, "1 to 8", |n| (1..=8).contains(n))
    }

    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        Self::levels(self.levels)?;
        finite_from_0("strictness", self.strictness)?;
        in_range("share", self.share, "a share above 0, up to 1", |v| {
            v > 0.0 && v <= 1.0
        })
    }
}

/// Channels of evidence: E and its variance.
pub const CHANNELS: usize = 4;

/// Size of the evidence for images of this size.
pub fn evidence_size(size: Size) -> Size {
    Size {
        height: size.height.div_ceil(2),
        width: size.width.div_ceil(2),
    }
}

/// The correction of a prediction, at half resolution.
pub struct Innovation {
    /// d, for blocks of 2×2 pixels.
    found: Image,
    black: f32,
}

/// What new samples are compared with.
pub trait Prediction: Sync {
    /// Scratch for the rows of a band.
    type Line;

    /// Height and width.
    fn size(&self) -> Size;

    /// New scratch.
    fn line(&self) -> Self::Line;

    /// Writes a run's colours, and of how many samples they were made. Missing colours are not finite.
    fn read(&self, run: Run, line: &mut Self::Line, colors: &mut [Row; 3], lengths: &mut [f32]);
}

/// A prediction that needs no scratch.
#[derive(Clone, Copy)]
pub struct Predicted<'a, P> {
    /// The colours.
    pub colors: &'a P,
    /// Of how many samples they were made.
    pub lengths: Pixels<'a>,
}

impl<P: Colors> Prediction for Predicted<'_, P> {
    type Line = ();

    fn size(&self) -> Size {
        self.lengths.size
    }

    fn line(&self) {}

    #[inline(always)]
    fn read(&self, run: Run, _: &mut (), colors: &mut [Row; 3], lengths: &mut [f32]) {
        self.colors.colors(run, colors);
        self.lengths.load(run, 0, lengths);
    }
}

/// Evidence of earlier frames, and the motion that reprojects it.
#[derive(Clone, Copy)]
pub struct Known<'a> {
    /// Interleaved, [`CHANNELS`] channels, of [`evidence_size`].
    pub evidence: Pixels<'a>,
    /// Motion vectors in full-resolution pixels; `None` for no motion.
    pub motion: Option<Pixels<'a>>,
}

impl<'a> Known<'a> {
    /// What the frame before left, if anything.
    pub(crate) fn of(evidence: Option<&'a Interleaved>, motion: Pixels<'a>) -> Option<Self> {
        evidence.map(|evidence| Self {
            evidence: evidence.pixels(),
            motion: Some(motion),
        })
    }
}

/// Estimates the error of a prediction; returns the correction and the evidence for the next frame. Differences of samples
/// count by their weight only, 0 to 1, or not at all where it is NaN; without weights all count wholly.
pub fn innovation(
    fresh: &impl Colors,
    weight: Option<View>,
    prediction: &impl Prediction,
    known: Option<Known>,
    exposure: f32,
    params: Params,
) -> (Innovation, Interleaved) {
    let black = black_level(exposure);
    let size = evidence_size(prediction.size());
    let around = params.sparse.then(|| LocalLight::of(prediction));
    let gather = Gather {
        fresh,
        weight,
        prediction,
        around: around.as_ref(),
        known,
        black,
        share: params.share,
        gaps: AtomicBool::new(false),
    };
    let mut finest = Image::blank(size, CHANNELS);
    rows::run(&gather, size.height, finest.bands());
    let gaps = gather.gaps.into_inner();

    let mut coarser: Vec<Image> = vec![];
    for _ in 1..params.levels {
        let finer = coarser.last().unwrap_or(&finest).view();
        let mut blocks = Image::blank(evidence_size(finer.size), CHANNELS);
        let pool = Pool { finer, gaps };
        rows::run(&pool, blocks.size.height, blocks.bands());
        coarser.push(blocks);
    }
    let mut evidence = Interleaved::blank(size, CHANNELS);
    let mut found: Option<Image> = None;
    for level in (1..=params.levels).rev() {
        let blocks = match level {
            1 => &mut finest,
            _ => &mut coarser[level as usize - 2],
        };
        let mut deeper = Image::blank(blocks.size, 3);
        let height = blocks.size.height;
        let outs = blocks.bands().zip(deeper.bands());
        rows::run(&Subtract(found.as_ref().map(Image::view)), height, outs);
        let shrink = Shrink {
            blocks: blocks.view(),
            gaps,
            params,
        };
        let rest = (level == 1).then_some(evidence.data_mut());
        let rest = rest.map(|rest| PixelsMut::bands(size, CHANNELS, rest));
        let outs = deeper.bands().zip(rows::optional(rest));
        rows::run(&shrink, height, outs);
        found = Some(deeper);
    }
    let found = found.expect("at least one level");
    (Innovation { found, black }, evidence)
}

/// Scratch: d interpolated at the height of one row of pixels, with a halo of one block on each side.
pub(crate) struct Line([Vec<f32>; 3]);

impl Line {
    /// Of a run, with its halo.
    #[inline(always)]
    fn of(&self, run: Run) -> [&[f32]; 3] {
        let rows = self.0.each_ref();
        rows.map(|row| &row[run.x / 2..][..run.len.div_ceil(2) + 2])
    }
}

impl Innovation {
    pub(crate) fn line(&self) -> Line {
        Line([(); 3].map(|()| vec![0.0; self.found.size.width + 2]))
    }

    /// Interpolates d at the height of pixel row `y`.
    #[inline(always)]
    pub(crate) fn go_to(&self, y: usize, line: &mut Line) {
        for (channel, row) in line.0.iter_mut().enumerate() {
            upsample_rows(self.found.view(), channel, y, row);
        }
    }

    /// Whether the correction of a run of that row is other than zero.
    #[inline(always)]
    pub(crate) fn corrects(&self, line: &Line, run: Run) -> bool {
        let mut rows = line.of(run).into_iter();
        rows.any(|row| row.iter().any(|&d| d != 0.0))
    }

    /// The correction of a run of that row, scaled by the light of what is corrected.
    #[inline(always)]
    pub(crate) fn correction(&self, line: &Line, run: Run, predicted: &[Row; 3]) -> [Row; 3] {
        let rows = line.of(run);
        let mut result = [[0.0; SEGMENT]; 3];
        for ((result, row), predicted) in result.iter_mut().zip(rows).zip(predicted) {
            upsample_columns(row, &mut result[..run.len]);
            for (result, &p) in result.iter_mut().zip(predicted) {
                let light = if p.is_finite() { larger(p, 0.0) } else { 0.0 };
                *result *= light + self.black;
            }
        }
        result
    }

    /// Writes the correction of a whole image.
    pub fn corrections<'a>(
        &'a self,
        target: &'a impl Colors,
        size: Size,
        out: impl Iterator<Item = PixelsMut<'a>>,
    ) {
        let kernel = Corrections {
            innovation: self,
            target,
            width: size.width,
        };
        rows::run(&kernel, size.height, out);
    }
}

/// Adds a correction and clamps at 0, and at the largest number, as what is finite stays so; NaN stays NaN.
#[inline(always)]
pub(crate) fn corrected(light: f32, found: f32) -> f32 {
    let light = light + found;
    if light < 0.0 {
        0.0
    } else {
        smaller(f32::MAX, light)
    }
}

struct Corrections<'a, P> {
    innovation: &'a Innovation,
    target: &'a P,
    width: usize,
}

impl<'a, P: Colors> Kernel for Corrections<'a, P> {
    type Out = PixelsMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: PixelsMut<'a>) {
        let mut line = self.innovation.line();
        let mut predicted = [[0.0; SEGMENT]; 3];
        for y in rows {
            self.innovation.go_to(y, &mut line);
            for run in segments(y, self.width) {
                self.target.colors(run, &mut predicted);
                let found = if self.innovation.corrects(&line, run) {
                    self.innovation.correction(&line, run, &predicted)
                } else {
                    [[0.0; SEGMENT]; 3]
                };
                out.write(run, &found);
            }
        }
    }
}
