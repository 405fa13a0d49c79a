"""Speed of guidance.game, as ratios in one run: `python tests/bench/bench_game.py [--quick]`.

Printed: one tick on one state against a plain scalar Python version of the same law; the batch against the same version
and against memory bandwidth; and 100,000 closed-loop games of 1,000 steps in one process, with its peak memory.
"""

import argparse
import math
import resource
import sys
import time
from collections.abc import Callable

import numpy as np

from guidance.game import Ball, Cylinder, Exact, Game, StandOff, rollout, solve
from guidance.game.solution import ROWS

GAME = Game(Ball(2.0), 1.0)
VEHICLE = Game(Cylinder(12.0, 3.0, 1.5), 3.0, standoff=StandOff(3.0, 5.0), capture_radius_m=0.2)
P, E, T = np.array([8.0, 1.42, 9.41]), np.array([7.92, 9.6, 0.0]), np.zeros(3)


def scalar_pe(game: Game, pursuer, evader, seen):
    """The PE law of `solve` in plain Python: same parameters, checks, degenerate states and answer."""
    px, py, pz = pursuer
    ex, ey, ez = evader
    u, v, capture = game.pursuer.speed_m_s, game.evader_speed_m_s, game.capture_radius_m
    radius, age, (wind_x, wind_y) = game.standoff.radius_m, game.information_age_s, game.wind_m_s
    total = px + py + pz + ex + ey + ez + seen[0] + seen[1]
    if total - total != 0:
        raise ValueError("not finite")
    dx, dy, z = ex - px, ey - py, pz - ez - game.standoff.height_m
    seen_x, seen_y = seen
    fast = math.sqrt(seen_x * seen_x + seen_y * seen_y)
    if fast > v:
        seen_x, seen_y = seen_x * v / fast, seen_y * v / fast
    d = math.sqrt(dx * dx + dy * dy)
    nx, ny = (dx / d, dy / d) if d > 0 else (1.0, 0.0)
    gap = d + v * age - radius
    above = (abs(z) - capture) / u
    t = above
    if gap + v * above > 0:
        hand, cross = u * u - v * v, u * gap - v * capture
        t = (v * gap - u * capture + math.sqrt(cross * cross + hand * z * z)) / hand
    t = max(t, 0.0)
    run = v * (t + age)
    meeting, evader_velocity = (ex + run * nx, ey + run * ny, ez), (v * nx, v * ny, 0.0)
    if t <= 0:
        return 1, t, math.inf, meeting, t, (seen_x, seen_y, 0.0), evader_velocity, 1
    if d <= 0 and gap + v * t > 0:
        rest = math.sqrt(u * u - seen_x * seen_x - seen_y * seen_y)
        vertical = -rest if z > 0 else rest
        return 1, t, math.inf, meeting, t, (seen_x + wind_x, seen_y + wind_y, vertical), evader_velocity, 2
    mx, my = meeting[0] - px - wind_x * t, meeting[1] - py - wind_y * t
    length = math.sqrt(mx * mx + my * my)
    reach = max(length - radius, 0.0)
    rate = u / math.sqrt(reach * reach + z * z)
    share = reach * rate / length if length > 0 else 0.0
    velocity = (mx * share + wind_x, my * share + wind_y, -z * rate)
    return 1, t, math.inf, meeting, t, velocity, evader_velocity, 0


def scalar_tad(u: float, v: float, pursuer, evader, target):
    """The paper's TAD law in plain Python, on both sides of the barrier; it knows nothing else, unlike `solve`."""
    px, py, pz = pursuer
    ex, ey, ez = evader
    tx, ty = target[0], target[1]
    total = px + py + pz + ex + ey + ez + tx + ty
    if total - total != 0:
        raise ValueError("not finite")
    z = pz - ez
    gx, gy = tx - ex, ty - ey
    far = math.sqrt(gx * gx + gy * gy)
    qx, qy = tx - px, ty - py
    reach = math.sqrt(qx * qx + qy * qy + z * z)
    arrival, guard = far / v, reach / u
    margin = arrival - guard
    if margin < 0:
        run_x, run_y, t, value, winner = gx, gy, arrival, reach - u * arrival, -1
    else:
        ratio = u / v
        hand = ratio * ratio - 1.0
        dx, dy = ex - px, ey - py
        cx, cy = dx / hand, dy / hand
        r = math.sqrt(z * z * hand + ratio * ratio * (dx * dx + dy * dy)) / hand
        ox, oy = gx - cx, gy - cy
        out = math.sqrt(ox * ox + oy * oy)
        run_x, run_y = cx + r * ox / out, cy + r * oy / out
        t = math.sqrt(run_x * run_x + run_y * run_y) / v
        value, winner = math.sqrt((gx - run_x) ** 2 + (gy - run_y) ** 2), 1
    mx, my = ex + run_x - px, ey + run_y - py
    pace = u / math.sqrt(mx * mx + my * my + z * z)
    length = math.sqrt(run_x * run_x + run_y * run_y)
    evader_velocity = (v * run_x / length, v * run_y / length, 0.0)
    return winner, value, margin, (ex + run_x, ey + run_y, ez), t, (mx * pace, my * pace, -z * pace), evader_velocity, 0


def per_call_s(call: Callable[[], object], *, least_s: float = 0.4, rounds: int = 9) -> float:
    """Processor time of one call, the best of some rounds: what it takes while nobody else uses the machine."""
    count = 1
    while True:
        started = time.process_time()
        for _ in range(count):
            call()
        if time.process_time() - started > least_s / rounds:
            break
        count *= 2
    times = []
    for _ in range(rounds):
        started = time.process_time()
        for _ in range(count):
            call()
        times.append((time.process_time() - started) / count)
    return min(times)


def bench_tick() -> None:
    """One state at a time."""
    p, e, t, still = tuple(P.tolist()), tuple(E.tolist()), tuple(T.tolist()), (0.0, 0.0)
    seen = np.array([0.3, 0.9, 0.0])
    scalar = per_call_s(lambda: scalar_pe(GAME, p, e, still))
    rows = {
        "PE, paper's game": lambda: solve(GAME, P, E),
        "PE, with observed velocity": lambda: solve(GAME, P, E, evader_velocity_m_s=seen),
        "PE, stand-off on the cylinder": lambda: solve(VEHICLE, P, E, evader_velocity_m_s=seen),
        "TAD, paper's game": lambda: solve(GAME, P, E, T),
        "TAD, stand-off on the cylinder": lambda: solve(VEHICLE, P, E, T),
    }
    print("one tick on one state")
    print(f"  {'plain scalar Python, PE':32} {scalar * 1e6:9.2f} µs")
    print(f"  {'plain scalar Python, TAD':32} {per_call_s(lambda: scalar_tad(2.0, 1.0, p, e, t)) * 1e6:9.2f} µs")
    for name, call in rows.items():
        took = per_call_s(call)
        print(f"  {name:32} {took * 1e6:9.2f} µs   {took / scalar:7.1f} × the scalar PE")
    took = per_call_s(lambda: solve(GAME, P, E))
    print(f"  required of the first: at most 40 µs: {'met' if took <= 40e-6 else 'NOT MET'}")


def bench_batch(count: int) -> None:
    """Many states at a time, on one core."""
    rng = np.random.default_rng(0)
    states = rng.uniform(-30.0, 30.0, (3, count, 3))
    states[1:, :, 2] = 0.0
    source, sink = np.ones(count * 8), np.empty(count * 8)
    copied = 2 * source.nbytes / per_call_s(lambda: np.copyto(sink, source))
    print(f"batch of {count:,} states in chunks of {ROWS:,}, one core; np.copyto moves {copied / 1e9:.1f} GB/s")
    some = [[tuple(row) for row in array[:20000].tolist()] for array in states]
    scalars = {
        "PE": per_call_s(lambda: [scalar_pe(GAME, p, e, (0.0, 0.0)) for p, e in zip(*some[:2], strict=True)]) / 20000,
        "TAD": per_call_s(lambda: [scalar_tad(2.0, 1.0, p, e, t) for p, e, t in zip(*some, strict=True)]) / 20000,
    }
    for name, given in (("PE", states[:2]), ("TAD", states)):
        answer = solve(GAME, *given)
        moved = sum(array.nbytes for array in given) + sum(field.nbytes for field in answer)
        took = per_call_s(lambda given=given, answer=answer: solve(GAME, *given, out=answer), least_s=1.0)
        rate, scalar = count / took, 1.0 / scalars[name]
        print(
            f"  {name:4} {rate / 1e6:6.2f} million states/s, scalar {scalar / 1e6:5.3f}: {rate / scalar:5.1f} ×,",
            end=" ",
        )
        if name == "PE":
            print(f"required ≥ 30 ×: {'met' if rate / scalar >= 30 else 'NOT MET'};", end=" ")
        print(f"{moved / count:.0f} bytes a state, {100 * moved / took / copied:.1f} % of copyto")


def bench_rollout(games: int, steps: int, chunk: int) -> None:
    """Closed-loop games in chunks: as many steps for each, both players optimal, memory that of one chunk."""
    rng = np.random.default_rng(1)
    step_s = 0.01
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    started, taken = time.process_time(), 0
    for start in range(0, games, chunk):
        size = min(chunk, games - start)
        pursuer, evader = rng.uniform(-30.0, 30.0, (2, size, 3))
        pursuer[:, 2], evader[:, 2] = rng.uniform(40.0, 60.0, size), 0.0
        end = rollout(GAME, pursuer, evader, stepping=Exact(step_s=step_s, order=1), duration_s=steps * step_s)
        taken += round(float(end.time_s.sum()) / step_s)
    took = time.process_time() - started
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(f"{games:,} closed-loop games of {steps:,} steps in chunks of {chunk:,}, one process")
    print(f"  {games / took:,.0f} games/s, {taken / took / 1e6:.2f} million steps/s, {took:.1f} s of processor time")
    print(
        f"  peak memory {peak / 1024:.0f} MiB, of which {(peak - before) / 1024:.0f} MiB since the start of this part"
    )


def main() -> None:
    """Run all three."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a tenth of the work")
    parser.add_argument("--chunk", type=int, default=2500)
    given = parser.parse_args()
    share = 10 if given.quick else 1
    print(f"NumPy {np.__version__}, Python {sys.version.split()[0]}")
    bench_rollout(100_000 // share, 1_000, given.chunk)
    bench_tick()
    bench_batch(1_000_000 // share)


if __name__ == "__main__":
    main()
