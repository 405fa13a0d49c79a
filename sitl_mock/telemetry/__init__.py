"""From state to MAVLink fields: one builder per message."""

from collections.abc import Callable, Mapping
from typing import Any

from sitl_mock.telemetry.motion import MOTION
from sitl_mock.telemetry.on_request import ARDUPILOT_ON_REQUEST, PX4_ON_REQUEST
from sitl_mock.telemetry.px4 import PX4_BUILDERS
from sitl_mock.telemetry.status import STATUS
from sitl_mock.vehicle.flavour import Report

Builders = Mapping[str, Callable[[Report], tuple[Any, ...] | None]]

BUILDERS: Builders = {**MOTION, **STATUS}
"""Builders that the flavours share; each replaces some and has more."""
_ARDUPILOT: Builders = {**BUILDERS, **ARDUPILOT_ON_REQUEST}
_OWN: Mapping[str, Builders] = {
    "px4": {**BUILDERS, **PX4_BUILDERS, **PX4_ON_REQUEST},
    "arducopter": _ARDUPILOT,
    "rover": _ARDUPILOT,
}


def builders_of(flavour: str) -> Builders:
    """Return the builders of a flavour."""
    return _OWN[flavour]


__all__ = ["BUILDERS", "MOTION", "PX4_BUILDERS", "STATUS", "Builders", "Report", "builders_of"]
