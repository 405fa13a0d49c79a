"""What one cycle leaves to the next: it moves with the local frame, and goes on or begins anew with a state."""

import pytest

from guidance.autopilots import Mode
from guidance.control.follow import Drift, FollowMemory
from guidance.control.servo import AltitudeHold
from guidance.cycle import CycleMemory, MonitorMemory
from guidance.flight import EngageOn, Event, State
from guidance.flight.machine import INVITE_AFTER_S
from guidance.flight.sending import Playing
from guidance.frames import Enu, Ned
from tests.flight.flown import CYCLE_S, Flown
from tests.flight.scenes import QUIET, SETTINGS, settings_of

BEGUN = CycleMemory(
    follow=FollowMemory(deficit_m=2.0, drift=Drift(Ned((0.1, 0.2, 0.3)), Ned((1.0, 2.0, -30.0)))),
    place=(5.0, 6.0),
    height=AltitudeHold(-31.0, 0.4),
)
PROMISED = MonitorMemory(lost=False)


def test_remembered_positions_move_with_the_local_frame_and_nothing_else_does():
    playing = Playing(SETTINGS)
    playing.memory = BEGUN
    playing.move(Ned((10.0, -20.0, 3.0)))
    assert playing.memory == BEGUN._replace(
        follow=BEGUN.follow._replace(drift=Drift(Ned((0.1, 0.2, 0.3)), Ned((11.0, -18.0, -27.0)))),
        place=(15.0, -14.0),
        height=AltitudeHold(-28.0, 0.4),
    )
    playing.memory = CycleMemory()
    playing.move(Ned((10.0, -20.0, 3.0)))
    assert playing.memory == CycleMemory()


@pytest.mark.parametrize(
    ("before", "after", "remembers", "watches_on"),
    [
        (State.STANDING_BY, State.ENTERING, False, False),
        (State.ENTERING, State.ENGAGED, True, True),
        (State.ENGAGED, State.PAUSED, True, True),
        (State.PAUSED, State.ENGAGED, True, True),
        (
            State.ENGAGED,
            State.ON_STATION,
            True,
            False,
        ),  # the promise is kept: the next one is another
        (State.ON_STATION, State.ENGAGED, True, True),
        (State.ENGAGED, State.HOLDING, False, False),
    ],
)
def test_a_change_of_state_keeps_what_goes_on(before, after, remembers, watches_on):
    playing = Playing(SETTINGS)
    playing.memory = BEGUN
    playing.monitor = PROMISED
    playing.certificate = QUIET
    playing.change(before, after)
    assert playing.memory == (BEGUN if remembers else CycleMemory())
    assert playing.monitor == (PROMISED if watches_on else MonitorMemory())
    assert playing.certificate is None


def test_nothing_was_promised_about_a_pause():
    playing = Playing(SETTINGS)
    playing.monitor = PROMISED._replace(
        best=20.0, since_s=3.0, oldest_s=0.2, reachable_m_s=8.0, reported_slow=True
    )
    playing.change(State.ENGAGED, State.PAUSED)
    assert playing.monitor == PROMISED.restarted()._replace(
        oldest_s=0.2, reachable_m_s=8.0, reported_slow=True
    )


def test_nothing_was_promised_about_the_evader_played_next():
    playing = Playing(SETTINGS)
    playing.memory = BEGUN._replace(optimal_game_m_s=Enu((3.0, -4.0, 0.0)))
    playing.monitor = PROMISED
    playing.certificate = QUIET
    playing.switch()
    assert playing.certificate is None
    assert playing.monitor == MonitorMemory()
    assert playing.memory == BEGUN  # the vehicle's own height and place go on


def test_silence_clears_the_alarm():
    flown = Flown(settings_of(guarantee_slack_s=0.0)).engaged()
    assert any(flown.cycle().alarm is not None for _ in range(100))
    flown.cycle(Event.HOLD)
    flown.mode = Mode.HOLD
    assert flown.cycle(beat=True).alarm is None


def test_a_pilot_who_climbs_with_the_neutral_stream_is_not_pulled_back():
    flown = Flown(settings_of(engage_on=EngageOn.PILOT_MODE)).standing_by()
    flown.cycles(INVITE_AFTER_S + 0.5)
    flown.mode = Mode.OTHER
    flown.velocity = [0.0, 0.0, -3.0]
    for _ in range(100):
        flown.position[2] -= 3.0 * CYCLE_S
        flown.cycle()
    assert flown.outputs.setpoint.velocity_ned_m_s == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)


def test_a_held_height_jumps_with_the_position_estimate():
    flown = Flown().engaged()
    flown.evader = None
    flown.cycles(5.0)
    assert flown.state is State.PAUSED
    flown.position[2] -= 5.0
    assert flown.cycle().setpoint.velocity_ned_m_s == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)


def test_a_cycle_in_which_a_pilot_takes_over_has_no_alarm_any_more():
    flown = Flown(settings_of(guarantee_slack_s=0.0)).engaged()
    assert any(flown.cycle().alarm is not None for _ in range(100))
    flown.mode = Mode.OTHER
    taken = flown.cycle(beat=True)
    assert (taken.state, taken.alarm) == (State.YIELDED, None)
