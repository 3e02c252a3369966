"""Docstrings are numpydoc, complete, and their examples give what they say."""

import doctest
import inspect
from enum import EnumType
from functools import cached_property

import numpy as np
import pytest
import yester
import yester.io
import yester.metrics
from numpydoc.docscrape import get_doc_object
from numpydoc.validate import Validator, validate

#: Checks of numpydoc that are left out, and why.
LEFT_OUT = {
    "ES01": "No extended summary: one sentence is enough where the parameters say the rest.",
    "EX01": "No examples: required below of functions and classes, not of every property.",
    "GL02": "Closing quotes on a line of their own: docstrings of the binary have no quotes.",
    "RT02": "A single result has no name: names tell what a buffer is, in results as in parameters.",
    "SA01": "No See Also: most methods have no relatives but those of their class.",
}
#: Classes that functions return, or that only describe.
WITHOUT_EXAMPLES = {"yester.io.Description", "yester.io.Plate", "yester.metrics.Metric"}
#: Functions that return nothing.
WITHOUT_RESULTS = ("reset", "save", "write_exr")

MODULES = {module.__name__: module for module in (yester, yester.io, yester.metrics)}
#: What modules export that can have a docstring.
EXPORTED = {
    f"{name}.{each}": getattr(module, each)
    for name, module in MODULES.items()
    for each in module.__all__
    if callable(getattr(module, each))
}


def attributes(owner):
    """Methods and properties of a class, sorted, without inherited ones and the members of enumerations."""
    for name, thing in sorted(vars(owner).items()):
        data = inspect.isdatadescriptor(thing) or isinstance(thing, cached_property)
        if not name.startswith("_") and not isinstance(thing, owner) and (data or callable(thing)):
            yield name, thing if data else getattr(owner, name)


PUBLIC = EXPORTED | {
    f"{full}.{name}": thing
    for full, owner in EXPORTED.items()
    if inspect.isclass(owner)
    for name, thing in attributes(owner)
}
FUNCTIONS = [name for name, thing in PUBLIC.items() if callable(thing) and not inspect.isclass(thing)]
EXAMPLES = {
    name: inspect.getdoc(thing) for name, thing in (MODULES | PUBLIC).items() if ">>> " in (inspect.getdoc(thing) or "")
}


class Compiled(Validator):
    """Takes functions of the binary for functions, whose results are checked as well."""

    def __init__(self, obj_name):
        super().__init__(get_doc_object(self._load_obj(obj_name)))

    @property
    def is_function_or_method(self):
        return inspect.isroutine(self.obj)

    @property
    def signature_parameters(self):
        """None of an enumeration, whose members are not made by callers."""
        return () if isinstance(self.obj, EnumType) else super().signature_parameters


@pytest.mark.parametrize("name", PUBLIC)
def test_docstring(name):
    errors = validate(name, validator_cls=Compiled)["errors"]
    assert [error for error in errors if error[0] not in LEFT_OUT] == []


def test_results_are_described():
    """numpydoc does not see that a compiled function returns something."""
    told = "\nReturns\n-------\n", "\nYields\n------\n"
    without = [name for name in FUNCTIONS if not any(head in inspect.getdoc(PUBLIC[name]) for head in told)]
    assert [name for name in without if name.rpartition(".")[2] not in WITHOUT_RESULTS] == []


def test_examples_are_there():
    without = {name for name, thing in EXPORTED.items() if "\nExamples\n--------\n" not in inspect.getdoc(thing)}
    assert without == WITHOUT_EXAMPLES


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    test = doctest.DocTestParser().get_doctest(EXAMPLES[name], {"np": np, "yester": yester}, name, None, None)
    said = []
    with np.printoptions(precision=4, suppress=True):
        found = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE).run(test, out=said.append)
    assert found.failed == 0, "".join(said)
