import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, each, tensor


def surfaces(rng, height, width):
    """Columns of even surfaces and of others, more or less mixed."""
    columns = np.arange(width) // 24
    mixed = rng.random((height, width)) < (columns % 4) / 3
    normal = np.broadcast_to([0.0, 0.6, 0.8], (height, width, 3)).copy()
    normal[mixed] = rng.normal(size=(mixed.sum(), 3))
    normal[rng.random((height, width)) < 0.03] = rng.choice([0, np.nan])
    ids = np.where(rng.random((height, width)) < (columns % 3) / 3, rng.integers(0, 5, (height, width)), 2**32 - 1)
    return normal.astype(np.float32), ids.astype(np.uint32)


@pytest.mark.parametrize("given", ["both", "normal", "ids"])
@each("size", [*SIZES, *TAILS, (33, 130), (64, 256)])
def test_reference(given, size):
    rng = np.random.default_rng(size)
    normal, ids = surfaces(rng, *size)
    buffers = (normal if given != "ids" else None), (ids if given != "normal" else None)
    for named in ({}, {"angle": 60.0, "share": 0.25}, {"angle": 180.0, "share": 0.0}, {"share": 1.0}):
        got = yester.incoherent_guides(*buffers, **named)
        assert got.dtype == bool
        want = reference.incoherent_guides(*(tensor(each) for each in buffers), **named)
        np.testing.assert_array_equal(got, want.numpy())


def test_edges_and_noise_on_few_pixels_are_coherent():
    normal = np.zeros((32, 48, 3), np.float32)
    normal[:, :20, 0] = normal[:, 20:, 1] = 1
    ids = np.arange(32)[:, None] // 4 + np.arange(48) // 4 * 100
    assert not yester.incoherent_guides(normal, ids).any()
    ids[16:, 16:32] = np.arange(256).reshape(16, 16)
    mask = yester.incoherent_guides(normal, ids)
    assert mask[16:, 16:32].all()
    assert mask.sum() == 256


def test_a_share_is_exceeded():
    """The share itself is allowed, and an angle as well."""
    ids = np.zeros((1, 11), np.uint32)
    ids[:, 6:] = np.arange(5) + 1
    assert not yester.incoherent_guides(ids=ids, share=0.5).any()
    assert yester.incoherent_guides(ids=ids, share=0.49).all()
    normal = np.zeros((1, 3, 3), np.float32)
    normal[0, [0, 2], 0] = normal[0, 1, 1] = 1
    assert yester.incoherent_guides(normal, angle=89.0).all()
    assert not yester.incoherent_guides(normal, angle=91.0).any()
    assert not yester.incoherent_guides(-5 * normal, angle=91.0).any()


def test_bad_input():
    normal = np.zeros((4, 5, 3), np.float32)
    with pytest.raises(ValueError, match="normal: expected an array where ids are not given, got None"):
        yester.incoherent_guides()
    with pytest.raises(ValueError, match="ids: expected height 4 and width 5"):
        yester.incoherent_guides(normal, np.zeros((5, 4), int))
    with pytest.raises(ValueError, match="angle: expected degrees from 0 to 180, got -1"):
        yester.incoherent_guides(normal, angle=-1)
    with pytest.raises(ValueError, match="share: expected a share from 0 to 1, got NaN"):
        yester.incoherent_guides(normal, share=np.nan)
    with pytest.raises(TypeError, match="out"):
        yester.incoherent_guides(normal, out=np.zeros((4, 5), np.uint8))
