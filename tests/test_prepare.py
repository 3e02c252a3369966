"""Training sets: what is in them, and how they come about when things go wrong."""

import errno
import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import flight
import layouts
import noisebase
import numpy as np
import psutil
import pytest
import yester
import zarr
from compare import assert_close
from yester import cli
from yester.io import read_exr, write_exr
from yester.io.noisebase import decode_color, layout, read_noisebase
from yester.prepare import CHANNELS, Source, derive, find_sequences, halve, prepare, run, store

WIDTH, HEIGHT = 32, 24


def shots(count: int, width: int = WIDTH, height: int = HEIGHT, seed: int = 0) -> list[yester.Frame]:
    rng = np.random.default_rng(seed)
    clean = (flight.shoot(number, width, height) for number in range(count))
    return [replace(frame, color=flight.noisy(frame, rng)) for frame in clean]


def still(count: int, width: int = 10, height: int = 8) -> list[yester.Frame]:
    """Noise that does not move, without cameras."""
    color = np.random.default_rng(0).exponential(1, (count, height, width, 3)).astype(np.float32)
    return [yester.Frame(each, motion=np.zeros((height, width, 2))) for each in color]


def write(folder: Path, frames: list[yester.Frame]) -> None:
    folder.mkdir(parents=True)
    for i, frame in enumerate(frames):
        write_exr(folder / f"frame_{i:04}.exr", frame)


@pytest.fixture
def inputs(tmp_path) -> Path:
    """Two sequences, one in a folder of its own."""
    write(tmp_path / "in" / "one", shots(3))
    write(tmp_path / "in" / "set" / "two", shots(2, seed=1))
    return tmp_path / "in"


def tree(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def command(*arguments) -> list[str]:
    return [sys.executable, "-W", "error", "-m", "yester", "prepare", *map(str, arguments)]


def told(*arguments, code: int) -> list[str]:
    result = subprocess.run(command(*arguments), capture_output=True, text=True, timeout=120)
    assert result.returncode == code, result.stderr
    return result.stderr.splitlines()


# The images


def test_derived_images_are_the_kernels():
    frames = shots(4)
    frames[2] = replace(frames[2], color=np.where(np.indices((HEIGHT, WIDTH, 1))[1] == 3, np.nan, frames[2].color))
    svgf, before, known = yester.SVGF(), None, None
    for index, (frame, (images, missing)) in enumerate(zip(frames, derive(frames, set(CHANNELS)), strict=True)):
        assert missing == (HEIGHT if index == 2 else 0)
        color = np.nan_to_num(frame.color)
        zero = np.zeros((HEIGHT, WIDTH), np.float32)
        mean, moments, length, validity, former = color * 0, np.zeros((HEIGHT, WIDTH, 2)), zero, zero, None
        if before is not None:
            motion = frame.motion
            tests = {name: getattr(frame, name) for name in ("depth", "normal", "ids")}
            tests |= {f"previous_{name}": getattr(before, name) for name in tests}
            tests["previous_camera"] = before.camera
            seen = np.where(np.isfinite(before.color), before.color, known.color)
            history = [known.color, known.moments, known.history_length, seen]
            (mean, moments, length, former), validity = yester.reproject(history, motion, **tests)
            np.testing.assert_array_equal(images["motion"], motion[..., :2])
        known = yester.accumulate(frame.color, mean, moments, length, confidence=validity, alpha=0.2)
        guides = {name: getattr(frame, name) for name in ("depth", "normal", "ids")}
        want = {
            "color": color,
            "demodulated": yester.demodulate(color, frame.albedo, where=yester.is_reflectance(frame.albedo, frame.ids)),
            "history": mean,
            "history_length": length,
            "validity": validity,
            "variance": yester.estimate_variance(known.moments, known.history_length, **guides),
            "denoised": svgf.step(frame).color,
        }
        for name, image in want.items():
            np.testing.assert_array_equal(images[name], image, name)
        difference = np.zeros_like(color)
        if former is not None:
            both = (validity > 0) & np.isfinite(frame.color).all(-1)
            difference[both] = (color - former)[both]
            assert 0.5 < both.mean() < 1
        np.testing.assert_array_equal(images["difference"], difference)
        assert [name for name in CHANNELS if name in images] == list(images)
        before = frame


@pytest.mark.parametrize("kind", ["as it should be", "one seed", "y up"])
def test_the_remarks_are_the_warnings_of_the_denoiser(kind):
    frames = shots(5, 64, 48)
    if kind == "one seed":
        frames = [
            replace(frame, color=flight.noisy(flight.shoot(i, 64, 48), np.random.default_rng(0)))
            for i, frame in enumerate(frames)
        ]
    if kind == "y up":
        frames = [replace(frame, motion=frame.motion * np.float32([1, -1, 1])) for frame in frames]
    svgf, remarks, warned = yester.SVGF(), [], set()
    for frame, _ in zip(frames, derive(frames, {"denoised"}, remarks.append), strict=True):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            svgf.step(frame)
        assert [str(one.message) for one in caught] == remarks
        warned.update(remarks)
        remarks.clear()
    assert len(warned) == (kind != "as it should be")


def test_motion_is_computed_from_cameras():
    first, second = (replace(frame, motion=None) for frame in shots(2))
    (_, _), (images, _) = derive([first, second], {"motion"})
    want = yester.motion_vectors(second.position, second.camera, first.camera)[..., :2]
    np.testing.assert_array_equal(images["motion"], want)
    assert want.any()


def test_only_a_first_frame_may_lack_motion():
    frames = still(3)
    frames[0] = replace(frames[0], motion=None)
    assert len([*derive(frames, CHANNELS)]) == 3
    frames[2] = replace(frames[2], motion=None)
    assert len([*derive(frames, {"color"})]) == 3
    for name in ("motion", "history", "denoised"):
        with pytest.raises(ValueError, match=r"^no motion, and no camera"):
            list(derive(frames, {name}))


def test_a_still_view_has_the_mean_of_its_frames():
    rng = np.random.default_rng(0)
    color = rng.exponential(1, (4, 8, 9, 3)).astype(np.float32)
    frames = [yester.Frame(each, motion=np.zeros((8, 9, 2))) for each in color]
    for index, (images, _) in enumerate(derive(frames, {"history", "validity", "difference", "history_length"})):
        if index == 0:
            assert not any(image.any() for image in images.values())
            continue
        assert_close("history", images["history"], color[:index].mean(0, np.float64), rtol=1e-5)
        assert_close("difference", images["difference"], color[index] - color[index - 1], rtol=1e-5)
        assert (images["validity"] == 1).all()
        assert (images["history_length"] == index).all()


def test_half_size():
    depth = np.array([[1, 2, 3], [0.5, 4, 1], [9, 9, 9]], np.float32)
    images = {
        "color": np.arange(27, dtype=np.float32).reshape(3, 3, 3),
        "motion": np.arange(18, dtype=np.float32).reshape(3, 3, 2),
        "ids": np.arange(9, dtype=np.uint32).reshape(3, 3),
        "variance": np.full((3, 3), 4, np.float32),
    }
    small = halve(images, depth)
    # Of the last column and row, blocks have two pixels, and the last one has one.
    np.testing.assert_array_equal(small["color"][0, 0], (images["color"][:2, :2]).mean((0, 1)))
    np.testing.assert_array_equal(small["color"][1, 1], images["color"][2, 2])
    np.testing.assert_array_equal(small["ids"], [[3, 5], [6, 8]])
    np.testing.assert_array_equal(small["motion"][0], images["motion"][1, [0, 2]] / 2)
    np.testing.assert_array_equal(small["variance"], [[1, 2], [2, 4]])
    assert small["ids"].dtype == np.uint32
    np.testing.assert_array_equal(halve(images)["ids"], [[0, 2], [6, 8]])


def test_half_size_of_missing_samples():
    """They are no black ones: means are of the others."""
    color = np.ones((2, 4, 3), np.float32)
    color[0, 0, 1] = color[:, 2:, 0] = np.nan
    frame = yester.Frame(color, albedo=np.full((2, 4, 3), 0.5))
    ((images, _),) = derive([frame], {"color", "demodulated"})
    images |= {"variance": np.full((2, 4), 6, np.float32), "history": np.arange(8, dtype=np.float32).reshape(2, 4)}
    small = halve(images, missing=~np.isfinite(color).all(-1))
    np.testing.assert_array_equal(small["color"], [[[1] * 3, [0] * 3]])
    np.testing.assert_array_equal(small["demodulated"], [[[2] * 3, [0] * 3]])
    np.testing.assert_array_equal(small["variance"], [[2, 6]])
    np.testing.assert_array_equal(small["history"], [[2.5, 4.5]])


def test_half_size_of_history_that_is_not_there():
    """Where nothing was carried there is no black history."""
    history, validity = np.array([[4, 4, 0], [0, 0, 0]], np.float32), np.array([[1, 0.5, 0], [0, 0, 0]], np.float32)
    images = {"history": history, "validity": validity, "history_length": validity}
    small = halve(images, validity=validity)
    np.testing.assert_array_equal(small["history"], [[4, 0]])
    np.testing.assert_array_equal(small["validity"], [[0.375, 0]])
    np.testing.assert_array_equal(halve(images)["history"], [[2, 0]])


def test_half_size_of_buffers_that_are_not_finite():
    albedo = np.ones((2, 4, 3), np.float32)
    albedo[0, 0, 1] = albedo[:, 2:, 0] = np.nan
    small = halve({"albedo": albedo})["albedo"]
    np.testing.assert_array_equal(small, [[[1, 1, 1], [np.nan, 1, 1]]])


def test_half_size_where_depth_is_nan():
    depth = np.array([[np.nan, 3], [np.inf, 2]], np.float32)
    ids = np.arange(4, dtype=np.uint32).reshape(2, 2)
    small = halve({"depth": depth, "ids": ids}, depth)
    assert (small["depth"].item(), small["ids"].item()) == (2, 3)


def test_half_size_in_a_set_leaves_missing_samples_out(tmp_path):
    color = np.ones((2, 2, 3), np.float32)
    color[0, 1] = np.nan
    write(tmp_path / "in" / "a", [yester.Frame(color)])
    prepare(tmp_path / "in", tmp_path / "out", sizes=("half",), jobs=1)
    half = zarr.open_group(tmp_path / "out" / "a" / "data.zarr", mode="r")["half/color"]
    np.testing.assert_array_equal(half, np.ones((1, 3, 1, 1)))


# Noisebase


def test_shared_exponents():
    """Against the formula written out."""
    color = np.array([[[255, 0], [128, 1]], [[0, 3], [7, 9]], [[0, 255], [64, 32]], [[255, 0], [128, 7]]], np.uint8)
    low, high = -3.5, 4.25
    want = color[:3] / 255 * np.exp(low + (color[3] + 1.0) / 256 * (high - low))
    assert_close("rgb", decode_color(color, np.array([low, high])), want, rtol=1e-6)


@pytest.mark.parametrize("single", [False, True])
def test_stores_are_what_was_rendered(tmp_path, single):
    size, window = (54, 96), (54, 96) if single else (32, 40)
    path = tmp_path / "store"
    if single:
        noisebase.single_frames(path)
        paths = sorted(path.iterdir())
    else:
        path = tmp_path / "store.zip"
        noisebase.training(path)
        paths = [path]
    assert layout(paths[0]).single is single
    for index, (frame, reference) in enumerate(read_noisebase(paths)):
        shot = flight.shoot(index, size[1], size[0])
        top, left = noisebase.offset(index) if not single else (0, 0)
        cut = np.s_[top : top + window[0], left : left + window[1]]
        hit = shot.ids[cut] > 0
        assert_close("reference", reference, shot.color[cut], rtol=1e-6)
        named = noisebase.arrays(index, size, window)
        want = decode_color(named["color"], named["exposure"]).mean(-1)
        assert_close("color", frame.color, np.moveaxis(want, 0, -1), rtol=1e-5)
        assert abs(frame.color.mean() / (shot.color[cut].mean()) - 1) < 0.1
        assert_close("albedo", frame.albedo, shot.albedo[cut], rtol=1e-3)
        assert_close("normal", frame.normal, shot.normal[cut], rtol=1e-3)
        assert_close("depth", frame.depth[hit], shot.depth[cut][hit], rtol=1e-5)
        assert np.isinf(frame.depth[~hit]).all()
        if index == 0:
            assert not frame.motion.any()
            continue
        motion = shot.motion[cut].copy()
        if not single:
            # The window has moved as well.
            motion[..., :2] += np.subtract(noisebase.offset(index), noisebase.offset(index - 1))[::-1]
        assert_close("motion", frame.motion, motion, rtol=1e-4)


@pytest.mark.parametrize("empty", [(0,), (1,), (0, 1)])
def test_frames_of_a_store_in_which_nothing_was_hit(tmp_path, empty):
    """The size of the whole image is that of the others."""
    noisebase.training(tmp_path / "a.zip")
    whole = [frame for frame, _ in read_noisebase(tmp_path / "a.zip")]
    noisebase.training(tmp_path / "b.zip", empty=empty)
    for index, (frame, _) in enumerate(read_noisebase(tmp_path / "b.zip")):
        np.testing.assert_allclose(frame.camera.world_to_clip, whole[index].camera.world_to_clip)
        assert np.isinf(frame.depth).all() == (index in empty)
    noisebase.training(tmp_path / "c.zip", empty=range(len(whole)))
    with pytest.raises(ValueError, match=r"c\.zip: position: nothing was hit"):
        next(read_noisebase(tmp_path / "c.zip"))


def test_damaged_stores_are_named(tmp_path):
    named = noisebase.arrays(0, (54, 96), (32, 40))
    for name, change, words in (
        ("lacks", {"diffuse": None}, "diffuse is missing"),
        ("moved", {"crop_offset": np.array([0, 0], np.int32)}, "positions project"),
        ("shape", {"color": np.zeros((3, 32, 40, 4), np.uint8)}, r"color: expected shape"),
    ):
        path = tmp_path / f"{name}.zip"
        changed = {key: value for key, value in {**named, **change}.items() if value is not None}
        noisebase.save(path, changed, single=True)
        with pytest.raises(ValueError, match=f"^{path}: .*{words}"):
            list(read_noisebase(path))
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(ValueError, match=f"^{path}: truncated or corrupt"):
        list(read_noisebase(path))
    with pytest.raises(FileNotFoundError, match="nowhere"):
        list(read_noisebase(tmp_path / "nowhere.zip"))


def test_a_set_of_a_store(tmp_path):
    noisebase.training(tmp_path / "in.zip")
    done = prepare(tmp_path / "in.zip", tmp_path / "out")
    assert (done.sequences, done.frames, done.set_aside) == (("in",), 4, {})
    data = zarr.open_group(tmp_path / "out" / "in" / "data.zarr", mode="r")["full"]
    assert {"reference", "history", "denoised"} < set(data.array_keys())
    noise, denoised = (np.mean((data[name][-1] - data["reference"][-1]) ** 2) for name in ("color", "denoised"))
    assert denoised < 0.3 * noise


# Sequences


def test_sequences_are_found(tmp_path):
    frames = shots(1)
    for name in ("b/10", "b/9"):
        write(tmp_path / "in" / name, frames)
    write(tmp_path / "in" / "jump", frames * 2)
    (tmp_path / "in" / "jump" / "frame_0001.exr").rename(tmp_path / "in" / "jump" / "frame_0005.exr")
    noisebase.training(tmp_path / "in" / "scene.zip", frames=1)
    noisebase.single_frames(tmp_path / "in" / "test", frames=2)
    (tmp_path / "in" / "test" / "broken.zip").write_bytes(b"PK")
    found, aside = find_sequences(tmp_path / "in")
    assert [source.name for source in found] == ["scene", "b/9", "b/10", "jump", "jump-2", "test"]
    assert [len(source.files) for source in found] == [1, 1, 1, 1, 1, 2]
    assert list(aside) == ["test/broken"]
    assert "broken.zip: truncated or corrupt" in aside["test/broken"][0]
    with pytest.raises(ValueError, match="two sequences would have the name scene"):
        find_sequences([tmp_path / "in", tmp_path / "in" / "scene.zip"])
    (tmp_path / "empty").mkdir()
    with pytest.raises(ValueError, match="no EXR files and no Noisebase stores"):
        find_sequences(tmp_path / "empty")
    with pytest.raises(FileNotFoundError, match="nowhere"):
        find_sequences(tmp_path / "nowhere")
    frame = tmp_path / "in" / "b" / "9" / "frame_0000.exr"
    with pytest.raises(ValueError, match=f"^{frame}: expected a folder of EXR files or a Noisebase store"):
        find_sequences(frame)


def test_parts_of_a_folder_do_not_take_the_name_of_another_folder(tmp_path):
    for name, numbers in {"shot": (1, 2, 4, 5, 8), "shot-2": (1, 2), "shot-2-1": (1,)}.items():
        (tmp_path / name).mkdir()
        for number in numbers:
            write_exr(tmp_path / name / f"f_{number}.exr", still(1)[0])
        (tmp_path / name / "._f_1.exr").write_bytes(bytes(64))
    found, aside = find_sequences(tmp_path)
    assert [(source.name, len(source.files)) for source in found] == [
        ("shot", 2),
        ("shot-2-1-1", 2),
        ("shot-3", 1),
        ("shot-2", 2),
        ("shot-2-1", 1),
    ]
    assert not aside


def test_no_sequence_is_also_set_aside(tmp_path):
    """What cannot be used beside a folder of its name has another name, and the others go on."""
    for name in ("s", "s-1"):
        write(tmp_path / "in" / "shots" / name, still(2))
        (tmp_path / "in" / "shots" / f"{name}.zip").write_bytes(b"an archive of the folder")
        (tmp_path / "in" / "shots" / f"{name}.ZIP").write_bytes(b"another one")
    done = prepare(tmp_path / "in", tmp_path / "out", jobs=1)
    assert done.sequences == ("shots/s", "shots/s-1")
    assert [*done.set_aside] == ["shots/s-1-1", "shots/s-1-1-1"]
    told = [message.partition(": ")[0] for messages in done.set_aside.values() for message in messages]
    assert sorted(told) == sorted(str(path) for path in (tmp_path / "in" / "shots").iterdir() if path.is_file())
    assert prepare(tmp_path / "in", tmp_path / "out", jobs=1, resume=True) == done


def frames_in_stores(folder: Path, names: list[str]) -> None:
    """Stores of single frames; the frame is of no account."""
    noisebase.single_frames(folder, frames=1)
    (folder / "frame0000.zip").rename(folder / names[0])
    for name in names[1:]:
        shutil.copy(folder / names[0], folder / name)


def test_frames_in_stores_are_ordered_by_each_of_their_numbers(tmp_path):
    frames_in_stores(tmp_path / "a", ["s1_9.zip", "s1_10.zip", "s2_1.zip", "s10_1.zip"])
    found, _ = find_sequences(tmp_path)
    names = [[path.name for path in source.files] for source in found]
    assert names == [["s1_9.zip", "s1_10.zip"], ["s2_1.zip"], ["s10_1.zip"]]


def test_folders_are_ordered_by_each_of_their_numbers(tmp_path):
    names = ["shot2_v10", "shot3_v1", "shot10_v1"]
    for name in names:
        write(tmp_path / name, still(1))
    assert [source.name for source in find_sequences(tmp_path)[0]] == names


def test_frames_in_stores_are_apart_where_their_numbers_jump(tmp_path):
    frames_in_stores(tmp_path / "a", ["f0.zip", "f1.zip", "f3.zip"])
    found, aside = find_sequences(tmp_path)
    assert [(source.name, len(source.files)) for source in found] == [("a", 2), ("a-2", 1)]
    assert found[1].jump == "f3.zip: frame numbers jump after f1.zip (2 is missing): history starts anew"
    assert not aside


def test_frames_in_stores_are_apart_where_one_cannot_be_read(tmp_path):
    """Also where the numbers of the others go up by a constant step."""
    frames_in_stores(tmp_path / "a", [f"f{number}.zip" for number in range(1, 6)])
    for number in (2, 4):
        (tmp_path / "a" / f"f{number}.zip").write_bytes(b"PK")
    found, aside = find_sequences(tmp_path)
    assert [source.files[0].name for source in found] == ["f1.zip", "f3.zip", "f5.zip"]
    assert found[1].jump == "f3.zip: f2.zip, before it, cannot be read: history starts anew"
    assert [*aside] == ["a/f2", "a/f4"]


def test_a_reference_of_two_sequences_is_refused(tmp_path):
    for name in "ABR":
        write(tmp_path / name, still(1))
    reference = tmp_path / "R" / "frame_0000.exr"
    with pytest.raises(ValueError, match=f"^{reference}: reference of two sequences, A and B; give a folder that has"):
        prepare([tmp_path / "A", tmp_path / "B"], tmp_path / "out", references=tmp_path / "R")


def test_what_is_in_the_way_of_a_sequence_is_told(tmp_path):
    """Sequences of an earlier run that were in folders of a sequence's folder."""
    for name in ("a", "a/b"):
        write(tmp_path / "in" / name, still(2))
    prepare(tmp_path / "in", tmp_path / "out", jobs=1)
    shutil.rmtree(tmp_path / "in" / "a" / "b")
    write(tmp_path / "in" / "c", still(2))
    done = prepare(tmp_path / "in", tmp_path / "out", jobs=1, resume=True)
    assert done.sequences == ("c",)
    assert done.set_aside["a"] == (in_the_way(tmp_path / "out" / "a" / "b", "a"),)


def in_the_way(folder: Path, name: str) -> str:
    return f"{folder}: of an earlier run, and in the way of {name}: to be removed first"


def test_a_sequence_does_not_go_into_the_folder_of_an_earlier_one(tmp_path):
    inputs, out = tmp_path / "in", tmp_path / "out"
    write(inputs / "a", still(2))
    prepare(inputs, out, jobs=1)
    write(inputs / "a" / "b", still(2))
    done = prepare(inputs, out, jobs=1, resume=True)
    assert (done.sequences, [*done.set_aside]) == (("a-1",), ["a", "a/b"])
    assert done.set_aside["a/b"] == (in_the_way(out / "a", "a/b"),)
    assert not (out / "a" / "b").exists()
    shutil.rmtree(out / "a")
    done = prepare(inputs, out, jobs=1, resume=True)
    assert (done.sequences, done.set_aside) == (("a-1", "a/b"), {})


def test_a_sequence_in_the_folder_of_another_is_not_removed(tmp_path):
    inputs, out = tmp_path / "in", tmp_path / "out"
    write(inputs / "a", still(2))
    prepare(inputs, out, jobs=1)
    shutil.copytree(out / "a", tmp_path / "b")
    (tmp_path / "b").rename(out / "a" / "b")
    made = tree(out / "a")
    (inputs / "a" / "frame_0001.exr").unlink()
    done = prepare(inputs, out, jobs=1, resume=True)
    assert done.set_aside == {"a": (in_the_way(out / "a" / "b", "a"),)}
    assert tree(out / "a") == made


def test_files_of_no_run_in_the_place_of_a_sequence_stay(tmp_path):
    write(tmp_path / "in" / "a", still(1))
    write(tmp_path / "in" / "b", still(1))
    prepare(tmp_path / "in", tmp_path / "out", jobs=1)
    place = tmp_path / "out" / "a"
    (place / "manifest.json").unlink()
    made = tree(place)
    done = prepare(tmp_path / "in", tmp_path / "out", jobs=1, resume=True)
    assert done.set_aside == {"a": (f"{place}: has files that are of no run: remove it",)}
    assert tree(place) == made


def test_sequences_in_many_folders(tmp_path):
    """Of names that together are longer than one name may be."""
    name = "/".join(letter * 100 for letter in "abc")
    write(tmp_path / "in" / name, still(1))
    assert prepare(tmp_path / "in", tmp_path / "out", jobs=1).sequences == (name,)


def test_names_that_are_too_long_are_set_aside(tmp_path):
    """Such as that of a part, to which a number is added."""
    name = "a" * os.pathconf(tmp_path, "PC_NAME_MAX")
    write(tmp_path / "in" / name, still(3))
    (tmp_path / "in" / name / "frame_0001.exr").unlink()
    done = prepare(tmp_path / "in", tmp_path / "out", jobs=1)
    assert done.sequences == (name,)
    reason = os.strerror(errno.ENAMETOOLONG)
    assert done.set_aside == {f"{name}-2": (f"{tmp_path / 'out' / name}-2: {reason}",)}


def test_links_are_followed(tmp_path):
    write(tmp_path / "far" / "a", still(1))
    (tmp_path / "in").mkdir()
    # The last two lead back to folders that they lie in.
    (tmp_path / "in" / "one").symlink_to(tmp_path / "far")
    (tmp_path / "in" / "two").symlink_to(tmp_path / "far" / "a")
    (tmp_path / "far" / "back").symlink_to(tmp_path / "in")
    (tmp_path / "far" / "a" / "up").symlink_to(tmp_path / "far")
    found, aside = find_sequences(tmp_path / "in")
    assert ([source.name for source in found], aside) == (["one/a", "two"], {})


def test_a_set_behind_a_link_in_the_inputs_is_refused(tmp_path):
    """A later run would read it."""
    write(tmp_path / "far" / "shots" / "a", still(1))
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "all").symlink_to(tmp_path / "far")
    for place in ("far/set", "far/shots/set", "far/shots/a/set"):
        with pytest.raises(ValueError, match=r"set: lies in .*/in/all.*, which is read"):
            prepare(tmp_path / "in", tmp_path / place, buffers=["color"], jobs=1)
        assert not (tmp_path / place).exists()
    prepare(tmp_path / "in", tmp_path / "far2", buffers=["color"], jobs=1)


def test_two_eyes_in_a_folder_are_two_sequences(tmp_path):
    for i, frame in enumerate(shots(3)):
        for eye in "LR":
            (tmp_path / "in").mkdir(exist_ok=True)
            write_exr(tmp_path / "in" / f"{i:03}_{eye}.exr", frame)
    found, _ = find_sequences(tmp_path / "in")
    assert [[path.name for path in source.files] for source in found] == [
        [f"{i:03}_{eye}.exr" for i in range(3)] for eye in "LR"
    ]


def test_folders_that_cannot_be_read_are_set_aside(inputs, monkeypatch):
    scan, closed = os.scandir, inputs / "set"

    def scandir(path):
        if Path(path) == closed:
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
        return scan(path)

    # Nothing is closed to the superuser.
    monkeypatch.setattr(os, "scandir", scandir)
    found, aside = find_sequences(inputs)
    assert [source.name for source in found] == ["one"]
    assert aside == {"set": [f"{closed}: {os.strerror(errno.EACCES)}"]}


@pytest.mark.skipif(sys.platform != "linux", reason="file names are UTF-8")
def test_names_that_are_not_utf_8_are_set_aside(tmp_path):
    name = os.fsdecode(b"caf\xe9")
    for folder in ("café", name):
        write(tmp_path / folder, still(2))
    frames = tmp_path / "in"
    frames.mkdir()
    for folder in ("café", name):
        shutil.move(tmp_path / folder, frames)
    done = prepare(frames, tmp_path / "out", jobs=1)
    assert done.sequences == ("café",)
    assert done.set_aside == {name: (f"{frames / name / 'frame_0000.exr'}: expected a name in UTF-8",)}
    text = (tmp_path / "out" / "manifest.json").read_text("utf-8")
    assert "café" in text
    assert list(json.loads(text)["set_aside"]) == [name]


# Sets


@pytest.mark.parametrize("format", ["zarr", "exr"])
def test_a_sequence_above_others(tmp_path, format):
    """Its images lie beside those of the others, whatever they are called."""
    for name in ("a", "a/full", "a-1/b"):
        write(tmp_path / "in" / name, still(2))
    done = prepare(tmp_path / "in", tmp_path / "out", format=format, jobs=1)
    assert (done.sequences, done.frames) == (("a-1-1", "a/full", "a-1/b"), 6)
    assert prepare(tmp_path / "in", tmp_path / "out", format=format, jobs=1, resume=True) == done


def test_a_first_frame_without_motion(tmp_path):
    frames = still(3)
    bare = [replace(frame, motion=None) for frame in frames]
    for name, some in {"a": [bare[0], *frames[1:]], "b": frames, "c": [frames[0], bare[1], frames[2]]}.items():
        write(tmp_path / "in" / name, some)
    done = prepare(tmp_path / "in", tmp_path / "out", jobs=1)
    assert done.sequences == ("a", "b")
    lacking = tmp_path / "in" / "c" / "frame_0001.exr"
    unmoved = "no motion, and no camera with depth or position to compute it from"
    assert done.set_aside == {"c": (f"{lacking}: {unmoved}; earlier frames have it",)}
    made = [tree(tmp_path / "out" / name) for name in "ab"]
    assert "data.zarr/full/denoised/c.2.0.0.0" in made[0]
    about = [json.loads(files.pop("manifest.json")) for files in made]
    assert about[0].pop("input_bytes") != about[1].pop("input_bytes")
    assert about[0] == about[1]
    assert made[0] == made[1]


def test_a_single_frame_without_motion(tmp_path):
    """It is a first frame, here behind a gap; it has what the first of several has."""
    bare = replace(still(1)[0], motion=None)
    write(tmp_path / "in" / "a", [bare, *still(3)[1:]])
    write_exr(tmp_path / "in" / "a" / "frame_0009.exr", bare)
    with pytest.warns(UserWarning, match="frame numbers jump"):
        done = prepare(tmp_path / "in", tmp_path / "out", jobs=1)
    assert (done.sequences, done.frames, done.set_aside) == (("a", "a-2"), 4, {})
    assert {"motion", "history", "denoised"} <= {*done.buffers}
    first, single = (tree(tmp_path / "out" / name / "data.zarr") for name in done.sequences)
    chunks = [f"full/{name}/c.0.0.0.0" for name in done.buffers]  # absent where all is 0
    assert [single.get(name) for name in chunks] == [first.get(name) for name in chunks]


@pytest.mark.slow
def test_what_is_stored(inputs, tmp_path):
    """Zarr, EXR, crops, half size and float16 hold the same images."""
    named = {"sizes": ("full", "half"), "crop": (16, 12), "crops": 2, "jobs": 1}
    prepare(inputs, tmp_path / "zarr", **named)
    prepare(inputs, tmp_path / "exr", format="exr", **named)
    prepare(inputs, tmp_path / "float16", half=True, **named)
    frames = [read_exr(path) for path in sorted((inputs / "one").iterdir())]
    wanted = [name for name in CHANNELS if name not in ("emission", "object_normal", "replay", "reference")]
    wanted = [name for name in wanted if name not in ("hit_distance", "reactive")]
    crops = json.loads((tmp_path / "zarr" / "one" / "manifest.json").read_text())["crops"]
    assert list(crops) == ["crop0", "crop1"]
    assert crops["crop0"] != crops["crop1"]
    data, half = (zarr.open_group(tmp_path / one / "one" / "data.zarr", mode="r") for one in ("zarr", "float16"))
    for index, (images, _) in enumerate(derive(frames, wanted)):
        assert list(images) == wanted
        for crop, place in crops.items():
            x, y = place["x"], place["y"]
            assert x % 2 == y % 2 == 0
            cut = {name: image[y : y + 12, x : x + 16] for name, image in images.items()}
            for size, made in (("full", cut), ("half", halve(cut, cut["depth"], cut["validity"]))):
                exr = read_exr(tmp_path / "exr" / "one" / crop / size / f"frame_{index:04}.exr")
                for name, image in made.items():
                    stored = data[crop][size][name]
                    assert stored.shape[:2] == (3, CHANNELS[name])
                    assert stored.metadata.dimension_names == ("frame", "channel", "y", "x")
                    assert stored.chunks == (1, *stored.shape[1:])
                    planes = np.moveaxis(np.atleast_3d(image), -1, 0)
                    np.testing.assert_array_equal(stored[index], planes)
                    small = half[crop][size][name][index]
                    assert small.dtype == (np.uint32 if name == "ids" else small.dtype)
                    np.testing.assert_allclose(small, planes, rtol=1e-3, atol=1e-4)
                    if name in exr.buffers():
                        np.testing.assert_array_equal(getattr(exr, name), image)
    assert half["crop0/full/color"].dtype == np.float16
    assert half["crop0/full/depth"].dtype == np.float32
    layers = store.import_module("OpenEXR").File(str(tmp_path / "exr/one/crop0/full/frame_0002.exr")).channels()
    np.testing.assert_array_equal(layers["history"].pixels, np.moveaxis(data["crop0/full/history"][2], 0, -1))
    np.testing.assert_array_equal(layers["validity.Y"].pixels, data["crop0/full/validity"][2, 0])


def test_references(inputs, tmp_path):
    shutil.copytree(inputs, tmp_path / "clean")
    for path in (tmp_path / "clean").rglob("*.exr"):
        write_exr(path, np.full((HEIGHT, WIDTH, 3), 0.5, np.float32))
    named = {"buffers": ["reference", "color"], "references": tmp_path / "clean", "jobs": 1}
    prepare(inputs, tmp_path / "out", **named)
    data = zarr.open_group(tmp_path / "out" / "one" / "data.zarr", mode="r")["full"]
    assert set(data.array_keys()) == {"color", "reference"}
    assert (data["reference"][:] == 0.5).all()
    with pytest.raises(ValueError, match="got references True, now False"):
        prepare(inputs, tmp_path / "out", jobs=1, resume=True)
    clean = [tmp_path / "clean" / "one" / f"frame_{i:04}.exr" for i in range(3)]
    write_exr(clean[2], np.zeros((HEIGHT, WIDTH + 1, 3), np.float32))
    done = prepare(inputs, tmp_path / "other", **named)
    other = f"{WIDTH + 1} x {HEIGHT}, but {inputs / 'one' / 'frame_0000.exr'} is {WIDTH} x {HEIGHT}"
    assert done.set_aside == {"one": (f"{clean[2]}: {other}",)}
    clean[1].unlink()
    done = prepare(inputs, tmp_path / "again", **named)
    assert done.sequences == ("set/two",)
    assert done.set_aside["one"] == (f"{clean[1]}: no such reference",)


def test_missing_pixels_of_references_and_buffers(tmp_path):
    """They are told; nothing is NaN but what has a meaning as NaN. At half size, means are of the others."""
    frames = still(2)
    whole = {"albedo": 0.5, "normal": 1, "emission": 2, "object_normal": 1, "position": 3, "replay": 1}
    flat = {"depth": 4, "hit_distance": 5, "reactive": 0.25}
    buffers = {name: np.full((8, 10, 3), value, np.float32) for name, value in whole.items()}
    buffers |= {name: np.full((8, 10), value, np.float32) for name, value in flat.items()}
    for image in buffers.values():
        image[2, 3] = np.nan
    frames[1] = replace(frames[1], **buffers)
    frames[0] = replace(frames[0], **{name: np.nan_to_num(image) for name, image in buffers.items()})
    write(tmp_path / "in" / "a", frames)
    clean = [np.ones((8, 10, 3), np.float32) for _ in frames]
    clean[1][2, 3, 1], clean[1][4:6, 4:6] = np.inf, np.nan
    write(tmp_path / "clean" / "a", [yester.Frame(each) for each in clean])
    with pytest.warns(UserWarning, match="^a: ") as said:
        prepare(tmp_path / "in", tmp_path / "out", references=tmp_path / "clean", sizes=("full", "half"), jobs=1)
    known = json.loads((tmp_path / "out" / "a" / "manifest.json").read_text())
    assert (known["missing_pixels"], known["missing_reference_pixels"]) == ([0, 0], [0, 5])
    named = {text.partition(": ")[0] for text in known["warnings"]}
    assert named == {*whole, *flat, "reference"} - {"position", "replay"}
    assert [f"a: {text}" for text in known["warnings"]] == [str(one.message) for one in said]
    data = zarr.open_group(tmp_path / "out" / "a" / "data.zarr", mode="r")
    full, half = ({name: images[1] for name, images in data[size].arrays()} for size in ("full", "half"))
    assert {name for name, image in full.items() if np.isnan(image).any()} == {"position", "replay"}
    assert {name for name, image in full.items() if np.isinf(image).any()} == {"depth", "hit_distance"}
    for name in named - {"depth", "hit_distance"}:
        assert not full[name][:, 2, 3].any(), name
    assert all(np.isfinite(image).all() for image in half.values())
    assert (half["albedo"] == 0.5).all()
    assert (half["reference"][:, 1, 1] == 1).all()
    assert (half["reference"][:, 2, 2] == 0).all()


def test_the_manifest(inputs, tmp_path):
    done = prepare(inputs, tmp_path / "out", jobs=1)
    assert (done.sequences, done.frames) == (("one", "set/two"), 5)
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["complete"] is True
    assert manifest["versions"]["yester"] == yester.__version__
    assert manifest["parameters"]["format"] == "zarr"
    assert "reference" not in manifest["parameters"]["buffers"]
    for name, known in manifest["sequences"].items():
        folder = tmp_path / "out" / name
        assert known["manifest_sha256"] == hashlib.sha256((folder / "manifest.json").read_bytes()).hexdigest()
        own = json.loads((folder / "manifest.json").read_text())
        assert own["inputs"] == [f"frame_{i:04}.exr" for i in range(known["frames"])]
        files = {path: hashlib.sha256(data).hexdigest() for path, data in tree(folder).items()}
        del files["manifest.json"]
        assert own["sha256"] == files
    assert str(tmp_path) not in (tmp_path / "out" / "manifest.json").read_text()


@pytest.fixture
def upwards(tmp_path) -> Path:
    """A sequence with motion whose y axis points up."""
    turn = np.array([1, -1, 1], np.float32)
    write(tmp_path / "up" / "one", [replace(frame, motion=frame.motion * turn) for frame in shots(3)])
    return tmp_path / "up"


def test_wrong_motion_is_told(upwards, tmp_path):
    with pytest.warns(UserWarning, match="^one: motion: expected .* y up: multiply") as told:
        prepare(upwards, tmp_path / "out", jobs=1)
    known = json.loads((tmp_path / "out" / "one" / "manifest.json").read_text())
    assert [f"one: {text}" for text in known["warnings"]] == [str(one.message) for one in told]


def test_manifests_have_the_remarks_on_their_own_files(upwards, tmp_path, monkeypatch):
    """Catching warnings would catch those of all threads, at whatever time each of them reads."""
    write(upwards / "none", still(3))
    askew = [replace(frame, position=-frame.position) for frame in shots(3)]
    write(upwards / "two", [replace(frame, depth=None) for frame in askew])
    with monkeypatch.context() as patch:
        patch.setattr(warnings, "catch_warnings", None)
        with pytest.warns(UserWarning, match=": ") as said:
            prepare(upwards, tmp_path / "out", buffers=["color", "denoised"], jobs=1)
    found = {
        name: json.loads((tmp_path / "out" / name / "manifest.json").read_text())["warnings"]
        for name in ("none", "one", "two")
    }
    assert found["none"] == []
    assert found["two"] == ["worldToNDC: not used, as it puts positions elsewhere on the screen"]
    assert [text.split(" ")[0] for text in found["one"]] == ["motion:"]
    assert [str(one.message) for one in said] == [f"{name}: {text}" for name in found for text in found[name]]


def test_channels_are_mapped(inputs, upwards, tmp_path):
    mapping = {"motion": ["motion.X", "-motion.Y", "motion.Z"]}
    prepare(upwards, tmp_path / "out", mapping=mapping, jobs=1)
    prepare(inputs, tmp_path / "right", jobs=1)
    assert tree(tmp_path / "out" / "one" / "data.zarr") == tree(tmp_path / "right" / "one" / "data.zarr")
    with pytest.raises(ValueError, match=r"same parameters to resume, got mapping \{'motion'.* now None"):
        prepare(upwards, tmp_path / "out", resume=True)
    arguments = [str(upwards), "-o", str(tmp_path / "out"), "--resume", "--map", "motion=motion.X,-motion.Y,motion.Z"]
    assert cli.main(["prepare", *arguments]) == 0
    with pytest.raises(ValueError, match=f"^{upwards / 'one' / 'frame_0000.exr'}: mapping: motion: no channel"):
        prepare(upwards, tmp_path / "none", mapping={"motion": ["speed.X", "speed.Y"]})


@pytest.mark.slow
def test_processes_write_the_same_bytes(inputs, upwards, tmp_path):
    # Warnings are among them.
    (upwards / "one").rename(inputs / "upwards")
    for name, jobs in (("one", 1), ("two", 2)):
        with pytest.warns(UserWarning, match="^upwards: motion: expected"):
            prepare(inputs, tmp_path / name, jobs=jobs)
    assert tree(tmp_path / "one") == tree(tmp_path / "two")


# Bad input


@pytest.mark.slow
def test_damaged_files_are_set_aside(inputs, tmp_path):
    """Every damaged file is named; the other sequences go on."""
    shutil.copytree(inputs / "one", inputs / "three")
    for name, size in (("frame_0001.exr", -100), ("frame_0002.exr", 200)):
        path = inputs / "one" / name
        path.write_bytes(path.read_bytes()[:size])
    (inputs / "set" / "two" / "frame_0000.exr").write_bytes(b"no image")
    lines = told(inputs, "-o", tmp_path / "out", code=1)
    aside = [line for line in lines if line.startswith("set aside: ")]
    paths = inputs / "one" / "frame_0001.exr", inputs / "one" / "frame_0002.exr", inputs / "set/two/frame_0000.exr"
    for line, path in zip(aside, paths, strict=True):
        assert line.startswith(f"set aside: {path}: ")
    assert lines[-1] == "2 sequences were set aside: one, set/two; once repaired, --resume tries them again"
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert list(manifest["sequences"]) == ["three"]
    assert {name: len(messages) for name, messages in manifest["set_aside"].items()} == {"one": 2, "set/two": 1}
    assert manifest["complete"] is False
    # Repaired, they join the others, and the set is as if nothing had happened.
    for name in ("frame_0001.exr", "frame_0002.exr"):
        shutil.copy(inputs / "three" / name, inputs / "one" / name)
    write_exr(inputs / "set" / "two" / "frame_0000.exr", shots(1, seed=1)[0])
    done = prepare(inputs, tmp_path / "out", resume=True, jobs=1)
    assert done.sequences == ("one", "set/two", "three")
    prepare(inputs, tmp_path / "fresh", jobs=1)
    assert tree(tmp_path / "out") == tree(tmp_path / "fresh")


def test_what_sequences_lack_is_told(inputs, tmp_path):
    write(inputs / "bare", [yester.Frame(np.ones((HEIGHT, WIDTH, 3)))] * 2)
    write(inputs / "small", shots(2, 8, 6))
    frames = shots(2)
    write(inputs / "changing", [frames[0], replace(frames[1], albedo=None)])
    write(inputs / "growing", [frames[0], shots(2, 40, 24)[1]])
    done = prepare(inputs, tmp_path / "out", buffers=["demodulated", "history"], crop=(16, 12), jobs=1)
    assert done.sequences == ("one", "set/two")
    assert "no albedo, which demodulated is made of, but --buffers asks for it" in done.set_aside["bare"][0]
    assert "smaller than the crop, 16 x 12" in done.set_aside["small"][0]
    lacks = "frame_0001.exr: no albedo, which demodulated is made of; earlier frames have it"
    assert lacks in done.set_aside["changing"][0]
    grown = f"frame_0001.exr: 40 x 24, but {inputs / 'growing' / 'frame_0000.exr'} is 32 x 24"
    assert grown in done.set_aside["growing"][0]
    with pytest.raises(ValueError, match="no motion, and no camera"):
        prepare(inputs / "bare", tmp_path / "other", buffers=["history"], jobs=1)


def test_headers_are_read_before_any_work(tmp_path, monkeypatch):
    """Albedo that is there in some frames only stops the denoiser."""
    frames = [replace(frame, albedo=np.full((8, 10, 3), 0.5)) for frame in still(4)]
    bare = [replace(frame, albedo=None) for frame in frames]
    write(tmp_path / "in" / "gain", [bare[0], bare[1], frames[2], frames[3]])
    write(tmp_path / "in" / "lose", [*frames[:3], bare[3]])
    monkeypatch.setattr(Source, "read", lambda _: pytest.fail("no pixels should be read"))
    done = prepare(tmp_path / "in", tmp_path / "out", buffers=["color", "denoised"], jobs=1)
    gain = f"{tmp_path / 'in/gain/frame_0002.exr'}, {tmp_path / 'in/gain/frame_0003.exr'}: albedo, which earlier frames"
    lose = f"{tmp_path / 'in/lose/frame_0003.exr'}: no albedo; earlier frames have it"
    assert done.set_aside["gain"][0].startswith(gain)
    assert done.set_aside["lose"] == (lose,)


def test_files_that_cannot_be_opened_are_named(tmp_path):
    write(tmp_path / "in" / "a", still(1))
    # Nothing is closed to the superuser; a link that leads nowhere cannot be opened, either.
    closed = tmp_path / "in" / "b" / "frame_0000.exr"
    closed.parent.mkdir()
    closed.symlink_to(tmp_path / "nowhere")
    done = prepare(tmp_path / "in", tmp_path / "out", jobs=1)
    assert done.set_aside["b"] == (f"{closed}: {os.strerror(errno.ENOENT)}",)
    assert done.sequences == ("a",)


# Arguments and images


@pytest.mark.filterwarnings("default:b. left out")
def test_the_first_sequence_chooses_the_images(tmp_path, capsys):
    write(tmp_path / "in" / "a", [yester.Frame(np.ones((8, 10, 3)))] * 2)
    write(tmp_path / "in" / "b", still(2))
    said = r"^b: left out: motion: the images are those that a, the first sequence, allows; --buffers chooses$"
    with pytest.warns(UserWarning, match=said):
        done = prepare(tmp_path / "in", tmp_path / "out", jobs=1)
    assert (done.buffers, done.first) == (("color",), "a")
    assert cli.main(["prepare", str(tmp_path / "in"), "-o", str(tmp_path / "out"), "--resume"]) == 0
    said = capsys.readouterr()
    assert said.out.splitlines()[1] == "images: color (all that a, the first sequence, allows)"
    assert said.err.startswith("warning: b: left out: motion")
    done = prepare(tmp_path / "in", tmp_path / "given", buffers=["color"], jobs=1)
    assert (done.buffers, done.first) == (("color",), "")
    # The other way round, the sequence that has less is set aside.
    (tmp_path / "in" / "a").rename(tmp_path / "in" / "c")
    for named, words in (
        ({}, "b, the first sequence, has it; --buffers chooses"),
        ({"resume": True}, "b, the first sequence, has it; --buffers chooses"),
        ({"buffers": ["color", "motion"]}, "--buffers asks for it"),
        ({"resume": True}, "the set has it"),
    ):
        if not named.get("resume"):
            out = tmp_path / f"other{len(named)}"
        done = prepare(tmp_path / "in", out, jobs=1, **named)
        assert done.sequences == ("b",)
        assert done.set_aside["c"][0].startswith(f"{tmp_path / 'in' / 'c' / 'frame_0000.exr'}: no motion")
        assert done.set_aside["c"][0].endswith(f", but {words}")


def test_what_denoise_warns_of(tmp_path):
    """Motion of windows that move, and missing frames; the manifests have both."""
    folder = tmp_path / "in" / "a"
    folder.mkdir(parents=True)
    for i in (1, 2, 3, 5):
        corner = np.array([max(i, 2), 0], np.int32)
        header = {"dataWindow": (corner, corner + np.array([9, 7], np.int32))}
        header["displayWindow"] = (np.array([0, 0], np.int32), np.array([31, 23], np.int32))
        named = {"RGB": still(1)[0].color, "motion.XY": np.zeros((8, 10, 2), np.float32)}
        layouts.store(folder / f"{i}.exr", layouts.layers(named), header)
    with pytest.warns(UserWarning, match=r"^a(-2)?: ") as said:
        prepare(tmp_path / "in", tmp_path / "out", jobs=1)
    moved = "3.exr: the data window has moved since the frame before: motion must contain that shift"
    jump = "5.exr: frame numbers jump after 3.exr (4 is missing): history starts anew"
    assert [str(one.message) for one in said] == [f"a: {moved}", f"a-2: {jump}"]
    for name, message in (("a", moved), ("a-2", jump)):
        assert json.loads((tmp_path / "out" / name / "manifest.json").read_text())["warnings"] == [message]


def test_wrong_arguments_are_one_line(inputs, tmp_path, capsys):
    (tmp_path / "elsewhere").mkdir()
    for arguments, words in (
        (["--crop", "9999x10"], "none of 2 sequences can be prepared: one: 32 x 24, smaller than the crop"),
        (["--buffers", "reference"], "buffers: reference needs --references, "),
        (["--references", str(tmp_path / "elsewhere")], "none of 2 sequences can be prepared: "),
    ):
        assert cli.main(["prepare", str(inputs), "-o", str(tmp_path / "out"), *arguments]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith(f"yester: error: {words}")
    for i in range(3, 5):
        shutil.copy(inputs / "one" / "frame_0000.exr", inputs / "one" / f"frame_{i:04}.exr")
    _, aside = find_sequences(inputs, tmp_path / "elsewhere")
    first = ", ".join(str(tmp_path / "elsewhere" / "one" / f"frame_{i:04}.exr") for i in range(3))
    assert aside["one"] == [f"{first} and 2 more: no such reference"]
    assert not (tmp_path / "out").exists()


def test_resume_is_advised_where_it_helps(tmp_path, capsys):
    for name in "ab":
        write(tmp_path / "in" / name, still(1))
    prepare(tmp_path / "in", tmp_path / "out", jobs=1)
    again = ["prepare", str(tmp_path / "in"), "-o", str(tmp_path / "out"), "--resume"]
    shutil.rmtree(tmp_path / "in" / "b")
    assert cli.main(again) == 1
    assert capsys.readouterr().err.splitlines()[-1] == "1 sequences were set aside: b"
    write(tmp_path / "in" / "c", [])
    (tmp_path / "in" / "c" / "1.exr").touch()
    assert cli.main(again) == 1
    assert capsys.readouterr().err.endswith(" set aside: b, c; once repaired, --resume tries them again\n")


def test_outputs_that_are_refused(inputs, tmp_path):
    before = tree(inputs)
    for out in (inputs, inputs / "one", inputs / "new"):
        with pytest.raises(ValueError, match=f"^{out}: lies in {inputs}, which is read"):
            prepare(inputs, out)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine").write_text("mine")
    with pytest.raises(FileExistsError, match="exists already and is not empty"):
        prepare(inputs, tmp_path / "out")
    with pytest.raises(ValueError, match="nothing to resume"):
        prepare(inputs, tmp_path / "out", resume=True)
    assert tree(tmp_path / "out") == {"mine": b"mine"}
    assert tree(inputs) == before
    prepare(inputs, tmp_path / "done", jobs=1)
    with pytest.raises(FileExistsError):
        prepare(inputs, tmp_path / "done", jobs=1)
    made = tree(tmp_path / "done")
    with pytest.raises(ValueError, match="expected the same parameters to resume, got half False, now True"):
        prepare(inputs, tmp_path / "done", half=True, resume=True)
    assert prepare(inputs, tmp_path / "done", resume=True).frames == 5
    assert tree(tmp_path / "done") == made


@pytest.mark.parametrize(
    ("named", "words"),
    [
        ({"buffers": ["histroy"]}, "buffers: expected some of color, .*, got histroy"),
        ({"buffers": []}, "got none"),
        ({"sizes": ["quarter"]}, "sizes: expected full, half or both, got quarter"),
        ({"crop": (0, 4)}, "crop: expected at least 1 x 1, got 0 x 4"),
        ({"crop": (8,)}, "crop: expected width and height, got 1 numbers"),
        ({"crop": (8, 8, 99)}, "crop: expected width and height, got 3 numbers"),
        ({"crops": 0}, "crops: expected at least 1"),
        ({"crops": 3}, "crops: expected a size in crop beside it, got 3 alone"),
        ({"jobs": 0}, "jobs: expected at least 1"),
        ({"format": "tiff"}, "format: expected zarr or exr, got tiff"),
    ],
)
def test_wrong_parameters(inputs, tmp_path, named, words):
    with pytest.raises(ValueError, match=words):
        prepare(inputs, tmp_path / "out", **named)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "named", [{"crop": (8.9, 8.0)}, {"crop": (8, 8), "crops": 1.5}, {"seed": "1"}, {"jobs": 1.5}], ids=str
)
def test_numbers_that_are_no_integers(inputs, tmp_path, named):
    name, *_ = reversed(named)
    with pytest.raises(TypeError, match=f"^{name}: expected an integer, got (float|str)$"):
        prepare(inputs, tmp_path / "out", **named)
    assert not (tmp_path / "out").exists()


def test_integers_of_numpy(inputs, tmp_path):
    prepare(inputs, tmp_path / "a", crop=(16, 12), crops=2, seed=3, half=True, jobs=1)
    numbers = {"crop": np.array([16, 12]), "crops": np.int64(2), "seed": np.uint8(3), "jobs": np.int32(1)}
    prepare(inputs, tmp_path / "b", half=np.True_, **numbers)
    assert tree(tmp_path / "a") == tree(tmp_path / "b")


def test_what_has_16_bits():
    """Colours, normals and validity."""
    half = {name for name in CHANNELS if store.stored(name, half=True) == np.float16}
    assert half == {name for name, channels in CHANNELS.items() if channels == 3} - {"position"} | {"validity"}


def test_what_16_bits_do_not_hold_is_told(tmp_path):
    frames = still(2)
    frames[1].color[2, 3] = 2e5
    write(tmp_path / "in", frames)
    with pytest.warns(UserWarning, match="in: color: values beyond ±65504"):
        prepare(tmp_path / "in", tmp_path / "out", buffers=["color", "history"], half=True, jobs=1)
    warned = json.loads((tmp_path / "out" / "in" / "manifest.json").read_text())["warnings"]
    assert warned == ["color: values beyond ±65504 are stored as that, as 16 bits have no more"]


@pytest.mark.parametrize("format", ["zarr", "exr"])
def test_the_space_is_enough_for_small_images(tmp_path, format):
    """Every file takes a block of the file system at least."""
    write(tmp_path / "in", still(30, 4, 3))
    sources, _ = find_sequences(tmp_path / "in")
    prepare(tmp_path / "in", tmp_path / "out", sizes=("full", "half"), format=format, jobs=1)
    taken = sum(path.stat().st_blocks * 512 for path in (tmp_path / "out").rglob("*"))
    images = json.loads((tmp_path / "out" / "manifest.json").read_text())["parameters"]["buffers"]
    parameters = run.Parameters(tuple(images), ("full", "half"), None, 1, 0, False, format, False, None, None)
    assert taken < parameters.bytes(sources[0].look())


def test_space_is_looked_at_first(inputs, tmp_path, monkeypatch):
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(run.shutil, "disk_usage", lambda _: usage._replace(free=1000))
    with pytest.raises(OSError, match=r"up to 0\.00\d+ GB are needed and 1e-06 GB are free") as caught:
        prepare(inputs, tmp_path / "out", jobs=1)
    assert caught.value.errno == errno.ENOSPC
    assert not tree(tmp_path / "out")


def test_a_refused_run_settles_nothing(tmp_path):
    """What it was told, such as a crop that fits no sequence, binds no later run."""
    write(tmp_path / "in" / "a", still(2))
    write(tmp_path / "in" / "b", [yester.Frame(np.ones((8, 10, 3)))] * 2)
    first = tmp_path / "in" / "a" / "frame_0000.exr"
    whole, out = first.read_bytes(), tmp_path / "out"
    first.write_bytes(whole[:100])
    with pytest.raises(ValueError, match=f"^{first}: truncated or corrupt"):
        prepare(tmp_path / "in" / "a", out, jobs=1)
    with pytest.raises(ValueError, match=r"^none of 2 sequences can be prepared: "):
        prepare(tmp_path / "in", out, crop=(100, 100), jobs=1)
    with pytest.raises(FileNotFoundError, match=r"^nowhere: no such folder"):
        prepare(tmp_path / "in", out, references="nowhere", jobs=1)
    assert not out.exists()
    # The images are those of b, also when a is repaired.
    assert prepare(tmp_path / "in", out, jobs=1, resume=True).sequences == ("b",)
    first.write_bytes(whole)
    assert prepare(tmp_path / "in", out, jobs=1, resume=True).sequences == ("a", "b")
    assert json.loads((out / "manifest.json").read_text())["parameters"]["buffers"] == ["color"]


def test_folders_that_cannot_be_written(inputs, tmp_path):
    (tmp_path / "file").touch()
    out = tmp_path / "file" / "out"
    with pytest.raises(NotADirectoryError) as caught:
        prepare(inputs, out)
    assert (caught.value.filename, caught.value.strerror) == (
        str(out),
        f"cannot be written: {os.strerror(errno.ENOTDIR)}",
    )


def test_a_set_that_another_run_uses(tmp_path, monkeypatch):
    write(tmp_path / "in" / "a", still(2))
    inputs, out, tried = tmp_path / "in", tmp_path / "out", []

    class Tries(store.ZarrStore):
        def write(self, index, group, images):
            tried.extend(told(inputs, "-o", out, "--resume", code=2))
            super().write(index, group, images)

    monkeypatch.setitem(run._WRITERS, "zarr", Tries)
    prepare(inputs, out, jobs=1)
    used = f"another run, process {os.getpid()}, uses it; if it does not, remove .run.{os.getpid()}.tmp"
    assert tried == [f"yester: error: {out}: {used}"] * 2
    assert sorted(path.name for path in out.iterdir()) == ["a", "manifest.json"]


def test_a_set_that_another_run_of_this_process_uses(tmp_path, monkeypatch):
    write(tmp_path / "in" / "a", still(2))
    inputs, out, link, refused = tmp_path / "in", tmp_path / "out", tmp_path / "link", []
    link.symlink_to(out)

    class Tries(store.ZarrStore):
        def write(self, index, group, images):
            for folder in (out, link):
                with pytest.raises(OSError, match="another run of this process uses it") as caught:
                    prepare(inputs, folder, resume=True, jobs=1)
                refused.append(caught.value.filename)
            super().write(index, group, images)

    prepare(inputs, tmp_path / "alone", jobs=1)
    monkeypatch.setitem(run._WRITERS, "zarr", Tries)
    prepare(inputs, out, jobs=1)
    assert refused == [str(out), str(link)] * 2
    assert tree(out) == tree(tmp_path / "alone")
    assert prepare(inputs, out, resume=True, jobs=1).frames == 2


@pytest.mark.parametrize(
    ("resume", "error", "words"),
    [
        (False, FileExistsError, "exists already and is not empty"),
        (True, ValueError, "expected the same parameters to resume, got half False, now True"),
    ],
)
def test_a_set_that_another_run_has_made_meanwhile(tmp_path, monkeypatch, resume, error, words):
    inputs, out = tmp_path / "in", tmp_path / "out"
    write(inputs / "a", still(2))

    def found(*given):
        monkeypatch.undo()
        prepare(inputs, out, jobs=1)
        return find_sequences(*given)

    monkeypatch.setattr(run, "find_sequences", found)
    with pytest.raises(error, match=words):
        prepare(inputs, out, half=True, resume=resume, jobs=1)
    assert not json.loads((out / "manifest.json").read_text())["parameters"]["half"]


def test_only_what_prepare_made_is_removed(tmp_path):
    write(tmp_path / "in" / "a", still(1))
    prepare(tmp_path / "in", tmp_path / "out", jobs=1)
    made = tree(tmp_path / "out")
    over = subprocess.Popen([sys.executable, "-c", ""])
    over.wait()
    left = f".run.{over.pid}.tmp", f".a.{'0' * 32}.tmp", f".manifest.json.{over.pid}.tmp"
    mine = ".notes.tmp", ".work.tmp", ".run.tmp", ".run.mine.tmp"
    for name in (*left, *mine):
        (tmp_path / "out" / name).write_bytes(b"")
    prepare(tmp_path / "in", tmp_path / "out", jobs=1, resume=True)
    assert tree(tmp_path / "out") == made | dict.fromkeys(mine, b"")
    # A run that was killed at once leaves nothing to go on with, and is in nobody's way.
    (tmp_path / "killed").mkdir()
    (tmp_path / "killed" / left[0]).touch()
    prepare(tmp_path / "in", tmp_path / "killed", jobs=1)
    assert tree(tmp_path / "killed") == made


# Inputs and outputs that change


def test_sequences_whose_inputs_changed_are_prepared_again(tmp_path):
    frames = still(6)
    write(tmp_path / "in" / "a", frames)
    write(tmp_path / "in" / "b", frames[:2])
    later = [tmp_path / "in" / "a" / f"frame_{i:04}.exr" for i in (2, 3, 5)]
    for path in later:
        path.rename(tmp_path / path.name)
    with pytest.warns(UserWarning, match="^a-2: frame_0004.exr: frame numbers jump after frame_0001.exr"):
        done = prepare(tmp_path / "in", tmp_path / "out", jobs=1)
    assert (done.sequences, done.frames) == (("a", "a-2", "b"), 5)
    kept = (tmp_path / "out" / "b").stat().st_ino
    for path in later:
        (tmp_path / path.name).rename(path)
    done = prepare(tmp_path / "in", tmp_path / "out", jobs=1, resume=True)
    assert (done.sequences, done.frames) == (("a", "b"), 8)
    assert (tmp_path / "out" / "b").stat().st_ino == kept
    # Only the user knows whether its inputs are elsewhere.
    why = "of an earlier run, and no sequence of the inputs has its name: give its inputs, or remove it"
    assert done.set_aside == {"a-2": (f"{tmp_path / 'out' / 'a-2'}: {why}",)}
    shutil.rmtree(tmp_path / "out" / "a-2")
    assert not prepare(tmp_path / "in", tmp_path / "out", jobs=1, resume=True).set_aside
    prepare(tmp_path / "in", tmp_path / "fresh", jobs=1)
    assert tree(tmp_path / "out") == tree(tmp_path / "fresh")


def test_sequences_with_empty_files_are_prepared_again(tmp_path):
    """As a machine that loses power may leave them."""
    write(tmp_path / "in" / "a", still(2))
    prepare(tmp_path / "in", tmp_path / "out", jobs=1)
    made = tree(tmp_path / "out")
    for name in ("data.zarr/full/color/c.1.0.0.0", "manifest.json"):
        (tmp_path / "out" / "a" / name).write_bytes(b"")
        prepare(tmp_path / "in", tmp_path / "out", jobs=1, resume=True)
        assert tree(tmp_path / "out") == made
    (tmp_path / "out" / "manifest.json").write_bytes(b"")
    with pytest.raises(ValueError, match=f"^{tmp_path / 'out' / 'manifest.json'}: truncated or corrupt"):
        prepare(tmp_path / "in", tmp_path / "out", jobs=1, resume=True)


@pytest.mark.parametrize(
    "odd",
    [
        lambda known: [known],
        lambda known: {name: value for name, value in known.items() if name != "sha256"},
        lambda known: known | {"sha256": 3},
    ],
    ids=["a list", "without sha256", "sha256 is a number"],
)
def test_sequences_with_odd_manifests_are_prepared_again(tmp_path, odd):
    write(tmp_path / "in" / "a", still(1))
    prepare(tmp_path / "in", tmp_path / "out", jobs=1)
    made, path = tree(tmp_path / "out"), tmp_path / "out" / "a" / "manifest.json"
    path.write_text(json.dumps(odd(json.loads(path.read_text()))))
    prepare(tmp_path / "in", tmp_path / "out", jobs=1, resume=True)
    assert tree(tmp_path / "out") == made


def test_what_a_lost_process_wrote_is_removed(tmp_path):
    """And not what others write, whose sequences have similar names."""
    names = "shot/a", "shot+a", "shot.1", "shot"
    for name in names:
        (tmp_path / f".{run._key(name)}.{'0' * 32}.tmp").mkdir()
    for left, name in enumerate(names, 1):
        run._clear(tmp_path, name)
        assert len([*tmp_path.iterdir()]) == len(names) - left


@pytest.mark.parametrize("format", ["zarr", "exr"])
def test_a_full_disk(inputs, tmp_path, monkeypatch, format):
    """It ends the run in the second sequence; what is complete stays, and a later run goes on."""
    kind = run._WRITERS[format]

    class Full(kind):
        def write(self, index, group, images):
            if self._folder_name.startswith(f".{run._key('set/two')}.") and index == 1:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "the file")
            super().write(index, group, images)

        def __init__(self, folder, frames, half):
            self._folder_name = folder.name
            super().__init__(folder, frames, half)

    with monkeypatch.context() as patch:
        patch.setitem(run._WRITERS, format, Full)
        with pytest.raises(OSError, match=os.strerror(errno.ENOSPC)):
            prepare(inputs, tmp_path / "out", format=format, jobs=1)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["manifest.json", "one"]
    prepare(inputs, tmp_path / "out", format=format, jobs=1, resume=True)
    prepare(inputs, tmp_path / "fresh", format=format, jobs=1)
    assert tree(tmp_path / "out") == tree(tmp_path / "fresh")


def test_a_set_is_not_complete_before_the_run_ends(tmp_path, monkeypatch):
    """Its manifest has the sequences that are there."""
    inputs, out = tmp_path / "in", tmp_path / "out"
    for name in "ab":
        write(inputs / name, still(2))
    prepare(inputs, out, jobs=1)
    (inputs / "b" / "frame_0001.exr").unlink()

    class Full(store.ZarrStore):
        def write(self, index, group, images):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "the file")

    with monkeypatch.context() as patch:
        patch.setitem(run._WRITERS, "zarr", Full)
        with pytest.raises(OSError, match=os.strerror(errno.ENOSPC)):
            prepare(inputs, out, jobs=1, resume=True)
    manifest = json.loads((out / "manifest.json").read_text())
    assert (manifest["complete"], [*manifest["sequences"]]) == (False, ["a"])
    prepare(inputs, out, jobs=1, resume=True)
    prepare(inputs, tmp_path / "fresh", jobs=1)
    assert tree(out) == tree(tmp_path / "fresh")


# Interruptions


def test_it_goes_on_after_it_was_killed_while_it_removed_a_sequence(tmp_path, monkeypatch):
    inputs, out = tmp_path / "in", tmp_path / "out"
    write(inputs / "a", still(2))
    prepare(inputs, out, jobs=1)
    (inputs / "a" / "frame_0001.exr").unlink()

    def killed(folder, **_):
        for path in Path(folder).rglob("*.json"):
            path.unlink()
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(run.shutil, "rmtree", killed)
        with pytest.raises(KeyboardInterrupt):
            prepare(inputs, out, jobs=1, resume=True)
    assert prepare(inputs, out, jobs=1, resume=True).sequences == ("a",)
    prepare(inputs, tmp_path / "fresh", jobs=1)
    assert tree(out) == tree(tmp_path / "fresh")


@pytest.fixture(scope="module")
def long(tmp_path_factory) -> tuple[Path, dict[str, bytes]]:
    """Four sequences that take a while, and the set that they make."""
    folder = tmp_path_factory.mktemp("long")
    for number in range(4):
        write(folder / "in" / f"shot{number}", shots(6, 320, 240, seed=number))
    prepare(folder / "in", folder / "out", jobs=1)
    return folder / "in", tree(folder / "out")


def until(what, timeout: float = 60) -> None:
    end = time.monotonic() + timeout
    while not what():
        assert time.monotonic() < end
        time.sleep(0.01)


def under_way(folder: Path) -> bool:
    """One sequence at least is complete, and one is being written."""
    return any(folder.glob("shot*/manifest.json")) and any(folder.glob(".*.tmp/data.zarr/full/*/c.2*"))


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, pytest.param(2, marks=pytest.mark.long)])
def test_it_goes_on_after_kill_9(long, tmp_path, jobs):
    inputs, want = long
    out = tmp_path / "out"
    running = subprocess.Popen(command(inputs, "-o", out, "--jobs", jobs), stderr=subprocess.DEVNULL)
    until(lambda: under_way(out))
    children = psutil.Process(running.pid).children(recursive=True)
    running.send_signal(signal.SIGKILL)
    running.wait()
    # Its processes end with it.
    assert not psutil.wait_procs(children, timeout=20)[1]
    assert any(out.glob(".*.tmp"))
    complete = len([*out.glob("shot*/manifest.json")])
    assert 0 < complete < 4
    assert prepare(inputs, out, resume=True, jobs=1).frames == 24
    assert tree(out) == want


@pytest.mark.slow
def test_a_lost_process_is_replaced(long, tmp_path):
    inputs, want = long
    out = tmp_path / "out"
    running = subprocess.Popen(command(inputs, "-o", out, "--jobs", 2), stderr=subprocess.PIPE, text=True)
    until(lambda: under_way(out))
    workers = [p for p in psutil.Process(running.pid).children() if "spawn_main" in " ".join(p.cmdline())]
    assert len(workers) == 2
    workers[0].kill()
    said = running.communicate(timeout=180)[1]
    assert running.returncode == 0, said
    assert tree(out) == want


@pytest.mark.parametrize("format", ["zarr", "exr"])
def test_what_is_removed_while_it_is_written_is_not_whole(inputs, tmp_path, monkeypatch, format):
    """As by a later run, whose predecessor's workers go on: what they write after that lacks the first frames."""
    out = tmp_path / "out"
    prepare(inputs, tmp_path / "whole", format=format, jobs=1)
    writer = run._WRITERS[format]
    writes = writer.write

    def write_and_clear(self, index, *given):
        if index == 1:
            run._clear(out)
        writes(self, index, *given)

    with monkeypatch.context() as patched:
        patched.setattr(writer, "write", write_and_clear)
        with pytest.raises(OSError, match=r"was removed while it was written|No such file"):
            prepare(inputs, out, format=format, jobs=1)
    assert not (out / "one").exists()
    assert prepare(inputs, out, format=format, resume=True, jobs=1).frames == 5
    assert tree(out) == tree(tmp_path / "whole")


def test_files_of_another_size_are_prepared_again(inputs, tmp_path):
    """Here of one that is cut off, which is then found to be damaged."""
    out, frame = tmp_path / "out", inputs / "one" / "frame_0001.exr"
    assert prepare(inputs, out, jobs=1).sequences == ("one", "set/two")
    frame.write_bytes(frame.read_bytes()[:900])
    done = prepare(inputs, out, resume=True, jobs=1)
    assert done.sequences == ("set/two",)
    assert "frame_0001.exr" in done.set_aside["one"][0]


def test_the_manifests_name_is_taken(inputs, tmp_path):
    (inputs / "one").rename(inputs / "manifest.json")
    done = prepare(inputs, tmp_path / "out", jobs=1)
    assert done.sequences == ("set/two",)
    (said,) = done.set_aside["manifest.json"]
    assert said == f"{inputs / 'manifest.json'}: has the name of the set's manifest.json: to be renamed"


def test_an_error_in_a_process_ends_the_run(monkeypatch):
    """The threads that wait for a process get it all the same."""

    class Exhausted(ThreadPoolExecutor):
        """In place of a process: has no memory left."""

        def __init__(self, *_):
            super().__init__(1)

        def submit(self, work, *given):
            def fail():
                time.sleep(0.05)
                raise MemoryError("out of memory")

            return super().submit(fail)

    monkeypatch.setattr(run, "ProcessPoolExecutor", Exhausted)
    tasks = [SimpleNamespace(source=SimpleNamespace(name=f"{number}"), folder=None) for number in range(6)]
    raised = []

    def work():
        try:
            [*run._in_processes(tasks, 2, 2)]
        except MemoryError as error:
            raised.append(str(error))

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    thread.join(20)
    assert raised == ["out of memory"]


@pytest.fixture
def deadly(inputs, monkeypatch) -> Path:
    """Inputs of which one kills the process that works on it."""
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent), prepend=os.pathsep)
    write(inputs / "deadly", shots(2))

    def found(*given):
        sources, aside = find_sequences(*given)
        return [Deadly(**vars(each)) if each.name == "deadly" else each for each in sources], aside

    monkeypatch.setattr(run, "find_sequences", found)
    return inputs


def set_aside(deadly: Path, out: Path, **how) -> None:
    """Whatever it is, it must not keep the others from being prepared, nor go on for ever."""
    done = prepare(deadly, out, **how)
    assert done.sequences == ("one", "set/two")
    assert done.set_aside == {"deadly": ("deadly: the process that worked on it died 3 times",)}
    assert (deadly / "deadly" / "deaths").read_text() == 3 * "one more\n"
    assert not any(out.glob(".*"))


@pytest.mark.slow
def test_a_sequence_that_kills_its_process_is_set_aside(deadly, tmp_path):
    set_aside(deadly, tmp_path / "out", jobs=2)


class Deadly(Source):
    """A sequence whose second frame kills the process that reads it."""

    def read(self):
        frames = super().read()
        yield next(frames)
        with (self.files[0].parent / "deaths").open("a") as file:
            file.write("one more\n")
        os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.slow
def test_an_interrupt_leaves_nothing_half_written(long, tmp_path, ctrl_c):
    inputs, want = long
    out = tmp_path / "out"
    running = subprocess.Popen(command(inputs, "-o", out, "--jobs", 2), stderr=subprocess.PIPE, text=True)
    until(lambda: under_way(out))
    children = psutil.Process(running.pid).children()
    running.send_signal(signal.SIGINT)
    said = running.communicate(timeout=60)[1]
    assert running.returncode == 130, said
    assert said.splitlines()[-1] == "yester: interrupted"
    assert not psutil.wait_procs(children, timeout=20)[1]
    assert not any(out.glob(".*"))
    assert prepare(inputs, out, resume=True, jobs=1).frames == 24
    assert tree(out) == want


# Clusters


@pytest.fixture(params=["--no-nanny"])
def cluster(tmp_path, request):
    """A scheduler and two workers, each a process of its own without a guard; address and workers."""
    log = (tmp_path / "cluster.log").open("w")
    started = []

    def start(*arguments):
        program = [sys.executable, "-m", "dask", *map(str, arguments)]
        started.append(subprocess.Popen(program, stdout=log, stderr=log, cwd=tmp_path))
        return started[-1]

    file = tmp_path / "scheduler.json"
    start("scheduler", "--host", "127.0.0.1", "--port", 0, "--no-dashboard", "--scheduler-file", file)
    until(lambda: file.exists() and file.stat().st_size > 0)
    options = "--nthreads", 1, request.param, "--no-dashboard", "--host", "127.0.0.1", "--scheduler-file", file
    workers = [start("worker", *options) for _ in range(2)]
    try:
        yield json.loads(file.read_text())["address"], workers
    finally:
        for process in reversed(started):
            process.kill()
            process.wait()
        log.close()


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # of distributed, when workers vanish
def test_a_cluster_that_loses_a_worker(long, cluster, tmp_path):
    inputs, want = long
    address, workers = cluster
    out = tmp_path / "out"
    arguments = command(inputs, "-o", out, "--scheduler", address)
    arguments.remove("-W")
    arguments.remove("error")
    running = subprocess.Popen(arguments, stderr=subprocess.PIPE, text=True)
    until(lambda: under_way(out))
    workers[0].kill()
    said = running.communicate(timeout=180)[1]
    assert running.returncode == 0, said
    assert workers[1].poll() is None
    # What the lost worker had begun is removed by the next run.
    assert prepare(inputs, out, resume=True).frames == 24
    assert tree(out) == want


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("cluster", ["--nanny"], indirect=True)
def test_a_sequence_that_kills_workers_is_set_aside(deadly, cluster, tmp_path):
    """Their guards start new ones."""
    set_aside(deadly, tmp_path / "out", scheduler=cluster[0])


@pytest.mark.slow
def test_workers_in_another_folder_read_the_same_files(cluster, tmp_path, monkeypatch):
    """Relative paths are those of the process that calls `prepare`."""
    here = tmp_path / "here"
    for folder, value in ((tmp_path, 5), (here, 1)):
        for name in ("in", "clean"):
            write(folder / name / "a", [replace(frame, color=np.full_like(frame.color, value)) for frame in still(2)])
    monkeypatch.chdir(here)
    prepare("in", "out", buffers=["color", "reference"], references="clean", scheduler=cluster[0])
    data = zarr.open_group(here / "out" / "a" / "data.zarr", mode="r")["full"]
    assert [(data[name][:] == 1).all() for name in ("color", "reference")] == [True, True]


@pytest.mark.slow
def test_no_scheduler(inputs, tmp_path, monkeypatch):
    monkeypatch.setattr(run, "_PATIENCE", 1)
    with pytest.raises(OSError, match=r"tcp://127\.0\.0\.1:9: no Dask scheduler can be reached"):
        prepare(inputs, tmp_path / "out", scheduler="tcp://127.0.0.1:9")
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("address", "why"),
    [("localhost", "missing port number in address 'localhost'"), ("no://localhost:1", "unknown address scheme 'no'")],
)
def test_addresses_of_no_scheduler(tmp_path, address, why):
    """One line: a client that fails would block, and print a traceback."""
    write(tmp_path / "in", still(1))
    (line,) = told(tmp_path / "in", "-o", tmp_path / "out", "--scheduler", address, code=2)
    assert line.startswith(f"yester: error: {address}: no Dask scheduler can be reached: {why}")
    assert not (tmp_path / "out").exists()
