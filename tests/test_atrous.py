import compare
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, assert_same_bits, each, tensor
from hypothesis import given
from hypothesis import strategies as st
from test_variance import surface


def inputs(rng, height, width, holes=0.05):
    variance = rng.exponential(0.5, (height, width)).astype(np.float32)
    variance[rng.random((height, width)) < 0.05] = 0
    variance[rng.random((height, width)) < holes / 2] = np.nan
    return compare.colors(rng, height, width, holes=holes), variance


def check(color, variance, *, rtol=2e-5, **named):
    got = yester.atrous(color, variance, **named)
    *want, weights = reference.atrous(*tensor([color, variance]), margin=True, **tensor(named))
    assert all(image.dtype == np.float32 for image in got)
    # Where the pixel itself is missing, near-zero weights of neighbours dominate, and are cut to zero at a bound.
    sure = weights.numpy() > 1e-12
    assert (~sure).sum() <= 1 + 0.05 * sure.size
    names = ["", " variance", " prediction"][: len(got)]
    for name, image, its, times in zip(names, got, want, (1, 2.5, 1), strict=False):
        assert_close(f"atrous{name}", image, its, rtol=times * rtol, where=sure)
    assert len(got) == len(want)
    return got


def predictions(rng, color, *, holes=0.2):
    """Predictions near the luminance of a colour; in places far from it, black, negative or not finite."""
    light = np.nan_to_num(luminance(color), nan=1, posinf=1, neginf=1)
    kind = rng.choice(4, light.shape, p=[0.8, 0.1, 0.05, 0.05])
    predicted = np.choose(kind, [light * rng.uniform(0.8, 1.2, light.shape), 9 * light, 0 * light, -light])
    none = rng.random(light.shape) < holes
    predicted[none] = rng.choice([np.nan, np.inf, -np.inf], int(none.sum()))
    return predicted.astype(np.float32)


def lengths(rng, height, width):
    """Numbers of samples, a few of them below 1 or not finite."""
    count = rng.uniform(0, 12, (height, width)).astype(np.float32)
    count[rng.random(count.shape) < 0.03] = np.nan
    return count


def luminance(color):
    with np.errstate(invalid="ignore"):
        return color @ np.float32([0.2126, 0.7152, 0.0722])


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    buffers=st.sets(st.sampled_from(["depth", "normal", "ids"])),
    iterations=st.sampled_from([0, 1, 2, 5, 7]),
    radius=st.sampled_from([1, 2]),
    sigma_luminance=st.sampled_from([0.5, 4.0, 100.0]),
    sigma_normal=st.sampled_from([0.0, 10.0, 128.0]),
    sigma_depth=st.sampled_from([0.5, 3.0]),
    sigma_plane=st.sampled_from([0.01, 0.3]),
)
def test_reference(seed, size, buffers, **named):
    rng = np.random.default_rng(seed)
    check(*inputs(rng, *size), **surface(rng, *size, buffers), **named)


@pytest.mark.parametrize("buffers", [[], ["depth", "ids"], ["depth", "normal", "ids"]])
@each(("height", "width"), SIZES + TAILS)
def test_sizes(height, width, buffers):
    rng = np.random.default_rng(width)
    check(*inputs(rng, height, width), iterations=3, **surface(rng, height, width, buffers))


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    buffers=st.sets(st.sampled_from(["depth", "normal", "ids"])),
    holes=st.sampled_from([0.0, 0.2, 0.9]),
    missing=st.sampled_from([0.0, 0.05, 0.5]),
    iterations=st.sampled_from([0, 1, 2, 5]),
    radius=st.sampled_from([1, 2]),
    sigma_luminance=st.sampled_from([0.5, 4.0, 100.0]),
)
def test_reference_of_predictions(seed, size, buffers, holes, missing, **named):
    rng = np.random.default_rng(seed)
    color, variance = inputs(rng, *size, holes=missing)
    prediction = predictions(rng, color, holes=holes)
    check(color, variance, prediction=prediction, **surface(rng, *size, buffers), **named)


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    buffers=st.sets(st.sampled_from(["depth", "normal", "ids"])),
    missing=st.sampled_from([0.0, 0.05, 0.5]),
    predicted=st.booleans(),
    iterations=st.sampled_from([0, 1, 2, 5]),
    radius=st.sampled_from([1, 2]),
    relative_noise=st.sampled_from([0.1, 2.0, 1e6, np.inf]),
    tap_exposure=st.sampled_from([None, 0.01, 1.0, 100.0, np.inf]),
    settled=st.sampled_from([0.0, 1.5, 3.5]),
)
def test_reference_of_limits(seed, size, buffers, missing, predicted, **named):
    rng = np.random.default_rng(seed)
    color, variance = inputs(rng, *size, holes=missing)
    known = {"prediction": predictions(rng, color)} if predicted else {}
    # The lower the limit, the more of the noise is rounding of the luminance.
    known |= {"rtol": 2e-5 * max(1, 0.2 / named["relative_noise"]), "history_length": lengths(rng, *size)}
    check(color, variance, **known, **surface(rng, *size, buffers), **named)


@each(("height", "width"), SIZES + TAILS)
def test_sizes_of_limits(height, width):
    rng = np.random.default_rng(width)
    check(*inputs(rng, height, width), iterations=3, history_length=lengths(rng, height, width))


def test_light_does_not_leak_into_the_dark():
    """Beside a lamp, the variance of a mean of ten samples is the lamp's edge, not noise."""
    lamp = np.where(np.arange(32) < 16, 100, 0.1) * np.ones((32, 1))
    color, variance = lamp[..., None] * np.ones(3), np.full((32, 32), 1000.0)
    dark = np.s_[:, 17:]  # the light around the first column of the dark is the lamp's, too
    assert yester.atrous(color, variance)[0][dark].max() > 1
    length = np.full((32, 32), 10.0)
    got, _ = yester.atrous(color, variance, history_length=length)
    np.testing.assert_allclose(got[dark], 0.1, rtol=1e-3)
    free, _ = yester.atrous(color, variance, history_length=length, relative_noise=np.inf)
    np.testing.assert_array_equal(free, yester.atrous(color, variance)[0])


def test_brighter_taps_weigh_less():
    """The darker, the less of a lamp's light is in it; pixels of few samples are not darkened."""
    rng = np.random.default_rng(5)
    color = np.where(rng.random((32, 32, 1)) < 0.05, 100, 0.1) * np.ones(3)
    length, endless = np.full((32, 32), 4.0), np.full((32, 32), 1e9)
    plain, _ = yester.atrous(color, endless)
    darker, _ = yester.atrous(color, endless, history_length=length, relative_noise=np.inf, tap_exposure=1)
    assert plain.mean() > 3
    assert darker.mean() < 1
    for few in (length - 1, np.where(rng.random((32, 32)) < 0.5, 4.0, 3.0)):
        some, _ = yester.atrous(color, endless, history_length=few, relative_noise=np.inf, tap_exposure=1)
        assert some.mean() > 1
    least, _ = yester.atrous(color, endless, history_length=length, relative_noise=np.inf, tap_exposure=1e9)
    np.testing.assert_allclose(least, plain, rtol=1e-5)
    with pytest.raises(ValueError, match="tap_exposure: needs history_length"):
        yester.atrous(color, endless, tap_exposure=1)


@pytest.mark.parametrize("radius", [1, 2])
@each(("height", "width"), SIZES + TAILS)
def test_sizes_of_predictions(height, width, radius):
    rng = np.random.default_rng(width)
    color, variance = inputs(rng, height, width)
    check(color, variance, prediction=predictions(rng, color), iterations=3, radius=radius)


@pytest.mark.parametrize("radius", [1, 2])
def test_a_prediction_of_its_own_luminance_changes_nothing(radius):
    """Neither does one without a finite value: bit for bit in the first pass, up to rounding in later ones."""
    rng = np.random.default_rng(0)
    color, variance = inputs(rng, 40, 50)
    buffers, light = surface(rng, 40, 50, ["depth", "normal"]), luminance(color)
    for iterations in (0, 1, 5):
        named = {"iterations": iterations, "radius": radius, **buffers}
        want, want_variance = yester.atrous(color, variance, **named)
        got = yester.atrous(color, variance, prediction=np.full_like(variance, np.nan), **named)
        if iterations < 2:
            assert_same_bits(got[0], want)
            assert_same_bits(got[1], want_variance)
        for images in (got, yester.atrous(color, variance, prediction=light, **named)):
            for image, its in zip(images, (want, want_variance, luminance(want)), strict=True):
                np.testing.assert_allclose(image, its, rtol=2e-5)


@pytest.mark.parametrize("radius", [1, 2])
def test_weights_do_not_see_the_noise(radius):
    """With a prediction everywhere the filter is linear in colour, and without one it is not."""
    rng = np.random.default_rng(0)
    one, other = (compare.colors(rng, 30, 40, holes=0) for _ in range(2))
    variance = rng.exponential(0.5, (30, 40)).astype(np.float32)
    for known in ({"prediction": predictions(rng, one, holes=0)}, {}):
        whole, *parts = (
            yester.atrous(color, variance, radius=radius, **known)[0] for color in (one + other, one, other)
        )
        assert np.allclose(whole, sum(parts), rtol=1e-5) == bool(known)


def test_edges_of_the_prediction_stop():
    """An edge of the prediction that noise hides in the colour."""
    rng = np.random.default_rng(0)
    color = rng.exponential(1, (16, 32, 3)).astype(np.float32)
    variance = np.full((16, 32), 0.01, np.float32)
    prediction = np.where(np.arange(32) < 16, 1, 3) * np.ones((16, 1))
    got, _, predicted = yester.atrous(color, variance, prediction=prediction)
    np.testing.assert_allclose(predicted, prediction, rtol=2e-3)
    for half in (np.s_[:, :16], np.s_[:, 16:]):
        # As if each half were alone, without the luminance test.
        alone = np.ones_like(variance[half]), 1e6
        smooth = yester.atrous(color[half], alone[0], sigma_luminance=alone[1])[0]
        np.testing.assert_allclose(got[half], smooth, rtol=0.02)


def test_predictions_scale_to_the_bit():
    rng = np.random.default_rng(0)
    color, variance = inputs(rng, 24, 33)
    prediction = predictions(rng, color)
    want = yester.atrous(color, variance, prediction=prediction)
    for k in (-4, 3, 10):
        scaled = yester.atrous(np.ldexp(color, k), np.ldexp(variance, 2 * k), prediction=np.ldexp(prediction, k))
        for image, its, power in zip(scaled, want, (k, 2 * k, k), strict=True):
            assert_same_bits(image, np.ldexp(its, power))


def test_predictions_of_missing_pixels_are_not_used():
    """Their luminance is filled from neighbours, as their colour is; NaN where there are none."""
    rng = np.random.default_rng(0)
    color, variance = inputs(rng, 20, 30, holes=0.3)
    prediction = predictions(rng, color, holes=0.2)
    missing = ~np.isfinite(color).all(-1)
    want = yester.atrous(color, variance, prediction=prediction)
    assert np.isfinite(want[2]).all()
    for value in (np.nan, 1e9):
        got = yester.atrous(color, variance, prediction=np.where(missing, np.float32(value), prediction))
        for image, its in zip(got, want, strict=True):
            assert_same_bits(image, its)
    _, _, left = yester.atrous(np.full_like(color, np.nan), variance, prediction=prediction)
    assert np.isnan(left).all()


def test_three_outputs():
    """With a prediction `out` has a third part; each may be left out."""
    rng = np.random.default_rng(0)
    color, variance = inputs(rng, 9, 14)
    prediction = predictions(rng, color)
    wants = yester.atrous(color, variance, prediction=prediction)
    out = tuple(np.empty_like(want) for want in wants)
    for parts in (out, (None, None, out[2])):
        got = yester.atrous(color, variance, prediction=prediction, out=parts)
        for image, part, want in zip(got, parts, wants, strict=True):
            assert part is None or image is part
            assert_same_bits(image, want)
    for parts, known, got in ((out[:2], prediction, "2 parts"), (out, None, "3 parts"), (out[0], None, "ndarray")):
        count = 2 if known is None else 3
        with pytest.raises(ValueError, match=rf"^out: expected a tuple of {count}, got {got}$"):
            yester.atrous(color, variance, prediction=known, out=parts)


@pytest.mark.parametrize("part", [np.s_[:-1], np.s_[:, :-1], np.s_[None]])
def test_wrong_predictions(part):
    rng = np.random.default_rng(0)
    color, variance = inputs(rng, 9, 14)
    with pytest.raises(ValueError, match=r"^prediction: expected"):
        yester.atrous(color, variance, prediction=predictions(rng, color)[part])


def naive(color, variance, depth, normal, ids):
    """One pass by loops over the pixels, of clean input without background: a reference for the reference."""
    sigma_luminance, sigma_normal, sigma_depth, sigma_plane = 4.0, 128.0, 0.5, 0.05
    height, width = variance.shape
    light = color @ np.array([0.2126, 0.7152, 0.0722])
    k, g = [1, 2 / 3, 1 / 6], [1 / 4, 1 / 8, 1 / 16]

    def slope(y, x, dy, dx):
        sides = []
        for s in (1, -1):
            if 0 <= y + s * dy < height and 0 <= x + s * dx < width:
                sides.append(s * (1 / depth[y + s * dy, x + s * dx] - 1 / depth[y, x]))
        return min(sides, key=abs, default=0)

    def rough(y, x):
        total = 0
        for dy, dx in (0, 1), (1, 0):
            before, after = (y - dy, x - dx), (y + dy, x + dx)
            inside = before[0] >= 0 and before[1] >= 0 and after[0] < height and after[1] < width
            if inside and ids[before] == ids[y, x] == ids[after]:
                left, right = normal[before] - normal[y, x], normal[after] - normal[y, x]
                total += 0.5 * min((left**2).sum(), (right**2).sum(), ((left + right) ** 2).sum() / 3)
        return total

    out, out_variance = np.zeros_like(color), np.zeros_like(variance)
    for y, x in np.ndindex(height, width):
        blur = 0
        for dy, dx in np.ndindex(3, 3):
            y1, x1 = np.clip(y + dy - 1, 0, height - 1), np.clip(x + dx - 1, 0, width - 1)
            blur += g[abs(dy - 1) + abs(dx - 1)] * variance[y1, x1]
        total = 0
        for dy, dx in np.ndindex(5, 5):
            dy, dx = dy - 2, dx - 2
            y1, x1 = y + dy, x + dx
            if not (0 <= y1 < height and 0 <= x1 < width and ids[y, x] == ids[y1, x1]):
                continue
            el = abs(light[y, x] - light[y1, x1]) / (sigma_luminance * blur**0.5 + 1e-3 * light[y, x])
            across, along = slope(y, x, 0, 1), slope(y, x, 1, 0)
            plane = 1 / depth[y, x] + across * dx + along * dy
            allowed = sigma_plane / depth[y, x] + sigma_depth * 2 * (abs(across) + abs(along))
            ez = abs(plane - 1 / depth[y1, x1]) / allowed
            en = sigma_normal * 0.5 * ((normal[y, x] - normal[y1, x1]) ** 2).sum() / (1 + sigma_normal * rough(y, x))
            w = k[abs(dx)] * k[abs(dy)] * np.exp(-el - ez - en)
            out[y, x] += w * color[y1, x1]
            out_variance[y, x] += w * w * variance[y1, x1]
            total += w
        out[y, x] /= total
        out_variance[y, x] /= total**2
    return out, out_variance


def test_the_reference_is_the_naive_loop():
    rng = np.random.default_rng(0)
    now = compare.surfaces(rng, 9, 13)
    now["ids"] = np.maximum(now["ids"], 1)
    now["depth"] = np.where(np.isfinite(now["depth"]) & (now["depth"] > 0), now["depth"], 4).astype(np.float64)
    color, variance = rng.exponential(1, (9, 13, 3)), rng.exponential(1, (9, 13))
    now["normal"] = now["normal"].astype(np.float64)
    want, want_variance = naive(color, variance, **now)
    got, got_variance = reference.atrous(*tensor([color, variance]), iterations=1, **tensor(now))
    np.testing.assert_allclose(got, want, rtol=1e-12)
    np.testing.assert_allclose(got_variance, want_variance, rtol=1e-12)


def test_constant_stays():
    rng = np.random.default_rng(0)
    color = np.full((21, 34, 3), 0.7, np.float32)
    buffers = surface(rng, 21, 34, ["depth", "normal", "ids"])
    got, variance = yester.atrous(color, np.ones((21, 34), np.float32), **buffers)
    np.testing.assert_allclose(got, color, rtol=1e-6)
    assert (variance <= 1 + 1e-6).all()
    assert variance.mean() < 0.5


def test_scale_passes_to_the_bit():
    """Scaling light by a power of two keeps the weights, so the bits are the same."""
    rng = np.random.default_rng(0)
    color, variance = inputs(rng, 24, 33)
    buffers = surface(rng, 24, 33, ["depth", "normal", "ids"])
    got, got_variance = yester.atrous(color, variance, **buffers)
    for k in (-4, 3, 10):
        scaled, scaled_variance = yester.atrous(np.ldexp(color, k), np.ldexp(variance, 2 * k), **buffers)
        assert_same_bits(scaled, np.ldexp(got, k))
        assert_same_bits(scaled_variance, np.ldexp(got_variance, 2 * k))


def test_stays_between_the_smallest_and_the_largest():
    color, variance = inputs(np.random.default_rng(0), 30, 31, holes=0)
    got, _ = yester.atrous(color, variance, sigma_luminance=1e6)
    assert (got >= color.min((0, 1)) * (1 - 1e-6)).all()
    assert (got <= color.max((0, 1)) * (1 + 1e-6)).all()
    assert got.std() < 0.2 * color.std()


def test_rough_normals_do_not_stop_and_edges_do():
    """Normals that change from pixel to pixel hardly stop the filter; a crease between flat sides stops it."""
    rng = np.random.default_rng(0)
    color, variance = rng.exponential(1, (32, 32, 3)).astype(np.float32), np.full((32, 32), 1e6, np.float32)
    flat = np.zeros((32, 32, 3), np.float32)
    flat[..., 2] = 1
    rough = flat + rng.normal(0, 0.2, flat.shape).astype(np.float32)
    rough /= np.linalg.norm(rough, axis=-1, keepdims=True)
    left = {
        name: yester.atrous(color, variance, normal=normal)[0].std()
        for name, normal in [("flat", flat), ("rough", rough)]
    }
    assert left["rough"] < 2 * left["flat"]
    bent = flat.copy()
    bent[:, 16:] = np.sqrt([0.2, 0, 0.8])
    color[:, 16:] = 0
    got, _ = yester.atrous(color, variance, normal=bent)
    assert np.abs(got[:, 16:]).max() < 1e-3


def test_edges_stop():
    """Pixels of another id, across a step in depth or around a corner get no weight."""
    color = np.ones((16, 32, 3), np.float32)
    color[:, 16:] = 100
    variance = np.full((16, 32), 1e6, np.float32)
    ids = np.ones((16, 32), np.uint32)
    depth, normal = np.ones((16, 32), np.float32), np.zeros((16, 32, 3), np.float32)
    normal[..., 2] = 1
    ids[:, 16:], depth[:, 16:], normal[:, 16:] = 2, 25, [1, 0, 0]
    assert yester.atrous(color, variance)[0][8, 15, 0] > 2
    for buffers in ({"ids": ids}, {"depth": depth}, {"normal": normal}):
        got, _ = yester.atrous(color, variance, **buffers)
        np.testing.assert_allclose(got, color, rtol=1e-5)


def test_slopes_do_not_stop():
    """A tilted plane is filtered as if no depth were given."""
    camera = yester.Camera.from_look_at([0, 1, 0], [0, 0, -3], [0, 1, 0], 50, 48, 32)
    origin, direction = camera.rays()
    t = -origin[1] / direction[..., 1]
    depth = (t * (direction @ camera.forward)).astype(np.float32)
    assert depth.min() > 0
    color = np.random.default_rng(0).exponential(1, (32, 48, 3)).astype(np.float32)
    variance = np.ones((32, 48), np.float32)
    got, _ = yester.atrous(color, variance, depth=depth)
    want, _ = yester.atrous(color, variance)
    np.testing.assert_allclose(got, want, rtol=1e-2)


def test_background_is_one_surface():
    """Its normals and invalid depths do not stop the smoothing inside it; none of it leaks out."""
    rng = np.random.default_rng(0)
    color, variance = inputs(rng, 12, 20, holes=0)
    depth = rng.choice(np.float32([np.inf, np.nan, 0, -2]), (12, 20))
    normal = rng.normal(0, 1, (12, 20, 3)).astype(np.float32)
    got = yester.atrous(color, variance, depth=depth, normal=normal)
    for image, want in zip(got, yester.atrous(color, variance), strict=True):
        np.testing.assert_allclose(image, want, rtol=1e-5)


def test_objects_may_be_counted_from_zero():
    """Background is a surface of its own, not the object with id 0."""
    color = np.ones((8, 16, 3), np.float32)
    color[:, 8:] = 100
    depth = np.full((8, 16), np.inf, np.float32)
    depth[:, 8:] = 2
    ids = np.zeros((8, 16), np.uint32)
    got, _ = yester.atrous(color, np.full((8, 16), 1e6, np.float32), depth=depth, ids=ids)
    np.testing.assert_allclose(got, color, rtol=1e-5)


def test_broken_normals_count_as_zero():
    rng = np.random.default_rng(0)
    color, variance = inputs(rng, 12, 20)
    zero = surface(rng, 12, 20, ["normal"])["normal"]
    broken = zero.copy()
    holes = rng.random((12, 20)) < 0.3
    zero[holes], broken[holes] = 0, np.nan
    for got, want in zip(
        yester.atrous(color, variance, normal=broken), yester.atrous(color, variance, normal=zero), strict=True
    ):
        assert_same_bits(got, want)


def test_holes_are_filled_and_never_spread():
    rng = np.random.default_rng(0)
    color, variance = inputs(rng, 30, 40, holes=0.4)
    got, got_variance = yester.atrous(color, variance)
    assert np.isfinite(got).all()
    assert np.isfinite(got_variance).all()


def test_no_similar_tap_is_nan():
    color, variance = np.ones((4, 6, 3), np.float32), np.ones((4, 6), np.float32)
    color[1, 2, 1] = np.nan
    ids = np.ones((4, 6), np.uint32)
    ids[1, 2] = 2
    got, got_variance = yester.atrous(color, variance, ids=ids)
    assert np.isnan(got[1, 2]).all()
    assert got_variance[1, 2] == 0
    assert np.isfinite(got).all(-1).sum() == 23


def test_no_iterations_no_change():
    rng = np.random.default_rng(0)
    color, variance = inputs(rng, 9, 10)
    variance = np.nan_to_num(variance)
    got, got_variance = yester.atrous(color, variance, iterations=0, **surface(rng, 9, 10, ["depth", "normal"]))
    holes = ~np.isfinite(color).all(-1)
    assert holes.any()
    assert np.isnan(got[holes]).all()
    assert_same_bits(got[~holes], color[~holes])
    assert_same_bits(got_variance, variance)


def test_no_denormals():
    variance = np.full((5, 6), 1e-29, np.float32)
    _, got = yester.atrous(np.ones((5, 6, 3), np.float32), variance, iterations=5)
    assert ((got == 0) | (got >= 1e-30)).all()
    assert (got == 0).any()


def test_endless_tolerance():
    """An infinite scale switches a weight off, also where the difference that it divides is 0 of 0."""
    color = np.random.default_rng(0).uniform(0, 1, (12, 16, 3))
    flat = {"variance": np.zeros((12, 16)), "depth": np.full((12, 16), 4.0)}
    endless = dict.fromkeys(("sigma_luminance", "sigma_depth", "sigma_plane"), np.inf)
    got, _ = yester.atrous(color, **flat, **endless)
    want, _ = yester.atrous(color, flat["variance"], sigma_luminance=1e30)
    np.testing.assert_allclose(got, want, rtol=1e-6)
