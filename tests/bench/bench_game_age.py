"""Compare laws for old information against a worst evader: `python tests/bench/bench_game_age.py [--states N]`.

The pursuer sees the evader's position and velocity of some time ago. Each law plays, from many starts, every evader of
a family: straight on any heading, weaving at several periods, turning relative to the pursuer, and straight to the
target. The loss is the difference of the worst result to the value of up-to-date play: seconds to the capture in PE (a
play ends after twice the value and 15 s), metres of the final distance in TAD. Ages are in units of `guaranteed_age_s`;
beyond it TAD with an age has no value.

Two laws also have a promise. With its age: the value for the last seen place with its age, a guarantee in PE up to this
age and never in TAD. With the disc less the spread vτ: that game's value (TAD: less vτ), a guarantee in both. The line
below such a law shows by how much the worst evader beats the promise. An age is a whole number of steps and counts to
the end of the step in which a command acts. A pursuer that would reach its point within a step follows the evader for
the rest of it, because otherwise a Ball flies past its disc: it moves 1.2 m in a step, and 0.3 m count as a capture.
"""

import argparse
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from guidance.game import Ball, Cylinder, Game, StandOff, guaranteed_age_s, solve

STEPS = 12
"""Steps of a guaranteed age: 0.056 s in both games."""

GAMES = {
    "cylinder 12/3/1.5 m/s, evader 6 m/s, R 4 m": (
        Cylinder(12.0, 3.0, 1.5),
        6.0,
        StandOff(4.0, 8.0),
    ),
    "ball 12 m/s, evader 6 m/s, R 4 m": (Ball(12.0), 6.0, StandOff(4.0, 8.0)),
}
AGES = (0.25, 0.5, 1.0, 1.5, 2.0)


class Law(NamedTuple):
    """The assumed place of the evader, and the treatment of its age."""

    predicted: bool
    answer: str


LAWS = {
    f"{seen}, {how}": Law(predicted=seen == "predicted", answer=answer)
    for seen in ("last seen", "predicted")
    for how, answer in (
        ("with its age", "age"),
        ("disc less the spread", "floor"),
        ("as if new", "new"),
    )
}
PROMISED = {"age": "  its value with age was beaten by", "floor": "  its floor was beaten by"}
"""Laws on the last seen place of the evader, and the promise of theirs that is held against the worst evader."""


def played(game, law, age_s):
    """The game whose `solve` a law plays."""
    spread = game.evader_speed_m_s * age_s
    if law.answer == "floor":
        return replace(
            game,
            standoff=StandOff(max(game.standoff.radius_m - spread, 0.0), game.standoff.height_m),
        )
    return replace(game, information_age_s=age_s * (1.0 - 1e-12)) if law.answer == "age" else game


def promised(game, law, age_s, P, E, T):
    """Return what a law promises: seconds to the capture at most, or metres of the final distance at least."""
    solution = solve(played(game, law, age_s), P, E, T)
    if T is None:
        return solution.value
    spread = game.evader_speed_m_s * age_s if law.answer == "floor" else 0.0
    return np.maximum(np.where(solution.winner > 0, solution.value, 0.0) - spread, 0.0)


def evaders(game, T):
    """Yield every evader of the family: a function of time, P and E that gives a heading."""
    for angle in np.arange(12) * np.pi / 6.0:
        yield lambda t, P, E, angle=angle: np.full(len(P), angle)
    away = lambda P, E: np.arctan2(*(E - P)[:, 1::-1].T)  # noqa: E731
    for period in (1.0, 2.0, 4.0):
        for swing in (np.pi / 3.0, np.pi / 2.0, np.pi):
            yield (
                lambda t, P, E, period=period, swing=swing: (
                    away(P, E) + swing * np.sign(np.sin(6.283 * t / period))
                )
            )
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
        yield lambda t, P, E: np.arctan2(*solve(game, P, E, T).evader_velocity_m_s[:, 1::-1].T)


def away_of(away, turn):
    """Run at an angle from straight away."""
    return lambda t, P, E: away(P, E) + turn


def caught(game, P, E):
    """Return which pursuers are within 0.3 m of the disc, the tolerance of a vehicle."""
    beside = np.hypot(*(P - E)[:, :2].T) - game.standoff.radius_m
    above = np.abs(P[:, 2] - game.standoff.height_m)
    return (
        (np.maximum(beside, above) <= 0.3)
        if isinstance(game.pursuer, Cylinder)
        else np.hypot(np.maximum(beside, 0.0), above) <= 0.3
    )


def play(game, law, age_steps, P, E, T, family, limit_s):
    """Play every start against every evader to the capture, the arrival or the limit.

    Returns when each was captured, and what distance was left then, (evaders, starts) each: zero where it arrived,
    infinite where it did neither.
    """
    step_s = guaranteed_age_s(game) / STEPS
    v = game.evader_speed_m_s
    kinds = len(family)
    count = len(P)
    age_s = age_steps * step_s
    delay = age_steps - 1
    known = played(game, law, age_s)
    P, E = (np.tile(array, (kinds, 1)) for array in (P, E))
    T = None if T is None else np.tile(T, (kinds, 1))
    path = [E] * (delay + 1)
    runs = [np.zeros_like(E)] * (delay + 1)
    time = np.full(len(P), limit_s)
    left = np.full(len(P), np.inf)
    live = np.ones(len(P), dtype=bool)
    blocks = [slice(k * count, (k + 1) * count) for k in range(kinds)]
    for step in range(int(limit_s / step_s)):
        now = caught(game, P, E) & live
        time[now], live = step * step_s, live & ~now
        if T is not None:
            left[now] = np.linalg.norm((E - T)[now], axis=1)
            there = live & (np.linalg.norm(E - T, axis=1) <= v * step_s)
            left[there], live = 0.0, live & ~there
        if not live.any():
            break
        heading = np.concatenate(
            [run(step * step_s, P[b], E[b]) for run, b in zip(family, blocks, strict=True)]
        )
        run = v * np.stack([np.cos(heading), np.sin(heading), 0.0 * heading], axis=1)
        seen = path[-delay - 1] + (age_s * runs[-delay - 1] if law.predicted else 0.0)
        move = solve(known, P, seen, T, evader_velocity_m_s=runs[-delay - 1])
        short = (move.meeting_time_s > 0) & (move.meeting_time_s < step_s)
        flown_s = np.where(short, move.meeting_time_s, step_s)[:, None]
        P = P + flown_s * move.pursuer_velocity_m_s + (step_s - flown_s) * runs[-delay - 1]
        E = E + step_s * run
        path.append(E)
        runs.append(run)
    return time.reshape(kinds, count), left.reshape(kinds, count)


def loss(game, law, age_steps, P, E, T):
    """Return the loss by the worst evader against up-to-date play and against the promise, row by row."""
    promise = promised(game, law, age_steps * guaranteed_age_s(game) / STEPS, P, E, T)
    value = solve(game, P, E, T).value
    limit_s = float(2.0 * value.max() + 15.0) if T is None else 40.0
    time, left = play(game, law, age_steps, P, E, T, list(evaders(game, T)), limit_s)
    if T is None:
        return time.max(axis=0) - value, time.max(axis=0) - promise
    return value - left.min(axis=0), promise - left.min(axis=0)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--states", type=int, default=8)
    parser.add_argument("--only", default="", help="what a title holds: PE, TAD, ball, cylinder")
    asked = parser.parse_args()
    count = asked.states
    rng = np.random.default_rng(0)
    for name, (speeds, v, standoff) in GAMES.items():
        game = Game(speeds, v, standoff=standoff)
        P, E, T = rng.uniform(-60.0, 60.0, (3, 8 * count, 3))
        P[:, 2] = standoff.height_m + rng.uniform(0.0, 4.0, len(P))
        E[:, 2] = T[:, 2] = 0.0
        won = np.flatnonzero(
            (solve(game, P, E, T).value > 15.0) & (solve(game, P, E, T).winner > 0)
        )[:count]
        P = P[won]
        E = E[won]
        T = T[won]
        for kind, target in (("PE, s", None), ("TAD, m", T)):
            title = f"{kind}: {name}"
            if not all(word in title for word in asked.only.split()):
                continue
            print(
                f"{title}; guaranteed to {guaranteed_age_s(game):.2f} s; mean (worst) loss of {len(P)} starts"
            )
            print(f"  {'age / guaranteed':38}" + "".join(f"{age:>16.2f}" for age in AGES))
            for said, law in LAWS.items():
                print(f"  {said:38}", end="", flush=True)
                losses = []
                ages = [age for age in AGES if target is None or law.answer != "age" or age <= 1.0]
                for age in ages:
                    losses.append(loss(game, law, round(age * STEPS), P, E, target))
                    print(
                        f"{losses[-1][0].mean():8.1f} ({losses[-1][0].max():5.1f})",
                        end="",
                        flush=True,
                    )
                print()
                if not law.predicted and law.answer in PROMISED:
                    within = [
                        f"{one.max():16.2f}"
                        for (_, one), age in zip(losses, ages, strict=True)
                        if age <= 1.0
                    ]
                    print(f"  {PROMISED[law.answer]:38}{''.join(within)}")


if __name__ == "__main__":
    main()
