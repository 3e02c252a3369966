"""Sequences on disk, to be measured on: noisy frames and references, rendered once into a cache, or a user's own."""

from __future__ import annotations

import hashlib
import inspect
import os
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from importlib import metadata
from operator import index
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from yester import Frame
from yester.io import describe, read_exr, sequence_paths, write_exr
from yester.io import mitsuba as renderer

from . import scenes, sequences

__all__ = ["Recording", "open_recording", "record"]

Source = str | os.PathLike[str]

#: Seeds from here on are those of references: no noisy frame shares its random numbers with any of them. Not higher, as
#: Mitsuba multiplies a seed by the number of an image's blocks, of which there may be ten thousand, in 32 bits.
_REFERENCE_SEEDS = 100_000


#: Sequences whose references need more samples than others.
_HARD = ("many_lights", "switched_light")


@dataclass(frozen=True)
class Recording:
    """A sequence on disk.

    Attributes
    ----------
    name : str
        What to call it.
    frames : list of Path
        EXR files in order, of one size, all of them with colour.
    references : dict of int to Path
        By index of the frame, the EXR file of what it would be without noise. May be empty.
    """

    name: str
    frames: list[Path]
    references: dict[int, Path]

    def frame(self, index: int) -> Frame:
        """Read a noisy frame."""
        return read_exr(self.frames[index])

    def reference(self, index: int) -> NDArray[np.float32]:
        """Read the colour of a reference, (H, W, 3); ValueError if that frame has none."""
        if index not in self.references:
            known = ", ".join(map(str, self.references)) or "none"
            raise ValueError(f"index: expected a frame of {self.name} with a reference ({known}), got {index}")
        return read_exr(self.references[index]).color

    @cached_property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        known = describe(self.frames[0])
        return known.width, known.height


def record(
    name: str,
    cache: Source | None = None,
    *,
    frames: int = 16,
    width: int = 256,
    height: int = 192,
    seed: int = 0,
    references: Iterable[int] | None = None,
    reference_spp: int | None = None,
) -> Recording:
    """Render a sequence of `scenes`, or what is not yet in the cache.

    Noisy frames have one sample per pixel and all buffers but `Frame.replay`, in 32 bits. Every file appears when it is
    whole, and each has a seed of its own: interrupted and called again, it goes on where it was and leaves the same
    bits. So do several processes at once, which at worst render a frame twice.

    Parameters
    ----------
    name : str
        One of `sequences.NAMES`.
    cache : path-like, optional
        A folder, made if it does not exist. By default that of the environment variable ``YESTER_CACHE``, else
        ``yester`` in ``XDG_CACHE_HOME``, else ``~/.cache/yester``. What is in it depends on the versions of Mitsuba and
        of this package; nothing is ever removed, and all of it may be.
    frames, width, height : int, default 16, 256, 192
        Length and size of the sequence.
    seed : int, default 0
        Of the noise: frame i has ``seed + i``. References do not depend on it.
    references : iterable of int, optional
        Which frames get one: by default the second half, in which methods with memory have warmed up. Measures of
        change need pairs in a row.
    reference_spp : int, optional
        Samples per pixel of references: by default 256, or 512 where small lights make more noise.

    Returns
    -------
    Recording

    Raises
    ------
    ValueError
        If the name is unknown, a number is too small, or a reference is asked for beyond the frames.
    OSError
        If the cache cannot be written to.
    ImportError
        If Mitsuba or OpenEXR is not installed.
    """
    make = sequences.find(name)
    if reference_spp is None:
        reference_spp = 512 if name in _HARD else 256
    for what, value in dict(frames=frames, width=width, height=height, reference_spp=reference_spp).items():
        if value < 1:
            raise ValueError(f"{what}: expected at least 1, got {value}")
    if not 0 <= seed <= _REFERENCE_SEEDS - frames:
        raise ValueError(f"seed: expected 0 to {_REFERENCE_SEEDS - frames}, got {seed}")
    chosen = sorted({index(i) for i in (range(frames // 2, frames) if references is None else references)})
    if chosen and not 0 <= chosen[0] <= chosen[-1] < frames:
        raise ValueError(f"references: expected frames from 0 to {frames - 1}, got {chosen}")

    sequence = make(frames, width, height)
    folder = (Path(cache) if cache else _cache()) / f"{name}-{frames}x{width}x{height}-{_digest(make)}"
    noisy = {i: folder / f"noisy-{seed}" / f"frame_{i:04}.exr" for i in range(frames)}
    clean = {i: folder / f"reference-{reference_spp}" / f"frame_{i:04}.exr" for i in chosen}
    _fill(noisy, f"{name}, frames", sequence, spp=1, seed=seed, buffers=True)
    _fill(clean, f"{name}, references", sequence, spp=reference_spp, seed=_REFERENCE_SEEDS, buffers=False)
    return Recording(name, [*noisy.values()], clean)


def open_recording(
    frames: Source | Iterable[Source], references: Source | Iterable[Source] | None = None, name: str | None = None
) -> Recording:
    """Take files that are there; their headers are looked at.

    Parameters
    ----------
    frames : path-like or iterable of path-like
        The noisy EXR files: a folder, a pattern or several, as for `yester.io.sequence_paths`.
    references : path-like or iterable of path-like, optional
        The same without noise. Either each has the name of the frame it belongs to, and there may be fewer; or all have
        other names, and there are as many.
    name : str, optional
        What to call it; by default, as the folder of the frames.

    Returns
    -------
    Recording

    Raises
    ------
    OSError
        If something is not there, or cannot be opened.
    ValueError
        If a folder or pattern has no EXR file, a file is something else or damaged, has no colour, or another size than
        the first frame; if some frames have albedo and others do not; if it cannot be told which reference belongs to
        which frame.
    ImportError
        If the OpenEXR package is not installed.
    """
    noisy = sequence_paths(frames)
    clean = [] if references is None else sequence_paths(references)
    pairs = _pair(noisy, clean)
    first = describe(noisy[0])
    for path in (*noisy, *clean):
        known = describe(path)
        if "color" not in known.channels:
            others = [channel for channels in known.channels.values() for channel in channels]
            got = ", ".join([*others, *known.unrecognised]) or "none"
            raise ValueError(f"{path}: no colour: expected channels R, G and B, got {got}")
        if (known.width, known.height) != (first.width, first.height):
            size, expected = f"{known.width} x {known.height}", f"{first.width} x {first.height}"
            raise ValueError(f"{path}: expected {expected} as {first.path}, got {size}")
        if path in noisy and ("albedo" in known.channels) != ("albedo" in first.channels):
            expected, got = ("one", "none") if "albedo" in first.channels else ("none", "one")
            raise ValueError(f"{path}: albedo: expected {expected} as in {first.path}, got {got}")
    return Recording(name or noisy[0].resolve().parent.name, noisy, pairs)


def _pair(frames: list[Path], references: list[Path]) -> dict[int, Path]:
    """Which reference belongs to which frame."""
    place = {path.name: i for i, path in enumerate(frames)}
    known = [path.name in place for path in references]
    if len(place) == len(frames) and all(known):
        pairs = {place[path.name]: path for path in references}
        if len(pairs) == len(references):
            return dict(sorted(pairs.items()))
    # A shift by one would be worse than no reference.
    if any(known) and not all(known):
        stranger = references[known.index(False)]
        raise ValueError(f"references: expected names of frames, or none of them, got {stranger}")
    if len(references) != len(frames):
        raise ValueError(f"references: expected one for each of {len(frames)} frames, got {len(references)}")
    return dict(enumerate(references))


def _cache() -> Path:
    if chosen := os.environ.get("YESTER_CACHE"):
        return Path(chosen)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "yester"


def _digest(make: sequences.Make) -> str:
    """Of the code that makes the bits of a sequence's frames: other modules of sequences may change without effect."""
    import mitsuba as mi

    made = hashlib.sha256(f"{metadata.version('mitsuba')} {mi.variant()}".encode())
    # `scenes` has the builders that all share.
    for module in dict.fromkeys((scenes, renderer, sys.modules[make.__module__])):
        made.update(inspect.getsource(module).encode())
    return made.hexdigest()[:12]


def _fill(paths: dict[int, Path], what: str, sequence: scenes.Sequence, *, spp: int, seed: int, buffers: bool) -> None:
    """Render the frames whose files are not there, each with the bits that it would have among all."""
    absent = [i for i, path in paths.items() if not path.exists()]
    if not absent:
        return
    paths[absent[0]].parent.mkdir(parents=True, exist_ok=True)
    # Runs of frames in a row.
    starts = [i for i in absent if i - 1 not in absent]
    stops = [i + 1 for i in absent if i + 1 not in absent]
    with tqdm(total=len(absent), desc=what, unit="frame", disable=None) as progress:
        for start, stop in zip(starts, stops, strict=True):
            # Motion wants the frame before; it is rendered for that and dropped.
            part = slice(max(start - buffers, 0), stop)
            rendered = renderer.render_sequence(
                sequence.scene,
                sequence.cameras[part],
                spp=spp,
                seed=seed + part.start,
                transforms=sequence.transforms[part],
                parameters=sequence.parameters[part],
                buffers=buffers,
            )
            for i, frame in enumerate(rendered, part.start):
                if i >= start:
                    write_exr(paths[i], frame)
                    progress.update()
