"""The documentation: examples run, commands parse, links lead somewhere, and no public name is missing."""

import re
import shlex
import types
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import yester
import yester.io
import yester.io.mitsuba
import yester.judge
import yester.live
import yester.metrics
from yester import cli

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
REPOSITORY = "https://github.com/yester-dev/yester"
#: Pages that are kept; the others are copied from elsewhere in the repository when the documentation is built.
PAGES = sorted(path for path in DOCS.rglob("*.md") if "copied" not in path.parts)
TEXTS = [*PAGES, *sorted(DOCS.rglob("*.rst")), *sorted(ROOT.glob("*.md"))]


def named(path):
    return path.relative_to(ROOT).as_posix()


def blocks(path, language):
    """The code blocks of a page."""
    return re.findall(rf"^```{language}\n(.*?)^```$", path.read_text("utf-8"), re.DOTALL | re.MULTILINE)


def run(path):
    """Run all Python of a page, in order and in one namespace."""
    namespace = {"__name__": "__main__"}
    for number, block in enumerate(blocks(path, "python"), 1):
        exec(compile(block, f"{named(path)}, block {number}", "exec"), namespace)
    return namespace


@pytest.mark.parametrize("path", [path for path in PAGES if blocks(path, "python")], ids=named)
def test_examples(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run(path)


def test_there_are_examples():
    guides = {path.stem for path in (DOCS / "guides").glob("*.md") if blocks(path, "python")}
    assert guides >= {"SVGF", "HalfRes", "BMFR", "OIDN", "TAA", "Upscaler", "Recirculation", "files", "both_sides"}


@pytest.mark.parametrize("path", [path for path in TEXTS if blocks(path, "sh")], ids=named)
def test_commands(path):
    """What is called by the name of `yester` is a command with these options."""
    for block in blocks(path, "sh"):
        for line in block.splitlines():
            words = shlex.split(line, comments=True)
            if words and Path(words[0]).name == "yester":
                cli._parser().parse_args(words[1:])


def public():
    """Every public name with its module."""
    modules = (yester, yester.io, yester.judge, yester.live, yester.metrics)
    names = {f"{module.__name__}.{name}" for module in modules for name in module.__all__}
    functions = vars(yester.io.mitsuba)
    return names | {
        f"yester.io.mitsuba.{name}"
        for name, value in functions.items()
        if isinstance(value, types.FunctionType) and value.__module__ == "yester.io.mitsuba" and name[0] != "_"
    }


def documented():
    """Every name that a page of the API describes by itself."""
    found = set()
    for path in (DOCS / "api").glob("*.rst"):
        module = ""
        for kind, name in re.findall(r"^\.\. (currentmodule|auto\w+|py:data):: ?(.*)$", path.read_text("utf-8"), re.M):
            if kind == "currentmodule":
                module = name
            elif kind not in ("autosummary", "automodule"):
                found.add(name if name.startswith("yester.") else f"{module}.{name}")
    return found


def test_every_public_name_is_described():
    assert sorted(public() - documented()) == []


def test_summaries_list_what_pages_describe():
    """A page's table has every name that it describes."""
    for path in (DOCS / "api").glob("*.rst"):
        text = path.read_text("utf-8")
        for table in re.finditer(r"^\.\. autosummary::\n   :nosignatures:\n\n((?:   \w+\n)+)", text, re.M):
            following = text[table.end() :].partition("currentmodule")[0]
            described = re.findall(r"^\.\. auto(?:function|class):: (\w+)$", following, re.M)
            assert table[1].split() == described, named(path)


def headings(path):
    """The anchors of a page's headings, as GitHub and MyST make them."""
    titles = re.findall(r"^#+ (.*)$", path.read_text("utf-8"), re.M)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def links(path):
    """The files that a page links to, with the anchor in them; of addresses, those in this repository."""
    text = re.sub(r"^```.*?^```$", "", path.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE)
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        inside = re.match(rf"{REPOSITORY}/(?:blob|tree|raw)/main/(.*)", link)
        if inside or not re.match(r"[a-z]+:", link):
            file, _, anchor = (inside[1] if inside else link).partition("#")
            yield link, ((ROOT if inside else path.parent) / file if file else path), anchor


@pytest.mark.parametrize("path", TEXTS, ids=named)
def test_links(path):
    for link, file, anchor in links(path):
        assert file.exists(), link
        if anchor and file.suffix == ".md":
            assert anchor in headings(file), link


def test_readme_leads_to_the_documentation():
    found = {named(file.resolve()) for _, file, _ in links(ROOT / "README.md")}
    assert found >= {"docs/index.md", "docs/guides", "docs/conventions.md", "docs/results/accuracy.md", "CHANGELOG.md"}


def rows(path, heading):
    """The cells of the first table after a heading."""
    text = path.read_text("utf-8").partition(f"\n{heading}\n")[2]
    table = re.search(r"^\|.*\n\|[-|]+\n((?:\|.*\n)+)", text, re.M)
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in table[1].splitlines()]


def test_tables_list_every_kernel():
    """The tables of README and of how it works have each compiled function once."""
    kernels = [name for name in yester.__all__ if isinstance(getattr(yester, name), types.BuiltinFunctionType)]
    for path, heading in (
        (ROOT / "README.md", "## Building blocks"),
        (DOCS / "how_it_works.md", "## The flow of a frame"),
    ):
        names = [name for cells in rows(path, heading) for name in re.findall(r"`(\w+)`", cells[-1])]
        assert sorted(names) == sorted(kernels), named(path)


def write_planes(path, names, rng):
    """An EXR file of single channels: their values, by name."""
    planes = {name: rng.random((4, 6)).astype(np.float32) for name in names}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, dict(planes)).write(str(path))
    return planes


COMPONENTS = {"albedo": "RGB", "normal": "XYZ", "depth": "T", "position": "XYZ", "ids": "I"}


def test_layers_of_mitsuba(tmp_path):
    """Files are recognised as the conventions say."""
    found = rows(DOCS / "conventions.md", "### Mitsuba 3")
    assert {buffer.strip("`") for buffer, *_ in found} == COMPONENTS.keys()
    for buffer, layers, _ in found:
        buffer = buffer.strip("`")
        for layer in re.findall(r"`([\w.]+)`", layers):
            if layer != ".T":
                names = [f"{layer}.{component}" for component in COMPONENTS[buffer]]
                write_planes(tmp_path / "frame.exr", [*"RGB", *names], np.random.default_rng(0))
                assert list(yester.io.describe(tmp_path / "frame.exr").channels[buffer]) == names


def test_channels_of_buffers(tmp_path):
    """A frame with every buffer is written to the channels that the conventions name, and no buffer is left out."""
    ones = {name: np.ones((4, 6, 3)) for name in ("color", "albedo", "normal", "position", "emission", "object_normal")}
    ones |= {name: np.ones((4, 6, 3)) for name in ("replay", "motion", "motion_next")}
    ones |= {name: np.ones((4, 6)) for name in ("depth", "hit_distance", "reactive")}
    frame = yester.Frame(**ones, ids=np.ones((4, 6), np.uint32))
    yester.io.write_exr(tmp_path / "frame.exr", frame)
    said = {}
    for name, _, _, channels in rows(DOCS / "conventions.md", "## Buffers"):
        if "attribute" not in channels:
            layer, _, components = channels.strip("`").rpartition(".")
            said[name.strip("`")] = tuple(f"{layer}.{one}" if layer else one for one in re.split("[ /]", components))
    assert said == yester.io.describe(tmp_path / "frame.exr").channels


def test_layers_of_cycles(tmp_path):
    """Files are recognised as the conventions say: each layer alone, behind the name of a view layer."""
    found = {cells[0]: cells[1] for cells in rows(DOCS / "conventions.md", "### Blender Cycles")}
    assert {name for buffer in found for name in re.findall(r"`(\w+)`", buffer)} == {
        *("color", "albedo", "normal", "depth", "motion", "motion_next", "ids", "position", "emission")
    }
    components = {"color": "RGB", "albedo": "RGB", "normal": "XYZ", "depth": "Z", "position": "XYZ", "emission": "RGB"}
    for cell, layers in found.items():
        buffer = cell.strip("`")
        for layer in re.findall(r"`([\w .]+)`", layers):
            if layer.startswith("Vector"):
                names, buffer = (
                    [f"Vector.{one}" for one in layer[-2:]],
                    "motion" if layer.endswith("XY") else "motion_next",
                )
            elif layer.startswith("Crypto"):
                names = [f"{layer}00.{one}" for one in "rgba"]
            else:
                names = [f"{layer}.{one}" for one in components.get(buffer, "X")]
            names = [f"ViewLayer.{name}" for name in names]
            colour = [f"ViewLayer.Combined.{one}" for one in "RGB"] if buffer != "color" else []
            write_planes(tmp_path / "frame.exr", [*colour, *names], np.random.default_rng(0))
            known = yester.io.describe(tmp_path / "frame.exr")
            assert (known.renderer, list(known.channels[buffer])) == ("Blender Cycles", names)


def test_layers_of_pbrt(tmp_path):
    names = [f"{name}.{component}" for name in ("P", "N", "Ns") for component in "XYZ"]
    write_planes(tmp_path / "frame.exr", [*"RGB", "Albedo.R", "Albedo.G", "Albedo.B", *names], np.random.default_rng(0))
    known = yester.io.describe(tmp_path / "frame.exr")
    assert known.channels.keys() == {"color", "albedo", "normal", "depth", "position"}
    assert known.channels["normal"] == ("Ns.X", "Ns.Y", "Ns.Z")


def test_layers_that_are_not_used(tmp_path):
    """Motion of which unit or sign are not known is not used, and a mapping is asked for."""
    for cell, _, remedy in rows(DOCS / "conventions.md", "### Arnold, RenderMan, V-Ray, MoonRay, Unreal"):
        for layer in re.findall(r"`(\w+)`", cell):
            # V-Ray's layer is named like others, so that its header is needed.
            header = {"vrayInfo/version": "7"} if layer == "Velocity" else {}
            names = [f"{layer}.{one}" for one in ("RGB" if layer == "Velocity" else "RG")]
            plus = ["zfiltered"] if layer in ("backward", "forward") else []
            planes = write_planes(tmp_path / "frame.exr", [*"RGB", *names, *plus], np.random.default_rng(0))
            OpenEXR.File(header, planes).write(str(tmp_path / "frame.exr"))
            known = yester.io.describe(tmp_path / "frame.exr")
            assert not {"motion", "motion_next"} & known.channels.keys()
            assert names[0] in known.unused
            assert ("map it" in known.unused[names[0]]) == remedy.startswith("a mapping")
