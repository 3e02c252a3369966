"""The command for larger frames: its tables, and the tiles that need a pass."""

from types import SimpleNamespace

import numpy as np
import pytest
from yester.study.compare import larger
from yester.study.rendered.recording import record

pytestmark = pytest.mark.slow


def test_tiles_that_need_a_pass(monkeypatch):
    """A tile needs what it or one beside it shows; frames without reference do not count."""
    choice = np.zeros((24, 44), np.float32)
    choice[23, 43] = 2.5
    outputs = iter([SimpleNamespace(choice=np.full_like(choice, 4)), SimpleNamespace(choice=choice)])
    monkeypatch.setattr(larger, "SVGF", lambda: SimpleNamespace(step=lambda frame: next(outputs)))
    recording = SimpleNamespace(frames=range(2), references={1: ""}, frame=lambda i: None)
    # Of three rows of six tiles, the last two of the last two.
    assert larger.needed(recording) == pytest.approx([4 / 18, 4 / 18, 4 / 18, 0])


@pytest.mark.long
def test_command(tmp_path, monkeypatch, capsys):
    recorded = record("cornell_box", tmp_path, frames=4, width=64, height=48, reference_spp=16)
    monkeypatch.setattr(larger, "record", lambda *_, **__: recorded)
    larger.main(["--sequences", "cornell_box", "mirror_room"])
    metrics, passes = capsys.readouterr().out.strip().split("\n\n")
    rows = [line.split() for line in metrics.splitlines()[1:]]
    assert [row[0] for row in rows[:: len(larger.METHODS)]] == ["cornell_box", "mirror_room", "mean"]
    assert len(rows) == 3 * len(larger.METHODS)
    assert [row[-1] for row in rows if row[1:-5] == ["SVGF"]] == ["1.00"] * 3
    assert [line.split()[0] for line in passes.splitlines()] == ["tiles", "cornell_box", "mirror_room"]
