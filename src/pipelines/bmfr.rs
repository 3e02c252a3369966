//! Block-wise multi-order feature regression (Koskela et al. 2019), as a list of this library's kernels:
//!
//!   demodulate → (motion from cameras) → (replay) → reproject → (suppress fireflies) → (temporal gradient) → accumulate
//!     → regress → blend → (innovation) → remodulate → (antialias)
//!
//! What comes before `regress` is as in [`super::svgf`]; `blend` accumulates the fits, whose blocks lie elsewhere in every
//! frame. Every buffer but colour is optional; what is absent drops out of the tests and features.

use std::ops::Range;

use super::correction::{correct_history, correct_light, innovate};
use super::frame::{Frame, Output, Pipeline, Summary, Upkeep};
use super::illumination::{Illumination, illumination, texture, without_fireflies};
use super::recall::{Memory, Recalled, recall};
use super::svgf;
use super::taa::{self, Stage, blacken_missing};
use crate::error::{Result, in_range};
use crate::image::{BandMut, Image, Pixels, Records, SEGMENT, View, segments};
use crate::kernels::camera::pinhole::Camera;
use crate::kernels::judge::exposure::exposure;
use crate::kernels::judge::innovation::Innovation;
use crate::kernels::merge::accumulate::{self, Images, Samples, accumulate};
use crate::kernels::merge::blend::{self, Alpha, Weighting, blend};
use crate::kernels::smooth::demodulate::{Way, modulate};
use crate::kernels::smooth::guide::Guide;
use crate::kernels::smooth::regress::{self, Features, Place, regress};
use crate::pixels::PixelsMut;
use crate::rows::{self, Kernel};

#[derive(Clone, Debug)]
pub struct Params {
    /// Of the history; what is of the spatial filter alone does not count.
    pub history: svgf::Params,
    /// Displaced from frame to frame.
    pub regress: regress::Params,
    /// Least share of the new fit; 0 to 1; 0.1.
    pub fitted_alpha: f32,
    /// The output stage.
    pub antialias: Option<taa::Params>,
}

impl Params {
    pub fn check(&self) -> Result<()> {
        self.history.check()?;
        in_range(
            "fitted_alpha",
            self.fitted_alpha,
            "a share from 0 to 1",
            |v| (0.0..=1.0).contains(&v),
        )
    }
}

/// Where blocks begin, frame by frame, in eighths of their side.
const OFFSETS: [[i64; 2]; 8] = [
    [0, 0],
    [4, 4],
    [2, 6],
    [6, 2],
    [1, 3],
    [5, 7],
    [3, 1],
    [7, 5],
];

/// Up to this albedo, a pixel shines by itself or by what it shows, and not by the light that falls on it.
const BLACK: f32 = 1.0 / 1024.0;

/// Channels of a history image: those of [`accumulate`], and the accumulated fits.
const CHANNELS: usize = accumulate::CHANNELS + 3;

pub struct Bmfr {
    params: Params,
    upkeep: Upkeep,
    memory: Option<Memory>,
    /// What was seen to be wrong and is not yet corrected.
    evidence: Option<Records>,
    /// Frames since the sequence began.
    age: usize,
    antialias: Option<Stage>,
}

impl Bmfr {
    pub fn new(params: Params) -> Result<Self> {
        params.check()?;
        Ok(Self {
            antialias: params.antialias.map(Stage::new),
            params,
            upkeep: Upkeep::default(),
            memory: None,
            evidence: None,
            age: 0,
        })
    }
}

impl Pipeline for Bmfr {
    fn upkeep(&mut self) -> &mut Upkeep {
        &mut self.upkeep
    }

    fn forget(&mut self) {
        self.memory = None;
        self.evidence = None;
        self.age = 0;
        self.antialias.iter_mut().for_each(Stage::reset);
    }

    fn next(&mut self, frame: &Frame, mut output: Output) -> Result<Summary> {
        if let Some(memory) = &self.memory {
            memory.check(frame)?;
        }
        let size = frame.color.size;
        let params = &self.params;
        let mut used = vec![];

        let texture = texture(frame);
        let sample = illumination(frame.color, texture);
        let rays = frame.camera.as_ref().map(Camera::rays);
        let hold = |known: Option<Pixels>| {
            let fireflies = params.history.fireflies?;
            let guide = Guide::new(size, fireflies.radius, frame.surface, rays);
            Some(without_fireflies(
                &sample, known, texture, &guide, fireflies,
            ))
        };

        let mut memory = self.memory.take();
        let evidence = self.evidence.take();
        let continues = memory.is_some();
        let replays = frame.replay.is_some() && memory.as_ref().is_some_and(Memory::expects_replay);
        let before = memory.as_ref().and_then(|memory| memory.camera.as_ref());
        let motion = frame.motion(before, &mut used);
        let Recalled {
            history: known,
            held,
            gradient,
            ..
        } = recall(
            &params.history,
            memory.as_mut(),
            CHANNELS,
            frame,
            &motion,
            &sample,
            hold,
            &mut output,
        );
        drop(memory);
        let color = held.unwrap_or(sample);
        let parts = [0..3, 3..5, 5..6, 6..9];
        let [light, moments, lengths, fits] = parts.map(|part| known.pixels().part(part));

        let mut history = Image::blank(size, CHANNELS);
        let (accumulated, fitted) = history.data_mut().split_at_mut(6 * size.pixels());
        let merged = PixelsMut::planar(size, accumulated).map(|all| [(0..6, all)]);
        let samples = Samples {
            size,
            color: &color.pixels(),
            weight: None,
            gradient: gradient.as_ref().map(Image::view),
        };
        let images = Images {
            parts: [light, moments, lengths],
            confidence: (params.history.by_confidence)
                .then(|| View::new(size, 1, output.confidence)),
        };
        let nothing = std::iter::repeat(());
        let missing = accumulate(samples, &images, params.history.accumulate, merged, nothing);

        let accumulated = Pixels::from(View::new(size, accumulate::CHANNELS, accumulated));

        let weight = texture.map(|texture| {
            let mut weight = Image::blank(size, 1);
            rows::run(&Reflects(texture.albedo), size.height, weight.bands());
            weight
        });
        let features = Features {
            normal: frame.surface.normal,
            place: (frame.geometry()).and_then(|geometry| Place::new(geometry, rays)),
        };
        let block = params.regress.block as i64;
        let displaced = regress::Params {
            offset: OFFSETS[self.age % OFFSETS.len()].map(|eighths| eighths * block / 8),
            ..params.regress
        };
        let mut fit = Records::blank(size, 3);
        let mut counts = Image::blank(size, 1);
        regress(
            accumulated.part(0..3),
            features,
            weight.as_ref().map(Image::pixels),
            displaced,
            fit.data_mut(),
            counts.data_mut(),
        );

        let length = accumulated.part(5..6).plane();
        let mut share = Image::blank(size, 1);
        let kernel = Share {
            length,
            least: params.fitted_alpha,
        };
        rows::run(&kernel, size.height, share.bands());
        let plain = blend::Params {
            weighting: Weighting::None,
            flicker: 1.0,
            exposure: 1.0,
        };
        let out = PixelsMut::planar(size, fitted);
        blend(fit.pixels(), fits, Alpha::Map(share.view()), plain, out);

        let mut rest = None;
        if let Some(params) = params.history.innovation.filter(|_| continues) {
            let [color, length, fits] = [0..3, 5..6, 6..9].map(|part| history.pixels().part(part));
            let (fresh, bright) = (Illumination::of(frame), exposure(color));
            let evidence = evidence.as_ref();
            let (found, left) = innovate(params, &fresh, &fits, length, &motion, bright, evidence);
            rows::run(&Correct(&found), size.height, history.bands());
            rest = Some(left);
        }
        let light = history.channels(6..9);
        let textured = texture.map(|texture| {
            let mut color = Image::blank(size, 3);
            let out = color.bands().map(PixelsMut::Planar);
            modulate(light.into(), texture, Way::Back, out);
            color
        });
        let color = textured.as_ref().map_or(light, Image::view);
        match &mut self.antialias {
            Some(stage) => {
                stage.step(
                    color.into(),
                    motion.pixels(),
                    frame.surface.depth.map(Pixels::plane),
                    PixelsMut::bands(size, 3, output.color),
                    None,
                );
            }
            None => {
                color.interleave(output.color);
                blacken_missing(output.color);
            }
        }
        output.history_length.copy_from_slice(history.plane(5));

        let surface = &frame.surface;
        let position = matches!(features.place, Some(Place::Position(_)));
        used.extend(
            [
                ("albedo", texture.is_some()),
                ("emission", texture.is_some() && frame.emission.is_some()),
                ("normal", surface.normal.is_some()),
                ("depth", surface.depth.is_some()),
                ("ids", continues && surface.ids.is_some()),
                ("position", position),
                (
                    "object_normal",
                    continues && surface.object_normal.is_some(),
                ),
                ("replay", replays),
            ]
            .into_iter()
            .filter_map(|(name, used)| used.then_some(name)),
        );
        self.age += 1;
        let kept = Records::of(history.view());
        self.memory = Some(Memory::new(frame, kept, &params.history, !continues));
        self.evidence = rest;
        Ok(Summary { used, missing })
    }
}

/// Adds what was found to the fits and to the history.
struct Correct<'a>(&'a Innovation);

impl<'a> Kernel for Correct<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut history: BandMut<'a>) {
        let mut line = self.0.line();
        let mut fits = [[0.0; SEGMENT]; 3];
        for y in rows {
            self.0.go_to(y, &mut line);
            let mut rows = history.rows::<CHANNELS>(y);
            for run in segments(y, rows[0].len()) {
                for (fits, row) in fits.iter_mut().zip(&rows[6..]) {
                    fits[..run.len].copy_from_slice(&row[run.x..][..run.len]);
                }
                let Some(found) = self.0.correction(&line, run, &fits) else {
                    continue;
                };
                for i in 0..run.len {
                    let mut record: [f32; CHANNELS] =
                        std::array::from_fn(|channel| rows[channel][run.x + i]);
                    let found = [0, 1, 2].map(|c| found[c][i]);
                    let (accumulated, fit) = record.split_at_mut(accumulate::CHANNELS);
                    correct_history(found, accumulated);
                    correct_light(found, fit);
                    for (row, value) in rows.iter_mut().zip(record) {
                        row[run.x + i] = value;
                    }
                }
            }
        }
    }
}

/// 1; NaN where albedo is black, so that what a lamp shines with is no light that falls on it.
struct Reflects<'a>(Pixels<'a>);

impl<'a> Kernel for Reflects<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: BandMut<'a>) {
        let width = self.0.size.width;
        for y in rows {
            for (x, weight) in out.row(0, y).iter_mut().enumerate() {
                let [r, g, b] = self.0.vector(y * width + x);
                let reflects = (r > BLACK) | (g > BLACK) | (b > BLACK);
                *weight = if reflects { 1.0 } else { f32::NAN };
            }
        }
    }
}

/// The share of the N-th fit: 1/N until that is the least.
struct Share<'a> {
    length: View<'a>,
    least: f32,
}

impl<'a> Kernel for Share<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: BandMut<'a>) {
        for y in rows {
            for (share, &length) in out.row(0, y).iter_mut().zip(self.length.row(0, y)) {
                *share = self.least.max(1.0 / length);
            }
        }
    }
}
