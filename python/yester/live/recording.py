"""Recordings of what was seen: the frames as EXR files, and the path of the camera.

``python -m yester.live.recording FOLDER`` renders references for a recording, so that ``yester chart`` can measure it.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tqdm import tqdm

from .. import Frame
from ..io import write_exr
from ..io.files import beside
from .scene import Pose, Shot, World

__all__ = ["Recorder", "main", "references"]

#: Frames that may wait to be written: a bound of the memory that they take.
_WAITING = 4


class Recorder:
    """Writes frames into a new folder, beside the work on the next ones.

    Parameters
    ----------
    folder : Path
        Gets a folder named by the time, with ``frames/frame_0000.exr`` and so on, and ``path.json``.
    world : World
        The scene that is recorded.
    size : (int, int)
        Width and height of all frames.

    Attributes
    ----------
    folder : Path
    size : (int, int)
    count : int
        Number of frames.
    """

    def __init__(self, folder: Path, world: World, size: tuple[int, int]) -> None:
        name = time.strftime("yester-live-%Y%m%d-%H%M%S")
        taken = [folder / (name if not number else f"{name}-{number}") for number in range(100)]
        self.folder = next((path for path in taken if not path.exists()), taken[0])
        (self.folder / "frames").mkdir(parents=True)
        self.size = size
        self.count = 0
        self._path: dict[str, Any] = {
            "scene": None if world.path is None else str(world.path.resolve()),
            "variant": world.variant,
            "fov": world.fov,
            "shots": [],
        }
        self._writer = ThreadPoolExecutor(1, "yester-record")
        self._writing: list[Future[None]] = []

    def add(self, frame: Frame, shot: Shot, seed: int) -> None:
        """Write the next frame; waits while too many are not yet written. OSError if an earlier one could not be."""
        if len(self._writing) >= _WAITING:
            self._writing.pop(0).result()
        path = self.folder / "frames" / f"frame_{self.count:04}.exr"
        self._path["shots"].append(asdict(shot) | {"seed": seed})
        self.count += 1
        self._writing.append(self._writer.submit(write_exr, path, frame))

    def close(self) -> None:
        """Wait for the frames, and write the path; then, OSError if a frame could not be written."""
        self._writer.shutdown()
        _write(self.folder / "path.json", self._path)
        for future in self._writing:
            future.result()


def _write(file: Path, path: dict[str, Any]) -> None:
    with beside(file) as temporary:
        temporary.write_text(json.dumps(path, indent=1), "utf-8")


def references(folder: Path, spp: int = 256) -> Path:
    """Render the frames of a recording without noise.

    Parameters
    ----------
    folder : Path
        Of a recording, with its ``path.json``.
    spp : int, default 256
        Samples per pixel.

    Returns
    -------
    Path
        ``references`` in the folder, with a file for each of ``frames``. Those that are there stay; the path keeps
        their number of samples.

    Raises
    ------
    OSError
        If the folder has no path, or the scene is gone.
    ValueError
        If spp is less than 1 or not that of the references that are there, or the path is not one.
    """
    if spp < 1:
        raise ValueError(f"spp: expected at least 1, got {spp}")
    file = folder / "path.json"
    try:
        path = json.loads(file.read_text("utf-8"))
        shots = [
            Shot(Pose(**shot["pose"]), tuple(shot["size"]), shot["light"], shot["flight"]) for shot in path["shots"]
        ]
        scene = path["scene"]
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{file}: expected the path of a recording, got {type(error).__name__}: {error}") from error
    target = folder / "references"
    there = target.is_dir() and any(target.iterdir())
    if there and (before := path.get("reference_spp", spp)) != spp:
        raise ValueError(f"spp: expected {before}, as the files in {target} have (or none there), got {spp}")
    world = World(scene)
    target.mkdir(exist_ok=True)
    if not there:
        _write(file, path | {"reference_spp": spp})
    for index, shot in enumerate(tqdm(shots, "references", unit="frame", disable=None)):
        to = target / f"frame_{index:04}.exr"
        if not to.exists():
            write_exr(to, world.reference(shot, spp, seed=index))
    return target


def main(arguments: Sequence[str] | None = None) -> None:
    """Render the references of a recording."""
    parser = argparse.ArgumentParser(
        prog="python -m yester.live.recording", description="Render the frames of a recording without noise."
    )
    parser.add_argument("folder", metavar="FOLDER", type=Path, help="of a recording")
    parser.add_argument("--spp", metavar="N", type=int, default=256, help="samples per pixel; %(default)s")
    options = parser.parse_args(arguments)
    try:
        print(references(options.folder, options.spp))
    except (OSError, ValueError) as error:
        parser.error(str(error))


if __name__ == "__main__":
    main()
