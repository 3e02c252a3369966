//! Masks of tiles, for passes that only parts of an image need.

use crate::image::{Run, Size};
use crate::rows::BAND;

/// A mask of square tiles of an image.
#[derive(Clone)]
pub struct Tiles {
    columns: usize,
    rows: usize,
    on: Vec<bool>,
}

impl Tiles {
    /// One row of tiles per band, so that a band needs no tile of another thread.
    pub const SIDE: usize = BAND;

    /// All off.
    pub fn new(size: Size) -> Self {
        let (columns, rows) = (
            size.width.div_ceil(Self::SIDE),
            size.height.div_ceil(Self::SIDE),
        );
        Self {
            columns,
            rows,
            on: vec![false; columns * rows],
        }
    }

    /// On in some rows of tiles.
    pub fn rows(size: Size, on: impl Fn(usize) -> bool) -> Self {
        let mut tiles = Self::new(size);
        for (row, tiles) in tiles.bands().enumerate() {
            tiles.fill(on(row));
        }
        tiles
    }

    /// Whether any is on.
    pub fn any(&self) -> bool {
        self.on.contains(&true)
    }

    /// The union of several masks.
    pub fn any_of(size: Size, tiles: &[Self]) -> Self {
        let mut any = Self::new(size);
        tiles.iter().for_each(|tiles| any.add(tiles));
        any
    }

    /// Adds another mask's tiles.
    pub fn add(&mut self, other: &Self) {
        for (on, &other) in self.on.iter_mut().zip(&other.on) {
            *on |= other;
        }
    }

    /// The tiles of each band, from left to right.
    pub fn bands(&mut self) -> impl Iterator<Item = &mut [bool]> {
        self.on.chunks_mut(self.columns)
    }

    /// The mask dilated by one tile in all eight directions.
    pub fn grown(&self) -> Self {
        let near = |at: usize, count: usize| at.saturating_sub(1)..(at + 2).min(count);
        let grown = |at: usize| {
            let (row, column) = (at / self.columns, at % self.columns);
            near(row, self.rows).any(|row| {
                near(column, self.columns).any(|column| self.on[row * self.columns + column])
            })
        };
        Self {
            on: (0..self.on.len()).map(grown).collect(),
            ..*self
        }
    }

    /// The parts of a run inside the mask.
    #[inline(always)]
    pub fn runs(&self, run: Run) -> impl Iterator<Item = Run> {
        runs_in(
            &self.on[run.y / Self::SIDE * self.columns..][..self.columns],
            run,
        )
    }
}

/// The parts of a run inside a row of tiles.
#[inline(always)]
pub fn runs_in(row: &[bool], run: Run) -> impl Iterator<Item = Run> {
    let (mut x, end) = (run.x, run.x + run.len);
    std::iter::from_fn(move || {
        let tile_end = |x: usize| ((x / Tiles::SIDE + 1) * Tiles::SIDE).min(end);
        while x < end && !row[x / Tiles::SIDE] {
            x = tile_end(x);
        }
        let start = x;
        while x < end && row[x / Tiles::SIDE] {
            x = tile_end(x);
        }
        (start < x).then_some(Run {
            y: run.y,
            x: start,
            len: x - start,
        })
    })
}
