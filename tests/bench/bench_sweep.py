"""Speed of sweeps, as numbers side by side of one run: `python tests/bench/bench_sweep.py [--quick] [--million]`.

Printed: games a second of a maths sweep on one core, and what of that is building and checking the scenarios; maths
sweeps with wind against those without; flights a second on one core and with two workers; our executor against a bare
pool of processes for the same chunks; and with --million one million games end to end: wall time, peak memory of this
process and of its largest worker, size on disk, report.
"""

import argparse
import contextlib
import gc
import io
import multiprocessing
import resource
import shutil
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import psutil

from guidance.sim.maths import play
from guidance.sweeps.chunk import as_table, computed, rows_of, table_of
from guidance.sweeps.executors import executor
from guidance.sweeps.report import write_report
from guidance.sweeps.row_scenarios import Scenarios
from guidance.sweeps.running import planned, run_sweep

GAMES = """
title = "Short chases"
scenario = "hover_chase"
seeds = SEEDS
policies = [{ pursuer = PURSUERS, evader = "optimal" }]
[random]
"evader.position_m" = { annulus = [6, 20] }
"evader.speed_m_s" = { uniform = [1.0, 3.0] }
"pursuer.position_m[2]" = { uniform = [5.0, 15.0] }
"""

TARGETS = """
scenario = "tad"
seeds = SEEDS
policies = [{ pursuer = PURSUERS, evader = "optimal" }]
[random]
"evader.position_m" = { annulus = [20, 40] }
"evader.speed_m_s" = { uniform = [1.0, 2.0] }
"""

WINDS = {
    "calm": "",
    "one wind": '[grid]\n"wind.velocity_m_s" = [[0.4, -0.3]]\n',
    "a wind for each game": """
"wind.velocity_m_s[0]" = { uniform = [-0.5, 0.5] }
"wind.velocity_m_s[1]" = { uniform = [-0.5, 0.5] }
""",
}

FLIGHTS = """
scenario = "hover_chase"
as = "fast"
seeds = SEEDS
[random]
"evader.position_m" = { annulus = [20, 30] }
"""


def planned_from(text, folder, seeds, pursuers='"optimal"'):
    """Lay out a sweep of a text."""
    path = folder / f"{seeds}.toml"
    path.write_text(text.replace("SEEDS", str(seeds)).replace("PURSUERS", pursuers), encoding="utf-8")
    return planned(str(path)), path


def processor_s():
    """Processor time of this process and of its children that have ended."""
    return sum(
        usage.ru_utime + usage.ru_stime
        for usage in map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    )


def bench_maths(folder, rows):
    """One core, in this process."""
    plan, _ = planned_from(GAMES, folder, rows)
    numbers = np.arange(rows, dtype=np.int64)
    cases = plan.cases(numbers)
    started = time.process_time()
    computed(plan, range(rows))
    whole = time.process_time() - started
    gc.disable()  # as in a chunk
    started = time.process_time()
    scenarios = list(Scenarios(plan).of(cases))
    built = time.process_time()
    outcomes = play(scenarios)
    played = time.process_time()
    as_table(plan, cases, outcomes)
    put = time.process_time()
    gc.enable()
    lasted = sum(outcome.game_time_s for outcome in outcomes) / rows
    print(f"a maths sweep of {rows:,} games of {lasted:.1f} s on average, in one chunk, one core")
    print(f"  {rows / whole:8,.0f} games/s, {rows * lasted / 0.02 / whole / 1e6:.2f} million cycles/s")
    print(f"  {(built - started) / rows * 1e6:8.1f} µs a game to build and check its scenario")
    print(f"  {(played - built) / rows * 1e6:8.1f} µs a game to play it")
    print(f"  {(put - played) / rows * 1e6:8.1f} µs a game to put it into a table")


def bench_wind(folder, rows):
    """Sweeps with wind beside those without, in turns, one core, in this process."""
    for game, text in (("PE", GAMES), ("TAD", TARGETS)):
        plans = {}
        for wind, more in WINDS.items():
            inside = folder / f"{game} {wind}"
            inside.mkdir()
            plans[wind] = planned_from(text.rstrip() + "\n" + more, inside, rows)[0]
        took = dict.fromkeys(plans, np.inf)
        for _ in range(2):
            for wind, plan in plans.items():
                started = time.process_time()
                computed(plan, range(rows))
                took[wind] = min(took[wind], time.process_time() - started)
        print(f"maths sweeps of {rows:,} {game} games: {rows / took['calm']:,.0f} games/s without wind")
        for wind in list(plans)[1:]:
            ratio = took[wind] / took["calm"]
            good = "met" if ratio <= 3.0 else "NOT MET"
            print(f"  {wind:20} {rows / took[wind]:8,.0f} games/s, {ratio:.2f} × without; required 3: {good}")


def bench_flights(folder, flights):
    """Flights on one core, and on two workers."""
    plan, _ = planned_from(FLIGHTS, folder, flights)
    started = time.perf_counter(), time.process_time()
    table = table_of(plan, range(flights))
    wall, cpu = time.perf_counter() - started[0], time.process_time() - started[1]
    flown = sum(table["duration_s"].to_pylist())
    print(f"a fast sweep of {flights} flights of {flown / flights:.0f} s on average")
    print(f"  {flights / cpu:8.3f} flights/s of processor time on one core, {flown / cpu:.1f} × real time")
    with executor(2, None) as working:
        chunks = [(chunk, rows_of(plan, chunk, 1)) for chunk in range(flights)]
        list(working.work(plan, chunks[:2]))  # the workers have imported what they need
        began = time.perf_counter()
        list(working.work(plan, chunks[2:]))
        two = (time.perf_counter() - began) / (flights - 2)
    print(
        f"  {flights / wall:8.3f} flights/s of wall time alone, {1 / two:.3f} with two workers: "
        f"{wall / flights / two:.2f} times as fast"
    )


def bench_executor(folder, rows, size):
    """The same chunks by our executor and by a bare pool of processes, in turns; starting them is not counted."""
    plan, _ = planned_from(GAMES, folder, rows)
    chunks = [(chunk, rows_of(plan, chunk, size)) for chunk in range(-(-rows // size))]
    spawn = multiprocessing.get_context("spawn")
    with executor(2, None) as working, ProcessPoolExecutor(2, mp_context=spawn) as pool:
        list(working.work(plan, chunks[:2]))
        list(pool.map(computed, [plan] * 2, [numbers for _, numbers in chunks[:2]]))
        took = {"executor": [], "pool": []}
        for _ in range(5):
            began = clocks_s()
            by_executor = {done.chunk: done.content for done in working.work(plan, chunks)}
            took["executor"].append(clocks_s() - began)
            began = clocks_s()
            by_pool = list(pool.map(computed, [plan] * len(chunks), [numbers for _, numbers in chunks]))
            took["pool"].append(clocks_s() - began)
    same = [by_executor[chunk] for chunk, _ in chunks] == by_pool
    ours, plain = (np.min(took[name], axis=0) for name in ("executor", "pool"))
    print(f"{rows:,} games in {len(chunks)} chunks by two workers, the best of five; the same bytes: {same}")
    for name, a, b in zip(("wall time", "processor time"), ours, plain, strict=True):
        more = f"{a / b:.3f} ×, {(a - b) / len(chunks) * 1e3:+.1f} ms a chunk"
        print(f"  {a:8.2f} s of {name} by our executor, {b:.2f} s by a bare pool: {more}")


def clocks_s():
    """Wall time, and processor time of this process and of its living children."""
    me = psutil.Process()
    times = [one.cpu_times() for one in (me, *me.children(recursive=True))]
    return np.array([time.perf_counter(), sum(one.user + one.system for one in times)])


def bench_end_to_end(folder, rows):
    """From the file to the report."""
    _, path = planned_from(GAMES, folder, rows // 2, '["optimal", "pure_pursuit"]')
    out = folder / "out"
    began, used = time.perf_counter(), processor_s()
    run_sweep(str(path), way=None, workers=2, scheduler=None, out=out, chunk=None)
    swept, used = time.perf_counter() - began, processor_s() - used
    kept = sum(part.stat().st_size for part in out.glob("rows/*.parquet"))
    parts = len(list(out.glob("rows/*.parquet")))
    here = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    worker = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    began = time.perf_counter()
    with contextlib.redirect_stdout(io.StringIO()):
        write_report(out, folder / "report", worst=3)
    told = time.perf_counter() - began
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{rows:,} games end to end, two workers")
    print(f"  {swept:8.1f} s, {rows / swept:,.0f} games/s of wall time")
    print(f"  {used:8.1f} s of processor time in all, {rows / used:,.0f} games/s of it")
    print(f"  {here:8.0f} MiB peak of the sweep's process, {worker:.0f} MiB of its largest worker")
    print(f"  {kept / 2**20:8.1f} MiB in {parts} files, {kept / rows:.0f} bytes a game")
    print(f"  {told:8.1f} s for the report, {after:.0f} MiB peak with it")


def main():
    """Run them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a tenth of the work")
    parser.add_argument("--million", action="store_true", help="one million games end to end, and nothing else")
    given = parser.parse_args()
    share = 10 if given.quick else 1
    print(f"NumPy {np.__version__}, Python {sys.version.split()[0]}")
    folder = Path(tempfile.mkdtemp())
    try:
        if given.million:
            bench_end_to_end(folder, 1_000_000 // share)
            return
        bench_maths(folder, 16384 // share)
        bench_wind(folder, 400 // share)
        bench_executor(folder, 65536 // share, 4096 // share)
        bench_executor(folder, 2048 // share, 16)  # chunks too small for any use: what one costs to hand out
        bench_flights(folder, max(4, 20 // share))
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
