"""A comparison on the screen, or as JSON."""

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.table import Table

from guidance.errors import ConfigError
from guidance.sweeps.compare import CAPTURED, compare_outcomes, compare_sweeps, read_outcome
from guidance.sweeps.folder import read_folder
from guidance.sweeps.report import wide_console


def compare_paths(a: Path, b: Path, *, column: str, rows: int, as_json: bool) -> None:
    """Compare two sweeps' folders or two outcomes' files, and print what came out.

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
    console = wide_console()
    console.print(f"A {a}\nB {b}", highlight=False)
    tables = _sweeps(compared) if "groups" in compared else [_outcomes(compared)]
    for table in tables:
        console.print(table)


def _outcomes(compared: Mapping[str, Mapping[str, Any]]) -> Table:
    table = _table("", "column", "A", "B", "B − A")
    for name, values in compared.items():
        table.add_row(name, *(_said(values[part]) for part in ("a", "b", "difference")))
    return table


def _sweeps(compared: Mapping[str, Any]) -> list[Table]:
    tables = []
    words = "paired rows" if compared["paired"] else "rows that do not pair: what is swept differs"
    for group in compared["groups"]:
        policies = group["a"] if group["a"] == group["b"] else f"{group['a']}, in B {group['b']}"
        count = str(group["rows_a"]) if compared["paired"] else f"{group['rows_a']} and {group['rows_b']}"
        table = _table(f"{policies}: {count} {words}", "mean of", "A", "B", "B − A", "95 %")
        for name, values in group["columns"].items():
            apart = values["difference"]
            reach = f"{_said(apart['low'])} to {_said(apart['high'])}"
            shown = "share captured" if name == CAPTURED else name
            table.add_row(shown, _said(values["a"]), _said(values["b"]), _said(apart["estimate"]), reach)
        tables.append(table)
    if compared["largest"]:
        column = compared["largest"][0]["column"]
        table = _table("the rows that differ most", "row in A", "in B", "end in A", "in B", f"{column} A", "B", "B − A")
        for row in compared["largest"]:
            numbers = (_said(row[name]) for name in ("a", "b", "difference"))
            table.add_row(str(row["row_a"]), str(row["row_b"]), row["end_a"], row["end_b"], *numbers)
        tables.append(table)
    return tables


def _table(title: str, *headings: str) -> Table:
    table = Table(title=title or None, title_justify="left", box=None, pad_edge=False)
    for place, heading in enumerate(headings):
        table.add_column(heading, justify="right" if place else "left")
    return table


def _said(value: Any) -> str:  # noqa: ANN401 - any column
    if isinstance(value, float):
        return f"{value:.5g}"
    if isinstance(value, list):
        return ", ".join(map(str, value)) or "none"
    return "-" if value is None else str(value)
