"""Parameters of a vehicle: their definitions and the values that all links share."""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping
from enum import IntEnum
from typing import Final, NamedTuple


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
    """A parameter that the vehicle does not have, or a value that its type or range does not allow."""


class Parameter(NamedTuple):
    """One parameter.

    Attributes:
        name: At most 16 characters.
        kind: Type on the wire.
        default: The autopilot's own default.
        unit: As the autopilot documents it, "" for none.
        minimum: Documented lower limit.
        maximum: Documented upper limit.
        meaning: What it does, in a few words.
    """

    name: str
    kind: ParamKind
    default: float
    unit: str
    minimum: float
    maximum: float
    meaning: str


class ParameterStore(Mapping[str, float]):
    """The values of one vehicle, read like a dict.

    Args:
        parameters: Definitions; their order gives the indices (sorted by name).
        overrides: Values that differ from the defaults.

    Raises:
        ParameterError: An override that is unknown or does not fit.
    """

    def __init__(self, parameters: Iterable[Parameter], overrides: Mapping[str, float] | None = None) -> None:
        self.definitions: Final = {item.name: item for item in sorted(parameters)}
        self.names: Final = tuple(self.definitions)
        self.index: Final = {name: index for index, name in enumerate(self.names)}
        self.revision = 0
        self._values = {name: rounded(item.kind, item.default) for name, item in self.definitions.items()}
        for name, value in (overrides or {}).items():
            self.set(name, value, check_range=True)

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def set(self, name: str, value: float, *, check_range: bool = False) -> float:
        """Store a value and return it as stored: a whole number, or rounded to single precision.

        Raises:
            ParameterError: Unknown name, not a number, or (with ``check_range``) out of the documented range.
        """
        item = self.definitions.get(name)
        if item is None:
            raise ParameterError(f"parameter {name!r} = {value!r}: this vehicle has no such parameter")
        if not math.isfinite(value):
            raise ParameterError(f"parameter {name!r} = {value!r}: a finite number is needed")
        if check_range and not item.minimum <= value <= item.maximum:
            raise ParameterError(f"parameter {name!r} = {value!r}: allowed are {item.minimum:g} to {item.maximum:g}")
        stored = rounded(item.kind, value)
        if stored != self._values[name]:
            self._values[name] = stored
            self.revision += 1
        return stored

    def hash(self) -> int:
        """Return the CRC-32 over names and values that PX4 sends as ``_HASH_CHECK`` (no inversions, as NuttX)."""
        crc = 0xFFFFFFFF
        for name, value in self._values.items():
            packed = struct.pack("<f" if self.definitions[name].kind is ParamKind.REAL32 else "<i", value)
            crc = zlib.crc32(name.encode() + packed, crc)
        return crc ^ 0xFFFFFFFF


def rounded(kind: ParamKind, value: float) -> float:
    """Return a value as its type holds it: halves away from zero and clamped for integers, single precision else."""
    if kind is ParamKind.REAL32:
        limit = struct.unpack("<f", b"\xff\xff\x7f\x7f")[0]
        return float(struct.unpack("<f", struct.pack("<f", min(max(value, -limit), limit)))[0])
    low, high = _INTEGER_RANGE[kind]
    return int(min(max(math.trunc(value + math.copysign(0.5, value)), low), high))
