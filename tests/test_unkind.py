import inspect

import numpy as np
import pytest
from compare import assert_same_bits
from test_scenes import ids, render
from yester.study import recording, scenes, sequences, unkind
from yester.study.sequences import GROUPS, NAMES


def test_names():
    """Each sequence is in one group, and is found by its name."""
    assert len(set(NAMES)) == len(NAMES) == sum(map(len, GROUPS.values())) - len(GROUPS["all"])
    assert GROUPS["all"] == NAMES
    assert NAMES[: len(scenes.SEQUENCES) + len(unkind.NAMES)] == scenes.SEQUENCES + unkind.NAMES
    assert sorted(unkind.__all__) == sorted(["NAMES", *unkind.NAMES])
    for name in NAMES:
        assert sequences.find(name).__name__ == name
    for name in ("cornell", "Sequence", "NAMES"):
        with pytest.raises(ValueError, match=f"name: expected one of cornell_box, .*, got '{name}'"):
            sequences.find(name)


def test_recordings_outlive_other_sequences(monkeypatch):
    """What a sequence does not use may change, and its recordings stay valid; what it uses may not."""
    source = inspect.getsource

    def digests(changed):
        monkeypatch.setattr(inspect, "getsource", lambda module: source(module) + "#" * (module is changed))
        return {name: recording._digest(sequences.find(name)) for name in ("cornell_box", "grass")}

    before = digests(None)
    assert digests(unkind)["cornell_box"] == before["cornell_box"]
    assert digests(unkind)["grass"] != before["grass"]
    for module in (scenes, recording.renderer):
        assert not set(digests(module).values()) & set(before.values())


@pytest.mark.parametrize("name", NAMES[len(scenes.SEQUENCES) :])
def test_sequence(name):
    """It renders at about the exposure of a photograph, and is the same every time."""
    first, again = (sequences.find(name)(2, 24, 18) for _ in range(2))
    assert len(first.cameras) == len(first.transforms) == len(first.parameters) == 2
    frames = render(first)
    for frame, other in zip(frames, render(again), strict=True):
        assert frame.shape == (18, 24)
        assert np.isfinite(frame.color).all()
        assert np.isfinite(frame.depth).mean() > 0.3
        assert len(np.unique(frame.ids)) > 2
        assert 0.02 < np.percentile(frame.color, 75) < 2
        for buffer, array in frame.buffers().items():
            assert_same_bits(array, other.buffers()[buffer])
    assert np.median(np.abs(frames[1].motion[..., :2])) > 0.1


def test_black_plastic():
    """A tenth of the image and more has an albedo that light cannot be divided by, beside white and gold."""
    (frame,) = render(unkind.black_plastic(1, 48, 36))
    albedo = frame.albedo.max(-1)
    assert ((albedo > 0) & (albedo < 0.004)).mean() > 0.2
    assert ((albedo > 0.7) & (albedo < 0.9)).mean() > 0.2
    assert (albedo == 1).mean() > 0.01


def test_glassware():
    """Surfaces without any diffuse part fill much of the image, and noise shows the checks behind them."""
    (frame,) = render(unkind.glassware(1, 48, 36))
    number = ids(unkind.glassware(1))
    assert (frame.albedo == 1).all(-1).mean() > 0.15
    assert frame.color[frame.ids == number["pane"]].std() > 0.15


def test_naked_lamps():
    """The lamps are seen directly, and nothing else is a light."""
    sequence = unkind.naked_lamps(1, 96, 72)
    (frame,) = render(sequence, spp=4)
    seen = frame.emission.max(-1) > 0
    assert 3 <= seen.sum() < 100
    assert frame.emission.max() > 300 * np.percentile(frame.color, 95)
    lights = [name for name, shape in sequence.scene.items() if isinstance(shape, dict) and "emitter" in shape]
    assert len(lights) == 5


def test_grass_before_the_sky():
    """Neighbours are blades and sky by turns, and the sky is the brighter one."""
    (frame,) = render(unkind.grass(1, 48, 36))
    miss = frame.ids == 0
    assert 0.2 < miss.mean() < 0.7
    assert (miss[:, 1:] != miss[:, :-1]).mean() > 0.08
    assert np.median(frame.color[miss]) > 1.5 * np.median(frame.color[~miss])
    assert_same_bits(frame.emission[miss], frame.color[miss])


@pytest.mark.parametrize("frames", [2, 16, 24])
def test_fast_dolly(frames):
    """Depth along the axis changes by 12 % a frame, however many there are."""
    cameras = unkind.fast_dolly(frames, 24, 18).cameras
    distance = np.array([np.linalg.norm(camera.position) for camera in cameras])
    np.testing.assert_allclose(distance[1:16] / distance[:15][: len(distance[1:16])], 0.88)
    np.testing.assert_allclose(distance[17:] / distance[16:-1], 1 / 0.88)
