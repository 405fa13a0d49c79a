"""How an evader moves in the plane: two models side by side, constant velocity (0) and coordinated turn (1).

State, last axis: north, east (m), their rates (m/s), turn rate (rad/s, north to east). Leading axis: the model.
Source: Bar-Shalom, Li & Kirubarajan, Estimation with Applications to Tracking and Navigation (2001), 6.2.2 (white
noise acceleration) and 11.7 (coordinated turn with unknown rate). The turn rate fades with a correlation time, so
that it stays bounded however long nothing is heard; the steady model only carries it along.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from guidance.estimate.settings import TrackSettings

Array = NDArray[np.float64]

STATES = 5

_IDENTITY = np.broadcast_to(np.eye(STATES), (2, STATES, STATES))
_SMALL_TURN_RAD = 1e-3


class Step(NamedTuple):
    """Both models moved on: states (2, 5), transition Jacobians (2, 5, 5) and process noise (2, 5, 5)."""

    mean: Array
    jacobian: Array
    noise: Array


def step(mean: Array, dt_s: float, settings: TrackSettings) -> Step:
    """Move both models' states (2, 5) on by dt ≥ 0."""
    fade = math.exp(-dt_s / settings.turn_time_s)
    north, east, north_rate, east_rate, turn_rate = mean[1].tolist()
    along, across, along_slope, across_slope = _arc(turn_rate, dt_s)
    sine, cosine = math.sin(turn_rate * dt_s), math.cos(turn_rate * dt_s)
    new_north_rate = cosine * north_rate - sine * east_rate
    new_east_rate = sine * north_rate + cosine * east_rate

    jacobian = _IDENTITY.copy()
    jacobian[:, 4, 4] = fade
    jacobian[0, 0, 2] = jacobian[0, 1, 3] = dt_s
    jacobian[1, :4, 2:] = (
        (along, -across, along_slope * north_rate - across_slope * east_rate),
        (across, along, across_slope * north_rate + along_slope * east_rate),
        (cosine, -sine, -dt_s * new_east_rate),
        (sine, cosine, dt_s * new_north_rate),
    )
    moved = np.empty_like(mean)
    moved[0] = jacobian[0] @ mean[0]
    moved[1] = (
        north + along * north_rate - across * east_rate,
        east + across * north_rate + along * east_rate,
        new_north_rate,
        new_east_rate,
        fade * turn_rate,
    )
    return Step(moved, jacobian, _noise(dt_s, fade, settings))


def _arc(turn_rate: float, dt_s: float) -> tuple[float, float, float, float]:
    """sin(ωt)/ω, (1 − cos ωt)/ω and their derivatives by ω, with their limits where the turn is small."""
    angle = turn_rate * dt_s
    if abs(angle) < _SMALL_TURN_RAD:
        return (
            dt_s * (1.0 - angle**2 / 6.0),
            dt_s * angle * (0.5 - angle**2 / 24.0),
            -(dt_s**2) * angle / 3.0,
            dt_s**2 * (0.5 - angle**2 / 8.0),
        )
    along, across = math.sin(angle) / turn_rate, (1.0 - math.cos(angle)) / turn_rate
    return (
        along,
        across,
        (dt_s * math.cos(angle) - along) / turn_rate,
        (dt_s * math.sin(angle) - across) / turn_rate,
    )


def _noise(dt_s: float, fade: float, settings: TrackSettings) -> Array:
    """White acceleration over dt: q · [dt³/3, dt²/2; dt²/2, dt], so that any report rate gives the same spread."""
    place, cross = dt_s**3 / 3.0, dt_s**2 / 2.0
    shape = np.array(
        [
            [place, 0.0, cross, 0.0, 0.0],
            [0.0, place, 0.0, cross, 0.0],
            [cross, 0.0, dt_s, 0.0, 0.0],
            [0.0, cross, 0.0, dt_s, 0.0],
            [0.0, 0.0, 0.0, 0.0, 0.0],
        ]
    )
    noise = np.array([settings.steady_noise_m2_s3 * shape, settings.turning_noise_m2_s3 * shape])
    noise[:, 4, 4] = settings.turn_rate_sd_rad_s**2 * (1.0 - fade**2)
    return noise
