"""Local frames, also at the date line."""

import math

import pytest

from sitl_mock.world import Home, LocalFrame, wrap_deg

FIJI = Home(-16.8, 179.9999, 0.0)


@pytest.mark.parametrize(("east_m", "lon_deg"), [(100.0, -179.99916), (-100.0, 179.99896)])
def test_longitudes_stay_within_180_degrees(east_m, lon_deg):
    frame = LocalFrame(FIJI)
    place = frame.to_geodetic(0.0, east_m, 0.0)
    assert place.lon_deg == pytest.approx(lon_deg, abs=1e-5)
    assert frame.to_local(*place)[1] == pytest.approx(east_m, abs=1e-6)


def test_a_place_beyond_the_date_line_is_near():
    north, east, down = LocalFrame(FIJI).to_local(-16.8, -179.9999, 0.0)
    assert (north, down) == (0.0, 0.0)
    assert east == pytest.approx(21.3, abs=0.1)


@pytest.mark.parametrize(
    ("angle", "wrapped"), [(180.0, -180.0), (-180.0, -180.0), (181.0, -179.0), (-541.0, 179.0)]
)
def test_angles_are_wrapped(angle, wrapped):
    assert wrap_deg(angle) == wrapped


@pytest.mark.parametrize("angle", [math.nan, math.inf])
def test_what_is_no_angle_is_nan(angle):
    assert math.isnan(wrap_deg(angle))


@pytest.mark.parametrize("flavour", ["px4", "arducopter"])
def test_a_vehicle_that_crosses_the_date_line_reports_valid_longitudes(fly, ned_velocity, flavour):
    flight = fly.airborne(flavour, home=FIJI, height=8.0)
    flight.command(511, 33, 20_000.0)
    stream = ned_velocity(0.0, 5.0, 0.0)
    if flavour == "px4":
        flight.offboard(stream)
    flight.run(6.0, stream)
    longitudes = [m.lon for _, m in flight.all("GLOBAL_POSITION_INT")]
    assert max(longitudes) > 1_799_990_000
    assert min(longitudes) < -1_799_990_000
    assert all(abs(longitude) <= 1_800_000_000 for longitude in longitudes)


def test_a_mission_item_beyond_the_date_line_is_flown_to(fly):
    flight = fly.airborne("arducopter", home=FIJI, height=10.0)
    flight.send(
        "MISSION_ITEM_INT", 1, 1, 0, 3, 16, 2, 0, 0, 0, 0, 0, -168000000, -1799999000, 10.0, 0
    )
    flight.run(8.0)
    assert flight.position[1] == pytest.approx(21.3, abs=1.0)
