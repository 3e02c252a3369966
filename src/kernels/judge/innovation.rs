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
//! with β = 0 for blocks without samples. With sparse samples, a block without any keeps its evidence (w = 1); one that
//! has none to keep (w = 0) is unknown: its V is NaN, and all means below leave it out. Persistent differences are so
//! believed sooner than flickering ones.
//! **Shrinkage.** Each coarser level averages E over 2×2 blocks, and V with the squares of the same weights. From
//! coarse to fine, with d the correction found by coarser levels:
//!   b = ⟨E − d⟩,  s = max(0, 1 − c ⟨V⟩² / |b|²),  d ← d + s b,
//! where ⟨·⟩ is a blur by {1, 2, 1}/4 ⊗ {1, 2, 1}/4 with borders replicated, ⟨·⟩² that of a variance, by the squares of
//! these weights, and d is upsampled bilinearly from level to level. s is James and Stein's shrinkage factor: 0 for a
//! mean no larger than chance makes it, nearly 1 for one many times that. The correction is d (max(p, 0) + e/16), with
//! the pixel's own p. If the correction is fed back into the history from which the next prediction is made, the
//! evidence passed on is the rest, E − d at the finest level, with its V; otherwise it is E, because the next
//! prediction will have the same error.
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

use std::ops::Range;

use crate::error::{Result, Whole, finite_from_0, in_range, whole};
use crate::image::{BandMut, Image, Pixels, Records, Run, SEGMENT, Size, View, segments};
use crate::math::{is_present, larger, saturate, smaller};
use crate::pixels::{Colors, PixelsMut, Row};
use crate::rows::{self, Kernel, Simd};

/// What counts as wrong, and over which blocks it is looked for.
#[derive(Clone, Copy, Debug)]
pub struct Params {
    /// c: multiple of the variance below which a difference counts as noise; ≥ 0; 3.
    pub strictness: f32,
    /// β: weight of the new frame in the evidence; above 0, up to 1; 0.5.
    pub share: f32,
    /// Levels of the pyramid of blocks; the finest has 2×2 pixels; 1 to 8; 4.
    pub levels: u32,
    /// True if the history of the next prediction is corrected too, so that later samples no longer show the difference;
    /// true.
    pub fed_back: bool,
    /// True if few pixels are sampled: predictions are noisy, and blocks may be unknown; false.
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
        levels: 4,
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

/// Bound of the relative difference r.
const BOUND: f32 = 50.0;
/// Black level relative to the exposure.
const BLACK: f32 = 1.0 / 16.0;
/// Noise grows by 1 + 4/N²: a prediction of N samples is correlated with the newest, which is one of them.
const CORRELATION: f32 = 4.0;

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

/// Evidence of earlier frames, and the motion that reprojects it.
#[derive(Clone, Copy)]
pub struct Known<'a> {
    /// Interleaved, [`CHANNELS`] channels, of [`evidence_size`].
    pub evidence: Pixels<'a>,
    /// Motion vectors in full-resolution pixels; `None` for no motion.
    pub motion: Option<Pixels<'a>>,
}

/// The black level added to l in r: far below it, differences count as absolute instead of relative.
pub(crate) fn black(exposure: f32) -> f32 {
    (exposure * BLACK).max(f32::MIN_POSITIVE)
}

/// Estimates the error of a prediction; returns the correction and the evidence for the next frame.
pub fn innovation(
    fresh: &impl Colors,
    prediction: &impl Colors,
    length: Pixels,
    known: Option<Known>,
    exposure: f32,
    params: Params,
) -> (Innovation, Records) {
    let black = black(exposure);
    let size = evidence_size(length.size);
    let around = params
        .sparse
        .then(|| LocalLight::of(prediction, length.size));
    let gather = Gather {
        fresh,
        prediction,
        around: around.as_ref(),
        length,
        known,
        black,
        share: params.share,
    };
    let mut finest = Image::blank(size, CHANNELS);
    rows::run(&gather, size.height, finest.bands());

    let mut coarser: Vec<Image> = vec![];
    for _ in 1..params.levels {
        let finer = coarser.last().unwrap_or(&finest).view();
        let mut blocks = Image::blank(evidence_size(finer.size), CHANNELS);
        let pool = Pool {
            finer,
            sparse: params.sparse,
        };
        rows::run(&pool, blocks.size.height, blocks.bands());
        coarser.push(blocks);
    }
    let mut evidence = Records::blank(size, CHANNELS);
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

/// Writes E and V of every 2×2 block: the new samples' merged with reprojected evidence.
struct Gather<'a, F, P> {
    fresh: &'a F,
    prediction: &'a P,
    /// The light l, if it is not the prediction itself.
    around: Option<&'a LocalLight>,
    length: Pixels<'a>,
    known: Option<Known<'a>>,
    black: f32,
    share: f32,
}

/// Sums over two rows of pixels, column by column of a span.
struct Pairs {
    relative: [Row; 3],
    /// |r|² of the row added last.
    square: Row,
    noise: Row,
    /// Number of valid samples.
    samples: Row,
    /// Sum of clamp(N − 1, 0, 1).
    trust: Row,
    motion: [Row; 2],
    /// Rows inside the image: 2, or 1 at an odd bottom border.
    pixels: f32,
}

impl<'a, F: Colors, P: Colors> Kernel for Gather<'a, F, P> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: BandMut<'a>) {
        let mut pairs = Pairs {
            relative: [[0.0; SEGMENT]; 3],
            square: [0.0; SEGMENT],
            noise: [0.0; SEGMENT],
            samples: [0.0; SEGMENT],
            trust: [0.0; SEGMENT],
            motion: [[0.0; SEGMENT]; 2],
            pixels: 0.0,
        };
        for y in rows {
            for run in segments(2 * y, self.length.size.width) {
                self.pair(run, &mut pairs);
                self.blocks(run, &pairs, out.rows(y));
            }
        }
    }
}

impl<F: Colors, P: Colors> Gather<'_, F, P> {
    /// Sums the two rows of pixels under a row of blocks.
    #[inline(always)]
    fn pair(&self, run: Run, pairs: &mut Pairs) {
        let mut fresh = [[0.0; SEGMENT]; 3];
        let mut predicted = [[0.0; SEGMENT]; 3];
        let mut light = [[0.0; SEGMENT]; 3];
        let mut length = [0.0; SEGMENT];
        let mut motion = [[0.0; SEGMENT]; 2];
        let below = run.y + 1 < self.length.size.height;
        pairs.pixels = if below { 2.0 } else { 1.0 };
        for y in run.y..=run.y + usize::from(below) {
            let line = Run { y, ..run };
            self.fresh.colors(line, &mut fresh);
            self.prediction.colors(line, &mut predicted);
            self.length.load(line, 0, &mut length[..run.len]);
            if let Some(from) = self.known.and_then(|known| known.motion) {
                from.read(line, motion.each_mut().map(Row::as_mut_slice));
            }
            // Padding beyond the image's last pixel counts as missing.
            fresh[0][run.len..].fill(f32::NAN);
            length[run.len..].fill(0.0);
            motion.iter_mut().for_each(|row| row[run.len..].fill(0.0));
            if y == run.y {
                pairs.clear();
            }
            let light = match self.around {
                Some(around) => {
                    around.read(line, &mut light);
                    &light
                }
                None => &predicted,
            };
            pairs.add(&fresh, &predicted, light, self.black);
            for x in 0..SEGMENT {
                let few = larger(length[x], 1.0);
                pairs.noise[x] += pairs.square[x] * (1.0 + CORRELATION / (few * few));
                pairs.trust[x] += saturate(length[x] - 1.0);
                pairs.motion[0][x] += motion[0][x];
                pairs.motion[1][x] += motion[1][x];
            }
        }
    }

    /// Sums pairs of columns and merges the reprojected evidence.
    #[inline(always)]
    fn blocks(&self, run: Run, pairs: &Pairs, out: [&mut [f32]; CHANNELS]) {
        const BLOCKS: usize = SEGMENT / 2;
        let (left, y) = (run.x / 2, run.y / 2);
        let count = run.len.div_ceil(2);
        let mut trust = [0.0_f32; BLOCKS];
        let mut before = [[0.0_f32; CHANNELS]; BLOCKS];
        if let Some(known) = self.known {
            let Size { height, width } = known.evidence.size;
            let (bottom, side) = (height as f32, width as f32);
            let mut places = [0_u32; BLOCKS];
            for i in 0..BLOCKS {
                // The last block has one column where the width is odd.
                let columns = smaller((run.len as f32) - 2.0 * i as f32, 2.0);
                let pixels = larger(columns, 1.0) * pairs.pixels;
                let [dx, dy] = [sum(&pairs.motion[0], i), sum(&pairs.motion[1], i)];
                let tx = ((left + i) as f32 + dx / pixels * 0.5 + 0.5).floor();
                let ty = (y as f32 + dy / pixels * 0.5 + 0.5).floor();
                let inside = (tx >= 0.0) & (ty >= 0.0) & (tx < side) & (ty < bottom);
                let held = |at: f32| if inside { at as u32 } else { 0 };
                places[i] = held(ty) * width as u32 + held(tx);
                trust[i] = if inside {
                    sum(&pairs.trust, i) / pixels
                } else {
                    0.0
                };
            }
            let records = known.evidence.elements().0.as_chunks::<CHANNELS>().0;
            for i in 0..count {
                let record = records[places[i] as usize];
                let finite = record.iter().all(|v| v.is_finite());
                trust[i] = if finite { trust[i] } else { 0.0 };
                before[i] = if finite { record } else { [0.0; CHANNELS] };
            }
        }
        let [er, eg, eb, variances] = out.map(|row| &mut row[left..][..count]);
        for i in 0..count {
            let samples = sum(&pairs.samples, i);
            let per = 1.0 / larger(samples, 1.0);
            let [or, og, ob, old] = before[i];
            let some = if samples > 0.0 { self.share } else { 0.0 };
            // Sparse: most blocks have no sample in a frame and keep their evidence until they get one.
            let lasts = self.around.is_some() & (samples == 0.0) & (trust[i] > 0.0);
            let w = if lasts { 1.0 } else { (1.0 - some) * trust[i] };
            let new = 1.0 - w;
            er[i] = new * (sum(&pairs.relative[0], i) * per) + w * or;
            eg[i] = new * (sum(&pairs.relative[1], i) * per) + w * og;
            eb[i] = new * (sum(&pairs.relative[2], i) * per) + w * ob;
            let variance = new * new * (sum(&pairs.noise, i) * per * per) + w * w * old;
            let unknown = self.around.is_some() & (samples == 0.0) & (w == 0.0);
            variances[i] = if unknown { f32::NAN } else { variance };
        }
    }
}

impl Pairs {
    #[inline(always)]
    fn clear(&mut self) {
        let Self {
            relative,
            noise,
            samples,
            trust,
            motion,
            ..
        } = self;
        let others = [noise, samples, trust].into_iter().chain(motion);
        relative
            .iter_mut()
            .chain(others)
            .for_each(|row| row.fill(0.0));
    }

    /// Adds the differences of one row of pixels and overwrites `square` with theirs.
    #[inline(always)]
    fn add(
        &mut self,
        [yr, yg, yb]: &[Row; 3],
        [pr, pg, pb]: &[Row; 3],
        [lr, lg, lb]: &[Row; 3],
        black: f32,
    ) {
        let [rr, rg, rb] = &mut self.relative;
        let (samples, square) = (&mut self.samples, &mut self.square);
        for x in 0..SEGMENT {
            let present = is_present([yr[x], yg[x], yb[x]]) & is_present([pr[x], pg[x], pb[x]]);
            let r = relative(yr[x] - pr[x], lr[x], black);
            let g = relative(yg[x] - pg[x], lg[x], black);
            let b = relative(yb[x] - pb[x], lb[x], black);
            rr[x] += if present { r } else { 0.0 };
            rg[x] += if present { g } else { 0.0 };
            rb[x] += if present { b } else { 0.0 };
            samples[x] += if present { 1.0 } else { 0.0 };
            square[x] = if present { r * r + g * g + b * b } else { 0.0 };
        }
    }
}

/// r of one channel.
#[inline(always)]
fn relative(difference: f32, light: f32, black: f32) -> f32 {
    let r = difference / (larger(light, 0.0) + black);
    smaller(larger(r, -BOUND), BOUND)
}

/// Sum over a block's two columns.
#[inline(always)]
fn sum(row: &Row, block: usize) -> f32 {
    row[2 * block] + row[2 * block + 1]
}

/// Side of the blocks over which light is averaged for noisy predictions.
const WIDE: usize = 4;
/// Bilinear weight of the neighbouring block by the pixel's position in its own block: the previous block for the first
/// half, the next one for the second.
const NEXT: [f32; WIDE] = [0.375, 0.125, 0.125, 0.375];

/// Mean light of blocks of 4×4 pixels.
struct LocalLight(Image);

impl LocalLight {
    fn of(light: &impl Colors, size: Size) -> Self {
        let [height, width] = [size.height, size.width].map(|n| n.div_ceil(WIDE));
        let mut blocks = Image::blank(Size { height, width }, 3);
        rows::run(&Average { light, size }, height, blocks.bands());
        Self(blocks)
    }

    /// Light of a span, interpolated between block centres.
    #[inline(always)]
    fn read(&self, run: Run, light: &mut [Row; 3]) {
        const BLOCKS: usize = SEGMENT / WIDE;
        let Size { height, width } = self.0.size;
        let (y, first) = (run.y / WIDE, run.x / WIDE);
        let count = run.len.div_ceil(WIDE);
        let other = next_block(y, run.y % WIDE, height);
        let weight = NEXT[run.y % WIDE];
        // With a halo of one block on each side.
        let mut means = [0.0; BLOCKS + 2];
        for (channel, light) in light.iter_mut().enumerate() {
            let [own, other] = [y, other].map(|y| self.0.view().row(channel, y));
            for (i, mean) in means[..count + 2].iter_mut().enumerate() {
                let x = (first + i).saturating_sub(1).min(width - 1);
                *mean = own[x] * (1.0 - weight) + other[x] * weight;
            }
            let pixels = light.as_chunks_mut::<WIDE>().0;
            for (i, pixels) in pixels[..count].iter_mut().enumerate() {
                let [before, own, after] = [means[i], means[i + 1], means[i + 2]];
                for (x, light) in pixels.iter_mut().enumerate() {
                    let other = if x < WIDE / 2 { before } else { after };
                    *light = own * (1.0 - NEXT[x]) + other * NEXT[x];
                }
            }
        }
    }
}

#[inline(always)]
fn next_block(block: usize, place: usize, count: usize) -> usize {
    match place < WIDE / 2 {
        true => block.saturating_sub(1),
        false => (block + 1).min(count - 1),
    }
}

/// Averages light over blocks. Missing and negative values count as 0.
struct Average<'a, P> {
    light: &'a P,
    /// Full-resolution size.
    size: Size,
}

impl<'a, P: Colors> Kernel for Average<'a, P> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: BandMut<'a>) {
        let Size { height, width } = self.size;
        let mut light = [[0.0; SEGMENT]; 3];
        let mut sums = [[0.0; SEGMENT]; 3];
        for block in rows {
            let lines = block * WIDE..(block * WIDE + WIDE).min(height);
            for run in segments(lines.start, width) {
                sums.iter_mut().for_each(|row| row.fill(0.0));
                for y in lines.clone() {
                    self.light.colors(Run { y, ..run }, &mut light);
                    let [r, g, b] = &light;
                    let [sr, sg, sb] = &mut sums;
                    for x in 0..run.len {
                        let present = is_present([r[x], g[x], b[x]]);
                        sr[x] += if present { larger(r[x], 0.0) } else { 0.0 };
                        sg[x] += if present { larger(g[x], 0.0) } else { 0.0 };
                        sb[x] += if present { larger(b[x], 0.0) } else { 0.0 };
                    }
                }
                for (channel, sums) in sums.iter().enumerate() {
                    let out = &mut out.row(channel, block)[run.x / WIDE..];
                    for (out, sums) in out.iter_mut().zip(sums[..run.len].chunks(WIDE)) {
                        let sum = sums.iter().fold(0.0, |sum, value| sum + value);
                        *out = sum / (lines.len() * sums.len()) as f32;
                    }
                }
            }
        }
    }
}

/// One coarser level: means of 2×2 blocks and the variances of these means. A block cut by the border averages what it
/// has.
struct Pool<'a> {
    finer: View<'a>,
    /// True if blocks may be unknown.
    sparse: bool,
}

impl Pool<'_> {
    /// Averages the known blocks alone.
    #[inline(always)]
    fn pool_known(&self, y: usize, out: [&mut [f32]; CHANNELS]) {
        let Size { height, width } = self.finer.size;
        let rows = [2 * y, (2 * y + 1).min(height - 1)].map(|y| self.finer.rows::<CHANNELS>(y));
        let rows = &rows[..(height - 2 * y).min(2)];
        let [er, eg, eb, variances] = out;
        for x in 0..variances.len() {
            let (mut sums, mut count) = ([0.0; CHANNELS], 0.0);
            for row in rows {
                for x in 2 * x..(2 * x + 2).min(width) {
                    let known = !row[3][x].is_nan();
                    count += if known { 1.0 } else { 0.0 };
                    for (sum, row) in sums.iter_mut().zip(row) {
                        *sum += if known { row[x] } else { 0.0 };
                    }
                }
            }
            let per = 1.0 / larger(count, 1.0);
            (er[x], eg[x], eb[x]) = (sums[0] * per, sums[1] * per, sums[2] * per);
            variances[x] = if count > 0.0 {
                sums[3] * per * per
            } else {
                f32::NAN
            };
        }
    }
}

impl<'a> Kernel for Pool<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: BandMut<'a>) {
        let Size { height, width } = self.finer.size;
        for y in rows {
            if self.sparse {
                self.pool_known(y, out.rows(y));
                continue;
            }
            let cut = 2 * y + 1 == height;
            let below = if cut { 2 * y } else { 2 * y + 1 };
            for channel in 0..CHANNELS {
                // Factor for a sum of two values: ½ for means, ¼ for the variance of a mean. At a cut border both
                // values are the same row, so ½ restores it.
                let half = |cut: bool| if channel < 3 || cut { 0.5 } else { 0.25 };
                let (down, across) = (half(cut), half(false));
                let [above, below] = [2 * y, below].map(|y| self.finer.row(channel, y));
                let out = out.row(channel, y);
                let pairs = above
                    .as_chunks::<2>()
                    .0
                    .iter()
                    .zip(below.as_chunks::<2>().0);
                for (out, (above, below)) in out.iter_mut().zip(pairs) {
                    let left = (above[0] + below[0]) * down;
                    let right = (above[1] + below[1]) * down;
                    *out = (left + right) * across;
                }
                if width % 2 == 1 {
                    out[width / 2] = (above[width - 1] + below[width - 1]) * down;
                }
            }
        }
    }
}

/// Upsamples vertically: the coarse row interpolated at the height of fine row `y`, weights ¾ and ¼, with a halo of one
/// block on each side.
#[inline(always)]
fn upsample_rows(coarse: View, channel: usize, y: usize, into: &mut [f32]) {
    let Size { height, width } = coarse.size;
    let own = y / 2;
    let other = match y % 2 {
        0 => own.saturating_sub(1),
        _ => (own + 1).min(height - 1),
    };
    let [own, other] = [own, other].map(|y| coarse.row(channel, y));
    for ((into, &own), &other) in into[1..=width].iter_mut().zip(own).zip(other) {
        *into = 0.75 * own + 0.25 * other;
    }
    (into[0], into[width + 1]) = (into[1], into[width]);
}

/// Upsamples such a row horizontally, weights ¾ and ¼; `fine` begins at the start of a block.
#[inline(always)]
fn upsample_columns(row: &[f32], fine: &mut [f32]) {
    let (pairs, last) = fine.as_chunks_mut::<2>();
    let blocks = pairs.len();
    let (left, own, right) = (&row[..blocks], &row[1..][..blocks], &row[2..][..blocks]);
    for (i, pair) in pairs.iter_mut().enumerate() {
        let nearer = 0.75 * own[i];
        *pair = [nearer + 0.25 * left[i], nearer + 0.25 * right[i]];
    }
    if let [last] = last {
        *last = 0.75 * row[blocks + 1] + 0.25 * row[blocks];
    }
}

/// Upsamples the coarser levels' d, writes it, and subtracts it from E. Unknown blocks stay unknown.
struct Subtract<'a>(Option<View<'a>>);

impl<'a> Kernel for Subtract<'a> {
    type Out = (BandMut<'a>, BandMut<'a>);

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, (mut blocks, mut found): Self::Out) {
        let mut row = self
            .0
            .map_or(vec![], |coarse| vec![0.0; coarse.size.width + 2]);
        for y in rows {
            let [r, g, b, variances] = blocks.rows(y);
            for (channel, rest) in [r, g, b].into_iter().enumerate() {
                let found = found.row(channel, y);
                let Some(coarse) = self.0 else {
                    found.fill(0.0);
                    continue;
                };
                upsample_rows(coarse, channel, y, &mut row);
                upsample_columns(&row, found);
                for ((rest, found), variance) in rest.iter_mut().zip(found).zip(&*variances) {
                    *rest -= if variance.is_nan() { 0.0 } else { *found };
                }
            }
        }
    }
}

/// Adds this level's shrunk means s b to d. At the finest level, also writes the evidence for the next frame.
struct Shrink<'a> {
    /// E − d and V.
    blocks: View<'a>,
    params: Params,
}

impl<'a> Kernel for Shrink<'a> {
    type Out = (BandMut<'a>, Option<PixelsMut<'a>>);

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, (mut found, mut rest): Self::Out) {
        let mut blurred = Blurred::new(self.blocks.size.width);
        for y in rows {
            self.add_rows(y, &mut blurred);
            blurred.add_columns(self.params.sparse);
            blurred.shrink(self.params.strictness);
            let mut found = found.rows::<3>(y);
            for (found, steps) in found.iter_mut().zip(&blurred.steps) {
                for (found, step) in found.iter_mut().zip(steps) {
                    *found += step;
                }
            }
            if let Some(rest) = &mut rest {
                self.leave(y, &found, &mut blurred.steps, rest);
            }
        }
    }
}

/// Scratch: blocks of a row, blurred by the binomial 3×3 window.
struct Blurred {
    /// Sums over the window's rows: of means, of variances, and of the weights of known blocks, 4 in a full column. All have a
    /// halo of one block on each side.
    sums: [Vec<f32>; 3],
    variances: Vec<f32>,
    weights: Vec<f32>,
    /// Over the whole window.
    variance: Vec<f32>,
    /// 16 in a full window.
    weight: Vec<f32>,
    /// What is kept of the means.
    steps: [Vec<f32>; 3],
}

impl Blurred {
    fn new(width: usize) -> Self {
        let [wide, own] = [width + 2, width].map(|width| vec![0.0; width]);
        Self {
            sums: [(); 3].map(|()| wide.clone()),
            variances: wide,
            weights: vec![4.0; width + 2],
            variance: own.clone(),
            weight: vec![16.0; width],
            steps: [(); 3].map(|()| own.clone()),
        }
    }

    /// Sums variances and weights over the window's columns.
    #[inline(always)]
    fn add_columns(&mut self, sparse: bool) {
        let (variances, weights) = (&self.variances, &self.weights);
        let width = self.variance.len();
        if sparse {
            for (x, weight) in self.weight.iter_mut().enumerate() {
                let sum = (weights[x] + weights[x + 2]) + (weights[x + 1] + weights[x + 1]);
                *weight = larger(sum, 1.0);
            }
        }
        for (x, variance) in self.variance.iter_mut().enumerate() {
            *variance = (variances[x] + variances[x + 2]) + 4.0 * variances[x + 1];
        }
        for x in [0, width - 1] {
            let [before, here, after] = squared_weights(x, width);
            self.variance[x] =
                (before * variances[x] + after * variances[x + 2]) + here * variances[x + 1];
        }
    }

    /// Keeps as much of the blurred means as is more than chance.
    #[inline(always)]
    fn shrink(&mut self, strictness: f32) {
        let width = self.variance.len();
        let [sr, sg, sb] = self.sums.each_ref().map(Vec::as_slice);
        let [r, g, b] = self.steps.each_mut().map(|row| &mut row[..width]);
        let blur = |sums: &[f32], x: usize, per: f32| {
            ((sums[x] + sums[x + 2]) + (sums[x + 1] + sums[x + 1])) * per
        };
        for x in 0..width {
            let per = 1.0 / self.weight[x];
            let [br, bg, bb] = [blur(sr, x, per), blur(sg, x, per), blur(sb, x, per)];
            let square = br * br + bg * bg + bb * bb;
            let chance = strictness * (self.variance[x] * (per * per));
            let kept = larger(1.0 - chance / larger(square, 1e-12), 0.0);
            (r[x], g[x], b[x]) = (kept * br, kept * bg, kept * bb);
        }
    }
}

impl Shrink<'_> {
    /// Sums means, variances and weights over the window's rows.
    #[inline(always)]
    fn add_rows(&self, y: usize, blurred: &mut Blurred) {
        let Size { height, width } = self.blocks.size;
        let lines = [y.saturating_sub(1), y, (y + 1).min(height - 1)];
        for (channel, sums) in blurred.sums.iter_mut().enumerate() {
            let [above, own, below] = lines.map(|y| self.blocks.row(channel, y));
            let inner = &mut sums[1..=width];
            for x in 0..width {
                inner[x] = (above[x] + below[x]) + (own[x] + own[x]);
            }
            (sums[0], sums[width + 1]) = (sums[1], sums[width]);
        }
        let [above, own, below] = lines.map(|y| self.blocks.row(3, y));
        let [before, here, after] = squared_weights(y, height);
        for (x, inner) in blurred.variances[1..=width].iter_mut().enumerate() {
            let [above, own, below] = [above[x], own[x], below[x]].map(or_zero);
            *inner = (before * above + after * below) + here * own;
        }
        if self.params.sparse {
            let weights = &mut blurred.weights;
            for (x, inner) in weights[1..=width].iter_mut().enumerate() {
                let [above, own, below] = [above[x], own[x], below[x]].map(known);
                *inner = (above + below) + (own + own);
            }
            (weights[0], weights[width + 1]) = (weights[1], weights[width]);
        }
    }

    /// Writes the evidence that the next frame takes: of what is fed back, what is left of it. Takes the steps as scratch.
    #[inline(always)]
    fn leave(
        &self,
        y: usize,
        found: &[&mut [f32]],
        steps: &mut [Vec<f32>; 3],
        rest: &mut PixelsMut,
    ) {
        let rows = self.blocks.rows::<CHANNELS>(y);
        for ((step, own), found) in steps.iter_mut().zip(rows).zip(found) {
            let pixels = step.iter_mut().zip(own).zip(found.iter()).zip(rows[3]);
            for (((step, own), found), &variance) in pixels {
                let left = own - *step;
                let left = if self.params.fed_back {
                    left
                } else {
                    left + found
                };
                *step = if variance.is_nan() { 0.0 } else { left };
            }
        }
        for run in segments(y, self.blocks.size.width) {
            let [r, g, b] = steps.each_ref().map(|row| &row[run.x..][..run.len]);
            rest.write(run, [r, g, b, &rows[3][run.x..][..run.len]]);
        }
    }
}

/// The variance; 0 for unknown blocks.
#[inline(always)]
fn or_zero(variance: f32) -> f32 {
    if variance.is_nan() { 0.0 } else { variance }
}

/// 1 for known blocks, 0 for unknown ones.
#[inline(always)]
fn known(variance: f32) -> f32 {
    if variance.is_nan() { 0.0 } else { 1.0 }
}

/// Squares of the weights {1, 2, 1} along an axis. At a border, the replicated block's weights are added before
/// squaring.
#[inline(always)]
fn squared_weights(place: usize, count: usize) -> [f32; 3] {
    let (first, last) = (place == 0, place + 1 == count);
    match (first, last) {
        (false, false) => [1.0, 4.0, 1.0],
        (true, false) => [0.0, 9.0, 1.0],
        (false, true) => [1.0, 9.0, 0.0],
        (true, true) => [0.0, 16.0, 0.0],
    }
}

/// Scratch: d interpolated at the height of one row of pixels, with a halo of one block on each side.
pub(crate) struct Line([Vec<f32>; 3]);

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

    /// The correction of a span of that row, scaled by the predicted light; `None` if it is zero throughout.
    #[inline(always)]
    pub(crate) fn correction(
        &self,
        line: &Line,
        run: Run,
        predicted: &[Row; 3],
    ) -> Option<[Row; 3]> {
        let rows = line.0.each_ref();
        let rows = rows.map(|row| &row[run.x / 2..][..run.len.div_ceil(2) + 2]);
        if rows.iter().all(|row| row.iter().all(|&d| d == 0.0)) {
            return None;
        }
        let mut result = [[0.0; SEGMENT]; 3];
        for ((result, row), predicted) in result.iter_mut().zip(rows).zip(predicted) {
            upsample_columns(row, &mut result[..run.len]);
            for (result, &p) in result.iter_mut().zip(predicted) {
                let light = if p.is_finite() { larger(p, 0.0) } else { 0.0 };
                *result *= light + self.black;
            }
        }
        Some(result)
    }

    /// Writes the correction of a whole image.
    pub fn corrections<'a>(
        &'a self,
        prediction: &'a impl Colors,
        size: Size,
        out: impl Iterator<Item = PixelsMut<'a>>,
    ) {
        let kernel = Corrections {
            innovation: self,
            prediction,
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
    prediction: &'a P,
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
                self.prediction.colors(run, &mut predicted);
                let found = self.innovation.correction(&line, run, &predicted);
                let found = found.unwrap_or([[0.0; SEGMENT]; 3]);
                out.write(run, found.each_ref().map(Row::as_slice));
            }
        }
    }
}
