"""Numbers of the wire."""

import math
from typing import Any

Fields = tuple[Any, ...]
"""Fields of a message, in the order of its payload."""

_LEAST_INT16 = -32767.0
_MOST_INT16 = 32767.0


def int16(value: float) -> int:
    """Round into a signed 16-bit field, clipped."""
    if _LEAST_INT16 <= value <= _MOST_INT16:
        return int(value)
    return int(min(max(value, _LEAST_INT16), _MOST_INT16))


def heading_cdeg(yaw_rad: float) -> int:
    """Heading as centidegrees in [0, 35999]."""
    return int(math.degrees(yaw_rad) * 100.0) % 36000
