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
import tomli_w
from rich.console import Console

from guidance.files import private_folder, writing
from guidance.log.codec import plain
from guidance.screen import console, sheet
from guidance.sweeps.axes import Axis
from guidance.sweeps.compare import Interval, cell, known, mean, share, spread
from guidance.sweeps.drawing import Key, draw_all, key_label
from guidance.sweeps.folder import CAPTURED, END, PAIR, POINT, Columns, read_folder, write_whole
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


def write_report(path: Path, out: Path, *, worst: int, as_json: bool = False) -> list[Path]:
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
    swept = [column for axis in plan.axes for column in axis.columns()]
    of_game = ("predicted", "evader_to_target_m") if plan.teams else _OF_GAME[plan.scenario["game"]]
    rows = folder.columns([*swept, *_COLUMNS, *of_game])
    rows["predicted"], rows["away_m"] = (rows[name] for name in of_game)
    keys = [key for axis in plan.axes for key in _keys(plan, axis, rows)]
    with writing(f"--out {out}"):
        private_folder(out)
        cases = list(_written_worst(plan, rows, out, worst))
        report = summed_up(plan, rows, keys, cases)
        text = json.dumps(report, indent=1) + "\n"
        write_whole(out / "report.json", text.encode())
        regrets = [known(rows["regret"][rows[PAIR] == number]) for number in range(len(plan.pairs))]
        pictures = draw_all(report, keys, regrets, out)
    if as_json:
        sys.stdout.write(text)
    else:
        _show(console(), report, keys)
    return [out / "report.json", *pictures, *(out / case["file"] for case in cases)]


def _keys(plan: Plan, axis: Axis, rows: Columns) -> Iterator[Key]:
    """Yield groups of rows: by the values of a grid, or by ten even bins of each random number."""
    if axis.random is None and len(axis.values) > 1:
        places = plan.on_axes(rows[POINT])[plan.axes.index(axis)]
        labels = [
            f"{value:.4g}" if isinstance(value, float) else str(value) for value in axis.values
        ]
        centres = (
            axis.values
            if all(isinstance(value, (int, float)) for value in axis.values)
            else range(len(labels))
        )
        yield Key(axis.key, labels, centres, places, grid=True)
    for column in axis.columns() if axis.random is not None else ():
        numbers = rows[column]
        if numbers.dtype.kind != "f":
            texts, places = np.unique(numbers.astype(str), return_inverse=True)
            yield Key(column, texts.tolist(), range(len(texts)), places, grid=False)
            continue
        edges = np.linspace(numbers.min(), numbers.max(), _BINS + 1)
        labels = [f"{low:.4g} to {high:.4g}" for low, high in itertools.pairwise(edges.tolist())]
        places = np.searchsorted(edges[1:-1], numbers, side="right")
        yield Key(column, labels, (0.5 * (edges[1:] + edges[:-1])).tolist(), places, grid=False)


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
    by_key = {key.column: _groups(plan, rows, [key]) for key in keys}
    by_point = _groups(plan, rows, grid) if len(grid) == 2 else {}
    everything = _groups(plan, rows, [])
    return dict(plain({
        "title": plan.title or plan.scenario["title"],
        "scenario": plan.scenario["title"],
        "as": plan.way,
        "digest": plan.digest,
        "rows": rows[ROW].size,
        "rows_planned": plan.rows,
        "teams": plan.teams,
        "unit": "s" if plan.scenario["game"] == "pe" else "m",
        "intervals": "95 %, of random draws only: Wilson's for probabilities, Student's t for means",
        "policies": [
            {**pair._asdict(), "ends": Counter(rows[END][rows[PAIR] == number].tolist()), **everything[number][0]}
            | {"by_key": {column: groups[number] for column, groups in by_key.items()}}
            | {"by_point": by_point.get(number, [])}
            for number, pair in enumerate(plan.pairs)
            if number in everything
        ],
        "invalid": _reasons(rows),
        "worst": worst,
    }))  # fmt: skip


def _groups(plan: Plan, rows: Columns, keys: Sequence[Key]) -> dict[int, list[dict[str, Any]]]:
    """Return for every pair of policies the summaries of its groups, in the order of the keys' values."""
    numbers = np.stack(
        [rows[name] for name in (CAPTURED, "regret", "predicted", "game_time_s")], axis=-1
    )
    shape = (len(plan.pairs), *(len(key.labels) for key in keys))
    group = np.ravel_multi_index((rows[PAIR], *(key.places for key in keys)), shape)
    mixed = sum(len(axis.values) > 1 for axis in plan.axes) > len([key for key in keys if key.grid])
    groups_of: dict[int, list[dict[str, Any]]] = {}
    order = np.argsort(group, kind="stable")
    groups, begins = np.unique(group[order], return_index=True)
    for number, members in zip(groups.tolist(), np.split(numbers[order], begins[1:]), strict=True):
        pair, *places = np.unravel_index(number, shape)
        captures, regrets, predicted, times_s = members.T
        captures = known(captures)
        regrets = known(regrets)
        drawn = (
            any(axis.random is not None for axis in plan.axes)
            or np.unique(known(times_s)).size != 1
        )
        captured = share(int(captures.sum()), captures.size)
        regret = mean(regrets)
        if not drawn or mixed or plan.teams:
            captured = Interval(captured.estimate)
            regret = Interval(regret.estimate)
        quantiles = np.quantile(regrets, QUANTILES).tolist() if regrets.size else []
        summary = {
            "games": captures.size,
            "capture": captured,
            "predicted_mean": float(predicted.mean()),
            "regret_games": regrets.size,
            "regret_mean": regret,
            "regret_quantiles": {
                f"{quantile:g}": value
                for quantile, value in zip(QUANTILES, quantiles, strict=False)
            },
        }
        at = {key.column: key.labels[index] for key, index in zip(keys, places, strict=True)}
        groups_of.setdefault(int(pair), []).append(({"at": at} if keys else {}) | summary)
    return groups_of


def _reasons(rows: Columns) -> list[dict[str, Any]]:
    """Return why rows are invalid or failed, with an example of each reason; its numbers differ from row to row."""
    wrong = (rows[END] == "invalid") | (rows[END] == "failed")
    reasons: dict[str, dict[str, Any]] = {}
    for row, reason in zip(rows[ROW][wrong].tolist(), rows["reason"][wrong], strict=True):
        kind = re.sub(r"-?\d+(\.\d+)?(e[-+]?\d+)?", "#", reason)
        reasons.setdefault(kind, {"rows": 0, "row": row, "reason": reason})["rows"] += 1
    return sorted(reasons.values(), key=lambda reason: -int(reason["rows"]))


def _written_worst(plan: Plan, rows: Columns, out: Path, count: int) -> Iterator[dict[str, Any]]:
    """Write the worst rows of every pair of policies as `worst-001.toml`, `worst-002.toml` …, the worst first.

    A game that the pursuer should have won and lost is worse than any regret; the evader's distance from its
    target (TAD) or the pursuer's from the disc (PE) orders it.
    """
    row, pair, end, regret = (rows[name] for name in (ROW, PAIR, END, "regret"))
    lost = (rows["predicted_winner"] == "pursuer") & (end != CAPTURED) & (end != "invalid")
    badness = np.nan_to_num(np.where(lost, rows["away_m"], regret))
    order = np.lexsort((row, -badness, ~lost))
    order = order[(lost | np.isfinite(regret))[order]]
    best = np.sort(
        np.concatenate(
            [np.flatnonzero(pair[order] == number)[:count] for number in range(len(plan.pairs))]
        )
    )
    for number, place in enumerate(order[best.astype(int)].tolist(), 1):
        scenario = scenario_of(plan, int(row[place]))
        names = plan.pairs[pair[place]]
        path = out / f"worst-{number:03d}.toml"
        about = f"Row {row[place]} of the sweep {plan.digest[:12]}, {' against '.join(names)}: {end[place]}."
        if not isinstance(scenario, str):
            document = {
                **scenario.model_dump(mode="json", exclude={"expect"}, exclude_none=True),
                "description": about,
            }
            write_whole(path, tomli_w.dumps(document).encode())
            result = {
                "row": int(row[place]),
                "end": str(end[place]),
                "regret": float(regret[place]),
            }
            yield {"file": path.name, **result, **names._asdict()}


def _show(target: Console, report: Mapping[str, Any], keys: Sequence[Key]) -> None:
    unit = report["unit"]
    grid = [key for key in keys if key.grid]
    count = report["rows"]
    planned = report["rows_planned"]
    counted = (
        f"{count} evaders of {planned} games" if report["teams"] else f"{count} of {planned} rows"
    )
    target.print(f"{counted}, as {report['as']}")
    target.print(
        f"regret, {unit}: the pursuer's loss against the game's value; below 0, the evader's"
    )
    ends = []
    regrets = []
    for invalid in report["policies"]:
        others = ", ".join(
            f"{count} {end}" for end, count in sorted(invalid["ends"].items()) if end != CAPTURED
        )
        ends.append(
            (_names(invalid), str(invalid["games"]), _share(invalid["capture"]), others or "-")
        )
        regrets.append((_names(invalid), *_regret(invalid, _SHOWN)))
    target.print(sheet(("policies", "games", "captured", "other ends"), ends, left=(0, 3)))
    target.print()
    target.print(sheet(("policies", "mean regret", *_SHOWN), regrets))
    for invalid in report["policies"]:
        for title, headings, rows in _by_key(invalid, grid):
            target.print(f"\n{_names(invalid)}{title}", style="italic")
            equal = len({row[1:] for row in rows}) == 1
            target.print(
                sheet(("", *headings), [("all", *rows[0][1:])] if equal else rows, left=())
            )
    for invalid in report["invalid"]:
        target.print(
            f"\n{invalid['rows']} rows are invalid or failed, as row {invalid['row']}: {invalid['reason']}",
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
        keys = f"{key_label(first.column)} (down) and {key_label(second.column)} (across)"
        for measure, name, cell_of in (
            ("capture", "captured", _percent),
            ("regret_mean", "mean regret", _number),
        ):
            cells = {
                tuple(point["at"].values()): cell_of(point[measure]["estimate"])
                for point in policies["by_point"]
            }
            rows = [
                (down, *(cells.get((down, across), "") for across in second.labels))
                for down in first.labels
            ]
            yield f": {name} by {keys}", second.labels, rows
        return
    names = list(_SHOWN)[:3]
    for column in (key.column for key in grid):
        groups = policies["by_key"][column]
        rows = [
            (group["at"][column], _share(group["capture"]), *_regret(group, names))
            for group in groups
        ]
        yield f", by {key_label(column)}", ("captured", "mean regret", *names), rows


def _regret(group: Mapping[str, Any], names: Iterable[str]) -> tuple[str, ...]:
    """Return the mean regret with half the width of its interval, if that is known, and some quantiles."""
    quantiles = (group["regret_quantiles"].get(_SHOWN[name]) for name in names)
    return (spread(group["regret_mean"], _ROUNDING), *map(_number, quantiles))


def _share(interval: Mapping[str, float | None]) -> str:
    low = interval["low"]
    high = interval["high"]
    reach = "" if low is None or high is None else f" ({100.0 * low:.0f}-{100.0 * high:.0f})"
    return _percent(interval["estimate"]) + reach


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100.0 * share:.3g} %"


def _number(value: float | None) -> str:
    """Return three digits; rounding errors of zero as 0."""
    return cell(value, 3, _ROUNDING)
