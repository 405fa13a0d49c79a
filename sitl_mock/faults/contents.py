"""Faults of what messages say: fields that are no numbers, no place, another parameter, another clock."""

from __future__ import annotations

import math
import struct
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sitl_mock.errors import ConfigError
from sitl_mock.faults import frames
from sitl_mock.faults.effect import Direction, Effect, FaultKind, Group, Making, Passed, Scope
from sitl_mock.faults.links import always
from sitl_mock.mavlink import SPEC_BY_NAME
from sitl_mock.tables import REQUIRED, Option, choice, number, text, words

if TYPE_CHECKING:
    from collections.abc import Mapping

_BOOT_WRAP_S: Final = 2**32 / 1000.0
_REAL32: Final = 9
_NOT_CONTENT: Final = ("time_", "timestamp", "target_", "param_")
_SORTS: Final = ("nan", "inf", "zero", "int_max", "int_min")
_FLOATS: Final = {"nan": math.nan, "inf": math.inf, "zero": 0.0}
_MOTION: Final = ("LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "ODOMETRY", "ATTITUDE", "ATTITUDE_QUATERNION")


def _new_value(found: frames.PayloadField, sort: str) -> float | None:
    """Return what a field becomes, or None if a field of its type cannot hold that."""
    if found.format == "c":
        return None
    if not found.whole:
        return _FLOATS.get(sort)
    return {"zero": 0, "int_max": found.most, "int_min": -found.most - 1 if found.format.islower() else 0}.get(sort)


def _changes(message: str, names: tuple[str, ...], sort: str) -> dict[str, float]:
    """Return the fields of a message that can hold it, among those named (all but stamps and targets if none are)."""
    fields = frames.layout(SPEC_BY_NAME[message].message_id)
    chosen = names or tuple(name for name in fields if not name.startswith(_NOT_CONTENT))
    new = {name: _new_value(fields[name], sort) for name in chosen if name in fields}
    return {name: value for name, value in new.items() if value is not None}


def _bad_fields(making: Making) -> Effect:
    options, signing = making.options, making.vehicle.autopilot.signing
    by_id = {
        SPEC_BY_NAME[name].message_id: _changes(name, options["fields"], options["value"]) for name in making.messages
    }
    found = {name for changes in by_id.values() for name in changes}
    for name in options["fields"]:
        if name not in found:
            raise ConfigError(
                f"fields = {name!r}: no message of {', '.join(making.messages)} has such a field that can be "
                f"{options['value']} (whole numbers: zero, int_max, int_min; others: nan, inf, zero)"
            )

    def alter(_now_s: float, frame: bytes) -> Passed:
        changes = by_id.get(frames.message_id(frame))
        return ((0.0, frames.changed(frame, changes, signing.secret_key) if changes else frame),)

    return Effect(alter=always(alter, making))


def _no_place(making: Making) -> Effect:
    signing = making.vehicle.autopilot.signing
    return Effect(alter=lambda _now_s, frame: ((0.0, frames.changed(frame, {"lat": 0, "lon": 0}, signing.secret_key)),))


def _param_echo(making: Making) -> Effect:
    vehicle, name, value = making.vehicle, making.options["parameter"], making.options["value"]
    parameters = vehicle.autopilot.parameters
    if name not in parameters:
        raise ConfigError(f"parameter = {name!r}: allowed are the parameters of {vehicle.flavour}")
    bytewise = vehicle.autopilot.flavour.parameter_rules.bytewise
    wire = value
    if bytewise and parameters.definitions[name].kind != _REAL32:
        wire = struct.unpack("<f", struct.pack("<i", int(value)))[0]

    def alter(_now_s: float, frame: bytes) -> Passed:
        if frames.value(frame, "param_id") != name.encode():
            return ((0.0, frame),)
        return ((0.0, frames.changed(frame, {"param_value": wire}, vehicle.autopilot.signing.secret_key)),)

    return Effect(alter=alter)


def _time_reset(making: Making) -> Effect:
    vehicle = making.vehicle
    return Effect(begin=lambda _now_s: vehicle.inject("time_jump_s", -vehicle.autopilot.report.boot_us * 1e-6))


def _time_wrap(making: Making) -> Effect:
    vehicle, before_s = making.vehicle, making.options["before_s"]

    def begin(_now_s: float) -> None:
        vehicle.inject("time_jump_s", _BOOT_WRAP_S - before_s - vehicle.autopilot.report.boot_us * 1e-6)

    return Effect(begin=begin)


CONTENT_KINDS: Mapping[str, FaultKind] = MappingProxyType(
    {
        "bad_fields": FaultKind(
            Group.LINK,
            "fields hold NaN, infinity, zero or the largest number of their type",
            _bad_fields,
            {
                "value": Option("what they hold", "nan", choice(*_SORTS)),
                "fields": Option("names; all of a fitting type if empty", (), words),
                "probability": Option("share of the frames", 1.0, number(0.0, 1.0)),
            },
            Scope(Direction.OUT, _MOTION, open=True),
        ),
        "latlon_zero": FaultKind(
            Group.LINK,
            "latitude and longitude are 0",
            _no_place,
            scope=Scope(Direction.OUT, ("GLOBAL_POSITION_INT", "GPS_RAW_INT")),
        ),
        "param_echo": FaultKind(
            Group.LINK,
            "a parameter is reported with another value than it has",
            _param_echo,
            {
                "parameter": Option("its name", REQUIRED, text),
                "value": Option("what is reported", REQUIRED, number(-1e9, 1e9)),
            },
            Scope(Direction.OUT, ("PARAM_VALUE",)),
        ),
        "time_reset": FaultKind(Group.LINK, "time since boot begins again at 0 in flight", _time_reset, for_s=0.0),
        "time_wrap": FaultKind(
            Group.LINK,
            "time_boot_ms is about to wrap around at 2^32",
            _time_wrap,
            {"before_s": Option("seconds until it does", 5.0, number(0.0, 1e6))},
            for_s=0.0,
        ),
    }
)
