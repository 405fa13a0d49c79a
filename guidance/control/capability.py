"""Abilities of this vehicle: the cost of accelerating, and the speed that it reaches.

The game's pursuer is at full speed at once. This vehicle is not:

* **Late start.** A vehicle that flies w, where the game asks for u, and accelerates with a, has the velocity u after
  ‖u − w‖/a seconds. By then it is (u − w)·‖u − w‖/(2a) metres behind. So it does as well as a pursuer of the game that
  starts that much further back (`late_start`). Along a straight chase after an evader with speed v, capture comes
  u²/(2a(u − v)) seconds later from hover. Ground and vertical use the same law, each with its own a.
* **Speed.** A vehicle may be slower than its file says: tilt limit, drag, wind. `observe_speed` compares the speed
  of the game with the mean speed flown over `RESPONSE_S` or longer. The ratio of the two is the share that it reaches.
  While it gains speed or brakes, this share can only rise. A time counts only once a HEARTBEAT in the guided mode has
  come after it: until then a pilot may have taken over.
"""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

from guidance.frames import Vector

RESPONSE_S: Final = 2.0
"""Shortest time of the mean; estimates of the speed wander by some per cent within a second."""

SHORT: Final = 0.02
"""Share of the speed asked for that may be missing; the mean scatters by about as much."""

_SMOOTHED_S: Final = 0.5
_STEADY_M_S2: Final = 0.3
"""Mean acceleration above which a vehicle is gaining speed or braking."""

_ALIGNED: Final = 0.9
"""Least share of the velocity along the desired one; below it the vehicle is turning."""

_LEAST_ASKED_M_S: Final = 1.0


@dataclass(frozen=True, slots=True)
class Acceleration:
    """Guaranteed acceleration of a vehicle, m/s²: over the ground, and vertically.

    Attributes:
        descent_share: Share of the commanded descent rate that it keeps during a chase.
    """

    ground_m_s2: float
    vertical_m_s2: float
    descent_share: float = 0.92


def late_start(position_m: Vector, desired_m_s: Vector, flown_m_s: Vector, acceleration: Acceleration) -> Vector:
    """Return where a pursuer of the game would have to start to do as well as this vehicle, m.

    Args:
        position_m: Position of the vehicle; any frame, third axis vertical.
        desired_m_s: Velocity of the game's solution, same axes.
        flown_m_s: Velocity of the vehicle.
        acceleration: Of the vehicle.
    """
    east, north, up = (desired - flown for desired, flown in zip(desired_m_s, flown_m_s, strict=True))
    over_ground_s = math.hypot(east, north) / (2.0 * acceleration.ground_m_s2)
    vertical_s = abs(up) / (2.0 * acceleration.vertical_m_s2)
    x, y, z = position_m
    return (x - east * over_ground_s, y - north * over_ground_s, z - up * vertical_s)


class SpeedMemory(NamedTuple):
    """Speeds that a vehicle has flown.

    Attributes:
        shown_m_s: Largest speed flown over the ground, smoothed.
        share: Share of the game's speed over the ground that it reaches, 1 at first.
        flown_ned_m_s: Mean velocity of the last half second or so.
        compared_s: Time for which its full speed has been commanded, without a turn.
        covered_s: The same, weighted by the share of that speed that it flew.
        began_m_s: Its speed at the beginning of that time.
    """

    shown_m_s: float = 0.0
    share: float = 1.0
    flown_ned_m_s: Vector = (0.0, 0.0, 0.0)
    compared_s: float = 0.0
    covered_s: float = 0.0
    began_m_s: float = 0.0

    def paused(self) -> "SpeedMemory":
        """Return the memory without the present comparison."""
        return SpeedMemory(self.shown_m_s, self.share)


def observe_speed(
    memory: SpeedMemory, asked_ned_m_s: Vector, flown_ned_m_s: Vector, *, unslowed: bool, confirmed: bool, dt_s: float
) -> SpeedMemory:
    """Compare the velocity that the game asks for with the one flown, for one cycle.

    Args:
        memory: From the last call.
        asked_ned_m_s: Velocity of the game at the vehicle's nominal speed.
        flown_ned_m_s: Velocity of the vehicle over the ground.
        unslowed: Whether the whole speed is commanded, not reduced by the approach or a limit.
        confirmed: Whether a HEARTBEAT of this cycle shows the guided mode.
        dt_s: Seconds since the last call.
    """
    weight = min(1.0, dt_s / _SMOOTHED_S)
    north, east, down = (
        before + weight * (now - before) for before, now in zip(memory.flown_ned_m_s, flown_ned_m_s, strict=True)
    )
    mean = (north, east, down)
    speed = math.hypot(north, east)
    shown_m_s = max(memory.shown_m_s, speed)
    asked = math.hypot(*asked_ned_m_s[:2])
    along = (north * asked_ned_m_s[0] + east * asked_ned_m_s[1]) / max(asked, _LEAST_ASKED_M_S)
    if not (unslowed and asked >= _LEAST_ASKED_M_S and along >= _ALIGNED * speed):
        return SpeedMemory(shown_m_s, memory.share, mean)
    began_m_s = memory.began_m_s if memory.compared_s > 0.0 else along
    compared_s, covered_s = memory.compared_s + dt_s, memory.covered_s + dt_s * along / asked
    if not (confirmed and compared_s >= RESPONSE_S):
        return SpeedMemory(shown_m_s, memory.share, mean, compared_s, covered_s, began_m_s)
    steady, reached = abs(along - began_m_s) < _STEADY_M_S2 * compared_s, covered_s / compared_s
    share = reached if steady else max(memory.share, reached)
    return SpeedMemory(shown_m_s, 1.0 if share > 1.0 - SHORT else share, mean)
