"""Faults in flight: the vehicle's reactions, and a client's view."""

import itertools
import math

import pytest

from sitl_mock.faults import KINDS

pytestmark = pytest.mark.flight


def modes_after(flight, seconds, *stream):
    """The modes flown during the next seconds, each once, in order."""
    seen = [flight.vehicle.mode]
    for _ in range(round(seconds / 0.1)):
        flight.run(0.1, *stream)
        if flight.vehicle.mode != seen[-1]:
            seen.append(flight.vehicle.mode)
    return seen


def test_the_pilot_takes_over_two_seconds_after_offboard_began(aloft, ned_velocity):
    fault = {"kind": "pilot_mode", "mode": "POSCTL", "after": "OFFBOARD", "at_s": 2.0}
    flight = aloft().inject(fault)
    north = ned_velocity(1, 0, 0)
    flight.guided(*north)
    begun_s = flight.now_s
    assert modes_after(flight, 1.5, *north) == ["OFFBOARD"]
    assert modes_after(flight, 3.0, *north) == ["OFFBOARD", "POSCTL"]
    assert flight.now_s > begun_s


def test_offboard_means_guided_on_arducopter(rig, ned_velocity):
    flight = rig(
        {"kind": "pilot_mode", "mode": "LOITER", "after": "OFFBOARD", "at_s": 12.0},
        flavour="arducopter",
    )
    flight.airborne()
    assert modes_after(flight, 12.0, *ned_velocity(1, 0, 0))[-1] == "LOITER"


def test_sticks_take_over_only_where_the_parameter_says_so(aloft, ned_velocity):
    fault = {"kind": "pilot_sticks", "pitch": 1.0, "after": "OFFBOARD", "at_s": 1.0, "for_s": 2.0}
    north = ned_velocity(0, 1, 0)
    for mask, after in ((1, ["OFFBOARD"]), (3, ["OFFBOARD", "POSCTL"])):
        flight = aloft().change(COM_RC_OVERRIDE=mask).inject(fault).guided(*north)
        assert modes_after(flight, 2.0, *north) == after


def test_arming_is_refused_with_the_text_given_and_granted_when_the_fault_is_over(rig):
    flight = rig(
        {"kind": "arm_refused", "text": "Preflight Fail: no compass", "for_s": 3.0}, texts=True
    ).run(1.5)
    assert flight.command(400, 1.0) == [(1, 1)]
    assert "Preflight Fail: no compass" in [m.text for _, m in flight.all("STATUSTEXT")]
    flight.run(2.0)
    assert flight.command(400, 1.0) == [(1, 0)]


@pytest.mark.parametrize(
    ("flavour", "refusal"), [("px4", [(1, 0), (1, 1)]), ("arducopter", [(1, 4)])]
)
def test_offboard_is_refused(rig, ned_velocity, flavour, refusal):
    flight = rig(flavour=flavour).airborne()
    if flavour == "arducopter":
        flight.command(176, 1.0, 5.0)
    flight.faulted.inject({"kind": "offboard_refused"})
    flight.run(0.5, *ned_velocity(0, 0, 0))
    mode = (1.0, 6.0) if flavour == "px4" else (1.0, 4.0)
    assert flight.command(176, *mode) == refusal


@pytest.mark.parametrize("axis", ["north", "east", "down"])
def test_the_estimate_jumps_along_one_axis_with_the_counter_while_the_body_stays(aloft, axis):
    flight = aloft()
    before = flight.all("LOCAL_POSITION_NED")[-1][1]
    counter = flight.all("ODOMETRY")[-1][1].reset_counter
    flight.inject({"kind": "ekf_jump", axis: 7.0}).run(0.1)
    after = flight.all("LOCAL_POSITION_NED")[-1][1]
    moved = {"north": after.x - before.x, "east": after.y - before.y, "down": after.z - before.z}
    assert moved.pop(axis) == pytest.approx(7.0, abs=0.6)
    assert list(moved.values()) == pytest.approx([0.0, 0.0], abs=0.6)
    assert flight.all("ODOMETRY")[-1][1].reset_counter == counter + 1


def test_the_heading_jumps(aloft):
    flight = aloft()
    before = flight.all("ATTITUDE")[-1][1].yaw
    flight.inject({"kind": "ekf_yaw_jump", "by_deg": 40.0}).run(0.1)
    turned = math.degrees(flight.all("ATTITUDE")[-1][1].yaw - before) % 360.0
    assert turned == pytest.approx(40.0, abs=3.0)


def test_without_gps_the_fix_goes_first_then_offboard(aloft, ned_velocity):
    flight = aloft().inject({"kind": "gps_loss", "after": "OFFBOARD", "at_s": 1.0})
    still = ned_velocity(0, 0, 0)
    flight.guided(*still)
    modes = modes_after(flight, 10.0, *still)
    assert modes[0] == "OFFBOARD"
    assert "OFFBOARD" not in modes[1:]
    assert len(modes) > 1
    assert flight.all("GPS_RAW_INT")[-1][1].fix_type == 0
    assert not flight.all("SYS_STATUS")[-1][1].onboard_control_sensors_health & 32


def test_uncertainty_grows_at_its_rate_up_to_its_most(rig):
    flight = rig({"kind": "eph_growth", "rate_m_s": 2.0, "most_m": 8.0, "at_s": 1.0}).run(4.0)
    assert flight.vehicle.autopilot.state.estimator.eph_m == pytest.approx(6.0, abs=0.3)
    flight.run(4.0)
    assert flight.vehicle.autopilot.state.estimator.eph_m == 8.0


@pytest.mark.parametrize(
    ("fault", "parameters", "last"),
    [
        ({"kind": "fence_breach"}, {"GF_ACTION": 3}, "RTL"),
        ({"kind": "fence_breach"}, {"GF_ACTION": 2}, "HOLD"),
        ({"kind": "battery_critical"}, {"COM_LOW_BAT_ACT": 3}, "RTL"),
        ({"kind": "battery_low"}, {"COM_LOW_BAT_ACT": 3}, "OFFBOARD"),
        ({"kind": "rc_loss"}, {"NAV_RCL_ACT": 2}, "RTL"),
        ({"kind": "gcs_loss"}, {"NAV_DLL_ACT": 1}, "HOLD"),
        ({"kind": "offboard_refused"}, {"COM_OBL_RC_ACT": 5}, "HOLD"),
    ],
)
def test_failsafes_act_as_their_parameters_say(aloft, ned_velocity, fault, parameters, last):
    flight = aloft().change(**parameters).inject({**fault, "after": "OFFBOARD", "at_s": 1.0})
    still = ned_velocity(0, 0, 0)
    flight.guided(*still)
    assert modes_after(flight, 9.0, *still)[-1] == last


def test_a_low_battery_is_reported_before_it_acts(rig):
    flight = rig({"kind": "battery_low", "at_s": 2.0}).run(4.0)
    assert flight.all("SYS_STATUS")[-1][1].battery_remaining == 12


@pytest.mark.parametrize("wind", [{"north": 6.0}, {"east": -6.0}])
def test_a_gust_pushes_the_vehicle_its_own_way_and_passes(aloft, wind):
    flight = aloft().inject({"kind": "wind_gust", **wind, "for_s": 2.0}).run(1.0)
    axis, speed = (0, wind["north"]) if "north" in wind else (1, wind["east"])
    assert flight.vehicle.truth.velocity_ned_m_s[axis] * math.copysign(1.0, speed) > 0.2
    flight.run(10.0)
    assert math.hypot(*flight.vehicle.truth.velocity_ned_m_s) < 0.3


def test_gusts_shake_and_a_push_is_a_step_in_velocity(aloft):
    calm = aloft()
    shaken = aloft().inject({"kind": "gusts", "sd_m_s": 5.0})
    for flight in (calm, shaken):
        flight.run(10.0)
    assert max(
        abs(m.vx) for _, m in shaken.all("LOCAL_POSITION_NED", shaken.now_s - 10.0)
    ) > 5 * max(abs(m.vx) for _, m in calm.all("LOCAL_POSITION_NED", calm.now_s - 10.0))
    calm.faulted.inject({"kind": "push", "east": 4.0})
    calm.run(0.04)
    assert calm.vehicle.truth.velocity_ned_m_s[1] == pytest.approx(4.0, abs=0.4)


def test_velocities_are_cut_in_length_not_in_direction(aloft, ned_velocity):
    flight = aloft().inject({"kind": "velocity_truncation", "horizontal_m_s": 2.0, "up_m_s": 1.0})
    flight.guided(*ned_velocity(6, 8, -3))
    flight.run(8.0, *ned_velocity(6, 8, -3))
    north, east, down = flight.vehicle.truth.velocity_ned_m_s
    assert math.hypot(north, east) == pytest.approx(2.0, abs=0.3)
    assert north / east == pytest.approx(6 / 8, abs=0.1)
    assert down == pytest.approx(-1.0, abs=0.2)


def test_frozen_telemetry_leaves_heartbeats_and_answers(rig):
    flight = rig({"kind": "telemetry_freeze", "at_s": 2.0}).run(3.0)
    assert flight.command(400, 1.0) == [(1, 0)]
    flight.run(5.0)
    assert {m.get_type() for _, m in flight.heard if _ > 2.1} == {"HEARTBEAT", "COMMAND_ACK"}


def test_silence_is_silence_while_the_vehicle_obeys(rig):
    flight = rig({"kind": "silence", "at_s": 2.0, "for_s": 3.0}).run(3.0)
    assert flight.command(400, 1.0) == []
    assert flight.vehicle.armed
    flight.run(3.0)
    times = [t for t, _ in flight.heard]
    assert max(b - a for a, b in itertools.pairwise(times)) == pytest.approx(3.0, abs=0.1)


def test_a_reboot_in_flight_starts_the_clock_again(rig):
    flight = rig({"kind": "reboot", "after": "AIRBORNE", "at_s": 8.0}).airborne(5.0)
    flight.run(3.0)
    stamps = [m.time_boot_ms for _, m in flight.all("ATTITUDE")]
    assert min(b - a for a, b in itertools.pairwise(stamps)) < -1000
    assert not flight.vehicle.armed


def test_an_invalid_estimate_is_no_ground_to_arm_on(rig):
    flight = rig({"kind": "estimator_invalid", "at_s": 1.0, "for_s": 2.0}).run(2.0)
    assert flight.command(400, 1.0) == [(1, 1)]
    flight.run(2.0)
    assert flight.command(400, 1.0) == [(1, 0)]


def test_every_kind_can_be_put_upon_every_flavour_and_lifted(rig):
    needs = {
        "ack_wrong": {"result": 3},
        "param_echo": {"value": 1},
        "pilot_mode": {"mode": "RTL"},
    }
    parameter = {"px4": "COM_OF_LOSS_T", "arducopter": "WPNAV_SPEED", "rover": "WP_SPEED"}
    for flavour, name in parameter.items():
        flight = rig(flavour=flavour).run(0.1)
        for kind in KINDS:
            more = {"parameter": name} if kind == "param_echo" else {}
            flight.faulted.inject({"kind": kind, **needs.get(kind, {}), **more})
            flight.run(0.1)
            flight.faulted.clear()
            flight.run(0.04)
        assert flight.faulted.faults() == ()
        flight.run(5.0)
        heard = len(flight.heard)
        flight.run(2.0)
        assert len(flight.heard) > heard


def test_arducopter_looks_at_the_mode_when_it_arms_not_before(rig):
    flight = rig(flavour="arducopter").run(2.0)
    flight.send("COMMAND_LONG", 1, 1, 511, 0, 1, 100_000, 0, 0, 0, 0, 0)
    flight.command(176, 1.0, 9.0)
    flight.run(1.0)
    assert flight.all("SYS_STATUS")[-1][1].onboard_control_sensors_health & (1 << 28)
    assert flight.command(400, 1.0) == [(1, 4)]
