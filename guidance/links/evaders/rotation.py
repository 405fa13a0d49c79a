"""Turning a vector from a body's axes into the axes its attitude quaternion is given in."""

import math
from collections.abc import Sequence

from guidance.frames import Vector
from guidance.links.evaders.refusal import UNKNOWN_VELOCITY

Quaternion = tuple[float, float, float, float]


def rotate(quaternion_wxyz: Sequence[float], vector: Vector) -> Vector:
    """Rotate a vector by q v q*, for a quaternion of length 1 within 5 %; unknown (NaN) for any other."""
    w, x, y, z = quaternion_wxyz
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if not abs(length - 1.0) < 0.05:
        return UNKNOWN_VELOCITY
    w, x, y, z = w / length, x / length, y / length, z / length
    vx, vy, vz = vector
    tx, ty, tz = 2 * (y * vz - z * vy), 2 * (z * vx - x * vz), 2 * (x * vy - y * vx)
    return (
        vx + w * tx + y * tz - z * ty,
        vy + w * ty + z * tx - x * tz,
        vz + w * tz + x * ty - y * tx,
    )
