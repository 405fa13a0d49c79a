"""ArduPilot's virtual files: parameters and plans packed, as ground stations fetch them over FTP.

Formats: ``AP_Filesystem_Param`` (0x671B) and ``AP_Filesystem_Mission`` (0x763D) of ArduPilot 4.5.
"""

from __future__ import annotations

import os.path
import struct
from typing import TYPE_CHECKING, Final

from sitl_mock.files import FileTree
from sitl_mock.protocols import ParamKind, PlanKind

if TYPE_CHECKING:
    from sitl_mock.protocols import ParameterStore, PlanStore

_PARAMETERS, _ITEMS = 0x671B, 0x763D
_TYPES: Final = {
    ParamKind.INT8: (1, "<b"),
    ParamKind.INT16: (2, "<h"),
    ParamKind.INT32: (3, "<i"),
    ParamKind.REAL32: (4, "<f"),
}
_ITEM: Final = struct.Struct("<ffffiifHHBBBBBB")
_NAMES: Final = {PlanKind.MISSION: "mission.dat", PlanKind.FENCE: "fence.dat", PlanKind.RALLY: "rally.dat"}


def files_of(parameters: ParameterStore, plans: PlanStore) -> FileTree:
    """Return the files of one vehicle."""
    hidden = {"@PARAM/param.pck": lambda: packed_parameters(parameters)}
    for kind, name in _NAMES.items():
        hidden[f"@MISSION/{name}"] = lambda kind=kind: packed_plan(plans, kind)  # type: ignore[misc]
    return FileTree({}, frozenset({"/logs", "/terrain"}), hidden)


def packed_parameters(parameters: ParameterStore) -> bytes:
    """Return all parameters as ``@PARAM/param.pck`` has them: names share their beginnings."""
    count = len(parameters.names)
    packed, last = [struct.pack("<HHH", _PARAMETERS, count, count)], ""
    for name in parameters.names:
        kind, form = _TYPES[parameters.definitions[name].kind]
        common = min(len(os.path.commonpath((last, name))), len(name) - 1, 15)
        rest = name[common:].encode()
        packed.append(bytes((kind, len(rest) - 1 << 4 | common)) + rest + struct.pack(form, parameters[name]))
        last = name
    return b"".join(packed)


def packed_plan(plans: PlanStore, kind: PlanKind) -> bytes:
    """Return a plan as ``@MISSION/mission.dat`` has it: a header and the payloads of MISSION_ITEM_INT."""
    items = plans.plans[kind].items
    packed = [struct.pack("<HHHHH", _ITEMS, kind, 0, 0, len(items))]
    for item in items:
        p1, p2, p3, p4 = item.param1, item.param2, item.param3, item.param4
        ids = (item.seq, item.command, 0, 0, item.frame, item.current, item.autocontinue, kind)
        packed.append(_ITEM.pack(p1, p2, p3, p4, item.x, item.y, item.z, *ids))
    return b"".join(packed)
