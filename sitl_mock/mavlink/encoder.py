"""Encode MAVLink 2 frames, with one sequence counter per link."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from fastcrc.crc16 import mcrf4xx

from sitl_mock.mavlink.dialect import SPEC_BY_NAME, EncodeError, FieldValue, spec_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sitl_mock.mavlink.dialect import MessageSpec
    from sitl_mock.mavlink.signing import Signing

_HEADER = struct.Struct("<BBxBBB3s").pack
_CRC = struct.Struct("<H").pack
_UNFIT = (struct.error, TypeError, ValueError, IndexError, OverflowError)


class Encoder:
    """One sender on one link; frames are packed from values, without a message object."""

    __slots__ = ("component_id", "link_id", "sequence", "signing", "system_id")

    def __init__(
        self, system_id: int, component_id: int, *, signing: Signing | None = None, link_id: int = 0
    ) -> None:
        self.system_id = system_id
        self.component_id = component_id
        self.signing = signing
        self.link_id = link_id
        self.sequence = 0

    def pack(self, message: str | int, *values: FieldValue) -> bytes:
        """Return one frame.

        Args:
            message: Name (fastest) or id of the message.
            values: Every field in the order of declaration; arrays as sequences, text as ``str`` or ``bytes``.

        Raises:
            EncodeError: Unknown message, wrong number of values, or a value out of its field's range.
        """
        return self.frame(SPEC_BY_NAME.get(message) or spec_of(message), values)  # type: ignore[arg-type]  # an id misses

    def frame(self, spec: MessageSpec, values: Sequence[FieldValue]) -> bytes:
        """Return one frame of a message that has been looked up before.

        Raises:
            EncodeError: Wrong number of values, or a value out of its field's range.
        """
        try:
            arrange = spec.arrange
            if arrange is None:
                payload = spec.pack(*values)
            elif len(values) == spec.count:
                payload = spec.pack(*arrange(values))
            else:
                raise struct.error(f"{spec.count} values expected, {len(values)} given")
        except _UNFIT as error:
            raise EncodeError(
                f"{spec.name}{values!r} cannot be packed: {error}; fields {spec.field_names}"
            ) from error
        if not payload[-1]:
            payload = payload.rstrip(b"\0") or payload[:1]  # at least one byte
        sequence = self.sequence
        self.sequence = (sequence + 1) & 0xFF
        signing = self.signing
        if signing is None or signing.secret_key is None:
            body = (
                _HEADER(len(payload), 0, sequence, self.system_id, self.component_id, spec.id_bytes)
                + payload
            )
            return b"\xfd" + body + _CRC(mcrf4xx(body + spec.crc_extra))
        body = (
            _HEADER(len(payload), 1, sequence, self.system_id, self.component_id, spec.id_bytes)
            + payload
        )
        frame = b"\xfd" + body + _CRC(mcrf4xx(body + spec.crc_extra))
        return frame + signing.block(frame, self.link_id)
