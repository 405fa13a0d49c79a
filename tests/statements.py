"""One statement, one idea: finds assignments that pack several values, `a, b = x, y`.

A tuple may be taken apart (`x, y = point`), and values that depend on each other may change
together (`low, high = high, low`). Anything else is two statements.
"""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGES = ("guidance", "sitl_mock", "tests")


def main() -> int:
    """Print every packed assignment of the project; return 1 if there is one."""
    faults = [
        f"{path.relative_to(ROOT)}:{line}: several values in one assignment: write one a line"
        for package in PACKAGES
        for path in sorted((ROOT / package).rglob("*.py"))
        for line in packed_lines(path.read_text(encoding="utf-8"))
    ]
    print("\n".join(faults) or "every assignment has one value")
    return int(bool(faults))


def packed_lines(source: str) -> Iterator[int]:
    """Yield the line of each assignment that packs independent values."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Assign) and any(
            _packs(target, node.value) for target in node.targets
        ):
            yield node.lineno


def _packs(target: ast.expr, value: ast.expr) -> bool:
    if not (isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple)):
        return False
    written = {ast.unparse(part) for part in target.elts}
    read = {
        ast.unparse(part)
        for part in ast.walk(value)
        if isinstance(part, ast.Name | ast.Attribute | ast.Subscript)
    }
    return not written & read


if __name__ == "__main__":
    sys.exit(main())
