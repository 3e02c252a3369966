//! Spatiotemporal variance-guided filtering.

use pyo3::prelude::*;

use super::{FrameArgs, History, Output, Parts, Pipeline, alone, split};
use crate::bindings::smooth::sigmas;
use crate::kernels::fetch::validate::{self, Threshold};
use crate::kernels::merge::accumulate;
use crate::kernels::smooth::{atrous, fireflies, variance};
use crate::pipelines::Pipeline as _;
use crate::pipelines::{history, svgf, taa};

/// Spatiotemporal variance-guided filtering of a sequence of frames.
///
/// Reprojects history along each pixel's motion, validates that it shows the same surface, merges it with the new
/// sample, estimates the remaining variance and filters in space accordingly. Buffers that a frame lacks drop out of
/// the tests and weights: without albedo, texture is filtered with the light; without normals, depth or ids, their
/// tests are skipped. Without motion, it is computed from the cameras if both frames have one and depth or position is
/// known; otherwise history is read in place.
///
/// Parameters
/// ----------
/// alpha : float, default 0.2
///     Smallest weight of the new sample in the history, 0 to 1. 0.05 averages over four times as many frames: less
///     noise in static regions, more lag of reflections and light.
/// moments_alpha : float, default 0.2
///     Smallest weight of the new sample in the moments of luminance.
/// iterations : int, default 3
///     Passes of the spatial filter, 0 to 16; with `choice`, the number used without evidence.
/// radius : int, default 1
///     Radius of a pass in taps: 1 for 3×3; 2 for the 5×5 of the paper, which reaches twice as far and takes twice the
///     time.
/// sigma_luminance : float, default 3.0
///     The filter's scale of luminance differences, in standard deviations; above 0.
/// relative_noise : float, default 2.5
///     Most standard deviation of one sample that the filter expects, in multiples of the light around it (`atrous`),
///     in frames without normals, ids and albedo, where edges look like noise; above 0, +inf for no limit. There is
///     none in the filter of the mean with `average_still`.
/// tap_exposure : float, default 16.0
///     The light above which brighter taps of the filter weigh less (`atrous`), in multiples of the exposure; above 0,
///     +inf to weigh all alike. With `average_still`, always 16 in the filter of the mean.
/// sigma_normal : float, default 64.0
///     Sharpness of the filter's normal weight; from 0.
/// sigma_depth, sigma_plane : float, default 0.5 and 0.05
///     Scale of distances from a pixel's tangent plane: in multiples of what the slope explains, and as a share of
///     depth; both above 0. The two add up (`atrous`). Where nothing but motion tells surfaces apart,
///     ``1 / (10 + |motion|)`` stands in for depth, unless motion changes from pixel to pixel or later frames join:
///     where the camera moves aside, near surfaces move faster.
/// relative_depth : float or (float, float), default 0.1
///     Largest relative difference from the expected depth that history may have; above 0. For frames without camera,
///     normals or motion of 3 channels.
/// plane_distance : float or (float, float), default 0.01
///     Largest distance from the history's plane, relative to depth; above 0. For frames with these.
/// normal_angle : float or (float, float), default 25.0
///     Largest angle between a pixel's normal and its history's, in degrees, 0 to 180.
/// motion_difference : float or (float, float), default 0.2
///     Largest difference of a pixel's motion from that of the previous frame's pixel where it comes from, in pixels,
///     above twice the least among all that come from there (`consistency`); from 0, +inf for any. For frames without
///     depth, unless their motion changes from pixel to pixel, as in grass.
/// relative_albedo : float or (float, float), optional
///     Largest relative difference between the luminance of a pixel's albedo and its history's, at least 0: rejects
///     history where textures change or move. Illumination usually survives a change of texture, so by default this is
///     not tested. The output stage shows texture and does not test it: where textures move, `split`, and give the
///     stage `relative_albedo` instead.
/// min_length : float, default 3.5
///     History length from which the temporal variance is used; at least 1. The default is fractional so that rounding
///     of resampled lengths does not decide.
/// feedback : bool, default False
///     Use the output of the filter's first pass, instead of its input, as the next frame's history: less noise in
///     motion, more bias.
/// by_confidence : bool, default False
///     Raise the new sample's weight where confidence in history is low: ``alpha + (1 - confidence) (1 - alpha)``.
/// gradient : bool, default True
///     Shorten history where the light changes. The change is estimated from the new samples and history, where it
///     exceeds the noise. Frames with a `replay` (a re-render with the same random numbers), if the previous frame had
///     one or was the first, show the change without noise: there, unless `innovation` is off, history is first
///     corrected by the change, then shortened by the part that the correction misses, and by at least half of the
///     whole change.
/// fireflies : bool, default False
///     First clamp samples far brighter than their surroundings and their history, and redistribute the excess over
///     their surface (`suppress_fireflies`).
/// reflections : sequence of float, default (0.2, 0.4, 0.7, 1.2)
///     Distances behind the surface, in multiples of its depth, +inf included, at which the history of reflections is
///     fetched as well. Where one of these histories predicts the new samples better than the surface's own
///     (`prediction_gain`), it is used instead. The output stage follows the reflection there, too; with albedo, only
///     where its luminance in 3×3 pixels is within a tenth of the pixel's, as texture moves with the surface. Each
///     distance costs time, mostly in tiles of 16 pixels in which a pixel chose it beyond doubt in the previous frame,
///     and in their neighbours; the others try it in two of sixteen frames. Rows are decided in pairs. () turns this
///     off; (0.25, 0.5, 1, 2, 4, inf) is finer, for very glossy scenes. Frames with a `hit_distance` use that distance
///     alone. Needs cameras and depth.
/// choice : bool, default True
///     Give each tile of 8×8 pixels the number of filter passes, from none to one more than `iterations`, after which
///     history best predicted the samples of earlier frames (`choice`); tiles that know nothing do as is best for the
///     frame as a whole. With albedo, pixels without history get one pass more than their tile. Mirrors, texture that
///     is not in the albedo and fine shadows keep their detail, and uniform surfaces are smoothed more. The filter
///     then compares the luminance that history predicts, where that is worth 2.5 samples and the new one is no
///     outlier, instead of the merged one. The output stage's result is mixed with the denoised colour and the
///     samples, by tiles, as new samples tell (`TAA`): frames of many samples need little of it. A frame that has the
///     noise of the frame before (`repetition`) cannot judge: it gets the usual passes, by the variance in space, with
///     a `UserWarning`.
/// innovation : bool, default True
///     Add the error of the result, as estimated from the new samples and those of a few earlier frames, to the result
///     and to history (`innovation`): this restores moving light and detail blurred by the filter or in reflections.
///     Where all light has changed by one factor, as by an exposure or a fade, history is first multiplied by it
///     (`light_change`). The output stage is corrected in the same ways, its history before it is merged, too
///     (`samples` of `TAA.step`).
/// antialias : bool, default True
///     End with a stage of temporal antialiasing, ``TAA("denoised", unguided_alpha=0.5)``; with `average_still`,
///     ``unguided_alpha=0, guided_exposure=0``.
/// average_still : bool, default False
///     Average all samples, as with ``alpha=0, moments_alpha=0``, in frames in which nothing moves: the camera is that
///     of the frame before, and the motion, without which only cameras tell, at most 0.001 pixels. For constant light.
///     With `choice` and albedo, the mean of all samples, filtered by the mean of the guides (`atrous`), then replaces
///     the result, beginning with eight samples and wholly from 16 on. Once all but one in 64 pixels have 16 or are
///     black, all show the mean, and the stages from `choice` to the output stage, whose result it replaces, are left
///     out; the variance is then that of the filtered mean. With `choice`, the result is mixed with the unfiltered mean
///     (`converge`), which follows changes of light by `innovation`, and the noise that `gradient` ignores grows with
///     the square root of the frames, from ten frames on and up to four times.
/// coherence : bool, default True
///     Let depth alone validate history and guide the filter where normals and ids change from pixel to pixel and from
///     frame to frame, as in grass and fur (`incoherent_guides`). Ids then only tell apart surfaces whose albedo is a
///     reflectance (`is_reflectance`) from others.
///
/// Raises
/// ------
/// ValueError
///     If a parameter is out of range.
///
/// See Also
/// --------
/// denoise : Runs a pipeline over a sequence, from both sides.
/// plan : Finds out which stages and buffers a sequence needs.
/// HalfRes : For frames of which a part is traced.
/// TAA : For frames with little noise.
///
/// Notes
/// -----
/// The method is that of Schied et al. [1]_, with their later gradient [2]_. Each step consists of this package's
/// functions and gives their bits: `motion_vectors`, `depth_change` (without cameras), `is_reflectance` (with albedo),
/// `material_ids` (with albedo, without ids), `demodulate`, `repetition`, `reproject` (with `consistency`),
/// `incoherent_guides`, `light_change` (without a replay), `suppress_fireflies`, `temporal_gradient` (``noise=2.4,
/// passes=3, widest=5``), `virtual_motion` and `prediction_gain`, `accumulate`, `combine_histories` (with `later`),
/// `choice`, `estimate_variance`, `atrous`, `compare_candidates` and `innovation` (with the `exposure` of the history),
/// `remodulate`, `innovation` of the history of `TAA` (``strictness=4, share=0.7``), those of `TAA`, and `innovation`
/// of its result and history (``strictness=12, share=0.7``), both with the `exposure` of the filtered colour; with
/// `average_still` those of the mean (``strictness=24, share=0.7``): `innovation`, `demodulate`, `atrous`, `remodulate`
/// and `converge`. Of the history and of `later`, no more than ``1 / alpha - 1`` samples count. The correction by a
/// replay is an `innovation` of history, too: its samples are the replayed ones' change, relative to the samples
/// blurred by `atrous`.
///
/// References
/// ----------
/// .. [1] C. Schied, A. Kaplanyan, C. Wyman, A. Patney, C. R. A. Chaitanya, J. Burgess, S. Liu, C. Dachsbacher, A.
///    Lefohn, M. Salvi, "Spatiotemporal variance-guided filtering: real-time reconstruction for path-traced global
///    illumination", High-Performance Graphics, 2017.
/// .. [2] C. Schied, C. Peters, C. Dachsbacher, "Gradient estimation for real-time adaptive temporal filtering",
///    Proceedings of the ACM on Computer Graphics and Interactive Techniques 1(2), 2018.
///
/// Examples
/// --------
/// >>> rng = np.random.default_rng(0)
/// >>> frames = [yester.Frame(rng.gamma(1, 0.5, (32, 32, 3))) for _ in range(8)]
/// >>> pipeline = yester.SVGF()
/// >>> outputs = [pipeline.step(frame) for frame in frames]
/// >>> bool(outputs[-1].color.std() < frames[-1].color.std() / 5)
/// True
/// >>> outputs[-1].used
/// ()
#[pyclass(extends = Pipeline, subclass, module = "yester")]
pub struct SVGF {
    pub(super) inner: svgf::Svgf,
}

#[pymethods]
impl SVGF {
    #[new]
    #[pyo3(signature = (*, alpha=0.2, moments_alpha=0.2, iterations=3, radius=1, sigma_luminance=3.0,
        relative_noise=2.5, tap_exposure=16.0, sigma_normal=64.0, sigma_depth=0.5, sigma_plane=0.05,
        relative_depth=Threshold::hard(0.1), plane_distance=Threshold::hard(0.01), normal_angle=Threshold::hard(25.0), motion_difference=Threshold::hard(0.2),
        relative_albedo=None, min_length=3.5, feedback=false, by_confidence=false, gradient=true, fireflies=false,
        reflections=vec![0.2, 0.4, 0.7, 1.2], choice=true, innovation=true, antialias=true, average_still=false, coherence=true))]
    #[pyo3(
        text_signature = "(*, alpha=0.2, moments_alpha=0.2, iterations=3, radius=1, sigma_luminance=3.0, \
        relative_noise=2.5, tap_exposure=16.0, sigma_normal=64.0, sigma_depth=0.5, sigma_plane=0.05, relative_depth=0.1, \
        plane_distance=0.01, normal_angle=25.0, motion_difference=0.2, relative_albedo=None, min_length=3.5, feedback=False, by_confidence=False, \
        gradient=True, fireflies=False, reflections=(0.2, 0.4, 0.7, 1.2), choice=True, innovation=True, antialias=True, average_still=False, \
        coherence=True)"
    )]
    fn new(
        alpha: f32,
        moments_alpha: f32,
        iterations: i128,
        radius: i128,
        sigma_luminance: f32,
        relative_noise: f32,
        tap_exposure: f32,
        sigma_normal: f32,
        sigma_depth: f32,
        sigma_plane: f32,
        relative_depth: Threshold,
        plane_distance: Threshold,
        normal_angle: Threshold,
        motion_difference: Threshold,
        relative_albedo: Option<Threshold>,
        min_length: f32,
        feedback: bool,
        by_confidence: bool,
        gradient: bool,
        fireflies: bool,
        reflections: Vec<f32>,
        choice: bool,
        innovation: bool,
        antialias: bool,
        average_still: bool,
        coherence: bool,
    ) -> PyResult<PyClassInitializer<Self>> {
        let sigmas = sigmas(sigma_normal, sigma_depth, sigma_plane);
        if let Some(albedo) = relative_albedo {
            albedo.check_luminance("relative_albedo")?;
        }
        let default = svgf::Params::default();
        let limits = default.history.surface;
        let params = svgf::Params {
            history: history::Params {
                surface: validate::Params {
                    relative_depth,
                    plane_distance,
                    normal_angle,
                    motion_difference,
                    relative_luminance: relative_albedo.unwrap_or(limits.relative_luminance),
                    ..limits
                },
                same_albedo: relative_albedo.is_some(),
                coherence,
                accumulate: accumulate::Params {
                    alpha,
                    moments_alpha,
                    ..default.history.accumulate
                },
                by_confidence,
                gradient: default.history.gradient.filter(|_| gradient),
                fireflies: fireflies.then(fireflies::Params::default),
                innovation: default.history.innovation.filter(|_| innovation),
            },
            average_still,
            variance: variance::Params {
                min_length,
                sigmas,
                ..default.variance
            },
            atrous: atrous::Params {
                iterations: atrous::Params::iterations(iterations)?,
                radius: atrous::Params::radius(radius)?,
                sigma_luminance,
                relative_noise,
                sigmas,
                ..default.atrous
            },
            tap_exposure,
            feedback,
            choice: default.choice.filter(|_| choice),
            reflections,
            antialias: (default.antialias.filter(|_| antialias))
                .map(|stage| taa::Params { choice, ..stage }),
            ..default
        };
        let inner = svgf::Svgf::new(params)?;
        Ok(Pipeline::made(Self { inner }))
    }

    /// Denoise the next frame of the sequence.
    ///
    /// Parameters
    /// ----------
    /// frame : Frame
    ///     The next frame, of the same size as the previous ones; in `HalfRes`, NaN where nothing was traced.
    /// out : Output, optional
    ///     An earlier step's output whose arrays are overwritten and returned, instead of new ones. From the
    ///     second frame on, no image memory is then allocated.
    /// later : History, optional
    ///     What later frames know of this frame's pixels: `recall` of a pipeline that runs backwards. It joins the
    ///     history before the filter, and the sample counts once. What goes on to the next frame is without it.
    ///     Confidence and rejection of the output are those of earlier frames; `later` has its own.
    ///
    /// Returns
    /// -------
    /// Output
    ///     The denoised frame, with its auxiliary outputs.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If the size changes, or albedo appears or vanishes, without `reset` in between; if `out` or `later` does not
    ///     fit.
    ///
    /// See Also
    /// --------
    /// denoise : Runs a pipeline over a sequence.
    #[pyo3(signature = (frame, out=None, *, later=None))]
    fn step<'py>(
        slf: &Bound<'py, Self>,
        py: Python<'py>,
        frame: &Bound<'py, PyAny>,
        out: Option<&Bound<'py, Output>>,
        later: Option<&Bound<'py, History>>,
    ) -> PyResult<Output> {
        FrameArgs::new(frame)?.step_between(py, out, later, &mut alone(slf)?.inner)
    }

    /// Go on to the next frame as `step` does, but tell what history expects of its pixels instead of showing it.
    ///
    /// Parameters
    /// ----------
    /// frame : Frame
    ///     As for `step`; of a reversed sequence, with the motion to the frame that follows it in time.
    ///
    /// Returns
    /// -------
    /// History
    ///     Without the frame's own sample.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     As of `step`.
    fn recall<'py>(
        slf: &Bound<'py, Self>,
        py: Python<'py>,
        frame: &Bound<'py, PyAny>,
    ) -> PyResult<History> {
        FrameArgs::new(frame)?.recall(py, &mut alone(slf)?.inner)
    }

    /// Make the pipeline without its output stage, and the stage.
    ///
    /// Both are without history. One after the other, they give the results of the whole, if the stage gets the frame's
    /// colour as `samples`, and the `motion` and `confidence` of the denoiser's output. Not with `average_still`: the
    /// whole shows the mean of a scene at rest after the stage, which would add noise to it.
    ///
    /// Parameters
    /// ----------
    /// both_sides : bool, default False
    ///     For a stage that runs forwards and backwards over the results, which are then averaged, as in `denoise`.
    ///     Their lags cancel, so that it keeps as many frames without guides as with them (``unguided_alpha=0``).
    ///
    /// Returns
    /// -------
    /// denoiser : Pipeline
    ///     With the same parameters, but ``antialias=False``.
    /// stage : TAA or None
    ///     For the frames with the denoiser's colours and motion; None without `antialias`.
    #[pyo3(signature = (*, both_sides=false))]
    fn split<'py>(slf: &Bound<'py, Self>, both_sides: bool) -> PyResult<Parts<'py>> {
        let params = alone(slf)?.inner.params().clone();
        split(slf.as_super(), &params, both_sides)
    }

    /// Discard all history; the next frame starts a new sequence.
    fn reset(slf: &Bound<Self>) -> PyResult<()> {
        alone(slf)?.inner.reset();
        Ok(())
    }
}
