"""`yester live` as its users see it: the command, its server, and the page in a browser."""

import asyncio
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Coroutine, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from http.client import HTTPConnection
from pathlib import Path
from types import SimpleNamespace
from typing import Any, TypeVar
from urllib.parse import urlsplit

import aiohttp
import numpy as np
import pytest
from aiohttp import web
from aiohttp.test_utils import make_mocked_request
from PIL import Image
from playwright.sync_api import Browser, Page, expect
from yester import cli
from yester.io import read_sequence
from yester.live import controls, recording, views
from yester.live.scene import Shot, World
from yester.live.server import Server
from yester.study.rendered.recording import open_recording

pytestmark = pytest.mark.slow

T = TypeVar("T")

#: Milliseconds within which anything happens, also on a busy machine.
LONG = 60_000
SCENE = """
<scene version="3.0.0">
  <integrator type="path"><integer name="max_depth" value="4"/></integrator>
  <sensor type="perspective">
    <float name="fov" value="40"/>
    <transform name="to_world"><lookat origin="0, -6, 2" target="0, 0, 0.5" up="0, 0, 1"/></transform>
    <film type="hdrfilm"><integer name="width" value="96"/><integer name="height" value="64"/></film>
  </sensor>
  <shape type="rectangle" id="floor"><transform name="to_world"><scale value="3"/></transform></shape>
  <shape type="sphere" id="ball"><point name="center" x="0" y="0" z="0.7"/><float name="radius" value="0.7"/></shape>
  <emitter type="constant" id="sky"><rgb name="radiance" value="0.4"/></emitter>
</scene>
"""


@contextmanager
def served(*arguments) -> Iterator[tuple[str, subprocess.Popen]]:
    """The address that the command prints; in the end, Ctrl-C ends it, and it has complained of nothing."""
    command = [sys.executable, "-W", "error", "-m", "yester", "live", "--no-open", *map(str, arguments)]
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # the process inherits that it is not ignored
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        signal.signal(signal.SIGINT, before)
        try:
            line = running.stdout.readline()
            assert line.startswith("http://127.0.0.1:"), running.communicate(timeout=60)[1]
            yield line.split()[0], running
            running.send_signal(signal.SIGINT)
            _, errors = running.communicate(timeout=60)
            assert (running.returncode, errors) == (0, "")
        finally:
            running.kill()


def ran(work: Coroutine[Any, Any, T]) -> T:
    """The result of a coroutine, in a thread of its own: here runs Playwright's loop."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(asyncio.run, work).result()


@pytest.fixture(scope="module", autouse=True)
def scalar() -> None:
    """In this process, Mitsuba's variant is that of the other tests; those of the command are their own."""
    import mitsuba as mi

    if mi.variant() is None:
        mi.set_variant("scalar_rgb")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("recordings")


@pytest.fixture(scope="module")
def address(folder) -> Iterator[str]:
    with served("--size", "160x120", "-o", folder) as (address, _):
        yield address


def opened(browser: Browser, address: str, **options) -> Page:
    """The page, showing pictures; what it says and asks for is kept as `said` and `asked`."""
    page = browser.new_context(**{"viewport": {"width": 1000, "height": 800}} | options).new_page()
    page.set_default_timeout(LONG)
    page.said, page.asked = [], []
    page.on("console", lambda message: page.said.append(message.text))
    page.on("pageerror", lambda error: page.said.append(str(error)))
    page.on("request", lambda request: page.asked.append(request.url))
    page.goto(address)
    comes(page, "app.header !== null")
    return page


def comes(page: Page, condition: str) -> None:
    """Waits for a condition. (What Playwright has for it, the page forbids: it would evaluate text.)"""
    end = time.monotonic() + LONG / 1000
    while not page.evaluate(condition):
        assert time.monotonic() < end, (
            condition,
            page.evaluate("({ ...app, images: 0, log: 0, hello: 0 })"),
            page.said,
        )
        page.wait_for_timeout(20)


def tell(page: Page, **message) -> None:
    page.evaluate("(message) => channel.send(message)", message)


@pytest.fixture
def page(browser, address) -> Iterator[Page]:
    """The page at the beginning: a small picture that stands still."""
    page = opened(browser, address)
    tell(page, home=True, light=True, moving=False, freeze=False, pipeline="SVGF", parameters={}, size=2)
    still = "!h.moving && h.light && !h.frozen && h.pipeline === 'SVGF' && h.size[0] === 80 && app.pose.eye[0] === 0"
    until(page, still)
    yield page
    assert {urlsplit(url).netloc for url in page.asked} == {urlsplit(address).netloc}
    # The tests read the canvas, which it is not made for.
    assert [text for text in page.said if "willReadFrequently" not in text] == []
    page.context.close()


def until(page: Page, condition: str) -> None:
    """Waits until a condition on the header `h` of the newest picture holds."""
    comes(page, f"(() => {{ const h = app.header; return {condition}; }})()")


def look(page: Page, left: str, right: str) -> None:
    """Chooses both views, and waits for a picture of them."""
    for side, name in enumerate((left, right)):
        page.locator(".view").nth(side).select_option(name)
    until(page, f"h.views[0] === '{left}' && h.views[1] === '{right}'")


def images(page: Page) -> np.ndarray:
    """The two images of the newest picture, (2, H, W, 4)."""
    width, height = page.evaluate("app.header.size")
    values = page.evaluate("app.images.map((image) => Array.from(image.data))")
    return np.array(values, np.uint8).reshape(2, height, width, 4)


def canvas(page: Page) -> np.ndarray:
    """What is on the canvas, (H, W, 4)."""
    width, height = page.evaluate(
        "[canvas().width, canvas().height]".replace("canvas()", "document.querySelector('canvas')")
    )
    read = f"Array.from(document.querySelector('canvas').getContext('2d').getImageData(0, 0, {width}, {height}).data)"
    return np.array(page.evaluate(read), np.uint8).reshape(height, width, 4)


def frozen(page: Page) -> None:
    """Waits until the picture is frozen, and the frame that was still under way is shown."""
    until(page, "h.frozen")
    number = None
    while (shown := page.evaluate("app.header.number")) != number:
        number = shown
        page.wait_for_timeout(1000)


def turned(page: Page) -> dict:
    """The pose, when all that was asked for is shown. It is asked for with the browser's next frame."""
    page.evaluate("new Promise(requestAnimationFrame)")
    comes(page, "app.input > 0 && app.header.input === app.input")
    return page.evaluate("app.header.pose")


def drag(page: Page, by: tuple[int, int], selector: str = "canvas") -> None:
    box = page.locator(selector).bounding_box()
    x, y = box["x"] + box["width"] / 2 + (60 if selector == "canvas" else 0), box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + by[0], y + by[1], steps=4)
    page.mouse.up()


def distance(pose: dict) -> float:
    return float(np.linalg.norm(np.subtract(pose["eye"], pose["target"])))


def test_drag_turns_the_camera(page):
    look(page, "albedo", "normal")
    home, before = page.evaluate("app.header.pose"), images(page)
    drag(page, (120, 40))
    pose, after = turned(page), images(page)
    assert pose["target"] == home["target"]
    assert distance(pose) == pytest.approx(distance(home))
    assert pose["eye"][0] < -0.5  # dragged to the right: the scene follows the pointer
    assert pose["eye"][1] > home["eye"][1]
    for side in (0, 1):
        assert (before[side] != after[side]).any(-1).mean() > 0.3
    page.keyboard.press("Home")
    until(page, "h.pose.eye[0] === 0")
    assert (before[0] != images(page)[0]).any(-1).mean() < 0.25  # samples are spread over their pixels


def test_wheel_and_shift(page):
    home = page.evaluate("app.header.pose")
    page.locator("canvas").hover(position={"x": 20, "y": 20})
    page.mouse.wheel(0, -300)
    near = turned(page)
    assert distance(near) < 0.9 * distance(home)
    page.keyboard.down("Shift")
    drag(page, (100, 0))
    page.keyboard.up("Shift")
    moved = turned(page)
    assert distance(moved) == pytest.approx(distance(near))
    assert moved["target"][0] < -0.1


def test_keyboard_moves_the_camera(page):
    home = page.evaluate("app.header.pose")
    for key in ("ArrowRight", "ArrowUp"):
        page.keyboard.press(key)
    pose = turned(page)
    assert pose["eye"][0] > 0.1
    assert pose["eye"][1] > home["eye"][1]
    page.keyboard.press("Shift+ArrowLeft")
    assert turned(page)["target"] != home["target"]
    page.keyboard.press("-")
    assert distance(turned(page)) > distance(home)


def test_two_fingers(browser, address):
    """On the screen of a phone: everything fits, and two fingers move and zoom."""
    page = opened(browser, address, viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True)
    tell(page, home=True, moving=False)
    until(page, "!h.moving && app.pose.eye[0] === 0")
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert page.evaluate("innerWidth") == 390
    for button in page.locator("button:visible").all():
        assert button.bounding_box()["height"] >= 40
    home, box = page.evaluate("app.header.pose"), page.locator("canvas").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    touch = page.context.new_cdp_session(page)

    def fingers(kind: str, *places: tuple[float, float]) -> None:
        points = [{"x": x + dx, "y": y + dy, "id": i} for i, (dx, dy) in enumerate(places)]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    fingers("touchStart", (-80, 30))
    fingers("touchMove", (-40, 30))
    fingers("touchEnd")
    one = turned(page)
    assert one["target"] == home["target"]
    assert one["eye"][0] < -0.1
    fingers("touchStart", (-40, 30), (40, 30))
    fingers("touchMove", (-80, 10), (80, 10))
    fingers("touchEnd")
    two = turned(page)
    assert distance(two) < 0.7 * distance(home)
    assert two["target"][1] != 0
    page.context.close()


def test_split(page):
    look(page, "albedo", "depth")
    page.keyboard.press("Space")
    frozen(page)

    def shows(share: float) -> None:
        expect(page.locator(".split")).to_have_attribute("aria-valuenow", str(round(100 * share)))
        (left, right), seen = images(page), canvas(page)
        middle = round(80 * page.evaluate("app.split"))
        np.testing.assert_array_equal(seen[:, :middle], left[:, :middle])
        np.testing.assert_array_equal(seen[:, middle:], right[:, middle:])

    shows(0.5)
    width = page.locator("canvas").bounding_box()["width"]
    drag(page, (round(width / 4), 0), ".split")
    shows(0.75)
    drag(page, (-2000, 0), ".split")
    shows(0)
    page.locator(".split").press("End")
    shows(1)
    page.locator(".split").press("ArrowLeft")
    shows(0.98)
    assert page.evaluate("app.header.pose.eye[0]") == 0  # the camera has not moved


@pytest.mark.long
def test_views_by_key(page):
    """Every view, chosen by its key for either side, shows something else."""
    look(page, "antialiased", "oidn")
    until(page, "h.samples > 6")
    page.locator("canvas").press("Space")
    frozen(page)
    seen = {}
    for name, view in views.VIEWS.items():
        page.keyboard.press(view.key)
        until(page, f"h.views[1] === '{name}'")
        expect(page.locator(".tag.right")).to_contain_text(view.label)
        seen[name] = images(page)[1].tobytes()
    assert len({*seen.values()}) == len(seen)
    page.keyboard.press("Shift+H")
    until(page, "h.views[0] === 'history'")
    assert images(page)[0].tobytes() == seen["history"]
    page.keyboard.press(",")
    until(page, "h.views[1] === 'history'")
    assert page.locator(".view").nth(1).input_value() == "history"


def test_controls(page):
    """Those of the pipeline: ranges and defaults are the pipeline's own."""
    rows = page.locator(".control")
    wanted = controls.controls("SVGF")
    assert [row.get_attribute("data-name") for row in rows.all()] == [control["name"] for control in wanted]
    for row, control in zip(rows.all(), wanted, strict=True):
        field = row.locator("input, select")
        if control["kind"] == "switch":
            assert field.is_checked() == control["default"]
        elif control["kind"] == "number":
            for limit, attribute in (("low", "min"), ("high", "max")):
                given = field.get_attribute(attribute)
                assert (given and float(given)) == control[limit]
            assert field.input_value() == ("" if control["default"] is None else f"{control['default']:g}")
    page.locator("[data-name=iterations] input").fill("0")
    until(page, "h.parameters.iterations === 0")
    page.locator("[data-name=choice] input").uncheck()
    until(page, "h.parameters.choice === false && h.parameters.iterations === 0")
    expect(page.locator("[data-name=choice]")).to_have_class("control changed")
    page.locator("[data-name=reflections] input").fill("1")
    page.locator("[data-name=reflections] input").blur()
    until(page, "JSON.stringify(h.parameters.reflections) === '[1]'")
    page.locator("[data-name=sigma_depth] input").fill("-1")
    page.locator("[data-name=sigma_depth] input").blur()
    expect(page.locator(".error")).to_contain_text("sigma_depth: expected a number above 0")
    page.locator("button.defaults").click()
    until(page, "Object.keys(h.parameters).length === 0")
    for name in ("TAA", "BMFR", "HalfRes", "Recirculation", "OIDN"):
        page.locator(".pipeline").select_option(name)
        until(page, f"h.pipeline === '{name}'")
        assert page.locator(".control").count() == len(controls.controls(name))
    page.locator(".pipeline").select_option("TAA")
    page.locator("[data-name=preset] select").select_option("textbook")
    until(page, "h.parameters.preset === 'textbook'")
    expect(page.locator(".tag.right")).to_have_text("denoised, TAA")


def test_light_switch(page):
    """The pictures change within two frames, the denoised one as well."""
    look(page, "raw", "denoised")
    until(page, "h.samples > 6")
    page.locator("button.freeze").click()
    frozen(page)
    lit, number = images(page)[..., :3].mean((1, 2, 3)), page.evaluate("app.header.number")
    page.locator("button.light").click()
    for step in (1, 2):
        page.locator("button.step").click()
        until(page, f"h.number === {number + step}")
    assert page.evaluate("app.log.slice(-2).map(({ light }) => light)") == [False, False]
    assert (images(page)[..., :3].mean((1, 2, 3)) < lit / 2).all()
    expect(page.locator("button.light")).to_have_attribute("aria-pressed", "false")
    # While frames go on: one may be under way, and one on its way to the page.
    page.locator("canvas").press("Space")
    until(page, "!h.frozen")
    page.keyboard.press("l")
    until(page, "h.light")
    assert images(page)[0, ..., :3].mean() > lit[0] / 2


@pytest.mark.long
def test_cube_cut_and_counter(page):
    look(page, "mean", "motion")
    until(page, "h.samples > 5")
    assert page.locator(".samples").text_content().endswith(" of 1024")
    assert images(page)[1, ..., :3].max() == 0
    page.locator("button.moving").click()
    until(page, "h.moving && h.samples === 1")
    comes(page, "app.images[1].data.some((value, i) => i % 4 < 3 && value > 0)")
    page.keyboard.press("k")
    until(page, "!h.moving && h.samples > 100")
    page.locator("button.cut").click()
    until(page, "h.samples < 100")


def test_exposure(page):
    look(page, "raw", "albedo")
    page.keyboard.press("Space")
    frozen(page)
    number, before = page.evaluate("app.header.number"), images(page)
    page.keyboard.press("]")
    page.keyboard.press("]")
    expect(page.locator(".stops")).to_have_text("+1 stops")
    comes(page, f"app.images[0].data.reduce((a, b) => a + b, 0) > {before[0].sum()}")
    after = images(page)
    assert page.evaluate("app.header.number") == number
    np.testing.assert_array_equal(after[1], before[1])
    assert (after[0].astype(int) >= before[0]).all()


def test_figures(page):
    until(page, "h.samples > 3")
    page.locator("canvas").focus()
    page.keyboard.press("ArrowRight")
    turned(page)
    for name in ("render", "denoise", "views", "transport", "latency"):
        expect(page.locator(f".{name}", has_text="ms")).to_have_text(re.compile(r"^\d+(\.\d)? ms$"))
    expect(page.locator(".fps")).to_have_text(re.compile(r"^\d+\.\d$"))
    page.locator(".size").select_option("")
    until(page, "h.adapts")
    expect(page.locator(".size option").first).to_have_text(re.compile(r"^auto: \d+×\d+$"))


def test_everything_has_a_name_and_a_place_in_the_order_of_tabs(page):
    for element in page.locator("button:visible, select:visible, input:visible, canvas, .split").all():
        name = element.evaluate(
            "(e) => e.getAttribute('aria-label') || e.labels?.[0]?.textContent || e.textContent || e.title"
        )
        assert name.strip(), element.evaluate("(e) => e.outerHTML")
        assert element.evaluate("(e) => e.tabIndex") == 0
    page.locator("canvas").focus()
    for _ in range(2):
        page.keyboard.press("Tab")
    page.keyboard.press("Enter")  # of the freeze button, behind the split
    frozen(page)


def test_second_viewer_and_one_who_leaves(page, browser, address):
    other = opened(browser, address)
    look(page, "raw", "denoised")
    look(other, "normal", "depth")
    drag(page, (100, 0))
    pose = turned(page)
    comes(other, f"Math.abs(app.pose.eye[0] - {pose['eye'][0]}) < 1e-9")
    assert not np.array_equal(images(page)[0], images(other)[0])
    page.keyboard.press("l")
    expect(other.locator("button.light")).to_have_attribute("aria-pressed", "false")
    other.context.close()
    number = page.evaluate("app.header.number")
    page.keyboard.press("k")
    until(page, f"h.number > {number + 5}")


def test_parameters_of_two_viewers(page, browser, address):
    """Those of the other are shown once nobody is about to change one here, and refused ones go back."""
    other = opened(browser, address)
    page.locator("[data-name=alpha] input").focus()
    other.locator("[data-name=iterations] input").fill("1")
    until(page, "h.parameters.iterations === 1")
    expect(page.locator("[data-name=iterations] input")).not_to_have_value("1")
    page.locator("[data-name=alpha] input").blur()
    expect(page.locator("[data-name=iterations] input")).to_have_value("1")
    page.locator("[data-name=sigma_depth] input").fill("-1")
    page.locator("[data-name=sigma_depth] input").blur()
    expect(page.locator(".error")).to_contain_text("sigma_depth: expected a number above 0")
    expect(page.locator("[data-name=sigma_depth]")).to_have_class("control")
    page.locator("[data-name=alpha] input").fill("0.5")
    until(page, "h.parameters.alpha === 0.5 && h.parameters.iterations === 1")
    other.context.close()


def test_home_while_frozen(page):
    drag(page, (100, 0))
    turned(page)
    page.keyboard.press(" ")
    until(page, "h.frozen")
    page.keyboard.press("Home")
    page.keyboard.press("ArrowUp")
    page.keyboard.press(" ")
    until(page, "!h.frozen && h.pose.eye[1] > app.hello.home.eye[1] + 0.01")
    assert abs(page.evaluate("app.header.pose.eye[0] - app.hello.home.eye[0]")) < 1e-6


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such signals")
@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP"])
def test_the_end_of_the_terminal_completes_a_recording(browser, tmp_path, name):
    number = getattr(signal, name)
    before = signal.signal(number, signal.SIG_DFL)  # which the process inherits, also if the tests run under nohup
    try:
        with served("--size", "64x60", "-o", tmp_path) as (address, running):
            page = opened(browser, address)
            page.keyboard.press("s")
            until(page, "h.recording && h.recording.frames > 1")
            running.send_signal(number)
            running.wait(60)
            page.context.close()
    finally:
        signal.signal(number, before)
    (made,) = tmp_path.iterdir()
    shots = json.loads((made / "path.json").read_text())["shots"]
    assert len(shots) == len([*(made / "frames").iterdir()]) > 1


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such signals")
def test_nohup_keeps_the_server(browser):
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # which the process inherits
    try:
        with served("--size", "64x60") as (address, running):
            page = opened(browser, address)
            running.send_signal(signal.SIGHUP)
            number = page.evaluate("app.header.number")
            until(page, f"h.number > {number + 5}")
            page.context.close()
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.long
def test_recording_is_read_by_the_commands(page, folder, tmp_path, capsys):
    page.keyboard.press("s")
    until(page, "h.recording?.frames > 0")
    expect(page.locator(".state")).to_contain_text("recording: ")
    drag(page, (80, 0))
    turned(page)
    until(page, "h.recording?.frames > 4")
    page.locator("button.record").click()
    until(page, "h.recorded")
    made = Path(page.evaluate("app.header.recorded"))
    assert made.parent == folder
    path = json.loads((made / "path.json").read_text())
    frames = [*read_sequence(made / "frames")]
    assert len(frames) == len(path["shots"]) > 4
    assert all(frame.camera is not None and frame.motion is not None for frame in frames)
    eyes = [shot["pose"]["eye"] for shot in path["shots"]]
    assert eyes[0] != eyes[-1]
    # The camera of a file is that of the path.
    np.testing.assert_allclose(frames[-1].camera.position, eyes[-1], atol=1e-4)
    assert cli.main(["denoise", str(made / "frames"), "-o", str(tmp_path / "clean")]) == 0
    assert len([*(tmp_path / "clean").iterdir()]) == len(frames)
    recording.main([str(made), "--spp", "4"])
    files = open_recording(made / "frames", made / "references")
    assert len(files.references) == len(frames)
    chart = ["chart", str(made / "frames"), "--references", str(made / "references"), "-o", str(tmp_path / "chart")]
    assert cli.main([*chart, "--methods", "SVGF", "--metrics", "psnr", "--no-peers", "--time-size", "64x48"]) == 0
    assert (tmp_path / "chart" / "points.csv").exists()
    assert "used: motion" in capsys.readouterr().err


@pytest.fixture
def world(tmp_path) -> World:
    (tmp_path / "own.xml").write_text(SCENE)
    return World(tmp_path / "own.xml", (12, 8))


def test_interrupted_frames_are_no_frames(world):
    """Mitsuba ends rendering on SIGINT, whatever Python does with it, and has a part of the image."""
    before = signal.signal(signal.SIGINT, lambda *_: None)
    try:
        with ThreadPoolExecutor(1) as pool:
            rendering = pool.submit(world.render, Shot(world.home, (3000, 2000)))
            time.sleep(0.5)
            signal.raise_signal(signal.SIGINT)
            with pytest.raises(InterruptedError, match="rendering was interrupted"):
                rendering.result()
    finally:
        signal.signal(signal.SIGINT, before)
    assert world.render(Shot(world.home, (12, 8))).color.all()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('up="0, 0, 1"', 'up="0.5, 0, 1"'),
        ('<film type="hdrfilm">', '<float name="principal_point_offset_x" value="0.1"/><film type="hdrfilm">'),
    ],
)
def test_cameras_that_a_pose_does_not_hold(tmp_path, old, new):
    (tmp_path / "own.xml").write_text(SCENE.replace(old, new))
    with pytest.warns(UserWarning, match=r"own\.xml: sensor: expected no crop, principal point offset, mirror or roll"):
        World(tmp_path / "own.xml")


def test_light_of_textures_goes_off_as_well(tmp_path):
    lamp = """<shape type="rectangle" id="screen"><transform name="to_world"><translate z="2"/></transform>
      <emitter type="area"><texture type="TEXTURE" name="radiance">FILE</texture></emitter></shape>"""
    Image.new("RGB", (4, 4), (200, 90, 30)).save(tmp_path / "a.png")
    for texture, file in (("checkerboard", ""), ("bitmap", '<string name="filename" value="a.png"/>')):
        own = lamp.replace("TEXTURE", texture).replace("FILE", file)
        (tmp_path / "own.xml").write_text(SCENE.replace("</scene>", f"{own}</scene>"))
        world = World(tmp_path / "own.xml", (12, 8))
        lit, dark = (world.reference(Shot(world.home, world.size, light=on), 1, 0).color for on in (True, False))
        assert lit.any()
        assert not dark.any()


def test_no_recording(tmp_path, capsys):
    with pytest.raises(SystemExit):
        recording.main([str(tmp_path / "none")])
    assert "none/path.json" in capsys.readouterr().err


def test_world_after_a_frame_that_failed(world, monkeypatch):
    def fails(*_):
        raise RuntimeError("no memory")

    shot = Shot(world.home, world.size)
    world.render(shot)
    with monkeypatch.context() as broken:
        broken.setattr(world._stage, "sample", fails)
        with pytest.raises(RuntimeError, match="no memory"):
            world.render(shot)
    seeds = world.seed
    frame = world.render(shot)
    assert (frame.width, frame.height) == world.size
    assert not frame.motion.any()
    assert world.seed == seeds + 1


def test_references_have_one_number_of_samples(world):
    recorder = recording.Recorder(world.path.parent, world, world.size)
    for seed in range(2):
        shot = Shot(world.home, world.size)
        recorder.add(world.render(shot), shot, seed)
    recorder.close()
    target = recording.references(recorder.folder, 2)
    (target / "frame_0001.exr").unlink()
    with pytest.raises(ValueError, match=r"spp: expected 2, as the files in .*references have .*, got 4"):
        recording.references(recorder.folder, 4)
    recording.references(recorder.folder, 2)
    assert len([*target.iterdir()]) == 2
    for file in target.iterdir():
        file.unlink()
    recording.references(recorder.folder, 4)
    assert len([*target.iterdir()]) == 2


def answer(address: str, path: str | None = None, **headers) -> int:
    """The status of a request."""
    parts = urlsplit(address)
    connection = HTTPConnection(parts.hostname, parts.port, timeout=30)
    connection.request("GET", parts.path if path is None else path, headers=headers)
    status = connection.getresponse().status
    connection.close()
    return status


def test_requests_without_the_token_are_refused(address):
    token = urlsplit(address).path
    assert len(token) > 20
    assert answer(address) == 200
    for path in ("/", "/live", "//live", "/x/", f"{token[:-2]}/", f"{token[:-1]}x/", "/x/live", f"{token}../x/live"):
        assert answer(address, path) == 403


def test_only_the_page_itself_may_connect(address, browser):
    parts = urlsplit(address)
    port = parts.port
    assert answer(address, Host=f"evil.example:{port}") == 403  # a name that was made to lead here
    assert answer(address, Host=f"localhost:{port}") == 200
    assert answer(address, Origin="http://evil.example") == 403

    async def connect(origin: str | None) -> int:
        async with aiohttp.ClientSession() as client:
            try:
                async with client.ws_connect(address + "live", origin=origin) as link:
                    assert "hello" in (await link.receive_json())
                    return 101
            except aiohttp.WSServerHandshakeError as error:
                return error.status

    origins = {
        f"http://127.0.0.1:{port}": 101,
        f"http://localhost:{port}": 101,
        f"http://127.0.0.1:{port + 1}": 403,
        f"https://127.0.0.1:{port}": 403,
        "http://evil.example": 403,
        "null": 403,
        None: 403,
    }
    assert {origin: ran(connect(origin)) for origin in origins} == origins
    page = browser.new_page()
    page.goto("data:text/html,another page")
    closed = "(url) => new Promise((done) => { new WebSocket(url).onclose = ({ code }) => done(code); })"
    assert page.evaluate(closed, f"ws://127.0.0.1:{port}{parts.path}live") == 1006
    page.close()


@pytest.mark.parametrize(("port", "status"), [(80, 200), (8080, 403)])
def test_hosts_without_a_port(port, status):
    """As browsers name the server on port 80."""
    server = Server(None, SimpleNamespace(getsockname=lambda: ("127.0.0.1", port)))
    headers = {"Host": "localhost", "Origin": "http://localhost"}
    request = make_mocked_request("GET", "/token/live", headers, match_info={"token": server.token})

    async def asked() -> int:
        async def found(_: web.Request) -> web.Response:
            return web.Response()

        try:
            return (await server._guarded(request, found)).status
        except web.HTTPForbidden as error:
            return error.status

    assert ran(asked()) == status


def test_odd_messages_do_no_harm(address):
    async def send(*messages: str) -> list[str]:
        parts, said = urlsplit(address), []
        async with aiohttp.ClientSession() as client:
            origin = f"http://{parts.netloc}"
            async with client.ws_connect(address + "live", origin=origin) as link:
                for message in messages:
                    await link.send_str(message)
                async for got in link:
                    if got.type is aiohttp.WSMsgType.TEXT and "error" in (told := got.json()):
                        said.append(told["error"])
                    if len(said) == len(messages):
                        return said
        return said

    said = ran(send("nonsense", "[1]", '{"views": 3}', '{"pose": {"eye": "abc"}}'))
    assert len(said) == 4
    assert said[1:3] == [
        "message: expected an object, got [1]",
        f"views: expected two of {', '.join(views.VIEWS)}, got 3",
    ]
    assert answer(address) == 200


def test_server_that_ends_is_told(browser):
    with served("--size", "64x60") as (address, _):
        page = opened(browser, address)
    expect(page.locator(".error")).to_contain_text("The connection has ended")
    page.context.close()


def test_own_scene(browser, tmp_path):
    """An XML file: its size, its camera with z up, its light; nothing flies."""
    (tmp_path / "own.xml").write_text(SCENE)
    with served(tmp_path / "own.xml") as (address, _):
        page = opened(browser, address)
        expect(page.locator(".scene")).to_contain_text("own.xml, ")
        assert page.evaluate("app.hello.sizes[0]") == [96, 64]
        np.testing.assert_allclose(page.evaluate("app.header.pose.eye"), [0, -6, 2], atol=1e-5)
        assert page.evaluate("app.hello.home.up") == [0, 0, 1]
        assert page.locator("button.moving").is_disabled()
        look(page, "raw", "normal")
        lit = images(page)[0, ..., :3].mean()
        drag(page, (60, 0))
        assert turned(page)["eye"][2] == pytest.approx(2, abs=1e-3)
        page.keyboard.press("l")
        until(page, "!h.light")
        assert images(page)[0, ..., :3].mean() < lit / 10
        page.context.close()


def test_what_cannot_be_shown(tmp_path, capsys):
    """One line that names it, before anything is served."""

    def refused(*arguments) -> str:
        assert cli.main(["live", "--no-open", *map(str, arguments)]) == 2
        printed = capsys.readouterr()
        assert printed.out == ""
        (line,) = printed.err.splitlines()
        return line

    assert refused(tmp_path / "none.xml") == f"yester: error: {tmp_path / 'none.xml'}: no such file"
    (tmp_path / "bad.xml").write_text("<scene")
    assert f"{tmp_path / 'bad.xml'}: " in refused(tmp_path / "bad.xml")
    (tmp_path / "blind.xml").write_text(re.sub(r"<sensor.*</sensor>", "", SCENE, flags=re.S))
    assert "blind.xml: expected a scene with a perspective sensor, got none" in refused(tmp_path / "blind.xml")
    assert "--port: expected 0 to 65535" in refused("--port", 65536)
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert f"port: expected one that is free, got {port}" in refused("--port", port)


WIDGET = """async (module) => {
  const { default: widget } = await import(URL.createObjectURL(new Blob([module], { type: "text/javascript" })));
  window.sent = [];
  const model = { send: (message) => sent.push(message), on: (_, heard) => { window.heard = heard; }, off: () => {} };
  const el = document.body.appendChild(document.createElement("div"));
  window.clean = widget.render({ model, el });
}"""


def test_widget(browser, folder):
    """In a notebook: the kernel's side here, the page's side in a browser, joined by hand."""
    from yester.live import Widget

    async def kernel() -> tuple[dict, bytes, str, str]:
        widget = Widget(size=(64, 60), folder=folder)
        sent: asyncio.Queue = asyncio.Queue()
        widget.send = lambda content, buffers=None: sent.put_nowait((content, buffers))
        widget._handle_custom_msg({"ready": True}, None)
        hello = picture = None
        while hello is None or picture is None:
            content, buffers = await asyncio.wait_for(sent.get(), 60)
            hello = content if "hello" in content else hello
            picture = bytes(buffers[0]) if buffers else picture
        widget._handle_custom_msg({"shown": 0, "light": 3}, None)
        while "error" not in content:
            content, _ = await asyncio.wait_for(sent.get(), 60)
        assert content == {"error": "light: expected true or false, got 3"}
        source = widget._esm, widget._css
        widget.close()
        widget.close()
        return hello, picture, *source

    hello, picture, module, style = ran(kernel())
    page = browser.new_page()
    page.set_content(f"<style>{style}</style>")
    page.evaluate(WIDGET, module)
    assert page.evaluate("sent") == [{"ready": True}]
    page.evaluate("(hello) => heard(hello, [])", hello)
    page.evaluate("(bytes) => heard({}, [new DataView(new Uint8Array([0, ...bytes]).buffer, 1)])", [*picture])
    assert page.evaluate("sent.at(-1)") == {"shown": 0}
    length = int.from_bytes(picture[:4], "little")
    pixels = np.frombuffer(picture[4 + length :], np.uint8).reshape(2, 60, 64, 4)
    shown = canvas(page)
    np.testing.assert_array_equal(shown[:, :32], pixels[0, :, :32])
    np.testing.assert_array_equal(shown[:, 32:], pixels[1, :, 32:])
    page.keyboard.press("l")  # elsewhere in the notebook
    assert page.evaluate("sent.at(-1)") == {"shown": 0}
    page.locator("canvas").press("l")
    assert page.evaluate("sent.at(-1)") == {"light": False}
    page.close()


@pytest.mark.long
def test_screenshot(browser, tmp_path):
    """The picture of the guide: YESTER_SCREENSHOTS=docs/_static writes it anew."""
    with served("--size", "320x240") as (address, _):
        page = opened(browser, address, viewport={"width": 1200, "height": 760})
        tell(page, size=0, moving=True)
        until(page, "h.size[0] === 320 && h.number > 12")
        drag(page, (30, -10))
        turned(page)
        number = page.evaluate("app.header.number")
        until(page, f"h.number > {number + 8}")
        for _ in range(2):
            page.locator("canvas").press("]")
        page.locator("h1").click()
        page.wait_for_timeout(2000)
        path = Path(os.environ.get("YESTER_SCREENSHOTS", tmp_path)) / "live.webp"
        page.screenshot(path=path.with_suffix(".png"))
        with Image.open(path.with_suffix(".png")) as image:
            image.convert("RGB").save(path, quality=85, method=6)
        path.with_suffix(".png").unlink()
        assert 20_000 < path.stat().st_size < 300_000
        page.context.close()


def test_pages_are_static():
    """One file, without anything from elsewhere."""
    from yester.live.messages import page

    text = page()
    assert not re.search(r"https?://|src=|@import|url\(", text)
