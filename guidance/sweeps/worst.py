"""The worst cases as scenario files, ready to be played and flown again."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tomli_w

from guidance.sim.scenario import Scenario
from guidance.sim.teams import TeamScenario
from guidance.sweeps.folder import Folder, write_whole
from guidance.sweeps.plan import Plan
from guidance.sweeps.rows import Scenarios
from guidance.sweeps.tally import Tally


class Worst(NamedTuple):
    """A row that came out badly, its scenario's file, how it ended and its regret, NaN if there is none."""

    path: Path
    row: int
    tally: Tally
    end: str
    regret: float


def scenario_of(plan: Plan, row: int) -> Scenario | TeamScenario | str:
    """Return what a row plays, or why it is no game."""
    return next(iter(Scenarios(plan).of(plan.cases(np.array([row], dtype=np.int64)))))


def write_worst(folder: Folder, tallies: Sequence[Tally], out: Path) -> Iterator[Worst]:
    """Write the worst rows of every tally as `worst-001.toml` and so on, the worst of all first.

    Raises:
        OSError: If a file cannot be written.
    """
    ranked = sorted(((bad, number) for number, tally in enumerate(tallies) for bad in tally.ranked))
    for number, (bad, whose) in enumerate(ranked, 1):
        scenario = scenario_of(folder.plan, bad.row)
        if isinstance(scenario, str):  # a row without a game is never ranked
            continue
        path, pair = out / f"worst-{number:03d}.toml", tallies[whose].pair
        about = (
            f"Row {bad.row} of the sweep {folder.plan.digest[:12]}, {pair.pursuer} against {pair.evader}: {bad.end}."
        )
        document = {**scenario.model_dump(mode="json", exclude={"expect"}), "description": about}
        write_whole(path, tomli_w.dumps(without_unset(document)).encode())
        yield Worst(path, bad.row, tallies[whose], bad.end, bad.regret)


def without_unset(document: Any) -> Any:  # noqa: ANN401 - any part of a document
    """Leave out what is None: TOML has no such value."""
    if isinstance(document, dict):
        return {name: without_unset(value) for name, value in document.items() if value is not None}
    return [without_unset(value) for value in document] if isinstance(document, list) else document
