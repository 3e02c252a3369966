import csv
import re

import numpy as np
import pytest
from compare import assert_same_bits
from PIL import Image
from yester.study.compare.methods import PIPELINES, Method, Result
from yester.study.synthetic import failures, stress
from yester.study.synthetic.failures import FAILURES, SCENARIOS

pytestmark = pytest.mark.slow

NAMED = {scenario.name: scenario for scenario in SCENARIOS}
FRAMES = 8


def method(name, change, *, oracle=()):
    """A method that applies `change` to the frame's number and colour, or to the reference if `oracle` has one."""

    def run(frames):
        for number, frame in enumerate(frames):
            known = oracle[number] if number < len(oracle) else None
            yield Result(np.float32(change(number, frame.color if known is None else known)))

    return Method(name, name, run)


def truths(scenario, frames=FRAMES):
    return [shot.truth for shot in scenario.shots(frames=frames)]


def trial(name, change, frames=FRAMES):
    """The trial of a method that degrades the reference."""
    scenario = NAMED[name]
    _, result = stress.examine(scenario, [method("broken", change, oracle=truths(scenario, frames))], frames=frames)
    return result


def identity(number, image):
    return image


def test_every_failure_is_staged():
    assert {scenario.failure for scenario in SCENARIOS} == set(FAILURES)
    assert len(FAILURES) == 17
    assert len(NAMED) == len(SCENARIOS)


# Those without noise, which most others repeat with noise, every night.
@pytest.mark.parametrize(
    "scenario",
    [pytest.param(one, id=one.name, marks=() if "noisy" in one.name else pytest.mark.long) for one in SCENARIOS],
)
def test_scenario(scenario):
    """It is deterministic, measures frames from the event on, and the reference passes every check."""
    shots = list(scenario.shots(frames=2))
    assert [shot.truth is None for shot in shots] == [scenario.warm_up, False]
    last = shots[-1]
    assert last.frame.shape == (failures.HEIGHT, failures.WIDTH)
    assert np.isfinite(last.truth).all()
    assert np.isfinite(last.frame.color).all()
    if scenario.deviation > 0:
        assert last.truth.mean() == pytest.approx(last.frame.color.mean(), rel=0.06 if scenario.fireflies else 0.03)
    assert (last.former is None) == (scenario.former is None)
    assert (last.watch is None) == (scenario.watch is None)
    if last.watch is not None:
        assert 0 < last.watch.mean() < 1

    def run(frames):
        for shot, frame in zip(shots, frames, strict=True):
            for name, array in shot.frame.buffers().items():
                assert_same_bits(array, frame.buffers()[name])
            # The former image is the one before the event.
            true = last.former if shot.truth is None else shot.truth
            yield Result(frame.color if true is None else true)

    _, result = stress.examine(scenario, [Method("truth", "truth", run)], frames=2)
    assert (result.verdict, result.reason) == ("holds", "")
    assert ("early" in result.values) == (scenario.former == "event")
    for measure in ("ghost", "early", "lag", "flicker", "bias", "blur", "error", "lost"):
        assert result.values.get(measure, 0) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("name", ["object passes, noisy", "past a mirror, noisy", "wires sway, noisy", "view races"])
def test_there_is_something_to_see(name):
    """Continuous motion starts before the event, and each frame differs from the previous one."""
    shots = list(NAMED[name].shots(frames=4))
    assert [bool(np.abs(shot.frame.motion).max() > 0.1) for shot in shots] == [False, True, True, True]
    assert np.abs(shots[-1].truth - shots[-2].truth).max() > 0.05


def test_noise_depends_on_the_seed():
    one, other = (next(NAMED["cut, noisy"].shots(seed)).frame.color for seed in (0, 1))
    assert (one != other).any()


def test_uncovered():
    """The pixels that a box leaves, and no others."""
    scenario = NAMED["object passes"]
    before, now = scenario.stage(0), scenario.stage(1)
    mask = failures.uncovered(now, before)
    shot = list(scenario.shots(frames=8))[-1]
    assert 0.005 < mask.mean() < 0.05
    assert not failures.uncovered(now, now).any()
    # Three pixels wide, on the box's trailing side.
    columns = np.flatnonzero(mask.any(0))
    box = np.flatnonzero((shot.frame.ids == 3).any(0))
    assert np.ptp(columns) < 6
    assert columns.max() < box.max()


def test_pixels_that_enter_the_view_are_uncovered():
    scenario = NAMED["view races"]
    mask = failures.uncovered(scenario.stage(1), scenario.stage(0))
    assert mask[:, -5:].mean() > 0.9


def test_altered_frames():
    def last(name):
        return list(NAMED[name].shots(frames=4))[-1].frame

    assert last("ball spins").object_normal is not None
    assert last("ball spins, world normals").object_normal is None
    assert last("fine tiles, albedo unknown").albedo is None
    assert last("screen switches, emission unknown").emission is None
    bare = last("grazing floor, depth alone")
    assert bare.camera is None
    assert set(bare.buffers()) == {"color", "albedo", "depth", "motion", "ids", "emission"}
    still, shaken = last("jitter"), last("jitter in motion")
    assert np.abs(still.motion).max() < 1e-6
    assert np.ptp(shaken.motion, axis=(0, 1)).max() < 1e-5
    assert np.abs(shaken.motion).max() > 0.1


def test_jittered_motion_is_that_of_jittered_cameras():
    shots = [shot.frame for shot in NAMED["jitter in motion"].shots(frames=4)]
    cameras = [frame.camera.jittered(frame.jitter) for frame in shots]
    points = np.float64(shots[3].position)
    now, before = (camera.project(points)[0] for camera in (cameras[3], cameras[2]))
    np.testing.assert_allclose(shots[3].motion[..., :2], before - now, atol=1e-4)


def test_unannounced_cut():
    shots = list(NAMED["cut, unannounced"].shots(frames=4))
    told = list(NAMED["cut"].shots(frames=4))
    assert not shots[2].frame.motion.any()
    assert np.abs(told[2].frame.motion).max() > 5
    assert_same_bits(shots[3].frame.motion, told[3].frame.motion)


def test_samples_are_missing_before_the_event():
    shots = list(NAMED["samples missing"].shots(frames=8))
    missing = [(~np.isfinite(shot.frame.color)).any(-1).mean() for shot in shots]
    assert min(missing[:4]) > 0.02
    assert missing[4:] == [0] * 4
    [shown, _] = stress.examine(NAMED["samples missing"], [method("same", identity)], frames=8)
    assert shown.values["lost"] == 0


# Methods with one fault each, and the expected verdict.


def test_one_that_stands_still():
    """It shows the image from before the event for ever."""
    former = list(NAMED["light goes off"].shots(frames=20))[10].former
    result = trial("light goes off", lambda number, image: former, 20)
    assert result.verdict == "fails"
    assert result.values["ghost"] == pytest.approx(1)
    assert result.values["lag"] == 10
    assert result.reason.startswith("ghost 1, lag 10, bias")


def test_one_that_takes_three_frames():
    former = list(NAMED["wallpaper swapped"].shots(frames=16))[8].former
    result = trial("wallpaper swapped", lambda number, image: former if 8 <= number < 11 else image, 16)
    assert result.values["lag"] == 3
    assert result.values["flicker"] == 0


def test_one_that_is_four_frames_late():
    """The same lag as a trail of four frames."""
    scenario = NAMED["shadow travels, noisy"]
    shots = list(scenario.shots(frames=12))
    assert_same_bits(shots[11].former, shots[7].truth)
    late = method("late", identity, oracle=[shot.former for shot in shots])
    _, result = stress.examine(scenario, [late], frames=12)
    assert result.values["ghost"] == pytest.approx(1)
    assert "lag" not in result.values
    assert result.verdict == "fails"


@pytest.mark.long
def test_a_turn_is_no_ghost():
    """Where the lamp turns back, the image of four frames ago is nearly that of now, that of two frames ago is not."""
    every = truths(NAMED["light travels"], 32)
    known = [image for image in every if image is not None]
    late = [known[0]] * (len(every) - len(known) + 2) + known[:-2]
    _, result = stress.examine(NAMED["light travels"], [method("late", identity, oracle=late)], frames=32)
    assert 0.4 < result.values["ghost"] < 0.75


def test_one_that_averages_for_long():
    """The usual cause: a constant blend factor."""
    scenario = NAMED["light comes on"]
    memory = {}

    def average(number, image):
        memory["image"] = image if number == 0 else memory["image"] + 0.2 * (image - memory["image"])
        return memory["image"]

    _, result = stress.examine(scenario, [method("slow", average)], frames=16)
    assert result.values["ghost"] > 0.5
    assert 5 < result.values["lag"] <= 8


def test_one_that_is_early():
    """It shows the image after the event two frames before it."""
    scenario = NAMED["cut"]
    shots = list(scenario.shots(frames=12))
    after, before = shots[6].truth, shots[6].former
    early = method("early", identity, oracle=[*[before] * 4, *[after] * 8])
    _, result = stress.examine(scenario, [early], frames=12)
    assert result.values["early"] == pytest.approx(1)
    assert result.values["ghost"] == pytest.approx(0)
    assert (result.verdict, result.reason) == ("fails", "early 1")
    just = method("just", identity, oracle=[*[before] * 6, *[after] * 6])
    _, result = stress.examine(scenario, [just], frames=12)
    assert result.values["early"] == pytest.approx(0)


def test_pipelines_that_use_later_frames_are_judged_in_both_directions():
    """Only these can be early: before a light goes off they are slightly too dark."""
    svgf, both = (PIPELINES[0], *(one for one in PIPELINES if one.name == "SVGF, both sides"))
    _, alone, other = stress.examine(NAMED["light goes off"], [svgf, both])
    assert abs(alone.values["early"]) < 0.01 < other.values["early"]
    assert other.verdict == "holds"


def test_one_that_flickers():
    result = trial("wires stand", lambda number, image: image * (1.1 if number % 2 else 0.9))
    assert result.verdict == "fails"
    assert result.reason.startswith("flicker")
    assert abs(result.values["bias"]) < 0.01


def test_one_that_darkens():
    result = trial("fireflies", lambda number, image: 0.8 * image)
    assert result.verdict == "fails"
    assert result.values["bias"] == pytest.approx(-0.2, abs=1e-6)
    assert result.reason == "bias -0.2"


@pytest.mark.parametrize(("share", "verdict"), [(0.5, "degrades"), (1, "fails")])
def test_one_that_blurs(share, verdict):
    def blur(number, image):
        padded = np.pad(image, ((1, 1), (1, 1), (0, 0)), "edge")
        box = sum(padded[y : y + image.shape[0], x : x + image.shape[1]] for y in range(3) for x in range(3)) / 9
        return image + share * (box - image)

    result = trial("light goes off, noisy", blur)
    assert result.verdict == verdict
    assert result.reason.startswith("blur")


def test_one_that_loses_pixels():
    def hole(number, image):
        image = image.copy()
        image[3, 4, 1] = np.nan if number % 2 else np.inf
        return image

    result = trial("jitter", hole)
    assert result.values["lost"] == FRAMES // 2
    assert (result.verdict, result.reason.split(",")[0]) == ("fails", "lost 4")
    assert (result.worst[3, failures.WIDTH + 4] == (255, 0, 255)).all()


def test_one_that_does_nothing():
    same, result = stress.examine(NAMED["jitter"], [method("same", identity)], frames=FRAMES)
    assert same.method == "input"
    assert result.values == same.values
    assert result.values["error"] == 1
    assert result.verdict == "fails"


def test_one_that_is_a_frame_late():
    """It drops the last frame of a sequence, as some tools' files do."""
    scenario = NAMED["three frames"]
    first, second, _ = truths(scenario)
    _, result = stress.examine(scenario, [method("late", identity, oracle=[first, first, second])])
    assert result.verdict == "fails"
    assert "error" in result.reason


def broken(number, image):
    if number == 3:
        raise RuntimeError("out of paint")
    return image


def shortened(frames):
    yield from (Result(frame.color) for number, frame in enumerate(frames) if number != 5)


def read_ahead(frames):
    yield from [Result(frame.color) for frame in frames]


def test_one_that_loses_a_frame():
    _, ahead, short = stress.examine(
        NAMED["cut"], [Method("ahead", "ahead", read_ahead), Method("short", "short", shortened)], frames=FRAMES
    )
    assert ahead.values["lost"] == 0
    assert (short.verdict, short.reason) == ("fails", "ValueError: expected an image for each frame, got 1 fewer")


@pytest.mark.parametrize(
    ("change", "reason"),
    [(broken, "RuntimeError: out of paint"), (lambda number, image: image[1:], "expected an image of shape")],
)
def test_one_that_raises(change, reason):
    ok = method("same", identity)
    _, first, failed, last = stress.examine(NAMED["cut"], [ok, method("broken", change), ok], frames=FRAMES)
    assert failed.verdict == "fails"
    assert reason in failed.reason
    assert failed.values == {}
    assert first.values == last.values


def test_the_worst_frame_is_shown():
    scenario = NAMED["jitter"]
    result = trial("jitter", lambda number, image: image * (0.5 if number == 6 else 1))
    height, width = failures.HEIGHT, failures.WIDTH
    assert result.worst.shape == (height, 4 * width, 3)
    shot = list(scenario.shots(frames=FRAMES))[6]
    for column, image in enumerate((shot.frame.color, 0.5 * shot.truth, shot.truth)):
        encoded = stress.srgb(image) * 255
        shown = result.worst[:, column * width : (column + 1) * width]
        assert np.abs(shown - encoded).max() <= 0.5 + 1e-9


def test_limits():
    for limit in stress.LIMITS:
        assert limit.holds <= limit.degrades
        assert limit.judge(0) == "holds"
        assert limit.judge(limit.holds) == limit.judge(-limit.holds) == "holds"
        assert limit.judge(-limit.degrades * 1.01 - 1e-9) == "fails"
        assert limit.judge(limit.degrades) in ("holds", "degrades")
        assert limit.why.endswith(".")


@pytest.mark.parametrize("case", stress.STRAINS, ids=lambda case: case.name)
def test_strain(case):
    """The identity passes everything except that its only buffer goes missing."""
    [result] = stress.strain(case, [method("same", identity)])
    if case.name == "color of one frame all NaN":
        assert result.verdict == "fails"
        assert result.values["lost"] == 48 * 32
    else:
        assert result.verdict == "holds"
        assert result.values["lost"] == 0
    assert ("difference" in result.values) == (case.ordinary is not None)


def test_strain_of_a_method_that_depends_on_the_exposure():
    curve = method("tone", lambda number, image: image / (1 + image))
    results = {case.name: stress.strain(case, [curve])[0] for case in stress.STRAINS[:6]}
    assert results["radiance × 1e+06"].verdict == "fails"
    assert results["radiance × 1e-06"].values["difference"] > 0.3


def test_strain_of_one_that_spreads_to_the_first_frame():
    """A fault in the middle that neither end shows."""
    named = {case.name: case for case in stress.STRAINS}

    def mean(frames):
        every = [frame.color for frame in frames]
        known = np.nanmean(every, 0) if np.isfinite(every).all() else np.zeros_like(every[0])
        yield from (Result(known if number == 0 else color) for number, color in enumerate(every))

    [result] = stress.strain(named["color of one frame all NaN"], [Method("mean", "mean", mean)])
    assert result.values["difference"] == pytest.approx(1)


def test_strain_of_one_that_fails_on_ordinary_frames():
    """Bright ones are no problem."""
    case = next(case for case in stress.STRAINS if case.name == "radiance × 1000")

    def run(frames):
        for number, frame in enumerate(frames):
            if number == 1 and frame.color.max() < 1000:
                raise RuntimeError("too dark")
            yield Result(frame.color)

    assert min(frame.color.max() for frame in case.frames()) > 1000
    [result] = stress.strain(case, [Method("bright", "bright", run)])
    assert (result.verdict, result.reason) == ("fails", "RuntimeError: too dark")


def test_strained_frames():
    named = {case.name: case for case in stress.STRAINS}
    [usual, *_], [long, *_] = named["lengths × 250000"].ordinary(), named["lengths × 250000"].frames()
    assert long.depth.max() > 1e6
    pixels, depth = long.camera.project(np.float64(long.position))
    np.testing.assert_allclose(depth, long.depth, rtol=1e-5)
    np.testing.assert_allclose(pixels, usual.camera.project(np.float64(usual.position))[0], atol=1e-3)
    frames = named["depth of one frame all NaN"].frames()
    assert [bool(np.isnan(frame.depth).all()) for frame in frames].index(True) == 5
    assert sum(bool(np.isnan(frame.depth).any()) for frame in frames) == 1
    tiny = named["radiance × 1e-40"].frames()[0].color
    assert 0 < tiny[tiny > 0].min() < np.finfo(np.float32).tiny


def endured(change, frames=700, moving=False):
    return stress.endure(method("one", change), moving=moving, frames=frames, progress=False)


@pytest.mark.parametrize("moving", [False, True])
def test_endurance(moving):
    """The identity keeps energy, error and memory constant."""
    result = endured(identity, moving=moving)
    assert result.case == f"700 frames, {'moving' if moving else 'still'}"
    assert result.verdict == "holds" or result.reason.startswith("drift")
    assert abs(result.values["bias"]) < 0.01
    assert abs(result.values["drift"]) < 0.01
    assert result.values["lost"] == 0
    assert result.values["relmse"] > 0.1


def test_endurance_of_one_that_fades():
    result = endured(lambda number, image: image * (1 - 1e-4 * number))
    assert result.values["drift"] == pytest.approx(-0.07, abs=0.01)
    assert result.verdict == "fails"


def test_endurance_of_one_that_gets_worse():
    rng = np.random.default_rng(0)
    result = endured(lambda number, image: image + 1e-3 * number * rng.normal(size=image.shape))
    assert result.values["growth"] > 0.5
    assert result.verdict == "fails"


def test_endurance_of_one_that_leaks():
    kept = []

    def leak(number, image):
        kept.append(np.ones((100, 4000)))  # 3.2 MB: more than earlier tests may still release
        return image

    result = endured(leak, frames=200)
    assert result.values["memory"] > 100
    assert "memory" in result.reason
    assert result.verdict == "fails"


def test_endurance_of_one_that_raises():
    assert endured(broken).reason == "RuntimeError: out of paint"


@pytest.mark.long
def test_endurance_of_a_pipeline():
    [svgf, *_] = PIPELINES
    result = stress.endure(svgf, moving=True, frames=200, progress=False)
    assert result.values["lost"] == 0
    assert abs(result.values["bias"]) < 0.02


def test_too_short_to_endure():
    with pytest.raises(ValueError, match="frames: expected at least 100, got 99"):
        endured(identity, frames=99)


def test_run(tmp_path):
    names = ["light goes off, noisy", "three frames"]
    report = stress.run(tmp_path / "new", names, ["SVGF", "TAA textbook"], quick=True)
    assert report.folder == tmp_path / "new"
    assert [(t.case, t.method) for t in report.trials] == [
        (name, method) for name in names for method in ("input", "SVGF", "TAA textbook")
    ]
    written = sorted(path.relative_to(report.folder).as_posix() for path in report.folder.rglob("*.*"))
    slugs = [
        f"worst/{name}-{m}.png" for name in ("light-goes-off-noisy", "three-frames") for m in ("svgf", "taa-textbook")
    ]
    assert written == ["stress.csv", "stress.md", *slugs]
    with Image.open(report.folder / slugs[0]) as picture:
        assert picture.size == (3 * 4 * failures.WIDTH, 3 * failures.HEIGHT)

    with open(report.folder / "stress.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [(row["case"], row["method"], row["verdict"], row["reason"]) for row in rows] == [
        (t.case, t.method, t.verdict, t.reason) for t in report.trials
    ]
    assert {row["failure"] for row in rows} == {"moving light, light switched", "sequence ends"}
    for row, one in zip(rows, report.trials, strict=True):
        for measure, value in one.values.items():
            assert float(row[measure]) == pytest.approx(value, rel=1e-5)

    table = str(report)
    text = (report.folder / "stress.md").read_text(encoding="utf-8")
    assert table in text
    assert len({len(line) for line in table.strip().splitlines()}) == 1
    assert re.search(r"\| light goes off, noisy +\| 1\d\.\d dB +\| (holds|degrades|fails)", table)
    for words in (*FAILURES, *(limit.measure for limit in stress.LIMITS)):
        assert words in text

    again = stress.run(tmp_path / "again", names, ["SVGF", "TAA textbook"], quick=True)
    for name in ("stress.csv", "stress.md", *slugs):
        assert (again.folder / name).read_bytes() == (report.folder / name).read_bytes()


@pytest.mark.long
def test_run_of_all_parts(tmp_path, monkeypatch):
    monkeypatch.setattr(stress, "STRAINS", stress.STRAINS[:1])
    one = method("one", lambda number, image: image[: 0 if number == 2 else None])
    report = stress.run(tmp_path, ["cut"], frames=4, endurance=100, pipelines=[method("same", identity), one])
    assert list(report.parts) == ["failures", "strains", "endurance"]
    assert [t.verdict for t in report.trials if t.method == "one"] == ["fails"] * 4
    assert "fails: ValueError" in str(report)
    assert len(list(csv.reader((tmp_path / "stress.csv").read_text(encoding="utf-8").splitlines()))) == 10
    assert not (tmp_path / "worst" / "cut-one.png").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"scenarios": ["cuts"]}, "scenarios: expected some of .*'cut'.*, got 'cuts'"),
        ({"methods": ["SVGF", "NRD"]}, "methods: expected some of 'SVGF'.*, got 'NRD'"),
        ({"frames": 1}, "frames: expected at least 2, got 1"),
        ({"endurance": 50}, "endurance: expected 0 or at least 100, got 50"),
    ],
)
def test_bad_wishes(tmp_path, options, message):
    """Refused before any work."""
    with pytest.raises(ValueError, match=message):
        stress.run(tmp_path / "new", **options)
    assert not (tmp_path / "new").exists()


def test_the_former_name_of_a_method_serves_with_a_warning(tmp_path):
    with pytest.warns(DeprecationWarning, match="'TAA seed' is now 'TAA textbook'"):
        report = stress.run(tmp_path, ["three frames"], ["TAA seed"], quick=True)
    assert {trial.method for trial in report.trials} == {"input", "TAA textbook"}
