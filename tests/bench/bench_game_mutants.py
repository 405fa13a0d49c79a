"""Mutants of guidance.game: `python tests/bench/bench_game_mutants.py [--only FILES] [--keep FILE] [--minutes M]`.

A file of a package within is named as it is imported, `--only pe,team.several`; `--tests 'test_team_*.py'` runs fewer
tests, for a quick look.

One operator, comparison, constant, condition or choice is changed at a time, in memory (`mutation.py`). The tests are
collected once. Each mutant has a forked child, in which the changed function or constant takes the place of the
original and the tests that reach the changed line run, the likeliest to fail soon first, up to the first failure. What
cannot be exchanged in a running package (classes), and whatever outlasts the first `--first` seconds of tests, is
judged once more by all tests that reach it in a package imported anew. Of changes that compile to the same code one is
drawn, and none that compiles to the original's. A test that takes five times its processor time (and three seconds
more) has noticed the change: it timed out; the clock on the wall does not matter.

Printed: how many were drawn, killed, listed, survived and timed out, and every survivor. One that changes no result is
listed in `game_mutants.toml` with the reason, and is not run again without `--listed`; any other fails the run. What
only PyTorch or JAX can notice survives where they are not installed. A file given with `--keep` holds what was noticed,
by the changed statement without its docstrings and annotations, and beside it which test reaches what: a later run
judges the others alone.
"""

import argparse
import json
import os
import random
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, settings
from mutant_judges import LIMIT, Forks, judge_afresh
from mutant_survey import OPTIONS, Survey, survey
from mutation import ROOT, Mutant, drawn_from, in_child, modules

REPORT = os.dup(1)
LISTED = Path(__file__).with_name("game_mutants.toml")
START_S = 0.005
"""What pytest takes around a test, s of processor time."""

LOCAL = 10
"""How much more it says of a test that it noticed another change to the same function."""

LIKELY = 12
"""Tests that are tried before all other files are even read, in a package imported anew."""


class Run:
    """Who noticed each mutant so far, by digest, and what is left to do."""

    def __init__(self, kept: Path | None, ends: float, first_s: float) -> None:
        self.kept, self.ends, self.first_s = kept, ends, first_s
        lines = kept.read_text().splitlines() if kept and kept.exists() else []
        self.verdicts: dict[str, str] = dict(map(json.loads, lines))
        self.kills: Counter[str | tuple[str, str, str]] = Counter(self.verdicts.values())

    def note(self, mutant: Mutant, killer: str) -> None:
        """Keep who noticed a mutant."""
        self.verdicts[mutant.digest] = killer
        self.count(mutant, killer)
        if killer and self.kept:
            with self.kept.open("a") as keep:
                keep.write(json.dumps([mutant.digest, killer]) + "\n")

    def count(self, mutant: Mutant, killer: str) -> None:
        """Learn which tests notice what."""
        self.kills[killer] += 1
        self.kills[mutant.stem, mutant.function, killer] += 1

    def tests_for(self, mutant: Mutant, found: Survey) -> dict[str, float]:
        """Return what the tests that can notice a mutant cost, the likeliest to fail soon first."""

        def rank(name: str) -> float:
            here = self.kills[mutant.stem, mutant.function, name]
            return (found.costs_s[name] + START_S) / (1 + self.kills[name] + LOCAL * here)

        return {name: found.costs_s[name] for name in sorted(sorted(found.of(mutant)), key=rank)}

    def in_place(self, waiting: list[Mutant], found: Survey) -> None:
        """Judge in forks of one process by the first seconds of tests; what is not noticed there stays to be judged."""

        def work(tell: Callable[[str], None]) -> int:
            files = sorted({name.split("::")[0] for name in found.costs_s})
            return int(pytest.main([*OPTIONS, *files], plugins=[Forks(partial(judge_all, tell))]))

        def judge_all(tell: Callable[[str], None], judge: Callable[[Mutant, dict[str, float]], str | None]) -> None:
            for number, mutant in enumerate(waiting, 1):
                if time.monotonic() > self.ends:
                    return
                tests = self.first_for(mutant, found)
                killer = judge(mutant, tests) if tests else None
                if killer:
                    self.count(mutant, killer)
                    tell(json.dumps([mutant.digest, killer]))
                else:
                    say(f"outlasts {len(tests)} tests: {mutant}")
                if number % 100 == 0:
                    say(f"judged so far: {number}")

        by_digest = {one.digest: one for one in waiting}
        in_child(work, 0, lambda line: self.note(by_digest[json.loads(line)[0]], json.loads(line)[1]))

    def first_for(self, mutant: Mutant, found: Survey) -> dict[str, float]:
        """Return the first tests of a mutant, as many as take the first seconds."""
        first, spent_s = {}, 0.0
        for name, cost_s in self.tests_for(mutant, found).items():
            spent_s += cost_s
            if first and spent_s > self.first_s:
                break
            first[name] = cost_s
        return first

    def afresh(self, waiting: list[Mutant], found: Survey) -> None:
        """Judge by all tests that reach the change, in a package imported anew."""
        for mutant in waiting:
            if time.monotonic() > self.ends:
                return
            tests = list(self.tests_for(mutant, found).items())
            killer = judge_afresh(mutant, dict(tests[:LIKELY])) or judge_afresh(mutant, dict(tests[LIKELY:]))
            self.note(mutant, killer)
            if not killer:
                say(f"survived {len(tests)} tests: {mutant}")


def say(line: str) -> None:
    """Print past pytest's capture."""
    os.write(REPORT, f"{line}\n".encode())


def report(drawn: list[Mutant], run: Run, listed: dict[str, dict[str, str]]) -> int:
    """Print the numbers, and return how many survivors change a result."""
    reasons = {one: listed.get(one.stem, {}).get(one.named, "") for one in drawn}
    for one in sorted((one for one in drawn if reasons[one]), key=lambda one: (one.stem, one.line)):
        noticed = run.verdicts.get(one.digest)
        say(f"{one}\n    {f'LISTED, YET NOTICED BY {noticed}' if noticed else reasons[one]}")
    known = {one.named for one in drawn}
    for stem in {one.stem for one in drawn}:
        for name in listed.get(stem, {}).keys() - known:
            say(f"{stem}.py: LISTED, YET NOT DRAWN: {name}")
    judged = [run.verdicts[one.digest] for one in drawn if one.digest in run.verdicts and not reasons[one]]
    late, survived, harmless = judged.count(LIMIT), judged.count(""), sum(map(bool, reasons.values()))
    say(
        f"{len(drawn)} mutants drawn: {len(judged) - survived - late} killed, {late} timed out, {harmless} listed as "
        f"changing no result (above), {survived} survived, {len(drawn) - harmless - len(judged)} not judged"
    )
    return survived


def main() -> int:
    """Judge mutants until all are, or the time is up."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="comma-separated modules")
    parser.add_argument("--tests", default="test_*.py", help="comma-separated patterns of the test files to run")
    parser.add_argument("--minutes", type=float, default=600.0)
    parser.add_argument(
        "--first", type=float, default=10.0, help="seconds of tests before the package is imported anew"
    )
    parser.add_argument("--listed", action="store_true", help="run what is listed, too")
    parser.add_argument("--quick", action="store_true", help="judge nothing in a package imported anew")
    parser.add_argument("--keep", type=Path, help="a file that keeps what was noticed")
    given = parser.parse_args()
    sys.path.insert(0, str(ROOT))
    os.chdir(ROOT)
    calm = {"derandomize": True, "database": None, "deadline": None, "suppress_health_check": list(HealthCheck)}
    settings.register_profile("mutants", phases=[Phase.explicit, Phase.generate], max_examples=20, **calm)
    settings.load_profile("mutants")
    os.environ["HYPOTHESIS_PROFILE"] = "mutants"  # which the tests load again
    chosen = given.only.split(",") if given.only else list(modules())
    drawn = [mutant for stem in modules() if stem in chosen for mutant in drawn_from(stem)]
    random.Random(0).shuffle(drawn)
    listed = tomllib.loads(LISTED.read_text())
    run = Run(given.keep, time.monotonic() + 60.0 * given.minutes, given.first)
    waiting = [one for one in drawn if given.listed or not listed.get(one.stem, {}).get(one.named)]
    waiting = [one for one in waiting if one.digest not in run.verdicts]
    if waiting:
        found = survey(given.tests, given.keep)
        say(
            f"{len(found.costs_s)} tests, {sum(found.costs_s.values()):.0f} s of processor time; {len(waiting)} mutants"
        )
        run.in_place(waiting, found)
        if not given.quick:
            run.afresh([one for one in waiting if one.digest not in run.verdicts], found)
    return min(report(drawn, run, listed), 1)


if __name__ == "__main__":
    sys.exit(main())
