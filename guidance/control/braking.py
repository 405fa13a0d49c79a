"""Braking fed forward: what a vehicle has to decelerate by before a wall that stands still goes out with the velocity.

A velocity that is only cut leaves the braking to the autopilot's own correction, which has to see an error first, and
gives too little where its integral leans the other way: one that has stood against a head wind drives the vehicle on
for seconds once that ends. Of a deceleration that is fed forward it needs to see nothing.

With closing speed c and what the drift c · reaction leaves of the distance, v · reaction + v² / (2 · braking) = left
tells the speed v that is allowed (`approach_speed`). What c is above it has to be gone within half the reaction:

    deceleration ≥ 2 · (c - v) / reaction

It binds wherever a vehicle closes on a wall too fast, whatever is asked of it: also one that is told to stand still, or
to come back. The walls are fences, floor and ceiling. An evader is arrived at, and a wall is not: the approach keeps
off the stand-off by itself, and the servo feeds its braking forward.
"""

from guidance.control.envelope import Envelope, Situation
from guidance.control.fence import Edge, FenceGeometry
from guidance.control.polygon import Point
from guidance.control.shaping import approach_speed
from guidance.frames import Vector

_NONE: Vector = (0.0, 0.0, 0.0)


def braked(
    feed_forward_ned_m_s2: Vector | None, here: Situation, fence: FenceGeometry, envelope: Envelope
) -> Vector | None:
    """Return a feed-forward that brakes at least as every wall asks; the very same one where none does.

    Args:
        feed_forward_ned_m_s2: What is fed forward without walls; None for nothing.
        here: Where the vehicle is, and how it moves.
        fence: Where it is to the fences.
        envelope: The walls, with the fences' margin, and how it brakes.
    """
    (north, east, down), fed, reaction_s = here.velocity_ned_m_s, feed_forward_ned_m_s2, envelope.reaction_s
    drift_s, braking_m_s2 = 2.0 * reaction_s, envelope.braking_m_s2
    for outward, gap_m in _fences(fence, envelope):
        closing = north * outward[0] + east * outward[1]
        if closing > 0.0 and closing * (drift_s + closing / (2.0 * braking_m_s2)) > gap_m:
            fed = _against(fed, outward, deceleration_m_s2(closing, gap_m, braking_m_s2, reaction_s))

    braking_m_s2, closing = envelope.vertical_braking_m_s2, abs(down)
    height_m = envelope.home_ned_m[2] - here.position_ned_m[2]
    gap_m = height_m - envelope.floor_m if down > 0.0 else envelope.ceiling_m - height_m
    if closing > 0.0 and closing * (drift_s + closing / (2.0 * braking_m_s2)) > gap_m:
        most = -deceleration_m_s2(closing, gap_m, braking_m_s2, reaction_s)
        a_north, a_east, a_down = fed or _NONE
        fed = (a_north, a_east, min(a_down, most) if down > 0.0 else max(a_down, -most))
    return fed


def deceleration_m_s2(closing_m_s: float, gap_m: float, braking_m_s2: float, reaction_s: float) -> float:
    """Return what a vehicle has to decelerate by at least; negative as long as it may still gather speed.

    Args:
        closing_m_s: Its speed towards the wall, not negative.
        gap_m: To the wall, negative beyond it.
        braking_m_s2: What it surely achieves.
        reaction_s: Until it does.
    """
    allowed = approach_speed(gap_m - closing_m_s * reaction_s, braking_m_s2, reaction_s)
    return 2.0 * (closing_m_s - allowed) / reaction_s


def _fences(fence: FenceGeometry, envelope: Envelope) -> list[Edge]:
    """The polygon's edges and, as one more, the circle's nearest: their margin lies inside."""
    margin_m, from_home_m = envelope.fence_margin_m, fence.from_home_m
    found = [Edge(outward, gap_m - margin_m) for outward, gap_m in fence.edges]
    if envelope.fence_radius_m is not None and from_home_m > 0.0:
        north_m, east_m = fence.about_home_m
        found.append(
            Edge((north_m / from_home_m, east_m / from_home_m), envelope.fence_radius_m - margin_m - from_home_m)
        )
    return found


def _against(fed: Vector | None, outward: Point, wanted_m_s2: float) -> Vector:
    north, east, down = fed or _NONE
    missing = max(0.0, north * outward[0] + east * outward[1] + wanted_m_s2)
    return (north - missing * outward[0], east - missing * outward[1], down)
