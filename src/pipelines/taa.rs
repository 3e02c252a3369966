//! Temporal antialiasing, as a list of this library's kernels:
//!
//!   (resolve the jittered sample) → (motion from cameras) → (expose) → (temporal gradient) → (alternation)
//!     → dilate → reproject → clip → (anti-lag) → blend → (innovation)
//!
//! From dilation on all is one pass: what one kernel knows of a run of pixels, the next takes from the first-level cache.
//! The temporal gradient looks farther, alternation has a memory of its own: both are found before, with reprojections of
//! their own.
//!
//! By default colours are merged across surfaces: no test of depth, normal or id refuses history, since along an edge
//! that would refuse what antialiases it. The neighbourhood's colours decide instead. Tests can be switched on, for
//! histories that no neighbourhood tells from what is there now.

use std::ops::Range;

use super::frame::{Frame, Output, Pipeline, Steps, Summary, SurfaceRecords, Upkeep, check_size};
use crate::error::Result;
use crate::image::{Image, Pixels, Records, SEGMENT, View, segments};
use crate::kernels::camera::dilate::{Choice, Dilation, Window, dilate_motion};
use crate::kernels::camera::pinhole::Camera;
use crate::kernels::fetch::footprint::{Filter, Motion, MotionLanes, Wide};
use crate::kernels::fetch::reproject::{self, Fetch, reproject};
use crate::kernels::judge::alternation::{self, Known, alternation, hold};
use crate::kernels::judge::exposure::exposure;
use crate::kernels::judge::gradient::{self, temporal_gradient};
use crate::kernels::judge::innovation::{self, innovation};
use crate::kernels::judge::neighborhood::{self, Bounds, Response, Space};
use crate::kernels::judge::surface::{self, Surface, Tests, Threshold};
use crate::kernels::judge::{anti_lag, blend_factor};
use crate::kernels::merge::accumulate::{count_missing, load_shares, tenth_power};
use crate::kernels::merge::blend::{self, Weighting, calm, mix};
use crate::kernels::merge::resolve::{self, resolve};
use crate::math::is_present;
use crate::pixels::{PixelsMut, Row, lanes};
use crate::rows::{self, BAND, Kernel};

/// Parameters of [`Taa`].
#[derive(Clone, Copy, Debug)]
pub struct Params {
    /// Which neighbours' motion a pixel may take; its own alone if none.
    pub dilate: Option<Window>,
    /// How history is read.
    pub filter: Filter,
    /// What of the neighbourhood holds history.
    pub clip: neighborhood::Params,
    /// Weight of the new sample.
    pub blend_factor: blend_factor::Params,
    /// What else weighs the two.
    pub blend: blend::Params,
    /// How a frame with known jitter is brought to pixel centres.
    pub reconstruct: Option<resolve::Filter>,
    /// The tests that history must pass.
    pub limits: Limits,
    /// Whether changes of light, estimated, shorten history.
    pub gradient: bool,
    /// How much clipping shortens history; from 0; 0.
    pub anti_lag: f32,
    /// Whether history is not clipped where the colours of whole neighbourhoods alternate.
    pub alternation: bool,
    /// Whether what new samples say of the result corrects it, where the pipeline stands alone.
    pub innovation: Option<innovation::Params>,
}

/// The tests that history must pass; by default none.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Relative difference of depth.
    pub relative_depth: Option<Threshold>,
    /// Replaces the relative depth for frames with cameras, depths, normals and motion of 3 channels.
    pub plane_distance: Option<Threshold>,
    /// Degrees.
    pub normal_angle: Option<Threshold>,
    /// Of the albedo's luminance.
    pub relative_albedo: Option<Threshold>,
    /// Whether ids must be equal.
    pub ids: bool,
}

impl Limits {
    const NONE: Self = Self {
        relative_depth: None,
        plane_distance: None,
        normal_angle: None,
        relative_albedo: None,
        ids: false,
    };

    fn any(&self) -> bool {
        let depth = self.relative_depth.or(self.plane_distance);
        let more = self.normal_angle.or(self.relative_albedo);
        depth.or(more).is_some() || self.ids
    }

    /// Of tests that are not wanted, the threshold that all pass, or the default where they never decide alone.
    fn thresholds(&self) -> surface::Params {
        let default = surface::Params::default();
        surface::Params {
            relative_depth: self.relative_depth.unwrap_or(default.relative_depth),
            plane_distance: self.plane_distance.unwrap_or(default.plane_distance),
            normal_angle: self.normal_angle.unwrap_or(Threshold::hard(180.0)),
            relative_luminance: (self.relative_albedo).unwrap_or(default.relative_luminance),
            ..default
        }
    }

    /// The buffers that are compared, with planes or without.
    fn compared<'a>(&self, surface: Surface<'a>, planes: bool) -> Surface<'a> {
        let (depth, angle) = (self.relative_depth.is_some(), self.normal_angle.is_some());
        Surface {
            depth: surface.depth.filter(|_| planes || depth),
            normal: surface.normal.filter(|_| planes || angle),
            object_normal: surface.object_normal.filter(|_| angle),
            ids: surface.ids.filter(|_| self.ids),
            color: surface.color.filter(|_| self.relative_albedo.is_some()),
        }
    }
}

/// A jump of the light that aliasing does not explain; several looks find more that is not there than one.
const GRADIENT: gradient::Params = gradient::Params {
    noise: 2.2,
    passes: 3,
    widest: 5,
};

/// The preset "best".
impl Default for Params {
    fn default() -> Self {
        Self::BEST
    }
}

impl Params {
    /// Names of presets.
    pub const PRESETS: [(&str, Self); 5] = [
        ("best", Self::BEST),
        ("denoised", Self::DENOISED),
        ("textbook", Self::TEXTBOOK),
        ("karis", Self::KARIS),
        ("filament", Self::FILAMENT),
    ];

    /// Names of windows for `dilate`.
    pub const DILATIONS: [(&str, Option<Window>); 3] = [
        ("3x3", Some(Window::Square)),
        ("cross", Some(Window::Cross)),
        ("none", None),
    ];

    /// The core equation: the range of the neighbourhood, a twentieth of the new sample.
    pub const TEXTBOOK: Self = Self {
        dilate: None,
        filter: Filter::Bilinear,
        clip: neighborhood::Params {
            bounds: Bounds::MinMax,
            gamma: 1.0,
            radius: 1,
            space: Space::Rgb,
            response: Response::Clamp,
            exposure: 1.0,
        },
        blend_factor: blend_factor::Params {
            alpha: 0.05,
            fast_alpha: 0.05,
            speed: Threshold {
                full: 2.0,
                none: 16.0,
            },
        },
        blend: blend::Params {
            weighting: Weighting::None,
            flicker: 1.0,
            exposure: 1.0,
        },
        reconstruct: None,
        limits: Limits::NONE,
        gradient: false,
        anti_lag: 0.0,
        alternation: false,
        innovation: None,
    };

    /// After Karis 2014, *High Quality Temporal Supersampling*; how far flicker lessens the share is our choice.
    pub const KARIS: Self = Self {
        dilate: Some(Window::Cross),
        clip: neighborhood::Params {
            bounds: Bounds::Rounded,
            space: Space::YCoCg,
            response: Response::Center,
            ..Self::TEXTBOOK.clip
        },
        blend: blend::Params {
            weighting: Weighting::Tone,
            flicker: 0.2,
            ..Self::TEXTBOOK.blend
        },
        reconstruct: Some(resolve::Filter::BlackmanHarris),
        ..Self::TEXTBOOK
    };

    /// After Filament's temporal antialiasing: filter, box, response, weights and share.
    pub const FILAMENT: Self = Self {
        dilate: Some(Window::Square),
        filter: Filter::Wide(Wide::CatmullRom5),
        clip: neighborhood::Params {
            bounds: Bounds::Intersection,
            space: Space::YCoCg,
            response: Response::Current,
            ..Self::TEXTBOOK.clip
        },
        blend_factor: blend_factor::Params {
            alpha: 0.12,
            fast_alpha: 0.12,
            ..Self::TEXTBOOK.blend_factor
        },
        blend: blend::Params {
            weighting: Weighting::Tone,
            ..Self::TEXTBOOK.blend
        },
        reconstruct: Some(resolve::Filter::BlackmanHarris),
        ..Self::TEXTBOOK
    };

    /// What our own measurements choose for frames without noise.
    pub const BEST: Self = Self {
        dilate: Some(Window::Square),
        filter: Filter::Wide(Wide::CatmullRom),
        clip: neighborhood::Params {
            bounds: Bounds::Variance,
            space: Space::ToneMappedYCoCg,
            ..Self::TEXTBOOK.clip
        },
        // What stands still may be averaged for longer than what is resampled every time.
        blend_factor: blend_factor::Params {
            alpha: 0.05,
            fast_alpha: 0.25,
            speed: Threshold {
                full: 0.0,
                none: 1.0,
            },
        },
        reconstruct: Some(resolve::Filter::BlackmanHarris),
        ..Self::TEXTBOOK
    };

    /// The same for frames that a denoiser has smoothed, whose history is the worse for what was wrong in each of them.
    pub const DENOISED: Self = Self {
        clip: neighborhood::Params {
            gamma: 0.75,
            response: Response::Center,
            ..Self::BEST.clip
        },
        blend_factor: blend_factor::Params {
            alpha: 0.1,
            fast_alpha: 0.3,
            ..Self::BEST.blend_factor
        },
        ..Self::BEST
    };

    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        self.clip.check()?;
        self.innovation
            .iter()
            .try_for_each(innovation::Params::check)?;
        self.limits.thresholds().check()?;
        anti_lag::check("anti_lag", self.anti_lag)?;
        self.blend_factor.check()?;
        self.blend.check()
    }

    /// Whether there are tone curves.
    fn is_exposed(&self) -> bool {
        let blends = self.blend.weighting != Weighting::None;
        self.clip.space.is_tone_mapped() || blends || self.alternation
    }
}

/// Channels of a history image: colour 0 to 2, length 3.
const CHANNELS: usize = 4;

/// How history is judged: the tests that it must pass; and to be written, its length, its coverage and the tests that it
/// failed.
pub(crate) struct Details<'a> {
    pub tests: Tests<'a>,
    pub history_length: &'a mut [f32],
    pub confidence: &'a mut [f32],
    pub rejection: &'a mut [u8],
}

impl<'a> Details<'a> {
    /// Band by band.
    fn bands(self, width: usize) -> impl Iterator<Item = Details<'a>> {
        let Self {
            tests,
            history_length,
            confidence,
            rejection,
        } = self;
        let band = BAND * width;
        (history_length.chunks_mut(band))
            .zip(confidence.chunks_mut(band))
            .zip(rejection.chunks_mut(band))
            .map(move |((history_length, confidence), rejection)| Details {
                tests,
                history_length,
                confidence,
                rejection,
            })
    }
}

/// Merges colours into the history of those before.
pub(crate) struct Stage {
    params: Params,
    /// Of the last frame.
    history: Option<Records>,
    /// What its neighbourhoods were, where that is asked for.
    alternation: Option<Records>,
}

impl Stage {
    pub fn new(params: Params) -> Self {
        Self {
            params,
            history: None,
            alternation: None,
        }
    }

    /// Forgets the sequence.
    pub fn reset(&mut self) {
        self.history = None;
        self.alternation = None;
    }

    /// Merges the next colour, whose history came along `motion`; what is nowhere known becomes black. Returns how many
    /// pixels of the colour are missing.
    pub fn step<'a>(
        &mut self,
        color: Pixels<'a>,
        motion: Pixels<'a>,
        depth: Option<View<'a>>,
        merged: impl Iterator<Item = PixelsMut<'a>>,
        details: Option<Details<'a>>,
    ) -> usize {
        let (params, size) = (&self.params, color.size);
        let mut next = Records::blank(size, CHANNELS);
        let tests = match &details {
            Some(details) => details.tests,
            None => Tests::none(),
        };
        let choice = depth.map_or(Choice::Longest, Choice::Nearest);
        let fetching = reproject::Params {
            filter: params.filter,
            fallback: false,
            dering: true,
        };
        let fetch = (self.history.as_ref())
            .map(|history| Fetch::new(&[history.pixels()], size, tests, fetching));
        let looks_back = self.history.is_some() && (params.gradient || params.alternation);
        let dilated = params.dilate.filter(|_| looks_back).map(|window| {
            let mut dilated = Image::blank(size, motion.channels);
            let out = dilated.bands().map(PixelsMut::Planar);
            dilate_motion(motion, choice, window, out);
            dilated
        });
        let moved = dilated.as_ref().map_or(motion, Image::pixels);
        let recall = |records: &Records, params| {
            let (mut coverage, mut rejection) = (Image::blank(size, 1), vec![0; size.pixels()]);
            let (covered, rejected) = (coverage.data_mut(), &mut rejection);
            let values = reproject(&[records.pixels()], moved, tests, params, covered, rejected);
            (values, coverage)
        };
        let gradient = self.history.as_ref().filter(|_| params.gradient);
        let gradient = gradient.map(|history| {
            let (history, coverage) = recall(history, fetching);
            let mut gradient = Image::blank(size, 1);
            let (before, known) = (history[0].pixels().part(0..3), Some(coverage.view()));
            temporal_gradient(color, before, known, GRADIENT, gradient.data_mut());
            gradient
        });
        // Tone curves are for images that are exposed as photographs are.
        let exposure = if params.is_exposed() {
            exposure(color)
        } else {
            1.0
        };
        let alternates = params.alternation.then(|| {
            let bilinear = reproject::Params {
                filter: Filter::Bilinear,
                ..fetching
            };
            let known = (self.alternation.as_ref()).map(|memory| recall(memory, bilinear));
            let known = known.as_ref().map(|(memory, coverage)| Known {
                memory: memory[0].pixels(),
                coverage: Some(coverage.view()),
            });
            let mut memory = Records::blank(size, alternation::CHANNELS);
            let out = PixelsMut::bands(size, alternation::CHANNELS, memory.data_mut());
            alternation(color, known, exposure, out);
            memory
        });
        let kernel = Antialias {
            params: Params {
                clip: neighborhood::Params {
                    exposure,
                    ..params.clip
                },
                blend: blend::Params {
                    exposure,
                    ..params.blend
                },
                ..*params
            },
            color,
            motion,
            choice,
            fetch,
            gradient: gradient.as_ref().map(Image::view),
            alternates: (alternates.as_ref()).map(|memory| {
                memory
                    .pixels()
                    .part(alternation::CHANNELS - 1..alternation::CHANNELS)
            }),
        };
        let mut missing = vec![0; size.height.div_ceil(BAND)];
        let mut details = details.map(|details| details.bands(size.width));
        let outs = PixelsMut::bands(size, CHANNELS, next.data_mut())
            .zip(merged)
            .zip(&mut missing)
            .map(|((history, merged), missing)| Outs {
                history,
                merged,
                missing,
                details: details.as_mut().and_then(Iterator::next),
            });
        rows::run_far(&kernel, size.height, params.clip.radius as usize, outs);
        self.history = Some(next);
        self.alternation = alternates;
        missing.iter().sum()
    }
}

struct Antialias<'a> {
    params: Params,
    color: Pixels<'a>,
    motion: Pixels<'a>,
    choice: Choice<'a>,
    /// None for a first frame.
    fetch: Option<Fetch<'a>>,
    gradient: Option<View<'a>>,
    /// How often the colours of neighbourhoods have returned.
    alternates: Option<Pixels<'a>>,
}

struct Outs<'a> {
    history: PixelsMut<'a>,
    merged: PixelsMut<'a>,
    missing: &'a mut usize,
    details: Option<Details<'a>>,
}

impl<'a> Kernel for Antialias<'a> {
    type Out = Vec<Outs<'a>>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut outs: Self::Out) {
        let Params {
            clip,
            blend,
            blend_factor,
            anti_lag: strength,
            ..
        } = self.params;
        let size = self.color.size;
        let longest = 1.0 / blend_factor.alpha;
        let mut window = neighborhood::Window::new(size.width, clip);
        let window_of = self.params.dilate.filter(|_| self.fetch.is_some());
        let mut dilation = window_of.map(|window| Dilation::new(self.motion, self.choice, window));
        let mut fetched = self.fetch.as_ref().map(Fetch::room);
        let mut own_motion = MotionLanes::zeroed();
        let mut dilated = [[0.0; SEGMENT]; 3];
        let mut history = [[0.0; SEGMENT]; 3];
        let mut merged = [[0.0; SEGMENT]; 3];
        let (mut length, mut coverage) = ([0.0; SEGMENT], [0.0; SEGMENT]);
        let [mut shares, mut changes, mut holds] = [[0.0; SEGMENT]; 3];
        for y in rows.clone() {
            window.roll(self.color, y, y == rows.start);
            if let Some(dilation) = &mut dilation {
                dilation.roll(y, y == rows.start);
            }
            let (band, below) = ((y - rows.start) / BAND, (y - rows.start) % BAND);
            let out = &mut outs[band];
            for run in segments(y, size.width) {
                let n = run.len;
                let motion = own_motion.load(&self.motion, run);
                if let Some((fetch, fetched)) = self.fetch.as_ref().zip(fetched.as_mut()) {
                    let from = match &dilation {
                        Some(dilation) => {
                            dilation.choose(run, &mut dilated);
                            let [x, y, depth] = dilated.each_ref().map(|row| &row[..n]);
                            Motion {
                                x,
                                y,
                                depth: motion.depth.map(|_| depth),
                            }
                        }
                        None => motion,
                    };
                    fetch.run(run, from, fetched);
                    let records = fetched.values(0)[..n * CHANNELS].as_chunks::<CHANNELS>().0;
                    let [r, g, b] = history.each_mut();
                    for (i, record) in records.iter().enumerate() {
                        [r[i], g[i], b[i], length[i]] = *record;
                    }
                    coverage = fetched.coverage;
                } else {
                    history = [[0.0; SEGMENT]; 3];
                    length = [0.0; SEGMENT];
                }
                let unclipped = history;
                window.clip(run, &mut history);
                if let Some(alternates) = &self.alternates {
                    alternates.load(run, 0, &mut holds[..n]);
                    holds.iter_mut().for_each(|count| *count = hold(*count));
                    let (clipped, before) = (history, unclipped.each_ref().map(Row::as_slice));
                    mix(before, &clipped, &holds, Weighting::None, 1.0, &mut history);
                }
                if strength > 0.0 {
                    anti_lag::shorten(&mut length[..n], &unclipped, &history, strength);
                }
                let colors = window.colors.own(run);
                blend_factor.shares(&coverage[..n], Some(motion), &mut shares);
                if let Some(gradient) = self.gradient {
                    load_shares(gradient, run, &mut changes);
                    for (length, change) in length.iter_mut().zip(&changes) {
                        *length *= tenth_power(1.0 - change);
                    }
                }
                warm_up(colors, longest, &mut shares, &mut length);
                if self.gradient.is_some() {
                    for (share, change) in shares.iter_mut().zip(&changes) {
                        *share += change * (1.0 - *share);
                    }
                }
                if blend.flicker < 1.0 {
                    calm(&window.colors, run, &history, blend.flicker, &mut shares);
                }
                let (weighting, exposure) = (blend.weighting, blend.exposure);
                mix(colors, &history, &shares, weighting, exposure, &mut merged);
                let [r, g, b] = merged.each_ref().map(Row::as_slice);
                out.history.write(run, [r, g, b, &length]);
                *out.missing += count_missing(colors.map(|row| &row[..n]));
                for row in &mut merged {
                    blacken_missing(&mut row[..lanes(run)]);
                }
                out.merged.write(run, merged.each_ref().map(Row::as_slice));
                if let Some(details) = &mut out.details {
                    let place = below * size.width + run.x;
                    details.history_length[place..][..n].copy_from_slice(&length[..n]);
                    details.confidence[place..][..n].copy_from_slice(&coverage[..n]);
                    let rejection = &mut details.rejection[place..][..n];
                    match &fetched {
                        Some(fetched) => rejection.copy_from_slice(&fetched.rejection[..n]),
                        None => rejection.fill(0),
                    }
                }
            }
        }
    }
}

/// Averages the first samples equally: the share of the N-th is at least 1/N, until the least share bounds N. Turns the
/// lengths before, 0 without history, into those after.
#[inline(always)]
fn warm_up([r, g, b]: [&[f32]; 3], longest: f32, shares: &mut Row, length: &mut Row) {
    let n = r.len().min(SEGMENT);
    let (r, g, b) = (&r[..n], &g[..n], &b[..n]);
    for i in 0..n {
        let present = is_present([r[i], g[i], b[i]]);
        let counted = (length[i] + 1.0).min(longest);
        shares[i] = shares[i].max(1.0 / counted);
        length[i] = if present { counted } else { length[i] };
    }
}

/// Where nobody has seen anything there is black.
#[inline(always)]
pub fn blacken_missing(row: &mut [f32]) {
    for value in row {
        *value = if value.is_finite() { *value } else { 0.0 };
    }
}

/// Temporal antialiasing.
pub struct Taa {
    stage: Stage,
    upkeep: Upkeep,
    camera: Option<Camera>,
    /// The last frame's, where history is tested.
    surface: Option<SurfaceRecords>,
    /// What the last frame saw to be wrong and did not correct.
    evidence: Option<Records>,
}

impl Taa {
    /// A pipeline without history; an error if a parameter is out of range.
    pub fn new(params: Params) -> Result<Self> {
        params.check()?;
        Ok(Self {
            stage: Stage::new(params),
            upkeep: Upkeep::default(),
            camera: None,
            surface: None,
            evidence: None,
        })
    }
}

impl Pipeline for Taa {}

impl Steps for Taa {
    fn upkeep(&mut self) -> &mut Upkeep {
        &mut self.upkeep
    }

    fn forget(&mut self) {
        self.stage.reset();
        self.camera = None;
        self.surface = None;
        self.evidence = None;
    }

    fn next(&mut self, frame: &Frame, output: Output) -> Result<Summary> {
        let size = frame.color.size;
        if let Some(before) = &self.stage.history {
            check_size(before.size, size)?;
        }
        let continues = self.stage.history.is_some();
        let mut used = vec![];
        let params = &self.stage.params;
        let resolved = params
            .reconstruct
            .zip(frame.jitter)
            .map(|(filter, jitter)| {
                used.push("jitter");
                let mut image = Image::blank(size, 3);
                let bands = image.bands().map(PixelsMut::Planar);
                let missing = resolve(&[(frame.color, jitter)], filter, bands);
                (image, missing)
            });
        let source = (resolved.as_ref()).map_or(frame.color, |(image, _)| image.pixels());
        let motion = frame.motion(self.camera.as_ref(), &mut used);
        let limits = params.limits;
        let depth = frame.surface.depth.filter(|_| params.dilate.is_some());
        let before = self.surface.take();
        let before = before.as_ref().map(SurfaceRecords::surface);
        let camera = self
            .camera
            .as_ref()
            .filter(|_| limits.plane_distance.is_some());
        let camera = camera.filter(|_| motion.tells_depth());
        let both = |surface: Surface| surface.depth.is_some() && surface.normal.is_some();
        let rays = camera.map(Camera::rays);
        let rays = rays.filter(|_| both(frame.surface) && before.is_some_and(both));
        let [now, before] = [frame.surface, before.unwrap_or_default()]
            .map(|surface| limits.compared(surface, rays.is_some()));
        let tests = Tests::new(now, before, rays, &limits.thresholds());
        let tested = tests.used();
        if depth.is_some() || tested.contains(&"depth") {
            used.push("depth");
        }
        used.extend(tested.into_iter().filter(|&name| name != "depth"));
        let details = Details {
            tests,
            history_length: &mut *output.history_length,
            confidence: output.confidence,
            rejection: output.rejection,
        };
        let missing = self.stage.step(
            source,
            motion.pixels(),
            depth.map(Pixels::plane),
            PixelsMut::bands(size, 3, &mut *output.color),
            Some(details),
        );
        let corrects = self.stage.params.innovation.filter(|_| continues);
        let evidence = self.evidence.take();
        self.evidence = corrects.map(|params| {
            let shown = Pixels::records(size, 3, output.color);
            let lengths = Pixels::records(size, 1, output.history_length);
            let known = evidence.as_ref().map(|evidence| innovation::Known {
                evidence: evidence.pixels(),
                motion: Some(motion.pixels()),
            });
            let bright = exposure(shown);
            let (found, rest) = innovation(&frame.color, &shown, lengths, known, bright, params);
            found.correct(size, output.color);
            rest
        });
        self.camera = frame.camera;
        let compared = limits.compared(frame.surface, limits.plane_distance.is_some());
        self.surface = limits.any().then(|| SurfaceRecords::of(&compared));
        Ok(Summary {
            used,
            missing: resolved.map_or(missing, |(_, missing)| missing),
        })
    }
}
