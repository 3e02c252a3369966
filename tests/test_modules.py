"""The direction of imports between the Rust modules: along the data flow, and without circles."""

import re
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

SOURCES = Path(__file__).parents[1] / "src"

#: The folders of kernels in the order of data flow.
FLOW = ("camera", "fetch", "judge", "merge", "smooth")

#: Layers of the crate; each may import those before it.
LAYERS = ("core", "kernels", "pipelines", "bindings")

Module = tuple[str, ...]


def modules() -> dict[Module, str]:
    """The code of every module, without comments, strings and tests."""
    found = {}
    for path in sorted(set(SOURCES.rglob("*.rs")) - set(SOURCES.rglob("tests.rs"))):
        parts = path.relative_to(SOURCES).with_suffix("").parts
        parts = parts[:-1] if parts[-1] in ("mod", "lib") else parts
        code = path.read_text(encoding="utf-8").split("#[cfg(test)]\nmod tests")[0]
        found[parts] = re.sub(r'//[^\n]*|"(\\.|[^"\\])*"', "", code)
    return found


def leaves(tree: str) -> Iterator[str]:
    """The paths of a use tree: ``a::{b, c::{d, e}}`` is ``a::b``, ``a::c::d`` and ``a::c::e``."""
    head, brace, rest = tree.partition("{")
    if not brace:
        yield head
        return
    depth, part = 0, ""
    for letter in rest.rstrip().removesuffix("}") + ",":
        depth += (letter == "{") - (letter == "}")
        if letter == "," and depth == 0:
            yield from (head + leaf for leaf in leaves(part) if part)
            part = ""
        else:
            part += letter


def imports(module: Module, code: str, known: dict[Module, str]) -> set[Module]:
    """The modules that a module names in `use` statements and in paths."""
    used = re.findall(r"\buse\s+((?:crate|super|self)::[^;]+);", code)
    trees = [re.sub(r"\s+as\s+\w+|\s", "", tree) for tree in used]
    paths = [leaf for tree in trees for leaf in leaves(tree)]
    paths += re.findall(r"\b(?:crate|super)(?:::\w+)+", code)
    found = set()
    folder = any(len(other) > len(module) and other[: len(module)] == module for other in known)
    for path in paths:
        first, *names = path.split("::")
        place = () if first == "crate" else module if first == "self" else module[:-1]
        while names and names[0] == "super":
            place, names = place[:-1], names[1:]
        target = (*place, *names)
        while target not in known:
            target = target[:-1]
        if target and target != module and not (folder and first == "self"):
            found.add(target)
    return found


def edges() -> set[tuple[Module, Module]]:
    known = modules()
    return {(module, target) for module, code in known.items() for target in imports(module, code, known)}


def layer(module: Module) -> int:
    name = module[0] if module else LAYERS[-1]
    return LAYERS.index(name) if name in LAYERS else 0


def breaks(module: Module, target: Module) -> bool:
    if layer(module) != layer(target):
        return layer(module) < layer(target)
    if module[0] != "kernels" or len(module) < 3 or len(target) < 3:
        return False
    here, there = FLOW.index(module[1]), FLOW.index(target[1])
    return here < there or (module[1], target[1]) == ("smooth", "judge")


def test_trees_are_expanded():
    assert list(leaves("a::{b,c::{d,e},f}")) == ["a::b", "a::c::d", "a::c::e", "a::f"]


def test_imports_are_found():
    known = modules()
    found = edges()
    assert {module[1] for module in known if len(module) == 3 and module[0] == "kernels"} == set(FLOW)
    # One of each form: a path of `super`, one of `crate`, a tree.
    assert (("kernels", "judge", "neighborhood"), ("kernels", "judge", "hull")) in found
    assert (("kernels", "merge", "blend"), ("kernels", "judge", "neighborhood")) in found
    assert (("bindings", "judge"), ("kernels", "judge", "innovation")) in found


def test_nothing_imports_to_its_right():
    assert sorted(edge for edge in edges() if breaks(*edge)) == []


@pytest.mark.parametrize("layer_name", LAYERS[:3])
def test_no_circles(layer_name):
    # A pipeline and its parts are one: the parts take from the whole what the frame is.
    depth = 2 if layer_name == "pipelines" else None
    graph: dict[Module, set[Module]] = {}
    for module, target in edges():
        if module and layer(module) == layer(target) == LAYERS.index(layer_name) and module[:depth] != target[:depth]:
            graph.setdefault(module[:depth], set()).add(target[:depth])
    TopologicalSorter(graph).prepare()
