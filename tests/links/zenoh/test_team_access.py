"""The team's router: mates hear each other, and a party that speaks for a vehicle is not heard."""

import socket
import time
from contextlib import ExitStack, closing

import pytest

from guidance.errors import LinkError
from guidance.links.zenoh.session import open_router, open_session
from guidance.links.zenoh.team import ZenohTeam
from guidance.session.orders.control_bus import owner_token
from guidance.session.orders.control_client import join_session, order_team
from guidance.session.orders.mailbox import Mailbox
from guidance.session.orders_section import Control
from guidance.team.board import Board
from guidance.team.messages import write_message
from tests.harness.bus import ControlBus
from tests.harness.command import HEAVY, fresh
from tests.links.peer import until
from tests.links.rigs import free_port
from tests.links.zenoh.parties import ROUTERS, folder_of_keys, of
from tests.team.virtual_team import state_of

pytestmark = pytest.mark.slow

VEHICLES = ("uav1", "uav2", "uav3")
PARTIES = (
    *(f"{name}-guidance" for name in VEHICLES),
    "rover1",
    "rover2",
    "operator",
    "viewer",
    "uav4-guidance",
)


@pytest.fixture(scope="module")
def keys(tmp_path_factory):
    return folder_of_keys(tmp_path_factory, PARTIES)


@pytest.fixture
def joined(keys):
    """Sessions of parties at the team's router."""
    endpoint = f"tls/127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    with (
        open_router(ROUTERS / "team.json5", keys, endpoint),
        ExitStack() as closing,
    ):

        def join(name):
            return closing.enter_context(open_session(endpoint, credentials=of(keys, name)))

        yield join, endpoint


def test_mates_are_heard_and_forgers_are_not(joined):
    join, _ = joined
    with ExitStack() as open_here:
        teams = {
            name: open_here.enter_context(
                closing(
                    ZenohTeam(time.monotonic, join(f"{name}-guidance"), "north", name, VEHICLES)
                )
            )
            for name in VEHICLES
        }
        assert until(lambda: all(set(one.present()) == set(VEHICLES) for one in teams.values()))
        board = Board("uav1", VEHICLES, ["rover1"])
        numbers = iter(range(1, 10_000))
        forgers = [
            join(name)
            for name in ("rover1", "viewer", "operator", "uav3-guidance", "uav4-guidance")
        ]

        def told():
            for forger in forgers:  # they speak for uav2
                forged = state_of("uav2", (999.0, 0.0, 0.0), epoch=2, seq=next(numbers))
                forger.put(f"guidance/team/north/{forged.key}", write_message(forged))
            honest = state_of("uav2", (1.0, 0.0, 0.0), seq=next(numbers))
            teams["uav2"].publish(honest.key, write_message(honest))
            # a mate that speaks for another under its own key: the router lets it pass, the board does not
            teams["uav3"].publish("state/uav3", write_message(honest))
            for one in teams["uav1"].receive():
                board.hear(*one)
            return board.counts["accepted"] > 3 and board.counts["refused_identity"] > 3

        assert until(told)
        assert {board.mates["uav2"].state.epoch} == {1}
        assert set(board.counts) == {"accepted", "refused_identity"}
        teams["uav2"].close()
        assert until(lambda: set(teams["uav1"].present()) == {"uav1", "uav3"})


def test_no_vehicle_claims_anothers_owner_token(joined):
    join, _ = joined
    own = join("uav2-guidance")
    forger = join("uav1-guidance")
    token = forger.liveliness().declare_token("guidance/uav2/owner/forged")
    time.sleep(0.3)
    mine = owner_token(own, "guidance/uav2")
    with pytest.raises(LinkError, match="another daemon owns this vehicle"):
        owner_token(join("uav2-guidance"), "guidance/uav2")
    mine.undeclare()
    token.undeclare()


def test_only_the_operator_orders_the_team_and_takes_less_than_300_ms_of_processor_time(
    joined, keys
):
    with ExitStack() as open_here:
        for name in VEHICLES:
            mailbox = Mailbox()
            mailbox.meanwhile = lambda order: {"accepted": True, "order": order, "state": "holding"}
            control = Control(endpoint=joined[1], host=False)
            credentials = of(keys, f"{name}-guidance")
            bus = ControlBus(
                name,
                mailbox,
                control,
                credentials,
                "north",
                [mate for mate in VEHICLES if mate != name],
            )
            open_here.callback(bus.close)
        operator, viewer = (of(keys, name) for name in ("operator", "viewer"))
        with join_session(joined[1], credentials=operator) as session:
            answers = order_team(session, "hold", "north", (), timeout_s=4.0)
        assert [(answer["name"], answer["accepted"]) for answer in answers] == [
            (name, True) for name in VEHICLES
        ]
        by_router = ("--team", "north", "--endpoint", joined[1], "--zenoh", keys / "operator.toml")
        orders = [fresh("ctl", order, *by_router) for order in ("hold", "land", "return", "abort")]
        for order, done in zip(("hold", "land", "return", "abort"), orders, strict=True):
            said = [f"{name}: {order} accepted, holding\n" for name in VEHICLES]
            assert (done.code, done.words, done.modules & HEAVY) == (0, "".join(said), set())
        assert min(done.processor_time_s for done in orders) < 0.3
        with (
            join_session(joined[1], credentials=viewer) as session,
            pytest.raises(Exception, match="no vehicle of it answers"),
        ):
            order_team(session, "hold", "north", (), timeout_s=0.3)
