"""`out=`: the same bits in the caller's memory, which may be that of an input."""

import re

import numpy as np
import pytest
import yester
from calls import arrays, calls
from compare import assert_same_bits, each

# Of a size that has more than one tile of 8×8 along each side.
NUMBERS = "depth_change", "exposure", "light_change", "repetition"  # of their results, one is a number
CALLS = {name: call for name, call in calls(10, 13).items() if name not in NUMBERS}
# The inputs that results may replace, in the order of the results.
IN_PLACE = {
    "reproject": ("history", None),
    "reproject(nearest)": ("history", None),
    "accumulate": ("history", "history_moments", "history_length"),
    "combine_histories": ("color", "moments", "history_length"),
    "converge": ("color",),
    "choice": (None, "evidence"),
    "compare_candidates": ("evidence",),
    "collocate": ("evidence",),
    "collocation_shares": (None, "evidence"),
    "estimate_variance": ("history_length",),
    "atrous": ("color", "variance"),
    "atrous(slopes)": ("color", "variance"),
    "atrous(prediction)": ("color", "variance", "prediction"),
    "atrous(history_length)": ("color", "variance"),
    "reconstruct": ("color",),
    "demodulate": ("color",),
    "remodulate": ("illumination",),
    "motion_vectors(position)": ("geometry",),
    "splat": ("color", "depth", "offset", "quality"),
    "pull_push": ("color", "quality"),
    "recirculate": ("filled", "reprojected_quality"),
}
each_call = each("name", CALLS)


def results(name) -> list[np.ndarray]:
    function, given = CALLS[name]
    return arrays(function(**given))


def put(name, parts, **change):
    """Call with an array for a single result, and a tuple for several."""
    function, given = CALLS[name]
    return function(**{**given, **change}, out=parts[0] if len(parts) == 1 else tuple(parts))


@each_call
def test_results_are_the_given_arrays(name):
    parts = [np.full_like(want, 7) for want in results(name)]
    got = arrays(put(name, parts))
    for part, array, want in zip(parts, got, results(name), strict=True):
        assert array is part
        assert_same_bits(part, want)


@each_call
def test_parts_may_be_left_out(name):
    wants = results(name)
    for only in range(len(wants)) if len(wants) > 1 else ():
        parts = [np.empty_like(want) if i == only else None for i, want in enumerate(wants)]
        got = arrays(put(name, parts))
        assert got[only] is parts[only]
        for array, want in zip(got, wants, strict=True):
            assert_same_bits(array, want)


@each("name", IN_PLACE)
def test_in_place(name):
    change = {argument: CALLS[name][1][argument].copy() for argument in IN_PLACE[name] if argument}
    parts = [change.get(argument) for argument in IN_PLACE[name]]
    for array, want in zip(arrays(put(name, parts, **change)), results(name), strict=True):
        assert_same_bits(array, want)


def test_lists_of_history():
    function, given = CALLS["reproject"]
    history = [given["history"], given["depth"], given["history"][..., :2].copy()]
    wants, want_coverage = function(**{**given, "history": history})
    parts, coverage = [np.empty_like(image) for image in history], np.empty_like(want_coverage)
    got, got_coverage = function(**{**given, "history": history}, out=(parts, coverage))
    assert got_coverage is coverage
    assert_same_bits(coverage, want_coverage)
    for array, part, want in zip(got, parts, wants, strict=True):
        assert array is part
        assert_same_bits(array, want)


def broken(part):
    """Unusable arrays, with the error that each raises."""
    wide = np.zeros((*part.shape[:-1], 2 * part.shape[-1]), part.dtype)
    frozen = np.zeros_like(part)
    frozen.flags.writeable = False
    return [
        (part.astype(np.float64), TypeError),
        (np.zeros(part.shape, np.int32), TypeError),
        (part.tolist(), TypeError),
        (np.zeros_like(part)[:-1], ValueError),
        (np.zeros_like(part)[None], ValueError),
        (wide[..., ::2], ValueError),
        (np.zeros_like(part)[::-1], ValueError),
        (np.zeros(part.shape, part.dtype, order="F"), ValueError),
        (frozen, ValueError),
        (np.ma.masked_array(np.zeros_like(part), True), TypeError),
    ]


@each_call
def test_unusable_arrays_are_refused_before_any_work(name):
    wants = results(name)
    for index, want in enumerate(wants):
        for wrong, error in broken(want):
            parts = [np.full_like(other, 7) for other in wants]
            parts[index] = wrong
            with pytest.raises(error, match="out"):
                put(name, parts)
            assert all((part == 7).all() for i, part in enumerate(parts) if i != index)


@each_call
def test_wrong_number_of_parts(name):
    wants = results(name)
    for parts in ([*wants, wants[0]], [wants[0]] if len(wants) > 1 else [wants[0], None]):
        with pytest.raises((TypeError, ValueError), match="out"):
            put(name, [part.copy() if part is not None else None for part in parts])


def test_nothing_is_written_when_an_argument_is_wrong():
    function, given = CALLS["atrous"]
    out = tuple(np.full_like(given[name], 7) for name in ("color", "variance"))
    for change in ({"iterations": 99}, {"depth": given["depth"][:-1]}):
        with pytest.raises(ValueError, match=next(iter(change))):
            function(**{**given, **change}, out=out)
        assert all((part == 7).all() for part in out)


def test_accumulation_in_the_callers_memory():
    """A sequence accumulated in place, frame by frame, equals the one in new arrays."""
    rng = np.random.default_rng(0)
    fresh = [np.zeros((8, 9, *channels), np.float32) for channels in ((3,), (2,), ())]
    owned = tuple(image.copy() for image in fresh)
    for _ in range(5):
        color = rng.exponential(1, (8, 9, 3)).astype(np.float32)
        result = yester.accumulate(color, *fresh)
        fresh = [result.color, result.moments, result.history_length]
        yester.accumulate(color, *owned, out=owned)
    for got, want in zip(owned, fresh, strict=True):
        assert_same_bits(got, want)


@pytest.mark.parametrize("pipeline", [yester.SVGF, yester.BMFR, yester.HalfRes, yester.TAA, yester.Upscaler])
def test_steps_write_into_an_earlier_output(pipeline):
    rng = np.random.default_rng(0)
    frames = [yester.Frame(rng.random((20, 33, 3), np.float32), depth=np.ones((20, 33), np.float32)) for _ in range(3)]
    fresh, reusing, out = pipeline(), pipeline(), None
    for frame in frames:
        want, before = fresh.step(frame), out
        out = reusing.step(frame, out=out)
        for name in ("color", "variance", "choice", "history_length", "confidence", "rejection"):
            np.testing.assert_array_equal(getattr(out, name), getattr(want, name))
            assert before is None or getattr(out, name) is getattr(before, name)
    other = yester.SVGF() if out.variance is None else yester.TAA()
    with pytest.raises(ValueError, match=r"^out: expected"):
        reusing.step(frames[0], out=other.step(frames[0]))
    wrong = pipeline().step(yester.Frame(np.ones((5, 7, 3), np.float32)))
    shapes = [re.escape(str(output.color.shape)) for output in (out, wrong)]
    with pytest.raises(ValueError, match=f"^out: expected .*{'.*'.join(shapes)}"):
        reusing.step(frames[0], out=wrong)
