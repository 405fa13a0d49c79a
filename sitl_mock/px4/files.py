"""PX4's files over FTP, as its simulator lists them; those whose content the mock has are read."""

from __future__ import annotations

import json
import lzma
from typing import TYPE_CHECKING

from sitl_mock.files import FileTree

if TYPE_CHECKING:
    from sitl_mock.protocols import ParameterStore, PlanStore

_TYPES = {6: "Int32", 9: "Float"}


def files_of(parameters: ParameterStore, _plans: PlanStore) -> FileTree:
    """Return the files of one vehicle."""
    return FileTree(
        {"/etc/extras/parameters.json.xz": lambda: _parameter_metadata(parameters)},
        frozenset({"/etc", "/etc/init.d", "/log", "/tmp", "/eeprom"}),
    )


def _parameter_metadata(parameters: ParameterStore) -> bytes:
    """Return COMP_METADATA_TYPE_PARAMETER: name, type, default, unit and limits of each parameter, compressed."""
    described = []
    for item in parameters.definitions.values():
        entry = {"name": item.name, "type": _TYPES[item.kind], "default": item.default, "shortDesc": item.meaning}
        if item.unit:
            entry["units"] = item.unit
        if item.minimum > float("-inf"):
            entry |= {"min": item.minimum, "max": item.maximum}
        described.append(entry)
    return lzma.compress(json.dumps({"version": 1, "parameters": described}).encode())
