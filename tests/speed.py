"""Every kernel against its torch reference at 1920×1080, in turn in one run: ``python tests/speed.py``.

Prints the median over the runs, in ms. The references run in float32, with as many threads as the kernels.
"""

import statistics
import time

import reference
import torch
import yester
from calls import calls
from compare import tensor

RUNS = 5


def milliseconds(function) -> float:
    start = time.perf_counter()
    function()
    return 1000 * (time.perf_counter() - start)


def main() -> None:
    threads, simd = yester._core.settings()
    torch.set_num_threads(threads)
    print(f"{threads} threads, {simd}; medians of {RUNS}\n{'':<28}{'kernel':>10}{'torch':>10}{'ratio':>8}")
    for name, (kernel, arguments) in calls(1080, 1920).items():
        twin = getattr(reference, kernel.__name__)
        tensors = {key: tensor(value, torch.float32) for key, value in arguments.items()}
        pairs = [
            (milliseconds(lambda: kernel(**arguments)), milliseconds(lambda: twin(**tensors)))  # noqa: B023
            for _ in range(RUNS)
        ]
        ours, theirs = (statistics.median(times) for times in zip(*pairs, strict=True))
        print(f"{name:<28}{ours:>10.1f}{theirs:>10.1f}{theirs / ours:>8.1f}", flush=True)


if __name__ == "__main__":
    main()
