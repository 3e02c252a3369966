"""The tasks of `yester bench`: every kernel and pipeline, and their input images.

The images are two consecutive frames of a small ray-cast scene, one sample per pixel, with a camera motion of a few
pixels; the history is accumulated up to the first of them. A tenth of the pixels, in blocks, have short histories, so
that kernels for short histories have as much work as after fast motion.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import yester
from yester import Camera, Frame

from ..compare.methods import quarter
from ..synthetic import raycast
from ..synthetic.raycast import Light, Scene, Thing

__all__ = ["TASKS", "Call", "Inputs", "Task", "stage"]

#: The images of a frame; those of the previous frame are named `previous_albedo` and so on.
_FRAME = ("albedo", "normal", "depth", "motion", "ids")
#: The arrays of a pipeline's output; some are optional.
_MADE = ("color", "variance", "choice", "history_length", "confidence", "rejection")
#: Period of the frames' noise. With a period of two, history would already contain every new sample, and reflections
#: would be tested in many more tiles.
_TURNS = 8
#: Rows that are ray-cast at a time; few enough to stay in cache.
_BAND = 32


class Call(NamedTuple):
    """A function to time.

    Attributes
    ----------
    run : callable
    bytes : int
        Bytes of all input and output images; 0 if unknown.
    made : int
        Bytes of the output images.
    """

    run: Callable[[], object]
    bytes: int = 0
    made: int = 0


@dataclass(frozen=True)
class Task:
    """A kernel or a pipeline in one of its variants.

    Attributes
    ----------
    name : str
    function : str
        Name in `yester` and in the torch references.
    images : dict of str to (str or list of str)
        By argument, the name of its images in `Inputs`.
    options : dict, default none
        Other arguments.
    rivals : tuple of str, default none
        Keys of `rivals.RIVALS`. The torch reference is a rival of every task.
    multiply_adds : float, optional
        Minimal number per pixel; None if not counted. The limit is the issue rate of vector instructions times lanes.
        Every vector instruction (addition, multiplication, comparison, select, shift) counts as a multiply-add, and so
        do divisions and roots, although they take longer. Loads and stores are not counted.
    jitter : (float, float), optional
        The jitter of the frames, for pipelines that use it.
    reference : bool, default True
        False if no torch reference is timed, because there is none, or because it takes 20 GB of memory at 1920×1080.
    """

    name: str
    function: str
    images: Mapping[str, str | list[str]] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    rivals: tuple[str, ...] = ()
    multiply_adds: float | None = None
    jitter: tuple[float, float] | None = None
    reference: bool = True

    @property
    def pipeline(self) -> bool:
        """Whether the function is a pipeline, which takes frames and keeps history."""
        return isinstance(getattr(yester, self.function), type)

    def frames(self, inputs: Inputs) -> list[Frame]:
        """The input frames of a pipeline, which are repeated endlessly."""
        frames = inputs.frames(self.jitter)
        match self.function:
            case "HalfRes":
                return [quarter(frame, i) for i, frame in enumerate(frames)]
            case "Upscaler":
                return [_halved(frame) for frame in frames]
        return frames

    def arguments(self, inputs: Inputs) -> dict[str, Any]:
        """The keyword arguments of a kernel."""
        images = {
            name: [inputs[one] for one in source] if isinstance(source, list) else inputs[source]
            for name, source in self.images.items()
        }
        return {**images, **self.options}

    def start(self, inputs: Inputs, frames: Sequence[Frame] = ()) -> Call:
        """Prepare for timing: results overwrite the previous call's arrays, so that no memory is allocated.

        The frames of a pipeline are those of `Task.frames` unless others are given.
        """
        if self.pipeline:
            state, turns = getattr(yester, self.function)(**self.options), cycle(frames or self.frames(inputs))
            # Warm up first: the first step has no history, and short histories are slower than the steady state.
            frame = next(turns)
            output, buffers = state.step(frame), frame.buffers()
            for _ in range(_TURNS):
                output = state.step(next(turns), out=output)
            used = [buffers[name] for name in {"color", *output.used} & buffers.keys()]
            made = _bytes([getattr(output, name) for name in _MADE])
            return Call(lambda: state.step(next(turns), out=output), _bytes(used) + made, made)
        function, given = getattr(yester, self.function), self.arguments(inputs)
        result = function(**given)
        if isinstance(result, yester.Accumulated):
            result = result.color, result.moments, result.history_length
        # Numbers are not written again.
        match result:
            case float():
                out = {}
            case (float(), array):
                out = {"out": array}
            case _:
                out = {"out": result}
        return Call(partial(function, **given, **out), _bytes(given.values()) + _bytes([result]), _bytes([result]))


def _halved(frame: Frame) -> Frame:
    """The frame at half the size, as input of `Upscaler`."""
    buffers: dict[str, Any] = {name: buffer[::2, ::2] for name, buffer in frame.buffers().items()}
    buffers["motion"] = buffers["motion"] / np.array([2, 2, 1][: buffers["motion"].shape[-1]], np.float32)
    height, width, _ = buffers["color"].shape
    camera = Camera(frame.camera.world_to_clip, width, height) if frame.camera else None
    return Frame(**buffers, camera=camera, jitter=frame.jitter)


def _bytes(values: Iterable[Any]) -> int:
    """The size of all arrays, including those in lists and tuples."""
    total = 0
    for value in values:
        if isinstance(value, list | tuple):
            total += _bytes(value)
        elif isinstance(value, np.ndarray):
            total += value.nbytes
    return total


def _named(*names: str, **others: str | list[str]) -> dict[str, str | list[str]]:
    """Arguments that have the name of their image, and others."""
    return {name: name for name in names} | others


_SURFACE = ("depth", "normal", "ids")
_TESTS = (*_SURFACE, "previous_depth", "previous_normal", "previous_ids", "previous_camera")
_MOVED = _named("camera", "previous_camera", geometry="depth")
_FETCH = _named("history", "motion")
_TESTED = _named("history", "motion", *_TESTS)
_MERGE = _named("color", "history", "history_moments", "history_length")
_COMBINE = {
    **_named("history_length", color="history", moments="history_moments"),
    **_named(other_color="previous_color", other_moments="history_moments", other_length="history_length"),
}
_BLEND = _named("color", "history", alpha="confidence")
_SPLAT = _named("camera", "previous_camera", color="previous_color", depth="previous_depth")
_RECIRCULATE = {
    **_named("motion", filled="color", filled_quality="confidence"),
    **_named(reprojected="history", reprojected_quality="history_length"),
}
_SMOOTH = _named("color", "variance", *_SURFACE)

_LINEAR, _CUBIC, _LANCZOS = (f"OpenCV remap, {name}" for name in ("linear", "cubic", "Lanczos4"))
_BILINEAR, _BICUBIC = (f"torch grid_sample, {name}" for name in ("bilinear", "bicubic"))
_MOMENTS = "OpenCV blur + sqrBoxFilter"
_WINDOWS = ("OpenCV joint bilateral, 5x5", "OpenCV guided filter, 5x5")
_NETWORKS = ("OIDN fast", "OIDN balanced", "OIDN high")

_TEXTBOOK: dict[str, Any] = {"box": "minmax", "space": "rgb", "response": "clamp"}
_HULL: dict[str, Any] = {"box": "exact-hull", "response": "current"}
_UNMAPPED: dict[str, Any] = {"filter": "catmull-rom-5", "dilate": "3x3", "box": "variance", "space": "ycocg"}
_PUBLISHED: dict[str, Any] = {
    **{"radius": 2, "sigma_luminance": 4.0, "relative_noise": math.inf, "tap_exposure": math.inf},
    **{"sigma_normal": 128.0, "feedback": True, "reflections": ()},
    **dict.fromkeys(("gradient", "fireflies", "choice", "innovation", "antialias", "coherence"), False),
}

# Vector operations per pixel as `Task.multiply_adds` counts them, read from the kernels.
#
# Exponent of a tap. Normals: 8 for the squared distance, 2 to scale and subtract it. Depth: 3 for the distance from the
# plane, 3 to scale and subtract it. Class: 2. The plane at a row of taps: 2.
_GUIDED, _ROW = 10 + 6 + 2, 2
# The centre: the scales of normals and depth.
_CENTER = 12
# 3 to split the exponent, 10 for the polynomial, 2 to combine both, 2 to find zero weights.
_EXP2 = 17


def _pass(side: int) -> int:
    """An à-trous pass with `side` × `side` taps; the centre, with which the sums start, is not computed as a tap.

    Per tap 4 for luminance and 10 to add weight, colour and variance; per pixel 30 for the blurred deviation and its
    reciprocal, 2 for a missing centre, 17 to divide the sums and for the luminance of the result.
    """
    return (side * side - 1) * (_GUIDED + 4 + _EXP2 + 10) + side * _ROW + _CENTER + 30 + 2 + 17


# What lets brighter taps weigh less in a pass of `side` × `side` taps: 4 per tap, 2 per pixel.
def _dim(side: int) -> int:
    return (side * side - 1) * 4 + 2


# Before the first pass and after the last, missing samples and background are found and replaced. Of pipelines, only
# this and the passes are counted.
_AROUND = 22 + 23 + 4
# Temporal variance: 11. Spatial variance, for the tenth of the pixels with a short history: 49 taps, each with 5 to
# weight the moments and 8 to add them.
_ESTIMATE = 11 + 0.1 * (49 * (_GUIDED + _ROW + _EXP2 + 13) + _CENTER + 12)
# Colour conversion 24 for each of two colours; statistics along columns 86, across them 76; the box 19, clipping to it
# 52, and 8 back to RGB.
_CLIP = 2 * 24 + 86 + 76 + 19 + 52 + 8
# The optional blend by alpha: 16 to find missing samples, 22 to blend.
_MIX = 16 + 22

TASKS = (
    Task("motion_vectors", "motion_vectors", _MOVED),
    Task("virtual_motion", "virtual_motion", {**_MOVED, "hit_distance": "hit_distance"}),
    Task("depth_change", "depth_change", _named("depth", "previous_depth", "motion")),
    Task("dilate_motion", "dilate_motion", _named("motion", "depth")),
    Task("invert_motion", "invert_motion", _named("motion", "depth", still="motion")),
    Task("disocclusion", "disocclusion", _named("depth", "motion")),
    Task("thin_features", "thin_features", _named("color")),
    Task("reproject, nearest", "reproject", _FETCH, {"filter": "nearest"}),
    Task("reproject, bilinear", "reproject", _FETCH, rivals=(_LINEAR, _BILINEAR)),
    Task("reproject, bilinear, tested", "reproject", _TESTED),
    Task("reproject, catmull-rom", "reproject", _FETCH, {"filter": "catmull-rom"}, (_CUBIC, _BICUBIC)),
    Task("reproject, catmull-rom, tested", "reproject", _TESTED, {"filter": "catmull-rom"}),
    Task("reproject, catmull-rom-5", "reproject", _FETCH, {"filter": "catmull-rom-5"}, (_CUBIC, _BICUBIC)),
    Task("reproject, lanczos-2", "reproject", _FETCH, {"filter": "lanczos-2"}, (_LANCZOS,)),
    Task("splat", "splat", _SPLAT),
    Task("pull_push, of 1/16", "pull_push", {"color": "sparse"}),
    Task("consistency", "consistency", _named("motion", *_TESTS)),
    Task("clip_history, variance", "clip_history", _named("history", "color"), {}, (_MOMENTS,), _CLIP),
    Task("clip_history, blended", "clip_history", _BLEND, {}, (_MOMENTS,), _CLIP + _MIX),
    Task("clip_history, minmax", "clip_history", _named("history", "color"), _TEXTBOOK, ("OpenCV erode + dilate",)),
    Task("clip_history, hull", "clip_history", _named("history", "color"), _HULL | {"box": "hull"}),
    Task("clip_history, exact hull", "clip_history", _named("history", "color"), _HULL, reference=False),
    Task("exposure", "exposure", _named("color")),
    Task("light_change", "light_change", _named("color", history="previous_color")),
    Task("repetition", "repetition", _named("color", "motion", previous="previous_color")),
    Task("material_change", "material_change", _named("albedo", "motion", previous_albedo="color")),
    Task("alternation", "alternation", _named("color")),
    Task("anti_lag", "anti_lag", _named("history_length", "history", clipped="previous_color")),
    Task("temporal_gradient", "temporal_gradient", _named("color", previous="history")),
    Task("innovation", "innovation", _named("color", "history_length", "motion", prediction="history")),
    Task("choice, of 5", "choice", _named("evidence", "motion", coverage="confidence"), {"usual": 3}),
    Task("compare_candidates, 5", "compare_candidates", _named("color", "candidates", "evidence"), {"usual": 3}),
    Task("collocate", "collocate", {"planes": "planes", "evidence": "products"}),
    Task("collocation_shares", "collocation_shares", _named("motion", coverage="confidence", evidence="products")),
    Task("prediction_gain", "prediction_gain", _named("color", "ids", candidate="history", base="previous_color")),
    Task("blend_factor", "blend_factor", _named("confidence", "motion")),
    Task("blend", "blend", _BLEND),
    Task("accumulate", "accumulate", _MERGE),
    Task("accumulate, with gradient", "accumulate", {**_MERGE, "gradient": "confidence"}),
    Task("combine_histories", "combine_histories", _COMBINE),
    Task("converge", "converge", _named("color", "history_length", mean="history", moments="history_moments")),
    Task("recirculate", "recirculate", _RECIRCULATE),
    Task("resolve, 2 samples", "resolve", {"samples": ["color", "history"]}, {"offsets": yester.jitter(2).tolist()}),
    Task("resample, twice the size", "resample", {"image": "color", "size": "doubled"}),
    Task("sharpen", "sharpen", _named("color")),
    Task("suppress_fireflies", "suppress_fireflies", _named("color")),
    Task("fix_history", "fix_history", _named("color", "history_length", *_SURFACE)),
    Task(
        "estimate_variance",
        "estimate_variance",
        _named("history_length", *_SURFACE, moments="history_moments"),
        multiply_adds=_ESTIMATE,
    ),
    Task("atrous, 1 pass", "atrous", _SMOOTH, {"iterations": 1}, _WINDOWS, _AROUND + _pass(5)),
    Task("atrous, 5 passes", "atrous", _SMOOTH, {"iterations": 5}, (), _AROUND + 5 * _pass(5)),
    Task("atrous, 5 passes, predicted", "atrous", {**_SMOOTH, "prediction": "predicted"}, {"iterations": 5}),
    Task("atrous, 5 passes of 3x3", "atrous", _SMOOTH, {"iterations": 5, "radius": 1}, (), _AROUND + 5 * _pass(3)),
    Task(
        "restore_detail",
        "restore_detail",
        {"smooth": "history", "noisy": "color", "variance": "variance"},
    ),
    Task("reconstruct", "reconstruct", _named(*_SURFACE, color="traced")),
    Task(
        "joint_bilateral_upsample",
        "joint_bilateral_upsample",
        _named(*_SURFACE, color="low"),
        {"offset": (0, 0)},
    ),
    Task("incoherent_guides", "incoherent_guides", _named("normal", "ids", "confidence")),
    Task("is_reflectance", "is_reflectance", _named("albedo", "ids")),
    Task("material_ids", "material_ids", _named("albedo", "normal", "depth")),
    Task("demodulate", "demodulate", _named("color", "albedo")),
    Task("remodulate", "remodulate", _named("albedo", illumination="color")),
    Task("regress, fewest", "regress", _named("color", "normal", "camera", geometry="depth")),
    Task("regress, all", "regress", _named("color", "normal", "camera", geometry="depth"), {"features": "all"}),
    Task("morphological_aa", "morphological_aa", _named("color")),
    Task("smooth_edges", "smooth_edges", _named(color="history")),
    Task("TAA", "TAA", jitter=(0.25, -0.125)),
    Task("TAA, box without tone mapping", "TAA", {}, _UNMAPPED, (_LINEAR,)),
    Task("BMFR", "BMFR", rivals=("OIDN high",)),
    Task("OIDN, temporal", "OIDN", {}, {"temporal": True}, reference=False),
    Task("Recirculation, of all", "Recirculation"),
    Task("Upscaler, 2", "Upscaler", jitter=(0.25, -0.125)),
    Task("SVGF", "SVGF", multiply_adds=_AROUND + 4 * (_pass(3) + _dim(3))),
    Task(
        "SVGF, 5 passes, no choice",
        "SVGF",
        {},
        {"iterations": 5, "choice": False},
        _NETWORKS,
        _AROUND + 5 * (_pass(3) + _dim(3)),
    ),
    Task("SVGF, no innovation", "SVGF", {}, {"innovation": False}),
    Task("HalfRes", "HalfRes"),
    Task("SVGF, as published", "SVGF", {}, {"iterations": 5, **_PUBLISHED}, (), _AROUND + 5 * _pass(5)),
    Task(
        "SVGF, as published but 3x3",
        "SVGF",
        {},
        {"iterations": 5, **_PUBLISHED, "radius": 1},
        ("OIDN fast",),
        _AROUND + 5 * _pass(3),
    ),
)


class Inputs:
    """The images of one size, as `stage` wrote them. Each is read once, on first use.

    Parameters
    ----------
    folder : Path
    width, height : int
    """

    def __init__(self, folder: Path, width: int, height: int) -> None:
        self.folder, self.width, self.height = folder, width, height
        self._read: dict[str, Any] = {
            name: _scene(now, width, height).camera for name, now in (("previous_camera", 0), ("camera", 1))
        }
        self._read["doubled"] = (2 * height, 2 * width)

    def __getitem__(self, name: str) -> Any:
        if name not in self._read:
            self._read[name] = np.load(self.folder / f"{name}.npy")
        return self._read[name]

    def frames(self, jitter: tuple[float, float] | None = None) -> list[Frame]:
        """Frames of an endless sequence that alternates between two views; each has its own noise."""
        return [self.frame(turn, jitter) for turn in range(_TURNS)]

    def frame(self, turn: int, jitter: tuple[float, float] | None = None) -> Frame:
        """A single one of these frames."""
        prefix = ("previous_", "")[turn % 2]
        images = {name: self[prefix + name] for name in (*_FRAME, "camera")}
        return Frame(self[_color(turn)], **images, jitter=jitter)


def stage(folder: Path, width: int, height: int) -> None:
    """Write the images of one size; equal sizes give equal bits.

    Parameters
    ----------
    folder : Path
        Gets one file for each image.
    width, height : int
        Size in pixels.
    """
    rng = np.random.default_rng(0)
    scenes = [_scene(now, width, height) for now in (0, 1)]
    images: dict[str, NDArray[Any]] = {}

    def put(name: str, rows: slice, values: NDArray[Any]) -> None:
        kind = np.uint32 if name.endswith("ids") else np.float32
        if name not in images:
            images[name] = np.empty((height, *values.shape[1:]), kind)
        images[name][rows] = values

    for prefix, scene, other in zip(("previous_", ""), scenes, scenes[::-1], strict=True):
        centres = raycast.centres(scene.camera)
        for top in range(0, height, _BAND):
            rows = slice(top, min(top + _BAND, height))
            hits = raycast.cast(scene, centres[rows])
            for turn in range(prefix == "", _TURNS, 2):
                put(_color(turn), rows, hits.color * raycast.noise(rng, (*hits.depth.shape, 1), 1.0))
            for name in ("albedo", "normal", "depth", "ids"):
                put(f"{prefix}{name}", rows, getattr(hits, name))
            put(f"{prefix}motion", rows, raycast.motion(hits, other))
            if prefix:
                put("history", rows, hits.color * raycast.noise(rng, (*hits.depth.shape, 1), 0.2))
    images["traced"] = quarter(Frame(images["color"]), 0).color
    images["low"] = images["color"][::2, ::2]
    light = images["history"][..., 1]
    images["predicted"] = light
    images["candidates"] = np.stack([np.float32(1 - 0.02 * passes) * light for passes in range(5)], -1)
    images["history_moments"] = np.stack([light, 1.5 * light**2], -1)
    images["variance"] = 0.5 * light**2
    images["hit_distance"] = 0.5 * images["depth"]
    down, across = height // 8 + 1, width // 8 + 1
    blocks = rng.permutation(down * across).reshape(down, across) % 10 == 0
    short = np.kron(blocks, np.ones((8, 8), bool))[:height, :width]
    images["history_length"] = np.where(short, rng.integers(0, 4, short.shape), 20).astype(np.float32)
    images["confidence"] = rng.random(short.shape, np.float32)
    images["sparse"] = np.full_like(images["color"], np.nan)
    images["sparse"][1::4, 2::4] = images["color"][1::4, 2::4]
    tiles = -(-height // 8), -(-width // 8)
    steps = rng.normal(0, 1, (*tiles, 8))
    images["evidence"] = np.dstack([steps[..., :4], steps[..., 4:] ** 2, np.full((*tiles, 2), 300)]).astype(np.float32)
    noise = raycast.noise(rng, (height, width, 3), 0.2)
    images["planes"] = np.dstack([light[..., None] * noise, light, 0.9 * light]).astype(np.float32)
    images["products"] = np.abs(rng.normal(0, 30, (*tiles, 14))).astype(np.float32)
    for name, image in images.items():
        # Not into the file: an interrupt while numpy writes to one becomes a TypeError.
        buffer = io.BytesIO()
        np.save(buffer, image)
        (folder / f"{name}.npy").write_bytes(buffer.getbuffer())


def _color(turn: int) -> str:
    """The name of a frame's colour; the colours of the first two frames are also inputs of kernels."""
    name = ("previous_color", "color")[turn % 2]
    return name if turn < 2 else f"{name}_{turn}"


def _scene(now: int, width: int, height: int) -> Scene:
    """The same view at every size; motion in pixels does not depend on the size."""
    step = now * 1920 / width / 100
    camera = Camera.from_look_at([step, 1.2, 4], [0.5 * step, 0.6, 0], [0, 1, 0], 50, width, height)
    white, grey, red = (0.8, 0.8, 0.7), (0.4, 0.5, 0.4), (0.9, 0.2, 0.1)
    things = (
        Thing(raycast.Rectangle(), raycast.turn([1, 0, 0], -90), raycast.value_noise((0.7, 0.6, 0.5), grey, 0.25)),
        Thing(raycast.Rectangle(4, 1.6), raycast.translate(0, 0.8, -2), raycast.checker(white, grey, 0.5)),
        Thing(raycast.Sphere(0.6), raycast.translate(0.9, 0.6, -0.4), raycast.checker(red, white, 0.3)),
        Thing(raycast.Box((1, 1.1, 0.9)), raycast.translate(-1.1 + step, 0.55, -0.5), red),
    )
    return Scene(things, camera, (Light((2, 4, 3), (12, 11, 10)),))
