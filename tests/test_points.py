import csv

import pytest
from yester.metrics import METRICS
from yester.study.compare.points import ALL, Point, means, pareto, table, write_csv


def point(method="a", ms=1.0, scene="s", **values):
    return Point(scene, method, method, False, False, ms, (0.9 * ms, 1.1 * ms), values)


def test_front_by_hand():
    """From the fastest to the best, without dominated points and the slower of equal ones."""
    points = [
        point("slow", 9, psnr=34),
        point("fast", 1, psnr=30),
        point("worse", 2, psnr=29),
        point("same", 3, psnr=30),
        point("middle", 4, psnr=32),
        point("unknown", 0.1, flip=0.1),
        point("as fast", 4, psnr=31),
    ]
    assert [p.method for p in pareto(points, METRICS["psnr"])] == ["fast", "middle", "slow"]


def test_front_where_low_is_good():
    points = [point("a", 1, flip=0.2), point("b", 2, flip=0.3), point("c", 3, flip=0.1)]
    assert [p.method for p in pareto(points, METRICS["flip"])] == ["a", "c"]
    assert pareto([], METRICS["flip"]) == []


def test_sharper_than_the_reference_is_not_better():
    points = [point("a", 1, edge_sharpness=0.8), point("b", 2, edge_sharpness=1.6), point("c", 3, edge_sharpness=0.98)]
    assert [p.method for p in pareto(points, METRICS["edge_sharpness"])] == ["a", "c"]
    (line,) = [line for line in table(points).splitlines() if "*" in line.partition("ms")[2] or line.endswith("*")]
    assert line.startswith("c ")


def test_means():
    points = [
        *(point("a", 2, "s", psnr=30, flip=0.1), point("b", 5, "s", psnr=20)),
        *(point("a", 4, "t", psnr=34), point("c", 1, "t", psnr=20)),
    ]
    (mean,) = means(points)
    assert (mean.scene, mean.method, mean.ms, mean.values) == (ALL, "a", 3, {"psnr": 32})
    assert mean.ms_range == pytest.approx((2.7, 3.3))


def test_table_marks_the_best():
    text = table([point("a", 2, psnr=30, flip=0.1), point("bb", 5, psnr=31, flip=0.2), point("c", 7)])
    head, first, second, third = text.splitlines()
    assert head.split() == ["ms", "psnr", "flip"]
    assert first.split() == ["a", "2.0", "30.0000", "0.1000*"]
    assert second.split() == ["bb", "5.0", "31.0000*", "0.2000"]
    assert third.split() == ["c", "7.0"]


def test_csv(tmp_path):
    write_csv([point("a, b", 2, psnr=30.5)], tmp_path / "points.csv")
    (row,) = csv.DictReader((tmp_path / "points.csv").read_text().splitlines())
    assert list(row)[:8] == ["scene", "method", "family", "default", "peer", "ms", "ms_low", "ms_high"]
    assert list(row)[8:] == [*METRICS, "timed"]
    assert (row["method"], row["psnr"], row["flip"], row["ms_high"]) == ("a, b", "30.5", "", "2.2")
    assert [path.name for path in tmp_path.iterdir()] == ["points.csv"]
