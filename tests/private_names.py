"""Tests use public names: finds names that a package keeps private, in tests.

`_replace`, `_asdict` and the others of `typing.NamedTuple` are public in spite of their underscore.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGES = ("guidance", "sitl_mock")
OF_NAMED_TUPLES = {"_replace", "_asdict", "_fields", "_make", "_field_defaults"}
OF_LIBRARIES = {"_mavsdk", "_response"}
"""Private names of libraries that tests need, and that a package happens to have too."""

BY_NAME = {"getattr", "hasattr", "setattr", "delattr", "attrgetter", "object"}
"""Functions that take the name of an attribute as text; `object` is that of `unittest.mock.patch`."""


def private_names(folder: Path = ROOT) -> set[str]:
    """Return every private name that the packages define."""
    names = {
        name
        for package in PACKAGES
        for path in (folder / package).rglob("*.py")
        for name in _defined(ast.parse(path.read_text(encoding="utf-8")))
    }
    return {name for name in names if _is_private(name)} - OF_NAMED_TUPLES - OF_LIBRARIES


def _is_private(name: str) -> bool:
    return name.startswith("_") and not name.startswith("__") and name != "_"


def _defined(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.attr
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id


def used_lines(source: str, names: set[str]) -> Iterator[tuple[int, str]]:
    """Yield line and name of each use of one of the names; a class may use its own through `self` or `cls`."""
    if names.isdisjoint(re.findall(r"\b_\w+", source)):
        return  # most files: reading the words takes a tenth of the time that reading the statements takes
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.expr | ast.stmt):
            for name in _used(node):
                if name in names:
                    yield node.lineno, name


def _used(node: ast.AST) -> Iterator[str]:
    if isinstance(node, ast.Attribute) and not _is_own(node.value):
        yield node.attr
    elif isinstance(node, ast.ImportFrom):
        yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] in BY_NAME:
        texts = [part.value for part in node.args if isinstance(part, ast.Constant)]
        yield from (text.split(".")[-1] for text in texts if isinstance(text, str))


def _is_own(value: ast.expr) -> bool:
    if isinstance(value, ast.Call):
        return isinstance(value.func, ast.Name) and value.func.id == "super"
    return isinstance(value, ast.Name) and value.id in {"self", "cls"}
