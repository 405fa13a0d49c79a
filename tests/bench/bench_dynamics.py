"""Cost of the dynamics: `python tests/bench/bench_dynamics.py`.

Prints for every vehicle the best of several runs: microseconds per step, simulated seconds per second on one core, and
the dynamics' share of the time budget of a stepped mock at 300 vehicle-seconds per second.
"""

import time

from rich.console import Console
from rich.table import Table

from sitl_mock.dynamics import (
    CALM,
    Kind,
    Setpoint,
    Vehicle,
    arducopter_quadrotor,
    px4_quadrotor,
    rover,
)
from sitl_mock.vector import Vector

STEP_S = 0.02
STEPS = 3000
RUNS = 7
ASKED_VEHICLE_S_PER_S = 300.0


def seconds_a_step(vehicle: Vehicle, *, flying: bool) -> float:
    """Best of several runs; the setpoint is a new one every step, as a 50 Hz stream gives it."""
    orders = [
        Setpoint(Kind.STREAM, velocity_ned_m_s=Vector((3.0 + 0.001 * k, 1.0, -0.2)))
        for k in range(STEPS)
    ]
    around = CALM._replace(ground_down_m=1e6 if flying else 0.0)
    best = float("inf")
    for _ in range(RUNS):
        motion = vehicle.initial(Vector((0.0, 0.0, -50.0 if flying else 0.0)), 0.0, flying=flying)
        started = time.perf_counter()
        for order in orders:
            motion = vehicle.step(motion, order, around, STEP_S)
            vehicle.estimate(motion.body, around)
        best = min(best, (time.perf_counter() - started) / STEPS)
    return best


def main() -> None:
    """Print the table."""
    table = Table(title=f"dynamics, one vehicle, steps of {1000 * STEP_S:g} ms")
    for name in (
        "vehicle",
        "us a step",
        "simulated s per s",
        f"share of the budget at {ASKED_VEHICLE_S_PER_S:g}/s",
    ):
        table.add_column(name, justify="right")
    vehicles: tuple[tuple[str, Vehicle], ...] = (
        ("px4", px4_quadrotor()),
        ("arducopter", arducopter_quadrotor()),
        ("rover", rover()),
    )
    for name, vehicle in vehicles:
        each_s = seconds_a_step(vehicle, flying=name != "rover")
        speed = STEP_S / each_s
        table.add_row(
            name,
            f"{1e6 * each_s:.1f}",
            f"{speed:.0f}",
            f"{100.0 * ASKED_VEHICLE_S_PER_S / speed:.0f} %",
        )
    Console().print(table)


if __name__ == "__main__":
    main()
