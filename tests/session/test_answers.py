"""What people are told of a flight that the test feeds by hand: status, reasons of refusals, and what to order next."""

import math
from dataclasses import replace

import pytest

from guidance.autopilots import Finding, Mode
from guidance.flight import Event, Inputs, State
from guidance.frames import Enu
from guidance.messages import EvaderReport, SystemStatus
from guidance.session.orders.answers import (
    flight_line,
    foreseen,
    missing,
    next_words,
    refusal,
    shown_state,
    status,
    to_do,
)
from tests.flight import scenes
from tests.flight.flown import Flown
from tests.flight.scenes import CYCLE, HOME_DOWN_M, QUIET, local, settings_of

REFUSED = Finding.of(False, "GF_ACTION", "0", "2", "set it")
PASSED = Finding.of(True, "GF_MAX", "1", "1", "")
ENDINGS = {
    Event.HOLD: (State.HOLDING, "held", "engage, return or land"),
    Event.RETURN: (State.RETURNING, "returning", "hold or land"),
    Event.LAND: (State.LANDING, "landing", "hold or return"),
}


def answer(order, flown, *rows):
    return refusal(order, flown.flight, flown.now_s, rows)


def moving():
    flown = Flown().engaged()
    flown.velocity = [3.0, 4.0, 0.0]
    flown.cycle()
    return flown


def test_the_status_of_a_game_has_these_fields():
    flown = moving()
    told = status(flown.flight, flown.outputs, (REFUSED, PASSED), ("GF_ACTION",), flown.now_s)
    game = told.pop("certificate")
    refused = told.pop("refused_orders")
    assert told == {
        "state": "engaged",
        "mode": "guided",
        "autopilot_mode": "OFFBOARD",
        "armed": True,
        "engage_on": "command",
        "after_capture": "hold",
        "streaming": True,
        "heartbeat_age_s": 0.02,
        "position_age_s": 0.0,
        "evader_silence_s": 0.0,
        "battery_needed": 0.25,
        "operator_silence_s": 0.04,
        "operator_timeout_s": None,
        "evader_second_source": "",
        "evader_doubts": [],
        "evader_reports_dropped": {},
        "position_ned_m": [0.0, 0.0, -14.0],
        "velocity_ned_m_s": [3.0, 4.0, 0.0],
        "height_m": 10.0,
        "battery": 0.9,
        "checks_failed": [],
        "preflight_refused": ["GF_ACTION"],
        "to_do": [
            {
                "name": "GF_ACTION",
                "found": "0",
                "wanted": "2",
                "verdict": "refuse",
                "advice": "set it",
            }
        ],
        "by": "flight",
        "cause": "guided mode confirmed",
        "next": "",
        "range_m": 60.83,
        "value_unit": "s",
    }
    assert [game[name] for name in ("reason", "winner", "vehicle_winner")] == [
        "solved",
        "pursuer",
        "pursuer",
    ]
    accepted = {order for order, reason in refused.items() if not reason}
    assert accepted == {"abort", "hold", "land", "return"}
    assert refused["start"] == f"under way already: {refused['engage']}"


def test_a_second_source_is_told_as_it_is_now(monkeypatch):
    flown = Flown().standing_by()
    monkeypatch.setattr(flown.flight.tracking, "rival", {flown.now_s: "place"}.get)
    told = status(flown.flight, flown.outputs, (), (), flown.now_s)
    assert told["evader_second_source"] == "place"


def test_what_bars_the_vehicle_is_foreseen_in_the_status():
    flown = Flown().standing_by()
    for barred in ((), ("GF_ACTION",)):
        told = status(flown.flight, flown.outputs, (REFUSED,), barred, flown.now_s)
        assert bool(told["refused_orders"]["engage"]) is bool(barred)


def test_the_numbers_of_a_status_are_rounded_and_a_height_of_nothing_has_no_sign():
    flown = Flown().standing_by()
    flown.position = [1.23456, -2.34567, HOME_DOWN_M + 0.00456]
    flown.velocity = [0.12345, 0.23456, -0.34567]
    flown.cycle(more=[scenes.status(flown.now_s, 0.87654)])
    told = status(flown.flight, flown.outputs, (), (), flown.now_s + 0.123456)
    assert told["position_ned_m"] == [1.23, -2.35, -4.0]
    assert told["velocity_ned_m_s"] == [0.12, 0.23, -0.35]
    assert told["battery"] == 0.877
    assert str(told["height_m"]) == "0.0"
    assert told["position_age_s"] == 0.1235
    flown.position[2] = HOME_DOWN_M + 0.04
    flown.cycle()
    assert "  0.0 m up, 0.3 m/s  " in flight_line(flown.flight, flown.outputs, flown.now_s)
    flown.position[2] = HOME_DOWN_M - 10.256
    flown.cycle()
    assert "  10.3 m up, 0.3 m/s  " in flight_line(flown.flight, flown.outputs, flown.now_s)
    assert status(flown.flight, flown.outputs, (), (), flown.now_s)["height_m"] == 10.26


def test_the_height_before_a_home_is_known_is_that_of_the_local_frame():
    flown = Flown()
    flown.flight.step(flown.now_s, Inputs([local(flown.now_s, (0.0, 0.0, -3.0))]))
    flown.cycle(silent=True)
    told = status(flown.flight, flown.outputs, (), (), flown.now_s)
    assert (told["height_m"], told["battery"]) == (3.0, None)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"reason": None, "vehicle_winner": None, "winner": -1}, (None, "evader", "undecided")),
        ({"reason": 1, "vehicle_winner": -1, "winner": 0}, ("captured", "undecided", "evader")),
    ],
)
def test_what_a_certificate_says_is_told_in_words_and_numbers(changes, words):
    flown = Flown(settings_of(cycle=replace(CYCLE, target_game_m=Enu((0.0, 0.0, 0.0)))))
    flown.cycle()
    places = {"pursuer_game_m": Enu((3.0, 4.0, 12.0)), "evader_game_m": Enu((0.0, 0.0, 0.123))}
    certificate = QUIET._replace(value=1.234567, gap_m=9.87, **places, **changes)
    outputs = flown.outputs._replace(certificate=certificate)
    told = status(flown.flight, outputs, (), (), flown.now_s)
    game = told["certificate"]
    assert (game["reason"], game["winner"], game["vehicle_winner"]) == words
    assert (game["value"], told["range_m"], told["value_unit"]) == (1.2346, 12.89, "m")
    assert "  rim 9.9 m, value 1.2 m  " in flight_line(flown.flight, outputs, flown.now_s)


def test_the_status_of_a_vehicle_that_was_never_heard_has_no_numbers():
    flown = Flown()
    flown.cycle(silent=True)
    told = status(flown.flight, flown.outputs, (), (), flown.now_s)
    assert (told["state"], told["mode"], told["autopilot_mode"]) == (
        "connecting",
        "unknown",
        "unknown",
    )
    assert not (told["armed"])
    assert not (told["streaming"])
    ages = ("heartbeat_age_s", "position_age_s", "evader_silence_s")
    assert [told[age] for age in ages] == [None] * 3
    assert [told[name] for name in ("by", "cause", "certificate")] == [None] * 3
    assert not {"position_ned_m", "height_m", "battery", "range_m", "value_unit"} & told.keys()
    assert told["checks_failed"][0] == "autopilot"
    assert len(told["to_do"]) == len(told["checks_failed"])
    assert {order for order, reason in told["refused_orders"].items() if not reason} == {"abort"}


def test_a_charge_that_is_not_known_is_null_and_left_out_of_the_line():
    flown = moving()
    flown.cycle(more=[SystemStatus(flown.now_s, 0, 0, math.nan)])
    assert status(flown.flight, flown.outputs, (), (), flown.now_s)["battery"] is None
    line = flight_line(flown.flight, flown.outputs, flown.now_s)
    assert "battery" not in line


def test_the_line_of_a_terminal_shows_the_flight_at_a_glance():
    flown = moving()
    line = flight_line(flown.flight, flown.outputs, flown.now_s)
    assert line.split("  ") == [
        "50 s",
        "engaged",
        "OFFBOARD, armed",
        "10.0 m up, 5.0 m/s",
        "battery 90%",
        "position 0.0 s old",
        "rim 57.0 m, value 19.0 s",
        "evader 0.0 s ago",
    ]
    unheard = Flown()
    unheard.cycle(silent=True)
    line = flight_line(unheard.flight, unheard.outputs, unheard.now_s)
    assert line.split("  ") == ["50 s", "connecting", "unknown, disarmed", "no evader"]


@pytest.mark.parametrize("order", ENDINGS)
def test_an_order_that_stands_is_named_with_the_orders_that_change_it(order):
    state, pause, orders = ENDINGS[order]
    flown = Flown().engaged()
    assert next_words(flown.flight) == ""
    flown.cycle(order)
    assert flown.state is state
    words = next_words(flown.flight)
    assert words.startswith(f"{pause} by operator: ")
    assert words.endswith(f"guidance ctl {orders}")
    assert answer(Event.START, flown) == f"under way already: {answer(order, flown)}"


def test_a_state_that_the_flight_entered_by_itself_names_no_order():
    flown = Flown().engaged()
    flown.mode = Mode.OTHER
    flown.cycle(beat=True)
    assert flown.state is State.YIELDED
    assert next_words(flown.flight) == ""
    words = answer(Event.ENGAGE, flown)
    assert "a pilot or the autopilot chose that mode" in words
    assert words.endswith("order reset to begin another")


def test_lost_telemetry_while_standing_by_is_named_until_an_order():
    flown = Flown().standing_by()
    flown.cycles(3.0, silent=True)
    assert flown.state is State.OUT_OF_CONTACT
    assert "guidance ctl hold, return or land" in next_words(flown.flight)
    assert "out of contact" in answer(Event.ENGAGE, flown)
    flown.cycles(3.0)
    assert flown.state is State.STANDING_BY
    assert next_words(flown.flight).endswith("guidance ctl engage, return or land")


def test_before_the_start_each_refusal_says_what_is_missing():
    flown = Flown()
    flown.cycle(silent=True)
    for order in (Event.START, Event.ENGAGE, Event.HOLD):
        assert "is not heard" in answer(order, flown)
    flown.cycle()
    assert flown.cycle(refusals=("GF_ACTION",)).state is State.CHECKING
    for order in (Event.HOLD, Event.RETURN, Event.LAND):
        assert "not armed" in answer(order, flown)
    for order in (Event.START, Event.ENGAGE):
        words = answer(order, flown, REFUSED)
        assert words.startswith("not ready: ")
        assert "GF_ACTION" in words
    flown.cycle()
    assert flown.state is State.READY
    assert answer(Event.START, flown).startswith("not ready: the checks have just passed")
    assert answer(Event.ENGAGE, flown) == "on the ground: order start first"
    flown.armed = True
    flown.landed = 2
    flown.cycle(beat=True)
    assert shown_state(flown.flight) == "not taken over"
    assert answer(Event.ENGAGE, flown).startswith("airborne")
    flown.mode = Mode.GUIDED
    flown.cycle(beat=True)
    assert answer(Event.START, flown).startswith("it flies in OFFBOARD")
    flown.landed = 1
    flown.cycle(beat=True)
    assert answer(Event.START, flown).startswith("somebody else armed it, in OFFBOARD")
    assert shown_state(flown.flight) == "ready"
    flown.armed = False
    flown.cycle(beat=True)
    assert shown_state(flown.flight) == "ready"
    words = answer(Event.START, flown)
    assert words.startswith("somebody else had it armed, in HOLD and OFFBOARD, less than 2.5 s ")


def test_an_engagement_is_refused_with_the_first_thing_that_bars_it():
    flown = Flown(settings_of()).standing_by()
    assert answer(Event.ENGAGE, flown).startswith("not ready: the checks have just passed")
    assert answer(Event.ENGAGE, flown, REFUSED).startswith("not ready: GF_ACTION")
    flown.evader = None
    flown.cycles(3.0)
    assert answer(Event.ENGAGE, flown).startswith("the evader was last heard 3.0 s ago")
    grounded = Flown()
    grounded.cycles(0.1)
    grounded.cycle(Event.START)
    grounded.cycle(Event.HOLD)
    assert grounded.state is State.HOLDING
    assert answer(Event.ENGAGE, grounded).startswith("it stands on the ground")
    found = Flown()
    found.armed = True
    found.landed = 2
    found.mode = Mode.OTHER
    found.cycles(0.1)
    found.cycle(Event.HOLD)
    assert answer(Event.ENGAGE, found).startswith(
        "HEARTBEATs of the last 2.5 s show it in another mode"
    )


def test_after_an_error_of_our_own_every_order_names_it():
    flown = Flown().engaged()
    impossible = EvaderReport(flown.now_s, flown.now_s, "x", None, 0.0, 0.0, None, 0.0, 0.0)
    flown.cycle(reports=[impossible])
    assert flown.flight.fault is not None
    words = answer(Event.HOLD, flown)
    assert words.startswith(f"guidance failed ({flown.flight.fault})")
    assert words.endswith("order reset to begin another")


def test_what_is_missing_is_every_failed_check_and_every_refused_row():
    flown = Flown()
    flown.cycle(silent=True)
    words = missing(flown.flight, flown.now_s, (REFUSED, PASSED))
    parts = words.split("; ")
    checks = parts[0]
    rows = parts[-1]
    assert checks.startswith("autopilot (not heard), Heartbeat (not heard), ")
    assert "GF_ACTION" in rows
    assert "GF_MAX" not in words
    names = [row["name"] for row in to_do(flown.flight, flown.now_s, (REFUSED, PASSED))]
    assert names[0] == "autopilot"
    assert names[-1] == "GF_ACTION"
    flown.cycles(0.1)
    assert missing(flown.flight, flown.now_s, ()).startswith("the checks have just passed")
    assert to_do(flown.flight, flown.now_s, (PASSED,)) == []


def test_every_order_is_foreseen_by_the_state_that_it_would_lead_to():
    flown = Flown().standing_by()

    def accepted(*barred):
        reasons = foreseen(flown.flight, flown.now_s, (REFUSED,), barred)
        return [order for order, reason in reasons.items() if not reason]

    assert accepted() == ["abort", "engage", "hold", "land", "return"]
    assert accepted("GF_ACTION") == ["abort", "hold", "land", "return"]
    flown.cycle(Event.HOLD)
    assert accepted() == ["abort", "engage", "hold", "land", "return"]
