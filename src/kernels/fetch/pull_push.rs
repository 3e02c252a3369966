//! Hole filling by a pyramid of ever coarser images: pull, then push (Gortler et al. 1996, *The Lumigraph*, section
//! 3.4).
//!
//! **Pull**: f × f pixels become one, whose colour and quality are
//!   c = Σ q c / Σ q,  q = Σ q / (n f²),
//! n being how many of them lie in the image: the share that is known, over the f² by which a pixel of the coarser
//! image is larger. So good pixels outweigh poor ones, and what fills a hole counts as little as a point of its size.
//! **Push**: from the coarsest level down, holes get the mean of the 2 × 2 coarser pixels around, weighted by the
//! bilinear weights b and by quality, Σ b q c / Σ b q, and the quality Σ b q. What is no hole stays as it is.
//!
//! By default there are as many levels as it takes to get one pixel, and a single point fills the whole image; with
//! fewer, what is a hole in the coarsest level stays one in parts.
//!
//! Inputs: colour (any channels), quality (1), 0 in holes; colour that is not finite is a hole as well. Outputs: both
//! without holes, or with NaN and quality 0 where nothing is known.

use std::ops::Range;

use crate::error::{Result, Whole, whole};
use crate::image::{BandMut, Image, Pixels, Size, View};
use crate::rows::{self, BAND, Kernel};

/// The pyramid of [`pull_push`].
#[derive(Clone, Copy, Debug)]
pub struct Params {
    /// By how much each level is smaller to a side; 2 to 16; 2.
    pub factor: usize,
    /// How many coarser levels, at least 1; by default as many as there can be.
    pub levels: usize,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            factor: 2,
            levels: usize::MAX,
        }
    }
}

impl Params {
    pub(crate) fn factor(factor: impl Whole<usize>) -> Result<usize> {
        whole("factor", factor, "2 to 16", |n| (2..=16).contains(n))
    }

    pub(crate) fn levels(levels: impl Whole<usize>) -> Result<usize> {
        whole("levels", levels, "1 or more", |&n| n >= 1)
    }

    /// Whether all are in range.
    pub fn check(&self) -> Result<()> {
        Self::factor(self.factor)?;
        Self::levels(self.levels)?;
        Ok(())
    }
}

/// Writes records of colour, and quality.
pub fn pull_push<'a>(
    color: Pixels<'a>,
    quality: Option<Pixels<'a>>,
    params: Params,
    filled: &'a mut [f32],
    filled_quality: &'a mut [f32],
) {
    let Pixels { size, channels, .. } = color;
    let factor = params.factor;
    let finest = Pull {
        color,
        quality,
        known: None,
        factor,
    };
    // Colour, and quality as the last channel.
    let mut pyramid: Vec<Image> = vec![];
    while pyramid.len() < params.levels {
        let finer = pyramid.last();
        let before = finer.map_or(size, |finer| finer.size);
        if before.pixels() == 1 {
            break;
        }
        let coarse = Size {
            height: before.height.div_ceil(factor),
            width: before.width.div_ceil(factor),
        };
        let mut level = Image::blank(coarse, channels + 1);
        match finer {
            Some(finer) => {
                let pull = Pull {
                    color: finer.pixels().part(0..channels),
                    quality: None,
                    known: Some(finer.channels(channels..channels + 1)),
                    factor,
                };
                rows::run(&pull, coarse.height, level.bands());
            }
            None => rows::run(&finest, coarse.height, level.bands()),
        }
        pyramid.push(level);
    }
    let mut coarser: Option<Image> = None;
    while let Some(mut level) = pyramid.pop() {
        if let Some(coarser) = &coarser {
            let push = Push::new(coarser, factor, level.size);
            rows::run(&push, level.size.height, level.bands());
        }
        coarser = Some(level);
    }
    let last = Fill {
        finest,
        push: coarser.as_ref().map(|level| Push::new(level, factor, size)),
    };
    let band = BAND * size.width;
    let outs = filled
        .chunks_mut(band * channels)
        .zip(filled_quality.chunks_mut(band));
    rows::run(&last, size.height, outs);
}

/// One level from the next finer.
struct Pull<'a> {
    color: Pixels<'a>,
    /// Of the finest level, if it has any.
    quality: Option<Pixels<'a>>,
    /// Of others.
    known: Option<View<'a>>,
    factor: usize,
}

impl Pull<'_> {
    /// 0 in holes.
    #[inline(always)]
    fn quality(&self, pixel: usize) -> f32 {
        if let Some(known) = self.known {
            return known.plane(0)[pixel];
        }
        let quality = self.quality.map_or(1.0, |quality| quality.at(pixel, 0));
        let present = (0..self.color.channels).all(|c| self.color.at(pixel, c).is_finite());
        let known = present && quality > 0.0 && quality.is_finite();
        if known { quality } else { 0.0 }
    }
}

impl<'a> Kernel for Pull<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: BandMut<'a>) {
        let Pixels { size, channels, .. } = self.color;
        let factor = self.factor;
        let area = (factor * factor) as f32;
        for y in rows {
            for channel in 0..=channels {
                out.row(channel, y).fill(0.0);
            }
            let lines = y * factor..((y + 1) * factor).min(size.height);
            for line in lines.clone() {
                for x in 0..size.width {
                    let pixel = line * size.width + x;
                    let quality = self.quality(pixel);
                    if quality > 0.0 {
                        let cell = x / factor;
                        out.row(channels, y)[cell] += quality;
                        for channel in 0..channels {
                            out.row(channel, y)[cell] += quality * self.color.at(pixel, channel);
                        }
                    }
                }
            }
            for cell in 0..size.width.div_ceil(factor) {
                let columns = factor.min(size.width - cell * factor);
                let sum = out.row(channels, y)[cell];
                for channel in 0..channels {
                    let color = &mut out.row(channel, y)[cell];
                    *color = if sum > 0.0 { *color / sum } else { 0.0 };
                }
                out.row(channels, y)[cell] = sum / ((lines.len() * columns) as f32 * area);
            }
        }
    }
}

/// Fills the holes of one level from the next coarser.
struct Push<'a> {
    coarse: &'a Image,
    channels: usize,
    factor: usize,
    /// Of each column: the two coarse ones around, and the share of the second.
    columns: Vec<([u32; 2], f32)>,
}

impl<'a> Push<'a> {
    fn new(coarse: &'a Image, factor: usize, size: Size) -> Self {
        let columns = (0..size.width).map(|x| between(x, factor, coarse.size.width));
        Self {
            coarse,
            channels: coarse.channels - 1,
            factor,
            columns: columns.collect(),
        }
    }

    /// The coarse pixels at the height of a row: the products of colour and quality, and quality.
    #[inline(always)]
    fn blend(&self, y: usize, blended: &mut [f32]) {
        let Size { height, width } = self.coarse.size;
        let ([above, below], share) = between(y, self.factor, height);
        let quality = self.coarse.view().channel(self.channels);
        let known = [above, below].map(|y| quality.row(0, y as usize));
        let (products, sums) = blended.split_at_mut(self.channels * width);
        for x in 0..width {
            sums[x] = known[0][x] * (1.0 - share) + known[1][x] * share;
        }
        for (channel, products) in products.chunks_exact_mut(width).enumerate() {
            let [above, below] = [above, below].map(|y| {
                self.coarse.view().plane(channel)[y as usize * width..]
                    .split_at(width)
                    .0
            });
            for x in 0..width {
                let (a, b) = (above[x] * known[0][x], below[x] * known[1][x]);
                products[x] = a * (1.0 - share) + b * share;
            }
        }
    }

    /// What a hole in this column gets: the quality, and the colour by its channel; none where nothing is known.
    #[inline(always)]
    fn fill(&self, blended: &[f32], x: usize, mut set: impl FnMut(usize, f32)) -> f32 {
        let width = self.coarse.size.width;
        let ([left, right], share) = self.columns[x];
        let at = |channel: usize| {
            let row = &blended[channel * width..][..width];
            row[left as usize] * (1.0 - share) + row[right as usize] * share
        };
        let quality = at(self.channels);
        if quality > 0.0 {
            for channel in 0..self.channels {
                set(channel, at(channel) / quality);
            }
        }
        quality
    }

    fn room(&self) -> Vec<f32> {
        vec![0.0; (self.channels + 1) * self.coarse.size.width]
    }
}

/// The two coarse pixels whose centres are around that of a fine one, and the share of the second.
#[inline(always)]
fn between(place: usize, factor: usize, count: usize) -> ([u32; 2], f32) {
    let at = (place as f32 + 0.5) / factor as f32 - 0.5;
    let first = at.floor();
    let last = count as i32 - 1;
    let pixels = [0, 1].map(|next| (first as i32 + next).clamp(0, last) as u32);
    (pixels, at - first)
}

impl<'a> Kernel for Push<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: BandMut<'a>) {
        let mut blended = self.room();
        for y in rows {
            self.blend(y, &mut blended);
            for x in 0..self.columns.len() {
                if out.row(self.channels, y)[x] == 0.0 {
                    let quality =
                        self.fill(&blended, x, |channel, value| out.row(channel, y)[x] = value);
                    out.row(self.channels, y)[x] = quality;
                }
            }
        }
    }
}

/// The finest level, as numpy has it.
struct Fill<'a> {
    finest: Pull<'a>,
    push: Option<Push<'a>>,
}

impl<'a> Kernel for Fill<'a> {
    type Out = (&'a mut [f32], &'a mut [f32]);

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, (filled, qualities): Self::Out) {
        let Pixels { size, channels, .. } = self.finest.color;
        let mut blended = self.push.as_ref().map_or(vec![], Push::room);
        let first = rows.start * size.width;
        for y in rows {
            if let Some(push) = &self.push {
                push.blend(y, &mut blended);
            }
            for x in 0..size.width {
                let pixel = y * size.width + x;
                let color = &mut filled[(pixel - first) * channels..][..channels];
                let mut quality = self.finest.quality(pixel);
                if quality > 0.0 {
                    for (channel, value) in color.iter_mut().enumerate() {
                        *value = self.finest.color.at(pixel, channel);
                    }
                } else {
                    color.fill(f32::NAN);
                    if let Some(push) = &self.push {
                        quality = push.fill(&blended, x, |channel, value| color[channel] = value);
                    }
                }
                qualities[pixel - first] = quality;
            }
        }
    }
}
