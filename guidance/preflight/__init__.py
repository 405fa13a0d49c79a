"""Is the autopilot set up for offboard flight? Parameters, frames and rates against the configuration, as rows."""

from guidance.autopilots import Finding, Verdict, Wants
from guidance.preflight.judging import (
    ParameterChange,
    advice,
    another_autopilot,
    changes,
    parameter_names,
    refusals,
    rows,
)
from guidance.preflight.survey import Facts, PreflightMemory

__all__ = [
    "Facts",
    "Finding",
    "ParameterChange",
    "PreflightMemory",
    "Verdict",
    "Wants",
    "advice",
    "another_autopilot",
    "changes",
    "parameter_names",
    "refusals",
    "rows",
]
