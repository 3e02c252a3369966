//! Half resolution: frames of which a part is traced, another one each time.
//!
//! [`super::svgf`] with one more kernel, before its accumulation: pixels without a sample borrow one
//! ([`crate::kernels::smooth::joint_bilateral`]). It joins the history as a part of a sample, w/(1 + N) where N are known
//! already. So it is what a history begins with, and where the light has changed; but what was traced soon outweighs it, and
//! in the end histories are the mean of their own samples. The gradient and the reflections ask what was traced alone.

use std::ops::Range;

use super::{svgf, taa};
use crate::error::{Result, in_range};
use crate::image::{BandMut, Image, View};
use crate::kernels::judge::{innovation, neighborhood};
use crate::kernels::merge::accumulate::{self, count_missing};
use crate::kernels::smooth::atrous;
use crate::kernels::smooth::guide::Guide;
use crate::kernels::smooth::joint_bilateral::{self, reconstruct};
use crate::math::is_present;
use crate::rows::{self, BAND, Kernel};

/// Parameters for frames of which a part is traced; [`Params::svgf`] makes a pipeline of them.
#[derive(Clone, Copy, Debug)]
pub struct Params {
    /// w: how much of a sample a reconstructed one is, where nothing else is known; above 0 to 1; 0.1.
    pub weight: f32,
    /// How samples are borrowed.
    pub window: joint_bilateral::Params,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            weight: 0.1,
            window: joint_bilateral::Params::default(),
        }
    }
}

impl Params {
    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        in_range("weight", self.weight, "a share above 0 to 1", |v| {
            v > 0.0 && v <= 1.0
        })?;
        self.window.check()
    }

    /// Those of the rest, which expects more noise than from whole frames, and histories to be wrong more often.
    pub fn svgf(self) -> svgf::Params {
        let clip = neighborhood::Params {
            gamma: 0.6,
            ..taa::Params::DENOISED.clip
        };
        let antialias = taa::Params {
            clip,
            ..taa::Params::DENOISED
        };
        svgf::Params {
            accumulate: accumulate::Params {
                alpha: 0.2,
                ..Default::default()
            },
            atrous: atrous::Params {
                iterations: 5,
                ..Default::default()
            },
            gradient: true,
            reflections: vec![0.5, 2.0],
            antialias: Some(antialias),
            half_res: Some(self),
            innovation: Some(innovation::Params::default()),
            ..svgf::Params::textbook()
        }
    }

    /// Fills a colour, as far as it can, that joins histories of so many samples.
    pub(crate) fn fill(&self, color: &Image, length: View, guide: &Guide) -> (Image, Lent) {
        let size = color.size;
        let mut weight = Image::blank(size, 1);
        let mut missing = vec![0; size.height.div_ceil(BAND)];
        let kernel = Weigh {
            color: color.view(),
            length,
            lent: self.weight,
        };
        rows::run(&kernel, size.height, weight.bands().zip(&mut missing));
        let lent = Lent {
            weight,
            missing: missing.iter().sum(),
        };
        (reconstruct(color.pixels(), guide, self.window), lent)
    }
}

/// What of a colour is reconstructed.
pub(crate) struct Lent {
    /// How much of a sample each pixel is.
    pub weight: Image,
    /// Pixels that had no sample.
    pub missing: usize,
}

struct Weigh<'a> {
    color: View<'a>,
    length: View<'a>,
    /// What a sample counts that is not the pixel's own.
    lent: f32,
}

impl<'a> Kernel for Weigh<'a> {
    type Out = (BandMut<'a>, &'a mut usize);

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, (mut weight, missing): Self::Out) {
        for y in rows {
            let [r, g, b] = self.color.rows(y);
            *missing += count_missing([r, g, b]);
            let length = self.length.row(0, y);
            for (x, weight) in weight.row(0, y).iter_mut().enumerate() {
                let own = is_present([r[x], g[x], b[x]]);
                let lent = self.lent / (1.0 + length[x]);
                *weight = if own { 1.0 } else { lent };
            }
        }
    }
}
