"""Scenarios of teams simulated with point masses; one outcome row for each evader."""

import math
from collections.abc import Hashable, Sequence
from typing import Any, NamedTuple

import numpy as np

from guidance.game import Ball, End, Game
from guidance.game.team import Matching, TeamRollout, match_teams, rollout_teams
from guidance.sim.expect import WINNERS
from guidance.sim.outcome import achieved_and_regret, winner_name
from guidance.sim.teams import Teams, TeamScenario, teams_of

_ENDS = {End.CAPTURED: "captured", End.ARRIVED: "arrived", End.TIME_UP: "time_up"}


class TeamOutcome(NamedTuple):
    """The outcome for one evader of a game of teams. Columns are as in `Outcome`; NaN means "none".

    Attributes:
        scenario: Title.
        run: "maths", always.
        game: "pe" or "tad".
        evader: Number of the evader, from 0.
        pursuer_policy: Of the pursuers; several are joined by "+".
        evader_policy: Of this evader.
        seed: Seed of all random numbers.
        pursuers: Number of pursuers.
        evaders: Number of evaders.
        guaranteed: Captures guaranteed at the start, in the whole game.
        captured: Captures in the whole game.
        end: "captured", "arrived", "time_up", or "invalid" (only in sweeps).
        winner: "pursuer", "evader" or "none".
        predicted_winner: "pursuer" where the capture was guaranteed, else "evader" (TAD) or "none" (PE).
        first: Number of the pursuer that guaranteed the capture; −1 for none.
        second: Number of the pursuer that supports it; −1 for none.
        captor: Number of the pursuer that captured the evader; −1 for none.
        game_time_s: Time of its end.
        capture_time_s: The same if it is a capture.
        evader_to_target_m: Of the evader from its target; NaN in PE.
        predicted: TAD: the guaranteed distance, m. PE: the guaranteed time, s.
        lower_bound: PE: the time that the evader had at least, s. TAD: as predicted.
        achieved: In the unit of predicted; NaN without a capture.
        regret: Loss of the pursuers against the guarantee: achieved − predicted in PE, predicted − achieved in TAD.
        ratio: achieved / predicted.
        reason: Why it is invalid, else empty.
    """

    scenario: str
    run: str
    game: str
    evader: int = -1
    pursuer_policy: str = ""
    evader_policy: str = ""
    seed: int = 0
    pursuers: int = 0
    evaders: int = 0
    guaranteed: int = 0
    captured: int = 0
    end: str = "invalid"
    winner: str = "none"
    predicted_winner: str = "none"
    first: int = -1
    second: int = -1
    captor: int = -1
    game_time_s: float = math.nan
    capture_time_s: float = math.nan
    evader_to_target_m: float = math.nan
    predicted: float = math.nan
    lower_bound: float = math.nan
    achieved: float = math.nan
    regret: float = math.nan
    ratio: float = math.nan
    reason: str = ""


def play_teams(scenarios: Sequence[TeamScenario]) -> list[list[TeamOutcome]]:
    """Simulate scenarios; return the rows of each, one for every evader."""
    teams = [teams_of(scenario) for scenario in scenarios]
    kinds: dict[Hashable, list[int]] = {}
    for index, (scenario, team) in enumerate(zip(scenarios, teams, strict=True)):
        kinds.setdefault(_kind_of(scenario, team), []).append(index)
    outcomes: dict[int, list[TeamOutcome]] = {}
    for indices in kinds.values():
        played = played_teams(scenarios[indices[0]], [teams[index] for index in indices])
        for row, index in enumerate(indices):
            outcomes[index] = _outcomes(scenarios[index], teams[index], played, row)
    return [outcomes[index] for index in range(len(scenarios))]


def played_teams(scenario: TeamScenario, teams: Sequence[Teams], *, keep_path: bool = False) -> TeamRollout:
    """Simulate several teams of one kind as a batch, with the settings of a scenario."""
    target = None if teams[0].target_m is None else np.array([[one.target_m] for one in teams])
    u = np.array([one.pursuer_speed_m_s[:, None] for one in teams])
    v = np.array([one.evader_speed_m_s[None, :] for one in teams])
    return rollout_teams(
        Game(Ball(u), v),
        np.array([one.pursuers_m for one in teams]),
        np.array([one.evaders_m for one in teams]),
        target,
        pursuer_policy=teams[0].pursuer_policy,
        evader_policy=teams[0].evader_policy,
        capture_m=scenario.capture_m,
        hysteresis=scenario.hysteresis,
        step_s=scenario.step_s,
        duration_s=scenario.time_limit_s,
        keep_path=keep_path,
    )


def opening_of(scenario: TeamScenario) -> Matching:
    """Match the teams of a scenario at its start."""
    teams = teams_of(scenario)
    return match_teams(teams.game, teams.pursuers_m, teams.evaders_m, teams.target_m)


def summary_of(rows: Sequence[TeamOutcome]) -> dict[str, Any]:
    """Return the summary of a game of teams."""
    regrets = [row.regret for row in rows if not math.isnan(row.regret)]
    sure = [row.predicted for row in rows if row.predicted_winner == "pursuer"]
    return {
        "pursuers": rows[0].pursuers,
        "evaders": rows[0].evaders,
        "guaranteed": rows[0].guaranteed,
        "captured": rows[0].captured,
        "total": math.fsum(sure),
        "worst_regret": max(regrets, default=math.nan),
    }


def _kind_of(scenario: TeamScenario, teams: Teams) -> Hashable:
    """Return a key that is equal for scenarios of one batch."""
    rules = (scenario.capture_m, scenario.hysteresis, scenario.step_s, scenario.time_limit_s)
    return (scenario.game, teams.pursuer_policy, teams.evader_policy, rules)


def _outcomes(scenario: TeamScenario, teams: Teams, played: TeamRollout, row: int) -> list[TeamOutcome]:
    first = played.first
    ends = [_ENDS[End(int(end))] for end in played.end[row]]
    rows = []
    for j, end in enumerate(ends):
        sure = bool(first.first[row, j] >= 0)
        time, predicted = float(played.time_s[row, j]), float(first.value[row, j])
        distance = float(played.distance_m[row, j])
        achieved, regret = achieved_and_regret(scenario.game, end, time, distance, predicted)
        rows.append(
            TeamOutcome(
                scenario=scenario.title,
                run="maths",
                game=scenario.game,
                evader=j,
                pursuer_policy="+".join(dict.fromkeys(teams.pursuer_policy)),
                evader_policy=teams.evader_policy[j],
                seed=scenario.seed,
                pursuers=len(teams.pursuers_m),
                evaders=len(teams.evaders_m),
                guaranteed=int(first.guaranteed[row]),
                captured=ends.count("captured"),
                end=end,
                winner=WINNERS.get(end, "none"),
                predicted_winner=winner_name(int(first.winner[row, j])),
                first=int(first.first[row, j]),
                second=int(first.second[row, j]),
                captor=int(played.captor[row, j]),
                game_time_s=time,
                capture_time_s=time if end == "captured" else math.nan,
                evader_to_target_m=distance,
                predicted=predicted,
                lower_bound=float(first.lower_bound[row, j]),
                achieved=achieved,
                regret=regret if sure else math.nan,
                ratio=achieved / predicted if sure and predicted else math.nan,
            )
        )
    return rows
