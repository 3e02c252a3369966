//! Neighbouring pixels as one value, for kernels whose inner loop runs over many taps: their sums then stay in registers.
//!
//! Written out in registers, as compilers do not find them: they turn loops over a few pixels inside of loops over taps
//! into gathers, at half the speed. Lanes never mix.

use std::ops::{Add, Div, Mul, Sub};

use pulp::Simd;

use crate::bordered::Taps;

/// The most lanes that there are.
pub const WIDEST: usize = 16;

/// A register of numbers.
#[derive(Clone, Copy)]
pub struct Lanes<S: Simd> {
    simd: S,
    values: S::f32s,
}

/// The same of whole numbers, which are only compared.
#[derive(Clone, Copy)]
pub struct Classes<S: Simd> {
    simd: S,
    values: S::u32s,
}

/// Which lanes something holds for.
#[derive(Clone, Copy)]
pub struct Mask<S: Simd> {
    simd: S,
    values: S::m32s,
}

impl<S: Simd> Lanes<S> {
    pub const COUNT: usize = S::F32_LANES;

    #[inline(always)]
    pub fn all(simd: S, value: f32) -> Self {
        Self {
            simd,
            values: simd.splat_f32s(value),
        }
    }

    /// The values from `at` on.
    #[inline(always)]
    pub fn load(simd: S, plane: &[f32], at: usize) -> Self {
        let (registers, _) = S::as_simd_f32s(&plane[at..][..Self::COUNT]);
        Self {
            simd,
            values: registers[0],
        }
    }

    /// The same of several planes.
    #[inline(always)]
    pub fn load_all<const N: usize>(simd: S, planes: [&[f32]; N], at: usize) -> [Self; N] {
        let mut lanes = [Self::all(simd, 0.0); N];
        for (lanes, plane) in lanes.iter_mut().zip(planes) {
            *lanes = Self::load(simd, plane, at);
        }
        lanes
    }

    /// The taps of what lies at `at`.
    #[inline(always)]
    pub fn load_taps<const N: usize>(
        simd: S,
        plane: &[f32],
        at: usize,
        taps: &Taps<N>,
    ) -> [Self; N] {
        // One window, so that one look at its length is enough for all.
        let window = &plane[taps.first(at)..][..taps.places[N - 1] + Self::COUNT];
        let mut lanes = [Self::all(simd, 0.0); N];
        for k in 0..N {
            lanes[k] = Self::load(simd, window, taps.places[k]);
        }
        lanes
    }

    /// The values of a row from `x` on, and `outside` beyond its ends.
    #[inline(always)]
    pub fn load_around(simd: S, row: &[f32], x: isize, outside: f32) -> Self {
        if x >= 0 && x as usize + Self::COUNT <= row.len() {
            return Self::load(simd, row, x as usize);
        }
        let mut values = [outside; WIDEST];
        for (lane, value) in values.iter_mut().enumerate().take(Self::COUNT) {
            let at = x + lane as isize;
            if at >= 0 && (at as usize) < row.len() {
                *value = row[at as usize];
            }
        }
        Self::load(simd, &values, 0)
    }

    /// Columns `x` and those to the right.
    #[inline(always)]
    pub fn count_from(simd: S, x: f32) -> Self {
        const COUNT: [f32; WIDEST] = [
            0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0,
        ];
        Self::load(simd, &COUNT, 0) + x
    }

    /// Writes into a row from `x` on, as far as the row goes.
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

    #[inline(always)]
    pub fn sqrt(self) -> Self {
        self.with(self.simd.sqrt_f32s(self.values))
    }

    /// 2^n times these, by their exponents, of the n that the low bits of `other` are.
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

    /// The lanes for which `holds`, and others for the rest.
    #[inline(always)]
    pub fn or(self, holds: Mask<S>, other: Self) -> Self {
        let (mask, simd) = (holds.values, self.simd);
        self.with(simd.select_f32s(mask, self.values, other.values))
    }

    /// The lanes for which `holds`, and a number for the rest.
    #[inline(always)]
    pub fn or_all(self, holds: Mask<S>, other: f32) -> Self {
        self.or(holds, Self::all(self.simd, other))
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

    /// Whether it holds for all lanes.
    #[inline(always)]
    pub fn all(self) -> bool {
        let not = self.simd.not_m32s(self.values);
        self.simd.first_true_m32s(not) == S::F32_LANES
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
        self + Self::all(self.simd, other)
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
        self * Self::all(self.simd, factor)
    }
}

impl<S: Simd> Div for Lanes<S> {
    type Output = Self;

    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.with(self.simd.div_f32s(self.values, other.values))
    }
}
