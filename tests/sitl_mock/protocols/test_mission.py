"""Missions, fences and rally points: transfers both ways, with everything that can go wrong on the way."""

import math
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import all as dialect

from sitl_mock.protocols import (
    ARDUPILOT_MISSION_RULES,
    PX4_MISSION_RULES,
    MissionProtocol,
    MissionResult,
    PlanItem,
    PlanKind,
    PlanStore,
)
from sitl_mock.protocols.mission_upload import read_item

MISSION = 0
FENCE = 1
RALLY = 2
ALL = 255
FLAVOURS = pytest.mark.parametrize(
    "rules", [PX4_MISSION_RULES, ARDUPILOT_MISSION_RULES], ids=["px4", "ardupilot"]
)


def waypoint(seq, *, frame=6, command=16, p1=0.0, x=None, y=80_000_000, z=20.0):
    return (
        seq,
        frame,
        command,
        0,
        1,
        p1,
        2.0,
        3.0,
        4.0,
        470_000_000 + seq if x is None else x,
        y,
        z,
    )


def send_item(client, item, kind=MISSION):
    return client.send("MISSION_ITEM_INT", 1, 1, *item, kind)


def upload(client, items, kind=MISSION):
    """Upload as a client that loses nothing; returns the final acknowledgement."""
    (answer,) = client.send("MISSION_COUNT", 1, 1, len(items), kind)
    while answer.get_type() in {"MISSION_REQUEST_INT", "MISSION_REQUEST"}:
        (answer,) = send_item(client, items[answer.seq], kind)
    return answer


def download(client, kind=MISSION):
    (count,) = client.send("MISSION_REQUEST_LIST", 1, 1, kind)
    items = []
    for seq in range(count.count):
        (item,) = client.send("MISSION_REQUEST_INT", 1, 1, seq, kind)
        items.append(item)
    client.send("MISSION_ACK", 1, 1, 0, kind)
    return items


@pytest.fixture
def plans():
    return PlanStore()


@pytest.fixture
def vehicle(plans):
    def make(rules=PX4_MISSION_RULES, set_current=lambda now_s, seq: []):
        return MissionProtocol(plans, rules, set_current)

    return make


def acked(message, result, kind=MISSION):
    assert message.get_type() == "MISSION_ACK"
    assert (message.type, message.mission_type) == (int(result), kind)
    assert (message.target_system, message.target_component) == (255, 190)
    return True


@FLAVOURS
def test_what_was_uploaded_is_what_is_downloaded(wire, vehicle, plans, rules):
    client = wire(vehicle(rules))
    items = [waypoint(seq) for seq in range(25)]
    acked(upload(client, items), MissionResult.ACCEPTED)
    assert plans.mission.items == tuple(rules.stored(PlanItem(*item)) for item in items)
    first = int(rules.home_first)  # item 0 of ArduPilot's missions is always home
    came = download(client)
    assert len(came) == len(items)
    assert [item.x for item in came[first:]] == [item[9] for item in items[first:]]
    for seq, item in enumerate(came[first:], start=first):
        stored = rules.stored(PlanItem(*items[seq]))
        expected = (
            seq,
            stored.frame,
            16,
            int(seq == 0),
            1,
            *(stored.param1, stored.param2, stored.param3, stored.param4),
            470_000_000 + seq,
            80_000_000,
            20.0,
        )
        assert tuple(getattr(item, name) for name in item.get_fieldnames()[2:-1]) == expected


def test_the_current_item_is_marked_in_a_download(wire, vehicle, plans):
    client = wire(vehicle())
    upload(client, [waypoint(seq) for seq in range(4)])
    plans.current = 2
    assert [item.current for item in download(client)] == [0, 0, 1, 0]


def test_each_accepted_upload_raises_the_revision_of_its_plan_only(wire, vehicle, plans):
    client = wire(vehicle())
    upload(client, [waypoint(0)])
    plans.current = 0
    upload(client, [waypoint(0), waypoint(1)])
    assert (plans.mission.revision, plans.fence.revision, plans.rally.revision) == (2, 0, 0)
    assert plans.mission.opaque_id != 0
    first = plans.mission.opaque_id
    upload(client, [waypoint(0), waypoint(1)])
    assert plans.mission.opaque_id == first


def test_a_fence_of_two_polygons_and_circles_goes_both_ways(wire, vehicle, plans):
    client = wire(vehicle())
    polygon = [waypoint(seq, frame=0, command=5001, p1=4.0) for seq in range(4)]
    hole = [waypoint(seq, frame=0, command=5002, p1=3.0) for seq in range(4, 7)]
    circles = [
        waypoint(7, frame=0, command=5003, p1=50.0),
        waypoint(8, frame=0, command=5004, p1=5.0),
    ]
    acked(upload(client, polygon + hole + circles, FENCE), MissionResult.ACCEPTED, FENCE)
    assert [item.command for item in download(client, FENCE)] == [5001] * 4 + [5002] * 3 + [
        5003,
        5004,
    ]
    assert plans.mission.items == ()


def test_rally_points_go_both_ways(wire, vehicle):
    client = wire(vehicle())
    acked(
        upload(client, [waypoint(0, frame=3, command=5100)], RALLY), MissionResult.ACCEPTED, RALLY
    )
    assert [item.command for item in download(client, RALLY)] == [5100]


def test_the_float_form_is_taken_and_given_too(wire, vehicle, plans):
    client = wire(vehicle())
    (request,) = client.send("MISSION_COUNT", 1, 1, 1, MISSION)
    assert request.get_type() == "MISSION_REQUEST_INT"
    (ack,) = client.send(
        "MISSION_ITEM", 1, 1, 0, 3, 16, 0, 1, 0.0, 0.0, 0.0, 0.0, 47.5, 8.25, 20.0, MISSION
    )
    acked(ack, MissionResult.ACCEPTED)
    assert (plans.mission.items[0].x, plans.mission.items[0].y) == (475_000_000, 82_500_000)
    (item,) = client.send("MISSION_REQUEST", 1, 1, 0, MISSION)
    assert (item.get_type(), item.x, item.y) == ("MISSION_ITEM", 47.5, 8.25)


def test_huge_and_missing_floats_make_no_overflow(wire, vehicle):
    client = wire(vehicle())
    for x, result in ((1e30, MissionResult.ACCEPTED), (math.nan, MissionResult.ACCEPTED)):
        client.send("MISSION_COUNT", 1, 1, 1, MISSION)
        (ack,) = client.send(
            "MISSION_ITEM", 1, 1, 0, 3, 16, 0, 1, 0.0, 0.0, 0.0, 0.0, x, 8.0, 20.0, MISSION
        )
        acked(ack, result)


# -- losses ------------------------------------------------------------------------------------------------------------


def test_a_lost_request_or_item_is_asked_for_again(wire, vehicle):
    client = wire(vehicle())
    client.send("MISSION_COUNT", 1, 1, 3, MISSION)
    again = client.wait(0.5)
    assert {message.get_type() for message in again} == {"MISSION_REQUEST_INT"}
    assert [message.seq for message in again] == [0] * len(again)
    assert len(again) == pytest.approx(0.5 / PX4_MISSION_RULES.resend_s, abs=2)
    send_item(client, waypoint(0))
    assert {message.seq for message in client.wait(0.2)} == {1}


def test_a_repeated_item_is_taken_once(wire, vehicle, plans):
    client = wire(vehicle())
    client.send("MISSION_COUNT", 1, 1, 2, MISSION)
    (request,) = send_item(client, waypoint(0))
    assert request.seq == 1
    assert send_item(client, waypoint(0)) == []
    (ack,) = send_item(client, waypoint(1))
    acked(ack, MissionResult.ACCEPTED)
    assert len(plans.mission.items) == 2


def test_a_client_that_missed_the_last_acknowledgement_gets_it_again(wire, vehicle, plans):
    client = wire(vehicle())
    upload(client, [waypoint(0), waypoint(1)])
    (ack,) = send_item(client, waypoint(1))
    acked(ack, MissionResult.ACCEPTED)
    assert plans.mission.revision == 1
    (ack,) = send_item(client, waypoint(0))
    acked(ack, MissionResult.ERROR)


@pytest.mark.parametrize(
    ("rules", "answers"), [(PX4_MISSION_RULES, 0), (ARDUPILOT_MISSION_RULES, 1)]
)
def test_px4_does_not_clear_while_a_client_downloads(wire, vehicle, rules, answers):
    client = wire(vehicle(rules))
    upload(client, [waypoint(0), waypoint(1)])
    client.send("MISSION_REQUEST_LIST", 1, 1, MISSION)
    assert len(client.send("MISSION_CLEAR_ALL", 1, 1, MISSION)) == answers
    client.send("MISSION_ACK", 1, 1, 0, MISSION)
    (ack,) = client.send("MISSION_CLEAR_ALL", 1, 1, MISSION)
    acked(ack, MissionResult.ACCEPTED)


def test_a_repeated_count_starts_the_upload_again(wire, vehicle, plans):
    client = wire(vehicle())
    client.send("MISSION_COUNT", 1, 1, 2, MISSION)
    send_item(client, waypoint(0))
    acked(upload(client, [waypoint(0, z=5.0), waypoint(1, z=5.0)]), MissionResult.ACCEPTED)
    assert [item.z for item in plans.mission.items] == [5.0, 5.0]


class LossyUpload:
    """A client like MAVSDK on a lossy wire: sends requested items, resends after 0.5 s of silence."""

    def __init__(self, client, items, rng, loss):
        self.client = client
        self.items = items
        self.rng = rng
        self.loss = loss
        self.result = None
        self.heard_s = 0.0
        self.last = None

    def put(self, *message):
        self.last = message
        self.heard_s = self.client.now_s
        if self.rng.random() >= self.loss:
            self.take(self.client.send(*message))

    def take(self, answers):
        for answer in answers:
            if self.rng.random() < self.loss or self.result is not None:
                continue
            if answer.get_type() == "MISSION_ACK":
                self.result = answer.type
            else:
                self.put("MISSION_ITEM_INT", 1, 1, *self.items[answer.seq], MISSION)

    def run(self, limit_s):
        self.put("MISSION_COUNT", 1, 1, len(self.items), MISSION)
        while self.result is None and self.client.now_s < limit_s:
            self.take(self.client.wait(0.005, 0.005))
            if self.client.now_s - self.heard_s > 0.5:
                self.put(*self.last)
        return self.result


@pytest.mark.parametrize("seed", range(4))
@FLAVOURS
def test_500_items_get_through_with_a_tenth_lost_each_way(wire, vehicle, plans, rules, seed):
    import random

    client = wire(vehicle(rules))
    items = [waypoint(seq) for seq in range(500)]
    assert LossyUpload(client, items, random.Random(seed), 0.1).run(60.0) == MissionResult.ACCEPTED
    assert plans.mission.items == tuple(rules.stored(PlanItem(*item)) for item in items)
    assert client.now_s < 15.0


def test_a_download_with_losses_is_repeated_by_the_client_and_answered_every_time(wire, vehicle):
    client = wire(vehicle())
    upload(client, [waypoint(seq) for seq in range(5)])
    for _ in range(3):
        assert client.send("MISSION_REQUEST_LIST", 1, 1, MISSION)[0].count == 5
        assert client.send("MISSION_REQUEST_INT", 1, 1, 4, MISSION)[0].seq == 4
        assert client.send("MISSION_REQUEST_INT", 1, 1, 1, MISSION)[0].seq == 1


@FLAVOURS
def test_an_upload_that_falls_silent_is_given_up_and_the_old_plan_stands(
    wire, vehicle, plans, rules
):
    protocol = vehicle(rules)
    client = wire(protocol)
    upload(client, [waypoint(0)])
    client.send("MISSION_COUNT", 1, 1, 3, MISSION)
    send_item(client, waypoint(0))
    came = client.wait(rules.timeout_s + 0.1)
    assert (came[-1].get_type() == "MISSION_ACK") == rules.cancel_on_timeout
    if rules.cancel_on_timeout:
        acked(came[-1], MissionResult.OPERATION_CANCELLED)
    assert protocol.is_idle
    assert client.wait(5.0) == []
    assert (len(plans.mission.items), plans.mission.revision) == (1, 1)


def test_a_client_that_gives_up_ends_the_upload(wire, vehicle, plans):
    protocol = vehicle()
    client = wire(protocol)
    client.send("MISSION_COUNT", 1, 1, 3, MISSION)
    client.send("MISSION_ACK", 1, 1, 15, FENCE)
    assert not protocol.is_idle
    client.send("MISSION_ACK", 1, 1, 15, MISSION)
    assert protocol.is_idle
    assert plans.mission.revision == 0
    client.send("MISSION_ACK", 1, 1, 15, MISSION)
    assert client.wait(1.0) == []


# -- refusals ----------------------------------------------------------------------------------------------------------


def test_px4s_simulator_takes_ten_thousand_items(wire, vehicle):
    client = wire(vehicle(PX4_MISSION_RULES))
    (request,) = client.send("MISSION_COUNT", 1, 1, 10_000, MISSION)
    assert request.get_type() == "MISSION_REQUEST_INT"


@FLAVOURS
def test_more_items_than_fit_are_refused_at_the_count(wire, vehicle, plans, rules):
    client = wire(vehicle(rules))
    for kind in PlanKind:
        (ack,) = client.send("MISSION_COUNT", 1, 1, rules.capacity[kind] + 1, kind)
        acked(ack, MissionResult.NO_SPACE, kind)
        (request,) = client.send("MISSION_COUNT", 1, 1, rules.capacity[kind], kind)
        assert (request.get_type(), request.seq, request.mission_type) == (rules.asks_with, 0, kind)


@pytest.mark.parametrize(
    ("item", "kind", "result"),
    [
        (waypoint(0, command=999), MISSION, MissionResult.UNSUPPORTED),
        (waypoint(0, frame=1), MISSION, MissionResult.UNSUPPORTED_FRAME),
        (waypoint(0, frame=1, command=178), MISSION, MissionResult.UNSUPPORTED_FRAME),
        (waypoint(0, x=900_000_001), MISSION, MissionResult.INVALID_PARAM5_X),
        (waypoint(0, x=2**31 - 1), MISSION, MissionResult.INVALID_PARAM5_X),
        (waypoint(0, y=1_800_000_001), MISSION, MissionResult.INVALID_PARAM6_Y),
        (waypoint(0, z=math.nan), MISSION, MissionResult.INVALID_PARAM7),
        (waypoint(0, z=math.inf, command=22), MISSION, MissionResult.INVALID_PARAM7),
        (waypoint(0, frame=0, command=16), FENCE, MissionResult.UNSUPPORTED),
        (waypoint(0, frame=0, command=5001, p1=2.0), FENCE, MissionResult.ERROR),
        (waypoint(0, frame=0, command=5001, p1=math.nan), FENCE, MissionResult.ERROR),
        (waypoint(0, frame=1, command=5003, p1=9.0), FENCE, MissionResult.UNSUPPORTED_FRAME),
        (waypoint(0, frame=0, command=5001, p1=3.0), FENCE, MissionResult.INVALID),
        (waypoint(0, command=16), RALLY, MissionResult.UNSUPPORTED),
        (waypoint(0, command=5100, x=910_000_000), RALLY, MissionResult.INVALID_PARAM5_X),
    ],
)
def test_a_bad_item_ends_the_upload_with_its_reason_and_the_old_plan_stands(
    wire, vehicle, plans, item, kind, result
):
    protocol = vehicle(replace(PX4_MISSION_RULES, any_place=False))
    client = wire(protocol)
    client.send("MISSION_COUNT", 1, 1, 1, kind)
    (ack,) = send_item(client, item, kind)
    acked(ack, result, kind)
    assert protocol.is_idle
    assert plans.plans[PlanKind(kind)].revision == 0


@pytest.mark.parametrize(
    "item",
    [
        waypoint(0, command=22, x=2**31 - 1, y=2**31 - 1),
        waypoint(0, command=21, x=0, y=0, z=math.nan),
        waypoint(0, command=20, frame=2, x=0, y=0),
        waypoint(0, command=178, frame=2, x=0, y=0, z=math.nan),
        waypoint(0, command=22, z=math.nan),
        waypoint(0, x=900_000_000, y=-1_800_000_000),
    ],
)
def test_items_that_leave_the_place_open_are_taken_where_that_has_a_meaning(wire, vehicle, item):
    acked(upload(wire(vehicle()), [item]), MissionResult.ACCEPTED)


def test_a_polygon_with_a_stray_vertex_or_a_gap_is_invalid(wire, vehicle):
    client = wire(vehicle())
    triangle = [waypoint(seq, frame=0, command=5001, p1=3.0) for seq in range(3)]
    stray = [*triangle[:2], waypoint(2, frame=0, command=5003, p1=3.0)]
    acked(upload(client, stray, FENCE), MissionResult.INVALID, FENCE)
    acked(upload(client, triangle, FENCE), MissionResult.ACCEPTED, FENCE)


@pytest.mark.parametrize("radius_m", [0.0, -5.0])
def test_px4_takes_a_fence_circle_of_any_radius_and_ardupilot_refuses_the_plan(
    wire, vehicle, radius_m
):
    circle = [waypoint(0, frame=0, command=5003, p1=radius_m)]
    acked(upload(wire(vehicle()), circle, FENCE), MissionResult.ACCEPTED, FENCE)
    client = wire(vehicle(ARDUPILOT_MISSION_RULES))
    client.send("MISSION_COUNT", 1, 1, 1, FENCE)
    *texts, ack = send_item(client, circle[0], FENCE)
    assert [text.text for text in texts] == [
        "Non-positive circle radius",
        "Fence validation failed",
    ]
    acked(ack, MissionResult.ERROR, FENCE)


def test_an_item_beyond_the_count_is_an_invalid_sequence_and_an_early_one_waits(wire, vehicle):
    client = wire(vehicle())
    client.send("MISSION_COUNT", 1, 1, 3, MISSION)
    (ack,) = send_item(client, waypoint(3))
    acked(ack, MissionResult.INVALID_SEQUENCE)
    assert send_item(client, waypoint(2)) == []
    (request,) = send_item(client, waypoint(0))
    assert request.seq == 1


def test_a_request_beyond_the_end_is_an_invalid_sequence(wire, vehicle):
    client = wire(vehicle())
    (ack,) = client.send("MISSION_REQUEST_INT", 1, 1, 0, MISSION)
    acked(ack, MissionResult.INVALID_SEQUENCE)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("MISSION_COUNT", (2, 7)),
        ("MISSION_REQUEST_LIST", (7,)),
        ("MISSION_REQUEST_INT", (0, 7)),
        ("MISSION_CLEAR_ALL", (7,)),
    ],
)
def test_an_unknown_kind_of_plan_is_unsupported(wire, vehicle, name, values):
    (ack,) = wire(vehicle()).send(name, 1, 1, *values)
    acked(ack, MissionResult.UNSUPPORTED, 7)


# -- several clients ---------------------------------------------------------------------------------------------------


def test_a_second_client_is_refused_on_any_link_while_the_first_uploads(wire, vehicle, plans):
    first_link = vehicle()
    first = wire(first_link)
    first.send("MISSION_COUNT", 1, 1, 3, MISSION)
    others = (wire(first_link, client=(1, 195)), wire(vehicle(), client=(1, 195)))
    for other, stray_answers in zip(others, (0, 1), strict=True):
        (ack,) = other.send("MISSION_COUNT", 1, 1, 1, MISSION)
        assert (ack.type, ack.target_system, ack.target_component) == (MissionResult.ERROR, 1, 195)
        (ack,) = other.send("MISSION_CLEAR_ALL", 1, 1, MISSION)
        assert ack.type == MissionResult.ERROR
        assert len(send_item(other, waypoint(0))) == stray_answers
    (ack,) = wire(vehicle(ARDUPILOT_MISSION_RULES)).send(
        "MISSION_WRITE_PARTIAL_LIST", 1, 1, 0, 0, MISSION
    )
    acked(ack, MissionResult.ERROR)
    for seq in range(3):
        answers = send_item(first, waypoint(seq))
    acked(answers[0], MissionResult.ACCEPTED)
    acked(upload(wire(vehicle()), [waypoint(0)]), MissionResult.ACCEPTED)


def test_a_link_that_vanished_in_an_upload_does_not_block_the_others_for_ever(wire, vehicle, plans):
    wire(vehicle()).send("MISSION_COUNT", 1, 1, 3, MISSION)
    other = wire(vehicle())
    other.now_s = PX4_MISSION_RULES.timeout_s + 0.1
    acked(upload(other, [waypoint(0)]), MissionResult.ACCEPTED)


def test_items_of_another_kind_do_not_disturb_an_upload(wire, vehicle):
    client = wire(vehicle())
    client.send("MISSION_COUNT", 1, 1, 1, MISSION)
    assert send_item(client, waypoint(0, frame=0, command=5003, p1=9.0), FENCE) == []
    acked(send_item(client, waypoint(0))[0], MissionResult.ACCEPTED)


# -- clearing, part of a list, current item ----------------------------------------------------------------------------


def test_clearing_one_kind_or_all(wire, vehicle, plans):
    client = wire(vehicle())
    circle = waypoint(0, frame=0, command=5003, p1=9.0)
    upload(client, [waypoint(0)])
    upload(client, [circle], FENCE)
    acked(client.send("MISSION_CLEAR_ALL", 1, 1, MISSION)[0], MissionResult.ACCEPTED)
    assert (plans.mission.items, len(plans.fence.items)) == ((), 1)
    acked(client.send("MISSION_CLEAR_ALL", 1, 1, ALL)[0], MissionResult.ACCEPTED, ALL)
    assert (plans.fence.items, plans.fence.opaque_id) == ((), 0)


def test_a_count_of_zero_clears(wire, vehicle, plans):
    client = wire(vehicle())
    upload(client, [waypoint(0)])
    acked(client.send("MISSION_COUNT", 1, 1, 0, MISSION)[0], MissionResult.ACCEPTED)
    assert plans.mission.items == ()


def test_a_new_mission_starts_at_its_first_item(wire, vehicle, plans):
    client = wire(vehicle())
    upload(client, [waypoint(seq) for seq in range(4)])
    plans.current = 3
    upload(client, [waypoint(0)])
    assert plans.current == 0


def test_ardupilot_replaces_a_part_and_px4_refuses_to(wire, vehicle, plans):
    client = wire(vehicle(ARDUPILOT_MISSION_RULES))
    upload(client, [waypoint(seq) for seq in range(5)])
    (request,) = client.send("MISSION_WRITE_PARTIAL_LIST", 1, 1, 1, 2, MISSION)
    assert request.seq == 1
    (request,) = send_item(client, waypoint(1, z=99.0))
    assert request.seq == 2
    acked(send_item(client, waypoint(2, z=98.0))[0], MissionResult.ACCEPTED)
    assert [item.z for item in plans.mission.items] == [20.0, 99.0, 98.0, 20.0, 20.0]
    for first, last in ((3, 5), (-1, 2), (3, 2)):
        acked(
            client.send("MISSION_WRITE_PARTIAL_LIST", 1, 1, first, last, MISSION)[0],
            MissionResult.ERROR,
        )
    client.send("MISSION_WRITE_PARTIAL_LIST", 1, 1, 0, 0, MISSION)
    acked(send_item(client, waypoint(0, z=97.0))[0], MissionResult.ACCEPTED)
    assert [item.z for item in plans.mission.items] == [97.0, 99.0, 98.0, 20.0, 20.0]
    (ack,) = wire(vehicle(PX4_MISSION_RULES)).send(
        "MISSION_WRITE_PARTIAL_LIST", 1, 1, 0, 0, MISSION
    )
    acked(ack, MissionResult.UNSUPPORTED)


def test_the_choice_of_the_current_item_goes_to_the_autopilot(wire, vehicle):
    asked = []

    def set_current(now_s, seq):
        asked.append((now_s, seq))
        return [("MISSION_CURRENT", seq, 9, 0, 0)]

    (current,) = wire(vehicle(set_current=set_current)).send("MISSION_SET_CURRENT", 1, 1, 4)
    assert (asked, current.seq) == ([(0.0, 4)], 4)


def test_another_message_is_no_mission(wire, vehicle):
    client = wire(vehicle())
    assert client.send("PING", 1, 1, 0, 0) == []
    assert client.wait(1.0) == []


@pytest.mark.parametrize(
    ("frame", "x", "integer"),
    [
        (3, -47.5, -475_000_000),
        (1, -2.5, -25_000),
        (2, -7.0, -7),
        (3, -1e30, -(2**31)),
        (3, 1e30, 2**31 - 2),
    ],
)
def test_a_float_coordinate_becomes_the_integer_of_its_frame(frame, x, integer):
    message = dialect.MAVLink_mission_item_message(
        1, 1, 0, frame, 16, 0, 1, 0.0, 0.0, 0.0, 0.0, x, math.nan, 1.0, 0
    )
    assert (read_item(message).x, read_item(message).y) == (integer, 2**31 - 1)


def test_a_circle_may_be_small_and_an_empty_plan_has_no_id(wire, vehicle, plans):
    acked(
        upload(wire(vehicle()), [waypoint(0, frame=0, command=5003, p1=0.5)], FENCE),
        MissionResult.ACCEPTED,
        FENCE,
    )
    assert plans.fence.opaque_id != 0
    plans.set_plan(PlanKind.FENCE, ())
    assert plans.fence.opaque_id == 0


def test_coordinates_of_a_plan_item_are_degrees_or_open():
    item = PlanItem(*waypoint(0, x=-475_000_000, y=2**31 - 1))
    assert item.latitude_deg == pytest.approx(-47.5)
    assert math.isnan(item.longitude_deg)
