//! What goes into a pipeline and what comes out, one frame at a time.

use std::marker::PhantomData;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

use super::motion_check::{Check, Mistake};
use crate::error::{Error, Result};
use crate::image::{
    BandMut, Image, Pixels, Records, Run, SEGMENT, Size, View, bands_of, check_length, segments,
};
use crate::kernels::camera::motion::{Geometry, Transforms, is_still, motion_vectors};
use crate::kernels::camera::pinhole::Camera;
use crate::kernels::fetch::validate::Surface;
use crate::kernels::merge::accumulate::{CHANNELS, load_history};
use crate::math::is_present;
use crate::memory::Scratch;
use crate::pixels::{MotionLanes, MotionRun, PixelsMut, Row};
use crate::rows::{self, BAND, Kernel, Settings, Simd};

/// One frame's buffers: its colour, and what else the renderer knows of it. All have one size.
#[derive(Clone, Copy)]
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
        for (name, own, channels, wanted) in buffers.chain(ids) {
            if own != size {
                return Err(Error::value(name, size, own));
            }
            if !wanted.contains(&channels) {
                let expected = match (*wanted.start(), *wanted.end()) {
                    (1, _) => "1 channel".into(),
                    (few, most) if few == most => format!("{few} channels"),
                    (few, most) => format!("{few} or {most} channels"),
                };
                return Err(Error::value(name, expected, channels));
            }
        }
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

    /// Whether neither the camera nor anything else moves. Without motion, only the cameras can tell.
    pub(super) fn rests(&self, previous: Option<&Camera>) -> bool {
        let camera = self.camera.as_ref() == previous;
        camera && self.motion.map_or(previous.is_some(), is_zero)
    }

    /// Positions, or else depth.
    pub(super) fn geometry(&self) -> Option<Geometry<'a>> {
        (self.position.map(Geometry::Position)).or(self.surface.depth.map(Geometry::Depth))
    }

    /// The motion that came with the frame; else that of a still scene, if both cameras and the geometry are known; else
    /// zero. The cameras complete it where it is unknown, and if it came without change of depth.
    pub(super) fn motion(
        &self,
        previous: Option<&Camera>,
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
        used.extend(still.as_ref().map(|_| "camera"));
        match (self.motion.zip(self.geometry()), still) {
            (Some((motion, geometry)), Some(still)) => complete(motion, geometry, still),
            (None, Some(still)) => Motion::Computed(still),
            (_, None) => {
                (self.motion).map_or_else(|| Motion::Computed(Image::new(size, 2)), Motion::Given)
            }
        }
    }

    /// The motion, with change of depth, if only the camera moves; None if cameras or geometry are unknown.
    pub(super) fn still(&self, previous: Option<&Camera>) -> Option<Image> {
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
        let rows = row.each_mut().map(Row::as_mut_slice);
        motion.part(0..2).read(run, rows);
        let moves = |v: &f32| v.abs() > NO_MOTION;
        !row.iter().any(|row| row[..run.len].iter().any(moves))
    })
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

    /// Gives the pixels that have one of these ids another one.
    pub fn replace_ids(&mut self, replaced: &[u32], by: u32) {
        for id in self.ids.iter_mut().flat_map(Records::data_mut) {
            *id = if replaced.contains(id) { by } else { *id };
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

/// Rows between those in which unknown motion is looked for: objects without motion are larger.
const LOOKED_AT: usize = 4;

/// Whether motion alone leaves open if it is known.
#[inline(always)]
fn may_be_unknown([x, y]: [f32; 2]) -> bool {
    !(x.is_finite() & y.is_finite()) | ((x == 0.0) & (y == 0.0))
}

/// Whether the motion of a pixel is unknown: it is not finite, or zero where nothing was hit, where only the camera moves.
#[inline(always)]
fn is_unknown([x, y]: [f32; 2], geometry: Geometry, pixel: usize) -> bool {
    let missed = || match geometry {
        Geometry::Depth(depth) => depth.at(pixel, 0) == f32::INFINITY,
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
    /// Two elements for each pixel: along which motion an output stage finds in the frame before what is seen in this one;
    /// for denoisers that look for reflections and have no stage of their own.
    pub motion: Option<&'a mut [f32]>,
}

impl Output<'_> {
    pub(super) fn check(&self, size: Size, extras: Extras) -> Result<()> {
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
    pub(super) fn parts(&mut self, size: Size) -> (&mut [f32], Vec<Report<'_>>) {
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
/// [`Svgf::step_between`](super::Svgf::step_between).
#[derive(Clone, Copy, Debug)]
pub struct History<'a> {
    /// Light, 3 channels, demodulated if frames have albedo; NaN where there is none.
    pub color: Pixels<'a>,
    /// Means of the luminance of light and of its square.
    pub moments: Pixels<'a>,
    /// How many samples each pixel counts for.
    pub length: Pixels<'a>,
    /// As [`Output::confidence`].
    pub confidence: View<'a>,
    /// As [`Output::rejection`].
    pub rejection: View<'a, u8>,
}

impl History<'_> {
    pub(super) fn check(&self, size: Size) -> Result<()> {
        let images = [
            ("color", self.color, 3),
            ("moments", self.moments, 2),
            ("length", self.length, 1),
            ("confidence", self.confidence.into(), 1),
        ];
        let shapes = images.map(|(name, image, wanted)| (name, image.size, image.channels, wanted));
        let (rejection, channels) = (self.rejection.size, self.rejection.channels);
        for (name, own, channels, wanted) in
            shapes
                .into_iter()
                .chain([("rejection", rejection, channels, 1)])
        {
            if own != size {
                return Err(Error::value(name, size, own));
            }
            if channels != wanted {
                return Err(Error::value(name, format!("{wanted} channels"), channels));
            }
        }
        Ok(())
    }

    /// Loads a run of colour, moments and length.
    #[inline(always)]
    pub(super) fn read(&self, run: Run, into: &mut [Row; CHANNELS]) {
        load_history([self.color, self.moments, self.length], run, into);
    }
}

/// Where [`Svgf::recall`](super::Svgf::recall) writes a history, interleaved.
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
pub(super) struct Expectation<'a> {
    pub color: &'a mut [f32],
    pub moments: &'a mut [f32],
    pub length: &'a mut [f32],
    pub motion: &'a mut [f32],
}

impl<'a> HistoryMut<'a> {
    pub(super) fn check(&self, size: Size) -> Result<()> {
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
    pub(super) fn parts(self) -> (Expectation<'a>, &'a mut [f32], &'a mut [u8]) {
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

/// What else a step reports.
#[derive(Clone, Debug)]
pub struct Summary {
    /// Names of the buffers that took part.
    pub used: Vec<&'static str>,
    /// The number of missing samples: pixels whose colour was not finite.
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

/// What [`Pipeline`] is made of. It is out of reach for other crates, so that every step is checked.
pub trait Steps {
    fn upkeep(&mut self) -> &mut Upkeep;

    /// Drops the history.
    fn forget(&mut self);

    /// Runs the passes on the next frame, which is checked. An error leaves the state as it was.
    fn next(&mut self, frame: &Frame, output: Output) -> Result<Summary>;
}

/// A method that works on a sequence frame by frame.
pub trait Pipeline: Steps {
    /// The size of the results for frames of this size.
    fn output_size(&self, size: Size) -> Size {
        size
    }

    /// The outputs that this pipeline writes beside those of all pipelines.
    fn extras(&self) -> Extras {
        Extras::default()
    }

    /// Starts a new sequence.
    fn reset(&mut self) {
        *self.upkeep() = Upkeep::default();
        self.forget();
    }

    /// Runs the passes on the next frame of the sequence. Also returns what seems wrong with the frame's motion, which is
    /// checked once, at the second frame.
    ///
    /// # Errors
    /// If a buffer has another size or other channels than it should, the size changes without a [`reset`](Self::reset), or
    /// the pipeline needs a buffer that is absent. The history is then as before.
    ///
    /// # Panics
    /// If an allocation fails, with [`OutOfMemory`](crate::OutOfMemory). A panic resets the pipeline, which stays usable.
    fn step(&mut self, frame: &Frame, output: Output) -> Result<(Summary, Option<Mistake>)> {
        self.checked(frame, |pipeline, frame| {
            output.check(pipeline.output_size(frame.color.size), pipeline.extras())?;
            pipeline.next(frame, output)
        })
    }

    #[doc(hidden)]
    /// Runs a step on a frame that it has checked.
    fn checked(
        &mut self,
        frame: &Frame,
        next: impl FnOnce(&mut Self, &Frame) -> Result<Summary>,
    ) -> Result<(Summary, Option<Mistake>)> {
        Settings::from_environment()?;
        let frame = &frame.checked()?;
        // Images are in memory that earlier frames freed.
        let mut upkeep = std::mem::take(self.upkeep());
        let next = AssertUnwindSafe(|| upkeep.scratch.install(|| next(self, frame)));
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
    if before == now {
        return Ok(());
    }
    let expected = format!("{before}, as in earlier frames (or reset() before)");
    Err(Error::value("frame", expected, now))
}

#[cfg(test)]
mod tests;
