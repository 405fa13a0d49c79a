"""What a flight of a team has besides: its members and the transport between them, and the rows of its outcome."""

import contextlib
import json
import math
import random
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from guidance.clock import Clock
from guidance.flight import Event
from guidance.flight.settings import TeamSection
from guidance.frames import Vector
from guidance.links.zenoh_team import ZenohTeam
from guidance.session.control_bus import ControlBus
from guidance.session.flight_files import TEAM
from guidance.session.result import MissionResult
from guidance.sim.scenario import Pursuit
from guidance.sim.team_flight import pursuits_of_team, rows_of
from guidance.sim.teams import TeamOutcome, TeamScenario
from guidance.team import Member, MemoryNetwork, Transport

DELAY_S: Final = 0.02
"""Delay of the messages between the vehicles in virtual time."""

Join = Callable[[str], Transport]
"""Connects a vehicle to its team."""

MakeJoin = Callable[[Clock], Join]


def separation_of(scenario: TeamScenario) -> TeamSection:
    """Return how far the vehicles stay from each other."""
    return TeamSection(**{name: getattr(scenario.flight, name) for name in TeamSection.model_fields})


def team_document(scenario: TeamScenario) -> str:
    """Return the separation and the speeds of all evaders as JSON."""
    speeds = {one.evader: one.scenario.evader.believed_speed_m_s for one in pursuits_of_team(scenario)}
    return json.dumps({"team": separation_of(scenario).model_dump(), "evaders": speeds})


def joined(
    scenario: TeamScenario,
    pursuits: Sequence[Pursuit],
    clock: Clock,
    buses: Mapping[str, ControlBus],
    join: MakeJoin | None,
    stack: contextlib.ExitStack,
) -> dict[str, Member]:
    """Return the members of a team, connected until the stack is closed.

    Args:
        scenario: The scenario.
        pursuits: One for each vehicle.
        clock: The flight's.
        buses: Where orders are taken; the messages go over their sessions. Empty in virtual time.
        join: Makes the transports instead.
        stack: Closes the transports.
    """
    names, evaders = [one.vehicle for one in pursuits], sorted({one.evader for one in pursuits})
    connect = MemoryNetwork(clock.now_s, delay_s=DELAY_S, seed=scenario.seed).join if join is None else join(clock)
    members = {}
    for number, (_, name, first) in enumerate(pursuits):
        over_zenoh = join is None and name in buses
        transport = ZenohTeam(clock.now_s, buses[name].session, TEAM, name, names) if over_zenoh else connect(name)
        stack.callback(transport.close)
        members[name] = Member(
            name,
            names,
            sorted(evaders, key=lambda evader, first=first: evader != first),  # type: ignore[misc]
            transport,
            epoch=random.Random(f"{scenario.seed} {number}").getrandbits(48),
            separation_height_m=scenario.flight.separation_height_m,
        )
    return members


def team_rows(scenario: TeamScenario, way: str, result: MissionResult) -> list[TeamOutcome]:
    """Return the rows, one for each evader; the game began when the last vehicle engaged. Without a game: none."""
    begun = [[one.now_s for one in each.happenings if one.event is Event.GUIDED] for each in result.vehicles.values()]
    if not all(begun):
        return []
    began_s, vehicles, names = max(times[0] for times in begun), list(result.vehicles), sorted(result.evaders)
    starts = [_at([(one.now_s, one.pursuer_m) for one in result.vehicles[name].samples], began_s) for name in vehicles]
    ends = []
    for name in names:
        evader = result.evaders[name]
        arrived_s = min((one.board.over.get(name, math.inf) for one in result.members.values()), default=math.inf)
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
