from dataclasses import replace

import numpy as np
import pytest
import yester
from yester.plan import Stage
from yester.study.compare import halves, judging, oracle, stein
from yester.study.compare.ablation import ABLATIONS
from yester.study.compare.doors import DOORS
from yester.study.rendered.recording import record

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    cache = tmp_path_factory.mktemp("cache")
    shape = {"frames": 6, "width": 64, "height": 48, "reference_spp": 16, "references": range(3, 6)}
    return [record(name, cache, **shape) for name in ("cornell_box", "tapestry")]


@pytest.mark.long
def test_the_judge_beside_the_truth(recordings):
    """With references as samples it finds the worse result; with noisy samples, within its standard errors."""
    found = {each.component: each for each in judging.judged(recordings[1])}
    assert {"antialiasing", "choice", "demodulation", "all passes"} < set(found)
    assert found["demodulation"].gains["psnr"] > 0
    for each in found.values():
        assert all(abs(each.predicted[w] - each.clean[w]) <= 5 * each.error[w] for w in each.predicted)
    head, *rows, share = judging.correlations([*found.values(), *judging.judged(recordings[0])]).splitlines()
    assert head.split() == ["relative", "display", "relMSE", "PSNR"]
    assert len(rows) == len(found) + 1
    assert all(-1 <= float(value) <= 1 for value in rows[-1].split()[1:])
    assert share.startswith("the sign is right in ")


def test_gain_of_a_plan(recordings):
    found = judging.worth(recordings[0])
    assert (found.scene, found.door) == ("cornell_box", "every buffer")
    assert found.plan.stages
    assert set(found.gains) == set(found.both) == {"psnr", "relmse", "flip"}
    assert not found.plan.options
    assert not found.plan.without
    assert not any((*found.gains.values(), *found.both.values()))


def test_loss_of_a_poor_plan(recordings, monkeypatch):
    """Without any filter, noise stays: less of it where later frames help."""
    monkeypatch.setattr(yester, "plan", lambda _: yester.Plan({"iterations": 0, "choice": False}))
    found = judging.worth(recordings[0])
    assert found.gains["psnr"] < found.both["psnr"] < -0.5
    assert all(gain < 0 for gain in (*found.gains.values(), *found.both.values()))


def test_plans_through_a_door(recordings):
    door = next(door for door in DOORS if door.name == "motion alone")
    found = judging.worth(recordings[0], door)
    assert found.plan.reason == "neither depth nor normals nor ids tell surfaces apart"
    assert not any((*found.gains.values(), *found.both.values()))


def test_the_table_of_plans():
    nothing, less = dict.fromkeys(("psnr", "relmse", "flip"), 0.0), {"psnr": 0.2, "relmse": -0.04, "flip": 0.01}
    simpler = yester.Plan({"choice": False}, stages=(Stage("choice", False, 0.0, 0.0, 1.0),))
    found = [
        judging.Worth("one", "no ids", simpler, less, nothing),
        judging.Worth("two", "no ids", yester.Plan(), nothing, nothing),
    ]
    head, row, _, left = judging.table(found).splitlines()
    assert head.split("  ")[-1].strip() == "flip, both sides"
    assert " ".join(row.split()).startswith("no ids 1 +0.10 dB (+0.00 dB) -2.0 % (-4.0 %) +0.5 % (+0.0 %) +0.00 dB")
    assert left == "no ids, without choice: one"


def test_passes_that_pixels_show(recordings):
    """Shares of all pixels: a row for each sequence, of which none shows fewer or more passes than there are."""
    head, *rows = judging.passes(recordings).splitlines()
    assert head.split() == ["passes", "shown", "0", "1", "2", "3", "4"]
    for recording, row in zip(recordings, rows, strict=True):
        name, *shares = row.replace(" %", "").split()
        assert name == recording.name
        assert sum(map(int, shares)) == pytest.approx(100, abs=2)
        assert int(shares[3]) < 100


def test_ranks():
    rng = np.random.default_rng(0)
    values = rng.random(20)
    assert judging.rank_correlation(values, np.exp(values)) == pytest.approx(1)
    assert judging.rank_correlation(values, -(values**3)) == pytest.approx(-1)
    # Equal values have the mean of their ranks: by hand, 2, 2, 2, 4 and 1, 2.5, 2.5, 4.
    assert judging.rank_correlation([0, 0, 0, 5], [1, 3, 3, 7]) == pytest.approx(3 / np.sqrt(3 * 4.5))
    assert np.isnan(judging.rank_correlation(np.zeros(5), values[:5]))
    assert np.isnan(judging.rank_correlation([], []))
    assert yester.Plan().summary() == "the default: nothing is superfluous"


def test_a_component_that_changes_nothing():
    """It has no correlation, and is left out of the row of all."""

    def found(component, value, gain):
        weighted, error = (dict.fromkeys(("relative", "display"), number) for number in (value, 0.01))
        return judging.Judged("cut", component, weighted, error, weighted, {"relmse": gain, "psnr": -gain})

    some = [found("clip", value, gain) for value, gain in ((0.1, 0.3), (0.2, 0.1), (0.3, 0.2))]
    _, clip, idle, every, _ = judging.correlations([*some, *[found("motion test", 0.0, 0.0)] * 9]).splitlines()
    assert clip.split()[1:] == every.split()[1:] == ["1.00", "1.00", "-0.50", "0.50"]
    assert idle.split()[-4:] == ["–"] * 4


def test_components_of_the_output_stage_are_compared_with_it(recordings, monkeypatch):
    """A method gains nothing over itself, by any estimate or oracle."""
    stage = next(each for each in ABLATIONS if each.counterpart)
    for module in (judging, oracle):
        monkeypatch.setattr(module, "PARTS", [replace(stage, method=stage.base)])
    one = recordings[0]
    for (found,) in (judging.judged(one), *halves.judged(one, one), *stein.judged(one)):
        assert not any((*found.predicted.values(), *found.clean.values(), *found.gains.values()))
    *_, last = oracle.gains(one)
    assert not any(gain for gains in last.gains.values() for gain in gains.values())
