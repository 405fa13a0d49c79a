"""Vehicles that run at URLs."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from typing import Any, ClassVar, Final

from guidance.clock import Clock, MonotonicClock
from guidance.errors import ConfigError
from guidance.flight import Event, State
from guidance.flight.settings import TeamSection
from guidance.frames import Amsl, Enu, GameFrame, LocalFrame
from guidance.links.kinds import LINKS
from guidance.links.port import Wire, is_px4, parse
from guidance.links.section import Vehicle
from guidance.links.wires.base import MemoryWire, share
from guidance.links.world import World
from guidance.messages import Home
from guidance.session.flight_files import TEAM_FOLDER
from guidance.session.fly.loop import Signals
from guidance.session.fly.mission import MissionPolicy, Progress, Show
from guidance.session.open import discovery
from guidance.session.open.links import open_all, open_equipment
from guidance.session.open.opened import (
    FlyableScenario,
    Onlooker,
    Opened,
    check_option,
    declared_m_s,
    lost_features,
    pursuits_and_team,
)
from guidance.session.orders import control_bus
from guidance.session.orders.mailbox import ORDER_OF, Mailbox, startup_answers
from guidance.session.plan import SIMULATED_URL, config_of
from guidance.session.vehicle_file import Config
from guidance.sim import stepped
from guidance.sim.scenario import EVADER, EVADER_ID, Pursuit, Scenario, Site, Wind

ENDS: Final = ("return", "land")
"""Endings of a flight at a URL: fly home and land, or land at once."""


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
    parameters: tuple[str, ...] = ()
    way: ClassVar[str] = "vehicle"

    def __post_init__(self) -> None:
        by_mavlink = [name for name, kind in LINKS.importable().items() if kind.by_mavlink]
        check_option("--link", self.link, by_mavlink)
        check_option("--end", self.end, ENDS)
        for url in (*self.urls, *self.parameters):
            parse(url)
        if self.parameters and len(self.parameters) != len(self.urls):
            raise ConfigError(f"--parameters: {len(self.parameters)} given; one for each --vehicle")

    def open(self, scenario: FlyableScenario, onlooker: Onlooker, stack: ExitStack) -> Opened:
        """Find the vehicles, wait until they know their places, and lay the scenario about the home of the first.

        Raises:
            ConfigError: If another autopilot is there, or the number of URLs is wrong.
            LinkError: If there is no vehicle.
            FlightError: If one is in the air, armed or does not get ready.
        """
        (pursuits, team) = pursuits_and_team(scenario)
        clock = MonotonicClock()
        vehicles = len(pursuits)
        if len(self.urls) != vehicles:
            words = f"the scenario has {vehicles} vehicles: give one URL each"
            raise ConfigError(f"--vehicle: {len(self.urls)} given; {words}")
        mailboxes = {pursuit.vehicle: Mailbox() for pursuit in pursuits}
        buses = stack.enter_context(
            control_bus.opened(mailboxes, onlooker.control, onlooker.on_control, team)
        )
        # Until then, the answer to an order names the awaited message.
        for (name, mailbox), url in zip(mailboxes.items(), self.urls, strict=True):
            awaited = "VehicleStatus of PX4" if is_px4(url) else "a HEARTBEAT"
            waiting = f"{awaited} at {url}, {discovery.FOUND_WITHIN_S:g} s at most"
            onlooker.show(
                Progress(0.0, State.CONNECTING, "unknown", None, "s", waiting=waiting, vehicle=name)
            )
            mailbox.meanwhile = startup_answers(name, waiting, discovery.FOUND_WITHIN_S, clock)
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

    def left_out(self, scenario: FlyableScenario) -> Sequence[str]:
        """Name the features of a scenario that these vehicles fly without."""
        return lost_features(scenario, evader_simulated=True)

    def reach(
        self, scenario: FlyableScenario, clock: Clock, world: World
    ) -> tuple[Mapping[str, Config], Mapping[str, Wire]]:
        """Find the vehicles and open their links in a world, and a wire in memory for each evader's reports.

        Args:
            scenario: Who pursues whom, and the separation of a team.
            clock: Of the process.
            world: Closes everything opened here.

        Returns:
            The vehicles' configurations by name, and the evaders' ends of the wires by name.

        Raises:
            ConfigError: If another autopilot is there.
            LinkError: If there is no vehicle.
        """
        pursuits = pursuits_and_team(scenario)[0]
        separation: dict[str, float] | None = None
        if not isinstance(scenario, Scenario):
            # Separation of the vehicles of a team.
            separation = scenario.flight.model_dump(include=set(TeamSection.model_fields))
        speeds_m_s = declared_m_s(pursuits)
        configs = dict[str, Config]()
        # A wire for each evader, and the shares of its other end, one for each vehicle.
        radios = dict[str, Wire]()
        receivers = dict[str, Iterator[Wire]]()
        for name in speeds_m_s:
            radio, receiver = MemoryWire.pair(clock.now_s)
            radios[name] = radio
            receivers[name] = iter(share(receiver, len(pursuits)))
        beside = self.parameters if self.parameters else (None,) * len(self.urls)
        for pursuit, url, mavlink_url in zip(pursuits, self.urls, beside, strict=True):
            wire, vehicle = self._vehicle_at(url, mavlink_url, clock, world)
            team = None
            if separation is not None:
                simulated = {
                    "kind": "global_position",
                    "url": SIMULATED_URL,
                    "system_id": EVADER_ID,
                }
                others = dict[str, dict[str, Any]]()
                for name, speed_m_s in speeds_m_s.items():
                    if name != pursuit.evader:
                        others[name] = {**simulated, "speed_m_s": speed_m_s}
                mates = [mate.vehicle for mate in pursuits if mate.vehicle != pursuit.vehicle]
                team = {
                    "name": TEAM_FOLDER,
                    "mates": mates,
                    "evader": pursuit.evader,
                    "evaders": others,
                    **separation,
                }
            config = config_of(pursuit.scenario, pursuit.vehicle, vehicle, team)
            configs[pursuit.vehicle] = config
            wires = dict[str, Wire]()
            if wire is not None:
                wires[pursuit.vehicle] = wire
            for name, shares in receivers.items():
                wires[name] = next(shares)
            open_all(config, clock, world, tapped=True, wires=wires)
        return configs, radios

    def _vehicle_at(
        self, url: str, mavlink_url: str | None, clock: Clock, world: World
    ) -> tuple[Wire | None, Vehicle]:
        """Find the autopilot at a URL; return its MAVLink wire, which the world closes, and its [vehicle] section."""
        if not is_px4(url):
            if mavlink_url is not None:
                raise ConfigError(
                    f"--parameters: only with zenoh+tcp:// or zenoh+tls://, not {url}"
                )
            at_url = discovery.autopilot_at(url, self.autopilot, clock, who=f"--vehicle {url}")
            wire, sender, autopilot = world.closing.enter_context(at_url)
            ids = {"system_id": sender.system_id, "component_id": sender.component_id}
            keys = {"autopilot": autopilot.name, "link": self.link, "url": url}
            return wire, Vehicle.model_validate({**keys, **ids})
        own_wire: Wire | None = None
        ids = {}
        if mavlink_url is not None:
            who = f"--parameters {mavlink_url}"
            beside = discovery.autopilot_at(mavlink_url, "px4", clock, who=who)
            own_wire, sender, _ = world.closing.enter_context(beside)
            ids = {"system_id": sender.system_id, "component_id": sender.component_id}
        keys = {"autopilot": "px4", "link": "zenoh", "url": url}
        limit_s = discovery.FOUND_WITHIN_S
        more = {"parameters": mavlink_url, "connect_timeout_s": limit_s}
        return own_wire, Vehicle.model_validate({**keys, **ids, **more})


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
        autopilot = configs[name].vehicle.profile
        home, frame = discovery.wait_until_placed(world.links[name], autopilot, clock, show, name)
        scenario = laid_about(pursuit.scenario, home, frame, autopilot.name)
        site = laid[0].scenario.site if laid else scenario.site
        shared_site = scenario.model_copy(update={"site": site})
        laid.append(pursuit._replace(scenario=shared_site))
    return laid


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
    site_ned_m = GameFrame(home_ned_m).position_to_ned(Enu((-x, -y, 0.0)))
    latitude_deg, longitude_deg, altitude = frame.wgs84_from_ned(site_ned_m)
    site = Site(
        latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude_amsl_m=altitude.metres
    )
    pursuer = scenario.pursuer.model_copy(update={"autopilot": autopilot})
    faults = tuple(fault for fault in scenario.fault if fault.vehicle == EVADER)
    update: dict[str, Any] = {"site": site, "pursuer": pursuer, "fault": faults, "wind": Wind()}
    return scenario.model_copy(update=update)
