"""The outcome of a run as JSON, and the tables of a team game: for each vehicle, for each evader, and for the team."""

import json
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

from rich.console import Console

from guidance.screen import Cell, print_sheet
from guidance.sim.outcome import outcome_json
from guidance.sim.scenario import Scenario
from guidance.sim.teams import TeamOutcome, TeamScenario, summary_of

if TYPE_CHECKING:
    from guidance.session.result import MissionResult

_ROLES: Final = ("first", "second")
_NUMBERS: Final = ("game_time_s", "predicted", "achieved", "regret")


def rows_json(scenario: Scenario | TeamScenario, rows: Sequence[Any]) -> str:
    """Return the rows of a run as JSON: of a team a list, else one object."""
    plain = [outcome_json(row) for row in rows]
    return json.dumps(plain if isinstance(scenario, TeamScenario) else plain[0], indent=2) + "\n"


def tell_players(
    rows: Sequence[TeamOutcome], console: Console, result: "MissionResult | None" = None
) -> None:
    """Print a line for each vehicle and each evader, and the row of the team.

    Args:
        rows: One for each evader; none if no game began.
        console: Where to.
        result: Of a flight; None in mathematics.
    """
    vehicles = (
        [f"uav{number + 1}" for number in range(rows[0].pursuers)]
        if result is None
        else list(result.vehicles)
    )
    evaders = [f"rover{row.evader + 1}" for row in rows]
    cells = list[Sequence[Cell]]()
    for number, name in enumerate(vehicles):
        roles = [
            f"{evaders[row.evader]}, {role}"
            for role in _ROLES
            for row in rows
            if getattr(row, role) == number
        ]
        captured = [evaders[row.evader] for row in rows if row.captor == number]
        flight = None if result is None else result.vehicles[name]
        flight_cells = (
            []
            if flight is None
            else [str(flight.ended), str(len(flight.alarms)), ", ".join(flight.limits) or "-"]
        )
        cells.append([name, "; ".join(roles) or "-", ", ".join(captured) or "-", *flight_cells])
    headings = (
        "vehicle",
        "assigned",
        "captured",
        *(() if result is None else ("ended", "alarms", "limits")),
    )
    print_sheet(console, headings, cells, left=range(len(headings)))
    if not rows:
        return
    names = [*vehicles, "-"]  # number -1 means none
    cells = []
    for row, evader in zip(rows, evaders, strict=True):
        who = (names[number] for number in (row.first, row.second, row.captor))
        promise = [] if result is None else [_promise(result, row, evader)]
        cells.append(
            [evader, row.end, *who, *(as_text(getattr(row, name)) for name in _NUMBERS), *promise]
        )
    headings = (
        "evader",
        "end",
        *_ROLES,
        "captor",
        *_NUMBERS,
        *(() if result is None else ("promise",)),
    )
    text_columns = [column for column, heading in enumerate(headings) if heading not in _NUMBERS]
    print_sheet(console, headings, cells, left=text_columns)
    summary = summary_of(rows)
    team = [(rows[0].game, *map(as_text, summary.values()))]
    print_sheet(console, ("team", *summary), team, left=(0,))


def _promise(result: "MissionResult", row: TeamOutcome, evader: str) -> str:
    """Say whether the last promise about an evader was kept."""
    roles = [
        member.board.roles for member in result.members.values() if member.board.roles is not None
    ]
    promises = [
        promise
        for member_roles in roles
        for promise in member_roles.promises
        if promise.evader == evader
    ]
    unit = "s" if row.game == "pe" else "m"
    captured = row.end == "captured"
    return (
        promises[0].verdict(row.predicted, row.achieved, unit, captured=captured)
        if promises
        else "-"
    )


def as_text(value: Any, unit: str = "") -> str:  # noqa: ANN401 - any column
    """Return a column's value as text; a number gets three places and its unit."""
    if isinstance(value, tuple):
        return ", ".join(value) or "none"
    if isinstance(value, float):
        return "-" if math.isnan(value) else f"{value:z.3f} {unit}".rstrip()
    return str(value) or "-"
