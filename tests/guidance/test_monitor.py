import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from guidance.game import Winner
from guidance.monitor import Broken, Guarantee, watch
from guidance.tick import Certificate

NOWHERE = (0.0, 0.0, 0.0)


def certificate(value, winner=Winner.PURSUER):
    known = dict.fromkeys(Certificate._fields, 0.0) | {"winner": int(winner), "value": value}
    return Certificate(**known)


def alarms(values, *, with_target, slack=0.5, winners=None):
    memory, found = Guarantee(), []
    for index, value in enumerate(values):
        winner = winners[index] if winners else Winner.PURSUER
        memory, alarm = watch(memory, 0.1 * index, certificate(value, winner), with_target=with_target, slack=slack)
        found.append(alarm and alarm.broken)
    return found


def test_optimal_play_raises_no_alarm():
    assert alarms([20.0 - 0.1 * k for k in range(100)], with_target=False) == [None] * 100
    assert alarms([4.0] * 100, with_target=True) == [None] * 100


def test_a_capture_that_comes_later_is_said_once_for_each_slack_lost():
    # V stays: V + t rises by 0.1 a cycle, so that every sixth cycle has lost more than 0.5.
    found = alarms([20.0] * 20, with_target=False)
    assert found.count(Broken.CAPTURE_LATER) == 3
    assert found[6] is Broken.CAPTURE_LATER


def test_a_final_distance_that_falls_is_said():
    found = alarms([4.0, 3.9, 3.6, 3.4, 3.4], with_target=True)
    assert found == [None, None, None, Broken.EVADER_CLOSER, None]


@pytest.mark.parametrize(
    ("first", "then", "broken"),
    [
        (Winner.PURSUER, Winner.EVADER, Broken.BARRIER_LOST),
        (Winner.EVADER, Winner.PURSUER, Broken.BARRIER_WON),
    ],
)
def test_the_barrier_is_reported_when_it_is_crossed(first, then, broken):
    winners = [first, first, then, then]
    assert alarms([4.0] * 4, with_target=True, winners=winners) == [None, None, broken, None]


def test_a_cycle_without_a_game_is_passed_over():
    memory = Guarantee(7.0, 1)
    for nothing in (certificate(math.nan), certificate(3.0, Winner.UNDECIDED)):
        assert watch(memory, 1.0, nothing, with_target=False, slack=0.5) == (memory, None)


@given(st.lists(st.floats(0.0, 100.0), min_size=2, max_size=50), st.booleans())
def test_what_never_gets_worse_never_alarms(values, with_target):
    # V + t falls or L rises: sort the costs and take the time off again.
    ordered = sorted(values, reverse=not with_target)
    steps = ordered if with_target else [value - 0.1 * index for index, value in enumerate(ordered)]
    assert set(alarms(steps, with_target=with_target, slack=1e-6)) == {None}
