"""The evader's position in the vehicle's current frame, and the position of the game frame in it."""

import math
from dataclasses import replace

import pytest

from guidance.autopilots import PX4
from guidance.estimation import Observer
from guidance.estimation.rivals import LASTS_S, SourceMemory
from guidance.flight.tracking import Tracking
from guidance.frames import Amsl, LocalFrame, Ned
from guidance.messages import EvaderReport, GlobalPosition, Home, Origin
from guidance.vehicle import VehicleState, observe
from tests.flight.scenes import HOME_DOWN_M, SETTINGS, home, local, settings_of

HERE = (47.397742, 8.545594)
NAN = math.nan
ZERO = LocalFrame(*HERE, Amsl(488.0), projection=PX4.projection)


def vehicle_at_home(resets=0):
    return observe(VehicleState(), [home(0.0), Origin(0.0, *HERE, 488.0)])._replace(resets=resets)


def report(at_s, *, north_deg=0.0, velocity=(0.0, 0.0, 0.0), velocity_sd=0.1):
    return EvaderReport(
        at_s, at_s, "test", HERE[0] + north_deg, HERE[1], 488.0, Ned(velocity), 0.1, velocity_sd
    )


def test_nothing_is_known_of_an_evader_before_the_vehicles_frame_is():
    tracking = Tracking(SETTINGS)
    tracking.observe(VehicleState(), [report(1.0)])
    assert (tracking.local_frame, tracking.game_frame, tracking.evader(1.0)) == (None, None, None)
    assert tracking.silence_s(1.0) == math.inf
    tracking.observe(vehicle_at_home(), [report(2.0)])
    assert tracking.silence_s(2.5) == pytest.approx(0.5)
    assert tracking.evader(2.0).position_ned_m == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)


def test_a_velocity_that_is_not_known_is_none_and_the_declared_speed_bounds_it():
    tracking = Tracking(SETTINGS)
    tracking.observe(vehicle_at_home(), [report(1.0, velocity=(NAN, NAN, NAN), velocity_sd=NAN)])
    evader = tracking.evader(1.0)
    assert evader.velocity_ned_m_s == (0.0, 0.0, 0.0)
    assert evader.speed_bound_m_s >= SETTINGS.cycle.game.evader_speed_m_s
    assert evader.age_s == pytest.approx(0.0, abs=0.1)


def test_an_evader_that_moves_is_where_it_has_come_to_with_its_own_velocity():
    tracking = Tracking(SETTINGS)
    for n in range(30):
        moved_deg = math.degrees(2.0 * 0.1 * n / 6371000.0)
        tracking.observe(
            vehicle_at_home(), [report(0.1 * n, north_deg=moved_deg, velocity=(2.0, 0.0, 0.0))]
        )
    evader = tracking.evader(2.9)
    assert evader.position_ned_m[0] == pytest.approx(5.8, abs=0.2)
    assert evader.velocity_ned_m_s == pytest.approx((2.0, 0.0, 0.0), abs=0.2)


def test_a_reset_that_leaves_the_zero_where_it_was_leaves_the_track_alone():
    tracking = Tracking(SETTINGS)
    tracking.observe(vehicle_at_home(), [report(1.0, north_deg=1e-3)])
    before = tracking.evader(1.5)
    tracking.observe(vehicle_at_home(resets=1)._replace(jumped_ned_m=Ned((7.0, 0.0, 0.0))), [])
    assert tracking.evader(1.5) == before


def test_a_moved_origin_moves_the_track_to_the_same_place_in_the_new_frame():
    tracking = Tracking(SETTINGS)
    tracking.observe(vehicle_at_home(), [report(1.0, north_deg=1e-3)])
    before = tracking.evader(1.5)
    place = tracking.local_frame
    tracking.observe(observe(vehicle_at_home(), [Origin(2.0, 47.4, 8.5, 480.0)]), [])
    after = tracking.evader(1.5)
    assert after.position_ned_m == pytest.approx(
        place.ned_in(tracking.local_frame, before.position_ned_m), abs=1e-6
    )
    assert after[1:] == before[1:]
    assert tracking.home_ned_m[2] == pytest.approx(HOME_DOWN_M - 8.0)


def test_the_game_is_played_about_the_site_or_where_the_local_frame_has_its_zero():
    vehicle = observe(
        VehicleState(), [Home(0.0, *HERE, 492.0, Ned((3.0, 4.0, -4.0))), Origin(0.0, *HERE, 488.0)]
    )
    about_zero = Tracking(SETTINGS)
    about_zero.observe(vehicle, [])
    assert about_zero.game_frame.position_from_ned(Ned((0.0, 0.0, 0.0))) == (0.0, 0.0, 0.0)
    site = (HERE[0] + math.degrees(50.0 / 6371000.0), HERE[1], Amsl(498.0))
    about_site = Tracking(settings_of(cycle=replace(SETTINGS.cycle, site=site)))
    about_site.observe(vehicle, [])
    assert about_site.game_frame.position_from_ned(Ned((50.0, 0.0, -10.0))) == pytest.approx(
        (0.0, 0.0, 0.0), abs=0.01
    )


def moved_zero(by_m):
    """The local frame with its origin elsewhere, given in the first one."""
    latitude_deg, longitude_deg, altitude = ZERO.wgs84_from_ned(Ned(by_m))
    return replace(ZERO, latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude=altitude)


def origin(frame, at_s=0.0):
    return Origin(at_s, frame.latitude_deg, frame.longitude_deg, frame.altitude.metres)


def seen_at(ned, at_s, *, received_s=None):
    latitude_deg, longitude_deg, altitude = ZERO.wgs84_from_ned(Ned(ned))
    received_s = at_s if received_s is None else received_s
    return GlobalPosition(
        received_s, at_s, latitude_deg, longitude_deg, altitude.metres, 0.0, Ned((0.0, 0.0, 0.0))
    )


def believed(by_m, *said):
    """Return the local frame used after a report of a moved origin, given the vehicle's earlier messages."""
    tracking = Tracking(SETTINGS)
    vehicle = observe(VehicleState(), [home(0.0), origin(ZERO), *said])
    tracking.observe(vehicle, [])
    assert tracking.local_frame == ZERO
    tracking.observe(observe(vehicle, [origin(moved_zero(by_m), 9.0)]), [])
    return tracking.local_frame


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_an_origin_is_believed_unseen_that_is_half_a_metre_off_at_most(axis, side):
    for size_m, harmless in ((0.45, True), (0.55, False)):
        by_m = tuple(side * size_m if n == axis else 0.0 for n in range(3))
        frame = believed(by_m, local(1.0, (5.0, 6.0, -7.0)), seen_at((5.0, 6.0, -7.0), 1.0))
        assert frame == (moved_zero(by_m) if harmless else ZERO)


@pytest.mark.parametrize(("late_s", "kept"), [(0.0, True), (0.9, True), (1.1, False)])
def test_a_global_position_that_is_older_than_a_second_judges_nothing(late_s, kept):
    by_m = (30.0, 0.0, 0.0)
    frame = believed(
        by_m, seen_at((5.0, 6.0, -7.0), 3.0, received_s=3.0 - late_s), local(3.0, (5.0, 6.0, -7.0))
    )
    assert frame == (ZERO if kept else moved_zero(by_m))


@pytest.mark.parametrize("north_m", [2.0, 4.0, -10.0])
def test_places_of_two_moments_are_compared_by_the_way_between_them(north_m):
    flying = local(1.0, (0.0, 0.0, -7.0), (5.0, 0.0, 0.0))
    assert believed((north_m, 0.0, 0.0), flying, seen_at((2.0, 0.0, -7.0), 1.4)) == ZERO


@pytest.mark.parametrize("axis", range(3))
def test_a_position_that_is_a_metre_off_at_first_has_not_jumped(axis):
    off = tuple(float(n == axis) for n in range(3))
    tracking = Tracking(SETTINGS)
    said = [home(0.0), origin(ZERO), local(1.0, (0.0, 0.0, 0.0)), seen_at(off, 1.0)]
    tracking.observe(observe(VehicleState(), said), [])
    assert (tracking.local_frame, tracking.held_back_ned_m) == (ZERO, (0.0, 0.0, 0.0))


def test_a_jump_is_judged_by_a_global_position_of_the_same_time():
    before = [home(0.0), origin(ZERO), local(1.0, (0.0, 0.0, 0.0)), seen_at((0.0, 0.0, 0.0), 1.0)]
    for seen_s, held_back_m in ((1.01, 30.0), (1.02, 0.0)):
        tracking = Tracking(SETTINGS)
        vehicle = observe(VehicleState(), before)
        tracking.observe(vehicle, [])
        jumped = [local(1.02, (30.0, 0.0, 0.0)), seen_at((30.0, 0.0, 0.0), seen_s)]
        tracking.observe(observe(vehicle, jumped), [])
        assert tracking.held_back_ned_m == pytest.approx((held_back_m, 0.0, 0.0))
        assert tracking.local_frame == ZERO


def test_a_jump_before_the_frame_is_known_or_a_far_origin_changes_nothing():
    tracking = Tracking(SETTINGS)
    jumped = observe(
        VehicleState(), [local(1.0), seen_at((0.0, 0.0, 0.0), 1.0), local(1.02, (30.0, 0.0, 0.0))]
    )
    assert jumped.jumped_ned_m != (0.0, 0.0, 0.0)
    tracking.observe(jumped, [])
    assert (tracking.local_frame, tracking.held_back_ned_m) == (None, (0.0, 0.0, 0.0))
    tracking.observe(vehicle_at_home(), [report(1.0)])
    tracking.observe(observe(vehicle_at_home(), [Origin(2.0, -33.0, 151.0, 20.0)]), [])
    assert tracking.local_frame == ZERO


def test_a_home_without_local_coordinates_is_where_the_map_has_it():
    latitude_deg, longitude_deg, altitude = ZERO.wgs84_from_ned(Ned((20.0, -30.0, -6.0)))
    unplaced = Home(0.0, latitude_deg, longitude_deg, altitude.metres, Ned((NAN, NAN, NAN)))
    tracking = Tracking(SETTINGS)
    tracking.observe(observe(VehicleState(), [unplaced, origin(ZERO)]), [])
    assert tracking.home_ned_m == pytest.approx((20.0, -30.0, -6.0), abs=1e-3)


@pytest.mark.parametrize("site", [None, (*HERE, Amsl(500.0))])
def test_the_game_stays_where_it_is_on_earth_when_the_origin_moves_and_moves_again(site):
    tracking = Tracking(settings_of(cycle=replace(SETTINGS.cycle, site=site)))
    tracking.observe(vehicle_at_home(), [])
    down_m = 0.0 if site is None else -12.0
    assert tracking.game_frame.origin_ned_m == pytest.approx((0.0, 0.0, down_m), abs=1e-6)
    for n, by_m in enumerate([(100.0, -50.0, 3.0), (-20.0, 80.0, -4.0)]):
        tracking.observe(observe(vehicle_at_home(), [origin(moved_zero(by_m), 1.0 + n)]), [])
        stayed = (-by_m[0], -by_m[1], down_m - by_m[2])
        assert tracking.game_frame.origin_ned_m == pytest.approx(stayed, abs=0.01)


@pytest.mark.parametrize(
    ("given", "believed_m"), [({}, 0.0), ({"in_flight": True}, 0.0), ({"in_flight": False}, 500.0)]
)
def test_an_evader_jumps_no_further_than_it_can_have_gone_unless_nothing_flies(given, believed_m):
    tracking = Tracking(SETTINGS)
    for n in range(25):
        north_deg = math.degrees(500.0 / 6371000.0) if n > 10 else 0.0
        tracking.observe(vehicle_at_home(), [report(0.1 * n, north_deg=north_deg)], **given)
    assert tracking.evader(2.4).position_ned_m[0] == pytest.approx(believed_m, abs=5.0)


def test_a_rival_is_told_of_for_as_long_as_it_counts_as_there():
    tracking = Tracking(SETTINGS)
    assert tracking.rival(0.0) == ""
    tracking.observers[""] = Observer(rivals=SourceMemory(seen_s=10.0, why="place"))
    assert [tracking.rival(10.0 + after_s) for after_s in (0.0, LASTS_S, LASTS_S + 0.1)] == [
        "place",
        "place",
        "",
    ]
