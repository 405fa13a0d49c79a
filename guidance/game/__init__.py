"""Pursuit-evasion games of a faster pursuer in space and a slower evader in a plane, in closed form."""

from guidance.game.game import Ball, Cylinder, Game, SpeedSet, StandOff
from guidance.game.policies import EVADER_POLICIES, PURSUER_POLICIES, Policy
from guidance.game.reasons import Reason, Winner
from guidance.game.solve import Solution, solve

__all__ = [
    "EVADER_POLICIES",
    "PURSUER_POLICIES",
    "Ball",
    "Cylinder",
    "Game",
    "Policy",
    "Reason",
    "Solution",
    "SpeedSet",
    "StandOff",
    "Winner",
    "solve",
]
