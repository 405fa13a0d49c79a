"""Solves a million states of the TAD game in one call, and draws the barrier between the winners.

python docs/examples/million_states.py [STATES] [PICTURE]
"""

import sys
import time
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from guidance.game import Ball, Game, StandOff, solve

GAME = Game(Ball(6.0), evader_speed_m_s=3.0, standoff=StandOff(3.0, 5.0))
TARGET = np.zeros(3)


def margins(states: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return evader positions on a square grid, (n, n, 3), m, and the pursuer's margins, (n, n), s."""
    side = int(states**0.5)
    x, y = np.meshgrid(np.linspace(-60.0, 60.0, side), np.linspace(-60.0, 60.0, side))
    evaders = np.stack([x, y, np.zeros_like(x)], axis=-1)
    pursuer = np.array([25.0, 10.0, 20.0])
    answer = solve(GAME, pursuer, evaders, TARGET)
    return evaders, np.asarray(answer.margin_s)


def draw(evaders: NDArray[np.float64], margin_s: NDArray[np.float64], picture: Path) -> None:
    """Draw the margin; the barrier is where it is zero."""
    figure = Figure(figsize=(7.0, 6.0), layout="constrained")
    axes = figure.add_subplot()
    shades = axes.contourf(
        evaders[..., 0],
        evaders[..., 1],
        margin_s,
        levels=np.arange(-12.0, 13.0, 2.0),
        cmap="RdBu",
        extend="both",
    )
    axes.contour(evaders[..., 0], evaders[..., 1], margin_s, levels=[0.0], colors="black")
    axes.plot(25.0, 10.0, "k^", label="pursuer, 20 m up")
    axes.plot(0.0, 0.0, "kX", label="target")
    axes.set(
        xlabel="x of the evader, m",
        ylabel="y of the evader, m",
        aspect="equal",
        title="Who wins: the barrier in black",
    )
    axes.legend()
    figure.colorbar(shades, label="margin of the pursuer, s")
    figure.savefig(picture, dpi=120)


def main(states: int = 1_000_000, picture: Path = Path("barrier.png")) -> None:
    """Solve, print the time, and draw."""
    begun_s = time.perf_counter()
    evaders, margin_s = margins(states)
    took_s = time.perf_counter() - begun_s
    share = float(np.mean(margin_s > 0.0))
    print(
        f"{margin_s.size} states in {took_s:.2f} s: the pursuer wins {100.0 * share:.1f} % of them"
    )
    draw(evaders, margin_s, picture)
    print(f"picture  {picture}")


if __name__ == "__main__":
    main(
        *([int(sys.argv[1])] if sys.argv[1:] else []),
        *([Path(sys.argv[2])] if sys.argv[2:] else []),
    )
