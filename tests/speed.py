"""Every kernel and pipeline against their torch references at 1920×1080: ``python tests/speed.py``.

With beginnings of names, those alone. All in one run, in turn; prints the medians in ms. The references run in float32,
with as many threads as the kernels.
"""

import statistics
import sys
import time
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import reference
import scene
import torch
import yester
from calls import calls
from compare import tensor

HEIGHT, WIDTH, RUNS = 1080, 1920, 5


def milliseconds(function: Callable) -> float:
    start = time.perf_counter()
    function()
    return 1000 * (time.perf_counter() - start)


def compare(name: str, kernel: Callable, twin: Callable) -> None:
    pairs = [(milliseconds(kernel), milliseconds(twin)) for _ in range(RUNS)]
    ours, theirs = (statistics.median(times) for times in zip(*pairs, strict=True))
    print(f"{name:<28}{ours:>10.1f}{theirs:>10.1f}{theirs / ours:>8.1f}", flush=True)


def kernels(chosen: tuple[str, ...]) -> None:
    for name, (kernel, arguments) in calls(HEIGHT, WIDTH).items():
        if not name.startswith(chosen):
            continue
        tensors = {key: tensor(value, torch.float32) for key, value in arguments.items()}
        twin = getattr(reference, kernel.__name__)
        compare(name, lambda: kernel(**arguments), lambda: twin(**tensors))  # noqa: B023


def pipelines(chosen: tuple[str, ...]) -> None:
    """With the defaults that the references know, on frames with everything but a replay."""
    shot = scene.shoot(1, WIDTH, HEIGHT)
    camera = scene.camera(0, WIDTH, HEIGHT)
    buffers = shot.buffers()
    buffers["motion"] = yester.motion_vectors(shot.position, shot.camera, camera)
    buffers["color"] = scene.noisy(shot, np.random.default_rng(0))
    buffers["jitter"] = np.array([0.25, -0.1])
    absent = dict.fromkeys(("emission", "object_normal", "replay"))
    frame, twin = yester.Frame(**buffers), SimpleNamespace(**absent, **tensor(buffers, torch.float32))
    for name in ("SVGF", "TAA"):
        if not name.startswith(chosen):
            continue
        # The reference of SVGF has no reflections.
        options = {"reflections": ()} if name == "SVGF" else {}
        ours, theirs = getattr(yester, name)(**options), getattr(reference, name)()
        # The first step has no history to bring along.
        ours.step(frame), theirs.step(twin)
        compare(f"{name}.step", lambda: ours.step(frame), lambda: theirs.step(twin))  # noqa: B023


def main() -> None:
    threads, instructions = yester._core.settings()
    torch.set_num_threads(threads)
    print(f"{threads} threads, {instructions}; medians of {RUNS}\n{'':<28}{'yester':>10}{'torch':>10}{'ratio':>8}")
    chosen = tuple(sys.argv[1:]) or ("",)
    kernels(chosen)
    pipelines(chosen)


if __name__ == "__main__":
    main()
