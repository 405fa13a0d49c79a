"""Gymnasium's environments: one side of a scenario's game against a named opponent."""

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from guidance.game import End
from guidance.league.play import WINNERS, Games
from guidance.league.sides import STEP_S, Side, require_steps, side_of
from guidance.league.states import SeedArray, seeds_of
from guidance.sim.batch import Array
from guidance.sim.scenario import PURSUER, Scenario

Flags = NDArray[np.bool_]
Info = dict[str, Any]


def spaces_of(side: Side) -> tuple[Box, Box]:
    """Return the spaces of observations and actions of one game."""
    low, high = side.bounds()
    observation = Box(low, high, dtype=np.float64)
    return observation, Box(-1.0, 1.0, (side.shares,), np.float64)


class PursuitVectorEnv(VectorEnv[Array, Array, Any]):
    """Many games of one scenario, each an environment, stepped as one NumPy batch.

    Observations (n, 8), float64, in m and m/s of the game frame; of the pursuer, with its bounds:

    | columns | quantity | bound |
    |---|---|---|
    | 0, 1 | place of the evader relative to the pursuer, as known to it | what both can fly until the limit |
    | 2 | height of the stand-off disc relative to the pursuer | what the pursuer can climb until the limit |
    | 3, 4 | velocity of the evader, as known to the pursuer | the evader's speed, and the sensor's noise |
    | 5, 6, 7 | velocity of the pursuer over the ground | its speed set, with the wind |
    | 8, 9 | in TAD: position of the target relative to the pursuer | as columns 0 and 1 |

    The evader sees (0, 1, 2) the pursuer's place relative to the disc's centre, (3, 4, 5) the pursuer's velocity and
    (6, 7) its own. With a section `[sensor]` in the scenario, the pursuer's knowledge is late and noisy as in
    `guidance scenario run`.

    Actions (n, 3) of the pursuer, (n, 2) of the evader, from −1 to 1: shares of the speeds through the air, brought
    into the speed set (`guidance.strategies.own`).

    The reward is the change of the exact value, in s (PE) or m (TAD): an episode's sum is minus the regret, and 0 is
    optimal play. `info` has arrays (n,): `value`, of the state: s to the capture in PE, m in TAD, negative where the
    evader wins; `regret`, the loss so far; `winner`, a `guidance.game.Winner`, 0 while the game runs; and `reason`,
    the `guidance.game.End` of the game. Capture, arrival and a failed game terminate; the time limit truncates.

    A finished environment begins anew with its next step, whose action is ignored (`AutoresetMode.NEXT_STEP`).

    Args:
        scenario: A scenario, its path, or the name of a bundled one.
        num_envs: Number of environments.
        side: The agent: "pursuer" or "evader".
        opponent: Policy of the other side; None is the scenario's.
        step_s: How long an action is held, s.
        between_points: Play the paper's game without the stand-off disc; it ends within the disc's tolerance.

    Raises:
        ConfigError: If an argument is unknown or out of range.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - Gymnasium's
        "autoreset_mode": AutoresetMode.NEXT_STEP
    }

    def __init__(
        self,
        scenario: str | Path | Scenario,
        num_envs: int = 1,
        *,
        side: str = PURSUER,
        opponent: str | None = None,
        step_s: float = STEP_S,
        between_points: bool = False,
    ) -> None:
        require_steps(step_s, num_envs)
        self._side = side_of(scenario, side, opponent, between_points=between_points)
        self._step_s = step_s
        self.num_envs = num_envs
        self.single_observation_space, self.single_action_space = spaces_of(self._side)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._seed: int | None = None
        self._begun = 0
        self.games: Games | None = None

    def reset(
        self,
        *,
        seed: int | list[int | None] | None = None,
        options: dict[str, Any] | None = None,  # noqa: ARG002 - Gymnasium's
    ) -> tuple[Array, Info]:
        """Begin a game in every environment, in random states of a seed; without one, in further states."""
        if isinstance(seed, list):
            seed = seed[0]
        super().reset(seed=seed)
        if seed is not None or self._seed is None:
            self._seed = int(self.np_random.integers(1 << 38)) if seed is None else seed
            self._begun = 0
        seeds = self._next_seeds(self.num_envs)
        if self.games is None:
            self.games = Games(self._side.arena, seeds, self._step_s)
        else:
            self.games.restart(np.arange(self.num_envs), seeds)
        return self._side.observe(self.games), self._info(self.games)

    def step(self, actions: Array) -> tuple[Array, Array, Flags, Flags, Info]:
        """Hold an action of each environment for a step.

        Raises:
            ConfigError: If the actions are not finite real numbers (n, k), or nothing was reset before.
        """
        games = self.games
        if games is None:
            raise gymnasium.error.ResetNeeded("PursuitVectorEnv.step: call reset first")
        velocity_m_s = self._side.velocity(self._side.checked(actions, self.num_envs))
        finished = np.flatnonzero(games.moment.end != End.RUNNING)
        before = games.score
        if self._side.name == PURSUER:
            games.step(velocity_m_s, None)
        else:
            games.step(None, velocity_m_s)
        reward = self._side.sign * (games.score - before)
        if len(finished):
            games.restart(finished, self._next_seeds(len(finished)))
        end = games.moment.end
        truncated = end == End.TIME_UP
        terminated = (end != End.RUNNING) & ~truncated
        return self._side.observe(games), reward, terminated, truncated, self._info(games)

    def _next_seeds(self, count: int) -> SeedArray:
        seeds = seeds_of(self._seed or 0, count, self._begun)
        self._begun += count
        return seeds

    def _info(self, games: Games) -> Info:
        end = games.moment.end
        return {
            "value": games.value,
            "regret": self._side.sign * (games.opening_score - games.score),
            "winner": WINNERS[end],
            "reason": end.copy(),
        }


class PursuitEnv(gymnasium.Env[Array, Array]):
    """One game of a `PursuitVectorEnv` as a plain environment; arguments, spaces and `info` are its, without n."""

    metadata: dict[str, Any] = {  # noqa: RUF012 - Gymnasium's
        "render_modes": []
    }

    def __init__(
        self,
        scenario: str | Path | Scenario,
        *,
        side: str = PURSUER,
        opponent: str | None = None,
        step_s: float = STEP_S,
        between_points: bool = False,
    ) -> None:
        self._batch = PursuitVectorEnv(
            scenario,
            side=side,
            opponent=opponent,
            step_s=step_s,
            between_points=between_points,
        )
        self.observation_space = self._batch.single_observation_space
        self.action_space = self._batch.single_action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, Info]:
        """Begin a game in a random state."""
        super().reset(seed=seed)
        observation, info = self._batch.reset(seed=seed, options=options)
        return observation[0], _first_row(info)

    def step(self, action: Array) -> tuple[Array, float, bool, bool, Info]:
        """Hold an action for a step; a finished game begins anew only with `reset`.

        Raises:
            ConfigError: If the action is not finite real numbers (k,).
        """
        observation, reward, terminated, truncated, info = self._batch.step(
            np.asarray(action)[None]
        )
        return (
            observation[0],
            float(reward[0]),
            bool(terminated[0]),
            bool(truncated[0]),
            _first_row(info),
        )


def _first_row(info: Info) -> Info:
    return {name: values[0].item() for name, values in info.items()}
