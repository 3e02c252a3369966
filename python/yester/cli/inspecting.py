"""`yester info` and `check`: what files hold, and whether it is what it should be."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import Finding, check
from ..argtypes import filename, whole
from ..io import Description, describe, mapping, read_sequence
from ..io.shots import breaks
from .parsing import Command, add_channels, files_of, how_to_read, need

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["add_check", "add_info"]


def add_info(command: Command) -> None:
    parser = command(_info, "info", "list the buffers of an EXR file, and the consequences of each missing one")
    parser.add_argument("file", metavar="FILE", type=filename)
    add_channels(parser)


def _info(options: argparse.Namespace) -> None:
    need("exr", "OpenEXR")
    known = describe(options.file, **how_to_read(options))
    width = max(map(len, [*known.channels, *known.missing, "camera"]))
    print(f"{known.path}: {known.width} x {known.height}")
    print(f"recognised: {known.renderer or 'no renderer'}{f', by {known.evidence}' if known.renderer else ''}")
    if known.views:
        print(f"views: {', '.join(known.views)}; {known.view} is used, --view chooses")
    for remark in known.remarks:
        print(f"note: {remark}")
    for name, channels in known.channels.items():
        print(f"  {name:<{width}} {_grouped(channels, sort=False)}")
        if name in known.notes:
            print(f"  {'':<{width}} {known.notes[name]}")
    if known.camera:
        print(f"  {'camera':<{width}} at {_vector(known.camera.position)}, looks along {_vector(known.camera.forward)}")
    if known.jitter:
        print(f"  {'jitter':<{width}} ({known.jitter[0]:g}, {known.jitter[1]:g}) pixels")
    if known.unused:
        print("not used:")
        reasons: dict[str, list[str]] = {}
        for channel, why in known.unused.items():
            reasons.setdefault(why, []).append(channel)
        for why, several in reasons.items():
            print(f"  {_grouped(several)}: {why}")
    if known.unrecognised:
        print(f"not recognised: {_grouped(known.unrecognised)}")
        for layer, guess in known.guesses.items():
            print(f"  {layer} may be {guess[0].partition('=')[0]}:", *(f"--map '{one}'" for one in guess))
    if known.missing:
        print("missing:")
        for name, cost in known.missing.items():
            print(f"  {name:<{width}} {cost}")


def add_check(command: Command) -> None:
    parser = command(
        _checked, "check", "find wrong conventions of motion, cameras, depth, normals, jitter, albedo and ids"
    )
    parser.add_argument("inputs", metavar="IN", nargs="+", help="a folder, files or a pattern; in natural order")
    about = "consecutive frames to look at, from the middle of the first shot; %(default)s"
    parser.add_argument("--frames", metavar="N", type=partial(whole, least=2), default=6, help=about)
    add_channels(parser)


def _checked(options: argparse.Namespace) -> int:
    need("exr", "OpenEXR")
    reading = how_to_read(options)
    paths = files_of(options.inputs)
    end, *_ = [*breaks(paths), len(paths)]
    start = max(end - options.frames, 0) // 2
    chosen = paths[start : min(start + options.frames, end)]
    if len(chosen) < 2:
        raise ValueError(f"{paths[0]}: expected at least two consecutive frames, got {len(chosen)}")
    known = describe(chosen[-1], **reading)
    guesses = [] if "motion" in known.channels else _like_motion(known)
    looks = [_looked(chosen, reading, guess) for guess in guesses] or [_looked(chosen, reading)]
    # All findings with the best guess of motion are printed, and of the other guesses those on motion.
    best = min(range(len(looks)), key=lambda i: _unlike_motion(looks[i][1]))
    for i, guess in sorted(enumerate(guesses), key=lambda each: each[0] == best):
        print(f"tried: motion={','.join(guess)}")
        if i != best:
            print(*(finding for finding in looks[i][1] if finding.subject == "motion"), sep="\n")
    paths, found = looks[best]
    print(f"{known.renderer or 'no renderer'} recognised; looked at {paths[0].name} to {paths[-1].name}")
    print(*found, sep="\n")
    if known.renderer.startswith("Mitsuba") and not known.camera:
        how = "yester.io.mitsuba.render_sequence renders with one, and write_exr stores it"
        print(f"note: Mitsuba's files have no camera; {how}")
    return int(any(finding.verdict == "wrong" for finding in found))


def _looked(paths: list[Path], reading: dict[str, Any], guess: Sequence[str] = ()) -> tuple[list[Path], list[Finding]]:
    """The files that are looked at, and the findings on them, with a guess of the channels of motion."""
    if guess:
        reading = reading | {"mapping": reading["mapping"] | mapping.load({"motion": guess})}
    known = describe(paths[-1], **reading)
    stored = {
        buffer: [*zip(known.factors[buffer], channels, strict=True)]
        for buffer, channels in known.channels.items()
        if buffer in ("motion", "motion_next", "depth", "normal")
    }
    # A shot's first frame needs no motion: without it, the others have it.
    if len(paths) > 2 and "motion" in known.channels and "motion" not in describe(paths[0], **reading).channels:
        paths = paths[1:]
    found = check(read_sequence(paths, **reading), channels=stored, display=known.display)
    if guess:
        # A guess that is right has to be written, too.
        remedy = f"--map motion={','.join(guess)}"
        found = [replace(f, remedy=remedy) if (f.subject, f.verdict) == ("motion", "right") else f for f in found]
    return paths, found


def _unlike_motion(found: Iterable[Finding]) -> int:
    """0 if a guess is motion, 1 if it leads to the next frame, 2 if it is neither."""
    (remedy,) = (finding.remedy for finding in found if finding.subject == "motion")
    return next((i for i in (0, 1) if remedy.startswith(("--map motion=", "--map motion_next=")[i])), 2)


def _like_motion(known: Description) -> list[list[str]]:
    """Pairs of channels that may hold motion: of layers that are known but not used, or with a similar name."""
    layers: dict[str, list[str]] = {}
    for channel, why in known.unused.items():
        if "motion" in f"{channel} {why}".lower():
            layers.setdefault(channel.rpartition(".")[0], []).append(channel)
    guesses = [one.partition("=")[2].split(",") for one, *_ in known.guesses.values() if one.startswith("motion")]
    several = [sorted(own, key=lambda name: "XYZRGB".find(name[-1])) for own in layers.values()]
    return [own[:2] for own in [*several, *guesses] if len(own) > 1]


def _grouped(channels: Iterable[str], *, sort: bool = True) -> str:
    """Channels by layer: ``N.XYZ`` for N.X, N.Y and N.Z, in the usual order of components or in that given."""
    layers: dict[str, list[str]] = {}
    for channel in channels:
        layer, _, component = channel.rpartition(".")
        layers.setdefault(layer, []).append(component)
    bare = layers.pop("", [])
    shown = list(bare)
    for layer, components in layers.items():
        if sort:
            components.sort(key=lambda component: "RGBAXYZWUV".find(component.upper()))
        shown.append(f"{layer}.{('' if all(len(one) == 1 for one in components) else ',').join(components)}")
    return " ".join(shown)


def _vector(values: NDArray[np.float64]) -> str:
    return f"({', '.join(f'{round(value, 4) + 0.0:g}' for value in values)})"
