import os
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import compare
import pytest
import torch
from hypothesis import HealthCheck, settings

if TYPE_CHECKING:
    from playwright.sync_api import Browser

# Commands that compare with the torch references find them here; the installed package does not contain them.
os.environ["YESTER_REFERENCES"] = str(Path(__file__).parent)

# By default the same examples every time. The nightly profile tries more, and others each night; what it prints of a
# failure repeats it.
settings.register_profile(
    "yester",
    deadline=None,
    derandomize=True,
    database=None,
    max_examples=200,
    suppress_health_check=list(HealthCheck),
)
settings.register_profile(
    "nightly", settings.get_profile("yester"), derandomize=False, max_examples=2000, print_blob=True
)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "yester"))


torch.set_num_threads(1)  # Images are small; on a busy machine, threads that wait for each other are slow.


@pytest.fixture(scope="module")
def browser() -> "Iterator[Browser]":
    """A headless browser; in CI, its absence is a failure."""
    program = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if program is None:
        reason = "no browser found: install chromium (on Debian: apt-get install chromium)"
        (pytest.fail if os.environ.get("CI") == "true" else pytest.skip)(reason)
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield running
        running.close()


@pytest.fixture
def ctrl_c() -> Iterator[None]:
    """SIGINT interrupts this process and those that it starts, also where pytest itself ignores it as a background job.

    Processes inherit that a signal is ignored, but not a handler: instead of one, they have the default.
    """
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    if compare.worst:
        terminalreporter.section("largest difference from the references, relative to magnitude")
        for name, difference in sorted(compare.worst.items()):
            terminalreporter.line(f"{name:<32} {difference:.1e}")
