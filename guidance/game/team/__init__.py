"""Teams: several pursuers against one evader, and many against many."""

from guidance.game.team.matching import Matching, match_teams
from guidance.game.team.rollout import TeamRollout, TeamSample, rollout_teams
from guidance.game.team.several import TeamSolution, solve_team

__all__ = [
    "Matching",
    "TeamRollout",
    "TeamSample",
    "TeamSolution",
    "match_teams",
    "rollout_teams",
    "solve_team",
]
