import inspect
from itertools import pairwise

import numpy as np
import pytest
from compare import assert_same_bits
from test_scenes import ids, render
from yester.io import read_exr
from yester.study.rendered import build, fresh, held_out, recording, scenes, sequences, thin, unkind, unseen
from yester.study.rendered.recording import record
from yester.study.rendered.sequences import FRESH, GROUPS, LATE, NAMES, THIN

pytestmark = pytest.mark.slow


def test_names():
    """Each sequence is in one group, and is found by its name."""
    known = (*NAMES, *LATE, *FRESH, *THIN)
    assert {*known} == build.BUILDERS.keys()
    assert len({*known}) == len(known) == sum(map(len, GROUPS.values())) - len(GROUPS["all"])
    assert GROUPS["all"] == NAMES
    assert GROUPS["late-held-out"] == LATE == held_out.NAMES
    assert GROUPS["fresh-held-out"] == FRESH == fresh.NAMES
    assert NAMES[: len(scenes.SEQUENCES) + len(unkind.NAMES)] == scenes.SEQUENCES + unkind.NAMES
    for module in (unkind, unseen, held_out, fresh, thin):
        assert sorted(module.__all__) == sorted(["NAMES", *module.NAMES])
    for name in known:
        assert sequences.find(name).__name__ == name
    for name in ("cornell", "Sequence", "NAMES"):
        with pytest.raises(ValueError, match=f"name: expected one of cornell_box, .*, got '{name}'"):
            sequences.find(name)


def test_recordings_outlive_other_sequences(monkeypatch):
    """Recordings stay valid when code changes that their sequence does not use, and become invalid otherwise."""
    source = inspect.getsource

    def digests(changed):
        monkeypatch.setattr(inspect, "getsource", lambda module: source(module) + "#" * (module is changed))
        return {name: recording._digest(sequences.find(name)) for name in ("cornell_box", "grass", "cut", "carousel")}

    before = digests(None)
    for module, name in ((scenes, "cornell_box"), (unkind, "grass"), (unseen, "cut"), (held_out, "carousel")):
        after = digests(module)
        assert {n for n in before if before[n] != after[n]} == {name}
    for module in (build, recording.renderer):
        assert not set(digests(module).values()) & set(before.values())


@pytest.mark.parametrize("name", [*NAMES[len(scenes.SEQUENCES) :], *LATE, *FRESH, *THIN])
def test_sequence(name):
    """It renders, is exposed like a photograph, and is the same every time."""
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
    # One camera stands still.
    assert (np.median(np.abs(frames[1].motion[..., :2])) > 0.1) == (name != "confetti")


def test_black_plastic():
    """At least a tenth of the image has an albedo too dark for division, beside white and gold."""
    (frame,) = render(unkind.black_plastic(1, 48, 36))
    albedo = frame.albedo.max(-1)
    assert ((albedo > 0) & (albedo < 0.004)).mean() > 0.2
    assert ((albedo > 0.7) & (albedo < 0.9)).mean() > 0.2
    assert (albedo == 1).mean() > 0.01


def test_glassware():
    """Surfaces without a diffuse part fill much of the image, and noise shows the checks behind them."""
    (frame,) = render(unkind.glassware(1, 48, 36))
    number = ids(unkind.glassware(1))
    assert (frame.albedo == 1).all(-1).mean() > 0.15
    assert frame.color[frame.ids == number["pane"]].std() > 0.15


def test_naked_lamps():
    """The lamps are directly visible, and are the only lights."""
    sequence = unkind.naked_lamps(1, 96, 72)
    (frame,) = render(sequence, spp=4)
    seen = frame.emission.max(-1) > 0
    assert 3 <= seen.sum() < 100
    assert frame.emission.max() > 300 * np.percentile(frame.color, 95)
    lights = [name for name, shape in sequence.scene.items() if isinstance(shape, dict) and "emitter" in shape]
    assert len(lights) == 5


def test_grass_before_the_sky():
    """Neighbouring pixels alternate between blades and the brighter sky."""
    (frame,) = render(unkind.grass(1, 48, 36))
    miss = frame.ids == 0
    assert 0.2 < miss.mean() < 0.7
    assert (miss[:, 1:] != miss[:, :-1]).mean() > 0.08
    assert np.median(frame.color[miss]) > 1.5 * np.median(frame.color[~miss])
    assert_same_bits(frame.emission[miss], frame.color[miss])


@pytest.mark.parametrize("frames", [2, 16, 24])
def test_fast_dolly(frames):
    """Depth along the axis changes by 12 % per frame, for any number of frames."""
    cameras = unkind.fast_dolly(frames, 24, 18).cameras
    distance = np.array([np.linalg.norm(camera.position) for camera in cameras])
    np.testing.assert_allclose(distance[1:16] / distance[:15][: len(distance[1:16])], 0.88)
    np.testing.assert_allclose(distance[17:] / distance[16:-1], 1 / 0.88)


# Held out


def test_brushed_metal():
    """Roughness and normals vary without showing in any buffer: the reference has detail within one surface."""
    sequence = unseen.brushed_metal(1, 64, 48)
    number = ids(sequence)
    (guide,) = render(sequence)
    (clean,) = render(sequence, spp=64, buffers=False)
    sheet = guide.ids == number["sheet"]
    rows = [clean.color[y][sheet[y]].mean() for y in range(48) if sheet[y].sum() > 8]
    assert np.std(rows) > 0.15 * np.mean(rows)
    assert np.ptp(guide.albedo[sheet]) == 0


def test_mist():
    """Buffers show the box that contains the mist; its light is scattered."""
    sequence = unseen.mist(1, 48, 36)
    (frame,) = render(sequence)
    bank = frame.ids == ids(sequence)["bank"]
    assert 0.2 < bank.mean() < 0.7
    assert (frame.albedo[bank] == 1).all()
    assert frame.emission is None
    assert frame.color[bank].std() > 0.1


def test_caustics():
    """On the table, one sample in thousands is far brighter than the others, and the mean is bright."""
    sequence = unseen.caustics(1, 48, 36)
    frames, (clean,) = [render(sequence, seed=seed)[0] for seed in range(6)], render(sequence, spp=128, buffers=False)
    table = frames[0].ids == ids(sequence)["table"]
    light = np.stack([frame.color[table].mean(-1) for frame in frames])
    assert light.max() > 20 * np.percentile(light, 90)
    assert clean.color[table].mean(-1).max() > 4 * np.percentile(clean.color[table].mean(-1), 90)


def test_passer_by():
    """It covers at least a fifth of the image and moves much faster than anything else."""
    frames = render(unseen.passer_by(8, 48, 36))
    ball = ids(unseen.passer_by(1))["ball"]
    assert max((frame.ids == ball).mean() for frame in frames) > 0.2
    speed = np.linalg.norm(frames[4].motion[..., :2], axis=-1)
    assert np.median(speed[frames[4].ids == ball]) > 5 * np.median(speed[frames[4].ids != ball])


@pytest.mark.parametrize("frames", [2, 7, 16])
def test_cut(frames):
    """The camera jumps once, in the middle."""
    cameras = unseen.cut(frames, 24, 18).cameras
    steps = [np.linalg.norm(b.position - a.position) for a, b in pairwise(cameras)]
    assert [i + 1 for i, step in enumerate(steps) if step > 2] == [frames // 2]
    assert sum(step > 1 for step in steps) == 1


@pytest.mark.long
def test_shallow_focus(tmp_path):
    """Samples of one pixel hit different surfaces at different instants; the reference is their mean."""
    sequence = unseen.shallow_focus(4, 48, 36)
    options = {"frames": 4, "width": 48, "height": 36, "references": [2], "reference_spp": 192}
    one, other = (record("shallow_focus", tmp_path, seed=seed, **options) for seed in (0, 10))
    near = ids(sequence)["near post"]
    seen = [shot.frame(2).ids == near for shot in (one, other)]
    assert (seen[0] != seen[1]).mean() > 0.03
    instants = [camera.position for camera, _ in sequence.instants[2]]
    assert len({tuple(position) for position in instants}) == 6
    assert_same_bits(instants[0], sequence.cameras[2].position)
    # Pixels that the cube crosses while the shutter is open are neither all cube nor all background.
    masks = []
    for instant in (0, 5):
        camera, poses = sequence.instants[2][instant]
        (frame,) = render(scenes.Sequence(sequence.scene, [camera], [poses], [{}]))
        masks.append(frame.ids == ids(sequence)["cube"])
    mixed = one.frame(2).ids == ids(sequence)["cube"]
    only = masks[1] & ~masks[0]
    assert 0.05 < mixed[only].mean() < 0.95
    # Frames and the reference differ by noise alone.
    frames = [next(recording.render_noisy(sequence, range(2, 3), seed))[0].color for seed in range(20, 32)]
    reference = one.reference(2)
    assert abs(np.mean(frames, 0) - reference).mean() < 0.5 * abs(frames[0] - reference).mean()
    assert np.mean(frames) == pytest.approx(reference.mean(), rel=0.03)


def test_exposures_come_back_as_they_were(tmp_path):
    """Any file, with the same bits; the first frame has no motion, later motion leads one frame back."""
    options = {"frames": 3, "width": 24, "height": 18, "reference_spp": 6, "seed": 3, "raw_albedo": True}
    made = record("shallow_focus", tmp_path, **options)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*.exr")}
    assert len(before) == 3 + 2 + 3
    for path in (made.frames[2], made.references[1], made.raw_albedo[0]):
        path.unlink()
    assert record("shallow_focus", tmp_path, **options) == made
    assert {path: path.read_bytes() for path in before} == before
    assert not made.frame(0).motion[made.frame(0).motion[..., 2] == 0].any()
    frame, sequence = made.frame(2), unseen.shallow_focus(3, 24, 18)
    which = recording._instants(sequence, 2, 3, frame.ids.shape)
    for instant, ((then, _), (now, _)) in enumerate(zip(*sequence.instants[1:], strict=True)):
        still = (frame.ids > 0) & (frame.ids != ids(sequence)["cube"]) & (which == instant)
        there, here = (camera.project(frame.position)[0] for camera in (then, now))
        assert still.any()
        np.testing.assert_allclose(frame.motion[still][:, :2], (there - here)[still], atol=1e-3)


@pytest.mark.parametrize("name", ["black_plastic", "glassware", "shallow_focus"])
def test_raw_albedo(tmp_path, name):
    """Albedo of the frame's own samples, except on surfaces without a diffuse part."""
    options = {"frames": 2, "width": 48, "height": 36, "references": ()}
    recording = record(name, tmp_path, **options, raw_albedo=True)
    assert record(name, tmp_path, **options).raw_albedo == {}
    for i in range(2):
        albedo, raw = recording.frame(i).albedo, read_exr(recording.raw_albedo[i]).color
        specular = (albedo == 1).all(-1)
        assert_same_bits(albedo[~specular], raw[~specular])
        if name == "glassware":
            assert (raw[specular] == 0).all(-1).mean() > 0.5
        elif name == "black_plastic":
            assert np.ptp(raw[specular]) > 0.5
