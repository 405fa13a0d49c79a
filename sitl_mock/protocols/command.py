"""The command protocol: COMMAND_LONG and COMMAND_INT, answered by one or more COMMAND_ACKs, now or later.

The autopilot executes commands (``execute``). This protocol converts both messages to one type, recognises resends and
addresses the answers. PX4's two answers to a mode change are two ``CommandAnswer``.
Source: https://mavlink.io/en/services/command.html
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING, Final, NamedTuple

from sitl_mock.protocols.session import ALL_COMPONENTS, Reply, source_of

if TYPE_CHECKING:
    from sitl_mock.mavlink import Message

RESEND_WINDOW_S: Final = 3.0  # MAVSDK sends a command four times within 2 s
# "not given" in the integer fields of COMMAND_INT and MISSION_ITEM_INT
INT32_NAN: Final = 2**31 - 1
GLOBAL_FRAMES: Final = frozenset({0, 3, 5, 6, 10, 11})
MISSION_FRAME: Final = 2  # the fields are no coordinates
MAX_TRACKED: Final = 64  # a flood of command numbers cannot grow the table

MAV_FRAME_GLOBAL: Final = 0
PX4_BROADCAST: Final = frozenset({512, 519})  # addressed to system 0, PX4 accepts only requests


class Result(IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5
    CANCELLED = 6


class Command(NamedTuple):
    """One command, from COMMAND_LONG or COMMAND_INT.

    Attributes:
        number: MAV_CMD.
        params: param1 to param7; 5 and 6 in degrees for global frames and in metres for local ones.
        frame: MAV_FRAME; COMMAND_LONG has none and is read as MAV_FRAME_GLOBAL.
        is_int: Whether it came as COMMAND_INT.
        source: (system id, component id) of the sender.
        confirmation: Resend counter of COMMAND_LONG.
    """

    number: int
    params: tuple[float, float, float, float, float, float, float]
    frame: int
    is_int: bool
    source: tuple[int, int]
    confirmation: int


class CommandAnswer(NamedTuple):
    """One COMMAND_ACK.

    Attributes:
        result: MAV_RESULT.
        progress: Percent for IN_PROGRESS, 255 for unknown.
        result_param2: Command-specific.
        delay_s: Delay after the command.
    """

    result: int
    progress: int = 0
    result_param2: int = 0
    delay_s: float = 0.0


Answers = Sequence[CommandAnswer]
ACCEPTED: Final = (CommandAnswer(Result.ACCEPTED),)
DENIED: Final = (CommandAnswer(Result.DENIED),)
UNSUPPORTED: Final = (CommandAnswer(Result.UNSUPPORTED),)


Execute = Callable[[float, Command], Sequence[CommandAnswer]]


@dataclass(slots=True)
class _Tracked:
    """The last command of one number from one source."""

    params: tuple[float, ...]
    at_s: float
    pending: list[tuple[float, CommandAnswer]]
    sent: list[CommandAnswer] = field(default_factory=list)


class CommandProtocol:
    """Commands on one link.

    Args:
        system_id: Own system id.
        component_id: Own component id.
        execute: ``execute(now_s, command)`` returns the answers in order; an empty sequence means no answer. It
            answers unknown commands with UNSUPPORTED.
        broadcast: Commands accepted when addressed to system 0; None for all.
    """

    def __init__(
        self,
        system_id: int,
        component_id: int,
        execute: Execute,
        *,
        broadcast: frozenset[int] | None = None,
    ) -> None:
        self._ids = (system_id, component_id)
        self._execute = execute
        self._broadcast = broadcast
        self._tracked: dict[tuple[tuple[int, int], int], _Tracked] = {}

    def handle(self, now_s: float, message: Message) -> list[Reply]:
        """Take COMMAND_LONG or COMMAND_INT; other messages and other vehicles' commands are ignored."""
        command = read_command(message)
        if command is None or command.source == self._ids:
            return []
        system, component = self._ids
        if message.target_component not in {ALL_COMPONENTS, component}:
            return []
        if message.target_system == 0:
            # A flavour may obey only some commands that are sent to all systems.
            if self._broadcast is not None and command.number not in self._broadcast:
                return []
        elif message.target_system != system:
            return []
        key = (command.source, command.number)
        tracked = self._tracked.get(key)
        if tracked is not None:
            same = all(
                a == b or (math.isnan(a) and math.isnan(b))
                for a, b in zip(command.params, tracked.params, strict=True)
            )
            counted = command.confirmation > 0 and now_s - tracked.at_s <= RESEND_WINDOW_S
            # A repeated command is not executed again; it gets its last answer.
            if same and (tracked.pending or counted):
                sent = tracked.sent[-1:]
                return [_ack(command.number, answer, command.source) for answer in sent]
        answers = self._execute(now_s, command)
        if key not in self._tracked and len(self._tracked) >= MAX_TRACKED:
            del self._tracked[next(iter(self._tracked))]
        self._tracked[key] = _Tracked(
            params=command.params,
            at_s=now_s,
            pending=[(now_s + answer.delay_s, answer) for answer in answers],
        )
        return self._due(now_s, key)

    @property
    def is_idle(self) -> bool:
        """True if no late answer waits."""
        return not any(tracked.pending for tracked in self._tracked.values())

    def advance(self, now_s: float) -> list[Reply]:
        """Return the late answers that are due."""
        replies: list[Reply] = []
        for key, tracked in self._tracked.items():
            if tracked.pending:
                replies += self._due(now_s, key)
        return replies

    def _due(self, now_s: float, key: tuple[tuple[int, int], int]) -> list[Reply]:
        tracked = self._tracked[key]
        answers = [answer for at_s, answer in tracked.pending if at_s <= now_s]
        tracked.pending = [late for late in tracked.pending if late[0] > now_s]
        tracked.sent += answers
        source, number = key
        return [_ack(number, answer, source) for answer in answers]


def read_command(message: Message) -> Command | None:
    """Return the command in a COMMAND_LONG or COMMAND_INT, or None for another message."""
    kind = message.get_type()
    first_four = ("param1", "param2", "param3", "param4")
    if kind == "COMMAND_LONG":
        names = (*first_four, "param5", "param6", "param7")
        return Command(
            message.command,
            tuple(getattr(message, name) for name in names),
            MAV_FRAME_GLOBAL,
            False,
            source_of(message),
            message.confirmation,
        )
    if kind != "COMMAND_INT":
        return None
    p1, p2, p3, p4 = (getattr(message, name) for name in first_four)
    x, y = (coordinate(value, message.frame) for value in (message.x, message.y))
    return Command(
        message.command,
        (p1, p2, p3, p4, x, y, message.z),
        message.frame,
        True,
        source_of(message),
        0,
    )


def coordinate(value: int, frame: int) -> float:
    """Return an integer coordinate field in degrees (global frames) or metres (local frames); NaN if not given."""
    if value == INT32_NAN:
        return math.nan
    if frame == MISSION_FRAME:
        return float(value)
    return value / (1e7 if frame in GLOBAL_FRAMES else 1e4)


def _ack(number: int, answer: CommandAnswer, source: tuple[int, int]) -> Reply:
    return ("COMMAND_ACK", number, answer.result, answer.progress, answer.result_param2, *source)
