"""Charts, and the page in a browser."""

import base64
import io
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yester
from PIL import Image
from playwright.sync_api import Locator, Page, expect
from yester.io import write_exr
from yester.metrics import METRICS, flip_map, srgb
from yester.study.compare.methods import Result
from yester.study.compare.points import ALL, Point, means, pareto
from yester.study.compare.report import draw, save_images, stored_images, write_figures, write_report
from yester.study.rendered.recording import Recording

pytestmark = pytest.mark.slow

WIDTH, HEIGHT = 48, 36
SCENES = ("room", "balls")
FRAMES = (4, 5, 7)
ODD = 'odd </script> & "name"'
#: Method, family, whether default, whether peer, ms, PSNR.
METHODS = (
    ("noisy input", "noisy input", False, False, 0.0, 18.0),
    ("SVGF", "SVGF", True, False, 20.0, 31.0),
    ("SVGF, 2 passes", "SVGF", False, False, 12.0, 29.5),
    ("TAA best", "TAA best", False, False, 6.0, 26.0),
    ("OIDN high", "OIDN", False, True, 150.0, 34.0),
    (ODD, "odd", False, True, 40.0, 25.0),
)
TOLERANCE = 6  # WebP


def shade(scene: str, source: str, frame: int) -> tuple[int, int, int]:
    """A colour unique to an image."""
    names = ["reference", *(method[0] for method in METHODS)]
    return 30 + 33 * names.index(source), 40 + 80 * FRAMES.index(frame), 60 + 120 * SCENES.index(scene)


def picture(scene: str, source: str, frame: int) -> np.ndarray:
    """An image of that colour, linear, with a white square of four pixels."""
    curve = np.linspace(0, 1, 4001)
    image = np.empty((HEIGHT, WIDTH, 3), np.float32)
    image[:] = np.interp(np.array(shade(scene, source, frame)) / 255, srgb(curve), curve)
    image[24:28, 32:36] = 1
    return image


def measured(scene: str, ms_factor: float = 1) -> list[Point]:
    points = []
    for name, family, default, peer, ms, psnr in METHODS:
        time = ms * ms_factor
        values = {"psnr": psnr, "relmse": 10 ** (-psnr / 10) * 40, "ssim": 0.9}
        points.append(Point(scene, name, family, default, peer, time, (0.9 * time, 1.2 * time), values))
    return points


@pytest.fixture(scope="module")
def material(tmp_path_factory) -> tuple[list[Point], list[Recording]]:
    """Two scenes; the first also has a temporal metric, the second lacks the reference of its first frame."""
    folder = tmp_path_factory.mktemp("material")
    points, recordings = [], []
    for scene in SCENES:
        frames = [folder / f"{scene}_{i}.exr" for i in range(max(FRAMES) + 1)]
        references = {}
        for frame in FRAMES:
            if (scene, frame) != ("balls", 4):
                references[frame] = folder / f"{scene}_{frame}_reference.exr"
                write_exr(references[frame], picture(scene, "reference", frame))
        recordings.append(Recording(scene, frames, references))
        for point in measured(scene, 1 if scene == "room" else 2):
            images = folder / scene / re.sub(r"\W+", "-", point.method)
            for frame in FRAMES:
                color = picture(scene, point.method, frame)
                reference = picture(scene, "reference", frame) if frame in references else None
                own = point.family in ("SVGF", "TAA best")
                save_images(images, frame, result(color, own=own), reference)
            values = point.values | ({"flip": 0.1} if scene == "room" else {})
            points.append(replace(point, values=values, images=images))
    return means(points) + points, recordings


def result(color: np.ndarray, *, own: bool) -> Result:
    if not own:
        return Result(color)
    x = np.arange(WIDTH, dtype=np.float32) + np.zeros((HEIGHT, 1), np.float32)
    rejection = np.zeros((HEIGHT, WIDTH), np.uint8)
    rejection[:12] = yester.Rejection.DEPTH
    rejection[12:20] = yester.Rejection.DEPTH | yester.Rejection.NORMAL
    return Result(color, x, x / (WIDTH - 1), rejection, x / 8)


@pytest.fixture(scope="module")
def report(material, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(path, *material, title="Tests <b> & more", about="On <this> machine.")
    return path


# Images


def test_images_are_those_given(tmp_path):
    color, reference = picture("room", "SVGF", 4), picture("room", "reference", 4)
    given = result(color, own=True)
    save_images(tmp_path / "new", 12, given, reference)
    stored = stored_images(tmp_path / "new")
    assert {frame: sorted(kinds) for frame, kinds in stored.items()} == {
        12: ["choice", "color", "confidence", "error", "history", "rejection"]
    }
    read = {kind: np.asarray(Image.open(path), np.float64) for kind, path in stored[12].items()}
    np.testing.assert_allclose(read["color"], 255 * srgb(color), atol=3 * TOLERANCE)
    assert np.abs(read["color"] - 255 * srgb(color)).mean() < 3
    errors = 255 * np.minimum(flip_map(color, reference) / 0.5, 1)
    np.testing.assert_allclose(read["error"].mean(-1), errors, atol=8 * TOLERANCE)
    assert abs(read["error"].mean() - errors.mean()) < 3
    for kind, expected in (
        ("history", np.minimum(given.history_length / 32, 1) * 255),
        ("confidence", given.confidence * 255),
        ("rejection", given.rejection),
        ("choice", np.minimum(given.choice / 8, 1) * 255),
    ):
        np.testing.assert_allclose(read[kind], np.repeat(expected[..., None], 3, 2), atol=0.51)


def test_images_of_an_earlier_run_do_not_stay(tmp_path):
    color = picture("room", "SVGF", 4)
    save_images(tmp_path, 0, result(color, own=True), color)
    save_images(tmp_path, 1, result(color, own=True), color)
    save_images(tmp_path, 0, Result(color))
    (tmp_path / "notes_0001.txt").write_text("not an image")
    (tmp_path / "other_0001.png").write_text("of another kind")
    stored = stored_images(tmp_path)
    assert list(stored) == [0, 1]
    assert list(stored[0]) == ["color"]
    assert len(stored[1]) == 6


def test_bad_images_change_nothing(tmp_path):
    color = picture("room", "SVGF", 4)
    with pytest.raises(ValueError, match="reference"):
        save_images(tmp_path / "new", 0, Result(color), color[:, :-1])
    with pytest.raises(ValueError, match="not finite"):
        save_images(tmp_path / "new", 0, Result(color), np.full_like(color, np.nan))
    assert not (tmp_path / "new").exists()


# Charts


def test_points_are_drawn_at_their_measurements(material):
    points = [point for point in material[0] if point.scene == "room"]
    (axes,) = draw(points, METRICS["psnr"]).axes
    places = {line.get_gid(): line.get_xydata()[0] for line in axes.lines if line.get_gid()}
    assert set(places.pop("point-0")) == {0, 18}
    assert places.keys() == {f"point-{i}" for i in range(1, len(points))}
    for i, point in enumerate(points[1:], 1):
        np.testing.assert_array_equal(places[f"point-{i}"], (point.ms, point.values["psnr"]))
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "linear")
    assert axes.get_ylabel() == "PSNR [dB], higher is better"


def test_wide_ranges_are_logarithmic():
    points = measured("room")[1:4]
    assert draw(points, METRICS["relmse"]).axes[0].get_yscale() == "linear"
    points.append(replace(points[0], method="bad", values={"relmse": 3.0}))
    assert draw(points, METRICS["relmse"]).axes[0].get_yscale() == "log"


@pytest.mark.parametrize("key", ["psnr", "relmse"])
def test_the_front_is_drawn(key):
    points = measured("room")
    (axes,) = draw(points, METRICS[key]).axes
    (stairs,) = [line for line in axes.lines if line.get_drawstyle() == "steps-post"]
    expected = [(point.ms, point.values[key]) for point in pareto(points[1:], METRICS[key])]
    np.testing.assert_array_equal(stairs.get_xydata(), expected)
    assert len(expected) == 4


def test_families_keep_their_colour():
    points = measured("room")
    style = {}
    for some in (points, points[3:]):
        (axes,) = draw(some, METRICS["psnr"], among=points).axes
        for line in axes.lines:
            if line.get_gid() and line.get_marker() != "None":
                family = some[int(line.get_gid().removeprefix("point-"))].family
                look = line.get_markeredgecolor() if "OIDN" in family else line.get_color(), line.get_marker()
                assert style.setdefault(family, look) == look or family == "SVGF"
    assert len(set(style.values())) == len(style)


def test_families_keep_their_colour_from_scene_to_scene(tmp_path):
    """The second scene lacks the first family; names have their family's colour."""
    points = [replace(point, values={"psnr": point.values["psnr"]}) for point in measured("room")]
    write_figures([*points, *(replace(point, scene="balls") for point in points[3:])], tmp_path)
    looks = [
        re.search(r'style="([^"]*)"[^>]*>TAA best</text>', (tmp_path / f"psnr_{scene}.svg").read_text())[1]
        for scene in SCENES
    ]
    assert looks[0] == looks[1]


def test_the_default_is_ringed_and_peers_are_hollow():
    (axes,) = draw(measured("room"), METRICS["psnr"]).axes
    lines = {line.get_gid(): line for line in axes.lines}
    default, other, peer = (lines[f"point-{i}"] for i in (1, 2, 4))
    assert default.get_markersize() > other.get_markersize()
    assert default.get_markeredgecolor() != default.get_color() == other.get_color()
    assert peer.get_marker() != other.get_marker()
    assert peer.get_color() == "#ffffff"


def test_methods_without_time_are_lines_across():
    (axes,) = draw(measured("room"), METRICS["psnr"]).axes
    (line,) = [line for line in axes.lines if line.get_gid() == "point-0"]
    assert set(line.get_ydata()) == {18.0}
    assert axes.get_xlim()[0] > 0
    assert axes.get_ylim()[0] < 18
    assert "noisy input" in [text.get_text() for text in axes.texts]
    draw(measured("room")[:1], METRICS["psnr"])


def test_names_of_families_cover_neither_each_other_nor_points():
    """Twelve families of three points each in a narrow column, like the presets of one method."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    rng = np.random.default_rng(5)
    points = [
        Point("room", f"{family} {i}", f"family {family}", False, False, ms, (ms, ms), {"psnr": psnr})
        for family in range(12)
        for i, (ms, psnr) in enumerate(zip(rng.uniform(6, 9, 3), rng.uniform(20, 30, 3), strict=True))
    ]
    figure = draw([*points, replace(points[0], method="slow", family="slow", ms=900.0)], METRICS["psnr"])
    axes, renderer = figure.axes[0], FigureCanvasAgg(figure).get_renderer()
    figure.canvas.draw()
    boxes = [text.get_window_extent(renderer) for text in axes.texts]
    assert len(boxes) == 13
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])
    places = axes.transData.transform([(point.ms, point.values["psnr"]) for point in points])
    assert sum(box.count_contains(places) for box in boxes) == 0
    frame = axes.get_window_extent(renderer)
    assert all(frame.x0 <= box.x0 and box.x1 <= frame.x1 and frame.y0 <= box.y0 <= frame.y1 for box in boxes)


@pytest.mark.long
def test_figures_as_files(material, tmp_path):
    paths = write_figures(material[0], tmp_path / "figures")
    assert sorted(path.name for path in paths) == sorted(path.name for path in (tmp_path / "figures").iterdir())
    # The means lack FLIP, as one scene has none.
    expected = {f"{key}_{scene}" for key in ("psnr", "relmse", "ssim") for scene in (ALL, *SCENES)} | {"flip_room"}
    assert {path.stem for path in paths} == expected
    svg = (tmp_path / "figures" / "psnr_room.svg").read_text()
    assert ">SVGF</text>" in svg
    assert 'id="point-4"' in svg
    with Image.open(tmp_path / "figures" / "psnr_room.png") as image:
        assert image.width > 1000
    again = write_figures(material[0], tmp_path / "again")
    assert [path.read_bytes() for path in paths] == [path.read_bytes() for path in again]


def test_charts_refuse_invalid_input(tmp_path):
    points = measured("room")
    with pytest.raises(ValueError, match="balls, room"):
        draw([*points, *measured("balls")], METRICS["psnr"])
    with pytest.raises(ValueError, match="finite flip"):
        draw(points, METRICS["flip"])
    with pytest.raises(ValueError, match="finite psnr"):
        draw([replace(points[0], values={"psnr": np.inf})], METRICS["psnr"])
    with pytest.raises(ValueError, match="at least one"):
        write_figures([], tmp_path / "new")
    with pytest.raises(ValueError, match="nonsense"):
        write_figures([replace(points[0], values={"nonsense": 1.0})], tmp_path / "new")
    assert not (tmp_path / "new").exists()


# The file


def test_the_page_refuses_before_work_starts(material, tmp_path):
    points, recordings = material
    path = tmp_path / "report.html"
    path.write_text("as it was")
    with pytest.raises(ValueError, match="at least one"):
        write_report(path, [], recordings)
    with pytest.raises(ValueError, match="SVGF twice"):
        write_report(path, [*points, points[-5]], recordings)
    with pytest.raises(ValueError, match="one named balls, got room"):
        write_report(path, points, recordings[:1])
    with pytest.raises(FileNotFoundError, match="nowhere"):
        write_report(path, [replace(points[-1], images=tmp_path / "nowhere")], recordings)
    assert path.read_text() == "as it was"
    assert [item.name for item in tmp_path.iterdir()] == ["report.html"]


def test_every_image_is_in_the_page_once(report, material):
    stored = [path for point in material[0] if point.images for path in point.images.iterdir()]
    # Six kinds of three pipelines and two of three others on two scenes, but for a frame without a reference.
    assert len(stored) == 2 * 3 * (3 * 6 + 3 * 2) - 6
    found = [base64.b64decode(coded) for coded in re.findall(r"data:image/\w+;base64,([\w+/=]+)", report.read_text())]
    assert len(set(found)) == len(found)
    assert {path.read_bytes() for path in stored} < set(found)


# The page


@pytest.fixture
def page(browser, report) -> Iterator[Page]:
    """The page without a network; at the end, it must have requested nothing and logged nothing."""
    context = browser.new_context(viewport={"width": 1400, "height": 1000}, offline=True)
    page = context.new_page()
    page.set_default_timeout(5000)
    asked, said = [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.goto(report.as_uri())
    shows(page, "room", 4, "noisy input", "SVGF")
    yield page
    assert [url for url in asked if not url.startswith("data:")] == [report.as_uri()]
    assert said == []
    context.close()


def shows(page: Page, scene: str, frame: int, left: str, right: str) -> None:
    """Wait for the images of both sides."""
    expect(page.locator("canvas")).to_have_attribute("aria-label", f"{scene}, frame {frame}: {left} | {right}")


def pixel(page: Page, x: float, y: float = 0.1) -> tuple[int, int, int]:
    """The colour on the screen at a position of the canvas, 0 to 1 from the upper left."""
    image = Image.open(io.BytesIO(page.locator("canvas").screenshot()))
    return image.convert("RGB").getpixel((x * (image.width - 1), y * (image.height - 1)))


def about(color: Sequence[int]) -> object:
    return pytest.approx(tuple(color), abs=TOLERANCE)


def white(page: Page) -> int:
    """The number of white pixels below the tags and the line's handle, with the line at the right."""
    image = np.asarray(Image.open(io.BytesIO(page.locator("canvas").screenshot())).convert("RGB"))
    return int((image[int(0.56 * len(image)) :, :-20].min(-1) > 225).sum())


def spot(page: Page, i: int) -> Locator:
    return page.locator(f"#plot #point-{i} use")


def test_page_has_its_words(page):
    expect(page).to_have_title("Tests <b> & more")
    expect(page.locator("h1")).to_have_text("Tests <b> & more")
    expect(page.locator("#about")).to_have_text("On <this> machine.")
    expect(page.locator("#plot text").filter(has_text="Mean over all scenes")).to_be_visible()
    assert page.locator("#scene option").all_inner_texts() == ["Mean over all scenes", *SCENES]
    assert page.locator("#metric option").all_inner_texts() == ["PSNR [dB]", "relMSE", "SSIM", "FLIP"]


def test_hover_shows_a_points_values(page):
    for i, (name, *_, ms, psnr) in enumerate(METHODS):
        if not ms:
            continue
        spot(page, i).hover()
        tip = page.locator("#tip")
        expect(tip).to_contain_text(name)
        expect(tip.locator("tr").nth(0)).to_have_text(f"ms per frame{1.5 * ms:.1f}")
        expect(tip.locator("tr").nth(2)).to_have_text(f"PSNR [dB]{psnr:.2f}")
        expect(tip.locator("tr").nth(4)).to_have_text("SSIM0.9000")
    line = page.locator("#point-0").bounding_box()
    page.mouse.move(line["x"] + 60, line["y"] + 2)
    expect(page.locator("#tip tr").nth(0)).to_have_text("PSNR [dB]18.00")
    page.locator("h1").hover()
    expect(page.locator("#tip")).to_be_hidden()


def test_click_shows_a_points_images(page):
    spot(page, 4).click()
    shows(page, "room", 4, "noisy input", "OIDN high")
    assert pixel(page, 0.8) == about(shade("room", "OIDN high", 4))
    spot(page, 3).click(modifiers=["Shift"])
    shows(page, "room", 4, "TAA best", "OIDN high")
    assert pixel(page, 0.2) == about(shade("room", "TAA best", 4))
    assert pixel(page, 0.8) == about(shade("room", "OIDN high", 4))
    assert page.locator("#plot .chosen text").all_text_contents() == ["L", "R"]
    page.locator("#numbers tr").filter(has_text=ODD).click()
    shows(page, "room", 4, "TAA best", ODD)
    expect(page.locator("#numbers tr").filter(has_text=ODD).locator(".side")).to_have_text("R")


def test_points_from_the_keyboard(page):
    page.locator("#metric").focus()
    page.keyboard.press("Tab")
    expect(page.locator("#point-0")).to_be_focused()
    page.keyboard.press("ArrowRight")  # by time
    expect(page.locator("#point-3")).to_be_focused()
    expect(page.locator("#tip")).to_contain_text("TAA best")
    page.keyboard.press("ArrowRight")
    expect(page.locator("#point-2")).to_be_focused()
    page.keyboard.press("Enter")
    shows(page, "room", 4, "noisy input", "SVGF, 2 passes")
    for _ in range(3):
        page.keyboard.press("ArrowLeft")
    page.keyboard.press("Shift+Enter")
    shows(page, "room", 4, "OIDN high", "SVGF, 2 passes")
    expect(page.locator("#point-4")).to_be_focused()
    page.keyboard.press("Tab")
    expect(page.locator("#sequence")).to_be_focused()


def test_the_line_splits(page):
    left, right = (shade("room", source, 4) for source in ("noisy input", "SVGF"))
    assert (pixel(page, 0.45), pixel(page, 0.55)) == (about(left), about(right))
    handle, box = page.locator("#split"), page.locator("canvas").bounding_box()
    handle.hover()
    page.mouse.down()
    page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 50)
    page.mouse.up()
    page.mouse.move(0, 0)
    assert (pixel(page, 0.2), pixel(page, 0.3)) == (about(left), about(right))
    expect(handle).to_have_attribute("aria-valuenow", "25")
    handle.focus()
    page.keyboard.press("PageUp")
    expect(handle).to_have_attribute("aria-valuenow", "35")
    page.keyboard.press("End")
    assert pixel(page, 0.9) == about(left)
    page.keyboard.press("Home")
    assert pixel(page, 0.1, 0.9) == about(right)


def test_any_two_sources(page):
    for side, source in ((0, "reference"), (1, "SVGF, 2 passes")):
        page.locator(".source").nth(side).select_option(source)
    shows(page, "room", 4, "reference", "SVGF, 2 passes")
    assert pixel(page, 0.2) == about(shade("room", "reference", 4))
    assert pixel(page, 0.8) == about(shade("room", "SVGF, 2 passes", 4))
    names = page.locator(".source").nth(0).locator("option").all_inner_texts()
    assert names == ["noisy input", "reference", *(method[0] for method in METHODS[1:])]


def test_frames(page):
    slider = page.locator("#frame")
    slider.focus()
    page.keyboard.press("End")
    shows(page, "room", 7, "noisy input", "SVGF")
    expect(page.locator("#which")).to_have_text("frame 7")
    assert pixel(page, 0.2) == about(shade("room", "noisy input", 7))
    assert pixel(page, 0.8) == about(shade("room", "SVGF", 7))
    page.locator("#play").click()
    expect(page.locator("#play")).to_have_text("Pause")
    for frame in (4, 5, 7, 4):
        shows(page, "room", frame, "noisy input", "SVGF")
    page.locator("#play").click()
    expect(page.locator("#play")).to_have_text("Play")


def test_zoom_to_pixels(page):
    """Four by four white pixels; the point under the pointer stays in place."""
    page.locator("#split").focus()
    page.keyboard.press("End")
    canvas = page.locator("canvas")
    box = canvas.bounding_box()
    scale = box["width"] / WIDTH
    page.mouse.move(0, 0)
    one = white(page)
    x, y = box["x"] + 34.5 * scale, box["y"] + 26.5 * scale
    page.mouse.move(x, y)
    expect(page.locator("#pixel")).to_contain_text("x 34, y 26")
    page.mouse.wheel(0, -400)
    page.wait_for_timeout(50)
    page.mouse.move(x + 1, y)
    expect(page.locator("#pixel")).to_contain_text("x 34, y 26")
    page.mouse.move(x + 1.6 * 2 * scale, y)
    expect(page.locator("#pixel")).to_contain_text("x 36, y 26")
    page.mouse.move(0, 0)
    assert white(page) == pytest.approx(4 * one, rel=0.2)
    page.locator("#fit").click()
    page.mouse.move(0, 0)
    assert white(page) == one
    page.locator("#in").click()
    page.locator("#in").click()
    page.locator("#out").click()
    # In the middle is x 24, y 18; the square is in the quarter at the lower right.
    page.mouse.move(box["x"] + box["width"] * 0.5 + 2, box["y"] + box["height"] * 0.5 + 2)
    expect(page.locator("#pixel")).to_contain_text("x 24, y 18")
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] * 0.5 + 2 - 6 * scale, box["y"] + box["height"] * 0.5 + 2)
    page.mouse.up()
    expect(page.locator("#pixel")).to_contain_text("x 24, y 18")
    canvas.focus()
    page.keyboard.press("0")
    page.mouse.move(0, 0)
    assert white(page) == one


def test_maps(page):
    left, right = page.locator(".view").all()
    page.locator(".source").nth(0).select_option("SVGF, 2 passes")
    left.select_option("rejection")
    right.select_option("history")
    shows(page, "room", 4, "SVGF, 2 passes: rejection", "SVGF: history length")
    legend = page.locator("#legend")
    for name in ("outside", "depth", "normal", "id", "velocity", "luminance", "history length", "32 or more"):
        expect(legend).to_contain_text(name)

    def shown(name: str) -> np.ndarray:
        color = legend.locator("span", has_text=name).locator("i").evaluate("i => getComputedStyle(i).backgroundColor")
        return np.array([int(v) for v in re.findall(r"\d+", color)])

    depth, normal = shown("depth"), shown("normal")
    assert pixel(page, 0.2, 0.25) == about(depth)
    assert pixel(page, 0.2, 0.45) == about((depth + normal) // 2)
    assert pixel(page, 0.2, 0.9) == about((0, 0, 0))
    # viridis: from violet to yellow, reached at 32.
    assert pixel(page, 0.75, 0.9) == about((253, 231, 37))
    assert pixel(page, 0.52, 0.9)[2] > 60
    box = page.locator("canvas").bounding_box()
    page.mouse.move(box["x"] + 0.2 * box["width"], box["y"] + 0.45 * box["height"])
    expect(page.locator("#pixel")).to_contain_text("left: depth, normal")
    page.mouse.move(box["x"] + 20.5 / WIDTH * box["width"], box["y"] + 0.9 * box["height"])
    expect(page.locator("#pixel")).to_contain_text("left: accepted")
    expect(page.locator("#pixel")).to_contain_text("right: history length 20")
    right.select_option("choice")
    expect(page.locator("#pixel")).to_be_visible()
    page.mouse.move(box["x"] + 20.5 / WIDTH * box["width"], box["y"] + 0.9 * box["height"])
    expect(page.locator("#pixel")).to_contain_text("chosen passes 2.51")
    right.select_option("confidence")
    expect(page.locator("#pixel")).to_be_visible()
    page.mouse.move(box["x"] + 47.5 / WIDTH * box["width"], box["y"] + 0.9 * box["height"])
    expect(page.locator("#pixel")).to_contain_text("confidence 1.00")
    right.select_option("error")
    shows(page, "room", 4, "SVGF, 2 passes: rejection", "SVGF: error (FLIP)")
    assert sum(pixel(page, 0.8)) > 30
    # Methods without this map show their image.
    page.locator(".source").nth(0).select_option("OIDN high")
    shows(page, "room", 4, "OIDN high", "SVGF: error (FLIP)")
    assert left.locator("option:disabled").count() == 4


def test_scenes_and_metrics(page):
    assert page.locator("#plot").get_by_text("PSNR [dB], higher is better").is_visible()
    page.locator("#metric").select_option("flip")
    expect(page.locator("#absent")).to_be_visible()
    page.locator("#scene").select_option("room")
    expect(page.locator("#absent")).to_be_hidden()
    expect(page.locator("#plot").get_by_text("FLIP, lower is better")).to_be_visible()
    page.locator("#scene").select_option("balls")
    shows(page, "balls", 4, "noisy input", "SVGF")
    assert pixel(page, 0.8) == about(shade("balls", "SVGF", 4))
    page.locator("#metric").select_option("relmse")
    expect(page.locator("#plot").get_by_text("relMSE, lower is better")).to_be_visible()
    expect(page.locator("#plot").get_by_text("balls", exact=True)).to_be_visible()
    page.locator("#sequence").select_option("room")
    shows(page, "room", 4, "noisy input", "SVGF")
    page.locator("#scene").select_option("balls")
    page.locator(".source").nth(0).select_option("reference")
    # The first frame of this scene has no reference.
    shows(page, "balls", 4, "no image", "SVGF")
    assert pixel(page, 0.2) == about((0, 0, 0))
    page.locator("#frame").press("ArrowRight")
    shows(page, "balls", 5, "reference", "SVGF")


def test_the_table_sorts(page):
    def names() -> list[str]:
        return page.locator("#numbers tbody button").all_inner_texts()

    assert names() == [method[0] for method in METHODS]
    head = page.locator("#numbers th")
    head.nth(2).locator("button").click()
    assert names() == [method[0] for method in sorted(METHODS, key=lambda method: -method[5])]
    expect(head.nth(2)).to_have_attribute("aria-sort", "descending")
    head.nth(2).locator("button").press("Enter")
    assert names() == [method[0] for method in sorted(METHODS, key=lambda method: method[5])]
    head.nth(3).locator("button").click()
    assert names() == [method[0] for method in sorted(METHODS, key=lambda method: -method[5])]
    head.nth(0).locator("button").click()
    assert names() == sorted((method[0] for method in METHODS), key=str.lower)
    best = page.locator("#numbers tbody .best").all_inner_texts()
    assert best.count("34.00") == 1
    assert "9.0" in best
    assert page.locator("#numbers tr").filter(has_text="noisy").locator("td").nth(1).inner_text() == "–"


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_can_be_read_in_the_light_and_in_the_dark(browser, report, scheme):
    page = browser.new_page(color_scheme=scheme, viewport={"width": 1200, "height": 900})
    page.goto(report.as_uri())
    shows(page, "room", 4, "noisy input", "SVGF")
    back, text = (
        page.evaluate(f"getComputedStyle(document.querySelector('{where}')).{what}")
        for where, what in (("section", "backgroundColor"), ("#plot text", "fill"))
    )
    back, text = (np.mean([int(v) for v in re.findall(r"\d+", color)[:3]]) for color in (back, text))
    assert (back - text > 150) if scheme == "light" else (text - back > 150)
    page.close()


def test_narrow_screens_need_no_scrolling_sideways(browser, report):
    page = browser.new_page(viewport={"width": 380, "height": 800})
    page.goto(report.as_uri())
    shows(page, "room", 4, "noisy input", "SVGF")
    assert page.evaluate("document.documentElement.scrollWidth") <= 380
    page.close()


def test_a_page_without_images(browser, tmp_path):
    path = tmp_path / "report.html"
    write_report(path, measured("room"), [])
    page = browser.new_page()
    page.goto(path.as_uri())
    expect(page.locator("#plot svg")).to_be_visible()
    expect(page.locator("#images")).to_be_hidden()
    page.locator("#numbers tbody tr").nth(1).click()
    expect(page.locator("#numbers tbody tr")).to_have_count(6)
    page.close()
