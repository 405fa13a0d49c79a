"""The board: bytes are never trusted, ages come from arrival times, and no jump is taken for motion."""

import contextlib
import json
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guidance.team.board import Board
from guidance.team.messages import RefusedMessage, RolesMessage, write_message
from tests.harness.examples import drawn
from tests.team.virtual_team import SITE, state_of

NAMES = ("alpha", "bravo", "charlie")


def board():
    return Board("alpha", NAMES, ("red", "blue"))


def tell(board, arrived_s, message, key=None):
    return board.hear(arrived_s, key or message.key, write_message(message))


@given(
    st.sampled_from(["state/bravo", "roles/bravo", "evader/red/bravo", "x/bravo", "", "state/"]),
    st.binary(),
)
def test_no_bytes_under_any_key_raise_or_are_used(key, payload):
    here = board()
    assert here.hear(1.0, key, payload) is None
    assert here.counts["accepted"] == 0
    assert sum(here.counts.values()) == 1


@settings(max_examples=drawn(200))
@given(st.data())
def test_a_message_with_any_field_replaced_is_used_whole_or_refused(data):
    """Catches a mate's message of which a part is used and another part refused."""
    plain = json.loads(write_message(state_of("bravo", (10.0, 5.0, -12.0))))
    name = data.draw(st.sampled_from([*plain, "extra"]))
    values = (
        st.none()
        | st.booleans()
        | st.integers()
        | st.floats()
        | st.text()
        | st.lists(st.floats(), max_size=5)
    )
    plain[name] = data.draw(values)
    here = board()
    mate = here.hear(1.0, "state/bravo", json.dumps(plain).encode())
    assert sum(here.counts.values()) == 1
    assert (mate is not None) == here.counts["accepted"]
    if mate is not None:
        assert math.isfinite(mate.top_speed_m_s)
        assert all(map(math.isfinite, mate.velocity_ned_m_s))


def test_only_a_mates_own_identity_is_accepted():
    here = board()
    state = state_of("bravo", (0.0, 0.0, -10.0))
    assert tell(here, 1.0, state, "state/charlie") is None
    assert tell(here, 1.0, state_of("mallory", (0.0, 0.0, -10.0))) is None
    assert tell(here, 1.0, state_of("alpha", (0.0, 0.0, -10.0))) is None
    assert here.counts == {"refused_identity": 3}


def test_repeated_and_reordered_messages_and_ended_epochs_are_refused():
    here = board()
    for seq, epoch in ((5, 1), (5, 1), (4, 1), (0, 2), (6, 1)):
        tell(here, 1.0, state_of("bravo", (0.0, 0.0, -10.0), seq=seq, epoch=epoch))
    assert here.counts == {"accepted": 2, "refused_order": 2, "refused_epoch": 1}


@settings(max_examples=drawn(80))
@given(st.floats(-1e5, 1e5), st.lists(st.floats(0.02, 0.4), min_size=30, max_size=60))
def test_ages_do_not_depend_on_the_senders_clock(offset_s, delays_s):
    """Catches a mate's clock that makes its state look younger or older."""
    here = board()
    for number, delay_s in enumerate([*delays_s, 0.02]):
        true_s = 10.0 + 0.1 * number
        state = state_of("bravo", (0.0, 0.0, -10.0), sent_s=true_s + offset_s, seq=number)
        mate = tell(here, true_s + delay_s, state)
        assert mate.at_s <= true_s + delay_s + 1e-6
    assert mate.at_s == pytest.approx(true_s + 0.02, abs=1e-2)


def fly(here, places, *, dt_s=0.1, velocity=(6.0, 0.0, 0.0)):
    for number, north_m in enumerate(places):
        state = state_of("bravo", (north_m, 0.0, -10.0), velocity, sent_s=dt_s * number, seq=number)
        mate = tell(here, dt_s * number + 0.03, state)
    return mate


@settings(max_examples=drawn(80))
@given(st.sets(st.integers(1, 98)))
def test_motion_with_losses_is_never_doubted(lost):
    """Catches a doubt about honest motion of which reports are lost."""
    here = board()
    for number in sorted(set(range(100)) - lost):
        time_s = 0.1 * number
        turn = 0.05 * number
        place = (60.0 * math.sin(turn), 60.0 * (1.0 - math.cos(turn)), -10.0)
        velocity = (30.0 * math.cos(turn) * 0.2, 30.0 * math.sin(turn) * 0.2, 0.0)
        place = tuple(part * 0.2 if axis < 2 else part for axis, part in enumerate(place))
        tell(here, time_s + 0.02, state_of("bravo", place, velocity, sent_s=time_s, seq=number))
    assert here.mates["bravo"].doubt_ned_m == (0.0, 0.0, 0.0)


@settings(max_examples=drawn(80))
@given(st.floats(8.0, 500.0), st.integers(2, 20))
def test_a_misreport_stays_within_the_doubt_until_it_ends(jump_m, lasting):
    """Catches a mate that is somewhere else than its reports say, outside of the doubt that is kept."""
    here = board()
    true = [0.6 * number for number in range(40)]
    false = [at + jump_m if 10 <= number < 10 + lasting else at for number, at in enumerate(true)]
    mate = fly(here, false[: 10 + lasting])
    north, _, _ = SITE.ned_from_wgs84(mate.latitude_deg, mate.longitude_deg, SITE.altitude)
    assert abs(north - true[9 + lasting]) <= mate.doubt_m + 4.0
    assert any("bravo jumped" in words for words in here.news)
    mate = fly(board(), false)
    assert mate.doubt_m <= 1e-3 * jump_m + 0.5


def roles(vehicle, term, seq=0):
    return RolesMessage(vehicle=vehicle, epoch=1, seq=seq, term=term, roles=())


@given(
    st.permutations(
        [("bravo", 1, 0), ("bravo", 1, 1), ("charlie", 1, 5), ("charlie", 2, 0), ("bravo", 2, 0)]
    )
)
def test_the_newest_term_wins_then_the_lower_name(order):
    here = board()
    for number, (vehicle, term, seq) in enumerate(order):
        with contextlib.suppress(RefusedMessage):
            here.take_roles(float(number), roles(vehicle, term, seq))
    assert (here.roles.vehicle, here.roles.term) == ("bravo", 2)


def test_an_evader_out_of_play_stays_out_and_only_known_ones_count():
    here = board()
    tell(here, 1.0, state_of("bravo", (0.0, 0.0, -10.0), over=("red", "green"), seq=1))
    tell(here, 2.0, state_of("bravo", (0.0, 0.0, -10.0), over=(), seq=2))
    assert here.over == {"red": 1.0}
