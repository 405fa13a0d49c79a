"""Flight logs: a vehicle's logs in memory, and their two formats, PX4's ULog and ArduPilot's DataFlash."""

from sitl_mock.logs.book import LOG_BYTES, FlightLog, LogBook

__all__ = ["LOG_BYTES", "FlightLog", "LogBook"]
