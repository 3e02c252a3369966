//! Images in either layout, plane by plane or pixel by pixel, worked on run by run.
//!
//! What is known of a run stays in the first-level cache, and the rows around it in the second. No planar copy of the
//! whole is needed: channels are taken apart, and put together again, on the way.

use std::ops::RangeInclusive;

use crate::image::{BandMut, Run, SEGMENT, Size, View};
use crate::rows::{self, BAND};

/// A borrowed image.
#[derive(Clone, Copy)]
pub enum Pixels<'a> {
    Planar(View<'a>),
    /// (height, width, channels), with 2, 3 or 4 channels.
    Interleaved {
        size: Size,
        channels: usize,
        data: &'a [f32],
    },
}

impl<'a> Pixels<'a> {
    /// (height, width, channels) data of 1 to 4 channels, whose length the caller has checked.
    pub fn new(size: Size, channels: usize, data: &'a [f32]) -> Self {
        match channels {
            1 => Self::Planar(View::new(size, 1, data)),
            _ => Self::Interleaved {
                size,
                channels,
                data,
            },
        }
    }

    pub fn size(&self) -> Size {
        match self {
            Self::Planar(view) => view.size,
            Self::Interleaved { size, .. } => *size,
        }
    }

    /// Copies the first `N` channels of a run.
    #[inline(always)]
    pub fn read<const N: usize>(&self, run: Run, into: [&mut [f32]; N]) {
        match *self {
            Self::Planar(view) => {
                for (row, into) in view.rows::<N>(run.y).into_iter().zip(into) {
                    into.copy_from_slice(&row[run.x..][..run.len]);
                }
            }
            Self::Interleaved {
                size,
                channels,
                data,
            } => {
                let pixels = &data[(run.y * size.width + run.x) * channels..][..run.len * channels];
                match channels {
                    2 => take_apart(pixels.as_chunks::<2>().0, into),
                    3 => take_apart(pixels.as_chunks::<3>().0, into),
                    _ => take_apart(pixels.as_chunks::<4>().0, into),
                }
            }
        }
    }
}

#[inline(always)]
fn take_apart<const C: usize, const N: usize>(pixels: &[[f32; C]], into: [&mut [f32]; N]) {
    let into = into.map(|row| &mut row[..pixels.len()]);
    for i in 0..pixels.len() {
        for c in 0..N {
            into[c][i] = pixels[i][c];
        }
    }
}

/// A band of rows of a mutable image.
pub enum PixelsMut<'a> {
    Planar(BandMut<'a>),
    /// Of as many channels as are written.
    Interleaved {
        top: usize,
        width: usize,
        data: &'a mut [f32],
    },
}

impl<'a> PixelsMut<'a> {
    /// The bands of (height, width, channels) data.
    pub fn bands(
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

    /// Overwrites a run.
    #[inline(always)]
    pub fn write<const N: usize>(&mut self, run: Run, from: [&[f32]; N]) {
        let from = from.map(|row| &row[..run.len]);
        match self {
            Self::Planar(band) => {
                for (row, from) in band.rows::<N>(run.y).into_iter().zip(from) {
                    row[run.x..][..run.len].copy_from_slice(from);
                }
            }
            Self::Interleaved { top, width, data } => {
                let start = ((run.y - *top) * *width + run.x) * N;
                let pixels = data[start..][..run.len * N].as_chunks_mut::<N>().0;
                for i in 0..run.len {
                    pixels[i] = from.map(|row| row[i]);
                }
            }
        }
    }
}

/// Scratch is worked on in multiples of so many pixels, whole vectors at every level.
pub const LANES: usize = 16;

/// Values of a run's pixels.
pub type Row = [f32; SEGMENT];

/// Values of a run's columns and those to its sides.
pub type Columns = [f32; SEGMENT + LANES];

/// The runs of a row that are worked on at a time.
pub fn runs(size: Size, y: usize) -> impl Iterator<Item = Run> {
    let width = size.width;
    (0..width).step_by(SEGMENT).map(move |x| Run {
        y,
        x,
        len: SEGMENT.min(width - x),
    })
}

/// As many pixels as a run has, in whole vectors.
#[inline(always)]
pub fn lanes(run: Run) -> usize {
    run.len.next_multiple_of(LANES).min(SEGMENT)
}

/// Rows of an image with columns to either side, of which the last few are held, in turn.
pub struct Rolling<const C: usize> {
    pub radius: usize,
    length: usize,
    data: Vec<f32>,
}

impl<const C: usize> Rolling<C> {
    /// For windows that reach so far to each side.
    #[inline(always)]
    pub fn new(width: usize, radius: usize) -> Self {
        let length = width.next_multiple_of(SEGMENT) + LANES;
        Self {
            radius,
            length,
            data: vec![0.0; (2 * radius + 1) * C * length],
        }
    }

    #[inline(always)]
    fn start(&self, y: isize) -> usize {
        let rows = 2 * self.radius as isize + 1;
        y.rem_euclid(rows) as usize * C * self.length
    }

    /// Row `y` of the channels, of which the image's begin `radius` columns further on.
    #[inline(always)]
    pub fn row(&self, y: isize) -> [&[f32]; C] {
        let rows = &self.data[self.start(y)..][..C * self.length];
        std::array::from_fn(|c| &rows[c * self.length..][..self.length])
    }

    #[inline(always)]
    pub fn row_mut(&mut self, y: isize) -> [&mut [f32]; C] {
        let start = self.start(y);
        let mut rows = self.data[start..][..C * self.length].chunks_exact_mut(self.length);
        std::array::from_fn(|_| rows.next().expect("as many rows as channels"))
    }

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

    /// Reads the rows around `y` that are not held since row `y - 1`, if that was before, and returns which; NaN where
    /// they are outside of the image.
    #[inline(always)]
    pub fn roll(&mut self, pixels: Pixels, y: usize, first: bool) -> RangeInclusive<isize> {
        let (y, radius) = (y as isize, self.radius);
        let last = y + radius as isize;
        let new = if first { y - radius as isize } else { last }..=last;
        let Size { height, width } = pixels.size();
        for y in new.clone() {
            let inside = (0..height as isize).contains(&y);
            let rows = self.row_mut(y);
            if !inside {
                rows.into_iter().for_each(|row| row.fill(f32::NAN));
                continue;
            }
            let rows = rows.map(|row| {
                let (before, row) = row.split_at_mut(radius);
                let (row, after) = row.split_at_mut(width);
                before.fill(f32::NAN);
                after.fill(f32::NAN);
                row
            });
            let y = y as usize;
            pixels.read(
                Run {
                    y,
                    x: 0,
                    len: width,
                },
                rows,
            );
        }
        new
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
