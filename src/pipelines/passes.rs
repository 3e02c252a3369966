//! The passes of the filter, of which every tile shows as many as it has chosen ([`crate::kernels::judge::choice`]).

use std::ops::Range;

use super::svgf::Sampled;
use crate::image::{BandMut, Image, Pixels, Records, Run, SEGMENT, Size, View, bands_of, segments};
use crate::kernels::judge::choice::{self, Candidates, Levels};
use crate::kernels::smooth::atrous::Filtered;
use crate::pixels::{Colors, Row, larger};
use crate::rows::{self, Kernel};

/// What choosing leaves to the next frame.
pub struct Chose {
    candidates: Candidates,
    evidence: Option<Records>,
    age: usize,
}

/// What of a frame the choice is made by.
pub struct Look<'a> {
    pub fresh: Sampled<'a>,
    /// Along which history was fetched: that of reflections where they were taken.
    pub motion: Pixels<'a>,
    pub coverage: View<'a>,
    pub exposure: f32,
    /// Passes where nothing is known.
    pub usual: usize,
}

/// An image on its way through the passes, of which every pixel shows as many as its tile has chosen.
pub struct Choosing<'a> {
    /// Passes, a fraction where two are mixed.
    levels: View<'a>,
    pub shown: Image,
    /// For the next frame.
    pub chose: Chose,
}

impl<'a> Choosing<'a> {
    /// Chooses by what the frame before has left.
    pub fn new(
        before: Option<Chose>,
        look: Look,
        params: choice::Params,
        start: &Filtered,
        levels: &'a mut [f32],
    ) -> Self {
        let size = start.size();
        let age = before.as_ref().map_or(0, |before| before.age + 1);
        let (chosen, evidence) = before
            .map(|before| {
                choice::choice(
                    &look.fresh,
                    before.candidates.known(),
                    look.motion,
                    look.coverage,
                    before.evidence.as_ref().map(Records::pixels),
                    look.exposure,
                    look.usual,
                    params,
                )
            })
            .unzip();
        let level = Level {
            chosen: chosen.as_ref().map(Levels),
            start,
            usual: look.usual as f32,
        };
        rows::run(&level, size.height, bands_of(levels, size));
        Self {
            levels: View::new(size, 1, levels),
            shown: Image::blank(size, Smooth::CHANNELS),
            chose: Chose {
                candidates: Candidates::none(age),
                evidence,
                age,
            },
        }
    }

    /// Keeps the image after so many passes as a candidate for the next frame, and adds it to the result where it was chosen.
    pub fn see(&mut self, pass: u32, image: &Filtered) {
        let size = image.size();
        self.chose.candidates.keep(image, size);
        let take = Take {
            levels: self.levels,
            image,
            pass: pass as f32,
        };
        rows::run(&take, size.height, self.shown.bands());
    }
}

/// How many passes each pixel shows.
struct Level<'a> {
    chosen: Option<Levels<'a>>,
    /// The image before all passes; pixels that are missing in it get the usual number, which fills them.
    start: &'a Filtered,
    usual: f32,
}

impl<'a> Kernel for Level<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: BandMut<'a>) {
        let mut levels = [self.usual; SEGMENT];
        for run in rows.flat_map(|y| segments(y, self.start.size().width)) {
            let levels = &mut levels[..run.len];
            if let Some(chosen) = &self.chosen {
                chosen.read(run, levels);
                for (level, luminance) in levels.iter_mut().zip(self.start.luminance(run)) {
                    *level = if luminance.is_nan() {
                        self.usual
                    } else {
                        *level
                    };
                }
            }
            out.put(run, levels, 1);
        }
    }
}

/// Adds the image after one number of passes to the result, weighted by its share in each pixel.
struct Take<'a> {
    levels: View<'a>,
    image: &'a Filtered,
    pass: f32,
}

impl<'a> Kernel for Take<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut shown: BandMut<'a>) {
        let mut color = [[0.0; SEGMENT]; 3];
        let mut shares = [0.0; SEGMENT];
        for run in rows.flat_map(|y| segments(y, self.image.size().width)) {
            let levels = &self.levels.row(0, run.y)[run.x..][..run.len];
            let shares = &mut shares[..run.len];
            for (share, &level) in shares.iter_mut().zip(levels) {
                *share = larger(1.0 - (level - self.pass).abs(), 0.0);
            }
            if shares.iter().all(|&share| share == 0.0) {
                continue;
            }
            self.image.colors(run, &mut color);
            let variance = &self.image.variance(run.y)[run.x..][..run.len];
            let values = color.iter().map(Row::as_slice).chain([variance]);
            for (shown, values) in shown.parts(run).zip(values) {
                for (i, shown) in shown.iter_mut().enumerate() {
                    // Of two images that are mixed, that of fewer passes comes first: added to −0, it keeps its bits.
                    let begun = if self.pass > levels[i] { *shown } else { -0.0 };
                    let mixed = begun + shares[i] * values[i];
                    *shown = if shares[i] > 0.0 { mixed } else { *shown };
                }
            }
        }
    }
}

/// What the filter has made of the light.
pub enum Smooth<'a> {
    Filtered(&'a Filtered),
    Chosen(&'a Image),
}

impl Smooth<'_> {
    /// Of what was chosen: colour and variance.
    const CHANNELS: usize = 4;

    pub fn size(&self) -> Size {
        match self {
            Self::Filtered(image) => image.size(),
            Self::Chosen(image) => image.size,
        }
    }

    #[inline(always)]
    pub fn variance(&self, y: usize) -> &[f32] {
        match self {
            Self::Filtered(image) => image.variance(y),
            Self::Chosen(image) => image.view().row(3, y),
        }
    }
}

impl Colors for Smooth<'_> {
    #[inline(always)]
    fn colors(&self, run: Run, into: &mut [Row; 3]) {
        match self {
            Self::Filtered(image) => image.colors(run, into),
            Self::Chosen(image) => image.pixels().colors(run, into),
        }
    }
}
