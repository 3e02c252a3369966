"""The compiled half of `yester`; its public names are re-exported there."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, ParamSpec, Self, TypeAlias, TypeVar, final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import disjoint_base

from .frame import Frame

_Given = ParamSpec("_Given")
_Result = TypeVar("_Result")
_Floats: TypeAlias = NDArray[np.float32]
_Doubles: TypeAlias = NDArray[np.float64]
_Threshold: TypeAlias = float | tuple[float, float]
_Filter: TypeAlias = Literal["bilinear", "nearest", "catmull-rom", "catmull-rom-5", "lanczos-2"]
_Box: TypeAlias = Literal["variance", "minmax", "rounded", "intersection", "hull", "exact-hull", "chroma-hull"]
_Space: TypeAlias = Literal["ycocg", "rgb", "tonemapped-ycocg", "tonemapped-rgb"]
_Response: TypeAlias = Literal["center", "clamp", "current", "ellipsoid"]
_Weighting: TypeAlias = Literal["none", "tone", "local-tone", "luminance"]

__all__ = [
    "BMFR",
    "SVGF",
    "TAA",
    "Accumulated",
    "Camera",
    "HalfRes",
    "History",
    "Output",
    "Pipeline",
    "Recirculation",
    "Upscaler",
    "__version__",
    "accumulate",
    "alternation",
    "anti_lag",
    "atrous",
    "blend",
    "blend_factor",
    "canonical",
    "choice",
    "clip_history",
    "collect_warnings",
    "collocate",
    "collocation_shares",
    "combine_histories",
    "compare_candidates",
    "consistency",
    "converge",
    "demodulate",
    "depth_change",
    "dilate_motion",
    "disocclusion",
    "estimate_variance",
    "exposure",
    "fix_history",
    "incoherent_guides",
    "innovation",
    "invert_motion",
    "is_reflectance",
    "jitter",
    "joint_bilateral_upsample",
    "light_change",
    "machine_limits",
    "material_change",
    "material_ids",
    "morphological_aa",
    "motion_vectors",
    "prediction_gain",
    "pull_push",
    "recirculate",
    "reconstruct",
    "regress",
    "remodulate",
    "repetition",
    "reproject",
    "resample",
    "resolve",
    "restore_detail",
    "settings",
    "sharpen",
    "smooth_edges",
    "splat",
    "suppress_fireflies",
    "temporal_gradient",
    "thin_features",
    "virtual_motion",
]

__version__: str

@final
class Camera:
    """A pinhole camera: where world points appear in the image, and the rays of its pixels.

    Parameters
    ----------
    world_to_clip : (4, 4) array_like of float
        Maps column vectors, ``clip = world_to_clip @ [x, y, z, 1]``, with x to the right, y up and w positive in
        front of the camera: the convention of OpenGL, Direct3D and (with y flipped) Vulkan. Their z rows differ; the z
        row is not used. The matrix's scale does not matter. It may have an off-axis principal point.
    width, height : int
        The image's size in pixels: 1 to 2²³ - 1 each, 2³¹ pixels at most.

    Raises
    ------
    ValueError
        If the matrix has NaN or infinity, is singular or orthographic, or the image has no pixels or too many.

    See Also
    --------
    motion_vectors : Motion of static surfaces, from two cameras.
    jitter : Offsets for `Camera.jittered`.

    Notes
    -----
    The pixel of a point is ``((x/w + 1)/2 * width, (1 - y/w)/2 * height)``: x to the right, y down, pixel centres at
    +0.5. Its depth is the distance along the camera axis, in scene units. Cameras are immutable, compare by matrix
    and size, can be keys of a dictionary and can be pickled.

    Examples
    --------
    >>> camera = yester.Camera.from_look_at([1, 2, 5], [1, 2, 0], [0, 1, 0], fov=90, width=4, height=4)
    >>> camera
    Camera(4x4, position=[1.0000, 2.0000, 5.0000], forward=[0.0000, 0.0000, -1.0000])
    >>> pixels, depth = camera.project([[1, 2, 0], [3.5, 2, 0]])
    >>> pixels
    array([[2., 2.],
           [3., 2.]])
    >>> depth
    array([5., 5.])
    """
    def __new__(cls, world_to_clip: ArrayLike, width: int, height: int) -> Self: ...
    @staticmethod
    def from_look_at(
        origin: ArrayLike,
        target: ArrayLike,
        up: ArrayLike,
        fov: float,
        width: int,
        height: int,
        *,
        fov_axis: Literal["x", "y"] = "x",
        principal_point: ArrayLike | None = None,
    ) -> Camera:
        """Make a camera at `origin` that looks at `target`.

        Parameters
        ----------
        origin, target, up : (3,) array_like of float
            World space, right-handed; `up` need not be perpendicular to the view.
        fov : float
            Field of view in degrees, above 0 and below 180; `ValueError` if it is so close to either that the matrix is
            singular.
        width, height : int
            The image's size in pixels.
        fov_axis : {"x", "y"}, default "x"
            The axis that `fov` spans: the image's width or its height.
        principal_point : (2,) array_like of float, optional
            Where the optical axis meets the image, in pixels; the centre by default.

        Returns
        -------
        Camera
            Without jitter.

        Raises
        ------
        ValueError
            If `target` is `origin`, `up` is along the view, or a value is out of range.

        Examples
        --------
        >>> camera = yester.Camera.from_look_at([1, 2, 5], [1, 2, 0], [0, 1, 0], fov=90, width=4, height=4)
        >>> camera.position
        array([1., 2., 5.])
        >>> camera.forward
        array([ 0.,  0., -1.])
        """
    @property
    def world_to_clip(self) -> _Doubles:
        """The matrix that was passed to the constructor: (4, 4) float64."""
    @property
    def world_to_camera(self) -> _Doubles:
        """World to camera; +X right, +Y up, +Z forward, as in EXR files; rigid unless skewed: (4, 4) float64."""
    @property
    def width(self) -> int:
        """Image width in pixels."""
    @property
    def height(self) -> int:
        """Image height in pixels."""
    @property
    def position(self) -> _Doubles:
        """The centre of projection in world space: (3,) float64."""
    @property
    def forward(self) -> _Doubles:
        """The unit vector along the optical axis, in world space: (3,) float64."""
    def project(self, points: ArrayLike) -> tuple[_Doubles, _Doubles]:
        """Project world points to pixels.

        Parameters
        ----------
        points : (..., 3) array_like of float
            World space.

        Returns
        -------
        pixels : (..., 2) float64
            Position, x right, y down, pixel centres at +0.5; NaN for points that are not in front of the camera.
        depth : (...) float64
            Distance along the camera axis.

        Raises
        ------
        ValueError
            If the last axis of `points` has not three coordinates.

        See Also
        --------
        Camera.unproject : From pixels and depths to world points.

        Examples
        --------
        >>> camera = yester.Camera.from_look_at([0, 0, 5], [0, 0, 0], [0, 1, 0], fov=90, width=4, height=4)
        >>> pixels, depth = camera.project([1, 1, 0])
        >>> pixels
        array([2.4, 1.6])
        >>> float(depth)
        5.0
        """
    def unproject(self, pixels: ArrayLike, depth: ArrayLike) -> _Doubles:
        """Unproject pixels and depths to world points.

        Parameters
        ----------
        pixels : (..., 2) array_like of float
            Position, x right, y down, pixel centres at +0.5.
        depth : (...) array_like of float
            Distance along the camera axis; the axes before the last of `pixels`.

        Returns
        -------
        points : (..., 3) float64
            World space.

        Raises
        ------
        ValueError
            If the last axis of `pixels` has not two coordinates, or `depth` another shape than the axes before it.

        See Also
        --------
        Camera.project : From world points to pixels.

        Examples
        --------
        >>> camera = yester.Camera.from_look_at([0, 0, 5], [0, 0, 0], [0, 1, 0], fov=90, width=4, height=4)
        >>> camera.unproject([2.5, 1.5], 4)
        array([1., 1., 1.])
        """
    def rays(self, pixels: ArrayLike | None = None) -> tuple[_Doubles, _Doubles]:
        """Compute the view rays of pixels.

        Parameters
        ----------
        pixels : (..., 2) array_like of float, optional
            By default the centres of all pixels, (height, width, 2).

        Returns
        -------
        origin : (3,) float64
            The camera's position.
        directions : (..., 3) float64
            World space, unit length.

        Raises
        ------
        ValueError
            If the last axis of `pixels` has not two coordinates.

        Examples
        --------
        >>> camera = yester.Camera.from_look_at([0, 0, 5], [0, 0, 0], [0, 1, 0], fov=90, width=4, height=4)
        >>> origin, directions = camera.rays()
        >>> directions.shape
        (4, 4, 3)
        >>> directions[0, 0]
        array([-0.5145,  0.5145, -0.686 ])
        """
    def jittered(self, offset: ArrayLike) -> Camera:
        """Make a camera whose image is shifted by part of a pixel.

        Parameters
        ----------
        offset : (2,) array_like of float
            In pixels, x right, y down, for instance from `jitter`. The new camera's samples at pixel centres are this
            camera's at pixel centres plus `offset`: points appear at their old pixel positions minus `offset`.

        Returns
        -------
        Camera
            With the same size, position and direction.

        Raises
        ------
        ValueError
            If `offset` is not finite.

        See Also
        --------
        jitter : Offsets for the frames of a sequence.

        Notes
        -----
        Use the jittered camera for rendering only: `Frame.camera` and `motion_vectors` take cameras without jitter.

        Examples
        --------
        >>> camera = yester.Camera.from_look_at([0, 0, 5], [0, 0, 0], [0, 1, 0], fov=90, width=4, height=4)
        >>> shifted = camera.jittered([0.25, -0.25])
        >>> shifted.project([0, 0, 0])[0] - camera.project([0, 0, 0])[0]
        array([-0.25,  0.25])
        """
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...
    def __ne__(self, other: object, /) -> bool: ...
    def __reduce__(self) -> tuple[type[Camera], tuple[_Doubles, int, int]]: ...

@final
class Accumulated:
    """Result of `accumulate`, which can be pickled.

    Parameters
    ----------
    color : (H, W, 3) float32
        Accumulated colour.
    moments : (H, W, 2) float32
        Means of luminance and of its square.
    history_length : (H, W) float32
        History length in samples, up to 1/alpha where a sample was merged.
    missing : int
        Pixels whose new sample was not finite, or of weight 0 or NaN.

    Raises
    ------
    ValueError
        On wrong shapes.

    See Also
    --------
    accumulate : Returns this.

    Examples
    --------
    >>> zeros = np.zeros((2, 2, 3))
    >>> yester.accumulate(zeros + 1, zeros, zeros[..., :2], zeros[..., 0])
    Accumulated(2x2, missing=0)
    """
    def __new__(cls, color: ArrayLike, moments: ArrayLike, history_length: ArrayLike, missing: int) -> Self: ...
    @property
    def color(self) -> _Floats:
        """Accumulated colour: (H, W, 3) float32."""
    @property
    def moments(self) -> _Floats:
        """Means of luminance and of its square: (H, W, 2) float32."""
    @property
    def history_length(self) -> _Floats:
        """History length in samples, up to 1/alpha: (H, W) float32."""
    @property
    def missing(self) -> int:
        """Number of pixels whose new sample was not finite, or of weight 0 or NaN."""
    def __getnewargs__(self) -> tuple[NDArray[Any] | int, ...]: ...

@final
class Output:
    """One denoised frame, with its auxiliary outputs.

    Parameters
    ----------
    color : (H, W, 3) float32
        Linear; finite everywhere.
    history_length : (H, W) float32
        Number of samples that each pixel's result is worth: at most 1/alpha from `step`, without limit while
        `average_still` averages, both sides together from `denoise`; of `Upscaler`, samples per output pixel; of
        `Recirculation`, the quality.
    confidence : (H, W) float32
        Accepted fraction of the history's footprint, 0 to 1; 0 where history was rejected (disocclusion).
    rejection : (H, W) uint8
        Bits of `Rejection`: the tests that taps of the footprint failed (one pixel for filter "nearest", else 2×2).
    variance : (H, W) float32, optional
        Estimated variance of the filtered luminance, before remodulation; None from pipelines without an estimate.
    choice : (H, W) float32, optional
        Number of filter passes of each pixel, fractional where two results are mixed; None from pipelines without a
        choice.
    motion : (H, W, 2) float32, optional
        Motion for an output stage behind the pipeline, in pixels as `Frame.motion`: to where the frame before shows
        what this one does. Where a reflection's history was taken and the luminance of albedo in 3×3 pixels is within a
        tenth of the pixel's, that is the reflection's, elsewhere the surface's. None from pipelines that do not look
        for reflections or have a stage of their own.
    used : tuple of str, default ()
        The buffers that were used: of "motion", "camera" (motion computed from cameras), "albedo", "emission",
        "normal", "depth", "plane" (depth compared by plane distance), "ids", "position", "object_normal", "replay",
        "hit_distance", "jitter" and "reactive".
    missing : int, default 0
        Pixels whose sample was not finite.

    Raises
    ------
    ValueError
        On wrong shapes.
    TypeError
        If an array has another dtype.

    See Also
    --------
    SVGF.step : Returns an output.
    Rejection : The bits of `rejection`.

    Examples
    --------
    >>> output = yester.SVGF().step(yester.Frame(np.ones((4, 4, 3))))
    >>> output
    Output(4x4, used=(), missing=0)
    """
    def __new__(
        cls,
        color: _Floats,
        history_length: _Floats,
        confidence: _Floats,
        rejection: NDArray[np.uint8],
        *,
        variance: _Floats | None = None,
        choice: _Floats | None = None,
        motion: _Floats | None = None,
        used: Sequence[str] = (),
        missing: int = 0,
    ) -> Self: ...
    @property
    def color(self) -> _Floats:
        """Linear colour, finite everywhere: (H, W, 3) float32."""
    @property
    def variance(self) -> _Floats | None:
        """Estimated variance of the filtered luminance, before remodulation: (H, W) float32, or None."""
    @property
    def choice(self) -> _Floats | None:
        """Number of filter passes of each pixel, fractional where two results are mixed: (H, W) float32, or None."""
    @property
    def motion(self) -> _Floats | None:
        """Motion for an output stage behind the pipeline: (H, W, 2) float32, or None."""
    @property
    def history_length(self) -> _Floats:
        """Number of samples that each pixel's result is worth: (H, W) float32."""
    @property
    def confidence(self) -> _Floats:
        """Accepted fraction of the history's footprint, 0 to 1; 0 at disocclusions: (H, W) float32."""
    @property
    def rejection(self) -> NDArray[np.uint8]:
        """Tests that taps of the history's footprint failed, as bits of `Rejection`: (H, W) uint8."""
    @property
    def used(self) -> tuple[str, ...]:
        """Names of the buffers that were used."""
    @property
    def missing(self) -> int:
        """Number of pixels whose sample was not finite."""
    def __getnewargs_ex__(self) -> tuple[tuple[NDArray[Any], ...], dict[str, Any]]: ...

@disjoint_base
class Pipeline:
    """Base class of pipelines, which process a sequence frame by frame.

    The `repr` is the constructor call with the given parameters (``inf`` is `math.inf`). Copies (shallow or deep) and
    unpickled objects are made by this call: they have the same parameters, no history, and start a new sequence.

    Parameters
    ----------
    *_args, **_kwargs
        Parameters of the pipeline, kept for `repr`, copies and pickles.

    See Also
    --------
    SVGF : Denoises path-traced frames.
    denoise : Runs a pipeline over a sequence, from both sides.

    Examples
    --------
    >>> import copy
    >>> pipeline = yester.SVGF(alpha=0.1)
    >>> copy.copy(pipeline)
    SVGF(alpha=0.1)
    >>> isinstance(pipeline, yester.Pipeline)
    True
    """
    def __new__(cls, *_args: Any, **_kwargs: Any) -> Self: ...
    def __init__(self, *args: Any, **kwargs: Any) -> None: ...
    def __reduce__(self) -> tuple[Any, tuple[()]]: ...

@final
class History:
    """What history expects of a frame's pixels, without the frame's own sample.

    `recall` of a pipeline that runs backwards returns that of later frames, and `step` takes it as `later`.

    Parameters
    ----------
    color : (H, W, 3) float32
        Light: demodulated, if frames have albedo. NaN where nothing is known.
    moments : (H, W, 2) float32
        Means of its luminance and of the luminance's square.
    history_length : (H, W) float32
        How many samples it is worth: less than went into it where the light has changed.
    confidence : (H, W) float32
        As `Output.confidence`.
    rejection : (H, W) uint8
        As `Output.rejection`.
    motion : (H, W, 2) float32, optional
        As `Output.motion`.
    used : tuple of str, default ()
        As `Output.used`; empty if that is not known.

    Raises
    ------
    ValueError
        On wrong shapes.

    See Also
    --------
    SVGF.recall : Returns a history.
    combine_histories : Joins two histories.

    Examples
    --------
    >>> pipeline = yester.SVGF()
    >>> for light in (1.0, 1.0):
    ...     history = pipeline.recall(yester.Frame(np.full((4, 4, 3), light)))
    >>> history.history_length[0]
    array([1., 1., 1., 1.], dtype=float32)
    """
    def __new__(
        cls,
        color: ArrayLike,
        moments: ArrayLike,
        history_length: ArrayLike,
        confidence: ArrayLike,
        rejection: ArrayLike,
        *,
        motion: ArrayLike | None = None,
        used: Sequence[str] = (),
    ) -> Self: ...
    @property
    def color(self) -> _Floats:
        """Light, demodulated if frames have albedo; NaN where nothing is known: (H, W, 3) float32."""
    @property
    def moments(self) -> _Floats:
        """Means of luminance and of its square: (H, W, 2) float32."""
    @property
    def history_length(self) -> _Floats:
        """Number of samples that the history is worth: (H, W) float32."""
    @property
    def confidence(self) -> _Floats:
        """Accepted fraction of the history's footprint, 0 to 1: (H, W) float32."""
    @property
    def rejection(self) -> NDArray[np.uint8]:
        """Tests that taps of the history's footprint failed, as bits of `Rejection`: (H, W) uint8."""
    @property
    def motion(self) -> _Floats | None:
        """Motion for an output stage behind the pipeline: (H, W, 2) float32, or None."""
    @property
    def used(self) -> tuple[str, ...]:
        """Names of the buffers that were used."""
    def __getnewargs_ex__(self) -> tuple[tuple[NDArray[Any], ...], dict[str, Any]]: ...

@disjoint_base
class SVGF(Pipeline):
    """Spatiotemporal variance-guided filtering of a sequence of frames.

    Reprojects history along each pixel's motion, validates that it shows the same surface, merges it with the new
    sample, estimates the remaining variance and filters in space accordingly. Buffers that a frame lacks drop out of
    the tests and weights: without albedo, texture is filtered with the light; without normals, depth or ids, their
    tests are skipped. Without motion, it is computed from the cameras if both frames have one and depth or position is
    known; otherwise history is read in place.

    Parameters
    ----------
    alpha : float, default 0.2
        Smallest weight of the new sample in the history, 0 to 1. 0.05 averages over four times as many frames: less
        noise in static regions, more lag of reflections and light.
    moments_alpha : float, default 0.2
        Smallest weight of the new sample in the moments of luminance.
    iterations : int, default 3
        Passes of the spatial filter, 0 to 16; with `choice`, the number used without evidence.
    radius : int, default 1
        Radius of a pass in taps: 1 for 3×3; 2 for the 5×5 of the paper, which reaches twice as far and takes twice the
        time.
    sigma_luminance : float, default 3.0
        The filter's scale of luminance differences, in standard deviations; above 0.
    relative_noise : float, default 2.5
        Most standard deviation of one sample that the filter expects, in multiples of the light around it (`atrous`),
        in frames without normals, ids and albedo, where edges look like noise; above 0, +inf for no limit. There is
        none in the filter of the mean with `average_still`.
    tap_exposure : float, default 16.0
        The light above which brighter taps of the filter weigh less (`atrous`), in multiples of the exposure; above 0,
        +inf to weigh all alike. With `average_still`, always 16 in the filter of the mean.
    sigma_normal : float, default 64.0
        Sharpness of the filter's normal weight; from 0.
    sigma_depth, sigma_plane : float, default 0.5 and 0.05
        Scale of distances from a pixel's tangent plane: in multiples of what the slope explains, and as a share of
        depth; both above 0. The two add up (`atrous`). Where nothing but motion tells surfaces apart,
        ``1 / (10 + |motion|)`` stands in for depth, unless motion changes from pixel to pixel or later frames join:
        where the camera moves aside, near surfaces move faster.
    relative_depth : float or (float, float), default 0.1
        Largest relative difference from the expected depth that history may have; above 0. For frames without camera,
        normals or motion of 3 channels.
    plane_distance : float or (float, float), default 0.01
        Largest distance from the history's plane, relative to depth; above 0. For frames with these.
    normal_angle : float or (float, float), default 25.0
        Largest angle between a pixel's normal and its history's, in degrees, 0 to 180.
    motion_difference : float or (float, float), default 0.2
        Largest difference of a pixel's motion from that of the previous frame's pixel where it comes from, in pixels,
        above twice the least among all that come from there (`consistency`); from 0, +inf for any. For frames without
        depth, unless their motion changes from pixel to pixel, as in grass.
    relative_albedo : float or (float, float), optional
        Largest relative difference between the luminance of a pixel's albedo and its history's, at least 0: rejects
        history where textures change or move. Illumination usually survives a change of texture, so by default this is
        not tested. The output stage shows texture and does not test it: where textures move, `split`, and give the
        stage `relative_albedo` instead.
    min_length : float, default 3.5
        History length from which the temporal variance is used; at least 1. The default is fractional so that rounding
        of resampled lengths does not decide.
    feedback : bool, default False
        Use the output of the filter's first pass, instead of its input, as the next frame's history: less noise in
        motion, more bias.
    by_confidence : bool, default False
        Raise the new sample's weight where confidence in history is low: ``alpha + (1 - confidence) (1 - alpha)``.
    gradient : bool, default True
        Shorten history where the light changes. The change is estimated from the new samples and history, where it
        exceeds the noise. Frames with a `replay` (a re-render with the same random numbers), if the previous frame had
        one or was the first, show the change without noise: there, unless `innovation` is off, history is first
        corrected by the change, then shortened by the part that the correction misses, and by at least half of the
        whole change.
    fireflies : bool, default False
        First clamp samples far brighter than their surroundings and their history, and redistribute the excess over
        their surface (`suppress_fireflies`).
    reflections : sequence of float, default (0.2, 0.4, 0.7, 1.2)
        Distances behind the surface, in multiples of its depth, +inf included, at which the history of reflections is
        fetched as well. Where one of these histories predicts the new samples better than the surface's own
        (`prediction_gain`), it is used instead. The output stage follows the reflection there, too; with albedo, only
        where its luminance in 3×3 pixels is within a tenth of the pixel's, as texture moves with the surface. Each
        distance costs time, mostly in tiles of 16 pixels in which a pixel chose it beyond doubt in the previous frame,
        and in their neighbours; the others try it in two of sixteen frames. Rows are decided in pairs. () turns this
        off; (0.25, 0.5, 1, 2, 4, inf) is finer, for very glossy scenes. Frames with a `hit_distance` use that distance
        alone. Needs cameras and depth.
    choice : bool, default True
        Give each tile of 8×8 pixels the number of filter passes, from none to one more than `iterations`, after which
        history best predicted the samples of earlier frames (`choice`); tiles that know nothing do as is best for the
        frame as a whole. With albedo, pixels without history get one pass more than their tile. Mirrors, texture that
        is not in the albedo and fine shadows keep their detail, and uniform surfaces are smoothed more. The filter
        then compares the luminance that history predicts, where that is worth 2.5 samples and the new one is no
        outlier, instead of the merged one. The output stage's result is mixed with the denoised colour and the
        samples, by tiles, as new samples tell (`TAA`): frames of many samples need little of it. A frame that has the
        noise of the frame before (`repetition`) cannot judge: it gets the usual passes, by the variance in space, with
        a `UserWarning`.
    innovation : bool, default True
        Add the error of the result, as estimated from the new samples and those of a few earlier frames, to the result
        and to history (`innovation`): this restores moving light and detail blurred by the filter or in reflections.
        Where all light has changed by one factor, as by an exposure or a fade, history is first multiplied by it
        (`light_change`). The output stage is corrected in the same ways, its history before it is merged, too
        (`samples` of `TAA.step`).
    antialias : bool, default True
        End with a stage of temporal antialiasing, ``TAA("denoised", unguided_alpha=0.5)``; with `average_still`,
        ``unguided_alpha=0, guided_exposure=0``.
    average_still : bool, default False
        Average all samples, as with ``alpha=0, moments_alpha=0``, in frames in which nothing moves: the camera is that
        of the frame before, and the motion, without which only cameras tell, at most 0.001 pixels. For constant light.
        With `choice` and albedo, the mean of all samples, filtered by the mean of the guides (`atrous`), then replaces
        the result, beginning with eight samples and wholly from 16 on. Once all but one in 64 pixels have 16 or are
        black, all show the mean, and the stages from `choice` to the output stage, whose result it replaces, are left
        out; the variance is then that of the filtered mean. With `choice`, the result is mixed with the unfiltered mean
        (`converge`), which follows changes of light by `innovation`, and the noise that `gradient` ignores grows with
        the square root of the frames, from ten frames on and up to four times.
    coherence : bool, default True
        Let depth alone validate history and guide the filter where normals and ids change from pixel to pixel and from
        frame to frame, as in grass and fur (`incoherent_guides`). Ids then only tell apart surfaces whose albedo is a
        reflectance (`is_reflectance`) from others.

    Raises
    ------
    ValueError
        If a parameter is out of range.

    See Also
    --------
    denoise : Runs a pipeline over a sequence, from both sides.
    plan : Finds out which stages and buffers a sequence needs.
    HalfRes : For frames of which a part is traced.
    TAA : For frames with little noise.

    Notes
    -----
    The method is that of Schied et al. [1]_, with their later gradient [2]_. Each step consists of this package's
    functions and gives their bits: `motion_vectors`, `depth_change` (without cameras), `is_reflectance` (with albedo),
    `material_ids` (with albedo, without ids), `demodulate`, `repetition`, `reproject` (with `consistency`),
    `incoherent_guides`, `light_change` (without a replay), `suppress_fireflies`, `temporal_gradient` (``noise=2.4,
    passes=3, widest=5``), `virtual_motion` and `prediction_gain`, `accumulate`, `combine_histories` (with `later`),
    `choice`, `estimate_variance`, `atrous`, `compare_candidates` and `innovation` (with the `exposure` of the history),
    `remodulate`, `innovation` of the history of `TAA` (``strictness=4, share=0.7``), those of `TAA`, and `innovation`
    of its result and history (``strictness=12, share=0.7``), both with the `exposure` of the filtered colour; with
    `average_still` those of the mean (``strictness=24, share=0.7``): `innovation`, `demodulate`, `atrous`, `remodulate`
    and `converge`. Of the history and of `later`, no more than ``1 / alpha - 1`` samples count. The correction by a
    replay is an `innovation` of history, too: its samples are the replayed ones' change, relative to the samples
    blurred by `atrous`.

    References
    ----------
    .. [1] C. Schied, A. Kaplanyan, C. Wyman, A. Patney, C. R. A. Chaitanya, J. Burgess, S. Liu, C. Dachsbacher, A.
       Lefohn, M. Salvi, "Spatiotemporal variance-guided filtering: real-time reconstruction for path-traced global
       illumination", High-Performance Graphics, 2017.
    .. [2] C. Schied, C. Peters, C. Dachsbacher, "Gradient estimation for real-time adaptive temporal filtering",
       Proceedings of the ACM on Computer Graphics and Interactive Techniques 1(2), 2018.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> frames = [yester.Frame(rng.gamma(1, 0.5, (32, 32, 3))) for _ in range(8)]
    >>> pipeline = yester.SVGF()
    >>> outputs = [pipeline.step(frame) for frame in frames]
    >>> bool(outputs[-1].color.std() < frames[-1].color.std() / 5)
    True
    >>> outputs[-1].used
    ()
    """
    def __new__(
        cls,
        *,
        alpha: float = 0.2,
        moments_alpha: float = 0.2,
        iterations: int = 3,
        radius: int = 1,
        sigma_luminance: float = 3.0,
        relative_noise: float = 2.5,
        tap_exposure: float = 16.0,
        sigma_normal: float = 64.0,
        sigma_depth: float = 0.5,
        sigma_plane: float = 0.05,
        relative_depth: _Threshold = 0.1,
        plane_distance: _Threshold = 0.01,
        normal_angle: _Threshold = 25.0,
        motion_difference: _Threshold = 0.2,
        relative_albedo: _Threshold | None = None,
        min_length: float = 3.5,
        feedback: bool = False,
        by_confidence: bool = False,
        gradient: bool = True,
        fireflies: bool = False,
        reflections: Sequence[float] = (0.2, 0.4, 0.7, 1.2),
        choice: bool = True,
        innovation: bool = True,
        antialias: bool = True,
        average_still: bool = False,
        coherence: bool = True,
    ) -> Self: ...
    def step(self, frame: Frame, out: Output | None = None, *, later: History | None = None) -> Output:
        """Denoise the next frame of the sequence.

        Parameters
        ----------
        frame : Frame
            The next frame, of the same size as the previous ones; in `HalfRes`, NaN where nothing was traced.
        out : Output, optional
            An earlier step's output whose arrays are overwritten and returned, instead of new ones. From the
            second frame on, no image memory is then allocated.
        later : History, optional
            What later frames know of this frame's pixels: `recall` of a pipeline that runs backwards. It joins the
            history before the filter, and the sample counts once. What goes on to the next frame is without it.
            Confidence and rejection of the output are those of earlier frames; `later` has its own.

        Returns
        -------
        Output
            The denoised frame, with its auxiliary outputs.

        Raises
        ------
        ValueError
            If the size changes, or albedo appears or vanishes, without `reset` in between; if `out` or `later` does not
            fit.

        See Also
        --------
        denoise : Runs a pipeline over a sequence.
        """
    def recall(self, frame: Frame) -> History:
        """Go on to the next frame as `step` does, but tell what history expects of its pixels instead of showing it.

        Parameters
        ----------
        frame : Frame
            As for `step`; of a reversed sequence, with the motion to the frame that follows it in time.

        Returns
        -------
        History
            Without the frame's own sample.

        Raises
        ------
        ValueError
            As of `step`.
        """
    def split(self, *, both_sides: bool = False) -> tuple[SVGF, TAA | None]:
        """Make the pipeline without its output stage, and the stage.

        Both are without history. One after the other, they give the results of the whole, if the stage gets the frame's
        colour as `samples`, and the `motion` and `confidence` of the denoiser's output. Not with `average_still`: the
        whole shows the mean of a scene at rest after the stage, which would add noise to it.

        Parameters
        ----------
        both_sides : bool, default False
            For a stage that runs forwards and backwards over the results, which are then averaged, as in `denoise`.
            Their lags cancel, so that it keeps as many frames without guides as with them (``unguided_alpha=0``).

        Returns
        -------
        denoiser : Pipeline
            With the same parameters, but ``antialias=False``.
        stage : TAA or None
            For the frames with the denoiser's colours and motion; None without `antialias`.
        """
    def reset(self) -> None:
        """Discard all history; the next frame starts a new sequence."""

@final
class HalfRes(SVGF):
    """Denoise frames of which only a part is traced, such as one pixel of each 2×2, another one in each frame.

    All buffers have full resolution, and colour is NaN where no path was traced. Untraced pixels are reconstructed from
    traced neighbours on the same surface; a reconstructed colour counts for a fraction of a sample, the smaller the
    longer the history. The rest is `SVGF` with other parameters: history is reprojected, validated tap by tap, merged
    with traced and reconstructed samples, and filtered. Any pattern and density of traced pixels works; the patterns of
    successive frames should cover all pixels, as those of `HalfRes.offset` do.

    Parameters
    ----------
    alpha : float, default 0.2
        Smallest weight of a traced sample in its pixel's history, 0 to 1: with a quarter of the pixels traced, 0.2
        averages over as many frames as 0.05 in `SVGF`.
    weight : float, default 0.3
        The fraction of a sample that a reconstructed colour counts for without history, above 0 to 1.
    radius : int, default 2
        Radius in pixels of the window from which untraced pixels are reconstructed, 1 to 16.
    iterations : int, default 4
        Passes of the spatial filter, 0 to 16.
    sigma_luminance : float, default 4.0
        The filter's scale of luminance differences, in standard deviations; above 0.
    relative_noise, tap_exposure : float, default 2.0 and 16.0
        As in `SVGF`; the latter for pixels of 1.75 samples or more.
    by_confidence, fireflies : bool, default False
        As in `SVGF`.
    reflections : sequence of float, default (0.2, 0.4, 0.7, 1.2)
        As in `SVGF`.
    choice : bool, optional
        As in `SVGF`. By default in frames without albedo alone: with it, most scenes gain little, and highlights that
        few samples hit can get worse.
    innovation : bool, default True
        As in `SVGF`.
    antialias : bool, default True
        End with a stage of temporal antialiasing, ``TAA("denoised", unguided_alpha=0.5, gamma=0.6, choice=False)``.

    Raises
    ------
    ValueError
        If a parameter is out of range.

    See Also
    --------
    SVGF : For frames that are traced as a whole.
    Recirculation : Keeps history as points, for few traced pixels.
    reconstruct : Fills untraced pixels.

    Notes
    -----
    An output's `history_length` counts traced samples, and reconstructed ones by their weight; its `missing` is the
    number of untraced pixels.

    Each step is that of `SVGF` with one more function: the demodulated colour goes through `reconstruct`, then to
    `accumulate` with weight 1 where it was traced and ``weight / (1 + N)`` elsewhere, N being the reprojected history
    length, so that a long history converges to the mean of its own samples. The gradient and the reflections use traced
    samples only. Besides the parameters above, these differ from `SVGF`: the filter has 5×5 taps (``radius=2`` in
    `atrous`); `choice` has ``strictness=1`` instead of 0.5, and uses predictions that are worth 0.9 samples or more
    instead of 2.5; `temporal_gradient` has ``noise=2.4, passes=4, widest=6``, whose windows are twice as wide; and the
    last stage clips history to 0.6 standard deviations.

    Examples
    --------
    >>> half_res = yester.HalfRes()
    >>> for number in range(4):
    ...     x, y = yester.HalfRes.offset(number)
    ...     color = np.full((8, 8, 3), np.nan)
    ...     color[y::2, x::2] = 1
    ...     output = half_res.step(yester.Frame(color))
    >>> output.missing
    48
    >>> output.history_length[:2, :2]
    array([[1.4206, 1.6493],
           [1.7267, 1.5539]], dtype=float32)
    """
    def __new__(
        cls,
        *,
        alpha: float = 0.2,
        weight: float = 0.3,
        radius: int = 2,
        iterations: int = 4,
        sigma_luminance: float = 4.0,
        relative_noise: float = 2.0,
        tap_exposure: float = 16.0,
        by_confidence: bool = False,
        fireflies: bool = False,
        reflections: Sequence[float] = (0.2, 0.4, 0.7, 1.2),
        choice: bool | None = None,
        innovation: bool = True,
        antialias: bool = True,
    ) -> Self: ...
    @staticmethod
    def offset(number: int) -> tuple[int, int]:
        """Choose the pixel of each 2×2 to trace in a frame.

        Four frames cover all pixels, and each even frame and the next a diagonal.

        Parameters
        ----------
        number : int
            Frame number, from 0.

        Returns
        -------
        (int, int)
            Its x and y in the block, 0 or 1.

        Raises
        ------
        ValueError
            If the number is negative.

        Examples
        --------
        >>> [yester.HalfRes.offset(number) for number in range(4)]
        [(0, 0), (1, 1), (1, 0), (0, 1)]
        """

@final
class BMFR(Pipeline):
    """Block-wise multi-order feature regression of a sequence of frames.

    Accumulates samples as `SVGF` does, fits the illumination of each block of pixels to its feature buffers, and
    accumulates the fits. Detail that no feature describes, such as shadow edges and reflections, is blurred within a
    block; it returns once enough samples are accumulated to tell it from noise. Buffers that a frame lacks drop
    out of the tests and features. Positions are the frame's, or computed from depth and camera.

    Parameters
    ----------
    alpha : float, default 0.05
        Smallest weight of the new sample in the history, 0 to 1.
    fitted_alpha : float, default 0.1
        Smallest weight of the new fit in the history of fits, 0 to 1.
    block : int, optional
        Side of the blocks in pixels, 4 to 256. By default 16, and 8 in frames without albedo, whose texture no feature
        tells. The paper has 32, for images of 1280×720.
    by_light : bool, default True
        Give pixels less weight in a fit where light is bright, as of lamps and highlights: ``1 / (1 + x)**2`` with ``x
        = l / 2e`` without albedo and ``x = (l / 16e)**2`` with it, l being the mean luminance of the accumulated light
        over 3×3 pixels and e its `exposure`. The differences by which new samples correct the output have the same
        weights.
    features : {"fewest", "all"}, default "fewest"
        As in `regress`.
    restore : bool, default True
        Give the fits back what detail the accumulated light shows beyond its noise (`restore_detail`), unless frames
        repeat each other's noise.
    relative_depth, plane_distance, normal_angle : float or (float, float), default 0.1, 0.01 and 25.0
        As in `SVGF`.
    motion_difference : float or (float, float), default 0.2
        As in `SVGF`.
    by_confidence : bool, default False
        Raise the new sample's weight where confidence in history is low: ``alpha + (1 - confidence) (1 - alpha)``.
    gradient : bool, default True
        Correct and shorten history where the light changes, as in `SVGF`, with ``noise=2.2, passes=3, widest=5`` in
        `temporal_gradient`.
    fireflies : bool, default False
        First clamp samples far brighter than their surroundings and their history, and redistribute the excess over
        their surface (`suppress_fireflies`).
    innovation : bool, default True
        Add the error of the fits, as estimated from new samples, to the fits and to the history, and correct the output
        stage, as in `SVGF`.
    antialias : bool, default True
        End with a stage of temporal antialiasing, `TAA` with preset "denoised".

    Raises
    ------
    ValueError
        If a parameter is out of range.

    See Also
    --------
    regress : Fits one frame.
    SVGF : Filters instead of fitting.

    Notes
    -----
    The method is that of Koskela et al. [1]_. Each step consists of this package's functions and gives their bits:
    `motion_vectors`, `depth_change` (without cameras), `is_reflectance` (with albedo), `material_ids` (with albedo,
    without ids), `demodulate`, `reproject` (with `consistency`), `light_change` (with `innovation`, without a replay),
    `suppress_fireflies`, `temporal_gradient`, `accumulate`, `exposure` (with `by_light`), `regress`, `blend`,
    `repetition`, `clip_history` and `restore_detail`, `innovation`, `remodulate`, and those of `TAA`, corrected as in
    `SVGF`. From frame to frame the grid of blocks is offset by (0, 0), (4, 4), (2, 6), (6, 2), (1, 3), (5, 7), (3, 1)
    and (7, 5) eighths of a block. Pixels with black albedo are not fitted if they have emission, or if their light has
    no noise (``m2 - m1² <= 0.01 m1²``), as lamps and background. Dark surfaces weigh less, ``min(1, d / 0.15)**2`` with
    ``1 / d`` the luminance of what demodulation multiplies light by: their highlights and unknown emission are divided
    by it, too. The weight of the N-th fit is at least 1/N. Detail is restored with a strictness of 0.7. It comes from
    the accumulated light of histories of at least 3.5 samples, clipped by ``clip_history(box="minmax", space="rgb",
    response="clamp")`` to the new samples, and its variance is ``(m2 - m1²) / N``. With `by_light`, what exceeds both
    fit and own new sample is divided by ``(1 + x / 8)**2``: history beside a lamp contains some of it.

    References
    ----------
    .. [1] M. Koskela, K. Immonen, M. Mäkitalo, A. Foi, T. Viitanen, P. Jääskeläinen, H. Kultala, J. Takala, "Blockwise
       multi-order feature regression for real-time path-tracing reconstruction", ACM Transactions on Graphics 38(5),
       2019.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> depth = np.full((32, 32), 2.0)
    >>> camera = yester.Camera.from_look_at([0, 0, 0], [0, 0, 1], [0, 1, 0], fov=60, width=32, height=32)
    >>> pipeline = yester.BMFR()
    >>> for _ in range(8):
    ...     frame = yester.Frame(rng.gamma(1, 0.5, (32, 32, 3)), depth=depth, camera=camera)
    ...     output = pipeline.step(frame)
    >>> bool(output.color.std() < frame.color.std() / 5)
    True
    """
    def __new__(
        cls,
        *,
        alpha: float = 0.05,
        fitted_alpha: float = 0.1,
        block: int | None = None,
        by_light: bool = True,
        features: Literal["fewest", "all"] = "fewest",
        restore: bool = True,
        relative_depth: _Threshold = 0.1,
        plane_distance: _Threshold = 0.01,
        normal_angle: _Threshold = 25.0,
        motion_difference: _Threshold = 0.2,
        by_confidence: bool = False,
        gradient: bool = True,
        fireflies: bool = False,
        innovation: bool = True,
        antialias: bool = True,
    ) -> Self: ...
    def step(self, frame: Frame, out: Output | None = None) -> Output:
        """Denoise the next frame of the sequence.

        Parameters
        ----------
        frame : Frame
            The next frame, of the same size as the previous ones.
        out : Output, optional
            An earlier step's output whose arrays are overwritten and returned, instead of new ones.

        Returns
        -------
        Output
            Without a variance.

        Raises
        ------
        ValueError
            If the size changes, or albedo appears or vanishes, without `reset` in between; if `out` does not fit.
        """
    def reset(self) -> None:
        """Discard all history; the next frame starts a new sequence."""

@final
class TAA(Pipeline):
    """Temporal antialiasing of a sequence of frames.

    Reprojects history along the motion, clips it to the neighbourhood of the new colour, and blends. For jittered
    frames with little noise: noise widens the neighbourhoods, so that clipping becomes less effective. Unless tests are
    switched on, history of different surfaces mixes, which is what antialiases edges. All buffers but colour are
    optional: without motion, it is computed from the cameras if both frames have one and depth or position is known;
    otherwise history is read in place.

    Parameters
    ----------
    preset : {"best", "denoised", "textbook", "karis", "filament"}, default "best"
        Source of the parameters that are not given: our own measurements, on frames without noise and on denoised ones;
        the textbook equation (clamped to the range of the 3×3 pixels, 5 % of the new sample); the talk of Karis (see
        References); Google's Filament. The last two have the techniques of their sources, but not all constants.
    alpha : float, optional
        Smallest weight of the new sample, 0 to 1.
    fast_alpha : float, optional
        Smallest weight of the new sample in fast motion, 0 to 1.
    speed : float or (float, float), optional
        Pixels up to which motion is slow, and from which it is fast.
    unguided_alpha : float, optional
        Smallest weight of the new sample, slow or fast, in frames without albedo, normals and ids, 0 to 1. Above 0,
        these frames are blended with `weighting` "tone". A denoiser without guides blurs edges and texture along with
        the noise, and what history then adds is mostly more blur. Frames are left out of which more than an eighth of
        the pairs of neighbours along x and y differ in depth by more than a tenth of the smaller one: what is thinner
        than a pixel needs its history. By default 0 in all presets.
    guided_exposure : float, optional
        Frames with albedo, normals or ids are blended with `weighting` "local-tone" at so many times the exposure, from
        0; with 0, as `weighting` says. What a denoiser lets leak from a lamp into the dark then fades faster, and what
        is not much brighter than the exposure is blended as before. By default 16 in preset "denoised", else 0.
    dilate : {"3x3", "cross", "none"}, optional
        Window of `dilate_motion`: the nearest pixel's motion if there is depth, else the longest.
    dilate_margin : float, optional
        Its margin, 0 to below 1.
    dilate_movers : bool, optional
        Whether pixels always take the motion of neighbours that move by themselves, as far as cameras and depth or
        position tell (the `still` of `dilate_motion`), or only where the history that it leads to is less than 0.3
        times as far from the mean colour of 3×3 pixels: the sum over channels of the differences of ``c / (l + e)``,
        with l the luminance of a colour c and e the exposure. By default all presets but "denoised" always do.
    filter : {"bilinear", "nearest", "catmull-rom", "catmull-rom-5", "lanczos-2"}, optional
        As in `reproject`.
    box, gamma, window, space, response : str or float, optional
        As in `clip_history`.
    weighting, flicker : str or float, optional
        As in `blend`.
    relative_depth, plane_distance, normal_angle : float or (float, float), optional
        Tests that history must pass, with thresholds as in `reproject`; by default none. With `plane_distance`, frames
        with camera, depth, normals and motion of 3 channels are tested by it, others by `relative_depth` if that is
        given. A test drops out where one of two frames lacks its buffers. Along edges the tests refuse the history that
        would antialias them.
    relative_albedo : float or (float, float), optional
        Largest relative difference of the albedo's luminance: rejects history where textures change or move, and where
        fine texture is sampled elsewhere (unlike `material_change`).
    ids : bool, default False
        Reject history with another id.
    fireflies : bool, default False
        First clamp samples far brighter than their surroundings and their history, fetched bilinearly without tests,
        and redistribute the excess over their surface (`suppress_fireflies`): of the frame's colour, or if that is
        denoised, of the `samples` of `step`.
    gradient : bool, default False
        Shorten history where the light changes by more than aliasing and noise explain (`temporal_gradient`). It helps
        with frames without noise; fireflies and other rare bright samples are mistaken for changes.
    anti_lag : float, default 0.0
        Shorten history where it is clipped: the `strength` of `anti_lag`; 0 turns it off. 1 helps with frames without
        noise, at almost no cost; in noisy frames, noise is clipped as well, and is then averaged less.
    alternation : bool, default False
        Do not clip history where the colours of whole neighbourhoods alternate (`alternation`): against flicker where
        an aliased feature is wider than the neighbourhood. It nearly doubles the time. For `SVGF`, use
        ``SVGF(antialias=False)`` followed by ``TAA("denoised", alternation=True)``.
    material_change : bool, optional
        Shorten history that has to be clipped where the albedo tells that the material has changed (`material_change`
        with its defaults): where a texture is swapped or plays, a denoised history leaves a ghost of the old one. The
        `confidence` of `step` counts as 0 there; if it is not given, as 1 elsewhere. By default only preset "denoised"
        does this.
    innovation : bool, default False
        Add the error of the result, as estimated from the samples of this and a few earlier frames, to the output
        (`innovation`, with the `exposure` of the result and ``fed_back=False``): for changing light in noisy frames.
        Without noise, part of the aliasing is mistaken for change. For denoised frames, see the `samples` of `step`.
    smooth_edges : bool, optional
        Show the result smoothed along its edges (`smooth_edges`; if there are `samples`, with the denoised colour as
        `newest`, its exposure and `confidence`); history stays as it is. Edges of denoised frames, whose pixels show
        either surface by chance, become straight. By default only preset "denoised" does this.
    clip_choice : bool, optional
        With the `samples` of denoised frames and `innovation`: tiles of 8×8 pixels leave their history unclipped where
        that would have predicted the samples of earlier frames better (see Notes). Where texture is as fine as the
        pixels, the colours around do not contain what a pixel shows on average. By default only preset "denoised" does
        this.
    choice : bool, optional
        With the `samples` of denoised frames: each tile of 8×8 pixels mixes the result with the denoised colour and the
        samples, by the weights that would have made the error of the frame before least (`collocate`,
        `collocation_shares`; frames are fetched by `reproject` without fallback). Frames of many samples are
        antialiased as they come, and have little noise. Samples are mixed into a tile only if at least 3 of 10 tiles,
        up to 4 tiles away along each axis, ask for a weight above 0.05. If that holds for one tile in 8, denoised
        colour is mixed into all tiles; so it is if its best weight for all of them together is at least 0.25 and at
        least a quarter of them ask for more than 0.05. With known `jitter`, as such frames are not antialiased, it is
        mixed only into tiles into which samples are. If neither holds, the whole frame shows the result alone, and the
        next five frames are not evaluated. So it mostly is with one sample per pixel, and always with the noise of the
        frame before (`repetition`), which comes with a `UserWarning`. By luminance, a sample counts for no more than
        eight times, and is shown as no more than three times, the result plus a sixteenth of its exposure, so that
        fireflies do not return.
        By default only preset "denoised" does this.

    Raises
    ------
    ValueError
        If a parameter is out of range, or a mode unknown (the error lists the modes).

    See Also
    --------
    clip_history : Clips history to the neighbourhood.
    resolve : Makes the image to which antialiasing should converge.
    Upscaler : Antialiases and upscales.
    morphological_aa, smooth_edges : Antialias a single image, without and with noise.

    Notes
    -----
    Each step consists of this package's functions and gives their bits: `motion_vectors`, `depth_change` (for tests of
    depth), `suppress_fireflies`, `resolve` (with "blackman-harris", of frames that tell their jitter, but for
    "textbook"), `dilate_motion`, `reproject` without fallback, `blend_factor`, `exposure`, `clip_history`,
    `alternation`, `material_change`, `anti_lag`, `temporal_gradient` (``noise=2.2, passes=3, widest=5``), `blend`,
    `smooth_edges`. The weight of a pixel's N-th sample is at least 1/N. With a gradient λ, N is first shortened to
    N (1 - λ)¹⁰, and the weight a becomes ``lerp(a, 1, λ)``, as in `accumulate`. Preset "karis" follows Karis [1]_,
    "filament" Google's Filament [2]_; Yang et al. [3]_ survey the field.

    With `clip_choice`, let h be the history and k the clipped history, l luminance, e a sixteenth of the exposure, a
    the blend factor before `weighting`, and s what the tiles choose, interpolated between their centres, times the
    share of the pixel's footprint in the frame before where d was not held at 0. Then k is moved by s d, ``d = (h -
    k) min(1, (l(k) + e) / (4 abs(l(h - k))))``. The next frame compares its samples with the luminances that the
    result has with the clip and without, ``l - s (1 - a) l(d)`` and ``l + (1 - s) (1 - a) l(d)``, fetched bilinearly
    without fallback, where their coverage is above 0.9 (`compare_candidates`, with candidate 0 as usual), and chooses
    by these and earlier samples (`choice` with its defaults). d is held at 0 where samples are not compared with
    history (see `samples` of `step`), where they have moved its luminance by more than a hundredth of that plus e,
    and up to two pixels along each axis from a `confidence` of 0. Samples that have the noise of the frame before
    (`repetition`) choose nothing.

    The presets set:

    ===============  ==================  ==================  ==========  ==========  ===============
    parameter        best                denoised            textbook    karis       filament
    ===============  ==================  ==================  ==========  ==========  ===============
    alpha            0.05                0.1                 0.05        0.05        0.12
    fast_alpha       0.25                0.3                 0.05        0.05        0.12
    speed            (0, 1)              (0, 1)              (2, 16)     (2, 16)     (2, 16)
    unguided_alpha   0                   0                   0           0           0
    guided_exposure  0                   16                  0           0           0
    dilate           "3x3"               "3x3"               "none"      "cross"     "3x3"
    dilate_margin    0.1                 0.1                 0           0           0
    dilate_movers    True                False               True        True        True
    filter           "catmull-rom-5"     "catmull-rom-5"     "bilinear"  "bilinear"  "catmull-rom-5"
    box              "variance"          "variance"          "minmax"    "rounded"   "intersection"
    gamma            1                   0.75                1           1           1
    window           "3x3"               "3x3"               "3x3"       "3x3"       "3x3"
    space            "tonemapped-ycocg"  "tonemapped-ycocg"  "rgb"       "ycocg"     "ycocg"
    response         "clamp"             "center"            "clamp"     "center"    "current"
    weighting        "none"              "none"              "none"      "tone"      "tone"
    flicker          1                   1                   1           0.2         1
    smooth_edges     False               True                False       False       False
    clip_choice      False               True                False       False       False
    choice           False               True                False       False       False
    material_change  False               True                False       False       False
    ===============  ==================  ==================  ==========  ==========  ===============

    References
    ----------
    .. [1] B. Karis, "High quality temporal supersampling", Advances in Real-Time Rendering in Games, SIGGRAPH courses,
       2014.
    .. [2] Google, "Filament", github.com/google/filament.
    .. [3] L. Yang, S. Liu, M. Salvi, "A survey of temporal antialiasing techniques", Computer Graphics Forum 39(2),
       2020.

    Examples
    --------
    >>> taa = yester.TAA()
    >>> for jitter in yester.jitter(8):
    ...     output = taa.step(yester.Frame(np.ones((8, 8, 3)), jitter=jitter))
    >>> output.history_length[0]
    array([8., 8., 8., 8., 8., 8., 8., 8.], dtype=float32)
    >>> yester.TAA("karis", alpha=0.1)
    TAA('karis', alpha=0.1)
    """
    def __new__(
        cls,
        preset: Literal["best", "denoised", "textbook", "karis", "filament"] = "best",
        *,
        alpha: float | None = None,
        fast_alpha: float | None = None,
        speed: _Threshold | None = None,
        unguided_alpha: float | None = None,
        guided_exposure: float | None = None,
        dilate: Literal["3x3", "cross", "none"] | None = None,
        dilate_margin: float | None = None,
        dilate_movers: bool | None = None,
        filter: _Filter | None = None,
        box: _Box | None = None,
        gamma: float | None = None,
        window: Literal["3x3", "5x5"] | None = None,
        space: _Space | None = None,
        response: _Response | None = None,
        weighting: _Weighting | None = None,
        flicker: float | None = None,
        relative_depth: _Threshold | None = None,
        plane_distance: _Threshold | None = None,
        normal_angle: _Threshold | None = None,
        relative_albedo: _Threshold | None = None,
        ids: bool = False,
        fireflies: bool = False,
        gradient: bool = False,
        anti_lag: float = 0.0,
        alternation: bool = False,
        material_change: bool | None = None,
        innovation: bool = False,
        smooth_edges: bool | None = None,
        clip_choice: bool | None = None,
        choice: bool | None = None,
    ) -> Self: ...
    def step(
        self,
        frame: Frame,
        out: Output | None = None,
        *,
        samples: ArrayLike | None = None,
        confidence: ArrayLike | None = None,
    ) -> Output:
        """Apply antialiasing to the next frame of the sequence.

        Parameters
        ----------
        frame : Frame
            The next frame, of the same size as the previous ones.
        out : Output, optional
            An earlier step's output whose arrays are overwritten and returned, instead of new ones. From the
            second frame on, no image memory is then allocated.
        samples : (H, W, 3) array_like of float, optional
            If the frame's colour is denoised: the samples that it was made of, by which `choice` judges. Missing ones
            are NaN. With `innovation`, they also correct history and result, as in the last stage of a denoiser.
            History is first multiplied by the `light_change` from it, fetched bilinearly without tests or fallback, to
            the samples. Then its own error, fetched bilinearly without fallback, is estimated (``strictness=4,
            share=0.7``) and added to it, but no further than to the new colour. Not compared are pixels whose coverage
            is at most 0.9, whose `confidence` is 0, or of which one of the 3×3 around has emission, a new colour of
            more than six times the exposure, or no finite depth: beside lamps and the sky, antialiased edges differ
            from single samples. Last, the error of the result is estimated (``strictness=12, share=0.7``), and corrects
            result and history. Denoised colour is not resolved by its `jitter`.
        confidence : (H, W) array_like of float, optional
            With `samples`: the denoiser's. Where it is 0, that found no history of the surface; history that has to be
            clipped there, and is not fetched along the motion of a neighbour, is another surface's. It is shortened, as
            by `anti_lag` with a strength of ``8 (k + e) / (max(k, c) + e)``, with k and c the luminances of the clipped
            history and of the denoised colour, and e a sixteenth of the exposure. Where it is below 1, `smooth_edges`
            smooths more.

        Returns
        -------
        Output
            Without a variance.

        Raises
        ------
        ValueError
            If the size changes without `reset` in between; if `out`, `samples` or `confidence` do not fit; if there is
            `confidence` without `samples`.
        """
    def reset(self) -> None:
        """Discard all history; the next frame starts a new sequence."""

@final
class Recirculation(Pipeline):
    """Complete frames of which only a part of the pixels is traced.

    History is kept as world-space points, one for each pixel, and scattered to where they appear now. The new frame's
    samples, with holes filled from their surroundings, are blended with it by quality. Untraced pixels need no buffers.

    A pixel counts as traced if its colour is finite and its position is known: `position`, or else `depth`, +inf where
    nothing was hit. All others are missing, whatever their other buffers contain; mark them by NaN. Every frame needs a
    camera. The pattern of traced pixels should change from frame to frame, so that each pixel is traced at some time.

    Parameters
    ----------
    preset : {"best", "textbook"}, default "best"
        Source of the parameters that are not given: our own measurements; or the textbook method as its source
        describes it, with ``factor=4, levels=2, nearness=1, history="fetch", share=(0.1, 0.5)``.
    factor : int, optional
        Ratio of the sides of successive levels of hole filling, 2 to 16, as in `pull_push`. "best" has 2.
    levels : int, optional
        Number of levels, at least 1. "best" goes down to a single pixel.
    nearness : int, optional
        Exponent of inverse depth in the samples' weight for hole filling, 0 to 4: near samples override distant ones.
        "best" has 0.
    history : {"splat", "fetch"}, optional
        Scatter history to where it appears now, or fetch it along the motion of the new samples. "best" has "splat".
    blur, share, fade, limit : float or (float, float), optional
        As in `recirculate`. "best" has its defaults. With "splat", history stays free of the blur.
    tolerance : float, optional
        As in `splat`; also the largest difference of a sample's depth, relative to it, from that of history at its
        pixel. Both presets have 0.1. No effect with "fetch".
    fireflies : bool, default False
        First clamp samples far brighter than the other samples around, and redistribute the excess over those of their
        surface (`suppress_fireflies`, by depth, normals and ids, without history).
    innovation : bool, optional
        Add the error of the result, as estimated from new samples over blocks of pixels and a few frames, to the result
        and to history (`innovation`), for changing light. The correction is relative to each pixel's own light, so that
        fireflies in history grow with the light around them. "best" does it.

    Raises
    ------
    ValueError
        If a parameter is out of range, or a preset or history unknown.

    See Also
    --------
    HalfRes : Denoises frames of which a part is traced.
    splat : Scatters history.
    recirculate : Blends history and new samples.

    Notes
    -----
    After a developer's diary [1]_. Each step consists of this package's functions and gives their bits:
    `suppress_fireflies`, `pull_push` (of colour and the inverse of depth), `splat` (with a reach of 0.5),
    `motion_vectors`, `recirculate`, without blur for the next frame and with it for the result, and from the second
    frame on `innovation` (``sparse=True``, with the `exposure` of the result, and the motion of `recirculate`). The
    point of a traced pixel lies where it was sampled (`Frame.position` or `Frame.jitter`, else the centre), that of a
    pixel with history where history's point lies, and that of a filled pixel at the centre, at the filled depth. Filled
    colour is ignored where history has eight times its quality; otherwise static pixels would never become as sharp as
    their samples. With `Frame.motion` at traced pixels, moving objects are extrapolated (`splat`'s drift); without it,
    they leave a ghost until samples overwrite it.

    In hole filling, a sample at depth ``z`` has weight ``max(z**-nearness, 1e-24)``. The quality of a filled pixel is
    divided by the weight at its depth, so that it counts samples.

    "fetch" applies one `recirculate` (with `fetch`) to the previous result, including its blur, along the motion of the
    filled samples. It is not validated against the surface. Interpolation in every frame blurs it, and averages noise:
    the notebook `recirculation.ipynb` shows both, beside the other choices of "textbook".

    References
    ----------
    .. [1] T. Lottes, "Reprojection 2", timothylottes.github.io/20081218.html, 2008.

    Examples
    --------
    >>> camera = yester.Camera.from_look_at([0, 0, 0], [0, 0, 1], [0, 1, 0], fov=60, width=8, height=8)
    >>> pipeline = yester.Recirculation()
    >>> for number in range(4):
    ...     x, y = yester.HalfRes.offset(number)
    ...     color = np.full((8, 8, 3), np.nan)
    ...     color[y::2, x::2] = 1
    ...     output = pipeline.step(yester.Frame(color, depth=np.full((8, 8), 2.0), camera=camera))
    >>> output.missing, bool(np.isfinite(output.color).all())
    (48, True)
    """
    def __new__(
        cls,
        preset: Literal["best", "textbook"] = "best",
        *,
        factor: int | None = None,
        levels: int | None = None,
        nearness: int | None = None,
        history: Literal["splat", "fetch"] | None = None,
        blur: float | None = None,
        share: tuple[float, float] | None = None,
        fade: float | None = None,
        limit: float | None = None,
        tolerance: float | None = None,
        fireflies: bool = False,
        innovation: bool | None = None,
    ) -> Self: ...
    def step(self, frame: Frame, out: Output | None = None) -> Output:
        """Complete the next frame of the sequence.

        Parameters
        ----------
        frame : Frame
            The next frame, of the same size as the previous ones, with camera, and depth or position.
        out : Output, optional
            An earlier step's output whose arrays are overwritten and returned, instead of new ones.

        Returns
        -------
        Output
            Without a variance. `history_length` is the quality of the pixel: 1 for a sample, more for several; the
            farther away the samples, the smaller. `confidence` is 1 where there is history, else 0; `rejection` is
            OUTSIDE where no point of history arrived, or motion leads to none, and DEPTH where a sample's depth
            disagrees with history's. Until anything has been traced, colour is black.

        Raises
        ------
        ValueError
            If the frame has no camera, or neither depth nor position; if the size changes without `reset` in between;
            if `out` does not fit.
        """
    def reset(self) -> None:
        """Discard all history; the next frame starts a new sequence."""

@final
class Upscaler(Pipeline):
    """Temporal upscaling of a sequence of frames.

    Every frame is rendered at low resolution with a different sub-pixel offset (`jitter`); a history at output
    resolution accumulates their samples. All buffers of a frame have the low resolution, and all but colour are
    optional: without depth, disocclusions are not detected; without motion, it is computed from the cameras if both
    frames have one and depth or position is known; otherwise history is read in place. A frame without jitter
    information counts as not jittered, so that no sub-pixel detail can be recovered, however many frames there are.

    Parameters
    ----------
    scale : float, default 2.0
        Ratio of output to input size along each side, 1 to 4; tuned for 1.3 to 3. Output sizes are rounded, halves to
        even. About ``8 * scale**2`` phases of jitter cover the output grid: ``jitter(32)`` for 2.
    alpha : float, default 0.06
        Smallest weight, 0 to 1, of a sample per output pixel in static history.
    fast_alpha : float, default 0.5
        Smallest weight in fast motion, 0 to 1.
    speed : float or (float, float), default (0, 1)
        Output pixels up to which motion is slow, and from which it is fast.
    separation : float, default 0.05
        As in `disocclusion`.
    lifetime : float, default 16
        Frames until the lock of a thin feature expires after its last detection; above 0.
    sharpness : float, default 0.0
        Strength of `sharpen`, 0 (off) to 1. History is not sharpened.
    fireflies : bool, default False
        First clamp samples far brighter than their surroundings and their history, and redistribute the excess over
        their surface (`suppress_fireflies`).

    Raises
    ------
    ValueError
        If a parameter is out of range.

    See Also
    --------
    resample : Upscales one frame.
    TAA : Antialiases without upscaling.
    jitter : Sub-pixel offsets.

    Notes
    -----
    Its parts follow AMD's FSR 2 [1]_. Each step consists of this package's functions and gives their bits:
    `dilate_motion`, `disocclusion`, `reproject` with "catmull-rom-5" and without tests, `suppress_fireflies`,
    `thin_features`, `resample` (colour by "lanczos-2", all else by "nearest"), `temporal_gradient` between the new
    samples and the history at their places, `clip_history`, `blend_factor`, `blend` and `sharpen`. A new frame of
    weight w is blended into a history of N samples per pixel with w/(N + w). Clipping is undone in static pixels,
    unless the light changes in a cell of 2×2 samples (``passes=1``), and where a thin feature is locked, unless more
    than a quarter of the light changes around it (``passes=3``). `Output.history_length` counts samples per output
    pixel.

    References
    ----------
    .. [1] AMD, "FidelityFX Super Resolution 2", GPUOpen, 2022.

    Examples
    --------
    >>> upscaler = yester.Upscaler(2.0)
    >>> for jitter in yester.jitter(32):
    ...     output = upscaler.step(yester.Frame(np.ones((8, 8, 3)), jitter=jitter))
    >>> output.color.shape
    (16, 16, 3)
    """
    def __new__(
        cls,
        scale: float = 2.0,
        *,
        alpha: float = 0.06,
        fast_alpha: float = 0.5,
        speed: _Threshold = (0.0, 1.0),
        separation: float = 0.05,
        lifetime: float = 16.0,
        sharpness: float = 0.0,
        fireflies: bool = False,
    ) -> Self: ...
    def step(self, frame: Frame, out: Output | None = None) -> Output:
        """Upscale the next frame of the sequence.

        Parameters
        ----------
        frame : Frame
            The next frame, of the same size as the previous ones. Its `reactive` mask, if any, excludes history.
        out : Output, optional
            An earlier step's output whose arrays are overwritten and returned, instead of new ones.

        Returns
        -------
        Output
            At output resolution, without a variance.

        Raises
        ------
        ValueError
            If the size changes without `reset` in between; if `out` does not fit.
        """
    def reset(self) -> None:
        """Discard all history; the next frame starts a new sequence."""

def canonical(value: ArrayLike | None, name: str, size: tuple[int, int] | None = None) -> NDArray[Any]:
    """Convert a frame's buffer to its canonical form: float32 (uint32 for `ids`) in C order.

    Parameters
    ----------
    value : array_like
        The buffer.
    name : str
        Its name in `Frame`, which determines channels and element type.
    size : (int, int), optional
        Height and width that it must have.

    Returns
    -------
    (H, W) or (H, W, C) ndarray
        The buffer itself if it is canonical, else a copy.

    Raises
    ------
    TypeError, ValueError
        On a wrong element type, shape or size.
    """

def jitter(count: int, *, sequence: Literal["halton", "r2", "rotated-grid", "blue-noise"] = "halton") -> _Doubles:
    """Sub-pixel sample positions for successive frames.

    Parameters
    ----------
    count : int
        Number of phases, at least 1.
    sequence : {"halton", "r2", "rotated-grid", "blue-noise"}, default "halton"
        Halton in bases 2 and 3; Roberts' R2; the lattice with one point in each row and column of a `count` x `count`
        grid and the largest minimum distance, from left to right (for 4, the pattern of rotated-grid multisampling);
        the same points in an order of which every prefix is well spread.

    Returns
    -------
    offsets : (count, 2) float64
        From the pixel's centre, x right, y down, in pixels from -0.5 to 0.5. For `Camera.jittered`.

    Raises
    ------
    ValueError
        If `count` is below 1 or above 65536, or the sequence is unknown.

    See Also
    --------
    Camera.jittered : The camera that renders a jittered frame.
    resolve : The image that jittered frames amount to.

    Notes
    -----
    The points of "halton" and "r2" do not depend on `count`; those of the others do. "halton" has the radical inverses
    of 1, 2, 3, … in bases 2 and 3 [1]_, "r2" multiples of (1/ρ, 1/ρ²) modulo 1, with ρ³ = ρ + 1 [2]_.

    References
    ----------
    .. [1] J. H. Halton, G. B. Smith, "Algorithm 247: radical-inverse quasi-random point sequence", Communications of
       the ACM 7(12), 1964.
    .. [2] M. Roberts, "The unreasonable effectiveness of quasirandom sequences", extremelearning.com.au, 2018.

    Examples
    --------
    >>> yester.jitter(4)
    array([[ 0.    , -0.1667],
           [-0.25  ,  0.1667],
           [ 0.25  , -0.3889],
           [-0.375 , -0.0556]])
    """

def motion_vectors(
    geometry: ArrayLike,
    camera: Camera,
    previous_camera: Camera,
    *,
    ids: ArrayLike | None = None,
    transforms: Mapping[int, ArrayLike] | None = None,
    out: _Floats | None = None,
) -> _Floats:
    """Motion vectors: where each pixel's surface was in the previous frame.

    Parameters
    ----------
    geometry : (H, W) or (H, W, 3) array_like of float
        Depth, view-space z, +inf or not above 0 where nothing was hit; or world-space position, not finite there.
        Positions account for the sub-pixel position of each sample.
    camera, previous_camera : Camera
        Of the current and the previous frame, without jitter, both of the image's size.
    ids : (H, W) array_like of int, optional
        Object id of each pixel.
    transforms : dict of int to (4, 4) array_like of float, optional
        Per id, ``previous @ inverse(current)`` of the object's to-world matrices: maps a current world point of the
        object to its previous position. Objects that are not listed are static. Needs `ids`.
    out : (H, W, 3) float32 array, optional
        Written and returned instead of a new array; it may be an input.

    Returns
    -------
    motion : (H, W, 3) float32
        Previous minus current x and y in pixels (x right, y down) and previous minus current depth in scene units.
        Zero for a still camera and object, exactly. Background moves with the camera's rotation alone. NaN where the
        surface was not in front of the previous camera, or the depth is NaN.

    Raises
    ------
    ValueError
        On a wrong shape, a camera of another size, `transforms` without `ids`, or a matrix that is not affine.

    See Also
    --------
    virtual_motion : Motion of reflections.
    dilate_motion : Motion that antialiases edges.
    reproject : Fetches history along the motion.

    Notes
    -----
    With T the `transforms` matrix of the object (the identity for static ones), a point X has the motion
    ``project(previous_camera, T X) - project(camera, X)``, computed in double precision. Both ends project the same
    point, so that the jitter of its sample cancels. The third channel is what NRD calls 2.5-D motion [1]_; it makes the
    depth tests of `reproject` exact under motion.

    References
    ----------
    .. [1] NVIDIA, "NVIDIA Real-Time Denoisers" (ReBLUR, ReLAX), github.com/NVIDIA-RTX/NRD; D. Zhdan, "ReBLUR: a
       hierarchical recurrent denoiser", Ray Tracing Gems II, 2021.

    Examples
    --------
    >>> camera = yester.Camera.from_look_at([0, 0, 5], [0, 0, 0], [0, 1, 0], fov=90, width=4, height=4)
    >>> previous = yester.Camera.from_look_at([1, 0, 5], [1, 0, 0], [0, 1, 0], fov=90, width=4, height=4)
    >>> motion = yester.motion_vectors(np.full((4, 4), 5.0), camera, previous)
    >>> motion[0, 0]
    array([-0.4,  0. ,  0. ], dtype=float32)
    """

def virtual_motion(
    geometry: ArrayLike,
    hit_distance: ArrayLike,
    camera: Camera,
    previous_camera: Camera,
    *,
    out: _Floats | None = None,
) -> _Floats:
    """Virtual motion: where each pixel's reflection was in the previous frame.

    Parameters
    ----------
    geometry : (H, W) or (H, W, 3) array_like of float
        Depth or world-space position of the reflecting surfaces, as for `motion_vectors`.
    hit_distance : (H, W) array_like of float
        Distance from the surface to the reflected object, in scene units; +inf for the environment.
    camera, previous_camera : Camera
        Of the current and the previous frame, without jitter, both of the image's size.
    out : (H, W, 2) float32 array, optional
        Written and returned instead of a new array; it may be an input.

    Returns
    -------
    motion : (H, W, 2) float32
        Previous position of the virtual image minus current position of the pixel, x right, y down. For a distance of 0
        this is the surface's own motion. NaN where the distance is NaN or negative, or the virtual image was not in
        front of the previous camera. Background moves with the camera's rotation, whatever its distance.

    Raises
    ------
    ValueError
        On a wrong shape or a camera of another size.

    See Also
    --------
    motion_vectors : Motion of the surfaces themselves.
    prediction_gain : Tells which of two histories predicts new samples better.

    Notes
    -----
    The image in a flat mirror lies on the continued view ray, as far behind the surface as the reflected object is in
    front of it: ``X + hit_distance (X - C)/|X - C|``. For static mirrors; after the virtual motion of NRD's ReBLUR and
    ReLAX [1]_. Validate history fetched along it by id and normal only: the source pixel shows another point of the
    mirror.

    References
    ----------
    .. [1] NVIDIA, "NVIDIA Real-Time Denoisers" (ReBLUR, ReLAX), github.com/NVIDIA-RTX/NRD; D. Zhdan, "ReBLUR: a
       hierarchical recurrent denoiser", Ray Tracing Gems II, 2021.

    Examples
    --------
    >>> camera = yester.Camera.from_look_at([0, 0, 5], [0, 0, 0], [0, 1, 0], fov=90, width=4, height=4)
    >>> previous = yester.Camera.from_look_at([1, 0, 5], [1, 0, 0], [0, 1, 0], fov=90, width=4, height=4)
    >>> depth = np.full((4, 4), 5.0)
    >>> yester.virtual_motion(depth, np.zeros((4, 4)), camera, previous)[1, 1]
    array([-0.4,  0. ], dtype=float32)
    >>> yester.virtual_motion(depth, np.full((4, 4), 5.0), camera, previous)[1, 1]
    array([-0.2059,  0.    ], dtype=float32)
    """

def depth_change(depth: ArrayLike, previous_depth: ArrayLike, motion: ArrayLike) -> float:
    """Find the change of depth that most surfaces share, where neither motion nor cameras tell it.

    Parameters
    ----------
    depth : (H, W) array_like of float
        View-space z. Background, which is infinite or not above 0, and NaN tell nothing.
    previous_depth : (H, W) array_like of float
        That of the previous frame.
    motion : (H, W, 2) or (H, W, 3) array_like of float
        As `motion_vectors` returns it. A third channel is not used.

    Returns
    -------
    change : float
        By how much the surfaces were farther away in the previous frame: the third channel of motion that
        `motion_vectors` would give for most of them. 0 where they share no change.

    Raises
    ------
    ValueError
        On wrong shapes.

    See Also
    --------
    motion_vectors : Exact changes of depth, from cameras.
    reproject : Expects history at ``depth + motion[..., 2]``.

    Notes
    -----
    A camera that moves by d along its view, without turning, changes the depth of all that rests by d. With Z the depth
    and Z′ that of the pixel of the previous frame nearest to where the motion leads, let r(d) be the number of pixels
    with ``|Z′ - Z - d| > (Z + d) / 10``, whose history the test of depth rejects. The change is ``m = median(Z′ - Z)``
    where ``2 r(m) < r(0)`` and ``|m| < median(Z) / 4``, else 0. Every eighth pixel of every eighth row is looked at,
    from the fourth on, of which 16 must be known.

    Without the change, a dolly of a tenth of the distance a frame loses all history. The pipelines add it to motion of
    two channels where cameras are unknown.

    Examples
    --------
    >>> depth = np.random.default_rng(0).uniform(4, 6, size=(48, 64))
    >>> yester.depth_change(depth, depth + 1, np.zeros((48, 64, 2)))
    1.0
    """

def dilate_motion(
    motion: ArrayLike,
    depth: ArrayLike | None = None,
    *,
    still: ArrayLike | None = None,
    choose: Literal["nearest", "longest"] = "nearest",
    window: Literal["3x3", "cross"] = "3x3",
    margin: float = 0.0,
    out: _Floats | None = None,
) -> _Floats:
    """Dilated motion: each pixel takes the motion of the nearest surface around it.

    Parameters
    ----------
    motion : (H, W, 2) or (H, W, 3) array_like of float
        As `motion_vectors` returns it.
    depth : (H, W) array_like of float, optional
        View-space z; NaN or not above 0 counts as infinitely far. Needed for `choose` "nearest".
    still : (H, W, 2) or (H, W, 3) array_like of float, optional
        Motion if nothing but the camera moved (`motion_vectors`). With it, a pixel does not take the motion of
        neighbours that move by themselves: those whose motion differs from it by more than half a pixel. For `choose`
        "nearest".
    choose : {"nearest", "longest"}, default "nearest"
        Takes the motion of the neighbour with the smallest depth, or the longest motion in pixels.
    window : {"3x3", "cross"}, default "3x3"
        The neighbours that are searched: all eight, or four.
    margin : float, default 0.0
        How much nearer than the pixel itself a neighbour must be, relative to the pixel's depth; for "longest", how
        much longer its motion, relative to the neighbour's. 0 to below 1.
    out : float32 array like `motion`, optional
        Written and returned instead of a new array; it may be an input.

    Returns
    -------
    motion : (H, W, 2) or (H, W, 3) float32
        All channels of the chosen neighbour. Motion that is not finite is taken only where there is no other. Ties go
        to the pixel itself, then to the first neighbour from the top left.

    Raises
    ------
    ValueError
        On wrong shapes, an unknown mode, a margin out of range, "nearest" without depth, or `still` without "nearest".

    See Also
    --------
    motion_vectors : Motion from cameras.
    TAA : Uses dilated motion.

    Notes
    -----
    With dilation, the history of an edge moves with the foreground as a whole, so that the edge is antialiased [1]_.
    Without it, histories of different surfaces do not mix. The published rule has no margin: on surfaces that turn or
    come closer, where motion differs from pixel to pixel, it fetches history beside its place, and blurs it. `TAA`,
    `Upscaler` and the denoisers dilate with a margin of 0.1, which leaves the motion of surfaces alone. Beside an
    object that moves by itself, dilation drags the history of the background along; the denoisers do not dilate there.

    References
    ----------
    .. [1] B. Karis, "High quality temporal supersampling", Advances in Real-Time Rendering in Games, SIGGRAPH courses,
       2014.

    Examples
    --------
    >>> motion = np.zeros((3, 4, 2))
    >>> motion[1, 1] = 4, 0
    >>> depth = np.full((3, 4), 9.0)
    >>> depth[1, 1] = 1
    >>> yester.dilate_motion(motion, depth)[..., 0]
    array([[4., 4., 4., 0.],
           [4., 4., 4., 0.],
           [4., 4., 4., 0.]], dtype=float32)
    """

def invert_motion(
    motion: ArrayLike,
    depth: ArrayLike | None = None,
    *,
    still: ArrayLike | None = None,
    out: _Floats | None = None,
) -> _Floats:
    """Inverted motion: where each pixel's surface is in the next frame, from the next frame's motion.

    Parameters
    ----------
    motion : (H, W, 2) or (H, W, 3) array_like of float
        `Frame.motion` of the next frame: its pixels' positions in this frame minus their own, in pixels, x right, y
        down, and the same of depth. Pixels with NaN or infinity are left out.
    depth : (H, W) array_like of float, optional
        View-space z of the next frame, +inf where nothing was hit; pixels with NaN, or not above 0, are left out. Where
        several pixels come from one, the nearest in this frame counts, by the third channel of `motion`. Without depth,
        all pixels count as equally far, even if motion has a third channel.
    still : (H, W, 2) or (H, W, 3) array_like of float, optional
        Motion to the next frame if nothing moved but the camera, with as many channels as `motion`: `motion_vectors` of
        this frame with the next frame's camera as the previous one. Exact where that is so; it replaces inverted motion
        that differs by at most half a pixel, and holds where no pixel of the next frame comes from.
    out : float32 array like `motion`, optional
        Written and returned instead of a new array; it may be an input.

    Returns
    -------
    motion : (H, W, 2) or (H, W, 3) float32
        Next minus current position in pixels, and depth. NaN where nothing is known.

    Raises
    ------
    ValueError
        On wrong shapes.

    See Also
    --------
    denoise : Denoises with later frames as well, along inverted motion.
    motion_vectors : Motion from cameras.

    Notes
    -----
    Pixel q of the next frame comes from ``q + motion[q]`` and therefore gives the pixel there ``-motion[q]``. A pixel
    that none comes from takes the nearest of its neighbours' points that lie less than a pixel away along each axis, so
    that surfaces which move apart have no cracks. Of points at the same depth, the first in rows counts.

    Examples
    --------
    >>> motion = np.zeros((1, 4, 2))
    >>> motion[..., 0] = -1
    >>> yester.invert_motion(motion)[0, :, 0]
    array([ 1.,  1.,  1., nan], dtype=float32)
    """

@overload
def reproject(
    history: Sequence[_Floats],
    motion: ArrayLike,
    *,
    filter: _Filter = "bilinear",
    fallback: bool = True,
    dering: bool = True,
    depth: ArrayLike | None = None,
    previous_depth: ArrayLike | None = None,
    normal: ArrayLike | None = None,
    previous_normal: ArrayLike | None = None,
    ids: ArrayLike | None = None,
    previous_ids: ArrayLike | None = None,
    object_normal: ArrayLike | None = None,
    previous_object_normal: ArrayLike | None = None,
    color: ArrayLike | None = None,
    previous_color: ArrayLike | None = None,
    previous_motion: ArrayLike | None = None,
    previous_camera: Camera | None = None,
    relative_depth: _Threshold = 0.1,
    plane_distance: _Threshold = 0.01,
    normal_angle: _Threshold = 25.0,
    relative_luminance: _Threshold = 0.5,
    speed: _Threshold | None = None,
    motion_difference: _Threshold = 0.2,
    out: tuple[Sequence[_Floats] | None, _Floats | None] | None = None,
) -> tuple[list[_Floats], _Floats]:
    """Reprojection: fetches history along motion vectors, each tap validated.

    Parameters
    ----------
    history : (H, W) or (H, W, C) array_like of float, or list of such
        The previous frame's image, or several, which are faster in one call than in several.
    motion : (H, W, 2) or (H, W, 3) array_like of float
        Previous minus current position in pixels, x right, y down; the third channel, if given, previous minus current
        depth. Where it is not finite there is no history.
    filter : {"bilinear", "nearest", "catmull-rom", "catmull-rom-5", "lanczos-2"}, default "bilinear"
        Interpolation between pixel centres. The last three stay sharp under repeated resampling: the cubic with 16
        taps, the cubic without its corner taps (as GPUs compute it from five bilinear fetches), and sinc(x) sinc(x/2).
        They apply where all their taps are valid; elsewhere bilinear does.
    fallback : bool, default True
        Take the mean of the valid pixels of a 3×3 window where less than 0.01 of the footprint is valid.
    dering : bool, default True
        Clamp the wide filters to the range of the nearest 2×2 taps.
    depth, previous_depth : (H, W) array_like of float, optional
        View-space z; +inf or not above 0 is background. Each pair of buffers is given together or not at all.
    normal, previous_normal : (H, W, 3) array_like of float, optional
        World space; only directions count. Zeros, as where nothing was hit, have none, and pass.
    ids, previous_ids : (H, W) array_like of int, optional
        Taps with another id fail.
    object_normal, previous_object_normal : (H, W, 3) array_like of float, optional
        In object space, where they do not rotate with the object. Their directions are compared instead of those of
        `normal`.
    color, previous_color : (H, W, 3) array_like of float, optional
        Compared by luminance. Missing samples pass.
    previous_motion : (H, W, 2) or (H, W, 3) array_like of float, optional
        The previous frame's own motion. Tells what is uncovered from what covered it where no other buffer does. Where
        it is not finite, it is unknown, and all pass.
    previous_camera : Camera, optional
        Turns the depth test from relative depth to plane distance; needs depths, normals and motion of 3 channels.
    relative_depth : float or (float, float), default 0.1
        Largest ``|previous - expected| / expected`` depth; above 0. Of this and all thresholds below, a pair is a ramp:
        full trust up to the first, none beyond the second, linear between.
    plane_distance : float or (float, float), default 0.01
        Largest distance of the expected point from the tap's plane, relative to the expected depth; above 0.
    normal_angle : float or (float, float), default 25.0
        Largest angle between normals in degrees, 0 to 180. The ramp is linear in the cosine.
    relative_luminance : float or (float, float), default 0.5
        Largest ``|l - l'| / max(|l|, |l'|)`` of the luminances; from 0.
    speed : float or (float, float), optional
        Longest motion in pixels; from 0. By default any.
    motion_difference : float or (float, float), default 0.2
        Largest difference of the pixel's motion from the tap's in the previous frame, in pixels, above twice the least
        such difference among all pixels whose 2×2 footprints have the tap; from 0, +inf for any.
    out : tuple of values, as `history` has them, and of (H, W) float32 coverage, optional
        Written and returned instead of new arrays; they may be inputs. A part may be None.

    Returns
    -------
    values : float32 array like `history`, or list of such
        The weighted mean of the valid taps; 0 where less than 0.01 of the footprint is valid and no fallback applies.
    coverage : (H, W) float32
        The valid fraction of the footprint, 0 to 1: the 2×2 weights times their trust, summed, or, where the fallback
        applied, the fraction of the 3×3 window's pixels. 0 where there is no history, or less than 0.01 of it.

    Raises
    ------
    ValueError
        On wrong shapes, an unknown filter, a buffer without its partner, or a threshold out of range.

    See Also
    --------
    consistency : Tests history without fetching it.
    motion_vectors : Motion from cameras.
    accumulate : Merges new samples into the result.

    Notes
    -----
    A tap is valid when it lies inside the image, is finite in every channel of every history image, and passes the
    tests that `consistency` describes; its weight is multiplied by their trust. The scheme is that of SVGF ([1]_,
    section 4.1), with every tap tested on its own. "catmull-rom" is the cubic with a = -½ [2]_, "catmull-rom-5" drops
    its corner taps [3]_. Without motion, the values are those of `history`, bit for bit, except that −0 becomes 0.

    References
    ----------
    .. [1] C. Schied, A. Kaplanyan, C. Wyman, A. Patney, C. R. A. Chaitanya, J. Burgess, S. Liu, C. Dachsbacher, A.
       Lefohn, M. Salvi, "Spatiotemporal variance-guided filtering: real-time reconstruction for path-traced global
       illumination", High-Performance Graphics, 2017.
    .. [2] R. G. Keys, "Cubic convolution interpolation for digital image processing", IEEE Transactions on Acoustics,
       Speech, and Signal Processing 29(6), 1981.
    .. [3] J. Jimenez, "Filmic SMAA: sharp morphological and temporal antialiasing", Advances in Real-Time Rendering in
       Games, SIGGRAPH courses, 2016.

    Examples
    --------
    >>> history = np.array([[0.0, 1.0, 2.0, 3.0]])
    >>> motion = np.zeros((1, 4, 2))
    >>> motion[..., 0] = 0.5
    >>> values, coverage = yester.reproject(history, motion)
    >>> values
    array([[0.5, 1.5, 2.5, 3. ]], dtype=float32)
    >>> coverage
    array([[1. , 1. , 1. , 0.5]], dtype=float32)
    """

@overload
def reproject(
    history: ArrayLike,
    motion: ArrayLike,
    *,
    filter: _Filter = "bilinear",
    fallback: bool = True,
    dering: bool = True,
    depth: ArrayLike | None = None,
    previous_depth: ArrayLike | None = None,
    normal: ArrayLike | None = None,
    previous_normal: ArrayLike | None = None,
    ids: ArrayLike | None = None,
    previous_ids: ArrayLike | None = None,
    object_normal: ArrayLike | None = None,
    previous_object_normal: ArrayLike | None = None,
    color: ArrayLike | None = None,
    previous_color: ArrayLike | None = None,
    previous_motion: ArrayLike | None = None,
    previous_camera: Camera | None = None,
    relative_depth: _Threshold = 0.1,
    plane_distance: _Threshold = 0.01,
    normal_angle: _Threshold = 25.0,
    relative_luminance: _Threshold = 0.5,
    speed: _Threshold | None = None,
    motion_difference: _Threshold = 0.2,
    out: tuple[_Floats | None, _Floats | None] | None = None,
) -> tuple[_Floats, _Floats]:
    """Reprojection: fetches history along motion vectors, each tap validated.

    Parameters
    ----------
    history : (H, W) or (H, W, C) array_like of float, or list of such
        The previous frame's image, or several, which are faster in one call than in several.
    motion : (H, W, 2) or (H, W, 3) array_like of float
        Previous minus current position in pixels, x right, y down; the third channel, if given, previous minus current
        depth. Where it is not finite there is no history.
    filter : {"bilinear", "nearest", "catmull-rom", "catmull-rom-5", "lanczos-2"}, default "bilinear"
        Interpolation between pixel centres. The last three stay sharp under repeated resampling: the cubic with 16
        taps, the cubic without its corner taps (as GPUs compute it from five bilinear fetches), and sinc(x) sinc(x/2).
        They apply where all their taps are valid; elsewhere bilinear does.
    fallback : bool, default True
        Take the mean of the valid pixels of a 3×3 window where less than 0.01 of the footprint is valid.
    dering : bool, default True
        Clamp the wide filters to the range of the nearest 2×2 taps.
    depth, previous_depth : (H, W) array_like of float, optional
        View-space z; +inf or not above 0 is background. Each pair of buffers is given together or not at all.
    normal, previous_normal : (H, W, 3) array_like of float, optional
        World space; only directions count. Zeros, as where nothing was hit, have none, and pass.
    ids, previous_ids : (H, W) array_like of int, optional
        Taps with another id fail.
    object_normal, previous_object_normal : (H, W, 3) array_like of float, optional
        In object space, where they do not rotate with the object. Their directions are compared instead of those of
        `normal`.
    color, previous_color : (H, W, 3) array_like of float, optional
        Compared by luminance. Missing samples pass.
    previous_motion : (H, W, 2) or (H, W, 3) array_like of float, optional
        The previous frame's own motion. Tells what is uncovered from what covered it where no other buffer does. Where
        it is not finite, it is unknown, and all pass.
    previous_camera : Camera, optional
        Turns the depth test from relative depth to plane distance; needs depths, normals and motion of 3 channels.
    relative_depth : float or (float, float), default 0.1
        Largest ``|previous - expected| / expected`` depth; above 0. Of this and all thresholds below, a pair is a ramp:
        full trust up to the first, none beyond the second, linear between.
    plane_distance : float or (float, float), default 0.01
        Largest distance of the expected point from the tap's plane, relative to the expected depth; above 0.
    normal_angle : float or (float, float), default 25.0
        Largest angle between normals in degrees, 0 to 180. The ramp is linear in the cosine.
    relative_luminance : float or (float, float), default 0.5
        Largest ``|l - l'| / max(|l|, |l'|)`` of the luminances; from 0.
    speed : float or (float, float), optional
        Longest motion in pixels; from 0. By default any.
    motion_difference : float or (float, float), default 0.2
        Largest difference of the pixel's motion from the tap's in the previous frame, in pixels, above twice the least
        such difference among all pixels whose 2×2 footprints have the tap; from 0, +inf for any.
    out : tuple of values, as `history` has them, and of (H, W) float32 coverage, optional
        Written and returned instead of new arrays; they may be inputs. A part may be None.

    Returns
    -------
    values : float32 array like `history`, or list of such
        The weighted mean of the valid taps; 0 where less than 0.01 of the footprint is valid and no fallback applies.
    coverage : (H, W) float32
        The valid fraction of the footprint, 0 to 1: the 2×2 weights times their trust, summed, or, where the fallback
        applied, the fraction of the 3×3 window's pixels. 0 where there is no history, or less than 0.01 of it.

    Raises
    ------
    ValueError
        On wrong shapes, an unknown filter, a buffer without its partner, or a threshold out of range.

    See Also
    --------
    consistency : Tests history without fetching it.
    motion_vectors : Motion from cameras.
    accumulate : Merges new samples into the result.

    Notes
    -----
    A tap is valid when it lies inside the image, is finite in every channel of every history image, and passes the
    tests that `consistency` describes; its weight is multiplied by their trust. The scheme is that of SVGF ([1]_,
    section 4.1), with every tap tested on its own. "catmull-rom" is the cubic with a = -½ [2]_, "catmull-rom-5" drops
    its corner taps [3]_. Without motion, the values are those of `history`, bit for bit, except that −0 becomes 0.

    References
    ----------
    .. [1] C. Schied, A. Kaplanyan, C. Wyman, A. Patney, C. R. A. Chaitanya, J. Burgess, S. Liu, C. Dachsbacher, A.
       Lefohn, M. Salvi, "Spatiotemporal variance-guided filtering: real-time reconstruction for path-traced global
       illumination", High-Performance Graphics, 2017.
    .. [2] R. G. Keys, "Cubic convolution interpolation for digital image processing", IEEE Transactions on Acoustics,
       Speech, and Signal Processing 29(6), 1981.
    .. [3] J. Jimenez, "Filmic SMAA: sharp morphological and temporal antialiasing", Advances in Real-Time Rendering in
       Games, SIGGRAPH courses, 2016.

    Examples
    --------
    >>> history = np.array([[0.0, 1.0, 2.0, 3.0]])
    >>> motion = np.zeros((1, 4, 2))
    >>> motion[..., 0] = 0.5
    >>> values, coverage = yester.reproject(history, motion)
    >>> values
    array([[0.5, 1.5, 2.5, 3. ]], dtype=float32)
    >>> coverage
    array([[1. , 1. , 1. , 0.5]], dtype=float32)
    """

def consistency(
    motion: ArrayLike,
    *,
    depth: ArrayLike | None = None,
    previous_depth: ArrayLike | None = None,
    normal: ArrayLike | None = None,
    previous_normal: ArrayLike | None = None,
    ids: ArrayLike | None = None,
    previous_ids: ArrayLike | None = None,
    object_normal: ArrayLike | None = None,
    previous_object_normal: ArrayLike | None = None,
    color: ArrayLike | None = None,
    previous_color: ArrayLike | None = None,
    previous_motion: ArrayLike | None = None,
    previous_camera: Camera | None = None,
    relative_depth: _Threshold = 0.1,
    plane_distance: _Threshold = 0.01,
    normal_angle: _Threshold = 25.0,
    relative_luminance: _Threshold = 0.5,
    speed: _Threshold | None = None,
    motion_difference: _Threshold = 0.2,
    out: tuple[NDArray[np.uint8] | None, _Floats | None] | None = None,
) -> tuple[NDArray[np.uint8], _Floats]:
    """History validation: the tests that each pixel's history fails, and the confidence in it.

    Tests the bilinear footprint in the previous frame at the end of each pixel's motion.

    Parameters
    ----------
    motion : (H, W, 2) or (H, W, 3) array_like of float
        Previous minus current position in pixels; the third channel, if given, previous minus current depth.
    depth, previous_depth : (H, W) array_like of float, optional
        View-space z; +inf or not above 0 is background. Each pair of buffers is given together or not at all.
    normal, previous_normal : (H, W, 3) array_like of float, optional
        World space; only directions count. Zeros, as where nothing was hit, have none, and pass.
    ids, previous_ids : (H, W) array_like of int, optional
        Taps with another id fail.
    object_normal, previous_object_normal : (H, W, 3) array_like of float, optional
        In object space, where they do not rotate with the object. Their directions are compared instead of those of
        `normal`.
    color, previous_color : (H, W, 3) array_like of float, optional
        Compared by luminance. Missing samples pass.
    previous_motion : (H, W, 2) or (H, W, 3) array_like of float, optional
        The previous frame's own motion. Tells what is uncovered from what covered it where no other buffer does. Where
        it is not finite, it is unknown, and all pass.
    previous_camera : Camera, optional
        Turns the depth test from relative depth to plane distance; needs depths, normals and motion of 3 channels.
    relative_depth : float or (float, float), default 0.1
        Largest ``|previous - expected| / expected`` depth; above 0. Of this and all thresholds below, a pair is a ramp:
        full trust up to the first, none beyond the second, linear between.
    plane_distance : float or (float, float), default 0.01
        Largest distance of the expected point from the tap's plane, relative to the expected depth; above 0.
    normal_angle : float or (float, float), default 25.0
        Largest angle between normals in degrees, 0 to 180. The ramp is linear in the cosine.
    relative_luminance : float or (float, float), default 0.5
        Largest ``|l - l'| / max(|l|, |l'|)`` of the luminances; from 0.
    speed : float or (float, float), optional
        Longest motion in pixels; from 0. By default any.
    motion_difference : float or (float, float), default 0.2
        Largest difference of the pixel's motion from the tap's in the previous frame, in pixels, above twice the least
        such difference among all pixels whose 2×2 footprints have the tap; from 0, +inf for any.
    out : tuple of (H, W) uint8 and (H, W) float32 arrays, optional
        Written and returned instead of new arrays. A part may be None.

    Returns
    -------
    rejection : (H, W) uint8
        Bits of `Rejection`: every test that some tap of the footprint fails entirely.
    confidence : (H, W) float32
        The taps' weights times their trust, summed: with hard thresholds, the fraction of the footprint that passes all
        tests. 0 to 1.

    Raises
    ------
    ValueError
        On wrong shapes, a buffer without its partner, or a threshold out of range.

    See Also
    --------
    reproject : Fetches history, with these tests.
    blend_factor : Turns confidence into a blend factor.
    Rejection : The tests.

    Notes
    -----
    Expected depth is depth plus the motion's third channel, or depth itself. Background, of depth +inf or not above 0,
    matches background only, and NaN nothing. The plane test is that of NRD's ReLAX and ReBLUR [1]_; the relative test
    at a tenth and the angle of 25° are customary values.

    With `previous_motion`, of the pixels that come from one place those are taken to have been there whose motion has
    changed least, so that a change of speed of the whole image, such as by a camera in the hand, rejects nothing. The
    claim c of a tap is the least ``|m - m'|`` of all pixels whose footprint has it, 0 if there is none, with m' its own
    motion in the previous frame; ``|m - m'| - 2c`` is compared. In leaves thinner than a pixel, motion says nothing:
    leave it out.

    References
    ----------
    .. [1] NVIDIA, "NVIDIA Real-Time Denoisers" (ReBLUR, ReLAX), github.com/NVIDIA-RTX/NRD; D. Zhdan, "ReBLUR: a
       hierarchical recurrent denoiser", Ray Tracing Gems II, 2021.

    Examples
    --------
    >>> depth = np.array([[1.0, 1.0, 5.0]])
    >>> previous_depth = np.array([[1.0, 5.0, 5.0]])
    >>> rejection, confidence = yester.consistency(
    ...     np.zeros((1, 3, 2)), depth=depth, previous_depth=previous_depth
    ... )
    >>> rejection
    array([[0, 2, 0]], dtype=uint8)
    >>> yester.Rejection(int(rejection[0, 1]))
    <Rejection.DEPTH: 2>
    >>> confidence
    array([[1., 0., 1.]], dtype=float32)
    """

def clip_history(
    history: ArrayLike,
    color: ArrayLike,
    *,
    box: _Box = "variance",
    gamma: float = 1.0,
    window: Literal["3x3", "5x5"] = "3x3",
    space: _Space = "ycocg",
    response: _Response = "center",
    exposure: float = 1.0,
    alpha: float | ArrayLike | None = None,
    out: _Floats | None = None,
) -> _Floats:
    """Clip history to the range of the current frame's colours around each pixel.

    Parameters
    ----------
    history : (H, W, 3) array_like of float
        Reprojected colour, linear. Missing pixels stay as they are.
    color : (H, W, 3) array_like of float
        The current frame. Missing pixels do not count; history stays where the neighbourhood has no valid pixel.
    box : {"variance", "minmax", "rounded", "intersection", "hull", "exact-hull", "chroma-hull"}, default "variance"
        The bounds of the neighbourhood's colours: mean ± `gamma` standard deviations; range; mean of the ranges of the
        square and of the cross in it; intersection of range and variance box; convex hull, as a polytope of 13 slabs (a
        26-DOP, which contains the exact hull); exact convex hull, which is slower, much slower for 5×5; exact convex
        hull of the chrominances, with the range of Y. The hulls need `response` "current", the last also a `space` with
        chrominances.
    gamma : float, default 1.0
        Half the side of the variance box in standard deviations; from 0.
    window : {"3x3", "5x5"}, default "3x3"
        The neighbourhood.
    space : {"ycocg", "rgb", "tonemapped-ycocg", "tonemapped-rgb"}, default "ycocg"
        The colour space of the box. The last two apply c / (exposure + max(r, g, b)) first, so that a single bright
        pixel does not open the box to everything; a clipped colour is limited to the brightest of history and
        neighbourhood.
    response : {"center", "clamp", "current", "ellipsoid"}, default "center"
        How a colour outside is moved into the box: towards the box's centre; each channel clamped; towards the current
        colour, itself clamped into the box; or onto the ellipsoid with half-axes gamma · deviation · (1.7, 1, 1) in
        YCoCg, (1, 1, 1) in RGB, which needs `box` "variance".
    exposure : float, default 1.0
        The radiance that tone-mapped spaces map to 1/2, above 0, as `exposure` returns it.
    alpha : float or (H, W) array_like of float, optional
        Weight of the new sample, as in `blend`: also blends the clipped history with `color`, which saves a pass over
        memory. By default, no blend.
    out : (H, W, 3) float32 array, optional
        Written and returned instead of a new array; it may be an input.

    Returns
    -------
    history : (H, W, 3) float32
        A colour inside its box keeps its bits. With `alpha`, the bits of ``blend(color, clip_history(...), alpha)``.

    Raises
    ------
    ValueError
        On wrong shapes, an unknown mode (the error lists the modes), `gamma`, `exposure` or `alpha` out of range.

    See Also
    --------
    blend : Blends the result with the new samples.
    anti_lag : Shortens history where clipping moved its colour.
    TAA : The pipeline that clips every frame's history.

    Notes
    -----
    The range is due to Lottes [1]_, the rounded range in YCoCg to Karis [2]_, the variance box to Salvi [3]_, the clip
    towards the centre to INSIDE [4]_, the ellipsoid to AMD's FSR 3.1 [5]_, the tone curve to Lottes [6]_.

    References
    ----------
    .. [1] T. Lottes, "TSSAA: temporal super-sampling AA", the author's weblog, 2011.
    .. [2] B. Karis, "High quality temporal supersampling", Advances in Real-Time Rendering in Games, SIGGRAPH courses,
       2014.
    .. [3] M. Salvi, "An excursion in temporal supersampling", Game Developers Conference, 2016.
    .. [4] L. J. F. Pedersen (Playdead), "Temporal reprojection anti-aliasing in INSIDE", Game Developers Conference,
       2016.
    .. [5] AMD, "FidelityFX Super Resolution 3.1", GPUOpen, 2024.
    .. [6] T. Lottes, "Optimized reversible tonemapper for resolve", AMD GPUOpen, 2016.

    Examples
    --------
    >>> color = np.full((3, 3, 3), 0.5)
    >>> color[1, 1] = 0.8
    >>> history = np.full((3, 3, 3), 2.0)
    >>> yester.clip_history(history, color, box="minmax")[1, 1]
    array([0.8, 0.8, 0.8], dtype=float32)
    """

def exposure(color: ArrayLike) -> float:
    """Measure the scale of a frame's radiance, for tone curves.

    Parameters
    ----------
    color : (H, W, 3) array_like of float
        Linear. Missing pixels do not count.

    Returns
    -------
    exposure : float
        ``8 (mean √l)²`` of the luminances l, negative ones as 0: proportional to the frame's radiance, determined by
        all of its pixels rather than by a few bright ones, and near 1 for images exposed like photographs. A row's
        mean counts for at most 4096 times the one that exceeds nine tenths of them: so single pixels of 1e20 and more,
        which are broken, do not decide. 1 for a frame that is black or has no valid pixel, and where the result exceeds
        float32.

    Raises
    ------
    ValueError
        On wrong shapes.

    See Also
    --------
    clip_history : Takes the exposure for tone-mapped colour spaces.
    innovation : Takes the exposure as the scale of differences.

    Notes
    -----
    A power mean instead of the log-average of photographic tone reproduction [1]_, which is 0 as soon as a pixel is
    black.

    References
    ----------
    .. [1] E. Reinhard, M. Stark, P. Shirley, J. Ferwerda, "Photographic tone reproduction for digital images", ACM
       Transactions on Graphics 21(3), 2002.

    Examples
    --------
    >>> round(yester.exposure(np.full((2, 2, 3), 0.18)), 3)
    1.44
    >>> yester.exposure(np.zeros((2, 2, 3)))
    1.0
    """

def material_change(
    albedo: ArrayLike,
    previous_albedo: ArrayLike,
    motion: ArrayLike,
    *,
    relative_luminance: float = 0.2,
    share: float = 0.6,
    radius: int = 7,
    out: NDArray[np.bool_] | None = None,
) -> NDArray[np.bool_]:
    """Find where the texture or material of surfaces is another than in the frame before, by their albedo.

    Parameters
    ----------
    albedo : (H, W, 3) array_like of float
        Of the current frame.
    previous_albedo : (H, W, 3) array_like of float
        Of the frame before.
    motion : (H, W, 2) or (H, W, 3) array_like of float
        As `motion_vectors` returns it; the third channel only tells that it is known.
    relative_luminance : float, default 0.2
        Luminances differ by more than this share of the larger one; from 0.
    share : float, default 0.6
        More than this share of the pixels around must differ, 0 to 1.
    radius : int, default 7
        Of the square of pixels around, as far as it lies inside the image, 0 to 16: 7 for 15x15.
    out : (H, W) bool array, optional
        Written and returned instead of a new array.

    Returns
    -------
    mask : (H, W) bool
        True where a pixel differs, and enough of those around it do. A pixel differs if those of its 2x2 footprint in
        the frame before whose luminance does not differ weigh less than 0.01. What was outside the image or is missing
        does not differ.

    Raises
    ------
    ValueError
        On wrong shapes, or if a parameter is out of range.
    TypeError
        If `out` has another dtype.

    See Also
    --------
    reproject : Tests single pixels with ``color=albedo``.
    TAA : Shortens history there, behind a denoiser.

    Notes
    -----
    Own method. Light that is divided by albedo does not change with the texture, so that `SVGF` and `BMFR` keep its
    history. Colour does, and what antialiases it, `TAA("denoised")`, then shows a ghost of the old texture: with noise,
    the colours around a pixel do not tell. Single pixels differ wherever fine texture is sampled elsewhere than in the
    frame before, and there history is what antialiases it: without `share`, two of 33 sequences lose 0.2 dB.

    Examples
    --------
    >>> before = np.full((8, 24, 3), 0.8)
    >>> albedo = before.copy()
    >>> albedo[:, 12:] = 0.2
    >>> mask = yester.material_change(albedo, before, np.zeros((8, 24, 2)), radius=2)
    >>> mask[4, 10:16]
    array([False, False, False,  True,  True,  True])
    """

def light_change(color: ArrayLike, history: ArrayLike, coverage: ArrayLike | None = None) -> float:
    """Find the factor by which all light has changed since the history, if it is one factor.

    That of an exposure, of a fade, or of a lamp that lights everything. History times the factor is not outdated.

    Parameters
    ----------
    color, history : (H, W, 3) array_like of float
        New samples, and reprojected history; illumination (see `demodulate`) if there is albedo. Missing pixels do not
        count.
    coverage : (H, W) array_like of float, optional
        Of the history, as `reproject` returns it: only pixels with more than 0.9 count. By default, all do.

    Returns
    -------
    change : float
        From 10⁻⁶ to 10⁶; 1 where blocks of the image disagree, or too little is known.

    Raises
    ------
    ValueError
        On wrong shapes.

    See Also
    --------
    innovation : Finds changes that differ from place to place.
    exposure : The scale of one frame's radiance.

    Notes
    -----
    The image is divided into 64 blocks, 8 across and 8 down. Of each that knows a sixteenth of its pixels,
    ``r = ln Σ l(color) - ln Σ l(history)``, with l the luminance. If at least 16 do, with m the median of r and d the
    third quartile of ``|r - m|``, the change is ``exp(m)`` where ``|m| > 1.25 d``, ``d < 0.15`` and ``|m| < ln 10⁶``,
    else 1. Of H rows, every ⌊H/128⌋th is looked at, or the next odd number.

    Examples
    --------
    >>> history = np.random.default_rng(0).uniform(size=(64, 64, 3))
    >>> round(yester.light_change(0.8 * history, history), 3)
    0.8
    >>> history[:, 32:] *= 2
    >>> yester.light_change(np.ones((64, 64, 3)), history)
    1.0
    """

def blend_factor(
    confidence: ArrayLike,
    motion: ArrayLike | None = None,
    *,
    alpha: float = 0.05,
    fast_alpha: float = 0.2,
    speed: _Threshold = (0.0, 1.0),
    out: _Floats | None = None,
) -> _Floats:
    """Compute the blend factor of the new sample from the confidence in history and from speed.

    Parameters
    ----------
    confidence : (H, W) array_like of float
        0 to 1, as `consistency` or the coverage of `reproject` gives it; clamped, NaN counts as 0.
    motion : (H, W, 2) or (H, W, 3) array_like of float, optional
        In pixels. Where it is not finite, the blend factor is 1.
    alpha : float, default 0.05
        Blend factor for full confidence and slow motion, 0 to 1.
    fast_alpha : float, default 0.2
        Blend factor for full confidence and fast motion, 0 to 1; no effect if below `alpha`.
    speed : float or (float, float), default (0, 1)
        Pixels up to which motion is slow, and from which it is fast.
    out : (H, W) float32 array, optional
        Written and returned instead of a new array; it may be an input.

    Returns
    -------
    alpha : (H, W) float32
        ``lerp(a, 1, 1 - confidence)`` with ``a = lerp(alpha, max(alpha, fast_alpha), clamp((|motion| - s0)/(s1 -
        s0)))``.

    Raises
    ------
    ValueError
        On wrong shapes or parameters out of range.

    See Also
    --------
    blend : Takes the result.
    consistency : Confidence in history.

    Notes
    -----
    History gives way where confidence in it is low, and where motion is fast: there, resampling has blurred it, and its
    ghosts would be long.

    Examples
    --------
    >>> yester.blend_factor([[1.0, 0.5, 0.0]])
    array([[0.05 , 0.525, 1.   ]], dtype=float32)
    >>> yester.blend_factor([[1.0, 1.0]], [[[0.5, 0.0], [3.0, 0.0]]])
    array([[0.125, 0.2  ]], dtype=float32)
    """

def alternation(
    color: ArrayLike, memory: ArrayLike | None = None, *, exposure: float = 1.0, out: _Floats | None = None
) -> _Floats:
    """Detect neighbourhoods whose colours alternate from frame to frame.

    Where an aliased feature is wider than the neighbourhood, clipping follows every frame, and the image flickers. The
    return of earlier colours distinguishes this from a change of light.

    Parameters
    ----------
    color : (H, W, 3) array_like of float
        The new frame, linear. Missing pixels do not count.
    memory : (H, W, 7) array_like of float, optional
        The previous frame's result, reprojected; NaN where there is no history. By default there is none.
    exposure : float, default 1.0
        The radiance that the tone curve maps to 1/2, above 0, as `exposure` returns it.
    out : (H, W, 7) float32 array, optional
        Written and returned instead of a new array.

    Returns
    -------
    memory : (H, W, 7) float32
        In tone-mapped YCoCg the mean of the 3×3 pixels and their mean before its last jump; then a count of returns, 0
        to 3. ``np.clip(memory[..., 6] - 1, 0, 1)`` is the weight of unclipped history. NaN where no pixel was ever
        valid.

    Raises
    ------
    ValueError
        On wrong shapes or an exposure out of range.

    See Also
    --------
    clip_history : Makes such neighbourhoods flicker.
    thin_features : Detects features narrower than the neighbourhood.

    Notes
    -----
    A mean jumps if it moves by more than the range of its pixels in some channel, and by more than a fifth of the
    larger one's largest channel. A jump is a return if the new mean is less than half as far from the mean before the
    last jump as from the last mean: it increments the count; other jumps reset it. Without a jump, the count and the
    earlier mean decay by an eighth per frame, so that at most five frames may lie between a colour and its return.
    AMD's FSR 2.2 [1]_ detects returning luminances of single pixels among the last four frames.

    References
    ----------
    .. [1] AMD, "FidelityFX Super Resolution 2", GPUOpen, 2022.

    Examples
    --------
    >>> memory = None
    >>> for light in (0.1, 1.0, 0.1, 1.0, 0.1):
    ...     memory = yester.alternation(np.full((3, 3, 3), light), memory)
    >>> memory[..., 6]
    array([[3., 3., 3.],
           [3., 3., 3.],
           [3., 3., 3.]], dtype=float32)
    """

def anti_lag(
    history_length: ArrayLike,
    history: ArrayLike,
    clipped: ArrayLike,
    *,
    strength: float = 1.0,
    out: _Floats | None = None,
) -> _Floats:
    """Shorten histories in proportion to the distance that clipping moved them.

    Parameters
    ----------
    history_length : (H, W) array_like of float
        History length in samples.
    history, clipped : (H, W, 3) array_like of float
        Colour before and after `clip_history`.
    strength : float, default 1.0
        At least 0; 0 leaves lengths unchanged.
    out : (H, W) float32 array, optional
        Written and returned instead of a new array; it may be an input.

    Returns
    -------
    history_length : (H, W) float32
        ``N / (1 + strength d N)`` with ``d = |l - l'| / max(|l|, |l'|)`` of the luminances; d is 0 where both are black
        or one is missing.

    Raises
    ------
    ValueError
        On wrong shapes or a strength out of range.

    See Also
    --------
    clip_history : Clips the history.
    temporal_gradient : Detects changes of light before clipping.

    Notes
    -----
    To be used with a fast history: ``clip_history(slow, fast, window="5x5")`` clips the slow average to the range of
    the last few frames, and where that moved it, the shortened length gives new samples more weight. After NRD's ReBLUR
    and ReLAX [1]_, in a similar form. `TAA` applies it to its own clipping if `anti_lag` is above 0.

    References
    ----------
    .. [1] NVIDIA, "NVIDIA Real-Time Denoisers" (ReBLUR, ReLAX), github.com/NVIDIA-RTX/NRD; D. Zhdan, "ReBLUR: a
       hierarchical recurrent denoiser", Ray Tracing Gems II, 2021.

    Examples
    --------
    >>> length = np.array([[20.0, 20.0]])
    >>> history = np.ones((1, 2, 3))
    >>> clipped = history * [[[1.0], [0.5]]]
    >>> yester.anti_lag(length, history, clipped)
    array([[20.    ,  1.8182]], dtype=float32)
    """

def temporal_gradient(
    color: ArrayLike,
    previous: ArrayLike,
    *,
    noise: float = 2.0,
    passes: int = 3,
    widest: int = 3,
    out: _Floats | None = None,
) -> _Floats:
    """Measure the relative change of light, beyond the change that noise explains.

    Parameters
    ----------
    color, previous : (H, W, 3) array_like of float
        Two images of the same pixels. For the exact gradient the previous frame and its `Frame.replay`, a re-render
        with the same random numbers, and ``noise=0``; for an estimate the new frame and the reprojected history.
        Illumination (see `demodulate`) if there is albedo. Missing pixels do not count.
    noise : float, default 2.0
        Standard errors of the local mean that are attributed to noise; at least 0.
    passes : int, default 3
        Passes of the smallest blur, 1 to 8; its radius is about 2^passes - 1 pixels.
    widest : int, default 3
        Passes of the widest blur, `passes` to 8. Small blurs locate a change of light, wide ones detect changes that
        are small but extended; the largest gradient counts. `SVGF` estimates with 5, and ``noise=2.4``.
    out : (H, W) float32 array, optional
        Written and returned instead of a new array; it may be an input.

    Returns
    -------
    gradient : (H, W) float32
        0 (no change, or nothing known) to 1 (all of the light has appeared or vanished). Missing pixels have the
        gradient of the 2×2 pixels around them.

    Raises
    ------
    ValueError
        On wrong shapes or parameters out of range.

    See Also
    --------
    accumulate : Takes the result, to shorten history.
    innovation : Corrects what has changed.

    Notes
    -----
    With the difference of luminances δ and the larger of them m, blurred means ⟨·⟩, and the standard error s of ⟨δ⟩:
    ``clamp((|⟨δ⟩| - noise s) / ⟨m⟩, 0, 1)`` with ``s² = (⟨δ²⟩ - ⟨δ⟩²) K / w``, w the blurred number of a cell's pixels
    that count, up to 4, and K the sum of squares of all blurs' kernels convolved, 1 without a blur. The first pass
    averages cells of 2×2 pixels, whose pixels all get their gradient; the others blur cells by {1, 2, 1}/4 kernels at
    steps of 1, 2, 4, … cells. The original (Schied et al. [1]_) has cells of 3×3, exact gradients, and no margin for
    noise.

    References
    ----------
    .. [1] C. Schied, C. Peters, C. Dachsbacher, "Gradient estimation for real-time adaptive temporal filtering",
       Proceedings of the ACM on Computer Graphics and Interactive Techniques 1(2), 2018.

    Examples
    --------
    >>> previous = np.ones((4, 4, 3))
    >>> yester.temporal_gradient(previous / 2, previous, noise=0)[0]
    array([0.5, 0.5, 0.5, 0.5], dtype=float32)
    """

def innovation(
    color: ArrayLike,
    prediction: ArrayLike,
    history_length: ArrayLike,
    evidence: ArrayLike | None = None,
    motion: ArrayLike | None = None,
    *,
    exposure: float = 1.0,
    strictness: float = 3.0,
    share: float = 0.5,
    levels: int = 6,
    fed_back: bool = True,
    sparse: bool = False,
    target: ArrayLike | None = None,
    out: tuple[_Floats | None, _Floats | None] | None = None,
) -> tuple[_Floats, _Floats]:
    """Estimate the error of a prediction from new samples.

    New samples are noisy but unbiased; a denoised image is steady, but lags and blurs. Where the mean of their
    difference is larger than noise explains, it is returned, to be added to the image and to its history.

    Parameters
    ----------
    color : (H, W, 3) array_like of float
        New samples; illumination (see `demodulate`) if there is albedo. Missing pixels do not count.
    prediction : (H, W, 3) array_like of float
        The image that samples are compared with.
    history_length : (H, W) array_like of float
        Samples in each pixel's prediction. A short prediction is correlated with the newest sample, which is part of
        it.
    evidence : (ceil(H / 2), ceil(W / 2), 4) array_like of float, optional
        The previous frame's result; none for the first frame.
    motion : (H, W, 2) or (H, W, 3) array_like of float, optional
        Motion in pixels along which `evidence` is fetched. By default none.
    exposure : float, default 1.0
        Exposure of the image, as `exposure` returns it; above 0. Differences are relative to the light plus a sixteenth
        of it.
    strictness : float, default 3.0
        Ratio of a squared mean to its variance up to which the mean counts as noise; at least 0.
    share : float, default 0.5
        Weight of the new frame in the evidence, above 0, up to 1, which discards earlier evidence.
    levels : int, default 6
        Block sizes, 1 to 8: 2 pixels, 4, 8, ….
    fed_back : bool, default True
        The history of the next prediction is corrected as well. If not, the next samples show the same difference
        again, and the evidence keeps the corrected part.
    sparse : bool, default False
        `color` has samples in few pixels, and the prediction is made of few. Differences are then relative to the local
        mean of the light, as the prediction itself is noisy; and a block without samples keeps its evidence until it
        gets one.
    target : (H, W, 3) array_like of float, optional
        The image that is corrected, whose light scales the correction; by default the prediction. Another one may be
        sharper than what samples are compared with.
    out : tuple of (H, W, 3) and (ceil(H / 2), ceil(W / 2), 4) float32 arrays, optional
        Written and returned instead of new arrays. A part may be None.

    Returns
    -------
    correction : (H, W, 3) float32
        To be added to the prediction, or to `target`; 0 where no error was found.
    evidence : (ceil(H / 2), ceil(W / 2), 4) float32
        For the next frame: the relative difference that is not fed back, and its variance. The variance is NaN in
        blocks without samples and evidence, which are left out of all means.

    Raises
    ------
    ValueError
        On wrong shapes or parameters out of range.

    See Also
    --------
    temporal_gradient : Detects changes of light, to shorten history.
    exposure : Exposure of the image.

    Notes
    -----
    r = (color - prediction) / (l + exposure / 16) is clamped to ±50; E is its mean over blocks of 2×2 pixels and over
    frames; l is max(prediction, 0), or with `sparse` its mean over blocks of 4×4 pixels, interpolated between their
    centres. From the coarsest level to the finest, b is the mean of the rest of E over 3×3 blocks, weighted {1, 2, 1}
    along both axes; it is multiplied by ``max(0, 1 - strictness v / |b|²)``, with v its variance, estimated from the
    squares of r, and one factor for the three channels: the shrinkage of James and Stein [1]_, scale by scale as Donoho
    and Johnstone do [2]_. The difference of sample and prediction is the innovation of the Kalman filter [3]_. A single
    bright sample has ``|b|² = v`` and never changes the image.

    References
    ----------
    .. [1] W. James, C. Stein, "Estimation with quadratic loss", Proceedings of the Fourth Berkeley Symposium on
       Mathematical Statistics and Probability 1, 1961.
    .. [2] D. L. Donoho, I. M. Johnstone, "Ideal spatial adaptation by wavelet shrinkage", Biometrika 81(3), 1994.
    .. [3] R. E. Kalman, "A new approach to linear filtering and prediction problems", Journal of Basic Engineering
       82(1), 1960.

    Examples
    --------
    >>> prediction = np.ones((16, 16, 3))
    >>> length = np.full((16, 16), 20.0)
    >>> correction, evidence = yester.innovation(prediction * 1.5, prediction, length)
    >>> correction[8, 8].round(3)
    array([0.494, 0.494, 0.494], dtype=float32)
    """

def choice(
    evidence: ArrayLike,
    motion: ArrayLike,
    coverage: ArrayLike,
    *,
    usual: int = 0,
    strictness: float = 0.5,
    frame_strictness: float = 3.0,
    share: float = 0.3,
    out: tuple[_Floats | None, _Floats | None] | None = None,
) -> tuple[_Floats, _Floats]:
    """Choose the best of several predictions, tile by tile, by the evidence of earlier frames.

    Parameters
    ----------
    evidence : (⌈H/8⌉, ⌈W/8⌉, 2 K) array_like of float
        The previous frame's, as `compare_candidates` returns it.
    motion : (H, W, 2) or (H, W, 3) array_like of float
        Motion in pixels. A tile's evidence comes from where its centre does.
    coverage : (H, W) array_like of float
        Above 0 where the pixel's surface was visible in the previous frame (see `reproject`); tiles whose centre was
        not have no evidence.
    usual : int, default 0
        The default candidate, unless another is better for the frame as a whole. The default is chosen without
        evidence, and all others are compared with it.
    strictness : float, default 0.5
        Standard errors by which another candidate must be better than the default; at least 0.
    frame_strictness : float, default 3
        Standard errors by which another candidate must be better than `usual` for the frame as a whole to become the
        default; at least 0, infinite to keep `usual`.
    share : float, default 0.3
        Fraction of the evidence that decays per frame; 0 to 1.
    out : tuple of (⌈H/8⌉, ⌈W/8⌉) and (⌈H/8⌉, ⌈W/8⌉, 2 K) float32 arrays, optional
        Written and returned, as choice and evidence, instead of new arrays. A part may be None.

    Returns
    -------
    choice : (⌈H/8⌉, ⌈W/8⌉) float32
        The candidate that each tile of 8×8 pixels should show: an integer from 0 to K - 1. To hide the tiles,
        interpolate between their centres, and mix two candidates where the result is fractional.
    evidence : (⌈H/8⌉, ⌈W/8⌉, 2 K) float32
        The evidence where the tiles are in this frame, decayed: `compare_candidates` adds this frame's.

    Raises
    ------
    ValueError
        On wrong shapes, evidence of fewer than 2 candidates, or parameters out of range.

    See Also
    --------
    compare_candidates : Adds a frame's evidence.
    SVGF : Chooses the number of filter passes in this way.

    Notes
    -----
    A tile's sums are averaged with those of its neighbours, with weights {1, 2, 1}/4 along each axis. The candidate
    with the least mean gain plus `strictness` standard errors of the steps between it and the default one wins if that
    is below 0; with fewer than 16 samples in the average, the default candidate stays. The variance of an average is
    that of a tile, divided by 64/9, the effective number of tiles in it. What is best for the frame is the best
    guess for a tile that knows nothing: the mean gains of all pixels in tiles of at least 16 samples decide first, in
    the same way.

    Examples
    --------
    >>> sample = np.ones((8, 8, 3))
    >>> candidates = np.stack([np.full((8, 8), 0.5), np.full((8, 8), 1.0)], -1)
    >>> evidence = yester.compare_candidates(sample, candidates)
    >>> best, evidence = yester.choice(evidence, np.zeros((8, 8, 2)), np.ones((8, 8)))
    >>> best
    array([[1.]], dtype=float32)
    """

def collect_warnings(
    function: Callable[_Given, _Result], /, *args: _Given.args, **named: _Given.kwargs
) -> tuple[_Result, list[str]]:
    """Call a function, and return what pipelines of this thread would warn of, instead of warning.

    Filters of warnings belong to the whole process: a thread that changes them changes what others show.

    Parameters
    ----------
    function : callable
    *args, **named
        Its arguments.

    Returns
    -------
    result
        What the function returns.
    messages : list of str
        The texts of the warnings, in their order.
    """

def collocate(
    planes: ArrayLike,
    evidence: ArrayLike | None = None,
    *,
    exposure: float = 1.0,
    out: _Floats | None = None,
) -> _Floats:
    """Compare three frames' samples and two results, tile by tile, to tell noise from detail.

    Parameters
    ----------
    planes : (H, W, 5) array_like of float
        Luminances, all where the pixels are in this frame: of its samples; of those of the frame before; of those of
        two frames before, which were first brought to the frame before; of two results of the frame before. A pixel
        counts if all are finite in its 3×3 pixels, so that the image's border does not.
    evidence : (⌈H/8⌉, ⌈W/8⌉, 14) array_like of float, optional
        That of earlier frames, as `collocation_shares` returns it.
    exposure : float, default 1.0
        `exposure` of the image; above 0. Detail below 1/1024 of it is black.
    out : (⌈H/8⌉, ⌈W/8⌉, 14) float32 array, optional
        Written and returned instead of a new array; it may be the evidence.

    Returns
    -------
    evidence : (⌈H/8⌉, ⌈W/8⌉, 14) float32
        With this frame's added: weighted sums of products of detail, and the number of pixels.

    Raises
    ------
    ValueError
        On wrong shapes or an exposure out of range.

    See Also
    --------
    collocation_shares : Tells by the evidence how samples and results are best mixed.

    Notes
    -----
    The detail of a plane is its difference from the mean of the 3×3 pixels. With the planes numbered from 0, the
    products are those of 00, 01, 02, 11, 12, 22, 03, 13, 33, 04, 14, 44 and 34. A frame's sums in a tile of n pixels
    have the weight ``1 / (max(Σ₀₀ + Σ₁₁, Σ₂₂/16, Σ₃₃/16, Σ₄₄/16) / n + (exposure / 1024)²)``, so that no frame decides
    alone; the tile adds nothing if a sum is infinite.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> image = rng.random((64, 64, 1))
    >>> noisy = image + 0.1 * rng.normal(size=(64, 64, 3))
    >>> evidence = yester.collocate(np.dstack([noisy, image, 0 * image]))
    >>> motion, coverage = np.zeros((64, 64, 2)), np.ones((64, 64))
    >>> shares, evidence = yester.collocation_shares(evidence, motion, coverage)
    >>> bool(shares[..., 0].mean() > 0.95), bool(shares[..., 1].mean() < 0.05)
    (True, True)
    """

def collocation_shares(
    evidence: ArrayLike,
    motion: ArrayLike,
    coverage: ArrayLike,
    *,
    share: float = 0.2,
    out: tuple[_Floats | None, _Floats | None] | None = None,
) -> tuple[_Floats, _Floats]:
    """Find how samples and two results are best mixed, tile by tile, by the evidence of earlier frames.

    Parameters
    ----------
    evidence : (⌈H/8⌉, ⌈W/8⌉, 14) array_like of float
        The previous frame's, as `collocate` returns it.
    motion : (H, W, 2) or (H, W, 3) array_like of float
        Motion in pixels. A tile's evidence comes from where its centre does.
    coverage : (H, W) array_like of float
        Above 0 where the pixel's surface was visible in the previous frame (see `reproject`); tiles whose centre was
        not have no evidence.
    share : float, default 0.2
        Fraction of the evidence that decays per frame; 0 to 1.
    out : tuple of (⌈H/8⌉, ⌈W/8⌉, 2) and (⌈H/8⌉, ⌈W/8⌉, 14) float32 arrays, optional
        Written and returned, as shares and evidence, instead of new arrays. A part may be None.

    Returns
    -------
    shares : (⌈H/8⌉, ⌈W/8⌉, 2) float32
        Shares λ and g, 0 to 1: with samples y and results a and b, ``m = b + λ (a - b)`` has the least error among
        mixtures of both results, and ``m + g (y - m)`` among those of it and the samples. To hide the tiles,
        interpolate between their centres.
    evidence : (⌈H/8⌉, ⌈W/8⌉, 14) float32
        The evidence where the tiles are in this frame, decayed: `collocate` adds this frame's.

    Raises
    ------
    ValueError
        On wrong shapes or a share out of range.

    See Also
    --------
    collocate : Adds a frame's evidence.
    choice : Chooses one of several predictions by how well they predict samples.
    TAA : Mixes samples, denoised colour and result in this way.

    Notes
    -----
    Samples y of a frame, p of the frame before and q of two frames before measure one signal, with independent noise.
    With ⟨a b⟩ the products, averaged over a tile and its neighbours with weights {1, 2, 1}/4 along each axis (those at
    the border are repeated beyond it),
    ``S = ⟨y p⟩ ⟨p q⟩ / ⟨y q⟩`` is the energy of the detail in p, whatever motion and resampling have lost: the triple
    collocation of [1]_. ⟨y q⟩ is at least 0.1 of √(⟨y y⟩ ⟨q q⟩), and S at most ⟨p p⟩. ``N = ⟨p p⟩ - S`` is the energy
    of p's noise, and with ``r = ⟨y p⟩ / S`` the samples y / r have the detail of p.

    The squared error of b less that of a is then ``E = ⟨b b⟩ - ⟨a a⟩ - 2 (⟨y b⟩ - ⟨y a⟩) / r``, and
    ``λ = 1/2 + E / 2⟨(a - b)²⟩``. The share of samples is Wiener's, ``g = 1 - (N - C) / ⟨(p - m)²⟩``, where
    ``C = ⟨p m⟩ - ⟨y m⟩ / r``, from 0 to N / 2, is the noise that m has of p. Both are limited to 0 and 1; with fewer
    than 16 pixels in the average, both are 0.

    References
    ----------
    .. [1] A. Stoffelen, "Toward the true near-surface wind speed: Error modeling and calibration using triple
       collocation", Journal of Geophysical Research 103(C4), 1998.

    Examples
    --------
    See `collocate`.
    """

def compare_candidates(
    color: ArrayLike,
    candidates: ArrayLike,
    evidence: ArrayLike | None = None,
    *,
    exposure: float = 1.0,
    usual: int = 0,
    out: _Floats | None = None,
) -> _Floats:
    """Compare predictions with new samples that none of them has seen, tile by tile.

    Parameters
    ----------
    color : (H, W, 3) array_like of float
        The new, noisy samples. Missing pixels do not count.
    candidates : (H, W, K) array_like of float
        K predictions of the samples' luminance, at least 2. They are a series, such as the predictions that more and
        more passes of `atrous` return. Pixels where one is not finite do not count.
    evidence : (⌈H/8⌉, ⌈W/8⌉, 2 K) array_like of float, optional
        That of earlier frames, as `choice` returns it.
    exposure : float, default 1.0
        `exposure` of the image; above 0. Errors of luminances well below a sixteenth of it count as absolute, of
        brighter ones as relative.
    usual : int, default 0
        The default candidate, relative to which errors are measured.
    out : (⌈H/8⌉, ⌈W/8⌉, 2 K) float32 array, optional
        Written and returned instead of a new array; it may be the evidence.

    Returns
    -------
    evidence : (⌈H/8⌉, ⌈W/8⌉, 2 K) float32
        With this frame's added: the weighted sums of the gains of the K - 1 steps, negative where a step reduces the
        error; then those of their squares; then the sum of the samples' weights, and their number.

    Raises
    ------
    ValueError
        On wrong shapes, fewer than 2 candidates, or parameters out of range.

    See Also
    --------
    choice : Chooses by the evidence.
    prediction_gain : Compares two histories pixel by pixel.
    atrous : Returns such predictions.

    Notes
    -----
    The gain of step k is ``(a - b)(a + b - 2r)``. Candidates a and b and the sample's luminance r are taken relative to
    the default candidate: with m its luminance, at least 0, each value v becomes ``(v - m) / (m + exposure / 16)``, and
    r is then clamped to ±8. Where no sample is clamped, this is an unbiased estimate of the difference of two squared
    errors (see `prediction_gain`).

    A frame's gains in a tile are weighted by ``1 / √(Σ d² / n + 1e-6)``, over their n samples and all steps, and the
    squares by its square, so that no frame decides alone.

    Examples
    --------
    >>> sample = np.ones((8, 8, 3))
    >>> candidates = np.stack([np.full((8, 8), 0.5), np.full((8, 8), 1.0)], -1)
    >>> gain, square, weight, count = yester.compare_candidates(sample, candidates)[0, 0]
    >>> bool(gain < 0), float(count)
    (True, 64.0)
    """

def combine_histories(
    color: ArrayLike,
    moments: ArrayLike,
    history_length: ArrayLike,
    other_color: ArrayLike,
    other_moments: ArrayLike,
    other_length: ArrayLike,
    *,
    gradient: ArrayLike | None = None,
    exposure: float | None = None,
    out: tuple[_Floats | None, _Floats | None, _Floats | None] | None = None,
) -> tuple[_Floats, _Floats, _Floats]:
    """Combine two independent histories of the same pixels, such as those of earlier and of later frames.

    Parameters
    ----------
    color : (H, W, 3) array_like of float
        Mean of the first history's samples.
    moments : (H, W, 2) array_like of float
        Means of luminance and of its square.
    history_length : (H, W) array_like of float
        Samples in each pixel.
    other_color, other_moments, other_length : array_like of float
        The same of the second history.
    gradient : (H, W) array_like of float, optional
        Relative change of light in the second history, 0 to 1; NaN counts as 0. It counts as fewer samples there.
    exposure : float, optional
        The scale of the light, above 0, as `exposure` returns it. If given, fireflies of one history that the other
        does not confirm are held down.
    out : tuple of (H, W, 3), (H, W, 2) and (H, W) float32 arrays, optional
        Written and returned instead of new arrays; they may be inputs. A part may be None.

    Returns
    -------
    color : (H, W, 3) float32
        Mean over the samples of both.
    moments : (H, W, 2) float32
        Means of luminance and of its square.
    history_length : (H, W) float32
        The sum of both. Where no history has samples, colour and moments are NaN and the length is 0.

    Raises
    ------
    ValueError
        On wrong shapes or an exposure out of range.

    See Also
    --------
    accumulate : Merges new samples into a history.
    denoise : Denoises from both sides.

    Notes
    -----
    Each is a mean over its samples, so the mean over all has the lengths for weights: ``c + N'/(N + N') (c' - c)``. A
    gradient g shortens the second history to ``N' (1 - g)**10``, as in `accumulate`.

    If one sample of N has nearly all light, ``m2`` is about ``N m1**2``. With an exposure, colour and moments of a
    history with ``m2 >= 0.7 max(N, 2.5) m1**2`` are therefore multiplied by
    ``min(1, 8 (max(l', 0) + exposure/16) / l)``, m2 by its square, l and l' the luminances of its colour and of the
    other one's, if that has 2.5 samples or more.

    Examples
    --------
    >>> color, moments = np.ones((1, 1, 3)), np.ones((1, 1, 2))
    >>> mean, _, length = yester.combine_histories(color, moments, [[3.0]], 5 * color, moments, [[1.0]])
    >>> mean, length
    (array([[[2., 2., 2.]]], dtype=float32), array([[4.]], dtype=float32))
    """

def converge(
    color: ArrayLike,
    mean: ArrayLike,
    moments: ArrayLike,
    history_length: ArrayLike,
    *,
    exposure: float = 1.0,
    strictness: float = 1.0,
    out: _Floats | None = None,
) -> _Floats:
    """Mix the mean of a still scene's samples into a denoised image, by how far each is from the noise-free image.

    Parameters
    ----------
    color : (H, W, 3) array_like of float
        A denoised image of the scene.
    mean : (H, W, 3) array_like of float
        Mean of all its samples, linear.
    moments : (H, W, 2) array_like of float
        Means of the samples' luminance and of its square.
    history_length : (H, W) array_like of float
        Number of samples. `accumulate` returns all three, with ``alpha=0, moments_alpha=0``.
    exposure : float, default 1.0
        The scale of the light, above 0, as `exposure` returns it: below a sixteenth of it, differences count as
        absolute instead of relative.
    strictness : float, default 1.0
        How much of the mean's variance counts; from 0. 1 if the image is independent of the mean's noise, less if it is
        made of the same samples: `SVGF` takes 0.7.
    out : (H, W, 3) float32 array, optional
        Written and returned instead of a new array; it may be an input.

    Returns
    -------
    color : (H, W, 3) float32
        The image itself where there are fewer than eight samples, or a value that is not finite; the more of the mean,
        the more samples there are.

    Raises
    ------
    ValueError
        On wrong shapes, an exposure or a strictness out of range.

    See Also
    --------
    accumulate : Averages samples.
    combine_histories : Merges two means.
    SVGF : Does so with ``average_still=True``, while nothing moves.

    Notes
    -----
    A denoised image O is wrong by what its filters blur, however many frames follow; the mean M of N samples by their
    noise, which ends. In units of the light ``l = max(luminance(O), 0) + exposure/16``, with ``r = (M - O)/l`` and the
    variance ``v = (m2 - m1*m1)/(N - 1) * (1 + 4/N)/l**2`` of M, tiles of 8×8 pixels have the share
    ``s = max(0, 1 - strictness mean(v)/mean(luminance(r)**2))``, interpolated bilinearly, and the result is
    ``O + s r l``: James and Stein's estimator [1]_ with O in the place of a fixed point.

    References
    ----------
    .. [1] W. James, C. Stein, "Estimation with quadratic loss", Proceedings of the Fourth Berkeley Symposium on
       Mathematical Statistics and Probability 1, 1961.

    Examples
    --------
    Sixteen samples of a pattern that a filter has blurred:

    >>> rng = np.random.default_rng(0)
    >>> truth = np.tile(np.float32([0.5, 1.5]), (8, 4))[..., None].repeat(3, -1)
    >>> samples = truth * rng.uniform(0.5, 1.5, (16, 8, 8, 1))
    >>> light = samples.mean(-1)
    >>> moments = np.stack([light.mean(0), (light**2).mean(0)], -1)
    >>> blurred = np.ones_like(truth)
    >>> found = yester.converge(blurred, samples.mean(0), moments, np.full((8, 8), 16.0))
    >>> bool(np.abs(found - truth).mean() < 0.2 * np.abs(blurred - truth).mean())
    True
    """

def repetition(
    color: ArrayLike,
    previous: ArrayLike,
    motion: ArrayLike,
    deviation: ArrayLike | None = None,
    *,
    out: _Floats | None = None,
) -> tuple[float, _Floats]:
    """Measure how much of a frame's noise is that of the frame before.

    Renderers that begin every frame with the same random numbers make noise that sticks to the screen, and a frame that
    is shown twice has no new noise. Methods that compare frames take such noise for detail.

    Parameters
    ----------
    color, previous : (H, W, 3) array_like of float
        New samples, and those of the frame before; illumination (see `demodulate`) if there is albedo. Missing pixels
        do not count.
    motion : (H, W, 2) or (H, W, 3) array_like of float
        Motion in pixels from this frame to the one before.
    deviation : (2 ⌈H/8⌉, W) array_like of float, optional
        The previous frame's result; none for the second frame of a sequence.
    out : (2 ⌈H/8⌉, W) float32 array, optional
        Written and returned, as the deviation, instead of a new array.

    Returns
    -------
    repetition : float
        0 to 1; 0 of fewer than 256 pairs of pixels. Of illumination, seven sequences with independent noise had at most
        0.09, and 0.52 and more with one seed for all frames (``python -m yester.study.compare.repeated``). Pipelines
        take more than 0.3 for repeated noise.
    deviation : (2 ⌈H/8⌉, W) float32
        For the next frame: ρ in every eighth row and the row below, NaN where it is unknown.

    Raises
    ------
    ValueError
        On wrong shapes.

    See Also
    --------
    choice, collocation_shares : Assume independent noise.

    Notes
    -----
    With y the luminance of `color` and p that of `previous`, fetched along the motion, ``ρ = (y - p) / (|y| + |p|)``,
    and ``δ = ρ(x) - ρ(x + 1)`` leaves out slow changes of light. Detail that moves with its surface cancels in ρ. Noise
    that sticks to the screen correlates by ``C = min(corr(δ, δ'), corr(δᵥ, δᵥ'))``, with δ' of the frame before and
    ``δᵥ = ρ(x) - ρ(x↓)``, ↓ the row below. Independent noise makes these correlate by 0 to -½, or by ¼ where it has
    moved by one pixel along the difference, which it cannot do for both. Where nothing moves, ρ of repeated noise is 0:
    S is the share of pairs of which y(x) is that of `previous` and ``|ε|`` is above 1/10, with
    ``ε = (y(x) - y(x + 1)) / (|y(x)| + |y(x + 1)|)``. Textures and mirrors repeat as well, but their rows resemble one
    another: ``V = corr(δ, δ↓)`` and ``W = corr(ε, ε↓)``. The repetition is
    ``max(0, C - max(V, 0), S - max(W, 0))``, with ``corr(a, b) = Σ a b / max(√(Σ a² Σ b²), n / 100)`` over n pairs:
    deviations below a tenth are no noise that matters.

    Examples
    --------
    >>> noise = np.random.default_rng(0).uniform(size=(64, 64, 3))
    >>> repetition, deviation = yester.repetition(noise, noise, np.zeros((64, 64, 2)))
    >>> repetition > 0.3
    True
    """

def prediction_gain(
    candidate: ArrayLike,
    base: ArrayLike,
    color: ArrayLike,
    *,
    ids: ArrayLike | None = None,
    radius: int = 3,
    standardized: bool = False,
    out: _Floats | None = None,
) -> _Floats:
    """Measure how much better one history predicts the new sample than another, without a reference.

    Parameters
    ----------
    candidate, base : (H, W, 3) array_like of float
        Two predictions of `color`, both independent of it.
    color : (H, W, 3) array_like of float
        The new, noisy samples. A pixel that is missing in one of the three does not count.
    ids : (H, W) array_like of int, optional
        Only pixels of the same id are averaged.
    radius : int, default 3
        Radius of the window in pixels, 0 to 16.
    standardized : bool, default False
        Divide the gain by √(s² / n + 0.01²), where s² is the variance over the n pixels of the window: Student's t,
        with a standard error of at least 1 %. This tells gains from chance, but is no longer unbiased.
    out : (H, W) float32 array, optional
        Written and returned instead of a new array; it may be an input.

    Returns
    -------
    gain : (H, W) float32
        The mean over the window of ``Σ (k - h)(k + h - 2c) / (Σ h² + 0.01)``, sums over channels: an unbiased estimate
        of the difference of relative squared errors, negative where `candidate` is better. 0 without valid pixels, and
        standardized with fewer than two.

    Raises
    ------
    ValueError
        On wrong shapes or a radius out of range.

    See Also
    --------
    compare_candidates : Compares a series of predictions, tile by tile.
    virtual_motion : Motion of the reflections' history.

    Notes
    -----
    ``(k - c)² - (h - c)²`` is linear in c, so that the noise of c averages out; after a tone curve or a clamp it would
    not.

    Examples
    --------
    >>> color = np.ones((4, 4, 3))
    >>> gain = yester.prediction_gain(color, 0.5 * color, color)
    >>> gain[0].round(4)
    array([-0.9868, -0.9868, -0.9868, -0.9868], dtype=float32)
    """

def blend(
    color: ArrayLike,
    history: ArrayLike,
    alpha: float | ArrayLike = 0.05,
    *,
    weighting: _Weighting = "none",
    flicker: float = 1.0,
    exposure: float = 1.0,
    out: _Floats | None = None,
) -> _Floats:
    """Blend history and new sample.

    Parameters
    ----------
    color : (H, W, 3) array_like of float
        The new samples, linear.
    history : (H, W, 3) array_like of float
        Reprojected and, as a rule, clipped.
    alpha : float or (H, W) array_like of float, default 0.05
        Blend factor: weight of the new sample, 0 to 1, for all pixels or for each, as `blend_factor` returns it. Maps
        are clamped; NaN counts as 1.
    weighting : {"none", "tone", "local-tone", "luminance"}, default "none"
        "tone" weights both sides by 1/(exposure + luminance) as well; "local-tone" does so with four times the mean
        luminance of the 3×3 pixels of `color` around for exposure, where that is more; "luminance" raises alpha up to
        fourfold, but to 1 at most, where luminances differ.
    flicker : float, default 1.0
        Factor on alpha, 0 to 1, where history has the lowest or highest luminance of the 3×3 pixels of `color` around;
        1 for no reduction.
    exposure : float, default 1.0
        The radiance that counts as 1, above 0, as `exposure` returns it.
    out : (H, W, 3) float32 array, optional
        Written and returned instead of a new array; it may be an input.

    Returns
    -------
    blended : (H, W, 3) float32
        History where the sample is missing, the sample where history is missing, NaN where both are.

    Raises
    ------
    ValueError
        On wrong shapes, an unknown weighting (the error lists them), alpha, flicker or exposure out of range.

    See Also
    --------
    blend_factor : Blend factors from confidence and speed.
    clip_history : Clips history, and blends in the same pass.
    accumulate : Merges by the number of samples.

    Notes
    -----
    First `flicker`, of Karis [1]_: with ``k = lerp(flicker, 1, d)`` and d the distance of history's luminance from the
    nearer end of the neighbourhood's range, in half ranges, 0 beyond and 1 if there is no range, alpha becomes
    ``alpha (k + alpha (1 - k))``. Then the weighting. "none": ``h + alpha (c - h)``. "tone" is Karis's, too. It darkens
    the edges of lamps, as most samples that hit one count for little there; "local-tone", our own, does so less.
    Missing pixels are left out of its mean, and negative luminances count as 0. "luminance": the same as "none" with
    ``lerp(min(4 alpha, 1), alpha, (1 - d)²)`` for alpha and ``d = min(|l - l'| / max(l, l', 0.2 exposure), 1)``, as in
    INSIDE [2]_.

    References
    ----------
    .. [1] B. Karis, "High quality temporal supersampling", Advances in Real-Time Rendering in Games, SIGGRAPH courses,
       2014.
    .. [2] L. J. F. Pedersen (Playdead), "Temporal reprojection anti-aliasing in INSIDE", Game Developers Conference,
       2016.

    Examples
    --------
    >>> yester.blend(np.ones((1, 1, 3)), np.zeros((1, 1, 3)), alpha=0.25)
    array([[[0.25, 0.25, 0.25]]], dtype=float32)
    """

def accumulate(
    color: ArrayLike,
    history: ArrayLike,
    history_moments: ArrayLike,
    history_length: ArrayLike,
    *,
    weight: ArrayLike | None = None,
    gradient: ArrayLike | None = None,
    confidence: ArrayLike | None = None,
    alpha: float = 0.05,
    moments_alpha: float = 0.2,
    warmup: bool = True,
    out: tuple[_Floats | None, _Floats | None, _Floats | None] | None = None,
) -> Accumulated:
    """Merge new samples into the history: temporal accumulation.

    Parameters
    ----------
    color : (H, W, 3) array_like of float
        The new samples. A pixel with NaN or infinity is missing.
    history : (H, W, 3) array_like of float
        Reprojected colour.
    history_moments : (H, W, 2) array_like of float
        Reprojected means of luminance and of its square.
    history_length : (H, W) array_like of float
        Reprojected number of samples, fractions included; 0 where there is no history.
    weight : (H, W) array_like of float, optional
        The fraction of a sample that each new colour counts for, 0 to 1: below 1 for colours reconstructed from
        neighbours. 0 and NaN mean missing. By default 1.
    gradient : (H, W) array_like of float, optional
        Relative change of light, 0 to 1, as `temporal_gradient` returns it; NaN counts as 0.
    confidence : (H, W) array_like of float, optional
        Confidence in history, 0 to 1, such as the coverage of `reproject`; NaN counts as 0. By default 1.
    alpha : float, default 0.05
        Smallest weight of the new sample, 0 to 1. With 0, all samples are averaged equally, without a limit.
    moments_alpha : float, default 0.2
        Smallest weight of the new sample in the moments.
    warmup : bool, default True
        Give the N-th sample a weight of 1/N until that falls to `alpha`, so that the first samples are averaged
        equally; otherwise the weight is `alpha`, above 0, from the second sample on.
    out : tuple of (H, W, 3), (H, W, 2) and (H, W) float32 arrays, optional
        Written and returned, as colour, moments and length, instead of new arrays; they may be inputs. A part may be
        None.

    Returns
    -------
    Accumulated
        With `color`, `moments`, `history_length` and `missing`. Where a sample is missing, history is unchanged, but
        for its length, which `gradient` shortens; without history either, colour and moments are NaN and the length
        is 0.

    Raises
    ------
    ValueError
        On wrong shapes or weights out of range.

    See Also
    --------
    reproject : Fetches the history.
    combine_histories : Merges two histories.
    converge : Shows the mean of a still scene's samples.
    blend : Merges with a given weight, without a count of samples.

    Notes
    -----
    With w the `weight`, N = min(`history_length` + w, 1/alpha) and l the Rec. 709 luminance:
    ``color = h + w (c - h)/N`` and ``moments = m + w max(moments_alpha, 1/N) ((l, l*l) - m)`` (SVGF [1]_, section 4.2;
    the equal start as in the survey by Yang et al. [2]_). A `gradient` g first shortens the history to
    ``N (1 - g)**10`` and then moves both weights towards 1: ``a + g (1 - a)`` (Schied et al. [3]_; the exponent as in
    Quake II RTX [4]_). A `confidence` c moves both weights further: ``a + w (1 - c) (1 - a)``.

    References
    ----------
    .. [1] C. Schied, A. Kaplanyan, C. Wyman, A. Patney, C. R. A. Chaitanya, J. Burgess, S. Liu, C. Dachsbacher, A.
       Lefohn, M. Salvi, "Spatiotemporal variance-guided filtering: real-time reconstruction for path-traced global
       illumination", High-Performance Graphics, 2017.
    .. [2] L. Yang, S. Liu, M. Salvi, "A survey of temporal antialiasing techniques", Computer Graphics Forum 39(2),
       2020.
    .. [3] C. Schied, C. Peters, C. Dachsbacher, "Gradient estimation for real-time adaptive temporal filtering",
       Proceedings of the ACM on Computer Graphics and Interactive Techniques 1(2), 2018.
    .. [4] NVIDIA, "Quake II RTX", github.com/NVIDIA/Q2RTX, 2019: the denoiser A-SVGF.

    Examples
    --------
    >>> color = np.full((1, 1, 3), 4.0)
    >>> history = np.zeros((1, 1, 3))
    >>> result = yester.accumulate(color, history, np.zeros((1, 1, 2)), [[3.0]])
    >>> result.color
    array([[[1., 1., 1.]]], dtype=float32)
    >>> result.history_length
    array([[4.]], dtype=float32)
    """

def resample(
    image: ArrayLike,
    size: tuple[int, int],
    *,
    offset: ArrayLike = (0.0, 0.0),
    filter: Literal["lanczos-2", "catmull-rom", "bilinear", "nearest"] = "lanczos-2",
    dering: bool = True,
    out: tuple[_Floats | None, _Floats | None] | None = None,
) -> tuple[_Floats, _Floats]:
    """Resample an image's jittered samples to a grid of another size.

    Parameters
    ----------
    image : (H, W) or (H, W, C) array_like of float
        Pixels with NaN or infinity are missing.
    size : (int, int)
        Height and width of the new grid, each at least 1. It covers the same area as the image.
    offset : (2,) array_like of float, default (0, 0)
        A frame's jitter: the samples' positions relative to pixel centres, x right, y down, in the image's pixels.
    filter : {"lanczos-2", "catmull-rom", "bilinear", "nearest"}, default "lanczos-2"
        Reconstruction filter, as in `reproject`; "nearest" copies a sample.
    dering : bool, default True
        Clamp "lanczos-2" and "catmull-rom" to the range of the nearest 2×2 samples.
    out : tuple of (H', W') or (H', W', C) and (H', W') float32 arrays, optional
        Written and returned instead of new arrays. A part may be None.

    Returns
    -------
    resampled : (H', W') or (H', W', C) float32
        NaN without valid samples. Missing samples have weight 0, except that "nearest" copies them.
    weight : (H', W') float32
        Density of samples near each pixel of the grid, in samples per pixel: each sample contributes a normal
        distribution with a standard deviation of 0.33 pixels of the grid. The average over offsets is the ratio of the
        pixel counts; on a finer grid the maximum is 1.46, where a sample hits a pixel's centre. On grids of less
        than half the resolution the average is lower, 12.1 instead of 16 at a quarter, as only the nearest 4×4 samples
        count.

    Raises
    ------
    ValueError
        On wrong shapes, an unknown filter, sizes below 1 or above 65536, or an offset that is not finite.

    See Also
    --------
    Upscaler : The pipeline that upscales sequences.
    jitter : Offsets.
    joint_bilateral_upsample : Upsamples along the edges of guides.

    Notes
    -----
    Lanczos with two lobes, ``sinc(x) sinc(x/2)``, as in AMD's FSR 2 [1]_, normalised by the sum of weights. There is no
    low-pass filter: downsampling aliases. Frames with different offsets, blended by weight, converge to an image at the
    grid's full resolution [2]_.

    References
    ----------
    .. [1] AMD, "FidelityFX Super Resolution 2", GPUOpen, 2022.
    .. [2] B. Karis, "High quality temporal supersampling", Advances in Real-Time Rendering in Games, SIGGRAPH courses,
       2014.

    Examples
    --------
    >>> image = np.array([[0.0, 1.0], [0.0, 1.0]])
    >>> resampled, weight = yester.resample(image, (2, 4), filter="bilinear")
    >>> resampled
    array([[0.  , 0.25, 0.75, 1.  ],
           [0.  , 0.25, 0.75, 1.  ]], dtype=float32)
    """

def disocclusion(
    depth: ArrayLike, motion: ArrayLike, *, separation: float = 0.05, out: _Floats | None = None
) -> _Floats:
    """Measure the fraction of each pixel's history footprint that was hidden by a nearer surface.

    Parameters
    ----------
    depth : (H, W) array_like of float
        View-space z of the current frame; NaN, +inf or not above 0 counts as infinitely far.
    motion : (H, W, 2) or (H, W, 3) array_like of float
        As `motion_vectors` returns it; with the third channel, depths are compared as they were.
    separation : float, default 0.05
        Smallest depth difference of an occluder, relative to depth, 0 to 1.
    out : (H, W) float32 array, optional
        Written and returned instead of a new array; it may be an input.

    Returns
    -------
    share : (H, W) float32
        0 (visible before) to 1 (hidden, wholly outside the image, or of unknown motion). Of a position partly outside,
        the part inside counts.

    Raises
    ------
    ValueError
        On wrong shapes or a separation out of range.

    See Also
    --------
    consistency : Tests history by buffers of the previous frame.
    Upscaler : The pipeline that upscales sequences.

    Notes
    -----
    Needs no buffer of the previous frame: the current depths are scattered to their previous positions, nearest depth
    wins. A surface that lies behind the result by more than ``separation`` times its depth was hidden; the 2×2 pixels
    at its previous position count by their bilinear weights. Depth and motion are dilated over 3×3 pixels, as in
    `dilate_motion`. After AMD's FSR 2 [1]_, whose separation is 1.37e-5 times half the image's width in pixels, the
    resolution of depth buffers [2]_: 0.013 at 1920 pixels. The default also tolerates slopes.

    References
    ----------
    .. [1] AMD, "FidelityFX Super Resolution 2", GPUOpen, 2022.
    .. [2] K. Akeley, J. Su, "Minimum triangle separation for correct z-buffer occlusion", Graphics Hardware, 2006.

    Examples
    --------
    >>> depth = np.full((3, 12), 9.0)
    >>> depth[:, :4] = 1
    >>> motion = np.zeros((3, 12, 2))
    >>> motion[:, :4, 0] = 4
    >>> yester.disocclusion(depth, motion)[1]
    array([0., 0., 0., 0., 0., 1., 1., 1., 1., 0., 0., 0.], dtype=float32)
    """

def thin_features(color: ArrayLike, *, similarity: float = 1.05, out: _Floats | None = None) -> _Floats:
    """Detect bright or dark lines narrower than two pixels.

    Parameters
    ----------
    color : (H, W, 3) array_like of float
        Linear.
    similarity : float, default 1.05
        Largest ratio of luminances that count as similar, at least 1.
    out : (H, W) float32 array, optional
        Written and returned instead of a new array.

    Returns
    -------
    thin : (H, W) float32
        1 where a pixel is brighter, or darker, than all dissimilar pixels of its 3×3, and no 2×2 block that contains it
        is similar throughout; else 0. Neighbours that are missing or outside count as similar.

    Raises
    ------
    ValueError
        On wrong shapes or a ratio out of range.

    See Also
    --------
    Upscaler : Locks thin features.
    alternation : Detects wider features that flicker.

    Notes
    -----
    After the locks of AMD's FSR 2 [1]_: jittered samples miss a thin feature in some frames; there its history must not
    be clipped to the neighbourhood.

    References
    ----------
    .. [1] AMD, "FidelityFX Super Resolution 2", GPUOpen, 2022.

    Examples
    --------
    >>> color = np.full((3, 5, 3), 0.1)
    >>> color[:, 2] = 1
    >>> yester.thin_features(color)
    array([[0., 0., 1., 0., 0.],
           [0., 0., 1., 0., 0.],
           [0., 0., 1., 0., 0.]], dtype=float32)
    """

def sharpen(color: ArrayLike, *, strength: float = 0.5, exposure: float = 1.0, out: _Floats | None = None) -> _Floats:
    """Sharpen an image in proportion to its local contrast, without halos.

    Parameters
    ----------
    color : (H, W, 3) array_like of float
        Linear.
    strength : float, default 0.5
        0 (unchanged) to 1.
    exposure : float, default 1.0
        The radiance that counts as 1, above 0, as `exposure` returns it.
    out : (H, W, 3) float32 array, optional
        Written and returned instead of a new array; it may be an input.

    Returns
    -------
    sharpened : (H, W, 3) float32
        Tone-mapped channels stay in the range of the pixel and its four neighbours: there are no halos. Missing pixels
        stay missing.

    Raises
    ------
    ValueError
        On wrong shapes, a strength or an exposure out of range.

    See Also
    --------
    Upscaler : Sharpens with the option `sharpness`.

    Notes
    -----
    Robust contrast-adaptive sharpening, as in AMD's FSR 1 [1]_, on colours ``c / (exposure + max(r, g, b))``: a pixel p
    with the four neighbours n becomes ``(p + λ Σ n) / (1 + 4λ)``. λ is `strength` times the strongest from -3/16 to 0
    by which a pixel within the range of its neighbours stays within 0 to 1, the weakest channel's:
    ``max(-min(n) / (4 max(n)), (1 - max(n)) / (4 min(n) - 4))``.

    References
    ----------
    .. [1] AMD, "FidelityFX Super Resolution 1", GPUOpen, 2021: RCAS, robust contrast-adaptive sharpening.

    Examples
    --------
    >>> color = np.full((3, 3, 3), 0.4)
    >>> color[:, 1] = 0.5
    >>> color[:, 2] = 0.6
    >>> color[1, 1] = 0.55
    >>> yester.sharpen(color, strength=1.0)[1, :, 0]
    array([0.4, 0.6, 0.6], dtype=float32)
    """

def resolve(
    samples: NDArray[Any] | Sequence[ArrayLike],
    offsets: ArrayLike,
    *,
    filter: Literal["blackman-harris", "box", "tent", "mitchell"] = "blackman-harris",
    out: _Floats | None = None,
) -> _Floats:
    """Reconstruct one image from the jittered samples of several frames.

    Parameters
    ----------
    samples : sequence of (H, W) or (H, W, C) array_like of float
        One image per frame, all of one shape, or an (N, H, W, C) array. Pixels with NaN or infinity are missing.
    offsets : (N, 2) array_like of float
        Each frame's jitter: its samples' positions relative to pixel centres, x right, y down, in pixels from -0.5 to
        0.5, as `jitter` returns them.
    filter : {"blackman-harris", "box", "tent", "mitchell"}, default "blackman-harris"
        Reconstruction filter: the Blackman-Harris window 3.3 pixels wide, the samples with ``-0.5 <= d < 0.5`` equally
        weighted, ``1 - |d|``, or Mitchell and Netravali's cubic with B = C = 1/3.
    out : float32 array like one of the samples, optional
        Written and returned instead of a new array; it may be an input.

    Returns
    -------
    image : float32 array like one of the samples
        The supersampling sum Σwᵢcᵢ / Σwᵢ; NaN without valid samples.

    Raises
    ------
    ValueError
        On wrong shapes, an unknown filter, or offsets beyond half a pixel.

    See Also
    --------
    jitter : Offsets.
    resample : Resamples one frame to a grid of another size.
    TAA : Approaches this image over time.

    Notes
    -----
    For a static camera and scene this is the image to which temporal antialiasing should converge. The Blackman-Harris
    window is that of Karis [1]_, the cubic that of Mitchell and Netravali [2]_.

    References
    ----------
    .. [1] B. Karis, "High quality temporal supersampling", Advances in Real-Time Rendering in Games, SIGGRAPH courses,
       2014.
    .. [2] D. P. Mitchell, A. N. Netravali, "Reconstruction filters in computer graphics", Computer Graphics (SIGGRAPH)
       22(4), 1988.

    Examples
    --------
    >>> samples = [np.zeros((2, 2)), np.ones((2, 2))]
    >>> yester.resolve(samples, [[0.0, 0.0], [0.0, 0.0]], filter="box")
    array([[0.5, 0.5],
           [0.5, 0.5]], dtype=float32)
    """

def estimate_variance(
    moments: ArrayLike,
    history_length: ArrayLike,
    *,
    depth: ArrayLike | None = None,
    normal: ArrayLike | None = None,
    ids: ArrayLike | None = None,
    min_length: float = 3.5,
    radius: int = 3,
    sigma_normal: float = 128.0,
    sigma_depth: float = 0.5,
    sigma_plane: float = 0.05,
    out: _Floats | None = None,
) -> _Floats:
    """Estimate the variance of luminance: temporal for long histories, spatial for short ones.

    Parameters
    ----------
    moments : (H, W, 2) array_like of float
        Means of luminance and of its square, as `accumulate` returns them.
    history_length : (H, W) array_like of float
        History length in samples.
    depth : (H, W) array_like of float, optional
        View-space z, +inf where nothing was hit.
    normal : (H, W, 3) array_like of float, optional
        World space, unit length.
    ids : (H, W) array_like of int, optional
        Pixels with different ids do not mix.
    min_length : float, default 3.5
        History length from which the temporal variance is used; at least 1. The default is fractional so that rounding
        of resampled lengths does not decide.
    radius : int, default 3
        The spatial window reaches so many pixels to each side, 0 to 16.
    sigma_normal, sigma_depth, sigma_plane : float, default 128.0, 0.5 and 0.05
        As in `atrous`.
    out : (H, W) float32 array, optional
        Written and returned instead of a new array; it may be an input.

    Returns
    -------
    variance : (H, W) float32
        In squared luminance; 0 for values below 1e-30 and for pixels without valid moments in their window.

    Raises
    ------
    ValueError
        On wrong shapes or parameters out of range.

    See Also
    --------
    accumulate : Returns the moments.
    atrous : Takes the variance.

    Notes
    -----
    A history of at least `min_length` gives ``m2 - m1²``. A shorter one, or one without valid moments, takes the
    moments' means over the window, weighted as in `atrous` but for kernel and luminance, and multiplies the variance by
    ``max(min_length / max(N, 1), 1)``, as SVGF does ([1]_, section 4.2, and its implementation in Falcor [2]_).

    References
    ----------
    .. [1] C. Schied, A. Kaplanyan, C. Wyman, A. Patney, C. R. A. Chaitanya, J. Burgess, S. Liu, C. Dachsbacher, A.
       Lefohn, M. Salvi, "Spatiotemporal variance-guided filtering: real-time reconstruction for path-traced global
       illumination", High-Performance Graphics, 2017.
    .. [2] NVIDIA, "Falcor", github.com/NVIDIAGameWorks/Falcor, render pass SVGFPass.

    Examples
    --------
    >>> moments = np.tile([0.5, 0.35], (4, 4, 1))
    >>> yester.estimate_variance(moments, np.full((4, 4), 20.0))[0].round(3)
    array([0.1, 0.1, 0.1, 0.1], dtype=float32)
    >>> yester.estimate_variance(moments, np.full((4, 4), 1.0))[0].round(3)
    array([0.35, 0.35, 0.35, 0.35], dtype=float32)
    """

@overload
def atrous(
    color: ArrayLike,
    variance: ArrayLike,
    *,
    prediction: None = None,
    history_length: ArrayLike | None = None,
    depth: ArrayLike | None = None,
    normal: ArrayLike | None = None,
    ids: ArrayLike | None = None,
    iterations: int = 5,
    radius: int = 2,
    sigma_luminance: float = 4.0,
    relative_noise: float = 2.5,
    tap_exposure: float | None = None,
    settled: float = 3.5,
    sigma_normal: float = 128.0,
    sigma_depth: float = 0.5,
    sigma_plane: float = 0.05,
    out: tuple[_Floats | None, _Floats | None] | None = None,
) -> tuple[_Floats, _Floats]:
    """Smooth colour by the edge-avoiding à-trous wavelet filter, guided by variance.

    Parameters
    ----------
    color : (H, W, 3) array_like of float
        Linear. Pixels with NaN or infinity are missing: they have weight 0 and are filled from their neighbours.
    variance : (H, W) array_like of float
        Variance of the luminance of `color`, as `estimate_variance` returns it; values that are not finite count as 0.
    prediction : (H, W) array_like of float, optional
        Luminance that history predicts, without the newest samples. Luminance differences are then its own instead of
        the colour's, so that weights do not depend on the samples' noise, and it is filtered by the same weights. NaN
        where nothing is predicted: the colour's luminance is used instead.
    history_length : (H, W) array_like of float, optional
        Number of samples that a pixel is the mean of. The noise is then limited by `relative_noise`. For frames without
        normals, ids and albedo: with them, this keeps noise where rare bright samples make all of the light.
    depth : (H, W) array_like of float, optional
        View-space z; +inf, NaN or not above 0 is background, which does not mix with surfaces.
    normal : (H, W, 3) array_like of float, optional
        World space, unit length.
    ids : (H, W) array_like of int, optional
        Pixels with different ids do not mix.
    iterations : int, default 5
        Number of passes, 0 to 16; pass i reaches radius·2^i pixels to each side.
    radius : int, default 2
        Radius of a pass in taps: 2 for 5×5, 1 for 3×3.
    sigma_luminance : float, default 4.0
        Scale of luminance differences, in standard deviations; above 0.
    relative_noise : float, default 2.5
        Most standard deviation of one sample that is expected, in multiples of the light around it, with
        `history_length`; above 0, may be +inf.
    tap_exposure : float, optional
        The light above which taps that are brighter than the centre weigh less, as light that leaks into the dark is
        seen more than dark that leaks into light; above 0. Needs `history_length`. By default all weigh alike.
    settled : float, default 3.5
        Smallest history length, in samples, that both pixels must have for `tap_exposure` to apply; from 0. Shorter
        histories are so noisy that it would darken them.
    sigma_normal : float, default 128.0
        Sharpness of the normal weight; from 0. About the exponent in (n·n')^sigma_normal, less where normals are rough.
    sigma_depth, sigma_plane : float, default 0.5 and 0.05
        Scale of the distance from the pixel's tangent plane: in multiples of what the slope explains over the reach of
        the pass, and as a share of depth; both above 0. The two add up.
    out : tuple of (H, W, 3) and (H, W) float32 arrays, and with `prediction` another of (H, W), optional
        Written and returned instead of new arrays; they may be inputs. A part may be None.

    Returns
    -------
    color : (H, W, 3) float32
        Filtered; NaN for missing pixels without valid neighbours.
    variance : (H, W) float32
        Variance of its luminance, assuming independent samples.
    prediction : (H, W) float32
        The filtered prediction, only if one was given. Where a pixel has one, it has not seen the pixel's newest sample
        either (see `compare_candidates`); where it was NaN, it begins with the colour's luminance.

    Raises
    ------
    ValueError
        On wrong shapes or parameters out of range.

    See Also
    --------
    estimate_variance : Estimates the variance.
    accumulate : Returns accumulated colour.
    SVGF : The pipeline that filters every frame.

    Notes
    -----
    A tap's weight is ``k(dx) k(dy) exp(-(en + ez + el))`` with the kernel k = {1, 2/3, 1/6}, or {1, 1/2} for 3×3 taps,
    zero between different ids or between surface and background. Background is one surface, whatever its ids and
    normals. In the exponent,

    - ``en = sigma_normal · ½|n - n'|² / (1 + sigma_normal · ρ)``, where the roughness ρ is how much normals change from
      pixel to pixel where that is neither an edge nor curvature, as bumps and noise do (after Rousselle et al. [1]_):
      ``½ Σ min(|n₋ - n|², |n₊ - n|², ⅓|n₋ - 2n + n₊|²)`` over those axes along which both neighbours are of the
      pixel's surface,
    - ``ez = |w' - w - ∇w·Δ| / (sigma_plane w + sigma_depth r |∇w|₁)``, where ``w = 1/Z`` is linear in the image on a
      plane, r is the reach of the pass in pixels, and ∇w has the smaller one-sided differences, of surfaces whatever
      their ids,
    - ``el = |l - l'| / (sigma_luminance √(3×3 Gaussian of variance) + |l|/1000)``, l being the luminance of the colour,
      or the prediction. With `history_length`, the root is at most ``relative_noise L / √N``, where N is the number of
      samples, at least 1, and L the 3×3 Gaussian of the luminance of `color`, at least 0, missing pixels being black.
      Both Gaussians repeat the pixels at the borders.

    With `tap_exposure` e, the weights of taps that are brighter before the first pass are also multiplied by
    ``((e + l) / (e + l'))²``, with l at least 0, where both pixels have `settled` samples or more.

    Colour is ``Σwc/Σw`` and variance ``Σw²v/(Σw)²``. The filter is that of Dammertz et al. [2]_, its guidance by
    variance that of SVGF ([3]_, section 4.3). SVGF's own ``ez``, ``|Z - Z'| / (sigma_depth |∇Z·Δ|)``, is 1 for every
    tap on an inclined plane, where the one above is 0.

    References
    ----------
    .. [1] F. Rousselle, M. Manzi, M. Zwicker, "Robust denoising using feature and color information", Computer Graphics
       Forum 32(7), 2013.
    .. [2] H. Dammertz, D. Sewtz, J. Hanika, H. P. A. Lensch, "Edge-avoiding à-trous wavelet transform for fast global
       illumination filtering", High-Performance Graphics, 2010.
    .. [3] C. Schied, A. Kaplanyan, C. Wyman, A. Patney, C. R. A. Chaitanya, J. Burgess, S. Liu, C. Dachsbacher, A.
       Lefohn, M. Salvi, "Spatiotemporal variance-guided filtering: real-time reconstruction for path-traced global
       illumination", High-Performance Graphics, 2017.

    Examples
    --------
    >>> noisy = 1 + 0.1 * np.random.default_rng(0).standard_normal((32, 32, 1)) * np.ones(3)
    >>> color, variance = yester.atrous(noisy, np.full((32, 32), 0.01))
    >>> bool(color.std() < noisy.std() / 5)
    True
    """

@overload
def atrous(
    color: ArrayLike,
    variance: ArrayLike,
    *,
    prediction: ArrayLike,
    history_length: ArrayLike | None = None,
    depth: ArrayLike | None = None,
    normal: ArrayLike | None = None,
    ids: ArrayLike | None = None,
    iterations: int = 5,
    radius: int = 2,
    sigma_luminance: float = 4.0,
    relative_noise: float = 2.5,
    tap_exposure: float | None = None,
    settled: float = 3.5,
    sigma_normal: float = 128.0,
    sigma_depth: float = 0.5,
    sigma_plane: float = 0.05,
    out: tuple[_Floats | None, _Floats | None, _Floats | None] | None = None,
) -> tuple[_Floats, _Floats, _Floats]:
    """Smooth colour by the edge-avoiding à-trous wavelet filter, guided by variance.

    Parameters
    ----------
    color : (H, W, 3) array_like of float
        Linear. Pixels with NaN or infinity are missing: they have weight 0 and are filled from their neighbours.
    variance : (H, W) array_like of float
        Variance of the luminance of `color`, as `estimate_variance` returns it; values that are not finite count as 0.
    prediction : (H, W) array_like of float, optional
        Luminance that history predicts, without the newest samples. Luminance differences are then its own instead of
        the colour's, so that weights do not depend on the samples' noise, and it is filtered by the same weights. NaN
        where nothing is predicted: the colour's luminance is used instead.
    history_length : (H, W) array_like of float, optional
        Number of samples that a pixel is the mean of. The noise is then limited by `relative_noise`. For frames without
        normals, ids and albedo: with them, this keeps noise where rare bright samples make all of the light.
    depth : (H, W) array_like of float, optional
        View-space z; +inf, NaN or not above 0 is background, which does not mix with surfaces.
    normal : (H, W, 3) array_like of float, optional
        World space, unit length.
    ids : (H, W) array_like of int, optional
        Pixels with different ids do not mix.
    iterations : int, default 5
        Number of passes, 0 to 16; pass i reaches radius·2^i pixels to each side.
    radius : int, default 2
        Radius of a pass in taps: 2 for 5×5, 1 for 3×3.
    sigma_luminance : float, default 4.0
        Scale of luminance differences, in standard deviations; above 0.
    relative_noise : float, default 2.5
        Most standard deviation of one sample that is expected, in multiples of the light around it, with
        `history_length`; above 0, may be +inf.
    tap_exposure : float, optional
        The light above which taps that are brighter than the centre weigh less, as light that leaks into the dark is
        seen more than dark that leaks into light; above 0. Needs `history_length`. By default all weigh alike.
    settled : float, default 3.5
        Smallest history length, in samples, that both pixels must have for `tap_exposure` to apply; from 0. Shorter
        histories are so noisy that it would darken them.
    sigma_normal : float, default 128.0
        Sharpness of the normal weight; from 0. About the exponent in (n·n')^sigma_normal, less where normals are rough.
    sigma_depth, sigma_plane : float, default 0.5 and 0.05
        Scale of the distance from the pixel's tangent plane: in multiples of what the slope explains over the reach of
        the pass, and as a share of depth; both above 0. The two add up.
    out : tuple of (H, W, 3) and (H, W) float32 arrays, and with `prediction` another of (H, W), optional
        Written and returned instead of new arrays; they may be inputs. A part may be None.

    Returns
    -------
    color : (H, W, 3) float32
        Filtered; NaN for missing pixels without valid neighbours.
    variance : (H, W) float32
        Variance of its luminance, assuming independent samples.
    prediction : (H, W) float32
        The filtered prediction, only if one was given. Where a pixel has one, it has not seen the pixel's newest sample
        either (see `compare_candidates`); where it was NaN, it begins with the colour's luminance.

    Raises
    ------
    ValueError
        On wrong shapes or parameters out of range.

    See Also
    --------
    estimate_variance : Estimates the variance.
    accumulate : Returns accumulated colour.
    SVGF : The pipeline that filters every frame.

    Notes
    -----
    A tap's weight is ``k(dx) k(dy) exp(-(en + ez + el))`` with the kernel k = {1, 2/3, 1/6}, or {1, 1/2} for 3×3 taps,
    zero between different ids or between surface and background. Background is one surface, whatever its ids and
    normals. In the exponent,

    - ``en = sigma_normal · ½|n - n'|² / (1 + sigma_normal · ρ)``, where the roughness ρ is how much normals change from
      pixel to pixel where that is neither an edge nor curvature, as bumps and noise do (after Rousselle et al. [1]_):
      ``½ Σ min(|n₋ - n|², |n₊ - n|², ⅓|n₋ - 2n + n₊|²)`` over those axes along which both neighbours are of the
      pixel's surface,
    - ``ez = |w' - w - ∇w·Δ| / (sigma_plane w + sigma_depth r |∇w|₁)``, where ``w = 1/Z`` is linear in the image on a
      plane, r is the reach of the pass in pixels, and ∇w has the smaller one-sided differences, of surfaces whatever
      their ids,
    - ``el = |l - l'| / (sigma_luminance √(3×3 Gaussian of variance) + |l|/1000)``, l being the luminance of the colour,
      or the prediction. With `history_length`, the root is at most ``relative_noise L / √N``, where N is the number of
      samples, at least 1, and L the 3×3 Gaussian of the luminance of `color`, at least 0, missing pixels being black.
      Both Gaussians repeat the pixels at the borders.

    With `tap_exposure` e, the weights of taps that are brighter before the first pass are also multiplied by
    ``((e + l) / (e + l'))²``, with l at least 0, where both pixels have `settled` samples or more.

    Colour is ``Σwc/Σw`` and variance ``Σw²v/(Σw)²``. The filter is that of Dammertz et al. [2]_, its guidance by
    variance that of SVGF ([3]_, section 4.3). SVGF's own ``ez``, ``|Z - Z'| / (sigma_depth |∇Z·Δ|)``, is 1 for every
    tap on an inclined plane, where the one above is 0.

    References
    ----------
    .. [1] F. Rousselle, M. Manzi, M. Zwicker, "Robust denoising using feature and color information", Computer Graphics
       Forum 32(7), 2013.
    .. [2] H. Dammertz, D. Sewtz, J. Hanika, H. P. A. Lensch, "Edge-avoiding à-trous wavelet transform for fast global
       illumination filtering", High-Performance Graphics, 2010.
    .. [3] C. Schied, A. Kaplanyan, C. Wyman, A. Patney, C. R. A. Chaitanya, J. Burgess, S. Liu, C. Dachsbacher, A.
       Lefohn, M. Salvi, "Spatiotemporal variance-guided filtering: real-time reconstruction for path-traced global
       illumination", High-Performance Graphics, 2017.

    Examples
    --------
    >>> noisy = 1 + 0.1 * np.random.default_rng(0).standard_normal((32, 32, 1)) * np.ones(3)
    >>> color, variance = yester.atrous(noisy, np.full((32, 32), 0.01))
    >>> bool(color.std() < noisy.std() / 5)
    True
    """

def restore_detail(
    smooth: ArrayLike,
    noisy: ArrayLike,
    variance: ArrayLike,
    *,
    strictness: float = 1.0,
    radius: int = 1,
    out: _Floats | None = None,
) -> _Floats:
    """Restore the detail that a smooth image lacks, as far as a noisy one shows it beyond its noise.

    Parameters
    ----------
    smooth : (H, W, 3) array_like of float
        What a filter or a fit made of the noisy colour.
    noisy : (H, W, 3) array_like of float
        Unbiased, such as accumulated samples.
    variance : (H, W) array_like of float
        Of the noisy luminance. A pixel whose variance is negative, NaN or infinite stays smooth.
    strictness : float, default 1.0
        Multiple of the variance below which a difference counts as noise; at least 0. With 1, the expected squared
        error is smallest.
    radius : int, default 1
        The window reaches so many pixels to each side, 0 to 16.
    out : (H, W, 3) float32 array, optional
        Written and returned instead of a new array; it may be an input.

    Returns
    -------
    restored : (H, W, 3) float32
        Between `smooth` and `noisy`; `smooth` with its bits where nothing exceeds the noise or `noisy` is missing.

    Raises
    ------
    ValueError
        On wrong shapes or parameters out of range.

    See Also
    --------
    accumulate : Returns moments and history length, of which the variance of the mean follows: ``(m2 - m1²) / N``.
    regress : Fits that lack detail.

    Notes
    -----
    The local Wiener filter [1]_: ``smooth + g (noisy - smooth)`` with ``g = max(0, 1 - strictness * mean(variance) /
    mean((l_noisy - l_smooth)**2))``, l the luminance, and means over the pixels of the window that have both colours
    and a variance.

    References
    ----------
    .. [1] J.-S. Lee, "Digital image enhancement and noise filtering by use of local statistics", IEEE Transactions on
       Pattern Analysis and Machine Intelligence 2(2), 1980.

    Examples
    --------
    >>> smooth, noisy = np.zeros((1, 3, 3)), np.ones((1, 3, 3))
    >>> yester.restore_detail(smooth, noisy, np.full((1, 3), 0.25))[0, 1]
    array([0.75, 0.75, 0.75], dtype=float32)
    >>> yester.restore_detail(smooth, noisy, np.full((1, 3), 2.0))[0, 1]
    array([0., 0., 0.], dtype=float32)
    """

def regress(
    color: ArrayLike,
    *,
    normal: ArrayLike | None = None,
    geometry: ArrayLike | None = None,
    camera: Camera | None = None,
    weight: ArrayLike | None = None,
    block: int = 32,
    offset: tuple[int, int] = (0, 0),
    features: Literal["fewest", "all"] = "fewest",
    out: tuple[_Floats | None, NDArray[np.uint8] | None] | None = None,
) -> tuple[_Floats, NDArray[np.uint8]]:
    """Fit colour, block by block, to feature buffers: block-wise multi-order feature regression.

    Parameters
    ----------
    color : (H, W, 3) array_like of float
        Linear, usually illumination (`demodulate`). Pixels with NaN or infinity are missing.
    normal : (H, W, 3) array_like of float, optional
        World space, unit length; not finite or zero where there is no surface.
    geometry : (H, W) or (H, W, 3) array_like of float, optional
        Depth, which needs `camera`, or world-space positions; not finite where there is no surface. Depth up to 0 means
        no surface, too.
    camera : Camera, optional
        This frame's camera.
    weight : (H, W) array_like of float, optional
        Weight of each pixel, at least 0; pixels whose weight is not finite or below 0 keep their colour. By default 1.
    block : int, default 32
        Side of the blocks in pixels, 4 to 256. An image smaller than that is one block.
    offset : (int, int), default (0, 0)
        Offset of the grid of blocks, right and down, in pixels. Changed from frame to frame, it lets blocks' edges
        average out in time. Blocks that the border cuts to less than half are merged with their neighbours.
    features : {"fewest", "all"}, default "fewest"
        The fewest features that the block needs, or all that vary in it.
    out : tuple of (H, W, 3) float32 and (H, W) uint8 arrays, optional
        Written and returned instead of new arrays; they may be inputs. A part may be None.

    Returns
    -------
    fitted : (H, W, 3) float32
        Clamped to the range of the block's colours. Missing pixels, and those of weight 0, get the fitted colour.
        Pixels without a surface keep their colour, as do blocks without valid pixels.
    used : (H, W) uint8
        Number of the block's features, including the constant: 1 to 10; 0 where a pixel keeps its colour.

    Raises
    ------
    ValueError
        On wrong shapes or parameters out of range; if a depth has no camera.

    See Also
    --------
    BMFR : The pipeline that fits every frame.
    demodulate : Divides colour by albedo.
    atrous : Filters instead of fitting.

    Notes
    -----
    Least squares of colour on those of {1, normal, position, position²} that are given and vary within the block
    (Koskela et al. [1]_), by a QR decomposition in double precision. Positions are relative to the block's weighted
    mean, which matters to "fewest": their squares are other features than those of coordinates. A feature is skipped if
    the others explain all but a hundredth of it (the paper adds noise instead), if it is a normal that varies by less
    than a thousandth, or a coordinate that varies by less than a thousandth of the others.

    "fewest" adds features one by one, each the one that reduces the sum S of squared residuals most, as long as that
    lowers the generalised cross-validation score ``S / (1 - (1 + 3k)/n)²``, with k features besides the constant and n
    pixels (``(Σw)² / Σw²`` by weight; Craven and Wahba [2]_). A chosen feature counts as three degrees of freedom, as
    in Friedman's regression splines [3]_.

    References
    ----------
    .. [1] M. Koskela, K. Immonen, M. Mäkitalo, A. Foi, T. Viitanen, P. Jääskeläinen, H. Kultala, J. Takala, "Blockwise
       multi-order feature regression for real-time path-tracing reconstruction", ACM Transactions on Graphics 38(5),
       2019.
    .. [2] P. Craven, G. Wahba, "Smoothing noisy data with spline functions", Numerische Mathematik 31, 1979.
    .. [3] J. H. Friedman, "Multivariate adaptive regression splines", The Annals of Statistics 19(1), 1991.

    Examples
    --------
    >>> depth = np.tile(np.linspace(1, 2, 8), (8, 1))
    >>> camera = yester.Camera.from_look_at([0, 0, 0], [0, 0, 1], [0, 1, 0], fov=60, width=8, height=8)
    >>> position = camera.unproject(np.stack(np.meshgrid(np.arange(8) + 0.5, np.arange(8) + 0.5), -1), depth)
    >>> color = np.repeat(position[..., 2:], 3, -1)
    >>> color[4, 4] = np.nan
    >>> fitted, used = yester.regress(color, geometry=position)
    >>> np.allclose(fitted[..., 0], depth, atol=1e-4)
    True
    >>> int(used[4, 4])
    2
    """

def splat(
    color: ArrayLike,
    depth: ArrayLike,
    camera: Camera,
    previous_camera: Camera,
    *,
    offset: ArrayLike | None = None,
    drift: ArrayLike | None = None,
    quality: ArrayLike | None = None,
    tolerance: float = 0.1,
    reach: float = 0.0,
    out: tuple[_Floats | None, _Floats | None, _Floats | None, _Floats | None] | None = None,
) -> tuple[_Floats, _Floats, _Floats, _Floats]:
    """Scatter the previous frame's pixels as points to where they appear now: forward reprojection.

    Every pixel of the previous frame is a world-space point, static unless `drift` says otherwise. In the current frame
    it covers a square as large as its old pixel appears now. The nearest point that covers a pixel determines the
    visible surface there.

    Parameters
    ----------
    color : (H, W) or (H, W, C) array_like of float
        The points' values. NaN or infinity in a channel: no point.
    depth : (H, W) array_like of float
        Distance along the previous camera's axis; +inf for the background, which only turns with the camera. NaN, or
        not above 0: no point.
    camera, previous_camera : Camera
        Of the current and the previous frame, without jitter, both of the image's size.
    offset : (H, W, 2) array_like of float, optional
        Position of each point relative to its pixel's centre, in pixels, x right, y down; -0.5 and 0.5 are the pixel's
        borders and belong to it. By default 0.
    drift : (H, W, 2) or (H, W, 3) array_like of float, optional
        The points' own motion: previous minus current position in pixels, and depth; that is, `Frame.motion` minus the
        `motion_vectors` of a static scene. Values that are not finite count as 0.
    quality : (H, W) array_like of float, optional
        Weight of each point, above 0; pixels with another value are no points. By default 1.
    tolerance : float, default 0.1
        Largest depth difference from the nearest point, relative to its depth, of points of the same surface; above 0.
    reach : float, default 0.0
        Pixels, 0 to 1, by which squares are enlarged on every side to fill pixels that no square covers. Points keep
        their sub-pixel positions and leave cracks as they move; 0.5 closes them.
    out : tuple of float32 arrays like the results, optional
        Written and returned instead of new arrays; they may be inputs. A part may be None.

    Returns
    -------
    color : float32 array like `color`
        Weighted mean of the points of the nearest surface; NaN in holes, which no point covers.
    depth : (H, W) float32
        Their mean distance along the current camera's axis; NaN in holes.
    offset : (H, W, 2) float32
        Their mean position relative to the pixel's centre, -0.5 to 0.5; NaN in holes. Passed to the next call, it
        prevents blur and sub-pixel drift over many frames.
    quality : (H, W) float32
        Mean of their ``quality / s**4``, weighted as `color` is; 0 in holes.

    Raises
    ------
    ValueError
        On wrong shapes, a camera of another size, or a tolerance or reach out of range.

    See Also
    --------
    pull_push : Fills the holes.
    reproject : Fetches instead of scattering.
    Recirculation : The pipeline that keeps history as points.

    Notes
    -----
    A point of depth z that is now at z' covers a square of side ``s = 1 + 1.01 max(0, z/z' - 1)`` (z/z' times the ratio
    of the focal lengths; at most 16 pixels), and its weight becomes ``quality / s**4``: small points override large
    ones. With the nearest point at z0, weights fall linearly to 0 at ``z' = z0 (1 + tolerance)``. In a pixel that it
    fills by `reach`, a point has the weight of its enlarged square. Points are summed in the order of their source
    pixels, whatever the number of threads. In pixels other than its own, a large point counts as lying at the centre.
    Equal cameras leave everything unchanged. That points are weighted by their size and depth is from a developer's
    diary [1]_; the formula is our own.

    References
    ----------
    .. [1] T. Lottes, "Reprojection 2", timothylottes.github.io/20081218.html, 2008.

    Examples
    --------
    >>> camera = yester.Camera.from_look_at([0, 0, 5], [0, 0, 0], [0, 1, 0], fov=90, width=4, height=4)
    >>> previous = yester.Camera.from_look_at([2.5, 0, 5], [2.5, 0, 0], [0, 1, 0], fov=90, width=4, height=4)
    >>> image = np.tile([1.0, 2.0, 3.0, 4.0], (4, 1))
    >>> color, depth, offset, quality = yester.splat(image, np.full((4, 4), 5.0), camera, previous)
    >>> color[0]
    array([nan,  1.,  2.,  3.], dtype=float32)
    """

def pull_push(
    color: ArrayLike,
    quality: ArrayLike | None = None,
    *,
    factor: int = 2,
    levels: int | None = None,
    out: tuple[_Floats | None, _Floats | None] | None = None,
) -> tuple[_Floats, _Floats]:
    """Fill holes from a pyramid of ever coarser images, by pull-push.

    Parameters
    ----------
    color : (H, W) or (H, W, C) array_like of float
        NaN or infinity in a channel makes a hole.
    quality : (H, W) array_like of float, optional
        Weight of each pixel; pixels whose weight is not above 0 and finite are holes. By default 1.
    factor : int, default 2
        Ratio of the sides of successive levels, 2 to 16.
    levels : int, optional
        Number of coarser levels, at least 1. By default down to a single pixel, so that one valid pixel fills all
        holes.
    out : tuple of float32 arrays like the results, optional
        Written and returned instead of new arrays; they may be inputs. A part may be None.

    Returns
    -------
    color : float32 array like `color`
        Valid pixels are unchanged. NaN in holes that no level can fill: with too few levels, or without a valid pixel.
    quality : (H, W) float32
        Unchanged for valid pixels; in filled holes, the lower the coarser the level that filled them; 0 where `color`
        is NaN.

    Raises
    ------
    ValueError
        On wrong shapes, or a factor or number of levels out of range.

    See Also
    --------
    splat : Leaves such holes.
    reconstruct : Fills holes within surfaces.

    Notes
    -----
    Pull: ``c = Σ q c / Σ q``, ``q = Σ q / (n factor²)`` over the n pixels of a block. Push: bilinear interpolation
    weighted by quality, so that near and detailed points override the others. With ``factor=4, levels=2`` the levels
    have 1, 1/4 and 1/16 of the size, as in a developer's diary [1]_, which planned ``factor=2`` next. Pull-push is due
    to Gortler et al. ([2]_, section 3.4).

    References
    ----------
    .. [1] T. Lottes, "Reprojection 2", timothylottes.github.io/20081218.html, 2008.
    .. [2] S. J. Gortler, R. Grzeszczuk, R. Szeliski, M. F. Cohen, "The lumigraph", SIGGRAPH, 1996.

    Examples
    --------
    >>> filled, quality = yester.pull_push([[1.0, np.nan, np.nan, 3.0]])
    >>> filled
    array([[1. , 1.5, 2.5, 3. ]], dtype=float32)
    >>> quality
    array([[1.   , 0.125, 0.125, 1.   ]], dtype=float32)
    """

def recirculate(
    filled: ArrayLike,
    filled_quality: ArrayLike,
    reprojected: ArrayLike,
    reprojected_quality: ArrayLike,
    motion: ArrayLike,
    *,
    blur: float = 0.25,
    share: tuple[float, float] = (0.0, 1.0),
    fade: float = 64.0,
    limit: float = 8.0,
    fetch: bool = False,
    out: tuple[_Floats | None, _Floats | None] | None = None,
) -> tuple[_Floats, _Floats]:
    """Blend the new, hole-filled image with reprojected history by quality, both motion-blurred.

    Parameters
    ----------
    filled : (H, W, 3) array_like of float
        The new image, as `pull_push` returns it.
    filled_quality : (H, W) array_like of float
        Its quality. A pixel is a hole if its quality is not above 0 and finite or its colour is not finite.
    reprojected : (H, W, 3) array_like of float
        Reprojected history, as `splat` returns it. With `fetch`, the previous frame's result.
    reprojected_quality : (H, W) array_like of float
        Its quality.
    motion : (H, W, 2) or (H, W, 3) array_like of float
        Previous minus current position in pixels, as `motion_vectors` returns it; values that are not finite count as
        0.
    blur : float, default 0.25
        Distance of the two outer taps of the motion blur, forwards and backwards, as a fraction of the motion, 0 to 1;
        0 for no blur.
    share : (float, float), default (0.0, 1.0)
        Range to which the weight of the new image is clamped where both are valid, within 0 to 1.
    fade : float, default 64.0
        Length of motion in pixels over which the quality of history falls to a half; above 0.
    limit : float, default 8.0
        Upper bound of the resulting quality; above 0.
    fetch : bool, default False
        `reprojected` and its quality are those of the previous frame and are fetched here, at the end of `motion`;
        outside the image there is no history.
    out : tuple of (H, W, 3) and (H, W) float32 arrays, optional
        Written and returned instead of new arrays; they may be inputs. A part may be None.

    Returns
    -------
    color : (H, W, 3) float32
        NaN where both images are missing.
    quality : (H, W) float32
        For the next frame; 0 where both are missing.

    Raises
    ------
    ValueError
        On wrong shapes, or a parameter out of range.

    See Also
    --------
    pull_push : Fills the holes of the new image.
    splat : Scatters the history to this frame.
    Recirculation : The pipeline that keeps history as points.

    Notes
    -----
    Each image is the mean of three bilinear taps at ``-blur``, 0 and ``blur`` times the motion, over valid pixels. With
    `fetch`, those of history are centred on the position plus the motion, and its quality is one bilinear tap there.
    With ``q = reprojected_quality / (1 + |motion| / fade)`` the weight of the new image is
    ``filled_quality / (filled_quality + q)``, and the resulting quality is ``filled_quality + q``: the more samples a
    pixel has, the less a new one changes it. After a developer's diary [1]_; how quality falls and adds up is our
    choice.

    References
    ----------
    .. [1] T. Lottes, "Reprojection 2", timothylottes.github.io/20081218.html, 2008.

    Examples
    --------
    >>> new, old = np.ones((1, 2, 3)), np.zeros((1, 2, 3))
    >>> color, quality = yester.recirculate(new, [[1.0, 1.0]], old, [[1.0, 3.0]], np.zeros((1, 2, 2)))
    >>> color[..., 0], quality
    (array([[0.5 , 0.25]], dtype=float32), array([[2., 4.]], dtype=float32))
    """

def suppress_fireflies(
    color: ArrayLike,
    *,
    expected: ArrayLike | None = None,
    depth: ArrayLike | None = None,
    normal: ArrayLike | None = None,
    ids: ArrayLike | None = None,
    threshold: float = 2.0,
    radius: int = 4,
    redistribute: bool = True,
    sigma_normal: float = 128.0,
    sigma_depth: float = 0.5,
    sigma_plane: float = 0.05,
    out: tuple[_Floats | None, _Floats | None] | None = None,
) -> tuple[_Floats, _Floats]:
    """Clamp samples far brighter than their surroundings and redistribute the excess.

    Parameters
    ----------
    color : (H, W, 3) array_like of float
        Linear, before demodulation, without emission. Missing pixels stay missing.
    expected : (H, W, 3) array_like of float, optional
        History at the pixel: a sample that history predicts is not a firefly. Values that are not finite count as 0.
    depth : (H, W) array_like of float, optional
        View-space z; +inf, NaN or not above 0 is background.
    normal : (H, W, 3) array_like of float, optional
        World space, unit length.
    ids : (H, W) array_like of int, optional
        Pixels with different ids do not mix.
    threshold : float, default 2.0
        Standard deviations by which a pixel may exceed the mean of its neighbours; at least 0.
    radius : int, default 4
        Radius of the window in pixels, 1 to 16.
    redistribute : bool, default True
        Spread the excess over the window's pixels of the same surface, so that the image does not darken. Without
        guides all of the excess is kept; where normals or depths change within the window, it may become less or more.
    sigma_normal, sigma_depth, sigma_plane : float, default 128.0, 0.5 and 0.05
        As in `atrous`.
    out : tuple of (H, W, 3) and (H, W) float32 arrays, optional
        Written and returned instead of new arrays; they may be inputs. A part may be None.

    Returns
    -------
    color : (H, W, 3) float32
        With the excess clamped, and spread if `redistribute` is set.
    removed : (H, W) float32
        Luminance by which each pixel exceeded its limit.

    Raises
    ------
    ValueError
        On wrong shapes or parameters out of range.

    See Also
    --------
    SVGF : Suppresses fireflies with the option `fireflies`.
    clip_history : Clips history instead of samples.

    Notes
    -----
    Neighbours have the guide weights of `reconstruct`, without the spatial weight. With mean m and standard deviation s
    of the luminance in the window without its centre, the limit is ``max(m + threshold s, (1 + threshold) l)``, l being
    the expected luminance (NRD's anti-firefly [1]_: 9×9 pixels, 2 deviations, no history). There is none where these
    neighbours have a weight below 2 in all. The excess is distributed over the window's pixels, the centre included:
    q's share of p's excess is q's weight of p, divided by the sum of p's weights of all. Weights of surfaces are not
    symmetric, so that the shares do not add up to 1 where surfaces differ.

    References
    ----------
    .. [1] NVIDIA, "NVIDIA Real-Time Denoisers" (ReBLUR, ReLAX), github.com/NVIDIA-RTX/NRD; D. Zhdan, "ReBLUR: a
       hierarchical recurrent denoiser", Ray Tracing Gems II, 2021.

    Examples
    --------
    >>> color = np.full((9, 9, 3), 0.5)
    >>> color[4, 4] = 100
    >>> clamped, removed = yester.suppress_fireflies(color)
    >>> clamped[4, 4]
    array([1.7284, 1.7284, 1.7284], dtype=float32)
    >>> round(float(removed[4, 4]), 2)
    99.5
    >>> bool(np.isclose(clamped.mean(), color.mean()))
    True
    """

def fix_history(
    color: ArrayLike,
    history_length: ArrayLike,
    *,
    depth: ArrayLike | None = None,
    normal: ArrayLike | None = None,
    ids: ArrayLike | None = None,
    max_length: float = 3.0,
    stride: float = 14.0,
    sigma_normal: float = 128.0,
    sigma_depth: float = 0.5,
    sigma_plane: float = 0.05,
    out: _Floats | None = None,
) -> _Floats:
    """Average recently disoccluded pixels over their surface: history fix.

    Parameters
    ----------
    color : (H, W, 3) array_like of float
        Accumulated colour. Missing pixels have weight 0, and those with a short history are filled.
    history_length : (H, W) array_like of float
        History length in samples.
    depth : (H, W) array_like of float, optional
        View-space z; +inf, NaN or not above 0 is background.
    normal : (H, W, 3) array_like of float, optional
        World space, unit length.
    ids : (H, W) array_like of int, optional
        Pixels with different ids do not mix.
    max_length : float, default 3.0
        Histories shorter than this are fixed; at least 0.
    stride : float, default 14.0
        Distance between taps in pixels at history length 0, 1 to 64; at length N it is stride/(1 + N), at least 1.
    sigma_normal, sigma_depth, sigma_plane : float, default 128.0, 0.5 and 0.05
        As in `atrous`.
    out : (H, W, 3) float32 array, optional
        Written and returned instead of a new array; it may be an input.

    Returns
    -------
    color : (H, W, 3) float32
        Fixed pixels are the mean of 5×5 taps, weighted by guide and history length; the others, and those without a
        valid tap, keep their bits.

    Raises
    ------
    ValueError
        On wrong shapes or parameters out of range.

    See Also
    --------
    accumulate : Returns accumulated colour and history length.
    estimate_variance : Widens the filter where history is short.

    Notes
    -----
    Taps lie at multiples of ``max(1, ⌊stride / (1 + N) + ½⌋)`` pixels and have the weights of `reconstruct`, without
    the spatial weight, times their history length: after the history fix of NRD's ReBLUR and ReLAX [1]_. `SVGF` does
    not use it: for short histories its filter, guided by spatial variance, was better on three of four scenes tried,
    and equal on the fourth.

    References
    ----------
    .. [1] NVIDIA, "NVIDIA Real-Time Denoisers" (ReBLUR, ReLAX), github.com/NVIDIA-RTX/NRD; D. Zhdan, "ReBLUR: a
       hierarchical recurrent denoiser", Ray Tracing Gems II, 2021.

    Examples
    --------
    >>> color = np.ones((8, 8, 3))
    >>> color[4, 4] = 9
    >>> length = np.full((8, 8), 10.0)
    >>> length[4, 4] = 1
    >>> yester.fix_history(color, length, stride=2)[4, 4].round(3)
    array([1.033, 1.033, 1.033], dtype=float32)
    """

def reconstruct(
    color: ArrayLike,
    *,
    depth: ArrayLike | None = None,
    normal: ArrayLike | None = None,
    ids: ArrayLike | None = None,
    radius: int = 2,
    sigma: float = 1.0,
    sigma_normal: float = 128.0,
    sigma_depth: float = 0.5,
    sigma_plane: float = 0.05,
    out: _Floats | None = None,
) -> _Floats:
    """Fill missing pixels from neighbours on the same surface.

    Parameters
    ----------
    color : (H, W, 3) array_like of float
        Illumination (see `demodulate`) if there is albedo. Pixels with NaN or infinity are missing.
    depth : (H, W) array_like of float, optional
        View-space z; +inf, NaN or not above 0 is background.
    normal : (H, W, 3) array_like of float, optional
        World space, unit length.
    ids : (H, W) array_like of int, optional
        Pixels with different ids do not mix.
    radius : int, default 2
        Radius of the window in pixels, 1 to 16.
    sigma : float, default 1.0
        Standard deviation of the spatial weight, in pixels; above 0.
    sigma_normal, sigma_depth, sigma_plane : float, default 128.0, 0.5 and 0.05
        As in `atrous`.
    out : (H, W, 3) float32 array, optional
        Written and returned instead of a new array; it may be an input.

    Returns
    -------
    color : (H, W, 3) float32
        Missing pixels become the weighted mean of the window's valid pixels, or NaN where no surface in it is similar;
        the others keep their bits.

    Raises
    ------
    ValueError
        On wrong shapes or parameters out of range.

    See Also
    --------
    joint_bilateral_upsample : Reconstructs from samples on a regular grid.
    pull_push : Fills holes without regard to surfaces.
    HalfRes : A pipeline for frames of which a part is traced.

    Notes
    -----
    The weight of a pixel at a distance of d is ``exp(-d²/(2 sigma²) - en - ez)``, with en and ez as in `atrous`, and
    zero between ids or between surface and background: a joint bilateral filter [1]_ whose samples may lie anywhere.
    Weights below 2⁻⁶⁴ count as 0: without guides, samples from 9.4 sigma on.

    References
    ----------
    .. [1] J. Kopf, M. F. Cohen, D. Lischinski, M. Uyttendaele, "Joint bilateral upsampling", ACM Transactions on
       Graphics 26(3), 2007.

    Examples
    --------
    >>> color = np.ones((1, 4, 3))
    >>> color[0, 1] = np.nan
    >>> color[0, 2:] = 5
    >>> yester.reconstruct(color, ids=[[1, 1, 2, 2]])[0, :, 0]
    array([1., 1., 5., 5.], dtype=float32)
    """

def joint_bilateral_upsample(
    color: ArrayLike,
    *,
    depth: ArrayLike | None = None,
    normal: ArrayLike | None = None,
    ids: ArrayLike | None = None,
    low_depth: ArrayLike | None = None,
    low_normal: ArrayLike | None = None,
    low_ids: ArrayLike | None = None,
    scale: int = 2,
    offset: ArrayLike | None = None,
    radius: int = 2,
    sigma: float = 1.0,
    sigma_normal: float = 128.0,
    sigma_depth: float = 0.5,
    sigma_plane: float = 0.05,
    out: _Floats | None = None,
) -> _Floats:
    """Upsample a low-resolution image along the edges of full-resolution buffers.

    Parameters
    ----------
    color : (⌈H/scale⌉, ⌈W/scale⌉, 3) array_like of float
        One sample for each block of scale×scale pixels; illumination (see `demodulate`) if there is albedo. Pixels with
        NaN or infinity are missing.
    depth : (H, W) array_like of float, optional
        View-space z in full resolution; +inf, NaN or not above 0 is background. One of `depth`, `normal` and `ids` must
        be given: they determine the size.
    normal : (H, W, 3) array_like of float, optional
        World space, unit length.
    ids : (H, W) array_like of int, optional
        Samples with another id have weight 0.
    low_depth, low_normal, low_ids : array_like, optional
        Buffers at the samples, of the size of `color`; by default the full-resolution buffers' values at the pixels
        that contain the samples.
    scale : int, default 2
        Side of a block in pixels, 1 to 16.
    offset : (float, float), optional
        Position of each sample in its block: pixels right and down from the centre of its first pixel, 0 to scale - 1.
        Integers are pixel centres; the default is the block's centre, (scale - 1)/2. A sample between two centres is in
        the later pixel. In blocks that the border cuts, it is moved by whole pixels, into the last one inside.
    radius : int, default 2
        Radius of the window in multiples of `scale` pixels, 1 to 16.
    sigma : float, default 1.0
        Standard deviation of the spatial weight, in multiples of `scale` pixels; above 0.
    sigma_normal, sigma_depth, sigma_plane : float, default 128.0, 0.5 and 0.05
        As in `atrous`.
    out : (H, W, 3) float32 array, optional
        Written and returned instead of a new array.

    Returns
    -------
    color : (H, W, 3) float32
        NaN where no sample in the window is on a similar surface.

    Raises
    ------
    ValueError
        On wrong shapes, sizes that do not fit each other, or parameters out of range.

    See Also
    --------
    reconstruct : Reconstructs from samples at arbitrary pixels.
    resample : Upsamples without guides.

    Notes
    -----
    The mean of the samples in the window, each with the weight ``exp(-d²/(2 (sigma scale)²) - en - ez)`` at a distance
    of d pixels, with en and ez as in `atrous` and zero between ids or between surface and background, or below 2⁻⁶⁴:
    joint bilateral upsampling [1]_, here with geometry as guide instead of colour. `reconstruct` does the same for
    samples at arbitrary pixels. No pipeline uses this function: `HalfRes` takes full-resolution frames with missing
    samples and fills them by `reconstruct`.

    References
    ----------
    .. [1] J. Kopf, M. F. Cohen, D. Lischinski, M. Uyttendaele, "Joint bilateral upsampling", ACM Transactions on
       Graphics 26(3), 2007.

    Examples
    --------
    >>> color = np.array([[[1.0] * 3, [5.0] * 3]])
    >>> ids = np.array([[1, 1, 1, 2], [1, 1, 1, 2]])
    >>> yester.joint_bilateral_upsample(color, ids=ids, low_ids=[[1, 2]])[..., 0]
    array([[1., 1., 1., 5.],
           [1., 1., 1., 5.]], dtype=float32)
    """

def incoherent_guides(
    normal: ArrayLike | None = None,
    ids: ArrayLike | None = None,
    *,
    confidence: ArrayLike | None = None,
    out: NDArray[np.bool_] | None = None,
) -> NDArray[np.bool_]:
    """Find the tiles in which normals and ids guide no filter: grass, fur and wire that are thinner than a pixel.

    Every pixel there shows another surface than its neighbours, and yet another one in the next frame. A filter that
    compares normals and ids finds no samples to average, so that depth alone should guide it, and validate history.

    Parameters
    ----------
    normal : (H, W, 3) array_like of float, optional
        Only directions count; zero and NaN differ from none. Needed without `ids`.
    ids : (H, W) array_like of int, optional
        Ids of objects, meshes or materials.
    confidence : (H, W) array_like of float, optional
        Confidence in history, 0 to 1, as `reproject` returns it. By default, only normals and ids decide.
    out : (H, W) bool array, optional
        Written and returned instead of a new array.

    Returns
    -------
    mask : (H, W) bool
        True in tiles of 16x16 pixels, from the top left, in which more than 0.4 of all pairs of neighbours along x and
        y differ, in id or by more than 25 degrees in normal, and the mean confidence is from 0.1 to below 0.5.

    Raises
    ------
    ValueError
        On wrong shapes, or if neither `normal` nor `ids` is given.
    TypeError
        If `out` has another dtype.

    See Also
    --------
    atrous : Compares normals and ids of neighbours.

    Notes
    -----
    Pebbles and leaves of a few pixels differ as much from their neighbours, but are found again in the next frame, and
    normals then tell how they are shaded: confidence tells them apart. Where no history is found, at a cut or behind
    what moves away, that says nothing of the guides. In these tiles, `SVGF` fetches history again without ids and with
    ``normal_angle=180``, and gives its filter normals of zero and the id 2**32 - 2 for all pixels whose id is not 0.

    Examples
    --------
    >>> ids = np.ones((16, 32), np.uint32)
    >>> ids[:, 16:] = np.random.default_rng(0).integers(1, 9, (16, 16))
    >>> mask = yester.incoherent_guides(ids=ids)
    >>> bool(mask[0, 0]), bool(mask[0, 16])
    (False, True)
    """

@overload
def is_reflectance(
    albedo: ArrayLike,
    ids: ArrayLike,
    *,
    normal: ArrayLike | None = None,
    depth: ArrayLike | None = None,
    out: NDArray[np.bool_] | None = None,
) -> NDArray[np.bool_]:
    """Tell where albedo is a reflectance: surface by surface, from the range of its values.

    Parameters
    ----------
    albedo : (H, W, 3) array_like of float
        As a renderer writes it; not finite counts as 0.
    ids : (H, W) array_like of int, optional
        Pixels with the same id show the same surface.
    normal : (H, W, 3) array_like of float, optional
        Unit vectors. With `depth`, they tell surfaces apart where there are no ids.
    depth : (H, W) array_like of float, optional
        View-space z, +inf where nothing was hit.
    out : (H, W) bool array, optional
        Written and returned instead of a new array.

    Returns
    -------
    mask : (H, W) bool, or None
        True at all pixels of surfaces of which the largest albedo, over pixels and channels, is at least 0.001, and no
        more than one in 64 pixels has an albedo whose largest channel is above 1.25, or not 0 and below 1e-5.
        None if there are no ids and no more than one in 1024 pixels of the image has an albedo out of that range: pass
        it on as `where` of `demodulate` and `remodulate`, whose default it is.

    Raises
    ------
    ValueError
        On wrong shapes.
    TypeError
        If `out` has another dtype.

    See Also
    --------
    demodulate : Takes the mask as `where`.
    material_ids : Ids for frames without, by the mask.

    Notes
    -----
    Renderers write other things under the name of albedo. Mitsuba's integrator ``aov`` gives the value of a BSDF for
    one pair of directions, which on rough metal follows a highlight, from below a millionth to tens. Light that is
    divided by it changes as much from pixel to pixel and from frame to frame. Glass, mirrors, lamps and sky have 0. No
    reflectance is above 1, but reconstruction filters overshoot at edges by a tenth or so. None that is not 0 is below
    1/3295, the darkest value of 8-bit textures, but beside weak highlights a fifth of the pixels and more are
    below 1e-5.

    Without ids, a surface is a region of pixels that are connected through their neighbours in rows and columns. Two
    are connected if their normals differ by less than 26° (a cosine of 0.9) and their depths by less than a fiftieth of
    the smaller one. Without normals or depth there are no regions: where more than one pixel in 1024 is out of range,
    the mask is False everywhere, as small highlights are enough to make albedo harm the whole image.

    Examples
    --------
    >>> albedo = np.array([[[0.5] * 3, [0.0] * 3, [9.0] * 3, [0.2] * 3]])
    >>> yester.is_reflectance(albedo, np.array([[1, 1, 2, 2]]))
    array([[ True,  True, False, False]])
    """

@overload
def is_reflectance(
    albedo: ArrayLike,
    ids: ArrayLike | None = None,
    *,
    normal: ArrayLike | None = None,
    depth: ArrayLike | None = None,
    out: NDArray[np.bool_] | None = None,
) -> NDArray[np.bool_] | None:
    """Tell where albedo is a reflectance: surface by surface, from the range of its values.

    Parameters
    ----------
    albedo : (H, W, 3) array_like of float
        As a renderer writes it; not finite counts as 0.
    ids : (H, W) array_like of int, optional
        Pixels with the same id show the same surface.
    normal : (H, W, 3) array_like of float, optional
        Unit vectors. With `depth`, they tell surfaces apart where there are no ids.
    depth : (H, W) array_like of float, optional
        View-space z, +inf where nothing was hit.
    out : (H, W) bool array, optional
        Written and returned instead of a new array.

    Returns
    -------
    mask : (H, W) bool, or None
        True at all pixels of surfaces of which the largest albedo, over pixels and channels, is at least 0.001, and no
        more than one in 64 pixels has an albedo whose largest channel is above 1.25, or not 0 and below 1e-5.
        None if there are no ids and no more than one in 1024 pixels of the image has an albedo out of that range: pass
        it on as `where` of `demodulate` and `remodulate`, whose default it is.

    Raises
    ------
    ValueError
        On wrong shapes.
    TypeError
        If `out` has another dtype.

    See Also
    --------
    demodulate : Takes the mask as `where`.
    material_ids : Ids for frames without, by the mask.

    Notes
    -----
    Renderers write other things under the name of albedo. Mitsuba's integrator ``aov`` gives the value of a BSDF for
    one pair of directions, which on rough metal follows a highlight, from below a millionth to tens. Light that is
    divided by it changes as much from pixel to pixel and from frame to frame. Glass, mirrors, lamps and sky have 0. No
    reflectance is above 1, but reconstruction filters overshoot at edges by a tenth or so. None that is not 0 is below
    1/3295, the darkest value of 8-bit textures, but beside weak highlights a fifth of the pixels and more are
    below 1e-5.

    Without ids, a surface is a region of pixels that are connected through their neighbours in rows and columns. Two
    are connected if their normals differ by less than 26° (a cosine of 0.9) and their depths by less than a fiftieth of
    the smaller one. Without normals or depth there are no regions: where more than one pixel in 1024 is out of range,
    the mask is False everywhere, as small highlights are enough to make albedo harm the whole image.

    Examples
    --------
    >>> albedo = np.array([[[0.5] * 3, [0.0] * 3, [9.0] * 3, [0.2] * 3]])
    >>> yester.is_reflectance(albedo, np.array([[1, 1, 2, 2]]))
    array([[ True,  True, False, False]])
    """

def material_ids(
    albedo: ArrayLike,
    *,
    normal: ArrayLike | None = None,
    depth: ArrayLike | None = None,
    out: NDArray[np.uint32] | None = None,
) -> NDArray[np.uint32]:
    """Tell kinds of material by albedo: ids for frames that have none.

    Parameters
    ----------
    albedo : (H, W, 3) array_like of float
        As a renderer writes it.
    normal : (H, W, 3) array_like of float, optional
        Unit vectors.
    depth : (H, W) array_like of float, optional
        View-space z, +inf where nothing was hit.
    out : (H, W) uint32 array, optional
        Written and returned instead of a new array.

    Returns
    -------
    ids : (H, W) uint32
        1 where the albedo is no reflectance (`is_reflectance`), 3 where it is white, at least 0.99 in all channels,
        and 2 elsewhere. White counts as 2 in frames in which it is part of textures.

    Raises
    ------
    ValueError
        On wrong shapes.
    TypeError
        If `out` has another dtype.

    See Also
    --------
    is_reflectance : Tells 1 from the others.

    Notes
    -----
    White is how renderers mark glass and mirrors: nothing that scatters light reflects so much. What is seen there has
    nothing to do with the light of the surfaces around, and should not be mixed with it.

    White is part of textures if, of the pairs of neighbours along x and y of which one has 2 and the other 3, more than
    an eighth as many as there are pixels of the rarer kind lie on one surface: their normals differ by less than 26
    degrees, and their depths by less than 2 percent or not at all. Without normals, without depth, or without both,
    what there is decides.

    `SVGF`, `HalfRes` and `BMFR` validate and filter frames without ids by these.

    Examples
    --------
    >>> albedo = np.full((16, 16, 3), 0.5)
    >>> albedo[:, 12:] = 1
    >>> depth = np.full((16, 16), 2.0)
    >>> yester.material_ids(albedo, depth=depth)[0, [0, 12]]
    array([2, 2], dtype=uint32)
    >>> depth[:, 12:] = 3
    >>> yester.material_ids(albedo, depth=depth)[0, [0, 12]]
    array([2, 3], dtype=uint32)
    """

def demodulate(
    color: ArrayLike,
    albedo: ArrayLike,
    *,
    emission: ArrayLike | None = None,
    where: ArrayLike | None = None,
    out: _Floats | None = None,
) -> _Floats:
    """Divide colour by albedo, so that filters see illumination without texture.

    Parameters
    ----------
    color : (H, W, 3) array_like of float
        Linear. NaN and infinity are kept.
    albedo : (H, W, 3) array_like of float
        Reflectance, held to 0 to 1; not finite counts as 0.
    emission : (H, W, 3) array_like of float, optional
        Light that the visible surface sends out itself; not finite counts as 0.
    where : (H, W) array_like of bool, optional
        Where the albedo is a reflectance (`is_reflectance`); by default, where it is not 0 in all channels.
    out : (H, W, 3) float32 array, optional
        Written and returned instead of a new array; it may be an input.

    Returns
    -------
    illumination : (H, W, 3) float32
        ``(color - emission) / d``; d is the albedo, at least 1/32, and 1 where the albedo is no reflectance.

    Raises
    ------
    ValueError
        On wrong shapes.

    See Also
    --------
    remodulate : Multiplies by albedo again.
    is_reflectance : Tells `where`.

    Notes
    -----
    With a the albedo of a channel, ``d = max(a, 1/32)``; where it is no reflectance, ``d = 1``. Lamps, sky, glass,
    mirrors and black plastic have an albedo near 0, which does not scale their light. Divided by it, the light would be
    a thousand times too bright, and filters would leak the excess to neighbouring surfaces. There is no smooth passage
    between both, as it blurs dark texture, and where an albedo changes with the view, the light changes as much.

    `remodulate` is the inverse. Where d is 1, the round trip without emission is exact; elsewhere it
    is exact to one or two units in the last place. After SVGF ([1]_, section 4); its implementation in Falcor [2]_
    divides by ``max(a, 0.001)``.

    References
    ----------
    .. [1] C. Schied, A. Kaplanyan, C. Wyman, A. Patney, C. R. A. Chaitanya, J. Burgess, S. Liu, C. Dachsbacher, A.
       Lefohn, M. Salvi, "Spatiotemporal variance-guided filtering: real-time reconstruction for path-traced global
       illumination", High-Performance Graphics, 2017.
    .. [2] NVIDIA, "Falcor", github.com/NVIDIAGameWorks/Falcor, render pass SVGFPass.

    Examples
    --------
    >>> color = np.full((1, 2, 3), 0.1)
    >>> albedo = np.array([[[0.2] * 3, [0.0] * 3]])
    >>> yester.demodulate(color, albedo)[..., 0]
    array([[0.5, 0.1]], dtype=float32)
    """

def remodulate(
    illumination: ArrayLike,
    albedo: ArrayLike,
    *,
    emission: ArrayLike | None = None,
    where: ArrayLike | None = None,
    out: _Floats | None = None,
) -> _Floats:
    """Multiply illumination by albedo and add emission.

    Parameters
    ----------
    illumination : (H, W, 3) array_like of float
        As `demodulate` returns it.
    albedo : (H, W, 3) array_like of float
        Reflectance, held to 0 to 1; not finite counts as 0.
    emission : (H, W, 3) array_like of float, optional
        Light that the visible surface sends out itself; not finite counts as 0.
    where : (H, W) array_like of bool, optional
        Where the albedo is a reflectance (`is_reflectance`); by default, where it is not 0 in all channels.
    out : (H, W, 3) float32 array, optional
        Written and returned instead of a new array; it may be an input.

    Returns
    -------
    color : (H, W, 3) float32
        ``illumination * d + emission``, with d as in `demodulate`.

    Raises
    ------
    ValueError
        On wrong shapes.

    See Also
    --------
    demodulate : Divides by albedo.

    Examples
    --------
    >>> albedo = np.full((1, 1, 3), 0.5)
    >>> yester.remodulate(np.full((1, 1, 3), 0.2), albedo, emission=np.ones((1, 1, 3)))
    array([[[1.1, 1.1, 1.1]]], dtype=float32)
    """

def smooth_edges(
    color: ArrayLike,
    *,
    newest: ArrayLike | None = None,
    confidence: ArrayLike | None = None,
    exposure: float = 1.0,
    out: _Floats | None = None,
) -> _Floats:
    """Smooth an image along its edges: antialiasing of denoised frames.

    Parameters
    ----------
    color : (H, W, 3) array_like of float
        Linear. Pixels with NaN or infinity are missing: they and all within four pixels keep their bits.
    newest : (H, W, 3) array_like of float, optional
        The frame that was merged into `color` last, if that is an average over frames: straight edges show 15 % more of
        it. Its missing pixels have no share.
    confidence : (H, W) array_like of float, optional
        What is known of the history of a pixel's surface, from 0 (nothing) to 1 (all, as without this image), as
        denoisers return it. Less known is smoothed more, even if its edge is not straight. NaN counts as 0.
    exposure : float, default 1.0
        The radiance that counts as 1, above 0, as `exposure` returns it.
    out : (H, W, 3) float32 array, optional
        Written and returned instead of a new array; it may be an input.

    Returns
    -------
    color : (H, W, 3) float32
        Pixels on straight edges are averaged with four others on the edge; pixels on no edge keep their bits.

    Raises
    ------
    ValueError
        On wrong shapes or an exposure out of range.

    See Also
    --------
    morphological_aa : Antialiasing of images without noise.
    TAA : Antialiasing over time, with the option `smooth_edges`.

    Notes
    -----
    In a denoised frame of one sample per pixel, a pixel of an edge shows either of two surfaces by chance. Let g be the
    gradient of the tone ``l / (l + e)``, of the luminance ``l >= 0`` and the exposure e (central differences, averaged
    by ``{1, 2, 1}/4`` across), ``[[a, b], [b, d]]`` the mean of ``g gᵀ`` by binomial weights over 7×7 pixels (the
    structure tensor [1]_), and ``R = sqrt((a - d)² + 4b²)``. The edge goes from row to row by ``-2b / (a - d + R)``
    columns where ``a > d``, else from column to column by ``-2b / (d - a + R)`` rows. Taps v are one and two rows (or
    columns) before and after, interpolated by a Catmull-Rom spline within the range of its four pixels, and weigh
    ``{1, 4, 6, 4, 1}`` times ``1 / (1 + l(v) / 2e)``. With m their weighted mean, the pixel v becomes
    ``v + s (m - v)``, where::

        s = max(0, 16 t - 1) / 15
        t = clip((a + d) / 3e-5 - 1, 0, 1) * (u + (1 - u) (R / (a + d))**4) / (1 + (l_max / 12e)²)
        u = 0.75 (1 - confidence)

    and l_max is the largest luminance of 3×3 pixels. ``R / (a + d)``, the coherence [2]_, is 1 on a straight edge and
    less in corners, on crossings and in noise; near lamps far brighter than the frame, a small error is large for the
    dark beside them. Borders are replicated.

    An average over frames lags and has been resampled in each; as the line takes noise away, the newest frame n can
    count for more. Each pixel c on the line of a pixel with the share s is then taken as
    ``c + 0.15 s (R / (a + d))**4 (n - c)``, and v is interpolated, too. The ranges stay those of `color`.

    References
    ----------
    .. [1] J. Bigün, G. H. Granlund, "Optimal orientation detection of linear symmetry", ICCV, 1987.
    .. [2] J. E. Kyprianidis, H. Kang, "Image and video abstraction by coherence-enhancing filtering", Computer Graphics
       Forum 30(2), 2011.

    Examples
    --------
    >>> color = np.zeros((9, 9, 3))
    >>> color[:, 5:] = 1
    >>> color[:, 4] = np.array([0.75, 0.25, 0.75, 0.25, 0.75, 0.25, 0.75, 0.25, 0.75])[:, None]
    >>> yester.smooth_edges(color)[3:6, 4, 0].round(2)
    array([0.47, 0.48, 0.47], dtype=float32)
    """

def morphological_aa(
    color: ArrayLike, *, threshold: float = 0.1, max_length: int = 16, out: _Floats | None = None
) -> _Floats:
    """Smooth jagged edges in a single image: morphological antialiasing.

    Parameters
    ----------
    color : (H, W, 3) array_like of float
        Linear. Pixels with NaN or infinity are missing: they have no edges and stay missing.
    threshold : float, default 0.1
        Difference in perceived brightness, ``sqrt(l / (1 + l))`` of the Rec. 709 luminance ``l >= 0``, above which the
        boundary of two pixels is part of an edge; finite, at least 0.
    max_length : int, default 16
        Search distance to each side for the end of an edge's step, in pixels, 1 to 128.
    out : (H, W, 3) float32 array, optional
        Written and returned instead of a new array; it may be an input.

    Returns
    -------
    color : (H, W, 3) float32
        Pixels that an edge crosses are mixed with the neighbours beyond the edge; the others keep their bits.

    Raises
    ------
    ValueError
        On wrong shapes or parameters out of range.

    See Also
    --------
    TAA : Antialiasing over time.
    smooth_edges : Antialiasing of denoised frames.
    resolve : Antialiasing from several jittered frames.

    Notes
    -----
    A separation line is a maximal sequence of n boundaries between two rows (or columns) that are discontinuities, with
    the brighter pixels on one side. If at one of its ends exactly one of the two pairs of pixels, above or below,
    differs across the end, the edge starts there, half a pixel above or below, and goes straight to the line's middle:
    the shapes L (one end), Z and U (both). At distance d from that end it cuts off the area ``(n - 2d - 1)/(2n)`` of
    the pixel, in the middle of an odd n ``1/(8n)``, beyond it 0. A line is cut at `max_length`; it has no shape at an
    end that was cut or lies at the image's border.

    Of rows and columns the direction counts that has the pixel's largest area, or half of each where these are equal.
    The result is ``(1 - Σ area) · own + Σ area · neighbour``. The original [1]_ is changed in two points: the side of
    the brighter pixels separates the two edges of thin lines, and choosing a direction avoids blending the steps of a
    slanted edge twice.

    References
    ----------
    .. [1] A. Reshetov, "Morphological antialiasing", High-Performance Graphics, 2009.

    Examples
    --------
    >>> color = np.zeros((4, 8, 3))
    >>> color[2:] = 1
    >>> color[1, 4:] = 1
    >>> yester.morphological_aa(color)[..., 0]
    array([[0.   , 0.   , 0.   , 0.   , 0.   , 0.   , 0.   , 0.   ],
           [0.   , 0.   , 0.125, 0.375, 0.625, 0.875, 1.   , 1.   ],
           [1.   , 1.   , 1.   , 1.   , 1.   , 1.   , 1.   , 1.   ],
           [1.   , 1.   , 1.   , 1.   , 1.   , 1.   , 1.   , 1.   ]], dtype=float32)
    """

def machine_limits() -> tuple[float, float]:
    """Measure the roofline of this machine, with the current threads and instruction set.

    Returns
    -------
    bandwidth : float
        Bytes per second that a copy reads and writes.
    arithmetic : float
        Multiply-adds per second.
    """

def settings() -> tuple[int, str]:
    """Return the number of threads and the instruction set of the kernels.

    Returns
    -------
    threads : int
        Those of the machine, unless lowered by ``YESTER_THREADS``.
    level : str
        The best that the machine has, unless lowered by ``YESTER_SIMD``.
    """
