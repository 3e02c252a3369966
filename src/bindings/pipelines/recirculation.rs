//! Forward reprojection with recirculation.

use pyo3::prelude::*;

use super::{FrameArgs, Output, Pipeline, renamed};
use crate::bindings::arrays::choice;
use crate::kernels::fetch::pull_push;
use crate::pipelines::Pipeline as _;
use crate::pipelines::recirculation;

/// Whole pictures from frames of which a part of the pixels is traced.
///
/// What has been seen is kept as points in the world, one for each pixel, and scattered to where it appears now; the
/// samples of the new frame, its holes filled from around, join it by quality. No buffer is needed where nothing was
/// traced.
///
/// A pixel of a frame was traced if its colour is finite and its place is known: its `position`, or else its `depth`,
/// +inf where nothing was hit. All others are missing, whatever is in their buffers; NaN says so. Every frame needs a
/// camera. The pattern of traced pixels should change from frame to frame, so that each is traced at some time.
///
/// Parameters
/// ----------
/// preset : {"best", "textbook"}, default "best"
///     Where the other parameters come from that are not given: our own measurements; the method as its source
///     describes it, with ``factor=4, levels=2, nearness=1, history="fetch", share=(0.1, 0.5)``.
/// factor : int, optional
///     By how much the levels that fill holes grow, 2 to 16: as for `pull_push`. "best" has 2.
/// levels : int, optional
///     How many of them, at least 1. "best" has as many as there can be.
/// nearness : int, optional
///     Power of the inverse of depth by which samples weigh where holes are filled, 0 to 4: near samples override
///     distant ones. "best" has 0.
/// history : {"splat", "fetch"}, optional
///     Whether what was known is scattered to where it appears now, or read where each pixel comes from, by the motion
///     of the new samples. "best" has "splat".
/// blur, share, fade, limit : optional
///     As for `recirculate`. "best" has its defaults. The blur is not carried on if history is splatted.
/// tolerance : float, optional
///     As for `splat`; and by how much a sample's depth may differ, as a share of it, from that of what was known
///     there. Both have 0.1. Without effect if history is fetched.
/// innovation : bool, optional
///     Whether what new samples, over blocks of pixels and a few frames, show to be wrong with the result is added to it
///     and to what is carried on (`innovation`): light that changes. It is a share of each pixel's own light, so that
///     fireflies in history grow with the light around them. "best" does it.
///
/// Raises
/// ------
/// ValueError
///     If a parameter is out of range, or a preset or history unknown.
///
/// Notes
/// -----
/// After "Reprojection 2", a developer's diary of 2008. Each step consists of this package's functions and
/// gives their bits: `pull_push` (of colour and the inverse of depth), `splat` (with a reach of 0.5), `motion_vectors`,
/// `recirculate`, without blur for the next frame and with it for the result, and from the second frame on `innovation`
/// (``sparse=True``, with the `exposure` of the result, and the motion of `recirculate`). A pixel's point lies where it was
/// sampled (`Frame.position` or `Frame.jitter`, else the centre), where it comes from, or, at the depth of those
/// around, in the centre. What is filled does not count beside what has eight times its quality, or what stands still
/// would never be as sharp as its samples. With `Frame.motion` where a pixel is traced, what moves by itself is taken
/// to go on as it did (`splat`'s drift); without, it stays behind until samples overwrite it.
///
/// Where holes are filled, a sample at depth ``z`` weighs ``max(z**-nearness, 1e-24)``, and the quality of a filled
/// pixel is divided by the weight at its depth, so that it counts samples.
///
/// Fetched history takes one `recirculate` (with `fetch`) of the image shown last, blur and all, along the motion of
/// the filled samples. No test tells whether it shows the same surface. It is read between pixels in every frame, which
/// softens it, and averages noise: the notebook `recirculation.ipynb` has both, beside the other choices of "textbook".
#[pyclass(extends = Pipeline, module = "yester")]
pub struct Recirculation {
    inner: recirculation::Recirculation,
}

#[pymethods]
impl Recirculation {
    #[new]
    #[pyo3(signature = (preset="best", *, factor=None, levels=None, nearness=None, history=None, blur=None, share=None,
        fade=None, limit=None, tolerance=None, innovation=None))]
    fn new(
        py: Python<'_>,
        preset: &str,
        factor: Option<i64>,
        levels: Option<i64>,
        nearness: Option<i64>,
        history: Option<&str>,
        blur: Option<f32>,
        share: Option<(f32, f32)>,
        fade: Option<f32>,
        limit: Option<f32>,
        tolerance: Option<f32>,
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
        if let Some(innovation) = innovation {
            params.innovation = innovation.then_some(recirculation::INNOVATION);
        }
        let inner = recirculation::Recirculation::new(params)?;
        Ok(Pipeline::made(Self { inner }))
    }

    /// Completes the next frame of the sequence.
    ///
    /// Parameters
    /// ----------
    /// frame : Frame
    ///     Of the same size as those before, with camera, and depth or position.
    /// out : Output, optional
    ///     Of an earlier step, no longer needed: its arrays are overwritten and returned, instead of new ones.
    ///
    /// Returns
    /// -------
    /// Output
    ///     Without a variance. `history_length` is the quality that is carried on: 1 for a sample, and more for
    ///     several; the smaller, the farther off samples are. `confidence` is 1 where the past knows the pixel, else 0;
    ///     `rejection` is OUTSIDE where no point of the past came to be, or motion leads to none, and DEPTH where a sample
    ///     shows that another surface has taken its place. As long as nothing at all has been traced, colour is black.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If the frame has no camera, or neither depth nor position; if the size changes without `reset` in between;
    ///     if `out` does not fit.
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
