//! Reading and writing images run by run, in either layout.
//!
//! A kernel loads a run into planar line buffers, which stay in the first-level cache; the rows around it, for windows,
//! stay in the second-level cache ([`Rolling`]). Interleaved images need no planar copy of the whole: runs are
//! deinterleaved and interleaved on the way.

use std::ops::RangeInclusive;

use crate::error::Result;
use crate::image::{
    BandMut, Image, Interleaved, Pixels, Run, SEGMENT, Size, bands_of, check_data, deinterleave,
    interleave, segments,
};
use crate::lanes::LANES;
use crate::memory::prefetch;
use crate::rows::{self, BAND};

/// A band of rows of a mutable image, in either layout.
pub enum PixelsMut<'a> {
    /// Planar.
    Planar(BandMut<'a>),
    /// Interleaved.
    Interleaved(InterleavedMut<'a>),
}

/// A band of rows of an interleaved image.
pub struct InterleavedMut<'a> {
    top: usize,
    width: usize,
    channels: usize,
    data: &'a mut [f32],
}

impl InterleavedMut<'_> {
    #[inline(always)]
    fn start(&self, run: Run) -> usize {
        ((run.y - self.top) * self.width + run.x) * self.channels
    }

    /// The numbers of the run's pixels.
    #[inline(always)]
    pub(crate) fn part(&mut self, run: Run) -> &mut [f32] {
        let start = self.start(run);
        &mut self.data[start..][..run.len * self.channels]
    }

    /// Prefetches the pixels ahead of a run.
    #[inline(always)]
    pub(crate) fn prefetch_ahead(&self, run: Run) {
        let len = run.len * self.channels;
        prefetch(self.data, self.start(run) + 2 * len, len);
    }
}

impl<'a> PixelsMut<'a> {
    /// (height, width, channels) data, to be written by a kernel.
    ///
    /// # Errors
    /// If the size is empty or too large, or the data have another length.
    pub fn interleaved(
        size: Size,
        channels: usize,
        data: &'a mut [f32],
    ) -> Result<impl Iterator<Item = PixelsMut<'a>>> {
        check_data(size, channels, data.len())?;
        Ok(Self::bands(size, channels, data))
    }

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
            .map(move |(rows, data)| {
                PixelsMut::Interleaved(InterleavedMut {
                    top: rows.start,
                    width,
                    channels,
                    data,
                })
            })
    }

    pub(crate) fn channels(&self) -> usize {
        match self {
            Self::Planar(band) => band.channels(),
            Self::Interleaved(band) => band.channels,
        }
    }

    /// The bands of planar data.
    pub(crate) fn planar(size: Size, data: &'a mut [f32]) -> impl Iterator<Item = PixelsMut<'a>> {
        bands_of(data, size).map(PixelsMut::Planar)
    }

    /// Reads a run's first three channels.
    #[inline(always)]
    pub(crate) fn load_colors(&mut self, run: Run, into: &mut [Row; 3]) {
        match self {
            Self::Planar(band) => {
                for (row, part) in into.iter_mut().zip(band.parts(run)) {
                    row[..run.len].copy_from_slice(part);
                }
            }
            Self::Interleaved(band) => {
                let size = Size {
                    height: 1,
                    width: run.len,
                };
                let pixels = Pixels::of_interleaved(size, band.channels, band.part(run));
                pixels.colors(Run::row(0, run.len), into);
            }
        }
    }

    /// Writes a run of interleaved pixels of so many channels.
    #[inline(always)]
    pub(crate) fn put(&mut self, run: Run, records: &[f32], channels: usize) {
        assert_eq!(channels, self.channels(), "an output has other channels");
        match self {
            Self::Planar(band) => {
                deinterleave(records, band.parts(run));
                band.prefetch_ahead(run);
            }
            Self::Interleaved(band) => {
                band.part(run).copy_from_slice(records);
                band.prefetch_ahead(run);
            }
        }
    }

    /// Writes a run; each of `rows` is the line buffer of a channel.
    #[inline(always)]
    pub(crate) fn write<'r, R: AsRef<[f32]> + ?Sized + 'r>(
        &mut self,
        run: Run,
        rows: impl IntoIterator<Item = &'r R, IntoIter: ExactSizeIterator>,
    ) {
        let rows = rows.into_iter().map(|row| &row.as_ref()[..run.len]);
        let channels = rows.len();
        assert_eq!(channels, self.channels(), "an output has other channels");
        match self {
            Self::Planar(band) => {
                for (part, row) in band.parts(run).zip(rows) {
                    part.copy_from_slice(row);
                }
                band.prefetch_ahead(run);
            }
            Self::Interleaved(band) => {
                interleave(rows, band.part(run));
                band.prefetch_ahead(run);
            }
        }
    }
}

impl Image {
    /// The image's bands as outputs of kernels, which write either layout.
    pub(crate) fn pixels_mut(&mut self) -> impl Iterator<Item = PixelsMut<'_>> {
        self.bands().map(PixelsMut::Planar)
    }
}

impl Interleaved {
    /// The image's bands as outputs of kernels, which write either layout.
    pub(crate) fn pixels_mut(&mut self) -> impl Iterator<Item = PixelsMut<'_>> {
        PixelsMut::bands(self.size, self.channels, self.data_mut())
    }
}

/// The rows of an image of `N` channels, each to be written on its own.
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

/// A source of colour that kernels read run by run: an image, or a computation on images that needs no intermediate one.
pub trait Colors: Sync {
    /// Writes a run's colours. Missing pixels are not finite.
    fn colors(&self, run: Run, into: &mut [Row; 3]);
}

impl Colors for Pixels<'_> {
    #[inline(always)]
    fn colors(&self, run: Run, into: &mut [Row; 3]) {
        self.read_rows(run, into);
    }
}

/// Columns of a strip. Kernels with large windows work strip by strip, so that the rows of the window stay in the
/// second-level cache.
pub const STRIP: usize = 640;

/// A line buffer: one value for each pixel of a run.
pub type Row<T = f32> = [T; SEGMENT];

/// A line buffer with room for the columns that a window adds to a run.
pub type Columns = [f32; SEGMENT + LANES];

/// The motion of a run of pixels; the third channel, if there is one, is the change of depth.
#[derive(Clone, Copy)]
pub struct MotionRun<'a> {
    pub x: &'a [f32],
    pub y: &'a [f32],
    pub depth: Option<&'a [f32]>,
}

/// Reads the motion of a run; the change of depth only if there is one.
#[inline(always)]
pub fn read_motion(motion: &Pixels, run: Run, [x, y, depth]: [&mut [f32]; 3]) {
    match motion.channels {
        3 => motion.read(run, [x, y, depth]),
        _ => motion.read(run, [x, y]),
    }
}

/// Line buffers for the motion of a run.
pub struct MotionLanes([Row; 3]);

impl MotionLanes {
    pub fn zeroed() -> Self {
        Self([[0.0; SEGMENT]; 3])
    }

    #[inline(always)]
    pub fn load(&mut self, motion: &Pixels, run: Run) -> MotionRun<'_> {
        let Self(lanes) = self;
        read_motion(motion, run, lanes.each_mut().map(Row::as_mut_slice));
        let [x, y, depth] = lanes.each_ref().map(|lane| &lane[..run.len]);
        MotionRun {
            x,
            y,
            depth: (motion.channels == 3).then_some(depth),
        }
    }
}

/// The run's length, rounded up to whole vectors.
#[inline(always)]
pub fn lanes(run: Run) -> usize {
    run.len.next_multiple_of(LANES).min(SEGMENT)
}

/// A ring buffer of the 2·radius + 1 rows that a vertical window needs, each with a halo of columns.
pub struct Rolling<const C: usize, T = f32> {
    pub radius: usize,
    length: usize,
    data: Vec<T>,
    /// The value of pixels outside the image.
    outside: T,
}

impl<const C: usize> Rolling<C> {
    /// For windows of this radius; NaN outside the image.
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

    /// Row `y` of each channel, halo included: column x of the image is at index x + radius.
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

    /// The rows that a step to row `y` adds to the buffer: the lowest of its window, or all of them for the first row.
    pub fn due(&self, y: usize, first: bool) -> RangeInclusive<isize> {
        let (y, radius) = (y as isize, self.radius as isize);
        let last = y + radius;
        if first {
            y - radius..=last
        } else {
            last..=last
        }
    }

    /// Row `y`, to be filled by the caller, its halo filled already; `None` for a row outside the image, which needs no more.
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
    /// The columns of a run and of its halo, `dy` rows below.
    #[inline(always)]
    pub fn columns(&self, run: Run, dy: isize) -> [&Columns; C] {
        self.row(run.y as isize + dy).map(|row| {
            row[run.x..]
                .first_chunk()
                .expect("rows are of whole segments")
        })
    }

    /// The run's own pixels, in whole vectors.
    #[inline(always)]
    pub fn own(&self, run: Run) -> [&[f32]; C] {
        self.columns(run, 0)
            .map(|row| &row[self.radius..][..lanes(run)])
    }

    /// Steps to row `y`, one below the previous call's row unless it is the `first`; loads the rows that this adds, and returns
    /// their numbers.
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

/// Copies line buffers into whole rows.
#[inline(always)]
pub fn put<const C: usize>(rows: &mut [&mut [f32]; C], run: Run, values: &[Row; C]) {
    for (row, values) in rows.iter_mut().zip(values) {
        row[run.x..][..run.len].copy_from_slice(&values[..run.len]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size {
        height: 3,
        width: 20,
    };

    fn write(mut out: PixelsMut) {
        let rows = [[1.0; SEGMENT]; 3];
        let run = segments(0, SIZE.width).next().expect("an image has pixels");
        out.write(run, &rows);
    }

    #[test]
    #[should_panic(expected = "an output has other channels")]
    fn a_missing_plane_panics() {
        let mut image = Image::new(SIZE, 2);
        image.pixels_mut().for_each(write);
    }

    #[test]
    #[should_panic(expected = "an output has other channels")]
    fn a_channel_too_many_panics() {
        let mut data = vec![0.0; 4 * SIZE.pixels()];
        PixelsMut::bands(SIZE, 4, &mut data).for_each(write);
    }
}
