"""The page that compares folders, as its readers use it, in a browser."""

import io
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page, expect
from yester.io import write_exr
from yester.metrics import srgb
from yester.study.compare.viewer import names_of, write_comparison

pytestmark = pytest.mark.slow
WIDTH, HEIGHT = 40, 30
FRAMES = (3, 4, 5)
#: Far below and above what 8 bits hold, and one float16 does not hold.
VALUES = {"noisy": (0.0004, 0.3, 700.0), "clean": (0.0008, 1 / 3, 650.0), "reference": (0.001, 0.5, 600.0)}


def picture(name: str, frame: int) -> np.ndarray:
    """Three columns of one value each, which depend on source and frame, in a colour."""
    image = np.repeat(np.array(VALUES[name], np.float32), (14, 13, 13))[None, :, None] * np.ones((HEIGHT, 1, 3))
    image *= np.array([1, 0.5, 0.25]) * (1 + 0.1 * FRAMES.index(frame))
    image[20:24, 4:8] = np.nan
    return image.astype(np.float32)


@pytest.fixture(scope="module")
def folders(tmp_path_factory) -> dict[str, Path]:
    root = tmp_path_factory.mktemp("folders")
    for name in VALUES:
        (root / name).mkdir()
        for frame in FRAMES:
            write_exr(root / name / f"shot_{frame:04}.exr", picture(name, frame), half=name == "reference")
    return {name: root / name for name in VALUES}


@pytest.fixture
def page(browser, folders, tmp_path) -> Iterator[Page]:
    """The page without a network; at the end, it has asked for nothing and complained of nothing."""
    path = tmp_path / "compare.html"
    assert write_comparison(path, folders, title="A <b> & C") == ["0003", "0004", "0005"]
    context = browser.new_context(viewport={"width": 900, "height": 900}, offline=True)
    page = context.new_page()
    page.set_default_timeout(5000)
    asked, said = [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.goto(path.as_uri())
    shows(page, "0003", "noisy | clean")
    yield page
    assert [url for url in asked if not url.startswith("data:")] == [path.as_uri()]
    assert said == []
    context.close()


def shows(page: Page, frame: str, what: str) -> None:
    expect(page.locator("canvas")).to_have_attribute("aria-label", f"noisy | clean | reference, frame {frame}: {what}")


def pixel(page: Page, column: int, row: int = 15) -> tuple[int, int, int]:
    """The colour of an image's pixel as on the screen."""
    image = Image.open(io.BytesIO(page.locator("canvas").screenshot())).convert("RGB")
    return image.getpixel((int((column + 0.5) / WIDTH * image.width), int((row + 0.5) / HEIGHT * image.height)))


def encoded(linear, exposure: float = 0) -> object:
    return pytest.approx(tuple(srgb(np.asarray(linear) * 2.0**exposure) * 255), abs=1.01)


def expose(page: Page, stops: float) -> None:
    page.locator("#exposure").fill(str(stops))


def test_split_and_exposure(page):
    noisy, clean = picture("noisy", 3), picture("clean", 3)
    expect(page.locator("#chart")).to_be_hidden()
    expect(page.locator("#numbers")).to_be_hidden()
    expect(page.locator("#lossy")).to_be_hidden()
    expect(page.locator("h1")).to_have_text("A <b> & C")
    assert pixel(page, 16) == encoded(noisy[15, 16])
    assert pixel(page, 24) == encoded(clean[15, 24])
    assert pixel(page, 5, 22) == (255, 0, 255)
    expose(page, 8)
    expect(page.locator("#stops")).to_have_text("+8 stops")
    assert pixel(page, 2) == encoded(noisy[15, 2], 8)
    expose(page, -10)
    assert pixel(page, 38) == encoded(clean[15, 38], -10)
    page.locator("#dark").click()
    expect(page.locator("#stops")).to_have_text("0 stops")


def test_values_are_those_of_the_files(page):
    """Every bit: what is decoded in the page, against the files."""
    for side, name in enumerate(("noisy", "clean")):
        bits = page.evaluate(f"Array.from(new Uint32Array(shown[{side}].linear.buffer))")
        found = np.array(bits, np.uint32).view(np.float32).reshape(3, HEIGHT, WIDTH)
        np.testing.assert_array_equal(np.moveaxis(found, 0, -1), picture(name, 3))
    page.locator(".source").nth(1).select_option("reference")
    shows(page, "0003", "noisy | reference")
    assert page.evaluate("data.images.map((image) => image.bytes)") == [4, 4, 2] * 3
    found = np.array(page.evaluate("Array.from(shown[1].linear, (v) => isNaN(v) ? null : v)"), np.float64)
    want = picture("reference", 3).astype(np.float16).astype(np.float64)
    np.testing.assert_array_equal(np.moveaxis(found.reshape(3, HEIGHT, WIDTH), 0, -1), want)
    page.locator("canvas").hover(position={"x": 430, "y": 300})
    red = float(np.float32(VALUES["noisy"][1]))
    expect(page.locator("#pixel")).to_contain_text(f"left: {red:.4f} {red / 2:.4f}")


def test_flip(page):
    noisy, clean = picture("noisy", 3)[15, 20], picture("clean", 3)[15, 20]
    page.locator("#mode").select_option("flip")
    shows(page, "0003", "noisy")
    expect(page.locator("#split")).to_be_hidden()
    assert pixel(page, 20) == encoded(noisy)
    page.locator("#turn").click()
    shows(page, "0003", "clean")
    assert pixel(page, 20) == encoded(clean)
    page.keyboard.press("f")
    shows(page, "0003", "noisy")
    page.keyboard.press("s")
    shows(page, "0003", "noisy | clean")
    expect(page.locator("#split")).to_be_visible()


def test_difference(page):
    page.locator("canvas").focus()
    page.keyboard.press("d")
    shows(page, "0003", "|noisy − clean|")
    apart = np.abs(picture("noisy", 3) - picture("clean", 3))
    for stops in (0, 4, -9):
        expose(page, stops)
        expect(page.locator("#stops")).to_contain_text(str(stops))
        for column in (2, 20, 36):
            assert pixel(page, column) == encoded(apart[15, column], stops)
    page.locator(".source").nth(1).select_option("reference")
    shows(page, "0003", "|noisy − reference|")
    apart = np.abs(picture("noisy", 3) - picture("reference", 3).astype(np.float16).astype(np.float32))
    expose(page, 1)
    assert pixel(page, 20) == encoded(apart[15, 20], 1)


def test_frames(page):
    page.locator("#frame").fill("2")
    shows(page, "0005", "noisy | clean")
    assert pixel(page, 16) == encoded(picture("noisy", 5)[15, 16])
    for _ in range(3):
        page.locator("canvas").press("]")
    expect(page.locator("#stops")).to_have_text("+1.5 stops")
    assert pixel(page, 16) == encoded(picture("noisy", 5)[15, 16], 1.5)


def test_frames_that_do_not_match(folders, tmp_path):
    a, b = folders["noisy"], folders["clean"]
    other = tmp_path / "other"
    other.mkdir()
    for i in range(2):
        write_exr(other / f"x{i}.exr", np.ones((HEIGHT, WIDTH, 3)))
    with pytest.raises(ValueError, match="3 in a, 2 in b"):
        write_comparison(tmp_path / "page.html", {"a": a, "b": other})
    write_exr(other / "x2.exr", np.ones((HEIGHT, WIDTH + 1, 3)))
    with (
        pytest.warns(UserWarning, match="paired by their order"),
        pytest.raises(ValueError, match=r"x2\.exr: expected .* \(30, 40\) as in .*, got \(30, 41\)"),
    ):
        write_comparison(tmp_path / "page.html", {"a": a, "b": other})
    with pytest.raises(ValueError, match="at least two"):
        write_comparison(tmp_path / "page.html", {"a": a})
    with pytest.raises(ValueError, match="frames: expected at least 1"):
        write_comparison(tmp_path / "page.html", {"a": a, "b": b}, frames=0)
    assert not (tmp_path / "page.html").exists()
    frame = b / "shot_0003.exr"
    kept = frame.read_bytes()
    with pytest.raises(ValueError, match=r"shot_0003\.exr: the page would overwrite this input"):
        write_comparison(frame, {"a": a, "b": b})
    assert frame.read_bytes() == kept


def test_frames_of_other_names_and_the_same_numbers(tmp_path):
    for folder, name in (("a", "noisy_{:04}"), ("b", "clean_{}")):
        (tmp_path / folder).mkdir()
        for i in range(2):
            write_exr(tmp_path / folder / f"{name.format(i)}.exr", np.ones((HEIGHT, WIDTH, 3)))
    assert len(write_comparison(tmp_path / "p.html", {"a": tmp_path / "a", "b": tmp_path / "b"})) == 2


def test_frames_that_are_left_out_or_have_other_numbers(folders, tmp_path):
    image = np.ones((HEIGHT, WIDTH, 3))
    for folder, numbers in (("a", range(4)), ("b", range(2, 6)), ("c", range(4, 8))):
        (tmp_path / folder).mkdir()
        for i in numbers:
            write_exr(tmp_path / folder / f"{'cx'[folder == 'c']}_{i}.exr", image)
    with pytest.warns(UserWarning, match="are left out") as told:
        assert write_comparison(tmp_path / "p.html", {"a": tmp_path / "a", "b": tmp_path / "b"}) == ["2", "3"]
    assert [str(one.message).split(",")[0] for one in told] == [f"sources: 2 files of {folder}" for folder in "ab"]
    with pytest.warns(UserWarning, match=r"paired by their order, with other numbers: .*c_0\.exr beside .*x_4\.exr"):
        write_comparison(tmp_path / "q.html", {"a": tmp_path / "a", "c": tmp_path / "c"})


def test_names():
    given = Path("/a/noisy"), Path("/b/noisy"), Path("/b/clean")
    assert list(names_of(given)) == ["a/noisy", "b/noisy", "b/clean"]
    assert list(names_of(given[1:])) == ["noisy", "clean"]
    assert list(names_of(given[:1] * 2)) == ["1: noisy", "2: noisy"]


def test_the_command(folders, tmp_path):
    """With what the extra for EXR files installs, and no more."""
    absent = "matplotlib", "PIL", "skimage", "psutil", "flip_evaluator", "cv2", "platformdirs", "torch", "mitsuba"
    code = (
        f"import sys; sys.modules |= dict.fromkeys({absent}); from yester.cli import main; sys.exit(main(sys.argv[1:]))"
    )
    given = folders["noisy"], folders["clean"], folders["reference"], "-o", tmp_path / "new" / "page.html"
    command = [sys.executable, "-c", code, "compare", *map(str, given), "--frames", "2", "--half"]
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    page = (tmp_path / "new" / "page.html").read_text()
    assert page.count('id="pixels') == 6
    assert '"frames":["0003","0005"]' in page
    assert "rounded to float16" in page
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.returncode == 2
    assert "page.html: exists already: --overwrite replaces" in result.stderr
    assert subprocess.run([*command, "--overwrite"], capture_output=True).returncode == 0
