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

use crate::error::{Result, Whole, finite_from_0, whole};
use crate::image::{BandMut, Image, Size, View};
use crate::math::{is_present, larger, luminance};
use crate::rows::{self, Kernel, Simd};

/// What counts as an edge, and how far it is followed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// Largest difference of brightness (0 to 1) that is not a discontinuity; ≥ 0; 0.1.
    pub threshold: f32,
    /// Search distance to each side, in pixels; 1 to 128; 16.
    pub max_length: usize,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            threshold: 0.1,
            max_length: 16,
        }
    }
}

impl Params {
    pub(crate) fn max_length(value: impl Whole<usize>) -> Result<usize> {
        let range = |n: &usize| (1..=128).contains(n);
        whole("max_length", value, "1 to 128 pixels", range)
    }

    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        Self::max_length(self.max_length)?;
        finite_from_0("threshold", self.threshold)
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

/// Blends every pixel by its coverages. The ends of the lines are not searched pixel by pixel: sweeps from all four sides
/// carry the distance to the end, and the crossing there, from each boundary to the next.
struct Blend<'a> {
    color: View<'a>,
    edges: View<'a, i8>,
    max_length: usize,
}

/// One end of the separation line through each boundary of a row; of no meaning where there is no discontinuity.
#[derive(Clone)]
struct Ends {
    /// Boundaries from here to the line's end, as far as the search goes.
    distance: Vec<u8>,
    /// The side of the crossing there: 1 for the first of the two pixels, -1 for the second, 0 for none.
    side: Vec<i8>,
}

impl Ends {
    fn new(width: usize) -> Self {
        Self {
            distance: vec![0; width],
            side: vec![0; width],
        }
    }

    /// Steps along vertical lines to the next row. `before` is the previous row of boundaries, `crossings` the row of those
    /// that a line may cross if it ends between the two rows.
    #[inline(always)]
    fn step(&mut self, edges: &[i8], before: &[i8], crossings: &[i8], search: u8) {
        // The last pixel has no boundary to its right.
        let n = self.distance.len() - 1;
        let (distance, side) = (&mut self.distance[..n], &mut self.side[..n]);
        let (edges, before) = (&edges[..n], &before[..n]);
        let (first, second) = (&crossings[..n], &crossings[1..][..n]);
        for x in 0..n {
            let here = side_of(first[x], second[x]);
            let end = (distance[x], side[x]);
            (distance[x], side[x]) = follow(edges[x] == before[x], end, here, search);
        }
    }
}

/// The end of a line, one boundary further on: farther away by one where the line goes on, otherwise here.
#[inline(always)]
fn follow(goes_on: bool, (distance, side): (u8, i8), here: i8, search: u8) -> (u8, i8) {
    let farther = (distance + 1).min(search);
    let seen = if farther < search { side } else { 0 };
    if goes_on { (farther, seen) } else { (0, here) }
}

/// The side of a crossing: that of the only discontinuity of two.
#[inline(always)]
fn side_of(first: i8, second: i8) -> i8 {
    i8::from(first != 0) - i8::from(second != 0)
}

/// Writes the ends of horizontal lines. `first` and `second` are the vertical discontinuities of the rows above and below.
#[inline(always)]
fn scan(edges: &[i8], first: &[i8], second: &[i8], search: u8, [start, end]: [&mut Ends; 2]) {
    let n = edges.len();
    let (first, second) = (&first[..n], &second[..n]);
    let (distance, side) = (&mut start.distance[..n], &mut start.side[..n]);
    (distance[0], side[0]) = (0, 0);
    let mut last = (0, 0);
    for x in 1..n {
        let here = side_of(first[x - 1], second[x - 1]);
        last = follow(edges[x] == edges[x - 1], last, here, search);
        (distance[x], side[x]) = last;
    }
    let (distance, side) = (&mut end.distance[..n], &mut end.side[..n]);
    let mut last = (0, 0);
    (distance[n - 1], side[n - 1]) = last;
    for x in (0..n - 1).rev() {
        let here = side_of(first[x], second[x]);
        last = follow(edges[x] == edges[x + 1], last, here, search);
        (distance[x], side[x]) = last;
    }
}

/// Writes the areas that edges cut off the pixels on either side of a row of boundaries.
#[inline(always)]
fn cover(edges: &[i8], start: &Ends, end: &Ends, first: &mut [f32], second: &mut [f32]) {
    let n = edges.len();
    let (first, second) = (&mut first[..n], &mut second[..n]);
    let (before, after) = (&start.distance[..n], &end.distance[..n]);
    let (start, end) = (&start.side[..n], &end.side[..n]);
    for x in 0..n {
        let (b, a) = (f32::from(before[x]), f32::from(after[x]));
        let length = b + 1.0 + a;
        let (b, a) = (cut_off(b, length), cut_off(a, length));
        let on = edges[x] != 0;
        let keep = |holds: bool, area: f32| if holds & on { area } else { 0.0 };
        first[x] = keep(start[x] > 0, b) + keep(end[x] > 0, a);
        second[x] = keep(start[x] < 0, b) + keep(end[x] < 0, a);
    }
}

impl<'a> Kernel for Blend<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: BandMut<'a>) {
        let Size { height, width } = self.color.size;
        let search = self.max_length as u8;
        let edges = |channel: usize, y: usize| self.edges.row(channel, y);
        // Beyond the image: a row in which no line goes on, and a row without crossings.
        let (outside, none) = (vec![2; width], vec![0; width]);
        // The lower ends of vertical lines. The sweep may start where the search of the band's last row would stop.
        let bottom = (rows.end - 1 + self.max_length).min(height - 1);
        let mut lower = vec![Ends::new(width); rows.len()];
        let mut ends = Ends::new(width);
        for y in (rows.start..=bottom).rev() {
            let next = if y < bottom {
                edges(RIGHT, y + 1)
            } else {
                &outside[..]
            };
            ends.step(edges(RIGHT, y), next, edges(BELOW, y), search);
            if y < rows.end {
                lower[y - rows.start].clone_from(&ends);
            }
        }
        let mut upper = Ends::new(width);
        let [mut start, mut end] = [Ends::new(width), Ends::new(width)];
        // Coverage by the neighbours; the one on the left is found one pixel to the left.
        let [mut up, mut down, mut right] = [(); 3].map(|()| vec![0.0; width]);
        let (mut left, mut next_up) = (vec![0.0; width + 1], vec![0.0; width]);
        let mut own = vec![0.0; width + 2];
        for y in rows.start.saturating_sub(self.max_length)..rows.end {
            let top = y == rows.start.saturating_sub(self.max_length);
            let before = if top {
                &outside[..]
            } else {
                edges(RIGHT, y - 1)
            };
            let crossings = if y == 0 {
                &none[..]
            } else {
                edges(BELOW, y - 1)
            };
            upper.step(edges(RIGHT, y), before, crossings, search);
            if y + 1 >= rows.start {
                std::mem::swap(&mut up, &mut next_up);
                let below = edges(RIGHT, (y + 1).min(height - 1));
                let line = edges(BELOW, y);
                scan(line, edges(RIGHT, y), below, search, [&mut start, &mut end]);
                cover(line, &start, &end, &mut down, &mut next_up);
            }
            if y < rows.start {
                continue;
            }
            let ends = &lower[y - rows.start];
            cover(edges(RIGHT, y), &upper, ends, &mut right, &mut left[1..]);
            choose(&mut up, &mut down, &mut left, &mut right);
            for channel in 0..3 {
                let row = |y: usize| self.color.row(channel, y);
                own[1..=width].copy_from_slice(row(y));
                let vertical = [row(y.saturating_sub(1)), row((y + 1).min(height - 1))];
                mix(
                    &own,
                    vertical,
                    [&up, &down, &left, &right],
                    out.row(channel, y),
                );
            }
        }
    }
}

/// Keeps the coverages of the direction with the largest; half of each where both are equal.
#[inline(always)]
fn choose(up: &mut [f32], down: &mut [f32], left: &mut [f32], right: &mut [f32]) {
    let n = up.len();
    let (down, left, right) = (&mut down[..n], &mut left[..n], &mut right[..n]);
    for x in 0..n {
        // Each coverage is a quotient of small integers, rounded once, so that equal values compare equal.
        let (in_rows, in_columns) = (larger(up[x], down[x]), larger(left[x], right[x]));
        let either = |a: f32, b: f32| if a > b { 1.0 } else { 0.0 };
        let same = in_rows == in_columns;
        let r = if same {
            0.5
        } else {
            either(in_rows, in_columns)
        };
        let c = if same {
            0.5
        } else {
            either(in_columns, in_rows)
        };
        (up[x], down[x]) = (r * up[x], r * down[x]);
        (left[x], right[x]) = (c * left[x], c * right[x]);
    }
}

/// Blends a row with its neighbours; `own` has one column more on either side.
#[inline(always)]
fn mix(own: &[f32], [above, below]: [&[f32]; 2], covers: [&[f32]; 4], out: &mut [f32]) {
    let n = out.len();
    let (before, own, after) = (&own[..n], &own[1..][..n], &own[2..][..n]);
    let (above, below) = (&above[..n], &below[..n]);
    let [up, down, left, right] = covers;
    let (up, down, left, right) = (&up[..n], &down[..n], &left[..n], &right[..n]);
    // A neighbour with zero coverage may be outside or missing: its value does not count.
    let term = |cover: f32, value: f32| if cover > 0.0 { cover * value } else { 0.0 };
    for x in 0..n {
        // Summed in symmetric pairs, so that a mirrored image gives mirrored bits.
        let sum = (up[x] + down[x]) + (left[x] + right[x]);
        let vertical = term(up[x], above[x]) + term(down[x], below[x]);
        let sideways = term(left[x], before[x]) + term(right[x], after[x]);
        let blended = (1.0 - sum) * own[x] + (vertical + sideways);
        out[x] = if sum > 0.0 { blended } else { own[x] };
    }
}

/// The integral from `distance` to `distance + 1` of the edge's height, (1 - 2t/length)/2 up to the line's middle.
#[inline(always)]
fn cut_off(distance: f32, length: f32) -> f32 {
    let rest = length - 2.0 * distance - 1.0;
    let (height, ends) = if rest > 0.0 { (rest, 2.0) } else { (1.0, 8.0) };
    if rest >= 0.0 {
        height / (ends * length)
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
            let area: f32 = (0..length).map(|d| cut_off(d as f32, length as f32)).sum();
            assert!((area - length as f32 / 8.0).abs() < 1e-5 * length as f32);
            assert!((0..length).all(|d| cut_off(d as f32, length as f32) < 0.5));
        }
    }
}
