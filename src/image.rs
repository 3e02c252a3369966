//! Planar images and borrowed views of them.
//!
//! Kernels work on structures of arrays: every channel is a contiguous plane, rows from the top, so that a loop over a row
//! vectorises. [`Pixels`] is a borrowed view of either layout, planar or interleaved, from which a kernel loads one run
//! of pixels at a time into planar line buffers.

use std::fmt::{self, Display};
use std::marker::PhantomData;
use std::ops::{Range, RangeInclusive};

use crate::error::{Error, Result};
pub use crate::memory::Value;
use crate::memory::{Memory, prefetch};
use crate::rows::{self, BAND, Kernel, Simd};

/// Height and width in pixels; both at least 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Rows of pixels.
    pub height: usize,
    /// Columns of pixels.
    pub width: usize,
}

impl Size {
    /// Coordinates of pixel centres, at +0.5, are exact in single precision below 2²³.
    pub(crate) const LONGEST: usize = (1 << 23) - 1;
    /// Pixel indices have 32 bits.
    const MOST: usize = 1 << 31;

    /// How many pixels an image of this size has.
    pub fn pixels(self) -> usize {
        self.height * self.width
    }

    /// An error for sizes that kernels cannot index.
    pub(crate) fn check(self, argument: &str) -> Result<()> {
        let Self { height, width } = self;
        let fits =
            (height.max(width) <= Self::LONGEST) && (1..=Self::MOST).contains(&self.pixels());
        if fits {
            return Ok(());
        }
        let expected = match height.min(width) {
            0 => "at least 1 × 1 pixels",
            _ => "sides below 2²³ and at most 2³¹ pixels",
        };
        Err(Error::value(argument, expected, self))
    }
}

impl Display for Size {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "height {} and width {}", self.height, self.width)
    }
}

/// An error unless the data have the `expected` number of elements.
pub(crate) fn check_length(argument: &str, expected: usize, got: usize) -> Result<()> {
    if expected == got {
        return Ok(());
    }
    let expected = format!("{expected} elements");
    Err(Error::value(argument, expected, got))
}

/// An error that names the first image of another size, or with another number of channels than one of a range.
pub(crate) fn check_shapes<'a>(
    size: Size,
    images: impl IntoIterator<Item = (&'a str, Size, usize, RangeInclusive<usize>)>,
) -> Result<()> {
    for (name, own, channels, wanted) in images {
        if own != size {
            return Err(Error::value(name, size, own));
        }
        if !wanted.contains(&channels) {
            let expected = match (*wanted.start(), *wanted.end()) {
                (1, _) => "1 channel".into(),
                (few, most) if few == most => format!("{few} channels"),
                (few, most) => format!("{few} or {most} channels"),
            };
            return Err(Error::value(name, expected, channels));
        }
    }
    Ok(())
}

/// Checks data from outside the crate. Inside of it, lengths are only asserted.
pub(crate) fn check_data(size: Size, channels: usize, length: usize) -> Result<()> {
    size.check("size")?;
    if channels == 0 {
        return Err(Error::value("channels", "1 or more", channels));
    }
    check_length("data", size.pixels().saturating_mul(channels), length)
}

impl<T: Value> Image<T> {
    /// An image of zeros.
    ///
    /// # Errors
    /// If the size is empty or too large, or there are no channels or too many.
    pub fn zeros(size: Size, channels: usize) -> Result<Self> {
        size.check("size")?; // before the product, which may overflow
        match size.pixels().checked_mul(channels) {
            Some(1..) => Ok(Self::new(size, channels)),
            _ => Err(Error::value(
                "channels",
                "1 or more, and few enough for memory",
                channels,
            )),
        }
    }

    /// Height and width.
    pub fn size(&self) -> Size {
        self.size
    }
}

impl<'a, T> View<'a, T> {
    /// A view of planar data, (channels, height, width).
    ///
    /// # Errors
    /// If the size is empty or too large, or the data have another length.
    pub fn planar(size: Size, channels: usize, data: &'a [T]) -> Result<Self> {
        check_data(size, channels, data.len())?;
        Ok(Self::new(size, channels, data))
    }

    /// Height and width.
    pub fn size(&self) -> Size {
        self.size
    }
}

impl<'a, T: Copy + Default> Pixels<'a, T> {
    /// A view of interleaved data, (height, width, channels).
    ///
    /// # Errors
    /// If the size is empty or too large, or the data have another length.
    pub fn interleaved(size: Size, channels: usize, data: &'a [T]) -> Result<Self> {
        check_data(size, channels, data.len())?;
        Ok(Self::of_interleaved(size, channels, data))
    }

    /// Height and width.
    pub fn size(&self) -> Size {
        self.size
    }
}

/// Shows size and channels: the elements are too many.
macro_rules! debug_without_elements {
    ($($name:literal $image:ty, $bound:path;)*) => {$(
        impl<T: $bound> fmt::Debug for $image {
            fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.debug_struct($name)
                    .field("size", &self.size)
                    .field("channels", &self.channels)
                    .finish_non_exhaustive()
            }
        }
    )*};
}

debug_without_elements! {
    "Image" Image<T>, Value;
    "Interleaved" Interleaved<T>, Value;
    "View" View<'_, T>, Sized;
    "Pixels" Pixels<'_, T>, Sized;
}

/// An owned planar image.
#[derive(Clone)]
pub struct Image<T: Value = f32> {
    pub(crate) size: Size,
    pub(crate) channels: usize,
    data: Memory<T>,
}

impl<T: Value> Image<T> {
    /// All zero.
    pub(crate) fn new(size: Size, channels: usize) -> Self {
        Self {
            size,
            channels,
            data: Memory::zeroed(size.pixels() * channels),
        }
    }

    /// Uninitialised; the caller must write every element.
    pub(crate) fn blank(size: Size, channels: usize) -> Self {
        Self {
            size,
            channels,
            data: Memory::stale(size.pixels() * channels),
        }
    }

    /// All planes.
    pub fn view(&self) -> View<'_, T> {
        View {
            size: self.size,
            channels: self.channels,
            data: &self.data,
        }
    }

    /// The image as an argument of kernels, which take either layout.
    pub fn pixels(&self) -> Pixels<'_, T> {
        self.view().into()
    }

    /// The pixels of a channel, row by row from the top.
    pub fn plane(&self, channel: usize) -> &[T] {
        self.view().plane(channel)
    }

    /// A view of consecutive channels.
    pub fn channels(&self, channels: Range<usize>) -> View<'_, T> {
        let n = self.size.pixels();
        View::new(
            self.size,
            channels.len(),
            &self.data[channels.start * n..channels.end * n],
        )
    }

    /// The image's bands of rows, to be written by different threads.
    pub fn bands(&mut self) -> impl Iterator<Item = BandMut<'_, T>> {
        bands_of(&mut self.data, self.size)
    }

    /// All elements, in the order of the layout.
    pub fn data_mut(&mut self) -> &mut [T] {
        &mut self.data
    }
}

/// A borrowed planar image.
#[derive(Clone, Copy)]
pub struct View<'a, T = f32> {
    pub(crate) size: Size,
    pub(crate) channels: usize,
    data: &'a [T],
}

impl<T: Copy + Send + Sync> View<'_, T> {
    /// Writes an interleaved copy.
    pub(crate) fn interleave(&self, into: &mut [T]) {
        let bands = into.chunks_mut(BAND * self.size.width * self.channels);
        rows::run(&Interleave { planes: *self }, self.size.height, bands);
    }
}

impl<'a, T> View<'a, T> {
    /// A view of planar data of the right length.
    pub(crate) fn new(size: Size, channels: usize, data: &'a [T]) -> Self {
        assert_eq!(data.len(), size.pixels() * channels);
        Self {
            size,
            channels,
            data,
        }
    }

    /// The pixels of a channel, row by row from the top.
    #[inline(always)]
    pub fn plane(&self, channel: usize) -> &'a [T] {
        let n = self.size.pixels();
        &self.data[channel * n..][..n]
    }

    /// One channel as an image of its own.
    pub fn channel(&self, channel: usize) -> View<'a, T> {
        View::new(self.size, 1, self.plane(channel))
    }

    /// Each channel's plane, in order.
    pub fn planes(&self) -> impl Iterator<Item = &'a [T]> + use<'a, T> {
        self.data.chunks(self.size.pixels())
    }

    /// A row of a channel.
    #[inline(always)]
    pub fn row(&self, channel: usize, y: usize) -> &'a [T] {
        &self.plane(channel)[y * self.size.width..][..self.size.width]
    }

    /// The run's pixels in a channel.
    #[inline(always)]
    pub(crate) fn run(&self, channel: usize, run: Run) -> &'a [T] {
        &self.row(channel, run.y)[run.x..][..run.len]
    }

    /// The same row of the first `N` channels.
    #[inline(always)]
    pub fn rows<const N: usize>(&self, y: usize) -> [&'a [T]; N] {
        std::array::from_fn(|channel| self.row(channel, y))
    }
}

/// A borrowed view of an image in either layout: planar, or interleaved.
#[derive(Clone, Copy)]
pub struct Pixels<'a, T = f32> {
    pub(crate) size: Size,
    pub(crate) channels: usize,
    data: &'a [T],
    /// Stride in elements from a pixel to the next, and from a channel to the next.
    strides: [usize; 2],
}

impl<'a, T> From<View<'a, T>> for Pixels<'a, T> {
    fn from(view: View<'a, T>) -> Self {
        let View {
            size,
            channels,
            data,
        } = view;
        Self {
            size,
            channels,
            data,
            strides: [1, size.pixels()],
        }
    }
}

impl<'a, T: Copy + Default> Pixels<'a, T> {
    /// A view of interleaved data of the right length.
    pub(crate) fn of_interleaved(size: Size, channels: usize, data: &'a [T]) -> Self {
        assert_eq!(data.len(), size.pixels() * channels);
        Self {
            size,
            channels,
            data,
            strides: [channels, 1],
        }
    }

    /// A view of consecutive channels.
    pub(crate) fn part(self, channels: Range<usize>) -> Self {
        Self {
            channels: channels.len(),
            data: &self.data[channels.start * self.strides[1]..],
            ..self
        }
    }

    /// The image as views whose channels are contiguous: itself if it is interleaved, otherwise every plane.
    pub(crate) fn contiguous(self) -> impl Iterator<Item = Self> {
        let gaps = self.strides[1] == 1 && self.strides[0] > self.channels;
        assert!(!gaps, "a part of an interleaved image has gaps");
        let width = if self.strides[1] == 1 {
            self.channels
        } else {
            1
        };
        (0..self.channels)
            .step_by(width)
            .map(move |first| self.part(first..first + width))
    }

    #[inline(always)]
    pub(crate) fn at(&self, pixel: usize, channel: usize) -> T {
        self.data[pixel * self.strides[0] + channel * self.strides[1]]
    }

    /// The first channel, which must be contiguous: that of a planar image or of an image with one channel.
    pub fn plane(self) -> View<'a, T> {
        assert_eq!(self.strides[0], 1);
        View::new(self.size, 1, &self.data[..self.size.pixels()])
    }

    /// A row of the first channel, which must be contiguous.
    #[inline(always)]
    pub fn row(&self, y: usize) -> &'a [T] {
        assert_eq!(self.strides[0], 1);
        &self.data[y * self.size.width..][..self.size.width]
    }

    /// All elements, and the stride from a pixel to the next.
    #[inline(always)]
    pub(crate) fn elements(&self) -> (&'a [T], usize) {
        (self.data, self.strides[0])
    }

    /// Three channels of a pixel.
    #[inline(always)]
    pub(crate) fn vector(&self, pixel: usize) -> [T; 3] {
        [0, 1, 2].map(|channel| self.at(pixel, channel))
    }

    /// Gathers the first channel of these pixels.
    #[inline(always)]
    pub(crate) fn gather(&self, pixels: &[u32], into: &mut [T]) {
        let (data, step) = (self.data, self.strides[0]);
        for (to, &pixel) in into.iter_mut().zip(pixels) {
            *to = data[pixel as usize * step];
        }
    }

    /// Gathers the first three channels of these pixels; `records` is scratch.
    #[inline(always)]
    pub(crate) fn gather_vectors(
        &self,
        pixels: &[u32],
        records: &mut [[T; 4]],
        into: [&mut [T]; 3],
    ) {
        if self.strides[1] == 1 {
            // One 4-element load per pixel, instead of three loads: the fourth element is ignored.
            let records = &mut records[..pixels.len()];
            for (to, &pixel) in records.iter_mut().zip(pixels) {
                *to = record(self.data, pixel as usize * self.strides[0]);
            }
            deinterleave_first(records, into);
        } else {
            for (channel, out) in into.into_iter().enumerate() {
                self.part(channel..channel + 1).gather(pixels, out);
            }
        }
    }

    /// Loads a channel of a run into a line buffer.
    #[inline(always)]
    pub(crate) fn load(&self, run: Run, channel: usize, into: &mut [T]) {
        self.prefetch_ahead(run, channel);
        self.copy(run, channel, into);
    }

    /// Prefetches the pixels ahead of a run. After longer runs than a segment the hardware prefetcher has seen the stream.
    #[inline(always)]
    fn prefetch_ahead(&self, run: Run, channel: usize) {
        if run.len <= SEGMENT {
            let [step, plane] = self.strides;
            let ahead = (run.y * self.size.width + run.ahead()) * step + channel * plane;
            prefetch(self.data, ahead, run.len * step);
        }
    }

    #[inline(always)]
    fn copy(&self, run: Run, channel: usize, into: &mut [T]) {
        #[inline(always)]
        fn strided<T: Copy, const STEP: usize>(data: &[T], into: &mut [T]) {
            // The last pixel may have fewer elements behind it than a whole stride.
            let (last, into) = into.split_last_mut().expect("at least one pixel");
            for (to, from) in into.iter_mut().zip(data.as_chunks::<STEP>().0) {
                *to = from[0];
            }
            *last = data[into.len() * STEP];
        }
        let first = run.y * self.size.width + run.x;
        let data = &self.data[first * self.strides[0] + channel * self.strides[1]..];
        match self.strides[0] {
            1 => into.copy_from_slice(&data[..into.len()]),
            2 => strided::<T, 2>(data, into),
            3 => strided::<T, 3>(data, into),
            4 => strided::<T, 4>(data, into),
            6 => strided::<T, 6>(data, into),
            step => {
                for (to, from) in into.iter_mut().zip(data.chunks(step)) {
                    *to = from[0];
                }
            }
        }
    }
}

impl<T: Value> Pixels<'_, T> {
    /// An interleaved copy.
    pub(crate) fn to_interleaved(self) -> Interleaved<T> {
        if self.strides[0] != self.channels {
            assert_eq!(self.strides[0], 1, "a part of an interleaved image");
            let planes = &self.data[..self.size.pixels() * self.channels];
            return Interleaved::of(View::new(self.size, self.channels, planes));
        }
        let mut records = Interleaved::blank(self.size, self.channels);
        let band = BAND * self.size.width * self.channels;
        let outs = self.data.chunks(band).zip(records.data.chunks_mut(band));
        rows::run(&Copies(PhantomData), self.size.height, outs);
        records
    }
}

impl Pixels<'_> {
    /// A planar copy.
    pub fn to_planes(self) -> Image {
        let mut image = Image::blank(self.size, self.channels);
        rows::run(&ToPlanes { pixels: self }, self.size.height, image.bands());
        image
    }

    /// Loads the first `N` channels of a run into line buffers of a segment each.
    #[inline(always)]
    pub(crate) fn read_rows<const N: usize>(&self, run: Run, into: &mut [[f32; SEGMENT]; N]) {
        self.read(run, into.each_mut().map(<[f32; SEGMENT]>::as_mut_slice));
    }

    /// Loads the first `N` channels of a run into line buffers: in one sweep where the channels are contiguous.
    #[inline(always)]
    pub(crate) fn read<const N: usize>(&self, run: Run, into: [&mut [f32]; N]) {
        let start = (run.y * self.size.width + run.x) * self.strides[0];
        let data = &self.data[start..];
        if self.strides[1] == 1 {
            self.prefetch_ahead(run, 0);
        }
        match self.strides {
            [2, 1] => deinterleave_run::<2, N>(data, run.len, into),
            [3, 1] => deinterleave_run::<3, N>(data, run.len, into),
            [4, 1] => deinterleave_run::<4, N>(data, run.len, into),
            [6, 1] => deinterleave_run::<6, N>(data, run.len, into),
            strides => {
                for (channel, into) in into.into_iter().enumerate() {
                    if strides[1] != 1 {
                        self.prefetch_ahead(run, channel);
                    }
                    self.copy(run, channel, &mut into[..run.len]);
                }
            }
        }
    }
}

/// Deinterleaves the first `N` of `C` channels of `len` pixels. Behind a part of an image's channels, the last pixel of the
/// image has fewer than `C`.
#[inline(always)]
fn deinterleave_run<const C: usize, const N: usize>(
    data: &[f32],
    len: usize,
    mut into: [&mut [f32]; N],
) {
    let records = data.as_chunks::<C>().0;
    let records = &records[..records.len().min(len)];
    if let Some(last) = data
        .get(records.len() * C..)
        .filter(|_| records.len() < len)
    {
        for (row, &value) in into.iter_mut().zip(last) {
            row[records.len()] = value;
        }
    }
    deinterleave_first(records, into);
}

/// Deinterleaves the first `N` of `C` channels.
#[inline(always)]
fn deinterleave_first<T: Copy, const C: usize, const N: usize>(
    records: &[[T; C]],
    mut into: [&mut [T]; N],
) {
    // Equal lengths that the compiler can see need no bounds checks. A loop, because `map` is not always inlined.
    for row in &mut into {
        *row = &mut std::mem::take(row)[..records.len()];
    }
    for i in 0..records.len() {
        for c in 0..N {
            into[c][i] = records[i][c];
        }
    }
}

/// The `N` elements from `start` on; those beyond the last channel of the pixel are to be ignored.
#[inline(always)]
pub fn record<T: Copy + Default, const N: usize>(data: &[T], start: usize) -> [T; N] {
    let rest = &data[start..];
    match rest.first_chunk() {
        Some(record) => *record,
        None => few(rest),
    }
}

/// Slow path: fewer than `N` elements are left.
#[cold]
fn few<T: Copy + Default, const N: usize>(rest: &[T]) -> [T; N] {
    std::array::from_fn(|i| rest.get(i).copied().unwrap_or_default())
}

/// An owned interleaved image.
#[derive(Clone)]
pub struct Interleaved<T: Value = f32> {
    pub(crate) size: Size,
    pub(crate) channels: usize,
    data: Memory<T>,
}

impl<T: Value> Interleaved<T> {
    pub(crate) fn new(size: Size, channels: usize) -> Self {
        Self {
            size,
            channels,
            data: Memory::zeroed(size.pixels() * channels),
        }
    }

    /// Uninitialised; the caller must write every element.
    pub(crate) fn blank(size: Size, channels: usize) -> Self {
        Self {
            size,
            channels,
            data: Memory::stale(size.pixels() * channels),
        }
    }

    /// An interleaved copy.
    pub fn of(image: View<T>) -> Self {
        let mut records = Self::blank(image.size, image.channels);
        image.interleave(&mut records.data);
        records
    }

    /// All elements, in the order of the layout.
    pub fn data_mut(&mut self) -> &mut [T] {
        &mut self.data
    }

    /// The image as an argument of kernels, which take either layout.
    pub fn pixels(&self) -> Pixels<'_, T> {
        Pixels::of_interleaved(self.size, self.channels, &self.data)
    }
}

/// The bands of an image of one channel, to be written by different threads.
pub fn plane_bands<T>(plane: &mut [T], size: Size) -> impl Iterator<Item = BandMut<'_, T>> {
    assert_eq!(plane.len(), size.pixels(), "an output has another size");
    bands_of(plane, size)
}

/// The bands of planar data.
pub fn bands_of<T>(data: &mut [T], size: Size) -> impl Iterator<Item = BandMut<'_, T>> {
    let Size { width, height } = size;
    let mut planes: Vec<_> = data
        .chunks_mut(size.pixels())
        .map(|plane| plane.chunks_mut(BAND * width))
        .collect();
    rows::bands(height).map(move |rows| BandMut {
        rows,
        width,
        planes: planes
            .iter_mut()
            .map(|bands| bands.next().expect("as many bands as rows give"))
            .collect(),
    })
}

/// A band of rows of a mutable planar image.
pub struct BandMut<'a, T = f32> {
    rows: Range<usize>,
    width: usize,
    planes: Vec<&'a mut [T]>,
}

impl<T> BandMut<'_, T> {
    /// How many planes there are.
    pub fn channels(&self) -> usize {
        self.planes.len()
    }

    /// A row of a channel; `y` counts from the image's top.
    #[inline(always)]
    pub fn row(&mut self, channel: usize, y: usize) -> &mut [T] {
        &mut self.planes[channel][(y - self.rows.start) * self.width..][..self.width]
    }

    /// The run's pixels in each channel.
    #[inline(always)]
    pub(crate) fn parts(&mut self, run: Run) -> impl ExactSizeIterator<Item = &mut [T]> {
        let start = (run.y - self.rows.start) * self.width + run.x;
        self.planes
            .iter_mut()
            .map(move |plane| &mut plane[start..][..run.len])
    }

    /// Prefetches the pixels ahead of a run in each channel.
    #[inline(always)]
    pub(crate) fn prefetch_ahead(&self, run: Run) {
        let ahead = (run.y - self.rows.start) * self.width + run.ahead();
        for plane in &self.planes {
            prefetch(plane, ahead, run.len);
        }
    }

    /// Writes a run of the first channel.
    #[inline(always)]
    pub(crate) fn put(&mut self, run: Run, values: &[T])
    where
        T: Copy,
    {
        let start = (run.y - self.rows.start) * self.width + run.x;
        self.planes[0][start..][..run.len].copy_from_slice(&values[..run.len]);
        self.prefetch_ahead(run);
    }

    /// The same row of the first `N` channels.
    #[inline(always)]
    pub fn rows<const N: usize>(&mut self, y: usize) -> [&mut [T]; N] {
        let start = (y - self.rows.start) * self.width;
        let mut planes = self.planes.iter_mut();
        std::array::from_fn(|_| {
            let plane = planes.next().expect("the image has N channels");
            &mut plane[start..][..self.width]
        })
    }
}

/// Pixels in a line buffer: the longest run that kernels with scratch work on at a time. Short enough that all line buffers
/// of a kernel fit into the first-level cache, and long enough that what is prefetched ahead has arrived when its turn comes.
/// No power of two: line buffers at multiples of 4 KB from each other would alias, and loads would wait for unrelated stores.
pub const SEGMENT: usize = 160;

/// The runs of up to [`SEGMENT`] pixels of a row.
#[inline(always)]
pub fn segments(y: usize, width: usize) -> impl Iterator<Item = Run> {
    (0..width).step_by(SEGMENT).map(move |x| Run {
        y,
        x,
        len: SEGMENT.min(width - x),
    })
}

/// Consecutive pixels of one row.
#[derive(Clone, Copy, Debug)]
pub struct Run {
    /// The row.
    pub y: usize,
    /// The first column.
    pub x: usize,
    /// The number of pixels.
    pub len: usize,
}

impl Run {
    /// The column at which the run after the next begins: what is prefetched from there on has arrived when its turn comes.
    #[inline(always)]
    pub fn ahead(&self) -> usize {
        self.x + 2 * self.len
    }

    /// A whole row.
    pub fn row(y: usize, width: usize) -> Self {
        Self {
            y,
            x: 0,
            len: width,
        }
    }
}

/// Deinterleaves pixels into planes.
#[inline(always)]
pub fn deinterleave<'a, T: Copy + 'a>(
    records: &[T],
    outs: impl ExactSizeIterator<Item = &'a mut [T]>,
) {
    #[inline(always)]
    fn all<'a, T: Copy + 'a, const C: usize>(
        records: &[T],
        mut outs: impl Iterator<Item = &'a mut [T]>,
    ) {
        let rows = std::array::from_fn(|_| outs.next().expect("C planes"));
        deinterleave_first::<T, C, C>(records.as_chunks::<C>().0, rows);
    }
    // With a constant stride the compiler uses shuffles instead of element copies.
    let channels = outs.len();
    match channels {
        1 => outs.for_each(|out| out.copy_from_slice(records)),
        2 => all::<T, 2>(records, outs),
        3 => all::<T, 3>(records, outs),
        4 => all::<T, 4>(records, outs),
        6 => all::<T, 6>(records, outs),
        _ => {
            for (channel, out) in outs.enumerate() {
                for (to, from) in out.iter_mut().zip(records.chunks_exact(channels)) {
                    *to = from[channel];
                }
            }
        }
    }
}

/// Interleaves planes into pixels.
#[inline(always)]
pub fn interleave<'a, T: Copy + 'a>(
    rows: impl ExactSizeIterator<Item = &'a [T]>,
    records: &mut [T],
) {
    #[inline(always)]
    fn all<'a, T: Copy + 'a, const C: usize>(
        parts: impl Iterator<Item = &'a [T]>,
        records: &mut [T],
    ) {
        let records = records.as_chunks_mut::<C>().0;
        let mut rows: [&[T]; C] = [&[]; C];
        for (row, part) in rows.iter_mut().zip(parts) {
            *row = &part[..records.len()];
        }
        for i in 0..records.len() {
            for c in 0..C {
                records[i][c] = rows[c][i];
            }
        }
    }
    let channels = rows.len();
    match channels {
        1 => rows.for_each(|row| records.copy_from_slice(row)),
        2 => all::<T, 2>(rows, records),
        3 => all::<T, 3>(rows, records),
        4 => all::<T, 4>(rows, records),
        6 => all::<T, 6>(rows, records),
        _ => {
            for (channel, row) in rows.enumerate() {
                for (to, &from) in records.chunks_exact_mut(channels).zip(row) {
                    to[channel] = from;
                }
            }
        }
    }
}

struct Copies<'a, T>(PhantomData<&'a T>);

impl<'a, T: Value> Kernel for Copies<'a, T> {
    type Out = (&'a [T], &'a mut [T]);

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, _: Range<usize>, (from, to): Self::Out) {
        to.copy_from_slice(from);
    }
}

struct ToPlanes<'a> {
    pixels: Pixels<'a>,
}

impl<'a> Kernel for ToPlanes<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: BandMut<'a>) {
        for run in rows.flat_map(|y| segments(y, self.pixels.size.width)) {
            for (channel, out) in out.parts(run).enumerate() {
                self.pixels.load(run, channel, out);
            }
        }
    }
}

struct Interleave<'a, T> {
    planes: View<'a, T>,
}

impl<'a, T: Copy + Send + Sync + 'a> Kernel for Interleave<'a, T> {
    type Out = &'a mut [T];

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, out: &'a mut [T]) {
        let View { size, channels, .. } = self.planes;
        for (y, row) in rows::lines(rows, out, size.width * channels) {
            for run in segments(y, size.width) {
                let records = &mut row[run.x * channels..][..run.len * channels];
                let parts = (0..channels).map(|c| self.planes.run(c, run));
                interleave(parts, records);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_have_a_possible_number_of_channels() {
        let size = Size {
            height: 3,
            width: 5,
        };
        assert_eq!(Image::<f32>::zeros(size, 2).unwrap().data_mut().len(), 30);
        for channels in [0, usize::MAX, usize::MAX / 15 + 1] {
            assert!(Image::<f32>::zeros(size, channels).is_err(), "{channels}");
        }
    }

    #[test]
    #[should_panic(expected = "an output has another size")]
    fn an_output_of_two_planes_is_not_one() {
        let size = Size {
            height: 3,
            width: 5,
        };
        plane_bands(&mut [0.0; 30], size).for_each(drop);
    }

    #[test]
    fn interleaving_goes_both_ways() {
        for (height, width) in [(1, 1), (1, 7), (33, 5), (16, 1), (17, 3)] {
            for channels in 1..5 {
                let data: Vec<f32> = (0..height * width * channels).map(|i| i as f32).collect();
                let image =
                    Pixels::of_interleaved(Size { height, width }, channels, &data).to_planes();
                assert_eq!(image.plane(channels - 1)[0], (channels - 1) as f32);
                let mut back = vec![0.0; data.len()];
                image.view().interleave(&mut back);
                assert_eq!(back, data);
            }
        }
    }
}
