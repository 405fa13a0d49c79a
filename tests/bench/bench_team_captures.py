"""How many evaders teams capture: the plays that keep promises, rules that keep none, and the most that is possible.

    nice -n 15 python -m tests.bench.bench_team_captures [--games 1000] [--evaders straight weaving optimal mixed]

Random games of target guarding between points with a capture radius of 1 m: pursuers anywhere within S of the target
and up to 5 m high, evaders in a square of 40 m about it. All rules play the same games. `guaranteed` are captures that
the matching at the start can force, `in turn` with those of a second evader that a pursuer surely makes after its own.
`most possible` tries all orders of captures of runs that are straight and known in advance; against other evaders it is
no bound. `fewer` are games with fewer captures than guaranteed, `lost` evaders whose capture was promised and that
arrived.
"""

import argparse
import time
from typing import NamedTuple

import numpy as np

from guidance.game import Ball, End, Game
from guidance.game.team import match_teams, rollout_teams
from guidance.game.team.capture_sequences import CaptureProblem, Foreseen, sequence_captures
from guidance.game.team.rollout import held_m

STEP_S = 0.1
TARGET = np.zeros(3)
PLAYS = ("captures", "optimal", "nearest", "hungarian", "lead")


class Cell(NamedTuple):
    """A size of game: players on each side, speed ratio, and S, m."""

    players: int
    ratio: float
    within_m: float


CELLS = (Cell(3, 1.2, 30.0), Cell(5, 1.2, 30.0), Cell(4, 1.1, 40.0))


def weaving(game, pursuer, evader, target=None, evader_velocity_m_s=None):
    """Run to the target in bends of 57 degrees, 6 m long."""
    to = target - evader
    far = np.linalg.norm(to[..., :2], axis=-1)
    to = to / np.maximum(far, 1e-9)[..., None]
    turn = np.where(far > 1.0, np.sin(2.0 * np.pi * far / 6.0), 0.0)
    x = np.cos(turn) * to[..., 0] - np.sin(turn) * to[..., 1]
    y = np.sin(turn) * to[..., 0] + np.cos(turn) * to[..., 1]
    return np.asarray(game.evader_speed_m_s)[..., None] * np.stack([x, y, 0.0 * x], axis=-1)


EVADERS = {
    "straight": ("task_oriented",),
    "weaving": (weaving,),
    "optimal": ("optimal",),
    "mixed": ("task_oriented", weaving, "optimal"),
}


def states(cell: Cell, games: int, seed: int):
    """Return random positions of both teams."""
    rng = np.random.default_rng(seed)
    shape = (games, cell.players)
    away = cell.within_m * np.sqrt(rng.random(shape))
    angle = 2.0 * np.pi * rng.random(shape)
    height = 5.0 * rng.random(shape)
    P = np.stack([away * np.cos(angle), away * np.sin(angle), height], axis=-1)
    E = rng.uniform(-20.0, 20.0, (*shape, 3))
    E[..., 2] = 0.0
    return P, E


def most_possible(game: Game, P, E):
    """Return the most captures of straight runs that are known in advance, by all orders of all pursuers."""
    far = np.linalg.norm(E, axis=-1)
    runs = Foreseen(-E / far[..., None], far)
    nobody = np.full(P.shape[:-1], -1)
    plays = np.ones((*P.shape[:-1], E.shape[-2]), dtype=bool)
    scene = CaptureProblem(game, P, E, np.zeros(E.shape), runs, plays, nobody, nobody > 0, 0.0)
    return sequence_captures(scene).captured


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--games", type=int, default=1000, help="of each cell (default 1000)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cells", type=int, nargs="+", default=range(len(CELLS)))
    parser.add_argument("--evaders", nargs="+", choices=EVADERS, default=list(EVADERS))
    parser.add_argument("--plays", nargs="+", choices=PLAYS, default=PLAYS)
    arguments = parser.parse_args()
    for number in arguments.cells:
        cell = CELLS[number]
        game = Game(Ball(cell.ratio), 1.0, capture_radius_m=1.0)
        P, E = states(cell, arguments.games, arguments.seed)
        sure = match_teams(game, P, E, TARGET, spare_m=held_m(game, STEP_S))
        share = 100.0 / cell.players
        print(
            f"{cell.players} against {cell.players}, u/v {cell.ratio}, S {cell.within_m:g} m, {arguments.games} games: "
            f"guaranteed {share * sure.guaranteed.mean():.1f} %, in turn {share * sure.captures.mean():.1f} %, "
            f"most possible {share * most_possible(game, P, E).mean():.1f} %",
            flush=True,
        )
        for kind in arguments.evaders:
            policies = (EVADERS[kind] * cell.players)[: cell.players]
            for play in arguments.plays:
                began_s = time.perf_counter()
                played = rollout_teams(
                    game,
                    P,
                    E,
                    TARGET,
                    pursuer_policy=play,
                    evader_policy=policies,
                    step_s=STEP_S,
                    duration_s=300.0,
                )
                captured = np.count_nonzero(played.end == End.CAPTURED, axis=1)
                sure_captures = (
                    played.first.captures if play == "captures" else played.first.guaranteed
                )
                lost = (played.first.first >= 0) & (played.end == End.ARRIVED)
                took_s = time.perf_counter() - began_s
                print(
                    f"  {kind:9s} {play:10s} captured {share * captured.mean():5.1f} %  "
                    f"fewer {np.count_nonzero(captured < sure_captures):3d}  lost {np.count_nonzero(lost):3d}  "
                    f"({took_s:.0f} s)",
                    flush=True,
                )


if __name__ == "__main__":
    main()
