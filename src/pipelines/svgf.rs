//! Spatiotemporal variance-guided filtering (Schied et al. 2017), as a list of this library's kernels:
//!
//!   demodulate → (motion from cameras) → (replay) → reproject → (coherence → reproject) → (change of light)
//!     → (suppress fireflies) → (temporal gradient) → (reflections) → (lend) → accumulate → (join later frames) → (choice)
//!     → estimate variance → à-trous → (innovation) → remodulate → (antialias → (innovation) → (mix)) → (converge)
//!
//! Where the noise of a frame is that of the frame before, its samples do not judge: no choice, no mix, and the variance is
//! estimated in space.
//!
//! Every buffer but colour is optional; what is absent drops out of the tests and weights that would use it.

mod finish;
mod merge;
mod params;
mod passes;
mod sides;
mod still;

use std::cell::OnceCell;

use self::finish::finish;
use self::merge::{Merged, merge, merge_at_once};
pub use self::params::{ANTIALIASED, Params};
use self::passes::{choose, filter};
use self::sides::{Joined, expect, join};
use self::still::Still;
use super::frame::{
    Expectation, Extras, Frame, History, HistoryMut, Mistake, Motion, Output, Steps, Summary,
    Upkeep, names,
};
use super::illumination::{Illumination, illumination};
use super::material_ids::MaterialIds;
use super::recall::{Incoherent, Memory, told_by_motion};
use super::reflections;
use super::repetition::Noise;
use super::taa::Stage;
use crate::error::Result;
use crate::image::{Image, Interleaved, Pixels, Size, View};
use crate::kernels::camera::parallax::parallax;
use crate::kernels::camera::pinhole::Camera;
use crate::kernels::fetch::validate::Surface;
use crate::kernels::judge::exposure::exposure;
use crate::kernels::judge::innovation::{self, Innovation, innovation};
use crate::kernels::merge::accumulate;
use crate::kernels::smooth::demodulate::Texture;
use crate::kernels::smooth::guide::{Coarse, Guide};
use crate::pixels::Colors;

/// What goes from frame to frame, beside the history of the output stage.
struct State {
    memory: Memory,
    /// Evidence of the innovation, carried to the next frame.
    evidence: Option<Interleaved>,
    /// Evidence of each tile for the numbers of passes.
    choice: Option<Interleaved>,
    /// The luminance of the samples, by which noise that repeats is detected; if samples judge.
    noise: Option<Noise>,
    /// Where nothing moved, if samples judge.
    still: Option<Still>,
}

/// What a step is for.
enum Task<'a> {
    /// To show the frame, as the frames before it know it, and those after it if their history is given.
    Show(Shown<'a>, Option<&'a History<'a>>),
    /// To tell what history expects of the frame.
    Recall(Expectation<'a>),
}

/// Where a step writes what it shows.
struct Shown<'a> {
    color: &'a mut [f32],
    variance: &'a mut [f32],
    choice: Option<&'a mut [f32]>,
    motion: Option<&'a mut [f32]>,
}

/// Where a step writes what it saw of history.
struct Reports<'a> {
    history_length: &'a mut [f32],
    confidence: &'a mut [f32],
    rejection: &'a mut [u8],
}

/// Spatiotemporal variance-guided filtering.
pub struct Svgf {
    params: Params,
    upkeep: Upkeep,
    state: Option<State>,
    antialias: Option<Stage>,
}

impl Svgf {
    /// The parameters.
    pub fn params(&self) -> &Params {
        &self.params
    }

    /// A pipeline without history; an error if a parameter is out of range. With `average_still`, the limit of noise is off,
    /// and so are the output stage's weights by tone and its larger share in frames without guides: with them, the image of a
    /// scene at rest ends farther from the mean of all samples. Brighter taps do not weigh less either, as that darkens noise.
    pub fn new(mut params: Params) -> Result<Self> {
        params.check()?;
        if params.average_still {
            params.atrous.relative_noise = f32::INFINITY;
            params.tap_exposure = f32::INFINITY;
            if let Some(stage) = &mut params.antialias {
                (stage.unguided_alpha, stage.guided_exposure) = (0.0, 0.0);
            }
        }
        Ok(Self {
            antialias: params.antialias.map(Stage::new),
            params,
            upkeep: Upkeep::default(),
            state: None,
        })
    }
}

debug_params!(Svgf, params);

impl Steps for Svgf {
    fn writes(&self) -> Extras {
        Extras {
            variance: true,
            choice: self.params.choice.is_some(),
            motion: !self.params.reflections.is_empty() && self.antialias.is_none(),
        }
    }

    fn upkeep(&mut self) -> &mut Upkeep {
        &mut self.upkeep
    }

    fn forget(&mut self) {
        self.state = None;
        self.antialias.iter_mut().for_each(Stage::reset);
    }

    fn next(&mut self, frame: &Frame, output: Output) -> Result<Summary> {
        self.show(frame, None, output)
    }
}

impl Svgf {
    /// As [`Pipeline::step`](super::Pipeline::step), with the history that later frames have of the frame's pixels: a pipeline that runs backwards
    /// [recalls](Self::recall) it. The two join before the filter, by their lengths.
    ///
    /// # Errors
    /// As `step`, and if the history has another size.
    pub fn step_between(
        &mut self,
        frame: &Frame,
        later: &History,
        output: Output,
    ) -> Result<(Summary, Option<Mistake>)> {
        self.checked(frame, |pipeline, frame| {
            output.check(frame.color.size, pipeline.writes())?;
            later.check(frame.color.size)?;
            pipeline.show(frame, Some(later), output)
        })
    }

    /// Goes on to the next frame as a step does, but instead of showing it writes what history expects of its pixels,
    /// shortened where the light has changed. The frame's own sample is not in it.
    ///
    /// # Errors
    /// As [`Pipeline::step`](super::Pipeline::step).
    pub fn recall(
        &mut self,
        frame: &Frame,
        expected: HistoryMut,
    ) -> Result<(Summary, Option<Mistake>)> {
        self.checked(frame, |pipeline, frame| {
            expected.check(frame.color.size)?;
            let (expectation, confidence, rejection) = expected.parts();
            let mut length = Image::blank(frame.color.size, 1);
            let reports = Reports {
                history_length: length.data_mut(),
                confidence,
                rejection,
            };
            pipeline.advance(frame, Task::Recall(expectation), reports)
        })
    }

    fn show(&mut self, frame: &Frame, later: Option<&History>, output: Output) -> Result<Summary> {
        let shown = Shown {
            color: output.color,
            variance: output.variance.expect("checked by Output::check"),
            choice: output.choice,
            motion: output.motion,
        };
        let reports = Reports {
            history_length: output.history_length,
            confidence: output.confidence,
            rejection: output.rejection,
        };
        self.advance(frame, Task::Show(shown, later), reports)
    }

    fn advance(&mut self, frame: &Frame, mut task: Task, reports: Reports) -> Result<Summary> {
        (self.state.iter()).try_for_each(|state| state.memory.check(frame))?;
        if matches!(task, Task::Recall(_)) {
            // The output stage does not see this frame, and would go on from an image that is too old.
            self.antialias.iter_mut().for_each(Stage::reset);
        }
        let mut past = self.state.take();
        let first = past.is_none();
        let before = past.as_ref().and_then(|past| past.memory.camera);
        let mut used = vec![];
        let depth = past.as_ref().and_then(|past| past.memory.depth());
        let motion = frame.motion(before.as_ref(), depth, &mut used);
        let rests = self.params.average_still && frame.rests(before.as_ref());
        let materials = MaterialIds::of(frame, past.as_mut().map(|past| &mut past.memory));
        let given = frame;
        let frame = &materials.frame(given);
        let texture = materials.texture(frame);
        let asks = self.params.looks_around() || !matches!(task, Task::Show(_, None));
        let sample = asks.then(|| illumination(frame.color, texture));
        let chooses = self.params.chooses(texture.is_some());
        let judges = sample.as_ref().filter(|_| chooses);
        let (noise, repeats) = self.compare_noise(past.as_mut(), judges, &motion, &mut task);
        // A replay corrects the history of light, which the mean of colours cannot follow.
        let averages = rests && noise.is_some() && !repeats && frame.replay.is_none();
        let still = past.as_mut().and_then(|past| past.still.take());
        let still = still.filter(|_| averages);
        let frames = still.as_ref().map(|still| still.frames);
        let params = &*self.params.for_frame(frames, repeats, chooses);
        let now = Current {
            params,
            accumulate: match rests {
                true => params.history.accumulate.averaging(),
                false => params.history.accumulate,
            },
            averages,
            frame,
            before,
            motion: &motion,
            texture,
            guide: OnceCell::new(),
            sample,
            continues: !first,
            joins: matches!(task, Task::Show(_, Some(_))),
            repeats,
        };

        let left = run(now, past, still, task, reports, self.antialias.as_mut());
        let missing = left.missing;
        used.extend(left.used);
        materials.omit_stand_ins(&mut used);
        let mut memory = materials.remember(given, left.history, &params.history, first);
        memory.reflections = left.reflections;
        self.state = Some(State {
            memory,
            evidence: left.evidence,
            choice: left.choice,
            noise,
            still: left.still,
        });
        Ok(Summary {
            used,
            missing,
            repeats,
        })
    }

    /// Detects noise that repeats that of the previous frame, where samples are to judge. If they do not, every pixel shows the
    /// default number of passes. Also returns what the next frame is compared with.
    fn compare_noise(
        &self,
        past: Option<&mut State>,
        judges: Option<&Image>,
        motion: &Motion,
        task: &mut Task,
    ) -> (Option<Noise>, bool) {
        let Task::Show(shown, _) = task else {
            return (None, false);
        };
        let (noise, repeats) = match judges {
            Some(sample) => {
                let before = past.and_then(|past| past.noise.take());
                let (noise, repeats) = Noise::compare(before, sample.pixels(), motion.pixels());
                (Some(noise), repeats)
            }
            None => (None, false),
        };
        if let (true, Some(choice)) = (repeats || judges.is_none(), &mut shown.choice) {
            choice.fill(self.params.atrous.iterations as f32);
        }
        (noise, repeats)
    }
}

/// What the passes leave.
struct Left {
    history: Interleaved,
    reflections: Option<reflections::Memory>,
    evidence: Option<Interleaved>,
    choice: Option<Interleaved>,
    still: Option<Still>,
    /// The buffers that took part, beside those of which motion is made.
    used: Vec<&'static str>,
    /// Samples that were not finite.
    missing: usize,
}

/// The passes, in their order. Images are dropped after the last pass that reads them, so that later ones reuse their memory.
fn run(
    mut now: Current,
    past: Option<State>,
    still: Option<Still>,
    mut task: Task,
    mut reports: Reports,
    antialias: Option<&mut Stage>,
) -> Left {
    let (memory, evidence, choice) = match past {
        Some(past) => (Some(past.memory), past.evidence, past.choice),
        None => (None, None, None),
    };
    let replays = now.frame.replay.is_some() && memory.as_ref().is_some_and(Memory::expects_replay);
    let planes = (memory.as_ref()).is_some_and(|memory| memory.tests_planes(now.frame, now.motion));
    let Merged {
        mut history,
        missing,
        recalled,
    } = match &now.sample {
        Some(sample) => merge(&now, sample, memory, &mut reports),
        None => merge_at_once(&now, memory, &mut reports),
    };
    let mut still = (now.averages).then(|| Still::add(still, &now, recalled.as_ref()));
    if let (Some(settled), Task::Show(shown, None)) = (&mut still, &mut task)
        && settled.is_settled(now.frame.color, reports.history_length)
    {
        show_settled(&now, settled, shown);
        return Left {
            used: now.used([planes, replays, false]),
            reflections: None,
            history,
            evidence,
            choice,
            still,
            missing,
        };
    }
    let (joined, mut shown, moved) = match task {
        Task::Show(mut shown, later) => {
            let joined = join(&now, recalled.as_ref(), &history, later, &mut reports);
            let moved = shown.motion.take();
            (joined, Some(shown), moved)
        }
        Task::Recall(into) => {
            let history = [into.color, into.moments, into.length];
            expect(recalled.as_ref(), now.size(), history);
            (Joined::default(), None, Some(into.motion))
        }
    };
    let (mut won, incoherent) = match recalled {
        Some(recalled) => (recalled.reflections, recalled.incoherent),
        None => (None, None),
    };
    let own = now.motion.pixels();
    let reflected = won.as_ref().and_then(|won| won.motion.as_ref());
    let along = reflected.map_or(own, Image::pixels);
    let exposure = now.exposure(joined.history.as_ref().unwrap_or(&history));
    let levels = shown.as_mut().and_then(|shown| shown.choice.take());
    let mut choosing = choose(&now, joined.prediction, along, choice, &reports, levels);
    let guide = now.take_guide(incoherent);
    let choices = choosing.as_mut();
    let mut passes = filter(
        &now,
        &guide,
        &reports,
        &mut history,
        joined.history,
        exposure,
        choices,
    );
    drop(guide);
    let choice = choosing.map(|choosing| choosing.judge(&now, exposure));
    let (innovation, evidence) = now
        .innovate(&passes, along, evidence, exposure, &reports)
        .unzip();
    now.sample = None;
    let mut light = passes.light.take();
    let followed = (won.as_mut()).and_then(|won| won.seen(own, now.frame.albedo));
    let followed = followed.map(Image::pixels);
    if let Some(moved) = moved {
        write_motion(followed.unwrap_or(own), moved);
    }
    let stage = antialias.filter(|_| shown.is_some());
    finish(
        &now,
        passes,
        innovation.as_ref(),
        &mut history,
        light.as_mut(),
        stage.map(|stage| (stage, followed)),
        View::new(now.size(), 1, reports.confidence),
        shown.as_mut(),
    );
    if let Some((still, shown)) = still.as_mut().zip(shown) {
        still.show(&now, shown.color);
    }
    Left {
        used: now.used([planes, replays, won.is_some()]),
        reflections: light.map(|light| now.remember(light, won)),
        history,
        evidence,
        choice,
        still,
        missing,
    }
}

/// Shows the filtered mean of all samples alone: no filter, choice, innovation or output stage for what it would replace. The
/// output stage keeps its history, as nothing has moved.
fn show_settled(now: &Current, still: &mut Still, shown: &mut Shown) {
    let variance = still.show_alone(now, shown.color);
    shown.variance.copy_from_slice(variance.plane(0));
    if let Some(levels) = &mut shown.choice {
        levels.fill(now.params.atrous.iterations as f32);
    }
    if let Some(moved) = &mut shown.motion {
        write_motion(now.motion.pixels(), moved);
    }
}

/// Writes motion without the change of depth.
fn write_motion(motion: Pixels, into: &mut [f32]) {
    motion.part(0..2).to_planes().view().interleave(into);
}

/// A frame on its way through the passes.
struct Current<'a> {
    params: &'a Params,
    /// How the frame's samples join the history.
    accumulate: accumulate::Params,
    /// Whether the mean of all samples takes part in what is shown.
    averages: bool,
    frame: &'a Frame<'a>,
    /// The camera of the frame before.
    before: Option<Camera>,
    motion: &'a Motion<'a>,
    texture: Option<Texture<'a>>,
    /// Built at its first use, after images that are no longer needed have been freed.
    guide: OnceCell<Guide>,
    /// The illumination as an image, if a pass reads the surroundings of a pixel.
    sample: Option<Image>,
    /// Whether there is a history.
    continues: bool,
    /// Whether later frames join it.
    joins: bool,
    /// Whether the samples have the noise of the frame before.
    repeats: bool,
}

impl Current<'_> {
    fn size(&self) -> Size {
        self.frame.color.size
    }

    fn guide(&self) -> &Guide {
        self.guide.get_or_init(|| self.guide_by(None))
    }

    /// Takes the guide of the filter out, or builds one by coarse ids where normals and ids are incoherent.
    fn take_guide(&mut self, incoherent: Option<Incoherent>) -> Guide {
        match (incoherent, self.guide.take()) {
            (Some(found), usual) => {
                drop(usual);
                self.guide_by(Some(found.guide()))
            }
            (None, usual) => usual.unwrap_or_else(|| self.guide_by(None)),
        }
    }

    fn guide_by(&self, coarse: Option<Coarse>) -> Guide {
        let reach = self.params.reach();
        // Not with frames from both sides, where three of 26 sequences lost 0.12 to 0.26 dB.
        let parallax = match self.frame.surface {
            Surface {
                normal: None,
                ids: None,
                ..
            } if !self.joins => told_by_motion(self.frame).map(parallax),
            _ => None,
        };
        let depth = parallax.as_ref().map(Image::pixels);
        let surface = Surface {
            depth: self.frame.surface.depth.or(depth),
            ..self.frame.surface
        };
        Guide::new(self.size(), reach, surface, coarse)
    }

    /// The illumination as it was sampled.
    fn fresh(&self) -> Illumination<'_> {
        match &self.sample {
            Some(image) => Illumination::of(image.pixels(), None),
            None => Illumination::of(self.frame.color, self.texture),
        }
    }

    /// The exposure of the history, the unit in which the filter, choice and innovation measure light; 1 if none of them does.
    fn exposure(&self, history: &Interleaved) -> f32 {
        let params = self.params;
        let judged = params.choice.is_some() || params.history.innovation.is_some();
        if judged || params.tap_exposure.is_finite() {
            exposure(history.pixels().part(0..3))
        } else {
            1.0
        }
    }

    /// What the samples show to be wrong with the filtered light, and the evidence for the next frame.
    fn innovate(
        &self,
        prediction: &impl Colors,
        motion: Pixels,
        evidence: Option<Interleaved>,
        exposure: f32,
        reports: &Reports,
    ) -> Option<(Innovation, Interleaved)> {
        let params = self.params.history.innovation.filter(|_| self.continues)?;
        let prediction = innovation::Predicted {
            colors: prediction,
            lengths: View::new(self.size(), 1, reports.history_length).into(),
        };
        let known = innovation::Known::of(evidence.as_ref(), motion);
        let fresh = &self.fresh();
        let found = innovation(fresh, None, &prediction, known, exposure, params);
        Some(found)
    }

    /// The light in which the next frame looks for reflections, with the distances that have won.
    fn remember(&self, light: Interleaved, won: Option<reflections::Won>) -> reflections::Memory {
        let scores = match won {
            Some(won) => won.scores,
            None => reflections::Scores::new(self.size(), self.params.reflections.len()),
        };
        reflections::Memory { light, scores }
    }

    /// The names of the buffers that take part, beside those of which motion is made.
    fn used(&self, [planes, replays, reflects]: [bool; 3]) -> Vec<&'static str> {
        let Frame { surface, .. } = self.frame;
        let albedo = self.frame.albedo.is_some();
        let turned = surface.object_normal.is_some();
        let params = self.params;
        let catches_up = params.antialias.is_some() && params.history.innovation.is_some();
        names([
            ("albedo", albedo),
            (
                "emission",
                (albedo || catches_up) && self.frame.emission.is_some(),
            ),
            ("normal", surface.normal.is_some()),
            ("depth", surface.depth.is_some()),
            ("plane", planes),
            ("ids", surface.ids.is_some()),
            ("object_normal", self.continues && turned),
            ("replay", replays),
            (
                "hit_distance",
                reflects && self.frame.hit_distance.is_some(),
            ),
        ])
    }
}
