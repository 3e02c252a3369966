//! Half-resolution tracing.

use pyo3::prelude::*;

use super::Pipeline;
use super::svgf::SVGF;
use crate::error::whole;
use crate::kernels::merge::accumulate;
use crate::kernels::smooth::{atrous, fireflies, joint_bilateral};
use crate::pipelines::{history, svgf};

/// Denoise frames of which only a part is traced, such as one pixel of each 2×2, another one in each frame.
///
/// All buffers have full resolution, and colour is NaN where no path was traced. Untraced pixels are reconstructed from
/// traced neighbours on the same surface; a reconstructed colour counts for a fraction of a sample, the smaller the
/// longer the history. The rest is `SVGF` with other parameters: history is reprojected, validated tap by tap, merged
/// with traced and reconstructed samples, and filtered. Any pattern and density of traced pixels works; the patterns of
/// successive frames should cover all pixels, as those of `HalfRes.offset` do.
///
/// Parameters
/// ----------
/// alpha : float, default 0.2
///     Smallest weight of a traced sample in its pixel's history, 0 to 1: with a quarter of the pixels traced, 0.2
///     averages over as many frames as 0.05 in `SVGF`.
/// weight : float, default 0.3
///     The fraction of a sample that a reconstructed colour counts for without history, above 0 to 1.
/// radius : int, default 2
///     Radius in pixels of the window from which untraced pixels are reconstructed, 1 to 16.
/// iterations : int, default 4
///     Passes of the spatial filter, 0 to 16.
/// sigma_luminance : float, default 4.0
///     The filter's scale of luminance differences, in standard deviations; above 0.
/// relative_noise, tap_exposure : float, default 2.0 and 16.0
///     As in `SVGF`; the latter for pixels of 1.75 samples or more.
/// by_confidence, fireflies : bool, default False
///     As in `SVGF`.
/// reflections : sequence of float, default (0.2, 0.4, 0.7, 1.2)
///     As in `SVGF`.
/// choice : bool, optional
///     As in `SVGF`. By default in frames without albedo alone: with it, most scenes gain little, and highlights that
///     few samples hit can get worse.
/// innovation : bool, default True
///     As in `SVGF`.
/// antialias : bool, default True
///     End with a stage of temporal antialiasing, ``TAA("denoised", unguided_alpha=0.5, gamma=0.6, choice=False)``.
///
/// Raises
/// ------
/// ValueError
///     If a parameter is out of range.
///
/// See Also
/// --------
/// SVGF : For frames that are traced as a whole.
/// Recirculation : Keeps history as points, for few traced pixels.
/// reconstruct : Fills untraced pixels.
///
/// Notes
/// -----
/// An output's `history_length` counts traced samples, and reconstructed ones by their weight; its `missing` is the
/// number of untraced pixels.
///
/// Each step is that of `SVGF` with one more function: the demodulated colour goes through `reconstruct`, then to
/// `accumulate` with weight 1 where it was traced and ``weight / (1 + N)`` elsewhere, N being the reprojected history
/// length, so that a long history converges to the mean of its own samples. The gradient and the reflections use traced
/// samples only. Besides the parameters above, these differ from `SVGF`: the filter has 5×5 taps (``radius=2`` in
/// `atrous`); `choice` has ``strictness=1`` instead of 0.5, and uses predictions that are worth 0.9 samples or more
/// instead of 2.5; `temporal_gradient` has ``noise=2.4, passes=4, widest=6``, whose windows are twice as wide; and the
/// last stage clips history to 0.6 standard deviations.
///
/// Examples
/// --------
/// >>> half_res = yester.HalfRes()
/// >>> for number in range(4):
/// ...     x, y = yester.HalfRes.offset(number)
/// ...     color = np.full((8, 8, 3), np.nan)
/// ...     color[y::2, x::2] = 1
/// ...     output = half_res.step(yester.Frame(color))
/// >>> output.missing
/// 48
/// >>> output.history_length[:2, :2]
/// array([[1.4206, 1.6493],
///        [1.7267, 1.5539]], dtype=float32)
#[pyclass(extends = SVGF, module = "yester")]
pub struct HalfRes;

#[pymethods]
impl HalfRes {
    #[new]
    #[pyo3(signature = (*, alpha=0.2, weight=0.3, radius=2, iterations=4, sigma_luminance=4.0, relative_noise=2.0,
        tap_exposure=16.0, by_confidence=false, fireflies=false, reflections=vec![0.2, 0.4, 0.7, 1.2], choice=None, innovation=true, antialias=true))]
    #[pyo3(
        text_signature = "(*, alpha=0.2, weight=0.3, radius=2, iterations=4, sigma_luminance=4.0, \
        relative_noise=2.0, tap_exposure=16.0, by_confidence=False, fireflies=False, reflections=(0.2, 0.4, 0.7, 1.2), choice=None, innovation=True, antialias=True)"
    )]
    fn new(
        alpha: f32,
        weight: f32,
        radius: i128,
        iterations: i128,
        sigma_luminance: f32,
        relative_noise: f32,
        tap_exposure: f32,
        by_confidence: bool,
        fireflies: bool,
        reflections: Vec<f32>,
        choice: Option<bool>,
        innovation: bool,
        antialias: bool,
    ) -> PyResult<PyClassInitializer<Self>> {
        let whole = svgf::Params::half_res(weight, joint_bilateral::Params::radius(radius)?);
        let params = svgf::Params {
            history: history::Params {
                accumulate: accumulate::Params {
                    alpha,
                    ..whole.history.accumulate
                },
                by_confidence,
                fireflies: fireflies.then(fireflies::Params::default),
                innovation: whole.history.innovation.filter(|_| innovation),
                ..whole.history
            },
            atrous: atrous::Params {
                iterations: atrous::Params::iterations(iterations)?,
                sigma_luminance,
                relative_noise,
                ..whole.atrous
            },
            tap_exposure,
            reflections,
            choice: whole.choice.filter(|_| choice != Some(false)),
            choice_with_albedo: choice == Some(true),
            antialias: whole.antialias.filter(|_| antialias),
            ..whole
        };
        let inner = svgf::Svgf::new(params)?;
        Ok(Pipeline::made(SVGF { inner }).add_subclass(Self))
    }

    /// Choose the pixel of each 2×2 to trace in a frame.
    ///
    /// Four frames cover all pixels, and each even frame and the next a diagonal.
    ///
    /// Parameters
    /// ----------
    /// number : int
    ///     Frame number, from 0.
    ///
    /// Returns
    /// -------
    /// (int, int)
    ///     Its x and y in the block, 0 or 1.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If the number is negative.
    ///
    /// Examples
    /// --------
    /// >>> [yester.HalfRes.offset(number) for number in range(4)]
    /// [(0, 0), (1, 1), (1, 0), (0, 1)]
    #[staticmethod]
    fn offset(number: i128) -> PyResult<(usize, usize)> {
        let number: usize = whole("number", number, "a number from 0", |_| true)?;
        Ok([(0, 0), (1, 1), (1, 0), (0, 1)][number % 4])
    }
}
