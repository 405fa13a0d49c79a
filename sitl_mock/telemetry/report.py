"""Numbers of the wire."""

import math

_INT16 = 32767


def int16(value: float) -> int:
    """Round into a signed 16-bit field, clipped."""
    if -_INT16 <= value <= _INT16:
        return int(value)
    return int(min(max(value, -_INT16), _INT16))


def heading_cdeg(yaw_rad: float) -> int:
    """Heading as centidegrees in [0, 35999]."""
    return int(math.degrees(yaw_rad) * 100.0) % 36000
