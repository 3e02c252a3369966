import pytest
from yester.study.compare import networks

pytestmark = pytest.mark.slow


def test_installed_packages_are_compared(monkeypatch, capsys):
    """Others are left out; the first one's images are what the others' are compared with."""
    monkeypatch.setattr(networks, "PACKAGES", {"none": ("no-such-package",), **networks.PACKAGES})
    networks.main(["--size", "64x48"])
    heads, _, first, *others = (line.strip("| ").split(" | ") for line in capsys.readouterr().out.splitlines())
    assert heads[0] == "package"
    assert first[0] == "mitsuba-oidn"
    assert float(first[-1]) == 0
    assert all(float(number) > 0 for number in first[1:-1])
    for name, *numbers in others:
        assert name == "pyoidn"
        assert float(numbers[-1]) < 1e-3
