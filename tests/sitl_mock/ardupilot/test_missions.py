"""Missions as ArduCopter 4.5.7 flies and stores them: waiting items, conditions, circles, jumps, old messages."""

import itertools
import math

import pytest

from tests.sitl_mock.missions.test_missions import item, reached, upload

ACCEPTED = 0
UNSUPPORTED = 3
ATTITUDE = 30
LOCAL_POSITION_NED = 32
TAKEOFF_M = 10.0


def order(number, *params):
    """A mission item without a position."""
    params = [*params, *[0.0] * (4 - len(params))]
    return (3, number, 0, 1, *params, 0, 0, 0.0)


@pytest.fixture
def flown(fly):
    """Fly items after a take-off to 10 m until the copter is disarmed; item 0 is home, item 1 the take-off."""

    def made(*items, within_s=300.0, **settings):
        flight = fly("arducopter", **settings).run(1.0)
        given = [entry(flight) if callable(entry) else entry for entry in items]
        ground = [item(flight, 16, 0, 0, 0.0), item(flight, 22, 0, 0, TAKEOFF_M)]
        assert upload(flight, [*ground, *given, order(20)]) == ACCEPTED
        for number in (ATTITUDE, LOCAL_POSITION_NED):
            assert flight.command(511, number, 100_000.0) == [0]
        flight.guided()
        assert flight.command(400, 1.0) == [0]
        assert flight.command(300, 0.0) == [0]
        flight.until(lambda: not flight.vehicle.armed, within_s)
        return flight

    return made


def at(north, east=0.0, *params, number=16):
    return lambda flight: item(flight, number, north, east, TAKEOFF_M, *params)


def reached_s(flight):
    """Time of the first MISSION_ITEM_REACHED by item."""
    times = {}
    for time_s, message in flight.all("MISSION_ITEM_REACHED"):
        times.setdefault(message.seq, time_s)
    return times


def between(flight, name, since_s, until_s):
    """The messages of a name between two times; there are some."""
    messages = [message for time_s, message in flight.all(name, since_s) if time_s < until_s]
    assert messages
    return messages


def positions(flight, since_s=0.0, until_s=math.inf):
    return between(flight, "LOCAL_POSITION_NED", since_s, until_s)


def test_nav_delay_waits_at_the_last_position(flown):
    """Catches a delay that is flown through."""
    flight = flown(at(20.0), order(93, 20.0, -1.0, -1.0, -1.0), at(40.0))
    times = reached_s(flight)
    assert times[3] - times[2] == pytest.approx(20.0, abs=0.1)
    waiting = positions(flight, times[2] + 6.0, times[3])
    assert all(m.x == pytest.approx(20.0, abs=0.3) for m in waiting)
    assert "Delaying 20 sec" in flight.texts()


def test_condition_delay_holds_back_what_follows_but_not_the_flight(flown):
    """Catches a delay that stops the vehicle."""
    flight = flown(at(20.0), order(112, 4.0), order(178, 1.0, 2.0, -1.0), at(80.0))
    times = reached_s(flight)
    assert times[3] - times[2] == pytest.approx(4.0, abs=0.1)
    assert times[4] == pytest.approx(times[3], abs=0.1)
    before = positions(flight, times[2], times[3])
    assert max(m.vx for m in before) > 5.0
    late = positions(flight, times[3] + 5.0, times[5] - 3.0)
    assert max(m.vx for m in late) < 2.3


def test_a_condition_is_dropped_when_the_position_is_reached_first(flown):
    """Catches a condition that outlives its leg."""
    flight = flown(at(20.0), order(112, 60.0), order(178, 1.0, 2.0, -1.0), at(50.0), at(110.0))
    assert {3, 4}.isdisjoint(reached_s(flight))
    assert max(m.vx for m in positions(flight)) > 8.0


def test_condition_distance_waits_until_the_position_is_near(flown):
    """Catches a distance that counts from the last place."""
    flight = flown(at(20.0), order(114, 30.0), order(207, 1.0), at(100.0))
    distance_s = reached_s(flight)[3]
    near = positions(flight, distance_s)[0]
    assert near.x == pytest.approx(70.0, abs=1.0)
    assert "Fence Enabled" in flight.texts()


def test_condition_yaw_turns_the_nose_until_the_next_position(flown):
    flight = flown(at(20.0), order(115, 90.0, 30.0, 1.0), at(80.0))
    times = reached_s(flight)
    attitudes = between(flight, "ATTITUDE", times[3], times[4] - 0.5)
    headings = [math.degrees(m.yaw) for m in attitudes]
    assert all(heading == pytest.approx(90.0, abs=5.0) for heading in headings)
    assert times[3] - times[2] == pytest.approx(3.0, abs=0.6)


@pytest.mark.parametrize(("radius_m", "turn"), [(10.0, 1.0), (-10.0, -1.0)])
def test_loiter_turns_flies_its_circles(flown, radius_m, turn):
    """Catches circles of a wrong radius, number or sense."""
    flight = flown(at(30.0, 0.0, 2.0, 0.0, radius_m, number=18), at(60.0))
    times = reached_s(flight)
    track = [(m.x - 30.0, m.y) for m in positions(flight, times[1], times[2])]
    circle = [place for place in track if math.hypot(*place) < 11.0]
    assert all(math.hypot(*place) == pytest.approx(10.0, abs=0.8) for place in circle[10:])
    bearings = [math.atan2(east, north) for north, east in circle]
    turned = sum(math.remainder(b - a, math.tau) for a, b in itertools.pairwise(bearings))
    assert turned * turn == pytest.approx(2.0 * math.tau, abs=0.7)


def test_loiter_turns_without_a_radius_has_circle_radius(flown):
    """Catches circles that ignore CIRCLE_RADIUS."""
    flight = flown(
        at(30.0, 0.0, 1.0, 0.0, 0.0, number=18), at(60.0), parameters={"CIRCLE_RADIUS": 500.0}
    )
    times = reached_s(flight)
    widest = max(abs(m.y) for m in positions(flight, 0.0, times[2]))
    assert widest == pytest.approx(5.0, abs=0.6)


def test_a_jump_to_a_tag_repeats_what_is_behind_it(flown):
    """Catches a jump by number instead of by tag."""
    flight = flown(order(600, 7.0), at(20.0), at(40.0), order(601, 7.0, 2.0))
    assert [seq for seq in reached(flight) if seq in {3, 4}] == [3, 4, 3, 4, 3, 4]


STORED = (30, 83, 182, 191, 193, 194, 202, 207, 208, 210, 212, 213, 215, 216, 217, 532, 534, 601)
STORED += (3000, 42600, 42702, 42703)


def test_the_commands_that_the_real_one_stores_are_stored(fly):
    flight = fly("arducopter").run(0.3)
    orders = [order(number, 1.0) for number in STORED]
    assert upload(flight, [item(flight, 16, 0, 0, 0.0), *orders]) == ACCEPTED
    stored = []
    for seq in range(1, 1 + len(STORED)):
        flight.send("MISSION_REQUEST_INT", 1, 1, seq, 0)
        stored.append(flight.last("MISSION_ITEM_INT").command)
    assert stored == list(STORED)


def test_a_command_that_no_copter_has_is_unsupported(fly):
    flight = fly("arducopter").run(0.3)
    assert upload(flight, [item(flight, 16, 0, 0, 0.0), order(12345)]) == UNSUPPORTED


def test_mission_item_and_mission_request_are_warned_of_once(fly):
    flight = fly("arducopter").run(0.5)
    for _ in range(2):
        flight.send("MISSION_COUNT", 1, 1, 1, 0)
        flight.run(0.02)
        flight.send("MISSION_ITEM", 1, 1, 0, 0, 16, 0, 1, 0, 0, 0, 0, 47.397742, 8.545594, 488.0, 0)
        flight.run(0.3)
        flight.send("MISSION_REQUEST", 1, 1, 0, 0)
        flight.run(0.3)
    texts = flight.texts()
    assert texts.count("got MISSION_ITEM; GCS should send MISSION_ITEM_INT") == 1
    assert texts.count("got MISSION_REQUEST; use MISSION_REQUEST_INT!") == 1


def test_px4_says_nothing_of_old_messages(fly):
    flight = fly("px4", texts=True).run(0.5)
    flight.send("MISSION_COUNT", 1, 1, 1, 0)
    flight.run(0.02)
    flight.send("MISSION_ITEM", 1, 1, 0, 0, 16, 0, 1, 0, 0, 0, 0, 47.397742, 8.545594, 488.0, 0)
    flight.run(0.3)
    assert not [text for text in flight.texts() if "got MISSION" in text]


def test_another_mission_goes_on_at_the_number_of_the_present_item(fly):
    """As flown on ArduCopter 4.5.7: in LOITER, in AUTO, after the end, shorter, cleared, and after disarming."""
    flight = fly.airborne("arducopter", height=TAKEOFF_M)

    def uploaded(count, east=0.0):
        items = [at(12.0 * index, east)(flight) for index in range(count)]
        assert upload(flight, items) == ACCEPTED
        return current()

    def current():
        flight.command(512, 42.0)
        message = flight.last("MISSION_CURRENT")
        return message.seq, message.total, message.mission_state, message.mission_mode

    def enter(number):
        assert flight.command(176, 1.0, number) == [0]
        flight.run(1.0)
        return current()

    def cleared():
        flight.send("MISSION_CLEAR_ALL", 1, 1, 0)
        return flight.last("MISSION_ACK").type

    auto = 3.0
    loiter = 5.0
    assert uploaded(5) == (0, 4, 2, 0)
    assert enter(auto) == (1, 4, 3, 1)
    flight.until(lambda: 2 in reached(flight), 60.0)
    assert enter(loiter) == (3, 4, 2, 0)
    assert uploaded(6, 10.0) == (3, 5, 2, 0)
    assert enter(auto) == (3, 5, 3, 1)
    assert cleared() == 1
    assert uploaded(5, -10.0) == (3, 4, 3, 1)
    flight.until(lambda: 4 in reached(flight), 90.0)
    assert flight.position[1] == pytest.approx(-10.0, abs=1.0)
    assert "Auto mission changed, restarted command" in flight.texts()
    assert current() == (4, 4, 5, 1)
    assert uploaded(4) == (4, 3, 5, 1)
    flight.run(2.0)
    assert current() == (4, 3, 5, 1)
    enter(loiter)
    assert enter(auto) == (1, 3, 3, 1)
    flight.send("MISSION_SET_CURRENT", 1, 1, 3)
    assert flight.last("MISSION_CURRENT").seq == 3
    enter(loiter)
    assert uploaded(3) == (3, 2, 2, 0)
    assert enter(auto) == (1, 2, 3, 1)
    enter(loiter)
    assert cleared() == ACCEPTED
    assert current() == (0, 0, 1, 0)
    uploaded(5)
    assert flight.command(224, 3.0) == [0]
    flight.command(400, 0.0, 21196.0)
    assert current() == (0, 4, 2, 0)
