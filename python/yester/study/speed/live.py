"""Rate and latency of `yester live`, in a browser on the same machine, and its memory over time.

``python -m yester.study.speed.live`` serves the Cornell box at each size, drags the camera about in a headless Chromium
while the cube flies, and prints: frames a second; milliseconds of rendering, denoising, making the views and transport
(from sending a picture until the page has drawn it and said so); milliseconds from a move of the pointer to the picture
that shows it. All are medians; of the latency also the 95th percentile. Then, the ways in which pictures may travel.
With ``--minutes``, it drags on for that long, and prints the memory that the server holds.
"""

from __future__ import annotations

import argparse
import math
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["main"]

_TIMES = ("render", "denoise", "views")


def main() -> None:
    """Print the tables."""
    about = (__doc__ or "").partition("\n")[0]
    parser = argparse.ArgumentParser(prog="python -m yester.study.speed.live", description=about)
    parser.add_argument("--sizes", metavar="WxH", nargs="*", default=["320x240", "640x480"], help="%(default)s")
    parser.add_argument("--seconds", type=float, default=20, help="at each size; %(default)s")
    parser.add_argument("--minutes", type=float, default=0, help="of use while memory is observed; %(default)s")
    options = parser.parse_args()
    from playwright.sync_api import sync_playwright

    program = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        rows, ways = [], []
        for size in options.sizes:
            with _served("--size", size) as (address, _):
                page = _opened(browser, address)
                page.evaluate("channel.send({ size: 0 })")
                rows.append(_row(size, page, options.seconds))
                ways += _ways(size, page)
                page.close()
        if rows:
            print(f"load of the machine: {os.getloadavg()[0]:.1f}; {os.cpu_count()} cores; {_variant}")
            print(_table(["size", "frames a second", *_TIMES, "transport", "pointer to picture", "95 %"], rows))
            print(_table(["size", "picture", "KiB", "encode, ms", "decode and draw, ms"], ways))
        if options.minutes:
            with _served() as (address, server):
                page = _opened(browser, address)
                print(_table(["minute", "resident, MiB", "frames"], _memory(server, page, options.minutes)))
                page.close()


_variant = ""


@contextmanager
def _served(*arguments: str) -> Iterator[tuple[str, int]]:
    """The address of a server, and its process id."""
    command = [sys.executable, "-m", "yester", "live", "--no-open", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as running:
        assert running.stdout is not None
        yield running.stdout.readline().split()[0], running.pid
        running.send_signal(signal.SIGTERM)


def _opened(browser: Any, address: str) -> Any:
    global _variant
    page = browser.new_page(viewport={"width": 1000, "height": 800})
    page.goto(address)
    while not page.evaluate("app.header !== null"):
        page.wait_for_timeout(100)
    _variant = page.evaluate("app.hello.variant")
    return page


def _drag(page: Any, seconds: float) -> None:
    """Move the pointer in circles, 60 times a second."""
    box = page.locator("canvas").bounding_box()
    x, y = box["x"] + box["width"] / 4, box["y"] + box["height"] / 2
    page.mouse.move(x + 40, y)
    page.mouse.down()
    start = time.perf_counter()
    while (passed := time.perf_counter() - start) < seconds:
        page.mouse.move(x + 40 * math.cos(passed), y + 40 * math.sin(passed))
        page.wait_for_timeout(16)
    page.mouse.up()


def _row(size: str, page: Any, seconds: float) -> list[str]:
    _drag(page, 5)  # kernels are compiled, the processor is warm
    page.evaluate("app.log.length = 0")
    _drag(page, seconds)
    width = int(size.split("x")[0])
    log = [entry for entry in page.evaluate("app.log") if entry["size"][0] == width]
    # The page logs pictures as they are drawn.
    rate = (len(log) - 1) / (log[-1]["at"] - log[0]["at"]) * 1e3
    times = [float(np.median([entry["ms"][name] for entry in log])) for name in _TIMES]
    transport = float(np.median([entry["transport"] for entry in log]))
    latency = [entry["latency"] for entry in log if entry["latency"] is not None]
    late = [float(np.median(latency)), float(np.percentile(latency, 95))]
    return [size.replace("x", "×"), f"{rate:.1f}", *(f"{value:.0f}" for value in (*times, transport, *late))]


def _ways(size: str, page: Any) -> list[list[str]]:
    """The denoised picture, raw and as WebP: bytes, time to encode, time to decode and draw in the browser."""
    from PIL import Image

    width, height = page.evaluate("app.header.size")
    values = page.evaluate("Array.from(app.images[1].data)")
    pixels: NDArray[np.uint8] = np.array(values, np.uint8).reshape(height, width, 4)
    rows = []
    options: dict[str, dict[str, Any]] = {
        "RGBA": {},
        "WebP, quality 85": {"quality": 85, "method": 0},
        "WebP, lossless": {"lossless": True, "method": 0, "quality": 0},
    }
    for name, how in options.items():
        times = []
        for _ in range(9):
            start = time.perf_counter()
            if how:
                file = BytesIO()
                Image.fromarray(pixels[..., :3]).save(file, "webp", **how)
                made = file.getvalue()
            else:
                made = pixels.tobytes()
            times.append(1e3 * (time.perf_counter() - start))
        decode = f"""async (bytes) => {{
          const data = new Uint8ClampedArray(bytes), target = new OffscreenCanvas({width}, {height}).getContext("2d");
          const times = [];
          for (let i = 0; i < 9; i++) {{
            const start = performance.now();
            if ({str(bool(how)).lower()}) target.drawImage(await createImageBitmap(new Blob([data])), 0, 0);
            else target.putImageData(new ImageData(data, {width}, {height}), 0, 0);
            times.push(performance.now() - start);
          }}
          return times.sort((a, b) => a - b)[4];
        }}"""
        drawn = page.evaluate(decode, [*made])
        rows.append(
            [size.replace("x", "×"), name, f"{len(made) / 1024:.0f}", f"{np.median(times):.1f}", f"{drawn:.1f}"]
        )
    return rows


def _memory(server: int, page: Any, minutes: float) -> list[list[str]]:
    """Resident memory of the server, while the camera is dragged and views, pipelines and light change."""
    import psutil

    process = psutil.Process(server)
    rows = [["0", f"{process.memory_info().rss / 2**20:.0f}", str(page.evaluate("app.header.number"))]]
    start, keys = time.perf_counter(), "adohcjtvlnzbmrlk"
    step = 0
    while (passed := time.perf_counter() - start) < 60 * minutes:
        _drag(page, 5)
        page.keyboard.press(keys[step % len(keys)])
        step += 1
        if passed // 60 >= len(rows) and passed >= 60:
            rows.append(_held(process, passed, page))
    return [*rows, _held(process, time.perf_counter() - start, page)]


def _held(process: Any, passed: float, page: Any) -> list[str]:
    resident = process.memory_info().rss / 2**20
    return [f"{passed / 60:.1f}", f"{resident:.0f}", str(page.evaluate("app.header.number"))]


def _table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---", *["--:"] * (len(head) - 1)], *rows]
    return "\n".join(["", *(f"| {' | '.join(line)} |" for line in lines)])


if __name__ == "__main__":
    main()
