"""Orders, answers and ownership over a real Zenoh session on loopback."""

import contextlib
import itertools
import json
import socket
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
import zenoh

from guidance.errors import ConfigError, LinkError
from guidance.links.zenoh.session import close_all
from guidance.session.orders import mailbox as orders
from guidance.session.orders.control_bus import opened, owner_token
from guidance.session.orders.control_client import answers, control_key
from guidance.session.orders.control_client import join_session as open_session
from guidance.session.orders.mailbox import ANSWER_LIMIT_S, Mailbox
from guidance.session.orders.socket_client import ask_here
from guidance.session.orders.words import REPLY_TIMEOUT_S
from guidance.session.orders_section import Control
from tests.harness.bus import ControlBus, ask


@pytest.fixture
def endpoint():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


class AnsweringLoop:
    """Answers every order as a daemon would."""

    def __init__(self, mailbox, name):
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, args=(mailbox, name))
        self._thread.start()

    def _run(self, mailbox, name):
        while not self._stop.wait(0.005):
            for question in itertools.chain(*mailbox.take()):
                answer = {
                    "accepted": question.order != "engage",
                    "order": question.order,
                    "name": name,
                }
                question.set_result(answer)

    def close(self):
        self._stop.set()
        self._thread.join()


@pytest.fixture
def daemon(endpoint):
    """Start daemons' control ends."""
    opened = []

    def start(name="uav1", *, host=True, answering=True):
        mailbox = Mailbox()
        if answering:
            opened.append(AnsweringLoop(mailbox, name))
        opened.append(ControlBus(name, mailbox, Control(endpoint=endpoint, host=host)))
        return opened[-1]

    yield start
    for one in reversed(opened):
        one.close()


def test_an_order_is_answered_by_the_vehicle_that_was_named_or_is_alone(daemon, endpoint):
    daemon()
    assert ask("hold", endpoint=endpoint, name="uav1") == {
        "accepted": True,
        "order": "hold",
        "name": "uav1",
    }
    assert not ask("engage", endpoint=endpoint, name=None)["accepted"]


def test_anyone_with_zenoh_can_ask(daemon, endpoint):
    daemon()
    session = open_session(endpoint)
    (reply,) = list(session.get("guidance/uav1/ctl/status", timeout=3.0))
    assert reply.ok.encoding == zenoh.Encoding.APPLICATION_JSON
    assert json.loads(reply.ok.payload.to_bytes())["order"] == "status"
    session.close()


def test_a_large_query_is_dropped_and_counted_and_the_next_one_is_answered(daemon, endpoint):
    bus = daemon()
    session = open_session(endpoint)
    assert not list(session.get("guidance/uav1/ctl/hold", payload=bytes(100_000), timeout=1.0))
    assert bus.mailbox.oversized == 1
    (reply,) = list(session.get("guidance/uav1/ctl/status", timeout=3.0))
    assert reply.ok is not None
    session.close()


def test_with_several_vehicles_an_order_needs_a_name(daemon, endpoint):
    daemon("uav1")
    daemon("uav2", host=False)
    with pytest.raises(ConfigError, match=r"which vehicle\? daemons at .*: uav1, uav2"):
        ask("hold", endpoint=endpoint, name=None)
    assert ask("hold", endpoint=endpoint, name="uav2")["name"] == "uav2"


def test_a_second_daemon_of_the_same_vehicle_is_refused(daemon, endpoint):
    first = daemon()
    with pytest.raises(LinkError, match="another daemon owns this vehicle"):
        daemon(host=False, answering=False)
    with pytest.raises(
        LinkError, match=r"cannot listen there: .* flies 'uav1'; end it, or choose another port"
    ):
        daemon(answering=False)
    first.close()
    daemon(answering=False).close()


def test_a_vehicle_is_free_again_when_its_owner_is_gone(daemon, endpoint):
    daemon("router")
    first = open_session(endpoint)
    second = open_session(endpoint)
    owner = owner_token(first, "uav1/guidance")
    with pytest.raises(LinkError, match="only one may fly it"):
        owner_token(second, "uav1/guidance")
    owner_token(second, "uav2/guidance").undeclare()
    first.close()  # as when its process ends: nothing was undeclared
    # On a busy machine the router may hear of it a moment later
    deadline_s = time.monotonic() + 10.0
    while True:
        try:
            owner_token(second, "uav1/guidance").undeclare()
            break
        except LinkError:
            assert time.monotonic() < deadline_s
    close_all(owner.undeclare)
    second.close()


def test_a_loop_that_hangs_is_said_to_hang(daemon, endpoint, monkeypatch):
    monkeypatch.setattr(orders, "ANSWER_LIMIT_S", 0.2)
    daemon(answering=False)
    answer = ask("hold", endpoint=endpoint, name="uav1")
    assert "the loop did not answer within 0.2 s" in answer["reason"]


def test_nobody_there_is_one_clear_error(daemon, endpoint):
    with pytest.raises(LinkError, match="no session within"):
        ask("hold", endpoint=endpoint, name="uav1")
    daemon("uav1")
    with pytest.raises(LinkError, match=r"uav9 at .*: no answer"):
        ask("hold", endpoint=endpoint, name="uav9", timeout_s=0.5)


def test_who_asks_waits_longer_than_the_mailbox_for_the_loop():
    assert REPLY_TIMEOUT_S > ANSWER_LIMIT_S
    assert control_key("*", "status") == "guidance/*/ctl/status"


def test_idle_connections_of_others_do_not_block_an_order(daemon, endpoint):
    daemon()
    host, _, port = endpoint.partition("/")[2].rpartition(":")
    idle = [socket.create_connection((host, int(port))) for _ in range(150)]
    try:
        assert ask_here("hold", endpoint=endpoint, name=None)["accepted"]
    finally:
        for one in idle:
            one.close()


def test_two_flights_at_once_both_take_orders_the_second_at_an_endpoint_of_its_own(endpoint):
    heard = []
    with contextlib.ExitStack() as closing:
        for name in ("uav1", "uav2"):
            mailbox = Mailbox()
            closing.callback(AnsweringLoop(mailbox, name).close)
            closing.enter_context(opened({name: mailbox}, endpoint, heard.append, ""))
        assert heard[0] == endpoint != heard[1]
        names = [ask_here("hold", endpoint=one, name=None)["name"] for one in heard]
    assert names == ["uav1", "uav2"]


def test_a_flight_without_an_endpoint_lets_nobody_in():
    with opened({"uav1": Mailbox()}, None, print, "") as control:
        assert not control


def test_100_of_100_holds_are_accepted_over_zenoh_while_32_clients_poll(daemon, endpoint):
    """Catches a hold that waits behind the queries of others on the bus."""
    daemon()
    polling = threading.Event()
    session = open_session(endpoint)
    polling.set()

    def poll():
        while polling.is_set():
            answers(session, "uav1", "status", 4.0)

    try:
        with ThreadPoolExecutor(32) as pool:
            for _ in range(32):
                pool.submit(poll)
            holds = [answers(session, "uav1", "hold", 4.0) for _ in range(100)]
            polling.clear()
        assert [hold["accepted"] for (hold,) in holds] == [True] * 100
    finally:
        polling.clear()
        session.close()
