"""`guidance fly`: the flight of a mock or of a running vehicle, with its output."""

import contextlib
import json
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final, NoReturn

from rich.console import Console

from guidance.cli.flight_display import live_line, report, tell_endpoint
from guidance.errors import FlightError
from guidance.screen import console as screen
from guidance.session.control_socket import ENDPOINT
from guidance.session.flight_files import next_folder
from guidance.session.fly_mock import fly_mock
from guidance.session.fly_vehicle import Asked, fly_url, left_out
from guidance.session.mission import Progress
from guidance.session.result import FlightResult, outcome_of_flight
from guidance.sim.outcome import outcome_json
from guidance.sim.scenario import Scenario
from guidance.sim.scenario_file import load_scenario

INTERRUPTED: Final = 130


def fly_scenario(
    name: str,
    asked: Asked | None = None,
    *,
    fast: bool = False,
    link: str = "mavsdk",
    port: int = 0,
    out: Path | None,
    seed: int | None,
    on_record: Callable[[Path], None] = lambda _: None,
    on_control: Callable[[str], None] = lambda _: None,
    as_json: bool = False,
) -> int:
    """Fly a scenario; return the exit code: 0 when the game ended as it should have.

    Args:
        name: Of one that comes along, or a path.
        asked: The vehicle that flies it; None for the mock.
        fast: The mock in virtual time.
        link: Which client flies the mock in real time.
        port: Where the live mock is reached; 0 is any.
        out: Folder for the record and the picture.
        seed: In place of the scenario's.
        on_record: Called with the record's path when it is open.
        on_control: Called with the control endpoint; never in virtual time.
        as_json: Print the outcome row as JSON, and text for people on standard error.

    Raises:
        GuidanceError: For everything that the user can mend.
    """
    path, scenario = load_scenario(name)
    if seed is not None:
        scenario = scenario.model_copy(update={"seed": seed})
    console = screen(stderr=as_json)
    folder = out if out is not None else next_folder(Path("flights"), path.stem)

    def heard_at(endpoint: str) -> None:
        tell_endpoint(console, endpoint)
        on_control(endpoint)

    title = f"[bold]{scenario.title}[/bold]  ({path.name}"
    if asked is not None:
        console.print(f"{title}, {asked.link}, {asked.url})", highlight=False)
        return _fly_url(name, scenario, asked, console, folder, on_record, heard_at, as_json=as_json)
    console.print(f"{title}, {'virtual time' if fast else link})")
    with live_line(console) as show, noted_ctrl_c() as check:

        def look(progress: Progress) -> None:
            check()
            show(progress)

        control = None if fast else ENDPOINT
        result = fly_mock(
            scenario,
            folder,
            look,
            fast=fast,
            link=link,
            port=port,
            on_record=on_record,
            control=control,
            on_control=heard_at,
        )
    return _report(console, result, "fast" if fast else "live", folder, as_json=as_json)


@contextlib.contextmanager
def noted_ctrl_c() -> Iterator[Callable[[], None]]:
    """Raise KeyboardInterrupt on Ctrl-C, and again from the yielded function: a library may swallow the first one."""
    noted = False

    def note(*_: object) -> NoReturn:
        nonlocal noted
        noted = True
        raise KeyboardInterrupt

    def check() -> None:
        if noted:
            raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, note)
    try:
        yield check
    finally:
        signal.signal(signal.SIGINT, before)


def _fly_url(
    name: str,
    scenario: Scenario,
    asked: Asked,
    console: Console,
    folder: Path,
    on_record: Callable[[Path], None],
    on_control: Callable[[str], None],
    *,
    as_json: bool,
) -> int:
    for what in left_out(scenario):
        console.print(f"{what}: only a mock can have that; the vehicle flies without")
    try:
        with live_line(console) as show:
            result, hand_over = fly_url(
                scenario, asked, folder, show, on_record=on_record, control=ENDPOINT, on_control=on_control
            )
    except FlightError as error:
        raise FlightError(f"{asked.url}: {error}{_advice(name, asked, str(error))}") from error
    code = _report(console, result, "vehicle", folder, as_json=as_json)
    if result.interrupted:
        console.print(f"interrupted: the vehicle was told to {hand_over}, and is {result.ended}")
        return INTERRUPTED
    return code


def _report(console: Console, result: FlightResult, way: str, folder: Path, *, as_json: bool) -> int:
    outcome = outcome_of_flight(result, way)
    report(console, result, outcome, folder)
    if as_json:
        sys.stdout.write(json.dumps(outcome_json(outcome), indent=2) + "\n")
    return 0 if result.captured else 4


def _advice(name: str, asked: Asked, words: str) -> str:
    if not words.startswith("preflight refuses"):
        return ""
    return f"\nto have it set up for this scenario: guidance check {name} --vehicle {asked.url} --apply"
