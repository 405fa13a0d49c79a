"""How the autopilots store a mission item: a client gets back what they keep of it, not what it sent.

A row of a table has one letter per parameter:

* ``f``: kept as a float; ``0``: not kept.
* ``B``, ``b``, ``H``, ``h``: truncated to an integer of 8 or 16 bits, unsigned or signed.
* ``y``: a heading, brought into 0 to 360 degrees; ``?``: whether it is above 0.

Sources: ``mavlink_mission.cpp`` of PX4 1.17 and ``AP_Mission.cpp`` of ArduPilot 4.5, and downloads from both.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from sitl_mock.protocols.command import MISSION_FRAME
from sitl_mock.protocols.plan import MissionResult, PlanItem

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

_AMSL: Final = frozenset({0, 5})
_RELATIVE: Final = frozenset({3, 6})
_OVER_TERRAIN: Final = frozenset({10, 11})
_BITS: Final = {"B": (0xFF, 0), "b": (0xFF, 0x80), "H": (0xFFFF, 0), "h": (0xFFFF, 0x8000)}
"""Mask and sign bit of each integer."""


def _stored_param(letter: str, value: float) -> float:
    if letter == "f":
        return value
    if letter == "0":
        return 0.0
    if letter == "y":
        return value % 360.0 if math.isfinite(value) else value
    if letter == "?":
        return float(value > 0.0)
    mask, sign = _BITS[letter]
    whole = int(value) & mask if math.isfinite(value) else 0
    return float(whole - 2 * sign if whole & sign else whole)


def _rewritten(item: PlanItem, letters: str) -> PlanItem:
    values = (item.param1, item.param2, item.param3, item.param4)
    p1, p2, p3, p4 = (
        _stored_param(letter, value) for letter, value in zip(letters, values, strict=True)
    )
    return item._replace(param1=p1, param2=p2, param3=p3, param4=p4)


# -- PX4 ---------------------------------------------------------------------------------------------------------------

_PX4_PLACES: Final[Mapping[int, str]] = {
    16: "ff0y",
    17: "00fy",
    19: "f?f?",
    21: "0H0y",
    22: "000y",
    31: "?f0?",
    80: "0000",
    84: "000y",
    85: "000y",
    195: "0000",
    201: "0000",
    400: "0000",
    4501: "0000",
}
"""Items with a place."""
_PX4_OTHERS: Final = frozenset(
    {
        *(20, 80, 93, 112, 114, 177, 178, 179, 187, 189, 196, 197, 200, 201, 203, 204, 205, 206),
        *(211, 214, 260, 400, 530, 532, 534, 1000, 1001, 2000, 2001, 2003, 2500, 2501, 3000),
        42600,
    }
)
"""Items without a place, in the frame MISSION."""
_ROI: Final = frozenset({80, 201})
_ROI_WITH_PLACE: Final = frozenset({0, 3})
_ROI_WITHOUT_PLACE: Final = frozenset({0, 1, 2})
_JUMP: Final = 177
PX4_COMMANDS: Final = frozenset(_PX4_PLACES) | _PX4_OTHERS


def stored_by_px4(item: PlanItem) -> PlanItem | MissionResult:
    """Return what PX4 stores of an item, or why it refuses it."""
    without_place = item.frame == MISSION_FRAME
    if not without_place and item.frame not in _AMSL | _RELATIVE:
        return MissionResult.UNSUPPORTED_FRAME
    if item.command not in (_PX4_OTHERS if without_place else _PX4_PLACES):
        return MissionResult.UNSUPPORTED
    roi_modes = _ROI_WITHOUT_PLACE if without_place else _ROI_WITH_PLACE
    mode = int(item.param1) if math.isfinite(item.param1) else None
    if item.command in _ROI and mode not in roi_modes:
        return MissionResult.INVALID_PARAM1
    if without_place:
        return _rewritten(item, "hHff" if item.command == _JUMP else "ffff")
    frame = 5 if item.frame in _AMSL else 6
    return _rewritten(item, _PX4_PLACES[item.command])._replace(frame=frame)


# -- ArduPilot ---------------------------------------------------------------------------------------------------------

_ARDUPILOT: Final[Mapping[int, str]] = {
    16: "H000",
    20: "0000",
    22: "H000",
    30: "H000",
    82: "H000",
    83: "ffB0",
    84: "0000",
    85: "H000",
    92: "H000",
    93: "fbbb",
    112: "f000",
    114: "f000",
    115: "ffbB",
    177: "Hh00",
    178: "Bff0",
    179: "H000",
    181: "BB00",
    182: "Bhf0",
    183: "BH00",
    184: "BHhf",
    189: "0000",
    191: "0000",
    193: "H000",
    194: "H000",
    201: "H000",
    202: "BHBH",
    203: "BBbB",
    205: "fff0",
    206: "f0B0",
    207: "H000",
    208: "H000",
    210: "H000",
    211: "BB00",
    212: "H000",
    213: "ffB0",
    215: "H000",
    216: "H000",
    217: "Hfff",
    218: "HB00",
    222: "Hfff",
    531: "Bf00",
    532: "Bf00",
    534: "BBB0",
    600: "H000",
    601: "Hh00",
    1000: "bhbb",
    2000: "BfHH",
    2001: "H000",
    2500: "B000",
    2501: "B000",
    3000: "B000",
    42600: "BBff",
    42702: "BBff",
    42703: "Hhbh",
}
_ARDUPILOT_PLACES: Final = frozenset(
    {16, 17, 18, 19, 21, 22, 30, 31, 82, 84, 85, 92, 94, 179, 189, 191, 201}
)
"""Items that are stored with a place; of all others coordinates and frame are lost."""
_MAY_BE_NAN: Final[Mapping[int, frozenset[int]]] = {
    16: frozenset({4}),
    21: frozenset({4}),
    22: frozenset({4}),
    84: frozenset({4}),
    85: frozenset({3, 4}),
}
_NAN_RESULTS: Final = (
    MissionResult.INVALID_PARAM1,
    MissionResult.INVALID_PARAM2,
    MissionResult.INVALID_PARAM3,
    MissionResult.INVALID_PARAM4,
)
_HIGHEST_M: Final = 83_000.0
_STORED_FRAMES: Final[Mapping[int, int]] = {
    **dict.fromkeys((*_AMSL, MISSION_FRAME), 0),
    **dict.fromkeys(_RELATIVE, 3),
    **dict.fromkeys(_OVER_TERRAIN, 10),
}
"""Frame of a stored place, by the frame of the received one."""


def _signed(value: float, like: float) -> float:
    return -value if like < 0.0 else value


def _circles(item: PlanItem) -> PlanItem:
    """A number of turns in 8 bits, parts of one in 256ths; a radius in 8 bits, large ones in tens of metres."""
    part = 0.0 < item.param1 < 1.0
    turns = int(min(255.0, item.param1 * 256.0 if part else item.param1))
    size_m = abs(item.param3)
    large = size_m > 255.0
    radius = int(min(255.0, size_m * 0.1 if large else size_m))
    both = (turns & 0xFFFF) | radius << 8  # a negative number of turns also fills the radius's bits
    low = both & 0xFF
    radius_m = float(both >> 8) * (10.0 if large else 1.0)
    return item._replace(
        param1=low / 256.0 if part else float(low),
        param2=0.0,
        param3=_signed(radius_m, item.param3),
        param4=_stored_param("?", item.param4),
    )


_ARDUPILOT_SPECIAL: Final[Mapping[int, Callable[[PlanItem], PlanItem]]] = {
    17: lambda item: item._replace(
        param1=0.0,
        param2=0.0,
        param3=_signed(_stored_param("H", abs(item.param3)), item.param3),
        param4=0.0,
    ),
    18: _circles,
    19: lambda item: _rewritten(item, "H00?")._replace(param3=_signed(1.0, item.param3)),
    21: lambda item: _rewritten(item, "H000")._replace(param4=_signed(1.0, item.param4)),
    31: lambda item: _rewritten(item, "000?")._replace(
        param2=_signed(_stored_param("H", abs(item.param2)), item.param2)
    ),
    94: lambda item: _rewritten(item, "f000")._replace(
        param1=_stored_param("H", item.param1 * 100.0) / 100.0
    ),
    223: lambda item: _rewritten(item, "??f0")._replace(
        param3=_stored_param("H", item.param3 * 100.0) * 0.01,
        param4=float(int(item.param4) & 1),
    ),
}
_ARDUPILOT_NUMBERS: Final[Mapping[int, str]] = {
    202: "BBf",
    203: "BB0",
    1000: "B0B",
    42702: "hh0",
    42703: "h00",
}
"""Items that store x, y or z as numbers."""
ARDUPILOT_COMMANDS: Final = frozenset(_ARDUPILOT) | frozenset(_ARDUPILOT_SPECIAL)
"""Mission commands that ArduCopter 4.5.7 stores, whether or not it can execute them."""


def stored_by_ardupilot(item: PlanItem) -> PlanItem | MissionResult:
    """Return what ArduPilot stores of an item, or why it refuses it."""
    allowed = _MAY_BE_NAN.get(item.command, frozenset())
    values = (item.param1, item.param2, item.param3, item.param4)
    for number, value in enumerate(values, start=1):
        if math.isinf(value) or (math.isnan(value) and number not in allowed):
            return _NAN_RESULTS[number - 1]
    if item.command not in ARDUPILOT_COMMANDS:  # unsupported, or new in a later version
        return item
    special = _ARDUPILOT_SPECIAL.get(item.command)
    stored = _rewritten(item, _ARDUPILOT[item.command]) if special is None else special(item)
    stored = stored._replace(autocontinue=1)
    if item.command in _ARDUPILOT_PLACES:
        if math.isnan(stored.z) or abs(stored.z) >= _HIGHEST_M:
            return MissionResult.INVALID_PARAM7
        frame = _STORED_FRAMES.get(stored.frame)
        if frame is None:
            return MissionResult.UNSUPPORTED_FRAME
        return stored._replace(frame=frame, z=int(stored.z * 100.0) * 0.01)
    letters = _ARDUPILOT_NUMBERS.get(item.command, "000")
    x = int(_stored_param(letters[0], item.x))
    y = int(_stored_param(letters[1], item.y))
    return stored._replace(frame=0, x=x, y=y, z=_stored_param(letters[2], item.z))


def as_sent(item: PlanItem) -> PlanItem:
    """Store an item as it was sent: plans other than missions."""
    return item
