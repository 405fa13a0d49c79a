"""Two vehicles that close on each other keep their separation, each braking its half, with old and lost states."""

import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guidance.control import Dynamics, Limits, Situation, Speeds
from guidance.control.braking_law import Separation, held_back, measure_walls
from guidance.control.setpoint_limiter import limit
from guidance.frames import STILL, Ned
from guidance.game import StandOff
from guidance.messages import Setpoint
from tests.harness.examples import drawn

APART_M = 8.0
HEIGHT_M = 3.0
STEP_S = 0.02
LAG_S = 0.3
LIMITS = Limits(floor_m=2.0, ceiling_m=100.0, fence_radius_m=900.0)
DYNAMICS = Dynamics(acceleration_m_s2=5.0, vertical_acceleration_m_s2=3.0, jerk_m_s3=20.0)
OPEN = replace(LIMITS.envelope(Speeds(8.0, 3.0, 2.0), DYNAMICS, StandOff(3.0, 8.0)), stand_off=None)


def outside_m(one, other):
    """Distance of two places beyond the separation; negative if it is not kept."""
    beside = math.dist(one[:2], other[:2]) - APART_M
    above = abs(one[2] - other[2]) - HEIGHT_M
    return max(beside, above)


class Point:
    """A vehicle whose velocity follows the setpoint with a lag and within its braking."""

    def __init__(self, place, goal):
        self.place = list(place)
        self.goal = goal
        self.velocity = [0.0, 0.0, 0.0]
        self.memory = None
        self.told = []

    def step(self, number, mate):
        if mate is not None:
            at, place, velocity = mate
            age_s = (number - at) * STEP_S
            place = tuple(p + age_s * v for p, v in zip(place, velocity, strict=True))
            spread_m = 2.5 * age_s * age_s
            mates = [Separation(Ned(place), APART_M + spread_m, HEIGHT_M + spread_m)]
        else:
            mates = []
        away = [to - at for to, at in zip(self.goal, self.place, strict=True)]
        asked = tuple(3.0 * part for part in away)
        here = Situation(Ned(tuple(self.place)), Ned(tuple(self.velocity)))
        walls = measure_walls(here, OPEN, mates)
        limited = limit(Setpoint(Ned(asked)), here, OPEN, self.memory, STEP_S, walls=walls)
        self.memory = limited.memory
        for axis, wanted in enumerate(limited.setpoint.velocity_ned_m_s):
            rate = (wanted - self.velocity[axis]) / LAG_S
            most = 5.0 if axis < 2 else 3.0
            self.velocity[axis] += STEP_S * max(-most, min(most, rate))
            self.place[axis] += STEP_S * self.velocity[axis]
        self.told.append((number, tuple(self.place), tuple(self.velocity)))


CLOSED = replace(OPEN, fence_radius_m=50.0, fence_margin_m=2.0, ceiling_m=20.0)
BEYOND = {
    "below the floor": Ned((0.0, 0.0, -1.4)),
    "above the ceiling": Ned((0.0, 0.0, -20.6)),
    "beyond the fence": Ned((0.0, 48.6, -10.0)),
    "beyond fence and ceiling": Ned((-48.6, 0.0, -20.6)),
}
"""Places 0.6 m beyond the line where a vehicle has to stop."""


def flown_to(here_ned_m, asked_ned_m_s, mates, envelope=CLOSED):
    """Return the setpoint that a resting vehicle gets in the end, at a place."""
    here = Situation(here_ned_m, STILL)
    walls = measure_walls(here, envelope, mates)
    desired = held_back(asked_ned_m_s, walls, envelope)
    memory = None
    for _ in range(100):
        limited = limit(Setpoint(desired), here, envelope, memory, STEP_S, walls=walls)
        memory = limited.memory
    return limited.setpoint.velocity_ned_m_s


@pytest.mark.parametrize("place", sorted(BEYOND))
@given(
    st.lists(st.tuples(*[st.floats(-6.0, 6.0)] * 3, st.floats(0.0, 30.0)), min_size=1, max_size=3)
)
@settings(max_examples=drawn(40), deadline=None)
def test_floor_ceiling_and_fence_rank_before_the_separation_from_mates_anywhere(place, mates):
    here_ned_m = BEYOND[place]
    # A spread of some metres is that of a mate which is silent: it may have the vehicle in its cylinder
    cylinders = [
        Separation(here_ned_m + Ned(offset), APART_M + spread_m, HEIGHT_M + spread_m)
        for *offset, spread_m in mates
    ]
    alone = flown_to(here_ned_m, STILL, [])
    beside_mates = flown_to(here_ned_m, STILL, cylinders)
    for axis in range(3):
        if abs(alone[axis]) > 0.1:
            back = beside_mates[axis] / alone[axis]
            assert back > 0.9, (axis, alone, beside_mates)


@given(
    st.tuples(*[st.floats(-6.0, 6.0)] * 3, st.floats(0.0, 30.0)),
    st.tuples(*[st.floats(-6.0, 6.0)] * 3).map(Ned),
)
@settings(max_examples=drawn(60), deadline=None)
def test_within_the_limits_the_separation_gives_way_to_nothing(mate, asked):
    *offset, spread_m = mate
    here_ned_m = Ned((10.0, 0.0, -10.0))
    centre = here_ned_m + Ned(offset)
    cylinder = Separation(centre, APART_M + spread_m, HEIGHT_M + spread_m)
    flown = flown_to(here_ned_m, asked, [cylinder])
    beside_m = math.dist(here_ned_m[:2], centre[:2]) - cylinder.radius_m
    above_m = abs(here_ned_m[2] - centre[2]) - cylinder.height_m
    if max(beside_m, above_m) < 0.0:  # inside: nothing leads nearer to the axis or to the middle
        assert flown.level_dot(centre - here_ned_m) <= 1e-6
        assert flown.down * (centre - here_ned_m).down <= 1e-6


def test_a_hover_at_the_ceiling_above_a_silent_mate_does_not_drift_out():
    """What a PX4 did: it could not correct a drift upwards, because down was towards the mate."""
    point = Point((0.0, 0.0, -19.9), (0.0, 0.0, -19.9))
    drift_m_s = -0.1
    highest_m = 0.0
    for number in range(1, 1500):
        spread_m = 0.02 * number
        mates = [Separation(Ned((3.0, 0.0, -16.0)), APART_M + spread_m, HEIGHT_M + spread_m)]
        here = Situation(Ned(tuple(point.place)), Ned(tuple(point.velocity)))
        walls = measure_walls(here, CLOSED, mates)
        asked = held_back(Ned((0.0, 0.0, point.goal[2] - point.place[2])), walls, CLOSED)
        limited = limit(Setpoint(asked), here, CLOSED, point.memory, STEP_S, walls=walls)
        point.memory = limited.memory
        velocity = limited.setpoint.velocity_ned_m_s
        point.velocity = [*velocity[:2], velocity[2] + drift_m_s]
        point.place = [
            at + STEP_S * rate for at, rate in zip(point.place, point.velocity, strict=True)
        ]
        highest_m = max(highest_m, -point.place[2] - CLOSED.ceiling_m)
    assert highest_m < 0.3


places = st.tuples(st.floats(-60.0, 60.0), st.floats(-60.0, 60.0), st.floats(-30.0, -8.0)).map(Ned)


@settings(max_examples=drawn(60), deadline=None)
@given(
    places,
    places,
    places,
    places,
    st.integers(0, 8),
    st.floats(0.0, 0.3),
    st.randoms(use_true_random=False),
)
def test_two_vehicles_keep_their_separation_wherever_they_want_to_go(
    one, other, to, there, late, loss, draw
):
    """Catches two vehicles that each brake within their half and meet, with late and lost states of each other."""
    if outside_m(one, other) < 1.0:
        other = (one[0] + APART_M + 1.0, one[1], other[2])
    points = [Point(one, to), Point(other, there)]
    heard = [(0, tuple(other), (0.0, 0.0, 0.0)), (0, tuple(one), (0.0, 0.0, 0.0))]
    for number in range(1, 700):
        for point, mate in zip(points, heard, strict=True):
            point.step(number, mate)
        if number % 5 == 0 and number > late:
            for index in (0, 1):
                if draw.random() >= loss:
                    heard[index] = points[1 - index].told[-1 - late]
        assert outside_m(points[0].place, points[1].place) > -0.5
