"""Frames a second of `yester prepare`, with one process, with two, and on a local cluster of two workers.

``python -m yester.study.speed.preparing`` makes four sequences of 1280×720, prepares them in each way with all images,
checks that the bytes are the same, and prints a table. The ways take turns, and the fastest round of each counts. What
is timed is the whole call: starting processes is part of it, starting the cluster is not.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from yester import Camera, Frame
from yester.io import write_exr
from yester.prepare import prepare

from ..synthetic import raycast
from ..synthetic.raycast import Light, Rectangle, Scene, Sphere, Thing, translate, turn


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--sequences", type=int, default=4, help="%(default)s")
    parser.add_argument("--frames", type=int, default=6, help="per sequence; %(default)s")
    parser.add_argument("--size", default="1280x720", help="%(default)s")
    parser.add_argument("--rounds", type=int, default=3, help="%(default)s")
    options = parser.parse_args()
    width, height = map(int, options.size.split("x"))
    with tempfile.TemporaryDirectory() as folder:
        print(measure(Path(folder), options.sequences, options.frames, width, height, options.rounds))


def measure(folder: Path, sequences: int, frames: int, width: int, height: int, rounds: int) -> str:
    """Make sequences, prepare them in each way, and return the table in Markdown."""
    from distributed import LocalCluster

    for number in range(sequences):
        _render(folder / "in" / f"shot{number}", frames, width, height, number)
    total = sequences * frames
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        ways: dict[str, Callable[..., object]] = {
            "one process": partial(prepare, jobs=1),
            "two processes": partial(prepare, jobs=2),
            "local cluster, two workers": partial(prepare, scheduler=cluster.scheduler_address),
        }
        want = None
        best = dict.fromkeys(ways, np.inf)
        size = 0.0
        for _ in range(rounds):
            for way, run in ways.items():
                out = folder / "out"
                start = time.perf_counter()
                run(folder / "in", out)
                best[way] = min(best[way], time.perf_counter() - start)
                made = {path.relative_to(out): path.read_bytes() for path in out.rglob("*") if path.is_file()}
                shutil.rmtree(out)
                if want not in (None, made):
                    raise RuntimeError(f"{way}: expected the bytes of one process, got others")
                want, size = made, sum(map(len, made.values())) / total / 1e6
    rows = [f"| {way} | {total / seconds:.2f} | {seconds:.1f} |" for way, seconds in best.items()]
    about = f"all images, Zarr, float32: {size:.0f} MB a frame"
    head = f"{sequences} sequences of {frames} frames of {width}×{height}, {about}"
    return "\n".join([head, "", "| | frames a second | seconds |", "|---|---|---|", *rows])


def _render(folder: Path, frames: int, width: int, height: int, seed: int) -> None:
    """A ball that rolls over a floor, with noise, and a camera that follows it."""
    folder.mkdir(parents=True)
    rng = np.random.default_rng(seed)
    before: Scene | None = None
    for index in range(frames):
        camera = Camera.from_look_at((0.1 * index, 1.5, 4), (0.1 * index, 0.5, 0), (0, 1, 0), 55, width, height)
        floor = Thing(Rectangle(240, 112), turn([1, 0, 0], -90), (0.7, 0.6, 0.5))
        ball = Thing(Sphere(0.6), translate(0.12 * index, 0.6, -0.1 * seed), (0.9, 0.3, 0.2))
        scene = Scene((floor, ball), camera, (Light((0.4, 0.8, 0.45), (1.0, 1.0, 1.0), distant=True),))
        frame: Frame = raycast.shoot(scene, before, np.random.default_rng(0))
        noisy = frame.color * raycast.noise(rng, (height, width, 1), 1.0)
        kept = {"emission": None, "object_normal": None, "jitter": None}
        write_exr(folder / f"frame_{index:04}.exr", replace(frame, color=noisy, **kept))
        before = scene


if __name__ == "__main__":
    main()
