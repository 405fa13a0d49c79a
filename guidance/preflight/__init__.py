"""Preflight: is the autopilot set up for offboard flight? Judges parameters, frames and rates as rows.

`PreflightMemory` asks for the firmware's version, for the parameters that this version has (`parameter_names`) and for
the uploaded fence, and collects `Facts`. `rows` judges them against the wants of a flight; each row is a
`guidance.autopilots.Finding`. `changes` are the parameters to set so that no row is refused.
"""

from guidance.preflight.changing import ParameterChange, changes
from guidance.preflight.judging import advice, another_autopilot, engage_rows, refusals, rows
from guidance.preflight.parameters import parameter_names, quantities_read, single
from guidance.preflight.reading import (
    ASK_AGAIN_S,
    COUNTED_S,
    EVADER_HEARD_S,
    Facts,
    PreflightMemory,
)

__all__ = [
    "ASK_AGAIN_S",
    "COUNTED_S",
    "EVADER_HEARD_S",
    "Facts",
    "ParameterChange",
    "PreflightMemory",
    "advice",
    "another_autopilot",
    "changes",
    "engage_rows",
    "parameter_names",
    "quantities_read",
    "refusals",
    "rows",
    "single",
]
