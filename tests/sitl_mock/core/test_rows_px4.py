"""PX4 v1.17 against the mock, by row of the list of differences that other people's clients found."""

import itertools

import pytest


def hovering(fly, seed, *, wanders=True, **settings):
    """A PX4 with its usual noise, 20 m up."""
    flight = fly("px4", noise=True, seed=seed, **settings)
    flight.vehicle.autopilot.brain.home.wanders = wanders
    return flight.airborne(20.0)


@pytest.mark.parametrize("seed", [1, 3])
def test_row_07_home_jumps_in_height_in_flight_and_nothing_else_of_it_does(fly, ned_velocity, seed):
    flight = hovering(fly, seed)
    begun_s = flight.now_s
    flight.offboard(ned_velocity(1.0, 0.0, 0.0)).run(40.0, ned_velocity(1.0, 0.0, 0.0))
    homes = [m for _, m in flight.all("HOME_POSITION", begun_s)]
    heights = [m.altitude for m in homes]
    jumps = [abs(b - a) for a, b in itertools.pairwise(heights)]
    assert len(set(heights)) >= 0.4 * len(heights), "recorded: 46 values in 98 messages"
    assert 1000 <= max(heights) - min(heights) <= 4000, "recorded: 488.0 to 490.5 m"
    assert 700 <= max(jumps) <= 3000
    assert len({(m.latitude, m.longitude, m.x, m.y) for m in homes}) == 1
    origin_mm = round(flight.vehicle.autopilot.frame.origin.alt_amsl_m * 1e3)
    assert all(abs(m.altitude - (origin_mm - m.z * 1e3)) <= 1.0 for m in homes), "x, y, z say the same"
    assert [m.time_usec for m in homes] == sorted(m.time_usec for m in homes)
    places = [m for _, m in flight.all("GLOBAL_POSITION_INT", begun_s)]
    assert max(abs(b.alt - a.alt) for a, b in itertools.pairwise(places)) < 200
    relative = [m.relative_alt for m in places]
    assert max(abs(b - a) for a, b in itertools.pairwise(relative)) > 900, "heights above home jump along"


def test_row_07_two_minutes_after_leaving_the_ground_home_stays(fly):
    flight = hovering(fly, 4).run(130.0)
    settled_s = flight.now_s
    flight.run(30.0)
    assert len({m.altitude for _, m in flight.all("HOME_POSITION", settled_s)}) == 1
    assert len({m.altitude for _, m in flight.all("HOME_POSITION")}) > 10


def test_row_07_the_local_frame_stays_and_equal_seeds_wander_equally(fly):
    flights = [hovering(fly, seed).run(20.0) for seed in (5, 5, 6)]
    origins = []
    for flight in flights:
        flight.command(512, 49.0)
        origins.append(flight.last("GPS_GLOBAL_ORIGIN"))
    assert len({(m.latitude, m.longitude, m.altitude) for m in origins}) == 1
    first, same, other = ([m.altitude for _, m in flight.all("HOME_POSITION")] for flight in flights)
    assert first == same
    assert first != other


def test_row_07_home_is_set_at_arming_and_at_leaving_the_ground_and_a_given_home_is_kept(fly):
    flight = fly("px4", noise=True, seed=7).run(8.0)
    homes = flight.all("HOME_POSITION")
    assert len({m.time_usec for _, m in homes}) == 1
    assert flight.command(400, 1.0) == [0]
    armed_s = flight.now_s
    flight.run(2.5)
    assert flight.last("HOME_POSITION").time_usec == pytest.approx(armed_s * 1e6, abs=2e5)
    flight.command(22)
    flight.until(lambda: not flight.vehicle.truth.on_ground, 10.0)
    left_s = flight.now_s
    flight.run(2.2)
    assert flight.vehicle.autopilot.craft.home_s == pytest.approx(left_s, abs=0.05)
    given = fly("px4", noise=True, seed=7).run(3.0)
    assert given.command_int(179, 0, 0.0, x=473_980_000, y=85_456_000, z=490.0) == [0]
    given.airborne(5.0)
    assert given.last("HOME_POSITION").latitude == pytest.approx(473_980_000, abs=2)


def test_row_07_without_noise_home_rests(fly):
    flight = fly("px4", noise=False)
    flight.vehicle.autopilot.brain.home.wanders = True
    flight.airborne(20.0).run(20.0)
    assert len({m.altitude for _, m in flight.all("HOME_POSITION", 10.0)}) == 1


def test_row_07_the_receiver_scatters_as_the_recorded_one_does(fly):
    flight = hovering(fly, 8, wanders=False).run(40.0)
    fixes = [m for _, m in flight.all("GPS_RAW_INT", flight.now_s - 40.0)]
    steps = [(b.alt - a.alt) * 1e-3 for a, b in itertools.pairwise(fixes)]
    rms_m = (sum(step * step for step in steps) / len(steps) / 2.0) ** 0.5
    assert rms_m == pytest.approx(0.54, abs=0.1), "white: a step's variance is twice a reading's"
