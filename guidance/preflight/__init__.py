"""Is the autopilot set up for offboard flight? Parameters, frames and rates against the configuration, as rows."""

from guidance.preflight.mending import ParameterChange
from guidance.preflight.report import advice, changes, parameter_names, refusals, rows
from guidance.preflight.row import Finding, Verdict
from guidance.preflight.survey import PreflightMemory
from guidance.preflight.wants import Facts, Wants

__all__ = [
    "Facts",
    "Finding",
    "ParameterChange",
    "PreflightMemory",
    "Verdict",
    "Wants",
    "advice",
    "changes",
    "parameter_names",
    "refusals",
    "rows",
]
