"""Replies of daemons are checked alone: a bad one is a refusal in the name of its sender, and raises nothing."""

import json
import math
import random

import pytest

from guidance.cli import print_answer
from guidance.cli.daemon import status_table
from guidance.screen import console
from guidance.session.orders.replies import (
    BAD_REPLY,
    MAX_REPLY_BYTES,
    bad_reply,
    is_bad,
    is_vehicle_name,
    read_reply,
    refused,
    written,
)
from tests.harness.examples import drawn

STATUS = {
    "accepted": True,
    "order": "status",
    "name": "uav1",
    "state": "engaged",
    "mode": "OFFBOARD",
    "autopilot_mode": "Offboard",
    "armed": True,
    "streaming": True,
    "after_capture": "hold",
    "next": "",
    "recording": "on",
    "heartbeat_age_s": 0.1,
    "position_age_s": 0.02,
    "evader_silence_s": None,
    "operator_silence_s": None,
    "operator_timeout_s": None,
    "battery": 0.8,
    "height_m": 5.0,
    "position_ned_m": [1.0, 2.0, -5.0],
    "velocity_ned_m_s": [0.0, 0.1, 0.0],
    "range_m": 12.0,
    "value_unit": "s",
    "vehicles": ["uav1", "uav2"],
    "team": "north",
    "refused_orders": {"start": "under way already", "engage": ""},
    "to_do": [{"name": "a", "found": "b", "wanted": "c", "verdict": "warn", "advice": "d"}],
    "certificate": {"winner": "pursuer", "value": 3.0, "active_limits": ["floor"], "gap_m": 2.0},
    "assignment": {
        "evader": "rover1",
        "above_m": 0.0,
        "coordinator": "uav1",
        "over": [],
        "promises": [
            {"evader": "rover1", "standing": "kept", "words": "x", "first": "uav1", "second": None}
        ],
    },
}


def data_of(**changes):
    return json.dumps({**STATUS, **changes}).encode()


def test_a_good_status_is_kept_and_its_name_is_that_of_the_key():
    assert read_reply(data_of(), "uav1", "status") == STATUS
    assert read_reply(data_of(name="uav7"), "uav1", "status") == STATUS


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "it is not JSON"),
        (b"5", "it is not a JSON object"),
        (b"[]", "it is not a JSON object"),
        (b"null", "it is not a JSON object"),
        (b"{}", "accepted is missing"),
        (b"\xff", "it is not JSON"),
        (b"[" * 100_000, "it is not JSON"),
        (b'{"a":' * 20 + b"1" + b"}" * 20, "it is nested more than 8 deep"),
        (b"1" * 5000, "it is not JSON"),
        (b" " * (MAX_REPLY_BYTES + 1), f"{MAX_REPLY_BYTES + 1} bytes; at most"),
        (data_of(battery=math.nan), "a number in it is not finite"),
        (data_of(strange=[-math.inf]), "a number in it is not finite"),
        (data_of().replace(b"0.8", b"1e999"), "a number in it is not finite"),
        (data_of(battery=10**400), "an integer in it is larger than"),
        (data_of(strange=[[-(10**400)]]), "an integer in it is larger than"),
        (data_of(order="land"), "it answers another order"),
        (data_of(accepted="yes"), "accepted has a wrong type"),
        (data_of(vehicles=5), "vehicles has a wrong type"),
        (data_of(vehicles=["a"] * 1000), "a list in it has 1000 items"),
        (data_of(to_do=[5]), "to_do has a wrong type"),
        (data_of(refused_orders={"start": None}), "refused_orders has a wrong type"),
        (data_of(position_ned_m=[1.0, 2.0]), "position_ned_m has a wrong type"),
        (data_of(velocity_ned_m_s="x"), "velocity_ned_m_s has a wrong type"),
        (data_of(certificate={}), "certificate has a wrong type"),
        (
            data_of(height_m=5, certificate=STATUS["certificate"], range_m="x"),
            "range_m has a wrong type",
        ),
        (data_of(assignment={"evader": "x"}), "assignment has a wrong type"),
        (data_of(waiting_for="its vehicle"), "waiting_for without waited_s"),
    ],
)
def test_a_bad_reply_is_a_refusal_that_says_what_is_wrong(data, reason):
    order = "hold" if b"accepted" not in data else "status"
    answer = read_reply(data, "uav2", order)
    assert is_bad(answer)
    assert (answer["name"], answer["order"]) == ("uav2", order)
    assert not answer["accepted"]
    assert answer["state"] == BAD_REPLY
    assert reason in answer["reason"]


TO_DO = STATUS["to_do"][0]
ASSIGNMENT = STATUS["assignment"]
PROMISE = ASSIGNMENT["promises"][0]
TEXTS = ("state", "mode", "autopilot_mode", "next", "recording", "reason", "team", "after_capture")
NUMBERS = (
    "heartbeat_age_s", "position_age_s", "evader_silence_s", "operator_silence_s", "operator_timeout_s", "battery",
    "height_m", "range_m", "waited_s", "connect_timeout_s",
)  # fmt: skip
GAME_NUMBERS = ("value", "gap_m", "time_needed_s", "reachable_speed_m_s")


def without(record, name):
    return {key: value for key, value in record.items() if key != name}


def accepted_values():
    """Fields, with values of their types."""
    for name in (*TEXTS, "value_unit"):
        yield name, "x"
    for name in NUMBERS:
        yield from ((name, value) for value in (5, 0.5, None))
    for name in ("accepted", "armed", "streaming"):
        yield from ((name, value) for value in (True, False))
    for name in ("position_ned_m", "velocity_ned_m_s"):
        yield name, [1, None, 0.5]
    yield from (("vehicles", value) for value in ([], ["uav1"]))
    yield from (("refused_orders", value) for value in ({}, {"start": "no"}))
    yield from (("to_do", value) for value in ([], [TO_DO, {**TO_DO, "new": 5}]))
    yield from (("certificate", value) for value in (None, {"winner": "pursuer", "new": 5}))
    yield "certificate", {"winner": "x", "vehicle_winner": "x", "active_limits": ["floor"]}
    for name in GAME_NUMBERS:
        yield from (("certificate", {"winner": "x", name: value}) for value in (5, 0.5, None))
    yield "assignment", {**ASSIGNMENT, "over": ["rover2"], "promises": []}
    for name in ("first", "second"):
        for value in ("uav1", None):
            yield "assignment", {**ASSIGNMENT, "promises": [{**PROMISE, name: value}]}
    yield "assignment", {**ASSIGNMENT, "promises": [without(PROMISE, "first")]}
    yield "a field of a newer daemon", [None]


def refused_values():
    """Fields, with values of other types."""
    for name in (*TEXTS, "value_unit", "waiting_for"):
        yield from ((name, value) for value in (5, None, ["x"]))
    for name in NUMBERS:
        yield from ((name, value) for value in (True, "x", [5]))
    for name in ("accepted", "armed", "streaming"):
        yield from ((name, value) for value in (1, None, "yes"))
    for name in ("position_ned_m", "velocity_ned_m_s"):
        values = (None, 5, [1, 2], [1, 2, 3, 4], [1, 2, "x"], [1, 2, True])
        yield from ((name, value) for value in values)
    yield from (("vehicles", value) for value in (None, "x", [5]))
    yield from (("refused_orders", value) for value in (None, [], {"start": 5}))
    yield from (("to_do", value) for value in (None, TO_DO, [5]))
    for name in TO_DO:
        yield "to_do", [without(TO_DO, name)]
        yield "to_do", [{**TO_DO, name: 5}]
    yield from (("certificate", value) for value in ({}, 5, {"winner": None}))
    for name in GAME_NUMBERS:
        yield from (("certificate", {"winner": "x", name: value}) for value in (True, "x"))
    for name in ("vehicle_winner", "active_limits"):
        yield from (("certificate", {"winner": "x", name: value}) for value in (5, [5], None))
    yield from (("assignment", value) for value in (None, {}, []))
    for name in ("evader", "coordinator", "over", "promises"):
        yield "assignment", without(ASSIGNMENT, name)
        yield "assignment", {**ASSIGNMENT, name: 5}
        yield "assignment", {**ASSIGNMENT, name: [5]}
    for name in ("evader", "standing", "words"):
        yield "assignment", {**ASSIGNMENT, "promises": [without(PROMISE, name)]}
        yield "assignment", {**ASSIGNMENT, "promises": [{**PROMISE, name: None}]}
    for name in ("first", "second"):
        yield "assignment", {**ASSIGNMENT, "promises": [{**PROMISE, name: 5}]}


def test_every_field_that_a_display_uses_has_its_type():
    for field, value in accepted_values():
        answer = read_reply(data_of(**{field: value}), "uav1", "status")
        assert not is_bad(answer), (field, value, answer["reason"])
        assert answer[field] == value
    for field, value in refused_values():
        answer = read_reply(data_of(**{field: value}), "uav1", "status")
        assert is_bad(answer), (field, value)
        assert f"({field} has a wrong type)" in answer["reason"]


WAITING = {"waiting_for": "its vehicle", "waited_s": 2.5, "connect_timeout_s": 30.0}


def test_fields_that_are_shown_together_are_sent_together():
    whole = {**STATUS, **WAITING}
    assert not is_bad(read_reply(json.dumps(whole).encode(), "uav1", "status"))
    for field, others in (
        ("waiting_for", ("waited_s", "connect_timeout_s")),
        ("height_m", ("position_ned_m", "velocity_ned_m_s")),
        ("certificate", ("range_m", "value_unit")),
    ):
        for other in others:
            partly = without(whole, other)
            answer = read_reply(json.dumps(partly).encode(), "uav1", "status")
            assert f"({field} without {', '.join(others)})" in answer["reason"]
            alone = without(partly, field)
            assert not is_bad(read_reply(json.dumps(alone).encode(), "uav1", "status"))
    unknown = {**without(STATUS, "position_ned_m"), "height_m": None}
    assert not is_bad(read_reply(json.dumps(unknown).encode(), "uav1", "status"))


def nested(depth):
    return b'{"accepted": true, "x": ' + b"[" * (depth - 1) + b"]" * (depth - 1) + b"}"


@pytest.mark.parametrize(
    ("largest", "too_large", "reason"),
    [
        (nested(8), nested(9), "it is nested more than 8 deep"),
        (
            data_of(strange=[0] * 256),
            data_of(strange=[0] * 257),
            "a list in it has 257 items; at most 256 are read",
        ),
        (
            data_of(strange=[2**53, -(2**53)]),
            data_of(strange=2**53 + 1),
            "an integer in it is larger than 9007199254740992",
        ),
        (
            b'{"accepted": true}' + b" " * (262_144 - 18),
            b'{"accepted": true}' + b" " * (262_145 - 18),
            "262145 bytes; at most 262144 are read",
        ),
    ],
)
def test_a_reply_is_read_up_to_its_bounds(largest, too_large, reason):
    assert not is_bad(read_reply(largest, "uav1", "status"))
    assert f"({reason})" in read_reply(too_large, "uav1", "status")["reason"]


def test_a_reply_names_what_was_asked_and_who_was_asked():
    assert read_reply(b'{"accepted": true}', "uav1", "hold") == {
        "accepted": True,
        "name": "uav1",
        "order": "hold",
    }
    assert refused("uav1", "hold", "gone", "it is off") == {
        "accepted": False,
        "name": "uav1",
        "order": "hold",
        "state": "gone",
        "reason": "it is off",
    }
    assert is_bad(bad_reply("uav1", "hold", "it is not JSON"))
    assert not is_bad({"accepted": False})


@pytest.mark.parametrize(
    ("name", "allowed"),
    [("uav_1-A", True), ("a" * 32, True), ("a" * 33, False), ("", False), ("uav/1", False)],
)
def test_a_name_of_a_vehicle_has_up_to_32_letters_digits_and_dashes(name, allowed):
    assert is_vehicle_name(name) is allowed


def test_texts_of_a_reply_cannot_command_the_terminal_or_turn_the_line(capsys):
    text = "\x1b]0;owned\x07\u202eabc\ud800\r\n"
    refusal = {"accepted": False, "order": "hold", "state": text, "reason": text, text: text}
    answer = read_reply(json.dumps(refusal).encode(), "uav1", "hold")
    assert print_answer(answer) == 4
    said = capsys.readouterr().out
    assert "\\x1b]0;owned\\x07\\u202eabc\\ud800\\r\\n" in said
    assert said.strip().isprintable()


def test_any_change_of_a_status_is_refused_or_can_be_shown():
    """Each part of a status is replaced by values of other types: the table of `ctl status` shows what is accepted."""
    draw = random.Random(1)
    values = [None, True, 5, 10**400, 1e300, "x", [], {}, [None], {"a": {}}, [[1.0]], -1]
    accepted = 0
    for _ in range(drawn(4000)):
        document = json.loads(json.dumps(STATUS))
        for _ in range(draw.randint(1, 2)):
            part = document
            while isinstance(part, dict | list) and part:
                keys = list(part) if isinstance(part, dict) else range(len(part))
                key = draw.choice(keys)
                if draw.random() < 0.5 or not isinstance(part[key], dict | list):
                    part[key] = draw.choice(values)
                    break
                part = part[key]
        answer = read_reply(json.dumps(document).encode(), "uav1", "status")
        if not is_bad(answer):
            accepted += 1
            with console().capture():
                console().print(status_table(answer))
    assert accepted > drawn(400)


def test_what_a_daemon_writes_has_no_number_that_is_not_finite():
    assert json.loads(written({"a": math.nan, "b": [(math.inf, 1.0)]})) == {
        "a": None,
        "b": [[None, 1.0]],
    }
