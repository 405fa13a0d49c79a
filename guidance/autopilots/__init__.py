"""The autopilots that a flight can use. One module describes each; `register` adds another from outside.

Descriptions:
    PX4, ARDUCOPTER: each an `Autopilot`. ROVER: the protocol of ArduPilot's rover, which plays the evader.
    AUTOPILOTS: every autopilot by name. `autopilot_named`, `autopilots_of`: look one up. AutopilotName: type of a key.
    Version: the parameters of a version of an autopilot. Mode: a mode by its meaning.
    Bound: a parameter that bounds a key of a new vehicle file.

Preflight:
    Preflight, Wants: requirements of the configuration. Finding: one row of the result, with a `Verdict`.
"""

from typing import Annotated

from pydantic import AfterValidator

from guidance.autopilots.arducopter import ARDUCOPTER, ROVER
from guidance.autopilots.description import Autopilot, Bound, Mode, Version
from guidance.autopilots.px4 import PX4
from guidance.autopilots.rules import Finding, Preflight, Verdict, Wants
from guidance.registry import Registry

AUTOPILOTS: Registry[Autopilot] = Registry(
    "autopilot",
    "autopilot",
    "pursuit_guidance.autopilots",
    {PX4.name: PX4, ARDUCOPTER.name: ARDUCOPTER},
)
"""The autopilots that can be flown, by name. Add one with `register`."""


def register(autopilot: Autopilot) -> None:
    """Add an autopilot under its name, as `Registry.add` does."""
    AUTOPILOTS.add(autopilot.name, autopilot)


def autopilot_named(name: str) -> Autopilot:
    """Return an autopilot by its name, as `Registry.named` does."""
    return AUTOPILOTS.named(name)


def autopilots_of(autopilot_id: int) -> tuple[Autopilot, ...]:
    """Return the autopilots with a MAV_AUTOPILOT number."""
    return tuple(
        autopilot for autopilot in AUTOPILOTS.values() if autopilot.autopilot_id == autopilot_id
    )


AutopilotName = Annotated[
    str, AfterValidator(AUTOPILOTS.checked_name), AUTOPILOTS.names_in_schema()
]
"""Type of a key that names an autopilot."""

__all__ = [
    "ARDUCOPTER",
    "AUTOPILOTS",
    "PX4",
    "ROVER",
    "Autopilot",
    "AutopilotName",
    "Bound",
    "Finding",
    "Mode",
    "Preflight",
    "Verdict",
    "Version",
    "Wants",
    "autopilot_named",
    "autopilots_of",
    "register",
]
