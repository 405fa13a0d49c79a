"""An envelope wide open but for what a test closes, a multicopter's, and a command that has been flown all along."""

from guidance.control import Envelope, Situation
from guidance.control.setpoint_limiter import LimitMemory, limit
from guidance.frames import Ned
from guidance.messages import Setpoint

DT_S = 0.02
OPEN = Envelope(
    floor_m=-1000.0,
    ceiling_m=1000.0,
    speed_m_s=10.0,
    climb_m_s=4.0,
    descent_m_s=2.0,
    acceleration_m_s2=5.0,
    vertical_acceleration_m_s2=3.0,
    jerk_m_s3=1e6,
    yaw_rate_rad_s=0.5,
    braking_m_s2=2.0,
    vertical_braking_m_s2=1.0,
    reaction_s=0.5,
)
MULTICOPTER = Envelope(
    floor_m=3.0,
    ceiling_m=40.0,
    speed_m_s=8.0,
    climb_m_s=3.0,
    descent_m_s=1.5,
    acceleration_m_s2=4.0,
    vertical_acceleration_m_s2=2.0,
    jerk_m_s3=20.0,
    yaw_rate_rad_s=1.0,
    braking_m_s2=2.5,
    vertical_braking_m_s2=1.2,
    reaction_s=0.6,
)
HOVER = Situation(Ned((0.0, 0.0, 0.0)), Ned((0.0, 0.0, 0.0)))


def settled(velocity, situation=HOVER, envelope=OPEN, **command):
    """Limit a command that has been flown all along, so that acceleration does not act."""
    return limit(
        Setpoint(Ned(velocity), **command), situation, envelope, LimitMemory(Ned(velocity)), DT_S
    )
