"""The parameter protocol: read by name or index, list, set with echo.

PX4 puts the four bytes of an INT32 into the float field, ArduPilot casts the number; both answer PARAM_SET with the
value as stored. Source: https://mavlink.io/en/services/parameter.html, PX4's ``mavlink_parameters.cpp``.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Final

from sitl_mock.protocols.parameter import MAX_NAME, ParameterError, ParameterStore, ParamKind
from sitl_mock.protocols.reply import Reply, source_of

if TYPE_CHECKING:
    from sitl_mock.mavlink import Message

HASH_NAME: Final = "_HASH_CHECK"
UINT32: Final = 5
NO_INDEX: Final = 0xFFFF


class ParamError(IntEnum):
    """MAV_PARAM_ERROR."""

    DOES_NOT_EXIST = 1
    VALUE_OUT_OF_RANGE = 2
    TYPE_MISMATCH = 7


@dataclass(frozen=True, slots=True)
class ParameterRules:
    """How a flavour speaks.

    Attributes:
        bytewise: Integers travel as their four bytes (PX4) instead of as a number (ArduPilot).
        hash_check: ``_HASH_CHECK`` leads each list and can be asked for (PX4).
        type_must_match: PARAM_SET with another type is refused (PX4); otherwise the number is cast (ArduPilot).
        errors: Unknown names and bad values are answered with PARAM_ERROR instead of silence.
        check_range: Refuse values out of the documented range; the real autopilots leave that to the ground station.
        list_hz: Parameters in a second while a list is sent.
    """

    bytewise: bool
    hash_check: bool
    type_must_match: bool
    errors: bool = True
    check_range: bool = False
    list_hz: float = 500.0


PX4_PARAMETER_RULES: Final = ParameterRules(bytewise=True, hash_check=True, type_must_match=True)
ARDUPILOT_PARAMETER_RULES: Final = ParameterRules(bytewise=False, hash_check=False, type_must_match=False)


class ParameterProtocol:
    """Parameters on one link, over the vehicle's store."""

    def __init__(self, store: ParameterStore, rules: ParameterRules) -> None:
        self._store = store
        self._rules = rules
        self._next_index: int | None = None
        self._next_s = 0.0

    @property
    def listing(self) -> bool:
        """Whether a list is being sent."""
        return self._next_index is not None

    def handle(self, now_s: float, message: Message) -> list[Reply]:
        """Take PARAM_REQUEST_READ, PARAM_REQUEST_LIST or PARAM_SET."""
        kind = message.get_type()
        if kind == "PARAM_REQUEST_READ":
            return self._read(message)
        if kind == "PARAM_SET":
            return self._set(message)
        if kind == "PARAM_REQUEST_LIST":
            self._next_index, self._next_s = 0, now_s
            return [self._hash_reply()] if self._rules.hash_check else []
        return []

    def advance(self, now_s: float) -> list[Reply]:
        """Return the part of a running list that is due."""
        replies: list[Reply] = []
        while self._next_index is not None and self._next_s <= now_s:
            if self._next_index >= len(self._store.names):
                self._next_index = None
                break
            replies.append(self._value(self._store.names[self._next_index]))
            self._next_index += 1
            self._next_s += 1.0 / self._rules.list_hz
        return replies

    def _read(self, message: Message) -> list[Reply]:
        index = message.param_index
        if index >= 0:
            if index < len(self._store.names):
                return [self._value(self._store.names[index])]
            return self._refuse(message, ParamError.DOES_NOT_EXIST)
        name = message.param_id
        if name == HASH_NAME and self._rules.hash_check:
            return [self._hash_reply()]
        if name in self._store:
            return [self._value(name)]
        return self._refuse(message, ParamError.DOES_NOT_EXIST)

    def _set(self, message: Message) -> list[Reply]:
        name = message.param_id
        if name == HASH_NAME and self._rules.hash_check:  # the ground station knows the values: stop the list
            self._next_index = None
            return []
        item = self._store.definitions.get(name)
        if item is None:
            return self._refuse(message, ParamError.DOES_NOT_EXIST)
        if self._rules.type_must_match and message.param_type != item.kind:
            return self._refuse(message, ParamError.TYPE_MISMATCH)
        value = self._decode(item.kind, message.param_value)
        try:
            self._store.set(name, value, check_range=self._rules.check_range)
        except ParameterError:
            return [*self._refuse(message, ParamError.VALUE_OUT_OF_RANGE), self._value(name)]
        return [self._value(name)]

    def _decode(self, kind: ParamKind, wire: float) -> float:
        if not self._rules.bytewise or kind is ParamKind.REAL32:
            return wire
        return int(struct.unpack("<i", struct.pack("<f", wire))[0])

    def _value(self, name: str) -> Reply:
        value = self._store[name]
        kind = self._store.definitions[name].kind
        if self._rules.bytewise and kind is not ParamKind.REAL32:
            value = struct.unpack("<f", struct.pack("<i", int(value)))[0]
        return ("PARAM_VALUE", name, value, int(kind), len(self._store), self._store.index[name])

    def _hash_reply(self) -> Reply:
        value = struct.unpack("<f", struct.pack("<I", self._store.hash()))[0]
        return ("PARAM_VALUE", HASH_NAME, value, UINT32, len(self._store), NO_INDEX)

    def _refuse(self, message: Message, error: ParamError) -> list[Reply]:
        if not self._rules.errors:
            return []
        index = getattr(message, "param_index", -1)
        return [("PARAM_ERROR", *source_of(message), message.param_id[:MAX_NAME], index, int(error))]
