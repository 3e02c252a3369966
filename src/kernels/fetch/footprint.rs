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
    /// A 4×4 kernel where all its taps may be used, bilinear elsewhere.
    Wide(Wide),
}

impl Filter {
    pub const NAMES: [(&str, Self); 5] = [
        ("nearest", Self::Nearest),
        ("bilinear", Self::Bilinear),
        ("catmull-rom", Self::Wide(Wide::CatmullRom)),
        ("catmull-rom-5", Self::Wide(Wide::CatmullRom5)),
        ("lanczos-2", Self::Wide(Wide::Lanczos2)),
    ];
}

/// Separable kernels of four taps a side, at −1, 0, 1 and 2 from the pixel before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wide {
    /// The cubic of Catmull and Rom, a = −½ (Keys 1981, *Cubic Convolution Interpolation for Digital Image Processing*).
    CatmullRom,
    /// The same without the four corners: what five bilinear look-ups of a GPU give (Jimenez 2016, *Filmic SMAA*).
    CatmullRom5,
    /// sinc(x) sinc(x/2), normalised by its sum.
    Lanczos2,
}

impl Wide {
    /// The weights of the taps from above on, row by row; 0 for those that do not count.
    #[inline(always)]
    pub fn matrix(self, f: Vec2) -> [[f32; 4]; 4] {
        let (along, down) = (self.weights(f.x), self.weights(f.y));
        let weight = |row: usize, column: usize| {
            if self.has(column, row) {
                along[column] * down[row]
            } else {
                0.0
            }
        };
        [0, 1, 2, 3].map(|row| [0, 1, 2, 3].map(|column| weight(row, column)))
    }

    #[inline(always)]
    fn weights(self, f: f32) -> [f32; 4] {
        if f == 0.0 {
            return [0.0, 1.0, 0.0, 0.0];
        }
        match self {
            Self::CatmullRom | Self::CatmullRom5 => {
                let (f2, f3) = (f * f, f * f * f);
                let w0 = f2 - 0.5 * (f3 + f);
                let w1 = 1.5 * f3 - 2.5 * f2 + 1.0;
                let w3 = 0.5 * (f3 - f2);
                [w0, w1, 1.0 - w0 - w1 - w3, w3]
            }
            Self::Lanczos2 => {
                // sin πx and sin πx/2 at the four distances 1 + f, f, 1 − f and 2 − f follow from those of f.
                let half = std::f32::consts::FRAC_PI_2 * f;
                let (s, c) = (libm::sinf(half), libm::cosf(half));
                let whole = 2.0 * s * c;
                let over = |x: f32, product: f32| product / (x * x);
                [
                    over(1.0 + f, -whole * c),
                    over(f, whole * s),
                    over(1.0 - f, whole * c),
                    over(2.0 - f, -whole * s),
                ]
            }
        }
    }

    #[inline(always)]
    fn has(self, column: usize, row: usize) -> bool {
        self != Self::CatmullRom5 || !(matches!(column, 0 | 3) && matches!(row, 0 | 3))
    }
}

/// The weights of the 2×2 taps at (0, 0), (1, 0), (0, 1) and (1, 1).
#[inline(always)]
pub fn bilinear(f: Vec2) -> [f32; 4] {
    [
        (1.0 - f.x) * (1.0 - f.y),
        f.x * (1.0 - f.y),
        (1.0 - f.x) * f.y,
        f.x * f.y,
    ]
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
        let motion = Vec2::new(self.x[i], self.y[i]);
        Origin {
            from,
            expected: tests.expected(i, from, motion, change),
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
        Filter::Bilinear | Filter::Wide(_) => origin.from.floor(),
    };
    let f = if filter == Filter::Nearest {
        Vec2::ZERO
    } else {
        origin.from - corner
    };
    let (left, top) = (corner.x as i32, corner.y as i32);
    let mut failed = 0;
    for ((dx, dy), weight) in [(0, 0), (1, 0), (0, 1), (1, 1)]
        .into_iter()
        .zip(bilinear(f))
    {
        if weight > 0.0 {
            match judge(size, origin, tests, left + dx, top + dy) {
                Ok((index, trust)) if usable(index) => taps.push(index, weight * trust),
                Ok(_) => {}
                Err(failures) => failed |= failures,
            }
        }
    }
    (taps, failed)
}

/// The taps of a wide kernel around an origin, if every one of them may be used.
#[inline(always)]
pub fn wide(
    size: Size,
    origin: &Origin,
    tests: &Tests,
    kernel: Wide,
    usable: impl Fn(usize) -> bool,
) -> Option<Taps<16>> {
    let mut taps = Taps::empty();
    if !reaches(size, origin.from) {
        return None;
    }
    let corner = origin.from.floor();
    let (left, top) = (corner.x as i32 - 1, corner.y as i32 - 1);
    let rows = kernel.matrix(origin.from - corner).into_iter();
    for (row, weights) in rows.enumerate() {
        for (column, weight) in weights.into_iter().enumerate() {
            if weight != 0.0 {
                let tap = judge(size, origin, tests, left + column as i32, top + row as i32);
                let (index, _) = tap.ok().filter(|&(index, _)| usable(index))?;
                taps.push(index, weight);
            }
        }
    }
    Some(taps)
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
            if let Ok((index, trust)) = judge(
                size,
                origin,
                tests,
                centre.x as i32 + dx,
                centre.y as i32 + dy,
            ) && usable(index)
            {
                taps.push(index, trust / 9.0);
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

/// The index of pixel (x, y) and the trust in it, or the bits of the tests that leave none.
#[inline(always)]
fn judge(size: Size, origin: &Origin, tests: &Tests, x: i32, y: i32) -> Result<(usize, f32), u8> {
    if x < 0 || y < 0 || x >= size.width as i32 || y >= size.height as i32 {
        return Err(rejection::OUTSIDE);
    }
    let (x, y) = (x as usize, y as usize);
    match tests.judge(&origin.expected, x, y) {
        (trust, 0) => Ok((y * size.width + x, trust)),
        (_, failures) => Err(failures),
    }
}
