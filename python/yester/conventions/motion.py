"""Motion, checked by the frames that it warps into each other."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..frame import Frame, turned
from .cameras import relative_distance, still_vectors
from .findings import Channels, Finding, Floats, judged, tile_means
from .guides import colours_of, guides_of, have, lack, warped
from .hypotheses import Motion, applied, named, possible_motions, remedy, seen

__all__ = ["judge_motion", "judge_motion_next"]

#: Vectors that are fewer pixels apart are not told apart by images, as interpolation blurs by as much. Where they are
#: hardly apart at all does not count.
_PIXEL, _HARDLY = 1.0, 0.05
#: Images with more pixels are thinned for the first comparison of hypotheses of motion.
_PIXELS = 250_000
#: Said if no hypothesis fits.
_CUT = "no hypothesis explains the frames, as at a cut"
#: Hypotheses that are compared again in full resolution.
_KEPT = 24


def judge_motion_next(shot: list[Frame], channels: Channels, display: tuple[int, int] | None) -> Finding:
    """Motion to the next frame is the motion of the reversed shot."""
    # The last frame needs none.
    known = shot[:-1] if shot[-1].motion_next is None and len(shot) > 2 else shot
    if (lacking := lack(known, "motion_next")) is not None:
        return Finding("motion_next", "unchecked", f"no motion vectors{lacking}")
    return judge_motion([turned(frame) for frame in reversed(known)], channels, display, "motion_next")[0]


def judge_motion(
    shot: list[Frame],
    channels: Channels,
    display: tuple[int, int] | None,
    buffer: Literal["motion", "motion_next"] = "motion",
) -> tuple[Finding, list[Frame]]:
    """The finding on a buffer, and the frames with canonical motion. A reversed shot has that to the next frame."""
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

    def told(
        hypotheses: list[Motion], residuals: NDArray[np.float64], witnesses: Iterable[str], **how: Any
    ) -> tuple[Finding, Motion]:
        names = [named(hypothesis, buffer) for hypothesis in hypotheses]
        remedies = [remedy(hypothesis, buffer, channels, sides) if i else "" for i, hypothesis in enumerate(hypotheses)]
        # At a steady pace, motion of neighbouring frames is the same.
        timed_ones = [i for i, hypothesis in enumerate(hypotheses) if hypothesis.file]
        finding, chosen = judged(buffer, names, remedies, residuals, witnesses, minor=timed_ones, **how)
        right = hypotheses[chosen or 0]
        return replace(finding, matrix=right.matrix), right

    def by_images(images: list[dict[str, NDArray[np.float32]]]) -> tuple[Finding, Motion, list[Motion]]:
        # All hypotheses on the pair that moves most, in a thinned image; the best ones on all pairs in full.
        few = [{name: image[::thin, ::thin] for name, image in each.items()} for each in images]
        rough = warped(every, [most], shot, [m[::thin, ::thin] for m in stored], few, thin)
        # Motion of a few pixels is lost when thinned: hypotheses that differ by direction alone always stay.
        best = rough.mean(1).argsort(kind="stable")[:_KEPT]
        kept = [every[i] for i in sorted({*range(9), *best.tolist()})]
        residuals, near = warped(kept, bases, shot, stored, images, 1), _near(kept, bases, stored)
        return *told(kept, residuals, images[0], poor=_CUT, null=1, near=near), kept

    every, guides = [*possible_motions(*sides, timed=timed, grey=grey)], guides_of(shot)
    thin = int(np.ceil(np.sqrt(width * height / _PIXELS)))
    most = max(bases, key=lambda t: float(np.nan_to_num(np.abs(stored[t] - 0.5 * grey)).mean()))
    finding, right, kept = by_images(guides)
    geometry = next((name for name in ("position", "depth") if have(shot, name, "camera")), None)
    if finding.verdict == "unclear" and geometry is not None:
        second, other = told(kept, _beside_cameras(kept, bases, shot, stored), ["camera", geometry])
        # Objects that move by themselves may agree better with the cameras by a wrong convention: images exclude that.
        if second.verdict == "right" or (second.verdict == "wrong" and second.stored in finding.rivals):
            finding, right = second, other
    unrelated = every[1].name
    if "color" not in guides[0] and (finding.verdict == "unclear" or finding.stored == unrelated):
        second, other, _ = by_images(colours_of(shot))
        # Guides that do not exclude history in place tell nothing: smooth surfaces agree best there.
        left = {second.stored, unrelated} & {finding.stored, *finding.rivals}
        if second.verdict == "right" or (second.verdict == "wrong" and left):
            finding, right = second, other
    if right.name == every[0].name:
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
