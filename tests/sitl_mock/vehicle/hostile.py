"""Hostile traffic, seeded: what a receiver of MAVLink has to survive without noticing.

Two kinds of frames: those that no vehicle may act upon (noise, cut, corrupted, for others, unknown, unsigned or signed
with a wrong key), and those that are right in form but carry any bits in their fields.
"""

from __future__ import annotations

import math
import struct
from random import Random
from typing import TYPE_CHECKING, Final, NamedTuple

from fastcrc.crc16 import mcrf4xx

from sitl_mock.mavlink import SPEC_BY_ID, SPEC_BY_NAME, MessageSpec, Signing

if TYPE_CHECKING:
    from collections.abc import Callable

_FILLS: Final = (b"\x00", b"\xff", b"\x7f", b"\x80", b"\x01")
COMMANDS: Final = (
    16,
    20,
    21,
    22,
    92,
    93,
    115,
    176,
    177,
    178,
    179,
    185,
    192,
    193,
    195,
    209,
    241,
    246,
    252,
    300,
    400,
    410,
    500,
    510,
    511,
    512,
    519,
    520,
    521,
    2000,
    2510,
    3000,
    42_000,
)
WRONG_KEY: Final = bytes(range(100, 132))


class Target(NamedTuple):
    """A message with a target.

    Attributes:
        spec: The message.
        system_at: Offset of target_system in the payload.
        component_at: Offset of target_component, or None.
    """

    spec: MessageSpec
    system_at: int
    component_at: int | None


def _offset(spec: MessageSpec, field: str) -> int | None:
    at = 0
    for wire_field in spec.wire_fields:
        if wire_field.name == field:
            return at
        at += wire_field.size
    return None


def _targets() -> tuple[Target, ...]:
    found = []
    for spec in SPEC_BY_ID.values():
        system_at = _offset(spec, "target_system")
        # An answer to a ping is for whom it names
        if system_at is not None and spec.name not in {"PING"}:
            found.append(Target(spec, system_at, _offset(spec, "target_component")))
    return tuple(found)


TARGETS: Final = _targets()
_COMMAND_TARGETS: Final = tuple(
    target for target in TARGETS if target.spec.name in {"COMMAND_LONG", "COMMAND_INT"}
)


class HostileTraffic:
    """A seeded source of frames.

    Args:
        seed: The same seed gives the same frames.
        system_id: The vehicle under attack.
    """

    def __init__(self, seed: int, system_id: int = 1) -> None:
        self._rng = Random(seed)
        self._system_id = system_id
        self._wrong = Signing(WRONG_KEY, timestamp=10**14)
        self.kinds: Final[dict[str, Callable[[], bytes]]] = {
            "noise": self.noise,
            "truncated": self.truncated,
            "corrupted": self.corrupted,
            "foreign": self.foreign,
            "unknown": self.unknown,
            "incompatible": self.incompatible,
        }
        self.kinds_against_signing: Final[dict[str, Callable[[], bytes]]] = {
            **self.kinds,
            "unsigned": self.own,
            "wrong_key": self.wrong_key,
        }

    def noise(self) -> bytes:
        """Return random bytes, rich in magic bytes."""
        data = bytearray(self._rng.randbytes(self._rng.randrange(1, 300)))
        for _ in range(self._rng.randrange(4)):
            data[self._rng.randrange(len(data))] = self._rng.choice((0xFD, 0xFE))
        return bytes(data)

    def own(self) -> bytes:
        """Return a frame that is right in form, for this vehicle or for all, with any bits in its fields."""
        rng = self._rng
        if rng.random() < 0.3:
            spec = rng.choice(tuple(SPEC_BY_ID.values()))
            return _frame(spec, self._payload(spec), rng, self._source())
        return self._aimed(rng.choice((self._system_id, 0)), rng.choice((0, 1)))

    def foreign(self) -> bytes:
        """Return a right frame that names another system or component."""
        rng = self._rng
        if rng.random() < 0.5:
            return self._aimed(
                rng.choice([n for n in (2, 77, 255) if n != self._system_id]),
                rng.choice((0, 1, 190)),
            )
        return self._aimed(self._system_id, rng.choice((2, 100, 195, 255)), with_component=True)

    def truncated(self) -> bytes:
        """Return the beginning of a right frame."""
        frame = self.own()
        return frame[: self._rng.randrange(1, len(frame))]

    def corrupted(self) -> bytes:
        """Return a right frame with up to three wrong bits behind its length; CRC-16 detects them all."""
        frame = bytearray(self.own())
        for bit in self._rng.sample(range(8 * 4, 8 * len(frame)), self._rng.randrange(1, 4)):
            frame[bit // 8] ^= 1 << bit % 8
        return bytes(frame)

    def unknown(self) -> bytes:
        """Return a frame with a message id that no dialect has."""
        rng = self._rng
        message_id = rng.choice([n for n in (60_000, 0xFFFFFF, 20_000) if n not in SPEC_BY_ID])
        body = (
            bytes((9, 0, 0, rng.randrange(256), 255, 190))
            + message_id.to_bytes(3, "little")
            + rng.randbytes(9)
        )
        return b"\xfd" + body + struct.pack("<H", mcrf4xx(body + b"\x00"))

    def incompatible(self) -> bytes:
        """Return a right frame with a flag that must be understood and is not."""
        frame = bytearray(self.own())
        frame[2] |= self._rng.choice((0x02, 0x40, 0x80))
        return bytes(frame)

    def wrong_key(self) -> bytes:
        """Return a right frame for this vehicle, signed with a key that is not its own."""
        frame = bytearray(self.own())
        frame[2] |= 1
        spec = SPEC_BY_ID[int.from_bytes(frame[7:10], "little")]
        frame[-2:] = struct.pack("<H", mcrf4xx(bytes(frame[1:-2]) + spec.crc_extra))
        return bytes(frame) + self._wrong.block(bytes(frame), 1)

    def _source(self) -> tuple[int, int]:
        return self._rng.choice(((255, 190), (1, 195), (42, 191)))

    def _aimed(self, system: int, component: int, *, with_component: bool = False) -> bytes:
        rng = self._rng
        target = rng.choice(_COMMAND_TARGETS) if rng.random() < 0.4 else rng.choice(TARGETS)
        while with_component and target.component_at is None:
            target = rng.choice(TARGETS)
        payload = self._payload(target.spec)
        payload[target.system_at] = system
        if target.component_at is not None:
            payload[target.component_at] = component
        return _frame(target.spec, payload, rng, self._source())

    def _payload(self, spec: MessageSpec) -> bytearray:
        rng = self._rng
        draw = rng.random()
        if draw < 0.4:
            payload = bytearray(rng.randbytes(spec.size))
        else:
            payload = bytearray(rng.choice(_FILLS) * spec.size)
            for _ in range(rng.randrange(6)):
                payload[rng.randrange(spec.size)] = rng.randrange(256)
        if spec.name in {"COMMAND_LONG", "COMMAND_INT"}:
            self._command(spec, payload)
        return payload

    def _command(self, spec: MessageSpec, payload: bytearray) -> None:
        rng = self._rng
        at = _COMMAND_AT[spec.name]
        payload[at : at + 2] = struct.pack("<H", rng.choice(COMMANDS))
        for index in range(7 if spec.name == "COMMAND_LONG" else 4):
            if rng.random() < 0.5:
                value = rng.choice(
                    (
                        0.0,
                        1.0,
                        -1.0,
                        2.0,
                        6.0,
                        21196.0,
                        math.nan,
                        math.inf,
                        -math.inf,
                        3e38,
                        65536.0,
                    )
                )
                payload[4 * index : 4 * index + 4] = struct.pack("<f", value)


_COMMAND_AT: Final = {
    name: _offset(SPEC_BY_NAME[name], "command") or 0 for name in ("COMMAND_LONG", "COMMAND_INT")
}


def _frame(spec: MessageSpec, payload: bytearray, rng: Random, source: tuple[int, int]) -> bytes:
    short = bytes(payload).rstrip(b"\0") or b"\0"
    body = bytes((len(short), 0, 0, rng.randrange(256), *source)) + spec.id_bytes + short
    return b"\xfd" + body + struct.pack("<H", mcrf4xx(body + spec.crc_extra))
