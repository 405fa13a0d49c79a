"""Both players of the paper's game as they are seen from an edge of the target: the margin along it has one unknown.

With the evader's distance A and the pursuer's distance B, in space, from a point of the edge, the margin there is
A/v − B/u. Its slope along the edge is sin α/v − sin β/u, with the angles of both ways to the edge's normal: where it is
zero, the ways are those of refracted light.
"""

from typing import NamedTuple

from guidance.game.arrays import Library, Plane, Real, cross2, dot2
from guidance.game.brackets import Pose

TINY = 1e-300
"""Added to squares of distances, so that none is zero; less than any rounding error."""


class SeenLine(NamedTuple):
    """A straight edge; positions on it are metres from the evader's foot towards the pursuer's foot.

    Attributes:
        u: speed of the pursuer, m/s.
        v: speed of the evader, m/s.
        apart_square: square of the evader's distance from the line, m².
        between: distance of both feet, m.
        height_square: square of the pursuer's distance from the line, in space, m².
    """

    u: Real
    v: Real
    apart_square: Real
    between: Real
    height_square: Real

    @property
    def curved(self) -> bool:
        """True if a pose has the derivatives of the slope."""
        return True

    def pose(self, xp: Library, position: Real) -> Pose:
        """Return the margin at a position and its derivatives."""
        past = position - self.between
        run_square = position * position + (self.apart_square + TINY)
        flight_square = past * past + (self.height_square + TINY)
        run = xp.sqrt(run_square)
        flight = xp.sqrt(flight_square)
        arrives = 1.0 / (self.v * run)
        guards = 1.0 / (self.u * flight)
        run_inverse = 1.0 / run_square
        flight_inverse = 1.0 / flight_square
        run_bend = self.apart_square * run_inverse * arrives
        flight_bend = self.height_square * flight_inverse * guards
        return Pose(
            margin=run / self.v - flight / self.u,
            slope=position * arrives - past * guards,
            bend=run_bend - flight_bend,
            twist=3.0 * (past * flight_bend * flight_inverse - position * run_bend * run_inverse),
        )

    def refracted(self, xp: Library, position: Real) -> Real:
        """Return where the evader's way is right for the angle of the pursuer's way to a position."""
        past = position - self.between
        flight = xp.sqrt(past * past + (self.height_square + TINY))
        sine = self.v * past / (self.u * flight)
        return sine * xp.sqrt(self.apart_square / (1.0 - sine * sine))


class SeenArc(NamedTuple):
    """A circle; positions on it are tangents of half the angle from the direction to the evader.

    Angles count towards the side of the pursuer.

    Attributes:
        u: speed of the pursuer, m/s.
        v: speed of the evader, m/s.
        radius: of the circle, m.
        apart: distance of the evader from the circle, m.
        pursuer: its place from the centre, m: towards the evader, and aside of that.
        height_square: square of the pursuer's height, m².
    """

    u: Real
    v: Real
    radius: Real
    apart: Real
    pursuer: Plane
    height_square: Real

    @property
    def curved(self) -> bool:
        """True if a pose has the derivatives of the slope."""
        return True

    def pose(self, xp: Library, position: Real) -> Pose:  # noqa: PLR0914
        """Return the margin at a position and its derivatives; the slope is by metres along the circle."""
        square = position * position
        scale = 1.0 / (1.0 + square)
        outward = ((1.0 - square) * scale, (position + position) * scale)
        evader = self.radius + self.apart
        # Without the difference of squares that cancels where the evader is close
        run_square = self.apart * self.apart + 4.0 * self.radius * evader * (square * scale) + TINY
        run = xp.sqrt(run_square)
        arrives = 1.0 / (self.v * run)
        aside = evader * outward[1]
        away = (
            self.radius * outward[0] - self.pursuer[0],
            self.radius * outward[1] - self.pursuer[1],
        )
        flight_square = dot2(away, away) + (self.height_square + TINY)
        flight = xp.sqrt(flight_square)
        guards = 1.0 / (self.u * flight)
        past = cross2(self.pursuer, outward)
        run_slope = aside * arrives
        flight_slope = past * guards
        # The bends and the twist by angle; times a circle's radius over the way they are without unit
        run_share = self.radius / run_square
        flight_share = self.radius / flight_square
        run_bend = evader * outward[0] - run_share * aside * aside
        flight_bend = dot2(self.pursuer, outward) - flight_share * past * past
        bend = run_bend * arrives - flight_bend * guards
        run_twist = run_slope * (1.0 + 3.0 * run_share * run_bend)
        flight_twist = flight_slope * (1.0 + 3.0 * flight_share * flight_bend)
        turn = scale + scale
        return Pose(
            margin=run / self.v - flight / self.u,
            slope=run_slope - flight_slope,
            bend=turn * bend,
            twist=turn * turn * (flight_twist - run_twist - position * bend),
        )

    def refracted(self, xp: Library) -> Real:
        """Return where the evader's way is right for the angle of the pursuer's way to the point nearest to E."""
        ahead = self.radius - self.pursuer[0]
        aside = self.pursuer[1]
        flight = xp.sqrt(ahead * ahead + aside * aside + (self.height_square + TINY))
        sine = -self.v * aside / (self.u * flight)
        # Sine of the angle between the evader's way and its way to the centre
        other = sine * self.radius / (self.radius + self.apart)
        cosine = xp.sqrt(1.0 - sine * sine)
        other_cosine = xp.sqrt(1.0 - other * other)
        turned = 1.0 + cosine * other_cosine + sine * other
        return (sine * other_cosine - cosine * other) / turned
