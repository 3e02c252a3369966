import compare
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, assert_same_bits, each, tensor
from hypothesis import given
from hypothesis import strategies as st
from yester import Camera

RESULTS = ("color", "depth", "offset", "quality")


def view(x=0.0, z=5.0, size=(60, 40), fov=50.0, target=(0, 0, 0)) -> Camera:
    return Camera.from_look_at([x, 0, z], target, [0, 1, 0], fov, *size)


def points(rng, height, width) -> dict:
    """Points of surfaces and background with holes, anywhere in their pixels, with a small drift."""
    quality = rng.uniform(0.1, 3, (height, width)).astype(np.float32)
    broken = rng.random(quality.shape) < 0.05
    quality[broken] = rng.choice([np.nan, 0, -1, np.inf], int(broken.sum()))
    return {
        "color": compare.colors(rng, height, width),
        "depth": compare.surfaces(rng, height, width)["depth"],
        "offset": rng.uniform(-0.5, 0.5, (height, width, 2)).astype(np.float32),
        "drift": np.where(rng.random((height, width, 1)) < 0.7, 0, compare.motions(rng, height, width, 3)),
        "quality": quality,
    }


def check(given: dict, camera: Camera, previous: Camera, **named) -> tuple:
    got = yester.splat(**given, camera=camera, previous_camera=previous, **named)
    want = reference.splat(**tensor(given), camera=camera, previous_camera=previous, **named)
    # A point on the border between two pixels may go to either; a large one covers a whole row.
    flips = min(got[1].size // 12, 16)
    for name, image, other in zip(RESULTS, got, want, strict=True):
        assert image.dtype == np.float32
        assert_close(f"splat {name}", image, other, rtol=2e-5, flips=flips, scale=1 if name == "offset" else None)
    return got


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    spread=st.sampled_from([0.0, 0.02, 0.3, 3.0]),
    nearer=st.sampled_from([0.0, 2.0, 4.0]),
    tolerance=st.sampled_from([0.02, 0.1, 0.5, np.inf]),
    reach=st.sampled_from([0.0, 0.5, 1.0]),
    absent=st.sets(st.sampled_from(["offset", "drift", "quality"])),
)
def test_reference(seed, size, spread, nearer, tolerance, reach, absent):
    rng = np.random.default_rng(seed)
    given = {name: value for name, value in points(rng, *size).items() if name not in absent}
    origin = rng.normal(0, spread, 3)
    cameras = [
        Camera.from_look_at(o, [0, 0, -10], [0, 1, 0], fov, size[1], size[0])
        for o, fov in ((origin - [0, 0, nearer], 45), ([0, 0, 0], rng.choice([30, 45, 60])))
    ]
    check(given, *cameras, tolerance=float(tolerance), reach=reach)


@each(("height", "width"), SIZES + TAILS[::4])
def test_sizes(height, width):
    rng = np.random.default_rng(width)
    check(points(rng, height, width), *(compare.camera(rng, width, height, spread=0.05) for _ in range(2)))


def test_images_of_any_channels():
    rng = np.random.default_rng(0)
    given = points(rng, 20, 31)
    cameras = view(0.1, size=(31, 20)), view(size=(31, 20))
    for color in (given["depth"], given["drift"][..., :1], np.dstack([given["color"]] * 2)):
        got = check({**given, "color": color.copy()}, *cameras)
        assert got[0].shape == color.shape


def test_between_equal_cameras_all_stays():
    """Bit for bit, for any position within the pixels; missing points are holes."""
    rng = np.random.default_rng(0)
    given = points(rng, 40, 60)
    del given["drift"]
    got = yester.splat(**given, camera=view(), previous_camera=view())
    here = np.isfinite(given["color"]).all(-1) & (given["depth"] > 0)
    here &= np.isfinite(given["quality"]) & (given["quality"] > 0)
    assert 0.5 < here.mean() < 0.95
    for image, name in zip(got, RESULTS, strict=True):
        hole = 0 if name == "quality" else np.nan
        assert_same_bits(
            image, np.where(here.reshape(here.shape + (1,) * (image.ndim - 2)), given[name], np.float32(hole))
        )


@pytest.mark.parametrize("half", [-0.5, 0.5])
def test_points_on_the_border_stay_in_their_pixel(half):
    color = np.arange(12, dtype=np.float32).reshape(2, 6)
    offset = np.full((2, 6, 2), half, np.float32)
    still = {"camera": view(size=(6, 2)), "previous_camera": view(size=(6, 2))}
    got, _, left, quality = yester.splat(color, np.ones((2, 6)), **still, offset=offset)
    assert_same_bits(got, color)
    np.testing.assert_allclose(left, offset, rtol=1e-6)
    assert (quality == 1).all()


def test_cracks_are_filled_from_both_sides():
    """A column that no point covers takes its own row, and of its neighbours as much from above as from below."""
    color = np.repeat(np.arange(7, dtype=np.float32)[:, None], 6, 1)
    drift = np.zeros((7, 6, 2), np.float32)
    drift[:, 3:, 0] = -1
    still = {"camera": view(size=(6, 7)), "previous_camera": view(size=(6, 7)), "reach": 0.5}
    got, *_ = yester.splat(color, np.ones((7, 6)), **still, drift=drift)
    np.testing.assert_allclose(got[1:-1], color[1:-1], rtol=1e-6)
    flipped, *_ = yester.splat(color[::-1].copy(), np.ones((7, 6)), **still, drift=drift)
    np.testing.assert_allclose(flipped, got[::-1], rtol=1e-6)


def test_constant_stays_constant():
    color = np.full((40, 60, 3), np.float32([0.7, 0.1, 3]))
    depth = 5 + 0.01 * np.arange(60, dtype=np.float32) + np.zeros((40, 1), np.float32)
    got, far, offset, quality = yester.splat(color, depth, view(0.3, 4.2), view())
    seen = quality > 0
    assert seen.mean() > 0.8
    assert (got[seen] == color[0, 0]).all()
    assert np.isnan(got[~seen]).all()
    assert np.isnan(far[~seen]).all()
    assert (np.abs(offset[seen]) <= 0.5).all()
    assert (quality[seen] <= 1).all()


def test_points_land_where_they_project():
    """One point: pixel, offset and depth are those of the camera's projection."""
    color, depth = np.full((40, 60), np.nan, np.float32), np.full((40, 60), 5, np.float32)
    color[13, 22] = 1
    offset = np.full((40, 60, 2), np.float32([0.3, -0.2]))
    here, there = view(), view(0.21, 5.1)
    pixel, z = there.project(here.unproject([22.8, 13.3], 5.0))
    got, far, place, quality = yester.splat(color, depth, there, here, offset=offset)
    ((y, x),) = np.argwhere(quality > 0)
    assert got[y, x] == 1
    np.testing.assert_allclose([x + 0.5 + place[y, x, 0], y + 0.5 + place[y, x, 1]], pixel, atol=1e-5)
    np.testing.assert_allclose(far[y, x], z, rtol=1e-6)


def test_approaching_points_cover_more_pixels():
    """At a third of the distance a point covers 3×3 pixels, at 1/81 of the weight; no hole is left."""
    color, depth = np.full((40, 60), np.nan, np.float32), np.full((40, 60), 6, np.float32)
    color[20, 30] = 1
    _, _, offset, quality = yester.splat(color, depth, view(z=2), view(z=6))
    y, x = np.nonzero(quality)
    assert (np.ptp(y), np.ptp(x), len(y)) == (2, 2, 9)
    np.testing.assert_allclose(quality[y, x], 1 / 81, rtol=0.04)
    assert (offset[quality > 0] != 0).all(-1).sum() <= 1
    for nearer in (5.9, 5, 4, 3, 2, 0.5):
        _, _, _, quality = yester.splat(np.ones_like(depth), depth, view(z=nearer), view(z=6))
        assert (quality > 0).all()
    zoomed = yester.splat(np.ones_like(depth), depth, view(fov=20), view(fov=50))
    assert (zoomed[3] > 0).all()


def test_the_nearest_is_seen():
    """A near point hides a far one in its pixel at any quality; at nearly equal depth, both count by quality."""
    for gap, expected in ((1.0, 1.0), (0.001, (1 + 3 * 0.99 * 5) / (1 + 3 * 0.99))):
        color, depth = np.full((1, 60), np.nan, np.float32), np.full((1, 60), 1, np.float32)
        color[0, [10, 50]] = 1, 5
        depth[0, 50] = 1 + gap
        quality = np.where(color == 5, np.float32(3), np.float32(1))
        drift = np.zeros((1, 60, 2), np.float32)
        drift[0, 50, 0] = 40
        camera = view(size=(60, 1))
        got = yester.splat(color, depth, camera, camera, quality=quality, drift=drift)
        np.testing.assert_allclose(got[0][0, 10], expected, rtol=1e-4)
        assert (got[3] > 0).sum() == 1


def test_background_is_behind_and_turns_with_the_camera():
    color = np.ones((40, 60), np.float32)
    depth = np.full((40, 60), np.inf, np.float32)
    moved = yester.splat(color, depth, view(3.0, target=(3, 0, 0)), view())
    # It stays at infinite distance, without drift.
    assert_same_bits(moved[3], color)
    assert_same_bits(moved[1], depth)
    turned = yester.splat(color, depth, view(target=(1, 0, 0)), view())
    assert 0.05 < (turned[3] == 0).mean() < 0.5
    depth[:, 30] = 4
    color[:, 30] = 2
    got = yester.splat(color, depth, view(0.2, target=(0.2, 0, 0)), view())
    # In each row, the line covers one pixel, and leaves one empty where it was: nothing was known behind it.
    assert (got[0] == 2).sum(1).tolist() == [1] * 40
    assert (got[3] == 0).sum(1).tolist() == [1] * 40
    assert (got[0] == 1).sum() == 40 * 58
    assert (got[0][got[1] < 9] == 2).all()


def test_drift_is_motion_that_cameras_do_not_explain():
    rng = np.random.default_rng(0)
    color = rng.random((40, 60)).astype(np.float32)
    depth = np.full((40, 60), 5, np.float32)
    drift = np.full((40, 60, 3), np.float32([-3, 2, 1]))
    got = yester.splat(color, depth, view(), view(), drift=drift)
    assert_same_bits(got[0][:38, 3:], color[2:, :57])
    assert (got[1][:38, 3:] == 4).all()
    assert (got[3] > 0).sum() == 38 * 57
    nowhere = np.full_like(drift, np.nan)
    assert_same_bits(yester.splat(color, depth, view(), view(), drift=nowhere)[0], color)


def test_nothing_is_left_of_nothing():
    color = np.full((40, 60, 3), np.nan, np.float32)
    for depth in (np.ones((40, 60), np.float32), np.full((40, 60), np.nan, np.float32)):
        got = yester.splat(color, depth, view(), view())
        assert np.isnan(got[0]).all()
        assert not got[3].any()
    behind = Camera.from_look_at([0, 0, 5], [0, 0, 9], [0, 1, 0], 50, 60, 40)
    assert not yester.splat(np.ones((40, 60)), np.ones((40, 60)), behind, view())[3].any()


def test_a_walk_with_offsets_does_not_blur():
    """Thirty steps of a third of a pixel: with offsets the image follows sharply; without, it stays behind."""
    rng = np.random.default_rng(0)
    color, depth = rng.random((40, 60)).astype(np.float32), np.full((40, 60), 5, np.float32)
    step = 5 / 60 * 2 * np.tan(np.radians(25)) / 3  # a third of a pixel

    def along(i):
        return view(i * step, target=(i * step, 0, 0))

    carried = color, depth, None, None
    for i in range(30):
        image, far, offset, quality = carried
        carried = yester.splat(image, far, along(i + 1), along(i), offset=offset, quality=quality)
    assert_same_bits(carried[0][:, :49], color[:, 10:59])
    image = color
    for i in range(30):
        image = yester.splat(image, depth, along(i + 1), along(i))[0]
    assert_same_bits(image, color)


def test_points_stand_in_where_no_other_is():
    """Within half a pixel of its square, with a sixteenth of its weight, and never where another point covers."""
    color, depth = np.full((9, 9), np.nan, np.float32), np.full((9, 9), 5, np.float32)
    color[4, 4], color[4, 3] = 1, 7
    offset = np.zeros((9, 9, 2), np.float32)
    offset[4, 4] = 0.3, 0
    camera = view(size=(9, 9))
    got, _, place, quality = yester.splat(color, depth, camera, camera, offset=offset, reach=0.5)
    assert quality[4, 3] == quality[4, 4] == 1
    np.testing.assert_allclose(quality[4, 5], 1 / 16)
    assert (got[4, 3], got[4, 4], got[4, 5]) == (7, 1, 1)
    assert (place[4, 5] == 0).all()
    assert (quality[4, 6:] == 0).all()
    assert (yester.splat(color, depth, camera, camera, offset=offset)[3] > 0).sum() == 2


@pytest.mark.parametrize("reach", [-0.1, 1.1, np.nan])
def test_reach_out_of_range(reach):
    flat = np.ones((40, 60))
    with pytest.raises(ValueError, match="reach"):
        yester.splat(flat, flat, view(), view(), reach=reach)


@pytest.mark.parametrize("tolerance", [0, -1, np.nan])
def test_out_of_range(tolerance):
    flat = np.ones((40, 60))
    with pytest.raises(ValueError, match="tolerance"):
        yester.splat(flat, flat, view(), view(), tolerance=tolerance)
