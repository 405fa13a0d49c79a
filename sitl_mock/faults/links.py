"""Impairments of a link: frames may be lost, duplicated, delayed, reordered or damaged."""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

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
from sitl_mock.mavlink import Signing
from sitl_mock.tables import Option, integer, number
from sitl_mock.telemetry.status import heartbeat

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from sitl_mock.faults.effect import Alter

ANY: Final = Scope(Direction.BOTH, open=True)
OUT: Final = Scope(Direction.OUT, open=True)
_SHARE: Final = Option("share of the frames", 1.0, number(0.0, 1.0))
_MOST_S: Final = 60.0
_SLACK_S: Final = 1e-9


def always(alter: Alter, inputs: EffectInputs) -> Alter:
    """Alter frames with the fault's `probability`."""
    random = inputs.random.random
    share = inputs.options["probability"]

    def sometimes(now_s: float, frame: bytes) -> Delayed:
        if random() < share:
            return alter(now_s, frame)
        return ((0.0, frame),)

    return sometimes


def changing(
    inputs: EffectInputs, changes_of: Callable[[float, bytes], Mapping[str, float]]
) -> Alter:
    """Give fields of a frame new values, by name; without new values the frame stays.

    Args:
        inputs: Of the fault; its vehicle signs a signed frame again.
        changes_of: Called with the time and the frame.
    """
    signing = inputs.vehicle.autopilot.signing

    def alter(now_s: float, frame: bytes) -> Delayed:
        changes = changes_of(now_s, frame)
        return ((0.0, frames.changed(frame, changes, signing.secret_key) if changes else frame),)

    return alter


def _lose(_now_s: float, _frame: bytes) -> Delayed:
    """Lose a frame."""
    return ()


def _burst_loss(inputs: EffectInputs) -> Effect:
    """Lose bursts of frames, as a fading radio does (Gilbert's channel, in time)."""
    random = inputs.random
    means_s = (inputs.options["good_s"], inputs.options["lost_s"])
    fading = [False]
    until_s = [math.nan]

    def alter(now_s: float, frame: bytes) -> Delayed:
        if math.isnan(until_s[0]):
            until_s[0] = now_s + random.expovariate(1.0 / means_s[0])
        while now_s >= until_s[0]:
            fading[0] = not fading[0]
            until_s[0] += random.expovariate(1.0 / means_s[fading[0]])
        if fading[0]:
            return ()
        return ((0.0, frame),)

    return Effect(alter=alter)


def _duplicate(inputs: EffectInputs) -> Effect:
    late_s = inputs.options["late_s"]
    copies = inputs.options["copies"]
    return Effect(
        alter=always(lambda _now_s, frame: ((0.0, frame), *(((late_s, frame),) * copies)), inputs),
    )


def _delay(inputs: EffectInputs) -> Effect:
    full_s = inputs.options["delay_s"]
    jitter_s = inputs.options["jitter_s"]
    grows_s = inputs.options["grows_s"]
    random = inputs.random.random
    begun_s = [math.nan]

    def late(now_s: float, frame: bytes) -> Delayed:
        if math.isnan(begun_s[0]):
            begun_s[0] = now_s
        share = 1.0
        if grows_s > 0.0:
            share = min(1.0, (now_s - begun_s[0]) / grows_s)
        return ((share * full_s + jitter_s * random(), frame),)

    return Effect(alter=always(late, inputs))


def _corrupt(inputs: EffectInputs) -> Effect:
    bits = inputs.options["bits"]
    random = inputs.random

    def damage(_now_s: float, frame: bytes) -> Delayed:
        damaged = bytearray(frame)
        first = 10 if frame[:1] == b"\xfd" else 6
        end = len(frame) - (13 if first == 10 and frame[2:3] == b"\x01" else 0)
        wrong = range(8 * first, 8 * end) if end > first else range(8 * len(frame))
        # CRC-16 detects every change of up to 3 bits
        for bit in random.sample(wrong, min(bits, len(wrong))):
            damaged[bit // 8] ^= 1 << bit % 8
        return ((0.0, bytes(damaged)),)

    return Effect(alter=always(damage, inputs))


def _as_v1(inputs: EffectInputs) -> Effect:
    del inputs

    def downgrade(_now_s: float, frame: bytes) -> Delayed:
        if frames.message_id(frame) < 0:
            return ((0.0, frame),)
        short = frames.as_v1(frame)
        if short is None:
            return ()
        return ((0.0, short),)

    return Effect(alter=downgrade)


def _sign(inputs: EffectInputs) -> Effect:
    signing = Signing(
        bytes((inputs.options["key_byte"],)) * 32, timestamp=inputs.options["timestamp"]
    )

    def sign(_now_s: float, frame: bytes) -> Delayed:
        return ((0.0, frame if frames.message_id(frame) < 0 else frames.signed(frame, signing)),)

    return Effect(alter=sign)


def _gap(inputs: EffectInputs) -> Effect:
    """Pass one more HEARTBEAT, then none until the gap ends, then one at once."""
    vehicle = inputs.vehicle
    gap_s = inputs.options["gap_s"]
    until_s = [math.nan]

    def alter(now_s: float, frame: bytes) -> Delayed:
        if math.isnan(until_s[0]):
            until_s[0] = now_s + gap_s
            return ((0.0, frame),)
        if now_s < until_s[0] - _SLACK_S:
            return ()
        return ((0.0, frame),)

    def advance(now_s: float) -> Iterable[tuple[str, bytes]]:
        if not (math.isfinite(until_s[0]) and now_s >= until_s[0] - _SLACK_S):
            return ()
        beat = ("HEARTBEAT", *heartbeat(vehicle.autopilot.report))
        until_s[0] = -math.inf
        sent = list[tuple[str, bytes]]()
        for name, link in vehicle.links.items():
            sent += [(name, frame) for frame in link.pack([beat])]
        return sent

    return Effect(alter=alter, advance=advance)


LINK_KINDS: Mapping[str, FaultKind] = MappingProxyType(
    {
        "loss": FaultKind(
            Group.LINK,
            "frames are lost",
            lambda inputs: Effect(alter=always(_lose, inputs)),
            {"probability": _SHARE},
            ANY,
        ),
        "burst_loss": FaultKind(
            Group.LINK,
            "frames are lost in bursts",
            _burst_loss,
            {
                "good_s": Option("mean seconds between two bursts", 1.0, number(0.01, 1e3)),
                "lost_s": Option("mean seconds of a burst", 0.3, number(0.01, 1e3)),
            },
            ANY,
        ),
        "duplicate": FaultKind(
            Group.LINK,
            "frames are duplicated",
            _duplicate,
            {
                "probability": _SHARE,
                "copies": Option("how many more", 1, integer(1, 10)),
                "late_s": Option(
                    "seconds by which the copies come later", 0.0, number(0.0, _MOST_S)
                ),
            },
            ANY,
        ),
        "reorder": FaultKind(
            Group.LINK,
            "frames are overtaken by later ones",
            lambda inputs: Effect(
                alter=always(lambda _now_s, frame: ((inputs.options["by_s"], frame),), inputs)
            ),
            {
                "probability": Option("share of the frames", 0.2, number(0.0, 1.0)),
                "by_s": Option("seconds by which they are held back", 0.1, number(0.0, _MOST_S)),
            },
            ANY,
        ),
        "delay": FaultKind(
            Group.LINK,
            "frames are delayed",
            _delay,
            {
                "probability": _SHARE,
                "delay_s": Option("seconds", 0.2, number(0.0, _MOST_S)),
                "grows_s": Option("seconds in which it grows to that", 0.0, number(0.0, 1e6)),
                "jitter_s": Option(
                    "up to so many seconds more, evenly spread", 0.0, number(0.0, _MOST_S)
                ),
            },
            ANY,
        ),
        "corrupt": FaultKind(
            Group.LINK,
            "frames are damaged so that the CRC does not match",
            _corrupt,
            {"probability": _SHARE, "bits": Option("how many bits are flipped", 1, integer(1, 3))},
            ANY,
        ),
        "heartbeat_gap": FaultKind(
            Group.LINK,
            "one long gap between two HEARTBEATs (MAVSDK disconnects after 3 s)",
            _gap,
            {
                "gap_s": Option(
                    "seconds from the last one before to the first one after", 3.1, number(0.0, 1e6)
                )
            },
            Scope(Direction.OUT, ("HEARTBEAT",)),
        ),
        "v1_frames": FaultKind(
            Group.LINK, "frames are MAVLink 1; others are lost", _as_v1, scope=OUT
        ),
        "signed_frames": FaultKind(
            Group.LINK,
            "frames are signed with a key that the receiver may lack",
            _sign,
            {
                "key_byte": Option("the key is this byte, 32 times", 7, integer(0, 255)),
                "timestamp": Option(
                    "10 µs since 2015 at which the signatures begin", 10**13, integer(0, 2**48 - 1)
                ),
            },
            OUT,
        ),
        "router_restart": FaultKind(
            Group.LINK,
            "the Zenoh router restarts; in stepped time all frames are lost meanwhile",
            lambda _inputs: Effect(alter=_lose, transport="router_restart"),
            scope=Scope(Direction.BOTH),
            for_s=1.0,
        ),
        "udp_port_change": FaultKind(
            Group.LINK,
            "the vehicle changes its UDP port",
            lambda _inputs: Effect(transport="udp_port_change"),
            for_s=0.0,
        ),
    }
)
