//! How much better one history predicts the new sample than another, judged without a reference.
//!
//! A new sample c is an unbiased look at the truth which no history has seen. Of two predictions k and h,
//!   (k − c)² − (h − c)² = (k − h)(k + h − 2c)
//! is, on average over c's noise, the difference of their true squared errors: it is linear in c, so that noise cancels
//! where a tone curve or a clamp would leave a bias. Relative to brightness and averaged over a neighbourhood of the same
//! object,
//!   d = mean of Σ (k − h)(k + h − 2c) / (Σ h² + 0.01),  sums over the channels:
//! negative where k is better.
//!
//! Inputs: k (3), h (3), c (3), ids (1), optional. Output: d (1); 0 where nothing is known.

use std::ops::Range;

use crate::image::{BandMut, Image, Run, Tap, Tiles, View};
use crate::rows::{self, Kernel};

/// The offset of relMSE, by which dark pixels do not count beyond measure.
const EPSILON: f32 = 0.01;

/// Where `tiles` are given, the gain means something in those alone that are on.
pub fn prediction_gain(
    candidate: View,
    base: View,
    color: View,
    ids: Option<View<u32>>,
    radius: usize,
    tiles: Option<&Tiles>,
) -> Image {
    let size = color.size;
    let mut terms = Image::new(size, 2);
    let kernel = Terms {
        candidate,
        base,
        color,
    };
    rows::run(&kernel, size.height, terms.bands());
    // Without ids the window is separable.
    let axes: &[[isize; 2]] = match ids {
        None => &[[1, 0], [0, 1]],
        Some(_) => &[[1, 1]],
    };
    let mut sums = Image::new(size, 2);
    for &axes in axes {
        let kernel = Window {
            terms: &terms,
            ids,
            radius,
            axes,
            tiles,
        };
        rows::run(&kernel, size.height, sums.bands());
        std::mem::swap(&mut terms, &mut sums);
    }
    let mut gain = Image::new(size, 1);
    rows::run(&Mean { sums: &terms }, size.height, gain.bands());
    gain
}

/// The term of each pixel, and whether it counts; both 0 where something is missing.
struct Terms<'a> {
    candidate: View<'a>,
    base: View<'a>,
    color: View<'a>,
}

impl<'a> Kernel for Terms<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: BandMut<'a>) {
        for y in rows {
            let k: [_; 3] = self.candidate.rows(y);
            let h: [_; 3] = self.base.rows(y);
            let c: [_; 3] = self.color.rows(y);
            let [terms, counts] = out.rows(y);
            for x in 0..terms.len() {
                let (mut term, mut size) = (0.0, EPSILON);
                for channel in 0..3 {
                    let (k, h, c) = (k[channel][x], h[channel][x], c[channel][x]);
                    term += (k - h) * (k + h - 2.0 * c);
                    size += h * h;
                }
                let term = term / size;
                let known = term.is_finite();
                terms[x] = if known { term } else { 0.0 };
                counts[x] = if known { 1.0 } else { 0.0 };
            }
        }
    }
}

struct Window<'a> {
    terms: &'a Image,
    ids: Option<View<'a, u32>>,
    radius: usize,
    /// 1 where the window reaches along x and y, 0 where it does not.
    axes: [isize; 2],
    tiles: Option<&'a Tiles>,
}

impl<'a> Kernel for Window<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: BandMut<'a>) {
        let size = self.terms.size;
        let [wide, high] = self.axes.map(|axis| axis * self.radius as isize);
        for y in rows {
            let [sums, counts] = out.rows(y);
            sums.fill(0.0);
            counts.fill(0.0);
            let row = Run {
                y,
                x: 0,
                len: size.width,
            };
            match self.tiles {
                None => self.add(row, [wide, high], sums, counts),
                // The sums along x, which come first, are asked for by the rows around as well.
                Some(tiles) => tiles
                    .runs(row, self.radius)
                    .for_each(|run| self.add(run, [wide, high], sums, counts)),
            }
        }
    }
}

impl Window<'_> {
    #[inline(always)]
    fn add(&self, run: Run, [wide, high]: [isize; 2], sums: &mut [f32], counts: &mut [f32]) {
        for dy in -high..=high {
            for dx in -wide..=wide {
                let tap = Tap { dx, dy, step: 1 };
                let Some(here) = tap.inside(run, self.terms.size) else {
                    continue;
                };
                let there = tap.of(here);
                let sums = &mut sums[here.x..][..here.len];
                let counts = &mut counts[here.x..][..here.len];
                let [terms, known]: [&[f32]; 2] = there.rows(self.terms);
                match self.ids {
                    None => {
                        for i in 0..sums.len() {
                            sums[i] += terms[i];
                            counts[i] += known[i];
                        }
                    }
                    Some(ids) => {
                        let own = &ids.row(0, here.y)[here.x..][..here.len];
                        let other = &ids.row(0, there.y)[there.x..][..here.len];
                        for i in 0..sums.len() {
                            let same = if own[i] == other[i] { 1.0 } else { 0.0 };
                            sums[i] += same * terms[i];
                            counts[i] += same * known[i];
                        }
                    }
                }
            }
        }
    }
}

struct Mean<'a> {
    sums: &'a Image,
}

impl<'a> Kernel for Mean<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut gain: BandMut<'a>) {
        for y in rows {
            let [sums, counts] = self.sums.view().rows(y);
            for (x, gain) in gain.row(0, y).iter_mut().enumerate() {
                *gain = if counts[x] > 0.0 {
                    sums[x] / counts[x]
                } else {
                    0.0
                };
            }
        }
    }
}
