"""MAVLink's common messages by number and by name, as pymavlink knows them."""

from typing import Final

from pymavlink.dialects.v20 import common

CRC_EXTRA: Final = {number: message.crc_extra for number, message in common.mavlink_map.items()}
NAMES: Final = {number: message.msgname for number, message in common.mavlink_map.items()}
IDS: Final = {name: number for number, name in NAMES.items()}
