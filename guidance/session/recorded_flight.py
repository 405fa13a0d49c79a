"""Scenarios flown from connecting to the end, whichever way their vehicles are opened (`guidance.session.open`)."""

import random
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from guidance.flight.settings import TeamSection
from guidance.links.zenoh.team import ZenohTeam
from guidance.session.flight_files import RECORD, TEAM_FOLDER, flight_metadata
from guidance.session.fly.loop import claimed
from guidance.session.fly.mission import Mission
from guidance.session.fly.own_policy import asked_in_flight, require_policies
from guidance.session.fly.result import MissionResult, closing_detail
from guidance.session.observe.outputs import OutputOrder, open_outputs
from guidance.session.observe.recording import recording, stopped_words
from guidance.session.open.opened import (
    NOBODY,
    FlyableScenario,
    Onlooker,
    Opened,
    Way,
    declared_m_s,
)
from guidance.session.plan import TeamPlan, plan_of
from guidance.sim.scenario import Pursuit, Scenario
from guidance.sim.teams import TeamScenario
from guidance.team import Member, MemoryTransport


def fly_recorded(
    scenario: FlyableScenario, folder: Path | None, how: Way, onlooker: Onlooker = NOBODY
) -> MissionResult:
    """Fly a scenario of one vehicle or of a team, with records, and broadcasts where orders are taken.

    Args:
        scenario: The scenario.
        folder: For the record; in a team each vehicle has a folder of its name in it. None keeps no record.
        how: The mocks, a vehicle file, or URLs.
        onlooker: Who watches, and gives orders.

    Raises:
        GuidanceError: For everything that the user can fix.
    """
    if isinstance(scenario, Scenario):
        require_policies(scenario, beside_vehicle=how.way == "vehicle")
    with ExitStack() as stack:
        if how.way != "fast":
            stack.enter_context(claimed())
        flight = how.open(scenario, onlooker, stack)
        pursuits = flight.pursuits
        clock = flight.clock
        team = team_plan(scenario, pursuits) if isinstance(scenario, TeamScenario) else None
        plans = {
            pursuit.vehicle: plan_of(flight.configs.get(pursuit.vehicle), pursuit.scenario, team)
            for pursuit in pursuits
        }
        _equip(flight, scenario, folder, onlooker, stack)
        if folder is not None:
            onlooker.on_record(folder if team else folder / RECORD)
        equipment = flight.equipment
        mission = Mission(
            pursuits,
            flight.world,
            clock,
            plans=plans,
            equipment=equipment,
            policy=flight.policy,
            show=onlooker.show,
        )
        result = mission.fly(flight.signals)
        for daemon in mission.daemons:
            if equipment[daemon.name].sinks:
                flight_result = result.vehicles[daemon.name]
                record = equipment[daemon.name].record
                detail = closing_detail(flight_result, how.way, record, folder)
                daemon.recording.over(clock.now_s(), detail)
    # A closed record knows its dropped entries and its failure.
    for name, flight_result in result.vehicles.items():
        record = equipment[name].record
        if record is None:
            continue
        flight_result.record_dropped = record.dropped
        if record.failed is not None and not flight_result.record_stopped:
            flight_result.record_stopped = stopped_words(flight_result.duration_s, record.failed)
    return result


def team_plan(scenario: TeamScenario, pursuits: Sequence[Pursuit]) -> TeamPlan:
    """Return the common plan of all vehicles of a scenario's team."""
    flight = scenario.flight
    team = TeamSection(
        separation_m=flight.separation_m, separation_height_m=flight.separation_height_m
    )
    return TeamPlan(team=team, evaders=declared_m_s(pursuits))


def _equip(
    flight: Opened,
    scenario: FlyableScenario,
    folder: Path | None,
    onlooker: Onlooker,
    stack: ExitStack,
) -> None:
    """Give all vehicles their records, and broadcasts where orders are taken.

    Those of a team are connected until the stack is closed: over the control buses, or in virtual time by a network in
    this process.
    """
    names = [pursuit.vehicle for pursuit in flight.pursuits]
    evaders = sorted({pursuit.evader for pursuit in flight.pursuits})
    now_s = flight.clock.now_s
    stamp = flight.clock if flight.world.real_time else None
    ends = dict[str, MemoryTransport]()
    for number, (own_scenario, name, first) in enumerate(flight.pursuits):
        metadata = flight_metadata(own_scenario, flight.configs.get(name), stamp)
        bus = flight.buses.get(name)
        equipment = flight.equipment[name]
        equipment.ask = asked_in_flight(
            own_scenario.pursuer.policy, flight.clock, real_time=flight.world.real_time
        )
        if isinstance(scenario, TeamScenario):
            metadata |= {
                TEAM_FOLDER: team_plan(scenario, flight.pursuits).model_dump_json(),
                "vehicle": name,
            }
            transport = (
                ZenohTeam(now_s, bus, TEAM_FOLDER, name, names)
                if bus
                else MemoryTransport(name, ends, now_s)
            )
            stack.callback(transport.close)
            epoch = random.Random(f"{own_scenario.seed} {number}").getrandbits(48)
            above_m = scenario.flight.separation_height_m
            equipment.team = Member(
                name, names, [first, *evaders], transport, epoch=epoch, separation_height_m=above_m
            )
        if folder is not None:
            path = (folder if equipment.team is None else folder / name) / RECORD
            equipment.record = stack.enter_context(
                recording(path, metadata, real_time=flight.world.real_time)
            )
        link = flight.world.links[name]
        config = flight.configs.get(name)
        order = OutputOrder(
            vehicle=name,
            metadata=metadata,
            clock=flight.clock,
            link=link,
            mailbox=equipment.mailbox,
            config=config,
            bus=bus,
            ground_link=flight.world.ground_links.get(name),
            ros=onlooker.ros,
        )
        equipment.sinks += open_outputs(order, stack)
