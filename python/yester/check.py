"""Check the conventions of a sequence's buffers against each other, and say what would make them canonical.

A convention is a hypothesis: what was stored, and the change that makes it canonical. Every hypothesis is applied to
the frames, and the disagreement that is left is measured by tile of the image. For motion, the neighbouring frame is
warped along it, and the guides (ids, positions, depths, normals, albedo; colour if there is nothing else) are compared
with those of the frame itself. Cameras are checked by projecting positions to pixels, depth by cameras and positions,
normals by the slopes of positions, motion's jitter by the motion of the cameras, albedo by colour, ids by those of the
frame before.

Disagreement is relative: 0 is perfect, 1 is that of unrelated places. The simplest hypothesis that is not significantly
worse than the best one is chosen; the margin to the next is a mean over tiles, with its standard error.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ._core import Camera, reproject
from .frame import Frame
from .io.channels import CANONICAL
from .judge import still_motion, tile_sums
from .messages import few

__all__ = ["Finding", "check", "check_motion"]

Floats: TypeAlias = NDArray[np.floating[Any]]
#: By buffer, the channels of its components, and the factors that make them what the frame has.
Channels: TypeAlias = Mapping[str, Sequence[tuple[float, str]]]
Verdict: TypeAlias = Literal["right", "wrong", "unclear", "unchecked"]

#: Tiles along the shorter side of an image.
_TILES = 8
#: A difference of disagreement counts from this many standard errors, and from this size.
_SIGMAS, _LEAST = 3.0, 0.001
#: With more disagreement than this, absolutely or relative to that of no relation, no hypothesis explains the data.
_POOR, _VAIN = 0.6, 0.9
#: Vectors that are fewer pixels apart are not told apart by images, as interpolation blurs by as much. Where they are
#: hardly apart at all does not count.
_PIXEL, _HARDLY = 1.0, 0.05
#: Less of the image than this must not be lost by warping.
_INSIDE = 0.75
#: Buffers of vectors, and the length from which these count as missing.
_VECTORS = "position", "normal", "motion"
_FARTHEST = 1e14
#: Images with more pixels are thinned for the first comparison of hypotheses of motion.
_PIXELS = 250_000
#: Slope of albedo over colour from which albedo is called lit. Paint may follow normals, too, but less.
_LIT = 0.7
#: Deviation of the shares of red, green and blue from normal to normal above which an object is painted: light that is
#: left in albedo changes them little.
_HUE = 0.02
#: Share of a surface's pixels with other ids than before up to which ids are right, and from which they are wrong.
_KEEPS, _CHANGES = 0.25, 0.5
#: Rivals that are printed.
_SHOWN = 3
#: Hypotheses that are compared again in full resolution.
_KEPT = 24


@dataclass(frozen=True)
class Finding:
    """What the data say about one buffer's convention.

    Parameters
    ----------
    subject : {"cameras", "depth", "motion", "jitter", "normal", "albedo", "ids"}
    verdict : {"right", "wrong", "unclear", "unchecked"}
        ``"right"``: as expected, and all else is excluded. ``"wrong"``: another convention fits clearly better.
        ``"unclear"``: as expected as far as can be told, but others fit as well, or nothing fits. ``"unchecked"``:
        buffers are missing. Motion is right even if that of a neighbouring frame fits as well, as at a steady pace. It
        is wrong only if the vectors of the other convention differ by a pixel or more, or cameras tell.
    stored : str
        The convention that the data support, or what is missing.
    remedy : str
        What to change; empty if nothing.
    margin, error : float
        By how much the disagreement of the next hypothesis is larger, up to 1, and the standard error of that over
        tiles; NaN if nothing was compared. Below 0 where a rival agrees better.
    rivals : tuple of str
        Other conventions that the data do not exclude.
    witnesses : tuple of str
        The buffers that told.
    matrix : (2, 2) ndarray of float64 or None
        For motion: canonical x and y from the stored ones.

    See Also
    --------
    check : Finds these for all buffers.

    Examples
    --------
    >>> print(yester.Finding("depth", "wrong", "distance along the ray", "--map depth.kind=distance"))
    depth    wrong     distance along the ray
                       write: --map depth.kind=distance
    """

    subject: str
    verdict: Verdict
    stored: str
    remedy: str = ""
    margin: float = np.nan
    error: float = np.nan
    rivals: tuple[str, ...] = ()
    witnesses: tuple[str, ...] = ()
    matrix: NDArray[np.float64] | None = None

    def __str__(self) -> str:
        lines = [f"{self.subject:<8} {self.verdict:<9} {self.stored}"]
        if np.isfinite(self.margin):
            lines[0] += f" (margin {self.margin:.3f} ± {self.error:.3f}, by {', '.join(self.witnesses)})"
        if self.rivals:
            more = f"; and {len(self.rivals) - _SHOWN} more" if len(self.rivals) > _SHOWN else ""
            lines.append(f"{'':<18} not excluded: {'; '.join(self.rivals[:_SHOWN])}{more}")
        if self.remedy:
            lines.append(f"{'':<18} write: {self.remedy}")
        return "\n".join(lines)


def check_motion(
    frames: Iterable[Frame], *, channels: Channels | None = None, display: tuple[int, int] | None = None
) -> Finding:
    """Find the sign, axes, unit, scale and time of motion vectors by warping neighbouring frames.

    Parameters
    ----------
    frames : iterable of Frame
        Consecutive frames of one shot with `motion`, at least two; from three on, motion that belongs to another frame
        is recognised. The guides `ids`, `position`, `depth`, `normal` and `albedo` are the witnesses; colour is used
        if there are none. Frames should show motion in both axes that is not constant. Where motion is so slow that
        images tell nothing, that of the cameras is the witness, if these and depth or position are known.
    channels : mapping of str to sequence of (float, str), optional
        For ``"motion"``, the file's channels that its components were made of, with the factors that were applied: the
        remedy names them. By default ``motion.X`` and ``motion.Y``.
    display : (int, int), optional
        Width and height of the image that the frames are a part of, if motion may be in fractions of it. By default,
        theirs.

    Returns
    -------
    Finding
        Its `matrix` makes stored vectors canonical: ``motion[..., :2] @ finding.matrix.T``.

    Raises
    ------
    TypeError
        If one is no `Frame`.
    ValueError
        If there are fewer than two frames, of several sizes, or some without motion.

    Examples
    --------
    Vertical motion points up, as Blender stores it:

    >>> rng = np.random.default_rng(0)
    >>> texture = rng.random((80, 120, 3), np.float32)
    >>> steps = [(0, 0), (3, 5), (8, 7)]  # rows and columns by which the image has moved
    >>> frames = []
    >>> for i, (y, x) in enumerate(steps):
    ...     down, right = np.subtract(steps[max(i - 1, 0)], steps[i])
    ...     motion = np.full((80, 120, 2), (right, -down), np.float32)
    ...     image = np.roll(texture, (y, x), (0, 1))
    ...     frames.append(yester.Frame(image, albedo=image, motion=motion))
    >>> finding = yester.check_motion(frames)
    >>> finding.verdict, finding.stored
    ('wrong', 'y up')
    >>> finding.remedy
    '--map motion=motion.X,-motion.Y'
    """
    shot = _shot(frames)
    if any(frame.motion is None for frame in shot):
        raise ValueError("frames: expected motion in each of them")
    return _motion(shot, _named(channels), display)[0]


def check(
    frames: Iterable[Frame], *, channels: Channels | None = None, display: tuple[int, int] | None = None
) -> list[Finding]:
    """Check the conventions of all buffers of a sequence.

    Parameters
    ----------
    frames : iterable of Frame
        Consecutive frames of one shot, at least two; about five are enough.
    channels : mapping of str to sequence of (float, str), optional
        As for `check_motion`; also for ``"depth"`` and ``"normal"``.
    display : (int, int), optional
        As for `check_motion`.

    Returns
    -------
    list of Finding
        On cameras, depth, motion, jitter, normals, albedo and ids. What is found wrong is corrected before the next is
        checked, so that one mistake is reported once.

    Raises
    ------
    TypeError
        If one is no `Frame`.
    ValueError
        If there are fewer than two frames, or of several sizes.

    Examples
    --------
    Depth is stored as the distance along the ray:

    >>> camera = yester.Camera.from_look_at([1, 2, 5], [0, 0, 0], [0, 1, 0], 60, 96, 64)
    >>> position = camera.unproject(np.stack(np.mgrid[:64, :96][::-1], -1) + 0.5, np.full((64, 96), 5.0))
    >>> distance = np.linalg.norm(position - camera.position, axis=-1)
    >>> frame = yester.Frame(np.ones((64, 96, 3)), depth=distance, position=position, camera=camera)
    >>> cameras, depth, *_ = yester.check([frame, frame])
    >>> cameras.verdict, depth.verdict, depth.stored
    ('right', 'wrong', 'distance along the ray')
    >>> depth.remedy
    '--map depth=depth.Z --map depth.kind=distance'
    """
    shot, names = _shot(frames), _named(channels)
    cameras, shot = _cameras(shot)
    depth, shot = _depth(shot, names)
    motion, shot = _motion(shot, names, display)
    if cameras.verdict == "unchecked":
        cameras, shot = _cameras_by_motion(shot)
    if depth.verdict == "unchecked":
        depth, shot = _depth_by_motion(shot, names)
    return [cameras, depth, motion, _jitter(shot), _normal(shot, names), _albedo(shot), _ids(shot)]


def _named(channels: Channels | None) -> dict[str, Sequence[tuple[float, str]]]:
    return {name: [(1.0, channel) for channel in CANONICAL[name]] for name in ("motion", "depth", "normal")} | {
        **(channels or {})
    }


def _shot(frames: Iterable[Frame]) -> list[Frame]:
    shot = list(frames)
    for number, frame in enumerate(shot):
        if not isinstance(frame, Frame):
            raise TypeError(f"frames: expected yester.Frame, got {type(frame).__name__} at {number}")
    if len(shot) < 2:
        raise ValueError(f"frames: expected at least two, got {len(shot)}")
    if len({frame.shape for frame in shot}) > 1:
        raise ValueError(f"frames: expected one size, got {sorted({frame.shape for frame in shot})}")
    return [_bounded(frame) for frame in shot]


def _bounded(frame: Frame) -> Frame:
    """NaN for vectors that are infinite, or so long that their squares may overflow."""
    given = {name: vectors for name, vectors in frame.buffers().items() if name in _VECTORS}
    bounded: dict[str, Any] = {
        name: np.where(np.abs(vectors) < _FARTHEST, vectors, np.float32(np.nan)) for name, vectors in given.items()
    }
    return replace(frame, **bounded)


# Evidence


def _judged(
    subject: str,
    names: Sequence[str],
    remedies: Sequence[str],
    residuals: NDArray[np.float64],
    witnesses: Iterable[str],
    *,
    poor: str = "no known convention fits",
    null: int | None = None,
    near: Collection[int] = (),
    minor: Collection[int] = (),
) -> tuple[Finding, int]:
    """The finding and the index of the hypothesis that is chosen. Hypotheses come in order, the expected one first.

    `residuals` are the disagreements of each hypothesis in each tile, (hypotheses, tiles). `null` is the hypothesis of
    no relation, which any other must beat, and which is chosen only if it beats all others. Those that are `near` the
    expected one are never chosen instead of it. Rivals among the `minor` ones leave the verdict as it is.
    """
    residuals = residuals[:, np.isfinite(residuals).all(0)]
    told = tuple(witnesses)
    count = residuals.shape[1]
    if count < 4:
        return Finding(subject, "unclear", f"{names[0]}, as expected; too little to compare", witnesses=told), 0

    def worse(one: int, other: int) -> tuple[float, float, bool]:
        difference = residuals[one] - residuals[other]
        mean, error = float(difference.mean()), float(difference.std(ddof=1) / np.sqrt(count))
        return mean, error, mean > max(_LEAST, _SIGMAS * error)

    def not_excluded(chosen: int) -> list[int]:
        return [i for i in range(len(names)) if i != chosen and not worse(i, chosen)[2]]

    means = residuals.mean(1)
    eligible = [0, *(i for i in range(1, len(names)) if i not in near)]
    best = min(eligible, key=lambda i: means[i])
    chosen = next(i for i in eligible if not worse(i, best)[2])
    fits = bool(means[chosen] < (_VAIN * means[null] if null in eligible else _POOR))
    if not fits and null is not None and chosen:
        chosen = null if null in eligible and means[null] < _VAIN and not not_excluded(null) else 0
    others = [i for i in range(len(names)) if np.abs(residuals[i] - residuals[chosen]).max() > 1e-6]
    doubtful = not_excluded(chosen)
    rivals = tuple(names[i] for i in doubtful)
    margin, error = min((worse(i, chosen)[:2] for i in others if chosen in minor or i not in minor), default=(0.0, 0.0))
    verdict: Verdict = "wrong" if chosen else "unclear" if not fits or set(doubtful) - set(minor) else "right"
    stored = names[chosen]
    if not chosen and means[0] > _POOR and not fits:
        stored = poor
    return Finding(subject, verdict, stored, remedies[chosen], margin, error, rivals, told), chosen


def _tile(shape: tuple[int, ...]) -> int:
    return max(min(shape[:2]) // _TILES, 4)


def _means(residual: Floats, known: NDArray[np.bool_] | None = None) -> NDArray[np.float64]:
    """Means over tiles, flat; NaN where less than a quarter of a tile is known."""
    side = _tile(residual.shape)
    known = np.ones(residual.shape, bool) if known is None else known
    number = tile_sums(known, side)
    with np.errstate(invalid="ignore", divide="ignore"):
        means = tile_sums(np.where(known, residual, 0), side) / number
    return np.where(number * 4 >= tile_sums(np.ones(residual.shape), side), means, np.nan).ravel()


def _clipped(difference: Floats, scale: Any) -> NDArray[np.float64]:
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        ratio = np.asarray(difference / scale, np.float64)
    return np.where(np.isfinite(ratio), np.minimum(ratio, 1), 1)


# Motion


@dataclass(frozen=True)
class _Motion:
    """A hypothesis of what motion vectors are: canonical = matrix · (stored - zero).

    All hypotheses compare a frame with the one before. Vectors come from the file `file` frames later, belong to the
    pixels of the frame `here` frames later, and lead to the other frame of the pair.
    """

    name: str
    matrix: NDArray[np.float64]
    zero: float = 0.0
    file: int = 0
    here: int = 0

    @property
    def there(self) -> int:
        return -1 - self.here


def _hypotheses(width: int, height: int, *, timed: bool, grey: bool) -> Iterator[_Motion]:
    """Without repetitions; the simpler ones first."""
    straight, swapped = np.eye(2), np.eye(2)[::-1]
    signs = {
        "": (1, 1),
        "y up": (1, -1),
        "current minus previous position": (-1, -1),
        "current minus previous position, y up": (-1, 1),
    }
    turns = {
        ", ".join(filter(None, (order, name))): np.diag(sign) @ axes
        for order, axes in (("", straight), ("(row, column) order", swapped))
        for name, sign in signs.items()
    }
    units = {
        "": np.eye(2),
        "fractions of the image's sides": np.diag([width, height]),
        "normalised device coordinates": np.diag([width / 2, height / 2]),
    }
    lengths = {"half as long": 2.0, "twice as long": 0.5, "a quarter as long": 4.0, "four times as long": 0.25}
    times = {"to the next frame": (-1, -1), "of the next frame": (-1, 0)} | (
        {"of the previous frame": (1, 0)} if timed else {}
    )
    seen: set[tuple[Any, ...]] = set()

    def new(
        name: str, matrix: NDArray[np.float64], zero: float = 0.0, file: int = 0, here: int = 0
    ) -> Iterator[_Motion]:
        key = (*matrix.ravel(), zero, file, here)
        if key not in seen:
            seen.add(key)
            yield _Motion(name, matrix, zero, file, here)

    def named(*parts: str) -> str:
        return ", ".join(filter(None, parts))

    yield from new("previous minus current position, in pixels, y down", straight)
    # What no better explanation excludes.
    yield from new("unrelated: history in place agrees better", np.zeros((2, 2)))
    for unit, scale in units.items():
        for turn, matrix in turns.items():
            yield from new(named(unit, turn), scale @ matrix)
    for length, factor in lengths.items():
        for turn, matrix in turns.items():
            yield from new(named(length, turn), factor * matrix)
    for unit, scale in [*units.items()][1:] if grey else ():
        for turn, matrix in turns.items():
            yield from new(named("0.5 is zero", unit, turn), 2 * scale @ matrix, 0.5)
    for time, (file, here) in times.items():
        for unit, scale in units.items():
            for turn, matrix in turns.items():
                # Towards the next frame, the difference that is expected is that to the next frame.
                said = turn.replace("previous", "next") if here else turn
                yield from new(named(time, unit, said), scale @ matrix, file=file, here=here)


def _motion(shot: list[Frame], channels: Channels, display: tuple[int, int] | None) -> tuple[Finding, list[Frame]]:
    """The finding, and the frames with canonical motion."""
    if (lacking := _lacking(shot, "motion")) is not None:
        return Finding("motion", "unchecked", f"no motion vectors{lacking}"), shot
    height, width = shot[0].shape
    stored = [np.asarray(frame.motion)[..., :2] for frame in shot]
    timed = len(shot) > 2
    bases = range(1, len(shot) - timed)
    values = np.concatenate([stored[t].ravel() for t in bases])
    values = values[np.isfinite(values)]
    grey = values.size > 0 and values.min() >= 0 and values.max() <= 1 and bool(np.abs(np.median(values) - 0.5) < 0.25)
    sides = display or (width, height)
    every = [*_hypotheses(*sides, timed=timed, grey=grey)]
    guides = _guides(shot)
    # All hypotheses on the pair that moves most, in a thinned image; the best ones on all pairs in full.
    thin = int(np.ceil(np.sqrt(width * height / _PIXELS)))
    few = [{name: image[::thin, ::thin] for name, image in images.items()} for images in guides]
    most = max(bases, key=lambda t: float(np.nan_to_num(np.abs(stored[t] - 0.5 * grey)).mean()))
    rough = _warped(every, [most], shot, [m[::thin, ::thin] for m in stored], few, thin)
    # Motion of a few pixels is lost when thinned: hypotheses that differ by direction alone always stay.
    best = rough.mean(1).argsort(kind="stable")[:_KEPT]
    every = [every[i] for i in sorted({*range(9), *best.tolist()})]
    residuals = _warped(every, bases, shot, stored, guides, 1)
    names = [hypothesis.name for hypothesis in every]
    remedies = [_remedy(hypothesis, channels, sides) if i else "" for i, hypothesis in enumerate(every)]
    # At a steady pace, motion of neighbouring frames is the same.
    timed_ones = [i for i, hypothesis in enumerate(every) if hypothesis.file]
    poor = "no hypothesis explains the frames, as at a cut"
    near = _near(every, bases, stored)
    finding, chosen = _judged(
        "motion", names, remedies, residuals, guides[0], poor=poor, null=1, near=near, minor=timed_ones
    )
    geometry = next((name for name in ("position", "depth") if _all(shot, name, "camera")), None)
    if finding.verdict == "unclear" and geometry is not None:
        residuals = _beside_cameras(every, bases, shot, stored)
        second, other = _judged("motion", names, remedies, residuals, ["camera", geometry], minor=timed_ones)
        # Objects that move by themselves may agree better with the cameras by a wrong convention: images exclude that.
        if second.verdict == "right" or (second.verdict == "wrong" and second.stored in finding.rivals):
            finding, chosen = second, other
    right = every[chosen]
    finding = replace(finding, matrix=right.matrix)
    if not chosen:
        return finding, shot
    if right.here or not right.matrix.any():
        return finding, [replace(frame, motion=None) for frame in shot]
    files = {i: i + right.file for i in range(len(shot)) if 0 <= i + right.file < len(shot)}
    return finding, [replace(shot[i], motion=_applied(right, stored[file])) for i, file in files.items()]


def _seen(hypothesis: _Motion, stored: Sequence[Floats], t: int) -> Floats:
    """The vectors of frame t as a hypothesis has them, approximately if they belong to the pixels of another frame."""
    vectors = _applied(hypothesis, stored[t + hypothesis.file])
    return -vectors if hypothesis.here else vectors


def _near(hypotheses: list[_Motion], bases: Sequence[int], stored: Sequence[Floats]) -> list[int]:
    """The hypotheses whose vectors are less than a pixel from those of the first one, typically, where they differ."""
    found = []
    for number, hypothesis in enumerate(hypotheses):
        pairs = [_seen(hypothesis, stored, t) - _seen(hypotheses[0], stored, t) for t in bases]
        apart = np.linalg.norm(np.concatenate(pairs), axis=-1)
        apart = apart[apart > _HARDLY]
        if not apart.size or np.median(apart) < _PIXEL:
            found.append(number)
    return found


def _beside_cameras(
    hypotheses: list[_Motion], bases: Iterable[int], shot: list[Frame], stored: Sequence[Floats]
) -> NDArray[np.float64]:
    """Difference of the vectors from the motion of a still scene between the cameras, (hypotheses, tiles)."""
    found: list[list[NDArray[np.float64]]] = [[] for _ in hypotheses]
    for t in bases:
        still = _still(shot[t], shot[t - 1].camera)
        known = np.asarray(np.isfinite(still).all(-1))
        for tiles, hypothesis in zip(found, hypotheses, strict=True):
            tiles.append(_means(_apart(_seen(hypothesis, stored, t), still), known))
    return np.array([np.concatenate(tiles) for tiles in found])


def _applied(hypothesis: _Motion, stored: Floats) -> NDArray[np.float32]:
    return np.asarray((stored - hypothesis.zero) @ hypothesis.matrix.T, np.float32)


def _mapping(
    buffer: str,
    matrix: NDArray[np.float64],
    channels: Sequence[tuple[float, str]],
    sides: tuple[int, int] = (1, 1),
    **form: Any,
) -> str:
    """The options of the command line that read a buffer, in that form, as a matrix says: one channel a component."""
    width, height = sides
    terms = [(row[i] * channels[i][0], channels[i][1]) for row in matrix for i in np.flatnonzero(row).tolist()]
    named = ",".join(f"{'-' if factor < 0 else ''}{name}" for factor, name in terms)
    lengths = np.abs([factor for factor, _ in terms])
    units = {"pixels": (1, 1), "uv": (width, height), "ndc": (width / 2, height / 2)}
    if buffer.startswith("motion"):
        unit = next((unit for unit, sides in units.items() if np.allclose(lengths, sides, rtol=1e-6)), "pixels")
        lengths = lengths / units[unit]
        form |= {"unit": unit} if unit != "pixels" else {}
    if not np.allclose(lengths, 1):
        form["scale"] = ",".join(f"{length:g}" for length in lengths)
    return " ".join([f"--map {buffer}={named}", *(f"--map {buffer}.{name}={value}" for name, value in form.items())])


def _remedy(hypothesis: _Motion, channels: Channels, sides: tuple[int, int]) -> str:
    """What to write for canonical motion."""
    if not hypothesis.matrix.any():
        return "leave the motion vectors out"
    text = _mapping("motion_next" if hypothesis.here else "motion", hypothesis.matrix, channels["motion"], sides)
    if hypothesis.zero:
        text += f", after subtracting {hypothesis.zero:g} from what is stored"
    if hypothesis.file != hypothesis.here:
        text += f", from the file of the {'next' if hypothesis.file > 0 else 'previous'} frame"
    return text


def _guides(shot: list[Frame]) -> list[dict[str, NDArray[np.float32]]]:
    """The images by which frames can be recognised in each other, by frame: float32 (H, W, C), finite."""
    names = [name for name in ("ids", "position", "depth", "normal", "albedo") if _all(shot, name)]
    if "position" not in names and "depth" in names and _all(shot, "camera"):
        names.append("camera")
    return [{_WITNESS[name]: make(frame) for name in names or ["color"] for make in [_GUIDES[name]]} for frame in shot]


def _lacking(shot: list[Frame], name: str) -> str | None:
    """Where a buffer is missing, for a message: empty if in all frames. None if it is nowhere missing."""
    without = [number for number, frame in enumerate(shot, 1) if getattr(frame, name) is None]
    if not without:
        return None
    which = f"frame{'s' if len(without) > 1 else ''} {few(without)} of {len(shot)}"
    return "" if len(without) == len(shot) else f" in {which}"


def _all(shot: list[Frame], *names: str) -> bool:
    """Whether all frames have these buffers."""
    return all(getattr(frame, name) is not None for frame in shot for name in names)


def _finite(image: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.nan_to_num(image, posinf=0, neginf=0)


def _by_id(frame: Frame) -> Floats:
    """A colour for each id: what lies between two is neither."""
    mixed = np.asarray(frame.ids, np.uint64)[..., None] * np.array([2654435761, 2246822519, 3266489917], np.uint64)
    return ((mixed >> np.uint64(16)) % np.uint64(1024)) / 1024


def _log_depth(frame: Frame) -> Floats:
    depth = np.abs(np.asarray(frame.depth, np.float64))
    known = np.isfinite(depth) & (depth > 0)
    return np.log(np.where(known, depth, 1e3 * depth[known].max(initial=1)))[..., None]


def _samples(frame: Frame) -> NDArray[np.float64]:
    """The places of the samples, as far as they are known, in pixels, (H, W, 2)."""
    rows, columns = np.mgrid[: frame.height, : frame.width] + 0.5
    return np.stack([columns, rows], -1) + (frame.jitter or (0, 0))


def _unprojected(frame: Frame) -> Floats:
    """Positions of pixel centres by depth; NaN for background."""
    assert frame.camera is not None
    depth = np.asarray(frame.depth, np.float64)
    places = _samples(frame)
    points = frame.camera.unproject(places, np.where(np.isfinite(depth), depth, 1))
    return np.where(np.isfinite(depth)[..., None], points, np.nan)


def _smooth_light(frame: Frame) -> Floats:
    """Tone-mapped colour, averaged over 5×5 pixels: noise must not outweigh what moves."""
    color = np.nan_to_num(np.log1p(np.maximum(np.nan_to_num(frame.color, posinf=0), 0)))
    for axis in (0, 1):
        padded = np.pad(color, [(3, 2) if i == axis else (0, 0) for i in range(3)], mode="edge").cumsum(axis)
        ahead, behind = ([slice(None)] * 3 for _ in range(2))
        ahead[axis], behind[axis] = slice(5, None), slice(None, -5)
        color = (padded[tuple(ahead)] - padded[tuple(behind)]) / 5
    return color


_GUIDES: dict[str, Callable[[Frame], Any]] = {
    "ids": _by_id,
    "position": lambda frame: frame.position,
    "depth": _log_depth,
    "normal": lambda frame: frame.normal,
    "albedo": lambda frame: frame.albedo,
    "camera": _unprojected,
    "color": _smooth_light,
}
_WITNESS = {name: name for name in _GUIDES} | {"camera": "position"}


def _footprint(position: Floats) -> Floats:
    """About the distance of neighbouring pixels' positions, (H, W)."""
    steps = []
    for axis in (0, 1):
        step = np.linalg.norm(np.diff(position, axis=axis), axis=-1)
        # Without a neighbour on one side, that of the other counts; in an image of one row, the other axis.
        before = np.pad(step, [(1, 0) if i == axis else (0, 0) for i in range(2)], constant_values=np.nan)
        after = np.pad(step, [(0, 1) if i == axis else (0, 0) for i in range(2)], constant_values=np.nan)
        steps.append(np.fmin(before, after))
    return np.asarray(np.fmax(np.fmax(*steps), 1e-6 * np.linalg.norm(position, axis=-1)))


def _warped(
    hypotheses: list[_Motion],
    bases: Iterable[int],
    shot: list[Frame],
    stored: Sequence[Floats],
    guides: list[dict[str, NDArray[np.float32]]],
    thin: int,
) -> NDArray[np.float64]:
    """Disagreement of warped guides with those of the frame itself, (hypotheses, tiles)."""
    found: list[list[NDArray[np.float64]]] = [[] for _ in hypotheses]
    for t in bases:
        pair = {i: {name: np.asarray(image, np.float32) for name, image in guides[t + i].items()} for i in (-1, 0)}
        images_of = {i: [_finite(image) for image in images.values()] for i, images in pair.items()}
        measures = {0: _disagreement(pair[0], pair[-1]), -1: _disagreement(pair[-1], pair[0])}
        for number, hypothesis in enumerate(hypotheses):
            images, disagreement = images_of[hypothesis.there], measures[hypothesis.here]
            shift = _shift(shot[t + hypothesis.here], shot[t + hypothesis.there])
            motion = _applied(hypothesis, stored[t + hypothesis.file]) + np.float32(shift)
            warped, coverage = reproject(images, motion / np.float32(thin), fallback=False)
            inside = coverage > 0.5
            left = disagreement(warped)
            # What has left the image tells nothing, unless it is so much that hypotheses would hide there.
            outside = left[inside].mean() if inside.mean() > _INSIDE else 1
            found[number].append(_means(np.where(inside, left, outside)))
    return np.array([np.concatenate(tiles) for tiles in found])


def _shift(frame: Frame, source: Frame) -> NDArray[np.float64]:
    """From motion without jitter to the place of the same sample in the source's image, in pixels."""
    if frame.jitter is None or source.jitter is None:
        return np.zeros(2)
    return np.subtract(frame.jitter, source.jitter)


def _disagreement(
    now: dict[str, NDArray[np.float32]], then: dict[str, NDArray[np.float32]]
) -> Callable[[list[NDArray[np.float32]]], NDArray[np.float64]]:
    """Measures how far warped images are from a frame's: mean over witnesses, relative to that of unrelated places."""
    scales: list[Any] = []
    chance: list[float] = []
    filled = {name: _finite(image) for name, image in now.items()}

    def apart(name: str, image: NDArray[np.float32]) -> Floats:
        difference = np.abs(image - filled[name])
        return np.asarray(np.linalg.norm(difference, axis=-1) if name == "position" else difference.mean(-1))

    for name, image in now.items():
        height, width = image.shape[:2]
        unrelated = apart(name, np.roll(_finite(then[name]), (height // 3, width // 3), (0, 1)))
        # Positions differ by how many pixels they are apart: four are as bad as all.
        scale = 4 * _footprint(image) if name == "position" else max(float(unrelated.mean()), 1e-9)
        scales.append(np.where(np.isfinite(scale), scale, 1.0))
        chance.append(float(_clipped(unrelated, scales[-1]).mean()))
    total = max(sum(chance), 1e-9)

    def disagreement(warped: list[NDArray[np.float32]]) -> NDArray[np.float64]:
        parts = (_clipped(apart(name, image), scale) for name, image, scale in zip(now, warped, scales, strict=True))
        return np.asarray(sum(parts) / total)

    return disagreement


# Cameras


def _still(frame: Frame, before: Camera | None) -> NDArray[np.float32]:
    """Motion of a still scene from a frame of known geometry to a camera."""
    motion = still_motion(frame, before)
    assert motion is not None
    return motion[..., :2]


#: From [0, 1] with y down to clip space.
_FROM_UV = np.array([[2.0, 0, 0, -1], [0, -2, 0, 1], [0, 0, 1, 0], [0, 0, 0, 1]])
#: Names, changes of world_to_clip, and how to write them.
_LAYOUTS: dict[str, tuple[Callable[[Any], Any], str]] = {
    "world to clip, for column vectors": (lambda m: m, ""),
    "transposed (for row vectors)": (lambda m: m.T, "Camera(world_to_clip.T, width, height)"),
    "y down": (lambda m: np.diag([1, -1, 1, 1]) @ m, "Camera(np.diag([1, -1, 1, 1]) @ world_to_clip, width, height)"),
    "x left (of the other handedness)": (
        lambda m: np.diag([-1, 1, 1, 1]) @ m,
        "Camera(np.diag([-1, 1, 1, 1]) @ world_to_clip, width, height)",
    ),
    "x left and y down (looks backwards)": (
        lambda m: np.diag([-1, -1, 1, 1]) @ m,
        "Camera(np.diag([-1, -1, 1, 1]) @ world_to_clip, width, height)",
    ),
    "w negative in front": (
        lambda m: np.diag([1, 1, 1, -1]) @ m,
        "Camera(np.diag([1, 1, 1, -1]) @ world_to_clip, width, height)",
    ),
    "all negative": (lambda m: -m, "Camera(-world_to_clip, width, height)"),
    "to [0, 1] with y down": (
        lambda m: _FROM_UV @ m,
        "Camera(np.array([[2, 0, 0, -1], [0, -2, 0, 1], [0, 0, 1, 0], [0, 0, 0, 1]]) @ world_to_clip, width, height)",
    ),
    "inverted (clip to world)": (np.linalg.inv, "Camera(np.linalg.inv(world_to_clip), width, height)"),
    "transposed, y down": (
        lambda m: np.diag([1, -1, 1, 1]) @ m.T,
        "Camera(np.diag([1, -1, 1, 1]) @ world_to_clip.T, width, height)",
    ),
    "transposed, x left": (
        lambda m: np.diag([-1, 1, 1, 1]) @ m.T,
        "Camera(np.diag([-1, 1, 1, 1]) @ world_to_clip.T, width, height)",
    ),
}


def _laid_out(camera: Camera, change: Callable[[Any], Any]) -> Camera | None:
    try:
        return Camera(change(camera.world_to_clip), camera.width, camera.height)
    except (ValueError, np.linalg.LinAlgError):
        return None


def _alternatives(shot: list[Frame]) -> dict[str, tuple[list[Camera | None], str]]:
    """By name of the hypothesis, each frame's camera and the remedy."""
    given = [frame.camera for frame in shot]
    found: dict[str, tuple[list[Camera | None], str]] = {
        name: ([camera and _laid_out(camera, change) for camera in given], remedy)
        for name, (change, remedy) in _LAYOUTS.items()
    }
    found["of the next frame"] = [None, *given[:-1]], "each frame's camera from the file of the previous frame"
    found["of the previous frame"] = [*given[1:], None], "each frame's camera from the file of the next frame"
    return found


def _cameras(shot: list[Frame]) -> tuple[Finding, list[Frame]]:
    """Positions are projected to the pixels that show them."""
    if any(frame.camera is None for frame in shot):
        return Finding("cameras", "unchecked", "no cameras"), shot
    if any(frame.position is None for frame in shot):
        return Finding("cameras", "unchecked", "no positions to project"), shot

    def distance(cameras: list[Camera | None], i: int) -> NDArray[np.float64]:
        frame, camera = shot[i], cameras[i]
        position = np.asarray(frame.position, np.float64)
        known = np.asarray(np.isfinite(position).all(-1))
        if camera is None:
            return _means(np.ones(frame.shape), known)
        pixels, _ = camera.project(np.nan_to_num(position))
        return _means(_clipped(np.linalg.norm(pixels - _samples(frame), axis=-1), 4), known)

    part = range(1, len(shot) - 1) if len(shot) > 2 else range(len(shot))
    return _layout(shot, part, distance, ["position"])


def _cameras_by_motion(shot: list[Frame]) -> tuple[Finding, list[Frame]]:
    """The motion of a still scene between two cameras is that of the vectors."""
    if any(frame.camera is None for frame in shot):
        return Finding("cameras", "unchecked", "no cameras"), shot
    missing = [name for name in ("depth", "motion") if any(getattr(f, name) is None for f in shot)]
    if missing:
        return Finding("cameras", "unchecked", f"no positions, and no {' or '.join(missing)}"), shot

    def distance(cameras: list[Camera | None], i: int) -> NDArray[np.float64]:
        frame, before = replace(shot[i], camera=cameras[i]), cameras[i - 1]
        known = np.isfinite(np.asarray(frame.motion)).all(-1)
        if frame.camera is None or before is None:
            return _means(np.ones(frame.shape), known)
        return _means(_apart(_still(frame, before), np.asarray(frame.motion)[..., :2]), known)

    part = range(2, len(shot) - 1) if len(shot) > 3 else range(1, len(shot))
    return _layout(shot, part, distance, ["motion", "depth"])


def _apart(vectors: Floats, motion: Floats) -> NDArray[np.float64]:
    """Difference of vectors from a motion, relative to its length."""
    length = np.linalg.norm(motion, axis=-1)
    return _clipped(np.linalg.norm(vectors - motion.astype(np.float64), axis=-1), 0.25 * length + 0.1)


def _layout(
    shot: list[Frame],
    part: range,
    distance: Callable[[list[Camera | None], int], NDArray[np.float64]],
    witnesses: list[str],
) -> tuple[Finding, list[Frame]]:
    """The alternative whose cameras have the least distance in a part of the frames."""
    every = _alternatives(shot)
    cameras, remedies = ([*each] for each in zip(*every.values(), strict=True))
    residuals = np.array([np.concatenate([distance(kind, i) for i in part]) for kind in cameras])
    finding, chosen = _judged("cameras", [*every], remedies, residuals, witnesses)
    if not chosen:
        return finding, shot
    return finding, [replace(f, camera=c) for f, c in zip(shot, cameras[chosen], strict=True)]


# Depth

_Z, _RAY = "distance along the camera axis", "distance along the ray"


def _depth(shot: list[Frame], channels: Channels) -> tuple[Finding, list[Frame]]:
    """Stored depth beside that of positions."""
    if (lacking := _lacking(shot, "depth")) is not None:
        return Finding("depth", "unchecked", f"no depth{lacking}"), shot
    if any(frame.camera is None or frame.position is None for frame in shot):
        return Finding("depth", "unchecked", "no cameras and positions to compare with"), shot
    # The expected convention comes first, even if nothing can be compared.
    residuals: dict[str, list[NDArray[np.float64]]] = {_Z: []}
    remedies = {_Z: ""}
    exact = []
    for frame in shot:
        assert frame.camera is not None
        assert frame.position is not None
        position = np.nan_to_num(np.asarray(frame.position, np.float64))
        z = frame.camera.project(position)[1]
        ray = np.linalg.norm(position - frame.camera.position, axis=-1)
        stored = np.asarray(frame.depth, np.float64)
        known = np.isfinite(frame.position).all(-1) & np.isfinite(stored) & (z > 0)
        exact.append(np.where(np.isfinite(frame.position).all(-1), z, np.inf))
        for name, (expected, remedy) in _depths(stored, z, ray, known, channels).items():
            remedies.setdefault(name, remedy)
            # A hundredth of the depth is as wrong as anything.
            error = _clipped(np.abs(stored - expected), 0.01 * np.maximum(np.abs(expected), 1e-9))
            residuals.setdefault(name, []).append(_means(error, known))
    # Frames that show nothing but background have none.
    names = [name for name, each in residuals.items() if len(each) == len(residuals[_Z])]
    every = np.array([np.concatenate([np.empty(0), *residuals[name]]) for name in names])
    finding, chosen = _judged("depth", names, [remedies[name] for name in names], every, ["position"])
    return finding, [replace(f, depth=z) for f, z in zip(shot, exact, strict=True)] if chosen else shot


def _depths(
    stored: NDArray[np.float64],
    z: NDArray[np.float64],
    ray: NDArray[np.float64],
    known: NDArray[np.bool_],
    channels: Channels,
) -> dict[str, tuple[NDArray[np.float64], str]]:
    """By name, the depth that a convention would store, and how to undo it."""
    if not known.any():
        return {}
    d, a, r = (image[known] for image in (stored, z, ray))
    near_z, near_ray = float(np.median(a - d)), float(np.median((r - d) * a / r))
    unit = float(np.median(d / a))

    def read(factor: float = 1, **form: Any) -> str:
        return _mapping("depth", np.array([[factor]]), channels["depth"], **form)

    found = {_Z: (z, ""), _RAY: (ray, read(kind="distance"))}
    # What hardly differs from the expected convention is none of its own.
    some = 1e-3 * float(np.median(a))
    if near_z > some:
        found[f"{_Z}, from the near plane"] = z - near_z, read(near=f"{near_z:.4g}")
    if near_ray > some:
        from_plane = ray - near_ray * ray / np.where(z > 0, z, 1)
        found[f"{_RAY}, from the near plane"] = from_plane, read(kind="distance", near=f"{near_ray:.4g}")
    found[f"negative {_Z}"] = -z, read(-1)
    if unit and abs(unit - 1) > 1e-3:
        found["in another unit"] = unit * z, read(float(f"{1 / unit:.4g}"))
    # A depth buffer is linear in 1/z; two quantiles give the line.
    order = np.argsort(a)
    low, high = order[len(order) // 10], order[-1 - len(order) // 10]
    slope = (d[low] - d[high]) / (1 / a[low] - 1 / a[high]) if a[high] > a[low] else 0.0
    offset = d[low] - slope / a[low]
    if slope:
        depth_buffer = offset + slope / np.where(z > 0, z, 1)
        found["a depth buffer (linear in 1/z)"] = depth_buffer, f"{slope:.4g} / (depth - {offset:.4g})"
    return found


def _depth_by_motion(shot: list[Frame], channels: Channels) -> tuple[Finding, list[Frame]]:
    """The motion of a still scene of that depth is that of the vectors."""
    missing = [name for name in ("depth", "camera", "motion") if any(getattr(f, name) is None for f in shot)]
    if missing:
        return Finding("depth", "unchecked", f"no {', '.join(missing)}"), shot
    names, forward, back = [_Z, _RAY, f"negative {_Z}"], np.eye(1), -np.eye(1)
    read = channels["depth"]
    remedies = ["", _mapping("depth", forward, read, kind="distance"), _mapping("depth", back, read)]
    changed: list[list[Frame]] = [[], [], []]
    for frame in shot:
        assert frame.camera is not None
        cosine = frame.camera.rays()[1] @ frame.camera.forward
        depth = np.asarray(frame.depth)
        for each, factor in zip(changed, (np.ones(()), cosine, np.array(-1.0)), strict=True):
            each.append(replace(frame, depth=np.where(np.isfinite(depth), depth * factor, np.inf), position=None))
    residuals = []
    for kind in changed:
        tiles = []
        for before, frame in pairwise(kind):
            assert before.camera is not None
            assert frame.camera is not None
            known = np.isfinite(np.asarray(frame.motion)).all(-1) & np.isfinite(np.asarray(frame.depth))
            motion = np.asarray(frame.motion)[..., :2]
            off = np.linalg.norm(_still(frame, before.camera) - motion, axis=-1)
            length = np.linalg.norm(motion, axis=-1)
            tiles.append(_means(_clipped(off, 0.02 * length + 0.01), known))
        residuals.append(np.concatenate(tiles))
    finding, chosen = _judged("depth", names, remedies, np.array(residuals), ["motion", "camera"])
    return finding, changed[chosen] if chosen else shot


# Jitter


def _jitter(shot: list[Frame]) -> Finding:
    """The jitter's change since the previous frame is no part of motion."""
    if any(frame.motion is None for frame in shot):
        return Finding("jitter", "unchecked", "no usable motion vectors")
    geometry = _all(shot, "camera") and all(frame.depth is not None or frame.position is not None for frame in shot)
    if not _all(shot, "jitter"):
        if not geometry:
            return Finding("jitter", "unchecked", "no jitter, and no cameras with depth or position")
        return _constant_offset(_offsets(shot))
    changes = [_shift(frame, before) for before, frame in pairwise(shot)]
    if max(np.abs(change).max() for change in changes) < 0.02:
        return Finding("jitter", "unchecked", "the jitter does not change")
    if geometry:
        offsets = _offsets(shot)
        residuals = [_left(offsets, [sign * change for change in changes]) for sign in _SIGNS]
        witnesses = ["camera"]
    else:
        guides = _guides(shot)
        residuals = [_left_by_warping(shot, guides, sign) for sign in _SIGNS]
        witnesses = [*guides[0]]
    return _judged("jitter", [*_SIGNS.values()], ["", *_UNJITTERED], np.array(residuals), witnesses)[0]


#: How often motion contains the change of jitter, and what that means.
_SIGNS = {0: "removed from motion", 1: "left in motion", -1: "removed from motion with the wrong sign"}
#: Remedies for the last two.
_UNJITTERED = (
    "motion - (jitter - previous_jitter): render motion with cameras that are not jittered",
    "motion + (jitter - previous_jitter)",
)


def _offsets(shot: list[Frame]) -> list[NDArray[np.float64]]:
    """Of every frame but the first, the mean difference of its motion from that of the cameras, by tile."""
    offsets = []
    for before, frame in pairwise(shot):
        off = np.asarray(frame.motion)[..., :2].astype(np.float64) - _still(frame, before.camera)
        # What moves by itself is farther off.
        still = np.isfinite(off).all(-1) & (np.linalg.norm(off, axis=-1) < 2)
        offsets.append(np.stack([_means(off[..., i], still) for i in range(2)], -1))
    return offsets


def _left(offsets: list[NDArray[np.float64]], changes: list[Floats]) -> NDArray[np.float64]:
    """How far the offsets are from what these changes would leave, relative to the changes; NaN where unknown."""
    found = []
    for offset, change in zip(offsets, changes, strict=True):
        apart = _clipped(np.linalg.norm(offset - change, axis=-1), max(float(np.linalg.norm(change)), 0.05))
        found.append(np.where(np.isfinite(offset[:, 0]), apart, np.nan))
    return np.concatenate(found)


def _constant_offset(offsets: list[NDArray[np.float64]]) -> Finding:
    """Whether motion differs from that of the cameras by the same vector everywhere."""
    tiles = [o[np.isfinite(o).all(-1)] for o in offsets]
    mean = np.array([o.mean(0) if len(o) > 3 else np.zeros(2) for o in tiles])
    error = np.array([o.std(0) / np.sqrt(len(o)) if len(o) > 3 else np.ones(2) for o in tiles])
    most = int(np.abs(mean).max(-1).argmax())
    size, sure = np.linalg.norm(mean[most]), np.linalg.norm(error[most])
    # Jitter is the same everywhere; wrong motion is not.
    spread = np.linalg.norm(error[most]) * np.sqrt(len(tiles[most]))
    if size > max(0.05, 5 * sure, 3 * spread):
        x, y = mean[most]
        said = f"a constant offset of ({x:.2f}, {y:.2f}) pixels in motion, as jitter leaves it"
        return Finding("jitter", "wrong", said, _UNJITTERED[0], float(size), float(sure), (), ("camera",))
    return Finding("jitter", "right", "no constant offset in motion", "", 0.0, float(sure), (), ("camera",))


def _left_by_warping(shot: list[Frame], guides: list[dict[str, NDArray[np.float32]]], sign: int) -> NDArray[np.float64]:
    """How badly guides agree along the motion without so many times the change of jitter."""
    clean = []
    for i, frame in enumerate(shot):
        change = _shift(frame, shot[max(i - 1, 0)])
        clean.append(np.asarray(frame.motion)[..., :2] - np.float32(sign * change))
    return np.asarray(_warped([_Motion("", np.eye(2))], range(1, len(shot)), shot, clean, guides, 1)[0])


# Normals


#: The form of normals in camera space.
_IN_CAMERA: dict[str, Any] = {"space": "camera"}


def _normal(shot: list[Frame], channels: Channels) -> Finding:
    """Normals beside the slopes of positions."""
    if (lacking := _lacking(shot, "normal")) is not None:
        return Finding("normal", "unchecked", f"no normals{lacking}")
    if any(frame.camera is None or (frame.position is None and frame.depth is None) for frame in shot):
        return Finding("normal", "unchecked", "no cameras with depth or position to compare with")
    flips = {"z forward": (1, 1, 1), "z backwards": (1, 1, -1), "y down": (1, -1, 1)}
    axes = np.eye(3)
    changes: dict[str, tuple[NDArray[np.float64], bool]] = {"world space": (axes, False)}
    changes |= {f"camera space, {how}": (np.diag(signs), True) for how, signs in flips.items()}
    changes["opposite direction"] = -axes, False
    changes["y and z swapped (z is up)"] = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), False
    changes["y and z swapped (z is down)"] = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), False
    read = channels["normal"]
    remedies = [_mapping("normal", m, read, **_IN_CAMERA if c else {}) for m, c in changes.values()]
    names, remedies = [*changes, "encoded from 0 to 1"], ["", *remedies[1:], "2 * normal - 1"]
    residuals: list[list[NDArray[np.float64]]] = [[] for _ in names]
    for frame in shot:
        assert frame.camera is not None
        slope, known = _slopes(frame)
        normal = np.asarray(frame.normal, np.float64)
        known = known & (np.abs(normal).sum(-1) > 0)
        to_camera = frame.camera.world_to_camera[:3, :3]
        every = [normal @ m.T @ (to_camera if c else axes) for m, c in changes.values()] + [2 * normal - 1]
        for each, guess in zip(residuals, every, strict=True):
            length = np.linalg.norm(guess, axis=-1)
            cosine = (guess * slope).sum(-1) / np.maximum(length, 1e-9)
            # Directions 60 degrees apart are as unrelated as any; encoded normals also have another length.
            each.append(_means(_clipped(1 - cosine, 0.5) * 0.8 + 0.2 * _clipped(np.abs(length - 1), 0.2), known))
    every_tile = np.array([np.concatenate(each) for each in residuals])
    witnesses = ["position" if shot[0].position is not None else "depth"]
    return _judged("normal", names, remedies, every_tile, witnesses)[0]


def _slopes(frame: Frame) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Unit normals of the surface through neighbouring positions, towards the camera, and where they are known."""
    assert frame.camera is not None
    position = np.asarray(frame.position if frame.position is not None else _unprojected(frame), np.float64)
    right, down = (np.roll(position, -1, axis) - np.roll(position, 1, axis) for axis in (1, 0))
    slope = np.cross(right, down)
    length = np.linalg.norm(slope, axis=-1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = slope / length
    away = position - frame.camera.position
    slope = np.where((slope * away).sum(-1, keepdims=True) > 0, -slope, slope)
    known = np.isfinite(slope).all(-1)
    known[[0, -1]] = known[:, [0, -1]] = False
    # Not across edges: neighbours have the same id and normal.
    for buffer, limit in ((frame.ids, 0), (frame.normal, 0.2)):
        if buffer is None:
            continue
        image = np.atleast_3d(np.asarray(buffer, np.float64))
        for axis in (0, 1):
            for step in (1, -1):
                known &= np.abs(np.roll(image, step, axis) - image).max(-1) <= limit
    return np.nan_to_num(slope), known


# Albedo


def _albedo(shot: list[Frame]) -> Finding:
    """Reflectance is 0 to 1, and does not follow the light."""
    if (lacking := _lacking(shot, "albedo")) is not None:
        return Finding("albedo", "unchecked", f"no albedo{lacking}")
    above = float(np.mean([(np.asarray(frame.albedo) > 1.001).any(-1).mean() for frame in shot]))
    below = float(np.mean([(np.asarray(frame.albedo) < 0).any(-1).mean() for frame in shot]))
    if above > 0.01:
        stored = f"above 1 at {above:.0%} of the pixels: not a reflectance"
        return Finding("albedo", "wrong", stored, "the reflectance alone, without light; 1 on metals and mirrors")
    if below > 0.01:
        return Finding("albedo", "wrong", f"negative at {below:.0%} of the pixels", "the reflectance alone")
    if all(_is_colour(frame) for frame in shot):
        stored = "contains lighting: it is the colour"
        return Finding("albedo", "wrong", stored, "the reflectance alone, without light", witnesses=("color",))
    if any(frame.normal is None or frame.ids is None for frame in shot):
        return Finding("albedo", "unclear", "from 0 to 1; without ids and normals, lighting in it cannot be told")
    found = [each for frame in shot for each in _lit(frame)]
    if len(found) < 4:
        return Finding("albedo", "unclear", "from 0 to 1; too few normals to tell whether it contains lighting")
    share, weight = np.array(found).T
    mean = float((share * weight).sum() / weight.sum())
    error = float(np.sqrt((weight**2 * (share - mean) ** 2).sum()) / weight.sum())
    if mean > max(_LIT, _SIGMAS * error):
        stored = f"contains lighting: within objects it follows colour from normal to normal (slope {mean:.2f})"
        return Finding("albedo", "wrong", stored, "the reflectance alone, without light", mean, error, (), ("color",))
    stored = "reflectance, 0 to 1, without lighting"
    return Finding("albedo", "right", stored, "", 1 - mean, error, (), ("color", "normal", "ids"))


def _is_colour(frame: Frame) -> bool:
    """Whether the albedo is the colour, noise and all, as far as it is below 1."""
    albedo, color = np.asarray(frame.albedo, np.float64), np.asarray(frame.color, np.float64)
    lit = np.isfinite(color).all(-1) & (color > 0).any(-1)
    return bool(lit.any() and np.isclose(albedo, color.clip(0, 1), rtol=1e-3, atol=1e-6)[lit].all(-1).mean() > 0.9)


def _lit(frame: Frame) -> Iterator[tuple[float, float]]:
    """For each object, the slope of albedo over colour, both as functions of the normal, and its weight.

    Within an object, colour follows the normals by its lighting; albedo should not. Means over groups of like normals
    free both from texture and noise. The slope is that of logarithms: 0 for a reflectance, 1 where it is lit alike.
    Such objects are left out if hue changes with the normal: they are painted, and in even light colour follows paint.
    """
    ids, normal = np.asarray(frame.ids), np.asarray(frame.normal, np.float64)
    paint = np.asarray(frame.albedo, np.float64)
    albedo = paint.mean(-1)
    color = np.nan_to_num(np.asarray(frame.color, np.float64).mean(-1), posinf=0)
    color -= 0 if frame.emission is None else np.asarray(frame.emission, np.float64).mean(-1)
    for number in np.unique(ids[ids > 0]):
        here = (ids == number) & (albedo > 0) & np.isfinite(normal).all(-1)
        if here.sum() < 64:
            continue
        groups = np.round(normal[here] * 2) @ np.array([1.0, 10.0, 100.0])
        _, group, count = np.unique(groups, return_inverse=True, return_counts=True)
        sums = [np.bincount(group, weights=image[here]) / count for image in (albedo, color)]
        kept = (count >= 16) & (sums[1] > 0)
        if kept.sum() < 3:
            continue
        a, c = (np.log(each[kept]) for each in sums)
        weights = count[kept] / count[kept].sum()
        a, c = a - weights @ a, c - weights @ c
        variance = float(weights @ c**2)
        if variance <= 0.01:
            continue
        slope = float(weights @ (a * c)) / variance
        hues = np.stack([np.bincount(group, weights=paint[here, k])[kept] for k in range(3)])
        hues = hues / hues.sum(0)
        painted = ((hues - hues @ weights[:, None]) ** 2).sum(0) @ weights > _HUE**2
        if slope < _LIT or not painted:
            yield slope, variance * float(here.sum())


# Ids


def _ids(shot: list[Frame]) -> Finding:
    """Surfaces keep their ids from frame to frame."""
    if (lacking := _lacking(shot, "ids")) is not None:
        return Finding("ids", "unchecked", f"no ids{lacking}")
    geometry = _all(shot, "camera") and all(frame.depth is not None or frame.position is not None for frame in shot)
    if not (_all(shot, "motion") or geometry):
        return Finding("ids", "unchecked", "no motion by which to find surfaces in the frame before")
    shares = np.concatenate([_renumbered(before, frame) for before, frame in pairwise(shot)])
    shares = shares[np.isfinite(shares)]
    told = ("motion" if _all(shot, "motion") else "camera",)
    if len(shares) < 4:
        return Finding("ids", "unclear", "too few surfaces are found in the frame before", witnesses=told)
    mean, error = float(shares.mean()), float(shares.std(ddof=1) / np.sqrt(len(shares)))
    if mean > _CHANGES:
        stored = f"{mean:.0%} of the surfaces that are found in the frame before had another id there"
        remedy = "ids that objects keep from frame to frame, or none: all history is lost with them"
        return Finding("ids", "wrong", stored, remedy, mean, error, (), told)
    if mean > _KEEPS:
        stored = f"{mean:.0%} of the surfaces that are found in the frame before had another id there"
        return Finding("ids", "unclear", stored, "", 1 - mean, error, (), told)
    return Finding("ids", "right", "surfaces keep them from frame to frame", "", 1 - mean, error, (), told)


def _renumbered(before: Frame, frame: Frame) -> NDArray[np.float64]:
    """Where a surface's id is none of the four around its place in the frame before: shares of tiles, flat."""
    motion = frame.motion
    if motion is None:
        assert frame.camera is not None
        assert before.camera is not None
        motion = _still(frame, before.camera)
    motion = np.array(motion, np.float32)
    motion[..., :2] += np.float32(_shift(frame, before))
    tests: dict[str, Any] = {}
    for name in ("depth", "normal"):
        if _all([before, frame], name):
            tests |= {name: getattr(frame, name), f"previous_{name}": getattr(before, name)}
    _, found = reproject(np.zeros(frame.shape, np.float32), motion, fallback=False, **tests)
    rows, columns = np.mgrid[: frame.height, : frame.width]
    places = np.nan_to_num(np.stack([columns, rows], -1) + motion[..., :2], posinf=0, neginf=0)
    low = np.floor(places).astype(int)
    ids, known = np.asarray(frame.ids), np.asarray(before.ids)
    kept = np.zeros(frame.shape, bool)
    for dy in (0, 1):
        for dx in (0, 1):
            x = np.clip(low[..., 0] + dx, 0, frame.width - 1)
            y = np.clip(low[..., 1] + dy, 0, frame.height - 1)
            kept |= known[y, x] == ids
    return _means(~kept, (found > 0.5) & (ids > 0))
