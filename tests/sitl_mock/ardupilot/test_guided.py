"""Flights as dronekit's examples fly them (2.9.2 does not import on Python 3.10 and later), beside ArduCopter 4.5.7.

The messages are those that dronekit's public API sends: simple_takeoff, airspeed and groundspeed, simple_goto (a
MISSION_ITEM with current 2), commands.upload and next, vehicle.mode. The flights are compared: where the real one
was, and when.
"""

import math

import pytest


class Drone:
    """The calls of dronekit's Vehicle, as messages to a stepped mock."""

    def __init__(self, fly):
        self.flight = fly("arducopter", source=(255, 0)).run(1.0)

    def mode(self, number):
        self.flight.send("COMMAND_LONG", 1, 1, 176, 0, 1, number, 0, 0, 0, 0, 0)

    def place(self, north, east):
        lat, lon, _ = self.flight.vehicle.autopilot.frame.to_geodetic(north, east, 0.0)
        return lat, lon

    def arm_and_takeoff(self, height):
        self.mode(4)
        self.flight.send("COMMAND_LONG", 1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
        self.flight.run(0.5)
        assert self.flight.vehicle.armed
        self.flight.send("COMMAND_LONG", 1, 1, 22, 0, 0, 0, 0, 0, 0, 0, height)
        return self.flight.until(lambda: self.flight.height >= 0.95 * height, 30.0)

    def speed(self, kind, speed):
        self.flight.send("COMMAND_LONG", 1, 1, 178, 0, kind, speed, -1, 0, 0, 0, 0)

    def simple_goto(self, north, east, height):
        self.flight.send(
            "MISSION_ITEM", 1, 1, 0, 3, 16, 2, 0, 0, 0, 0, 0, *self.place(north, east), height, 0
        )

    def upload(self, items):
        self.flight.send("MISSION_CLEAR_ALL", 1, 1, 0)
        before = len(self.flight.heard)
        self.flight.send("MISSION_COUNT", 1, 1, len(items), 0)
        for _ in range(200):
            for _, message in self.flight.heard[before:]:
                before += 1
                if message.get_type() == "MISSION_REQUEST":
                    command, north, east, height = items[message.seq]
                    where = (*self.place(north, east), height)
                    self.flight.send(
                        "MISSION_ITEM", 1, 1, message.seq, 3, command, 0, 1, 0, 0, 0, 0, *where, 0
                    )
                    break
                if (
                    message.get_type() == "MISSION_ACK"
                    and message.type == 0
                    and self.flight.vehicle.autopilot.plans.mission.items
                ):
                    return
            else:
                self.flight.run(0.02)
        raise AssertionError("not uploaded")


GOTO_1 = {
    3: (-8.4, 2.8, 13.2),
    6: (-33.3, 11.0, 16.8),
    9: (-53.9, 17.8, 19.7),
    12: (-61.1, 20.2, 19.9),
}
GOTO_1 |= {30: (-60.3, 20.0, 20.0)}
GOTO_2 = {
    3: (-51.2, 15.4, 20.0),
    6: (-26.6, 3.2, 20.0),
    9: (0.5, -10.3, 20.0),
    12: (25.3, -22.7, 20.0),
}
GOTO_2 |= {30: (40.1, -30.1, 20.0)}
HOMEWARDS = {
    4.3: (35.7, -26.8, 19.9),
    8.3: (13.1, -9.8, 19.9),
    16.4: (-0.1, 0.1, 19.9),
    24.4: (0.0, 0.0, 12.1),
}
HOMEWARDS |= {36.4: (0.0, 0.0, 5.1)}


def along(flight, measured, within_m):
    """Continue the flight; at each time the position is that of the real one."""
    begun_s = flight.now_s
    for at_s, place in measured.items():
        flight.run(round(begun_s + at_s - flight.now_s, 2))
        north, east, down = flight.position
        assert math.dist((north, east, -down), place) < within_m, (at_s, flight.position)


def test_simple_goto_flies_where_arducopter_flew(fly):
    """Catches a flight to a place that differs from the real ArduCopter's."""
    drone = Drone(fly)
    assert drone.arm_and_takeoff(10.0) == pytest.approx(8.9, abs=1.5)
    # Airspeed = 3, before the first goto: forgotten with it, on the real one too
    drone.speed(1, 3.0)
    drone.simple_goto(-60.0, 20.0, 20.0)
    along(drone.flight, GOTO_1, 5.0)
    drone.simple_goto(40.0, -30.0, 20.0)
    drone.speed(0, 10.0)
    along(drone.flight, GOTO_2, 5.0)
    drone.mode(6)
    begun_s = drone.flight.now_s
    along(drone.flight, HOMEWARDS, 6.0)
    drone.flight.until(lambda: not drone.flight.vehicle.armed, 60.0)
    assert drone.flight.now_s - begun_s == pytest.approx(49.0, abs=5.0)
    assert math.hypot(*drone.flight.position[:2]) < 0.5


MISSION = [
    (16, 0, 0, 0),
    (22, 0, 0, 10),
    (16, 50, -50, 11),
    (16, 50, 50, 12),
    (16, -50, 50, 13),
    (16, -50, -50, 14),
]
MISSION += [MISSION[-1]]
REACHED_S = {1: 0.8, 2: 13.3, 3: 26.4, 4: 39.1, 5: 53.9, 6: 53.9}


def test_mission_basic_reaches_each_place_when_arducopter_did_and_stays_in_auto(fly):
    """Catches a mission that is flown faster or slower than the real ArduCopter's."""
    drone = Drone(fly)
    drone.upload(MISSION)
    drone.arm_and_takeoff(10.0)
    drone.flight.send("MISSION_SET_CURRENT", 1, 1, 0)
    drone.mode(3)
    begun_s = drone.flight.now_s
    drone.flight.run(58.0)
    came = {m.seq: t - begun_s for t, m in drone.flight.all("MISSION_ITEM_REACHED", begun_s)}
    assert came == pytest.approx(REACHED_S, abs=3.5)
    assert drone.flight.mode == "AUTO", "a mission that ends in the air loiters in AUTO"
    assert drone.flight.position == pytest.approx((-50.0, -50.0, -14.0), abs=1.0)
    assert math.hypot(*drone.flight.velocity) < 0.3


def test_set_attitude_target_flies_forwards_and_back_as_its_example_does(fly):
    """Pitch -5 degrees, then +5, thrust one half: height is held, the speeds are small and opposite."""
    drone = Drone(fly)
    drone.arm_and_takeoff(2.5)
    drone.flight.run(3.0)
    for pitch, sign in ((-5.0, 1.0), (5.0, -1.0)):
        half = math.radians(pitch) / 2.0
        stream = (
            "SET_ATTITUDE_TARGET",
            0,
            1,
            1,
            4,
            (math.cos(half), 0.0, math.sin(half), 0.0),
            0,
            0,
            0,
            0.5,
        )
        drone.flight.run(3.0 if sign > 0 else 6.0, stream, every_s=0.1)
        assert sign * drone.flight.velocity[0] > 0.8
    assert drone.flight.height == pytest.approx(2.5, abs=0.3)
