"""A game of teams whose players are all steered, as `guidance.game.team.rollout_teams` plays it, one game at a time."""

import math
from dataclasses import replace
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Box

from guidance.errors import ConfigError
from guidance.game import End, Winner
from guidance.game.arrays import NUMPY, FloatArray, Real, components
from guidance.game.pe import to_target
from guidance.game.team import Matching, match_teams
from guidance.game.team.arguments import joined
from guidance.game.team.rollout import (
    NextEvents,
    Outcomes,
    foresee,
    held_m,
    judged_ends,
    moved,
    step_of,
)
from guidance.league.play import LEAST_S
from guidance.league.sides import ROUNDING
from guidance.sim.scenario import EVADER, PURSUER
from guidance.sim.team_policies import observed_by
from guidance.sim.teams import TeamScenario, game_of, teams_of
from guidance.strategies import bounded
from guidance.strategies.own import EVADER_SHARES, PURSUER_SHARES, shares_of

ByAgent = dict[str, Any]
"""A value for each agent, by its name."""

PLAYER_COLUMNS: Final = 6
"""Place and velocity of another player, relative."""


class TeamScenarioGame:
    """One game of a scenario of teams.

    Args:
        scenario: Players, speeds, target.
        step_s: How long velocities are held.

    Attributes:
        agents: Names of all players, pursuers first.
    """

    def __init__(self, scenario: TeamScenario, step_s: float) -> None:
        self._scenario = scenario
        self._held_s = step_s
        teams = teams_of(scenario)
        self._teams = teams
        self._speeds_m_s = np.concatenate([teams.pursuer_speed_m_s, teams.evader_speed_m_s])
        self._n = len(teams.pursuers_m)
        self._m = len(teams.evaders_m)
        pursuers = [f"{PURSUER}_{number}" for number in range(self._n)]
        evaders = [f"{EVADER}_{number}" for number in range(self._m)]
        self.agents = (*pursuers, *evaders)
        pursuer_speed_m_s = teams.pursuer_speed_m_s[:, None]
        self._game = game_of(scenario, pursuer_speed_m_s, teams.evader_speed_m_s)
        shape = (self._n, self._m)
        pairs = joined(self._game, "(n, m)").rows(lambda value: np.broadcast_to(value, shape))
        self._plays = pairs.plays
        reach_m = pairs.game.capture_radius_m + scenario.capture_m
        self._ends_game = replace(pairs.game, capture_radius_m=reach_m)
        self._spare_m = held_m(pairs.game, step_s)
        self.begin(scenario.seed)

    def begin(self, seed: int) -> None:
        """Place the players as a seed scatters them."""
        teams = teams_of(self._scenario.model_copy(update={"seed": seed}))
        self._P = teams.pursuers_m
        self._E = teams.evaders_m
        self._T = None
        if teams.target_m is not None:
            self._T = np.repeat(teams.target_m[None], self._m, axis=0)
        self._velocity_m_s = np.zeros((self._n + self._m, 3))
        self._now_s = np.zeros(())
        still_running = np.full(self._m, int(End.RUNNING))
        times_s = np.zeros(self._m)
        nobody = np.full(self._m, -1)
        self._outcomes = Outcomes(still_running, times_s, nobody)
        self._matching = self._matched(None)
        self._guaranteed = int(self._matching.guaranteed)
        self._score = self._opening_score = self._scored()

    def spaces(self, agent: str) -> tuple[Box, Box]:
        """Return the spaces of observations and actions of an agent."""
        shares = PURSUER_SHARES if self._number(agent) < self._n else EVADER_SHARES
        places_m = np.concatenate([self._teams.pursuers_m, self._teams.evaders_m])
        if self._teams.target_m is not None:
            places_m = np.concatenate([places_m, self._teams.target_m[None]])
        groups = (*self._scenario.pursuer, *self._scenario.evader)
        scattered_m = 2.0 * max(group.scatter_m for group in groups)
        closing_m_s = 2.0 * float(self._speeds_m_s.max())
        extent_m = float(np.ptp(places_m, axis=0).max())
        highest_m = float(places_m[:, 2].max())
        spread_m = extent_m + scattered_m + highest_m
        away_m = spread_m + closing_m_s * self._scenario.time_limit_s
        player = [away_m] * 3 + [closing_m_s] * 3
        other_players = player * (len(self.agents) - 1)
        high = [away_m, *other_players]
        if self._T is not None:
            high += [away_m, away_m]
        upper = (1.0 + ROUNDING) * np.array(high)
        observation = Box(-upper, upper, dtype=np.float64)
        return observation, Box(-1.0, 1.0, (shares,), np.float32)

    def velocity(self, agent: str, action: Any) -> FloatArray:  # noqa: ANN401 - as given
        """Return the velocity of an action, (3,).

        Raises:
            ConfigError: If it is no finite real numbers of the right shape.
        """
        number = self._number(agent)
        shares = PURSUER_SHARES if number < self._n else EVADER_SHARES
        numbers = np.asarray(action)
        allowed = (
            f"must be real, finite numbers of shape ({shares},), shares of its speed from -1 to 1"
        )
        if numbers.dtype.kind not in "fiu" or numbers.shape != (shares,):
            kind = f"shape {numbers.shape}, dtype {numbers.dtype}"
            raise ConfigError(f"actions[{agent!r}]: {kind}: {allowed}")
        if not np.isfinite(numbers).all():
            raise ConfigError(f"actions[{agent!r}] = {numbers.tolist()}: {allowed}")
        velocity = np.zeros(3)
        velocity[:shares] = shares_of(numbers)
        speed_m_s = float(self._speeds_m_s[number])
        return speed_m_s * bounded(velocity, 1.0)

    def step(self, velocities: ByAgent) -> ByAgent:
        """Hold the velocities of the agents for a step, or to the end; return all rewards."""
        for agent, velocity_m_s in velocities.items():
            self._velocity_m_s[self._number(agent)] = velocity_m_s
        left_s = self._held_s
        with np.errstate(all="ignore"):
            while left_s > LEAST_S and (self._outcomes.end == End.RUNNING).any():
                # To the next end, at most so long.
                limit_s = self._scenario.time_limit_s
                running = self._outcomes.end == End.RUNNING
                most_s = np.minimum(left_s, limit_s - self._now_s)
                h = step_of(self._straight(), running, self._matching.evader_of, most_s)
                v = self._velocity_m_s[: self._n]
                w = self._velocity_m_s[self._n :]
                P, self._E = moved(self._P, self._E, v, w, h, running)
                lowest_m = [-math.inf, -math.inf, 0.0]
                self._P = np.maximum(P, lowest_m)
                self._now_s = self._now_s + h
                foreseen = foresee(self._ends_game, self._plays, self._P, self._E, self._T)
                self._outcomes = judged_ends(self._outcomes, foreseen, self._now_s, limit_s)
                left_s -= float(h)
        finished = self._outcomes.end != End.RUNNING
        self._velocity_m_s[self._n :][finished] = 0.0
        self._matching = self._matched(self._matching)
        before = self._score
        self._score = self._scored()
        gain = self._score - before
        return {agent: self._sign(agent) * gain for agent in self.agents}

    def _straight(self) -> NextEvents:
        """Return lower bounds of the times until straight tracks end in captures and arrivals, s.

        A distance is a convex function of time: its tangent is below it.
        """
        v = self._velocity_m_s[: self._n, None]
        w = self._velocity_m_s[None, self._n :]
        way_m = self._E[None] - self._P[:, None]
        capture_s = _reached_s(way_m, v - w, self._ends_game.capture_radius_m)
        arrival_s = np.full(self._m, math.inf)
        if self._T is not None:
            x, y, z = to_target(NUMPY, self._ends_game, components(self._E), components(self._T))
            way_to_target_m = np.stack([x, y, z], axis=-1)
            arrival_s = _reached_s(way_to_target_m, w[0], 0.0)
        no_turn_s = np.full((self._n, self._m), math.inf)
        return NextEvents(capture_s, arrival_s, no_turn_s)

    def ended(self, agent: str) -> int:
        """Return the `End` of an agent: an evader's own, a pursuer's when no evader runs any more."""
        end = self._outcomes.end
        number = self._number(agent)
        if number >= self._n:
            return int(end[number - self._n])
        if (end == End.RUNNING).any():
            return int(End.RUNNING)
        return int(max(end, key=lambda code: code != End.CAPTURED))

    def observations(self, agents: list[str]) -> ByAgent:
        """Return each agent's observation."""
        places_m = np.concatenate([self._P, self._E])
        pursuers_present = np.ones(self._n, dtype=bool)
        evaders_present = self._outcomes.end == End.RUNNING
        present = np.concatenate([pursuers_present, evaders_present])
        observed = {}
        for agent in agents:
            number = self._number(agent)
            target_m = None if self._T is None else self._T[0]
            observed[agent] = observed_by(
                number, self._n, places_m, self._velocity_m_s, present, target_m
            )
        return observed

    def infos(self, agents: list[str]) -> ByAgent:
        """Return value, regret, winner and reason."""
        rows: ByAgent = {}
        for agent in agents:
            end = self.ended(agent)
            winner = Winner.UNDECIDED
            if self._number(agent) >= self._n:
                winners = {int(End.CAPTURED): Winner.PURSUER, int(End.ARRIVED): Winner.EVADER}
                winner = winners.get(end, winner)
            elif end != End.RUNNING:
                captured = np.count_nonzero(self._outcomes.end == End.CAPTURED)
                winner = Winner.PURSUER if captured >= self._guaranteed else Winner.EVADER
            loss = self._opening_score - self._score
            rows[agent] = {
                "value": self._score,
                "regret": self._sign(agent) * loss,
                "winner": int(winner),
                "reason": end,
            }
        return rows

    def _matched(self, previous: Matching | None) -> Matching:
        in_play = self._outcomes.end == End.RUNNING
        spare_m = 0.0 if self._T is None else self._spare_m
        return match_teams(
            self._game,
            self._P,
            self._E,
            self._T,
            in_play=in_play,
            previous=previous,
            spare_m=spare_m,
        )

    def _scored(self) -> float:
        """Return the pursuers' result so far, plus the guarantee for the rest."""
        end, time_s, _ = self._outcomes
        running = end == End.RUNNING
        value = self._matching.value
        if self._T is None:
            limit_s = self._scenario.time_limit_s
            captured_s = np.where(end == End.CAPTURED, time_s, limit_s)
            promised_s = np.minimum(self._now_s + value, limit_s)
            times_s = np.where(running, promised_s, captured_s)
            return -float(np.sum(times_s))
        x, y, _ = to_target(NUMPY, self._ends_game, components(self._E), components(self._T))
        away_m = NUMPY.norm2((x, y))
        captured_m = np.where(end == End.CAPTURED, away_m, 0.0)
        distances_m = np.where(running, value, captured_m)
        return float(np.sum(distances_m))

    def _sign(self, agent: str) -> float:
        return 1.0 if self._number(agent) < self._n else -1.0

    def _number(self, agent: str) -> int:
        if agent not in self.agents:
            raise ConfigError(f"agent = {agent!r}: must be one of {', '.join(self.agents)}")
        return self.agents.index(agent)


def _reached_s(way_m: FloatArray, closing_m_s: FloatArray, reach_m: Real) -> FloatArray:
    """Return the times until tangents of distances (..., 3) reach `reach_m`, s; infinite where they grow."""
    away_m = np.sqrt(np.sum(way_m**2, axis=-1))
    product = np.sum(way_m * closing_m_s, axis=-1)
    divisor_m = np.where(away_m > 0.0, away_m, 1.0)
    rate_m_s = product / divisor_m
    beyond_m = away_m - reach_m
    later_s = np.where(rate_m_s > 0.0, beyond_m / rate_m_s, math.inf)
    return np.where(beyond_m <= 0.0, 0.0, later_s)
