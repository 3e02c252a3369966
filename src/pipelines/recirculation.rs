//! Recirculation: whole pictures of frames of which a part of the pixels is traced, as a list of this library's
//! kernels:
//!
//!   (motion of what stands still) → pull-push → splat → motion → recirculate     history is splatted, or
//!   (motion of what stands still) → pull-push → motion → recirculate             history is fetched
//!
//! Splatted, history is a set of points, one for each pixel: colour, depth, place, drift and quality. They are
//! scattered to where they appear now; the new samples, whose holes are filled, join them by quality; the result is
//! the history of the next frame. The motion blur is shown, but not carried on.
//!
//! Fetched, history is the image that was shown last, with its quality. The motion of each pixel follows from the new
//! samples, whose holes are filled, and says where that image is read; nothing tests whether the surface is the same.
//!
//! What new samples show to be wrong with the result is estimated (`innovation`, with sparse samples) and added to it and to
//! what is carried on: light that changes need not wait until its pixel is traced again. Its evidence comes along the motion
//! that the blur has anyway.
//!
//! Where holes are filled, a sample of depth z weighs
//!   w = max(z⁻ᵏ, 10⁻²⁴),
//! k being the nearness: near samples override distant ones, and all override the background. The quality of a filled
//! pixel is divided by the weight at its filled depth, so that it counts samples at any k and in any unit of depth.
//!
//! After "Reprojection 2", a developer's diary of 2008: it fetches history and weighs samples by depth and size. All new
//! samples are of one pixel's size here; points that have grown lose quality in `splat`, filled pixels in `pull_push`.

use std::marker::PhantomData;
use std::ops::Range;

use super::frame::{Frame, Output, Pipeline, Steps, Summary, Upkeep, check_size};
use super::taa::blacken_missing;
use crate::error::{Error, Result, Whole, whole};
use crate::image::{
    BandMut, Image, Pixels, Records, Run, SEGMENT, Size, View, bands_of, deinterleave, interleave,
    segments,
};
use crate::kernels::camera::motion::{Geometry, Shown, Transforms, motion_vectors};
use crate::kernels::camera::pinhole::Camera;
use crate::kernels::fetch::pull_push::{self, pull_push};
use crate::kernels::fetch::splat::{self, Points, Splats, splat};
use crate::kernels::judge::exposure::exposure;
use crate::kernels::judge::innovation::{self, Innovation, corrected, innovation};
use crate::kernels::judge::surface::rejection;
use crate::kernels::merge::recirculate::{self, Known, recirculate};
use crate::math::is_present;
use crate::pixels::{Colors, PixelsMut, Row};
use crate::rows::{self, BAND, Kernel};

/// Parameters of [`Recirculation`].
#[derive(Clone, Copy, Debug)]
pub struct Params {
    /// How what was known is scattered.
    pub splat: splat::Params,
    /// How holes are filled.
    pub pull_push: pull_push::Params,
    /// Its `fetch` says how history comes to where it appears now.
    pub recirculate: recirculate::Params,
    /// Power of the inverse of depth by which samples weigh where holes are filled, k; 0 to 4; 0.
    pub nearness: u32,
    /// None adds nothing.
    pub innovation: Option<innovation::Params>,
}

/// By which results are corrected.
pub const INNOVATION: innovation::Params = innovation::Params {
    sparse: true,
    ..innovation::Params::DEFAULT
};

/// The preset "best".
impl Default for Params {
    fn default() -> Self {
        Self::BEST
    }
}

impl Params {
    /// Names of presets.
    pub const PRESETS: [(&str, Self); 2] = [("best", Self::BEST), ("textbook", Self::TEXTBOOK)];

    /// Whether history is fetched.
    pub const HISTORIES: [(&str, bool); 2] = [("splat", false), ("fetch", true)];

    /// By our own measurements.
    pub const BEST: Self = Self {
        splat: splat::Params {
            tolerance: 0.1,
            reach: 0.5,
        },
        pull_push: pull_push::Params {
            factor: 2,
            levels: usize::MAX,
        },
        recirculate: recirculate::Params {
            blur: 0.25,
            share: [0.0, 1.0],
            fade: 64.0,
            limit: 8.0,
            fetch: false,
        },
        nearness: 0,
        innovation: Some(INNOVATION),
    };

    /// As the diary has it; it gives neither the range of the shares nor the weight of depth.
    pub const TEXTBOOK: Self = Self {
        pull_push: pull_push::Params {
            factor: 4,
            levels: 2,
        },
        recirculate: recirculate::Params {
            share: [0.1, 0.5],
            fetch: true,
            ..Self::BEST.recirculate
        },
        nearness: 1,
        innovation: None,
        ..Self::BEST
    };

    pub(crate) fn nearness(nearness: impl Whole<u32>) -> Result<u32> {
        whole("nearness", nearness, "0 to 4", |n| (0..=4).contains(n))
    }

    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        self.splat.check()?;
        self.pull_push.check()?;
        Self::nearness(self.nearness)?;
        if let Some(innovation) = &self.innovation {
            innovation.check()?;
        }
        self.recirculate.check()
    }
}

/// What one frame leaves to the next.
struct Memory {
    /// And drift, if history is splatted.
    color: Image,
    quality: Records,
    /// Depth, and the offset from the pixel's centre, if history is splatted.
    place: Option<[Records; 2]>,
    /// Of the innovation, after a second frame.
    evidence: Option<Records>,
    camera: Camera,
}

/// The same where it appears now, splatted.
struct Recalled {
    /// And drift.
    color: Records,
    depth: Records,
    offset: Records,
    quality: Records,
}

const CHANNELS: usize = 6;

/// Whole pictures from frames of which a part of the pixels is traced. Frames need a camera, and depth or position.
pub struct Recirculation {
    params: Params,
    upkeep: Upkeep,
    memory: Option<Memory>,
}

impl Recirculation {
    /// A pipeline without history; an error if a parameter is out of range.
    pub fn new(params: Params) -> Result<Self> {
        params.check()?;
        Ok(Self {
            params,
            upkeep: Upkeep::default(),
            memory: None,
        })
    }
}

impl Pipeline for Recirculation {}

impl Steps for Recirculation {
    fn upkeep(&mut self) -> &mut Upkeep {
        &mut self.upkeep
    }

    fn forget(&mut self) {
        self.memory = None;
    }

    fn next(&mut self, frame: &Frame, mut output: Output) -> Result<Summary> {
        let size = frame.color.size;
        let needs = |what| Error::value("frame", what, "one without");
        let camera = frame.camera.ok_or_else(|| needs("one with a camera"))?;
        let geometry = frame.geometry();
        let geometry = geometry.ok_or_else(|| needs("one with depth or position"))?;
        if let Some(memory) = &self.memory {
            check_size(memory.color.size, size)?;
        }
        let continues = self.memory.is_some();
        let previous = self.memory.as_ref().map_or(camera, |memory| memory.camera);
        let moves = frame.motion.filter(|_| continues).map(|motion| {
            let mut still = Image::blank(size, 3);
            let out = still.bands().map(PixelsMut::Planar);
            let none = Transforms::default();
            motion_vectors(geometry, &camera, &previous, None, &none, out);
            (motion, still)
        });

        let mut samples = Samples::new(size);
        let mut counts = vec![0; size.height.div_ceil(BAND)];
        let sort = Sort {
            color: frame.color,
            geometry,
            camera: &camera,
            moves: moves
                .as_ref()
                .map(|(motion, still)| (*motion, still.view())),
            jitter: frame.jitter.unwrap_or_default().map(|v| v as f32),
        };
        let outs = (PixelsMut::bands(size, SAMPLES, samples.color.data_mut()))
            .zip(PixelsMut::bands(size, 3, samples.place.data_mut()))
            .zip(&mut counts)
            .map(|((color, place), missing)| Sorted {
                color,
                place,
                missing,
            });
        rows::run(&sort, size.height, outs);
        drop(moves);
        let new = Fresh::new(samples, frame.color, self.params);
        let cameras = [&camera, &previous];
        let memory = self.memory.take();
        let join = if self.params.recirculate.fetch {
            fetched
        } else {
            splatted
        };
        self.memory = Some(join(memory, new, cameras, self.params, &mut output));
        let band = BAND * size.width;
        let rows = output.color.chunks_mut(3 * band);
        rows::run(&Blacken(PhantomData), size.height, rows);
        let from = match geometry {
            Geometry::Position(_) => "position",
            Geometry::Depth(_) => "depth",
        };
        Ok(Summary {
            used: ["camera", from]
                .into_iter()
                .chain(frame.motion.filter(|_| continues).map(|_| "motion"))
                .chain(frame.jitter.map(|_| "jitter"))
                .collect(),
            missing: counts.iter().sum(),
        })
    }
}

/// New samples with their holes filled.
struct Fresh<'a> {
    /// The frame's own, of which those count that have a place.
    color: Pixels<'a>,
    /// Where they were taken, as in [`Samples`].
    place: Records,
    /// As in [`Samples`].
    filled: Records,
    quality: Records,
}

impl<'a> Fresh<'a> {
    fn new(samples: Samples, own: Pixels<'a>, params: Params) -> Self {
        let Samples { color, place } = samples;
        let size = own.size;
        let (mut filled, mut quality) = (Records::blank(size, SAMPLES), Records::blank(size, 1));
        let weigh = |samples: &Records, weights: &mut Records, divide| {
            let kernel = Weigh {
                inverse: samples.pixels().part(3..4),
                nearness: params.nearness,
                divide,
            };
            let outs = weights.data_mut().chunks_mut(BAND * size.width);
            rows::run(&kernel, size.height, outs);
        };
        let weights = (params.nearness > 0).then(|| {
            let mut weights = Records::blank(size, 1);
            weigh(&color, &mut weights, false);
            weights
        });
        let weighted = weights.as_ref().map(Records::pixels);
        let (colors, qualities) = (filled.data_mut(), quality.data_mut());
        pull_push(
            color.pixels(),
            weighted,
            params.pull_push,
            colors,
            qualities,
        );
        if weights.is_some() {
            weigh(&filled, &mut quality, true);
        }
        Self {
            color: own,
            place,
            filled,
            quality,
        }
    }

    fn known(&self) -> Known<'_> {
        Known {
            color: self.filled.pixels().part(0..3),
            quality: self.quality.pixels(),
        }
    }
}

impl Colors for Fresh<'_> {
    /// Those that were traced; NaN elsewhere.
    #[inline(always)]
    fn colors(&self, run: Run, into: &mut [Row; 3]) {
        let mut depth = [0.0; SEGMENT];
        self.color.colors(run, into);
        self.place.pixels().load(run, 0, &mut depth[..run.len]);
        for (color, depth) in into[0].iter_mut().zip(&depth[..run.len]) {
            *color = if depth.is_nan() { f32::NAN } else { *color };
        }
    }
}

/// Adds what new samples show to be wrong with the result to that and to `carried`, its planes in the memory. Returns the
/// evidence for the next frame.
fn innovate(
    params: innovation::Params,
    new: &Fresh,
    motion: &Image,
    evidence: Option<&Records>,
    carried: &mut [f32],
    output: &mut Output,
) -> Records {
    let size = motion.size;
    let shown = Pixels::records(size, 3, output.color);
    let lengths = Pixels::records(size, 1, output.history_length);
    let known = evidence.map(|evidence| innovation::Known {
        evidence: evidence.pixels(),
        motion: Some(motion.pixels()),
    });
    let (found, rest) = innovation(new, &shown, lengths, known, exposure(shown), params);
    let kernel = Correct {
        found: &found,
        width: size.width,
    };
    let rows = output.color.chunks_mut(3 * BAND * size.width);
    rows::run(&kernel, size.height, rows.zip(bands_of(carried, size)));
    rest
}

struct Correct<'a> {
    found: &'a Innovation,
    width: usize,
}

impl<'a> Kernel for Correct<'a> {
    type Out = (&'a mut [f32], BandMut<'a>);

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, (shown, mut carried): Self::Out) {
        let mut line = self.found.line();
        let mut color = [[0.0; SEGMENT]; 3];
        for y in rows.clone() {
            self.found.go_to(y, &mut line);
            for run in segments(y, self.width) {
                let start = ((y - rows.start) * self.width + run.x) * 3;
                let shown = &mut shown[start..][..run.len * 3];
                deinterleave(shown, color.iter_mut().map(|row| &mut row[..run.len]));
                let Some(found) = self.found.correction(&line, run, &color) else {
                    continue;
                };
                for ((color, carried), found) in
                    color.iter_mut().zip(carried.parts(run)).zip(&found)
                {
                    for ((color, carried), &found) in color.iter_mut().zip(carried).zip(found) {
                        *color = corrected(*color, found);
                        *carried = corrected(*carried, found);
                    }
                }
                interleave(color.iter().map(|row| &row[..run.len]), shown);
            }
        }
    }
}

/// The least weight of a sample: the background's.
const LEAST: f32 = 1e-24;

/// Writes the weights that samples have by depth, or divides by them.
struct Weigh<'a> {
    /// Of depth.
    inverse: Pixels<'a>,
    nearness: u32,
    divide: bool,
}

impl<'a> Kernel for Weigh<'a> {
    type Out = &'a mut [f32];

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, weights: &'a mut [f32]) {
        let first = rows.start * self.inverse.size.width;
        for (i, weight) in weights.iter_mut().enumerate() {
            let inverse = self.inverse.at(first + i, 0);
            let power = (0..self.nearness).fold(1.0, |power, _| power * inverse);
            // NaN stays: there is no sample.
            let heavy = if power < LEAST { LEAST } else { power };
            *weight = match self.divide {
                true if *weight > 0.0 => *weight / heavy,
                true => 0.0,
                false => heavy,
            };
        }
    }
}

/// Joins new samples and points of the past, scattered to where they appear now.
fn splatted(
    memory: Option<Memory>,
    mut new: Fresh,
    cameras: [&Camera; 2],
    params: Params,
    output: &mut Output,
) -> Memory {
    let Params {
        splat,
        recirculate: blend,
        ..
    } = params;
    let [camera, previous] = cameras;
    let size = new.filled.pixels().size;
    let continues = memory.is_some();
    let (mut known, evidence) = match memory {
        Some(memory) => memory.recall(camera, splat),
        None => (Recalled::nothing(size), None),
    };
    let mut color = Image::blank(size, CHANNELS);
    let (colors, drifts) = color.data_mut().split_at_mut(3 * size.pixels());
    let settle = Settle {
        samples: new.place.pixels(),
        filled: new.filled.pixels(),
        drift: known.color.pixels().part(3..6),
        tolerance: splat.tolerance,
        continues,
    };
    let band = BAND * size.width;
    let outs = (known.depth.data_mut().chunks_mut(band))
        .zip(known.offset.data_mut().chunks_mut(2 * band))
        .zip(known.quality.data_mut().chunks_mut(band))
        .zip(bands_of(drifts, size))
        .zip(new.quality.data_mut().chunks_mut(band))
        .zip(output.confidence.chunks_mut(band))
        .zip(output.rejection.chunks_mut(band))
        .map(
            |((((((depth, offset), quality), drift), fresh), confidence), rejection)| Settled {
                depth,
                offset,
                quality,
                drift,
                fresh,
                confidence,
                rejection,
            },
        );
    rows::run(&settle, size.height, outs);

    let mut motion = Image::blank(size, 3);
    let out = motion.bands().map(PixelsMut::Planar);
    let (depth, still) = (Geometry::Depth(known.depth.pixels()), Transforms::default());
    motion_vectors(depth, camera, previous, None, &still, out);
    let drift = View::new(size, 3, drifts).into();
    rows::run(&AddDrift { drift }, size.height, motion.bands());
    let mut quality = Records::blank(size, 1);
    let old = known.known();
    let sharp = recirculate::Params { blur: 0.0, ..blend };
    recirculate(
        new.known(),
        old,
        motion.pixels(),
        sharp,
        PixelsMut::planar(size, colors),
        PixelsMut::bands(size, 1, quality.data_mut()),
    );
    recirculate(
        new.known(),
        old,
        motion.pixels(),
        blend,
        PixelsMut::bands(size, 3, output.color),
        PixelsMut::bands(size, 1, output.history_length),
    );
    let corrects = params.innovation.filter(|_| continues);
    let evidence = corrects.map(|params| {
        let colors = &mut color.data_mut()[..3 * size.pixels()];
        innovate(params, &new, &motion, evidence.as_ref(), colors, output)
    });
    Memory {
        color,
        quality,
        place: Some([known.depth, known.offset]),
        evidence,
        camera: *camera,
    }
}

/// Joins new samples and the image that was shown last, read where each pixel comes from.
fn fetched(
    memory: Option<Memory>,
    new: Fresh,
    [camera, previous]: [&Camera; 2],
    params: Params,
    output: &mut Output,
) -> Memory {
    let filled = new.filled.pixels();
    let size = filled.size;
    let continues = memory.is_some();
    let past = memory.unwrap_or_else(|| Memory {
        color: Image::new(size, 3),
        quality: Records::new(size, 1),
        place: None,
        evidence: None,
        camera: *camera,
    });
    let mut depth = Records::blank(size, 1);
    let outs = depth.data_mut().chunks_mut(BAND * size.width);
    rows::run(&Invert(filled.part(3..4)), size.height, outs);
    let mut motion = Image::blank(size, 3);
    let out = motion.bands().map(PixelsMut::Planar);
    let (depth, still) = (Geometry::Depth(depth.pixels()), Transforms::default());
    motion_vectors(depth, camera, previous, None, &still, out);
    let drift = filled.part(4..7);
    rows::run(&AddDrift { drift }, size.height, motion.bands());
    let old = Known {
        color: past.color.pixels(),
        quality: past.quality.pixels(),
    };
    let (mut color, mut quality) = (Image::blank(size, 3), Records::blank(size, 1));
    recirculate(
        new.known(),
        old,
        motion.pixels(),
        params.recirculate,
        PixelsMut::planar(size, color.data_mut()),
        PixelsMut::bands(size, 1, quality.data_mut()),
    );
    let found = Found {
        quality: past.quality.pixels(),
        motion: motion.pixels(),
        continues,
    };
    let band = BAND * size.width;
    let outs = (output.confidence.chunks_mut(band)).zip(output.rejection.chunks_mut(band));
    rows::run(&found, size.height, outs);
    color.view().interleave(output.color);
    output
        .history_length
        .copy_from_slice(quality.pixels().numbers().0);
    let corrects = params.innovation.filter(|_| continues);
    let evidence = corrects.map(|params| {
        let evidence = past.evidence.as_ref();
        innovate(params, &new, &motion, evidence, color.data_mut(), output)
    });
    Memory {
        color,
        quality,
        place: None,
        evidence,
        camera: *camera,
    }
}

/// Depth from its inverse.
struct Invert<'a>(Pixels<'a>);

impl<'a> Kernel for Invert<'a> {
    type Out = &'a mut [f32];

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, depth: &'a mut [f32]) {
        let first = rows.start * self.0.size.width;
        for (i, depth) in depth.iter_mut().enumerate() {
            *depth = 1.0 / self.0.at(first + i, 0);
        }
    }
}

/// Whether the pixel that motion leads to was known in the previous frame.
struct Found<'a> {
    /// Of the previous frame.
    quality: Pixels<'a>,
    motion: Pixels<'a>,
    continues: bool,
}

impl<'a> Kernel for Found<'a> {
    type Out = (&'a mut [f32], &'a mut [u8]);

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, (confidence, rejection): Self::Out) {
        let Size { height, width } = self.quality.size;
        for (i, pixel) in (rows.start * width..rows.end * width).enumerate() {
            let mut motion = [0, 1].map(|c| self.motion.at(pixel, c));
            if !motion.iter().all(|v| v.abs() < recirculate::FARTHEST) {
                motion = [0.0; 2];
            }
            let x = ((pixel % width) as f32 + 0.5 + motion[0]).floor() as i32;
            let y = ((pixel / width) as f32 + 0.5 + motion[1]).floor() as i32;
            let inside = (0..width as i32).contains(&x) && (0..height as i32).contains(&y);
            let found = inside && self.quality.at(y as usize * width + x as usize, 0) > 0.0;
            confidence[i] = f32::from(u8::from(found));
            rejection[i] = if found || !self.continues {
                0
            } else {
                rejection::OUTSIDE
            };
        }
    }
}

impl Recalled {
    fn nothing(size: Size) -> Self {
        Self {
            color: Records::new(size, CHANNELS),
            depth: Records::new(size, 1),
            offset: Records::new(size, 2),
            quality: Records::new(size, 1),
        }
    }

    fn known(&self) -> Known<'_> {
        Known {
            color: self.color.pixels().part(0..3),
            quality: self.quality.pixels(),
        }
    }
}

impl Memory {
    /// The points where this camera sees them, and the evidence.
    fn recall(self, camera: &Camera, params: splat::Params) -> (Recalled, Option<Records>) {
        let [depth, offset] = self.place.as_ref().expect("left by the same pipeline");
        let mut now = Recalled::nothing(self.color.size);
        let points = Points {
            color: self.color.pixels(),
            depth: depth.pixels(),
            offset: Some(offset.pixels()),
            drift: Some(self.color.pixels().part(3..6)),
            quality: Some(self.quality.pixels()),
        };
        let splats = Splats {
            color: now.color.data_mut(),
            depth: now.depth.data_mut(),
            offset: now.offset.data_mut(),
            quality: now.quality.data_mut(),
        };
        splat(points, [camera, &self.camera], params, splats);
        (now, self.evidence)
    }
}

/// Of [`Samples::color`].
const SAMPLES: usize = 7;

/// What was traced of a frame; NaN where nothing was.
struct Samples {
    /// Colour; the inverse of depth, which grows evenly along a plane and ends at the background; and drift.
    color: Records,
    /// Depth, and the offset from the pixel's centre.
    place: Records,
}

impl Samples {
    fn new(size: Size) -> Self {
        Self {
            color: Records::blank(size, SAMPLES),
            place: Records::blank(size, 3),
        }
    }
}

/// Finds the samples among a frame's pixels: those with colour and a place.
struct Sort<'a> {
    color: Pixels<'a>,
    geometry: Geometry<'a>,
    camera: &'a Camera,
    /// The motion of everything, and of what stands still.
    moves: Option<(Pixels<'a>, View<'a>)>,
    jitter: [f32; 2],
}

struct Sorted<'a> {
    color: PixelsMut<'a>,
    place: PixelsMut<'a>,
    /// Pixels that are none.
    missing: &'a mut usize,
}

impl Sort<'_> {
    /// How the pixels of a run move by themselves.
    #[inline(always)]
    fn drift(&self, run: Run, drift: &mut [Row; 3]) {
        drift.iter_mut().for_each(|row| row.fill(0.0));
        if let Some((motion, still)) = self.moves {
            for (channel, row) in drift.iter_mut().enumerate().take(motion.channels) {
                motion.load(run, channel, &mut row[..run.len]);
                let still = &still.row(channel, run.y)[run.x..][..run.len];
                for (drift, still) in row.iter_mut().zip(still) {
                    let own = *drift - still;
                    *drift = if own.is_finite() { own } else { 0.0 };
                }
            }
        }
    }
}

impl<'a> Kernel for Sort<'a> {
    type Out = Sorted<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: Sorted<'a>) {
        let mut shown = Shown::nothing();
        let mut color = [[0.0; SEGMENT]; 3];
        let mut inverse = [0.0; SEGMENT];
        let mut place = [[0.0; SEGMENT]; 3];
        let mut drift = [[0.0; SEGMENT]; 3];
        let placed = matches!(self.geometry, Geometry::Position(_));
        for run in rows.flat_map(|y| segments(y, self.color.size.width)) {
            self.color
                .read(run, color.each_mut().map(Row::as_mut_slice));
            shown.find(self.geometry, self.camera, run);
            self.drift(run, &mut drift);
            for i in 0..run.len {
                let near = shown.near[i] != 0.0;
                let depth = if near {
                    shown.depth[i] as f32
                } else {
                    f32::INFINITY
                };
                let sample = color.each_ref().map(|row| row[i]);
                let here = is_present(sample) && depth > 0.0;
                let offset = match placed && near {
                    true => [
                        (shown.x[i] - (run.x + i) as f64 - 0.5) as f32,
                        (shown.y[i] - run.y as f64 - 0.5) as f32,
                    ],
                    false => self.jitter,
                };
                let found = [
                    depth,
                    offset[0].clamp(-0.5, 0.5),
                    offset[1].clamp(-0.5, 0.5),
                ];
                for c in 0..3 {
                    color[c][i] = if here { sample[c] } else { f32::NAN };
                    place[c][i] = if here { found[c] } else { f32::NAN };
                    drift[c][i] = if here { drift[c][i] } else { f32::NAN };
                }
                inverse[i] = if here { 1.0 / depth } else { f32::NAN };
                *out.missing += usize::from(!here);
            }
            let ([r, g, b], [x, y, z]) = (&color, &drift);
            let rows = [r, g, b, &inverse, x, y, z];
            out.color.write(run, rows.map(Row::as_slice));
            out.place.write(run, place.each_ref().map(Row::as_slice));
        }
    }
}

/// What is known of a pixel goes without what is filled from around, if it has so many times its quality: or else what
/// stands still would never be as sharp as its samples.
const OUTWEIGHS: f32 = 8.0;

/// Decides, pixel by pixel, where its point lies: where it was sampled, where it comes from, or where those around
/// suggest; forgets points that a sample shows to be gone, and leaves out what they outweigh.
struct Settle<'a> {
    samples: Pixels<'a>,
    filled: Pixels<'a>,
    /// Of what was known.
    drift: Pixels<'a>,
    tolerance: f32,
    /// Whether there was a frame before.
    continues: bool,
}

/// Of the points as they were scattered.
struct Settled<'a> {
    depth: &'a mut [f32],
    offset: &'a mut [f32],
    quality: &'a mut [f32],
    drift: BandMut<'a>,
    /// Quality of what was filled.
    fresh: &'a mut [f32],
    confidence: &'a mut [f32],
    rejection: &'a mut [u8],
}

impl<'a> Kernel for Settle<'a> {
    type Out = Settled<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: Settled<'a>) {
        let width = self.samples.size.width;
        let offsets = out.offset.as_chunks_mut::<2>().0;
        for (i, pixel) in (rows.start * width..rows.end * width).enumerate() {
            let [depth, x, y] = self.samples.vector(pixel);
            let sampled = !depth.is_nan();
            let known = out.quality[i] > 0.0;
            let alike =
                (out.depth[i] - depth).abs() <= self.tolerance * depth || out.depth[i] == depth;
            let gone = known && sampled && !alike;
            if gone {
                out.quality[i] = 0.0;
            }
            let kept = known && !gone;
            if !sampled && out.quality[i] > OUTWEIGHS * out.fresh[i] {
                out.fresh[i] = 0.0;
            }
            let (source, first) = if kept && !sampled {
                (self.drift, 0)
            } else {
                (self.filled, 4)
            };
            for channel in 0..3 {
                let drift = source.at(pixel, first + channel);
                out.drift.row(channel, pixel / width)[pixel % width] = drift;
            }
            if sampled {
                (out.depth[i], offsets[i]) = (depth, [x, y]);
            } else if !kept {
                (out.depth[i], offsets[i]) = (1.0 / self.filled.at(pixel, 3), [0.0; 2]);
            }
            out.confidence[i] = f32::from(u8::from(kept));
            out.rejection[i] = match (self.continues, known, gone) {
                (true, false, _) => rejection::OUTSIDE,
                (true, _, true) => rejection::DEPTH,
                _ => 0,
            };
        }
    }
}

/// Adds to the motion of what stands still how points move by themselves.
struct AddDrift<'a> {
    drift: Pixels<'a>,
}

impl<'a> Kernel for AddDrift<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut motion: BandMut<'a>) {
        let mut drift = [0.0; SEGMENT];
        for run in rows.flat_map(|y| segments(y, self.drift.size.width)) {
            for channel in 0..3 {
                self.drift.load(run, channel, &mut drift[..run.len]);
                let motion = &mut motion.row(channel, run.y)[run.x..][..run.len];
                for (motion, drift) in motion.iter_mut().zip(&drift) {
                    *motion += drift;
                }
            }
        }
    }
}

struct Blacken<'a>(PhantomData<&'a f32>);

impl<'a> Kernel for Blacken<'a> {
    type Out = &'a mut [f32];

    #[inline(always)]
    fn rows(&self, _: Range<usize>, color: &'a mut [f32]) {
        blacken_missing(color);
    }
}
