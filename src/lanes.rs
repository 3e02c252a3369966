//! Explicit SIMD vectors of neighbouring pixels, and the addresses of taps around them.
//!
//! For kernels whose inner loop runs over many taps, so that the sums of a vector of pixels stay in registers. Compilers
//! do not find this form: from a loop over pixels around a loop over taps they make gathers, at half the speed. No
//! operation mixes lanes, so that the results do not depend on the vector's width.

use std::ops::{Add, Div, Mul, Sub};

use pulp::Simd;

/// Lanes of the widest vector. Scratch rows are whole multiples of it, so that every level works on whole vectors.
pub const LANES: usize = 16;

/// A vector of numbers.
#[derive(Clone, Copy)]
pub struct Lanes<S: Simd> {
    pub simd: S,
    values: S::f32s,
}

/// A vector of surface classes, which can only be compared.
#[derive(Clone, Copy)]
pub struct Classes<S: Simd> {
    simd: S,
    values: S::u32s,
}

/// The result of a comparison, lane by lane.
#[derive(Clone, Copy)]
pub struct Mask<S: Simd> {
    simd: S,
    values: S::m32s,
}

impl<S: Simd> Lanes<S> {
    pub const COUNT: usize = S::F32_LANES;

    /// A vector of one number.
    #[inline(always)]
    pub fn splat(simd: S, value: f32) -> Self {
        Self {
            simd,
            values: simd.splat_f32s(value),
        }
    }

    /// The elements from `at` on.
    #[inline(always)]
    pub fn load(simd: S, plane: &[f32], at: usize) -> Self {
        let (registers, _) = S::as_simd_f32s(&plane[at..][..Self::COUNT]);
        Self {
            simd,
            values: registers[0],
        }
    }

    /// The elements of several planes from `at` on.
    #[inline(always)]
    pub fn load_all<const N: usize>(simd: S, planes: [&[f32]; N], at: usize) -> [Self; N] {
        let mut lanes = [Self::splat(simd, 0.0); N];
        for (lanes, plane) in lanes.iter_mut().zip(planes) {
            *lanes = Self::load(simd, plane, at);
        }
        lanes
    }

    /// The taps of the pixels from `at` on.
    #[inline(always)]
    pub fn load_taps<const N: usize>(
        simd: S,
        plane: &[f32],
        at: usize,
        taps: &Taps<N>,
    ) -> [Self; N] {
        // One slice that holds all taps: one bounds check instead of N.
        let window = &plane[taps.first(at)..][..taps.places[N - 1] + Self::COUNT];
        let mut lanes = [Self::splat(simd, 0.0); N];
        for k in 0..N {
            lanes[k] = Self::load(simd, window, taps.places[k]);
        }
        lanes
    }

    /// The elements of a row from `x` on; lanes beyond either end are `outside`.
    #[inline(always)]
    pub fn load_around(simd: S, row: &[f32], x: isize, outside: f32) -> Self {
        if x >= 0 && x as usize + Self::COUNT <= row.len() {
            return Self::load(simd, row, x as usize);
        }
        let mut values = [outside; LANES];
        for (lane, value) in values.iter_mut().enumerate().take(Self::COUNT) {
            let at = x + lane as isize;
            if at >= 0 && (at as usize) < row.len() {
                *value = row[at as usize];
            }
        }
        Self::load(simd, &values, 0)
    }

    /// Writes to a row from `x` on; lanes beyond its end are dropped.
    #[inline(always)]
    pub fn store(self, row: &mut [f32], x: usize) {
        let rest = &mut row[x..];
        match S::as_mut_simd_f32s(rest) {
            ([whole, ..], _) => *whole = self.values,
            ([], rest) => self.simd.partial_store_f32s(rest, self.values),
        }
    }

    /// The first lane.
    #[cfg(test)]
    pub fn first(self) -> f32 {
        let mut first = [0.0];
        self.store(&mut first, 0);
        first[0]
    }

    #[inline(always)]
    pub fn abs(self) -> Self {
        self.with(self.simd.abs_f32s(self.values))
    }

    /// `self * factor + addend`, rounded once, on every machine.
    #[inline(always)]
    pub fn mul_add(self, factor: Self, addend: Self) -> Self {
        let simd = self.simd;
        self.with(simd.mul_add_f32s(self.values, factor.values, addend.values))
    }

    #[inline(always)]
    pub fn sqrt(self) -> Self {
        self.with(self.simd.sqrt_f32s(self.values))
    }

    /// Multiplies by 2^n, with n the integer in the low mantissa bits of `other`: adds n to the exponents.
    #[inline(always)]
    pub fn scale_by_low_bits(self, other: Self) -> Self {
        let simd = self.simd;
        let bits = simd.transmute_u32s_f32s(self.values);
        let other = simd.transmute_u32s_f32s(other.values);
        let exponent = simd.wrapping_dyn_shl_u32s(other, simd.splat_u32s(23));
        self.with(simd.transmute_f32s_u32s(simd.add_u32s(bits, exponent)))
    }

    #[inline(always)]
    pub fn above(self, other: f32) -> Mask<S> {
        let other = self.simd.splat_f32s(other);
        self.mask(self.simd.greater_than_f32s(self.values, other))
    }

    #[inline(always)]
    pub fn at_least(self, other: f32) -> Mask<S> {
        let other = self.simd.splat_f32s(other);
        self.mask(self.simd.greater_than_or_equal_f32s(self.values, other))
    }

    #[inline(always)]
    pub fn is_number(self) -> Mask<S> {
        self.mask(self.simd.equal_f32s(self.values, self.values))
    }

    #[inline(always)]
    pub fn is_finite(self) -> Mask<S> {
        let infinity = self.simd.splat_f32s(f32::INFINITY);
        self.mask(self.simd.less_than_f32s(self.abs().values, infinity))
    }

    /// These lanes where `holds`, those of `other` elsewhere.
    #[inline(always)]
    pub fn when_else(self, holds: Mask<S>, other: Self) -> Self {
        let (mask, simd) = (holds.values, self.simd);
        self.with(simd.select_f32s(mask, self.values, other.values))
    }

    /// These lanes where `holds`, `other` elsewhere.
    #[inline(always)]
    pub fn when_or(self, holds: Mask<S>, other: f32) -> Self {
        self.when_else(holds, Self::splat(self.simd, other))
    }

    #[inline(always)]
    fn with(self, values: S::f32s) -> Self {
        Self { values, ..self }
    }

    #[inline(always)]
    fn mask(self, values: S::m32s) -> Mask<S> {
        Mask {
            simd: self.simd,
            values,
        }
    }
}

impl<S: Simd> Classes<S> {
    #[inline(always)]
    pub fn load(simd: S, plane: &[u32], at: usize) -> Self {
        let (registers, _) = S::as_simd_u32s(&plane[at..][..S::U32_LANES]);
        Self {
            simd,
            values: registers[0],
        }
    }

    #[inline(always)]
    pub fn load_taps<const N: usize>(
        simd: S,
        plane: &[u32],
        at: usize,
        taps: &Taps<N>,
    ) -> [Self; N] {
        let window = &plane[taps.first(at)..][..taps.places[N - 1] + S::U32_LANES];
        let mut classes = [Self::load(simd, window, 0); N];
        for k in 1..N {
            classes[k] = Self::load(simd, window, taps.places[k]);
        }
        classes
    }

    #[inline(always)]
    pub fn equal(self, other: Self) -> Mask<S> {
        Mask {
            simd: self.simd,
            values: self.simd.equal_u32s(self.values, other.values),
        }
    }
}

impl<S: Simd> Mask<S> {
    #[inline(always)]
    pub fn and(self, other: Self) -> Self {
        let values = self.simd.and_m32s(self.values, other.values);
        Self { values, ..self }
    }

    /// True if every lane is.
    #[inline(always)]
    pub fn all(self) -> bool {
        let not = self.simd.not_m32s(self.values);
        self.simd.first_true_m32s(not) == S::F32_LANES
    }
}

/// The columns of a window's taps, ascending. Where they are compile-time constants, one address register serves all
/// taps of a row.
pub struct TapColumns<const N: usize> {
    /// Offsets in steps; positive to the right.
    pub multiples: [isize; N],
    /// Offset of the first tap, in elements.
    first: isize,
    /// Offsets from the first tap, in elements.
    places: [usize; N],
    /// Offsets from the pixel, in pixels.
    right: [f32; N],
}

impl<const N: usize> TapColumns<N> {
    /// Taps at these multiples of `step`, their addresses clamped to `farthest` elements on either side.
    #[inline(always)]
    pub fn new(multiples: [isize; N], step: isize, farthest: isize) -> Self {
        let mut columns = Self {
            multiples,
            first: 0,
            places: [0; N],
            right: [0.0; N],
        };
        let place = |k: usize| (multiples[k] * step).clamp(-farthest, farthest);
        columns.first = place(0);
        for k in 0..N {
            columns.places[k] = (place(k) - columns.first) as usize;
            columns.right[k] = multiples[k] as f32 * step as f32;
        }
        columns
    }

    /// The taps of a row that lies `down` rows below the pixel, relative to a slice of that row alone.
    #[inline(always)]
    pub fn taps(&self, down: isize) -> Taps<N> {
        Taps {
            offset: [self.first, down],
            right: self.right,
            down: down as f32,
            shift: self.first,
            places: self.places,
        }
    }
}

/// N taps in one row of a window.
#[derive(Clone, Copy)]
pub struct Taps<const N: usize> {
    /// Offset of the first tap, to the right and down.
    pub offset: [isize; 2],
    /// Offsets in pixels, for weights that depend on the distance.
    pub right: [f32; N],
    pub down: f32,
    /// Elements from the pixel to the first tap, and from there to each tap.
    shift: isize,
    pub places: [usize; N],
}

/// One tap.
pub type Tap = Taps<1>;

impl<const N: usize> Taps<N> {
    /// These taps, `by` elements further on in memory.
    pub fn shifted(self, by: isize) -> Self {
        Self {
            shift: self.shift + by,
            ..self
        }
    }

    /// The index of the first tap of the pixel at `at`.
    #[inline(always)]
    pub fn first(&self, at: usize) -> usize {
        at.wrapping_add_signed(self.shift)
    }
}

impl<S: Simd> Add for Lanes<S> {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.with(self.simd.add_f32s(self.values, other.values))
    }
}

impl<S: Simd> Add<f32> for Lanes<S> {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: f32) -> Self {
        self + Self::splat(self.simd, other)
    }
}

impl<S: Simd> Sub for Lanes<S> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.with(self.simd.sub_f32s(self.values, other.values))
    }
}

impl<S: Simd> Mul for Lanes<S> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.with(self.simd.mul_f32s(self.values, other.values))
    }
}

impl<S: Simd> Mul<f32> for Lanes<S> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, factor: f32) -> Self {
        self * Self::splat(self.simd, factor)
    }
}

impl<S: Simd> Div for Lanes<S> {
    type Output = Self;

    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.with(self.simd.div_f32s(self.values, other.values))
    }
}
