"""Row 15: the parameters that count plans, as ArduCopter 4.5.7 answered the same uploads one after another."""

import pytest

from sitl_mock.ardupilot.totals import fence_total
from sitl_mock.protocols import PlanItem, PlanKind

VERTEX, KEEP_OUT_VERTEX, CIRCLE, KEEP_OUT_CIRCLE, RETURN = 5001, 5002, 5003, 5004, 5000


def items(*commands):
    return [PlanItem(seq, 3, command, 0, 1, 4.0, 0, 0, 0, 0, 0, 0.0) for seq, command in enumerate(commands)]


@pytest.mark.parametrize(
    ("commands", "total"),
    [
        ([VERTEX] * 4, 6),
        ([VERTEX] * 5, 7),
        ([VERTEX] * 4 + [KEEP_OUT_VERTEX] * 3, 9),
        ([VERTEX] * 3 + [KEEP_OUT_CIRCLE, RETURN], 6),
        ([RETURN] + [VERTEX] * 3, 5),
        ([VERTEX] * 4 + [RETURN], 6),
        ([VERTEX] * 4 + [CIRCLE, KEEP_OUT_CIRCLE], 8),
        ([CIRCLE] + [VERTEX] * 3, 6),
        ([CIRCLE, KEEP_OUT_CIRCLE, RETURN] + [VERTEX] * 4 + [KEEP_OUT_VERTEX] * 3, 11),
        ([CIRCLE], 0),
        ([CIRCLE, KEEP_OUT_CIRCLE], 0),
        ([RETURN], 0),
        ([], 0),
    ],
)
def test_a_fence_is_counted_as_the_real_one_counts(commands, total):
    assert fence_total(items(*commands)) == total


def test_uploads_and_clearings_are_told_once_on_every_link_and_kept_as_parameters(fly):
    flight = fly("arducopter").run(1.0)
    plans = flight.vehicle.autopilot.plans

    def told(kind, *commands):
        seen = len(flight.all("PARAM_VALUE")), len(flight.all("STATUSTEXT"))
        plans.set_plan(kind, items(*commands))
        flight.run(0.3)
        values = [(m.param_id, m.param_value, m.param_index) for _, m in flight.all("PARAM_VALUE")[seen[0] :]]
        return values, [m.text for _, m in flight.all("STATUSTEXT")[seen[1] :]]

    assert told(PlanKind.MISSION, 16, 22, 16, 20) == ([("MIS_TOTAL", 4.0, 0xFFFF)], ["Flight plan received"])
    for _ in range(2):  # an unchanged number of the fence is told again
        assert told(PlanKind.FENCE, *[VERTEX] * 4) == ([("FENCE_TOTAL", 6.0, 0xFFFF)], ["Fence Indexed OK"])
    assert told(PlanKind.RALLY, 5100, 5100) == ([("RALLY_TOTAL", 2.0, 0xFFFF)], [])
    assert told(PlanKind.RALLY) == ([("RALLY_TOTAL", 0.0, 0xFFFF)], [])
    assert told(PlanKind.RALLY) == ([], [])
    assert told(PlanKind.MISSION) == ([("MIS_TOTAL", 0.0, 0xFFFF)], [])
    parameters = flight.vehicle.autopilot.parameters
    assert [parameters[f"{name}_TOTAL"] for name in ("MIS", "FENCE", "RALLY")] == [0, 6, 0]
