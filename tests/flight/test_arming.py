"""Arming: requested once HEARTBEAT shows the mode to arm in, and the autopilot's own check, made in it, passes."""

import pytest

from guidance.autopilots import Mode
from guidance.flight import Event, State
from guidance.flight.detection import JUDGED_AFTER_S
from guidance.messages import Heartbeat, SystemStatus
from guidance.session.orders.answers import failed_checks
from tests.flight.flown import ARM, SET_MODE, SLOW_S, Flown, commands
from tests.flight.scenes import ARDUCOPTER, BOTH, PREARM, settings_of, status
from tests.harness.sortie import Sorties, Stepped

GPS = 1 << 5
ELSEWHERE = {"px4": "STABILIZED", "arducopter": "STABILIZE"}


@pytest.fixture(scope="module")
def sorties(soon_up_and_down):
    made = Sorties(Stepped)
    yield made
    made.close()


def switched(sortie, autopilot):
    """A pilot has chosen a mode that needs no position, on the ground."""
    sortie.mock.inject("rc", True)
    sortie.run(0.2)
    sortie.mock.inject("pilot_mode", ELSEWHERE[autopilot])
    sortie.run(3.0)
    assert sortie.mock.mode == ELSEWHERE[autopilot]
    return sortie


@pytest.mark.flight
@pytest.mark.parametrize("autopilot", ["px4", "arducopter"])
def test_a_vehicle_without_a_position_is_not_ready_in_a_mode_that_needs_none(sorties, autopilot):
    sortie = switched(sorties.ready(autopilot), autopilot)
    sortie.world.faulted["pursuer"].inject({"kind": "gps_loss", "at_s": 0.0})
    sortie.run(12.0)
    assert sortie.state is not State.READY
    assert "needs" in failed_checks(sortie.flight, sortie.now_s)


@pytest.mark.flight
@pytest.mark.parametrize("autopilot", ["px4", "arducopter"])
def test_a_vehicle_in_another_mode_is_armed_in_the_mode_that_it_takes_off_in(sorties, autopilot):
    sortie = switched(sorties.ready(autopilot), autopilot)
    assert sortie.state is State.READY
    sortie.cycle(Event.START)
    started_s = sortie.now_s
    modes = set()
    while not sortie.mock.armed:
        sortie.cycle()
        modes.add(sortie.mock.mode)
        assert sortie.state is State.ARMING
        assert sortie.now_s - started_s < 4.0
    assert sortie.now_s - started_s > JUDGED_AFTER_S
    assert sortie.flight.observed.mode is sortie.flight.settings.autopilot.arming_mode
    sortie.until(State.STANDING_BY)


class Told(Flown):
    """A vehicle on the ground, in a mode of the test, whose own check passes only where the test says."""

    def __init__(self, autopilot, *, mode, healthy_in, present=PREARM, healthy=0):
        super().__init__(settings_of(autopilot))
        self.mode = mode
        self.healthy_in = healthy_in
        self.present = present
        self.healthy = healthy

    def inputs(self, said, *rest):
        bit = PREARM if self.mode in self.healthy_in else 0
        said = [one for one in said if not isinstance(one, SystemStatus)]
        if any(isinstance(one, Heartbeat) for one in said):
            said.append(status(self.now_s, present=self.present, healthy=self.healthy | bit))
        return super().inputs(said, *rest)


@pytest.mark.parametrize("autopilot", BOTH)
def test_a_check_that_passes_in_another_mode_only_arms_nothing_and_the_end_names_it(autopilot):
    vehicle = Told(autopilot, mode=Mode.OTHER, healthy_in={Mode.OTHER})
    vehicle.cycles(0.1)
    assert vehicle.state is State.READY
    outputs = [vehicle.cycle(Event.START)]
    assert SET_MODE in commands(outputs)
    vehicle.mode = autopilot.arming_mode
    outputs += vehicle.cycles(14.0, dt_s=SLOW_S)
    assert ARM not in commands(outputs)
    outputs += vehicle.cycles(1.2, dt_s=SLOW_S)
    assert vehicle.state is State.FAILED
    title = autopilot.mode_title(autopilot.arming_mode)
    assert vehicle.flight.cause.words == f"the autopilot's own checks fail in {title}"


@pytest.mark.parametrize("autopilot", BOTH)
def test_arming_waits_for_a_check_that_was_made_in_the_mode(autopilot):
    everywhere = {Mode.OTHER, autopilot.arming_mode}
    vehicle = Told(autopilot, mode=Mode.OTHER, healthy_in=everywhere)
    vehicle.cycles(0.1)
    vehicle.cycle(Event.START)
    assert ARM not in commands(vehicle.cycles(3.0))  # the mode is not shown
    vehicle.mode = autopilot.arming_mode
    vehicle.cycle(beat=True)
    shown_s = vehicle.now_s
    while ARM not in commands([vehicle.cycle(beat=True)]):
        assert vehicle.now_s - shown_s < 2.0
    assert vehicle.now_s - shown_s >= JUDGED_AFTER_S


def test_a_vehicle_that_stands_in_the_mode_already_is_armed_at_once():
    vehicle = Told(ARDUCOPTER, mode=Mode.GUIDED, healthy_in={Mode.GUIDED})
    vehicle.cycles(2.2)
    assert ARM in commands([vehicle.cycle(Event.START, beat=True)])


def test_an_unhealthy_gps_counts_where_the_own_check_is_of_another_mode():
    for mode, ready in ((Mode.OTHER, False), (Mode.GUIDED, True)):
        vehicle = Told(
            ARDUCOPTER, mode=mode, healthy_in={Mode.OTHER, Mode.GUIDED}, present=PREARM | GPS
        )
        vehicle.cycles(0.1)
        assert (vehicle.state is State.READY) is ready
    vehicle = Told(ARDUCOPTER, mode=Mode.OTHER, healthy_in={Mode.OTHER})  # has no GPS
    vehicle.cycles(0.1)
    assert vehicle.state is State.READY
