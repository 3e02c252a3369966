"""Frames of more than one sample: how much of the output stage they show, and the command's table."""

import pytest
from yester.study.compare import samples
from yester.study.rendered.recording import record

pytestmark = pytest.mark.slow


@pytest.mark.long
@pytest.mark.parametrize("name", ["cornell_box", "thicket"])
def test_less_of_the_output_stage(tmp_path, name):
    """Of many samples, the stage alone makes frames worse than they were rendered; tiles then show less of it."""
    shape = {"frames": 8, "width": 96, "height": 72, "references": (6, 7), "reference_spp": 512}
    found = samples.errors(record(name, tmp_path, spp=64, **shape))
    svgf, whole, rendered = (found[method] for method in ("SVGF", "SVGF, stage everywhere", "as rendered"))
    assert whole["relmse"] > rendered["relmse"]
    assert svgf["relmse"] < 0.6 * whole["relmse"]
    assert svgf["psnr"] > whole["psnr"] + 1


def test_command(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(samples, "_SAMPLES", (1, 2))
    recorded = record("cornell_box", tmp_path, frames=4, width=32, height=24, reference_spp=16)
    monkeypatch.setattr(samples, "record", lambda *_, **__: recorded)
    samples.main(["--sequences", "cornell_box", "cut"])
    lines = capsys.readouterr().out.splitlines()
    count = len(samples.METHODS)
    assert [line.split()[0] for line in lines[1 : 1 + 2 * count]] == [*["1"] * count, *["2"] * count]
    assert [line.split()[0] for line in lines[-2:]] == ["1", "2"]
    assert all(line.endswith(("cornell_box", "cut")) for line in lines[-2:])
