//! Averages of taps: the 2×2, and the 4×4 with or without their corners.

use std::ops::Range;

use super::{Source, WIDEST};
use crate::image::record;
use crate::memory::prefetch;
use crate::rows::{self, Outlined};

/// The footprints of a span of pixels, in one image of the history.
pub struct Taken<'a> {
    pub source: Source<'a>,
    /// Indices of the upper left taps.
    pub at: &'a [u32],
    /// Strides to the pixel on the right and to the pixel below.
    pub steps: [usize; 2],
    pub part: Range<usize>,
}

impl Taken<'_> {
    /// Gathers, pixel by pixel, for those that are `on`; up to [`WIDEST`] channels at once.
    #[inline(always)]
    pub fn each(&self, average: &impl Average, on: &[u32], values: &mut [f32], done: &mut [u32]) {
        let stride = self.source.image.channels;
        // Last channels first: a vector store also overwrites the channels after its own.
        for first in (0..stride).step_by(WIDEST).rev() {
            let image = self.source.image.part(first..(first + WIDEST).min(stride));
            let (part, values) = (
                Self {
                    source: Source {
                        image,
                        ..self.source
                    },
                    part: self.part.clone(),
                    ..*self
                },
                &mut values[first..],
            );
            match image.channels {
                1 => part.each_of::<1>(average, stride, on, values, done),
                2 => part.each_of::<2>(average, stride, on, values, done),
                3 | 4 => part.each_of::<4>(average, stride, on, values, done),
                _ => part.each_of::<WIDEST>(average, stride, on, values, done),
            }
        }
    }

    /// Writes `N` channels of every pixel, of `stride` elements; pixels with values that are not finite stay undone.
    #[inline(always)]
    fn each_of<const N: usize>(
        &self,
        average: &impl Average,
        stride: usize,
        on: &[u32],
        values: &mut [f32],
        done: &mut [u32],
    ) {
        let (data, step) = self.source.image.elements();
        let [dx, dy] = self.steps;
        for i in self.part.clone() {
            if on[i] != 0 {
                let at = self.at[i] as usize;
                let tap = |column, row| {
                    record(data, (self.source.below(at, row, dy) + column * dx) * step)
                };
                let mean: [f32; N] = average.mean(i, tap);
                done[i] &= u32::from(all_finite(&mean));
                // The store may reach into the next pixel, which is written afterwards.
                let due = on.get(i + 1).is_none_or(|&next| next != 0);
                let values = &mut values[i * stride..];
                if due {
                    values[..N].copy_from_slice(&mean);
                } else {
                    let count = self.source.image.channels;
                    values[..count].copy_from_slice(&mean[..count]);
                }
            }
        }
    }

    /// Fast path: a contiguous span, read with vector loads.
    #[inline(always)]
    pub fn row<A: Average, const C: usize>(
        &self,
        average: &A,
        values: &mut [f32],
        done: &mut [u32],
    ) {
        let Range { start, end } = self.part;
        let len = end - start;
        let data = self.source.image.elements().0;
        let [dx, dy] = self.steps;
        let first = self.at[start] as usize;
        let mut taps: [[&[[f32; C]]; 4]; 4] = [[&[]; 4]; 4];
        for row in 0..A::SIDE {
            for column in 0..A::SIDE {
                let from = (first + row * dy + column * dx) * C;
                taps[row][column] = data[from..][..len * C].as_chunks().0;
            }
        }
        let average = average.part(start, len);
        let means = &mut values[start * C..][..len * C].as_chunks_mut::<C>().0[..len];
        rows::outline(Means {
            average,
            taps,
            means: &mut *means,
        });
        // Only the lowest row of taps is new to the cache; the rows of pixels before have prefetched the others.
        let ahead = first + 2 * len + (A::SIDE - 1) * dy;
        prefetch(data, ahead * C, len * C);
        let lost = |value: &f32| u32::from(!value.is_finite());
        let all = means.as_flattened().iter();
        if all.fold(0, |any, value| any | lost(value)) != 0 {
            for (done, mean) in done[start..end].iter_mut().zip(means) {
                *done &= u32::from(all_finite(mean));
            }
        }
    }
}

/// The averages of a contiguous span, compiled once for all callers.
struct Means<'a, A, const C: usize> {
    average: A,
    taps: [[&'a [[f32; C]]; 4]; 4],
    means: &'a mut [[f32; C]],
}

impl<A: Average, const C: usize> Outlined for Means<'_, A, C> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self {
            average,
            mut taps,
            means,
        } = self;
        let len = means.len();
        let average = average.part(0, len);
        // Equal lengths that the compiler can see need no bounds checks.
        for row in 0..A::SIDE {
            for column in 0..A::SIDE {
                taps[row][column] = &taps[row][column][..len];
            }
        }
        for i in 0..len {
            means[i] = average.mean(i, |column, row| taps[row][column][i]);
        }
    }
}

/// A filter: how taps become a value.
pub trait Average {
    /// Taps along each side.
    const SIDE: usize;

    /// The filter for a part of the pixels.
    fn part(&self, start: usize, len: usize) -> Self;

    /// The value of pixel `i`; `tap` takes column and row.
    fn mean<const N: usize>(&self, i: usize, tap: impl Fn(usize, usize) -> [f32; N]) -> [f32; N];
}

/// 2×2 taps.
pub struct Quad<'a> {
    pub normalized: [&'a [f32]; 4],
}

impl Average for Quad<'_> {
    const SIDE: usize = 2;

    #[inline(always)]
    fn part(&self, start: usize, len: usize) -> Self {
        Self {
            normalized: self.normalized.map(|lane| &lane[start..][..len]),
        }
    }

    #[inline(always)]
    fn mean<const N: usize>(&self, i: usize, tap: impl Fn(usize, usize) -> [f32; N]) -> [f32; N] {
        let [w, x, y, z] = self.normalized;
        let mut mean = [-0.0; N];
        add(&mut mean, w[i], &tap(0, 0));
        add(&mut mean, x[i], &tap(1, 0));
        add(&mut mean, y[i], &tap(0, 1));
        add(&mut mean, z[i], &tap(1, 1));
        mean
    }
}

/// 4×4 taps, with or without the corners.
pub struct Grid<'a, const CORNERS: bool> {
    /// Weights of the columns and of the rows.
    pub weights: [[&'a [f32]; 4]; 2],
    pub dering: bool,
}

impl<'a, const CORNERS: bool> Average for Grid<'a, CORNERS> {
    const SIDE: usize = 4;

    #[inline(always)]
    fn part(&self, start: usize, len: usize) -> Self {
        let cut = |side: [&'a [f32]; 4]| side.map(|lane| &lane[start..][..len]);
        let [along, down] = self.weights;
        Self {
            weights: [cut(along), cut(down)],
            ..*self
        }
    }

    #[inline(always)]
    fn mean<const N: usize>(&self, i: usize, tap: impl Fn(usize, usize) -> [f32; N]) -> [f32; N] {
        let [[a0, a1, a2, a3], [d0, d1, d2, d3]] = self.weights;
        let along = [a0[i], a1[i], a2[i], a3[i]];
        let down = [d0[i], d1[i], d2[i], d3[i]];
        let mean = wide_mean::<CORNERS, N>([along, down], &tap);
        if self.dering {
            // Taps without weight must not widen the range: repeat their neighbours.
            let [a, b, c, d] = [tap(1, 1), tap(2, 1), tap(1, 2), tap(2, 2)];
            let [b, d] = if along[2] == 0.0 { [a, c] } else { [b, d] };
            let [c, d] = if down[2] == 0.0 { [a, b] } else { [c, d] };
            let mut held = hold(mean, [a, b, c, d]);
            for k in 0..N {
                // A missing value must stay missing, so that the slow path finds it.
                held[k] = if mean[k].is_finite() {
                    held[k]
                } else {
                    mean[k]
                };
            }
            held
        } else {
            mean
        }
    }
}

/// Adds a weighted tap; a sum that begins with −0 keeps the bits of its first tap.
#[inline(always)]
fn add<const N: usize>(sum: &mut [f32; N], weight: f32, tap: &[f32; N]) {
    for (sum, tap) in sum.iter_mut().zip(tap) {
        *sum = weight.mul_add(*tap, *sum);
    }
}

#[inline(always)]
fn all_finite<const N: usize>(values: &[f32; N]) -> bool {
    values
        .iter()
        .fold(true, |all, value| all & value.is_finite())
}

/// The weighted mean of 4×4 taps.
#[inline(always)]
pub fn wide_mean<const CORNERS: bool, const N: usize>(
    [along, [d0, d1, d2, d3]]: [[f32; 4]; 2],
    tap: impl Fn(usize, usize) -> [f32; N],
) -> [f32; N] {
    let mut sum = [-0.0; N];
    add(
        &mut sum,
        d0,
        &line::<CORNERS, N>(along, |column| tap(column, 0)),
    );
    add(
        &mut sum,
        d1,
        &line::<true, N>(along, |column| tap(column, 1)),
    );
    add(
        &mut sum,
        d2,
        &line::<true, N>(along, |column| tap(column, 2)),
    );
    add(
        &mut sum,
        d3,
        &line::<CORNERS, N>(along, |column| tap(column, 3)),
    );
    sum
}

/// The weighted sum of a row of four taps, or of those in the middle.
#[inline(always)]
fn line<const ENDS: bool, const N: usize>(
    [w0, w1, w2, w3]: [f32; 4],
    tap: impl Fn(usize) -> [f32; N],
) -> [f32; N] {
    let mut sum = [-0.0; N];
    if ENDS {
        add(&mut sum, w0, &tap(0));
    }
    add(&mut sum, w1, &tap(1));
    add(&mut sum, w2, &tap(2));
    if ENDS {
        add(&mut sum, w3, &tap(3));
    }
    sum
}

/// Values held to the range of the taps.
#[inline(always)]
pub fn hold<const N: usize, const TAPS: usize>(
    values: [f32; N],
    taps: [[f32; N]; TAPS],
) -> [f32; N] {
    let (mut low, mut high) = ([f32::INFINITY; N], [f32::NEG_INFINITY; N]);
    for tap in &taps {
        for k in 0..N {
            low[k] = if tap[k] < low[k] { tap[k] } else { low[k] };
            high[k] = if tap[k] > high[k] { tap[k] } else { high[k] };
        }
    }
    let mut held = values;
    for k in 0..N {
        held[k] = if held[k] < low[k] { low[k] } else { held[k] };
        held[k] = if held[k] > high[k] { high[k] } else { held[k] };
    }
    held
}
