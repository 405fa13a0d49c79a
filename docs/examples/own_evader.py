"""Your own evader: as a function in a rollout, and as a track in a scenario.

python docs/examples/own_evader.py
"""

import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from guidance.game import Ball, Game, StandOff, rollout, solve
from guidance.sim.maths import play_scenarios
from guidance.sim.scenario_file import load_scenario

Array = NDArray[np.float64]
GAME = Game(Ball(6.0), evader_speed_m_s=3.0, standoff=StandOff(3.0, 5.0))
P, E = np.array([0.0, 0.0, 20.0]), np.array([10.0, 30.0, 0.0])


def aside(
    game: Game,
    pursuer: Array,
    evader: Array,
    target: Array | None = None,
    evader_velocity_m_s: Array | None = None,
) -> Array:
    """Run across the pursuer's line of sight at full speed. A policy is a function of arrays (..., 3)."""
    del target, evader_velocity_m_s
    sight = (evader - pursuer) * np.array([1.0, 1.0, 0.0])
    across = np.stack([-sight[..., 1], sight[..., 0], 0.0 * sight[..., 0]], axis=-1)
    return np.asarray(
        game.evader_speed_m_s * across / np.linalg.norm(across, axis=-1, keepdims=True)
    )


SCENARIO = """
title = "My own zigzag"
game = "pe"
pursuer = { position_m = [0, 0, 20], speed_m_s = 6 }
evader = { position_m = [10, 30], speed_m_s = 3, policy = "recorded", track = "zigzag.csv" }
expect = { end = "captured" }
"""


def zigzag() -> str:
    """Return a track: time and position, from any origin. It is moved to the evader's start."""
    rows = [
        (float(t), 1.5 * t, 2.0 * ((t // 4) % 2) * (t % 4) + 2.0 * (1 - (t // 4) % 2) * (4 - t % 4))
        for t in range(60)
    ]
    return "t_s,x_m,y_m\n" + "".join(f"{t},{x},{y}\n" for t, x, y in rows)


def main() -> None:
    """Play against both evaders."""
    value = float(solve(GAME, P, E).value)
    played = rollout(GAME, P, E, evader_policy=aside)
    print(
        f"value of the game {value:.2f} s; an evader that runs aside is captured after {float(played.time_s):.2f} s"
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "zigzag.toml"
        path.write_text(SCENARIO, encoding="utf-8")
        (path.parent / "zigzag.csv").write_text(zigzag(), encoding="utf-8")
        (outcome,) = play_scenarios([load_scenario(str(path))[1]])
    print(
        f"the zigzag: {outcome.end} after {outcome.capture_time_s:.2f} s, regret {outcome.regret:.2f} s"
    )


if __name__ == "__main__":
    main()
