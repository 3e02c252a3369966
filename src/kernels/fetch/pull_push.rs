//! Hole filling by a pyramid of ever coarser images: pull, then push (Gortler et al. 1996, *The Lumigraph*, section
//! 3.4).
//!
//! **Pull**: f × f pixels become one, whose colour and quality are
//!   c = Σ q c / Σ q,  q = Σ q / (n f²),
//! n being the number of them inside the image: their mean quality, divided by f² because a coarse pixel is that much
//! larger. So good pixels outweigh poor ones, and a filled hole has as low a quality as a point of the coarse pixel's size.
//! **Push**: from the coarsest level down, holes get the mean of the 2 × 2 coarser pixels around, weighted by the
//! bilinear weights b and by quality, Σ b q c / Σ b q, and the quality Σ b q. Other pixels are unchanged.
//!
//! By default the coarsest level has one pixel, so that a single point fills the whole image; with fewer levels, holes
//! that remain in the coarsest level are not filled.
//!
//! Inputs: colour (any channels), quality (1), 0 in holes; colour that is not finite is a hole as well. Outputs: both
//! without holes, or with NaN and quality 0 where no level has a value.

use std::ops::Range;

use crate::error::{Result, Whole, whole};
use crate::image::{BandMut, Image, Pixels, Size, View};
use crate::rows::{self, BAND, Kernel, Simd};

/// The pyramid of [`pull_push`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// f: ratio of the sides of successive levels; 2 to 16; 2.
    pub factor: usize,
    /// Number of coarser levels; ≥ 1; as many as it takes to get a single pixel.
    pub levels: usize,
}

impl Default for Params {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl Params {
    /// The default, as a constant.
    pub const DEFAULT: Self = Self {
        factor: 2,
        levels: usize::MAX,
    };

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

/// Writes filled colour (interleaved) and quality.
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
    // Planar levels: colour, then quality.
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
    let lengths = [filled.len() / channels, filled_quality.len()];
    assert_eq!(lengths, [size.pixels(); 2], "an output has another size");
    let band = BAND * size.width;
    let outs = filled
        .chunks_mut(band * channels)
        .zip(filled_quality.chunks_mut(band));
    rows::run(&last, size.height, outs);
}

/// Downsamples one level; holds the finer level.
struct Pull<'a> {
    color: Pixels<'a>,
    /// Input quality of the finest level, unchecked; `None` means 1.
    quality: Option<Pixels<'a>>,
    /// Quality of a pyramid level.
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
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: BandMut<'a>) {
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

/// Fills the holes of one level from the next coarser one.
struct Push<'a> {
    coarse: &'a Image,
    channels: usize,
    factor: usize,
    /// Per column: the two coarse columns around and the weight of the second.
    columns: Vec<([u32; 2], f32)>,
}

impl<'a> Push<'a> {
    fn new(coarse: &'a Image, factor: usize, size: Size) -> Self {
        let columns = (0..size.width).map(|x| interpolation(x, factor, coarse.size.width));
        Self {
            coarse,
            channels: coarse.channels - 1,
            factor,
            columns: columns.collect(),
        }
    }

    /// Interpolates the coarse level at the height of row `y`: colour premultiplied by quality, then quality.
    #[inline(always)]
    fn blend(&self, y: usize, blended: &mut [f32]) {
        let Size { height, width } = self.coarse.size;
        let ([above, below], weight) = interpolation(y, self.factor, height);
        let quality = self.coarse.view().channel(self.channels);
        let known = [above, below].map(|y| quality.row(0, y as usize));
        let (products, sums) = blended.split_at_mut(self.channels * width);
        for x in 0..width {
            sums[x] = known[0][x] * (1.0 - weight) + known[1][x] * weight;
        }
        for (channel, products) in products.chunks_exact_mut(width).enumerate() {
            let [above, below] = [above, below].map(|y| {
                self.coarse.view().plane(channel)[y as usize * width..]
                    .split_at(width)
                    .0
            });
            for x in 0..width {
                let (a, b) = (above[x] * known[0][x], below[x] * known[1][x]);
                products[x] = a * (1.0 - weight) + b * weight;
            }
        }
    }

    /// Interpolates such a row at column `x`: returns the quality and, if it is above 0, passes the colour to `set`.
    #[inline(always)]
    fn fill(&self, blended: &[f32], x: usize, mut set: impl FnMut(usize, f32)) -> f32 {
        let width = self.coarse.size.width;
        let ([left, right], weight) = self.columns[x];
        let at = |channel: usize| {
            let row = &blended[channel * width..][..width];
            row[left as usize] * (1.0 - weight) + row[right as usize] * weight
        };
        let quality = at(self.channels);
        if quality > 0.0 {
            for channel in 0..self.channels {
                set(channel, at(channel) / quality);
            }
        }
        quality
    }

    fn scratch(&self) -> Vec<f32> {
        vec![0.0; (self.channels + 1) * self.coarse.size.width]
    }
}

/// The two coarse pixels whose centres enclose a fine pixel's along an axis, and the weight of the second.
#[inline(always)]
fn interpolation(place: usize, factor: usize, count: usize) -> ([u32; 2], f32) {
    let at = (place as f32 + 0.5) / factor as f32 - 0.5;
    let first = at.floor();
    let last = count as i32 - 1;
    let pixels = [0, 1].map(|next| (first as i32 + next).clamp(0, last) as u32);
    (pixels, at - first)
}

impl<'a> Kernel for Push<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: BandMut<'a>) {
        let mut blended = self.scratch();
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

/// Writes the finest level, interleaved.
struct Fill<'a> {
    finest: Pull<'a>,
    push: Option<Push<'a>>,
}

impl<'a> Kernel for Fill<'a> {
    type Out = (&'a mut [f32], &'a mut [f32]);

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, (filled, qualities): Self::Out) {
        let Pixels { size, channels, .. } = self.finest.color;
        let mut blended = self.push.as_ref().map_or(vec![], Push::scratch);
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
