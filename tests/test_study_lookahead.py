"""The study of later frames: its errors are the chart's, its new pixels those without history, its costs measured."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from yester.metrics import METRICS, Picture
from yester.study.compare import lookahead
from yester.study.compare.chart import measure
from yester.study.compare.lookahead import Cost, Revealed, Worth, costs, ends, errors, gains, places, revealed, worth
from yester.study.compare.methods import PIPELINES, Result
from yester.study.compare.points import Point
from yester.study.rendered.recording import record

pytestmark = pytest.mark.slow

METHODS = [PIPELINES[0], next(method for method in PIPELINES if method.name == "SVGF, both sides")]
SHAPE = {"frames": 6, "width": 48, "height": 36, "reference_spp": 16, "references": (0, 2, 3, 5)}


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="module")
def recordings(cache):
    return [record(name, cache, **SHAPE) for name in ("cornell_box", "passer_by")]


@pytest.fixture(scope="module")
def found(recordings):
    return [worth(recording, METHODS) for recording in recordings]


def table(text):
    return [line.split() for line in text.splitlines()]


def test_methods():
    names = [method.name for method in lookahead.methods()]
    assert names[:2] == [method.name for method in METHODS]
    assert set(names[2:]) <= {"OIDN high"}


@pytest.mark.parametrize("length", [1, 2, 3, 6, 7, 20])
def test_places(length):
    """Three frames each, or fewer, inside the sequence; the middle is in the middle."""
    parts = places(length)
    assert {name: len(part) for name, part in parts.items()} == dict.fromkeys(parts, min(3, length))
    assert parts["beginning"].start == 0
    assert parts["end"].stop == length
    assert 0 <= length - parts["middle"].stop <= parts["middle"].start <= length - parts["middle"].stop + 1


@pytest.mark.parametrize("number", [0, 1])
def test_errors_are_those_of_the_chart(recordings, found, tmp_path, number):
    """Times are of this run."""
    _, *charted = measure(recordings[number], METHODS, tmp_path, metrics=("psnr", "relmse", "flip", "temporal_error"))
    for point, other in zip(found[number].points, charted, strict=True):
        assert point.values == pytest.approx(other.values)
        assert 0 < point.ms_range[0] <= point.ms <= point.ms_range[1]
        assert replace(point, ms=0, ms_range=(0, 0), values={}, size=None) == replace(
            other, values={}, images=None, runs=()
        )
    both = found[number].frames["SVGF, both sides"]
    assert [*both] == [0, 2, 3, 5]
    assert [i for i in both if "temporal_error" in both[i]] == [3]


def test_new_pixels_by_hand(recordings, found):
    """Pixels with this frame's sample alone, and pixels with history within three pixels of these."""
    recording = recordings[1]
    given = [recording.frame(i) for i in range(6)]
    runs = {method.name: [*method.run(iter(given))] for method in METHODS}
    new = {i: runs["SVGF"][i].history_length == 1 for i in (2, 3, 5)}
    near = {}
    for i, mask in new.items():
        near[i] = np.zeros_like(mask)
        for y, x in np.argwhere(~mask):
            near[i][y, x] = mask[max(y - 3, 0) : y + 4, max(x - 3, 0) : x + 4].any()
    assert found[1].share == pytest.approx(np.mean([mask.mean() for mask in new.values()]))
    assert 0.05 < found[1].share < 0.3
    for name, results in runs.items():
        for masks, value in zip((new, near), found[1].revealed[name], strict=True):
            squares = [
                (results[i].color[mask] - recording.reference(i)[mask].astype(float)) ** 2
                / (recording.reference(i)[mask].astype(float) ** 2 + 0.01)
                for i, mask in masks.items()
            ]
            assert value == pytest.approx(np.concatenate(squares).mean())


def test_no_new_pixels_where_there_are_none_or_only_such():
    """The first frame, one without disocclusion, and one after a cut."""

    def result(confidence):
        return Result(np.zeros((4, 5, 3), np.float32), confidence=np.float32(confidence) * np.ones((4, 5), np.float32))

    pictures = {i: Picture(np.full((4, 5, 3), 0.1 * (i + 1))) for i in range(3)}
    images = {"one": pictures, "other": pictures}
    assert lookahead._revealed([result(0), result(0), result(0.1)], images, pictures) == ({}, 0.0)
    half = np.zeros((4, 5), bool)
    half[0, 0] = True
    values, share = lookahead._revealed([result(1), result(1), result(~half)], images, pictures)
    assert values == dict.fromkeys(images, Revealed(0, 0))
    assert share == 1 / 20


def worths():
    """Two sequences with known errors."""

    def one(scene, factor):
        frames = {
            name: {i: dict.fromkeys(("psnr", "relmse", "flip"), factor * much * (i + 1)) for i in (0, 2, 9)}
            for name, much in (("SVGF", 0.2), ("SVGF, both sides", 0.1))
        }
        known = {name: {"psnr": 30.0 - v[0]["psnr"], "relmse": v[0]["relmse"]} for name, v in frames.items()}
        points = [Point(scene, name, name, False, False, 5.0, (4, 6), known[name]) for name in frames]
        return Worth(points, frames, 10, {name: Revealed(much[0]["flip"], 0.5) for name, much in frames.items()}, 0.25)

    return [one("calm", 1), one("wild", 3)]


def test_tables_by_hand():
    both = worths()
    assert [line.split() for line in errors(both).splitlines() if "both" in line] == [
        ["SVGF,", "both", "sides", "5.0", "29.9000*", "0.1000*"],
        ["SVGF,", "both", "sides", "5.0", "29.7000*", "0.3000*"],
        ["SVGF,", "both", "sides", "5.0", "29.8000*", "0.2000*"],
    ]
    assert [line for line in errors(both).splitlines() if line in ("calm", "wild", "all")] == ["calm", "wild", "all"]
    assert "all" not in errors(both[:1]).splitlines()
    _, row = gains(both).splitlines()
    assert " ".join(row.split()) == f"{METHODS[1].name} over SVGF +0.20 dB ( 2) +0.10 dB calm +50.0 % ( 2) +50.0 % calm"
    head, *rows = table(ends(both))
    assert " ".join(head).startswith("frame relMSE, SVGF relMSE, SVGF, both sides FLIP, SVGF FLIP, SVGF, both sides")
    assert rows == [
        ["beginning", "0", "0.4000", "0.2000", "0.4000", "0.2000"],
        ["beginning", "2", "1.2000", "0.6000", "1.2000", "0.6000"],
        ["end", "9", "4.0000", "2.0000", "4.0000", "2.0000"],
    ]
    _, calm, wild, mean, median = table(revealed(both))
    assert calm == ["calm", "25.00", "%", "0.2000", "0.5000", "0.1000", "0.5000"]
    assert wild == ["wild", "25.00", "%", "0.6000", "0.5000", "0.3000", "0.5000"]
    assert mean == ["mean", "25.00", "%", "0.4000", "0.5000", "0.2000", "0.5000"]
    assert median == ["median", *mean[1:]]
    third = both[0]._replace(revealed={name: Revealed(9, 9) for name in both[0].revealed}, share=1.0)
    *_, mean, median = table(revealed([*both, third]))
    assert mean == ["mean", "50.00", "%", "3.2667", "3.3333", "3.1333", "3.3333"]
    assert median == ["median", "25.00", "%", "0.6000", "0.5000", "0.3000", "0.5000"]
    assert len(table(revealed([both[0], both[1]._replace(revealed={}, share=0.0)]))) == 4
    assert revealed([both[0]._replace(revealed={}, share=0.0)]) == "no disoccluded pixels"


def test_frames_that_not_all_sequences_have():
    calm, wild = worths()
    frames = {name: {i: each[i] for i in (2, 9)} for name, each in wild.frames.items()}
    assert [row[1] for row in table(ends([calm, wild._replace(frames=frames)]))[1:]] == ["2", "9"]


@pytest.mark.long
def test_costs():
    """A larger lookahead holds more frames."""
    alone, ahead = costs((0, 6), (160, 96))
    assert (alone.lookahead, ahead.lookahead) == (0, 6)
    assert min(alone.ms, ahead.ms) > 0
    if sys.platform == "linux":  # Others do not report the peak.
        # Seven frames, each of color, albedo, normal, motion, depth and ids.
        assert ahead.memory - alone.memory > 7 * 160 * 96 * 14 * 4e-6
    text = lookahead._costs([Cost(0, 5.0, 10.2), Cost(8, 12.0, None)])
    assert table(text)[1:] == [["0", "5.0", "1.00", "10"], ["8", "12.0", "2.40"]]


def test_command(recordings, cache, capsys, monkeypatch):
    """It prints everything, for the requested sequences."""
    monkeypatch.setattr(lookahead, "methods", lambda: METHODS)
    shape = ("--length", "6", "--size", "48x36", "--references", "0", "2", "3", "5", "--reference-spp", "16")
    names = ("--sequences", "passer_by", "cornell_box", "passer_by")
    lookahead.main([*names, *shape, "--cache", str(cache), "--lookaheads", "0", "--time-size", "32x24"])
    parts = capsys.readouterr().out.split("\n\n")
    assert [part.split()[0] for part in parts[:3]] == ["passer_by", "cornell_box", "all"]
    assert [part.split()[0] for part in parts[3:]] == ["psnr", "frame", "new", "lookahead"]
    assert METRICS.keys() > {*parts[3].splitlines()[0].split()}
    assert [row[0] for row in table(parts[4])[1:]] == ["beginning", "beginning", "middle", "end"]
    lookahead.main([*names[:2], *shape, "--cache", str(cache), "--lookaheads"])
    assert "lookahead" not in capsys.readouterr().out


@pytest.mark.parametrize("wrong", [("--sequences", "cornell"), ("--size", "48by36"), ("--lookaheads", "-1")])
def test_command_refuses(wrong, capsys):
    with pytest.raises(SystemExit):
        lookahead.main([*wrong])
    assert wrong[0] in capsys.readouterr().err
