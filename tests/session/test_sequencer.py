import pytest

from guidance.flight import Event, Outputs, State
from guidance.session.mission import MissionSequencer


def told(director, now_s, state):
    director.follow(now_s, Outputs(state, None, (), (), None))


def orders(director, now_s, *, ready=True, fresh=True):
    return director.order(now_s, evader_ready=ready, evader_fresh=fresh)


@pytest.fixture
def director():
    return MissionSequencer(3.0, 60.0)


def test_the_flight_starts_only_when_the_evader_is_ready(director):
    told(director, 1.0, State.READY)
    assert orders(director, 1.0, ready=False) is None
    assert orders(director, 1.0) is Event.START


def test_the_game_is_engaged_once_and_only_with_an_evader_that_is_heard(director):
    told(director, 1.0, State.STANDING_BY)
    assert orders(director, 1.0, fresh=False) is None
    assert orders(director, 1.0) is Event.ENGAGE
    told(director, 2.0, State.ENGAGED)
    told(director, 9.0, State.STANDING_BY)
    assert orders(director, 9.1) is None


def test_the_evader_plays_from_engagement_until_capture(director):
    assert not director.playing
    told(director, 2.0, State.ENGAGED)
    assert director.playing
    told(director, 4.0, State.PAUSED)
    assert director.playing
    told(director, 9.0, State.ON_STATION)
    assert not director.playing
    assert director.engaged_s == 2.0


def test_after_capture_it_holds_and_then_lands(director):
    told(director, 10.0, State.ON_STATION)
    assert orders(director, 12.9) is None
    assert orders(director, 13.0) is Event.LAND


@pytest.mark.parametrize("state", [State.HOLDING, State.STANDING_BY])
def test_a_hold_that_leads_nowhere_is_landed(director, state):
    director.engaged_s = 0.0
    told(director, 10.0, state)
    assert orders(director, 12.0) is Event.LAND


@pytest.mark.parametrize("state", [State.ENGAGED, State.PAUSED])
def test_a_game_over_its_time_is_landed(director, state):
    told(director, 5.0, State.ENGAGED)
    told(director, 6.0, state)
    assert orders(director, 64.0) is None
    assert orders(director, 65.5) is Event.LAND


@pytest.mark.parametrize("state", [State.LANDED, State.FAILED])
def test_a_final_state_is_the_end_and_gets_no_orders(director, state):
    told(director, 5.0, state)
    assert director.finished
    assert orders(director, 500.0) is None


def test_a_pilot_who_took_over_is_watched_for_two_seconds_and_given_no_orders(director):
    told(director, 5.0, State.ENGAGED)
    told(director, 6.0, State.YIELDED)
    assert not director.finished
    assert orders(director, 7.0) is None
    told(director, 8.0, State.YIELDED)
    assert director.finished


@pytest.mark.parametrize(("state", "limit_s"), [(State.READY, 60.0), (State.RETURNING, 300.0), (State.LANDING, 300.0)])
def test_a_state_that_leads_nowhere_is_given_up(director, state, limit_s):
    told(director, 5.0, state)
    told(director, 4.9 + limit_s, state)
    assert not director.finished
    told(director, 5.1 + limit_s, state)
    assert director.finished
