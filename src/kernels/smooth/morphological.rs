//! Morphological antialiasing: smooths the stair-steps of edges in a single image.
//!
//! A slanted edge is rendered as stairs. The length of a step, and the side to which the edge continues at its ends,
//! locate the true edge, and with it the area of each pixel that belongs to the other side (Reshetov 2009,
//! *Morphological Antialiasing*). It is the baseline for methods that use history.
//!
//! - **Discontinuity**: the boundary of two pixels, side by side or one above the other, with |L - L'| > threshold,
//!   where L = √(l/(1 + l)) is perceived brightness, l ≥ 0 the Rec. 709 luminance.
//! - **Separation line**: a maximal sequence of n discontinuities along a row of boundaries (or a column; all below
//!   with x and y exchanged), with the brighter pixels all on one side. If the sides could change, the two edges of a
//!   thin slanted line would be merged into one.
//! - **Crossing**: at each end of the line, the discontinuities of the two pixels above it and of the two below it with
//!   their neighbours beyond the end. If exactly one is present, the edge continues there: it starts at the end of the
//!   line, half a pixel above or below, and descends linearly to the middle of the line. Otherwise, and at the border of
//!   the image, it stays on the line. A crossing at one end makes the shape L, at both ends U or, on different sides, Z.
//! - **Coverage**: the area that the edge cuts off a pixel at distance d = 0, 1, … from the line's end: (n - 2d -
//!   1)/(2n) in the near half, 1/(8n) in the middle of an odd n, 0 beyond.
//! - **Search**: `max_length` boundaries to each side. A longer line is cut there, without a crossing.
//! - **Direction**: a pixel with coverage from both rows and columns saw the same edge twice; the longer line locates it
//!   better: the direction with the largest coverage counts. Equal ones, as on diagonals, count half each. Hence the
//!   coverages never sum to more than 1.
//!
//! The pixel becomes (1 - Σ coverage) own + Σ coverage · neighbour, in linear colour. Input and output: colour (3).
//! Missing pixels have no discontinuities. They and every pixel with zero coverage keep their bits.

use std::ops::Range;

use crate::error::{Result, Whole, in_range, whole};
use crate::image::{BandMut, Image, View};
use crate::math::{is_present, luminance};
use crate::rows::{self, Kernel, Simd};

/// What counts as an edge, and how far it is followed.
#[derive(Clone, Copy, Debug)]
pub struct Params {
    /// Largest difference of brightness (0 to 1) that is not a discontinuity; ≥ 0; 0.1.
    pub threshold: f32,
    /// Search distance to each side, in pixels; 1 to 128; 16.
    pub max_length: usize,
}

impl Params {
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

/// Channels of the edge image: the boundaries with the pixel below and with the pixel to the right.
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
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: BandMut<'a>) {
        for y in rows {
            let [r, g, b] = self.color.rows(y);
            let [out] = out.rows(y);
            for x in 0..r.len() {
                let present = is_present([r[x], g[x], b[x]]);
                // The luminance of the largest floats may round to infinity.
                let l = luminance(r[x], g[x], b[x]).clamp(0.0, f32::MAX);
                // A difference from NaN exceeds no threshold: missing pixels have no edges.
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
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: BandMut<'a, i8>) {
        // Boundaries with the outside stay 0.
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
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: BandMut<'a>) {
        let width = self.color.size.width;
        for y in rows {
            for channel in 0..3 {
                out.row(channel, y)
                    .copy_from_slice(self.color.row(channel, y));
            }
            for x in 0..width {
                let Some(coverages) = self.coverages(x, y) else {
                    continue;
                };
                let own = y * width + x;
                let neighbors = [
                    own.wrapping_sub(width),
                    own + width,
                    own.wrapping_sub(1),
                    own + 1,
                ];
                let [up, down, left, right] = coverages;
                // Summed in symmetric pairs, so that a mirrored image gives mirrored bits.
                let rest = 1.0 - ((up + down) + (left + right));
                for channel in 0..3 {
                    let plane = self.color.plane(channel);
                    // A neighbour with zero coverage may be outside or missing: its value must not be read.
                    let term = |k: usize| {
                        if coverages[k] > 0.0 {
                            coverages[k] * plane[neighbors[k]]
                        } else {
                            0.0
                        }
                    };
                    out.row(channel, y)[x] =
                        rest * plane[own] + ((term(0) + term(1)) + (term(2) + term(3)));
                }
            }
        }
    }
}

/// Separation lines through a pixel, in one direction.
struct Lines<'a> {
    /// Discontinuities along the lines, by pixel.
    edges: &'a [i8],
    /// Discontinuities across them.
    crossings: &'a [i8],
    /// Index step from one pixel to the next along a line.
    step: usize,
    /// The pixel's position along its line.
    place: usize,
    /// Size of the image along the line.
    extent: usize,
}

impl Blend<'_> {
    /// Coverage by the neighbours above, below, left and right; `None` if all are 0.
    #[inline(always)]
    fn coverages(&self, x: usize, y: usize) -> Option<[f32; 4]> {
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
        let coverage = |k: usize, lines: &Lines, other: usize| {
            if some[k] {
                self.coverage(lines, own, other)
            } else {
                0.0
            }
        };
        let up = coverage(0, &rows, own.wrapping_sub(size.width));
        let down = coverage(1, &rows, own + size.width);
        let left = coverage(2, &columns, own.wrapping_sub(1));
        let right = coverage(3, &columns, own + 1);
        // Each coverage is a quotient of small integers, rounded once, so that equal values compare equal.
        let (in_rows, in_columns) = (up.max(down), left.max(right));
        let (r, c) = if in_rows > in_columns {
            (1.0, 0.0)
        } else if in_rows < in_columns {
            (0.0, 1.0)
        } else {
            (0.5, 0.5)
        };
        let coverages = [r * up, r * down, c * left, c * right];
        (coverages != [0.0; 4]).then_some(coverages)
    }

    /// The area that the edge along the boundary with `other` cuts off `own`.
    #[inline(always)]
    fn coverage(&self, lines: &Lines, own: usize, other: usize) -> f32 {
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
        let mut coverage = 0.0;
        if before < to_start {
            let back = (before + 1) * step;
            if crossed(own - back) && !crossed(other - back) {
                coverage += cut_off(before, length);
            }
        }
        if after < to_end {
            let ahead = after * step;
            if crossed(own + ahead) && !crossed(other + ahead) {
                coverage += cut_off(after, length);
            }
        }
        coverage
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
