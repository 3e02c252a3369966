"""Noise that repeats, in renders: that it is found, and the command's table."""

import pytest
from yester.study.compare import repeated
from yester.study.rendered.recording import record

pytestmark = pytest.mark.slow


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:color. expected new noise")
def test_command(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(repeated, "_FRAMES", 6)
    monkeypatch.setattr(repeated, "_WIDTH", 64)
    monkeypatch.setattr(repeated, "_HEIGHT", 48)
    small = {"frames": 6, "width": 64, "height": 48, "reference_spp": 64}
    recorded = record("cornell_box", tmp_path, **small)
    monkeypatch.setattr(repeated, "record", lambda *_, **__: recorded)
    repeated.main(["--sequences", "cornell_box"])
    table, ranges = capsys.readouterr().out.split("\n\n")
    rows = [line.rsplit(maxsplit=4) for line in table.splitlines()[1:]]
    assert len(rows) == len(repeated.KINDS) * len(repeated.METHODS)
    psnr = {" ".join(name.split()): float(value) for name, value, *_ in rows}
    for kind in repeated.KINDS:
        assert psnr[f"{kind} SVGF"] > psnr[f"{kind} as rendered"] + 5
    least = [float(line.split()[-3]) for line in ranges.splitlines()[1:]]
    most = [float(line.split()[-1]) for line in ranges.splitlines()[1:]]
    assert most[0] < 0.3 < min(least[1:])
