"""Comparable functions of other libraries, for `yester bench`, with the same number of threads.

Before timing, inputs are converted, and outputs are allocated if the library supports that: only the filter is timed.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from itertools import cycle
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from yester._core import settings
from yester.frame import present
from yester.oidn import Network

from ..compare.peers import opencv, peers, references, tensors
from .tasks import Call, Inputs, Task

__all__ = ["REFERENCE", "RIVALS", "Rival", "library", "missing", "start"]

#: The contender's name of a task's torch reference.
REFERENCE = "torch reference"


class Rival(NamedTuple):
    """A function to compare with.

    Attributes
    ----------
    library : str
        Its key in `missing`.
    make : callable
        Makes the function to be timed from `Inputs`.
    """

    library: str
    make: Callable[[Inputs], Callable[[], object]]


def missing() -> dict[str, str]:
    """By name of a missing library, how to install it, as in `peers`."""
    _, absent = peers()
    remedy = absent.pop("SVGF in torch", None)
    if remedy:
        absent["torch references"] = remedy
    if not find_spec("torch"):
        absent["torch"] = "pip install 'yester[test]'"
    return absent


def library(name: str) -> str:
    """The key in `missing` of a rival, or of the torch reference."""
    return "torch references" if name == REFERENCE else RIVALS[name].library


def start(name: str, task: Task, inputs: Inputs) -> Call:
    """Prepare a rival or the torch reference of a task for timing."""
    if name != REFERENCE:
        return Call(RIVALS[name].make(inputs))
    twins = references()
    if not task.pipeline:
        given = {key: tensors(value) for key, value in task.arguments(inputs).items()}
        if task.function == "clip_history" and "alpha" in given:
            alpha = given.pop("alpha")
            return Call(lambda: twins.blend(given["color"], twins.clip_history(**given), alpha))
        return Call(partial(getattr(twins, task.function), **given))
    # The torch reference has no reflections.
    options = {key: value for key, value in task.options.items() if key != "reflections"}
    state = getattr(twins, task.function)(**options)
    turns = cycle(tensors(frame) for frame in task.frames(inputs))
    state.step(next(turns))
    return Call(lambda: state.step(next(turns)))


def _remap(filter: str, inputs: Inputs) -> Callable[[], object]:
    cv2 = opencv()
    places = _places(inputs)
    x, y = (np.ascontiguousarray(places[..., i]) for i in (0, 1))
    history = inputs["history"]
    return partial(cv2.remap, history, x, y, getattr(cv2, f"INTER_{filter}"), np.empty_like(history))


def _moments(inputs: Inputs) -> Callable[[], object]:
    cv2, color = opencv(), inputs["color"]
    mean, square = np.empty_like(color), np.empty_like(color)

    def run() -> None:
        cv2.blur(color, (3, 3), mean)
        cv2.sqrBoxFilter(color, -1, (3, 3), square)

    return run


def _range(inputs: Inputs) -> Callable[[], object]:
    cv2, color, window = opencv(), inputs["color"], np.ones((3, 3), np.uint8)
    low, high = np.empty_like(color), np.empty_like(color)

    def run() -> None:
        cv2.erode(color, window, low)
        cv2.dilate(color, window, high)

    return run


def _joint_bilateral(inputs: Inputs) -> Callable[[], object]:
    color = inputs["color"]
    return partial(opencv().ximgproc.jointBilateralFilter, inputs["normal"], color, 5, 0.2, 1.0, np.empty_like(color))


def _guided(inputs: Inputs) -> Callable[[], object]:
    color = inputs["color"]
    return partial(opencv().ximgproc.guidedFilter, inputs["normal"], color, 2, 1e-3, np.empty_like(color))


def _grid_sample(filter: str, inputs: Inputs) -> Callable[[], object]:
    import torch

    torch.set_num_threads(settings()[0])
    image = torch.from_numpy(np.moveaxis(inputs["history"], -1, 0)[None].copy())
    scaled = (2 * _places(inputs) + 1) / np.array([inputs.width, inputs.height]) - 1
    grid = torch.from_numpy(scaled.astype(np.float32)[None])
    return partial(torch.nn.functional.grid_sample, image, grid, filter, align_corners=False)


def _places(inputs: Inputs) -> NDArray[np.float32]:
    """Previous pixel positions, with integer pixel centres; outside the image if unknown."""
    y, x = np.mgrid[: inputs.height, : inputs.width].astype(np.float32)
    places: NDArray[np.float32] = np.nan_to_num(np.stack([x, y], -1) + inputs["motion"][..., :2], nan=-9.0)
    return places


def _oidn(quality: str, inputs: Inputs) -> Callable[[], object]:
    network, frame = Network(quality), inputs.frame(1)
    network.take(present(frame), frame)
    return network.run


RIVALS = {
    **{
        f"OpenCV remap, {name}": Rival("OpenCV with ximgproc", partial(_remap, filter))
        for name, filter in (("linear", "LINEAR"), ("cubic", "CUBIC"), ("Lanczos4", "LANCZOS4"))
    },
    **{
        f"torch grid_sample, {filter}": Rival("torch", partial(_grid_sample, filter))
        for filter in ("bilinear", "bicubic")
    },
    "OpenCV blur + sqrBoxFilter": Rival("OpenCV with ximgproc", _moments),
    "OpenCV erode + dilate": Rival("OpenCV with ximgproc", _range),
    "OpenCV joint bilateral, 5x5": Rival("OpenCV with ximgproc", _joint_bilateral),
    "OpenCV guided filter, 5x5": Rival("OpenCV with ximgproc", _guided),
    **{
        f"OIDN {quality}": Rival("Open Image Denoise", partial(_oidn, quality))
        for quality in ("fast", "balanced", "high")
    },
}
