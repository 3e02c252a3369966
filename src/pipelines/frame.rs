//! What goes into a pipeline and what comes out, one frame at a time.

mod motion;
mod motion_check;
mod output;

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

pub use self::motion::{Motion, still_motion};
use self::motion_check::Check;
pub use self::motion_check::Mistake;
pub(super) use self::output::Expectation;
pub use self::output::{
    Extras, History, HistoryMut, Output, Report, Results, blacken_missing, show,
};
use crate::error::{Error, Result};
use crate::image::{Interleaved, Pixels, Size, check_shapes};
use crate::kernels::camera::pinhole::Camera;
use crate::kernels::fetch::validate::Surface;
use crate::memory::Scratch;
use crate::rows::{self, Settings};

/// One frame's buffers: its colour, and what else the renderer knows of it. All have one size.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// 3 channels; linear, scene-referred and unclamped. Samples with NaN or infinity count as missing.
    pub color: Pixels<'a>,
    /// 3 channels; the reflectance of the visible surface, 0 to 1; zeros where nothing was hit.
    pub albedo: Option<Pixels<'a>>,
    /// 3 channels; light that the visible surface emits: the part of the colour that has no noise.
    pub emission: Option<Pixels<'a>>,
    /// The buffers that surface tests compare. Pipelines take their colour from `albedo`.
    pub surface: Surface<'a>,
    /// 3 channels; world space; not finite where nothing was hit.
    pub position: Option<Pixels<'a>>,
    /// 2 or 3 channels; previous minus current position in pixels, x right, y down, without jitter; the third channel is
    /// previous minus current depth.
    pub motion: Option<Pixels<'a>>,
    /// 3 channels; the previous frame rendered again with its camera and random numbers, but this frame's scene. NaN where
    /// another surface shows.
    pub replay: Option<Pixels<'a>>,
    /// 1 channel; distance from the surface to what it reflects, +inf for the environment.
    pub hit_distance: Option<Pixels<'a>>,
    /// 1 channel; how little of the history [`upscaler`](super::upscaler) may show, 0 (all of it) to 1 (nothing).
    pub reactive: Option<Pixels<'a>>,
    /// Without jitter, and of the frame's size.
    pub camera: Option<Camera>,
    /// Offset of the samples from their pixel centres in pixels, x right, y down; −0.5 to 0.5.
    pub jitter: Option<[f64; 2]>,
}

/// What tells a frame's surfaces or their texture apart.
pub(super) enum Guides<'a> {
    None,
    /// Depth alone.
    Depth(Pixels<'a>),
    More,
}

impl<'a> Frame<'a> {
    /// A frame of which only the colour is known.
    pub fn new(color: Pixels<'a>) -> Self {
        Self {
            color,
            albedo: None,
            emission: None,
            surface: Surface::default(),
            position: None,
            motion: None,
            replay: None,
            hit_distance: None,
            reactive: None,
            camera: None,
            jitter: None,
        }
    }

    /// What tells surfaces or their texture apart.
    pub(super) fn guides(&self) -> Guides<'a> {
        let Surface {
            depth, normal, ids, ..
        } = self.surface;
        match depth {
            _ if self.albedo.is_some() || normal.is_some() || ids.is_some() => Guides::More,
            Some(depth) => Guides::Depth(depth),
            None => Guides::None,
        }
    }

    /// The frame with its albedo as the surface's colour, if all buffers have the channels that they should and the size
    /// of the colour.
    fn checked(&self) -> Result<Self> {
        let Surface {
            depth,
            normal,
            ids,
            object_normal,
            ..
        } = self.surface;
        let size = self.color.size;
        size.check("color")?;
        let buffers = [
            ("color", Some(self.color), 3..=3),
            ("albedo", self.albedo, 3..=3),
            ("emission", self.emission, 3..=3),
            ("depth", depth, 1..=1),
            ("normal", normal, 3..=3),
            ("object_normal", object_normal, 3..=3),
            ("position", self.position, 3..=3),
            ("motion", self.motion, 2..=3),
            ("replay", self.replay, 3..=3),
            ("hit_distance", self.hit_distance, 1..=1),
            ("reactive", self.reactive, 1..=1),
        ];
        let buffers = buffers.into_iter().filter_map(|(name, buffer, wanted)| {
            let buffer = buffer?;
            Some((name, buffer.size, buffer.channels, wanted))
        });
        let ids = ids.map(|ids| ("ids", ids.size, ids.channels, 1..=1));
        check_shapes(size, buffers.chain(ids))?;
        if let Some(camera) = self.camera.filter(|camera| camera.size != size) {
            return Err(Error::value("camera", size, camera.size));
        }
        if let Some(jitter) = self.jitter
            && !jitter.iter().all(|d| d.abs() <= 0.5)
        {
            let got = format!("{jitter:?}");
            return Err(Error::value("jitter", "offsets from -0.5 to 0.5", got));
        }
        let color = self.albedo;
        Ok(Self {
            surface: Surface {
                color,
                ..self.surface
            },
            ..*self
        })
    }
}

/// A copy of the buffers that the next frame's surface tests read; interleaved, as a tap reads all channels of a pixel.
pub struct OwnedSurface {
    depth: Option<Interleaved>,
    normal: Option<Interleaved>,
    object_normal: Option<Interleaved>,
    ids: Option<Interleaved<u32>>,
    color: Option<Interleaved>,
}

impl OwnedSurface {
    pub fn of(surface: &Surface) -> Self {
        Self {
            depth: surface.depth.map(Pixels::to_interleaved),
            normal: surface.normal.map(Pixels::to_interleaved),
            object_normal: surface.object_normal.map(Pixels::to_interleaved),
            ids: surface.ids.map(Pixels::to_interleaved),
            color: surface.color.map(Pixels::to_interleaved),
        }
    }

    /// The ids; empty if there are none.
    pub fn ids_mut(&mut self) -> &mut [u32] {
        self.ids.as_mut().map_or(&mut [], Interleaved::data_mut)
    }

    pub fn forget_ids(&mut self) {
        self.ids = None;
    }

    pub fn surface(&self) -> Surface<'_> {
        Surface {
            depth: self.depth.as_ref().map(Interleaved::pixels),
            normal: self.normal.as_ref().map(Interleaved::pixels),
            object_normal: self.object_normal.as_ref().map(Interleaved::pixels),
            ids: self.ids.as_ref().map(Interleaved::pixels),
            color: self.color.as_ref().map(Interleaved::pixels),
        }
    }
}

/// What else a step reports.
#[derive(Clone, Debug)]
pub struct Summary {
    /// Names of the buffers that took part.
    pub used: Vec<&'static str>,
    /// The number of missing samples: pixels whose colour was not finite, or, of
    /// [`Recirculation`](super::recirculation::Recirculation), whose place is unknown.
    pub missing: usize,
    /// Whether the samples have the noise of the frame before, where the pipeline looks: frames of one seed, or one that is
    /// shown twice.
    pub repeats: bool,
}

/// The names of the buffers that took part, given whether each did.
pub fn names<const N: usize>(buffers: [(&'static str, bool); N]) -> Vec<&'static str> {
    let used = |(name, used): (_, bool)| used.then_some(name);
    buffers.into_iter().filter_map(used).collect()
}

/// What every pipeline keeps from frame to frame beside its history.
#[derive(Default)]
pub struct Upkeep {
    /// Memory for the next frame's images.
    scratch: Scratch,
    check: Check,
}

/// What a [`Pipeline`] is made of, within the crate: other crates cannot leave out the checks.
pub trait Steps: Sized + Send {
    fn upkeep(&mut self) -> &mut Upkeep;

    /// Drops the history.
    fn forget(&mut self);

    /// Runs the passes on the next frame, which is checked. An error leaves the state as it was.
    fn next(&mut self, frame: &Frame, output: Output) -> Result<Summary>;

    /// As [`Pipeline::output_size`].
    fn result_size(&self, size: Size) -> Size {
        size
    }

    /// As [`Pipeline::extras`].
    fn writes(&self) -> Extras {
        Extras::default()
    }

    /// As [`Pipeline::reset`].
    fn start_anew(&mut self) {
        *self.upkeep() = Upkeep::default();
        self.forget();
    }

    /// Runs a step on a frame that it has checked.
    fn checked(
        &mut self,
        frame: &Frame,
        next: impl FnOnce(&mut Self, &Frame) -> Result<Summary> + Send,
    ) -> Result<(Summary, Option<Mistake>)> {
        Settings::from_environment()?;
        let frame = &frame.checked()?;
        // Images are in memory that earlier frames freed.
        let mut upkeep = std::mem::take(self.upkeep());
        let next = || upkeep.scratch.install(|| next(self, frame));
        let next = AssertUnwindSafe(|| rows::together(next));
        let summary = catch_unwind(next).unwrap_or_else(|panic| {
            self.start_anew();
            resume_unwind(panic)
        });
        let mistake = summary.as_ref().ok().and_then(|_| upkeep.check.see(frame));
        *self.upkeep() = upkeep;
        Ok((summary?, mistake))
    }
}

mod sealed {
    /// Out of reach for other crates.
    pub trait Sealed {}

    impl<P: super::Steps> Sealed for P {}
}

/// A method that works on a sequence frame by frame. Those of this crate have it; it cannot be implemented outside:
///
/// ```compile_fail,E0277
/// use yester::Size;
/// use yester::error::Result;
/// use yester::pipelines::{Extras, Frame, Mistake, Output, Pipeline, Summary};
///
/// struct Unchecked;
///
/// impl Pipeline for Unchecked {
///     fn output_size(&self, size: Size) -> Size { size }
///     fn extras(&self) -> Extras { Extras::default() }
///     fn reset(&mut self) {}
///     fn step(&mut self, _: &Frame, _: Output) -> Result<(Summary, Option<Mistake>)> { loop {} }
/// }
/// ```
pub trait Pipeline: sealed::Sealed {
    /// The size of the results for frames of this size.
    fn output_size(&self, size: Size) -> Size;

    /// The outputs that this pipeline writes beside those of all pipelines.
    fn extras(&self) -> Extras;

    /// Starts a new sequence.
    fn reset(&mut self);

    /// Runs the passes on the next frame of the sequence. Also returns what seems wrong with the frame's motion, which is
    /// checked once, at the second frame.
    ///
    /// # Errors
    /// If a buffer, the camera or an output has another size or other channels than it should, the jitter is above half a
    /// pixel, the pipeline needs a buffer that is absent, or an environment variable of [`Settings`] has a value that it
    /// cannot have; and if the size changes, or albedo is given in some frames and absent in others, without a
    /// [`reset`](Self::reset). The history is then as before.
    ///
    /// # Panics
    /// If an allocation fails, with [`OutOfMemory`](crate::OutOfMemory). A panic resets the pipeline, which stays usable.
    fn step(&mut self, frame: &Frame, output: Output) -> Result<(Summary, Option<Mistake>)>;
}

impl<P: Steps> Pipeline for P {
    fn output_size(&self, size: Size) -> Size {
        self.result_size(size)
    }

    fn extras(&self) -> Extras {
        self.writes()
    }

    fn reset(&mut self) {
        self.start_anew();
    }

    fn step(&mut self, frame: &Frame, output: Output) -> Result<(Summary, Option<Mistake>)> {
        self.checked(frame, |pipeline, frame| {
            output.check(pipeline.result_size(frame.color.size), pipeline.writes())?;
            pipeline.next(frame, output)
        })
    }
}

/// Refuses a frame whose size differs from the sequence's.
pub fn check_size(before: Size, now: Size) -> Result<()> {
    if before == now {
        return Ok(());
    }
    let expected = format!("{before}, as in the other frames (or reset() between)");
    Err(Error::value("frame", expected, now))
}

#[cfg(test)]
mod tests;
