"""Cost of the evader's track and of the limits, beside filterpy's IMM: `python tests/bench/bench_track_and_limits.py`.

Prints the best of several means in microseconds: our update and prediction, filterpy's predict and update with two
linear models of four states (the least it can do: no turn rate, no gate, no counting, no history), the ratio, and one
call of the limits with every limiter there is.
"""

import time
import warnings
from collections.abc import Callable

import numpy as np
from rich.console import Console
from rich.table import Table

from guidance.control import Envelope, Situation
from guidance.control.polygon import Polygon
from guidance.control.setpoint_limiter import limit
from guidance.estimation import predict
from guidance.estimation.measurement import Measurement, TrackSettings
from guidance.estimation.track import Track, update
from guidance.frames import STILL, Ned
from guidance.game import StandOff
from guidance.messages import Setpoint

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # filterpy's, on import
    from filterpy.kalman import IMMEstimator, KalmanFilter

SETTINGS = TrackSettings(declared_speed_m_s=3.0)
DT_S = 0.02
ENVELOPE = Envelope(
    floor_m=3.0,
    ceiling_m=60.0,
    speed_m_s=8.0,
    climb_m_s=3.0,
    descent_m_s=1.5,
    acceleration_m_s2=4.0,
    vertical_acceleration_m_s2=2.0,
    jerk_m_s3=20.0,
    yaw_rate_rad_s=1.0,
    fence_radius_m=200.0,
    fence_polygon=Polygon(((-150.0, -150.0), (150.0, -150.0), (150.0, 150.0), (-150.0, 150.0))),
    stand_off=StandOff(radius_m=2.0, height_m=4.0),
)


def report(step: int) -> Measurement:
    """An evader at 3 m/s, reported at 50 Hz."""
    time_s = DT_S * step
    return Measurement(
        time_s, time_s, Ned((3.0 * time_s, 0.0, 0.0)), Ned((3.0, 0.0, 0.0)), 0.5, 0.2
    )


def microseconds(call: Callable[[], object], repeats: int = 1000) -> float:
    """Best of seven means."""
    best = float("inf")
    for _ in range(7):
        begun = time.perf_counter()
        for _ in range(repeats):
            call()
        best = min(best, (time.perf_counter() - begun) / repeats)
    return best * 1e6


def reference() -> Callable[[], object]:
    """One predict and update of filterpy's IMM."""
    filters = []
    for density in (0.05, 1.0):
        one = KalmanFilter(dim_x=4, dim_z=4)
        one.F = np.eye(4) + DT_S * np.eye(4, k=2)
        one.H = np.eye(4)
        one.R = np.diag([0.25, 0.25, 0.04, 0.04])
        one.P = np.eye(4)
        one.Q = density * DT_S * np.eye(4)
        filters.append(one)
    mixture = IMMEstimator(filters, [0.7, 0.3], np.array([[0.99, 0.01], [0.02, 0.98]]))
    measured = np.array([[0.0], [0.0], [3.0], [0.0]])

    def call() -> None:
        mixture.predict()
        mixture.update(measured)

    return call


def main() -> None:
    """Print the table."""
    track = Track()
    for step in range(300):
        track = update(track, report(step), SETTINGS)
    following = report(300)
    situation = Situation(
        Ned((0.0, 0.0, -20.0)),
        Ned((5.0, 0.0, 0.5)),
        0.0,
        Ned((60.0, 0.0, 0.0)),
        Ned((3.0, 0.0, 0.0)),
    )
    command = Setpoint(Ned((6.0, 0.0, 1.5)), Ned((1.0, 0.0, 0.0)), 1.0)
    memory = limit(command, situation, ENVELOPE, None, DT_S).memory

    ours = microseconds(lambda: update(track, following, SETTINGS))
    predicted = microseconds(lambda: predict(track.estimate, STILL, 6.5, SETTINGS))
    reference_us = microseconds(reference())
    limited = microseconds(lambda: limit(command, situation, ENVELOPE, memory, DT_S))
    table = Table("what", "µs", "of filterpy's", title="track and limits, one call")
    table.add_row("track: update with a report", f"{ours:.0f}", f"{ours / reference_us:.2f}")
    table.add_row("track: predict to now", f"{predicted:.0f}", f"{predicted / reference_us:.2f}")
    table.add_row(
        "track: both (asked: 100)",
        f"{ours + predicted:.0f}",
        f"{(ours + predicted) / reference_us:.2f}",
    )
    table.add_row("filterpy IMM: predict and update", f"{reference_us:.0f}", "1")
    table.add_row("limits: every limiter", f"{limited:.0f}", "")
    Console().print(table)


if __name__ == "__main__":
    main()
