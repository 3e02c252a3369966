//! The two grids of an upscaler: the input's, on which samples lie at an offset, and the output's.

use std::ops::Range;

use crate::image::{Image, Pixels, SEGMENT, Size, segments};
use crate::kernels::fetch::footprint::{Filter, Wide};
use crate::kernels::merge::resample::{nearest, resample};
use crate::pixels::PixelsMut;
use crate::rows::{self, Kernel, Simd};

pub struct Grids {
    small: Size,
    large: Size,
    /// In pixels of the input.
    jitter: [f64; 2],
    /// The row and the column of the sample nearest to each row and column of the output.
    rows: Vec<usize>,
    columns: Vec<usize>,
}

impl Grids {
    pub fn new(small: Size, large: Size, jitter: [f64; 2]) -> Self {
        Self {
            small,
            large,
            jitter,
            rows: nearest(small.height, large.height, jitter[1]),
            columns: nearest(small.width, large.width, jitter[0]),
        }
    }

    /// The input's pixel whose sample is nearest to a pixel of the output.
    #[inline(always)]
    pub fn nearest(&self, x: usize, y: usize) -> usize {
        self.rows[y] * self.small.width + self.columns[x]
    }

    /// The samples as pixels of the output, and how many of them each is worth.
    pub fn resample(&self, samples: Pixels) -> (Image, Image) {
        let filter = Filter::Wide(Wide::Lanczos2);
        resampled(samples, self.large, self.jitter, filter)
    }

    /// An image of the output's size at the places of the samples.
    pub fn at_samples(&self, image: Pixels) -> Image {
        let Self { small, large, .. } = *self;
        let offset = [
            -self.jitter[0] * large.width as f64 / small.width as f64,
            -self.jitter[1] * large.height as f64 / small.height as f64,
        ];
        resampled(image, small, offset, Filter::Nearest).0
    }

    /// Motion of the input's pixels as motion of the output's, in its pixels.
    pub fn enlarge_motion(&self, motion: Pixels) -> Image {
        let Self { small, large, .. } = *self;
        let mut moved = Image::blank(large, 2);
        let kernel = Enlarge {
            motion,
            grids: self,
            scale: [
                large.width as f32 / small.width as f32,
                large.height as f32 / small.height as f32,
            ],
        };
        rows::run(&kernel, large.height, moved.pixels_mut());
        moved
    }
}

fn resampled(image: Pixels, size: Size, offset: [f64; 2], filter: Filter) -> (Image, Image) {
    let (mut color, mut weight) = (Image::blank(size, 3), Image::blank(size, 1));
    let (out, weights) = (color.pixels_mut(), weight.pixels_mut());
    resample(image, size, offset, filter, true, out, weights);
    (color, weight)
}

struct Enlarge<'a> {
    motion: Pixels<'a>,
    grids: &'a Grids,
    scale: [f32; 2],
}

impl<'a> Kernel for Enlarge<'a> {
    type Out = PixelsMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: PixelsMut<'a>) {
        let mut moved = [[0.0; SEGMENT]; 2];
        for run in rows.flat_map(|y| segments(y, self.grids.large.width)) {
            for i in 0..run.len {
                let at = self.grids.nearest(run.x + i, run.y);
                for c in 0..2 {
                    moved[c][i] = self.motion.at(at, c) * self.scale[c];
                }
            }
            out.write(run, &moved);
        }
    }
}
