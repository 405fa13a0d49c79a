"""One bad message, or one bad mate: the true stream wins, is never shut out, and what is refused is told."""

import json
import math
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from guidance.team.board import MOST_TERMS, Board
from guidance.team.messages import (
    MOST_BYTES,
    RefusedMessage,
    RolesMessage,
    read_message,
    write_message,
)
from guidance.team.senders import ALONE_AFTER_S, MOST_EPOCHS, STEADY, TAKES_OVER_S, Sender
from tests.team.virtual_team import SITE, VirtualTeam, state_of

NAMES = ("alpha", "bravo", "charlie")
HUGE = 2**53 - 1
TRUE_M = (10.0, 0.0, -10.0)
FORGED_M = (500.0, 0.0, -10.0)


def tell(board, at_s, message):
    return board.hear(at_s, message.key, write_message(message))


def board():
    return Board("alpha", NAMES, ("red", "blue"))


def north_m(here):
    return state_of("bravo", TRUE_M).latitude_deg == here.mates["bravo"].state.latitude_deg


@pytest.mark.parametrize(
    "forged", [{"seq": HUGE}, {"epoch": 99, "seq": 1}, {"epoch": 99, "seq": HUGE}]
)
@pytest.mark.parametrize("at", [0, 5])
def test_one_forged_message_shuts_no_true_mate_out(forged, at):
    here = board()
    news = []
    accepted_s = []
    for number in range(40):
        at_s = 10.0 + 0.1 * number
        if number == at:
            tell(here, at_s, state_of("bravo", FORGED_M, **forged))
        state = state_of("bravo", TRUE_M, seq=number + 1, sent_s=at_s)
        if tell(here, at_s, state) is not None:
            accepted_s.append(at_s)
        news += here.news
        here.news.clear()
    assert north_m(here)
    assert accepted_s[-1] == at_s
    silent_s = max(b - a for a, b in zip([10.0, *accepted_s], accepted_s, strict=False))
    assert silent_s < TAKES_OVER_S + 0.15
    assert any("bravo: a message in its name was refused" in words for words in news)


def test_a_flood_of_forged_epochs_takes_over_nothing_while_the_mate_speaks():
    """Catches a forger that takes over a mate's name by flooding newer epochs."""
    here = board()
    for number in range(1000):
        at_s = 10.0 + 0.02 * number
        if number % 5 == 0:
            tell(here, at_s, state_of("bravo", TRUE_M, seq=number, sent_s=at_s))
        tell(here, at_s, state_of("bravo", FORGED_M, epoch=5 + number // 25, seq=number))
        assert north_m(here)
    kinds = {words.partition(":")[2]: here.news.count(words) for words in here.news}
    assert max(kinds.values()) == math.ceil(20.0 / 10.0)  # told, and not in every cycle


@pytest.mark.parametrize(
    ("first", "step", "ahead_s", "epoch"),
    [
        pytest.param(1, 1, 0.01, 1, id="same number first"),
        pytest.param(1, 1, -0.01, 1, id="same number second"),
        pytest.param(15, 1, 0.05, 1, id="ahead"),
        pytest.param(20, 4, 0.05, 1, id="ever further ahead"),
        pytest.param(HUGE - 999, 1, 0.05, 1, id="far ahead"),
        pytest.param(1, 1, 0.05, 99, id="another epoch"),
    ],
)
def test_a_mate_for_whom_a_forger_speaks_too_is_silent_and_its_disc_holds_both(
    first, step, ahead_s, epoch
):
    here = board()
    states = []
    for number in range(160):
        at_s = 10.0 + 0.1 * number
        heard = [(at_s, state_of("bravo", TRUE_M, seq=number + 1, sent_s=at_s))]
        if 20 <= number < 80:
            seq = 20 + first + step * (number - 20)
            forged = state_of("bravo", FORGED_M, seq=seq, sent_s=at_s, airborne=False, epoch=epoch)
            heard.append((at_s - ahead_s, forged))
        heard.sort(key=lambda row: row[0])
        states += [(arrived_s, tell(here, arrived_s, message)) for arrived_s, message in heard]
    disputed = [(at_s, state) for at_s, state in states if state is not None and 13 < at_s < 18]
    for at_s, state in disputed:
        place = SITE.ned_from_wgs84(state.latitude_deg, state.longitude_deg, SITE.altitude)
        for claim_m in (TRUE_M, FORGED_M):
            assert math.dist(place[:2], claim_m[:2]) <= state.doubt_m + 0.1
        assert state.airborne
        assert min(at_s - state.at_s, 5.0) >= min(at_s - 12.6, 4.9)
    assert len(disputed) > 80
    assert any("bravo: two senders speak in its name" in words for words in here.news)
    after = [state for at_s, state in states if at_s > 18.0 + ALONE_AFTER_S + TAKES_OVER_S]
    assert after[0] is not None
    assert north_m(here)


def test_late_and_repeated_messages_are_no_second_sender():
    here = board()
    sent = [state_of("bravo", TRUE_M, seq=number, sent_s=0.1 * number) for number in range(60)]
    for number, state in enumerate(sent):
        at_s = 0.1 * number
        if number % 7 != 3:
            tell(here, at_s, state)
        if number > 30:
            tell(here, at_s + 0.01, sent[number - 30])
        if number % 7 == 4:
            tell(here, at_s + 0.02, sent[number - 1])
    assert not any("two senders" in words for words in here.news)
    assert here.counts["refused_two senders"] == 0


def test_a_mate_that_restarts_is_heard_again():
    here = board()
    tell(here, 1.0, state_of("bravo", FORGED_M, epoch=1, seq=900))
    heard = [
        tell(here, 2.5 + 0.1 * number, state_of("bravo", TRUE_M, epoch=2, seq=number))
        for number in range(5)
    ]
    assert [state is not None for state in heard] == [False] * (STEADY - 1) + [True] * 3
    assert tell(here, 9.0, state_of("bravo", FORGED_M, epoch=1, seq=901)) is None


@given(st.lists(st.tuples(st.floats(0.0, 5.0), st.integers(0, HUGE), st.integers(0, HUGE))))
def test_what_is_remembered_is_bounded(messages):
    sender = Sender()
    now_s = 0.0
    for waited_s, epoch, number in messages:
        now_s += waited_s
        for step in range(4):
            sender.refuses(now_s + 0.01 * step, epoch, number + step, step)
    assert len(sender.ended) <= MOST_EPOCHS


def test_names_of_unknown_evaders_are_not_remembered():
    here = board()
    plain = {
        "vehicle": "bravo",
        "epoch": 1,
        "seq": 1,
        "latitude_deg": 47.0,
        "longitude_deg": 8.0,
        "altitude_amsl_m": 400.0,
        "sent_s": 1.0,
        "source": "radio",
    }
    for number in range(500):
        name = f"red{number}"
        here.hear(1.0, f"evader/{name}/bravo", json.dumps({**plain, "evader": name}).encode())
    assert here.counts == {"refused_evader": 500}
    assert len(here.mates["bravo"].senders) == 0


@pytest.mark.parametrize("term", [MOST_TERMS + 2, HUGE])
def test_a_term_beyond_all_elections_is_refused_and_ends_no_coordinator(term):
    team = VirtualTeam(
        {name: (5.0 * number, 0.0, 0.0) for number, name in enumerate(NAMES)},
        {"red": (30.0, 0.0, 0.0)},
        (0.0, 0.0),
    )
    team.run(1.5)
    before = len(team.points["alpha"].made)
    for name in ("alpha", "bravo"):
        here = team.points[name].board
        forged = RolesMessage(vehicle="charlie", epoch=1, seq=1, term=term, roles=())
        here.hear(team.clock.now_s(), "roles/charlie", write_message(forged))
        seq = here.mates["charlie"].senders["state/charlie"].current.number + 1
        state = state_of("charlie", TRUE_M, seq=seq, sent_s=0.0, term=term)
        here.hear(team.clock.now_s(), "state/charlie", write_message(state))
        assert here.term < MOST_TERMS
        assert here.counts["refused_term"] == 1
    team.points["charlie"].killed = True
    team.run(1.0)
    assert len(team.points["alpha"].made) > before
    team.points["alpha"].killed = True
    team.run(2.5)
    assert team.points["bravo"].made


@pytest.mark.parametrize("sent_s", [-1.7e308, 1.7e308, -1e12])
def test_no_time_of_a_sender_makes_a_doubt_nan(sent_s):
    here = board()
    tell(here, 1.0, state_of("bravo", TRUE_M, seq=1, sent_s=1.0))
    plain = json.loads(write_message(state_of("bravo", TRUE_M, seq=2))) | {"sent_s": sent_s}
    here.hear(1.1, "state/bravo", json.dumps(plain).encode())
    state = tell(here, 1.2, state_of("bravo", TRUE_M, seq=3, sent_s=1.2))
    assert math.isfinite(state.doubt_m)
    assert here.counts["refused_schema"] == 1


@given(st.lists(st.floats(-9e9, 9e9), min_size=1, max_size=8))
def test_whatever_a_sender_says_of_its_clock_doubt_and_age_are_numbers(times_s):
    here = board()
    for number, sent_s in enumerate(times_s):
        state = tell(here, 1.0 + 0.1 * number, state_of("bravo", TRUE_M, seq=number, sent_s=sent_s))
        if state is not None:
            assert math.isfinite(state.doubt_m)
            assert math.isfinite(state.at_s)


def test_a_message_of_many_unknown_keys_costs_little():
    keys = ",".join(f'"{number:x}":1' for number in range(1000))
    payload = ("{" + keys + "}").encode()[: MOST_BYTES - 1]
    begun_s = time.process_time()
    for _ in range(100):
        with pytest.raises(RefusedMessage):
            read_message("state", payload)
    many_s = time.process_time() - begun_s
    begun_s = time.process_time()
    for _ in range(100):
        read_message("state", write_message(state_of("bravo", TRUE_M)))
    assert many_s < 20.0 * (time.process_time() - begun_s)
