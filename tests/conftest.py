"""Hypothesis draws the same examples in every run, so that a test that failed fails again; and no wall clock judges.

A share of them by default, all in the profile `all`; `HYPOTHESIS_PROFILE=search python -m tests tests` draws new ones.
"""

import gc

import pytest
from hypothesis import Phase, settings

from tests.harness.examples import PROFILE, drawn
from tests.harness.starved import Waiting

INCONCLUSIVE = "inconclusive"
WAITING = pytest.StashKey[Waiting]()
REAL = {"asyncio", "running", "slow", "socket", "subprocess", "threading", "time", "zenoh"}
"""Marks of a test, or names in its module, that let it wait for real time, another process or a socket."""

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
    """Leave what is collected, thousands of tests and all modules, out of every search for garbage, for it stays."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.fixture(autouse=True)
def remembered(monkeypatch, tmp_path_factory, request):
    """What one test's programs remember across restarts is nobody else's; the folder exists once it is written."""
    folder = tmp_path_factory.getbasetemp() / "state" / str(abs(hash(request.node.nodeid)))
    monkeypatch.setenv("XDG_STATE_HOME", str(folder))
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item):
    """Measure whether a test that may wait for the real world has a processor when it needs one."""
    marks = {mark.name for mark in item.iter_markers()}
    if REAL.isdisjoint(marks.union(vars(item.module))):
        return (yield)
    with Waiting() as item.stash[WAITING]:
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item):
    """Take a failure of a starved test for no result: neither passed nor failed."""
    report = yield
    if report.failed and (waited := WAITING in item.stash and item.stash[WAITING].starved()):
        report.sections.append((f"inconclusive: {waited}", str(report.longrepr)))
        report.outcome = "skipped"
        report.inconclusive = waited
        report.longrepr = (str(item.path), item.location[1], f"Skipped: {waited}")
    return report


def pytest_report_teststatus(report):
    if getattr(report, INCONCLUSIVE, ""):
        return INCONCLUSIVE, "I", "INCONCLUSIVE"
    return None


def pytest_terminal_summary(terminalreporter):
    """Show what was inconclusive, and keep the list: `python -m tests` runs those tests again alone."""
    found = terminalreporter.stats.get(INCONCLUSIVE, [])
    for report in found:
        terminalreporter.section(f"inconclusive: {report.nodeid}: {report.inconclusive}")
        terminalreporter.write_line(report.sections[-1][1])
    if cache := getattr(terminalreporter.config, "cache", None):
        cache.set(INCONCLUSIVE, sorted({report.nodeid for report in found}))


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
