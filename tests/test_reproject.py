import compare
import flight
import numpy as np
import pytest
import reference
import yester
from compare import BAND, SIZES, TAILS, assert_close, assert_same_bits, each, tensor
from hypothesis import given
from hypothesis import strategies as st

RAMP = 0.3 * BAND / 1e-5  # the part of the tolerance that a ramp multiplies
WIDE = ["catmull-rom", "catmull-rom-5", "lanczos-2"]
TESTS = ["depth", "normal", "ids", "plane", "object_normal", "color", "motion"]
# Hard and soft; whole-pixel motion lies on none of them.
THRESHOLDS = {
    "relative_depth": [0.01, 0.1, 0.5, (0.02, 0.11), (0.05, 0.5)],
    "plane_distance": [0.01, 0.2, (0.01, 0.2), (0.05, 0.1)],
    "normal_angle": [0.5, 25.0, 90.0, 179.0, (0.0, 30.0), (10.0, 25.0), (25.0, 180.0)],
    "relative_luminance": [0.3, 0.5, (0.0, 1.0), (0.2, 0.7), (0.1, 3.0)],
    "speed": [None, None, 1.3, 7.9, (0.0, 3.3), (0.7, 2.9)],
    "motion_difference": [0.3, 0.5, np.inf, (0.1, 2.1), (0.4, 0.9)],
}
SOFT = {
    "relative_depth": (0.02, 0.1),
    "plane_distance": (0.01, 0.2),
    "normal_angle": (5.0, 25.0),
    "relative_luminance": (0.1, 0.6),
    "speed": (0.5, 1.5),
    "motion_difference": (0.3, 1.1),
}
thresholds = {name: st.sampled_from(values) for name, values in THRESHOLDS.items()}


def surface(rng, height, width, names) -> dict:
    """The buffers of the named tests; "plane" is depth, normal and the previous camera, "motion" the previous one."""
    now = compare.surfaces(rng, height, width)
    buffers = now | compare.previous(rng, now)
    turned = compare.previous(rng, now)["previous_normal"]
    buffers |= {"object_normal": now["normal"], "previous_object_normal": turned}
    color = compare.colors(rng, height, width)
    again = color * rng.choice([0.25, 0.6, 0.9, 1.0, 1.7], (height, width, 1))
    buffers |= {"color": color, "previous_color": again.astype(np.float32)}
    names = set(names) | ({"depth", "normal"} if "plane" in names else set())
    both = sorted(names - {"plane", "motion"})
    found = {key: buffers[key] for name in both for key in (name, f"previous_{name}")}
    found |= {"previous_motion": compare.motions(rng, height, width)} if "motion" in names else {}
    return found | ({"previous_camera": compare.camera(rng, width, height)} if "plane" in names else {})


def check(history, motion, **named) -> np.ndarray:
    """Compare with the reference; return the coverage."""
    values, coverage = yester.reproject(history, motion, **named)
    wants, want_coverage, margin, steepness = reference.reproject(
        tensor(history), tensor(motion), margin=True, **{k: tensor(v) for k, v in named.items()}
    )
    sure = margin.numpy() > BAND
    decisions = 4 if named.get("filter") in WIDE else 1  # 16 taps instead of 4
    assert (~sure).sum() <= decisions * (2 + 0.005 * sure.size)
    # Roundings in the weights as multiplied by ramps, relative to the sum of weights.
    extra = RAMP * steepness.numpy()
    part = np.where(coverage > 0, extra / np.maximum(coverage, 1e-30), 0)
    for value, want in zip(*((values, wants) if isinstance(history, list) else ([values], [wants])), strict=True):
        assert value.dtype == np.float32
        size = float(want.square().mean().sqrt()) * (1 + part)
        assert_close("reproject", value, want, where=sure, scale=size if want.ndim == 2 else size[..., None])
    assert_close("reproject coverage", coverage, want_coverage, where=sure, scale=1 + extra)
    return coverage


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    channels=st.sampled_from([None, 1, 2, 3, 4, 7]),
    motion=st.sampled_from([2, 3]),
    filter=st.sampled_from(["nearest", "bilinear", "catmull-rom", "catmull-rom-5", "lanczos-2"]),
    fallback=st.booleans(),
    dering=st.booleans(),
    tests=st.sets(st.sampled_from(TESTS)),
    **thresholds,
)
def test_reference(seed, size, channels, motion, filter, fallback, dering, tests, **thresholds):
    rng = np.random.default_rng(seed)
    history = compare.colors(rng, *size, channels or 1)
    check(
        history if channels else history[..., 0],
        compare.motions(rng, *size, 3 if "plane" in tests else motion),
        filter=filter,
        fallback=fallback,
        dering=dering,
        **surface(rng, *size, tests),
        **thresholds,
    )


@pytest.mark.parametrize("tests", [[], ["depth", "ids"], ["plane", "ids"]])
@each(("height", "width"), SIZES + TAILS)
def test_sizes(height, width, tests):
    rng = np.random.default_rng(width)
    color, moments = compare.colors(rng, height, width), compare.colors(rng, height, width, 2)
    length = rng.uniform(1, 30, (height, width)).astype(np.float32)
    check([color, moments, length], compare.motions(rng, height, width, 3), **surface(rng, height, width, tests))


@pytest.mark.parametrize("filter", ["nearest", "bilinear", *WIDE])
@each(("height", "width"), SIZES + TAILS[::4])
def test_sizes_of_ramps(height, width, filter):
    rng = np.random.default_rng(width)
    history, motion = compare.colors(rng, height, width), compare.motions(rng, height, width, 3)
    check(history, motion, filter=filter, **surface(rng, height, width, TESTS), **SOFT)


@pytest.mark.parametrize("tests", [["depth"], ["normal"], ["ids"], ["plane"], ["object_normal"], ["color"]])
def test_both_sides_of_every_test(tests):
    rng = np.random.default_rng(1)
    history = compare.colors(rng, 64, 64, holes=0)
    motion = rng.normal(0, 0.5, (64, 64, 3)).astype(np.float32)
    coverage = check(history, motion, fallback=False, plane_distance=0.1, **surface(rng, 64, 64, tests))
    inside = coverage[4:-4, 4:-4]
    assert 0.1 < (inside > 0.99).mean() < 0.9
    assert 0.02 < (inside < 0.01).mean() < 0.9


@pytest.mark.parametrize("name", ["depth", "normal", "plane", "color", "speed"])
def test_in_the_band_of_the_threshold(name):
    """Around the threshold both decisions occur, one on each side, and the band is as narrow as documented."""
    size = (8, 512)
    off = np.linspace(-4 * BAND, 4 * BAND, 512) * np.ones(size)
    ones = np.ones(size, np.float32)
    camera = compare.camera(np.random.default_rng(0), 512, 8)
    motion = np.zeros((*size, 3), np.float32)
    if name == "color":
        dark = np.broadcast_to((0.5 - off)[..., None], (*size, 3)).astype(np.float32)
        named = {"color": np.ones_like(dark), "previous_color": dark}
    elif name == "speed":
        motion[..., 1] = np.where(np.arange(8) < 4, 2, -2)[:, None] * (1 + off)
        named = {"speed": 2.0}
    elif name == "depth":
        named = {"depth": 3 * ones, "previous_depth": (3 * (1.1 + off)).astype(np.float32)}
    elif name == "normal":
        angle = np.radians(25) + off / np.sin(np.radians(25))
        tilted = np.stack([np.sin(angle), np.cos(angle), 0 * angle], -1).astype(np.float32)
        named = {"normal": np.broadcast_to(np.float32([0, 1, 0]), (*size, 3)), "previous_normal": tilted}
    else:
        # Facing the previous camera, the distance from a plane is a difference of depths; centre rays have length one.
        forward = np.broadcast_to(camera.forward.astype(np.float32), (*size, 3))
        named = {"depth": 3 * ones, "previous_depth": (3 * (1.01 + off)).astype(np.float32)}
        named |= {"normal": forward, "previous_normal": forward, "previous_camera": camera}
    kept = yester.reproject(ones, motion, fallback=False, **named)[1] > 0.99
    assert kept[off < -1.5 * BAND].all()
    assert not kept[off > 1.5 * BAND].any()
    inside = np.abs(off) <= 1.5 * BAND
    assert 0.1 < kept[inside].mean() < 0.9


def test_identity_is_the_identity():
    """Pixels without motion are not filtered: the same bits for every filter, with every test passing."""
    rng = np.random.default_rng(0)
    history = compare.colors(rng, 13, 29, holes=0)
    now = compare.surfaces(rng, 13, 29)
    depth = np.where(now["depth"] > 0, now["depth"], 1).astype(np.float32)
    buffers = {"depth": depth, "normal": now["normal"], "ids": now["ids"]}
    twice = buffers | {f"previous_{name}": buffer for name, buffer in buffers.items()}
    for camera in ({}, {"previous_camera": compare.camera(rng, 29, 13)}):
        for filter in ("nearest", "bilinear"):
            motion = np.zeros((13, 29, 3), np.float32)
            values, coverage = yester.reproject(history, motion, filter=filter, **twice, **camera)
            assert_same_bits(values, history)
            assert_same_bits(coverage, np.ones((13, 29), np.float32))


@pytest.mark.parametrize("filter", ["nearest", "bilinear"])
def test_whole_pixels_move_whole_pixels(filter):
    rng = np.random.default_rng(0)
    history = compare.colors(rng, 9, 12, holes=0)
    motion = np.broadcast_to(np.float32([2, -1]), (9, 12, 2))
    values, coverage = yester.reproject(history, motion, filter=filter, fallback=False)
    assert_same_bits(np.ascontiguousarray(values[1:, :-2]), np.ascontiguousarray(history[:-1, 2:]))
    assert (coverage[1:, :-2] == 1).all()
    assert (coverage[0] == 0).all()
    assert (coverage[:, -2:] == 0).all()
    assert (values[0] == 0).all()


@pytest.mark.parametrize("filter", ["nearest", "bilinear"])
def test_constant_and_scale(filter):
    """Weights sum to one: a constant stays, and scaling by a power of two scales the result, bit for bit."""
    rng = np.random.default_rng(0)
    motion = compare.motions(rng, 31, 33)
    constant = np.full((31, 33, 3), 0.7, np.float32)
    values, coverage = yester.reproject(constant, motion, filter=filter)
    assert 0.5 < (coverage > 0).mean() < 1
    np.testing.assert_allclose(values[coverage > 0], 0.7, rtol=3e-7)
    assert (values[coverage == 0] == 0).all()
    history = compare.colors(rng, 31, 33)
    values, _ = yester.reproject(history, motion, filter=filter)
    for k in (-20, 3, 40):
        assert_same_bits(yester.reproject(np.ldexp(history, k), motion, filter=filter)[0], np.ldexp(values, k))


def test_together_is_apart_where_all_are_finite():
    rng = np.random.default_rng(0)
    images = [compare.colors(rng, 9, 20, c, holes=0) for c in (3, 2, 1)]
    images.append(images[0][..., 0].copy())
    motion = compare.motions(rng, 9, 20)
    together, coverage = yester.reproject(images, motion)
    for image, value in zip(images, together, strict=True):
        alone, alone_coverage = yester.reproject(image, motion)
        assert value.shape == image.shape
        assert_same_bits(value, alone)
        assert_same_bits(coverage, alone_coverage)
    again, _ = yester.reproject(tuple(images), motion)
    assert isinstance(again, list)


def test_a_hole_in_one_image_is_a_hole_in_all():
    images = [np.ones((3, 3, 3), np.float32), np.ones((3, 3), np.float32)]
    images[1][1, 1] = np.nan
    (color, scalar), coverage = yester.reproject(images, np.zeros((3, 3, 2), np.float32), fallback=False)
    assert coverage[1, 1] == 0
    assert (color[1, 1] == 0).all()
    assert scalar[1, 1] == 0
    assert coverage.sum() == 8


def test_fallback_is_the_mean_of_the_neighbours():
    history = np.arange(9, dtype=np.float32).reshape(3, 3)
    history[1, 1] = np.nan
    motion = np.zeros((3, 3, 2), np.float32)
    for filter in ("nearest", "bilinear"):
        values, coverage = yester.reproject(history, motion, filter=filter)
        assert values[1, 1] == pytest.approx(4, rel=1e-6)
        assert coverage[1, 1] == pytest.approx(8 / 9)


@pytest.mark.parametrize(("share", "kept"), [(0.0099, False), (0.0101, True)])
def test_a_hundredth_of_the_footprint_is_enough(share, kept):
    history = np.float32([[np.nan, 5]])
    motion = np.zeros((1, 2, 2), np.float32)
    motion[0, 0, 0] = share
    values, coverage = yester.reproject(history, motion, fallback=False)
    assert (values[0, 0], coverage[0, 0]) == pytest.approx((5, share) if kept else (0, 0))
    values, coverage = yester.reproject(history, motion)
    assert (values[0, 0], coverage[0, 0]) == pytest.approx((5, share if kept else 1 / 9))


def test_holes_never_spread():
    rng = np.random.default_rng(0)
    history = compare.colors(rng, 40, 50, holes=0.5)
    values, coverage = yester.reproject(history, compare.motions(rng, 40, 50))
    assert np.isfinite(values).all()
    assert ((coverage >= 0) & (coverage <= 1)).all()
    values, coverage = yester.reproject(np.full_like(history, np.nan), np.zeros((40, 50, 2), np.float32))
    assert not values.any()
    assert not coverage.any()


def test_without_motion_there_is_no_history():
    motion = np.zeros((2, 4, 2), np.float32)
    motion[0, :, 0] = [np.nan, np.inf, -np.inf, 3e38]
    motion[1, :, 1] = [np.nan, np.inf, -np.inf, -3e38]
    values, coverage = yester.reproject(np.ones((2, 4), np.float32), motion)
    assert not values.any()
    assert not coverage.any()


def test_background_is_a_surface():
    """Infinite depth, and none above 0, match one another alone; unknown depths match nothing."""
    depth = np.float32([[np.inf, np.inf, 1, np.nan, 0, -1, 1, 0, np.inf, 1, 0]])
    before = np.float32([[np.inf, 1, np.inf, np.nan, 0, -1, 1, np.inf, -1, 0, 1]])
    normal = np.zeros((1, 11, 3), np.float32)
    motion = np.zeros((1, 11, 3), np.float32)
    camera = {"previous_camera": compare.camera(np.random.default_rng(0), 11, 1)}
    for plane in ({}, {"normal": normal, "previous_normal": normal, **camera}):
        named = {"depth": depth, "previous_depth": before, "fallback": False, **plane}
        _, coverage = yester.reproject(np.ones((1, 11), np.float32), motion, **named)
        np.testing.assert_array_equal(coverage, [[1, 0, 0, 0, 1, 1, 1, 1, 1, 0, 0]])


def test_depth_motion_moves_the_expected_depth():
    motion = np.zeros((1, 2, 3), np.float32)
    motion[0, 0, 2] = 1
    depth, before = np.float32([[1, 1]]), np.float32([[2, 2]])
    _, coverage = yester.reproject(depth, motion, depth=depth, previous_depth=before, fallback=False)
    np.testing.assert_array_equal(coverage, [[1, 0]])
    _, coverage = yester.reproject(depth, motion[..., :2], depth=depth, previous_depth=before, fallback=False)
    np.testing.assert_array_equal(coverage, [[0, 0]])


def test_plane_keeps_grazing_surfaces():
    """On a floor seen at a grazing angle the depths of neighbours differ by more than any bound; the plane does not."""
    before, now = flight.shoot(0, 64, 48), flight.shoot(1, 64, 48)
    floor, motion = now.ids == flight.GROUND, now.motion
    named = {"depth": now.depth, "previous_depth": before.depth, "normal": now.normal, "previous_normal": before.normal}
    _, relative = yester.reproject(before.color, motion, relative_depth=0.01, fallback=False, **named)
    _, plane = yester.reproject(before.color, motion, previous_camera=before.camera, fallback=False, **named)
    assert plane[floor].mean() > 0.95
    assert relative[floor].mean() < plane[floor].mean() - 0.1


def glide(image, x, y=0.0, **named):
    motion = np.broadcast_to(np.float32([x, y]), (*image.shape[:2], 2))
    return yester.reproject(image, motion, **named)[0]


@pytest.mark.parametrize("filter", WIDE)
@each("size", TAILS[::7])
def test_wide_filters_against_the_reference(filter, size):
    """Without holes, so that the wide filters cover nearly every pixel."""
    rng = np.random.default_rng(size[1])
    size = (size[0] + 5, size[1])
    motion = compare.motions(rng, *size)
    coverage = check(rng.normal(0, 1, (*size, 2)).astype(np.float32), motion, filter=filter, dering=False)
    check(rng.normal(0, 1, (*size, 2)).astype(np.float32), motion, filter=filter)
    assert size[1] < 16 or (coverage == 1).mean() > 0.3


@pytest.mark.parametrize("filter", WIDE)
def test_wide_filters_stay_sharp(filter):
    """After eight half-pixel steps to the right and eight back, more of a fine wave is left than with bilinear."""
    wave = np.sin(np.arange(64, dtype=np.float32) * 1.2)[None].repeat(9, 0)

    def left(filter):
        image = wave
        for step in [0.5] * 8 + [-0.5] * 8:
            image = glide(image, step, filter=filter, dering=False)
        return np.abs(image[4, 24:40]).max()

    assert left("bilinear") < 0.1
    assert left(filter) > 0.4


def test_catmull_rom_reproduces_parabolas():
    x = np.arange(32, dtype=np.float32)[None].repeat(8, 0)
    parabola = (x - 11) ** 2
    moved = glide(parabola, 0.3, filter="catmull-rom", dering=False)
    np.testing.assert_allclose(moved[:, 2:-3], (x + 0.3 - 11)[:, 2:-3] ** 2, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("filter", WIDE)
def test_dering_keeps_within_the_neighbours(filter):
    edge = (np.arange(32) > 15).astype(np.float32)[None].repeat(8, 0)
    rung, held = (glide(edge, 0.4, filter=filter, dering=dering) for dering in (False, True))
    assert rung.max() > 1.01
    assert rung.min() < -0.01
    assert 0 <= held.min() <= held.max() <= 1


@pytest.mark.parametrize("filter", WIDE)
def test_a_hole_turns_the_wide_filters_bilinear_around_it(filter):
    rng = np.random.default_rng(0)
    image = rng.random((16, 16), np.float32)
    image[8, 8] = np.nan
    wide, bilinear, plain = (
        glide(np.nan_to_num(image) if whole else image, 0.25, 0.25, filter=name)
        for name, whole in ((filter, False), ("bilinear", False), (filter, True))
    )
    near = np.zeros((16, 16), bool)
    near[6:10, 6:10] = True
    if filter == "catmull-rom-5":
        near[[6, 6, 9, 9], [6, 9, 6, 9]] = False
    inside = np.zeros_like(near)
    inside[1:-2, 1:-2] = True
    assert np.isfinite(wide).all()
    assert_same_bits(wide[near], bilinear[near])
    assert_same_bits(wide[inside & ~near], plain[inside & ~near])


@pytest.mark.parametrize("filter", WIDE)
def test_wide_filters_without_motion_are_the_identity(filter):
    image = compare.colors(np.random.default_rng(1), 9, 13, holes=0)
    assert_same_bits(glide(image, 0.0, filter=filter), image)


def test_an_unknown_filter_lists_the_known():
    with pytest.raises(ValueError, match=r'filter: .*"nearest", "bilinear", "catmull-rom".*got "cubic"'):
        glide(np.zeros((4, 4), np.float32), 0.0, filter="cubic")


@pytest.mark.parametrize("filter", ["nearest", "bilinear", *WIDE])
@pytest.mark.parametrize("name", SOFT)
def test_a_pair_of_equals_is_the_number(name, filter):
    """A pair of equal thresholds gives the number's bits; a ramp gives neither these nor the untested result."""
    rng = np.random.default_rng(2)
    history, motion = compare.colors(rng, 30, 40), compare.motions(rng, 30, 40, 3)
    named = surface(rng, 30, 40, TESTS) | {"filter": filter}
    threshold = {"relative_depth": 0.1, "plane_distance": 0.01, "normal_angle": 25.0, "relative_luminance": 0.5}
    threshold |= {"motion_difference": 0.2}
    number = threshold.get(name, 1.3)
    if name == "relative_depth":
        del named["previous_camera"]  # the plane test would replace this one
    calls = [{name: number}, {name: (number, number)}, *([{}] if name in threshold else [])]
    results = [yester.reproject(history, motion, **named, **call) for call in calls]
    for values, coverage in results[1:]:
        assert_same_bits(values, results[0][0])
        assert_same_bits(coverage, results[0][1])
    softly, _ = yester.reproject(history, motion, **named, **{name: (0.5 * number, 1.5 * number)})
    assert 0.005 < (softly != results[0][0]).any(-1).mean() < 0.9


def still(value, **named):
    """History and coverage without motion and fallback."""
    return yester.reproject(value, np.zeros((*value.shape[:2], 3), np.float32), fallback=False, **named)


@pytest.mark.parametrize("name", ["depth", "plane", "normal", "object_normal", "color", "speed"])
def test_ramps_are_linear(name):
    """Trust falls from 1 at the first threshold to 0 at the second: of depth, distance, cosine, luminance, speed."""
    size, amount = (4, 301), np.linspace(0, 0.3, 301)
    full, none = 0.1, 0.2
    want = np.clip((none - amount) / (none - full), 0, 1) * np.ones(size)
    ones, motion = np.ones(size, np.float32), np.zeros((*size, 3), np.float32)
    up = np.broadcast_to(np.float32([0, 1, 0]), (*size, 3))
    if name in ("depth", "plane"):
        named = {"depth": 5 * ones, "previous_depth": (5 * (1 + amount) * ones).astype(np.float32)}
        named["plane_distance" if name == "plane" else "relative_depth"] = (full, none)
        if name == "plane":
            camera = compare.camera(np.random.default_rng(0), 301, 4)
            forward = np.broadcast_to(camera.forward.astype(np.float32), (*size, 3))
            named |= {"normal": forward, "previous_normal": forward, "previous_camera": camera}
    elif name == "color":
        dark = (up * (1 - amount)[:, None]).astype(np.float32)
        named = {"color": up, "previous_color": dark, "relative_luminance": (full, none)}
    elif name == "speed":
        motion[..., 1] = amount
        want *= 1 - amount * (np.arange(4) == 3)[:, None]  # the last row fetches from outside
        named = {"speed": (full, none)}
    else:
        tilted = np.stack([np.sqrt(1 - (1 - amount) ** 2), 1 - amount, 0 * amount], -1).astype(np.float32)
        angles = tuple(np.degrees(np.arccos([1 - full, 1 - none])).tolist())
        named = {name: up, f"previous_{name}": np.broadcast_to(tilted, up.shape), "normal_angle": angles}
    _, coverage = yester.reproject(ones, motion, fallback=False, **named)
    want[want < 0.01] = 0  # too little trust in the footprint
    sure = np.abs(amount - 0.199) > 1e-4
    np.testing.assert_allclose(coverage[:, sure], want[:, sure], atol=5e-6)


def test_trust_weighs_the_taps():
    """Half a pixel to the right: one tap is trusted fully, the other by half; in the fallback, too."""
    history, depth = np.float32([[0, 3, 9]]), np.ones((1, 3), np.float32)
    before = np.float32([[1, 1.15, 1.3]])
    motion = np.zeros((1, 3, 2), np.float32)
    motion[0, 0, 0] = 0.5
    named = {"depth": depth, "previous_depth": before, "relative_depth": (0.1, 0.2)}
    for filter in ("bilinear", *WIDE):
        values, coverage = yester.reproject(history, motion, filter=filter, **named)
        assert (values[0, 0], coverage[0, 0]) == pytest.approx((1, 0.75), rel=1e-5)
    # The last pixel trusts no tap of its footprint; its fallback is 3, with a trust of one half.
    assert (values[0, 2], coverage[0, 2]) == pytest.approx((3, 0.5 / 9), rel=1e-5)
    motion[0, 1, 0] = 1  # the middle pixel fetches there: no trust, and the same fallback
    values, coverage = yester.reproject(history, motion, **named)
    assert (values[0, 1], coverage[0, 1]) == pytest.approx((3, 0.5 / 9), rel=1e-5)


@pytest.mark.parametrize("filter", WIDE)
def test_wide_filters_serve_unless_a_tap_has_no_trust(filter):
    """With their own weights, whatever the trust; coverage is that of the bilinear taps."""
    rng = np.random.default_rng(4)
    history, motion = rng.random((20, 20), np.float32), np.full((20, 20, 2), 0.25, np.float32)
    ones = np.ones((20, 20), np.float32)
    before = rng.uniform(1.1, 1.19, (20, 20)).astype(np.float32)
    named = {"depth": ones, "previous_depth": before, "relative_depth": (0.1, 0.2)}
    values, coverage = yester.reproject(history, motion, filter=filter, **named)
    plain, all_of_it = yester.reproject(history, motion, filter=filter)
    linear, share = yester.reproject(history, motion, **named)
    assert_same_bits(values[1:-2, 1:-2], plain[1:-2, 1:-2])
    assert_same_bits(coverage, share)
    assert all_of_it[5, 5] == 1
    assert (share[1:-2, 1:-2] < 0.95).all()
    before[8, 8] = 1.3
    values, _ = yester.reproject(history, motion, filter=filter, **named)
    linear, _ = yester.reproject(history, motion, **named)
    assert_same_bits(values[7:9, 7:9], linear[7:9, 7:9])
    assert values[12, 12] == plain[12, 12] != linear[12, 12]


@pytest.mark.parametrize("filter", ["nearest", "bilinear"])
def test_constants_pass_through_ramps(filter):
    rng = np.random.default_rng(6)
    motion = compare.motions(rng, 40, 50, 3)
    named = surface(rng, 40, 50, ["depth", "object_normal", "color"]) | SOFT | {"speed": (0.5, 9.0)}
    values, coverage = yester.reproject(np.full((40, 50, 3), 0.7, np.float32), motion, filter=filter, **named)
    np.testing.assert_allclose(values[coverage > 0], 0.7, rtol=3e-7)
    assert (values[coverage == 0] == 0).all()
    assert ((coverage >= 0) & (coverage <= 1)).all()
    assert ((coverage > 0.01) & (coverage < 0.99)).mean() > 0.1
    assert 0.05 < (coverage == 0).mean() < 0.9


def test_object_normals_stand_in_for_normals():
    """A rotated object keeps them; where they differ, equal world normals do not help; the plane test uses these."""
    rng = np.random.default_rng(8)
    ones = np.ones((5, 6), np.float32)
    here = rng.normal(0, 1, (5, 6, 3)).astype(np.float32)
    pair = {"normal": here, "previous_normal": -here}
    objects = {"object_normal": here, "previous_object_normal": here}
    assert (still(ones, **pair)[1] == 0).all()
    assert (still(ones, **pair, **objects)[1] == 1).all()
    assert (still(ones, **objects)[1] == 1).all()
    swapped = {**objects, "previous_object_normal": -here}
    assert (still(ones, normal=here, previous_normal=here, **swapped)[1] == 0).all()
    swapped["previous_object_normal"] = np.zeros_like(here)  # zero normals pass
    assert (still(ones, **pair, **swapped)[1] == 1).all()
    depths = {"depth": ones, "previous_depth": 1.05 * ones, "previous_camera": compare.camera(rng, 6, 5)}
    distant = still(ones, **depths, **pair, **objects)[1]
    assert_same_bits(distant, still(ones, **depths, normal=here, previous_normal=here)[1])
    assert 0.1 < distant.mean() < 0.9


def test_luminance_compares_valid_colours():
    """Black matches black, a missing colour passes, and only luminance counts."""
    color = np.float32([[[0, 0, 0], [np.nan, 0, 0], [1, 1, 1], [0, 0, 0], [1, 1, 1], [0.7152, 0, 0], [-1, -1, -1]]])
    before = np.float32([[[0, 0, 0], [9, 9, 9], [1, np.inf, 1], [1, 1, 1], [0.4, 0.4, 0.4], [0, 0.2126, 0], [1, 1, 1]]])
    named = {"color": color, "previous_color": before}
    ones = np.ones((1, 7), np.float32)
    np.testing.assert_array_equal(still(ones, **named)[1], [[1, 1, 1, 0, 0, 1, 0]])
    np.testing.assert_array_equal(still(ones, **named, relative_luminance=1.0)[1], [[1, 1, 1, 1, 1, 1, 0]])
    np.testing.assert_array_equal(still(ones, **named, relative_luminance=2.0)[1], 1)
    _, coverage = still(ones, **named, relative_luminance=(0.0, 2.0))
    np.testing.assert_allclose(coverage, [[1, 1, 1, 0.5, 0.7, 1, 0]], atol=1e-6)


def test_speed_is_the_length_of_motion():
    motion = np.zeros((1, 5, 3), np.float32)
    motion[0, :, 0] = [0, 3, 0, 2, -4]
    motion[0, :, 2] = 100  # the change of depth does not count
    ones = np.ones((1, 5), np.float32)
    for speed, want in (
        (0, [1, 0, 1, 0, 0]),
        (2.0, [1, 0, 1, 0, 0]),
        (3.0, [1, 1, 1, 0, 0]),
        (np.inf, [1, 1, 1, 0, 1]),
    ):
        _, coverage = yester.reproject(ones, motion, speed=speed, fallback=False)
        np.testing.assert_array_equal(coverage, [want])
    _, coverage = yester.reproject(ones, motion, speed=(2.0, 4.0), fallback=False)
    np.testing.assert_allclose(coverage, [[1, 0.5, 1, 0, 0]])


BAD = {
    "relative_depth": [(0.2, 0.1), (0.0, 0.1), (0.1, np.nan), (-1.0, 1.0)],
    "plane_distance": [(0.2, 0.1), (0.0, 0.1), (np.nan, 0.1)],
    "normal_angle": [(20.0, 10.0), (-1.0, 10.0), (10.0, 181.0), (np.nan, 10.0), np.inf],
    "relative_luminance": [(0.2, 0.1), (-0.1, 0.5), (0.1, np.nan), -0.1, np.nan],
    "speed": [(2.0, 1.0), (-1.0, 1.0), (1.0, np.nan), -1.0, np.nan],
}


@pytest.mark.parametrize(("name", "value"), [(name, value) for name, values in BAD.items() for value in values])
def test_bad_thresholds(name, value):
    motion = np.zeros((2, 3, 2), np.float32)
    for call in (
        lambda **named: yester.reproject(np.ones((2, 3)), motion, **named),
        lambda **named: yester.consistency(motion, **named),
    ):
        with pytest.raises(ValueError, match=rf"^{name}: expected"):
            call(**{name: value})


@pytest.mark.parametrize("name", SOFT)
def test_thresholds_of_another_type(name):
    motion = np.zeros((2, 3, 2), np.float32)
    for value in ("0.5", (1.0,), (1.0, 2.0, 3.0), (1.0, "2"), {}):
        with pytest.raises(TypeError, match=name):
            yester.reproject(np.ones((2, 3)), motion, **{name: value})


@pytest.mark.parametrize("name", ["object_normal", "color"])
def test_one_of_a_pair(name):
    motion, ones = np.zeros((2, 3, 2), np.float32), np.ones((2, 3, 3), np.float32)
    for there, absent in ((name, f"previous_{name}"), (f"previous_{name}", name)):
        for call in (yester.consistency, lambda *a, **named: yester.reproject(ones, *a, **named)):
            with pytest.raises(ValueError, match=rf"^{there}: needs {absent} as well"):
                call(motion, **{there: ones})
            with pytest.raises(ValueError, match=rf"^{there}: expected height 2 and width 3"):
                call(motion, **{there: ones[1:], absent: ones})
            with pytest.raises(ValueError, match=rf"^{there}: expected shape \(H, W, 3\)"):
                call(motion, **{there: ones[..., 0], absent: ones})
