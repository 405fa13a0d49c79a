"""Replay of MAVSDK's and MAVProxy's recorded frames on the mock, compared with the real autopilots' flights.

`tests/data/flights` has each flight; `python -m tests.sitl_mock.flights.record` flies and records it again. A client's
frames reach the mock at their recorded times. Positions, modes and answers must agree with the real ones.

`*_chase_streams.csv` is a table of recorded facts: 50 s of a pursuit at 6 m/s by the offboard service, on PX4 v1.17
(SIH) and ArduCopter 4.5.7. There the streams, their rates and the size of changes must agree as well.
"""

import functools
import math
from collections import Counter
from typing import NamedTuple

import pytest

from sitl_mock.compare import behaviour_of, differences, fly_recording
from tests.sitl_mock.flights.recorded import Flown, flown, recording, streams_of

pytestmark = pytest.mark.flight


HEARTBEAT_S = 1.2
"""Modes are known by HEARTBEAT, which both send once a second."""


class Bounds(NamedTuple):
    """Tolerances: mean and greatest horizontal and vertical distance (m), and mean yaw difference (deg)."""

    level_m: float
    level_most_m: float
    height_m: float
    height_most_m: float
    yaw_deg: float = 4.0
    late_s: float = HEARTBEAT_S
    reached_s: float = 1.5


DOWN_S = 6.0
"""PX4's landing detector: in three landings from 2.5 m the real one disarmed 8.8 to 14.1 s after the order."""

FLIGHTS = {
    "px4_takeoff_and_land": Bounds(0.6, 1.3, 0.5, 1.0, late_s=DOWN_S),
    "px4_goto": Bounds(1.0, 3.4, 0.9, 3.5),
    "px4_offboard_position_ned": Bounds(0.5, 1.2, 0.4, 1.4),
    # Its heights are relative to home, which wanders on both and counts with the wrong sign.
    "px4_offboard_position_global": Bounds(0.5, 1.5, 1.0, 2.3),
    "px4_offboard_velocity_ned": Bounds(2.4, 6.5, 0.7, 2.6),
    "px4_offboard_velocity_body": Bounds(2.9, 9.0, 1.7, 4.0, yaw_deg=18.0),
    "px4_offboard_attitude": Bounds(0.8, 1.6, 0.9, 1.8),
    "px4_offboard_acceleration": Bounds(1.3, 2.8, 1.2, 3.0, yaw_deg=12.0),
    "px4_mission": Bounds(2.0, 9.0, 1.6, 6.2, yaw_deg=9.0, late_s=DOWN_S, reached_s=2.6),
    "px4_mission_raw": Bounds(1.3, 4.8, 1.3, 3.2, yaw_deg=9.0, late_s=DOWN_S, reached_s=5.0),
    "px4_geofence": Bounds(1.2, 2.7, 0.6, 2.4, yaw_deg=12.0),
    "px4_follow_me": Bounds(1.6, 7.5, 0.7, 1.3, yaw_deg=10.0),
    "px4_do_orbit": Bounds(2.4, 6.0, 0.3, 0.9, yaw_deg=15.0),
    "px4_chase": Bounds(4.5, 16.0, 1.4, 3.6),
    "px4_manual_control": Bounds(2.0, 4.8, 0.7, 2.3, yaw_deg=14.0),
    "arducopter_chase": Bounds(0.1, 0.6, 0.2, 0.6),
    "arducopter_takeoff_and_land": Bounds(0.1, 0.2, 0.2, 0.3),
    "arducopter_velocity": Bounds(3.1, 6.8, 0.2, 0.9, yaw_deg=23.0),
    "arducopter_setyaw": Bounds(0.1, 0.2, 0.1, 0.2, yaw_deg=2.0),
    "arducopter_circle": Bounds(2.9, 4.0, 0.1, 0.2, yaw_deg=17.0),
    "arducopter_mission": Bounds(0.3, 1.9, 0.3, 2.4, yaw_deg=2.0, reached_s=0.4),
    "arducopter_fence": Bounds(0.25, 1.7, 0.2, 1.2, late_s=2.0),
    "arducopter_rally": Bounds(0.35, 1.5, 0.2, 1.2),
    # Until the fence's margin: the real behaviour there is not modelled.
    "arducopter_avoidance": Bounds(0.2, 0.9, 0.25, 1.2),
}
"""Stated as measured, and a third more."""

RARELY = {
    "px4_goto", "px4_offboard_position_global", "px4_offboard_position_ned", "px4_offboard_velocity_body",
    "px4_offboard_attitude", "px4_mission_raw", "px4_offboard_acceleration", "px4_do_orbit", "px4_manual_control",
    "arducopter_setyaw", "arducopter_circle", "arducopter_rally",
}  # fmt: skip
"""Flown by the step `long`: the others use the same modes and messages."""
NAMES = [pytest.param(name, marks=pytest.mark.long) if name in RARELY else name for name in FLIGHTS]


CHASES = ("px4_chase", "arducopter_chase")
SPAN = 4.0
"""A field's range on the mock is neither so much wider nor so much narrower than the recorded one."""

SENSORS = "filter and sensor models with one number where the real ones' move a little"
SIMULATOR = "of that simulator and its host, not of the autopilot"
CLIENT = "the mock flies that client's frames again, not its dialogue"
LEVEL = "yaw, roll and gyros of a vehicle that stands or flies straight are quieter, and the IMU feels no gusts of drag"
UNSET = "what is not controlled is NaN, and 0 on the real one"

DEPARTURES = {
    "px4_chase": {
        "ALTITUDE altitude_terrain": SENSORS,
        "ATTITUDE": LEVEL,
        "ATTITUDE_QUATERNION": LEVEL,
        "ATTITUDE_TARGET": LEVEL,
        "BATTERY_STATUS": SIMULATOR,
        "ESTIMATOR_STATUS": SENSORS,
        "GLOBAL_POSITION_INT": "a unit of the last place, and north is a matter of noise",
        "HIGHRES_IMU": LEVEL,
        "HOME_POSITION": "home creeps and jumps less before the take-off",
        "LINK_NODE_STATUS": "the mock's links count nothing",
        "ODOMETRY": SENSORS,
        "OPEN_DRONE_ID_LOCATION": SENSORS,
        "OPEN_DRONE_ID_SYSTEM": SENSORS,
        "PARAM_VALUE": CLIENT,
        "POSITION_TARGET_GLOBAL_INT": "the trajectory of a hover is quieter",
        "POSITION_TARGET_LOCAL_NED": "the trajectory of a hover is quieter; " + UNSET,
        "SCALED_PRESSURE temperature": SENSORS,
        "STATUSTEXT": "the real one said none here, though heartbeats of a ground station came by",
        "SYS_STATUS": SIMULATOR,
        "TIME_ESTIMATE_TO_TARGET": "no estimate of the way home",
        "VFR_HUD heading": "north is a matter of noise: 0 and 359.9",
        "VIBRATION": SENSORS,
    },
    "arducopter_chase": {
        "ATTITUDE yaw": LEVEL,
        "GLOBAL_POSITION_INT": "a unit of the last place, and north is a matter of noise",
        "POSITION_TARGET_LOCAL_NED": UNSET + "; its type_mask tells less",
        "SYS_STATUS": SIMULATOR,
    },
}
"""Message, or message and beginning of a field, to why the mock differs there."""


class Both(NamedTuple):
    """The real one's flight and the mock's, when the real one ended, and the streams of a chase."""

    real: Flown
    mock: Flown
    end_s: float
    streams: tuple = ()


@functools.cache
def both(name):
    real = recording(name)
    said = fly_recording(real)
    streams = (streams_of(name), behaviour_of(said)) if name in CHASES else ()
    return Both(flown(real.said), flown(said), real.end_s, streams)


@pytest.mark.parametrize("name", NAMES)
def test_the_track_is_the_real_ones(name):
    real, mock, *_ = both(name)
    bounds = FLIGHTS[name]
    pairs = [(row, mock.at(row[0])) for row in real.track]
    assert all(abs(a[0] - b[0]) < 0.3 for a, b in pairs), (
        "the mock tells where it is when the real one did"
    )
    level = [math.dist(a[1:3], b[1:3]) for a, b in pairs]
    height = [abs(a[3] - b[3]) for a, b in pairs]
    turned = [
        abs(math.degrees(math.remainder(a[7] - b[7], math.tau)))
        for a, b in pairs
        if math.isfinite(a[7] + b[7])
    ]
    found = Bounds(_mean(level), max(level), _mean(height), max(height), _mean(turned))
    assert all(a <= b for a, b in zip(found[:5], bounds[:5], strict=True)), (found, bounds)


def _mean(values):
    return sum(values) / len(values)


@pytest.mark.parametrize("name", NAMES)
def test_the_modes_are_the_real_ones_at_their_times(name):
    """Neither was in a mode, armed or not, for longer than a HEARTBEAT that the other was not in at about that time."""
    real, mock, end_s, _ = both(name)
    late_s = FLIGHTS[name].late_s
    for second in range(2, math.floor(end_s - late_s)):
        now = (second, second, HEARTBEAT_S)
        around = (second - late_s, second + late_s)
        assert mock.modes_between(*now) <= real.modes_between(*around), second
        assert real.modes_between(*now) <= mock.modes_between(*around), second


@pytest.mark.parametrize("name", NAMES)
def test_every_order_is_answered_as_the_real_one_did(name):
    real, mock, *_ = both(name)
    assert Counter(mock.answers) == Counter(real.answers)
    assert Counter(mock.plans) == Counter(real.plans)


@pytest.mark.parametrize("name", NAMES)
def test_places_of_a_mission_are_reached_when_the_real_one_did(name):
    real, mock, *_ = both(name)
    assert mock.reached == pytest.approx(real.reached, abs=FLIGHTS[name].reached_s)


def unexplained(name, found):
    """Return the differences without a documented reason."""
    reasons = DEPARTURES[name]
    return [each for each in found if not any(_of(each, reason) for reason in reasons)]


def _of(difference, departure):
    message, _, field = departure.partition(" ")
    return difference[0] == message and difference[1].startswith(field)


def wide(name):
    """Fields that move on both sides, with ranges more than four times apart."""
    real, mock = both(name).streams
    for message in real.keys() & mock.keys():
        for phase, fields in real[message].fields.items():
            for label, values in fields.items():
                other = mock[message].fields.get(phase, {}).get(label)
                if (
                    other is None
                    or not (values.moves and other.moves)
                    or min(real[message].count, 5) < 5
                ):
                    continue
                shares = (values.most - values.least, other.most - other.least)
                if max(shares) > SPAN * max(min(shares), 1e-9):
                    yield message, f"{label} ({phase})", *shares


@pytest.mark.parametrize("name", CHASES)
def test_messages_rates_and_what_moves_are_the_recorded_ones(name):
    real, mock = both(name).streams
    assert len(real) >= 12
    assert unexplained(name, [difference[1:] for difference in differences(real, mock)]) == []


@pytest.mark.parametrize("name", CHASES)
def test_what_moves_moves_by_as_much(name):
    assert unexplained(name, list(wide(name))) == []


@pytest.mark.parametrize("name", CHASES)
def test_every_departure_is_one(name):
    real, mock = both(name).streams
    found = [difference[1:] for difference in differences(real, mock)] + list(wide(name))
    assert [
        reason for reason in DEPARTURES[name] if not any(_of(each, reason) for each in found)
    ] == []


@pytest.mark.parametrize("name", CHASES)
def test_no_message_is_missing(name):
    real, mock = both(name).streams
    assert real.keys() - mock.keys() == set()
