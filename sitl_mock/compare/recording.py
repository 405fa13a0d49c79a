"""A recorded flight: a .tlog read, and what others sent in it flown again by a mock vehicle at the recorded times.

A .tlog has frames of both directions, each behind its time (microseconds since 1970, 64 bits, big endian).
"""

import math
import struct
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from typing import Final, NamedTuple

from sitl_mock.errors import ConfigError
from sitl_mock.mavlink import Decoder, Message
from sitl_mock.vehicle import MockVehicle
from sitl_mock.world import DEFAULT_HOME, Home

_TIME: Final = struct.Struct(">Q")
_V1 = 0xFE
_V2 = 0xFD
_V1_AROUND = 8
_V2_AROUND = 12
_SIGNATURE = 13
_PX4 = 12
_ARDUPILOT = 3
_ROVER = 10
_AUTOPILOT_COMPONENT = 1


class Recording(NamedTuple):
    """One vehicle's flight.

    Attributes:
        flavour: px4, arducopter or rover, by its HEARTBEAT.
        system_id: The vehicle's.
        said: Time (s, from the first frame) and message of all that the vehicle sent.
        heard: Time and frame of all that others sent.
        end_s: When the last frame came.
    """

    flavour: str
    system_id: int
    said: list[tuple[float, Message]]
    heard: list[tuple[float, bytes]]
    end_s: float


def read_tlog(path: Path) -> Recording:
    """Read the flight of the first autopilot in a file.

    Raises:
        ConfigError: The file cannot be read, is no tlog, or has no HEARTBEAT of PX4, ArduCopter or Rover.
    """
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror or error}") from None
    decoder = Decoder()
    frames = [
        (at_us * 1e-6, message, frame)
        for at_us, frame in _frames(path, raw)
        for message in decoder.feed(frame, whole=True)
    ]
    beats = [
        m
        for _, m, _ in frames
        if m.get_type() == "HEARTBEAT" and m.get_srcComponent() == _AUTOPILOT_COMPONENT
    ]
    known = [(m, _flavour(m)) for m in beats if _flavour(m)]
    if not known:
        raise ConfigError(
            f"{path}: no HEARTBEAT of PX4, ArduCopter or Rover in {len(frames)} messages"
        )
    vehicle, flavour = known[0]
    system_id = vehicle.get_srcSystem()
    begun_s = frames[0][0]
    ids = (system_id, _AUTOPILOT_COMPONENT)
    said = [
        (t - begun_s, m) for t, m, _ in frames if (m.get_srcSystem(), m.get_srcComponent()) == ids
    ]
    heard = [
        (t - begun_s, frame)
        for t, m, frame in frames
        if (m.get_srcSystem(), m.get_srcComponent()) != ids
    ]
    return Recording(flavour, system_id, said, heard, frames[-1][0] - begun_s)


def _flavour(heartbeat: Message) -> str:
    if heartbeat.autopilot == _PX4:
        return "px4"
    if heartbeat.autopilot == _ARDUPILOT:
        return "rover" if heartbeat.type == _ROVER else "arducopter"
    return ""


def _frames(path: Path, raw: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield time and frame; a cut last frame is left out, as a recorder that was killed leaves it."""
    at = 0
    while at + _TIME.size + 3 <= len(raw):
        (time_us,) = _TIME.unpack_from(raw, at)
        at += _TIME.size
        magic = raw[at]
        length = raw[at + 1]
        flags = raw[at + 2]
        if magic == _V2:
            size = length + _V2_AROUND + (_SIGNATURE if flags & 1 else 0)
        elif magic == _V1:
            size = length + _V1_AROUND
        else:
            raise ConfigError(
                f"{path}: byte {at} is 0x{magic:02X}, no MAVLink frame; is this a .tlog?"
            )
        if at + size <= len(raw):
            yield time_us, raw[at : at + size]
        at += size


STEP_S = 0.01
BOOTED_S = 60.0
"""Time from the mock's boot to the start of the recording."""


def fly_recording(recording: Recording, *, seed: int = 0) -> list[tuple[float, Message]]:
    """Return time and message of everything that a mock of the same kind sends to the recorded client.

    Stream rates requested in the recording are applied; those requested before its start are unknown.
    """
    vehicle = MockVehicle(
        recording.flavour,
        system_id=recording.system_id,
        home=_home(recording),
        yaw_deg=_yaw_deg(recording),
        seed=seed,
        links={"recorded": _kind(recording)},
        ready_after_s=0.0,
    )
    vehicle.step(-BOOTED_S)
    vehicle.step(-STEP_S)
    decoder = Decoder()
    said: list[tuple[float, Message]] = []
    for at_s, frames in _steps(recording):
        for frame in vehicle.step(at_s, frames):
            said += [(at_s, message) for message in decoder.feed(frame, whole=True)]
    return said


def _steps(recording: Recording) -> Iterator[tuple[float, list[bytes]]]:
    """Yield the time of every step and the frames received until then."""
    due = {
        number: [frame for _, frame in frames]
        for number, frames in groupby(recording.heard, key=lambda item: round(item[0] / STEP_S))
    }
    for number in range(round(recording.end_s / STEP_S) + 1):
        yield number * STEP_S, due.get(number, [])


def _home(recording: Recording) -> Home:
    for _, message in recording.said:
        if message.get_type() == "HOME_POSITION":
            return Home(message.latitude * 1e-7, message.longitude * 1e-7, message.altitude * 1e-3)
    return DEFAULT_HOME


def _yaw_deg(recording: Recording) -> float:
    """Initial heading; 0 if unknown."""
    yaws = (message.yaw for _, message in recording.said if message.get_type() == "ATTITUDE")
    return math.degrees(next(yaws, 0.0))


def _kind(recording: Recording) -> str:
    """Kind of link; PX4 sends HIGHRES_IMU only to an onboard computer."""
    streams = {message.get_type() for _, message in recording.said}
    return "gcs" if recording.flavour == "px4" and "HIGHRES_IMU" not in streams else "onboard"
