"""Gymnasium's environments: one side of a scenario's game against a named opponent."""

from pathlib import Path
from typing import Any, Final

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from guidance.errors import ConfigError
from guidance.extras import require_extras
from guidance.frames import Enu
from guidance.game import End
from guidance.game.arrays import FloatArray
from guidance.league.play import WINNER_OF_END, Games
from guidance.league.sides import STEP_S, Side, require_steps, side_of, warn_of_long_steps
from guidance.league.states import SeedArray, seeds_of
from guidance.sim.scenario import PURSUER, Scenario

FRAME_INCHES: Final = (8.0, 6.0)
FRAME_DPI: Final = 80
"""Of a rendered picture of 640 by 480 points."""

_Flags = NDArray[np.bool_]
Info = dict[str, Any]


def spaces_of(side: Side) -> tuple[Box, Box]:
    """Return the spaces of observations and actions of one game."""
    low, high = side.bounds()
    observation = Box(low, high, dtype=np.float64)
    return observation, Box(-1.0, 1.0, (side.shares,), np.float32)


class PursuitVectorEnv(VectorEnv[FloatArray, FloatArray, Any]):
    """Many games of one scenario, each an environment, stepped as one NumPy batch.

    Observations (n, 8), float64, in m and m/s of the game frame; of the pursuer, with its bounds:

    | columns | quantity | bound |
    |---|---|---|
    | 0, 1 | place of the evader relative to the pursuer, as known to it | distance that both can fly until the limit |
    | 2 | height of the stand-off disc relative to the pursuer | height that the pursuer can climb until the limit |
    | 3, 4 | velocity of the evader, as known to the pursuer | the evader's speed, and the sensor's noise |
    | 5, 6, 7 | velocity over the ground that the pursuer asked for last | its speed set, with the wind |
    | 8, 9 | in TAD: position of the target relative to the pursuer | as columns 0 and 1 |

    The evader sees (0, 1, 2) the pursuer's place relative to the disc's centre, (3, 4, 5) the velocity that the pursuer
    asked for last and (6, 7) its own. With a section `[sensor]` in the scenario, the pursuer's knowledge is late and
    noisy as in `guidance scenario run`.

    Actions (n, 3) of the pursuer, (n, 2) of the evader, from −1 to 1: shares of the speeds through the air, brought
    into the speed set (`guidance.strategies.own`).

    The reward is the change of the exact value, in s (PE) or m (TAD): an episode's sum is minus the regret, and 0 is
    optimal play. `info` has arrays (n,): `value`, of the state: s to the capture in PE, m in TAD, negative where the
    evader wins; `regret`, the loss so far; `winner`, a `guidance.game.Winner`, 0 while the game runs; and `reason`,
    the `guidance.game.End` of the game. Capture, arrival and a failed game terminate; the time limit truncates.

    The pursuer has the speed set of the scenario's flight: a multicopter's where the scenario names none. The opponent
    chooses anew every 0.5 s, however long a step is.

    A finished environment begins anew with its next step, whose action is ignored (`AutoresetMode.NEXT_STEP`).

    Args:
        scenario: A scenario, its path, or the name of a bundled one.
        num_envs: Number of environments.
        side: The agent: "pursuer" or "evader".
        opponent: Policy of the other side; None is the scenario's.
        step_s: How long an action is held, s. A warning says if optimal actions held so long lose 1 % of the value.
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
        warn_of_long_steps(self._side, step_s)
        self._number = np.zeros(num_envs, dtype=np.int64)
        self._stride = np.ones(num_envs, dtype=np.int64)
        self.games: Games | None = None

    def reset(
        self,
        *,
        seed: int | list[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[FloatArray, Info]:
        """Begin a game in every environment, in random states of a seed; without one, in further states.

        Args:
            seed: One, whose states the environments share out; or a list with one for each environment, whose states
                then do not depend on the other environments.
            options: `reset_mask`, (n,) of bool: the environments to begin anew; the others keep their games.

        Raises:
            ConfigError: If the seeds or the mask have a wrong length or type.
        """
        count = self.num_envs
        rows = np.arange(count)
        mask = None if options is None else options.get("reset_mask")
        if mask is not None:
            if not isinstance(mask, np.ndarray) or mask.dtype != bool or mask.shape != (count,):
                raise ConfigError(
                    f"options['reset_mask'] = {mask!r}: must be an array of {count} truth values"
                )
            if self.games is None and not mask.all():
                raise gymnasium.error.ResetNeeded("reset_mask: reset all environments first")
            rows = np.flatnonzero(mask)
        if isinstance(seed, list):
            if len(seed) != count:
                raise ConfigError(f"seed: {len(seed)} in the list, must be {count}, one each")
            super().reset()
            for row in rows:
                own = seed[row]
                drawn = int(self.np_random.integers(1 << 38)) if own is None else own
                self._number[row] = seeds_of(drawn, 1)[0]
            self._stride[rows] = 1
        elif seed is not None or self.games is None:
            super().reset(seed=seed)
            drawn = int(self.np_random.integers(1 << 38)) if seed is None else seed
            self._number[rows] = seeds_of(drawn, count)[rows]
            self._stride[rows] = count
        seeds = self._next_seeds(rows)
        if self.games is None:
            self.games = Games(self._side.arena, seeds, self._step_s)
        else:
            self.games.restart(rows, seeds)
        return self._side.observe(self.games), self._info(self.games)

    def step(self, actions: FloatArray) -> tuple[FloatArray, FloatArray, _Flags, _Flags, Info]:
        """Hold an action of each environment for a step.

        Raises:
            ConfigError: If the actions are not finite real numbers (n, k), or before the first reset.
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
            games.restart(finished, self._next_seeds(finished))
        end = games.moment.end
        truncated = end == End.TIME_UP
        terminated = (end != End.RUNNING) & ~truncated
        return self._side.observe(games), reward, terminated, truncated, self._info(games)

    def _next_seeds(self, rows: NDArray[np.intp]) -> SeedArray:
        seeds = self._number[rows]
        self._number[rows] += self._stride[rows]
        return seeds

    def _info(self, games: Games) -> Info:
        end = games.moment.end
        return {
            "value": games.value,
            "regret": self._side.sign * (games.opening_score - games.score),
            "winner": WINNER_OF_END[end],
            "reason": end.copy(),
        }


class PursuitEnv(gymnasium.Env[FloatArray, FloatArray]):
    """One game of a `PursuitVectorEnv` as a plain environment; arguments, spaces and `info` are its, without n.

    Args:
        scenario: As of `PursuitVectorEnv`; so are the others.
        side: The agent.
        opponent: Policy of the other side.
        step_s: How long an action is held, s.
        between_points: Play the paper's game.
        render_mode: "rgb_array": `render` draws the game, which needs the extra `plot`.

    Raises:
        ConfigError: As `PursuitVectorEnv`; another render_mode; or the extra is not installed.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - Gymnasium's
        "render_modes": ["rgb_array"],
        "render_fps": round(1.0 / STEP_S),
    }

    def __init__(
        self,
        scenario: str | Path | Scenario,
        *,
        side: str = PURSUER,
        opponent: str | None = None,
        step_s: float = STEP_S,
        between_points: bool = False,
        render_mode: str | None = None,
    ) -> None:
        if render_mode not in {None, "rgb_array"}:
            raise ConfigError(f"render_mode = {render_mode!r}: must be rgb_array, or left out")
        if render_mode is not None:
            require_extras(f"render_mode = {render_mode!r}", "plot")
        self.render_mode = render_mode
        self._batch = PursuitVectorEnv(
            scenario,
            side=side,
            opponent=opponent,
            step_s=step_s,
            between_points=between_points,
        )
        self.metadata = {**self.metadata, "render_fps": max(1, round(1.0 / step_s))}
        self.observation_space = self._batch.single_observation_space
        self.action_space = self._batch.single_action_space
        self._over = True
        self._tracks_m: list[tuple[FloatArray, FloatArray]] = []

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, Info]:
        """Begin a game in a random state."""
        super().reset(seed=seed)
        observation, info = self._batch.reset(seed=seed, options=options)
        self._over = False
        self._tracks_m = []
        self._keep_places()
        return observation[0], _first_row(info)

    def step(self, action: FloatArray) -> tuple[FloatArray, float, bool, bool, Info]:
        """Hold an action for a step; a finished game begins anew only with `reset`.

        Raises:
            ConfigError: If the action is not finite real numbers (k,).
            gymnasium.error.ResetNeeded: If the game is over, or none has begun.
        """
        if self._over:
            raise gymnasium.error.ResetNeeded("PursuitEnv.step: no game is running; call reset")
        observation, reward, terminated, truncated, info = self._batch.step(
            np.asarray(action)[None]
        )
        self._over = bool(terminated[0] or truncated[0])
        self._keep_places()
        return (
            observation[0],
            float(reward[0]),
            bool(terminated[0]),
            bool(truncated[0]),
            _first_row(info),
        )

    def render(self) -> Any:  # noqa: ANN401 - Gymnasium's
        """Return a picture of the game so far from above, (480, 640, 3); None without a render_mode.

        Raises:
            gymnasium.error.ResetNeeded: If no game has begun.
        """
        if self.render_mode is None:
            return None
        games = self._batch.games
        if games is None:
            raise gymnasium.error.ResetNeeded("PursuitEnv.render: no game has begun; call reset")
        from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415 - optional

        from guidance.viz.figures import (  # noqa: PLC0415 - matplotlib is optional
            disc_of,
            draw,
            figure_of,
            label_plan,
            legend_below,
            player_tracks,
            target_of,
        )

        pursuer_m, evader_m = map(np.stack, zip(*self._tracks_m, strict=True))
        target_m = None if games.batch.target_m is None else Enu(games.batch.target_m[0].tolist())
        shapes = [
            *player_tracks(pursuer_m, evader_m),
            disc_of(evader_m[-1], games.batch.game.standoff),
            *target_of(target_m, games.batch.game.target_extent),
        ]
        figure = figure_of(*FRAME_INCHES)
        plan = figure.subplots()
        draw(plan, shapes, 2)
        height_m = pursuer_m[-1, 2] - games.batch.game.standoff.height_m
        words = f"{float(games.moment.now_s[0]):.1f} s, pursuer {height_m:.1f} m above the disc"
        label_plan(plan, words, adjustable="datalim")
        legend_below(figure, plan, columns=3)
        figure.set_dpi(FRAME_DPI)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        return np.array(canvas.buffer_rgba())[..., :3]

    def _keep_places(self) -> None:
        games = self._batch.games
        if self.render_mode is not None and games is not None:
            moment = games.moment
            self._tracks_m.append((moment.pursuer_m[0].copy(), moment.evader_m[0].copy()))


def _first_row(info: Info) -> Info:
    return {name: values[0].item() for name, values in info.items()}
