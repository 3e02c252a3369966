//! Temporal upscaling, as a list of this library's kernels:
//!
//!   (motion from cameras) → dilate → disocclusion → resample → reproject → temporal gradient → clip → blend → sharpen
//!
//! The history is of the output's size, everything that comes with a frame of the input's. What the history has of a
//! pixel is counted in samples: a frame adds as many as it has near the pixel, and the blend is by these.
//!
//! Clipping would forget what single jittered frames cannot show. History escapes it where it stands still, as far as the
//! new samples do not contradict it beyond their noise (the temporal gradient), and where a thin feature is locked, which
//! most frames contradict.

use std::ops::Range;

use super::frame::{Frame, Output, Pipeline, Summary, Upkeep, check_size};
use crate::error::{Error, Result, in_range};
use crate::image::{Image, Pixels, Records, SEGMENT, Size, View, segments};
use crate::kernels::camera::dilate::{Choice, Window, dilate_motion};
use crate::kernels::camera::pinhole::Camera;
use crate::kernels::fetch::footprint::{Filter, MotionLanes, Wide};
use crate::kernels::fetch::reproject::{self, reproject};
use crate::kernels::judge::blend_factor;
use crate::kernels::judge::disocclusion::{self, disocclusion};
use crate::kernels::judge::exposure::exposure;
use crate::kernels::judge::gradient::{self, temporal_gradient};
use crate::kernels::judge::neighborhood::{self, Bounds, Response, Space, clip_history};
use crate::kernels::judge::surface::{self, Surface, Tests, rejection};
use crate::kernels::judge::thin_features::thin_features;
use crate::kernels::merge::accumulate::count_missing;
use crate::kernels::merge::blend::{Weighting, mix};
use crate::kernels::merge::resample::{nearest, resample};
use crate::kernels::smooth::sharpen::{self, check_strength, sharpen};
use crate::math::{is_present, saturate};
use crate::pixels::{PixelsMut, Row};
use crate::rows::{self, BAND, Kernel};

#[derive(Clone, Copy, Debug)]
pub struct Params {
    /// Pixels of the output to one of the input, along each side; 1 to 4; 2.
    pub scale: f64,
    /// Share of one more sample in what is remembered, at least.
    pub blend_factor: blend_factor::Params,
    /// Of depths between what was hidden and what hid it, relative; 0 to 1; 0.05.
    pub separation: f32,
    /// Frames after which a lock opens; above 0; 16.
    pub lifetime: f32,
    /// Of the sharpening; 0, which does without, to 1; 0.
    pub sharpness: f32,
}

const CLIP: neighborhood::Params = neighborhood::Params {
    bounds: Bounds::Variance,
    gamma: 1.0,
    radius: 1,
    space: Space::ToneMappedYCoCg,
    response: Response::Clamp,
    exposure: 1.0,
};
const GRADIENT: gradient::Params = gradient::Params {
    noise: 2.2,
    passes: 1,
    widest: 1,
};
/// A change of a quarter of the light is all that it takes.
const CHANGE: f32 = 4.0;
/// Luminances of one thin feature.
const SIMILARITY: f32 = 1.05;
const FETCH: reproject::Params = reproject::Params {
    filter: Filter::Wide(Wide::CatmullRom),
    fallback: false,
    dering: true,
};

impl Params {
    pub fn check(&self) -> Result<()> {
        if !(1.0..=4.0).contains(&self.scale) {
            return Err(Error::value("scale", "a number from 1 to 4", self.scale));
        }
        self.blend_factor.check()?;
        disocclusion::check(self.separation)?;
        in_range("lifetime", self.lifetime, "frames above 0", |v| v > 0.0)?;
        check_strength("sharpness", self.sharpness)
    }

    /// The size of what comes out.
    pub fn scaled(&self, size: Size) -> Size {
        let side = |side: usize| (side as f64 * self.scale).round_ties_even() as usize;
        Size {
            height: side(size.height),
            width: side(size.width),
        }
    }
}

/// Channels of a history image: colour 0 to 2, samples 3, lock 4.
const CHANNELS: usize = 5;
const SAMPLES: usize = 3;
const LOCK: usize = 4;

pub struct Upscaler {
    params: Params,
    upkeep: Upkeep,
    before: Option<Before>,
}

/// What is known of the last frame.
struct Before {
    size: Size,
    history: Records,
    camera: Option<Camera>,
}

impl Upscaler {
    pub fn new(params: Params) -> Result<Self> {
        params.check()?;
        Ok(Self {
            params,
            upkeep: Upkeep::default(),
            before: None,
        })
    }

    /// The size of what comes out for frames of a size.
    pub fn scaled(&self, size: Size) -> Size {
        self.params.scaled(size)
    }
}

impl Pipeline for Upscaler {
    fn upkeep(&mut self) -> &mut Upkeep {
        &mut self.upkeep
    }

    fn forget(&mut self) {
        self.before = None;
    }

    fn next(&mut self, frame: &Frame, output: Output) -> Result<Summary> {
        let (small, large) = (frame.color.size, self.scaled(frame.color.size));
        if let Some(before) = &self.before {
            check_size(before.size, small)?;
        }
        let mut used = vec![];
        let before = self.before.as_ref();
        let motion = frame.motion(before.and_then(|before| before.camera.as_ref()), &mut used);
        let depth = frame.surface.depth.map(Pixels::plane);
        for (name, there) in [
            ("depth", depth.is_some()),
            ("jitter", frame.jitter.is_some()),
            ("reactive", frame.reactive.is_some()),
        ] {
            used.extend(there.then_some(name));
        }
        let jitter = frame.jitter.unwrap_or_default();
        let lookup = Lookup::new(small, large, jitter);

        let choice = depth.map_or(Choice::Longest, Choice::Nearest);
        let mut dilated = Image::blank(small, motion.pixels().channels);
        let out = dilated.bands().map(PixelsMut::Planar);
        dilate_motion(motion.pixels(), choice, Window::Square, out);
        let mut moved = Image::blank(large, 2);
        let kernel = Scale {
            motion: dilated.pixels(),
            lookup: &lookup,
            scale: [
                large.width as f32 / small.width as f32,
                large.height as f32 / small.height as f32,
            ],
        };
        rows::run(&kernel, large.height, moved.bands().map(PixelsMut::Planar));

        let mut disoccluded = Image::new(small, 1);
        if let Some(depth) = depth {
            let out = disoccluded.bands().map(PixelsMut::Planar);
            disocclusion(depth, motion.pixels(), self.params.separation, out);
        }
        let mut thin = Image::blank(small, 1);
        let out = thin.bands().map(PixelsMut::Planar);
        thin_features(frame.color, SIMILARITY, out);

        let (mut color, mut weight) = (Image::blank(large, 3), Image::blank(large, 1));
        let (out, density) = (color.bands(), weight.bands());
        let filter = Filter::Wide(Wide::Lanczos2);
        resample(
            frame.color,
            large,
            jitter,
            filter,
            true,
            out.map(PixelsMut::Planar),
            density.map(PixelsMut::Planar),
        );
        let exposure = exposure(frame.color);

        let (mut coverage, mut rejection) = (Image::new(large, 1), Image::new(large, 1));
        let known = before.and_then(|before| {
            let limits = surface::Params::default();
            let tests = Tests::new(Surface::default(), Surface::default(), None, &limits);
            let (coverage, rejection) = (coverage.data_mut(), rejection.data_mut());
            let (history, motion) = ([before.history.pixels()], moved.pixels());
            reproject(&history, motion, tests, FETCH, coverage, rejection).pop()
        });
        let known = known.unwrap_or_else(|| Image::new(large, CHANNELS));
        let history = known.channels(0..3);
        // What the history has where the samples are.
        let mut there = Image::blank(small, 3);
        let mut unused = Image::blank(small, 1);
        let far = [
            -jitter[0] * large.width as f64 / small.width as f64,
            -jitter[1] * large.height as f64 / small.height as f64,
        ];
        let (out, density) = (there.bands(), unused.bands());
        resample(
            history.into(),
            small,
            far,
            Filter::Nearest,
            false,
            out.map(PixelsMut::Planar),
            density.map(PixelsMut::Planar),
        );
        let mut change = Image::blank(small, 1);
        temporal_gradient(
            frame.color,
            there.pixels(),
            None,
            GRADIENT,
            change.data_mut(),
        );
        let mut clipped = Image::blank(large, 3);
        let out = clipped.bands().map(PixelsMut::Planar);
        let clip = neighborhood::Params { exposure, ..CLIP };
        clip_history(history.into(), color.pixels(), clip, out);

        let mut next = Records::blank(large, CHANNELS);
        let kernel = Merge {
            params: self.params,
            color: color.pixels(),
            weight: weight.view(),
            known: &known,
            coverage: coverage.view(),
            rejection: rejection.view(),
            clipped: clipped.pixels(),
            motion: moved.pixels(),
            lookup: &lookup,
            disoccluded: disoccluded.view(),
            change: change.view(),
            thin: thin.view(),
            reactive: frame.reactive.map(Pixels::plane),
        };
        let band = BAND * large.width;
        let outs = PixelsMut::bands(large, CHANNELS, next.data_mut())
            .zip(output.history_length.chunks_mut(band))
            .zip(output.confidence.chunks_mut(band))
            .zip(output.rejection.chunks_mut(band));
        let outs = outs.map(|(((next, length), confidence), rejection)| Outs {
            next,
            length,
            confidence,
            rejection,
        });
        rows::run(&kernel, large.height, outs);

        let shown = next.pixels().part(0..3);
        let params = sharpen::Params {
            strength: self.params.sharpness,
            exposure,
        };
        sharpen(shown, params, PixelsMut::bands(large, 3, output.color));
        let missing = missing(frame.color);
        self.before = Some(Before {
            size: small,
            history: next,
            camera: frame.camera,
        });
        Ok(Summary { used, missing })
    }
}

fn missing(color: Pixels) -> usize {
    let mut planes = [[0.0; SEGMENT]; 3];
    let runs = (0..color.size.height).flat_map(|y| segments(y, color.size.width));
    runs.map(|run| {
        color.read(run, planes.each_mut().map(Row::as_mut_slice));
        count_missing(planes.each_ref().map(|row| &row[..run.len]))
    })
    .sum()
}

/// The sample of the input next to each pixel of the output.
struct Lookup {
    rows: Vec<usize>,
    columns: Vec<usize>,
    width: usize,
}

impl Lookup {
    fn new(small: Size, large: Size, jitter: [f64; 2]) -> Self {
        Self {
            rows: nearest(small.height, large.height, jitter[1]),
            columns: nearest(small.width, large.width, jitter[0]),
            width: small.width,
        }
    }

    #[inline(always)]
    fn at(&self, x: usize, y: usize) -> usize {
        self.rows[y] * self.width + self.columns[x]
    }
}

/// Motion of the input's pixels as motion of the output's, in its pixels.
struct Scale<'a> {
    motion: Pixels<'a>,
    lookup: &'a Lookup,
    scale: [f32; 2],
}

impl<'a> Kernel for Scale<'a> {
    type Out = PixelsMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: PixelsMut<'a>) {
        let mut moved = [[0.0; SEGMENT]; 2];
        for run in rows.flat_map(|y| segments(y, self.lookup.columns.len())) {
            for i in 0..run.len {
                let at = self.lookup.at(run.x + i, run.y);
                for c in 0..2 {
                    moved[c][i] = self.motion.at(at, c) * self.scale[c];
                }
            }
            out.write(run, moved.each_ref().map(Row::as_slice));
        }
    }
}

/// Joins the new samples with what is left of the history.
struct Merge<'a> {
    params: Params,
    color: Pixels<'a>,
    weight: View<'a>,
    known: &'a Image,
    coverage: View<'a>,
    rejection: View<'a, u8>,
    clipped: Pixels<'a>,
    motion: Pixels<'a>,
    // Of the input's size.
    lookup: &'a Lookup,
    disoccluded: View<'a>,
    change: View<'a>,
    thin: View<'a>,
    reactive: Option<View<'a>>,
}

struct Outs<'a> {
    next: PixelsMut<'a>,
    length: &'a mut [f32],
    confidence: &'a mut [f32],
    rejection: &'a mut [u8],
}

impl<'a> Kernel for Merge<'a> {
    type Out = Outs<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, out: Outs<'a>) {
        let Outs {
            mut next,
            length,
            confidence,
            rejection,
        } = out;
        let mut lanes = MotionLanes::zeroed();
        let [mut color, mut old, mut clipped, mut merged] = [[[0.0; SEGMENT]; 3]; 4];
        let [mut trust, mut lock, mut shares, mut hastes, mut hold] = [[0.0; SEGMENT]; 5];
        let values = self.known;
        let (disoccluded, change) = (self.disoccluded.plane(0), self.change.plane(0));
        let thin = self.thin.plane(0);
        // 0 where all stands still, 1 from fast motion on.
        let haste = blend_factor::Params {
            alpha: 0.0,
            fast_alpha: 1.0,
            ..self.params.blend_factor
        };
        let width = self.color.size.width;
        for run in rows.clone().flat_map(|y| segments(y, width)) {
            let (n, start) = (run.len, run.y * width + run.x);
            let below = (run.y - rows.start) * width + run.x;
            let motion = lanes.load(&self.motion, run);
            self.color
                .read(run, color.each_mut().map(Row::as_mut_slice));
            self.clipped
                .read(run, clipped.each_mut().map(Row::as_mut_slice));
            values
                .pixels()
                .read(run, old.each_mut().map(Row::as_mut_slice));
            let weights = &self.weight.plane(0)[start..][..n];
            let samples = &values.plane(SAMPLES)[start..][..n];
            let locks = &values.plane(LOCK)[start..][..n];
            let coverage = &self.coverage.plane(0)[start..][..n];
            let failed = &self.rejection.plane(0)[start..][..n];
            for i in 0..n {
                let at = self.lookup.at(run.x + i, run.y);
                let reacts = match self.reactive {
                    // NaN says nothing.
                    Some(reactive) => saturate(reactive.plane(0)[at]),
                    None => 0.0,
                };
                trust[i] = coverage[i] * (1.0 - disoccluded[at]) * (1.0 - reacts);
                let hidden = if disoccluded[at] > 0.0 {
                    rejection::DEPTH
                } else {
                    0
                };
                rejection[below + i] = failed[i] | hidden;
            }
            haste.shares(&[1.0; SEGMENT][..n], Some(motion), &mut hastes);
            self.params
                .blend_factor
                .shares(&trust[..n], Some(motion), &mut shares);
            for i in 0..n {
                let at = self.lookup.at(run.x + i, run.y);
                let same = 1.0 - (CHANGE * change[at]).min(1.0);
                let kept = locks[i] * trust[i] - 1.0 / self.params.lifetime;
                lock[i] = kept.max(thin[at] * weights[i].min(1.0));
                hold[i] = (same * (1.0 - hastes[i])).max(locks[i]);
                let present = is_present([color[0][i], color[1][i], color[2][i]]);
                let new = if present { weights[i] } else { 0.0 };
                let least = samples[i].min(1.0 / shares[i] - 1.0);
                length[below + i] = least + new;
                let share = new / (least + new);
                shares[i] = if least > 0.0 { share } else { 1.0 };
            }
            // As far as it is held, history is what it was before it was clipped.
            mix(
                old.each_ref().map(|row| &row[..n]),
                &clipped,
                &hold,
                Weighting::None,
                1.0,
                &mut merged,
            );
            old = merged;
            mix(
                color.each_ref().map(|row| &row[..n]),
                &old,
                &shares,
                Weighting::None,
                1.0,
                &mut merged,
            );
            let [r, g, b] = merged.each_ref().map(Row::as_slice);
            next.write(run, [r, g, b, &length[below..], &lock]);
            confidence[below..][..n].copy_from_slice(&trust[..n]);
        }
    }
}
