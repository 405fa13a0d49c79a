"""Faults of message contents: wrong fields, positions, parameters, clocks and COMMAND_ACKs.

A command whose COMMAND_ACK is affected is still executed; only the answer is wrong.
"""

from __future__ import annotations

import math
import struct
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sitl_mock.errors import ConfigError
from sitl_mock.faults import frames
from sitl_mock.faults.effect import (
    Delayed,
    Direction,
    Effect,
    EffectInputs,
    FaultKind,
    Group,
    Scope,
)
from sitl_mock.faults.links import always, changing
from sitl_mock.mavlink import SPEC_BY_NAME
from sitl_mock.tables import REQUIRED, Option, choice, integer, integers, number, text, words

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sitl_mock.faults.effect import Alter


_BOOT_WRAP_S: Final = 2**32 / 1000.0
_REAL32: Final = 9
_NOT_CONTENT: Final = ("time_", "timestamp", "target_", "param_")
_SORTS: Final = ("nan", "inf", "zero", "int_max", "int_min")
_FLOATS: Final = {"nan": math.nan, "inf": math.inf, "zero": 0.0}
_MOTION: Final = (
    "LOCAL_POSITION_NED",
    "GLOBAL_POSITION_INT",
    "ODOMETRY",
    "ATTITUDE",
    "ATTITUDE_QUATERNION",
)


def _new_values(message: str, names: tuple[str, ...], sort: str) -> dict[str, float]:
    """Return new values for the named fields whose type can hold one (without names: all but stamps and targets)."""
    fields = frames.payload_fields(SPEC_BY_NAME[message].message_id)
    chosen = names
    if not names:
        chosen = tuple(name for name in fields if not name.startswith(_NOT_CONTENT))
    new: dict[str, float] = {}
    for name in chosen:
        field = fields.get(name)
        if field is None or field.format == "c":
            continue
        values = _FLOATS
        if field.whole:
            least = -field.most - 1 if field.format.islower() else 0
            values = {"zero": 0, "int_max": field.most, "int_min": least}
        if sort in values:
            new[name] = values[sort]
    return new


def _bad_fields(inputs: EffectInputs) -> Effect:
    options = inputs.options
    by_id = {
        SPEC_BY_NAME[name].message_id: _new_values(name, options["fields"], options["value"])
        for name in inputs.messages
    }
    names = set[str]().union(*by_id.values())
    for name in options["fields"]:
        if name not in names:
            raise ConfigError(
                f"fields = {name!r}: no message of {', '.join(inputs.messages)} has such a field that can be "
                f"{options['value']} (whole numbers: zero, int_max, int_min; others: nan, inf, zero)"
            )

    def bad(_now_s: float, frame: bytes) -> dict[str, float]:
        return by_id.get(frames.message_id(frame), {})

    return Effect(alter=always(changing(inputs, bad), inputs))


def _param_echo(inputs: EffectInputs) -> Effect:
    vehicle = inputs.vehicle
    name = inputs.options["parameter"]
    value = inputs.options["value"]
    parameters = vehicle.autopilot.parameters
    if name not in parameters:
        raise ConfigError(f"parameter = {name!r}: allowed are the parameters of {vehicle.flavour}")
    bytewise = vehicle.autopilot.flavour.parameter_rules.bytewise
    wire = value
    if bytewise and parameters.definitions[name].kind != _REAL32:
        wire = struct.unpack("<f", struct.pack("<i", int(value)))[0]

    def wrong(_now_s: float, frame: bytes) -> dict[str, float]:
        return {"param_value": wire} if frames.value(frame, "param_id") == name.encode() else {}

    return Effect(alter=changing(inputs, wrong))


def _to_boot_time(inputs: EffectInputs, since_boot_s: float) -> Effect:
    """Let the time since boot jump to a value."""
    vehicle = inputs.vehicle
    return Effect(
        begin=lambda _now_s: vehicle.inject(
            "time_jump_s", since_boot_s - vehicle.autopilot.report.boot_us * 1e-6
        )
    )


CONTENT_KINDS: Mapping[str, FaultKind] = MappingProxyType(
    {
        "bad_fields": FaultKind(
            Group.LINK,
            "fields hold NaN, infinity, zero or the largest number of their type",
            _bad_fields,
            {
                "value": Option("the value", "nan", choice(*_SORTS)),
                "fields": Option("field names; empty: all of a fitting type", (), words),
                "probability": Option("share of the frames", 1.0, number(0.0, 1.0)),
            },
            Scope(Direction.OUT, _MOTION, open=True),
        ),
        "latlon_zero": FaultKind(
            Group.LINK,
            "latitude and longitude are 0",
            lambda inputs: Effect(
                alter=changing(inputs, lambda _now_s, _frame: {"lat": 0, "lon": 0})
            ),
            scope=Scope(Direction.OUT, ("GLOBAL_POSITION_INT", "GPS_RAW_INT")),
        ),
        "param_echo": FaultKind(
            Group.LINK,
            "a parameter is reported with a wrong value",
            _param_echo,
            {
                "parameter": Option("its name", REQUIRED, text),
                "value": Option("the reported value", REQUIRED, number(-1e9, 1e9)),
            },
            Scope(Direction.OUT, ("PARAM_VALUE",)),
        ),
        "time_reset": FaultKind(
            Group.LINK,
            "time since boot restarts at 0 in flight",
            lambda inputs: _to_boot_time(inputs, 0.0),
            for_s=0.0,
        ),
        "time_wrap": FaultKind(
            Group.LINK,
            "time_boot_ms wraps around at 2^32",
            lambda inputs: _to_boot_time(inputs, _BOOT_WRAP_S - inputs.options["before_s"]),
            {"before_s": Option("seconds until then", 5.0, number(0.0, 1e6))},
            for_s=0.0,
        ),
    }
)


_ACKS: Final = Scope(Direction.OUT, ("COMMAND_ACK",))
_IN_PROGRESS: Final = 5
_COMMANDS: Final = Option("MAV_CMD numbers; empty: all", frozenset(), integers(0, 65535))
_SHARE: Final = Option("share of the answers", 1.0, number(0.0, 1.0))


def _of_commands(inputs: EffectInputs, alter: Alter) -> Effect:
    """Alter the answers to the chosen commands, with the chosen probability."""
    chosen = inputs.options["commands"]
    sometimes = always(alter, inputs)

    def check(now_s: float, frame: bytes) -> Delayed:
        if chosen and frames.value(frame, "command") not in chosen:
            return ((0.0, frame),)
        return sometimes(now_s, frame)

    return Effect(alter=check)


def _unfinished(inputs: EffectInputs) -> Effect:
    signing = inputs.vehicle.autopilot.signing
    progress = inputs.options["progress"]
    begun: set[int] = set()

    def alter(_now_s: float, frame: bytes) -> Delayed:
        command = frames.value(frame, "command")
        if command in begun:
            return ()
        begun.add(command)
        news = {"result": _IN_PROGRESS, "progress": progress}
        return ((0.0, frames.changed(frame, news, signing.secret_key)),)

    return _of_commands(inputs, alter)


def _foreign(inputs: EffectInputs) -> Effect:
    component = inputs.options["component"]
    signing = inputs.vehicle.autopilot.signing
    return _of_commands(
        inputs,
        lambda _now_s, frame: (
            (0.0, frames.relabelled(frame, component=component, key=signing.secret_key)),
        ),
    )


_COMMON: Final = {"commands": _COMMANDS, "probability": _SHARE}

ACK_KINDS: Mapping[str, FaultKind] = MappingProxyType(
    {
        "ack_lost": FaultKind(
            Group.LINK,
            "the COMMAND_ACK is lost; the command was executed",
            lambda inputs: _of_commands(inputs, lambda _now_s, _frame: ()),
            _COMMON,
            _ACKS,
        ),
        "ack_late": FaultKind(
            Group.LINK,
            "the COMMAND_ACK is delayed",
            lambda inputs: _of_commands(
                inputs, lambda _now_s, frame: ((inputs.options["delay_s"], frame),)
            ),
            {**_COMMON, "delay_s": Option("seconds", 1.0, number(0.0, 60.0))},
            _ACKS,
        ),
        "ack_wrong": FaultKind(
            Group.LINK,
            "the COMMAND_ACK has a wrong result",
            lambda inputs: _of_commands(
                inputs,
                changing(inputs, lambda _now_s, _frame: {"result": inputs.options["result"]}),
            ),
            {**_COMMON, "result": Option("MAV_RESULT", REQUIRED, integer(0, 255))},
            _ACKS,
        ),
        "ack_in_progress": FaultKind(
            Group.LINK,
            "the COMMAND_ACK is IN_PROGRESS, without a final one",
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
