import compare
import numpy as np
import pytest
import reference
import yester
from calls import calls
from compare import BAND, SIZES, TAILS, each, tensor
from hypothesis import given
from hypothesis import strategies as st


def check(albedo, previous, motion, **named):
    got = yester.material_change(albedo, previous, motion, **named)
    want, slack = reference.material_change(*map(tensor, (albedo, previous, motion)), margin=True, **named)
    clear = slack.numpy() > BAND
    np.testing.assert_array_equal(got[clear], want.numpy()[clear])
    return got, clear


def textures(rng, height, width):
    """Two albedos that share some texels; some are missing, some black."""
    before = rng.uniform(0, 1, (height, width, 3)).astype(np.float32)
    now = np.where(rng.random((height, width, 1)) < 0.3, before, rng.uniform(0, 1, before.shape).astype(np.float32))
    for image in before, now:
        image[rng.random((height, width)) < 0.05] = rng.choice([0, np.nan, np.inf])
    return now, before


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    channels=st.sampled_from([2, 3]),
    difference=st.sampled_from([0.0, 0.2, 0.5, 1.0]),
    share=st.sampled_from([0.0, 0.3, 0.6, 1.0]),
    radius=st.sampled_from([0, 1, 2, 7, 16]),
)
def test_reference(seed, size, channels, difference, share, radius):
    rng = np.random.default_rng(seed)
    motion = compare.motions(rng, *size, channels)
    check(*textures(rng, *size), motion, relative_luminance=difference, share=share, radius=radius)


@each("size", SIZES + TAILS[::3])
def test_sizes(size):
    rng = np.random.default_rng(size[1])
    check(*textures(rng, *size), compare.motions(rng, *size, 3), share=0.2)


def test_most_pixels_are_clear():
    rng = np.random.default_rng(0)
    mask, clear = check(*textures(rng, 80, 120), compare.motions(rng, 80, 120, 2), share=0.3, radius=4)
    assert clear.mean() > 0.9
    assert 0.1 < mask.mean() < 0.9


def chessboard(height, width, shift=0):
    y, x = np.indices((height, width)) // 8
    return np.where((x + y + shift) % 2, 0.8, 0.1)[..., None].repeat(3, -1).astype(np.float32)


def test_a_swapped_texture_is_found():
    """All of it but its borders, around which too few pixels differ."""
    before, now, still = chessboard(64, 96), chessboard(64, 96), np.zeros((64, 96, 2))
    now[16:48, 32:80] = chessboard(64, 96, 1)[16:48, 32:80]
    mask = yester.material_change(now, before, still)
    assert mask[20:44, 36:76].all()
    mask[16:48, 32:80] = False
    assert not mask.any()


def test_it_is_compared_where_it_was():
    before, motion = chessboard(64, 96), np.full((64, 96, 2), (3.0, -5.0))
    now = np.roll(before, (5, -3), (0, 1))
    assert not yester.material_change(now, before, motion)[8:-8, 8:-8].any()
    assert not yester.material_change(now, before, motion, share=0)[8:-8, 8:-8].any()


def test_aliased_texture_is_no_change():
    """Each frame samples it elsewhere: half of the pixels differ."""
    rng = np.random.default_rng(0)
    before, now = (np.where(rng.random((64, 96, 1)) < 0.5, 0.8, 0.1).repeat(3, -1) for _ in range(2))
    still = np.zeros((64, 96, 2))
    assert yester.material_change(now, before, still, share=0.3).mean() > 0.4
    assert yester.material_change(now, before, still).mean() < 0.02


def test_what_is_unknown_does_not_differ():
    dark, bright = np.full((20, 30, 3), 0.1), np.full((20, 30, 3), 0.8)
    still = np.zeros((20, 30, 2))
    assert yester.material_change(bright, dark, still).all()
    for known in (np.nan, np.inf):
        assert not yester.material_change(np.full_like(bright, known), dark, still).any()
        assert not yester.material_change(bright, np.full_like(dark, known), still).any()
    assert not yester.material_change(bright, dark, still + 40).any()
    assert not yester.material_change(bright, dark, still * np.nan).any()
    assert not yester.material_change(0 * bright, 0 * dark, still).any(), "black stays black"


def test_out():
    named = calls(20, 13)["material_change"][1]
    out = np.ones((20, 13), bool)
    assert yester.material_change(**named, out=out) is out
    np.testing.assert_array_equal(out, yester.material_change(**named))
    with pytest.raises(TypeError, match="out"):
        yester.material_change(**named, out=np.zeros((20, 13), np.float32))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"relative_luminance": -0.1}, "relative_luminance"),
        ({"relative_luminance": np.nan}, "relative_luminance"),
        ({"share": 1.1}, "share"),
        ({"radius": 17}, "radius: expected 0 to 16, got 17"),
        ({"radius": -1}, "radius"),
        ({"previous_albedo": np.ones((6, 8, 3))}, "previous_albedo"),
        ({"albedo": np.ones((6, 9))}, "albedo"),
        ({"motion": np.ones((6, 9, 4))}, "motion"),
    ],
)
def test_bad_arguments(wrong, message):
    with pytest.raises(ValueError, match=message):
        yester.material_change(**calls()["material_change"][1] | wrong)


def swapped(stage, *, swap=True) -> list[float]:
    """The mean errors of a stage behind a denoiser from the frame on in which the texture is swapped."""
    rng, errors = np.random.default_rng(0), []
    still = np.zeros((64, 96, 2), np.float32)
    for number in range(11):
        albedo = chessboard(64, 96, number >= 8 and swap)
        color = albedo * rng.gamma(20, 1 / 20, (64, 96, 1)).astype(np.float32)
        samples = albedo * rng.gamma(1, 1, (64, 96, 1)).astype(np.float32)
        output = stage.step(yester.Frame(color, albedo=albedo, motion=still), samples=samples)
        errors.append(float(np.abs(output.color - albedo).mean()))
    return errors[8:]


def test_a_denoised_history_leaves_no_ghost():
    """But at the borders of the checks, which are smoothed as for a first frame."""
    shown = {changes: swapped(yester.TAA("denoised", material_change=changes)) for changes in (True, False)}
    assert all(new < 0.6 * old for new, old in list(zip(shown[True], shown[False], strict=True))[:2])
    assert shown[True][2] < shown[False][2]
    usual = swapped(yester.TAA("denoised"), swap=False)
    assert swapped(yester.TAA("denoised", material_change=False), swap=False) == usual


def test_albedo_is_used():
    frame = yester.Frame(np.ones((4, 5, 3)), albedo=np.ones((4, 5, 3)))
    for changes, used in (None, ("albedo",)), (False, ()):
        assert yester.TAA("denoised", material_change=changes).step(frame).used == used
    assert yester.TAA("denoised", relative_albedo=0.2).step(frame).used == ("albedo",)
