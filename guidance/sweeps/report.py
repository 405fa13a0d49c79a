"""`guidance sweep report`: results by policies and by swept key, in the terminal, as JSON and as pictures."""

import itertools
import json
import re
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import tomlkit
from rich.console import Console

from guidance.files import private_folder, writing
from guidance.game.arrays import FloatArray
from guidance.log.codec import plain
from guidance.screen import console, text_table
from guidance.sweeps.axes import Axis
from guidance.sweeps.compare import Interval, cell, finite_numbers, mean, spread, success_share
from guidance.sweeps.drawing import Key, draw_all, key_label
from guidance.sweeps.folder import (
    CAPTURED,
    END,
    PAIR,
    POINT_NUMBER,
    Columns,
    read_folder,
    write_whole,
)
from guidance.sweeps.plan import ROW, Plan
from guidance.sweeps.rows import scenario_of

QUANTILES: Final = (0.05, 0.25, 0.5, 0.75, 0.95, 0.99, 1.0)
_SHOWN: Final = {"5 %": "0.05", "median": "0.5", "95 %": "0.95", "max": "1"}
_BINS: Final = 10
_ROUNDING: Final = 5e-5
"""Smaller regrets are rounding errors."""
_COLUMNS: Final = ("predicted_winner", "regret", "game_time_s", "reason")
_OF_GAME: Final = {
    "pe": ("predicted_capture_time_s", "distance_to_disc_m"),
    "tad": ("predicted_evader_to_target_m", "evader_to_target_m"),
}
"""Columns of the predicted value, and of the distance that orders lost games."""
Rows = list[tuple[str, ...]]


def write_sweep_report(path: Path, out: Path, *, worst: int, as_json: bool = False) -> list[Path]:
    """Print a sweep's tables, write its report, and return the files.

    Args:
        path: Folder of the sweep.
        out: Folder of the report.
        worst: Number of scenario files for each pair of policies, of the games with the worst results.
        as_json: Print the JSON instead of the tables.

    Raises:
        ConfigError: If the folder is not that of a sweep, or empty.
        OutputError: If the report cannot be written.
    """
    folder = read_folder(path)
    plan = folder.plan
    swept: list[str] = []
    for axis in folder.plan.axes:
        swept.extend(axis.columns())
    # The predicted value, and the distance that orders lost games.
    columns_of_game = ("predicted", "evader_to_target_m")
    if not folder.plan.teams:
        columns_of_game = _OF_GAME[folder.plan.scenario["game"]]
    predicted, away_m = columns_of_game
    rows: Columns = folder.columns([*swept, *_COLUMNS, predicted, away_m])
    rows["predicted"] = rows[predicted]
    rows["away_m"] = rows[away_m]
    keys: list[Key] = []
    for axis in plan.axes:
        keys.extend(_keys(plan, axis, rows))
    with writing(f"--out {out}"):
        private_folder(out)
        cases = list(_written_worst(plan, rows, out, worst))
        report = summed_up(plan, rows, keys, cases)
        text = json.dumps(report, indent=1) + "\n"
        write_whole(out / "report.json", text.encode())
        regrets = []
        for number in range(len(plan.pairs)):
            of_pair = rows[PAIR] == number
            regrets.append(finite_numbers(rows["regret"][of_pair]))
        pictures = draw_all(report, keys, regrets, out)
    if as_json:
        sys.stdout.write(text)
    else:
        _show(console(), report, keys)
    case_files = [out / case["file"] for case in cases]
    return [out / "report.json", *pictures, *case_files]


def _keys(plan: Plan, axis: Axis, rows: Columns) -> Iterator[Key]:
    """Yield groups of rows: by the values of a grid, or by ten even bins of each random number."""
    centres: Sequence[float]
    if axis.random is not None:
        for column in axis.columns():
            numbers = rows[column]
            if numbers.dtype.kind == "f":
                edges = np.linspace(numbers.min(), numbers.max(), _BINS + 1)
                bounds = itertools.pairwise(edges.tolist())
                labels = [f"{low:.4g} to {high:.4g}" for low, high in bounds]
                centres = (0.5 * (edges[1:] + edges[:-1])).tolist()
                inner_edges = edges[1:-1]
                places = np.searchsorted(inner_edges, numbers, side="right")
            else:
                texts, places = np.unique(numbers.astype(str), return_inverse=True)
                labels = texts.tolist()
                centres = range(len(labels))
            yield Key(column, labels, centres, places, grid=False)
    elif len(axis.values) > 1:
        number = plan.axes.index(axis)
        places = plan.on_axes(rows[POINT_NUMBER])[number]
        labels = [
            f"{value:.4g}" if isinstance(value, float) else str(value) for value in axis.values
        ]
        centres = range(len(labels))
        are_numbers = all(isinstance(value, (int, float)) for value in axis.values)
        if are_numbers:
            centres = axis.values
        yield Key(axis.key, labels, centres, places, grid=True)


def summed_up(
    plan: Plan, rows: Columns, keys: Sequence[Key], worst: Sequence[dict[str, Any]]
) -> dict[str, Any]:
    """Return the report as plain values; None if unknown.

    Args:
        plan: Of the sweep.
        rows: Its rows.
        keys: Groups of the rows.
        worst: Rows with the worst results.
    """
    grid = [key for key in keys if key.grid]
    by_key = {key.column: _group_summaries(plan, rows, [key]) for key in keys}
    by_point: dict[int, list[dict[str, Any]]] = {}
    if len(grid) == 2:
        by_point = _group_summaries(plan, rows, grid)
    everything = _group_summaries(plan, rows, [])
    policies = []
    for number, pair in enumerate(plan.pairs):
        if number not in everything:
            continue
        of_pair = rows[PAIR] == number
        ends = Counter(rows[END][of_pair].tolist())
        results = {**pair._asdict(), "ends": ends, **everything[number][0]}
        results["by_key"] = {column: groups[number] for column, groups in by_key.items()}
        results["by_point"] = by_point.get(number, [])
        policies.append(results)
    scenario_title = plan.scenario["title"]
    # An example of each reason; its numbers differ from row to row.
    is_invalid = rows[END] == "invalid"
    has_failed = rows[END] == "failed"
    is_wrong = is_invalid | has_failed
    numbers = rows[ROW][is_wrong].tolist()
    reasons: dict[str, dict[str, Any]] = {}
    for number, reason in zip(numbers, rows["reason"][is_wrong], strict=True):
        kind = re.sub(r"-?\d+(\.\d+)?(e[-+]?\d+)?", "#", reason)
        example = {"rows": 0, "row": number, "reason": reason}
        reasons.setdefault(kind, example)["rows"] += 1
    report = {
        "title": plan.title if plan.title else scenario_title,
        "scenario": scenario_title,
        "as": plan.way,
        "digest": plan.digest,
        "rows": rows[ROW].size,
        "rows_planned": plan.rows,
        "teams": plan.teams,
        "unit": "s" if plan.scenario["game"] == "pe" else "m",
        "intervals": "95 %, of random draws only: Wilson's for probabilities, Student's t for means",
        "policies": policies,
        "invalid": sorted(reasons.values(), key=lambda reason: -int(reason["rows"])),
        "worst": worst,
    }
    return dict(plain(report))


def _group_summaries(
    plan: Plan, rows: Columns, keys: Sequence[Key]
) -> dict[int, list[dict[str, Any]]]:
    """Return for every pair of policies the summaries of its groups, in the order of the keys' values."""
    # No interval if the plan varies more keys of its grid than these.
    varied = [axis for axis in plan.axes if len(axis.values) > 1]
    grid = [key for key in keys if key.grid]
    with_intervals = not (plan.teams or len(varied) > len(grid))
    # A group has one pair of policies, and one place on each key.
    columns = [rows[name] for name in (CAPTURED, "regret", "predicted", "game_time_s")]
    numbers = np.stack(columns, axis=-1)
    shape = (len(plan.pairs), *(len(key.labels) for key in keys))
    group = np.ravel_multi_index((rows[PAIR], *(key.places for key in keys)), shape)
    order = np.argsort(group, kind="stable")
    groups, begins = np.unique(group[order], return_index=True)
    games_of = np.split(numbers[order], begins[1:])
    groups_of: dict[int, list[dict[str, Any]]] = {}
    for number, games in zip(groups.tolist(), games_of, strict=True):
        pair, *places = map(int, np.unravel_index(number, shape))
        summary: dict[str, Any] = {}
        if keys:
            places_of = zip(keys, places, strict=True)
            summary["at"] = {key.column: key.labels[index] for key, index in places_of}
        summary.update(_summary(plan, games, with_intervals=with_intervals))
        groups_of.setdefault(pair, []).append(summary)
    return groups_of


def _summary(plan: Plan, games: FloatArray, *, with_intervals: bool) -> dict[str, Any]:
    """Return captures and regrets of a group of games (n, 4): captured, regret, predicted value and time."""
    captures, regrets, predicted, times_s = games.T
    captures = finite_numbers(captures)
    regrets = finite_numbers(regrets)
    captured = success_share(int(captures.sum()), captures.size)
    regret = mean(regrets)
    has_draws = any(axis.random is not None for axis in plan.axes)
    distinct_times_s = np.unique(finite_numbers(times_s))
    are_equal = not has_draws and distinct_times_s.size == 1
    if are_equal or not with_intervals:
        captured = Interval(captured.estimate)
        regret = Interval(regret.estimate)
    quantiles: dict[str, float] = {}
    if regrets.size:
        values = np.quantile(regrets, QUANTILES).tolist()
        quantiles = {f"{part:g}": value for part, value in zip(QUANTILES, values, strict=True)}
    return {
        "games": captures.size,
        "capture": captured,
        "predicted_mean": float(predicted.mean()),
        "regret_games": regrets.size,
        "regret_mean": regret,
        "regret_quantiles": quantiles,
    }


def _written_worst(plan: Plan, rows: Columns, out: Path, count: int) -> Iterator[dict[str, Any]]:
    """Write the worst rows of every pair of policies as `worst-001.toml`, `worst-002.toml` …, the worst first.

    A game that the pursuer should have won and lost is worse than any regret; the evader's distance from its
    target (TAD) or the pursuer's from the disc (PE) orders it.
    """
    for number, index in enumerate(_worst(plan, rows, count), 1):
        row = int(rows[ROW][index])
        end = str(rows[END][index])
        scenario = scenario_of(plan, row)
        if isinstance(scenario, str):
            continue
        names = plan.pairs[rows[PAIR][index]]
        document = scenario.model_dump(mode="json", exclude={"expect"}, exclude_none=True)
        sweep = plan.digest[:12]
        policies = " against ".join(names)
        document["description"] = f"Row {row} of the sweep {sweep}, {policies}: {end}."
        path = out / f"worst-{number:03d}.toml"
        write_whole(path, tomlkit.dumps(document).encode())
        regret = float(rows["regret"][index])
        result = {"row": row, "end": end, "regret": regret}
        yield {"file": path.name, **result, **names._asdict()}


def _worst(plan: Plan, rows: Columns, count: int) -> list[int]:
    """Return the indices of the worst `count` rows of every pair of policies, the worst first."""
    pair = rows[PAIR]
    end = rows[END]
    regret = rows["regret"]
    should_win = rows["predicted_winner"] == "pursuer"
    lost = should_win & (end != CAPTURED) & (end != "invalid")
    badness = np.nan_to_num(np.where(lost, rows["away_m"], regret))
    order = np.lexsort((rows[ROW], -badness, ~lost))
    is_ordered = lost | np.isfinite(regret)
    order = order[is_ordered[order]]
    worst_ranks = []
    for number in range(len(plan.pairs)):
        ranks = np.flatnonzero(pair[order] == number)
        worst_ranks.append(ranks[:count])
    chosen_ranks = np.sort(np.concatenate(worst_ranks))
    return list(order[chosen_ranks.astype(int)].tolist())


def _show(target: Console, report: Mapping[str, Any], keys: Sequence[Key]) -> None:
    unit = report["unit"]
    grid = [key for key in keys if key.grid]
    count = report["rows"]
    planned = report["rows_planned"]
    if report["teams"]:
        row_words = f"{count} evaders of {planned} games"
    else:
        row_words = f"{count} of {planned} rows"
    target.print(f"{row_words}, as {report['as']}")
    target.print(
        f"regret, {unit}: the pursuer's loss against the game's value; below 0, the evader's"
    )
    ends = []
    regrets = []
    for policies in report["policies"]:
        counts = sorted(policies["ends"].items())
        others = [f"{count} {end}" for end, count in counts if end != CAPTURED]
        other_ends = ", ".join(others) if others else "-"
        games = str(policies["games"])
        captured = _share(policies["capture"])
        ends.append((_names(policies), games, captured, other_ends))
        regrets.append((_names(policies), *_regret(policies, _SHOWN)))
    end_headings = ("policies", "games", "captured", "other ends")
    target.print(text_table(end_headings, ends, left=(0, 3)))
    target.print()
    target.print(text_table(("policies", "mean regret", *_SHOWN), regrets))
    for policies in report["policies"]:
        for title, headings, rows in _by_key(policies, grid):
            target.print(f"\n{_names(policies)}{title}", style="italic")
            if len({row[1:] for row in rows}) == 1:
                rows = [("all", *rows[0][1:])]  # noqa: PLW2901 - equal rows are shown once
            target.print(text_table(("", *headings), rows, left=()))
    for invalid in report["invalid"]:
        example = f"as row {invalid['row']}: {invalid['reason']}"
        target.print(
            f"\n{invalid['rows']} rows are invalid or failed, {example}",
            soft_wrap=True,
        )


def _names(policies: Mapping[str, Any]) -> str:
    return f"{policies['pursuer']} against {policies['evader']}"


def _by_key(
    policies: Mapping[str, Any], grid: Sequence[Key]
) -> Iterator[tuple[str, Sequence[str], Rows]]:
    """Yield title, headings and rows of the maps over two keys, or of the curve over each key."""
    if len(grid) == 2:
        first, second = grid
        down_label = key_label(first.column)
        across_label = key_label(second.column)
        keys = f"{down_label} (down) and {across_label} (across)"
        measures = (("capture", "captured", _percent), ("regret_mean", "mean regret", _number))
        for measure, name, cell_of in measures:
            cells = {}
            for point in policies["by_point"]:
                labels = tuple(point["at"].values())
                cells[labels] = cell_of(point[measure]["estimate"])
            rows = []
            for down in first.labels:
                cells_across = [cells.get((down, across), "") for across in second.labels]
                rows.append((down, *cells_across))
            yield f": {name} by {keys}", second.labels, rows
    else:
        names = list(_SHOWN)[:3]
        headings = ("captured", "mean regret", *names)
        for key in grid:
            column = key.column
            rows = []
            for group in policies["by_key"][column]:
                label = group["at"][column]
                captured = _share(group["capture"])
                rows.append((label, captured, *_regret(group, names)))
            yield f", by {key_label(column)}", headings, rows


def _regret(group: Mapping[str, Any], names: Iterable[str]) -> tuple[str, ...]:
    """Return the mean regret with half the width of its interval, if that is known, and some quantiles."""
    regret_quantiles = group["regret_quantiles"]
    quantiles = [regret_quantiles.get(_SHOWN[name]) for name in names]
    average = spread(group["regret_mean"], _ROUNDING)
    return (average, *map(_number, quantiles))


def _share(interval: Mapping[str, float | None]) -> str:
    low = interval["low"]
    high = interval["high"]
    estimate = _percent(interval["estimate"])
    if low is None or high is None:
        return estimate
    low_percent = 100.0 * low
    high_percent = 100.0 * high
    return f"{estimate} ({low_percent:.0f}-{high_percent:.0f})"


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100.0 * share:.3g} %"


def _number(value: float | None) -> str:
    """Return three digits; rounding errors of zero as 0."""
    return cell(value, 3, _ROUNDING)
