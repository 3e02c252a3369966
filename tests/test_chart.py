import inspect
import time
import weakref
from dataclasses import replace
from itertools import islice, pairwise
from types import SimpleNamespace

import numpy as np
import pytest
import yester
from compare import assert_same_bits
from yester import metrics
from yester.io import read_exr, write_exr
from yester.sequence import LOOKAHEAD
from yester.study.compare import ablation, harm
from yester.study.compare import chart as module
from yester.study.compare.ablation import ABLATIONS, Effect, ablate
from yester.study.compare.chart import SIZE, _flow, _shared, _turn, chart, measure, orders, times
from yester.study.compare.doors import DOORS, FULL
from yester.study.compare.methods import METHODS, PIPELINES, QUARTERS, Method, Result, pipeline, quarter
from yester.study.compare.peers import peers
from yester.study.compare.points import ALL
from yester.study.compare.report import draw
from yester.study.rendered.recording import Recording, record
from yester.study.rendered.sequences import LATE, NAMES

pytestmark = pytest.mark.slow

QUICK = ("psnr", "relmse", "temporal_error", "warped_error")
LITTLE = (48, 32)
SVGF = PIPELINES[0]
BLACK = Method("black", "black", lambda frames: (Result(np.zeros_like(frame.color)) for frame in frames))


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Recording:
    return record("cornell_box", tmp_path_factory.mktemp("cache"), frames=6, width=32, height=24, reference_spp=16)


def counted(method):
    """The method with a counter of its starts."""
    starts = []

    def run(frames):
        starts.append(1)
        return method.run(frames)

    return replace(method, run=run), starts


def test_names_are_different():
    assert len({method.name for method in METHODS}) == len(METHODS)
    assert {*PIPELINES, *QUARTERS} < set(METHODS)
    assert [method.name for method in PIPELINES if method.default] == ["SVGF", "TAA best"]


def test_quarters():
    """Also of odd sizes: HalfRes gets one pixel of each 2×2; copies repeat its light under each pixel's own texture."""
    rng = np.random.default_rng(0)
    colors = rng.random((4, 5, 7, 3)).astype(np.float32)
    runs = [method.run(yester.Frame(color, albedo=color) for color in colors) for method in QUARTERS[:3]]
    pipelines = yester.HalfRes(), yester.SVGF(), yester.SVGF()
    for number, color in enumerate(colors):
        frame = yester.Frame(color, albedo=color)
        x, y = yester.HalfRes.offset(number)
        part = quarter(frame, number)
        seen = np.isfinite(part.color).all(-1)
        assert seen[y::2, x::2].all()
        assert seen.sum() == seen[y::2, x::2].size
        assert_same_bits(part.color[seen], color[seen])
        assert_same_bits(part.albedo, color)
        rows, columns = (np.minimum(np.arange(n) // 2 * 2 + d, n - 1) for n, d in ((5, y), (7, x)))
        copy = yester.Frame(color[rows][:, columns], albedo=color)
        for run, state, given in zip(runs, pipelines, (part, part, copy), strict=True):
            assert_same_bits(next(run).color, state.step(given).color)


@pytest.mark.parametrize("method", PIPELINES, ids=lambda method: method.name)
def test_methods_are_the_pipelines(method, recording):
    _, result = method.run([recording.frame(i) for i in range(2)])
    assert result.color.shape == (24, 32, 3)
    assert result.history_length.max() == 2
    assert result.confidence.max() == 1
    assert result.rejection.any()


BOTH = [method for method in (*METHODS, *peers()[0]) if method.name.endswith(", both sides")]


def test_methods_on_both_sides_are_there():
    names = {"SVGF", "BMFR", "TAA best", "HalfRes, a quarter traced", "temporal OIDN high"}
    assert {method.name for method in BOTH} == {f"{name}, both sides" for name in names}
    every = {method.name for method in (*METHODS, *peers()[0])}
    assert names < every
    assert {"SVGF, both sides", "BMFR, both sides", "TAA best, both sides"} < {method.name for method in PIPELINES}


@pytest.mark.parametrize("method", BOTH, ids=lambda method: method.name)
def test_methods_on_both_sides_are_denoise(method, recording):
    """They run `denoise` with the pipeline that their name begins with."""
    frames = [recording.frame(i) for i in range(6)]
    if "quarter" in method.name:
        frames = [quarter(frame, i) for i, frame in enumerate(frames)]
    pipelines = {
        "SVGF": yester.SVGF,
        "BMFR": yester.BMFR,
        "TAA": yester.TAA,
        "HalfRes": yester.HalfRes,
        "temporal": lambda: yester.OIDN(temporal=True),
    }
    make = next(make for name, make in pipelines.items() if method.name.startswith(name))
    results = method.run(recording.frame(i) for i in range(6))
    forwards = make()
    for number, (result, output) in enumerate(zip(results, yester.denoise(frames, make()), strict=True)):
        assert_same_bits(result.color, output.color)
        assert_same_bits(result.history_length, output.history_length)
        # There is no frame after the last one.
        assert number == 5 or not np.array_equal(result.color, forwards.step(frames[number]).color)


def test_values_of_a_method_that_reads_ahead(recording, tmp_path):
    """Run beside a method that does not read ahead: every result is measured against its own frame's reference."""
    ahead = Method("ahead", "ahead", lambda frames: iter([*SVGF.run(frames)]))
    _, svgf, other, both = measure(recording, [SVGF, ahead, BOTH[0]], tmp_path, metrics=QUICK, images=0)
    assert other.values == svgf.values
    outputs = [output.color for output in yester.denoise(recording.frame(i) for i in range(6))]
    want = np.mean([metrics.psnr(outputs[i], recording.reference(i)) for i in recording.references])
    assert both.values["psnr"] == pytest.approx(want)
    assert both.values["psnr"] > svgf.values["psnr"]


def test_a_method_that_loses_a_frame_is_refused(recording, tmp_path):
    short = Method("short", "short", lambda frames: islice(BLACK.run(frames), 5))
    with pytest.raises(ValueError, match="shorter"):
        measure(recording, [BLACK, short], tmp_path, metrics=QUICK)


def test_frames_are_read_once_and_held_no_longer_than_needed():
    class Item:
        pass

    alive = weakref.WeakSet()
    made = []

    def source():
        for number in range(12):
            item = Item()
            alive.add(item)
            made.append(number)
            yield item
            del item

    slow, fast, other = _shared(source(), 3)
    first = [next(fast) for _ in range(5)]
    assert len(made) == 5
    assert [next(slow) for _ in range(5)] == [next(other) for _ in range(5)] == first
    del first
    assert len(alive) <= 1
    assert len([*slow]) == len([*other]) == len([*fast]) == 7
    assert made == [*range(12)]


def test_values_are_those_of_the_metrics(recording, tmp_path):
    """Values are means of the pipeline's errors over the frames that have a reference."""
    noisy, svgf, _ = measure(recording, [SVGF, BLACK], tmp_path, metrics=QUICK, images=2)
    assert (noisy.method, noisy.ms, noisy.scene) == ("noisy input", 0, "cornell_box")
    assert svgf.default
    assert (svgf.ms, svgf.size) == (0, None)
    state, images = yester.SVGF(), []
    for i in range(6):
        images.append(state.step(recording.frame(i)).color)
    truth = {i: recording.reference(i) for i in (3, 4, 5)}
    for key in ("psnr", "relmse"):
        want = np.mean([getattr(metrics, key)(images[i], truth[i]) for i in truth])
        assert svgf.values[key] == pytest.approx(want)
    pairs = [(images[i], images[i - 1], truth[i], truth[i - 1]) for i in (4, 5)]
    want = np.mean([metrics.temporal_error(*pair) for pair in pairs])
    assert svgf.values["temporal_error"] == pytest.approx(want)
    assert list(svgf.values) == list(QUICK)
    assert noisy.values["psnr"] == pytest.approx(
        np.mean([metrics.psnr(recording.frame(i).color, truth[i]) for i in truth])
    )
    assert sorted(path.name for path in svgf.images.glob("color*")) == ["color_0004.webp", "color_0005.webp"]
    assert sorted(path.name for path in svgf.images.glob("history*")) == ["history_0004.webp", "history_0005.webp"]


def test_measurements_are_stored(recording, tmp_path):
    method, starts = counted(SVGF)
    first = measure(recording, [method], tmp_path, metrics=QUICK)
    assert measure(recording, [method], tmp_path, metrics=QUICK) == first
    assert len(starts) == 1
    measure(recording, [method], tmp_path, metrics=["psnr"])
    assert len(starts) == 2
    measure(recording, [replace(method, name="another")], tmp_path, metrics=["psnr"])
    assert len(starts) == 3


@pytest.mark.parametrize("given", ["table", "file"])
def test_measurements_with_another_mapping_are_not_reused(recording, tmp_path, given):
    method, starts = counted(BLACK)
    file = tmp_path / "mapping.toml"

    def mapped(scale):
        file.write_text(f"[color]\nscale = {scale}\n")
        mapping = {"color": {"scale": scale}} if given == "table" else file
        return replace(recording, reading={"mapping": mapping, "view": None})

    found = [measure(mapped(scale), [method], tmp_path, metrics=["psnr"], images=0)[0] for scale in (2, 4, 4)]
    assert len(starts) == 2
    assert found[0].values["psnr"] > found[1].values["psnr"]
    assert found[1] == found[2]


def test_an_interrupted_run_goes_on(recording, tmp_path):
    """Finished sequences are not run again; the others leave no partial files."""
    method, starts = counted(SVGF)
    shorter = replace(recording, name="shorter", frames=recording.frames[1:], references={})

    def run(frames):
        for number, result in enumerate(BLACK.run(frames)):
            if len(starts) == 2 and number == 2:
                raise KeyboardInterrupt
            yield result

    methods = [method, replace(BLACK, run=run)]
    with pytest.raises(KeyboardInterrupt):
        chart([recording, shorter], methods, tmp_path, metrics=QUICK, size=LITTLE)
    assert (tmp_path / "points" / "cornell_box" / "points.json").exists()
    assert not (tmp_path / "points" / "shorter" / "points.json").exists()
    assert not (tmp_path / "points.csv").exists()
    points = chart([recording, shorter], methods, tmp_path, metrics=QUICK, size=LITTLE)
    turns = len(orders(2))
    assert len(starts) == 3 + turns
    assert chart([recording, shorter], methods, tmp_path, metrics=QUICK, size=LITTLE) == points
    assert len(starts) == 3 + turns


def test_without_references(recording, tmp_path):
    """Only the warped error and the speed are measured."""
    bare = replace(recording, references={})
    noisy, svgf = measure(bare, [SVGF], tmp_path)
    assert set(noisy.values) == set(svgf.values) == {"warped_error"}
    assert 0 < svgf.values["warped_error"] < 0.5 * noisy.values["warped_error"]


def test_frames_of_colour_alone(recording, tmp_path):
    """Without motion, the warped error cannot be measured."""
    paths = []
    for i in range(3):
        paths.append(tmp_path / f"{i}.exr")
        write_exr(paths[-1], read_exr(recording.frames[i]).color)
    points = measure(Recording("bare", paths, {}), [SVGF], tmp_path)
    assert [point.values for point in points] == [{}, {}]


def test_all_is_written(recording, tmp_path):
    named = {"metrics": QUICK, "size": LITTLE, "about": "here"}
    points = chart([recording, replace(recording, name="second")], [SVGF, BLACK], tmp_path, **named)
    assert [point.scene for point in points] == ["cornell_box"] * 3 + ["second"] * 3 + [ALL] * 3
    names = {path.name for path in tmp_path.iterdir()}
    assert {"points.csv", "report.html", "psnr_all.png", "psnr_second.svg", "relmse_cornell_box.png"} < names
    assert "here" in (tmp_path / "report.html").read_text()
    assert not [name for name in names if name.endswith(".tmp")]


def test_methods_precede_each_other_in_turn():
    """Orders are the same in every run and all different, and no method always follows another."""
    for count in (4, 20, 60):
        found = orders(count)
        assert found == orders(count)
        assert all(sorted(order) == [*range(count)] for order in found)
        followers = [{*pairwise(order)} for order in found]
        assert not set.intersection(*followers)


def test_times(recording, tmp_path):
    """Frames of one size, whatever the sequence's size, after warm-up; measured once."""
    sizes, starts = [], []

    def run(frames):
        starts.append(1)
        for frame in frames:
            sizes.append((frame.width, frame.height))
            yield Result(np.zeros_like(frame.color))

    method = replace(BLACK, run=run)
    spent = times([method, SVGF], tmp_path, LITTLE)
    assert {name: len(each) for name, each in spent.items()} == {"black": 9, "SVGF": 9}
    assert all(ms > 0 for each in spent.values() for ms in each)
    assert sizes == [LITTLE] * 3 * (8 + 3)
    assert times([method, SVGF], tmp_path, LITTLE) == spent
    assert len(starts) == 3
    times([method, SVGF], tmp_path, (32, 48))
    assert len(starts) == 6
    assert SIZE[0] * SIZE[1] >= 1280 * 720


def test_times_of_results_in_bursts():
    """A method that reads five frames and yields five results at once: each result counts the mean time."""
    reads = []

    def run(frames):
        frames = iter(frames)
        while window := [*islice(frames, 5)]:
            reads.append(len(window))
            time.sleep(0.05)
            yield from (Result(frame.color) for frame in window)

    frames = [yester.Frame(np.ones((2, 2, 3), np.float32))]
    spent = _turn(Method("bursts", "bursts", run), frames)
    # Ten frames of warm-up, then five timed frames.
    assert reads[:3] == [5, 5, 5]
    assert sum(reads) == 15
    assert len(spent) == 5
    assert len(set(spent)) == 1
    assert 10 <= spent[0] < 30


def test_times_of_denoise_are_those_of_whole_chunks(recording):
    """Not of the results that are already finished with the first one."""
    frames = [recording.frame(i) for i in range(6)]
    spent = _turn(BOTH[0], frames)
    assert len(spent) == 5 * LOOKAHEAD
    assert len(set(spent)) == 1


def test_what_a_first_burst_reads_ahead_does_not_count(monkeypatch):
    """It works on two windows, as `denoise` does for its output stage, and each later burst on one."""
    worked = []
    monkeypatch.setattr(module, "PATIENCE", 0.5)
    monkeypatch.setattr(module, "time", SimpleNamespace(perf_counter=lambda: len(worked), sleep=lambda _: None))

    def run(frames):
        waiting = []
        while window := [*islice(frames, 4)]:
            worked.append("a second of work")
            waiting.append(window)
            if len(waiting) > 1:
                yield from (Result(frame.color) for frame in waiting.pop(0))

    spent = _turn(Method("ahead", "ahead", run), [yester.Frame(np.ones((2, 2, 3), np.float32))])
    assert spent == [250.0] * 4


def test_a_slow_method_gets_few_frames(monkeypatch):
    """As few as possible: one burst of warm-up and one timed burst."""
    monkeypatch.setattr(module, "PATIENCE", 0.01)
    for burst in (1, 4, 12):

        def run(frames, burst=burst, reads=(reads := [])):
            frames = iter(frames)
            while window := [*islice(frames, burst)]:
                reads.append(len(window))
                time.sleep(0.02)
                yield from (Result(frame.color) for frame in window)

        spent = _turn(Method("slow", "slow", run), [yester.Frame(np.ones((2, 2, 3), np.float32))])
        assert len(spent) == burst
        assert reads == [burst] * 2


def test_a_method_with_long_turns_has_one(monkeypatch, tmp_path):
    monkeypatch.setattr(module, "_LONG", 0.5)
    starts = []

    def run(frames):
        starts.append(1)
        time.sleep(0.6)
        yield from BLACK.run(frames)

    spent = times([Method("long", "long", run), BLACK], tmp_path, LITTLE)
    assert len(starts) == 1
    assert {name: len(each) for name, each in spent.items()} == {"long": 3, "black": 9}


def test_the_time_axis_names_the_size(recording, tmp_path):
    noisy, svgf = chart([recording], [SVGF], tmp_path, metrics=["psnr"], images=0, size=LITTLE)
    assert (noisy.ms, noisy.size) == (0, None)
    assert svgf.size == LITTLE
    assert 0 < svgf.ms_range[0] <= svgf.ms <= svgf.ms_range[1]
    (axes,) = draw([noisy, svgf], metrics.METRICS["psnr"]).axes
    assert axes.get_xlabel() == "time of a frame of 48×32 [ms]"
    rows = (tmp_path / "points.csv").read_text().splitlines()
    assert [row.split(",")[-1] for row in rows] == ["timed", "", "48x32"]
    assert r"time of a frame of 48\u00d732" in (tmp_path / "report.html").read_text()


def test_bad_input_does_nothing(recording, tmp_path):
    folder = tmp_path / "out"
    with pytest.raises(ValueError, match="recordings: expected different names, got cornell_box more than once"):
        chart([recording, recording], [SVGF], folder)
    with pytest.raises(ValueError, match="methods: expected different names, got SVGF more than once"):
        chart([recording], [SVGF, SVGF], folder)
    with pytest.raises(ValueError, match="metric: expected one of psnr"):
        chart([recording], [SVGF], folder, metrics=["nonsense"])
    assert not folder.exists()


def test_a_method_that_breaks_is_named(recording, tmp_path):
    bad = Method("broken", "broken", lambda frames: (Result(np.full_like(frame.color, np.nan)) for frame in frames))
    with pytest.raises(ValueError, match=r"^broken: 2304 of 2304 values are not finite"):
        measure(recording, [bad], tmp_path, metrics=QUICK)


# Ablation


@pytest.mark.parametrize("each", ABLATIONS, ids=lambda each: each.method.name)
def test_each_component_does_something(each, recording):
    """At the latest when the light changes, most pixels become surfaces of their own, or nothing guides, each changes
    the output."""
    frames = [recording.frame(i) for i in range(6)]
    last = frames[-1]
    bright = last.buffers() | {"color": 4 * last.color}
    frames += [yester.Frame(**bright, camera=last.camera, jitter=last.jitter)] * 2
    rng = np.random.default_rng(0)
    own = np.where(rng.random(last.shape) < 0.7, rng.permutation(last.ids.size).reshape(last.shape) + 1000, last.ids)
    frames.append(replace(frames[-1], ids=own.astype(np.uint32)))
    bare = [yester.Frame(frame.color, motion=frame.motion) for frame in frames]

    def changes(frames):
        both = zip(each.whole.run(frames), each.method.run(frames), strict=True)
        return not all(np.array_equal(one.color, other.color) for one, other in both)

    assert changes(frames) or changes(bare)


def test_the_stage_of_the_ablation_is_svgfs(recording):
    """Run separately, as in the ablation, they give the pipeline's bits; one before samples tell anything."""
    frames = [recording.frame(i) for i in range(3)]
    corrected = ablation._antialiased(**ablation._CORRECTED)
    for run, some in ((ablation._antialiased(), frames[:2]), (corrected, frames)):
        for one, other in zip(pipeline(yester.SVGF)(some), run(some), strict=True):
            assert_same_bits(one.color, other.color)


def test_switches_follow_the_default():
    """Default components are removed, optional ones are added."""
    defaults = inspect.signature(yester.SVGF).parameters
    names = {"fireflies": "fireflies", "gradient": "gradient", "antialias": "antialiasing", "feedback": "feedback"}
    for keyword, component in names.items():
        (each,) = (e for e in ABLATIONS if (e.whole.name, e.component) == ("SVGF", component))
        assert each.added == (not defaults[keyword].default)
        assert each.method.name == f"SVGF {'+' if each.added else '-'} {component}"


def test_effects(recording, tmp_path):
    """A gain is that of having the component, whether it is on by default or not."""
    known = {each.component: each for each in ABLATIONS if each.whole.name == "SVGF"}
    some = (known["antialiasing"], known["pass 4"])
    recordings = [recording, replace(recording, name="second")]
    effects = ablate(recordings, tmp_path, metrics=["psnr", "relmse"], ablations=some, size=LITTLE)
    assert [(e.scene, e.component) for e in effects] == [
        (scene, component) for scene in ("cornell_box", "second", ALL) for component in ("antialiasing", "pass 4")
    ]
    methods = [known["antialiasing"].whole, *(each.method for each in some)]
    _, whole, without, more = measure(recording, methods, tmp_path, metrics=["psnr", "relmse"], images=0)
    first, second = effects[:2]
    assert first.gains["psnr"] == pytest.approx(whole.values["psnr"] - without.values["psnr"])
    assert first.gains["relmse"] == pytest.approx(1 - whole.values["relmse"] / without.values["relmse"])
    assert second.gains["psnr"] == pytest.approx(more.values["psnr"] - whole.values["psnr"])
    assert effects[-2].gains["psnr"] == pytest.approx(first.gains["psnr"])
    lines = ablation.table(effects).splitlines()
    assert lines[1].startswith("SVGF - antialiasing")
    assert lines[2].startswith("SVGF + pass 4")
    assert f"{first.gains['psnr']:+.2f} dB ( 2) {first.gains['psnr']:+.2f} dB cornell_box" in lines[1]
    assert len((tmp_path / "ablation.csv").read_text().splitlines()) == 7


def test_variants_are_averaged(recording, tmp_path):
    """Values and gains are means over the variants, with the standard error of the mean."""
    known = {each.component: each for each in ABLATIONS if each.whole.name == "SVGF"}
    part = replace(
        recording, frames=recording.frames[1:], references={i - 1: p for i, p in recording.references.items()}
    )
    methods = [known["clip"].base, known["clip"].method]
    alone = [
        measure(one, methods, tmp_path / str(i), metrics=["psnr"], images=0) for i, one in enumerate((recording, part))
    ]
    both = replace(recording, variants=(part,))
    points = measure(both, methods, tmp_path / "both", metrics=["psnr"], images=0)
    for point, one, other in zip(points, *alone, strict=True):
        assert point.runs == (one.values, other.values)
        assert point.values["psnr"] == pytest.approx((one.values["psnr"] + other.values["psnr"]) / 2)
    (effect,) = ablate([both], tmp_path, metrics=["psnr"], ablations=[known["clip"]], size=LITTLE)
    gains = [whole.values["psnr"] - without.values["psnr"] for _, whole, without in alone]
    assert effect.gains["psnr"] == pytest.approx(sum(gains) / 2)
    assert effect.errors["psnr"] == pytest.approx(abs(gains[0] - gains[1]) / 2)


@pytest.mark.parametrize("channels", [0, 2, 3])
@pytest.mark.parametrize("names", [(), ("depth",), ("position",), ("depth", "normal"), ("normal", "ids")])
@pytest.mark.parametrize("cameras", [False, True])
def test_flow_of_any_buffers(channels, names, cameras):
    """With or without cameras, for any given motion and surfaces, all visible surfaces are followed."""
    height, width = 12, 16
    shared = {
        "depth": np.full((height, width), 2.0),
        "normal": np.full((height, width, 3), (0.0, 0.0, -1.0)),
        "ids": np.ones((height, width), int),
    }
    frames = []
    for i in range(2):
        camera = yester.Camera.from_look_at((0.01 * i, 0, 0), (0.01 * i, 0, 1), (0, 1, 0), 60, width, height)
        y, x = np.mgrid[:height, :width] + 0.5
        given = shared | {"position": camera.unproject(np.stack([x, y], -1), shared["depth"])}
        buffers = {name: given[name] for name in names}
        if channels:
            buffers["motion"] = np.zeros((height, width, channels))
        frames.append(yester.Frame(np.ones((height, width, 3)), **buffers, camera=camera if cameras else None))
    found = _flow(*frames)
    if channels or (cameras and {"depth", "position"} & set(names)):
        motion, valid = found
        assert motion.shape[:2] == valid.shape == (height, width)
        assert valid[:, 2:-2].all()
    else:
        assert found is None


def test_effects_through_doors(recording, tmp_path):
    """The same pipelines on the frames of each door; no options that are off by default or need all buffers."""
    known = {each.component: each for each in ABLATIONS if each.whole.name == "SVGF"}
    needy = [each for each in ABLATIONS if each.whole.name == "Recirculation"]
    some = (known["antialiasing"], known["pass 4"], *needy)
    chosen = [door for door in DOORS if door.name in (FULL, "raw albedo", "no normals")]
    effects = ablate([recording], tmp_path, metrics=["psnr"], doors=chosen, ablations=some, size=LITTLE)
    assert [(e.door, e.component) for e in effects] == [
        (FULL, "antialiasing"),
        (FULL, "pass 4"),
        (FULL, "innovation"),
        ("no normals", "antialiasing"),
    ]
    states = yester.SVGF(), yester.SVGF(antialias=False)
    values = [[], []]
    for i in range(6):
        frame = recording.frame(i)
        kept = {name: array for name, array in frame.buffers().items() if "normal" not in name}
        for state, found in zip(states, values, strict=True):
            color = state.step(yester.Frame(**kept, camera=frame.camera)).color
            if i in recording.references:
                found.append(metrics.psnr(color, recording.reference(i)))
    assert effects[-1].gains["psnr"] == pytest.approx(np.mean(values[0]) - np.mean(values[1]))
    assert effects[-1].case == "cornell_box, no normals"
    rows = (tmp_path / "ablation.csv").read_text().splitlines()
    assert rows[0] == "scene,pipeline,component,added,ms,psnr,door,psnr_error"
    assert [row.split(",")[-2] for row in rows[1:]] == [FULL, FULL, FULL, "no normals"]


def test_harmful_components(monkeypatch):
    """A loss counts beyond the limit, for a component that is on by default, unless it is compensated and listed."""

    def effect(component="clip", scene="cut", added=False, default=True, **gained):
        return Effect(scene, "SVGF", component, added, gained, 0.0, default=default)

    assert ablation.harmful([effect(psnr=-0.09, relmse=-0.019, flip=0, temporal_error=-0.02)]) == []
    assert ablation.harmful([effect(ssim=-1)]) == []
    worse = effect(psnr=0.1, flip=-0.05, relmse=-0.021)
    worst = effect("dilation", psnr=-0.4)
    assert ablation.harmful([worse, worst]) == [
        "SVGF - dilation, cut: psnr -0.40 dB",
        "SVGF - clip, cut: relmse -2.1 %, flip -5.0 %",
    ]
    assert ablation.harmful([replace(worse, **other) for other in ({"added": True}, {"default": False})]) == []
    assert ablation.harmful([replace(worse, scene=ALL)]) == []
    assert len(ablation.harmful([worse], {"flip": 0.04})) == 1
    assert ablation.harmful([replace(worse, errors={"flip": 0.026, "relmse": 0.01})]) == [
        "SVGF - clip, cut: relmse -2.1 %"
    ]
    assert ablation.harmful([worse], {"flip": 0.06}) == []
    good = replace(worse, gains=worse.gains | {"psnr": 1.3})
    assert "made good" in ablation.harmful([good])[0]
    # A gain of less than two standard errors makes nothing good.
    unsure = replace(good, errors={"psnr": 0.7})
    assert "made good" not in ablation.harmful([unsure])[0]
    monkeypatch.setitem(harm.EXCEPTIONS, ("SVGF - clip", "cut"), "it sharpens")
    assert ablation.harmful([good, worse]) == ["SVGF - clip, cut: relmse -2.1 %, flip -5.0 %"]
    assert ablation.harmful([replace(good, gains=good.gains | {"psnr": 1.2})]) == [
        "SVGF - clip, cut: relmse -2.1 %, flip -5.0 %"
    ]
    assert len(ablation.harmful([replace(good, scene="thicket")])) == 1


def test_exceptions_name_existing_components():
    components = {each.method.name for each in ABLATIONS if each.whole.default and not each.added}
    for (component, scene), reason in harm.EXCEPTIONS.items():
        assert component in components
        assert scene in (*NAMES, *LATE)
        assert reason


def test_table_of_gains():
    """Mean, number of gains, and the worst case with its name; columns fit their contents."""
    rows = {
        "long name of a component": {"grass": {"psnr": 0.5, "flip": -0.013}, "cut": {"psnr": -0.25, "flip": 0.02}},
        "short": {"grass": {"psnr": 0.1}},
    }
    lines = harm.table(rows, {"long name of a component": 1.25, "short": -0.5}).splitlines()
    assert lines[0].split() == ["psnr", "flip", "costs", "ms"]
    text = "long name of a component +0.12 dB ( 1) -0.25 dB cut +0.4 % ( 1) -1.3 % grass 1.2"
    assert " ".join(lines[1].split()) == text
    assert " ".join(lines[2].split()) == "short +0.10 dB ( 1) -0.5"
    assert len({len(line) for line in lines}) == 1
