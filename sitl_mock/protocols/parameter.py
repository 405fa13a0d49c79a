"""The parameter protocol: read by name or index, list, set with echo.

PX4 puts the four bytes of an INT32 into the float field, ArduPilot casts the number. Both answer PARAM_SET with the
stored value, regardless of the documented range. Both ignore unknown names and never send PARAM_ERROR.
Source: https://mavlink.io/en/services/parameter.html, PX4 1.17's ``mavlink_parameters.cpp``, ArduPilot 4.5's
``GCS_Param.cpp``.
"""

from __future__ import annotations

import difflib
import math
import re
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property, lru_cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, NamedTuple

if TYPE_CHECKING:
    from sitl_mock.mavlink import Message
    from sitl_mock.protocols.session import Reply


class ParamKind(IntEnum):
    """MAV_PARAM_TYPE, as far as autopilots use it."""

    INT8 = 2
    INT16 = 4
    INT32 = 6
    REAL32 = 9


_INTEGER_RANGE: Final = {
    kind: (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    for kind, bits in (
        (ParamKind.INT8, 8),
        (ParamKind.INT16, 16),
        (ParamKind.INT32, 32),
    )
}


class ParameterError(ValueError):
    """Unknown parameter, or a value outside the type or range."""


class Parameter(NamedTuple):
    """One parameter.

    Attributes:
        name: At most 16 characters.
        kind: Type on the wire.
        default: The autopilot's default.
        unit: Documented unit, "" for none.
        minimum: Documented lower limit.
        maximum: Documented upper limit.
        meaning: Short description.
        behind: Parameter that must not be 0 for this one to be listed; "" if it is always listed.
    """

    name: str
    kind: ParamKind
    default: float
    unit: str
    minimum: float
    maximum: float
    meaning: str
    behind: str = ""


class Renamed(NamedTuple):
    """A parameter's name in this version, and how many of its units are one of the old unit (0.01: cm to m)."""

    name: str
    factor: float


class ParameterTable(tuple[Parameter, ...]):
    """Parameter definitions of a flavour, shared by its vehicles; their order gives the indices.

    Attributes:
        renamed: Parameters by their names in the version with recorded data, which the mock's own code reads.
    """

    renamed: Mapping[str, Renamed] = MappingProxyType({})

    @cached_property
    def definitions(self) -> Mapping[str, Parameter]:
        """By name."""
        return {item.name: item for item in self}

    @cached_property
    def switches(self) -> frozenset[str]:
        """Parameters that show others."""
        return frozenset(item.behind for item in self if item.behind)

    def listed(self, values: Mapping[str, float]) -> tuple[str, ...]:
        """Names in their order, without those behind a parameter that is 0."""
        return tuple(item.name for item in self if not item.behind or values[item.behind])

    @cached_property
    def first_listed(self) -> tuple[str, ...]:
        """Names that are listed with the defaults."""
        return self.listed(self.values)

    @cached_property
    def values(self) -> Mapping[str, float]:
        """Defaults by name, rounded to their types."""
        return {name: rounded(item.kind, item.default) for name, item in self.definitions.items()}


class ParameterStore(Mapping[str, float]):
    """The values of one vehicle, read like a dict.

    `names` are the listed ones, and `index` their places in the list; the others are behind a parameter that is 0, and
    can be read and set by name. A value can also be read by its name, and in its unit, of the version with recorded
    data; `definitions` has only the names of this version. `saved` are those whose value was ever another.

    Args:
        parameters: Definitions; their order gives the indices.
        overrides: Values that differ from the defaults.

    Raises:
        ParameterError: An override that is unknown or does not fit.
    """

    def __init__(
        self, parameters: Iterable[Parameter], overrides: Mapping[str, float] | None = None
    ) -> None:
        table = parameters if isinstance(parameters, ParameterTable) else ParameterTable(parameters)
        self._table = table
        self.definitions: Final = table.definitions
        self.names = table.first_listed
        self.index = _indices(self.names)
        self.revision = 0
        self.reset_at_boot = False
        self.saved: set[str] = set()
        self._renamed = table.renamed
        self._values = dict(table.values)
        if overrides is not None:
            for name, value in overrides.items():
                self.set(name, value, check_range=True)

    def __getitem__(self, name: str) -> float:
        if name in self._renamed:
            renamed = self._renamed[name]
            return self._values[renamed.name] / renamed.factor
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def set(self, name: str, value: float, *, check_range: bool = False) -> float:
        """Store a value and return the stored one: an integer, or rounded to single precision.

        Raises:
            ParameterError: Unknown name, not a number, or (with ``check_range``) out of the documented range.
        """
        item = self.definitions.get(name)
        if item is None:
            near = difflib.get_close_matches(name.upper(), self.definitions, 1)
            advice = (
                f"; did you mean {near[0]}?" if near else "; `sitl-mock list parameters` names them"
            )
            raise ParameterError(
                f"parameter {name!r} = {value!r}: this vehicle has no such parameter{advice}"
            )
        if not math.isfinite(value):
            raise ParameterError(f"parameter {name!r} = {value!r}: a finite number is needed")
        if check_range and not item.minimum <= value <= item.maximum:
            raise ParameterError(
                f"parameter {name!r} = {value!r}: allowed are {item.minimum:g} to {item.maximum:g}"
            )
        stored = rounded(item.kind, value)
        if stored != self._values[name]:
            self._values[name] = stored
            self.saved.add(name)
            self.revision += 1
            if name in self._table.switches:
                self.names = self._table.listed(self._values)
                self.index = _indices(self.names)
        return stored

    def default_of(self, name: str) -> float:
        """Return a parameter's default, rounded to its type."""
        return self._table.values[name]

    def reset(self, keep: Callable[[str], bool] = lambda _: False) -> None:
        """Put every parameter back to its default, except those that `keep` names."""
        self.reset_at_boot = False
        for name, item in self.definitions.items():
            if not keep(name):
                self.set(name, item.default)
                self.saved.discard(name)

    def hash(self) -> int:
        """Return the CRC-32 over listed names and values that PX4 sends as ``_HASH_CHECK`` (no inversions, as NuttX).

        PX4's volatile parameters are excluded.
        """
        crc = 0xFFFFFFFF
        for name in self.names:
            value = self._values[name]
            if _VOLATILE.fullmatch(name):
                continue
            packed = struct.pack(
                "<f" if self.definitions[name].kind is ParamKind.REAL32 else "<i", value
            )
            crc = zlib.crc32(name.encode() + packed, crc)
        return crc ^ 0xFFFFFFFF


@lru_cache
def _indices(names: tuple[str, ...]) -> Mapping[str, int]:
    """Return the place of each name in a list."""
    return {name: index for index, name in enumerate(names)}


def rounded(kind: ParamKind, value: float) -> float:
    """Round a value to its type: integers half away from zero and clamped, others to single precision."""
    if kind is ParamKind.REAL32:
        limit = struct.unpack("<f", b"\xff\xff\x7f\x7f")[0]
        return float(struct.unpack("<f", struct.pack("<f", min(max(value, -limit), limit)))[0])
    low, high = _INTEGER_RANGE[kind]
    return int(min(max(math.trunc(value + math.copysign(0.5, value)), low), high))


_VOLATILE: Final = re.compile(
    r"ASPD_SCALE_\d|CAL_(ACC|GYRO|MAG|BARO)\d_([XYZ](OFF|SCALE|COMP|ODIAG)|OFF)"
    r"|COM_FLIGHT_UUID|COM_MODE\d_HASH|EKF2_MAG_DECL|LND_FLIGHT_T_(HI|LO)|SENS_DPRES_OFF"
)
"""Parameters that PX4 v1.17 marks as volatile; without them the hash equals the real one."""
HASH_NAME: Final = "_HASH_CHECK"
UINT32: Final = 5
NO_INDEX: Final = 0xFFFF
WARNING: Final = 4  # MAV_SEVERITY


@dataclass(frozen=True, slots=True)
class ParameterRules:
    """Rules of a flavour.

    Attributes:
        bytewise: Integers travel as their four bytes (PX4) instead of as a number (ArduPilot).
        hash_check: ``_HASH_CHECK`` leads each list and can be read (PX4).
        type_must_match: PARAM_SET with another type is ignored (PX4); otherwise the number is cast (ArduPilot).
        index_only_in_lists: An answer to a name carries no index (ArduPilot).
        protected: Names that clients may not set; the answer is a text and the present value.
        ungrouped: Names outside groups of parameters. An answer about a parameter of a group says REAL32 if it is set
            to its default and was never saved (ArduPilot's ``save_sync`` sends the group's type). None: no such rule.
        list_hz: Parameters per second while a list is sent.
    """

    bytewise: bool
    hash_check: bool
    type_must_match: bool
    index_only_in_lists: bool = False
    protected: frozenset[str] = frozenset()
    ungrouped: frozenset[str] | None = None
    list_hz: float = 500.0


_UNGROUPED: Final = frozenset(
    {
        "FORMAT_VERSION",
        "SYSID_THISMAV",
        "SYSID_MYGCS",
        "TELEM_DELAY",
        "GCS_PID_MASK",
        "FS_GCS_ENABLE",
        "FS_THR_ENABLE",
        "FS_THR_VALUE",
        "INITIAL_MODE",
        "LOG_BITMASK",
        "FS_EKF_ACTION",
        "FS_CRASH_CHECK",
        "PILOT_THR_BHV",
        "RTL_ALT",
        "RTL_SPEED",
        "RTL_ALT_FINAL",
        "RTL_CLIMB_MIN",
        "RTL_LOIT_TIME",
        "RTL_ALT_TYPE",
        "GPS_HDOP_GOOD",
        "SUPER_SIMPLE",
        "WP_YAW_BEHAVIOR",
        "LAND_SPEED",
        "LAND_SPEED_HIGH",
        "PILOT_SPEED_UP",
        "PILOT_ACCEL_Z",
        "THR_DZ",
        "FLTMODE1",
        "FLTMODE2",
        "FLTMODE3",
        "FLTMODE4",
        "FLTMODE5",
        "FLTMODE6",
        "FLTMODE_CH",
        "SIMPLE",
        "ESC_CALIBRATION",
        "TUNE",
        "FRAME_TYPE",
        "DISARM_DELAY",
        "ANGLE_MAX",
        "PHLD_BRAKE_RATE",
        "PHLD_BRAKE_ANGLE",
        "LAND_REPOSITION",
        "RC_SPEED",
        "ACRO_TRAINER",
        "THROW_MOT_START",
        "THROW_ALT_MIN",
        "THROW_ALT_MAX",
        "RST_SWITCH_CH",
        "AUTO_TRIGGER_PIN",
        "CRUISE_THROTTLE",
        "PILOT_STEER_TYPE",
        "FS_ACTION",
        "MODE_CH",
        "MODE1",
        "MODE2",
        "MODE3",
        "MODE4",
        "MODE5",
        "MODE6",
    }
)
"""Integers outside groups: ``GSCALAR`` and ``ASCALAR`` of ``Parameters.cpp``, of ArduCopter and of Rover."""
PX4_PARAMETER_RULES: Final = ParameterRules(bytewise=True, hash_check=True, type_must_match=True)
ARDUPILOT_PARAMETER_RULES: Final = ParameterRules(
    bytewise=False,
    hash_check=False,
    type_must_match=False,
    index_only_in_lists=True,
    protected=frozenset(
        {"MIS_TOTAL", *(f"BARO{n}_{what}" for n in (1, 2, 3) for what in ("DEVID", "GND_PRESS"))}
    ),
    ungrouped=_UNGROUPED,
)


class ParameterProtocol:
    """Parameters on one link, over the vehicle's store."""

    def __init__(self, store: ParameterStore, rules: ParameterRules) -> None:
        self._store = store
        self._rules = rules
        self._next_index: int | None = None
        self._next_s = 0.0

    def handle(self, now_s: float, message: Message) -> list[Reply]:
        """Take PARAM_REQUEST_READ, PARAM_REQUEST_LIST or PARAM_SET."""
        replies: list[Reply] = []
        kind = message.get_type()
        if kind == "PARAM_REQUEST_READ":
            # A negative index asks by name.
            index = message.param_index
            name = message.param_id
            names = self._store.names
            if 0 <= index < len(names):
                replies = [_param_value(self._store, self._rules, names[index])]
            elif index < 0 and name == HASH_NAME and self._rules.hash_check:
                replies = [self._hash_reply()]
            elif index < 0 and name in self._store.definitions:
                replies = [named(self._store, self._rules, name)]
        elif kind == "PARAM_SET":
            replies = self._set(message)
        elif kind == "PARAM_REQUEST_LIST":
            self._next_index = 0
            self._next_s = now_s
            if self._rules.hash_check:
                replies = [self._hash_reply()]
        return replies

    @property
    def is_idle(self) -> bool:
        """True if no list runs."""
        return self._next_index is None

    def advance(self, now_s: float) -> list[Reply]:
        """Return the part of a running list that is due."""
        replies: list[Reply] = []
        while self._next_index is not None and self._next_s <= now_s:
            if self._next_index >= len(self._store.names):
                self._next_index = None
                break
            replies.append(
                _param_value(self._store, self._rules, self._store.names[self._next_index])
            )
            self._next_index += 1
            self._next_s += 1.0 / self._rules.list_hz
        return replies

    def _set(self, message: Message) -> list[Reply]:
        name = message.param_id
        rules = self._rules
        # The ground station knows the values: stop the list
        if name == HASH_NAME and rules.hash_check:
            self._next_index = None
            return []
        item = self._store.definitions.get(name)
        if item is None or (rules.type_must_match and message.param_type != item.kind):
            return []
        if name in rules.protected:
            return [
                ("STATUSTEXT", WARNING, f"Param write denied ({name})", 0, 0),
                named(self._store, rules, name),
            ]
        try:
            value = message.param_value
            if rules.bytewise and item.kind is not ParamKind.REAL32:
                value = int(struct.unpack("<i", struct.pack("<f", value))[0])
            self._store.set(name, value)
        except ParameterError:  # NaN would spread into every sum
            return []
        answer = named(self._store, rules, name)
        is_grouped = rules.ungrouped is not None and name not in rules.ungrouped
        if is_grouped and name not in self._store.saved:
            return [(*answer[:3], int(ParamKind.REAL32), *answer[4:])]
        return [answer]

    def _hash_reply(self) -> Reply:
        value = struct.unpack("<f", struct.pack("<I", self._store.hash()))[0]
        return ("PARAM_VALUE", HASH_NAME, value, UINT32, len(self._store.names), NO_INDEX)


def named(store: ParameterStore, rules: ParameterRules, name: str) -> Reply:
    """Return PARAM_VALUE for a name, as an answer or as an unsolicited update."""
    reply = _param_value(store, rules, name)
    if rules.index_only_in_lists:
        return (*reply[:-1], NO_INDEX)
    return reply


def _param_value(store: ParameterStore, rules: ParameterRules, name: str) -> Reply:
    value = store[name]
    kind = store.definitions[name].kind
    if rules.bytewise and kind is not ParamKind.REAL32:
        value = struct.unpack("<f", struct.pack("<i", int(value)))[0]
    index = store.index.get(name, NO_INDEX)
    return ("PARAM_VALUE", name, value, int(kind), len(store.names), index)
