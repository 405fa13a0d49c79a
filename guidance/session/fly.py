"""Scenarios flown from connecting to the end, in three ways: by the mock, by a vehicle file, or at a URL.

Each way opens what its flight needs (`Opened`); `fly_recorded` flies all of them.
"""

import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Final, NamedTuple

from guidance.autopilots import autopilot_named
from guidance.clock import Clock, MonotonicClock, VirtualClock
from guidance.errors import ConfigError
from guidance.flight import Event, State
from guidance.flight.settings import TeamSection
from guidance.frames import Amsl, GameFrame, LocalFrame
from guidance.links.opening import KINDS
from guidance.links.port import Wire, parse
from guidance.links.wires import MemoryWire, share
from guidance.links.world import World
from guidance.links.zenoh_team import ZenohTeam
from guidance.links.zenoh_wire import Session
from guidance.messages import Home
from guidance.session import control_bus, discovery
from guidance.session.checkup import Checkup
from guidance.session.daemon import Equipment
from guidance.session.flight_files import RECORD, TEAM, flight_metadata, recording, stopped_words
from guidance.session.loop import Signals
from guidance.session.mission import MOCKED, Mission, MissionPolicy, Progress, Show
from guidance.session.orders import ORDER_OF, Mailbox, startup_answers
from guidance.session.outputs import OutputOrder, open_outputs
from guidance.session.plan import SIMULATED_URL, TeamPlan, config_of, plan_of
from guidance.session.result import MissionResult, closing_detail
from guidance.session.service import open_all, open_equipment, open_vehicle
from guidance.session.vehicle_file import Config, Vehicle
from guidance.sim import live, mock_files, stepped
from guidance.sim.scenario import EVADER, EVADER_ID, PURSUER, Pursuit, Scenario, Site, Wind
from guidance.sim.team_flight import pursuits_of_team
from guidance.sim.teams import TeamScenario
from guidance.team import Member, MemoryTransport

ENDS: Final = ("return", "land")
"""Endings of a flight at a URL: fly home and land, or land at once."""


class Onlooker(NamedTuple):
    """Who watches a flight and gives it orders.

    Attributes:
        show: Called ten times a second and at every event.
        on_record: Called with the record's path when it is open.
        control: Endpoint for orders and broadcasts; a free one if that is in use. None opens none.
        on_control: Called with the endpoint.
    """

    show: Show = lambda _: None
    on_record: Callable[[Path], None] = lambda _: None
    control: str | None = None
    on_control: Callable[[str], None] = lambda _: None


NOBODY: Final = Onlooker()


Played = Scenario | TeamScenario
"""A scenario of one vehicle, or of a team."""


class Opened(NamedTuple):
    """Everything that a flight needs, open; by the vehicle's name. `configs` are of vehicles that are not mocks."""

    pursuits: Sequence[Pursuit]
    world: World
    clock: Clock
    buses: Mapping[str, Session]
    equipment: Mapping[str, Equipment]
    configs: Mapping[str, Config]
    policy: MissionPolicy = MOCKED
    signals: Signals | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class MockOptions:
    """How the mock flies.

    Attributes:
        fast: In virtual time; else in real time, with the mock as a live process.
        link: Which client flies in real time.
        port: Of the live mock's Zenoh session, or its first UDP port; 0 is any.
        over: Transport to the live mock.

    Raises:
        ConfigError: If an option has an unknown value.
    """

    fast: bool
    link: str = "mavsdk"
    port: int = 0
    over: str = "zenoh"

    def __post_init__(self) -> None:
        _check("--link", self.link, KINDS)
        _check("--over", self.over, live.OVER)

    @property
    def way(self) -> str:
        """The kind of run in an outcome row."""
        return "fast" if self.fast else "live"

    def open(self, scenario: Played, onlooker: Onlooker, stack: ExitStack) -> Opened:
        """Open the mocks, and take orders."""
        (pursuits, team) = _players(scenario)
        clock = VirtualClock() if self.fast else MonotonicClock()
        mock_files.faulted_fleet(pursuits)  # refuses faults that a vehicle cannot have
        mailboxes = {pursuit.vehicle: Mailbox() for pursuit in pursuits}
        equipment = {name: Equipment(mailbox=mailbox) for name, mailbox in mailboxes.items()}
        buses = stack.enter_context(
            control_bus.opened(mailboxes, onlooker.control, onlooker.on_control, team)
        )
        in_real_time = partial(live.LiveWorld, link=self.link, port=self.port, over=self.over)
        world = (stepped.SteppedWorld if self.fast else in_real_time)(pursuits, clock)
        return Opened(pursuits, stack.enter_context(closing(world)), clock, buses, equipment, {})


@dataclass(frozen=True, slots=True)
class ByFile:
    """The vehicle of a configuration file; the evader is whatever its evader source reports.

    Preflight must pass. Ctrl-C hands the vehicle over as the file says (flight.on_terminate).

    Attributes:
        config: The file's content.
        engage: A person allowed to start and to engage; else one has to order `guidance ctl start` and
            `guidance ctl engage`.
    """

    config: Config
    engage: bool
    way: ClassVar[str] = "vehicle"

    def open(self, scenario: Played, _: Onlooker, stack: ExitStack) -> Opened:
        """Open all that the file names, and wait for the vehicle.

        Raises:
            ConfigError: If file and scenario contradict each other, or a team plays.
            LinkError: If vehicle or evader cannot be reached.
        """
        config = self.config
        clock = MonotonicClock()
        if isinstance(scenario, TeamScenario):
            raise ConfigError(
                "--config: one vehicle; a team needs --vehicle URL for each of its vehicles"
            )
        plan_of(config, scenario)  # refused before anything is opened
        name = config.name
        hand_over = ORDER_OF[config.flight.on_terminate]
        signals = stack.enter_context(Signals(hand_over).installed())
        world, bus, equipment = open_vehicle(config, clock, stack, tapped=True)
        policy = MissionPolicy(self.engage, hand_over=hand_over)
        return Opened(
            (Pursuit(scenario, name),),
            world,
            clock,
            {name: bus},
            {name: equipment},
            {name: config},
            policy,
            signals,
        )


@dataclass(frozen=True, slots=True)
class Asked:
    """Vehicles that run at URLs, one for each of the scenario; their evaders are simulated here. Ctrl-C lands them.

    See `guidance fly --help`.

    Raises:
        ConfigError: If an option has an unknown value.
    """

    urls: tuple[str, ...]
    autopilot: str | None = None
    link: str = "mavsdk"
    end: str = "return"
    way: ClassVar[str] = "vehicle"

    def __post_init__(self) -> None:
        _check("--link", self.link, KINDS)
        _check("--end", self.end, ENDS)
        for url in self.urls:
            parse(url)

    def open(self, scenario: Played, onlooker: Onlooker, stack: ExitStack) -> Opened:
        """Find the vehicles, wait until they know their places, and lay the scenario about the home of the first.

        Raises:
            ConfigError: If another autopilot is there, or the number of URLs is wrong.
            LinkError: If there is no vehicle.
            FlightError: If one is in the air, armed or does not get ready.
        """
        (pursuits, team) = _players(scenario)
        clock = MonotonicClock()
        if len(self.urls) != len(pursuits):
            words = f"the scenario has {len(pursuits)} vehicles: give one URL each"
            raise ConfigError(f"--vehicle: {len(self.urls)} given; {words}")
        mailboxes = {one.vehicle: Mailbox() for one in pursuits}
        buses = stack.enter_context(
            control_bus.opened(mailboxes, onlooker.control, onlooker.on_control, team)
        )
        self._announce(mailboxes, onlooker, clock)
        world = stack.enter_context(closing(World()))
        configs, radios = self.reach(scenario, clock, world)
        laid = _laid_where_they_stand(pursuits, configs, world, clock, onlooker.show)
        for name, radio in radios.items():
            chased = next(pursuit.scenario for pursuit in laid if pursuit.evader == name)
            world.players[name] = stepped.EvaderHere(chased, clock, radio)
        policy = MissionPolicy(engage=True, end_with=ORDER_OF[self.end], hand_over=Event.LAND)
        signals = stack.enter_context(Signals(Event.LAND).installed())
        equipment = {
            name: open_equipment(box, configs[name], stack) for name, box in mailboxes.items()
        }
        return Opened(laid, world, clock, buses, equipment, configs, policy, signals)

    def _announce(self, mailboxes: Mapping[str, Mailbox], onlooker: Onlooker, clock: Clock) -> None:
        """Show which HEARTBEATs are awaited; orders are answered with that meanwhile."""
        for (name, mailbox), url in zip(mailboxes.items(), self.urls, strict=True):
            waiting = f"a HEARTBEAT at {url}, {discovery.FOUND_WITHIN_S:g} s at most"
            onlooker.show(
                Progress(0.0, State.CONNECTING, "unknown", None, "s", waiting=waiting, vehicle=name)
            )
            mailbox.meanwhile = startup_answers(name, waiting, discovery.FOUND_WITHIN_S, clock)

    def reach(
        self, scenario: Played, clock: Clock, world: World
    ) -> tuple[Mapping[str, Config], Mapping[str, Wire]]:
        """Find the vehicles and open their links in a world, and a wire in memory for each evader's reports.

        Args:
            scenario: Who pursues whom, and the separation of a team.
            clock: Of the process.
            world: Closes what was opened.

        Returns:
            The vehicles' configurations by name, and the evaders' ends of the wires by name.

        Raises:
            ConfigError: If another autopilot is there.
            LinkError: If there is no vehicle.
        """
        pursuits, _ = _players(scenario)
        separation = _separation(scenario)
        speeds_m_s = _declared_m_s(pursuits)
        configs = dict[str, Config]()
        radios = dict[str, Wire]()
        receivers = dict[str, Iterator[Wire]]()
        for name in speeds_m_s:
            radios[name], receiver = MemoryWire.pair(clock.now_s)
            receivers[name] = iter(share(receiver, len(pursuits)))
        for pursuit, url in zip(pursuits, self.urls, strict=True):
            wire, vehicle = self._vehicle_at(url, clock, world)
            team = None
            if separation is not None:
                team = {**_team_keys(pursuit, pursuits, speeds_m_s), **separation}
            config = config_of(pursuit.scenario, pursuit.vehicle, vehicle, team)
            configs[pursuit.vehicle] = config
            wires = {pursuit.vehicle: wire}
            for name, shares in receivers.items():
                wires[name] = next(shares)
            open_all(config, clock, world, tapped=True, wires=wires)
        return configs, radios

    def _vehicle_at(self, url: str, clock: Clock, world: World) -> tuple[Wire, Vehicle]:
        """Find the autopilot at a URL; return its wire, which the world closes, and its [vehicle] section."""
        at_url = discovery.autopilot_at(url, self.autopilot, clock, who=f"--vehicle {url}")
        wire, sender, autopilot = world.closing.enter_context(at_url)
        vehicle = Vehicle(
            autopilot=autopilot.name,
            link=self.link,
            url=url,
            system_id=sender.system_id,
            component_id=sender.component_id,
        )
        return wire, vehicle


def _team_keys(
    pursuit: Pursuit, pursuits: Sequence[Pursuit], speeds_m_s: Mapping[str, float]
) -> dict[str, Any]:
    """Return the keys of a vehicle file's [team] section for one vehicle of a scenario's team."""
    simulated = {"kind": "global_position", "url": SIMULATED_URL, "system_id": EVADER_ID}
    others = {
        name: {**simulated, "speed_m_s": speed_m_s}
        for name, speed_m_s in speeds_m_s.items()
        if name != pursuit.evader
    }
    mates = [mate.vehicle for mate in pursuits if mate.vehicle != pursuit.vehicle]
    return {"name": TEAM, "mates": mates, "evader": pursuit.evader, "evaders": others}


def _laid_where_they_stand(
    pursuits: Sequence[Pursuit],
    configs: Mapping[str, Config],
    world: World,
    clock: Clock,
    show: Show,
) -> list[Pursuit]:
    """Wait until the vehicles know their places; return the pursuits about the home of the first one."""
    laid = list[Pursuit]()
    for pursuit in pursuits:
        name = pursuit.vehicle
        autopilot = autopilot_named(configs[name].vehicle.autopilot)
        home, frame = discovery.wait_until_placed(world.links[name], autopilot, clock, show, name)
        scenario = laid_about(pursuit.scenario, home, frame, autopilot.name)
        site = laid[0].scenario.site if laid else scenario.site
        laid.append(pursuit._replace(scenario=scenario.model_copy(update={"site": site})))
    return laid


def _players(scenario: Played) -> tuple[Sequence[Pursuit], str]:
    """Return who pursues whom, and the name of the team; empty without one."""
    if isinstance(scenario, Scenario):
        return (Pursuit(scenario),), ""
    return pursuits_of_team(scenario), TEAM


def _check(option: str, value: str, allowed: Sequence[str]) -> None:
    if value not in allowed:
        raise ConfigError(f"{option} {value}: allowed are {', '.join(allowed)}")


Way = MockOptions | ByFile | Asked


def fly_recorded(
    scenario: Played, folder: Path | None, how: Way, onlooker: Onlooker = NOBODY
) -> MissionResult:
    """Fly a scenario of one vehicle or of a team, with records, and broadcasts where orders are taken.

    Args:
        scenario: The scenario.
        folder: For the record; in a team each vehicle has a folder of its name in it. None keeps no record.
        how: The mocks, a vehicle file, or URLs.
        onlooker: Who watches, and gives orders.

    Raises:
        GuidanceError: For everything that the user can mend.
    """
    with ExitStack() as stack:
        flight = how.open(scenario, onlooker, stack)
        pursuits = flight.pursuits
        clock = flight.clock
        policy = flight.policy
        show = onlooker.show
        team = team_plan(scenario, pursuits) if isinstance(scenario, TeamScenario) else None
        plans = {
            pursuit.vehicle: plan_of(flight.configs.get(pursuit.vehicle), pursuit.scenario, team)
            for pursuit in pursuits
        }
        _equip(flight, scenario, folder, stack)
        if folder is not None:
            onlooker.on_record(folder if team else folder / RECORD)
        equipment = flight.equipment
        mission = Mission(
            pursuits,
            flight.world,
            clock,
            plans=plans,
            equipment=equipment,
            policy=policy,
            show=show,
        )
        result = mission.fly(flight.signals)
        for daemon in mission.daemons:
            if equipment[daemon.name].sinks:
                flight_result = result.vehicles[daemon.name]
                record = equipment[daemon.name].record
                detail = closing_detail(flight_result, how.way, record, folder)
                daemon.recording.over(clock.now_s(), detail)
    for (
        name,
        flight_result,
    ) in result.vehicles.items():  # the records are closed: note what is missing
        if (record := equipment[name].record) is not None:
            flight_result.record_dropped = record.dropped
            if record.failed is not None and not flight_result.record_stopped:
                flight_result.record_stopped = stopped_words(
                    flight_result.duration_s, record.failed
                )
    return result


def _separation(scenario: Played) -> dict[str, float] | None:
    """Return how far the vehicles of a team stay from each other; None without a team."""
    return (
        None
        if isinstance(scenario, Scenario)
        else scenario.flight.model_dump(include={*TeamSection.model_fields})
    )


def _declared_m_s(pursuits: Sequence[Pursuit]) -> dict[str, float]:
    """Return the declared speeds of the evaders, by name."""
    return {
        pursuit.evader: pursuit.scenario.evader.believed_speed_m_s for pursuit in reversed(pursuits)
    }


def team_plan(scenario: TeamScenario, pursuits: Sequence[Pursuit]) -> TeamPlan:
    """Return what all vehicles of a scenario's team share."""
    flight = scenario.flight
    team = TeamSection(
        separation_m=flight.separation_m, separation_height_m=flight.separation_height_m
    )
    return TeamPlan(team=team, evaders=_declared_m_s(pursuits))


def _equip(flight: Opened, scenario: Played, folder: Path | None, stack: ExitStack) -> None:
    """Give all vehicles their records, and broadcasts where orders are taken.

    Those of a team are connected until the stack is closed: over the control buses, or in virtual time by a network in
    this process.
    """
    names = [pursuit.vehicle for pursuit in flight.pursuits]
    evaders = sorted({pursuit.evader for pursuit in flight.pursuits})
    now_s = flight.clock.now_s
    stamp = flight.clock if flight.world.real_time else None
    ends = dict[str, MemoryTransport]()
    for number, (own, name, first) in enumerate(flight.pursuits):
        metadata = flight_metadata(own, flight.configs.get(name), stamp)
        bus = flight.buses.get(name)
        used = flight.equipment[name]
        if isinstance(scenario, TeamScenario):
            metadata |= {
                TEAM: team_plan(scenario, flight.pursuits).model_dump_json(),
                "vehicle": name,
            }
            transport = (
                ZenohTeam(now_s, bus, TEAM, name, names)
                if bus
                else MemoryTransport(name, ends, now_s)
            )
            stack.callback(transport.close)
            epoch = random.Random(f"{own.seed} {number}").getrandbits(48)
            above_m = scenario.flight.separation_height_m
            used.team = Member(
                name, names, [first, *evaders], transport, epoch=epoch, separation_height_m=above_m
            )
        if folder is not None:
            path = (folder if used.team is None else folder / name) / RECORD
            used.record = stack.enter_context(
                recording(path, metadata, real_time=flight.world.real_time)
            )
        link = flight.world.links[name]
        config = flight.configs.get(name)
        order = OutputOrder(name, metadata, flight.clock, link, used.mailbox, config, bus)
        used.sinks += open_outputs(order, stack)


@contextmanager
def checkup_at(scenario: Scenario, asked: Asked) -> Iterator[Checkup]:
    """Open the vehicle at a URL, to be judged by what a scenario asks of it.

    Raises:
        GuidanceError: For everything that the user can mend.
    """
    clock = MonotonicClock()
    with closing(World()) as world:
        configs, _ = asked.reach(scenario, clock, world)
        config = configs[PURSUER]
        pursuer = scenario.pursuer.model_copy(update={"autopilot": config.vehicle.autopilot})
        yield Checkup(
            config.name,
            plan_of(config, scenario.model_copy(update={"pursuer": pursuer})),
            world,
            clock,
        )


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
    home_ned_m = frame.ned_from_wgs84(
        home.latitude_deg, home.longitude_deg, Amsl(home.altitude_amsl_m)
    )
    site_ned_m = GameFrame(home_ned_m).position_to_ned((-x, -y, 0.0))
    latitude_deg, longitude_deg, altitude = frame.wgs84_from_ned(site_ned_m)
    update: dict[str, Any] = {
        "site": Site(
            latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude_amsl_m=altitude.metres
        ),
        "pursuer": scenario.pursuer.model_copy(update={"autopilot": autopilot}),
        "fault": tuple(fault for fault in scenario.fault if fault.vehicle == EVADER),
        "wind": Wind(),
    }
    return scenario.model_copy(update=update)


def left_out(scenario: Played, how: Way) -> Sequence[str]:
    """Name what of a scenario a vehicle that is not ours flies without."""
    if isinstance(how, MockOptions) or isinstance(scenario, TeamScenario):
        return ()
    faults = any(fault.vehicle != EVADER or isinstance(how, ByFile) for fault in scenario.fault)
    return [
        feature
        for feature, lost in (("faults", faults), ("wind", any(scenario.wind.velocity_m_s)))
        if lost
    ]
