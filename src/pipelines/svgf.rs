//! Spatiotemporal variance-guided filtering (Schied et al. 2017), as a list of this library's kernels:
//!
//!   demodulate → (motion from cameras) → (replay) → reproject → (suppress fireflies) → (temporal gradient) → (reconstruct)
//!     → accumulate → estimate variance → (choice) → à-trous → (innovation) → remodulate → (antialias)
//!
//! Every buffer but colour is optional; what is absent drops out of the tests and weights that would use it.

use std::ops::Range;

use pulp::Simd;

use super::frame::{
    Extras, Frame, Motion, Output, Pipeline, Steps, Summary, SurfaceRecords, Upkeep, check_size,
};
use super::half_res;
use super::passes::{self, Choosing, Look, Smooth};
use super::reflections::{self, Own};
use super::replay;
use super::taa::{self, Stage, blacken_missing};
use crate::bordered::BorderedBand;
use crate::error::{Error, Result, in_range};
use crate::image::{
    BandMut, Image, Pixels, Records, Run, SEGMENT, Size, View, bands_of, deinterleave, segments,
};
use crate::kernels::camera::pinhole::Camera;
use crate::kernels::fetch::footprint::{Filter, MotionLanes};
use crate::kernels::fetch::reproject::{self, Fetch, reproject};
use crate::kernels::judge::choice;
use crate::kernels::judge::exposure::exposure;
use crate::kernels::judge::gradient::{self, temporal_gradient};
use crate::kernels::judge::innovation::{self, Innovation, corrected, innovation};
use crate::kernels::judge::surface::{self, Surface, Tests};
use crate::kernels::merge::accumulate::{self, accumulate, count_missing};
use crate::kernels::smooth::atrous::{self, Filtered};
use crate::kernels::smooth::demodulate::{Texture, Way, modulate};
use crate::kernels::smooth::fireflies::{self, suppress_fireflies};
use crate::kernels::smooth::guide::{Guide, Sigmas};
use crate::kernels::smooth::variance::{self, Estimate};
use crate::math::luminance;
use crate::pixels::{Colors, PixelsMut, Row};
use crate::rows::{self, BAND, Kernel, LanesKernel};

/// Parameters of [`Svgf`].
#[derive(Clone, Debug)]
pub struct Params {
    /// The tests that history must pass.
    pub surface: surface::Params,
    /// How samples join the history.
    pub accumulate: accumulate::Params,
    /// How the variance is estimated.
    pub variance: variance::Params,
    /// The filter.
    pub atrous: atrous::Params,
    /// Whether the first pass of the filter, instead of its input, is the next frame's history.
    pub feedback: bool,
    /// Whether history must be of the same albedo, by the surface's threshold of luminance.
    pub same_albedo: bool,
    /// Whether the new sample's share rises where the history is not wholly trusted.
    pub by_confidence: bool,
    /// Whether changes of light correct and shorten history where frames have replays, and shorten it by estimate where
    /// they have none.
    pub gradient: bool,
    /// Whether outliers are held down.
    pub fireflies: Option<fireflies::Params>,
    /// Whether each tile gets as many passes of the filter, up to one more than `atrous.iterations`, as predicted best.
    pub choice: Option<choice::Params>,
    /// Whether what new samples say of the result corrects it, and the history.
    pub innovation: Option<innovation::Params>,
    /// Distances behind the surface at which reflections are looked for, in units of depth; above 0, +inf included.
    pub reflections: Vec<f32>,
    /// The output stage.
    pub antialias: Option<taa::Params>,
    /// For frames of which only a part is traced.
    pub half_res: Option<half_res::Params>,
}

/// By our own measurements.
impl Default for Params {
    fn default() -> Self {
        Self {
            accumulate: accumulate::Params {
                alpha: 0.2,
                ..Default::default()
            },
            atrous: atrous::Params {
                iterations: 3,
                radius: 1,
                sigma_luminance: 3.0,
                ..Default::default()
            },
            gradient: true,
            choice: Some(choice::Params::default()),
            innovation: Some(innovation::Params::default()),
            reflections: vec![0.5, 2.0],
            antialias: Some(taa::Params::DENOISED),
            ..Self::textbook()
        }
    }
}

impl Params {
    /// Accumulation, variance and filter alone.
    pub fn textbook() -> Self {
        Self {
            surface: surface::Params::default(),
            accumulate: accumulate::Params::default(),
            variance: variance::Params::default(),
            atrous: atrous::Params::default(),
            feedback: false,
            same_albedo: false,
            by_confidence: false,
            gradient: false,
            fireflies: None,
            choice: None,
            innovation: None,
            reflections: vec![],
            antialias: None,
            half_res: None,
        }
    }

    /// The same guide serves the variance and the filter.
    pub fn with_sigmas(mut self, sigmas: Sigmas) -> Self {
        self.variance.sigmas = sigmas;
        self.atrous.sigmas = sigmas;
        self
    }

    /// Pixels from the farthest tap to the centre.
    fn reach(&self) -> usize {
        let lent = self.half_res.map_or(0, |half_res| half_res.window.radius);
        let spread = self.fireflies.map_or(0, |fireflies| fireflies.radius);
        let filter = atrous::Params {
            iterations: self.passes(),
            ..self.atrous
        };
        let filtered = filter.reach().max(self.variance.radius);
        filtered.max(lent).max(spread)
    }

    /// Passes of the filter that are run.
    fn passes(&self) -> u32 {
        let usual = self.atrous.iterations;
        match self.choice {
            Some(_) => (usual + 1).min(atrous::Params::MOST),
            None => usual,
        }
    }

    /// Whether a run of pixels can be fetched and merged without a look at the rest of the image in between.
    fn merges_at_once(&self) -> bool {
        let looks_around = self.gradient || self.fireflies.is_some() || self.half_res.is_some();
        !looks_around && self.reflections.is_empty()
    }

    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        self.surface.check()?;
        self.accumulate.check()?;
        self.variance.check()?;
        self.atrous.check()?;
        self.choice.iter().try_for_each(choice::Params::check)?;
        self.innovation
            .iter()
            .try_for_each(innovation::Params::check)?;
        self.fireflies
            .iter()
            .try_for_each(fireflies::Params::check)?;
        self.antialias.iter().try_for_each(taa::Params::check)?;
        self.half_res.iter().try_for_each(half_res::Params::check)?;
        for &distance in &self.reflections {
            in_range("reflections", distance, "distances above 0", |v| v > 0.0)?;
        }
        Ok(())
    }
}

const BILINEAR: reproject::Params = reproject::Params {
    filter: Filter::Bilinear,
    fallback: true,
    dering: true,
};

/// What one frame leaves to the next; in records, as all that is fetched in several channels.
pub(super) struct Memory {
    /// Beginning with the channels of [`accumulate`].
    history: Records,
    /// What the next frame's replay is compared with, where one is expected.
    shown: Option<replay::Before>,
    reflections: Option<reflections::Memory>,
    /// What was seen to be wrong and is not yet corrected.
    pub evidence: Option<Records>,
    choice: Option<passes::Chose>,
    surface: SurfaceRecords,
    pub camera: Option<Camera>,
    demodulated: bool,
}

impl Memory {
    /// Of a frame that has become this history; without reflections. Its colour is kept where the next frame's replay is
    /// wanted and to be expected: after a first frame, and after a frame with a replay.
    pub fn new(frame: &Frame, history: Records, params: &Params, first: bool) -> Self {
        let keeps_color = params.gradient && (first || frame.replay.is_some());
        let compared = Surface {
            color: frame.surface.color.filter(|_| params.same_albedo),
            ..frame.surface
        };
        Self {
            history,
            shown: keeps_color.then(|| replay::Before::of(frame)),
            reflections: None,
            evidence: None,
            choice: None,
            surface: SurfaceRecords::of(&compared),
            camera: frame.camera,
            demodulated: frame.albedo.is_some(),
        }
    }

    pub fn expects_replay(&self) -> bool {
        self.shown.is_some()
    }

    /// What tells whether a pixel shows what one of this frame's does.
    fn tests<'a>(&'a self, frame: &Frame<'a>, motion: &Motion, params: &Params) -> Tests<'a> {
        let camera = self.camera.as_ref().filter(|_| motion.tells_depth());
        let rays = camera.map(Camera::rays);
        Tests::new(frame.surface, self.surface.surface(), rays, &params.surface)
    }
}

/// What the memory knows of the current frame's pixels.
pub(super) struct Recalled {
    /// Beginning with the channels of [`accumulate`].
    pub history: Image,
    /// The new light without fireflies, where they are suppressed.
    pub held: Option<Image>,
    pub gradient: Option<Image>,
    pub reflections: Option<reflections::Won>,
}

impl Recalled {
    /// What a first frame knows.
    pub fn nothing(
        size: Size,
        channels: usize,
        hold: impl FnOnce(Option<Pixels>) -> Option<Image>,
        output: &mut Output,
    ) -> Self {
        output.confidence.fill(0.0);
        output.rejection.fill(0);
        Self {
            history: Image::new(size, channels),
            held: hold(None),
            gradient: None,
            reflections: None,
        }
    }
}

/// Spatiotemporal variance-guided filtering.
pub struct Svgf {
    params: Params,
    upkeep: Upkeep,
    memory: Option<Memory>,
    antialias: Option<Stage>,
}

impl Svgf {
    /// A pipeline without history; an error if a parameter is out of range.
    pub fn new(params: Params) -> Result<Self> {
        params.check()?;
        Ok(Self {
            antialias: params.antialias.map(Stage::new),
            params,
            upkeep: Upkeep::default(),
            memory: None,
        })
    }
}

impl Pipeline for Svgf {
    fn extras(&self) -> Extras {
        Extras {
            variance: true,
            choice: self.params.choice.is_some(),
        }
    }
}

impl Steps for Svgf {
    fn upkeep(&mut self) -> &mut Upkeep {
        &mut self.upkeep
    }

    fn forget(&mut self) {
        self.memory = None;
        self.antialias.iter_mut().for_each(Stage::reset);
    }

    fn next(&mut self, frame: &Frame, mut output: Output) -> Result<Summary> {
        if let Some(memory) = &self.memory {
            check_continues(memory, frame)?;
        }
        let size = frame.color.size;
        let params = &self.params;
        let passes = params.passes();
        let mut used = vec![];

        let texture = frame.albedo.map(|albedo| Texture {
            albedo,
            emission: frame.emission,
        });
        let mut memory = self.memory.take();
        let evidence = memory.as_mut().and_then(|memory| memory.evidence.take());
        let chose = memory.as_mut().and_then(|memory| memory.choice.take());
        let continues = memory.is_some();
        let replays = frame.replay.is_some() && memory.as_ref().is_some_and(Memory::expects_replay);
        let before = memory.as_ref().and_then(|memory| memory.camera.as_ref());
        let motion = frame.motion(before, &mut used);
        let rays = frame.camera.as_ref().map(Camera::rays);
        let new_guide = || Guide::new(size, params.reach(), frame.surface, rays);
        let light = Light {
            params,
            frame,
            texture,
            motion: &motion,
        };
        let Merged {
            mut history,
            missing,
            sample,
            guide,
            reflections,
        } = match params.merges_at_once() {
            true => light.merge_at_once(memory, &mut output),
            false => light.merge_in_steps(memory, &mut output, new_guide),
        };

        let guide = guide.unwrap_or_else(new_guide);
        let mut filtered = Filtered::new(guide.layout);
        let [color, moments, length] = [0..3, 3..5, 5..6].map(|part| history.pixels().part(part));
        let begin = Begin {
            color,
            variance: Estimate::new(moments, length, &guide, params.variance),
        };
        rows::run_lanes(&begin, size.height, filtered.bands());

        let usual = params.atrous.iterations;
        let estimates = params.choice.is_some() || params.innovation.is_some();
        let bright = if estimates { exposure(color) } else { 0.0 };
        let mut choosing = params.choice.zip(output.choice).map(|(params, levels)| {
            let moved = reflections.as_ref().and_then(|won| won.motion.as_ref());
            let look = Look {
                fresh: Sampled::of(frame, texture, sample.as_ref()),
                motion: moved.map_or(motion.pixels(), Image::pixels),
                coverage: View::new(size, 1, output.confidence),
                exposure: bright,
                usual: usual as usize,
            };
            Choosing::new(chose, look, params, &filtered, levels)
        });
        let mut light = None;
        for pass in 0..=passes {
            if pass > 0 {
                filtered.filter(&guide, params.atrous, pass - 1);
            }
            if let Some(choosing) = &mut choosing {
                choosing.see(pass, &filtered);
            }
            if params.feedback && pass == usual.min(1) {
                let records = history.data_mut();
                let out = records.chunks_mut(BAND * size.width * accumulate::CHANNELS);
                rows::run(&FeedBack(&filtered), size.height, out);
            }
            if !params.reflections.is_empty() && pass == usual.min(2) {
                let mut records = Records::blank(size, 3);
                let out = PixelsMut::bands(size, 3, records.data_mut());
                rows::run(&Keep(&filtered), size.height, out);
                light = Some(records);
            }
        }

        let result = match &choosing {
            Some(choosing) => Smooth::Chosen(&choosing.shown),
            None => Smooth::Filtered(&filtered),
        };
        let (innovation, evidence) = params
            .innovation
            .filter(|_| continues)
            .map(|params| {
                let fresh = Sampled::of(frame, texture, sample.as_ref());
                let length = View::new(size, 1, &*output.history_length).into();
                let evidence = evidence.as_ref();
                innovate(params, &fresh, &result, length, &motion, bright, evidence)
            })
            .unzip();
        let finish = Finish {
            light: result,
            texture,
            innovation: innovation.as_ref(),
            last: self.antialias.is_none(),
        };
        let variances = bands_of(output.variance.expect("an estimate has room"), size);
        let band = BAND * size.width;
        let mut lights = light
            .as_mut()
            .map(|light| light.data_mut().chunks_mut(band * 3));
        let write = |colors: &mut dyn Iterator<Item = PixelsMut>| {
            let histories = history.data_mut().chunks_mut(band * accumulate::CHANNELS);
            let outs = colors.zip(variances).zip(histories);
            let outs = outs.map(|((color, variance), history)| Outs {
                color,
                variance,
                history,
                light: lights.as_mut().and_then(Iterator::next),
            });
            rows::run(&finish, size.height, outs);
        };
        used.extend(list_used(frame, &guide));
        match &mut self.antialias {
            Some(stage) => {
                let mut color = Image::blank(size, 3);
                write(&mut color.bands().map(PixelsMut::Planar));
                drop((filtered, guide));
                stage.step(
                    color.pixels(),
                    motion.pixels(),
                    frame.surface.depth.map(Pixels::plane),
                    PixelsMut::bands(size, 3, output.color),
                    None,
                );
            }
            None => {
                write(&mut PixelsMut::bands(size, 3, output.color));
                drop((filtered, guide));
            }
        }

        let reflected = reflections.is_some();
        used.extend(
            [
                (
                    "object_normal",
                    continues && frame.surface.object_normal.is_some(),
                ),
                ("replay", replays),
                ("hit_distance", reflected && frame.hit_distance.is_some()),
            ]
            .into_iter()
            .filter_map(|(name, used)| used.then_some(name)),
        );
        self.memory = Some(Memory {
            reflections: light.map(|light| reflections::Memory {
                light,
                scores: reflections.map_or_else(
                    || reflections::Scores::new(size, params.reflections.len()),
                    |won| won.scores,
                ),
            }),
            evidence,
            choice: choosing.map(|choosing| choosing.chose),
            ..Memory::new(frame, history, params, !continues)
        });
        Ok(Summary { used, missing })
    }
}

/// The light of a colour, as it was sampled.
pub(super) fn illumination(color: Pixels, texture: Option<Texture>) -> Image {
    let Some(texture) = texture else {
        return color.to_planes();
    };
    modulated(color, texture, Way::Off)
}

fn modulated(image: Pixels, texture: Texture, way: Way) -> Image {
    let mut result = Image::blank(image.size, 3);
    modulate(image, texture, way, result.bands().map(PixelsMut::Planar));
    result
}

/// Light without fireflies: these are held down and spread in what is seen, with its texture but without emission. The guide
/// is for taps up to their radius.
pub(super) fn without_fireflies(
    light: &Image,
    known: Option<Pixels>,
    texture: Option<Texture>,
    guide: &Guide,
    params: fireflies::Params,
) -> Image {
    let suppress = |seen: Pixels, expected: Option<Pixels>| {
        let mut held = Image::blank(seen.size, 3);
        let bands = held.bands().map(PixelsMut::Planar);
        suppress_fireflies(seen, expected, guide, params, bands);
        held
    };
    let Some(texture) = texture else {
        return suppress(light.pixels(), known);
    };
    let texture = Texture {
        emission: None,
        ..texture
    };
    let seen = modulated(light.pixels(), texture, Way::Back);
    let expected = known.map(|known| modulated(known, texture, Way::Back));
    let held = suppress(seen.pixels(), expected.as_ref().map(Image::pixels));
    modulated(held.pixels(), texture, Way::Off)
}

/// What a frame's light makes of the memory.
struct Merged {
    history: Records,
    missing: usize,
    /// The light as it was sampled, where there is an image of it.
    sample: Option<Image>,
    /// If it was needed already.
    guide: Option<Guide>,
    reflections: Option<reflections::Won>,
}

/// A frame's light, still with its texture.
struct Light<'a> {
    params: &'a Params,
    frame: &'a Frame<'a>,
    texture: Option<Texture<'a>>,
    motion: &'a Motion<'a>,
}

impl Light<'_> {
    /// Writes the output but for its colour and variance.
    fn merge_in_steps(
        self,
        mut memory: Option<Memory>,
        output: &mut Output,
        new_guide: impl Fn() -> Guide,
    ) -> Merged {
        let Self {
            params,
            frame,
            texture,
            motion,
        } = self;
        let size = frame.color.size;
        let sample = illumination(frame.color, texture);
        let guide = (params.fireflies.is_some() || params.half_res.is_some()).then(new_guide);
        let hold = |known: Option<Pixels>| {
            let (fireflies, guide) = params.fireflies.zip(guide.as_ref())?;
            Some(without_fireflies(&sample, known, texture, guide, fireflies))
        };
        let Recalled {
            history: known,
            held,
            gradient,
            reflections,
        } = match &mut memory {
            Some(memory) => recall(params, memory, frame, motion, &sample, hold, output),
            None => Recalled::nothing(size, accumulate::CHANNELS, hold, output),
        };
        drop(memory);
        let color = held.as_ref().unwrap_or(&sample);
        let filled = (params.half_res.zip(guide.as_ref()))
            .map(|(half_res, guide)| half_res.fill(color, known.channels(5..6), guide));
        let (color, lent) = match &filled {
            Some((color, lent)) => (color, Some(lent)),
            None => (color, None),
        };
        let before = [0..3, 3..5, 5..6].map(|channels| known.pixels().part(channels));
        let mut history = Records::blank(size, accumulate::CHANNELS);
        let merged = PixelsMut::bands(size, accumulate::CHANNELS, history.data_mut())
            .zip(PixelsMut::planar(size, output.history_length))
            .map(|(all, length)| [(0..6, all), (5..6, length)]);
        let missing = accumulate(
            color.pixels(),
            lent.map(|lent| lent.weight.view()),
            before,
            gradient.as_ref().map(Image::view),
            (params.by_confidence).then(|| View::new(size, 1, output.confidence)),
            params.accumulate,
            merged,
        );
        Merged {
            history,
            missing: lent.map_or(missing, |lent| lent.missing),
            sample: Some(sample),
            guide,
            reflections,
        }
    }

    /// The same without images of what lies between.
    fn merge_at_once(self, memory: Option<Memory>, output: &mut Output) -> Merged {
        let Self {
            params,
            frame,
            texture,
            motion,
        } = self;
        let size = frame.color.size;
        let fetch = memory.as_ref().map(|memory| {
            let tests = memory.tests(frame, motion, params);
            Fetch::new(&[memory.history.pixels()], size, tests, BILINEAR)
        });
        let kernel = Merge {
            color: frame.color,
            texture,
            motion: motion.pixels(),
            fetch,
            params: params.accumulate,
            by_confidence: params.by_confidence,
        };
        let mut history = Records::blank(size, accumulate::CHANNELS);
        let mut missing = vec![0; rows::bands(size.height).count()];
        let outs = PixelsMut::bands(size, accumulate::CHANNELS, history.data_mut())
            .zip(bands_of(output.history_length, size))
            .zip(bands_of(output.confidence, size))
            .zip(bands_of(output.rejection, size))
            .zip(&mut missing)
            .map(
                |((((history, length), confidence), rejection), missing)| MergedBand {
                    history,
                    length,
                    confidence,
                    rejection,
                    missing,
                },
            );
        rows::run(&kernel, size.height, outs);
        Merged {
            history,
            missing: missing.iter().sum(),
            sample: None,
            guide: None,
            reflections: None,
        }
    }
}

struct Merge<'a> {
    color: Pixels<'a>,
    texture: Option<Texture<'a>>,
    motion: Pixels<'a>,
    /// None for a first frame.
    fetch: Option<Fetch<'a>>,
    params: accumulate::Params,
    by_confidence: bool,
}

struct MergedBand<'a> {
    history: PixelsMut<'a>,
    length: BandMut<'a>,
    confidence: BandMut<'a>,
    rejection: BandMut<'a, u8>,
    missing: &'a mut usize,
}

impl<'a> Kernel for Merge<'a> {
    type Out = MergedBand<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: MergedBand<'a>) {
        let mut lanes = MotionLanes::zeroed();
        let mut fetched = self.fetch.as_ref().map(Fetch::room);
        let mut color = [[0.0; SEGMENT]; 3];
        let mut history = [[0.0; SEGMENT]; accumulate::CHANNELS];
        let (whole, unchanged, unknown) = ([1.0; SEGMENT], [0.0; SEGMENT], [0.0; SEGMENT]);
        for run in rows.flat_map(|y| segments(y, self.color.size.width)) {
            self.color
                .read(run, color.each_mut().map(Row::as_mut_slice));
            if let Some(texture) = &self.texture {
                texture.modulate(Way::Off, run, &mut color);
            }
            *out.missing += count_missing(color.each_ref().map(|row| &row[..run.len]));
            match self.fetch.as_ref().zip(fetched.as_mut()) {
                Some((fetch, fetched)) => {
                    fetch.run(run, lanes.load(&self.motion, run), fetched);
                    let records = &fetched.values(0)[..run.len * accumulate::CHANNELS];
                    deinterleave(records, history.iter_mut().map(|row| &mut row[..run.len]));
                    out.confidence.put(run, &fetched.coverage[..run.len], 1);
                    out.rejection.put(run, &fetched.rejection[..run.len], 1);
                }
                None => {
                    history = [unknown; accumulate::CHANNELS];
                    out.confidence.put(run, &unknown[..run.len], 1);
                    out.rejection.put(run, &[0; SEGMENT][..run.len], 1);
                }
            }
            let confidence = (fetched.as_ref()).filter(|_| self.by_confidence);
            let confidence = confidence.map_or(&whole, |fetched| &fetched.coverage);
            let how = [&whole, &unchanged, confidence];
            self.params.merge(&color, how, &mut history);
            let rows = history.each_ref().map(Row::as_slice);
            out.history.write(run, rows);
            out.length.put(run, &rows[5][..run.len], 1);
        }
    }
}

/// Estimates the variance of an accumulated image, and makes it ready for the filter.
struct Begin<'a> {
    color: Pixels<'a>,
    variance: Estimate<'a>,
}

impl<'a> LanesKernel for Begin<'a> {
    type Out = BorderedBand<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, simd: S, rows: Range<usize>, mut out: BorderedBand<'a>) {
        let mut around = self.variance.around();
        for y in rows.clone() {
            let (first, variance) = (y == rows.start, atrous::variance_of(&mut out, y));
            self.variance.row(simd, y, first, &mut around, variance);
            atrous::settle(self.color, y, &mut out);
        }
    }
}

/// Puts the colour after the passes so far into records of history.
struct FeedBack<'a>(&'a Filtered);

impl<'a> Kernel for FeedBack<'a> {
    type Out = &'a mut [f32];

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, records: &'a mut [f32]) {
        let (top, width) = (rows.start, self.0.size().width);
        let mut color = [[0.0; SEGMENT]; 3];
        let records = records.as_chunks_mut::<{ accumulate::CHANNELS }>().0;
        for run in rows.flat_map(|y| segments(y, width)) {
            self.0.colors(run, &mut color);
            let records = &mut records[(run.y - top) * width + run.x..][..run.len];
            for (i, record) in records.iter_mut().enumerate() {
                (record[0], record[1], record[2]) = (color[0][i], color[1][i], color[2][i]);
            }
        }
    }
}

/// The colour after the passes so far.
struct Keep<'a>(&'a Filtered);

impl<'a> Kernel for Keep<'a> {
    type Out = PixelsMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: PixelsMut<'a>) {
        let mut color = [[0.0; SEGMENT]; 3];
        for run in rows.flat_map(|y| segments(y, self.0.size().width)) {
            self.0.colors(run, &mut color);
            out.write(run, color.each_ref().map(Row::as_slice));
        }
    }
}

/// What a frame's samples show to be wrong with its light as it is predicted, and the evidence for the next frame.
pub(super) fn innovate(
    params: innovation::Params,
    fresh: &Sampled,
    prediction: &impl Colors,
    length: Pixels,
    motion: &Motion,
    exposure: f32,
    evidence: Option<&Records>,
) -> (Innovation, Records) {
    let known = evidence.map(|evidence| innovation::Known {
        evidence: evidence.pixels(),
        motion: Some(motion.pixels()),
    });
    innovation(fresh, prediction, length, known, exposure, params)
}

/// Light as it was sampled.
pub struct Sampled<'a> {
    color: Pixels<'a>,
    texture: Option<Texture<'a>>,
}

impl<'a> Sampled<'a> {
    /// Of a frame, or as it lies there already.
    pub fn of(frame: &Frame<'a>, texture: Option<Texture<'a>>, light: Option<&'a Image>) -> Self {
        match light {
            Some(light) => Self {
                color: light.pixels(),
                texture: None,
            },
            None => Self {
                color: frame.color,
                texture,
            },
        }
    }
}

impl Colors for Sampled<'_> {
    #[inline(always)]
    fn colors(&self, run: Run, into: &mut [Row; 3]) {
        self.color.colors(run, into);
        if let Some(texture) = &self.texture {
            texture.modulate(Way::Off, run, into);
        }
    }
}

/// Corrects the filtered light, puts its texture back, and writes what is known of it. History is corrected as well.
struct Finish<'a> {
    light: Smooth<'a>,
    texture: Option<Texture<'a>>,
    innovation: Option<&'a Innovation>,
    /// Whether what nobody has seen, nor a neighbour, is to be black.
    last: bool,
}

struct Outs<'a> {
    color: PixelsMut<'a>,
    variance: BandMut<'a>,
    /// Records.
    history: &'a mut [f32],
    /// Records, where reflections are looked for.
    light: Option<&'a mut [f32]>,
}

impl<'a> Kernel for Finish<'a> {
    type Out = Outs<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: Outs<'a>) {
        let mut color = [[0.0; SEGMENT]; 3];
        let mut line = self.innovation.map(Innovation::line);
        let (top, width) = (rows.start, self.light.size().width);
        for y in rows {
            out.variance
                .row(0, y)
                .copy_from_slice(self.light.variance(y));
            if let Some((innovation, line)) = self.innovation.zip(line.as_mut()) {
                innovation.go_to(y, line);
            }
            for run in segments(y, width) {
                self.light.colors(run, &mut color);
                let found = match (self.innovation, &line) {
                    (Some(innovation), Some(line)) => innovation.correction(line, run, &color),
                    _ => None,
                };
                if let Some(found) = found {
                    for (color, found) in color.iter_mut().zip(&found) {
                        for (color, &found) in color.iter_mut().zip(found) {
                            *color = corrected(*color, found);
                        }
                    }
                    let first = (y - top) * width + run.x;
                    let pixels = |channels: usize| first * channels..(first + run.len) * channels;
                    let history = &mut out.history[pixels(accumulate::CHANNELS)];
                    let history = history.as_chunks_mut::<{ accumulate::CHANNELS }>().0;
                    for (i, history) in history.iter_mut().enumerate() {
                        correct_history([found[0][i], found[1][i], found[2][i]], history);
                    }
                    if let Some(light) = &mut out.light {
                        let light = light[pixels(3)].as_chunks_mut::<3>().0;
                        for (i, light) in light.iter_mut().enumerate() {
                            correct_light([found[0][i], found[1][i], found[2][i]], light);
                        }
                    }
                }
                if let Some(texture) = &self.texture {
                    texture.modulate(Way::Back, run, &mut color);
                }
                if self.last {
                    color.iter_mut().for_each(|row| blacken_missing(row));
                }
                out.color.write(run, color.each_ref().map(Row::as_slice));
            }
        }
    }
}

/// A pixel's colour; the moments move with it, and their variance stays.
#[inline(always)]
pub(super) fn correct_history(found: [f32; 3], history: &mut [f32]) {
    let before = [history[0], history[1], history[2]];
    correct_light(found, history);
    let [r, g, b] = before;
    let moved = luminance(history[0] - r, history[1] - g, history[2] - b);
    let first = history[3];
    history[3] += moved;
    history[4] += moved * (first + first + moved);
}

#[inline(always)]
pub(super) fn correct_light(found: [f32; 3], light: &mut [f32]) {
    for (light, found) in light.iter_mut().zip(found) {
        *light = corrected(*light, found);
    }
}

/// The light of the new frame comes as it was sampled; `hold` makes it free of fireflies by the light that history has. A
/// replay corrects the memory first. Writes the output's confidence and rejection.
pub(super) fn recall(
    params: &Params,
    memory: &mut Memory,
    frame: &Frame,
    motion: &Motion,
    sample: &Image,
    hold: impl FnOnce(Option<Pixels>) -> Option<Image>,
    output: &mut Output,
) -> Recalled {
    let replayed = frame
        .replay
        .zip(memory.shown.as_ref())
        .map(|(replay, shown)| {
            let light = memory.reflections.as_mut().map(|known| &mut known.light);
            let corrects = params.innovation.is_some();
            replay::relight(replay, shown, &mut memory.history, light, corrects)
        });
    let tests = memory.tests(frame, motion, params);
    let motion = motion.pixels();
    let cameras = frame.camera.as_ref().zip(memory.camera.as_ref());
    let reflections = memory.reflections.as_ref().filter(|_| cameras.is_some());

    let mut planes = vec![memory.history.pixels()];
    planes.extend(replayed.as_ref().map(Image::pixels));
    let coverage = &mut *output.confidence;
    let values = reproject(&planes, motion, tests, BILINEAR, coverage, output.rejection);
    let mut values = values.into_iter();
    let mut next = || values.next().expect("an image for each that is fetched");
    let mut history = next();
    let held = hold(Some(history.pixels().part(0..3)));
    let color = held.as_ref().unwrap_or(sample);

    let gradient = params.gradient.then(|| match replayed {
        Some(_) => next(),
        None => {
            // A lamp that travels changes all of the light by less than the noise of a few pixels. Three looks find more
            // that is not there than one: hence the larger margin. Where fewer are traced, windows twice as wide have as
            // many samples.
            let passes = gradient::Params::default().passes + u32::from(params.half_res.is_some());
            let estimated = gradient::Params {
                noise: 2.2,
                passes,
                widest: passes + 2,
            };
            let known = history.pixels().part(0..3);
            let coverage = Some(View::new(motion.size, 1, coverage));
            find_gradient([color.pixels(), known], coverage, estimated)
        }
    });
    let reflections = reflections
        .zip(cameras)
        .and_then(|(reflections, (now, then))| {
            let own = Own {
                motion,
                tests,
                params: BILINEAR,
            };
            reflections::choose(
                reflections,
                memory.history.pixels(),
                &params.reflections,
                frame,
                [now, then],
                memory.surface.surface(),
                own,
                sample.view(),
                &mut history,
                coverage,
            )
        });
    Recalled {
        history,
        held,
        gradient,
        reflections,
    }
}

pub(super) fn find_gradient(
    [now, before]: [Pixels; 2],
    coverage: Option<View>,
    params: gradient::Params,
) -> Image {
    let mut gradient = Image::blank(now.size, 1);
    temporal_gradient(now, before, coverage, params, gradient.data_mut());
    gradient
}

pub(super) fn check_continues(memory: &Memory, frame: &Frame) -> Result<()> {
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
