"""Whether an evader's velocities agree with its positions."""

import math
import random

import pytest

from guidance.estimation import Observer, add_report
from guidance.estimation.measurement import TrackSettings
from guidance.estimation.velocity_check import VelocityCheck, check_velocity
from guidance.frames import Amsl, LocalFrame, Ned
from guidance.messages import EvaderReport
from tests.estimation.scenes import measured

FRAME = LocalFrame(47.0, 8.0, Amsl(488.0))
SETTINGS = TrackSettings(declared_speed_m_s=3.0)
SPEED_M_S = 2.0
RADIUS_M = 20.0


def circle(time_s):
    """Position and velocity, north and east, of a circle that begins northwards."""
    angle = SPEED_M_S * time_s / RADIUS_M
    position = (RADIUS_M * math.sin(angle), RADIUS_M * (1.0 - math.cos(angle)))
    velocity = (SPEED_M_S * math.cos(angle), SPEED_M_S * math.sin(angle))
    return position, velocity


def twice_rotated(time_s):
    """The velocity in the world's axes, rotated by the heading as if it were the body's."""
    angle = 2.0 * SPEED_M_S * time_s / RADIUS_M
    return (SPEED_M_S * math.cos(angle), SPEED_M_S * math.sin(angle))


def shuttle(time_s, leg_m=15.0):
    """There and back, with a sharp turn at each end."""
    way_m = SPEED_M_S * time_s % (2.0 * leg_m)
    if way_m < leg_m:
        return (way_m, 0.0), (SPEED_M_S, 0.0)
    return (2.0 * leg_m - way_m, 0.0), (-SPEED_M_S, 0.0)


def checked(course, said=None, *, rate_hz=10.0, for_s=60.0, noise_m=0.0, check=None, begin_s=0.0):
    check = check or VelocityCheck()
    rng = random.Random(3)
    for step in range(round(for_s * rate_hz)):
        time_s = begin_s + step / rate_hz
        (north, east), (north_rate, east_rate) = course(time_s)
        if said is not None:
            north_rate, east_rate = said(time_s)
        position = (north + rng.gauss(0.0, noise_m), east + rng.gauss(0.0, noise_m), 0.0)
        velocity = (north_rate, east_rate, 0.0)
        spread_m = max(0.3, noise_m)
        check = check_velocity(check, measured(time_s, position, velocity, position_sd_m=spread_m))
    return check


@pytest.mark.parametrize("rate_hz", [0.5, 1.0, 4.0, 10.0, 50.0])
@pytest.mark.parametrize("course", [circle, shuttle])
def test_a_right_velocity_is_believed(course, rate_hz):
    assert checked(course, rate_hz=rate_hz).believed


@pytest.mark.parametrize("noise_m", [0.7, 2.0])
@pytest.mark.parametrize("rate_hz", [1.0, 10.0])
def test_noisy_positions_do_not_contradict_a_right_velocity(rate_hz, noise_m):
    assert checked(circle, rate_hz=rate_hz, for_s=200.0, noise_m=noise_m).believed


@pytest.mark.parametrize("rate_hz", [1.0, 4.0, 10.0, 50.0])
def test_a_velocity_that_is_always_zero_is_dropped_within_eight_seconds(rate_hz):
    check = checked(shuttle, lambda _: (0.0, 0.0), rate_hz=rate_hz, for_s=7.0)
    assert not check.believed
    assert check.error_m_s == pytest.approx(SPEED_M_S, abs=0.3)


def test_a_velocity_that_is_rotated_twice_is_dropped_and_stays_dropped():
    for for_s in (15.0, 60.0, 90.0):
        assert not checked(circle, twice_rotated, for_s=for_s).believed


def test_a_velocity_is_believed_again_once_it_was_right_for_long_while_the_evader_moved():
    dropped = checked(shuttle, lambda _: (0.0, 0.0), for_s=7.0)

    def resting(_):
        return (14.0, 0.0), (0.0, 0.0)

    rested = checked(resting, check=dropped, begin_s=7.0)
    assert not rested.believed
    assert not checked(circle, check=dropped, begin_s=20.0, for_s=15.0).believed
    assert checked(circle, check=dropped, begin_s=20.0, for_s=40.0).believed


def test_a_dropped_velocity_no_longer_pulls_the_estimate():
    """Catches reported velocities of a wrong frame that still pull the estimate after they are no longer believed."""
    observer = Observer()
    errors_m = []
    for step in range(900):
        time_s = step / 20.0
        position, velocity = circle(time_s)
        north_rate, east_rate = twice_rotated(time_s)
        latitude, longitude, _ = FRAME.wgs84_from_ned(Ned((*position, 0.0)))
        said = (north_rate, east_rate, 0.0)
        report = EvaderReport(time_s, time_s, "t", latitude, longitude, 488.0, Ned(said), 0.3, 0.1)
        observer = add_report(observer, report, FRAME, SETTINGS)
        estimated = observer.track.estimate.modes.steady.mean
        errors_m.append(math.dist(estimated[2:], velocity))
    assert not observer.velocity_check.believed
    assert max(errors_m[400:]) < 0.5 < max(errors_m[:400])
