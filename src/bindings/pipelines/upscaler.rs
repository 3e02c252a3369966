//! Temporal upscaling.

use pyo3::prelude::*;

use super::{FrameArgs, Output, Pipeline};
use crate::bindings::judge::Bounds;
use crate::kernels::judge::blend_factor;
use crate::pipelines::Pipeline as _;
use crate::pipelines::upscaler;

/// Temporal upscaling of a sequence of frames.
///
/// Every frame is rendered small, each with its samples at another place in their pixels (`jitter`); the history, of the
/// size of the output, gathers what all of them saw. All buffers of a frame have the small size; all but colour may be
/// absent: without depth nothing is known to have been hidden, without motion, it is computed from the cameras if both
/// frames have one and depth or position is known, and otherwise history stays in place. A frame that does not tell its
/// jitter counts as not jittered: what is no larger than its pixels stays unknown then, however many there are.
///
/// Parameters
/// ----------
/// scale : float, default 2.0
///     Pixels of the output to one of the input, along each side, 1 to 4; made for 1.3 to 3. Sides are rounded, halves to
///     even. About ``8 * scale**2`` phases of jitter show everything: ``jitter(32)`` for 2.
/// alpha : float, default 0.06
///     Least share of one more sample per pixel of the output in its history, 0 to 1, where all stands still.
/// fast_alpha : float, default 0.5
///     The same for fast motion.
/// speed : float or (float, float), default (0, 1)
///     Output pixels up to which motion is slow, and from which it is fast.
/// separation : float, default 0.05
///     As in `disocclusion`.
/// lifetime : float, default 16
///     Frames after which the lock of a thin feature opens that is no longer seen; above 0.
/// sharpness : float, default 0.0
///     Strength of `sharpen`, 0 (off) to 1. What is remembered is not sharpened.
///
/// Raises
/// ------
/// ValueError
///     If a parameter is out of range.
///
/// Notes
/// -----
/// After AMD's FSR 2 in its parts. Each step consists of this package's functions and gives their bits: `dilate_motion`,
/// `disocclusion`, `thin_features`, `resample` (colour by "lanczos-2", all else by "nearest"), `reproject` with
/// "catmull-rom" and without tests, `temporal_gradient` between the new samples and the history at their places,
/// `clip_history`, `blend_factor`, `blend` and `sharpen`. A history of N samples per pixel meets a new frame of weight w with
/// a share of w/(N + w); clipping is undone where all stands still, as far as the gradient sees no change, and where a thin
/// feature is locked. `Output.history_length` counts samples per pixel of the output.
#[pyclass(extends = Pipeline, module = "yester")]
pub struct Upscaler {
    inner: upscaler::Upscaler,
}

#[pymethods]
impl Upscaler {
    #[new]
    #[pyo3(signature = (scale=2.0, *, alpha=0.06, fast_alpha=0.5, speed=Bounds::Soft(0.0, 1.0), separation=0.05,
        lifetime=16.0, sharpness=0.0))]
    #[pyo3(
        text_signature = "(scale=2.0, *, alpha=0.06, fast_alpha=0.5, speed=(0.0, 1.0), separation=0.05, \
        lifetime=16.0, sharpness=0.0)"
    )]
    fn new(
        scale: f64,
        alpha: f32,
        fast_alpha: f32,
        speed: Bounds,
        separation: f32,
        lifetime: f32,
        sharpness: f32,
    ) -> PyResult<PyClassInitializer<Self>> {
        let params = upscaler::Params {
            scale,
            blend_factor: blend_factor::Params {
                alpha,
                fast_alpha,
                speed: speed.into(),
            },
            separation,
            lifetime,
            sharpness,
        };
        let inner = upscaler::Upscaler::new(params)?;
        Ok(Pipeline::made(Self { inner }))
    }

    /// Upscales the next frame of the sequence.
    ///
    /// Parameters
    /// ----------
    /// frame : Frame
    ///     Of the same size as those before. Its `reactive` mask, if it has one, says where history may not show.
    /// out : Output, optional
    ///     Of an earlier step, no longer needed: its arrays are overwritten and returned, instead of new ones.
    ///
    /// Returns
    /// -------
    /// Output
    ///     Of the large size, without a variance.
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
