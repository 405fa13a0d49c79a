"""A scenario flown by a vehicle that is not ours: the one of a configuration file, or one that runs at a URL."""

import contextlib
import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple, NoReturn

from guidance.autopilots import autopilot_named
from guidance.clock import MonotonicClock
from guidance.errors import ConfigError
from guidance.flight import State
from guidance.frames import Amsl, LocalFrame, ned_from_game
from guidance.links.opening import KINDS
from guidance.links.port import Wire, parse
from guidance.links.udp import UdpWire
from guidance.log.entries import FLIGHT_OVER
from guidance.messages import Home
from guidance.session.answers import startup_answers
from guidance.session.checkup import Checkup
from guidance.session.control_bus import ControlBus, broadcasting, opened
from guidance.session.daemon import Equipment
from guidance.session.discovery import FOUND_WITHIN_S, autopilot_at, wait_until_placed
from guidance.session.flight_files import RECORD, flight_metadata, recording
from guidance.session.fly import fly
from guidance.session.log import Log
from guidance.session.loop import Signals
from guidance.session.mission import Progress, Show
from guidance.session.orders import ORDER_OF, Mailbox
from guidance.session.plan import config_of, plan_of
from guidance.session.process import Notifier
from guidance.session.result import FlightResult, closing_detail
from guidance.session.sequencer import MissionPolicy
from guidance.session.vehicle_file import Config
from guidance.session.vehicle_world import VehicleWorld, open_all, open_control
from guidance.sim.scenario import EVADER, EVADER_ID, PURSUER, Pursuit, Scenario, Site, Wind
from guidance.sim.stepped import EvaderHere

ENDS: Final = ("return", "land")
"""Endings of a flight at a URL: fly home and land, or land at once."""


@dataclass(frozen=True, slots=True)
class Asked:
    """A running vehicle and how to talk to it; see `guidance fly --help`.

    Raises:
        ConfigError: If an option has an unknown value.
    """

    url: str
    autopilot: str | None = None
    link: str = "mavsdk"
    end: str = "return"

    def __post_init__(self) -> None:
        if self.link not in KINDS:
            raise ConfigError(f"--link {self.link}: allowed are {', '.join(KINDS)}")
        if self.end not in ENDS:
            raise ConfigError(f"--end {self.end}: allowed are {', '.join(ENDS)}")
        parse(self.url)


class Reached(NamedTuple):
    """A vehicle as it was opened: its configuration, its world, its clock, and the evader's end of a loopback port."""

    own: Config
    world: VehicleWorld
    clock: MonotonicClock
    radio: Wire | None = None


def fly_vehicle(
    scenario: Scenario, own: Config, folder: Path, say: Callable[[str], None], *, engage: bool
) -> FlightResult:
    """Fly a scenario with the vehicle of a configuration file; the evader is whatever its evader source reports.

    Preflight must pass. Without `engage` a person has to order `guidance ctl start` and `guidance ctl engage`. Ctrl-C
    hands the vehicle over as the file says (flight.on_terminate).

    Args:
        scenario: The scenario.
        own: The vehicle's file.
        folder: For the record.
        say: Prints a line for the person.
        engage: A person allowed to start and to engage.

    Raises:
        ConfigError: If the two contradict each other.
        FlightError: If preflight refuses, or the start is outside of the fence.
        LinkError: If vehicle or evader cannot be reached.
    """
    plan_of(own, scenario)  # refused before anything is opened
    if scenario.fault:
        say("faults are a mock's: the vehicle flies without them")
    clock, mailbox = MonotonicClock(), Mailbox()
    hand_over = ORDER_OF[own.flight.on_terminate]
    signals = Signals(hand_over, _kept)
    with signals.installed(), contextlib.ExitStack() as closing:
        control = closing.enter_context(contextlib.closing(open_control(own, mailbox)))
        world = closing.enter_context(contextlib.closing(open_all(own, clock, tapped=True)))
        say(f"record   {folder / RECORD}")
        if not engage:
            say("waiting for a person: `guidance ctl start`, then `guidance ctl engage`")
        policy = MissionPolicy(engage, hand_over=hand_over)
        return _conducted(scenario, Reached(own, world, clock), policy, folder, mailbox, control, signals)


def fly_url(
    scenario: Scenario,
    asked: Asked,
    folder: Path,
    show: Show,
    *,
    on_record: Callable[[Path], None] = lambda _: None,
    control: str | None = None,
    on_control: Callable[[str], None] = lambda _: None,
) -> FlightResult:
    """Fly a scenario with the vehicle that runs at a URL; its evader is simulated here.

    Args:
        scenario: Who plays what, where and within which limits.
        asked: The URL, and how to fly there. Ctrl-C lands it.
        folder: For the record.
        show: Called in every cycle.
        on_record: Called with the record's path before the flight begins.
        control: Endpoint for orders and onlookers; a free one if that is in use. None opens none.
        on_control: Called with the endpoint.

    Raises:
        ConfigError: If an argument is wrong, or another autopilot is there.
        LinkError: If there is no vehicle.
        FlightError: If it is in the air, armed or does not get ready, or preflight refuses.
    """
    for_whom = f"a HEARTBEAT at {asked.url}, {FOUND_WITHIN_S:g} s at most"
    show(Progress(0.0, State.CONNECTING, "unknown", None, "s", waiting=for_whom))
    mailbox = Mailbox()
    mailbox.meanwhile(startup_answers(PURSUER, for_whom, FOUND_WITHIN_S, MonotonicClock()))
    with (
        opened(PURSUER, mailbox, control, on_control) as bus,
        reach(scenario, asked) as (own, world, clock, radio),
    ):
        began_s = time.perf_counter()
        home, frame = wait_until_placed(world.links[own.name], autopilot_named(own.vehicle.autopilot), clock, show)
        laid = laid_about(scenario, home, frame, own.vehicle.autopilot)
        if radio is not None:
            evader = EvaderHere(laid, clock, radio)
            world.players[EVADER], world.on_engage = evader, evader.engage
        on_record(folder / RECORD)
        hand_over = ORDER_OF[own.flight.on_terminate]
        signals = Signals(hand_over, _kept)
        policy = MissionPolicy(engage=True, end_with=ORDER_OF[asked.end], hand_over=hand_over)
        with signals.installed():
            mailbox.meanwhile(None)
            reached = Reached(own, world, clock, radio)
            result = _conducted(laid, reached, policy, folder, mailbox, bus, signals, show)
        result.wall_s = time.perf_counter() - began_s
    return result


def _conducted(
    scenario: Scenario,
    reached: Reached,
    policy: MissionPolicy,
    folder: Path,
    mailbox: Mailbox,
    bus: ControlBus | None,
    signals: Signals,
    show: Show = lambda _: None,
) -> FlightResult:
    own, world, clock, _ = reached
    metadata = flight_metadata(scenario, own, clock)
    with (
        contextlib.closing(Log(own.log.format, own.log.level)) as log,
        contextlib.closing(Notifier.from_environment(os.environ, os.getpid())) as notifier,
        recording(folder / RECORD, metadata, real_time=True) as record,
        broadcasting(own.name, bus, metadata) as broadcast,
    ):
        used = Equipment(mailbox=mailbox, log=log, notifier=notifier, record=record, broadcast=broadcast)
        flown = fly(
            (Pursuit(scenario, own.name),),
            world,
            clock,
            plans={own.name: plan_of(own, scenario)},
            equipment={own.name: used},
            policy=policy,
            show=show,
            signals=signals,
        )
        result = flown.vehicles[own.name]
        if broadcast is not None:
            broadcast.event(clock.now_s(), FLIGHT_OVER, closing_detail(result, "vehicle", folder))
        return result


@contextlib.contextmanager
def reach(scenario: Scenario, asked: Asked) -> Iterator[Reached]:
    """Find the vehicle at a URL and open its link, and a loopback port for the evader's reports.

    Raises:
        ConfigError: If an argument is wrong, or another autopilot is there.
        LinkError: If there is no vehicle.
    """
    clock = MonotonicClock()
    with contextlib.ExitStack() as closing:
        at_url = autopilot_at(asked.url, asked.autopilot, clock, who=f"--vehicle {asked.url}")
        wire, found, autopilot = closing.enter_context(at_url)
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
        world = open_all(own, clock, tapped=True, wire=wire, evader_wire=ears)
        closing.callback(world.close)
        yield Reached(own, world, clock, radio)


@contextlib.contextmanager
def checkup_at(scenario: Scenario, asked: Asked) -> Iterator[Checkup]:
    """Open the vehicle at a URL, to be judged by what a scenario asks of it.

    Raises:
        GuidanceError: For everything that the user can mend.
    """
    log = Log("console", "error")
    try:
        with reach(scenario, asked) as (own, world, clock, _):
            pursuer = scenario.pursuer.model_copy(update={"autopilot": own.vehicle.autopilot})
            plan = plan_of(own, scenario.model_copy(update={"pursuer": pursuer}))
            yield Checkup(own.name, plan, world, clock, log=log)
    finally:
        log.close()


def laid_about(scenario: Scenario, home: Home, frame: LocalFrame, autopilot: str) -> Scenario:
    """Return the scenario where the vehicle stands: its home is the scenario's, and the autopilot is its own.

    Faults and wind of the vehicle are a mock's and fall away; those of the evader stay, since it is a mock.

    Args:
        scenario: With a site of its own.
        home: Of the vehicle.
        frame: Its local frame.
        autopilot: The name of the one that is there.
    """
    x, y = scenario.home_m
    home_ned_m = frame.ned_from_wgs84(home.latitude_deg, home.longitude_deg, Amsl(home.altitude_amsl_m))
    north_m, east_m, down_m = (at + by for at, by in zip(home_ned_m, ned_from_game((-x, -y, 0.0)), strict=True))
    latitude_deg, longitude_deg, altitude = frame.wgs84_from_ned((north_m, east_m, down_m))
    return scenario.model_copy(
        update={
            "site": Site(latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude_amsl_m=altitude.metres),
            "pursuer": scenario.pursuer.model_copy(update={"autopilot": autopilot}),
            "fault": tuple(fault for fault in scenario.fault if fault.vehicle == EVADER),
            "wind": Wind(),
        }
    )


def left_out(scenario: Scenario) -> Sequence[str]:
    """Name what of a scenario a vehicle that is not ours flies without."""
    words = []
    if any(fault.vehicle != EVADER for fault in scenario.fault):
        words.append("faults of the pursuer")
    if any(scenario.wind.velocity_m_s):
        words.append("wind")
    return words


def _kept() -> NoReturn:
    raise ConfigError("a scenario is flown: end it and begin again to fly another configuration")
