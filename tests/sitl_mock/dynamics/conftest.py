"""Fly a vehicle's dynamics open loop and keep its reports."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from sitl_mock.dynamics import CALM, Kind, Motion, Setpoint, Surroundings, Vehicle
from sitl_mock.vector import Vector

HIGH = CALM._replace(ground_down_m=1e6)


@dataclass
class Trace:
    """The vehicle's reports (estimates) and its final motion."""

    time_s: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    motion: Motion

    def first(self, axis: int, level: float) -> float:
        """Time when |velocity| of an axis first reaches a level."""
        reached = np.flatnonzero(np.abs(self.velocity[:, axis]) >= level)
        return float(self.time_s[reached[0]]) if reached.size else math.inf

    def at(self, time_s: float, axis: int) -> float:
        return float(np.interp(time_s, self.time_s, self.velocity[:, axis]))

    def mean(self, axis: int, start_s: float, end_s: float) -> float:
        chosen = (self.time_s >= start_s) & (self.time_s <= end_s)
        return float(self.velocity[chosen, axis].mean())


def fly(
    vehicle: Vehicle,
    setpoint: Setpoint | Callable[[float], Setpoint],
    seconds: float,
    motion: Motion | None = None,
    around: Surroundings | Callable[[float], Surroundings] = HIGH,
    dt_s: float = 0.02,
) -> Trace:
    motion = motion or vehicle.initial(Vector((0.0, 0.0, -20.0)), 0.0, flying=True)
    count = round(seconds / dt_s)
    times = []
    places = []
    speeds = []
    for step in range(count):
        now_s = step * dt_s
        order = setpoint(now_s) if callable(setpoint) else setpoint
        here = around(now_s) if callable(around) else around
        motion = vehicle.step(motion, order, here, dt_s)
        seen = vehicle.estimate(motion.body, here)
        times.append((step + 1) * dt_s)
        places.append(seen.position_ned_m)
        speeds.append(seen.velocity_ned_m_s)
    return Trace(np.array(times), np.array(places), np.array(speeds), motion)


def stream(n: float = 0.0, e: float = 0.0, d: float = 0.0, **more) -> Setpoint:
    """A velocity setpoint of OFFBOARD or GUIDED."""
    return Setpoint(Kind.STREAM, velocity_ned_m_s=Vector((n, e, d)), **more)


def sine_answer(
    vehicle: Vehicle, frequency_hz: float, amplitude_m_s: float = 3.0
) -> tuple[float, float]:
    """Gain and lag (s) of north velocity to a sine, once settled."""
    trace = fly(
        vehicle, lambda t: stream(amplitude_m_s * math.sin(math.tau * frequency_hz * t)), 80.0
    )
    settled = trace.time_s > 40.0
    phase = math.tau * frequency_hz * trace.time_s[settled]
    north = trace.velocity[settled, 0]
    in_phase = 2.0 * np.mean(north * np.sin(phase))
    across = 2.0 * np.mean(north * np.cos(phase))
    lag_rad = -math.atan2(across, in_phase) % math.tau
    return math.hypot(in_phase, across) / amplitude_m_s, lag_rad / (math.tau * frequency_hz)


@pytest.fixture(name="fly")
def fly_fixture():
    return fly


@pytest.fixture(name="stream")
def stream_fixture():
    return stream


@pytest.fixture(name="sine_answer")
def sine_answer_fixture():
    return sine_answer
