//! Jitter: where in its pixel each frame takes its sample.
//!
//! - **halton**: radical inverses of 1, 2, 3 … in bases 2 and 3 (Halton 1964).
//! - **r2**: ½ + n (1/ρ, 1/ρ²) modulo 1, with ρ³ = ρ + 1 (Roberts 2018, *The Unreasonable Effectiveness of Quasirandom
//!   Sequences*).
//! - **rotated-grid**: a lattice with one point in each of n columns and n rows, y = (a·column mod n), with the a that
//!   keeps the points farthest apart when the pixel is repeated; for 5, 10, 13 … it is a rotated square grid. Four points
//!   are those of 4× rotated-grid multisampling. From left to right.
//! - **blue-noise**: the same points, each next one farthest from all before it, so that every beginning is spread out.
//!
//! Output: offsets from the pixel's centre, in pixels, in [−½, ½).

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sequence {
    Halton,
    R2,
    RotatedGrid,
    BlueNoise,
}

impl Sequence {
    pub const NAMES: [(&str, Self); 4] = [
        ("halton", Self::Halton),
        ("r2", Self::R2),
        ("rotated-grid", Self::RotatedGrid),
        ("blue-noise", Self::BlueNoise),
    ];
}

type Point = [f64; 2];

/// The first `count` offsets, of which the last two sequences have no more.
pub fn jitter(count: usize, sequence: Sequence) -> Vec<Point> {
    let points = match sequence {
        Sequence::Halton => (1..=count)
            .map(|n| [radical_inverse(n, 2), radical_inverse(n, 3)])
            .collect(),
        Sequence::R2 => (1..=count).map(r2).collect(),
        Sequence::RotatedGrid => rotated_grid(count),
        Sequence::BlueNoise => spread(rotated_grid(count)),
    };
    points
        .into_iter()
        .map(|p: Point| p.map(|v| v - 0.5))
        .collect()
}

fn radical_inverse(mut n: usize, base: usize) -> f64 {
    let (mut inverse, mut place) = (0.0, 1.0);
    while n > 0 {
        place /= base as f64;
        inverse += place * (n % base) as f64;
        n /= base;
    }
    inverse
}

fn r2(n: usize) -> Point {
    const RHO: f64 = 1.324_717_957_244_746;
    [RHO, RHO * RHO].map(|step| (0.5 + n as f64 / step).fract())
}

fn rotated_grid(count: usize) -> Vec<Point> {
    let rows: Vec<usize> = match count {
        4 => vec![2, 0, 3, 1],
        _ => lattice(count),
    };
    let place = |i: usize| (i as f64 + 0.5) / count as f64;
    rows.into_iter()
        .enumerate()
        .map(|(column, row)| [place(column), place(row)])
        .collect()
}

/// The row of each column's point.
fn lattice(count: usize) -> Vec<usize> {
    let rows = |a: usize| (0..count).map(move |column| a * column % count);
    // A lattice looks the same from each of its points: the nearest to the first is the nearest to any.
    let nearest = |a: usize| {
        let apart = |d: usize| d.min(count - d).pow(2);
        rows(a)
            .enumerate()
            .skip(1)
            .map(|(column, row)| apart(column) + apart(row))
            .min()
    };
    // Every row is taken once when a and the count have no common divisor.
    let coprime = |&a: &usize| (2..=a).all(|d| !(a.is_multiple_of(d) && count.is_multiple_of(d)));
    // The smallest of equals; `max_by_key` alone would take the last.
    let best = (1..=count / 2)
        .rev()
        .filter(coprime)
        .max_by_key(|&a| nearest(a))
        .unwrap_or(0);
    rows(best).collect()
}

/// Orders points so that each is as far as can be from all before it, the pixel being repeated.
fn spread(mut points: Vec<Point>) -> Vec<Point> {
    let distance = |a: Point, b: Point| -> f64 {
        [0, 1]
            .map(|c| (a[c] - b[c]).abs())
            .map(|d| d.min(1.0 - d).powi(2))
            .iter()
            .sum()
    };
    for next in 1..points.len() {
        let nearest = |i: usize| {
            points[..next]
                .iter()
                .map(|&p| distance(p, points[i]))
                .fold(f64::MAX, f64::min)
        };
        // Equal but for rounding counts as equal, of which the first is taken.
        let best = (next + 1..points.len()).fold(next, |best, i| {
            if nearest(i) > nearest(best) + 1e-9 {
                i
            } else {
                best
            }
        });
        points[next..=best].rotate_right(1);
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grids_have_one_point_in_each_row_and_column() {
        for count in 1..200 {
            for sequence in [Sequence::RotatedGrid, Sequence::BlueNoise] {
                let points = jitter(count, sequence);
                for axis in 0..2 {
                    let mut cells: Vec<_> = points
                        .iter()
                        .map(|p| ((p[axis] + 0.5) * count as f64).floor() as usize)
                        .collect();
                    cells.sort_unstable();
                    assert!(cells.into_iter().eq(0..count), "{count} {sequence:?}");
                }
            }
        }
    }

    #[test]
    fn five_points_are_a_rotated_square_grid() {
        assert_eq!(lattice(5), [0, 2, 4, 1, 3]);
        assert_eq!(lattice(10), [0, 3, 6, 9, 2, 5, 8, 1, 4, 7]);
    }
}
