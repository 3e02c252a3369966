//! Temporal antialiasing.

use pyo3::prelude::*;

use super::{FrameArgs, Output, Pipeline, renamed};
use crate::bindings::arrays::choice;
use crate::bindings::judge::Bounds;
use crate::kernels::fetch::footprint::Filter;
use crate::kernels::judge::{innovation, neighborhood};
use crate::kernels::merge::blend;
use crate::pipelines::Pipeline as _;
use crate::pipelines::taa;

/// Temporal antialiasing of a sequence of frames.
///
/// Carries the colours of former frames along the motion, holds them to the colours that the new frame has around each
/// pixel, and blends. For frames without noise to speak of, with samples that differ in place from frame to frame; what
/// noise there is makes neighbourhoods wide and histories doubtful. No surface is told from another unless tests are
/// switched on, so that edges are antialiased, and all buffers but colour may be absent: without motion, it is computed
/// from the cameras if both frames have one and depth or position is known, and otherwise history stays in place.
///
/// Parameters
/// ----------
/// preset : {"best", "denoised", "textbook", "karis", "filament"}, default "best"
///     Where the other parameters come from that are not given: our own measurements, on frames without noise and on
///     denoised ones; the textbook equation (range of the 3×3 pixels, clamped, 5 % of the new sample); after Karis 2014,
///     *High Quality Temporal Supersampling*, and after Google's Filament, whose techniques these have, not every constant.
/// alpha : float, optional
///     Least share of the new sample, 0 to 1.
/// fast_alpha : float, optional
///     The same for fast motion.
/// speed : float or (float, float), optional
///     Pixels up to which motion is slow, and from which it is fast.
/// dilate : {"3x3", "cross", "none"}, optional
///     Which pixels may lend their motion, as in `dilate_motion`: the nearest one where there is depth, else the longest.
/// filter : {"bilinear", "nearest", "catmull-rom", "catmull-rom-5", "lanczos-2"}, optional
///     As in `reproject`.
/// box, gamma, window, space, response : optional
///     As in `clip_history`.
/// weighting, flicker : optional
///     As in `blend`.
/// relative_depth, plane_distance, normal_angle : float or (float, float), optional
///     Tests that history must pass, with thresholds as in `reproject`; by default none. With `plane_distance`, frames
///     with camera, depth, normals and motion of 3 channels are tested by it, others by `relative_depth` if that is given.
///     A test drops out where one of two frames lacks its buffers. Along edges the tests refuse the history that would
///     antialias them.
/// relative_albedo : float or (float, float), optional
///     Largest relative difference of the albedo's luminance: refuses history where textures are swapped or move.
/// ids : bool, default False
///     Whether history must be of the same id.
/// gradient : bool, default False
///     Whether changes of light, as far as aliasing and noise let see, shorten history (`temporal_gradient`). Pays for
///     frames without noise; fireflies and other rare bright samples are taken for changes.
/// anti_lag : float, default 0.0
///     How much clipping shortens history: the `strength` of `anti_lag`; from 0, which leaves it out. 1 pays for frames
///     without noise, and costs next to no time; noise is clipped as well, and is then averaged less.
/// alternation : bool, default False
///     Whether history is not clipped where the colours of whole neighbourhoods come and go and come again
///     (`alternation`): against flicker where aliasing is wider than the neighbourhood. It costs most of the time that
///     all the rest takes. `SVGF` gets it as ``SVGF(antialias=False)`` followed by ``TAA("denoised", alternation=True)``.
/// innovation : bool, default False
///     Whether what the samples of this and a few earlier frames show to be wrong with the result is added to what is shown
///     (`innovation`, with the `exposure` of the result and ``fed_back=False``): light that changes, in frames with noise. In frames without, a part
///     of the aliasing counts as news.
///
/// Raises
/// ------
/// ValueError
///     If a parameter is out of range, or a mode unknown (the error lists the modes).
///
/// Notes
/// -----
/// Each step consists of this package's functions and gives their bits: `resolve` (with "blackman-harris", of frames that
/// tell their jitter, but for "textbook"), `motion_vectors`, `dilate_motion`, `reproject` without fallback, `blend_factor`,
/// `exposure`, `clip_history`, `alternation`, `anti_lag`, `temporal_gradient` (``noise=2.2, passes=3, widest=5``), `blend`.
/// The share of the N-th sample of a pixel is at least 1/N. With a gradient λ, N becomes N (1 - λ)¹⁰ before, and the share a
/// ``lerp(a, 1, λ)``, as in `accumulate`.
#[pyclass(extends = Pipeline, module = "yester")]
pub struct TAA {
    inner: taa::Taa,
}

#[pymethods]
impl TAA {
    #[new]
    #[pyo3(signature = (preset="best", *, alpha=None, fast_alpha=None, speed=None, dilate=None, filter=None, r#box=None,
        gamma=None, window=None, space=None, response=None, weighting=None, flicker=None, relative_depth=None,
        plane_distance=None, normal_angle=None, relative_albedo=None, ids=false, gradient=false, anti_lag=0.0, alternation=false,
        innovation=false))]
    fn new(
        py: Python<'_>,
        preset: &str,
        alpha: Option<f32>,
        fast_alpha: Option<f32>,
        speed: Option<Bounds>,
        dilate: Option<&str>,
        filter: Option<&str>,
        r#box: Option<&str>,
        gamma: Option<f32>,
        window: Option<&str>,
        space: Option<&str>,
        response: Option<&str>,
        weighting: Option<&str>,
        flicker: Option<f32>,
        relative_depth: Option<Bounds>,
        plane_distance: Option<Bounds>,
        normal_angle: Option<Bounds>,
        relative_albedo: Option<Bounds>,
        ids: bool,
        gradient: bool,
        anti_lag: f32,
        alternation: bool,
        innovation: bool,
    ) -> PyResult<PyClassInitializer<Self>> {
        /// The mode that is named, or the preset's.
        fn or<T: Copy>(
            name: Option<&str>,
            argument: &str,
            names: &[(&str, T)],
            preset: T,
        ) -> PyResult<T> {
            name.map_or(Ok(preset), |name| choice(argument, name, names))
        }
        let mut params = choice("preset", renamed(py, preset)?, &taa::Params::PRESETS)?;
        params.dilate = or(dilate, "dilate", &taa::Params::DILATIONS, params.dilate)?;
        params.filter = or(filter, "filter", &Filter::NAMES, params.filter)?;
        let factor = &mut params.blend_factor;
        factor.alpha = alpha.unwrap_or(factor.alpha);
        factor.fast_alpha = fast_alpha.unwrap_or(factor.fast_alpha);
        factor.speed = speed.map_or(factor.speed, Into::into);
        let clip = &mut params.clip;
        clip.bounds = or(r#box, "box", &neighborhood::Params::BOUNDS, clip.bounds)?;
        clip.gamma = gamma.unwrap_or(clip.gamma);
        clip.radius = or(
            window,
            "window",
            &neighborhood::Params::WINDOWS,
            clip.radius,
        )?;
        clip.space = or(space, "space", &neighborhood::Params::SPACES, clip.space)?;
        clip.response = or(
            response,
            "response",
            &neighborhood::Params::RESPONSES,
            clip.response,
        )?;
        let weightings = &blend::Params::WEIGHTINGS;
        params.blend.weighting = or(weighting, "weighting", weightings, params.blend.weighting)?;
        params.blend.flicker = flicker.unwrap_or(params.blend.flicker);
        params.limits = taa::Limits {
            relative_depth: relative_depth.map(Bounds::into),
            plane_distance: plane_distance.map(Bounds::into),
            normal_angle: normal_angle.map(Bounds::into),
            relative_albedo: relative_albedo.map(Bounds::into),
            ids,
        };
        params.gradient = gradient;
        params.anti_lag = anti_lag;
        params.alternation = alternation;
        params.innovation = innovation.then(|| innovation::Params {
            fed_back: false,
            ..Default::default()
        });
        let inner = taa::Taa::new(params)?;
        Ok(Pipeline::made(Self { inner }))
    }

    /// Antialiases the next frame of the sequence.
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
    ///     Without a variance.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If the size changes without `reset` in between; if `out` does not fit.
    #[pyo3(signature = (frame, out=None))]
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        frame: &Bound<'py, PyAny>,
        out: Option<&Bound<'py, Output>>,
    ) -> PyResult<Output> {
        FrameArgs::new(frame)?.step(py, out, &mut self.inner)
    }

    /// Forgets the sequence; the next frame is a first one.
    fn reset(&mut self) {
        self.inner.reset();
    }
}
