"""Standard modes: AVAILABLE_MODES (435), CURRENT_MODE (436) and AVAILABLE_MODES_MONITOR (437).

Source: https://mavlink.io/en/services/standard_modes.html
"""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, Final, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sitl_mock.protocols.reply import Reply

ADVANCED: Final = 1
NOT_USER_SELECTABLE: Final = 2
ALL_MODES: Final = 0


class StandardMode(IntEnum):
    """MAV_STANDARD_MODE."""

    NON_STANDARD = 0
    POSITION_HOLD = 1
    ORBIT = 2
    CRUISE = 3
    ALTITUDE_HOLD = 4
    SAFE_RECOVERY = 5
    MISSION = 6
    LAND = 7
    TAKEOFF = 8


class ModeEntry(NamedTuple):
    """One mode as a ground station lists it.

    Attributes:
        name: At most 35 characters.
        custom_mode: As in HEARTBEAT.
        standard: The standard mode that it is.
        properties: ADVANCED, NOT_USER_SELECTABLE.
    """

    name: str
    custom_mode: int
    standard: StandardMode = StandardMode.NON_STANDARD
    properties: int = 0


def available_modes(modes: Sequence[ModeEntry], index: int) -> list[Reply]:
    """Return AVAILABLE_MODES for one mode (from 1), or for all (0); nothing for an index that is not there."""
    return [
        ("AVAILABLE_MODES", len(modes), number, int(mode.standard), mode.custom_mode, mode.properties, mode.name)
        for number, mode in enumerate(modes, start=1)
        if index in {ALL_MODES, number}
    ]


def current_mode(modes: Sequence[ModeEntry], custom_mode: int, intended_custom_mode: int = 0) -> Reply:
    """Return CURRENT_MODE; an intended mode of 0 means that none is intended."""
    standard = next((mode.standard for mode in modes if mode.custom_mode == custom_mode), StandardMode.NON_STANDARD)
    return ("CURRENT_MODE", int(standard), custom_mode, intended_custom_mode)


def available_modes_monitor(sequence: int) -> Reply:
    """Return AVAILABLE_MODES_MONITOR; the number changes when the list does."""
    return ("AVAILABLE_MODES_MONITOR", sequence & 0xFF)
