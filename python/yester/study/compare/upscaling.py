"""Upscaling against alternatives with the same number of samples: ``python -m yester.study.compare.upscaling``.

Frames of half the size have four samples per pixel, spread over one output pixel at the jittered position; native
frames have one sample per pixel. Both cost the same number of samples. References have the size of the output.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from yester import SVGF, TAA, Camera, Frame, Upscaler, jitter, resample
from yester.frame import present
from yester.io import mitsuba as renderer
from yester.metrics import flip, psnr, temporal_error

from ..rendered.recording import record
from ..rendered.sequences import find

__all__ = ["METHODS", "SCALE", "Score", "denoised", "enlarge", "scores", "shrunk"]

Image = NDArray[np.float32]
#: Ratio of the output's sides to the input's.
SCALE = 2
#: Samples of a small pixel for equal cost.
_SPP = SCALE**2
_PHASES = 8 * SCALE**2


class Score(NamedTuple):
    """Means over frames with references: PSNR in dB, FLIP, temporal error; processor time in ms for a 1080p output."""

    psnr: float
    flip: float
    temporal_error: float
    ms: float


def shrunk(name: str, frames: int = 16, width: int = 256, height: int = 192, *, spp: int = _SPP) -> Iterator[Frame]:
    """Render jittered frames of half the size.

    Parameters
    ----------
    name : str
        One of `sequences.NAMES`.
    frames, width, height : int
        Number of frames, and size of the output, which must be even.
    spp : int, default 4
        Samples of a small pixel.

    Yields
    ------
    Frame
        With jitter. Rendered at the output's size with a shifted camera, so that one of each 2×2 pixels lies at the
        jittered position, and reduced to these pixels. A renderer whose pixel filter has that width could render them
        alone.
    """
    sequence = find(name)(frames, width, height)
    offsets = jitter(_PHASES)[np.arange(frames) % _PHASES]
    places = SCALE * (0.5 + offsets)
    cells = np.floor(places).astype(int)
    shifts = places - cells - 0.5
    rendered = renderer.render_sequence(
        sequence.scene,
        [camera.jittered(shift) for camera, shift in zip(sequence.cameras, shifts, strict=True)],
        spp=spp,
        transforms=sequence.transforms,
        parameters=sequence.parameters,
    )
    for i, frame in enumerate(rendered):
        x, y = cells[i]
        buffers = {key: buffer[y::SCALE, x::SCALE].copy() for key, buffer in frame.buffers().items()}
        # The cameras were jittered, but motion must not contain jitter.
        buffers["motion"][..., :2] -= shifts[i] - shifts[max(i - 1, 0)]
        buffers["motion"][..., :2] /= SCALE
        camera = Camera(sequence.cameras[i].world_to_clip, width // SCALE, height // SCALE)
        yield Frame(**buffers, camera=camera, jitter=offsets[i])


def denoised(frames: Iterable[Frame]) -> Iterator[Frame]:
    """Denoise the colours with `SVGF`, without antialiasing, which would average out the jitter."""
    svgf = SVGF(antialias=False)
    for frame in frames:
        buffers = {name: buffer for name, buffer in frame.buffers().items() if name != "color"}
        yield Frame(svgf.step(frame).color, **buffers, camera=frame.camera, jitter=frame.jitter)


def enlarge(frame: Frame, filter: Literal["bilinear", "catmull-rom"] = "catmull-rom") -> Image:
    """Upscale a single frame with a filter of `resample`."""
    size, offset = (SCALE * frame.height, SCALE * frame.width), frame.jitter or (0, 0)
    return resample(present(frame), size, offset=offset, filter=filter, dering=False)[0]


def _step(make: Callable[[], Any]) -> Callable[[], Callable[[Frame], Image]]:
    def start() -> Callable[[Frame], Image]:
        state = make()
        return lambda frame: state.step(frame).color

    return start


#: By name: whether the method takes small frames, whether these are denoised, and the constructor of its step.
METHODS: dict[str, tuple[bool, bool, Callable[[], Callable[[Frame], Image]]]] = {
    "bilinear": (True, False, lambda: partial(enlarge, filter="bilinear")),
    "bicubic": (True, False, lambda: enlarge),
    "native, 1 spp": (False, False, lambda: present),
    "native TAA": (False, False, _step(TAA)),
    "Upscaler": (True, False, _step(partial(Upscaler, SCALE))),
    "SVGF, bicubic": (True, True, lambda: enlarge),
    "native SVGF": (False, False, _step(SVGF)),
    "SVGF, Upscaler": (True, True, _step(partial(Upscaler, SCALE))),
}


def scores(
    small: list[Frame], native: list[Frame], references: dict[int, Image], times: dict[str, float] | None = None
) -> dict[str, Score]:
    """Score every method on a sequence.

    Parameters
    ----------
    small, native : list of Frame
        The sequence at half the size, and at the output's size.
    references : dict of int to (H, W, 3) float32
        By index of the frame.
    times : dict of str to float, optional
        By method, milliseconds to include in the scores.

    Returns
    -------
    dict of str to Score
        By method.
    """
    smooth = list(denoised(small))
    found = {}
    for name, (takes_small, takes_smooth, start) in METHODS.items():
        step = start()
        images = [step(frame) for frame in (smooth if takes_smooth else small if takes_small else native)]
        pairs = [(i, i - 1) for i in references if i - 1 in references]
        found[name] = Score(
            statistics.mean(psnr(images[i], references[i]) for i in references),
            statistics.mean(flip(images[i], references[i]) for i in references),
            statistics.mean(temporal_error(images[i], images[j], references[i], references[j]) for i, j in pairs),
            (times or {}).get(name, float("nan")),
        )
    return found


def _times(repetitions: int = 7) -> dict[str, float]:
    """Milliseconds of processor time, summed over cores, of a step whose output has 1920×1080 pixels."""
    rng = np.random.default_rng(0)

    def frame(width: int, height: int) -> Frame:
        motion = np.full((height, width, 2), 0.3, np.float32)
        depth = rng.uniform(2, 3, (height, width)).astype(np.float32)
        normal = np.broadcast_to(np.array([0, 0, 1], np.float32), (height, width, 3))
        color = rng.gamma(4, 0.2, (height, width, 3)).astype(np.float32)
        return Frame(
            color, albedo=np.full_like(color, 0.5), normal=normal, depth=depth, motion=motion, jitter=(0.2, -0.1)
        )

    small, native = frame(1920 // SCALE, 1080 // SCALE), frame(1920, 1080)
    found = {}
    for name, (takes_small, takes_smooth, start) in METHODS.items():
        step, given = start(), small if takes_small else native
        before = SVGF(antialias=False) if takes_smooth else None
        taken = []
        for _ in range(repetitions + 2):
            begin = time.process_time()
            if before:
                before.step(given)
            step(given)
            taken.append(1e3 * (time.process_time() - begin))
        found[name] = statistics.median(taken[2:])
    return found


def main() -> None:
    """Print a table for each sequence."""
    parser = argparse.ArgumentParser(prog="python -m yester.study.compare.upscaling", description=__doc__)
    parser.add_argument("sequences", nargs="*", default=["thicket", "spinning_shapes", "glossy_plates"])
    parser.add_argument("--reference-spp", type=int, default=256)
    options = parser.parse_args()
    times = _times()
    for sequence in options.sequences:
        recording = record(sequence, reference_spp=options.reference_spp)
        native = [recording.frame(i) for i in range(len(recording.frames))]
        references = {i: recording.reference(i) for i in recording.references}
        print(f"| {sequence} | PSNR | FLIP | temporal error | CPU ms at 1080p |\n|---|--:|--:|--:|--:|")
        for name, score in scores([*shrunk(sequence)], native, references, times).items():
            print(f"| {name} | {score.psnr:.2f} | {score.flip:.4f} | {score.temporal_error:.4f} | {score.ms:.0f} |")


if __name__ == "__main__":
    main()
