"""Preflight: is the autopilot set up for offboard flight? Judges parameters, frames and rates as rows.

`PreflightMemory` asks for the firmware's version, for the parameters that this version has and for the uploaded fence.
Each row is a `guidance.autopilots.Finding`.

Contents:
    PreflightMemory, Facts: the readings of one vehicle; ASK_AGAIN_S is the period of requests, COUNTED_S the averaging
        time of rates, EVADER_HEARD_S the age up to which a report is judged.
    parameter_names, quantities_read: the parameters of a version, and their values by quantity.
    single: a value rounded as on the wire.
    rows, engage_rows, another_autopilot: judgements of the facts. EVADER_ALTITUDE: name of a row.
    refusals, advice: names of the refused rows, and their remedies.
    ParameterChange, changes: the parameters to set so that no row is refused.
"""

from guidance.preflight.changing import ParameterChange, changes
from guidance.preflight.judging import (
    EVADER_ALTITUDE,
    advice,
    another_autopilot,
    engage_rows,
    refusals,
    rows,
)
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
    "EVADER_ALTITUDE",
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
