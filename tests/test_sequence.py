"""Whole sequences, rendered by Mitsuba, against many samples per pixel of the same renderer."""

import numpy as np
import pytest
import yester
from yester.io.mitsuba import render_sequence
from yester.study.metrics import psnr, srgb
from yester.study.scenes import cornell_box

WIDTH, HEIGHT, FRAMES = 96, 72, 16


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
    # In place and across surfaces, as the renderer's own mean would be: its edges are those of many samples.
    svgf = yester.SVGF(alpha=0, iterations=0)
    outputs = [svgf.step(yester.Frame(frame.color)) for frame in frames]
    np.testing.assert_allclose(
        outputs[-1].color, np.mean([frame.color for frame in frames], 0, np.float64), rtol=1e-4, atol=1e-6
    )
    reference = truth(sequence, 0)
    errors = [np.mean((np.minimum(output.color, 4) - np.minimum(reference, 4)) ** 2) for output in outputs]
    for n in (2, 4, 8, 16):
        assert errors[n - 1] == pytest.approx(errors[0] / n, rel=0.35)


def test_history_and_filter_each_help():
    """Noisy is worse than filtered alone or accumulated alone, and both of these are worse than both together.

    With a moving camera in a still scene, where no light changes, and away from edges of surfaces and of texture, which
    stay as jagged as those of one sample, while the reference's are smooth.
    """
    sequence = cornell_box(FRAMES, WIDTH, HEIGHT)
    sequence.transforms[:] = sequence.transforms[-1:] * FRAMES
    frames = list(render_sequence(sequence.scene, sequence.cameras, transforms=sequence.transforms))
    reference = truth(sequence, FRAMES - 1)
    marks = np.dstack([frames[-1].ids, frames[-1].albedo])
    padded = np.pad(marks, ((1, 1), (1, 1), (0, 0)), mode="edge")
    neighbours = [padded[y : y + HEIGHT, x : x + WIDTH] for y in range(3) for x in range(3)]
    within = (np.ptp(neighbours, 0) < 1e-3).all(-1)

    def error(color):
        return np.mean((srgb(color) - srgb(reference))[within] ** 2)

    def last(**parameters):
        svgf = yester.SVGF(**parameters)
        for frame in frames:
            output = svgf.step(frame)
        return error(output.color)

    accumulated, filtered, both = last(iterations=0), last(alpha=1), last()
    assert accumulated < 0.5 * error(frames[-1].color)
    assert filtered < 0.5 * error(frames[-1].color)
    assert both < 0.9 * min(accumulated, filtered)


def test_exact_motion_beats_none(moving):
    """What the motion vectors are for."""
    frames, reference = moving

    def last(keep):
        svgf = yester.SVGF(iterations=0)
        for frame in frames:
            output = svgf.step(yester.Frame(**keep(frame.buffers()), camera=frame.camera))
        return psnr(output.color, reference)

    exact = last(lambda buffers: buffers)
    # Without them the cameras still tell where everything but the cube was.
    cameras = last(lambda buffers: {name: value for name, value in buffers.items() if name != "motion"})
    none = last(lambda buffers: {name: buffers[name] for name in ("color", "albedo", "emission")})
    assert exact > cameras > none
