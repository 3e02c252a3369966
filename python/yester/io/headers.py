"""Headers of a sequence's files: whether they suit each other, and lines for the user about what they have and lack."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import chain, pairwise

from ..judge import UNMOVED
from ..messages import few
from .exr import Description, without_colour

#: Why motion may be wrong where the data window has `moved`.
MOVED = "the data window has moved since the frame before: motion must contain that shift"

#: The headers of a sequence by shot, as history begins anew with each.
Shots = Sequence[Sequence[Description]]


def suit(known: Description, first: Description) -> None:
    """Raise ValueError for a file without colour, with colour of whole numbers, or of another size than the first."""
    if "color" not in known.channels:
        raise without_colour(known.path, layers(known))
    if known.whole:
        raise ValueError(f"{known.path}: {known.whole[0]}: expected channels of floats, got uint32")
    of_one_size(known, first)


def of_one_size(known: Description, first: Description) -> None:
    """Raise ValueError for a file of another size than the first."""
    if (known.width, known.height) != (first.width, first.height):
        raise ValueError(
            f"{known.path}: {known.width} x {known.height}, but {first.path} is {first.width} x {first.height}"
        )


def same_albedo(known: Description, first: Description) -> None:
    """Raise ValueError unless a file has albedo like the first: pipelines take it in all frames or in none."""
    if ("albedo" in known.channels) != ("albedo" in first.channels):
        has, lacks = (known, first) if "albedo" in known.channels else (first, known)
        raise ValueError(f"{lacks.path}: no albedo, but {has.path} has albedo")


def layers(known: Description) -> list[str]:
    """The channels of a file other than its colour."""
    recognised = [name for buffer, names in known.channels.items() if buffer != "color" for name in names]
    return [*recognised, *known.unused, *known.unrecognised]


def moved(before: Description, known: Description) -> bool:
    """Whether a frame has motion, and another corner of its data window than the frame before."""
    return "motion" in known.channels and known.corner != before.corner


def lines(files: Sequence[Description]) -> list[str]:
    """Lines on the renderers of files, and on choices among their layers; each once."""
    found: dict[str, None] = {}
    for known in files:
        if known.renderer:
            found[f"recognised: {known.renderer}, by {known.evidence}"] = None
        found |= dict.fromkeys(f"note: {remark}" for remark in known.remarks)
        if known.views:
            others = ", ".join(view for view in known.views if view != known.view)
            found[f"note: view {known.view} is used, not {others}; --view chooses"] = None
        for name, why in known.unused.items():
            if "map it" in why and "motion" not in known.channels:
                found[f"note: {name.rpartition('.')[0] or name}: not used: {why}"] = None
    renderers = {known.renderer: known.path for known in reversed(files)}
    if len(renderers) > 1:
        of = "; ".join(f"{path} is by {name or 'an unknown one'}" for name, path in renderers.items())
        found[f"warning: files of several renderers: {of}"] = None
    return [*found]


def unmoved(shots: Shots) -> list[str]:
    """Warnings of frames to which history cannot follow motion. A shot's first frame has no history."""
    lacking, shifted = [], []
    for before, known in chain.from_iterable(map(pairwise, shots)):
        if "motion" not in known.channels:
            cameras = before.camera and known.camera and known.channels.keys() & {"depth", "position"}
            if not cameras and "motion_next" not in before.channels:
                lacking.append(known)
        elif moved(before, known):
            shifted.append(known.path)
    found = []
    if lacking:
        files = few([known.path for known in lacking])
        found += [f"warning: {files}: {UNMOVED}: {lacking[0].missing['motion']}"]
    if shifted:
        found += [f"warning: {few(shifted)}: {MOVED}"]
    return found


def missing(shots: Shots, names: Iterable[str] | None = None) -> list[str]:
    """A line for each buffer that some file lacks, with the consequence; with `names`, for these buffers only."""
    found = []
    for name in dict.fromkeys(name for known in chain(*shots) for name in known.missing):
        # Nothing leads from a shot's first frame to an earlier one.
        files = [known for shot in shots for known in shot[name in ("motion", "position") :]]
        lacking = [known for known in files if name in known.missing]
        if lacking and (names is None or name in names):
            where = f" in {few([known.path for known in lacking])}" if len(lacking) < len(files) else ""
            found.append(f"missing{where}: {name}: {lacking[0].missing[name]}")
    return found
