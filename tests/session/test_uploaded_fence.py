"""A fence on the autopilot that is unknown, unjudged or new never lets the vehicle fly into it."""

import pytest
from pymavlink.dialects.v20 import common as mavlink

from guidance.flight import State
from guidance.session.orders.mailbox import READ_WITHIN_S
from tests.harness.vehicle import FENCED
from tests.session.conftest import HERE

FENCED_ARDUCOPTER = {
    "FENCE_ENABLE": 1, "FENCE_RADIUS": 230, "FENCE_ALT_MAX": 90, "FENCE_TYPE": 7, "GUID_TIMEOUT": 1,
}  # fmt: skip
SET_UP = {
    "px4": {"parameters": FENCED},
    "arducopter": {"parameters": FENCED_ARDUCOPTER, "vehicle": {"autopilot": "arducopter"}},
}
POLYGON = 5001
SQUARE = ((1, 1), (1, -1), (-1, -1), (-1, 1))


def around(size_m, corners=SQUARE):
    """Mission items of a polygon: corners in multiples of a size about the field."""
    places = [
        (HERE.lat_deg + north * size_m / 111_320.0, HERE.lon_deg + east * size_m / 75_400.0)
        for north, east in corners
    ]
    return [(POLYGON, len(places), place) for place in places]


def upload(one, items):
    """A ground station uploads a fence."""
    ground = mavlink.MAVLink(None, 255, 190)

    def send(message):
        one.injected.append(message.pack(ground))
        one.run(0.06)

    send(mavlink.MAVLink_mission_count_message(1, 1, len(items), 1))
    for sequence, (command, size, (latitude, longitude)) in enumerate(items):
        place = round(latitude * 1e7), round(longitude * 1e7)
        send(
            mavlink.MAVLink_mission_item_int_message(
                1, 1, sequence, 0, command, 0, 1, size, 0, 0, 0, *place, 0, 1
            )
        )


def without_parameters(one, names):
    """From now on the autopilot does not have these parameters."""
    step = one.vehicle.step

    def heard(frame):
        message = mavlink.MAVLink(None).decode(bytearray(frame))
        return message.get_type() != "PARAM_VALUE" or message.param_id not in names

    one.vehicle.step = lambda now_s, frames=(): [
        frame for frame in step(now_s, frames) if heard(frame)
    ]


def fence_row(one):
    (row,) = [row for row in one.daemon.survey.rows if row.name == "uploaded fence"]
    return row


@pytest.mark.parametrize(
    ("autopilot", "hidden"), [("arducopter", "RTL_ALT"), ("px4", "COM_RCL_EXCEPT")]
)
def test_a_tight_fence_is_read_although_another_parameter_does_not_exist(base, autopilot, hidden):
    """Catches a fence that is not read behind a missing parameter."""
    one = base(**SET_UP[autopilot])
    without_parameters(one, {hidden})
    one.run(1.0)
    upload(one, around(12.0))
    one.run(16.0)
    assert (fence_row(one).value, fence_row(one).verdict) == ("polygon of 4", "refuse")
    unread = next(row for row in one.daemon.survey.rows if row.name == hidden)
    assert (unread.value, unread.verdict) == ("not read", "refuse")
    assert not one.order("start")["accepted"]


@pytest.mark.parametrize("autopilot", SET_UP)
def test_a_fence_uploaded_while_standing_by_is_judged_before_the_game(base, autopilot):
    """Catches a fence that came after the start and is flown into."""
    one = base.standing_by(**SET_UP[autopilot])
    upload(one, around(12.0))
    answer = one.order("engage")
    assert not answer["accepted"]
    assert "uploaded fence is polygon of 4" in answer["reason"]
    upload(one, around(400.0))
    assert one.order("engage")["accepted"]
    one.until(State.ENGAGED)


def test_a_fence_that_does_not_answer_refuses_the_game_in_time(base):
    """Catches an engagement by a fence that was not read again."""
    one = base.standing_by()
    step = one.vehicle.step
    one.vehicle.step = lambda now_s, frames=(): [
        frame
        for frame in step(now_s, frames)
        if frame[7] != 44  # MISSION_COUNT
    ]
    asked_s = one.now_s
    answer = one.order("engage")
    assert "uploaded fence is not read again: no answer" in answer["reason"]
    assert one.now_s - asked_s < READ_WITHIN_S + 0.1


def over_a_slow_link(one, by_s):
    """From now on items of the fence arrive so much later."""
    step = one.vehicle.step
    late = []

    def slow(now_s, frames=()):
        out = []
        for frame in step(now_s, frames):
            if frame[7] == 73:  # MISSION_ITEM_INT
                late.append((now_s + by_s, frame))
            else:
                out.append(frame)
        out += [frame for due_s, frame in late if due_s <= now_s]
        late[:] = [(due_s, frame) for due_s, frame in late if due_s > now_s]
        return out

    one.vehicle.step = slow


def test_a_fence_too_large_for_one_order_is_read_on_and_serves_the_next(base):
    """Catches a download that each order begins anew and none finishes."""
    ring = [(north / 5.0, 1.0) for north in range(-5, 6)]
    ring += [(-north, -east) for north, east in ring]
    one = base.standing_by()
    upload(one, around(400.0, ring))
    over_a_slow_link(one, 0.1)
    answer = one.order("engage")
    assert not answer["accepted"]
    assert "of 22 items so far" in answer["reason"]
    one.run(2.0)
    assert one.order("engage")["accepted"]
    one.until(State.ENGAGED)
    one.order("hold")
    one.until(State.HOLDING)
    assert not one.order("engage")["accepted"]  # each engagement has its own download
