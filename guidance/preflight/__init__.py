"""Is the autopilot set up for offboard flight? Parameters, frames and rates against the configuration, as rows.

What it offers:
    rows: judges `Facts` against `Wants`, a `Finding` with its `Verdict` each.
    PreflightMemory: asks for what is judged, and gathers the facts; `parameter_names` says what it asks for.
    another_autopilot: the row that refuses another autopilot than configured.
    engage_rows: judges the parameters that are read again before the game begins, `engage_names`.
    refusals: names what keeps a vehicle on the ground. advice: says how to mend it.
    changes: what to set so that it passes, a `ParameterChange` each.
"""

from guidance.autopilots import Finding, Verdict, Wants
from guidance.preflight.judging import (
    ParameterChange,
    advice,
    another_autopilot,
    changes,
    engage_names,
    engage_rows,
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
    "engage_names",
    "engage_rows",
    "parameter_names",
    "refusals",
    "rows",
]
