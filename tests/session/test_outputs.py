"""An output of a flight from outside the package: one class and one call of `OUTPUTS.add`."""

from copy import copy

import pytest

from guidance.errors import ConfigError
from guidance.log.entries import CYCLE
from guidance.log.reader import scan
from guidance.log.sink import Sink
from guidance.session.observe import outputs
from guidance.session.open.mock import MockOptions
from guidance.session.recorded_flight import fly_recorded
from tests.harness.flights import NEAR
from tests.harness.witness import Witness

pytestmark = pytest.mark.usefixtures("soon_up_and_down")


class Broken(Sink):
    """An output with a defect."""

    def __init__(self):
        self.calls = 0

    def report(self, report):
        self.calls += 1
        raise ZeroDivisionError("its own")


@pytest.fixture
def witnesses(monkeypatch):
    """Return the witnesses of all vehicles that fly from now on, by name; beside each is a broken output."""
    opened = {}
    broken = []

    def witness(order):
        opened[order.vehicle] = Witness(order)
        return opened[order.vehicle]

    def defective(_):
        broken.append(Broken())
        return broken[-1]

    monkeypatch.setattr(outputs, "OUTPUTS", copy(outputs.OUTPUTS))
    outputs.OUTPUTS.add("defective", defective)
    outputs.OUTPUTS.add("nothing", lambda _: None)
    outputs.OUTPUTS.add("witness", witness)
    yield opened
    assert [output.calls for output in broken] == [1] * len(opened)


@pytest.mark.flight
def test_an_output_from_outside_sees_a_whole_flight_as_its_record_keeps_it(witnesses, tmp_path):
    result = fly_recorded(NEAR, tmp_path, MockOptions(fast=True))
    (witness,) = witnesses.values()
    witness.saw_the_whole(result.vehicles["pursuer"])
    kept = [item.data for item in scan(tmp_path / "record.mcap") if item.topic == CYCLE.topic]
    assert kept == [CYCLE.encode(entry) for entry in witness.of("cycle")]


def test_a_name_is_taken_once(witnesses):
    with pytest.raises(ConfigError, match="'witness': another one has this name"):
        outputs.OUTPUTS.add("witness", Witness)
