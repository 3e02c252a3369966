//! Footprints: the taps of the previous frame that a pixel's history is filtered from, with weights and validation.
//!
//! Places, weights and validation pass through line buffers of [`SEGMENT`] pixels, which stay in the first-level cache. The
//! same 16 pixels at a time in registers was tried: as fast for bilinear taps and a fifth slower for cubic ones.

use super::spans::Spans;
use crate::image::{Run, SEGMENT, Size};
use crate::kernels::fetch::validate::{Expected, Places, Tests, Validation, rejection};
use crate::pixels::{MotionRun, Row};

/// A footprint whose valid taps have less weight than this counts as disoccluded (as in Falcor's SVGF).
pub const MIN_COVERAGE: f32 = 0.01;

/// How history is read between pixel centres.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filter {
    /// The nearest pixel.
    Nearest,
    /// The nearest 2×2 pixels.
    Bilinear,
    /// A 4×4 kernel where all its taps may be used, bilinear elsewhere.
    Wide(Wide),
}

impl Filter {
    /// Their names.
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
    /// The weights of the columns and of the rows, which together sum to one.
    pub(crate) fn weights(self, f: [f32; 2]) -> [[f32; 4]; 2] {
        match self {
            Self::CatmullRom | Self::CatmullRom5 => product(cubic, self.has_corners(), f),
            Self::Lanczos2 => product(lanczos, true, f),
        }
    }

    pub(crate) const fn has_corners(self) -> bool {
        !matches!(self, Self::CatmullRom5)
    }

    /// The columns that count in a row.
    #[inline(always)]
    pub(crate) fn columns(corners: bool, row: usize) -> std::ops::Range<usize> {
        if corners || matches!(row, 1 | 2) {
            0..4
        } else {
            1..3
        }
    }
}

/// The weights of the columns and of the rows at the distances `f` from the pixel before; the corners count or not.
#[inline(always)]
fn product(side: impl Fn(f32) -> [f32; 4], corners: bool, [x, y]: [f32; 2]) -> [[f32; 4]; 2] {
    let (along, [d0, d1, d2, d3]) = (exact(x, side(x)), exact(y, side(y)));
    let middle = along[1] + along[2];
    let all = along[0] + middle + along[3];
    let outer = if corners { all } else { middle };
    let scale = 1.0 / ((d0 + d3) * outer + (d1 + d2) * all);
    [along, [d0 * scale, d1 * scale, d2 * scale, d3 * scale]]
}

/// At f = 0 the weights are exactly 0, 1, 0, 0: a still image is copied bit for bit, and the sinc's 0/0 is avoided.
#[inline(always)]
fn exact(f: f32, [w0, w1, w2, w3]: [f32; 4]) -> [f32; 4] {
    let or = |still: f32, weight: f32| if f == 0.0 { still } else { weight };
    [or(0.0, w0), or(1.0, w1), or(0.0, w2), or(0.0, w3)]
}

/// Weights of a Catmull-Rom spline, for the pixels at −1, 0, 1 and 2.
#[inline(always)]
pub fn cubic(f: f32) -> [f32; 4] {
    let (f2, f3) = (f * f, f * f * f);
    let w0 = f2 - 0.5 * (f3 + f);
    let w1 = 1.5 * f3 - 2.5 * f2 + 1.0;
    let w3 = 0.5 * (f3 - f2);
    [w0, w1, 1.0 - w0 - w1 - w3, w3]
}

#[inline(always)]
fn lanczos(f: f32) -> [f32; 4] {
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

/// Taps of the previous frame, as index and weight.
pub(crate) struct Taps<const N: usize> {
    taps: [(usize, f32); N],
    count: usize,
}

impl<const N: usize> Taps<N> {
    /// The taps that have a weight and are `usable`.
    #[inline(always)]
    fn of(taps: impl Iterator<Item = (usize, f32)>, usable: impl Fn(usize) -> bool) -> Self {
        let mut found = Self {
            taps: [(0, 0.0); N],
            count: 0,
        };
        for (at, weight) in taps {
            if weight > 0.0 && usable(at) {
                found.taps[found.count] = (at, weight);
                found.count += 1;
            }
        }
        found
    }

    pub fn as_slice(&self) -> &[(usize, f32)] {
        &self.taps[..self.count]
    }

    pub fn weight(&self) -> f32 {
        // Not `sum`, whose zero is negative.
        self.as_slice()
            .iter()
            .fold(0.0, |sum, &(_, weight)| sum + weight)
    }
}

/// The 2×2 footprints of a run of pixels: upper left, upper right, lower left and lower right tap. The taps always lie
/// inside, so that they can be read without a test; where the true footprint lies outside, their weights are 0.
pub(crate) struct Footprints {
    size: Size,
    /// Reprojected position, in index space (pixel centres at whole numbers).
    from: [Row; 2],
    /// Position of the upper left tap.
    corner: [Row; 2],
    pub at: Row<u32>,
    pub spans: Spans,
    pub weights: [Row; 4],
    /// The sum of the weights.
    pub coverage: Row,
    /// The bits of the tests that taps failed.
    pub failed: Row<u32>,
    expected: Expected,
    validation: Validation,
}

impl Footprints {
    pub fn new(size: Size) -> Self {
        Self {
            size,
            from: [[0.0; SEGMENT]; 2],
            corner: [[0.0; SEGMENT]; 2],
            at: [0; SEGMENT],
            spans: Spans::none(),
            weights: [[0.0; SEGMENT]; 4],
            coverage: [0.0; SEGMENT],
            failed: [0; SEGMENT],
            expected: Expected::zeroed(),
            validation: Validation::zeroed(),
        }
    }

    /// Strides to the pixel on the right and to the pixel below.
    #[inline(always)]
    pub fn steps(&self) -> [usize; 2] {
        let Size { height, width } = self.size;
        [(width > 1).into(), if height > 1 { width } else { 0 }]
    }

    /// Finds and validates the 2×2 footprints of a run.
    #[inline(always)]
    pub fn find(&mut self, run: Run, motion: MotionRun, nearest: bool, tests: &Tests) {
        self.place(run, motion, nearest);
        if !tests.accept_all() {
            let from = self.from.each_ref().map(|lane| &lane[..run.len]);
            tests.expect(run, from, motion, &mut self.expected);
            self.validate(run.len, tests);
        }
        let coverage = &mut self.coverage[..run.len];
        let [w, x, y, z] = self.weights.each_ref().map(|lane| &lane[..run.len]);
        for i in 0..run.len {
            coverage[i] = w[i] + x[i] + y[i] + z[i];
        }
    }

    #[inline(always)]
    fn place(&mut self, run: Run, motion: MotionRun, nearest: bool) {
        let len = run.len;
        let [from_x, from_y] = self.from.each_mut().map(|lane| &mut lane[..len]);
        let (mx, my) = (&motion.x[..len], &motion.y[..len]);
        for i in 0..len {
            from_x[i] = (run.x as i32 + i as i32) as f32 + mx[i];
            from_y[i] = run.y as f32 + my[i];
        }
        if let Some(depth) = motion.depth {
            // Motion that is not finite in any channel leads outside.
            for (from, change) in from_x.iter_mut().zip(&depth[..len]) {
                *from = if change.is_finite() { *from } else { f32::NAN };
            }
        }
        let (width, height) = (self.size.width as f32, self.size.height as f32);
        let columns = self.size.width as u32;
        let [left, top] = self.corner.each_mut().map(|lane| &mut lane[..len]);
        let (at, failed) = (&mut self.at[..len], &mut self.failed[..len]);
        let [w, x, y, z] = self.weights.each_mut().map(|lane| &mut lane[..len]);
        for i in 0..len {
            let across = pair(from_x[i], width, nearest);
            let down = pair(from_y[i], height, nearest);
            (left[i], top[i]) = (across.start, down.start);
            at[i] = whole(down.start)
                .wrapping_mul(columns)
                .wrapping_add(whole(across.start));
            w[i] = across.weights[0] * down.weights[0];
            x[i] = across.weights[1] * down.weights[0];
            y[i] = across.weights[0] * down.weights[1];
            z[i] = across.weights[1] * down.weights[1];
            let inside = across.inside & down.inside;
            failed[i] = if inside { 0 } else { rejection::OUTSIDE.into() };
        }
        self.spans.find(at);
    }

    #[inline(always)]
    fn validate(&mut self, len: usize, tests: &Tests) {
        let (size, steps) = (self.size, self.steps());
        let Self {
            at,
            spans,
            corner,
            weights,
            failed,
            expected,
            validation,
            ..
        } = self;
        let taps = Places {
            at: &at[..len],
            spans,
            corner: corner.each_ref().map(|lane| &lane[..len]),
            side: 2,
            size,
            steps,
        };
        let all = |_, _| true;
        tests.validate(
            expected,
            taps,
            validation,
            all,
            |[row, column], part, trust, failures| {
                let len = part.len();
                let weights = &mut weights[2 * row + column][part.start..][..len];
                let failed = &mut failed[part.start..][..len];
                let (trust, failures) = (&trust[..len], &failures[..len]);
                for i in 0..len {
                    let (weight, failures) = (weights[i], failures[i]);
                    failed[i] |= if weight > 0.0 { failures } else { 0 };
                    weights[i] = weight * trust[i];
                }
            },
        );
    }

    /// The valid taps of the 2×2 footprint of pixel `i` of the run.
    #[inline(always)]
    pub fn taps(&self, i: usize, usable: impl Fn(usize) -> bool) -> Taps<4> {
        let [dx, dy] = self.steps();
        let at = self.at[i] as usize;
        let weights = self.weights.iter().map(|lane| lane[i]);
        Taps::of(
            [at, at + dx, at + dy, at + dy + dx]
                .into_iter()
                .zip(weights),
            usable,
        )
    }

    /// The valid taps of the 3×3 window around the reprojected position of pixel `i`, with equal weights: finds thin geometry
    /// that the 2×2 footprint missed.
    #[inline(always)]
    pub fn window(&self, i: usize, tests: &Tests, usable: impl Fn(usize) -> bool) -> Taps<9> {
        let [x, y] = self.from.each_ref().map(|lane| (lane[i] + 0.5).floor());
        let places = (0..9).map(|k| (x + (k % 3 - 1) as f32, y + (k / 3 - 1) as f32));
        let taps = places.filter_map(|(x, y)| self.trusted(i, tests, x, y));
        Taps::of(taps.map(|(at, trust)| (at, trust / 9.0)), usable)
    }

    /// The fractional part of the reprojected position of pixel `i`, and its 4×4 taps; `None` for invalid taps.
    pub fn grid(
        &self,
        i: usize,
        tests: &Tests,
        usable: impl Fn(usize) -> bool,
    ) -> ([f32; 2], [[Option<usize>; 4]; 4]) {
        let from = self.from.each_ref().map(|lane| lane[i]);
        let [left, top] = from.map(f32::floor);
        let grid = [0, 1, 2, 3].map(|row| {
            [0, 1, 2, 3].map(|column| {
                let (x, y) = (left + column as f32 - 1.0, top + row as f32 - 1.0);
                let (at, trust) = self.trusted(i, tests, x, y)?;
                (trust > 0.0 && usable(at)).then_some(at)
            })
        });
        ([from[0] - left, from[1] - top], grid)
    }

    /// The index of pixel (x, y) and the trust in it; `None` outside.
    #[inline(always)]
    fn trusted(&self, i: usize, tests: &Tests, x: f32, y: f32) -> Option<(usize, f32)> {
        let Size { height, width } = self.size;
        let inside = x >= 0.0 && y >= 0.0 && x < width as f32 && y < height as f32;
        if !inside {
            return None;
        }
        let at = y as usize * width + x as usize;
        Some((at, tests.trust(&self.expected, i, [x, y], at)))
    }

    /// Computes the weights of a wide kernel, and for which pixels all of its taps are inside and valid.
    #[inline(always)]
    pub fn widen(&mut self, kernel: Wide, len: usize, tests: &Tests, wide: &mut WideLanes) {
        match kernel {
            Wide::CatmullRom => self.weigh(cubic, true, len, wide),
            Wide::CatmullRom5 => self.weigh(cubic, false, len, wide),
            Wide::Lanczos2 => self.weigh(lanczos, true, len, wide),
        }
        wide.spans.find(&wide.at[..len]);
        let any = wide.covers[..len]
            .iter()
            .fold(0, |any, covers| any | covers);
        if any != 0 && !tests.accept_all() {
            self.validate_around(kernel, len, tests, wide);
        }
    }

    #[inline(always)]
    fn weigh(
        &self,
        side: impl Fn(f32) -> [f32; 4],
        corners: bool,
        len: usize,
        wide: &mut WideLanes,
    ) {
        let Size { height, width } = self.size;
        let [x, y] = self.from.each_ref().map(|lane| &lane[..len]);
        let [a0, a1, a2, a3] = wide.along.each_mut().map(|lane| &mut lane[..len]);
        let [d0, d1, d2, d3] = wide.down.each_mut().map(|lane| &mut lane[..len]);
        let (first, failed) = (&self.at[..len], &self.failed[..len]);
        let (at, covers) = (&mut wide.at[..len], &mut wide.covers[..len]);
        let [left, top] = wide.corner.each_mut().map(|lane| &mut lane[..len]);
        let unsure = &mut wide.unsure[..len];
        let back = width as u32 + 1;
        let fits = |at: f32, side: usize| (at >= 1.0) & (at + 2.0 < side as f32);
        for i in 0..len {
            let before = [x[i].floor(), y[i].floor()];
            let [along, down] = product(&side, corners, [x[i] - before[0], y[i] - before[1]]);
            [a0[i], a1[i], a2[i], a3[i]] = along;
            [d0[i], d1[i], d2[i], d3[i]] = down;
            let fits = fits(before[0], width) & fits(before[1], height);
            [left[i], top[i]] = before.map(|at| at - 1.0);
            let gaps = (along[0] == 0.0) | (along[3] == 0.0) | (down[0] == 0.0) | (down[3] == 0.0);
            let passes = failed[i] == 0;
            at[i] = if fits { first[i].wrapping_sub(back) } else { 0 };
            covers[i] = (fits & passes).into();
            unsure[i] = (!fits & gaps & passes).into();
        }
    }

    /// Validates the taps around the 2×2, which are validated already.
    #[inline(always)]
    fn validate_around(&mut self, kernel: Wide, len: usize, tests: &Tests, wide: &mut WideLanes) {
        let WideLanes {
            along,
            down,
            at,
            spans,
            corner,
            covers,
            ..
        } = wide;
        let taps = Places {
            at: &at[..len],
            spans,
            corner: corner.each_ref().map(|lane| &lane[..len]),
            side: 4,
            size: self.size,
            steps: self.steps(),
        };
        let around = |row, column| {
            let inner = matches!((row, column), (1 | 2, 1 | 2));
            !inner && Wide::columns(kernel.has_corners(), row).contains(&column)
        };
        let (expected, validation) = (&self.expected, &mut self.validation);
        tests.validate(
            expected,
            taps,
            validation,
            around,
            |[row, column], part, _, failures| {
                let len = part.len();
                let along = &along[column][part.start..][..len];
                let down = &down[row][part.start..][..len];
                let covers = &mut covers[part.start..][..len];
                let failures = &failures[..len];
                for i in 0..len {
                    let counts = (along[i] != 0.0) & (down[i] != 0.0);
                    let fails = counts & (failures[i] != 0);
                    covers[i] = if fails { 0 } else { covers[i] };
                }
            },
        );
    }
}

/// Line buffers of a wide kernel: its weights, and whether all taps are valid.
pub(crate) struct WideLanes {
    pub along: [Row; 4],
    pub down: [Row; 4],
    /// Index of the upper left tap.
    pub at: Row<u32>,
    pub spans: Spans,
    corner: [Row; 2],
    /// 1 where all taps are valid, 0 elsewhere.
    pub covers: Row<u32>,
    /// 1 where taps lie outside, which is harmless if their weights are 0; 0 elsewhere.
    pub unsure: Row<u32>,
}

impl WideLanes {
    pub fn zeroed() -> Self {
        Self {
            along: [[0.0; SEGMENT]; 4],
            down: [[0.0; SEGMENT]; 4],
            at: [0; SEGMENT],
            spans: Spans::none(),
            corner: [[0.0; SEGMENT]; 2],
            covers: [0; SEGMENT],
            unsure: [0; SEGMENT],
        }
    }
}

/// Converts an integral value below 2^23 in two instructions; `as` would also test for NaN and overflow.
#[inline(always)]
fn whole(x: f32) -> u32 {
    const SHIFT: f32 = 8_388_608.0; // 2^23, beyond which the last bit of the mantissa counts ones
    (x + SHIFT).to_bits().wrapping_sub(SHIFT.to_bits())
}

/// The two taps along an axis.
struct Pair {
    start: f32,
    weights: [f32; 2],
    /// True if every tap with a weight lies inside.
    inside: bool,
}

/// The two taps nearest to a position; at the border, the outermost two.
#[inline(always)]
fn pair(from: f32, side: f32, nearest: bool) -> Pair {
    let corner = if nearest { from + 0.5 } else { from }.floor();
    let f = if nearest { 0.0 } else { from - corner };
    // The comparison is false for NaN, which then starts at 0.
    let start = if corner > 0.0 { corner } else { 0.0 };
    let start = start.min(side - 2.0).max(0.0);
    let weight = |at: f32| {
        let before = if at == corner { 1.0 - f } else { 0.0 };
        if at == corner + 1.0 { f } else { before }
    };
    let last = side - 1.0;
    Pair {
        start,
        weights: [
            weight(start),
            if start < last {
                weight(start + 1.0)
            } else {
                0.0
            },
        ],
        inside: (corner >= 0.0) & (corner <= last) & ((corner < last) | (f == 0.0)),
    }
}
