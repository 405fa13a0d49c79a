"""Comparing the mock's velocity response with a log of a real autopilot."""

from sitl_mock.calibrate.replay import RMS_LIMIT_M_S, Comparison, Flavour, compare, guess, replay
from sitl_mock.calibrate.step_log import COLUMNS, StepLog, read_step_log

__all__ = [
    "COLUMNS",
    "RMS_LIMIT_M_S",
    "Comparison",
    "Flavour",
    "StepLog",
    "compare",
    "guess",
    "read_step_log",
    "replay",
]
