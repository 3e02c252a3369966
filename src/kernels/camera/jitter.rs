//! Jitter: where in its pixel each frame takes its sample.
//!
//! - **halton**: radical inverses of 1, 2, 3 … in bases 2 and 3 (Halton and Smith 1964).
//! - **r2**: ½ + n (1/ρ, 1/ρ²) modulo 1, with ρ³ = ρ + 1 (Roberts 2018, *The Unreasonable Effectiveness of Quasirandom
//!   Sequences*).
//! - **rotated-grid**: a lattice with one point in each of n columns and n rows, y = (a·column mod n), with the a that
//!   maximises the smallest (toroidal) distance; for n = 5, 10, 13 … it is a rotated square grid. For n = 4 it is the
//!   pattern of 4× rotated-grid multisampling. Ordered from left to right.
//! - **blue-noise**: the same points reordered, each farthest from all before it, so that every prefix is well spread.
//!
//! Output: offsets from the pixel's centre, in pixels, in [−½, ½).

/// Where the offsets come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sequence {
    /// Radical inverses in bases 2 and 3.
    Halton,
    /// Roberts's additive recurrence.
    R2,
    /// A lattice, from left to right.
    RotatedGrid,
    /// The same lattice, each point farthest from all before it.
    BlueNoise,
}

impl Sequence {
    /// Their names.
    pub const NAMES: [(&str, Self); 4] = [
        ("halton", Self::Halton),
        ("r2", Self::R2),
        ("rotated-grid", Self::RotatedGrid),
        ("blue-noise", Self::BlueNoise),
    ];
}

type Point = [f64; 2];

/// The first `count` offsets; rotated-grid and blue-noise depend on `count` and end there. `go_on` is polled; its error
/// cancels long computations.
pub fn jitter<E>(
    count: usize,
    sequence: Sequence,
    mut go_on: impl FnMut() -> Result<(), E>,
) -> Result<Vec<Point>, E> {
    let points: Vec<Point> = match sequence {
        Sequence::Halton => (1..=count)
            .map(|n| [radical_inverse(n, 2), radical_inverse(n, 3)])
            .collect(),
        Sequence::R2 => (1..=count).map(r2).collect(),
        Sequence::RotatedGrid => rotated_grid(count, &mut go_on)?,
        Sequence::BlueNoise => spread(rotated_grid(count, &mut go_on)?, &mut go_on)?,
    };
    Ok(points.into_iter().map(|p| p.map(|v| v - 0.5)).collect())
}

/// Steps, each O(count), between two polls of `go_on`.
const STEPS: usize = 256;

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

fn rotated_grid<E>(
    count: usize,
    go_on: &mut impl FnMut() -> Result<(), E>,
) -> Result<Vec<Point>, E> {
    let rows: Vec<usize> = match count {
        4 => vec![2, 0, 3, 1],
        _ => lattice(count, go_on)?,
    };
    let place = |i: usize| (i as f64 + 0.5) / count as f64;
    Ok(rows
        .into_iter()
        .enumerate()
        .map(|(column, row)| [place(column), place(row)])
        .collect())
}

/// The rows of the lattice's points, column by column.
fn lattice<E>(count: usize, go_on: &mut impl FnMut() -> Result<(), E>) -> Result<Vec<usize>, E> {
    let rows = |a: usize| (0..count).map(move |column| a * column % count);
    // A lattice looks the same from each of its points: the nearest to the first is the nearest to any.
    let distances = |a: usize| {
        let apart = |d: usize| d.min(count - d).pow(2);
        (rows(a).enumerate().skip(1)).map(move |(column, row)| apart(column) + apart(row))
    };
    // Each row holds exactly one point if and only if a and the count are coprime.
    fn divisor(a: usize, b: usize) -> usize {
        if b == 0 { a } else { divisor(b, a % b) }
    }
    let (mut best, mut nearest) = (0, 0);
    for a in 1..=count / 2 {
        if a % STEPS == 0 {
            go_on()?;
        }
        // `>`: the smallest a wins ties.
        if divisor(a, count) == 1 && distances(a).all(|distance| distance > nearest) {
            (best, nearest) = (a, distances(a).min().unwrap_or_default());
        }
    }
    Ok(rows(best).collect())
}

/// Orders points so that each has the largest toroidal distance to all before it.
fn spread<E>(
    mut points: Vec<Point>,
    go_on: &mut impl FnMut() -> Result<(), E>,
) -> Result<Vec<Point>, E> {
    let distance = |a: Point, b: Point| -> f64 {
        [0, 1]
            .map(|c| (a[c] - b[c]).abs())
            .map(|d| d.min(1.0 - d).powi(2))
            .iter()
            .sum()
    };
    // Squared distance of each point to the nearest of those before `next`.
    let mut nearest = vec![f64::MAX; points.len()];
    for next in 1..points.len() {
        if next % STEPS == 0 {
            go_on()?;
        }
        let last = points[next - 1];
        for (nearest, &point) in nearest.iter_mut().zip(&points).skip(next) {
            *nearest = nearest.min(distance(last, point));
        }
        // The tolerance makes distances that differ by rounding equal: the first point wins ties.
        let best = (next + 1..points.len()).fold(next, |best, i| {
            if nearest[i] > nearest[best] + 1e-9 {
                i
            } else {
                best
            }
        });
        points[next..=best].rotate_right(1);
        nearest[next..=best].rotate_right(1);
    }
    Ok(points)
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use super::*;

    fn lattice(count: usize) -> Vec<usize> {
        super::lattice(count, &mut || Ok::<_, Infallible>(())).unwrap()
    }

    #[test]
    fn long_work_can_be_ended() {
        for sequence in [Sequence::RotatedGrid, Sequence::BlueNoise] {
            assert_eq!(jitter(4096, sequence, || Err("enough")), Err("enough"));
        }
    }

    #[test]
    fn grids_have_one_point_in_each_row_and_column() {
        for count in 1..200 {
            for sequence in [Sequence::RotatedGrid, Sequence::BlueNoise] {
                let points = jitter(count, sequence, || Ok::<_, Infallible>(())).unwrap();
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
