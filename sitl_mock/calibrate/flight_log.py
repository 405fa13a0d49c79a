"""Read the velocity commands and the motion of a flight from PX4's ULog or ArduPilot's DataFlash log.

The rows are the estimates of the longest stretch of flight under streamed velocities: PX4 in Offboard and in the air,
ArduCopter in Guided. Each row has the command that was in force.

A log has the command at intervals (PX4 0.1 s), not when it changed. A change between two samples is placed half way
between them; at the later one it would be late by half an interval, and the mock early.
"""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

from sitl_mock.errors import ConfigError
from sitl_mock.logs import dataflash, ulog

Row = tuple[float, ...]

_OFFBOARD = 14
_GUIDED = 4
_VELOCITY_TARGET = 4
_FIRST_CORE = 0
_VECTORS = frozenset({"velocity", "position"})
"""Fields of three numbers."""
_LONGEST_GAP_S = 1.0
"""A stream of setpoints with a longer gap is two streams."""
_TAKE_OFF_S = 5.0
"""PX4 limits the velocity for MPC_TKO_RAMP_T (3 s) after it has left the ground."""


class VelocityCommand(NamedTuple):
    """A commanded velocity (north, east, down) from a time on; None where none is in force."""

    at_s: float
    velocity_ned_m_s: Row | None


def is_flight_log(content: bytes) -> bool:
    """True if a file's beginning is that of a ULog or of a DataFlash log."""
    return content.startswith((ulog.MAGIC, dataflash.START))


def rows_of(content: bytes, source: str) -> list[Row]:
    """Return rows of time, commanded velocity, velocity and position (north, east, down), and the command's beginning.

    Raises:
        ConfigError: The log is damaged, or has no flight under streamed velocities.
    """
    reader = _px4 if content.startswith(ulog.MAGIC) else _arducopter
    commands, motion = reader(content, source)
    # The rows of the longest stretch in which a command is in force.
    rows: list[Row] = []
    stretch: list[Row] = []
    index = 0
    for command, following in pairwise(commands):
        if command.velocity_ned_m_s is None:
            stretch = []
        while index < len(motion) and motion[index][0] < following.at_s:
            at_s, *state = motion[index]
            index += 1
            if command.velocity_ned_m_s is not None and at_s >= command.at_s:
                stretch.append((at_s, *command.velocity_ned_m_s, *state, command.at_s))
        if len(stretch) > len(rows):
            rows = list(stretch)
    if not rows:
        raise ConfigError(
            f"{source}: no flight under velocity setpoints; PX4 logs them in Offboard, ArduCopter in Guided"
        )
    return rows


class _News(NamedTuple):
    """One change: the mode streams or not, it is on the ground or not, or a target has come.

    The velocity of a target is None if it is not a velocity alone.
    """

    at_us: int
    streams: bool | None = None
    landed: bool | None = None
    velocity_ned_m_s: Row | None = None


def _px4(content: bytes, source: str) -> tuple[list[VelocityCommand], list[Row]]:
    selection = {
        "vehicle_status": ("timestamp", "nav_state"),
        "vehicle_land_detected": ("timestamp", "landed"),
        "trajectory_setpoint": ("timestamp", "velocity", "position"),
        "vehicle_local_position_setpoint": ("timestamp", "vx", "vy", "vz", "x", "y", "z"),
        "vehicle_local_position": ("timestamp", "vx", "vy", "vz", "x", "y", "z"),
    }
    rows = ulog.read(content, selection, source)
    _require_numbers(rows, selection, source)
    news = [_News(stamp_us, streams=mode == _OFFBOARD) for stamp_us, mode in rows["vehicle_status"]]
    for stamp_us, landed in rows["vehicle_land_detected"]:
        news.append(_News(stamp_us, landed=landed))
    targets = rows["vehicle_local_position_setpoint"]  # twice as often as the other
    if not targets:
        targets = rows["trajectory_setpoint"]
    for stamp_us, *target in targets:
        velocity = tuple(target[:3])
        is_velocity = all(map(math.isfinite, velocity)) and all(map(math.isnan, target[3:]))
        news.append(_News(stamp_us, velocity_ned_m_s=velocity if is_velocity else None))
    return _commands(news), [_in_seconds(row) for row in rows["vehicle_local_position"]]


def _arducopter(content: bytes, source: str) -> tuple[list[VelocityCommand], list[Row]]:
    selection = {
        "MODE": ("TimeUS", "ModeNum"),
        "GUIP": ("TimeUS", "Type", "vX", "vY", "vZ"),
        "XKF1": ("TimeUS", "C", "VN", "VE", "VD", "PN", "PE", "PD"),
    }
    rows = dataflash.read(content, selection, source)
    _require_numbers(rows, selection, source)
    news = [_News(stamp_us, streams=mode == _GUIDED) for stamp_us, mode in rows["MODE"]]
    for stamp_us, kind, north, east, up in rows["GUIP"]:
        velocity = (north * 0.01, east * 0.01, -up * 0.01)
        is_velocity = kind == _VELOCITY_TARGET
        news.append(_News(stamp_us, velocity_ned_m_s=velocity if is_velocity else None))
    motion = [
        _in_seconds((stamp_us, *rest))
        for stamp_us, core, *rest in rows["XKF1"]
        if core == _FIRST_CORE
    ]
    return _commands(news), motion


def _require_numbers(
    rows: Mapping[str, Sequence[tuple[Any, ...]]],
    selection: Mapping[str, Sequence[str]],
    source: str,
) -> None:
    """Refuse a log whose own definitions make a text or an array of what is a number in the autopilot's logs.

    Raises:
        ConfigError: A selected field is not one number, or a vector not three.
    """
    for topic, names in selection.items():
        count = sum(3 if name in _VECTORS else 1 for name in names)
        for row in rows[topic]:
            if len(row) != count or not all(isinstance(value, int | float) for value in row):
                raise ConfigError(
                    f"{source}: {topic} has {', '.join(names)} of {repr(row)[:80]}; needed are {count} numbers"
                )


def _in_seconds(row: Row) -> Row:
    return (row[0] * 1e-6, *row[1:])


def _commands(news: list[_News]) -> list[VelocityCommand]:
    """Return the commands: a target is in force in the air, in a streamed mode, until the mode or the stream ends."""
    commands = []
    streams = False
    flies_s = -math.inf  # from then on without the limits of a take-off
    last_s = -math.inf
    for item in sorted(news, key=lambda each: each.at_us):
        at_s = item.at_us * 1e-6
        if item.streams is not None:
            streams = item.streams
        if item.landed:
            flies_s = math.inf
        elif item.landed is not None and flies_s == math.inf:
            flies_s = at_s + _TAKE_OFF_S
        if item.streams is not None or item.landed is not None:
            if not streams or at_s < flies_s:
                commands.append(VelocityCommand(at_s, None))
            continue
        began_s = (last_s + at_s) / 2.0
        if at_s - last_s > _LONGEST_GAP_S:
            commands.append(VelocityCommand(last_s + _LONGEST_GAP_S, None))
            began_s = at_s
        if commands:
            began_s = max(began_s, commands[-1].at_s)
        last_s = at_s
        in_force = streams and at_s >= flies_s
        commands.append(VelocityCommand(began_s, item.velocity_ned_m_s if in_force else None))
    commands.append(VelocityCommand(last_s + _LONGEST_GAP_S, None))
    return commands
