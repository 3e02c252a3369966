//! The kernels of the merge folder.

use numpy::{PyArrayDyn, PyArrayMethods, PyUntypedArray};
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use super::arrays::{COLOR, Channels, Direct, Input, Out, choice, fill_parts, points};
use crate::error::Error;
use crate::image::Size;
use crate::kernels::judge::exposure;
use crate::kernels::merge::{accumulate, blend, combine, converge, resolve};
use crate::pixels::PixelsMut;

pub const MOMENTS: Channels = Channels::Of(&[2]);

/// Result of `accumulate`, which can be pickled.
///
/// Parameters
/// ----------
/// color : (H, W, 3) float32
///     Accumulated colour.
/// moments : (H, W, 2) float32
///     Means of luminance and of its square.
/// history_length : (H, W) float32
///     History length in samples, up to 1/alpha where a sample was merged.
/// missing : int
///     Pixels whose new sample was not finite, or of weight 0 or NaN.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes.
///
/// See Also
/// --------
/// accumulate : Returns this.
///
/// Examples
/// --------
/// >>> zeros = np.zeros((2, 2, 3))
/// >>> yester.accumulate(zeros + 1, zeros, zeros[..., :2], zeros[..., 0])
/// Accumulated(2x2, missing=0)
#[pyclass(frozen, get_all, module = "yester")]
pub struct Accumulated {
    /// Accumulated colour: (H, W, 3) float32.
    color: Py<PyArrayDyn<f32>>,
    /// Means of luminance and of its square: (H, W, 2) float32.
    moments: Py<PyArrayDyn<f32>>,
    /// History length in samples, up to 1/alpha: (H, W) float32.
    history_length: Py<PyArrayDyn<f32>>,
    /// Number of pixels whose new sample was not finite, or of weight 0 or NaN.
    missing: usize,
}

#[pymethods]
impl Accumulated {
    #[new]
    fn new(
        color: &Bound<'_, PyAny>,
        moments: &Bound<'_, PyAny>,
        history_length: &Bound<'_, PyAny>,
        missing: usize,
    ) -> PyResult<Self> {
        let color = Input::<f32>::new(color, "color", COLOR)?;
        let size = color.size();
        let input = |value, name, channels| {
            Input::<f32>::of_size(value, name, channels, size).map(|input| input.array().unbind())
        };
        Ok(Self {
            color: color.array().unbind(),
            moments: input(moments, "moments", MOMENTS)?,
            history_length: input(history_length, "history_length", Channels::One)?,
            missing,
        })
    }

    /// Supports pickling and copying; a shallow copy shares the arrays.
    fn __getnewargs__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let Self {
            color,
            moments,
            history_length,
            missing,
        } = self;
        (color, moments, history_length, missing).into_pyobject(py)
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let shape =
            numpy::PyUntypedArrayMethods::shape(self.history_length.bind(py).as_untyped()).to_vec();
        format!(
            "Accumulated({}x{}, missing={})",
            shape[1], shape[0], self.missing
        )
    }
}

/// Merge new samples into the history: temporal accumulation.
///
/// Parameters
/// ----------
/// color : (H, W, 3) array_like of float
///     The new samples. A pixel with NaN or infinity is missing.
/// history : (H, W, 3) array_like of float
///     Reprojected colour.
/// history_moments : (H, W, 2) array_like of float
///     Reprojected means of luminance and of its square.
/// history_length : (H, W) array_like of float
///     Reprojected number of samples, fractions included; 0 where there is no history.
/// weight : (H, W) array_like of float, optional
///     The fraction of a sample that each new colour counts for, 0 to 1: below 1 for colours reconstructed from
///     neighbours. 0 and NaN mean missing. By default 1.
/// gradient : (H, W) array_like of float, optional
///     Relative change of light, 0 to 1, as `temporal_gradient` returns it; NaN counts as 0.
/// confidence : (H, W) array_like of float, optional
///     Confidence in history, 0 to 1, such as the coverage of `reproject`; NaN counts as 0. By default 1.
/// alpha : float, default 0.05
///     Smallest weight of the new sample, 0 to 1. With 0, all samples are averaged equally, without a limit.
/// moments_alpha : float, default 0.2
///     Smallest weight of the new sample in the moments.
/// warmup : bool, default True
///     Give the N-th sample a weight of 1/N until that falls to `alpha`, so that the first samples are averaged
///     equally; otherwise the weight is `alpha`, above 0, from the second sample on.
/// out : tuple of (H, W, 3), (H, W, 2) and (H, W) float32 arrays, optional
///     Written and returned, as colour, moments and length, instead of new arrays; they may be inputs. A part may be
///     None.
///
/// Returns
/// -------
/// Accumulated
///     With `color`, `moments`, `history_length` and `missing`. Where a sample is missing, history is unchanged, but
///     for its length, which `gradient` shortens; without history either, colour and moments are NaN and the length
///     is 0.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes or weights out of range.
///
/// See Also
/// --------
/// reproject : Fetches the history.
/// combine_histories : Merges two histories.
/// converge : Shows the mean of a still scene's samples.
/// blend : Merges with a given weight, without a count of samples.
///
/// Notes
/// -----
/// With w the `weight`, N = min(`history_length` + w, 1/alpha) and l the Rec. 709 luminance:
/// ``color = h + w (c - h)/N`` and ``moments = m + w max(moments_alpha, 1/N) ((l, l*l) - m)`` (SVGF [1]_, section 4.2;
/// the equal start as in the survey by Yang et al. [2]_). A `gradient` g first shortens the history to
/// ``N (1 - g)**10`` and then moves both weights towards 1: ``a + g (1 - a)`` (Schied et al. [3]_; the exponent as in
/// Quake II RTX [4]_). A `confidence` c moves both weights further: ``a + w (1 - c) (1 - a)``.
///
/// References
/// ----------
/// .. [1] C. Schied, A. Kaplanyan, C. Wyman, A. Patney, C. R. A. Chaitanya, J. Burgess, S. Liu, C. Dachsbacher, A.
///    Lefohn, M. Salvi, "Spatiotemporal variance-guided filtering: real-time reconstruction for path-traced global
///    illumination", High-Performance Graphics, 2017.
/// .. [2] L. Yang, S. Liu, M. Salvi, "A survey of temporal antialiasing techniques", Computer Graphics Forum 39(2),
///    2020.
/// .. [3] C. Schied, C. Peters, C. Dachsbacher, "Gradient estimation for real-time adaptive temporal filtering",
///    Proceedings of the ACM on Computer Graphics and Interactive Techniques 1(2), 2018.
/// .. [4] NVIDIA, "Quake II RTX", github.com/NVIDIA/Q2RTX, 2019: the denoiser A-SVGF.
///
/// Examples
/// --------
/// >>> color = np.full((1, 1, 3), 4.0)
/// >>> history = np.zeros((1, 1, 3))
/// >>> result = yester.accumulate(color, history, np.zeros((1, 1, 2)), [[3.0]])
/// >>> result.color
/// array([[[1., 1., 1.]]], dtype=float32)
/// >>> result.history_length
/// array([[4.]], dtype=float32)
#[pyfunction]
#[pyo3(signature = (color, history, history_moments, history_length, *, weight=None, gradient=None, confidence=None,
    alpha=0.05, moments_alpha=0.2, warmup=true, out=None))]
#[pyo3(name = "accumulate")]
pub fn accumulate_<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    history: &Bound<'py, PyAny>,
    history_moments: &Bound<'py, PyAny>,
    history_length: &Bound<'py, PyAny>,
    weight: Option<&Bound<'py, PyAny>>,
    gradient: Option<&Bound<'py, PyAny>>,
    confidence: Option<&Bound<'py, PyAny>>,
    alpha: f32,
    moments_alpha: f32,
    warmup: bool,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Accumulated> {
    let params = accumulate::Params {
        alpha,
        moments_alpha,
        warmup,
    };
    params.check()?;
    let mut missing = 0;
    let [color, moments, length] = {
        let color = Input::<f32>::new(color, "color", COLOR)?;
        let size = color.size();
        let history = Input::<f32>::of_size(history, "history", COLOR, size)?;
        let moments = Input::<f32>::of_size(history_moments, "history_moments", MOMENTS, size)?;
        let length = Input::<f32>::of_size(history_length, "history_length", Channels::One, size)?;
        let weight = Input::<f32>::optional(weight, "weight", Channels::One, size)?;
        let gradient = Input::<f32>::optional(gradient, "gradient", Channels::One, size)?;
        let confidence = Input::<f32>::optional(confidence, "confidence", Channels::One, size)?;
        let data = [
            color.pixels(),
            history.pixels(),
            moments.pixels(),
            length.pixels(),
        ];
        let [color, history @ ..] = data;
        let [weight, gradient, confidence] = [&weight, &gradient, &confidence]
            .map(|image| image.as_ref().map(|image| image.pixels().plane()));
        let missing = &mut missing;
        fill_history(py, out.as_ref(), size, |merged| {
            let samples = accumulate::Samples {
                size: color.size,
                color: &color,
                weight,
                gradient,
            };
            let history = accumulate::Images {
                parts: history,
                confidence,
            };
            let nothing = std::iter::repeat(());
            *missing = accumulate::accumulate(samples, &history, params, merged, nothing);
        })?
    };
    Ok(Accumulated {
        color: color.array()?.unbind(),
        moments: moments.array()?.unbind(),
        history_length: length.array()?.unbind(),
        missing,
    })
}

/// Colour, moments and length.
/// Lets `write` fill the arrays of a history: colour, moments and length.
fn fill_history<'py>(
    py: Python<'py>,
    out: Option<&Bound<'py, PyAny>>,
    size: Size,
    write: impl FnOnce(std::vec::IntoIter<[accumulate::Part; 3]>) + Send,
) -> PyResult<[Direct<'py>; 3]> {
    let Size { height, width } = size;
    let shapes: [&[usize]; 3] = [&[height, width, 3], &[height, width, 2], &[height, width]];
    fill_parts(py, out, shapes, |[colors, moments, lengths]| {
        let bands = PixelsMut::bands(size, 3, colors)
            .zip(PixelsMut::bands(size, 2, moments))
            .zip(PixelsMut::bands(size, 1, lengths))
            .map(|((color, moments), length)| [(0..3, color), (3..5, moments), (5..6, length)]);
        write(bands.collect::<Vec<_>>().into_iter());
    })
}

type Images<'py> = (
    Bound<'py, PyArrayDyn<f32>>,
    Bound<'py, PyArrayDyn<f32>>,
    Bound<'py, PyArrayDyn<f32>>,
);

/// Combine two independent histories of the same pixels, such as those of earlier and of later frames.
///
/// Parameters
/// ----------
/// color : (H, W, 3) array_like of float
///     Mean of the first history's samples.
/// moments : (H, W, 2) array_like of float
///     Means of luminance and of its square.
/// history_length : (H, W) array_like of float
///     Samples in each pixel.
/// other_color, other_moments, other_length : array_like of float
///     The same of the second history.
/// gradient : (H, W) array_like of float, optional
///     Relative change of light in the second history, 0 to 1; NaN counts as 0. It counts as fewer samples there.
/// exposure : float, optional
///     The scale of the light, above 0, as `exposure` returns it. If given, fireflies of one history that the other
///     does not confirm are held down.
/// out : tuple of (H, W, 3), (H, W, 2) and (H, W) float32 arrays, optional
///     Written and returned instead of new arrays; they may be inputs. A part may be None.
///
/// Returns
/// -------
/// color : (H, W, 3) float32
///     Mean over the samples of both.
/// moments : (H, W, 2) float32
///     Means of luminance and of its square.
/// history_length : (H, W) float32
///     The sum of both. Where no history has samples, colour and moments are NaN and the length is 0.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes or an exposure out of range.
///
/// See Also
/// --------
/// accumulate : Merges new samples into a history.
/// denoise : Denoises from both sides.
///
/// Notes
/// -----
/// Each is a mean over its samples, so the mean over all has the lengths for weights: ``c + N'/(N + N') (c' - c)``. A
/// gradient g shortens the second history to ``N' (1 - g)**10``, as in `accumulate`.
///
/// If one sample of N has nearly all light, ``m2`` is about ``N m1**2``. With an exposure, colour and moments of a
/// history with ``m2 >= 0.7 max(N, 2.5) m1**2`` are therefore multiplied by
/// ``min(1, 8 (max(l', 0) + exposure/16) / l)``, m2 by its square, l and l' the luminances of its colour and of the
/// other one's, if that has 2.5 samples or more.
///
/// Examples
/// --------
/// >>> color, moments = np.ones((1, 1, 3)), np.ones((1, 1, 2))
/// >>> mean, _, length = yester.combine_histories(color, moments, [[3.0]], 5 * color, moments, [[1.0]])
/// >>> mean, length
/// (array([[[2., 2., 2.]]], dtype=float32), array([[4.]], dtype=float32))
#[pyfunction]
#[pyo3(signature = (color, moments, history_length, other_color, other_moments, other_length, *, gradient=None, exposure=None,
    out=None))]
pub fn combine_histories<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    moments: &Bound<'py, PyAny>,
    history_length: &Bound<'py, PyAny>,
    other_color: &Bound<'py, PyAny>,
    other_moments: &Bound<'py, PyAny>,
    other_length: &Bound<'py, PyAny>,
    gradient: Option<&Bound<'py, PyAny>>,
    exposure: Option<f32>,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Images<'py>> {
    exposure.map_or(Ok(()), exposure::check)?;
    let [color, moments, length] = {
        let color = Input::<f32>::new(color, "color", COLOR)?;
        let size = color.size();
        let input = |value, name, channels| Input::<f32>::of_size(value, name, channels, size);
        let first = [
            color,
            input(moments, "moments", MOMENTS)?,
            input(history_length, "history_length", Channels::One)?,
        ];
        let second = [
            input(other_color, "other_color", COLOR)?,
            input(other_moments, "other_moments", MOMENTS)?,
            input(other_length, "other_length", Channels::One)?,
        ];
        let gradient = Input::<f32>::optional(gradient, "gradient", Channels::One, size)?;
        let [first, second] =
            [&first, &second].map(|inputs| inputs.each_ref().map(|input| input.pixels()));
        let gradient = gradient.as_ref().map(|image| image.pixels().plane());
        fill_history(py, out.as_ref(), size, |outs| {
            combine::combine(first, second, gradient, exposure, outs);
        })?
    };
    Ok((color.array()?, moments.array()?, length.array()?))
}

/// Mix the mean of a still scene's samples into a denoised image, by how far each is from the noise-free image.
///
/// Parameters
/// ----------
/// color : (H, W, 3) array_like of float
///     A denoised image of the scene.
/// mean : (H, W, 3) array_like of float
///     Mean of all its samples, linear.
/// moments : (H, W, 2) array_like of float
///     Means of the samples' luminance and of its square.
/// history_length : (H, W) array_like of float
///     Number of samples. `accumulate` returns all three, with ``alpha=0, moments_alpha=0``.
/// exposure : float, default 1.0
///     The scale of the light, above 0, as `exposure` returns it: below a sixteenth of it, differences count as
///     absolute instead of relative.
/// strictness : float, default 1.0
///     How much of the mean's variance counts; from 0. 1 if the image is independent of the mean's noise, less if it is
///     made of the same samples: `SVGF` takes 0.7.
/// out : (H, W, 3) float32 array, optional
///     Written and returned instead of a new array; it may be an input.
///
/// Returns
/// -------
/// color : (H, W, 3) float32
///     The image itself where there are fewer than eight samples, or a value that is not finite; the more of the mean,
///     the more samples there are.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes, an exposure or a strictness out of range.
///
/// See Also
/// --------
/// accumulate : Averages samples.
/// combine_histories : Merges two means.
/// SVGF : Does so with ``average_still=True``, while nothing moves.
///
/// Notes
/// -----
/// A denoised image O is wrong by what its filters blur, however many frames follow; the mean M of N samples by their
/// noise, which ends. In units of the light ``l = max(luminance(O), 0) + exposure/16``, with ``r = (M - O)/l`` and the
/// variance ``v = (m2 - m1*m1)/(N - 1) * (1 + 4/N)/l**2`` of M, tiles of 8×8 pixels have the share
/// ``s = max(0, 1 - strictness mean(v)/mean(luminance(r)**2))``, interpolated bilinearly, and the result is
/// ``O + s r l``: James and Stein's estimator [1]_ with O in the place of a fixed point.
///
/// References
/// ----------
/// .. [1] W. James, C. Stein, "Estimation with quadratic loss", Proceedings of the Fourth Berkeley Symposium on
///    Mathematical Statistics and Probability 1, 1961.
///
/// Examples
/// --------
/// Sixteen samples of a pattern that a filter has blurred:
///
/// >>> rng = np.random.default_rng(0)
/// >>> truth = np.tile(np.float32([0.5, 1.5]), (8, 4))[..., None].repeat(3, -1)
/// >>> samples = truth * rng.uniform(0.5, 1.5, (16, 8, 8, 1))
/// >>> light = samples.mean(-1)
/// >>> moments = np.stack([light.mean(0), (light**2).mean(0)], -1)
/// >>> blurred = np.ones_like(truth)
/// >>> found = yester.converge(blurred, samples.mean(0), moments, np.full((8, 8), 16.0))
/// >>> bool(np.abs(found - truth).mean() < 0.2 * np.abs(blurred - truth).mean())
/// True
#[pyfunction]
#[pyo3(name = "converge", signature = (color, mean, moments, history_length, *, exposure=1.0, strictness=1.0, out=None))]
pub fn converge_<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    mean: &Bound<'py, PyAny>,
    moments: &Bound<'py, PyAny>,
    history_length: &Bound<'py, PyAny>,
    exposure: f32,
    strictness: f32,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    exposure::check(exposure)?;
    converge::check_strictness(strictness)?;
    let shown = {
        let color = Input::<f32>::new(color, "color", COLOR)?;
        let size = color.size();
        let input = |value, name, channels| Input::<f32>::of_size(value, name, channels, size);
        let history = [
            input(mean, "mean", COLOR)?,
            input(moments, "moments", MOMENTS)?,
            input(history_length, "history_length", Channels::One)?,
        ];
        let out = Out::given(out, &[size.height, size.width, 3])?;
        let (color, history) = (color.pixels(), history.each_ref().map(Input::pixels));
        out.fill(py, |shown| {
            shown.copy_from_slice(color.to_interleaved().data_mut());
            converge::converge(shown, history, exposure, strictness);
        })?
    };
    shown.array()
}

/// Reconstruct one image from the jittered samples of several frames.
///
/// Parameters
/// ----------
/// samples : sequence of (H, W) or (H, W, C) array_like of float
///     One image per frame, all of one shape, or an (N, H, W, C) array. Pixels with NaN or infinity are missing.
/// offsets : (N, 2) array_like of float
///     Each frame's jitter: its samples' positions relative to pixel centres, x right, y down, in pixels from -0.5 to
///     0.5, as `jitter` returns them.
/// filter : {"blackman-harris", "box", "tent", "mitchell"}, default "blackman-harris"
///     Reconstruction filter: the Blackman-Harris window 3.3 pixels wide, the samples with ``-0.5 <= d < 0.5`` equally
///     weighted, ``1 - |d|``, or Mitchell and Netravali's cubic with B = C = 1/3.
/// out : float32 array like one of the samples, optional
///     Written and returned instead of a new array; it may be an input.
///
/// Returns
/// -------
/// image : float32 array like one of the samples
///     The supersampling sum Σwᵢcᵢ / Σwᵢ; NaN without valid samples.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes, an unknown filter, or offsets beyond half a pixel.
///
/// See Also
/// --------
/// jitter : Offsets.
/// resample : Resamples one frame to a grid of another size.
/// TAA : Approaches this image over time.
///
/// Notes
/// -----
/// For a static camera and scene this is the image to which temporal antialiasing should converge. The Blackman-Harris
/// window is that of Karis [1]_, the cubic that of Mitchell and Netravali [2]_.
///
/// References
/// ----------
/// .. [1] B. Karis, "High quality temporal supersampling", Advances in Real-Time Rendering in Games, SIGGRAPH courses,
///    2014.
/// .. [2] D. P. Mitchell, A. N. Netravali, "Reconstruction filters in computer graphics", Computer Graphics (SIGGRAPH)
///    22(4), 1988.
///
/// Examples
/// --------
/// >>> samples = [np.zeros((2, 2)), np.ones((2, 2))]
/// >>> yester.resolve(samples, [[0.0, 0.0], [0.0, 0.0]], filter="box")
/// array([[0.5, 0.5],
///        [0.5, 0.5]], dtype=float32)
#[pyfunction]
#[pyo3(name = "resolve", signature = (samples, offsets, *, filter="blackman-harris", out=None))]
pub fn resolve_<'py>(
    py: Python<'py>,
    samples: &Bound<'py, PyAny>,
    offsets: &Bound<'py, PyAny>,
    filter: &str,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let filter = choice("filter", filter, &resolve::Filter::NAMES)?;
    let (offsets, outer) = points::<2>(offsets, "offsets")?;
    if outer.len() != 1 {
        let got = format!("{} axes", outer.len() + 1);
        return Err(Error::value("offsets", "shape (N, 2)", got).into());
    }
    offsets.iter().copied().try_for_each(resolve::check)?;
    let image = {
        let images: Vec<_> = samples.try_iter()?.collect::<PyResult<_>>()?;
        if images.is_empty() || images.len() != offsets.len() {
            let expected = format!(
                "as many images as offsets, {}, and at least one",
                offsets.len()
            );
            return Err(Error::value("samples", expected, images.len()).into());
        }
        let images: Vec<_> = images
            .iter()
            .enumerate()
            .map(|(i, image)| Input::<f32>::new(image, &format!("samples[{i}]"), Channels::Any))
            .collect::<PyResult<_>>()?;
        let shape = images[0].shape();
        if let Some(i) = images.iter().position(|image| image.shape() != shape) {
            let name = format!("samples[{i}]");
            let [expected, got] = [shape, images[i].shape()].map(|shape| format!("{shape:?}"));
            return Err(
                Error::value(&name, format!("the shape of the first, {expected}"), got).into(),
            );
        }
        let out = Out::given(out, shape)?;
        let (size, channels) = (images[0].size(), images[0].channels());
        let frames: Vec<_> = (images.iter())
            .map(|image| image.pixels())
            .zip(offsets)
            .collect();
        out.fill(py, |image| {
            resolve::resolve(&frames, filter, PixelsMut::bands(size, channels, image));
        })?
    };
    image.array()
}

/// Blend history and new sample.
///
/// Parameters
/// ----------
/// color : (H, W, 3) array_like of float
///     The new samples, linear.
/// history : (H, W, 3) array_like of float
///     Reprojected and, as a rule, clipped.
/// alpha : float or (H, W) array_like of float, default 0.05
///     Blend factor: weight of the new sample, 0 to 1, for all pixels or for each, as `blend_factor` returns it. Maps
///     are clamped; NaN counts as 1.
/// weighting : {"none", "tone", "local-tone", "luminance"}, default "none"
///     "tone" weights both sides by 1/(exposure + luminance) as well; "local-tone" does so with four times the mean
///     luminance of the 3×3 pixels of `color` around for exposure, where that is more; "luminance" raises alpha up to
///     fourfold, but to 1 at most, where luminances differ.
/// flicker : float, default 1.0
///     Factor on alpha, 0 to 1, where history has the lowest or highest luminance of the 3×3 pixels of `color` around;
///     1 for no reduction.
/// exposure : float, default 1.0
///     The radiance that counts as 1, above 0, as `exposure` returns it.
/// out : (H, W, 3) float32 array, optional
///     Written and returned instead of a new array; it may be an input.
///
/// Returns
/// -------
/// blended : (H, W, 3) float32
///     History where the sample is missing, the sample where history is missing, NaN where both are.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes, an unknown weighting (the error lists them), alpha, flicker or exposure out of range.
///
/// See Also
/// --------
/// blend_factor : Blend factors from confidence and speed.
/// clip_history : Clips history, and blends in the same pass.
/// accumulate : Merges by the number of samples.
///
/// Notes
/// -----
/// First `flicker`, of Karis [1]_: with ``k = lerp(flicker, 1, d)`` and d the distance of history's luminance from the
/// nearer end of the neighbourhood's range, in half ranges, 0 beyond and 1 if there is no range, alpha becomes
/// ``alpha (k + alpha (1 - k))``. Then the weighting. "none": ``h + alpha (c - h)``. "tone" is Karis's, too. It darkens
/// the edges of lamps, as most samples that hit one count for little there; "local-tone", our own, does so less.
/// Missing pixels are left out of its mean, and negative luminances count as 0. "luminance": the same as "none" with
/// ``lerp(min(4 alpha, 1), alpha, (1 - d)²)`` for alpha and ``d = min(|l - l'| / max(l, l', 0.2 exposure), 1)``, as in
/// INSIDE [2]_.
///
/// References
/// ----------
/// .. [1] B. Karis, "High quality temporal supersampling", Advances in Real-Time Rendering in Games, SIGGRAPH courses,
///    2014.
/// .. [2] L. J. F. Pedersen (Playdead), "Temporal reprojection anti-aliasing in INSIDE", Game Developers Conference,
///    2016.
///
/// Examples
/// --------
/// >>> yester.blend(np.ones((1, 1, 3)), np.zeros((1, 1, 3)), alpha=0.25)
/// array([[[0.25, 0.25, 0.25]]], dtype=float32)
#[pyfunction]
#[pyo3(signature = (color, history, alpha=None, *, weighting="none", flicker=1.0, exposure=1.0, out=None))]
#[pyo3(
    text_signature = "(color, history, alpha=0.05, *, weighting='none', flicker=1.0, exposure=1.0, out=None)"
)]
#[pyo3(name = "blend")]
pub fn blend_<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    history: &Bound<'py, PyAny>,
    alpha: Option<&Bound<'py, PyAny>>,
    weighting: &str,
    flicker: f32,
    exposure: f32,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let params = blend::Params {
        weighting: choice("weighting", weighting, &blend::Params::WEIGHTINGS)?,
        flicker,
        exposure,
    };
    params.check()?;
    let blended = {
        let color = Input::<f32>::new(color, "color", COLOR)?;
        let size = color.size();
        let history = Input::<f32>::of_size(history, "history", COLOR, size)?;
        let alpha = match alpha {
            None => AlphaArg::Constant(0.05),
            Some(alpha) => AlphaArg::new(alpha, size)?,
        };
        let out = Out::given(out, color.shape())?;
        let [new, old] = [color.pixels(), history.pixels()];
        let alpha = alpha.data();
        out.fill(py, |blended| {
            blend::blend(new, old, alpha, params, PixelsMut::bands(size, 3, blended));
        })?
    };
    blended.array()
}

/// The `alpha` argument: a blend factor for all pixels, or one for each.
pub enum AlphaArg<'py> {
    Constant(f32),
    Map(Input<'py>),
}

impl<'py> AlphaArg<'py> {
    pub fn new(alpha: &Bound<'py, PyAny>, size: Size) -> PyResult<Self> {
        // `extract` would also accept an array of one pixel as a number, of which older versions of numpy warn.
        let axes = alpha
            .getattr("ndim")
            .and_then(|axes| axes.extract::<usize>());
        let is_image = alpha.is_instance_of::<PyUntypedArray>() || axes.is_ok_and(|axes| axes > 0);
        let share: Option<f32> = if is_image { None } else { alpha.extract().ok() };
        match share {
            Some(share) => {
                blend::check_alpha(share)?;
                Ok(Self::Constant(share))
            }
            None => Input::of_size(alpha, "alpha", Channels::One, size).map(Self::Map),
        }
    }

    pub fn data(&self) -> blend::Alpha<'_> {
        match self {
            Self::Constant(share) => blend::Alpha::Constant(*share),
            Self::Map(map) => blend::Alpha::Map(map.pixels().plane()),
        }
    }
}
