//! History fix: recently disoccluded pixels take the mean of their surface's surroundings.
//!
//! Where history is shorter than a few samples, 5×5 taps, far apart at first and closer as samples arrive, are averaged
//! with the weights of a guide (see [`super::guide`]) and the history length of each tap:
//!   c ← Σ w N c / Σ w N,  taps at multiples of max(1, ⌊stride/(1 + N) + ½⌋) pixels
//! (NRD's ReBLUR and ReLAX: stride 14, histories below 3). Taps with longer history than the pixel itself weigh more.
//!
//! Inputs: colour (3), length (1), guide. Output: colour (3). Pixels with enough history keep their bits; missing taps do
//! not count.

use std::ops::Range;

use super::guide::{Center, Comparison, Guide, Sigmas};
use crate::error::{Result, finite_from_0, in_range};
use crate::image::{BandMut, Image, View};
use crate::lanes::{LANES, Lanes, Tap};
use crate::math::exp2_weights;
use crate::rows::{self, Kernel, Simd};

/// Which pixels are fixed, and from how far.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// Histories shorter than this are fixed; ≥ 0; 3.
    pub max_length: f32,
    /// Distance between taps in pixels at history length 0; 1 to 64; 14.
    pub stride: f32,
    /// How far surfaces may differ.
    pub sigmas: Sigmas,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            max_length: 3.0,
            stride: 14.0,
            sigmas: Sigmas::default(),
        }
    }
}

impl Params {
    /// The halo that the taps need, in pixels.
    pub fn reach(&self) -> usize {
        2 * self.step(0.0)
    }

    /// Distance between taps in pixels, for this history length.
    fn step(&self, length: f32) -> usize {
        (self.stride / (1.0 + length.max(0.0)) + 0.5).max(1.0) as usize
    }

    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        finite_from_0("max_length", self.max_length)?;
        in_range("stride", self.stride, "1 to 64 pixels", |v| {
            (1.0..=64.0).contains(&v)
        })?;
        self.sigmas.check()
    }
}

/// Taps whose weights are computed together, because one exponential alone is a chain of dependent instructions.
const TOGETHER: usize = 4;

struct Fix<'a> {
    color: View<'a>,
    length: View<'a>,
    guide: &'a Guide,
    params: Params,
}

/// Returns the fixed colours; the guide is for taps up to [`Params::reach`].
pub fn fix_history(color: View, length: View, guide: &Guide, params: Params) -> Image {
    let mut fixed = Image::blank(color.size, 3);
    let kernel = Fix {
        color,
        length,
        guide,
        params,
    };
    rows::run(&kernel, color.size.height, fixed.bands());
    fixed
}

impl<'a> Kernel for Fix<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, simd: S, rows: Range<usize>, mut fixed: BandMut<'a>) {
        for y in rows {
            for channel in 0..3 {
                fixed
                    .row(channel, y)
                    .copy_from_slice(self.color.row(channel, y));
            }
            // Taps by step, created on demand.
            let mut taps = vec![None; self.params.step(0.0) + 1];
            let lengths = self.length.row(0, y).chunks(Lanes::<S>::COUNT);
            for (lengths, x) in lengths.zip((0..).step_by(Lanes::<S>::COUNT)) {
                let mut steps = [0; LANES];
                for (step, &length) in steps.iter_mut().zip(lengths) {
                    if length < self.params.max_length {
                        *step = self.params.step(length);
                    }
                }
                // Neighbours were mostly disoccluded together, so lanes with the same step are processed together.
                for lane in 0..lengths.len() {
                    let step = std::mem::take(&mut steps[lane]);
                    if step == 0 {
                        continue;
                    }
                    let mut chosen = [0.0; LANES];
                    chosen[lane] = 1.0;
                    for (chosen, other) in chosen.iter_mut().zip(&mut steps) {
                        if *other == step {
                            (*chosen, *other) = (1.0, 0);
                        }
                    }
                    let layout = &self.guide.layout;
                    let taps = taps[step].get_or_insert_with(|| layout.taps(y, 2, step));
                    let (weight, sum) = self.sums(simd, [x, y], step, taps);
                    let chosen = Lanes::load(simd, &chosen, 0).above(0.0);
                    let known = chosen.and(weight.above(0.0));
                    for (channel, sum) in sum.into_iter().enumerate() {
                        let row = fixed.row(channel, y);
                        let own = Lanes::load_around(simd, row, x as isize, 0.0);
                        (sum / weight).when_else(known, own).store(row, x);
                    }
                }
            }
        }
    }
}

impl Fix<'_> {
    /// Sums over the taps, `step` pixels apart, of the pixels from (x, y) on: weights, and colours times weights.
    #[inline(always)]
    fn sums<S: Simd>(
        &self,
        simd: S,
        [x, y]: [usize; 2],
        step: usize,
        taps: &[Tap],
    ) -> (Lanes<S>, [Lanes<S>; 3]) {
        let nothing = Lanes::splat(simd, 0.0);
        let mut sums = (nothing, [nothing; 3]);
        let guide = self.guide.compare(&self.params.sigmas, 2 * step);
        let center = guide.center(simd, x, y);
        let (several, rest) = taps.as_chunks::<TOGETHER>();
        for taps in several {
            self.add(simd, [x, y], (&guide, &center), taps, &mut sums);
        }
        for &tap in rest {
            self.add(simd, [x, y], (&guide, &center), &[tap], &mut sums);
        }
        sums
    }

    /// Adds `N` taps to the sums of the pixels from (x, y) on.
    #[inline(always)]
    fn add<S: Simd, const N: usize>(
        &self,
        simd: S,
        [x, y]: [usize; 2],
        (guide, center): (&Comparison, &Center<S>),
        taps: &[Tap; N],
        (weight, sum): &mut (Lanes<S>, [Lanes<S>; 3]),
    ) {
        let mut weights = [Lanes::splat(simd, 0.0); N];
        for k in 0..N {
            [weights[k]] = guide.exponents(simd, center, &taps[k], [0.0]);
        }
        let weights = exp2_weights(weights);
        for k in 0..N {
            let [dx, dy] = taps[k].offset;
            let (x, y) = (x as isize + dx, y.wrapping_add_signed(dy));
            let samples = Lanes::load_around(simd, self.length.row(0, y), x, f32::NAN);
            let mut known = samples.above(0.0);
            let mut color = [samples; 3];
            // A loop, because closures that take vectors are not always inlined.
            for c in 0..3 {
                color[c] = Lanes::load_around(simd, self.color.row(c, y), x, f32::NAN);
                known = known.and(color[c].is_finite());
            }
            let w = weights[k] * samples;
            *weight = *weight + w.when_or(known, 0.0);
            for c in 0..3 {
                sum[c] = sum[c] + (w * color[c]).when_or(known, 0.0);
            }
        }
    }
}
