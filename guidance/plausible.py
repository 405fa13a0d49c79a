"""Which numbers from a wire can be meant: asked where a message enters, so that nothing behind it has to.

NaN, infinities and sizes that nothing in flight can have are refused. Bounds are generous: they keep arithmetic whole
and nonsense out, and judge no flight; that is for the limits and for preflight.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any, Final

from guidance.messages import (
    Attitude,
    EvaderReport,
    FenceItem,
    GlobalPosition,
    Home,
    LocalPosition,
    Message,
    Origin,
    Parameter,
    PositionTarget,
    SystemStatus,
)

FARTHEST_M: Final = 1e6
"""From the zero of a local frame, or a radius. PX4 and ArduPilot keep local positions in 32 bit, 0.1 m there."""

HIGHEST_M: Final = 1e5
FASTEST_M_S: Final = 1e3
_TURNED_RAD: Final = 4.0 * math.pi
_LATEST_S: Final = 2.0**32 / 1e3  # time_boot_ms has 32 bits


def is_plausible(message: Message | EvaderReport) -> bool:
    """Whether everything in a message can be meant. What may be unknown by its definition (NaN) may be here too."""
    judge = _JUDGES.get(type(message))
    return judge is None or judge(message)


def _within(limit: float, *numbers: float) -> bool:
    return all(abs(number) <= limit for number in numbers)


def _on_earth(place: GlobalPosition | Home | Origin | EvaderReport) -> bool:
    here = abs(place.latitude_deg) < 90.0 and abs(place.longitude_deg) <= 180.0  # at a pole north has no direction
    return here and abs(place.altitude_amsl_m) <= HIGHEST_M


def _home(home: Home) -> bool:
    untold = all(map(math.isnan, home.position_ned_m))  # then it is reckoned from the map
    return _on_earth(home) and (untold or _within(FARTHEST_M, *home.position_ned_m))


def _local(local: LocalPosition) -> bool:
    (north, east, down), (v_north, v_east, v_down) = local.position_ned_m, local.velocity_ned_m_s
    place = abs(north) <= FARTHEST_M and abs(east) <= FARTHEST_M and abs(down) <= FARTHEST_M
    rate = abs(v_north) <= FASTEST_M_S and abs(v_east) <= FASTEST_M_S and abs(v_down) <= FASTEST_M_S
    return place and rate and 0.0 <= local.time_boot_s <= _LATEST_S


def _global(place: GlobalPosition) -> bool:
    height, rate = abs(place.altitude_above_home_m) <= HIGHEST_M, _within(FASTEST_M_S, *place.velocity_ned_m_s)
    return _on_earth(place) and height and rate and 0.0 <= place.time_boot_s <= _LATEST_S


def _status(status: SystemStatus) -> bool:
    return math.isnan(status.battery_remaining) or 0.0 <= status.battery_remaining <= 1.0


def _echo(echo: PositionTarget) -> bool:
    return all(math.isnan(part) or abs(part) <= FASTEST_M_S for part in echo.velocity_ned_m_s)


_JUDGES: Final[Mapping[type, Callable[[Any], bool]]] = {
    Attitude: lambda attitude: abs(attitude.yaw_rad) <= _TURNED_RAD,
    FenceItem: lambda item: abs(item.size) <= FARTHEST_M and abs(item.latitude_deg) < 90.0,
    GlobalPosition: _global,
    Home: _home,
    LocalPosition: _local,
    Origin: _on_earth,
    Parameter: lambda parameter: math.isfinite(parameter.value),
    PositionTarget: _echo,
    SystemStatus: _status,
    EvaderReport: _on_earth,
}
