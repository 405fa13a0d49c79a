"""Team flights on mocks: a daemon for each vehicle, and a transport between them."""

import contextlib
import json
import math
import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

from guidance.autopilots import autopilot_named
from guidance.clock import Clock
from guidance.errors import ConfigError
from guidance.flight import Event
from guidance.flight.settings import TeamSection
from guidance.flight.table import SETPOINT_STATES
from guidance.frames import Vector
from guidance.links.zenoh_team import ZenohTeam
from guidance.log.broadcast import Broadcast
from guidance.session.control_bus import opened
from guidance.session.control_socket import ENDPOINT
from guidance.session.daemon import Equipment
from guidance.session.discovery import wait_until_placed
from guidance.session.flight_files import RECORD, TEAM, flight_metadata, recording, with_team
from guidance.session.fly import NOBODY, Asked, MockOptions, Onlooker, fly, kept, laid_about, reach
from guidance.session.log import Log
from guidance.session.loop import Signals, World
from guidance.session.mission import MOCKED, MissionPolicy
from guidance.session.orders import ORDER_OF, Mailbox
from guidance.session.plan import plan_of
from guidance.session.result import MissionResult
from guidance.session.vehicle_file import Config
from guidance.sim.scenario import Pursuit
from guidance.sim.stepped import EvaderHere
from guidance.sim.team_flight import pursuits_of_team, rows_of
from guidance.sim.teams import TeamOutcome, TeamScenario
from guidance.team import Member, MemoryNetwork, Transport

DELAY_S = 0.02
"""Delay of the messages between the vehicles in virtual time."""

Join = Callable[[str], Transport]
"""Connects a vehicle to its team."""


class Opened(NamedTuple):
    """Who pursues whom, in which world and by which clock; configurations of vehicles at URLs, by name."""

    pursuits: tuple[Pursuit, ...]
    world: World
    clock: Clock
    configs: Mapping[str, Config]


class TeamFlight(NamedTuple):
    """A team flight: its rows (one for each evader), its result, and the least distances between vehicles.

    Attributes:
        rows: One for each evader.
        result: Of all vehicles and evaders.
        least_m: Least distance of two vehicles in the air, horizontally, while their heights differed by less than the
            separation; infinite if they never did.
        members: Knowledge of each vehicle at the end.
    """

    rows: list[TeamOutcome]
    result: MissionResult
    least_m: float
    members: dict[str, Member]


def team_document(scenario: TeamScenario) -> str:
    """Return the separation and the speeds of all evaders as JSON."""
    separation = {name: getattr(scenario.flight, name) for name in TeamSection.model_fields}
    speeds = {one.evader: one.scenario.evader.believed_speed_m_s for one in pursuits_of_team(scenario)}
    return json.dumps({"team": separation, "evaders": speeds})


def fly_team(
    scenario: TeamScenario,
    how: MockOptions | Sequence[Asked],
    *,
    folder: Path | None = None,
    onlooker: Onlooker = NOBODY,
    join: Callable[[Clock], Join] | None = None,
) -> TeamFlight:
    """Fly a scenario of teams with mocks, or with vehicles that run at URLs; their evaders are simulated here.

    Args:
        scenario: The scenario.
        how: The mocks, or one URL for each vehicle. Ctrl-C lands vehicles at URLs.
        folder: For the records, one folder for each vehicle; None keeps none.
        onlooker: Who watches, and gives orders; `show` is called for each vehicle in every cycle.
        join: Makes the transports; by default a network in this process, or in real time the sessions for orders.

    Raises:
        GuidanceError: For everything that the user can mend.
    """
    fast = isinstance(how, MockOptions) and how.fast
    members, equipment, document = {}, {}, team_document(scenario)
    with contextlib.ExitStack() as closing:
        log = closing.enter_context(contextlib.closing(Log("console", "error")))
        flown = (
            _mocks(scenario, how, closing)
            if isinstance(how, MockOptions)
            else _reached(scenario, how, closing, onlooker)
        )
        pursuits, world, clock, configs = flown
        names, evaders = [one.vehicle for one in pursuits], sorted({one.evader for one in pursuits})
        network = None if not fast else MemoryNetwork(clock.now_s, delay_s=DELAY_S, seed=scenario.seed).join
        connect = network if join is None else join(clock)
        mailboxes = {name: Mailbox() for name in names}
        orders = opened(mailboxes, None if fast else ENDPOINT, onlooker.on_control, team=TEAM)
        buses = closing.enter_context(orders)
        for number, pursuit in enumerate(pursuits):
            name, own = pursuit.vehicle, configs.get(pursuit.vehicle)
            if connect is None:
                transport: Transport = ZenohTeam(clock.now_s, buses[name].session, TEAM, name, names)
            else:
                transport = connect(name)
            closing.callback(transport.close)
            members[name] = Member(
                name,
                names,
                sorted(evaders, key=lambda evader: evader != pursuit.evader),
                transport,
                epoch=random.Random(f"{scenario.seed} {number}").getrandbits(48),
                separation_height_m=scenario.flight.separation_height_m,
            )
            metadata = flight_metadata(pursuit.scenario, own, None if fast else clock)
            metadata |= {TEAM: document, "vehicle": name}
            record, broadcast = None, None
            if folder is not None:
                record = closing.enter_context(recording(folder / name / RECORD, metadata, real_time=not fast))
            if name in buses:
                broadcast = closing.enter_context(contextlib.closing(Broadcast(name, buses[name].session, metadata)))
            equipment[name] = Equipment(
                mailbox=mailboxes[name], log=log, record=record, broadcast=broadcast, team=members[name]
            )
        plans = {one.vehicle: plan_of(configs.get(one.vehicle), one.scenario) for one in pursuits}
        policy, signals = MOCKED, None
        if not isinstance(how, MockOptions):
            policy = MissionPolicy(engage=True, end_with=ORDER_OF[how[0].end], hand_over=Event.LAND)
            signals = Signals(Event.LAND, kept)
            closing.enter_context(signals.installed())
        result = fly(
            pursuits,
            world,
            clock,
            plans={name: replace(plan, flight=with_team(plan.flight, document)) for name, plan in plans.items()},
            equipment=equipment,
            policy=policy,
            show=onlooker.show,
            signals=signals,
        )
    way = how.way if isinstance(how, MockOptions) else Asked.way
    rows = _rows(scenario, way, result, members)
    return TeamFlight(rows, result, least_distance_m(result, scenario.flight.separation_height_m), members)


def _mocks(scenario: TeamScenario, options: MockOptions, closing: contextlib.ExitStack) -> Opened:
    pursuits, clock = pursuits_of_team(scenario), options.clock()
    world = options.world(pursuits, clock)
    closing.callback(world.close)
    return Opened(pursuits, world, clock, {})


def _reached(
    scenario: TeamScenario, asked: Sequence[Asked], closing: contextlib.ExitStack, onlooker: Onlooker
) -> Opened:
    """Open the vehicles at URLs, and lay the scenario about the first one's home."""
    pursuits, flight = pursuits_of_team(scenario), scenario.flight
    if len(asked) != len(pursuits):
        raise ConfigError(
            f"--vehicle: {len(asked)} given; the scenario has {len(pursuits)} vehicles: give one URL each"
        )
    separation = TeamSection(separation_m=flight.separation_m, separation_height_m=flight.separation_height_m)
    reached = closing.enter_context(reach(pursuits, asked, separation))
    world, clock, laid = reached.world, reached.clock, list[Pursuit]()
    for pursuit in pursuits:
        autopilot = autopilot_named(reached.configs[pursuit.vehicle].vehicle.autopilot)
        home, frame = wait_until_placed(world.links[pursuit.vehicle], autopilot, clock, onlooker.show)
        here = laid_about(pursuit.scenario, home, frame, autopilot.name)
        site = laid[0].scenario.site if laid else here.site
        laid.append(pursuit._replace(scenario=here.model_copy(update={"site": site})))
    for name, radio in reached.radios.items():
        chased = next(one.scenario for one in laid if one.evader == name)
        world.players[name] = EvaderHere(chased, clock, radio)
    return Opened(tuple(laid), world, clock, reached.configs)


def _rows(
    scenario: TeamScenario,
    way: str,
    result: MissionResult,
    members: Mapping[str, Member],
) -> list[TeamOutcome]:
    """Return the rows; the game began when the last vehicle engaged. Without a game there are none."""
    begun = [[one.now_s for one in each.happenings if one.event is Event.GUIDED] for each in result.vehicles.values()]
    if not all(begun):
        return []
    began_s, vehicles, names = max(times[0] for times in begun), list(result.vehicles), sorted(result.evaders)
    starts = [_at([(one.now_s, one.pursuer_m) for one in result.vehicles[name].samples], began_s) for name in vehicles]
    ends = []
    for name in names:
        evader = result.evaders[name]
        arrived_s = min((one.board.over.get(name, math.inf) for one in members.values()), default=math.inf)
        if evader.captured_by is not None:
            captor = vehicles.index(evader.captured_by)
            ends.append(("captured", evader.captured_s, _at(evader.track, evader.captured_s), captor))
        else:
            end, end_s = ("arrived", arrived_s) if math.isfinite(arrived_s) else ("time_up", evader.track[-1][0])
            ends.append((end, end_s, _at(evader.track, end_s), -1))
    return rows_of(scenario, way, (began_s, starts, [_at(result.evaders[name].track, began_s) for name in names]), ends)


def _at(track: Sequence[tuple[float, Vector]], now_s: float) -> Vector:
    """Return the last place of a track until a time."""
    return next((place for at_s, place in reversed(track) if at_s <= now_s), track[0][1])


def least_distance_m(result: MissionResult, height_m: float) -> float:
    """Return the least horizontal distance of two flying vehicles whose heights differed by less than `height_m`."""
    tracks = [
        {one.now_s: one.pursuer_m for one in each.samples if one.state in SETPOINT_STATES}
        for each in result.vehicles.values()
    ]
    return min(
        (
            math.dist(one[now_s][:2], other[now_s][:2])
            for one, other in combinations(tracks, 2)
            for now_s in one.keys() & other.keys()
            if abs(one[now_s][2] - other[now_s][2]) < height_m
        ),
        default=math.inf,
    )
