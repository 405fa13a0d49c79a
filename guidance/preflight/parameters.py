"""The parameters that are judged: their names in a version of an autopilot, and the quantities that they give."""

from collections.abc import Mapping

import numpy as np

from guidance.autopilots import Autopilot, Version
from guidance.autopilots.rules import Quantity, Rule
from guidance.messages import AutopilotVersion
from guidance.preflight.fence import Uploaded


def version_of(autopilot: Autopilot, firmware: AutopilotVersion | None) -> Version:
    """Return the description of a firmware's version; of the oldest one if None was read."""
    if firmware is None:
        return autopilot.version_of(None)
    return autopilot.version_of((firmware.major, firmware.minor))


def rules_of(version: Version, announces: bool) -> tuple[Rule, ...]:
    """Return the rules of a version; those of an announced evader only if it `announces` one."""
    return tuple(rule for rule in version.rules if announces or not rule.of_announced)


def parameter_names(
    version: Version, *, announces: bool = False, only_needed: bool = False
) -> tuple[str, ...]:
    """Return the names of the judged parameters.

    Args:
        version: Of the autopilot.
        announces: Whether the evader is announced as traffic.
        only_needed: Only those that are needed, which are read again before every engagement.
    """
    rules = rules_of(version, announces)
    return tuple(rule.name for rule in rules if rule.needed or not only_needed)


def quantities_read(
    parameters: Mapping[str, float], version: Version, uploaded: Uploaded
) -> dict[str, float]:
    """Return the values read, by quantity and in its unit."""
    quantities: dict[str, float] = {
        rule.quantity: parameters[rule.name] * rule.unit
        for rule in version.rules
        if rule.name in parameters
    }
    if uploaded.areas is not None:
        encloses = any(area.inclusion for area in uploaded.areas)
        quantities[Quantity.UPLOADED_INCLUSION] = float(encloses)
    return quantities


def single(value: float) -> float:
    """Round to single precision, as parameters have on the wire."""
    return float(np.float32(value))
