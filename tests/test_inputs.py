"""Accepted and refused inputs of the array functions: one valid call each, varied in one argument."""

import re

import numpy as np
import pytest
import torch
import yester
from calls import arrays, calls
from compare import assert_same_bits, each

CALLS = calls()
IMAGES = [
    (name, argument)
    for name, (_, given) in CALLS.items()
    for argument, value in given.items()
    if isinstance(value, np.ndarray)
]
# Images that may have any number of channels.
ANY = {
    ("reproject", "history"),
    ("splat", "color"),
    ("pull_push", "color"),
    ("resample", "image"),
    ("choice", "evidence"),
}
each_call = each("name", CALLS)
each_image = each(("name", "argument"), IMAGES)


def call(name, **change):
    function, given = CALLS[name]
    return function(**{**given, **change})


def refused(name, error, match, **change):
    with pytest.raises(error, match=match) as caught:
        call(name, **change)
    return str(caught.value)


def strided(a):
    wide = np.zeros((a.shape[0] * 2, a.shape[1] * 3, *a.shape[2:]), a.dtype)
    wide[::2, ::3] = a
    return wide[::2, ::3]


def read_only(a):
    a = a.copy()
    a.flags.writeable = False
    return a


LAYOUTS = {
    "fortran": np.asfortranarray,
    "upside down": lambda a: a[::-1, ::-1].copy()[::-1, ::-1],
    "strided": strided,
    "read-only": read_only,
    "big-endian": lambda a: a.astype(a.dtype.newbyteorder(">")),
    "torch": lambda a: torch.from_numpy(a.copy()) if a.dtype.kind == "f" else a,
    "torch transposed": lambda a: torch.from_numpy(np.asfortranarray(a)) if a.dtype.kind == "f" else a,
    "float64": lambda a: a.astype(np.float64) if a.dtype.kind == "f" else a,
}


@each_call
@each("layout", LAYOUTS)
def test_layouts_are_one(name, layout):
    _, given = CALLS[name]
    converted = {k: LAYOUTS[layout](v) if isinstance(v, np.ndarray) else v for k, v in given.items()}
    for got, want in zip(arrays(call(name, **converted)), arrays(call(name)), strict=True):
        assert_same_bits(got, want)


@each_call
def test_half_precision_is_its_value_in_single(name):
    _, given = CALLS[name]
    floats = {k: v for k, v in given.items() if isinstance(v, np.ndarray) and v.dtype == np.float32}
    halves = {k: np.clip(v, -6e4, 6e4).astype(np.float16) for k, v in floats.items()}
    singles = {k: v.astype(np.float32) for k, v in halves.items()}
    for got, want in zip(arrays(call(name, **halves)), arrays(call(name, **singles)), strict=True):
        assert_same_bits(got, want)


@each_call
def test_results_are_new_float32(name):
    _, given = CALLS[name]
    before = {k: v.copy() for k, v in given.items() if isinstance(v, np.ndarray)}
    for got in arrays(call(name)):
        assert got.dtype in (np.float32, np.uint8, np.uint32, bool)
        assert got.flags.c_contiguous
        assert got.flags.writeable
        assert not any(np.shares_memory(got, given[k]) for k in before)
    for k, v in before.items():
        np.testing.assert_array_equal(given[k], v)


@each_image
@each("dtype", [bool, np.complex64, object, "U3", "M8[s]"])
def test_wrong_kind_of_elements(name, argument, dtype):
    if argument == "where" and dtype is bool:
        dtype = np.int8
    value = np.zeros(CALLS[name][1][argument].shape).astype(dtype)
    refused(name, TypeError, argument, **{argument: value})


@each_image
def test_integers_are_not_floats_nor_floats_integers(name, argument):
    value = CALLS[name][1][argument]
    other = np.ones(value.shape, np.float32 if argument.endswith("ids") else np.int32)
    refused(name, TypeError, argument, **{argument: other})


@each_image
def test_wrong_shapes(name, argument):
    value = CALLS[name][1][argument]
    wrong = [value[None], value[:0], value[:, :0], np.zeros((), value.dtype)]
    if argument != "image":  # one channel or several
        wrong.append(value[0])
    if value.ndim == 3 and (name.split("(")[0], argument) not in ANY:
        wrong += [np.concatenate([value, value], -1), value[..., :1], value[..., :0]]
    for array in wrong:
        # A position with one axis less is taken for a depth, whose size differs from the camera's.
        refused(name, ValueError, "geometry|camera" if argument == "geometry" else argument, **{argument: array})


@each_image
def test_sizes_must_agree(name, argument):
    """One image of another size: the message names it, or the one that it does not fit."""
    given = CALLS[name][1]
    # Beside evidence alone, an image may be a pixel smaller without a tile less.
    alone = (name, argument) == ("collocate", "planes")
    if sum(isinstance(v, np.ndarray) for v in given.values()) > 1 and not alone:
        for cut in (np.s_[:-1], np.s_[:, :-1]):
            message = refused(name, ValueError, "expected", **{argument: given[argument][cut]})
            assert any(other in message for other in given)


@each_call
@each("cut", [np.s_[:0], np.s_[:, :0]])
def test_empty(name, cut):
    given = CALLS[name][1]
    images = {k: v[cut] for k, v in given.items() if isinstance(v, np.ndarray)}
    if name == "resolve":
        images["samples"] = [image[cut] for image in given["samples"]]
    message = refused(name, ValueError, "expected", **images)
    assert any(argument in message for argument in given)


@each_image
def test_masks_would_be_ignored(name, argument):
    value = np.ma.masked_equal(CALLS[name][1][argument], 0)
    refused(name, TypeError, f"^{argument}: expected an array without a mask", **{argument: value})


@each_image
def test_not_arrays(name, argument):
    for value in ("text", object(), {"a": 1}):
        refused(name, TypeError, argument, **{argument: value})


@each_call
@each("argument", ["camera", "previous_camera"])
def test_cameras(name, argument):
    given = CALLS[name][1]
    if argument in given:
        refused(name, TypeError, argument, **{argument: np.eye(4)})
    if argument in given and argument == "camera":
        other = yester.Camera(given[argument].world_to_clip, given[argument].width + 1, given[argument].height)
        refused(name, ValueError, argument, **{argument: other})


def test_channels_first_motion_is_explained():
    """The most common mistake: the message names the argument, the expected shape and the actual one."""
    motion = np.zeros((2, 6, 9), np.float32)
    for name in ("reproject", "consistency"):
        function, given = CALLS[name]
        change = {k: v for k, v in given.items() if k == "history"}
        with pytest.raises(ValueError, match="motion") as error:
            function(**change, motion=motion)
        assert "(2, 6, 9)" in str(error.value)
        assert "(H, W, 2)" in str(error.value)


ADVICE = {
    "channels first": (lambda c: np.moveaxis(c, -1, 0), ValueError, "numpy.moveaxis(x, 0, -1)"),
    "alpha": (lambda c: np.concatenate([c, c[..., :1]], -1), ValueError, "x[..., :3]"),
    "alpha first": (lambda c: np.moveaxis(np.concatenate([c, c[..., :1]], -1), -1, 0), ValueError, "moveaxis(x[:3],"),
    "gradients": (lambda c: torch.from_numpy(c).requires_grad_(), TypeError, "x.detach()"),
    "bfloat16": (lambda c: torch.from_numpy(c).bfloat16(), TypeError, "x.float()"),
    "8 bits": (lambda c: c.astype(np.uint8), TypeError, "(x / 255) ** 2.2"),
    "16 bits": (lambda c: c.astype(np.uint16), TypeError, "(x / 65535) ** 2.2"),
}


@pytest.mark.parametrize("mistake", ADVICE)
def test_common_mistakes_are_explained(mistake):
    """Kernels and frames give the same one-sentence advice."""
    change, error, advice = ADVICE[mistake]
    color = np.ones((6, 9, 3), np.float32)
    for function in (yester.suppress_fireflies, yester.Frame):
        with pytest.raises(error, match="^color: expected .*" + re.escape(advice)):
            function(change(color))


def test_a_channel_axis_too_many_is_explained():
    color, depth = np.ones((6, 9, 3), np.float32), np.ones((6, 9), np.float32)
    for wrong, advice in ((depth[None], "x[0]"), (depth[..., None], "x[..., 0]")):
        with pytest.raises(ValueError, match="^depth: expected .*" + re.escape(advice)):
            yester.Frame(color, depth=wrong)
    with pytest.raises(ValueError, match=r"^history: expected .*moveaxis\(x, 0, -1\)"):
        yester.reproject(np.ones((3, 6, 9), np.float32), np.zeros((6, 9, 2), np.float32))
    # Blender's vectors to the next frame are no change of depth.
    with pytest.raises(ValueError, match=r"^motion: expected .*to the previous frame: x\[\.\.\., :2\]"):
        yester.Frame(color, motion=np.zeros((6, 9, 4), np.float32))


@pytest.mark.parametrize("pair", ["depth", "normal", "ids"])
@pytest.mark.parametrize("name", ["reproject", "consistency"])
def test_unpaired_buffers(name, pair):
    for absent, present in ((pair, f"previous_{pair}"), (f"previous_{pair}", pair)):
        given = {k: v for k, v in CALLS[name][1].items() if k in ("history", "motion", present)}
        with pytest.raises(ValueError, match=rf"\b{absent}\b"):
            CALLS[name][0](**given)


@pytest.mark.parametrize("name", ["reproject", "consistency"])
def test_the_plane_test_needs_its_buffers(name):
    function, given = CALLS[name]
    for absent in ("depth", "normal"):
        kept = {k: v for k, v in given.items() if k not in (absent, f"previous_{absent}")}
        with pytest.raises(ValueError, match=absent):
            function(**kept)
    with pytest.raises(ValueError, match="motion"):
        function(**{**given, "motion": given["motion"][..., :2].copy()})


def test_transforms():
    function, given = CALLS["motion_vectors(depth)"]
    for wrong in ({1: np.eye(3)}, {1: np.full((4, 4), np.nan)}):
        with pytest.raises(ValueError, match="transforms"):
            function(**{**given, "transforms": wrong})
    with pytest.raises(ValueError, match="ids"):
        function(**{**given, "ids": None})


def test_no_history():
    motion = CALLS["reproject"][1]["motion"]
    for history in ([], ()):
        with pytest.raises(ValueError, match="history"):
            yester.reproject(history, motion)


SURFACE = {"relative_depth": [0, -1, np.nan], "plane_distance": [0, -1, np.nan], "normal_angle": [-1, 181, np.nan]}
SURFACE |= {"motion_difference": [-1, np.nan, (2, 1)]}
SIGMAS = {"sigma_normal": [-1, np.nan], "sigma_depth": [0, -1, np.nan], "sigma_plane": [0, -1, np.nan]}
RANGES = {
    "reproject": {**SURFACE, "filter": ["", "Bilinear", "cubic"]},
    "consistency": SURFACE,
    "accumulate": {"alpha": [-0.1, 1.1, np.nan], "moments_alpha": [-0.1, 1.1, np.nan]},
    "estimate_variance": {**SIGMAS, "min_length": [-1, np.nan], "radius": [-1]},
    "regress": {"block": [3, 257, -1], "features": ["", "All"]},
    "atrous": {
        **SIGMAS,
        "sigma_luminance": [0, -1, np.nan],
        "relative_noise": [0, -1, np.nan],
        "tap_exposure": [0, -1, np.nan],
        "settled": [-1, np.nan, np.inf],
        "iterations": [-1, 17],
        "radius": [0, 3],
    },
}


@each(
    ("name", "argument", "value"), [(n, a, v) for n, ranges in RANGES.items() for a, vs in ranges.items() for v in vs]
)
def test_out_of_range(name, argument, value):
    refused(name, ValueError, argument, **{argument: value})


@each(("name", "argument"), [(n, a) for n, ranges in RANGES.items() for a in ranges])
def test_parameters_of_another_type(name, argument):
    refused(name, TypeError, argument, **{argument: [1, 2]})


@pytest.mark.parametrize("argument", ["alpha", "moments_alpha"])
def test_alpha_zero_is_a_running_mean_only(argument):
    call("accumulate", **{argument: 0.0})
    refused("accumulate", ValueError, argument, **{argument: 0.0, "warmup": False})


def test_unknown_arguments():
    for name in CALLS:
        with pytest.raises(TypeError, match="colour"):
            call(name, colour=1)
