"""`guidance fly`: the flight of a mock or of a running vehicle, with its output."""

import contextlib
import json
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NoReturn

from guidance.cli import INTERRUPTED
from guidance.cli.flight_display import live_line, report, tell_endpoint
from guidance.errors import FlightError
from guidance.screen import console as screen
from guidance.session.control_socket import ENDPOINT
from guidance.session.flight_files import flight_folder
from guidance.session.fly import MockOptions, fly_mock
from guidance.session.fly_vehicle import Asked, fly_url, left_out
from guidance.session.mission import Progress
from guidance.session.result import outcome_of_flight
from guidance.sim.outcome import outcome_json
from guidance.sim.scenario_file import load_scenario


def fly_scenario(
    name: str,
    how: MockOptions | Asked,
    *,
    out: Path | None,
    seed: int | None,
    on_record: Callable[[Path], None] = lambda _: None,
    on_control: Callable[[str], None] = lambda _: None,
    as_json: bool = False,
) -> int:
    """Fly a scenario; return the exit code: 0 when the game ended as it should have.

    Args:
        name: Of one that comes along, or a path.
        how: The mock, or the vehicle that flies it.
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

    def heard_at(endpoint: str) -> None:
        tell_endpoint(console, endpoint)
        on_control(endpoint)

    console.print(f"[bold]{scenario.title}[/bold]  ({path.name}, {_words(how)})", highlight=False)
    with flight_folder(out, path.stem) as folder:
        if isinstance(how, MockOptions):
            way, control = how.way, None if how.fast else ENDPOINT
            with live_line(console) as show, noted_ctrl_c() as check:

                def look(progress: Progress) -> None:
                    check()
                    show(progress)

                result = fly_mock(
                    scenario, folder, look, how, on_record=on_record, control=control, on_control=heard_at
                )
        else:
            way = "vehicle"
            for what in left_out(scenario):
                console.print(f"{what}: only a mock can have that; the vehicle flies without")
            with live_line(console) as show, _advised(name, how):
                result = fly_url(
                    scenario, how, folder, show, on_record=on_record, control=ENDPOINT, on_control=heard_at
                )
        outcome = outcome_of_flight(result, way)
        report(console, result, outcome, folder)
    if as_json:
        sys.stdout.write(json.dumps(outcome_json(outcome), indent=2) + "\n")
    if result.interrupted and way == "vehicle":
        console.print(f"interrupted: the vehicle was told to land, and is {result.ended}")
        return INTERRUPTED
    return 0 if result.captured else FlightError.exit_code


def _words(how: MockOptions | Asked) -> str:
    if isinstance(how, Asked):
        return f"{how.link}, {how.url}"
    return "virtual time" if how.fast else how.link


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


@contextlib.contextmanager
def _advised(name: str, asked: Asked) -> Iterator[None]:
    """Add the URL to a refusal, and the command that sets the vehicle up."""
    try:
        yield
    except FlightError as error:
        mend = f"\nto have it set up for this scenario: guidance check {name} --vehicle {asked.url} --apply"
        advice = mend if str(error).startswith("preflight refuses") else ""
        raise FlightError(f"{asked.url}: {error}{advice}") from error
