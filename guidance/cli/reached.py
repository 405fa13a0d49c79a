"""`guidance fly SCENARIO --vehicle URL`: a vehicle that runs elsewhere against an evader that is simulated here."""

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final, NamedTuple

from rich.console import Console

from guidance.autopilots import autopilot_named
from guidance.cli.showing import Show, live_line, report
from guidance.clock import MonotonicClock
from guidance.errors import ConfigError, FlightError
from guidance.links.endpoint import parse
from guidance.links.opening import KINDS, find_autopilot, open_wire
from guidance.links.wires.udp import UdpWire
from guidance.session.checkup import Checkup
from guidance.session.flown import outcome_of_flight
from guidance.session.handover import ORDER_OF
from guidance.session.log import Log
from guidance.session.loop import Signals
from guidance.session.meeting import identify, wait_until_placed
from guidance.session.merging import config_of
from guidance.session.opening import Opened, open_all
from guidance.session.orders import Mailbox
from guidance.session.recording import RECORD, next_folder
from guidance.session.spec import plan_of
from guidance.session.vehicle import Conduct, Reached, conducted
from guidance.session.vehicle_file import Config
from guidance.sim.evader_here import EvaderHere, laid_about, left_out
from guidance.sim.files import load_scenario
from guidance.sim.fleet import EVADER_ID
from guidance.sim.scenario import Scenario

FOUND_WITHIN_S: Final = 15.0
_CONNECTED_WITHIN_S: Final = 5.0
INTERRUPTED: Final = 130
ENDS: Final = ("return", "land")
"""What the vehicle does when the game is over: fly home and land, or land where it is."""


class Asked(NamedTuple):
    """Which vehicle, and how it is talked to; see `guidance fly --help`."""

    url: str
    autopilot: str | None = None
    link: str = "mavsdk"
    end: str = "return"


def fly_url(
    name: str,
    asked: Asked,
    *,
    out: Path | None,
    seed: int | None,
    on_record: Callable[[Path], None] = lambda _: None,
) -> int:
    """Fly a scenario with the vehicle at a URL; return the exit code: 0 when the game ended as it should have.

    Raises:
        ConfigError: If an argument is wrong, or another autopilot is there.
        LinkError: If there is no vehicle.
        FlightError: If it is in the air, armed or does not get ready, or preflight refuses.
    """
    path, scenario = load_scenario(name)
    if seed is not None:
        scenario = scenario.model_copy(update={"seed": seed})
    console = Console()
    folder = out if out is not None else next_folder(Path("flights"), path.stem)
    console.print(f"[bold]{scenario.title}[/bold]  ({path.name}, {asked.link}, {asked.url})", highlight=False)
    for what in left_out(scenario):
        console.print(f"{what}: only a mock can have that; the vehicle flies without")
    with live_line(console) as show, reached(scenario, asked) as (own, opened, clock, radio):
        try:
            began_s = time.perf_counter()
            laid = _laid(scenario, own, opened, clock, show)
            evader = EvaderHere(laid, clock, radio)
            on_record(folder / RECORD)
            conduct = Conduct(
                engage=True,
                on_terminate=ORDER_OF[own.flight.on_terminate],
                evader=evader,
                end_with=ORDER_OF[asked.end],
                show=show,
            )
            signals = Signals()
            signals.install()
            result = conducted(
                laid, Reached(own, plan_of(own, laid), opened, clock), conduct, folder, Mailbox(), signals
            )
            result.wall_s = time.perf_counter() - began_s
        except FlightError as error:
            raise FlightError(f"{asked.url}: {error}{_advice(name, asked, str(error))}") from error
    report(console, result, outcome_of_flight(result, "vehicle"), folder)
    if result.interrupted:
        console.print(f"interrupted: the vehicle was told to {own.flight.on_terminate}, and is {result.ended}")
        return INTERRUPTED
    return 0 if result.captured else 4


@contextlib.contextmanager
def reached(scenario: Scenario, asked: Asked) -> Iterator[tuple[Config, Opened, MonotonicClock, UdpWire]]:
    """Find the vehicle at a URL and open its link, and a loopback port for the evader's reports.

    Yields the configuration, what was opened, the clock, and the evader's end of the port.

    Raises:
        ConfigError: If an argument is wrong, or another autopilot is there.
        LinkError: If there is no vehicle.
    """
    if asked.link not in KINDS:
        raise ConfigError(f"--link {asked.link}: allowed are {', '.join(KINDS)}")
    if asked.end not in ENDS:
        raise ConfigError(f"--end {asked.end}: allowed are {', '.join(ENDS)}")
    parse(asked.url)
    clock = MonotonicClock()
    with contextlib.ExitStack() as closing:
        wire = open_wire(asked.url, clock=clock.now_s, timeout_s=_CONNECTED_WITHIN_S)
        closing.callback(wire.close)
        found = find_autopilot(
            wire, clock=clock.now_s, timeout_s=FOUND_WITHIN_S, sleep=time.sleep, who=f"--vehicle {asked.url}"
        )
        autopilot = identify(found, asked.url, asked.autopilot)
        ears = UdpWire(clock.now_s, host="127.0.0.1", port=0, listen=True, systems=(EVADER_ID,))
        closing.callback(ears.close)
        radio = UdpWire(clock.now_s, host="127.0.0.1", port=ears.port, listen=False)
        closing.callback(radio.close)
        own = config_of(
            scenario,
            url=asked.url,
            link=asked.link,
            autopilot=autopilot.name,
            found=found,
            evader_url=f"udpin://127.0.0.1:{ears.port}",
        )
        opened = open_all(own, clock, tapped=True, wire=wire, evader_wire=ears)
        closing.callback(opened.close)
        yield own, opened, clock, radio


@contextlib.contextmanager
def checkup_at(name: str, asked: Asked) -> Iterator[Checkup]:
    """Open the vehicle at a URL, to be judged by what a scenario asks of it.

    Raises:
        GuidanceError: For everything that the user can mend.
    """
    _, scenario = load_scenario(name)
    log = Log("console", "error")
    try:
        with reached(scenario, asked) as (own, opened, clock, _):
            scenario = scenario.model_copy(
                update={"pursuer": scenario.pursuer.model_copy(update={"autopilot": own.vehicle.autopilot})}
            )
            yield Checkup(own.name, plan_of(own, scenario), opened.link, opened.evader, clock, log=log)
    finally:
        log.close()


def _laid(scenario: Scenario, own: Config, opened: Opened, clock: MonotonicClock, show: Show) -> Scenario:
    home, frame = wait_until_placed(opened.link, autopilot_named(own.vehicle.autopilot), clock, show)
    return laid_about(scenario, home, frame, own.vehicle.autopilot)


def _advice(name: str, asked: Asked, words: str) -> str:
    if not words.startswith("preflight refuses"):
        return ""
    return f"\nto have it set up for this scenario: guidance check {name} --vehicle {asked.url} --apply"
