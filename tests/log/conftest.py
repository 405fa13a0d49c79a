"""The record of a short flight, read by the tests of the log."""

import pytest


@pytest.fixture(scope="session")
def flight(short_flight):
    """Result and record of one mocked flight in virtual time."""
    return short_flight
