//! What goes into a pipeline and what comes out, one frame at a time.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

use super::motion_check::{Check, Mistake};
use crate::error::{Error, Result};
use crate::image::{Image, Pixels, Size};
use crate::kernels::camera::motion::{Geometry, Transforms, motion_vectors};
use crate::kernels::camera::pinhole::Camera;
use crate::kernels::judge::surface::Surface;
use crate::memory::Reserve;
use crate::pixels::PixelsMut;

/// One frame's buffers.
pub struct Frame<'a> {
    pub color: Pixels<'a>,
    pub albedo: Option<Pixels<'a>>,
    pub emission: Option<Pixels<'a>>,
    pub surface: Surface<'a>,
    pub position: Option<Pixels<'a>>,
    pub motion: Option<Pixels<'a>>,
    pub replay: Option<Pixels<'a>>,
    pub hit_distance: Option<Pixels<'a>>,
    pub reactive: Option<Pixels<'a>>,
    pub camera: Option<Camera>,
    pub jitter: Option<[f64; 2]>,
}

impl<'a> Frame<'a> {
    pub fn geometry(&self) -> Option<Geometry<'a>> {
        (self.position.map(Geometry::Position)).or(self.surface.depth.map(Geometry::Depth))
    }

    /// The motion that came with the frame; or, if both cameras are known and where surfaces are, computed; or none.
    pub fn motion(&self, previous: Option<&Camera>, used: &mut Vec<&'static str>) -> Motion<'a> {
        let cameras = self.camera.as_ref().zip(previous);
        match self.motion {
            Some(motion) => {
                used.push("motion");
                Motion::Given(motion)
            }
            None => {
                let size = self.color.size;
                Motion::Computed(find_motion(size, cameras, self.geometry(), used))
            }
        }
    }
}

/// The motion of what stands still, if both cameras are known and where surfaces are; or none.
pub fn find_motion(
    size: Size,
    cameras: Option<(&Camera, &Camera)>,
    geometry: Option<Geometry>,
    used: &mut Vec<&'static str>,
) -> Image {
    match cameras.zip(geometry) {
        Some(((camera, previous), geometry)) => {
            used.push("camera");
            let mut motion = Image::blank(size, 3);
            let out = motion.bands().map(PixelsMut::Planar);
            let still = Transforms::default();
            motion_vectors(geometry, camera, previous, None, &still, out);
            motion
        }
        None => Image::new(size, 2),
    }
}

pub enum Motion<'a> {
    Given(Pixels<'a>),
    Computed(Image),
}

impl Motion<'_> {
    pub fn pixels(&self) -> Pixels<'_> {
        match self {
            Self::Given(pixels) => *pixels,
            Self::Computed(image) => image.pixels(),
        }
    }
}

/// Where a step writes its results: records of colour, and a number for each pixel of the others.
pub struct Output<'a> {
    pub color: &'a mut [f32],
    /// Of the luminance, where the pipeline estimates it.
    pub variance: Option<&'a mut [f32]>,
    pub history_length: &'a mut [f32],
    pub confidence: &'a mut [f32],
    pub rejection: &'a mut [u8],
}

/// What else a step knows.
pub struct Summary {
    /// Names of the buffers that took part.
    pub used: Vec<&'static str>,
    /// Samples that were not finite.
    pub missing: usize,
}

/// What every pipeline keeps from frame to frame beside its history.
#[derive(Default)]
pub struct Upkeep {
    reserve: Reserve,
    check: Check,
}

/// A method that works on a sequence frame by frame.
pub trait Pipeline {
    fn upkeep(&mut self) -> &mut Upkeep;

    /// Forgets the history.
    fn forget(&mut self);

    /// Works on the next frame; after an error, everything is as before.
    fn next(&mut self, frame: &Frame, output: Output) -> Result<Summary>;

    /// Forgets the sequence; the next frame is a first one.
    fn reset(&mut self) {
        *self.upkeep() = Upkeep::default();
        self.forget();
    }

    /// Works on the next frame, in memory that earlier ones have left, and looks at its motion. A panic resets the pipeline.
    fn step(&mut self, frame: &Frame, output: Output) -> Result<(Summary, Option<Mistake>)> {
        let mut upkeep = std::mem::take(self.upkeep());
        let next = AssertUnwindSafe(|| upkeep.reserve.serve(|| self.next(frame, output)));
        let summary = catch_unwind(next).unwrap_or_else(|panic| {
            self.reset();
            resume_unwind(panic)
        });
        let mistake = summary.as_ref().ok().and_then(|_| upkeep.check.see(frame));
        *self.upkeep() = upkeep;
        Ok((summary?, mistake))
    }
}

/// Frames of a sequence have one size.
pub fn check_size(before: Size, now: Size) -> Result<()> {
    let text = |Size { height, width }: Size| format!("height {height} and width {width}");
    if before == now {
        return Ok(());
    }
    let expected = format!("{}, as in earlier frames (or reset() before)", text(before));
    Err(Error::value("frame", expected, text(now)))
}
