"""Limits: no input, however wrong, yields a setpoint outside the envelope. The envelope is judged anew in here."""

import math
from dataclasses import replace

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from guidance.control import Limiter, Situation
from guidance.control.polygon import Polygon
from guidance.control.servo import AltitudeHold, hold_altitude
from guidance.control.setpoint_limiter import NOTED, LimitMemory, limit
from guidance.frames import Ned
from guidance.game import StandOff
from guidance.messages import Setpoint
from tests.control.scenes import MULTICOPTER
from tests.harness.examples import drawn

TOLERANCE = 1e-6
# A polygon with an inward corner, a circle that cuts its far corners, and a stand-off.
CORNERS = ((-40.0, -40.0), (60.0, -40.0), (60.0, 50.0), (10.0, 5.0), (-40.0, 50.0))
ENVELOPE = replace(
    MULTICOPTER,
    braking_m_s2=2.0,
    vertical_braking_m_s2=1.0,
    reaction_s=0.5,
    home_ned_m=Ned((100.0, -50.0, -7.0)),
    fence_radius_m=65.0,
    fence_polygon=Polygon(CORNERS),
    fence_margin_m=1.0,
    stand_off=StandOff(radius_m=3.0, height_m=5.0),
)

anything = st.floats(allow_nan=True, allow_infinity=True)
wild = st.one_of(
    anything,
    st.floats(-30.0, 30.0),
    st.sampled_from([0.0, -0.0, 1e308, -1e308, 1e-308, math.nan, math.inf]),
)
wild_vectors = st.tuples(wild, wild, wild).map(Ned)
speeds = st.tuples(*[st.floats(-15.0, 15.0)] * 3).map(Ned)
places = st.tuples(st.floats(20.0, 180.0), st.floats(-120.0, 30.0), st.floats(-60.0, 5.0)).map(Ned)
setpoints = st.builds(Setpoint, speeds, st.none() | speeds, st.none() | st.floats(-7, 7))
wild_setpoints = st.builds(Setpoint, wild_vectors, st.none() | wild_vectors, st.none() | wild)
situations = st.builds(
    Situation,
    places,
    speeds,
    st.floats(-4, 4),
    st.none() | places,
    st.none() | speeds,
    acceleration_ned_m_s2=wild_vectors,
)
wild_situations = st.builds(
    Situation,
    wild_vectors,
    wild_vectors,
    wild,
    st.none() | wild_vectors,
    st.none() | wild_vectors,
    wild_vectors,
)
offsets = st.tuples(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0), st.floats(-2.0, 15.0)).map(Ned)
near_situations = situations.flatmap(
    lambda situation: st.builds(
        lambda offset: situation._replace(evader_position_ned_m=situation.position_ned_m + offset),
        offsets,
    )
)
memories = st.none() | st.builds(LimitMemory, speeds, speeds, speeds, st.floats(-4.0, 4.0))
wild_memories = st.none() | st.builds(LimitMemory, wild_vectors, wild_vectors, wild_vectors, wild)
steps = st.floats(0.0, 0.1)


def numbers(setpoint):
    yield from setpoint.velocity_ned_m_s
    yield from setpoint.acceleration_ned_m_s2 or ()
    yield setpoint.yaw_rad or 0.0


def height_m(situation, envelope):
    return envelope.home_ned_m[2] - situation.position_ned_m[2]


def rest_point(situation, velocity, envelope):
    """Return the stopping point of a vehicle that keeps its velocity for the reaction time and then brakes."""
    point = list(situation.position_ned_m)
    ground = math.hypot(*velocity[:2])
    for axis, speed, braking in (
        (0, ground, "braking_m_s2"),
        (1, ground, "braking_m_s2"),
        (2, None, "vertical_braking_m_s2"),
    ):
        size = abs(velocity[axis]) if speed is None else speed
        point[axis] += velocity[axis] * envelope.reaction_s
        point[axis] += velocity[axis] * size / (2.0 * getattr(envelope, braking))
    return point


def winding_number(point, corners):
    """Turns of the polygon about a point, by angles: independent of any ray."""
    total = 0.0
    for one, other in zip(corners, corners[1:] + corners[:1], strict=True):
        a = math.atan2(one[1] - point[1], one[0] - point[0])
        b = math.atan2(other[1] - point[1], other[0] - point[0])
        total += math.remainder(b - a, math.tau)
    return round(total / math.tau)


def distance_to_boundary(point, corners):
    best = math.inf
    for one, other in zip(corners, corners[1:] + corners[:1], strict=True):
        length = math.dist(one, other)
        along = (
            (point[0] - one[0]) * (other[0] - one[0]) + (point[1] - one[1]) * (other[1] - one[1])
        ) / length
        along = min(length, max(0.0, along)) / length
        foot = (one[0] + along * (other[0] - one[0]), one[1] + along * (other[1] - one[1]))
        best = min(best, math.dist(point, foot))
    return best


def assert_speeds(velocity, envelope):
    assert math.hypot(velocity[0], velocity[1]) <= envelope.speed_m_s + TOLERANCE
    assert -envelope.climb_m_s - TOLERANCE <= velocity[2] <= envelope.descent_m_s + TOLERANCE


def assert_heights(situation, velocity, envelope):
    rest_m = envelope.home_ned_m[2] - rest_point(situation, velocity, envelope)[2]
    assert rest_m >= min(envelope.floor_m, height_m(situation, envelope)) - TOLERANCE
    assert rest_m <= max(envelope.ceiling_m, height_m(situation, envelope)) + TOLERANCE


def assert_circle(situation, velocity, envelope):
    home = envelope.home_ned_m[:2]
    now_m = math.dist(situation.position_ned_m[:2], home)
    rest_m = math.dist(rest_point(situation, velocity, envelope)[:2], home)
    assert rest_m <= max(envelope.fence_radius_m - envelope.fence_margin_m, now_m) + TOLERANCE


def assert_polygon(situation, velocity, envelope):
    home = envelope.home_ned_m
    start = (situation.position_ned_m[0] - home[0], situation.position_ned_m[1] - home[1])
    rest = rest_point(situation, velocity, envelope)
    path = (rest[0] - home[0] - start[0], rest[1] - home[1] - start[1])
    if winding_number(start, CORNERS):
        needed_m = min(envelope.fence_margin_m, distance_to_boundary(start, CORNERS))
        for share in (0.25, 0.5, 0.75, 1.0):
            point = (start[0] + share * path[0], start[1] + share * path[1])
            assert (
                distance_to_boundary(point, CORNERS) >= needed_m - TOLERANCE
                or math.hypot(*path) < TOLERANCE
            )
            assert (
                winding_number(point, CORNERS) or distance_to_boundary(point, CORNERS) < TOLERANCE
            )
    else:
        nudge = 1e-3 / max(1.0, math.hypot(*path))
        nudged = (start[0] + nudge * path[0], start[1] + nudge * path[1])
        further_m = distance_to_boundary(nudged, CORNERS) - distance_to_boundary(start, CORNERS)
        assert winding_number(nudged, CORNERS) or further_m <= TOLERANCE


def assert_stand_off(situation, velocity, envelope):
    if situation.evader_position_ned_m is None:
        return
    zone = envelope.stand_off
    evader = situation.evader_position_ned_m

    def gap(point):
        beside = max(0.0, math.dist(point[:2], evader[:2]) - zone.radius_m)
        return math.hypot(beside, max(0.0, evader[2] - point[2] - zone.height_m))

    now = situation.position_ned_m
    rest = rest_point(situation, velocity, envelope)
    for share in (0.25, 0.5, 0.75, 1.0):
        point = [a + share * (b - a) for a, b in zip(now, rest, strict=True)]
        if gap(now) > TOLERANCE:
            assert gap(point) > -TOLERANCE
            inside = math.dist(point[:2], evader[:2]) < zone.radius_m - 1e-5
            below = evader[2] - point[2] < zone.height_m - 1e-5
            assert not (inside and below)
    if gap(now) == 0.0:
        assert velocity[2] <= TOLERANCE
        toward = [evader[axis] - now[axis] for axis in (0, 1)]
        assert velocity[0] * toward[0] + velocity[1] * toward[1] <= TOLERANCE


def assert_inside(limited, envelope):
    velocity = limited.setpoint.velocity_ned_m_s
    assert all(math.isfinite(value) for value in numbers(limited.setpoint))
    assert_speeds(velocity, envelope)
    acceleration = limited.setpoint.acceleration_ned_m_s2 or (0.0, 0.0, 0.0)
    assert math.hypot(*acceleration[:2]) <= envelope.acceleration_m_s2 + TOLERANCE
    assert abs(acceleration[2]) <= envelope.vertical_acceleration_m_s2 + TOLERANCE


def assert_inside_space(limited, situation, envelope):
    velocity = limited.setpoint.velocity_ned_m_s
    assert_heights(situation, velocity, envelope)
    assert_circle(situation, velocity, envelope)
    assert_polygon(situation, velocity, envelope)


@settings(max_examples=drawn(200), deadline=None)
@given(wild_setpoints, wild_situations, wild_memories, wild, st.booleans())
def test_no_numbers_at_all_leave_the_speeds_or_yield_a_nan(command, situation, memory, dt, led):
    limited = limit(command, situation, ENVELOPE, memory, dt, already_shaped=led)
    assert_inside(limited, ENVELOPE)
    assert_inside(
        limit(command, situation, ENVELOPE, limited.memory, dt, already_shaped=led), ENVELOPE
    )


@settings(max_examples=drawn(300), deadline=None)
@given(
    wild_setpoints | setpoints, situations, wild_memories | memories, wild | steps, st.booleans()
)
def test_no_command_leads_out_of_the_envelope_from_any_place(command, situation, memory, dt, led):
    limited = limit(command, situation, ENVELOPE, memory, dt, already_shaped=led)
    assert_inside(limited, ENVELOPE)
    assert_inside_space(limited, situation, ENVELOPE)


@settings(max_examples=drawn(200), deadline=None)
@given(setpoints, near_situations, memories, steps, st.booleans())
def test_no_command_leads_into_the_stand_off_of_an_evader_at_rest(
    command, situation, memory, dt, led
):
    situation = situation._replace(evader_velocity_ned_m_s=None)
    limited = limit(command, situation, ENVELOPE, memory, dt, already_shaped=led)
    assert_stand_off(situation, limited.setpoint.velocity_ned_m_s, ENVELOPE)


@settings(deadline=None)
@given(setpoints, situations, memories, steps, st.booleans())
def test_the_acceleration_holds_wherever_no_wall_acts(command, situation, memory, dt, led):
    free = replace(
        ENVELOPE,
        fence_radius_m=None,
        fence_polygon=None,
        stand_off=None,
        floor_m=-1e4,
        ceiling_m=1e4,
    )
    first = limit(command, situation, free, memory, dt, already_shaped=led)
    limited = limit(command, situation, free, first.memory, dt, already_shaped=led)
    change = [
        new - old
        for new, old in zip(
            limited.memory.velocity_ned_m_s, first.memory.velocity_ned_m_s, strict=True
        )
    ]
    assert math.hypot(*change[:2]) <= free.acceleration_m_s2 * dt + TOLERANCE
    assert abs(change[2]) <= free.vertical_acceleration_m_s2 * dt + TOLERANCE


@settings(deadline=None)
@given(setpoints, situations, memories, steps, st.booleans())
def test_standing_still_is_never_turned_into_motion(command, situation, memory, dt, led):
    still = LimitMemory(Ned((0.0, 0.0, 0.0)))
    limited = limit(
        Setpoint(Ned((0.0, 0.0, 0.0))), situation, ENVELOPE, still, dt, already_shaped=led
    )
    assert limited.setpoint.velocity_ned_m_s == (0.0, 0.0, 0.0)
    fed = limited.setpoint.acceleration_ned_m_s2
    assert limited.active == () or (limited.active == (Limiter.FEED_FORWARD,) and fed is not None)
    north, east, down = (
        flown * a for flown, a in zip(situation.velocity_ned_m_s, fed or (0, 0, 0), strict=True)
    )
    assert north + east <= TOLERANCE  # what is fed forward only brakes
    assert down <= TOLERANCE


@settings(deadline=None)
@given(setpoints, situations, memories, steps, st.booleans())
def test_walls_never_add_speed(command, situation, memory, dt, led):
    """Catches a combination of walls that turns or lengthens a command which no single wall changes."""
    free = replace(
        ENVELOPE,
        fence_radius_m=None,
        fence_polygon=None,
        stand_off=None,
        floor_m=-1e4,
        ceiling_m=1e4,
    )
    asked = limit(
        command, situation, free, memory, dt, already_shaped=led
    ).setpoint.velocity_ned_m_s
    got = limit(
        command, situation, ENVELOPE, memory, dt, already_shaped=led
    ).setpoint.velocity_ned_m_s
    assert math.hypot(*got[:2]) <= math.hypot(*asked[:2]) + TOLERANCE
    assert abs(got[2]) <= abs(asked[2]) + TOLERANCE
    assert got[2] * asked[2] >= 0.0


@settings(deadline=None)
@given(setpoints, situations, memories, steps, st.booleans())
def test_a_limiter_is_named_whenever_the_velocity_is_not_the_one_asked_for(
    command, situation, memory, dt, led
):
    limited = limit(command, situation, ENVELOPE, memory, dt, already_shaped=led)
    changed = math.dist(limited.setpoint.velocity_ned_m_s, command.velocity_ned_m_s) > 4.0 * NOTED
    assert bool(set(limited.active) - {Limiter.FEED_FORWARD, Limiter.YAW}) >= changed
    assert len(set(limited.active)) == len(limited.active)


@settings(deadline=None)
@given(setpoints, situations, memories, steps, st.floats(-math.pi, math.pi))
def test_the_limits_know_no_north_where_the_envelope_has_none(
    command, situation, memory, dt, angle
):
    round_envelope = replace(ENVELOPE, fence_polygon=None)
    # Right above the evader, or on its rim, the least turn decides
    if situation.evader_position_ned_m is not None:
        distance_m = math.dist(situation.evader_position_ned_m[:2], situation.position_ned_m[:2])
        assume(distance_m > 1e-3 and abs(distance_m - 3.0) > 1e-3)

    def turned(vector, about=(0.0, 0.0)):
        if vector is None:
            return None
        north = vector[0] - about[0]
        east = vector[1] - about[1]
        cosine = math.cos(angle)
        sine = math.sin(angle)
        return Ned(
            (
                about[0] + cosine * north - sine * east,
                about[1] + sine * north + cosine * east,
                vector[2],
            )
        )

    home = ENVELOPE.home_ned_m
    plain = limit(command._replace(yaw_rad=None), situation, round_envelope, memory, dt)
    other = limit(
        Setpoint(turned(command.velocity_ned_m_s), turned(command.acceleration_ned_m_s2)),
        situation._replace(
            position_ned_m=turned(situation.position_ned_m, home),
            velocity_ned_m_s=turned(situation.velocity_ned_m_s),
            evader_position_ned_m=turned(situation.evader_position_ned_m, home),
            evader_velocity_ned_m_s=turned(situation.evader_velocity_ned_m_s),
            acceleration_ned_m_s2=turned(situation.acceleration_ned_m_s2),
        ),
        round_envelope,
        memory and LimitMemory(*(turned(part) for part in memory[:3]), memory.yaw_rad),
        dt,
    )
    assert other.setpoint.velocity_ned_m_s == pytest.approx(
        turned(plain.setpoint.velocity_ned_m_s), abs=1e-6
    )


@settings(deadline=None)
@given(st.none() | st.builds(AltitudeHold, wild, wild), wild, wild)
def test_no_numbers_at_all_make_a_hold_leave_the_speeds_or_the_heights(memory, down_m, dt):
    down_m_s, held = hold_altitude(memory, down_m=down_m, envelope=ENVELOPE, dt_s=dt)
    assert -ENVELOPE.climb_m_s <= down_m_s <= ENVELOPE.descent_m_s
    if held is not memory:
        assert all(math.isfinite(number) for number in held)
        assert ENVELOPE.floor_m <= ENVELOPE.home_ned_m[2] - held.down_m <= ENVELOPE.ceiling_m
