"""Stored mission items are those that PX4 v1.17 and ArduCopter 4.5.7 sent back after their upload.

`tests/data/stored_items.json` has what was sent (frame, command, current, autocontinue, param1 to 4, x, y, z), the
result and
what was downloaded; null is NaN.
"""

import json
import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sitl_mock.protocols.mission_upload import ARDUPILOT_MISSION_RULES, PX4_MISSION_RULES
from sitl_mock.protocols.plan import MissionResult, PlanItem, PlanKind, item_fault

REAL = json.loads((Path(__file__).parents[2] / "data" / "stored_items.json").read_text())
RULES = {"px4": PX4_MISSION_RULES, "arducopter": ARDUPILOT_MISSION_RULES}


def item_of(values):
    return PlanItem(1, *(math.nan if value is None else value for value in values))


def told(rules, item):
    stored = rules.stored(item)
    if isinstance(stored, MissionResult):
        return int(stored), None
    fault = item_fault(PlanKind.MISSION, stored, rules.commands, any_place=rules.any_place)
    if fault is not MissionResult.ACCEPTED:
        return int(fault), None
    values = [None if isinstance(v, float) and math.isnan(v) else round(v, 3) for v in stored[1:]]
    return 0, values


@pytest.mark.parametrize("flavour", RULES)
def test_an_item_is_stored_or_refused_as_by_the_real_autopilot(flavour):
    different = [
        (sent, real)
        for sent, *real in REAL[flavour]
        if list(told(RULES[flavour], item_of(sent))) != real
    ]
    assert different == []
    assert len(REAL[flavour]) > 180


NUMBERS = st.floats(width=32) | st.sampled_from([0.0, -1.0, 255.5, 70_000.0])
WHOLE = st.integers(-(2**31), 2**31 - 1)
COMMANDS = sorted(PX4_MISSION_RULES.commands | ARDUPILOT_MISSION_RULES.commands)


@pytest.mark.parametrize("flavour", RULES)
@given(
    st.tuples(
        st.sampled_from([0, 2, 3, 6, 10, 77]),
        st.sampled_from(COMMANDS),
        st.just(0),
        st.integers(0, 1),
        *[NUMBERS] * 4,
        WHOLE,
        WHOLE,
        NUMBERS,
    )
)
def test_what_is_stored_is_stored_again_unchanged(flavour, values):
    stored = RULES[flavour].stored(PlanItem(1, *values))
    if not isinstance(stored, MissionResult):
        again = RULES[flavour].stored(stored)
        assert again == pytest.approx(stored, rel=1e-6, nan_ok=True)
