//! Temporal antialiasing.

use pyo3::prelude::*;

use super::{FrameArgs, Output, Pipeline, alone, renamed};
use crate::bindings::arrays::choice as one_of;
use crate::kernels::fetch::footprint::Filter;
use crate::kernels::fetch::validate::Threshold;
use crate::kernels::judge::{innovation, neighborhood};
use crate::kernels::merge::blend;
use crate::kernels::smooth::fireflies;
use crate::pipelines::Pipeline as _;
use crate::pipelines::taa;

/// Temporal antialiasing of a sequence of frames.
///
/// Reprojects history along the motion, clips it to the neighbourhood of the new colour, and blends. For jittered
/// frames with little noise: noise widens the neighbourhoods, so that clipping becomes less effective. Unless tests are
/// switched on, history of different surfaces mixes, which is what antialiases edges. All buffers but colour are
/// optional: without motion, it is computed from the cameras if both frames have one and depth or position is known;
/// otherwise history is read in place.
///
/// Parameters
/// ----------
/// preset : {"best", "denoised", "textbook", "karis", "filament"}, default "best"
///     Source of the parameters that are not given: our own measurements, on frames without noise and on denoised ones;
///     the textbook equation (clamped to the range of the 3×3 pixels, 5 % of the new sample); the talk of Karis (see
///     References); Google's Filament. The last two have the techniques of their sources, but not all constants.
/// alpha : float, optional
///     Smallest weight of the new sample, 0 to 1.
/// fast_alpha : float, optional
///     Smallest weight of the new sample in fast motion, 0 to 1.
/// speed : float or (float, float), optional
///     Pixels up to which motion is slow, and from which it is fast.
/// unguided_alpha : float, optional
///     Smallest weight of the new sample, slow or fast, in frames without albedo, normals and ids, 0 to 1. Above 0,
///     these frames are blended with `weighting` "tone". A denoiser without guides blurs edges and texture along with
///     the noise, and what history then adds is mostly more blur. Frames are left out of which more than an eighth of
///     the pairs of neighbours along x and y differ in depth by more than a tenth of the smaller one: what is thinner
///     than a pixel needs its history. By default 0 in all presets.
/// guided_exposure : float, optional
///     Frames with albedo, normals or ids are blended with `weighting` "local-tone" at so many times the exposure, from
///     0; with 0, as `weighting` says. What a denoiser lets leak from a lamp into the dark then fades faster, and what
///     is not much brighter than the exposure is blended as before. By default 16 in preset "denoised", else 0.
/// dilate : {"3x3", "cross", "none"}, optional
///     Window of `dilate_motion`: the nearest pixel's motion if there is depth, else the longest.
/// dilate_margin : float, optional
///     Its margin, 0 to below 1.
/// dilate_movers : bool, optional
///     Whether pixels always take the motion of neighbours that move by themselves, as far as cameras and depth or
///     position tell (the `still` of `dilate_motion`), or only where the history that it leads to is less than 0.3
///     times as far from the mean colour of 3×3 pixels: the sum over channels of the differences of ``c / (l + e)``,
///     with l the luminance of a colour c and e the exposure. By default all presets but "denoised" always do.
/// filter : {"bilinear", "nearest", "catmull-rom", "catmull-rom-5", "lanczos-2"}, optional
///     As in `reproject`.
/// box, gamma, window, space, response : str or float, optional
///     As in `clip_history`.
/// weighting, flicker : str or float, optional
///     As in `blend`.
/// relative_depth, plane_distance, normal_angle : float or (float, float), optional
///     Tests that history must pass, with thresholds as in `reproject`; by default none. With `plane_distance`, frames
///     with camera, depth, normals and motion of 3 channels are tested by it, others by `relative_depth` if that is
///     given. A test drops out where one of two frames lacks its buffers. Along edges the tests refuse the history that
///     would antialias them.
/// relative_albedo : float or (float, float), optional
///     Largest relative difference of the albedo's luminance: rejects history where textures change or move, and where
///     fine texture is sampled elsewhere (unlike `material_change`).
/// ids : bool, default False
///     Reject history with another id.
/// fireflies : bool, default False
///     First clamp samples far brighter than their surroundings and their history, fetched bilinearly without tests,
///     and redistribute the excess over their surface (`suppress_fireflies`): of the frame's colour, or if that is
///     denoised, of the `samples` of `step`.
/// gradient : bool, default False
///     Shorten history where the light changes by more than aliasing and noise explain (`temporal_gradient`). It helps
///     with frames without noise; fireflies and other rare bright samples are mistaken for changes.
/// anti_lag : float, default 0.0
///     Shorten history where it is clipped: the `strength` of `anti_lag`; 0 turns it off. 1 helps with frames without
///     noise, at almost no cost; in noisy frames, noise is clipped as well, and is then averaged less.
/// alternation : bool, default False
///     Do not clip history where the colours of whole neighbourhoods alternate (`alternation`): against flicker where
///     an aliased feature is wider than the neighbourhood. It nearly doubles the time. For `SVGF`, use
///     ``SVGF(antialias=False)`` followed by ``TAA("denoised", alternation=True)``.
/// material_change : bool, optional
///     Shorten history that has to be clipped where the albedo tells that the material has changed (`material_change`
///     with its defaults): where a texture is swapped or plays, a denoised history leaves a ghost of the old one. The
///     `confidence` of `step` counts as 0 there; if it is not given, as 1 elsewhere. By default only preset "denoised"
///     does this.
/// innovation : bool, default False
///     Add the error of the result, as estimated from the samples of this and a few earlier frames, to the output
///     (`innovation`, with the `exposure` of the result and ``fed_back=False``): for changing light in noisy frames.
///     Without noise, part of the aliasing is mistaken for change. For denoised frames, see the `samples` of `step`.
/// smooth_edges : bool, optional
///     Show the result smoothed along its edges (`smooth_edges`; if there are `samples`, with the denoised colour as
///     `newest`, its exposure and `confidence`); history stays as it is. Edges of denoised frames, whose pixels show
///     either surface by chance, become straight. By default only preset "denoised" does this.
/// clip_choice : bool, optional
///     With the `samples` of denoised frames and `innovation`: tiles of 8×8 pixels leave their history unclipped where
///     that would have predicted the samples of earlier frames better (see Notes). Where texture is as fine as the
///     pixels, the colours around do not contain what a pixel shows on average. By default only preset "denoised" does
///     this.
/// choice : bool, optional
///     With the `samples` of denoised frames: each tile of 8×8 pixels mixes the result with the denoised colour and the
///     samples, by the weights that would have made the error of the frame before least (`collocate`,
///     `collocation_shares`; frames are fetched by `reproject` without fallback). Frames of many samples are
///     antialiased as they come, and have little noise. Samples are mixed into a tile only if at least 3 of 10 tiles,
///     up to 4 tiles away along each axis, ask for a weight above 0.05. If that holds for one tile in 8, denoised
///     colour is mixed into all tiles; so it is if its best weight for all of them together is at least 0.25 and at
///     least a quarter of them ask for more than 0.05. With known `jitter`, as such frames are not antialiased, it is
///     mixed only into tiles into which samples are. If neither holds, the whole frame shows the result alone, and the
///     next five frames are not evaluated. So it mostly is with one sample per pixel, and always with the noise of the
///     frame before (`repetition`), which comes with a `UserWarning`. By luminance, a sample counts for no more than
///     eight times, and is shown as no more than three times, the result plus a sixteenth of its exposure, so that
///     fireflies do not return.
///     By default only preset "denoised" does this.
///
/// Raises
/// ------
/// ValueError
///     If a parameter is out of range, or a mode unknown (the error lists the modes).
///
/// See Also
/// --------
/// clip_history : Clips history to the neighbourhood.
/// resolve : Makes the image to which antialiasing should converge.
/// Upscaler : Antialiases and upscales.
/// morphological_aa, smooth_edges : Antialias a single image, without and with noise.
///
/// Notes
/// -----
/// Each step consists of this package's functions and gives their bits: `motion_vectors`, `depth_change` (for tests of
/// depth), `suppress_fireflies`, `resolve` (with "blackman-harris", of frames that tell their jitter, but for
/// "textbook"), `dilate_motion`, `reproject` without fallback, `blend_factor`, `exposure`, `clip_history`,
/// `alternation`, `material_change`, `anti_lag`, `temporal_gradient` (``noise=2.2, passes=3, widest=5``), `blend`,
/// `smooth_edges`. The weight of a pixel's N-th sample is at least 1/N. With a gradient λ, N is first shortened to
/// N (1 - λ)¹⁰, and the weight a becomes ``lerp(a, 1, λ)``, as in `accumulate`. Preset "karis" follows Karis [1]_,
/// "filament" Google's Filament [2]_; Yang et al. [3]_ survey the field.
///
/// With `clip_choice`, let h be the history and k the clipped history, l luminance, e a sixteenth of the exposure, a
/// the blend factor before `weighting`, and s what the tiles choose, interpolated between their centres, times the
/// share of the pixel's footprint in the frame before where d was not held at 0. Then k is moved by s d, ``d = (h -
/// k) min(1, (l(k) + e) / (4 abs(l(h - k))))``. The next frame compares its samples with the luminances that the
/// result has with the clip and without, ``l - s (1 - a) l(d)`` and ``l + (1 - s) (1 - a) l(d)``, fetched bilinearly
/// without fallback, where their coverage is above 0.9 (`compare_candidates`, with candidate 0 as usual), and chooses
/// by these and earlier samples (`choice` with its defaults). d is held at 0 where samples are not compared with
/// history (see `samples` of `step`), where they have moved its luminance by more than a hundredth of that plus e,
/// and up to two pixels along each axis from a `confidence` of 0. Samples that have the noise of the frame before
/// (`repetition`) choose nothing.
///
/// The presets set:
///
/// ===============  ==================  ==================  ==========  ==========  ===============
/// parameter        best                denoised            textbook    karis       filament
/// ===============  ==================  ==================  ==========  ==========  ===============
/// alpha            0.05                0.1                 0.05        0.05        0.12
/// fast_alpha       0.25                0.3                 0.05        0.05        0.12
/// speed            (0, 1)              (0, 1)              (2, 16)     (2, 16)     (2, 16)
/// unguided_alpha   0                   0                   0           0           0
/// guided_exposure  0                   16                  0           0           0
/// dilate           "3x3"               "3x3"               "none"      "cross"     "3x3"
/// dilate_margin    0.1                 0.1                 0           0           0
/// dilate_movers    True                False               True        True        True
/// filter           "catmull-rom-5"     "catmull-rom-5"     "bilinear"  "bilinear"  "catmull-rom-5"
/// box              "variance"          "variance"          "minmax"    "rounded"   "intersection"
/// gamma            1                   0.75                1           1           1
/// window           "3x3"               "3x3"               "3x3"       "3x3"       "3x3"
/// space            "tonemapped-ycocg"  "tonemapped-ycocg"  "rgb"       "ycocg"     "ycocg"
/// response         "clamp"             "center"            "clamp"     "center"    "current"
/// weighting        "none"              "none"              "none"      "tone"      "tone"
/// flicker          1                   1                   1           0.2         1
/// smooth_edges     False               True                False       False       False
/// clip_choice      False               True                False       False       False
/// choice           False               True                False       False       False
/// material_change  False               True                False       False       False
/// ===============  ==================  ==================  ==========  ==========  ===============
///
/// References
/// ----------
/// .. [1] B. Karis, "High quality temporal supersampling", Advances in Real-Time Rendering in Games, SIGGRAPH courses,
///    2014.
/// .. [2] Google, "Filament", github.com/google/filament.
/// .. [3] L. Yang, S. Liu, M. Salvi, "A survey of temporal antialiasing techniques", Computer Graphics Forum 39(2),
///    2020.
///
/// Examples
/// --------
/// >>> taa = yester.TAA()
/// >>> for jitter in yester.jitter(8):
/// ...     output = taa.step(yester.Frame(np.ones((8, 8, 3)), jitter=jitter))
/// >>> output.history_length[0]
/// array([8., 8., 8., 8., 8., 8., 8., 8.], dtype=float32)
/// >>> yester.TAA("karis", alpha=0.1)
/// TAA('karis', alpha=0.1)
#[pyclass(extends = Pipeline, module = "yester")]
pub struct TAA {
    inner: taa::Taa,
}

#[pymethods]
impl TAA {
    #[new]
    #[pyo3(signature = (preset="best", *, alpha=None, fast_alpha=None, speed=None, unguided_alpha=None, guided_exposure=None, dilate=None, dilate_margin=None,
        dilate_movers=None, filter=None, r#box=None, gamma=None, window=None, space=None, response=None, weighting=None, flicker=None,
        relative_depth=None, plane_distance=None, normal_angle=None, relative_albedo=None, ids=false, fireflies=false, gradient=false, anti_lag=0.0, alternation=false,
        material_change=None, innovation=false, smooth_edges=None, clip_choice=None, choice=None))]
    fn new(
        py: Python<'_>,
        preset: &str,
        alpha: Option<f32>,
        fast_alpha: Option<f32>,
        speed: Option<Threshold>,
        unguided_alpha: Option<f32>,
        guided_exposure: Option<f32>,
        dilate: Option<&str>,
        dilate_margin: Option<f32>,
        dilate_movers: Option<bool>,
        filter: Option<&str>,
        r#box: Option<&str>,
        gamma: Option<f32>,
        window: Option<&str>,
        space: Option<&str>,
        response: Option<&str>,
        weighting: Option<&str>,
        flicker: Option<f32>,
        relative_depth: Option<Threshold>,
        plane_distance: Option<Threshold>,
        normal_angle: Option<Threshold>,
        relative_albedo: Option<Threshold>,
        ids: bool,
        fireflies: bool,
        gradient: bool,
        anti_lag: f32,
        alternation: bool,
        material_change: Option<bool>,
        innovation: bool,
        smooth_edges: Option<bool>,
        clip_choice: Option<bool>,
        choice: Option<bool>,
    ) -> PyResult<PyClassInitializer<Self>> {
        /// Parses the mode, or keeps the preset's.
        fn or<T: Copy>(
            name: Option<&str>,
            argument: &str,
            names: &[(&str, T)],
            preset: T,
        ) -> PyResult<T> {
            name.map_or(Ok(preset), |name| one_of(argument, name, names))
        }
        let mut params = one_of("preset", renamed(py, preset)?, &taa::Params::PRESETS)?;
        params.dilate = or(dilate, "dilate", &taa::Params::DILATIONS, params.dilate)?;
        params.dilate_margin = dilate_margin.unwrap_or(params.dilate_margin);
        params.dilate_movers = dilate_movers.unwrap_or(params.dilate_movers);
        params.filter = or(filter, "filter", &Filter::NAMES, params.filter)?;
        let factor = &mut params.blend_factor;
        factor.alpha = alpha.unwrap_or(factor.alpha);
        factor.fast_alpha = fast_alpha.unwrap_or(factor.fast_alpha);
        factor.speed = speed.map_or(factor.speed, Into::into);
        params.unguided_alpha = unguided_alpha.unwrap_or(params.unguided_alpha);
        params.guided_exposure = guided_exposure.unwrap_or(params.guided_exposure);
        let clip = &mut params.clip;
        clip.bounds = or(r#box, "box", &neighborhood::Params::BOUNDS, clip.bounds)?;
        clip.gamma = gamma.unwrap_or(clip.gamma);
        clip.radius = or(
            window,
            "window",
            &neighborhood::Params::WINDOWS,
            clip.radius,
        )?;
        clip.space = or(space, "space", &neighborhood::Params::SPACES, clip.space)?;
        clip.response = or(
            response,
            "response",
            &neighborhood::Params::RESPONSES,
            clip.response,
        )?;
        let weightings = &blend::Params::WEIGHTINGS;
        params.blend.weighting = or(weighting, "weighting", weightings, params.blend.weighting)?;
        params.blend.flicker = flicker.unwrap_or(params.blend.flicker);
        params.limits = taa::Limits {
            relative_depth,
            plane_distance,
            normal_angle,
            relative_albedo,
            ids,
        };
        params.fireflies = fireflies.then(fireflies::Params::default);
        params.gradient = gradient;
        params.anti_lag = anti_lag;
        params.alternation = alternation;
        params.material_change = material_change.unwrap_or(params.material_change);
        params.innovation = innovation.then(|| innovation::Params {
            fed_back: false,
            ..Default::default()
        });
        params.smooth_edges = smooth_edges.unwrap_or(params.smooth_edges);
        params.clip_choice = clip_choice.unwrap_or(params.clip_choice);
        params.choice = choice.unwrap_or(params.choice);
        let inner = taa::Taa::new(params)?;
        Ok(Pipeline::made(Self { inner }))
    }

    /// Apply antialiasing to the next frame of the sequence.
    ///
    /// Parameters
    /// ----------
    /// frame : Frame
    ///     The next frame, of the same size as the previous ones.
    /// out : Output, optional
    ///     An earlier step's output whose arrays are overwritten and returned, instead of new ones. From the
    ///     second frame on, no image memory is then allocated.
    /// samples : (H, W, 3) array_like of float, optional
    ///     If the frame's colour is denoised: the samples that it was made of, by which `choice` judges. Missing ones
    ///     are NaN. With `innovation`, they also correct history and result, as in the last stage of a denoiser.
    ///     History is first multiplied by the `light_change` from it, fetched bilinearly without tests or fallback, to
    ///     the samples. Then its own error, fetched bilinearly without fallback, is estimated (``strictness=4,
    ///     share=0.7``) and added to it, but no further than to the new colour. Not compared are pixels whose coverage
    ///     is at most 0.9, whose `confidence` is 0, or of which one of the 3×3 around has emission, a new colour of
    ///     more than six times the exposure, or no finite depth: beside lamps and the sky, antialiased edges differ
    ///     from single samples. Last, the error of the result is estimated (``strictness=12, share=0.7``), and corrects
    ///     result and history. Denoised colour is not resolved by its `jitter`.
    /// confidence : (H, W) array_like of float, optional
    ///     With `samples`: the denoiser's. Where it is 0, that found no history of the surface; history that has to be
    ///     clipped there, and is not fetched along the motion of a neighbour, is another surface's. It is shortened, as
    ///     by `anti_lag` with a strength of ``8 (k + e) / (max(k, c) + e)``, with k and c the luminances of the clipped
    ///     history and of the denoised colour, and e a sixteenth of the exposure. Where it is below 1, `smooth_edges`
    ///     smooths more.
    ///
    /// Returns
    /// -------
    /// Output
    ///     Without a variance.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If the size changes without `reset` in between; if `out`, `samples` or `confidence` do not fit; if there is
    ///     `confidence` without `samples`.
    #[pyo3(signature = (frame, out=None, *, samples=None, confidence=None))]
    fn step<'py>(
        slf: &Bound<'py, Self>,
        py: Python<'py>,
        frame: &Bound<'py, PyAny>,
        out: Option<&Bound<'py, Output>>,
        samples: Option<&Bound<'py, PyAny>>,
        confidence: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Output> {
        let source = [samples, confidence];
        FrameArgs::new(frame)?.step_denoised(py, out, source, &mut alone(slf)?.inner)
    }

    /// Discard all history; the next frame starts a new sequence.
    fn reset(slf: &Bound<Self>) -> PyResult<()> {
        alone(slf)?.inner.reset();
        Ok(())
    }
}
