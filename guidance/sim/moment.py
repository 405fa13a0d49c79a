"""A moment of a batch of games that are played as mathematics."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from guidance.sim.batch import Array, starts
from guidance.sim.scenario import Scenario
from guidance.sim.sensor import PERFECT, Received, begin
from guidance.strategies.catalogue import PROPORTIONAL

RUNNING, CAPTURED, ARRIVED, TIME_UP, FAILED = range(5)
ENDS = ("running", "captured", "arrived", "time_up", "failed")
LIMITS = ("fence", "floor", "ceiling")


class Moment(NamedTuple):
    """A batch of games, each at one moment of its own; arrays (n, …).

    Attributes:
        row: Number of the game.
        now_s: Time since engagement.
        pursuer_m: Position.
        evader_m: Position.
        flown_m_s: Pursuer velocity at the begin of the last step.
        run_m_s: Evader velocity at the begin of the last step.
        step_s: Length of the last step.
        turning_rad_s: Mean rate of turn of the last step, for proportional navigation of a pursuer that sees the
            evader; else None.
        heard: Reports that the pursuer received; None if it sees the evader.
        lost_s: Waiting time for a report.
        standoff_m: Least horizontal distance so far.
        altitude_m: Least height above the evader's plane so far.
        met: Which of `LIMITS` have held the pursuer back, (n, 3).
        lost: Whether the evader was ever lost.
        no_game: Whether the evader was too fast for a game.
        end: Index into `ENDS`.
    """

    row: NDArray[np.intp]
    now_s: Array
    pursuer_m: Array
    evader_m: Array
    flown_m_s: Array
    run_m_s: Array
    step_s: Array
    turning_rad_s: Array | None
    heard: Received | None
    lost_s: Array
    standoff_m: Array
    altitude_m: Array
    met: NDArray[np.bool_]
    lost: NDArray[np.bool_]
    no_game: NDArray[np.bool_]
    end: NDArray[np.int8]


def begun(scenarios: Sequence[Scenario]) -> Moment:
    """Return the moment of engagement of scenarios of one kind."""
    P, E = starts(scenarios)
    count = len(scenarios)
    zeros = np.zeros(count)
    no = np.zeros(count, dtype=bool)
    sensor, navigates = scenarios[0].sensor, scenarios[0].pursuer.policy == PROPORTIONAL
    return Moment(
        row=np.arange(count),
        now_s=zeros,
        pursuer_m=P,
        evader_m=E,
        flown_m_s=np.zeros_like(P),
        run_m_s=np.zeros_like(E),
        step_s=zeros,
        turning_rad_s=np.zeros_like(P) if navigates and sensor == PERFECT else None,
        heard=None if sensor == PERFECT else begin(sensor, E),
        lost_s=zeros,
        standoff_m=beside(P, E),
        altitude_m=P[:, 2],
        met=np.zeros((count, len(LIMITS)), dtype=bool),
        lost=no,
        no_game=no,
        end=np.zeros(count, dtype=np.int8),
    )


def beside(P: Array, E: Array) -> Array:
    """Return the horizontal distances of pursuers and evaders, (n,), m."""
    return np.asarray(np.sqrt((P[:, 0] - E[:, 0]) ** 2 + (P[:, 1] - E[:, 1]) ** 2))
