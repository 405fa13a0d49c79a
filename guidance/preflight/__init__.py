"""Preflight: is the autopilot set up for offboard flight? Judges parameters, frames and rates as rows.

PreflightMemory: requests parameters (`parameter_names`) and collects `Facts`.
rows: judges `Facts` against the wants of a flight; each row is a `guidance.autopilots.Finding`.
another_autopilot: the row for a wrong autopilot.
engage_names, engage_rows: the parameters that are read and judged again before every engagement.
refusals: names of the refused rows. advice: their fixes in one line. changes: the `ParameterChange`s that fix them.
"""

from guidance.preflight.judging import (
    Facts,
    ParameterChange,
    PreflightMemory,
    advice,
    another_autopilot,
    changes,
    engage_names,
    engage_rows,
    parameter_names,
    refusals,
    rows,
)

__all__ = [
    "Facts",
    "ParameterChange",
    "PreflightMemory",
    "advice",
    "another_autopilot",
    "changes",
    "engage_names",
    "engage_rows",
    "parameter_names",
    "refusals",
    "rows",
]
