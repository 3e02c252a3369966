//! Forward reprojection with recirculation.

use pyo3::prelude::*;

use super::{FrameArgs, Output, Pipeline, alone, renamed};
use crate::bindings::arrays::choice;
use crate::kernels::fetch::pull_push;
use crate::kernels::smooth::fireflies;
use crate::pipelines::Pipeline as _;
use crate::pipelines::recirculation;

/// Complete frames of which only a part of the pixels is traced.
///
/// History is kept as world-space points, one for each pixel, and scattered to where they appear now. The new frame's
/// samples, with holes filled from their surroundings, are blended with it by quality. Untraced pixels need no buffers.
///
/// A pixel counts as traced if its colour is finite and its position is known: `position`, or else `depth`, +inf where
/// nothing was hit. All others are missing, whatever their other buffers contain; mark them by NaN. Every frame needs a
/// camera. The pattern of traced pixels should change from frame to frame, so that each pixel is traced at some time.
///
/// Parameters
/// ----------
/// preset : {"best", "textbook"}, default "best"
///     Source of the parameters that are not given: our own measurements; or the textbook method as its source
///     describes it, with ``factor=4, levels=2, nearness=1, history="fetch", share=(0.1, 0.5)``.
/// factor : int, optional
///     Ratio of the sides of successive levels of hole filling, 2 to 16, as in `pull_push`. "best" has 2.
/// levels : int, optional
///     Number of levels, at least 1. "best" goes down to a single pixel.
/// nearness : int, optional
///     Exponent of inverse depth in the samples' weight for hole filling, 0 to 4: near samples override distant ones.
///     "best" has 0.
/// history : {"splat", "fetch"}, optional
///     Scatter history to where it appears now, or fetch it along the motion of the new samples. "best" has "splat".
/// blur, share, fade, limit : float or (float, float), optional
///     As in `recirculate`. "best" has its defaults. With "splat", history stays free of the blur.
/// tolerance : float, optional
///     As in `splat`; also the largest difference of a sample's depth, relative to it, from that of history at its
///     pixel. Both presets have 0.1. No effect with "fetch".
/// fireflies : bool, default False
///     First clamp samples far brighter than the other samples around, and redistribute the excess over those of their
///     surface (`suppress_fireflies`, by depth, normals and ids, without history).
/// innovation : bool, optional
///     Add the error of the result, as estimated from new samples over blocks of pixels and a few frames, to the result
///     and to history (`innovation`), for changing light. The correction is relative to each pixel's own light, so that
///     fireflies in history grow with the light around them. "best" does it.
///
/// Raises
/// ------
/// ValueError
///     If a parameter is out of range, or a preset or history unknown.
///
/// See Also
/// --------
/// HalfRes : Denoises frames of which a part is traced.
/// splat : Scatters history.
/// recirculate : Blends history and new samples.
///
/// Notes
/// -----
/// After a developer's diary [1]_. Each step consists of this package's functions and gives their bits:
/// `suppress_fireflies`, `pull_push` (of colour and the inverse of depth), `splat` (with a reach of 0.5),
/// `motion_vectors`, `recirculate`, without blur for the next frame and with it for the result, and from the second
/// frame on `innovation` (``sparse=True``, with the `exposure` of the result, and the motion of `recirculate`). The
/// point of a traced pixel lies where it was sampled (`Frame.position` or `Frame.jitter`, else the centre), that of a
/// pixel with history where history's point lies, and that of a filled pixel at the centre, at the filled depth. Filled
/// colour is ignored where history has eight times its quality; otherwise static pixels would never become as sharp as
/// their samples. With `Frame.motion` at traced pixels, moving objects are extrapolated (`splat`'s drift); without it,
/// they leave a ghost until samples overwrite it.
///
/// In hole filling, a sample at depth ``z`` has weight ``max(z**-nearness, 1e-24)``. The quality of a filled pixel is
/// divided by the weight at its depth, so that it counts samples.
///
/// "fetch" applies one `recirculate` (with `fetch`) to the previous result, including its blur, along the motion of the
/// filled samples. It is not validated against the surface. Interpolation in every frame blurs it, and averages noise:
/// the notebook `recirculation.ipynb` shows both, beside the other choices of "textbook".
///
/// References
/// ----------
/// .. [1] T. Lottes, "Reprojection 2", timothylottes.github.io/20081218.html, 2008.
///
/// Examples
/// --------
/// >>> camera = yester.Camera.from_look_at([0, 0, 0], [0, 0, 1], [0, 1, 0], fov=60, width=8, height=8)
/// >>> pipeline = yester.Recirculation()
/// >>> for number in range(4):
/// ...     x, y = yester.HalfRes.offset(number)
/// ...     color = np.full((8, 8, 3), np.nan)
/// ...     color[y::2, x::2] = 1
/// ...     output = pipeline.step(yester.Frame(color, depth=np.full((8, 8), 2.0), camera=camera))
/// >>> output.missing, bool(np.isfinite(output.color).all())
/// (48, True)
#[pyclass(extends = Pipeline, module = "yester")]
pub struct Recirculation {
    inner: recirculation::Recirculation,
}

#[pymethods]
impl Recirculation {
    #[new]
    #[pyo3(signature = (preset="best", *, factor=None, levels=None, nearness=None, history=None, blur=None, share=None,
        fade=None, limit=None, tolerance=None, fireflies=false, innovation=None))]
    fn new(
        py: Python<'_>,
        preset: &str,
        factor: Option<i128>,
        levels: Option<i128>,
        nearness: Option<i128>,
        history: Option<&str>,
        blur: Option<f32>,
        share: Option<(f32, f32)>,
        fade: Option<f32>,
        limit: Option<f32>,
        tolerance: Option<f32>,
        fireflies: bool,
        innovation: Option<bool>,
    ) -> PyResult<PyClassInitializer<Self>> {
        let mut params = choice(
            "preset",
            renamed(py, preset)?,
            &recirculation::Params::PRESETS,
        )?;
        let holes = &mut params.pull_push;
        holes.factor = factor.map_or(Ok(holes.factor), pull_push::Params::factor)?;
        holes.levels = levels.map_or(Ok(holes.levels), pull_push::Params::levels)?;
        let nearest = recirculation::Params::nearness;
        params.nearness = nearness.map_or(Ok(params.nearness), nearest)?;
        let blend = &mut params.recirculate;
        if let Some(history) = history {
            blend.fetch = choice("history", history, &recirculation::Params::HISTORIES)?;
        }
        blend.blur = blur.unwrap_or(blend.blur);
        blend.share = share.map_or(blend.share, Into::into);
        blend.fade = fade.unwrap_or(blend.fade);
        blend.limit = limit.unwrap_or(blend.limit);
        params.splat.tolerance = tolerance.unwrap_or(params.splat.tolerance);
        params.fireflies = fireflies.then(fireflies::Params::default);
        if let Some(innovation) = innovation {
            params.innovation = innovation.then_some(recirculation::INNOVATION);
        }
        let inner = recirculation::Recirculation::new(params)?;
        Ok(Pipeline::made(Self { inner }))
    }

    /// Complete the next frame of the sequence.
    ///
    /// Parameters
    /// ----------
    /// frame : Frame
    ///     The next frame, of the same size as the previous ones, with camera, and depth or position.
    /// out : Output, optional
    ///     An earlier step's output whose arrays are overwritten and returned, instead of new ones.
    ///
    /// Returns
    /// -------
    /// Output
    ///     Without a variance. `history_length` is the quality of the pixel: 1 for a sample, more for several; the
    ///     farther away the samples, the smaller. `confidence` is 1 where there is history, else 0; `rejection` is
    ///     OUTSIDE where no point of history arrived, or motion leads to none, and DEPTH where a sample's depth
    ///     disagrees with history's. Until anything has been traced, colour is black.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If the frame has no camera, or neither depth nor position; if the size changes without `reset` in between;
    ///     if `out` does not fit.
    #[pyo3(signature = (frame, out=None))]
    fn step<'py>(
        slf: &Bound<'py, Self>,
        py: Python<'py>,
        frame: &Bound<'py, PyAny>,
        out: Option<&Bound<'py, Output>>,
    ) -> PyResult<Output> {
        FrameArgs::new(frame)?.step(py, out, &mut alone(slf)?.inner)
    }

    /// Discard all history; the next frame starts a new sequence.
    fn reset(slf: &Bound<Self>) -> PyResult<()> {
        alone(slf)?.inner.reset();
        Ok(())
    }
}
