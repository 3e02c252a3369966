//! Block-wise multi-order feature regression (Koskela et al. 2019), as a list of this library's kernels:
//!
//!   (motion from cameras) → demodulate → (replay) → reproject → (change of light) → (suppress fireflies)
//!     → (temporal gradient) → accumulate → regress → blend → (repetition) → (restore detail) → (innovation) → remodulate
//!     → (antialias → (innovation) → (mix))
//!
//! The passes before `regress` are those of [`super::svgf`]; `blend` accumulates the fits, whose blocks lie elsewhere in
//! every frame. Every buffer but colour is optional; what is absent drops out of the tests and features.

mod fit;

use std::ops::Range;

use self::fit::{LEAST, accumulate_fits, by_light, by_texture, fit, restored};
use super::correction::correct;
use super::frame::{Frame, Motion, Output, Steps, Summary, Upkeep, names, show};
use super::history;
use super::illumination::{Illumination, illumination, modulated, without_fireflies};
use super::material_ids::MaterialIds;
use super::recall::{self, Memory, Recalled};
use super::repetition::Noise;
use super::taa::{self, Input, Others, Stage};
use crate::error::{Result, from_0_to_1};
use crate::image::{Image, Interleaved, Pixels, View};
use crate::kernels::camera::pinhole::Camera;
use crate::kernels::fetch::validate;
use crate::kernels::judge::exposure::exposure;
use crate::kernels::judge::gradient;
use crate::kernels::judge::innovation::{self, innovation};
use crate::kernels::merge::accumulate::{self, Images, Samples, accumulate};
use crate::kernels::smooth::demodulate::{Texture, Way};
use crate::kernels::smooth::guide::Guide;
use crate::kernels::smooth::regress::{self, Features, Place};
use crate::kernels::smooth::restore;
use crate::pixels::PixelsMut;

/// Parameters of [`Bmfr`].
#[derive(Clone, Debug, PartialEq)]
pub struct Params {
    /// How history is recalled, and how samples join it.
    pub history: history::Params,
    /// Side of the blocks in pixels; 4 to 256. `None` stands for 16, and for 8 in frames without albedo, whose light has
    /// texture that no feature describes.
    pub block: Option<usize>,
    /// Whether bright light weighs less in a fit, and in what new samples correct; true.
    pub by_light: bool,
    /// How many features each block is fitted to.
    pub features: regress::Choice,
    /// What detail the fits get back from the accumulated light before they are shown.
    pub restore: Option<restore::Params>,
    /// Least blend factor of the new fit; 0 to 1; 0.1.
    pub fitted_alpha: f32,
    /// The last pass.
    pub antialias: Option<taa::Params>,
}

/// As [`history::ESTIMATED_GRADIENT`]; fits of highlights lose by its wider margin: 5 % relMSE on `glossy_plates`.
pub const ESTIMATED_GRADIENT: gradient::Params = gradient::Params {
    noise: 2.2,
    ..history::ESTIMATED_GRADIENT
};

/// By our own measurements. As the output stage goes on averaging, detail may keep more of its noise than what minimises the
/// error of a frame.
impl Default for Params {
    fn default() -> Self {
        Self {
            history: history::Params {
                gradient: Some(ESTIMATED_GRADIENT),
                innovation: Some(innovation::Params::default()),
                surface: validate::Params::default(),
                ..history::Params::plain()
            },
            block: None,
            by_light: true,
            features: regress::Choice::Fewest,
            restore: Some(restore::Params {
                strictness: 0.7,
                ..restore::Params::default()
            }),
            fitted_alpha: 0.1,
            antialias: Some(taa::Params::DENOISED),
        }
    }
}

impl Params {
    /// Side of the blocks of a frame's fits.
    fn block_of(&self, frame: &Frame) -> usize {
        let usual = if frame.albedo.is_some() { 16 } else { 8 };
        self.block.unwrap_or(usual)
    }

    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        self.history.check()?;
        self.block.map(regress::Params::block).transpose()?;
        self.restore.iter().try_for_each(restore::Params::check)?;
        self.antialias.iter().try_for_each(taa::Params::check)?;
        from_0_to_1("fitted_alpha", self.fitted_alpha)
    }
}

/// Channels of a history: those of [`accumulate`], and the accumulated fits.
const CHANNELS: usize = FITS.end;
const LIGHT: Range<usize> = 0..3;
const MOMENTS: Range<usize> = 3..5;
const LENGTH: Range<usize> = 5..6;
const FITS: Range<usize> = accumulate::CHANNELS..accumulate::CHANNELS + 3;

/// What one frame leaves to the next.
struct State {
    memory: Memory,
    /// Evidence of the innovation, carried to the next frame.
    evidence: Option<Interleaved>,
    /// Of the samples, if they are mixed in or detail is restored.
    noise: Option<Noise>,
    /// Frames since the sequence began.
    age: usize,
}

/// Block-wise multi-order feature regression.
pub struct Bmfr {
    params: Params,
    upkeep: Upkeep,
    state: Option<State>,
    antialias: Option<Stage>,
}

impl Bmfr {
    /// A pipeline without history; an error if a parameter is out of range.
    pub fn new(params: Params) -> Result<Self> {
        params.check()?;
        Ok(Self {
            antialias: params.antialias.map(Stage::new),
            params,
            upkeep: Upkeep::default(),
            state: None,
        })
    }
}

debug_params!(Bmfr, params);

impl Steps for Bmfr {
    fn upkeep(&mut self) -> &mut Upkeep {
        &mut self.upkeep
    }

    fn forget(&mut self) {
        self.state = None;
        self.antialias.iter_mut().for_each(Stage::reset);
    }

    fn next(&mut self, frame: &Frame, mut output: Output) -> Result<Summary> {
        (self.state.iter()).try_for_each(|state| state.memory.check(frame))?;
        let params = &self.params;
        let (mut memory, evidence, noise, age) = match self.state.take() {
            Some(state) => (Some(state.memory), state.evidence, state.noise, state.age),
            None => (None, None, None, 0),
        };
        let first = memory.is_none();
        let materials = MaterialIds::of(frame, memory.as_mut());
        let given = frame;
        let frame = &materials.frame(given);
        let texture = materials.texture(frame);
        let catches_up = params.antialias.is_some() && params.history.innovation.is_some();
        let inputs = Inputs::new(frame, texture, memory.as_ref(), catches_up);

        let sample = illumination(frame.color, texture);
        let past = inputs.reproject(&params.history, memory, &sample, &mut output);
        let (mut history, missing) = merge(&params.history, &sample, &past, output.confidence);
        let light = history.pixels().part(LIGHT);
        let bright = exposure(light);
        let trust = (params.by_light).then(|| by_light(light, bright, frame.albedo.is_some()));
        let trust = trust.as_ref().map(Image::view);
        let fit = inputs.fit(params, &history, trust, age);
        accumulate_fits(&fit, &past.history, params.fitted_alpha, &mut history);
        let mixes = params.antialias.is_some_and(|stage| stage.choice);
        let compared = (mixes || params.restore.is_some())
            .then(|| Noise::compare(noise, sample.pixels(), inputs.motion.pixels()));
        let (noise, repeats) = compared.unzip();
        let repeats = repeats.unwrap_or(false);
        // The mean of noise that repeats varies by more than its samples tell.
        let mut detailed = (params.restore.filter(|_| !repeats))
            .map(|params| restored(&history, sample.pixels(), trust, params));
        drop((sample, past, fit));
        let (before, shown) = (evidence.as_ref(), detailed.as_mut());
        let evidence = (params.history.innovation.filter(|_| !first))
            .map(|params| inputs.correct(params, bright, trust, before, &mut history, shown));
        let light = detailed
            .as_ref()
            .map_or_else(|| history.channels(FITS), Image::view);
        let textured = texture.map(|texture| modulated(light.into(), texture, Way::Back));
        let color = textured.as_ref().map_or(light, Image::view);
        match &mut self.antialias {
            Some(stage) => {
                let corrects = params.history.innovation.is_some();
                let others = Others::by_confidence(View::new(color.size, 1, output.confidence));
                let input = Input {
                    weight: trust,
                    ..Input::denoised(color.into(), corrects, repeats, others)
                };
                let (before, motion) = (inputs.before.as_ref(), inputs.motion.pixels());
                stage.show(frame, before, motion, input, output.color);
            }
            None => show(color, output.color),
        }
        (output.history_length).copy_from_slice(history.plane(LENGTH.start));

        let left = Interleaved::of(history.view());
        let mut used = inputs.used;
        materials.omit_stand_ins(&mut used);
        self.state = Some(State {
            memory: materials.remember(given, left, &params.history, first),
            evidence,
            noise,
            age: age + 1,
        });
        Ok(Summary {
            used,
            missing,
            repeats,
        })
    }
}

/// A frame's buffers as the passes read them.
struct Inputs<'a> {
    frame: &'a Frame<'a>,
    /// The camera of the frame before.
    before: Option<Camera>,
    motion: Motion<'a>,
    texture: Option<Texture<'a>>,
    features: Features<'a>,
    used: Vec<&'static str>,
}

impl<'a> Inputs<'a> {
    fn new(
        frame: &'a Frame<'a>,
        texture: Option<Texture<'a>>,
        memory: Option<&Memory>,
        catches_up: bool,
    ) -> Self {
        let camera = memory.and_then(|memory| memory.camera.as_ref());
        let mut used = vec![];
        let motion = frame.motion(camera, memory.and_then(Memory::depth), &mut used);
        let (surface, textured) = (&frame.surface, frame.albedo.is_some());
        let rays = frame.camera.as_ref().map(Camera::rays);
        let place = (frame.geometry()).and_then(|geometry| Place::new(geometry, rays));
        let (continues, turned) = (memory.is_some(), surface.object_normal.is_some());
        let replays = frame.replay.is_some() && memory.is_some_and(Memory::expects_replay);
        let planes = memory.is_some_and(|memory| memory.tests_planes(frame, &motion));
        used.extend(names([
            ("albedo", textured),
            (
                "emission",
                (textured || catches_up) && frame.emission.is_some(),
            ),
            ("normal", surface.normal.is_some()),
            ("depth", surface.depth.is_some()),
            ("plane", planes),
            ("ids", continues && surface.ids.is_some()),
            (
                "position",
                matches!(place, Some(Place::Position(_))) && !used.contains(&"position"),
            ),
            ("object_normal", continues && turned),
            ("replay", replays),
        ]));
        Self {
            frame,
            before: camera.copied(),
            motion,
            texture,
            features: Features {
                normal: surface.normal,
                place,
            },
            used,
        }
    }

    /// Reprojects the history, and suppresses fireflies if `params` have it. Writes the output's confidence and rejection.
    fn reproject(
        &self,
        params: &history::Params,
        memory: Option<Memory>,
        sample: &Image,
        output: &mut Output,
    ) -> Recalled {
        let now = recall::Now {
            params,
            frame: self.frame,
            motion: &self.motion,
            texture: self.texture,
            sample,
            reflections: &[],
        };
        let hold = |known: Option<Pixels>| {
            let limits = params.fireflies?;
            let guide = Guide::new(sample.size, limits.radius, self.frame.surface, None);
            Some(without_fireflies(
                sample,
                known,
                self.texture,
                &guide,
                limits,
            ))
        };
        let mut memory = memory;
        recall::recall(
            &now,
            memory.as_mut(),
            CHANNELS,
            hold,
            output.confidence,
            output.rejection,
        )
    }

    /// Fits the accumulated light, where emitters do not count, and dark surfaces less. Pixels count by `trust`, if there is any.
    fn fit(
        &self,
        params: &Params,
        history: &Image,
        trust: Option<View>,
        age: usize,
    ) -> Interleaved {
        let weight = (self.texture).map(|texture| by_texture(texture, history, trust));
        fit(
            history.pixels().part(LIGHT),
            self.features,
            weight.as_ref().map(Image::view).or(trust).map(Pixels::from),
            params.features,
            params.block_of(self.frame),
            age,
        )
    }

    /// Estimates from new samples what is wrong with the output, which is `detailed` or, without it, the fits. Corrects output,
    /// fits and history by it. Samples count by `weight`, if there is one. Returns the evidence for the next frame.
    fn correct(
        &self,
        params: innovation::Params,
        bright: f32,
        weight: Option<View>,
        evidence: Option<&Interleaved>,
        history: &mut Image,
        detailed: Option<&mut Image>,
    ) -> Interleaved {
        let size = history.size;
        let [length, fits] = [LENGTH, FITS].map(|part| history.pixels().part(part));
        let samples = Illumination::of(self.frame.color, self.texture);
        let known = innovation::Known::of(evidence, self.motion.pixels());
        let shown = detailed.as_deref().map_or(fits, Image::pixels);
        let shown = innovation::Predicted {
            colors: &shown,
            lengths: length,
        };
        let (found, rest) = innovation(&samples, weight, &shown, known, bright, params);
        if let Some(detailed) = detailed {
            let behind = history.pixels_mut();
            correct(&found, size, LEAST, detailed.pixels_mut(), Some(behind));
        } else {
            let (accumulated, fits) = history.data_mut().split_at_mut(FITS.start * size.pixels());
            let [fits, behind] = [fits, accumulated].map(|data| PixelsMut::planar(size, data));
            correct(&found, size, LEAST, fits, Some(behind));
        }
        rest
    }
}

/// Accumulates the new sample. Returns the new history, its fits not yet written, and the number of missing samples.
fn merge(
    params: &history::Params,
    sample: &Image,
    past: &Recalled,
    confidence: &[f32],
) -> (Image, usize) {
    let size = sample.size;
    let mut history = Image::blank(size, CHANNELS);
    let accumulated = &mut history.data_mut()[..FITS.start * size.pixels()];
    let samples = Samples {
        size,
        color: &past.held.as_ref().unwrap_or(sample).pixels(),
        weight: None,
        gradient: past.gradient.as_ref().map(Image::view),
    };
    let known = Images {
        parts: accumulate::parts(past.history.pixels()),
        confidence: (params.by_confidence).then(|| View::new(size, 1, confidence)),
    };
    let merged = PixelsMut::planar(size, accumulated).map(|all| [(0..FITS.start, all)]);
    let nothing = std::iter::repeat(());
    let missing = accumulate(samples, &known, params.accumulate, merged, nothing);
    (history, missing)
}
