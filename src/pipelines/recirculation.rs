//! Recirculation: whole pictures of frames of which a part of the pixels is traced, as a list of this library's
//! kernels:
//!
//!   splat → (motion of what stands still) → pull-push → motion → recirculate
//!
//! What is known of the past is a set of points, one for each pixel: colour, depth, place, drift and quality. They are
//! scattered to where they appear now; the new samples, whose holes are filled, join them by quality; the result is
//! what the next frame knows. The motion blur is seen, not carried on.
//!
//! After "Reprojection 2", a developer's diary of 2008.

use std::marker::PhantomData;
use std::ops::Range;

use super::frame::{Frame, Output, Pipeline, Summary, Upkeep, check_size};
use super::taa::blacken_missing;
use crate::error::{Error, Result};
use crate::image::{BandMut, Image, Pixels, Records, Run, SEGMENT, Size, View, bands_of, segments};
use crate::kernels::camera::motion::{Geometry, Shown, Transforms, motion_vectors};
use crate::kernels::camera::pinhole::Camera;
use crate::kernels::fetch::pull_push::{self, pull_push};
use crate::kernels::fetch::splat::{self, Points, Splats, splat};
use crate::kernels::judge::surface::rejection;
use crate::kernels::merge::recirculate::{self, Known, recirculate};
use crate::math::is_present;
use crate::pixels::{PixelsMut, Row};
use crate::rows::{self, BAND, Kernel};

#[derive(Clone, Copy, Debug, Default)]
pub struct Params {
    pub splat: splat::Params,
    pub pull_push: pull_push::Params,
    pub recirculate: recirculate::Params,
}

impl Params {
    pub fn check(&self) -> Result<()> {
        self.splat.check()?;
        self.recirculate.check()
    }
}

/// What one frame leaves to the next: a point for every pixel.
struct Memory {
    /// And drift.
    color: Image,
    depth: Records,
    offset: Records,
    quality: Records,
    camera: Camera,
}

/// The same where they appear now.
struct Recalled {
    /// And drift.
    color: Records,
    depth: Records,
    offset: Records,
    quality: Records,
}

const CHANNELS: usize = 6;

pub struct Recirculation {
    params: Params,
    upkeep: Upkeep,
    memory: Option<Memory>,
}

impl Recirculation {
    pub fn new(params: Params) -> Result<Self> {
        params.check()?;
        Ok(Self {
            params,
            upkeep: Upkeep::default(),
            memory: None,
        })
    }
}

impl Pipeline for Recirculation {
    fn upkeep(&mut self) -> &mut Upkeep {
        &mut self.upkeep
    }

    fn forget(&mut self) {
        self.memory = None;
    }

    fn next(&mut self, frame: &Frame, output: Output) -> Result<Summary> {
        let size = frame.color.size;
        let needs = |what| Error::value("frame", what, "one without");
        let camera = frame.camera.ok_or_else(|| needs("one with a camera"))?;
        let geometry = frame.geometry();
        let geometry = geometry.ok_or_else(|| needs("one with depth or position"))?;
        if let Some(memory) = &self.memory {
            check_size(memory.color.size, size)?;
        }
        let Params {
            splat,
            pull_push: holes,
            recirculate: blend,
        } = self.params;
        let continues = self.memory.is_some();
        let previous = self.memory.as_ref().map_or(camera, |memory| memory.camera);
        let mut known = match self.memory.take() {
            Some(memory) => memory.recall(&camera, splat),
            None => Recalled::nothing(size),
        };
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
        let mut filled = Records::blank(size, SAMPLES);
        let mut fresh = Records::blank(size, 1);
        let (colors, qualities) = (filled.data_mut(), fresh.data_mut());
        pull_push(samples.color.pixels(), None, holes, colors, qualities);

        let mut color = Image::blank(size, CHANNELS);
        let (colors, drifts) = color.data_mut().split_at_mut(3 * size.pixels());
        let settle = Settle {
            samples: samples.place.pixels(),
            filled: filled.pixels(),
            drift: known.color.pixels().part(3..6),
            tolerance: splat.tolerance,
            continues,
        };
        let band = BAND * size.width;
        let outs = (known.depth.data_mut().chunks_mut(band))
            .zip(known.offset.data_mut().chunks_mut(2 * band))
            .zip(known.quality.data_mut().chunks_mut(band))
            .zip(bands_of(drifts, size))
            .zip(fresh.data_mut().chunks_mut(band))
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
        drop(samples);

        let mut motion = Image::blank(size, 3);
        let out = motion.bands().map(PixelsMut::Planar);
        let (depth, still) = (Geometry::Depth(known.depth.pixels()), Transforms::default());
        motion_vectors(depth, &camera, &previous, None, &still, out);
        let drift = View::new(size, 3, drifts);
        rows::run(&AddDrift { drift }, size.height, motion.bands());
        let new = Known {
            color: filled.pixels().part(0..3),
            quality: fresh.pixels(),
        };
        let mut quality = Records::blank(size, 1);
        let old = known.known();
        let sharp = recirculate::Params { blur: 0.0, ..blend };
        recirculate(
            new,
            old,
            motion.pixels(),
            sharp,
            PixelsMut::planar(size, colors),
            PixelsMut::bands(size, 1, quality.data_mut()),
        );
        recirculate(
            new,
            old,
            motion.pixels(),
            blend,
            PixelsMut::bands(size, 3, output.color),
            PixelsMut::bands(size, 1, output.history_length),
        );
        let rows = output.color.chunks_mut(3 * band);
        rows::run(&Blacken(PhantomData), size.height, rows);
        self.memory = Some(Memory {
            color,
            depth: known.depth,
            offset: known.offset,
            quality,
            camera,
        });
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
    /// The points where this camera sees them.
    fn recall(self, camera: &Camera, params: splat::Params) -> Recalled {
        let mut now = Recalled::nothing(self.color.size);
        let points = Points {
            color: self.color.pixels(),
            depth: self.depth.pixels(),
            offset: Some(self.offset.pixels()),
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
        now
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
    drift: View<'a>,
}

impl<'a> Kernel for AddDrift<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut motion: BandMut<'a>) {
        for y in rows {
            for channel in 0..3 {
                let drift = self.drift.row(channel, y);
                for (motion, drift) in motion.row(channel, y).iter_mut().zip(drift) {
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
