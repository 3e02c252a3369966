"""The two-buffer estimate: its formula pixel by pixel, its bias, and its agreement with the predictive error."""

import numpy as np
import pytest
from yester import Frame
from yester.study.compare import halves, judging
from yester.study.compare.halves import two_buffer_error
from yester.study.rendered.recording import record

pytestmark = pytest.mark.slow


def blurred(image, share):
    """Blended with its mean by this weight."""
    return ((1 - share) * image + share * image.mean((0, 1))).astype(np.float32)


def averaged(image):
    """The mean over 5×5 pixels."""
    padded = np.pad(image, ((2, 2), (2, 2), (0, 0)), mode="edge")
    return np.lib.stride_tricks.sliding_window_view(padded, (5, 5), (0, 1)).mean((-2, -1))


def weights(mean):
    relative = 1 / (mean**2 + 0.01)
    slope = 1.055 / 2.4 * mean ** (1 / 2.4 - 1) if mean > 0.0031308 else 12.92
    return relative, slope**2 * (mean < 1)


def test_by_hand():
    """Two frames of few pixels with one missing sample; the variance terms cancel."""
    rng = np.random.default_rng(3)
    samples = rng.uniform(0, 1.5, (2, 3, 3, 4, 3)).astype(np.float32)
    first, second = rng.uniform(0, 1.2, (2, 2, 3, 3, 4, 3)).astype(np.float32)
    samples[1, 2, 1, 1, 0] = np.nan
    given = [[Frame(color) for color in half] for half in samples]
    found = two_buffer_error(first, second, given, start=1, tile=2)
    total = np.zeros(2)
    for t, y, x in np.ndindex(2, 3, 4):
        if (t, y, x) == (1, 1, 1):
            continue
        a, b, (one, other) = (each[:, t + 1, y, x].astype(float) for each in (first, second, samples))
        for number in range(2):
            error = []
            for f in (a, b):
                w = [weights((a[i].mean() + b[i].mean()) / 2)[number] for i in (0, 1)]
                both = (w[0] + w[1]) / 2
                variance = both * (one - other) ** 2 / 4
                cross = 0.5 * (w[0] * (other - f[0]) ** 2 + w[1] * (one - f[1]) ** 2)
                error.append((cross - 2 * variance - both * 0.25 * (f[1] - f[0]) ** 2).mean())
            total[number] += error[0] - error[1]
    assert [found[w].difference for w in ("relative", "display")] == pytest.approx(total / 23)
    for one in found.values():
        assert one.tiles.shape == (2, 2)
        assert one.error > 0
        assert one.change > 0


def test_without_bias(monkeypatch):
    """The mean over many halves is the difference of the errors of the mean results, up to noise in the weights."""
    monkeypatch.setattr(halves, "weights", lambda mean: [np.ones_like(mean)] * 2)
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:24, :32] / 24
    true = np.dstack([0.3 + 0.2 * np.sin(5 * x), 0.4 + 0.1 * y, 0.5 + 0.2 * np.cos(4 * x * y)]).astype(np.float32)
    said, known = [], []
    for _ in range(200):
        samples = (true * rng.gamma(4, 0.25, (2, *true.shape))).astype(np.float32)
        first, second = ([[blurred(half, share)] for half in samples] for share in (0.9, 0.6))
        said.append(two_buffer_error(first, second, [[Frame(half)] for half in samples])["relative"].difference)
        means = [halves._mean(*each) for each in (first, second)]
        known.append(halves._true_error(*means, {0: true})["relative"].difference)
    apart = np.subtract(said, known)
    error = apart.std() / np.sqrt(200)
    assert abs(apart.mean()) < 3 * error < 0.12 * np.mean(known)


def test_bias_by_weights():
    """Relative to brightness, the difference of noisy results is overrated by a quarter, as measured."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:48, :64]
    true = np.repeat((0.5 + 0.3 * np.sin(x / 3) * np.cos(y / 5))[..., None], 3, 2).astype(np.float32)
    said, known = [], []
    for _ in range(20):
        samples = (true + rng.normal(0, 0.3, (2, *true.shape))).astype(np.float32)
        first, second = [[half] for half in samples], [[averaged(half)] for half in samples]
        said.append(two_buffer_error(first, second, [[Frame(half)] for half in samples])["relative"].difference)
        means = [halves._mean(*each) for each in (first, second)]
        known.append(halves._true_error(*means, {0: true})["relative"].difference)
    assert np.mean(said) / np.mean(known) == pytest.approx(1.25, abs=0.04)


def test_equal_results_do_not_differ():
    rng = np.random.default_rng(1)
    samples = rng.random((2, 2, 5, 6, 3)).astype(np.float32)
    given = [[Frame(color) for color in half] for half in samples]
    for found in two_buffer_error(samples, samples, given).values():
        assert found.difference == 0


@pytest.mark.parametrize("start", [-1, 2])
def test_refuses(start):
    image = np.zeros((2, 3, 3), np.float32)
    given = [[Frame(image)] * 2] * 2
    with pytest.raises(ValueError, match="halves: expected as many frames as results"):
        two_buffer_error([[image] * 2] * 2, [[image] * 2] * 2, given, start=start)
    with pytest.raises(ValueError, match=r"halves: .* got \[1, 2\]"):
        two_buffer_error([[image] * 2] * 2, [[image] * 2, [image]], given)


def test_judged(tmp_path, monkeypatch):
    """Both estimates of every component, the predictive error from each half alone, and their table."""
    names = ("demodulation", "choice", "antialiasing")
    some = [each for each in judging.PARTS if each.component in names]
    monkeypatch.setattr(judging, "PARTS", some)
    shape = {"frames": 6, "width": 64, "height": 48, "reference_spp": 16, "references": range(3, 6)}
    first = record("tapestry", tmp_path, **shape, halves=True)
    pair = [first, *first.variants]
    assert (pair[0].frame(3).color != pair[1].frame(3).color).mean() > 0.5
    both, single = halves.judged(*pair)
    assert [each.component for each in both] == [each.component for each in some]
    for one, *others in zip(single, *map(judging.judged, pair), strict=True):
        assert one.component == others[0].component
        for w in one.predicted:
            assert one.predicted[w] == pytest.approx(np.mean([other.predicted[w] for other in others]))
            assert one.clean[w] == pytest.approx(np.mean([other.clean[w] for other in others]))
            assert one.error[w] == pytest.approx(np.hypot(*(other.error[w] for other in others)) / 2)
    for one in both:
        assert one.scene == "tapestry"
        for w in one.predicted:
            assert abs(one.predicted[w] - one.clean[w]) <= 5 * one.error[w]
    parts = {each.component: each for each in both}
    assert parts["demodulation"].gains["psnr"] > 0
    assert parts["demodulation"].predicted["relative"] > 2 * parts["demodulation"].error["relative"]
    assert len(judging.correlations([*both, *single]).splitlines()) == len(both) + 3
