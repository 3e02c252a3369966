//! The kernels of the judge folder.

use numpy::PyArrayDyn;
use pyo3::prelude::*;

use super::arrays::{COLOR, Channels, Direct, Input, MOTION, Out, choice, detached, parts};
use super::merge::AlphaArg;
use crate::error::{Error, finite_from_0, whole};
use crate::image::{Records, Run, bands_of};
use crate::kernels::fetch::validate::Threshold;
use crate::kernels::judge::coherence::incoherent;
use crate::kernels::judge::light_change::light_change;
use crate::kernels::judge::{
    alternation, anti_lag, blend_factor, choice, collocation, exposure, gradient, innovation,
    neighborhood, prediction, repetition,
};
use crate::kernels::merge::blend::clip_and_blend;
use crate::pixels::PixelsMut;

/// Find the tiles in which normals and ids guide no filter: grass, fur and wire that are thinner than a pixel.
///
/// Every pixel there shows another surface than its neighbours, and yet another one in the next frame. A filter that
/// compares normals and ids finds no samples to average, so that depth alone should guide it, and validate history.
///
/// Parameters
/// ----------
/// normal : (H, W, 3) array_like of float, optional
///     Only directions count; zero and NaN differ from none. Needed without `ids`.
/// ids : (H, W) array_like of int, optional
///     Ids of objects, meshes or materials.
/// confidence : (H, W) array_like of float, optional
///     Confidence in history, 0 to 1, as `reproject` returns it. By default, only normals and ids decide.
/// out : (H, W) bool array, optional
///     Written and returned instead of a new array.
///
/// Returns
/// -------
/// mask : (H, W) bool
///     True in tiles of 16x16 pixels, from the top left, in which more than 0.4 of all pairs of neighbours along x and
///     y differ, in id or by more than 25 degrees in normal, and the mean confidence is from 0.1 to below 0.5.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes, or if neither `normal` nor `ids` is given.
/// TypeError
///     If `out` has another dtype.
///
/// See Also
/// --------
/// atrous : Compares normals and ids of neighbours.
///
/// Notes
/// -----
/// Pebbles and leaves of a few pixels differ as much from their neighbours, but are found again in the next frame, and
/// normals then tell how they are shaded: confidence tells them apart. Where no history is found, at a cut or behind
/// what moves away, that says nothing of the guides. In these tiles, `SVGF` fetches history again without ids and with
/// ``normal_angle=180``, and gives its filter normals of zero and the id 2**32 - 2 for all pixels whose id is not 0.
///
/// Examples
/// --------
/// >>> ids = np.ones((16, 32), np.uint32)
/// >>> ids[:, 16:] = np.random.default_rng(0).integers(1, 9, (16, 16))
/// >>> mask = yester.incoherent_guides(ids=ids)
/// >>> bool(mask[0, 0]), bool(mask[0, 16])
/// (False, True)
#[pyfunction]
#[pyo3(signature = (normal=None, ids=None, *, confidence=None, out=None), name = "incoherent_guides")]
pub fn incoherent_guides_<'py>(
    py: Python<'py>,
    normal: Option<&Bound<'py, PyAny>>,
    ids: Option<&Bound<'py, PyAny>>,
    confidence: Option<&Bound<'py, PyAny>>,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<bool>>> {
    let (mask, out) = {
        let normal =
            (normal.map(|normal| Input::<f32>::new(normal, "normal", COLOR))).transpose()?;
        let ids = (ids.map(|ids| Input::<u32>::new(ids, "ids", Channels::One))).transpose()?;
        let size = (normal.as_ref().map(Input::size)).or(ids.as_ref().map(Input::size));
        let Some(size) = size else {
            let expected = "an array where ids are not given";
            return Err(Error::value("normal", expected, "None").into());
        };
        let ids = ids.map(|ids| ids.sized("ids", size)).transpose()?;
        let confidence = Input::<f32>::optional(confidence, "confidence", Channels::One, size)?;
        let (normal, ids) = (
            normal.as_ref().map(Input::pixels),
            ids.as_ref().map(Input::pixels),
        );
        let confidence = confidence.as_ref().map(Input::pixels);
        let shape = [size.height, size.width];
        let out = Out::<bool>::given(out, &shape)?;
        let mask = out.bytes()?.fill(py, &shape, |mask| {
            let [normal, confidence] = [normal, confidence].map(|image| image);
            let tiles = incoherent(size, normal, ids, confidence);
            for (y, row) in mask.chunks_mut(size.width).enumerate() {
                row.fill(0);
                for part in tiles.runs(Run::row(y, size.width)) {
                    row[part.x..][..part.len].fill(1);
                }
            }
        })?;
        (mask, out)
    };
    out.array(mask.array()?)
}

/// Clip history to the range of the current frame's colours around each pixel.
///
/// Parameters
/// ----------
/// history : (H, W, 3) array_like of float
///     Reprojected colour, linear. Missing pixels stay as they are.
/// color : (H, W, 3) array_like of float
///     The current frame. Missing pixels do not count; history stays where the neighbourhood has no valid pixel.
/// box : {"variance", "minmax", "rounded", "intersection", "hull", "exact-hull", "chroma-hull"}, default "variance"
///     The bounds of the neighbourhood's colours: mean ± `gamma` standard deviations; range; mean of the ranges of the
///     square and of the cross in it; intersection of range and variance box; convex hull, as a polytope of 13 slabs (a
///     26-DOP, which contains the exact hull); exact convex hull, which is slower, much slower for 5×5; exact convex
///     hull of the chrominances, with the range of Y. The hulls need `response` "current", the last also a `space` with
///     chrominances.
/// gamma : float, default 1.0
///     Half the side of the variance box in standard deviations; from 0.
/// window : {"3x3", "5x5"}, default "3x3"
///     The neighbourhood.
/// space : {"ycocg", "rgb", "tonemapped-ycocg", "tonemapped-rgb"}, default "ycocg"
///     The colour space of the box. The last two apply c / (exposure + max(r, g, b)) first, so that a single bright
///     pixel does not open the box to everything; a clipped colour is limited to the brightest of history and
///     neighbourhood.
/// response : {"center", "clamp", "current", "ellipsoid"}, default "center"
///     How a colour outside is moved into the box: towards the box's centre; each channel clamped; towards the current
///     colour, itself clamped into the box; or onto the ellipsoid with half-axes gamma · deviation · (1.7, 1, 1) in
///     YCoCg, (1, 1, 1) in RGB, which needs `box` "variance".
/// exposure : float, default 1.0
///     The radiance that tone-mapped spaces map to 1/2, above 0, as `exposure` returns it.
/// alpha : float or (H, W) array_like of float, optional
///     Weight of the new sample, as in `blend`: also blends the clipped history with `color`, which saves a pass over
///     memory. By default, no blend.
/// out : (H, W, 3) float32 array, optional
///     Written and returned instead of a new array; it may be an input.
///
/// Returns
/// -------
/// history : (H, W, 3) float32
///     A colour inside its box keeps its bits. With `alpha`, the bits of ``blend(color, clip_history(...), alpha)``.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes, an unknown mode (the error lists the modes), `gamma`, `exposure` or `alpha` out of range.
///
/// See Also
/// --------
/// blend : Blends the result with the new samples.
/// anti_lag : Shortens history where clipping moved its colour.
/// TAA : The pipeline that clips every frame's history.
///
/// Notes
/// -----
/// The range is due to Lottes [1]_, the rounded range in YCoCg to Karis [2]_, the variance box to Salvi [3]_, the clip
/// towards the centre to INSIDE [4]_, the ellipsoid to AMD's FSR 3.1 [5]_, the tone curve to Lottes [6]_.
///
/// References
/// ----------
/// .. [1] T. Lottes, "TSSAA: temporal super-sampling AA", the author's weblog, 2011.
/// .. [2] B. Karis, "High quality temporal supersampling", Advances in Real-Time Rendering in Games, SIGGRAPH courses,
///    2014.
/// .. [3] M. Salvi, "An excursion in temporal supersampling", Game Developers Conference, 2016.
/// .. [4] L. J. F. Pedersen (Playdead), "Temporal reprojection anti-aliasing in INSIDE", Game Developers Conference,
///    2016.
/// .. [5] AMD, "FidelityFX Super Resolution 3.1", GPUOpen, 2024.
/// .. [6] T. Lottes, "Optimized reversible tonemapper for resolve", AMD GPUOpen, 2016.
///
/// Examples
/// --------
/// >>> color = np.full((3, 3, 3), 0.5)
/// >>> color[1, 1] = 0.8
/// >>> history = np.full((3, 3, 3), 2.0)
/// >>> yester.clip_history(history, color, box="minmax")[1, 1]
/// array([0.8, 0.8, 0.8], dtype=float32)
#[pyfunction]
#[pyo3(name = "clip_history", signature = (history, color, *, r#box="variance", gamma=1.0, window="3x3", space="ycocg",
    response="center", exposure=1.0, alpha=None, out=None))]
pub fn clip_history_<'py>(
    py: Python<'py>,
    history: &Bound<'py, PyAny>,
    color: &Bound<'py, PyAny>,
    r#box: &str,
    gamma: f32,
    window: &str,
    space: &str,
    response: &str,
    exposure: f32,
    alpha: Option<&Bound<'py, PyAny>>,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let params = neighborhood::Params {
        bounds: choice("box", r#box, &neighborhood::Params::BOUNDS)?,
        gamma,
        radius: choice("window", window, &neighborhood::Params::WINDOWS)?,
        space: choice("space", space, &neighborhood::Params::SPACES)?,
        response: choice("response", response, &neighborhood::Params::RESPONSES)?,
        exposure,
    };
    params.check()?;
    let clipped = {
        let history = Input::<f32>::new(history, "history", COLOR)?;
        let color = Input::<f32>::new(color, "color", COLOR)?.sized("color", history.size())?;
        let alpha = alpha
            .map(|alpha| AlphaArg::new(alpha, history.size()))
            .transpose()?;
        let out = Out::given(out, history.shape())?;
        let [old, new] = [history.pixels(), color.pixels()];
        let alpha = alpha.as_ref().map(AlphaArg::data);
        out.fill(py, history.shape(), |clipped| {
            let clipped = PixelsMut::bands(new.size, 3, clipped);
            match alpha {
                Some(alpha) => clip_and_blend(new, old, alpha, params, clipped),
                None => neighborhood::clip_history(old, new, params, clipped),
            }
        })?
    };
    clipped.array()
}

/// Measure the scale of a frame's radiance, for tone curves.
///
/// Parameters
/// ----------
/// color : (H, W, 3) array_like of float
///     Linear. Missing pixels do not count.
///
/// Returns
/// -------
/// exposure : float
///     ``8 (mean √l)²`` of the luminances l, negative ones as 0: proportional to the frame's radiance, determined by
///     all of its pixels rather than by a few bright ones, and near 1 for images exposed like photographs. 1 for a
///     black frame.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes.
///
/// See Also
/// --------
/// clip_history : Takes the exposure for tone-mapped colour spaces.
/// innovation : Takes the exposure as the scale of differences.
///
/// Notes
/// -----
/// A power mean instead of the log-average of photographic tone reproduction [1]_, which is 0 as soon as a pixel is
/// black.
///
/// References
/// ----------
/// .. [1] E. Reinhard, M. Stark, P. Shirley, J. Ferwerda, "Photographic tone reproduction for digital images", ACM
///    Transactions on Graphics 21(3), 2002.
///
/// Examples
/// --------
/// >>> round(yester.exposure(np.full((2, 2, 3), 0.18)), 3)
/// 1.44
/// >>> yester.exposure(np.zeros((2, 2, 3)))
/// 1.0
#[pyfunction]
#[pyo3(name = "exposure")]
pub fn exposure_(py: Python<'_>, color: &Bound<'_, PyAny>) -> PyResult<f32> {
    let color = Input::<f32>::new(color, "color", COLOR)?;
    let color = color.pixels();
    detached(py, || exposure::exposure(color))
}

/// Find the factor by which all light has changed since the history, if it is one factor.
///
/// That of an exposure, of a fade, or of a lamp that lights everything. History times the factor is not outdated.
///
/// Parameters
/// ----------
/// color, history : (H, W, 3) array_like of float
///     New samples, and reprojected history; illumination (see `demodulate`) if there is albedo. Missing pixels do not
///     count.
/// coverage : (H, W) array_like of float, optional
///     Of the history, as `reproject` returns it: only pixels with more than 0.9 count. By default, all do.
///
/// Returns
/// -------
/// change : float
///     From 10⁻⁶ to 10⁶; 1 where blocks of the image disagree, or too little is known.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes.
///
/// See Also
/// --------
/// innovation : Finds changes that differ from place to place.
/// exposure : The scale of one frame's radiance.
///
/// Notes
/// -----
/// The image is divided into 64 blocks, 8 across and 8 down. Of each that knows a sixteenth of its pixels,
/// ``r = ln Σ l(color) - ln Σ l(history)``, with l the luminance. If at least 16 do, with m the median of r and d the
/// third quartile of ``|r - m|``, the change is ``exp(m)`` where ``|m| > 1.25 d``, ``d < 0.15`` and ``|m| < ln 10⁶``,
/// else 1. Of H rows, every ⌊H/128⌋th is looked at, or the next odd number.
///
/// Examples
/// --------
/// >>> history = np.random.default_rng(0).uniform(size=(64, 64, 3))
/// >>> round(yester.light_change(0.8 * history, history), 3)
/// 0.8
/// >>> history[:, 32:] *= 2
/// >>> yester.light_change(np.ones((64, 64, 3)), history)
/// 1.0
#[pyfunction]
#[pyo3(name = "light_change", signature = (color, history, coverage=None))]
pub fn light_change_<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    history: &Bound<'py, PyAny>,
    coverage: Option<&Bound<'py, PyAny>>,
) -> PyResult<f32> {
    let color = Input::<f32>::new(color, "color", COLOR)?;
    let size = color.size();
    let history = Input::<f32>::new(history, "history", COLOR)?.sized("history", size)?;
    let coverage = Input::<f32>::optional(coverage, "coverage", Channels::One, size)?;
    let coverage = coverage.as_ref().map(|coverage| coverage.pixels().plane());
    let (color, history) = (color.pixels(), history.pixels());
    detached(py, || light_change(color, history, coverage))
}

/// Compute the blend factor of the new sample from the confidence in history and from speed.
///
/// Parameters
/// ----------
/// confidence : (H, W) array_like of float
///     0 to 1, as `consistency` or the coverage of `reproject` gives it; clamped, NaN counts as 0.
/// motion : (H, W, 2) or (H, W, 3) array_like of float, optional
///     In pixels. Where it is not finite, the blend factor is 1.
/// alpha : float, default 0.05
///     Blend factor for full confidence and slow motion, 0 to 1.
/// fast_alpha : float, default 0.2
///     Blend factor for full confidence and fast motion, 0 to 1; no effect if below `alpha`.
/// speed : float or (float, float), default (0, 1)
///     Pixels up to which motion is slow, and from which it is fast.
/// out : (H, W) float32 array, optional
///     Written and returned instead of a new array; it may be an input.
///
/// Returns
/// -------
/// alpha : (H, W) float32
///     ``lerp(a, 1, 1 - confidence)`` with ``a = lerp(alpha, max(alpha, fast_alpha), clamp((|motion| - s0)/(s1 -
///     s0)))``.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes or parameters out of range.
///
/// See Also
/// --------
/// blend : Takes the result.
/// consistency : Confidence in history.
///
/// Notes
/// -----
/// History gives way where confidence in it is low, and where motion is fast: there, resampling has blurred it, and its
/// ghosts would be long.
///
/// Examples
/// --------
/// >>> yester.blend_factor([[1.0, 0.5, 0.0]])
/// array([[0.05 , 0.525, 1.   ]], dtype=float32)
/// >>> yester.blend_factor([[1.0, 1.0]], [[[0.5, 0.0], [3.0, 0.0]]])
/// array([[0.125, 0.2  ]], dtype=float32)
#[pyfunction]
#[pyo3(name = "blend_factor", signature = (confidence, motion=None, *, alpha=0.05, fast_alpha=0.2,
    speed=Threshold { full: 0.0, none: 1.0 }, out=None))]
#[pyo3(
    text_signature = "(confidence, motion=None, *, alpha=0.05, fast_alpha=0.2, speed=(0.0, 1.0), out=None)"
)]
pub fn blend_factor_<'py>(
    py: Python<'py>,
    confidence: &Bound<'py, PyAny>,
    motion: Option<&Bound<'py, PyAny>>,
    alpha: f32,
    fast_alpha: f32,
    speed: Threshold,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let params = blend_factor::Params {
        alpha,
        fast_alpha,
        speed,
    };
    params.check()?;
    let factor = {
        let confidence = Input::<f32>::new(confidence, "confidence", Channels::One)?;
        let motion = Input::<f32>::optional(motion, "motion", MOTION, confidence.size())?;
        let out = Out::given(out, confidence.shape())?;
        let motion = motion.as_ref().map(|motion| motion.pixels());
        let known = confidence.pixels().plane();
        out.fill(py, confidence.shape(), |alpha| {
            let alpha = PixelsMut::bands(known.size, 1, alpha);
            blend_factor::blend_factor(known, motion, params, alpha);
        })?
    };
    factor.array()
}

/// Shorten histories in proportion to the distance that clipping moved them.
///
/// Parameters
/// ----------
/// history_length : (H, W) array_like of float
///     History length in samples.
/// history, clipped : (H, W, 3) array_like of float
///     Colour before and after `clip_history`.
/// strength : float, default 1.0
///     At least 0; 0 leaves lengths unchanged.
/// out : (H, W) float32 array, optional
///     Written and returned instead of a new array; it may be an input.
///
/// Returns
/// -------
/// history_length : (H, W) float32
///     ``N / (1 + strength d N)`` with ``d = |l - l'| / max(|l|, |l'|)`` of the luminances; d is 0 where both are black
///     or one is missing.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes or a strength out of range.
///
/// See Also
/// --------
/// clip_history : Clips the history.
/// temporal_gradient : Detects changes of light before clipping.
///
/// Notes
/// -----
/// To be used with a fast history: ``clip_history(slow, fast, window="5x5")`` clips the slow average to the range of
/// the last few frames, and where that moved it, the shortened length gives new samples more weight. After NRD's ReBLUR
/// and ReLAX [1]_, in a similar form. `TAA` applies it to its own clipping if `anti_lag` is above 0.
///
/// References
/// ----------
/// .. [1] NVIDIA, "NVIDIA Real-Time Denoisers" (ReBLUR, ReLAX), github.com/NVIDIA-RTX/NRD; D. Zhdan, "ReBLUR: a
///    hierarchical recurrent denoiser", Ray Tracing Gems II, 2021.
///
/// Examples
/// --------
/// >>> length = np.array([[20.0, 20.0]])
/// >>> history = np.ones((1, 2, 3))
/// >>> clipped = history * [[[1.0], [0.5]]]
/// >>> yester.anti_lag(length, history, clipped)
/// array([[20.    ,  1.8182]], dtype=float32)
#[pyfunction]
#[pyo3(name = "anti_lag", signature = (history_length, history, clipped, *, strength=1.0, out=None))]
pub fn anti_lag_<'py>(
    py: Python<'py>,
    history_length: &Bound<'py, PyAny>,
    history: &Bound<'py, PyAny>,
    clipped: &Bound<'py, PyAny>,
    strength: f32,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    finite_from_0("strength", strength)?;
    let shortened = {
        let length = Input::<f32>::new(history_length, "history_length", Channels::One)?;
        let size = length.size();
        let history = Input::<f32>::new(history, "history", COLOR)?.sized("history", size)?;
        let clipped = Input::<f32>::new(clipped, "clipped", COLOR)?.sized("clipped", size)?;
        let out = Out::given(out, length.shape())?;
        let [old, new] = [history.pixels(), clipped.pixels()];
        let lengths = length.pixels().plane();
        out.fill(py, length.shape(), |shortened| {
            let shortened = PixelsMut::bands(size, 1, shortened);
            anti_lag::anti_lag(lengths, old, new, strength, shortened);
        })?
    };
    shortened.array()
}

/// Detect neighbourhoods whose colours alternate from frame to frame.
///
/// Where an aliased feature is wider than the neighbourhood, clipping follows every frame, and the image flickers. The
/// return of earlier colours distinguishes this from a change of light.
///
/// Parameters
/// ----------
/// color : (H, W, 3) array_like of float
///     The new frame, linear. Missing pixels do not count.
/// memory : (H, W, 7) array_like of float, optional
///     The previous frame's result, reprojected; NaN where there is no history. By default there is none.
/// exposure : float, default 1.0
///     The radiance that the tone curve maps to 1/2, above 0, as `exposure` returns it.
/// out : (H, W, 7) float32 array, optional
///     Written and returned instead of a new array.
///
/// Returns
/// -------
/// memory : (H, W, 7) float32
///     In tone-mapped YCoCg the mean of the 3×3 pixels and their mean before its last jump; then a count of returns, 0
///     to 3. ``np.clip(memory[..., 6] - 1, 0, 1)`` is the weight of unclipped history. NaN where no pixel was ever
///     valid.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes or an exposure out of range.
///
/// See Also
/// --------
/// clip_history : Makes such neighbourhoods flicker.
/// thin_features : Detects features narrower than the neighbourhood.
///
/// Notes
/// -----
/// A mean jumps if it moves by more than the range of its pixels in some channel, and by more than a fifth of the
/// larger one's largest channel. A jump is a return if the new mean is less than half as far from the mean before the
/// last jump as from the last mean: it increments the count; other jumps reset it. Without a jump, the count and the
/// earlier mean decay by an eighth per frame, so that at most five frames may lie between a colour and its return.
/// AMD's FSR 2.2 [1]_ detects returning luminances of single pixels among the last four frames.
///
/// References
/// ----------
/// .. [1] AMD, "FidelityFX Super Resolution 2", GPUOpen, 2022.
///
/// Examples
/// --------
/// >>> memory = None
/// >>> for light in (0.1, 1.0, 0.1, 1.0, 0.1):
/// ...     memory = yester.alternation(np.full((3, 3, 3), light), memory)
/// >>> memory[..., 6]
/// array([[3., 3., 3.],
///        [3., 3., 3.],
///        [3., 3., 3.]], dtype=float32)
#[pyfunction]
#[pyo3(name = "alternation", signature = (color, memory=None, *, exposure=1.0, out=None))]
pub fn alternation_<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    memory: Option<&Bound<'py, PyAny>>,
    exposure: f32,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    exposure::check(exposure)?;
    let next = {
        let color = Input::<f32>::new(color, "color", COLOR)?;
        let size = color.size();
        let channels = Channels::Of(&[alternation::CHANNELS]);
        let memory = Input::<f32>::optional(memory, "memory", channels, size)?;
        let shape = [size.height, size.width, alternation::CHANNELS];
        let out = Out::given(out, &shape)?;
        let (color, memory) = (color.pixels(), memory.as_ref().map(Input::pixels));
        let known = memory.map(|memory| alternation::Known {
            memory,
            coverage: None,
        });
        out.fill(py, &shape, |next| {
            let next = PixelsMut::bands(size, alternation::CHANNELS, next);
            alternation::alternation(color, known, exposure, next);
        })?
    };
    next.array()
}

/// Measure the relative change of light, beyond the change that noise explains.
///
/// Parameters
/// ----------
/// color, previous : (H, W, 3) array_like of float
///     Two images of the same pixels. For the exact gradient the previous frame and its `Frame.replay`, a re-render
///     with the same random numbers, and ``noise=0``; for an estimate the new frame and the reprojected history.
///     Illumination (see `demodulate`) if there is albedo. Missing pixels do not count.
/// noise : float, default 2.0
///     Standard errors of the local mean that are attributed to noise; at least 0.
/// passes : int, default 3
///     Passes of the smallest blur, 0 to 8; its radius is 2^passes - 1 pixels.
/// widest : int, default 3
///     Passes of the widest blur, `passes` to 8. Small blurs locate a change of light, wide ones detect changes that
///     are small but extended; the largest gradient counts. `SVGF` estimates with 5, and ``noise=2.5``.
/// out : (H, W) float32 array, optional
///     Written and returned instead of a new array; it may be an input.
///
/// Returns
/// -------
/// gradient : (H, W) float32
///     0 (no change, or missing) to 1 (all of the light has appeared or vanished).
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes or parameters out of range.
///
/// See Also
/// --------
/// accumulate : Takes the result, to shorten history.
/// innovation : Corrects what has changed.
///
/// Notes
/// -----
/// With the difference of luminances δ and the larger of them m, blurred means ⟨·⟩ over {1, 2, 1}/4 kernels at steps of
/// 1, 2, 4, …, and the standard error s of ⟨δ⟩: ``clamp((|⟨δ⟩| - noise s) / ⟨m⟩, 0, 1)``. The original (Schied et al.
/// [1]_) has exact gradients and no margin for noise.
///
/// References
/// ----------
/// .. [1] C. Schied, C. Peters, C. Dachsbacher, "Gradient estimation for real-time adaptive temporal filtering",
///    Proceedings of the ACM on Computer Graphics and Interactive Techniques 1(2), 2018.
///
/// Examples
/// --------
/// >>> previous = np.ones((4, 4, 3))
/// >>> yester.temporal_gradient(previous / 2, previous, noise=0)[0]
/// array([0.5, 0.5, 0.5, 0.5], dtype=float32)
#[pyfunction]
#[pyo3(signature = (color, previous, *, noise=2.0, passes=3, widest=3, out=None))]
pub fn temporal_gradient<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    previous: &Bound<'py, PyAny>,
    noise: f32,
    passes: i128,
    widest: i128,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let params = gradient::Params {
        noise,
        passes: gradient::Params::passes("passes", passes)?,
        widest: gradient::Params::passes("widest", widest)?,
    };
    params.check()?;
    let gradient = {
        let color = Input::<f32>::new(color, "color", COLOR)?;
        let size = color.size();
        let previous = Input::<f32>::new(previous, "previous", COLOR)?.sized("previous", size)?;
        let shape = [size.height, size.width];
        let out = Out::given(out, &shape)?;
        let [color, previous] = [color.pixels(), previous.pixels()];
        out.fill(py, &shape, |gradient| {
            gradient::temporal_gradient(color, previous, None, params, gradient);
        })?
    };
    gradient.array()
}

/// Estimate the error of a prediction from new samples.
///
/// New samples are noisy but unbiased; a denoised image is steady, but lags and blurs. Where the mean of their
/// difference is larger than noise explains, it is returned, to be added to the image and to its history.
///
/// Parameters
/// ----------
/// color : (H, W, 3) array_like of float
///     New samples; illumination (see `demodulate`) if there is albedo. Missing pixels do not count.
/// prediction : (H, W, 3) array_like of float
///     The image to be corrected.
/// history_length : (H, W) array_like of float
///     Samples in each pixel's prediction. A short prediction is correlated with the newest sample, which is part of
///     it.
/// evidence : (ceil(H / 2), ceil(W / 2), 4) array_like of float, optional
///     The previous frame's result; none for the first frame.
/// motion : (H, W, 2) or (H, W, 3) array_like of float, optional
///     Motion in pixels along which `evidence` is fetched. By default none.
/// exposure : float, default 1.0
///     Exposure of the image, as `exposure` returns it; above 0. Differences are relative to the light plus a sixteenth
///     of it.
/// strictness : float, default 3.0
///     Ratio of a squared mean to its variance up to which the mean counts as noise; at least 0.
/// share : float, default 0.5
///     Weight of the new frame in the evidence, above 0, up to 1, which discards earlier evidence.
/// levels : int, default 4
///     Block sizes, 1 to 8: 2 pixels, 4, 8, ….
/// fed_back : bool, default True
///     The history of the next prediction is corrected as well. If not, the next samples show the same difference
///     again, and the evidence keeps the corrected part.
/// sparse : bool, default False
///     `color` has samples in few pixels, and the prediction is made of few. Differences are then relative to the local
///     mean of the light, as the prediction itself is noisy; and unknown blocks, whose variance in `evidence` is NaN,
///     are left out of the means.
/// out : tuple of (H, W, 3) and (ceil(H / 2), ceil(W / 2), 4) float32 arrays, optional
///     Written and returned instead of new arrays. A part may be None.
///
/// Returns
/// -------
/// correction : (H, W, 3) float32
///     To be added to the prediction; 0 where no error was found.
/// evidence : (ceil(H / 2), ceil(W / 2), 4) float32
///     For the next frame: the relative difference that is not fed back, and its variance.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes or parameters out of range.
///
/// See Also
/// --------
/// temporal_gradient : Detects changes of light, to shorten history.
/// exposure : Exposure of the image.
///
/// Notes
/// -----
/// r = (color - prediction) / (l + exposure / 16) is clamped to ±50; E is its mean over blocks of 2×2 pixels and over
/// frames; l is max(prediction, 0), or with `sparse` its mean over blocks of 4×4 pixels, interpolated between their
/// centres. From the coarsest level to the finest, b is the mean of the rest of E over 3×3 blocks, weighted {1, 2, 1}
/// along both axes; it is multiplied by ``max(0, 1 - strictness v / |b|²)``, with v its variance, estimated from the
/// squares of r, and one factor for the three channels: the shrinkage of James and Stein [1]_, scale by scale as Donoho
/// and Johnstone do [2]_. The difference of sample and prediction is the innovation of the Kalman filter [3]_. A single
/// bright sample has ``|b|² = v`` and never changes the image.
///
/// References
/// ----------
/// .. [1] W. James, C. Stein, "Estimation with quadratic loss", Proceedings of the Fourth Berkeley Symposium on
///    Mathematical Statistics and Probability 1, 1961.
/// .. [2] D. L. Donoho, I. M. Johnstone, "Ideal spatial adaptation by wavelet shrinkage", Biometrika 81(3), 1994.
/// .. [3] R. E. Kalman, "A new approach to linear filtering and prediction problems", Journal of Basic Engineering
///    82(1), 1960.
///
/// Examples
/// --------
/// >>> prediction = np.ones((16, 16, 3))
/// >>> length = np.full((16, 16), 20.0)
/// >>> correction, evidence = yester.innovation(prediction * 1.5, prediction, length)
/// >>> correction[8, 8].round(3)
/// array([0.494, 0.494, 0.494], dtype=float32)
#[pyfunction]
#[pyo3(name = "innovation", signature = (color, prediction, history_length, evidence=None, motion=None, *, exposure=1.0,
    strictness=3.0, share=0.5, levels=4, fed_back=true, sparse=false, out=None))]
#[pyo3(
    text_signature = "(color, prediction, history_length, evidence=None, motion=None, *, exposure=1.0, strictness=3.0, \
    share=0.5, levels=4, fed_back=True, sparse=False, out=None)"
)]
pub fn innovation_<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    prediction: &Bound<'py, PyAny>,
    history_length: &Bound<'py, PyAny>,
    evidence: Option<&Bound<'py, PyAny>>,
    motion: Option<&Bound<'py, PyAny>>,
    exposure: f32,
    strictness: f32,
    share: f32,
    levels: i128,
    fed_back: bool,
    sparse: bool,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<(Bound<'py, PyArrayDyn<f32>>, Bound<'py, PyArrayDyn<f32>>)> {
    let params = innovation::Params {
        fed_back,
        sparse,
        strictness,
        share,
        levels: innovation::Params::levels(levels)?,
    };
    params.check()?;
    exposure::check(exposure)?;
    let (correction, left) = {
        let color = Input::<f32>::new(color, "color", COLOR)?;
        let size = color.size();
        let prediction =
            Input::<f32>::new(prediction, "prediction", COLOR)?.sized("prediction", size)?;
        let length = Input::<f32>::new(history_length, "history_length", Channels::One)?;
        let length = length.sized("history_length", size)?;
        let small = innovation::evidence_size(size);
        let channels = Channels::Of(&[innovation::CHANNELS]);
        let evidence = Input::<f32>::optional(evidence, "evidence", channels, small)?;
        let motion = Input::<f32>::optional(motion, "motion", MOTION, size)?;
        let [first, second] = parts(out.as_ref())?;
        let shape = color.shape();
        let blocks = [small.height, small.width, innovation::CHANNELS];
        let out = (Out::given(first, shape)?, Out::given(second, &blocks)?);
        let mut correction = Direct::new(py, out.0, shape)?;
        let mut left = Direct::new(py, out.1, &blocks)?;
        let [color, prediction] = [color.pixels(), prediction.pixels()];
        let length = length.pixels();
        let motion = motion.as_ref().map(|motion| motion.pixels());
        let known = evidence.as_ref().map(|evidence| innovation::Known {
            evidence: evidence.pixels(),
            motion,
        });
        let (bands, records) = (correction.data()?, left.data()?);
        detached(py, || {
            let (found, rest) =
                innovation::innovation(&color, &prediction, length, known, exposure, params);
            found.corrections(&prediction, size, PixelsMut::bands(size, 3, bands));
            records.copy_from_slice(rest.pixels().elements().0);
        })?;
        (correction, left)
    };
    Ok((correction.array()?, left.array()?))
}

/// Choose the best of several predictions, tile by tile, by the evidence of earlier frames.
///
/// Parameters
/// ----------
/// evidence : (⌈H/8⌉, ⌈W/8⌉, 2 K) array_like of float
///     The previous frame's, as `compare_candidates` returns it.
/// motion : (H, W, 2) or (H, W, 3) array_like of float
///     Motion in pixels. A tile's evidence comes from where its centre does.
/// coverage : (H, W) array_like of float
///     Above 0 where the pixel's surface was visible in the previous frame (see `reproject`); tiles whose centre was
///     not have no evidence.
/// usual : int, default 0
///     The default candidate: it is chosen without evidence, and all others are compared with it.
/// strictness : float, default 0.5
///     Standard errors by which another candidate must be better; at least 0.
/// share : float, default 0.3
///     Fraction of the evidence that decays per frame; 0 to 1.
/// out : tuple of (⌈H/8⌉, ⌈W/8⌉) and (⌈H/8⌉, ⌈W/8⌉, 2 K) float32 arrays, optional
///     Written and returned, as choice and evidence, instead of new arrays. A part may be None.
///
/// Returns
/// -------
/// choice : (⌈H/8⌉, ⌈W/8⌉) float32
///     The candidate that each tile of 8×8 pixels should show: an integer from 0 to K - 1. To hide the tiles,
///     interpolate between their centres, and mix two candidates where the result is fractional.
/// evidence : (⌈H/8⌉, ⌈W/8⌉, 2 K) float32
///     The evidence where the tiles are in this frame, decayed: `compare_candidates` adds this frame's.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes, evidence of fewer than 2 candidates, or parameters out of range.
///
/// See Also
/// --------
/// compare_candidates : Adds a frame's evidence.
/// SVGF : Chooses the number of filter passes in this way.
///
/// Notes
/// -----
/// A tile's sums are averaged with those of its neighbours, with weights {1, 2, 1}/4 along each axis. The candidate
/// with the least mean gain plus `strictness` standard errors of the steps between it and the default one wins if that
/// is below 0; with fewer than 16 samples in the average, the default candidate stays. The variance of an average is
/// that of a tile, divided by 64/9, the effective number of tiles in it.
///
/// Examples
/// --------
/// >>> sample = np.ones((8, 8, 3))
/// >>> candidates = np.stack([np.full((8, 8), 0.5), np.full((8, 8), 1.0)], -1)
/// >>> evidence = yester.compare_candidates(sample, candidates)
/// >>> best, evidence = yester.choice(evidence, np.zeros((8, 8, 2)), np.ones((8, 8)))
/// >>> best
/// array([[1.]], dtype=float32)
#[pyfunction]
#[pyo3(name = "choice", signature = (evidence, motion, coverage, *, usual=0, strictness=0.5, share=0.3, out=None))]
pub fn choice_<'py>(
    py: Python<'py>,
    evidence: &Bound<'py, PyAny>,
    motion: &Bound<'py, PyAny>,
    coverage: &Bound<'py, PyAny>,
    usual: i128,
    strictness: f32,
    share: f32,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<(Bound<'py, PyArrayDyn<f32>>, Bound<'py, PyArrayDyn<f32>>)> {
    let params = choice::Params { strictness, share };
    params.check()?;
    let (chosen, carried) = {
        let motion = Input::<f32>::new(motion, "motion", MOTION)?;
        let size = motion.size();
        let coverage = Input::<f32>::new(coverage, "coverage", Channels::One)?;
        let coverage = coverage.sized("coverage", size)?;
        let tiles = choice::tiles(size);
        let evidence = Input::<f32>::new(evidence, "evidence", Channels::Any)?;
        let evidence = evidence.sized("evidence", tiles)?;
        let numbers = evidence.pixels().channels;
        if numbers < 4 || !numbers.is_multiple_of(2) {
            let got = format!("{numbers} channels");
            return Err(Error::value("evidence", "4, 6, 8, … channels", got).into());
        }
        let last = numbers / 2 - 1;
        let expected = format!("a candidate, 0 to {last}");
        let usual = whole("usual", usual, &expected, |&n: &usize| n <= last)?;
        let [first, second] = parts(out.as_ref())?;
        let shapes = [tiles.height, tiles.width, numbers];
        let out = (
            Out::given(first, &shapes[..2])?,
            Out::given(second, &shapes)?,
        );
        let mut chosen = Direct::new(py, out.0, &shapes[..2])?;
        let mut carried = Direct::new(py, out.1, &shapes)?;
        let images = [&evidence, &motion, &coverage].map(|input| input.pixels());
        let (plane, records) = (chosen.data()?, carried.data()?);
        detached(py, || {
            let [evidence, motion, coverage] = images;
            let coverage = coverage.plane();
            let (best, rest) = choice::choice(evidence, motion, coverage, usual, params);
            plane.copy_from_slice(best.plane(0));
            records.copy_from_slice(rest.pixels().elements().0);
        })?;
        (chosen, carried)
    };
    Ok((chosen.array()?, carried.array()?))
}

/// Compare predictions with new samples that none of them has seen, tile by tile.
///
/// Parameters
/// ----------
/// color : (H, W, 3) array_like of float
///     The new, noisy samples. Missing pixels do not count.
/// candidates : (H, W, K) array_like of float
///     K predictions of the samples' luminance, at least 2. They are a series, such as the predictions that more and
///     more passes of `atrous` return. Pixels where one is not finite do not count.
/// evidence : (⌈H/8⌉, ⌈W/8⌉, 2 K) array_like of float, optional
///     That of earlier frames, as `choice` returns it.
/// exposure : float, default 1.0
///     `exposure` of the image; above 0. Errors of luminances well below a sixteenth of it count as absolute, of
///     brighter ones as relative.
/// usual : int, default 0
///     The default candidate, relative to which errors are measured.
/// out : (⌈H/8⌉, ⌈W/8⌉, 2 K) float32 array, optional
///     Written and returned instead of a new array; it may be the evidence.
///
/// Returns
/// -------
/// evidence : (⌈H/8⌉, ⌈W/8⌉, 2 K) float32
///     With this frame's added: the weighted sums of the gains of the K - 1 steps, negative where a step reduces the
///     error; then those of their squares; then the sum of the samples' weights, and their number.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes, fewer than 2 candidates, or parameters out of range.
///
/// See Also
/// --------
/// choice : Chooses by the evidence.
/// prediction_gain : Compares two histories pixel by pixel.
/// atrous : Returns such predictions.
///
/// Notes
/// -----
/// The gain of step k is ``(a - b)(a + b - 2r)``. Candidates a and b and the sample's luminance r are taken relative to
/// the default candidate: with m its luminance, at least 0, each value v becomes ``(v - m) / (m + exposure / 16)``, and
/// r is then clamped to ±8. Where no sample is clamped, this is an unbiased estimate of the difference of two squared
/// errors (see `prediction_gain`).
///
/// A frame's gains in a tile are weighted by ``1 / √(Σ d² / n + 1e-6)``, over their n samples and all steps, and the
/// squares by its square, so that no frame decides alone.
///
/// Examples
/// --------
/// >>> sample = np.ones((8, 8, 3))
/// >>> candidates = np.stack([np.full((8, 8), 0.5), np.full((8, 8), 1.0)], -1)
/// >>> gain, square, weight, count = yester.compare_candidates(sample, candidates)[0, 0]
/// >>> bool(gain < 0), float(count)
/// (True, 64.0)
#[pyfunction]
#[pyo3(signature = (color, candidates, evidence=None, *, exposure=1.0, usual=0, out=None))]
pub fn compare_candidates<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    candidates: &Bound<'py, PyAny>,
    evidence: Option<&Bound<'py, PyAny>>,
    exposure: f32,
    usual: i128,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    exposure::check(exposure)?;
    let after = {
        let color = Input::<f32>::new(color, "color", COLOR)?;
        let size = color.size();
        let candidates = Input::<f32>::new(candidates, "candidates", Channels::Any)?;
        let candidates = candidates.sized("candidates", size)?;
        let count = candidates.channels();
        if count < 2 {
            let got = format!("{count} channels");
            return Err(Error::value("candidates", "a channel for each of at least 2", got).into());
        }
        let expected = format!("a candidate, 0 to {}", count - 1);
        let usual = whole("usual", usual, &expected, |&n: &usize| n < count)?;
        let (tiles, numbers) = (choice::tiles(size), choice::channels(count));
        let evidence = Input::<f32>::optional(evidence, "evidence", Channels::Any, tiles)?;
        if let Some(evidence) = &evidence
            && evidence.channels() != numbers
        {
            let expected = format!("{numbers} channels, for {count} candidates");
            let got = format!("{} channels", evidence.channels());
            return Err(Error::value("evidence", expected, got).into());
        }
        let shape = [tiles.height, tiles.width, numbers];
        let out = Out::given(out, &shape)?;
        let color = color.pixels();
        let candidates = candidates.pixels();
        let evidence = evidence.as_ref().map(|evidence| evidence.pixels());
        out.fill(py, &shape, |after| {
            let candidates = candidates.to_planes();
            let views: Vec<_> = (0..count).map(|k| candidates.view().channel(k)).collect();
            let mut sums = match evidence {
                Some(evidence) => evidence.to_records(),
                None => Records::new(tiles, numbers),
            };
            choice::compare(&color, &views, exposure, usual, &mut sums);
            after.copy_from_slice(sums.pixels().elements().0);
        })?
    };
    after.array()
}

/// Compare three frames' samples and two results, tile by tile, to tell noise from detail.
///
/// Parameters
/// ----------
/// planes : (H, W, 5) array_like of float
///     Luminances, all where the pixels are in this frame: of its samples; of those of the frame before; of those of
///     two frames before, which were first brought to the frame before; of two results of the frame before. A pixel
///     counts if all are finite in its 3×3 pixels, so that the image's border does not.
/// evidence : (⌈H/8⌉, ⌈W/8⌉, 14) array_like of float, optional
///     That of earlier frames, as `collocation_shares` returns it.
/// exposure : float, default 1.0
///     `exposure` of the image; above 0. Detail below 1/1024 of it is black.
/// out : (⌈H/8⌉, ⌈W/8⌉, 14) float32 array, optional
///     Written and returned instead of a new array; it may be the evidence.
///
/// Returns
/// -------
/// evidence : (⌈H/8⌉, ⌈W/8⌉, 14) float32
///     With this frame's added: weighted sums of products of detail, and the number of pixels.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes or an exposure out of range.
///
/// See Also
/// --------
/// collocation_shares : Tells by the evidence how samples and results are best mixed.
///
/// Notes
/// -----
/// The detail of a plane is its difference from the mean of the 3×3 pixels. With the planes numbered from 0, the
/// products are those of 00, 01, 02, 11, 12, 22, 03, 13, 33, 04, 14, 44 and 34. A frame's sums in a tile of n pixels
/// have the weight ``1 / ((Σ₀₀ + Σ₁₁) / n + (exposure / 1024)²)``, so that no frame decides alone.
///
/// Examples
/// --------
/// >>> rng = np.random.default_rng(1)
/// >>> image = rng.random((64, 64, 1))
/// >>> noisy = image + 0.1 * rng.normal(size=(64, 64, 3))
/// >>> evidence = yester.collocate(np.dstack([noisy, image, 0 * image]))
/// >>> motion, coverage = np.zeros((64, 64, 2)), np.ones((64, 64))
/// >>> shares, evidence = yester.collocation_shares(evidence, motion, coverage)
/// >>> bool(shares[..., 0].mean() > 0.95), bool(shares[..., 1].mean() < 0.05)
/// (True, True)
#[pyfunction]
#[pyo3(name = "collocate", signature = (planes, evidence=None, *, exposure=1.0, out=None))]
pub fn collocate_<'py>(
    py: Python<'py>,
    planes: &Bound<'py, PyAny>,
    evidence: Option<&Bound<'py, PyAny>>,
    exposure: f32,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    exposure::check(exposure)?;
    let after = {
        let planes = Input::<f32>::new(planes, "planes", Channels::Of(&[collocation::PLANES]))?;
        let tiles = choice::tiles(planes.size());
        let evidence = Input::<f32>::optional(evidence, "evidence", EVIDENCE, tiles)?;
        let shape = [tiles.height, tiles.width, collocation::CHANNELS];
        let out = Out::given(out, &shape)?;
        let planes = planes.pixels();
        let evidence = evidence.as_ref().map(|evidence| evidence.pixels());
        out.fill(py, &shape, |after| {
            let mut sums = match evidence {
                Some(evidence) => evidence.to_records(),
                None => collocation::nothing(planes.size),
            };
            collocation::collocate(planes, exposure, &mut sums);
            after.copy_from_slice(sums.pixels().elements().0);
        })?
    };
    after.array()
}

/// Channels of the evidence that `collocate` returns.
const EVIDENCE: Channels = Channels::Of(&[collocation::CHANNELS]);

/// Find how samples and two results are best mixed, tile by tile, by the evidence of earlier frames.
///
/// Parameters
/// ----------
/// evidence : (⌈H/8⌉, ⌈W/8⌉, 14) array_like of float
///     The previous frame's, as `collocate` returns it.
/// motion : (H, W, 2) or (H, W, 3) array_like of float
///     Motion in pixels. A tile's evidence comes from where its centre does.
/// coverage : (H, W) array_like of float
///     Above 0 where the pixel's surface was visible in the previous frame (see `reproject`); tiles whose centre was
///     not have no evidence.
/// share : float, default 0.2
///     Fraction of the evidence that decays per frame; 0 to 1.
/// out : tuple of (⌈H/8⌉, ⌈W/8⌉, 2) and (⌈H/8⌉, ⌈W/8⌉, 14) float32 arrays, optional
///     Written and returned, as shares and evidence, instead of new arrays. A part may be None.
///
/// Returns
/// -------
/// shares : (⌈H/8⌉, ⌈W/8⌉, 2) float32
///     Shares λ and g, 0 to 1: with samples y and results a and b, ``m = b + λ (a - b)`` has the least error among
///     mixtures of both results, and ``m + g (y - m)`` among those of it and the samples. To hide the tiles,
///     interpolate between their centres.
/// evidence : (⌈H/8⌉, ⌈W/8⌉, 14) float32
///     The evidence where the tiles are in this frame, decayed: `collocate` adds this frame's.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes or a share out of range.
///
/// See Also
/// --------
/// collocate : Adds a frame's evidence.
/// choice : Chooses one of several predictions by how well they predict samples.
/// TAA : Mixes samples, denoised colour and result in this way.
///
/// Notes
/// -----
/// Samples y of a frame, p of the frame before and q of two frames before measure one signal, with independent noise.
/// With ⟨a b⟩ the products, averaged over a tile and its neighbours with weights {1, 2, 1}/4 along each axis (those at
/// the border are repeated beyond it),
/// ``S = ⟨y p⟩ ⟨p q⟩ / ⟨y q⟩`` is the energy of the detail in p, whatever motion and resampling have lost: the triple
/// collocation of [1]_. ⟨y q⟩ is at least 0.1 of √(⟨y y⟩ ⟨q q⟩), and S at most ⟨p p⟩. ``N = ⟨p p⟩ - S`` is the energy
/// of p's noise, and with ``r = ⟨y p⟩ / S`` the samples y / r have the detail of p.
///
/// The squared error of b less that of a is then ``E = ⟨b b⟩ - ⟨a a⟩ - 2 (⟨y b⟩ - ⟨y a⟩) / r``, and
/// ``λ = 1/2 + E / 2⟨(a - b)²⟩``. The share of samples is Wiener's, ``g = 1 - (N - C) / ⟨(p - m)²⟩``, where
/// ``C = ⟨p m⟩ - ⟨y m⟩ / r``, from 0 to N / 2, is the noise that m has of p. Both are limited to 0 and 1; with fewer
/// than 16 pixels in the average, both are 0.
///
/// References
/// ----------
/// .. [1] A. Stoffelen, "Toward the true near-surface wind speed: Error modeling and calibration using triple
///    collocation", Journal of Geophysical Research 103(C4), 1998.
///
/// Examples
/// --------
/// See `collocate`.
#[pyfunction]
#[pyo3(signature = (evidence, motion, coverage, *, share=collocation::SHARE, out=None))]
#[pyo3(text_signature = "(evidence, motion, coverage, *, share=0.2, out=None)")]
pub fn collocation_shares<'py>(
    py: Python<'py>,
    evidence: &Bound<'py, PyAny>,
    motion: &Bound<'py, PyAny>,
    coverage: &Bound<'py, PyAny>,
    share: f32,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<(Bound<'py, PyArrayDyn<f32>>, Bound<'py, PyArrayDyn<f32>>)> {
    choice::check_share(share)?;
    let (shares, carried) = {
        let motion = Input::<f32>::new(motion, "motion", MOTION)?;
        let size = motion.size();
        let coverage = Input::<f32>::new(coverage, "coverage", Channels::One)?;
        let coverage = coverage.sized("coverage", size)?;
        let tiles = choice::tiles(size);
        let evidence = Input::<f32>::new(evidence, "evidence", EVIDENCE)?;
        let evidence = evidence.sized("evidence", tiles)?;
        let [first, second] = parts(out.as_ref())?;
        let shapes = [collocation::SHARES, collocation::CHANNELS]
            .map(|channels| [tiles.height, tiles.width, channels]);
        let out = (
            Out::given(first, &shapes[0])?,
            Out::given(second, &shapes[1])?,
        );
        let mut shares = Direct::new(py, out.0, &shapes[0])?;
        let mut carried = Direct::new(py, out.1, &shapes[1])?;
        let images = [&evidence, &motion, &coverage].map(|input| input.pixels());
        let (found, records) = (shares.data()?, carried.data()?);
        detached(py, || {
            let [evidence, motion, coverage] = images;
            let (shares, rest) = collocation::shares(evidence, motion, coverage.plane(), share);
            shares.view().interleave(found);
            records.copy_from_slice(rest.pixels().elements().0);
        })?;
        (shares, carried)
    };
    Ok((shares.array()?, carried.array()?))
}

/// Measure how much of a frame's noise is that of the frame before.
///
/// Renderers that begin every frame with the same random numbers make noise that sticks to the screen, and a frame that
/// is shown twice has no new noise. Methods that compare frames take such noise for detail.
///
/// Parameters
/// ----------
/// color, previous : (H, W, 3) array_like of float
///     New samples, and those of the frame before; illumination (see `demodulate`) if there is albedo. Missing pixels
///     do not count.
/// motion : (H, W, 2) or (H, W, 3) array_like of float
///     Motion in pixels from this frame to the one before.
/// deviation : (2 ⌈H/8⌉, W) array_like of float, optional
///     The previous frame's result; none for the second frame of a sequence.
/// out : (2 ⌈H/8⌉, W) float32 array, optional
///     Written and returned, as the deviation, instead of a new array.
///
/// Returns
/// -------
/// repetition : float
///     0 to 1; 0 of fewer than 256 pairs of pixels. Of illumination, seven sequences with independent noise had at most
///     0.09, and 0.52 and more with one seed for all frames (``python -m yester.study.compare.repeated``). Pipelines
///     take more than 0.3 for repeated noise.
/// deviation : (2 ⌈H/8⌉, W) float32
///     For the next frame: ρ in every eighth row and the row below, NaN where it is unknown.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes.
///
/// See Also
/// --------
/// choice, collocation_shares : Assume independent noise.
///
/// Notes
/// -----
/// With y the luminance of `color` and p that of `previous`, fetched along the motion, ``ρ = (y - p) / (|y| +
/// |p|)``, and ``δ = ρ(x) - ρ(x + 1)`` leaves out slow changes of light. Detail that moves with its surface cancels
/// in ρ; independent noise makes δ of consecutive frames correlate by 0 to -½. Noise that sticks to the screen
/// correlates by ``C = corr(δ, δ')``, with δ' of the frame before. Where nothing moves, ρ of repeated noise is 0: S
/// is the share of pairs of which y(x) is that of `previous` and ``ε = (y(x) - y(x + 1)) / (|y(x)| + |y(x + 1)|)``
/// is above 1/10. Textures and mirrors repeat as well, but their rows resemble one another: ``V = corr(δ, δ↓)`` and
/// ``W = corr(ε, ε↓)``, with ↓ the row below. The repetition is ``max(0, C - max(V, 0), S - max(W, 0))``, with
/// ``corr(a, b) = Σ a b / max(√(Σ a² Σ b²), n / 100)`` over n pairs: deviations below a tenth are no noise that
/// matters.
///
/// Examples
/// --------
/// >>> noise = np.random.default_rng(0).uniform(size=(64, 64, 3))
/// >>> repetition, deviation = yester.repetition(noise, noise, np.zeros((64, 64, 2)))
/// >>> repetition > 0.3
/// True
#[pyfunction]
#[pyo3(name = "repetition", signature = (color, previous, motion, deviation=None, *, out=None))]
pub fn repetition_<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    previous: &Bound<'py, PyAny>,
    motion: &Bound<'py, PyAny>,
    deviation: Option<&Bound<'py, PyAny>>,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<(f32, Bound<'py, PyArrayDyn<f32>>)> {
    let mut share = 0.0;
    let found = {
        let color = Input::<f32>::new(color, "color", COLOR)?;
        let size = color.size();
        let previous = Input::<f32>::new(previous, "previous", COLOR)?.sized("previous", size)?;
        let motion = Input::<f32>::new(motion, "motion", MOTION)?.sized("motion", size)?;
        let rows = repetition::looked_at(size);
        let deviation = Input::<f32>::optional(deviation, "deviation", Channels::One, rows)?;
        let shape = [rows.height, rows.width];
        let out = Out::given(out, &shape)?;
        let [color, previous, motion] = [&color, &previous, &motion].map(|image| image.pixels());
        let deviation = deviation.as_ref().map(|image| image.pixels().plane());
        let share = &mut share;
        out.fill(py, &shape, |found| {
            let [now, before] = [color, previous].map(repetition::luminances);
            let (most, image) =
                repetition::repetition(now.view(), before.view(), motion, deviation);
            *share = most;
            found.copy_from_slice(image.plane(0));
        })?
    };
    Ok((share, found.array()?))
}

/// Measure how much better one history predicts the new sample than another, without a reference.
///
/// Parameters
/// ----------
/// candidate, base : (H, W, 3) array_like of float
///     Two predictions of `color`, both independent of it.
/// color : (H, W, 3) array_like of float
///     The new, noisy samples. A pixel that is missing in one of the three does not count.
/// ids : (H, W) array_like of int, optional
///     Only pixels of the same id are averaged.
/// radius : int, default 3
///     Radius of the window in pixels, 0 to 16.
/// standardized : bool, default False
///     Divide the gain by √(s² / n + 0.01²), where s² is the variance over the n pixels of the window: Student's t,
///     with a standard error of at least 1 %. This tells gains from chance, but is no longer unbiased.
/// out : (H, W) float32 array, optional
///     Written and returned instead of a new array; it may be an input.
///
/// Returns
/// -------
/// gain : (H, W) float32
///     The mean over the window of ``Σ (k - h)(k + h - 2c) / (Σ h² + 0.01)``, sums over channels: an unbiased estimate
///     of the difference of relative squared errors, negative where `candidate` is better. 0 without valid pixels, and
///     standardized with fewer than two.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes or a radius out of range.
///
/// See Also
/// --------
/// compare_candidates : Compares a series of predictions, tile by tile.
/// virtual_motion : Motion of the reflections' history.
///
/// Notes
/// -----
/// ``(k - c)² - (h - c)²`` is linear in c, so that the noise of c averages out; after a tone curve or a clamp it would
/// not.
///
/// Examples
/// --------
/// >>> color = np.ones((4, 4, 3))
/// >>> gain = yester.prediction_gain(color, 0.5 * color, color)
/// >>> gain[0].round(4)
/// array([-0.9868, -0.9868, -0.9868, -0.9868], dtype=float32)
#[pyfunction]
#[pyo3(signature = (candidate, base, color, *, ids=None, radius=3, standardized=false, out=None))]
pub fn prediction_gain<'py>(
    py: Python<'py>,
    candidate: &Bound<'py, PyAny>,
    base: &Bound<'py, PyAny>,
    color: &Bound<'py, PyAny>,
    ids: Option<&Bound<'py, PyAny>>,
    radius: i128,
    standardized: bool,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let radius = whole("radius", radius, "0 to 16 pixels", |&n| {
        n <= prediction::MOST
    })?;
    let gain = {
        let color = Input::<f32>::new(color, "color", COLOR)?;
        let size = color.size();
        let candidate =
            Input::<f32>::new(candidate, "candidate", COLOR)?.sized("candidate", size)?;
        let base = Input::<f32>::new(base, "base", COLOR)?.sized("base", size)?;
        let ids = Input::<u32>::optional(ids, "ids", Channels::One, size)?;
        let shape = [size.height, size.width];
        let out = Out::given(out, &shape)?;
        let [candidate, base, color] = [&candidate, &base, &color].map(|image| image.pixels());
        let ids = ids.as_ref().map(|ids| ids.pixels());
        out.fill(py, &shape, |gain| {
            let gain = bands_of(gain, size);
            prediction::prediction_gain(candidate, base, color, ids, radius, standardized, gain);
        })?
    };
    gain.array()
}
