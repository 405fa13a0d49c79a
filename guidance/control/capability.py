"""What this vehicle can do, as far as it has shown it: speeds, acceleration, and the time it needs to be somewhere.

The game's pursuer is at full speed at once. This vehicle is not:

* **Late start.** A vehicle that flies w, where the game asks for u, and accelerates with a, has the velocity u after
  ‖u − w‖/a seconds. By then it is (u − w)·‖u − w‖/(2a) metres behind. So it does as well as a pursuer of the game that
  starts that much further back (`late_start`). Along a straight chase after an evader with speed v, capture comes
  u²/(2a(u − v)) seconds later from hover. Ground and vertical use the same law, each with its own a.
* **Time to guard.** The time to be at a place and able to stay there: accelerate, fly at the speed that the vehicle has
  shown, brake (`time_to_stop_at`).
* **Speed.** A vehicle may be slower than its file says: tilt limit, drag, wind. `observe_speed` compares the speed
  asked for with the speed flown. If the vehicle stays below for longer than `RESPONSE_S` and is not gaining, the ratio
  of the two is what it reaches. It is learned anew while the vehicle is asked for full speed, so it also rises again.
"""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

from guidance.control.limits import Speeds
from guidance.frames import Vector

RESPONSE_S: Final = 1.0
"""How long a vehicle must stay below the speed asked for before that counts as all it can reach."""

SHORT: Final = 0.05
"""Share of the speed asked for that may be missing; estimates scatter by about as much."""

_SMOOTHED_S: Final = 0.5
_STEADY_M_S2: Final = 0.4
_ALIGNED: Final = 0.9
"""Nothing is learned while the mean acceleration is larger, or less than this share of the velocity is along the one
asked for: the vehicle is still gaining speed, or turning."""

_FOLLOWING: Final = 0.3
"""Nothing is learned below this share of the speed asked for: such a vehicle does not follow the setpoints at all, for
example because a pilot has just taken it over."""

_LEAST_ASKED_M_S: Final = 1.0
_TAKEN_FOR_GRANTED: Final = 0.5
"""Share of the game's speeds that a vehicle is trusted with before it has shown them."""


@dataclass(frozen=True, slots=True)
class Acceleration:
    """Guaranteed acceleration of a vehicle, m/s²: over the ground, and vertically."""

    ground_m_s2: float
    vertical_m_s2: float


def late_start(position_m: Vector, desired_m_s: Vector, flown_m_s: Vector, acceleration: Acceleration) -> Vector:
    """Return where a pursuer of the game would have to start to do as well as this vehicle, m.

    Args:
        position_m: Position of the vehicle; any frame, third axis vertical.
        desired_m_s: Velocity that the game asks for, same axes.
        flown_m_s: Velocity of the vehicle.
        acceleration: Of the vehicle.
    """
    east, north, up = (desired - flown for desired, flown in zip(desired_m_s, flown_m_s, strict=True))
    over_ground_s = math.hypot(east, north) / (2.0 * acceleration.ground_m_s2)
    vertical_s = abs(up) / (2.0 * acceleration.vertical_m_s2)
    x, y, z = position_m
    return (x - east * over_ground_s, y - north * over_ground_s, z - up * vertical_s)


def time_to_stop_at(
    distance_m: float, speed_m_s: float, *, top_m_s: float, gaining_m_s2: float, braking_m_s2: float
) -> float:
    """Return the time until a vehicle on a line has covered a distance and is able to stay there, s.

    It accelerates to no more than the top speed, then brakes to rest.

    Args:
        distance_m: Zero or negative: it is there already.
        speed_m_s: Present speed towards it, negative away from it.
        top_m_s: Largest speed.
        gaining_m_s2: Acceleration, also while turning back.
        braking_m_s2: Deceleration.
    """
    if distance_m <= 0.0:
        return 0.0
    turning_s = max(0.0, -speed_m_s) / gaining_m_s2
    distance_m += 0.5 * max(0.0, -speed_m_s) * turning_s
    speed_m_s = min(max(speed_m_s, 0.0), top_m_s)
    braking_m = speed_m_s * speed_m_s / (2.0 * braking_m_s2)
    if braking_m >= distance_m:
        return turning_s + speed_m_s / braking_m_s2
    square = (distance_m + speed_m_s * speed_m_s / (2.0 * gaining_m_s2)) * 2.0
    peak_m_s = math.sqrt(square / (1.0 / gaining_m_s2 + 1.0 / braking_m_s2))
    cruised_s = 0.0
    if peak_m_s > top_m_s:
        peak_m_s = top_m_s
        changing_m = (peak_m_s * peak_m_s - speed_m_s * speed_m_s) / (2.0 * gaining_m_s2)
        cruised_s = (distance_m - changing_m - peak_m_s * peak_m_s / (2.0 * braking_m_s2)) / peak_m_s
    return turning_s + (peak_m_s - speed_m_s) / gaining_m_s2 + cruised_s + peak_m_s / braking_m_s2


class SpeedMemory(NamedTuple):
    """What a vehicle has shown of its speeds.

    Attributes:
        shown: Largest speeds flown, smoothed: over the ground, up and down.
        flown_ned_m_s: Mean velocity of the last half second or so.
        acceleration_m_s2: Mean acceleration of the last second or so, north and east.
        short_s: For how long it has stayed below the speed asked for.
        share: Share of the game's speed over the ground that it reaches; 1 until it was seen to reach less.
    """

    shown: Speeds = Speeds(0.0, 0.0, 0.0)
    flown_ned_m_s: Vector = (0.0, 0.0, 0.0)
    acceleration_m_s2: tuple[float, float] = (0.0, 0.0)
    short_s: float = 0.0
    share: float = 1.0


def observe_speed(
    memory: SpeedMemory, asked_ned_m_s: Vector, flown_ned_m_s: Vector, *, at_full_speed: bool, dt_s: float
) -> SpeedMemory:
    """Compare the velocity that the game asks for with the one flown, for one cycle.

    Args:
        memory: From the last call.
        asked_ned_m_s: Velocity of the game at the vehicle's nominal speed.
        flown_ned_m_s: Velocity of the vehicle over the ground.
        at_full_speed: Whether all of it is commanded: neither the approach nor a limit slows the vehicle down.
        dt_s: Seconds since the last call.
    """
    (north, east, down), share = memory.flown_ned_m_s, min(1.0, dt_s / _SMOOTHED_S)
    north += share * (flown_ned_m_s[0] - north)
    east += share * (flown_ned_m_s[1] - east)
    down += share * (flown_ned_m_s[2] - down)
    a_north, a_east = memory.acceleration_m_s2
    acceleration = (
        a_north + share * ((flown_ned_m_s[0] - north) / _SMOOTHED_S - a_north),
        a_east + share * ((flown_ned_m_s[1] - east) / _SMOOTHED_S - a_east),
    )
    ground, climb, descent = memory.shown
    shown = Speeds(max(ground, math.hypot(north, east)), max(climb, -down), max(descent, down))
    asked = math.hypot(asked_ned_m_s[0], asked_ned_m_s[1])
    if asked < _LEAST_ASKED_M_S:
        return memory._replace(
            shown=shown, flown_ned_m_s=(north, east, down), acceleration_m_s2=acceleration, short_s=0.0
        )
    along = (north * asked_ned_m_s[0] + east * asked_ned_m_s[1]) / asked
    steady = math.hypot(*acceleration) < _STEADY_M_S2 and along > _ALIGNED * math.hypot(north, east)
    short = at_full_speed and steady and _FOLLOWING * asked < along < (1.0 - SHORT) * asked
    short_s = memory.short_s + dt_s if short else 0.0
    reached = max(0.0, along) / asked
    learned = memory.share
    if short and (short_s >= RESPONSE_S or learned < 1.0):
        learned = reached
    elif learned < 1.0 and reached > learned:
        learned = 1.0 if reached >= 1.0 - SHORT else reached
    return SpeedMemory(shown, (north, east, down), acceleration, short_s, learned)


def trusted(shown: Speeds, game: Speeds) -> Speeds:
    """Return the speeds that a promise may rest on: those shown, at most the game's, and at least half of them."""
    return Speeds(
        *(max(_TAKEN_FOR_GRANTED * played, min(seen, played)) for seen, played in zip(shown, game, strict=True))
    )
