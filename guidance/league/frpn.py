"""FRPN, a law of proportional navigation, as a policy of observations, for comparison in the league; simulation only.

They have the form of a user's policy: columns of observations and actions are those of `guidance.strategies.own`.
"""

from typing import Final

import numpy as np

from guidance.game.arrays import FloatArray

GAIN: Final = 19.7
"""G of public implementations of the paper."""

PURSUIT_WEIGHT: Final = 0.051
"""W of the same implementations, 1/s²: the weight of pure pursuit."""

HELD_S: Final = 0.02
"""Holding time of a velocity: a cycle of `guidance.sim.maths`."""

LEVELLED_M: Final = 0.2
"""Closer than this to the goal's height, `frpn_level` flies slower than at full vertical speed."""

FRPN: Final = "guidance.league.frpn:frpn"
FRPN_LEVEL: Final = "guidance.league.frpn:frpn_level"
"""The law for a Ball, and for a Cylinder."""


def frpn(observation: FloatArray) -> FloatArray:
    """Fast response proportional navigation: Pliska, Vrba, Báča & Saska, arXiv 2405.13542, eq. (19).

    The acceleration is that of linearised proportional navigation and a part of pure pursuit, which lets the vehicle
    respond at once where the relative velocity is small:

        a = G ((1 − W) (r + w t) / t² + W r),    t = ‖r‖ / ‖w‖

    with r the vector to the goal and w the evader's velocity relative to the pursuer. Equation and gains are those of
    the paper. Players here have bounded speeds and no bounded acceleration, so the velocity after a cycle is flown at
    full speed in its direction.
    """
    evader_m_s = np.zeros((len(observation), 3))
    evader_m_s[:, :2] = observation[:, 3:5]
    return _flight_direction(observation[:, 0:3], observation[:, 5:8], evader_m_s)


def frpn_level(observation: FloatArray) -> FloatArray:
    """`frpn` for a pursuer whose level and vertical speed are bounded each by itself.

    The law is flown in the plane, and the vehicle flies to the height of the goal at its vertical speed, as
    `guidance.strategies.navigation` does.
    """
    action = np.empty((len(observation), 3))
    action[:, :2] = _flight_direction(observation[:, 0:2], observation[:, 5:7], observation[:, 3:5])
    action[:, 2] = np.clip(observation[:, 2] / LEVELLED_M, -1.0, 1.0)
    return action


def _flight_direction(r: FloatArray, v: FloatArray, evader_m_s: FloatArray) -> FloatArray:
    """Return the direction of the velocity after a cycle, (n, 3) or (n, 2)."""
    w = evader_m_s - v
    to_go_1_s = (_length(w) / np.maximum(_length(r), 1e-9))[:, None]
    navigation = r * to_go_1_s**2 + w * to_go_1_s
    acceleration = GAIN * ((1.0 - PURSUIT_WEIGHT) * navigation + PURSUIT_WEIGHT * r)
    after_m_s = v + HELD_S * acceleration
    return after_m_s / np.maximum(_length(after_m_s), 1e-9)[:, None]


def _length(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.sum(vectors**2, axis=1)))
