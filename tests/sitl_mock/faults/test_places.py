"""Wrong positions and velocities, and the effects of bursts, drifts, weak rotors and other programs."""

import itertools
import math

import pytest

M_PER_DEG = 111_319.49


def apart_m(one, other):
    """From one HOME_POSITION or GPS_GLOBAL_ORIGIN to another: metres north, east, down."""
    north_m = (other.latitude - one.latitude) * 1e-7 * M_PER_DEG
    east_m = (
        (other.longitude - one.longitude)
        * 1e-7
        * M_PER_DEG
        * math.cos(math.radians(one.latitude * 1e-7))
    )
    return north_m, east_m, (one.altitude - other.altitude) * 1e-3


def places(flight, *span):
    return [(m.x, m.y, m.z) for _, m in flight.all("LOCAL_POSITION_NED", *span)]


def test_home_is_told_elsewhere_at_once_on_earth_and_in_the_local_frame(rig):
    flight = rig({"kind": "home_jump", "north": 20.0, "east": -10.0, "down": 3.0, "at_s": 3.0}).run(
        5.0
    )
    before = flight.all("HOME_POSITION", 1.0, 3.0)[-1][1]
    after = flight.all("HOME_POSITION", 3.0)[0]
    assert after[0] == pytest.approx(3.0, abs=0.05)
    assert apart_m(before, after[1]) == pytest.approx((20.0, -10.0, 3.0), abs=0.05)
    assert (after[1].x - before.x, after[1].y - before.y) == pytest.approx((20.0, -10.0), abs=1e-4)


def test_a_home_that_wanders_is_told_elsewhere_each_time(rig):
    flight = rig({"kind": "home_jump", "wander_m": 2.0, "at_s": 2.0}).run(12.0)
    xs = [m.x for _, m in flight.all("HOME_POSITION", 2.0)]
    assert len(set(xs)) == len(xs) >= 10
    assert (
        0.5 < math.sqrt(sum((b - a) ** 2 for a, b in itertools.pairwise(xs)) / (len(xs) - 1)) < 5.0
    )


def test_an_origin_that_jumps_leaves_positions_alone(rig):
    flight = rig({"kind": "origin_jump", "north": 5.0, "at_s": 3.0}).run(5.0)
    told = flight.all("GPS_GLOBAL_ORIGIN", 3.0)
    assert len(told) >= 2
    lat_deg = flight.vehicle.autopilot.frame.origin.lat_deg
    assert (told[0][1].latitude * 1e-7 - lat_deg) * M_PER_DEG == pytest.approx(5.0, abs=0.05)
    assert places(flight, 4.0)[-1] == pytest.approx(places(flight, 2.0, 3.0)[-1], abs=1e-3)


@pytest.mark.parametrize("told", ["yes", "no"])
def test_an_origin_that_moves_takes_every_place_with_it(rig, told):
    fault = {
        "kind": "origin_move",
        "north": 8.0,
        "east": -6.0,
        "down": 1.0,
        "told": told,
        "at_s": 3.0,
    }
    flight = rig(fault).run(5.0)
    before = places(flight, 2.0, 3.0)[-1]
    after = places(flight, 4.0)[-1]
    assert [b - a for a, b in zip(before, after, strict=True)] == pytest.approx(
        [-8.0, 6.0, -1.0], abs=0.01
    )
    home = flight.all("HOME_POSITION", 1.0, 3.0)[-1][1]
    there = flight.all("HOME_POSITION", 3.0)[-1][1]
    assert (there.latitude, there.x - home.x) == (home.latitude, pytest.approx(-8.0, abs=1e-4))
    assert bool(flight.all("GPS_GLOBAL_ORIGIN", 3.0)) == (told == "yes")


def test_a_lie_in_velocity_leaves_positions_alone(rig):
    flight = rig({"kind": "velocity_lie", "north": 1.5, "east": -0.5, "at_s": 2.0}).run(3.0)
    local = flight.all("LOCAL_POSITION_NED", 2.5)[0][1]
    place = flight.all("GLOBAL_POSITION_INT", 2.5)[0][1]
    assert (local.vx, local.vy, local.vz) == pytest.approx((1.5, -0.5, 0.0), abs=0.01)
    assert (place.vx, place.vy, place.vz) == pytest.approx((150, -50, 0), abs=1)
    assert places(flight, 2.9)[-1] == pytest.approx(places(flight, 1.0, 2.0)[-1], abs=1e-3)


def test_bursts_lose_every_frame_for_a_while_and_about_their_share(rig):
    """Catches a burst that loses single frames only."""
    flight = rig({"kind": "burst_loss", "good_s": 0.6, "lost_s": 0.3, "at_s": 1.0}).run(61.0)
    times = [t for t, _ in flight.all("ATTITUDE", 1.0)]
    gaps = [b - a for a, b in itertools.pairwise(times)]
    assert 0.55 < len(times) / len(flight.all("ATTITUDE", 0.0, 1.0)) / 60.0 < 0.8
    assert max(gaps) > 0.5
    assert sum(gap > 0.05 for gap in gaps) < 110


@pytest.mark.parametrize(
    ("fault", "axis", "slid_m"),
    [
        ({"kind": "gps_drift", "east": 0.4}, 1, 2.0),
        ({"kind": "barometer_drift", "down_m_s": -0.3}, 2, -1.5),
    ],
)
def test_the_estimate_slides_and_the_vehicle_follows_it_the_other_way(rig, fault, axis, slid_m):
    """Catches a drift that moves the report but not the vehicle."""
    flight = rig({**fault, "after": "AIRBORNE", "at_s": 20.0, "for_s": 5.0}).airborne()
    before = flight.vehicle.truth.position_ned_m[axis]
    flight.run(30.0)
    truth = flight.vehicle.truth.position_ned_m[axis]
    believed = places(flight)[-1][axis]
    assert believed - truth == pytest.approx(slid_m, abs=0.1)
    assert truth - before == pytest.approx(-slid_m, abs=0.6)


def test_rotors_that_give_less_let_the_vehicle_sink_and_it_catches_itself(rig):
    """Catches a loss of thrust without an effect, or one that stays."""
    flight = rig(
        {"kind": "thrust_loss", "share": 0.5, "after": "AIRBORNE", "at_s": 20.0, "for_s": 1.0}
    ).airborne()
    while not any(fault["state"] == "acting" for fault in flight.faulted.faults()):
        flight.run(0.1)
    before_m = flight.vehicle.truth.position_ned_m[2]
    flight.run(1.0)
    assert flight.vehicle.truth.velocity_ned_m_s[2] > 0.3
    flight.run(10.0)
    assert flight.vehicle.truth.position_ned_m[2] == pytest.approx(before_m, abs=0.5)


@pytest.mark.parametrize("flavour", ["px4", "arducopter"])
def test_another_program_moves_the_vehicle_between_our_setpoints(rig, ned_velocity, flavour):
    """Catches a second source that the vehicle does not obey."""
    flight = rig(flavour=flavour).airborne()
    still = ned_velocity(0, 0, 0)
    flight.guided(*still).run(1.0, *still)
    flight.faulted.inject({"kind": "second_source", "north": 3.0, "rate_hz": 50.0})
    flight.run(2.0, *still)
    assert flight.vehicle.truth.velocity_ned_m_s[0] > 0.5
