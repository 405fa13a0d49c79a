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

from guidance.clock import Clock, MonotonicClock, VirtualClock
from guidance.flight import Event
from guidance.flight.settings import TeamSection
from guidance.flight.table import SETPOINT_STATES
from guidance.frames import Vector
from guidance.links.zenoh_team import ZenohTeam
from guidance.links.zenoh_wire import open_session
from guidance.session.daemon import Equipment
from guidance.session.flight_files import RECORD, TEAM, flight_metadata, recording, with_team
from guidance.session.fly import MockOptions, fly
from guidance.session.mission import Show
from guidance.session.plan import plan_of
from guidance.session.result import MissionResult
from guidance.sim.live import LiveWorld
from guidance.sim.scenario import Pursuit
from guidance.sim.stepped import SteppedWorld
from guidance.sim.team_flight import pursuits_of_team, rows_of
from guidance.sim.teams import TeamOutcome, TeamScenario
from guidance.team import Member, MemoryNetwork, Transport

DELAY_S = 0.02
"""Delay of the messages between the vehicles in virtual time."""

Join = Callable[[str], Transport]
"""Connects a vehicle to its team."""


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
    options: MockOptions,
    *,
    folder: Path | None = None,
    show: Show = lambda _: None,
    join: Callable[[Clock], Join] | None = None,
) -> TeamFlight:
    """Fly a scenario of teams against mocks.

    Args:
        scenario: The scenario.
        options: Real or virtual time, and links.
        folder: For the records, one folder for each vehicle; None keeps none.
        show: Called for each vehicle in every cycle.
        join: Makes the transports; by default a network in this process, or Zenoh in real time.

    Raises:
        GuidanceError: For everything that the user can mend.
    """
    clock: Clock = VirtualClock() if options.fast else MonotonicClock()
    pursuits = pursuits_of_team(scenario)
    members, equipment, document = {}, {}, team_document(scenario)
    with contextlib.ExitStack() as closing:
        world: SteppedWorld | LiveWorld = closing.enter_context(contextlib.closing(_world(pursuits, clock, options)))
        connect = _connection(world, clock, scenario.seed, closing) if join is None else join(clock)
        for number, pursuit in enumerate(pursuits):
            transport = connect(pursuit.vehicle)
            closing.callback(transport.close)
            members[pursuit.vehicle] = member = Member(
                pursuit.vehicle,
                [one.vehicle for one in pursuits],
                sorted({one.evader for one in pursuits}, key=lambda name: (name != pursuit.evader, name)),
                transport,
                epoch=random.Random(f"{scenario.seed} {number}").getrandbits(48),
                separation_height_m=scenario.flight.separation_height_m,
            )
            record = None
            if folder is not None:
                metadata = flight_metadata(pursuit.scenario, None, None if options.fast else clock)
                metadata |= {TEAM: document, "vehicle": pursuit.vehicle}
                path = folder / pursuit.vehicle / RECORD
                record = closing.enter_context(recording(path, metadata, real_time=not options.fast))
            equipment[pursuit.vehicle] = Equipment(record=record, team=member)
        alone = {one.vehicle: plan_of(scenario=one.scenario) for one in pursuits}
        plans = {name: replace(plan, flight=with_team(plan.flight, document)) for name, plan in alone.items()}
        result = fly(pursuits, world, clock, plans=plans, equipment=equipment, show=show)
    rows = _rows(scenario, options.way, result, members)
    return TeamFlight(rows, result, least_distance_m(result, scenario.flight.separation_height_m), members)


def _world(pursuits: tuple[Pursuit, ...], clock: Clock, options: MockOptions) -> SteppedWorld | LiveWorld:
    if options.fast:
        return SteppedWorld(pursuits, clock)
    return LiveWorld(pursuits, clock, link=options.link, port=options.port, over=options.over)


def _connection(world: SteppedWorld | LiveWorld, clock: Clock, seed: int, closing: contextlib.ExitStack) -> Join:
    """Return how vehicles join: a network in virtual time, or in real time Zenoh, routed by the mock's session."""
    if isinstance(world, SteppedWorld):
        return MemoryNetwork(clock.now_s, delay_s=DELAY_S, seed=seed).join
    endpoint, names = world.endpoint, list(world.links)
    return lambda vehicle: ZenohTeam(clock.now_s, closing.enter_context(open_session(endpoint)), TEAM, vehicle, names)


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
