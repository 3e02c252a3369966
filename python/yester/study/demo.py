"""The demo: render a short sequence at one sample per pixel, denoise it, and show its error against references."""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from yester import Camera, Frame, denoise
from yester.io import write_exr
from yester.io.files import beside
from yester.io.mitsuba import render_sequence
from yester.io.pictures import displayed, write_animation
from yester.metrics import flip_map, psnr, relmse

from .rendered.scenes import cornell_box

if TYPE_CHECKING:
    from matplotlib.axes import Axes

T = TypeVar("T")

__all__ = ["REFERENCES", "REFERENCE_SPP", "WRITTEN", "Report", "Score", "run"]

#: Samples per pixel of the reference frames, and their number, chosen for three minutes on two cores.
REFERENCE_SPP = 128
REFERENCES = 8

#: The files and folders that a run writes.
WRITTEN = ("contact_sheet.png", "side_by_side.webp", "noisy", "denoised", "reference")

#: Details that the contact sheet enlarges: the ball, at this position, and the cube. The colours mark both.
BALL = (0.5, -0.55, -0.05)
MARKS = ("#ffb000", "#36c5f0")


@dataclass(frozen=True)
class Score:
    """Errors of one image, or the means over several."""

    psnr: float
    relmse: float
    flip: float

    def __str__(self) -> str:
        return f"PSNR {self.psnr:.1f} dB   relMSE {self.relmse:.3f}   FLIP {self.flip:.3f}"


@dataclass(frozen=True)
class Report:
    """The demo's measurements and its output folder."""

    folder: Path
    frames: int
    measured: list[int]
    noisy: Score
    denoised: Score
    render_ms: float
    denoise_ms: float
    reference_ms: float

    def __str__(self) -> str:
        spp = f"reference, {REFERENCE_SPP} spp"
        return "\n".join(
            [
                f"{'':<20}{'PSNR':>9}{'relMSE':>9}{'FLIP':>8}{'ms per frame':>15}",
                _row("noisy, 1 spp", self.noisy) + f"{self.render_ms:>15.1f}  rendering",
                _row("denoised", self.denoised) + f"{self.denoise_ms:>15.1f}  SVGF, both sides",
                f"{spp:<46}{self.reference_ms:>15.1f}  rendering",
                f"Errors are means over frames {', '.join(map(str, self.measured))}, times over all frames.",
            ]
        )


@dataclass(frozen=True)
class _Shot:
    """A frame with a reference."""

    index: int
    camera: Camera
    cube: NDArray[np.float64]
    noisy: NDArray[np.float32]
    denoised: NDArray[np.float32]


def run(folder: str | os.PathLike[str], *, frames: int = 24, width: int = 320, height: int = 240) -> Report:
    """Render `scenes.cornell_box`, denoise it with earlier and later frames, measure and show the result.

    Writes `noisy/`, `denoised/` and `reference/` with one EXR per frame, `contact_sheet.png` and `side_by_side.webp`.
    There are `REFERENCES` references, spread evenly from the first to the last frame. Nothing is overwritten or
    removed.

    Parameters
    ----------
    folder : path
        Output folder, created if missing.
    frames, width, height : int
        Number and size of the frames.

    Returns
    -------
    Report
        Its text is a table.

    Raises
    ------
    FileExistsError
        If one of these files or folders already exists.
    """
    folder = Path(folder)
    for name in WRITTEN:
        if (folder / name).exists():
            raise FileExistsError(f"{folder / name}: already exists; choose another folder, or remove it")
    for name in ("noisy", "denoised", "reference"):
        (folder / name).mkdir(parents=True)

    sequence = cornell_box(frames, width, height)
    measured = sorted({round(i) for i in np.linspace(0, frames - 1, min(frames, REFERENCES))})
    shots: list[_Shot] = []
    film: list[NDArray[np.float32]] = []
    rendered = _Timed(render_sequence(sequence.scene, sequence.cameras, spp=1, transforms=sequence.transforms))
    waiting: deque[Frame] = deque()

    def kept() -> Iterator[Frame]:
        for noisy in rendered:
            waiting.append(noisy)
            yield noisy

    clean = _Timed(denoise(kept()))
    for i, output in enumerate(_progress(clean, "render and denoise", frames)):
        noisy, denoised = waiting.popleft(), output.color
        write_exr(folder / "noisy" / f"frame_{i:04}.exr", noisy)
        write_exr(folder / "denoised" / f"frame_{i:04}.exr", Frame(denoised, camera=noisy.camera))
        film.append(np.hstack([noisy.color, denoised]))
        if i in measured:
            shots.append(_Shot(i, sequence.cameras[i], sequence.transforms[i]["cube"], noisy.color, denoised))

    references = _Timed(
        render_sequence(
            sequence.scene,
            [sequence.cameras[i] for i in measured],
            spp=REFERENCE_SPP,
            seed=frames,  # above the seeds of the noisy frames
            transforms=[sequence.transforms[i] for i in measured],
            buffers=False,
        )
    )
    scores = []
    shown = {measured[0], measured[len(measured) // 2], measured[-1]}
    rows = []
    for shot in _progress(shots, "reference", len(shots)):
        reference = next(references).color
        write_exr(folder / "reference" / f"frame_{shot.index:04}.exr", Frame(reference, camera=shot.camera))
        images = (shot.noisy, shot.denoised)
        maps = [flip_map(image, reference) for image in images]
        scores.append(
            [
                Score(psnr(image, reference), relmse(image, reference), float(error.mean()))
                for image, error in zip(images, maps, strict=True)
            ]
        )
        if shot.index in shown:
            rows.append(_Row(shot, reference, maps, scores[-1]))

    _contact_sheet(folder / "contact_sheet.png", rows)
    write_animation(folder / "side_by_side.webp", film, fps=12)
    noisy_score, denoised_score = (_mean([pair[i] for pair in scores]) for i in range(2))
    return Report(
        folder,
        frames,
        measured,
        noisy_score,
        denoised_score,
        1e3 * rendered.seconds / frames,
        1e3 * (clean.seconds - rendered.seconds) / frames,
        1e3 * references.seconds / len(measured),
    )


class _Timed(Iterator[T]):
    """An iterator that adds up the time spent in it, in seconds."""

    def __init__(self, items: Iterable[T]) -> None:
        self.items = iter(items)
        self.seconds = 0.0

    def __next__(self) -> T:
        start = time.perf_counter()
        try:
            return next(self.items)
        finally:
            self.seconds += time.perf_counter() - start


def _progress(items: Iterable[T], what: str, total: int) -> Iterable[T]:
    shown: Iterable[T] = tqdm(items, what, total, unit="frame", disable=None)
    return shown


def _row(name: str, score: Score) -> str:
    return f"{name:<20}{score.psnr:>6.2f} dB{score.relmse:>9.4f}{score.flip:>8.4f}"


def _mean(scores: list[Score]) -> Score:
    return Score(*(float(np.mean([getattr(s, name) for s in scores])) for name in ("psnr", "relmse", "flip")))


@dataclass(frozen=True)
class _Row:
    """A frame of the contact sheet."""

    shot: _Shot
    reference: NDArray[np.float32]
    flip: list[NDArray[np.float32]]
    scores: list[Score]


def _contact_sheet(path: Path, rows: list[_Row]) -> None:
    """Write a row per frame: noisy, denoised, reference and both error maps, each with two enlarged details below."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    height, width = rows[0].reference.shape[:2]
    # All lengths in pixels of the sheet. At 320 pixels, a picture of the default size is not resampled.
    cell, gap, margin, head, caption = 320, 8, 12, 30, 24
    picture = round(cell * height / width)
    detail = round((cell - gap) / 2 * 0.75)
    total = 2 * margin + 5 * cell + 4 * gap, head + len(rows) * (picture + gap + detail + caption + margin) + margin
    figure = Figure((total[0] / 100, total[1] / 100), dpi=100, facecolor="white")

    def axes(x: float, y: float, w: float, h: float) -> Axes:
        result = figure.add_axes((x / total[0], 1 - (y + h) / total[1], w / total[0], h / total[1]))
        result.set(xticks=[], yticks=[])
        return result

    def text(x: float, y: float, words: str, **style: Any) -> None:
        figure.text(x / total[0], 1 - y / total[1], words, va="center", **style)

    titles = (
        "noisy, 1 spp",
        "denoised, SVGF, both sides",
        f"reference, {REFERENCE_SPP} spp",
        "FLIP of noisy",
        "FLIP of denoised",
    )
    for column, title in enumerate(titles):
        text(margin + column * (cell + gap) + cell / 2, head / 2 + 2, title, ha="center", size=11, weight="bold")
    top = head
    for row in rows:
        images: list[NDArray[Any]] = [displayed(image) for image in (row.shot.noisy, row.shot.denoised, row.reference)]
        captions = [*map(str, row.scores), f"frame {row.shot.index}", "0 (black) to 1 (white)", ""]
        boxes = _details(row.shot, width, height)
        for column, image in enumerate([*images, *row.flip]):
            left = margin + column * (cell + gap)
            style: Any = {"cmap": "magma", "vmin": 0, "vmax": 1} if image.ndim == 2 else {}
            whole = axes(left, top, cell, picture)
            whole.imshow(image, **style)
            whole.axis("off")
            for i, ((x, y, w, h), color) in enumerate(zip(boxes, MARKS, strict=True)):
                whole.add_patch(Rectangle((x - 0.5, y - 0.5), w, h, fill=False, edgecolor=color, linewidth=1))
                side = (cell - gap) / 2
                close = axes(left + i * (side + gap), top + picture + gap, side, detail)
                close.imshow(image[y : y + h, x : x + w], interpolation="nearest", aspect="auto", **style)
                for spine in close.spines.values():
                    spine.set(edgecolor=color, linewidth=1.5)
            text(left + cell / 2, top + picture + gap + detail + caption / 2, captions[column], ha="center", size=9)
        top += picture + gap + detail + caption + margin
    with beside(path) as temporary:
        figure.savefig(temporary, format="png")


def _details(shot: _Shot, width: int, height: int) -> list[tuple[int, int, int, int]]:
    """x, y, width and height of the enlarged details: the trailing edge of the cube, and the ball."""
    w, h = max(width // 7, 1), max(round(width / 7 * 0.75), 1)
    points = np.array([shot.cube[:3, 3] - [0.2, 0, 0], BALL])
    pixels, _ = shot.camera.project(points)
    corners = np.clip(np.round(pixels - [w / 2, h / 2]), 0, [width - w, height - h]).astype(int)
    return [(int(x), int(y), w, h) for x, y in corners]
