"""A recorded flight: a .tlog read, and what others sent in it flown again by a mock vehicle at the recorded times.

A .tlog has frames of both directions, each behind its time (microseconds since 1970, 64 bits, big endian).
"""

import math
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

from sitl_mock.compare.tlog import TimedFrame, read_frames, steady_times
from sitl_mock.errors import ConfigError, require_file, require_span
from sitl_mock.mavlink import Decoder, Message
from sitl_mock.vehicle.mock_vehicle import MockVehicle
from sitl_mock.world import DEFAULT_HOME, Home

_PX4 = 12
_ARDUPILOT = 3
_AUTOPILOTS: Final = {_PX4: "PX4", _ARDUPILOT: "ArduPilot"}
_MULTICOPTERS: Final = frozenset({2, 3, 13, 14, 15, 29, 35})
_HELICOPTER = 4
_GROUND_VEHICLES: Final = frozenset({10, 11})
_FLAVOURS: Final = {
    **{(_PX4, kind): "px4" for kind in _MULTICOPTERS},
    **{(_ARDUPILOT, kind): "arducopter" for kind in _MULTICOPTERS | {_HELICOPTER}},
    **{(_ARDUPILOT, kind): "rover" for kind in _GROUND_VEHICLES},
}
"""Flavour by MAV_AUTOPILOT and MAV_TYPE."""
_TYPE_NAMES: Final = {
    1: "fixed wing",
    7: "airship",
    8: "balloon",
    9: "rocket",
    12: "submarine",
    16: "flapping wing",
    17: "kite",
    **dict.fromkeys(range(19, 26), "VTOL"),
}
_AUTOPILOT_COMPONENT = 1
_FIX_3D = 3


class Recording(NamedTuple):
    """One vehicle's flight.

    Attributes:
        flavour: px4, arducopter or rover, by its HEARTBEAT.
        system_id: The vehicle's.
        said: Time (s, from the first frame) and message of all that the vehicle sent.
        heard: Time and frame of all that others sent.
        end_s: When the last frame came.
        notes: What a reader of the comparison must know: bytes that are no frames, steps of the clock, an unknown
            home, a log without the client's side.
    """

    flavour: str
    system_id: int
    said: list[tuple[float, Message]]
    heard: list[tuple[float, bytes]]
    end_s: float
    notes: tuple[str, ...] = ()

    @property
    def one_sided(self) -> bool:
        """True if nobody but the vehicle sends in it."""
        return not self.heard


def read_tlog(path: Path) -> Recording:
    """Read the flight of the first autopilot in a file that the mock can fly.

    Bytes that are no frames are skipped and counted. A step of the recording clock is replaced by the vehicle's own.

    Raises:
        ConfigError: The file cannot be read, is no tlog, has no HEARTBEAT of PX4, ArduCopter or Rover, or is too long
            to be flown again.
    """
    require_file(path)
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror or error}") from None
    frames, notes = read_frames(path, raw)
    vehicle, flavour = _autopilot_heartbeat(path, frames)
    ids = (vehicle.get_srcSystem(), _AUTOPILOT_COMPONENT)
    times_s, steps = steady_times(frames, ids)
    require_span(str(path), times_s[-1])
    if steps:
        notes.append(
            f"the clock of the recording steps {steps} times; the vehicle's clock is used there"
        )
    messages: list[tuple[float, Message]] = []
    heard: list[tuple[float, bytes]] = []
    for time_s, frame in zip(times_s, frames, strict=True):
        message = frame.message
        if (message.get_srcSystem(), message.get_srcComponent()) == ids:
            messages.append((time_s, message))
        else:
            heard.append((time_s, frame.frame))
    if not heard:
        notes.append(
            "one-sided: only the vehicle's messages are recorded, so the mock hears no client"
        )
    if _home(messages) is None:
        notes.append("no home and no position in it; the mock flies at its default home")
    return Recording(flavour, ids[0], messages, heard, times_s[-1], tuple(notes))


def _autopilot_heartbeat(path: Path, frames: list[TimedFrame]) -> tuple[Message, str]:
    """Return the first HEARTBEAT of an autopilot that the mock can fly, and its flavour."""
    others: dict[str, None] = {}
    for frame in frames:
        message = frame.message
        if message.get_type() != "HEARTBEAT" or message.get_srcComponent() != _AUTOPILOT_COMPONENT:
            continue
        flavour = _FLAVOURS.get((message.autopilot, message.type))
        if flavour is not None:
            return message, flavour
        if message.autopilot in _AUTOPILOTS:
            kind = _TYPE_NAMES.get(message.type, "not a vehicle of the mock")
            others[f"{_AUTOPILOTS[message.autopilot]}, MAV_TYPE {message.type} ({kind})"] = None
    others_words = f"; it has {', '.join(others)}" if others else ""
    raise ConfigError(
        f"{path}: no HEARTBEAT of a PX4 multicopter, ArduCopter or Rover in {len(frames)} messages{others_words}"
    )


_STEP_S = 0.01
BOOTED_S = 60.0
"""Time from the mock's boot to the start of the recording."""


def fly_recording(recording: Recording, *, seed: int = 0) -> list[tuple[float, Message]]:
    """Return time and message of everything that a mock of the same kind sends to the recorded client.

    Stream rates requested in the recording are applied; those requested before its start are unknown.
    """
    # The heading at first; 0 if the recording has none.
    yaws = (message.yaw for _, message in recording.said if message.get_type() == "ATTITUDE")
    # PX4 sends HIGHRES_IMU only to an onboard computer.
    streams = {message.get_type() for _, message in recording.said}
    home = _home(recording.said)
    vehicle = MockVehicle(
        recording.flavour,
        system_id=recording.system_id,
        home=DEFAULT_HOME if home is None else home,
        yaw_deg=math.degrees(next(yaws, 0.0)),
        seed=seed,
        links={
            "recorded": (
                "gcs" if recording.flavour == "px4" and "HIGHRES_IMU" not in streams else "onboard"
            )
        },
        ready_after_s=0.0,
    )
    vehicle.step(-BOOTED_S)
    vehicle.step(-_STEP_S)
    decoder = Decoder()
    messages: list[tuple[float, Message]] = []
    heard = defaultdict[int, list[bytes]](list)
    for heard_s, frame in recording.heard:
        heard[round(heard_s / _STEP_S)].append(frame)
    for number in range(round(recording.end_s / _STEP_S) + 1):
        at_s = number * _STEP_S
        for frame in vehicle.step(at_s, heard.get(number, [])):
            messages += [(at_s, message) for message in decoder.feed(frame, whole=True)]
    return messages


def _home(said: list[tuple[float, Message]]) -> Home | None:
    """Home as recorded; else from the first estimated position, else from the GPS receiver; None without any."""
    first: dict[str, Message] = {}
    for _, message in said:
        name = message.get_type()
        if name in _HOMES and name not in first and _HOMES[name](message) is not None:
            first[name] = message
            if name == "HOME_POSITION":
                break
    homes = (_HOMES[name](first[name]) for name in _HOMES if name in first)
    return next(homes, None)


def _home_of(latitude: int, longitude: int, altitude_mm: int) -> Home | None:
    """Return a place on Earth, None for 0/0, which means that there is none."""
    if not (latitude or longitude) or abs(latitude) > 900_000_000 or abs(longitude) > 1_800_000_000:
        return None
    return Home(latitude * 1e-7, longitude * 1e-7, altitude_mm * 1e-3)


_HOMES: Final[dict[str, Callable[[Message], Home | None]]] = {
    "HOME_POSITION": lambda home: _home_of(home.latitude, home.longitude, home.altitude),
    "GLOBAL_POSITION_INT": lambda place: _home_of(
        place.lat, place.lon, place.alt - place.relative_alt
    ),
    "GPS_RAW_INT": lambda fix: (
        _home_of(fix.lat, fix.lon, fix.alt) if fix.fix_type >= _FIX_3D else None
    ),
}
