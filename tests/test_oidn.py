"""The learned denoiser: its inputs and outputs, alone and between temporal stages."""

import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest
import yester
from compare import assert_same_bits
from composed import between_tiles, luminance
from test_peers import frames, plain

pytestmark = pytest.mark.slow

NAMES = ("color", "history_length", "confidence", "rejection")


def test_alone_it_is_itself():
    oidn = yester.OIDN("fast")
    for names in ((), ("albedo",), ("albedo", "normal"), ("normal",)):
        for frame, _ in frames(1, *(names or ["camera"])):
            albedo = frame.albedo
            normal = frame.normal if albedo is not None else None
            want = plain(frame.color, albedo, normal, "fast")
            out = oidn.step(frame)
            assert_same_bits(out.color, want)
            assert out.used == tuple(name for name in names if albedo is not None)
            assert out.variance is None
            assert (out.history_length == 1).all()
            assert not out.confidence.any()
            assert not out.rejection.any()


@pytest.mark.parametrize(("innovation", "choice"), [(False, False), (True, False), (True, True)])
def test_between_temporal_stages_it_is_their_composition(innovation, choice):
    oidn = yester.OIDN("fast", temporal=True, innovation=innovation, choice=choice)
    history = yester.SVGF(alpha=0.05, iterations=0, choice=False, innovation=False, antialias=False)
    antialiasing, before, evidence = yester.TAA("denoised", innovation=innovation), None, None
    mixing = SimpleNamespace(evidence=None, before=None)
    for frame, _ in frames(4):
        out, known = oidn.step(frame), history.step(frame)
        clean = plain(known.color, frame.albedo, frame.normal, "fast")
        if choice:
            alone = plain(frame.color, frame.albedo, frame.normal, "fast")
            clean = mixed(mixing, clean, alone, frame.color, known)
        if innovation and before is not None:
            carried = known.history_length, evidence, known.motion
            bright = yester.exposure(clean)
            found, evidence = yester.innovation(frame.color, clean, *carried, exposure=bright, fed_back=False)
            assert found.any()
            clean = np.maximum(clean + found, 0)
        kept = "depth", "position", "camera", "jitter", "albedo", "normal", "ids"
        smooth = yester.Frame(clean, motion=known.motion, **{name: getattr(frame, name) for name in kept})
        want = antialiasing.step(smooth, samples=frame.color, confidence=known.confidence)
        assert_same_bits(out.color, want.color)
        for name in NAMES[1:]:
            assert_same_bits(getattr(out, name), getattr(known, name))
        assert set(out.used) == set(known.used)
        before = frame
    if choice:
        assert mixing.shares.any()
    oidn.reset()
    again = yester.OIDN("fast", temporal=True, innovation=innovation, choice=choice)
    first, fresh = oidn.step(frame), again.step(frame)
    assert (first.history_length <= 1).all()
    assert_same_bits(first.color, fresh.color)


def mixed(state, steady, fresh, samples, known):
    """As much of the second image, up to half of it, as predicts the samples best; less of what is brighter."""
    rule = {"strictness": 1, "frame_strictness": np.inf}
    bright = yester.exposure(steady)
    tone = np.minimum(1, (bright + luminance(steady)) / (bright + luminance(fresh)))
    before, state.before = state.before, [steady, (tone * tone)[..., None] * (fresh - steady)]
    if before is None:
        return steady
    (carried, change), coverage = yester.reproject(before, known.motion, fallback=False)
    coverage[known.confidence == 0] = 0
    candidates = [luminance(carried) + np.float32(share) * luminance(change) for share in (0, 0.25, 0.5)]
    candidates = np.where((coverage > 0)[..., None], np.dstack(candidates), np.float32(np.nan))
    if state.evidence is not None:
        _, state.evidence = yester.choice(state.evidence, known.motion, coverage, **rule)
    state.evidence = yester.compare_candidates(samples, candidates, state.evidence, exposure=bright)
    still = np.zeros((*coverage.shape, 2), np.float32)
    chosen, _ = yester.choice(state.evidence, still, np.ones_like(coverage), share=0, **rule)
    state.shares = between_tiles(chosen, *coverage.shape) / 4
    return steady + state.shares[..., None] * state.before[1]


@pytest.mark.filterwarnings("ignore:color. expected new noise")
def test_noise_that_repeats_does_not_choose():
    still = next(iter(frames(1)))[0]
    chooses, other = (yester.OIDN("fast", temporal=True, choice=choice) for choice in (True, False))
    for _ in range(3):
        assert_same_bits(chooses.step(still).color, other.step(still).color)


def test_one_array_may_hold_every_frame():
    """Without albedo, too, where a frame's light is its colour."""
    given = [yester.Frame(frame.color, motion=frame.motion) for frame, _ in frames(4)]
    oidn, other = (yester.OIDN("fast", temporal=True) for _ in range(2))
    held = np.empty_like(given[0].color)
    for frame in given:
        held[:] = frame.color
        assert_same_bits(oidn.step(yester.Frame(held, motion=frame.motion)).color, other.step(frame).color)


def test_time_steadies_it():
    """On a static scene its output flickers less and has less error."""
    still = next(iter(frames(1)))
    rng, truth = np.random.default_rng(1), still[1]
    named = {name: value for name, value in still[0].buffers().items() if name != "color"}
    changes, errors = [], []
    for temporal in (False, True):
        oidn, images = yester.OIDN("fast", temporal=temporal), []
        for _ in range(10):
            noisy = truth * rng.exponential(1, truth.shape[:2])[..., None].astype(np.float32)
            images.append(oidn.step(yester.Frame(noisy, **named, camera=still[0].camera)).color)
        changes.append(np.mean(np.abs(np.diff(images[4:], axis=0))))
        errors.append(np.mean((np.array(images[4:]) - truth) ** 2))
    assert changes[1] < 0.3 * changes[0]
    assert errors[1] < errors[0]


@pytest.mark.parametrize("temporal", [False, True])
def test_missing_samples(temporal):
    oidn = yester.OIDN("fast", temporal=temporal)
    color = np.full((24, 32, 3), 0.5, np.float32)
    color[3, 4] = np.nan
    color[5, 6, 1] = np.inf
    broken = np.full_like(color, np.nan)
    for given in ({"color": color}, {"color": broken}, {"color": color}):
        out = oidn.step(yester.Frame(**given))
        assert np.isfinite(out.color).all()
        assert out.missing == (~np.isfinite(given["color"]).all(-1)).sum()
    # Missing auxiliary buffers do not spread either.
    oidn.reset()
    out = oidn.step(yester.Frame(color, albedo=broken, normal=broken))
    assert np.isfinite(out.color).all()


@pytest.mark.parametrize("temporal", [False, True])
def test_out(temporal):
    oidn, other = (yester.OIDN("fast", temporal=temporal) for _ in range(2))
    out = None
    for frame, _ in frames(3):
        before, want = out, other.step(frame)
        out = oidn.step(frame, out=out)
        for name in NAMES:
            assert_same_bits(getattr(out, name), getattr(want, name))
            assert before is None or getattr(out, name) is getattr(before, name)
    small = yester.Frame(np.ones((5, 7, 3), np.float32))
    for wrong, got in ((yester.SVGF().step(frame), "with variance"), (yester.TAA().step(small), "without variance")):
        with pytest.raises(ValueError, match=rf"^out: expected .*\(64, 96, 3\), got one {got}"):
            oidn.step(frame, out=wrong)


def test_an_out_that_cannot_be_written_changes_nothing():
    oidn, other = (yester.OIDN("fast", temporal=True) for _ in range(2))
    first, second, third = (frame for frame, _ in frames(3))
    out = oidn.step(first)
    before = out.color.copy()
    out.confidence.flags.writeable = False
    with pytest.raises(ValueError, match=r"^out\.confidence: expected a writable array"):
        oidn.step(second, out=out)
    assert_same_bits(out.color, before)
    for frame in (first, second, third):
        want = other.step(frame)
        if frame is not first:
            assert_same_bits(oidn.step(frame).color, want.color)


def test_one_thread_at_a_time(monkeypatch):
    oidn = yester.OIDN("fast")
    frame, _ = next(iter(frames(1)))
    want = oidn.step(frame).color
    begun, refused = threading.Event(), threading.Event()
    network = oidn._network.denoise

    def slow(*given):
        begun.set()
        refused.wait(30)
        return network(*given)

    monkeypatch.setattr(oidn._network, "denoise", slow)
    with ThreadPoolExecutor(1) as pool:
        other = pool.submit(oidn.step, frame)
        begun.wait(30)
        for call in (oidn.reset, lambda: oidn.step(frame)):
            with pytest.raises(RuntimeError, match=r"^OIDN: expected one thread at a time"):
                call()
        refused.set()
        assert_same_bits(other.result().color, want)


def test_sizes_and_buffers_may_change_where_nothing_is_remembered():
    oidn, temporal = yester.OIDN("fast"), yester.OIDN("fast", temporal=True)
    for shape in ((1, 1, 3), (7, 33, 3), (40, 5, 3)):
        frame = yester.Frame(np.ones(shape, np.float32))
        assert oidn.step(frame).color.shape == shape
        temporal.reset()
        assert temporal.step(frame).color.shape == shape
    with pytest.raises(ValueError, match=r"^frame: .*reset"):
        temporal.step(yester.Frame(np.ones((8, 8, 3))))


def test_wrong_arguments():
    with pytest.raises(ValueError, match=r"^quality: expected one of high, balanced, fast, got best"):
        yester.OIDN("best")
    for name in ("temporal", "fireflies", "innovation", "choice"):
        with pytest.raises(TypeError, match=rf"^{name}: expected a bool, got str"):
            yester.OIDN("fast", **{name: "no"})
    with pytest.raises(TypeError, match=r"^frame: .*ndarray"):
        yester.OIDN("fast").step(np.ones((8, 9, 3)))
    with pytest.raises(TypeError, match=r"^out: expected a yester\.Output, got str"):
        yester.OIDN("fast").step(yester.Frame(np.ones((8, 9, 3))), "x")


def test_without_the_package():
    """Where it is needed, the error names the command that installs it."""
    code = "import sys; sys.modules['mitsuba_oidn'] = None; import yester; yester.SVGF(); yester.OIDN()"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.returncode == 1
    last = result.stderr.strip().splitlines()[-1]
    assert last.startswith("ImportError: mitsuba-oidn not installed")
    assert last.endswith("pip install 'yester[oidn]'")


@pytest.mark.parametrize("threads", [1, 2])
def test_threads_and_memory(threads):
    """It runs in as many threads as `YESTER_THREADS` allows; they and its memory are freed with it."""
    code = """if True:
        import gc
        import numpy as np
        import psutil
        import yester

        def held():
            gc.collect()
            return psutil.Process().num_threads(), psutil.Process().memory_info().rss / 2**20

        frame = yester.Frame(np.ones((360, 640, 3), np.float32))
        yester.OIDN().step(frame)  # reads the weights, which stay
        threads, memory = held()
        oidn = yester.OIDN()
        oidn.step(frame)
        more, used = held()
        del oidn
        after, kept = held()
        assert more - threads == yester._core.settings()[0], (threads, more)
        assert used - memory > 50, (memory, used)
        assert after == threads
        assert kept - memory < 10, (memory, kept)
    """
    variables = {**os.environ, "YESTER_THREADS": str(threads)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=variables, check=False)
    assert done.returncode == 0, done.stderr


def test_arrays_are_used_in_place():
    """An earlier result is not overwritten, and input is not changed."""
    oidn, (frame, _) = yester.OIDN("fast"), next(frames(1))
    before = {name: array.copy() for name, array in frame.buffers().items()}
    first = oidn.step(frame).color
    kept = first.copy()
    oidn.step(yester.Frame(frame.color[::-1].copy()))
    assert_same_bits(first, kept)
    for name, array in frame.buffers().items():
        assert_same_bits(array, before[name])


def test_outputs_of_stages_in_python():
    color, flat = np.ones((4, 5, 3), np.float32), np.ones((4, 5), np.float32)
    rejection = np.zeros((4, 5), np.uint8)
    out = yester.Output(color, flat, flat, rejection, variance=flat, choice=2 * flat, used=["albedo"], missing=3)
    assert out.color is color
    assert out.variance is flat
    assert (out.choice == 2).all()
    assert (out.used, out.missing) == (("albedo",), 3)
    for name, wrong in (
        ("color", flat),
        ("history_length", flat[:-1]),
        ("confidence", color),
        ("choice", flat[:, 1:]),
        ("rejection", rejection[1:]),
    ):
        given = {"color": color, "history_length": flat, "confidence": flat, "rejection": rejection, name: wrong}
        with pytest.raises(ValueError, match=rf"^{name}: expected shape"):
            yester.Output(**given)
    with pytest.raises(TypeError, match=r"^rejection: expected a uint8 array, got float32"):
        yester.Output(color, flat, flat, flat)
    with pytest.raises(TypeError, match=r"^color: expected a float32 array, got float64"):
        yester.Output(color.astype(np.float64), flat, flat, rejection)
    with pytest.raises(ValueError, match=r"^missing: expected a number of pixels, got -1"):
        yester.Output(color, flat, flat, rejection, missing=-1)
