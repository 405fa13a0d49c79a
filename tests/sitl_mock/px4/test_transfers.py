"""Plans of PX4 as clients get them back, and transfers that clients do not end."""

import pytest

RALLY = 2


def upload(flight, kind, *items):
    flight.send("MISSION_COUNT", 1, 1, len(items), kind)
    for seq, (frame, command) in enumerate(items):
        place = (473977420, 85455940 + 1000 * seq, 20.0)
        item = (seq, frame, command, 0, 1, *(0.0,) * 4, *place, kind)
        flight.run(0.1)
        flight.send("MISSION_ITEM_INT", 1, 1, *item)
    flight.run(0.1)


def test_rally_points_come_back_in_whole_degrees_and_the_first_is_current(fly):
    flight = fly("px4").run(1.0)
    upload(flight, RALLY, (3, 5100), (3, 5100))
    flight.send("MISSION_REQUEST_LIST", 1, 1, RALLY)
    for seq in (0, 1):
        flight.send("MISSION_REQUEST_INT", 1, 1, seq, RALLY)
        flight.run(0.1)
    items = [message for _, message in flight.all("MISSION_ITEM_INT")]
    assert [(item.seq, item.frame, item.current) for item in reversed(items)] in (
        [(0, 6, 1), (1, 6, 0)],
        [(1, 6, 0), (0, 6, 1)],
    )


@pytest.mark.parametrize("begin", ["MISSION_COUNT", "MISSION_REQUEST_LIST"])
@pytest.mark.parametrize("flavour", ["px4", "arducopter"])
def test_px4_says_when_a_client_leaves_a_transfer(fly, flavour, begin):
    flight = fly(flavour, texts=True, ready_after_s=0.5).run(1.0)
    upload(flight, 0, (3, 16), (3, 16))
    begun_s = flight.now_s
    if begin == "MISSION_COUNT":
        flight.send("MISSION_COUNT", 1, 1, 3, 0)
    else:
        flight.send("MISSION_REQUEST_LIST", 1, 1, 0)
    flight.run(9.0)
    said = [
        (at_s - begun_s, message.severity)
        for at_s, message in flight.all("STATUSTEXT", begun_s)
        if message.text == "Operation timeout\t"
    ]
    if flavour == "px4":
        assert said == [(pytest.approx(5.0, abs=0.2), 2)]
    else:
        assert not said


def test_a_finished_transfer_is_not_given_up(fly):
    flight = fly("px4", texts=True).run(1.0)
    upload(flight, 0, (3, 16), (3, 16))
    flight.send("MISSION_REQUEST_LIST", 1, 1, 0)
    flight.send("MISSION_ACK", 1, 1, 0, 0)
    flight.run(9.0)
    assert not [m for _, m in flight.all("STATUSTEXT") if m.text.startswith("Operation")]
