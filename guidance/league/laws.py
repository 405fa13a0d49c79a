"""Guidance laws as policies of observations, for comparison in the league; simulation only.

They have the form of a user's policy: columns of observations and actions are those of `guidance.strategies.own`.
"""

from typing import Final

import numpy as np

from guidance.strategies.own import Array

NAVIGATION: Final = 3.0
"""The navigation constant N."""

CLOSING_1_S: Final = 5.0
"""Gain of the part along the line of sight, 1/s, as a share of the speed."""

HELD_S: Final = 0.02
"""How long a velocity is held: a cycle of `guidance.sim.maths`."""

FRPN: Final = "guidance.league.laws:frpn"


def frpn(observation: Array) -> Array:
    """Fast response proportional navigation, after Pliska, Vrba, Báča & Saska, arXiv 2405.13542.

    The acceleration is that of proportional navigation and a part along the line of sight, which lets the vehicle
    respond at once where the line of sight does not turn:

        a = N Ω × v + k ‖v‖ r/‖r‖,    Ω = r × (v_E − v) / ‖r‖²

    with r the vector to the goal and v the pursuer's velocity. The law of the paper commands an acceleration; players
    here have bounded speeds, so the velocity after a cycle is flown at full speed in its direction. The gains are not
    the paper's, which are tuned to its vehicle.
    """
    r = observation[:, 0:3]
    evader_m_s = np.zeros_like(r)
    evader_m_s[:, :2] = observation[:, 3:5]
    v = observation[:, 5:8]
    far_m = _length(r)
    sight = r / np.maximum(far_m, 1e-9)[:, None]
    omega = np.cross(r, evader_m_s - v) / np.maximum(far_m**2, 1e-9)[:, None]
    speed_m_s = _length(v)[:, None]
    acceleration = NAVIGATION * np.cross(omega, v) + CLOSING_1_S * speed_m_s * sight
    after_m_s = v + HELD_S * acceleration
    standing = speed_m_s[:, 0] == 0.0
    after_m_s[standing] = sight[standing]
    return after_m_s / np.maximum(_length(after_m_s), 1e-9)[:, None]


def _length(vectors: Array) -> Array:
    return np.asarray(np.sqrt(np.sum(vectors**2, axis=1)))
