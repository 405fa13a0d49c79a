"""Faults with plausible but wrong positions and velocities: home, origin of the local frame, motion."""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

from sitl_mock.faults import frames
from sitl_mock.faults.effect import (
    Direction,
    Effect,
    EffectInputs,
    FaultKind,
    Group,
    Scope,
)
from sitl_mock.faults.links import changing
from sitl_mock.mavlink import SPEC_BY_NAME
from sitl_mock.tables import Option, choice, number
from sitl_mock.vector import Vector

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from sitl_mock.vehicle.mock_vehicle import MockVehicle

_M_PER_DEG: Final = 111_319.490_793
_JUMP: Final = Option("metres", 0.0, number(-1e5, 1e5))
_LIE: Final = Option("m/s", 0.0, number(-100.0, 100.0))
_AGAIN_S: Final = 1.0
_ON_EARTH: Final = (("lat", "lon", "alt"), ("latitude", "longitude", "altitude"))
_HOME, _ORIGIN, _LOCAL, _ODOMETRY, _ASKED = (
    SPEC_BY_NAME[name].message_id
    for name in (
        "HOME_POSITION",
        "GPS_GLOBAL_ORIGIN",
        "LOCAL_POSITION_NED",
        "ODOMETRY",
        "SET_POSITION_TARGET_LOCAL_NED",
    )
)


def along(option: Option) -> dict[str, Option]:
    """Return one option for each direction."""
    return {"north": option, "east": option, "down": option}


def vector(inputs: EffectInputs) -> Vector:
    """Return the vector in the options of `along`."""
    options = inputs.options
    return Vector((options["north"], options["east"], options["down"]))


def on_earth(frame: bytes, by_m: Vector) -> dict[str, Any]:
    """Return a message's geographic fields, displaced; empty if it has none."""
    fields = frames.payload_fields(frames.message_id(frame))
    names = next((names for names in _ON_EARTH if names[0] in fields), None)
    if names is None:
        return {}
    (lat_name, lon_name, alt_name) = names
    (north_m, east_m, down_m) = by_m
    lat = frames.value(frame, lat_name)
    east = east_m / _M_PER_DEG * 1e7 / math.cos(math.radians(lat * 1e-7))
    moved: dict[str, Any] = {
        lat_name: lat + round(north_m / _M_PER_DEG * 1e7),
        lon_name: frames.value(frame, lon_name) + round(east),
    }
    for name in (alt_name, "relative_alt"):
        if name in fields:
            moved[name] = frames.value(frame, name) - down_m * (1e3 if fields[name].whole else 1.0)
    return moved


def in_local_frame(frame: bytes, by_m: Vector) -> dict[str, Any]:
    """Return x, y and z displaced."""
    return {
        name: frames.value(frame, name) + by for name, by in zip(("x", "y", "z"), by_m, strict=True)
    }


def _repeated(vehicle: MockVehicle, *names: str) -> Effect:
    """Make an effect that sends messages at once and then every second."""
    next_s = [-math.inf]

    def begin(now_s: float) -> None:
        next_s[0] = now_s

    def advance(now_s: float) -> Iterable[tuple[str, bytes]]:
        if now_s >= next_s[0] - 1e-9:
            next_s[0] = now_s + _AGAIN_S
            vehicle.autopilot.state.news.extend(names)
        return ()

    return Effect(begin=begin, advance=advance)


def _home_jump(inputs: EffectInputs) -> Effect:
    random = inputs.random
    wander_m = inputs.options["wander_m"]
    by_m = list(vector(inputs))
    effect = _repeated(inputs.vehicle, "HOME_POSITION")

    def moved(_now_s: float, frame: bytes) -> dict[str, float]:
        if frames.message_id(frame) != _HOME:
            return {}
        by_m[:] = [part + random.gauss(0.0, wander_m) for part in by_m]
        displaced = Vector((by_m[0], by_m[1], by_m[2]))
        return {**on_earth(frame, displaced), **in_local_frame(frame, displaced)}

    effect.alter = changing(inputs, moved)
    return effect


def _origin_jump(inputs: EffectInputs) -> Effect:
    by_m = vector(inputs)
    effect = _repeated(inputs.vehicle, "GPS_GLOBAL_ORIGIN")

    def moved(_now_s: float, frame: bytes) -> dict[str, float]:
        return on_earth(frame, by_m) if frames.message_id(frame) == _ORIGIN else {}

    effect.alter = changing(inputs, moved)
    return effect


def _origin_move(inputs: EffectInputs) -> Effect:
    error = inputs.options["told"]
    north, east, down = by_m = vector(inputs)
    back_m = Vector((-north, -east, -down))
    effect = (
        _repeated(inputs.vehicle, "GPS_GLOBAL_ORIGIN", "HOME_POSITION")
        if error == "yes"
        else Effect()
    )

    def moved(_now_s: float, frame: bytes) -> dict[str, float]:
        number_ = frames.message_id(frame)
        if number_ in {_LOCAL, _ODOMETRY, _HOME}:
            return in_local_frame(frame, back_m)
        if number_ == _ASKED:
            return in_local_frame(frame, by_m)
        if number_ == _ORIGIN and error == "yes":
            return on_earth(frame, by_m)
        return {}

    effect.alter = changing(inputs, moved)
    return effect


def _velocity_lie(inputs: EffectInputs) -> Effect:
    by_m_s = vector(inputs)

    def wrong(_now_s: float, frame: bytes) -> dict[str, float]:
        if frames.message_id(frame) >= 0:
            fields = frames.payload_fields(frames.message_id(frame))
        else:
            fields = {}
        if "vx" not in fields:
            return {}
        units = 100.0 if fields["vx"].whole else 1.0  # cm/s in whole numbers
        parts = zip(("vx", "vy", "vz"), by_m_s, strict=True)
        return {name: frames.value(frame, name) + by * units for name, by in parts}

    return Effect(alter=changing(inputs, wrong))


PLACE_KINDS: Mapping[str, FaultKind] = MappingProxyType(
    {
        "home_jump": FaultKind(
            Group.LINK,
            "HOME_POSITION is displaced and may wander",
            _home_jump,
            {
                **along(_JUMP),
                "wander_m": Option("standard deviation of each step", 0.0, number(0.0, 1e3)),
            },
            Scope(Direction.OUT, ("HOME_POSITION",)),
        ),
        "origin_jump": FaultKind(
            Group.LINK,
            "GPS_GLOBAL_ORIGIN is displaced",
            _origin_jump,
            along(_JUMP),
            Scope(Direction.OUT, ("GPS_GLOBAL_ORIGIN",)),
        ),
        "origin_move": FaultKind(
            Group.LINK,
            "the local frame and all positions in it move, with or without an announcement",
            _origin_move,
            {**along(_JUMP), "told": Option("yes or no", "yes", choice("yes", "no"))},
            Scope(
                Direction.BOTH,
                (
                    "LOCAL_POSITION_NED",
                    "ODOMETRY",
                    "HOME_POSITION",
                    "GPS_GLOBAL_ORIGIN",
                    "SET_POSITION_TARGET_LOCAL_NED",
                ),
            ),
        ),
        "velocity_lie": FaultKind(
            Group.LINK,
            "reported velocities have an error; positions are right",
            _velocity_lie,
            along(_LIE),
            Scope(Direction.OUT, ("LOCAL_POSITION_NED", "GLOBAL_POSITION_INT"), open=True),
        ),
    }
)
