"""The parameter protocol: read by name or index, list, set with echo.

PX4 puts the four bytes of an INT32 into the float field, ArduPilot casts the number; both answer PARAM_SET with the
value as stored, whatever its documented range. Both are silent about a name they do not know, and say nothing of
PARAM_ERROR. Source: https://mavlink.io/en/services/parameter.html, PX4 1.17's ``mavlink_parameters.cpp``, ArduPilot
4.5's ``GCS_Param.cpp``.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from sitl_mock.protocols.parameter import ParameterError, ParameterStore, ParamKind

if TYPE_CHECKING:
    from sitl_mock.mavlink import Message
    from sitl_mock.protocols.reply import Reply

HASH_NAME: Final = "_HASH_CHECK"
UINT32: Final = 5
NO_INDEX: Final = 0xFFFF
WARNING: Final = 4  # MAV_SEVERITY


@dataclass(frozen=True, slots=True)
class ParameterRules:
    """How a flavour speaks.

    Attributes:
        bytewise: Integers travel as their four bytes (PX4) instead of as a number (ArduPilot).
        hash_check: ``_HASH_CHECK`` leads each list and can be asked for (PX4).
        type_must_match: PARAM_SET with another type is ignored (PX4); otherwise the number is cast (ArduPilot).
        index_only_in_lists: An answer about one name carries no index (ArduPilot).
        protected: Names that a client may not set: a text says so, and the value as it is.
        list_hz: Parameters in a second while a list is sent.
    """

    bytewise: bool
    hash_check: bool
    type_must_match: bool
    index_only_in_lists: bool = False
    protected: frozenset[str] = frozenset()
    list_hz: float = 500.0


PX4_PARAMETER_RULES: Final = ParameterRules(bytewise=True, hash_check=True, type_must_match=True)
ARDUPILOT_PARAMETER_RULES: Final = ParameterRules(
    bytewise=False,
    hash_check=False,
    type_must_match=False,
    index_only_in_lists=True,
    protected=frozenset({"MIS_TOTAL", *(f"BARO{n}_{what}" for n in (1, 2, 3) for what in ("DEVID", "GND_PRESS"))}),
)


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
            return [self._value(self._store.names[index])] if index < len(self._store.names) else []
        name = message.param_id
        if name == HASH_NAME and self._rules.hash_check:
            return [self._hash_reply()]
        return [self._named(name)] if name in self._store else []

    def _set(self, message: Message) -> list[Reply]:
        name, rules = message.param_id, self._rules
        if name == HASH_NAME and rules.hash_check:  # the ground station knows the values: stop the list
            self._next_index = None
            return []
        item = self._store.definitions.get(name)
        if item is None or (rules.type_must_match and message.param_type != item.kind):
            return []
        if name in rules.protected:
            return [("STATUSTEXT", WARNING, f"Param write denied ({name})", 0, 0), self._named(name)]
        try:
            self._store.set(name, self._decode(item.kind, message.param_value))
        except ParameterError:  # not a number: it would go on into every sum
            return []
        return [self._named(name)]

    def _decode(self, kind: ParamKind, wire: float) -> float:
        if not self._rules.bytewise or kind is ParamKind.REAL32:
            return wire
        return int(struct.unpack("<i", struct.pack("<f", wire))[0])

    def _named(self, name: str) -> Reply:
        """Return PARAM_VALUE to a question about a name."""
        reply = self._value(name)
        return (*reply[:-1], NO_INDEX) if self._rules.index_only_in_lists else reply

    def _value(self, name: str) -> Reply:
        value = self._store[name]
        kind = self._store.definitions[name].kind
        if self._rules.bytewise and kind is not ParamKind.REAL32:
            value = struct.unpack("<f", struct.pack("<i", int(value)))[0]
        return ("PARAM_VALUE", name, value, int(kind), len(self._store), self._store.index[name])

    def _hash_reply(self) -> Reply:
        value = struct.unpack("<f", struct.pack("<I", self._store.hash()))[0]
        return ("PARAM_VALUE", HASH_NAME, value, UINT32, len(self._store), NO_INDEX)
