//! Repetition: whether a frame has the noise of the frame before.
//!
//! A renderer that begins every frame with the same random numbers makes noise that sticks to the screen, while surfaces move
//! behind it; and a frame that is shown twice has no new noise at all. A comparison of such frames mistakes their noise for
//! detail.
//!
//! With y the luminance of the new samples, p that of the frame before, brought along the motion, and
//! ρ = (y − p) / (|y| + |p|), the differences δ(x) = ρ(x) − ρ(x + 1) of neighbours in a row leave out slow changes of light;
//! detail that moves with its surface cancels in ρ. Noise that sticks to the screen correlates by
//!   C = min(corr(δ, δ′), corr(δᵥ, δᵥ′)), δ′ those of the frame before at the same pixels, δᵥ(x) = ρ(x) − ρ(x↓).
//! Of independent noise, two frames' δ share only that of the frame between them. Mostly they do with opposite signs; but
//! where it has moved by a pixel along the row, one of two samples has the same sign in both, and they correlate by ¼. δᵥ,
//! with the pixel below, then share none.
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
use crate::math::{is_present, larger, luminance, smaller};
use crate::pixels::{Colors, MotionLanes};
use crate::rows::{self, Kernel, Simd};

/// Stride between the rows that are sampled.
const STEP: usize = 8;
/// Fewest pairs of pixels for an estimate.
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
                let own = self.now.run(0, run);
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
    let of = |[product, one, other]: [usize; 3]| {
        let correlation = Correlation {
            pairs,
            product: total(product),
            squares: [total(one), total(other)],
        };
        correlation.value()
    };
    let [along, down, below] = [[1, 2, 3], [4, 5, 6], [7, 2, 8]].map(of);
    match pairs {
        FEWEST.. => smaller(along, down) - larger(below, 0.0),
        _ => 0.0,
    }
}

/// The number of pairs, then the sums of δ δ′, δ², δ′², δᵥ δᵥ′, δᵥ², δᵥ′², δ δ↓ and δ↓².
const SUMS: usize = 9;

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
            let rows = [y, y + 1].map(|y| [&self.now, &self.before].map(|image| image.row(0, y)));
            // One partial sum per lane: a single sum would be one chain of dependent additions.
            let mut partial = [[0.0_f32; LANES]; SUMS];
            let last = rows[0][0].len().saturating_sub(1);
            for start in (0..last).step_by(LANES) {
                // Beyond the last pair nothing is known.
                let parts = rows.map(|row| {
                    row.map(|row| {
                        std::array::from_fn::<_, { LANES + 1 }, _>(|i| {
                            row.get(start + i).copied().unwrap_or(f32::NAN)
                        })
                    })
                });
                let [[own, lasting], [below, lasting_below]] = &parts;
                for i in 0..LANES {
                    let along = [own, lasting, below].map(|row| row[i] - row[i + 1]);
                    let down = [own[i] - below[i], lasting[i] - lasting_below[i]];
                    let known = is_present(along) & is_present([down[0], down[1], 0.0]);
                    let [own, lasting, below] = along.map(|v| if known { v } else { 0.0 });
                    let [down, lasting_down] = down.map(|v| if known { v } else { 0.0 });
                    partial[0][i] += f32::from(u8::from(known));
                    partial[1][i] += own * lasting;
                    partial[2][i] += own * own;
                    partial[3][i] += lasting * lasting;
                    partial[4][i] += down * lasting_down;
                    partial[5][i] += down * down;
                    partial[6][i] += lasting_down * lasting_down;
                    partial[7][i] += own * below;
                    partial[8][i] += below * below;
                }
            }
            for (channel, partial) in partial.iter().enumerate() {
                sums.row(channel, row)[0] = partial.iter().sum();
            }
        }
    }
}

/// S − W. If no pixel repeats, which needs no sums to see, 0: the difference would not be above it either.
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
