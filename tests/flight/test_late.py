"""Late telemetry: named, it keeps the vehicle on the ground, ends a game, and lengthens the reaction before walls."""

import math

import pytest

from guidance.autopilots import Mode
from guidance.boot_clock import UNKNOWN_S
from guidance.flight import EngageOn, Event, State
from guidance.flight.observed import ORDINARY_AGE_S
from guidance.messages import LocalPosition
from guidance.session.orders.answers import failed_checks, refusal
from tests.flight.flown import CYCLE_S, Flown
from tests.flight.scenes import settings_of

REACTION_S = Flown().flight.observed.cycle.envelope.reaction_s


class Late(Flown):
    """A vehicle whose positions come `late_s` after their stamps. Its answers to TIMESYNC come at once."""

    late_s = 0.0

    def inputs(self, said, *rest):
        positions = [
            message._replace(time_boot_s=message.time_boot_s - self.late_s)
            if isinstance(message, LocalPosition)
            else message
            for message in said
        ]
        return super().inputs(positions, *rest)


def grown(flight, late_s, per_s):
    """Let the delay grow; return the state of every cycle."""
    states = []
    while flight.late_s < late_s:
        flight.late_s += per_s * CYCLE_S
        flight.cycle()
        states.append(flight.state)
    return states


def test_a_constant_delay_keeps_the_vehicle_on_the_ground_and_is_named():
    late = Late()
    late.late_s = 1.5
    late.cycles(2.0)
    assert late.state is State.CHECKING
    assert "delay (1.50 s)" in failed_checks(late.flight, late.now_s)
    late.late_s = 0.0
    late.cycles(1.0)
    assert late.state is State.READY


@pytest.mark.parametrize("per_s", [0.1, 0.3, 0.5])
def test_a_growing_delay_hands_the_vehicle_to_its_hold_before_a_position_is_a_second_old(per_s):
    """Catches a delay that grows slowly enough to pass for a clock's drift."""
    late = Late().engaged()
    states = grown(late, 3.0, per_s)
    assert states[0] is State.ENGAGED
    assert states[-1] is State.HOLDING
    assert late.flight.cause.event is Event.LATE
    assert "telemetry is 0." in late.flight.cause.words


def test_no_setpoint_uses_a_position_older_than_a_second():
    late = Late().engaged()
    sent = set()
    while late.late_s < 2.0:
        late.late_s += 0.9 * CYCLE_S
        outputs = late.cycle()  # HEARTBEAT goes on showing the guided mode, so a hover is due
        sent.add((late.late_s <= 1.0, outputs.setpoint is not None))
    assert sent == {(True, True), (False, False)}
    assert late.state is State.HOLDING


def test_a_delay_that_has_become_unknown_ends_the_game():
    late = Late().engaged()
    late.late_s = -5.0  # its clock was set
    late.beat_s = math.inf  # and it answers nothing more
    late.cycles(UNKNOWN_S - 0.1)
    assert late.state is State.ENGAGED
    late.cycles(0.2)
    assert late.state is State.HOLDING
    assert late.flight.cause.event is Event.LATE
    assert "unknown: TIMESYNC is not answered" in late.flight.cause.words


def test_a_late_vehicle_that_was_handed_over_is_still_ordered():
    late = Late().engaged()
    grown(late, 3.0, 0.5)
    late.mode = Mode.HOLD
    late.cycles(5.0)
    assert late.state is State.HOLDING
    late.cycle(Event.LAND)
    assert late.state is State.LANDING


def test_late_telemetry_bars_an_engagement_and_the_answer_names_it():
    late = Late().standing_by()
    grown(late, 0.7, 0.5)
    late.cycles(1.0)
    late.cycle(Event.ENGAGE)
    assert late.state is State.STANDING_BY
    assert "telemetry is 0.7 s late" in refusal(Event.ENGAGE, late.flight, late.now_s, ())


def test_late_telemetry_bars_a_pilots_engagement():
    late = Late(settings_of(engage_on=EngageOn.PILOT_MODE)).standing_by()
    grown(late, 0.7, 0.5)
    late.cycles(3.0)
    late.mode = Mode.GUIDED
    late.cycles(2.0)
    assert late.state is State.STANDING_BY


@pytest.mark.parametrize("late_s", [0.0, 0.3, 0.45])
def test_the_vehicle_brakes_before_walls_by_its_delay_too(late_s):
    late = Late().engaged()
    grown(late, late_s, 0.5)
    late.cycles(0.5)
    more_s = late.flight.observed.cycle.envelope.reaction_s - REACTION_S
    beyond_s = max(0.0, late_s - ORDINARY_AGE_S)
    assert beyond_s - 1e-6 <= more_s <= beyond_s + 0.0501


@pytest.mark.parametrize("late_s", [0.0, 0.3])
def test_the_vehicle_brakes_by_the_silence_since_the_last_position_too(late_s):
    late = Late().engaged()
    grown(late, late_s, 0.5)
    late.cycles(0.5)
    silent_s = 0.0
    while silent_s < 0.4:
        silent_s += CYCLE_S
        late.cycle(silent=True)
        more_s = late.flight.observed.cycle.envelope.reaction_s - REACTION_S
        beyond_s = max(0.0, late_s + silent_s - ORDINARY_AGE_S)
        assert beyond_s - 1e-6 <= more_s <= beyond_s + 0.0501
    late.cycle()
    assert late.flight.observed.cycle.envelope.reaction_s - REACTION_S <= late_s
