//! Recirculation: whole pictures of frames of which a part of the pixels is traced, as a list of this library's
//! kernels, `splat` only if history is splatted and not fetched:
//!
//!   (suppress fireflies) → (motion of a still scene) → pull-push → (splat) → motion → recirculate → (innovation)
//!
//! Splatted, history is a set of points, one for each pixel: colour, depth, place in the pixel, drift and quality. The
//! points are scattered to where they appear now; the new samples, whose holes are filled, join them by quality; the result
//! is the history of the next frame. The motion blur is shown, but not carried on.
//!
//! Fetched, history is the image that was shown last, with its quality. The motion of each pixel follows from the new
//! samples, whose holes are filled, and says where that image is read; no test tells whether the surface is the same.
//!
//! The innovation of new samples, which are sparse, corrects the result and the history, so that a change of light reaches
//! pixels before they are traced again. Its evidence comes along the motion that the blur uses.
//!
//! Where holes are filled, a sample of depth z weighs
//!   w = max(z⁻ᵏ, 10⁻²⁴),
//! k being the nearness: near samples override distant ones, and all override the background. The quality of a filled
//! pixel is divided by the weight at its filled depth, so that it counts samples at any k and in any unit of depth.
//!
//! After Lottes 2008, *Reprojection 2*: it fetches history and weighs samples by depth and size. All new
//! samples are of one pixel's size here; points that have grown lose quality in `splat`, filled pixels in `pull_push`.

mod history;
mod samples;

use self::history::{Points, filled_depth, motion_along, report_known};
use self::samples::{Fresh, find_samples};
use super::correction::correct;
use super::frame::{Frame, Motion, Output, Steps, Summary, Upkeep, check_size, names, show};
use super::illumination::samples_without_fireflies;
use crate::error::{Error, Result, Whole, whole};
use crate::image::{Image, Interleaved, Pixels, Size, View};
use crate::kernels::camera::motion::Geometry;
use crate::kernels::camera::pinhole::Camera;
use crate::kernels::fetch::{pull_push, splat};
use crate::kernels::judge::exposure::exposure;
use crate::kernels::judge::innovation::{self, innovation};
use crate::kernels::merge::recirculate::{self, Known};
use crate::kernels::smooth::fireflies;
use crate::pixels::PixelsMut;

/// Parameters of [`Recirculation`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// How what was known is scattered.
    pub splat: splat::Params,
    /// How holes are filled.
    pub pull_push: pull_push::Params,
    /// Its `fetch` tells whether history is fetched or splatted.
    pub recirculate: recirculate::Params,
    /// k: where holes are filled, samples are weighted by the inverse of their depth to this power; 0 to 4; 0.
    pub nearness: u32,
    /// Whether outliers of the samples are held down first.
    pub fireflies: Option<fireflies::Params>,
    /// Corrects the result and the history by the innovation of new samples.
    pub innovation: Option<innovation::Params>,
}

/// The default innovation, for frames of few samples.
pub const INNOVATION: innovation::Params = innovation::Params {
    sparse: true,
    ..innovation::Params::DEFAULT
};

/// The preset "best".
impl Default for Params {
    fn default() -> Self {
        Self::BEST
    }
}

impl Params {
    /// Names of presets.
    pub const PRESETS: [(&str, Self); 2] = [("best", Self::BEST), ("textbook", Self::TEXTBOOK)];

    /// How history comes to the current frame, as the value of `recirculate.fetch`.
    pub const HISTORIES: [(&str, bool); 2] = [("splat", false), ("fetch", true)];

    /// Our own measurements' choice.
    pub const BEST: Self = Self {
        splat: splat::Params {
            reach: 0.5,
            ..splat::Params::DEFAULT
        },
        pull_push: pull_push::Params::DEFAULT,
        recirculate: recirculate::Params::DEFAULT,
        nearness: 0,
        fireflies: None,
        innovation: Some(INNOVATION),
    };

    /// As the diary describes it; the range of the blend factor and the weight of depth are our choice, as it gives none.
    pub const TEXTBOOK: Self = Self {
        pull_push: pull_push::Params {
            factor: 4,
            levels: 2,
        },
        recirculate: recirculate::Params {
            share: [0.1, 0.5],
            fetch: true,
            ..Self::BEST.recirculate
        },
        nearness: 1,
        innovation: None,
        ..Self::BEST
    };

    pub(crate) fn nearness(nearness: impl Whole<u32>) -> Result<u32> {
        whole("nearness", nearness, "0 to 4", |n| (0..=4).contains(n))
    }

    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        self.splat.check()?;
        self.pull_push.check()?;
        Self::nearness(self.nearness)?;
        self.fireflies
            .iter()
            .try_for_each(fireflies::Params::check)?;
        if let Some(innovation) = &self.innovation {
            innovation.check()?;
        }
        self.recirculate.check()
    }
}

/// What one frame leaves to the next.
struct State {
    /// If history is splatted, its last three channels are the drift: the motion of points that move by themselves.
    color: Image,
    quality: Interleaved,
    /// Depth, and offset from the pixel's centre, if history is splatted.
    place: Option<[Interleaved; 2]>,
    /// Evidence of the innovation, carried to the next frame; from the second frame on.
    evidence: Option<Interleaved>,
    camera: Camera,
}

/// Whole pictures from frames of which a part of the pixels is traced. Frames need a camera, and depth or position.
pub struct Recirculation {
    params: Params,
    upkeep: Upkeep,
    state: Option<State>,
}

impl Recirculation {
    /// A pipeline without history; an error if a parameter is out of range.
    pub fn new(params: Params) -> Result<Self> {
        params.check()?;
        Ok(Self {
            params,
            upkeep: Upkeep::default(),
            state: None,
        })
    }
}

debug_params!(Recirculation, params);

impl Steps for Recirculation {
    fn upkeep(&mut self) -> &mut Upkeep {
        &mut self.upkeep
    }

    fn forget(&mut self) {
        self.state = None;
    }

    fn next(&mut self, frame: &Frame, mut output: Output) -> Result<Summary> {
        let needs = |what| Error::value("frame", what, "one without");
        let camera = frame.camera.ok_or_else(|| needs("one with a camera"))?;
        let geometry = frame.geometry();
        let geometry = geometry.ok_or_else(|| needs("one with depth or position"))?;
        if let Some(state) = &self.state {
            check_size(state.color.size, frame.color.size)?;
        }
        let held = (self.params.fireflies)
            .map(|limits| samples_without_fireflies(frame.color, None, frame.surface, limits));
        let frame = &Frame {
            color: held.as_ref().map_or(frame.color, Image::pixels),
            ..*frame
        };
        let before = self.state.take();
        let previous = before.as_ref().map(|before| before.camera);
        let (samples, missing) = find_samples(frame, geometry, &camera, previous.as_ref());
        let mut fresh = Fresh::fill(samples, frame.color, self.params);
        let join = match self.params.recirculate.fetch {
            true => fetched,
            false => splatted,
        };
        let cameras = [&camera, previous.as_ref().unwrap_or(&camera)];
        let mut joined = join(before, &mut fresh, cameras, self.params, &mut output);
        if let Some(params) = self.params.innovation.filter(|_| previous.is_some()) {
            joined.correct(params, &fresh, output.history_length);
        }
        show(joined.shown(), output.color);
        self.state = Some(joined.state);
        let position = matches!(geometry, Geometry::Position(_));
        let used = names([
            ("camera", true),
            ("position", position),
            ("depth", !position),
            ("motion", frame.motion.is_some() && previous.is_some()),
            ("jitter", frame.jitter.is_some()),
        ]);
        Ok(Summary {
            used,
            missing,
            repeats: false,
        })
    }
}

/// New samples and history, joined.
struct Joined {
    /// Still with the last frame's evidence.
    state: State,
    motion: Motion<'static>,
    /// If other than the colour that is carried on.
    shown: Option<Image>,
}

/// Joins new samples with the points of the past, scattered to where they appear now.
fn splatted(
    before: Option<State>,
    fresh: &mut Fresh,
    cameras: [&Camera; 2],
    params: Params,
    output: &mut Output,
) -> Joined {
    let (size, continues) = (fresh.size(), before.is_some());
    let (mut points, evidence) = match before {
        Some(before) => Points::splat(before, cameras[0], params.splat),
        None => (Points::none(size), None),
    };
    let mut color = Image::blank(size, history::CHANNELS);
    let (carried, drift) = color.data_mut().split_at_mut(3 * size.pixels());
    points.settle(fresh, drift, params.splat.tolerance, continues, output);
    let drift = View::new(size, 3, drift).into();
    let motion = motion_along(points.depth.pixels(), drift, cameras);
    let (known, length) = (points.known(), &mut *output.history_length);
    let (mut quality, mut shown) = (Interleaved::blank(size, 1), Image::blank(size, 3));
    let sharp = recirculate::Params {
        blur: 0.0,
        ..params.recirculate
    };
    fresh.join(known, &motion, sharp, carried, quality.data_mut());
    fresh.join(known, &motion, params.recirculate, shown.data_mut(), length);
    let state = State {
        color,
        quality,
        place: Some([points.depth, points.offset]),
        evidence,
        camera: *cameras[0],
    };
    Joined {
        state,
        motion,
        shown: Some(shown),
    }
}

/// Joins new samples with the image that was shown last, read along the motion.
fn fetched(
    before: Option<State>,
    fresh: &mut Fresh,
    cameras: [&Camera; 2],
    params: Params,
    output: &mut Output,
) -> Joined {
    let (size, continues) = (fresh.size(), before.is_some());
    let past = before.unwrap_or_else(|| State::nothing(size, *cameras[0]));
    let (depth, drift) = (filled_depth(fresh), fresh.filled.pixels().part(4..7));
    let motion = motion_along(depth.pixels(), drift, cameras);
    let known = Known {
        color: past.color.pixels(),
        quality: past.quality.pixels(),
    };
    let mut state = State::nothing(size, *cameras[0]);
    let (color, quality) = (state.color.data_mut(), state.quality.data_mut());
    fresh.join(known, &motion, params.recirculate, color, quality);
    report_known(known.quality, motion.pixels(), continues, output);
    output.history_length.copy_from_slice(quality);
    state.evidence = past.evidence;
    Joined {
        state,
        motion,
        shown: None,
    }
}

impl State {
    /// A state without history, for history that is fetched.
    fn nothing(size: Size, camera: Camera) -> Self {
        Self {
            color: Image::new(size, 3),
            quality: Interleaved::new(size, 1),
            place: None,
            evidence: None,
            camera,
        }
    }
}

impl Joined {
    fn shown(&self) -> View<'_> {
        let carried = self.state.color.channels(0..3);
        self.shown.as_ref().map_or(carried, Image::view)
    }

    /// Corrects the result, and the colour that is carried on, by what new samples show to be wrong with the result.
    fn correct(&mut self, params: innovation::Params, fresh: &Fresh, length: &[f32]) {
        let prediction = Pixels::from(self.shown());
        let size = prediction.size;
        let (length, bright) = (
            Pixels::of_interleaved(size, 1, length),
            exposure(prediction),
        );
        let known = innovation::Known::of(self.state.evidence.as_ref(), self.motion.pixels());
        let prediction = innovation::Predicted {
            colors: &prediction,
            lengths: length,
        };
        let (found, rest) = innovation(fresh, None, &prediction, known, bright, params);
        let carried = &mut self.state.color.data_mut()[..3 * size.pixels()];
        let (shown, behind) = match &mut self.shown {
            Some(shown) => (shown.data_mut(), Some(carried)),
            None => (carried, None),
        };
        let planar = |data| PixelsMut::planar(size, data);
        correct(&found, size, 0.0, planar(shown), behind.map(planar));
        self.state.evidence = Some(rest);
    }
}
