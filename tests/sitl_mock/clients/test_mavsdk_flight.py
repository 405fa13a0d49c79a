"""Whole flights by the real MAVSDK, synchronous: both flavours, over UDP and over raw:// on Zenoh."""

import math
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from mavsdk.plugins.info import Info
from mavsdk.plugins.offboard import PositionNedYaw, VelocityBodyYawspeed, VelocityNedYaw
from mavsdk.plugins.telemetry import FlightMode, LandedState

pytestmark = pytest.mark.slow


SPEED = 3.0
"""Of the vehicles' time. No result depends on real time, and the timeouts of the setpoints are longer accordingly."""

NAMES = {"px4udp": "px4", "px4zenoh": "px4", "copterudp": "arducopter", "copterzenoh": "arducopter"}


@pytest.fixture(scope="module")
def flights(fleet_of, client_of):
    """All flights at once, each by a client of its own; a name to what becomes of it."""

    def flown(vehicle):
        with client_of(vehicle, "zenoh" if vehicle.name.endswith("zenoh") else "udp") as client:
            fly(client)

    with fleet_of(NAMES, speed=SPEED) as fleet, ThreadPoolExecutor(len(NAMES)) as pilots:
        yield {name: pilots.submit(flown, fleet[name]) for name in NAMES}


def speeds(client):
    velocity = client.telemetry.position_velocity_ned().velocity
    return velocity.north_m_s, velocity.east_m_s, velocity.down_m_s


def distance_m(client, goal):
    place = client.telemetry.position_velocity_ned().position
    here = (place.north_m, place.east_m, place.down_m)
    return math.dist(here, (goal.north_m, goal.east_m, goal.down_m))


def ask_for_streams(client):
    """ArduCopter sends streams only on request."""
    client.telemetry.set_rate_position_velocity_ned(30.0)
    client.telemetry.set_rate_position(20.0)
    client.telemetry.set_rate_health(5.0)
    client.telemetry.set_rate_in_air(5.0)
    client.telemetry.set_rate_landed_state(5.0)


def take_off(client):
    client.action.set_takeoff_altitude(4.0)
    client.action.arm()
    client.wait(client.telemetry.armed, 2.0)
    client.action.takeoff()
    client.wait(lambda: client.height_m > 3.6, 20.0, "no take-off")
    client.wait(client.telemetry.in_air, 2.0)


def fly_body_velocity(client):
    heading = math.radians(client.telemetry.heading().heading_deg)
    client.offboard.set_velocity_body(VelocityBodyYawspeed(3.0, 0.0, 0.0, 0.0))

    def forward():
        north, east, _ = speeds(client)
        return north * math.cos(heading) + east * math.sin(heading)

    client.wait(lambda: forward() > 2.0, 8.0, "no forward velocity")


def fly_ned(client):
    client.offboard.set_velocity_ned(VelocityNedYaw(2.0, -1.0, 0.0, 0.0))
    client.wait(
        lambda: speeds(client)[0] > 1.4 and speeds(client)[1] < -0.6, 8.0, "velocity not followed"
    )
    start = client.telemetry.position_velocity_ned().position
    goal = PositionNedYaw(start.north_m + 3.0, start.east_m + 2.0, start.down_m - 1.0, 0.0)
    client.offboard.set_position_ned(goal)
    client.wait(lambda: distance_m(client, goal) < 0.8, 15.0, "position not reached")


def fly(client):
    """Over UDP it ends by landing, over Zenoh by returning home."""
    flavour = client.vehicle.flavour
    telemetry = client.telemetry
    action = client.action
    offboard = client.offboard
    returns = client.vehicle.name.endswith("zenoh")
    ask_for_streams(client)
    client.ready()
    assert client.system.get_system_id() == client.vehicle.system_id
    assert Info(client.system).get_version().flight_sw_major == (1 if flavour == "px4" else 4)
    name = "COM_OF_LOSS_T" if flavour == "px4" else "GUID_TIMEOUT"
    client.param.set_param_float(name, 0.75 * SPEED)
    assert client.param.get_param_float(name) == 0.75 * SPEED
    take_off(client)
    if flavour == "px4":
        client.wait(
            lambda: telemetry.flight_mode() == FlightMode.HOLD, 5.0, "no hold after take-off"
        )

    offboard.set_velocity_ned(VelocityNedYaw(0.0, 0.0, 0.0, 0.0))
    time.sleep(0.3)  # PX4 takes OFFBOARD about 0.1 s after the first setpoint
    offboard.start()
    client.wait(lambda: telemetry.flight_mode() == FlightMode.OFFBOARD, 3.0, "no offboard")
    (fly_body_velocity if returns else fly_ned)(client)
    offboard.stop()
    client.wait(lambda: telemetry.flight_mode() == FlightMode.HOLD, 3.0, "no hold after offboard")
    client.wait(lambda: math.hypot(*speeds(client)) < 0.5, 6.0, "not stopped")

    (action.return_to_launch if returns else action.land)()
    expected = FlightMode.RETURN_TO_LAUNCH if returns else FlightMode.LAND
    client.wait(lambda: telemetry.flight_mode() == expected, 3.0, f"no {expected}")
    client.wait(lambda: not telemetry.armed(), 40.0, "not disarmed by landing")
    assert telemetry.landed_state() == LandedState.ON_GROUND
    place = telemetry.position_velocity_ned().position
    away_m = math.hypot(place.north_m, place.east_m)
    assert (away_m < 2.0) == returns


@pytest.mark.parametrize("name", NAMES)
def test_a_flight_goes_from_connecting_to_standing_on_the_ground(flights, name):
    flights[name].result(timeout=90.0)
