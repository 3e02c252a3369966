//! Temporal antialiasing, as a list of this library's kernels:
//!
//!   (motion from cameras) → (suppress fireflies) → (resolve the jittered sample) → (change of light) → (change of material)
//!     → (expose) → (lag) → (choice of the clip) → (temporal gradient) → (alternation) → dilate → reproject → (catch up) → clip
//!     → (anti-lag) → blend → (innovation) → (smooth edges) → (mix)
//!
//! From dilation to blend the kernels run in one fused pass ([`sweep`]). The temporal gradient looks at larger windows and
//! alternation has a history of its own, so both run before it and reproject for themselves.
//!
//! By default colours are merged across surfaces: no test of depth, normal or id refuses history, since along an edge
//! that would refuse what antialiases it. The neighbourhood's colours decide instead. Tests can be switched on for
//! sequences in which another surface's history has the neighbourhood's colours and would pass.

mod clip_choice;
mod lag;
mod mix;
mod params;
mod sweep;

use std::ops::Range;

use self::clip_choice::{Chosen, Predicted};
use self::lag::Lag;
use self::mix::{Seen, mix};
pub use self::params::{Limits, Params};
use self::sweep::{Merged, Sweep};
use super::correction::{correct, scale};
use super::frame::{
    Frame, Mistake, Output, OwnedSurface, Report, Steps, Summary, Upkeep, check_size,
};
use super::illumination::samples_without_fireflies;
use super::repetition::Noise;
use crate::error::{Error, Result};
use crate::image::{Image, Interleaved, Pixels, View};
use crate::kernels::camera::dilate::{Choice, dilate};
use crate::kernels::camera::pinhole::Camera;
use crate::kernels::fetch::footprint::Filter;
use crate::kernels::fetch::reproject::{self, Fetch, reproject};
use crate::kernels::fetch::validate::Tests;
use crate::kernels::judge::alternation::{self, alternation};
use crate::kernels::judge::exposure::exposure;
use crate::kernels::judge::gradient::{self, find_gradient};
use crate::kernels::judge::innovation::{self, innovation};
use crate::kernels::judge::light_change::light_change_along;
use crate::kernels::judge::material_change::material_change;
use crate::kernels::judge::repetition::luminances;
use crate::kernels::merge::resolve::{self, resolve};
use crate::kernels::smooth::edges::smooth_edges;
use crate::pixels::PixelsMut;

/// Finds changes of light beyond what aliasing explains. Each pass adds false alarms, hence a margin for noise above the
/// default.
const GRADIENT: gradient::Params = gradient::Params {
    noise: 2.2,
    passes: 3,
    widest: 5,
};

/// How the last stage of a denoiser is corrected by the innovation: its history lags behind light that moves, too. Antialiased
/// edges differ from single samples even where nothing changes, and at a strictness of 8 still images became worse. Changes
/// of light are far above that, so that the newest frame may count for more than in the denoiser.
const AFTER_DENOISER: innovation::Params = innovation::Params {
    strictness: 12.0,
    share: 0.7,
    ..innovation::Params::DEFAULT
};

/// What the stage leaves to the next frame.
struct History {
    /// Colour and length.
    merged: Interleaved,
    /// The memory of the alternation kernel, where it runs.
    alternation: Option<Interleaved>,
    /// Evidence of the innovation of the result, carried to the next frame.
    evidence: Option<Interleaved>,
    /// The same of the history before it is merged.
    lag: Option<Interleaved>,
    /// By what the next frame's tiles choose between the clip and none, if they do.
    predicted: Option<Predicted>,
    /// Luminances and evidence for the next frame's mixing weights, if samples and denoised colour are mixed in.
    seen: Option<Seen>,
    /// Whether the frame is the first.
    first: bool,
}

/// The passes from the temporal gradient to the blend, as [`Taa`] and the denoisers' last stage use them.
pub(crate) struct Stage {
    params: Params,
    history: Option<History>,
    /// Luminance of the last frame's albedo, where changes of material are looked for.
    albedo: Option<Image>,
}

/// What the stage merges into its history.
pub(crate) struct Input<'a> {
    pub color: Pixels<'a>,
    pub origin: Origin,
    /// How the samples correct the result, if they do.
    pub correction: Option<innovation::Params>,
    /// By how much of its difference from the result each sample counts then, if not all count wholly.
    pub weight: Option<View<'a>>,
    pub others: Others<'a>,
    /// Whether what is shown is mixed with the mean of all samples. History that is not clipped is nearly the mean of the last
    /// ones. That both are alike would be taken for a sign that both are right, so the clip always holds.
    pub averaged: bool,
}

/// Where the stage's colour is from.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Origin {
    /// It is the frame's samples.
    Samples,
    /// A denoiser has made it of the frame's samples. They are mixed in, unless their noise repeats.
    Denoiser { repeats: bool },
}

impl<'a> Input<'a> {
    /// From a denoiser.
    pub fn denoised(color: Pixels<'a>, corrects: bool, repeats: bool, others: Others<'a>) -> Self {
        Self {
            color,
            origin: Origin::Denoiser { repeats },
            correction: corrects.then_some(AFTER_DENOISER),
            weight: None,
            others,
            averaged: false,
        }
    }
}

/// Tests and confidence by which history of another surface is rejected.
pub(crate) struct Others<'a> {
    /// Tests that history must pass.
    pub tests: Tests<'a>,
    pub report: Option<Vec<Report<'a>>>,
    /// Confidence of the denoiser, if it is known: 0 where it found no history of the surface. History that has to be clipped
    /// there is shortened. Edges are smoothed the more, the less of it there is.
    pub confidence: Option<View<'a>>,
}

impl<'a> Others<'a> {
    /// Where the denoiser's confidence tells all.
    pub fn by_confidence(confidence: View<'a>) -> Self {
        Self {
            tests: Tests::none(),
            report: None,
            confidence: Some(confidence),
        }
    }
}

impl Stage {
    pub fn new(params: Params) -> Self {
        Self {
            params,
            history: None,
            albedo: None,
        }
    }

    pub fn reset(&mut self) {
        *self = Self::new(self.params);
    }

    /// The whole stage: antialiases a colour, corrects the result by what the frame's samples show to be wrong with it, and mixes
    /// them in behind a denoiser. `before` is the camera of the frame before. Returns the number of missing pixels.
    pub fn show<'a>(
        &mut self,
        frame: &Frame<'a>,
        before: Option<&Camera>,
        motion: Pixels<'a>,
        input: Input<'a>,
        shown: &mut [f32],
    ) -> usize {
        let (samples, color) = (frame.color, input.color);
        let depth = frame.surface.depth.map(Pixels::plane);
        let still = self.still(frame, before);
        let choice = Choice::of(depth, still.as_ref());
        if input.origin != Origin::Samples && input.correction.is_some() {
            self.follow_light(samples, motion);
        }
        let params = self.params.of(frame);
        let bright = match input.origin {
            Origin::Samples => params.exposure(color),
            Origin::Denoiser { .. } => exposure(color),
        };
        let params = params.exposed(bright);
        let known = self.known_materials(frame.albedo, motion, input.others.confidence);
        let mut input = input;
        if let Some(known) = &known {
            input.others.confidence = Some(known.view());
        }
        let lag = self.lag(frame, motion, &input, bright);
        let chosen = lag
            .as_ref()
            .and_then(|_| self.choose_clip(&input, samples, motion, bright));
        let (out, others) = (PixelsMut::bands(color.size, 3, shown), input.others);
        let confidence = others.confidence;
        let missing = self.step(
            params,
            color,
            lag.as_ref(),
            chosen,
            motion,
            choice,
            out,
            others,
        );
        drop(still);
        let (correction, weight) = (input.correction, input.weight);
        self.correct(correction, samples, weight, motion, bright, shown);
        let newest = (input.origin != Origin::Samples).then_some(color);
        let is_history = correction.is_none_or(|correction| correction.fed_back);
        self.smooth_edges(is_history, newest, confidence, bright, shown);
        if let Origin::Denoiser { repeats } = input.origin
            && let Some(history) = self.history.as_mut().filter(|_| self.params.choice)
        {
            let noise = mix::SampleNoise {
                repeats,
                jittered: frame.jitter.is_some(),
            };
            let seen = history.seen.take();
            let result = history.merged.pixels().part(0..3);
            let seen = mix(seen, samples, color, result, motion, bright, noise, shown);
            history.seen = Some(seen);
        }
        missing
    }

    /// Scales the history by what all light has changed by, as samples tell: denoised colour may fluctuate on its own.
    fn follow_light(&mut self, samples: Pixels, motion: Pixels) {
        let Some(history) = &mut self.history else {
            return;
        };
        let before = history.merged.pixels();
        let bilinear = reproject::Params::of(Filter::Bilinear);
        let fetch = Fetch::new(&[before], samples.size, Tests::none(), bilinear);
        let change = light_change_along(samples, &fetch, motion, before.channels);
        if change != 1.0 {
            let factors = [change, change, change, 1.0];
            scale(samples.size.width, history.merged.data_mut(), &factors);
            history.seen.iter_mut().for_each(|seen| seen.scale(change));
            (history.predicted.iter_mut()).for_each(|predicted| predicted.scale(change));
        }
    }

    /// The confidence, by default 1, where the material is that of the frame before, else 0. None if no material has changed.
    fn known_materials(
        &mut self,
        albedo: Option<Pixels>,
        motion: Pixels,
        confidence: Option<View>,
    ) -> Option<Image> {
        let albedo = albedo.filter(|_| self.params.material_change);
        let before = std::mem::replace(&mut self.albedo, albedo.map(luminances));
        let (now, before) = (self.albedo.as_ref()?.view(), before?);
        let mut known = material_change(now, before.view(), motion, Default::default())?;
        for (pixel, known) in known.data_mut().iter_mut().enumerate() {
            let confidence = confidence.map_or(1.0, |image| image.plane(0)[pixel]);
            *known = if *known > 0.0 { 0.0 } else { confidence };
        }
        Some(known)
    }

    /// The history, colour first, where its pixels are now; black where it is not known.
    fn known(&self, motion: Pixels) -> Option<Image> {
        let history = self.history.as_ref()?.merged.pixels();
        Some(fetch(history, motion, Tests::none(), Filter::Bilinear).0)
    }

    /// How the history lags behind the samples that a denoiser's colour was made of. None if samples correct nothing.
    fn lag(&mut self, frame: &Frame, motion: Pixels, input: &Input, exposure: f32) -> Option<Lag> {
        let corrects = input.origin != Origin::Samples && input.correction.is_some();
        let history = self.history.as_mut().filter(|_| corrects)?;
        let evidence = history.lag.as_ref();
        let (lag, rest) = Lag::find(frame, motion, &history.merged, input, exposure, evidence);
        history.lag = Some(rest);
        Some(lag)
    }

    /// Where history is clipped, if that is chosen. Samples whose noise repeats cannot judge.
    fn choose_clip(
        &mut self,
        input: &Input,
        samples: Pixels,
        motion: Pixels,
        exposure: f32,
    ) -> Option<Chosen> {
        let before = self.history.as_mut()?.predicted.take();
        let judges = input.origin == Origin::Denoiser { repeats: false };
        let chooses = self.params.clip_choice && judges && !input.averaged;
        chooses.then(|| Chosen::by(before, samples, motion, exposure))
    }

    /// The motion of the still scene, if the dilation of a frame asks for it and the cameras tell it.
    fn still(&self, frame: &Frame, before: Option<&Camera>) -> Option<Image> {
        let asks = self.params.dilate.is_some() && !self.params.dilate_movers;
        // Without motion of their own, no surfaces move by themselves.
        let moves = asks && frame.surface.depth.is_some() && frame.motion.is_some();
        moves.then(|| frame.still(before)).flatten()
    }

    /// Merges a colour into the history, and makes pixels black that no frame had a sample for. `choice` is that of the
    /// dilation. Returns the number of missing samples.
    fn step<'a>(
        &mut self,
        params: Params,
        color: Pixels<'a>,
        lag: Option<&'a Lag>,
        chosen: Option<Chosen>,
        motion: Pixels<'a>,
        choice: Choice<'a>,
        merged: impl Iterator<Item = PixelsMut<'a>>,
        others: Others<'a>,
    ) -> usize {
        let before = self.history.take();
        let Others {
            tests,
            report,
            confidence,
        } = others;

        let dilation = (params.dilation()).filter(|_| params.gradient || params.alternation);
        let dilated = dilation.map(|dilation| dilate(motion, choice, dilation));
        let moved = dilated.as_ref().map_or(motion, Image::pixels);
        let past = |records: &Interleaved, filter| fetch(records.pixels(), moved, tests, filter);
        let gradient = (before.as_ref().filter(|_| params.gradient))
            .map(|before| change_of_light(color, past(&before.merged, params.filter)));
        let alternation = params.alternation.then(|| {
            let known = before
                .as_ref()
                .and_then(|before| before.alternation.as_ref());
            let known = known.map(|memory| past(memory, Filter::Bilinear));
            find_alternation(color, known, params.clip.exposure)
        });
        let history = before.as_ref().map(|before| [before.merged.pixels()]);
        let sweep = Sweep {
            params,
            color,
            lag,
            motion,
            choice,
            fetch: history.map(|history| {
                Fetch::new(
                    &history,
                    color.size,
                    tests,
                    reproject::Params::of(params.filter),
                )
            }),
            gradient: gradient.as_ref().map(Image::view),
            returns: (alternation.as_ref()).map(|memory| memory.pixels().part(RETURNS)),
            confidence,
            predicts: chosen.is_some(),
            chosen: chosen.as_ref().and_then(Chosen::levels),
        };
        let Merged {
            history: merged,
            predicted,
            missing,
        } = sweep.run(merged, report);
        let predicted = (chosen.zip(predicted)).map(|(chosen, luminances)| chosen.and(luminances));
        let first = before.is_none();
        let carried = before.map(|before| (before.evidence, before.lag, before.seen));
        let (evidence, lag, seen) = carried.unwrap_or_default();
        self.history = Some(History {
            merged,
            alternation,
            evidence,
            lag,
            predicted,
            seen,
            first,
        });
        missing
    }

    /// Smooths what is shown along its edges; the history stays as it is. `is_history` tells that both are still the same, so that
    /// the history can be read instead of a copy.
    fn smooth_edges(
        &self,
        is_history: bool,
        newest: Option<Pixels>,
        confidence: Option<View>,
        exposure: f32,
        shown: &mut [f32],
    ) {
        let Some(history) = self.history.as_ref().filter(|_| self.params.smooth_edges) else {
            return;
        };
        let size = history.merged.size;
        let copy = (!is_history).then(|| Pixels::of_interleaved(size, 3, shown).to_planes());
        let color = match &copy {
            Some(copy) => copy.pixels(),
            None => history.merged.pixels().part(0..3),
        };
        let out = PixelsMut::bands(size, 3, shown);
        smooth_edges(color, newest, confidence, exposure, out);
    }

    /// Corrects what [`Self::step`] has shown by the innovation of the frame's samples, and with it the history if that is fed
    /// back.
    fn correct(
        &mut self,
        params: Option<innovation::Params>,
        samples: Pixels,
        weight: Option<View>,
        motion: Pixels,
        exposure: f32,
        shown: &mut [f32],
    ) {
        let Some((params, history)) = params.zip(self.history.as_mut()) else {
            return;
        };
        if history.first {
            return;
        }
        let size = samples.size;
        let color = Pixels::of_interleaved(size, 3, shown);
        let length = history.merged.pixels().part(3..4);
        let known = innovation::Known::of(history.evidence.as_ref(), motion);
        let shown_before = innovation::Predicted {
            colors: &color,
            lengths: length,
        };
        let (found, rest) = innovation(&samples, weight, &shown_before, known, exposure, params);
        let behind = (params.fed_back).then(|| history.merged.pixels_mut());
        let shown = PixelsMut::bands(size, 3, shown);
        correct(&found, size, 0.0, shown, behind);
        history.evidence = Some(rest);
    }
}

/// The channel of the alternation kernel's memory that counts returns.
const RETURNS: Range<usize> = alternation::CHANNELS - 1..alternation::CHANNELS;

/// Reprojects what the last frame left, and tells its coverage.
fn fetch(past: Pixels, motion: Pixels, tests: Tests, filter: Filter) -> (Image, Image) {
    let size = motion.size;
    let mut coverage = Image::blank(size, 1);
    let (covered, params) = (coverage.data_mut(), reproject::Params::of(filter));
    let [image] = reproject(&[past], motion, tests, params, covered, None)
        .try_into()
        .expect("an image for each that is fetched");
    (image, coverage)
}

/// The temporal gradient from the reprojected history to a colour.
fn change_of_light(color: Pixels, (history, coverage): (Image, Image)) -> Image {
    let before = history.pixels().part(0..3);
    find_gradient([color, before], Some(coverage.view()), GRADIENT)
}

/// The alternation kernel's memory with one more colour.
fn find_alternation(color: Pixels, known: Option<(Image, Image)>, exposure: f32) -> Interleaved {
    let known = known.as_ref().map(|(memory, coverage)| alternation::Known {
        memory: memory.pixels(),
        coverage: Some(coverage.view()),
    });
    let mut memory = Interleaved::blank(color.size, alternation::CHANNELS);
    alternation(color, known, exposure, memory.pixels_mut());
    memory
}

/// What one frame leaves to the next beside the stage's history.
struct State {
    camera: Option<Camera>,
    surface: OwnedSurface,
    /// Of the samples that a denoiser had, if they are mixed in.
    noise: Option<Noise>,
}

/// Temporal antialiasing.
pub struct Taa {
    stage: Stage,
    upkeep: Upkeep,
    state: Option<State>,
}

impl Taa {
    /// A pipeline without history; an error if a parameter is out of range.
    pub fn new(params: Params) -> Result<Self> {
        params.check()?;
        Ok(Self {
            stage: Stage::new(params),
            upkeep: Upkeep::default(),
            state: None,
        })
    }
}

/// What a frame's colour was denoised from.
#[derive(Clone, Copy)]
pub struct Source<'a> {
    /// The samples, 3 channels.
    pub samples: Pixels<'a>,
    /// How much the denoiser found of the surface's history: 0 where it found none.
    pub confidence: Option<View<'a>>,
}

impl Taa {
    /// As [`Pipeline::step`](super::Pipeline::step), for a frame whose colour is denoised: with [`Params::innovation`], the samples that it was made
    /// of correct the result and the history. History that has to be clipped where the denoiser had none is shortened.
    ///
    /// # Errors
    /// As `step`, and if the source has another size or its samples not 3 channels.
    pub fn step_denoised(
        &mut self,
        frame: &Frame,
        source: Source,
        output: Output,
    ) -> Result<(Summary, Option<Mistake>)> {
        self.checked(frame, |pipeline, frame| {
            let size = frame.color.size;
            output.check(size, pipeline.writes())?;
            let Source {
                samples,
                confidence,
            } = source;
            if samples.size != size {
                return Err(Error::value("samples", size, samples.size));
            }
            if let Some(confidence) = confidence.filter(|image| image.size != size) {
                return Err(Error::value("confidence", size, confidence.size));
            }
            if samples.channels != 3 {
                return Err(Error::value("samples", "3 channels", samples.channels));
            }
            pipeline.advance(frame, Some(source), output)
        })
    }
}

debug_params!(Taa, stage.params);

impl Steps for Taa {
    fn upkeep(&mut self) -> &mut Upkeep {
        &mut self.upkeep
    }

    fn forget(&mut self) {
        self.stage.reset();
        self.state = None;
    }

    fn next(&mut self, frame: &Frame, output: Output) -> Result<Summary> {
        self.advance(frame, None, output)
    }
}

impl Taa {
    fn advance(
        &mut self,
        frame: &Frame,
        source: Option<Source>,
        mut output: Output,
    ) -> Result<Summary> {
        let (size, params) = (frame.color.size, self.stage.params);
        if let Some(history) = &self.stage.history {
            check_size(history.merged.size, size)?;
        }
        let mut before = self.state.take();
        let noise = before.as_mut().and_then(|before| before.noise.take());
        let mut used = vec![];
        let camera = before.as_ref().and_then(|before| before.camera.as_ref());
        let surface = before.as_ref().map(|before| before.surface.surface());
        let surface = surface.unwrap_or_default();
        let motion = frame.motion(camera, surface.depth, &mut used);
        let held = params.fireflies.map(|limits| {
            let samples = source.map_or(frame.color, |source| source.samples);
            let known = self.stage.known(motion.pixels());
            let known = known.as_ref().map(|known| known.pixels().part(0..3));
            samples_without_fireflies(samples, known, frame.surface, limits)
        });
        let samples = held.as_ref().map(Image::pixels);
        let source = source.map(|source| Source {
            samples: samples.unwrap_or(source.samples),
            ..source
        });
        let own = samples.filter(|_| source.is_none());
        let frame = &Frame {
            color: own.unwrap_or(frame.color),
            ..*frame
        };
        // Denoised colour is already filtered: its jitter is not resolved.
        let filter = params.reconstruct.filter(|_| source.is_none());
        let resolved = resolve_jitter(frame, filter, &mut used);
        let color = (resolved.as_ref()).map_or(frame.color, |(image, _)| image.pixels());
        let rays = camera.filter(|_| motion.tells_depth()).map(Camera::rays);
        let tests = (params.limits).tests(frame.surface, surface, rays);
        let catches_up = source.is_some() && params.innovation.is_some();
        let uses_depth = params.dilate.is_some() || catches_up;
        used.extend(list_used(
            &tests,
            uses_depth && frame.surface.depth.is_some(),
        ));
        used.extend((catches_up && frame.emission.is_some()).then_some("emission"));
        let compares = params.material_change && frame.albedo.is_some();
        used.extend((compares && !tests.used().contains(&"albedo")).then_some("albedo"));
        let chooses_clip = params.clip_choice && params.innovation.is_some();
        let compared = (source.filter(|_| params.choice || chooses_clip))
            .map(|source| Noise::compare(noise, source.samples, motion.pixels()));
        let (noise, repeats) = compared.unzip();
        let repeats = repeats.unwrap_or(false);
        let (shown, report) = output.parts(size);
        let motion = motion.pixels();
        let others = Others {
            tests,
            report: Some(report),
            confidence: source.and_then(|source| source.confidence),
        };
        let input = match source {
            Some(_) => Input::denoised(color, params.innovation.is_some(), repeats, others),
            None => Input {
                color,
                origin: Origin::Samples,
                correction: params.innovation,
                weight: None,
                others,
                averaged: false,
            },
        };
        let sampled = &Frame {
            color: source.map_or(frame.color, |source| source.samples),
            ..*frame
        };
        let missing = self.stage.show(sampled, camera, motion, input, shown);
        self.state = Some(State {
            camera: frame.camera,
            surface: params.limits.keep(frame.surface),
            noise,
        });
        let missing = resolved.map_or(missing, |(_, missing)| missing);
        Ok(Summary {
            used,
            missing,
            repeats,
        })
    }
}

/// The buffers that the surface tests use, and depth if something else does.
fn list_used(tests: &Tests, uses_depth: bool) -> impl Iterator<Item = &'static str> {
    let tested = tests.used();
    let depth = uses_depth || tested.contains(&"depth");
    let others = tested.into_iter().filter(|&name| name != "depth");
    depth.then_some("depth").into_iter().chain(others)
}

/// Brings jittered samples to pixel centres, if the frame tells its jitter, and counts those that are missing.
fn resolve_jitter(
    frame: &Frame,
    filter: Option<resolve::Filter>,
    used: &mut Vec<&'static str>,
) -> Option<(Image, usize)> {
    let (filter, jitter) = filter.zip(frame.jitter)?;
    used.push("jitter");
    let mut image = Image::blank(frame.color.size, 3);
    let missing = resolve(&[(frame.color, jitter)], filter, image.pixels_mut());
    Some((image, missing))
}
