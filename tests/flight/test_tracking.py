"""Where the evader is, in whichever frame the vehicle has now, and where the game is played in it."""

import math
from dataclasses import replace

import pytest

from guidance.autopilots import PX4
from guidance.flight.tracking import Tracking
from guidance.frames import Amsl
from guidance.messages import EvaderReport, Home, Origin
from guidance.vehicle import VehicleState, observe
from tests.flight.scenes import HOME_DOWN_M, SETTINGS, home

HERE = (47.397742, 8.545594)
NAN = math.nan


def vehicle_at_home(resets=0):
    return observe(VehicleState(), [home(0.0), Origin(0.0, *HERE, 488.0)])._replace(resets=resets)


def report(at_s, *, north_deg=0.0, velocity=(0.0, 0.0, 0.0), velocity_sd=0.1):
    return EvaderReport(at_s, at_s, "test", HERE[0] + north_deg, HERE[1], 488.0, velocity, 0.1, velocity_sd)


def test_nothing_is_known_of_an_evader_before_the_vehicles_frame_is():
    tracking = Tracking(SETTINGS.cycle, PX4)
    tracking.observe(VehicleState(), [report(1.0)])
    assert (tracking.local_frame, tracking.game_frame, tracking.evader(1.0)) == (None, None, None)
    assert tracking.silence_s(1.0) == math.inf
    tracking.observe(vehicle_at_home(), [report(2.0)])
    assert tracking.silence_s(2.5) == pytest.approx(0.5)
    assert tracking.evader(2.0).position_ned_m == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)


def test_a_velocity_that_is_not_known_is_none_and_the_declared_speed_bounds_it():
    tracking = Tracking(SETTINGS.cycle, PX4)
    tracking.observe(vehicle_at_home(), [report(1.0, velocity=(NAN, NAN, NAN), velocity_sd=NAN)])
    evader = tracking.evader(1.0)
    assert evader.velocity_ned_m_s == (0.0, 0.0, 0.0)
    assert evader.speed_bound_m_s >= SETTINGS.cycle.declared_evader_speed_m_s
    assert evader.age_s == pytest.approx(0.0, abs=0.1)


def test_an_evader_that_moves_is_where_it_has_come_to_with_its_own_velocity():
    tracking = Tracking(SETTINGS.cycle, PX4)
    for n in range(30):
        moved_deg = math.degrees(2.0 * 0.1 * n / 6371000.0)
        tracking.observe(vehicle_at_home(), [report(0.1 * n, north_deg=moved_deg, velocity=(2.0, 0.0, 0.0))])
    evader = tracking.evader(2.9)
    assert evader.position_ned_m[0] == pytest.approx(5.8, abs=0.2)
    assert evader.velocity_ned_m_s == pytest.approx((2.0, 0.0, 0.0), abs=0.2)


def test_a_reset_that_leaves_the_zero_where_it_was_leaves_the_track_alone():
    tracking = Tracking(SETTINGS.cycle, PX4)
    tracking.observe(vehicle_at_home(), [report(1.0, north_deg=1e-3)])
    before = tracking.evader(1.5)
    tracking.observe(vehicle_at_home(resets=1)._replace(jumped_ned_m=(7.0, 0.0, 0.0)), [])
    assert tracking.evader(1.5) == before


def test_an_origin_that_is_told_elsewhere_moves_the_track_to_the_same_place_in_the_new_frame():
    tracking = Tracking(SETTINGS.cycle, PX4)
    tracking.observe(vehicle_at_home(), [report(1.0, north_deg=1e-3)])
    before, place = tracking.evader(1.5), tracking.local_frame
    tracking.observe(observe(vehicle_at_home(), [Origin(2.0, 47.4, 8.5, 480.0)]), [])
    after = tracking.evader(1.5)
    assert after.position_ned_m == pytest.approx(place.ned_in(tracking.local_frame, before.position_ned_m), abs=1e-6)
    assert after[1:] == before[1:]
    assert tracking.home_ned_m[2] == pytest.approx(HOME_DOWN_M - 8.0)


def test_the_game_is_played_about_the_site_or_where_the_local_frame_has_its_zero():
    vehicle = observe(VehicleState(), [Home(0.0, *HERE, 492.0, (3.0, 4.0, -4.0)), Origin(0.0, *HERE, 488.0)])
    about_zero = Tracking(SETTINGS.cycle, PX4)
    about_zero.observe(vehicle, [])
    assert about_zero.game_frame.position_from_ned((0.0, 0.0, 0.0)) == (0.0, 0.0, 0.0)
    site = (HERE[0] + math.degrees(50.0 / 6371000.0), HERE[1], Amsl(498.0))
    about_site = Tracking(replace(SETTINGS.cycle, site=site), PX4)
    about_site.observe(vehicle, [])
    assert about_site.game_frame.position_from_ned((50.0, 0.0, -10.0)) == pytest.approx((0.0, 0.0, 0.0), abs=0.01)
