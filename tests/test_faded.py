"""Exposure that changes, in renders: the command's table, and that the denoisers follow."""

import pytest
from yester.study.compare import faded
from yester.study.rendered.recording import record

pytestmark = [pytest.mark.slow, pytest.mark.long]


def test_command(tmp_path, monkeypatch, capsys):
    small = {"frames": 12, "width": 128, "height": 96, "reference_spp": 32}
    recorded = record("cornell_box", tmp_path, **small)
    monkeypatch.setattr(faded, "record", lambda *_, **__: recorded)
    faded.main(["--sequences", "cornell_box"])
    rows = [line.rsplit(maxsplit=4) for line in capsys.readouterr().out.splitlines()[1:]]
    assert len(rows) == len(faded.FACTORS) * len(faded.METHODS)
    psnr = {" ".join(name.split()): float(value) for name, value, *_ in rows}
    for kind in ("flicker", "fade"):
        assert psnr[f"{kind} as rendered"] == psnr["constant as rendered"]
        for method in ("SVGF", "BMFR", "SVGF, both sides"):
            assert psnr[f"{kind} {method}"] > psnr[f"constant {method}"] - 0.5
        assert psnr[f"{kind} SVGF"] > psnr[f"{kind} SVGF(innovation=False)"] + 0.3
