"""Sorties for the complaints, on both autopilots."""

import pytest

from tests.harness.flights import soon_up_and_down
from tests.harness.sortie import Sorties, Stepped


@pytest.fixture(scope="session")
def sorties():
    return Sorties(Stepped)


@pytest.fixture
def sortie(sorties):
    """Make sorties; all are closed at the end."""
    with soon_up_and_down():
        yield sorties
    sorties.close()


@pytest.fixture(params=["px4", "arducopter"])
def autopilot(request):
    return request.param
