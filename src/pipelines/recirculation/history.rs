//! History where it appears now: points that are splatted, or an image that motion leads to.

use std::ops::Range;

use super::State;
use super::samples::Fresh;
use crate::image::{BandMut, Interleaved, Pixels, SEGMENT, Size, bands_of, segments};
use crate::kernels::camera::motion::Geometry;
use crate::kernels::camera::pinhole::Camera;
use crate::kernels::fetch::splat::{self, Splats, splat};
use crate::kernels::fetch::validate::rejection;
use crate::kernels::merge::recirculate::{self, Known};
use crate::pipelines::frame::{Motion, Output, still_motion};
use crate::rows::{self, BAND, Kernel, Simd};

/// Channels of a point's colour: colour 0 to 2, drift 3 to 5.
pub const CHANNELS: usize = 6;

/// The points of the past where they appear now; quality 0 where none does.
pub struct Points {
    color: Interleaved,
    pub depth: Interleaved,
    pub offset: Interleaved,
    quality: Interleaved,
}

impl Points {
    pub fn none(size: Size) -> Self {
        Self {
            color: Interleaved::new(size, CHANNELS),
            depth: Interleaved::new(size, 1),
            offset: Interleaved::new(size, 2),
            quality: Interleaved::new(size, 1),
        }
    }

    /// Scatters the points to where a camera sees them. Hands the evidence on.
    pub fn splat(
        before: State,
        camera: &Camera,
        params: splat::Params,
    ) -> (Self, Option<Interleaved>) {
        let [depth, offset] = before.place.as_ref().expect("left by the same pipeline");
        let mut now = Self::none(before.color.size);
        let points = splat::Points {
            color: before.color.pixels(),
            depth: depth.pixels(),
            offset: Some(offset.pixels()),
            drift: Some(before.color.pixels().part(3..6)),
            quality: Some(before.quality.pixels()),
        };
        let splats = Splats {
            color: now.color.data_mut(),
            depth: now.depth.data_mut(),
            offset: now.offset.data_mut(),
            quality: now.quality.data_mut(),
        };
        splat(points, [camera, &before.camera], params, splats);
        (now, before.evidence)
    }

    pub fn known(&self) -> Known<'_> {
        Known {
            color: self.color.pixels().part(0..3),
            quality: self.quality.pixels(),
        }
    }

    /// Decides where each pixel's point lies: at the new sample; else where the old point is; else at the filled depth, in
    /// the pixel's centre. Drops old points whose depth a sample contradicts, and filled pixels that an old point outweighs.
    /// Writes planes of drift, and the output's confidence and rejection.
    pub fn settle(
        &mut self,
        fresh: &mut Fresh,
        drift: &mut [f32],
        tolerance: f32,
        continues: bool,
        output: &mut Output,
    ) {
        let size = fresh.size();
        let settle = Settle {
            samples: fresh.place.pixels(),
            filled: fresh.filled.pixels(),
            drift: self.color.pixels().part(3..6),
            tolerance,
            continues,
        };
        let band = BAND * size.width;
        let outs = (self.depth.data_mut().chunks_mut(band))
            .zip(self.offset.data_mut().chunks_mut(2 * band))
            .zip(self.quality.data_mut().chunks_mut(band))
            .zip(bands_of(drift, size))
            .zip(fresh.quality.data_mut().chunks_mut(band))
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
    }
}

/// A filled pixel is not blended into a point of more than so many times its quality, which it would blur: a still scene would
/// never become as sharp as its samples.
const OUTWEIGHS: f32 = 8.0;

struct Settle<'a> {
    /// Depth, and offset; NaN where no sample is.
    samples: Pixels<'a>,
    filled: Pixels<'a>,
    /// Of the points.
    drift: Pixels<'a>,
    tolerance: f32,
    /// False in a first frame, in which no history is missed.
    continues: bool,
}

/// A band of the points, of the filled pixels' quality, and of the outputs.
struct Settled<'a> {
    depth: &'a mut [f32],
    offset: &'a mut [f32],
    quality: &'a mut [f32],
    drift: BandMut<'a>,
    fresh: &'a mut [f32],
    confidence: &'a mut [f32],
    rejection: &'a mut [u8],
}

impl<'a> Kernel for Settle<'a> {
    type Out = Settled<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: Settled<'a>) {
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
            if sampled && kept {
                // The point moves towards the sample's place by the share that its colour will have. At the sample's own
                // place, old colours would be shown beside where they belong.
                let share = out.fresh[i] / (out.fresh[i] + out.quality[i]);
                let join = |old: f32, new: f32| {
                    if old == new {
                        new
                    } else {
                        old + share * (new - old)
                    }
                };
                out.depth[i] = join(out.depth[i], depth);
                offsets[i] = [join(offsets[i][0], x), join(offsets[i][1], y)];
            } else if sampled {
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

/// The motion of pixels at these depths: a still scene's plus the drift.
pub fn motion_along<'a>(depth: Pixels, drift: Pixels, cameras: [&Camera; 2]) -> Motion<'a> {
    let size = depth.size;
    let mut motion = still_motion(size, Geometry::Depth(depth), cameras[0], cameras[1]);
    rows::run(&AddDrift(drift), size.height, motion.bands());
    Motion::Computed(motion)
}

struct AddDrift<'a>(Pixels<'a>);

impl<'a> Kernel for AddDrift<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut motion: BandMut<'a>) {
        let mut drift = [0.0; SEGMENT];
        for run in rows.flat_map(|y| segments(y, self.0.size.width)) {
            for (channel, motion) in motion.parts(run).enumerate() {
                self.0.load(run, channel, &mut drift[..run.len]);
                for (motion, drift) in motion.iter_mut().zip(&drift) {
                    *motion += drift;
                }
            }
        }
    }
}

/// The depth of filled pixels.
pub fn filled_depth(fresh: &Fresh) -> Interleaved {
    let inverse = fresh.filled.pixels().part(3..4);
    let mut depth = Interleaved::blank(inverse.size, 1);
    let outs = depth.data_mut().chunks_mut(BAND * inverse.size.width);
    rows::run(&Invert(inverse), inverse.size.height, outs);
    depth
}

struct Invert<'a>(Pixels<'a>);

impl<'a> Kernel for Invert<'a> {
    type Out = &'a mut [f32];

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, depth: &'a mut [f32]) {
        let first = rows.start * self.0.size.width;
        for (i, depth) in depth.iter_mut().enumerate() {
            *depth = 1.0 / self.0.at(first + i, 0);
        }
    }
}

/// Writes the output's confidence and rejection: whether motion leads to a pixel that was known.
pub fn report_known(quality: Pixels, motion: Pixels, continues: bool, output: &mut Output) {
    let found = Found {
        quality,
        motion,
        continues,
    };
    let band = BAND * quality.size.width;
    let outs = (output.confidence.chunks_mut(band)).zip(output.rejection.chunks_mut(band));
    rows::run(&found, quality.size.height, outs);
}

struct Found<'a> {
    /// Of the previous frame.
    quality: Pixels<'a>,
    motion: Pixels<'a>,
    continues: bool,
}

impl<'a> Kernel for Found<'a> {
    type Out = (&'a mut [f32], &'a mut [u8]);

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, (confidence, rejection): Self::Out) {
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
