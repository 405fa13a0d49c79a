"""Which numbers of a message are believed: each one at its bound and beyond it, on both sides."""

import math
from typing import Any

import pytest

from guidance.autopilots import ARDUCOPTER, PX4
from guidance.frames import Ned
from guidance.messages import (
    Aircraft,
    Attitude,
    EstimatorStatus,
    EvaderReport,
    FenceItem,
    GlobalPosition,
    Heartbeat,
    Home,
    LocalPosition,
    Origin,
    Parameter,
    PositionTarget,
    SystemStatus,
)
from guidance.vehicle import VehicleState, is_plausible, local_frame, observe

STILL = Ned((0.0, 0.0, 0.0))
HERE = (47.0, 8.0, 500.0)
NAN = math.nan
PLAIN: dict[type, Any] = {
    Aircraft: Aircraft(1.0, "ICAO 1", *HERE, STILL, 0.0, 1.0),
    Attitude: Attitude(1.0, 1.0, 0.0),
    EstimatorStatus: EstimatorStatus(1.0, 0.1),
    EvaderReport: EvaderReport(1.0, 1.0, "test", *HERE, STILL, 1.0, 1.0),
    FenceItem: FenceItem(1.0, 0, 5001, 3.0, 47.0, 8.0),
    GlobalPosition: GlobalPosition(1.0, 1.0, *HERE, 10.0, STILL),
    Home: Home(1.0, *HERE, STILL),
    LocalPosition: LocalPosition(1.0, 1.0, STILL, STILL),
    Origin: Origin(1.0, *HERE),
    Parameter: Parameter(1.0, "GF_ACTION", 2.0),
    PositionTarget: PositionTarget(1.0, 1.0, 0, STILL),
    SystemStatus: SystemStatus(1.0, 0, 0, 0.5),
}
ON_EARTH = (Aircraft, EvaderReport, GlobalPosition, Home, Origin)
BOUNDS = [
    *((kind, "latitude_deg", 90.0, False) for kind in ON_EARTH),
    *((kind, "longitude_deg", 180.0, True) for kind in ON_EARTH),
    *((kind, "altitude_amsl_m", 1e5, True) for kind in ON_EARTH),
    (FenceItem, "latitude_deg", 90.0, False),
    (FenceItem, "size", 1e6, True),
    (GlobalPosition, "altitude_above_home_m", 1e5, True),
    (Attitude, "yaw_rad", 4.0 * math.pi, True),
]
VECTORS = [
    (Home, "position_ned_m", 1e6),
    (LocalPosition, "position_ned_m", 1e6),
    (LocalPosition, "velocity_ned_m_s", 1e3),
    (GlobalPosition, "velocity_ned_m_s", 1e3),
    (PositionTarget, "velocity_ned_m_s", 1e3),
    (Aircraft, "velocity_ned_m_s", 1e3),
]
UNKNOWN = {
    (Aircraft, "altitude_amsl_m"),
    (Aircraft, "velocity_ned_m_s"),
    (PositionTarget, "velocity_ned_m_s"),
}
"""Values that may be NaN, which means unknown."""


@pytest.mark.parametrize("kind", sorted(PLAIN, key=str))
def test_ordinary_numbers_are_believed(kind):
    assert is_plausible(PLAIN[kind])


@pytest.mark.parametrize(("kind", "name", "bound", "included"), BOUNDS)
def test_a_number_is_believed_up_to_its_bound(kind, name, bound, included):
    for sign in (1.0, -1.0):
        assert is_plausible(PLAIN[kind]._replace(**{name: sign * bound * (1.0 - 1e-9)}))
        assert is_plausible(PLAIN[kind]._replace(**{name: sign * bound})) is included
        assert not is_plausible(PLAIN[kind]._replace(**{name: sign * bound * (1.0 + 1e-9)}))
    unknown = PLAIN[kind]._replace(**{name: NAN})
    assert is_plausible(unknown) is ((kind, name) in UNKNOWN)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize(("kind", "name", "bound"), VECTORS)
def test_a_vector_is_believed_up_to_its_bound_on_each_axis(kind, name, bound, axis):
    def message(value):
        return PLAIN[kind]._replace(**{name: Ned([value if n == axis else 0.0 for n in range(3)])})

    for sign in (1.0, -1.0):
        assert is_plausible(message(sign * bound))
        assert not is_plausible(message(sign * bound * (1.0 + 1e-9)))
    assert is_plausible(message(NAN)) is ((kind, name) in UNKNOWN)


@pytest.mark.parametrize("kind", [LocalPosition, GlobalPosition])
def test_a_stamp_has_32_bits_of_milliseconds(kind):
    for stamp_s, believed in (
        (0.0, True),
        (-1e-3, False),
        (2.0**32 / 1e3, True),
        (2.0**32 / 1e3 + 1e-3, False),
    ):
        assert is_plausible(PLAIN[kind]._replace(time_boot_s=stamp_s)) is believed


def test_a_home_without_a_place_in_the_local_frame_is_believed_and_half_a_place_is_not():
    assert is_plausible(PLAIN[Home]._replace(position_ned_m=Ned((NAN, NAN, NAN))))
    assert not is_plausible(PLAIN[Home]._replace(position_ned_m=Ned((NAN, NAN, 0.0))))


@pytest.mark.parametrize(
    ("message", "believed"),
    [
        (SystemStatus(1.0, 0, 0, 0.0), True),
        (SystemStatus(1.0, 0, 0, 1.0), True),
        (SystemStatus(1.0, 0, 0, -0.01), False),
        (SystemStatus(1.0, 0, 0, 1.01), False),
        (SystemStatus(1.0, 0, 0, NAN), True),
        (EstimatorStatus(1.0, 0.0), True),
        (EstimatorStatus(1.0, -0.1), False),
        (EstimatorStatus(1.0, 1e5), True),
        (EstimatorStatus(1.0, 1.1e5), False),
        (EstimatorStatus(1.0, NAN), True),
        (Parameter(1.0, "GF_ACTION", NAN), False),
        (Parameter(1.0, "GF_ACTION", math.inf), False),
        (Heartbeat(1.0, 4, True, 4, 3), True),
    ],
)
def test_shares_deviations_and_parameters(message, believed):
    assert is_plausible(message) is believed


def test_an_aircrafts_speed_is_bounded_in_every_direction():
    fast = Ned((800.0, 600.0, 0.0))
    assert is_plausible(PLAIN[Aircraft]._replace(velocity_ned_m_s=fast))
    assert not is_plausible(PLAIN[Aircraft]._replace(velocity_ned_m_s=1.01 * fast))


@pytest.mark.parametrize("projection", [PX4.projection, ARDUCOPTER.projection])
def test_an_origin_a_thousand_kilometres_from_home_is_none_of_this_vehicle(projection):
    home = PLAIN[Home]
    for degrees, believed in ((8.9, True), (9.1, False)):  # 1,000 km are 8.99 degrees of latitude
        state = observe(VehicleState(), [home, Origin(1.0, 47.0 - degrees, 8.0, 500.0)])
        frame = local_frame(state, projection)
        assert (frame is not None) is believed
        assert frame is None or frame.projection is projection


def test_without_an_origin_the_frame_comes_from_home_if_that_says_where_it_is():
    unplaced = PLAIN[Home]._replace(position_ned_m=Ned((NAN, NAN, NAN)))
    assert local_frame(observe(VehicleState(), [unplaced]), PX4.projection) is None
    half = PLAIN[Home]._replace(position_ned_m=Ned((0.0, 0.0, math.inf)))
    assert local_frame(observe(VehicleState(), [half]), PX4.projection) is None
    assert local_frame(VehicleState(), PX4.projection) is None


def test_a_frame_whose_origin_would_be_a_pole_is_none():
    home = Home(1.0, -89.99, 8.0, 500.0, Ned((0.0, 0.0, 0.0)))
    for projection in (PX4.projection, ARDUCOPTER.projection):
        assert local_frame(observe(VehicleState(), [home]), projection) is not None
    beyond = home._replace(position_ned_m=Ned((5000.0, 0.0, 0.0)))
    assert local_frame(observe(VehicleState(), [beyond]), ARDUCOPTER.projection) is None
