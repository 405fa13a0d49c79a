"""Reading a .tlog: frames of both directions, each behind its time (microseconds since 1970, 64 bits, big endian)."""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

from sitl_mock.errors import ConfigError
from sitl_mock.mavlink import Decoder, Message

_TIME: Final = struct.Struct(">Q")
_V1, _V2 = 0xFE, 0xFD
_V1_AROUND, _V2_AROUND, _SIGNATURE = 8, 12, 13
_PX4, _ARDUPILOT = 12, 3
_ROVER, _AUTOPILOT_COMPONENT = 10, 1


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
    beats = [m for _, m, _ in frames if m.get_type() == "HEARTBEAT" and m.get_srcComponent() == _AUTOPILOT_COMPONENT]
    known = [(m, _flavour(m)) for m in beats if _flavour(m)]
    if not known:
        raise ConfigError(f"{path}: no HEARTBEAT of PX4, ArduCopter or Rover in {len(frames)} messages")
    vehicle, flavour = known[0]
    system_id, begun_s = vehicle.get_srcSystem(), frames[0][0]
    ids = (system_id, _AUTOPILOT_COMPONENT)
    said = [(t - begun_s, m) for t, m, _ in frames if (m.get_srcSystem(), m.get_srcComponent()) == ids]
    heard = [(t - begun_s, frame) for t, m, frame in frames if (m.get_srcSystem(), m.get_srcComponent()) != ids]
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
        magic, length, flags = raw[at], raw[at + 1], raw[at + 2]
        if magic == _V2:
            size = length + _V2_AROUND + (_SIGNATURE if flags & 1 else 0)
        elif magic == _V1:
            size = length + _V1_AROUND
        else:
            raise ConfigError(f"{path}: byte {at} is 0x{magic:02X}, no MAVLink frame; is this a .tlog?")
        if at + size <= len(raw):
            yield time_us, raw[at : at + size]
        at += size
