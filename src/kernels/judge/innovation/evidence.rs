//! Evidence: what samples show beside the prediction, by blocks of 2×2 pixels, and its means over larger blocks.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use super::{CHANNELS, Known, Prediction};
use crate::image::{BandMut, Image, Run, SEGMENT, Size, View, segments};
use crate::math::{is_present, larger, saturate, smaller};
use crate::pixels::{Colors, Row};
use crate::rows::{self, Kernel, Simd};

/// Bound of the relative difference r.
const BOUND: f32 = 50.0;
/// Noise grows by 1 + 4/N²: a prediction of N samples is correlated with the newest, which is one of them.
const CORRELATION: f32 = 4.0;

/// Writes E and V of every 2×2 block: the new samples' merged with reprojected evidence.
pub struct Gather<'a, F, P> {
    pub fresh: &'a F,
    /// By how much of its difference from the prediction each sample counts.
    pub weight: Option<View<'a>>,
    pub prediction: &'a P,
    /// The light l, if it is not the prediction itself.
    pub around: Option<&'a LocalLight>,
    pub known: Option<Known<'a>>,
    pub black: f32,
    pub share: f32,
    /// Output: whether there are unknown blocks.
    pub gaps: AtomicBool,
}

/// Line buffers for one row of pixels.
struct Line {
    fresh: [Row; 3],
    predicted: [Row; 3],
    /// The light l, if it is not the prediction itself.
    light: [Row; 3],
    length: Row,
    motion: [Row; 2],
}

/// Sums over two rows of pixels, column by column of a span.
struct Pairs {
    relative: [Row; 3],
    noise: Row,
    /// Number of valid samples.
    samples: Row,
    /// Sum of clamp(N − 1, 0, 1).
    trust: Row,
    motion: [Row; 2],
    /// Rows inside the image: 2, or 1 at an odd bottom border.
    pixels: f32,
}

impl<'a, F: Colors, P: Prediction> Kernel for Gather<'a, F, P> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: BandMut<'a>) {
        let Size { height, width } = self.prediction.size();
        let mut scratch = self.prediction.line();
        let mut lines = [(); 2].map(|()| Line::blank());
        let mut pairs = Pairs {
            relative: [[0.0; SEGMENT]; 3],
            noise: [0.0; SEGMENT],
            samples: [0.0; SEGMENT],
            trust: [0.0; SEGMENT],
            motion: [[0.0; SEGMENT]; 2],
            pixels: 0.0,
        };
        for y in rows {
            for run in segments(2 * y, width) {
                self.read(run, &mut scratch, &mut lines[0]);
                let below = run.y + 1 < height;
                if below {
                    let run = Run {
                        y: run.y + 1,
                        ..run
                    };
                    self.read(run, &mut scratch, &mut lines[1]);
                } else {
                    lines[1].clear(0);
                }
                pairs.pixels = if below { 2.0 } else { 1.0 };
                pairs.sum(&lines, self.around.is_some(), self.black);
                self.blocks(run, &pairs, out.rows(y));
            }
        }
    }
}

impl Line {
    fn blank() -> Self {
        Self {
            fresh: [[0.0; SEGMENT]; 3],
            predicted: [[0.0; SEGMENT]; 3],
            light: [[0.0; SEGMENT]; 3],
            length: [0.0; SEGMENT],
            motion: [[0.0; SEGMENT]; 2],
        }
    }

    /// Pixels from `start` on are beyond the image, and count as missing.
    #[inline(always)]
    fn clear(&mut self, start: usize) {
        self.fresh[0][start..].fill(f32::NAN);
        self.length[start..].fill(0.0);
        self.motion
            .iter_mut()
            .for_each(|row| row[start..].fill(0.0));
    }
}

impl<F: Colors, P: Prediction> Gather<'_, F, P> {
    #[inline(always)]
    fn read(&self, run: Run, scratch: &mut P::Line, line: &mut Line) {
        self.fresh.colors(run, &mut line.fresh);
        let lengths = &mut line.length[..run.len];
        (self.prediction).read(run, scratch, &mut line.predicted, lengths);
        if let Some(weight) = self.weight {
            let weight = weight.run(0, run);
            for (sample, predicted) in line.fresh.iter_mut().zip(&line.predicted) {
                for ((sample, predicted), weight) in sample.iter_mut().zip(predicted).zip(weight) {
                    *sample = predicted + weight * (*sample - predicted);
                }
            }
        }
        if let Some(from) = self.known.and_then(|known| known.motion) {
            from.read_rows(run, &mut line.motion);
        }
        if let Some(around) = self.around {
            around.read(run, &mut line.light);
        }
        line.clear(run.len);
    }

    /// Sums pairs of columns and merges the reprojected evidence.
    #[inline(always)]
    fn blocks(&self, run: Run, pairs: &Pairs, out: [&mut [f32]; CHANNELS]) {
        const BLOCKS: usize = SEGMENT / 2;
        let (left, y) = (run.x / 2, run.y / 2);
        let count = run.len.div_ceil(2).min(BLOCKS);
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
        let mut gaps = false;
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
            let unknown = (samples == 0.0) & (w == 0.0);
            variances[i] = if unknown { f32::NAN } else { variance };
            gaps |= variances[i].is_nan();
        }
        if gaps {
            self.gaps.store(true, Ordering::Relaxed);
        }
    }
}

impl Pairs {
    /// Sums the two rows of pixels under a row of blocks.
    #[inline(always)]
    fn sum(&mut self, [above, below]: &[Line; 2], apart: bool, black: f32) {
        let [rr, rg, rb] = &mut self.relative;
        let [mx, my] = &mut self.motion;
        for x in 0..SEGMENT {
            let a = above.difference(x, apart, black);
            let b = below.difference(x, apart, black);
            rr[x] = a.relative[0] + b.relative[0];
            rg[x] = a.relative[1] + b.relative[1];
            rb[x] = a.relative[2] + b.relative[2];
            self.noise[x] = a.noise + b.noise;
            self.samples[x] = a.samples + b.samples;
            self.trust[x] = a.trust + b.trust;
            mx[x] = above.motion[0][x] + below.motion[0][x];
            my[x] = above.motion[1][x] + below.motion[1][x];
        }
    }
}

/// What one pixel adds to its block.
struct Difference {
    relative: [f32; 3],
    noise: f32,
    samples: f32,
    trust: f32,
}

impl Line {
    #[inline(always)]
    fn difference(&self, x: usize, apart: bool, black: f32) -> Difference {
        let color = |[r, g, b]: &[Row; 3]| [r[x], g[x], b[x]];
        let ([yr, yg, yb], [pr, pg, pb]) = (color(&self.fresh), color(&self.predicted));
        let [lr, lg, lb] = color(if apart { &self.light } else { &self.predicted });
        let present = is_present([yr, yg, yb]) & is_present([pr, pg, pb]);
        let r = relative(yr - pr, lr, black);
        let g = relative(yg - pg, lg, black);
        let b = relative(yb - pb, lb, black);
        let few = larger(self.length[x], 1.0);
        let noise = (r * r + g * g + b * b) * (1.0 + CORRELATION / (few * few));
        // Added to 0, −0 becomes 0.
        let counts = |value: f32| 0.0 + if present { value } else { 0.0 };
        Difference {
            relative: [counts(r), counts(g), counts(b)],
            noise: counts(noise),
            samples: counts(1.0),
            trust: saturate(self.length[x] - 1.0),
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
pub struct LocalLight(Image);

impl LocalLight {
    pub fn of(light: &impl Prediction) -> Self {
        let size = light.size();
        let [height, width] = [size.height, size.width].map(|n| n.div_ceil(WIDE));
        let mut blocks = Image::blank(Size { height, width }, 3);
        rows::run(&Average(light), height, blocks.bands());
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
struct Average<'a, P>(&'a P);

impl<'a, P: Prediction> Kernel for Average<'a, P> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: BandMut<'a>) {
        let Size { height, width } = self.0.size();
        let mut scratch = self.0.line();
        let (mut light, mut lengths) = ([[0.0; SEGMENT]; 3], [0.0; SEGMENT]);
        let mut sums = [[0.0; SEGMENT]; 3];
        for block in rows {
            let lines = block * WIDE..(block * WIDE + WIDE).min(height);
            for run in segments(lines.start, width) {
                sums.iter_mut().for_each(|row| row.fill(0.0));
                for y in lines.clone() {
                    let (run, lengths) = (Run { y, ..run }, &mut lengths[..run.len]);
                    self.0.read(run, &mut scratch, &mut light, lengths);
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
pub struct Pool<'a> {
    pub finer: View<'a>,
    /// False if all blocks are known.
    pub gaps: bool,
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
            if self.gaps {
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
