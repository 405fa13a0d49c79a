"""What to play on old information: laws against a worst evader: `python tests/bench/bench_game_age.py [--states N]`.

The evader is seen as it was some time ago, where it was and how it ran. Beyond `guaranteed_age_s` nothing promises the
value of `solve`, so the laws are compared by what they lose: each plays, from many starts, every evader of a family
(straight on any heading, weaving at several periods, turning away or back at whatever the pursuer does, straight to the
target), and the worst of them counts. Printed, for ages in units of the guaranteed one: what that costs more than
up-to-date play is worth, in seconds to the capture (PE; play ends after twice that and a quarter of a minute more) or
in metres of the final distance to the target (TAD).
"""

import argparse
from typing import NamedTuple

import numpy as np

from guidance.game import Ball, Cylinder, Game, StandOff, guaranteed_age_s, solve

DT_S = 0.1
GAMES = {
    "cylinder 12/3/1.5 m/s, evader 6 m/s, R 4 m": (Cylinder(12.0, 3.0, 1.5), 6.0, StandOff(4.0, 8.0)),
    "ball 12 m/s, evader 6 m/s, R 4 m": (Ball(12.0), 6.0, StandOff(4.0, 8.0)),
}
AGES = (1.0, 1.25, 1.5, 2.0)


class Law(NamedTuple):
    """Where the evader is taken to be, and how old that is taken to be at most, in units of the guaranteed age."""

    predicted: bool
    most: float


LAWS = {
    "last seen, whole age (open loop)": Law(predicted=False, most=np.inf),
    "last seen, age as guaranteed at most": Law(predicted=False, most=1.0),
    "last seen, as if new": Law(predicted=False, most=0.0),
    "predicted, whole age (open loop)": Law(predicted=True, most=np.inf),
    "predicted, age as guaranteed at most": Law(predicted=True, most=1.0),
    "predicted, as if new": Law(predicted=True, most=0.0),
}


def evaders(game, T):
    """Yield every evader of the family: a function of time, P and E that gives a heading."""
    for angle in np.arange(12) * np.pi / 6.0:
        yield lambda t, P, E, angle=angle: np.full(len(P), angle)
    away = lambda P, E: np.arctan2(*(E - P)[:, 1::-1].T)  # noqa: E731
    for period in (1.0, 2.0, 4.0):
        for swing in (np.pi / 3.0, np.pi / 2.0, np.pi):
            yield lambda t, P, E, period=period, swing=swing: away(P, E) + swing * np.sign(np.sin(6.283 * t / period))
    yield away_of(away, np.pi / 2.0)
    yield away_of(away, -np.pi / 2.0)
    yield away_of(away, 0.0)
    if T is not None:
        to_target = lambda E: np.arctan2(*(T - E)[:, 1::-1].T)  # noqa: E731
        yield lambda t, P, E: to_target(E)
        for period in (1.0, 2.0, 4.0):
            for swing in (np.pi / 6.0, np.pi / 3.0):
                yield (
                    lambda t, P, E, period=period, swing=swing: (
                        to_target(E) + swing * np.sign(np.sin(6.283 * t / period))
                    )
                )
        up_to_date = Game(game.pursuer, game.evader_speed_m_s, standoff=game.standoff)
        yield lambda t, P, E: np.arctan2(*solve(up_to_date, P, E, T).evader_velocity_m_s[:, 1::-1].T)


def away_of(away, turn):
    """Run at an angle from straight away."""
    return lambda t, P, E: away(P, E) + turn


def caught(game, P, E):
    """Say who is on the disc or nearer, to 0.3 m: what a vehicle's tolerance is."""
    beside = np.hypot(*(P - E)[:, :2].T) - game.standoff.radius_m
    above = np.abs(P[:, 2] - game.standoff.height_m)
    return (
        (np.maximum(beside, above) <= 0.3)
        if isinstance(game.pursuer, Cylinder)
        else np.hypot(np.maximum(beside, 0.0), above) <= 0.3
    )


def play(game, law, age_s, P, E, T, family, limit_s):
    """Play every start against every evader to the capture, the arrival or the limit.

    Returns when each was captured, and what distance was left then, (evaders, starts) each: zero where it arrived,
    infinite where it did neither.
    """
    delay, v, kinds = round(age_s / DT_S), game.evader_speed_m_s, len(family)
    known = Game(
        game.pursuer, v, standoff=game.standoff, information_age_s=min(age_s, law.most * guaranteed_age_s(game))
    )
    count = len(P)
    P, E = (np.tile(array, (kinds, 1)) for array in (P, E))
    T = None if T is None else np.tile(T, (kinds, 1))
    path, runs = [E] * (delay + 1), [np.zeros_like(E)] * (delay + 1)
    time, left, live = np.full(len(P), limit_s), np.full(len(P), np.inf), np.ones(len(P), dtype=bool)
    for step in range(int(limit_s / DT_S)):
        now = caught(game, P, E) & live
        time[now], live = step * DT_S, live & ~now
        if T is not None:
            left[now] = np.linalg.norm((E - T)[now], axis=1)
            there = live & (np.linalg.norm(E - T, axis=1) <= v * DT_S)
            left[there], live = 0.0, live & ~there
        if not live.any():
            break
        blocks = [slice(k * count, (k + 1) * count) for k in range(kinds)]
        heading = np.concatenate([run(step * DT_S, P[b], E[b]) for run, b in zip(family, blocks, strict=True)])
        run = v * np.stack([np.cos(heading), np.sin(heading), 0.0 * heading], axis=1)
        seen = path[-delay - 1] + (age_s * runs[-delay - 1] if law.predicted else 0.0)
        P = P + DT_S * solve(known, P, seen, T, evader_velocity_m_s=runs[-delay - 1]).pursuer_velocity_m_s
        E = E + DT_S * run
        path.append(E)
        runs.append(run)
    return time.reshape(kinds, count), left.reshape(kinds, count)


def loss(game, law, age_s, P, E, T):
    """Return what the worst evader costs, row by row."""
    value = solve(Game(game.pursuer, game.evader_speed_m_s, standoff=game.standoff), P, E, T).value
    limit_s = float(2.0 * value.max() + 15.0) if T is None else 40.0
    time, left = play(game, law, age_s, P, E, T, list(evaders(game, T)), limit_s)
    return time.max(axis=0) - value if T is None else value - left.min(axis=0)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--states", type=int, default=8)
    count = parser.parse_args().states
    rng = np.random.default_rng(0)
    for name, (speeds, v, standoff) in GAMES.items():
        game = Game(speeds, v, standoff=standoff)
        P, E, T = rng.uniform(-60.0, 60.0, (3, 8 * count, 3))
        P[:, 2] = standoff.height_m + rng.uniform(0.0, 4.0, len(P))
        E[:, 2] = T[:, 2] = 0.0
        won = np.flatnonzero((solve(game, P, E, T).value > 15.0) & (solve(game, P, E, T).winner > 0))[:count]
        P, E, T = P[won], E[won], T[won]
        for kind, target in (("PE, s", None), ("TAD, m", T)):
            print(f"{kind}: {name}; guaranteed to {guaranteed_age_s(game):.2f} s; mean (worst) loss of {len(P)} starts")
            print(f"  {'age / guaranteed':38}" + "".join(f"{age:>16.1f}" for age in AGES))
            for said, law in LAWS.items():
                losses = [loss(game, law, age * guaranteed_age_s(game), P, E, target) for age in AGES]
                print(f"  {said:38}" + "".join(f"{one.mean():8.1f} ({one.max():5.1f})" for one in losses), flush=True)


if __name__ == "__main__":
    main()
