"""Pitfalls 5, 6, 9, 24, 29: the autopilot's parameters, the start of the game, and other senders."""

import pytest
from pymavlink.dialects.v20 import common as mavlink

from guidance.autopilots import Verdict, autopilot_named
from guidance.flight import EngageOn, Event, State
from guidance.preflight import Facts, refusals, rows
from sitl_mock import MockVehicle
from tests.preflight.wants import wants_of

pytestmark = pytest.mark.flight


WANTS = wants_of(fence_required=False)


def judged(autopilot, **changed):
    """Every row of a mock's own parameters, with these changed."""
    parameters = dict(MockVehicle(autopilot).autopilot.parameters) | changed
    return {
        row.name: row
        for row in rows(Facts(parameters=parameters), autopilot_named(autopilot), WANTS)
    }


@pytest.mark.parametrize("action", [-1, 1, 2])
def test_05_an_autopilot_that_would_fly_on_without_setpoints_is_refused(action):
    row = judged("px4", COM_OBL_RC_ACT=action)["COM_OBL_RC_ACT"]
    assert row.verdict is Verdict.REFUSE
    assert "param set COM_OBL_RC_ACT" in row.advice


def test_05_the_default_action_is_told_for_what_it_becomes_without_a_radio():
    row = judged("px4", COM_OBL_RC_ACT=0)["COM_OBL_RC_ACT"]
    assert row.verdict is Verdict.WARN
    assert "without one PX4 returns" in f"{row.value} {row.wanted} {row.advice}"


def test_05_a_loss_time_that_flies_an_old_setpoint_for_long_is_refused():
    assert judged("px4", COM_OF_LOSS_T=10.0)["COM_OF_LOSS_T"].verdict is Verdict.REFUSE
    assert judged("px4", COM_OF_LOSS_T=1.0)["COM_OF_LOSS_T"].verdict is Verdict.PASS


@pytest.mark.parametrize(
    ("bits", "words"),
    [(0, []), (1, ["Mission"]), (4, ["Offboard"]), (7, ["Mission", "Hold", "Offboard"])],
)
def test_06_the_exceptions_to_radio_loss_are_read_bit_by_bit(bits, words):
    row = judged("px4", COM_RCL_EXCEPT=bits)["COM_RCL_EXCEPT"]
    assert all(word.lower() in row.value.lower() for word in words)
    assert all(
        (word.lower() in row.value.lower()) == (word in words)
        for word in ("Mission", "Hold", "Offboard")
    )


def with_pilot_start(settings):
    return settings.model_copy(update={"engage_on": EngageOn.PILOT_MODE})


def test_09_a_pilots_switch_to_offboard_begins_the_game_where_that_is_configured(sortie):
    flight = sortie("px4", change=with_pilot_start).standing_by().run(2.0)
    # MAVSDK would have stopped its stream outside of Offboard, and PX4 would refuse the switch.
    assert flight.mock.mode == "HOLD"
    assert len(flight.setpoints) > 40
    flight.mock.inject("rc", True)
    flight.run(0.2)
    flight.mock.inject("pilot_mode", "OFFBOARD")
    flight.until(State.ENGAGED, limit_s=3.0)


def test_09_otherwise_a_pilots_switch_begins_nothing(sortie):
    flight = sortie.standing_by("px4").run(2.0)
    assert flight.setpoints == []
    flight.mock.inject("rc", True)
    flight.run(0.2)
    flight.mock.inject("pilot_mode", "OFFBOARD")
    flight.run(3.0)
    assert flight.state is not State.ENGAGED
    assert flight.setpoints == []


@pytest.mark.parametrize(
    ("timeout_s", "fit"), [(0.5, True), (1.0, True), (3.0, False), (5.0, False)]
)
def test_24_arducopters_three_seconds_on_an_old_velocity_are_refused(timeout_s, fit):
    row = judged("arducopter", GUID_TIMEOUT=timeout_s)["GUID_TIMEOUT"]
    assert (row.verdict is Verdict.REFUSE) != fit
    assert fit or "param set GUID_TIMEOUT" in row.advice


def test_24_the_timeout_that_was_set_is_what_the_autopilot_acts_on(sortie):
    flight = sortie.engaged("arducopter").run(3.0)
    flight.mock.autopilot.parameters.set("GUID_TIMEOUT", 1.0)
    flight.frozen = True
    flight.run(3.0)
    speed = sum(part * part for part in flight.mock.truth.velocity_ned_m_s) ** 0.5
    assert speed < 0.4


def test_29_a_second_setpoint_source_is_detected_and_ends_in_the_autopilots_hold(sortie):
    flight = sortie.engaged("px4").run(2.0)
    stranger = mavlink.MAVLink(None, 255, 190)
    real_step = flight.mock.step

    def with_a_stranger(now_s, frames=(), link=None):
        other = mavlink.MAVLink_set_position_target_local_ned_message(
            int(now_s * 1000), 1, 1, 1, 3527, 0, 0, 0, -3.0, -3.0, 0.0, 0, 0, 0, 0, 0
        )
        return real_step(now_s, [*frames, other.pack(stranger)], link)

    flight.world.faulted["pursuer"].step = with_a_stranger
    flight.until(State.HOLDING, limit_s=5.0)
    assert Event.FOREIGN in flight.events


@pytest.mark.parametrize("autopilot", ["px4", pytest.param("arducopter", marks=pytest.mark.long)])
def test_29_our_own_setpoints_are_never_taken_for_a_strangers(sortie, autopilot):
    flight = sortie.engaged(autopilot)
    flight.until(State.ON_STATION, limit_s=40.0).run(5.0)
    assert Event.FOREIGN not in flight.events


def test_refusals_name_the_rows_that_hold_the_vehicle_back():
    parameters = dict(MockVehicle("px4").autopilot.parameters) | {"COM_OBL_RC_ACT": -1}
    assert "COM_OBL_RC_ACT" in refusals(
        rows(Facts(parameters=parameters), autopilot_named("px4"), WANTS)
    )
