"""Six pursuers, four evaders, one target: the matching, the guaranteed captures, and a simulation.

python docs/examples/teams.py
"""

import numpy as np

from guidance.game import Ball, End, Game
from guidance.game.team import TeamRollout, match_teams, rollout_teams

GAME = Game(Ball(2.0), evader_speed_m_s=1.0)
PURSUERS = np.array(
    [[6, 4, 5], [6, -5, 3], [-9, 9, 9], [0, 12, 4], [-6, -8, 6], [14, 2, 8]], dtype=float
)
EVADERS = np.array([[9, 0, 0], [-20, 3, 0], [4, 18, 0], [-8, -16, 0]], dtype=float)
TARGET = np.zeros(3)


def main() -> TeamRollout:
    """Match the teams, print the matching, and simulate the game."""
    matching = match_teams(GAME, PURSUERS, EVADERS, target=TARGET)
    print(f"{int(matching.guaranteed)} of {len(EVADERS)} captures are guaranteed")
    for evader, (first, second, value) in enumerate(
        zip(matching.first, matching.second, matching.value, strict=True)
    ):
        team = (
            "nobody"
            if first < 0
            else f"pursuer {first}" + (f" and {second}" if second >= 0 else "")
        )
        print(f"evader {evader}: {team}, kept {value:.2f} m from the target")
    played = rollout_teams(GAME, PURSUERS, EVADERS, TARGET, capture_m=0.05, step_s=0.1)
    for evader, (end, distance) in enumerate(zip(played.end, played.distance_m, strict=True)):
        print(f"evader {evader}: {End(int(end)).name.lower()}, {distance:.2f} m from the target")
    return played


if __name__ == "__main__":
    main()
