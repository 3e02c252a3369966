import os
import re
import signal
import subprocess
import sys
import time
from threading import Thread

import numpy as np
import OpenEXR
import pytest
import yester
from compare import assert_same_bits
from yester.io import read_exr, write_exr
from yester.io.mitsuba import render_sequence
from yester.study.rendered import scenes
from yester.study.rendered.recording import open_recording, record

pytestmark = pytest.mark.slow

TINY = {"frames": 3, "width": 24, "height": 18, "reference_spp": 4}


def files(folder):
    """All files, hidden ones too, with their bytes."""
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_record(tmp_path):
    """Frames as rendered, with references for the second half of them."""
    recording = record("cornell_box", tmp_path / "new" / "cache", **TINY, seed=5)
    assert recording.name == "cornell_box"
    assert recording.size == (24, 18)
    assert len(recording.frames) == 3
    assert list(recording.references) == [1, 2]
    sequence = scenes.cornell_box(3, 24, 18)
    wanted = render_sequence(sequence.scene, sequence.cameras, seed=5, transforms=sequence.transforms)
    for i, want in enumerate(wanted):
        frame = recording.frame(i)
        assert frame.buffers().keys() == want.buffers().keys()
        for name, array in want.buffers().items():
            assert_same_bits(frame.buffers()[name], array)
        assert frame.camera is not None
    exact = record("cornell_box", tmp_path, **{**TINY, "reference_spp": 512}, references=[0, 2])
    assert list(exact.references) == [0, 2]
    assert_same_bits(exact.reference(2), read_exr(exact.references[2]).color)
    errors = [np.abs(image - exact.reference(2)).mean() for image in (recording.frame(2).color, recording.reference(2))]
    assert errors[1] < 0.7 * errors[0]
    with pytest.raises(ValueError, match=r"index: expected a frame of cornell_box with a reference \(0, 2\), got 1"):
        exact.reference(1)


@pytest.mark.parametrize("name", ["spinning_shapes", "switched_light"])
def test_missing_files_come_back_as_they_were(tmp_path, name):
    """Any missing file is made again, and no other."""
    recording = record(name, tmp_path, **{**TINY, "frames": 5}, seed=3)
    whole = files(tmp_path)
    assert len(whole) == 5 + 3
    for gone in ([0], [4], [1, 3], [0, 1, 3, 4]):
        for i in gone:
            recording.frames[i].unlink()
        recording.references[3].unlink()
        kept = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.exr")}
        assert record(name, tmp_path, **{**TINY, "frames": 5}, seed=3) == recording
        assert files(tmp_path) == whole
        assert {path: path.stat().st_mtime_ns for path in kept} == kept


def test_every_file_has_its_own_noise(tmp_path):
    """Frames and references of all seeds; all seeds share the references."""
    recordings = [record("cornell_box", tmp_path, **{**TINY, "reference_spp": 1}, seed=seed) for seed in (0, 3)]
    assert recordings[0].references == recordings[1].references
    paths = {path for recording in recordings for path in (*recording.frames, *recording.references.values())}
    assert len(paths) == 6 + 2
    # In frames of one view, at least half of the pixels differ.
    for i in (1, 2):
        images = [recording.frame(i).color for recording in recordings] + [recordings[0].reference(i)]
        for a, b in ((0, 1), (0, 2), (1, 2)):
            assert (images[a] != images[b]).any(-1).mean() > 0.5


def test_other_recordings_are_other_files(tmp_path):
    """Each parameter that changes the images has its own place in the cache."""
    base = {**TINY, "frames": 1, "references": [0]}
    variants = [{}, {"width": 25}, {"height": 19}, {"frames": 2}, {"seed": 1}, {"reference_spp": 5}]
    recordings = [record("cornell_box", tmp_path, **{**base, **variant}) for variant in variants]
    frames = [recording.frames[0] for recording in recordings]
    references = [recording.references[0] for recording in recordings]
    assert len(set(frames)) == len(variants) - 1  # all but the references' samples
    assert len(set(references)) == len(variants) - 1  # all but the noise's seed
    assert record("cornell_box", tmp_path, **{**base, "references": []}).references == {}


def test_variants(tmp_path):
    """The same sequence with other noise in every frame, and the same references."""
    whole = record("cornell_box", tmp_path, **TINY, variants=2)
    assert [one.name for one in whole.variants] == ["cornell_box"] * 2
    assert all(one.references == whole.references and one.variants == () for one in whole.variants)
    frames = [one.frame(i) for one in (whole, *whole.variants) for i in range(len(whole.frames))]
    assert len({frame.color.tobytes() for frame in frames}) == len(frames)
    assert len({frame.camera.world_to_clip.tobytes() for frame in frames}) == len(whole.frames)
    with pytest.raises(ValueError, match="variants: expected at least 0, got -1"):
        record("cornell_box", tmp_path, **TINY, variants=-1)


@pytest.mark.usefixtures("ctrl_c")
def test_interrupted(tmp_path):
    """Ctrl-C after the first file leaves complete files; another call makes the rest, all with the same bits.

    Another thread sends the signal.
    """
    options = {**TINY, "frames": 24, "width": 48, "height": 36}
    want = tmp_path / "want"
    record("cornell_box", want, **options)
    got = tmp_path / "got"

    def interrupt():
        while not [*got.rglob("*.exr")]:
            time.sleep(1e-3)
        os.kill(os.getpid(), signal.SIGINT)

    thread = Thread(target=interrupt)
    with pytest.raises(KeyboardInterrupt):  # noqa: PT012
        thread.start()
        record("cornell_box", got, **options)
        thread.join()
    thread.join()
    whole, part = files(want), files(got)
    assert 0 < len(part) < len(whole) == 36
    assert part.items() <= whole.items()
    record("cornell_box", got, **options)
    assert files(got) == whole


def test_two_processes_at_once(tmp_path):
    record("cornell_box", tmp_path / "want", **TINY)
    call = f"record('cornell_box', {str(tmp_path / 'got')!r}, **{TINY})"
    code = f"from yester.study.rendered.recording import record; {call}"
    running = [subprocess.Popen([sys.executable, "-c", code]) for _ in range(2)]
    assert [process.wait(timeout=120) for process in running] == [0, 0]
    assert files(tmp_path / "got") == files(tmp_path / "want")


def test_cache(tmp_path, monkeypatch):
    """The argument, then YESTER_CACHE, then XDG_CACHE_HOME, then the home folder; empty counts as absent."""
    places = {"YESTER_CACHE": "a", "XDG_CACHE_HOME": "b/yester", "HOME": "c/.cache/yester"}
    for variable, place in places.items():
        monkeypatch.setenv(variable, str(tmp_path / place.partition("/")[0]))
    one = {**TINY, "frames": 1, "references": ()}
    assert record("cornell_box", tmp_path / "d", **one).frames[0].is_relative_to(tmp_path / "d")
    for variable, place in places.items():
        (frame,) = record("cornell_box", **one).frames
        assert frame.parents[2] == tmp_path / place
        assert frame.exists()
        monkeypatch.setenv(variable, "")


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({"name": "cornell"}, "name: expected one of cornell_box, .*, got 'cornell'"),
        ({"name": "Sequence"}, "name: expected one of"),
        ({"frames": 0}, "frames: expected at least 1, got 0"),
        ({"width": 0}, "width: expected at least 1, got 0"),
        ({"height": -1}, "height: expected at least 1, got -1"),
        ({"reference_spp": 0}, "reference_spp: expected at least 1, got 0"),
        ({"seed": -1}, "seed: expected 0 to 99997, got -1"),
        ({"seed": 99998}, "seed: expected 0 to 99997, got 99998"),
        ({"references": [0, 3]}, r"references: expected frames from 0 to 2, got \[0, 3\]"),
        ({"references": [-1]}, r"references: expected frames from 0 to 2, got \[-1\]"),
    ],
)
def test_bad_input(tmp_path, arguments, complaint):
    """Refused before anything is written."""
    with pytest.raises(ValueError, match=complaint):
        record(**{"name": "cornell_box", "cache": tmp_path, **TINY, **arguments})
    assert not [*tmp_path.iterdir()]
    with pytest.raises(TypeError, match="float"):
        record("cornell_box", tmp_path, **TINY, references=[0.5])


def test_cache_that_cannot_be(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OSError, match="file"):
        record("cornell_box", tmp_path / "file", **TINY)
    assert (tmp_path / "file").read_text() == "in the way"


def test_without_mitsuba(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "mitsuba", None)
    with pytest.raises(ImportError, match=r"pip install 'yester\[mitsuba\]'"):
        record("cornell_box", tmp_path, **TINY)


# A user's own files


def image(value, height=6, width=8, **buffers):
    return yester.Frame(np.full((height, width, 3), value, np.float32), **buffers)


def shot(folder, names, **options):
    """Files whose colour is their number."""
    folder.mkdir(exist_ok=True)
    for name in names:
        write_exr(folder / name, image(float("".join(filter(str.isdecimal, name))), **options))
    return folder


@pytest.fixture
def noisy(tmp_path):
    """Twelve frames whose names do not sort alphabetically into their order."""
    return shot(tmp_path / "noisy", [f"shot{i}.exr" for i in range(12)], albedo=np.ones((6, 8, 3)))


def numbers(recording):
    """By frame index: the number that its reference shows."""
    return {i: float(recording.reference(i).mean()) for i in recording.references}


def test_open(noisy, tmp_path):
    recording = open_recording(noisy)
    assert (recording.name, recording.size, recording.references) == ("noisy", (8, 6), {})
    assert [recording.frame(i).color.mean() for i in range(12)] == list(range(12))
    assert open_recording(str(noisy), name="mine").name == "mine"
    part = open_recording([noisy / "shot11.exr", noisy / "shot3.exr"])
    assert [path.name for path in part.frames] == ["shot11.exr", "shot3.exr"]
    with pytest.raises(ValueError, match=r"index: expected a frame of noisy with a reference \(none\), got 2"):
        recording.reference(2)


def test_references_by_name(noisy, tmp_path):
    """For any number of references and any order of the frames."""
    clean = shot(tmp_path / "clean", ["shot7.exr", "shot10.exr", "shot2.exr"])
    assert numbers(open_recording(noisy, clean)) == {2: 2, 7: 7, 10: 10}
    assert list(open_recording(noisy, clean).references) == [2, 7, 10]
    assert numbers(open_recording(sorted(noisy.iterdir()), clean)) == {2: 10, 4: 2, 9: 7}
    assert numbers(open_recording(noisy, clean / "shot7.exr")) == {7: 7}


def test_references_by_order(noisy, tmp_path):
    clean = shot(tmp_path / "clean", [f"truth_{100 + i}.EXR" for i in range(12)])
    assert numbers(open_recording(noisy, clean)) == {i: 100 + i for i in range(12)}
    # Two takes have the same names: files belong together by position.
    takes = [shot(tmp_path / name, ["a1.exr", "a2.exr"]) for name in ("take", "retake")]
    truths = [shot(tmp_path / f"true {take.name}", [path.name for path in takes[0].iterdir()]) for take in takes]
    for number, path in enumerate(path for folder in truths for path in sorted(folder.iterdir())):
        write_exr(path, image(number))
    assert numbers(open_recording(takes, truths)) == {0: 0, 1: 1, 2: 2, 3: 3}


def test_references_that_fit_nothing(noisy, tmp_path):
    eleven = shot(tmp_path / "eleven", [f"truth{i}.exr" for i in range(11)])
    with pytest.raises(ValueError, match="references: expected one for each of 12 frames, got 11"):
        open_recording(noisy, eleven)
    shifted = shot(tmp_path / "shifted", [f"shot{i}.exr" for i in range(1, 13)])
    takes = [shot(tmp_path / name, ["shot1.exr", "shot2.exr"]) for name in ("take", "retake")]
    with pytest.raises(ValueError, match=r"references: expected names of frames, or none of them, got .*shot3\.exr"):
        open_recording(takes, shifted)
    assert open_recording(takes).references == {}


def test_surplus_references(noisy, tmp_path):
    """References of other names are named and not used."""
    more = shot(tmp_path / "more", [f"shot{i}.exr" for i in range(10, 14)])
    with pytest.warns(UserWarning, match=r"shot12\.exr and 1 more: no frame of that name: not used as a reference"):
        assert numbers(open_recording(noisy, more)) == {10: 10, 11: 11}


@pytest.mark.parametrize("role", ["frames", "references"])
def test_bad_files(noisy, tmp_path, role):
    """The error names the bad file."""
    clean = shot(tmp_path / "clean", [path.name for path in noisy.iterdir()])
    bad = (noisy if role == "frames" else clean) / "shot3.exr"

    def opened(complaint):
        with pytest.raises(ValueError, match=f"^{re.escape(str(bad))}: {complaint}"):
            open_recording(noisy, clean)

    write_exr(bad, image(0, height=5))
    opened(r"8 x 5, but .*shot0\.exr is 8 x 6")
    write_exr(bad, image(0))
    whole = bad.read_bytes()
    if role == "frames":
        opened(r"no albedo, but .*shot0\.exr has albedo")
    else:
        open_recording(noisy, clean)
    bad.write_bytes(whole[:-20])
    opened("truncated or corrupt")
    bad.write_text("no picture")
    opened("not an EXR file")
    header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    OpenEXR.File(header, {"depth.Z": np.ones((6, 8), np.float32)}).write(str(bad))
    opened("no colour: expected channels R, G and B, got depth.Z")


def test_no_such_folder(noisy, tmp_path):
    with pytest.raises(FileNotFoundError, match="nowhere"):
        open_recording(tmp_path / "nowhere")
    with pytest.raises(FileNotFoundError, match="nowhere"):
        open_recording(noisy, tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    with pytest.raises(ValueError, match="empty: no EXR files found"):
        open_recording(tmp_path / "empty")


@pytest.mark.slow
def test_more_samples(tmp_path):
    """They have less noise, and are kept beside those of one."""
    shape = {"frames": 2, "width": 32, "height": 24, "references": (1,), "reference_spp": 256}
    few, many = (record("cornell_box", tmp_path, **shape, spp=spp) for spp in (1, 16))
    assert not {*few.frames} & {*many.frames}
    truth = few.reference(1)
    noise = [np.abs(each.frame(1).color - truth).mean() for each in (few, many)]
    assert noise[1] < 0.5 * noise[0]
    with pytest.raises(ValueError, match="spp: expected 1 for shallow_focus"):
        record("shallow_focus", tmp_path, **shape, spp=2)
    with pytest.raises(ValueError, match="spp: expected at least 1"):
        record("cornell_box", tmp_path, **shape, spp=0)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cornell_box", "passer_by"])
def test_halves(tmp_path, name):
    """Two recordings of independent noise, also with motion blur, that together have the samples of one frame each."""
    shape = {"frames": 3, "width": 32, "height": 24, "references": ()}
    one = record(name, tmp_path, **shape, halves=True, seed=5)
    (other,) = one.variants
    assert not {*one.frames} & {*other.frames}
    for i in range(3):
        first, second = one.frame(i), other.frame(i)
        assert first.camera == second.camera
        assert (first.color != second.color).mean() > 0.3
    # What is missing is rendered again, with the same bits.
    kept = one.frame(1).color, other.frame(1).color
    other.frames[1].unlink()
    again = record(name, tmp_path, **shape, halves=True, seed=5)
    np.testing.assert_array_equal(again.frame(1).color, kept[0])
    np.testing.assert_array_equal(again.variants[0].frame(1).color, kept[1])
