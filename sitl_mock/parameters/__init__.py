"""Parameter tables: one CSV file per flavour, in the autopilot's order, and one of changes per later version.

PX4 and ArduCopter: all parameters that PX4 v1.17.0 (SIH quadrotor) and ArduCopter 4.5.7 (its own simulated quadrotor,
``copter.parm``) list, with type and value as on the wire. Rover: a selection of Rover 4.5's defaults.
Parameters that are listed only while another one is not 0 are in ``arducopter_hidden.csv``, as 4.5.7 lists them, and in
``px4_hidden.csv``: hashes of the names of external modes, listed once there is one, and those of PX4's module `zenoh`.
``unit``, ``minimum``, ``maximum`` and ``meaning`` are given where they are documented and matter here. The limits apply
to settings of the mock; over MAVLink neither autopilot enforces them.

Changes of PX4 v1.18: its release notes. Changes of ArduCopter 4.6 and 4.7: the release notes, the pull requests that
rename (31970, 31990, 32147) and the list of the 4.7.0 beta. Only changes whose default is known are listed.
"""

import csv
import math
from collections.abc import Iterator
from functools import cache
from importlib.resources import files
from itertools import chain
from operator import attrgetter
from typing import Final, NamedTuple

from sitl_mock.protocols import Parameter, ParameterTable, ParamKind, Renamed

_PACKAGE: Final = "sitl_mock.parameters"
_WITH_HIDDEN: Final = frozenset({"arducopter", "px4"})
"""Flavours with a file of parameters that appear when another one is set."""


class Change(NamedTuple):
    """One line of a version's changes, as text.

    Attributes:
        change: removed, renamed, changed (its limits or meaning) or added.
        name: Name in the new version, or of the removed parameter.
        was: Name in the version with recorded data.
        factor: New units per old unit.
        kind: MAV_PARAM_TYPE; of a renamed one "" if it is unchanged.
        value: Default of an added one.
        unit: Unit in the new version.
        minimum: Lower limit.
        maximum: Upper limit.
        meaning: Short description; of a renamed one "" if it is unchanged.
    """

    change: str
    name: str
    was: str
    factor: str
    kind: str
    value: str
    unit: str
    minimum: str
    maximum: str
    meaning: str


@cache
def parameters_of(flavour: str, version: str = "") -> ParameterTable:
    """Return the parameters of a flavour in the order of its list: px4, arducopter or rover.

    Args:
        flavour: Name of the flavour.
        version: A version with a file of changes; "" for the one with recorded data.
    """
    recorded = list(_recorded(flavour))
    if not version:
        return ParameterTable(recorded)
    changes = [Change(*row) for row in _rows(f"{flavour}_{version}")]
    renamed = {change.was: change for change in changes if change.change == "renamed"}
    redefined = renamed | {change.was: change for change in changes if change.change == "changed"}
    removed = {change.name for change in changes if change.change == "removed"}
    kept = [
        _redefined(item, redefined[item.name]) if item.name in redefined else item
        for item in recorded
        if item.name not in removed
    ]
    kept = [
        item._replace(behind=renamed[item.behind].name) if item.behind in renamed else item
        for item in kept
    ]
    added = [
        _parameter(
            change.name,
            change.kind,
            change.value,
            change.unit,
            change.minimum,
            change.maximum,
            change.meaning,
        )
        for change in changes
        if change.change == "added"
    ]
    table = ParameterTable([*kept, *added])
    table.renamed = {
        was: Renamed(change.name, float(change.factor)) for was, change in renamed.items()
    }
    return table


def _recorded(flavour: str) -> Iterator[Parameter]:
    """Yield the recorded parameters, each followed by those that are behind it.

    PX4's list is in alphabetical order; there a parameter may be behind itself.
    """
    behind: dict[str, list[Parameter]] = {}
    if flavour in _WITH_HIDDEN:
        for switch, name, kind, value in _rows(f"{flavour}_hidden"):
            item = Parameter(
                name, ParamKind(int(kind)), float(value), "", -math.inf, math.inf, "", switch
            )
            behind.setdefault(switch, []).append(item)
    listed = [_parameter(*row) for row in _rows(flavour)]
    if flavour == "px4":
        yield from sorted(chain(listed, *behind.values()), key=attrgetter("name"))
        return
    for item in listed:
        yield item
        yield from behind.get(item.name, ())


def _rows(name: str) -> Iterator[list[str]]:
    text = files(_PACKAGE).joinpath(f"{name}.csv").read_text(encoding="utf-8")
    rows = csv.reader(text.splitlines())
    next(rows)
    return rows


def _redefined(item: Parameter, change: Change) -> Parameter:
    """Return a parameter with its new name, unit, scale, limits and meaning."""
    factor = float(change.factor)
    return Parameter(
        change.name,
        ParamKind(int(change.kind)) if change.kind else item.kind,
        item.default * factor,
        change.unit,
        float(change.minimum) if change.minimum else item.minimum * factor,
        float(change.maximum) if change.maximum else item.maximum * factor,
        change.meaning if change.meaning else item.meaning,
        item.behind,
    )


def _parameter(
    name: str, kind: str, value: str, unit: str, minimum: str, maximum: str, meaning: str
) -> Parameter:
    low = float(minimum) if minimum else -math.inf
    high = float(maximum) if maximum else math.inf
    return Parameter(name, ParamKind(int(kind)), float(value), unit, low, high, meaning)
