"""Pursuit-evasion games of a faster pursuer in space and a slower evader in a plane, in closed form."""

from guidance.game.apollonius import Apollonius, apollonius_circle, apollonius_sphere, barrier
from guidance.game.game import Ball, Cylinder, Game, Reason, SpeedSet, StandOff, Winner, guaranteed_age_s
from guidance.game.gradient import Gradient, value_gradient
from guidance.game.hji import hji_residual
from guidance.game.policies import EVADER_POLICIES, PURSUER_POLICIES, Policy
from guidance.game.rollout import Rollout, rollout
from guidance.game.solution import Solution, solve
from guidance.game.stepping import End, Exact, Paper

__all__ = [
    "EVADER_POLICIES",
    "PURSUER_POLICIES",
    "Apollonius",
    "Ball",
    "Cylinder",
    "End",
    "Exact",
    "Game",
    "Gradient",
    "Paper",
    "Policy",
    "Reason",
    "Rollout",
    "Solution",
    "SpeedSet",
    "StandOff",
    "Winner",
    "apollonius_circle",
    "apollonius_sphere",
    "barrier",
    "guaranteed_age_s",
    "hji_residual",
    "rollout",
    "solve",
    "value_gradient",
]
