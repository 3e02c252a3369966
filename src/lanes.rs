//! Neighbouring pixels as one value, for kernels whose inner loop runs over many taps: their sums then stay in
//! registers.
//!
//! The compiler turns each operation into the vector instructions of the level that [`crate::rows`] runs; lanes never mix.

use std::ops::{Add, Div, Mul, Range, Sub};

use crate::image::{BandMut, Image, Size, Value};

pub const LANES: usize = 32;

#[derive(Clone, Copy)]
pub struct Lanes<T = f32>(pub [T; LANES]);

impl<T: Copy> Lanes<T> {
    #[inline(always)]
    pub fn all(value: T) -> Self {
        Self([value; LANES])
    }

    /// The values from `at` on.
    #[inline(always)]
    pub fn load(plane: &[T], at: usize) -> Self {
        let values = plane[at..][..LANES].try_into();
        Self(values.expect("as many values as lanes"))
    }

    /// The same of several planes.
    #[inline(always)]
    pub fn load_all<const N: usize>(planes: [&[T]; N], at: usize) -> [Self; N]
    where
        T: Default,
    {
        let mut lanes = [Self([T::default(); LANES]); N];
        for (lanes, plane) in lanes.iter_mut().zip(planes) {
            *lanes = Self::load(plane, at);
        }
        lanes
    }

    /// The values of a row from `x` on, and `outside` beyond its ends.
    #[inline(always)]
    pub fn load_around(row: &[T], x: isize, outside: T) -> Self {
        let inside = usize::try_from(x).ok().and_then(|x| row.get(x..x + LANES));
        match inside {
            Some(values) => Self(values.try_into().expect("as many values as lanes")),
            None => Self(std::array::from_fn(|lane| {
                let at = usize::try_from(x + lane as isize).ok();
                at.and_then(|at| row.get(at)).copied().unwrap_or(outside)
            })),
        }
    }

    /// Writes into a row from `x` on, as far as the row goes.
    #[inline(always)]
    pub fn store(self, row: &mut [T], x: usize) {
        let rest = &mut row[x..];
        match rest.first_chunk_mut() {
            Some(whole) => *whole = self.0,
            None => rest.copy_from_slice(&self.0[..rest.len()]),
        }
    }

    #[inline(always)]
    pub fn map<U: Copy + Default>(self, f: impl Fn(T) -> U) -> Lanes<U> {
        let mut mapped = [U::default(); LANES];
        for lane in 0..LANES {
            mapped[lane] = f(self.0[lane]);
        }
        Lanes(mapped)
    }

    #[inline(always)]
    pub fn zip<U: Copy, V: Copy + Default>(
        self,
        other: Lanes<U>,
        f: impl Fn(T, U) -> V,
    ) -> Lanes<V> {
        let mut zipped = [V::default(); LANES];
        for lane in 0..LANES {
            zipped[lane] = f(self.0[lane], other.0[lane]);
        }
        Lanes(zipped)
    }
}

impl Lanes {
    #[inline(always)]
    pub fn abs(self) -> Self {
        self.map(|x| x.abs())
    }

    #[inline(always)]
    pub fn sqrt(self) -> Self {
        self.map(|x| x.sqrt())
    }

    /// The lanes for which `holds`, and `other` for the rest.
    #[inline(always)]
    pub fn or(self, holds: Lanes<bool>, other: f32) -> Self {
        self.zip(holds, |x, holds| if holds { x } else { other })
    }
}

impl Add for Lanes {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }
}

impl Sub for Lanes {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }
}

impl Mul for Lanes {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }
}

impl Mul<f32> for Lanes {
    type Output = Self;

    #[inline(always)]
    fn mul(self, factor: f32) -> Self {
        self.map(|x| x * factor)
    }
}

impl Div for Lanes {
    type Output = Self;

    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.zip(other, |a, b| a / b)
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
        // Taps beyond the width all lie outside. One vector more, since the last of a row may begin at its last pixel.
        let border = reach.min(size.width).next_multiple_of(LANES) + LANES;
        Self {
            size,
            border,
            stride: size.width.next_multiple_of(LANES) + 2 * border,
        }
    }

    /// Where pixel (x, y) lies in its plane.
    #[inline(always)]
    pub fn at(&self, x: usize, y: usize) -> usize {
        y * self.stride + self.border + x
    }

    /// The taps at `step` times up to `radius` pixels to each side that pixels of row y have inside; some pixels at least.
    pub fn taps(&self, y: usize, radius: isize, step: usize) -> Vec<Tap> {
        let inside = |&[dx, dy]: &[isize; 2]| {
            ((y as isize + dy) as usize) < self.size.height && dx.unsigned_abs() < self.size.width
        };
        let all = (-radius..=radius).flat_map(|dy| (-radius..=radius).map(move |dx| [dx, dy]));
        all.map(|steps| steps.map(|d| d * step as isize))
            .filter(inside)
            .map(|offset| Tap {
                offset,
                shift: offset[1] * self.stride as isize + offset[0],
            })
            .collect()
    }
}

/// A neighbour: so many pixels to the right and down, and so many values further in memory.
#[derive(Clone, Copy)]
pub struct Tap {
    pub offset: [isize; 2],
    shift: isize,
}

impl Tap {
    /// Where the tap of what lies at `at` lies.
    #[inline(always)]
    pub fn of(self, at: usize) -> usize {
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
