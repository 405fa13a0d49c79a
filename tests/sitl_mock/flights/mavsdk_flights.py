"""Whole flights as MAVSDK's examples fly them, by its public API; the same for a real PX4 and for the mock.

Each function flies a connected vehicle that stands disarmed and is ready to arm. Its client waits for nothing but
time and landing, so that what a vehicle does with the same orders at the same times can be compared.
"""

import math
import time

from mavsdk.plugins.action import Action, OrbitYawBehavior
from mavsdk.plugins.follow_me import Config, FollowMe, TargetLocation
from mavsdk.plugins.geofence import FenceType, Geofence, GeofenceData, Point, Polygon
from mavsdk.plugins.manual_control import ManualControl
from mavsdk.plugins.mission import Mission, MissionItem, MissionPlan
from mavsdk.plugins.mission_raw import MissionItem as RawItem
from mavsdk.plugins.mission_raw import MissionRaw
from mavsdk.plugins.offboard import (
    AccelerationNed,
    Attitude,
    Offboard,
    PositionGlobalYaw,
    PositionNedYaw,
    VelocityBodyYawspeed,
    VelocityNedYaw,
)
from mavsdk.plugins.telemetry import Telemetry

M_PER_DEG = 111_195.0
NAN = math.nan


class Pilot:
    """The plugins that most flights use, and places about where the vehicle stood."""

    def __init__(self, system):
        self.system = system
        self.telemetry = Telemetry(system)
        self.action = Action(system)
        self.offboard = Offboard(system)
        self.home = None

    def wait_until(self, condition, within_s):
        """Wait in real time."""
        end_s = time.monotonic() + within_s
        while not condition():
            assert time.monotonic() < end_s, f"not within {within_s} s"
            time.sleep(0.05)

    def ready(self):
        """Wait until it can be armed, and note where it stands."""
        self.wait_until(
            lambda: self.telemetry.health_all_ok() and self.telemetry.health().is_armable, 60.0
        )
        self.home = self.telemetry.position()
        return self

    def place(self, north_m, east_m):
        """Latitude and longitude of a place."""
        lat = self.home.latitude_deg + north_m / M_PER_DEG
        return lat, self.home.longitude_deg + east_m / M_PER_DEG / math.cos(
            math.radians(self.home.latitude_deg)
        )

    def amsl(self, height_m):
        """Altitude above sea level of a height above where it stood."""
        return self.home.absolute_altitude_m + height_m

    def take_off(self, height_m=10.0, for_s=14.0):
        """Arm, take off, and wait for as long as that takes."""
        self.action.set_takeoff_altitude(height_m)
        self.action.arm()
        self.action.takeoff()
        time.sleep(for_s)

    def land(self):
        """Land and wait until it is disarmed."""
        self.action.land()
        self.down(60.0)

    def down(self, within_s):
        """Wait until it is disarmed, and a little longer."""
        self.wait_until(lambda: not self.telemetry.armed(), within_s)
        time.sleep(4.0)

    def stream(self, *setpoints):
        """Fly setpoints in OFFBOARD, each for its seconds, as the examples do: the first one, start, the others."""
        setpoints[0][0]()
        self.offboard.start()
        for put, for_s in setpoints:
            put()
            time.sleep(for_s)


def takeoff_and_land(pilot):
    pilot.action.arm()
    pilot.action.takeoff()
    time.sleep(10.0)
    pilot.land()


def goto(pilot):
    pilot.action.arm()
    pilot.action.takeoff()
    time.sleep(1.0)
    pilot.action.goto_location(*pilot.place(25.0, 15.0), pilot.amsl(20.0), 0.0)
    time.sleep(24.0)


def offboard_position_ned(pilot):
    def to(*values):
        return lambda: pilot.offboard.set_position_ned(PositionNedYaw(*values))

    pilot.action.arm()
    pilot.stream(
        (to(0.0, 0.0, 0.0, 0.0), 0.5),
        (to(0.0, 0.0, -5.0, 0.0), 8.0),
        (to(5.0, 0.0, -5.0, 90.0), 8.0),
        (to(5.0, 10.0, -8.0, 90.0), 10.0),
        (to(0.0, 10.0, -3.0, 180.0), 8.0),
    )
    pilot.offboard.stop()
    time.sleep(2.0)


def offboard_position_global(pilot):
    def to(north, east, height, yaw, kind):
        where = PositionGlobalYaw(*pilot.place(north, east), height, yaw, kind)
        return lambda: pilot.offboard.set_position_global(where)

    relative = PositionGlobalYaw.AltitudeType.REL_HOME
    amsl = PositionGlobalYaw.AltitudeType.AMSL
    pilot.take_off()
    pilot.stream(
        (to(0.0, 0.0, 10.0, 0.0, relative), 2.0),
        (to(15.0, 0.0, 10.0, 0.0, relative), 10.0),
        (to(15.0, -10.0, pilot.amsl(14.0), 270.0, amsl), 12.0),
    )


def offboard_velocity_ned(pilot):
    def at(*values):
        return lambda: pilot.offboard.set_velocity_ned(VelocityNedYaw(*values))

    pilot.action.arm()
    pilot.stream(
        (at(0.0, 0.0, 0.0, 0.0), 0.5),
        (at(0.0, 0.0, -2.0, 0.0), 4.0),
        (at(-2.0, 0.0, -1.0, 0.0), 4.0),
        (at(2.0, 0.0, -1.0, 90.0), 4.0),
        (at(0.0, -2.0, 0.0, 90.0), 4.0),
        (at(0.0, 2.0, 0.0, 180.0), 4.0),
        (at(0.0, 0.0, 1.0, 270.0), 5.0),
    )
    pilot.offboard.stop()
    time.sleep(2.0)


def offboard_velocity_body(pilot):
    def at(*values):
        return lambda: pilot.offboard.set_velocity_body(VelocityBodyYawspeed(*values))

    pilot.take_off(5.0, 9.0)
    pilot.stream(
        (at(0.0, 0.0, 0.0, 0.0), 0.5),
        (at(0.0, 0.0, -1.0, 60.0), 5.0),
        (at(0.0, 0.0, 0.0, -60.0), 5.0),
        (at(0.0, 0.0, 0.0, 0.0), 2.0),
        (at(5.0, 0.0, 0.0, 30.0), 12.0),
        (at(0.0, 0.0, 0.0, 0.0), 5.0),
        (at(0.0, -5.0, 0.0, 30.0), 8.0),
    )
    pilot.offboard.stop()
    time.sleep(3.0)


def offboard_attitude(pilot):
    def lean(*values):
        return lambda: pilot.offboard.set_attitude(Attitude(*values))

    pilot.action.arm()
    pilot.stream(
        (lean(0.0, 0.0, 0.0, 0.0), 0.5),
        (lean(0.0, 0.0, 0.0, 0.65), 3.0),
        (lean(15.0, 0.0, 0.0, 0.6), 2.0),
        (lean(-15.0, 0.0, 0.0, 0.6), 2.0),
        (lean(0.0, 0.0, 0.0, 0.6), 2.0),
    )
    pilot.offboard.stop()
    time.sleep(6.0)


def offboard_acceleration(pilot):
    def push(*values):
        return lambda: pilot.offboard.set_acceleration_ned(AccelerationNed(*values))

    pilot.take_off(5.0, 13.0)
    pilot.stream(
        (push(0.0, 0.0, 0.0), 1.0),
        (push(1.0, 0.0, 0.0), 3.0),
        (push(-1.0, 0.5, 0.0), 4.0),
        (push(0.0, -0.5, -0.3), 3.0),
    )
    pilot.offboard.stop()
    time.sleep(4.0)


CORNERS = ((30.0, 0.0, 10.0), (30.0, 20.0, 15.0), (0.0, 20.0, 10.0))


def mission(pilot):
    plans = Mission(pilot.system)
    items = [
        MissionItem(
            latitude_deg=pilot.place(north, east)[0],
            longitude_deg=pilot.place(north, east)[1],
            relative_altitude_m=height,
            speed_m_s=5.0,
            is_fly_through=True,
        )
        for north, east, height in CORNERS
    ]
    plans.set_return_to_launch_after_mission(True)
    plans.upload_mission(MissionPlan(items))
    pilot.action.arm()
    plans.start_mission()
    time.sleep(40.0)
    pilot.down(90.0)


def mission_raw(pilot):
    def item(seq, command, north, east, height, current=0):
        lat, lon = (round(value * 1e7) for value in pilot.place(north, east))
        return RawItem(seq, 6, command, current, 1, 0.0, 0.0, 0.0, NAN, lat, lon, height, 0)

    plans = MissionRaw(pilot.system)
    plans.upload_mission(
        [
            item(0, 22, 0.0, 0.0, 10.0, current=1),
            *(item(1 + n, 16, *corner) for n, corner in enumerate(CORNERS)),
            item(4, 21, 0.0, 20.0, 0.0),
        ]
    )
    assert len(plans.download_mission()) == 5
    pilot.action.arm()
    plans.start_mission()
    time.sleep(30.0)
    pilot.down(90.0)


def geofence(pilot):
    """Fly at 5 m/s into a fence 20 m ahead; the autopilot reacts."""
    corners = [
        Point(*pilot.place(n, e))
        for n, e in ((20.0, 20.0), (20.0, -20.0), (-20.0, -20.0), (-20.0, 20.0))
    ]
    Geofence(pilot.system).upload_geofence(
        GeofenceData(polygons=[Polygon(corners, FenceType.INCLUSION)])
    )
    pilot.take_off(5.0, 9.0)
    pilot.stream(
        (lambda: pilot.offboard.set_velocity_ned(VelocityNedYaw(5.0, 0.0, 0.0, 0.0)), 14.0)
    )


def follow_me(pilot):
    follower = FollowMe(pilot.system)
    pilot.take_off(8.0, 12.0)
    follower.set_config(Config(8.0, 8.0, 0.1, Config.FollowAltitudeMode.CONSTANT, 5.0, 180.0))
    follower.start()
    pilot.wait_until(follower.is_active, 3.0)  # targets are taken once HEARTBEAT tells of the mode
    for second in range(30):
        lat, lon = pilot.place(2.0 * second, 5.0)
        follower.set_target_location(TargetLocation(lat, lon, pilot.amsl(0.0), 2.0, 0.0, 0.0))
        time.sleep(1.0)
    follower.stop()
    time.sleep(4.0)


def do_orbit(pilot):
    pilot.take_off(8.0, 12.0)
    facing = OrbitYawBehavior.HOLD_FRONT_TO_CIRCLE_CENTER
    pilot.action.do_orbit(10.0, 2.0, facing, *pilot.place(15.0, 0.0), pilot.amsl(8.0))
    time.sleep(45.0)


def manual_control(pilot):
    sticks = ManualControl(pilot.system)

    def hold(for_s, x, y, z, r):
        for _ in range(round(for_s * 10.0)):
            sticks.set_manual_control_input(x, y, z, r)
            time.sleep(0.1)

    hold(1.0, 0.0, 0.0, 0.5, 0.0)
    pilot.action.arm()
    hold(0.2, 0.0, 0.0, 0.5, 0.0)
    sticks.start_position_control()
    hold(1.0, 0.0, 0.0, 0.5, 0.0)
    hold(5.0, 0.0, 0.0, 1.0, 0.0)
    hold(3.0, 0.0, 0.0, 0.5, 0.0)
    hold(4.0, 0.6, 0.0, 0.5, 0.0)
    hold(4.0, 0.0, 0.0, 0.5, 0.0)
    hold(2.0, 0.0, 0.0, 0.5, 0.7)
    hold(3.0, 0.0, -0.6, 0.5, 0.0)
    hold(4.0, 0.0, 0.0, 0.5, 0.0)
    hold(4.0, 0.0, 0.0, 0.2, 0.0)
    hold(3.0, 0.0, 0.0, 0.5, 0.0)


FLIGHTS = {
    each.__name__: each
    for each in (
        takeoff_and_land,
        goto,
        offboard_position_ned,
        offboard_position_global,
        offboard_velocity_ned,
        offboard_velocity_body,
        offboard_attitude,
        offboard_acceleration,
        mission,
        mission_raw,
        geofence,
        follow_me,
        do_orbit,
        manual_control,
    )
}
