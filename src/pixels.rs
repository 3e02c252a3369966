//! Images in either layout, plane by plane or pixel by pixel, worked on tile by tile.
//!
//! What is known of a tile's row stays in the first-level cache. No planar copy of the whole is needed: channels are
//! taken apart, and put together again, there.

use crate::image::{BandMut, Run, Size, View};
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

/// Pixels of a row that are worked on at a time.
pub const TILE: usize = 192;

/// Scratch is worked on in multiples of so many pixels, whole vectors at every level.
pub const LANES: usize = 16;

/// Values of a tile's row.
pub type Row = [f32; TILE];

/// Values of a tile's row, with those to the sides.
pub type Columns = [f32; TILE + LANES];

/// The runs of an image's first row that tiles begin with.
pub fn tiles(size: Size) -> impl Iterator<Item = Run> {
    let width = size.width;
    (0..width).step_by(TILE).map(move |x| Run {
        y: 0,
        x,
        len: TILE.min(width - x),
    })
}

/// As many pixels as a tile's row has, in whole vectors.
#[inline(always)]
pub fn lanes(run: Run) -> usize {
    run.len.next_multiple_of(LANES).min(TILE)
}

/// Rows of a window of at most so many.
const WIDEST: usize = 5;

/// The colours in and around a row of a tile, down which it rolls.
pub struct Around {
    pub radius: usize,
    /// As they are; NaN outside of the image. The rows take turns.
    rows: [[Columns; 3]; WIDEST],
}

impl Around {
    #[inline(always)]
    pub fn new(radius: usize) -> Self {
        Self {
            radius,
            rows: [[[0.0; TILE + LANES]; 3]; WIDEST],
        }
    }

    /// The row that is read `dy` below a run is held here.
    #[inline(always)]
    pub fn slot(&self, run: Run, dy: isize) -> usize {
        let rows = 2 * self.radius as isize + 1;
        (run.y as isize + dy).rem_euclid(rows) as usize
    }

    /// Goes to a run, which is below the one before unless it is the first; calls `each` for all rows that are read, with
    /// where they are held.
    #[inline(always)]
    pub fn roll(
        &mut self,
        color: Pixels,
        run: Run,
        first: bool,
        mut each: impl FnMut(usize, [&[f32]; 3]),
    ) {
        let radius = self.radius as isize;
        for dy in if first { -radius } else { radius }..=radius {
            self.read(color, run, dy);
            let slot = self.slot(run, dy);
            let columns = lanes(run) + LANES;
            each(slot, self.rows[slot].each_ref().map(|row| &row[..columns]));
        }
    }

    #[inline(always)]
    fn read(&mut self, color: Pixels, run: Run, dy: isize) {
        let slot = self.slot(run, dy);
        let Size { height, width } = color.size();
        let columns = lanes(run) + LANES;
        let y = run.y as isize + dy;
        let inside = if (0..height as isize).contains(&y) {
            self.radius.saturating_sub(run.x)..(width + self.radius - run.x).min(columns)
        } else {
            0..0
        };
        let rows = &mut self.rows[slot];
        for row in rows.iter_mut() {
            row[..inside.start].fill(f32::NAN);
            row[inside.end..].fill(f32::NAN);
        }
        if !inside.is_empty() {
            let there = Run {
                y: y as usize,
                x: run.x + inside.start - self.radius,
                len: inside.len(),
            };
            color.read(there, rows.each_mut().map(|row| &mut row[inside.clone()]));
        }
    }

    /// The colours of the run's columns, `dy` below.
    #[inline(always)]
    pub fn columns(&self, run: Run, dy: isize) -> &[Columns; 3] {
        &self.rows[self.slot(run, dy)]
    }

    /// The colours of the run itself.
    #[inline(always)]
    pub fn own(&self, run: Run) -> [&[f32]; 3] {
        let row = self.columns(run, 0).each_ref();
        row.map(|row| &row[self.radius..][..lanes(run)])
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
