"""Missions, geofences and message intervals by the real MAVSDK's asyncio client, over UDP and over raw:// on Zenoh."""

import asyncio
import contextlib
import math
import time

import pytest
from mavsdk import ComponentType
from mavsdk.asyncio import Configuration, Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.geofence import (
    Circle,
    FenceType,
    GeofenceAsync,
    GeofenceData,
    Point,
    Polygon,
)
from mavsdk.asyncio.plugins.info import InfoAsync
from mavsdk.asyncio.plugins.mission import MissionAsync, MissionItem, MissionPlan
from mavsdk.asyncio.plugins.offboard import (
    OffboardAsync,
    OffboardError,
    PositionNedYaw,
    VelocityNedYaw,
)
from mavsdk.asyncio.plugins.param import ParamAsync, ParamError
from mavsdk.asyncio.plugins.telemetry import FlightMode, TelemetryAsync

pytestmark = pytest.mark.slow
SPEED = 4.0
"""Of the vehicles' time; the setpoints' timeout is longer accordingly."""

M_PER_DEG = 111_319.49
ITEMS = 25


@pytest.fixture(scope="module")
def fleet(fleet_of):
    vehicles = {"planner": "px4", "flyer": "px4", "copter": "arducopter"}
    with fleet_of(vehicles, speed=SPEED) as started:
        yield started


@contextlib.asynccontextmanager
async def over_udp(vehicle):
    """The asyncio client of a vehicle."""
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.COMPANION_COMPUTER))
    try:
        await mavsdk.add_any_connection(vehicle.udp)
        system = await mavsdk.first_autopilot(10.0)
        assert system is not None
        yield system
    finally:
        mavsdk.destroy()


@contextlib.asynccontextmanager
async def over_zenoh(vehicle, bridge_of):
    """The asyncio client of a vehicle, its raw connection on Zenoh."""
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.COMPANION_COMPUTER))
    try:
        with bridge_of(mavsdk._mavsdk, vehicle):
            system = await mavsdk.first_autopilot(10.0)
            assert system is not None
            yield system
    finally:
        mavsdk.destroy()


async def first(stream, accepted, within_s, what):
    """The first value of a stream that is accepted."""
    async with asyncio.timeout(within_s):
        async for value in stream:
            if accepted(value):
                return value
    raise AssertionError(what)


async def ready(telemetry):
    """Wait until the vehicle can be armed."""
    await first(
        telemetry.subscribe_health(), lambda health: health.is_armable, 15.0, "never armable"
    )
    await first(telemetry.subscribe_health_all_ok(), bool, 15.0, "never healthy")


def spiral(home):
    """Waypoints 1.2 m to 1.8 m apart on a growing circle, flown through."""
    items = []
    for index in range(ITEMS):
        angle = 0.6 * index
        radius_m = 2.0 + 0.04 * index
        items.append(
            MissionItem(
                latitude_deg=home.latitude_deg + radius_m * math.cos(angle) / M_PER_DEG,
                longitude_deg=home.longitude_deg
                + radius_m
                * math.sin(angle)
                / M_PER_DEG
                / math.cos(math.radians(home.latitude_deg)),
                relative_altitude_m=4.0 + 0.02 * index,
                speed_m_s=8.0,
                is_fly_through=True,
                acceptance_radius_m=1.0,
                gimbal_pitch_deg=math.nan,
                gimbal_yaw_deg=math.nan,
                camera_action=0,
                loiter_time_s=math.nan,
                camera_photo_interval_s=math.nan,
                yaw_deg=math.nan,
                camera_photo_distance_m=math.nan,
                vehicle_action=0,
            )
        )
    return MissionPlan(items)


async def test_a_mission_of_25_items_is_uploaded_read_back_and_flown(fleet):
    async with over_udp(fleet["planner"]) as system:
        telemetry = TelemetryAsync(system)
        action = ActionAsync(system)
        mission = MissionAsync(system)
        await ready(telemetry)
        home = await telemetry.home()
        plan = spiral(home)
        await mission.upload_mission(plan)
        back = await mission.download_mission()
        assert len(back.mission_items) == ITEMS
        for sent, came in zip(plan.mission_items, back.mission_items, strict=True):
            assert came.latitude_deg == pytest.approx(sent.latitude_deg, abs=1e-7)
            assert came.relative_altitude_m == pytest.approx(sent.relative_altitude_m)

        await action.arm()
        await mission.start_mission()
        await first(
            mission.subscribe_mission_progress(),
            lambda done: done.current == done.total == ITEMS,
            60.0,
            "not flown",
        )
        assert await mission.is_mission_finished()
        await action.kill()
        await first(telemetry.subscribe_armed(), lambda armed: not armed, 5.0, "still armed")
        await mission.clear_mission()
        assert (await mission.download_mission()).mission_items == []


async def test_the_asyncio_client_flies_offboard_over_zenoh(fleet, bridge_of):
    async with over_zenoh(fleet["flyer"], bridge_of) as system:
        telemetry = TelemetryAsync(system)
        action = ActionAsync(system)
        offboard = OffboardAsync(system)
        await ready(telemetry)
        assert (await InfoAsync(system).get_version()).flight_sw_major == 1
        with pytest.raises(OffboardError, match="NO_SETPOINT_SET"):
            await offboard.start()
        with pytest.raises(ParamError, match="WRONG_TYPE"):
            await ParamAsync(system).get_param_int("COM_OF_LOSS_T")
        await ParamAsync(system).set_param_float("COM_OF_LOSS_T", SPEED)
        await action.arm()
        await action.takeoff()
        await first(
            telemetry.subscribe_flight_mode(), lambda mode: mode == FlightMode.HOLD, 20.0, "no hold"
        )
        await first(
            telemetry.subscribe_position(),
            lambda p: p.relative_altitude_m > 3.5,
            20.0,
            "no take-off",
        )
        await offboard.set_velocity_ned(VelocityNedYaw(0.0, 2.0, 0.0, 90.0))
        await asyncio.sleep(0.3)
        await offboard.start()
        await first(
            telemetry.subscribe_position_velocity_ned(),
            lambda pv: pv.velocity.east_m_s > 1.4,
            6.0,
            "too slow",
        )
        await offboard.set_position_ned(PositionNedYaw(0.0, 0.0, -4.0, 0.0))
        await first(
            telemetry.subscribe_position_velocity_ned(),
            lambda pv: math.hypot(pv.position.north_m, pv.position.east_m) < 0.7,
            12.0,
            "not back",
        )
        await action.hold()
        await first(
            telemetry.subscribe_flight_mode(), lambda mode: mode == FlightMode.HOLD, 3.0, "no hold"
        )
        await offboard.stop()
        await action.land()
        await first(telemetry.subscribe_armed(), lambda armed: not armed, 20.0, "not landed")


@pytest.mark.parametrize("name", ["planner", "copter"])
async def test_a_geofence_is_uploaded_and_read_back(fleet, name):
    async with over_udp(fleet[name]) as system:
        geofence = GeofenceAsync(system)
        corners = [
            Point(47.398, 8.545),
            Point(47.398, 8.547),
            Point(47.397, 8.547),
            Point(47.397, 8.545),
        ]
        fences = GeofenceData(
            [Polygon(corners, FenceType.INCLUSION)], [Circle(corners[0], 5.0, FenceType.EXCLUSION)]
        )
        await geofence.upload_geofence(fences)
        back = await geofence.download_geofence()
        assert [len(polygon.points) for polygon in back.polygons] == [4]
        assert back.polygons[0].points[2].longitude_deg == pytest.approx(8.547, abs=1e-7)
        assert (back.circles[0].radius, back.circles[0].fence_type) == (5.0, FenceType.EXCLUSION)
        await geofence.clear_geofence()


@pytest.mark.parametrize(("name", "rate_hz"), [("planner", 5.0), ("copter", 12.5)])
async def test_the_rate_asked_for_is_the_rate_that_comes(fleet, name, rate_hz):
    async with over_udp(fleet[name]) as system:
        telemetry = TelemetryAsync(system)
        await telemetry.set_rate_position_velocity_ned(rate_hz)
        times = []
        async with asyncio.timeout(5.0):
            async for _ in telemetry.subscribe_position_velocity_ned():
                times.append(time.monotonic())
                if times[-1] - times[0] > 1.5:
                    break
        own_s = SPEED * (times[-1] - times[0])
        assert (len(times) - 1) / own_s == pytest.approx(rate_hz, rel=0.1)
