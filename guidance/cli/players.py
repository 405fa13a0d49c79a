"""The outcome of a run as JSON, and the tables of a team game: for each vehicle, for each evader, and for the team."""

import json
import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, Final

from rich.console import Console

from guidance.screen import Cell, print_text_table
from guidance.sim.outcome import outcome_json
from guidance.sim.scenario import Scenario
from guidance.sim.teams import TeamOutcome, TeamScenario, summary_of

if TYPE_CHECKING:
    from guidance.session.fly.result import MissionResult

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
    if result is not None:
        vehicles = list(result.vehicles)
    else:
        vehicles = [f"uav{number + 1}" for number in range(rows[0].pursuers)]
    headings = ["vehicle", "assigned", "captured"]
    if result is not None:
        headings += ["ended", "alarms", "limits"]
    cells = list[Sequence[Cell]]()
    for number, name in enumerate(vehicles):
        assigned = []
        for role in _ROLES:
            of_vehicle = [row for row in rows if getattr(row, role) == number]
            assigned += [f"{_evader_name(row)}, {role}" for row in of_vehicle]
        captured = [_evader_name(row) for row in rows if row.captor == number]
        line = [name, _cell_of_words("; ", assigned), _cell_of_words(", ", captured)]
        if result is not None:
            flight = result.vehicles[name]
            line += [
                str(flight.ended),
                str(len(flight.alarms)),
                _cell_of_words(", ", flight.limits),
            ]
        cells.append(line)
    print_text_table(console, headings, cells, left=range(len(headings)))
    if not rows:
        return
    headings = ["evader", "end", *_ROLES, "captor", *_NUMBERS]
    if result is not None:
        headings.append("promise")
    names = [*vehicles, "-"]  # number -1 means none
    cells = list[Sequence[Cell]]()
    for row in rows:
        evader = _evader_name(row)
        pursuers = [names[number] for number in (row.first, row.second, row.captor)]
        numbers = [as_text(getattr(row, name)) for name in _NUMBERS]
        line = [evader, row.end, *pursuers, *numbers]
        if result is not None:
            line.append(_promise_verdict(result, row, evader))
        cells.append(line)
    text_columns = [column for column, heading in enumerate(headings) if heading not in _NUMBERS]
    print_text_table(console, headings, cells, left=text_columns)
    summary = summary_of(rows)
    team = [(rows[0].game, *map(as_text, summary.values()))]
    print_text_table(console, ("team", *summary), team, left=(0,))


def _evader_name(row: TeamOutcome) -> str:
    return f"rover{row.evader + 1}"


def _cell_of_words(separator: str, words: Iterable[str]) -> str:
    """Return words as a cell; "-" if there are none."""
    text = separator.join(words)
    return text if text else "-"


def _promise_verdict(result: "MissionResult", row: TeamOutcome, evader: str) -> str:
    """Say whether the last promise about an evader was kept."""
    unit = "s" if row.game == "pe" else "m"
    captured = row.end == "captured"
    for member in result.members.values():
        roles = member.board.roles
        if roles is None:
            continue
        for promise in roles.promises:
            if promise.evader == evader:
                return promise.verdict(row.predicted, row.achieved, unit, captured=captured)
    return "-"


def as_text(value: Any, unit: str = "") -> str:  # noqa: ANN401 - any column
    """Return a column's value as text; a number gets three places and its unit."""
    if isinstance(value, tuple):
        return ", ".join(value) if value else "none"
    if isinstance(value, float):
        return "-" if math.isnan(value) else f"{value:z.3f} {unit}".rstrip()
    text = str(value)
    return text if text else "-"
