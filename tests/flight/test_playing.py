"""The flight's step during the game, with inputs from the test: setpoints sent, reasons to end, and silence."""

from itertools import pairwise

import pytest

from guidance.autopilots import ARDUCOPTER, PX4, Mode
from guidance.autopilots.description import GPS_GLOBAL_ORIGIN, HOME_POSITION
from guidance.cycle import Violation
from guidance.flight import FINAL, EngageOn, Event, FlightSettings, State
from guidance.flight.observed import Observed
from guidance.flight.sending import requests_in
from guidance.flight.settings import AfterCapture
from guidance.flight.table import HANDING_OVER, SETPOINT_STATES
from guidance.frames import Amsl, LocalFrame, Ned
from guidance.messages import LandedState, Odometry, PositionTarget
from guidance.vehicle import VehicleState, observe
from tests.flight.flown import CYCLE_S, MESSAGE, REPOSITION, Flown, commands
from tests.flight.scenes import (
    BOTH,
    HOME_DOWN_M,
    SETTINGS,
    home,
    local,
    settings_of,
)


def test_the_game_is_played_on_an_evader_and_hovered_through_without_one():
    vehicle = Flown().engaged()
    playing = vehicle.cycles(1.0)[-1]
    assert playing.certificate is not None
    assert playing.certificate.gap_m == pytest.approx(57.0, abs=0.1)
    assert playing.setpoint.velocity_ned_m_s[0] > 1.0
    vehicle.evader = None
    outputs = vehicle.cycles(1.6)
    (lost,) = [h for output in outputs for h in output.transitions]
    assert (lost.event, lost.after) == (Event.EVADER_LOST, State.PAUSED)
    assert outputs[-1].certificate is None
    assert vehicle.cycles(2.0)[-1].setpoint.velocity_ned_m_s == pytest.approx(
        (0.0, 0.0, 0.0), abs=0.3
    )
    vehicle.evader = (60.0, 0.0)
    back = vehicle.cycles(1.5)
    assert [h.after for output in back for h in output.transitions] == [State.ENGAGED]


def test_a_pause_counts_what_was_well_from_the_moment_that_it_began():
    vehicle = Flown().engaged()
    vehicle.cycles(1.0)
    vehicle.cycle(dt_s=0.3)
    assert vehicle.state is State.PAUSED
    outputs = vehicle.cycles(1.2)
    resumed = next(n for n, output in enumerate(outputs) if output.state is State.ENGAGED)
    assert (resumed + 1) * CYCLE_S == pytest.approx(SETTINGS.settle_s, abs=CYCLE_S)


def test_the_heading_of_the_engagement_is_held_until_the_vehicle_is_handed_over():
    vehicle = Flown().engaged(evader=(3.2, 0.0))
    vehicle.yaw_rad = 0.9
    vehicle.position[2] = HOME_DOWN_M - 5.0
    vehicle.cycles(2.0)
    assert vehicle.state is State.ON_STATION
    vehicle.cycle(dt_s=0.3)
    assert vehicle.state is State.PAUSED
    assert vehicle.cycle().setpoint.yaw_rad == pytest.approx(0.7)
    vehicle.cycle(Event.HOLD)
    assert vehicle.cycles(0.1)[-1].setpoint.yaw_rad == pytest.approx(0.9)
    vehicle.yaw_rad = 1.1
    vehicle.cycle(beat=True)
    assert vehicle.cycle(Event.ENGAGE).setpoint.yaw_rad == pytest.approx(1.1)


@pytest.mark.parametrize(
    ("after", "moves"), [(AfterCapture.HOLD, False), (AfterCapture.SHADOW, True)]
)
def test_on_station_the_vehicle_hovers_or_follows_as_configured(after, moves):
    vehicle = Flown(settings_of(after_capture=after)).engaged(evader=(3.2, 0.0), height_m=5.0)
    vehicle.cycles(1.0)
    assert vehicle.state is State.ON_STATION
    vehicle.evader = (4.3, 0.0)
    outputs = vehicle.cycles(1.0)
    assert vehicle.state is State.ON_STATION
    assert (outputs[-1].setpoint.velocity_ned_m_s[0] > 0.3) is moves
    assert (outputs[-1].certificate is not None) is moves


def test_after_the_capture_it_returns_where_that_is_configured():
    vehicle = Flown(settings_of(after_capture=AfterCapture.RETURN)).engaged(
        evader=(3.2, 0.0), height_m=5.0
    )
    events = [h.event for output in vehicle.cycles(1.0) for h in output.transitions]
    assert events == [Event.CAPTURED, Event.DONE]
    assert vehicle.state is State.RETURNING


def test_a_certificate_is_of_the_state_that_it_was_made_in():
    vehicle = Flown().engaged(evader=(3.2, 0.0), height_m=5.0)
    outputs = vehicle.cycles(1.0)
    entered = next(output for output in outputs if output.transitions)
    assert entered.state is State.ON_STATION
    assert entered.certificate is None


def test_an_estimators_jump_pauses_once():
    vehicle = Flown().engaged()
    vehicle.cycles(0.5, more=())
    vehicle.cycle(more=[Odometry(vehicle.now_s, 7)])
    assert vehicle.state is State.ENGAGED
    vehicle.cycle(more=[Odometry(vehicle.now_s, 8)])
    assert vehicle.state is State.PAUSED
    assert vehicle.cycles(1.2)[-1].state is State.ENGAGED
    assert {output.state for output in vehicle.cycles(1.0)} == {State.ENGAGED}


def test_another_sources_setpoints_end_in_the_autopilots_hold_and_our_own_do_not():
    vehicle = Flown().engaged()
    for _ in range(200):
        vehicle.cycle(
            more=[PositionTarget(vehicle.now_s, 0.0, 0, vehicle.outputs.setpoint.velocity_ned_m_s)]
        )
    assert vehicle.state is State.ENGAGED
    for _ in range(31):
        vehicle.cycle(more=[PositionTarget(vehicle.now_s, 0.0, 0, Ned((-5.0, 5.0, 0.0)))])
    # It may be a pilot's: that is for the next HEARTBEAT to say
    assert vehicle.state is State.ENGAGED
    vehicle.cycle(beat=True)
    assert vehicle.state is State.HOLDING


def test_a_pilots_setpoints_are_not_another_source_and_cause_no_command():
    vehicle = Flown().engaged()
    vehicle.cycles(4.0)
    vehicle.mode = Mode.OTHER
    before_the_beat = [
        vehicle.cycle(more=[PositionTarget(vehicle.now_s, 0.0, 0, Ned((-5.0, 5.0, 0.0)))])
        for _ in range(31)
    ]
    assert {output.state for output in before_the_beat} == {State.ENGAGED}
    # A HEARTBEAT was asked for, to see who flies
    assert set(commands(before_the_beat)) == {MESSAGE}
    assert commands([vehicle.cycle(beat=True), *vehicle.cycles(3.0)]) == []
    assert vehicle.state is State.YIELDED


def test_what_the_autopilot_did_between_two_engagements_is_not_held_against_anyone():
    vehicle = Flown().engaged()
    vehicle.cycles(3.0)
    vehicle.cycle(Event.HOLD)
    vehicle.mode = Mode.HOLD
    vehicle.cycle(beat=True)
    vehicle.cycles(3.0)
    vehicle.cycle(Event.ENGAGE)
    vehicle.mode = Mode.GUIDED
    vehicle.cycle(beat=True)
    for _ in range(60):
        vehicle.cycle(more=[PositionTarget(vehicle.now_s, 0.0, 0, Ned((0.0, 5.0, 0.0)))], beat=True)
    assert vehicle.state is State.ENGAGED


def test_while_standing_by_the_autopilots_own_targets_are_its_own_affair():
    vehicle = Flown(settings_of(engage_on=EngageOn.PILOT_MODE)).standing_by()
    vehicle.evader = (60.0, 0.0)
    vehicle.cycles(3.0, more=[PositionTarget(vehicle.now_s, 0.0, 0, Ned((5.0, 5.0, 0.0)))])
    vehicle.mode = Mode.OTHER
    vehicle.cycle(beat=True)
    vehicle.mode = Mode.GUIDED
    vehicle.cycle(beat=True)
    assert vehicle.state is State.ENGAGED
    for _ in range(60):
        vehicle.cycle(more=[PositionTarget(vehicle.now_s, 0.0, 0, Ned((5.0, 5.0, 0.0)))], beat=True)
    assert vehicle.state is State.ENGAGED


def test_a_pilot_is_invited_by_a_neutral_stream_after_the_hold_was_asked_for():
    vehicle = Flown(settings_of(engage_on=EngageOn.PILOT_MODE)).standing_by()
    assert vehicle.outputs.requests == (PX4.set_mode(Mode.HOLD),)
    outputs = vehicle.cycles(1.5)
    streaming = [output.setpoint is not None for output in outputs]
    assert (streaming.index(True) + 1) * CYCLE_S == pytest.approx(1.0, abs=CYCLE_S)
    assert all(streaming[streaming.index(True) :])
    vehicle.cycles(3.0)
    # The hold is asked for once: the pilot's next switch is an answer
    assert commands(vehicle.cycles(3.0)) == []
    vehicle.mode = Mode.OTHER
    vehicle.position[2] = HOME_DOWN_M - 30.0
    followed = vehicle.cycles(2.0)
    assert vehicle.state is State.STANDING_BY
    assert followed[-1].setpoint.velocity_ned_m_s == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)


def test_the_mode_of_our_own_climb_is_no_invitation():
    vehicle = Flown(settings_of(ARDUCOPTER, engage_on=EngageOn.PILOT_MODE))
    vehicle.cycles(0.1)
    vehicle.cycle(Event.START)
    vehicle.armed_as_asked()
    vehicle.cycle(beat=True)
    vehicle.landed = 2
    vehicle.position[2] = HOME_DOWN_M - 10.0
    vehicle.cycle(beat=True)
    vehicle.evader = (60.0, 0.0)
    vehicle.cycle()
    assert {output.state for output in vehicle.cycles(4.0)} == {State.STANDING_BY}
    vehicle.mode = Mode.OTHER
    vehicle.cycle(beat=True)
    vehicle.mode = Mode.GUIDED
    assert vehicle.cycle(beat=True).state is State.ENGAGED


def test_a_mode_that_was_chosen_before_standing_by_is_no_invitation_either():
    vehicle = Flown(settings_of(engage_on=EngageOn.PILOT_MODE))
    vehicle.cycles(0.1)
    vehicle.armed = True
    vehicle.landed = 2
    vehicle.evader = (60.0, 0.0)
    vehicle.position[2] = HOME_DOWN_M - 10.0
    for vehicle.mode in (Mode.OTHER, Mode.GUIDED):
        vehicle.cycle(beat=True)
    assert vehicle.cycle(Event.START).state is State.READY  # another program may fly it
    vehicle.mode = Mode.OTHER
    vehicle.cycles(4.0)
    assert vehicle.cycle(Event.START).state is State.STANDING_BY
    assert {output.state for output in vehicle.cycles(2.5)} == {State.STANDING_BY}
    vehicle.mode = Mode.GUIDED
    assert vehicle.cycle(beat=True).state is State.ENGAGED


def test_a_pilot_who_flies_while_waited_for_keeps_the_vehicle_against_any_order():
    for order in (Event.HOLD, Event.RETURN, Event.LAND):
        vehicle = Flown(settings_of(engage_on=EngageOn.PILOT_MODE)).standing_by()
        vehicle.mode = Mode.OTHER
        assert vehicle.cycle(beat=True).state is State.STANDING_BY
        vehicle.cycle(order)
        assert vehicle.cycle().state is State.YIELDED


def test_the_guarantee_is_watched_from_engagement_and_an_alarm_is_of_its_own_cycle():
    vehicle = Flown(settings_of(guarantee_slack_s=0.0)).engaged()
    assert {output.alarm for output in vehicle.cycles(0.3)} == {None}
    outputs = vehicle.cycles(1.5)  # the vehicle does not move, so that the capture is ever later
    alarms = [output.alarm for output in outputs if output.alarm is not None]
    assert alarms
    assert {alarm.violation for alarm in alarms} == {Violation.CAPTURE_LATER}
    assert all(alarm.amount > 0.5 for alarm in alarms)
    alarmed = [output.alarm is not None for output in outputs]
    assert not any(output and after for output, after in pairwise(alarmed))
    while vehicle.outputs.alarm is None:
        vehicle.cycle()
    paused = vehicle.cycle(dt_s=0.3)
    assert (paused.state, paused.alarm) == (State.PAUSED, None)


def test_of_all_that_happens_in_one_cycle_the_most_severe_alone_has_an_effect():
    vehicle = Flown().engaged()
    vehicle.cycles(0.5)
    vehicle.mode = Mode.OTHER
    vehicle.armed = False
    outputs = vehicle.cycle(
        beat=True, dt_s=0.3, more=[Odometry(vehicle.now_s, 1), Odometry(vehicle.now_s, 2)]
    )
    assert [h.event for h in outputs.transitions] == [Event.PILOT]
    late = Flown().engaged()
    late.cycles(0.5)
    outputs = late.cycle(dt_s=0.3, more=[Odometry(late.now_s, 1), Odometry(late.now_s, 2)])
    assert [h.event for h in outputs.transitions] == [Event.ESTIMATOR_RESET]


def test_after_a_reboot_or_a_lost_vehicle_nothing_is_said_any_more():
    for shock in ({"more": [local(1.0)]}, {"silent": True, "dt_s": 3.5}):
        vehicle = Flown().engaged()
        vehicle.cycles(0.5)
        outputs = vehicle.cycle(**shock)
        assert outputs.state is State.YIELDED
        assert (outputs.setpoint, outputs.requests) == (None, ())
        assert {(output.setpoint, output.requests) for output in vehicle.cycles(3.0)} == {
            (None, ())
        }


def test_every_final_state_is_silent_and_asks_nothing():
    for state in FINAL:
        vehicle = Flown().engaged()
        vehicle.flight.stage.state = state
        assert {(output.setpoint, output.requests) for output in vehicle.cycles(2.0)} == {
            (None, ())
        }


def heard_of(settings, vehicle, mode=None):
    observed = Observed(settings)
    observed.vehicle = vehicle
    observed.mode = mode
    observed.on_ground = vehicle.on_ground
    return observed


AT_HOME = observe(VehicleState(), [home(), LandedState(0.0, 1)])


@pytest.mark.parametrize("autopilot", BOTH)
def test_each_state_asks_for_what_it_needs(autopilot):
    settings = settings_of(autopilot)
    observed = heard_of(settings, AT_HOME, Mode.OTHER)
    observed.has_flown = True
    observed.tracking.local_frame = LocalFrame(47.0, 8.0, Amsl(500.0), projection=PX4.projection)
    observed.start_ned_m = (0.0, 0.0, 0.0)
    start = {"latitude_deg": 47.0, "longitude_deg": 8.0, "altitude_amsl_m": 500.0}
    needed = {
        State.ARMING: autopilot.set_mode(autopilot.arming_mode),
        State.CLIMBING: autopilot.takeoff(height_m=10.0, home_amsl_m=492.0),
        State.POSITIONING: autopilot.reposition(**start),
        State.ENTERING: autopilot.set_mode(Mode.GUIDED),
        State.HOLDING: autopilot.set_mode(Mode.HOLD),
        State.RETURNING: autopilot.set_mode(Mode.RETURN),
        State.LANDING: autopilot.set_mode(Mode.LAND),
    }
    asked = {state: requests_in(state, settings, observed) for state in State}
    assert len(asked.pop(State.CHECKING)) == len(autopilot.streams_hz) + 3
    places = [request.params[0] for request in asked.pop(State.READY)]
    assert places == [HOME_POSITION, GPS_GLOBAL_ORIGIN]
    assert {state: requests for state, requests in asked.items() if requests} == {
        state: (request,) for state, request in needed.items()
    }


@pytest.mark.parametrize("autopilot", BOTH)
def test_no_state_asks_for_what_is_there_already_or_cannot_be(autopilot):
    settings = settings_of(autopilot)
    in_mode = heard_of(settings, AT_HOME, autopilot.arming_mode)
    assert requests_in(State.ARMING, settings, in_mode) == ()
    assert requests_in(State.ARMING, settings, in_mode, arms=True) == (autopilot.arm(),)
    airborne = observe(AT_HOME, [LandedState(0.0, 2)])
    nowhere = observe(VehicleState(), [LandedState(0.0, 1)])
    for vehicle in (airborne, nowhere):
        assert requests_in(State.CLIMBING, settings, heard_of(settings, vehicle)) == ()
    without_frame = heard_of(settings, AT_HOME, Mode.OTHER)
    assert requests_in(State.POSITIONING, settings, without_frame) == ()


@pytest.mark.parametrize("engage_on", list(EngageOn))
@pytest.mark.parametrize("mode", list(Mode))
def test_standing_by_asks_for_the_hold_only_of_a_vehicle_that_holds_for_a_pilot(engage_on, mode):
    settings = settings_of(engage_on=engage_on)
    requests = requests_in(State.STANDING_BY, settings, heard_of(settings, VehicleState(), mode))
    expected = engage_on is EngageOn.PILOT_MODE and mode is Mode.HOLD
    assert requests == ((PX4.set_mode(Mode.HOLD),) if expected else ())


def test_a_start_that_is_configured_is_flown_to_by_the_autopilot():
    vehicle = Flown(settings_of(start_game_m=(20.0, 30.0, 12.0)))
    vehicle.cycles(0.1)
    vehicle.cycle(Event.START)
    vehicle.armed_as_asked()
    vehicle.cycle(beat=True)
    vehicle.landed = 2
    vehicle.position[2] = HOME_DOWN_M - 10.0
    outputs = [vehicle.cycle(beat=True), *vehicle.cycles(0.1)]
    assert vehicle.state is State.POSITIONING
    (request,) = [request for output in outputs for request in output.requests]
    assert request.command == REPOSITION
    assert request.params[6] == pytest.approx(488.0 + 12.0, abs=0.1)
    vehicle.position = [30.0, 20.0, -12.0]
    assert vehicle.cycle().state is State.STANDING_BY


def test_default_settings_of_a_flight():
    settings = FlightSettings(autopilot=ARDUCOPTER, cycle=SETTINGS.cycle, takeoff_height_m=10.0)
    assert (settings.start_game_m, settings.after_capture, settings.engage_on) == (
        None,
        AfterCapture.HOLD,
        EngageOn.COMMAND,
    )
    assert (settings.battery_minimum, settings.settle_s, settings.guarantee_slack_s) == (
        0.25,
        1.0,
        0.3,
    )
    assert (settings.reserve, settings.farthest_m, settings.hold_on_rival) == (None, 200.0, True)
    assert (settings.longest_chase_s, settings.operator_timeout_s, settings.operator_return_s) == (
        None,
        None,
        30.0,
    )
    assert settings.limits_s == {
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
        vehicle = Flown().engaged()
        vehicle.cycles(0.3)
        vehicle.flight.stage.state = state
        vehicle.mode = Mode.HOLD
        vehicle.flight.stage.since_s = vehicle.now_s
        # HEARTBEAT still shows the guided mode
        outputs = vehicle.cycle()
        speaks = outputs.setpoint is not None
        assert speaks is (outputs.state in SETPOINT_STATES | HANDING_OVER)


def test_a_chase_has_a_longest_time_its_pauses_included_and_a_new_one_begins_anew():
    vehicle = Flown(settings_of(longest_chase_s=5.0)).engaged()
    vehicle.cycles(2.0)
    vehicle.cycle(more=[Odometry(vehicle.now_s, 7)])
    vehicle.cycle(more=[Odometry(vehicle.now_s, 8)])
    assert vehicle.state is State.PAUSED
    vehicle.cycles(2.8)
    assert vehicle.state is State.ENGAGED
    outputs = vehicle.cycles(0.4)
    assert [h.event for output in outputs for h in output.transitions] == [Event.CHASE_TIMED_OUT]
    assert vehicle.state is State.HOLDING
    vehicle.mode = Mode.HOLD
    vehicle.cycle(beat=True)
    vehicle.cycle(Event.ENGAGE)
    vehicle.mode = Mode.GUIDED
    vehicle.cycles(1.0, beat=True)
    assert vehicle.state is State.ENGAGED
    assert {output.state for output in vehicle.cycles(3.5)} == {State.ENGAGED}
