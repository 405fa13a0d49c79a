"""`guidance compare`: two outcomes or two sweeps, what differs by row and by statistic. Differences are B − A."""

import heapq
import json
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
from pyarrow import parquet
from rich.table import Table

from guidance.errors import ConfigError
from guidance.log.codec import plain
from guidance.screen import console, sheet
from guidance.sweeps.folder import Folder, read_folder
from guidance.sweeps.pairing import pair_numbers, paired, rows_pair
from guidance.sweeps.plan import ROW
from guidance.sweeps.statistics import (
    NONE,
    Interval,
    Moments,
    difference_of_means,
    difference_of_shares,
    mean,
    share,
)

COLUMNS: Final = (
    "predicted",
    "achieved",
    "regret",
    "game_time_s",
    "capture_time_s",
    "final_distance_m",
    "min_standoff_m",
    "min_altitude_m",
)
"""Columns whose means are compared."""

CAPTURED: Final = "captured"
_READ: Final = [ROW, "end", *COLUMNS]


@dataclass(slots=True)
class RowGroup:
    """Rows of one pair of policies in A and of that in B which it is held against.

    Attributes:
        a: Name of the policies in A.
        b: Name of the policies in B.
        rows_a: How many rows A has; games, captures and moments likewise.
        rows_b: How many rows B has.
        apart: Moments of the differences of paired rows.
        of_a: Moments of A.
        of_b: Moments of B.
    """

    a: str
    b: str
    rows_a: int = 0
    rows_b: int = 0
    apart: dict[str, Moments] = field(default_factory=dict)
    of_a: dict[str, Moments] = field(default_factory=dict)
    of_b: dict[str, Moments] = field(default_factory=dict)

    def add(self, a: pa.Table | None, b: pa.Table | None) -> None:
        """Add rows of either, or of both where they pair."""
        numbers = [None if table is None else _numbers(table) for table in (a, b)]
        for name in (CAPTURED, *COLUMNS):
            for given, kept in zip(numbers, (self.of_a, self.of_b), strict=True):
                if given is not None:
                    kept[name] = kept.get(name, NONE).joined(given[name])
            if numbers[0] is not None and numbers[1] is not None:
                self.apart[name] = self.apart.get(name, NONE).joined(numbers[1][name] - numbers[0][name])
        self.rows_a += 0 if a is None else a.num_rows
        self.rows_b += 0 if b is None else b.num_rows

    def difference(self, name: str) -> Interval:
        """Return the difference of a column's means, or of the shares that were captured."""
        if self.apart:
            return mean(self.apart[name])
        of_a, of_b = self.of_a.get(name, NONE), self.of_b.get(name, NONE)
        if name == CAPTURED:
            return difference_of_shares(*(share(round(one.mean * one.count), one.count) for one in (of_a, of_b)))
        return difference_of_means(of_a, of_b)


def compare_sweeps(a: Folder, b: Folder, *, column: str, rows: int) -> dict[str, Any]:
    """Compare two sweeps; return the comparison as plain values, NaN as null.

    Args:
        a: One sweep.
        b: The other.
        column: What the rows are compared by.
        rows: How many of the largest differences are listed.

    Raises:
        ConfigError: If the column is none that can be compared.
    """
    if column not in COLUMNS:
        raise ConfigError(f"--by {column}: allowed are {', '.join(COLUMNS)}")
    for folder in (a, b):
        if folder.plan.teams:
            raise ConfigError(f"{folder.path}: has teams, whose rows are evaders; see each with guidance sweep report")
    pairing = rows_pair(a.plan, b.plan)
    matched = pair_numbers(a.plan, b.plan)
    names = [[f"{pair.pursuer} / {pair.evader}" for pair in folder.plan.pairs] for folder in (a, b)]
    largest: list[tuple[Any, ...]] = []
    if matched is None:
        groups = {0: RowGroup("all rows", "all rows")}
    else:
        groups = {number: RowGroup(names[0][number], names[1][other]) for number, other in matched.items()}
    if pairing:
        for side in paired(a, b, _READ):
            for number in np.unique(side.pair).tolist():
                mask = pa.array(side.pair == number)
                groups[number].add(side.a.filter(mask), side.b.filter(mask))
            largest = heapq.nlargest(rows, [*largest, *_largest(side.a, side.b, column, rows)])
    else:
        _add_apart(a, groups, {number: number for number in matched} if matched else None, first=True)
        _add_apart(b, groups, {other: number for number, other in matched.items()} if matched else None, first=False)
    compared: dict[str, Any] = plain(
        {
            "paired": pairing,
            "intervals": "95 %: Student's t of the paired differences"
            if pairing
            else "95 %: Welch's t for means, Newcombe's for shares",
            "groups": [_summed_up(group) for group in groups.values() if group.rows_a or group.rows_b],
            "largest": [
                {"row_a": -one[2], "row_b": one[3], "end_a": one[4], "end_b": one[5], "column": column}
                | {"a": one[6], "b": one[7], "difference": one[7] - one[6]}
                for one in largest
            ],
        }
    )
    return compared


def _add_apart(folder: Folder, groups: dict[int, RowGroup], matched: dict[int, int] | None, *, first: bool) -> None:
    """Add a sweep's rows that pair with none."""
    for part in folder.parts:
        table = parquet.read_table(part, columns=_READ)
        pairs = folder.plan.cases(table[ROW].to_numpy()).pair
        for number in np.unique(pairs).tolist():
            if matched is not None and number not in matched:
                continue
            rows = table.filter(pa.array(pairs == number))
            group = groups[0 if matched is None else matched[number]]
            group.add(rows, None) if first else group.add(None, rows)


def _numbers(table: pa.Table) -> dict[str, Any]:
    end = np.array(table["end"].to_pylist(), dtype=object)
    captured = np.where(end == "invalid", math.nan, end == CAPTURED)
    return {CAPTURED: captured.astype(np.float64), **{name: table[name].to_numpy() for name in COLUMNS}}


def _largest(a: pa.Table, b: pa.Table, column: str, count: int) -> Iterator[tuple[Any, ...]]:
    """Yield rows that ended otherwise, and those furthest apart in a column, as they are ordered and shown."""
    ends = a["end"].to_pylist(), b["end"].to_pylist()
    values = a[column].to_numpy(), b[column].to_numpy()
    otherwise = np.array([one != other for one, other in zip(*ends, strict=True)])
    apart = np.nan_to_num(np.abs(values[1] - values[0]), nan=0.0)
    for place in np.lexsort((-apart, ~otherwise))[:count].tolist():
        if not otherwise[place] and apart[place] == 0.0:
            return
        numbers = -a[ROW][place].as_py(), b[ROW][place].as_py()
        shown = ends[0][place], ends[1][place], float(values[0][place]), float(values[1][place])
        yield (bool(otherwise[place]), float(apart[place]), *numbers, *shown)


def _summed_up(group: RowGroup) -> dict[str, Any]:
    return {
        "a": group.a,
        "b": group.b,
        "rows_a": group.rows_a,
        "rows_b": group.rows_b,
        "columns": {
            name: {
                "a": _mean_of(group.of_a, name),
                "b": _mean_of(group.of_b, name),
                "difference": group.difference(name),
            }
            for name in (CAPTURED, *COLUMNS)
        },
    }


def _mean_of(moments: dict[str, Moments], name: str) -> float:
    known = moments.get(name, NONE)
    return known.mean if known.count else math.nan


def compare_outcomes(a: dict[str, Any], b: dict[str, Any]) -> dict[str, Any]:
    """Compare two outcomes column by column; the difference of what are no numbers is null."""
    return {
        name: {"a": value, "b": b[name], "difference": _difference(value, b[name])}
        for name, value in a.items()
        if name in b
    }


def _difference(a: Any, b: Any) -> float | None:  # noqa: ANN401 - any column
    numbers = all(isinstance(one, (int, float)) and not isinstance(one, bool) for one in (a, b))
    return b - a if numbers else None


def read_outcome(path: Path) -> dict[str, Any]:
    """Read an outcome that `guidance scenario run --json` wrote.

    Raises:
        ConfigError: If it is none.
    """
    try:
        outcome = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from error
    except ValueError as error:
        raise ConfigError(f"{path}: is no JSON ({error})") from error
    if not isinstance(outcome, dict) or not {"end", "winner", *COLUMNS} <= set(outcome):
        raise ConfigError(f"{path}: is no outcome; it must be what guidance scenario run FILE --json wrote")
    return outcome


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


def _outcomes(compared: Mapping[str, Mapping[str, Any]]) -> Table:
    rows = [(name, *(_said(values[part]) for part in ("a", "b", "difference"))) for name, values in compared.items()]
    return sheet(("column", "A", "B", "B − A"), rows)


def _sweeps(compared: Mapping[str, Any]) -> list[Table]:
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
        tables.append(sheet(("mean of", "A", "B", "B − A", "95 %"), rows, title=f"{policies}: {count} {words}"))
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
        tables.append(sheet(headings, largest, title="the rows that differ most"))
    return tables


def _said(value: Any) -> str:  # noqa: ANN401 - any column
    if isinstance(value, float):
        return f"{value:.5g}"
    if isinstance(value, list):
        return ", ".join(map(str, value)) or "none"
    return "-" if value is None else str(value)
