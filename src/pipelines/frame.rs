//! What goes into a pipeline and what comes out, one frame at a time.

use std::marker::PhantomData;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

use super::motion_check::{Check, Mistake};
use crate::error::{Error, Result};
use crate::image::{BandMut, Image, Pixels, Records, Run, SEGMENT, Size, View, bands_of, segments};
use crate::kernels::camera::motion::{Geometry, Transforms, motion_vectors};
use crate::kernels::camera::pinhole::Camera;
use crate::kernels::judge::surface::Surface;
use crate::memory::Reserve;
use crate::pixels::{PixelsMut, Row};
use crate::rows::{self, BAND, Kernel};

/// One frame's buffers.
pub struct Frame<'a> {
    pub color: Pixels<'a>,
    pub albedo: Option<Pixels<'a>>,
    pub emission: Option<Pixels<'a>>,
    /// The buffers that surface tests compare; their colour is the albedo.
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
    /// Positions, or else depth.
    pub fn geometry(&self) -> Option<Geometry<'a>> {
        (self.position.map(Geometry::Position)).or(self.surface.depth.map(Geometry::Depth))
    }

    /// The motion that came with the frame; else that of a still scene, if both cameras and the geometry are known; else
    /// zero. If it came without change of depth, the cameras complete it.
    pub fn motion(&self, previous: Option<&Camera>, used: &mut Vec<&'static str>) -> Motion<'a> {
        let size = self.color.size;
        used.extend(self.motion.map(|_| "motion"));
        let cameras = self.camera.as_ref().zip(previous);
        let still = (cameras.zip(self.geometry()))
            .filter(|_| self.motion.is_none_or(|motion| motion.channels == 2))
            .map(|((camera, previous), geometry)| {
                used.push("camera");
                still_motion(size, geometry, camera, previous)
            });
        match (self.motion, still) {
            (Some(motion), Some(still)) => Motion::Completed(complete(motion, still)),
            (Some(motion), None) => Motion::Given(motion),
            (None, Some(still)) => Motion::Computed(still),
            (None, None) => Motion::Computed(Image::new(size, 2)),
        }
    }
}

/// The motion, with change of depth, of a scene in which only the camera moves.
pub fn still_motion(size: Size, geometry: Geometry, camera: &Camera, previous: &Camera) -> Image {
    let mut motion = Image::blank(size, 3);
    let still = Transforms::default();
    let out = PixelsMut::planar(size, motion.data_mut());
    motion_vectors(geometry, camera, previous, None, &still, out);
    motion
}

/// A copy of the buffers that the next frame's surface tests read; interleaved, as a tap reads all channels of a pixel.
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

/// Pixels by which a motion may differ from the still scene's and count as the same.
const SAME_MOTION: f32 = 0.5;

/// Adds the change of depth to a motion of two channels: the still scene's where both motions agree, 0 elsewhere, so that an
/// object that moves by itself is expected to keep its depth.
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
    /// Of a still scene, from the cameras; or zero.
    Computed(Image),
    /// Given without change of depth, which the cameras added.
    Completed(Image),
}

impl Motion<'_> {
    pub fn pixels(&self) -> Pixels<'_> {
        match self {
            Self::Given(pixels) => *pixels,
            Self::Computed(image) | Self::Completed(image) => image.pixels(),
        }
    }

    /// Whether the change of depth is exact at every pixel, as the plane test needs it: a completed one is a guess where
    /// objects move by themselves.
    pub fn tells_depth(&self) -> bool {
        self.pixels().channels == 3 && !matches!(self, Self::Completed(_))
    }
}

/// Where a step writes its results: colour interleaved, one number per pixel for the others.
pub struct Output<'a> {
    pub color: &'a mut [f32],
    /// Of the result's luminance, for pipelines that estimate it.
    pub variance: Option<&'a mut [f32]>,
    pub history_length: &'a mut [f32],
    pub confidence: &'a mut [f32],
    pub rejection: &'a mut [u8],
    /// The filter passes that each pixel shows, for pipelines that choose their number.
    pub choice: Option<&'a mut [f32]>,
}

impl Output<'_> {
    /// The colour, and the report band by band.
    pub fn parts(&mut self, size: Size) -> (&mut [f32], Vec<Report<'_>>) {
        let report = (bands_of(self.history_length, size))
            .zip(bands_of(self.confidence, size))
            .zip(bands_of(self.rejection, size))
            .map(|((history_length, confidence), rejection)| Report {
                history_length,
                confidence,
                rejection,
            });
        (self.color, report.collect())
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
        self.history_length.put(run, &length[..run.len], 1);
        self.confidence.put(run, &confidence[..run.len], 1);
        self.rejection.put(run, &rejection[..run.len], 1);
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
    fn rows(&self, _: Range<usize>, color: &'a mut [f32]) {
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

/// What else a step reports.
pub struct Summary {
    /// Names of the buffers that took part.
    pub used: Vec<&'static str>,
    /// The number of missing samples.
    pub missing: usize,
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
    reserve: Reserve,
    check: Check,
}

/// A method that works on a sequence frame by frame.
pub trait Pipeline {
    fn upkeep(&mut self) -> &mut Upkeep;

    /// Drops the history.
    fn forget(&mut self);

    /// Runs the passes on the next frame. An error leaves the state as it was.
    fn next(&mut self, frame: &Frame, output: Output) -> Result<Summary>;

    /// Starts a new sequence.
    fn reset(&mut self) {
        *self.upkeep() = Upkeep::default();
        self.forget();
    }

    /// Runs the passes on the next frame, with images in memory that earlier frames freed, and checks the frame's motion. A
    /// panic resets the pipeline.
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

/// Refuses a frame whose size differs from the sequence's.
pub fn check_size(before: Size, now: Size) -> Result<()> {
    let text = |Size { height, width }: Size| format!("height {height} and width {width}");
    if before == now {
        return Ok(());
    }
    let expected = format!("{}, as in earlier frames (or reset() before)", text(before));
    Err(Error::value("frame", expected, text(now)))
}
