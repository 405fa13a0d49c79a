"""Pitfalls 3, 8, 12, 21, 23: the loop that hangs, the pilot who takes over, what is lost and what jumps."""

import math

import pytest

from guidance.flight import Event, State
from guidance.messages import LocalPosition

pytestmark = pytest.mark.flight


PILOT_MODES = {
    "px4": ["POSCTL", "HOLD", "RTL", "LAND"],
    "arducopter": ["LOITER", "RTL", "LAND"],
}
CASES = [(autopilot, mode) for autopilot, modes in PILOT_MODES.items() for mode in modes]


def take_over(flight, mode):
    """A pilot with a radio flips the mode switch."""
    flight.mock.inject("rc", True)
    flight.run(0.1)
    flight.mock.inject("pilot_mode", mode)


def test_03_when_the_loop_hangs_the_stream_stops_and_the_autopilot_acts(sortie, autopilot):
    flight = sortie.engaged(autopilot).run(4.0)
    assert math.hypot(*flight.mock.truth.velocity_ned_m_s[:2]) > 1.5
    flight.frozen = True
    count = len(flight.setpoints)
    flight.run(6.5)
    # Nothing resends: not one frame more. The last velocity is held until the autopilot's own limit, then given up.
    assert len(flight.setpoints) == count
    if autopilot == "px4":
        assert flight.mock.mode == "RTL"
    else:
        assert flight.mock.mode == "GUIDED"
        assert math.hypot(*flight.mock.truth.velocity_ned_m_s) < 0.3


def test_03_a_loop_that_comes_back_after_a_failsafe_stays_silent(sortie):
    flight = sortie.engaged("px4").run(2.0)
    flight.frozen = True
    flight.run(4.0)
    flight.frozen = False
    flight.run(0.1)
    assert flight.state is State.YIELDED
    count = len(flight.setpoints)
    flight.run(5.0)
    assert len(flight.setpoints) == count
    assert flight.mock.mode == "RTL"


@pytest.mark.parametrize(("autopilot", "mode"), CASES)
def test_08_a_pilots_mode_change_is_final(sortie, autopilot, mode):
    flight = sortie.engaged(autopilot).run(1.0)
    take_over(flight, mode)
    flight.until(State.YIELDED, limit_s=2.5)
    sent = len(flight.sent)
    flight.run(3.0)
    said = [one.name for one in flight.sent[sent:]]
    assert set(said) <= {"HEARTBEAT", "TIMESYNC"}
    assert flight.mock.mode == mode


@pytest.mark.parametrize("order", [Event.ENGAGE, Event.START, Event.HOLD, Event.LAND, Event.RETURN])
def test_08_not_even_an_order_takes_the_vehicle_back_from_a_pilot(sortie, order):
    flight = sortie.engaged("px4")
    take_over(flight, "POSCTL")
    flight.until(State.YIELDED, limit_s=2.5)
    flight.cycle(order)
    flight.run(3.0)
    assert flight.state is State.YIELDED
    assert flight.mock.mode == "POSCTL"


def test_08_a_pilot_who_returns_to_offboard_is_not_joined(sortie):
    flight = sortie.engaged("px4")
    take_over(flight, "POSCTL")
    flight.until(State.YIELDED, limit_s=2.5)
    count = len(flight.setpoints)
    flight.mock.inject("pilot_mode", "OFFBOARD")
    flight.run(4.0)
    assert len(flight.setpoints) == count


def test_08_a_pilot_is_seen_in_every_phase_in_the_air(sortie, autopilot):
    mode = PILOT_MODES[autopilot][0]
    for phase in (State.CLIMBING, State.POSITIONING, State.STANDING_BY, State.ENTERING):
        if phase in {State.CLIMBING, State.POSITIONING}:
            flight = sortie.ready(autopilot)
            flight.cycle(Event.START)
        else:
            flight = sortie.standing_by(autopilot)
        if phase is State.ENTERING:
            flight.cycle(Event.ENGAGE)
        flight.until(phase)
        take_over(flight, mode)
        flight.until(State.YIELDED, limit_s=2.5)


@pytest.mark.parametrize("jump_m", [(7.0, 0.0, 0.0), (0.0, -7.0, 0.0), (0.0, 0.0, 3.0)])
def test_12_an_estimators_jump_is_held_and_not_chased(sortie, jump_m):
    flight = sortie.engaged("px4").run(3.0)
    flight.mock.inject("ekf_jump_m", jump_m)
    start_s = flight.now_s
    flight.run(0.3)
    assert flight.state is State.PAUSED
    assert Event.ESTIMATOR_RESET in flight.events
    flight.until(State.ENGAGED, limit_s=8.0)
    speeds = [math.hypot(*sent.velocity[:2]) for sent in flight.setpoints if sent.now_s >= start_s]
    assert max(speeds) <= flight.scenario.speed_limits.speed_m_s + 1e-6
    steps = [
        math.dist(a.velocity, b.velocity)
        for a, b in zip(flight.setpoints[:-1], flight.setpoints[1:], strict=True)
        if a.now_s >= start_s
    ]
    assert max(steps) < 0.5


def test_21_a_lost_evader_is_hovered_for_then_handed_to_the_autopilots_hold(sortie, autopilot):
    flight = sortie.engaged(autopilot).run(2.0)
    flight.rover.inject("silent", True)
    flight.until(State.PAUSED, limit_s=3.0)
    assert Event.EVADER_LOST in flight.events
    flight.run(4.0)
    assert math.hypot(*flight.mock.truth.velocity_ned_m_s[:2]) < 0.5
    flight.until(State.HOLDING, limit_s=12.0)
    flight.until_mock("HOLD" if autopilot == "px4" else "BRAKE")


def test_21_an_evader_that_is_found_again_in_time_is_played_on(sortie):
    flight = sortie.engaged("px4").run(2.0)
    flight.rover.inject("silent", True)
    flight.until(State.PAUSED, limit_s=3.0)
    flight.rover.inject("silent", False)
    flight.until(State.ENGAGED, limit_s=5.0)


def test_21_another_system_on_the_same_wire_is_never_taken_for_the_evader(sortie):
    flight = sortie.engaged("px4").run(1.0)
    # The evader's own frames go on, but under another system id: a stranger at the evader's place.
    real_step = flight.rover.step

    def as_stranger(now_s, frames=(), link=None):
        from pymavlink.dialects.v20 import common as mavlink

        stranger = mavlink.MAVLink(None, 77, 1)
        decoder = mavlink.MAVLink(None)
        return [
            decoder.decode(bytearray(frame)).pack(stranger)
            for frame in real_step(now_s, frames, link)
        ]

    flight.world.faulted["evader"].step = as_stranger
    flight.until(State.PAUSED, limit_s=3.0)
    assert flight.world.evaders["pursuer"]["evader"].counters()["foreign"] > 10


@pytest.mark.parametrize("condition", ["telemetry_frozen", "silent"])
def test_23_without_fresh_telemetry_nothing_is_commanded(sortie, autopilot, condition):
    flight = sortie.engaged(autopilot).run(2.0)
    flight.mock.inject(condition, True)
    lost_s = flight.now_s
    flight.until(State.YIELDED, limit_s=4.0)
    assert Event.TELEMETRY_LOST in flight.events
    assert (
        flight.now_s - lost_s < 1.3
        if condition == "telemetry_frozen"
        else flight.now_s - lost_s < 3.5
    )
    count = len(flight.setpoints)
    flight.run(2.0)
    assert len(flight.setpoints) == count


def test_23_only_the_latest_of_what_queued_up_is_used(sortie):
    flight = sortie.engaged("px4").run(1.0)
    flight.frozen = True
    flight.run(0.2)
    flight.frozen = False
    flight.cycle()
    local = flight.flight.vehicle.latest.get(LocalPosition)
    assert flight.now_s - local.received_s <= 0.05


def test_a_reboot_in_flight_ends_it_for_us(sortie):
    flight = sortie.engaged("px4").run(1.0)
    flight.mock.inject("reboot", True)
    flight.until(State.YIELDED, limit_s=5.0)


def test_a_low_battery_returns(sortie):
    flight = sortie.engaged("px4").run(1.0)
    flight.mock.inject("battery", 0.15)
    flight.until(State.RETURNING, limit_s=3.0)
    flight.until_mock("RTL")
