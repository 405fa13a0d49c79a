"""A comparison on the screen, or as JSON."""

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from guidance.errors import ConfigError
from guidance.screen import Sheet, console
from guidance.sweeps.compare import CAPTURED, compare_outcomes, compare_sweeps, read_outcome
from guidance.sweeps.folder import read_folder


def compare_paths(a: Path, b: Path, *, column: str, rows: int, as_json: bool) -> None:
    """Compare two sweeps' folders or two outcomes' files, and print what came out.

    Args:
        a: A sweep's folder or an outcome's JSON file.
        b: Another of the same kind.
        column: What a sweep's rows are compared by.
        rows: How many of the largest differences are listed.
        as_json: Whether plain JSON is printed.

    Raises:
        ConfigError: If they are neither.
    """
    if a.is_dir() != b.is_dir():
        raise ConfigError(f"{a}, {b}: must be two outcomes or two sweeps, not one of each")
    if a.is_dir():
        compared = compare_sweeps(read_folder(a), read_folder(b), column=column, rows=rows)
    else:
        compared = compare_outcomes(read_outcome(a), read_outcome(b))
    if as_json:
        sys.stdout.write(json.dumps(compared, indent=1) + "\n")
        return
    there = console()
    there.print(f"A {a}\nB {b}", soft_wrap=True)
    tables = _sweeps(compared) if "groups" in compared else [_outcomes(compared)]
    for table in tables:
        there.print(table)


def _outcomes(compared: Mapping[str, Mapping[str, Any]]) -> Sheet:
    rows = [(name, *(_said(values[part]) for part in ("a", "b", "difference"))) for name, values in compared.items()]
    return Sheet(("column", "A", "B", "B − A"), rows)


def _sweeps(compared: Mapping[str, Any]) -> list[Sheet]:
    tables = []
    words = "paired rows" if compared["paired"] else "rows that do not pair: what is swept differs"
    for group in compared["groups"]:
        policies = group["a"] if group["a"] == group["b"] else f"{group['a']}, in B {group['b']}"
        count = str(group["rows_a"]) if compared["paired"] else f"{group['rows_a']} and {group['rows_b']}"
        rows = []
        for name, values in group["columns"].items():
            apart = values["difference"]
            reach = f"{_said(apart['low'])} to {_said(apart['high'])}"
            shown = "share captured" if name == CAPTURED else name
            rows.append((shown, _said(values["a"]), _said(values["b"]), _said(apart["estimate"]), reach))
        tables.append(Sheet(("mean of", "A", "B", "B − A", "95 %"), rows, title=f"{policies}: {count} {words}"))
    if compared["largest"]:
        column = compared["largest"][0]["column"]
        headings = ("row in A", "row in B", "end in A", "end in B", f"{column} in A", "in B", "B − A")
        largest: list[Sequence[str]] = [
            (
                *(str(row[name]) for name in ("row_a", "row_b", "end_a", "end_b")),
                *(_said(row[name]) for name in ("a", "b", "difference")),
            )
            for row in compared["largest"]
        ]
        tables.append(Sheet(headings, largest, title="the rows that differ most"))
    return tables


def _said(value: Any) -> str:  # noqa: ANN401 - any column
    if isinstance(value, float):
        return f"{value:.5g}"
    if isinstance(value, list):
        return ", ".join(map(str, value)) or "none"
    return "-" if value is None else str(value)
