//! Half-resolution tracing.

use pyo3::prelude::*;

use super::{Extras, FrameArgs, Output, Pipeline, Room};
use crate::error::whole;
use crate::kernels::judge::{choice, innovation};
use crate::kernels::merge::accumulate;
use crate::kernels::smooth::{atrous, fireflies, joint_bilateral, lend};
use crate::pipelines::frame::Pipeline as _;
use crate::pipelines::svgf;

/// Denoising of frames of which only a part is traced: one pixel of each 2×2, another one in each frame.
///
/// Frames are whole: all buffers have full resolution, and colour is NaN where no path was traced. What was not traced is
/// reconstructed from what was near it on the same surface, and counts as a part of a sample, ever less. History is carried
/// along, each tap tested, merged with both, and filtered, as `SVGF` does it. Any pattern, and any share of the pixels,
/// will do; what follows from frame to frame should reach all of them, as `HalfRes.offset` does.
///
/// Parameters
/// ----------
/// alpha : float, default 0.2
///     Least share of a traced sample in its pixel's history, 0 to 1: with a quarter traced, 0.2 remembers for as many
///     frames as 0.05 of `SVGF`.
/// weight : float, default 0.1
///     How much of a sample a reconstructed one is where nothing else is known, above 0 to 1.
/// radius : int, default 2
///     Samples up to so many pixels to each side lend to a pixel that has none, 1 to 16.
/// iterations : int, default 5
///     Passes of the spatial filter, 0 to 16.
/// sigma_luminance : float, default 4.0
///     Luminance difference that counts as one in the filter, in standard deviations; above 0.
/// by_confidence, fireflies : bool, default False
/// reflections : sequence of float, default (0.5, 2.0)
/// choice : bool, default False
///     As in `SVGF`. Most scenes gain; highlights that few samples hit can lose.
/// innovation : bool, default True
///     As in `SVGF`.
/// antialias : bool, default True
///     As in `SVGF`.
///
/// Raises
/// ------
/// ValueError
///     If a parameter is out of range.
///
/// Notes
/// -----
/// Each step is that of `SVGF` with one more of this package's functions: the demodulated colour goes
/// through `reconstruct`, and on to `accumulate` with a weight of 1 where it was traced, and elsewhere of
/// ``weight / (1 + N)``, N being the reprojected history's length: a history without end becomes the mean of its own
/// samples. The gradient, in windows twice as wide, and the reflections look at what was traced alone, and the last stage
/// clips history to 0.6 standard deviations.
///
/// Examples
/// --------
/// With ``trace(pixels)`` a renderer that returns the colours of some pixels:
///
/// >>> half_res = yester.HalfRes()
/// >>> for number, buffers in enumerate(sequence):
/// ...     x, y = yester.HalfRes.offset(number)
/// ...     color = np.full((height, width, 3), np.nan, np.float32)
/// ...     color[y::2, x::2] = trace(pixels[y::2, x::2])
/// ...     output = half_res.step(yester.Frame(color, **buffers))
#[pyclass(extends = Pipeline, module = "yester")]
pub struct HalfRes {
    inner: svgf::Svgf,
}

#[pymethods]
impl HalfRes {
    #[new]
    #[pyo3(signature = (*, alpha=0.2, weight=0.1, radius=2, iterations=5, sigma_luminance=4.0,
        by_confidence=false, fireflies=false, reflections=vec![0.5, 2.0], choice=false, innovation=true, antialias=true))]
    #[pyo3(
        text_signature = "(*, alpha=0.2, weight=0.1, radius=2, iterations=5, sigma_luminance=4.0, \
        by_confidence=False, fireflies=False, reflections=(0.5, 2.0), choice=False, innovation=True, antialias=True)"
    )]
    fn new(
        alpha: f32,
        weight: f32,
        radius: i64,
        iterations: i64,
        sigma_luminance: f32,
        by_confidence: bool,
        fireflies: bool,
        reflections: Vec<f32>,
        choice: bool,
        innovation: bool,
        antialias: bool,
    ) -> PyResult<PyClassInitializer<Self>> {
        let window = joint_bilateral::Params {
            radius: joint_bilateral::Params::radius(radius)?,
            ..Default::default()
        };
        let whole = svgf::Params::half_res(lend::Params { weight, window });
        let params = svgf::Params {
            accumulate: accumulate::Params {
                alpha,
                ..whole.accumulate
            },
            atrous: atrous::Params {
                iterations: atrous::Params::iterations(iterations)?,
                sigma_luminance,
                ..whole.atrous
            },
            by_confidence,
            fireflies: fireflies.then(fireflies::Params::default),
            reflections,
            choice: choice.then(choice::Params::default),
            innovation: innovation.then(innovation::Params::default),
            antialias: whole.antialias.filter(|_| antialias),
            ..whole
        };
        let inner = svgf::Svgf::new(params)?;
        Ok(Pipeline::made(Self { inner }))
    }

    /// Denoises the next frame of the sequence.
    ///
    /// Parameters
    /// ----------
    /// frame : Frame
    ///     Of the same size as those before; NaN where nothing was traced.
    /// out : Output, optional
    ///     Of an earlier step, no longer needed: its arrays are overwritten and returned, instead of new ones. From the
    ///     second frame on no memory for images is then asked for.
    ///
    /// Returns
    /// -------
    /// Output
    ///     `history_length` counts traced samples; `missing` is the number of pixels that had none.
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

    /// The pixel of each 2×2 to trace in a frame: all of them in four, and two diagonal ones in any two of these pairs.
    ///
    /// Parameters
    /// ----------
    /// number : int
    ///     Of the frame, from 0.
    ///
    /// Returns
    /// -------
    /// (int, int)
    ///     x and y, 0 or 1.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If the number is negative.
    #[staticmethod]
    fn offset(number: i64) -> PyResult<(usize, usize)> {
        let number: usize = whole("number", number, "a number from 0", |_| true)?;
        Ok([(0, 0), (1, 1), (1, 0), (0, 1)][number % 4])
    }
}
