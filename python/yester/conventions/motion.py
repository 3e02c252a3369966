"""Motion, checked by the frames that it warps into each other."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..frame import Frame
from .cameras import relative_distance, still_vectors
from .findings import Channels, Finding, Floats, judged, tile_means
from .guides import guides_of, have, lack, warped
from .hypotheses import Motion, applied, possible_motions, remedy, seen

__all__ = ["judge_motion"]

#: Vectors that are fewer pixels apart are not told apart by images, as interpolation blurs by as much. Where they are
#: hardly apart at all does not count.
_PIXEL, _HARDLY = 1.0, 0.05
#: Images with more pixels are thinned for the first comparison of hypotheses of motion.
_PIXELS = 250_000
#: Hypotheses that are compared again in full resolution.
_KEPT = 24


def judge_motion(shot: list[Frame], channels: Channels, display: tuple[int, int] | None) -> tuple[Finding, list[Frame]]:
    """The finding, and the frames with canonical motion."""
    if (lacking := lack(shot, "motion")) is not None:
        return Finding("motion", "unchecked", f"no motion vectors{lacking}"), shot
    height, width = shot[0].shape
    stored = [np.asarray(frame.motion)[..., :2] for frame in shot]
    timed = len(shot) > 2
    bases = range(1, len(shot) - timed)
    values = np.concatenate([stored[t].ravel() for t in bases])
    values = values[np.isfinite(values)]
    grey = values.size > 0 and values.min() >= 0 and values.max() <= 1 and bool(np.abs(np.median(values) - 0.5) < 0.25)
    sides = display or (width, height)
    every = [*possible_motions(*sides, timed=timed, grey=grey)]
    guides = guides_of(shot)
    # All hypotheses on the pair that moves most, in a thinned image; the best ones on all pairs in full.
    thin = int(np.ceil(np.sqrt(width * height / _PIXELS)))
    few = [{name: image[::thin, ::thin] for name, image in images.items()} for images in guides]
    most = max(bases, key=lambda t: float(np.nan_to_num(np.abs(stored[t] - 0.5 * grey)).mean()))
    rough = warped(every, [most], shot, [m[::thin, ::thin] for m in stored], few, thin)
    # Motion of a few pixels is lost when thinned: hypotheses that differ by direction alone always stay.
    best = rough.mean(1).argsort(kind="stable")[:_KEPT]
    every = [every[i] for i in sorted({*range(9), *best.tolist()})]
    residuals = warped(every, bases, shot, stored, guides, 1)
    names = [hypothesis.name for hypothesis in every]
    remedies = [remedy(hypothesis, channels, sides) if i else "" for i, hypothesis in enumerate(every)]
    # At a steady pace, motion of neighbouring frames is the same.
    timed_ones = [i for i, hypothesis in enumerate(every) if hypothesis.file]
    poor = "no hypothesis explains the frames, as at a cut"
    near = _near(every, bases, stored)
    finding, chosen = judged(
        "motion", names, remedies, residuals, guides[0], poor=poor, null=1, near=near, minor=timed_ones
    )
    geometry = next((name for name in ("position", "depth") if have(shot, name, "camera")), None)
    if finding.verdict == "unclear" and geometry is not None:
        residuals = _beside_cameras(every, bases, shot, stored)
        second, other = judged("motion", names, remedies, residuals, ["camera", geometry], minor=timed_ones)
        # Objects that move by themselves may agree better with the cameras by a wrong convention: images exclude that.
        if second.verdict == "right" or (second.verdict == "wrong" and second.stored in finding.rivals):
            finding, chosen = second, other
    right = every[chosen or 0]
    finding = replace(finding, matrix=right.matrix)
    if not chosen:
        return finding, shot
    if right.here or not right.matrix.any():
        return finding, [replace(frame, motion=None) for frame in shot]
    files = {i: i + right.file for i in range(len(shot)) if 0 <= i + right.file < len(shot)}
    return finding, [replace(shot[i], motion=applied(right, stored[file])) for i, file in files.items()]


def _near(hypotheses: list[Motion], bases: Sequence[int], stored: Sequence[Floats]) -> list[int]:
    """The hypotheses whose vectors are less than a pixel from those of the first one, typically, where they differ."""
    found = []
    for number, hypothesis in enumerate(hypotheses):
        pairs = [seen(hypothesis, stored, t) - seen(hypotheses[0], stored, t) for t in bases]
        apart = np.linalg.norm(np.concatenate(pairs), axis=-1)
        apart = apart[apart > _HARDLY]
        if not apart.size or np.median(apart) < _PIXEL:
            found.append(number)
    return found


def _beside_cameras(
    hypotheses: list[Motion], bases: Iterable[int], shot: list[Frame], stored: Sequence[Floats]
) -> NDArray[np.float64]:
    """Difference of the vectors from the motion of a still scene between the cameras, (hypotheses, tiles)."""
    found: list[list[NDArray[np.float64]]] = [[] for _ in hypotheses]
    for t in bases:
        still = still_vectors(shot[t], shot[t - 1].camera)
        known = np.asarray(np.isfinite(still).all(-1))
        for tiles, hypothesis in zip(found, hypotheses, strict=True):
            tiles.append(tile_means(relative_distance(seen(hypothesis, stored, t), still), known))
    return np.array([np.concatenate(tiles) for tiles in found])
