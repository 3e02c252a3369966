//! Neighbouring pixels as one value, for kernels whose inner loop runs over many taps: their sums then stay in registers.
//!
//! Written out in registers, as compilers do not find them: they turn loops over a few pixels inside of loops over taps
//! into gathers, at half the speed. Lanes never mix.

use std::ops::{Add, Div, Mul, Range, Sub};

use pulp::Simd;

use crate::image::{BandMut, Image, Size, Value};
use crate::rows;

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
    #[inline(always)]
    pub fn first(self) -> f32 {
        let mut first = [0.0];
        self.store(&mut first, 0);
        first[0]
    }

    /// Times a factor, plus a term, rounded once: not for kernels, as not every level has an instruction for it.
    #[inline(always)]
    pub fn mul_add(self, factor: Self, term: Self) -> Self {
        self.with(
            self.simd
                .mul_add_e_f32s(self.values, factor.values, term.values),
        )
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

/// How bordered images of one size lie in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    pub size: Size,
    border: usize,
    stride: usize,
}

impl Layout {
    /// For taps up to `reach` pixels to the side.
    pub fn new(size: Size, reach: usize) -> Self {
        // Taps beyond the width all lie outside, but those of kernels that know their columns beforehand have to lie somewhere.
        // One vector more, since the last of a row may begin at its last pixel.
        let border = reach
            .min(size.width.max(2 * WIDEST))
            .next_multiple_of(WIDEST)
            + WIDEST;
        Self {
            size,
            border,
            stride: size.width.next_multiple_of(WIDEST) + 2 * border,
        }
    }

    /// Where pixel (x, y) lies in its plane.
    #[inline(always)]
    pub fn at(&self, x: usize, y: usize) -> usize {
        y * self.stride + self.border + x
    }

    /// The taps at `step` times up to `radius` pixels to each side that pixels of row y have inside; some pixels at least.
    pub fn taps(&self, y: usize, radius: usize, step: usize) -> Vec<Tap> {
        let radius = radius as isize;
        let columns = (-radius..=radius)
            .map(|dx| dx * step as isize)
            .filter(|dx| dx.unsigned_abs() < self.size.width);
        let columns: Vec<_> = columns.map(Columns::single).collect();
        let rows = self.rows(y, radius as usize, step);
        rows.flat_map(|down| columns.iter().map(move |column| self.along(column, down)))
            .collect()
    }

    /// How far below row y the rows at `step` times up to `radius` pixels are that lie inside.
    pub fn rows(&self, y: usize, radius: usize, step: usize) -> impl Iterator<Item = isize> {
        let (radius, step, height) = (radius as isize, step as isize, self.size.height);
        let downs = (-radius..=radius).map(move |dy| dy * step);
        downs.filter(move |dy| ((y as isize + dy) as usize) < height)
    }

    /// The taps of these columns so many rows below.
    #[inline(always)]
    pub fn along<const N: usize>(&self, columns: &Columns<N>, down: isize) -> Taps<N> {
        Taps {
            offset: [columns.first, down],
            right: columns.right,
            down: down as f32,
            shift: down * self.stride as isize + columns.first,
            places: columns.places,
        }
    }

    /// Farther to the side there is no memory: what lies beyond the image lies there as well.
    pub fn farthest(&self) -> usize {
        self.border - WIDEST
    }
}

/// Columns around a pixel's own, in ascending order. Where compilers know them beforehand, all taps of a row are read off one
/// address.
pub struct Columns<const N: usize> {
    first: isize,
    /// In pixels to the right of the first, and in memory.
    places: [usize; N],
    /// In pixels to the right of the pixel.
    right: [f32; N],
}

impl Columns<1> {
    fn single(right: isize) -> Self {
        Self {
            first: right,
            places: [0],
            right: [right as f32],
        }
    }
}

impl<const N: usize> Columns<N> {
    /// At multiples of `step`, but not beyond the `farthest`.
    #[inline(always)]
    pub fn new(step: usize, farthest: usize) -> Self {
        let middle = N / 2;
        let first = (middle * step).min(farthest);
        let (mut places, mut right) = ([0; N], [0.0; N]);
        for k in 0..N {
            let distance = (k.abs_diff(middle) * step).min(farthest);
            places[k] = if k < middle {
                first - distance
            } else {
                first + distance
            };
            right[k] = (k as f32 - middle as f32) * step as f32;
        }
        Self {
            first: -(first as isize),
            places,
            right,
        }
    }
}

/// Neighbours in one row: where they lie.
#[derive(Clone, Copy)]
pub struct Taps<const N: usize> {
    /// Of the first, in pixels to the right and down.
    pub offset: [isize; 2],
    /// Pixels to the right, and down.
    pub right: [f32; N],
    pub down: f32,
    /// To the first, in memory; and from there to each.
    shift: isize,
    places: [usize; N],
}

/// A neighbour.
pub type Tap = Taps<1>;

impl<const N: usize> Taps<N> {
    /// Where the first tap of what lies at `at` lies.
    #[inline(always)]
    pub fn first(&self, at: usize) -> usize {
        at.wrapping_add_signed(self.shift)
    }
}

/// A planar image whose rows go on for some pixels to both sides, so that taps need not look where they are.
pub struct Bordered<T: Value = f32> {
    pub layout: Layout,
    image: Image<T>,
}

impl<T: Value> Bordered<T> {
    /// Planes to be overwritten, with these values beyond their rows.
    pub fn new<const N: usize>(layout: Layout, beyond: [T; N]) -> Self {
        let size = Size {
            height: layout.size.height,
            width: layout.stride,
        };
        let mut image = Image::blank(size, N);
        let planes = image.data_mut().chunks_exact_mut(size.pixels());
        for (plane, value) in planes.zip(beyond) {
            for row in plane.chunks_exact_mut(layout.stride) {
                row[..layout.border].fill(value);
                row[layout.border + layout.size.width..].fill(value);
            }
        }
        Self { layout, image }
    }

    /// The first `N` planes, border included.
    pub fn planes<const N: usize>(&self) -> [&[T]; N] {
        std::array::from_fn(|channel| self.image.plane(channel))
    }

    /// A row of each of the first `N` channels, without border.
    #[inline(always)]
    pub fn rows<const N: usize>(&self, y: usize) -> [&[T]; N] {
        let at = self.layout.at(0, y);
        self.planes()
            .map(|plane| &plane[at..][..self.layout.size.width])
    }

    pub fn bands(&mut self) -> impl Iterator<Item = BorderedBand<'_, T>> {
        let layout = self.layout;
        self.image
            .bands()
            .map(move |band| BorderedBand { layout, band })
    }
}

impl<T: Value> Bordered<T> {
    /// As many sets of rows as an image has bands, every `step`-th row after another: what rows that far apart share then
    /// stays in cache.
    pub fn rows_apart<const N: usize>(
        &mut self,
        step: usize,
    ) -> impl Iterator<Item = Vec<BorderedRow<'_, N, T>>> {
        let layout = self.layout;
        let pixels = self.image.size.pixels();
        let planes = self.image.data_mut().chunks_exact_mut(pixels);
        let mut planes: Vec<_> = planes
            .map(|plane| plane.chunks_exact_mut(layout.stride))
            .collect();
        let mut rows: Vec<_> = (0..layout.size.height)
            .map(|y| {
                let mut planes = planes.iter_mut();
                let rows = std::array::from_fn(|_| {
                    let plane = planes.next().expect("the image has N channels");
                    plane.next().expect("as many rows as it is high")
                });
                BorderedRow { y, layout, rows }
            })
            .collect();
        rows.sort_by_key(|row| (row.y % step, row.y));
        let mut rows = rows.into_iter();
        rows::bands(layout.size.height).map(move |band| rows.by_ref().take(band.len()).collect())
    }
}

/// A row of `N` channels of a bordered image.
pub struct BorderedRow<'a, const N: usize, T = f32> {
    pub y: usize,
    layout: Layout,
    rows: [&'a mut [T]; N],
}

impl<const N: usize, T: Copy> BorderedRow<'_, N, T> {
    /// Without the border.
    #[inline(always)]
    pub fn channels(&mut self) -> [&mut [T]; N] {
        let Layout { border, size, .. } = self.layout;
        self.rows
            .each_mut()
            .map(|row| &mut row[border..][..size.width])
    }

    /// Continues a channel by one pixel to both sides.
    #[inline(always)]
    pub fn replicate(&mut self, channel: usize) {
        let Layout { border, size, .. } = self.layout;
        let (row, end) = (&mut self.rows[channel], border + size.width);
        (row[border - 1], row[end]) = (row[border], row[end - 1]);
    }
}

/// One band of rows of a bordered image.
pub struct BorderedBand<'a, T = f32> {
    layout: Layout,
    band: BandMut<'a, T>,
}

impl<T> BorderedBand<'_, T> {
    pub fn channels(&self) -> usize {
        self.band.channels()
    }

    fn columns(&self) -> Range<usize> {
        self.layout.border..self.layout.border + self.layout.size.width
    }

    /// A row without its border.
    #[inline(always)]
    pub fn row(&mut self, channel: usize, y: usize) -> &mut [T] {
        let columns = self.columns();
        &mut self.band.row(channel, y)[columns]
    }

    /// The same row of the first `N` channels.
    #[inline(always)]
    pub fn rows<const N: usize>(&mut self, y: usize) -> [&mut [T]; N] {
        let columns = self.columns();
        self.band.rows(y).map(|row| &mut row[columns.clone()])
    }

    /// Continues a row by one pixel to both sides.
    #[inline(always)]
    pub fn replicate(&mut self, channel: usize, y: usize)
    where
        T: Copy,
    {
        let Range { start, end } = self.columns();
        let row = self.band.row(channel, y);
        (row[start - 1], row[end]) = (row[start], row[end - 1]);
    }
}
