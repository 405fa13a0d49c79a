"""State to MAVLink fields: one builder a message."""

from sitl_mock.telemetry.motion import MOTION
from sitl_mock.telemetry.report import Report
from sitl_mock.telemetry.status import STATUS

BUILDERS = {**MOTION, **STATUS}

__all__ = ["BUILDERS", "MOTION", "STATUS", "Report"]
