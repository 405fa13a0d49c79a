"""Faults of COMMAND_ACK: the command is obeyed, the answer is not to be relied on."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sitl_mock.faults import frames
from sitl_mock.faults.effect import Direction, Effect, FaultKind, Group, Making, Passed, Scope
from sitl_mock.faults.links import always
from sitl_mock.tables import REQUIRED, Option, integer, integers, number

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sitl_mock.faults.effect import Alter

_ACKS: Final = Scope(Direction.OUT, ("COMMAND_ACK",))
_IN_PROGRESS: Final = 5
_COMMANDS: Final = Option("MAV_CMD numbers; empty for all", frozenset(), integers(0, 65535))
_SHARE: Final = Option("share of the answers", 1.0, number(0.0, 1.0))


def _of_commands(making: Making, alter: Alter) -> Effect:
    """Strike the answers to the commands asked for, and of those the share asked for."""
    chosen, sometimes = making.options["commands"], always(alter, making)

    def check(now_s: float, frame: bytes) -> Passed:
        if chosen and frames.value(frame, "command") not in chosen:
            return ((0.0, frame),)
        return sometimes(now_s, frame)

    return Effect(alter=check)


def _lost(making: Making) -> Effect:
    return _of_commands(making, lambda _now_s, _frame: ())


def _late(making: Making) -> Effect:
    delay_s = making.options["delay_s"]
    return _of_commands(making, lambda _now_s, frame: ((delay_s, frame),))


def _wrong(making: Making) -> Effect:
    result, signing = making.options["result"], making.vehicle.autopilot.signing
    return _of_commands(
        making, lambda _now_s, frame: ((0.0, frames.changed(frame, {"result": result}, signing.secret_key)),)
    )


def _unfinished(making: Making) -> Effect:
    signing, progress = making.vehicle.autopilot.signing, making.options["progress"]
    begun: set[int] = set()

    def alter(_now_s: float, frame: bytes) -> Passed:
        command = frames.value(frame, "command")
        if command in begun:
            return ()
        begun.add(command)
        news = {"result": _IN_PROGRESS, "progress": progress}
        return ((0.0, frames.changed(frame, news, signing.secret_key)),)

    return _of_commands(making, alter)


def _foreign(making: Making) -> Effect:
    component, signing = making.options["component"], making.vehicle.autopilot.signing
    return _of_commands(
        making, lambda _now_s, frame: ((0.0, frames.relabelled(frame, component=component, key=signing.secret_key)),)
    )


_COMMON: Final = {"commands": _COMMANDS, "probability": _SHARE}

ACK_KINDS: Mapping[str, FaultKind] = MappingProxyType(
    {
        "ack_lost": FaultKind(Group.LINK, "the COMMAND_ACK is lost; the command was obeyed", _lost, _COMMON, _ACKS),
        "ack_late": FaultKind(
            Group.LINK,
            "the COMMAND_ACK comes late",
            _late,
            {**_COMMON, "delay_s": Option("seconds", 1.0, number(0.0, 60.0))},
            _ACKS,
        ),
        "ack_wrong": FaultKind(
            Group.LINK,
            "the COMMAND_ACK says something else than what happened",
            _wrong,
            {**_COMMON, "result": Option("MAV_RESULT", REQUIRED, integer(0, 255))},
            _ACKS,
        ),
        "ack_in_progress": FaultKind(
            Group.LINK,
            "the COMMAND_ACK says IN_PROGRESS, and nothing follows",
            _unfinished,
            {**_COMMON, "progress": Option("percent, 255 for unknown", 0, integer(0, 255))},
            _ACKS,
        ),
        "ack_foreign": FaultKind(
            Group.LINK,
            "the COMMAND_ACK comes from another component",
            _foreign,
            {**_COMMON, "component": Option("component id", 191, integer(0, 255))},
            _ACKS,
        ),
    }
)
