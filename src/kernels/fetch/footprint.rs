//! Where a pixel's history lies in the previous frame, and which of those pixels may be used.

use glam::Vec2;

use crate::image::{Size, View};
use crate::kernels::judge::surface::{Expected, Tests, rejection};

/// Below this share of valid weight, a footprint says too little (Falcor's SVGF has the same bound).
pub const MIN_COVERAGE: f32 = 0.01;

/// How history is read between pixel centres.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filter {
    Nearest,
    Bilinear,
}

/// Up to `N` taps with their weights.
pub struct Taps<const N: usize> {
    taps: [(usize, f32); N],
    count: usize,
}

impl<const N: usize> Taps<N> {
    #[inline(always)]
    fn empty() -> Self {
        Self {
            taps: [(0, 0.0); N],
            count: 0,
        }
    }

    #[inline(always)]
    fn push(&mut self, index: usize, weight: f32) {
        self.taps[self.count] = (index, weight);
        self.count += 1;
    }

    #[inline(always)]
    pub fn as_slice(&self) -> &[(usize, f32)] {
        &self.taps[..self.count]
    }

    #[inline(always)]
    pub fn weight(&self) -> f32 {
        // Not `sum`, whose zero is negative.
        self.as_slice()
            .iter()
            .fold(0.0, |sum, &(_, weight)| sum + weight)
    }
}

/// The motion of a frame, applied to its pixels.
#[derive(Clone, Copy)]
pub struct Motion<'a> {
    x: &'a [f32],
    y: &'a [f32],
    depth: Option<&'a [f32]>,
    size: Size,
}

/// A pixel's place in the previous frame, in index space (pixel centres at whole numbers).
pub struct Origin {
    pub from: Vec2,
    pub expected: Expected,
}

impl<'a> Motion<'a> {
    pub fn new(motion: View<'a>) -> Self {
        let depth = (motion.channels == 3).then(|| motion.plane(2));
        Self {
            x: motion.plane(0),
            y: motion.plane(1),
            depth,
            size: motion.size,
        }
    }

    pub fn size(&self) -> Size {
        self.size
    }

    #[inline(always)]
    pub fn origin(&self, x: usize, y: usize, tests: &Tests) -> Origin {
        let i = y * self.size.width + x;
        let change = self.depth.map_or(0.0, |depth| depth[i]);
        // Motion that is not finite in one of its channels leads nowhere.
        let known = if change.is_finite() { 0.0 } else { f32::NAN };
        let from = Vec2::new(x as f32 + self.x[i] + known, y as f32 + self.y[i]);
        Origin {
            from,
            expected: tests.expected(i, from, change),
        }
    }
}

/// The taps of `filter` around an origin that lie inside, pass the tests, and that `usable` accepts; and the bits of
/// the tests that the others fail.
#[inline(always)]
pub fn footprint(
    size: Size,
    origin: &Origin,
    tests: &Tests,
    filter: Filter,
    usable: impl Fn(usize) -> bool,
) -> (Taps<4>, u8) {
    let mut taps = Taps::empty();
    if !reaches(size, origin.from) {
        return (taps, rejection::OUTSIDE);
    }
    let corner = match filter {
        Filter::Nearest => (origin.from + 0.5).floor(),
        Filter::Bilinear => origin.from.floor(),
    };
    let f = if filter == Filter::Nearest {
        Vec2::ZERO
    } else {
        origin.from - corner
    };
    let (left, top) = (corner.x as i32, corner.y as i32);
    let mut failed = 0;
    for (dx, dy, weight) in [
        (0, 0, (1.0 - f.x) * (1.0 - f.y)),
        (1, 0, f.x * (1.0 - f.y)),
        (0, 1, (1.0 - f.x) * f.y),
        (1, 1, f.x * f.y),
    ] {
        if weight > 0.0 {
            let failures = judge(size, origin, tests, left + dx, top + dy);
            failed |= failures.err().unwrap_or(0);
            if let Ok(index) = failures
                && usable(index)
            {
                taps.push(index, weight);
            }
        }
    }
    (taps, failed)
}

/// The usable taps of the 3×3 window around an origin, with equal weights: for thin geometry whose own pixels the
/// 2×2 footprint missed.
#[inline(always)]
pub fn window(
    size: Size,
    origin: &Origin,
    tests: &Tests,
    usable: impl Fn(usize) -> bool,
) -> Taps<9> {
    let mut taps = Taps::empty();
    if !reaches(size, origin.from) {
        return taps;
    }
    let centre = (origin.from + 0.5).floor();
    for dy in -1..=1 {
        for dx in -1..=1 {
            if let Ok(index) = judge(
                size,
                origin,
                tests,
                centre.x as i32 + dx,
                centre.y as i32 + dy,
            ) && usable(index)
            {
                taps.push(index, 1.0 / 9.0);
            }
        }
    }
    taps
}

/// Whether any tap can lie inside; false for NaN. Bounds the numbers that are turned into integers.
#[inline(always)]
fn reaches(size: Size, from: Vec2) -> bool {
    from.x > -2.0
        && from.y > -2.0
        && from.x < size.width as f32 + 1.0
        && from.y < size.height as f32 + 1.0
}

/// The index of pixel (x, y), or the bits of the tests that it fails.
#[inline(always)]
fn judge(size: Size, origin: &Origin, tests: &Tests, x: i32, y: i32) -> Result<usize, u8> {
    if x < 0 || y < 0 || x >= size.width as i32 || y >= size.height as i32 {
        return Err(rejection::OUTSIDE);
    }
    let (x, y) = (x as usize, y as usize);
    match tests.failures(&origin.expected, x, y) {
        0 => Ok(y * size.width + x),
        failures => Err(failures),
    }
}
