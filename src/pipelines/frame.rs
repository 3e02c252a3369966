//! What goes into a pipeline and what comes out, one frame at a time.

use crate::error::{Error, Result};
use crate::image::{Image, Size, View};
use crate::kernels::camera::motion::{Geometry, Transforms, motion_vectors};
use crate::kernels::camera::pinhole::Camera;
use crate::kernels::judge::surface::Surface;

/// One frame's buffers.
pub struct Frame<'a> {
    pub color: View<'a>,
    pub albedo: Option<View<'a>>,
    pub emission: Option<View<'a>>,
    pub surface: Surface<'a>,
    pub position: Option<View<'a>>,
    pub motion: Option<View<'a>>,
    pub replay: Option<View<'a>>,
    pub hit_distance: Option<View<'a>>,
    pub camera: Option<Camera>,
    pub jitter: Option<[f64; 2]>,
}

impl<'a> Frame<'a> {
    pub fn geometry(&self) -> Option<Geometry<'a>> {
        self.position
            .map(Geometry::Position)
            .or(self.surface.depth.map(Geometry::Depth))
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
            motion_vectors(geometry, camera, previous, None, &Transforms::default())
        }
        None => Image::new(size, 2),
    }
}

pub enum Motion<'a> {
    Given(View<'a>),
    Computed(Image),
}

impl Motion<'_> {
    pub fn view(&self) -> View<'_> {
        match self {
            Self::Given(view) => *view,
            Self::Computed(image) => image.view(),
        }
    }
}

/// What a step returns.
pub struct Output {
    pub color: Image,
    /// Of the luminance, where the pipeline estimates it.
    pub variance: Option<Image>,
    pub history_length: Image,
    pub confidence: Image,
    pub rejection: Image<u8>,
    /// Names of the buffers that took part.
    pub used: Vec<&'static str>,
    /// Samples that were not finite.
    pub missing: usize,
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

/// Where nobody has seen anything, nor has a neighbour, there is black.
pub fn blacken_missing(color: &mut Image) {
    let missing = color.data_mut().iter_mut().filter(|v| !v.is_finite());
    missing.for_each(|v| *v = 0.0);
}
