//! Block-wise multi-order feature regression.

use pyo3::prelude::*;

use super::{FrameArgs, Output, Pipeline, alone};
use crate::bindings::arrays::choice;
use crate::kernels::fetch::validate;
use crate::kernels::fetch::validate::Threshold;
use crate::kernels::merge::accumulate;
use crate::kernels::smooth::{fireflies, regress};
use crate::pipelines::Pipeline as _;
use crate::pipelines::{bmfr, history};

/// Block-wise multi-order feature regression of a sequence of frames.
///
/// Accumulates samples as `SVGF` does, fits the illumination of each block of pixels to its feature buffers, and
/// accumulates the fits. Detail that no feature describes, such as shadow edges and reflections, is blurred within a
/// block; it returns once enough samples are accumulated to tell it from noise. Buffers that a frame lacks drop
/// out of the tests and features. Positions are the frame's, or computed from depth and camera.
///
/// Parameters
/// ----------
/// alpha : float, default 0.05
///     Smallest weight of the new sample in the history, 0 to 1.
/// fitted_alpha : float, default 0.1
///     Smallest weight of the new fit in the history of fits, 0 to 1.
/// block : int, optional
///     Side of the blocks in pixels, 4 to 256. By default 16, and 8 in frames without albedo, whose texture no feature
///     tells. The paper has 32, for images of 1280×720.
/// by_light : bool, default True
///     Give pixels less weight in a fit where light is bright, as of lamps and highlights: ``1 / (1 + x)**2`` with ``x
///     = l / 2e`` without albedo and ``x = (l / 16e)**2`` with it, l being the mean luminance of the accumulated light
///     over 3×3 pixels and e its `exposure`. The differences by which new samples correct the output have the same
///     weights.
/// features : {"fewest", "all"}, default "fewest"
///     As in `regress`.
/// restore : bool, default True
///     Give the fits back what detail the accumulated light shows beyond its noise (`restore_detail`), unless frames
///     repeat each other's noise.
/// relative_depth, plane_distance, normal_angle : float or (float, float), default 0.1, 0.01 and 25.0
///     As in `SVGF`.
/// motion_difference : float or (float, float), default 0.2
///     As in `SVGF`.
/// by_confidence : bool, default False
///     Raise the new sample's weight where confidence in history is low: ``alpha + (1 - confidence) (1 - alpha)``.
/// gradient : bool, default True
///     Correct and shorten history where the light changes, as in `SVGF`, with ``noise=2.2, passes=3, widest=5`` in
///     `temporal_gradient`.
/// fireflies : bool, default False
///     First clamp samples far brighter than their surroundings and their history, and redistribute the excess over
///     their surface (`suppress_fireflies`).
/// innovation : bool, default True
///     Add the error of the fits, as estimated from new samples, to the fits and to the history, and correct the output
///     stage, as in `SVGF`.
/// antialias : bool, default True
///     End with a stage of temporal antialiasing, `TAA` with preset "denoised".
///
/// Raises
/// ------
/// ValueError
///     If a parameter is out of range.
///
/// See Also
/// --------
/// regress : Fits one frame.
/// SVGF : Filters instead of fitting.
///
/// Notes
/// -----
/// The method is that of Koskela et al. [1]_. Each step consists of this package's functions and gives their bits:
/// `motion_vectors`, `depth_change` (without cameras), `is_reflectance` (with albedo), `material_ids` (with albedo,
/// without ids), `demodulate`, `reproject` (with `consistency`), `light_change` (with `innovation`, without a replay),
/// `suppress_fireflies`, `temporal_gradient`, `accumulate`, `exposure` (with `by_light`), `regress`, `blend`,
/// `repetition`, `clip_history` and `restore_detail`, `innovation`, `remodulate`, and those of `TAA`, corrected as in
/// `SVGF`. From frame to frame the grid of blocks is offset by (0, 0), (4, 4), (2, 6), (6, 2), (1, 3), (5, 7), (3, 1)
/// and (7, 5) eighths of a block. Pixels with black albedo are not fitted if they have emission, or if their light has
/// no noise (``m2 - m1² <= 0.01 m1²``), as lamps and background. Dark surfaces weigh less, ``min(1, d / 0.15)**2`` with
/// ``1 / d`` the luminance of what demodulation multiplies light by: their highlights and unknown emission are divided
/// by it, too. The weight of the N-th fit is at least 1/N. Detail is restored with a strictness of 0.7. It comes from
/// the accumulated light of histories of at least 3.5 samples, clipped by ``clip_history(box="minmax", space="rgb",
/// response="clamp")`` to the new samples, and its variance is ``(m2 - m1²) / N``. With `by_light`, what exceeds both
/// fit and own new sample is divided by ``(1 + x / 8)**2``: history beside a lamp contains some of it.
///
/// References
/// ----------
/// .. [1] M. Koskela, K. Immonen, M. Mäkitalo, A. Foi, T. Viitanen, P. Jääskeläinen, H. Kultala, J. Takala, "Blockwise
///    multi-order feature regression for real-time path-tracing reconstruction", ACM Transactions on Graphics 38(5),
///    2019.
///
/// Examples
/// --------
/// >>> rng = np.random.default_rng(0)
/// >>> depth = np.full((32, 32), 2.0)
/// >>> camera = yester.Camera.from_look_at([0, 0, 0], [0, 0, 1], [0, 1, 0], fov=60, width=32, height=32)
/// >>> pipeline = yester.BMFR()
/// >>> for _ in range(8):
/// ...     frame = yester.Frame(rng.gamma(1, 0.5, (32, 32, 3)), depth=depth, camera=camera)
/// ...     output = pipeline.step(frame)
/// >>> bool(output.color.std() < frame.color.std() / 5)
/// True
#[pyclass(extends = Pipeline, module = "yester")]
pub struct BMFR {
    inner: bmfr::Bmfr,
}

#[pymethods]
impl BMFR {
    #[new]
    #[pyo3(signature = (*, alpha=0.05, fitted_alpha=0.1, block=None, by_light=true, features="fewest", restore=true,
        relative_depth=Threshold::hard(0.1), plane_distance=Threshold::hard(0.01), normal_angle=Threshold::hard(25.0),
        motion_difference=Threshold::hard(0.2), by_confidence=false, gradient=true, fireflies=false, innovation=true, antialias=true))]
    #[pyo3(
        text_signature = "(*, alpha=0.05, fitted_alpha=0.1, block=None, by_light=True, features='fewest', restore=True, \
        relative_depth=0.1, plane_distance=0.01, normal_angle=25.0, motion_difference=0.2, by_confidence=False, gradient=True, \
        fireflies=False, innovation=True, antialias=True)"
    )]
    fn new(
        alpha: f32,
        fitted_alpha: f32,
        block: Option<i128>,
        by_light: bool,
        features: &str,
        restore: bool,
        relative_depth: Threshold,
        plane_distance: Threshold,
        normal_angle: Threshold,
        motion_difference: Threshold,
        by_confidence: bool,
        gradient: bool,
        fireflies: bool,
        innovation: bool,
        antialias: bool,
    ) -> PyResult<PyClassInitializer<Self>> {
        let default = bmfr::Params::default();
        let params = bmfr::Params {
            history: history::Params {
                surface: validate::Params {
                    relative_depth,
                    plane_distance,
                    normal_angle,
                    motion_difference,
                    ..default.history.surface
                },
                accumulate: accumulate::Params {
                    alpha,
                    ..default.history.accumulate
                },
                by_confidence,
                gradient: default.history.gradient.filter(|_| gradient),
                fireflies: fireflies.then(fireflies::Params::default),
                innovation: default.history.innovation.filter(|_| innovation),
                ..default.history
            },
            block: block.map(regress::Params::block).transpose()?,
            by_light,
            features: choice("features", features, &regress::Params::FEATURES)?,
            restore: default.restore.filter(|_| restore),
            fitted_alpha,
            antialias: default.antialias.filter(|_| antialias),
        };
        let inner = bmfr::Bmfr::new(params)?;
        Ok(Pipeline::made(Self { inner }))
    }

    /// Denoise the next frame of the sequence.
    ///
    /// Parameters
    /// ----------
    /// frame : Frame
    ///     The next frame, of the same size as the previous ones.
    /// out : Output, optional
    ///     An earlier step's output whose arrays are overwritten and returned, instead of new ones.
    ///
    /// Returns
    /// -------
    /// Output
    ///     Without a variance.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If the size changes, or albedo appears or vanishes, without `reset` in between; if `out` does not fit.
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
