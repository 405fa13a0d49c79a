"""Faults of an evader's reports: slow, old, duplicated, forged, displaced, or with a wrong clock."""

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
from sitl_mock.faults.links import LINK_KINDS, changing
from sitl_mock.faults.places import along, in_local_frame, on_earth, vector
from sitl_mock.mavlink import SPEC_BY_NAME, Encoder, Signing
from sitl_mock.tables import Option, choice, integer, number
from sitl_mock.world import Home, LocalFrame

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

REPORTS: Final = ("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED", "ODOMETRY", "FOLLOW_TARGET")
_SCOPE: Final = Scope(Direction.OUT, REPORTS, open=True)
_STAMPS: Final = {"time_boot_ms": 1e3, "time_usec": 1e6, "timestamp": 1e3}
_JUMP: Final = Option("metres", 0.0, number(-1e5, 1e5))


def _slow(inputs: EffectInputs) -> Effect:
    period_s = inputs.options["period_s"]
    last_s = dict[int, float]()

    def alter(now_s: float, frame: bytes) -> Delayed:
        number_ = frames.message_id(frame)
        if now_s - last_s.get(number_, -math.inf) < period_s - 1e-6:
            return ()
        last_s[number_] = now_s
        return ((0.0, frame),)

    return Effect(alter=alter)


def _clock(inputs: EffectInputs) -> Effect:
    options = inputs.options
    begun_s = [math.nan]

    def begin(now_s: float) -> None:
        begun_s[0] = now_s

    def wrong(now_s: float, frame: bytes) -> dict[str, float]:
        number_ = frames.message_id(frame)
        if number_ >= 0:
            fields = frames.payload_fields(number_)
        else:
            fields = {}
        stamp = next(((name, units) for name, units in _STAMPS.items() if name in fields), None)
        if stamp is None:
            return {}
        name, units = stamp
        error_s = options["offset_s"] + options["drift_ppm"] * 1e-6 * (now_s - begun_s[0])
        return {name: frames.value(frame, name) + round(error_s * units)}

    return Effect(begin=begin, alter=changing(inputs, wrong))


def _stale(inputs: EffectInputs) -> Effect:
    repeats = inputs.options["as"] == "repeats"
    last = dict[int, bytes]()

    def alter(_now_s: float, frame: bytes) -> Delayed:
        if not repeats:
            return ()
        return ((0.0, last.setdefault(frames.message_id(frame), frame)),)

    return Effect(alter=alter)


def _jump(inputs: EffectInputs) -> Effect:
    by_m = vector(inputs)
    placed = frozenset(SPEC_BY_NAME[name].message_id for name in REPORTS)

    def moved(_now_s: float, frame: bytes) -> dict[str, float]:
        if frames.message_id(frame) not in placed:
            return {}
        return on_earth(frame, by_m) or in_local_frame(frame, by_m)

    return Effect(alter=changing(inputs, moved))


def _forger(inputs: EffectInputs) -> Effect:
    """A second sender reports as this vehicle, from its position at the start and moving away."""
    vehicle = inputs.vehicle
    options = inputs.options
    autopilot = vehicle.autopilot
    by_m = vector(inputs)
    away_m_s = (options["north_m_s"], options["east_m_s"], 0.0)
    encoder = Encoder(vehicle.system_id, options["component"], signing=Signing(), link_id=102)
    link = next(iter(vehicle.links))
    period_s = 1.0 / options["rate_hz"]
    begun_s = [math.nan]
    next_s = [math.nan]
    place: list[Home] = []

    def begin(now_s: float) -> None:
        begun_s[0] = next_s[0] = now_s
        place[:] = [autopilot.frame.to_geodetic(*autopilot.state.position_m)]

    def advance(now_s: float) -> Iterable[tuple[str, bytes]]:
        frames = []
        while next_s[0] <= now_s + 1e-9:
            frames.append((link, encoder.pack("GLOBAL_POSITION_INT", *report(next_s[0], now_s))))
            next_s[0] += period_s
        return frames

    def report(at_s: float, now_s: float) -> tuple[int, ...]:
        since_s = at_s - begun_s[0]
        offset = (part + rate * since_s for part, rate in zip(by_m, away_m_s, strict=True))
        lat, lon, alt = LocalFrame(place[0]).to_geodetic(*offset)
        boot_ms = (
            autopilot.report.boot_ms - round((now_s - at_s) * 1e3) + round(options["clock_s"] * 1e3)
        )
        rates = (round(rate * 100.0) for rate in away_m_s)
        return (
            boot_ms & 0xFFFFFFFF,
            round(lat * 1e7),
            round(lon * 1e7),
            round(alt * 1e3),
            0,
            *rates,
            0,
        )

    return Effect(begin=begin, advance=advance)


def _as_evader(kind: str, meaning: str) -> FaultKind:
    """Return an impairment of links, limited to an evader's reports."""
    link = LINK_KINDS[kind]
    return FaultKind(Group.EVADER, meaning, link.make, link.options, _SCOPE)


EVADER_KINDS: Mapping[str, FaultKind] = MappingProxyType(
    {
        "evader_slow": FaultKind(
            Group.EVADER,
            "reports come rarely, once a second",
            _slow,
            {"period_s": Option("seconds between two", 1.0, number(0.0, 60.0))},
            _SCOPE,
        ),
        "evader_duplicates": _as_evader("duplicate", "reports are duplicated"),
        "evader_out_of_order": _as_evader("reorder", "reports are overtaken by later ones"),
        "evader_late": _as_evader("delay", "reports are delayed"),
        "evader_clock": FaultKind(
            Group.EVADER,
            "the evader's clock has an offset and a drift",
            _clock,
            {
                "offset_s": Option("seconds ahead", 0.0, number(-1e6, 1e6)),
                "drift_ppm": Option(
                    "millionths of the time since the fault began", 0.0, number(-1e5, 1e5)
                ),
            },
            _SCOPE,
        ),
        "evader_stale": FaultKind(
            Group.EVADER,
            "the last report is repeated with its old time, or reports stop",
            _stale,
            {"as": Option("repeats or silence", "repeats", choice("repeats", "silence"))},
            _SCOPE,
        ),
        "evader_forger": FaultKind(
            Group.EVADER,
            "a second sender reports as this vehicle too",
            _forger,
            {
                **along(_JUMP),
                "north_m_s": Option(
                    "speed of its position to the north", 0.0, number(-300.0, 300.0)
                ),
                "east_m_s": Option("the same to the east", 0.0, number(-300.0, 300.0)),
                "rate_hz": Option("reports per second", 500.0, number(0.1, 1e4)),
                "clock_s": Option(
                    "seconds that its clock is ahead of the vehicle's", 0.0, number(-1e6, 1e6)
                ),
                "component": Option("its component id", 1, integer(1, 255)),
            },
        ),
        "evader_jump": FaultKind(
            Group.EVADER,
            "reported positions are displaced",
            _jump,
            along(_JUMP),
            _SCOPE,
        ),
    }
)
