"""Speed of guidance.game, as ratios in one run: `python tests/bench/bench_game.py [--quick]`.

Printed: every kind of game on one state, against a plain scalar Python version of the paper's law, and in a batch,
against plain NumPy and memory bandwidth; 1,000 states against plain NumPy that gives a caller the same outputs, and
against one that gives three of them; a capture radius of zeros against none; rollouts with stand-off or wind against
those without; teams and matchings against their pairs; and 100,000 closed-loop games of 1,000 steps in one process,
with its peak memory.
"""

import argparse
import math
import resource
import sys
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from guidance.game import Ball, Cylinder, Exact, Extent, Game, StandOff, rollout, solve
from guidance.game.team import match_teams, solve_team

GAME = Game(Ball(2.0), 1.0)
VEHICLE = Game(Cylinder(12.0, 3.0, 1.5), 3.0, standoff=StandOff(3.0, 5.0), capture_radius_m=0.2)
P = np.array([8.0, 1.42, 9.41])
E = np.array([7.92, 9.6, 0.0])
T = np.zeros(3)


def scalar_pe(game: Game, pursuer, evader, seen):
    """The PE law of `solve` in plain Python: same parameters, checks, degenerate states and answer."""
    px, py, pz = pursuer
    ex, ey, ez = evader
    u = game.pursuer.speed_m_s
    v = game.evader_speed_m_s
    capture = game.capture_radius_m
    radius = game.standoff.radius_m
    age = game.information_age_s
    (wind_x, wind_y) = game.wind_m_s
    total = px + py + pz + ex + ey + ez + seen[0] + seen[1]
    if total - total != 0:
        raise ValueError("not finite")
    dx = ex - px
    dy = ey - py
    z = pz - ez - game.standoff.height_m
    seen_x, seen_y = seen
    fast = math.sqrt(seen_x * seen_x + seen_y * seen_y)
    if fast > v:
        seen_x = seen_x * v / fast
        seen_y = seen_y * v / fast
    d = math.sqrt(dx * dx + dy * dy)
    nx, ny = (dx / d, dy / d) if d > 0 else (1.0, 0.0)
    gap = d + v * age - radius
    above = (abs(z) - capture) / u
    t = above
    if gap + v * above > 0:
        hand = u * u - v * v
        cross = u * gap - v * capture
        t = (v * gap - u * capture + math.sqrt(cross * cross + hand * z * z)) / hand
    t = max(t, 0.0)
    run = v * (t + age)
    meeting = (ex + run * nx, ey + run * ny, ez)
    evader_velocity = (v * nx, v * ny, 0.0)
    if t <= 0:
        return 1, t, math.inf, meeting, t, (seen_x, seen_y, 0.0), evader_velocity, 1
    if d <= 0 and gap + v * t > 0:
        rest = math.sqrt(u * u - seen_x * seen_x - seen_y * seen_y)
        vertical = -rest if z > 0 else rest
        return (
            1,
            t,
            math.inf,
            meeting,
            t,
            (seen_x + wind_x, seen_y + wind_y, vertical),
            evader_velocity,
            2,
        )
    mx = meeting[0] - px - wind_x * t
    my = meeting[1] - py - wind_y * t
    length = math.sqrt(mx * mx + my * my)
    reach = max(length - radius, 0.0)
    rate = u / math.sqrt(reach * reach + z * z)
    share = reach * rate / length if length > 0 else 0.0
    velocity = (mx * share + wind_x, my * share + wind_y, -z * rate)
    return 1, t, math.inf, meeting, t, velocity, evader_velocity, 0


def scalar_tad(u: float, v: float, pursuer, evader, target):
    """The paper's TAD law in plain Python, on both sides of the barrier; without the extensions of `solve`."""
    px, py, pz = pursuer
    ex, ey, ez = evader
    tx = target[0]
    ty = target[1]
    total = px + py + pz + ex + ey + ez + tx + ty
    if total - total != 0:
        raise ValueError("not finite")
    z = pz - ez
    gx = tx - ex
    gy = ty - ey
    far = math.sqrt(gx * gx + gy * gy)
    qx = tx - px
    qy = ty - py
    reach = math.sqrt(qx * qx + qy * qy + z * z)
    arrival = far / v
    guard = reach / u
    margin = arrival - guard
    if margin < 0:
        run_x = gx
        run_y = gy
        t = arrival
        value = reach - u * arrival
        winner = -1
    else:
        ratio = u / v
        hand = ratio * ratio - 1.0
        dx = ex - px
        dy = ey - py
        cx = dx / hand
        cy = dy / hand
        r = math.sqrt(z * z * hand + ratio * ratio * (dx * dx + dy * dy)) / hand
        ox = gx - cx
        oy = gy - cy
        out = math.sqrt(ox * ox + oy * oy)
        run_x = cx + r * ox / out
        run_y = cy + r * oy / out
        t = math.sqrt(run_x * run_x + run_y * run_y) / v
        value = math.sqrt((gx - run_x) ** 2 + (gy - run_y) ** 2)
        winner = 1
    mx = ex + run_x - px
    my = ey + run_y - py
    pace = u / math.sqrt(mx * mx + my * my + z * z)
    length = math.sqrt(run_x * run_x + run_y * run_y)
    evader_velocity = (v * run_x / length, v * run_y / length, 0.0)
    return (
        winner,
        value,
        margin,
        (ex + run_x, ey + run_y, ez),
        t,
        (mx * pace, my * pace, -z * pace),
        evader_velocity,
        0,
    )


def per_call_s(call: Callable[[], object], *, least_s: float = 0.4, rounds: int = 9) -> float:
    """Processor time of one call, the best of several rounds, to exclude other load on the machine."""
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


QUAD = ((0.0, 0.0), (15.0, 0.0), (18.0, 12.0), (4.0, 14.0))
KINDS = {
    "paper": (GAME, 10.0, 5.0),
    "capture radius": (Game(Ball(2.0), 1.0, capture_radius_m=1.5), 0.8, 0.8),
    "capture radius of zeros": (Game(Ball(2.0), 1.0), 10.0, 5.0),
    "stand-off": (Game(Ball(2.0), 1.0, standoff=StandOff(3.0, 2.0)), 0.8, 0.8),
    "stand-off and age": (Game(Ball(2.0), 1.0, standoff=StandOff(3.0, 2.0), information_age_s=0.5), 0.8, 0.8),
    "age beyond the guarantee": (Game(Ball(2.0), 1.0, information_age_s=1.0), 0.8, 0.8),
    "wind": (Game(Ball(2.0), 1.0, wind_m_s=(0.3, -0.4)), 0.8, 0.8),
    "moving target": (Game(Ball(2.0), 1.0, target_velocity_m_s=(0.3, 0.2)), 0.8, 0.8),
    "everything": (
        Game(Ball(2.0), 1.0, 0.2, StandOff(3.0, 2.0), information_age_s=0.5, wind_m_s=(0.3, -0.4)), 0.8, 0.8
    ),
    "cylinder": (Game(Cylinder(12.0, 3.0, 1.5), 3.0), 0.8, 0.8),
    "cylinder and stand-off": (VEHICLE, 0.8, 0.8),
    "target: a disc": (replace(GAME, target_extent=Extent(radius_m=6.0)), 10.0, 2.0),
    "target: a polygon": (replace(GAME, target_extent=Extent(QUAD)), 10.0, 2.0),
    "vehicle, target: a polygon": (replace(VEHICLE, target_extent=Extent(QUAD)), 0.8, 0.2),
}  # fmt: skip
"""The games that are timed, with the required million states a second of PE and TAD."""


def met(good: bool) -> str:
    return "met" if good else "NOT MET"


def bench_tick() -> None:
    """One state at a time."""
    p = tuple(P.tolist())
    e = tuple(E.tolist())
    t = tuple(T.tolist())
    still = (0.0, 0.0)
    scalars = {
        "PE": per_call_s(lambda: scalar_pe(GAME, p, e, still)),
        "TAD": per_call_s(lambda: scalar_tad(2.0, 1.0, p, e, t)),
    }
    print(
        "one state, processor time; required of the paper's game 30 µs (PE) and 45 µs (TAD), of the others 150 µs "
        "(200 µs with a shape)"
    )
    print(
        "  "
        + ", ".join(
            f"plain scalar Python, {kind}: {took * 1e6:.2f} µs" for kind, took in scalars.items()
        )
    )
    for name, (game, _, _) in KINDS.items():
        for kind, players in (("PE", (P, E)), ("TAD", (P, E, T))):
            took = per_call_s(lambda game=game, players=players: solve(game, *players))
            limit = {"PE": 30e-6, "TAD": 45e-6}[kind] if game is GAME else 150e-6
            if not game.target_extent.is_point:
                limit = 200e-6
            print(
                f"  {name:26} {kind:4} {took * 1e6:8.1f} µs {took / scalars[kind]:7.1f} × scalar: {met(took <= limit)}"
            )


def plain_pe(p, e):
    """The paper's PE value and both players' velocities in plain NumPy, whole arrays at a time, nothing checked."""
    away = e[:, :2] - p[:, :2]
    d = np.hypot(away[:, 0], away[:, 1])
    z = p[:, 2]
    t = (d + np.sqrt(3.0 * z * z + 4.0 * d * d)) / 3.0
    n = away / d[:, None]
    to = np.concatenate([away + t[:, None] * n, -z[:, None]], axis=1)
    return t, 2.0 * to / np.linalg.norm(to, axis=1, keepdims=True), n


def plain_tad(p, e, goal):
    """The paper's TAD value and velocities in plain NumPy, as it writes them, nothing checked."""
    c = (4.0 * e[:, :2] - p[:, :2]) / 3.0 - goal[:, :2]
    away = e[:, :2] - p[:, :2]
    z = p[:, 2]
    r = np.sqrt(z * z / 3.0 + 4.0 * (away * away).sum(axis=1) / 9.0)
    far = np.linalg.norm(c, axis=1)
    g = goal[:, :2] + c * (1.0 - r / far)[:, None]
    to = np.concatenate([g - p[:, :2], -z[:, None]], axis=1)
    run = g - e[:, :2]
    pace = np.linalg.norm(run, axis=1, keepdims=True)
    return far - r, 2.0 * to / np.linalg.norm(to, axis=1, keepdims=True), run / pace


def whole_pe(p, e):
    """All eight outputs of `solve` in plain NumPy, for the paper's PE; nothing checked, degenerate states left out."""
    count = len(p)
    time_s, pursuer_velocity, n = plain_pe(p, e)
    meeting = e.copy()
    meeting[:, :2] += time_s[:, None] * n
    evader_velocity = np.zeros((count, 3))
    evader_velocity[:, :2] = n
    winner = np.ones(count, np.int8)
    margin = np.full(count, np.inf)
    reason = np.zeros(count, np.int8)
    return winner, time_s, margin, meeting, time_s.copy(), pursuer_velocity, evader_velocity, reason


def whole_tad(p, e, goal):
    """All eight outputs of `solve` in plain NumPy, for the paper's TAD on both sides of the barrier."""
    c = (4.0 * e[:, :2] - p[:, :2]) / 3.0 - goal[:, :2]
    away = e[:, :2] - p[:, :2]
    z = p[:, 2]
    r = np.sqrt(z * z / 3.0 + 4.0 * (away * away).sum(axis=1) / 9.0)
    far = np.linalg.norm(c, axis=1)
    margin = np.linalg.norm(goal - e, axis=1) - np.linalg.norm(p - goal, axis=1) / 2.0
    won = margin > 0.0
    closest = goal[:, :2] + c * (1.0 - r / far)[:, None]
    meeting = e.copy()
    meeting[:, :2] = np.where(won[:, None], closest, goal[:, :2])
    to = meeting - p
    run = meeting - e
    time_s = np.linalg.norm(run, axis=1)
    value = np.where(won, far - r, -2.0 * margin)
    pursuer_velocity = 2.0 * to / np.linalg.norm(to, axis=1, keepdims=True)
    reason = np.zeros(len(p), np.int8)
    winner = np.sign(margin).astype(np.int8)
    return (
        winner,
        value,
        margin,
        meeting,
        time_s,
        pursuer_velocity,
        run / time_s[:, None],
        reason,
    )


def undisturbed_s(
    calls: dict[str, Callable[[], object]], *, rounds: int = 150, inner: int = 20
) -> dict[str, float]:
    """Processor time of one call of each, in turns: the median of the fastest fifth, to exclude other load."""
    took = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            for _ in range(inner):
                started = time.thread_time_ns()
                call()
                took[name].append(time.thread_time_ns() - started)
    return {
        name: 1e-9 * np.median(sorted(times)[: len(times) // 5]) for name, times in took.items()
    }


def bench_short(count: int) -> None:
    """A short batch beside plain NumPy that gives a caller the same outputs, and one that gives three of the eight."""
    rng = np.random.default_rng(0)
    states = rng.uniform(-30.0, 30.0, (3, count, 3))
    states[1:, :, 2] = 0.0
    print(f"batch of {count:,} states, the paper's game; plain NumPy checks nothing")
    for kind, players, plain, eight_outputs in (
        ("PE", states[:2], plain_pe, whole_pe),
        ("TAD", states, plain_tad, whole_tad),
    ):
        answer = solve(GAME, *players)
        for field, expected in zip(answer, eight_outputs(*players), strict=True):
            np.testing.assert_allclose(field, expected, rtol=1e-9, atol=1e-9)
        took = undisturbed_s(
            {
                "solve": lambda players=players: solve(GAME, *players),
                "filled again": lambda players=players, answer=answer: solve(
                    GAME, *players, out=answer
                ),
                "same": lambda players=players, eight_outputs=eight_outputs: eight_outputs(
                    *players
                ),
                "three": lambda players=players, plain=plain: plain(*players),
            }
        )
        same = took["same"] / took["solve"]
        print(
            f"  {kind:4} {took['solve'] * 1e6:6.1f} µs; plain NumPy with the same eight outputs "
            f"{took['same'] * 1e6:6.1f} µs: {same:.2f} × its speed; required 1: {met(same >= 1.0)}"
        )
        print(
            f"       with `out` {took['filled again'] * 1e6:6.1f} µs; plain NumPy with three outputs "
            f"{took['three'] * 1e6:6.1f} µs: {took['three'] / took['solve']:.2f} × its speed, "
            f"with `out` {took['three'] / took['filled again']:.2f} ×"
        )


def bench_batch(count: int) -> None:
    """Many states at a time, on one core."""
    rng = np.random.default_rng(0)
    states = rng.uniform(-30.0, 30.0, (3, count, 3))
    states[1:, :, 2] = 0.0
    source = np.ones(count * 8)
    sink = np.empty(count * 8)
    copied = 2 * source.nbytes / per_call_s(lambda: np.copyto(sink, source))
    plain = {
        "PE": count / per_call_s(lambda: plain_pe(*states[:2]), rounds=3) / 1e6,
        "TAD": count / per_call_s(lambda: plain_tad(*states), rounds=3) / 1e6,
    }
    print(
        f"batch of {count:,} states, one core; np.copyto moves {copied / 1e9:.1f} GB/s; million states a second"
    )
    print(
        f"  plain NumPy, the paper's formulas without a check: PE {plain['PE']:.2f}, TAD {plain['TAD']:.2f}"
    )
    for name, (kind_of_game, least_pe, least_tad) in KINDS.items():
        game = kind_of_game
        if "zeros" in name:
            game = replace(game, capture_radius_m=np.zeros(count))
        for kind, players, least in (("PE", states[:2], least_pe), ("TAD", states, least_tad)):
            answer = solve(game, *players)
            moved = sum(array.nbytes for array in players) + sum(field.nbytes for field in answer)
            took = per_call_s(
                lambda game=game, players=players, out=answer: solve(game, *players, out=out),
                rounds=3,
            )
            rate = count / took / 1e6
            print(
                f"  {name:26} {kind:4} {rate:6.2f}, {rate / plain[kind]:5.2f} × plain, "
                f"{100 * moved / took / copied:4.1f} % of copyto; required {least:g}: {met(rate >= least)}"
            )


def bench_zeros(count: int) -> None:
    """A capture radius of zeros as an array, compared with none."""
    rng = np.random.default_rng(4)
    states = rng.uniform(-30.0, 30.0, (3, count, 3))
    states[1:, :, 2] = 0.0
    games = {"none": GAME, "zeros": replace(GAME, capture_radius_m=np.zeros(count))}
    for kind, players in (("PE", states[:2]), ("TAD", states)):
        answer = solve(GAME, *players)
        took = dict.fromkeys(games, math.inf)
        for _ in range(30):  # in turns
            for name, game in games.items():
                started = time.process_time()
                solve(game, *players, out=answer)
                took[name] = min(took[name], time.process_time() - started)
        ratio = took["zeros"] / took["none"]
        print(
            f"capture radius of {count:,} zeros, {kind}: {ratio:.3f} × none; required 1.03: {met(ratio <= 1.03)}"
        )


def bench_rollout(games: int, steps: int, chunk: int) -> None:
    """Closed-loop games in chunks: as many steps for each, both players optimal, memory that of one chunk."""
    rng = np.random.default_rng(1)
    step_s = 0.01
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    started = time.process_time()
    taken = 0
    for start in range(0, games, chunk):
        size = min(chunk, games - start)
        pursuer, evader = rng.uniform(-30.0, 30.0, (2, size, 3))
        pursuer[:, 2] = rng.uniform(40.0, 60.0, size)
        evader[:, 2] = 0.0
        end = rollout(
            GAME, pursuer, evader, stepping=Exact(step_s=step_s, order=1), duration_s=steps * step_s
        )
        taken += round(float(end.time_s.sum()) / step_s)
    took = time.process_time() - started
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(f"{games:,} closed-loop games of {steps:,} steps in chunks of {chunk:,}, one process")
    print(
        f"  {games / took:,.0f} games/s, {taken / took / 1e6:.2f} million steps/s, {took:.1f} s of processor time"
    )
    print(
        f"  peak memory {peak / 1024:.0f} MiB, of which {(peak - before) / 1024:.0f} MiB since the start of this part"
    )


def bench_standoff(games: int) -> None:
    """Rollouts of TAD games with stand-off and with wind beside those of plain ones."""
    rng = np.random.default_rng(2)
    pursuer, evader, target = rng.uniform(-30.0, 30.0, (3, games, 3))
    pursuer[:, 2] = 20.0
    evader[:, 2] = 0.0
    target[:, 2] = 0.0
    took = dict.fromkeys(("paper", "stand-off", "wind"), math.inf)
    for _ in range(15):  # in turns, so that other load slows all of them equally
        for name in took:
            started = time.process_time()
            rollout(
                KINDS[name][0],
                pursuer,
                evader,
                target,
                stepping=Exact(step_s=0.05, order=1),
                duration_s=5.0,
            )
            took[name] = min(took[name], time.process_time() - started)
    for name in ("stand-off", "wind"):
        ratio = took[name] / took["paper"]
        print(
            f"rollouts of {games:,} TAD games: {name} {ratio:.2f} × without; required 3: {met(ratio <= 3.0)}"
        )


def bench_teams(count: int) -> None:
    """Teams and matchings of a batch, compared with all pairs alone, which they solve first."""
    rng = np.random.default_rng(3)
    print(f"teams, {count:,} states in a batch, one core, beside all pairs by themselves")
    for n, m in ((2, 1), (3, 1), (8, 1), (3, 3), (8, 8)):
        rows = max(count // (n * m), 1)
        pursuers, evaders, targets = (rng.uniform(-30.0, 30.0, (rows, k, 3)) for k in (n, m, m))
        evaders[..., 2] = targets[..., 2] = 0.0
        for kind, goal in (("PE", None), ("TAD", targets)):
            pairs = (
                pursuers[:, :, None],
                evaders[:, None],
                *([] if goal is None else [goal[:, None]]),
            )
            if m == 1:
                evader = (evaders[:, 0], *([] if goal is None else [goal[:, 0]]))
                play = lambda pursuers=pursuers, evader=evader: solve_team(GAME, pursuers, *evader)  # noqa: E731
            else:
                many = (evaders, *([] if goal is None else [goal]))
                play = lambda pursuers=pursuers, many=many: match_teams(GAME, pursuers, *many)  # noqa: E731
            took = alone = math.inf
            for _ in range(5):  # in turns
                started = time.process_time()
                solve(GAME, *pairs)
                between = time.process_time()
                play()
                alone = min(alone, between - started)
                took = min(took, time.process_time() - between)
            print(
                f"  {n} against {m} {kind:4} {rows / took:12,.0f} states/s, {rows * n * m / took / 1e6:.2f} M pairs/s, "
                f"{took / alone:5.1f} × the pairs alone"
            )


def bench_match() -> None:
    """One match of six pursuers and four evaders."""
    rng = np.random.default_rng(5)
    pursuers = rng.uniform(-30.0, 30.0, (6, 3))
    evaders = rng.uniform(-30.0, 30.0, (4, 3))
    evaders[:, 2] = 0.0
    for kind, goal in (("PE", ()), ("TAD", (T,))):
        took = per_call_s(lambda goal=goal: match_teams(GAME, pursuers, evaders, *goal))
        print(
            f"one match of 6 against 4, {kind}: {took * 1e3:.2f} ms; required 1: {met(took <= 1e-3)}"
        )


def main() -> None:
    """Run all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a tenth of the work")
    parser.add_argument("--chunk", type=int, default=2500)
    arguments = parser.parse_args()
    share = 10 if arguments.quick else 1
    print(f"NumPy {np.__version__}, Python {sys.version.split()[0]}")
    bench_rollout(100_000 // share, 1_000, arguments.chunk)
    bench_standoff(2000)
    bench_tick()
    bench_short(1000)
    bench_batch(1_000_000 // share)
    bench_zeros(1_000_000 // share)
    bench_teams(100_000 // share)
    bench_match()


if __name__ == "__main__":
    main()
