//! Temporal upscaling.

use pyo3::prelude::*;

use super::{FrameArgs, Output, Pipeline, alone};
use crate::kernels::fetch::validate::Threshold;
use crate::kernels::judge::blend_factor;
use crate::kernels::smooth::fireflies;
use crate::pipelines::Pipeline as _;
use crate::pipelines::upscaler;

/// Temporal upscaling of a sequence of frames.
///
/// Every frame is rendered at low resolution with a different sub-pixel offset (`jitter`); a history at output
/// resolution accumulates their samples. All buffers of a frame have the low resolution, and all but colour are
/// optional: without depth, disocclusions are not detected; without motion, it is computed from the cameras if both
/// frames have one and depth or position is known; otherwise history is read in place. A frame without jitter
/// information counts as not jittered, so that no sub-pixel detail can be recovered, however many frames there are.
///
/// Parameters
/// ----------
/// scale : float, default 2.0
///     Ratio of output to input size along each side, 1 to 4; tuned for 1.3 to 3. Output sizes are rounded, halves to
///     even. About ``8 * scale**2`` phases of jitter cover the output grid: ``jitter(32)`` for 2.
/// alpha : float, default 0.06
///     Smallest weight, 0 to 1, of a sample per output pixel in static history.
/// fast_alpha : float, default 0.5
///     Smallest weight in fast motion, 0 to 1.
/// speed : float or (float, float), default (0, 1)
///     Output pixels up to which motion is slow, and from which it is fast.
/// separation : float, default 0.05
///     As in `disocclusion`.
/// lifetime : float, default 16
///     Frames until the lock of a thin feature expires after its last detection; above 0.
/// sharpness : float, default 0.0
///     Strength of `sharpen`, 0 (off) to 1. History is not sharpened.
/// fireflies : bool, default False
///     First clamp samples far brighter than their surroundings and their history, and redistribute the excess over
///     their surface (`suppress_fireflies`).
///
/// Raises
/// ------
/// ValueError
///     If a parameter is out of range.
///
/// See Also
/// --------
/// resample : Upscales one frame.
/// TAA : Antialiases without upscaling.
/// jitter : Sub-pixel offsets.
///
/// Notes
/// -----
/// Its parts follow AMD's FSR 2 [1]_. Each step consists of this package's functions and gives their bits:
/// `dilate_motion`, `disocclusion`, `reproject` with "catmull-rom-5" and without tests, `suppress_fireflies`,
/// `thin_features`, `resample` (colour by "lanczos-2", all else by "nearest"), `temporal_gradient` between the new
/// samples and the history at their places, `clip_history`, `blend_factor`, `blend` and `sharpen`. A new frame of
/// weight w is blended into a history of N samples per pixel with w/(N + w). Clipping is undone in static pixels,
/// unless the light changes in a cell of 2×2 samples (``passes=1``), and where a thin feature is locked, unless more
/// than a quarter of the light changes around it (``passes=3``). `Output.history_length` counts samples per output
/// pixel.
///
/// References
/// ----------
/// .. [1] AMD, "FidelityFX Super Resolution 2", GPUOpen, 2022.
///
/// Examples
/// --------
/// >>> upscaler = yester.Upscaler(2.0)
/// >>> for jitter in yester.jitter(32):
/// ...     output = upscaler.step(yester.Frame(np.ones((8, 8, 3)), jitter=jitter))
/// >>> output.color.shape
/// (16, 16, 3)
#[pyclass(extends = Pipeline, module = "yester")]
pub struct Upscaler {
    inner: upscaler::Upscaler,
}

#[pymethods]
impl Upscaler {
    #[new]
    #[pyo3(signature = (scale=2.0, *, alpha=0.06, fast_alpha=0.5, speed=Threshold { full: 0.0, none: 1.0 }, separation=0.05,
        lifetime=16.0, sharpness=0.0, fireflies=false))]
    #[pyo3(
        text_signature = "(scale=2.0, *, alpha=0.06, fast_alpha=0.5, speed=(0.0, 1.0), separation=0.05, \
        lifetime=16.0, sharpness=0.0, fireflies=False)"
    )]
    fn new(
        scale: f64,
        alpha: f32,
        fast_alpha: f32,
        speed: Threshold,
        separation: f32,
        lifetime: f32,
        sharpness: f32,
        fireflies: bool,
    ) -> PyResult<PyClassInitializer<Self>> {
        let params = upscaler::Params {
            scale,
            blend_factor: blend_factor::Params {
                alpha,
                fast_alpha,
                speed,
            },
            separation,
            lifetime,
            sharpness,
            fireflies: fireflies.then(fireflies::Params::default),
        };
        let inner = upscaler::Upscaler::new(params)?;
        Ok(Pipeline::made(Self { inner }))
    }

    /// Upscale the next frame of the sequence.
    ///
    /// Parameters
    /// ----------
    /// frame : Frame
    ///     The next frame, of the same size as the previous ones. Its `reactive` mask, if any, excludes history.
    /// out : Output, optional
    ///     An earlier step's output whose arrays are overwritten and returned, instead of new ones.
    ///
    /// Returns
    /// -------
    /// Output
    ///     At output resolution, without a variance.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If the size changes without `reset` in between; if `out` does not fit.
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
