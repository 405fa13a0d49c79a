"""Frames: every axis has its sign, every altitude its datum, and every way out has its way back."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymap3d.vincenty import vreckon

from guidance.autopilots import ARDUCOPTER, PX4
from guidance.errors import ConfigError
from guidance.frames import (
    WGS84,
    Amsl,
    Ellipsoid,
    GameFrame,
    LocalFrame,
    Ned,
    Relative,
    game_from_ned,
    ned_from_game,
    wrap_deg,
)

LATITUDES = st.floats(-80.0, 80.0)
LONGITUDES = st.floats(-180.0, 180.0)
METRES = st.floats(-5000.0, 5000.0)
PROJECTIONS = {"wgs84": WGS84, "px4": PX4.projection, "arducopter": ARDUCOPTER.projection}
ZURICH = LocalFrame(47.397742, 8.545594, Amsl(488.0), home=Amsl(490.0), undulation_m=47.5)


@settings(deadline=None)
@given(
    LATITUDES,
    LONGITUDES,
    METRES,
    METRES,
    st.floats(-100, 3000),
    st.sampled_from(list(PROJECTIONS.values())),
)
def test_the_way_to_wgs84_and_back_is_the_identity_within_a_millimetre(
    lat, lon, north, east, down, projection
):
    frame = LocalFrame(lat, lon, Amsl(400.0), projection=projection)
    latitude, longitude, altitude = frame.wgs84_from_ned(Ned((north, east, down)))
    assert altitude.metres == pytest.approx(400.0 - down)
    assert frame.ned_from_wgs84(latitude, longitude, altitude) == pytest.approx(
        (north, east, down), abs=1e-3
    )


@settings(deadline=None)
@given(LATITUDES, LONGITUDES, st.floats(-math.pi, math.pi), st.floats(1.0, 2000.0))
def test_wgs84_metres_are_the_geodesic_s_metres(lat, lon, bearing, distance):
    # An independent derivation: Vincenty's direct geodesic, against the tangent plane (error of order s³/R²).
    frame = LocalFrame(lat, lon, Amsl(0.0))
    latitude, longitude = vreckon(lat, lon, distance, math.degrees(bearing) % 360.0)
    north, east, down = frame.ned_from_wgs84(float(latitude), float(longitude), Amsl(0.0))
    assert (north, east) == pytest.approx(
        (distance * math.cos(bearing), distance * math.sin(bearing)), abs=2e-3
    )
    assert down == 0.0


@pytest.mark.parametrize("projection", PROJECTIONS.values(), ids=PROJECTIONS)
@pytest.mark.parametrize(
    ("step", "axis", "sign"),
    [((1e-3, 0.0, 0.0), 0, 1), ((0.0, 1e-3, 0.0), 1, 1), ((0.0, 0.0, 10.0), 2, -1)],
)
def test_north_east_and_down_have_their_signs(projection, step, axis, sign):
    frame = LocalFrame(47.0, 8.0, Amsl(400.0), projection=projection)
    ned = frame.ned_from_wgs84(47.0 + step[0], 8.0 + step[1], Amsl(400.0 + step[2]))
    assert ned[axis] * sign > 5.0
    assert all(abs(value) < 1e-3 for index, value in enumerate(ned) if index != axis)


@pytest.mark.parametrize(
    ("projection", "radius_m"), [(PX4.projection, 6371000.0), (ARDUCOPTER.projection, 6378100.0)]
)
def test_the_autopilots_maps_are_spheres_of_their_own_radius(projection, radius_m):
    frame = LocalFrame(47.0, 8.0, Amsl(400.0), projection=projection)
    north, _, _ = frame.ned_from_wgs84(47.001, 8.0, Amsl(400.0))
    _, east, _ = frame.ned_from_wgs84(47.0, 8.001, Amsl(400.0))
    assert north == pytest.approx(radius_m * math.radians(0.001), rel=1e-7)
    assert east == pytest.approx(
        radius_m * math.cos(math.radians(47.0)) * math.radians(0.001), rel=1e-7
    )


@pytest.mark.parametrize("projection", PROJECTIONS.values(), ids=PROJECTIONS)
def test_the_date_line_is_no_wall(projection):
    frame = LocalFrame(-17.0, 179.9999, Amsl(0.0), projection=projection)
    north, east, _ = frame.ned_from_wgs84(-17.0, -179.9999, Amsl(0.0))
    assert (north, east) == pytest.approx((0.0, 21.3), abs=0.1)
    assert -180.0 <= frame.wgs84_from_ned(Ned((0.0, 100.0, 0.0)))[1] <= 180.0


def test_the_origin_is_its_own_image():
    for projection in PROJECTIONS.values():
        frame = LocalFrame(47.0, 8.0, Amsl(400.0), projection=projection)
        assert frame.ned_from_wgs84(47.0, 8.0, Amsl(400.0)) == pytest.approx(
            (0.0, 0.0, 0.0), abs=1e-6
        )
        assert frame.wgs84_from_ned(Ned((0.0, 0.0, 0.0))) == (
            pytest.approx(47.0),
            pytest.approx(8.0),
            Amsl(400.0),
        )


def test_altitudes_of_different_datum_are_never_equal():
    assert Amsl(50.0) != Relative(50.0)
    assert Amsl(50.0) != Ellipsoid(50.0)
    assert len({Amsl(50.0), Relative(50.0), Ellipsoid(50.0)}) == 3


def test_one_height_said_in_three_datums_is_one_place():
    height = {
        ZURICH.ned_from_wgs84(47.397742, 8.545594, altitude)[2]
        for altitude in (Amsl(510.0), Relative(20.0), Ellipsoid(557.5))
    }
    assert height == {-22.0}


@pytest.mark.parametrize(
    ("altitude", "word"), [(Relative(20.0), "HOME_POSITION"), (Ellipsoid(20.0), "undulation_m")]
)
def test_a_datum_that_cannot_be_converted_is_refused_by_name(altitude, word):
    with pytest.raises(ConfigError, match=word):
        LocalFrame(47.0, 8.0, Amsl(400.0)).amsl(altitude)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ((90.0, 8.0, Amsl(0.0)), "latitude_deg"),
        ((math.nan, 8.0, Amsl(0.0)), "latitude_deg"),
        ((47.0, 181.0, Amsl(0.0)), "longitude_deg"),
        ((47.0, math.nan, Amsl(0.0)), "longitude_deg"),
        ((47.0, 8.0, Amsl(math.inf)), "altitude"),
        ((47.0, 8.0, Relative(0.0)), "altitude"),
        ((47.0, 8.0, Amsl(0.0), Ellipsoid(3.0)), "home"),
    ],
)
def test_an_origin_that_is_no_place_is_refused_by_name(arguments, word):
    with pytest.raises(ConfigError, match=word):
        LocalFrame(*arguments)


def test_the_game_s_axes_are_east_north_up_above_the_plane():
    game = GameFrame(Ned((100.0, 200.0, -5.0)))  # the evader's plane is 5 m above the origin
    assert game.position_from_ned(Ned((103.0, 207.0, -20.0))) == (7.0, 3.0, 15.0)
    assert game_from_ned(Ned((1.0, 2.0, 3.0))) == (2.0, 1.0, -3.0)


@settings(deadline=None)
@given(st.tuples(METRES, METRES, METRES), st.tuples(METRES, METRES, METRES))
def test_the_way_to_the_game_and_back_is_the_identity(position, origin):
    game = GameFrame(Ned(origin))
    assert game.position_to_ned(game.position_from_ned(Ned(position))) == pytest.approx(
        position, abs=1e-9
    )
    assert ned_from_game(game_from_ned(Ned(position))) == position


@settings(deadline=None)
@given(st.tuples(METRES, METRES, METRES), st.tuples(METRES, METRES, METRES))
def test_distances_survive_the_turn_into_the_game(one, other):
    game = GameFrame(Ned((10.0, -20.0, 3.0)))
    turned = math.dist(game.position_from_ned(Ned(one)), game.position_from_ned(Ned(other)))
    assert turned == pytest.approx(math.dist(one, other), abs=1e-6)


@settings(deadline=None)
@given(st.floats(-1e3, 1e3))
def test_a_wrapped_angle_is_the_same_direction_within_half_a_turn(angle):
    wrapped = math.radians(wrap_deg(math.degrees(angle)))
    assert abs(wrapped) <= math.pi
    assert (math.cos(wrapped), math.sin(wrapped)) == pytest.approx(
        (math.cos(angle), math.sin(angle)), abs=1e-9
    )
