"""HOLD and return interrupt a landing or return in the air, not after it."""

import math

import pytest

HOLD = {"px4": (4, 3), "arducopter": (17, 0)}
RETURN = {"px4": (4, 5), "arducopter": (6, 0)}
NAMES = {"px4": {"hold": "HOLD", "return": "RTL"}, "arducopter": {"hold": "BRAKE", "return": "RTL"}}
AUTOPILOTS = tuple(HOLD)
IN_AIR = 2
LANDING = 4


def ordered(flight, mode):
    """Ask for a mode as the service does; returns the results."""
    return flight.command(176, 1.0, *mode[flight.flavour])


def landed_state(flight):
    """EXTENDED_SYS_STATE.landed_state."""
    return flight.vehicle.autopilot.commander.landed_state


def accepted(flight, results):
    """PX4 answers a mode request twice."""
    return results == ([0, 0] if flight.flavour == "px4" else [0])


@pytest.mark.parametrize("name", AUTOPILOTS)
@pytest.mark.parametrize("descent", ["land", "return"])
def test_hold_stops_a_descent_in_the_air_and_stays_there(fly, name, descent):
    """Catches a descent that goes on after a hold."""
    flight = fly.airborne(name, height=12.0)
    assert flight.command({"land": 21, "return": 20}[descent]) == [0]
    flight.until(lambda: flight.height < 7.0 and flight.velocity[2] > 0.4, 60.0)
    assert landed_state(flight) == LANDING
    assert accepted(flight, ordered(flight, HOLD))
    flight.run(4.0)
    assert landed_state(flight) == IN_AIR
    stopped = flight.position
    assert flight.height > 4.0
    flight.run(30.0)
    assert flight.mode == NAMES[name]["hold"]
    assert flight.vehicle.armed
    assert math.dist(stopped, flight.position) < 0.5


@pytest.mark.parametrize("name", AUTOPILOTS)
def test_hold_stops_the_way_home(fly, name, ned_velocity):
    """Catches a hold that waits for the end of a return."""
    flight = fly.airborne(name, height=35.0)
    stream = ned_velocity(5.0, 0.0, 0.0)
    (flight.offboard(stream) if name == "px4" else flight).run(12.0, stream)
    assert ordered(flight, RETURN)[-1] == 0
    flight.until(lambda: flight.velocity[0] < -1.0, 60.0)
    assert accepted(flight, ordered(flight, HOLD))
    flight.run(10.0)
    stopped = flight.position
    assert stopped[0] > 5.0
    flight.run(20.0)
    assert flight.mode == NAMES[name]["hold"]
    assert math.dist(stopped, flight.position) < 0.5


@pytest.mark.parametrize("name", AUTOPILOTS)
def test_return_interrupts_a_landing_and_lands_at_home(fly, name, ned_velocity):
    """Catches a return that waits for the end of a landing."""
    flight = fly.airborne(name, height=12.0)
    stream = ned_velocity(4.0, 0.0, 0.0)
    (flight.offboard(stream) if name == "px4" else flight).run(8.0, stream)
    flight.command(21)
    flight.until(lambda: flight.height < 6.0, 60.0)
    away_m = math.hypot(*flight.position[:2])
    assert accepted(flight, ordered(flight, RETURN))
    assert flight.mode == "RTL"
    highest_m = 0.0
    while flight.vehicle.armed:
        flight.run(0.5)
        highest_m = max(highest_m, flight.height)
        assert flight.now_s < 250.0
    assert highest_m > 10.0, "it climbs first"
    assert away_m > 10.0
    assert math.hypot(*flight.position[:2]) < 1.0


@pytest.mark.parametrize(
    ("name", "order", "after_s"),
    [
        ("px4", HOLD, 3.5),
        ("px4", RETURN, 0.1),
        ("px4", RETURN, 3.5),
        ("arducopter", HOLD, 0.1),
        ("arducopter", RETURN, 1.2),
    ],
)
def test_a_vehicle_that_has_landed_stays_down_and_disarms(fly, name, order, after_s):
    flight = fly.airborne(name, height=3.0)
    flight.command(21)
    flight.until(lambda: flight.vehicle.truth.on_ground, 30.0)
    flight.run(after_s)
    ordered(flight, order)
    heights_m = []

    def is_disarmed():
        heights_m.append(flight.height)
        return not flight.vehicle.armed

    flight.until(is_disarmed, 15.0)
    assert max(heights_m) < 0.1
    flight.run(2.0)
    assert flight.height < 0.1
    assert not flight.vehicle.armed


def test_px4_stays_armed_when_hold_comes_before_it_has_detected_the_touchdown(fly):
    """As PX4 v1.17: it hovers at the height of the ground until the next landing order."""
    flight = fly.airborne("px4", height=3.0)
    flight.command(21)
    flight.until(lambda: flight.vehicle.truth.on_ground, 30.0)
    assert ordered(flight, HOLD) == [0, 0]
    flight.run(20.0)
    assert flight.mode == "HOLD"
    assert flight.vehicle.armed
    assert landed_state(flight) == IN_AIR
    assert flight.height < 1.0
    assert flight.command(21) == [0]
    flight.until(lambda: not flight.vehicle.armed, 8.0)


def test_arducopter_climbs_to_two_metres_when_a_return_comes_just_after_touchdown(fly):
    """As ArduCopter 4.5.7: it climbs to RTL's least height, waits, lands and disarms."""
    flight = fly.airborne("arducopter", height=3.0)
    flight.command(21)
    flight.until(lambda: flight.vehicle.truth.on_ground, 30.0)
    assert ordered(flight, RETURN) == [0]
    highest_m = 0.0
    while flight.vehicle.armed:
        flight.run(0.5)
        highest_m = max(highest_m, flight.height)
        assert flight.now_s < 120.0
    assert highest_m == pytest.approx(2.0, abs=0.3)
