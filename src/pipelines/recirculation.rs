//! Recirculation: whole pictures of frames of which a part of the pixels is traced, as a list of this library's
//! kernels:
//!
//!   (motion of a still scene) → pull-push → splat → motion → recirculate → (innovation)     history is splatted, or
//!   (motion of a still scene) → pull-push → motion → recirculate → (innovation)             history is fetched
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
//! After "Reprojection 2", a developer's diary of 2008: it fetches history and weighs samples by depth and size. All new
//! samples are of one pixel's size here; points that have grown lose quality in `splat`, filled pixels in `pull_push`.

mod history;
mod samples;

use self::history::{Points, filled_depth, motion_along, report_known};
use self::samples::{Fresh, find_samples};
use super::correction::{correct, innovate};
use super::frame::{Frame, Motion, Output, Pipeline, Summary, Upkeep, check_size, names, show};
use crate::error::{Error, Result, whole};
use crate::image::{Image, Pixels, Records, View};
use crate::kernels::camera::motion::Geometry;
use crate::kernels::camera::pinhole::Camera;
use crate::kernels::fetch::{pull_push, splat};
use crate::kernels::judge::exposure::exposure;
use crate::kernels::judge::innovation;
use crate::kernels::merge::recirculate::{self, Known};

#[derive(Clone, Copy, Debug)]
pub struct Params {
    pub splat: splat::Params,
    pub pull_push: pull_push::Params,
    /// Its `fetch` tells whether history is fetched or splatted.
    pub recirculate: recirculate::Params,
    /// k: holes are filled by samples weighted by the inverse of their depth to this power; 0 to 4; 0.
    pub nearness: u32,
    /// Corrects the result and the history by the innovation of new samples.
    pub innovation: Option<innovation::Params>,
}

/// The default innovation, for frames of few samples.
pub const INNOVATION: innovation::Params = innovation::Params {
    sparse: true,
    ..innovation::Params::DEFAULT
};

impl Params {
    pub const PRESETS: [(&str, Self); 2] = [("best", Self::BEST), ("seed", Self::SEED)];

    /// How history comes to the current frame, as the value of `recirculate.fetch`.
    pub const HISTORIES: [(&str, bool); 2] = [("splat", false), ("fetch", true)];

    /// Our own measurements' choice.
    pub const BEST: Self = Self {
        splat: splat::Params {
            tolerance: 0.1,
            reach: 0.5,
        },
        pull_push: pull_push::Params {
            factor: 2,
            levels: usize::MAX,
        },
        recirculate: recirculate::Params {
            blur: 0.25,
            share: [0.0, 1.0],
            fade: 64.0,
            limit: 8.0,
            fetch: false,
        },
        nearness: 0,
        innovation: Some(INNOVATION),
    };

    /// As the diary describes it; the range of the blend factor and the weight of depth are our choice, as it gives none.
    pub const SEED: Self = Self {
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

    pub fn nearness(nearness: i64) -> Result<u32> {
        whole("nearness", nearness, "0 to 4", |n| (0..=4).contains(n))
    }

    pub fn check(&self) -> Result<()> {
        self.splat.check()?;
        if let Some(innovation) = &self.innovation {
            innovation.check()?;
        }
        self.recirculate.check()
    }
}

/// What one frame leaves to the next.
struct State {
    /// Followed by the drift, if history is splatted.
    color: Image,
    quality: Records,
    /// Depth, and the offset from the pixel's centre, if history is splatted.
    place: Option<[Records; 2]>,
    /// The innovation that was found and not corrected, from the second frame on.
    evidence: Option<Records>,
    camera: Camera,
}

pub struct Recirculation {
    params: Params,
    upkeep: Upkeep,
    state: Option<State>,
}

impl Recirculation {
    pub fn new(params: Params) -> Result<Self> {
        params.check()?;
        Ok(Self {
            params,
            upkeep: Upkeep::default(),
            state: None,
        })
    }
}

impl Pipeline for Recirculation {
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
        let before = self.state.take();
        let previous = before.as_ref().map(|before| before.camera);
        let (samples, missing) = find_samples(frame, geometry, &camera, previous.as_ref());
        let fresh = Fresh::fill(samples, frame.color, self.params);
        let join = match self.params.recirculate.fetch {
            true => fetched,
            false => splatted,
        };
        let cameras = [&camera, previous.as_ref().unwrap_or(&camera)];
        self.state = Some(join(before, fresh, cameras, self.params, &mut output));
        let position = matches!(geometry, Geometry::Position(_));
        let used = names([
            ("camera", true),
            ("position", position),
            ("depth", !position),
            ("motion", frame.motion.is_some() && previous.is_some()),
            ("jitter", frame.jitter.is_some()),
        ]);
        Ok(Summary {
            used: used.collect(),
            missing,
        })
    }
}

/// Joins new samples with the points of the past, scattered to where they appear now.
fn splatted(
    before: Option<State>,
    mut fresh: Fresh,
    cameras: [&Camera; 2],
    params: Params,
    output: &mut Output,
) -> State {
    let size = fresh.size();
    let (innovation, continues) = (params.innovation, before.is_some());
    let (mut points, evidence) = match before {
        Some(before) => Points::splat(before, cameras[0], params.splat),
        None => (Points::none(size), None),
    };
    let mut color = Image::blank(size, history::CHANNELS);
    let (carried, drift) = color.data_mut().split_at_mut(3 * size.pixels());
    points.settle(&mut fresh, drift, params.splat.tolerance, continues, output);
    let motion = motion_along(
        points.depth.pixels(),
        View::new(size, 3, drift).into(),
        cameras,
    );
    let join = |params, color: &mut [f32], quality: &mut [f32]| {
        fresh.join(points.known(), &motion, params, color, quality);
    };
    let (mut quality, mut shown) = (Records::blank(size, 1), Image::blank(size, 3));
    let sharp = recirculate::Params {
        blur: 0.0,
        ..params.recirculate
    };
    join(sharp, carried, quality.data_mut());
    join(params.recirculate, shown.data_mut(), output.history_length);
    let evidence = (innovation.filter(|_| continues)).map(|params| {
        let evidence = evidence.as_ref();
        add_innovation(
            params,
            &fresh,
            &motion,
            evidence,
            output.history_length,
            &mut shown,
            carried,
        )
    });
    show(shown.view(), output.color);
    State {
        color,
        quality,
        place: Some([points.depth, points.offset]),
        evidence,
        camera: *cameras[0],
    }
}

/// Joins new samples with the image that was shown last, read along the motion.
fn fetched(
    before: Option<State>,
    fresh: Fresh,
    cameras: [&Camera; 2],
    params: Params,
    output: &mut Output,
) -> State {
    let size = fresh.size();
    let (innovation, continues) = (params.innovation, before.is_some());
    let past = before.unwrap_or_else(|| State {
        color: Image::new(size, 3),
        quality: Records::new(size, 1),
        place: None,
        evidence: None,
        camera: *cameras[0],
    });
    let (depth, drift) = (filled_depth(&fresh), fresh.filled.pixels().part(4..7));
    let motion = motion_along(depth.pixels(), drift, cameras);
    let known = Known {
        color: past.color.pixels(),
        quality: past.quality.pixels(),
    };
    let (mut color, mut quality) = (Image::blank(size, 3), Records::blank(size, 1));
    fresh.join(
        known,
        &motion,
        params.recirculate,
        color.data_mut(),
        quality.data_mut(),
    );
    report_known(known.quality, motion.pixels(), continues, output);
    (output.history_length).copy_from_slice(quality.pixels().numbers().0);
    let evidence = (innovation.filter(|_| continues)).map(|params| {
        let evidence = past.evidence.as_ref();
        add_innovation(
            params,
            &fresh,
            &motion,
            evidence,
            output.history_length,
            &mut color,
            &mut [],
        )
    });
    show(color.view(), output.color);
    State {
        color,
        quality,
        place: None,
        evidence,
        camera: *cameras[0],
    }
}

/// Corrects the result and the planes that are carried on by what new samples show to be wrong with the result. Returns the
/// evidence for the next frame.
fn add_innovation(
    params: innovation::Params,
    fresh: &Fresh,
    motion: &Motion,
    evidence: Option<&Records>,
    length: &[f32],
    shown: &mut Image,
    carried: &mut [f32],
) -> Records {
    let size = shown.size;
    let (prediction, length) = (shown.pixels(), Pixels::records(size, 1, length));
    let bright = exposure(prediction);
    let (found, rest) = innovate(params, fresh, &prediction, length, motion, bright, evidence);
    correct(&found, size, shown.data_mut(), carried);
    rest
}
