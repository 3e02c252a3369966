"""Every planted mistake is named, and none is found without one."""

import numpy as np
import pytest
from yester.study.compare.mistakes import MISTAKES, findings

#: One of each kind for the quick part of the suite.
QUICK = ("none", "NDC, y up", "transposed matrix")


def named(mistake):
    return f"{mistake.name} ({'jittered, ' * mistake.jittered}{len(mistake.buffers)} buffers)"


def every():
    seen = set()
    for mistake in MISTAKES:
        quick = mistake.name in QUICK and mistake.name not in seen
        seen.add(mistake.name)
        yield pytest.param(mistake, id=named(mistake), marks=[] if quick else pytest.mark.slow)


@pytest.mark.parametrize("mistake", [*every()])
def test_planted_mistakes_are_named(mistake):
    found = findings(mistake)
    wrong = {finding.subject: finding for finding in found if finding.verdict == "wrong"}
    assert wrong.keys() == {mistake.subject} - {""}, "\n".join(map(str, found))
    for finding in wrong.values():
        assert finding.stored.startswith(mistake.stored)
        assert finding.remedy
        if np.isfinite(finding.margin):
            assert finding.margin > 3 * finding.error > 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_no_mistake_is_found_without_one(seed):
    """Of noise far above the light, too."""
    for mistake in MISTAKES:
        if not mistake.subject:
            found = findings(mistake, seed=seed, deviation=2.0)
            assert "wrong" not in [finding.verdict for finding in found], "\n".join(map(str, found))
