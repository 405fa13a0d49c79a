"""Speed of sweeps: `python tests/bench/bench_sweep.py [--quick] [--million]`.

Prints: games per second of the sweep "policies" on one core, of each pair of policies; the shares of building scenarios
and of playing them; sweeps with wind against those without; flights per second on one core and with two workers; and
with --million one million games from the file to the report: wall time, peak memory of this process and of its largest
worker, size on disk.
"""

import argparse
import contextlib
import gc
import io
import resource
import shutil
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from guidance.config import find
from guidance.sim.maths import play_scenarios
from guidance.sweeps.folder import begin_or_continue
from guidance.sweeps.plan import SWEEP_FOLDER
from guidance.sweeps.report import write_sweep_report
from guidance.sweeps.rows import as_table, computed, planned, scenarios_of, table_of_rows
from guidance.sweeps.running import finish, run_sweep

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
    path.write_text(
        text.replace("SEEDS", str(seeds)).replace("PURSUERS", pursuers), encoding="utf-8"
    )
    return planned(str(path)), path


def processor_s():
    """Processor time of this process and of its children that have ended."""
    return sum(
        usage.ru_utime + usage.ru_stime
        for usage in map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    )


def bench_policies(folder, seeds):
    """The bundled sweep with other numbers of seeds, one core, in this process; each pair of policies is one chunk."""
    text = (
        find("policies", SWEEP_FOLDER)
        .read_text(encoding="utf-8")
        .replace("seeds = 1000", "seeds = SEEDS")
    )
    plan, _ = planned_from(text, folder, seeds)
    table_of_rows(plan, range(2))  # imports
    total = 0.0
    print(f'the sweep "policies" with {seeds:,} seeds, one core')
    for number, pair in enumerate(plan.pairs):
        started = time.process_time()
        computed(plan, range(number * seeds, (number + 1) * seeds))
        took = time.process_time() - started
        total += took
        print(f"  {seeds / took:8,.0f} games/s, {pair.pursuer} against {pair.evader}")
    good = "met" if plan.rows / total >= 2500 else "NOT MET"
    print(f"  {plan.rows / total:8,.0f} games/s of all; required 2,500: {good}")


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
    scenarios = list(scenarios_of(plan, cases))
    built = time.process_time()
    outcomes = play_scenarios(scenarios)
    played = time.process_time()
    as_table(plan, cases, [[outcome] for outcome in outcomes])
    put = time.process_time()
    gc.enable()
    lasted = sum(outcome.game_time_s for outcome in outcomes) / rows
    print(f"{rows:,} games of {lasted:.1f} s on average, in one chunk, one core")
    print(f"  {rows / whole:8,.0f} games/s")
    print(f"  {(built - started) / rows * 1e6:8.1f} µs per game to build and validate its scenario")
    print(f"  {(played - built) / rows * 1e6:8.1f} µs per game to play it")
    print(f"  {(put - played) / rows * 1e6:8.1f} µs per game to put it into a table")


def bench_wind(folder, rows):
    """Sweeps with wind beside those without, in turns, one core, in this process."""
    for game, text in (("PE", GAMES), ("TAD", TARGETS)):
        plans = {}
        for wind, changes in WINDS.items():
            inside = folder / f"{game} {wind}"
            inside.mkdir()
            plans[wind] = planned_from(text.rstrip() + "\n" + changes, inside, rows)[0]
        took = dict.fromkeys(plans, np.inf)
        for _ in range(2):
            for wind, plan in plans.items():
                started = time.process_time()
                computed(plan, range(rows))
                took[wind] = min(took[wind], time.process_time() - started)
        print(
            f"maths sweeps of {rows:,} {game} games: {rows / took['calm']:,.0f} games/s without wind"
        )
        for wind in list(plans)[1:]:
            ratio = took[wind] / took["calm"]
            good = "met" if ratio <= 3.0 else "NOT MET"
            print(
                f"  {wind:20} {rows / took[wind]:8,.0f} games/s, {ratio:.2f} × without; required 3: {good}"
            )


def bench_flights(folder, flights):
    """Flights on one core, and on two workers."""
    plan, _ = planned_from(FLIGHTS, folder, flights)
    started = time.perf_counter(), time.process_time()
    table = table_of_rows(plan, range(flights))
    wall = time.perf_counter() - started[0]
    cpu = time.process_time() - started[1]
    flown = sum(table["duration_s"].to_pylist())
    print(f"a fast sweep of {flights} flights of {flown / flights:.0f} s on average")
    print(
        f"  {flights / cpu:8.3f} flights/s of processor time on one core, {flown / cpu:.1f} × real time"
    )
    began = time.perf_counter()
    finish(begin_or_continue(folder / "flights", plan, 1), lambda _: None, workers=2)
    two = (time.perf_counter() - began) / flights
    print(
        f"  {flights / wall:8.3f} flights/s of wall time alone, {1 / two:.3f} with two workers and their start: "
        f"{wall / flights / two:.2f} times as fast"
    )


def bench_end_to_end(folder, rows):
    """From the file to the report, with the states of the sweep "policies"."""
    text = (
        find("policies", SWEEP_FOLDER)
        .read_text(encoding="utf-8")
        .replace("seeds = 1000", "seeds = SEEDS")
    )
    _, path = planned_from(text, folder, rows // 8)
    out = folder / "out"
    began = time.perf_counter()
    used = processor_s()
    run_sweep(str(path), way=None, workers=2, scheduler=None, out=out, chunk=None)
    swept = time.perf_counter() - began
    used = processor_s() - used
    kept = sum(part.stat().st_size for part in out.glob("rows/*.parquet"))
    parts = len(list(out.glob("rows/*.parquet")))
    here = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    worker = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    began = time.perf_counter()
    with contextlib.redirect_stdout(io.StringIO()):
        write_sweep_report(out, folder / "report", worst=3)
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
    parser.add_argument(
        "--million", action="store_true", help="one million games end to end, and nothing else"
    )
    arguments = parser.parse_args()
    share = 10 if arguments.quick else 1
    print(f"NumPy {np.__version__}, Python {sys.version.split()[0]}")
    folder = Path(tempfile.mkdtemp())
    try:
        if arguments.million:
            bench_end_to_end(folder, 1_000_000 // share)
            return
        bench_policies(folder, 4096 // share)  # the largest chunk of a sweep in maths
        bench_maths(folder, 16384 // share)
        bench_wind(folder, 400 // share)
        bench_flights(folder, max(4, 20 // share))
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
