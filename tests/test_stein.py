"""Stein's estimate: without bias for filters of which the derivative is known, and its command."""

import numpy as np
import pytest
from yester import Frame
from yester.study.compare import stein
from yester.study.compare.stein import shifted, stein_error

pytestmark = pytest.mark.slow


def smoothed(image, share):
    """A mixture of each pixel with the mean of its row of four neighbours."""
    return image + share * (0.25 * sum(np.roll(image, by, 1) for by in (-2, -1, 1, 2)) - image)


def test_derivatives():
    """Of a filter's result by the own sample, the mean over many pixels is the sample's share."""
    rng = np.random.default_rng(0)
    frames = [Frame(rng.exponential(1, (48, 64, 3)).astype(np.float32)) for _ in range(4)]
    moved, shifts = shifted(frames)
    for frame, other, shift in zip(frames, moved, shifts, strict=True):
        assert (np.abs(shift) <= 0.2 * frame.color.mean()).all()
        slopes = (smoothed(other.color, 0.6) - smoothed(frame.color, 0.6)) / shift
        assert slopes.mean() == pytest.approx(0.4, abs=0.02)
        assert (shift > 0).mean() == pytest.approx(0.5, abs=0.02)


def test_without_bias(monkeypatch):
    """With Gaussian noise, and squared errors without weights, the mean over many images is the true difference."""
    monkeypatch.setattr(stein, "weights", lambda mean: [np.ones_like(mean)] * 2)
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:24, :32] / 24
    true = np.dstack([3 + np.sin(5 * x), 3 + y, 3 + np.cos(4 * x * y)])
    frames = [Frame((true + rng.normal(0, 1, true.shape)).astype(np.float32)) for _ in range(100)]
    moved, shifts = shifted(frames)
    first, second = (tuple([smoothed(f.color, s) for f in each] for each in (frames, moved)) for s in (0.1, 0.8))
    said = stein_error(first, second, frames, shifts)["relative"]
    known = np.mean([((a - true) ** 2 - (b - true) ** 2).mean() for a, b in zip(first[0], second[0], strict=True)])
    assert known > 0.1
    assert said.difference == pytest.approx(known, abs=4 * said.error)
    assert said.difference == pytest.approx(known, rel=0.1)
    swapped = stein_error(second, first, frames, shifts)["relative"]
    assert swapped.difference == pytest.approx(-said.difference)


def test_missing_samples_and_wrong_lengths():
    rng = np.random.default_rng(0)
    colors = rng.exponential(1, (3, 8, 9, 3)).astype(np.float32)
    colors[1, 2, 3] = np.nan
    frames = [Frame(color) for color in colors]
    moved, shifts = shifted(frames)
    assert np.isnan(moved[1].color[2, 3]).all()
    clean = [np.nan_to_num(frame.color) for frame in frames]
    method = [smoothed(image, 0.3) for image in clean], [smoothed(image, 0.3) for image in clean]
    assert np.isfinite(stein_error(method, (clean, clean), frames, shifts)["display"].difference)
    with pytest.raises(ValueError, match=r"^frames: expected as many results, more than 3"):
        stein_error(method, method, frames, shifts, start=3)
    with pytest.raises(ValueError, match=r"^frames: expected as many results"):
        stein_error(method, method, frames[:2], shifts)


@pytest.mark.long
def test_command(capsys):
    stein.main(["--sequences", "cornell_box", "cut"])
    tables = capsys.readouterr().out.split("\n\n")
    assert [table.splitlines()[0] for table in tables[:2]] == ["Stein's estimate", "prediction"]
    assert all("normal weight" in table for table in tables[:2])
