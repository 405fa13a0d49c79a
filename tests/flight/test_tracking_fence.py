"""A fence given by degrees: about home, wherever the local frame has its zero, by the autopilot's own map."""

import math

import pytest

from guidance.control import Limits
from guidance.control.polygon import Polygon, corners_about_home
from guidance.flight import Flight, Inputs
from guidance.frames import Amsl, LocalFrame, Ned
from guidance.messages import Home, Origin
from tests.flight.scenes import BOTH, SETTINGS, heartbeat, local, settings_of

SQUARE_M = ((-30.0, -40.0), (-30.0, 40.0), (50.0, 40.0), (50.0, -40.0))


def on_the_map(frame, home_ned_m, corners_m=SQUARE_M):
    """The corners' degrees, for corners in metres about home."""
    north_m, east_m, _ = home_ned_m
    places = [
        frame.wgs84_from_ned(Ned((north + north_m, east + east_m, 0.0)))
        for north, east in corners_m
    ]
    return tuple((latitude, longitude) for latitude, longitude, _ in places)


@pytest.mark.parametrize("autopilot", BOTH)
@pytest.mark.parametrize("home_ned_m", [(0.0, 0.0, -2.0), (120.0, -300.0, 5.0)])
def test_corners_by_degrees_are_metres_about_home_whatever_the_frames_zero(autopilot, home_ned_m):
    frame = LocalFrame(
        47.397742, 8.545594, Amsl(488.0), Amsl(490.0), projection=autopilot.projection
    )
    latitude, longitude, altitude = frame.wgs84_from_ned(Ned(home_ned_m))
    home = Home(0.0, latitude, longitude, altitude.metres, Ned(home_ned_m))
    corners_deg = on_the_map(frame, home_ned_m)
    made = Polygon(corners_about_home(corners_deg, Ned(home_ned_m), frame)).corners_ne_m
    assert [place for corner in made for place in corner] == pytest.approx(
        [place for corner in SQUARE_M for place in corner], abs=1e-3
    )
    flight = Flight(
        settings_of(autopilot, limits=Limits.model_construct(fence_polygon_deg=corners_deg))
    )
    origin = Origin(50.0, frame.latitude_deg, frame.longitude_deg, 488.0)
    flight.step(50.0, Inputs([heartbeat(50.0, autopilot=autopilot), origin, home, local(50.0)]))
    envelope = flight.observed.cycle.envelope
    assert envelope.home_ned_m == home_ned_m
    assert envelope.fence_polygon.contains((49.0, 39.0))
    assert not envelope.fence_polygon.contains((51.0, 0.0))


def test_until_a_flight_is_accepted_a_new_home_shifts_heights_and_never_corners_on_the_map():
    frame = LocalFrame(47.397742, 8.545594, Amsl(488.0), projection=SETTINGS.autopilot.projection)
    flight = Flight(
        settings_of(
            limits=Limits.model_construct(fence_polygon_deg=on_the_map(frame, (0.0, 0.0, 0.0)))
        )
    )
    origin = Origin(50.0, 47.397742, 8.545594, 488.0)
    homes = [(0.0, 0.0, 0.0), (10.0, 20.0, -3.0)]
    for n, home_ned_m in enumerate(homes):
        latitude, longitude, altitude = frame.wgs84_from_ned(Ned(home_ned_m))
        home = Home(50.0 + n, latitude, longitude, altitude.metres, Ned(home_ned_m))
        flight.step(
            50.0 + n, Inputs([heartbeat(50.0 + n, armed=False), origin, home, local(50.0 + n)])
        )
    envelope = flight.observed.cycle.envelope
    (north_m, east_m, _) = homes[1]
    assert envelope.home_ned_m == homes[1]
    first = envelope.fence_polygon.corners_ne_m[0]
    assert first == pytest.approx((SQUARE_M[0][0] - north_m, SQUARE_M[0][1] - east_m), abs=1e-3)


def test_an_origin_that_comes_after_home_moves_the_fence_into_its_frame():
    told = LocalFrame(47.4, 8.55, Amsl(488.0), projection=SETTINGS.autopilot.projection)
    home_ned_m = told.ned_from_wgs84(47.397742, 8.545594, Amsl(488.0))
    flight = Flight(
        settings_of(limits=Limits.model_construct(fence_polygon_deg=on_the_map(told, home_ned_m)))
    )
    home = Home(50.0, 47.397742, 8.545594, 488.0, home_ned_m)
    flight.step(50.0, Inputs([heartbeat(50.0), home, local(50.0)]))
    before = flight.observed.cycle.envelope.fence_polygon
    flight.step(50.02, Inputs([Origin(50.02, 47.4, 8.55, 488.0)]))
    after = flight.observed.cycle.envelope.fence_polygon
    assert before != after  # reckoned from home first, which is right to millimetres only
    for polygon in (before, after):
        for corner, meant in zip(polygon.corners_ne_m, SQUARE_M, strict=True):
            assert math.dist(corner, meant) < 0.05


def test_without_corners_on_the_map_the_fence_stays_as_it_was_configured():
    flight = Flight(SETTINGS)
    home = Home(50.0, 47.397742, 8.545594, 488.0, Ned((1.0, 2.0, 3.0)))
    flight.step(50.0, Inputs([heartbeat(50.0), home, local(50.0)]))
    assert flight.observed.cycle.envelope.fence_polygon is SETTINGS.cycle.envelope.fence_polygon
    assert flight.observed.cycle.envelope.home_ned_m == (1.0, 2.0, 3.0)
