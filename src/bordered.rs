//! Planar images whose rows go on for some pixels to both sides, so that taps of windows need not look where they are; and
//! windows' taps.

use std::ops::Range;

use crate::image::{BandMut, Image, Size, Value};
use crate::lanes::WIDEST;
use crate::rows;

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
        // Rows are of whole vectors, and continue by a pixel at least.
        let border = reach
            .min(size.width.max(2 * WIDEST))
            .max(1)
            .next_multiple_of(WIDEST);
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
            .filter(|dx| dx.unsigned_abs() * step < self.size.width)
            .map(|dx| Columns::new([dx], step as isize, isize::MAX));
        let columns: Vec<_> = columns.collect();
        let rows = self.rows(y, radius as usize, step);
        rows.flat_map(|down| columns.iter().map(move |column| (column.taps(down), down)))
            .map(|(tap, down)| Tap {
                shift: tap.shift + down * self.stride as isize,
                ..tap
            })
            .collect()
    }

    /// How far below row y the rows at `step` times up to `radius` pixels are that lie inside.
    pub fn rows(&self, y: usize, radius: usize, step: usize) -> impl Iterator<Item = isize> {
        let (radius, step, height) = (radius as isize, step as isize, self.size.height);
        let downs = (-radius..=radius).map(move |dy| dy * step);
        downs.filter(move |dy| ((y as isize + dy) as usize) < height)
    }

    /// A row of a plane, border included.
    #[inline(always)]
    pub fn cut<'a, T>(&self, plane: &'a [T], y: usize) -> &'a [T] {
        &plane[y * self.stride..][..self.stride]
    }

    pub fn stride(&self) -> usize {
        self.stride
    }

    /// Continues a row by one pixel to both sides.
    #[inline(always)]
    fn replicate<T: Copy>(&self, row: &mut [T]) {
        let (start, end) = (self.border, self.border + self.size.width);
        (row[start - 1], row[end]) = (row[start], row[end - 1]);
    }

    /// Farther to the side there is no memory: what lies beyond the image lies there as well.
    pub fn farthest(&self) -> isize {
        self.border as isize
    }
}

/// Columns around a pixel's own, in ascending order. Where compilers know them beforehand, all taps of a row are read off one
/// address.
pub struct Columns<const N: usize> {
    /// Steps to the right.
    pub multiples: [isize; N],
    /// In pixels to the right, and in memory.
    first: isize,
    /// To the right of the first, in memory.
    places: [usize; N],
    /// In pixels to the right of the pixel.
    right: [f32; N],
}

impl<const N: usize> Columns<N> {
    /// These multiples of `step` to the right, but not beyond the `farthest`.
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

    /// In a row that is so many below, and cut out.
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
    pub places: [usize; N],
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

    /// A row of a channel, without border.
    #[inline(always)]
    pub fn row(&self, channel: usize, y: usize) -> &[T] {
        &self.image.view().row(channel, y)[self.layout.border..][..self.layout.size.width]
    }

    /// A row of each of the first `N` channels, without border.
    #[inline(always)]
    pub fn rows<const N: usize>(&self, y: usize) -> [&[T]; N] {
        std::array::from_fn(|channel| self.row(channel, y))
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
        self.layout.replicate(self.band.row(channel, y));
    }
}

/// Rows that are `step` apart, of an image that is overwritten in place: each is written when none below it is yet, and
/// those above are read as they were before. What rows that far apart share stays in cache, and of the rows in between, no
/// chain reads what another overwrites. Every row comes with an `E`, whatever else belongs to it.
pub struct Chain<'a, const N: usize, E> {
    layout: Layout,
    step: usize,
    /// How many rows of the chain are read above and below each.
    radius: usize,
    first: usize,
    pub len: usize,
    rows: Vec<(ChainRow<'a, N>, E)>,
    /// Copies of the rows above the chain and below, from the nearest on, as far as there are any.
    beyond: [Vec<f32>; 2],
    /// Copies of the rows that were overwritten last, in turn.
    turns: Vec<f32>,
}

/// A row of the channels that are overwritten in place, and of one that is not read.
type ChainRow<'a, const N: usize> = ([&'a mut [f32]; N], &'a mut [f32]);

/// A row as it was before, border included.
pub struct Before<'c, const N: usize> {
    /// How many rows below.
    pub down: isize,
    pub channels: [&'c [f32]; N],
}

/// A row of a chain.
pub struct Link<'c, const N: usize, E> {
    pub y: usize,
    /// Itself and the rows around that lie inside.
    pub around: Vec<Before<'c, N>>,
    /// To be overwritten, border excluded.
    pub out: [&'c mut [f32]; N],
    pub apart: &'c mut [f32],
    pub extra: &'c mut E,
}

impl Bordered {
    /// Cuts the first `N` channels, and of two others the second, into chains; the first of these is returned as it is.
    pub fn chains<const N: usize, E>(
        &mut self,
        step: usize,
        radius: usize,
        [still, apart]: [usize; 2],
        extras: impl Iterator<Item = E>,
    ) -> (&[f32], Vec<Chain<'_, N, E>>) {
        let (layout, height) = (self.layout, self.layout.size.height);
        let fair = rows::turn(height);
        let mut chains = vec![];
        for column in 0..step.min(height) {
            let all = (height - column).div_ceil(step);
            let parts = ((all + fair / 2) / fair).max(1);
            let most = all.div_ceil(parts);
            for at in (0..all).step_by(most) {
                let (first, len) = (column + at * step, most.min(all - at));
                let near =
                    |link: usize| (first + link * step < height).then_some(first + link * step);
                let above = (1..=radius).map_while(|far| first.checked_sub(far * step));
                let below = (len..len + radius).map_while(near);
                chains.push(Chain {
                    layout,
                    step,
                    radius,
                    first,
                    len,
                    rows: Vec::with_capacity(len),
                    beyond: [self.copies::<N>(above), self.copies::<N>(below)],
                    turns: vec![],
                });
            }
        }
        let (still, rows) = self.split(still, apart);
        let mut rows: Vec<_> = rows.zip(extras).map(Some).collect();
        assert_eq!(rows.len(), height);
        for chain in &mut chains {
            let own = (0..chain.len).map(|link| rows[chain.first + link * step].take());
            chain.rows = own.map(|row| row.expect("a row is in one chain")).collect();
        }
        (still, chains)
    }

    /// Rows of the first `N` channels, border included, one after the other.
    fn copies<const N: usize>(&self, rows: impl Iterator<Item = usize>) -> Vec<f32> {
        let mut copies = vec![];
        for y in rows {
            for channel in 0..N {
                copies.extend_from_slice(self.image.view().row(channel, y));
            }
        }
        copies
    }

    /// A channel, and the rows of the first `N` channels and of another, border included.
    fn split<const N: usize>(
        &mut self,
        still: usize,
        apart: usize,
    ) -> (&[f32], impl Iterator<Item = ChainRow<'_, N>>) {
        let Size { height, width } = self.image.size;
        let planes = self.image.data_mut().chunks_exact_mut(height * width);
        let mut planes: Vec<_> = planes.map(Some).collect();
        let mut take = |channel: usize| planes[channel].take().expect("a channel of its own");
        let (still, apart) = (take(still), take(apart).chunks_exact_mut(width));
        let mut planes: [_; N] =
            std::array::from_fn(|channel| take(channel).chunks_exact_mut(width));
        let rows = apart.map(move |apart| {
            let rows = planes
                .each_mut()
                .map(|plane| plane.next().expect("planes are of one height"));
            (rows, apart)
        });
        (still, rows)
    }
}

impl<const N: usize, E> Chain<'_, N, E> {
    /// The rows of the image that are in it, and in between.
    pub fn range(&self) -> Range<usize> {
        self.first..self.first + (self.len - 1) * self.step + 1
    }

    /// Goes to a row: the first, or that below the last.
    pub fn link(&mut self, link: usize) -> Link<'_, N, E> {
        let Layout {
            size,
            border,
            stride,
        } = self.layout;
        let (step, len) = (self.step as isize, self.len as isize);
        let (record, turns) = (N * stride, self.radius + 1);
        self.turns.resize(turns * record, 0.0);
        let (own, below) = self.rows.split_at_mut(link + 1);
        let ((out, apart), extra) = &mut own[link];
        let kept = self.turns[link % turns * record..].chunks_exact_mut(stride);
        for (kept, row) in kept.zip(out.iter()) {
            kept.copy_from_slice(row);
        }
        let y = self.first + link * self.step;
        let downs = self.layout.rows(y, self.radius, self.step);
        let around = downs.map(|down| Before {
            down,
            channels: match link as isize + down / step {
                above @ ..0 => nth(&self.beyond[0], (-1 - above) as usize, stride),
                kept if down <= 0 => nth(&self.turns, kept as usize % turns, stride),
                still if still < len => {
                    let ((rows, _), _) = &below[(down / step) as usize - 1];
                    rows.each_ref().map(|row| &**row)
                }
                after => nth(&self.beyond[1], (after - len) as usize, stride),
            },
        });
        Link {
            y,
            around: around.collect(),
            out: out.each_mut().map(|row| &mut row[border..][..size.width]),
            apart: &mut apart[border..][..size.width],
            extra,
        }
    }

    /// Continues the channel that is not read by a pixel to both sides, when it is there.
    pub fn replicate(&mut self) {
        for ((_, row), _) in &mut self.rows {
            self.layout.replicate(row);
        }
    }
}

/// One of several rows of `N` channels that lie one after the other.
fn nth<const N: usize>(rows: &[f32], at: usize, stride: usize) -> [&[f32]; N] {
    std::array::from_fn(|channel| &rows[(at * N + channel) * stride..][..stride])
}
