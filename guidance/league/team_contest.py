"""A league of rules of teams: captures of every rule against every kind of evader, on common random states.

Every rule plays the games of the same seeds, so a rule is compared with the others game by game. `guaranteed` are the
captures that the matching at the start can force (`guidance.game.team.match_teams`). A game with fewer breaks a
promise, which only the plays "optimal" and "captures" give.
"""

from collections.abc import Iterator
from typing import Any, Final, NamedTuple

import numpy as np
from rich.console import Console

from guidance.config import parse_document
from guidance.errors import ConfigError
from guidance.game import End
from guidance.game.team import TEAM_RULES
from guidance.game.team.rollout import CAPTURES
from guidance.league.contest import CONFIDENCE, RESAMPLES
from guidance.screen import print_text_table
from guidance.sim.scenario import PURSUER
from guidance.sim.teams import TeamScenario, played_teams, teams_of
from guidance.strategies import OPTIMAL, uniform

_ROWS: Final = 256
"""Games that are played at a time."""

_STREAM: Final = 43
"""Random stream of the bootstrap."""


class TeamRow(NamedTuple):
    """The games of a rule against a kind of evaders.

    Attributes:
        player: policy of the pursuers.
        opponent: policy of the evaders.
        games: number of games.
        evaders: number of evaders of a game.
        guaranteed: share of the evaders whose capture is guaranteed at the start.
        captured: share of the evaders that were captured.
        low: lower end of its 95 % interval.
        high: upper end.
        fewer: games with fewer captures than guaranteed.
        closer: games with a promised evader that ended a tenth closer to its target than guaranteed, or a tenth later.
    """

    player: str
    opponent: str
    games: int
    evaders: int
    guaranteed: float
    captured: float
    low: float
    high: float
    fewer: int
    closer: int


class TeamContest(NamedTuple):
    """The games of a league of teams: policies of both sides, and the number and first seed of the games."""

    scenario: TeamScenario
    players: tuple[str, ...]
    opponents: tuple[str, ...]
    games: int
    seed: int


def team_contest_of(
    scenario: TeamScenario, policy: str, side: str, games: int, seed: int
) -> TeamContest:
    """Return the contest of a policy of the pursuers beside the built-in plays and rules.

    Raises:
        ConfigError: If the side is not the pursuers', the policy is unknown, or no place depends on the seed.
    """
    if side != PURSUER:
        raise ConfigError(f"--side {side}: a league of teams compares pursuers; leave it out")
    if not any(group.scatter_m for group in (*scenario.pursuer, *scenario.evader)):
        raise ConfigError("scatter_m: 0 in all tables, so all games would be the same; set it")
    plays = (OPTIMAL, *TEAM_RULES)
    evaders = (OPTIMAL, "pure_evade")
    if scenario.target is not None:
        plays = (OPTIMAL, CAPTURES, *TEAM_RULES)
        evaders = ("task_oriented", OPTIMAL)
    players = tuple(dict.fromkeys((policy, *plays)))
    contest = TeamContest(scenario, players, evaders, games, seed)
    with_team_policies(scenario, policy, evaders[0])
    return contest


def with_team_policies(scenario: TeamScenario, pursuer: str, evader: str) -> TeamScenario:
    """Return a scenario with one policy for all players of a side, checked as a file's.

    Raises:
        ConfigError: If a policy is unknown.
    """
    pursuers = [group.model_copy(update={"policy": pursuer}) for group in scenario.pursuer]
    evaders = [group.model_copy(update={"policy": evader}) for group in scenario.evader]
    document = scenario.model_dump(mode="json", exclude={"expect"}, exclude_unset=True)
    document["pursuer"] = [group.model_dump(mode="json") for group in pursuers]
    document["evader"] = [group.model_dump(mode="json") for group in evaders]
    return parse_document(TeamScenario, document, source=scenario.title)


def play_team_pair(contest: TeamContest, player: str, opponent: str) -> TeamRow:
    """Play all games of a pair of policies."""
    scenario = with_team_policies(contest.scenario, player, opponent)
    captured = []
    guaranteed = []
    closer = 0
    for begin in range(0, contest.games, _ROWS):
        numbers = range(begin, min(begin + _ROWS, contest.games))
        seeded = [scenario.model_copy(update={"seed": contest.seed + number}) for number in numbers]
        rollout = played_teams(scenario, [teams_of(one) for one in seeded])
        captured.append(np.count_nonzero(rollout.end == End.CAPTURED, axis=1))
        guaranteed.append(rollout.first.guaranteed)
        value = np.where(rollout.first.first >= 0, rollout.first.value, 0.0)
        if scenario.target is None:
            broken = (rollout.first.first >= 0) & (rollout.time_s > 1.1 * value)
        else:
            broken = rollout.distance_m < 0.9 * value
        closer += int(np.count_nonzero(broken.any(axis=1)))
    captures = np.concatenate(captured)
    sure = np.concatenate(guaranteed)
    evaders = len(teams_of(scenario).evaders_m)
    # The resampled games are the same for every pair.
    shares = captures / evaders
    count = len(shares)
    means = []
    for number in range(RESAMPLES):
        places = uniform(np.int64(contest.seed), _STREAM, np.arange(count) + number * count)
        means.append(shares[(places * count).astype(np.intp)].mean())
    low, high = np.quantile(means, CONFIDENCE).tolist()
    return TeamRow(
        player,
        opponent,
        contest.games,
        evaders,
        float(sure.mean() / evaders),
        float(captures.mean() / evaders),
        low,
        high,
        int(np.count_nonzero(captures < sure)),
        closer,
    )


def play_all_teams(contest: TeamContest) -> Iterator[TeamRow]:
    """Play every pair, the player's opponents one after the other."""
    for player in contest.players:
        for opponent in contest.opponents:
            yield play_team_pair(contest, player, opponent)


def print_team_table(target: Console, contest: TeamContest, rows: list[TeamRow]) -> None:
    """Print a row for each pair."""
    unit = "later" if contest.scenario.target is None else "closer"
    headings = ["pursuers", "against", "guaranteed %", "captured %", "fewer than guaranteed", unit]
    cells = [
        [
            row.player,
            row.opponent,
            f"{100.0 * row.guaranteed:.1f}",
            f"{100.0 * row.captured:.1f} [{100.0 * row.low:.1f}, {100.0 * row.high:.1f}]",
            str(row.fewer),
            str(row.closer),
        ]
        for row in rows
    ]
    print_text_table(target, headings, cells, left=range(2))


def team_document_of(contest: TeamContest, rows: list[TeamRow]) -> dict[str, Any]:
    """Return the results as plain values."""
    return {
        "scenario": contest.scenario.title,
        "game": contest.scenario.game,
        "side": PURSUER,
        "games": contest.games,
        "seed": contest.seed,
        "confidence": 0.95,
        "rows": [row._asdict() for row in rows],
    }
