"""PettingZoo's environment: both sides of a scenario's game as agents, or all players of two teams."""

from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from pettingzoo import ParallelEnv

from guidance.errors import ConfigError
from guidance.game import End
from guidance.game.arrays import FloatArray
from guidance.league.gymnasium_envs import spaces_of
from guidance.league.play import WINNER_OF_END, Games
from guidance.league.sides import (
    SIDES,
    STEP_S,
    Side,
    require_steps,
    warn_of_long_steps,
    with_flown_speeds,
)
from guidance.league.states import arena_of, seeds_of
from guidance.league.teams import ByAgent, TeamScenarioGame
from guidance.sim.scenario import EVADER, PURSUER, Scenario
from guidance.sim.scenario_file import load_any, with_policies
from guidance.sim.teams import TeamScenario


class PursuitParallelEnv(ParallelEnv):
    """All players of a scenario as agents that act at the same time.

    A scenario of two players has the agents "pursuer" and "evader", with the observations and actions of
    `PursuitVectorEnv`. The rewards are the change of the exact value, s (PE) or m (TAD), and of opposite sign: what one
    player loses, the other gains.

    A scenario of teams has the agents "pursuer_0", "pursuer_1", …, "evader_0", …. It is the game between points that
    `guidance scenario run` plays. Each agent observes, in m and m/s of the game frame, bounded by what both teams can
    fly until the time limit: its own height (1 column); of every player of the other team, in their order, place and
    velocity relative to its own (6 each); of its mates the same; and in TAD the target's place, relative (2). Of a
    player that is out of the game all are 0. The reward of a team is the change of its guaranteed result
    (`guidance.game.team.match_teams`): in TAD the sum of the guaranteed distances from the targets, m; in PE minus
    the time of the guaranteed captures, s. An evader leaves the game with its capture or arrival.

    `infos` has `value`, `regret`, `winner` and `reason` as `PursuitVectorEnv`, each a number.

    Args:
        scenario: A scenario, its path, or the name of a bundled one.
        step_s: How long an action is held, s.
        between_points: Of two players: play the paper's game without the stand-off disc.

    Raises:
        ConfigError: If an argument is unknown or out of range.
    """

    metadata: dict[str, Any] = {"name": "pursuit_v0", "render_modes": [], "is_parallelizable": True}  # noqa: RUF012

    def __init__(
        self,
        scenario: str | Path | Scenario | TeamScenario,
        *,
        step_s: float = STEP_S,
        between_points: bool = False,
    ) -> None:
        require_steps(step_s, 1)
        loaded = scenario
        if isinstance(loaded, (str, Path)):
            loaded = load_any(str(loaded))[1]
        self._game: TeamScenarioGame | _Duel
        if isinstance(loaded, TeamScenario):
            if between_points:
                raise ConfigError(
                    "between_points = True: teams play between points always; leave it out"
                )
            self._game = TeamScenarioGame(loaded, step_s)
        else:
            self._game = _Duel(loaded, step_s, between_points=between_points)
        self.possible_agents = list(self._game.agents)
        self.agents: list[str] = []
        self._spaces = {agent: self._game.spaces(agent) for agent in self.possible_agents}
        self._generator = np.random.default_rng()

    def observation_space(self, agent: str) -> Box:
        """Return the space of an agent's observations."""
        return self._spaces[agent][0]

    def action_space(self, agent: str) -> Box:
        """Return the space of an agent's actions."""
        return self._spaces[agent][1]

    def reset(
        self,
        seed: int | None = None,
        options: dict[str, Any] | None = None,  # noqa: ARG002
    ) -> tuple[ByAgent, ByAgent]:
        """Begin a game in a random state of a seed; without one, of the next random number."""
        if seed is not None:
            self._generator = np.random.default_rng(seed)
        self._game.begin(int(self._generator.integers(1 << 31)))
        self.agents = list(self.possible_agents)
        return self._game.observations(self.agents), self._game.infos(self.agents)

    def step(self, actions: ByAgent) -> tuple[ByAgent, ByAgent, ByAgent, ByAgent, ByAgent]:
        """Hold an action of each agent that plays; after the end all results are empty.

        Raises:
            ConfigError: If an agent has no action, or one that is no finite real numbers of its space's shape.
        """
        playing = self.agents
        if not playing:  # as PettingZoo's own environments after the end
            return {}, {}, {}, {}, {}
        velocities = {}
        for agent in playing:
            if agent not in actions:
                raise ConfigError(
                    f"actions: none for {agent}; each of {', '.join(self.agents)} needs its action"
                )
            velocities[agent] = self._game.velocity(agent, actions[agent])
        rewards = self._game.step(velocities)
        ends = {agent: self._game.ended(agent) for agent in playing}
        terminated = {agent: end not in {End.RUNNING, End.TIME_UP} for agent, end in ends.items()}
        truncated = {agent: end == End.TIME_UP for agent, end in ends.items()}
        observations = self._game.observations(playing)
        infos = self._game.infos(playing)
        self.agents = [agent for agent in playing if ends[agent] == End.RUNNING]
        return (
            observations,
            {agent: rewards[agent] for agent in playing},
            terminated,
            truncated,
            infos,
        )


class _Duel:
    """A game of two players, steered by both."""

    def __init__(self, scenario: Scenario, step_s: float, *, between_points: bool) -> None:
        played = scenario if between_points else with_flown_speeds(scenario)
        standing = with_policies(played, pursuer="hold", evader="hold")
        arena = arena_of(standing, between_points=between_points)
        self._sides = {name: Side(name, arena) for name in SIDES}
        for side in self._sides.values():
            warn_of_long_steps(side, step_s)
        self._games = Games(arena, seeds_of(0, 1), step_s)
        self.agents = SIDES

    def spaces(self, agent: str) -> tuple[Box, Box]:
        """Return the spaces of an agent."""
        return spaces_of(self._sides[agent])

    def begin(self, seed: int) -> None:
        """Begin a game."""
        self._games.restart(np.arange(1), seeds_of(seed, 1))

    def velocity(self, agent: str, action: Any) -> FloatArray:  # noqa: ANN401 - as given
        """Return the velocity of an action, (1, 3)."""
        side = self._sides[agent]
        try:
            return side.velocity(side.checked(np.asarray(action)[None], 1))
        except ConfigError as error:
            raise ConfigError(f"{agent}: {error}") from None

    def step(self, velocities: ByAgent) -> ByAgent:
        """Fly a step; return the rewards."""
        before = self._games.score
        self._games.step(velocities[PURSUER], velocities[EVADER])
        change = float(self._games.score[0] - before[0])
        return {name: side.sign * change for name, side in self._sides.items()}

    def ended(self, agent: str) -> int:  # noqa: ARG002 - as of teams
        """Return the `End` of an agent's game."""
        return int(self._games.moment.end[0])

    def observations(self, agents: list[str]) -> ByAgent:
        """Return each agent's observation."""
        return {agent: self._sides[agent].observe(self._games)[0] for agent in agents}

    def infos(self, agents: list[str]) -> ByAgent:
        """Return value, regret, winner and reason."""
        games = self._games
        end = int(games.moment.end[0])
        lost = float(games.opening_score[0] - games.score[0])
        shared = {"value": float(games.value[0]), "winner": int(WINNER_OF_END[end]), "reason": end}
        return {agent: {**shared, "regret": self._sides[agent].sign * lost} for agent in agents}
