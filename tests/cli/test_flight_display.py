"""How a flight is told: no number where there is none, one definition of each, and alarms with their units."""

import io
import math

import pytest
from rich.console import Console

from guidance.cli.fly import plain_line, result_table, score, words
from guidance.cycle import Alarm, Certificate, Violation
from guidance.flight import State
from guidance.session.fly.mission import Progress
from guidance.session.fly.result import FlightResult
from guidance.session.plan import plan_of
from guidance.sim.outcome import outcome_of
from guidance.sim.scenario_file import load_scenario


def yielded(predicted):
    return outcome_of(
        load_scenario("pilot_takeover")[1], "fast", end="yielded", game_time_s=3.84,
        distance_to_disc_m=9.0, evader_to_target_m=math.nan,
        predicted=predicted, predicted_winner="pursuer", time_needed_s=math.nan, min_standoff_m=12.0,
        min_altitude_m=10.0, duration_s=29.0,
    )  # fmt: skip


@pytest.mark.parametrize("width", [60, 200])
def test_a_flight_without_a_capture_has_no_number_for_one(width):
    outcome = yielded(12.82)
    written = io.StringIO()
    scenario = load_scenario("pilot_takeover")[1]
    flown = FlightResult(scenario, plan_of(scenario=scenario).flight.cycle, State.YIELDED)
    Console(file=written, width=width).print(result_table(flown, outcome))
    words = written.getvalue()
    assert "nan" not in words
    assert "yielded to a pilot" in words
    assert "12.82 s" in words
    assert max(map(len, words.splitlines())) <= width
    assert score(outcome) == "12.82 s predicted"
    assert score(yielded(math.nan)) == "no game was played"


def test_the_result_tells_the_speed_that_was_reached_last():
    written = io.StringIO()
    scenario = load_scenario("pilot_takeover")[1]
    flown = FlightResult(scenario, plan_of(scenario=scenario).flight.cycle, State.YIELDED)
    told = dict.fromkeys(Certificate._fields, 0.0)
    flown.latest = Certificate(**told | {"reachable_speed_m_s": 4.5})
    Console(file=written).print(result_table(flown, yielded(12.82)))
    assert f"4.5 of {scenario.pursuer.speed_m_s:g} m/s" in written.getvalue()


def test_a_flight_that_pauses_says_why():
    paused = Progress(36.1, State.PAUSED, "OFFBOARD", None, "s", why="loop late")
    assert plain_line(paused) == "paused: loop late"
    assert words(paused) == "  36.1 s  paused      in OFFBOARD loop late"
    assert plain_line(paused._replace(state=State.ENGAGED)) == "engaged"


def test_a_hold_by_an_operator_says_so_and_how_to_continue():
    words_of = "held by operator: continue with guidance ctl engage, return or land"
    held = Progress(40.0, State.HOLDING, "HOLD", None, "s", why="hold", next=words_of)
    assert plain_line(held) == f"holding: {words_of}"
    assert words(held).endswith(words_of)
    lost = Progress(
        40.0, State.OUT_OF_CONTACT, "HOLD", None, "s", why="no telemetry for 1.0 s", next="wait"
    )
    assert plain_line(lost) == "out of contact: no telemetry for 1.0 s; wait"


@pytest.mark.parametrize(
    ("violation", "words"),
    [
        (
            Violation.CAPTURE_LATER,
            "guarantee: the time of capture has risen, 1.79 s; the evader may have turned",
        ),
        (
            Violation.EVADER_CLOSER,
            "guarantee: the evader's final distance to its target has fallen, 1.79 m",
        ),
        (Violation.BARRIER_LOST, "barrier: the evader can now reach its target"),
    ],
)
def test_an_alarm_says_by_how_much_in_which_unit(violation, words):
    assert Alarm(violation, 1.789).words == words
