"""What DO_CHANGE_SPEED has asked for."""

import math
from dataclasses import dataclass

from sitl_mock.dynamics import Setpoint


@dataclass(slots=True)
class Speeds:
    """Speeds instead of those of the parameters, NaN for the parameter's."""

    level_m_s: float = math.nan
    climb_m_s: float = math.nan
    sink_m_s: float = math.nan

    def change(self, kind: float, speed_m_s: float) -> None:
        """Take DO_CHANGE_SPEED: 3 the descent, 2 the climb, anything below the speed over ground."""
        if kind > 2.9:
            self.sink_m_s = speed_m_s
        elif kind > 1.9:
            self.climb_m_s = speed_m_s
        else:
            self.level_m_s = speed_m_s

    def applied(self, setpoint: Setpoint) -> Setpoint:
        """Return a setpoint to a place, flown at these speeds."""
        return setpoint._replace(speed_m_s=self.level_m_s, climb_m_s=self.climb_m_s, sink_m_s=self.sink_m_s)
