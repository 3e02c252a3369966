import sys

import flight
import mitsuba_oidn
import numpy as np
import pytest
import yester
from compare import assert_same_bits
from yester.metrics import relmse
from yester.study.compare import peers as module
from yester.study.compare.peers import peers

pytestmark = pytest.mark.slow

FOUND, MISSING = peers()


def frames(count, *names):
    """Noisy frames of the flight and their references; with all buffers, or some."""
    rng = np.random.default_rng(0)
    for number in range(count):
        shot = flight.shoot(number, 96, 64)
        known = {**shot.buffers(), "camera": shot.camera, "color": flight.noisy(shot, rng)}
        if number == 0:
            del known["motion"]
        yield yester.Frame(**{name: known[name] for name in ({"color", *names} if names else known)}), shot.color


def plain(color, albedo, normal, quality):
    """Open Image Denoise by the function of its bindings, in its default number of threads."""
    device = mitsuba_oidn.Device(mitsuba_oidn.DeviceType.CPU)
    quality = mitsuba_oidn.Quality[quality.title()]
    return mitsuba_oidn.denoise(color, albedo, normal, hdr=True, quality=quality, device=device)


def test_all_are_here():
    assert MISSING == {}
    families = {method.family for method in FOUND}
    networks = {"OIDN", "temporal OIDN", "temporal OIDN, both sides"}
    assert families == networks | {"non-local means", "joint bilateral", "guided filter", "SVGF in torch"}
    assert all(method.peer and not method.default for method in FOUND)
    assert len({method.name for method in FOUND}) == len(FOUND) >= 13


@pytest.mark.parametrize("method", FOUND, ids=lambda method: method.name)
def test_each_denoises(method):
    given, truths = zip(*frames(3), strict=True)
    for frame, truth, result in zip(given, truths, method.run(given), strict=True):
        assert result.color.shape == truth.shape
        assert result.color.dtype == np.float32
        # Non-local means mistake the noise of single samples for texture.
        most = 1.0 if method.family == "non-local means" else 0.5
        assert relmse(result.color, truth) < most * relmse(frame.color, truth)


def holed(frame):
    """The frame with some samples missing."""
    color = frame.color.copy()
    color[5, 7] = np.nan
    color[9, 9, 1] = np.inf
    return yester.Frame(**frame.buffers() | {"color": color}, camera=frame.camera)


@pytest.mark.filterwarnings("ignore:frames. later frames are not used")
@pytest.mark.parametrize("names", [["camera"], ["albedo", "camera"], ["normal", "camera"]], ids=str)
@pytest.mark.parametrize("method", FOUND, ids=lambda method: method.name)
def test_each_does_with_less(method, names):
    given, truths = zip(*frames(2, *names), strict=True)
    for frame, truth, result in zip(given, truths, method.run(map(holed, given)), strict=True):
        assert np.isfinite(result.color).all()
        assert relmse(result.color, truth) < relmse(frame.color, truth)


@pytest.mark.parametrize("method", FOUND, ids=lambda method: method.name)
def test_highlights_stay(method):
    """A wide bright spot is not cut off at white."""
    color = np.full((48, 64, 3), 0.2, np.float32)
    color[12:36, 16:48] = 20
    (result,) = method.run([yester.Frame(color)])
    assert result.color[24, 32].min() > 15


def test_oidn_is_itself():
    for frame, _ in frames(1):
        for method in FOUND:
            if method.family == "OIDN":
                want = plain(frame.color, frame.albedo, frame.normal, method.name.split()[-1])
                (result,) = method.run([frame])
                assert_same_bits(result.color, want)


@pytest.mark.long
def test_torch_is_ours():
    (method,) = (method for method in FOUND if method.family == "SVGF in torch")
    given, svgf = [frame for frame, _ in frames(4)], yester.SVGF(reflections=())
    for frame, result in zip(given, method.run(given), strict=True):
        other, ours = result.color, svgf.step(frame).color
        assert np.mean(np.abs(other - ours) > 1e-3 * np.abs(ours) + 1e-5) < 0.005


def test_missing_peers_are_named(monkeypatch):
    with monkeypatch.context() as here:
        for name in ("mitsuba_oidn", "cv2", "torch"):
            here.setitem(sys.modules, name, None)
        found, missing = peers()
    assert found == []
    assert list(missing) == ["Open Image Denoise", "OpenCV with ximgproc", "SVGF in torch"]
    assert all("pip install 'yester[" in remedy for remedy in missing.values())
    monkeypatch.setattr(module, "_checkout", lambda: None)
    found, missing = peers()
    assert "checkout" in missing["SVGF in torch"]
    assert len(found) == len(FOUND) - 1


def test_a_peer_that_does_not_start_is_missing(monkeypatch):
    """As one whose system libraries are missing. The references in torch need none."""

    def broken(name):
        raise OSError("libtbb.so.12: cannot open shared object file")

    monkeypatch.setattr(module, "import_module", broken)
    assert {peer.family for peer in peers()[0]} == {"SVGF in torch"}
