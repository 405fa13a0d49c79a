"""Exceptions and timeouts of the real MAVSDK when faults of the mock make its calls fail."""

import contextlib
import time

import pytest
import zenoh
from mavsdk.plugins.action import ActionError, ActionResult
from mavsdk.plugins.offboard import OffboardError, OffboardResult, VelocityNedYaw
from mavsdk.plugins.param import ParamError, ParamResult
from mavsdk.plugins.telemetry import FlightMode

pytestmark = pytest.mark.slow

STILL = VelocityNedYaw(0.0, 0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def fleet(fleet_of):
    with fleet_of({"uav1": "px4", "copter": "arducopter"}) as started:
        yield started


@pytest.fixture(scope="module")
def px4(fleet, client_of):
    with client_of(fleet["uav1"]) as connected:
        yield connected.ready()


@pytest.fixture(scope="module")
def copter(fleet, client_of):
    with client_of(fleet["copter"], "zenoh") as connected:
        connected.telemetry.set_rate_health(5.0)
        connected.telemetry.set_rate_position(5.0)
        yield connected.ready()


def seconds_until(error, act):
    """Seconds until a call raises, and the exception."""
    begin = time.monotonic()
    with pytest.raises(error) as caught:
        act()
    return time.monotonic() - begin, caught.value.result


def test_a_lost_answer_is_a_timeout_after_two_seconds_and_the_vehicle_has_armed(px4, inject):
    with inject(px4.vehicle, kind="ack_lost", commands=[400]):
        took_s, result = seconds_until(ActionError, px4.action.arm)
    assert result == ActionResult.TIMEOUT
    assert took_s == pytest.approx(2.0, abs=0.4)
    px4.wait(px4.telemetry.armed, 2.0)
    px4.action.disarm()


def test_an_answer_from_another_component_is_no_answer(px4, inject):
    with inject(px4.vehicle, kind="ack_foreign", commands=[400]):
        took_s, result = seconds_until(ActionError, px4.action.arm)
    assert (result, took_s) == (ActionResult.TIMEOUT, pytest.approx(2.0, abs=0.4))
    px4.action.disarm()


def test_an_answer_a_second_late_is_taken(px4, inject):
    with inject(px4.vehicle, kind="ack_late", delay_s=1.0):
        begin = time.monotonic()
        px4.action.arm()
        assert time.monotonic() - begin == pytest.approx(1.0, abs=0.3)
        # The answers to MAVSDK's resends: they would be taken for those to the next command
        time.sleep(1.2)
    px4.action.disarm()


@pytest.mark.parametrize(
    ("result", "name"),
    [
        (1, "COMMAND_DENIED"),
        (2, "COMMAND_DENIED"),
        (3, "UNSUPPORTED"),
        (4, "FAILED"),
        (6, "UNKNOWN"),
    ],
)
def test_each_result_has_its_exception(px4, inject, result, name):
    with inject(px4.vehicle, kind="ack_wrong", result=result, commands=[400]):
        assert seconds_until(ActionError, px4.action.arm)[1].name == name
    px4.action.disarm()


def test_in_progress_and_then_silence_is_a_timeout_after_ten_seconds(px4, inject):
    with inject(px4.vehicle, kind="ack_in_progress", commands=[400]):
        took_s, result = seconds_until(ActionError, px4.action.arm)
    assert result == ActionResult.TIMEOUT
    assert took_s == pytest.approx(10.0, abs=1.0)
    px4.action.disarm()


def test_a_refused_arming_is_denied_by_px4_and_failed_by_arducopter(px4, copter, inject):
    for client, name in ((px4, "COMMAND_DENIED"), (copter, "FAILED")):
        with inject(client.vehicle, kind="arm_refused"):
            assert seconds_until(ActionError, client.action.arm)[1].name == name
        assert not client.telemetry.armed()


def test_force_arming_by_mavsdk_is_a_kill(px4):
    px4.action.arm()
    px4.wait(px4.telemetry.armed, 2.0)
    px4.action.arm_force()
    px4.wait(lambda: not px4.telemetry.armed(), 2.0)


def test_offboard_without_a_setpoint_is_refused_by_the_client(px4):
    assert seconds_until(OffboardError, px4.offboard.start)[1] == OffboardResult.NO_SETPOINT_SET


def test_row_15_an_unknown_parameter_is_met_with_silence(copter):
    took_s, result = seconds_until(ParamError, lambda: copter.param.get_param_float("NO_SUCH"))
    assert (result, took_s) == (ParamResult.TIMEOUT, pytest.approx(3.0, abs=0.5))


def test_parameters_that_are_not_answered_time_out_after_three_seconds(px4, inject):
    with inject(px4.vehicle, kind="loss", messages=["PARAM_VALUE"]):
        took_s, result = seconds_until(
            ParamError, lambda: px4.param.get_param_float("COM_OF_LOSS_T")
        )
    assert (result, took_s) == (ParamResult.TIMEOUT, pytest.approx(3.0, abs=0.5))


def test_a_parameter_that_is_echoed_with_another_value_is_not_believed(px4, inject):
    with inject(px4.vehicle, kind="param_echo", parameter="COM_OF_LOSS_T", value=9.0):
        _, result = seconds_until(
            ParamError, lambda: px4.param.set_param_float("COM_OF_LOSS_T", 2.0)
        )
    assert result != ParamResult.SUCCESS
    px4.param.set_param_float("COM_OF_LOSS_T", 1.0)


@pytest.mark.parametrize(("gap_s", "lost"), [(2.7, False), (3.3, True)])
def test_the_connection_is_lost_three_seconds_after_the_last_heartbeat(px4, inject, gap_s, lost):
    px4.wait(px4.system.is_connected, 3.0)
    seen = False
    with inject(px4.vehicle, kind="heartbeat_gap", gap_s=gap_s):
        end_s = time.monotonic() + 1.2 + gap_s
        while time.monotonic() < end_s:
            seen = seen or not px4.system.is_connected()
            time.sleep(0.01)
    assert seen == lost
    px4.wait(px4.system.is_connected, 3.0)


def test_another_component_with_a_custom_mode_deceives_mavsdk(px4, inject):
    assert px4.telemetry.flight_mode() != FlightMode.OFFBOARD
    with inject(
        px4.vehicle, kind="foreign_heartbeat", component=191, mode="OFFBOARD", period_s=0.1
    ):
        px4.wait(lambda: px4.telemetry.flight_mode() == FlightMode.OFFBOARD, 2.0)
    px4.wait(lambda: px4.telemetry.flight_mode() != FlightMode.OFFBOARD, 3.0)


def test_broken_numbers_and_frames_of_any_kind_leave_the_client_flying(px4, inject):
    for fault in (
        {"kind": "bad_fields", "value": "nan"},
        {"kind": "bad_fields", "value": "int_max"},
        {"kind": "latlon_zero"},
        {"kind": "corrupt", "probability": 0.5},
        {"kind": "v1_frames"},
        {"kind": "signed_frames"},
        {"kind": "time_wrap", "before_s": 0.1},
        {"kind": "sysid_clash"},
        {"kind": "statustext"},
    ):
        with inject(px4.vehicle, **fault):
            time.sleep(0.2)
    px4.wait(px4.system.is_connected, 3.0)
    px4.action.arm()
    px4.action.disarm()


def test_offboard_in_the_air_is_believed_too_early_lost_and_taken_by_the_pilot(px4, inject):
    px4.ready()
    px4.action.arm()
    px4.action.takeoff()
    px4.wait(lambda: px4.height_m > 3.5 and px4.telemetry.flight_mode() == FlightMode.HOLD, 20.0)

    with inject(px4.vehicle, kind="offboard_refused"):
        px4.offboard.set_velocity_ned(STILL)
        px4.offboard.start()  # the first ACK says yes
        time.sleep(1.5)
        assert px4.telemetry.flight_mode() == FlightMode.HOLD
    px4.offboard.stop()

    px4.offboard.set_velocity_ned(STILL)
    time.sleep(0.3)
    px4.offboard.start()
    px4.wait(lambda: px4.telemetry.flight_mode() == FlightMode.OFFBOARD, 3.0)
    with inject(
        px4.vehicle, kind="loss", direction="in", messages=["SET_POSITION_TARGET_LOCAL_NED"]
    ):
        took_s = px4.wait(lambda: px4.telemetry.flight_mode() == FlightMode.RETURN_TO_LAUNCH, 4.0)
        assert 0.8 < took_s < 2.4  # COM_OF_LOSS_T, then the next HEARTBEAT
    # A slow machine: MAVSDK ignores another mode for no longer than some seconds
    if not px4.offboard.is_active():
        px4.offboard.set_velocity_ned(STILL)
        time.sleep(0.3)
        px4.offboard.start()
    # By itself, as on the real PX4
    px4.wait(lambda: px4.telemetry.flight_mode() == FlightMode.OFFBOARD, 3.0)

    with inject(px4.vehicle, kind="pilot_mode", mode="POSCTL"):
        px4.wait(lambda: px4.telemetry.flight_mode() == FlightMode.POSCTL, 3.0)
        px4.action.kill()
    px4.wait(lambda: not px4.telemetry.armed(), 10.0)


def test_mavsdk_over_zenoh_outlives_a_restart_of_the_router(copter, inject):
    with (
        contextlib.suppress(zenoh.ZError, ValueError),
        inject(copter.vehicle, kind="router_restart", for_s=0.5),
    ):
        time.sleep(0.7)
    copter.wait(copter.system.is_connected, 10.0)
    copter.wait(lambda: armed_and_disarmed(copter), 10.0)


def armed_and_disarmed(client):
    try:
        client.action.arm()
        client.action.disarm()
    except ActionError:
        return False
    return True


def test_mavsdk_over_udp_follows_a_vehicle_to_its_new_port(px4, inject):
    with inject(px4.vehicle, kind="udp_port_change"):
        px4.wait(lambda: armed_and_disarmed(px4), 10.0)
