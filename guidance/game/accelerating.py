"""PE in the plane with a pursuer whose acceleration is bounded too (arXiv 2508.01570).

The pursuer is a double integrator: ‖a‖ ≤ A, ‖w‖ ≤ u. The evader changes its velocity at once, ‖v‖ < u. Both go straight
for the point where the evader's reach first lies within the pursuer's. In a direction n, the pursuer's reach is the
largest distance along n that it can fly by then:

* **Below top speed** it accelerates along n throughout: n·w₀ t + A t²/2. Its reach is a disc.
* **At top speed** it has to turn its velocity to n. The best way is a catenary in the plane of velocities: an
  acceleration whose tangent is linear in time, until the velocity touches the circle ‖w‖ = u; from there it turns along
  the circle, at the rate A/u. The angle of that point is the one unknown.

In each direction the evader is out of reach during one interval of time, because the pursuer's speed along it never
falls. It may begin after the start: the evader dodges a pursuer that flies past. The time of capture is the first one
that lies in the interval of no direction.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

from guidance.errors import ConfigError
from guidance.game.arrays import along2, dot2, in_plane, plus2
from guidance.game.records import require

Point = tuple[float, float]

_HEADINGS = 48
"""Directions of the first search."""
_HEADING_RAD = 1e-8
_ROUNDING = 1e-12
_STEPS = 60
_INSIDE = 1.0 - 1e-9
"""Largest share of the top speed: on the circle itself, turning along it at once would be a second root."""


class AcceleratingSolution(NamedTuple):
    """Optimal play.

    Attributes:
        time_s: Time to capture, the game's value.
        heading_rad: Heading of the evader, from the first axis to the second.
        meeting_point_m: Where the evader is captured.
        acceleration_m_s2: Acceleration of the pursuer now; zero at top speed along the heading.
    """

    time_s: float
    heading_rad: float
    meeting_point_m: Point
    acceleration_m_s2: Point


def solve_accelerating(
    pursuer_m: Point,
    pursuer_m_s: Point,
    evader_m: Point,
    *,
    speed_m_s: float,
    acceleration_m_s2: float,
    evader_speed_m_s: float,
    capture_radius_m: float = 0.0,
) -> AcceleratingSolution:
    """Solve PE in the plane against a pursuer with bounded speed and acceleration.

    Args:
        pursuer_m: Position of the pursuer, m.
        pursuer_m_s: Its velocity, m/s; reduced to `speed_m_s` if it is faster.
        evader_m: Position of the evader, m.
        speed_m_s: Top speed of the pursuer, u.
        acceleration_m_s2: Its largest acceleration, A.
        evader_speed_m_s: Speed of the evader, v < u.
        capture_radius_m: Distance of capture: the capture radius, or the radius of a stand-off disc.

    Raises:
        ConfigError: A value is not a finite number, or not in its range.
    """
    require("acceleration_m_s2", acceleration_m_s2)
    require("capture_radius_m", capture_radius_m, zero_allowed=True)
    given = (*pursuer_m, *pursuer_m_s, *evader_m, speed_m_s, evader_speed_m_s)
    if not all(map(math.isfinite, given)):
        raise ConfigError(f"positions, velocity and speeds must be finite numbers, not {given}")
    if not 0.0 <= evader_speed_m_s < speed_m_s:
        allowed = f"allowed is 0 up to below {speed_m_s:g} (speed_m_s)"
        raise ConfigError(f"evader_speed_m_s = {evader_speed_m_s:g}: {allowed}")
    away = (evader_m[0] - pursuer_m[0], evader_m[1] - pursuer_m[1])
    excess = max(1.0, math.hypot(*pursuer_m_s) / (_INSIDE * speed_m_s))
    flown = (pursuer_m_s[0] / excess, pursuer_m_s[1] / excess)
    chase = _Chase(away, flown, speed_m_s, acceleration_m_s2, evader_speed_m_s, capture_radius_m)
    if math.hypot(*away) <= capture_radius_m:
        return AcceleratingSolution(0.0, math.atan2(away[1], away[0]), evader_m, (0.0, 0.0))
    step = 2.0 * math.pi / _HEADINGS
    tried = [(number * step, chase.escape(number * step)) for number in range(_HEADINGS)]
    best = tried[0][0]
    last = _Escape()
    while later := [
        (heading, one) for heading, one in tried if one.begin_s <= last.end_s < one.end_s
    ]:
        best, last = max(later, key=lambda one: one[1].end_s)
    low = best - step
    high = best + step
    golden = 0.5 * (math.sqrt(5.0) - 1.0)
    while high - low > _HEADING_RAD:
        inner = high - golden * (high - low)
        outer = low + golden * (high - low)
        if chase.escape(inner).end_s > chase.escape(outer).end_s:
            high = outer
        else:
            low = inner
    heading = 0.5 * (low + high)
    met = chase.escape(heading)
    ahead = math.cos(heading), math.sin(heading)
    meeting = plus2(evader_m, evader_speed_m_s * met.end_s, ahead)
    return AcceleratingSolution(met.end_s, heading, meeting, in_plane(ahead, met.acceleration_m_s2))


class _Escape(NamedTuple):
    """Interval of time in which the evader is out of reach along a direction.

    `acceleration_m_s2`: of the pursuer that reaches it at the end, along and across the direction, at first.
    """

    begin_s: float = 0.0
    end_s: float = 0.0
    acceleration_m_s2: Point = (0.0, 0.0)


class _Turn(NamedTuple):
    """A turn of the velocity: its duration and distance along the direction, and the acceleration at its beginning."""

    time_s: float
    along_m: float
    acceleration_m_s2: Point


class _Chase(NamedTuple):
    """A state: vector to the evader, velocity of the pursuer, u, A, v and the radius."""

    away_m: Point
    flown_m_s: Point
    u: float
    a: float
    v: float
    radius_m: float

    def escape(self, heading: float) -> _Escape:
        """Return when the evader is out of the pursuer's reach along a heading."""
        ahead = math.cos(heading), math.sin(heading)
        gap_m = dot2(self.away_m, ahead) - self.radius_m
        along, across = along2(ahead, self.flown_m_s)
        behind = self.v - along
        square = behind * behind + 2.0 * self.a * gap_m
        if gap_m <= 0.0 and (behind <= 0.0 or square <= 0.0):
            return _Escape()
        begin_s = (behind - math.sqrt(square)) / self.a
        end_s = (behind + math.sqrt(square)) / self.a
        if math.hypot(across, along + self.a * end_s) <= self.u:
            return _Escape(begin_s, end_s, (self.a, 0.0))

        def short_m(end: float) -> float:
            turn = self.turn(along, abs(across), end)
            return gap_m + self.v * turn.time_s - turn.along_m

        turn = self.turn(along, abs(across), 0.0)
        end_s = (gap_m - turn.along_m + self.u * turn.time_s) / (self.u - self.v)
        if end_s < turn.time_s:  # captured during the turn
            first = math.asin(min(1.0, abs(across) / self.u))
            turn = self.turn(along, abs(across), _root(short_m, 0.0, first))
            end_s = turn.time_s
        forward, aside = turn.acceleration_m_s2
        return _Escape(begin_s, end_s, (forward, math.copysign(1.0, across) * aside))

    def turn(self, along: float, across: float, end: float) -> _Turn:
        """Turn the velocity (along, across ≥ 0) until it is at top speed, at the angle `end` from the direction."""
        top = self.u * math.cos(end)
        a = self.a
        longest = (top - along) / a

        def arc(touch: float) -> tuple[float, float, float, float]:
            """Constants of the catenary that touches the circle at this angle, and by how much it misses `across`."""
            size = self.u * (math.cos(end) - math.cos(touch)) / a
            side = size * math.cos(touch)
            before = size * math.sin(touch)
            begin = math.sqrt(max(before * before, longest * longest - side * side))
            bent = side * (_asinh(begin, side) - _asinh(before, side))
            return side, before, begin, self.u * math.sin(touch) + a * bent - across

        widest = math.acos(max(-1.0, min(1.0, along / self.u)))
        touch = _root(lambda angle: arc(angle)[3], end, widest)
        side, before, begin, _ = arc(touch)
        free_s = begin - before
        lost_m = 0.5 * a * (_area(begin, side) - _area(before, side))
        along_m = top * free_s - lost_m + self.u * self.u / a * (math.sin(touch) - math.sin(end))
        size = math.hypot(side, begin)
        acceleration = (a * begin / size, -a * side / size) if size > _ROUNDING else (0.0, 0.0)
        return _Turn(free_s + self.u * (touch - end) / a, along_m, acceleration)


def _asinh(value: float, scale: float) -> float:
    return math.asinh(value / abs(scale)) if abs(scale) > _ROUNDING else 0.0


def _area(value: float, scale: float) -> float:
    """Twice the integral of √(k² + z²) from 0 to z."""
    return value * math.hypot(scale, value) + scale * scale * _asinh(value, scale)


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Return where a function changes its sign: false position, where the end that stays counts half (Illinois)."""
    below = function(low)
    above = function(high)
    if (below > 0.0) is (above > 0.0):  # rounding at an end that is the root
        return low if abs(below) < abs(above) else high
    for _ in range(_STEPS):
        if high - low <= _ROUNDING or below == above:
            break
        middle = low - below * (high - low) / (above - below)
        value = function(middle)
        if abs(value) <= _ROUNDING:
            return middle
        if (value > 0.0) is (above > 0.0):
            high = middle
            above = value
            below = 0.5 * below
        else:
            low = middle
            below = value
            above = 0.5 * above
    return 0.5 * (low + high)
