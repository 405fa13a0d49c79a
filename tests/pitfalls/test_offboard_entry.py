"""Pitfalls 1, 2, 4, 7, 18, 27: how the guided mode is entered, and when it is not."""

import itertools

import pytest

from guidance.autopilots import AUTOPILOTS, Mode
from guidance.autopilots.description import MAV_CMD_COMPONENT_ARM_DISARM, MAV_CMD_DO_SET_MODE
from guidance.flight import Event, State

pytestmark = pytest.mark.flight


GUIDED = {"px4": "OFFBOARD", "arducopter": "GUIDED"}


def is_guided_request(sent, profile):
    main = profile.set_mode(Mode.GUIDED).params[1]
    return (
        sent.name == "COMMAND_LONG"
        and sent.message.command == MAV_CMD_DO_SET_MODE
        and sent.message.param2 == main
    )


@pytest.mark.parametrize("times_real", [1, 30])
def test_01_setpoints_stream_before_the_mode_request_at_any_simulation_speed(
    sortie, autopilot, times_real, monkeypatch
):
    # The core knows only the injected clock: 30 cycles of 20 ms are the same whether they take 0.6 s or 0.02 s. What a
    # fast simulation changes is how coarsely its time moves, so the mock is stepped in coarser strides at 30x.
    flight = sortie.standing_by(autopilot)
    if times_real == 30:
        stride = 3
        real_step = flight.mock.step
        calls = iter(range(10**9))
        held = []

        def coarse(now_s, frames_in=(), link=None):
            held.extend(frames_in)
            if next(calls) % stride:
                return []
            frames = list(held)
            held[:] = []
            return real_step(now_s, frames, link)

        monkeypatch.setattr(flight.mock, "step", coarse)
    flight.sent.clear()
    flight.cycle(Event.ENGAGE)
    flight.until(State.ENGAGED, limit_s=10.0)
    # ArduCopter has been in GUIDED since before it was armed, and is not asked again.
    asked_s = [sent.now_s for sent in flight.sent if is_guided_request(sent, AUTOPILOTS[autopilot])]
    assert bool(asked_s) == AUTOPILOTS[autopilot].stream_before_guided
    entered_s = min(asked_s, default=flight.now_s)
    streamed = len([sent for sent in flight.setpoints if sent.now_s < entered_s])
    assert streamed >= (10 if AUTOPILOTS[autopilot].stream_before_guided else 1)
    assert flight.mock.mode == GUIDED[autopilot]


def test_02_offboard_without_a_stream_is_refused_and_with_a_fresh_one_granted(sortie):
    flight = sortie.standing_by("px4")
    flight.world.links["pursuer"].request(AUTOPILOTS["px4"].set_mode(Mode.GUIDED))
    flight.run(2.0)
    assert flight.mock.mode != "OFFBOARD"
    assert flight.state is State.STANDING_BY
    flight.cycle(Event.ENGAGE)
    flight.until(State.ENGAGED, limit_s=10.0)


def test_02_a_refusal_ends_in_the_autopilots_hold_with_a_typed_reason(sortie):
    flight = sortie.standing_by("px4")
    flight.mock.inject("offboard_refused", True)
    flight.cycle(Event.ENGAGE)
    flight.until(State.HOLDING, limit_s=15.0)
    assert flight.transitions[-1].event is Event.TIMED_OUT
    assert flight.transitions[-1].before is State.ENTERING
    count = len(flight.setpoints)
    flight.run(3.0)
    assert len(flight.setpoints) == count
    assert flight.mock.mode == "HOLD"


@pytest.mark.parametrize("loss_s", [0.5, 1.0, 2.5])
def test_04_the_autopilots_own_freshness_limit_decides_and_we_stay_far_within_it(sortie, loss_s):
    flight = sortie.engaged("px4")
    flight.mock.autopilot.parameters.set("COM_OF_LOSS_T", loss_s)
    flight.run(3.0)
    assert flight.mock.mode == "OFFBOARD"
    times = [sent.now_s for sent in flight.setpoints]
    gaps = sorted(b - a for a, b in itertools.pairwise(times))
    assert gaps[round(0.99 * (len(gaps) - 1))] <= 0.1
    flight.frozen = True
    last_s = times[-1]
    while flight.mock.mode == "OFFBOARD":
        flight.cycle()
    assert loss_s <= flight.now_s - last_s <= loss_s + 0.3


def test_07_an_accepted_command_is_not_a_mode(sortie):
    flight = sortie.standing_by("px4")
    flight.mock.inject("offboard_refused", True)
    flight.cycle(Event.ENGAGE)
    flight.run(5.0)
    # PX4 says ACCEPTED first and refuses afterwards: HEARTBEAT alone counts.
    assert flight.state is State.ENTERING
    assert all(output.state is not State.ENGAGED for output in flight.outputs)


def test_07_the_game_begins_only_with_a_heartbeat_that_shows_the_mode(sortie, autopilot):
    flight = sortie.standing_by(autopilot)
    flight.cycle(Event.ENGAGE)
    entered_s = flight.now_s
    flight.until(State.ENGAGED, limit_s=10.0)
    assert flight.flight.mode_name == "guided"
    assert flight.now_s > entered_s


@pytest.mark.parametrize("order", [Event.ENGAGE, Event.HOLD, Event.RETURN])
def test_18_nothing_engages_on_the_ground(sortie, autopilot, order):
    flight = sortie(autopilot).until(State.READY)
    flight.cycle(order)
    flight.run(3.0)
    assert flight.state is State.READY
    assert flight.setpoints == []
    assert not flight.mock.armed


def test_18_the_climb_is_the_autopilots_own_and_no_setpoint_goes_out_during_it(sortie, autopilot):
    flight = sortie.standing_by(autopilot)
    assert flight.setpoints == []
    names = [sent.message.command for sent in flight.sent if sent.name == "COMMAND_LONG"]
    assert 22 in names


@pytest.mark.parametrize("condition", ["gps_lost", "estimator_invalid"])
def test_27_without_a_valid_position_nothing_is_armed(sortie, autopilot, condition):
    flight = sortie(autopilot)
    flight.mock.inject(condition, True)
    flight.run(8.0)
    flight.cycle(Event.START)
    for _ in range(4):
        flight.run(1.0)
        assert not flight.mock.armed
        assert flight.setpoints == []
    assert flight.state is State.CHECKING
    assert not any(
        getattr(sent.message, "command", 0) == MAV_CMD_COMPONENT_ARM_DISARM for sent in flight.sent
    )
    assert any(check.verdict != "pass" for check in flight.flight.checks(flight.now_s))
