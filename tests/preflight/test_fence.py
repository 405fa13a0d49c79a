"""The uploaded fence: read from the mock over its wire, and judged against ours."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from guidance.autopilots import PX4, Verdict, autopilot_named
from guidance.frames import Amsl, LocalFrame
from guidance.links import MemoryWire
from guidance.links.pymavlink_link import PymavlinkLink
from guidance.messages import (
    FenceCount,
    FenceItem,
    FenceReceived,
    FenceRefused,
    FenceRequest,
    Heartbeat,
    Home,
    Origin,
)
from guidance.preflight import Facts, PreflightMemory, rows
from guidance.preflight.fence import READ_AGAIN_S, Area, Reading, Uploaded, areas_of
from guidance.vehicle import VehicleState, observe
from sitl_mock import MockVehicle
from tests.preflight.wants import wants_of

HERE = (47.397742, 8.545594)
FRAME = LocalFrame(*HERE, Amsl(488.0), Amsl(488.0), projection=PX4.projection)
WANTS = wants_of(fence_radius_m=100.0)
SET = {
    "px4": {"GF_ACTION": 2.0, "GF_MAX_HOR_DIST": 0.0, "GF_MAX_VER_DIST": 70.0},
    "arducopter": {
        "FENCE_ENABLE": 1.0, "FENCE_ACTION": 1.0, "FENCE_TYPE": 5.0, "FENCE_RADIUS": 30.0, "FENCE_ALT_MAX": 70.0,
    },
}  # fmt: skip


def on_the_map(*corners_m):
    return tuple(FRAME.wgs84_from_ned((north, east, 0.0))[:2] for north, east in corners_m)


def square(size_m, north_m=0.0, east_m=0.0):
    signs = ((-1, -1), (-1, 1), (1, 1), (1, -1))
    return on_the_map(*((north_m + a * size_m, east_m + b * size_m) for a, b in signs))


WIDE = Area(inclusion=True, corners_deg=square(150.0))
TIGHT = Area(inclusion=True, corners_deg=square(80.0))
HOLE = Area(inclusion=False, corners_deg=square(5.0, 40.0, 40.0))
POND = Area(inclusion=False, corners_deg=on_the_map((100.0, 0.0)), radius_m=20.0)
DISC = Area(inclusion=True, corners_deg=on_the_map((0.0, 0.0)), radius_m=120.0)


def judged(uploaded, *, autopilot="px4", wants=WANTS, **parameters):
    vehicle = observe(
        VehicleState(), [Origin(0.0, *HERE, 488.0), Home(0.0, *HERE, 488.0, (0.0, 0.0, 0.0))]
    )
    facts = Facts(parameters=SET[autopilot] | parameters, vehicle=vehicle, uploaded=uploaded)
    return {row.name: row for row in rows(facts, autopilot_named(autopilot), wants)}


@pytest.mark.parametrize(
    ("autopilot", "areas", "value", "verdict"),
    [
        ("px4", (), "none", "pass"),
        ("px4", (WIDE,), "polygon of 4", "pass"),
        ("px4", (DISC,), "circle of 120 m", "pass"),
        ("px4", (TIGHT,), "polygon of 4", "refuse"),
        (
            "px4",
            (WIDE, TIGHT),
            "polygon of 4, polygon of 4",
            "pass",
        ),  # within one is enough for PX4
        ("arducopter", (WIDE, TIGHT), "polygon of 4, polygon of 4", "refuse"),
        ("arducopter", (WIDE, DISC), "polygon of 4, circle of 120 m", "pass"),
        ("px4", (POND,), "excluded circle of 20 m", "refuse"),
        ("px4", (WIDE, POND), "polygon of 4, excluded circle of 20 m", "refuse"),
    ],
)
def test_an_uploaded_fence_that_would_act_inside_ours_is_refused(autopilot, areas, value, verdict):
    row = judged(Uploaded(areas), autopilot=autopilot)["uploaded fence"]
    assert (row.value, str(row.verdict)) == (value, verdict)
    assert ("it acts inside our fence at" in row.advice) is (verdict == "refuse")
    required = judged(
        Uploaded(areas),
        autopilot=autopilot,
        wants=wants_of(fence_required=False, fence_radius_m=100.0),
    )
    assert required["uploaded fence"].verdict is not Verdict.REFUSE


def test_what_was_not_read_or_cannot_be_is_said_to_be_unknown():
    unread = judged(Uploaded())["uploaded fence"]
    assert (unread.value, unread.verdict) == ("not read", Verdict.WARN)
    assert "may act inside our fence" in unread.advice
    assert judged(Uploaded(refused=3))["uploaded fence"].value == "not read (MISSION_ACK 3)"
    folded = Area(
        inclusion=True, corners_deg=on_the_map((0.0, 0.0), (9.0, 9.0), (9.0, 0.0), (0.0, 9.0))
    )
    assert "cannot be judged" in judged(Uploaded((folded,)))["uploaded fence"].advice


@pytest.mark.parametrize(
    ("uploaded", "verdict", "words"),
    [
        (Uploaded((WIDE,)), "pass", ""),
        (Uploaded((HOLE,)), "refuse", "no inclusion fence is uploaded"),
        (Uploaded(()), "refuse", "no inclusion fence is uploaded"),
        (Uploaded(), "refuse", "whether a fence is uploaded is not known"),
    ],
)
def test_without_a_distance_px4_needs_an_uploaded_fence(uploaded, verdict, words):
    row = judged(uploaded)["GF_MAX_HOR_DIST"]
    assert str(row.verdict) == verdict
    assert words in row.advice
    assert judged(uploaded, GF_MAX_VER_DIST=0.0)["GF_MAX_VER_DIST"].verdict is Verdict.REFUSE


@pytest.mark.parametrize(
    ("fence_type", "uploaded", "verdict"),
    [
        (3.0, Uploaded((WIDE,)), "pass"),
        (5.0, Uploaded((WIDE,)), "pass"),
        (5.0, Uploaded(()), "refuse"),
        (5.0, Uploaded(), "refuse"),
        (1.0, Uploaded((WIDE,)), "refuse"),
        (4.0, Uploaded((WIDE,)), "refuse"),
        (2.0, Uploaded((WIDE,)), "refuse"),
    ],
)
def test_arducopter_needs_a_height_and_a_circle_or_an_uploaded_polygon(
    fence_type, uploaded, verdict
):
    found = judged(uploaded, autopilot="arducopter", FENCE_TYPE=fence_type)
    assert str(found["FENCE_TYPE"].verdict) == verdict
    circle = int(fence_type) & 2
    assert str(found["FENCE_RADIUS"].verdict) == ("refuse" if circle else "pass")
    in_use = int(fence_type) & 4
    assert ("not in use" in found["uploaded fence"].value) is (not in_use)


def test_a_fence_by_degrees_reaches_as_far_as_it_does_about_home():
    wants = wants_of(fence_radius_m=None, fence_polygon_deg=square(80.0))
    found = judged(Uploaded((WIDE,)), wants=wants, GF_MAX_HOR_DIST=110.0)
    assert found["GF_MAX_HOR_DIST"].verdict is Verdict.REFUSE
    assert "at least 113.137 m" in found["GF_MAX_HOR_DIST"].wanted
    assert found["uploaded fence"].verdict is Verdict.PASS
    assert found["home in our fence"].verdict is Verdict.PASS
    tight = Area(inclusion=True, corners_deg=square(79.0))
    assert judged(Uploaded((tight,)), wants=wants)["uploaded fence"].verdict is Verdict.REFUSE
    elsewhere = wants_of(fence_radius_m=None, fence_polygon_deg=square(80.0, 500.0))
    assert judged(Uploaded(()), wants=elsewhere)["home in our fence"].verdict is Verdict.REFUSE
    both = wants_of(
        fence_radius_m=100.0, fence_polygon_ne_m=((-200.0, -200.0), (-200.0, 200.0), (200.0, 0.0))
    )
    assert judged(Uploaded((DISC,)), wants=both)["uploaded fence"].verdict is Verdict.PASS


def item(sequence, command, size, place):
    return FenceItem(0.0, sequence, command, size, *place)


def test_items_make_areas_and_what_is_none_is_passed_over():
    items = [
        item(0, 5000, 0.0, HERE),  # a return point
        *(item(1 + n, 5001, 3.0, (47.0 + n, 8.0)) for n in range(3)),
        item(4, 5003, 50.0, HERE),
        *(item(5 + n, 5002, 3.0, (48.0 + n, 9.0)) for n in range(3)),
        item(8, 5004, 5.0, HERE),
        item(9, 5001, 3.0, HERE),  # a polygon that never ends
    ]
    assert areas_of(items) == (
        Area(inclusion=True, corners_deg=((47.0, 8.0), (48.0, 8.0), (49.0, 8.0))),
        Area(inclusion=True, corners_deg=(HERE,), radius_m=50.0),
        Area(inclusion=False, corners_deg=((48.0, 9.0), (49.0, 9.0), (50.0, 9.0))),
        Area(inclusion=False, corners_deg=(HERE,), radius_m=5.0),
    )


def test_the_fence_is_read_item_by_item_and_again_later():
    reading = Reading()
    assert reading.requests(0.0) == (FenceRequest(),)
    assert reading.requests(0.1) == ()
    assert reading.requests(6.0) == (FenceRequest(),)  # nobody answered
    reading.observe(FenceCount(6.1, 2))
    assert reading.requests(6.1) == (FenceRequest(0),)
    reading.observe(item(1, 5003, 7.0, HERE))  # out of turn, and kept
    reading.observe(item(2, 5003, 7.0, HERE))  # of another plan
    reading.observe(FenceCount(6.2, 9))
    assert reading.requests(6.2) == ()
    reading.observe(item(0, 5003, 9.0, HERE))
    assert reading.found == Uploaded()
    assert reading.requests(6.3) == (FenceReceived(),)
    assert [area.radius_m for area in reading.found.areas] == [9.0, 7.0]
    assert reading.requests(6.4) == ()
    assert reading.requests(6.0 + READ_AGAIN_S) == (FenceRequest(),)
    assert len(reading.found.areas) == 2  # known until something else is
    reading.observe(FenceCount(30.0, 0))
    assert reading.requests(30.0) == (FenceReceived(),)
    assert reading.found == Uploaded(())


def test_an_autopilot_without_a_fence_to_tell_of_is_not_asked_all_the_time():
    reading = Reading()
    reading.observe(FenceRefused(0.0, 3))  # to somebody else's question
    assert reading.found == Uploaded()
    reading.requests(1.0)
    reading.observe(FenceRefused(1.1, 3))
    assert reading.found == Uploaded(refused=3)
    assert reading.requests(2.0) == ()
    assert reading.requests(1.0 + READ_AGAIN_S) == (FenceRequest(),)


messages = st.one_of(
    st.builds(FenceCount, st.just(0.0), st.integers(0, 65535)),
    st.builds(FenceRefused, st.just(0.0), st.integers(0, 255)),
    st.builds(
        item, st.integers(0, 5), st.integers(4999, 5006), st.floats(-1e6, 1e6), st.just(HERE)
    ),
)


@given(st.lists(messages, max_size=30))
def test_whatever_an_autopilot_says_of_its_fence_nothing_raises(said):
    reading = Reading()
    for n, message in enumerate(said):
        reading.observe(message)
        assert len(reading.requests(float(n))) <= 1
    judged(reading.found)


@pytest.mark.parametrize("autopilot", ["px4", "arducopter"])
def test_a_fence_uploaded_to_the_mock_is_found_by_preflight_over_the_wire(autopilot):
    now = [0.0]
    ours, theirs = MemoryWire.pair(lambda: now[0])
    vehicle = MockVehicle(autopilot, ready_after_s=0.5)
    link = PymavlinkLink(ours, lambda: now[0], system_id=1)
    ground = mavlink.MAVLink(None, 255, 190)
    corners = square(150.0)
    waiting = [mavlink.MAVLink_mission_count_message(1, 1, 4, 1).pack(ground)]
    survey = PreflightMemory([])
    heard = []
    for cycle in range(500):
        now[0] = 0.02 * cycle
        out = vehicle.step(now[0], [*(frame for _, frame in theirs.receive()), *waiting])
        waiting = []
        for frame in out:
            message = mavlink.MAVLink(None).decode(bytearray(frame))
            asked = message.get_type() in {"MISSION_REQUEST_INT", "MISSION_REQUEST"}
            if asked and message.target_system == 255:
                latitude, longitude = corners[message.seq]
                place = round(latitude * 1e7), round(longitude * 1e7)
                answer = mavlink.MAVLink_mission_item_int_message(
                    1, 1, message.seq, 0, 5001, 0, 1, 4.0, 0, 0, 0, *place, 0.0, 1
                )
                waiting.append(answer.pack(ground))
            theirs.send(frame)
        received = link.receive()
        heard += received
        if cycle > 100:  # the ground station is done
            survey.observe(received, [])
            for request in survey.requests(now[0]):
                link.request(request)
    assert any(isinstance(message, Heartbeat) for message in heard)
    (area,) = survey.facts(VehicleState(), now[0]).uploaded.areas
    assert area.inclusion
    assert json.dumps(area.corners_deg) == json.dumps(
        [[round(part * 1e7) / 1e7 for part in one] for one in corners]
    )
    assert link.counters()["requests_unanswered"] == 0
