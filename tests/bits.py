"""The bits of all kernels and pipelines, which are the same on every machine: `python tests/bits.py > tests/bits.txt`.

Each line has a name, the hash of the inputs and the hash of the results, over images from less than a vector to more
than a band of rows. Inputs are made by numpy, whose functions differ in the last bits from machine to machine: they are
rounded to multiples of 2⁻¹².
"""

import hashlib
from dataclasses import replace

import flight
import numpy as np
import yester
from calls import arrays, calls
from yester.study.compare.methods import quarter

SIZES = ((1, 1), (5, 7), (9, 33), (131, 173))
GRID = 2.0**12


def rounded(value):
    """Arrays of floats and cameras within containers, rounded; the rest as it is."""
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        with np.errstate(invalid="ignore"):
            return (np.rint(value.astype(np.float64) * GRID) / GRID + 0.0).astype(value.dtype)  # + 0: no -0
    if isinstance(value, yester.Camera):
        return yester.Camera(rounded(np.asarray(value.world_to_clip)), value.width, value.height)
    if isinstance(value, dict):
        return {name: rounded(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return type(value)(rounded(item) for item in value)
    return value


def numbers(value) -> bytes:
    """The bytes of all arrays and cameras within containers, in order."""
    if isinstance(value, yester.Camera):
        return np.asarray(value.world_to_clip).tobytes()
    if isinstance(value, dict):
        return b"".join(numbers(item) for item in value.values())
    if isinstance(value, list | tuple):
        return b"".join(map(numbers, value))
    if not isinstance(value, np.ndarray):
        return b""
    # The payload of NaN is no bit of the result.
    return np.where(np.isnan(value), np.nan, value).astype(value.dtype).tobytes()


def short(parts: list[bytes]) -> str:
    return hashlib.sha256(b"".join(parts)).hexdigest()[:16]


def digest() -> str:
    """All lines."""
    given, found = {}, {}

    def note(name: str, inputs, results) -> None:
        given.setdefault(name, []).append(numbers(inputs))
        found.setdefault(name, []).append(numbers(results))

    for size in SIZES:
        for name, (function, arguments) in calls(*size).items():
            arguments = rounded(arguments)
            note(name, arguments, arrays(function(**arguments)))
    pipelines = {
        "SVGF": yester.SVGF(),
        "SVGF without guides": yester.SVGF(),
        "SVGF(reflections=(), choice=False)": yester.SVGF(reflections=(), choice=False),
        "TAA": yester.TAA(),
        "BMFR": yester.BMFR(),
        "HalfRes": yester.HalfRes(),
        "Recirculation": yester.Recirculation(),
        "Recirculation(textbook)": yester.Recirculation("textbook"),
        "Upscaler": yester.Upscaler(1.5, sharpness=0.5),
    }
    rng = np.random.default_rng(0)
    before = None
    for number in range(4):
        shot = flight.shoot(number, 171, 97)
        buffers = rounded(vars(replace(shot, color=flight.noisy(shot, rng), motion=None)))
        buffers["color"][number, 5:9] = np.nan
        frame = yester.Frame(**buffers | {"replay": before, "jitter": (0.25, -0.125)})
        before = frame.color * np.float32(0.5)
        for name, pipeline in pipelines.items():
            seen = yester.Frame(frame.color) if name == "SVGF without guides" else frame
            out = pipeline.step(quarter(frame, number) if isinstance(pipeline, yester.HalfRes) else seen)
            images = (out.color, out.variance, out.history_length, out.confidence, out.rejection, out.choice)
            note(name, buffers, list(images))
    return "\n".join(f"{name}: {short(given[name])} {short(found[name])}" for name in given)


if __name__ == "__main__":
    print(digest())
