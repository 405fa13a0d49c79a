"""A vehicle that gathers speed goes on gathering some before it brakes: the fences keep that distance free."""

import math

import pytest

from guidance.control import Envelope
from guidance.control.velocity_constraints import surge_ned_m

ENVELOPE = Envelope(
    floor_m=1.0,
    ceiling_m=50.0,
    speed_m_s=8.0,
    climb_m_s=3.0,
    descent_m_s=1.5,
    acceleration_m_s2=5.0,
    vertical_acceleration_m_s2=2.0,
    jerk_m_s3=20.0,
    yaw_rate_rad_s=1.0,
    braking_m_s2=2.3,
    reaction_s=0.4,
    easing_m_s3=3.0,
)


def come_to_rest(speed, acceleration, step_s=1e-4):
    """Let go of an acceleration at the jerk, do nothing for the reaction, and brake: how far that goes, by steps."""
    far = waited = 0.0
    while speed > 0.0:
        if acceleration > 0.0:
            acceleration = max(0.0, acceleration - ENVELOPE.easing_m_s3 * step_s)
            rate = acceleration
        else:
            rate = 0.0 if waited < ENVELOPE.reaction_s else -ENVELOPE.braking_m_s2
            waited += step_s
        far += speed * step_s + 0.5 * rate * step_s**2
        speed += rate * step_s
    return far


@pytest.mark.parametrize(("speed", "acceleration"), [(1.0, 3.0), (4.0, 3.5), (6.0, 1.0)])
def test_the_surge_is_how_much_further_it_goes(speed, acceleration):
    further = come_to_rest(speed, acceleration) - come_to_rest(speed, 0.0)
    way = (0.6, -0.8)
    felt = acceleration + 0.5  # that much is scatter
    surge = surge_ned_m((speed * way[0], speed * way[1], -1.0), (felt * way[0], felt * way[1], 2.0), ENVELOPE)
    assert surge == pytest.approx((further * way[0], further * way[1], 0.0), abs=0.01)


def test_braking_and_scatter_are_no_surge_and_a_turn_is_one_to_its_side():
    assert surge_ned_m((4.0, 0.0, 0.0), (-3.0, 0.0, 0.0), ENVELOPE) == (0.0, 0.0, 0.0)
    assert surge_ned_m((4.0, 0.0, 0.0), (0.3, 0.2, 5.0), ENVELOPE) == (0.0, 0.0, 0.0)
    north, east, _ = surge_ned_m((4.0, 0.0, 0.0), (-3.0, 2.0, 0.0), ENVELOPE)
    assert abs(north) < 1e-12
    assert east > 1.0
    assert math.isfinite(east)
