"""One side of a scenario's games as an agent: its observations and actions with their bounds, and its reward.

Observations and actions are those of `guidance.strategies.own`; a policy has the same ones in flight.
"""

import warnings
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from guidance.errors import ConfigError
from guidance.game import End
from guidance.game.arrays import FloatArray, pair_length
from guidance.league.play import CHOICE_S, Games
from guidance.league.states import Arena, arena_of, seeds_of
from guidance.sim.maths import view_of
from guidance.sim.scenario import EVADER, PURSUER, Scenario
from guidance.sim.scenario_file import load_scenario, with_policies
from guidance.strategies import OPTIMAL
from guidance.strategies.own import (
    EVADER_SHARES,
    PURSUER_SHARES,
    evader_velocity,
    observe_evasion,
    observe_pursuit,
    pursuer_velocity,
)

SIDES: Final = (PURSUER, EVADER)

STEP_S: Final = 0.1
"""Default holding time of an action."""

FARTHEST_SIGMAS: Final = 9.0
"""Normal noise that is drawn from 53 random bits is never farther out."""


ROUNDING: Final = 1e-9
"""A number may exceed its bound by this share: 3.0000000000000004 m/s of 3."""

MOST_LOST: Final = 0.01
"""Share of the value that a step may cost an optimal player without a warning."""

TRIED_GAMES: Final = 256
"""Number of games for measuring the cost of a step."""


class Bounds(NamedTuple):
    """Least and greatest values of each column."""

    low: FloatArray
    high: FloatArray


class Side(NamedTuple):
    """An agent. `name` is "pursuer" or "evader", `arena` its games."""

    name: str
    arena: Arena

    @property
    def shares(self) -> int:
        """Columns of an action."""
        return PURSUER_SHARES if self.name == PURSUER else EVADER_SHARES

    @property
    def sign(self) -> float:
        """Share of the score's change that is this side's reward: 1 of the pursuer, −1 of the evader."""
        return 1.0 if self.name == PURSUER else -1.0

    def observe(self, games: Games) -> FloatArray:
        """Return the observations of all games, (n, k)."""
        moment = games.moment
        batch = games.batch
        P = moment.pursuer_m
        E = moment.evader_m
        if self.name == EVADER:
            return observe_evasion(
                batch.game, P, E, moment.flown_m_s, moment.run_m_s, batch.target_m
            )
        view = view_of(batch, moment, E, moment.run_m_s)
        return observe_pursuit(
            batch.game, P, view.evader_m, view.evader_m_s, moment.flown_m_s, batch.target_m
        )

    def velocity(self, action: FloatArray) -> FloatArray:
        """Return the velocities, (n, 3), m/s, of actions."""
        game = self.arena.template.game
        return (
            pursuer_velocity(game, action)
            if self.name == PURSUER
            else evader_velocity(game, action)
        )

    def checked(self, action: object, count: int) -> FloatArray:
        """Return actions as numbers.

        Raises:
            ConfigError: If they are not finite real numbers of shape (count, `shares`).
        """
        numbers = np.asarray(action)
        shape = (count, self.shares)
        allowed = f"must be real, finite numbers of shape {shape}, shares of the {self.name}'s speed from -1 to 1"
        if numbers.dtype.kind not in "fiu" or numbers.shape != shape:
            raise ConfigError(f"actions: shape {numbers.shape}, dtype {numbers.dtype}: {allowed}")
        if not np.isfinite(numbers).all():
            row = int(np.flatnonzero(~np.isfinite(numbers).all(axis=1))[0])
            raise ConfigError(f"actions[{row}] = {numbers[row].tolist()}: {allowed}")
        return numbers

    def bounds(self) -> Bounds:
        """Return the bounds of an observation, wide enough for every state that a game can reach.

        Positions: the arena's diameter, and the way of both players, with the sensor's noise, until the time limit.
        """
        kind = self.arena.template.kind
        game = self.arena.template.game
        sensor = kind.sensor
        run_m_s = float(game.evader_speed_m_s)
        seen_m_s = run_m_s
        noise_m = 0.0
        if self.name == PURSUER:
            seen_m_s += FARTHEST_SIGMAS * sensor.velocity_noise_m_s
            noise_m = FARTHEST_SIGMAS * sensor.position_noise_m
        level_m_s = float(game.pursuer.horizontal_m_s + pair_length(game.wind_m_s))
        vertical_m_s = float(max(game.pursuer.climb_m_s, game.pursuer.descent_m_s))
        limit_s = kind.time_limit_s
        away_m = 2.0 * self.arena.radius_m + (level_m_s + seen_m_s) * limit_s + noise_m
        rise_m = self.arena.heights_m[1] + float(game.standoff.height_m) + vertical_m_s * limit_s
        speeds_m_s = [level_m_s, level_m_s, vertical_m_s]
        if self.name == PURSUER:
            high = [away_m, away_m, rise_m, seen_m_s, seen_m_s, *speeds_m_s]
        else:
            high = [away_m, away_m, rise_m, *speeds_m_s, run_m_s, run_m_s]
        if kind.target is not None:
            high += [away_m, away_m]
        upper = (1.0 + ROUNDING) * np.array(high)
        return Bounds(-upper, upper)


def with_flown_speeds(scenario: Scenario) -> Scenario:
    """Return a scenario with the speed set of its flight where it names none, so policies play with flown speeds."""
    return scenario.model_copy(update={"pursuer": scenario.as_flown().pursuer})


def side_of(
    scenario: str | Path | Scenario, name: str, opponent: str | None, *, between_points: bool
) -> Side:
    """Return one side of a scenario against an opponent, whose policy is the scenario's if none is named.

    Raises:
        ConfigError: If the side, the scenario or the opponent's policy is unknown, or the scenario is one of teams.
    """
    if name not in SIDES:
        raise ConfigError(f"side = {name!r}: must be one of {', '.join(SIDES)}")
    opposing_side = EVADER if name == PURSUER else PURSUER
    # The steered side's own policy is not played
    policies = {name: "hold"}
    if opponent is not None:
        policies[opposing_side] = opponent
    loaded = scenario if isinstance(scenario, Scenario) else load_scenario(str(scenario))[1]
    if not between_points:
        loaded = with_flown_speeds(loaded)
    steered_scenario = with_policies(loaded, **policies)
    return Side(name, arena_of(steered_scenario, between_points=between_points))


def warn_of_long_steps(side: Side, step_s: float) -> None:
    """Warn if optimal actions that are held for a step lose more than 1 % of the value.

    The loss is measured: of 256 random games against the optimal opponent, the largest over the median value.
    """
    if step_s <= CHOICE_S:
        return
    best = with_policies(side.arena.template.kind, pursuer=OPTIMAL, evader=OPTIMAL)
    games = Games(
        arena_of(best, between_points=side.arena.between_points),
        seeds_of(0, TRIED_GAMES),
        step_s,
    )
    value = float(np.median(np.abs(games.value)))
    while (games.moment.end == End.RUNNING).any():
        if side.name == PURSUER:
            games.step(games.solution.pursuer_velocity_m_s, None)
        else:
            games.step(None, games.solution.evader_velocity_m_s)
    lost = float(np.max(side.sign * (games.opening_score - games.score)))
    if lost > MOST_LOST * value:
        unit = "s" if side.arena.template.kind.target is None else "m"
        warnings.warn(
            f"step_s = {step_s:g}: the {side.name}'s optimal actions, held so long, lose up to {lost:.2g} {unit} of a "
            f"median value of {value:.3g} {unit}; {CHOICE_S:g} s and less lose nothing",
            stacklevel=3,
        )


def require_steps(step_s: float, count: int) -> None:
    """Check the length of a step and the number of games.

    Raises:
        ConfigError: If one is out of range.
    """
    if not 1e-3 <= step_s <= 10.0:
        raise ConfigError(f"step_s = {step_s!r}: must be from 0.001 to 10 s")
    if not isinstance(count, int) or count < 1:
        raise ConfigError(f"num_envs = {count!r}: must be a whole number, 1 or more")
