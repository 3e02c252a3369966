//! Morphological antialiasing: edges straightened by the steps that they make, from one image alone.
//!
//! A slanted edge is rendered as stairs. The length of a stair, and the side to which it goes on at its ends, tell where
//! the edge was, and with it which share of a pixel the other side should have had (Reshetov 2009, *Morphological
//! Antialiasing*). It is the baseline for all that uses history.
//!
//! - **Discontinuity**: the boundary of two pixels, side by side or one above the other, with |L - L'| > threshold,
//!   where L = √(l/(1 + l)) is perceived brightness, l ≥ 0 the Rec. 709 luminance.
//! - **Separation line**: a longest run of n discontinuities along a row of boundaries (or a column; all below with x and
//!   y exchanged), with the brighter pixels all on one side. The sides must not change, or the two edges of a thin
//!   slanted line would be taken for a single one.
//! - **Crossing**: at each end of the line, the discontinuities of the two pixels above it and of the two below it with
//!   their neighbours beyond the end. If it is one of them, the edge comes from there: it starts at the end, half a
//!   pixel above or below, and comes down straight to the middle of the line. Otherwise, and at the end of the image, it
//!   keeps to the line. Crossings at one end make the shape L, at both ends U or, on different sides, Z.
//! - **Share**: the area that the edge cuts off a pixel at distance d = 0, 1, … from its end: (n - 2d - 1)/(2n) in its
//!   half, 1/(8n) in the middle of an odd n, nothing beyond.
//! - **Search**: `max_length` boundaries to each side. A line that is longer counts as that long, without a crossing
//!   there.
//! - **Direction**: where a pixel has shares in both, rows and columns saw the same edge, and longer lines saw it better:
//!   the direction with the largest share counts. Equal ones, as on diagonals, count half each. Hence shares never
//!   sum up to more than one.
//!
//! The pixel becomes (1 - Σ share) own + Σ share · neighbour, in linear colour. Input and output: colour (3). Missing
//! pixels have no discontinuities and stay, as does every pixel without a share, to the bit.

use std::ops::Range;

use crate::error::{Result, Whole, in_range, whole};
use crate::image::{BandMut, Image, View};
use crate::math::{is_present, luminance};
use crate::rows::{self, Kernel};

/// What counts as an edge, and how far it is followed.
#[derive(Clone, Copy, Debug)]
pub struct Params {
    /// Difference of brightness, which is 0 to 1, that is not yet a discontinuity; ≥ 0; 0.1.
    pub threshold: f32,
    /// Boundaries that are searched to each side; 1 to 128; 16.
    pub max_length: usize,
}

impl Params {
    /// A length of search.
    pub(crate) fn max_length(value: impl Whole<usize>) -> Result<usize> {
        let range = |n: &usize| (1..=128).contains(n);
        whole("max_length", value, "1 to 128 pixels", range)
    }

    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        Self::max_length(self.max_length)?;
        in_range("threshold", self.threshold, "a finite number from 0", |v| {
            v >= 0.0 && v.is_finite()
        })
    }
}

/// The channels of the discontinuities: of each pixel with the one below it, and with the one to the right.
const BELOW: usize = 0;
const RIGHT: usize = 1;

/// Returns the antialiased colours.
pub fn morphological_aa(color: View, params: Params) -> Image {
    let size = color.size;
    let mut brightness = Image::new(size, 1);
    rows::run(&Brightness { color }, size.height, brightness.bands());
    let mut edges = Image::new(size, 2);
    let kernel = Edges {
        brightness: brightness.view(),
        threshold: params.threshold,
    };
    rows::run(&kernel, size.height, edges.bands());
    let mut smooth = Image::new(size, 3);
    let kernel = Blend {
        color,
        edges: edges.view(),
        max_length: params.max_length,
    };
    rows::run(&kernel, size.height, smooth.bands());
    smooth
}

struct Brightness<'a> {
    color: View<'a>,
}

impl<'a> Kernel for Brightness<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: BandMut<'a>) {
        for y in rows {
            let [r, g, b] = self.color.rows(y);
            let [out] = out.rows(y);
            for x in 0..r.len() {
                let present = is_present([r[x], g[x], b[x]]);
                // The sum of the largest floats may be rounded to infinity.
                let l = luminance(r[x], g[x], b[x]).clamp(0.0, f32::MAX);
                // No difference from NaN exceeds any threshold.
                out[x] = if present {
                    (l / (1.0 + l)).sqrt()
                } else {
                    f32::NAN
                };
            }
        }
    }
}

/// 1 where the first of two pixels is brighter, -1 where the second is, 0 where there is no discontinuity.
struct Edges<'a> {
    brightness: View<'a>,
    threshold: f32,
}

impl<'a> Kernel for Edges<'a> {
    type Out = BandMut<'a, i8>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: BandMut<'a, i8>) {
        // What lies outside stays 0.
        let size = self.brightness.size;
        for y in rows {
            let row = self.brightness.row(0, y);
            if y + 1 < size.height {
                self.compare(row, self.brightness.row(0, y + 1), out.row(BELOW, y));
            }
            self.compare(row, &row[1..], out.row(RIGHT, y));
        }
    }
}

impl Edges<'_> {
    #[inline(always)]
    fn compare(&self, first: &[f32], second: &[f32], out: &mut [i8]) {
        for ((edge, a), b) in out.iter_mut().zip(first).zip(second) {
            let difference = a - b;
            *edge = i8::from(difference > self.threshold) - i8::from(difference < -self.threshold);
        }
    }
}

struct Blend<'a> {
    color: View<'a>,
    edges: View<'a, i8>,
    max_length: usize,
}

impl<'a> Kernel for Blend<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: BandMut<'a>) {
        let width = self.color.size.width;
        for y in rows {
            for channel in 0..3 {
                out.row(channel, y)
                    .copy_from_slice(self.color.row(channel, y));
            }
            for x in 0..width {
                let Some(shares) = self.shares(x, y) else {
                    continue;
                };
                let own = y * width + x;
                let neighbors = [
                    own.wrapping_sub(width),
                    own + width,
                    own.wrapping_sub(1),
                    own + 1,
                ];
                let [up, down, left, right] = shares;
                // In pairs, so that the bits are those of the mirrored image.
                let rest = 1.0 - ((up + down) + (left + right));
                for channel in 0..3 {
                    let plane = self.color.plane(channel);
                    // Neighbours without a share may be outside or missing.
                    let lent = |k: usize| {
                        if shares[k] > 0.0 {
                            shares[k] * plane[neighbors[k]]
                        } else {
                            0.0
                        }
                    };
                    out.row(channel, y)[x] =
                        rest * plane[own] + ((lent(0) + lent(1)) + (lent(2) + lent(3)));
                }
            }
        }
    }
}

/// A direction of separation lines.
struct Lines<'a> {
    /// The discontinuities that lines are made of, and those that cross them, by pixel.
    edges: &'a [i8],
    crossings: &'a [i8],
    /// From one pixel to the next along a line.
    step: usize,
    /// The pixel's place along its line, and their number there.
    place: usize,
    extent: usize,
}

impl Blend<'_> {
    /// Shares of the neighbours above, below, to the left and to the right; `None` where all are 0.
    #[inline(always)]
    fn shares(&self, x: usize, y: usize) -> Option<[f32; 4]> {
        let size = self.color.size;
        let own = y * size.width + x;
        let (below, right) = (self.edges.plane(BELOW), self.edges.plane(RIGHT));
        let some = [
            y > 0 && below[own - size.width] != 0,
            below[own] != 0,
            x > 0 && right[own - 1] != 0,
            right[own] != 0,
        ];
        if some == [false; 4] {
            return None;
        }
        let rows = Lines {
            edges: below,
            crossings: right,
            step: 1,
            place: x,
            extent: size.width,
        };
        let columns = Lines {
            edges: right,
            crossings: below,
            step: size.width,
            place: y,
            extent: size.height,
        };
        let share = |k: usize, lines: &Lines, other: usize| {
            if some[k] {
                self.share(lines, own, other)
            } else {
                0.0
            }
        };
        let up = share(0, &rows, own.wrapping_sub(size.width));
        let down = share(1, &rows, own + size.width);
        let left = share(2, &columns, own.wrapping_sub(1));
        let right = share(3, &columns, own + 1);
        // Each share is one rounded quotient of small whole numbers, so that equal ones are found to be equal.
        let (in_rows, in_columns) = (up.max(down), left.max(right));
        let (r, c) = if in_rows > in_columns {
            (1.0, 0.0)
        } else if in_rows < in_columns {
            (0.0, 1.0)
        } else {
            (0.5, 0.5)
        };
        let shares = [r * up, r * down, c * left, c * right];
        (shares != [0.0; 4]).then_some(shares)
    }

    /// The area that the edge along the boundary with `other` cuts off `own`.
    #[inline(always)]
    fn share(&self, lines: &Lines, own: usize, other: usize) -> f32 {
        let &Lines {
            edges,
            crossings,
            step,
            place,
            extent,
        } = lines;
        let boundary = own.min(other);
        let goes_on = |i: usize| edges[i] == edges[boundary];
        let (mut before, mut after) = (0, 0);
        let (to_start, to_end) = (
            place.min(self.max_length),
            (extent - 1 - place).min(self.max_length),
        );
        while before < to_start && goes_on(boundary - (before + 1) * step) {
            before += 1;
        }
        while after < to_end && goes_on(boundary + (after + 1) * step) {
            after += 1;
        }
        let length = before + 1 + after;
        let crossed = |i: usize| crossings[i] != 0;
        let mut share = 0.0;
        if before < to_start {
            let back = (before + 1) * step;
            if crossed(own - back) && !crossed(other - back) {
                share += cut_off(before, length);
            }
        }
        if after < to_end {
            let ahead = after * step;
            if crossed(own + ahead) && !crossed(other + ahead) {
                share += cut_off(after, length);
            }
        }
        share
    }
}

/// The integral from `distance` to `distance + 1` of the edge's height, (1 - 2t/length)/2 up to the line's middle.
#[inline(always)]
fn cut_off(distance: usize, length: usize) -> f32 {
    let (d, n) = (distance as f32, length as f32);
    if 2.0 * d + 1.0 < n {
        (n - 2.0 * d - 1.0) / (2.0 * n)
    } else if 2.0 * d + 1.0 == n {
        1.0 / (8.0 * n)
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_edge_cuts_off_a_triangle() {
        for length in 1..=257 {
            let area: f32 = (0..length).map(|d| cut_off(d, length)).sum();
            assert!((area - length as f32 / 8.0).abs() < 1e-5 * length as f32);
            assert!((0..length).all(|d| cut_off(d, length) < 0.5));
        }
    }
}
