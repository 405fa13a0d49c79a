"""Is the autopilot set up for offboard flight? Parameters, frames and rates against the configuration, as rows."""

from guidance.preflight.mending import ParameterChange
from guidance.preflight.report import advice, changes, parameter_names, refusals, rows
from guidance.preflight.row import Row, Verdict
from guidance.preflight.survey import Survey
from guidance.preflight.wants import Facts, Wants

__all__ = [
    "Facts",
    "ParameterChange",
    "Row",
    "Survey",
    "Verdict",
    "Wants",
    "advice",
    "changes",
    "parameter_names",
    "refusals",
    "rows",
]
