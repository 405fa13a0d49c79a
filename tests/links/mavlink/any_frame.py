"""MAVLink frames with a right checksum and any payload."""

import struct

from fastcrc import crc16
from pymavlink.dialects.v20 import common as dialect

MESSAGES = {message.msgname: message for message in dialect.mavlink_map.values()}


def framed(name: str, payload: bytes, *, system_id: int = 1) -> bytes:
    """A MAVLink 2 frame of this message; the payload may be anything."""
    message = MESSAGES[name]
    body = (
        struct.pack("<BBBBBB", len(payload), 0, 0, 0, system_id, 1)
        + message.id.to_bytes(3, "little")
        + payload
    )
    return b"\xfd" + body + struct.pack("<H", crc16.mcrf4xx(body + bytes([message.crc_extra])))
