"""Failsafes of the PX4 flavour: radio, ground station, battery, fence, estimator; deferred, sticky, overridden."""

import math

import pytest

from sitl_mock.px4.events import event_id
from sitl_mock.px4.safety import TRIGGERS, Action, Failsafes

PARAMETERS = {
    "NAV_RCL_ACT": 2,
    "NAV_DLL_ACT": 0,
    "GF_ACTION": 2,
    "COM_LOW_BAT_ACT": 3,
    "COM_FAIL_ACT_T": 5.0,
}


def test_a_radio_that_never_was_cannot_be_lost(fly):
    flight = fly.airborne("px4").run(10.0)
    assert flight.mode == "HOLD"


def test_a_lost_radio_holds_five_seconds_then_returns(fly):
    flight = fly.airborne("px4")
    flight.vehicle.inject("rc", True)
    flight.run(1.0)
    flight.command(176, 1, 3)
    assert flight.mode == "POSCTL"
    flight.vehicle.inject("rc", False)
    flight.run(1.0)
    assert flight.mode == "HOLD"
    assert flight.vehicle.autopilot.commander.system_status == 5
    took_s = flight.until(lambda: flight.mode == "RTL", 8.0)
    assert took_s == pytest.approx(4.6, abs=0.4)


def test_a_radio_that_comes_back_does_not_end_the_return_but_a_mode_change_does(fly):
    flight = fly.airborne("px4")
    flight.vehicle.inject("rc", True)
    flight.run(1.0)
    flight.vehicle.inject("rc", False)
    flight.run(8.0)
    assert flight.mode == "RTL"
    flight.vehicle.inject("rc", True)
    flight.run(2.0)
    assert flight.mode == "RTL"
    flight.vehicle.inject("pilot_mode", "POSCTL")
    flight.run(0.5)
    assert flight.mode == "POSCTL"


@pytest.mark.parametrize(("action", "mode"), [(0, "HOLD"), (1, "HOLD"), (2, "RTL"), (3, "LAND")])
def test_ground_station_loss_does_what_nav_dll_act_says(fly, action, mode):
    flight = fly.airborne("px4").change(NAV_DLL_ACT=action)
    flight.send("HEARTBEAT", 6, 8, 0, 0, 4, 3)
    flight.run(11.5)
    assert flight.mode == "HOLD"
    assert not flight.vehicle.autopilot.commander.in_failsafe
    flight.run(6.5)
    assert flight.mode == mode
    assert flight.vehicle.autopilot.commander.in_failsafe == (action > 0)


@pytest.mark.parametrize(("action", "mode"), [(1, "HOLD"), (2, "HOLD"), (3, "RTL"), (5, "LAND")])
def test_fence_acts_at_once_in_offboard(fly, ned_velocity, action, mode):
    stream = ned_velocity(5.0, 0.0, 0.0)
    flight = fly.airborne("px4").change(GF_ACTION=action, GF_MAX_HOR_DIST=20.0).offboard(stream)
    flight.until(lambda: flight.position[0] > 20.3, 20.0, stream)
    flight.run(0.1, stream)
    assert flight.mode == (mode if action > 1 else "OFFBOARD")


def test_fence_action_ends_when_back_inside(fly):
    flight = fly.airborne("px4")
    flight.vehicle.inject("fence_breach", True)
    flight.run(0.2)
    assert flight.vehicle.autopilot.commander.in_failsafe
    flight.vehicle.inject("fence_breach", False)
    flight.run(0.2)
    assert not flight.vehicle.autopilot.commander.in_failsafe


@pytest.mark.parametrize(("action", "mode"), [(0, "HOLD"), (2, "LAND"), (3, "RTL")])
def test_critical_battery_does_what_com_low_bat_act_says(fly, action, mode):
    flight = fly.airborne("px4").change(COM_LOW_BAT_ACT=action)
    flight.vehicle.inject("battery", 0.06)
    flight.run(6.0)
    assert flight.mode == mode


def test_emergency_battery_lands(fly):
    flight = fly.airborne("px4")
    flight.vehicle.inject("battery", 0.04)
    flight.run(6.0)
    assert flight.mode == "LAND"


def test_a_low_battery_refuses_arming(fly):
    flight = fly("px4").run(1.0)
    flight.vehicle.inject("battery", 0.05)
    flight.run(0.1)
    assert flight.command(400, 1.0) == [1]


def test_without_the_mission_that_com_arm_mis_req_wants_arming_is_refused(fly):
    flight = fly("px4", parameters={"COM_ARM_MIS_REQ": 1}).run(6.0)
    assert flight.command(400, 1.0) == [1]
    flight.vehicle.autopilot.parameters.set("COM_ARM_MIS_REQ", 0)
    assert flight.command(400, 1.0) == [0]


def test_the_battery_drains_by_the_time_armed_as_that_of_px4s_simulation(fly):
    """SYS_STATUS in mV and %, as measured; SIM_BAT_MIN_PCT also raises the charge."""
    parameters = {"SIM_BAT_DRAIN": 20.0, "COM_DISARM_PRFLT": -1.0}
    flight = fly("px4", parameters=parameters).run(6.0)

    def after(seconds, least=None):
        if least is not None:
            flight.vehicle.autopilot.parameters.set("SIM_BAT_MIN_PCT", least)
        flight.run(seconds)
        status = flight.last("SYS_STATUS")
        return status.voltage_battery, status.battery_remaining

    assert after(0.0) == (16200, 100)
    flight.command(400, 1)
    assert after(6.0) == (pytest.approx(15660, abs=50), pytest.approx(75, abs=3))
    assert after(10.0) == (15300, 51)
    assert after(5.0, least=70.0) == (15660, 70)
    assert after(8.0, least=30.0) == (pytest.approx(14940, abs=50), pytest.approx(36, abs=3))
    flight.command(400, 0)
    assert after(1.5) == (16200, pytest.approx(84, abs=4))
    assert after(4.0) == (16200, 100)


def test_gps_loss_shows_at_once_and_takes_the_position_after_five_seconds(fly):
    flight = fly.airborne("px4")
    flight.vehicle.inject("gps_lost", True)
    flight.run(0.5)
    assert flight.last("GPS_RAW_INT").fix_type == 0
    assert not flight.last("SYS_STATUS").onboard_control_sensors_health & 0x20
    assert flight.mode == "HOLD"
    flight.run(6.0)
    assert flight.mode == "DESCEND"
    flight.vehicle.inject("gps_lost", False)
    counter = flight.last("ODOMETRY").reset_counter
    flight.run(0.5)
    assert flight.mode == "HOLD"
    assert flight.last("ODOMETRY").reset_counter == (counter + 1) % 256


def test_an_estimator_jump_moves_the_report_at_once_and_the_truth_after(fly):
    flight = fly.airborne("px4")
    truth = flight.position
    before = flight.last("LOCAL_POSITION_NED").x
    counter = flight.last("ODOMETRY").reset_counter
    flight.vehicle.inject("ekf_jump_m", (7.0, 0.0, 0.0))
    flight.run(0.1)
    assert flight.last("LOCAL_POSITION_NED").x - before == pytest.approx(7.0, abs=0.3)
    assert math.dist(flight.position, truth) < 0.3
    assert flight.last("ODOMETRY").reset_counter == counter + 1


def test_a_heading_jump_turns_the_report(fly):
    flight = fly.airborne("px4")
    before = flight.last("ATTITUDE").yaw
    flight.vehicle.inject("ekf_yaw_jump_deg", 40.0)
    flight.run(0.1)
    assert flight.last("ATTITUDE").yaw - before == pytest.approx(math.radians(40.0), abs=0.05)


def test_stick_movement_takes_over_from_auto_modes(fly):
    flight = fly.airborne("px4")
    flight.vehicle.inject("rc", True)
    flight.command(20)
    flight.run(1.0)
    flight.vehicle.inject("sticks", (0.8, 0.0, 0.0, 0.0))
    flight.run(0.3)
    assert flight.mode == "POSCTL"
    flight.run(3.0)
    assert flight.velocity[1] > 2.0, "right stick flies right"


def test_manual_control_is_a_radio(fly):
    flight = fly.airborne("px4")
    flight.run(1.0, ("MANUAL_CONTROL", 1, 0, 0, 500, 0, 0, 0, 0, *[0] * 8), every_s=0.1)
    assert flight.command(176, 1, 3) == [0, 0]
    assert flight.mode == "POSCTL"
    flight.run(0.8)
    assert flight.mode != "POSCTL", "it stops, so the pilot is lost"


@pytest.mark.parametrize(("exception", "mode"), [(0, "RTL"), (2, "RTL"), (4, "OFFBOARD")])
def test_a_lost_radio_is_borne_where_com_rcl_except_says_so(fly, ned_velocity, exception, mode):
    stream = ned_velocity(1.0, 0.0, 0.0)
    flight = fly.airborne("px4").change(COM_RCL_EXCEPT=exception)
    flight.vehicle.inject("rc", True)
    flight.offboard(stream)
    flight.vehicle.inject("rc", False)
    flight.run(7.0, stream)
    assert flight.mode == mode


def test_a_lost_onboard_computer_is_a_warning_only(fly):
    flight = fly.airborne("px4", texts=True)
    flight.send("HEARTBEAT", 18, 8, 0, 0, 4, 3)
    flight.run(8.0)
    assert flight.mode == "HOLD"
    assert not flight.vehicle.autopilot.commander.in_failsafe
    flight.run(0.3, ("HEARTBEAT", 18, 8, 0, 0, 4, 3))
    told = ["Connection to mission computer lost", "Onboard controller regained"]
    assert flight.texts()[-2:] == told


@pytest.mark.parametrize(("source", "heard"), [(0, False), (1, True), (3, True), (4, False)])
def test_com_rc_in_mode_chooses_where_sticks_come_from(fly, source, heard):
    flight = fly("px4", parameters={"COM_RC_IN_MODE": source}).run(1.0)
    flight.send("MANUAL_CONTROL", 1, 0, 0, 500, 0, 0, 0, 0, *[0] * 8)
    assert flight.vehicle.autopilot.state.pilot.known == heard


class TestFrameworkAlone:
    def test_every_value_of_every_parameter_is_an_action_or_a_warning(self):
        for trigger in TRIGGERS:
            for choice in range(8):
                failsafes = Failsafes()
                parameters = (
                    {**PARAMETERS, trigger.parameter: choice} if trigger.parameter else PARAMETERS
                )
                action, new = failsafes.update(0.0, frozenset({trigger.name}), parameters)
                assert new == (trigger.name,)
                assert action in Action

    def test_the_worst_of_two_is_done(self):
        failsafes = Failsafes()
        wrong = frozenset({"geofence violated", "manual control lost"})
        assert failsafes.update(0.0, wrong, PARAMETERS)[0] is Action.HOLD
        assert failsafes.update(6.0, wrong, PARAMETERS)[0] is Action.RTL

    def test_an_answered_trigger_acts_again_only_after_it_has_gone(self):
        failsafes = Failsafes()
        wrong = frozenset({"geofence violated"})
        assert failsafes.update(0.0, wrong, PARAMETERS)[0] is Action.HOLD
        failsafes.answer()
        assert failsafes.update(1.0, wrong, PARAMETERS)[0] is Action.NONE
        failsafes.update(2.0, frozenset(), PARAMETERS)
        assert failsafes.update(3.0, wrong, PARAMETERS) == (Action.HOLD, ("geofence violated",))


def test_a_disarmed_px4_says_when_its_ground_station_is_lost_and_back(fly):
    """As recorded on v1.17: a text waits five seconds for a station, so the first loss is not told."""
    flight = fly("px4")
    beat = ("HEARTBEAT", 6, 8, 0, 0, 4, 3)
    flight.run(9.8, beat, every_s=0.5)
    flight.run(20.2)
    flight.run(3.7, beat, every_s=0.5)
    flight.run(14.3)
    assert flight.texts() == ["GCS connection regained"]
    flight.run(0.3, beat)
    assert flight.texts()[1:] == ["Connection to ground station lost", "GCS connection regained"]
    lost = event_id("commander_gcs_lost")
    times_s = [time_s for time_s, message in flight.all("EVENT") if message.id == lost]
    assert times_s == pytest.approx([22.1, 46.0], abs=0.4)


def test_sticks_that_stop_count_for_nothing_after_they_were_disabled(fly):
    """COM_RC_IN_MODE 4 in flight, as the real PX4 v1.17: it stays in its hold."""
    flight = fly.airborne("px4").change(COM_RC_IN_MODE=1)
    sticks = ("MANUAL_CONTROL", 1, 0, 0, 500, 0, 0, 0, 0, *[0] * 8)
    flight.run(3.0, sticks, every_s=0.1)
    flight.vehicle.autopilot.parameters.set("COM_RC_IN_MODE", 4)
    before = flight.mode
    flight.run(15.0)
    assert flight.mode == before == "HOLD"
    flight.vehicle.autopilot.parameters.set("COM_RC_IN_MODE", 1)
    flight.run(15.0)
    assert flight.mode == "RTL"
