//! Spatiotemporal variance-guided filtering.

use pyo3::prelude::*;

use super::{Extras, FrameArgs, Output, Pipeline, Room};
use crate::bindings::judge::Bounds;
use crate::kernels::judge::{choice, innovation, surface};
use crate::kernels::merge::accumulate;
use crate::kernels::smooth::guide::Sigmas;
use crate::kernels::smooth::{atrous, fireflies, variance};
use crate::pipelines::frame::Pipeline as _;
use crate::pipelines::{svgf, taa};

/// Spatiotemporal variance-guided filtering of a sequence of frames.
///
/// Carries the history of every pixel along its motion, accepts it where it shows the same surface, merges it with the
/// new sample, estimates the variance that is left and filters in space accordingly. Surface that a frame lacks drop out
/// of the tests and weights: without albedo, texture is filtered with the light; without normals, depth or ids, their
/// tests fall away; without motion, it is computed from the cameras if both frames have one and depth or position is
/// known, and otherwise history stays in place.
///
/// Parameters
/// ----------
/// alpha : float, default 0.2
///     Least share of the new sample in the history, 0 to 1. 0.05 remembers four times as long: steadier where nothing
///     moves, and behind where reflections or light do.
/// moments_alpha : float, default 0.2
///     The same for the moments of luminance.
/// iterations : int, default 3
///     Passes of the spatial filter, 0 to 16; with `choice`, where nothing is known yet.
/// radius : int, default 1
///     Of a pass: 1 for 3×3 taps; 2 for the 5×5 of the paper, which reach twice as far and take twice the time.
/// sigma_luminance : float, default 3.0
///     Luminance difference that counts as one in the filter, in standard deviations; above 0.
/// sigma_normal : float, default 128.0
///     How sharply differences of normals count in the filter; from 0.
/// sigma_depth : float, default 1.0
///     Depth difference that counts as one, in multiples of what the slope explains; above 0. For frames without
///     camera or normals.
/// sigma_plane : float, default 0.01
///     Plane distance that counts as one, as a share of depth; above 0. For frames with camera, depth and normals.
/// relative_depth : float or (float, float), default 0.1
///     Largest relative difference from the expected depth that history may have; above 0. For frames without camera,
///     normals or motion of 3 channels.
/// plane_distance : float or (float, float), default 0.01
///     Largest distance from the history's plane, as a share of depth; above 0. For frames with these.
/// normal_angle : float or (float, float), default 25.0
///     Largest angle between a pixel's normal and its history's, in degrees, 0 to 180.
/// relative_albedo : float or (float, float), optional
///     Largest relative difference between the luminance of a pixel's albedo and its history's, from 0: refuses the history
///     of surfaces whose texture is swapped or moves. Light without its texture mostly stays what it was, so by default
///     nothing is refused.
/// min_length : float, default 3.5
///     Samples from which the temporal variance is trusted; at least 1. Not a whole number by default, so that rounding
///     of resampled lengths does not decide.
/// feedback : bool, default False
///     Whether the filter's first pass, instead of its input, is the next frame's history: less noise in motion, more
///     bias.
/// by_confidence : bool, default False
///     Whether the new sample's share rises where the history is not wholly trusted: ``alpha + (1 - confidence) (1 - alpha)``.
/// gradient : bool, default True
///     Whether changes of light shorten history. They are estimated from the new samples and history, as far as noise lets
///     see. Frames that have a `replay`, if the frame before had one or was the first, tell them without noise: there,
///     unless `innovation` is off, history is first corrected by what the replay shows, and shortened by what the
///     correction leaves and by at least half of the whole change.
/// fireflies : bool, default False
///     Whether samples far brighter than their surroundings, of which history knows nothing, are held down and their excess
///     spread over their surface first (`suppress_fireflies`).
/// reflections : sequence of float, default (0.5, 2.0)
///     Distances behind the surface, in multiples of its depth, +inf included, at which history is looked for as well:
///     where one of them predicts the new samples better than the surface itself (`prediction_gain`), it takes its
///     place. Each costs time, most of it in tiles of 16 pixels where it has won for a sixteenth of them in the frame
///     before, and in those around; every eighth frame asks everywhere. Rows decide in pairs. () leaves it out,
///     (0.25, 0.5, 1, 2, 4, inf) is a finer choice for very glossy scenes. Frames with a `hit_distance` are tried at
///     that one alone. Needs cameras, and depth.
/// choice : bool, default True
///     Whether each tile of 8×8 pixels gets as many passes of the filter, from none to one more than `iterations`, as
///     predicted the samples of the frames before best (`choice`). Mirrors, texture that albedo does not tell and fine
///     shadows keep their detail, and even surfaces are smoothed more.
/// innovation : bool, default True
///     Whether what new samples, together with those of a few frames before, show to be wrong with the result is added to it
///     and to the history (`innovation`): light that moves, and what the filter or reflections blur.
/// antialias : bool, default True
///     Whether a stage of temporal antialiasing, `TAA` with preset "denoised", follows.
///
/// Raises
/// ------
/// ValueError
///     If a parameter is out of range.
///
/// Notes
/// -----
/// Schied et al. 2017, *Spatiotemporal Variance-Guided Filtering: Real-Time Reconstruction for Path-Traced Global
/// Illumination*. Each step consists of this package's functions and gives their bits: `demodulate`,
/// `suppress_fireflies`, `motion_vectors`, `reproject` (with `consistency`), `temporal_gradient`, `virtual_motion` and
/// `prediction_gain`, `accumulate`, `estimate_variance`, `atrous`, `choice` and `innovation` (with the `exposure` of the
/// history), `remodulate`, and those of `TAA`. A replay's correction is an `innovation` too, of history with the change
/// of its samples relative to their blur by `atrous`.
#[pyclass(extends = Pipeline, module = "yester")]
pub struct SVGF {
    inner: svgf::Svgf,
}

#[pymethods]
impl SVGF {
    #[new]
    #[pyo3(signature = (*, alpha=0.2, moments_alpha=0.2, iterations=3, radius=1, sigma_luminance=3.0,
        sigma_normal=128.0, sigma_depth=1.0, sigma_plane=0.01, relative_depth=Bounds::Hard(0.1),
        plane_distance=Bounds::Hard(0.01), normal_angle=Bounds::Hard(25.0), relative_albedo=None, min_length=3.5, feedback=false,
        by_confidence=false, gradient=true, fireflies=false, reflections=vec![0.5, 2.0], choice=true, innovation=true, antialias=true))]
    #[pyo3(
        text_signature = "(*, alpha=0.2, moments_alpha=0.2, iterations=3, radius=1, sigma_luminance=3.0, \
        sigma_normal=128.0, sigma_depth=1.0, sigma_plane=0.01, relative_depth=0.1, plane_distance=0.01, \
        normal_angle=25.0, relative_albedo=None, min_length=3.5, feedback=False, by_confidence=False, gradient=True, fireflies=False, \
        reflections=(0.5, 2.0), choice=True, innovation=True, antialias=True)"
    )]
    fn new(
        alpha: f32,
        moments_alpha: f32,
        iterations: i64,
        radius: i64,
        sigma_luminance: f32,
        sigma_normal: f32,
        sigma_depth: f32,
        sigma_plane: f32,
        relative_depth: Bounds,
        plane_distance: Bounds,
        normal_angle: Bounds,
        relative_albedo: Option<Bounds>,
        min_length: f32,
        feedback: bool,
        by_confidence: bool,
        gradient: bool,
        fireflies: bool,
        reflections: Vec<f32>,
        choice: bool,
        innovation: bool,
        antialias: bool,
    ) -> PyResult<PyClassInitializer<Self>> {
        let sigmas = Sigmas {
            normal: sigma_normal,
            depth: sigma_depth,
            plane: sigma_plane,
        };
        let limits = surface::Params::default();
        let params = svgf::Params {
            surface: surface::Params {
                relative_depth: relative_depth.into(),
                plane_distance: plane_distance.into(),
                normal_angle: normal_angle.into(),
                relative_luminance: relative_albedo.map_or(limits.relative_luminance, Bounds::into),
                ..limits
            },
            same_albedo: relative_albedo.is_some(),
            accumulate: accumulate::Params {
                alpha,
                moments_alpha,
                warmup: true,
            },
            variance: variance::Params {
                min_length,
                sigmas,
                ..Default::default()
            },
            atrous: atrous::Params {
                iterations: atrous::Params::iterations(iterations)?,
                radius: atrous::Params::radius(radius)?,
                sigma_luminance,
                sigmas,
            },
            feedback,
            by_confidence,
            gradient,
            fireflies: fireflies.then(fireflies::Params::default),
            choice: choice.then(choice::Params::default),
            innovation: innovation.then(innovation::Params::default),
            reflections,
            antialias: antialias.then_some(taa::Params::DENOISED),
            lend: None,
        };
        let inner = svgf::Svgf::new(params)?;
        Ok(Pipeline::made(Self { inner }))
    }

    /// Denoises the next frame of the sequence.
    ///
    /// Parameters
    /// ----------
    /// frame : Frame
    ///     Of the same size as those before.
    /// out : Output, optional
    ///     Of an earlier step, no longer needed: its arrays are overwritten and returned, instead of new ones. From the
    ///     second frame on no memory for images is then asked for.
    ///
    /// Returns
    /// -------
    /// Output
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If the size changes, or albedo appears or vanishes, without `reset` in between; if `out` does not fit.
    #[pyo3(signature = (frame, out=None))]
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        frame: &Bound<'py, PyAny>,
        out: Option<&Bound<'py, Output>>,
    ) -> PyResult<Output> {
        let frame = FrameArgs::new(frame)?;
        let extras = Extras {
            variance: true,
            choice: self.inner.chooses(),
        };
        let room = Room::new(py, out, frame.size(), extras)?;
        frame.step(py, room, &mut self.inner)
    }

    /// Forgets the sequence; the next frame is a first one.
    fn reset(&mut self) {
        self.inner.reset();
    }
}
