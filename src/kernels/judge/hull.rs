//! Convex hulls of a few colours, and where a segment enters them.
//!
//! - [`Polygon`]: the exact hull of chrominances, with the range of the first coordinate. Points are float32; products
//!   of their differences are float64, which makes the test for collinear points exact. The hull of two points is a
//!   segment, that of one a point.
//! - [`enter_hulls`]: the exact hull of the colours. With the target as origin, a ray along w leaves the hull of the
//!   colours q at the parameter t = max 1/Σμ over all w = Σ μ q, μ ≥ 0. By linear programming three colours attain the
//!   maximum: all triples are tried, and by Cramer's rule each takes one determinant and three shared with other
//!   triples. A hull thinner than a millionth of the largest coordinate counts as flat: then pairs of colours stand for
//!   triples (in the plane) or single colours (on a line), for rays that stay within that distance of the triangle or
//!   segment that the colours form with the target. In float64.
//! - [`enter_slabs`]: the smallest intersection of slabs along thirteen directions (a 26-DOP: axes and diagonals of the
//!   cube) that holds the colours. It contains their exact hull, and takes minima and maxima alone.

use crate::image::SEGMENT;
use crate::lanes::LANES;
use crate::math::{Color, larger, smaller};
use crate::pixels::{Columns, Row};

/// The parameter from inside (0) to outside (1) at which a segment crosses a plane, from its ends' signed distances.
#[inline(always)]
fn crossing(outside: f32, inside: f32) -> f32 {
    // The inner end is inside by construction, but rounding may make its distance negative.
    let inside = larger(inside, 0.0);
    inside / (inside - outside)
}

/// Interpolated from the target's end, because a far colour cannot represent an offset of the target's precision.
#[inline(always)]
pub fn toward(color: Color, target: Color, t: f32) -> Color {
    [0, 1, 2].map(|c| target[c] + t * (color[c] - target[c]))
}

pub struct Polygon {
    /// Corners in winding order; second and third coordinate of the colours.
    corners: [[f64; 2]; 26],
    count: usize,
    low: f32,
    high: f32,
}

impl Polygon {
    #[inline(always)]
    pub fn of(colors: &[Color]) -> Self {
        let mut points = [[0.0; 2]; 25];
        let points = &mut points[..colors.len()];
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        for (point, color) in points.iter_mut().zip(colors) {
            *point = [f64::from(color[1]), f64::from(color[2])];
            (low, high) = (low.min(color[0]), high.max(color[0]));
        }
        // Insertion sort: at most 25 points, and equal points are interchangeable.
        for i in 1..points.len() {
            for j in (1..=i).rev() {
                let [a, b] = [points[j - 1], points[j]];
                if (a[0], a[1]) > (b[0], b[1]) {
                    points.swap(j - 1, j);
                }
            }
        }
        // Monotone chain: lower hull from left to right, then upper hull back (Andrew 1979).
        let mut hull = Self {
            corners: [[0.0; 2]; 26],
            count: 0,
            low,
            high,
        };
        for &point in points.iter() {
            hull.push(point, 0);
        }
        let start = hull.count.saturating_sub(1);
        for &point in points.iter().rev() {
            hull.push(point, start);
        }
        // The upper chain ends with the first corner again.
        if hull.count > 1 {
            hull.count -= 1;
        }
        hull
    }

    /// Appends a corner to the chain that begins at `start`; removes corners that are no longer convex.
    #[inline(always)]
    fn push(&mut self, point: [f64; 2], start: usize) {
        if self.count > 0 && self.corners[self.count - 1] == point {
            return;
        }
        while self.count >= start + 2 {
            let [a, b] = [self.corners[self.count - 2], self.corners[self.count - 1]];
            if cross(a, b, point) > 0.0 {
                break;
            }
            self.count -= 1;
        }
        self.corners[self.count] = point;
        self.count += 1;
    }
}

/// Positive if c lies to the left of the line from a to b.
#[inline(always)]
fn cross(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Positive if c lies beyond a in the direction of b.
#[inline(always)]
fn ahead(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[0] - a[0]) + (b[1] - a[1]) * (c[1] - a[1])
}

impl Polygon {
    /// Where the segment from a colour to a target inside enters the hull; `None` if the colour is inside.
    #[inline(always)]
    pub fn enter(&self, color: Color, target: Color) -> Option<Color> {
        let [from, to] = [color, target].map(|c| [f64::from(c[1]), f64::from(c[2])]);
        // The smallest parameter from target to colour at which a bound is crossed.
        let mut t = None;
        let mut bound = |outside: f64, inside: f64| {
            if outside < 0.0 {
                let here = crossing(outside as f32, inside as f32);
                t = Some(here.min(t.unwrap_or(1.0)));
            }
        };
        for (sign, limit) in [(1.0, self.low), (-1.0, self.high)] {
            let distance = |c: Color| sign * (f64::from(c[0]) - f64::from(limit));
            bound(distance(color), distance(target));
        }
        let corners = &self.corners[..self.count];
        match *corners {
            [point] => {
                if from != point {
                    t = Some(0.0);
                }
            }
            [a, b] => {
                for (a, b) in [(a, b), (b, a)] {
                    bound(cross(a, b, from), cross(a, b, to));
                    bound(ahead(a, b, from), ahead(a, b, to));
                }
            }
            _ => {
                for i in 0..corners.len() {
                    let (a, b) = (corners[i], corners[(i + 1) % corners.len()]);
                    bound(cross(a, b, from), cross(a, b, to));
                }
            }
        }
        Some(toward(color, target, t?))
    }
}

/// Slab directions: axes, face diagonals, space diagonals.
const DIRECTIONS: [[f32; 3]; 13] = [
    [1.0, 0.0, 0.0],
    [0.0, 1.0, 0.0],
    [0.0, 0.0, 1.0],
    [1.0, 1.0, 0.0],
    [1.0, -1.0, 0.0],
    [1.0, 0.0, 1.0],
    [1.0, 0.0, -1.0],
    [0.0, 1.0, 1.0],
    [0.0, 1.0, -1.0],
    [1.0, 1.0, 1.0],
    [1.0, 1.0, -1.0],
    [1.0, -1.0, 1.0],
    [1.0, -1.0, -1.0],
];

#[inline(always)]
fn along(direction: [f32; 3], color: Color) -> f32 {
    direction[0] * color[0] + direction[1] * color[1] + direction[2] * color[2]
}

/// Moves each of `n` colours towards its target until it enters the 26-DOP of its neighbourhood; NaN for colours that
/// are inside or have no valid neighbours.
#[inline(always)]
pub fn enter_slabs<const N: usize>(
    n: usize,
    rows: [[&Columns; 3]; N],
    [t0, t1, t2]: &[Row; 3],
    [c0, c1, c2]: &mut [Row; 3],
) {
    let n = n.min(SEGMENT);
    let mut nearest = [f32::INFINITY; SEGMENT];
    let (mut lows, mut highs): (Columns, Columns) = ([0.0; _], [0.0; _]);
    for direction in DIRECTIONS {
        for i in 0..n + LANES {
            let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
            for row in rows {
                let at = along(direction, row.map(|row| row[i]));
                (low, high) = (smaller(at, low), larger(at, high));
            }
            (lows[i], highs[i]) = (low, high);
        }
        for i in 0..n {
            let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
            for dx in 0..N {
                (low, high) = (smaller(lows[i + dx], low), larger(highs[i + dx], high));
            }
            let from = along(direction, [c0[i], c1[i], c2[i]]);
            let to = along(direction, [t0[i], t1[i], t2[i]]);
            let below = from < low;
            let outside = if below { from - low } else { high - from };
            let inside = if below { to - low } else { high - to };
            let t = smaller(crossing(outside, inside), nearest[i]);
            let leaves = (outside < 0.0) & (low <= high);
            nearest[i] = if leaves { t } else { nearest[i] };
        }
    }
    for i in 0..n {
        let (color, target) = ([c0[i], c1[i], c2[i]], [t0[i], t1[i], t2[i]]);
        let entered = toward(color, target, nearest[i]);
        let moves = nearest[i] < f32::INFINITY;
        [c0[i], c1[i], c2[i]] = entered.map(|c| if moves { c } else { f32::NAN });
    }
}

/// Pixels whose hulls are computed together, one a lane.
const WIDE: usize = 8;
type Wide = [f64; WIDE];
/// Neighbours of a pixel in 5×5.
const MAX_NEIGHBOURS: usize = 24;
/// A hull thinner than this counts as flat, and a colour as near to a flat hull as inside; relative to the largest
/// coordinate.
const TOLERANCE: f64 = 1e-6;
/// Volumes and areas below this are rounding errors; relative to the product of their edges' lengths.
const ROUNDOFF: f64 = 1e-12;

#[inline(always)]
fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn product(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[inline(always)]
fn of(vectors: &[Wide; 3], l: usize) -> [f64; 3] {
    [vectors[0][l], vectors[1][l], vectors[2][l]]
}

/// Moves each of `n` colours towards its target until it enters the exact hull of its neighbourhood; NaN for colours
/// that are inside or have no valid neighbours.
#[inline(always)]
pub fn enter_hulls<const N: usize>(
    n: usize,
    rows: [[&Columns; 3]; N],
    targets: &[Row; 3],
    colors: &mut [Row; 3],
) {
    let mut hulls = Hulls::new(N * N - 1);
    for start in (0..n.min(SEGMENT)).step_by(WIDE) {
        let mut place = 0;
        let mut largest = [0.0; WIDE];
        for (dy, row) in rows.iter().enumerate() {
            for dx in 0..N {
                // The centre is the target itself, or missing: it adds nothing to the hull.
                let own = (dy == N / 2) & (dx == N / 2);
                let mut vectors = [[0.0; WIDE]; 3];
                for c in 0..3 {
                    for l in 0..WIDE {
                        let tap = f64::from(row[c][start + dx + l]);
                        let off = tap - f64::from(targets[c][start + l]);
                        let missing = off.is_nan();
                        vectors[c][l] = if missing { 0.0 } else { off };
                        let size = if missing { 0.0 } else { tap.abs() };
                        largest[l] = if size > largest[l] { size } else { largest[l] };
                    }
                }
                if !own {
                    hulls.around[place] = vectors;
                    place += 1;
                }
            }
        }
        let mut way = [[0.0; WIDE]; 3];
        for c in 0..3 {
            for l in 0..WIDE {
                way[c][l] = f64::from(colors[c][start + l]) - f64::from(targets[c][start + l]);
            }
        }
        let exits = hulls.exit(&way, largest.map(|largest| TOLERANCE * largest));
        for l in 0..WIDE {
            let i = start + l;
            let color = [colors[0][i], colors[1][i], colors[2][i]];
            let target = [targets[0][i], targets[1][i], targets[2][i]];
            let entered = toward(color, target, exits[l] as f32);
            let moves = exits[l] < 1.0;
            for c in 0..3 {
                colors[c][i] = if moves { entered[c] } else { f32::NAN };
            }
        }
    }
}

/// Neighbourhoods of [`WIDE`] pixels relative to their targets, and scratch.
struct Hulls {
    count: usize,
    around: [[Wide; 3]; MAX_NEIGHBOURS],
    lengths: [Wide; MAX_NEIGHBOURS],
    /// Cross product of every pair of neighbours, in lexicographic order.
    products: Vec<[Wide; 3]>,
    /// Dot product of each cross product with the ray.
    along: Vec<Wide>,
}

impl Hulls {
    fn new(count: usize) -> Self {
        let pairs = count * (count - 1) / 2;
        Self {
            count,
            around: [[[0.0; WIDE]; 3]; MAX_NEIGHBOURS],
            lengths: [[0.0; WIDE]; MAX_NEIGHBOURS],
            products: vec![[[0.0; WIDE]; 3]; pairs],
            along: vec![[0.0; WIDE]; pairs],
        }
    }

    /// The ray parameters at which the segments from the targets along `way` leave the hulls; 1 or more for ends inside.
    #[inline(always)]
    fn exit(&mut self, way: &[Wide; 3], tolerance: Wide) -> Wide {
        let mut exits = self.exit_solid(way, tolerance);
        if exits.iter().any(|exit| exit.is_nan()) {
            let flat = self.exit_flat(way, tolerance);
            for (exit, flat) in exits.iter_mut().zip(flat) {
                *exit = if exit.is_nan() { flat } else { *exit };
            }
        }
        exits
    }

    /// Hulls with a volume; NaN for flat ones.
    #[inline(always)]
    fn exit_solid(&mut self, way: &[Wide; 3], tolerance: Wide) -> Wide {
        let Self {
            count,
            around,
            lengths,
            products,
            along,
        } = self;
        let count = *count;
        let around = &around[..count];
        for (vector, lengths) in around.iter().zip(&mut *lengths) {
            for l in 0..WIDE {
                let q = of(vector, l);
                lengths[l] = dot(q, q).sqrt();
            }
        }
        let mut widest = [0.0; WIDE];
        let mut pairs = products.iter_mut().zip(&mut *along);
        for (i, first) in around.iter().enumerate() {
            for second in &around[i + 1..] {
                let (products, along) = pairs.next().expect("one for every pair");
                for l in 0..WIDE {
                    let normal = product(of(first, l), of(second, l));
                    for c in 0..3 {
                        products[c][l] = normal[c];
                    }
                    along[l] = dot(of(way, l), normal);
                    let square = dot(normal, normal);
                    widest[l] = if square > widest[l] {
                        square
                    } else {
                        widest[l]
                    };
                }
            }
        }
        let pair = |i: usize, j: usize| i * (2 * count - i - 1) / 2 + j - i - 1;
        // The largest quotient volume/sum, compared by cross-multiplication so that the loop has no division.
        let [mut volumes, mut thickest] = [[0.0; WIDE]; 2];
        let mut sums = [1.0; WIDE];
        for i in 0..count {
            for j in i + 1..count {
                let (normals, first) = (&products[pair(i, j)], &along[pair(i, j)]);
                for k in j + 1..count {
                    let (second, third) = (&along[pair(j, k)], &along[pair(i, k)]);
                    let (a, b, c, others) = (&lengths[i], &lengths[j], &lengths[k], &around[k]);
                    for l in 0..WIDE {
                        let volume = dot(of(normals, l), of(others, l));
                        let side = if volume > 0.0 { 1.0 } else { -1.0 };
                        let (x, y, z) = (side * first[l], side * second[l], -side * third[l]);
                        let (volume, sum) = (side * volume, x + y + z);
                        let solid = volume > ROUNDOFF * (a[l] * b[l] * c[l]);
                        let inside = (x >= 0.0) & (y >= 0.0) & (z >= 0.0) & solid;
                        let later = inside & (volume * sums[l] > volumes[l] * sum);
                        volumes[l] = if later { volume } else { volumes[l] };
                        sums[l] = if later { sum } else { sums[l] };
                        let thick = solid & (volume > thickest[l]);
                        thickest[l] = if thick { volume } else { thickest[l] };
                    }
                }
            }
        }
        std::array::from_fn(|l| {
            let solid = thickest[l] > tolerance[l] * widest[l].sqrt();
            if solid {
                volumes[l] / sums[l]
            } else {
                f64::NAN
            }
        })
    }

    /// Hulls that are triangles (area), segments (line) or a single point.
    fn exit_flat(&self, way: &[Wide; 3], tolerance: Wide) -> Wide {
        std::array::from_fn(|l| {
            let (w, tolerance) = (of(way, l), tolerance[l]);
            let point = tolerance / dot(w, w).sqrt();
            let [mut line, mut area, mut longest, mut widest] = [0.0_f64; 4];
            let mut normals = self.products.iter();
            for i in 0..self.count {
                let (a, length) = (of(&self.around[i], l), self.lengths[i][l]);
                let t = dot(w, a) / dot(a, a);
                let rest = [0, 1, 2].map(|c| w[c] - t * a[c]);
                if t > 0.0 {
                    line = line.max((1.0 / t).min(tolerance / dot(rest, rest).sqrt()));
                }
                longest = longest.max(length);
                for j in i + 1..self.count {
                    let b = of(&self.around[j], l);
                    let normal = of(normals.next().expect("one for every pair"), l);
                    let square = dot(normal, normal);
                    let size = square.sqrt();
                    if size > ROUNDOFF * length * self.lengths[j][l] {
                        let first = dot(product(w, b), normal);
                        let second = dot(product(a, w), normal);
                        let near = tolerance * size / dot(w, normal).abs();
                        if first >= 0.0 && second >= 0.0 {
                            area = area.max((square / (first + second)).min(near));
                        }
                        widest = widest.max(size);
                    }
                }
            }
            if !point.is_finite() {
                // The colour is missing or equal to the target: it stays.
                1.0
            } else if widest > tolerance * longest {
                area
            } else if longest > tolerance {
                line
            } else {
                point
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn color() -> impl Strategy<Value = Color> {
        prop::array::uniform3(-3_i8..=3).prop_map(|c| c.map(f32::from))
    }

    /// True if a colour with up to 25 neighbours is inside their 26-DOP.
    fn stays_in_slabs(around: &[Color], color: Color, target: Color) -> bool {
        let mut rows = [[[f32::NAN; SEGMENT + LANES]; 3]; 5];
        for (i, tap) in around.iter().enumerate() {
            for c in 0..3 {
                rows[i / 5][c][i % 5] = tap[c];
            }
        }
        let [target, mut color] = [target, color].map(|color| color.map(|c| [c; SEGMENT]));
        enter_slabs(
            1,
            rows.each_ref().map(|row| row.each_ref()),
            &target,
            &mut color,
        );
        color[0][0].is_nan()
    }

    /// True if a colour is inside the exact hull of its up to 24 neighbours and its target.
    fn stays_in_hull(around: &[Color], color: Color, target: Color) -> bool {
        let mut rows = [[[f32::NAN; SEGMENT + LANES]; 3]; 5];
        for i in 0..25 {
            // The target is in the middle.
            let tap = match i {
                12 => Some(&target),
                _ => around.get(i - usize::from(i > 12)),
            };
            for c in 0..3 {
                rows[i / 5][c][i % 5] = tap.map_or(f32::NAN, |tap| tap[c]);
            }
        }
        let [target, mut color] = [target, color].map(|color| color.map(|c| [c; SEGMENT]));
        enter_hulls(
            1,
            rows.each_ref().map(|row| row.each_ref()),
            &target,
            &mut color,
        );
        color[0][0].is_nan()
    }

    proptest! {
        /// Small integers: collinear points are common and arithmetic is exact.
        #[test]
        fn colors_are_inside_their_hulls(colors in prop::collection::vec(color(), 1..25), target in 0_usize..25) {
            let target = colors[target % colors.len()];
            for &color in &colors {
                prop_assert_eq!(Polygon::of(&colors).enter(color, target), None);
                prop_assert!(stays_in_slabs(&colors, color, target));
                prop_assert!(stays_in_hull(&colors, color, target));
            }
        }

        #[test]
        fn few_points_are_their_segment(a in color(), b in color(), far in color()) {
            let hull = Polygon::of(&[a, b, a, b]);
            let entered = hull.enter(far, a).unwrap_or(far);
            let [a, b, p] = [a, b, entered].map(|c| [f64::from(c[1]), f64::from(c[2])]);
            prop_assert!(cross(a, b, p).abs() < 1e-5);
            prop_assert!(a == b || (-1e-5..=1.0 + 1e-5).contains(&(ahead(a, b, p) / ahead(a, b, b))));
        }
    }
}
