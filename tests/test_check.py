"""Every planted mistake is named, and none is found without one."""

from dataclasses import replace
from itertools import pairwise

import layouts
import numpy as np
import pytest
import yester
from yester import cli
from yester.conventions.findings import judged
from yester.io import write_sequence
from yester.study.compare import mistakes
from yester.study.compare.mistakes import MISTAKES, findings, sequence
from yester.study.synthetic.raycast import Rectangle, Scene, Sphere, Thing, checker, shoot, translate

#: One of each kind for the quick part of the suite. With fewer buffers, mistakes are planted every night.
QUICK = ("NDC, y up", "transposed matrix")


def named(mistake):
    return f"{mistake.name} ({'jittered, ' * mistake.jittered}{len(mistake.buffers)} buffers)"


def every():
    seen = set()
    for mistake in MISTAKES:
        again = mistake.name in seen
        quick = mistake.name in QUICK and not again
        seen.add(mistake.name)
        marks = [] if quick else [pytest.mark.slow, pytest.mark.long] if again else [pytest.mark.slow]
        yield pytest.param(mistake, id=named(mistake), marks=marks)


@pytest.mark.parametrize("mistake", [*every()])
def test_planted_mistakes_are_named(mistake):
    found = findings(mistake)
    wrong = {finding.subject: finding for finding in found if finding.verdict == "wrong"}
    assert wrong.keys() == {mistake.subject} - {""}, "\n".join(map(str, found))
    for finding in wrong.values():
        assert finding.stored.startswith(mistake.stored)
        assert finding.remedy
        if np.isfinite(finding.margin):
            assert finding.margin > 3 * finding.error >= 0


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2])
def test_no_mistake_is_found_without_one(seed):
    """Of noise far above the light, too."""
    for mistake in MISTAKES:
        if not mistake.subject:
            found = findings(mistake, seed=seed, deviation=2.0)
            assert "wrong" not in [finding.verdict for finding in found], "\n".join(map(str, found))


def shifted(motion, count=4, size=(80, 120)):
    """A texture that moves by whole pixels, faster and faster, with the motion that is made of its true one."""
    texture = np.random.default_rng(0).random((*size, 3), np.float32)
    places = [(i * i, 2 * i + i * i) for i in range(count)]
    for i, place in enumerate(places):
        y, x = np.subtract(places[max(i - 1, 0)], place)
        image = np.roll(texture, place, (0, 1))
        vectors = np.full((*size, 2), motion(x, y), np.float32)
        yield yester.Frame(image, albedo=image, motion=vectors)


def test_the_matrix_makes_motion_canonical():
    right = [*shifted(lambda x, y: (x, y))]
    assert yester.check_motion(right).verdict == "right"
    np.testing.assert_array_equal(yester.check_motion(right).matrix, np.eye(2))
    wrong = [*shifted(lambda x, y: (y / 40, x / 60))]
    finding = yester.check_motion(wrong)
    assert (finding.verdict, finding.stored) == ("wrong", "normalised device coordinates, (row, column) order")
    for frame, before in zip(right, wrong, strict=True):
        np.testing.assert_allclose(before.motion @ finding.matrix.T, frame.motion, rtol=1e-6)


def test_channels_are_named_with_what_was_done_to_them():
    """Vertical motion was turned at the door, which was wrong: the remedy is to take it as it is."""
    finding = yester.check_motion(
        shifted(lambda x, y: (x, -y)), channels={"motion": [(1.0, "Vector.X"), (-1.0, "Vector.Y")]}
    )
    assert finding.remedy == "--map motion=Vector.X,Vector.Y"
    finding = yester.check_motion(
        shifted(lambda x, y: (2 * x, -2 * y)), channels={"motion": [(120.0, "mvec.X"), (80.0, "mvec.Y")]}
    )
    assert finding.remedy == "--map motion=mvec.X,-mvec.Y --map motion.unit=ndc"


def test_a_still_scene_tells_nothing():
    frame = next(shifted(lambda x, y: (x, y)))
    finding = yester.check_motion([frame] * 3)
    assert finding.verdict == "unclear"
    assert "y up" in finding.rivals
    assert not finding.remedy
    assert "and" in str(finding)


def slow(step, count=4):
    """Exact motion of fractions of a pixel before sharp texture, which no interpolation reproduces."""
    things = (
        Thing(Rectangle(20, 20), translate(0, 0, -1), checker((0.8, 0.7, 0.6), (0.2, 0.3, 0.4), 0.25)),
        Thing(Sphere(0.5), translate(0, 0, 0.2)),
    )
    eyes = [(step * i, 0.7 * step * i, 0) for i in range(count)]
    cameras = [yester.Camera.from_look_at((x, y, 3), (x, y, 0), (0, 1, 0), 45, 64, 48) for x, y, _ in eyes]
    scenes = [Scene(things, camera, ambient=(1, 1, 1)) for camera in cameras]
    rng = np.random.default_rng(0)
    return [shoot(now, before, rng, jitter=(0, 0)) for before, now in pairwise([scenes[0], *scenes])]


@pytest.mark.parametrize("step", [0.006, 0.012])
def test_slow_motion_is_not_wrong(step):
    """It blurs more than it moves: images prefer history in place, but cameras tell."""
    frames = slow(step)
    assert np.linalg.norm(frames[-1].motion[..., :2], axis=-1).max() < 0.6
    for geometry in ("position", "depth"):
        left_out = {"depth", "position"} - {geometry}
        finding = yester.check_motion(replace(frame, **dict.fromkeys(left_out)) for frame in frames)
        assert (finding.verdict, finding.witnesses) == ("right", ("camera", geometry))
    for left_out in (("camera",), ("position", "depth"), ("position", "depth", "normal", "ids")):
        finding = yester.check_motion(replace(frame, **dict.fromkeys(left_out)) for frame in frames)
        assert (finding.verdict, finding.remedy) == ("unclear", "")
        assert "unrelated: history in place agrees better" in finding.rivals
    wrong = [replace(frame, motion=frame.motion * np.float32([1, -1, 1])) for frame in frames]
    finding = yester.check_motion(wrong)
    assert (finding.verdict, finding.stored, finding.witnesses) == ("wrong", "y up", ("camera", "position"))
    np.testing.assert_array_equal(finding.matrix, np.diag([1, -1]))
    assert yester.check_motion(replace(frame, camera=None) for frame in wrong).verdict == "unclear"


def test_frames_that_lack_a_buffer_are_numbered():
    frames = slow(0.012)
    frames[2] = replace(frames[2], albedo=None, motion=None)
    said = {finding.subject: finding.stored for finding in yester.check(frames)}
    assert said["albedo"] == "no albedo in frame 3 of 4"
    assert said["motion"] == "no motion vectors in frame 3 of 4"
    bare = yester.check([replace(frame, ids=None, normal=None) for frame in frames])
    assert {"no ids", "no normals"} <= {finding.stored for finding in bare}


def test_no_relation_must_beat_all_others():
    rng = np.random.default_rng(0)
    for other, verdict, index in ((0.7, "wrong", 1), (0.4, "unclear", None)):
        means = np.array([0.7, 0.4, other])[:, None]
        finding, chosen = judged("motion", "abc", "123", means + rng.normal(0, 0.01, (3, 50)), ["ids"], null=1)
        assert (finding.verdict, chosen) == (verdict, index)


def test_cameras_that_nothing_makes_fit():
    """They get no remedy, and nothing else is judged by them."""
    layout = np.array([[2, 0, 0, -1], [0, -2, 0, 1], [0, 0, 1, 0], [0, 0, 0, 1]])
    frames = [
        replace(frame, camera=yester.Camera(layout @ frame.camera.world_to_clip, frame.width, frame.height))
        for frame in sequence()
    ]
    for left_out in ((), ("position",)):
        found = yester.check([replace(frame, **dict.fromkeys(left_out)) for frame in frames])
        cameras, depth, motion, _, normal, *_ = found
        assert (cameras.verdict, cameras.stored, cameras.remedy) == ("unclear", "no known convention fits", "")
        assert motion.verdict == "right"
        assert {depth.verdict, normal.verdict} <= {"right", "unchecked"}
    *_, normal, _, _ = yester.check([replace(frame, position=None, motion=None) for frame in frames])
    assert (normal.verdict, normal.stored) == ("unclear", "camera space, z backwards, if the cameras are right")


def test_a_cut_is_no_mistake():
    rng = np.random.default_rng(0)
    images = rng.random((4, 80, 120, 3), np.float32)
    frames = [replace(f, color=i, albedo=i) for f, i in zip(shifted(lambda x, y: (x, y)), images, strict=True)]
    finding = yester.check_motion(frames)
    assert (finding.verdict, finding.stored) == ("unclear", "no hypothesis explains the frames, as at a cut")


def test_two_frames_are_enough():
    frames = [*shifted(lambda x, y: (x, -y))][2:]
    assert yester.check_motion(frames).stored == "y up"


def test_small_units_are_found_by_colour_alone():
    """Stored vectors near zero are no reason to expect little disagreement: noise alone is more."""
    motion = np.float32([160, 120])
    frames = [yester.Frame(f.color, motion=f.motion[..., :2] / motion) for f in sequence(deviation=1)]
    finding = yester.check_motion(frames)
    assert (finding.verdict, finding.stored) == ("wrong", "fractions of the image's sides")


@pytest.mark.parametrize(
    ("factors", "verdict", "stored"),
    [
        ((1, 1), "right", "previous minus current position, in pixels, y down"),
        ((1, -1), "wrong", "y up"),
        ((1 / 120, 1 / 80), "wrong", "fractions of the image's sides"),
    ],
)
def test_where_guides_show_no_motion_colour_tells(factors, verdict, stored):
    slope = np.linspace(5, 5.1, 80, dtype=np.float32)[:, None] * np.ones(120, np.float32)
    frames = [replace(f, albedo=None, depth=slope) for f in shifted(lambda x, y: np.multiply((x, y), factors))]
    finding = yester.check_motion(frames)
    assert (finding.verdict, finding.stored, finding.witnesses) == (verdict, stored, ("color",))


@pytest.mark.parametrize(
    ("stored", "change", "remedy"),
    [
        ("next minus current position, in pixels, y down", lambda back, on: on, ""),
        ("y up", lambda back, on: on * [1, -1], "motion_next=motion_next.X,-motion_next.Y"),
        ("current minus next position", lambda back, on: -on, "motion_next=-motion_next.X,-motion_next.Y"),
        ("to the previous frame", lambda back, on: back, "motion=motion_next.X,motion_next.Y"),
        ("of the next frame", lambda back, on: np.add(on, 2), "from the file of the previous frame"),
    ],
)
def test_motion_to_the_next_frame(stored, change, remedy):
    """It has a finding of its own. The last frame needs none."""
    frames = [*shifted(lambda x, y: (x, y), 5)]
    frames[:-1] = [replace(f, motion_next=change(f.motion, -following.motion)) for f, following in pairwise(frames)]
    *found, finding = yester.check(frames)
    assert (finding.subject, finding.stored, finding.verdict) == ("motion_next", stored, "wrong" if remedy else "right")
    assert remedy in finding.remedy
    assert found[2].verdict == "right"
    assert "motion_next" not in [each.subject for each in found]


@pytest.mark.slow
def test_large_frames_are_thinned_first():
    frames = shifted(lambda x, y: (x / 800, -y / 600), 3, (600, 800))
    assert yester.check_motion(frames).stored == "fractions of the image's sides, y up"


def test_frames_without_guides():
    found = yester.check([yester.Frame(frame.color) for frame in shifted(lambda x, y: (x, y))])
    assert {finding.verdict for finding in found} == {"unchecked"}
    assert [finding.subject for finding in found] == ["cameras", "depth", "motion", "jitter", "normal", "albedo", "ids"]


def test_ids_that_change():
    """Wrong if most surfaces have others, unclear if many have. Surfaces are found along the cameras' motion, too."""
    frames = sequence()[:3]
    still = [replace(frame, motion=None) for frame in frames]
    assert yester.check(still)[-1].verdict == "right"
    for share, verdict in ((0.1, "right"), (0.4, "unclear"), (0.7, "wrong")):
        changed = [replace(frame, ids=frame.ids.copy()) for frame in still]
        columns = int(share * frames[0].width)
        changed[1].ids[:, :columns] += 10
        found = yester.check(changed[:2])[-1]
        assert (found.subject, found.verdict) == ("ids", verdict), found
        assert found.witnesses == ("camera",)
    flat = [
        replace(frame, depth=np.full(frame.shape, depth, np.float32), position=None)
        for frame, depth in zip(still, (1, 50), strict=False)
    ]
    assert yester.check(flat)[-1].stored == "too few surfaces are found in the frame before"


def test_bad_input():
    frame, other, *_ = shifted(lambda x, y: (x, y))
    for check in (yester.check, yester.check_motion):
        with pytest.raises(ValueError, match="frames: expected at least two, got 1"):
            check([frame])
        with pytest.raises(ValueError, match="frames: expected one size"):
            check([frame, yester.Frame(other.color[1:])])
        with pytest.raises(TypeError, match=r"frames: expected yester\.Frame, got ndarray at 1"):
            check([frame, frame.color])
    with pytest.raises(ValueError, match="frames: expected motion"):
        yester.check_motion([frame, replace(other, motion=None)])


@pytest.mark.parametrize("missing", [np.nan, np.inf, 1e30, 3e38])
def test_missing_values_are_no_evidence(missing):
    frames = [*shifted(lambda x, y: (x, -y))]
    for frame in frames:
        frame.motion[:20] = missing
        frame.albedo[30:40, :50] = np.inf
    assert yester.check_motion(frames).stored == "y up"
    assert yester.check(frames)[2].stored == "y up"


def wall(*, sky=False, size=(32, 48), shift=0.0):
    """A frame of a wall that fills the image, or of background alone."""
    height, width = size
    camera = yester.Camera.from_look_at([shift, 2, 5], [shift, 0, 0], [0, 1, 0], 60, width, height)
    depth = np.full(size, np.inf if sky else 5.0, np.float32)
    pixels = np.stack(np.mgrid[:height, :width][::-1], -1) + 0.5
    position = np.full((*size, 3), np.nan) if sky else camera.unproject(pixels, depth)
    return yester.Frame(np.ones((*size, 3)), depth=depth, position=position, camera=camera)


def test_frames_of_background_alone():
    """One tells nothing, and the others are judged without it."""
    cameras, depth, *_ = yester.check([wall(shift=0.5 * i, sky=i == 2) for i in range(4)])
    assert (cameras.verdict, depth.verdict) == ("right", "right")
    _, depth, *_ = yester.check([wall(sky=True)] * 3)
    assert (depth.verdict, depth.stored) == (
        "unclear",
        "distance along the camera axis, as expected; too little to compare",
    )


@pytest.mark.parametrize("size", [(1, 1), (1, 48), (48, 1)])
def test_images_of_one_row(size):
    frames = [wall(size=size, shift=0.1 * i) for i in range(4)]
    frames = [
        replace(frame, motion=yester.motion_vectors(frame.depth, frame.camera, frames[max(i - 1, 0)].camera))
        for i, frame in enumerate(frames)
    ]
    assert "wrong" not in [finding.verdict for finding in yester.check(frames)]


@pytest.mark.parametrize("missing", [np.nan, np.inf, 1e30])
def test_missing_normals_tell_nothing_about_albedo(missing):
    frames = slow(0.006)
    frames = [replace(frame, albedo=0.1 + 0.8 * abs(frame.normal[..., :1]) * [1, 1, 1]) for frame in frames]
    frames = [replace(frame, color=0.9 * frame.albedo) for frame in frames]
    lit = yester.check(frames)[5]
    assert lit.verdict == "wrong"
    for frame in frames:
        frame.normal[:2] = missing
    assert yester.check(frames)[5].stored == lit.stored


def test_paint_that_follows_normals():
    """In even light, colour follows paint. It is told from light by its hues."""
    frames = slow(0.006)
    for hues, verdict in (([1, 1, 1], "wrong"), (frames[0].normal, "unclear")):
        paint = [0.1 + 0.8 * abs(frame.normal[..., :1] * hues) for frame in frames]
        frames = [replace(f, albedo=a, color=0.9 * a) for f, a in zip(frames, paint, strict=True)]
        assert yester.check(frames)[5].verdict == verdict
    frames = [replace(frame, color=frame.albedo) for frame in frames]
    albedo = yester.check(frames)[5]
    assert (albedo.verdict, albedo.stored) == ("wrong", "contains lighting: it is the colour")


def test_fractions_of_the_display():
    """Of a crop, motion in fractions is that of the image from which it was cut."""
    (mistake,) = [m for m in MISTAKES if m.name == "NDC, y up" and "camera" in m.buffers]
    frames = mistake.make(sequence())
    usual = yester.check_motion(frames)
    height, width = frames[0].shape
    larger = [replace(f, motion=f.motion[..., :2] * [width / (2 * width), height / (4 * height)]) for f in frames]
    found = yester.check_motion(larger, display=(2 * width, 4 * height))
    assert (found.stored, found.remedy) == (usual.stored, usual.remedy)
    assert yester.check_motion(larger).stored != usual.stored


def test_command(tmp_path, capsys):
    """It names the option to write, and is content with it."""
    (mistake,) = [m for m in MISTAKES if m.name == "NDC, y up" and "camera" in m.buffers]
    write_sequence(tmp_path, mistake.make(sequence())[2:5])
    assert cli.main(["check", str(tmp_path)]) == 1
    said = capsys.readouterr().out
    options = "--map motion=motion.X,-motion.Y --map motion.unit=ndc"
    assert f"write: {options}\n" in said
    assert "looked at frame_0000.exr to frame_0002.exr" in said
    assert cli.main(["check", str(tmp_path), *options.split(), "--frames", "3"]) == 0
    assert "wrong" not in capsys.readouterr().out
    assert cli.main(["check", str(tmp_path / "frame_0000.exr")]) == 2
    assert "expected at least two consecutive frames" in capsys.readouterr().err


@pytest.mark.parametrize("components", ["XYZ", "RGB", "RG", "XY"])
def test_what_may_be_motion_is_tried(tmp_path, capsys, components):
    """Of three components, the first two."""
    for i, frame in enumerate(sequence()[2:5]):
        planes = {f"velocity.{c}": np.zeros(frame.shape, np.float32) for c in components}
        planes |= {f"velocity.{c}": frame.motion[..., k].copy() for k, c in enumerate(components[:2])}
        color = {c: frame.color[..., k].copy() for k, c in enumerate("RGB")}
        layouts.store(tmp_path / f"{i}.exr", color | planes, {"vrayInfo/version": "7"})
    cli.main(["check", str(tmp_path), "--frames", "3"])
    assert f"tried: motion=velocity.{components[0]},velocity.{components[1]}\n" in capsys.readouterr().out


def test_every_layer_that_may_be_motion_is_tried(tmp_path, capsys):
    """RenderMan's lead to the previous frame and to the next one: all other buffers are checked by the former."""
    frames = sequence()[1:5]
    for i, (frame, following) in enumerate(pairwise(frames)):
        onward = yester.invert_motion(following.motion, following.depth)
        planes = {f"Ci.{c}": frame.color[..., k] for k, c in enumerate("RGB")} | {"zfiltered": frame.depth}
        planes |= {f"albedo.{c}": frame.albedo[..., k] for k, c in enumerate("RGB")}
        for name, motion in (("forward", onward), ("backward", frame.motion)):
            planes |= {f"{name}.{c}": motion[..., k] for k, c in enumerate("RG")}
        layouts.store(tmp_path / f"{i}.exr", {name: plane.copy() for name, plane in planes.items()}, {})
    assert cli.main(["check", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert said.index("tried: motion=forward.R,forward.G\n") < said.index("tried: motion=backward.R,backward.G\n")
    assert "write: --map motion_next=forward.R,forward.G\n" in said
    assert "write: --map motion=backward.R,backward.G\n" in said


@pytest.mark.slow
def test_the_table_is_written(capsys, monkeypatch):
    monkeypatch.setattr(mistakes, "MISTAKES", MISTAKES[:1] + MISTAKES[-2:])
    mistakes.main([])
    _, _, right, lit, colour = capsys.readouterr().out.strip().splitlines()
    assert "nothing is wrong" in right
    assert all("albedo | wrong: contains lighting" in line for line in (lit, colour))
