import compare
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, assert_same_bits, each, tensor
from hypothesis import given
from hypothesis import strategies as st


def inputs(rng, height, width, buffers, holes=0.05):
    """Noisy light that varies nonlinearly over tilted planes, with the named buffers of the surfaces."""
    now = compare.surfaces(rng, height, width)
    camera = compare.camera(rng, width, height)
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    position = np.stack([x / 10, y / 10, np.where(np.isfinite(now["depth"]), now["depth"], 1)], -1)
    trend = 1 + 0.1 * position[..., :1] ** 2 + 0.2 * now["normal"]
    color = compare.colors(rng, height, width, holes=holes) * trend.astype(np.float32)
    position[~np.isfinite(now["depth"])] = np.nan
    weight = rng.choice(np.float32([0, 1, 2.5, 20, np.nan, -1]), (height, width), p=[0.1, 0.3, 0.3, 0.28, 0.01, 0.01])
    given = {
        "normal": {"normal": now["normal"]},
        "position": {"geometry": position.astype(np.float32)},
        "depth": {"geometry": now["depth"], "camera": camera},
        "weight": {"weight": weight},
    }
    return color, {name: value for buffer in buffers for name, value in given[buffer].items()}


def check(color, **named):
    got, used = yester.regress(color, **named)
    want, want_used, distance = reference.regress(tensor(color), **tensor(named), margin=True)
    # Rays in single precision move what is decided.
    sure = distance.numpy() > (1e-4 if "camera" in named else 1e-9)
    assert got.dtype == np.float32
    np.testing.assert_array_equal(used[sure], want_used.numpy()[sure])
    assert_close("regress", got, want, where=sure, rtol=2e-4 if "camera" in named else 1e-5)
    return used, sure


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 70), st.integers(1, 70)),
    buffers=st.sets(st.sampled_from(["normal", "position", "weight"])),
    block=st.sampled_from([4, 5, 16, 32, 256]),
    offset=st.tuples(st.integers(-50, 50), st.integers(-50, 50)),
    features=st.sampled_from(["fewest", "all"]),
    holes=st.sampled_from([0.0, 0.05, 0.9]),
)
def test_reference(seed, size, buffers, holes, **named):
    rng = np.random.default_rng(seed)
    color, surface = inputs(rng, *size, buffers, holes)
    check(color, **surface, **named)


@pytest.mark.parametrize("features", ["fewest", "all"])
@pytest.mark.parametrize("buffers", [["depth"], ["depth", "normal"]])
def test_depth_with_a_camera(buffers, features):
    rng = np.random.default_rng(1)
    color, surface = inputs(rng, 61, 77, buffers)
    used, sure = check(color, block=16, features=features, **surface)
    assert used.max() >= (2 if features == "fewest" else 7)
    assert sure.mean() > 0.5


@each("size", SIZES + TAILS)
def test_sizes(size):
    rng = np.random.default_rng(size[1])
    color, surface = inputs(rng, *size, ["normal", "position"])
    check(color, block=16, offset=(5, 3), **surface)


def plane(height=40, width=50):
    """Positions on a plane that is aligned with no axis."""
    x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    return np.stack([x, y, 5 + 0.3 * x - 0.7 * y], -1).astype(np.float32)


def test_features_are_kept_and_noise_is_not():
    rng = np.random.default_rng(0)
    position = plane()
    light = (2 + position[..., :1] - 0.5 * position[..., 1:2] ** 2) * np.float32([1, 0.5, 2])
    fitted, _ = yester.regress(light, geometry=position)
    np.testing.assert_allclose(fitted, light, rtol=1e-6)
    noisy = light * rng.uniform(0, 2, (40, 50, 1)).astype(np.float32)
    fitted, _ = yester.regress(noisy, geometry=position)
    assert np.mean((fitted - light) ** 2) < 0.02 * np.mean((noisy - light) ** 2)


def test_constant_features_are_not_modelled():
    rng = np.random.default_rng(0)
    color = rng.exponential(1, (16, 16, 3)).astype(np.float32)
    flat = np.broadcast_to(np.float32([0, 0.6, 0.8]), (16, 16, 3))
    far = np.broadcast_to(np.float32([1e3, -4, 7]), (16, 16, 3))
    fitted, used = yester.regress(color, normal=flat, geometry=far, features="all")
    assert (used == 1).all()
    np.testing.assert_allclose(fitted, np.broadcast_to(color.mean((0, 1)), color.shape), rtol=1e-5)
    same = yester.regress(color)
    assert_same_bits(fitted, same[0])


def test_rank_deficiency():
    """Dependent features are left out: on a plane one coordinate of three, on a line two, and copies."""
    rng = np.random.default_rng(0)
    color = rng.exponential(1, (32, 32, 3)).astype(np.float32)
    position = plane(32, 32)
    _, used = yester.regress(color, geometry=position, features="all")
    # The constant, two of three coordinates, and the squares, of which the third has the mixed term.
    assert (used == 6).all()
    line = np.repeat(position[:1], 32, 0)
    _, used = yester.regress(color, geometry=line, features="all")
    assert (used == 3).all()
    normal = position / 8
    _, both = yester.regress(color, geometry=position, normal=normal, features="all")
    assert (both == 6).all()
    for shift in (0, 1e3, -1e5):
        moved = position + np.float32(shift)
        fitted, _ = yester.regress(color, geometry=moved, features="all")
        assert np.isfinite(fitted).all()
        assert fitted.min() >= color.min()
        assert fitted.max() <= color.max()


def test_fewest_selects_no_more_features_than_needed():
    """Pure noise needs the constant; a trend one feature more; a curve a square. Each feature fits some noise."""
    rng = np.random.default_rng(0)
    position = plane(64, 64)
    noise = rng.normal(1, 0.1, (64, 64, 3)).astype(np.float32)

    def count(light):
        return yester.regress(light, geometry=position, block=16)[1].mean()

    assert count(noise) < 1.5
    assert 1.9 < count(noise + 3 * position[..., :1]) < 2.6
    fit = {
        features: yester.regress(noise, geometry=position, block=16, features=features)[0]
        for features in ("all", "fewest")
    }
    assert np.var(fit["fewest"]) < 0.6 * np.var(fit["all"])
    bent = noise + 40 * (position[..., :1] - 0.2) ** 2
    few = yester.regress(bent, geometry=position, block=64)
    assert 3 <= few[1].max() <= 5
    np.testing.assert_allclose(few[0], bent - noise + 1, atol=0.1)


def test_blocks():
    """Each block is fitted alone; an image smaller than a block is one; narrow blocks join their neighbours."""
    rng = np.random.default_rng(0)
    color = rng.exponential(1, (40, 70, 3)).astype(np.float32)

    def means(*parts):
        want = np.empty_like(color)
        for part in parts:
            want[part] = color[part].mean((0, 1), np.float64)
        return want

    np.testing.assert_allclose(yester.regress(color, block=128)[0], means(np.s_[:, :]), rtol=1e-6)
    rows, columns = (np.s_[:16], np.s_[16:32], np.s_[32:]), (np.s_[:16], np.s_[16:32], np.s_[32:48], np.s_[48:])
    np.testing.assert_allclose(
        yester.regress(color, block=16)[0], means(*((y, x) for y in rows for x in columns)), rtol=1e-6
    )
    # Displaced by (5, 9): the first column of blocks would be 5 wide, and joins the next; the first row stays.
    rows, columns = (np.s_[:9], np.s_[9:25], np.s_[25:]), (np.s_[:21], np.s_[21:37], np.s_[37:53], np.s_[53:])
    for offset in ((5, 9), (-11, 25), (21, -7)):
        fitted, _ = yester.regress(color, block=16, offset=offset)
        np.testing.assert_allclose(fitted, means(*((y, x) for y in rows for x in columns)), rtol=1e-6)


def test_constant_stays():
    color = np.full((33, 45, 3), np.float32([0.7, 1e-20, 3e30]))
    fitted, _ = yester.regress(color, geometry=plane(33, 45), normal=plane(33, 45), features="all")
    assert_same_bits(fitted, color)


def test_missing_pixels_are_filled_and_spread_nothing():
    position = plane()
    light = (2 + position[..., :1]) * np.float32([1, 0.5, 2])
    holes = np.random.default_rng(0).random((40, 50)) < 0.2
    color = light.copy()
    color[holes] = np.nan
    color[3, 4] = (1, np.inf, 1)
    fitted, used = yester.regress(color, geometry=position)
    inside = np.s_[:, 1:-1]  # clamped to the range of the samples
    np.testing.assert_allclose(fitted[inside], light[inside], rtol=0.02)
    assert (used > 0).all()
    weight = np.where(holes, 0, 1).astype(np.float32)
    color[holes] = 1e9
    color[3, 4] = light[3, 4]
    assert yester.regress(color, geometry=position, weight=weight)[0].max() <= light.max()


def test_pixels_without_surface_keep_their_colour():
    rng = np.random.default_rng(0)
    color = rng.exponential(1, (24, 24, 3)).astype(np.float32)
    position, normal = plane(24, 24), plane(24, 24)
    weight = np.ones((24, 24), np.float32)
    position[0, 0], normal[1, 1], normal[2, 2], weight[3, 3], weight[4, 4] = np.nan, 0, np.inf, np.nan, -1
    color[5, 5], position[5, 5] = np.nan, np.inf
    fitted, used = yester.regress(color, geometry=position, normal=normal, weight=weight)
    kept = np.zeros((24, 24), bool)
    kept[range(6), range(6)] = True
    np.testing.assert_array_equal(used == 0, kept)
    assert_same_bits(fitted[kept], color[kept])
    assert np.isfinite(fitted[~kept]).all()
    nobody = np.full((24, 24, 3), np.nan, np.float32)
    fitted, used = yester.regress(nobody, geometry=position)
    assert np.isnan(fitted).all()
    assert (used == 0).all()


def test_depth_and_position_are_equivalent():
    rng = np.random.default_rng(2)
    camera = compare.camera(rng, 48, 32)
    y, x = np.mgrid[:32, :48] + 0.5
    depth = (4 + 0.03 * x + np.sin(0.2 * y)).astype(np.float32)
    position = camera.unproject(np.stack([x, y], -1), depth).astype(np.float32)
    color = rng.exponential(1, (32, 48, 3)).astype(np.float32)
    for features in ("all", "fewest"):
        near, few = yester.regress(color, geometry=depth, camera=camera, features=features)
        far, many = yester.regress(color, geometry=position, features=features)
        np.testing.assert_array_equal(few, many)
        np.testing.assert_allclose(near, far, rtol=2e-3)


def test_depth_needs_a_camera():
    with pytest.raises(ValueError, match="camera"):
        yester.regress(np.ones((8, 8, 3)), geometry=np.ones((8, 8)))


@pytest.mark.parametrize("offset", [(1,), (1, 2, 3), (0.5, 1), "ab", None])
def test_offsets_are_two_whole_numbers(offset):
    with pytest.raises((TypeError, ValueError), match="offset"):
        yester.regress(np.ones((8, 8, 3)), offset=offset)
