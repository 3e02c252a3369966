//! Spatiotemporal variance-guided filtering (Schied et al. 2017), as a list of this library's kernels:
//!
//!   demodulate → (suppress fireflies) → (motion from cameras) → reproject → (temporal gradient) → accumulate
//!     → estimate variance → à-trous → remodulate → (antialias)
//!
//! Every buffer but colour is optional; what is absent drops out of the tests and weights that would use it.

use super::frame::{Frame, Output, blacken_missing, check_size};
use super::reflections::{self, forget_uncovered};
use super::taa::{self, Stage};
use crate::error::{Error, Result, in_range};
use crate::image::{Image, Records, View};
use crate::kernels::camera::pinhole::Camera;
use crate::kernels::fetch::footprint::Filter;
use crate::kernels::fetch::reproject::{self, Reprojected, reproject};
use crate::kernels::judge::gradient::{self, temporal_gradient};
use crate::kernels::judge::surface::{self, Buffers, Tests};
use crate::kernels::merge::accumulate::{self, accumulate};
use crate::kernels::smooth::atrous::{self, Filtered, atrous};
use crate::kernels::smooth::demodulate::{demodulate, remodulate};
use crate::kernels::smooth::fireflies::{self, suppress_fireflies};
use crate::kernels::smooth::guide::{Guide, Sigmas};
use crate::kernels::smooth::variance::{self, estimate_variance};
use crate::pixels::PixelsMut;

#[derive(Clone, Debug, Default)]
pub struct Params {
    pub surface: surface::Params,
    pub accumulate: accumulate::Params,
    pub variance: variance::Params,
    pub atrous: atrous::Params,
    /// Whether the first pass of the filter, instead of its input, is the next frame's history.
    pub feedback: bool,
    /// Whether changes of light shorten history: known from the frames' replays, estimated where they have none.
    pub gradient: bool,
    pub fireflies: Option<fireflies::Params>,
    /// Distances behind the surface at which reflections are looked for, in units of depth; above 0, +inf included.
    pub reflections: Vec<f32>,
    /// The output stage.
    pub antialias: Option<taa::Params>,
}

impl Params {
    /// The same guide serves the variance and the filter.
    pub fn with_sigmas(mut self, sigmas: Sigmas) -> Self {
        self.variance.sigmas = sigmas;
        self.atrous.sigmas = sigmas;
        self
    }

    pub fn check(&self) -> Result<()> {
        self.surface.check()?;
        self.accumulate.check()?;
        self.variance.check()?;
        self.atrous.check()?;
        for &distance in &self.reflections {
            in_range("reflections", distance, "distances above 0", |v| v > 0.0)?;
        }
        Ok(())
    }
}

/// What one frame leaves to the next.
struct Memory {
    /// As [`accumulate`] has it; in records, as all that is fetched in several channels.
    history: Records,
    /// As it came, for its replay.
    color: Option<Image>,
    reflections: Option<reflections::Memory>,
    depth: Option<Image>,
    normal: Option<Records>,
    object_normal: Option<Records>,
    ids: Option<Image<u32>>,
    camera: Option<Camera>,
    demodulated: bool,
}

impl Memory {
    fn surface(&self) -> Buffers<'_> {
        Buffers {
            depth: self.depth.as_ref().map(Image::pixels),
            normal: self.normal.as_ref().map(Records::pixels),
            ids: self.ids.as_ref().map(Image::pixels),
            object_normal: self.object_normal.as_ref().map(Records::pixels),
            color: None,
        }
    }
}

/// What the memory knows of the current frame's pixels.
struct Recalled {
    /// Beginning with the channels of the history image.
    history: Reprojected,
    gradient: Option<Image>,
    reflections: Option<reflections::Scores>,
}

pub struct Svgf {
    params: Params,
    memory: Option<Memory>,
    antialias: Option<Stage>,
}

impl Svgf {
    pub fn new(params: Params) -> Result<Self> {
        params.check()?;
        Ok(Self {
            antialias: params.antialias.map(Stage::new),
            params,
            memory: None,
        })
    }

    /// Forgets the sequence.
    pub fn reset(&mut self) {
        self.memory = None;
        self.antialias.iter_mut().for_each(Stage::reset);
    }

    pub fn step(&mut self, frame: &Frame) -> Result<Output> {
        let memory = self.memory.as_ref();
        if let Some(memory) = memory {
            check_continues(memory, frame)?;
        }
        let size = frame.color.size;
        let params = &self.params;
        let mut used = vec![];

        let illumination = frame
            .albedo
            .map(|albedo| demodulate(frame.color, albedo, frame.emission));
        let sample = illumination.as_ref().map_or(frame.color, Image::view);
        let held = params.fireflies.map(|fireflies| {
            let mut held = Image::new(size, 3);
            let bands = held.bands().map(PixelsMut::Planar);
            suppress_fireflies(sample.into(), fireflies, bands, None);
            held
        });
        let color = held.as_ref().map_or(sample, Image::view);

        let camera = memory.and_then(|memory| memory.camera.as_ref());
        let motion = frame.motion(camera, &mut used);
        let recalled = match memory {
            Some(memory) => recall(params, memory, frame, motion.view(), [sample, color]),
            None => Recalled {
                history: Reprojected::nothing(size, accumulate::CHANNELS),
                gradient: None,
                reflections: None,
            },
        };
        let values = recalled.history.values.pixels();
        let before = [0..3, 3..5, 5..6].map(|channels| values.part(channels));
        let gradient = recalled.gradient.as_ref().map(Image::view);
        let mut history = Image::new(size, accumulate::CHANNELS);
        let (colors, rest) = history.data_mut().split_at_mut(3 * size.pixels());
        let (moments, lengths) = rest.split_at_mut(2 * size.pixels());
        let merged = PixelsMut::planar(size, colors)
            .zip(PixelsMut::planar(size, moments))
            .zip(PixelsMut::planar(size, lengths))
            .map(|((color, moments), length)| [color, moments, length]);
        let missing = accumulate(color.into(), before, gradient, params.accumulate, merged);

        let reach = params.atrous.reach().max(params.variance.radius);
        let rays = frame.camera.as_ref().map(Camera::rays);
        let guide = Guide::new(size, reach, frame.surface, rays);
        let [color, moments, length] =
            [0..3, 3..5, 5..6].map(|channels| history.channels(channels));
        let variance = estimate_variance(moments, length, &guide, params.variance);
        let reflects = !params.reflections.is_empty();
        let keep = [params.feedback.then_some(1), reflects.then_some(2)];
        let Filtered {
            mut color,
            variance,
            kept: [first, second],
        } = atrous(color, variance.view(), &guide, params.atrous, keep);

        let history_length = length.to_image();
        if let Some(first) = first {
            history.set_channels(0, first.view());
        }
        if let Some(albedo) = frame.albedo {
            color = remodulate(color.view(), albedo, frame.emission);
        }
        match &mut self.antialias {
            Some(stage) => {
                let mut antialiased = Image::new(size, 3);
                stage.step(
                    color.view().into(),
                    motion.view().into(),
                    frame.surface.depth,
                    antialiased.bands().map(PixelsMut::Planar),
                    None,
                );
                color = antialiased;
            }
            None => blacken_missing(&mut color),
        }

        used.extend(list_used(frame, &guide));
        let before = memory.is_some();
        let reflected = reflects && recalled.reflections.is_some();
        used.extend(
            [
                (
                    "object_normal",
                    before && frame.surface.object_normal.is_some(),
                ),
                ("replay", gradient.is_some() && frame.replay.is_some()),
                ("hit_distance", reflected && frame.hit_distance.is_some()),
            ]
            .into_iter()
            .filter_map(|(name, used)| used.then_some(name)),
        );
        self.memory = Some(Memory {
            history: Records::of(history.view()),
            color: params.gradient.then(|| frame.color.to_image()),
            reflections: second.map(|light| reflections::Memory {
                light: Records::of(light.view()),
                scores: recalled
                    .reflections
                    .unwrap_or_else(|| reflections::Scores::new(size, params.reflections.len())),
            }),
            depth: frame.surface.depth.map(|v| v.to_image()),
            normal: frame.surface.normal.map(Records::of),
            object_normal: frame.surface.object_normal.map(Records::of),
            ids: frame.surface.ids.map(|v| v.to_image()),
            camera: frame.camera,
            demodulated: frame.albedo.is_some(),
        });
        Ok(Output {
            color,
            variance: Some(variance),
            history_length,
            confidence: recalled.history.coverage,
            rejection: recalled.history.rejection,
            used,
            missing,
        })
    }
}

/// The light of the new frame comes as it was sampled, and without fireflies.
fn recall(
    params: &Params,
    memory: &Memory,
    frame: &Frame,
    motion: View,
    [sample, color]: [View; 2],
) -> Recalled {
    let rays = memory
        .camera
        .as_ref()
        .filter(|_| motion.channels == 3)
        .map(Camera::rays);
    let tests = Tests::new(frame.surface, memory.surface(), rays, &params.surface);
    let before = memory.color.as_ref();
    let replayed = frame.replay.zip(before).map(|(replay, before)| {
        // The same random numbers make the same noise.
        let exact = gradient::Params {
            noise: 0.0,
            ..Default::default()
        };
        find_gradient(replay, before.view(), exact)
    });
    let cameras = frame.camera.as_ref().zip(memory.camera.as_ref());
    let reflections = memory.reflections.as_ref().filter(|_| cameras.is_some());

    let mut planes = vec![memory.history.pixels()];
    if let Some(reflections) = reflections {
        planes.extend([&reflections.light, &reflections.scores.image].map(Records::pixels));
    }
    planes.extend(replayed.as_ref().map(Image::pixels));
    let bilinear = reproject::Params {
        filter: Filter::Bilinear,
        fallback: true,
        dering: true,
    };
    let mut history = reproject(&planes, motion.into(), tests, bilinear);

    let gradient = params.gradient.then(|| match replayed {
        Some(_) => {
            let last = history.values.channels - 1;
            history.values.channels(last..last + 1).to_image()
        }
        None => {
            let mut known = history.values.channels(0..3).to_image();
            forget_uncovered(&mut known, &history.coverage);
            // A lamp that travels changes all of the light by less than the noise of a few pixels. Three looks find more
            // that is not there than one: hence the larger margin.
            let estimated = gradient::Params {
                noise: 2.2,
                widest: 5,
                ..Default::default()
            };
            find_gradient(color, known.view(), estimated)
        }
    });
    let reflections = reflections
        .zip(cameras)
        .and_then(|(reflections, (now, before))| {
            reflections::choose(
                reflections,
                memory.history.pixels(),
                &params.reflections,
                frame,
                [now, before],
                memory.surface(),
                sample,
                &mut history,
            )
        });
    Recalled {
        history,
        gradient,
        reflections,
    }
}

fn find_gradient(color: View, previous: View, params: gradient::Params) -> Image {
    let mut gradient = Image::new(color.size, 1);
    temporal_gradient(color.into(), previous.into(), params, gradient.data_mut());
    gradient
}

fn check_continues(memory: &Memory, frame: &Frame) -> Result<()> {
    check_size(memory.history.size, frame.color.size)?;
    if memory.demodulated != frame.albedo.is_some() {
        let [before, now] = [memory.demodulated, frame.albedo.is_some()]
            .map(|has| if has { "given" } else { "absent" });
        return Err(Error::value(
            "albedo",
            format!("{before}, as in earlier frames (or reset() before)"),
            now,
        ));
    }
    Ok(())
}

fn list_used(frame: &Frame, guide: &Guide) -> impl Iterator<Item = &'static str> {
    [
        ("albedo", frame.albedo.is_some()),
        (
            "emission",
            frame.albedo.is_some() && frame.emission.is_some(),
        ),
        ("normal", frame.surface.normal.is_some()),
        ("depth", frame.surface.depth.is_some()),
        ("plane", guide.compares_planes()),
        ("ids", frame.surface.ids.is_some()),
    ]
    .into_iter()
    .filter_map(|(name, used)| used.then_some(name))
}
