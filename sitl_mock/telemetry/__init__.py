"""From state to MAVLink fields: one builder per message."""

from collections.abc import Callable, Mapping
from typing import Any

from sitl_mock.telemetry.motion import MOTION
from sitl_mock.telemetry.px4 import PX4
from sitl_mock.telemetry.status import STATUS
from sitl_mock.vehicle.flavour import Report

Builders = Mapping[str, Callable[[Report], tuple[Any, ...] | None]]

BUILDERS: Builders = {**MOTION, **STATUS}
"""Builders of all messages; a flavour may replace some."""
_OWN: Mapping[str, Builders] = {"px4": {**BUILDERS, **PX4}}


def builders_of(flavour: str) -> Builders:
    """Return the builders of a flavour."""
    return _OWN.get(flavour, BUILDERS)


__all__ = ["BUILDERS", "MOTION", "PX4", "STATUS", "Builders", "Report", "builders_of"]
