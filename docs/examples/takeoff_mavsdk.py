"""A plain MAVSDK script: arm, take off, fly north, land. `test_takeoff_mavsdk.py` tests it.

sitl-mock run --vehicles px4:uav1 --udp 14540 &
python docs/examples/takeoff_mavsdk.py udpin://127.0.0.1:14540
"""

import sys
import time
from collections.abc import Callable

from mavsdk import ComponentType, Configuration, Mavsdk, System
from mavsdk.plugins.action import Action
from mavsdk.plugins.offboard import Offboard, VelocityNedYaw
from mavsdk.plugins.telemetry import Telemetry


def wait(condition: Callable[[], bool], within_s: float, what: str) -> None:
    """Wait in real time."""
    end_s = time.monotonic() + within_s
    while not condition():
        if time.monotonic() > end_s:
            raise TimeoutError(f"{what}: not within {within_s:g} s")
        time.sleep(0.05)


def main(url: str, *, height_m: float = 5.0, north_s: float = 2.0) -> float:
    """Fly; return the distance flown north, m."""
    with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as mavsdk:
        mavsdk.add_any_connection(url)
        return fly(mavsdk.first_autopilot(20.0), height_m, north_s)


def fly(system: System, height_m: float, north_s: float) -> float:
    """Fly a connected vehicle; return the distance flown north, m."""
    telemetry, action, offboard = Telemetry(system), Action(system), Offboard(system)
    wait(telemetry.health_all_ok, 60.0, "ready to arm")
    action.set_takeoff_altitude(height_m)
    action.arm()
    action.takeoff()
    wait(lambda: telemetry.position().relative_altitude_m > 0.9 * height_m, 30.0, "height")
    begun_m = telemetry.position_velocity_ned().position.north_m
    offboard.set_velocity_ned(VelocityNedYaw(2.0, 0.0, 0.0, 0.0))
    offboard.start()
    time.sleep(north_s)
    offboard.stop()
    north_m = float(telemetry.position_velocity_ned().position.north_m - begun_m)
    action.land()
    wait(lambda: not telemetry.armed(), 60.0, "landing")
    return north_m


if __name__ == "__main__":
    print(f"{main(sys.argv[1]):.1f} m north")
