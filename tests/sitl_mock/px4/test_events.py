"""Log levels of PX4's events: the one that is shown, and the one for the log."""

import pytest

from sitl_mock.px4.events import event_of


@pytest.mark.parametrize(
    ("severity", "text", "levels"),
    [
        (6, "Takeoff detected", 0x66),
        (2, "Failsafe activated", 0x42),
        (2, "Arming denied: Resolve system health failures first", 0x62),
        (2, "Mission start denied! No valid mission", 0x62),
        (3, "Reposition is outside geofence", 0x63),
        (6, "Connection to ground station lost", 0x64),
    ],
)
def test_an_event_has_the_levels_of_v1_17(severity, text, levels):
    assert event_of(severity, text).levels == levels
