"""Messages of MAVLink's common set that pymavlink's dialects lack, as the message classes that pymavlink would have.

PX4 sends EVENT where it used to send texts, and answers the old request for PROTOCOL_VERSION. Fields, order and sizes:
https://mavlink.io/en/messages/common.html. The CRC's seed follows from them, by the rule of
https://mavlink.io/en/guide/serialization.html.
"""

from __future__ import annotations

import struct
from typing import Any, Final, NamedTuple

from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import all as dialect

_LETTERS: Final = {
    "uint8_t": "B",
    "uint16_t": "H",
    "uint32_t": "I",
    "int32_t": "i",
    "uint64_t": "Q",
}


class _Field(NamedTuple):
    kind: str
    name: str
    length: int = 0


def _message(message_id: int, name: str, *fields: _Field) -> type[Any]:
    """A message class like pymavlink's own."""
    wire = sorted(fields, key=lambda field: -struct.calcsize(_LETTERS[field.kind]))
    described = f"{name} ".encode()
    for field in wire:
        described += f"{field.kind} {field.name} ".encode() + (
            bytes((field.length,)) if field.length else b""
        )
    seed = mcrf4xx(described)
    order = [wire.index(field) for field in fields]
    names = [field.name for field in fields]
    layout = "<" + "".join(f"{field.length or ''}{_LETTERS[field.kind]}" for field in wire)

    def __init__(self: Any, *values: Any) -> None:  # noqa: ANN401, N807 - as pymavlink's
        dialect.MAVLink_message.__init__(self, message_id, name)
        self._fieldnames = names
        for field, value in zip(fields, values, strict=True):
            setattr(self, field.name, value)

    return type(
        f"MAVLink_{name.lower()}_message",
        (dialect.MAVLink_message,),
        {
            "__init__": __init__,
            "id": message_id,
            "msgname": name,
            "fieldnames": names,
            "ordered_fieldnames": [field.name for field in wire],
            "fieldtypes": [field.kind for field in fields],
            "orders": order,
            "lengths": [field.length or 1 for field in wire],
            "array_lengths": [field.length for field in wire],
            "crc_extra": (seed & 0xFF) ^ (seed >> 8),
            "unpacker": struct.Struct(layout),
        },
    )


NEWER: Final = {
    cls.id: cls
    for cls in (
        _message(
            8,
            "LINK_NODE_STATUS",
            _Field("uint64_t", "timestamp"),
            _Field("uint8_t", "tx_buf"),
            _Field("uint8_t", "rx_buf"),
            _Field("uint32_t", "tx_rate"),
            _Field("uint32_t", "rx_rate"),
            _Field("uint16_t", "rx_parse_err"),
            _Field("uint16_t", "tx_overflows"),
            _Field("uint16_t", "rx_overflows"),
            _Field("uint32_t", "messages_sent"),
            _Field("uint32_t", "messages_received"),
            _Field("uint32_t", "messages_lost"),
        ),
        _message(
            300,
            "PROTOCOL_VERSION",
            _Field("uint16_t", "version"),
            _Field("uint16_t", "min_version"),
            _Field("uint16_t", "max_version"),
            _Field("uint8_t", "spec_version_hash", 8),
            _Field("uint8_t", "library_version_hash", 8),
        ),
        _message(
            380,
            "TIME_ESTIMATE_TO_TARGET",
            _Field("int32_t", "safe_return"),
            _Field("int32_t", "land"),
            _Field("int32_t", "mission_next_item"),
            _Field("int32_t", "mission_end"),
            _Field("int32_t", "commanded_action"),
        ),
        _message(
            410,
            "EVENT",
            _Field("uint8_t", "destination_component"),
            _Field("uint8_t", "destination_system"),
            _Field("uint32_t", "id"),
            _Field("uint32_t", "event_time_boot_ms"),
            _Field("uint16_t", "sequence"),
            _Field("uint8_t", "log_levels"),
            _Field("uint8_t", "arguments", 40),
        ),
        _message(
            411,
            "CURRENT_EVENT_SEQUENCE",
            _Field("uint16_t", "sequence"),
            _Field("uint8_t", "flags"),
        ),
        _message(
            412,
            "REQUEST_EVENT",
            _Field("uint8_t", "target_system"),
            _Field("uint8_t", "target_component"),
            _Field("uint16_t", "first_sequence"),
            _Field("uint16_t", "last_sequence"),
        ),
        _message(
            413,
            "RESPONSE_EVENT_ERROR",
            _Field("uint8_t", "target_system"),
            _Field("uint8_t", "target_component"),
            _Field("uint16_t", "sequence"),
            _Field("uint16_t", "sequence_oldest_available"),
            _Field("uint8_t", "reason"),
        ),
    )
    if cls.id not in dialect.mavlink_map
}
"""By id; what pymavlink has by itself is its own."""
