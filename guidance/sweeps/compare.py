"""`guidance compare`: two outcomes or two sweeps, by row and by statistic. Differences are B − A."""

import json
import math
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.table import Table
from rich.text import Text
from scipy import stats

from guidance.errors import ConfigError
from guidance.files import text_of
from guidance.game.arrays import FloatArray
from guidance.log.codec import plain
from guidance.log.entries import OUTCOME
from guidance.screen import console, text_table
from guidance.sim.outcome import Outcome
from guidance.sim.scenario import WIND_WORDS
from guidance.sweeps.folder import (
    CAPTURED,
    END,
    PAIR,
    POINT_NUMBER,
    SEED,
    Columns,
    Folder,
    read_folder,
)
from guidance.sweeps.plan import ROW, Plan

_CONFIDENCE: Final = 0.95
COLUMNS: Final = tuple(name for name, kind in Outcome.__annotations__.items() if kind is float)
"""Columns whose means are compared."""

_ROUNDING: Final = 1e-9
"""Smaller numbers are rounding errors."""


class Interval(NamedTuple):
    """An estimate with its 95 % confidence interval; NaN if unknown."""

    estimate: float = math.nan
    low: float = math.nan
    high: float = math.nan


def success_share(successes: int, of: int) -> Interval:
    """Return a probability with Wilson's interval."""
    if of == 0:
        return Interval()
    low, high = stats.binomtest(successes, of).proportion_ci(_CONFIDENCE, method="wilson")
    return Interval(successes / of, low, high)


def finite_numbers(numbers: FloatArray) -> FloatArray:
    """Return the numbers that are known."""
    return numbers[np.isfinite(numbers)]


def mean(numbers: FloatArray) -> Interval:
    """Return the mean of the known numbers with Student's t interval."""
    numbers = finite_numbers(numbers)
    count = numbers.size
    average = float(numbers.mean()) if count else math.nan
    error = float(stats.sem(numbers)) if count > 1 else math.nan
    return _interval(average, error, count - 1)


def difference_of_means(a: FloatArray, b: FloatArray) -> Interval:
    """Return mean b − mean a of the known numbers of independent samples with Welch's t interval."""
    a = finite_numbers(a)
    b = finite_numbers(b)
    if min(a.size, b.size) == 0:
        return Interval()
    apart = float(b.mean() - a.mean())
    if min(a.size, b.size) == 1:
        return Interval(apart)
    standard_errors = np.array([stats.sem(a), stats.sem(b)])
    variances = standard_errors**2
    total = float(variances.sum())
    freedom = 1.0
    if total:
        # Welch and Satterthwaite
        shares = variances**2 / [a.size - 1, b.size - 1]
        freedom = total**2 / float(shares.sum())
    return _interval(apart, math.sqrt(total), freedom)


def _interval(estimate: float, error: float, freedom: float) -> Interval:
    half = math.nan
    if freedom > 0:
        quantile = float(stats.t.ppf(0.5 + _CONFIDENCE / 2.0, freedom))
        half = error * quantile
    return Interval(estimate, estimate - half, estimate + half)


def compare_sweeps(a: Folder, b: Folder, *, column: str, rows: int) -> dict[str, Any]:
    """Compare two sweeps; return plain values, NaN as None.

    Args:
        a: One sweep.
        b: The other.
        column: Rows are compared by this column.
        rows: Number of the largest differences to list.

    Raises:
        ConfigError: If the column cannot be compared, or a sweep has teams.
    """
    if column not in COLUMNS:
        raise ConfigError(f"--by {column}: allowed are {', '.join(COLUMNS)}")
    for folder in (a, b):
        if folder.plan.teams:
            raise ConfigError(
                f"{folder.path}: has teams, whose rows are evaders; use guidance sweep report for each"
            )
    matched = matched_pairs(a.plan, b.plan)
    paired = len(matched) > 0 and a.plan.axes == b.plan.axes
    rows_a = a.columns(COLUMNS)
    rows_b = b.columns(COLUMNS)
    groups = []
    largest = list[dict[str, Any]]()
    if not matched:
        groups.append(_group("all rows", "all rows", rows_a, rows_b, paired=False))
    for number_a, number_b in matched.items():
        first = _selected(rows_a, rows_a[PAIR] == number_a)
        second = _selected(rows_b, rows_b[PAIR] == number_b)
        if paired:
            # Rows whose grid point and seed occur in both, in order.
            cases_a = np.rec.fromarrays([first[POINT_NUMBER], first[SEED]])
            cases_b = np.rec.fromarrays([second[POINT_NUMBER], second[SEED]])
            _, indices_a, indices_b = np.intersect1d(
                cases_a, cases_b, assume_unique=True, return_indices=True
            )
            first = _selected(first, indices_a)
            second = _selected(second, indices_b)
            largest += _largest(first, second, column, rows)
        if first[ROW].size or second[ROW].size:
            name_a = " / ".join(a.plan.pairs[number_a])
            name_b = " / ".join(b.plan.pairs[number_b])
            groups.append(_group(name_a, name_b, first, second, paired=paired))
    # Rows with different ends first, then those with the largest difference.
    largest.sort(
        key=lambda row: (row["end_a"] == row["end_b"], -abs(np.nan_to_num(row["difference"])))
    )
    means = "Student's t of the paired differences" if paired else "Welch's t"
    comparison = {
        "paired": paired,
        "intervals": f"95 %: {means}",
        "groups": groups,
        "largest": largest[:rows],
    }
    return dict(plain(comparison))


def _selected(rows: Columns, selection: NDArray[Any]) -> Columns:
    """Return the rows of a mask or of indices."""
    return {name: column[selection] for name, column in rows.items()}


def matched_pairs(a: Plan, b: Plan) -> dict[int, int]:
    """Match the pairs of policies of two sweeps: by name if they share any, otherwise by place; empty if neither."""
    shared = {a.pairs.index(pair): b.pairs.index(pair) for pair in a.pairs if pair in b.pairs}
    if shared:
        return shared
    if len(a.pairs) != len(b.pairs):
        return {}
    return {number: number for number in range(len(a.pairs))}


def _group(name_a: str, name_b: str, a: Columns, b: Columns, *, paired: bool) -> dict[str, Any]:
    columns = {}
    for name in (CAPTURED, *COLUMNS):
        numbers_a = a[name]
        numbers_b = b[name]
        if paired:
            difference = mean(numbers_b - numbers_a)
        else:
            difference = difference_of_means(numbers_a, numbers_b)
        columns[name] = {
            "a": mean(numbers_a).estimate,
            "b": mean(numbers_b).estimate,
            "difference": difference,
        }
    return {
        "a": name_a,
        "b": name_b,
        "rows_a": a[ROW].size,
        "rows_b": b[ROW].size,
        "columns": columns,
    }


def _largest(a: Columns, b: Columns, column: str, count: int) -> list[dict[str, Any]]:
    """Return paired rows with different ends, then those with the largest differences."""
    difference = b[column] - a[column]
    size = np.nan_to_num(np.abs(difference))
    has_same_end = a[END] == b[END]
    order = np.lexsort((-size, has_same_end))[:count]
    differs = ~has_same_end | (size > 0.0)
    order = order[differs[order]]
    rows = []
    for index in order.tolist():
        value_a = a[column][index].item()
        value_b = b[column][index].item()
        row = {
            "row_a": a[ROW][index].item(),
            "row_b": b[ROW][index].item(),
            "end_a": a[END][index],
            "end_b": b[END][index],
            "column": column,
            "a": value_a,
            "b": value_b,
            "difference": value_b - value_a,
        }
        rows.append(row)
    return rows


def compare_outcomes(a: dict[str, Any], b: dict[str, Any]) -> dict[str, Any]:
    """Compare two outcomes column by column; the difference of values that are not numbers is None."""
    columns = {}
    for name, value_a in a.items():
        if name not in b:
            continue
        value_b = b[name]
        are_numbers = {type(value_a), type(value_b)} <= {int, float}
        difference = value_b - value_a if are_numbers else None
        columns[name] = {"a": value_a, "b": value_b, "difference": difference}
    return columns


def compare_teams(
    a: list[dict[str, Any]], b: list[dict[str, Any]]
) -> dict[str, dict[str, dict[str, Any]]]:
    """Compare the outcomes of two games of teams, evader by evader, by the evaders' numbers.

    Raises:
        ConfigError: If they have different evaders.
    """
    rows_a = {row["evader"]: row for row in a}
    rows_b = {row["evader"]: row for row in b}
    if rows_a.keys() != rows_b.keys():
        raise ConfigError(
            f"the outcomes are of {len(a)} and {len(b)} evaders: must be games of the same evaders"
        )
    return {
        f"evader {number}": compare_outcomes(row, rows_b[number]) for number, row in rows_a.items()
    }


def read_outcome(path: Path) -> dict[str, Any] | list[dict[str, Any]]:
    """Read an outcome that `guidance scenario run` wrote: a row, or of teams a row for each evader.

    Raises:
        ConfigError: If it cannot be read, or is something else.
    """
    try:
        outcome = json.loads(text_of(path, str(path), secret=False), parse_int=_integer)
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: not valid JSON ({error})") from error
    if isinstance(outcome, list):
        if outcome and all(_is_row(row, "evader") for row in outcome):
            return outcome
    elif _is_row(outcome):
        return dict(outcome)
    raise ConfigError(
        f"{path}: not an outcome; it must be an outcome.json of guidance scenario run or fly"
    )


def _integer(digits: str) -> int:
    value = int(digits)
    if not -(2**63) <= value < 2**63:
        raise ValueError("an integer has more than 64 bits")
    return value


def _is_row(row: Any, *further_columns: str) -> bool:  # noqa: ANN401 - whatever a file holds
    if not isinstance(row, dict):
        return False
    return {"end", "winner", "game_time_s", "run", *further_columns} <= row.keys()


def notes_of(a: str, b: str) -> Iterator[str]:
    """Say how the games of two kinds of runs differ.

    Args:
        a: How the one was run: "maths", "fast", "live" or "vehicle".
        b: How the other was run.
    """
    if (a == "maths") == (b == "maths"):
        return
    yield f"wind: {WIND_WORDS}"
    yield (
        "speed set: where the scenario names none, mathematics plays the ball, one speed in every direction, and a "
        "vehicle its own climb and descent (cylinder)"
    )
    yield "teams: mathematics captures points, vehicles capture on the stand-off disc"


def _outcome_in(path: Path) -> Path:
    """Return the outcome in the folder of a run; other paths as they are."""
    outcome = path / OUTCOME
    return outcome if outcome.is_file() else path


def compare_paths(a: Path, b: Path, *, column: str, rows: int, as_json: bool) -> None:
    """Compare two sweeps' folders or two outcomes' files, and print the comparison.

    Args:
        a: A sweep's folder, or an outcome's JSON file or folder.
        b: Another of the same kind.
        column: Rows of sweeps are compared by this column.
        rows: Number of the largest differences to list.
        as_json: Print JSON.

    Raises:
        ConfigError: If they are neither, or one of each.
    """
    screen = console(stderr=as_json)
    screen.print(f"A {a}\nB {b}", soft_wrap=True)
    a = _outcome_in(a)
    b = _outcome_in(b)
    if a.is_dir() != b.is_dir():
        raise ConfigError(f"{a}, {b}: must be two outcomes or two sweeps, not one of each")
    compared: Mapping[str, Any]
    parts: Iterable[Table | Text]
    if a.is_dir():
        folders = read_folder(a), read_folder(b)
        compared = compare_sweeps(*folders, column=column, rows=rows)
        parts = _sweeps(compared)
        runs = [folder.plan.way for folder in folders]
    else:
        of_a = read_outcome(a)
        of_b = read_outcome(b)
        if isinstance(of_a, dict) and isinstance(of_b, dict):
            compared = compare_outcomes(of_a, of_b)
            parts = _outcomes(compared)
            runs = [of_a["run"], of_b["run"]]
        elif isinstance(of_a, list) and isinstance(of_b, list):
            compared = compare_teams(of_a, of_b)
            of_evaders = list[Table | Text]()
            for name, columns in compared.items():
                of_evaders.append(Text(f"\n{name}", "italic"))
                of_evaders.extend(_outcomes(columns))
            parts = of_evaders
            runs = [of_a[0]["run"], of_b[0]["run"]]
        else:
            raise ConfigError(f"{a}, {b}: must be two outcomes of teams or none, not one of each")
    for note in notes_of(*runs):
        screen.print(note, style="italic", soft_wrap=True)
    if as_json:
        sys.stdout.write(json.dumps(compared, indent=1) + "\n")
        return
    for part in parts:
        screen.print(part)


def _valued(compared: Mapping[str, Mapping[str, Any]]) -> list[tuple[Any, ...]]:
    """Return name, A, B and difference of the columns with a value."""
    rows: list[tuple[Any, ...]] = []
    for name, row in compared.items():
        has_value = row["a"] is not None or row["b"] is not None
        if has_value:
            rows.append((name, *row.values()))
    return rows


def _outcomes(compared: Mapping[str, Mapping[str, Any]]) -> Iterator[Table]:
    """Yield a table of numbers, and one of texts, whose cells may be long."""
    rows = [tuple(map(cell, row)) for row in _valued(compared)]
    numbers = [row for row in rows if row[3] != "-"]
    texts = [row[:3] for row in rows if row[3] == "-"]
    yield text_table(("column", "A", "B", "B − A"), numbers)
    yield text_table(("column", "A", "B"), texts, left=range(3), title=" ")


def _sweeps(compared: Mapping[str, Any]) -> Iterator[Table | Text]:
    for group in compared["groups"]:
        count = f"{group['rows_a']} and {group['rows_b']}"
        kind = "independent rows (the sweeps vary different values)"
        if compared["paired"]:
            count = group["rows_a"]
            kind = "paired rows"
        names = _both(group, "")
        yield Text(f"\n{names}: {count} {kind}", "italic")
        rows = []
        for name, a, b, difference in _valued(group["columns"]):
            rows.append((name, cell(a, 4), cell(b, 4), spread(difference)))
        yield text_table(("mean of", "A", "B", "B − A (95 %)"), rows)
    largest = compared["largest"]
    if largest:
        column = largest[0]["column"]
        yield Text(f"\nthe rows that differ most in {column}", "italic")
        cells = []
        for row in largest:
            numbers = _both(row, "row_")
            ends = _both(row, "end_")
            values = [cell(row[key]) for key in ("a", "b", "difference")]
            cells.append((numbers, ends, *values))
        yield text_table(("row", "end", "A", "B", "B − A"), cells, left=(0, 1))


def _both(values: Mapping[str, Any], prefix: str) -> str:
    """Return a value of A, and that of B if it is another."""
    a = values[f"{prefix}a"]
    b = values[f"{prefix}b"]
    return str(a) if a == b else f"{a}, in B {b}"


def spread(interval: Mapping[str, float | None], rounding: float = _ROUNDING) -> str:
    """Return an estimate in three digits, with half the width of its interval if that is known.

    Args:
        interval: As plain values.
        rounding: Smaller numbers are rounding errors.
    """
    low = interval["low"]
    high = interval["high"]
    estimate = cell(interval["estimate"], 3, rounding)
    if low is None or high is None:
        return estimate
    half = 0.5 * (high - low)
    return f"{estimate} ± {half:.2g}" if half > rounding else estimate


def cell(value: Any, digits: int = 5, rounding: float = _ROUNDING) -> str:  # noqa: ANN401 - any column
    """Return a value in a table: numbers smaller than `rounding` as 0, none as "-"."""
    if isinstance(value, float):
        rounded = 0.0 if abs(value) < rounding else value
        return f"{rounded:.{digits}g}"
    if isinstance(value, list):
        return ", ".join(map(str, value)) if value else "none"
    return "-" if value is None else str(value)
