//! The kernels of the smooth folder.

use numpy::PyArrayDyn;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use super::arrays::{
    COLOR, Channels, Direct, Input, Out, detached, fill_parts, needs, refuse_mask, wrong_type,
};
use crate::error::{finite_above_0, in_range};
use crate::image::Size;
use crate::kernels::fetch::validate::Surface;
use crate::kernels::smooth::demodulate::{self, Texture, Way};
use crate::kernels::smooth::edges::smooth_edges;
use crate::kernels::smooth::guide::{Guide, Sigmas};
use crate::kernels::smooth::material::Materials;
use crate::kernels::smooth::reflectance::Surfaces;
use crate::kernels::smooth::restore::{self, restore_detail};
use crate::kernels::smooth::variance::{self, Estimate, estimate_variance};
use crate::kernels::smooth::{atrous, fireflies, history_fix, morphological};
use crate::pixels::PixelsMut;

/// The guide's checked arguments.
pub(super) struct GuideArgs<'py> {
    depth: Option<Input<'py>>,
    normal: Option<Input<'py>>,
    ids: Option<Input<'py, u32>>,
}

impl<'py> GuideArgs<'py> {
    pub(super) fn new(
        size: Size,
        depth: Option<&Bound<'py, PyAny>>,
        normal: Option<&Bound<'py, PyAny>>,
        ids: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Self> {
        Ok(Self {
            depth: Input::optional(depth, "depth", Channels::One, size)?,
            normal: Input::optional(normal, "normal", COLOR, size)?,
            ids: Input::optional(ids, "ids", Channels::One, size)?,
        })
    }

    pub(super) fn surface(&self) -> Surface<'_> {
        Surface {
            depth: self.depth.as_ref().map(Input::pixels),
            normal: self.normal.as_ref().map(Input::pixels),
            ids: self.ids.as_ref().map(Input::pixels),
            ..Default::default()
        }
    }
}

/// The arguments `sigma_normal`, `sigma_depth` and `sigma_plane`.
pub(super) fn sigmas(normal: f32, depth: f32, plane: f32) -> Sigmas {
    Sigmas {
        normal,
        depth,
        plane,
    }
}

/// Estimate the variance of luminance: temporal for long histories, spatial for short ones.
///
/// Parameters
/// ----------
/// moments : (H, W, 2) array_like of float
///     Means of luminance and of its square, as `accumulate` returns them.
/// history_length : (H, W) array_like of float
///     History length in samples.
/// depth : (H, W) array_like of float, optional
///     View-space z, +inf where nothing was hit.
/// normal : (H, W, 3) array_like of float, optional
///     World space, unit length.
/// ids : (H, W) array_like of int, optional
///     Pixels with different ids do not mix.
/// min_length : float, default 3.5
///     History length from which the temporal variance is used; at least 1. The default is fractional so that rounding
///     of resampled lengths does not decide.
/// radius : int, default 3
///     The spatial window reaches so many pixels to each side, 0 to 16.
/// sigma_normal, sigma_depth, sigma_plane : float, default 128.0, 0.5 and 0.05
///     As in `atrous`.
/// out : (H, W) float32 array, optional
///     Written and returned instead of a new array; it may be an input.
///
/// Returns
/// -------
/// variance : (H, W) float32
///     In squared luminance; 0 for values below 1e-30 and for pixels without valid moments in their window.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes or parameters out of range.
///
/// See Also
/// --------
/// accumulate : Returns the moments.
/// atrous : Takes the variance.
///
/// Notes
/// -----
/// A history of at least `min_length` gives ``m2 - m1²``. A shorter one, or one without valid moments, takes the
/// moments' means over the window, weighted as in `atrous` but for kernel and luminance, and multiplies the variance by
/// ``max(min_length / max(N, 1), 1)``, as SVGF does ([1]_, section 4.2, and its implementation in Falcor [2]_).
///
/// References
/// ----------
/// .. [1] C. Schied, A. Kaplanyan, C. Wyman, A. Patney, C. R. A. Chaitanya, J. Burgess, S. Liu, C. Dachsbacher, A.
///    Lefohn, M. Salvi, "Spatiotemporal variance-guided filtering: real-time reconstruction for path-traced global
///    illumination", High-Performance Graphics, 2017.
/// .. [2] NVIDIA, "Falcor", github.com/NVIDIAGameWorks/Falcor, render pass SVGFPass.
///
/// Examples
/// --------
/// >>> moments = np.tile([0.5, 0.35], (4, 4, 1))
/// >>> yester.estimate_variance(moments, np.full((4, 4), 20.0))[0].round(3)
/// array([0.1, 0.1, 0.1, 0.1], dtype=float32)
/// >>> yester.estimate_variance(moments, np.full((4, 4), 1.0))[0].round(3)
/// array([0.35, 0.35, 0.35, 0.35], dtype=float32)
#[pyfunction]
#[pyo3(signature = (moments, history_length, *, depth=None, normal=None, ids=None, min_length=3.5,
    radius=3, sigma_normal=128.0, sigma_depth=0.5, sigma_plane=0.05, out=None))]
#[pyo3(name = "estimate_variance")]
pub fn estimate_variance_<'py>(
    py: Python<'py>,
    moments: &Bound<'py, PyAny>,
    history_length: &Bound<'py, PyAny>,
    depth: Option<&Bound<'py, PyAny>>,
    normal: Option<&Bound<'py, PyAny>>,
    ids: Option<&Bound<'py, PyAny>>,
    min_length: f32,
    radius: i128,
    sigma_normal: f32,
    sigma_depth: f32,
    sigma_plane: f32,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let sigmas = sigmas(sigma_normal, sigma_depth, sigma_plane);
    let params = variance::Params {
        min_length,
        radius: variance::Params::radius(radius)?,
        sigmas,
    };
    params.check()?;
    let variance = {
        let moments = Input::<f32>::new(moments, "moments", Channels::Of(&[2]))?;
        let size = moments.size();
        let length = Input::<f32>::of_size(history_length, "history_length", Channels::One, size)?;
        let guide = GuideArgs::new(size, depth, normal, ids)?;
        let out = Out::given(out, &[size.height, size.width])?;
        let (moments, length, guide) = (moments.pixels(), length.pixels(), guide.surface());
        out.fill(py, |variance| {
            let guide = Guide::new(size, params.radius, guide, None);
            let estimate = Estimate::new(moments, length, &guide, params);
            estimate_variance(&estimate, variance);
        })?
    };
    variance.array()
}

/// Restore the detail that a smooth image lacks, as far as a noisy one shows it beyond its noise.
///
/// Parameters
/// ----------
/// smooth : (H, W, 3) array_like of float
///     What a filter or a fit made of the noisy colour.
/// noisy : (H, W, 3) array_like of float
///     Unbiased, such as accumulated samples.
/// variance : (H, W) array_like of float
///     Of the noisy luminance. A pixel whose variance is negative, NaN or infinite stays smooth.
/// strictness : float, default 1.0
///     Multiple of the variance below which a difference counts as noise; at least 0. With 1, the expected squared
///     error is smallest.
/// radius : int, default 1
///     The window reaches so many pixels to each side, 0 to 16.
/// out : (H, W, 3) float32 array, optional
///     Written and returned instead of a new array; it may be an input.
///
/// Returns
/// -------
/// restored : (H, W, 3) float32
///     Between `smooth` and `noisy`; `smooth` with its bits where nothing exceeds the noise or `noisy` is missing.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes or parameters out of range.
///
/// See Also
/// --------
/// accumulate : Returns moments and history length, of which the variance of the mean follows: ``(m2 - m1²) / N``.
/// regress : Fits that lack detail.
///
/// Notes
/// -----
/// The local Wiener filter [1]_: ``smooth + g (noisy - smooth)`` with ``g = max(0, 1 - strictness * mean(variance) /
/// mean((l_noisy - l_smooth)**2))``, l the luminance, and means over the pixels of the window that have both colours
/// and a variance.
///
/// References
/// ----------
/// .. [1] J.-S. Lee, "Digital image enhancement and noise filtering by use of local statistics", IEEE Transactions on
///    Pattern Analysis and Machine Intelligence 2(2), 1980.
///
/// Examples
/// --------
/// >>> smooth, noisy = np.zeros((1, 3, 3)), np.ones((1, 3, 3))
/// >>> yester.restore_detail(smooth, noisy, np.full((1, 3), 0.25))[0, 1]
/// array([0.75, 0.75, 0.75], dtype=float32)
/// >>> yester.restore_detail(smooth, noisy, np.full((1, 3), 2.0))[0, 1]
/// array([0., 0., 0.], dtype=float32)
#[pyfunction]
#[pyo3(name = "restore_detail", signature = (smooth, noisy, variance, *, strictness=1.0, radius=1, out=None))]
pub fn restore_detail_<'py>(
    py: Python<'py>,
    smooth: &Bound<'py, PyAny>,
    noisy: &Bound<'py, PyAny>,
    variance: &Bound<'py, PyAny>,
    strictness: f32,
    radius: i128,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let params = restore::Params {
        strictness,
        radius: restore::Params::radius(radius)?,
    };
    params.check()?;
    let restored = {
        let smooth = Input::<f32>::new(smooth, "smooth", COLOR)?;
        let size = smooth.size();
        let noisy = Input::<f32>::of_size(noisy, "noisy", COLOR, size)?;
        let variance = Input::<f32>::of_size(variance, "variance", Channels::One, size)?;
        let out = Out::given(out, smooth.shape())?;
        let [coarse, fine] = [smooth.pixels(), noisy.pixels()];
        let variance = variance.pixels().plane();
        out.fill(py, |restored| {
            let restored = PixelsMut::bands(size, 3, restored);
            restore_detail(coarse, fine, variance, params, restored);
        })?
    };
    restored.array()
}

/// Smooth colour by the edge-avoiding à-trous wavelet filter, guided by variance.
///
/// Parameters
/// ----------
/// color : (H, W, 3) array_like of float
///     Linear. Pixels with NaN or infinity are missing: they have weight 0 and are filled from their neighbours.
/// variance : (H, W) array_like of float
///     Variance of the luminance of `color`, as `estimate_variance` returns it; values that are not finite count as 0.
/// prediction : (H, W) array_like of float, optional
///     Luminance that history predicts, without the newest samples. Luminance differences are then its own instead of
///     the colour's, so that weights do not depend on the samples' noise, and it is filtered by the same weights. NaN
///     where nothing is predicted: the colour's luminance is used instead.
/// history_length : (H, W) array_like of float, optional
///     Number of samples that a pixel is the mean of. The noise is then limited by `relative_noise`. For frames without
///     normals, ids and albedo: with them, this keeps noise where rare bright samples make all of the light.
/// depth : (H, W) array_like of float, optional
///     View-space z; +inf, NaN or not above 0 is background, which does not mix with surfaces.
/// normal : (H, W, 3) array_like of float, optional
///     World space, unit length.
/// ids : (H, W) array_like of int, optional
///     Pixels with different ids do not mix.
/// iterations : int, default 5
///     Number of passes, 0 to 16; pass i reaches radius·2^i pixels to each side.
/// radius : int, default 2
///     Radius of a pass in taps: 2 for 5×5, 1 for 3×3.
/// sigma_luminance : float, default 4.0
///     Scale of luminance differences, in standard deviations; above 0.
/// relative_noise : float, default 2.5
///     Most standard deviation of one sample that is expected, in multiples of the light around it, with
///     `history_length`; above 0, may be +inf.
/// tap_exposure : float, optional
///     The light above which taps that are brighter than the centre weigh less, as light that leaks into the dark is
///     seen more than dark that leaks into light; above 0. Needs `history_length`. By default all weigh alike.
/// settled : float, default 3.5
///     Smallest history length, in samples, that both pixels must have for `tap_exposure` to apply; from 0. Shorter
///     histories are so noisy that it would darken them.
/// sigma_normal : float, default 128.0
///     Sharpness of the normal weight; from 0. About the exponent in (n·n')^sigma_normal, less where normals are rough.
/// sigma_depth, sigma_plane : float, default 0.5 and 0.05
///     Scale of the distance from the pixel's tangent plane: in multiples of what the slope explains over the reach of
///     the pass, and as a share of depth; both above 0. The two add up.
/// out : tuple of (H, W, 3) and (H, W) float32 arrays, and with `prediction` another of (H, W), optional
///     Written and returned instead of new arrays; they may be inputs. A part may be None.
///
/// Returns
/// -------
/// color : (H, W, 3) float32
///     Filtered; NaN for missing pixels without valid neighbours.
/// variance : (H, W) float32
///     Variance of its luminance, assuming independent samples.
/// prediction : (H, W) float32
///     The filtered prediction, only if one was given. Where a pixel has one, it has not seen the pixel's newest sample
///     either (see `compare_candidates`); where it was NaN, it begins with the colour's luminance.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes or parameters out of range.
///
/// See Also
/// --------
/// estimate_variance : Estimates the variance.
/// accumulate : Returns accumulated colour.
/// SVGF : The pipeline that filters every frame.
///
/// Notes
/// -----
/// A tap's weight is ``k(dx) k(dy) exp(-(en + ez + el))`` with the kernel k = {1, 2/3, 1/6}, or {1, 1/2} for 3×3 taps,
/// zero between different ids or between surface and background. Background is one surface, whatever its ids and
/// normals. In the exponent,
///
/// - ``en = sigma_normal · ½|n - n'|² / (1 + sigma_normal · ρ)``, where the roughness ρ is how much normals change from
///   pixel to pixel where that is neither an edge nor curvature, as bumps and noise do (after Rousselle et al. [1]_):
///   ``½ Σ min(|n₋ - n|², |n₊ - n|², ⅓|n₋ - 2n + n₊|²)`` over those axes along which both neighbours are of the
///   pixel's surface,
/// - ``ez = |w' - w - ∇w·Δ| / (sigma_plane w + sigma_depth r |∇w|₁)``, where ``w = 1/Z`` is linear in the image on a
///   plane, r is the reach of the pass in pixels, and ∇w has the smaller one-sided differences, of surfaces whatever
///   their ids,
/// - ``el = |l - l'| / (sigma_luminance √(3×3 Gaussian of variance) + |l|/1000)``, l being the luminance of the colour,
///   or the prediction. With `history_length`, the root is at most ``relative_noise L / √N``, where N is the number of
///   samples, at least 1, and L the 3×3 Gaussian of the luminance of `color`, at least 0, missing pixels being black.
///   Both Gaussians repeat the pixels at the borders.
///
/// With `tap_exposure` e, the weights of taps that are brighter before the first pass are also multiplied by
/// ``((e + l) / (e + l'))²``, with l at least 0, where both pixels have `settled` samples or more.
///
/// Colour is ``Σwc/Σw`` and variance ``Σw²v/(Σw)²``. The filter is that of Dammertz et al. [2]_, its guidance by
/// variance that of SVGF ([3]_, section 4.3). SVGF's own ``ez``, ``|Z - Z'| / (sigma_depth |∇Z·Δ|)``, is 1 for every
/// tap on an inclined plane, where the one above is 0.
///
/// References
/// ----------
/// .. [1] F. Rousselle, M. Manzi, M. Zwicker, "Robust denoising using feature and color information", Computer Graphics
///    Forum 32(7), 2013.
/// .. [2] H. Dammertz, D. Sewtz, J. Hanika, H. P. A. Lensch, "Edge-avoiding à-trous wavelet transform for fast global
///    illumination filtering", High-Performance Graphics, 2010.
/// .. [3] C. Schied, A. Kaplanyan, C. Wyman, A. Patney, C. R. A. Chaitanya, J. Burgess, S. Liu, C. Dachsbacher, A.
///    Lefohn, M. Salvi, "Spatiotemporal variance-guided filtering: real-time reconstruction for path-traced global
///    illumination", High-Performance Graphics, 2017.
///
/// Examples
/// --------
/// >>> noisy = 1 + 0.1 * np.random.default_rng(0).standard_normal((32, 32, 1)) * np.ones(3)
/// >>> color, variance = yester.atrous(noisy, np.full((32, 32), 0.01))
/// >>> bool(color.std() < noisy.std() / 5)
/// True
#[pyfunction]
#[pyo3(signature = (color, variance, *, prediction=None, history_length=None, depth=None, normal=None, ids=None,
    iterations=5, radius=2, sigma_luminance=4.0, relative_noise=2.5, tap_exposure=None, settled=3.5,
    sigma_normal=128.0, sigma_depth=0.5, sigma_plane=0.05, out=None))]
#[pyo3(name = "atrous")]
pub fn atrous_<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    variance: &Bound<'py, PyAny>,
    prediction: Option<&Bound<'py, PyAny>>,
    history_length: Option<&Bound<'py, PyAny>>,
    depth: Option<&Bound<'py, PyAny>>,
    normal: Option<&Bound<'py, PyAny>>,
    ids: Option<&Bound<'py, PyAny>>,
    iterations: i128,
    radius: i128,
    sigma_luminance: f32,
    relative_noise: f32,
    tap_exposure: Option<f32>,
    settled: f32,
    sigma_normal: f32,
    sigma_depth: f32,
    sigma_plane: f32,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyTuple>> {
    let sigmas = sigmas(sigma_normal, sigma_depth, sigma_plane);
    let params = atrous::Params {
        iterations: atrous::Params::iterations(iterations)?,
        radius: atrous::Params::radius(radius)?,
        sigma_luminance,
        relative_noise,
        settled,
        sigmas,
    };
    params.check()?;
    let filtered = {
        let color = Input::<f32>::new(color, "color", COLOR)?;
        let size = color.size();
        let variance = Input::<f32>::of_size(variance, "variance", Channels::One, size)?;
        let prediction = Input::<f32>::optional(prediction, "prediction", Channels::One, size)?;
        if let Some(exposure) = tap_exposure {
            in_range("tap_exposure", exposure, "a number above 0", |v| v > 0.0)?;
            if history_length.is_none() {
                return Err(needs("tap_exposure", "history_length"));
            }
        }
        let length = Input::<f32>::optional(history_length, "history_length", Channels::One, size)?;
        let guide = GuideArgs::new(size, depth, normal, ids)?;
        let (shape, flat) = (color.shape(), [size.height, size.width]);
        let source = atrous::Source {
            color: color.pixels(),
            variance: variance.pixels(),
            prediction: prediction.as_ref().map(|image| image.pixels()),
            samples: length.as_ref().map(|image| image.pixels()),
            exposure: tap_exposure.unwrap_or(f32::INFINITY),
        };
        let guide = guide.surface();
        let filter = |color: &mut [f32], variance: &mut [f32], prediction: Option<&mut [f32]>| {
            let guide = Guide::new(size, params.reach(), guide, None);
            let color = PixelsMut::bands(size, 3, color);
            atrous::atrous(source, &guide, params, color, variance, prediction);
        };
        let out = out.as_ref();
        match prediction {
            Some(_) => Vec::from(fill_parts(py, out, [shape, &flat, &flat], |[a, b, c]| {
                filter(a, b, Some(c));
            })?),
            None => Vec::from(fill_parts(py, out, [shape, &flat], |[a, b]| {
                filter(a, b, None);
            })?),
        }
    };
    let arrays = filtered.into_iter().map(Direct::array);
    PyTuple::new(py, arrays.collect::<PyResult<Vec<_>>>()?)
}

/// Clamp samples far brighter than their surroundings and redistribute the excess.
///
/// Parameters
/// ----------
/// color : (H, W, 3) array_like of float
///     Linear, before demodulation, without emission. Missing pixels stay missing.
/// expected : (H, W, 3) array_like of float, optional
///     History at the pixel: a sample that history predicts is not a firefly. Values that are not finite count as 0.
/// depth : (H, W) array_like of float, optional
///     View-space z; +inf, NaN or not above 0 is background.
/// normal : (H, W, 3) array_like of float, optional
///     World space, unit length.
/// ids : (H, W) array_like of int, optional
///     Pixels with different ids do not mix.
/// threshold : float, default 2.0
///     Standard deviations by which a pixel may exceed the mean of its neighbours; at least 0.
/// radius : int, default 4
///     Radius of the window in pixels, 1 to 16.
/// redistribute : bool, default True
///     Spread the excess over the window's pixels of the same surface, so that the image does not darken. Without
///     guides all of the excess is kept; where normals or depths change within the window, it may become less or more.
/// sigma_normal, sigma_depth, sigma_plane : float, default 128.0, 0.5 and 0.05
///     As in `atrous`.
/// out : tuple of (H, W, 3) and (H, W) float32 arrays, optional
///     Written and returned instead of new arrays; they may be inputs. A part may be None.
///
/// Returns
/// -------
/// color : (H, W, 3) float32
///     With the excess clamped, and spread if `redistribute` is set.
/// removed : (H, W) float32
///     Luminance by which each pixel exceeded its limit.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes or parameters out of range.
///
/// See Also
/// --------
/// SVGF : Suppresses fireflies with the option `fireflies`.
/// clip_history : Clips history instead of samples.
///
/// Notes
/// -----
/// Neighbours have the guide weights of `reconstruct`, without the spatial weight. With mean m and standard deviation s
/// of the luminance in the window without its centre, the limit is ``max(m + threshold s, (1 + threshold) l)``, l being
/// the expected luminance (NRD's anti-firefly [1]_: 9×9 pixels, 2 deviations, no history). There is none where these
/// neighbours have a weight below 2 in all. The excess is distributed over the window's pixels, the centre included:
/// q's share of p's excess is q's weight of p, divided by the sum of p's weights of all. Weights of surfaces are not
/// symmetric, so that the shares do not add up to 1 where surfaces differ.
///
/// References
/// ----------
/// .. [1] NVIDIA, "NVIDIA Real-Time Denoisers" (ReBLUR, ReLAX), github.com/NVIDIA-RTX/NRD; D. Zhdan, "ReBLUR: a
///    hierarchical recurrent denoiser", Ray Tracing Gems II, 2021.
///
/// Examples
/// --------
/// >>> color = np.full((9, 9, 3), 0.5)
/// >>> color[4, 4] = 100
/// >>> clamped, removed = yester.suppress_fireflies(color)
/// >>> clamped[4, 4]
/// array([1.7284, 1.7284, 1.7284], dtype=float32)
/// >>> round(float(removed[4, 4]), 2)
/// 99.5
/// >>> bool(np.isclose(clamped.mean(), color.mean()))
/// True
#[pyfunction]
#[pyo3(name = "suppress_fireflies", signature = (color, *, expected=None, depth=None, normal=None, ids=None,
    threshold=2.0, radius=4, redistribute=true, sigma_normal=128.0, sigma_depth=0.5, sigma_plane=0.05, out=None))]
pub fn suppress_fireflies_<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    expected: Option<&Bound<'py, PyAny>>,
    depth: Option<&Bound<'py, PyAny>>,
    normal: Option<&Bound<'py, PyAny>>,
    ids: Option<&Bound<'py, PyAny>>,
    threshold: f32,
    radius: i128,
    redistribute: bool,
    sigma_normal: f32,
    sigma_depth: f32,
    sigma_plane: f32,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<(Bound<'py, PyArrayDyn<f32>>, Bound<'py, PyArrayDyn<f32>>)> {
    let params = fireflies::Params {
        threshold,
        radius: fireflies::Params::radius(radius)?,
        redistribute,
        sigmas: sigmas(sigma_normal, sigma_depth, sigma_plane),
    };
    params.check()?;
    let [held, removed] = {
        let color = Input::<f32>::new(color, "color", COLOR)?;
        let size = color.size();
        let expected = Input::<f32>::optional(expected, "expected", COLOR, size)?;
        let guide = GuideArgs::new(size, depth, normal, ids)?;
        let shape = color.shape();
        let (color, guide) = (color.pixels(), guide.surface());
        let expected = expected.as_ref().map(Input::pixels);
        fill_parts(py, out.as_ref(), [shape, &shape[..2]], |[held, plane]| {
            let guide = Guide::new(size, params.radius, guide, None);
            let held = PixelsMut::bands(size, 3, held);
            let removed = fireflies::suppress_fireflies(color, expected, &guide, params, held);
            removed.view().interleave(plane);
        })?
    };
    Ok((held.array()?, removed.array()?))
}

/// Average recently disoccluded pixels over their surface: history fix.
///
/// Parameters
/// ----------
/// color : (H, W, 3) array_like of float
///     Accumulated colour. Missing pixels have weight 0, and those with a short history are filled.
/// history_length : (H, W) array_like of float
///     History length in samples.
/// depth : (H, W) array_like of float, optional
///     View-space z; +inf, NaN or not above 0 is background.
/// normal : (H, W, 3) array_like of float, optional
///     World space, unit length.
/// ids : (H, W) array_like of int, optional
///     Pixels with different ids do not mix.
/// max_length : float, default 3.0
///     Histories shorter than this are fixed; at least 0.
/// stride : float, default 14.0
///     Distance between taps in pixels at history length 0, 1 to 64; at length N it is stride/(1 + N), at least 1.
/// sigma_normal, sigma_depth, sigma_plane : float, default 128.0, 0.5 and 0.05
///     As in `atrous`.
/// out : (H, W, 3) float32 array, optional
///     Written and returned instead of a new array; it may be an input.
///
/// Returns
/// -------
/// color : (H, W, 3) float32
///     Fixed pixels are the mean of 5×5 taps, weighted by guide and history length; the others, and those without a
///     valid tap, keep their bits.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes or parameters out of range.
///
/// See Also
/// --------
/// accumulate : Returns accumulated colour and history length.
/// estimate_variance : Widens the filter where history is short.
///
/// Notes
/// -----
/// Taps lie at multiples of ``max(1, ⌊stride / (1 + N) + ½⌋)`` pixels and have the weights of `reconstruct`, without
/// the spatial weight, times their history length: after the history fix of NRD's ReBLUR and ReLAX [1]_. `SVGF` does
/// not use it: for short histories its filter, guided by spatial variance, was better on three of four scenes tried,
/// and equal on the fourth.
///
/// References
/// ----------
/// .. [1] NVIDIA, "NVIDIA Real-Time Denoisers" (ReBLUR, ReLAX), github.com/NVIDIA-RTX/NRD; D. Zhdan, "ReBLUR: a
///    hierarchical recurrent denoiser", Ray Tracing Gems II, 2021.
///
/// Examples
/// --------
/// >>> color = np.ones((8, 8, 3))
/// >>> color[4, 4] = 9
/// >>> length = np.full((8, 8), 10.0)
/// >>> length[4, 4] = 1
/// >>> yester.fix_history(color, length, stride=2)[4, 4].round(3)
/// array([1.033, 1.033, 1.033], dtype=float32)
#[pyfunction]
#[pyo3(signature = (color, history_length, *, depth=None, normal=None, ids=None, max_length=3.0,
    stride=14.0, sigma_normal=128.0, sigma_depth=0.5, sigma_plane=0.05, out=None))]
#[pyo3(name = "fix_history")]
pub fn fix_history_<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    history_length: &Bound<'py, PyAny>,
    depth: Option<&Bound<'py, PyAny>>,
    normal: Option<&Bound<'py, PyAny>>,
    ids: Option<&Bound<'py, PyAny>>,
    max_length: f32,
    stride: f32,
    sigma_normal: f32,
    sigma_depth: f32,
    sigma_plane: f32,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let params = history_fix::Params {
        max_length,
        stride,
        sigmas: sigmas(sigma_normal, sigma_depth, sigma_plane),
    };
    params.check()?;
    let fixed = {
        let color = Input::<f32>::new(color, "color", COLOR)?;
        let size = color.size();
        let length = Input::<f32>::of_size(history_length, "history_length", Channels::One, size)?;
        let guide = GuideArgs::new(size, depth, normal, ids)?;
        let out = Out::given(out, color.shape())?;
        let (color, length, guide) = (color.pixels(), length.pixels().plane(), guide.surface());
        out.fill(py, |fixed| {
            let color = color.to_planes();
            let guide = Guide::new(size, params.reach(), guide, None);
            let image = history_fix::fix_history(color.view(), length, &guide, params);
            image.view().interleave(fixed);
        })?
    };
    fixed.array()
}

fn modulate<'py>(
    py: Python<'py>,
    way: Way,
    (name, image): (&str, &Bound<'py, PyAny>),
    albedo: &Bound<'py, PyAny>,
    [emission, mask]: [Option<&Bound<'py, PyAny>>; 2],
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let modulated = {
        let image = Input::<f32>::new(image, name, COLOR)?;
        let albedo = Input::<f32>::of_size(albedo, "albedo", COLOR, image.size())?;
        let emission = Input::<f32>::optional(emission, "emission", COLOR, image.size())?;
        let mask = mask
            .map(|mask| {
                Input::<u8>::of_size(&bytes(mask, "where")?, "where", Channels::One, image.size())
            })
            .transpose()?;
        let out = Out::given(out, image.shape())?;
        let [values, albedo] = [&image, &albedo].map(|input| input.pixels());
        let emission = emission.as_ref().map(|input| input.pixels());
        let mask = mask.as_ref().map(|input| input.pixels().plane());
        let texture = Texture {
            albedo,
            emission,
            mask,
        };
        out.fill(py, |modulated| {
            let modulated = PixelsMut::bands(values.size, 3, modulated);
            demodulate::modulate(values, texture, way, modulated);
        })?
    };
    modulated.array()
}

/// An array of booleans, as the bytes that it consists of.
fn bytes<'py>(mask: &Bound<'py, PyAny>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    refuse_mask(mask, name)?;
    let mask = (mask.py().import("numpy")?).call_method1("asarray", (mask,))?;
    let dtype = mask.getattr("dtype")?;
    if dtype.getattr("kind")?.extract::<String>()? != "b" {
        return Err(wrong_type(name, "booleans", dtype));
    }
    mask.call_method1("view", ("uint8",))
}

/// Tell where albedo is a reflectance: surface by surface, from the range of its values.
///
/// Parameters
/// ----------
/// albedo : (H, W, 3) array_like of float
///     As a renderer writes it; not finite counts as 0.
/// ids : (H, W) array_like of int, optional
///     Pixels with the same id show the same surface.
/// normal : (H, W, 3) array_like of float, optional
///     Unit vectors. With `depth`, they tell surfaces apart where there are no ids.
/// depth : (H, W) array_like of float, optional
///     View-space z, +inf where nothing was hit.
/// out : (H, W) bool array, optional
///     Written and returned instead of a new array.
///
/// Returns
/// -------
/// mask : (H, W) bool, or None
///     True at all pixels of surfaces of which the largest albedo, over pixels and channels, is at least 0.001, and no
///     more than one in 64 pixels has an albedo whose largest channel is above 1.25, or not 0 and below 1e-5.
///     None if there are no ids and no more than one in 1024 pixels of the image has an albedo out of that range: pass
///     it on as `where` of `demodulate` and `remodulate`, whose default it is.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes.
/// TypeError
///     If `out` has another dtype.
///
/// See Also
/// --------
/// demodulate : Takes the mask as `where`.
/// material_ids : Ids for frames without, by the mask.
///
/// Notes
/// -----
/// Renderers write other things under the name of albedo. Mitsuba's integrator ``aov`` gives the value of a BSDF for
/// one pair of directions, which on rough metal follows a highlight, from below a millionth to tens. Light that is
/// divided by it changes as much from pixel to pixel and from frame to frame. Glass, mirrors, lamps and sky have 0. No
/// reflectance is above 1, but reconstruction filters overshoot at edges by a tenth or so. None that is not 0 is below
/// 1/3295, the darkest value of 8-bit textures, but beside weak highlights a fifth of the pixels and more are
/// below 1e-5.
///
/// Without ids, a surface is a region of pixels that are connected through their neighbours in rows and columns. Two
/// are connected if their normals differ by less than 26° (a cosine of 0.9) and their depths by less than a fiftieth of
/// the smaller one. Without normals or depth there are no regions: where more than one pixel in 1024 is out of range,
/// the mask is False everywhere, as small highlights are enough to make albedo harm the whole image.
///
/// Examples
/// --------
/// >>> albedo = np.array([[[0.5] * 3, [0.0] * 3, [9.0] * 3, [0.2] * 3]])
/// >>> yester.is_reflectance(albedo, np.array([[1, 1, 2, 2]]))
/// array([[ True,  True, False, False]])
#[pyfunction]
#[pyo3(signature = (albedo, ids=None, *, normal=None, depth=None, out=None), name = "is_reflectance")]
pub fn is_reflectance_<'py>(
    py: Python<'py>,
    albedo: &Bound<'py, PyAny>,
    ids: Option<&Bound<'py, PyAny>>,
    normal: Option<&Bound<'py, PyAny>>,
    depth: Option<&Bound<'py, PyAny>>,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Option<Bound<'py, PyArrayDyn<bool>>>> {
    let (mask, out) = {
        let albedo = Input::<f32>::new(albedo, "albedo", COLOR)?;
        let size = albedo.size();
        let guide = GuideArgs::new(size, depth, normal, ids)?;
        let out = Out::<bool>::given(out, &[size.height, size.width])?;
        let (albedo, guide) = (albedo.pixels(), guide.surface());
        let Some(surfaces) = detached(py, || Surfaces::of(albedo, &guide))? else {
            return Ok(None);
        };
        let mask = out.bytes()?.fill(py, |mask| {
            mask.copy_from_slice(surfaces.mask().plane(0));
        })?;
        (mask, out)
    };
    Ok(Some(out.array(mask.array()?)?))
}

/// Tell kinds of material by albedo: ids for frames that have none.
///
/// Parameters
/// ----------
/// albedo : (H, W, 3) array_like of float
///     As a renderer writes it.
/// normal : (H, W, 3) array_like of float, optional
///     Unit vectors.
/// depth : (H, W) array_like of float, optional
///     View-space z, +inf where nothing was hit.
/// out : (H, W) uint32 array, optional
///     Written and returned instead of a new array.
///
/// Returns
/// -------
/// ids : (H, W) uint32
///     1 where the albedo is no reflectance (`is_reflectance`), 3 where it is white, at least 0.99 in all channels,
///     and 2 elsewhere. White counts as 2 in frames in which it is part of textures.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes.
/// TypeError
///     If `out` has another dtype.
///
/// See Also
/// --------
/// is_reflectance : Tells 1 from the others.
///
/// Notes
/// -----
/// White is how renderers mark glass and mirrors: nothing that scatters light reflects so much. What is seen there has
/// nothing to do with the light of the surfaces around, and should not be mixed with it.
///
/// White is part of textures if, of the pairs of neighbours along x and y of which one has 2 and the other 3, more than
/// an eighth as many as there are pixels of the rarer kind lie on one surface: their normals differ by less than 26
/// degrees, and their depths by less than 2 percent or not at all. Without normals, without depth, or without both,
/// what there is decides.
///
/// `SVGF`, `HalfRes` and `BMFR` validate and filter frames without ids by these.
///
/// Examples
/// --------
/// >>> albedo = np.full((16, 16, 3), 0.5)
/// >>> albedo[:, 12:] = 1
/// >>> depth = np.full((16, 16), 2.0)
/// >>> yester.material_ids(albedo, depth=depth)[0, [0, 12]]
/// array([2, 2], dtype=uint32)
/// >>> depth[:, 12:] = 3
/// >>> yester.material_ids(albedo, depth=depth)[0, [0, 12]]
/// array([2, 3], dtype=uint32)
#[pyfunction]
#[pyo3(signature = (albedo, *, normal=None, depth=None, out=None), name = "material_ids")]
pub fn material_ids_<'py>(
    py: Python<'py>,
    albedo: &Bound<'py, PyAny>,
    normal: Option<&Bound<'py, PyAny>>,
    depth: Option<&Bound<'py, PyAny>>,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<u32>>> {
    let ids = {
        let albedo = Input::<f32>::new(albedo, "albedo", COLOR)?;
        let size = albedo.size();
        let guide = GuideArgs::new(size, depth, normal, None)?;
        let out = Out::<u32>::given(out, &[size.height, size.width])?;
        let (albedo, guide) = (albedo.pixels(), guide.surface());
        out.fill(py, |ids| {
            let surfaces = Surfaces::of(albedo, &guide);
            let materials = Materials::of(albedo, surfaces.as_ref(), &guide);
            ids.copy_from_slice(materials.counted().plane(0));
        })?
    };
    ids.array()
}

/// Divide colour by albedo, so that filters see illumination without texture.
///
/// Parameters
/// ----------
/// color : (H, W, 3) array_like of float
///     Linear. NaN and infinity are kept.
/// albedo : (H, W, 3) array_like of float
///     Reflectance, held to 0 to 1; not finite counts as 0.
/// emission : (H, W, 3) array_like of float, optional
///     Light that the visible surface sends out itself; not finite counts as 0.
/// where : (H, W) array_like of bool, optional
///     Where the albedo is a reflectance (`is_reflectance`); by default, where it is not 0 in all channels.
/// out : (H, W, 3) float32 array, optional
///     Written and returned instead of a new array; it may be an input.
///
/// Returns
/// -------
/// illumination : (H, W, 3) float32
///     ``(color - emission) / d``; d is the albedo, at least 1/32, and 1 where the albedo is no reflectance.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes.
///
/// See Also
/// --------
/// remodulate : Multiplies by albedo again.
/// is_reflectance : Tells `where`.
///
/// Notes
/// -----
/// With a the albedo of a channel, ``d = max(a, 1/32)``; where it is no reflectance, ``d = 1``. Lamps, sky, glass,
/// mirrors and black plastic have an albedo near 0, which does not scale their light. Divided by it, the light would be
/// a thousand times too bright, and filters would leak the excess to neighbouring surfaces. There is no smooth passage
/// between both, as it blurs dark texture, and where an albedo changes with the view, the light changes as much.
///
/// `remodulate` is the inverse. Where d is 1, the round trip without emission is exact; elsewhere it
/// is exact to one or two units in the last place. After SVGF ([1]_, section 4); its implementation in Falcor [2]_
/// divides by ``max(a, 0.001)``.
///
/// References
/// ----------
/// .. [1] C. Schied, A. Kaplanyan, C. Wyman, A. Patney, C. R. A. Chaitanya, J. Burgess, S. Liu, C. Dachsbacher, A.
///    Lefohn, M. Salvi, "Spatiotemporal variance-guided filtering: real-time reconstruction for path-traced global
///    illumination", High-Performance Graphics, 2017.
/// .. [2] NVIDIA, "Falcor", github.com/NVIDIAGameWorks/Falcor, render pass SVGFPass.
///
/// Examples
/// --------
/// >>> color = np.full((1, 2, 3), 0.1)
/// >>> albedo = np.array([[[0.2] * 3, [0.0] * 3]])
/// >>> yester.demodulate(color, albedo)[..., 0]
/// array([[0.5, 0.1]], dtype=float32)
#[pyfunction]
#[pyo3(signature = (color, albedo, *, emission=None, r#where=None, out=None), name = "demodulate")]
pub fn demodulate_<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    albedo: &Bound<'py, PyAny>,
    emission: Option<&Bound<'py, PyAny>>,
    r#where: Option<&Bound<'py, PyAny>>,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let image = ("color", color);
    modulate(py, Way::Off, image, albedo, [emission, r#where], out)
}

/// Multiply illumination by albedo and add emission.
///
/// Parameters
/// ----------
/// illumination : (H, W, 3) array_like of float
///     As `demodulate` returns it.
/// albedo : (H, W, 3) array_like of float
///     Reflectance, held to 0 to 1; not finite counts as 0.
/// emission : (H, W, 3) array_like of float, optional
///     Light that the visible surface sends out itself; not finite counts as 0.
/// where : (H, W) array_like of bool, optional
///     Where the albedo is a reflectance (`is_reflectance`); by default, where it is not 0 in all channels.
/// out : (H, W, 3) float32 array, optional
///     Written and returned instead of a new array; it may be an input.
///
/// Returns
/// -------
/// color : (H, W, 3) float32
///     ``illumination * d + emission``, with d as in `demodulate`.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes.
///
/// See Also
/// --------
/// demodulate : Divides by albedo.
///
/// Examples
/// --------
/// >>> albedo = np.full((1, 1, 3), 0.5)
/// >>> yester.remodulate(np.full((1, 1, 3), 0.2), albedo, emission=np.ones((1, 1, 3)))
/// array([[[1.1, 1.1, 1.1]]], dtype=float32)
#[pyfunction]
#[pyo3(signature = (illumination, albedo, *, emission=None, r#where=None, out=None), name = "remodulate")]
pub fn remodulate_<'py>(
    py: Python<'py>,
    illumination: &Bound<'py, PyAny>,
    albedo: &Bound<'py, PyAny>,
    emission: Option<&Bound<'py, PyAny>>,
    r#where: Option<&Bound<'py, PyAny>>,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let image = ("illumination", illumination);
    modulate(py, Way::Back, image, albedo, [emission, r#where], out)
}

/// Smooth jagged edges in a single image: morphological antialiasing.
///
/// Parameters
/// ----------
/// color : (H, W, 3) array_like of float
///     Linear. Pixels with NaN or infinity are missing: they have no edges and stay missing.
/// threshold : float, default 0.1
///     Difference in perceived brightness, ``sqrt(l / (1 + l))`` of the Rec. 709 luminance ``l >= 0``, above which the
///     boundary of two pixels is part of an edge; finite, at least 0.
/// max_length : int, default 16
///     Search distance to each side for the end of an edge's step, in pixels, 1 to 128.
/// out : (H, W, 3) float32 array, optional
///     Written and returned instead of a new array; it may be an input.
///
/// Returns
/// -------
/// color : (H, W, 3) float32
///     Pixels that an edge crosses are mixed with the neighbours beyond the edge; the others keep their bits.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes or parameters out of range.
///
/// See Also
/// --------
/// TAA : Antialiasing over time.
/// smooth_edges : Antialiasing of denoised frames.
/// resolve : Antialiasing from several jittered frames.
///
/// Notes
/// -----
/// A separation line is a maximal sequence of n boundaries between two rows (or columns) that are discontinuities, with
/// the brighter pixels on one side. If at one of its ends exactly one of the two pairs of pixels, above or below,
/// differs across the end, the edge starts there, half a pixel above or below, and goes straight to the line's middle:
/// the shapes L (one end), Z and U (both). At distance d from that end it cuts off the area ``(n - 2d - 1)/(2n)`` of
/// the pixel, in the middle of an odd n ``1/(8n)``, beyond it 0. A line is cut at `max_length`; it has no shape at an
/// end that was cut or lies at the image's border.
///
/// Of rows and columns the direction counts that has the pixel's largest area, or half of each where these are equal.
/// The result is ``(1 - Σ area) · own + Σ area · neighbour``. The original [1]_ is changed in two points: the side of
/// the brighter pixels separates the two edges of thin lines, and choosing a direction avoids blending the steps of a
/// slanted edge twice.
///
/// References
/// ----------
/// .. [1] A. Reshetov, "Morphological antialiasing", High-Performance Graphics, 2009.
///
/// Examples
/// --------
/// >>> color = np.zeros((4, 8, 3))
/// >>> color[2:] = 1
/// >>> color[1, 4:] = 1
/// >>> yester.morphological_aa(color)[..., 0]
/// array([[0.   , 0.   , 0.   , 0.   , 0.   , 0.   , 0.   , 0.   ],
///        [0.   , 0.   , 0.125, 0.375, 0.625, 0.875, 1.   , 1.   ],
///        [1.   , 1.   , 1.   , 1.   , 1.   , 1.   , 1.   , 1.   ],
///        [1.   , 1.   , 1.   , 1.   , 1.   , 1.   , 1.   , 1.   ]], dtype=float32)
#[pyfunction]
#[pyo3(signature = (color, *, threshold=0.1, max_length=16, out=None), name = "morphological_aa")]
pub fn morphological_aa_<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    threshold: f32,
    max_length: i128,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let params = morphological::Params {
        threshold,
        max_length: morphological::Params::max_length(max_length)?,
    };
    params.check()?;
    let smooth = {
        let color = Input::<f32>::new(color, "color", COLOR)?;
        let out = Out::given(out, color.shape())?;
        let color = color.pixels();
        out.fill(py, |smooth| {
            let color = color.to_planes();
            let image = morphological::morphological_aa(color.view(), params);
            image.view().interleave(smooth);
        })?
    };
    smooth.array()
}

/// Smooth an image along its edges: antialiasing of denoised frames.
///
/// Parameters
/// ----------
/// color : (H, W, 3) array_like of float
///     Linear. Pixels with NaN or infinity are missing: they and all within four pixels keep their bits.
/// newest : (H, W, 3) array_like of float, optional
///     The frame that was merged into `color` last, if that is an average over frames: straight edges show 15 % more of
///     it. Its missing pixels have no share.
/// confidence : (H, W) array_like of float, optional
///     What is known of the history of a pixel's surface, from 0 (nothing) to 1 (all, as without this image), as
///     denoisers return it. Less known is smoothed more, even if its edge is not straight. NaN counts as 0.
/// exposure : float, default 1.0
///     The radiance that counts as 1, above 0, as `exposure` returns it.
/// out : (H, W, 3) float32 array, optional
///     Written and returned instead of a new array; it may be an input.
///
/// Returns
/// -------
/// color : (H, W, 3) float32
///     Pixels on straight edges are averaged with four others on the edge; pixels on no edge keep their bits.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes or an exposure out of range.
///
/// See Also
/// --------
/// morphological_aa : Antialiasing of images without noise.
/// TAA : Antialiasing over time, with the option `smooth_edges`.
///
/// Notes
/// -----
/// In a denoised frame of one sample per pixel, a pixel of an edge shows either of two surfaces by chance. Let g be the
/// gradient of the tone ``l / (l + e)``, of the luminance ``l >= 0`` and the exposure e (central differences, averaged
/// by ``{1, 2, 1}/4`` across), ``[[a, b], [b, d]]`` the mean of ``g gᵀ`` by binomial weights over 7×7 pixels (the
/// structure tensor [1]_), and ``R = sqrt((a - d)² + 4b²)``. The edge goes from row to row by ``-2b / (a - d + R)``
/// columns where ``a > d``, else from column to column by ``-2b / (d - a + R)`` rows. Taps v are one and two rows (or
/// columns) before and after, interpolated by a Catmull-Rom spline within the range of its four pixels, and weigh
/// ``{1, 4, 6, 4, 1}`` times ``1 / (1 + l(v) / 2e)``. With m their weighted mean, the pixel v becomes
/// ``v + s (m - v)``, where::
///
///     s = max(0, 16 t - 1) / 15
///     t = clip((a + d) / 3e-5 - 1, 0, 1) * (u + (1 - u) (R / (a + d))**4) / (1 + (l_max / 12e)²)
///     u = 0.75 (1 - confidence)
///
/// and l_max is the largest luminance of 3×3 pixels. ``R / (a + d)``, the coherence [2]_, is 1 on a straight edge and
/// less in corners, on crossings and in noise; near lamps far brighter than the frame, a small error is large for the
/// dark beside them. Borders are replicated.
///
/// An average over frames lags and has been resampled in each; as the line takes noise away, the newest frame n can
/// count for more. Each pixel c on the line of a pixel with the share s is then taken as
/// ``c + 0.15 s (R / (a + d))**4 (n - c)``, and v is interpolated, too. The ranges stay those of `color`.
///
/// References
/// ----------
/// .. [1] J. Bigün, G. H. Granlund, "Optimal orientation detection of linear symmetry", ICCV, 1987.
/// .. [2] J. E. Kyprianidis, H. Kang, "Image and video abstraction by coherence-enhancing filtering", Computer Graphics
///    Forum 30(2), 2011.
///
/// Examples
/// --------
/// >>> color = np.zeros((9, 9, 3))
/// >>> color[:, 5:] = 1
/// >>> color[:, 4] = np.array([0.75, 0.25, 0.75, 0.25, 0.75, 0.25, 0.75, 0.25, 0.75])[:, None]
/// >>> yester.smooth_edges(color)[3:6, 4, 0].round(2)
/// array([0.47, 0.48, 0.47], dtype=float32)
#[pyfunction]
#[pyo3(signature = (color, *, newest=None, confidence=None, exposure=1.0, out=None), name = "smooth_edges")]
pub fn smooth_edges_<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    newest: Option<&Bound<'py, PyAny>>,
    confidence: Option<&Bound<'py, PyAny>>,
    exposure: f32,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    finite_above_0("exposure", exposure)?;
    let smooth = {
        let color = Input::<f32>::new(color, "color", COLOR)?;
        let size = color.size();
        let newest = Input::<f32>::optional(newest, "newest", COLOR, size)?;
        let confidence = Input::<f32>::optional(confidence, "confidence", Channels::One, size)?;
        let out = Out::given(out, color.shape())?;
        let (color, newest) = (color.pixels(), newest.as_ref().map(Input::pixels));
        let confidence = (confidence.as_ref()).map(|image| image.pixels().plane());
        out.fill(py, |smooth| {
            color.to_planes().view().interleave(smooth);
            let smooth = PixelsMut::bands(size, 3, smooth);
            smooth_edges(color, newest, confidence, exposure, smooth);
        })?
    };
    smooth.array()
}
