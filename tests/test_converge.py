"""The mean of a still scene's samples in its denoised image."""

import warnings

import composed
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, assert_same_bits, each, tensor
from hypothesis import given
from hypothesis import strategies as st

NAMES = "color", "mean", "moments", "history_length"


def scene(rng, height, width, *, holes=0.0, samples=(0, 40)) -> dict:
    """A denoised image with errors of its own, and the mean of up to so many samples."""
    truth = rng.uniform(0.2, 2, (height, width, 3)) * rng.uniform(0.01, 10)
    length = rng.integers(*samples, (height, width), endpoint=True).astype(np.float32)
    n = np.maximum(length, 1)[..., None]
    mean = truth * rng.gamma(n, 1 / n)
    light = mean @ [0.2126, 0.7152, 0.0722]
    spread = light**2 * rng.uniform(0, 2, light.shape)
    given = {
        "color": truth * rng.uniform(0.7, 1.4, truth.shape),
        "mean": mean,
        "moments": np.stack([light, light**2 + spread], -1),
        "history_length": length,
    }
    for image in given.values():
        image[rng.random((height, width)) < holes] = rng.choice([np.nan, np.inf, -np.inf])
    return {name: image.astype(np.float32) for name, image in given.items()}


def samples_of(rng, truth, count):
    """Mean, moments and number of noisy samples of a grey image."""
    samples = truth * rng.exponential(1, (count, *truth.shape))
    mean, square = samples.mean(0), (samples**2).mean(0)
    return mean[..., None].repeat(3, -1), np.stack([mean, square], -1), np.full(truth.shape, float(count))


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 100), st.integers(1, 100)),
    holes=st.sampled_from([0.0, 0.05, 0.8]),
    exposure=st.sampled_from([0.01, 1.0, 30.0]),
    strictness=st.sampled_from([0.0, 0.7, 1.0, 4.0]),
)
def test_reference(seed, size, holes, exposure, strictness):
    check(scene(np.random.default_rng(seed), *size, holes=holes), exposure, strictness)


@each("size", SIZES + TAILS)
def test_reference_of_sizes(size):
    check(scene(np.random.default_rng(size[1]), *size), 1.0)


def check(given, exposure, strictness=1.0):
    named = {"exposure": exposure, "strictness": strictness}
    got = yester.converge(**given, **named)
    want = reference.converge(**tensor(given), **named).numpy()
    assert got.dtype == np.float32
    # What is subtracted from each other is as large as this.
    largest = [np.where(np.isfinite(given[name]), np.abs(given[name]), 0) for name in ("color", "mean")]
    assert_close("converge", got, want, rtol=2e-5, scale=np.concatenate(largest, -1).max(-1, keepdims=True))


def test_by_hand():
    """One tile: v = 1/3 · (1 + 4/8), d = 4 in each pixel, so that the share is 7/8."""
    sign = np.where(np.indices((8, 8)).sum(0) % 2, 1.0, -1.0)
    color = np.ones((8, 8, 3))
    moments = np.stack([np.zeros((8, 8)), np.full((8, 8), 7 / 3)], -1)
    given = {"color": color, "mean": color + 2 * sign[..., None], "moments": moments}
    got = yester.converge(**given, history_length=np.full((8, 8), 8.0), exposure=1e-30)
    np.testing.assert_allclose(got, color + 7 / 4 * sign[..., None], rtol=1e-5)


@pytest.mark.parametrize("texture", [0.0, 0.3])
def test_it_is_better_than_both(texture):
    """Of a denoised image without texture, and the mean of ever more samples."""
    rng, texture = np.random.default_rng(0), 1 + texture * np.sin(1.7 * np.arange(96))
    truth = np.broadcast_to(texture, (72, 96))
    blurred = np.ones((72, 96, 3))
    for count in (8, 32, 128, 2000):
        mean, *known = samples_of(rng, truth, count)
        shown = yester.converge(blurred, mean, *known)
        errors = [((image - truth[..., None]) ** 2).mean() for image in (shown, blurred, mean)]
        assert errors[0] <= 1.02 * min(errors[1:]) + 0.01 * errors[2]
    if texture.std() > 0:
        assert errors[0] < 0.05 * errors[1]


def test_a_lamp_does_not_decide_for_what_is_around_it():
    """One pixel that the filter has spread is a thousand times brighter in the mean: around it, nothing gets darker."""
    truth = np.ones((72, 96))
    truth[30, 50] = 1000
    mean, *known = samples_of(np.random.default_rng(0), truth, 200)
    shown = yester.converge(np.ones((72, 96, 3)), mean, *known)
    assert np.abs(np.delete(shown.reshape(-1, 3), 30 * 96 + 50, 0) - 1).max() < 0.5
    assert (shown[30, 50] > 300).all()


def test_few_samples_show_the_image():
    given = scene(np.random.default_rng(0), 20, 30, samples=(0, 7))
    assert_same_bits(yester.converge(**given), given["color"])


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_stays_where_it_is(value):
    given = scene(np.random.default_rng(0), 40, 50, samples=(20, 30))
    clean = yester.converge(**given)
    for name in NAMES:
        spoiled = {**given, name: given[name].copy()}
        spoiled[name][17, 23] = value
        got = yester.converge(**spoiled)
        assert_same_bits(got[17, 23], spoiled["color"][17, 23])
        others = np.ones((40, 50), bool)
        others[17, 23] = False
        assert np.isfinite(got[others]).all()
        assert np.abs(got - clean)[others].max() < 0.2 * clean.max()


def test_scale_of_light():
    """Times a power of two, with the exposure, the bits are the same."""
    given = scene(np.random.default_rng(0), 30, 40)
    scaled = {"color": given["color"] * 8, "mean": given["mean"] * 8}
    scaled |= {"moments": given["moments"] * np.float32([8, 64]), "history_length": given["history_length"]}
    assert_same_bits(yester.converge(**scaled, exposure=8.0), yester.converge(**given) * 8)


@pytest.mark.parametrize("name", NAMES)
def test_in_place(name):
    given = scene(np.random.default_rng(0), 9, 14)
    want = yester.converge(**given)
    out = given[name] if given[name].shape == want.shape else np.empty_like(want)
    assert yester.converge(**given, out=out) is out
    assert_same_bits(out, want)


@pytest.mark.parametrize(
    ("name", "part"),
    [("color", np.s_[..., :2]), ("moments", np.s_[..., :1]), *((name, np.s_[:-1]) for name in NAMES[1:])],
)
def test_wrong_shapes(name, part):
    given = scene(np.random.default_rng(0), 6, 9)
    with pytest.raises(ValueError, match=f"^{name}: expected"):
        yester.converge(**given | {name: given[name][part].copy()})


@pytest.mark.parametrize("strictness", [-1.0, np.nan, np.inf])
def test_wrong_strictness(strictness):
    with pytest.raises(ValueError, match=r"^strictness: expected"):
        yester.converge(**scene(np.random.default_rng(0), 6, 9), strictness=strictness)


@pytest.mark.parametrize("exposure", [0.0, -1.0, np.nan, np.inf])
def test_wrong_exposure(exposure):
    with pytest.raises(ValueError, match=r"^exposure: expected"):
        yester.converge(**scene(np.random.default_rng(0), 6, 9), exposure=exposure)


# Within SVGF.


def standing_still(count, *, light=None, smoothness=1, size=(48, 64), depth=True):
    """Frames of a fine texture without albedo under gamma noise, and each frame's truth."""
    rng, (y, x) = np.random.default_rng(5), np.indices(size)
    texture = (1 + 0.6 * np.sin(1.9 * x) * np.sin(1.7 * y))[..., None].repeat(3, -1)
    still = {"motion": np.zeros((*size, 2), np.float32)}
    if depth:
        still["depth"] = np.full(size, 4.0, np.float32)
    for number in range(count):
        truth = texture if light is None else texture * light(number, x / size[1])[..., None]
        yield (
            yester.Frame((truth * rng.gamma(smoothness, 1 / smoothness, (*size, 1))).astype(np.float32), **still),
            truth,
        )


def error(image, truth) -> float:
    return float(((image - truth) ** 2).mean())


@pytest.mark.parametrize("depth", [True, False])
def test_a_still_scene_ends_in_the_mean_of_its_samples(depth):
    """Which the filter of so fine a texture is far from."""
    averaging, forgetting = yester.SVGF(average_still=True), yester.SVGF()
    frames, truth = [frame for frame, _ in standing_still(150, depth=depth)], next(standing_still(1))[1]
    for frame in frames:
        shown, usual = averaging.step(frame).color, forgetting.step(frame).color
    mean = error(np.mean([frame.color for frame in frames], 0), truth)
    assert error(shown, truth) < 1.1 * mean
    assert error(shown, truth) < 0.3 * error(usual, truth)


@pytest.mark.parametrize(
    "light",
    [
        lambda number, x: np.where((x < 0.5) & (number >= 50), 1.5, 1.0),
        lambda number, x: 1 + 0.8 * np.sin(number / 16) * (x - 0.5),
    ],
    ids=["switched", "travelling"],
)
def test_the_mean_of_samples_does_not_lag(light):
    """Where light changes in a part of the image, no frame is worse than without averaging."""
    averaging, forgetting, errors = yester.SVGF(average_still=True), yester.SVGF(), []
    for frame, truth in standing_still(100, light=light):
        errors.append([error(pipeline.step(frame).color, truth) for pipeline in (averaging, forgetting)])
    averaged, forgot = np.convolve(np.transpose(errors)[0], np.ones(5) / 5, "valid"), np.transpose(errors)[1]
    assert (averaged[20:] < 1.1 * np.convolve(forgot, np.ones(5) / 5, "valid")[20:]).all()
    assert np.mean(averaged[20:]) < 0.8 * forgot[20:].mean()


def test_what_moves_after_a_rest():
    """No frame is worse than without averaging, although the stages after the filter have paused."""
    rng, (y, x) = np.random.default_rng(3), np.indices((48, 96))
    pipelines, errors = (yester.SVGF(average_still=True), yester.SVGF()), []
    for number in range(40):
        shift = max(0, number - 29)  # pixels, from the thirtieth frame on
        texture = (1 + 0.6 * np.sin(0.9 * (x + shift)) * np.sin(0.7 * y))[..., None].repeat(3, -1)
        truth = texture * (1 + 0.5 * np.cos(0.1 * (x + shift)))[..., None]
        frame = yester.Frame(
            (truth * rng.gamma(1, 1, (48, 96, 1))).astype(np.float32),
            albedo=np.float32(0.5 * texture),
            depth=np.full((48, 96), 4.0, np.float32),
            motion=np.float32([float(number >= 30), 0]) * np.ones((48, 96, 1), np.float32),
        )
        errors.append([error(pipeline.step(frame).color, truth) for pipeline in pipelines])
    averaged, forgot = np.transpose(errors)[:, 30:]
    assert (averaged < 1.05 * forgot).all()
    assert averaged[0] < 0.95 * forgot[0]


@pytest.mark.parametrize("depth", [True, False])
def test_noise_that_repeats_is_not_the_mean_of_its_samples(depth):
    """Rendered with one seed, all frames are alike: their mean is as noisy as each."""
    frame, truth = next(standing_still(1, depth=depth))
    averaging, forgetting = yester.SVGF(average_still=True), yester.SVGF()
    with warnings.catch_warnings(action="ignore"):
        for _ in range(20):
            shown, usual = averaging.step(frame).color, forgetting.step(frame).color
    assert error(shown, truth) < 1.5 * error(usual, truth)


def test_the_mean_follows_what_all_light_changes_by():
    """As history does, in the bits of its kernels: a lamp that lights everything becomes three times as bright."""
    averaging, other, forgetting = yester.SVGF(average_still=True), composed.SVGF(average_still=True), yester.SVGF()
    light, errors = lambda number, x: np.full_like(x, 3.0 if number >= 14 else 1.0), []
    for frame, truth in standing_still(30, light=light, smoothness=16):
        shown = averaging.step(frame).color
        assert_same_bits(shown, other.step(frame).color)
        errors.append([error(image, truth) for image in (shown, forgetting.step(frame).color)])
    averaged, forgot = np.mean(errors[14:], 0)
    assert averaged < 0.6 * forgot


def test_the_mean_is_filtered_without_its_texture():
    """Each sample of an edge has one of its two albedos; the light of both is the same."""
    rng, svgf = np.random.default_rng(0), yester.SVGF(average_still=True)
    x = np.linspace(0.2, 0.8, 64, dtype=np.float32)
    chance = np.abs(np.sin(9 * x)) * np.ones((48, 1), np.float32)
    known = {"motion": np.zeros((48, 64, 2), np.float32), "depth": np.full((48, 64), 4.0, np.float32)}
    albedos, samples = [], []
    for _ in range(60):
        albedos.append(np.where(rng.uniform(size=chance.shape) < chance, np.float32(0.9), np.float32(0.1)))
        albedo = albedos[-1][..., None].repeat(3, -1)
        samples.append(albedo * rng.gamma(1, x, chance.shape)[..., None].astype(np.float32))
        shown = svgf.step(yester.Frame(samples[-1], albedo=albedo, **known)).color
    truth = (x * np.mean(albedos, 0))[..., None]
    assert error(shown, truth) < 0.2 * error(np.mean(samples, 0), truth)


def test_the_mean_keeps_albedo_that_is_no_reflectance():
    """A lobe by one pair of directions a sample: light that is divided by its mean is noisier than it was."""
    rng = np.random.default_rng(0)
    pipelines = yester.SVGF(average_still=True), composed.SVGF(average_still=True), yester.SVGF()
    x = np.linspace(0.2, 0.8, 64, dtype=np.float32) * np.ones((48, 1), np.float32)
    metal = np.arange(64) >= 32
    known = {
        "motion": np.zeros((48, 64, 2), np.float32),
        "depth": np.full((48, 64), 4.0, np.float32),
        "ids": np.where(metal, 2, 1).astype(np.uint32) * np.ones((48, 1), np.uint32),
    }
    for _ in range(24):
        lobe = np.exp(3 * rng.standard_normal((48, 64))).astype(np.float32)
        albedo = np.where(metal, lobe, np.float32(0.5))[..., None].repeat(3, -1)
        color = (rng.gamma(1, x)[..., None] * np.where(metal, 1, 0.5)[:, None]).astype(np.float32).repeat(3, -1)
        frame = yester.Frame(color, albedo=albedo, **known)
        shown, same, usual = (pipeline.step(frame).color for pipeline in pipelines)
    assert_same_bits(shown, same)
    truth = (x * np.where(metal, 1, 0.5))[..., None]
    assert error(shown[:, metal], truth[:, metal]) < error(usual[:, metal], truth[:, metal])
