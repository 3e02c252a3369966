"""Damaged EXR files: each gives a result or an error that names the file, and no process dies."""

import struct
import sys
import threading
import time

import fuzz_exr
import numpy as np
import pytest
from yester import io
from yester.io import layout
from yester.io.stdout import kept_output


def put(name, *numbers, kind="i", at=0):
    """Damage that writes numbers into the value of an attribute."""

    def damage(data):
        (header, *_), _ = layout.headers(bytes(data))
        struct.pack_into(f"<{len(numbers)}{kind}", data, header[name].start + at, *numbers)

    return damage


def size(name, value):
    def damage(data):
        (header, *_), _ = layout.headers(bytes(data))
        struct.pack_into("<i", data, header[name].start - 4, value)

    return damage


def replaced(old, new):
    def damage(data):
        assert old in data
        data[:] = data.replace(old, new)

    return damage


def offset(value, index=0):
    def damage(data):
        _, table = layout.headers(bytes(data))
        struct.pack_into("<Q", data, table + 8 * index, value)

    return damage


def chunk(value, at):
    """Damage to a number of the first chunk."""

    def damage(data):
        _, table = layout.headers(bytes(data))
        (first,) = struct.unpack_from("<Q", data, table)
        struct.pack_into("<i", data, first + at, value)

    return damage


def cut(count):
    def damage(data):
        del data[count:]

    return damage


def many_channels(data):
    """Damage: five thousand channels instead of a few, with offsets that still point to the chunks."""
    (header, *_), table = layout.headers(bytes(data))
    (first,) = struct.unpack_from("<Q", data, table)
    new = b"".join(b"c%d\0" % i + struct.pack("<4i", 2, 0, 1, 1) for i in range(5000))
    for at in range(table, first, 8):
        struct.pack_into("<Q", data, at, struct.unpack_from("<Q", data, at)[0] + len(new))
    start = header["channels"].start
    struct.pack_into("<i", data, start - 4, header["channels"].size + len(new))
    data[start:start] = new


MOST = 2**31 - 1
DAMAGES = {
    "offset beyond 63 bits": ("ZIP", offset(2**64 - 1), "pixels are missing"),
    "offset beyond 31 bits": ("NO", offset(2**40, 17), "pixels are missing"),
    "offset into the header": ("ZIP", offset(12), "pixels are missing"),
    "offset zero": ("ZIP", offset(0), "pixels are missing"),
    "offset of another chunk": ("NO", lambda data: offset(len(data) - 300, 3)(data), "."),
    "offset in a part": ("parts", offset(2**63), "pixels are missing"),
    "offset in a tiled file": ("ZIP tiled", offset(2**62, 2), "pixels are missing"),
    "chunk's size": ("ZIP", chunk(MOST, 4), "pixels are missing"),
    "chunk's negative size": ("ZIP", chunk(-8, 4), "pixels are missing"),
    "chunk's row": ("ZIP", chunk(-5, 0), "."),
    "tile's level": ("ZIP tiled", chunk(9, 8), "."),
    "chunk count": ("parts", put("chunkCount", MOST), "truncated or corrupt"),
    "negative chunk count": ("parts", put("chunkCount", -1), "pixels are missing"),
    "huge window": ("ZIP", put("dataWindow", 0, 0, 2**20, 2**20), "dataWindow: no image has corners"),
    "high window": ("ZIP", put("dataWindow", 0, 0, 19, 2**29), "."),
    "wide window": ("ZIP", put("dataWindow", 0, 0, 2**26, 17), "."),
    "negative window": ("ZIP", put("dataWindow", 0, 0, -5, -5), "dataWindow"),
    "window that overflows": ("ZIP", put("dataWindow", -(2**31), 0, MOST, 17), "dataWindow"),
    "negative display window": ("ZIP", put("displayWindow", 5, 5, -5, -5), "displayWindow"),
    "huge tiles": ("ZIP tiled", put("tiles", 8, 2**24), "tiles"),
    "no tiles": ("ZIP tiled", put("tiles", 0, 0), "tiles"),
    "tiles in all 32 bits": ("ZIP tiled", put("tiles", -1, -1), "tiles"),
    "attribute's size": ("ZIP", size("dataWindow", MOST), "dataWindow"),
    "attribute's negative size": ("ZIP", size("channels", -4), "channels"),
    "short window": ("ZIP", size("dataWindow", 12), "truncated or corrupt"),
    "type of sample": ("ZIP", put("channels", 77, at=2), "type of sample"),
    "five thousand channels": ("ZIP", many_channels, "truncated or corrupt"),
    "subsampled": ("ZIP", put("channels", 2, 2, at=10), "subsampled, 2 x 2"),
    "subsampled by 0": ("ZIP", put("channels", 0, 0, at=10), "subsampled, 0 x 0"),
    "unending channels": ("ZIP", size("channels", 900), "truncated or corrupt"),
    "name that is no text": ("ZIP", replaced(b"ids.I\0", b"ids.\xb8\0"), "."),
    "type that is no text": ("ZIP", replaced(b"box2i\0", b"bo\n2i\0"), "dataWindow|displayWindow"),
    "no compression": ("ZIP", replaced(b"compression\0compression\0", b"compressioN\0compression\0"), "compression"),
    "unknown compression": ("ZIP", put("compression", 99, kind="B"), "unknown compression 99"),
    "another compression": ("ZIP", put("compression", 9, kind="B"), "."),
    "camera of another type": ("ours", replaced(b"worldToNDC\0m44f\0", b"worldToNDC\0m55f\0"), "worldToNDC"),
    "jitter of another type": ("ours", replaced(b"jitter\0v2d\0", b"jitter\0v9d\0"), "jitter"),
    "camera of signalling NaN": ("ours", put("worldToNDC", 0x7F800001), "worldToNDC"),
    "aspect": ("ZIP", put("pixelAspectRatio", np.nan, kind="f"), "pixelAspectRatio"),
    "deep": ("deep", lambda data: None, "a deep image, which cannot be read"),
    "flags": ("ZIP", lambda data: data.__setitem__(6, 0x7F), "unknown version or flags"),
    "version": ("ZIP", lambda data: data.__setitem__(4, 9), "unknown version or flags"),
    "magic alone": ("ZIP", cut(4), "the header ends early"),
    "half a header": ("ZIP", cut(150), "truncated or corrupt"),
    "half a table": ("ZIP", lambda data: cut(layout.headers(bytes(data))[1] + 12)(data), "pixels are missing"),
    "no table": ("ZIP", lambda data: cut(layout.headers(bytes(data))[1])(data), "truncated or corrupt"),
}


def the_same_chunk(data):
    """All offsets of the first part are that of its largest chunk: a copy of them would be larger than the file."""
    _, table = layout.headers(bytes(data))
    places = [struct.unpack_from("<Q", data, table + 8 * i)[0] for i in range(2)]
    largest = max(places, key=lambda place: struct.unpack_from("<i", data, place + 8)[0])
    for i in range(2):
        struct.pack_into("<Q", data, table + 8 * i, largest)


DAMAGES["offsets of one chunk"] = ("more parts", the_same_chunk, ".")


#: Numbers of mutations that once ended in a traceback. What else did is in `DAMAGES`.
FOUND = (9_000_230, 20_013_370)


@pytest.mark.parametrize("name", DAMAGES)
def test_damaged(tmp_path, name):
    sample, damage, complaint = DAMAGES[name]
    data = bytearray(fuzz_exr.samples()[sample])
    damage(data)
    path = tmp_path / "a.exr"
    path.write_bytes(data)
    with pytest.raises(ValueError, match=rf"a\.exr: .*({complaint})"):
        io.read_exr(path)
    assert fuzz_exr.fault(path) == ""


def test_views_of_another_type_are_none(tmp_path):
    data = bytearray(fuzz_exr.samples()["cycles"])
    replaced(b"multiView\0stringvector\0", b"multiView\0sAringvector\0")(data)
    path = tmp_path / "a.exr"
    path.write_bytes(data)
    assert io.describe(path).views == ()
    assert io.read_exr(path).shape == (18, 20)
    assert fuzz_exr.fault(path) == ""


def test_mutated():
    """The first mutations: `python tests/fuzz_exr.py 100000` read all of them without a fault."""
    assert fuzz_exr.main(2000) == 0


@pytest.mark.parametrize("number", FOUND)
def test_mutations_that_were_faults(tmp_path, number):
    path = tmp_path / "a.exr"
    path.write_bytes(fuzz_exr.mutated(number))
    assert fuzz_exr.fault(path) == ""


def test_the_fuzzer_reports_faults(monkeypatch, capfd):
    """An exception, a process that dies, and one that hangs."""
    broken = """
import ctypes, sys, time
sys.path[:] = {path!r}
import fuzz_exr
first, last = map(int, sys.argv[2:])
def fault(path, numbers=iter(range(first, last))):
    number = next(numbers)
    if number == 2:
        ctypes.string_at(0)
    if number == 4:
        time.sleep(60)
    return "a fault" if number == 1 else ""
fuzz_exr.fault = fault
fuzz_exr.work(first, last)
"""
    monkeypatch.setattr(fuzz_exr, "PATIENCE", 1)
    monkeypatch.setattr(fuzz_exr, "COMMAND", (sys.executable, "-c", broken.format(path=sys.path)))
    assert fuzz_exr.main(6) == 3
    said = capfd.readouterr().out.splitlines()
    assert said == ["1: a fault", "2: the process ends with -11", "4: hangs", "6 files, 3 at fault"]


# Standard output


def test_a_part_that_cannot_be_decoded(tmp_path, capfd):
    """OpenEXR prints the reason; Yester raises it, and nothing is printed."""
    path = tmp_path / "a.exr"
    io.write_exr(path, np.ones((24, 32, 3)))
    path.write_bytes(path.read_bytes()[:-16] + bytes(16))
    with pytest.raises(ValueError, match=r"a\.exr: truncated or corrupt: .*part 0"):
        io.read_exr(path)
    assert capfd.readouterr().out == ""


def test_other_threads_print_while_one_reads(tmp_path, capsys):
    """All their output appears, and standard output is restored afterwards."""
    path = tmp_path / "a.exr"
    io.write_exr(path, np.random.default_rng(0).random((300, 400, 3)))
    before, count = sys.stdout, 0

    def read():
        for _ in range(20):
            io.read_exr(path)

    readers = [threading.Thread(target=read) for _ in range(3)]
    for reader in readers:
        reader.start()
    while any(reader.is_alive() for reader in readers):
        print("line", count)
        count += 1
        time.sleep(1e-4)
    assert sys.stdout is before
    assert capsys.readouterr().out.splitlines() == [f"line {i}" for i in range(count)]


def test_kept_output(capsys):
    """Captures the output of this thread, also when nested, and not that of other threads."""
    with kept_output() as outer:
        print("a")
        with kept_output() as inner:
            print("b")
        other = threading.Thread(target=print, args=("c",))
        other.start()
        other.join()
        print("d")
    print("e")
    assert ("".join(outer), "".join(inner), capsys.readouterr().out) == ("a\nd\n", "b\n", "c\ne\n")


@pytest.mark.filterwarnings("ignore:worldToNDC. not used")  # positions are noise
@pytest.mark.parametrize("name", sorted(fuzz_exr.samples().keys() - {"deep"}))
def test_undamaged_parts_are_read(tmp_path, name):
    (tmp_path / "a.exr").write_bytes(fuzz_exr.samples()[name])
    assert io.read_exr(tmp_path / "a.exr").shape == (18, 20)
