"""A user's policy in flight: it flies behind the same limits, and ends in a hold where it has no answer."""

import threading

import numpy as np
import pytest

from guidance.clock import MonotonicClock, VirtualClock
from guidance.errors import ConfigError
from guidance.log.replay import compare
from guidance.session.flight_files import RECORD, recorded_settings
from guidance.session.fly.own_policy import (
    LONGEST_ANSWER_S,
    PolicyThread,
    TimedPolicy,
    require_policies,
)
from guidance.session.open.mock import MockOptions
from guidance.session.recorded_flight import fly_recorded
from guidance.sim.scenario_file import load_scenario, with_policies
from guidance.strategies import own
from tests.harness.flights import NEAR

pytestmark = pytest.mark.usefixtures("soon_up_and_down")
OBSERVATION = np.array([[3.0, 4.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]])


def straight(observation):
    way = observation[:, 0:3]
    share = way / np.linalg.norm(way, axis=1, keepdims=True)
    share[:, 2] = np.clip(way[:, 2], -1.0, 1.0)
    return share


class Failing:
    """Flies straight, and after some answers does something else."""

    def __init__(self, answers, then):
        self.left = answers
        self.then = then

    def __call__(self, observation):
        self.left -= 1
        return straight(observation) if self.left > 0 else self.then(observation)


def boom(_):
    raise RuntimeError("boom")


@pytest.mark.flight
@pytest.mark.parametrize(
    ("then", "words"),
    [
        (straight, None),
        (lambda observation: np.full((1, 3), np.nan), "is not 3 finite numbers"),
    ],
)
def test_a_policy_flies_and_what_has_no_answer_holds_and_replays(then, words, tmp_path):
    own.register_policy("tests.own:policy", Failing(150, then))
    scenario = with_policies(NEAR, pursuer="tests.own:policy")
    result = fly_recorded(scenario, tmp_path, MockOptions(fast=True)).vehicles["pursuer"]
    own.forget()  # a replay runs nobody's code
    assert result.captured is (words is None)
    if words is not None:
        assert any(words in transition.words for transition in result.transitions)
    comparison, _ = compare(tmp_path / RECORD, recorded_settings)
    assert comparison.differing == 0
    assert comparison.setpoints > 100


def test_an_answer_that_took_longer_than_a_cycle_is_none():
    clock = VirtualClock()

    def slow(observation):
        clock.sleep_until(clock.now_s() + pause_s)
        return straight(observation)

    own.register_policy("tests.slow:policy", slow)
    ask = TimedPolicy("tests.slow:policy", clock)
    pause_s = 0.9 * LONGEST_ANSWER_S
    assert ask(OBSERVATION) == (0.6, 0.8, 0.0)
    pause_s = 1.1 * LONGEST_ANSWER_S
    assert "took 22 ms; a cycle has 20 ms" in ask(OBSERVATION)


def test_an_error_of_a_policy_is_no_answer():
    own.register_policy("tests.boom:policy", boom)
    ask = TimedPolicy("tests.boom:policy", VirtualClock())
    assert "raised RuntimeError: boom" in ask(OBSERVATION)


@pytest.mark.slow
def test_a_policy_that_does_not_return_stops_no_cycle_and_its_late_answer_is_dropped():
    free = threading.Event()
    done = threading.Event()
    answers = iter([boom, None])

    def stuck(observation):
        if next(answers, None) is boom:
            free.wait(10.0)
            done.set()
            return np.ones((1, 3))
        return straight(observation)

    own.register_policy("tests.stuck:policy", stuck)
    ask = PolicyThread(TimedPolicy("tests.stuck:policy", MonotonicClock()))
    assert "takes longer than a cycle" in ask(OBSERVATION)
    assert "still computes an earlier cycle" in ask(OBSERVATION)
    free.set()
    assert done.wait(10.0)
    while isinstance(answer := ask(OBSERVATION), str):
        pass
    assert answer == (0.6, 0.8, 0.0)


def test_a_scenario_with_a_policy_is_read_and_shown_without_running_it(tmp_path, monkeypatch):
    (tmp_path / "evil.py").write_text("raise SystemExit('it ran')")
    monkeypatch.chdir(tmp_path)
    scenario = with_policies(load_scenario("pe")[1], pursuer="evil.py:choose")
    from guidance.cli.scenario import facts_of

    assert "plays evil.py:choose" in dict(facts_of(scenario))["pursuer"]


def test_an_evaders_own_policy_is_refused_beside_a_vehicle():
    scenario = with_policies(load_scenario("pe")[1], evader="tests.some:policy")
    with pytest.raises(
        ConfigError, match=r"evader.policy = 'tests.some:policy': .* on the mock only"
    ):
        require_policies(scenario, beside_vehicle=True)
