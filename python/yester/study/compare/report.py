"""Reports of measurements: charts as PNG and SVG, and a self-contained HTML page with charts, table and images."""

from __future__ import annotations

import base64
import html
import json
import re
from collections.abc import Iterable, Sequence
from importlib.resources import files
from io import BytesIO, StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from tqdm import tqdm

from yester import rejection
from yester.io.files import beside
from yester.io.pictures import encoded
from yester.metrics import METRICS, Metric, flip_map, metric

from .methods import Result
from .points import ALL, Point, pareto

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..rendered.recording import Recording

__all__ = ["draw", "save_images", "stored_images", "write_figures", "write_report"]

#: Upper ends of the colour maps: error (FLIP), history length in frames, passes.
WORST, LONGEST, PASSES = 0.5, 32, 8

# After Okabe and Ito, "Color Universal Design" (2008); light colours darkened, to be legible on white and on black.
COLORS = ("#0072b2", "#d55e00", "#009e73", "#b8589a", "#cc8a00", "#3d9bd1", "#7a7f87")
_OURS, _PEERS = ("o", "^", "v", "p"), ("D", "s", "X", "P")
INK, GRID, PAPER = "#1f2328", "#d8dee4", "#ffffff"

#: WebP quality of images: visually lossless for colours, less for the error map, lossless for the others.
_KINDS: dict[str, dict[str, Any]] = {
    "color": {"quality": 85},
    "error": {"quality": 50},
    "history": {"lossless": True},
    "confidence": {"lossless": True},
    "rejection": {"lossless": True},
    "choice": {"lossless": True},
}


def save_images(folder: Path, index: int, result: Result, reference: ArrayLike | None = None) -> None:
    """Write the images of one frame for a page.

    ``color_0007.webp`` is the sRGB image. The others are grey maps in 8 bits: ``error`` is FLIP, clipped at 0.5;
    ``history`` the history length in whole frames, clipped at 32; ``confidence`` ranges from 0 to 1; ``rejection`` has
    the bits of `yester.Rejection`; ``choice`` is the chosen number of passes, clipped at 8. Images whose data are
    missing are not written, and earlier files of these names are removed.

    Parameters
    ----------
    folder : Path
        Output folder, created if missing.
    index : int
        Index of the frame.
    result : Result
        A method's result for the frame.
    reference : (H, W, 3) array_like of float, optional
        Linear.

    Raises
    ------
    ValueError
        If the reference has another size than the result, or either has values that are not finite.
    ImportError
        If Pillow is not installed, or flip-evaluator, which a reference needs.
    """
    coded = _pictures(result, reference)
    folder.mkdir(parents=True, exist_ok=True)
    for kind in _KINDS:
        path = folder / f"{kind}_{index:04}.webp"
        if kind in coded:
            with beside(path) as temporary:
                temporary.write_bytes(coded[kind])
        else:
            path.unlink(missing_ok=True)


def stored_images(folder: Path) -> dict[int, dict[str, Path]]:
    """Find the images of `save_images`, by frame and kind: ``color``, ``error``, ``history`` and so on.

    Parameters
    ----------
    folder : Path
        The folder of one method on one sequence.

    Returns
    -------
    dict of int to dict of str to Path
        In the order of the frames; other files are ignored.
    """
    found: dict[int, dict[str, Path]] = {}
    for path in sorted(folder.iterdir()):
        named = re.fullmatch(r"([a-z]+)_(\d+)\.webp", path.name)
        if named and named[1] in _KINDS:
            found.setdefault(int(named[2]), {})[named[1]] = path
    return dict(sorted(found.items()))


def draw(points: Sequence[Point], metric: Metric, *, among: Sequence[Point] | None = None) -> Figure:
    """Draw a metric over the time of a frame.

    A family has one colour, a line, and a label. Peers have hollow markers of another shape; defaults are ringed. Thin
    lines show the quartiles of the time. A pale line joins the Pareto front. A point without a time, such as the noisy
    input, is a horizontal line. The label of the time axis has the size of the timed frames, if all have one size.

    Parameters
    ----------
    points : sequence of Point
        Of one scene. Points without a finite value of the metric are left out.
    metric : Metric
        One of `metrics.METRICS`.
    among : sequence of Point, optional
        All points of this and other charts, so that a family has the same colour in all of them. By default `points`.

    Returns
    -------
    matplotlib.figure.Figure
        The markers of ``points[i]`` have the gid ``point-i``.

    Raises
    ------
    ValueError
        If no point has the metric, or the points belong to several scenes.
    ImportError
        If matplotlib is not installed.
    """
    scenes = {point.scene for point in points}
    if len(scenes) > 1:
        raise ValueError(f"points: expected those of one scene, got {', '.join(sorted(scenes))}")
    shown = [(i, point) for i, point in enumerate(points) if np.isfinite(point.values.get(metric.key, np.nan))]
    if not shown:
        raise ValueError(f"points: expected at least one with a finite {metric.key}, got none")
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ImportError("charts need matplotlib: pip install 'yester[study]'") from error

    # At 72 dots per inch a pixel is a point, the unit of offsets.
    figure = Figure((8.4, 5.4), dpi=72)
    axes = _axes(figure, metric, [point.values[metric.key] for _, point in shown])
    styles = _styles(points if among is None else among)
    families: dict[str, list[tuple[float, float]]] = {}
    if len(sizes := {point.size for _, point in shown if point.size}) == 1:
        axes.set_xlabel("time of a frame of {}×{} [ms]".format(*sizes.pop()))
    timed = []
    for i, point in shown:
        value = point.values[metric.key]
        if point.ms <= 0:
            axes.axhline(value, color=INK, linestyle=(0, (5, 3)), linewidth=1.2, gid=f"point-{i}")
            words: dict[str, Any] = {"textcoords": "offset points", "color": INK, "size": 9.5}
            axes.annotate(point.method, (0, value), (4, 3), ("axes fraction", "data"), **words)
            continue
        color, marker = styles[point.family]
        timed.append(point)
        families.setdefault(point.family, []).append((point.ms, value))
        axes.plot(point.ms_range, [value] * 2, color=color, linewidth=1, alpha=0.5, zorder=2)
        axes.plot(
            *([point.ms], [value]),
            marker=marker,
            markersize=9 if point.default else 6.5,
            color=PAPER if point.peer else color,
            markeredgecolor=INK if point.default else color,
            markeredgewidth=1.6 if point.default or point.peer else 0,
            linestyle="none",
            zorder=4 + point.default,
            gid=f"point-{i}",
        )
    front = pareto(timed, metric)
    stairs = [point.ms for point in front], [point.values[metric.key] for point in front]
    axes.plot(*stairs, color=INK, alpha=0.13, linewidth=7, solid_capstyle="round", drawstyle="steps-post", zorder=1)
    axes.autoscale_view()  # otherwise limits, and with them positions of points, are only known after drawing
    lines = {family: _ordered(axes, np.array(places)) for family, places in families.items()}
    for family, line in lines.items():
        axes.plot(*line.T, color=styles[family][0], linewidth=1.4, alpha=0.8, zorder=3)
    if lines:
        _name(axes, lines, {family: _dark(color) for family, (color, _) in styles.items()})
    figure.text(0.085, 0.955, _title(*scenes), color=INK, size=13, weight="bold", va="center")
    _key(figure, default=any(p.default for _, p in shown), peer=any(p.peer for _, p in shown))
    return figure


def write_figures(points: Sequence[Point], folder: Path) -> list[Path]:
    """Write the charts of all metrics and scenes as PNG and SVG.

    Parameters
    ----------
    points : sequence of Point
        Of any number of scenes.
    folder : Path
        For ``psnr_all.png`` and so on; created if missing.

    Returns
    -------
    list of Path
        The written files. There is no chart of a metric that no point of the scene has.

    Raises
    ------
    ValueError
        If there are no points, or they have an unknown metric.
    ImportError
        If matplotlib is not installed.
    """
    _known(points)
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for scene, each, figure in _charts(points):
        for path in figure_paths(folder, each.key, scene):
            with beside(path) as temporary, temporary.open("wb") as file:
                save_figure(figure, file, path.suffix[1:])
            written.append(path)
    return written


def figure_paths(folder: Path, key: str, scene: str) -> list[Path]:
    """The files of a metric's chart."""
    return [folder / f"{key}_{re.sub(r'[^A-Za-z0-9._-]+', '-', scene)}.{kind}" for kind in ("png", "svg")]


def write_report(
    path: Path,
    points: Sequence[Point],
    recordings: Iterable[Recording],
    *,
    title: str = "Yester: error over time",
    about: str = "",
) -> None:
    """Write the page: charts, a table and images to compare, in one self-contained file.

    Parameters
    ----------
    path : Path
        The HTML file.
    points : sequence of Point
        Of any number of scenes. The page shows the images of points whose `images` is a folder of `save_images`.
    recordings : iterable of Recording
        The sequences of these points; their references are shown beside the methods' images.
    title, about : str
        Heading, and a paragraph below it, such as machine and options.

    Raises
    ------
    ValueError
        If there are no points, two points of one scene and method, an unknown metric, or images of a scene that is not
        among the recordings.
    ImportError
        If matplotlib, Pillow or flip-evaluator is not installed.
    """
    _known(points)
    by_name = {recording.name: recording for recording in recordings}
    by_scene: dict[str, list[Point]] = {}
    stored: dict[str, dict[str, dict[int, dict[str, Path]]]] = {}
    for point in points:
        same = by_scene.setdefault(point.scene, [])
        if any(point.method == other.method for other in same):
            raise ValueError(f"points: expected each method once in {point.scene}, got {point.method} twice")
        same.append(point)
        if point.images is not None:
            if point.scene not in by_name:
                raise ValueError(f"recordings: expected one named {point.scene}, got {', '.join(by_name) or 'none'}")
            stored.setdefault(point.scene, {})[point.method] = stored_images(point.images)
    by_scene = dict(sorted(by_scene.items(), key=lambda item: item[0] != ALL))
    path.parent.mkdir(parents=True, exist_ok=True)
    with beside(path) as temporary:
        charts: dict[str, dict[str, str]] = {scene: {} for scene in by_scene}
        for scene, each, figure in _charts(points):
            charts[scene][each.key] = _inline(figure)
        styles = _styles(points)
        # Methods with equal maps share one copy.
        images: dict[bytes, int] = {}
        data: dict[str, Any] = {
            "metrics": [
                {"key": m.key, "label": m.label, "higher": m.higher_is_better, "exact": m.exact}
                for m in _metrics(points)
            ],
            "scenes": [
                {
                    "name": scene,
                    "title": _title(scene),
                    "points": [_plain(point, styles) for point in same],
                    "charts": charts[scene],
                }
                for scene, same in by_scene.items()
            ],
            "sequences": [
                _sequence(by_name[scene], by_scene[scene], found, images)
                for scene, found in tqdm(stored.items(), "images", unit="scene", disable=None)
            ],
            "maps": {
                "error": {"label": "error (FLIP)", "high": WORST, "more": True, "colors": _gradient("magma")},
                "history": {"label": "history length", "high": LONGEST, "more": True, "colors": _gradient("viridis")},
                "confidence": {"label": "confidence", "high": 1, "more": False, "colors": _gradient("viridis")},
                "choice": {"label": "chosen passes", "high": PASSES, "more": True, "colors": _gradient("viridis")},
            },
            "rejections": [
                {"bit": bit.value, "name": (bit.name or "").lower(), "color": color}
                for bit, color in rejection.COLORS.items()
            ],
        }
        data["images"] = [f"data:image/webp;base64,{base64.b64encode(image).decode()}" for image in images]
        write_page(temporary, data, title=title, about=about)


def write_page(
    path: Path, data: dict[str, Any], *, title: str, about: str, precision: str = "", pixels: Iterable[str] = ()
) -> None:
    """Fill the page with data: a report's, or linear images to compare, which are elements of the page."""
    # Escaped, so that no text in the data can close the script element.
    text = json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    colors = "".join(
        f"--line{i}: color-mix(in srgb, {color} var(--pure), var(--ink)); "
        f"--name{i}: color-mix(in srgb, {color} 60%, var(--ink)); "
        for i, color in enumerate(COLORS)
    )
    words = {"title": title, "about": about, "precision": precision}
    filled = {name: html.escape(value) for name, value in words.items()} | {"colors": colors, "data": text}
    template = files(__package__).joinpath("report.html").read_text("utf-8")
    with path.open("w", encoding="utf-8") as page:
        for i, piece in enumerate(re.split(r"{{(\w+)}}", template)):
            # Pixels are long, so they are not held together.
            page.writelines(pixels if i % 2 and piece == "pixels" else [filled[piece] if i % 2 else piece])


def _known(points: Sequence[Point]) -> None:
    if not points:
        raise ValueError("points: expected at least one, got none")
    for key in {key for point in points for key in point.values}:
        metric(key)


def _title(scene: str) -> str:
    return "Mean over all scenes" if scene == ALL else scene


def _metrics(points: Sequence[Point]) -> list[Metric]:
    """The metrics that at least one point has."""
    return [
        each for each in METRICS.values() if any(np.isfinite(point.values.get(each.key, np.nan)) for point in points)
    ]


def _charts(points: Sequence[Point]) -> Iterable[tuple[str, Metric, Figure]]:
    """Scene, metric and chart, for every scene and every metric that it has."""
    by_scene: dict[str, list[Point]] = {}
    for point in points:
        by_scene.setdefault(point.scene, []).append(point)
    wanted = [(scene, same, each) for scene, same in by_scene.items() for each in _metrics(same)]
    for scene, same, each in tqdm(wanted, "charts", unit="chart", disable=None):
        yield scene, each, draw(same, each, among=points)


def _axes(figure: Figure, metric: Metric, values: Sequence[float]) -> Any:
    """Axes: time to the right, the metric upwards; logarithmic for large ranges."""
    from matplotlib.ticker import FuncFormatter, LogLocator

    axes = figure.add_axes((0.085, 0.105, 0.895, 0.775), facecolor="none")
    spread = not metric.higher_is_better and min(values) > 0 and max(values) > 8 * min(values)
    axes.set(xscale="log", yscale="log" if spread else "linear")
    for axis in (axes.xaxis, axes.yaxis)[: 1 + spread]:
        axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.minorticks_off()
    axes.margins(0.07, 0.08)
    axes.grid(color=GRID, linewidth=0.7)
    axes.set_axisbelow(True)
    axes.tick_params(length=0, labelsize=9, labelcolor=INK, pad=5)
    for side, spine in axes.spines.items():
        spine.set(visible=side in ("left", "bottom"), edgecolor=GRID)
    better = "" if metric.exact is not None else f", {'higher' if metric.higher_is_better else 'lower'} is better"
    axes.set_xlabel("time of a frame [ms]", color=INK, size=10)
    axes.set_ylabel(f"{metric.label}{better}", color=INK, size=10)
    return axes


def _key(figure: Figure, *, default: bool, peer: bool) -> None:
    """The legend of markers."""
    from matplotlib.lines import Line2D

    mark: dict[str, Any] = {"linestyle": "none", "markersize": 7, "color": INK, "markeredgewidth": 0}
    ring: dict[str, Any] = {"markeredgecolor": INK, "markeredgewidth": 1.6}
    keys = [Line2D([], [], marker="o", label="Yester", **mark)]
    if default:
        keys.append(Line2D([], [], marker="o", label="its default", **mark | ring | {"color": GRID}))
    if peer:
        keys.append(Line2D([], [], marker="D", label="others", **mark | ring | {"color": PAPER}))
    keys.append(Line2D([], [], color=INK, alpha=0.13, linewidth=7, label="Pareto front"))
    place: dict[str, Any] = {"loc": "center right", "bbox_to_anchor": (0.985, 0.955), "frameon": False}
    figure.legend(handles=keys, ncols=len(keys), fontsize=9, labelcolor=INK, columnspacing=1.6, **place)


def _styles(points: Sequence[Point]) -> dict[str, tuple[str, str]]:
    """Colour and marker of each family; when colours run out, they repeat with other markers."""
    styles: dict[str, tuple[str, str]] = {}
    for peer, markers in ((False, _OURS), (True, _PEERS)):
        families = dict.fromkeys(point.family for point in points if point.peer is peer and point.ms > 0)
        for i, family in enumerate(families):
            styles[family] = COLORS[i % len(COLORS)], markers[i // len(COLORS) % len(markers)]
    return styles


def _ordered(axes: Any, line: NDArray[np.float64]) -> NDArray[np.float64]:
    """The points of a family, sorted along the axis on which they spread further."""
    places = axes.transData.transform(line)
    return line[np.argsort(places[:, np.ptp(places, axis=0).argmax()], kind="stable")]


def _name(axes: Any, lines: dict[str, NDArray[np.float64]], colors: dict[str, str]) -> None:
    """Label each family beside one of its points, with the least overlap."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    style: dict[str, Any] = {"size": 9.5, "ha": "center", "va": "center", "zorder": 6}
    renderer = FigureCanvasAgg(axes.figure).get_renderer()
    halves = {}
    for family in lines:
        text = axes.figure.text(0.5, 0.5, family, **style)
        halves[family] = text.get_window_extent(renderer).size / 2
        text.remove()
    places = {family: axes.transData.transform(line) for family, line in lines.items()}
    leader = {"arrowstyle": "-", "linewidth": 0.7, "shrinkA": 0, "shrinkB": 5}
    for family, (point, offset) in _clear(places, halves, axes.get_window_extent(renderer)).items():
        far = bool((np.abs(offset) - halves[family] > 10).any())
        arrow = {**leader, "color": colors[family]} if far else None
        place = {"xytext": offset, "textcoords": "offset points", "color": colors[family]}
        axes.annotate(family, lines[family][point], arrowprops=arrow, **place, **style)


def _dark(color: str) -> str:
    """A darker version of the colour, legible as text on white."""
    pure, ink = (np.frombuffer(bytes.fromhex(c[1:]), np.uint8) for c in (color, INK))
    return "#" + np.rint(0.6 * pure + 0.4 * ink).astype(np.uint8).tobytes().hex()


def _clear(
    lines: dict[str, NDArray[np.float64]], halves: dict[str, NDArray[np.float64]], frame: Any
) -> dict[str, tuple[int, NDArray[np.float64]]]:
    """For each line, the point and offset, in pixels, at which a box of the given half size overlaps least."""
    marks = np.concatenate([*lines.values()])
    steps = np.linspace(0, 1, 16)[:, None, None]
    strokes = np.concatenate([(line[:-1] * (1 - steps) + line[1:] * steps).reshape(-1, 2) for line in lines.values()])
    sides = np.array([(1, 0), (-1, 0), (0, 1), (0, -1), (0.7, 0.7), (-0.7, 0.7), (0.7, -0.7), (-0.7, -0.7)])
    gaps = np.repeat([8, 18, 32, 50, 75], len(sides))
    sides = np.tile(sides, (5, 1))
    taken: dict[str, tuple[int, NDArray[np.float64]]] = {}
    for _ in range(3):  # repeated, as the first labels are placed without knowing the last
        for family, line in lines.items():
            half = halves[family]
            offsets = sides * gaps[:, None] + np.sign(sides) * half
            boxes = (line[:, None] + offsets).reshape(-1, 2)
            cost = 0.06 * np.tile(gaps, len(line)) + 4 * _inside(marks, boxes, half + 4).sum(1)
            cost += 0.5 * _inside(strokes, boxes, half + 1).sum(1)
            for other, (point, offset) in taken.items():
                if other != family:
                    cost += 50 * _inside(lines[other][point] + offset[None], boxes, half + halves[other] + 1)[:, 0]
            cost += 100 * ((boxes - half < frame.min).any(1) | (boxes + half > frame.max).any(1))
            best = int(cost.argmin())
            taken[family] = best // len(offsets), offsets[best % len(offsets)]
    return taken


def _inside(points: NDArray[np.float64], middles: NDArray[np.float64], half: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which points lie in which boxes, (boxes, points)."""
    return np.asarray((np.abs(points - middles[:, None]) < half).all(-1), np.bool_)


def save_figure(figure: Figure, file: Any, kind: str, paper: str = PAPER) -> None:
    """Write a figure as ``kind``, "png" or "svg"."""
    from matplotlib import rc_context

    # Reproducible: equal points give equal bytes.
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "yester"}):
        metadata = {"Date": None} if kind == "svg" else None
        figure.savefig(file, format=kind, dpi=160, facecolor=paper, metadata=metadata)


def _inline(figure: Figure) -> str:
    """The SVG as an element of the page, with its colours and its font."""
    file = StringIO()
    save_figure(figure, file, "svg", paper="none")
    svg = file.getvalue()
    svg = re.sub(r"<metadata>.*?</metadata>|<style.*?</style>", "", svg[svg.index("<svg") :], flags=re.DOTALL)
    svg = re.sub(r" font-family: [^;\"]*;", "", svg)
    svg = re.sub(r"\s*\n\s*", "\n", svg)
    for name, color in (("ink", INK), ("grid", GRID), ("paper", PAPER)):
        svg = svg.replace(color, f"var(--{name})")
    for i, color in enumerate(COLORS):
        svg = svg.replace(color, f"var(--line{i})").replace(_dark(color), f"var(--name{i})")
    return svg


def _plain(point: Point, styles: dict[str, tuple[str, str]]) -> dict[str, Any]:
    return {
        **{name: getattr(point, name) for name in ("method", "default", "peer", "ms")},
        "range": point.ms_range,
        "values": {key: value for key, value in point.values.items() if np.isfinite(value)},
        "color": f"var(--line{COLORS.index(styles[point.family][0])})" if point.ms > 0 else "var(--ink)",
    }


def _sequence(
    recording: Recording,
    points: Sequence[Point],
    stored: dict[str, dict[int, dict[str, Path]]],
    images: dict[bytes, int],
) -> dict[str, Any]:
    """The images of one sequence: those of the methods, and the references."""
    frames = sorted({index for each in stored.values() for index in each})
    sources = []
    for point in points:
        files = [stored.get(point.method, {}).get(index, {}) for index in frames]
        read = [{kind: path.read_bytes() for kind, path in each.items()} for each in files]
        family = point.family if point.ms > 0 else None
        sources.append(_source(point.method, read, images) | {"family": family, "default": point.default})
    known = [index in recording.references for index in frames]
    truth = [_pictures(Result(recording.reference(i))) if has else {} for i, has in zip(frames, known, strict=True)]
    sources.append(_source("reference", truth, images))
    return {"name": recording.name, "frames": frames, "sources": [source for source in sources if source["views"]]}


def _source(name: str, frames: Sequence[dict[str, bytes]], images: dict[bytes, int]) -> dict[str, Any]:
    """The images of a method or reference: by kind, the index of each frame's image, or null."""
    views = {
        kind: [images.setdefault(frame[kind], len(images)) if kind in frame else None for frame in frames]
        for kind in _KINDS
        if any(kind in frame for frame in frames)
    }
    return {"name": name, "views": views}


def _pictures(result: Result, reference: ArrayLike | None = None) -> dict[str, bytes]:
    """By kind, the encoded images that `save_images` writes."""
    try:
        from PIL import Image
    except ImportError as error:
        raise ImportError("images of the report need Pillow: pip install 'yester[study]'") from error
    images = {"color": encoded(result.color)}
    if reference is not None:
        images["error"] = _bytes(flip_map(result.color, reference) / WORST)
    if result.history_length is not None:
        images["history"] = _bytes(np.rint(result.history_length) / LONGEST)
    if result.confidence is not None:
        images["confidence"] = _bytes(result.confidence)
    if result.rejection is not None:
        images["rejection"] = result.rejection
    if result.choice is not None:
        images["choice"] = _bytes(result.choice / PASSES)
    coded = {}
    for kind, image in images.items():
        file = BytesIO()
        Image.fromarray(image).save(file, "webp", **_KINDS[kind])
        coded[kind] = file.getvalue()
    return coded


def _bytes(values: NDArray[np.floating[Any]]) -> NDArray[np.uint8]:
    """Quantise values from 0 to 1 to 8 bits."""
    return np.asarray(np.clip(values, 0, 1) * 255 + 0.5).astype(np.uint8)


def _gradient(name: str) -> str:
    """The 256 colours of a colour map, in hexadecimal digits."""
    from matplotlib import colormaps

    return str(colormaps[name](np.arange(256), bytes=True)[:, :3].tobytes().hex())
