import itertools
from dataclasses import replace
from types import SimpleNamespace

import composed
import flight
import numpy as np
import pytest
import reference
import yester
from compare import assert_close, assert_same_bits, tensor
from composed import sample, sequence, supersampled, with_highlight, with_white
from yester.study.synthetic import raycast

WIDTH, HEIGHT = 61, 43
SETTINGS = {
    **{"alpha": 0.08, "moments_alpha": 0.25, "iterations": 4, "sigma_luminance": 3.0, "min_length": 3.0},
    **{"sigma_normal": 100.0, "sigma_depth": 1.5, "sigma_plane": 0.02},
    **{"relative_depth": (0.05, 0.1), "plane_distance": 0.02, "normal_angle": (15.0, 30.0)},
}
# Accumulation and filter alone.
PLAIN = {"gradient": False, "fireflies": False, "antialias": False}
DISTANCES = (0.25, 0.5, 1, 2, 4, np.inf)
NAMES = ("albedo", "emission", "normal", "depth", "motion", "ids", "position", "camera")
NEWER = ("object_normal", "replay", "hit_distance", "jitter")


def frames_of(names, count, **options) -> list[yester.Frame]:
    return [yester.Frame(**{name: frame[name] for name in ("color", *names)}) for frame in sequence(count, **options)]


def check_bits(frames, **named) -> composed.SVGF:
    svgf, other = yester.SVGF(**named), composed.SVGF(**named)
    for frame in frames:
        got, want = svgf.step(frame), other.step(frame)
        for name in ("color", "variance", "history_length", "confidence", "rejection"):
            assert_same_bits(getattr(got, name), getattr(want, name))
        for name in ("choice", "motion"):
            assert (getattr(got, name) is None) == (getattr(want, name) is None)
            if getattr(got, name) is not None:
                assert_same_bits(getattr(got, name), getattr(want, name))
        assert got.missing == want.missing
        assert np.isfinite(got.color).all()
        assert np.isfinite(got.variance).all()
    return other


@pytest.mark.parametrize("replay", [False, True])
@pytest.mark.parametrize(
    "named",
    [
        {},
        SETTINGS,
        {"feedback": True},
        {"gradient": False},
        {"choice": False},
        {"innovation": False},
        {"choice": False, "innovation": False},
        {"fireflies": True},
        {"by_confidence": True},
        {"tap_exposure": 0.5},
        {"tap_exposure": np.inf},
        {"relative_albedo": 0.3},
        {"average_still": True},
        {"antialias": False},
        PLAIN,
        {**SETTINGS, **PLAIN, "feedback": True},
        {"iterations": 0, "feedback": True},
        {"radius": 2},
        {"reflections": (0.5, np.inf)},
        {"reflections": (1.0,), "iterations": 1, "feedback": True, **PLAIN},
    ],
    ids=str,
)
def test_pipeline_is_its_kernels(named, replay):
    check_bits(frames_of((*NAMES, *(NEWER if replay else ["object_normal"])), 6), **named)


@pytest.mark.parametrize(
    "named",
    [{}, {"choice": False}, {"relative_noise": 0.5}, {"relative_noise": np.inf}, {"motion_difference": (0, 0.2)}],
    ids=str,
)
@pytest.mark.parametrize("names", [["motion"], ["motion", "depth"]], ids=str)
def test_without_guides(named, names):
    check_bits(frames_of(names, 6), **named)


@pytest.mark.parametrize("pipeline", [yester.SVGF, yester.HalfRes])
def test_motion_tells_what_was_covered(pipeline):
    """Without depth, unless motion changes from pixel to pixel."""

    def share(names, scatter=0.0, **named):
        rng, stage = np.random.default_rng(0), pipeline(**named)
        for frame in frames_of(names, 4):
            frame.motion[...] += scatter * rng.random(frame.motion.shape, np.float32)
            output = stage.step(frame)
        return (output.rejection & yester.Rejection.MOTION > 0).mean()

    assert 0.02 < share(["motion"]) < 0.1
    assert 0.02 < share(["motion", "normal", "ids"]) < 0.1
    assert share(["motion", "depth"]) == share(["motion"], scatter=3) == 0
    if pipeline is yester.SVGF:
        assert share(["motion"], motion_difference=np.inf) == 0


@pytest.mark.slow
@pytest.mark.parametrize("count", range(len(NAMES) + 1))
def test_every_subset_of_buffers(count):
    """With any subset of buffers, the pipeline gives the kernels' bits."""
    for names in itertools.combinations(NAMES, count):
        check_bits(frames_of(names, 3))


@pytest.mark.parametrize("seed", range(4))
def test_subsets_of_buffers_and_stages(seed):
    """Random subsets of all buffers, with random stages."""
    rng = np.random.default_rng(seed)
    for _ in range(12):
        names = [name for name in (*NAMES, *NEWER) if rng.random() < 0.7]
        names_of_stages = ("feedback", "by_confidence", "gradient", "fireflies", "choice", "innovation", "antialias")
        stages = {name: bool(rng.integers(2)) for name in names_of_stages}
        distances = [float(d) for d in rng.choice(DISTANCES, rng.integers(0, 3), replace=False)]
        check_bits(frames_of(names, 4), **stages, reflections=distances, iterations=int(rng.integers(0, 4)))


@pytest.mark.parametrize("named", [{}, {"fireflies": True}, {**PLAIN, "choice": False, "innovation": False}], ids=str)
@pytest.mark.parametrize("newer", [(), ("object_normal", "replay")])
def test_albedo_that_is_no_reflectance(named, newer):
    """A surface has one in some frames: its history is rejected where it begins and ends."""
    frames = with_highlight(frames_of((*NAMES, *newer), 7))
    check_bits(frames, **named)
    svgf = yester.SVGF(**named)
    lengths = [svgf.step(frame).history_length[frame.ids == flight.BOX].max() for frame in frames]
    assert [length > 1 for length in lengths] == [False, False, True, False, False, True, False]


@pytest.mark.parametrize("lacking", [("ids",), ("ids", "normal"), ("ids", "depth", "position")], ids=str)
def test_regions_stand_in_for_ids(lacking):
    """Light of which the albedo is no reflectance is kept apart without ids, also where that begins and ends."""
    frames = [replace(frame, **dict.fromkeys(lacking)) for frame in with_highlight(frames_of(NAMES, 7))]
    check_bits(frames)
    svgf = yester.SVGF()
    outputs = [svgf.step(frame) for frame in frames]
    assert all("ids" not in output.used for output in outputs)
    for frame, output, longer in zip(frames[:3], outputs, (None, False, True), strict=False):
        mask = yester.is_reflectance(frame.albedo, normal=frame.normal, depth=frame.depth)
        assert (mask is None) == (longer is None)
        if mask is not None:
            assert not mask.all()
            assert (output.history_length[~mask].max() > 1) == longer
    # Without normals or depth, no pixel had a reflectance in the frame before, and all have one now.
    assert (outputs[3].history_length.max() > 1) == (lacking == ("ids",))


def test_white_stands_in_for_ids():
    """It counts again after a frame in which it did not; ids that come and go are compared with no kinds."""
    frames = with_white(frames_of(NAMES, 9))
    counts = [
        (yester.material_ids(frame.albedo, normal=frame.normal, depth=frame.depth) == 3).any() for frame in frames
    ]
    assert counts == [True, True, False, False, True, True, True, True, True]
    check_bits(frames)
    svgf = yester.SVGF()
    outputs = [svgf.step(frame) for frame in frames]
    assert ["ids" in output.used for output in outputs] == [number == 5 for number in range(9)]
    lengths = [output.history_length for output in outputs]
    assert all(np.mean(now > 1) > 0.7 for now in lengths[1:])


def in_leaves(frames: list[yester.Frame]) -> list[yester.Frame]:
    """Normals and ids of six surfaces by chance, one of them black, in some tiles as a whole and in others in part."""
    rng, result = np.random.default_rng(2), []
    directions = np.concatenate([np.eye(3), -np.eye(3)]).astype(np.float32)
    for frame in frames:
        leaf = rng.integers(0, 6, frame.shape)
        changed = {}
        if frame.normal is not None:
            changed["normal"] = frame.normal.copy()
            changed["normal"][9:, 8:51] = directions[leaf[9:, 8:51]]
        if frame.ids is not None:
            changed["ids"] = frame.ids.copy()
            changed["ids"][3:40, 12:55] = leaf[3:40, 12:55] + 1
            if frame.albedo is not None:
                changed["albedo"] = np.where((changed["ids"] == 2)[..., None], np.float32(5e-4), frame.albedo)
        result.append(replace(frame, **changed))
    return result


@pytest.mark.parametrize(
    "names", [NAMES, ("ids",), ("normal",), ("depth", "ids"), ("depth", "normal", "albedo")], ids=str
)
def test_leaves(names):
    """Where neither normals nor ids guide the filter, it is the kernels' with the buffers that the mask leaves."""
    frames = in_leaves(frames_of(names, 4))
    check_bits(frames, fireflies=True)
    images = []
    for coherence in (True, False):
        svgf = yester.SVGF(coherence=coherence)
        images.append([svgf.step(frame).color for frame in frames])
    # A first frame does not tell what is found again.
    assert [np.array_equal(on, off) for on, off in zip(*images, strict=True)] == [True, False, False, False]


def test_reference_of_leaves():
    svgf, other = yester.SVGF(reflections=()), reference.SVGF()
    for frame in in_leaves(frames_of(NAMES, 3)):
        given = {name: getattr(frame, name) for name in ("color", *NAMES)}
        check_reference(svgf.step(yester.Frame(**given)), other.step(twin(given)))


def test_flat_motion():
    """Motion without its change of depth: no plane test, and depths are compared as they are."""
    frames = [{**frame, "motion": frame["motion"][..., :2].copy()} for frame in sequence(4)]
    check_bits([yester.Frame(**frame) for frame in frames])


@pytest.mark.parametrize("names", [NAMES, ("normal", "camera", "position"), ("motion",), ("normal",)], ids=str)
def test_samples_are_averaged_while_nothing_moves(names):
    """As soon as something moves, history counts for as many samples as usual."""
    still = frames_of(names, 18, moving=False, holes=False)
    moves = frames_of(names, 4, holes=False)[1:]
    check_bits([*still, *moves], average_still=True)
    svgf = yester.SVGF(average_still=True, gradient=False)
    lengths = [svgf.step(frame).history_length.max() for frame in (*still, *moves)]
    assert lengths[17] == (5 if names == ("normal",) else 18)
    assert max(lengths[18:]) <= 5


def test_a_pixel_that_moves_ends_the_rest():
    """A thousandth of a pixel does not, nor does unknown motion."""
    for moved, longest in ((0.001, 8), (np.nan, 8), (0.002, 5)):
        svgf = yester.SVGF(average_still=True, gradient=False)
        for _ in range(8):
            motion = np.zeros((40, 400, 3), np.float32)
            motion[39, 399, 1] = moved
            length = svgf.step(yester.Frame(np.ones((40, 400, 3), np.float32), motion=motion)).history_length[0, 0]
        assert length == longest


@pytest.mark.parametrize("channels", [2, 3, None])
def test_a_dolly_keeps_its_history(channels):
    """Depth changes by 12 % per frame: without the third channel of motion, the cameras give the expected depth."""
    svgf, before = yester.SVGF(**PLAIN), None
    for number in range(4):
        distance = 4 * 0.88**number
        camera = yester.Camera.from_look_at([0, 0, distance], [0, 0, 0], [0, 1, 0], 40, 48, 36)
        depth = np.full((36, 48), distance, np.float32)
        motion = np.zeros((36, 48, 3), np.float32)
        if before is not None:
            motion = yester.motion_vectors(depth, camera, before)
        named = {} if channels is None else {"motion": motion[..., :channels].copy()}
        normal = np.broadcast_to(np.float32([0, 0, 1]), (36, 48, 3)).copy()
        out = svgf.step(yester.Frame(np.ones((36, 48, 3)), depth=depth, normal=normal, camera=camera, **named))
        before = camera
    np.testing.assert_allclose(out.history_length, 4, rtol=1e-6)
    # Of pixels that may move by themselves, the depth is only expected.
    assert ("plane" in out.used) == (channels != 2)
    assert ("camera" in out.used) == (channels != 3)


def test_moving_things_are_expected_at_their_depth():
    """Motion other than the cameras' tells no change of depth: the expected depth is the current one."""
    svgf = yester.SVGF(**PLAIN)
    for number in range(3):
        camera = yester.Camera.from_look_at([0, 0, 4 * 0.8**number], [0, 0, 0], [0, 1, 0], 40, 48, 36)
        # A thing that moves ahead of the camera.
        frame = yester.Frame(
            np.ones((36, 48, 3)), depth=np.full((36, 48), 4.0), motion=np.zeros((36, 48, 2)), camera=camera
        )
        out = svgf.step(frame)
    assert np.median(out.history_length) == 3


def test_history_of_another_albedo_is_refused():
    """A texture is swapped on the right half: history restarts only there, and only with the option on."""
    lengths = {}
    for limit in (None, 0.2):
        svgf = yester.SVGF(relative_albedo=limit, **PLAIN)
        for number in range(4):
            albedo = np.full((20, 30, 3), 0.5, np.float32)
            albedo[:, 15:] = 0.5 if number < 3 else 0.2
            out = svgf.step(yester.Frame(albedo, albedo=albedo))
        lengths[limit] = out.history_length
    np.testing.assert_array_equal(lengths[None], 4)
    np.testing.assert_array_equal(lengths[0.2][:, :15], 4)
    np.testing.assert_array_equal(lengths[0.2][:, 15:], 1)


def test_buffers_may_come_and_go():
    """Except for albedo: buffers that both frames have are tested, others are not."""
    frames = sequence(14)
    for number, name in enumerate((*NAMES[1:], *NEWER)):
        del frames[number + 1][name]
    for distances in ((), (1.0,)):
        check_bits([yester.Frame(**frame) for frame in frames], reflections=distances)


def gallery(number: int, width: int, height: int, *, middle=(0, 0), half=np.inf, behind=3):
    """Buffers, light and hit distance of a wall with a mirror, past which the camera moves.

    The mirror extends by `half` around `middle`, and shows waves on a second wall, `behind` away.
    """
    x = 0.1 * number
    camera = yester.Camera.from_look_at([x, 0, 4], [x, 0, 0], [0, 1, 0], 50, width, height)
    origin, direction = camera.rays(raycast.centres(camera))
    wall, image = (origin - direction * ((origin[2] + z) / direction[..., 2])[..., None] for z in (0, behind))
    mirrors = (np.abs(wall[..., :2] - middle) < half).all(-1)
    waves = 1 + 0.8 * np.sin(9 * image[..., 0] + 1) * np.sin(7 * image[..., 1])
    light = np.where(mirrors, waves, 0.5 + 0.1 * np.sin(2 * wall[..., 0]))[..., None] * [1, 0.8, 0.6]
    buffers = {
        "depth": np.full((height, width), 4.0),
        "normal": np.broadcast_to([0.0, 0, 1], wall.shape),
        "ids": np.where(mirrors, 2, 1),
        "position": wall,
        "camera": camera,
    }
    return buffers, light, np.linalg.norm(image - wall, axis=-1)


def half_textured(position):
    """Albedo that is the same everywhere but below the middle, where no two pixels are alike, and a missing pixel."""
    texture = np.linspace(0.2, 1, 13)[(np.arange(position[..., 0].size) * 5 % 13).reshape(position.shape[:2])]
    albedo = np.where((position[..., 1] < 0.4)[..., None], texture[..., None], [0.9, 0.7, 0.5]).astype(np.float32)
    albedo[20, 40] = np.nan
    return albedo


def speckled(light, rng):
    """Noise of a quarter of the signal."""
    return light * rng.gamma(16, 1 / 16, light.shape[:2])[..., None]


@pytest.mark.parametrize("known", [False, True])
def test_reflections_are_their_kernels(known):
    """Through a whole cycle of trying candidates and of asking winners again, while the mirror leaves the view."""
    rng = np.random.default_rng(0)
    frames = []
    for number in range(19):
        buffers, light, hit = gallery(number, 180, 100, middle=(-0.8, 0.4), half=0.45)
        buffers["albedo"] = half_textured(buffers["position"])
        frames.append(
            yester.Frame(speckled(light * buffers["albedo"], rng), **buffers, hit_distance=hit if known else None)
        )
    other = check_bits(frames, reflections=(0.5, 1.0, np.inf))
    check_bits(frames[:8], reflections=(0.5, 1.0, np.inf), antialias=False)
    asked, won = np.array(other.asked), np.array(other.won)
    assert (asked[:2] == 1).all()
    assert (asked[2:] < 0.5).all()
    assert won[:8].max() > 0.05
    assert len(set(asked)) > 5, "the tiles follow the winners"
    assert won[15:].max() < 0.002, "chance does not win either"
    np.testing.assert_allclose(asked[16:], 0.16, err_msg="one row of tiles, in its turn")


def test_reflections_follow_what_all_light_changes_by():
    rng, frames = np.random.default_rng(0), []
    for number, factor in enumerate((1, 1, 1, 0.4, 0.4, 1)):
        buffers, light, _ = gallery(number, 120, 90, half=0.8)
        frames.append(yester.Frame(factor * speckled(light, rng), **buffers))
    other = check_bits(frames, reflections=(0.5, 1.0))
    assert min(other.won[1:]) > 0.02


def test_an_output_stage_follows_reflections_without_albedo():
    """The candidates were compared with their texture, so that the winner's motion is that of what is seen."""
    rng, denoiser, before = np.random.default_rng(0), yester.SVGF(antialias=False), None
    for number in range(8):
        buffers, light, hit = gallery(number, 120, 90)
        out = denoiser.step(yester.Frame(speckled(light, rng), **buffers, hit_distance=hit))
        cameras = buffers["camera"], before or buffers["camera"]
        reflected, before = yester.virtual_motion(buffers["position"], hit, *cameras), buffers["camera"]
    mirror = buffers["position"][..., 1] > 0.5
    assert (np.abs(out.motion - reflected) < 1e-5).all(-1)[mirror].mean() > 0.8


def test_an_output_stage_follows_reflections_but_not_through_texture():
    rng, denoiser, before = np.random.default_rng(0), yester.SVGF(antialias=False), None
    for number in range(8):
        buffers, light, hit = gallery(number, 120, 90)
        albedo = half_textured(buffers["position"])
        out = denoiser.step(yester.Frame(speckled(light * albedo, rng), **buffers, hit_distance=hit, albedo=albedo))
        cameras = buffers["camera"], before or buffers["camera"]
        own = yester.motion_vectors(buffers["position"], *cameras)[..., :2]
        reflected, before = yester.virtual_motion(buffers["position"], hit, *cameras), buffers["camera"]
    plain = buffers["position"][..., 1] > 0.5
    plain[18:23, 38:43] = False  # around the missing pixel
    texture = buffers["position"][..., 1] < 0.3
    follows = (np.abs(out.motion - reflected) < 1e-5).all(-1)
    assert follows[plain].mean() > 0.8
    assert not follows[texture].any()
    assert_same_bits(out.motion[texture], own[texture])
    assert yester.SVGF(antialias=False, reflections=()).step(yester.Frame(light)).motion is None
    assert yester.SVGF().step(yester.Frame(light)).motion is None


def test_what_a_turning_surface_reflects_is_found_by_its_normal_in_the_world():
    """A surface passes the pixels, and its normals in the object's space with it; what it reflects stays."""
    height, width = 64, 80
    y, x = np.mgrid[:height, :width]
    waves = 1 + 0.8 * np.sin(x / 3) * np.sin(y / 4)
    camera = yester.Camera.from_look_at([0, 0, 4], [0, 0, 0], [0, 1, 0], 50, width, height)
    flat = {"depth": np.full((height, width), 4.0), "normal": np.broadcast_to([0.0, 0, 1], (height, width, 3))}
    errors = []
    for named in ({}, {"reflections": ()}):
        rng, svgf = np.random.default_rng(0), yester.SVGF(**named)
        for number in range(12):
            angle = 0.15 * (x - 5 * number)
            buffers = {
                "albedo": np.full((height, width, 3), 0.9),
                "motion": np.broadcast_to(np.float32([-5, 2.5, 0]), (height, width, 3)),
                "object_normal": np.dstack([np.sin(angle), np.zeros_like(angle), np.cos(angle)]),
            }
            color = speckled(np.dstack([waves] * 3), rng)
            out = svgf.step(yester.Frame(color, **flat, **buffers, camera=camera))
        errors.append(np.abs(out.color[8:-8, 8:-8, 0] - waves[8:-8, 8:-8]).mean())
    assert errors[0] < 0.4 * errors[1]


@pytest.mark.parametrize("channels", [2, 3])
@pytest.mark.parametrize("geometry", ["depth", "position"])
@pytest.mark.parametrize("make", ["SVGF", "TAA", "BMFR"])
def test_unknown_motion_is_the_still_scenes(make, geometry, channels):
    """NaN on the box, and zero where nothing was hit; without cameras they stay unknown."""
    names = ("color", "albedo", "normal", "ids", "camera", geometry)
    for cameras in (True, False):
        frames, wanted, last = [], [], None
        for frame in sequence(4):
            given = {name: frame[name] for name in names if cameras or name != "camera"}
            still = np.zeros_like(frame["motion"])
            if last is not None:
                still = yester.motion_vectors(frame[geometry], frame["camera"], last)
            last = frame["camera"]
            box, sky = frame["ids"] == flight.BOX, np.isposinf(frame["depth"])
            assert box[::4].any()
            assert sky.any()
            motion = np.where(box[..., None], np.nan, np.where(sky[..., None], 0, frame["motion"]))[..., :channels]
            frames.append(yester.Frame(**given, motion=motion))
            filled = np.where((box | sky)[..., None], still[..., :channels], frame["motion"][..., :channels])
            wanted.append(yester.Frame(**given, motion=filled))
        one, other = (getattr(yester, make)() for _ in range(2))
        same = []
        for frame, want in zip(frames, wanted, strict=True):
            got, want = one.step(frame), other.step(want)
            same.append((got.color == want.color).all() and (got.confidence == want.confidence).all())
        assert all(same) == cameras
        if cameras:
            assert "camera" in got.used


@pytest.mark.parametrize("channels", [2, 3])
@pytest.mark.parametrize("row", [8, 9])
def test_unknown_motion_is_filled_as_composed(channels, row):
    frames = []
    for frame in frames_of(NAMES, 4):
        motion = frame.motion[..., :channels].copy()
        motion[row] = np.nan
        frames.append(replace(frame, motion=motion))
    check_bits(frames)


def test_unknown_motion_is_looked_for_in_every_fourth_row():
    for row, known in ((8, True), (9, False)):
        svgf = yester.SVGF()
        for frame in sequence(3):
            given = {name: frame[name] for name in ("color", "albedo", "normal", "depth", "ids", "camera")}
            motion = np.where(np.isposinf(frame["depth"])[..., None], [3, 3, 0], frame["motion"])
            motion[row] = np.nan
            out = svgf.step(yester.Frame(**given, motion=motion))
        assert ("camera" in out.used) == known
        assert (out.confidence[row] > 0).any() == known


def test_scores_restart_where_candidates_were_not_tested():
    """A picture, for which virtual motion is wrong, becomes a mirror while its candidates are not tested."""
    rng = np.random.default_rng(0)
    frames = []
    for number in range(20):
        buffers, light, _ = gallery(number, 80, 60, behind=0 if number < 3 else 3)
        frames.append(yester.Frame(speckled(light, rng), **buffers))
    other = check_bits(frames, reflections=(1.0, 0.5))
    # The last of four rows of tiles is the first that is tried again.
    assert other.asked[:11] == [1, 1, *[0] * 8, 12 / 60]
    assert max(other.won[:10]) == 0 < other.won[11] < other.won[17]


def test_a_lost_camera_restarts_the_scores():
    rng = np.random.default_rng(0)
    frames = []
    for number in range(8):
        buffers, light, _ = gallery(number, 100, 70, half=0.5)
        if number == 3:
            del buffers["camera"]
        frames.append(yester.Frame(speckled(light, rng), **buffers))
    other = check_bits(frames, reflections=(1.0, 0.5))
    assert [share == 1 for share in other.asked] == [True, True, True, True, False]


def test_reflections_sharpen_mirrors():
    """History along the surface blurs a mirror's image; virtual motion does not, least at a known distance."""

    def last(known=False, **named):
        alone = {"choice": False, "innovation": False}
        rng, svgf, errors = np.random.default_rng(0), yester.SVGF(alpha=0.05, **alone, **named), []
        for number in range(16):
            buffers, light, hit = gallery(number, 120, 80)
            frame = yester.Frame(speckled(light, rng), **buffers, hit_distance=hit if known else None)
            errors.append(np.mean((svgf.step(frame).color - light) ** 2))
        return np.mean(errors[10:])

    for named, factors in (({}, (0.7, 0.55)), ({**PLAIN, "iterations": 0}, (0.16, 0.07))):
        without, tried = (last(**named, reflections=distances) for distances in ((), DISTANCES))
        known = last(known=True, **named, reflections=(1.0,))
        assert tried < factors[0] * without
        assert known < factors[1] * without
        assert known < tried


@pytest.mark.parametrize(
    ("names", "used"),
    [
        ([], set()),
        (["albedo"], {"albedo"}),
        (["albedo", "emission"], {"albedo", "emission"}),
        (["depth", "motion"], {"depth", "motion"}),
        (["normal", "ids"], {"normal", "ids"}),
        (["depth", "camera"], {"depth", "camera"}),
        (["depth", "normal", "camera"], {"depth", "normal", "camera", "plane"}),
        (["depth", "normal", "motion", "camera"], {"depth", "normal", "motion", "plane"}),
        (["position", "camera"], {"camera", "position"}),
        (["camera"], set()),
        (["position"], set()),
        (["replay", "jitter", "object_normal", "hit_distance"], {"object_normal", "replay"}),
    ],
)
def test_used(names, used):
    svgf = yester.SVGF()
    for frame in sequence(3):
        out = svgf.step(yester.Frame(**{name: frame[name] for name in ("color", *names)}))
    assert isinstance(out.used, tuple)
    assert sorted(out.used) == sorted(used)


@pytest.mark.parametrize("newer", [(), ("object_normal", "replay")])
@pytest.mark.parametrize(
    "named", [{}, PLAIN, {"feedback": True, "antialias": False}, {"iterations": 0}, {"choice": False}], ids=str
)
def test_reference(named, newer):
    """The pipeline against its float64 composition, in which decisions may flip in a few pixels."""
    svgf, other = yester.SVGF(reflections=(), **named), reference.SVGF(**named)
    for frame in with_highlight(frames_of((*NAMES, *newer), 6)):
        given = {name: getattr(frame, name) for name in ("color", *NAMES, *newer)}
        check_reference(svgf.step(yester.Frame(**given)), other.step(twin(given)))


@pytest.mark.parametrize(
    "named", [{}, PLAIN, {"feedback": True, "antialias": False}, {"choice": False}, {"alpha": 0.35}], ids=str
)
def test_reference_with_later_frames(named):
    """Histories as of later frames, of any length: they are merged, but not passed on."""
    svgf, other = yester.SVGF(reflections=(), **named), reference.SVGF(**named)
    rng, source = np.random.default_rng(0), yester.SVGF(alpha=0.15, reflections=())
    for frame in sequence(6):
        given = {name: frame[name] for name in ("color", *NAMES)}
        known = source.recall(yester.Frame(**given))
        color, length = known.color.copy(), known.history_length * rng.uniform(0.3, 2, (HEIGHT, WIDTH))
        color[rng.random((HEIGHT, WIDTH)) < 0.05] = np.nan
        # What earlier frames have not seen, later ones have, in a part of the image.
        length[: HEIGHT // 2] += 2
        # There, validation fails that of earlier frames passes.
        sure = known.confidence[::-1].copy(), known.rejection[::-1].copy()
        later = color, known.moments, length.astype(np.float32), *sure
        got = svgf.step(yester.Frame(**given), later=yester.History(*later))
        names = "color", "moments", "history_length", "confidence", "rejection"
        want = other.step(twin(given), SimpleNamespace(**tensor(dict(zip(names, later, strict=True)))))
        check_reference(got, want)
        assert np.mean(got.rejection != want.rejection.numpy()) < 0.005
    assert got.history_length.max() > 0.5 + 1 / named.get("alpha", 0.2)


@pytest.mark.parametrize("lacks", ["samples", "length", "color"])
def test_later_frames_that_know_nothing(lacks):
    """They change no bit of the output."""
    svgf, alone = yester.SVGF(), yester.SVGF()
    for frame in frames_of(NAMES, 5):
        color, moments, length, confidence = (
            np.full((HEIGHT, WIDTH, *c), 0.5, np.float32) for c in ((3,), (2,), (), ())
        )
        if lacks == "color":
            color[..., 1] = np.nan
        else:
            length[:] = {"samples": 0, "length": np.nan}[lacks]
        later = yester.History(color, moments, length, confidence, np.full((HEIGHT, WIDTH), 255, np.uint8))
        got, want = svgf.step(frame, later=later), alone.step(frame)
        for name in ("color", "variance", "history_length", "rejection"):
            assert_same_bits(getattr(got, name), getattr(want, name))


def twin(given):
    """A frame of tensors with the given buffers."""
    return SimpleNamespace(**{**dict.fromkeys(NEWER), **tensor(given)})


def check_reference(got, want) -> None:
    assert got.missing == want.missing
    where = {"where": np.ones((HEIGHT, WIDTH), bool), "flips": WIDTH * HEIGHT // 200}
    assert_close("SVGF", got.color, want.color, rtol=1e-4, **where)
    assert_close("SVGF variance", got.variance, want.variance, rtol=5e-4, **where)
    assert_close("SVGF history_length", got.history_length, want.history_length, rtol=1e-4, **where)
    assert_close("SVGF confidence", got.confidence, want.confidence, **where)
    assert (got.choice is None) == (want.choice is None)
    if got.choice is not None:
        assert_close("SVGF choice", got.choice, want.choice, rtol=1e-5)


def test_reset_forgets():
    frames = [yester.Frame(**frame) for frame in sequence(3)]
    svgf = yester.SVGF()
    first = [svgf.step(frame).color for frame in frames]
    assert svgf.reset() is None
    again = svgf.step(frames[0])
    assert (again.history_length <= 1).all()
    assert not again.confidence.any()
    assert_same_bits(again.color, first[0])
    for frame, want in zip(frames[1:], first[1:], strict=True):
        assert_same_bits(svgf.step(frame).color, want)


def test_one_size_until_reset():
    small, large = (yester.Frame(np.ones((size, size, 3), np.float32)) for size in (8, 9))
    svgf = yester.SVGF()
    svgf.step(small)
    with pytest.raises(ValueError, match="reset") as error:
        svgf.step(large)
    assert "8" in str(error.value)
    assert "9" in str(error.value)
    assert svgf.step(small).history_length.max() == 2, "a refused frame leaves the state alone"
    svgf.reset()
    assert svgf.step(large).history_length.max() == 1


def test_a_refused_recall_leaves_the_output_stage_alone():
    rng = np.random.default_rng(0)
    frames = [yester.Frame(rng.random((8, 9, 3), np.float32)) for _ in range(3)]
    plain, asked = yester.SVGF(), yester.SVGF()
    for frame in frames[:2]:
        plain.step(frame)
        asked.step(frame)
    with pytest.raises(ValueError, match="reset"):
        asked.recall(yester.Frame(np.ones((9, 9, 3), np.float32)))
    assert_same_bits(asked.step(frames[2]).color, plain.step(frames[2]).color)


def test_albedo_always_or_never():
    """With and without albedo the history means different things."""
    color = np.ones((8, 9, 3), np.float32)
    frames = [yester.Frame(color), yester.Frame(color, albedo=color)]
    for first, second in (frames, frames[::-1]):
        svgf = yester.SVGF()
        svgf.step(first)
        with pytest.raises(ValueError, match="albedo"):
            svgf.step(second)
        svgf.reset()
        svgf.step(second)


def test_a_lost_frame_is_survived():
    """A frame of NaN shows the history; at the start it shows black, and the next sample repairs it."""
    good = np.ones((8, 9, 3), np.float32)
    lost = yester.Frame(np.full_like(good, np.nan))
    svgf = yester.SVGF()
    out = svgf.step(lost)
    assert out.missing == 72
    assert not out.color.any()
    assert not out.history_length.any()
    for length in (1, 2):
        out = svgf.step(yester.Frame(good))
        assert out.missing == 0
        np.testing.assert_allclose(out.color, 1, rtol=1e-6)
        assert (out.history_length == length).all()
    out = svgf.step(lost)
    assert out.missing == 72
    np.testing.assert_allclose(out.color, 1, rtol=1e-6)
    assert (out.history_length == 2).all()


def error(image, shot) -> float:
    seen = shot.ids > 0
    return float(np.mean((image[seen] - shot.color[seen]) ** 2))


def test_error_falls_when_nothing_moves():
    rng = np.random.default_rng(0)
    svgf, shot = yester.SVGF(**PLAIN), flight.shoot(0, 96, 64, moving=False)
    errors, raw = [], []
    for _ in range(32):
        color = flight.noisy(shot, rng)
        errors.append(error(svgf.step(replace(shot, color=color)).color, shot))
        raw.append(error(color, shot))
    assert errors[0] < 0.1 * np.mean(raw)
    assert np.mean(errors[16:]) < 0.5 * errors[0]
    assert np.mean(errors[16:]) < 0.03 * np.mean(raw)


def test_error_falls_when_everything_moves():
    """The camera flies and a sphere moves; history follows the motion vectors, and disocclusions are rejected."""
    rng = np.random.default_rng(0)
    svgf = yester.SVGF(alpha=0.05, **PLAIN)
    errors, raw, lengths = [], [], []
    for number in range(24):
        now = flight.shoot(number, 96, 64)
        color = flight.noisy(now, rng)
        out = svgf.step(replace(now, color=color))
        errors.append(error(out.color, now))
        raw.append(error(color, now))
        lengths.append(out.history_length[now.ids == flight.MOVER].mean())
    assert errors[0] < 0.1 * np.mean(raw)
    assert np.mean(errors[12:]) < 0.6 * errors[0]
    assert np.mean(errors[12:]) < 0.04 * np.mean(raw)
    assert lengths[-1] > 5, "the moving sphere keeps its history"
    assert (out.history_length[now.ids == flight.MOVER] < 5).any(), "and its uncovered rim has none"


def switched(count: int, at: int, scale: float, **named):
    """The static scene with light scaled from one frame on: output and reference, per frame."""
    rng, shot = np.random.default_rng(0), flight.shoot(0, 96, 64, moving=False)
    svgf = yester.SVGF(alpha=0.05, **named)
    for number in range(count):
        light = np.float32(scale if number >= at else 1)
        yield svgf.step(replace(shot, color=flight.noisy(shot, rng) * light)), shot.color * light


@pytest.mark.parametrize("scale", [3.0, 0.25])
def test_a_switched_light_is_followed(scale):
    """To within 15 % at once; without gradient, innovation and choice, half the change is missing ten frames later.

    Innovation alone brings nine tenths of it within four frames.
    """

    def brightness(**named):
        return [float(out.color.mean() / truth.mean()) for out, truth in switched(28, 16, scale, **named)]

    followed, kept = brightness(), brightness(gradient=False, innovation=False, choice=False)
    corrected = brightness(gradient=False)
    assert followed[15] == pytest.approx(1, abs=0.05)
    assert followed[16:] == pytest.approx([1] * 12, abs=0.15)
    assert followed[20:] == pytest.approx([1] * 8, abs=0.06)
    # (before - after) / after, half of which is left
    change = abs(1 / scale - 1)
    assert min(abs(ratio - 1) for ratio in kept[16:26]) > 0.5 * change
    assert max(abs(ratio - 1) for ratio in corrected[20:]) < 0.15 * change


def test_steady_light_keeps_its_history():
    """Noise is no change of light: of sixteen frames three in four count, and the error stays about the same."""
    found = []
    for gradient in (True, False):
        steps = list(switched(24, 99, 1.0, gradient=gradient))
        assert steps[15][0].history_length.mean() > (12 if gradient else 15.99)
        found.append(np.mean([(out.color - truth) ** 2 for out, truth in steps[16:]]))
    assert found[0] < 1.25 * found[1]


def test_replays_give_exact_changes():
    """Only in the half where the light is switched does history restart with the first sample of new light."""
    rng, shot = np.random.default_rng(0), flight.shoot(0, 96, 64, moving=False)
    seen, sides = shot.ids > 0, np.arange(96)[None, :, None]
    before, left, right = None, seen & (sides[..., 0] < 40), seen & (sides[..., 0] >= 56)
    plain = {**PLAIN, "alpha": 0.05, "gradient": True, "choice": False, "innovation": False, "iterations": 0}
    svgf, blind = yester.SVGF(**plain), yester.SVGF(**plain | {"gradient": False})
    for number in range(18):
        light = np.where(sides < 48, 3 if number >= 15 else 1, 1).astype(np.float32)
        color = flight.noisy(shot, rng) * light
        replay = before if number != 15 else before * light
        frame = replace(shot, color=color, replay=replay)
        out, other = svgf.step(frame), blind.step(frame)
        since = number + 1 if number < 15 else number - 14
        np.testing.assert_allclose(out.history_length[left], since, atol=2e-3)
        np.testing.assert_array_equal(out.history_length[right], number + 1)
        np.testing.assert_array_equal(out.color[right], other.color[right])
        if number == 15:
            np.testing.assert_allclose(out.color[left], color[left], rtol=5e-3, atol=1e-3)
            assert np.median(other.color[left] / color[left]) < 2
        before = color


def replayed(pipeline, scale, seed, **named):
    """Light of the static scene, just after scaling, with replays: relative to the reference, where surfaces are."""
    rng, shot = np.random.default_rng(seed), flight.shoot(0, 96, 64, moving=False)
    denoiser, before = pipeline(antialias=False, **named), None
    for number in range(16):
        light = np.float32(scale if number == 15 else 1)
        color = flight.noisy(shot, rng) * light
        replay = None if before is None else before * light
        out = denoiser.step(replace(shot, color=color, replay=replay))
        before = color
    seen = shot.ids > 0
    return out.color[seen] / (shot.color * light)[seen]


@pytest.mark.parametrize(
    ("scale", "noise"), [(1.25, 0.65), (0.8, 0.7), (3.0, 0.99), (0.25, 1.02)], ids=["more", "less", "bright", "dark"]
)
@pytest.mark.parametrize("pipeline", [yester.SVGF, yester.HalfRes])
def test_replays_correct_history(pipeline, scale, noise):
    """Light is right in its first frame, with less noise where it is corrected than where history is cut alone."""
    corrected, cut = (
        np.array([replayed(pipeline, scale, seed, innovation=choice) for seed in range(4)]) for choice in (True, False)
    )
    # The luminance weight keeps a single sample's bright outliers to themselves, so that the others are too dark.
    assert corrected.mean() == pytest.approx(1, abs=0.04 if 0.5 < scale < 2 else 0.07)
    assert np.sqrt(np.mean((corrected - 1) ** 2)) < noise * np.sqrt(np.mean((cut - 1) ** 2))


@pytest.mark.parametrize("kind", ["the same", "missing"])
@pytest.mark.parametrize("pipeline", [yester.SVGF, yester.BMFR])
def test_replays_without_news(pipeline, kind):
    """A replay equal to the previous colour, or without values, changes no bit."""
    told, untold, before = pipeline(), pipeline(gradient=False), None
    for frame in frames_of(NAMES, 4):
        color = np.full_like(frame.color, np.nan) if before is None or kind == "missing" else before
        replay = yester.Frame(**frame.buffers(), camera=frame.camera, replay=color)
        got, want = told.step(replay), untold.step(frame)
        assert ("replay" in got.used) == (before is not None)
        assert_same_bits(got.color, want.color)
        assert_same_bits(got.history_length, want.history_length)
        before = frame.color


def test_a_lamp_that_is_switched_leaves_no_halo():
    """A lamp's own emission is not the light of its surroundings."""
    rng, shot = np.random.default_rng(0), flight.shoot(0, 96, 64, moving=False)
    lamp, before, shown = np.zeros((64, 96, 1), np.float32), None, []
    lamp[20:26, 40:46] = 300
    for lit in ((1, 0), (0, 1)):
        svgf, before = yester.SVGF(antialias=False), None
        for number in range(12):
            emission = np.broadcast_to(lamp * lit[number >= 11], (64, 96, 3)).copy()
            noise = flight.noisy(shot, rng)
            replay = before
            if number == 11:
                replay = before - lamp * lit[0] + lamp * lit[1]
            before = noise + emission
            out = svgf.step(replace(shot, color=before, emission=emission, replay=replay))
        light = out.color - emission
        around = np.zeros((64, 96), bool)
        around[8:38, 28:58] = True
        around &= (shot.ids > 0) & (lamp[..., 0] == 0)
        shown.append(float(light[around].mean() / shot.color[around].mean()))
    assert shown == pytest.approx([1, 1], abs=0.1)


@pytest.mark.parametrize("pipeline", [yester.SVGF, yester.BMFR])
def test_replays_are_expected_after_replays(pipeline):
    """The first replay after a frame without one is not used, except in a sequence's second frame."""
    frames, used = sequence(6), []
    denoiser, other = pipeline(), getattr(composed, pipeline.__name__)()
    for number, buffers in enumerate(frames):
        if number in (0, 3):
            buffers["replay"] = None
        frame = yester.Frame(**buffers)
        out = denoiser.step(frame)
        assert_same_bits(out.color, other.step(frame).color)
        used.append("replay" in out.used)
    assert used == [False, True, True, False, False, True]


@pytest.mark.parametrize("noise", [False, True])
def test_antialiasing_nears_the_supersampled_image(noise):
    """A third of the error, from jittered samples; without it, SVGF keeps the last frame's edges."""
    rng, camera = np.random.default_rng(0), flight.camera(0, 96, 64)
    truth = supersampled(camera)
    smooth, plain = yester.SVGF(), yester.SVGF(antialias=False)
    errors = []
    for number, offset in enumerate(yester.jitter(24)):
        frame = sample(camera, offset)
        if noise:
            frame["color"] *= rng.exponential(1, (64, 96, 1)).astype(np.float32)
        frame = yester.Frame(**frame)
        images = [svgf.step(frame).color for svgf in (smooth, plain)]
        if number >= 12:
            errors.append([np.mean((image - truth) ** 2) for image in images])
    smooth, plain = np.mean(errors, 0)
    assert 3 * smooth < plain


def test_a_firefly_does_not_stay():
    """One sample, a thousand times too bright, is spread; unsuppressed, it stays as long as the history."""
    good = np.full((24, 25, 3), 0.5, np.float32)
    glaring = good.copy()
    glaring[12, 12] = 500

    def brightest(**named):
        svgf = yester.SVGF(iterations=0, **{**PLAIN, **named})
        return [svgf.step(yester.Frame(color)).color.max() for color in (good, good, glaring, good, good)]

    # A third of the frame's light, an 81st of it per pixel of the window, plus the limit.
    assert max(brightest(fireflies=True)) < 500 / 81 / 3 + 1
    assert brightest()[-1] > 50


def test_object_normals_outlive_a_turn():
    """An object turns by 40 degrees per frame: world normals reject history, object normals do not."""
    shape = (12, 13, 3)
    color = np.ones(shape, np.float32)
    own = np.broadcast_to(np.float32([0, 0, 1]), shape)
    for named, length in (({}, 1), ({"object_normal": own}, 4)):
        svgf = yester.SVGF()
        for number in range(4):
            angle = np.radians(40 * number)
            normal = np.broadcast_to([np.sin(angle), 0, np.cos(angle)], shape)
            out = svgf.step(yester.Frame(color, normal=normal, **named))
        assert (out.history_length == length).all()
        assert (out.rejection == (0 if named else 4)).all()


@pytest.mark.parametrize("named", [{}, PLAIN, {"reflections": DISTANCES}], ids=str)
def test_constant_stays(named):
    color = np.full((16, 17, 3), np.float32([0.7, 0.2, 3]))
    svgf = yester.SVGF(**named)
    buffers, _, _ = gallery(0, 17, 16)
    for number in range(5):
        out = svgf.step(yester.Frame(color, **buffers))
        np.testing.assert_allclose(out.color, color, rtol=3e-6)
        assert (out.history_length == number + 1).all()
    assert (out.confidence == 1).all()
    assert not out.rejection.any()


@pytest.mark.parametrize(
    ("argument", "values"),
    [
        ("alpha", [-0.1, 1.1, np.nan]),
        ("moments_alpha", [-0.1, 1.1]),
        ("iterations", [-1, 17]),
        ("radius", [0, 3]),
        ("sigma_luminance", [0, -1, np.nan]),
        ("relative_noise", [0, -1, np.nan]),
        ("tap_exposure", [0, -1, np.nan]),
        ("motion_difference", [-1, np.nan]),
        ("sigma_normal", [-1, np.nan]),
        ("sigma_depth", [0, -1]),
        ("sigma_plane", [0, -1]),
        ("relative_depth", [0, -1]),
        ("plane_distance", [0, -1]),
        ("normal_angle", [-1, 181]),
        ("min_length", [-1, np.nan]),
        ("relative_albedo", [-1, np.inf]),
        ("reflections", [[0.0], [1, -1], [np.nan], [1, -np.inf]]),
    ],
)
def test_out_of_range(argument, values):
    for value in values:
        with pytest.raises(ValueError, match=argument):
            yester.SVGF(**{argument: value})


def test_not_a_frame():
    for frame in (np.ones((4, 4, 3), np.float32), None, {"color": np.ones((4, 4, 3), np.float32)}):
        with pytest.raises((TypeError, ValueError), match="frame"):
            yester.SVGF().step(frame)
    with pytest.raises(TypeError):
        yester.SVGF(0.05)
