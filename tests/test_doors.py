from dataclasses import replace

import numpy as np
import pytest
import yester
from compare import assert_same_bits
from yester.io import read_exr
from yester.study.compare import doors, harm
from yester.study.compare.doors import DOORS, FULL, Worth, measure_doors, through
from yester.study.compare.methods import Method, Result
from yester.study.rendered.recording import record

pytestmark = pytest.mark.slow

BY_NAME = {door.name: door for door in DOORS}
#: By door: the buffers of a full frame that it removes.
ABSENT = {
    FULL: (),
    "no emission": ("emission",),
    "raw albedo": (),
    "raw albedo, no emission": ("emission",),
    "no albedo": ("albedo", "emission"),
    "2-channel motion": (),
    "no camera": ("camera",),
    "2-channel motion, no camera": ("camera",),
    "no motion": ("motion",),
    "no ids": ("ids",),
    "raw albedo, no ids": ("ids",),
    "no albedo, no ids": ("albedo", "emission", "ids"),
    "no normals": ("normal", "object_normal"),
    "misses have depth 0": (),
    "misses have depth 1e10": (),
    "no depth": ("depth", "position"),
    "depth alone": ("albedo", "emission", "normal", "object_normal", "ids", "position", "camera"),
    "motion alone": ("albedo", "emission", "normal", "object_normal", "ids", "position", "camera", "depth"),
}
#: By door: the buffers that it changes.
OTHER = {
    "raw albedo": {"albedo"},
    "raw albedo, no emission": {"albedo"},
    "raw albedo, no ids": {"albedo"},
    "2-channel motion": {"motion"},
    "2-channel motion, no camera": {"motion"},
    "misses have depth 0": {"depth", "position"},
    "misses have depth 1e10": {"depth", "position"},
}


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Gold, black plastic and moving normals."""
    cache = tmp_path_factory.mktemp("cache")
    return record("black_plastic", cache, frames=4, width=32, height=24, reference_spp=8, raw_albedo=True)


def seen(door, recording):
    """The frames that a method receives through a door."""
    frames = []

    def run(given):
        for frame in given:
            frames.append(frame)
            yield Result(frame.color)

    method = through(door, Method("seer", "seer", run), recording)
    assert len([*method.run(map(recording.frame, range(len(recording.frames))))]) == len(recording.frames)
    return frames


@pytest.mark.parametrize("door", DOORS, ids=lambda door: door.name)
def test_doors(door, recording):
    """The named buffers are absent or changed; all others have the same bits."""
    absent, other = ABSENT[door.name], OTHER.get(door.name, set())
    for i, frame in enumerate(seen(door, recording)):
        whole = recording.frame(i)
        assert (frame.camera is None) == ("camera" in absent)
        assert frame.buffers().keys() == whole.buffers().keys() - {*absent}
        for name, array in frame.buffers().items():
            if name not in other:
                assert_same_bits(array, whole.buffers()[name])
        if "motion" in other:
            assert_same_bits(frame.motion, whole.motion[..., :2])
        if "albedo" in other:
            assert_same_bits(frame.albedo, read_exr(recording.raw_albedo[i]).color)
            assert (frame.albedo != whole.albedo).any()


def test_doors_of_misses():
    """Infinite depth becomes a number, and positions become zeros."""
    depth, position = np.full((2, 3), np.inf, np.float32), np.full((2, 3, 3), np.nan, np.float32)
    depth[0], position[0] = 4, 1
    frame = yester.Frame(np.ones((2, 3, 3)), depth=depth, position=position)
    for name, miss in (("misses have depth 0", 0), ("misses have depth 1e10", 1e10)):
        coded = BY_NAME[name].take(frame, None)
        assert_same_bits(coded.depth, np.array([[4] * 3, [miss] * 3], np.float32))
        assert_same_bits(coded.position, np.array([[[1] * 3] * 3, [[0] * 3] * 3], np.float32))


def test_richer_doors_give_more():
    """Each door names existing doors whose frames lack less."""
    assert BY_NAME.keys() == ABSENT.keys()
    assert BY_NAME[FULL].richer == ()
    for door in DOORS[1:]:
        assert door.richer
        for richer in door.richer:
            assert {*ABSENT[richer]} <= {*ABSENT[door.name]}
            assert richer != door.name


def test_colour_alone_passes_all_doors():
    """Frames without anything to remove pass through every door."""
    frame = yester.Frame(np.ones((2, 3, 3)))
    for door in DOORS:
        passed = door.take(frame, None)
        assert list(passed.buffers()) == ["color"]


def test_measured(recording, tmp_path):
    """The pipelines are compared on the frames as they come; stored results are read again."""
    starts = []

    def run(frames):
        starts.append(1)
        state = yester.BMFR()
        return (Result(state.step(frame).color) for frame in frames)

    chosen = [BY_NAME[name] for name in ("no albedo", "raw albedo")]
    method = Method("BMFR", "BMFR", run)
    found = measure_doors([recording], [method], tmp_path, doors=chosen)
    assert [(each.door, each.richer) for each in found] == [
        ("no albedo", FULL),
        ("no albedo", "raw albedo"),
        ("raw albedo", FULL),
    ]
    states, errors = {name: yester.BMFR() for name in (FULL, "no albedo")}, {FULL: [], "no albedo": []}
    for i in range(4):
        for name, state in states.items():
            color = state.step(BY_NAME[name].take(recording.frame(i), None)).color
            if i in recording.references:
                reference = recording.reference(i)
                errors[name].append(((color - reference) ** 2 / (reference**2 + 0.01)).mean(dtype=np.float64))
    assert found[0].poor[0]["relmse"] == pytest.approx(np.mean(errors["no albedo"]), rel=1e-5)
    assert found[0].rich[0]["relmse"] == pytest.approx(np.mean(errors[FULL]), rel=1e-5)
    assert len(starts) == 3
    assert measure_doors([recording], [method], tmp_path, doors=chosen) == found
    assert len(starts) == 3
    rows = (tmp_path / "doors.csv").read_text().splitlines()
    assert rows[0] == "scene,method,door,run," + ",".join(harm.LIMITS)
    assert [row.split(",")[2] for row in rows[1:]] == [FULL, "no albedo", "raw albedo"]
    bare = measure_doors([replace(recording, raw_albedo={}, name="bare")], [method], tmp_path, doors=chosen)
    assert [(each.door, each.richer) for each in bare] == [("no albedo", FULL)]


def test_variants_have_their_own_raw_albedo(tmp_path):
    """Samples of another realisation are elsewhere in their pixels, and so is what they hit."""
    options = {"frames": 2, "width": 16, "height": 12, "references": (), "variants": 1, "raw_albedo": True}
    recorded, frames = record("black_plastic", tmp_path, **options), []

    def run(given):
        for frame in given:
            frames.append(frame)
            yield Result(frame.color)

    measure_doors([recorded], [Method("seer", "seer", run)], tmp_path / "out", doors=[BY_NAME["raw albedo"]])
    raw = [path for each in (recorded, *recorded.variants) for path in each.raw_albedo.values()]
    assert len({path.read_bytes() for path in raw}) == 4
    # Both doors take turns.
    for frame, path in zip(frames[1::2], raw, strict=True):
        assert_same_bits(frame.albedo, read_exr(path).color)


def test_losses_are_printed():
    """Losses against the full door, mean and worst; and cases in which more buffers make it worse."""
    full = ({"psnr": 30.0, "relmse": 0.01},)
    found = [
        Worth("grass", "SVGF", "no ids", FULL, ({"psnr": 29.0, "relmse": 0.02},), full),
        Worth("cut", "SVGF", "no ids", FULL, ({"psnr": 30.0, "relmse": 0.009},), full),
        Worth("cut", "SVGF", "no albedo", FULL, ({"psnr": 20.0, "relmse": 0.02},), full),
        Worth(
            "cut",
            "SVGF",
            "no albedo",
            "raw albedo",
            ({"psnr": 20.0, "relmse": 0.02},),
            ({"psnr": 19.0, "relmse": 0.01},),
        ),
        # These doors differ by more than one buffer.
        Worth("cut", "SVGF", "raw albedo, no emission", FULL, ({"psnr": 31.0, "relmse": 0.01},), full),
    ]
    _, ids, albedo, raw = doors.table(found).splitlines()
    assert " ".join(ids.split()) == "SVGF, no ids -0.50 dB ( 0) -1.00 dB grass -45.0 % ( 1) -100.0 % grass"
    assert albedo.startswith("SVGF, no albedo")
    assert " ".join(raw.split()) == "SVGF, raw albedo, no emission +1.00 dB ( 1) +0.0 % ( 0)"
    assert doors.harmful(found) == [
        "SVGF, cut: every buffer is worse than no ids: relmse -11.1 %",
        "SVGF, cut: raw albedo is worse than no albedo: psnr -1.00 dB",
    ]
    assert doors.harmful(found, {"psnr": 0.9, "relmse": 0.2}) == [
        "SVGF, cut: raw albedo is worse than no albedo: psnr -1.00 dB",
    ]
    assert doors.harmful(found, {"psnr": 1.1}) == []


def test_losses_within_the_noise_are_no_harm():
    """A richer door is worse only by more than two standard errors over the realisations of the noise."""
    poor = [{"psnr": 30.0}] * 3
    for spread, expected in (0.05, 1), (1.0, 0):
        rich = [{"psnr": 29.5 + change} for change in (-spread, 0.0, spread)]
        found = [Worth("cut", "SVGF", "no ids", FULL, tuple(poor), tuple(rich))]
        assert len(doors.harmful(found)) == expected
