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
import yester.metrics
import yester.study
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
    modules = (yester, yester.io, yester.metrics, yester.study)
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


def test_files_of_blender(tmp_path, monkeypatch):
    """The conversion that the conventions give, on a file as Cycles writes it."""
    rng = np.random.default_rng(0)
    names = [f"Combined.{c}" for c in "RGBA"] + [f"Denoising Albedo.{c}" for c in "RGB"]
    names += [f"Normal.{c}" for c in "XYZ"] + [f"Vector.{c}" for c in "XYZW"] + ["Depth.Z"]
    planes = {f"ViewLayer.{name}": rng.random((4, 6)).astype(np.float32) for name in names}
    planes["ViewLayer.Depth.Z"][0, 0] = 1e10
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, dict(planes)).write(str(tmp_path / "frame.exr"))
    monkeypatch.chdir(tmp_path)
    frame = run(DOCS / "conventions.md")["read_blender"]("frame.exr")
    assert set(frame.buffers()) == {"color", "albedo", "normal", "depth", "motion", "motion_next"}
    assert frame.depth[0, 0] == np.inf
    assert np.isfinite(frame.depth.ravel()[1:]).all()
    assert (frame.motion[..., 1] == -planes["ViewLayer.Vector.Y"]).all()
    assert (frame.motion_next[..., 0] == -planes["ViewLayer.Vector.Z"]).all()
    assert (frame.color[..., 2] == planes["ViewLayer.Combined.B"]).all()
