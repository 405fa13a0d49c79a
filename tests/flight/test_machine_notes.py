"""What a flight tells: why an evader is refused, and what happened in the cycles of an error and after it."""

import math
from dataclasses import replace

import pytest

from guidance.autopilots import ARDUCOPTER, PX4, Mode
from guidance.flight import Authority, Event, Flight, Inputs, State
from guidance.flight.settings import Transition
from guidance.strategies import Strategy
from tests.flight.flown import Flown
from tests.flight.scenes import CYCLE, HOME_DOWN_M, NOW_S, home, settings_of


class Evader:
    """A tracking of which a test gives the answers; each one is asked about the present."""

    def __init__(self, silence_s=0.0, dropped="", rival="", height=""):
        self.answers = {
            "silence_s": silence_s,
            "unusable_words": dropped,
            "rival": rival,
            "height_refusal": height,
        }

    def __getattr__(self, name):
        def answer(now_s):
            assert now_s == NOW_S
            return self.answers[name]

        return answer


@pytest.mark.parametrize(
    ("evader", "far", "words"),
    [
        (Evader(), "", ""),
        (Evader(silence_s=1.5), "", ""),  # just the limit
        (
            Evader(silence_s=math.inf),
            "",
            "the evader was never heard; at most 1.5 s is allowed",
        ),
        (
            Evader(silence_s=2.34, dropped="3 reports are too old"),
            "",
            "the evader was last heard 2.3 s ago; 3 reports are too old; at most 1.5 s is allowed",
        ),
        (
            Evader(rival="place"),
            "",
            "two sources report as the evader (told apart by place); silence one, "
            "or set evader.second_source",
        ),
        (Evader(), "it is too far", "it is too far"),
        (Evader(height="it is too high"), "it is too far", "it is too far"),
        (Evader(height="it is too high"), "", "it is too high"),
    ],
)
def test_why_an_evader_is_refused(evader, far, words):
    flight = Flight(settings_of())
    flight.tracking = evader
    flight.observed.distance_refusal = lambda now_s: far if now_s == NOW_S else None
    assert flight.evader_refusal(NOW_S) == words


def test_a_second_source_is_no_refusal_if_the_configuration_allows_it():
    flight = Flight(settings_of(hold_on_rival=False))
    flight.tracking = Evader(rival="place")
    flight.observed.distance_refusal = lambda _now_s: ""
    assert flight.evader_refusal(NOW_S) == ""


def failed():
    """An engaged flight whose next cycle fails, and the outputs of that cycle."""
    flown = Flown().engaged()

    def broken(*_, **__):
        raise ZeroDivisionError("the speed is nil")

    flown.flight.tracking.observe = broken
    outputs = flown.cycle()
    return flown, outputs


def test_an_error_is_the_cause_of_the_state_that_it_leads_to():
    flown, outputs = failed()
    fault = Transition(
        flown.now_s, Event.FAULT, State.ENGAGED, State.YIELDED, detail=flown.flight.fault
    )
    assert outputs.transitions == (fault,)
    assert outputs.cause == flown.flight.cause == fault
    assert outputs.fault == flown.flight.fault


def test_after_an_error_every_order_is_told_as_one_without_an_effect():
    flown, outputs = failed()
    later = flown.flight.step(
        NOW_S, Inputs(orders=(Event.HOLD, Event.LAND), mission=(Event.RETURN,))
    )
    still = (State.YIELDED, State.YIELDED)
    assert later.transitions == (
        Transition(NOW_S, Event.HOLD, *still, Authority.OPERATOR),
        Transition(NOW_S, Event.LAND, *still, Authority.OPERATOR),
        Transition(NOW_S, Event.RETURN, *still, Authority.MISSION),
    )
    assert later.cause == outputs.cause
    again = flown.flight.give_up(NOW_S + 1.0, Inputs(orders=(Event.HOLD,)), ValueError("again"))
    assert again.transitions == (Transition(NOW_S + 1.0, Event.HOLD, *still, Authority.OPERATOR),)


def test_an_error_without_a_traceback_is_named_without_a_place():
    flown = Flown().engaged()
    outputs = flown.flight.give_up(flown.now_s, Inputs(), ValueError("no number"))
    assert outputs.fault == "ValueError: no number"


@pytest.mark.parametrize(
    ("mode", "landed", "state"),
    [
        (Mode.GUIDED, 2, State.STANDING_BY),
        (Mode.GUIDED, 1, State.ARMING),
        (Mode.HOLD, 1, State.READY),
        (Mode.OTHER, 2, State.READY),
    ],
)
def test_a_start_takes_a_vehicle_in_the_mode_that_guidance_itself_registered(mode, landed, state):
    flown = Flown(settings_of(replace(PX4, guided_is_ours=True)))
    flown.mode = mode
    flown.armed = True
    flown.landed = landed
    flown.position[2] = HOME_DOWN_M - (10.0 if landed == 2 else 0.0)
    flown.cycles(0.1)
    assert flown.cycle(Event.START).state is state


def test_a_refused_order_is_told_with_its_time_and_the_state():
    flown = Flown()
    flown.cycles(0.1)
    refused = flown.cycle(Event.ENGAGE).transitions
    assert refused == (
        Transition(flown.now_s, Event.ENGAGE, State.READY, State.READY, Authority.OPERATOR),
    )


def test_a_home_that_is_not_used_is_told_with_its_time_and_the_state():
    flown = Flown().standing_by()
    moved = home(flown.now_s)._replace(latitude_deg=47.398)
    notes = flown.cycle(more=[moved]).transitions
    ((event, words),) = flown.flight.observed.notes
    still = (State.STANDING_BY, State.STANDING_BY)
    assert notes == (Transition(flown.now_s, event, *still, detail=words),)
    assert event is Event.HOME_MOVED
    assert words


def test_a_second_source_that_is_allowed_is_told_with_its_time_and_the_state(monkeypatch):
    flown = Flown(settings_of(hold_on_rival=False)).engaged()
    asked_s = []

    def rival(now_s):
        asked_s.append(now_s)
        return "place"

    monkeypatch.setattr(flown.flight.tracking, "rival", rival)
    notes = flown.cycle().transitions
    assert notes == (Transition(flown.now_s, Event.RIVAL, State.ENGAGED, State.ENGAGED),)
    assert set(asked_s) == {flown.now_s}


def test_a_pilot_who_chose_our_mode_before_the_game_gets_a_hover_and_in_the_hold_none_is_sent():
    flown = Flown(settings_of(replace(PX4, guided_is_ours=True))).standing_by()
    assert {output.setpoint for output in flown.cycles(2.0)} == {None}
    flown.mode = Mode.GUIDED
    assert flown.cycle(beat=True).state is State.STANDING_BY
    assert all(output.setpoint is not None for output in flown.cycles(1.0))


def test_a_hold_of_a_vehicle_in_our_own_mode_is_waited_for_and_choosing_the_mode_again_is_free():
    flown = Flown(settings_of(replace(PX4, guided_is_ours=True)))
    flown.mode = Mode.GUIDED
    flown.armed = True
    flown.landed = 2
    flown.cycles(0.1)
    assert flown.cycle(Event.HOLD).state is State.HOLDING
    assert flown.flight.leaving_modes == (Mode.GUIDED,)
    flown.mode = Mode.HOLD
    flown.cycle(beat=True)
    assert flown.flight.leaving_modes == (Mode.GUIDED,)
    flown.cycles(3.2)
    assert flown.flight.leaving_modes == ()
    flown.mode = Mode.GUIDED
    flown.cycle(beat=True)
    assert flown.state is State.HOLDING
    assert flown.flight.leaving_modes == ()


def test_every_cycle_names_the_transition_that_led_to_its_state():
    flown = Flown()
    assert flown.cycle(silent=True).cause is None
    flown.engaged()
    cause = flown.cycle().cause
    assert cause is not None
    assert (cause.event, cause.after) == (flown.flight.cause.event, State.ENGAGED)


class ByPolicy(Flown):
    """A flight of a user's policy, or of its recorded answer."""

    def __init__(self, ask=None, recorded=None):
        super().__init__(settings_of(cycle=replace(CYCLE, policy=Strategy("anywhere:chase"))))
        self.flight = Flight(self.flight.settings, ask)
        self.recorded = recorded

    def inputs(self, *read):
        return super().inputs(*read)._replace(answer=self.recorded)


def test_every_cycle_tells_the_answer_of_the_users_policy_and_the_record_flies_the_same():
    answer = (0.5, -0.5, 0.25)
    asked = ByPolicy(lambda _observation: answer).engaged()
    replayed = ByPolicy(recorded=answer).engaged()
    flown = asked.cycles(0.2)
    assert {output.answer for output in flown} == {answer}
    assert [output.setpoint for output in replayed.cycles(0.2)] == [
        output.setpoint for output in flown
    ]
    assert asked.cycle(Event.HOLD).answer is None


def test_a_vehicle_that_climbs_in_the_guided_mode_gets_a_hover_until_it_has_left_it():
    flown = Flown(settings_of(ARDUCOPTER)).climbing()
    assert flown.mode is Mode.GUIDED
    assert flown.cycle(Event.HOLD).setpoint is not None


def test_a_second_source_that_is_allowed_is_told_also_in_the_first_cycle(monkeypatch):
    flown = Flown(settings_of(hold_on_rival=False))
    monkeypatch.setattr(flown.flight.tracking, "rival", lambda _now_s: "place")
    assert Event.RIVAL in {transition.event for transition in flown.cycle().transitions}
