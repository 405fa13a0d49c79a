"""Steps per second of the league's environments on one core, and what Gymnasium's wrapper adds to the bare rollout.

`python -m tests.bench.bench_league --environments 4096` plays games between points with the optimal velocities as
actions. It measures processor time, because others may use the machine too, and prints medians. Wanted: 1 M
environment steps per second in PE and TAD, a reset of all in 5 ms, and a wrapper of at most 20 % of the rollout, which
begins finished games anew as well.
"""

import argparse
import time

import numpy as np

from guidance.game import End
from guidance.league import PursuitVectorEnv
from guidance.league.states import seeds_of

SPEEDS_M_S = {"pursuer": 3.0, "evader": 1.5}


def median_ms(action, times):
    """Return the median of the processor time of an action, ms."""
    spent = []
    for _ in range(times):
        began_s = time.process_time()
        action()
        spent.append(time.process_time() - began_s)
    return 1e3 * float(np.median(spent))


def measured(scenario, side, environments, steps, *, between_points):
    """Return step, bare rollout and reset, ms."""
    environment = PursuitVectorEnv(scenario, environments, side=side, between_points=between_points)
    environment.reset(seed=1)
    games = environment.games
    columns = environment.single_action_space.shape[0]
    whole = []
    bare = []

    def optimal():
        return getattr(games.solution, f"{side}_velocity_m_s").copy()

    for number in range(2 * steps):
        velocity = optimal()
        action = velocity[:, :columns] / SPEEDS_M_S[side]
        if side == "pursuer":
            speeds = games.batch.game.pursuer
            rates_m_s = np.where(velocity[:, 2] > 0.0, speeds.climb_m_s, speeds.descent_m_s)
            action[:, 2] = velocity[:, 2] / rates_m_s
        began_s = time.process_time()
        if number % 2:
            environment.step(action)
            whole.append(time.process_time() - began_s)
        else:
            finished = np.flatnonzero(games.moment.end != End.RUNNING)
            games.step(*((velocity, None) if side == "pursuer" else (None, velocity)))
            if len(finished):
                games.restart(finished, seeds_of(3, len(finished), 100 * number))
            bare.append(time.process_time() - began_s)
    reset_ms = median_ms(lambda: environment.reset(seed=2), 20)
    return 1e3 * float(np.median(whole)), 1e3 * float(np.median(bare)), reset_ms


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--environments", type=int, default=4096)
    parser.add_argument("--steps", type=int, default=200)
    arguments = parser.parse_args()
    print("game            side     M steps/s  step ms  rollout ms  wrapper %  reset ms")
    for scenario, side, between_points in [
        ("pe", "pursuer", True),
        ("pe", "evader", True),
        ("tad", "pursuer", True),
        ("tad", "evader", True),
        ("pe", "pursuer", False),
        ("tad", "pursuer", False),
    ]:
        step_ms, bare_ms, reset_ms = measured(
            scenario, side, arguments.environments, arguments.steps, between_points=between_points
        )
        name = f"{scenario} {'points' if between_points else 'disc'}"
        rate = arguments.environments / step_ms / 1e3
        wrapper = 100.0 * (step_ms / bare_ms - 1.0)
        print(
            f"{name:<15} {side:<8} {rate:9.2f} {step_ms:8.2f} {bare_ms:11.2f} {wrapper:10.0f} {reset_ms:9.2f}"
        )


if __name__ == "__main__":
    main()
