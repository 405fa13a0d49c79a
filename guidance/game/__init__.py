"""Pursuit-evasion games of a faster pursuer in space and a slower evader in a plane, in closed form.

The game:
    Game: one pursuer against one evader, with the extensions of a vehicle: stand-off, wind, old information.
    Ball, Cylinder: the pursuer's speed set; `SpeedSet` is their interface, `guidance.game.speed_sets` their package.
    StandOff: the disc around the evader that the pursuer aims for.
    Extent: the shape of the evader's target about its position: a disc, a segment, a convex polygon.
    guaranteed_age_s: the largest age of the evader's position with a guaranteed value of PE.

Its answer:
    solve: both players' optimal play, for one state or a million, as a `Solution`.
    solve_state: the same of one state in plain numbers, as a `StateSolution`.
    Winner, Reason: the winner, and the kind of the answer, as numbers with names.
    apollonius_circle, apollonius_sphere: the points that both players reach at the same time, as an `Apollonius`.
    barrier: the paper's function that is zero between both players' wins.

Its play:
    rollout: simulate two policies to the end, as a `Rollout` with its `End`.
    Exact, Paper: stepping of a rollout, exact up to the end or as for the published tables.
    PURSUER_POLICIES, EVADER_POLICIES: the policies without memory, by name; each is a `Policy`.

`guidance.game.verification` has gradients of the value, the HJI residual and the paper's angles.
`guidance.game.team` has several pursuers and several evaders. Positions are arrays (..., 3) in m, of NumPy, PyTorch or
JAX, or lists (`numpy.typing.ArrayLike`). Answers are annotated as `Array`.

Examples:
    The time in s until the capture in the paper's PE state:

    >>> from guidance import game
    >>> paper = game.Game(game.Ball(2.0), evader_speed_m_s=1.0)
    >>> float(game.solve(paper, [8, 1.42, 9.41], [7.92, 9.6, 0]).value.round(4))
    10.4247
"""

from guidance.game.apollonius import Apollonius, apollonius_circle, apollonius_sphere, barrier
from guidance.game.arrays import Array
from guidance.game.extent import Extent
from guidance.game.game import Game, Reason, StandOff, Winner, guaranteed_age_s
from guidance.game.pe import StateSolution
from guidance.game.policies import EVADER_POLICIES, PURSUER_POLICIES, Policy
from guidance.game.rollout import End, Exact, Paper, Rollout, rollout
from guidance.game.solution import Solution, solve, solve_state
from guidance.game.speed_sets import Ball, Cylinder, SpeedSet

__all__ = [
    "EVADER_POLICIES",
    "PURSUER_POLICIES",
    "Apollonius",
    "Array",
    "Ball",
    "Cylinder",
    "End",
    "Exact",
    "Extent",
    "Game",
    "Paper",
    "Policy",
    "Reason",
    "Rollout",
    "Solution",
    "SpeedSet",
    "StandOff",
    "StateSolution",
    "Winner",
    "apollonius_circle",
    "apollonius_sphere",
    "barrier",
    "guaranteed_age_s",
    "rollout",
    "solve",
    "solve_state",
]
