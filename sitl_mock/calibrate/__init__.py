"""Comparing the mock's velocity response with a log of a real autopilot."""

from sitl_mock.calibrate.comparison import RMS_LIMIT_M_S, Comparison, compare_log
from sitl_mock.calibrate.flight import fly_log, guess, replay, vehicle_of
from sitl_mock.calibrate.step_log import COLUMNS, FlavourName, StepLog, read_step_log

__all__ = [
    "COLUMNS",
    "RMS_LIMIT_M_S",
    "Comparison",
    "FlavourName",
    "StepLog",
    "compare_log",
    "fly_log",
    "guess",
    "read_step_log",
    "replay",
    "vehicle_of",
]
