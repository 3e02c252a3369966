"""Sequences on disk for measurements: noisy frames and references, either rendered into a cache or a user's own."""

from __future__ import annotations

import hashlib
import inspect
import os
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from importlib import metadata
from itertools import islice
from operator import index
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from platformdirs import user_cache_path
from tqdm import tqdm

from yester import Camera, Frame
from yester.io import describe, read_exr, sequence_paths, write_exr
from yester.io import mitsuba as renderer
from yester.io.headers import same_albedo, suit

from . import build, sequences
from .build import Exposure

__all__ = ["Recording", "open_recording", "record"]

Source = str | os.PathLike[str]

#: First seed of references, above the seeds of noisy frames, so that they share no random numbers. Higher seeds could
#: overflow: Mitsuba multiplies a seed by the number of an image's blocks, up to ten thousand, in 32 bits.
_REFERENCE_SEEDS = 100_000


#: Sequences whose references need more samples than usual.
_HARD = ("many_lights", "switched_light", "naked_lamps", "caustics", "mist", "opening_door", "neon_corridor")


@dataclass(frozen=True)
class Recording:
    """A sequence on disk.

    Attributes
    ----------
    name : str
        Name of the sequence.
    frames : list of Path
        EXR files in order, of one size, all with colour.
    references : dict of int to Path
        By index of the frame, the EXR file of its reference. May be empty.
    raw_albedo : dict of int to Path
        By index of the frame, the EXR file whose colour is the renderer's raw albedo. Empty unless requested.
    variants : tuple of Recording
        Other realisations of the noise, with the same references.
    reading : dict
        Arguments of `read_exr` for the noisy frames.
    """

    name: str
    frames: list[Path]
    references: dict[int, Path]
    raw_albedo: dict[int, Path] = field(default_factory=dict)
    variants: tuple[Recording, ...] = ()
    reading: dict[str, Any] = field(default_factory=dict)

    def frame(self, index: int) -> Frame:
        """Read a noisy frame."""
        return read_exr(self.frames[index], **self.reading)

    def reference(self, index: int) -> NDArray[np.float32]:
        """Read the colour of a reference, (H, W, 3); ValueError if that frame has none."""
        if index not in self.references:
            known = ", ".join(map(str, self.references)) or "none"
            raise ValueError(f"index: expected a frame of {self.name} with a reference ({known}), got {index}")
        return read_exr(self.references[index]).color

    @cached_property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        known = describe(self.frames[0], **self.reading)
        return known.width, known.height


def record(
    name: str,
    cache: Source | None = None,
    *,
    frames: int = 16,
    width: int = 256,
    height: int = 192,
    seed: int = 0,
    variants: int = 0,
    references: Iterable[int] | None = None,
    spp: int = 1,
    reference_spp: int | None = None,
    raw_albedo: bool = False,
    halves: bool = False,
) -> Recording:
    """Render a sequence into the cache, except the frames that are already there.

    Noisy frames have few samples per pixel and all buffers except `Frame.replay`, in 32 bits. Files are written
    atomically, and each frame has its own seed: an interrupted run resumes and gives the same bits. Concurrent
    processes give the same bits as well; at worst they render a frame twice.

    Parameters
    ----------
    name : str
        One of `sequences.KNOWN`.
    cache : path-like, optional
        A folder, created if missing. By default the environment variable ``YESTER_CACHE``, else the user's cache folder
        for yester (``~/.cache/yester`` on Linux). Frames are rendered anew for other versions of Mitsuba or of the
        scenes. Nothing is removed automatically; the folder may be deleted at any time.
    frames, width, height : int, default 16, 256, 192
        Length and size of the sequence.
    seed : int, default 0
        Seed of the noise: frame i has ``seed + i``. References do not depend on it.
    variants : int, default 0
        Number of further realisations of the noise; all their frames have different seeds.
    references : iterable of int, optional
        Frames that get a reference: by default the second half, after temporal methods have warmed up. Temporal metrics
        need consecutive frames.
    spp : int, default 1
        Samples per pixel of noisy frames. Sequences with motion blur have one.
    reference_spp : int, optional
        Samples per pixel of references: by default 256, or 512 for sequences with more noise. With motion blur, rounded
        up to a multiple of the number of instants.
    raw_albedo : bool, default False
        Also record the albedo of every noisy frame as Mitsuba's ``aov`` integrator gives it: 0 on glass and mirrors,
        anything from 0 to above 1 on rough metals, where `render_sequence` has 1.
    halves : bool, default False
        Render every noisy frame as two half-buffers with independent noise, of one sample per pixel each. The second
        ones are the first of the recording's variants.

    Returns
    -------
    Recording

    Raises
    ------
    ValueError
        If the name is unknown, a number is too small, or a reference is beyond the last frame.
    OSError
        If the cache cannot be written.
    ImportError
        If Mitsuba or OpenEXR is not installed.
    """
    make = sequences.find(name)
    if reference_spp is None:
        reference_spp = 512 if name in _HARD else 256
    numbers = dict(frames=frames, width=width, height=height, spp=spp, reference_spp=reference_spp)
    for what, value in numbers.items():
        if value < 1:
            raise ValueError(f"{what}: expected at least 1, got {value}")
    if variants < 0:
        raise ValueError(f"variants: expected at least 0, got {variants}")
    last = _REFERENCE_SEEDS - (variants + 1) * frames
    if not 0 <= seed <= last:
        raise ValueError(f"seed: expected 0 to {last}, got {seed}")
    chosen = sorted({index(i) for i in (range(frames // 2, frames) if references is None else references)})
    if chosen and not 0 <= chosen[0] <= chosen[-1] < frames:
        raise ValueError(f"references: expected frames from 0 to {frames - 1}, got {chosen}")

    sequence = make(frames, width, height)
    if spp > 1 and isinstance(sequence, Exposure):
        raise ValueError(f"spp: expected 1 for {name}, whose samples are at different instants, got {spp}")
    folder = (Path(cache) if cache else _cache()) / f"{name}-{frames}x{width}x{height}-{_digest(make)}"
    suffix = f"-{spp}" if spp > 1 else ""
    parts = [f"half-{seed}-{number}{suffix}" for number in (1, 2)] if halves else [f"noisy-{seed}{suffix}"]
    noisy = [{i: folder / part / f"frame_{i:04}.exr" for i in range(frames)} for part in parts]
    clean = {i: folder / f"reference-{reference_spp}" / f"frame_{i:04}.exr" for i in chosen}
    raw = {i: folder / f"albedo-{seed}" / f"frame_{i:04}.exr" for i in range(frames if raw_albedo else 0)}
    _fill(noisy, f"{name}, frames", lambda part: render_noisy(sequence, part, seed, spp=spp, halves=halves))
    _fill([clean], f"{name}, references", lambda part: zip(render_clean(sequence, part, reference_spp)))
    _fill([raw], f"{name}, albedo", lambda part: zip(_raw_albedo(sequence, part, seed)))
    again: dict[str, Any] = {"frames": frames, "width": width, "height": height, "reference_spp": reference_spp}
    again |= {"references": chosen, "spp": spp, "raw_albedo": raw_albedo, "halves": halves}
    seeds = range(seed + frames, seed + (variants + 1) * frames, frames)
    others = tuple(record(name, cache, seed=other, **again) for other in seeds)
    second = [Recording(name, [*half.values()], clean, raw) for half in noisy[1:]]
    return Recording(name, [*noisy[0].values()], clean, raw, (*second, *others))


def open_recording(
    frames: Source | Iterable[Source],
    references: Source | Iterable[Source] | None = None,
    name: str | None = None,
    **reading: Any,
) -> Recording:
    """Make a recording of existing files. Only their headers are read.

    Parameters
    ----------
    frames : path-like or iterable of path-like
        The noisy EXR files: a folder, a pattern or several, as for `yester.io.sequence_paths`.
    references : path-like or iterable of path-like, optional
        The files of the references. They are matched with the frames by name, in which case some frames may lack a
        reference, and references of other names are not used, with a `UserWarning`; or, if no name is that of a frame,
        by order, in which case their numbers must be equal.
    name : str, optional
        Name of the recording; by default that of the frames' folder.
    **reading
        ``mapping`` and ``view`` of the frames, as for `yester.io.read_exr`.

    Returns
    -------
    Recording

    Raises
    ------
    OSError
        If a file or folder does not exist or cannot be opened.
    ValueError
        If a folder or pattern has no EXR file; if a file is not an EXR file, damaged, without colour or of another size
        than the first frame; if only some frames have albedo; if references cannot be matched with frames.
    ImportError
        If the OpenEXR package is not installed.
    """
    noisy = sequence_paths(frames)
    clean = [] if references is None else sequence_paths(references)
    pairs = _pair(noisy, clean)
    first = describe(noisy[0], **reading)
    for path in noisy:
        known = describe(path, **reading)
        suit(known, first)
        same_albedo(known, first)
    for path in clean:
        suit(describe(path), first)
    return Recording(name or noisy[0].resolve().parent.name, noisy, pairs, reading=reading)


def _pair(frames: list[Path], references: list[Path]) -> dict[int, Path]:
    """Match references to frames."""
    place = {path.name: i for i, path in enumerate(frames)}
    named = [path for path in references if path.name in place]
    others = [path for path in references if path.name not in place]
    pairs = {place[path.name]: path for path in named}
    # Several takes may have the same names. They are paired by order.
    unique = len(place) == len(frames) and len(pairs) == len(named)
    if others and named:
        if not unique:
            raise ValueError(f"references: expected names of frames, or none of them, got {others[0]}")
        more = f" and {len(others) - 1} more" if len(others) > 1 else ""
        warnings.warn(f"{others[0]}{more}: no frame of that name: not used as a reference", UserWarning, stacklevel=3)
    if not references or (unique and named):
        return dict(sorted(pairs.items()))
    if len(references) != len(frames):
        raise ValueError(f"references: expected one for each of {len(frames)} frames, got {len(references)}")
    return dict(enumerate(references))


def _cache() -> Path:
    return Path(os.environ.get("YESTER_CACHE") or user_cache_path("yester", appauthor=False))


def _digest(make: build.Make) -> str:
    """Hash of the source code that determines the bits of a sequence's frames."""
    import mitsuba as mi

    made = hashlib.sha256(f"{metadata.version('mitsuba')} {mi.variant()}".encode())
    for module in (build, renderer, sys.modules[make.__module__]):
        made.update(inspect.getsource(module).encode())
    return made.hexdigest()[:12]


def _fill(parts: Sequence[dict[int, Path]], what: str, render: Callable[[range], Iterable[tuple[Frame, ...]]]) -> None:
    """Render the missing frames, with the same bits as in a full render, each in as many parts as there are."""
    absent = [i for i in parts[0] if not all(paths[i].exists() for paths in parts)]
    if not absent:
        return
    for paths in parts:
        paths[absent[0]].parent.mkdir(parents=True, exist_ok=True)
    # Spans of consecutive missing frames.
    starts = [i for i in absent if i - 1 not in absent]
    stops = [i + 1 for i in absent if i + 1 not in absent]
    with tqdm(total=len(absent), desc=what, unit="frame", disable=None) as progress:
        for start, stop in zip(starts, stops, strict=True):
            part = range(start, stop)
            for i, frames in zip(part, render(part), strict=True):
                for paths, frame in zip(parts, frames, strict=True):
                    write_exr(paths[i], frame)
                progress.update()


def render_noisy(
    sequence: build.Sequence, part: range, seed: int, *, spp: int = 1, halves: bool = False
) -> Iterator[tuple[Frame, ...]]:
    """Frames of few samples per pixel, with all buffers; each alone, or a pair with independent noise."""
    if isinstance(sequence, Exposure):
        scene = renderer.Stage(sequence.scene).scene
        for i in part:
            # Motion needs the frame before as well, which is rendered with another seed and dropped.
            lead = min(i, 1)
            several = [
                [*_shots(scene, pair, sequence.parameters[i], seed + i - lead, halves=halves)][-1]
                for pair in zip(*sequence.instants[i - lead : i + 1], strict=True)
            ]
            frames = []
            for half, shots in enumerate(zip(*several, strict=True) if halves else [several]):
                which = _instants(sequence, i, seed, shots[0].shape, half)
                names = shots[0].buffers()
                buffers = {name: _picked([shot.buffers()[name] for shot in shots], which) for name in names}
                frames.append(Frame(**buffers, camera=sequence.cameras[i]))
            yield tuple(frames)
        return
    # Motion needs the frame before as well, which is rendered and dropped.
    lead = min(part.start, 1)
    span = slice(part.start - lead, part.stop)
    options: dict[str, Any] = {
        "seed": seed + span.start,
        "spp": spp,
        "transforms": sequence.transforms[span],
        "parameters": sequence.parameters[span],
    }
    if halves:
        pairs = renderer.render_sequence(sequence.scene, sequence.cameras[span], halves=True, **options)
        yield from islice(pairs, lead, None)
        return
    yield from zip(islice(renderer.render_sequence(sequence.scene, sequence.cameras[span], **options), lead, None))


def render_clean(sequence: build.Sequence, part: range, spp: int) -> Iterator[Frame]:
    """Frames of many samples per pixel, with colour only."""
    if isinstance(sequence, Exposure):
        for i in part:
            instants = sequence.instants[i]
            count = len(instants)
            options = {"spp": -(-spp // count), "buffers": False}
            shots = _shots(sequence.scene, instants, sequence.parameters[i], _REFERENCE_SEEDS + i * count, **options)
            yield Frame(np.mean([shot.color for shot in shots], 0), camera=sequence.cameras[i])
        return
    span = slice(part.start, part.stop)
    yield from renderer.render_sequence(
        sequence.scene,
        sequence.cameras[span],
        spp=spp,
        seed=_REFERENCE_SEEDS + span.start,
        transforms=sequence.transforms[span],
        parameters=sequence.parameters[span],
        buffers=False,
    )


def _raw_albedo(sequence: build.Sequence, part: range, seed: int) -> Iterator[Frame]:
    """The renderer's own albedo for the samples of `render_noisy`."""
    stage = renderer.Stage(sequence.scene)
    poses = [stage.poses(named) for named in sequence.transforms]
    values = [stage.values(named) for named in sequence.parameters]

    def albedo(i: int, camera: Camera, pose: dict[str, Any]) -> NDArray[Any]:
        stage.arrange(pose, values[i])
        return stage.hit(stage.mi.load_dict(stage.sensor(camera)), seed + i)["albedo"]

    for i in part:
        if isinstance(sequence, Exposure):
            layers = [albedo(i, *instant) for instant in sequence.instants[i]]
            raw = _picked(layers, _instants(sequence, i, seed, layers[0].shape[:2]))
        else:
            raw = albedo(i, sequence.cameras[i], poses[i])
        yield Frame(raw, camera=sequence.cameras[i])


def _shots(
    scene: Any, instants: Iterable[tuple[Camera, Any]], parameters: dict[str, Any], seed: int, **options: Any
) -> Iterator[Any]:
    """The instants of one frame, or pairs if halves are asked for."""
    cameras, transforms = zip(*instants, strict=True)
    same = [parameters] * len(cameras)
    return renderer.render_sequence(scene, cameras, seed=seed, transforms=transforms, parameters=same, **options)


def _instants(sequence: Exposure, frame: int, seed: int, shape: tuple[int, ...], half: int = 0) -> NDArray[np.int64]:
    """The index of the instant at which each pixel of a noisy frame is sampled."""
    return np.random.default_rng([seed, frame, half] if half else [seed, frame]).integers(
        len(sequence.instants[frame]), size=shape
    )


def _picked(layers: list[NDArray[Any]], which: NDArray[np.int64]) -> NDArray[Any]:
    """Select, for each pixel, the value of the layer with its index."""
    rows, columns = np.indices(which.shape)
    picked: NDArray[Any] = np.stack(layers)[which, rows, columns]
    return picked
