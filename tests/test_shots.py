"""Shots and missing frames, detected from file names."""

from pathlib import Path

import pytest
from yester.io.shots import breaks

CASES = {
    "one shot": (["a.0008.exr", "a.0009.exr", "a.0010.exr"], {}),
    "without zeros": (["frame9.exr", "frame10.exr", "frame11.exr"], {}),
    "zeros that change": (["f099.exr", "f0100.exr"], {}),
    "a gap": (["a.1.exr", "a.2.exr", "a.5.exr", "a.6.exr"], {2: "numbers jump"}),
    "backwards": (["a.2.exr", "a.1.exr"], {1: "numbers jump"}),
    "twice": (["a.1.exr", "a.01.exr"], {1: "not the same shot"}),
    "two shots": (["a1.exr", "a2.exr", "b1.exr", "b2.exr"], {2: "not the same shot"}),
    "two numbered shots": (["s1_4.exr", "s1_5.exr", "s2_1.exr", "s2_2.exr"], {2: "not the same shot"}),
    "shots that meet": (["s1_4.exr", "s1_5.exr", "s2_5.exr", "s2_6.exr"], {2: "not the same shot"}),
    "a version behind": (["a_0001_v3.exr", "a_0002_v3.exr"], {}),
    "another version": (["a_0001_v3.exr", "a_0002_v3.exr", "a_0003_v4.exr"], {2: "not the same shot"}),
    "folders": (["1/a.exr", "2/a.exr", "3/a.exr"], {}),
    "no numbers": (["a.exr", "b.exr"], {1: "not the same shot"}),
    "one file": (["a.exr"], {}),
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
