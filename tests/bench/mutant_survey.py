"""What each test of a package costs, and which lines it reaches: what a mutant is judged by."""

import gc
import hashlib
import importlib
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest
from coverage import Coverage
from mutation import ROOT, SOURCE, Mutant, in_child, modules

TESTS = ROOT / "tests" / "game"
OWN = ("guidance", "sitl_mock", "tests", "conftest", "__main__")
OPTIONS = ["-q", "-x", "-m", "not slow", "-p", "no:cacheprovider", "--assert=plain", f"--rootdir={ROOT}"]


class Survey(NamedTuple):
    """What each test costs, s of processor time, and which tests reach a line of a file."""

    costs_s: dict[str, float]
    reached: dict[str, dict[int, set[str]]]

    def of(self, mutant: Mutant) -> set[str]:
        """Return the tests that can notice a mutant: all of its file's where it is outside of all functions."""
        lines = self.reached.get(mutant.stem, {})
        of_file = mutant.lines if mutant.function else lines
        return set().union(*(lines.get(line, ()) for line in of_file)) or (
            set() if mutant.function else {*self.costs_s}
        )


class Watch:
    """A pytest plugin: what each test costs, and which lines of the package it reaches."""

    def __init__(self) -> None:
        self.costs_s: dict[str, float] = {}
        self.failed = ""
        self.coverage = Coverage(data_file=None, config_file=False, source=[str(SOURCE)])
        self.coverage.start()

    def pytest_runtest_logstart(self, nodeid, location) -> None:
        """Start to count."""
        self.coverage.switch_context(nodeid)
        self.started = time.process_time()

    def pytest_runtest_logfinish(self, nodeid, location) -> None:
        """Keep the count."""
        self.costs_s[nodeid] = time.process_time() - self.started

    def pytest_runtest_logreport(self, report) -> None:
        """Keep what failed."""
        if report.failed:
            self.failed = f"{report.nodeid}\n{report.longreprtext}"

    def reached(self) -> dict[str, dict[int, list[str]]]:
        """Return the tests that reached each line of each file."""
        self.coverage.stop()
        data = self.coverage.get_data()
        lines = {stem: data.contexts_by_lineno(str(path)) for stem, path in modules().items()}
        return {stem: {line: [one for one in names if one] for line, names in of.items()} for stem, of in lines.items()}


def survey(patterns: str, kept: Path | None) -> Survey:
    """Run the test files that are not known yet without a change, and import here what they import."""
    kept = kept and kept.with_suffix(".survey")
    known: dict[str, list] = json.loads(kept.read_text()) if kept and kept.exists() else {}
    sources = "".join(path.read_text() for path in (*modules().values(), TESTS / "conftest.py"))
    files = sorted({path for pattern in patterns.split(",") for path in TESTS.glob(pattern)})
    digests = {path.name: hashlib.blake2b((sources + path.read_text()).encode()).hexdigest()[:16] for path in files}
    for path, digest in digests.items():
        if known.get(path, [""])[0] != digest:
            known[path] = [digest, *_watched(str(TESTS / path))]
            if kept:
                kept.write_text(json.dumps(known))
    found, libraries = Survey({}, {}), set()
    for path in digests:
        _, costs_s, reached, names = known[path]
        mean_s = sum(costs_s.values()) / max(len(costs_s), 1)  # what a file's tests share falls on any of them
        found.costs_s.update({name: max(cost_s, mean_s) for name, cost_s in costs_s.items()})
        libraries.update(names)
        for stem, lines in reached.items():
            for line, tests in lines.items():
                found.reached.setdefault(stem, {}).setdefault(int(line), set()).update(tests)
    for name in sorted(libraries):
        _import(name)
    gc.freeze()
    return found


def _import(name: str) -> None:
    """Import what the tests import, so that no child has to; what only a test can import is left to it."""
    try:
        importlib.import_module(name)
    except ImportError:
        return


def _watched(path: str) -> list:
    """Run one file; return its tests' costs, what they reached, and what had to be imported."""

    def work(tell: Callable[[str], None]) -> int:
        watch = Watch()
        code = pytest.main([*OPTIONS, path], plugins=[watch])
        names = [one for one in sys.modules if one.split(".")[0] not in OWN and "test_" not in one]
        tell(json.dumps([watch.costs_s, watch.reached(), names, watch.failed]))
        return int(code)

    status, told = in_child(work)
    if status:
        raise SystemExit(f"{path}: fails without a change: {json.loads(told)[-1] if told else status}")
    return json.loads(told)[:-1]
