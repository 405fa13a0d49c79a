"""State to MAVLink fields: one builder a message."""

from collections.abc import Callable, Mapping
from typing import Any

from sitl_mock.telemetry.motion import MOTION
from sitl_mock.telemetry.px4 import PX4
from sitl_mock.telemetry.report import Report
from sitl_mock.telemetry.status import STATUS

Builders = Mapping[str, Callable[[Report], tuple[Any, ...] | None]]

BUILDERS: Builders = {**MOTION, **STATUS}
"""How every message is filled, unless a flavour fills it in its own way."""
_OWN: Mapping[str, Builders] = {"px4": {**BUILDERS, **PX4}}


def builders_of(flavour: str) -> Builders:
    """How a flavour, by name, fills its messages."""
    return _OWN.get(flavour, BUILDERS)


__all__ = ["BUILDERS", "MOTION", "PX4", "STATUS", "Builders", "Report", "builders_of"]
