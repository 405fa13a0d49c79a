"""A forger takes over the evader's place on a port that pins addresses. Whole flights, in virtual time.

The vehicle must not follow the forger: either the true evader gets its pin back, or both are heard and the vehicle
holds.
"""

import math

import pytest

from guidance.clock import VirtualClock
from guidance.flight import Event
from guidance.links.evaders.carriers import GLOBAL_POSITION
from guidance.links.evaders.mavlink import MavlinkEvader
from guidance.session.fly.loop import run
from guidance.session.fly.mission import Mission
from guidance.sim.scenario import EVADER_ID
from guidance.sim.stepped import SteppedWorld
from tests.harness.pinned_wire import PinnedWire, evader_wire
from tests.pitfalls.test_evader_forged import Around, chase

pytestmark = [pytest.mark.flight, pytest.mark.usefixtures("soon_up_and_down")]

FORGERS_ID = 66
FORGER = {
    "kind": "evader_forger",
    "vehicle": "evader",
    "north_m_s": 3.0,
    "rate_hz": 10.0,
    "component": FORGERS_ID,
}
SILENT_S = 3.7


class Hijacked(Around):
    """The mission, ended once the vehicle holds, or 12 s after engagement."""

    def after(self, now_s, late_s=0.0):
        super().after(now_s, late_s)
        since_s = 0.0 if self.engaged_s is None else now_s - self.engaged_s
        self.rival = self._daemon.flight.tracking.rival(now_s)
        self.finished = self.held_s is not None or since_s > 12.0 or now_s > 60.0


def flown(forger, *, silent_from_s=math.inf):
    """Fly the chase with the evader's reports through a port that pins addresses.

    The evader is silent for a while after `silent_from_s` since engagement.
    """
    scenario = chase(forger)
    clock = VirtualClock()
    world = SteppedWorld(scenario, clock)

    def is_lost(component):
        since_s = -math.inf if around.engaged_s is None else clock.now_s() - around.engaged_s
        return component != FORGERS_ID and silent_from_s <= since_s < silent_from_s + SILENT_S

    wire = PinnedWire(evader_wire(world), (EVADER_ID,), is_lost)
    world.evaders["pursuer"]["evader"] = MavlinkEvader(wire, GLOBAL_POSITION, system_id=EVADER_ID)
    mission = Mission(scenario, world, clock)
    around = Hijacked(mission, mission.daemons[0], world)
    try:
        run(mission.daemons, world, clock, mission=around)
    finally:
        world.close()
    assert world.evaders["pursuer"]["evader"].counters()["wire_impostor"] > 0
    return around


def test_a_forger_that_takes_the_pin_during_a_silence_is_detected():
    flight = flown({**FORGER, "at_s": 2.0 + 3.2}, silent_from_s=2.0)
    assert flight.told[-1] is Event.RIVAL
    assert flight.held_s < 2.0 + SILENT_S + 2.0
    assert flight.worst_m < 8.0


def test_a_forger_that_speaks_first_is_detected_and_no_game_begins():
    flight = flown({**FORGER, "after": "start", "at_s": 0.0})
    assert flight.engaged_s is None
    assert flight.rival == "sender"


def test_a_forger_from_another_address_is_never_followed_and_reported():
    flight = flown({**FORGER, "at_s": 3.0})
    assert flight.told[-1] is Event.RIVAL
    assert 3.0 < flight.held_s < 5.0
    assert flight.worst_m < 3.0
