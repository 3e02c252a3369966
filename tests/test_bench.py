"""The benchmark covers everything, its arithmetic is right, and it names what it left out."""

import signal
import sys
import tempfile
import types
from tempfile import mkdtemp

import numpy as np
import pytest
import yester
from test_cli import refused, run
from test_cli_study import files, interrupted, table, without
from yester.study.compare import peers
from yester.study.speed import bench, rivals
from yester.study.speed.tasks import TASKS, Inputs, stage
from yester.study.speed.timings import OURS, Limits, Memory, Timing, draw, markdown, targets, write_csv

pytestmark = pytest.mark.slow

HD, UHD = (1920, 1080), (3840, 2160)
LIMITS = Limits(20.0, 100.0)


def timing(task, contender=OURS, *runs, size=HD, threads=2, simd="avx2", **more):
    return Timing(task, contender, size, threads, simd if contender == OURS else "", runs, **more)


def test_every_kernel_and_pipeline_is_timed():
    kernels = {name for name in yester.__all__ if isinstance(getattr(yester, name), types.BuiltinFunctionType)}
    pipelines = {name for name in yester.__all__ if hasattr(getattr(yester, name), "step")}
    # A planned pipeline is SVGF.
    assert {task.function for task in TASKS} == kernels - {"jitter"} | pipelines - {"Planned"}
    assert len({task.name for task in TASKS}) == len(TASKS)
    assert {rival for task in TASKS for rival in task.rivals} == set(rivals.RIVALS)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("images")
    stage(folder, 64, 48)
    return Inputs(folder, 64, 48)


@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.name)
def test_every_task_runs_again_and_again(task, inputs):
    call = task.start(inputs)
    call.run(), call.run()
    given = [array for name in task.images.values() for array in inputs_of(inputs, name)]
    # The smallest frame is the one to be upscaled.
    least = sum(array.nbytes for array in given) if given else 32 * 24 * 4 * 3
    assert least <= call.bytes - call.made < 1e6
    # A number, some values per tile, or a mask.
    fewer = "exposure", "light_change", "choice", "compare_candidates", "collocate", "collocation_shares"
    fewer += "depth_change", "incoherent_guides", "is_reflectance", "material_change", "repetition"
    assert 64 * 48 * 4 <= call.made < 1e6 or task.function in fewer


def inputs_of(inputs, names):
    values = [inputs[name] for name in (names if isinstance(names, list) else [names])]
    return [value for value in values if isinstance(value, np.ndarray)]


def test_bytes_count_each_image_once(inputs):
    # History and motion with depth in, values and coverage out; colour in, a number out.
    calls = {task.name: task.start(inputs) for task in TASKS if task.name in ("reproject, bilinear", "exposure")}
    pixels = 64 * 48
    assert calls["reproject, bilinear"].bytes == pixels * 4 * (3 + 3 + 3 + 1)
    assert calls["reproject, bilinear"].made == pixels * 4 * (3 + 1)
    assert calls["exposure"].bytes == pixels * 4 * 3
    assert calls["exposure"].made == 0


def test_frames_follow_each_other(inputs):
    """Frames move to and fro: history is found again, and kernels have pixels to reject, to clip and to repair."""
    svgf = yester.SVGF(alpha=0.05)
    for frame in inputs.frames() * 4:
        output = svgf.step(frame)
    assert 0.8 < np.mean(output.history_length > 6) < 1
    assert 0 < np.mean(output.rejection > 0) < 0.2
    assert 0.05 < np.mean(inputs["history_length"] < 4) < 0.2
    assert (inputs["ids"] == 0).any()
    assert np.abs(inputs["motion"][..., :2]).max() > 1


@pytest.mark.parametrize("name", rivals.RIVALS)
def test_every_rival_runs(name, inputs):
    task = next(task for task in TASKS if name in task.rivals)
    call = rivals.start(name, task, inputs)
    call.run(), call.run()


@pytest.mark.parametrize("name", ["remap, linear", "grid_sample, bilinear"])
def test_rivals_give_the_same_results(name, inputs):
    """Inside the image, rivals give our results."""
    (task,) = (task for task in TASKS if task.name == "reproject, bilinear")
    (full,) = (rival for rival in task.rivals if rival.endswith(name))
    other = np.asarray(rivals.start(full, task, inputs).run())
    other = np.moveaxis(other[0], 0, -1) if other.ndim == 4 else other
    ours, coverage = yester.reproject(inputs["history"], inputs["motion"])
    # OpenCV rounds positions to 1/32 of a pixel.
    difference = np.abs(other - ours)[coverage == 1]
    assert np.mean(difference) < 0.01 * np.mean(ours)


@pytest.mark.parametrize(
    "name", ["reproject, bilinear, tested", "clip_history, blended", "TAA, box without tone mapping"]
)
def test_references_do_the_same(name, inputs):
    (task,) = (task for task in TASKS if task.name == name)
    calls = rivals.start(rivals.REFERENCE, task, inputs), task.start(inputs)
    for _ in inputs.frames() if task.pipeline else ():
        calls[0].run()  # our pipeline has taken as many steps already
    other, ours = (call.run() for call in calls)
    if not isinstance(ours, np.ndarray):
        other, ours = (result.color if task.pipeline else result[0] for result in (other, ours))
    assert np.mean(np.abs(np.asarray(other) - ours) > 1e-3) < 0.01


def test_memory_of_a_pipeline(tmp_path):
    """More than its history, less than ten times its images; and it does not grow from frame to frame."""
    width, height = 512, 288
    stage(tmp_path, width, height)
    with bench._Worker(2) as worker:
        memory = worker.ask("memory", "TAA, box without tone mapping", (tmp_path, width, height))
    image = 12e-6 * width * height
    assert image < memory.most < 10 * image
    assert abs(memory.growth) < image


def test_memory_is_the_lasting_growth(monkeypatch, inputs):
    (task,) = (task for task in TASKS if task.name == "TAA")
    known = iter([(100, 105), (120, 130), (140, 150), (150, 155), *[(151, 160)] * 8, (153, 170)])
    monkeypatch.setattr(bench, "resident", lambda: next(known))
    made = 1e-6 * task.start(inputs).made
    assert bench._memory(task, inputs) == (pytest.approx(70 - made), 3)

    def refuse():
        raise FileNotFoundError

    monkeypatch.setattr(bench, "resident", refuse)
    assert bench._memory(task, inputs) is None


# Analysis of the times


def test_a_limit_binds():
    given = {"bytes": 2_000_000_000, "limits": LIMITS}
    one = timing("atrous, 1 pass", OURS, 400.0, 100.0, 200.0, 500.0, 300.0, **given)
    assert (one.ms, one.quartiles) == (300, (200, 400))
    assert one.ns_per_pixel == pytest.approx(300e6 / (1920 * 1080))
    assert one.bandwidth == pytest.approx(2 / 0.3)
    # 2 GB at 20 GB/s take 100 ms; 10 multiply-adds of each pixel take 0.2 ms, 10000 take 207 ms.
    assert one.limit == ("memory", pytest.approx(100))
    assert one.share == pytest.approx(1 / 3)
    assert timing("a", OURS, 300.0, multiply_adds=10, **given).limit == ("memory", pytest.approx(100))
    heavy = timing("a", OURS, 300.0, multiply_adds=10_000, **given)
    assert heavy.limit == ("arithmetic", pytest.approx(207.36))
    assert heavy.share == pytest.approx(207.36 / 300)
    assert timing("a", "OpenCV", 300.0).limit is timing("a", "OpenCV", 300.0).share is None


def test_targets():
    timings = [
        timing("reproject, bilinear", OURS, 10.0),
        timing("reproject, bilinear", "OpenCV remap, linear", 10.0),
        timing("reproject, bilinear, tested", OURS, 15.0),
        timing("reproject, catmull-rom", OURS, 21.0),
        timing("reproject, catmull-rom", "OpenCV remap, cubic", 20.0),
        timing("atrous, 1 pass", OURS, 10.0, bytes=100_000_000, limits=LIMITS),
        timing("atrous, 5 passes", OURS, 22.0, bytes=100_000_000, limits=LIMITS, multiply_adds=500),
        timing("SVGF", OURS, 60.0, memory=Memory(219.0, 0.75)),
        timing("SVGF", OURS, 2.0, size=(256, 256)),
        timing("SVGF, 5 passes, no choice", OURS, 50.0),
        timing("SVGF, 5 passes, no choice", OURS, 90.0, threads=1),
        timing("SVGF, 5 passes, no choice", OURS, 500.0, simd="baseline"),
        timing("SVGF, 5 passes, no choice", OURS, 220.0, size=UHD),
        timing("SVGF, 5 passes, no choice", "OIDN fast", 600.0),
        timing("SVGF, 5 passes, no choice", "OIDN fast", 60_000.0, threads=1),
        timing("SVGF, 5 passes, no choice", "torch reference", 1900.0),
        timing("SVGF, as published", OURS, 30.0, memory=Memory(111.0, 0.0)),
    ]
    known = {target.name: target for target in targets(timings) if target.measured is not None}
    found = {name: (pytest.approx(target.measured), target.met) for name, target in known.items()}
    assert found == {
        "reproject, bilinear: time relative to OpenCV remap, linear": (1, True),
        "reproject, catmull-rom: time relative to OpenCV remap, cubic": (1.05, False),
        "reproject, bilinear, tested: time relative to untested": (1.5, False),
        "atrous, 1 pass with its guide: fraction of the limit (memory binds)": (0.5, True),
        "atrous, a further pass: fraction of the limit": (5.368 / 12, True),
        "SVGF: speed relative to OIDN fast": (10, False),
        "SVGF, 5 passes, no choice: speed relative to torch reference": (38, False),
        "SVGF, 5 passes, no choice: time of one thread relative to two": (1.8, False),
        "SVGF, 5 passes, no choice: time per pixel at 4K relative to 1080p": (1.1, True),
        "SVGF: time per pixel at 256×256 relative to 1080p": (2 / 60 * 1920 * 1080 / 256**2, True),
        "SVGF: state and scratch, MB": (219, True),
        "SVGF, as published: state and scratch, MB": (111, False),
        "SVGF: growth of state and scratch, MB": (0.75, False),
    }
    assert all(target.met is None for target in targets([timings[0]]))


def test_page_and_tables(tmp_path):
    timings = [
        timing("exposure", OURS, 2.0, 1.0, 3.0, bytes=10_000_000, limits=LIMITS),
        timing("exposure", OURS, 4.0, threads=1, bytes=10_000_000, limits=LIMITS),
        timing("exposure", "torch reference", 50.0),
        timing("exposure", "OpenCV mean", 8.0),
        timing("exposure", "OpenCV mean", 9.0, threads=1),
        timing("TAA", OURS, 6.0, memory=Memory(34.56, 0.0)),
        timing("TAA", OURS, 7.0, size=UHD),
    ]
    page = markdown(timings, about="of a machine", missing=["OpenCV: buy it"])
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in page.splitlines() if line.startswith("|")]
    assert ["2 threads, avx2", "20.0", "100"] in rows
    assert ["exposure", "2.00", "1.50 to 2.50", "0.96", "5.0", "25% memory", "4.00", "50.00"] in rows
    assert ["— OpenCV mean", "8.00", "8.00 to 8.00", "3.86", "", "(4.00 × yester)", "9.00", ""] in rows
    assert ["TAA", "6.00", "6.00 to 6.00", "2.89", "", "", "", ""] in rows
    assert ["TAA", "7.00", "7.00 to 7.00", "0.84", "", "", ""] in rows
    assert ["TAA", "34.6", "0.0"] in rows
    assert ["TAA: time per pixel at 4K relative to 1080p", "≤ 1.15", "0.29", "met"] in rows
    assert ["SVGF: time per pixel at 4K relative to 1080p", "≤ 1.15", "not measured", ""] in rows
    assert "of a machine" in page
    assert page.endswith("Not measured: OpenCV: buy it\n")
    write_csv(timings, tmp_path)
    first, *_, last = table(tmp_path / "bench.csv")[:5]
    assert (first["task"], first["contender"], first["width"], first["runs"], first["limit"]) == (
        *("exposure", OURS, "1920", "3", "memory"),
    )
    assert [float(first[key]) for key in ("ms", "ms_low", "ms_high", "gb_per_s", "share", "copy_gb_per_s")] == (
        pytest.approx([2, 1.5, 2.5, 5, 0.25, 20])
    )
    assert (last["threads"], last["simd"], last["share"], last["copy_gb_per_s"]) == ("1", "", "", "")
    judged = table(tmp_path / "targets.csv")
    assert [row["target"] for row in judged] == [target.name for target in targets(timings)]
    held = [(row["held_mb"], row["growth_mb"]) for row in table(tmp_path / "bench.csv")]
    assert held == [*[("", "")] * 5, ("34.56", "0.0"), ("", "")]
    figure = draw(timings)
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()] == ["exposure", "TAA"]


def test_missing_system_information_is_named():
    assert "Not measured: memory" in markdown([timing("TAA", OURS, 6.0)], about="")
    assert "Not measured: memory" not in markdown([timing("exposure", OURS, 6.0)], about="")
    assert "targets" not in markdown([timing("exposure", OURS, 6.0)], about="")


def test_slow_contenders_get_fewer_runs(monkeypatch, tmp_path):
    class Worker:
        def __init__(self, *times):
            self.times = [0.0, *times]

        def ask(self, what, *_):
            if what == "prepare":
                return 12, self.times[0]
            return self.times.pop() if what == "run" else None

    def raced(first, *times):
        worker = Worker(*times)
        worker.times[0] = first
        entrant = bench._Entrant(OURS, (2, ""), worker)
        bench._race([entrant], TASKS[0], (tmp_path, 1, 1), 7)
        return entrant.runs

    patience = 1e3 * bench.PATIENCE
    assert raced(1.0, *range(7)) == [6, 5, 4, 3, 2, 1, 0]
    assert len(raced(0.1 * patience, *[0.2 * patience] * 7)) == 5
    assert len(raced(0.6 * patience, *[0.6 * patience] * 7)) == 3
    assert raced(1.1 * patience, *[1.2 * patience] * 7) == [1.2 * patience]


def test_large_images_are_spared_the_slow():
    (task,) = (task for task in TASKS if task.name == "reproject, lanczos-2")
    ours = dict.fromkeys([(4, "avx2"), (1, "avx2"), (4, "baseline")])
    others = dict.fromkeys([4, 1])

    def entrants(size, absent=()):
        every = [*bench._ours(ours, size), *bench._rivals(others, task, size, absent)]
        return [(entrant.name, entrant.setting) for entrant in every]

    remap = "OpenCV remap, Lanczos4"
    assert entrants(HD) == [
        *((OURS, setting) for setting in ours),
        *((remap, (4, "")), ("torch reference", (4, "")), (remap, (1, ""))),
    ]
    assert entrants(UHD) == [(OURS, (4, "avx2")), (OURS, (1, "avx2")), (remap, (4, ""))]
    assert entrants(UHD, {"OpenCV with ximgproc"}) == entrants(UHD)[:2]


def test_settings(monkeypatch):
    monkeypatch.setattr(bench._core, "settings", lambda: (8, "avx512"))
    assert bench.settings() == [(8, "avx512"), (1, "avx512"), (8, "avx2"), (8, "baseline")]
    assert bench.settings([2, 1], ["baseline", "avx2"]) == [(2, "avx2"), (1, "avx2"), (2, "baseline")]
    with pytest.raises(ValueError, match="threads: expected 1 to 8, got 9"):
        bench.settings([9])
    monkeypatch.setattr(bench._core, "settings", lambda: (1, "avx2"))
    assert bench.settings() == [(1, "avx2"), (1, "baseline")]
    with pytest.raises(ValueError, match="simd: expected some of baseline, avx2, got avx512"):
        bench.settings(None, ["avx512"])
    monkeypatch.setattr(bench._core, "settings", lambda: (4, "neon"))
    assert bench.settings([4]) == [(4, "neon")]


def test_something_is_to_be_measured():
    with pytest.raises(ValueError, match="repetitions: expected at least 1, got 0"):
        bench.measure(TASKS, [HD], [(1, "")], repetitions=0)


def test_missing_rivals_and_extras_are_named(monkeypatch):
    assert rivals.missing() == {}
    with monkeypatch.context() as here:
        for name in ("mitsuba_oidn", "cv2", "torch"):
            here.setitem(sys.modules, name, None)
        absent = rivals.missing()
    assert list(absent) == ["Open Image Denoise", "OpenCV with ximgproc", "torch references", "torch"]
    assert set(absent) == {rivals.library(name) for name in (*rivals.RIVALS, rivals.REFERENCE)}
    monkeypatch.setattr(peers, "_checkout", lambda: None)
    assert "checkout" in rivals.missing()["torch references"]


# The command


LITTLE = ("--sizes", "64x48", "--threads", 1, "--repetitions", 1)
WRITTEN = ("bench.md", "bench.csv", "targets.csv", "bench.svg")


def test_bench(tmp_path):
    out = tmp_path / "new" / "out"
    result = run("bench", *LITTLE, "--only", "reproject, bilinear", "demodulate", "-o", out)
    assert result.stderr == ""
    page, names = result.stdout[: -1 - sum(len(f"{out / name}\n") for name in WRITTEN)], result.stdout.splitlines()[-4:]
    assert names == [str(out / name) for name in WRITTEN]
    assert page == (out / "bench.md").read_text()
    rows = table(out / "bench.csv")
    best = yester._core.settings()[1]
    assert {(row["width"], row["height"], row["threads"]) for row in rows} == {("64", "48", "1")}
    alike = ["OpenCV remap, linear", "torch grid_sample, bilinear", "torch reference"]
    rivals_and_best = [row for row in rows if row["simd"] in (best, "")]
    contenders = [row["contender"] for row in rivals_and_best if row["task"] == "reproject, bilinear"]
    assert contenders == [OURS, *alike]
    assert [row["contender"] for row in rows if row["task"] == "demodulate"][-1] == "torch reference"
    for row in rows:
        assert 0 < float(row["ms_low"]) <= float(row["ms"]) <= float(row["ms_high"])
        assert (row["simd"] != "") == (row["contender"] == OURS) == (row["gb_per_s"] != "")
        assert row["contender"] != OURS or float(row["copy_gb_per_s"]) > 0 < float(row["giga_multiply_adds_per_s"])
    assert {row["task"] for row in rows} == {"reproject, bilinear", "reproject, bilinear, tested", "demodulate"}
    assert {path.name for path in files(tmp_path)} == set(WRITTEN)


def test_missing_rivals_are_named(tmp_path):
    arguments = ("bench", *LITTLE, "--simd", "baseline", "--only", "reproject, b", "TAA, box", "-o", tmp_path)
    result = without("cv2,mitsuba_oidn", *arguments)
    named = [line.split(": ")[1] for line in result.stdout.splitlines() if line.startswith("Not measured")]
    assert named == ["Open Image Denoise", "OpenCV with ximgproc"]
    rows = table(tmp_path / "bench.csv")
    assert {row["contender"] for row in rows} == {OURS, "torch grid_sample, bilinear", "torch reference"}
    assert {row["simd"] for row in rows} == {"baseline", ""}
    result = run("bench", *LITTLE, "--only", "demodulate", "-o", tmp_path, "--no-rivals", "--overwrite")
    assert {row["contender"] for row in table(tmp_path / "bench.csv")} == {OURS}
    assert "Not measured" not in result.stdout


@pytest.mark.parametrize("name", WRITTEN)
def test_a_bench_replaces_nothing(tmp_path, name):
    """Unless told so."""
    (tmp_path / name).write_text("mine")
    line = refused("bench", *LITTLE, "--only", "demodulate", "--no-rivals", "-o", tmp_path)
    assert f"{tmp_path / name}: exists already: --overwrite replaces" in line
    assert (tmp_path / name).read_text() == "mine"


def test_refuses_before_work_starts(tmp_path):
    def bench(*arguments):
        return refused("bench", "-o", tmp_path / "out", *arguments)

    assert "64by48" in bench("--sizes", "64by48")
    assert "--threads" in bench("--threads", 0)
    assert "threads: expected 1 to" in bench("--threads", 10_000)
    assert all(part in bench("--simd", "sse9") for part in ("simd: expected some of baseline", "got sse9"))
    line = bench("--only", "SVGF", "svfg")
    assert all(name in line for name in ("only", "got svfg", *(task.name for task in TASKS)))
    assert "--repetitions" in bench("--repetitions", 0)
    assert not [*tmp_path.iterdir()]
    (tmp_path / "file").write_text("in the way")
    assert "cannot be written" in refused("bench", *LITTLE, "-o", tmp_path / "file")
    assert "yester[study]" in without("matplotlib", "bench", "-o", tmp_path / "out", code=2).stderr
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.usefixtures("ctrl_c")
@pytest.mark.parametrize("moment", ["yester-bench-*", "*/*.npy"], ids=["processes start", "images are made"])
def test_interrupted(moment, tmp_path, monkeypatch):
    """No files are left, and the measuring processes print nothing."""
    out, images = tmp_path / "out", tmp_path / "images"
    images.mkdir()
    monkeypatch.setenv("TMPDIR", str(images))
    interrupted("bench", "--sizes", "640x480", "--no-rivals", "-o", out, until=lambda: [*images.glob(moment)])
    assert not [*images.iterdir()]
    assert not [*out.iterdir()]


@pytest.mark.usefixtures("ctrl_c")
def test_interrupted_as_a_folder_is_made(tmp_path, monkeypatch):
    def make(*arguments):
        made = mkdtemp(*arguments)
        signal.raise_signal(signal.SIGINT)
        return made

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(tempfile, "mkdtemp", make)
    with pytest.raises(KeyboardInterrupt):
        bench.measure(TASKS[:1], [(64, 48)], [(1, "baseline")], absent=None)
    assert not [*tmp_path.iterdir()]
