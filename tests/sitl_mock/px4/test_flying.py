"""One long flight of the mock beside the same commands flown on PX4 v1.17 (SIH): `tests/data/px4_flights.csv`.

Tracks, heights and speeds are held second by second. The real one had its estimator's wander, and its legs begin where
the last one ended, so the bounds are those of a flight and not of a calculation.
"""

import csv
import math
from collections import defaultdict
from pathlib import Path

import pytest

pytestmark = pytest.mark.flight
NAN = math.nan
PLACES = [(20.0, 0.0, 10.0), (20.0, 20.0, 15.0), (0.0, 20.0, 10.0)]


def recorded():
    """Rows of each recorded flight: seconds, position, velocity, yaw."""
    flights = defaultdict(list)
    path = Path(__file__).parents[2] / "data" / "px4_flights.csv"
    with path.open(newline="", encoding="ascii") as file:
        for row in csv.DictReader(file):
            flights[row.pop("flight")].append([float(value) for value in row.values()])
    return flights


REAL = recorded()


class Script:
    """The commands that were flown, and the track of the mock."""

    def __init__(self, flight):
        self.flight = flight.run(3.0)
        self.amsl = self.flight.vehicle.autopilot.frame.origin.alt_amsl_m
        self.tracks = {}
        self.took_s = {}

    def place(self, north, east):
        lat, lon, _ = self.flight.vehicle.autopilot.frame.to_geodetic(north, east, 0.0)
        return {"x": round(lat * 1e7), "y": round(lon * 1e7)}

    def goto(self, north, east, height, speed=-1.0):
        where = self.place(north, east)
        assert self.flight.command_int(
            192, 0, speed, 1.0, 0.0, NAN, **where, z=self.amsl + height
        ) == [0]

    def orbit(self, radius):
        where = self.place(0.0, 0.0)
        assert self.flight.command_int(
            34, 0, radius, 2.0, 0.0, NAN, **where, z=self.amsl + 10.0
        ) == [0]

    def target(self, since_s):
        """A FOLLOW_TARGET that moves north at 2 m/s."""
        where = self.place(2.0 * since_s, 5.0)
        rest = ([2.0, 0.0, 0.0], [0.0] * 3, [1.0, 0.0, 0.0, 0.0], [0.0] * 3, [0.0] * 3, 0)
        self.flight.send(
            "FOLLOW_TARGET", int(since_s * 1000.0), 1, where["x"], where["y"], self.amsl, *rest
        )

    def record(self, name, stream=None, each=None):
        """Fly for as long as was recorded, noting the truth every second."""
        vehicle = self.flight.vehicle
        track = []
        for second in range(len(REAL[name])):
            truth = vehicle.truth
            track.append(
                [float(second), *truth.position_ned_m, *truth.velocity_ned_m_s, truth.yaw_rad]
            )
            if each is not None:
                each(float(second))
            self.flight.run(1.0, stream)
        self.tracks[name] = track

    def until(self, name, condition):
        self.took_s[name] = len(REAL[name]) + self.flight.until(condition, 30.0)


def attitude(roll_deg, pitch_deg, thrust):
    half_r = math.radians(roll_deg) / 2.0
    half_p = math.radians(pitch_deg) / 2.0
    c_r = math.cos(half_r)
    s_r = math.sin(half_r)
    c_p = math.cos(half_p)
    s_p = math.sin(half_p)
    return (
        "SET_ATTITUDE_TARGET",
        0,
        1,
        1,
        7,
        [c_r * c_p, s_r * c_p, c_r * s_p, -s_r * s_p],
        0,
        0,
        0,
        thrust,
    )


@pytest.fixture(scope="module")
def flown(fly, ned_velocity):
    script = Script(fly("px4"))
    flight = script.flight
    assert flight.command(400, 1.0) == [0]
    flight.run(0.5)
    script.goto(15.0, 0.0, 10.0)
    script.record("goto")
    assert flight.command(178, 1.0, 2.0, -1.0) == [0]
    script.goto(-15.0, 0.0, 10.0)
    script.record("goto at 2 m/s")
    script.orbit(10.0)
    script.record("orbit")
    script.orbit(2000.0)
    flight.run(3.0)
    assert flight.command(176, 1, 4, 8) == [0, 0]
    script.record("follow", each=script.target)
    assert flight.command(176, 1, 4, 3) == [0, 0]
    flight.run(3.0)
    script.goto(0.0, 0.0, 12.4, 6.0)
    script.record("goto 55 m")
    assert flight.command(21) == [0]
    script.record("land")
    script.until("land", lambda: not flight.vehicle.armed)
    _mission(script)
    assert flight.command(20) == [0]
    script.record("return")
    script.until("return", lambda: not flight.vehicle.armed)
    flight.run(2.0)
    _attitudes(script, ned_velocity(1.0, 0.0, 0.0, mask=0xFC7))
    return script


def _mission(script):
    flight = script.flight
    flight.send("MISSION_COUNT", 1, 1, len(PLACES), 0)
    for seq, (north, east, height) in enumerate(PLACES):
        where = script.place(north, east)
        flight.send(
            "MISSION_ITEM_INT",
            1,
            1,
            seq,
            6,
            16,
            0,
            1,
            0.0,
            0.0,
            0.0,
            NAN,
            where["x"],
            where["y"],
            height,
            0,
        )
    assert flight.command(400, 1.0) == [0]
    assert flight.command(176, 1, 4, 4) == [0, 0]
    script.record("mission")
    script.until("mission", lambda: flight.mode == "HOLD")
    flight.run(3.0)


def _attitudes(script, velocity):
    flight = script.flight
    still = attitude(0.0, 0.0, 0.0)
    flight.run(1.0, still)
    flight.guided()
    assert flight.command(400, 1.0) == [0]
    flight.run(1.0, still)
    script.record("attitude thrust 0.6", attitude(0.0, 0.0, 0.6))
    script.record("attitude roll 10", attitude(10.0, 0.0, 0.6))
    script.record("attitude pitch 10", attitude(0.0, 10.0, 0.6))
    acceleration = (
        "SET_POSITION_TARGET_LOCAL_NED",
        0,
        1,
        1,
        1,
        3135,
        0,
        0,
        0,
        0,
        0,
        0,
        1.0,
        0,
        0,
        0,
        0,
    )
    script.record("acceleration 1 north", acceleration)
    script.record("velocity 1 north", velocity)
    assert flight.mode == "OFFBOARD"


def differences(flown, name):
    """Mean distance level and in height over the track, m."""
    pairs = list(zip(REAL[name], flown.tracks[name], strict=True))
    level = sum(math.dist(a[1:3], b[1:3]) for a, b in pairs) / len(pairs)
    height = sum(abs(a[3] - b[3]) for a, b in pairs) / len(pairs)
    return level, height


@pytest.mark.parametrize(
    ("name", "level_m", "height_m"),
    [
        pytest.param("goto", 0.8, 0.7, marks=pytest.mark.long),
        ("goto at 2 m/s", 2.8, 0.2),
        ("orbit", 1.1, 0.2),
        ("follow", 3.6, 0.6),
        ("goto 55 m", 1.6, 0.3),
        ("land", 0.8, 0.5),
        ("return", 1.8, 1.2),
    ],
)
def test_the_track_is_the_real_ones(flown, name, level_m, height_m):
    level, height = differences(flown, name)
    assert level < level_m
    assert height < height_m


def test_the_mission_is_the_real_ones_but_for_the_moment_it_began(flown):
    late_s = 2
    real = REAL["mission"][late_s:]
    mock = flown.tracks["mission"]
    away = [math.dist(a[1:4], b[1:4]) for a, b in zip(real, mock, strict=False)]
    assert sum(away) / len(away) < 2.5
    assert flown.took_s["mission"] == pytest.approx(36.5 - late_s, abs=3.5)
    assert max(math.hypot(*row[4:6]) for row in mock) == pytest.approx(
        max(math.hypot(*row[4:6]) for row in real), abs=0.5
    )


@pytest.mark.parametrize(("name", "real_s"), [("land", 22.4), ("return", 50.7)])
def test_it_is_disarmed_when_the_real_one_is(flown, name, real_s):
    assert flown.took_s[name] == pytest.approx(real_s, abs=3.0)


@pytest.mark.parametrize(
    "name",
    [
        "attitude thrust 0.6",
        "attitude roll 10",
        "attitude pitch 10",
        "acceleration 1 north",
        "velocity 1 north",
    ],
)
def test_a_stream_leads_to_the_real_ones_velocity(flown, name):
    real = REAL[name][-1]
    mock = flown.tracks[name][-1]
    assert math.dist(real[4:6], mock[4:6]) < 0.5


def test_two_metres_a_second_are_what_the_real_one_makes_of_them(flown):
    pairs = zip(REAL["goto at 2 m/s"][6:14], flown.tracks["goto at 2 m/s"][6:14], strict=True)
    assert all(abs(a[4] - b[4]) < 0.3 for a, b in pairs)


def test_the_nose_points_where_the_real_ones_does(flown):
    for name in ("goto 55 m", "orbit"):
        pairs = list(zip(REAL[name][8:], flown.tracks[name][8:], strict=True))
        assert all(abs(math.remainder(a[7] - b[7], math.tau)) < 0.35 for a, b in pairs), name
