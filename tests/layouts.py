"""Small EXR files as renderers lay them out: layers, components, units, spaces, signs, values for misses, headers.

    python tests/layouts.py FOLDER [FRAMES]

writes one sequence for each renderer. What they contain is the sequence of `flight`, with noise; what each renderer
stores is from its sources or measured files, as far as the tables of `yester.io.channels` say so.
"""

import json
import struct
import sys
from dataclasses import replace
from pathlib import Path

import flight
import numpy as np
import OpenEXR

WIDTH, HEIGHT = 96, 64
NAMES = {flight.GROUND: "ground", flight.BOX: "box", flight.BALL: "ball", flight.MOVER: "mover"}


def frame(index, width=WIDTH, height=HEIGHT, seed=0):
    """A noisy frame in canonical form, with motion to both sides."""
    before, now, after = (flight.scene(n, flight.camera(n, width, height)) for n in (index - 1, index, index + 1))
    exact = flight.sample(now, before)
    color = flight.noisy(exact, np.random.default_rng([seed, index]))
    color[exact.ids == 0] = 0.25, 0.5, 1  # the sky, without noise
    motion, motion_next = exact.motion[..., :2], flight.sample(now, after).motion[..., :2]
    return replace(exact, color=color, motion=motion, motion_next=motion_next)


def murmur(name):
    """MurmurHash3 (32 bits, seed 0) of a name, with an exponent that makes a finite float, as cryptomattes have it."""
    data = name.encode()
    state, padded = 0, data + bytes(-len(data) % 4)
    for i, (word,) in enumerate(struct.iter_unpack("<I", padded)):
        word = word * 0xCC9E2D51 & 0xFFFFFFFF
        word = (word << 15 | word >> 17) * 0x1B873593 & 0xFFFFFFFF
        state ^= word
        if 4 * i + 4 <= len(data):
            state = ((state << 13 | state >> 19) * 5 + 0xE6546B64) & 0xFFFFFFFF
    state ^= len(data)
    for shift, factor in ((16, 0x85EBCA6B), (13, 0xC2B2AE35), (16, 1)):
        state = (state ^ state >> shift) * factor & 0xFFFFFFFF
    return state ^ 1 << 23 if state >> 23 & 255 in (0, 255) else state


def cryptomatte(layer, ids):
    """Channels and attributes: edges are covered by a second object, or by nothing, for less than a half."""
    hashes = np.zeros(max(NAMES) + 1, np.uint32)
    for number, name in NAMES.items():
        hashes[number] = murmur(name)
    beside = np.roll(ids, 1, 1)
    edge = beside != ids
    second = np.where(edge, beside, 0)
    cover = [np.where(ids > 0, np.where(edge, 0.6, 1), 0), np.where(edge & (beside > 0), 0.4, 0)]
    ranks = [hashes[ids], hashes[second]]
    # A later rank may be empty, and ids need not be in the order of coverage within a file.
    planes = [ranks[1].view(np.float32), cover[1], ranks[0].view(np.float32), cover[0], *[np.zeros(ids.shape)] * 4]
    names = [f"{layer}{level:02}.{component}" for level in range(2) for component in "rgba"]
    prefix = f"cryptomatte/{murmur(layer):08x}"[:19]
    manifest = {name: f"{murmur(name):08x}" for name in NAMES.values()}
    header = {"name": layer, "hash": "MurmurHash3_32", "conversion": "uint32_to_float32"}
    header["manifest"] = json.dumps(manifest)
    return dict(zip(names, planes, strict=True)), {f"{prefix}/{key}": value for key, value in header.items()}


def layers(named):
    """Channels of layers given as (H, W, C) under their names with components, such as ``"Normal.XYZ"``."""
    channels = {}
    for name, value in named.items():
        layer, dot, components = name.rpartition(".")
        for i, component in enumerate(components):
            channels[f"{layer}{dot}{component}"] = np.atleast_3d(value)[..., i]
    return channels


def to_camera(view):
    return np.asarray(view.world_to_camera, np.float64)


def store(path, channels, header, *, half=(), parts=False, window=None):
    """Write channels as float32, or as float16 if `half` has them; one part, or one for each layer."""
    kinds = {name: np.float16 if half == "all" or name in half else np.float32 for name in channels}
    with np.errstate(over="ignore"):  # what is beyond half floats becomes infinite, as in a renderer
        planes = {name: np.ascontiguousarray(plane, kinds[name]) for name, plane in channels.items()}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage} | header
    if window is not None:
        display, (x, y) = window
        height, width = next(iter(planes.values())).shape
        header["displayWindow"] = (np.array([0, 0], np.int32), np.array(display, np.int32) - 1)
        header["dataWindow"] = (np.array([x, y], np.int32), np.array([x + width - 1, y + height - 1], np.int32))
    if not parts:
        OpenEXR.File(header, planes).write(str(path))
        return
    groups = {}
    for name, plane in planes.items():
        groups.setdefault(name.rpartition(".")[0], {})[name] = plane
    shared = {name: header[name] for name in ("displayWindow", "dataWindow") if name in header}
    found = [
        OpenEXR.Part(
            dict(header) if i == 0 else {**shared, **{n: header[n] for n in ("compression", "type")}}, group, name
        )
        for i, (name, group) in enumerate(groups.items())
    ]
    OpenEXR.File(found).write(str(path))


def cycles(path, shot, *, layer="ViewLayer", new=False, denoising=True, crypto=True, parts=False, half=(), **other):
    """Blender's multilayer file of Cycles; `new` for the names of 5.0, `denoising` for the data of its denoiser."""
    z = np.where(np.isfinite(shot.depth), shot.depth, 1e10)
    emission = np.where((shot.ids == 0)[..., None], shot.color, 0)
    names = (
        ("Object Index", "Diffuse Color", "Emission", "Environment") if new else ("IndexOB", "DiffCol", "Emit", "Env")
    )
    index, diffuse, emit, environment = names
    alpha = np.ones_like(z)
    named = {
        "Combined.RGBA": np.concatenate([shot.color, alpha[..., None]], -1),
        "Depth.Z": z,
        "Vector.XYZW": np.concatenate([shot.motion * (1, -1), shot.motion_next * (-1, 1)], -1),
        "Normal.XYZ": shot.normal,
        "Position.XYZ": np.where(np.isfinite(shot.position), shot.position, 0),
        f"{index}.X": shot.ids,
        f"{diffuse}.RGB": shot.albedo,
        f"{emit}.RGB": np.zeros_like(shot.color),
        f"{environment}.RGB": emission,
        "DiffDir.RGB": shot.color,
    }
    if denoising:
        named["Noisy Image.RGBA"] = named["Combined.RGBA"]
        named["Combined.RGBA"] = named["Combined.RGBA"] * 0.5 + 0.1  # whatever the renderer's denoiser made of it
        named["Denoising Albedo.RGB"] = shot.albedo
        named["Denoising Normal.XYZ"] = shot.normal @ to_camera(shot.camera)[:3, :3].T
        named["Denoising Depth.Z"] = z
    header = {"BlenderMultiChannel": "Blender V2.55.1 and newer", "Scene": "Scene", "Camera": "Camera"}
    header |= {"Software": "Blender 5.0.0"} if new else {}
    header |= {f"cycles.{layer}.samples": "1", "File": "shot.blend", "RenderTime": "00:01.25"}
    channels = {f"{layer}.{name}": plane for name, plane in layers(named).items()}
    if crypto:
        more, attributes = cryptomatte(f"{layer}.CryptoObject", shot.ids)
        channels, header = channels | more, header | attributes
    half = [name for name in channels if name.split(".")[-2] in half]
    store(path, channels, header, parts=parts, half=half, **other)


def pbrt(path, shot, *, old=False, half=True, space="camera", **other):
    """pbrt-v4's GBufferFilm; `old` for the names of older builds."""
    matrix = to_camera(shot.camera)
    hit = (shot.ids > 0)[..., None]
    position, normal = np.where(hit, shot.position, 0), shot.normal
    if space == "camera":
        position = np.where(hit, position @ matrix[:3, :3].T + matrix[:3, 3], 0)
        normal = normal @ matrix[:3, :3].T
    named = {"RGB": shot.color, "Albedo.RGB": shot.albedo}
    for name, value in (("P", position), ("N", normal), ("Ns", normal)):
        named |= {f"{name}{c}": value[..., i] for i, c in enumerate("xyz")} if old else {f"{name}.XYZ": value}
    named |= {"Variance.RGB": shot.color, "RelativeVariance.RGB": shot.color}
    channels = {}
    for name, value in named.items():
        channels |= {name: value} if value.ndim == 2 else layers({name: value})
    channels |= {"dzdx": np.zeros_like(shot.depth), "dzdy": np.zeros_like(shot.depth)}
    channels |= {} if old else {"u": np.zeros_like(shot.depth), "v": np.zeros_like(shot.depth)}
    # From the screen, whose shorter side is from -1 to 1, as `ProjectiveCamera::InitMetadata` has it.
    size = np.array(shot.shape[::-1])
    display, corner = map(np.array, other.get("window", (size, (0, 0))))
    whole = np.diag([*(size / display), 1, 1])
    whole[:2, 3] = ((2 * corner + size) / display - 1) * [1, -1]
    screen = np.diag([*(display / display.min()), 1, 1]) @ whole @ shot.camera.world_to_clip
    ndc = np.array([[0.5, 0, 0, 0.5], [0, 0.5, 0, 0.5], [0, 0, 0.5, 0.5], [0, 0, 0, 1]]) @ screen
    # Matrices for column vectors, where Imath has those for row vectors.
    header = {"worldToCamera": matrix.astype(np.float32), "worldToNDC": ndc.astype(np.float32)}
    header |= {"renderTimeSeconds": 1.5, "samplesPerPixel": 1}
    store(path, channels, header, half="all" if half else (), **other)


def arnold(path, shot, **other):
    """Arnold's EXR driver with its standard AOVs in one file."""
    crypto, attributes = cryptomatte("crypto_object", shot.ids)
    named = {
        "RGBA": np.concatenate([shot.color, np.ones_like(shot.depth)[..., None]], -1),
        "Z": np.where(np.isfinite(shot.depth), shot.depth, 1e30),
        "N.XYZ": shot.normal,
        "P.XYZ": np.where(np.isfinite(shot.position), shot.position, 0),
        "diffuse_albedo.RGB": shot.albedo,
        "motionvector.RG": shot.motion,
    }
    store(
        path,
        layers(named) | {name: plane for name, plane in crypto.items()},
        {"arnold/version": "7.4"} | attributes,
        **other,
    )


def renderman(path, shot, **other):
    """RenderMan's layers for its denoiser."""
    named = {
        "Ci.rgb": shot.color,
        "albedo.rgb": shot.albedo,
        "normal.rgb": shot.normal,
        "normal_var.rgb": shot.normal,
        "mse.rgb": shot.color,
        "forward.rg": -shot.motion_next,
        "backward.rg": shot.motion,
    }
    channels = layers(named) | {"zfiltered": np.where(np.isfinite(shot.depth), shot.depth, 1e30)}
    store(path, channels | {"sampleCount": np.ones_like(shot.depth)}, {}, **other)


def falcor(path, shot, **other):
    """Falcor's G-buffer, its images gathered as layers: motion in fractions of the image."""
    height, width = shot.shape
    named = {
        "RGB": shot.color,
        "mvec.XY": shot.motion / (width, height),
        "posW.XYZ": np.where(np.isfinite(shot.position), shot.position, 0),
        "normW.XYZ": shot.normal,
    }
    store(path, layers(named), {}, **other)


RENDERERS = {"cycles": cycles, "pbrt": pbrt, "arnold": arnold, "renderman": renderman, "falcor": falcor}


def write(folder, frames=8, width=WIDTH, height=HEIGHT):
    """A sequence for each renderer, in a folder of its name."""
    for name, make in RENDERERS.items():
        (Path(folder) / name).mkdir(parents=True, exist_ok=True)
        for index in range(frames):
            make(Path(folder) / name / f"shot.{index + 1}.exr", frame(index, width, height))


if __name__ == "__main__":
    write(sys.argv[1], *map(int, sys.argv[2:]))
