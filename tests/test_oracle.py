"""Oracles choose per tile, by errors of this frame or of earlier ones."""

from dataclasses import replace

import numpy as np
import pytest
import yester
from yester.metrics import psnr
from yester.study.compare import oracle
from yester.study.compare.methods import pipeline
from yester.study.rendered.recording import record

pytestmark = pytest.mark.slow

SHAPE = {"frames": 4, "width": 36, "height": 20, "reference_spp": 16}


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return record("cornell_box", tmp_path_factory.mktemp("cache"), **SHAPE)


@pytest.mark.parametrize("size", [(1, 1), (8, 8), (17, 30)])
def test_tiles(size):
    """Each tile comes from the better image; tiles at the border are smaller."""
    rng = np.random.default_rng(0)
    reference = rng.uniform(0.5, 1, (*size, 3)).astype(np.float32)
    better = rng.random((-(-size[0] // 8), -(-size[1] // 8))) < 0.5
    mask = np.kron(better, np.ones((8, 8), bool))[: size[0], : size[1], None]
    one, other = (reference + np.where(where, 0.1, 0.2).astype(np.float32) for where in (mask, ~mask))
    errors = [oracle.tile_errors(image, reference) for image in (one, other)]
    assert errors[0].shape == better.shape
    np.testing.assert_allclose(oracle.chosen([one, other], errors), reference + np.float32(0.1), rtol=1e-6)


def test_tile_error():
    """The mean over the tile of the squared error, relative to brightness."""
    reference, image = np.full((8, 9, 3), 0.3, np.float32), np.full((8, 9, 3), 0.5, np.float32)
    image[:, 8] = 0.3
    np.testing.assert_allclose(oracle.tile_errors(image, reference), [[0.04 / 0.1, 0]], rtol=1e-5)


def test_earlier_errors_decide():
    """A candidate that was worse so far is not taken, even if it is better now."""
    truth = {i: np.ones((8, 8, 3), np.float32) for i in range(3)}
    one, other = ({i: truth[i] + np.float32(d) for i, d in enumerate(errors)} for errors in ((0, 1, 0), (1, 0, 1)))
    found = oracle._best([one, other], truth, "before")
    assert [float(found[i].mean()) - 1 for i in range(3)] == [0, 1, 0]
    found = oracle._best([one, other], truth, "now")
    assert [float(found[i].mean()) - 1 for i in range(3)] == [0, 0, 0]


def test_gains(recording):
    """Gains over the default, in frames with a reference except the first."""
    found = {gain.candidates: gain for gain in oracle.gains(recording)}
    passes = found.pop("passes").gains
    assert set(passes) == {"now", "before", "default"}
    assert all(set(gain.gains) == set(oracle.ORACLES) for gain in found.values())
    frames = [recording.frame(i) for i in range(4)]
    usual, default = (
        [result.color for result in pipeline(yester.SVGF, **options)(frames)] for options in ({"choice": False}, {})
    )
    truth = recording.reference(3)
    assert passes["default"]["psnr"] == pytest.approx(psnr(default[3], truth) - psnr(usual[3], truth))
    # A choice by this frame's own errors has no greater error than either candidate.
    without = [result.color for result in pipeline(yester.SVGF, antialias=False)(frames)]
    both = [oracle.tile_errors(image, truth) for image in (default[3], without[3])]
    best = oracle.chosen([default[3], without[3]], both)
    assert found["SVGF - antialiasing"].gains["now"]["psnr"] == pytest.approx(
        psnr(best, truth) - psnr(default[3], truth)
    )


@pytest.mark.long
def test_command(recording, monkeypatch, capsys):
    monkeypatch.setattr(oracle, "record", lambda name, *_, **__: replace(recording, name=name))
    oracle.main(["--sequences", "grass", "cut"])
    lines = capsys.readouterr().out.splitlines()
    for table in (lines, lines[6:], lines[12:]):
        assert [line.split()[0] for line in table[2:5]] == ["grass", "cut", "mean"]
    assert sum(line.startswith("gain") for line in lines) == 5
    assert sum(line.startswith("SVGF - clip") for line in lines) == 2
