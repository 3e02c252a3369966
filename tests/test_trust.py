"""Frames that are hard to demodulate, in renders: the command's table, and that the default holds."""

import pytest
from yester.study.compare import trust
from yester.study.rendered.recording import record

pytestmark = [pytest.mark.slow, pytest.mark.long]


def test_command(tmp_path, monkeypatch, capsys):
    small = {"frames": 8, "width": 96, "height": 72, "reference_spp": 64, "variants": 1, "raw_albedo": True}
    monkeypatch.setattr(trust, "record", lambda name, *_, **__: record(name, tmp_path, **small))
    trust.main(["--sequences", "black_plastic", "brushed_metal"])
    rows = [line.rsplit(maxsplit=4) for line in capsys.readouterr().out.splitlines()[1:]]
    found = {" ".join(name.split()): (float(psnr), float(relmse)) for name, psnr, relmse, *_ in rows}
    cases = ["black_plastic every buffer", "brushed_metal raw albedo, no emission"]
    assert [*found] == [f"{case} {method}" for case in cases for method in trust.METHODS]
    for case in cases:
        (psnr, relmse), (less, more) = found[f"{case} SVGF"], found[f"{case} SVGF(fireflies=True)"]
        assert psnr > less - 0.1
        assert relmse < 1.02 * more
