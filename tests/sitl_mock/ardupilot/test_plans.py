"""Effects of uploaded plans, as on ArduCopter 4.5.7: row 15, item counts as parameters; a fence slows the copter."""

import pytest

from sitl_mock.ardupilot.plans import avoiding, fence_total
from sitl_mock.dynamics import Kind, Setpoint
from sitl_mock.protocols import PlanItem, PlanKind
from sitl_mock.vector import Vector

SIDE_M = 25.0
VERTEX = 5001
KEEP_OUT_VERTEX = 5002
CIRCLE = 5003
KEEP_OUT_CIRCLE = 5004
RETURN = 5000


def items(*commands):
    return [
        PlanItem(seq, 3, command, 0, 1, 4.0, 0, 0, 0, 0, 0, 0.0)
        for seq, command in enumerate(commands)
    ]


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
        values = [
            (m.param_id, m.param_value, m.param_index)
            for _, m in flight.all("PARAM_VALUE")[seen[0] :]
        ]
        return values, [m.text for _, m in flight.all("STATUSTEXT")[seen[1] :]]

    assert told(PlanKind.MISSION, 16, 22, 16, 20) == (
        [("MIS_TOTAL", 4.0, 0xFFFF)],
        ["Flight plan received"],
    )
    for _ in range(2):  # the fence's count is reported again even if unchanged
        assert told(PlanKind.FENCE, *[VERTEX] * 4) == (
            [("FENCE_TOTAL", 6.0, 0xFFFF)],
            ["Fence Indexed OK"],
        )
    assert told(PlanKind.RALLY, 5100, 5100) == ([("RALLY_TOTAL", 2.0, 0xFFFF)], [])
    assert told(PlanKind.RALLY) == ([("RALLY_TOTAL", 0.0, 0xFFFF)], [])
    assert told(PlanKind.RALLY) == ([], [])
    assert told(PlanKind.MISSION) == ([("MIS_TOTAL", 0.0, 0xFFFF)], [])
    parameters = flight.vehicle.autopilot.parameters
    assert [parameters[f"{name}_TOTAL"] for name in ("MIS", "FENCE", "RALLY")] == [0, 6, 0]


@pytest.fixture
def square(fly):
    """A copter in GUIDED at 10 m in a square of 50 m with the fence enabled; parameters by keyword."""

    def make(**parameters):
        flight = fly(
            "arducopter", parameters={"FENCE_ENABLE": 1, "FENCE_TYPE": 4, **parameters}
        ).run(0.5)
        frame = flight.vehicle.autopilot.frame
        corners = [(SIDE_M, SIDE_M), (SIDE_M, -SIDE_M), (-SIDE_M, -SIDE_M), (-SIDE_M, SIDE_M)]
        places = [frame.to_geodetic(*corner, 0.0) for corner in corners]
        items = [
            PlanItem(seq, 0, 5001, 0, 1, 4.0, 0, 0, 0, round(lat * 1e7), round(lon * 1e7), 0.0)
            for seq, (lat, lon, _) in enumerate(places)
        ]
        flight.vehicle.autopilot.plans.set_plan(PlanKind.FENCE, items)
        return flight

    return make


@pytest.mark.parametrize(
    ("real", "stream", "axis"),
    [
        (
            [(15.24, 4.44), (17.77, 3.86), (20.06, 3.09), (21.70, 2.24), (22.76, 1.20)],
            (5.0, 0.0, 0.0),
            0,
        ),
        (
            [(17.10, 3.81), (19.41, 3.19), (21.13, 2.46), (22.46, 1.50), (23.09, 0.57)],
            (-3.0, 4.0, 0.0),
            1,
        ),
    ],
)
def test_towards_a_fence_it_is_as_fast_at_each_distance_as_the_real_one(
    square, ned_velocity, real, stream, axis
):
    flight = square()
    flight.guided()
    flight.command(400, 1.0)
    flight.command(22, 0, 0, 0, 0, 0, 0, 10.0)
    flight.run(14.0)
    flown = []
    for _ in range(90):
        flight.run(0.1, ned_velocity(*stream))
        flown.append((flight.position[axis], flight.velocity[axis], flight.velocity[1 - axis]))
    for place_m, speed_m_s in real:
        _, speed, aside = min(flown, key=lambda row: abs(row[0] - place_m))
        assert speed == pytest.approx(speed_m_s, abs=0.4)
        if place_m < SIDE_M - 2.0:
            assert aside == pytest.approx(stream[1 - axis], abs=0.25), "it slides along the fence"
    assert max(place for place, *_ in flown) < SIDE_M - 1.5
    assert flight.mode == "GUIDED"


def test_it_goes_back_from_the_margin_and_only_where_it_is_asked_to_avoid(square):
    ask = Setpoint(Kind.STREAM, velocity_ned_m_s=Vector((5.0, 1.0, -0.5)))

    def allowed(place, **parameters):
        vehicle = square(**parameters).vehicle.autopilot
        vehicle.state.position_m = place
        return avoiding(vehicle.state, vehicle.plans, ask).velocity_ned_m_s

    assert allowed((0.0, 0.0, -10.0)) == (5.0, 1.0, -0.5)
    assert allowed((22.5, 0.0, -10.0)) == pytest.approx((0.5, 1.0, -0.5), abs=0.02)
    assert allowed((23.5, 0.0, -10.0)) == pytest.approx((-0.5, 0.0, -0.5), abs=0.02)
    assert allowed((24.8, 0.0, -10.0)) == pytest.approx((-0.75, 0.0, -0.5), abs=0.02)
    for off in ({"AVOID_ENABLE": 2}, {"FENCE_ENABLE": 0}, {"FENCE_TYPE": 3}):
        assert allowed((23.5, 0.0, -10.0), **off) == (5.0, 1.0, -0.5)
