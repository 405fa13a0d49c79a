"""The second judge finds what a service with other limits, or with wrong setpoints, does."""

import math
from dataclasses import replace
from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import common as dialect

from guidance.clock import VirtualClock
from guidance.config import parse_document
from guidance.sim.scenario import Scenario
from guidance.sim.stepped import SteppedWorld
from tests.faults import flying, second_judge
from tests.faults.drawing import Case
from tests.faults.test_watch import TO_THE_FENCE

CASE = Case(0, 0, parse_document(Scenario, TO_THE_FENCE, source="test"))


def setpoint(*velocity, time_ms=0):
    packer = dialect.MAVLink(None, 255, 190)
    message = dialect.MAVLink_set_position_target_local_ned_message(
        time_ms, 1, 1, 1, 0xFC7, 0.0, 0.0, 0.0, *velocity, 0.0, 0.0, 0.0, 0.0, 0.0
    )
    return bytes(message.pack(packer))


@pytest.fixture
def judge():
    world = SteppedWorld(CASE.game, VirtualClock())
    yield second_judge.SecondJudge(CASE, world)
    world.close()


@pytest.mark.parametrize(
    ("frames", "invariant"),
    [
        ([setpoint(math.nan, 0.0, 0.0)], "numbers"),
        ([setpoint(6.0, 0.0, 0.0)], "speed limits"),
        ([setpoint(0.0, 0.0, 0.0)] * 2, "one setpoint per cycle"),
        ([setpoint(1.0, 0.0, 0.0)], "no old position"),
    ],
)
def test_wrong_setpoints_are_found(judge, frames, invariant):
    judge.sent(5.0, frames, SimpleNamespace(transitions=()), None)
    assert invariant in judge.worst


@pytest.mark.flight
@pytest.mark.parametrize(("fence_m", "found"), [(16.0, set()), (1e4, {"fence"})])
def test_a_service_that_knows_of_no_fence_is_found_out(monkeypatch, fence_m, found):
    planned = flying.plan

    def other(case):
        plan = planned(case)
        cycle = plan.flight.cycle
        envelope = replace(cycle.envelope, fence_radius_m=fence_m)
        return replace(
            plan, flight=plan.flight.model_copy(update={"cycle": replace(cycle, envelope=envelope)})
        )

    monkeypatch.setattr(flying, "plan", other)
    monkeypatch.setattr(flying, "Watch", second_judge.SecondJudge)
    assert {violation.name for violation in flying.fly(CASE).violations} == found  # type: ignore[attr-defined]
