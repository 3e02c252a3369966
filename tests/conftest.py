import os
from pathlib import Path

import compare
import pytest
import torch
from hypothesis import HealthCheck, settings

# For the commands that compare with the references, which the installed package does not have.
os.environ["YESTER_REFERENCES"] = str(Path(__file__).parent)

settings.register_profile(
    "yester", deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck)
)
settings.load_profile("yester")
torch.set_num_threads(1)  # the images are small, and threads that wait for each other are slow on a busy machine


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    if compare.worst:
        terminalreporter.section("largest difference from the references, relative to magnitude")
        for name, difference in sorted(compare.worst.items()):
            terminalreporter.line(f"{name:<32} {difference:.1e}")
