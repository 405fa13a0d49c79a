"""The Rover flavour."""

import math

import pytest


def driving(fly, **settings):
    flight = fly("rover", **settings).run(1.0)
    assert flight.guided() == [0]
    assert flight.command(400, 1.0) == [0]
    return flight


def test_it_is_a_ground_rover_and_never_leaves_the_ground(fly, ned_velocity):
    flight = driving(fly).run(5.0, ned_velocity(2.0, 0.0, -3.0))
    assert flight.last("HEARTBEAT").type == 10
    assert flight.position[2] == 0.0
    assert flight.velocity[0] == pytest.approx(2.0, abs=0.1)


def test_guided_needs_a_position(fly):
    flight = fly("rover", ready_after_s=20.0).run(1.0)
    assert flight.guided() == [4]
    flight.run(20.0)
    assert flight.guided() == [0]


def test_it_turns_towards_the_velocity(fly, ned_velocity):
    flight = driving(fly).run(8.0, ned_velocity(-1.0, -2.0, 0.0))
    assert flight.velocity[:2] == pytest.approx((-1.0, -2.0), abs=0.1)
    assert flight.vehicle.truth.yaw_rad == pytest.approx(math.atan2(-2.0, -1.0), abs=0.05)


def test_it_stops_three_seconds_after_the_last_setpoint_and_stays_guided(fly, ned_velocity):
    flight = driving(fly).run(5.0, ned_velocity(2.0, 0.0, 0.0))
    flight.run(2.9)
    assert flight.velocity[0] == pytest.approx(2.0, abs=0.05)
    flight.run(2.2)
    assert abs(flight.velocity[0]) < 0.05
    assert flight.mode == "GUIDED"


def test_disarmed_it_does_not_move(fly, ned_velocity):
    flight = fly("rover").run(1.0)
    flight.guided()
    flight.run(3.0, ned_velocity(2.0, 0.0, 0.0))
    assert flight.position == (0.0, 0.0, 0.0)


def test_hold_stands_and_return_drives_home(fly, ned_velocity):
    flight = driving(fly).run(10.0, ned_velocity(3.0, 0.0, 0.0))
    assert flight.command(176, 1, 4) == [0]
    flight.run(3.0)
    assert math.hypot(*flight.velocity) < 0.05
    assert flight.command(20) == [0]
    flight.run(40.0)
    assert math.hypot(*flight.position[:2]) < 1.0


def test_it_has_no_take_off(fly):
    assert driving(fly).command(22, 0, 0, 0, 0, 0, 0, 5.0) == [3]


def test_a_place_is_driven_to(fly):
    flight = driving(fly)
    flight.send(
        "SET_POSITION_TARGET_LOCAL_NED", 0, 1, 1, 1, 0x0DF8, 10.0, -6.0, 0, 0, 0, 0, 0, 0, 0, 0, 0
    )
    flight.run(30.0)
    assert math.dist(flight.position[:2], (10.0, -6.0)) < 0.8


def test_it_starts_where_it_is_put_and_counts_from_there(fly):
    flight = fly("rover", start_ned=(30.0, -10.0, 0.0)).run(1.0)
    flight.command(512, 33.0)
    flight.command(512, 32.0)
    place = flight.last("GLOBAL_POSITION_INT")
    assert place.lat * 1e-7 == pytest.approx(47.397742 + 30.0 / 111_185.0, abs=2e-7)
    assert (flight.last("LOCAL_POSITION_NED").x, flight.last("LOCAL_POSITION_NED").y) == (0.0, 0.0)


def test_a_rover_knows_no_buttons_of_a_solo(fly):
    flight = fly("rover").run(1.0)
    flight.command(400, 1.0, 21196.0)
    assert flight.vehicle.armed
    assert [flight.command(number) for number in (42002, 42003)] == [[3], [3]]
    assert flight.vehicle.armed
