"""The status predicts the answer to every order, and log and record name the sender of an order."""

import getpass
import re

import pytest

from guidance.flight import ORDERS, State
from guidance.log.entries import ORDERED
from guidance.log.writer import Record
from guidance.session.orders.mailbox import ANSWER_LIMIT_S
from guidance.session.orders.words import (
    LONGEST_NAME,
    REPLY_TIMEOUT_S,
    TEAM_ANSWER_LIMIT_S,
    TEAM_TIMEOUT_S,
    WORDS,
    name_in,
    own_name,
)


class KeptRecord(Record):
    """A record that keeps its events."""

    def __init__(self):
        super().__init__()
        self.events = []

    def event(self, now_s, event, detail=""):
        self.events.append((event, detail))


def refused_are_refused_for_that_reason(base):
    """Give every order that the status says would be refused; return those that would be accepted."""
    accepted = []
    for order, reason in base.order("status")["refused_orders"].items():
        if not reason:
            accepted.append(order)
            continue
        answer = base.order(order)
        assert not answer["accepted"]
        # Missing inputs may arrive meanwhile and ages grow; the rest of the text must be equal.
        assert re.split(r"[:\d]", answer["reason"])[0] == re.split(r"[:\d]", reason)[0]
    return accepted


def test_the_status_foresees_every_answer_in_every_state_of_a_flight(base):
    """Catches a status that foretells another answer than the order gets."""
    base = base()
    met = {}

    def look():
        met[base.state] = refused_are_refused_for_that_reason(base)

    base.cycle()
    look()
    base.until(State.READY)
    look()
    for order, states in (
        ("start", (State.ARMING, State.CLIMBING, State.STANDING_BY)),
        ("engage", (State.ENTERING, State.ENGAGED)),
        ("hold", (State.HOLDING,)),
        ("engage", (State.ENGAGED,)),
        ("land", (State.LANDING, State.LANDED)),
    ):
        assert order in met[base.state]
        assert base.order(order)["accepted"]
        for state in states:
            base.until(state)
            look()
    assert met[State.CHECKING] == ["abort"]
    assert met[State.READY] == ["abort", "start"]
    assert met[State.STANDING_BY] == ["abort", "engage", "hold", "land", "return"]
    assert met[State.ENGAGED] == ["abort", "hold", "land", "return"]
    assert met[State.LANDED] == []
    assert set(met[State.STANDING_BY]) < set(map(str, ORDERS)) < set(WORDS)


def test_an_evader_that_falls_silent_stands_against_engaging(base):
    """Catches a status that promises an engagement which would be refused."""
    base = base.standing_by()
    base.prey_silent = True
    base.run(3.0)
    assert base.order("status")["refused_orders"]["engage"].startswith("the evader was last heard ")
    assert "engage" not in refused_are_refused_for_that_reason(base)


def test_what_is_missing_is_listed_with_what_to_do_about_it(base):
    """Catches a row without advice in the list of what is to do."""
    base = base(parameters={})
    base.run(0.1)
    rows = {row["name"]: row for row in base.order("status")["to_do"]}
    assert rows["Home"]["advice"].startswith("wait for a position fix")
    assert rows["Home"]["verdict"] == "refuse"
    base.run(20.0)
    rows = {row["name"]: row for row in base.order("status")["to_do"]}
    fence = rows["GF_MAX_HOR_DIST"]
    assert (fence["verdict"], fence["advice"][:27]) == ("refuse", "param set GF_MAX_HOR_DIST 1")
    assert all(row["advice"] for row in rows.values())


def test_who_gave_an_order_is_kept_in_log_and_record_with_what_was_answered(base):
    record = KeptRecord()
    base = base(record=record).until(State.READY)
    for word, by in (
        ("engage", "panel, Ana"),
        ("start", "ctl, ben"),
        ("status", "panel"),
        ("hold", ""),
    ):
        base.mailbox.ask(word, by)
        base.cycle()
    told = [detail for event, detail in record.events if event == ORDERED]
    assert told[0].startswith("engage by panel, Ana: on the ground: order start first")
    assert told[1] == "start by ctl, ben: accepted"
    assert len(told) == 2
    by = [fields.get("by") for _, message, fields in base.log.lines if message == "order"]
    assert by[:2] == ["panel, Ana", "ctl, ben"]


@pytest.mark.parametrize(
    ("data", "name"),
    [
        (b"panel, Ana", "panel, Ana"),
        (b"", ""),
        ("Zoë".encode(), "Zoë"),
        (b"two\nlines\x00\x1b[31m", "twolines[31m"),
        (b"\xff\xfe", "\N{REPLACEMENT CHARACTER}" * 2),
        (b"x" * 10_000, "x" * LONGEST_NAME),
    ],
)
def test_a_name_from_the_wire_is_printable_and_bounded(data, name):
    assert name_in(data) == name


@pytest.mark.parametrize("error", [KeyError, OSError])
def test_a_user_without_a_name_is_named_by_the_program(monkeypatch, error):
    def getuser():
        raise error

    monkeypatch.setattr(getpass, "getuser", getuser)
    assert own_name("ctl") == "ctl"


def test_who_waits_for_a_team_waits_longer_than_its_vehicles_may_take_twice():
    assert ANSWER_LIMIT_S < TEAM_ANSWER_LIMIT_S < REPLY_TIMEOUT_S
    assert TEAM_TIMEOUT_S >= 2.0 * TEAM_ANSWER_LIMIT_S + 1.0
