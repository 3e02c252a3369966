"""Scenes in which nothing moves, in renders: the command's tables."""

import pytest
from yester.study.compare import still

pytestmark = [pytest.mark.slow, pytest.mark.long]


def test_command(monkeypatch, capsys):
    """With ever more samples, the result is better than their mean, and than without averaging."""
    render = still.render
    monkeypatch.setattr(still, "render", lambda name, count: render(name, count, spp=512))
    monkeypatch.setattr(still, "COUNTS", (8, 40))
    still.main(["--sequences", "cornell_box", "sunlit_teapot"])
    seen, held_out = capsys.readouterr().out.split("\n\n")
    for table in (seen, held_out):
        rows = [line.rsplit(maxsplit=3) for line in table.splitlines()[1:]]
        assert len(rows) == 2 * len(still.METHODS)
        psnr = {" ".join(name.split()): float(value) for name, value, *_ in rows}
        averaged = psnr["40 SVGF(average_still=True)"]
        assert averaged > psnr["40 mean of samples"] + 2
        assert averaged > psnr["40 SVGF"] + 1
        assert psnr["8 SVGF(average_still=True)"] > psnr["8 SVGF"] - 0.1
