//! Images in either layout, plane by plane or pixel by pixel, worked on run by run.
//!
//! What is known of a run stays in the first-level cache, and the rows around it in the second. No planar copy of the
//! whole is needed: channels are taken apart, and put together again, on the way.

use std::ops::RangeInclusive;

use crate::image::{BandMut, Image, Pixels, Run, SEGMENT, Size, bands_of, interleave, segments};
use crate::memory::prefetch;
use crate::rows::{self, BAND};

/// A band of rows of a mutable image.
pub enum PixelsMut<'a> {
    /// Plane by plane.
    Planar(BandMut<'a>),
    /// Of as many channels as are written.
    Interleaved {
        /// The band's first row.
        top: usize,
        /// Columns of the image.
        width: usize,
        /// Pixel by pixel.
        data: &'a mut [f32],
    },
}

impl<'a> PixelsMut<'a> {
    /// The bands of (height, width, channels) data.
    pub(crate) fn bands(
        size: Size,
        channels: usize,
        data: &'a mut [f32],
    ) -> impl Iterator<Item = PixelsMut<'a>> {
        let width = size.width;
        let bands = data.chunks_mut(BAND * width * channels);
        rows::bands(size.height)
            .zip(bands)
            .map(move |(rows, data)| PixelsMut::Interleaved {
                top: rows.start,
                width,
                data,
            })
    }

    /// The bands of planes that lie one after the other.
    pub(crate) fn planar(size: Size, data: &'a mut [f32]) -> impl Iterator<Item = PixelsMut<'a>> {
        bands_of(data, size).map(PixelsMut::Planar)
    }

    /// Overwrites a run of as many channels as there are rows.
    #[inline(always)]
    pub(crate) fn write<'r>(
        &mut self,
        run: Run,
        rows: impl IntoIterator<Item = &'r [f32], IntoIter: ExactSizeIterator>,
    ) {
        let rows = rows.into_iter().map(|row| &row[..run.len]);
        match self {
            Self::Planar(band) => {
                for (part, row) in band.parts(run).zip(rows) {
                    part.copy_from_slice(row);
                }
                band.follow(run);
            }
            Self::Interleaved { top, width, data } => {
                let channels = rows.len();
                let start = ((run.y - *top) * *width + run.x) * channels;
                let len = run.len * channels;
                interleave(rows, &mut data[start..][..len]);
                prefetch(data, start + len, len);
            }
        }
    }
}

/// The rows of `N` planes that lie one after the other, to be written apart.
pub fn rows_of<const N: usize>(image: &mut Image) -> Vec<[&mut [f32]; N]> {
    let Size { height, width } = image.size;
    assert_eq!(image.channels, N);
    let mut planes = image.data_mut().chunks_exact_mut(height * width);
    let mut planes: [_; N] = std::array::from_fn(|_| {
        let plane = planes.next().expect("N planes");
        plane.chunks_exact_mut(width)
    });
    let row = |_| {
        planes
            .each_mut()
            .map(|rows| rows.next().expect("planes are of one height"))
    };
    (0..height).map(row).collect()
}

/// An image that gives its colours run by run.
pub trait Colors: Sync {
    /// Writes a run's colours; what is missing is not finite.
    fn colors(&self, run: Run, into: &mut [Row; 3]);
}

impl Colors for Pixels<'_> {
    #[inline(always)]
    fn colors(&self, run: Run, into: &mut [Row; 3]) {
        self.read(run, into.each_mut().map(Row::as_mut_slice));
    }
}

/// Columns that kernels with large windows work on at a time, so that what they know of the rows around stays in the
/// second-level cache.
pub const STRIP: usize = 640;

/// Scratch is worked on in multiples of so many pixels, whole vectors at every level.
pub const LANES: usize = 16;

/// Values of a run's pixels.
pub type Row = [f32; SEGMENT];

/// Values of a run's columns and those to its sides.
pub type Columns = [f32; SEGMENT + LANES];

/// As many pixels as a run has, in whole vectors.
#[inline(always)]
pub fn lanes(run: Run) -> usize {
    run.len.next_multiple_of(LANES).min(SEGMENT)
}

/// Rows of an image with columns to either side, of which the last few are held, in turn.
pub struct Rolling<const C: usize, T = f32> {
    pub radius: usize,
    length: usize,
    data: Vec<T>,
    /// What is where no image is.
    outside: T,
}

impl<const C: usize> Rolling<C> {
    /// For windows that reach so far to each side; NaN outside.
    #[inline(always)]
    pub fn new(width: usize, radius: usize) -> Self {
        Self::within(width, radius, f32::NAN)
    }
}

impl<const C: usize, T: Copy> Rolling<C, T> {
    #[inline(always)]
    pub fn within(width: usize, radius: usize, outside: T) -> Self {
        let length = width.next_multiple_of(SEGMENT) + LANES + 2 * radius;
        Self {
            radius,
            length,
            data: vec![outside; (2 * radius + 1) * C * length],
            outside,
        }
    }

    #[inline(always)]
    fn start(&self, y: isize) -> usize {
        let rows = 2 * self.radius as isize + 1;
        y.rem_euclid(rows) as usize * C * self.length
    }

    /// Row `y` of the channels, of which the image's begin `radius` columns further on.
    #[inline(always)]
    pub fn row(&self, y: isize) -> [&[T]; C] {
        let rows = &self.data[self.start(y)..][..C * self.length];
        std::array::from_fn(|c| &rows[c * self.length..][..self.length])
    }

    #[inline(always)]
    pub fn row_mut(&mut self, y: isize) -> [&mut [T]; C] {
        let start = self.start(y);
        let mut rows = self.data[start..][..C * self.length].chunks_exact_mut(self.length);
        std::array::from_fn(|_| rows.next().expect("as many rows as channels"))
    }

    /// The rows around `y` that are not held since row `y - 1`, if that was before.
    pub fn due(&self, y: usize, first: bool) -> RangeInclusive<isize> {
        let (y, radius) = (y as isize, self.radius as isize);
        let last = y + radius;
        if first {
            y - radius..=last
        } else {
            last..=last
        }
    }

    /// The row to be filled, of an image of this size; what is around it is outside.
    #[inline(always)]
    pub fn fresh(&mut self, y: isize, size: Size) -> Option<[&mut [T]; C]> {
        let (radius, outside) = (self.radius, self.outside);
        let mut rows = self.row_mut(y);
        if !(0..size.height as isize).contains(&y) {
            rows.iter_mut().for_each(|row| row.fill(outside));
            return None;
        }
        Some(rows.map(|row| {
            let (before, row) = row.split_at_mut(radius);
            let (row, after) = row.split_at_mut(size.width);
            before.fill(outside);
            after.fill(outside);
            row
        }))
    }
}

impl<const C: usize> Rolling<C> {
    /// The columns of a run's pixels and those around, `dy` below.
    #[inline(always)]
    pub fn columns(&self, run: Run, dy: isize) -> [&Columns; C] {
        self.row(run.y as isize + dy).map(|row| {
            row[run.x..]
                .first_chunk()
                .expect("rows are of whole segments")
        })
    }

    /// The run's pixels.
    #[inline(always)]
    pub fn own(&self, run: Run) -> [&[f32]; C] {
        self.columns(run, 0)
            .map(|row| &row[self.radius..][..lanes(run)])
    }

    /// Goes to row `y`, which is below the one before unless it is the first, and returns the rows that this adds.
    #[inline(always)]
    pub fn roll(&mut self, pixels: Pixels, y: usize, first: bool) -> RangeInclusive<isize> {
        let due = self.due(y, first);
        for y in due.clone() {
            if let Some(mut rows) = self.fresh(y, pixels.size) {
                for run in segments(y as usize, pixels.size.width) {
                    pixels.read(run, rows.each_mut().map(|row| &mut row[run.x..]));
                }
            }
        }
        due
    }
}

/// Puts a run into rows.
#[inline(always)]
pub fn put<const C: usize>(rows: &mut [&mut [f32]; C], run: Run, values: &[Row; C]) {
    for (row, values) in rows.iter_mut().zip(values) {
        row[run.x..][..run.len].copy_from_slice(&values[..run.len]);
    }
}

/// The smaller; the second where the first is NaN. One instruction, which `min` is not.
#[inline(always)]
pub fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The larger; the second where the first is NaN.
#[inline(always)]
pub fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}
