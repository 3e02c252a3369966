"""Recordings of what was seen: the frames as EXR files, and the path of the camera."""

from __future__ import annotations

import json
import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import Frame
from ..io import write_exr
from ..io.files import beside

if TYPE_CHECKING:
    from .scene import Shot, World

__all__ = ["Recorder"]

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

    Attributes
    ----------
    folder : Path
    count : int
        Number of frames.
    """

    def __init__(self, folder: Path, world: World) -> None:
        name = time.strftime("yester-live-%Y%m%d-%H%M%S")
        taken = [folder / (name if not number else f"{name}-{number}") for number in range(100)]
        self.folder = next(path for path in taken if not path.exists())
        (self.folder / "frames").mkdir(parents=True)
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
        """Write the next frame; waits while too many are not yet written."""
        path = self.folder / "frames" / f"frame_{self.count:04}.exr"
        self._path["shots"].append(asdict(shot) | {"seed": seed})
        self.count += 1
        if len(self._writing) >= _WAITING:
            self._writing.pop(0).result()
        self._writing.append(self._writer.submit(write_exr, path, frame))

    def close(self) -> None:
        """Wait for the frames, and write the path."""
        for future in self._writing:
            future.result()
        self._writer.shutdown()
        with beside(self.folder / "path.json") as temporary:
            temporary.write_text(json.dumps(self._path, indent=1), "utf-8")
