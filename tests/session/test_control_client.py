"""The client of orders on a bus that the test answers: whom it asks, what it reads, and what it says of silence."""

import json
from types import SimpleNamespace

import pytest
import zenoh

from guidance.errors import ConfigError, LinkError
from guidance.links.zenoh.credentials import Credentials
from guidance.session.orders import control_client
from guidance.session.orders.control_client import (
    answers,
    ask,
    control_key,
    join_session,
    order_team,
    replies,
    say_alive,
)
from guidance.session.orders.control_token import ControlToken
from guidance.session.orders.replies import MAX_REPLY_BYTES
from guidance.session.orders.words import REPLY_TIMEOUT_S

ENDPOINT = "tcp/127.0.0.1:7448"


class Payload(bytes):
    def to_bytes(self):
        return bytes(self)


def reply_of(name, order, data):
    return SimpleNamespace(
        ok=SimpleNamespace(key_expr=control_key(name, order), payload=Payload(data))
    )


class Bus:
    """A session with vehicles that answer what the test says; it keeps what was asked.

    An answer is a record, the bytes of a reply, or None for a vehicle that does not answer.
    """

    def __init__(self, **vehicles):
        self.vehicles = vehicles
        self.asked = []

    def get(self, key, *handlers, timeout, target=None, payload=None):
        self.asked.append((key, *handlers, timeout, target, payload))
        name, _, order = key.partition("?")[0].split("/")[1:]
        yielded = [SimpleNamespace(ok=None)]
        for vehicle, answer in self.vehicles.items():
            data = answer
            if isinstance(answer, dict):
                data = json.dumps({"accepted": True, **answer}).encode()
            if data is not None and name in {"*", vehicle}:
                yielded.append(reply_of(vehicle, order, data))
        return yielded

    @property
    def orders(self):
        """The name and the order of every query."""
        return [tuple(key.partition("?")[0].split("/")[1::2]) for key, *_ in self.asked]


def asked_of(key, timeout_s, payload):
    return (key, timeout_s, zenoh.QueryTarget.ALL, payload)


def test_an_order_goes_to_the_vehicle_that_is_named_with_its_sender_and_its_time_limit():
    bus = Bus(uav1={"state": "holding"}, uav2={})
    answer = ask(bus, "hold", "uav1", endpoint=ENDPOINT, by="Ana", timeout_s=1.5)
    assert (answer["name"], answer["order"], answer["state"]) == ("uav1", "hold", "holding")
    assert ask(bus, "land", "uav1", endpoint=ENDPOINT)["order"] == "land"
    assert bus.asked == [
        asked_of("guidance/uav1/ctl/hold", 1.5, b"Ana"),
        asked_of("guidance/uav1/ctl/land", REPLY_TIMEOUT_S, None),
    ]


def test_an_order_without_a_name_goes_to_the_only_vehicle_and_never_to_all():
    bus = Bus(uav1={})
    assert ask(bus, "hold", None, endpoint=ENDPOINT, timeout_s=1.5)["name"] == "uav1"
    assert bus.asked == [
        asked_of("guidance/*/ctl/status", 1.5, None),
        asked_of("guidance/uav1/ctl/hold", 1.5, None),
    ]
    several = Bus(uav2={}, uav1={})
    with pytest.raises(ConfigError, match=f"which vehicle. daemons at {ENDPOINT}: uav1, uav2"):
        ask(several, "hold", None, endpoint=ENDPOINT)
    assert several.orders == [("*", "status")]


@pytest.mark.parametrize(
    ("name", "words"),
    [(None, f"{ENDPOINT}: no daemon"), ("uav1", f"uav1 at {ENDPOINT}: no answer within 1.5 s")],
)
def test_a_silent_bus_is_named(name, words):
    with pytest.raises(LinkError, match=words):
        ask(Bus(uav1=None), "hold", name, endpoint=ENDPOINT, timeout_s=1.5)


def test_every_other_order_goes_to_the_team_at_once_and_names_who_is_silent():
    bus = Bus(uav2={"vehicles": ["uav1", "uav2", "uav3", "no name/"]}, uav1={"state": "holding"})
    answered = order_team(bus, "hold", "north", (), by="Ana", timeout_s=1.5)
    assert bus.asked == [asked_of("guidance/*/ctl/hold?team=north", 1.5, b"Ana")]
    assert [(answer["name"], answer["accepted"]) for answer in answered] == [
        ("uav1", True),
        ("uav2", True),
        ("uav3", False),
    ]
    assert answered[0]["state"] == "holding"
    assert answered[2] == {
        "accepted": False,
        "name": "uav3",
        "order": "hold",
        "state": "not heard",
        "reason": "no answer in 1.5 s",
    }


def test_the_named_vehicles_of_a_team_are_asked_each_and_no_other_one_is_told_of():
    bus = Bus(uav1={"vehicles": ["uav1", "uav2", "uav3"]})
    answered = order_team(bus, "hold", "north", ("uav2", "uav1"))
    assert bus.asked == [
        asked_of("guidance/uav2/ctl/hold?team=north", REPLY_TIMEOUT_S, None),
        asked_of("guidance/uav1/ctl/hold?team=north", REPLY_TIMEOUT_S, None),
    ]
    assert [(answer["name"], answer["accepted"]) for answer in answered] == [
        ("uav1", True),
        ("uav2", False),
    ]


def test_a_team_that_does_not_answer_is_named():
    with pytest.raises(LinkError, match="--team north: no vehicle of it answers"):
        order_team(Bus(uav1=None), "hold", "north", ())


def test_no_order_waits_for_more_than_64_vehicles():
    names = [f"uav{number:03d}" for number in range(70)]
    answered = order_team(Bus(uav000={"vehicles": names}), "hold", "north", ())
    assert [answer["name"] for answer in answered] == names[:64]


@pytest.mark.parametrize("order", ["start", "engage"])
def test_a_team_starts_or_engages_only_if_every_vehicle_would_follow(order):
    follows = {"state": "ready", "refused_orders": {order: ""}}
    bus = Bus(uav1=follows, uav2=follows)
    assert [answer["order"] for answer in order_team(bus, order, "north", ())] == [order] * 2
    assert bus.orders == [("*", "status"), ("*", order)]


@pytest.mark.parametrize(
    ("status", "reason"),
    [
        ({"state": "checking", "refused_orders": {"start": "no home"}}, "no home"),
        ({"state": "off", "reason": "it is off", "refused_orders": {"start": ""}}, "it is off"),
        ({"state": "older"}, "its status does not say whether it would follow"),
        (
            {"state": "newer", "refused_orders": {}},
            "its status does not say whether it would follow",
        ),
    ],
)
def test_a_vehicle_that_would_not_start_keeps_the_team_on_the_ground_and_says_why(status, reason):
    bus = Bus(
        uav1={"state": "ready", "refused_orders": {"start": ""}},
        uav2=status,
        uav3={"refused_orders": {"start": "no link"}},
    )
    assert order_team(bus, "start", "north", ()) == [
        {
            "accepted": False,
            "name": name,
            "order": "start",
            "state": state,
            "reason": words,
        }
        for name, state, words in (
            ("uav1", "ready", "waits for uav2, uav3"),
            ("uav2", status["state"], reason),
            ("uav3", "", "no link"),
        )
    ]
    assert bus.orders == [("*", "status")]


@pytest.mark.parametrize(("name", "team"), [("uav/1", ""), ("uav1", "no/rth")])
def test_nobody_is_asked_by_a_name_that_no_vehicle_can_have(name, team):
    bus = Bus(uav1={})
    with pytest.raises(ConfigError, match=r"(--name 'uav/1'|--team 'no/rth'): a name has up to"):
        answers(bus, name, "hold", 1.0, team=team)
    assert bus.asked == []


def test_one_answer_of_each_vehicle_that_was_asked_is_read_and_a_bad_one_is_its_refusal():
    class Chatty(Bus):
        """It repeats every answer, and others answer too."""

        def get(self, key, *handlers, timeout, target=None, payload=None):
            replied = super().get(key, *handlers, timeout=timeout, target=target, payload=payload)
            return [
                *replied,
                *replied,
                reply_of("no name", "status", b"{}"),
                reply_of("uav9", "status", b'{"accepted": true}'),
            ]

    bus = Chatty(uav1=b"5", uav2=b" " * (MAX_REPLY_BYTES + 1), uav3=b'{"accepted": true}')
    told = {answer["name"]: answer for answer in answers(bus, "*", "status", 1.0)}
    assert list(told) == ["uav1", "uav2", "uav3", "uav9"]
    assert "it is not a JSON object" in told["uav1"]["reason"]
    assert f"({MAX_REPLY_BYTES + 1} bytes)" in told["uav2"]["reason"]
    assert told["uav2"]["order"] == "status"
    assert told["uav3"]["accepted"]
    assert [answer["name"] for answer in answers(bus, "uav3", "status", 1.0)] == ["uav3"]
    largest = b'{"accepted": true}'.ljust(MAX_REPLY_BYTES)
    (answer,) = answers(Bus(uav1=largest), "uav1", "status", 1.0)
    assert answer["accepted"]


def test_who_only_looks_asks_without_a_sender_and_whatever_the_team():
    bus = Bus(uav1={})
    assert [answer["name"] for answer in replies(bus, "*", "status", 1.0)] == ["uav1"]
    assert bus.asked == [asked_of("guidance/*/ctl/status", 1.0, None)]


def test_a_sign_of_life_waits_for_no_answer():
    bus = Bus()
    say_alive(bus, "uav1")
    ((key, heard, timeout_s, _, _),) = bus.asked
    assert (key, timeout_s) == ("guidance/uav1/ctl/alive", REPLY_TIMEOUT_S)
    assert heard(None) is None


@pytest.fixture
def opening(monkeypatch):
    """Sessions are not opened: each attempt is kept, and fails if the test says so."""
    attempts = SimpleNamespace(made=[], fails=False)

    def opened(endpoint, *, timeout_s, credentials):
        attempts.made.append((endpoint, timeout_s, credentials))
        if attempts.fails:
            raise LinkError("nobody is there")
        return "session"

    monkeypatch.setattr(control_client, "open_session", opened)
    return attempts


def test_a_bus_is_joined_with_the_token_of_its_daemon_or_by_a_certificate(opening, tmp_path):
    path = tmp_path / "uav1.token"
    assert join_session(ENDPOINT, path) == "session"
    token = ControlToken(path, "ab" * 32)
    path.write_text(f"guidance:{token.secret}")
    assert join_session(ENDPOINT, path, timeout_s=1.5) == "session"
    certified = Credentials(tls={"root_ca_certificate": "ca.pem"})
    assert join_session(ENDPOINT, path, certified, timeout_s=2.5) == "session"
    assert opening.made == [
        (ENDPOINT, 3.0, Credentials(auth=None)),
        (ENDPOINT, 1.5, Credentials(auth=token.auth())),
        (ENDPOINT, 2.5, certified),
    ]


def test_the_token_in_its_usual_place_is_shown(opening, tmp_path, monkeypatch):
    path = tmp_path / "usual.token"
    path.write_text("guidance:" + "cd" * 32)
    monkeypatch.setattr(control_client, "token_path", {ENDPOINT: path}.get)
    join_session(ENDPOINT)
    assert opening.made == [(ENDPOINT, 3.0, Credentials(auth=ControlToken(path, "cd" * 32).auth()))]


def test_a_bus_that_cannot_be_joined_is_named_with_the_token_that_was_shown(opening, tmp_path):
    opening.fails = True
    path = tmp_path / "uav1.token"
    with pytest.raises(LinkError, match=f"control {ENDPOINT}: no session within 1.5 s: .*no token"):
        join_session(ENDPOINT, path, timeout_s=1.5)
    path.write_text("guidance:" + "ab" * 32)
    with pytest.raises(LinkError, match=f"the token in {path} was shown"):
        join_session(ENDPOINT, path)
