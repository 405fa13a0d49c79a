"""The frame of a flight: home stays where the vehicle armed, and what really moves takes the evader's track along."""

import math
from collections import Counter
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guidance.autopilots import PX4
from guidance.flight import Flight, Inputs, State
from guidance.frames import Amsl, LocalFrame, Ned
from guidance.messages import (
    EvaderReport,
    GlobalPosition,
    Home,
    LocalPosition,
    Odometry,
    Origin,
)
from guidance.vehicle import VehicleState, observe
from tests.flight.flown import CYCLE_S, Flown, outcome_of
from tests.flight.recorded import messages
from tests.flight.scenes import BOTH, HOME_DOWN_M, settings_of
from tests.harness.examples import drawn

ZERO = LocalFrame(47.397742, 8.545594, Amsl(488.0), projection=PX4.projection)
NORTH_M = 60.0


def test_the_real_px4s_home_wandered_meanwhile():
    homes = [message for message in messages("px4", 12) if isinstance(message, Home)]
    heights_m = [home.altitude_amsl_m for home in homes]
    assert len(set(heights_m)) > 15
    assert max(heights_m) - min(heights_m) > 1.5


@pytest.mark.parametrize("autopilot", BOTH)
def test_in_a_real_flight_the_track_never_begins_anew_and_the_floor_stays(autopilot):
    flight = Flight(settings_of(autopilot))
    origin = next(
        one for one in messages(autopilot.name, autopilot.autopilot_id) if isinstance(one, Origin)
    )
    frame = LocalFrame(
        origin.latitude_deg,
        origin.longitude_deg,
        Amsl(origin.altitude_amsl_m),
        projection=autopilot.projection,
    )
    due_s = 0.0
    armed = False
    floors = set()
    silences = []
    places = []
    outcomes = Counter()
    for message in messages(autopilot.name, autopilot.autopilot_id):
        reports = []
        while due_s <= message.received_s:  # an evader at 2 m/s, reported ten times a second
            place = (NORTH_M + 2.0 * due_s, 0.0, -0.2)
            latitude_deg, longitude_deg, altitude = frame.wgs84_from_ned(Ned(place))
            velocity = (2.0, 0.0, 0.0)
            reports.append(
                EvaderReport(
                    due_s,
                    due_s,
                    "test",
                    latitude_deg,
                    longitude_deg,
                    altitude.metres,
                    Ned(velocity),
                    0.1,
                    0.1,
                )
            )
            due_s += 0.1
        if flight.vehicle.armed and not armed:
            flight.observed.fix_home()  # as an accepted start does, before the vehicle arms
        armed = flight.vehicle.armed
        flight.step(message.received_s, Inputs([message], reports))
        outcomes[outcome_of(flight)] += 1 if reports else 0
        if not flight.vehicle.armed:
            continue
        floors.add(flight.observed.cycle.envelope.home_ned_m)
        silences.append(flight.tracking.silence_s(message.received_s))
        places.append(
            flight.tracking.evader(message.received_s).position_ned_m[0] - 2.0 * message.received_s
        )
    assert len(floors) == 1
    assert max(silences) < 0.3
    assert places == pytest.approx([NORTH_M] * len(places), abs=0.05)
    assert (outcomes["started"], outcomes["jumped"], outcomes["reacquired"]) == (1, 0, 0)


@pytest.mark.parametrize("autopilot", BOTH)
def test_a_real_autopilots_local_and_global_positions_agree_by_its_own_map(autopilot):
    vehicle = VehicleState()
    apart_m = []
    for message in messages(autopilot.name, autopilot.autopilot_id):
        vehicle = observe(vehicle, [message])
        origin = vehicle.latest.get(Origin)
        if not isinstance(message, GlobalPosition) or origin is None:
            continue
        frame = LocalFrame(
            origin.latitude_deg,
            origin.longitude_deg,
            Amsl(origin.altitude_amsl_m),
            projection=autopilot.projection,
        )
        reckoned = frame.ned_from_wgs84(
            message.latitude_deg, message.longitude_deg, Amsl(message.altitude_amsl_m)
        )
        apart_m.append(math.dist(reckoned, _at(vehicle, message.time_boot_s)))
    assert len(apart_m) > 80
    assert max(apart_m) < 0.12  # 0.25 % of the way, for the wrong map, would be 0.3 m and more


def _at(vehicle, boot_s):
    local = vehicle.latest.get(LocalPosition)
    step_s = boot_s - local.time_boot_s
    return [
        at + step_s * rate
        for at, rate in zip(local.position_ned_m, local.velocity_ned_m_s, strict=True)
    ]


def global_of(flown, frame=ZERO):
    latitude_deg, longitude_deg, altitude = frame.wgs84_from_ned(Ned(tuple(flown.position)))
    return GlobalPosition(
        flown.now_s,
        flown.now_s,
        latitude_deg,
        longitude_deg,
        altitude.metres,
        0.0,
        Ned((0.0, 0.0, 0.0)),
    )


def told(frame, at_s):
    return Origin(at_s, frame.latitude_deg, frame.longitude_deg, frame.altitude.metres)


def relative(flown):
    """From the vehicle to its evader, metres."""
    evader = flown.flight.tracking.evader(flown.now_s)
    return tuple(
        there - here for there, here in zip(evader.position_ned_m, flown.position, strict=True)
    )


def engaged():
    flown = Flown()
    flown.cycle(more=[told(ZERO, flown.now_s)])
    flown.engaged(evader=(NORTH_M, 0.0))
    flown.cycles(0.5)
    return flown


def moved_zero(flown, by_m):
    """The same vehicle in a frame in which every coordinate is higher by this."""
    latitude_deg, longitude_deg, altitude = ZERO.wgs84_from_ned(Ned(tuple(-part for part in by_m)))
    flown.position = [at + by for at, by in zip(flown.position, by_m, strict=True)]
    return replace(ZERO, latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude=altitude)


def steps_m_s(outputs):
    """The largest change of the commanded velocity from one cycle to the next."""
    said = [output.setpoint.velocity_ned_m_s for output in outputs]
    return max(math.dist(one, other) for one, other in pairwise(said))


SHIFTS = st.tuples(*[st.floats(-300.0, 300.0)] * 2, st.floats(-40.0, 40.0)).filter(
    lambda by: math.hypot(*by) > 2.0
)
BY_CYCLE_M_S = 5.0 * CYCLE_S * 1.5
"""What acceleration allows in a cycle, horizontally and vertically together, and a little."""


@settings(max_examples=drawn(10))
@given(by_m=SHIFTS, order=st.sampled_from(["together", "told first", "told later", "never told"]))
def test_a_zero_that_is_moved_in_flight_leaves_evader_home_and_fence_where_they_are(by_m, order):
    flown = engaged()
    before = [flown.outputs]
    was = relative(flown)
    floor_m = flown.flight.observed.cycle.envelope.home_ned_m[2] - flown.position[2]
    if order == "told first":
        before.append(flown.cycle(more=[told(moved_zero_of(by_m), flown.now_s), global_of(flown)]))
        before += [flown.cycle(more=[global_of(flown)]) for _ in range(3)]
    zero = moved_zero(flown, by_m)
    announced = [told(zero, flown.now_s)] if order == "together" else []
    before.append(flown.cycle(more=[*announced, global_of(flown, zero)]))
    before += [flown.cycle(more=[global_of(flown, zero)]) for _ in range(5)]
    if order == "told later":
        before.append(flown.cycle(more=[told(zero, flown.now_s)]))
    before += [flown.cycle(more=[global_of(flown, zero)]) for _ in range(70)]
    assert flown.state is State.ENGAGED
    assert relative(flown) == pytest.approx(was, abs=0.06)
    assert flown.flight.observed.cycle.envelope.home_ned_m[2] - flown.position[2] == pytest.approx(
        floor_m, abs=0.01
    )
    assert steps_m_s(before) < BY_CYCLE_M_S
    assert flown.outcomes["started"] == 1
    assert not {"jumped", "reacquired", "outlier"} & set(flown.outcomes)


def moved_zero_of(by_m):
    latitude_deg, longitude_deg, altitude = ZERO.wgs84_from_ned(Ned(tuple(-part for part in by_m)))
    return replace(ZERO, latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude=altitude)


@settings(max_examples=drawn(10))
@given(by_m=SHIFTS)
def test_an_estimate_that_is_reset_leaves_the_evader_where_its_reports_have_it(by_m):
    flown = engaged()
    place = flown.flight.tracking.evader(flown.now_s).position_ned_m
    envelope = flown.flight.observed.cycle.envelope
    outputs = [flown.outputs]
    flown.position = [at + by for at, by in zip(flown.position, by_m, strict=True)]
    outputs.append(flown.cycle(more=[Odometry(flown.now_s, 8), global_of(flown)]))
    assert flown.state is State.PAUSED
    outputs += [flown.cycle(more=[global_of(flown)]) for _ in range(40)]
    assert all(math.hypot(*output.setpoint.velocity_ned_m_s) < 6.7 for output in outputs)
    assert flown.flight.tracking.evader(flown.now_s).position_ned_m == pytest.approx(
        place, abs=1e-6
    )
    assert flown.flight.observed.cycle.envelope == envelope
    assert flown.outcomes["started"] == 1


def test_a_moved_origin_is_rejected_if_the_vehicle_did_not_move_with_it():
    flown = engaged()
    was = relative(flown)
    home_ned_m = flown.flight.observed.cycle.envelope.home_ned_m
    wrong = moved_zero_of((50.0, -80.0, 3.0))
    flown.cycle(more=[told(wrong, flown.now_s), global_of(flown)])
    for _ in range(100):
        flown.cycle(more=[global_of(flown)])
    assert relative(flown) == pytest.approx(was, abs=1e-6)
    assert flown.flight.observed.cycle.envelope.home_ned_m == home_ned_m
    assert flown.state is State.ENGAGED


@given(
    wanders=st.lists(
        st.tuples(*[st.floats(-0.3, 0.3)] * 2, st.floats(-2.0, 2.0)), min_size=1, max_size=6
    )
)
@settings(max_examples=drawn(20))
def test_a_home_that_wanders_in_flight_changes_nothing_at_all(wanders):
    """Catches a home reported in flight that moves the fence, the evader or a setpoint by a bit."""
    still = engaged()
    restless = engaged()
    for wander in wanders:
        place = (wander[0], wander[1], HOME_DOWN_M + wander[2])
        latitude_deg, longitude_deg, altitude = ZERO.wgs84_from_ned(Ned(place))
        for n in range(20):
            more = (
                [Home(restless.now_s, latitude_deg, longitude_deg, altitude.metres, Ned(place))]
                if n == 0
                else []
            )
            assert restless.cycle(more=more) == still.cycle()
    assert restless.outcomes == still.outcomes
