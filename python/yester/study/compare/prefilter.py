"""What filtering noisy guides first is worth: ``python -m yester.study.compare.prefilter``.

Through a lens or an open shutter, a pixel's first sample sees one of several surfaces: its guides are noisy. Open Image
Denoise filters such guides by themselves before they guide its network. Here that is done for a Cornell box through a
thin lens and with motion blur; albedo, normals or both are filtered, and `SVGF` and Open Image Denoise, alone and
between temporal stages, are measured against references with and without.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yester import OIDN, SVGF, Frame, denoise
from yester._core import settings
from yester.io.mitsuba import render_sequence
from yester.metrics import relmse

from ..rendered.build import expose
from ..rendered.recording import render_clean, render_noisy
from ..rendered.scenes import box_flight, box_view, cornell_box

__all__ = ["SCENES", "filtered", "measure", "table"]

#: Frames in all, and the first one that is measured.
_COUNT, _START = 12, 6
#: The guides that are filtered.
_CHOICES: dict[str, tuple[str, ...]] = {"as they are": (), "normals": ("normal",), "both": ("albedo", "normal")}
_METHODS: dict[str, Any] = {
    "SVGF": lambda: SVGF(),
    "Open Image Denoise": lambda: OIDN(),
    "temporal Open Image Denoise": lambda: OIDN(temporal=True),
}


def _lens(width: int, height: int, spp: int) -> tuple[list[Frame], list[NDArray[np.float32]]]:
    """Through a thin lens that is focused on the ball."""
    sequence = cornell_box(_COUNT, width, height)
    lens = {"type": "thinlens", "aperture_radius": 0.12, "focus_distance": 3.2, "fov": 40}
    scene = {**sequence.scene, "sensor": lens}
    options: dict[str, Any] = {"transforms": sequence.transforms}
    noisy = list(render_sequence(scene, sequence.cameras, **options))
    late: dict[str, Any] = {"transforms": sequence.transforms[_START:], "seed": 100_000}
    clean = render_sequence(scene, sequence.cameras[_START:], spp=spp, buffers=False, **late)
    return noisy, [frame.color for frame in clean]


def _blur(width: int, height: int, spp: int) -> tuple[list[Frame], list[NDArray[np.float32]]]:
    """With the shutter open for half of each frame."""
    scene = cornell_box(_COUNT, width, height).scene
    exposed = expose(scene, _COUNT, lambda t: box_view(t, width, height), lambda t: {"cube": box_flight(t)})
    noisy = [frame for (frame,) in render_noisy(exposed, range(_COUNT), 0)]
    return noisy, [frame.color for frame in render_clean(exposed, range(_START, _COUNT), spp)]


SCENES = {"thin lens": _lens, "motion blur": _blur}


def filtered(frames: Sequence[Frame], names: Sequence[str]) -> Iterator[Frame]:
    """Frames with guides filtered one by one, as Open Image Denoise recommends for noisy ones.

    Parameters
    ----------
    frames : sequence of Frame
    names : sequence of {"albedo", "normal"}

    Yields
    ------
    Frame

    References
    ----------
    Open Image Denoise's documentation, "Prefiltering": each guide is filtered by itself, by a network of its own.
    """
    from mitsuba_oidn import Device, DeviceType

    device = Device(DeviceType.CPU)
    device.num_threads = settings()[0]
    filters = {name: device.new_filter("RT") for name in names}
    for frame in frames:
        changed: dict[str, Any] = {name: np.empty((*frame.shape, 3), np.float32) for name in names}
        for name, result in changed.items():
            filters[name].set_image(name, getattr(frame, name))
            filters[name].set_image("output", result)
            filters[name].execute()
        yield replace(frame, **changed)


def measure(name: str, *, width: int = 160, height: int = 120, spp: int = 128) -> dict[str, dict[str, float]]:
    """relMSE of each method, by the guides that are filtered, over the last frames of a scene."""
    noisy, clean = SCENES[name](width, height, spp)
    found: dict[str, dict[str, float]] = {}
    for choice, names in _CHOICES.items():
        given = list(filtered(noisy, names)) if names else noisy
        for method, make in _METHODS.items():
            results = [output.color.copy() for output in denoise(given, make(), 0)][_START:]
            errors = [relmse(result, reference) for result, reference in zip(results, clean, strict=True)]
            found.setdefault(method, {})[choice] = float(np.mean(errors))
    return found


def table(**named: int) -> str:
    """All scenes, methods and choices, in Markdown."""
    lines = [f"| scene | method | {' | '.join(_CHOICES)} |", f"|---|---|{'---|' * len(_CHOICES)}"]
    for scene in SCENES:
        for method, errors in measure(scene, **named).items():
            lines.append(f"| {scene} | {method} | {' | '.join(f'{error:.4f}' for error in errors.values())} |")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m yester.study.compare.prefilter", description=__doc__)
    parser.add_argument("--reference-spp", type=int, default=128, help="samples of a reference's pixel; %(default)s")
    options = parser.parse_args(arguments)
    print(table(spp=options.reference_spp))


if __name__ == "__main__":
    main()
