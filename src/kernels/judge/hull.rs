//! Convex hulls of a few colours, and where a segment enters them.
//!
//! - [`Polygon`]: the exact hull of chrominances, with the range of the first coordinate. Points are float32, products
//!   of their differences are taken in float64, so that collinear points are found to be. A hull of two points is their
//!   segment, of one the point.
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

    proptest! {
        /// On small whole numbers, where collinear points are common and nothing is rounded.
        #[test]
        fn colors_are_inside_their_hulls(colors in prop::collection::vec(color(), 1..25), target in 0_usize..25) {
            let target = colors[target % colors.len()];
            for &color in &colors {
                prop_assert_eq!(Polygon::of(&colors).enter(color, target), None);
                prop_assert!(stays_in_slabs(&colors, color, target));
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
