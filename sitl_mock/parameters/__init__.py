"""Parameter tables: one CSV file per flavour, read once, in the autopilot's order.

PX4 and ArduCopter: all parameters that PX4 v1.17.0 (SIH quadrotor) and ArduCopter 4.5.7 (its own simulated quadrotor,
``copter.parm``) list, with type and value as on the wire. Rover: a selection of Rover 4.5's defaults.
``unit``, ``minimum``, ``maximum`` and ``meaning`` are given where they are documented and matter here. The limits apply
to settings of the mock; over MAVLink neither autopilot enforces them.
"""

import csv
import math
from functools import cache
from importlib.resources import files
from typing import Final

from sitl_mock.protocols import Parameter, ParameterTable, ParamKind

_PACKAGE: Final = "sitl_mock.parameters"


@cache
def parameters_of(flavour: str) -> ParameterTable:
    """Return the parameters of a flavour in the order of its list: px4, arducopter or rover."""
    text = files(_PACKAGE).joinpath(f"{flavour}.csv").read_text(encoding="utf-8")
    rows = csv.reader(text.splitlines())
    next(rows)
    return ParameterTable(_parameter(*row) for row in rows)


def _parameter(
    name: str, kind: str, value: str, unit: str, minimum: str, maximum: str, meaning: str
) -> Parameter:
    low = float(minimum) if minimum else -math.inf
    high = float(maximum) if maximum else math.inf
    return Parameter(name, ParamKind(int(kind)), float(value), unit, low, high, meaning)
