"""Runs one scenario as mathematics, mock or vehicle, and checks its expectations."""

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from rich.console import Console
from rich.table import Table
from rich.text import Text

from guidance.cli.arguments import agree, refuse_others
from guidance.config import find
from guidance.errors import ConfigError
from guidance.files import private_file, writing
from guidance.screen import Cell, pairs, sheet
from guidance.sim.expect import CheckedExpectation
from guidance.sim.maths import play
from guidance.sim.outcome import Outcome, outcome_json
from guidance.sim.scenario import Scenario
from guidance.sim.scenario_file import load_any
from guidance.sim.team_maths import TeamOutcome, play_teams, summary_of
from guidance.sim.teams import TeamScenario

WAYS: Final = ("maths", "fast", "live", "vehicle")

REPORTED: Final = "reported"
"""Evader policy in the row of a run `--as vehicle`, where the evader is only reported."""

STANDARD_OUTPUT: Final = Path("-")


class Run(NamedTuple):
    """Options of `guidance scenario run`."""

    way: str
    config: Path | None = None
    engage: bool = False
    yes: bool = False
    link: str | None = None
    port: int | None = None
    out: Path | None = None
    seed: int | None = None
    json_file: Path | None = None
    over: str | None = None


def run_scenario(name: str, run: Run, console: Console) -> int:
    """Run a scenario and show its outcome; return 0, or 1 if an expectation fails.

    Raises:
        GuidanceError: For every error that the user can fix.
    """
    if run.way not in WAYS:
        raise ConfigError(f"--as {run.way}: allowed are {', '.join(WAYS)}")
    if run.config is None and run.way == "vehicle":
        raise ConfigError("--config: missing; --as vehicle needs a vehicle file")
    _refuse_others(run)
    path, scenario = load_any(name)
    if run.seed is not None:
        scenario = scenario.model_copy(update={"seed": run.seed})
    console.print(f"[bold]{scenario.title}[/bold]  ({path.name}, as {run.way})")
    if isinstance(scenario, TeamScenario):
        return _run_teams(scenario, path, run, console)
    if run.way == "maths" and scenario.fault:
        console.print("the mathematics ignores faults")
    outcome = _run(scenario, path.stem, run, console)
    console.print(_outcome_table(outcome))
    return _judged(scenario.expect.of(outcome._asdict()), outcome_json(outcome), run, console)


def _judged(verdicts: Sequence[CheckedExpectation], row: Any, run: Run, console: Console) -> int:  # noqa: ANN401 - JSON
    """Show which expectations hold, write the row, and return the exit code."""
    if verdicts:
        rows: list[Sequence[Cell]] = []
        for verdict in verdicts:
            held = Text("holds", "green") if verdict.held else Text("FAILS", "red")
            rows.append([verdict.column, verdict.expected, _said(verdict.value, ""), held])
        console.print(sheet(("column", "expected", "came out", "verdict"), rows, left=range(4), title="expected"))
    text = json.dumps(row, indent=2) + "\n"
    if run.json_file == STANDARD_OUTPUT:
        sys.stdout.write(text)
    elif run.json_file is not None:
        with writing(run.json_file):
            private_file(run.json_file).write_text(text, encoding="utf-8")
    return 0 if all(verdict.held for verdict in verdicts) else 1


def _refuse_others(run: Run) -> None:
    given = {f"--{option}": value for option, value in run._asdict().items()}
    ways: dict[str, tuple[str, ...]] = dict.fromkeys(("--config", "--engage", "--yes"), ("vehicle",))
    ways |= dict.fromkeys(("--link", "--over", "--port"), ("live",)) | {"--out": ("fast", "live", "vehicle")}
    elsewhere = {option: f"with --as {' or '.join(of)}" for option, of in ways.items() if run.way not in of}
    refuse_others(f"--as {run.way}", given, elsewhere)
    if not run.engage:
        refuse_others("orders by hand", given, {"--yes": "with --engage, which arms"})


def _run_teams(scenario: TeamScenario, path: Path, run: Run, console: Console) -> int:
    if run.way != "maths":
        raise ConfigError(f"--as {run.way}: {path.name} has teams, which only the mathematics plays; use --as maths")
    rows = play_teams([scenario])[0]
    console.print(_row_table(rows))
    summary = summary_of(rows)
    unit = "s" if scenario.game == "pe" else "m"
    words = f"{summary['captured']} of {summary['evaders']} captured by {summary['pursuers']}"
    console.print(f"{words}; {summary['guaranteed']} were guaranteed, with {summary['total']:.3f} {unit} in all")
    return _judged(scenario.expect.verdicts(summary), [outcome_json(row) for row in rows], run, console)


def _row_table(rows: Sequence[TeamOutcome]) -> Table:
    """Return the table of a team game, one row per evader."""
    shown = ("evader", "end", "first", "second", "captor", "game_time_s", "predicted", "achieved", "regret")
    cells = []
    for row in rows:
        values = row._asdict()
        cells.append(["-" if values[name] == -1 else _said(values[name], "") for name in shown])
    return sheet(shown, cells, left=(1,))


def _run(scenario: Scenario, stem: str, run: Run, console: Console) -> Outcome:
    if run.way == "maths":
        return play([scenario])[0]
    from guidance.cli.flight_display import live_line, tell_dropped, tell_endpoint  # noqa: PLC0415 - zenoh and mavsdk take a second
    from guidance.session.control_socket import ENDPOINT  # noqa: PLC0415
    from guidance.session.flight_files import RECORD, flight_folder  # noqa: PLC0415
    from guidance.session.fly import MockOptions, fly_mock  # noqa: PLC0415
    from guidance.session.result import outcome_of_flight  # noqa: PLC0415

    def say(words: str) -> None:
        console.print(words, soft_wrap=True, highlight=False)

    if run.config is not None:
        from guidance.session.fly_vehicle import fly_vehicle  # noqa: PLC0415
        from guidance.session.vehicle_file import load_vehicle  # noqa: PLC0415

        own = load_vehicle(find(str(run.config), "vehicles"))
        if run.engage and not run.yes:  # also on loopback: a real vehicle may be behind a router
            url = own.vehicle.url
            agree(f"{run.config}: {url} may be a real vehicle. Arm it, take off and engage? Propellers will turn")
        with flight_folder(run.out, own.name) as folder:
            result = fly_vehicle(scenario, own, folder, say, engage=run.engage)
        # The evader is out there, and does what it wants: no policy of the file's is its.
        return outcome_of_flight(result, "vehicle")._replace(evader_policy=REPORTED)
    options = MockOptions(
        fast=run.way == "fast", link=run.link or "mavsdk", port=run.port or 0, over=run.over or "zenoh"
    )
    with flight_folder(run.out, stem) as folder, live_line(console) as show:
        control = None if options.fast else ENDPOINT
        result = fly_mock(
            scenario, folder, show, options, control=control, on_control=lambda at: tell_endpoint(console, at)
        )
    tell_dropped(console, result)
    say(f"record   {folder / RECORD}")
    return outcome_of_flight(result, run.way)


def _outcome_table(outcome: Outcome) -> Table:
    unit = "s" if outcome.game == "pe" else "m"
    shown = ((name, value) for name, value in outcome._asdict().items() if name != "scenario")
    return pairs((name, _said(value, unit if name == "regret" else _unit(name))) for name, value in shown)


def _unit(column: str) -> str:
    """Return the unit that ends the name of a column, or that its name implies."""
    if column.endswith("_m_s"):
        return "m/s"
    return {"s": "s", "m": "m"}.get(column.rpartition("_")[2], "")


def _said(value: Any, unit: str) -> str:  # noqa: ANN401 - any column
    if isinstance(value, tuple):
        return ", ".join(value) or "none"
    if isinstance(value, float):
        return "-" if value != value else f"{round(value, 3) + 0.0:.3f} {unit}".rstrip()  # noqa: PLR0124 - NaN
    return str(value) or "-"
