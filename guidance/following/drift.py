"""How far a vehicle's reported velocity is from the rate at which its reported position moves.

An estimator's velocity carries an error that wanders slowly (PX4: 0.2 to 0.4 m/s over many seconds, north, east and
down), its position is drawn back by GPS and barometer. The autopilot flies the velocity it believes in, so that a
vehicle told to stand still moves, and one told to fly at 6 m/s gains on its evader by 5 % too little. The game is
played in positions: what counts is how they change. An observer of second order, with both poles at -1/settle, tells
the difference from the two, and is no slower than the error itself.
"""

import math
from typing import NamedTuple

from guidance.frames import Vector

SETTLE_S = 1.2
LARGEST_M_S = 0.6
JUMP_M = 1.0
_LONGEST_STEP_S = 0.1


class Drift(NamedTuple):
    """Reported velocity less rate of the reported position, and the position by the two; None before the first call."""

    velocity_ned_m_s: Vector = (0.0, 0.0, 0.0)
    position_ned_m: Vector | None = None


def observe_drift(drift: Drift, position_ned_m: Vector, velocity_ned_m_s: Vector, *, dt_s: float) -> Drift:
    """Take in one report of position and velocity, `dt_s` after the last.

    A position that is further off than any drift could have it (`JUMP_M`: the estimator was reset) is taken as it is,
    and nothing is learned from it.
    """
    if drift.position_ned_m is None:
        return Drift(drift.velocity_ned_m_s, position_ned_m)
    dt_s = min(max(dt_s, 0.0), _LONGEST_STEP_S)
    rows = [
        _axis(*row, dt_s)
        for row in zip(drift.position_ned_m, drift.velocity_ned_m_s, position_ned_m, velocity_ned_m_s, strict=True)
    ]
    if math.dist(position_ned_m, [place for place, _ in rows]) > JUMP_M:
        return Drift(drift.velocity_ned_m_s, position_ned_m)
    (north, drift_north), (east, drift_east), (down, drift_down) = rows
    return Drift((drift_north, drift_east, drift_down), (north, east, down))


def _axis(place_m: float, drift_m_s: float, reported_m: float, velocity_m_s: float, dt_s: float) -> tuple[float, float]:
    place_m += (velocity_m_s - drift_m_s) * dt_s
    off_m = reported_m - place_m
    drift_m_s -= off_m * dt_s / SETTLE_S**2
    return place_m + 2.0 * off_m * dt_s / SETTLE_S, max(-LARGEST_M_S, min(LARGEST_M_S, drift_m_s))
