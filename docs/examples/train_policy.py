"""Train a small policy from nothing by evolution strategies, draw how it learns, and fly it.

python docs/examples/train_policy.py
guidance league run docs/examples/train_policy.py:choose --scenario trained/chase.toml --games 1000
guidance fly trained/chase.toml --pursuer docs/examples/train_policy.py:choose --fast

The policy is a network of one hidden layer. Its reward is the change of the game's exact value, so that a single step
tells how good an action is: 0 is the best that there is. Each of 64 slightly different networks plays 64 games for one
step; the weights move towards those that lost less (Salimans et al., arXiv 1703.03864). It takes a minute or two.

The game is the paper's PE game with the speed set of a multicopter, which the mock and real autopilots fly.
"""

import argparse
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from guidance.league import PursuitVectorEnv

Array = NDArray[np.float64]

FOLDER = Path("trained")
WEIGHTS = "weights.npy"
SCENARIO = "chase.toml"
INPUTS = 8
HIDDEN = 16
ACTIONS = 3
SIZE = (INPUTS + 1) * HIDDEN + (HIDDEN + 1) * ACTIONS
NETWORKS = 64
GAMES = 64
SPREAD = 0.3
RATE = 0.1
CHASE = """
title = "A chase to train a policy in"
game = "pe"
pursuer = { position_m = [40, 7, 35], speed_m_s = 3, speed_set = "cylinder", climb_m_s = 2, descent_m_s = 2 }
evader = { position_m = [40, 48], speed_m_s = 1.5 }
time_limit_s = 60
"""


def act(weights: Array, observation: Array) -> Array:
    """Return the actions (..., n, 3) of networks with weights (..., SIZE) for observations (..., n, 8)."""
    level_m = observation[..., 0:2]
    far_m = np.sqrt(np.sum(level_m**2, axis=-1, keepdims=True))
    height_m = observation[..., 2:3]
    inputs = [
        *(
            level_m / (far_m + 1.0),
            np.tanh(far_m / 20.0),
            np.tanh(height_m),
            np.tanh(height_m / 20.0),
        ),
        *(observation[..., 3:5] / 1.5, np.ones_like(far_m)),
    ]
    first, second = np.split(weights, [(INPUTS + 1) * HIDDEN], axis=-1)
    lead = weights.shape[:-1]
    first = first.reshape(*lead, INPUTS + 1, HIDDEN)
    second = second.reshape(*lead, HIDDEN + 1, ACTIONS)
    seen = np.concatenate([*inputs, np.ones_like(far_m)], axis=-1)
    hidden = np.tanh(seen @ first)
    return np.tanh(np.concatenate([hidden, np.ones_like(far_m)], axis=-1) @ second)


@cache
def trained_weights() -> Array:
    """Read the weights once."""
    return np.asarray(np.load(FOLDER / WEIGHTS))


def choose(observation: Array) -> Array:
    """Return the actions of the trained policy, as `guidance league run` and `guidance fly` ask for them."""
    return act(trained_weights(), observation)


def regret_share(weights: Array, scenario: Path, games: int) -> float:
    """Play games to their ends; return the median of the regret over the game's value."""
    environment = PursuitVectorEnv(scenario, games)
    observation, info = environment.reset(seed=1)
    value = info["value"]
    share = np.full(games, np.nan)
    while np.isnan(share).any():
        observation, _, terminated, truncated, info = environment.step(act(weights, observation))
        over = (terminated | truncated) & np.isnan(share)
        share[over] = info["regret"][over] / value[over]
    return float(np.median(share))


def train(
    scenario: Path, iterations: int, judged: int, seed: int = 0
) -> tuple[Array, list[tuple[int, float]]]:
    """Return the weights, and the learning curve: iterations and median regret over the value of `judged` games."""
    random = np.random.default_rng(seed)
    weights = 0.1 * random.standard_normal(SIZE)
    mean = np.zeros(SIZE)
    square = np.zeros(SIZE)
    environment = PursuitVectorEnv(scenario, NETWORKS * GAMES, step_s=0.5)
    curve = []
    observation = np.zeros((0, INPUTS))
    for number in range(iterations):
        left = 1.0 - number / iterations
        spread = SPREAD * (0.15 + 0.85 * left)
        if number % 40 == 0:  # games of an untrained policy go nowhere
            observation, _ = environment.reset(seed=seed + number)
            curve.append((number, regret_share(weights, scenario, judged)))
            print(f"{number:5d} iterations: median regret {100 * curve[-1][1]:6.1f} % of the value")
        half = random.standard_normal((NETWORKS // 2, SIZE))
        changes = np.concatenate([half, -half])
        # The games are dealt out anew, so that all networks play the same kind
        order = random.permutation(NETWORKS * GAMES)
        games = observation[order].reshape(NETWORKS, GAMES, INPUTS)
        actions = np.empty((NETWORKS * GAMES, ACTIONS))
        actions[order] = act(weights + spread * changes, games).reshape(-1, ACTIONS)
        observation, reward, _, _, _ = environment.step(actions)
        fitness = reward[order].reshape(NETWORKS, GAMES).mean(axis=1)
        fitness = (fitness - fitness.mean()) / (fitness.std() + 1e-9)
        slope = fitness @ changes / (NETWORKS * SPREAD)
        mean = 0.9 * mean + 0.1 * slope
        square = 0.99 * square + 0.01 * slope**2
        size = np.sqrt(square / (1.0 - 0.99 ** (number + 1))) + 1e-9
        weights = weights + RATE * (0.1 + 0.9 * left) * mean / size
    curve.append((iterations, regret_share(weights, scenario, judged)))
    print(f"{iterations:5d} iterations: median regret {100 * curve[-1][1]:6.1f} % of the value")
    return weights, curve


def draw(curve: list[tuple[int, float]], path: Path) -> None:
    """Draw the learning curve."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.0), layout="constrained")
    axes = figure.subplots()
    numbers, shares = zip(*curve, strict=True)
    axes.semilogy(numbers, 100.0 * np.array(shares), marker="o")
    axes.axhline(10.0, color="0.5", linestyle="--")
    axes.set(xlabel="iterations", ylabel="median regret, % of the game's value")
    axes.grid(visible=True, linewidth=0.3)
    figure.savefig(path)


def main(iterations: int = 160, folder: Path = FOLDER, games: int = 128) -> float:
    """Train, and write scenario, weights and learning curve; return the last median regret over the value."""
    folder.mkdir(exist_ok=True, parents=True)
    scenario = folder / SCENARIO
    scenario.write_text(CHASE, encoding="utf-8")
    weights, curve = train(scenario, iterations, games)
    np.save(folder / WEIGHTS, weights)
    draw(curve, folder / "learning.png")
    return curve[-1][1]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--iterations", type=int, default=160)
    main(parser.parse_args().iterations)
