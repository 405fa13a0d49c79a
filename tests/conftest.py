"""Hypothesis draws the same examples in every run, so that a test that failed fails again; and no wall clock judges.

A share of them by default, all in the profile `all`; `HYPOTHESIS_PROFILE=search python -m tests tests` draws new ones.
"""

import contextlib
import gc
import os
import re
import resource
import signal
import time
from importlib.util import find_spec
from pathlib import Path
from statistics import median_low

import pytest
from hypothesis import Phase, settings

from guidance.errors import ConfigError
from guidance.extras import EXTRAS
from tests.__main__ import GIVES_WAY, costly
from tests.harness.examples import PROFILE, drawn
from tests.harness.starved import Waiting

STARVED = "starved"
WAITING = pytest.StashKey[Waiting]()
SINCE_S = pytest.StashKey[float]()
OPTIONAL = {"PIL", "coverage", "cyclonedx", "filterpy", "libcst", "mkdocs", "mutmut"}.union(
    *EXTRAS.values()
)
"""Packages that `python -m tests` does without; `python -m tests all` needs them."""
REAL = {"asyncio", "running", "slow", "socket", "subprocess", "threading", "time", "zenoh"}
"""Marks of a test, or names in its module, that let it wait for real time, another process or a socket."""

# A shell that starts the tests in its background ignores SIGINT, and every child would inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile("same", derandomize=True, deadline=None, max_examples=drawn(100))
settings.register_profile("all", derandomize=True, deadline=None)
settings.register_profile("search", deadline=None)
settings.register_profile(
    "mutants",
    settings.get_profile("same"),
    phases=(Phase.explicit, Phase.generate),  # a failure is enough; nobody reads the smallest one
)
settings.load_profile(PROFILE)


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Leave what is collected, thousands of tests and all modules, out of every search for garbage, for it stays.

    The searches after it are rare: a flight keeps nearly all that it makes, and by default they take 4 % of the time.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(20_000)
        gc.enable()


@pytest.hookimpl(optionalhook=True)  # mutants are judged without pytest-xdist
def pytest_xdist_auto_num_workers():
    """Return a worker for each core, and more on a busy machine, where they get a larger share of it.

    Threads that compute now are counted, because the load average still knows what has just ended. Each worker collects
    the tests again, which takes 5 to 16 s of processor time, so there is none for what the other steps compute. A step
    that gives way wants no larger share; one more computes while another one waits.
    """
    cores = (
        len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    )
    if os.nice(0) >= GIVES_WAY:
        return cores + 1
    others = []
    for _ in range(9):
        with contextlib.suppress(OSError):  # there is no such file outside Linux
            computing = Path("/proc/loadavg").read_text().split()[3].partition("/")[0]
            others.append(int(computing) - 1)
        time.sleep(0.05)
    return cores + min(4, max(0, median_low(others or [0]) - cores))


def pytest_collection_modifyitems(items):
    """Mark the tests that `python -m tests` leaves to `python -m tests all`."""
    listed = costly()
    for item in items:
        if item.nodeid in listed:
            item.add_marker(pytest.mark.costly)


@pytest.fixture(autouse=True)
def remembered(monkeypatch, tmp_path_factory, request):
    """What one test's programs remember across restarts is nobody else's; the folder exists once it is written."""
    folder = tmp_path_factory.getbasetemp() / "state" / str(abs(hash(request.node.nodeid)))
    monkeypatch.setenv("XDG_STATE_HOME", str(folder))
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)


def missing(error):
    """Return the optional package that an error says is not installed; empty if it says something else."""
    if isinstance(error, ConfigError) and (
        named := re.search(r"needs (\w+).* not installed", str(error))
    ):
        name = named[1]
    else:
        name = (getattr(error, "name", None) or "").partition(".")[0]
    return name if name in OPTIONAL and find_spec(name) is None else ""


class Module(pytest.Module):
    """A file of tests; it is skipped if it needs a package that is not installed."""

    def collect(self):
        try:
            return super().collect()
        except self.CollectError as error:
            if name := missing(error.__cause__):
                pytest.skip(f"needs {name}", allow_module_level=True)
            raise


def pytest_pycollect_makemodule(module_path, parent):
    return Module.from_parent(parent, path=module_path)


def processor_s():
    """Return the processor time of this process and of its children that have ended."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item):
    """Measure whether a test that may wait for the real world has a processor when it needs one."""
    item.stash[SINCE_S] = processor_s()
    marks = {mark.name for mark in item.iter_markers()}
    if REAL.isdisjoint(marks.union(vars(item.module))):
        return (yield)
    with Waiting() as item.stash[WAITING]:
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    """Take a failure of a starved test for no result, and that for want of a package for a skip."""
    report = yield
    spent_s = processor_s()
    report.processor_s = spent_s - item.stash[SINCE_S]
    item.stash[SINCE_S] = spent_s
    if report.failed and (name := missing(call.excinfo.value)):
        report.outcome = "skipped"
        report.longrepr = (str(item.path), item.location[1], f"Skipped: needs {name}")
    elif report.failed and (waited := WAITING in item.stash and item.stash[WAITING].starved()):
        report.sections.append((f"{STARVED}: {waited}", str(report.longrepr)))
        report.outcome = "skipped"
        report.starved = waited
        report.longrepr = (str(item.path), item.location[1], f"Skipped: {waited}")
    return report


def pytest_report_teststatus(report):
    if getattr(report, STARVED, ""):
        return STARVED, "S", "STARVED"
    return None


def pytest_terminal_summary(terminalreporter):
    """Show what starved, and keep each test's outcome and processor time: `python -m tests` counts them.

    It also runs the starved ones again, alone.
    """
    for report in terminalreporter.stats.get(STARVED, []):
        terminalreporter.section(f"{STARVED}: {report.nodeid}: {report.starved}")
        terminalreporter.write_line(report.sections[-1][1])
    tests = {}
    for category, reports in terminalreporter.stats.items():
        for report in reports:
            if isinstance(report, pytest.TestReport | pytest.CollectReport):
                outcome, spent_s = tests.get(report.nodeid, ("", 0.0))
                outcome = category if outcome in {"", "passed"} and category else outcome
                tests[report.nodeid] = (outcome, spent_s + getattr(report, "processor_s", 0.0))
    if cache := getattr(terminalreporter.config, "cache", None):
        cache.set("tests", tests)


@pytest.fixture(scope="session")
def short_flight(tmp_path_factory):
    """A short chase, flown once for all who read of it: its result, and its record, which nobody changes."""
    from tests.harness.flights import NEAR, flown  # what draws no flight need not load one

    path = tmp_path_factory.mktemp("short") / "record.mcap"
    return flown(NEAR, path), path


@pytest.fixture(scope="module")
def soon_up_and_down():
    """Let the PX4s of this module's mocked flights take off and land fast."""
    from tests.harness import flights

    with flights.soon_up_and_down():
        yield
