"""The league: policies of one side against policies of the other, on common random states.

Every pair plays the same states, as point masses in `guidance.sim.maths`. The loss of a game is the change of its
score (`guidance.league.play`) from the first state to the end. A game that the player leaves without a winner also
costs the remaining value, and no less than a lost game. All numbers depend on the scenario and the seed only, bit for
bit, on one machine with one version of NumPy.
"""

from collections.abc import Iterator
from operator import itemgetter
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from guidance.errors import ConfigError
from guidance.game import EVADER_POLICIES, PURSUER_POLICIES, Cylinder, End
from guidance.game.arrays import FloatArray
from guidance.game.records import rows_of
from guidance.league.frpn import FRPN, FRPN_LEVEL
from guidance.league.play import losses_of
from guidance.league.sides import Side, with_flown_speeds
from guidance.league.states import (
    States,
    arena_of,
    batch_at,
    random_states,
    scenario_at,
    seeds_of,
)
from guidance.sim.maths import moments
from guidance.sim.scenario import EVADER, PURSUER, Scenario
from guidance.sim.scenario_file import with_policies
from guidance.strategies import uniform
from guidance.strategies.catalogue import PROPORTIONAL
from guidance.strategies.own import is_own, require_fit

_ROWS: Final = 4096
"""Games that are played at a time."""

RESAMPLES: Final = 200
"""Bootstrap samples of an interval."""

BOOTSTRAP_STREAM: Final = 41

TRIAL: Final = 16
"""Number of states for trying a policy before any game."""

CONFIDENCE: Final = (0.025, 0.975)
"""Quantiles of the resampled numbers that bound an interval."""

TASK: Final = "task_oriented"
STANDING: Final = "hold"
TURNING: Final = "random_turns"


class IntervalEstimate(NamedTuple):
    """A number of the games that were played, and its 95 % confidence interval."""

    value: float
    low: float
    high: float


class Row(NamedTuple):
    """The games of a pair of policies.

    Attributes:
        player: Policy of the side that is compared.
        opponent: Policy of the other side.
        games: Number of games.
        won: Share that the player won.
        failed: Number of games that a policy without an answer, or the sensor, ended without a winner.
        undecided: Number of games that the time limit ended.
        median: Regret of half of the games, s (PE) or m (TAD).
        p95: Regret of 95 % of the games.
        worst: The largest regret.
        relative: PE: the median of the regret over the game's value; NaN in TAD.
    """

    player: str
    opponent: str
    games: int
    won: IntervalEstimate
    failed: int
    undecided: int
    median: IntervalEstimate
    p95: IntervalEstimate
    worst: float
    relative: IntervalEstimate


class PlayedPair(NamedTuple):
    """A pair's row, and of each game its regret, and its end."""

    row: Row
    regret: FloatArray
    end: NDArray[np.int8]


class Contest(NamedTuple):
    """The games of a league: scenario, policies and initial states."""

    scenario: Scenario
    side: str
    players: tuple[str, ...]
    opponents: tuple[str, ...]
    states: States
    seed: int


def contest_of(scenario: Scenario, policy: str, side: str, games: int, seed: int) -> Contest:
    """Return the contest of a policy and the built-in policies of its side; the policy is loaded and tried.

    The pursuer has the speed set of the scenario's flight.

    Raises:
        ConfigError: If the policy is unknown or does not fit the game, or an argument is out of range.
    """
    if side not in {PURSUER, EVADER}:
        raise ConfigError(f"--side {side}: must be {PURSUER} or {EVADER}")
    if not 1 <= games <= 1 << 24:
        raise ConfigError(f"--games {games}: must be from 1 to {1 << 24}")
    scenario = with_flown_speeds(scenario)
    states = random_states(arena_of(scenario), seeds_of(seed, games))
    fast_response = FRPN_LEVEL if scenario.pursuer.speed_set == Cylinder.name else FRPN
    pursuers = built_in_policies(scenario, tuple(PURSUER_POLICIES), (PROPORTIONAL, fast_response))
    evaders = built_in_policies(scenario, tuple(EVADER_POLICIES), (TURNING, STANDING))
    built_in, opponents = (pursuers, evaders) if side == PURSUER else (evaders, pursuers)
    players = tuple(dict.fromkeys((policy, *built_in)))
    contest = Contest(scenario, side, players, opponents, states, seed)
    # A scenario with it is refused if the name is unknown
    with_policies(scenario, **{side: policy})
    if is_own(policy):
        # Ask the policy for actions in a few states.
        asked = Side(contest.side, arena_of(contest.scenario))
        bounds = asked.bounds()
        draws = uniform(np.arange(TRIAL)[:, None], BOOTSTRAP_STREAM, np.arange(len(bounds.low)))
        require_fit(policy, 0.1 * (2.0 * draws - 1.0) * bounds.high, asked.shares)
    return contest


def built_in_policies(
    scenario: Scenario, memoryless: tuple[str, ...], others: tuple[str, ...]
) -> tuple[str, ...]:
    """Return the built-in policies of one side, those with a memory last, that can play a scenario."""
    left_out = {STANDING} if scenario.target is not None else {STANDING, TASK}
    return (*(name for name in memoryless if name not in left_out), *others)


def play_pair(contest: Contest, player: str, opponent: str) -> PlayedPair:
    """Play every state with a pair of policies."""
    opposing_side = EVADER if contest.side == PURSUER else PURSUER
    scenario = with_policies(contest.scenario, **{contest.side: player, opposing_side: opponent})
    arena = arena_of(scenario)
    count = len(contest.states.seed)
    loss = np.zeros(count)
    value = np.zeros(count)
    end = np.zeros(count, dtype=np.int8)
    for start in range(0, count, _ROWS):
        part = slice(start, start + _ROWS)
        batch = batch_at(arena.template, rows_of(contest.states, itemgetter(part)))
        chunk = losses_of(arena, batch, moments(batch), contest.side)
        loss[part] = chunk.loss
        value[part] = chunk.value
        end[part] = chunk.end
    sign = 1.0 if contest.side == PURSUER else -1.0
    regret = sign * loss
    return PlayedPair(_summed_up(contest, player, opponent, regret, value, end), regret, end)


def play_all(contest: Contest) -> Iterator[PlayedPair]:
    """Play every pair, the player's opponents one after the other."""
    for player in contest.players:
        for opponent in contest.opponents:
            yield play_pair(contest, player, opponent)


def _summed_up(
    contest: Contest,
    player: str,
    opponent: str,
    regret: FloatArray,
    value: FloatArray,
    end: NDArray[np.int8],
) -> Row:
    winning = End.CAPTURED if contest.side == PURSUER else End.ARRIVED
    won = (end == winning).astype(np.float64)
    if contest.side == EVADER and contest.scenario.target is None:
        won = (end == End.TIME_UP).astype(np.float64)  # it was not captured in time
    relative = np.full(len(regret), np.nan)
    if contest.scenario.target is None:
        relative = regret / value
    # The resampled games are the same for every pair, so that pairs can be compared.
    count = len(won)
    samples = np.empty((RESAMPLES, 4))
    for number in range(RESAMPLES):
        places = uniform(
            np.int64(contest.seed), BOOTSTRAP_STREAM, np.arange(count) + number * count
        )
        picked = (places * count).astype(np.intp)
        samples[number] = _statistics(won[picked], regret[picked], relative[picked])
    bounds = np.quantile(samples, CONFIDENCE, axis=0)
    numbers = _statistics(won, regret, relative)
    rate, median, p95, share = [
        IntervalEstimate(float(value), float(low), float(high))
        for value, low, high in zip(numbers, *bounds, strict=True)
    ]
    return Row(
        player,
        opponent,
        len(regret),
        rate,
        int(np.count_nonzero(end == End.NO_ANSWER)),
        int(np.count_nonzero(end == End.TIME_UP)),
        median,
        p95,
        float(regret.max()),
        share,
    )


def _statistics(won: FloatArray, regret: FloatArray, relative: FloatArray) -> tuple[Any, ...]:
    median, p95 = np.quantile(regret, (0.5, 0.95))
    return won.mean(), median, p95, np.quantile(relative, 0.5)


def worst_rows(played: PlayedPair, count: int) -> list[int]:
    """Return the numbers of the games with the largest regret, the worst first."""
    order = np.argsort(-played.regret, kind="stable")
    return [int(row) for row in order[:count]]


def scenario_of_game(contest: Contest, row: Row, number: int) -> Scenario:
    """Return one game as a scenario, with both policies."""
    opposing_side = EVADER if contest.side == PURSUER else PURSUER
    names = {contest.side: row.player, opposing_side: row.opponent}
    return scenario_at(with_policies(contest.scenario, **names), contest.states, number)
