"""Teams: several pursuers against one evader, and many against many.

solve_team: several pursuers against one evader, as a `TeamSolution`: value, meeting point, which pursuers bind.
match_teams: who goes for whom so that the most captures are guaranteed, as a `Matching`.
rollout_teams: all of them played to the end, as a `TeamRollout`, whose path is of `TeamSample`s.
"""

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
