"""A daemon that answers wrongly, on the bus of others: its fault is named, and the others are ordered and shown."""

import contextlib
import itertools
import json
import threading

import pytest

from guidance.clock import MonotonicClock
from guidance.links.zenoh.credentials import NO_CREDENTIALS
from guidance.log.broadcast import FLIGHT, broadcast_key
from guidance.session.orders.control_bus import free_endpoint
from guidance.session.orders.control_client import control_key, join_session, order_team
from guidance.session.orders.mailbox import Mailbox
from guidance.session.orders.socket_client import ask_team_here
from guidance.session.orders_section import Control
from guidance.viz.panel.hub import DaemonBus, Hub
from tests.harness.bus import ControlBus

pytestmark = pytest.mark.slow

BAD = {
    "another's name": b'{"accepted": true, "name": "uav1", "state": "holding", "vehicles": []}',
    "a number": b"5",
    "a list": b"[]",
    "no JSON": b"\xff",
    "deep": b"[" * 100_000,
    "NaN": b'{"accepted": true, "battery": NaN}',
    "wrong types": b'{"accepted": true, "vehicles": 5, "refused_orders": []}',
}


@pytest.fixture
def healthy(tmp_path):
    """The vehicle uav1 of the team north, which hosts the endpoint and follows orders; it notes them."""
    endpoint = free_endpoint()
    token = tmp_path / "token"
    mailbox = Mailbox()
    orders = []

    def follow(order):
        if order != "status":
            orders.append(order)
        return {"accepted": True, "order": order, "state": "ready", "refused_orders": {}}

    mailbox.meanwhile = follow
    control = Control(endpoint=endpoint, host=True, token_file=token)
    bus = ControlBus("uav1", mailbox, control, team="north", mates=["uav2"])
    yield endpoint, token, orders
    bus.close()


@contextlib.contextmanager
def answering(endpoint, token, data):
    """The vehicle uav2, whose daemon answers every query with `data`."""

    def reply(query):
        word = str(query.key_expr).rpartition("/")[2]
        key = broadcast_key("uav2", FLIGHT) if word == FLIGHT else control_key("uav2", word)
        query.reply(key, data)
        query.drop()

    with join_session(endpoint, token) as session:
        for key in (control_key("uav2", "*"), broadcast_key("uav2", FLIGHT)):
            session.declare_queryable(key, reply)
        yield


@pytest.mark.parametrize("data", BAD.values(), ids=BAD)
def test_an_order_to_the_team_is_given_and_each_answer_is_that_of_its_sender(healthy, data):
    endpoint, token, orders = healthy
    with answering(endpoint, token, data), join_session(endpoint, token) as session:
        for answers in (
            order_team(session, "hold", "north", (), timeout_s=2.0),
            ask_team_here("hold", "north", (), endpoint=endpoint, token_file=token),
        ):
            uav1, uav2 = answers
            assert (uav1["name"], uav1["accepted"], uav1["state"]) == ("uav1", True, "ready")
            assert uav2["name"] == "uav2"
            if b'"uav1"' not in data:
                assert not uav2["accepted"]
                assert "uav2" not in uav2["reason"]
                assert "take over by radio" in uav2["reason"]
        assert orders == ["hold", "hold"]
        start = ask_team_here("start", "north", (), endpoint=endpoint, token_file=token)
        assert [answer["accepted"] for answer in start] == [False, False]
        assert orders == ["hold", "hold"]


@pytest.mark.parametrize("data", BAD.values(), ids=BAD)
def test_the_page_keeps_contact_with_the_others_and_gives_them_orders(healthy, data):
    endpoint, token, orders = healthy
    clock = MonotonicClock()
    bus = DaemonBus(endpoint, token, clock, NO_CREDENTIALS)
    hub = Hub([bus], clock)
    with answering(endpoint, token, data), contextlib.closing(hub):
        shown = {}
        for _ in itertools.count():
            hub.receive()
            message = json.loads(hub.message(whole=True))
            shown = {daemon["name"]: daemon for daemon in message["daemons"]}
            if shown.keys() == {"uav1", "uav2"}:
                break
            threading.Event().wait(0.01)
        assert bus.reason == ""
        assert shown["uav1"]["status"]["state"] == "ready"
        assert shown["uav1"]["fault"] == ""
        assert ("cannot be used" in shown["uav2"]["fault"]) is (b'"uav1"' not in data)
        hub.note_operator(shown["uav2"]["key"])
        assert hub.order(shown["uav1"]["key"], "hold", "Ana")[0]["accepted"]
        answers = hub.order(shown["uav1"]["key"], "land", "Ana", team=True)
        assert [answer["name"] for answer in answers] == ["uav1", "uav2"]
        assert orders == ["hold", "land"]
