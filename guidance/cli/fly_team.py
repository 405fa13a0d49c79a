"""Team flights of mocks, with their output: one line for each vehicle, one for each evader, and one for the team."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

from guidance.screen import Cell, sheet
from guidance.sim.teams import TeamOutcome, TeamScenario, summary_of

if TYPE_CHECKING:
    from guidance.session.fly import Asked, MockOptions, Onlooker
    from guidance.session.fly_team import TeamFlight
    from guidance.session.mission import Progress

_SHOWN = ("evader", "end", "first", "second", "captor", "game_time_s", "predicted", "achieved", "regret")


def fly_and_show(
    scenario: TeamScenario,
    folder: Path,
    how: "MockOptions | Sequence[Asked]",
    onlooker: "Onlooker",
    console: Console,
) -> list[TeamOutcome]:
    """Fly a scenario of teams and show its outcome; return its rows, one for each evader.

    Raises:
        GuidanceError: For everything that the user can mend.
    """
    from guidance.session.flight_files import RECORD, TEAM  # noqa: PLC0415 - zenoh and mavsdk take a second
    from guidance.session.fly_team import fly_team  # noqa: PLC0415

    def first(progress: "Progress") -> None:
        """Show the first vehicle only; all of them would not fit in one line."""
        if progress.vehicle == "uav1":
            onlooker.show(progress)

    def tell_endpoint(endpoint: str) -> None:
        console.print(
            f"orders   guidance ctl ORDER --team {TEAM} --endpoint {endpoint}", soft_wrap=True, highlight=False
        )
        onlooker.on_control(endpoint)

    look = onlooker._replace(show=first, on_control=tell_endpoint)
    flown = fly_team(scenario, how, folder=folder, onlooker=look)
    console.print(_vehicles(flown))
    if flown.rows:
        tell_rows(flown.rows, console)
    kept = "never at one height" if math.isinf(flown.least_m) else f"{flown.least_m:.2f} m"
    wanted = scenario.flight
    console.print(
        f"least distance of two vehicles less than {wanted.separation_height_m:g} m apart in height: {kept} "
        f"({wanted.separation_m:g} m wanted)",
        highlight=False,
    )
    wall_s = max(one.wall_s for one in flown.result.vehicles.values())
    duration_s = max(one.duration_s for one in flown.result.vehicles.values())
    console.print(f"{duration_s:.1f} s of flight in {wall_s:.2f} s", highlight=False)
    console.print(f"records  {folder}/VEHICLE/{RECORD}", soft_wrap=True, highlight=False)
    return flown.rows


def tell_rows(rows: Sequence[TeamOutcome], console: Console) -> None:
    """Print the rows of a game of teams, and the line of the team."""
    cells: list[Sequence[Cell]] = []
    for row in rows:
        values = row._asdict()
        cells.append([_cell(values[name]) for name in _SHOWN])
    console.print(sheet(_SHOWN, cells, left=(1,)))
    summary, unit = summary_of(rows), "s" if rows[0].game == "pe" else "m"
    words = f"{summary['captured']} of {summary['evaders']} captured by {summary['pursuers']}"
    console.print(f"{words}; {summary['guaranteed']} were guaranteed, with {summary['total']:.3f} {unit} in all")


def _cell(value: float | str) -> str:
    if isinstance(value, str):
        return value
    if value == -1 or math.isnan(value):
        return "-"
    return str(value) if isinstance(value, int) else f"{value:.3f}"


def _vehicles(flown: "TeamFlight") -> Table:
    """Return a line for each vehicle."""
    rows: list[Sequence[Cell]] = []
    for name, result in flown.result.vehicles.items():
        captured = [evader for evader, one in flown.result.evaders.items() if one.captured_by == name]
        limits = ", ".join(result.limits) or "-"
        rows.append([name, str(result.ended), ", ".join(captured) or "-", str(len(result.alarms)), limits])
    return sheet(("vehicle", "ended", "captured", "alarms", "limits"), rows, left=range(5))
