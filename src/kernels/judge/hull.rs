//! Convex hulls of a few colours, and where a segment enters them.
//!
//! - [`Polygon`]: the exact hull of chrominances, with the range of the first coordinate. Points are float32, products
//!   of their differences are taken in float64, so that collinear points are found to be. A hull of two points is their
//!   segment, of one the point.
//! - [`enter_hulls`]: the exact hull of the colours. With the target as origin, a way w leaves the hull of the colours q at
//!   the share t = max 1/Σμ over all w = Σ μ q, μ ≥ 0. By linear programming a maximum needs no more than three of the
//!   colours: all triples are tried, and by Cramer's rule each is one determinant and three shared with others. A hull
//!   thinner than a millionth of the largest coordinate counts as flat: then the same holds for pairs in the plane, and
//!   for single colours in line, of ways that stay as near to their triangles with the target, or segments. In float64.
//! - [`enter_slabs`]: the smallest intersection of slabs along thirteen directions (a 26-DOP: axes and diagonals of the cube)
//!   that holds the colours. It contains their exact hull, and needs no more than minima and maxima.

use crate::image::SEGMENT;
use crate::pixels::{Columns, LANES, Row, larger, smaller};

type Color = [f32; 3];

/// Where a segment leaves: the share of the way from `inside` to `outside`, from the signed distances of both ends.
#[inline(always)]
fn crossing(outside: f32, inside: f32) -> f32 {
    // The end inside is so by construction; rounding may say otherwise.
    let inside = larger(inside, 0.0);
    inside / (inside - outside)
}

/// From the target, which is near, rather than from the colour: a colour far out has no digits left for its goal.
#[inline(always)]
pub fn toward(color: Color, target: Color, t: f32) -> Color {
    [0, 1, 2].map(|c| target[c] + t * (color[c] - target[c]))
}

pub struct Polygon {
    /// Corners in order, of the second and third coordinate.
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
        // A handful, of which no two orders differ in the result.
        for i in 1..points.len() {
            for j in (1..=i).rev() {
                let [a, b] = [points[j - 1], points[j]];
                if (a[0], a[1]) > (b[0], b[1]) {
                    points.swap(j - 1, j);
                }
            }
        }
        // The lower chain from left to right, the upper one back (Andrew 1979).
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
        // The first corner stands at the end again.
        if hull.count > 1 {
            hull.count -= 1;
        }
        hull
    }

    /// Adds a corner to the chain from `start` on, without those before it that it makes superfluous.
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

/// Positive where c lies to the left of the line from a to b.
#[inline(always)]
fn cross(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Positive where c lies beyond a in the direction of b.
#[inline(always)]
fn ahead(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[0] - a[0]) + (b[1] - a[1]) * (c[1] - a[1])
}

impl Polygon {
    /// The colour on the way to a target inside where it enters the hull; `None` where it is inside.
    #[inline(always)]
    pub fn enter(&self, color: Color, target: Color) -> Option<Color> {
        let [from, to] = [color, target].map(|c| [f64::from(c[1]), f64::from(c[2])]);
        // The least share of the way from target to colour at which a bound is crossed.
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

/// Along the axes first.
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

/// Brings each of `n` colours to where it enters the hull of the colours around it, on the way to its target inside; NaN
/// for those that are inside, or have no others around.
#[inline(always)]
pub fn enter_slabs<const N: usize>(
    n: usize,
    rows: [[&Columns; 3]; N],
    [t0, t1, t2]: &[Row; 3],
    [c0, c1, c2]: &mut [Row; 3],
) {
    let n = n.min(SEGMENT);
    let mut shares = [f32::INFINITY; SEGMENT];
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
            let share = smaller(crossing(outside, inside), shares[i]);
            let leaves = (outside < 0.0) & (low <= high);
            shares[i] = if leaves { share } else { shares[i] };
        }
    }
    for i in 0..n {
        let (color, target) = ([c0[i], c1[i], c2[i]], [t0[i], t1[i], t2[i]]);
        let entered = toward(color, target, shares[i]);
        let moves = shares[i] < f32::INFINITY;
        [c0[i], c1[i], c2[i]] = entered.map(|c| if moves { c } else { f32::NAN });
    }
}

/// Pixels whose hulls are found at once.
const WIDE: usize = 8;
type Wide = [f64; WIDE];
/// Colours around the middle one.
const MOST: usize = 24;
/// How thick a hull is that counts as flat, as a share of the largest coordinate, and how near to it is inside.
const ROOM: f64 = 1e-6;
/// Volumes and areas that are no more than rounding, relative to the lengths of their edges.
const LEAST: f64 = 1e-12;

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

/// Brings each of `n` colours to where it enters the exact hull of the colours around it, on the way to its target inside;
/// NaN for those that are inside, or have no others around.
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
                // The middle one is the target, or missing.
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
        let shares = hulls.leave(&way, largest.map(|largest| ROOM * largest));
        for l in 0..WIDE {
            let i = start + l;
            let color = [colors[0][i], colors[1][i], colors[2][i]];
            let target = [targets[0][i], targets[1][i], targets[2][i]];
            let entered = toward(color, target, shares[l] as f32);
            let moves = shares[l] < 1.0;
            for c in 0..3 {
                colors[c][i] = if moves { entered[c] } else { f32::NAN };
            }
        }
    }
}

/// The colours around some pixels from their targets, and what is made of them.
struct Hulls {
    count: usize,
    around: [[Wide; 3]; MOST],
    lengths: [Wide; MOST],
    /// Of every pair, in order, the cross product; and how much of it is along the way.
    products: Vec<[Wide; 3]>,
    along: Vec<Wide>,
}

impl Hulls {
    fn new(count: usize) -> Self {
        let pairs = count * (count - 1) / 2;
        Self {
            count,
            around: [[[0.0; WIDE]; 3]; MOST],
            lengths: [[0.0; WIDE]; MOST],
            products: vec![[[0.0; WIDE]; 3]; pairs],
            along: vec![[0.0; WIDE]; pairs],
        }
    }

    /// Where ways from the targets leave the hulls, as shares of the ways, which may be left by some room where hulls
    /// are flat.
    #[inline(always)]
    fn leave(&mut self, way: &[Wide; 3], room: Wide) -> Wide {
        let mut shares = self.leave_solid(way, room);
        if shares.iter().any(|share| share.is_nan()) {
            let flat = self.leave_flat(way, room);
            for (share, flat) in shares.iter_mut().zip(flat) {
                *share = if share.is_nan() { flat } else { *share };
            }
        }
        shares
    }

    /// NaN where hulls are flat.
    #[inline(always)]
    fn leave_solid(&mut self, way: &[Wide; 3], room: Wide) -> Wide {
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
                let (products, along) = pairs.next().expect("room for every pair");
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
        // The largest share is a quotient, so that nothing is divided on the way.
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
                        let solid = volume > LEAST * (a[l] * b[l] * c[l]);
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
            let solid = thickest[l] > room[l] * widest[l].sqrt();
            if solid {
                volumes[l] / sums[l]
            } else {
                f64::NAN
            }
        })
    }

    /// By points, segments and triangles, whichever the colours are.
    fn leave_flat(&self, way: &[Wide; 3], room: Wide) -> Wide {
        std::array::from_fn(|l| {
            let (w, room) = (of(way, l), room[l]);
            let point = room / dot(w, w).sqrt();
            let [mut line, mut area, mut longest, mut widest] = [0.0_f64; 4];
            let mut normals = self.products.iter();
            for i in 0..self.count {
                let (a, length) = (of(&self.around[i], l), self.lengths[i][l]);
                let share = dot(w, a) / dot(a, a);
                let rest = [0, 1, 2].map(|c| w[c] - share * a[c]);
                if share > 0.0 {
                    line = line.max((1.0 / share).min(room / dot(rest, rest).sqrt()));
                }
                longest = longest.max(length);
                for j in i + 1..self.count {
                    let b = of(&self.around[j], l);
                    let normal = of(normals.next().expect("one for every pair"), l);
                    let square = dot(normal, normal);
                    let size = square.sqrt();
                    if size > LEAST * length * self.lengths[j][l] {
                        let first = dot(product(w, b), normal);
                        let second = dot(product(a, w), normal);
                        let near = room * size / dot(w, normal).abs();
                        if first >= 0.0 && second >= 0.0 {
                            area = area.max((square / (first + second)).min(near));
                        }
                        widest = widest.max(size);
                    }
                }
            }
            if !point.is_finite() {
                // A colour that is missing stays so, and so does one that is the target.
                1.0
            } else if widest > room * longest {
                area
            } else if longest > room {
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

    /// Whether a colour that has these around it, up to 25, stays.
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

    /// Whether a colour that has these around it, up to 24, and its target stays in their exact hull.
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
        /// On small whole numbers, where collinear points are common and nothing is rounded.
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
