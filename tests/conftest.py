"""Hypothesis draws the same examples in every run, so that a test that failed fails again; and no wall clock judges.

A share of them by default, all in the profile `all`; `HYPOTHESIS_PROFILE=search python -m tests tests` draws new ones.
"""

import gc

import pytest
from hypothesis import settings

from tests.harness.examples import PROFILE, drawn

settings.register_profile("same", derandomize=True, deadline=None, max_examples=drawn(100))
settings.register_profile("all", derandomize=True, deadline=None)
settings.register_profile("search", deadline=None)
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


@pytest.fixture(scope="session")
def short_flight(tmp_path_factory):
    """A short chase, flown once for all who read of it: its result, and its record, which nobody changes."""
    from tests.harness.flights import NEAR, flown  # what draws no flight need not load one

    path = tmp_path_factory.mktemp("short") / "record.mcap"
    return flown(NEAR, path), path
