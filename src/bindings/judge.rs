//! The kernels of the judge folder that judge history by one frame, but for those in [`super::evidence`].

use numpy::PyArrayDyn;
use pyo3::prelude::*;

use super::arrays::{COLOR, Channels, Input, MOTION, Out, choice, detached, fill_parts};
use super::merge::AlphaArg;
use crate::error::{Error, finite_from_0};
use crate::image::Run;
use crate::kernels::fetch::validate::Threshold;
use crate::kernels::judge::coherence::incoherent;
use crate::kernels::judge::light_change::light_change;
use crate::kernels::judge::material_change::{self, material_change};
use crate::kernels::judge::repetition::luminances;
use crate::kernels::judge::{
    alternation, anti_lag, blend_factor, exposure, gradient, innovation, neighborhood,
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
        let out = Out::<bool>::given(out, &[size.height, size.width])?;
        let mask = out.bytes()?.fill(py, |mask| {
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

/// Find where the texture or material of surfaces is another than in the frame before, by their albedo.
///
/// Parameters
/// ----------
/// albedo : (H, W, 3) array_like of float
///     Of the current frame.
/// previous_albedo : (H, W, 3) array_like of float
///     Of the frame before.
/// motion : (H, W, 2) or (H, W, 3) array_like of float
///     As `motion_vectors` returns it; the third channel only tells that it is known.
/// relative_luminance : float, default 0.2
///     Luminances differ by more than this share of the larger one; from 0.
/// share : float, default 0.6
///     More than this share of the pixels around must differ, 0 to 1.
/// radius : int, default 7
///     Of the square of pixels around, as far as it lies inside the image, 0 to 16: 7 for 15x15.
/// out : (H, W) bool array, optional
///     Written and returned instead of a new array.
///
/// Returns
/// -------
/// mask : (H, W) bool
///     True where a pixel differs, and enough of those around it do. A pixel differs if those of its 2x2 footprint in
///     the frame before whose luminance does not differ weigh less than 0.01. What was outside the image or is missing
///     does not differ.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes, or if a parameter is out of range.
/// TypeError
///     If `out` has another dtype.
///
/// See Also
/// --------
/// reproject : Tests single pixels with ``color=albedo``.
/// TAA : Shortens history there, behind a denoiser.
///
/// Notes
/// -----
/// Own method. Light that is divided by albedo does not change with the texture, so that `SVGF` and `BMFR` keep its
/// history. Colour does, and what antialiases it, `TAA("denoised")`, then shows a ghost of the old texture: with noise,
/// the colours around a pixel do not tell. Single pixels differ wherever fine texture is sampled elsewhere than in the
/// frame before, and there history is what antialiases it: without `share`, two of 33 sequences lose 0.2 dB.
///
/// Examples
/// --------
/// >>> before = np.full((8, 24, 3), 0.8)
/// >>> albedo = before.copy()
/// >>> albedo[:, 12:] = 0.2
/// >>> mask = yester.material_change(albedo, before, np.zeros((8, 24, 2)), radius=2)
/// >>> mask[4, 10:16]
/// array([False, False, False,  True,  True,  True])
#[pyfunction]
#[pyo3(signature = (albedo, previous_albedo, motion, *, relative_luminance=0.2, share=0.6, radius=7, out=None), name = "material_change")]
pub fn material_change_<'py>(
    py: Python<'py>,
    albedo: &Bound<'py, PyAny>,
    previous_albedo: &Bound<'py, PyAny>,
    motion: &Bound<'py, PyAny>,
    relative_luminance: f32,
    share: f32,
    radius: i128,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<bool>>> {
    let params = material_change::Params {
        relative_luminance,
        share,
        radius: material_change::Params::radius(radius)?,
    };
    params.check()?;
    let (mask, out) = {
        let albedo = Input::<f32>::new(albedo, "albedo", COLOR)?;
        let size = albedo.size();
        let before = Input::<f32>::of_size(previous_albedo, "previous_albedo", COLOR, size)?;
        let motion = Input::<f32>::of_size(motion, "motion", MOTION, size)?;
        let out = Out::<bool>::given(out, &[size.height, size.width])?;
        let (albedo, before, motion) = (albedo.pixels(), before.pixels(), motion.pixels());
        let mask = out.bytes()?.fill(py, |mask| {
            let (now, before) = (luminances(albedo), luminances(before));
            let found = material_change(now.view(), before.view(), motion, params);
            match found {
                Some(changed) => (mask.iter_mut().zip(changed.plane(0)))
                    .for_each(|(mask, &changed)| *mask = (changed > 0.0).into()),
                None => mask.fill(0),
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
        let color = Input::<f32>::of_size(color, "color", COLOR, history.size())?;
        let alpha = alpha
            .map(|alpha| AlphaArg::new(alpha, history.size()))
            .transpose()?;
        let out = Out::given(out, history.shape())?;
        let [old, new] = [history.pixels(), color.pixels()];
        let alpha = alpha.as_ref().map(AlphaArg::data);
        out.fill(py, |clipped| {
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
///     all of its pixels rather than by a few bright ones, and near 1 for images exposed like photographs. A row's
///     mean counts for at most 4096 times the one that exceeds nine tenths of them: so single pixels of 1e20 and more,
///     which are broken, do not decide. 1 for a frame that is black or has no valid pixel, and where the result exceeds
///     float32.
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
    let history = Input::<f32>::of_size(history, "history", COLOR, size)?;
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
        out.fill(py, |alpha| {
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
        let history = Input::<f32>::of_size(history, "history", COLOR, size)?;
        let clipped = Input::<f32>::of_size(clipped, "clipped", COLOR, size)?;
        let out = Out::given(out, length.shape())?;
        let [old, new] = [history.pixels(), clipped.pixels()];
        let lengths = length.pixels().plane();
        out.fill(py, |shortened| {
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
        let out = Out::given(out, &[size.height, size.width, alternation::CHANNELS])?;
        let (color, memory) = (color.pixels(), memory.as_ref().map(Input::pixels));
        let known = memory.map(|memory| alternation::Known {
            memory,
            coverage: None,
        });
        out.fill(py, |next| {
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
///     Passes of the smallest blur, 1 to 8; its radius is about 2^passes - 1 pixels.
/// widest : int, default 3
///     Passes of the widest blur, `passes` to 8. Small blurs locate a change of light, wide ones detect changes that
///     are small but extended; the largest gradient counts. `SVGF` estimates with 5, and ``noise=2.4``.
/// out : (H, W) float32 array, optional
///     Written and returned instead of a new array; it may be an input.
///
/// Returns
/// -------
/// gradient : (H, W) float32
///     0 (no change, or nothing known) to 1 (all of the light has appeared or vanished). Missing pixels have the
///     gradient of the 2×2 pixels around them.
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
/// With the difference of luminances δ and the larger of them m, blurred means ⟨·⟩, and the standard error s of ⟨δ⟩:
/// ``clamp((|⟨δ⟩| - noise s) / ⟨m⟩, 0, 1)`` with ``s² = (⟨δ²⟩ - ⟨δ⟩²) K / w``, w the blurred number of a cell's pixels
/// that count, up to 4, and K the sum of squares of all blurs' kernels convolved, 1 without a blur. The first pass
/// averages cells of 2×2 pixels, whose pixels all get their gradient; the others blur cells by {1, 2, 1}/4 kernels at
/// steps of 1, 2, 4, … cells. The original (Schied et al. [1]_) has cells of 3×3, exact gradients, and no margin for
/// noise.
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
        let previous = Input::<f32>::of_size(previous, "previous", COLOR, size)?;
        let out = Out::given(out, &[size.height, size.width])?;
        let [color, previous] = [color.pixels(), previous.pixels()];
        out.fill(py, |gradient| {
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
///     The image that samples are compared with.
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
/// levels : int, default 6
///     Block sizes, 1 to 8: 2 pixels, 4, 8, ….
/// fed_back : bool, default True
///     The history of the next prediction is corrected as well. If not, the next samples show the same difference
///     again, and the evidence keeps the corrected part.
/// sparse : bool, default False
///     `color` has samples in few pixels, and the prediction is made of few. Differences are then relative to the local
///     mean of the light, as the prediction itself is noisy; and a block without samples keeps its evidence until it
///     gets one.
/// target : (H, W, 3) array_like of float, optional
///     The image that is corrected, whose light scales the correction; by default the prediction. Another one may be
///     sharper than what samples are compared with.
/// out : tuple of (H, W, 3) and (ceil(H / 2), ceil(W / 2), 4) float32 arrays, optional
///     Written and returned instead of new arrays. A part may be None.
///
/// Returns
/// -------
/// correction : (H, W, 3) float32
///     To be added to the prediction, or to `target`; 0 where no error was found.
/// evidence : (ceil(H / 2), ceil(W / 2), 4) float32
///     For the next frame: the relative difference that is not fed back, and its variance. The variance is NaN in
///     blocks without samples and evidence, which are left out of all means.
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
    strictness=3.0, share=0.5, levels=6, fed_back=true, sparse=false, target=None, out=None))]
#[pyo3(
    text_signature = "(color, prediction, history_length, evidence=None, motion=None, *, exposure=1.0, strictness=3.0, \
    share=0.5, levels=6, fed_back=True, sparse=False, target=None, out=None)"
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
    target: Option<&Bound<'py, PyAny>>,
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
    let [correction, left] = {
        let color = Input::<f32>::new(color, "color", COLOR)?;
        let size = color.size();
        let prediction = Input::<f32>::of_size(prediction, "prediction", COLOR, size)?;
        let length = Input::<f32>::of_size(history_length, "history_length", Channels::One, size)?;
        let small = innovation::evidence_size(size);
        let channels = Channels::Of(&[innovation::CHANNELS]);
        let evidence = Input::<f32>::optional(evidence, "evidence", channels, small)?;
        let motion = Input::<f32>::optional(motion, "motion", MOTION, size)?;
        let target = Input::<f32>::optional(target, "target", COLOR, size)?;
        let blocks = [small.height, small.width, innovation::CHANNELS];
        let shapes = [color.shape(), &blocks];
        let [color, prediction] = [color.pixels(), prediction.pixels()];
        let target = target.as_ref().map_or(prediction, Input::pixels);
        let predicted = innovation::Predicted {
            colors: &prediction,
            lengths: length.pixels(),
        };
        let motion = motion.as_ref().map(|motion| motion.pixels());
        let known = evidence.as_ref().map(|evidence| innovation::Known {
            evidence: evidence.pixels(),
            motion,
        });
        fill_parts(py, out.as_ref(), shapes, |[correction, left]| {
            let (found, rest) =
                innovation::innovation(&color, None, &predicted, known, exposure, params);
            found.corrections(&target, size, PixelsMut::bands(size, 3, correction));
            left.copy_from_slice(rest.pixels().elements().0);
        })?
    };
    Ok((correction.array()?, left.array()?))
}
