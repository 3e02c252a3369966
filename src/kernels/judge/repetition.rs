//! Repetition: whether a frame has the noise of the frame before.
//!
//! A renderer that begins every frame with the same random numbers makes noise that sticks to the screen, while surfaces move
//! behind it; and a frame that is shown twice has no new noise at all. A comparison of such frames mistakes their noise for
//! detail.
//!
//! With y the luminance of the new samples, p that of the frame before, brought along the motion, and
//! ρ = (y − p) / (|y| + |p|), the differences δ(x) = ρ(x) − ρ(x + 1) of neighbours in a row leave out slow changes of light;
//! detail that moves with its surface cancels in ρ. Of independent noise, two frames' δ share only that of the frame between
//! them, with opposite signs: their correlation is between 0 and −½. Noise that sticks to the screen correlates by
//!   C = corr(δ, δ′), δ′ those of the frame before at the same pixels.
//! Where nothing moves, ρ of noise that repeats is 0, and
//!   S: the share of pairs of which y(x) is as it was, bit by bit, and |ε(x)| above ⅒, ε(x) = (y(x) − y(x + 1)) / (|y(x)| +
//!   |y(x + 1)|),
//! tells it. Images without noise repeat as well: what bilinear interpolation loses of a texture, what mirrors show along
//! other motion, and all of a scene at rest. But their rows resemble one another, as those of noise do not. The repetition is
//!   max(0, C − V, S − W), V = corr(δ, δ↓), W = corr(ε, ε↓), at least 0 each, ↓ that of the row below.
//! With sums over n pairs that are known in all that is compared, corr(a, b) = Σ a b / max(√(Σ a² Σ b²), n / 100): deviations
//! below a tenth are no noise that matters. Of fewer than 256 pairs, the repetition is 0. Every eighth row is looked at, and
//! the one below. Of light, which has no texture, seven sequences with independent noise have at most 0.09, and 0.52 and more
//! with one seed for all frames (`python -m yester.study.compare.repeated`).
//!
//! Inputs: luminances of the samples (1) and of the frame before (1), motion (2), ρ of the frame before (1; two of every eight
//! rows). Outputs: a number from 0 to 1, and ρ.

use std::ops::Range;

use crate::image::{BandMut, Image, Pixels, SEGMENT, Size, View, segments};
use crate::kernels::fetch::footprint::Filter;
use crate::kernels::fetch::reproject::{self, Fetch};
use crate::kernels::fetch::validate::Tests;
use crate::lanes::LANES;
use crate::math::{is_present, larger, luminance};
use crate::pixels::{Colors, MotionLanes};
use crate::rows::{self, Kernel, Simd};

/// From one row that is looked at to the next.
const STEP: usize = 8;
/// Fewer pairs of pixels tell nothing.
const FEWEST: usize = 256;
/// Smaller deviations, relative to the light, are no noise that matters.
const NOISE: f32 = 0.1;

/// The size of the ρ of a frame: of every pair of its rows, the lower one is the row below.
pub fn looked_at(size: Size) -> Size {
    Size {
        height: 2 * size.height.div_ceil(STEP),
        ..size
    }
}

/// The repetition, and ρ for the next frame.
pub fn repetition(
    now: View,
    before: View,
    motion: Pixels,
    deviation: Option<View>,
) -> (f32, Image) {
    let bilinear = reproject::Params::of(Filter::Bilinear);
    let kernel = Deviate {
        now,
        before: Fetch::new(&[before.into()], now.size, Tests::none(), bilinear),
        motion,
    };
    let size = looked_at(now.size);
    let mut found = Image::blank(size, 1);
    rows::run(&kernel, size.height, found.bands());
    let sticks = deviation.map_or(0.0, |deviation| sticking(found.view(), deviation));
    (larger(larger(sticks, standing(now, before)), 0.0), found)
}

struct Deviate<'a> {
    now: View<'a>,
    before: Fetch<'a>,
    motion: Pixels<'a>,
}

impl<'a> Kernel for Deviate<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut deviation: BandMut<'a>) {
        let (mut lanes, mut fetched) = (MotionLanes::zeroed(), self.before.scratch());
        for row in rows {
            let y = row / 2 * STEP + row % 2;
            if y >= self.now.size.height {
                deviation.row(0, row).fill(f32::NAN);
                continue;
            }
            for run in segments(y, self.now.size.width) {
                let motion = lanes.load(&self.motion, run);
                self.before.run(run, motion, &mut fetched);
                let own = &self.now.row(0, y)[run.x..][..run.len];
                let out = &mut deviation.row(0, row)[run.x..][..run.len];
                let carried = &fetched.values(0)[..run.len];
                for i in 0..run.len {
                    let (now, then) = (own[i], carried[i]);
                    let known = fetched.coverage[i] > 0.0;
                    out[i] = if known {
                        difference(now, then)
                    } else {
                        f32::NAN
                    };
                }
            }
        }
    }
}

/// Sums for the correlation of two quantities.
#[derive(Default)]
struct Correlation {
    pairs: usize,
    product: f64,
    squares: [f64; 2],
}

impl Correlation {
    fn add(&mut self, one: f32, other: f32) {
        let [one, other] = [one, other].map(f64::from);
        self.pairs += 1;
        self.product += one * other;
        self.squares[0] += one * one;
        self.squares[1] += other * other;
    }

    fn value(&self) -> f32 {
        let least = self.pairs as f64 * f64::from(NOISE * NOISE);
        let [one, other] = self.squares;
        (self.product / (one * other).sqrt().max(least)) as f32
    }
}

/// C − V.
fn sticking(now: View, before: View) -> f32 {
    let height = now.size.height / 2;
    let mut sums = Image::new(Size { height, width: 1 }, SUMS);
    rows::run(&Products { now, before }, height, sums.bands());
    let total = |channel: usize| -> f64 {
        let rows = sums.plane(channel).iter();
        rows.map(|&sum| f64::from(sum)).sum()
    };
    let pairs = total(0) as usize;
    let [lasting, below] = [[1, 3], [2, 4]].map(|[product, square]| Correlation {
        pairs,
        product: total(product),
        squares: [total(5), total(square)],
    });
    match pairs {
        FEWEST.. => lasting.value() - larger(below.value(), 0.0),
        _ => 0.0,
    }
}

/// The number of pairs, then the sums of δ δ′, δ δ↓, δ′², δ↓² and δ².
const SUMS: usize = 6;

/// Writes [`SUMS`] for each row that is looked at, with the one below.
struct Products<'a> {
    now: View<'a>,
    before: View<'a>,
}

impl<'a> Kernel for Products<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut sums: BandMut<'a>) {
        for row in rows {
            let y = 2 * row;
            let rows = [
                self.now.row(0, y),
                self.before.row(0, y),
                self.now.row(0, y + 1),
            ];
            // One partial sum per lane: a single sum would be one chain of dependent additions.
            let mut partial = [[0.0_f32; LANES]; SUMS];
            let last = rows[0].len().saturating_sub(1);
            for start in (0..last).step_by(LANES) {
                // Beyond the last pair nothing is known.
                let [own, lasting, below] = rows.map(|row| match row.get(start..=start + LANES) {
                    Some(row) => std::array::from_fn(|i| row[i] - row[i + 1]),
                    None => std::array::from_fn::<_, LANES, _>(|i| match row.get(start + i + 1) {
                        Some(next) => row[start + i] - next,
                        None => f32::NAN,
                    }),
                });
                for i in 0..LANES {
                    let known = is_present([own[i], lasting[i], below[i]]);
                    let [own, lasting, below] =
                        [own[i], lasting[i], below[i]].map(|v| if known { v } else { 0.0 });
                    partial[0][i] += f32::from(u8::from(known));
                    partial[1][i] += own * lasting;
                    partial[2][i] += own * below;
                    partial[3][i] += lasting * lasting;
                    partial[4][i] += below * below;
                    partial[5][i] += own * own;
                }
            }
            for (channel, partial) in partial.iter().enumerate() {
                sums.row(channel, row)[0] = partial.iter().sum();
            }
        }
    }
}

/// S − W, or 0 if nothing is as it was: then it is not above 0.
fn standing(now: View, before: View) -> f32 {
    let mut looked_at = (0..now.size.height).step_by(STEP);
    let repeats = |y| {
        now.row(0, y)
            .iter()
            .zip(before.row(0, y))
            .any(|(now, before)| now == before)
    };
    if !looked_at.any(repeats) {
        return 0.0;
    }
    let (mut same, mut below) = (0, Correlation::default());
    for y in (0..now.size.height.saturating_sub(1)).step_by(STEP) {
        let [own, last, next] = [now.row(0, y), before.row(0, y), now.row(0, y + 1)];
        for x in 1..now.size.width {
            let [here, next] = [own, next].map(|row| difference(row[x - 1], row[x]));
            if here.is_finite() && next.is_finite() {
                same += usize::from(here.abs() > NOISE && own[x - 1] == last[x - 1]);
                below.add(here, next);
            }
        }
    }
    match below.pairs {
        FEWEST.. => same as f32 / below.pairs as f32 - larger(below.value(), 0.0),
        _ => 0.0,
    }
}

/// Of two lights, relative to them.
fn difference(one: f32, other: f32) -> f32 {
    (one - other) / (one.abs() + other.abs())
}

/// The luminance of an image.
pub fn luminances(color: Pixels) -> Image {
    let mut image = Image::blank(color.size, 1);
    rows::run(&Luminances { color }, color.size.height, image.bands());
    image
}

struct Luminances<'a> {
    color: Pixels<'a>,
}

impl<'a> Kernel for Luminances<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut luminances: BandMut<'a>) {
        let mut colors = [[0.0; SEGMENT]; 3];
        for y in rows {
            let row = luminances.row(0, y);
            for run in segments(y, row.len()) {
                self.color.colors(run, &mut colors);
                for (i, value) in row[run.x..][..run.len].iter_mut().enumerate() {
                    *value = luminance(colors[0][i], colors[1][i], colors[2][i]);
                }
            }
        }
    }
}
