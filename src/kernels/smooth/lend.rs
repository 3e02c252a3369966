//! Samples for the pixels that were not traced, borrowed from those that were.
//!
//! A pixel without a sample gets one from its neighbours ([`super::joint_bilateral`]), which counts as w/(1 + N) of a sample
//! where its history has N. So a borrowed sample is what a history begins with, and soon hardly shows among its own.
//!
//! Inputs: colour (3), NaN where nothing was traced; history length (1); guide. Outputs: colour (3); how much of a sample each
//! is (1); the number of pixels that had none.

use std::ops::Range;

use super::guide::Guide;
use super::joint_bilateral::{self, reconstruct};
use crate::error::{Result, in_range};
use crate::image::{BandMut, Image, View};
use crate::math::is_present;
use crate::rows::{self, BAND, Kernel, Simd};

/// How samples are borrowed, and what they count.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// w: how much of a sample a borrowed one is, where nothing else is known; above 0 to 1.
    pub weight: f32,
    /// The neighbours that samples are borrowed from.
    pub window: joint_bilateral::Params,
}

impl Params {
    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        in_range("weight", self.weight, "a share above 0 to 1", |v| {
            v > 0.0 && v <= 1.0
        })?;
        self.window.check()
    }
}

/// A colour with borrowed samples.
pub struct Lent {
    /// NaN where no neighbour had a sample either.
    pub color: Image,
    /// How much of a sample each pixel is.
    pub weight: Image,
    /// Pixels that had no sample.
    pub missing: usize,
}

/// Fills the pixels without a sample, where neighbours have one. `length` is the history's, before this frame. The guide
/// must have a halo of the window's radius.
pub fn lend(color: &Image, length: View, guide: &Guide, params: Params) -> Lent {
    let size = color.size;
    let mut weight = Image::blank(size, 1);
    let mut missing = vec![0; size.height.div_ceil(BAND)];
    let kernel = Weigh {
        color: color.view(),
        length,
        weight: params.weight,
    };
    rows::run(&kernel, size.height, weight.bands().zip(&mut missing));
    Lent {
        color: reconstruct(color.pixels(), guide, params.window),
        weight,
        missing: missing.iter().sum(),
    }
}

struct Weigh<'a> {
    color: View<'a>,
    length: View<'a>,
    weight: f32,
}

impl<'a> Kernel for Weigh<'a> {
    type Out = (BandMut<'a>, &'a mut usize);

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, (mut weight, missing): Self::Out) {
        for y in rows {
            let [r, g, b] = self.color.rows(y);
            let length = self.length.row(0, y);
            for (x, weight) in weight.row(0, y).iter_mut().enumerate() {
                let own = is_present([r[x], g[x], b[x]]);
                *missing += usize::from(!own);
                let lent = self.weight / (1.0 + length[x]);
                *weight = if own { 1.0 } else { lent };
            }
        }
    }
}
