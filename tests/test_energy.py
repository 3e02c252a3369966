"""The light of a frame that denoisers keep, in renders: the command's tables."""

import numpy as np
import pytest
from yester.study.compare import energy
from yester.study.rendered.recording import record


def test_change():
    references = {i: np.full((2, 3, 3), i, np.float32) for i in (1, 2)}
    images = [np.full((2, 3, 3), value, np.float32) for value in (7, 0.5, 3)]
    assert energy.change(images, references) == pytest.approx(0)


@pytest.mark.slow
@pytest.mark.long
def test_command(tmp_path, monkeypatch, capsys):
    small = {"frames": 8, "width": 64, "height": 48, "reference_spp": 64}
    recorded = record("naked_lamps", tmp_path, **small)
    monkeypatch.setattr(energy, "record", lambda *_, **__: recorded)
    energy.main(["--sequences", "naked_lamps"])
    head, row, _, columns, *means = capsys.readouterr().out.splitlines()
    assert all(method in head for method in energy.METHODS)
    kept = dict(zip(energy.METHODS, row.replace(" %", "").split()[1:], strict=True))
    assert columns.split() == ["PSNR", "relMSE", "FLIP", "temporal"]
    assert len(means) == 3
    assert float(kept["SVGF"]) < -20 < float(kept["linear stage"]) < float(kept["no antialiasing"]) + 20
