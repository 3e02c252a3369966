"""Configuration of the documentation. ``python -m sphinx -n -W --keep-going docs OUT`` builds it, without a network."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path
from typing import Any

import yester
from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.transforms.post_transforms import SphinxPostTransform

HERE = Path(__file__).parent
ROOT = HERE.parent
REPOSITORY = "https://github.com/yester-dev/yester"

project = "Yester"
author = "Yester developers"
copyright = author
release = yester.__version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.viewcode",
    "numpydoc",
    "myst_nb",
    "sphinx_design",
]
exclude_patterns = ["results/data"]

# In docstrings, single backticks are links where there is something to link to, as numpydoc has them.
default_role = "autolink"
autodoc_typehints = "none"
nitpick_ignore_regex = [("py:class", r"(numpy|collections\.abc)\..*")]  # in aliases of types
numpydoc_class_members_toctree = False
numpydoc_show_inherited_class_members = False

myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 3
nb_execution_mode = "off"

html_theme = "furo"
html_title = f"Yester {release}"
html_show_copyright = False
html_static_path = ["_static"]
html_css_files = ["yester.css"]
html_theme_options = {
    "source_repository": REPOSITORY,
    "source_branch": "main",
    "source_directory": "docs/",
}


def _linked(text: str, folder: str = "") -> str:
    """Markdown of the repository, with its relative links made absolute."""
    base = f"{REPOSITORY}/blob/main/{folder}"
    return re.sub(r"\]\((?!https?:|#|mailto:)([^)\s]+)\)", rf"]({base}\1)", text)


def _write(path: Path, content: bytes) -> None:
    """Write a file unless it is there, so that pages are not built anew for nothing."""
    path.parent.mkdir(exist_ok=True)
    if not path.exists() or path.read_bytes() != content:
        path.write_bytes(content)


def _first_image(notebook: dict[str, Any]) -> tuple[str, bytes]:
    """Suffix and contents of the first picture in a notebook's outputs."""
    for cell in notebook["cells"]:
        for output in cell.get("outputs", []):
            data = output.get("data", {})
            if "image/svg+xml" in data:
                return ".svg", "".join(data["image/svg+xml"]).encode()
            for kind in {"image/png", "image/jpeg"} & data.keys():
                return f".{kind.removeprefix('image/')}", base64.b64decode(data[kind])
    raise ValueError("expected a notebook with a picture, got none")


def _copy() -> None:
    """Copy pages that are elsewhere in the repository to where Sphinx can read them."""
    for name in ("CHANGELOG.md", "CONTRIBUTING.md"):
        _write(HERE / "copied" / name, _linked((ROOT / name).read_text("utf-8")).encode())
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        text = path.read_text("utf-8")
        _write(HERE / "notebooks" / path.name, _linked(text, "notebooks/").encode())
        suffix, image = _first_image(json.loads(text))
        _write(HERE / "notebooks" / "thumbnails" / f"{path.stem}{suffix}", image)


class LinkedNames(SphinxPostTransform):
    """Makes links of names in code font, so that pages can be plain Markdown: `reproject`, `SVGF.step`, `Frame(…)`."""

    default_priority = 5  # before references are resolved

    def run(self, **_: Any) -> None:
        """Replace literals that are names of the public API."""
        python = self.env.get_domain("py")
        for literal in list(self.document.findall(nodes.literal)):
            name = re.sub(r"\(.*\)$", "", literal.astext())
            target = next((full for full in (f"yester.{name}", name) if full in python.objects), None)
            inside = literal.parent
            while inside is not None and not isinstance(inside, nodes.reference | addnodes.pending_xref):
                inside = inside.parent
            if target is None or inside is not None:
                continue
            link = addnodes.pending_xref(
                "", refdomain="py", reftype="obj", reftarget=target, refdoc=self.env.docname, refwarn=True
            )
            literal.replace_self(link)
            link += literal


def _found(app: Sphinx, env: Any, node: addnodes.pending_xref, content: nodes.Node) -> nodes.Node | None:
    """What is in backticks in a docstring: a name in `yester`, an attribute of a class, or no link at all."""
    if node.get("reftype") != "obj":
        return None
    python, name = env.get_domain("py"), node["reftarget"]
    for target in (name, name.rpartition(".")[0]):
        if f"yester.{target}" in python.objects:
            target = f"yester.{target}"
            return python.resolve_xref(env, node["refdoc"], app.builder, "obj", target, node, content)
    return content


def setup(app: Sphinx) -> None:
    """Prepare the pages, and register what makes links."""
    _copy()
    app.add_post_transform(LinkedNames)
    app.connect("missing-reference", _found)
