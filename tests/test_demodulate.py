from dataclasses import replace

import compare
import flight
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, each, tensor


@each(("height", "width"), SIZES + TAILS)
def test_reference(height, width):
    rng = np.random.default_rng(width)
    color, emission = compare.colors(rng, height, width), compare.colors(rng, height, width)
    albedo = rng.uniform(-0.1, 1.2, (height, width, 3)).astype(np.float32)
    albedo[rng.random((height, width)) < 0.3] *= 0.03
    albedo[rng.random((height, width)) < 0.2] *= 0.003
    albedo[rng.random((height, width)) < 0.1] = rng.choice([0, np.nan, np.inf, 1e-5, 30])
    for name in ("demodulate", "remodulate"):
        for named in ({}, {"emission": emission}, {"where": rng.random((height, width)) < 0.5}):
            got = getattr(yester, name)(color, albedo, **named)
            want = getattr(reference, name)(tensor(color), tensor(albedo), **tensor(named)).numpy()
            assert got.dtype == np.float32
            # Differences of numbers near one, divided by 1/32 or more.
            scale = 32 if name == "demodulate" else 1
            missing = ~np.isfinite(want).all(-1)
            np.testing.assert_array_equal(~np.isfinite(got).all(-1), missing)
            assert_close(name, got, want, scale=scale, where=~missing)


@pytest.mark.parametrize("emission", [False, True])
def test_back_and_forth(emission):
    rng = np.random.default_rng(0)
    color = compare.colors(rng, 20, 30)
    albedo = rng.uniform(0, 1, color.shape).astype(np.float32)
    albedo[3] = 0
    named = {"emission": rng.exponential(0.1, color.shape).astype(np.float32)} if emission else {}
    back = yester.remodulate(yester.demodulate(color, albedo, **named), albedo, **named)
    seen = np.isfinite(color).all(-1)
    np.testing.assert_allclose(back[seen], color[seen], rtol=1e-5, atol=1e-6)
    assert not np.isfinite(back[~seen]).all(-1).any()


def test_white_is_the_identity():
    color = compare.colors(np.random.default_rng(0), 5, 7, holes=0)
    np.testing.assert_array_equal(yester.demodulate(color, np.ones_like(color)), color)
    np.testing.assert_array_equal(yester.remodulate(color, np.ones_like(color)), color)


def test_black_albedo_divides_by_one():
    color = compare.colors(np.random.default_rng(0), 5, 7, holes=0)
    np.testing.assert_array_equal(yester.demodulate(color, 0 * color), color)
    np.testing.assert_array_equal(yester.remodulate(color, 0 * color), color)


def test_no_reflectance_exceeds_one():
    color = compare.colors(np.random.default_rng(0), 5, 7, holes=0)
    np.testing.assert_array_equal(yester.demodulate(color, np.full_like(color, 30)), color)


def test_light_never_explodes():
    albedo = np.broadcast_to(np.geomspace(1e-6, 10, 1000, dtype=np.float32)[:, None], (1000, 3))[None]
    light = yester.demodulate(np.ones_like(albedo), albedo)
    np.testing.assert_allclose(light, 1 / np.clip(albedo, 1 / 32, 1), rtol=1e-6)


def test_one_channel_of_three_may_be_black():
    """Pure red is a valid reflectance."""
    light = yester.demodulate(np.ones((1, 1, 3), np.float32), np.float32([[[0.5, 0, 0]]]))
    np.testing.assert_array_equal(light, [[[2, 32, 32]]])


def test_broken_albedo_and_emission_count_as_zero():
    color = np.ones((1, 3, 3), np.float32)
    broken = np.full_like(color, np.nan)
    np.testing.assert_array_equal(yester.demodulate(color, broken), yester.demodulate(color, 0 * color))
    np.testing.assert_array_equal(yester.demodulate(color, color, emission=broken), color)
    np.testing.assert_array_equal(yester.remodulate(color, color, emission=broken), color)


def surfaces(rng, height, width):
    """Ids, some of them of few pixels, and an albedo that is dark, usual or a highlight's, by surface."""
    ids = rng.choice([0, 1, 2, 3, 7, 2**31 + 2, 2**32 - 1], (height, width)).astype(np.uint32)
    albedo = rng.uniform(0, 1, (height, width, 3)).astype(np.float32)
    for known, most in zip(np.unique(ids), rng.permutation([0, 5e-6, 5e-4, 1e-3, 0.5, 1.25, 1.26, 30]), strict=False):
        albedo[ids == known] *= np.float32(most) / max(albedo[ids == known].max(), 1e-9)
    albedo[rng.random((height, width)) < 0.05] = rng.choice([np.nan, np.inf, -np.inf, -3])
    return albedo, ids


@each(("height", "width"), SIZES + TAILS)
def test_reflectance_reference(height, width):
    albedo, ids = surfaces(np.random.default_rng(height), height, width)
    got = yester.is_reflectance(albedo, ids)
    assert got.dtype == bool
    want = reference.is_reflectance(tensor(albedo), tensor(ids.astype(np.int64))).numpy()
    np.testing.assert_array_equal(got, want)


@each(("height", "width"), SIZES + TAILS)
def test_regions_reference(height, width):
    """Without ids: of surfaces that touch, by normals and depths that are alike or nearly so, or unknown."""
    rng = np.random.default_rng(height)
    albedo, ids = surfaces(rng, height, width)
    turn = np.float32(0.2) * (ids % 7)[..., None] + rng.normal(0, 0.02, (height, width, 1)).astype(np.float32)
    normal = np.concatenate([np.sin(turn), np.zeros_like(turn), np.cos(turn)], -1)
    depth = np.where(ids % 3 == 0, np.inf, 5 + 0.07 * (ids % 5)).astype(np.float32)
    depth[rng.random(depth.shape) < 0.05] = rng.choice([np.nan, -1, 0])
    normal[rng.random(depth.shape) < 0.05] = rng.choice([np.nan, 0])
    for guides in ({"normal": normal, "depth": depth}, {"normal": normal}, {}):
        got = yester.is_reflectance(albedo, **guides)
        want = reference.is_reflectance(tensor(albedo), **{name: tensor(image) for name, image in guides.items()})
        assert (got is None) == (want is None)
        if got is not None:
            np.testing.assert_array_equal(got, want.numpy())


def materials(rng, height, width, grain):
    """White, black and grey, in squares of as many pixels, on surfaces of eight pixels; metal here and there."""
    y, x = np.mgrid[:height, :width]
    kinds = rng.choice([0, 0.5, 0.98, 0.99, 1], (height, width))[y // grain, x // grain]
    albedo = np.repeat(kinds.astype(np.float32)[..., None], 3, -1)
    albedo[rng.random((height, width)) < 0.02, 1] = rng.choice([0.4, np.nan, np.inf])
    turn = np.float32(0.3) * rng.integers(0, 2, (height, width))[y // 8, x // 8]
    normal = np.stack([np.sin(turn), np.zeros_like(turn), np.cos(turn)], -1)
    depth = (2 + 0.03 * rng.integers(0, 4, (height, width))[y // 8, x // 8]).astype(np.float32)
    return albedo, {"normal": normal, "depth": depth}


@each("grain", [1, 2, 8])
@each("metal", [False, True])
@each(("height", "width"), SIZES + TAILS)
def test_material_reference(height, width, metal, grain):
    albedo, guides = materials(np.random.default_rng(height), height, width, grain)
    if metal:
        albedo[: height // 3, : width // 2] = 9
    for names in ((), ("normal",), ("depth",), ("normal", "depth")):
        given = {name: guides[name] for name in names}
        got = yester.material_ids(albedo, **given)
        assert got.dtype == np.uint32
        want = reference.material_ids(tensor(albedo), **{name: tensor(image) for name, image in given.items()})
        np.testing.assert_array_equal(got, want.numpy())


def test_white_tells_where_it_ends_with_surfaces():
    """Glass in front of a wall, and as a pane in it; not the white fields of a chessboard, unless they are few."""
    albedo = np.full((64, 64, 3), 0.5, np.float32)
    albedo[16:48, 16:48] = 1
    depth = np.full((64, 64), 4, np.float32)
    depth[16:48, 16:48] = 3
    guides = {"normal": np.broadcast_to(np.float32([0, 0, 1]), (64, 64, 3)), "depth": depth}
    expected = np.where(albedo[..., 0] == 1, 3, 2)
    assert (yester.material_ids(albedo, **guides) == expected).all()
    depth[:] = 4  # 128 pairs of neighbours for 1024 pixels
    assert (yester.material_ids(albedo, **guides) == expected).all()
    assert (yester.material_ids(albedo) == expected).all()
    albedo[0, 0] = 1  # two pairs and a pixel more
    assert (yester.material_ids(albedo, **guides) == 2).all()
    albedo[::2, ::2] = 1
    assert (yester.material_ids(albedo, **guides) == 2).all()


def test_a_region_is_what_connects():
    """A metal ring around a plate: the lobe on one side of it speaks for the other, but not for the plate."""
    y, x = np.mgrid[:48, :48]
    radius = np.hypot(y - 24, x - 24)
    ring = (radius > 12) & (radius < 20)
    albedo = np.full((48, 48, 3), 0.5, np.float32)
    albedo[ring & (x < 24)] = 9
    normal = np.where(ring[..., None], np.float32([1, 0, 0]), np.float32([0, 0, 1]))
    depth = np.full((48, 48), 4, np.float32)
    assert (yester.is_reflectance(albedo, normal=normal, depth=depth) == ~ring).all()
    assert not yester.is_reflectance(albedo, normal=normal).any()
    assert not yester.is_reflectance(albedo, depth=depth).any()
    albedo[ring] = 0.5
    albedo[5, 5:7] = 9
    assert yester.is_reflectance(albedo, normal=normal, depth=depth) is None
    albedo[6, 6] = 9
    assert yester.is_reflectance(albedo, normal=normal, depth=depth).all()


def test_a_surface_is_reflectance_as_a_whole():
    """Anywhere in the image, and whatever its other pixels have: out of range, if they are more than one in 64."""
    ids = np.ones((64, 300), np.uint32)
    ids[:, ::3] = 2
    ids[:, 1::3] = 3
    albedo = np.full((*ids.shape, 3), 1e-5, np.float32)
    albedo[63, 299, 1] = 1.25
    albedo[0, ::3, 2] = albedo[0, 1::3, 0] = 1.26
    albedo[40, 4, 1] = 30
    mask = yester.is_reflectance(albedo, ids)
    assert mask[ids == 1].all()
    assert mask[ids == 2].all()
    assert not mask[ids == 3].any()


@each(("faint", "expected"), [(0, True), (1e-13, False), (9e-6, False), (1.1e-5, True)])
def test_a_highlight_fades_below_what_materials_reflect(faint, expected):
    """A surface may be black in parts, but values of a BSDF fall to next to nothing beside a highlight."""
    albedo = np.full((8, 16, 3), 0.5, np.float32)
    albedo[:, :4] = faint
    assert (yester.is_reflectance(albedo, np.ones((8, 16), np.uint32)) == expected).all()
    albedo[:, 2:4] = albedo[2:, :2] = 0.5
    # Two of 128 pixels, then three.
    albedo[:2, 1] = 0.5
    assert yester.is_reflectance(albedo, np.ones((8, 16), np.uint32)).all()
    albedo[7, 15] = faint
    assert (yester.is_reflectance(albedo, np.ones((8, 16), np.uint32)) == expected).all()


def test_one_pixel_of_many_keeps_the_texture_out_of_the_light():
    """An albedo that overshoots at one pixel does not change how its surface is denoised, nor cut its history."""
    frames = [flight.shoot(number, 96, 72) for number in range(4)]
    shown = []
    for odd in (False, True):
        svgf = yester.SVGF(antialias=False)
        for number, frame in enumerate(frames):
            albedo = frame.albedo.copy()
            albedo[60, 20] = 1.6 if odd and number % 2 else 1
            output = svgf.step(replace(frame, albedo=albedo))
        shown.append(output)
    np.testing.assert_array_equal(shown[0].color, shown[1].color)
    np.testing.assert_array_equal(shown[0].history_length, shown[1].history_length)


def test_where_is_boolean():
    color = np.ones((2, 3, 3), np.float32)
    with pytest.raises(TypeError, match="where: expected booleans, got int64"):
        yester.demodulate(color, color, where=np.ones((2, 3), np.int64))
    with pytest.raises(ValueError, match="where: expected height 2 and width 3"):
        yester.demodulate(color, color, where=np.ones((3, 3), bool))
    with pytest.raises(ValueError, match="ids: expected height 2 and width 3"):
        yester.is_reflectance(color, np.ones((3, 3), np.int64))
