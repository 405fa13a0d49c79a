"""Ages in records and on the page count from the measurement, not from the arrival."""

from pathlib import Path

import pytest

from guidance.flight import Inputs, State
from guidance.frames import Ned
from guidance.log.aggregator import Aggregator
from guidance.log.entries import CYCLE, CycleEntry, Item
from guidance.messages import LocalPosition, Timesync
from tests.flight.scenes import SETTINGS

STAND_M = (0.0, 0.0, -10.0)
STILL_M_S = (0.0, 0.0, 0.0)


@pytest.mark.parametrize("late_s", [0.0, 1.5])
def test_the_age_of_the_telemetry_counts_from_the_measurement(late_s):
    aggregator = Aggregator(lambda _: SETTINGS, {}, Path("test"))
    answer = Timesync(100.0, round(100.0e9), round(100.0e9))
    position = LocalPosition(101.0, 101.0 - late_s, Ned(STAND_M), Ned(STILL_M_S))
    entry = CycleEntry(101.2, State.CHECKING, Inputs((answer, position)), ())
    aggregator.take(Item(101.2, CYCLE.topic, "json", CYCLE.encode(entry)))
    assert aggregator.cycle.telemetry_age_s == pytest.approx(0.2 + late_s, abs=1e-3)
