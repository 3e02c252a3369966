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


@pytest.mark.parametrize("given", ["all", "normal", "ids"])
@each("size", [*SIZES, *TAILS, (33, 130), (64, 256)])
def test_reference(given, size):
    rng = np.random.default_rng(size)
    normal, ids = surfaces(rng, *size)
    # Between a tenth and a half in one part of the tiles.
    confidence = (rng.random(size) < rng.random((size[1] + 15) // 16)[np.arange(size[1]) // 16]).astype(np.float32)
    buffers = (normal if given != "ids" else None), (ids if given != "normal" else None)
    for named in ({}, {"confidence": confidence * np.float32(0.77)}):
        got = yester.incoherent_guides(*buffers, **named)
        assert got.dtype == bool
        want = reference.incoherent_guides(*(tensor(each) for each in buffers), **tensor(named))
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


def test_guides_that_are_found_again_are_coherent():
    """And those of which nothing is, as at a cut."""
    ids = np.arange(16 * 80).reshape(16, 80)
    confidence = np.repeat([0.0, 0.09, 0.11, 0.49, 0.51], 16) * np.ones((16, 1))
    tiles = yester.incoherent_guides(ids=ids, confidence=confidence)[0, ::16]
    assert tiles.tolist() == [False, False, True, True, False]
    # The mean decides.
    confidence[:, 32:48] = np.arange(16) % 4 == 0
    assert yester.incoherent_guides(ids=ids, confidence=confidence)[0, 32]


def test_bounds():
    """Two fifths of the pairs are allowed, and 25 degrees, whatever the lengths of normals."""
    ids = np.zeros((1, 11), np.uint32)
    ids[:, 7:] = np.arange(4) + 1
    assert not yester.incoherent_guides(ids=ids).any()
    ids[:, 6] = 9
    assert yester.incoherent_guides(ids=ids).all()
    for degrees, differs in ((24.9, False), (25.1, True)):
        normal = np.zeros((3, 1, 3), np.float32)
        normal[[0, 2], :, 0] = 5
        normal[1] = 0.1 * np.cos(np.radians(degrees)), 0.1 * np.sin(np.radians(degrees)), 0
        assert yester.incoherent_guides(normal).all() == differs


def test_bad_input():
    normal = np.zeros((4, 5, 3), np.float32)
    with pytest.raises(ValueError, match="normal: expected an array where ids are not given, got None"):
        yester.incoherent_guides()
    with pytest.raises(ValueError, match="ids: expected height 4 and width 5"):
        yester.incoherent_guides(normal, np.zeros((5, 4), int))
    with pytest.raises(ValueError, match="confidence: expected height 4 and width 5"):
        yester.incoherent_guides(normal, confidence=np.zeros((5, 4)))
    with pytest.raises(TypeError, match="out"):
        yester.incoherent_guides(normal, out=np.zeros((4, 5), np.uint8))
