"""Denoisers to compare with: Open Image Denoise, OpenCV's filters, and the torch reference of SVGF."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

import yester
from yester import OIDN, Frame, demodulate, remodulate
from yester._core import settings
from yester.frame import present
from yester.sequence import LOOKAHEAD

from .methods import Method, Result, pipeline

__all__ = ["imports", "opencv", "peers", "references", "tensors"]

Floats = NDArray[np.float32]


def peers() -> tuple[list[Method], dict[str, str]]:
    """List the peers that are installed.

    Returns
    -------
    methods : list of Method
        Open Image Denoise on single frames, with albedo and normals, in three qualities; the same between temporal
        stages, and in the best quality also with later frames. OpenCV's non-local means on the tone-mapped image, and
        its joint bilateral and guided filters on the demodulated light, guided by normals, each over its main
        parameter. The torch reference of SVGF in single precision.
    missing : dict of str to str
        By name of a missing peer, how to install it.
    """
    found: list[Method] = []
    missing: dict[str, str] = {}
    if imports("mitsuba_oidn"):
        qualities = ("fast", "balanced", "high")
        found += [_peer(f"OIDN {quality}", "OIDN", _oidn, quality) for quality in qualities]
        found += [
            Method(f"temporal OIDN {quality}", "temporal OIDN", pipeline(OIDN, quality, temporal=True), peer=True)
            for quality in qualities
        ]
        both = pipeline(OIDN, "high", temporal=True, lookahead=LOOKAHEAD)
        found.append(Method("temporal OIDN high, both sides", "temporal OIDN, both sides", both, peer=True))
    else:
        missing["Open Image Denoise"] = "pip install 'yester[study]'"
    if _has_ximgproc():
        found += [_peer(f"non-local means, h {h:g}", "non-local means", _non_local_means, h) for h in (0.05, 0.1, 0.2)]
        found += [
            _peer(f"{family}, {radius} px", family, filter, radius)
            for family, filter in (("joint bilateral", _joint_bilateral), ("guided filter", _guided))
            for radius in (4, 8, 16)
        ]
    else:
        missing["OpenCV with ximgproc"] = "pip install 'yester[study]', without other packages of OpenCV beside it"
    # torch needs no system libraries, and takes seconds to import.
    if _checkout() and find_spec("torch"):
        found.append(_peer("SVGF, surfaces only, in torch", "SVGF in torch", _torch_svgf))
    else:
        missing["SVGF in torch"] = "set YESTER_REFERENCES to a checkout's tests, and pip install 'yester[test]'"
    return found, missing


def imports(module: str) -> bool:
    """True if the package and the system libraries that it needs are installed."""
    try:
        return import_module(module) is not None
    except (ImportError, OSError):
        return False


def _peer(name: str, family: str, make: Callable[..., Callable[[Frame], Floats]], *arguments: Any) -> Method:
    def run(frames: Iterable[Frame]) -> Iterator[Result]:
        return map(Result, map(make(*arguments), frames))

    return Method(name, family, run, peer=True)


def _oidn(quality: Literal["high", "balanced", "fast"]) -> Callable[[Frame], Floats]:
    network = OIDN(quality)
    return lambda frame: network.step(frame).color


def opencv() -> Any:
    """Import OpenCV, with as many threads as this package uses."""
    import cv2

    cv2.setNumThreads(settings()[0])
    return cv2


def _has_ximgproc() -> bool:
    return imports("cv2") and hasattr(import_module("cv2"), "ximgproc")


def _non_local_means(h: float) -> Callable[[Frame], Floats]:
    cv2 = opencv()

    def step(frame: Frame) -> Floats:
        color = present(frame).clip(0)
        # The filter takes integers. Reinhard's curve maps radiance to [0, 1) and keeps highlights.
        toned = (color / (1 + color) * 65535).astype(np.uint16)
        clean = cv2.fastNlMeansDenoising(toned, [h * 65535] * 3, None, 5, 15, cv2.NORM_L1) / np.float32(65536)
        return np.asarray(clean / (1 - clean), np.float32)

    return step


def _joint_bilateral(radius: int) -> Callable[[Frame], Floats]:
    filter = opencv().ximgproc.jointBilateralFilter

    def smooth(light: Floats, guide: Floats) -> Floats:
        clean = filter(guide, light, 2 * radius + 1, 0.2, radius / 2)
        return np.asarray(clean, np.float32)

    return _on_light(smooth)


def _guided(radius: int) -> Callable[[Frame], Floats]:
    filter = opencv().ximgproc.guidedFilter

    def smooth(light: Floats, guide: Floats) -> Floats:
        return np.asarray(filter(guide, light, radius, 1e-3), np.float32)

    return _on_light(smooth)


def _on_light(smooth: Callable[[Floats, Floats], Floats]) -> Callable[[Frame], Floats]:
    """Filter the colour, demodulated if the frame has albedo, guided by normals.

    Pixels with black albedo (lamps and sky) have no noise and keep their colour, since filters that blur across edges
    would leak into them.
    """

    def step(frame: Frame) -> Floats:
        color = present(frame)
        guide = color if frame.normal is None else frame.normal
        if frame.albedo is None:
            return smooth(color, guide)
        light = demodulate(color, frame.albedo, emission=frame.emission)
        smoothed = remodulate(smooth(light, guide), frame.albedo, emission=frame.emission)
        return np.where((frame.albedo > 0).any(-1, keepdims=True), smoothed, color)

    return step


def _checkout() -> Path | None:
    """The parent folder of the torch references: ``YESTER_REFERENCES``, or ``tests`` beside the package's sources."""
    chosen = os.environ.get("YESTER_REFERENCES")
    folder = Path(chosen) if chosen else Path(yester.__file__).parents[2] / "tests"
    return folder if (folder / "reference" / "svgf.py").is_file() else None


def references() -> ModuleType:
    """Import the torch references of a checkout, with as many threads as this package uses."""
    folder = _checkout()
    if folder is None:
        raise ImportError("torch references: not part of the package; set YESTER_REFERENCES to a checkout's tests")
    if str(folder) not in sys.path:
        sys.path.append(str(folder))
    import torch

    torch.set_num_threads(settings()[0])
    return import_module("reference")


def tensors(value: Any) -> Any:
    """Convert arrays (also in lists, and a frame's buffers) to tensors; leave floats unchanged."""
    import torch

    if isinstance(value, Frame):
        absent: Mapping[str, None] = dict.fromkeys(yester.frame.BUFFERS)
        buffers = {name: tensors(array) for name, array in value.buffers().items()}
        return SimpleNamespace(**{**absent, **buffers}, camera=value.camera, jitter=value.jitter)
    if isinstance(value, list):
        return [tensors(item) for item in value]
    if isinstance(value, np.ndarray):
        return torch.from_numpy(value.astype(np.int64) if value.dtype == np.uint32 else value)
    return value


def _torch_svgf() -> Callable[[Frame], Floats]:
    state = references().SVGF()
    return lambda frame: np.asarray(state.step(tensors(frame)).color, np.float32)
