"""Course and speeds over ground, as aviation gives them, into a velocity."""

import math

from guidance.frames import Vector


def velocity_over_ground(*, course_cdeg: float, speed_cm_s: float, climb_cm_s: float) -> Vector:
    """North, east, down in m/s, from the course in 1/100 degree clockwise from north, ground speed, and climb up."""
    course_rad = math.radians(course_cdeg / 100.0)
    speed_m_s = speed_cm_s / 100.0
    return speed_m_s * math.cos(course_rad), speed_m_s * math.sin(course_rad), -climb_cm_s / 100.0
