//! Boxes around a neighbourhood's colours: ranges and deviations of 3×3 or 5×5 pixels, for [`super::neighborhood`].
//!
//! All are separable: columns first, then across columns. Variances are merged by the formula of Chan, Golub and LeVeque
//! 1983, *Algorithms for Computing the Sample Variance*, since a mean of squares would cancel.

use super::hull::toward;
use crate::image::SEGMENT;
use crate::lanes::LANES;
use crate::math::{Color, larger, smaller};
use crate::pixels::{Columns, Row};

/// The bounds of a neighbourhood, to which history is clipped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bounds {
    /// The range of each channel.
    MinMax,
    /// The mean of the ranges of the square and of the cross.
    Rounded,
    /// The mean ± γ standard deviations.
    Variance,
    /// The intersection of range and variance box.
    Intersection,
    /// A polytope of thirteen slabs around the convex hull.
    Hull,
    /// The convex hull.
    ExactHull,
    /// The convex hull in chrominance, with the range of Y.
    ChromaHull,
}

impl Bounds {
    pub(super) fn is_hull(self) -> bool {
        matches!(self, Self::Hull | Self::ExactHull | Self::ChromaHull)
    }
}

/// Tolerance of the inside test, relative to the box's largest coordinate: rounding must not decide where a neighbourhood
/// is flat along an axis.
const TOLERANCE: f32 = 1e-6;

/// Statistics of a span's neighbourhoods, structure of arrays.
pub(super) struct Boxes {
    pub count: Row,
    pub mean: [Row; 3],
    pub deviation: [Row; 3],
    pub low: [Row; 3],
    pub high: [Row; 3],
    sums: ColumnSums,
    ranges: ColumnRanges,
}

/// Statistics of single columns of height N, from which those of N×N neighbourhoods are merged.
struct ColumnSums {
    count: Columns,
    sum: [Columns; 3],
    mean: [Columns; 3],
    /// Sum of squared deviations from the column's mean.
    squares: [Columns; 3],
}

impl ColumnSums {
    #[inline(always)]
    fn find<const N: usize>(&mut self, n: usize, rows: [[&Columns; 3]; N]) {
        for i in 0..n.min(SEGMENT) + LANES {
            // Conversion made a missing colour NaN in every channel, so one channel tells.
            let mut there = [true; N];
            let mut count = 0.0;
            for k in 0..N {
                there[k] = !rows[k][0][i].is_nan();
                count += if there[k] { 1.0 } else { 0.0 };
            }
            self.count[i] = count;
            let weight = reciprocal::<N>(count);
            for c in 0..3 {
                let mut sum = 0.0;
                for k in 0..N {
                    sum += if there[k] { rows[k][c][i] } else { 0.0 };
                }
                let mean = sum * weight;
                let mut squares = 0.0;
                for k in 0..N {
                    let off = rows[k][c][i] - mean;
                    squares += if there[k] { off * off } else { 0.0 };
                }
                self.sum[c][i] = sum;
                self.mean[c][i] = mean;
                self.squares[c][i] = squares;
            }
        }
    }
}

/// 1/count for counts up to `N`, by selects instead of a division; 1 for a count of 0.
#[inline(always)]
fn reciprocal<const N: usize>(count: f32) -> f32 {
    (2..=N).fold(1.0, |found, n| {
        if count == n as f32 {
            1.0 / n as f32
        } else {
            found
        }
    })
}

/// Minima and maxima of single columns.
struct ColumnRanges {
    low: [Columns; 3],
    high: [Columns; 3],
}

impl ColumnRanges {
    #[inline(always)]
    fn find<const N: usize>(&mut self, n: usize, rows: [[&Columns; 3]; N]) {
        for c in 0..3 {
            for i in 0..n.min(SEGMENT) + LANES {
                let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
                for row in rows {
                    let tap = row[c][i];
                    (low, high) = (smaller(tap, low), larger(tap, high));
                }
                (self.low[c][i], self.high[c][i]) = (low, high);
            }
        }
    }
}

impl Boxes {
    #[inline(always)]
    pub(super) fn new() -> Self {
        Self {
            count: [0.0; SEGMENT],
            mean: [[0.0; SEGMENT]; 3],
            deviation: [[0.0; SEGMENT]; 3],
            low: [[0.0; SEGMENT]; 3],
            high: [[0.0; SEGMENT]; 3],
            sums: ColumnSums {
                count: [0.0; _],
                sum: [[0.0; _]; 3],
                mean: [[0.0; _]; 3],
                squares: [[0.0; _]; 3],
            },
            ranges: ColumnRanges {
                low: [[0.0; _]; 3],
                high: [[0.0; _]; 3],
            },
        }
    }

    /// Computes the boxes of a span from the valid neighbours inside the image.
    #[inline(always)]
    pub(super) fn find<const N: usize>(
        &mut self,
        n: usize,
        rows: [[&Columns; 3]; N],
        bounds: Bounds,
        gamma: f32,
    ) {
        let n = n.min(SEGMENT);
        if bounds != Bounds::Variance {
            self.find_ranges(n, rows);
        }
        if bounds == Bounds::Rounded {
            self.round(n, rows);
        }
        match bounds {
            Bounds::Variance => self.find_deviations(n, rows, |mean, reach, _| {
                [mean - gamma * reach, mean + gamma * reach]
            }),
            Bounds::Intersection => self.find_deviations(n, rows, |mean, reach, [low, high]| {
                [
                    larger(low, mean - gamma * reach),
                    smaller(high, mean + gamma * reach),
                ]
            }),
            _ => {}
        }
    }

    #[inline(always)]
    pub(super) fn find_ranges<const N: usize>(&mut self, n: usize, rows: [[&Columns; 3]; N]) {
        self.ranges.find(n, rows);
        let columns = &self.ranges;
        for c in 0..3 {
            for i in 0..n {
                let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
                for dx in 0..N {
                    low = smaller(columns.low[c][i + dx], low);
                    high = larger(columns.high[c][i + dx], high);
                }
                (self.low[c][i], self.high[c][i]) = (low, high);
            }
        }
        for i in 0..n {
            self.count[i] = if self.low[0][i] <= self.high[0][i] {
                1.0
            } else {
                0.0
            };
        }
    }

    /// Averages the range of the square with that of the cross.
    #[inline(always)]
    pub(super) fn round<const N: usize>(&mut self, n: usize, rows: [[&Columns; 3]; N]) {
        let columns = &self.ranges;
        for c in 0..3 {
            for i in 0..n {
                let (mut low, mut high) = (columns.low[c][i + N / 2], columns.high[c][i + N / 2]);
                for dx in 0..N {
                    let tap = rows[N / 2][c][i + dx];
                    (low, high) = (smaller(tap, low), larger(tap, high));
                }
                // With the whole cross missing, keep the square's range.
                let some = low <= high;
                let half = |a: f32, b: f32| if some { 0.5 * (a + b) } else { a };
                self.low[c][i] = half(self.low[c][i], low);
                self.high[c][i] = half(self.high[c][i], high);
            }
        }
    }

    /// Computes means, deviations, and the bounds that `bounds` makes of them and the range.
    #[inline(always)]
    pub(super) fn find_deviations<const N: usize>(
        &mut self,
        n: usize,
        rows: [[&Columns; 3]; N],
        bounds: impl Fn(f32, f32, [f32; 2]) -> [f32; 2],
    ) {
        self.sums.find(n, rows);
        let columns = &self.sums;
        for i in 0..n {
            let mut count = 0.0;
            for dx in 0..N {
                count += columns.count[i + dx];
            }
            self.count[i] = count;
            let weight = 1.0 / count;
            for c in 0..3 {
                let mut sum = 0.0;
                for dx in 0..N {
                    sum += columns.sum[c][i + dx];
                }
                let mean = sum * weight;
                let mut squares = 0.0;
                for dx in 0..N {
                    let off = columns.mean[c][i + dx] - mean;
                    squares += columns.squares[c][i + dx] + columns.count[i + dx] * (off * off);
                }
                let deviation = (squares * weight).sqrt();
                let range = [self.low[c][i], self.high[c][i]];
                [self.low[c][i], self.high[c][i]] = bounds(mean, deviation, range);
                self.mean[c][i] = mean;
                self.deviation[c][i] = deviation;
            }
        }
    }

    /// Replaces each colour by what `clip` returns: the clipped colour, or NaN for a colour that stays.
    #[inline(always)]
    pub(super) fn clip_by(
        &self,
        n: usize,
        [c0, c1, c2]: &mut [Row; 3],
        clip: impl Fn(&Neighborhood, usize, Color) -> Color,
    ) {
        for i in 0..n.min(SEGMENT) {
            let color = [c0[i], c1[i], c2[i]];
            [c0[i], c1[i], c2[i]] = clip(&self.at(i), i, color);
        }
    }

    #[inline(always)]
    pub(super) fn at(&self, i: usize) -> Neighborhood {
        let of = |planes: &[Row; 3]| [planes[0][i], planes[1][i], planes[2][i]];
        let (low, high) = (of(&self.low), of(&self.high));
        let largest = (low.iter().zip(high)).fold(0.0_f32, |most, (low, high)| {
            larger(larger(most, low.abs()), high.abs())
        });
        let tolerance = TOLERANCE * largest;
        Neighborhood {
            empty: self.count[i] == 0.0,
            mean: of(&self.mean),
            deviation: of(&self.deviation),
            low,
            high,
            padded: [
                low.map(|low| low - tolerance),
                high.map(|high| high + tolerance),
            ],
            tolerance,
        }
    }
}

/// Statistics of one pixel's neighbourhood.
pub(super) struct Neighborhood {
    empty: bool,
    mean: Color,
    deviation: Color,
    low: Color,
    high: Color,
    /// The box, enlarged by the tolerance.
    padded: [Color; 2],
    tolerance: f32,
}

/// Each response returns the clipped colour, or NaN for a colour inside.
impl Neighborhood {
    #[inline(always)]
    pub(super) fn contains(&self, color: Color) -> bool {
        let [low, high] = self.padded;
        let inside = |c: usize| (low[c] <= color[c]) & (color[c] <= high[c]);
        self.empty | (inside(0) & inside(1) & inside(2))
    }

    #[inline(always)]
    pub(super) fn unless_inside(&self, color: Color, clipped: Color) -> Color {
        let inside = self.contains(color);
        clipped.map(|c| if inside { f32::NAN } else { c })
    }

    #[inline(always)]
    pub(super) fn clamped(&self, color: Color) -> Color {
        [0, 1, 2].map(|c| smaller(larger(color[c], self.low[c]), self.high[c]))
    }

    #[inline(always)]
    pub(super) fn center(&self) -> Color {
        [0, 1, 2].map(|c| 0.5 * (self.low[c] + self.high[c]))
    }

    #[inline(always)]
    pub(super) fn clamp(&self, color: Color) -> Color {
        let clamped = self.clamped(color);
        self.unless_inside(color, clamped)
    }

    #[inline(always)]
    pub(super) fn to_center(&self, color: Color) -> Color {
        let ([low, high], center) = (self.padded, self.center());
        // 0/0 where the colour is at the centre along an axis: `smaller` then keeps the other axes' t.
        let t = (0..3).fold(1.0, |t, c| {
            smaller(0.5 * (high[c] - low[c]) / (color[c] - center[c]).abs(), t)
        });
        let clipped = self.clamped([0, 1, 2].map(|c| center[c] + t * (color[c] - center[c])));
        self.unless_inside(color, clipped)
    }

    #[inline(always)]
    pub(super) fn to_current(&self, color: Color, own: Color) -> Color {
        let (center, clamped) = (self.center(), self.clamped(own));
        let missing = own[0].is_nan();
        let target = [0, 1, 2].map(|c| if missing { center[c] } else { clamped[c] });
        let [low, high] = self.padded;
        let exit = |c: usize| {
            let below = color[c] < low[c];
            let bound = if below { self.low[c] } else { self.high[c] };
            let t = (bound - target[c]) / (color[c] - target[c]);
            if below | (color[c] > high[c]) { t } else { 1.0 }
        };
        let t = smaller(exit(0), smaller(exit(1), exit(2)));
        let clipped = self.clamped(toward(color, target, t));
        self.unless_inside(color, clipped)
    }

    /// `axes` are the half-axes in standard deviations.
    #[inline(always)]
    pub(super) fn to_ellipsoid(&self, color: Color, axes: Color) -> Color {
        let v = [0, 1, 2].map(|c| {
            ratio(
                color[c] - self.mean[c],
                axes[c] * self.deviation[c] + self.tolerance,
            )
        });
        let length = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
        let clipped = [0, 1, 2].map(|c| self.mean[c] + (color[c] - self.mean[c]) / length);
        let moves = (length > 1.0) & !self.empty;
        clipped.map(|c| if moves { c } else { f32::NAN })
    }
}

/// |distance| / half_axis; 0/0 counts as 0.
#[inline(always)]
fn ratio(distance: f32, half_axis: f32) -> f32 {
    let ratio = distance.abs() / half_axis;
    if distance == 0.0 { 0.0 } else { ratio }
}
