"""Pictures and animations: what a viewer sees of linear images."""

import resource
import subprocess
import sys

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image
from yester.io import write_exr
from yester.io.pictures import displayed, write_animation, write_png


def one(values) -> np.ndarray:
    return np.array(values, np.float32).reshape(1, -1, 3)


def test_what_is_displayed():
    """The sRGB curve written out, with the tone curves at places that are known."""
    x = np.linspace(0, 1, 300).reshape(10, 10, 3)
    want = [12.92 * v if v <= 0.0031308 else 1.055 * v ** (1 / 2.4) - 0.055 for v in x.ravel()]
    np.testing.assert_array_equal(displayed(x).ravel(), np.floor(np.array(want) * 255 + 0.5))
    np.testing.assert_array_equal(displayed(x * 8, exposure=-3), displayed(x))
    np.testing.assert_array_equal(displayed(x, curve="reinhard"), displayed(x / (1 + x)))
    aces = [(v * (2.51 * v + 0.03)) / (v * (2.43 * v + 0.59) + 0.14) for v in (0.18, 1, 4)]
    np.testing.assert_array_equal(displayed(one([0.18, 1, 4]), curve="aces"), displayed(one(aces)))
    given = one([np.nan, -1, np.inf, -np.inf, 1e30, 0])
    for curve in ("clip", "reinhard", "aces"):
        assert displayed(given, exposure=3, curve=curve).ravel().tolist() == [0, 0, 255, 0, 255, 0]
    for exposure, shown in ((1e6, [255, 0, 255]), (-1e6, [0, 0, 0])):
        assert displayed(one([1e-5, 0, 1e5]), exposure=exposure).ravel().tolist() == shown


def test_png(tmp_path):
    image = np.random.default_rng(0).exponential(0.5, (7, 9, 3)).astype(np.float32)
    write_png(tmp_path / "a.png", image, exposure=1, curve="aces")
    with Image.open(tmp_path / "a.png") as picture:
        assert (picture.format, picture.mode) == ("PNG", "RGB")
        np.testing.assert_array_equal(np.asarray(picture), displayed(image, exposure=1, curve="aces"))
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]


@pytest.mark.parametrize("kind", [".webp", ".mp4"])
def test_animations(tmp_path, kind):
    """The frames come back, but for compression; an odd size is kept or padded."""
    images = [np.full((11, 13, 3), (0.1 * i, 0.5, 0.2), np.float32) for i in range(5)]
    path = tmp_path / f"take:1{kind}"
    write_animation(path, iter(images), fps=10)
    if kind == ".webp":
        with Image.open(path) as film:
            assert (film.n_frames, film.size, film.info["loop"]) == (5, (13, 11), 0)
            found = []
            for i in range(5):
                film.seek(i)
                film.load()
                assert film.info["duration"] == 100
                found.append(np.asarray(film.convert("RGB")))
    else:
        program = imageio_ffmpeg.get_ffmpeg_exe()
        about = subprocess.run([program, "-hide_banner", "-i", path], capture_output=True, text=True).stderr
        assert "Video: h264" in about
        assert "10 fps" in about
        assert "yuv420p(tv, bt709/bt709/iec61966-2-1" in about
        decode = [program, "-loglevel", "error", "-i", path, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
        raw = subprocess.run(decode, capture_output=True, check=True).stdout
        found = np.frombuffer(raw, np.uint8).reshape(-1, 12, 14, 3)
    assert len(found) == 5
    for image, picture in zip(images, found, strict=True):
        assert np.abs(picture[:11, :13].astype(int) - displayed(image)).max() < 8
    assert [item.name for item in tmp_path.iterdir()] == [path.name]


def test_bad_pictures(tmp_path):
    image = np.ones((4, 4, 3))
    for named, words in (
        ({"curve": "filmic"}, "curve: expected one of clip, reinhard, aces, got filmic"),
        ({"exposure": np.nan}, "exposure: expected a finite"),
    ):
        with pytest.raises(ValueError, match=words):
            write_png(tmp_path / "a.png", image, **named)
    with pytest.raises(ValueError, match=r"image: expected shape \(H, W, 3\), got \(4, 4\)"):
        write_png(tmp_path / "a.png", image[..., 0])
    with pytest.raises(ValueError, match=r"expected a name that ends in \.webp or \.mp4"):
        write_animation(tmp_path / "a.gif", [image])
    for kind in (".webp", ".mp4"):
        with pytest.raises(ValueError, match="images: expected at least one"):
            write_animation(tmp_path / f"a{kind}", [])
        with pytest.raises(ValueError, match=r"images: expected shape \(4, 4, 3\) as before, got \(5, 4, 3\)"):
            write_animation(tmp_path / f"a{kind}", [image, np.ones((5, 4, 3))])
    for kind in (".webp", ".mp4"):
        for fps in (0, 1e-8, 1e4, np.inf, np.nan):
            with pytest.raises(ValueError, match=r"fps: expected 0\.001 to 1000, got "):
                write_animation(tmp_path / f"a{kind}", [image], fps=fps)
    assert not any(tmp_path.iterdir())


def test_slowest_and_fastest_animations(tmp_path):
    images = [np.zeros((4, 4, 3)), np.ones((4, 4, 3))]
    for fps, duration in ((0.001, 1_000_000), (1000, 1)):
        write_animation(tmp_path / "a.webp", images, fps=fps)
        with Image.open(tmp_path / "a.webp") as film:
            film.load()
            assert film.info["duration"] == duration
        write_animation(tmp_path / "a.mp4", images, fps=fps)
        assert (tmp_path / "a.mp4").stat().st_size > 0


def test_a_size_that_webp_lacks(tmp_path):
    with pytest.raises(ValueError, match="expected at most 16383 pixels a side for WebP, got 16384 x 2"):
        write_animation(tmp_path / "a.webp", [np.zeros((2, 16384, 3))])
    assert not any(tmp_path.iterdir())


def test_a_size_that_h264_lacks(tmp_path):
    """The error names the file that was asked for, not the temporary one."""
    with pytest.raises(OSError, match=r"a\.mp4: cannot be written: .+") as caught:
        write_animation(tmp_path / "a.mp4", [np.zeros((2, 20_000, 3))])
    assert ".tmp" not in str(caught.value)
    assert not any(tmp_path.iterdir())


def test_a_full_disk(tmp_path):
    """The file is named, and nothing remains of it."""
    images = [np.random.default_rng(i).random((64, 64, 3)) for i in range(3)]
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, limits[1]))
    try:
        with pytest.raises(OSError, match=r"a\.png") as caught:
            write_png(tmp_path / "a.png", images[0])
        assert caught.value.filename == str(tmp_path / "a.png")
        with pytest.raises(OSError, match=r"a\.webp"):
            write_animation(tmp_path / "a.webp", images)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert not any(tmp_path.iterdir())


def told(*arguments, code=0) -> str:
    command = [sys.executable, "-W", "error", "-m", "yester", *map(str, arguments)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert result.returncode == code, result.stderr
    return result.stderr


@pytest.mark.slow
def test_the_command(tmp_path):
    (tmp_path / "in").mkdir()
    images = [np.full((8, 10, 3), 0.1 * i, np.float32) for i in range(3)]
    for i, image in enumerate(images):
        write_exr(tmp_path / "in" / f"f{i}.exr", image)
    told("picture", tmp_path / "in", "-o", tmp_path / "out", "--exposure", 1.5, "--curve", "aces")
    for i, image in enumerate(images):
        with Image.open(tmp_path / "out" / f"f{i}.png") as picture:
            np.testing.assert_array_equal(np.asarray(picture), displayed(image, exposure=1.5, curve="aces"))
    told("picture", tmp_path / "in", "-o", tmp_path / "film.webp", "--fps", 5)
    with Image.open(tmp_path / "film.webp") as film:
        assert film.n_frames == 3
    pictures = ", ".join(str(tmp_path / "out" / f"f{i}.png") for i in range(3))
    for name, there in (("film.webp", tmp_path / "film.webp"), ("out", pictures)):
        said = told("picture", tmp_path / "in", "-o", tmp_path / name, code=2)
        assert f"{there}: exists already: --overwrite replaces" in said
    told("picture", tmp_path / "in", "-o", tmp_path / "out", "--overwrite")
    with Image.open(tmp_path / "out" / "f2.png") as picture:
        np.testing.assert_array_equal(np.asarray(picture), displayed(images[2]))
    (tmp_path / "in" / "f1.exr").write_bytes(b"no image")
    for name in ("few", "few.webp"):
        said = told("picture", tmp_path / "in", "-o", tmp_path / name, code=1)
        assert said.splitlines() == [f"left out: {tmp_path / 'in' / 'f1.exr'}: not an EXR file"]
    assert {path.name for path in (tmp_path / "few").iterdir()} == {"f0.png", "f2.png"}
    with Image.open(tmp_path / "few.webp") as film:
        assert film.n_frames == 2
    said = told("picture", tmp_path / "in" / "f1.exr", "-o", tmp_path / "none.webp", code=2)
    assert [line.partition(": ")[0] for line in said.splitlines()] == ["left out", "yester"]
    assert not (tmp_path / "none.webp").exists()
    assert "expected a folder for 3 files" in told("picture", tmp_path / "in", "-o", tmp_path / "a.png", code=2)
