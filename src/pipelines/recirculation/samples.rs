//! The traced samples of a frame, and what fills the holes between them.

use std::ops::Range;

use super::Params;
use crate::image::{Image, Interleaved, Pixels, Run, SEGMENT, Size, View, segments};
use crate::kernels::camera::motion::{Geometry, Shown};
use crate::kernels::camera::pinhole::Camera;
use crate::kernels::fetch::pull_push::pull_push;
use crate::kernels::merge::recirculate::{self, Known, recirculate};
use crate::math::is_present;
use crate::pipelines::frame::{Frame, Motion, still_motion};
use crate::pixels::{Colors, PixelsMut, Row};
use crate::rows::{self, BAND, Kernel, Simd};

/// Channels of samples: colour 0 to 2; the inverse of depth 3, which is linear along a plane and 0 for the background; drift
/// 4 to 6, the motion beyond that of a still scene.
const CHANNELS: usize = 7;

/// A frame's samples; NaN in pixels that were not traced.
pub struct Samples {
    color: Interleaved,
    /// Depth, and the offset from the pixel's centre.
    place: Interleaved,
}

/// Finds the samples of a frame, the pixels whose colour and place are known, and counts the other pixels.
pub fn find_samples(
    frame: &Frame,
    geometry: Geometry,
    camera: &Camera,
    previous: Option<&Camera>,
) -> (Samples, usize) {
    let size = frame.color.size;
    let still =
        (frame.motion.and(previous)).map(|previous| still_motion(size, geometry, camera, previous));
    let sort = Sort {
        color: frame.color,
        geometry,
        camera,
        moves: frame.motion.zip(still.as_ref().map(Image::view)),
        jitter: frame.jitter.unwrap_or_default().map(|v| v as f32),
    };
    let mut samples = Samples {
        color: Interleaved::blank(size, CHANNELS),
        place: Interleaved::blank(size, 3),
    };
    let mut missing = vec![0; size.height.div_ceil(BAND)];
    let outs = (samples.color.pixels_mut())
        .zip(samples.place.pixels_mut())
        .zip(&mut missing)
        .map(|((color, place), missing)| Sorted {
            color,
            place,
            missing,
        });
    rows::run(&sort, size.height, outs);
    (samples, missing.iter().sum())
}

/// New samples with their holes filled.
pub struct Fresh<'a> {
    /// The frame's colour, of which only pixels with a place are samples.
    color: Pixels<'a>,
    /// As in [`Samples`], still with holes.
    pub place: Interleaved,
    /// As [`Samples::color`], without holes.
    pub filled: Interleaved,
    pub quality: Interleaved,
}

impl<'a> Fresh<'a> {
    /// Fills the holes between samples.
    pub fn fill(samples: Samples, own: Pixels<'a>, params: Params) -> Self {
        let Samples { color, place } = samples;
        let size = own.size;
        let (mut filled, mut quality) = (
            Interleaved::blank(size, CHANNELS),
            Interleaved::blank(size, 1),
        );
        let weigh = |samples: &Interleaved, weights: &mut Interleaved, divides| {
            let kernel = Weigh {
                inverse: samples.pixels().part(3..4),
                nearness: params.nearness,
                divides,
            };
            let outs = weights.data_mut().chunks_mut(BAND * size.width);
            rows::run(&kernel, size.height, outs);
        };
        let weights = (params.nearness > 0).then(|| {
            let mut weights = Interleaved::blank(size, 1);
            weigh(&color, &mut weights, false);
            weights
        });
        let (weighted, into) = (weights.as_ref().map(Interleaved::pixels), filled.data_mut());
        pull_push(
            color.pixels(),
            weighted,
            params.pull_push,
            into,
            quality.data_mut(),
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

    pub fn size(&self) -> Size {
        self.color.size
    }

    /// Blends with history by quality. Writes planes of colour, and quality.
    pub fn join(
        &self,
        known: Known,
        motion: &Motion,
        params: recirculate::Params,
        color: &mut [f32],
        quality: &mut [f32],
    ) {
        let size = self.size();
        let filled = Known {
            color: self.filled.pixels().part(0..3),
            quality: self.quality.pixels(),
        };
        let [color, quality] = [color, quality].map(|out| PixelsMut::planar(size, out));
        recirculate(filled, known, motion.pixels(), params, color, quality);
    }
}

impl Colors for Fresh<'_> {
    /// The samples, without what fills their holes.
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

/// The least weight of a sample: the background's.
const LEAST: f32 = 1e-24;

/// Writes the weights of samples by their depth, or divides quality by them.
struct Weigh<'a> {
    /// Of depth.
    inverse: Pixels<'a>,
    nearness: u32,
    divides: bool,
}

impl<'a> Kernel for Weigh<'a> {
    type Out = &'a mut [f32];

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, weights: &'a mut [f32]) {
        let first = rows.start * self.inverse.size.width;
        for (i, weight) in weights.iter_mut().enumerate() {
            let inverse = self.inverse.at(first + i, 0);
            let power = (0..self.nearness).fold(1.0, |power, _| power * inverse);
            // NaN, which marks a hole, stays.
            let heavy = if power < LEAST { LEAST } else { power };
            *weight = match self.divides {
                true if *weight > 0.0 => *weight / heavy,
                true => 0.0,
                false => heavy,
            };
        }
    }
}

/// Separates the samples of a frame from its holes.
struct Sort<'a> {
    color: Pixels<'a>,
    geometry: Geometry<'a>,
    camera: &'a Camera,
    /// The frame's motion, and that of a still scene.
    moves: Option<(Pixels<'a>, View<'a>)>,
    jitter: [f32; 2],
}

struct Sorted<'a> {
    color: PixelsMut<'a>,
    place: PixelsMut<'a>,
    /// Pixels without a sample.
    missing: &'a mut usize,
}

impl Sort<'_> {
    /// The drift of a run; 0 where it is unknown.
    #[inline(always)]
    fn drift(&self, run: Run, drift: &mut [Row; 3]) {
        drift.iter_mut().for_each(|row| row.fill(0.0));
        if let Some((motion, still)) = self.moves {
            for (channel, row) in drift.iter_mut().enumerate().take(motion.channels) {
                motion.load(run, channel, &mut row[..run.len]);
                let still = still.run(channel, run);
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
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: Sorted<'a>) {
        let mut shown = Shown::nothing();
        let mut color = [[0.0; SEGMENT]; 3];
        let mut inverse = [0.0; SEGMENT];
        let mut place = [[0.0; SEGMENT]; 3];
        let mut drift = [[0.0; SEGMENT]; 3];
        let placed = matches!(self.geometry, Geometry::Position(_));
        for run in rows.flat_map(|y| segments(y, self.color.size.width)) {
            self.color.read_rows(run, &mut color);
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
            out.color.write(run, rows);
            out.place.write(run, &place);
        }
    }
}
