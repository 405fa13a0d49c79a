"""The table of ages: which values a safety rule reads, and how old each may be."""

import re

from guidance.flight.freshness import AGES, NEEDED, known
from guidance.messages import (
    Attitude,
    GlobalPosition,
    Heartbeat,
    Home,
    LandedState,
    LocalPosition,
    Origin,
    SystemStatus,
)
from tests.flight.scenes import NOW_S, home, status, well


def test_preflight_judges_by_nothing_that_is_old():
    place = GlobalPosition(NOW_S - 1.9, 0.0, 47.4, 8.5, 500.0, 10.0, (0.0, 0.0, 0.0))
    origin = Origin(NOW_S - 9.9, 47.4, 8.5, 500.0)
    vehicle = well(place, origin, home(NOW_S - 9.9), status(NOW_S - 2.9))
    kinds = {GlobalPosition, Origin, Home, SystemStatus}
    assert kinds <= known(vehicle, NOW_S).latest.copy().keys()
    assert not kinds & known(vehicle, NOW_S + 0.2).latest.copy().keys()
    flown = vehicle._replace(home_fixed=True)
    assert known(flown, NOW_S + 0.2).latest.copy().keys() & kinds == {Origin, Home}


def test_the_table_of_ages_states_these_limits():
    stated = {
        row.value: tuple(
            re.findall(r"([0-9.]+ m?s)\b", text) for text in (row.before, row.in_flight)
        )
        for row in AGES
    }
    assert {value: limits for value, limits in stated.items() if any(limits)} == {
        "mode, armed or not": (["3 s"], ["3 s"]),
        "position, velocity": (["1 s"], ["1 s"]),
        "delay of the telemetry": (["0.2 ms", "0.5 s"], ["0.5 s"]),
        "heading": (["1 s"], []),
        "on the ground or not": (["2 s"], ["2 s"]),
        "the autopilot's own pre-arm check": (["3 s"], []),
        "charge": (["3 s"], ["10 s"]),
        "home": (["10 s"], []),
        "origin of the local frame": (["10 s"], []),
        "place on the map": (["2 s"], ["1 s"]),
        "error of the height": ([], ["5 s"]),
        "a mate of the team": ([], ["0.5 s", "2 s", "10 s"]),
        "another aircraft, in a team": ([], ["0.5 s", "10 s"]),
    }
    ages = [NEEDED[kind].limit_s for kind in (Heartbeat, LocalPosition, Attitude, LandedState)]
    assert ages == [3.0, 1.0, 1.0, 2.0]
    assert [NEEDED[kind].limit_s for kind in (Home, SystemStatus)] == [10.0, 3.0]


def test_every_message_that_a_check_needs_is_in_the_table_of_ages():
    names = {name for row in AGES for name in row.message.split(", ")}
    assert {
        "HEARTBEAT",
        "LOCAL_POSITION_NED",
        "ATTITUDE",
        "EXTENDED_SYS_STATE",
        "HOME_POSITION",
        "SYS_STATUS",
    } <= names
    assert len(NEEDED) == 6
    assert all(needed.advice for needed in NEEDED.values())
    assert all(all(cells) for cells in AGES)
