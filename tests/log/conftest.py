"""The record that the log's tests read."""

import pytest


@pytest.fixture(scope="session")
def flight(short_flight):
    """One mocked flight in virtual time: its result and its record."""
    return short_flight
