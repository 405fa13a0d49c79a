"""Streams, their rates, and the size of changes: the mock in two whole chases compared with the real ones.

`tests/data/flights/*_chase_streams.csv` is the table of recorded facts, `*_chase.tlog.gz` the client's frames: 50 s of
a pursuit at 6 m/s by the offboard service, on PX4 v1.17 (SIH) and ArduCopter 4.5.7.
"""

import functools

import pytest

from sitl_mock.compare import behaviour_of, differences, fly_recording
from tests.sitl_mock.flights.recorded import recording, streams_of

pytestmark = pytest.mark.flight
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


@functools.cache
def both(name):
    return streams_of(name), behaviour_of(fly_recording(recording(name)))


def unexplained(name, found):
    """Return the differences without a documented reason."""
    reasons = DEPARTURES[name]
    return [each for each in found if not any(_of(each, reason) for reason in reasons)]


def _of(difference, departure):
    message, _, field = departure.partition(" ")
    return difference[0] == message and difference[1].startswith(field)


def wide(name):
    """Fields that move on both sides, with ranges more than four times apart."""
    real, mock = both(name)
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
    real, mock = both(name)
    assert len(real) >= 12
    assert unexplained(name, [difference[1:] for difference in differences(real, mock)]) == []


@pytest.mark.parametrize("name", CHASES)
def test_what_moves_moves_by_as_much(name):
    assert unexplained(name, list(wide(name))) == []


@pytest.mark.parametrize("name", CHASES)
def test_every_departure_is_one(name):
    real, mock = both(name)
    found = [difference[1:] for difference in differences(real, mock)] + list(wide(name))
    assert [
        reason for reason in DEPARTURES[name] if not any(_of(each, reason) for each in found)
    ] == []


@pytest.mark.parametrize("name", CHASES)
def test_no_message_is_missing(name):
    real, mock = both(name)
    assert real.keys() - mock.keys() == set()
