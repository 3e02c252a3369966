//! Repetition: whether a frame has the noise of the frame before.
//!
//! A renderer that begins every frame with the same random numbers makes noise that sticks to the screen, while surfaces move
//! behind it; and a frame that is shown twice has no new noise at all. Whoever compares such frames takes their noise for
//! detail.
//!
//! With y the luminance of the new samples, p that of the frame before, brought along the motion, and
//! ρ = (y − p) / (|y| + |p|), the differences δ(x) = ρ(x) − ρ(x + 1) of neighbours in a row leave out slow changes of light;
//! detail that moves with its surface cancels in ρ. Of independent noise, two frames' δ share only that of the frame between
//! them, with opposite signs: their correlation is between 0 and −½. Noise that sticks to the screen correlates:
//!   C = Σ δ δ′ / max(√(Σ δ² Σ δ′²), n / 100),
//! δ′ those of the frame before, at the same pixels, n the number of pairs that both frames know. With deviations below a
//! tenth there is little noise, and C falls: what bilinear interpolation loses of a texture repeats as well. Where nothing
//! moves, ρ is 0 of noise that repeats, and
//!   S: the share of pairs with |y(x) − y(x + 1)| > (|y(x)| + |y(x + 1)|) / 10, of which y(x) is as it was, bit by bit
//! tells it. The repetition is the larger of the two, at least 0; of fewer than 256 pairs, it is 0. Every eighth row is looked
//! at. 39 sequences with independent noise have up to 0.16, 14 with one seed for all frames 0.39 and more.
//!
//! Inputs: luminances of the samples (1) and of the frame before (1), motion (2), ρ of the frame before (1; of every eighth
//! row). Outputs: a number from 0 to 1, and ρ.

use std::ops::Range;

use crate::image::{BandMut, Image, Pixels, SEGMENT, Size, View, segments};
use crate::kernels::fetch::footprint::Filter;
use crate::kernels::fetch::reproject::{self, Fetch};
use crate::kernels::fetch::validate::Tests;
use crate::math::luminance;
use crate::pixels::{Colors, MotionLanes};
use crate::rows::{self, Kernel, Simd};

/// From row to row that is looked at.
const STEP: usize = 8;
/// Fewer pairs of pixels tell nothing.
const FEWEST: usize = 256;
/// Smaller deviations, relative to the light, are no noise that matters.
const NOISE: f32 = 0.1;

/// The size of the ρ of a frame.
pub fn looked_at(size: Size) -> Size {
    Size {
        height: size.height.div_ceil(STEP),
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
    let bilinear = reproject::Params {
        filter: Filter::Bilinear,
        fallback: false,
        dering: true,
    };
    let kernel = Deviate {
        now,
        before: Fetch::new(&[before.into()], now.size, Tests::none(), bilinear),
        motion,
    };
    let size = looked_at(now.size);
    let mut found = Image::blank(size, 1);
    rows::run(&kernel, size.height, found.bands());
    let sticks = deviation.map_or(0.0, |deviation| correlate(found.view(), deviation));
    (sticks.max(share_of_same(now, before)), found)
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
        let (mut lanes, mut fetched) = (MotionLanes::zeroed(), self.before.room());
        for row in rows {
            let y = STEP * row;
            for run in segments(y, self.now.size.width) {
                let motion = lanes.load(&self.motion, run);
                self.before.run(run, motion, &mut fetched);
                let own = &self.now.row(0, y)[run.x..][..run.len];
                let out = &mut deviation.row(0, row)[run.x..][..run.len];
                let carried = &fetched.values(0)[..run.len];
                for i in 0..run.len {
                    let (now, then) = (own[i], carried[i]);
                    let deviation = (now - then) / (now.abs() + then.abs());
                    let known = fetched.coverage[i] > 0.0;
                    out[i] = if known { deviation } else { f32::NAN };
                }
            }
        }
    }
}

/// C.
fn correlate(now: View, before: View) -> f32 {
    let (mut pairs, mut products, mut squares) = (0, 0.0, [0.0; 2]);
    for (now, before) in now
        .plane(0)
        .chunks(now.size.width)
        .zip(before.plane(0).chunks(now.size.width))
    {
        for (now, before) in now.windows(2).zip(before.windows(2)) {
            let [now, before] = [now, before].map(|pair| f64::from(pair[0] - pair[1]));
            if now.is_finite() && before.is_finite() {
                pairs += 1;
                products += now * before;
                squares[0] += now * now;
                squares[1] += before * before;
            }
        }
    }
    let least = pairs as f64 * f64::from(NOISE * NOISE);
    match pairs {
        FEWEST.. => (products / (squares[0] * squares[1]).sqrt().max(least)) as f32,
        _ => 0.0,
    }
}

/// S.
fn share_of_same(now: View, before: View) -> f32 {
    let (mut pairs, mut same) = (0, 0);
    for y in (0..now.size.height).step_by(STEP) {
        for (now, before) in now.row(0, y).windows(2).zip(before.row(0, y)) {
            let (light, rough) = (now[0].abs() + now[1].abs(), (now[0] - now[1]).abs());
            if light.is_finite() {
                pairs += 1;
                same += usize::from(rough > NOISE * light && now[0] == *before);
            }
        }
    }
    match pairs {
        FEWEST.. => same as f32 / pairs as f32,
        _ => 0.0,
    }
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
