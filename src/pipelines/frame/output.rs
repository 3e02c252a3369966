//! Where steps write their results, and the histories that a frame has from both sides.

use std::marker::PhantomData;
use std::ops::Range;

use super::Pipeline;
use crate::error::{Error, Result};
use crate::image::{
    BandMut, Pixels, Run, SEGMENT, Size, View, check_length, check_shapes, plane_bands,
};
use crate::kernels::merge::accumulate::{CHANNELS, load_history};
use crate::pixels::Row;
use crate::rows::{self, BAND, Kernel, Simd};

/// The outputs that only some pipelines write.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Extras {
    /// [`Output::variance`].
    pub variance: bool,
    /// [`Output::choice`].
    pub choice: bool,
    /// [`Output::motion`].
    pub motion: bool,
}

/// Where a step writes its results: colour interleaved, one number per pixel for the others, row by row from the top, in the
/// size that [`Pipeline::output_size`] gives.
pub struct Output<'a> {
    /// Three elements for each pixel: its channels side by side. Finite everywhere.
    pub color: &'a mut [f32],
    /// Variance of the filtered luminance, before albedo is put back; for pipelines that estimate it.
    pub variance: Option<&'a mut [f32]>,
    /// Samples that went into each pixel.
    pub history_length: &'a mut [f32],
    /// Weight of the history's footprint that was accepted, 0 to 1; 0 where the pixel starts anew.
    pub confidence: &'a mut [f32],
    /// Bits of [`rejection`](crate::kernels::fetch::validate::rejection): the tests that history failed.
    pub rejection: &'a mut [u8],
    /// The filter passes that each pixel shows, for pipelines that choose their number.
    pub choice: Option<&'a mut [f32]>,
    /// Two elements for each pixel: motion to the previous frame, for a separate output stage. It follows the reflection where
    /// the history of the reflection was used.
    pub motion: Option<&'a mut [f32]>,
}

impl Output<'_> {
    pub(in crate::pipelines) fn check(&self, size: Size, extras: Extras) -> Result<()> {
        size.check("output")?;
        for (name, given, wanted) in [
            ("variance", self.variance.is_some(), extras.variance),
            ("choice", self.choice.is_some(), extras.choice),
            ("motion", self.motion.is_some(), extras.motion),
        ] {
            if given != wanted {
                let text = |there| if there { "Some" } else { "None" };
                return Err(Error::value(name, text(wanted), text(given)));
            }
        }
        let length = |buffer: &Option<&mut [f32]>| buffer.as_ref().map(|buffer| buffer.len());
        let pixels = size.pixels();
        for (name, wanted, got) in [
            ("color", 3 * pixels, Some(self.color.len())),
            ("variance", pixels, length(&self.variance)),
            ("history_length", pixels, Some(self.history_length.len())),
            ("confidence", pixels, Some(self.confidence.len())),
            ("rejection", pixels, Some(self.rejection.len())),
            ("choice", pixels, length(&self.choice)),
            ("motion", 2 * pixels, length(&self.motion)),
        ] {
            check_length(name, wanted, got.unwrap_or(wanted))?;
        }
        Ok(())
    }

    /// The colour, and the report band by band.
    pub(in crate::pipelines) fn parts(&mut self, size: Size) -> (&mut [f32], Vec<Report<'_>>) {
        let report = (plane_bands(self.history_length, size))
            .zip(plane_bands(self.confidence, size))
            .zip(plane_bands(self.rejection, size))
            .map(|((history_length, confidence), rejection)| Report {
                history_length,
                confidence,
                rejection,
            });
        (self.color, report.collect())
    }
}

/// Memory for the results of a pipeline's steps, which each step overwrites.
#[derive(Clone, Debug)]
pub struct Results {
    /// As [`Output::color`].
    pub color: Vec<f32>,
    /// As [`Output::variance`].
    pub variance: Option<Vec<f32>>,
    /// As [`Output::history_length`].
    pub history_length: Vec<f32>,
    /// As [`Output::confidence`].
    pub confidence: Vec<f32>,
    /// As [`Output::rejection`].
    pub rejection: Vec<u8>,
    /// As [`Output::choice`].
    pub choice: Option<Vec<f32>>,
    /// As [`Output::motion`].
    pub motion: Option<Vec<f32>>,
}

impl Results {
    /// For what a pipeline makes of frames of a size.
    ///
    /// # Errors
    /// If the size is empty or too large.
    pub fn new(pipeline: &impl Pipeline, size: Size) -> Result<Self> {
        let size = pipeline.output_size(size);
        size.check("size")?;
        let (n, extras) = (size.pixels(), pipeline.extras());
        let zeros = || vec![0.0; n];
        Ok(Self {
            color: vec![0.0; 3 * n],
            variance: extras.variance.then(zeros),
            history_length: zeros(),
            confidence: zeros(),
            rejection: vec![0; n],
            choice: extras.choice.then(zeros),
            motion: extras.motion.then(|| vec![0.0; 2 * n]),
        })
    }

    /// To be written by a step.
    pub fn output(&mut self) -> Output<'_> {
        Output {
            color: &mut self.color,
            variance: self.variance.as_deref_mut(),
            history_length: &mut self.history_length,
            confidence: &mut self.confidence,
            rejection: &mut self.rejection,
            choice: self.choice.as_deref_mut(),
            motion: self.motion.as_deref_mut(),
        }
    }
}

/// A history of a frame's pixels, each in the pixel's own place: an input of
/// [`Svgf::step_between`](crate::pipelines::Svgf::step_between).
#[derive(Clone, Copy, Debug)]
pub struct History<'a> {
    /// Light, 3 channels, demodulated if frames have albedo; NaN where there is none.
    pub color: Pixels<'a>,
    /// Means of the luminance of light and of its square.
    pub moments: Pixels<'a>,
    /// How many samples each pixel counts for.
    pub length: Pixels<'a>,
}

impl History<'_> {
    pub(in crate::pipelines) fn check(&self, size: Size) -> Result<()> {
        let images = [
            ("color", self.color, 3..=3),
            ("moments", self.moments, 2..=2),
            ("length", self.length, 1..=1),
        ];
        let shapes = images.map(|(name, image, wanted)| (name, image.size, image.channels, wanted));
        check_shapes(size, shapes)
    }

    /// Loads a run of colour, moments and length.
    #[inline(always)]
    pub(in crate::pipelines) fn read(&self, run: Run, into: &mut [Row; CHANNELS]) {
        load_history([self.color, self.moments, self.length], run, into);
    }
}

/// Where [`Svgf::recall`](crate::pipelines::Svgf::recall) writes a history, interleaved.
pub struct HistoryMut<'a> {
    /// 3 elements for each pixel, as [`History::color`].
    pub color: &'a mut [f32],
    /// 2 elements for each pixel, as [`History::moments`].
    pub moments: &'a mut [f32],
    /// As [`History::length`].
    pub length: &'a mut [f32],
    /// As [`Output::confidence`].
    pub confidence: &'a mut [f32],
    /// As [`Output::rejection`].
    pub rejection: &'a mut [u8],
    /// As [`Output::motion`].
    pub motion: &'a mut [f32],
}

/// The part of a [`HistoryMut`] that history fills.
pub(in crate::pipelines) struct Expectation<'a> {
    pub color: &'a mut [f32],
    pub moments: &'a mut [f32],
    pub length: &'a mut [f32],
    pub motion: &'a mut [f32],
}

impl<'a> HistoryMut<'a> {
    pub(in crate::pipelines) fn check(&self, size: Size) -> Result<()> {
        let pixels = size.pixels();
        for (name, wanted, got) in [
            ("color", 3 * pixels, self.color.len()),
            ("moments", 2 * pixels, self.moments.len()),
            ("length", pixels, self.length.len()),
            ("confidence", pixels, self.confidence.len()),
            ("rejection", pixels, self.rejection.len()),
            ("motion", 2 * pixels, self.motion.len()),
        ] {
            check_length(name, wanted, got)?;
        }
        Ok(())
    }

    /// What history fills, confidence and rejection.
    pub(in crate::pipelines) fn parts(self) -> (Expectation<'a>, &'a mut [f32], &'a mut [u8]) {
        let Self {
            color,
            moments,
            length,
            confidence,
            rejection,
            motion,
        } = self;
        let expectation = Expectation {
            color,
            moments,
            length,
            motion,
        };
        (expectation, confidence, rejection)
    }
}

/// A band of the outputs that say how much history a pixel has, and why it has no more.
pub struct Report<'a> {
    pub history_length: BandMut<'a>,
    pub confidence: BandMut<'a>,
    pub rejection: BandMut<'a, u8>,
}

impl Report<'_> {
    #[inline(always)]
    pub fn write(&mut self, run: Run, length: &Row, confidence: &Row, rejection: &[u8; SEGMENT]) {
        self.history_length.put(run, length);
        self.confidence.put(run, confidence);
        self.rejection.put(run, rejection);
    }
}

/// Writes the result interleaved, black where no sample was ever seen.
pub fn show(color: View, into: &mut [f32]) {
    color.interleave(into);
    let bands = into.chunks_mut(BAND * color.size.width * 3);
    rows::run(&Blacken(PhantomData), color.size.height, bands);
}

struct Blacken<'a>(PhantomData<&'a f32>);

impl<'a> Kernel for Blacken<'a> {
    type Out = &'a mut [f32];

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, _: Range<usize>, color: &'a mut [f32]) {
        blacken_missing(color);
    }
}

/// Makes missing values black.
#[inline(always)]
pub fn blacken_missing(row: &mut [f32]) {
    for value in row {
        *value = if value.is_finite() { *value } else { 0.0 };
    }
}
