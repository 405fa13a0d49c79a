"""`guidance sweep report`: what a sweep came to, for each pair of policies, in a table, as JSON and in pictures."""

import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from guidance.errors import OutputError
from guidance.files import private_folder
from guidance.log.codec import plain
from guidance.screen import console, sheet
from guidance.sweeps.drawing import draw_all
from guidance.sweeps.folder import Folder, read_folder, write_whole
from guidance.sweeps.statistics import mean, share
from guidance.sweeps.tally import QUANTILES, Tally, Worst, tallied, write_worst


def write_report(path: Path, out: Path, *, worst: int, as_json: bool = False) -> list[Path]:
    """Print a sweep's table, write its report, and return the files.

    Args:
        path: Folder of the sweep.
        out: Folder of the report.
        worst: How many of the worst games of each pair of policies get a scenario file.
        as_json: Whether the summary is printed as JSON instead of the table.

    Raises:
        ConfigError: If the folder is no sweep's, or empty.
        OutputError: If the report cannot be written.
    """
    folder = read_folder(path)
    tallies = tallied(folder, worst=worst)
    unit = "s" if folder.plan.scenario["game"] == "pe" else "m"
    title = folder.plan.sweep.title or str(folder.plan.scenario["title"])
    try:
        private_folder(out)
        cases = list(write_worst(folder, tallies, out))
        summary = summed_up(folder, tallies, cases, unit)
        write_whole(out / "report.json", (json.dumps(summary, indent=1) + "\n").encode())
        pictures = draw_all(tallies, cases, title=f"{title}, {folder.plan.way}", unit=unit, out=out)
    except OSError as error:
        raise OutputError(f"--out {out}: cannot be written ({error.strerror}); choose another folder") from error
    if as_json:
        sys.stdout.write(json.dumps(summary, indent=1) + "\n")
    else:
        _show(console(), folder, tallies, unit)
    return [out / "report.json", *pictures, *(case.path for case in cases)]


def summed_up(folder: Folder, tallies: Sequence[Tally], cases: Sequence[Worst], unit: str) -> dict[str, Any]:
    """Return the report as plain values; what is not known is null.

    Args:
        folder: The sweep.
        tallies: One a pair of policies.
        cases: The rows that went worst.
        unit: Of the regret, `s` or `m`.
    """
    summary: dict[str, Any] = plain(
        {
            "title": folder.plan.sweep.title,
            "scenario": folder.plan.scenario["title"],
            "as": folder.plan.way,
            "digest": folder.plan.digest,
            "rows": sum(tally.rows for tally in tallies),
            "rows_planned": folder.plan.rows,
            "unit": unit,
            "intervals": "95 %: Wilson's for probabilities, Student's t for means",
            "policies": [_of_pair(tally) for tally in tallies],
            "worst": [
                {
                    "file": case.path.name,
                    "row": case.row,
                    "pursuer": case.tally.pair.pursuer,
                    "evader": case.tally.pair.evader,
                    "end": case.end,
                    "regret": case.regret,
                }
                for case in cases
            ],
        }
    )
    return summary


def _of_pair(tally: Tally) -> dict[str, Any]:
    quantiles = zip(QUANTILES, tally.quantiles(), strict=False)
    return {
        "pursuer": tally.pair.pursuer,
        "evader": tally.pair.evader,
        "rows": tally.rows,
        "games": tally.valid,
        "ends": dict(tally.ends),
        "capture": share(tally.ends["captured"], tally.valid),
        "predicted_mean": mean(tally.predicted),
        "regret_games": tally.regret.count,
        "regret_mean": mean(tally.regret),
        "regret_quantiles": {f"{quantile:g}": value for quantile, value in quantiles},
        "capture_by_key": {
            bins.column: [
                {"at": label, "games": int(games), **share(int(captures), int(games))._asdict()}
                for label, games, captures in zip(bins.labels, tally.games[place], tally.captures[place], strict=True)
            ]
            for place, bins in enumerate(tally.bins)
        },
    }


def _show(there: Console, folder: Folder, tallies: Sequence[Tally], unit: str) -> None:
    rows = sum(tally.rows for tally in tallies)
    counted = (
        f"{rows} evaders of {folder.plan.rows} games" if folder.plan.teams else f"{rows} of {folder.plan.rows} rows"
    )
    there.print(f"{counted}, as {folder.plan.way}; regret in {unit}")
    ends, regrets = [], []
    for tally in tallies:
        captured, regret = share(tally.ends["captured"], tally.valid), mean(tally.regret)
        others = ", ".join(f"{count} {end}" for end, count in sorted(tally.ends.items()) if end != "captured")
        reach = f"{captured.low:.4f} to {captured.high:.4f}"
        policies = [str(policy) for policy in tally.pair]
        ends.append((*policies, str(tally.valid), f"{captured.estimate:.4f}", reach, others or "-"))
        reach = f"{_short(regret.low)} to {_short(regret.high)}"
        quantiles = [_short(value) for value in tally.quantiles()] or ["-"] * len(QUANTILES)
        regrets.append((*policies, _short(regret.estimate), reach, *quantiles))
    headings = ("pursuer", "evader", "mean regret", "95 %", *(_percent(one) for one in QUANTILES))
    there.print(sheet(("pursuer", "evader", "games", "captured", "95 %", "other rows"), ends, left=(0, 1)))
    there.print(sheet(headings, regrets, left=(0, 1)))


def _short(value: float) -> str:
    """Four digits, and nothing of what rounding leaves of a zero."""
    return "-" if math.isnan(value) else f"{0.0 if abs(value) < 5e-5 else value:.4g}"


def _percent(quantile: float) -> str:
    return "max" if quantile == 1.0 else f"{100.0 * quantile:g} %"
