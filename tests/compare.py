"""Comparison with the references: tight away from thresholds, bounded in number inside their band."""

import functools
import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
import yester

# A dozen roundings, relative to the compared numbers: that close to a threshold, float32 may decide unlike float64.
BAND = 2e-6

# name -> largest relative difference found; printed at the end of the session
worst: dict[str, float] = {}


def each(names: str | Sequence[str], cases: Iterable) -> Callable[[Callable], Callable]:
    """Like `pytest.mark.parametrize`, but one test that goes through all cases: a failure's note names its case.

    For many small cases, which take longer to set up and to report than to run. All cases share the fixtures.
    """
    cases = [(case,) for case in cases] if isinstance(names, str) else list(cases)
    names = (names,) if isinstance(names, str) else names

    def decorate(test: Callable) -> Callable:
        @functools.wraps(test)
        def run(**given):
            for case in cases:
                values = dict(zip(names, case, strict=True))
                try:
                    test(**given, **values)
                except BaseException as error:
                    error.add_note(f"The case is {values}.")
                    raise

        signature = inspect.signature(test)
        rest = [parameter for name, parameter in signature.parameters.items() if name not in names]
        run.__signature__ = signature.replace(parameters=rest)
        return run

    return decorate


def tensor(value, dtype=None):
    """Convert numpy to torch: floats to `dtype` (default float64), ids to int64, others unchanged."""
    import torch  # here, so that `bits` needs numpy alone

    dtype = dtype or torch.float64
    if isinstance(value, np.ndarray):
        integers = value.dtype.kind in "ui"
        return torch.from_numpy(value.astype(np.int64)) if integers else torch.tensor(value, dtype=dtype)
    if isinstance(value, Mapping):
        return {name: tensor(item, dtype) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [tensor(item, dtype) for item in value]
    return value


def assert_close(name: str, got, want, *, rtol=1e-5, scale=None, where=None, flips=0) -> None:
    """Equal NaN and infinities, and |got - want| ≤ rtol · max(|want|, scale), except in `flips` pixels of `where`.

    The scale is the magnitude of the terms that were summed, by default the root mean square of `want`: where
    large terms cancel, the small result is no more precise than they are.
    """
    got, want = np.asarray(got, np.float64), np.asarray(want, np.float64)
    assert got.shape == want.shape, f"{name}: {got.shape} instead of {want.shape}"
    finite = np.isfinite(got) & np.isfinite(want)
    if scale is None:
        scale = np.sqrt(np.mean(want[finite] ** 2)) if finite.any() else 0.0
    with np.errstate(invalid="ignore"):
        size = np.maximum(np.maximum(np.abs(want), scale), np.finfo(np.float32).tiny)
        error = np.where(finite, np.abs(got - want) / size, np.where(same(got, want), 0, np.inf))
    error = error[where] if where is not None else error
    pixels = np.sort(error.max(tuple(range(1, error.ndim)), initial=0))
    top = float(pixels[: len(pixels) - flips].max(initial=0))
    assert top <= rtol, f"{name}: differs by {top:.2e}, in {int((error > rtol).sum())} of {error.size} values"
    worst[name] = max(worst.get(name, 0.0), top)


def same(a, b) -> np.ndarray:
    """Elementwise equality in which NaN equals NaN."""
    return (a == b) | (np.isnan(a) & np.isnan(b))


def assert_same_bits(got, want) -> None:
    np.testing.assert_array_equal(got, want, strict=True)
    if got.dtype.kind == "f":
        here = ~np.isnan(got)
        np.testing.assert_array_equal(np.signbit(got)[here], np.signbit(want)[here])


def camera(rng: np.random.Generator, width: int, height: int, *, spread: float = 0.3) -> yester.Camera:
    """A random camera near the origin that looks roughly along -z, with its principal point off the centre."""
    origin, target = rng.normal(0, spread, 3), rng.normal(0, spread, 3) - [0, 0, 10]
    centre = (width * rng.uniform(0.4, 0.6), height * rng.uniform(0.4, 0.6))
    fov = rng.uniform(30, 80)
    return yester.Camera.from_look_at(origin, target, (0, 1, 0), fov, width, height, principal_point=centre)


def surfaces(rng: np.random.Generator, height: int, width: int) -> dict[str, np.ndarray]:
    """Depth, normal and ids of random tilted planes and background; one pixel in fifty lacks a depth, one an id."""
    cell = int(rng.integers(2, 9))
    coarse = rng.integers(0, 5, (height // cell + 1, width // cell + 1)).astype(np.uint32)
    ids = np.kron(coarse, np.ones((cell, cell), np.uint32))[:height, :width].copy()
    y, x = np.mgrid[:height, :width]
    tilt = rng.normal(0, 0.02, (5, 2))[ids]
    depth = 2.0 + ids + np.abs(tilt[..., 0] * x + tilt[..., 1] * y) + rng.uniform(0, 1e-3, ids.shape)
    normal = rng.normal(0, 1, (5, 3))[ids] + rng.normal(0, 0.1, (*ids.shape, 3))
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    depth[ids == 0], normal[ids == 0] = np.inf, 0
    ids[rng.random(ids.shape) < 0.02] = 0
    broken = rng.random(ids.shape) < 0.02
    depth[broken] = rng.choice([np.nan, 0.0, -1.0, np.inf], int(broken.sum()))
    return {"depth": depth.astype(np.float32), "normal": normal.astype(np.float32), "ids": ids}


def previous(rng: np.random.Generator, now: dict[str, np.ndarray], *, turn: float = 0.3) -> dict[str, np.ndarray]:
    """The previous frame's buffers: those of `now`, disturbed enough that every test both passes and fails."""
    shape = now["depth"].shape
    depth = now["depth"] * rng.uniform(0.88, 1.12, shape)
    normal = now["normal"] + rng.normal(0, turn, (*shape, 3)) * (rng.random(shape) < 0.5)[..., None]
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-6)
    normal[rng.random(shape) < 0.02] = 0
    ids = np.where(rng.random(shape) < 0.2, rng.integers(0, 5, shape), now["ids"])
    return {
        "previous_depth": depth.astype(np.float32),
        "previous_normal": normal.astype(np.float32),
        "previous_ids": ids.astype(np.uint32),
    }


def motions(rng: np.random.Generator, height: int, width: int, channels: int = 2) -> np.ndarray:
    """Still, whole-pixel, subpixel and far motion; unknown in one pixel of thirty."""
    kind = rng.choice(5, (height, width, 1), p=[0.15, 0.15, 0.5, 0.15, 0.05])
    motion = rng.normal(0, 1.5, (height, width, 3))
    motion = np.choose(kind, [0 * motion, np.rint(motion), motion, 4 * motion, 1e9 * motion])
    motion[..., 2] = rng.normal(0, 0.2, (height, width))
    motion[rng.random((height, width)) < 0.03] = np.nan
    motion[rng.random((height, width)) < 0.01, 0] = np.inf
    motion[rng.random((height, width)) < 0.01, 2] = np.nan
    return motion[..., :channels].astype(np.float32)


def colors(rng: np.random.Generator, height: int, width: int, channels: int = 3, *, holes: float = 0.05) -> np.ndarray:
    """Noisy HDR colour around one, with some missing samples and some channels missing."""
    color = rng.exponential(1, (height, width, channels)).astype(np.float32)
    color[rng.random((height, width)) < holes] = np.nan
    color[rng.random(color.shape) < holes / 5] = rng.choice([np.nan, np.inf, -np.inf])
    return color


# Shapes (height, width): single pixels, lines, odd sizes, and widths around multiples of every vector length.
SIZES = [(1, 1), (1, 9), (9, 1), (2, 2), (5, 7), (37, 41)]
TAILS = [(3, width) for width in [*range(1, 34), 63, 64, 65, 127, 128, 129]]
