"""One frame's buffers, converted to canonical form and validated."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._core import Camera, canonical
from .tensors import as_array, shared

#: The buffers of a frame in canonical order.
BUFFERS = (
    *("color", "albedo", "normal", "depth", "motion", "ids", "position", "emission"),
    *("object_normal", "replay", "hit_distance", "reactive", "motion_next"),
)


@dataclass(frozen=True, init=False, repr=False, eq=False)
class Frame:
    """The noisy colour of one frame and its auxiliary buffers.

    Every buffer but `color` is optional. float32 arrays and CPU tensors (of torch, Mitsuba or any library with DLPack)
    in C order are kept as they are, without a copy; float16, float64 and other strides are converted once. The
    attributes are read-only, the arrays are not; ``dataclasses.replace(frame, albedo=None)`` makes another frame.

    Parameters
    ----------
    color : (H, W, 3) array_like of float
        Linear, scene-referred, unclamped. Samples with NaN or infinity count as missing.
    albedo : (H, W, 3) array_like of float, optional
        Reflectance of the visible surface, 0 to 1; zeros where nothing was hit.
    normal : (H, W, 3) array_like of float, optional
        World space, unit length; zeros where nothing was hit.
    depth : (H, W) array_like of float, optional
        Distance along the camera axis in scene units; +inf, or not above 0, where nothing was hit.
    motion : (H, W, 2) or (H, W, 3) array_like of float, optional
        Previous minus current position in pixels, x right, y down, jitter removed. The third channel, if given, is
        previous minus current depth, which makes the depth tests exact under motion. Unknown where it is not finite,
        or zero where nothing was hit; there, the pipelines take the motion of the still scene, if the cameras of both
        frames tell it. With 3 channels, pipelines search every fourth row for unknown motion, and the whole image if
        they find any.
    ids : (H, W) array_like of int, optional
        Object, mesh or material; 0 where nothing was hit. An object may also have id 0, provided that none has 2³² - 1.
    position : (H, W, 3) array_like of float, optional
        World space; not finite where nothing was hit.
    emission : (H, W, 3) array_like of float, optional
        Emission of the visible surface: the part of `color` without noise.
    object_normal : (H, W, 3) array_like of float, optional
        Normals in object space, where they do not rotate with the object; zeros where nothing was hit.
    replay : (H, W, 3) array_like of float, optional
        Correlated re-render of the previous frame: its camera and random numbers, but this frame's scene. Its
        difference from the previous colour is the change of light, without noise. NaN where another surface is visible.
    hit_distance : (H, W) array_like of float, optional
        Distance from the surface to the reflected object, +inf for the environment.
    reactive : (H, W) array_like of float, optional
        Excludes history in `Upscaler`: 0 (use all of it) to 1 (use none). For pixels that do not move along their
        motion vectors, such as particles, glass and animated textures.
    motion_next : (H, W, 2) or (H, W, 3) array_like of float, optional
        Next minus current position in pixels, and depth, as `motion` has them for the previous frame. Only `denoise`
        uses it, which looks at later frames, too.
    camera : Camera, optional
        The camera of this frame, without jitter, of the same size.
    jitter : (2,) array_like of float, optional
        Offset of this frame's samples from their pixel centres, in pixels from -0.5 to 0.5, x right, y down, as
        `yester.jitter` returns it. Stored as a tuple.

    Raises
    ------
    TypeError
        If an array has another element type, or `camera` is not a `Camera`.
    ValueError
        If an array or the camera has another shape than the above, or another size than `color`; if `jitter` lies
        outside the pixel.

    See Also
    --------
    yester.io.read_exr : Reads a frame from a file.
    SVGF : Denoises a sequence of frames.

    Notes
    -----
    Pipelines check the convention of `motion` at a sequence's second frame: against the motion of the cameras, if these
    and depth or position are known, otherwise by fetching the first frame's albedo and normals (or else its colour)
    along it. If another convention fits clearly better (y up, the opposite direction, normalised device coordinates
    from -1 to 1, or fractions of the image's sides from 0 to 1), they emit a `UserWarning` with the factor to multiply
    by. `check` is the thorough form, for all buffers.

    Examples
    --------
    >>> import dataclasses
    >>> frame = yester.Frame(np.ones((4, 6, 3)), depth=np.full((4, 6), 2.0))
    >>> frame
    Frame(6x4: color, depth)
    >>> frame.depth.dtype
    dtype('float32')
    >>> dataclasses.replace(frame, depth=None)
    Frame(6x4: color)
    """

    color: NDArray[np.float32]
    albedo: NDArray[np.float32] | None
    normal: NDArray[np.float32] | None
    depth: NDArray[np.float32] | None
    motion: NDArray[np.float32] | None
    ids: NDArray[np.uint32] | None
    position: NDArray[np.float32] | None
    emission: NDArray[np.float32] | None
    object_normal: NDArray[np.float32] | None
    replay: NDArray[np.float32] | None
    hit_distance: NDArray[np.float32] | None
    reactive: NDArray[np.float32] | None
    motion_next: NDArray[np.float32] | None
    camera: Camera | None
    jitter: tuple[float, float] | None

    def __init__(
        self,
        color: ArrayLike,
        *,
        albedo: ArrayLike | None = None,
        normal: ArrayLike | None = None,
        depth: ArrayLike | None = None,
        motion: ArrayLike | None = None,
        ids: ArrayLike | None = None,
        position: ArrayLike | None = None,
        emission: ArrayLike | None = None,
        object_normal: ArrayLike | None = None,
        replay: ArrayLike | None = None,
        hit_distance: ArrayLike | None = None,
        reactive: ArrayLike | None = None,
        motion_next: ArrayLike | None = None,
        camera: Camera | None = None,
        jitter: ArrayLike | None = None,
    ) -> None:
        given = dict(
            color=color,
            albedo=albedo,
            normal=normal,
            depth=depth,
            motion=motion,
            ids=ids,
            position=position,
            emission=emission,
            object_normal=object_normal,
            replay=replay,
            hit_distance=hit_distance,
            reactive=reactive,
            motion_next=motion_next,
        )
        size = None
        for name, value in given.items():
            array = None
            if value is not None or name == "color":
                # Not one of numpy's subclasses, which index and multiply in other ways.
                array = np.asarray(canonical(shared(value, name), name, size))
                size = array.shape[:2]
            object.__setattr__(self, name, array)
        if camera is not None and not isinstance(camera, Camera):
            raise TypeError(f"camera: expected a yester.Camera, got {type(camera).__name__}")
        if camera is not None and (camera.height, camera.width) != size:
            raise ValueError(f"camera: expected height and width {size}, got {(camera.height, camera.width)}")
        object.__setattr__(self, "camera", camera)
        object.__setattr__(self, "jitter", None if jitter is None else _offset(jitter))

    def __repr__(self) -> str:
        names = [*self.buffers(), *(name for name in ("camera", "jitter") if getattr(self, name) is not None)]
        return f"Frame({self.width}x{self.height}: {', '.join(names)})"

    @property
    def height(self) -> int:
        """Rows of pixels."""
        return int(self.color.shape[0])

    @property
    def width(self) -> int:
        """Columns of pixels."""
        return int(self.color.shape[1])

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        return self.height, self.width

    def buffers(self) -> dict[str, NDArray[np.float32] | NDArray[np.uint32]]:
        """Collect the arrays that were given.

        Returns
        -------
        dict of str to ndarray
            By name, in canonical order.

        Examples
        --------
        >>> [*yester.Frame(np.ones((2, 2, 3)), depth=np.ones((2, 2))).buffers()]
        ['color', 'depth']
        """
        return {name: array for name in BUFFERS if (array := getattr(self, name)) is not None}


def alike(frames: Iterable[Frame]) -> Iterator[Frame]:
    """The frames, of which each must be a `Frame` of the first one's size."""
    shape: tuple[int, int] | None = None
    for number, frame in enumerate(frames):
        if not isinstance(frame, Frame):
            got = f"{type(frame).__name__} at {number}"
            raise TypeError(f"frames: expected yester.Frame, got {got}: pass yester.Frame(color) for an image")
        shape = shape or frame.shape
        if frame.shape != shape:
            expected = f"height {shape[0]} and width {shape[1]}, as in earlier frames"
            got = f"height {frame.height} and width {frame.width} at {number}"
            raise ValueError(f"frames: expected {expected}, got {got}")
        yield frame


def turned(frame: Frame) -> Frame:
    """The frame as one of the reversed sequence."""
    return replace(frame, motion=frame.motion_next, motion_next=None, replay=None)


def present(frame: Frame) -> NDArray[np.float32]:
    """The colour of a frame with zeros for missing samples, for methods that do not accept NaN."""
    return np.where(np.isfinite(frame.color).all(-1, keepdims=True), frame.color, np.float32(0))


def _offset(jitter: ArrayLike) -> tuple[float, float]:
    """Validate a jitter offset."""
    offset = as_array(jitter, "jitter")
    if offset.dtype.kind not in "fiu":
        raise TypeError(f"jitter: expected floats, got {offset.dtype}")
    if offset.shape != (2,):
        raise ValueError(f"jitter: expected shape (2,), got {offset.shape}")
    if not (np.abs(offset) <= 0.5).all():
        raise ValueError(f"jitter: expected offsets from -0.5 to 0.5, got {offset.tolist()}")
    return float(offset[0]), float(offset[1])
