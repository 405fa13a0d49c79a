"""`python -m tests faults`: flights with faults in virtual time, checked against the mock's true state.

Geometry, autopilot, game, wind and faults are drawn from the seed and the flight's number, so that the same numbers
repeat a flight. The exit code is 1 if an invariant was violated. docs/faults.md lists the invariants and tolerances.
"""

import argparse
import os
import sys
from collections import defaultdict
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from rich.console import Console
from rich.progress import Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from tests.faults import teams
from tests.faults.drawing import AUTOPILOTS, KINDS, SHARED, draw_case
from tests.faults.flying import Row, Starts, fly

FLIGHTS = 30
"""With the ten of every change there are forty."""

TOLD_EVERY = 20
WALLS = ("fence", "polygon", "floor", "ceiling", "stand-off")


_STARTS = Starts()
"""Of this process."""


def flown(seed: int, number: int, folder: Path | None) -> Row:
    """Fly one by its number, in a process of the pool."""
    return fly(draw_case(seed, number), folder, _STARTS)


def main(arguments: Sequence[str]) -> int:
    """Fly, show; return 0 if everything held."""
    parser = argparse.ArgumentParser(prog="python -m tests faults", description=__doc__)
    parser.add_argument(
        "--flights", type=int, default=FLIGHTS, metavar="N", help=f"how many (default {FLIGHTS})"
    )
    parser.add_argument(
        "--seed", type=int, default=1, metavar="S", help="of all randomness (default 1)"
    )
    parser.add_argument(
        "--only", type=int, metavar="I", help="flight I of the seed, told at length"
    )
    parser.add_argument(
        "--kind", metavar="K", help="only flights in which this goes wrong: " + ", ".join(KINDS)
    )
    parser.add_argument(
        "--jobs", type=int, default=min(2, os.cpu_count() or 1), metavar="J", help="processes"
    )
    parser.add_argument(
        "--records", type=Path, metavar="FOLDER", help="keep every flight's record there"
    )
    parser.add_argument(
        "--teams",
        action="store_true",
        help="flights of teams, with faults of mates and their links",
    )
    given = parser.parse_args(arguments)
    if given.kind is not None and given.kind not in KINDS:
        parser.error(f"--kind {given.kind}: allowed are {', '.join(KINDS)}")
    if given.records is not None:
        given.records.mkdir(parents=True, exist_ok=True)
    console = Console(highlight=False, soft_wrap=True)
    if given.teams:
        chosen = range(given.flights) if given.only is None else [given.only]
        with ProcessPoolExecutor(given.jobs) as pool:
            return teams.fly_all(
                given.seed, chosen, pool, lambda words: console.print(words, markup=False)
            )
    numbers = (
        [given.only] if given.only is not None else _numbers(given.seed, given.flights, given.kind)
    )
    rows = list(_all(console, given.seed, numbers, given.jobs, given.records))
    if given.only is not None:
        _tell(console, rows[0])
    _conclude(console, rows)
    return 1 if any(row.violations for row in rows) else 0


def _numbers(seed: int, flights: int, kind: str | None) -> list[int]:
    if kind is None:
        return list(range(flights))
    return [number for number in range(flights) if kind in draw_case(seed, number).kinds]


def _all(
    console: Console, seed: int, numbers: Sequence[int], jobs: int, folder: Path | None
) -> Iterator[Row]:
    chunk = len(AUTOPILOTS) * SHARED  # those of one game in one process
    with ProcessPoolExecutor(max(1, min(jobs, len(numbers) or 1))) as pool:
        waiting = pool.map(
            flown, [seed] * len(numbers), numbers, [folder] * len(numbers), chunksize=chunk
        )
        columns = (TextColumn("{task.completed}/{task.total} flights"), TimeRemainingColumn())
        with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
            task = progress.add_task("", total=len(numbers))
            for done, row in enumerate(waiting, start=1):
                progress.advance(task)
                if not console.is_terminal and done % TOLD_EVERY == 0:
                    print(f"{done} of {len(numbers)} flights", flush=True)
                for violation in row.violations:
                    finding = f"{violation.amount:.2f} at {violation.at_s:.2f} s"
                    remark = f" ({violation.said})" if violation.said else ""
                    console.print(
                        f"[bold red]NO[/bold red] {violation.invariant}: {finding}{remark}; "
                        f"{', '.join(row.case.kinds)}; again: {row.case.again}"
                    )
                yield row


def _tell(console: Console, row: Row) -> None:
    scenario = row.case.scenario
    console.print(scenario.model_dump_json(indent=1, exclude_defaults=True))
    console.print(f"polygon {row.case.corners_m}, stalls {row.case.stalls}")
    console.print(
        f"ended {row.end} after {row.duration_s:.1f} s; beyond walls by {row.breaches_m or 'nothing'}"
    )


def _conclude(console: Console, rows: Sequence[Row]) -> None:
    by_kind: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        for kind in dict.fromkeys(row.case.kinds):
            by_kind[kind].append(row)
    table = Table(box=None, pad_edge=False)
    for heading in (
        "what went wrong",
        "flights",
        "violations",
        *(f"{wall}, m" for wall in WALLS),
        "worst",
    ):
        table.add_column(
            heading, justify="left" if heading in {"what went wrong", "worst"} else "right"
        )
    for kind in sorted(by_kind):
        found = by_kind[kind]
        wrong = [one for row in found for one in row.violations]
        worst = max(wrong, key=lambda one: one.amount, default=None)
        beyond = (
            max((row.breaches_m.get(wall, 0.0) for row in found), default=0.0) for wall in WALLS
        )
        table.add_row(
            kind, str(len(found)), str(len(wrong)) if wrong else "", *(f"{far:.2f}" if far else "" for far in beyond),
            "" if worst is None else f"{worst.invariant} {worst.amount:.2f}",
            style="bold red" if wrong else "",
        )  # fmt: skip
    Console(width=max(console.width, 130)).print(table)
    console.print(
        "Metres are how far beyond a wall by the truth; a violation is what is left of that beyond the error."
    )
    violated = sum(bool(row.violations) for row in rows)
    spent_s = sum(row.processor_s for row in rows)
    console.print(
        f"{len(rows) - violated} of {len(rows)} flights as wanted; {spent_s:.0f} s of processor time"
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
