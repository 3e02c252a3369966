"""Tiles of the output stage that leave their history unclipped (`TAA(clip_choice=True)`)."""

from types import SimpleNamespace

import composed
import numpy as np
import pytest
import reference
import yester
from compare import assert_close, assert_same_bits, tensor


def texture(height=40, width=56, seed=3):
    """A mean for each pixel that the colours around it mostly do not contain."""
    return np.random.default_rng(seed).uniform(0.1, 0.9, (height, width, 3)).astype(np.float32)


def frames(count, *, light=lambda number: 1.0, noise=0.2, seed=0, plain=0):
    """Noisy frames of a texture that moves by (-1, 0) and has no detail in some rows; the truth of each."""
    rng, still = np.random.default_rng(seed), texture()
    still[:plain] = 0.5
    height, width, _ = still.shape
    for number in range(count):
        albedo = np.roll(still, -number, 1)
        shade = light(number) * rng.gamma(1 / noise**2, noise**2, (height, width, 1))
        motion = np.broadcast_to(np.float32([1, 0]), (height, width, 2))
        depth = np.full((height, width), 5, np.float32)
        color = (albedo * shade).astype(np.float32)
        yield yester.Frame(color, albedo=albedo, depth=depth, motion=motion), light(number) * albedo


def errors(shown, **given) -> list[float]:
    stage = yester.TAA("denoised", innovation=True, choice=False, clip_choice=shown)
    found = []
    for frame, truth in frames(14, noise=0.1, **given):
        output = stage.step(frame, samples=frame.color)
        found.append(float(np.abs(output.color - truth)[4:-4, 4:-4].mean()))
    return found


def test_texture_as_fine_as_the_pixels_is_kept():
    chosen, clipped = errors(True), errors(False)
    assert chosen[:2] == clipped[:2], "nothing is known yet"
    assert np.mean(chosen[7:]) < 0.6 * np.mean(clipped[7:])


def test_light_that_changes_is_clipped():
    """Where history lags, it is clipped as before, whatever the frames before have chosen."""
    lit = {"light": lambda number: 1.0 if number < 9 else 2.0 + 0.2 * number}
    chosen, clipped = errors(True, **lit), errors(False, **lit)
    assert np.mean(chosen[4:9]) < 0.8 * np.mean(clipped[4:9])
    assert np.mean(chosen[9:]) < 1.02 * np.mean(clipped[9:])


def test_it_is_its_kernels():
    """The pipeline has the bits of the functions that it consists of, in tiles that have chosen either."""
    svgf, other = yester.SVGF(), composed.SVGF()
    levels = []
    for frame, _ in frames(9, plain=28):
        got, want = svgf.step(frame), other.step(frame)
        assert_same_bits(got.color, want.color)
        if other.clipping is not None:
            levels.append(float(other.clipping.level.mean()))
    assert 0.05 < max(levels) < 0.95


def test_against_the_reference():
    svgf, other = yester.SVGF(reflections=()), reference.SVGF()
    names = "color", "albedo", "depth", "motion"
    for frame, _ in frames(7):
        empty = dict.fromkeys((*yester.frame.BUFFERS, "camera", "jitter"))
        given = SimpleNamespace(**empty | {name: tensor(getattr(frame, name)) for name in names})
        got, want = svgf.step(frame).color, other.step(given).color
        where = {"where": np.ones(frame.shape, bool), "flips": 40 * 56 // 200}
        assert_close("a chosen clip", got, want, rtol=1e-4, **where)
    assert float(other.clipping.level.max()) > 0.5


@pytest.mark.parametrize("given", [{"innovation": False}, {"clip_choice": False}])
def test_without_it_nothing_is_chosen(given):
    """Without innovation nothing tells where history lags, and the clip always holds."""
    one, other = (
        yester.TAA("denoised", **{"innovation": True} | given | more) for more in ({}, {"clip_choice": False})
    )
    for frame, _ in frames(6):
        images = [stage.step(frame, samples=frame.color).color for stage in (one, other)]
        assert_same_bits(*images)
