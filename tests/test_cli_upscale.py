"""`yester upscale`, run in a process of its own."""

import numpy as np
import OpenEXR
import pytest
import yester
from test_cli import noise, refused, run
from yester.io import describe, read_exr, write_exr

pytestmark = pytest.mark.slow


@pytest.fixture
def sequence(tmp_path):
    """Twelve jittered frames whose names do not sort alphabetically into their order."""
    folder = tmp_path / "small"
    folder.mkdir()
    camera = yester.Camera.from_look_at([0, 1, 5], [0, 1, 0], [0, 1, 0], 40, 32, 24)
    for i, offset in enumerate(yester.jitter(12)):
        mask = np.full((24, 32), i / 24)
        frame = noise(seed=i, depth=np.ones((24, 32)), camera=camera, jitter=offset, reactive=mask)
        write_exr(folder / f"shot{i + 1}.exr", frame)
    return folder


def test_files_keep_jitter_and_mask(sequence):
    frame = read_exr(sequence / "shot3.exr")
    assert frame.jitter == tuple(yester.jitter(3)[2])
    assert describe(sequence / "shot3.exr").jitter == frame.jitter
    assert (frame.reactive == np.float32(2 / 24)).all()
    assert "jitter" in run("info", sequence / "shot3.exr").stdout


@pytest.mark.parametrize("options", [{}, {"fireflies": True}])
def test_upscale_is_the_pipeline(sequence, tmp_path, options):
    """In natural order, at the new size, with a camera of that size."""
    run("upscale", sequence, "-o", tmp_path / "out", *(f"--{name}" for name in options))
    upscaler = yester.Upscaler(**options)
    for i in range(12):
        want = upscaler.step(read_exr(sequence / f"shot{i + 1}.exr")).color
        got = read_exr(tmp_path / "out" / f"shot{i + 1}.exr")
        np.testing.assert_array_equal(got.color, want)
        assert (got.camera.height, got.camera.width) == got.shape == (48, 64)


def test_options(sequence, tmp_path):
    run(
        "upscale",
        sequence,
        "-o",
        tmp_path / "out",
        "--scale",
        1.5,
        "--sharpness",
        0.4,
        "--denoise",
        "--half",
        "--fireflies",
    )
    svgf, upscaler = yester.SVGF(antialias=False, fireflies=True), yester.Upscaler(1.5, sharpness=0.4)
    for i in range(12):
        frame = read_exr(sequence / f"shot{i + 1}.exr")
        named = {"depth": frame.depth, "reactive": frame.reactive, "camera": frame.camera, "jitter": frame.jitter}
        want = upscaler.step(yester.Frame(svgf.step(frame).color, **named)).color.astype(np.float16)
        np.testing.assert_array_equal(read_exr(tmp_path / "out" / f"shot{i + 1}.exr").color, want)


def test_frames_without_jitter_are_reported(tmp_path):
    (tmp_path / "small").mkdir()
    for i in range(2):
        write_exr(tmp_path / "small" / f"{i}.exr", noise(seed=i))
    assert "no jitter found in the headers" in run("upscale", tmp_path / "small", "-o", tmp_path / "out").stderr
    assert read_exr(tmp_path / "out" / "1.exr").shape == (48, 64)


def test_refuses_before_work_starts(sequence, tmp_path):
    out = tmp_path / "out"
    for scale in (0.9, 4.5, "nan"):
        assert "scale: expected a number from 1 to 4" in refused("upscale", sequence, "-o", out, "--scale", scale)
    assert "sharpness" in refused("upscale", sequence, "-o", out, "--sharpness", 2)
    assert "nowhere" in refused("upscale", tmp_path / "nowhere", "-o", out)
    assert "overwrite" in refused("upscale", sequence, "-o", sequence)
    header = {"jitter": np.array([0.7, 0.0])}
    pixels = np.ones((24, 32), np.float32)
    OpenEXR.File(header, dict.fromkeys("RGB", pixels)).write(str(sequence / "shot13.exr"))
    assert "shot13.exr: jitter: expected two offsets" in refused("upscale", sequence, "-o", out)
    write_exr(sequence / "shot13.exr", noise(width=40))
    assert "shot13.exr: 40 x 24" in refused("upscale", sequence, "-o", out)
    assert not out.exists()
