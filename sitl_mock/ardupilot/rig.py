"""What differs between ArduPilot's vehicles, as data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sitl_mock.ardupilot.brain import ArduPilot
    from sitl_mock.dynamics import Setpoint
    from sitl_mock.modes import ModeTable


@dataclass(frozen=True)
class Rig:
    """One vehicle of ArduPilot.

    Attributes:
        modes: Its table.
        first_mode: Mode after boot.
        hold_mode: What MAVSDK and others mean by "hold".
        flights: What each mode does with the motors.
        flies: It can leave the ground.
        guided_timeout: Parameter with the stream's timeout, or "" where it is fixed.
        guided_timeout_s: The fixed timeout.
    """

    modes: ModeTable
    first_mode: str
    hold_mode: str
    flights: Mapping[str, Callable[[ArduPilot], Setpoint]]
    flies: bool
    guided_timeout: str = ""
    guided_timeout_s: float = 3.0
