"""Replies of daemons are checked alone: a bad one is a refusal in the name of its sender, and raises nothing."""

import json
import math
import random

import pytest

from guidance.cli import print_answer
from guidance.cli.daemon import status_table
from guidance.screen import console
from guidance.session.orders.replies import BAD_REPLY, MAX_REPLY_BYTES, is_bad, read_reply, written
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
    answer = read_reply(data, "uav2", "hold" if b"accepted" not in data else "status")
    assert is_bad(answer)
    assert answer["name"] == "uav2"
    assert not answer["accepted"]
    assert answer["state"] == BAD_REPLY
    assert reason in answer["reason"]


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
