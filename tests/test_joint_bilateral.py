import itertools

import compare
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, assert_same_bits, each, tensor
from hypothesis import given
from hypothesis import strategies as st
from test_variance import surface

PARAMETERS = {
    "radius": st.sampled_from([1, 2, 4]),
    "sigma": st.sampled_from([0.5, 1.0, 3.0]),
    "sigma_normal": st.sampled_from([0.0, 10.0, 128.0]),
    "sigma_depth": st.sampled_from([0.5, 3.0]),
    "sigma_plane": st.sampled_from([0.01, 0.3]),
}
BUFFERS = ["depth", "normal", "ids"]


def compare_with_reference(function, color, **named):
    got = getattr(yester, function)(color, **named)
    want, weights = getattr(reference, function)(tensor(color), margin=True, **tensor(named))
    assert got.dtype == np.float32
    # With no similar tap, near-zero weights dominate, and are cut to zero at a bound.
    sure = (weights.numpy() > 1e-12) | (weights.numpy() == 0)
    assert (~sure).sum() <= 9 + 0.2 * sure.size
    assert_close(function, got, want, rtol=2e-5, where=sure)
    return got


def traced(color, number, scale=2):
    """A colour of which only one pixel of each block is traced."""
    order = list(itertools.product(range(scale), repeat=2))
    y, x = order[number % len(order)]
    kept = np.full_like(color, np.nan)
    kept[y::scale, x::scale] = color[y::scale, x::scale]
    return kept


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 36), st.integers(1, 36)),
    buffers=st.sets(st.sampled_from(BUFFERS)),
    holes=st.sampled_from([0.0, 0.3, 0.75, 0.97]),
    **PARAMETERS,
)
def test_reconstruct_reference(seed, size, buffers, holes, **named):
    rng = np.random.default_rng(seed)
    color = compare.colors(rng, *size, holes=holes)
    compare_with_reference("reconstruct", color, **surface(rng, *size, buffers), **named)


@pytest.mark.parametrize("buffers", [[], ["depth", "ids"], ["depth", "normal", "ids"]])
@each("size", SIZES + TAILS)
def test_reconstruct_sizes(size, buffers):
    rng = np.random.default_rng(size[1])
    color = traced(compare.colors(rng, *size), size[1])
    compare_with_reference("reconstruct", color, **surface(rng, *size, buffers))


def low_inputs(rng, height, width, scale, buffers, lows, offset):
    """A low-resolution colour, the full buffers, and the samples' own low-resolution buffers."""
    full = surface(rng, height, width, set(buffers) or {"ids"})
    low = -(-height // scale), -(-width // scale)
    y, x = (np.minimum(np.arange(n) * scale + scale // 2, m - 1) for n, m in zip(low, (height, width), strict=True))
    own = {f"low_{name}": full[name][np.ix_(y, x)].copy() for name in sorted(lows & set(full))}
    for name, image in own.items():
        odd = rng.random(low) < 0.1
        image[odd] = rng.integers(0, 3) if name == "low_ids" else image[odd] * np.float32(1.01)
    where = None if offset is None else tuple(d * (scale - 1) for d in offset)
    return compare.colors(rng, *low, holes=0.1), {**full, **own, "scale": scale, "offset": where}


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 36), st.integers(1, 36)),
    scale=st.sampled_from([1, 2, 3, 5]),
    buffers=st.sets(st.sampled_from(BUFFERS)),
    lows=st.sets(st.sampled_from(["depth", "normal", "ids"])),
    offset=st.sampled_from([None, (0.0, 0.0), (1.0, 0.0), (0.5, 0.75), (1.0, 1.0)]),
    **PARAMETERS,
)
def test_upsample_reference(seed, size, scale, buffers, lows, offset, **named):
    rng = np.random.default_rng(seed)
    color, more = low_inputs(rng, *size, scale, buffers, lows, offset)
    compare_with_reference("joint_bilateral_upsample", color, **more, **named)


@pytest.mark.parametrize("buffers", [["depth"], ["depth", "normal", "ids"]])
@each("size", SIZES + TAILS)
def test_upsample_sizes(size, buffers):
    rng = np.random.default_rng(size[1])
    color, more = low_inputs(rng, *size, 2, buffers, set(), None)
    got = compare_with_reference("joint_bilateral_upsample", color, **more)
    assert got.shape == (*size, 3)


@pytest.mark.parametrize("buffers", [[], ["depth", "normal", "ids"]])
def test_samples_keep_their_bits(buffers):
    rng = np.random.default_rng(0)
    color = compare.colors(rng, 30, 41, holes=0.6)
    present = np.isfinite(color).all(-1)
    got = yester.reconstruct(color, **surface(rng, 30, 41, buffers))
    assert_same_bits(got[present], color[present])
    assert np.isfinite(got[~present]).any()
    whole = compare.colors(rng, 30, 41, holes=0)
    assert_same_bits(yester.reconstruct(whole, **surface(rng, 30, 41, buffers)), whole)


@pytest.mark.parametrize("scale", [2, 3])
def test_upsampling_is_reconstruction_of_samples_in_their_pixels(scale):
    """With samples in pixel centres, both fill missing pixels alike, bit for bit."""
    rng = np.random.default_rng(scale)
    height, width = 10 * scale - 1, 13 * scale + 1
    buffers = surface(rng, height, width, ["depth", "normal", "ids"])
    low = compare.colors(rng, 10, 14)
    color = np.full((height, width, 3), np.nan, np.float32)
    color[::scale, ::scale] = low
    want = yester.reconstruct(color, radius=2 * scale, sigma=float(scale), **buffers)
    got = yester.joint_bilateral_upsample(low, scale=scale, offset=(0, 0), **buffers)
    missing = ~np.isfinite(color).all(-1)
    assert_same_bits(got[missing], want[missing])
    assert (got[~missing] != want[~missing]).any(), "samples are averaged too"


@pytest.mark.parametrize("scale", [2, 3, 4])
def test_straight_slopes_stay_straight(scale):
    """Sample positions are used: a wide window in the middle of a ramp reproduces the ramp, for every offset."""
    height, width = 24 * scale, 26 * scale
    y, x = np.mgrid[:height, :width].astype(np.float32)
    ids = np.ones((height, width), np.uint32)
    for offset in ((0, 0), (scale - 1, 0), ((scale - 1) / 2, (scale - 1) / 2)):
        rows, columns = np.arange(24) * scale + offset[1], np.arange(26) * scale + offset[0]
        low = np.stack(np.broadcast_arrays(columns[None], rows[:, None], 1.0), -1)
        got = yester.joint_bilateral_upsample(low, ids=ids, scale=scale, offset=offset, radius=4, sigma=1.0)
        inner = np.s_[5 * scale : -5 * scale, 5 * scale : -5 * scale]
        want = np.stack([x, y, np.ones_like(x)], -1)
        # The cut-off of the window and the sample spacing leave an error of a few percent of that spacing.
        np.testing.assert_allclose(got[inner], want[inner], atol=0.05 * scale)


@pytest.mark.parametrize("scale", [1, 2, 3, 4])
@pytest.mark.parametrize("radius", [1, 2])
def test_mirrored_samples_give_the_mirrored_image(scale, radius):
    """The window reaches as far to one side of a pixel as to the other, also where samples lie between pixels."""
    low = compare.colors(np.random.default_rng(0), 12, 15)
    ids = np.ones((12 * scale, 15 * scale), np.uint32)
    want = yester.joint_bilateral_upsample(low, ids=ids, scale=scale, radius=radius)
    got = yester.joint_bilateral_upsample(low[::-1, ::-1], ids=ids, scale=scale, radius=radius)[::-1, ::-1]
    np.testing.assert_allclose(got, want, rtol=1e-5, atol=1e-6)


def test_nothing_crosses():
    """Neither ids, nor the border to the background, nor steps in depth, nor corners."""
    color = np.ones((32, 64, 3), np.float32)
    color[:, 32:] = 100
    ids = np.ones((32, 64), np.uint32)
    depth, normal = np.ones((32, 64), np.float32), np.zeros((32, 64, 3), np.float32)
    normal[..., 2] = 1
    sky = depth.copy()
    ids[:, 32:], depth[:, 32:], normal[:, 32:], sky[:, 32:] = 2, 25, [1, 0, 0], np.inf
    assert not np.isin(yester.reconstruct(traced(color, 1)), (1, 100)).all()
    for buffers in (
        {"ids": ids},
        {"depth": depth},
        {"depth": sky},
        {"normal": normal},
    ):
        for number in range(4):
            got = yester.reconstruct(traced(color, number), **buffers)
            np.testing.assert_allclose(got, color, rtol=1e-5)
            y, x = divmod(number, 2)
            low = color[y::2, x::2].copy()
            got = yester.joint_bilateral_upsample(low, offset=(x, y), **buffers)
            np.testing.assert_allclose(got, color, rtol=1e-5)


def test_samples_go_to_their_own_side():
    """An edge through the middle of the blocks: with buffers of their own, samples go to their own side."""
    color = np.ones((16, 16, 3), np.float32)
    color[:, 8:] = 100
    ids = np.ones((32, 32), np.uint32)
    ids[:, 17:] = 2
    low_ids = np.ones((16, 16), np.uint32)
    low_ids[:, 8:] = 2
    want = np.where(ids[..., None] == 2, np.float32(100), np.float32(1)) * np.ones(3, np.float32)
    got = yester.joint_bilateral_upsample(color, ids=ids, low_ids=low_ids)
    np.testing.assert_allclose(got, want, rtol=1e-6)
    got = yester.joint_bilateral_upsample(color, ids=ids, offset=(0, 0))
    assert not np.isclose(got, want).all()


def test_constant_stays():
    rng = np.random.default_rng(0)
    color = np.full((21, 34, 3), 0.7, np.float32)
    buffers = surface(rng, 21, 34, ["depth", "normal", "ids"])
    got = yester.reconstruct(traced(color, 2), **buffers)
    seen = np.isfinite(got)
    np.testing.assert_allclose(got[seen], 0.7, rtol=1e-6)
    assert 0.8 < seen.mean() < 1, "some pixels have nobody like them"
    got = yester.joint_bilateral_upsample(color[::2, ::2].copy(), **buffers)
    np.testing.assert_allclose(got[np.isfinite(got)], 0.7, rtol=1e-6)


def test_no_similar_sample_is_nan():
    nothing = np.full((9, 40, 3), np.nan, np.float32)
    nothing[2, 3, 1] = np.inf
    assert np.isnan(yester.reconstruct(nothing)[..., 0]).all()
    ids = np.ones((18, 80), np.uint32)
    assert np.isnan(yester.joint_bilateral_upsample(nothing, ids=ids)).all()


SIGMAS = {
    "sigma": (0, -1, np.nan),
    "sigma_normal": (-1, np.nan),
    "sigma_depth": (0, np.nan),
    "sigma_plane": (0, np.nan),
}


@pytest.mark.parametrize("name", ["reconstruct", "joint_bilateral_upsample"])
def test_parameters_out_of_range(name):
    color = np.ones((4, 5, 3), np.float32)
    buffers = {"ids": np.ones((4, 5), np.uint32)} | ({"scale": 1} if name != "reconstruct" else {})
    for argument, values in {**SIGMAS, "radius": (0, 17, -1)}.items():
        for value in values:
            with pytest.raises(ValueError, match=rf"^{argument}: expected"):
                getattr(yester, name)(color, **buffers, **{argument: value})


@pytest.mark.parametrize("size", [(3, 4), (2, 5), (4, 3), (5, 7), (1, 1)])
def test_sizes_that_do_not_fit(size):
    """Low and high resolution: the message has all three sizes."""
    expected = (
        r"^color: expected height 3 and width 3, a sample for each block of 2x2 of the full height 5 and width 6, "
    )
    with pytest.raises(ValueError, match=rf"{expected}got height {size[0]} and width {size[1]}$"):
        yester.joint_bilateral_upsample(np.ones((*size, 3), np.float32), ids=np.ones((5, 6), np.uint32))


def test_bad_input():
    low, ids = np.ones((3, 3, 3), np.float32), np.ones((5, 6), np.uint32)
    depth = np.ones((5, 6), np.float32)
    upsample = yester.joint_bilateral_upsample
    with pytest.raises(ValueError, match=r"^depth, normal, ids: expected one of them in full resolution, got none"):
        upsample(low)
    with pytest.raises(ValueError, match=r"^ids: expected height 5 and width 6"):
        upsample(low, depth=depth, ids=ids[:-1])
    for name, image in (("depth", np.ones((3, 3))), ("normal", low), ("ids", np.ones((3, 3), np.uint32))):
        with pytest.raises(ValueError, match=rf"^low_{name}: needs {name} as well"):
            upsample(
                low, **{"ids" if name != "ids" else "depth": ids if name != "ids" else depth, f"low_{name}": image}
            )
    with pytest.raises(ValueError, match=r"^low_ids: expected height 3 and width 3, got \(5, 6\)"):
        upsample(low, ids=ids, low_ids=ids)
    for scale in (0, 17, -2):
        with pytest.raises(ValueError, match=r"^scale: expected 1 to 16 pixels"):
            upsample(low, ids=ids, scale=scale)
    for offset in ((-0.5, 0), (0, 1.5), (np.nan, 0)):
        with pytest.raises(ValueError, match=r"^offset: expected 0 to 1 pixels"):
            upsample(low, ids=ids, offset=offset)
    with pytest.raises(ValueError, match=r"^offset: expected shape \(2,\)"):
        upsample(low, ids=ids, offset=(0, 0, 0))
