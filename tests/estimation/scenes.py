"""Reports of an evader, and what a track makes of them."""

import random

from guidance.estimation import Measurement, Track, TrackSettings, update

SETTINGS = TrackSettings(declared_speed_m_s=3.0)


def measured(time_s, position, velocity=None, *, received_s=None, position_sd_m=0.5, velocity_sd_m_s=0.2):
    return Measurement(
        time_s, time_s if received_s is None else received_s, position, velocity, position_sd_m, velocity_sd_m_s
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
                tuple(start + time_s * v + noise(0.5) for start, v in zip((10.0, 20.0, -1.0), velocity, strict=True)),
                tuple(v + noise(0.2) for v in velocity) if known else None,
                received_s=time_s + delay_s,
            )
        )
    return reports


def tracked(reports, options=SETTINGS, track=None):
    track = track or Track()
    for one in reports:
        track = update(track, one, options)
    return track
