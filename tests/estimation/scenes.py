"""Reports of an evader, and what a track makes of them."""

import math
import random
from collections import Counter
from typing import NamedTuple

import numpy as np

from guidance import estimation
from guidance.estimation.filters import advance, blended, distance
from guidance.estimation.measurement import Measurement, TrackSettings
from guidance.estimation.track import Track, update
from guidance.frames import Ned

SETTINGS = TrackSettings(declared_speed_m_s=3.0)


def measured(
    time_s, position, velocity=None, *, received_s=None, position_sd_m=0.5, velocity_sd_m_s=0.2
):
    return Measurement(
        time_s,
        time_s if received_s is None else received_s,
        Ned(position),
        None if velocity is None else Ned(velocity),
        position_sd_m,
        velocity_sd_m_s,
    )


def straight(count, rate_hz=10.0, velocity=(3.0, -1.0, 0.2), *, seed=None, known=True, delay_s=0.0):
    """Reports of an evader that goes straight, with noise from a seed."""
    rng = random.Random(seed)
    noise = (lambda sd: rng.gauss(0.0, sd)) if seed is not None else (lambda _sd: 0.0)
    reports = []
    for step in range(count):
        time_s = step / rate_hz
        reports.append(
            measured(
                time_s,
                tuple(
                    start + time_s * v + noise(0.5)
                    for start, v in zip((10.0, 20.0, -1.0), velocity, strict=True)
                ),
                tuple(v + noise(0.2) for v in velocity) if known else None,
                received_s=time_s + delay_s,
            )
        )
    return reports


def tracked(reports, options=SETTINGS, track=None):
    track = track or Track()
    for report in reports:
        track = update(track, report, options)
    return track


def outcomes_of(reports, options=SETTINGS):
    """Return how many reports have each outcome."""
    track = Track()
    counts = Counter()
    for report in reports:
        track = update(track, report, options)
        counts[track.outcome] += 1
    return counts


def nis_of(track, one, options):
    """Return the normalised innovation squared of a report that is newer than the track's last."""
    return distance(advance(track.estimate, one.time_s, options).modes, *one.plane())


class Predicted(NamedTuple):
    """A prediction with what the filter knows besides."""

    position_ned_m: tuple
    velocity_ned_m_s: tuple
    speed_bound_m_s: float
    age_s: float
    velocity_known: bool
    turning: float
    turn_rate_rad_s: float
    covariance: np.ndarray

    @property
    def position_sd_m(self):
        return math.sqrt(np.linalg.eigvalsh(self.covariance[:2, :2]).max())

    @property
    def velocity_sd_m_s(self):
        return math.sqrt(np.linalg.eigvalsh(self.covariance[2:, 2:]).max())


def predict(track, now_s, options):
    """Return the prediction with its covariance and turn rate; its velocity also where it is not known."""
    if track.estimate is None:
        return None
    evader = estimation.predict(track.estimate, Ned((0.0, 0.0, 0.0)), now_s, options)
    moved = advance(track.estimate, now_s, options)
    mixture = blended(*moved.modes)
    mean = mixture.mean
    covariance = np.zeros((4, 4))
    covariance[np.tril_indices(4)] = mixture.covariance
    covariance += np.tril(covariance, -1).T
    turning = moved.modes.turning_share
    made = Predicted(*evader, False, turning, turning * moved.modes.turning.mean[4], covariance)
    velocity = (float(mean[2]), float(mean[3]), moved.height.rate_m_s)
    known = made.velocity_sd_m_s <= options.known_velocity_sd_m_s
    assert evader.velocity_ned_m_s == (velocity if known else (0.0, 0.0, 0.0))
    return made._replace(velocity_ned_m_s=velocity, velocity_known=known)
