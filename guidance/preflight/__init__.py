"""Is the autopilot set up for offboard flight? Parameters, frames and rates against the configuration, as rows."""

from guidance.preflight.report import advice, parameter_names, refusals, rows
from guidance.preflight.row import Row, Verdict
from guidance.preflight.survey import Survey
from guidance.preflight.wants import Facts, Wants

__all__ = ["Facts", "Row", "Survey", "Verdict", "Wants", "advice", "parameter_names", "refusals", "rows"]
