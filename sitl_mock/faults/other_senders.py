"""Other senders on the link: a component that poses as an autopilot, a second vehicle with the same id, long texts."""

from __future__ import annotations

import math
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
from sitl_mock.faults.links import always
from sitl_mock.faults.places import along, vector
from sitl_mock.mavlink import Encoder
from sitl_mock.protocols import StatusTexts
from sitl_mock.tables import Option, integer, number
from sitl_mock.tables import text as a_text
from sitl_mock.vector import Vector
from sitl_mock.vehicle.mock_vehicle import MockVehicle

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

_CUSTOM_MODE_ENABLED: Final = 1
_ONBOARD_CONTROLLER: Final = 18
_LOCAL_NED: Final = 1
_VELOCITY_ONLY: Final = 0b0000_1101_1100_0111
_TEXT_ID: Final = 40_000
_LONG_TEXT: Final = (
    "Preflight Fail: the compass is inconsistent by 32 degrees, the barometer is stale "
    "and the accelerometer bias is high"
)
GUIDED_OF: Final = {"px4": "OFFBOARD", "arducopter": "GUIDED", "rover": "GUIDED"}


def mode_named(vehicle: MockVehicle, name: str) -> str:
    """Return the vehicle's name of a mode; OFFBOARD and GUIDED are synonyms.

    Raises:
        ConfigError: It has no such mode.
    """
    mode = GUIDED_OF[vehicle.flavour] if name in {"OFFBOARD", "GUIDED"} else name
    if mode not in vehicle.modes:
        raise ConfigError(f"mode = {name!r}: allowed are {', '.join(vehicle.modes)}")
    return mode


def _foreign_heartbeat(inputs: EffectInputs) -> Effect:
    vehicle = inputs.vehicle
    options = inputs.options
    flavour = vehicle.autopilot.flavour
    custom_mode = flavour.modes.by_name()[mode_named(vehicle, options["mode"])].number
    encoder = Encoder(
        vehicle.system_id, options["component"], signing=vehicle.autopilot.signing, link_id=100
    )
    next_s = [0.0]

    def advance(now_s: float) -> Iterable[tuple[str, bytes]]:
        if now_s < next_s[0] - 1e-9:
            return ()
        next_s[0] = now_s + options["period_s"]
        fields = (_ONBOARD_CONTROLLER, flavour.autopilot, _CUSTOM_MODE_ENABLED, custom_mode, 4, 3)
        return [(link, encoder.pack("HEARTBEAT", *fields)) for link in vehicle.links]

    return Effect(advance=advance)


def _sysid_clash(inputs: EffectInputs) -> Effect:
    vehicle = inputs.vehicle
    options = inputs.options
    settings = vehicle.autopilot.settings
    link = next(iter(vehicle.links))
    start = settings.start_ned
    sender = MockVehicle(
        vehicle.flavour,
        system_id=vehicle.system_id,
        home=settings.home,
        start_ned=Vector((start[0] + options["north_m"], start[1] + options["east_m"], start[2])),
        seed=settings.seed + 1,
        ready_after_s=0.0,
        links={link: "onboard"},
    )
    inbox: list[bytes] = []

    def hear(_now_s: float, frame: bytes) -> Delayed:
        inbox.append(frame)
        return ((0.0, frame),)

    def advance(now_s: float) -> Iterable[tuple[str, bytes]]:
        frames = list(inbox)
        inbox[:] = []
        return [(link, frame) for frame in sender.step(now_s, frames)]

    return Effect(alter=hear, advance=advance)


def _position_forger(inputs: EffectInputs) -> Effect:
    """After each position of the vehicle another sender reports a displaced one, stamped later, with its ids."""
    ahead_ms = 1e3 * inputs.options["ahead_s"]
    displaced = dict(zip(("x", "y", "z"), vector(inputs), strict=True))

    def alter(_now_s: float, frame: bytes) -> Delayed:
        values = {name: frames.value(frame, name) + metres for name, metres in displaced.items()}
        values["time_boot_ms"] = frames.value(frame, "time_boot_ms") + ahead_ms
        return ((0.0, frame), (0.0, frames.changed(frame, values)))

    return Effect(alter=always(alter, inputs))


def _second_source(inputs: EffectInputs) -> Effect:
    """A second program commands the vehicle over the first link."""
    vehicle = inputs.vehicle
    options = inputs.options
    link = next(iter(vehicle.links))
    velocity = vector(inputs)
    encoder = Encoder(options["system"], 190, signing=vehicle.autopilot.signing, link_id=101)
    next_s = [-math.inf]

    def advance(now_s: float) -> Iterable[tuple[str, bytes]]:
        if now_s < next_s[0] - 1e-9:
            return ()
        next_s[0] = now_s + 1.0 / options["rate_hz"]
        stamp = vehicle.autopilot.report.boot_ms
        fields = (
            stamp,
            vehicle.system_id,
            1,
            _LOCAL_NED,
            _VELOCITY_ONLY,
            0,
            0,
            0,
            *velocity,
            0,
            0,
            0,
            0,
            0,
        )
        frame = encoder.pack("SET_POSITION_TARGET_LOCAL_NED", *fields)
        return [(link, reply) for reply in vehicle.links[link].receive(now_s, frame)]

    return Effect(advance=advance)


def _statustext(inputs: EffectInputs) -> Effect:
    vehicle = inputs.vehicle
    options = inputs.options
    waiting: list[tuple[str, bytes]] = []

    def begin(_now_s: float) -> None:
        replies = StatusTexts().replies(options["severity"], options["text"])
        own_id = _TEXT_ID + inputs.random.randrange(1000)
        relabelled = [
            (name, severity, chunk, own_id if of else 0, seq)
            for name, severity, chunk, of, seq in replies
        ]
        for name, link in vehicle.links.items():
            waiting.extend((name, frame) for frame in link.pack(relabelled))

    def advance(_now_s: float) -> Iterable[tuple[str, bytes]]:
        frames = list(waiting)
        waiting[:] = []
        return frames

    def alter(_now_s: float, frame: bytes) -> Delayed:
        lost = (
            frames.value(frame, "id") and frames.value(frame, "chunk_seq") == options["lost_chunk"]
        )
        if lost:
            return ()
        return ((0.0, frame),)

    return Effect(begin=begin, advance=advance, alter=alter)


OTHER_SENDER_KINDS: Mapping[str, FaultKind] = MappingProxyType(
    {
        "foreign_heartbeat": FaultKind(
            Group.LINK,
            "another component of the same system sends HEARTBEAT with a custom mode (deceives MAVSDK 4.1)",
            _foreign_heartbeat,
            {
                "component": Option("component id", 191, integer(2, 255)),
                "mode": Option("the mode it claims", "OFFBOARD", a_text),
                "period_s": Option("seconds between two", 1.0, number(0.01, 60.0)),
            },
        ),
        "sysid_clash": FaultKind(
            Group.LINK,
            "a second autopilot with the same ids sends and answers on the first link",
            _sysid_clash,
            {
                "north_m": Option(
                    "where it stands from the start of the first", 100.0, number(-1e5, 1e5)
                ),
                "east_m": Option("as above", 0.0, number(-1e5, 1e5)),
            },
            Scope(Direction.IN),
        ),
        "position_forger": FaultKind(
            Group.LINK,
            "another sender reports displaced positions with the vehicle's ids, stamped ahead of the true ones",
            _position_forger,
            {
                **along(Option("metres", 0.0, number(-1e5, 1e5))),
                "ahead_s": Option("seconds by which its stamps are ahead", 0.3, number(0.0, 60.0)),
                "probability": Option("share of positions that it follows", 1.0, number(0.0, 1.0)),
            },
            Scope(Direction.OUT, ("LOCAL_POSITION_NED",)),
        ),
        "second_source": FaultKind(
            Group.LINK,
            "another program sends velocity setpoints to the vehicle",
            _second_source,
            {
                **along(Option("m/s", 0.0, number(-20.0, 20.0))),
                "rate_hz": Option("reports per second", 10.0, number(0.1, 100.0)),
                "system": Option("its system id", 254, integer(1, 255)),
            },
        ),
        "statustext": FaultKind(
            Group.LINK,
            "a STATUSTEXT in chunks, one of them may be lost",
            _statustext,
            {
                "text": Option("any length", _LONG_TEXT, a_text),
                "severity": Option("MAV_SEVERITY", 2, integer(0, 7)),
                "lost_chunk": Option(
                    "number of the chunk that is lost, -1 for none", -1, integer(-1, 255)
                ),
            },
            Scope(Direction.OUT, ("STATUSTEXT",)),
            for_s=0.5,
        ),
    }
)
