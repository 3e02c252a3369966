//! The motion of a frame: given, completed, or made from cameras.

use std::ops::Range;

use super::{Frame, names};
use crate::image::{BandMut, Image, Pixels, SEGMENT, Size, segments};
use crate::kernels::camera::depth_change::depth_change;
use crate::kernels::camera::motion::{Geometry, Transforms, is_still, motion_vectors};
use crate::kernels::camera::pinhole::Camera;
use crate::math::{is_background, is_present};
use crate::pixels::{MotionLanes, MotionRun};
use crate::rows::{self, Kernel, Simd};

impl<'a> Frame<'a> {
    /// Whether neither the camera nor anything else moves. Without motion, only the cameras can tell.
    pub(in crate::pipelines) fn rests(&self, previous: Option<&Camera>) -> bool {
        let camera = self.camera.as_ref() == previous;
        camera && self.motion.map_or(previous.is_some(), is_zero)
    }

    /// Positions, or else depth.
    pub(in crate::pipelines) fn geometry(&self) -> Option<Geometry<'a>> {
        (self.position.map(Geometry::Position)).or(self.surface.depth.map(Geometry::Depth))
    }

    /// The motion that came with the frame; else that of a still scene, if both cameras and the geometry are known; else
    /// zero. The cameras complete it where it is unknown, and if it came without change of depth; without them, the depth of
    /// the previous frame tells a change that most surfaces share.
    pub(in crate::pipelines) fn motion(
        &self,
        previous: Option<&Camera>,
        previous_depth: Option<Pixels>,
        used: &mut Vec<&'static str>,
    ) -> Motion<'a> {
        let size = self.color.size;
        used.extend(self.motion.map(|_| "motion"));
        let lacks = |motion: Pixels| {
            motion.channels == 2
                || self
                    .geometry()
                    .is_some_and(|geometry| has_unknown(motion, geometry))
        };
        let asks = previous.is_some() && self.motion.is_none_or(lacks);
        let still = asks.then(|| self.still(previous)).flatten();
        if still.is_some() {
            let position = matches!(self.geometry(), Some(Geometry::Position(_)));
            used.extend(names([("camera", true), ("position", position)]));
        }
        match (self.motion.zip(self.geometry()), still) {
            (Some((motion, geometry)), Some(still)) => complete(motion, geometry, still),
            (None, Some(still)) => Motion::Computed(still),
            (_, None) => match self.motion {
                Some(motion) => approach(motion, self.surface.depth.zip(previous_depth)),
                None => Motion::Computed(Image::new(size, 2)),
            },
        }
    }

    /// The motion, with change of depth, if only the camera moves; None if cameras or geometry are unknown.
    pub(in crate::pipelines) fn still(&self, previous: Option<&Camera>) -> Option<Image> {
        let ((camera, previous), geometry) =
            (self.camera.as_ref().zip(previous)).zip(self.geometry())?;
        Some(still_motion(self.color.size, geometry, camera, previous))
    }
}

/// Motion up to so many pixels counts as none.
const NO_MOTION: f32 = 1e-3;

/// Whether no pixel moves. Motion of NaN is unknown, and does not count as movement.
fn is_zero(motion: Pixels) -> bool {
    let mut row = [[0.0; SEGMENT]; 2];
    let mut runs = (0..motion.size.height).flat_map(|y| segments(y, motion.size.width));
    runs.all(|run| {
        motion.read_rows(run, &mut row);
        let moves = |v: &f32| v.abs() > NO_MOTION;
        !row.iter().any(|row| row[..run.len].iter().any(moves))
    })
}

/// The motion, with change of depth, of a scene in which only the camera moves.
pub fn still_motion(size: Size, geometry: Geometry, camera: &Camera, previous: &Camera) -> Image {
    let mut motion = Image::blank(size, 3);
    let still = Transforms::default();
    let out = motion.pixels_mut();
    motion_vectors(geometry, camera, previous, None, &still, out);
    motion
}

/// Every so many rows are searched for missing motion vectors: an object without them is higher than that.
const LOOKED_AT: usize = 4;

/// Whether a motion vector is missing (NaN), or zero: then geometry has to decide.
#[inline(always)]
fn may_be_unknown([x, y]: [f32; 2]) -> bool {
    !(x.is_finite() & y.is_finite()) | ((x == 0.0) & (y == 0.0))
}

/// Whether the motion of a pixel is unknown: it is not finite, or zero where nothing was hit, where only the camera moves.
#[inline(always)]
fn is_unknown([x, y]: [f32; 2], geometry: Geometry, pixel: usize) -> bool {
    let missed = || match geometry {
        Geometry::Depth(depth) => is_background(depth.at(pixel, 0)),
        Geometry::Position(position) => !is_present(position.vector(pixel)),
    };
    may_be_unknown([x, y]) && ((x != 0.0) | (y != 0.0) || missed())
}

/// Whether motion is unknown somewhere.
fn has_unknown(motion: Pixels, geometry: Geometry) -> bool {
    let Size { height, width } = motion.size;
    let mut lanes = MotionLanes::zeroed();
    let mut runs = (0..height)
        .step_by(LOOKED_AT)
        .flat_map(|y| segments(y, width));
    runs.any(|run| {
        let start = run.y * width + run.x;
        let MotionRun { x, y, .. } = lanes.load(&motion, run);
        // Most runs need no look at the geometry.
        let open = (0..run.len).fold(false, |any, i| any | may_be_unknown([x[i], y[i]]));
        open && (0..run.len).any(|i| is_unknown([x[i], y[i]], geometry, start + i))
    })
}

/// Adds the change of depth that most surfaces share, if any, to a motion of two channels, given the depths now and before.
fn approach<'a>(motion: Pixels<'a>, depths: Option<(Pixels, Pixels)>) -> Motion<'a> {
    let depths = depths.filter(|_| motion.channels == 2);
    let change = depths.map_or(0.0, |(now, before)| depth_change(now, before, motion));
    if change == 0.0 {
        return Motion::Given(motion);
    }
    let size = motion.size;
    let mut changed = Image::blank(size, 3);
    let (plane, pixels) = (size.pixels(), changed.data_mut());
    pixels[2 * plane..].fill(change);
    let (x, y) = pixels[..2 * plane].split_at_mut(plane);
    for run in (0..size.height).flat_map(|y| segments(y, size.width)) {
        let at = run.y * size.width + run.x;
        motion.read(run, [&mut x[at..][..run.len], &mut y[at..][..run.len]]);
    }
    Motion::Completed(changed)
}

/// Puts the still scene's motion where motion is unknown, and adds the change of depth to a motion of two channels: the still
/// scene's where both motions agree, 0 elsewhere, so that an object that moves by itself is expected to keep its depth.
fn complete<'a>(motion: Pixels, geometry: Geometry, mut still: Image) -> Motion<'a> {
    let height = motion.size.height;
    rows::run(&Complete { motion, geometry }, height, still.bands());
    match motion.channels {
        2 => Motion::Completed(still),
        _ => Motion::Computed(still),
    }
}

struct Complete<'a> {
    motion: Pixels<'a>,
    geometry: Geometry<'a>,
}

impl<'a> Kernel for Complete<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut still: BandMut<'a>) {
        let width = self.motion.size.width;
        let mut lanes = MotionLanes::zeroed();
        for y in rows {
            let [sx, sy, change] = still.rows(y);
            for run in segments(y, width) {
                let given = lanes.load(&self.motion, run);
                for i in 0..run.len {
                    let (x, own) = (run.x + i, [given.x[i], given.y[i]]);
                    if is_unknown(own, self.geometry, y * width + x) {
                        continue;
                    }
                    let same = is_still(own, [sx[x], sy[x]]);
                    [sx[x], sy[x]] = own;
                    let known = given.depth.map(|depth| depth[i]);
                    change[x] = known.unwrap_or(if same { change[x] } else { 0.0 });
                }
            }
        }
    }
}

pub enum Motion<'a> {
    Given(Pixels<'a>),
    /// Of a still scene, from the cameras, everywhere or where none was given; or zero.
    Computed(Image),
    /// Given without change of depth, which cameras or the previous depth added.
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
