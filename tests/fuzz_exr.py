"""Mutated EXR files: each must give a result or a clear error, and no process may die.

    python tests/fuzz_exr.py COUNT [FIRST]

A mutation is a function of its number. A worker process takes numbers from FIRST on, and is restarted when it dies or
hangs. Prints the numbers of the files that failed and exits with their count.
"""

import os
import random
import resource
import select
import struct
import subprocess
import sys
import tempfile
import warnings
from functools import cache
from pathlib import Path

import numpy as np
import OpenEXR
from yester import Camera, Frame, io
from yester.io import layout

#: Seconds after which reading counts as a hang, and the limit of address space in bytes.
PATIENCE, MEMORY = 20.0, 4 << 30
COMMAND = (sys.executable, __file__)
INTERESTING = (0, 1, -1, 2, 3, 7, 255, 256, 65535, 2**24, 2**30, 2**31 - 1, -(2**31), -(2**31) + 1, 0x7F800000)
TYPES = (b"box2i", b"float", b"int", b"string", b"chlist", b"m44f", b"v2d", b"preview", b"timecode", b"stringvector")
LAYERS = {"Combined": "RGBA", "Depth": "Z", "Vector": "XYZW", "Normal": "XYZ", "CryptoObject00": "rgba"}
COMPRESSIONS = ("NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB", "HTJ2K256", "HTJ2K32")


@cache
def samples() -> dict[str, bytes]:
    """Small valid files of every kind that OpenEXR's Python module writes."""
    rng = np.random.default_rng(0)

    def planes(height, width, kind=np.float32, names="RGB"):
        return {name: (rng.random((height, width)) * 9).astype(kind) for name in names}

    camera = Camera.from_look_at((0, 1, 5), (0, 0, 0), (0, 1, 0), 40, 20, 18)
    color = rng.random((18, 20, 3))
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.exr"

        def keep(name, header=None, channels=None, parts=None):
            (OpenEXR.File(parts) if parts else OpenEXR.File(header, channels)).write(str(path))
            found[name] = path.read_bytes()

        io.write_exr(path, Frame(color, depth=color[..., 0], ids=np.ones((18, 20), int), camera=camera, jitter=(0, 0)))
        found["ours"] = path.read_bytes()
        for name in COMPRESSIONS:
            header = {"compression": getattr(OpenEXR, f"{name}_COMPRESSION"), "type": OpenEXR.scanlineimage}
            kind = np.float16 if name[0] in "BDH" else np.float32
            keep(name, header, planes(18, 20, kind) | planes(18, 20, np.uint32, ["ids.I"]))
            window = (np.array([-3, 5], np.int32), np.array([16, 22], np.int32))
            tiles = {"type": OpenEXR.tiledimage, "tiles": OpenEXR.TileDescription(), "dataWindow": window}
            tiles["tiles"].xSize = tiles["tiles"].ySize = 8
            keep(f"{name} tiled", header | tiles, planes(18, 20, kind))
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        more = {"comments": "a comment", "owner": "somebody"}
        parts = [OpenEXR.Part(header | more, planes(18, 20), "beauty")]
        parts += [OpenEXR.Part(dict(header), planes(18, 20, names=["depth.Z"]), "depth")]
        keep("parts", parts=parts)
        # Parts that are not needed are not decoded.
        parts.insert(1, OpenEXR.Part(dict(header), planes(18, 20, names=["other.A", "other.B"]), "other"))
        keep("more parts", parts=parts)
        crypto = {f"cryptomatte/abcdef0/{name}": "ViewLayer.CryptoObject" for name in ("name", "manifest")}
        layers = {f"ViewLayer.{name}.{c}": planes(18, 20, names=c)[c] for name, of in LAYERS.items() for c in of}
        views = {f"ViewLayer.Combined.right.{c}": planes(18, 20, names=c)[c] for c in "RGB"}
        marks = {"BlenderMultiChannel": "Blender V2.55.1 and newer", "multiView": ["left", "right"]}
        keep("cycles", header | crypto | marks, layers | views)
        matrices = {"worldToCamera": camera.world_to_camera, "worldToNDC": camera.world_to_clip}
        matrices = {name: np.asarray(matrix, np.float32) for name, matrix in matrices.items()}
        geometry = {f"{name}.{c}": planes(18, 20, np.float16, c)[c] for name in ("P", "Ns") for c in "XYZ"}
        keep("pbrt", header | matrices | {"renderTimeSeconds": 1.0}, planes(18, 20, np.float16) | geometry)
        deep = np.empty((3, 4), object)
        for place in np.ndindex(3, 4):
            deep[place] = np.ones(1 + place[0], np.float32)
        deep_header = {"compression": OpenEXR.ZIPS_COMPRESSION, "type": OpenEXR.deepscanline}
        keep("deep", deep_header, dict.fromkeys("RGB", deep))
    return found


def mutated(number: int) -> bytes:
    """The mutated file of this number: mostly the header or a table is damaged, at times the pixels."""
    chance = random.Random(number)
    name = chance.choice(list(samples()))
    data = bytearray(samples()[name])
    for _ in range(chance.choice((1, 1, 1, 2, 3, 6))):
        try:
            parts, tables = layout.headers(bytes(data))
        except (ValueError, IndexError, struct.error):
            parts, tables = [], min(400, len(data))
        attributes = [attribute for header in parts for attribute in header.values()]
        chance.choice((_flip, _flip_header, _table, _cut, _number, _number, _number, _value, _size, _kind, _splice))(
            chance, data, attributes, tables
        )
    return bytes(data)


def _put(data: bytearray, at: int, new: bytes) -> None:
    data[at : at + len(new)] = new[: max(len(data) - at, 0)]


def _word(chance: random.Random) -> int:
    return chance.choice(INTERESTING) if chance.random() < 0.8 else chance.randint(-(2**31), 2**31 - 1)


def _flip(chance, data, _attributes, _tables):
    if data:
        data[chance.randrange(len(data))] = chance.randrange(256)


def _flip_header(chance, data, _attributes, tables):
    if data:
        data[chance.randrange(min(tables, len(data)))] = chance.randrange(256)


def _table(chance, data, _attributes, tables):
    """Damage an offset or, after the table, the beginning of a chunk."""
    at = tables + 4 * chance.randrange(24)
    new = chance.choice((struct.pack("<Q", chance.getrandbits(64)), struct.pack("<Q", chance.randrange(len(data) + 1))))
    _put(data, at, chance.choice((new, struct.pack("<i", _word(chance)))))


def _cut(chance, data, _attributes, _tables):
    del data[chance.randrange(len(data) + 1) :]


def _number(chance, data, attributes, _tables):
    """Damage a number in the value of an attribute."""
    if attributes:
        attribute = chance.choice(attributes)
        at = attribute.start + 4 * chance.randrange(max(attribute.size // 4, 1))
        _put(data, at, struct.pack("<i", _word(chance))[: max(attribute.size, 1)])


def _value(chance, data, attributes, _tables):
    """Damage a whole value."""
    if attributes:
        attribute = chance.choice(attributes)
        _put(data, attribute.start, chance.choice((bytes, chance.randbytes, lambda n: b"\xff" * n))(attribute.size))


def _size(chance, data, attributes, _tables):
    if attributes:
        attribute = chance.choice(attributes)
        size = chance.choice((_word(chance), attribute.size + chance.randint(-4, 4))) & 0xFFFFFFFF
        _put(data, attribute.start - 4, struct.pack("<I", size))


def _kind(chance, data, attributes, _tables):
    """Damage the type of an attribute, or remove or duplicate the attribute."""
    if attributes:
        attribute = chance.choice(attributes)
        kind = attribute.start - 4 - len(attribute.type) - 1
        end = attribute.start + attribute.size
        begin = data.rfind(b"\0", 0, kind - 1) + 1
        how = chance.randrange(3)
        if how == 0:
            data[kind : attribute.start - 5] = chance.choice(TYPES)
        elif how == 1:
            del data[begin:end]
        else:
            data[begin:begin] = data[begin:end]


def _splice(chance, data, _attributes, _tables):
    """Join the beginning of this file and the end of another."""
    other = samples()[chance.choice(list(samples()))]
    at = chance.randrange(min(len(other), len(data) + 1))
    data[at:] = other[at:]


def rewrite(path: Path) -> None:
    """Replace the colour of a file."""
    plate = io.read_plate(path)
    io.write_exr(path, plate.frame.color, like=plate)


def fault(path: Path) -> str:
    """The fault in reading a file; empty if there is a result or a clear error."""
    for read in (io.describe, io.read_exr, rewrite):
        try:
            read(path)
        except (OSError, ValueError) as error:
            if str(path) not in str(error) or "\n" in str(error):
                return f"{read.__name__}: an error that does not name the file in one line: {error!r}"
        except Exception as error:
            return f"{read.__name__}: {error!r}"
    return ""


def main(count: int, first: int = 0) -> int:
    """Read that many mutations; returns the number of faults."""
    faults, at = 0, first
    samples()  # fails here rather than in every worker
    while at < first + count:
        command = [*COMMAND, "work", str(at), str(first + count)]
        with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE) as worker:
            begun, rest = None, b""
            while True:
                ready = select.select([worker.stdout], [], [], PATIENCE if begun is not None else 120)[0]
                new = os.read(worker.stdout.fileno(), 1 << 16) if ready else b""
                if not new:
                    break
                *lines, rest = (rest + new).split(b"\n")
                for line in lines:
                    at, _, said = line.decode().partition(" ")
                    begun, at = int(at), int(at) + 1
                    if said:
                        faults += 1
                        print(f"{begun}: {said}", flush=True)
            hung = ready == []
            if hung:
                worker.kill()
            code = worker.wait()
        if at < first + count:  # the number whose result is missing
            faults += 1
            print(f"{at}: {'hangs' if hung else f'the process ends with {code}'}", flush=True)
            at += 1
    print(f"{count} files, {faults} at fault")
    return faults


def work(first: int, last: int) -> None:
    """The worker process: read files and report each on the original standard output."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    tell = os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    os.dup2(1, 2)
    warnings.simplefilter("error")
    # Damaged matrices and positions do not fit each other.
    warnings.filterwarnings("ignore", "worldToNDC: not used", UserWarning)
    warnings.filterwarnings("ignore", "depth: not used", UserWarning)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.exr"
        for number in range(first, last):
            path.write_bytes(mutated(number))
            print(number, fault(path), file=tell, flush=True)


if __name__ == "__main__":
    if sys.argv[1] == "work":
        work(*map(int, sys.argv[2:]))
    else:
        sys.exit(min(main(*map(int, sys.argv[1:])), 255))
