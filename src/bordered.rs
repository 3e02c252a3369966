//! Planar images with a halo of columns to the left and right of each row, so that the taps of a window need no bounds test
//! along x. Rows have no halo: a window leaves out the rows beyond the image.

use std::ops::Range;

use crate::image::{BandMut, Image, Size, Value, View};
use crate::lanes::{LANES, Tap, TapColumns};
use crate::rows::{self, Job, Kernel, Simd};

/// The memory layout that all bordered images of one frame share: halo and row stride.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    pub size: Size,
    border: usize,
    stride: usize,
}

impl Layout {
    /// A layout for taps up to `reach` pixels to the side.
    pub fn new(size: Size, reach: usize) -> Self {
        // No tap farther than the width can lie inside. Whole vectors keep rows aligned; one column at least holds the
        // replicated edge.
        let border = reach.min(size.width).max(1).next_multiple_of(LANES);
        Self {
            size,
            border,
            stride: size.width.next_multiple_of(LANES) + 2 * border,
        }
    }

    /// The index of pixel (x, y) in its plane.
    #[inline(always)]
    pub fn at(&self, x: usize, y: usize) -> usize {
        y * self.stride + self.border + x
    }

    /// The window of row y: taps at multiples of `step` up to `radius` steps to each side, without the rows outside the image
    /// and without the columns that lie outside for every pixel.
    pub fn taps(&self, y: usize, radius: usize, step: usize) -> Vec<Tap> {
        let radius = radius as isize;
        let columns = (-radius..=radius)
            .filter(|dx| dx.unsigned_abs() * step < self.size.width)
            .map(|dx| TapColumns::new([dx], step as isize, isize::MAX));
        let columns: Vec<_> = columns.collect();
        let rows = self.rows(y, radius as usize, step);
        rows.flat_map(|down| columns.iter().map(move |column| (column.taps(down), down)))
            .map(|(tap, down)| tap.shifted(down * self.stride as isize))
            .collect()
    }

    /// The offsets of the window's rows from row y, multiples of `step` up to `radius` steps, as far as they lie inside.
    pub fn rows(&self, y: usize, radius: usize, step: usize) -> impl Iterator<Item = isize> {
        let (radius, step, height) = (radius as isize, step as isize, self.size.height);
        let downs = (-radius..=radius).map(move |dy| dy * step);
        downs.filter(move |dy| ((y as isize + dy) as usize) < height)
    }

    /// A row of a plane, halo included.
    #[inline(always)]
    pub fn cut<'a, T>(&self, plane: &'a [T], y: usize) -> &'a [T] {
        &plane[y * self.stride..][..self.stride]
    }

    pub fn stride(&self) -> usize {
        self.stride
    }

    /// A row without its halo.
    #[inline(always)]
    fn inner<'a, T>(&self, row: &'a mut [T]) -> &'a mut [T] {
        &mut row[self.border..][..self.size.width]
    }

    /// Replicates the edge pixels of a row into the first column of the halo on either side.
    #[inline(always)]
    fn replicate<T: Copy>(&self, row: &mut [T]) {
        let (start, end) = (self.border, self.border + self.size.width);
        (row[start - 1], row[end]) = (row[start], row[end - 1]);
    }

    /// Columns of the halo. Taps farther to the side are clamped to its end: outside the image is outside.
    pub fn farthest(&self) -> isize {
        self.border as isize
    }
}

/// A planar image with a halo of columns.
pub struct Bordered<T: Value = f32> {
    pub layout: Layout,
    image: Image<T>,
}

impl<T: Value> Bordered<T> {
    /// `N` planes whose halos hold the values of `beyond`. The pixels are uninitialised; the caller must write every one.
    pub fn new<const N: usize>(layout: Layout, beyond: [T; N]) -> Self {
        let size = Size {
            height: layout.size.height,
            width: layout.stride,
        };
        let mut image = Image::blank(size, N);
        let halo = Halo {
            layout,
            beyond: &beyond,
        };
        rows::run(&halo, size.height, image.bands());
        Self { layout, image }
    }

    /// The first `N` planes, halo included.
    pub fn planes<const N: usize>(&self) -> [&[T]; N] {
        std::array::from_fn(|channel| self.image.plane(channel))
    }

    /// A row of a channel, without halo.
    #[inline(always)]
    pub fn row(&self, channel: usize, y: usize) -> &[T] {
        &self.image.view().row(channel, y)[self.layout.border..][..self.layout.size.width]
    }

    /// The same row of the first `N` channels, without halo.
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

/// Fills the halos. On all threads: it is the first use of fresh memory, whose pages the system clears one by one.
struct Halo<'a, T, const N: usize> {
    layout: Layout,
    /// The value beyond the edges of each channel.
    beyond: &'a [T; N],
}

impl<'a, T: Value, const N: usize> Kernel for Halo<'a, T, N> {
    type Out = BandMut<'a, T>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut image: BandMut<'a, T>) {
        let Layout { border, size, .. } = self.layout;
        for y in rows {
            for (channel, &value) in self.beyond.iter().enumerate() {
                let row = image.row(channel, y);
                row[..border].fill(value);
                row[border + size.width..].fill(value);
            }
        }
    }
}

/// A band of rows of a bordered image.
pub struct BorderedBand<'a, T = f32> {
    layout: Layout,
    band: BandMut<'a, T>,
}

impl<T> BorderedBand<'_, T> {
    fn columns(&self) -> Range<usize> {
        self.layout.border..self.layout.border + self.layout.size.width
    }

    /// A row of a channel, without halo.
    #[inline(always)]
    pub fn row(&mut self, channel: usize, y: usize) -> &mut [T] {
        let columns = self.columns();
        &mut self.band.row(channel, y)[columns]
    }

    /// The same row of the first `N` channels, without halo.
    #[inline(always)]
    pub fn rows<const N: usize>(&mut self, y: usize) -> [&mut [T]; N] {
        let columns = self.columns();
        self.band.rows(y).map(|row| &mut row[columns.clone()])
    }

    /// Replicates the edge pixels of a row into the halo.
    #[inline(always)]
    pub fn replicate(&mut self, channel: usize, y: usize)
    where
        T: Copy,
    {
        self.layout.replicate(self.band.row(channel, y));
    }
}

/// A job of a pass that overwrites an image in place: every `step`-th row of a range, from top to bottom.
///
/// In place, because a second image for ping-pong would cost memory, 16 bytes a pixel, and time, 13 % of `atrous`: the
/// lines of the second image are fetched into cache only to be overwritten. Taps lie multiples of `step` rows apart, so
/// that jobs of another y mod `step` never read these rows. Of the job's own rows, those below the current one are not
/// overwritten yet, and the `radius` rows above are read from a ring buffer of copies. The rows beyond both ends of the job
/// belong to other jobs: they are copied before the pass begins.
pub struct InPlace<'a, const N: usize, E> {
    layout: Layout,
    step: usize,
    /// Rows of the window above and below the current one.
    radius: usize,
    /// The first row.
    first: usize,
    /// Number of rows.
    pub len: usize,
    rows: Vec<(TargetRow<'a, N>, E)>,
    /// Copies of the window's rows above the job and below it, from the nearest on.
    halo: [Vec<f32>; 2],
    /// Ring buffer of the rows overwritten last, as they were before.
    ring: Vec<f32>,
}

/// A row of the `N` channels that are overwritten in place, and of the channel that is written and not read.
type TargetRow<'a, const N: usize> = ([&'a mut [f32]; N], &'a mut [f32]);

/// A row of the window, as it was before the pass, halo included.
pub struct SourceRow<'c, const N: usize> {
    /// Rows below the current one.
    pub down: isize,
    pub channels: [&'c [f32]; N],
}

/// One step of a job: the window around a row, and where the results go.
pub struct Step<'c, const N: usize, E> {
    pub y: usize,
    /// The rows of the window that lie inside the image.
    pub window: Vec<SourceRow<'c, N>>,
    /// The row of the channels in place, without halo.
    pub out: [&'c mut [f32]; N],
    /// The row of the channel that is written and not read, without halo.
    pub target: &'c mut [f32],
    /// The row of the pass's other outputs.
    pub extra: &'c mut E,
}

/// Copies the rows of the window above and below each job, of the first `N` channels, halo included.
struct CopyHalos<'a, const N: usize> {
    image: View<'a>,
    step: usize,
    radius: usize,
}

impl<'a, const N: usize> Kernel for CopyHalos<'a, N> {
    /// The number of the job's rows, and where the copies go.
    type Out = (usize, &'a mut [Vec<f32>; 2]);

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, (len, halo): Self::Out) {
        let Self { step, radius, .. } = *self;
        let Range { start: first, end } = rows;
        let above = (1..=radius).map_while(|up| first.checked_sub(up * step));
        let below = (len..len + radius).map(|row| first + row * step);
        let below = below.take_while(|&y| y < end);
        let [up, down] = halo;
        above.for_each(|y| self.copy(y, up));
        below.for_each(|y| self.copy(y, down));
    }
}

impl<const N: usize> CopyHalos<'_, N> {
    #[inline(always)]
    fn copy(&self, y: usize, copies: &mut Vec<f32>) {
        if copies.is_empty() {
            copies.reserve_exact(self.radius * N * self.image.size.width);
        }
        for channel in 0..N {
            copies.extend_from_slice(self.image.row(channel, y));
        }
    }
}

impl Bordered {
    /// Cuts a pass into jobs. The first `N` channels are overwritten in place. A further channel alternates between two
    /// planes, because all jobs read it: the pass reads `source`, which is returned, and writes `target`.
    pub fn in_place<const N: usize, E>(
        &mut self,
        step: usize,
        radius: usize,
        [source, target]: [usize; 2],
        extras: impl Iterator<Item = E>,
    ) -> (&[f32], Vec<Job<InPlace<'_, N, E>>>) {
        let (layout, height) = (self.layout, self.layout.size.height);
        let rows_per_job = rows::rows_per_job(height);
        let mut cuts = vec![];
        for remainder in 0..step.min(height) {
            let all = (height - remainder).div_ceil(step);
            let jobs = ((all + rows_per_job / 2) / rows_per_job).max(1);
            let longest = all.div_ceil(jobs);
            for start in (0..all).step_by(longest) {
                let len = longest.min(all - start);
                cuts.push((remainder + start * step, len, [vec![], vec![]]));
            }
        }
        let copies = cuts.iter_mut();
        let copies = copies.map(|(first, len, halo)| (*first..height, (*len, halo)));
        let copy = CopyHalos::<N> {
            image: self.image.view(),
            step,
            radius,
        };
        rows::run_jobs(&copy, copies.collect());
        let (source, rows) = self.split(source, target);
        let mut rows: Vec<_> = rows.zip(extras).map(Some).collect();
        assert_eq!(rows.len(), height);
        let jobs = cuts.into_iter().map(|(first, len, halo)| {
            let own = (first..height).step_by(step).take(len);
            let own = own.map(|y| rows[y].take().expect("a row is in one job"));
            let job = InPlace {
                layout,
                step,
                radius,
                first,
                len,
                rows: own.collect(),
                halo,
                ring: vec![],
            };
            (first..height, job)
        });
        (source, jobs.collect())
    }

    /// The `source` channel, and the rows of the first `N` channels and of `target`, halo included.
    fn split<const N: usize>(
        &mut self,
        source: usize,
        target: usize,
    ) -> (&[f32], impl Iterator<Item = TargetRow<'_, N>>) {
        let Size { height, width } = self.image.size;
        let planes = self.image.data_mut().chunks_exact_mut(height * width);
        let mut planes: Vec<_> = planes.map(Some).collect();
        let mut take = |channel: usize| planes[channel].take().expect("a channel of its own");
        let (source, target) = (take(source), take(target).chunks_exact_mut(width));
        let mut planes: [_; N] =
            std::array::from_fn(|channel| take(channel).chunks_exact_mut(width));
        let rows = target.map(move |target| {
            let rows = planes
                .each_mut()
                .map(|plane| plane.next().expect("planes are of one height"));
            (rows, target)
        });
        (source, rows)
    }
}

impl<const N: usize, E> InPlace<'_, N, E> {
    /// Goes to a row of the job: the first, or the one below the last.
    pub fn step(&mut self, row: usize) -> Step<'_, N, E> {
        let (layout, stride) = (self.layout, self.layout.stride);
        let (step, len) = (self.step as isize, self.len as isize);
        let (record, slots) = (N * stride, self.radius + 1);
        self.ring.resize(slots * record, 0.0);
        let (own, below) = self.rows.split_at_mut(row + 1);
        let ((out, target), extra) = &mut own[row];
        let copies = self.ring[row % slots * record..].chunks_exact_mut(stride);
        for (copy, row) in copies.zip(out.iter()) {
            copy.copy_from_slice(row);
        }
        let y = self.first + row * self.step;
        let downs = layout.rows(y, self.radius, self.step);
        let window = downs.map(|down| SourceRow {
            down,
            channels: match row as isize + down / step {
                above @ ..0 => nth(&self.halo[0], (-1 - above) as usize, stride),
                copied if down <= 0 => nth(&self.ring, copied as usize % slots, stride),
                unwritten if unwritten < len => {
                    let ((rows, _), _) = &below[(down / step) as usize - 1];
                    rows.each_ref().map(|row| &**row)
                }
                after => nth(&self.halo[1], (after - len) as usize, stride),
            },
        });
        Step {
            y,
            window: window.collect(),
            out: out.each_mut().map(|row| layout.inner(row)),
            target: layout.inner(target),
            extra,
        }
    }

    /// Replicates the edges of the rows written to the channel that is not read, when the job is done.
    pub fn replicate(&mut self) {
        for ((_, row), _) in &mut self.rows {
            self.layout.replicate(row);
        }
    }
}

/// Row number `at` of contiguous copies of rows of `N` channels.
fn nth<const N: usize>(rows: &[f32], at: usize, stride: usize) -> [&[f32]; N] {
    std::array::from_fn(|channel| &rows[(at * N + channel) * stride..][..stride])
}
