"""Frames, datum, rates and the survey that gathers them."""

import math

import pytest

from guidance.autopilots import ARDUCOPTER, PX4, Verdict
from guidance.autopilots.description import AUTOPILOT_VERSION
from guidance.frames import Amsl, LocalFrame, Ned
from guidance.messages import (
    Attitude,
    AutopilotVersion,
    EvaderReport,
    FenceCount,
    FenceReceived,
    FenceRequest,
    GlobalPosition,
    Heartbeat,
    Home,
    LocalPosition,
    Odometry,
    Origin,
    Parameter,
    ParameterRequest,
    PositionTarget,
)
from guidance.preflight import ASK_AGAIN_S, Facts, PreflightMemory, rows
from guidance.preflight.fence import Uploaded
from guidance.vehicle import VehicleState, observe
from tests.preflight.wants import wants_of

WANTS = wants_of()
ORIGIN = Origin(0.0, 47.397742, 8.545594, 488.0)
FRAME = LocalFrame(47.397742, 8.545594, Amsl(488.0), Amsl(488.0), projection=PX4.projection)
REST = (0.0, 0.0, 0.0)


def memory(*names):
    """A memory that reads these parameters."""
    return PreflightMemory(PX4, lambda _: names)


def vehicle_at(
    position_ned_m=REST, *, home_ned_m=REST, home_told_m=None, height_error_m=0.0, home_error_m=0.0
):
    """A vehicle that says where it is twice: in its frame, and on Earth."""
    latitude, longitude, altitude = FRAME.wgs84_from_ned(Ned(position_ned_m))
    home_latitude, home_longitude, home_altitude = FRAME.wgs84_from_ned(Ned(home_ned_m))
    amsl = altitude.metres + height_error_m
    messages = [
        ORIGIN,
        Home(
            0.0,
            home_latitude,
            home_longitude,
            home_altitude.metres + home_error_m,
            Ned(home_told_m or home_ned_m),
        ),
        LocalPosition(0.0, 1.0, Ned(position_ned_m), Ned(REST)),
        GlobalPosition(0.0, 1.0, latitude, longitude, amsl, amsl - home_altitude.metres, Ned(REST)),
    ]
    return observe(VehicleState(), messages)


def evader_at(amsl_m, north_m=0.0):
    """Return a report of an evader north of home; None without an altitude."""
    nan = math.nan
    if amsl_m is None:
        return None
    latitude_deg = 47.397742 + math.degrees(north_m / 6371000.0)
    velocity = Ned((nan, nan, nan))
    return EvaderReport(0.0, 0.0, "t", latitude_deg, 8.545594, amsl_m, velocity, nan, nan)


def verdicts(vehicle, evader_amsl_m=488.0):
    facts = Facts(vehicle=vehicle, evader=evader_at(evader_amsl_m))
    return {row.name: row.verdict for row in rows(facts, PX4, WANTS)}


PLACE = (
    "frame origin",
    "home in the frame",
    "local = global",
    "datum of home",
    "evader's altitude",
)


def test_a_vehicle_that_agrees_with_itself_passes_wherever_its_origin_is():
    for home in (REST, (300.0, -200.0, 12.0)):
        found = verdicts(vehicle_at((310.0, -205.0, -3.0), home_ned_m=home))
        assert {found[name] for name in PLACE} == {Verdict.PASS}


def streamed(rates_hz, seconds=4.0):
    """Messages of several kinds at their rates, in order of arrival."""
    made = {
        LocalPosition: lambda t: LocalPosition(t, t, Ned(REST), Ned(REST)),
        Attitude: lambda t: Attitude(t, t, 0.0),
        Odometry: lambda t: Odometry(t, 0),
        PositionTarget: lambda t: PositionTarget(t, t, 0, Ned(REST)),
        GlobalPosition: lambda t: GlobalPosition(t, t, 47.0, 8.0, 488.0, 0.0, Ned(REST)),
    }
    messages = [
        made[kind](count / rate_hz)
        for kind, rate_hz in rates_hz.items()
        for count in range(round(seconds * rate_hz))
    ]
    return sorted(messages, key=lambda message: message.received_s)


def test_rates_are_those_that_arrive():
    survey = memory()
    survey.observe(streamed({LocalPosition: 50.0, Attitude: 20.0, Odometry: 2.0}), [])
    facts = survey.facts(VehicleState(), 3.99)
    assert facts.rates_hz[LocalPosition] == pytest.approx(50.0, abs=1.0)
    found = {row.name: row for row in rows(facts, PX4, WANTS)}
    assert found["LOCAL_POSITION_NED"].verdict is Verdict.PASS
    assert found["ODOMETRY"].verdict is Verdict.WARN
    assert found["POSITION_TARGET_LOCAL_NED"].verdict is Verdict.WARN
    assert "is the link fast enough for 10 Hz?" in found["ODOMETRY"].advice


def test_a_position_stream_that_is_slow_or_has_stopped_is_refused():
    slow = memory()
    slow.observe(streamed({LocalPosition: 4.0, Attitude: 20.0}), [])
    stopped = memory()
    stopped.observe(streamed({LocalPosition: 50.0, Attitude: 20.0}), [])
    for survey, now_s in ((slow, 4.0), (stopped, 7.0)):
        found = {
            row.name: row.verdict
            for row in rows(survey.facts(VehicleState(), now_s), ARDUCOPTER, WANTS)
        }
        assert found["LOCAL_POSITION_NED"] is Verdict.REFUSE
        assert "POSITION_TARGET_LOCAL_NED" not in found  # ArduCopter tells it in GUIDED only
        assert "ODOMETRY" not in found


def heard(now_s=0.0):
    return Heartbeat(now_s, 0, armed=False, system_status=3, autopilot=12)


def test_version_fence_and_parameters_are_requested_after_contact_and_again_while_missing():
    survey = memory("A", "B")
    assert survey.requests(0.0) == ()
    survey.observe([heard()], [])
    version = PX4.request_message(AUTOPILOT_VERSION)
    assert survey.requests(1.0) == (FenceRequest(), version)
    assert survey.requests(1.1) == ()
    survey.observe([AutopilotVersion(1.2, 1, 17, 0)], [])
    assert survey.requests(1.2) == (ParameterRequest("A"), ParameterRequest("B"))
    survey.observe([Parameter(1.5, "B", 2.0), FenceCount(1.5, 0)], [])
    assert survey.missing == ("1 of 2 parameters", "uploaded fence")
    assert survey.requests(1.5) == (FenceReceived(),)
    assert survey.requests(1.2 + ASK_AGAIN_S - 0.1) == ()
    assert survey.requests(1.2 + ASK_AGAIN_S) == (ParameterRequest("A"),)
    assert not survey.complete
    survey.observe([Parameter(7.0, "A", 1.0), Parameter(7.0, "UNASKED", 9.0)], [])
    assert survey.complete
    assert survey.missing == ()
    assert survey.facts(VehicleState(), 8.0).parameters == {"A": 1.0, "B": 2.0}


def test_without_a_version_the_oldest_ones_parameters_are_requested_after_a_while():
    survey = memory("A")
    survey.observe([heard()], [])
    version = PX4.request_message(AUTOPILOT_VERSION)
    assert survey.requests(0.0) == (FenceRequest(), version)
    assert survey.requests(ASK_AGAIN_S)[1:] == (version, ParameterRequest("A"))
    survey.observe([Parameter(6.0, "A", 1.0)], [])
    assert survey.parameters_complete
    assert not survey.complete


def test_a_missing_parameter_never_keeps_the_fence_from_being_read():
    survey = memory("MISSING")
    survey.observe([heard()], [])
    survey.requests(0.0)
    survey.observe([AutopilotVersion(0.1, 1, 17, 0), FenceCount(0.1, 0)], [])
    survey.requests(0.2)
    assert survey.facts(VehicleState(), 0.3).uploaded == Uploaded(areas=())
    assert not survey.complete


def test_a_parameter_that_the_autopilot_announces_as_changed_is_taken_over():
    survey = memory("A")
    survey.observe([heard(), Parameter(0.0, "A", 1.0)], [])
    survey.observe([Parameter(5.0, "A", 7.0)], [])
    assert survey.facts(VehicleState(), 5.0).parameters == {"A": 7.0}


def test_the_evaders_last_report_is_kept_until_it_is_old():
    survey = memory()
    report = evader_at(491.0)._replace(received_s=8.0)
    survey.observe([], [evader_at(490.0), report])
    assert survey.facts(VehicleState(), 13.0).evader is report
    assert survey.facts(VehicleState(), 13.1).evader is None


FARTHEST_M = 200.0 + 3.0 + 2.0 * 200.0 * 3.0 / 6.0
"""The fence, the disc, and what the evader flies while the vehicle crosses the fence."""


@pytest.mark.parametrize(
    ("north_m", "verdict"),
    [
        (0.0, Verdict.PASS),
        (FARTHEST_M - 2.0, Verdict.PASS),
        (FARTHEST_M + 2.0, Verdict.REFUSE),
        (20e3, Verdict.REFUSE),
        (-4e6, Verdict.REFUSE),
    ],
)
def test_an_evader_that_cannot_be_met_inside_the_fence_is_refused_with_its_distance(
    north_m, verdict
):
    wants = WANTS._replace(evader_speed_m_s=3.0, standoff_radius_m=3.0)
    facts = Facts(vehicle=vehicle_at(), evader=evader_at(488.0, north_m))
    (row,) = [row for row in rows(facts, PX4, wants) if row.name == "evader's distance"]
    assert row.verdict is verdict
    assert row.wanted.startswith("at most 403 m")
    assert float(row.value.split()[0]) == pytest.approx(abs(north_m), rel=1e-3, abs=0.5)


@pytest.mark.parametrize(("north_m", "verdict"), [(5.0, Verdict.PASS), (5.1, Verdict.WARN)])
def test_a_home_elsewhere_is_warned_of_before_the_fence_lies_there(north_m, verdict):
    vehicle = vehicle_at((north_m, 0.0, 0.0))
    found = {row.name: row for row in rows(Facts(vehicle=vehicle), PX4, WANTS)}
    assert found["vehicle at home"].verdict is verdict
    assert bool(found["vehicle at home"].advice) is (verdict is Verdict.WARN)
    armed = observe(vehicle, [Heartbeat(0.0, 0, True, 4, 12)])
    assert "vehicle at home" not in verdicts(armed)
