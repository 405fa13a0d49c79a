"""The daemon's side of orders on a bus that the test plays: what is answered to whom, and what is closed."""

import contextlib
import json
from pathlib import Path
from types import SimpleNamespace

import pytest
import zenoh

from guidance.errors import LinkError
from guidance.links.zenoh.credentials import NO_CREDENTIALS, Credentials
from guidance.session.orders import control_bus as bus_module
from guidance.session.orders.control_bus import (
    control_bus,
    free_endpoint,
    host_session,
    opened,
    owner_token,
)
from guidance.session.orders.control_client import order_team
from guidance.session.orders.control_token import ControlToken, read_token, socket_path
from guidance.session.orders.mailbox import MOST_ORDERS, MOST_QUERIES, Mailbox
from guidance.session.orders.words import TEAM_ANSWER_LIMIT_S
from guidance.session.orders_section import Control

ENDPOINT = "tcp/127.0.0.1:7448"


class Session:
    """A Zenoh session that keeps what is declared, and in which order everything is closed."""

    def __init__(self, owners=(), gone=False):
        self.owners = owners
        self.gone = gone
        self.declared = {}
        self.closed = []
        self.looked = None

    def zid(self):
        return "7e"

    def close(self, what="session"):
        self.closed.append(what)
        if self.gone:
            raise zenoh.ZError("the router is gone")

    def liveliness(self):
        return self

    def declare_token(self, key):
        self.declared[key] = "token"
        return SimpleNamespace(undeclare=lambda: self.close("token"))

    def get(self, key, *, timeout):
        assert "token" in self.declared.values()  # claimed first
        self.looked = (key, timeout)
        mine = [key for key, kind in self.declared.items() if kind == "token"]
        claims = [SimpleNamespace(key_expr=owner) for owner in (*mine, *self.owners)]
        return [SimpleNamespace(ok=None), *(SimpleNamespace(ok=claim) for claim in claims)]

    def declare_queryable(self, key, heard):
        self.declared[key] = heard
        return SimpleNamespace(undeclare=lambda: self.close("queryable"))


class Payload(bytes):
    def to_bytes(self):
        return bytes(self)


class Query:
    """An order on the wire."""

    attachment = None

    def __init__(self, order, payload=None, team=None, gone=False):
        self.key_expr = f"guidance/*/ctl/{order}"
        self.payload = None if payload is None else Payload(payload)
        self.parameters = {} if team is None else {"team": team}
        self.gone = gone
        self.replies = []
        self.dropped = False

    def reply(self, key, data, *, encoding):
        if self.gone:
            raise zenoh.ZError("who asked is gone")
        assert encoding == zenoh.Encoding.APPLICATION_JSON
        self.replies.append((key, json.loads(data)))

    def drop(self):
        self.dropped = True


@pytest.fixture
def played(monkeypatch):
    """A session and a mailbox that is answered at once; exchanges run on the asking thread."""
    made = SimpleNamespace(session=Session(), joined=[], limits={}, said=[])
    made.mailbox = Mailbox()

    def answer(order, by):
        made.said.append((order, by))
        return {"accepted": True, "order": order}

    def join(*arguments):
        made.joined.append(arguments)
        return made.session

    def exchange(free, call, query, order):
        made.limits[order] = free
        call(query, order)

    monkeypatch.setattr(made.mailbox, "answer", answer)
    monkeypatch.setattr(bus_module, "join_session", join)
    monkeypatch.setattr(bus_module, "begin_exchange", exchange)
    return made


def joining(played, team="", mates=(), credentials=NO_CREDENTIALS, **control):
    return control_bus(
        "uav1",
        played.mailbox,
        Control(endpoint=ENDPOINT, host=False, **control),
        credentials,
        team,
        mates,
    )


def heard(played, query):
    played.session.declared["guidance/uav1/ctl/*"](query)
    return query


def test_an_order_is_answered_under_our_own_key_with_the_name_of_its_sender(played):
    with joining(played) as session:
        assert session is played.session
        query = heard(played, Query("hold", b"Ana"))
        assert query.replies == [
            ("guidance/uav1/ctl/hold", {"name": "uav1", "accepted": True, "order": "hold"})
        ]
        assert query.dropped
        heard(played, Query("status"))
        heard(played, Query("hold", b"x" * 4096))
        heard(played, Query("hold", b"x" * 4097))
    longest = "x" * 64
    assert played.said == [("hold", "Ana"), ("status", ""), ("hold", longest), ("hold", "")]


def test_queries_never_keep_an_order_out(played):
    with joining(played):
        for word in ("hold", "status"):
            heard(played, Query(word))
    for word, most in (("hold", MOST_ORDERS), ("status", MOST_QUERIES)):
        taken = sum(played.limits[word].acquire(blocking=False) for _ in range(2 * MOST_QUERIES))
        assert taken == most


def test_an_order_to_another_team_and_one_that_is_too_large_are_dropped_unanswered(played):
    with joining(played, team="north", mates=("uav2",)):
        ours = heard(played, Query("hold", team="north"))
        theirs = heard(played, Query("hold", team="south"))
        assert played.mailbox.oversized == 0
        heard(played, Query("status", payload=bytes(100_000)))
        large = heard(played, Query("hold", payload=bytes(100_000)))
    assert [answer for _, answer in ours.replies] == [
        {
            "name": "uav1",
            "team": "north",
            "vehicles": ["uav1", "uav2"],
            "accepted": True,
            "order": "hold",
        }
    ]
    assert (theirs.replies, theirs.dropped) == ([], True)
    assert (large.replies, large.dropped) == ([], True)
    assert played.mailbox.oversized == 2
    assert len(played.said) == 1


def test_who_asked_and_is_gone_disturbs_nothing(played):
    with joining(played):
        heard(played, Query("hold", gone=True))
    assert played.said == [("hold", "")]


def test_a_daemon_that_joins_claims_its_vehicle_and_closes_everything_in_the_end(played, tmp_path):
    certified = Credentials(tls={"root_ca_certificate": "ca.pem"})
    with joining(played, credentials=certified, token_file=tmp_path / "its.token"):
        assert played.joined == [(ENDPOINT, tmp_path / "its.token", certified)]
        assert "guidance/uav1/owner/7e" in played.session.declared
        assert played.session.looked == ("guidance/uav1/owner/*", 1.0)
        assert played.session.closed == []
    assert played.session.closed == ["queryable", "token", "session"]


@pytest.mark.parametrize("host", [False, True])
def test_a_session_whose_router_is_gone_ends_without_an_error(
    played, sockets, monkeypatch, tmp_path, host
):
    played.session.gone = True
    monkeypatch.setattr(bus_module, "host_session", lambda *_: played.session)
    control = Control(endpoint=ENDPOINT, host=host, token_file=tmp_path / "uav1.token")
    with control_bus("uav1", played.mailbox, control, NO_CREDENTIALS, "", ()):
        pass
    assert played.session.closed == ["queryable", "token", "session"]
    assert all(made.closed for made in sockets)


def test_a_vehicle_with_another_owner_is_given_up_at_once():
    session = Session(owners=["guidance/uav1/owner/3", "guidance/uav1/owner/1"])
    with pytest.raises(
        LinkError,
        match=r"guidance/uav1: another .*\(guidance/uav1/owner/1, guidance/uav1/owner/3\)",
    ):
        owner_token(session, "guidance/uav1")
    assert session.closed == ["token"]


@pytest.fixture
def sockets(monkeypatch):
    """Sockets of this computer that are kept, not opened."""
    made = []

    class Socket:
        def __init__(self, name, answer, token, pass_on):
            self.given = (name, answer, token)
            self.pass_on = pass_on
            self.closed = False
            made.append(self)

        def close(self):
            self.closed = True

    monkeypatch.setattr(bus_module, "ControlSocket", Socket)
    return made


@pytest.mark.parametrize("usual", [False, True])
def test_a_daemon_that_listens_publishes_its_token_and_a_socket_while_it_does(
    played, sockets, monkeypatch, tmp_path, usual
):
    path = tmp_path / "uav1.token"
    hosted = []

    def host(endpoint, token):
        hosted.append((endpoint, token))
        assert not path.exists()  # not before the endpoint is ours
        return played.session

    monkeypatch.setattr(bus_module, "host_session", host)
    monkeypatch.setattr(bus_module, "token_path", {ENDPOINT: path if usual else None}.get)
    control = Control(endpoint=ENDPOINT, host=True, token_file=None if usual else path)
    with control_bus("uav1", played.mailbox, control, NO_CREDENTIALS, "", ()):
        ((endpoint, drawn),) = hosted
        token = read_token(path)
        assert (endpoint, token.secret) == (ENDPOINT, drawn.secret)
        (made,) = sockets
        assert made.given == ("uav1", played.mailbox.answer, token)
        assert socket_path(token.path) == path.with_suffix(".sock")
        assert (made.pass_on.func, made.pass_on.args) == (order_team, (played.session,))
        assert made.pass_on.keywords == {"timeout_s": TEAM_ANSWER_LIMIT_S}
    assert made.closed
    assert not path.exists()
    assert played.session.closed == ["queryable", "token", "session"]


def test_an_endpoint_is_listened_at_by_a_router_for_those_who_know_the_token(monkeypatch):
    opened_with = []

    def direct(*arguments, **transport):
        opened_with.append((arguments, transport))
        return "session"

    monkeypatch.setattr(bus_module, "direct_session", direct)
    token = ControlToken(Path("/run/a.token"), "ab" * 32)
    assert host_session(ENDPOINT, token) == "session"
    listening = {"endpoints": [ENDPOINT], "timeout_ms": 0, "exit_on_failure": True}
    auth = {
        "usrpwd": {"user": "guidance", "password": "ab" * 32, "dictionary_file": "/run/a.token"}
    }
    assert opened_with == [(("router", {"listen": listening}), {"auth": auth})]


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        ({"name": "uav7"}, "flies 'uav7'"),
        (None, "another program has the port"),
        (LinkError("no answer"), "another program has the port"),
    ],
)
def test_an_endpoint_that_is_taken_is_named_with_who_has_it(monkeypatch, answer, words):
    asked = []

    def direct(*_, **__):
        raise zenoh.ZError("in use")

    def ask(*arguments, **about):
        asked.append((arguments, about))
        if isinstance(answer, Exception):
            raise answer
        return answer

    monkeypatch.setattr(bus_module, "direct_session", direct)
    monkeypatch.setattr(bus_module, "ask_here", ask)
    token = ControlToken(Path("/run/a.token"), "ab" * 32)
    with pytest.raises(LinkError, match=f"control.endpoint = '{ENDPOINT}': cannot .*{words}"):
        host_session(ENDPOINT, token)
    assert asked == [(("status",), {"endpoint": ENDPOINT, "name": None})]


@pytest.fixture
def buses(monkeypatch):
    """Control buses that are kept, not opened; those at an endpoint that is taken fail."""
    made = SimpleNamespace(opened=[], closed=[], taken={})

    @contextlib.contextmanager
    def bus(name, mailbox, control, *, credentials, team, mates):
        if control.endpoint in made.taken.get(name, ()):
            raise LinkError("cannot listen there")
        assert credentials == NO_CREDENTIALS
        made.opened.append((name, mailbox, control.endpoint, control.host, team, tuple(mates)))
        yield f"session of {name}"
        made.closed.append(name)

    monkeypatch.setattr(bus_module, "control_bus", bus)
    monkeypatch.setattr(bus_module, "free_endpoint", lambda: "tcp/127.0.0.1:9999")
    return made


@pytest.mark.parametrize(
    ("taken", "endpoint"), [((), ENDPOINT), ((ENDPOINT,), "tcp/127.0.0.1:9999")]
)
def test_the_first_vehicle_of_a_flight_listens_and_the_others_join_it(buses, taken, endpoint):
    buses.taken["uav1"] = taken
    mailboxes = {"uav1": "first", "uav2": "second"}
    told = []
    with opened(mailboxes, ENDPOINT, told.append, "north") as sessions:
        assert sessions == {"uav1": "session of uav1", "uav2": "session of uav2"}
        assert told == [endpoint]
        assert buses.closed == []
    assert buses.opened == [
        ("uav1", "first", endpoint, True, "north", ("uav1", "uav2")),
        ("uav2", "second", endpoint, False, "north", ("uav1", "uav2")),
    ]
    assert buses.closed == ["uav2", "uav1"]


def test_a_flight_whose_second_vehicle_cannot_join_is_an_error(buses):
    buses.taken["uav2"] = (ENDPOINT,)
    with (
        pytest.raises(LinkError, match="cannot listen there"),
        opened({"uav1": "first", "uav2": "second"}, ENDPOINT, print, ""),
    ):
        pass
    assert buses.opened[0][0] == "uav1"
    assert len(buses.opened) == 1


def test_a_free_endpoint_is_on_loopback_at_a_port_that_any_user_may_take():
    place, _, port = free_endpoint().rpartition(":")
    assert place == "tcp/127.0.0.1"
    assert 1024 <= int(port) < 65_536
