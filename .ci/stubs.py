"""Writes the docstrings of the compiled core into its stub, where editors find them.

The signatures of the stub are written by hand and kept; docstrings are those of the installed binary.

    python .ci/stubs.py            rewrites python/yester/_core.pyi
    python .ci/stubs.py --check    fails if that would change it
"""

from __future__ import annotations

import argparse
import ast
import subprocess
import sys
import textwrap
from pathlib import Path

STUB = Path(__file__).parents[1] / "python" / "yester" / "_core.pyi"


def documented(source: str, module: object) -> str:
    """The stub with the docstrings of the module's functions, classes, methods and properties."""
    lines = source.splitlines()
    # From the end, so that the numbers of earlier lines stay.
    for node, owner in sorted(_definitions(ast.parse(source), module), key=lambda pair: -pair[0].lineno):
        _document(lines, node, getattr(owner, node.name))
    formatted = subprocess.run(
        [sys.executable, "-m", "ruff", "format", "--stdin-filename", STUB, "-"],
        input="\n".join(lines) + "\n",
        capture_output=True,
        encoding="utf-8",
        check=True,
    )
    return formatted.stdout


def _definitions(tree: ast.Module | ast.ClassDef, owner: object) -> list[tuple[ast.FunctionDef | ast.ClassDef, object]]:
    """Functions and classes with the object that has them; none with underscores, whose docstrings nobody looks up."""
    found: list[tuple[ast.FunctionDef | ast.ClassDef, object]] = []
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            found.append((node, owner))
            if isinstance(node, ast.ClassDef):
                found += _definitions(node, getattr(owner, node.name))
    return found


def _document(lines: list[str], node: ast.FunctionDef | ast.ClassDef, thing: object) -> None:
    """Give a definition its docstring, instead of the one that it has."""
    text = thing.__doc__
    if not text:
        raise SystemExit(f"{node.name}: has no docstring in the binary")
    if '"""' in text or "\\" in text:
        raise SystemExit(f"{node.name}: a docstring with backslashes or triple quotes needs another literal")
    body = node.body[0]
    start = end = min([body.lineno, *(each.lineno for each in getattr(body, "decorator_list", []))]) - 1
    behind = ""
    if isinstance(body, ast.Expr) and isinstance(body.value, ast.Constant):
        # A docstring, or the dots of an empty body, maybe behind the colon of `def f(): ...`.
        end = body.end_lineno or body.lineno
        behind = lines[start][: body.col_offset].rstrip()
    indent = " " * (node.col_offset + 4)
    closing = f"\n{indent}" if "\n" in text else ""
    docstring = textwrap.indent(f'"""{text}{closing}"""', indent, lambda line: bool(line.strip())).splitlines()
    lines[start:end] = [*([behind] if behind else []), *docstring]


def main() -> None:
    """Rewrite the stub, or compare it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--check", action="store_true", help="fail if the stub would change")
    check = parser.parse_args().check

    from yester import _core

    source = STUB.read_text(encoding="utf-8")
    new = documented(source, _core)
    if check and new != source:
        sys.exit(f"{STUB}: docstrings differ from those of the binary: run python .ci/stubs.py")
    if not check:
        STUB.write_text(new, encoding="utf-8")


if __name__ == "__main__":
    main()
