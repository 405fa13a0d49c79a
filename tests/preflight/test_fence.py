"""The uploaded fence: read from the mock over its wire, and judged against ours."""

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from guidance.autopilots import PX4, Verdict, autopilot_named
from guidance.frames import Amsl, LocalFrame, Ned
from guidance.links import MemoryWire
from guidance.links.mavlink.pymavlink_link import PymavlinkLink
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
from guidance.preflight.fence import (
    MOST_ITEMS,
    READ_AGAIN_S,
    Area,
    Reading,
    Uploaded,
    about_home,
    our_rings,
    ring_of,
    uploaded_of,
)
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
    return tuple(FRAME.wgs84_from_ned(Ned((north, east, 0.0)))[:2] for north, east in corners_m)


def square(size_m, north_m=0.0, east_m=0.0):
    signs = ((-1, -1), (-1, 1), (1, 1), (1, -1))
    return on_the_map(*((north_m + a * size_m, east_m + b * size_m) for a, b in signs))


WIDE = Area(inclusion=True, corners_deg=square(150.0))
TIGHT = Area(inclusion=True, corners_deg=square(80.0))
POND = Area(inclusion=False, corners_deg=on_the_map((100.0, 0.0)), radius_m=20.0)
DISC = Area(inclusion=True, corners_deg=on_the_map((0.0, 0.0)), radius_m=120.0)


def judged(uploaded, *, autopilot="px4", wants=WANTS, **parameters):
    vehicle = observe(
        VehicleState(), [Origin(0.0, *HERE, 488.0), Home(0.0, *HERE, 488.0, Ned((0.0, 0.0, 0.0)))]
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


NOT_REQUIRED = wants_of(fence_required=False, fence_radius_m=100.0)


@pytest.mark.parametrize("autopilot", ["px4", "arducopter"])
@pytest.mark.parametrize(
    ("uploaded", "value"),
    [
        (Uploaded(), "not read"),
        (Uploaded(refused=3), "not read (MISSION_ACK 3)"),
        (Uploaded(problem="has 1500 items"), "has 1500 items"),
    ],
)
def test_what_was_not_read_or_cannot_be_judged_is_refused(autopilot, uploaded, value):
    row = judged(uploaded, autopilot=autopilot)["uploaded fence"]
    assert (row.value, row.verdict) == (value, Verdict.REFUSE)
    assert "may act inside our fence" in row.advice
    lenient = judged(uploaded, autopilot=autopilot, wants=NOT_REQUIRED)["uploaded fence"]
    assert lenient.verdict is Verdict.WARN


@pytest.mark.parametrize(
    ("autopilot", "off"), [("px4", {"GF_ACTION": 1.0}), ("arducopter", {"FENCE_TYPE": 3.0})]
)
def test_a_fence_that_is_not_in_use_may_be_unknown(autopilot, off):
    row = judged(Uploaded(), autopilot=autopilot, **off)["uploaded fence"]
    assert (row.value, row.verdict) == ("not read, not in use", Verdict.PASS)


def test_what_is_unknown_of_its_use_counts_as_in_use():
    facts = Facts(uploaded=Uploaded())
    for name in ("px4", "arducopter"):
        by_name = {row.name: row for row in rows(facts, autopilot_named(name), WANTS)}
        assert by_name["uploaded fence"].verdict is Verdict.REFUSE


def ring(*corners_m, inclusion=True):
    return Area(inclusion=inclusion, corners_deg=on_the_map(*corners_m))


BOW_TIE = ring((-300.0, -300.0), (300.0, 300.0), (300.0, -300.0), (-300.0, 300.0))
SPIKE = ring((-200.0, -200.0), (-200.0, 200.0), (200.0, 200.0), (200.0, 900.0), (200.0, -200.0))
PENTAGRAM = ring(
    *((500.0 * math.cos(turn), 500.0 * math.sin(turn)) for turn in np.arange(5) * 0.8 * math.pi)
)
ISLAND = Area(inclusion=False, corners_deg=square(5.0, 40.0, 40.0))
FAR_ISLAND = Area(inclusion=False, corners_deg=square(5.0, 140.0, 40.0))
NEEDLE = ring((500.0, -0.5), (500.0, 0.5), (60.0, 0.0), inclusion=False)
WEST = ring((-200.0, -200.0), (-200.0, 20.0), (200.0, 20.0), (200.0, -200.0))
EAST = ring((-200.0, 200.0), (-200.0, -20.0), (200.0, -20.0), (200.0, 200.0))
OURS = Area(inclusion=True, corners_deg=on_the_map((0.0, 0.0)), radius_m=100.0)


@pytest.mark.parametrize(
    ("areas", "px4", "arducopter"),
    [
        ((BOW_TIE,), "refuse", "refuse"),  # by even-odd home is on its waist
        ((SPIKE,), "pass", "pass"),
        ((PENTAGRAM,), "refuse", "refuse"),  # its middle counts as outside
        ((WIDE, ISLAND), "refuse", "refuse"),  # excluded in the middle of ours, far from our outline
        ((ISLAND,), "refuse", "refuse"),
        ((WIDE, FAR_ISLAND), "pass", "pass"),
        ((NEEDLE,), "refuse", "refuse"),  # thinner than any sampling of our outline
        ((WEST, EAST), "pass", "refuse"),  # PX4 needs one of them, ArduPilot both
        ((WEST,), "refuse", "refuse"),
        ((OURS,), "pass", "pass"),  # as large as ours
    ],
)  # fmt: skip
def test_areas_are_judged_by_even_odd_wherever_they_act(areas, px4, arducopter):
    for autopilot, verdict in (("px4", px4), ("arducopter", arducopter)):
        row = judged(Uploaded(areas), autopilot=autopilot)["uploaded fence"]
        assert str(row.verdict) == verdict, row


@pytest.mark.parametrize(
    ("uploaded", "verdict", "words"),
    [
        (Uploaded((WIDE,)), "pass", ""),
        (Uploaded((FAR_ISLAND,)), "refuse", "no inclusion fence is uploaded"),
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


def polygon(count, *places, command=5001, first=0):
    return [item(first + number, command, count, place) for number, place in enumerate(places)]


A = (47.0, 8.0)
B = (47.1, 8.0)
C = (47.1, 8.1)
D = (47.0, 8.1)


def test_items_make_areas_and_a_return_point_is_passed_over():
    items = [
        item(0, 5000, 0.0, HERE),
        *polygon(3.0, A, B, C, first=1),
        item(4, 5003, 50.0, HERE),
        *polygon(3.0, B, C, D, command=5002, first=5),
        item(8, 5004, 5.0, HERE),
    ]
    assert uploaded_of(items).areas == (
        Area(inclusion=True, corners_deg=(A, B, C)),
        Area(inclusion=True, corners_deg=(HERE,), radius_m=50.0),
        Area(inclusion=False, corners_deg=(B, C, D)),
        Area(inclusion=False, corners_deg=(HERE,), radius_m=5.0),
    )


@pytest.mark.parametrize("places", [(A, B, C, A), (A, A, B, C), (A, B, B, B, C), (A, B, C, C, A)])
def test_repeated_corners_and_closed_rings_are_dropped(places):
    uploaded = uploaded_of(polygon(float(len(places)), *places))
    assert uploaded.areas == (Area(inclusion=True, corners_deg=(A, B, C)),)


@pytest.mark.parametrize(
    ("items", "problem"),
    [
        (polygon(2.0, A, B), "polygon of 2 corners: needs at least 3"),
        (polygon(5.0, A, B, C, D), "has 4 corners, but announces 5"),
        ([*polygon(5.0, A, B, C, D), item(4, 5003, 5.0, A)], "has 4 corners, but announces 5"),
        ([*polygon(4.0, A, B), *polygon(3.0, C, D, first=2)], "has 2 corners, but announces 4"),
        ([item(0, 5003, 0.0, A)], "circle of 0 m: must be above 0"),
        ([item(0, 5003, -7.0, A)], "circle of -7 m: must be above 0"),
        ([item(0, 5099, 7.0, A)], "item 0 is unknown (command 5099)"),
        ([item(number, 5003, 1e4, A) for number in range(9)], "edges are more than"),
    ],
)
def test_what_cannot_be_judged_is_named(items, problem):
    uploaded = uploaded_of(items)
    assert uploaded.areas is None
    assert problem in uploaded.words


def test_a_fence_with_too_many_items_is_named():
    reading = Reading()
    reading.requests(0.0)
    reading.observe(FenceCount(0.1, MOST_ITEMS + 1))
    assert reading.found.words == f"has {MOST_ITEMS + 1} items, more than {MOST_ITEMS}"
    assert reading.over


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
    assert reading.progress == "not read again: 1 of 2 items so far"
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


def test_questions_and_readings_are_repeated_at_their_times_wherever_the_clock_began():
    reading = Reading()
    assert reading.requests(100.0) == (FenceRequest(),)
    assert reading.requests(104.9) == ()
    assert reading.requests(105.0) == (FenceRequest(),)
    reading.observe(FenceCount(105.1, 0))
    assert reading.requests(105.2) == (FenceReceived(),)
    assert reading.requests(114.9) == ()
    assert reading.requests(115.0) == (FenceRequest(),)


def test_as_many_items_and_edges_as_can_be_judged_are_read():
    reading = Reading()
    reading.requests(0.0)
    reading.observe(FenceCount(0.1, 1000))
    assert not reading.over
    larger = Reading()
    larger.requests(0.0)
    larger.observe(FenceCount(0.1, 1001))
    assert larger.over
    sides = [(47.0 + 1e-3 * math.cos(n), 8.0 + 1e-3 * math.sin(n)) for n in range(1000)]
    for corners, judged_too in ((1000, True), (1001, False)):
        rings = [*[sides] * 2, (*sides, HERE)[:corners]]
        items = []
        for ring in rings:
            items += polygon(float(len(ring)), *ring, first=len(items))
        uploaded = uploaded_of(items)
        assert (uploaded.areas is not None) is judged_too
    assert uploaded.problem == "3001 edges are more than 3000, which can be judged"
    small = uploaded_of([item(0, 5003, 0.5, HERE), item(1, 5003, 0.0, HERE)])
    assert small.problem == "area 2 is a circle of 0 m: must be above 0"


FAR_ORIGIN = observe(
    VehicleState(), [Origin(0.0, -33.0, 18.0, 0.0), Home(0.0, *HERE, 488.0, Ned((0.0, 0.0, 0.0)))]
)
AT_HOME = observe(
    VehicleState(), [Origin(0.0, *HERE, 488.0), Home(0.0, *HERE, 488.0, Ned((0.0, 0.0, 0.0)))]
)


def test_a_fence_is_compared_once_home_is_known_in_the_frame():
    wants = wants_of(fence_radius_m=None, fence_polygon_deg=square(80.0))
    for vehicle in (VehicleState(), FAR_ORIGIN):
        assert about_home(wants, vehicle, PX4.projection) is wants
        facts = Facts(parameters=SET["px4"], vehicle=vehicle, uploaded=Uploaded((WIDE,)))
        row = next(row for row in rows(facts, PX4, WANTS) if row.name == "uploaded fence")
        assert (row.verdict, row.advice) == (Verdict.REFUSE, "home is not known yet")
    limits = about_home(wants, AT_HOME, PX4.projection).limits
    assert limits.fence_polygon_deg is None
    assert len(limits.fence_polygon_ne_m) == 4


def test_circles_are_judged_as_tighter_than_they_are():
    home = AT_HOME.latest[Home]
    centre = (HERE,)
    (ours,) = our_rings(WANTS.limits)
    kept_in = ring_of(Area(True, centre, 100.0), home, FRAME).corners_m
    kept_out = ring_of(Area(False, centre, 100.0), home, FRAME).corners_m
    assert max(math.hypot(*corner) for corner in ours) == pytest.approx(100.0, abs=1e-6)
    assert max(math.hypot(*corner) for corner in kept_in) == pytest.approx(100.0, abs=1e-6)
    assert min(math.hypot(*corner) for corner in kept_out) > 100.01


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
    survey = PreflightMemory(autopilot_named(autopilot), lambda _: ())
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
        [[round(part * 1e7) / 1e7 for part in corner] for corner in corners]
    )
    assert link.counters()["requests_unanswered"] == 0
