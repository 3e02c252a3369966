//! What goes into a pipeline and what comes out, one frame at a time.

use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

use super::motion_check::{Check, Mistake};
use crate::error::{Error, Result};
use crate::image::{BandMut, Image, Pixels, Records, SEGMENT, Size, segments};
use crate::kernels::camera::motion::{Geometry, Transforms, motion_vectors};
use crate::kernels::camera::pinhole::Camera;
use crate::kernels::judge::surface::Surface;
use crate::memory::Reserve;
use crate::pixels::{PixelsMut, Row};
use crate::rows::{self, Kernel};

/// One frame's buffers.
pub struct Frame<'a> {
    pub color: Pixels<'a>,
    pub albedo: Option<Pixels<'a>>,
    pub emission: Option<Pixels<'a>>,
    /// Its colour is the albedo.
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

    /// The motion that came with the frame; or, if both cameras are known and where surfaces are, computed; or none. Where
    /// it came without change of depth, that is completed from the cameras, as far as they tell the same motion.
    pub fn motion(&self, previous: Option<&Camera>, used: &mut Vec<&'static str>) -> Motion<'a> {
        let cameras = self.camera.as_ref().zip(previous);
        match self.motion {
            Some(motion) => {
                used.push("motion");
                let still = cameras.zip(self.geometry());
                match still.filter(|_| motion.channels == 2) {
                    Some((cameras, geometry)) => {
                        let still = find_motion(motion.size, Some(cameras), Some(geometry), used);
                        Motion::Completed(complete(motion, still))
                    }
                    None => Motion::Given(motion),
                }
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

/// What the next frame's tests ask of a frame's surfaces; in records, as all that is fetched in several channels.
pub struct SurfaceRecords {
    depth: Option<Records>,
    normal: Option<Records>,
    object_normal: Option<Records>,
    ids: Option<Records<u32>>,
    color: Option<Records>,
}

impl SurfaceRecords {
    pub fn of(surface: &Surface) -> Self {
        Self {
            depth: surface.depth.map(Pixels::to_records),
            normal: surface.normal.map(Pixels::to_records),
            object_normal: surface.object_normal.map(Pixels::to_records),
            ids: surface.ids.map(Pixels::to_records),
            color: surface.color.map(Pixels::to_records),
        }
    }

    pub fn surface(&self) -> Surface<'_> {
        Surface {
            depth: self.depth.as_ref().map(Records::pixels),
            normal: self.normal.as_ref().map(Records::pixels),
            object_normal: self.object_normal.as_ref().map(Records::pixels),
            ids: self.ids.as_ref().map(Records::pixels),
            color: self.color.as_ref().map(Records::pixels),
        }
    }
}

/// Pixels in which a motion may differ from that of the cameras and still be theirs.
const SAME_MOTION: f32 = 0.5;

/// A motion without change of depth gets that of what stands still where it moves like it, and none elsewhere: objects that
/// move by themselves are expected at the depth that they have.
fn complete(motion: Pixels, mut still: Image) -> Image {
    let height = motion.size.height;
    rows::run(&Complete(motion), height, still.bands());
    still
}

struct Complete<'a>(Pixels<'a>);

impl<'a> Kernel for Complete<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut still: BandMut<'a>) {
        let mut given = [[0.0; SEGMENT]; 2];
        for y in rows {
            let [sx, sy, change] = still.rows(y);
            for run in segments(y, self.0.size.width) {
                self.0.read(run, given.each_mut().map(Row::as_mut_slice));
                for i in 0..run.len {
                    let (x, [gx, gy]) = (run.x + i, [given[0][i], given[1][i]]);
                    let (dx, dy) = (gx - sx[x], gy - sy[x]);
                    let same = dx * dx + dy * dy <= SAME_MOTION * SAME_MOTION;
                    (sx[x], sy[x]) = (gx, gy);
                    change[x] = if same { change[x] } else { 0.0 };
                }
            }
        }
    }
}

pub enum Motion<'a> {
    Given(Pixels<'a>),
    /// From the cameras, of what stands still.
    Computed(Image),
    /// Given, with the change of depth that cameras tell.
    Completed(Image),
}

impl Motion<'_> {
    pub fn pixels(&self) -> Pixels<'_> {
        match self {
            Self::Given(pixels) => *pixels,
            Self::Computed(image) | Self::Completed(image) => image.pixels(),
        }
    }

    /// Whether the change of depth is that of the pixel's own surface, as the test against planes needs it.
    pub fn tells_depth(&self) -> bool {
        self.pixels().channels == 3 && !matches!(self, Self::Completed(_))
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
    /// What was chosen, where the pipeline chooses.
    pub choice: Option<&'a mut [f32]>,
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
