"""A team's messages over Zenoh: what one vehicle publishes, the others hear, and tokens end with their vehicle."""

import time
from contextlib import closing, contextmanager

import pytest

from guidance.links.zenoh.session import open_session
from guidance.links.zenoh.team import ZenohTeam
from tests.links.peer import until

pytestmark = pytest.mark.slow


@contextmanager
def joined(router, vehicle, team="north"):
    with (
        open_session(f"tcp/127.0.0.1:{router.port}") as session,
        closing(ZenohTeam(time.monotonic, session, team, vehicle, ("alpha", "bravo"))) as transport,
    ):
        yield transport


def test_mates_hear_each_other_and_not_themselves_nor_another_team(router):
    with (
        joined(router, "alpha") as alpha,
        joined(router, "bravo") as bravo,
        joined(router, "x", "south") as other,
    ):
        assert until(lambda: {"alpha", "bravo"} <= set(alpha.present()) & set(bravo.present()))
        heard = []

        def told():
            alpha.publish("state/alpha", b"here")
            heard.extend(bravo.receive())
            return bool(heard)

        assert until(told)
        assert {one[1:] for one in heard} == {("state/alpha", b"here")}
        assert alpha.receive() == []
        assert other.receive() == []
        assert set(other.present()) == {"x"}


def test_tokens_of_strangers_are_not_kept(router):
    with joined(router, "alpha") as alpha, joined(router, "bravo"), joined(router, "charlie"):
        assert until(lambda: "bravo" in alpha.present())
        assert set(alpha.present()) == {"alpha", "bravo"}


def test_a_vehicle_that_leaves_is_not_present(router):
    with joined(router, "alpha") as alpha:
        with joined(router, "bravo"):
            assert until(lambda: "bravo" in alpha.present())
        assert until(lambda: "bravo" not in alpha.present())
