"""Orders to a team: one reply for each vehicle, and a start or an engagement only where all of them can follow."""

import contextlib
import itertools
import json
import threading

import pytest
from typer.testing import CliRunner

from guidance.cli.program import app
from guidance.errors import LinkError
from guidance.links.zenoh.session import open_session
from guidance.session.orders.control_bus import free_endpoint
from guidance.session.orders.control_client import join_session, order_team
from guidance.session.orders.mailbox import Mailbox
from guidance.session.orders_section import Control
from tests.harness.bus import ControlBus, ask
from tests.links.peer import until

pytestmark = pytest.mark.slow

NAMES = ("uav1", "uav2", "uav3")


class Vehicle:
    """A daemon's side of the bus; it follows every order and notes it."""

    def __init__(self, name, mailbox):
        self.name = name
        self.mailbox = mailbox
        self.orders = []
        self.refused = {"start": "", "engage": ""}
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        while not self._stop.wait(0.005):
            for question in itertools.chain(*self.mailbox.take()):
                if question.order != "status":
                    self.orders.append(question.order)
                said = {
                    "accepted": True,
                    "order": question.order,
                    "state": "ready",
                    "refused_orders": self.refused,
                }
                question.set_result(said)

    def close(self):
        self._stop.set()
        self._thread.join()


@pytest.fixture
def team(tmp_path):
    """Three vehicles of the team north and one without a team, all at one endpoint."""
    endpoint = free_endpoint()
    token = tmp_path / "token"
    vehicles = {}
    with contextlib.ExitStack() as closing:

        def add(name, team):
            mailbox = Mailbox()
            mates = [mate for mate in NAMES if mate != name]
            vehicles[name] = closing.enter_context(contextlib.closing(Vehicle(name, mailbox)))
            control = Control(
                endpoint=endpoint, host=not vehicles.keys() - {name}, token_file=token
            )
            bus = ControlBus(name, mailbox, control, team=team, mates=mates if team else ())
            closing.callback(bus.close)

        add("uav1", "north")
        add("uav2", "north")
        add("single", "")
        vehicles["add"] = add

        def asked(order, names=(), team="north"):
            with join_session(endpoint, token) as session:
                return order_team(session, order, team, names, timeout_s=1.0)

        vehicles["asked"] = asked
        vehicles["endpoint"] = endpoint
        vehicles["token"] = token
        yield vehicles


def test_a_hold_reaches_the_whole_team_and_only_that_and_names_who_is_silent(team):
    answers = team["asked"]("hold")
    assert [(answer["name"], answer["accepted"]) for answer in answers] == [
        ("uav1", True),
        ("uav2", True),
        ("uav3", False),
    ]
    assert "no answer" in answers[2]["reason"]
    assert (team["uav1"].orders, team["uav2"].orders, team["single"].orders) == (
        ["hold"],
        ["hold"],
        [],
    )


def test_nobody_starts_before_all_are_there_and_would_accept(team):
    assert {one["name"]: one["reason"] for one in team["asked"]("start")}[
        "uav1"
    ] == "waits for uav3"
    team["add"]("uav3", "north")
    team["uav2"].refused = {"start": "not ready: battery", "engage": ""}
    reasons = {one["name"]: one["reason"] for one in team["asked"]("start")}
    assert reasons == {
        "uav1": "waits for uav2",
        "uav2": "not ready: battery",
        "uav3": "waits for uav2",
    }
    assert not any(team[name].orders for name in NAMES)
    team["uav2"].refused = {"start": "", "engage": ""}
    assert all(one["accepted"] for one in team["asked"]("start"))
    assert [team[name].orders for name in NAMES] == [["start"]] * 3


def test_the_named_ones_engage_without_the_others(team):
    assert all(one["accepted"] for one in team["asked"]("engage", ("uav2",)))
    assert (team["uav1"].orders, team["uav2"].orders) == ([], ["engage"])
    assert not team["asked"]("engage", ("uav2", "uav3"))[0]["accepted"]


def test_a_slow_vehicle_delays_no_order_to_another_one(team):
    def follow_last(order):
        return {"accepted": until(lambda: team["uav2"].orders), "order": order, "state": "ready"}

    team["uav1"].mailbox.meanwhile = follow_last
    answers = team["asked"]("hold", ("uav1", "uav2"))
    assert [(answer["name"], answer["accepted"]) for answer in answers] == [
        ("uav1", True),
        ("uav2", True),
    ]


def test_a_team_that_is_not_there_is_said_to_be_silent(team):
    with pytest.raises(LinkError, match="--team south: no vehicle of it answers"):
        team["asked"]("hold", team="south")


def test_without_the_token_nobody_joins_the_team(team):
    with pytest.raises(LinkError):
        open_session(team["endpoint"], timeout_s=0.5)


def test_one_vehicle_of_the_team_is_ordered_alone(team):
    assert ask("land", endpoint=team["endpoint"], name="uav2", token_file=team["token"])["accepted"]
    assert (team["uav1"].orders, team["uav2"].orders) == ([], ["land"])


def test_the_command_prints_a_line_for_each_vehicle(team):
    words = [
        "ctl",
        "hold",
        "--team",
        "north",
        "--endpoint",
        team["endpoint"],
        "--token-file",
        str(team["token"]),
    ]
    said = CliRunner().invoke(app, [*words, "--name", "uav1,uav2"])
    assert said.exit_code == 0
    assert said.output.splitlines() == ["uav1: hold accepted, ready", "uav2: hold accepted, ready"]
    answers = json.loads(CliRunner().invoke(app, [*words, "--name", "uav1,uav2", "--json"]).output)
    assert [answer["name"] for answer in answers] == ["uav1", "uav2"]
