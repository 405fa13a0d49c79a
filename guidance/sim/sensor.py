"""What the pursuer of a mathematical play knows of the evader: everything, or what a sensor's reports tell it.

Report k is measured at k / rate and arrives a latency later, unless it is lost. Between reports the evader is taken to
keep its velocity, as a flight's estimate has it; the age of what is known goes into the game as its information age.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from guidance.game.arrays import Real
from guidance.sim.scenario import Sensor
from guidance.strategies import normal, uniform

Array = NDArray[np.float64]

PERFECT: Final = Sensor()

FASTEST_HZ: Final = 50.0
"""Rate of reports that come "as they come": one a cycle."""

TIMEOUT_S: Final = 1.5
"""From this age on a flight takes the evader for lost, and waits."""

DROPOUT_STREAM, POSITION_STREAM, VELOCITY_STREAM = 11, 12, 14
_SURE: Final = 2.0
"""An evader is taken to be faster than declared from so many standard deviations on."""


class Noise(NamedTuple):
    """What may differ from row to row: the seed (n,); standard deviations and share of reports lost, (n,) or one."""

    seed: NDArray[np.int64]
    position_m: Real
    velocity_m_s: Real
    dropout: Real


class Heard(NamedTuple):
    """The pursuer's knowledge, rows (n, …): the last report that arrived, and those on their way.

    Attributes:
        position_m: (n, 3), of the last report.
        velocity_m_s: (n, 3).
        measured_s: When it was measured, (n,).
        measurements: How many were made, (n,).
        arrivals: How many arrived or should have, (n,).
        on_the_way: Reports by number modulo the ring's length, (n, d, 6): position and velocity.
    """

    position_m: Array
    velocity_m_s: Array
    measured_s: Array
    measurements: NDArray[np.int64]
    arrivals: NDArray[np.int64]
    on_the_way: Array


def begin(sensor: Sensor, evader_m: Array) -> Heard:
    """Begin with the evader known to stand where it stands, evader_m being (n, 3)."""
    count = len(evader_m)
    none = np.zeros(count, dtype=np.int64)
    depth = math.floor(sensor.latency_s * _rate_hz(sensor)) + 2
    ring = np.zeros((count, depth, 6))
    return Heard(evader_m.copy(), np.zeros_like(evader_m), np.zeros(count), none, none.copy(), ring)


def next_event_s(sensor: Sensor, heard: Heard) -> Array:
    """Return when, (n,), the next report is measured or arrives."""
    period_s = 1.0 / _rate_hz(sensor)
    return np.asarray(np.minimum(heard.measurements * period_s, heard.arrivals * period_s + sensor.latency_s))


def listen(sensor: Sensor, noise: Noise, heard: Heard, now_s: Array, evader_m: Array, velocity_m_s: Array) -> Heard:
    """Make the measurements and receive the reports that are due at `now_s`, (n,)."""
    period_s = 1.0 / _rate_hz(sensor)
    near_s = now_s + 1e-9
    due = heard.measurements * period_s <= near_s
    if due.any():
        rows = np.flatnonzero(due)
        number = heard.measurements[rows]
        seed = noise.seed[rows]
        at = heard.on_the_way[rows, number % heard.on_the_way.shape[1]]
        for axis in range(2):
            at[:, axis] = evader_m[rows, axis] + _in(noise.position_m, rows) * normal(
                seed, POSITION_STREAM + axis, number
            )
            draw = normal(seed, VELOCITY_STREAM + axis, number)
            at[:, 3 + axis] = velocity_m_s[rows, axis] + _in(noise.velocity_m_s, rows) * draw
        at[:, 2], at[:, 5] = evader_m[rows, 2], velocity_m_s[rows, 2]
        heard.on_the_way[rows, number % heard.on_the_way.shape[1]] = at
        heard.measurements[rows] += 1
    while (
        arrived := (heard.arrivals < heard.measurements) & (heard.arrivals * period_s + sensor.latency_s <= near_s)
    ).any():
        heard = _arrive(sensor, noise, heard, arrived, now_s, period_s)
    return heard


def _arrive(
    sensor: Sensor, noise: Noise, heard: Heard, arrived: NDArray[np.bool_], now_s: Array, period_s: float
) -> Heard:
    rows = np.flatnonzero(arrived)
    number = heard.arrivals[rows]
    comes = uniform(noise.seed[rows], DROPOUT_STREAM, number) >= _in(noise.dropout, rows)
    for begin_s, end_s in sensor.outages_s:
        comes &= ~((now_s[rows] >= begin_s) & (now_s[rows] < end_s))
    heard.arrivals[rows] += 1
    rows, number = rows[comes], number[comes]
    report = heard.on_the_way[rows, number % heard.on_the_way.shape[1]]
    heard.position_m[rows], heard.velocity_m_s[rows] = report[:, :3], report[:, 3:]
    heard.measured_s[rows] = number * period_s
    return heard


class Known(NamedTuple):
    """The evader as the pursuer has it now: where it should be, how fast it goes, its speed bound, how old that is."""

    position_m: Array
    velocity_m_s: Array
    speed_bound_m_s: Real
    age_s: Array


def known(noise: Noise, heard: Heard, declared_m_s: Real, now_s: Array) -> Known:
    """Carry the last report on to now."""
    age_s = np.maximum(now_s - heard.measured_s, 0.0)
    position_m = heard.position_m + age_s[:, None] * heard.velocity_m_s
    seen_m_s = np.sqrt(heard.velocity_m_s[:, 0] ** 2 + heard.velocity_m_s[:, 1] ** 2)
    bound = np.maximum(declared_m_s, seen_m_s - _SURE * noise.velocity_m_s)
    return Known(position_m, heard.velocity_m_s, bound, age_s)


def _in(value: Real, rows: NDArray[np.intp]) -> Real:
    return value[rows] if isinstance(value, np.ndarray) else value


def _rate_hz(sensor: Sensor) -> float:
    return FASTEST_HZ if sensor.rate_hz is None else sensor.rate_hz
