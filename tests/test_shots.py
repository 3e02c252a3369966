"""Shots and missing frames, detected from file names."""

from pathlib import Path

import pytest
from yester.io.shots import breaks, by_shots, natural

CASES = {
    "one shot": (["a.0008.exr", "a.0009.exr", "a.0010.exr"], {}),
    "without zeros": (["frame9.exr", "frame10.exr", "frame11.exr"], {}),
    "zeros that change": (["f099.exr", "f0100.exr"], {}),
    "a gap": (["a.1.exr", "a.2.exr", "a.5.exr", "a.6.exr"], {2: "numbers jump"}),
    "every second frame": (["a.0.exr", "a.2.exr", "a.4.exr", "a.6.exr"], {}),
    "every tenth, with a gap": (
        ["a.10.exr", "a.20.exr", "a.30.exr", "a.60.exr"],
        {3: "(40 to 50 are missing, in steps of 10)"},
    ),
    "one of every second": (["a.0.exr", "a.2.exr", "a.4.exr", "a.8.exr"], {3: "(6 is missing)"}),
    "beside the step": (["a.0.exr", "a.2.exr", "a.4.exr", "a.7.exr"], {3: "numbers jump after a.4.exr: history"}),
    "no increase twice": (["a.1.exr", "a.3.exr", "a.6.exr"], {1: "(2 is missing)", 2: "(4 to 5 are missing)"}),
    "steps of each shot": (["a0.exr", "a2.exr", "a4.exr", "b0.exr", "b1.exr", "b2.exr"], {3: "not the same shot"}),
    "backwards": (["a.2.exr", "a.1.exr"], {1: "numbers jump"}),
    "twice": (["a.1.exr", "a.01.exr"], {1: "not the same shot"}),
    "two series of the same numbers": (
        ["a.1.exr", "a.01.exr", "a.2.exr", "a.02.exr"],
        {1: "the same frame number", 2: "one of two files with the same", 3: "the same frame number"},
    ),
    "once twice": (
        ["a.1.exr", "a.2.exr", "a.02.exr", "a.3.exr", "a.4.exr"],
        {2: "the same frame number", 3: "one of two files"},
    ),
    "two shots": (["a1.exr", "a2.exr", "b1.exr", "b2.exr"], {2: "not the same shot"}),
    "two numbered shots": (["s1_4.exr", "s1_5.exr", "s2_1.exr", "s2_2.exr"], {2: "not the same shot"}),
    "shots that meet": (["s1_4.exr", "s1_5.exr", "s2_5.exr", "s2_6.exr"], {2: "not the same shot"}),
    "a version behind": (["a_0001_v3.exr", "a_0002_v3.exr"], {}),
    "another version": (["a_0001_v3.exr", "a_0002_v3.exr", "a_0003_v4.exr"], {2: "not the same shot"}),
    "below zero": (["shot.-002.exr", "shot.-001.exr", "shot.0000.exr", "shot.0001.exr"], {}),
    "a number behind a dash": (["shot-001.exr", "shot-002.exr"], {}),
    "folders": (["1/a.exr", "2/a.exr", "3/a.exr"], {}),
    "no numbers": (["a.exr", "b.exr"], {1: "not the same shot"}),
    "one file": (["a.exr"], {}),
    "extensions": (["a1.exr", "a2.EXR", "a3.Exr"], {}),
    "none": ([], {}),
}


@pytest.mark.parametrize("name", CASES)
def test_breaks(name):
    names, want = CASES[name]
    paths = [Path(text) for text in names]
    found = breaks(paths)
    assert found.keys() == want.keys()
    for index, about in found.items():
        assert want[index] in about
        assert str(paths[index]) in about
        assert str(paths[index - 1]) in about


def test_words_tell_shots_apart():
    """As of two eyes, whose files take turns in natural order."""
    names = [f"{number:03}_{eye}.exr" for number in range(1, 4) for eye in "LR"]
    paths = by_shots(map(Path, names))
    assert [path.name for path in paths] == [*names[::2], *names[1::2]]
    assert list(breaks(paths)) == [3]


def test_natural_order():
    """A minus is a sign at the start and behind a separator, and a dash behind a letter or a number."""
    for names in (
        ["shot.-010.exr", "shot.-2.exr", "shot.0.exr", "shot.3.exr", "shot.20.exr"],
        ["-2.exr", "-1.exr", "1.exr"],
        ["shots_-2/a.exr", "shots_-1/a.exr"],
        ["shot-1.exr", "shot-2.exr", "shot-10.exr"],
        ["v2-1.exr", "v2-10.exr"],
        ["a01.exr", "a1.exr"],
    ):
        assert sorted(map(Path, reversed(names)), key=natural) == [*map(Path, names)]
