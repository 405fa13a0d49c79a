"""Missions and fences that are uploaded over the wire and flown."""

import math
from typing import NamedTuple

import pytest

from tests.harness.copies import Flown

MISSION = 0
FENCE = 1
ACCEPTED = 0


def upload(flight, items, kind=MISSION):
    """Upload as a client does: count, then every requested item; returns the result."""
    before = len(flight.heard)
    flight.send("MISSION_COUNT", 1, 1, len(items), kind)
    for _ in range(20 * len(items) + 50):
        for _, message in flight.heard[before:]:
            before += 1
            if message.get_type() in {"MISSION_REQUEST_INT", "MISSION_REQUEST"}:
                flight.send("MISSION_ITEM_INT", 1, 1, message.seq, *items[message.seq], kind)
                break
            if message.get_type() == "MISSION_ACK":
                return message.type
        else:
            flight.run(0.02)
    raise AssertionError("no MISSION_ACK")


def item(flight, command, north, east, height, *params, current=0):
    lat, lon, _ = flight.vehicle.autopilot.frame.to_geodetic(north, east, 0.0)
    params = [*params, *[0.0] * (4 - len(params))]
    return (6, command, current, 1, *params, round(lat * 1e7), round(lon * 1e7), height)


def square(flight, count, side=15.0):
    corners = [(side, 0.0), (side, side), (0.0, side), (0.0, 0.0)]
    return [item(flight, 16, *corners[index % 4], 8.0, 0.0, 1.5) for index in range(count)]


def reached(flight):
    return [m.seq for _, m in flight.all("MISSION_ITEM_REACHED")]


@pytest.mark.parametrize("flavour", [pytest.param("px4", marks=pytest.mark.long), "arducopter"])
def test_a_mission_of_25_items_is_flown_in_order_and_landed(fly, flavour):
    """Catches an item that is skipped, and a mission without a landing."""
    flight = fly(flavour).run(1.0)
    home = [item(flight, 16, 0, 0, 0.0)] if flavour == "arducopter" else []
    items = [*home, item(flight, 22, 0, 0, 8.0), *square(flight, 23), item(flight, 21, 0, 0, 0.0)]
    assert upload(flight, items) == ACCEPTED
    if flavour == "arducopter":
        flight.guided()
    assert flight.command(400, 1.0) == [0]
    if flavour == "arducopter":
        flight.command(22, 0, 0, 0, 0, 0, 0, 3.0)
        flight.run(8.0)
    assert flight.command(300, 0.0) == [0]
    flight.until(lambda: not flight.vehicle.armed, 400.0)
    assert reached(flight) == list(range(len(home), len(items)))
    assert math.hypot(*flight.position[:2]) < 1.5
    assert flight.height == 0.0


def test_mission_start_without_a_mission_is_denied(fly):
    assert fly("px4").run(1.0).command(300, 0.0) == [2]


def test_a_mission_that_ends_in_the_air_holds_there(fly):
    flight = fly.airborne("px4", height=8.0)
    assert upload(flight, square(flight, 2)) == ACCEPTED
    flight.command(300, 0.0)
    flight.until(lambda: flight.mode == "HOLD", 60.0)
    flight.run(4.0)
    assert math.dist(flight.position, (15.0, 15.0, -8.0)) < 2.0
    assert flight.last("MISSION_CURRENT").mission_state == 5


def test_an_interrupted_mission_goes_on_where_it_was(fly):
    """Catches a mission that begins again after a hold."""
    flight = fly.airborne("px4", height=8.0)
    upload(flight, square(flight, 4))
    flight.command(300, 0.0)
    flight.until(lambda: 0 in reached(flight), 40.0)
    flight.command(176, 1, 4, 3)
    flight.run(2.0)
    flight.command(176, 1, 4, 4)
    flight.until(lambda: flight.mode == "HOLD", 90.0)
    assert reached(flight) == [0, 1, 2, 3]


def test_set_current_jumps(fly):
    flight = fly.airborne("px4", height=8.0)
    upload(flight, square(flight, 4))
    flight.send("MISSION_SET_CURRENT", 1, 1, 2)
    flight.command(176, 1, 4, 4)
    flight.run(1.5)
    assert flight.last("MISSION_CURRENT").seq == 2


def test_a_wait_is_kept_and_a_speed_change_is_obeyed(fly):
    """Catches items of time and speed without an effect."""
    flight = fly.airborne("px4", height=8.0)
    items = [
        (2, 178, 0, 1, 1.0, 2.0, -1.0, 0.0, 0, 0, 0.0),
        item(flight, 16, 15.0, 0.0, 8.0, 4.0, 1.0),
        item(flight, 16, 16.0, 0.0, 8.0, 0.0, 1.0),
    ]
    assert upload(flight, items) == ACCEPTED
    flight.command(300, 0.0)
    fastest = 0.0
    while 1 not in reached(flight):
        flight.run(0.1)
        fastest = max(fastest, flight.velocity[0])
        assert flight.now_s < 90.0
    assert fastest < 2.4
    near_s = next(t for t, m in flight.all("LOCAL_POSITION_NED") if m.x > 14.2)
    assert flight.now_s - near_s > 3.5
    flight.until(lambda: reached(flight) == [0, 1, 2], 20.0)


def test_an_uploaded_circle_is_a_fence(fly, ned_velocity):
    flight = fly.airborne("px4", height=8.0).change(GF_ACTION=3)
    lat, lon, _ = flight.vehicle.autopilot.frame.to_geodetic(0.0, 0.0, 0.0)
    circle = (0, 5003, 0, 1, 25.0, 0.0, 0.0, 0.0, round(lat * 1e7), round(lon * 1e7), 0.0)
    assert upload(flight, [circle], FENCE) == ACCEPTED
    stream = ned_velocity(0.0, 5.0, 0.0)
    flight.offboard(stream)
    flight.until(lambda: flight.mode == "RTL", 20.0, stream)
    assert 24.0 < flight.position[1] < 27.0


def test_an_uploaded_polygon_is_a_fence(fly, ned_velocity):
    flight = fly.airborne("px4", height=8.0).change(GF_ACTION=2)
    corners = [(-20.0, -20.0), (-20.0, 20.0), (20.0, 20.0), (20.0, -20.0)]
    items = []
    for corner in corners:
        lat, lon, _ = flight.vehicle.autopilot.frame.to_geodetic(*corner, 0.0)
        items.append((0, 5001, 0, 1, 4.0, 0.0, 0.0, 0.0, round(lat * 1e7), round(lon * 1e7), 0.0))
    assert upload(flight, items, FENCE) == ACCEPTED
    stream = ned_velocity(-5.0, 0.0, 0.0)
    flight.offboard(stream)
    flight.until(lambda: flight.mode == "HOLD", 20.0, stream)
    assert -22.5 < flight.position[0] < -19.0


@pytest.mark.parametrize("height", [math.nan, math.inf])
def test_px4_stores_any_place_and_waits_for_ever_before_one_without_a_height(fly, height):
    """Catches a place without a height that is flown to.

    Measured on v1.17: it hovers where the item before ended and reaches no other.
    """
    flight = fly("px4").run(6.0)
    take_off = item(flight, 22, 0.0, 0.0, 5.0)
    beyond = (6, 16, 0, 1, 0.0, 0.0, 0.0, 0.0, 910_000_000, 2**31 - 1, 5.0)
    assert upload(flight, [take_off, beyond]) == ACCEPTED
    assert upload(flight, [take_off, item(flight, 16, 10.0, 0.0, height)]) == ACCEPTED
    flight.run(0.5)
    assert flight.command(300, 0.0) == [0]
    flight.run(30.0)
    assert flight.last("MISSION_CURRENT").seq == 1
    assert flight.position == pytest.approx((0.0, 0.0, -5.0), abs=1.0)
    assert upload(flight, [(6, 5100, 0, 1, *beyond[4:10], height)], 2) == ACCEPTED


def test_px4_waits_for_a_nav_delay_in_flight_and_on_the_ground(fly):
    """Catches a delay that is lost before the take-off."""
    flight = fly("px4").run(1.0)
    delay = (2, 93, 0, 1, 5.0, -1.0, -1.0, -1.0, 0, 0, 0.0)
    items = [
        delay,
        item(flight, 22, 0, 0, 8.0),
        item(flight, 16, 10.0, 0.0, 8.0),
        delay,
        item(flight, 16, 20.0, 0.0, 8.0),
    ]
    assert upload(flight, items) == ACCEPTED
    flight.command(300, 0.0)
    begun_s = flight.now_s
    flight.run(4.5)
    assert flight.height == 0.0
    flight.until(lambda: 4 in reached(flight), 90.0)
    times = {m.seq: time_s for time_s, m in flight.all("MISSION_ITEM_REACHED")}
    assert times[0] - begun_s == pytest.approx(5.0, abs=0.2)
    assert times[3] - times[2] == pytest.approx(5.0, abs=0.1)


class Replaced(NamedTuple):
    """A mission uploaded during or after another one, as the real PX4 v1.17 flew it.

    Attributes:
        items: Waypoints of the new mission; 0 is the old mission again.
        marked: The item that the client calls current.
        flown: Items flown after the upload.
    """

    items: int
    marked: int | None
    flown: list[int]


PRESENT = 2
"""The old mission's item that is flown during the upload; it has 4."""
RUNNING = (
    Replaced(0, 0, [2, 3]),
    Replaced(5, 0, [0, 1, 2, 3, 4]),
    Replaced(5, None, [2, 3, 4]),
    Replaced(2, None, [1]),
)
FINISHED = (Replaced(0, 0, []), Replaced(5, 0, [0, 1, 2, 3, 4]), Replaced(5, None, [3, 4]))


def legs(flight, count, *, side=10.0, marked=None):
    """Items of a mission along a line to the north, or with a negative side to the south."""
    return [
        item(flight, 16, side * index, 0.0, 8.0, 0.0, 1.0, current=int(index == marked))
        for index in range(count)
    ]


def follow_up(flight, replaced):
    """Upload the new mission, and return the numbers of its items as they were flown."""
    if replaced.items:
        items = legs(flight, replaced.items, side=-10.0, marked=replaced.marked)
    else:
        items = legs(flight, 4, marked=replaced.marked)
    before = len(reached(flight))
    assert upload(flight, items) == ACCEPTED
    flight.command(176, 1, 4, 4)
    flight.run(1.5)
    flight.until(lambda: flight.mode == "HOLD", 90.0)
    return reached(flight)[before:]


@pytest.fixture(scope="module")
def begun(fly):
    """Return copies of a flight that has reached an item of the old mission."""
    flown = Flown()

    def start():
        flight = fly.airborne("px4", height=8.0, texts=True)
        upload(flight, legs(flight, 4))
        flight.command(300, 0.0)
        flight.until(lambda: PRESENT - 1 in reached(flight), 60.0)
        return flight

    def go_on(last):
        flight = flown(PRESENT - 1, start)
        flight.until(lambda: last in reached(flight), 90.0)
        return flight

    return lambda last: flown(last, lambda: go_on(last))


@pytest.mark.parametrize(
    ("replaced", "is_paused"), list(zip(RUNNING, (True, False, True, False), strict=True))
)
def test_a_mission_replaced_in_flight_goes_on_as_on_px4(begun, replaced, is_paused):
    """Catches a new mission that begins at a wrong item in flight."""
    flight = begun(PRESENT - 1)
    if is_paused:
        flight.command(176, 1, 4, 3)
        flight.run(2.0)
    assert follow_up(flight, replaced) == replaced.flown


@pytest.mark.parametrize("replaced", FINISHED)
def test_a_finished_mission_is_replaced_as_on_px4(begun, replaced):
    """Catches a new mission that begins at a wrong item after the end of the old one.

    A finished mission uploaded once more is not flown: nothing has changed, and no item is left.
    """
    flight = begun(3)
    flight.until(lambda: flight.mode == "HOLD", 5.0)
    assert follow_up(flight, replaced) == replaced.flown
    abandoned = "No valid mission available, loitering" in flight.texts()
    assert abandoned == (not replaced.flown)


def test_a_finished_mission_starts_again_after_the_vehicle_was_disarmed(fly):
    """Catches an end that outlives disarming."""
    flight = fly.airborne("px4", height=3.0)
    upload(flight, [item(flight, 16, 5.0, 0.0, 3.0), item(flight, 16, 8.0, 0.0, 3.0)])
    flight.command(300, 0.0)
    flight.until(lambda: 1 in reached(flight), 60.0)
    flight.until(lambda: flight.mode == "HOLD", 5.0)
    flight.command(400, 0, 21196)
    flight.run(3.0)
    before = len(reached(flight))
    assert flight.command(300, 0.0) == [0]
    flight.until(lambda: len(reached(flight)) == before + 2, 60.0)
    assert reached(flight)[before:] == [0, 1]


def test_a_mission_that_px4_cannot_fly_is_accepted_ends_the_flight_and_is_refused(fly, begun):
    """Catches an impossible mission that is flown."""
    flight = fly("px4").run(1.0)
    landing = item(flight, 21, 0, 0, 0.0)
    take_off = item(flight, 22, 0, 0, 8.0)
    for items in ([landing], [*legs(flight, 1), take_off], [item(flight, 22, 0, 0, -3.0)]):
        assert upload(flight, items) == ACCEPTED
        assert flight.command(300, 0.0) == [2]
    flight = begun(PRESENT - 1)
    assert upload(flight, [*legs(flight, 1), take_off]) == ACCEPTED
    flight.run(1.5)
    assert flight.mode == "HOLD"
    assert "No valid mission available, loitering" in flight.texts()
    assert flight.command(176, 1, 4, 4) == [0, 1]
