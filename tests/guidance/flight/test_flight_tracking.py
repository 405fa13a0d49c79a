"""Where the target is, in whichever frame the vehicle has now, and where the game is played in it."""

import math
from dataclasses import replace

import pytest
from flight_scenes import SETTINGS, home

from guidance.autopilots import PX4
from guidance.flight.tracking import Tracking
from guidance.frames import Amsl
from guidance.telemetry import Home, Origin, TargetReport
from guidance.vehicle import VehicleState, observe

HERE = (47.397742, 8.545594)
NAN = math.nan


def vehicle_at_home(resets=0):
    return replace(observe(VehicleState(), [home(0.0), Origin(0.0, *HERE, 488.0)]), resets=resets)


def report(at_s, *, north_deg=0.0, velocity=(0.0, 0.0, 0.0), velocity_sd=0.1):
    return TargetReport(at_s, at_s, "test", HERE[0] + north_deg, HERE[1], 488.0, velocity, 0.1, velocity_sd)


def test_nothing_is_known_of_a_target_before_the_vehicles_frame_is():
    tracking = Tracking(SETTINGS.tick, PX4)
    tracking.observe(VehicleState(), [report(1.0)])
    assert (tracking.local_frame, tracking.game_frame, tracking.target(1.0)) == (None, None, None)
    assert tracking.silence_s(1.0) == math.inf
    tracking.observe(vehicle_at_home(), [report(2.0)])
    assert tracking.silence_s(2.5) == pytest.approx(0.5)
    assert tracking.target(2.0).position_ned_m == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)


def test_a_velocity_that_is_not_known_is_none_and_the_declared_speed_bounds_it():
    tracking = Tracking(SETTINGS.tick, PX4)
    tracking.observe(vehicle_at_home(), [report(1.0, velocity=(NAN, NAN, NAN), velocity_sd=NAN)])
    target = tracking.target(1.0)
    assert target.velocity_ned_m_s == (0.0, 0.0, 0.0)
    assert target.speed_bound_m_s >= SETTINGS.tick.declared_evader_speed_m_s
    assert target.age_s == pytest.approx(0.0, abs=0.1)


def test_a_target_that_moves_is_where_it_has_come_to_with_its_own_velocity():
    tracking = Tracking(SETTINGS.tick, PX4)
    for n in range(30):
        moved_deg = math.degrees(2.0 * 0.1 * n / 6371000.0)
        tracking.observe(vehicle_at_home(), [report(0.1 * n, north_deg=moved_deg, velocity=(2.0, 0.0, 0.0))])
    target = tracking.target(2.9)
    assert target.position_ned_m[0] == pytest.approx(5.8, abs=0.2)
    assert target.velocity_ned_m_s == pytest.approx((2.0, 0.0, 0.0), abs=0.2)


@pytest.mark.parametrize("change", ["reset", "origin"])
def test_what_was_said_in_a_frame_that_is_no_more_is_forgotten(change):
    tracking = Tracking(SETTINGS.tick, PX4)
    tracking.observe(vehicle_at_home(), [report(1.0)])
    tracking.observe(vehicle_at_home(), [])
    assert tracking.target(1.5) is not None
    other = (
        vehicle_at_home(resets=1) if change == "reset" else observe(vehicle_at_home(), [Origin(2.0, 47.4, 8.5, 488.0)])
    )
    tracking.observe(other, [])
    assert tracking.target(2.0) is None
    assert tracking.silence_s(2.0) == math.inf
    tracking.observe(other, [report(3.0)])
    tracking.observe(other, [])
    assert tracking.target(3.0) is not None


def test_a_count_of_resets_that_did_not_begin_at_none_is_forgotten_only_when_it_changes():
    tracking = Tracking(SETTINGS.tick, PX4)
    tracking.observe(vehicle_at_home(resets=4), [report(1.0)])
    tracking.observe(vehicle_at_home(resets=4), [])
    assert tracking.target(1.0) is not None


def test_the_game_is_played_about_the_site_or_where_the_local_frame_has_its_zero():
    vehicle = observe(VehicleState(), [Home(0.0, *HERE, 492.0, (3.0, 4.0, -4.0)), Origin(0.0, *HERE, 488.0)])
    about_zero = Tracking(SETTINGS.tick, PX4)
    about_zero.observe(vehicle, [])
    assert about_zero.game_frame.position_from_ned((0.0, 0.0, 0.0)) == (0.0, 0.0, 0.0)
    site = (HERE[0] + math.degrees(50.0 / 6371000.0), HERE[1], Amsl(498.0))
    about_site = Tracking(replace(SETTINGS.tick, site=site), PX4)
    about_site.observe(vehicle, [])
    assert about_site.game_frame.position_from_ned((50.0, 0.0, -10.0)) == pytest.approx((0.0, 0.0, 0.0), abs=0.01)
