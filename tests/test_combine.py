import compare
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, assert_same_bits, each, tensor
from hypothesis import given
from hypothesis import strategies as st

LENGTHS = np.float32([0, 0.3, 1, 2, 3.5, 17, 1000, -1, np.nan, np.inf, -np.inf])
NAMES = ("color", "moments", "history_length", "other_color", "other_moments", "other_length")


def history(rng, height, width, *, holes=0.05) -> list:
    """Colour, moments and length of any magnitude, some of them missing."""
    length = rng.choice(LENGTHS, (height, width))
    return [compare.colors(rng, height, width, c, holes=holes) for c in (3, 2)] + [length]


def gradients(rng, height, width):
    """Zero, fractions of every size, one, and invalid values: out of range or not finite."""
    kind = rng.choice(7, (height, width), p=[0.3, 0.3, 0.2, 0.05, 0.05, 0.05, 0.05])
    many = rng.uniform(0, 0.99, kind.shape)
    return np.choose(kind, [0.0, many, 1.0, -0.5, 1.5, np.nan, np.inf]).astype(np.float32)


def empty(height, width) -> list:
    return [np.full((height, width, *c), value, np.float32) for c, value in (((3,), np.nan), ((2,), np.nan), ((), 0))]


def sizes(*histories):
    """The largest magnitude (H, W, 1) of a pixel's colours and moments, by which float32 rounds."""
    images = [np.where(np.isfinite(image), np.abs(image), 0) for known in histories for image in known[:2]]
    return np.concatenate(images, -1).max(-1, keepdims=True)


def assert_alike(got, want, scale) -> None:
    for image, its in zip(got[:2], want[:2], strict=True):
        assert_close("combine_histories", image, its, rtol=1e-6, scale=scale)
    assert_close("combine_histories length", got[2], want[2], rtol=2e-6)


def check(first, second, **named):
    got = yester.combine_histories(*first, *second, **named)
    want = reference.combine_histories(*tensor([*first, *second]), **tensor(named))
    assert all(image.dtype == np.float32 for image in got)
    assert_alike(got, [image.numpy() for image in want], sizes(first, second))
    return got


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    changes=st.booleans(),
    holes=st.sampled_from([0.0, 0.05, 0.8]),
)
def test_reference(seed, size, changes, holes):
    rng = np.random.default_rng(seed)
    first, second = (history(rng, *size, holes=holes) for _ in range(2))
    check(first, second, gradient=gradients(rng, *size) if changes else None)


@each(("height", "width"), SIZES + TAILS)
def test_sizes(height, width):
    rng = np.random.default_rng(width)
    first, second = (history(rng, height, width) for _ in range(2))
    check(first, second)
    check(first, second, gradient=gradients(rng, height, width))


def test_by_hand():
    """One sample of 2 and three of 6 have a mean of 5."""
    first, second = ([np.full((1, 2, *c), value, np.float32) for c in ((3,), (2,))] for value in (2, 6))
    lengths = np.float32([[1, 1]]), np.float32([[3, 0]])
    color, moments, length = yester.combine_histories(*first, lengths[0], *second, lengths[1])
    np.testing.assert_array_equal(color[0], [[5, 5, 5], [2, 2, 2]])
    np.testing.assert_array_equal(moments[0], [[5, 5], [2, 2]])
    np.testing.assert_array_equal(length, [[4, 1]])
    # Half of the light has changed: of three samples, a thousandth of three is left.
    color, _, length = yester.combine_histories(*first, lengths[0], *second, lengths[1], gradient=np.full((1, 2), 0.5))
    np.testing.assert_allclose(length, [[1 + 3 / 1024, 1]], rtol=1e-6)
    np.testing.assert_allclose(color[0, 0], 2 + 4 * 3 / 1027, rtol=1e-6)


@given(seed=st.integers(0, 2**32), size=st.tuples(st.integers(1, 20), st.integers(1, 40)))
def test_order_changes_nothing_but_roundings(seed, size):
    """The order of two histories, and of combining three; lengths add up."""
    rng = np.random.default_rng(seed)
    a, b, c = (history(rng, *size, holes=0.2) for _ in range(3))
    for _, moments, _ in (a, b, c):  # of moments that are not finite, the first ones stay
        moments[~np.isfinite(moments)] = 1
    scale = sizes(a, b, c)

    def combine(first, second):
        return yester.combine_histories(*first, *second)

    assert_alike(combine(a, b), combine(b, a), scale)
    assert_alike(combine(combine(a, b), c), combine(a, combine(b, c)), scale)
    known = [np.isfinite(np.dstack(one)).all(-1) & (one[2] > 0) for one in (a, b)]
    total = sum(np.where(there, one[2], np.float32(0)) for there, one in zip(known, (a, b), strict=True))
    assert_same_bits(combine(a, b)[2], total)


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 20), st.integers(1, 40)),
    lacks=st.sampled_from(["samples", "length", "color"]),
)
def test_an_empty_history_changes_no_bit(seed, size, lacks):
    """Whatever makes it empty; two empty histories give NaN and no samples."""
    rng = np.random.default_rng(seed)
    some, other = history(rng, *size, holes=0.2), history(rng, *size, holes=0)
    match lacks:
        case "samples":
            other[2][:] = rng.choice(np.float32([0, -0.0, -3]), size)
        case "length":
            other[2][:] = rng.choice(np.float32([np.nan, np.inf]), size)
        case "color":
            other[0][..., rng.integers(3)] = rng.choice(np.float32([np.nan, np.inf, -np.inf]), size)
    known = np.isfinite(some[0]).all(-1) & np.isfinite(some[2]) & (some[2] > 0)
    nothing = empty(*size)
    for combined in (yester.combine_histories(*some, *other), yester.combine_histories(*other, *some)):
        for got, its, none in zip(combined, some, nothing, strict=True):
            assert_same_bits(got, np.where(known.reshape(known.shape + (1,) * (its.ndim - 2)), its, none))


def test_moments_that_overflow():
    """Colours are combined all the same; where a mean overflows, the first history's stays, or else the second's."""
    color, length = np.ones((1, 2, 3), np.float32), np.ones((1, 2), np.float32)
    good, bad = np.float32([[[1, 2], [1, 2]]]), np.float32([[[np.nan, np.inf], [np.inf, np.inf]]])
    for moments, others, want in ((good, bad, good), (bad, good, good), (bad, bad, bad)):
        mixed, left, total = yester.combine_histories(color, moments, length, 3 * color, others, length)
        assert (mixed == 2).all()
        assert (total == 2).all()
        assert_same_bits(left, want)


def test_a_whole_change_is_an_empty_history():
    """Bit for bit; zero, negative and non-finite gradients count as no change."""
    rng = np.random.default_rng(0)
    first, second = (history(rng, 9, 14) for _ in range(2))
    for value, its in ((1, empty(9, 14)), (7, empty(9, 14)), (0, second), (-1, second), (np.nan, second)):
        gradient = np.full((9, 14), value, np.float32)
        got = yester.combine_histories(*first, *second, gradient=gradient)
        for image, want in zip(got, yester.combine_histories(*first, *its), strict=True):
            assert_same_bits(image, want)


def test_two_halves_are_the_whole():
    """For samples that are accumulated with equal weights."""
    frames = np.random.default_rng(0).exponential(1, (20, 6, 9, 3)).astype(np.float32)
    frames[3, 2, 4] = frames[11, 2, 4] = frames[:13, 5, 5] = np.nan

    def accumulated(frames):
        known = [np.zeros((6, 9, *c), np.float32) for c in ((3,), (2,), ())]
        for frame in frames:
            result = yester.accumulate(frame, *known, alpha=0.0, moments_alpha=0.0)
            known = [result.color, result.moments, result.history_length]
        return known

    got = yester.combine_histories(*accumulated(frames[:13]), *accumulated(frames[13:]))
    assert_alike(got, accumulated(frames), sizes(got))


def spiky(rng, height, width) -> list:
    """A history of which some pixels have most light from one sample, of several or of a single one."""
    length = rng.choice(np.float32([0.5, 1, 2, 3, 5]), (height, width))
    light = rng.uniform(0.5, 2, (height, width)) * rng.choice([1, 100, 1e4], (height, width), p=[0.6, 0.2, 0.2])
    tint = rng.uniform(0.9, 1.1, (height, width, 3))
    square = np.where(rng.random((height, width)) < 0.5, np.maximum(length, 1), 1.1)
    moments = np.stack([light, square * light**2], -1)
    return [(light[..., None] * tint).astype(np.float32), moments.astype(np.float32), length]


@given(seed=st.integers(0, 2**32), size=st.tuples(st.integers(1, 20), st.integers(1, 40)), holes=st.booleans())
def test_spikes_are_held(seed, size, holes):
    rng = np.random.default_rng(seed)
    first, second = (spiky(rng, *size) for _ in range(2))
    if holes:
        for image in (*first, *second):
            image[rng.random(size) < 0.1] = np.nan
    check(first, second, exposure=0.5)


def test_a_spike_by_hand():
    """One of four samples is a firefly; two are, and so it is none; the other history has two samples, or none."""
    color, moments = np.full((1, 4, 3), 250, np.float32), np.float32([[[250, 250_000], [250, 125_000]] * 2])
    lengths, others = np.full((1, 4), 4, np.float32), np.float32([[4, 4, 2, 0]])
    other, others_moments = np.ones((1, 4, 3), np.float32), np.ones((1, 4, 2), np.float32)
    held, _, length = yester.combine_histories(color, moments, lengths, other, others_moments, others, exposure=1.0)
    np.testing.assert_allclose(held[0, :, 1], [(8.5 + 1) / 2, 251 / 2, (4 * 250 + 2) / 6, 250], rtol=1e-5)
    turned, _, _ = yester.combine_histories(other, others_moments, others, color, moments, lengths, exposure=1.0)
    np.testing.assert_allclose(turned, held, rtol=1e-5)
    np.testing.assert_array_equal(length, [[8, 8, 6, 4]])
    plain, _, _ = yester.combine_histories(color, moments, lengths, other, others_moments, others)
    np.testing.assert_allclose(plain[0, :2, 1], 251 / 2)


@pytest.mark.parametrize("exposure", [0, -1, np.nan, np.inf])
def test_wrong_exposure(exposure):
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match=r"^exposure: expected a finite number above 0"):
        yester.combine_histories(*history(rng, 6, 9), *history(rng, 6, 9), exposure=exposure)


def test_nothing_of_the_arguments_changes():
    rng = np.random.default_rng(0)
    images = [*history(rng, 4, 5), *history(rng, 4, 5), gradients(rng, 4, 5)]
    copies = [image.copy() for image in images]
    yester.combine_histories(*images[:6], gradient=images[6])
    for image, copy in zip(images, copies, strict=True):
        np.testing.assert_array_equal(image, copy)


@pytest.mark.parametrize("names", [NAMES[:3], NAMES[3:]])
def test_in_place(names):
    """Either history may become the combined one."""
    rng = np.random.default_rng(0)
    given = dict(zip(NAMES, [*history(rng, 9, 14), *history(rng, 9, 14)], strict=True))
    want = yester.combine_histories(**given)
    out = tuple(given[name] for name in names)
    for got, part, its in zip(yester.combine_histories(**given, out=out), out, want, strict=True):
        assert got is part
        assert_same_bits(got, its)


@pytest.mark.parametrize(
    ("name", "part"),
    [
        ("color", np.s_[..., :2]),
        ("moments", np.s_[..., :1]),
        *((name, np.s_[:-1]) for name in NAMES[1:]),
        ("other_color", np.s_[..., :1]),
        ("other_moments", np.s_[:, :, [0, 1, 1]]),
        ("gradient", np.s_[:, :-1]),
    ],
)
def test_wrong_shapes(name, part):
    rng = np.random.default_rng(0)
    images = [*history(rng, 6, 9), *history(rng, 6, 9), gradients(rng, 6, 9)]
    given = dict(zip((*NAMES, "gradient"), images, strict=True))
    with pytest.raises(ValueError, match=f"^{name}: expected"):
        yester.combine_histories(**given | {name: given[name][part].copy()})


def test_gradient_by_name_only():
    rng = np.random.default_rng(0)
    with pytest.raises(TypeError):
        yester.combine_histories(*history(rng, 6, 9), *history(rng, 6, 9), gradients(rng, 6, 9))
