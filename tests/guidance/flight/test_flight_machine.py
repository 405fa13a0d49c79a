"""The flight's step, fed by hand: what is asked and when, what is sent and when there is silence."""

import math
from dataclasses import replace
from itertools import pairwise

import pytest
from flight_scenes import (
    BOTH,
    ENVELOPE,
    HOME_DOWN_M,
    SETTINGS,
    heartbeat,
    home,
    local,
    settings_of,
    status,
)

from guidance.autopilots import ARDUCOPTER, GPS_GLOBAL_ORIGIN, HOME_POSITION, PX4, Mode
from guidance.flight import FINAL, ORDERS, AfterCapture, EngageOn, Event, Flight, FlightSettings, Inputs, State
from guidance.flight.machine import INVITE_AFTER_S, REPEAT_S, STREAM_FIRST_S
from guidance.flight.requests import requests_in
from guidance.flight.table import HANDING_OVER, SETPOINT_STATES
from guidance.frames import Amsl
from guidance.monitor import Broken
from guidance.telemetry import Attitude, LandedState, Odometry, PositionTarget, TargetReport
from guidance.vehicle import VehicleState, observe

TICK_S = 0.02
START_S = 50.0


class Flown:
    """A flight and its vehicle's word for it: every tick a position, every second (or at once) a HEARTBEAT."""

    def __init__(self, settings=SETTINGS):
        self.flight = Flight(settings)
        self.profile = settings.profile
        self.now_s = START_S
        self.mode, self.armed, self.landed = Mode.HOLD, False, 1
        self.position = [0.0, 0.0, HOME_DOWN_M]
        self.velocity = [0.0, 0.0, 0.0]
        self.yaw_rad = 0.7
        self.target = None
        self.outputs = None
        self.beat_s = -math.inf

    @property
    def state(self):
        return self.flight.state

    def tick(self, *orders, beat=False, dt_s=TICK_S, more=(), refusals=(), silent=False):
        self.now_s += dt_s
        said = [] if silent else [local(self.now_s, tuple(self.position), tuple(self.velocity))]
        if beat or (not silent and self.now_s - self.beat_s >= 1.0 - 1e-9):
            self.beat_s = self.now_s
            said += [
                heartbeat(self.now_s, self.mode, armed=self.armed, profile=self.profile),
                Attitude(self.now_s, self.now_s, self.yaw_rad),
                LandedState(self.now_s, self.landed),
                status(self.now_s),
                home(self.now_s),
            ]
        reports = [] if self.target is None else [self.report()]
        self.outputs = self.flight.step(Inputs(self.now_s, [*said, *more], reports, orders, refusals))
        return self.outputs

    def report(self):
        north_m, east_m = self.target
        latitude_deg = 47.397742 + math.degrees(north_m / 6371000.0)
        longitude_deg = 8.545594 + math.degrees(east_m / (6371000.0 * math.cos(math.radians(47.397742))))
        return TargetReport(
            self.now_s, self.now_s, "test", latitude_deg, longitude_deg, 492.0, (0.0, 0.0, 0.0), 0.1, 0.1
        )

    def ticks(self, seconds, **given):
        return [self.tick(**given) for _ in range(round(seconds / TICK_S))]

    def standing_by(self):
        self.tick()
        self.tick()
        assert self.state is State.READY
        self.armed, self.landed, self.position[2] = True, 2, HOME_DOWN_M - 10.0
        self.tick(beat=True)
        self.tick(Event.START)
        assert self.state is State.STANDING_BY
        return self

    def engaged(self, target=(60.0, 0.0)):
        self.target = target
        self.standing_by()
        self.tick(Event.ENGAGE)
        self.mode = Mode.GUIDED
        self.tick(beat=True)
        assert self.state is State.ENGAGED
        return self


def commands(outputs):
    return [request.command for one in outputs for request in one.requests]


SET_MODE, ARM, TAKEOFF, REPOSITION, INTERVAL, MESSAGE = 176, 400, 22, 192, 511, 512


def test_a_flight_begins_with_a_heartbeat_and_asks_for_streams_home_and_origin():
    flown = Flown()
    assert flown.flight.mode_name == "unknown"
    assert flown.tick(silent=True).state is State.CONNECTING
    first = flown.tick()
    assert (first.state, first.happenings[0].event) == (State.CHECKING, Event.HEARD)
    assert flown.flight.mode_name == "hold"
    assert [request.command for request in first.requests] == [INTERVAL] * 7 + [MESSAGE] * 2
    assert [request.params[0] for request in first.requests[-2:]] == [HOME_POSITION, GPS_GLOBAL_ORIGIN]
    assert flown.tick().state is State.READY


def test_what_preflight_refuses_keeps_a_vehicle_from_being_ready_and_takes_readiness_away():
    flown = Flown()
    flown.tick()
    assert flown.tick(refusals=("GF_ACTION",)).state is State.CHECKING
    assert flown.tick().state is State.READY
    assert flown.tick(refusals=("GF_ACTION",)).state is State.CHECKING
    assert [check.name for check in flown.flight.checks(flown.now_s) if not check.passed] == []


def test_the_time_in_a_phase_counts_from_its_entry():
    flown = Flown()
    assert flown.tick(silent=True).state is State.CONNECTING
    outputs = flown.ticks(30.0, silent=True)
    assert [one.state for one in outputs[-2:]] == [State.CONNECTING] * 2
    assert flown.ticks(0.1, silent=True)[-1].state is State.FAILED


def test_a_request_is_repeated_when_a_heartbeat_shows_that_it_had_no_effect_and_not_before():
    flown = Flown()
    flown.tick()
    flown.tick()
    asked = flown.tick(Event.START)
    assert asked.state is State.ARMING
    assert commands([asked]) == [SET_MODE, ARM]
    assert commands(flown.ticks(REPEAT_S - 0.06)) == []  # a HEARTBEAT came meanwhile
    flown.beat_s = flown.now_s
    assert commands(flown.ticks(0.5)) == []  # due, and nothing was heard
    assert commands([flown.tick(beat=True)]) == [SET_MODE, ARM]


@pytest.mark.parametrize("profile", BOTH)
def test_from_the_ground_the_autopilot_takes_off_and_the_flight_stands_by_in_its_hold(profile):
    flown = Flown(settings_of(profile))
    flown.ticks(0.1)
    flown.tick(Event.START)
    flown.armed = True
    flown.mode = profile.arming_mode
    climbing = flown.tick(beat=True)
    assert (climbing.state, commands([climbing])) == (State.CLIMBING, [TAKEOFF])
    assert climbing.requests[0] == profile.takeoff(height_m=10.0, home_amsl_m=492.0)
    flown.landed = 3
    assert commands([*flown.ticks(2.0), flown.tick(beat=True)]) == []  # it has left the ground
    flown.position[2] = HOME_DOWN_M - 9.5
    assert flown.tick().state is State.POSITIONING
    standing_by = flown.tick()
    assert standing_by.state is State.STANDING_BY
    assert {one.setpoint for one in flown.ticks(3.0)} == {None}


def test_a_vehicle_that_is_up_already_is_taken_over_as_it_hovers_and_one_on_the_ground_is_armed():
    up = Flown()
    up.standing_by()
    assert [h.event for h in up.outputs.happenings] == [Event.ALOFT]
    for armed, landed in ((True, 1), (False, 2)):
        down = Flown()
        down.ticks(0.1)
        down.armed, down.landed = armed, landed
        down.tick(beat=True)
        ordered = down.tick(Event.START).happenings[0]
        assert (ordered.event, ordered.after) == (Event.START, State.ARMING)


def test_only_orders_may_be_ordered():
    flown = Flown()
    for event in set(Event) - ORDERS:
        with pytest.raises(ValueError, match=r"^order = .*: allowed are abort, engage, hold, land, return, start$"):
            flown.tick(event)


def test_orders_are_followed_one_after_the_other_and_have_one_happening_each():
    flown = Flown().standing_by()
    outputs = flown.tick(Event.ENGAGE, Event.START, Event.HOLD)
    assert [(h.event, h.before, h.after) for h in outputs.happenings] == [
        (Event.ENGAGE, State.STANDING_BY, State.ENTERING),
        (Event.ALOFT, State.ENTERING, State.ENTERING),
        (Event.HOLD, State.ENTERING, State.HOLDING),
    ]
    assert {h.now_s for h in outputs.happenings} == {flown.now_s}


def test_the_guided_mode_is_asked_for_once_setpoints_flow_and_a_heartbeat_came():
    flown = Flown().standing_by()
    flown.target = (60.0, 0.0)
    outputs = [flown.tick(Event.ENGAGE), *flown.ticks(STREAM_FIRST_S - 2 * TICK_S)]
    assert flown.state is State.ENTERING
    assert all(one.setpoint is not None for one in outputs)
    assert commands([*outputs, flown.tick(beat=True)]) == []  # not for long enough yet
    flown.beat_s = flown.now_s
    assert commands(flown.ticks(0.2)) == []  # long enough, and no HEARTBEAT
    assert commands([flown.tick(beat=True)]) == [SET_MODE]
    assert flown.outputs.requests[0] == PX4.set_mode(Mode.GUIDED)


def test_an_order_without_effect_gives_a_phase_no_more_time():
    flown = Flown().standing_by()
    flown.tick(Event.ENGAGE)
    entered_s = flown.now_s
    while flown.state is State.ENTERING:
        flown.tick(Event.START)
    assert flown.state is State.HOLDING
    assert flown.now_s - entered_s == pytest.approx(10.0, abs=2 * TICK_S)


def test_a_pilots_switch_is_not_undone_by_a_request_that_is_due():
    flown = Flown().standing_by()
    assert commands(flown.ticks(REPEAT_S + 0.5)) == []
    flown.mode = Mode.OTHER
    seen = flown.tick(beat=True)
    assert (seen.state, seen.setpoint, seen.requests) == (State.YIELDED, None, ())
    for order in sorted(ORDERS):
        after = flown.tick(order, beat=True)
        assert (after.state, after.setpoint, after.requests) == (State.YIELDED, None, ())


@pytest.mark.parametrize(
    ("order", "state", "mode"),
    [
        (Event.HOLD, State.HOLDING, Mode.HOLD),
        (Event.RETURN, State.RETURNING, Mode.RETURN),
        (Event.LAND, State.LANDING, Mode.LAND),
    ],
)
def test_a_hover_goes_out_until_a_heartbeat_shows_that_the_autopilot_has_taken_over(order, state, mode):
    flown = Flown().engaged()
    handed = flown.tick(order)
    assert handed.state is state
    assert list(handed.requests) == [PX4.set_mode(mode)]
    assert all(one.setpoint is not None for one in flown.ticks(0.5))
    flown.mode = mode
    assert flown.tick(beat=True).setpoint is None
    assert {one.setpoint for one in flown.ticks(2.5)} == {None}
    assert commands(flown.ticks(2.0)) == []


def test_the_game_is_played_on_a_target_and_hovered_through_without_one():
    flown = Flown().engaged()
    playing = flown.ticks(1.0)[-1]
    assert playing.certificate is not None
    assert playing.certificate.gap_m == pytest.approx(57.0, abs=0.1)
    assert playing.setpoint.velocity_ned_m_s[0] > 1.0
    flown.target = None
    outputs = flown.ticks(1.6)
    (lost,) = [h for one in outputs for h in one.happenings]
    assert (lost.event, lost.after) == (Event.TARGET_LOST, State.PAUSED)
    assert outputs[-1].certificate is None
    assert flown.ticks(2.0)[-1].setpoint.velocity_ned_m_s == pytest.approx((0.0, 0.0, 0.0), abs=0.3)
    flown.target = (60.0, 0.0)
    back = flown.ticks(1.5)
    assert [h.after for one in back for h in one.happenings] == [State.ENGAGED]


def test_a_pause_counts_what_was_well_from_the_moment_that_it_began():
    flown = Flown().engaged()
    flown.ticks(1.0)
    flown.tick(dt_s=0.3)
    assert flown.state is State.PAUSED
    outputs = flown.ticks(1.2)
    resumed = next(n for n, one in enumerate(outputs) if one.state is State.ENGAGED)
    assert (resumed + 1) * TICK_S == pytest.approx(SETTINGS.settle_s, abs=TICK_S)


def test_the_heading_of_the_engagement_is_held_until_the_vehicle_is_handed_over():
    flown = Flown().engaged(target=(3.2, 0.0))
    flown.yaw_rad = 0.9
    flown.position[2] = HOME_DOWN_M - 5.0
    flown.ticks(2.0)
    assert flown.state is State.ON_STATION
    flown.tick(dt_s=0.3)
    assert flown.state is State.PAUSED
    assert flown.tick().setpoint.yaw_rad == pytest.approx(0.7)
    flown.tick(Event.HOLD)
    assert flown.ticks(0.1)[-1].setpoint.yaw_rad == pytest.approx(0.9)
    flown.yaw_rad = 1.1
    flown.tick(beat=True)
    assert flown.tick(Event.ENGAGE).setpoint.yaw_rad == pytest.approx(1.1)


@pytest.mark.parametrize(("after", "moves"), [(AfterCapture.HOLD, False), (AfterCapture.SHADOW, True)])
def test_on_station_the_vehicle_hovers_or_follows_as_configured(after, moves):
    flown = Flown(settings_of(after_capture=after)).engaged(target=(3.2, 0.0))
    flown.position[2] = HOME_DOWN_M - 5.0
    flown.ticks(1.0)
    assert flown.state is State.ON_STATION
    flown.target = (4.3, 0.0)
    outputs = flown.ticks(1.0)
    assert flown.state is State.ON_STATION
    assert (outputs[-1].setpoint.velocity_ned_m_s[0] > 0.3) is moves
    assert (outputs[-1].certificate is not None) is moves


def test_after_the_capture_it_returns_where_that_is_configured():
    flown = Flown(settings_of(after_capture=AfterCapture.RETURN)).engaged(target=(3.2, 0.0))
    flown.position[2] = HOME_DOWN_M - 5.0
    events = [h.event for one in flown.ticks(1.0) for h in one.happenings]
    assert events == [Event.CAPTURED, Event.DONE]
    assert flown.state is State.RETURNING


def test_a_certificate_is_of_the_state_that_it_was_made_in():
    flown = Flown().engaged(target=(3.2, 0.0))
    flown.position[2] = HOME_DOWN_M - 5.0
    outputs = flown.ticks(1.0)
    entered = next(one for one in outputs if one.happenings)
    assert entered.state is State.ON_STATION
    assert entered.certificate is None


def test_an_estimators_jump_pauses_once():
    flown = Flown().engaged()
    flown.ticks(0.5, more=())
    flown.tick(more=[Odometry(flown.now_s, 7)])
    assert flown.state is State.ENGAGED
    flown.tick(more=[Odometry(flown.now_s, 8)])
    assert flown.state is State.PAUSED
    assert flown.ticks(1.2)[-1].state is State.ENGAGED
    assert {one.state for one in flown.ticks(1.0)} == {State.ENGAGED}


def test_another_sources_setpoints_end_in_the_autopilots_hold_and_our_own_do_not():
    flown = Flown().engaged()
    for _ in range(200):
        flown.tick(more=[PositionTarget(flown.now_s, 0.0, 0, flown.outputs.setpoint.velocity_ned_m_s)])
    assert flown.state is State.ENGAGED
    for _ in range(4):
        flown.tick(more=[PositionTarget(flown.now_s, 0.0, 0, (-5.0, 5.0, 0.0))])
    assert flown.state is State.ENGAGED  # it may be a pilot's: that is for the next HEARTBEAT to say
    flown.tick(beat=True)
    assert flown.state is State.HOLDING


def test_a_pilots_own_setpoints_are_not_taken_for_another_sources_and_nothing_is_ordered():
    flown = Flown().engaged()
    flown.ticks(4.0)
    flown.mode = Mode.OTHER
    before_the_beat = [flown.tick(more=[PositionTarget(flown.now_s, 0.0, 0, (-5.0, 5.0, 0.0))]) for _ in range(4)]
    assert {one.state for one in before_the_beat} == {State.ENGAGED}
    outputs = [*before_the_beat, flown.tick(beat=True), *flown.ticks(3.0)]
    assert flown.state is State.YIELDED
    assert commands(outputs) == []


def test_what_the_autopilot_did_between_two_engagements_is_not_held_against_anyone():
    flown = Flown().engaged()
    flown.ticks(3.0)
    flown.tick(Event.HOLD)
    flown.mode = Mode.HOLD
    flown.tick(beat=True)
    flown.ticks(3.0)
    flown.tick(Event.ENGAGE)
    flown.mode = Mode.GUIDED
    flown.tick(beat=True)
    flown.ticks(1.2, more=[PositionTarget(flown.now_s, 0.0, 0, (0.0, 5.0, 0.0))], beat=True)
    assert flown.state is State.ENGAGED


def test_while_standing_by_the_autopilots_own_targets_are_its_own_affair():
    flown = Flown(settings_of(engage_on=EngageOn.PILOT_MODE)).standing_by()
    flown.target = (60.0, 0.0)
    flown.ticks(3.0, more=[PositionTarget(flown.now_s, 0.0, 0, (5.0, 5.0, 0.0))])
    flown.mode = Mode.OTHER
    flown.tick(beat=True)
    flown.mode = Mode.GUIDED
    flown.tick(beat=True)
    assert flown.state is State.ENGAGED
    assert {one.state for one in flown.ticks(1.0, more=[PositionTarget(flown.now_s, 0.0, 0, (5.0, 5.0, 0.0))])} == {
        State.ENGAGED
    }


def test_a_pilot_is_invited_by_a_neutral_stream_after_the_hold_was_asked_for():
    flown = Flown(settings_of(engage_on=EngageOn.PILOT_MODE)).standing_by()
    assert flown.outputs.requests == (PX4.set_mode(Mode.HOLD),)
    outputs = flown.ticks(INVITE_AFTER_S + 0.5)
    streaming = [one.setpoint is not None for one in outputs]
    assert (streaming.index(True) + 1) * TICK_S == pytest.approx(INVITE_AFTER_S, abs=TICK_S)
    assert all(streaming[streaming.index(True) :])
    flown.ticks(3.0)
    assert commands(flown.ticks(3.0)) == []  # the hold is asked for once: the pilot's next switch is an answer
    flown.mode, flown.position[2] = Mode.OTHER, HOME_DOWN_M - 30.0
    followed = flown.ticks(2.0)
    assert flown.state is State.STANDING_BY
    assert followed[-1].setpoint.velocity_ned_m_s == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)


def test_a_mode_that_the_vehicle_was_left_in_is_no_invitation():
    flown = Flown(settings_of(engage_on=EngageOn.PILOT_MODE))
    flown.mode = Mode.GUIDED
    flown.standing_by()
    flown.target = (60.0, 0.0)
    assert {one.state for one in flown.ticks(4.0)} == {State.STANDING_BY}
    flown.mode = Mode.OTHER
    flown.tick(beat=True)
    flown.mode = Mode.GUIDED
    assert flown.tick(beat=True).state is State.ENGAGED


def test_heights_count_from_where_home_is_now():
    flown = Flown().engaged()
    assert flown.flight._tick.envelope == replace(ENVELOPE, home_ned_m=(0.0, 0.0, HOME_DOWN_M))


def test_the_guarantee_is_watched_from_engagement_and_an_alarm_is_of_its_own_cycle():
    flown = Flown(settings_of(guarantee_slack=0.5)).engaged()
    assert {one.alarm for one in flown.ticks(0.3)} == {None}
    outputs = flown.ticks(1.5)  # the vehicle does not move, so that the capture is ever later
    alarms = [one.alarm for one in outputs if one.alarm is not None]
    assert alarms
    assert {alarm.broken for alarm in alarms} == {Broken.CAPTURE_LATER}
    assert all(alarm.amount > 0.5 for alarm in alarms)
    alarmed = [one.alarm is not None for one in outputs]
    assert not any(one and after for one, after in pairwise(alarmed))
    while flown.outputs.alarm is None:
        flown.tick()
    paused = flown.tick(dt_s=0.3)
    assert (paused.state, paused.alarm) == (State.PAUSED, None)


def test_of_all_that_happens_in_one_cycle_the_gravest_alone_has_an_effect():
    flown = Flown().engaged()
    flown.ticks(0.5)
    flown.mode, flown.armed = Mode.OTHER, False
    outputs = flown.tick(beat=True, dt_s=0.3, more=[Odometry(flown.now_s, 1), Odometry(flown.now_s, 2)])
    assert [h.event for h in outputs.happenings] == [Event.PILOT]
    late = Flown().engaged()
    late.ticks(0.5)
    outputs = late.tick(dt_s=0.3, more=[Odometry(late.now_s, 1), Odometry(late.now_s, 2)])
    assert [h.event for h in outputs.happenings] == [Event.ESTIMATOR_RESET]


def test_after_a_reboot_or_a_lost_vehicle_nothing_is_said_any_more():
    for shock in ({"more": [local(1.0)]}, {"silent": True, "dt_s": 3.5}):
        flown = Flown().engaged()
        flown.ticks(0.5)
        outputs = flown.tick(**shock)
        assert outputs.state is State.YIELDED
        assert (outputs.setpoint, outputs.requests) == (None, ())
        assert {(one.setpoint, one.requests) for one in flown.ticks(3.0)} == {(None, ())}


def test_every_final_state_is_silent_and_asks_nothing():
    for state in FINAL:
        flown = Flown().engaged()
        flown.flight.state = state
        assert {(one.setpoint, one.requests) for one in flown.ticks(2.0)} == {(None, ())}


@pytest.mark.parametrize("profile", BOTH)
@pytest.mark.parametrize("state", sorted(set(State) - {State.STANDING_BY}))
def test_each_state_asks_for_what_it_needs_and_for_nothing_that_is_there(state, profile):
    settings = settings_of(profile)
    vehicle = observe(VehicleState(), [home(), LandedState(0.0, 1)])
    modes = {
        State.ENTERING: Mode.GUIDED,
        State.HOLDING: Mode.HOLD,
        State.RETURNING: Mode.RETURN,
        State.LANDING: Mode.LAND,
    }
    asked = requests_in(state, settings, vehicle, Mode.OTHER, (47.0, 8.0, Amsl(500.0)))
    if state in modes:
        assert asked == (profile.set_mode(modes[state]),)
        assert requests_in(state, settings, vehicle, modes[state], None) == ()
    elif state is State.ARMING:
        assert asked == (profile.set_mode(profile.arming_mode), profile.arm())
    elif state is State.CLIMBING:
        assert asked == (profile.takeoff(height_m=10.0, home_amsl_m=492.0),)
        assert requests_in(state, settings, observe(vehicle, [LandedState(0.0, 2)]), None, None) == ()
        assert requests_in(state, settings, observe(VehicleState(), [LandedState(0.0, 1)]), None, None) == ()
    elif state is State.POSITIONING:
        assert asked == (profile.reposition(latitude_deg=47.0, longitude_deg=8.0, altitude_amsl_m=500.0),)
        assert requests_in(state, settings, vehicle, Mode.OTHER, None) == ()
    elif state is State.CHECKING:
        assert len(asked) == len(profile.streams_hz) + 2
    else:
        assert asked == ()


@pytest.mark.parametrize("engage_on", list(EngageOn))
@pytest.mark.parametrize("mode", list(Mode))
def test_standing_by_asks_for_the_hold_only_of_a_vehicle_that_holds_for_a_pilot(engage_on, mode):
    settings = settings_of(engage_on=engage_on)
    asked = requests_in(State.STANDING_BY, settings, VehicleState(), mode, None)
    expected = engage_on is EngageOn.PILOT_MODE and mode is Mode.HOLD
    assert asked == ((PX4.set_mode(Mode.HOLD),) if expected else ())


def test_a_start_that_is_configured_is_flown_to_by_the_autopilot():
    flown = Flown(settings_of(start_game_m=(20.0, 30.0, 12.0)))
    flown.ticks(0.1)
    flown.tick(Event.START)
    flown.armed = True
    flown.tick(beat=True)
    flown.landed, flown.position[2] = 2, HOME_DOWN_M - 10.0
    outputs = [flown.tick(beat=True), *flown.ticks(0.1)]
    assert flown.state is State.POSITIONING
    (request,) = [request for one in outputs for request in one.requests]
    assert request.command == REPOSITION
    assert request.params[6] == pytest.approx(488.0 + 12.0, abs=0.1)
    flown.position = [30.0, 20.0, -12.0]
    assert flown.tick().state is State.STANDING_BY


def test_a_flight_that_says_nothing_of_it_is_flown_so():
    said = FlightSettings(profile=ARDUCOPTER, tick=SETTINGS.tick, takeoff_height_m=10.0)
    assert (said.start_game_m, said.after_capture, said.engage_on) == (None, AfterCapture.HOLD, EngageOn.COMMAND)
    assert (said.battery_minimum, said.settle_s, said.guarantee_slack) == (0.2, 1.0, 1.0)
    assert said.limits_s == {
        State.CONNECTING: 30.0,
        State.CHECKING: 90.0,
        State.ARMING: 15.0,
        State.CLIMBING: 90.0,
        State.POSITIONING: 180.0,
        State.ENTERING: 10.0,
        State.PAUSED: 10.0,
    }


def test_no_state_that_commands_is_silent_and_no_other_speaks():
    assert not SETPOINT_STATES & HANDING_OVER
    for state in set(State) - FINAL:
        flown = Flown().engaged()
        flown.ticks(0.3)
        flown.flight.state, flown.mode = state, Mode.HOLD
        flown.flight._since_s = flown.now_s
        flown.flight._setpoint(flown.now_s, TICK_S)
        speaks = flown.flight._setpoint(flown.now_s, TICK_S) is not None
        assert speaks is (state in SETPOINT_STATES | HANDING_OVER)  # HEARTBEAT still shows the guided mode
