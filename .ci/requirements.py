"""Print what extras of pyproject.toml ask for, themselves and through each other: ``python requirements.py EXTRA...``.

So they can be installed before the package is compiled.
"""

import re
import sys
import tomllib
from pathlib import Path

PROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]


def expand(names: list[str]) -> set[str]:
    """The requirements of extras; those of the form ``yester[...]`` are replaced by what they ask for."""
    found: set[str] = set()
    for requirement in (each for name in names for each in PROJECT["optional-dependencies"][name]):
        own = re.fullmatch(rf"{PROJECT['name']}\[(.*)\]", requirement)
        found |= expand([name.strip() for name in own[1].split(",")]) if own else {requirement}
    return found


print("\n".join(sorted({*PROJECT["dependencies"], *expand(sys.argv[1:])})))
