"""Whole sequences rendered by Mitsuba, against references of many samples per pixel."""

import numpy as np
import pytest
import yester
from yester.io.mitsuba import render_sequence
from yester.metrics import psnr, srgb
from yester.study.rendered.scenes import cornell_box

pytestmark = pytest.mark.slow

WIDTH, HEIGHT, FRAMES = 96, 72, 16
# Accumulation and filter alone.
PLAIN = {"gradient": False, "fireflies": False, "antialias": False}


def truth(sequence, index):
    shot = slice(index, index + 1)
    (frame,) = render_sequence(
        sequence.scene,
        sequence.cameras[shot],
        spp=256,
        seed=1000,
        transforms=sequence.transforms[shot],
        buffers=False,
    )
    return frame.color


@pytest.fixture(scope="module")
def moving():
    sequence = cornell_box(FRAMES, WIDTH, HEIGHT)
    frames = list(render_sequence(sequence.scene, sequence.cameras, transforms=sequence.transforms))
    return frames, truth(sequence, FRAMES - 1)


def test_a_still_scene_converges():
    """Without the spatial filter, a running mean: a sixteenth of the variance after sixteen frames."""
    sequence = cornell_box(FRAMES, WIDTH, HEIGHT)
    still = [sequence.cameras[0]] * FRAMES, [sequence.transforms[0]] * FRAMES
    frames = list(render_sequence(sequence.scene, still[0], transforms=still[1]))
    # Without validation, as the renderer's own mean: its edges are those of many samples.
    svgf = yester.SVGF(alpha=0, iterations=0, choice=False, innovation=False, **PLAIN)
    outputs = [svgf.step(yester.Frame(frame.color)) for frame in frames]
    np.testing.assert_allclose(
        outputs[-1].color, np.mean([frame.color for frame in frames], 0, np.float64), rtol=1e-4, atol=1e-6
    )
    reference = truth(sequence, 0)
    errors = [np.mean((np.minimum(output.color, 4) - np.minimum(reference, 4)) ** 2) for output in outputs]
    for n in (2, 4, 8, 16):
        assert errors[n - 1] == pytest.approx(errors[0] / n, rel=0.35)


@pytest.fixture(scope="module")
def flown():
    """A moving camera in a static scene under constant light; references, and masks without edges."""
    sequence = cornell_box(FRAMES, WIDTH, HEIGHT)
    sequence.transforms[:] = sequence.transforms[-1:] * FRAMES
    frames = list(render_sequence(sequence.scene, sequence.cameras, transforms=sequence.transforms))
    marks = np.dstack([frames[-1].ids, frames[-1].albedo])
    padded = np.pad(marks, ((1, 1), (1, 1), (0, 0)), mode="edge")
    neighbours = [padded[y : y + HEIGHT, x : x + WIDTH] for y in range(3) for x in range(3)]
    within = (np.ptp(neighbours, 0) < 1e-3).all(-1)
    return frames, truth(sequence, FRAMES - 1), within


def last(frames, **parameters):
    svgf = yester.SVGF(**parameters)
    for frame in frames:
        output = svgf.step(frame)
    return output.color


def test_history_and_filter_each_help(flown):
    """Filter and accumulation each reduce the error of the noisy input, and together reduce it further.

    Away from edges of surfaces and textures, which stay as jagged as with one sample, while the reference's are smooth.
    """
    frames, reference, within = flown

    def error(color):
        return np.mean((srgb(color) - srgb(reference))[within] ** 2)

    accumulated = error(last(frames, iterations=0, choice=False, **PLAIN))
    filtered = error(last(frames, alpha=1, **PLAIN))
    both = error(last(frames, **PLAIN))
    assert accumulated < 0.5 * error(frames[-1].color)
    assert filtered < 0.5 * error(frames[-1].color)
    assert both < 0.9 * min(accumulated, filtered)


def test_more_stages_help(flown):
    """Firefly suppression away from edges, antialiasing at edges, and all stages together."""
    frames, reference, within = flown

    def error(color, where=slice(None)):
        return np.mean((srgb(color) - srgb(reference))[where] ** 2)

    plain = last(frames, **PLAIN)
    assert error(last(frames, **PLAIN | {"fireflies": True}), within) < 0.97 * error(plain, within)
    assert error(last(frames, **PLAIN | {"antialias": True}), ~within) < 0.6 * error(plain, ~within)
    assert error(last(frames)) < 0.6 * error(plain)
    assert error(last(frames), within) < 0.95 * error(plain, within)


def test_exact_motion_beats_none(moving):
    """Motion vectors reduce the error."""
    frames, reference = moving

    def quality(keep, **named):
        kept = [yester.Frame(**keep(frame.buffers()), camera=frame.camera) for frame in frames]
        return psnr(last(kept, iterations=0, choice=False, **named), reference)

    for named in ({}, PLAIN):
        exact = quality(lambda buffers: buffers, **named)
        # Without them the cameras still give the motion of everything but the cube.
        cameras = quality(lambda buffers: {name: value for name, value in buffers.items() if name != "motion"}, **named)
        none = quality(lambda buffers: {name: buffers[name] for name in ("color", "albedo", "emission")}, **named)
        assert exact > cameras > none


def test_later_frames_help():
    """Both directions are better than one; motion to the next frame need not be given, as motion can be inverted."""
    sequence = cornell_box(FRAMES, WIDTH, HEIGHT)
    frames = list(render_sequence(sequence.scene, sequence.cameras, transforms=sequence.transforms, next=True))
    bare = [
        yester.Frame(
            **{name: buffer for name, buffer in frame.buffers().items() if name != "motion_next"}, camera=frame.camera
        )
        for frame in frames
    ]
    middle = 5
    reference = truth(sequence, middle)
    quality = [
        psnr([*yester.denoise(given, lookahead=lookahead)][middle].color, reference)
        for given, lookahead in ((frames, 0), (frames, 4), (bare, 4))
    ]
    assert quality[1] > quality[0] + 0.5
    assert quality[2] == pytest.approx(quality[1], abs=0.1)
