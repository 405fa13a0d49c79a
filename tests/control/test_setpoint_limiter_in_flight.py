"""Limits in closed loop: a vehicle with lag and limited braking stays inside and stops without oscillation."""

import math
import random
from dataclasses import dataclass, field, replace
from itertools import pairwise

import pytest

from guidance.control import Limiter, Situation
from guidance.control.polygon import Polygon
from guidance.control.servo import AltitudeHold, hold_altitude
from guidance.control.setpoint_limiter import limit
from guidance.frames import Ned
from guidance.game import StandOff
from guidance.messages import Setpoint
from tests.control.scenes import DT_S
from tests.control.scenes import MULTICOPTER as ENVELOPE

ROUNDING_M = 1e-6
SQUARE = Polygon(((-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (-50.0, 50.0)))


@dataclass
class Vehicle:
    """A multicopter's response to a velocity setpoint: first-order lag and bounded acceleration."""

    position: list[float] = field(default_factory=lambda: [0.0, 0.0, -20.0])
    velocity: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    lag_s: float = 0.45
    acceleration: float = 4.0

    def step(self, wanted, disturbance=(0.0, 0.0, 0.0)):
        rate = [
            (w + d - v) / self.lag_s
            for w, d, v in zip(wanted, disturbance, self.velocity, strict=True)
        ]
        share = min(1.0, self.acceleration / max(1e-9, math.hypot(*rate)))
        for axis in range(3):
            self.velocity[axis] += share * rate[axis] * DT_S
            self.position[axis] += self.velocity[axis] * DT_S


def fly(command, envelope, *, vehicle=None, seconds=25.0, evader=None, evader_velocity=None):
    """Fly a command (a vector, or a function of time) and return positions, setpoints and limiters at every step."""
    vehicle = vehicle or Vehicle()
    memory = None
    rows = []
    for step in range(round(seconds / DT_S)):
        now = step * DT_S
        wanted = command(now, vehicle) if callable(command) else command
        place = Ned(evader(now)) if evader else None
        situation = Situation(
            Ned(tuple(vehicle.position)), Ned(tuple(vehicle.velocity)), 0.0, place, evader_velocity
        )
        limited = limit(Setpoint(Ned(wanted)), situation, envelope, memory, DT_S)
        memory = limited.memory
        vehicle.step(limited.setpoint.velocity_ned_m_s)
        rows.append((tuple(vehicle.position), limited.setpoint.velocity_ned_m_s, limited.active))
    return rows


def turnings(values, least=0.02):
    """Count the changes of direction of a sequence that are larger than `least`."""
    count = 0
    direction = 0
    extreme = values[0]
    for value in values:
        if direction * (value - extreme) < -least or (
            direction == 0 and abs(value - extreme) > least
        ):
            count += direction != 0
            direction = 1 if value > extreme else -1
            extreme = value
        elif direction * (value - extreme) > 0 or direction == 0:
            extreme = value if direction else extreme
    return count


@pytest.mark.parametrize("heading_deg", [0, 144])
def test_a_vehicle_sent_out_at_full_speed_rests_at_the_circle(heading_deg):
    heading = math.radians(heading_deg)
    fenced = replace(ENVELOPE, fence_radius_m=60.0)
    rows = fly((20.0 * math.cos(heading), 20.0 * math.sin(heading), 0.0), fenced)
    radii = [math.hypot(*position[:2]) for position, _, _ in rows]
    assert max(radii) <= 60.0 + ROUNDING_M
    assert radii[-1] > 59.8
    assert turnings(radii) == 0
    assert Limiter.FENCE_RADIUS in rows[-1][2]


@pytest.mark.parametrize("heading_deg", [0, 24, 216])
def test_a_vehicle_sent_out_at_full_speed_rests_at_the_polygon(heading_deg):
    heading = math.radians(heading_deg)
    rows = fly(
        (20.0 * math.cos(heading), 20.0 * math.sin(heading), 0.0),
        replace(ENVELOPE, fence_polygon=SQUARE),
    )
    for axis in (0, 1):
        reached = [position[axis] for position, _, _ in rows]
        assert max(abs(value) for value in reached) <= 50.0 + ROUNDING_M
        assert turnings(reached) == 0
    assert max(abs(value) for value in rows[-1][0][:2]) > 49.8


def test_a_vehicle_slides_along_a_wall_and_stops_in_the_corner():
    rows = fly((4.0, 6.0, 0.0), replace(ENVELOPE, fence_polygon=SQUARE), seconds=60.0)
    assert rows[-1][0][:2] == pytest.approx((50.0, 50.0), abs=0.3)


def test_the_inward_corner_of_a_polygon_is_not_cut():
    """Catches a way past the inward corner of a fence, where the nearest edge changes in flight."""
    notched = Polygon(((-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (5.0, 0.0), (-50.0, 50.0)))
    for start in range(-40, 41, 16):
        rows = fly(
            (0.0, 20.0, 0.0),
            replace(ENVELOPE, fence_polygon=notched),
            vehicle=Vehicle([start, -30.0, -20.0]),
        )
        for position, _, _ in rows:
            inside = notched.contains(position[:2])
            assert (
                inside
                or min(math.dist(position[:2], p) for p in notched.nearest_points(position[:2]))
                < ROUNDING_M
            )


def test_a_vehicle_found_outside_the_fence_may_come_back_and_go_no_further():
    fenced = replace(ENVELOPE, fence_radius_m=60.0, fence_polygon=SQUARE)
    out = fly((8.0, 3.0, 0.0), fenced, vehicle=Vehicle([80.0, 0.0, -20.0]), seconds=10.0)
    assert max(math.hypot(*position[:2]) for position, _, _ in out) <= 80.0 + 1e-6
    back = fly((-8.0, 0.0, 0.0), fenced, vehicle=Vehicle([80.0, 0.0, -20.0]), seconds=10.0)
    assert back[-1][0][0] < 20.0


def test_following_the_circle_costs_no_speed_to_speak_of():
    def along(_now, vehicle):
        north, east, _ = vehicle.position
        size = max(1e-9, math.hypot(north, east))
        return (-6.0 * east / size, 6.0 * north / size, 0.0)

    rows = fly(along, replace(ENVELOPE, fence_radius_m=60.0), vehicle=Vehicle([59.0, 0.0, -20.0]))
    assert max(math.hypot(*position[:2]) for position, _, _ in rows) <= 60.0 + ROUNDING_M
    assert min(math.hypot(*velocity[:2]) for _, velocity, _ in rows[200:]) > 5.5


@pytest.mark.parametrize(("vertical", "height"), [(9.0, 3.0), (-9.0, 40.0)])
def test_a_dive_ends_at_the_floor_and_a_climb_at_the_ceiling(vertical, height):
    rows = fly((0.0, 0.0, vertical), ENVELOPE)
    heights = [-position[2] for position, _, _ in rows]
    assert min(heights) >= 3.0 - ROUNDING_M
    assert max(heights) <= 40.0 + ROUNDING_M
    assert heights[-1] == pytest.approx(height, abs=0.1)
    assert turnings(heights) == 0


@pytest.mark.parametrize("stops_at_s", [2.0, 8.0, 30.0])
def test_an_evader_that_stops_dead_is_not_run_into_from_beside(stops_at_s):
    # The estimated evader velocity keeps its old value after the stop, the worst case of a slow estimate.
    envelope = replace(ENVELOPE, stand_off=StandOff(radius_m=3.0, height_m=50.0), ceiling_m=60.0)
    rows = fly(
        (8.0, 0.0, 0.0),
        envelope,
        evader=lambda now: (30.0 + 3.0 * min(now, stops_at_s), 0.0, 0.0),
        evader_velocity=Ned((3.0, 0.0, 0.0)),
        seconds=max(25.0, stops_at_s + 10.0),
    )
    gaps = [
        30.0 + 3.0 * min((step + 1) * DT_S, stops_at_s) - position[0]
        for step, (position, _, _) in enumerate(rows)
    ]
    assert min(gaps) >= 3.0 - ROUNDING_M
    assert gaps[-1] == pytest.approx(3.0, abs=0.1)


@pytest.mark.parametrize("stops_at_s", [5.0, 8.0])
def test_an_evader_that_stops_dead_is_flown_past_over_it_and_never_below_the_lid(stops_at_s):
    envelope = replace(ENVELOPE, stand_off=StandOff(radius_m=3.0, height_m=5.0))
    rows = fly(
        (8.0, 0.0, 1.5),
        envelope,
        vehicle=Vehicle([0.0, 0.0, -6.0]),
        evader=lambda now: (30.0 + 3.0 * min(now, stops_at_s), 0.0, 0.0),
        evader_velocity=Ned((3.0, 0.0, 0.0)),
        seconds=stops_at_s + 6.0,
    )
    for step, (position, _, _) in enumerate(rows):
        away_m = abs(30.0 + 3.0 * min((step + 1) * DT_S, stops_at_s) - position[0])
        assert away_m >= 3.0 - ROUNDING_M or -position[2] >= 5.0 - ROUNDING_M


def test_a_fleeing_evader_is_followed_beside_at_what_can_be_stopped_within():
    envelope = replace(ENVELOPE, stand_off=StandOff(radius_m=3.0, height_m=50.0), ceiling_m=60.0)
    rows = fly(
        (8.0, 0.0, 0.0),
        envelope,
        evader=lambda now: (30.0 + 3.0 * now, 0.0, 0.0),
        evader_velocity=Ned((3.0, 0.0, 0.0)),
    )
    gaps = [
        30.0 + 3.0 * (step + 1) * DT_S - position[0] for step, (position, _, _) in enumerate(rows)
    ]
    assert min(gaps) >= 3.0 - ROUNDING_M
    # Drift and stop at 3 m/s
    assert gaps[-1] == pytest.approx(3.0 + 2.0 * 0.6 * 3.0 + 3.0**2 / (2.0 * 2.5), abs=0.2)
    assert turnings(gaps[200:]) == 0  # it grows at first, while the vehicle gathers speed
    assert rows[-1][1][0] == pytest.approx(3.0, abs=0.05)


@pytest.mark.parametrize(("bearing_deg", "height_m"), [(0, 4.5), (135, 7.0), (260, 20.0)])
def test_a_dive_at_the_evader_ends_on_the_rim_or_the_lid_of_the_stand_off(bearing_deg, height_m):
    envelope = replace(ENVELOPE, stand_off=StandOff(radius_m=3.0, height_m=5.0))
    bearing = math.radians(bearing_deg)

    def at_evader(_now, vehicle):
        slower = 8.0 / max(16.0, math.hypot(*vehicle.position))
        return tuple(-slower * value for value in vehicle.position)

    vehicle = Vehicle([30.0 * math.cos(bearing), 30.0 * math.sin(bearing), -height_m])
    rows = fly(at_evader, envelope, vehicle=vehicle, evader=lambda _now: (0.0, 0.0, 0.0))
    for position, _, _ in rows:
        assert math.hypot(*position[:2]) >= 3.0 - ROUNDING_M or -position[2] >= 5.0 - ROUNDING_M
    assert turnings([math.hypot(*position[:2]) for position, _, _ in rows]) == 0


def test_hovering_noise_at_the_rim_does_not_shake_the_setpoint():
    envelope = replace(ENVELOPE, stand_off=StandOff(radius_m=2.0, height_m=4.0))
    noise = random.Random(5)
    memory = None
    sent = []
    # The game holds at R = 3 m, h = 5 m; the estimate is noisy, the law pulls towards the evader
    for _ in range(1000):
        position = (
            -3.0 + noise.gauss(0.0, 0.1),
            noise.gauss(0.0, 0.1),
            -5.0 + noise.gauss(0.0, 0.1),
        )
        command = Setpoint(Ned((0.5, 0.0, 0.0)))
        limited = limit(
            command,
            Situation(Ned(position), Ned((0.0, 0.0, 0.0)), 0.0, Ned((0.0, 0.0, 0.0))),
            envelope,
            memory,
            DT_S,
        )
        memory = limited.memory
        sent.append(limited.setpoint.velocity_ned_m_s)
    assert max(abs(one[0] - other[0]) for one, other in pairwise(sent[200:])) < 1e-9
    assert sent[-1] == pytest.approx((0.5, 0.0, 0.0))


def test_a_step_from_hover_starts_without_a_jump_and_arrives_without_overshoot():
    rows = fly((8.0, 0.0, 1.5), ENVELOPE, seconds=5.0)
    north = [velocity[0] for _, velocity, _ in rows]
    assert north[0] == pytest.approx(20.0 * DT_S * DT_S)
    assert max(north) <= 8.0
    assert north[-1] == 8.0
    accelerations = [(b - a) / DT_S for a, b in pairwise(north)]
    assert max(accelerations) == pytest.approx(4.0, abs=1e-6)
    assert min(accelerations) > -1e-6
    jerks = [(b - a) / DT_S for a, b in pairwise(accelerations)]
    assert max(abs(jerk) for jerk in jerks) <= 20.0 + 1e-6
    # From rest to v in v/a + a/jerk, the closed form of a trapezoid of acceleration, within two ticks and the reserve.
    reached = next(index for index, value in enumerate(north) if value > 8.0 - 1e-3) * DT_S
    assert reached == pytest.approx(8.0 / 4.0 + 4.0 / 20.0, abs=0.1)


def test_five_minutes_of_level_flight_keep_the_height_that_bare_velocity_loses():
    # PX4 at vz = 0: 6.5 m in 75 s, a steady sink of 0.087 m/s. The hold has to see through noise and a gust of it.
    noise = random.Random(7)
    bare = Vehicle()
    held = Vehicle()
    memory = AltitudeHold(-20.0, 0.0)
    errors = []
    for step in range(round(300.0 / DT_S)):
        sink = 0.087 + (0.2 if 100.0 < step * DT_S < 160.0 else 0.0)
        bare.step((5.0, 0.0, 0.0), (0.0, 0.0, sink))
        seen_m = held.position[2] + noise.gauss(0.0, 0.05)
        down_m_s, memory = hold_altitude(memory, down_m=seen_m, envelope=ENVELOPE, dt_s=DT_S)
        held.step((5.0, 0.0, down_m_s), (0.0, 0.0, sink))
        errors.append(held.position[2] + 20.0)
    assert bare.position[2] + 20.0 > 25.0
    assert max(abs(error) for error in errors) < 0.5
    assert abs(errors[-1]) < 0.1


def test_a_hold_reaches_its_height_without_overshoot():
    vehicle = Vehicle()
    memory = AltitudeHold(-30.0, 0.0)
    heights = []
    for _ in range(1500):
        down_m_s, memory = hold_altitude(
            memory, down_m=vehicle.position[2], envelope=ENVELOPE, dt_s=DT_S
        )
        vehicle.step((0.0, 0.0, down_m_s))
        heights.append(-vehicle.position[2])
    assert max(heights) < 30.3
    assert heights[-1] == pytest.approx(30.0, abs=0.05)
