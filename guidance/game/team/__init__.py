"""Teams: several pursuers against one evader, and many against many.

solve_team: several pursuers against one evader, as a `TeamSolution`: value, meeting point, which pursuers bind.
match_teams: assign pursuers to evaders for the most guaranteed captures, as a `Matching`.
between: the game of every pair of some vehicles and evaders, from one vehicle's game.
rollout_teams: simulate a game of teams to its end, as a `TeamRollout` with `TeamSample`s.
TEAM_RULES: rules of teams without promises, by name; each is a `TeamRule`, a function of a `TeamView`.
"""

from guidance.game.team.arguments import between
from guidance.game.team.matching import Matching, match_teams
from guidance.game.team.rollout import TeamRollout, TeamSample, rollout_teams
from guidance.game.team.rules import TEAM_RULES, TeamRule, TeamView
from guidance.game.team.several import TeamSolution, solve_team

__all__ = [
    "TEAM_RULES",
    "Matching",
    "TeamRollout",
    "TeamRule",
    "TeamSample",
    "TeamSolution",
    "TeamView",
    "between",
    "match_teams",
    "rollout_teams",
    "solve_team",
]
