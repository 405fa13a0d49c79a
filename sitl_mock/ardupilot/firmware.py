"""What differs between ArduPilot's vehicles, as data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from sitl_mock.dynamics import Setpoint
    from sitl_mock.modes import ModeTable
    from sitl_mock.protocols import Command, CommandAnswer

CommanderT = TypeVar("CommanderT")


@dataclass(frozen=True)
class Firmware(Generic[CommanderT]):
    """One vehicle of ArduPilot, for the commander that flies it.

    Attributes:
        modes: Its table.
        first_mode: Mode after boot.
        hold_mode: What MAVSDK and others mean by "hold".
        flights: What each mode does with the motors.
        execute: Answers commands.
        flies: It can leave the ground.
        guided_timeout: Parameter with the stream's timeout, or "" where it is fixed.
        guided_timeout_s: The fixed timeout.
    """

    modes: ModeTable
    first_mode: str
    hold_mode: str
    flights: Mapping[str, Callable[[CommanderT], Setpoint]]
    execute: Callable[[CommanderT, float, Command], Sequence[CommandAnswer]]
    flies: bool
    guided_timeout: str = ""
    guided_timeout_s: float = 3.0
