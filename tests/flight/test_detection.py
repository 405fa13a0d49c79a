"""Detection of events: each condition alone, on both sides of its threshold, and the order of the conditions."""

import math
from dataclasses import replace

import pytest

from guidance.autopilots import ARDUCOPTER, PX4, Mode
from guidance.boot_clock import BootClock
from guidance.flight import EngageOn, Event, State
from guidance.flight.detection import (
    LOSS_SPARE_S,
    Stage,
    arming_refusal,
    checks,
    detail_of,
    events,
    fit,
    is_late,
    telemetry_gap,
    telemetry_refusal,
)
from guidance.flight.freshness import NEEDED, STATUS_LIMIT_S, TELEMETRY_LIMIT_S
from guidance.flight.observed import Observed
from guidance.flight.settings import AfterCapture, Inputs
from guidance.flight.table import (
    ASKED_MODES,
    BEFORE_FLIGHT,
    FINAL,
    HANDING_OVER,
    SETPOINT_STATES,
    TRANSITIONS,
)
from guidance.frames import Ned
from guidance.game import StandOff
from guidance.messages import (
    Attitude,
    EstimatorStatus,
    LandedState,
)
from guidance.vehicle import VehicleState, observe
from tests.flight.scenes import (
    BOTH,
    ENVELOPE,
    HOME_DOWN_M,
    NOW_S,
    NOWHERE,
    PREARM,
    QUIET,
    SETTINGS,
    context,
    heartbeat,
    home,
    local,
    settings_of,
    status,
    timesync,
    well,
)

FLYING = sorted(
    {state for state, event in TRANSITIONS if event is Event.REBOOTED} - {State.OUT_OF_CONTACT}
)
GPS = 1 << 5
INVITING = settings_of(engage_on=EngageOn.PILOT_MODE)
GUIDED = well(heartbeat(mode=Mode.GUIDED))


def happens(event, state, **changes):
    return event in set(events(context(state, **changes)))


def test_in_quiet_flight_nothing_happens():
    for state in (State.ENGAGED, State.PAUSED, State.ON_STATION):
        assert (
            list(events(context(state, vehicle=GUIDED, settings=settings_of(settle_s=60.0)))) == []
        )
    assert list(events(context(State.STANDING_BY))) == []


def test_only_what_the_table_answers_is_asked():
    wild = {"dt_s": 99.0, "vehicle": VehicleState(), "evader_silence_s": math.inf, "foreign": True}
    for state in State:
        assert {(state, event) for event in events(context(state, **wild))} <= set(TRANSITIONS)


@pytest.mark.parametrize(("age_s", "is_fresh"), [(0.0, True), (3.0, True), (3.01, False)])
def test_a_heartbeat_counts_for_three_seconds(age_s, is_fresh):
    vehicle = well(heartbeat(NOW_S - age_s))
    assert happens(Event.HEARD, State.CONNECTING, vehicle=vehicle) is is_fresh
    for state in (State.CHECKING, State.READY, *FLYING):
        assert (
            happens(Event.TELEMETRY_LOST, state, vehicle=vehicle, since_s=NOW_S - 2.0)
            is not is_fresh
        )


@pytest.mark.parametrize(("age_s", "lost"), [(1.0, False), (1.01, True)])
def test_positions_that_stop_end_a_flight_and_not_a_check(age_s, lost):
    vehicle = observe(VehicleState(), [heartbeat(), local(NOW_S - age_s)])
    for state in FLYING:
        assert happens(Event.TELEMETRY_LOST, state, vehicle=vehicle, since_s=NOW_S - 2.0) is lost
    for state in (State.CHECKING, State.READY):
        assert not happens(Event.TELEMETRY_LOST, state, vehicle=vehicle)


def test_positions_never_heard_do_not_end_a_handover_and_end_everything_else():
    vehicle = observe(VehicleState(), [heartbeat()])
    for state in FLYING:
        assert happens(Event.TELEMETRY_LOST, state, vehicle=vehicle) is (state not in HANDING_OVER)


@pytest.mark.parametrize("mode", [*PX4.custom_modes, Mode.OTHER])
def test_the_mode_that_an_order_leaves_is_no_takeover_but_a_pilots_that_stays_is(mode):
    vehicle = well(heartbeat(mode=mode))
    left = frozenset({mode})
    early = {"vehicle": vehicle, "left": left, "since_s": NOW_S - 5.0}
    late = {"vehicle": vehicle, "left": left, "since_s": NOW_S - 5.1}
    for state in HANDING_OVER:
        assert not happens(Event.PILOT, state, **early)
        assert happens(Event.PILOT, state, **late) is (mode is Mode.OTHER)


@pytest.mark.parametrize("autopilot", BOTH)
@pytest.mark.parametrize("state", sorted(set(State) - BEFORE_FLIGHT - FINAL))
def test_a_mode_that_was_not_asked_for_is_a_pilots_in_every_state(state, autopilot):
    asked = autopilot.arming_mode if state is State.ARMING else ASKED_MODES.get(state)
    for mode in [*autopilot.custom_modes, Mode.OTHER]:
        seen = happens(
            Event.PILOT,
            state,
            vehicle=well(heartbeat(mode=mode, autopilot=autopilot)),
            settings=settings_of(autopilot),
            left=frozenset(),
        )
        px4s_own = (autopilot, state, mode) == (PX4, State.CLIMBING, Mode.HOLD)
        assert seen is (mode is not asked and not px4s_own)


@pytest.mark.parametrize("asked", [False, True])
@pytest.mark.parametrize("armed", [False, True])
def test_a_vehicle_that_is_armed_before_guidance_asked_was_armed_by_somebody_else(armed, asked):
    beat = heartbeat(mode=SETTINGS.autopilot.arming_mode, armed=armed)
    vehicle = well(beat)
    moment = {"vehicle": vehicle, "beats": [beat], "may_be_armed": asked}
    assert happens(Event.PILOT, State.ARMING, **moment) is (armed and not asked)
    words = detail_of(Event.PILOT, context(State.ARMING, **moment))
    assert words.startswith("somebody else armed the vehicle") is (armed and not asked)
    assert not happens(Event.PILOT, State.HOLDING, vehicle=vehicle, may_be_armed=False)


@pytest.mark.parametrize(
    ("height_m", "landed", "is_told_now", "pilots"),
    [
        (7.9, 2, True, True),
        (8.0, 2, True, False),
        (8.1, 2, True, False),  # PX4 ends the climb a little below the height
        (0.0, 3, True, True),
        (0.0, 1, True, False),  # before the take-off it holds
        (5.0, 2, False, False),  # HEARTBEAT may be from the ground
    ],
)
def test_the_hold_below_the_height_of_px4s_climb_is_a_pilots(height_m, landed, is_told_now, pilots):
    beat = heartbeat(mode=Mode.HOLD)
    here = local(NOW_S, (0.0, 0.0, HOME_DOWN_M - height_m))
    moment = context(State.CLIMBING, vehicle=well(beat, here, LandedState(NOW_S, landed)))
    moment.observed.beats = [beat] if is_told_now else []
    moment.observed.on_ground = landed == 1
    assert (Event.PILOT in set(events(moment))) is pilots


def test_as_it_disarms_after_a_landing_an_autopilots_own_change_of_mode_is_no_pilots():
    for mode in (Mode.HOLD, Mode.OTHER):
        vehicle = well(heartbeat(mode=mode, armed=False))
        landed = list(events(context(State.LANDING, vehicle=vehicle, since_s=NOW_S - 9.0)))
        assert landed == [Event.DISARMED]


@pytest.mark.parametrize("state", sorted(HANDING_OVER))
def test_a_vehicle_may_still_arm_after_an_order_to_end(state):
    for since_s, disarmed in ((1.9, False), (2.1, True)):
        vehicle = well(heartbeat(mode=ASKED_MODES[state], armed=False))
        seen = happens(Event.DISARMED, state, vehicle=vehicle, since_s=NOW_S - since_s)
        assert seen is disarmed


def test_a_missing_heartbeat_or_an_invited_pilot_is_no_takeover():
    assert not happens(Event.PILOT, State.ENGAGED, vehicle=VehicleState())
    sticks = well(heartbeat(mode=Mode.OTHER))
    assert happens(Event.PILOT, State.STANDING_BY, vehicle=sticks)
    assert not happens(Event.PILOT, State.STANDING_BY, vehicle=sticks, settings=INVITING)
    assert happens(Event.PILOT, State.ENGAGED, vehicle=sticks, settings=INVITING)


@pytest.mark.parametrize(
    ("mode", "other_mode_seen", "settings", "invited"),
    [
        (Mode.GUIDED, True, INVITING, True),
        (Mode.GUIDED, False, INVITING, False),
        (Mode.HOLD, True, INVITING, False),
        (Mode.GUIDED, True, SETTINGS, False),
    ],
)
def test_a_pilot_engages_by_a_change_to_the_guided_mode_where_that_is_configured(
    mode, other_mode_seen, settings, invited
):
    vehicle = well(heartbeat(mode=mode))
    given = {"vehicle": vehicle, "other_mode_seen": other_mode_seen, "settings": settings}
    assert happens(Event.INVITED, State.STANDING_BY, **given) is invited


def test_a_reboot_and_a_reset_are_counts_that_changed():
    shaken = well()._replace(resets=3, reboots=2)
    assert happens(Event.REBOOTED, State.ENGAGED, vehicle=shaken, reboots_seen=1)
    assert not happens(Event.REBOOTED, State.ENGAGED, vehicle=shaken, reboots_seen=2)
    assert happens(Event.ESTIMATOR_RESET, State.ENGAGED, vehicle=shaken, resets_seen=4)
    assert not happens(Event.ESTIMATOR_RESET, State.ENGAGED, vehicle=shaken, resets_seen=3)


@pytest.mark.parametrize(
    ("armed", "at_s", "seen"), [(False, NOW_S, True), (True, NOW_S, False), (False, 99.9, False)]
)
def test_disarmed_is_said_by_a_heartbeat_after_the_state_was_entered(armed, at_s, seen):
    vehicle = well(heartbeat(at_s, armed=armed))
    assert happens(Event.DISARMED, State.CLIMBING, vehicle=vehicle, since_s=99.9) is seen


@pytest.mark.parametrize(("at_s", "seen"), [(99.9, False), (99.91, True)])
def test_the_guided_mode_is_said_by_a_heartbeat_after_the_state_was_entered(at_s, seen):
    vehicle = observe(VehicleState(), [heartbeat(at_s, Mode.GUIDED), local()])
    assert happens(Event.GUIDED, State.ENTERING, vehicle=vehicle, since_s=99.9) is seen
    held = observe(VehicleState(), [heartbeat(at_s, Mode.HOLD), local()])
    assert not happens(Event.GUIDED, State.ENTERING, vehicle=held, since_s=99.9)
    assert not happens(Event.GUIDED, State.ENTERING, vehicle=VehicleState())


@pytest.mark.parametrize(
    ("autopilot", "dt_s", "late", "stopped"),
    [
        (PX4, 0.25, False, False),
        (PX4, 0.26, True, False),
        (PX4, 0.99 - LOSS_SPARE_S, True, False),
        (PX4, 1.0 - LOSS_SPARE_S, True, True),
        (ARDUCOPTER, 2.99 - LOSS_SPARE_S, True, False),
        (ARDUCOPTER, 3.0 - LOSS_SPARE_S, True, True),
    ],
)
def test_a_late_loop_pauses_and_yields_after_the_autopilots_timeout(autopilot, dt_s, late, stopped):
    settings = settings_of(autopilot)
    assert happens(Event.LOOP_LATE, State.ENGAGED, dt_s=dt_s, settings=settings) is late
    assert happens(Event.LOOP_STOPPED, State.ENGAGED, dt_s=dt_s, settings=settings) is stopped


@pytest.mark.parametrize(
    ("event", "state", "name"),
    [
        (Event.NO_GAME, State.ENGAGED, "no_game"),
        (Event.ESCAPED, State.ENGAGED, "evader_arrived"),
        (Event.CAPTURED, State.ENGAGED, "captured"),
        (Event.STRAYED, State.ON_STATION, "strayed"),
    ],
)
def test_what_the_certificate_says_is_read_from_its_own_line(event, state, name):
    says = QUIET._replace(**{name: True})
    everything_else = QUIET._replace(
        **dict.fromkeys(("no_game", "evader_arrived", "captured", "strayed"), True)
    )._replace(**{name: False})
    assert happens(event, state, certificate=says, vehicle=GUIDED)
    assert not happens(event, state, certificate=everything_else, vehicle=GUIDED)
    assert not happens(event, state, certificate=None, vehicle=GUIDED)


HIGH_M = HOME_DOWN_M - 10.0
STAND_OFF = StandOff(radius_m=4.0, height_m=6.0)
ABOUT_HOME = replace(ENVELOPE, home_ned_m=Ned((5.0, 0.0, HOME_DOWN_M)), stand_off=STAND_OFF)


@pytest.mark.parametrize("state", sorted(SETPOINT_STATES))
@pytest.mark.parametrize(
    ("event", "place", "broken"),
    [
        (Event.FENCE, (304.9, 0.0, HIGH_M), False),
        (Event.FENCE, (305.1, 0.0, HIGH_M), True),
        (Event.FLOOR, (0.0, 0.0, HOME_DOWN_M - 2.6), False),
        (Event.FLOOR, (0.0, 0.0, HOME_DOWN_M - 2.5), False),
        (Event.FLOOR, (0.0, 0.0, HOME_DOWN_M - 2.4), True),
        (Event.CEILING, (0.0, 0.0, HOME_DOWN_M - 60.4), False),
        (Event.CEILING, (0.0, 0.0, HOME_DOWN_M - 60.6), True),
        (Event.STAND_OFF, (100.0, 3.6, HIGH_M), False),
        (Event.STAND_OFF, (100.0, 3.4, HIGH_M), True),
        (Event.STAND_OFF, (100.0, 0.0, HOME_DOWN_M - 5.6), False),
        (Event.STAND_OFF, (100.0, 0.0, HOME_DOWN_M - 5.4), True),
    ],
)
def test_limits_of_space_are_checked_in_every_commanding_state(state, event, place, broken):
    evader = (
        100.0,
        0.0,
        HIGH_M if event is not Event.STAND_OFF or place[2] == HIGH_M else HOME_DOWN_M,
    )
    given = {
        "vehicle": GUIDED,
        "envelope": ABOUT_HOME,
        "position_ned_m": Ned(place),
        "evader_ned_m": Ned(evader),
    }
    for certificate in (QUIET, None):
        assert happens(event, state, certificate=certificate, **given) is broken
    assert not happens(event, state, **(given | {"position_ned_m": None}))
    assert not happens(event, State.HOLDING, **given)


def test_without_a_stand_off_or_an_evader_there_is_none_to_break():
    given = {"vehicle": GUIDED, "position_ned_m": Ned((100.0, 0.0, HIGH_M))}
    without = replace(ABOUT_HOME, stand_off=None)
    assert not happens(
        Event.STAND_OFF,
        State.ENGAGED,
        envelope=without,
        evader_ned_m=Ned((100.0, 0.0, HIGH_M)),
        **given,
    )
    assert not happens(
        Event.STAND_OFF, State.ENGAGED, envelope=ABOUT_HOME, evader_ned_m=None, **given
    )


@pytest.mark.parametrize(
    ("batteries", "low"),
    [
        ([0.25, 0.25, 0.25], False),
        ([0.24, 0.24, 0.24], True),
        ([0.9, 0.0, 0.9, 0.9], False),
        ([0.9, 0.0, 0.0, 0.9, 0.0, 0.0], False),
        ([0.2, 0.2, math.nan, 0.2, 0.2], False),
        ([math.nan, math.nan, math.nan], False),
        ([0.9, 0.0, 0.0, 0.0], True),
    ],
)
def test_a_battery_is_low_when_three_reports_in_succession_are_below_the_minimum(batteries, low):
    observed = Observed(SETTINGS)
    for number, battery in enumerate(batteries):
        observed.take_in(float(number), Inputs([status(float(number), battery)]), in_flight=True)
    is_low = observed.battery_is_low
    assert happens(Event.BATTERY_LOW, State.ENGAGED, battery_is_low=is_low) is low


@pytest.mark.parametrize(("silence_s", "lost"), [(1.5, False), (1.51, True), (math.inf, True)])
def test_an_evader_is_lost_after_its_timeout(silence_s, lost):
    assert happens(Event.EVADER_LOST, State.ENGAGED, evader_silence_s=silence_s) is lost


def test_done_is_a_matter_of_configuration():
    for after in AfterCapture:
        settings = settings_of(after_capture=after)
        assert happens(Event.DONE, State.ON_STATION, settings=settings) is (
            after is AfterCapture.RETURN
        )


@pytest.mark.parametrize("mode", [*PX4.custom_modes, Mode.OTHER])
@pytest.mark.parametrize("armed", [False, True])
def test_armed_counts_in_the_mode_that_was_asked_for_only(armed, mode):
    vehicle = well(heartbeat(mode=mode, armed=armed))
    counts = armed and mode is PX4.arming_mode
    assert happens(Event.ARMED, State.ARMING, vehicle=vehicle) is counts


@pytest.mark.parametrize(("height_m", "mode", "there"), [
    (9.29, Mode.HOLD, False), (9.31, Mode.HOLD, True), (9.31, Mode.TAKEOFF, False), (12.0, Mode.GUIDED, True),
])  # fmt: skip
def test_the_take_off_height_is_above_home_and_reached_once_the_autopilot_is_done(
    height_m, mode, there
):
    vehicle = well(heartbeat(mode=mode), local(position=(0.0, 0.0, HOME_DOWN_M - height_m)))
    assert happens(Event.AT_HEIGHT, State.CLIMBING, vehicle=vehicle) is there
    high = observe(VehicleState(), [heartbeat(), local(position=(0.0, 0.0, -50.0))])
    assert happens(Event.AT_HEIGHT, State.CLIMBING, vehicle=high)
    assert not happens(Event.AT_HEIGHT, State.CLIMBING, vehicle=high, home_ned_m=None)
    just_below = well(heartbeat(), local(position=(0.0, 0.0, -(10.0 - 0.7))))
    assert not happens(Event.AT_HEIGHT, State.CLIMBING, vehicle=just_below, home_ned_m=NOWHERE)
    assert not happens(
        Event.AT_HEIGHT, State.CLIMBING, vehicle=observe(VehicleState(), [heartbeat(), home()])
    )


@pytest.mark.parametrize(
    ("off_m", "speed_m_s", "there"),
    [(0.99, 0.0, True), (1.0, 0.0, False), (0.0, 0.39, True), (0.0, 0.4, False)],
)
def test_the_start_is_reached_at_rest_within_a_metre(off_m, speed_m_s, there):
    start = (30.0, -20.0, -15.0)
    vehicle = well(local(position=(30.0, -20.0 + off_m, -15.0), velocity=(0.0, 0.0, speed_m_s)))
    assert happens(Event.AT_START, State.POSITIONING, vehicle=vehicle, start_ned_m=start) is there
    assert happens(Event.AT_START, State.POSITIONING, vehicle=vehicle, start_ned_m=None)
    deaf = observe(VehicleState(), [heartbeat()])
    assert not happens(Event.AT_START, State.POSITIONING, vehicle=deaf, start_ned_m=start)


@pytest.mark.parametrize(
    ("changes", "clear"),
    [
        ({}, True),
        ({"since_s": NOW_S - 0.99}, False),
        ({"evader_silence_s": 1.5}, True),
        ({"evader_silence_s": 1.6}, False),
        ({"vehicle": GUIDED._replace(resets=1, reset_s=NOW_S - 1.0)}, True),
        ({"vehicle": GUIDED._replace(resets=1, reset_s=NOW_S - 0.99)}, False),
        (
            {"vehicle": observe(VehicleState(), [heartbeat(mode=Mode.GUIDED), local(NOW_S - 1.2)])},
            False,
        ),
    ],
)
def test_a_pause_ends_once_everything_was_well_for_a_while(changes, clear):
    assert (
        happens(
            Event.CLEAR, State.PAUSED, **({"since_s": NOW_S - 1.0, "vehicle": GUIDED} | changes)
        )
        is clear
    )


@pytest.mark.parametrize(
    ("state", "limit_s"),
    [
        (State.CONNECTING, 30.0),
        (State.CHECKING, 90.0),
        (State.ARMING, 15.0),
        (State.CLIMBING, 90.0),
        (State.POSITIONING, 180.0),
        (State.ENTERING, 10.0),
        (State.PAUSED, 10.0),
    ],
)
def test_a_phase_has_its_own_longest_time(state, limit_s):
    assert not happens(Event.TIMED_OUT, state, since_s=NOW_S - limit_s)
    assert happens(Event.TIMED_OUT, state, since_s=NOW_S - limit_s - 0.01)
    patient = settings_of(limits_s={})
    assert not happens(Event.TIMED_OUT, state, since_s=-1e9, settings=patient)


def test_of_all_that_happens_at_once_the_most_severe_comes_first():
    flags = dict.fromkeys(("no_game", "evader_arrived", "captured", "strayed"), True)
    worst = {
        "vehicle": observe(
            VehicleState(),
            [heartbeat(mode=Mode.OTHER, armed=False), local(NOW_S - 1.1), status(battery=0.1)],
        )._replace(resets=1, reboots=1, clock=BootClock(delay_s=0.6, late_since_s=NOW_S - 1.1)),
        "dt_s": 2.0,
        "battery_is_low": True,
        "since_s": NOW_S - 60.0,
        "evader_silence_s": 9.0,
        "foreign": True,
        "position_ned_m": Ned((1e3, 0.0, HOME_DOWN_M)),
        "evader_ned_m": Ned((1e3, 0.0, HOME_DOWN_M)),
        "envelope": ABOUT_HOME,
        "certificate": QUIET._replace(**flags),
        "settings": settings_of(after_capture=AfterCapture.RETURN),
    }
    most_severe = [
        Event.PILOT,
        Event.REBOOTED,
        Event.TELEMETRY_LOST,
        Event.DISARMED,
        Event.LOOP_STOPPED,
        Event.LATE,
        Event.FOREIGN,
        Event.FENCE,
        Event.FLOOR,
        Event.STAND_OFF,
        Event.BATTERY_LOW,
    ]
    engaged = [Event.ESTIMATOR_RESET, Event.LOOP_LATE, Event.EVADER_LOST, Event.NO_GAME]
    assert list(events(context(State.ENGAGED, **worst))) == [
        *most_severe,
        *engaged,
        Event.ESCAPED,
        Event.CAPTURED,
    ]
    assert list(events(context(State.ON_STATION, **worst))) == [
        *most_severe,
        *engaged,
        Event.DONE,
        Event.STRAYED,
    ]
    assert list(events(context(State.PAUSED, **worst))) == [*most_severe, Event.TIMED_OUT]
    back = {"vehicle": GUIDED, "since_s": NOW_S - 60.0}
    assert list(events(context(State.PAUSED, **back))) == [Event.CLEAR, Event.TIMED_OUT]
    assert list(events(context(State.ENTERING, **back))) == [Event.GUIDED, Event.TIMED_OUT]
    assert list(events(context(State.ARMING, since_s=0.0))) == [Event.ARMED, Event.TIMED_OUT]


@pytest.mark.parametrize(
    ("delay_s", "silence_s", "expected"),
    [
        (0.0, 0.9, []),
        (0.0, 1.1, [Event.TELEMETRY_LOST]),
        (0.4, 0.7, [Event.TELEMETRY_LOST]),
        (0.6, 0.3, []),
        (0.6, 0.5, [Event.LATE]),
    ],
)
def test_telemetry_that_stops_is_lost_and_telemetry_that_is_old_on_arrival_is_late(
    delay_s, silence_s, expected
):
    messages = [heartbeat(armed=True), local(NOW_S - silence_s)]
    vehicle = observe(VehicleState(), messages)._replace(clock=BootClock(delay_s=delay_s))
    moment = context(State.ENGAGED, vehicle=vehicle)
    telemetry = {Event.TELEMETRY_LOST, Event.LATE}
    assert [event for event in events(moment) if event in telemetry] == expected


def test_what_is_done_in_time_has_not_taken_too_long():
    late = {"since_s": NOW_S - 1e3, "evader_silence_s": 0.0}
    assert list(events(context(State.CONNECTING, **late))) == [Event.HEARD, Event.TIMED_OUT]
    assert list(events(context(State.CHECKING, **late))) == [Event.FIT, Event.TIMED_OUT]
    assert list(events(context(State.CLIMBING, **late))) == [Event.AT_HEIGHT, Event.TIMED_OUT]
    assert list(events(context(State.POSITIONING, **late))) == [Event.AT_START, Event.TIMED_OUT]


def test_fit_is_every_check_and_no_refusal():
    assert fit(context(State.CHECKING))
    assert list(events(context(State.READY))) == []
    for unfit in ({"refusals": ("COM_OF_LOSS_T",)}, {"vehicle": well(status(healthy=0))}):
        assert not fit(context(State.CHECKING, **unfit))
        assert list(events(context(State.CHECKING, **unfit))) == []
        assert list(events(context(State.READY, **unfit))) == [Event.UNFIT]


def observed_of(vehicle, autopilot=PX4, **changes):
    return context(
        State.READY, vehicle=vehicle, settings=settings_of(autopilot), **changes
    ).observed


def row(name, vehicle, autopilot=PX4, **changes):
    (one,) = [
        check
        for check in checks(observed_of(vehicle, autopilot, **changes), autopilot, NOW_S)
        if check.name == name
    ]
    return one.verdict == "pass", one.value


@pytest.mark.parametrize(
    ("name", "changes", "expected"),
    [
        ("sender", [], (True, "alone")),
        ("autopilot", [], (True, "MAV_AUTOPILOT 12, want 12")),
        ("autopilot", [heartbeat(autopilot=ARDUCOPTER)], (False, "MAV_AUTOPILOT 3, want 12")),
        ("Heartbeat", [heartbeat(NOW_S - 2.99)], (True, "3.0 s old")),
        ("Heartbeat", [heartbeat(NOW_S - 3.1)], (False, "3.1 s old")),
        ("Attitude", [Attitude(NOW_S - 0.99, 0.0, 0.0)], (True, "1.0 s old")),
        ("Attitude", [Attitude(NOW_S - 1.1, 0.0, 0.0)], (False, "1.1 s old")),
        ("LandedState", [LandedState(NOW_S - 1.99, 1)], (True, "2.0 s old")),
        ("LandedState", [LandedState(NOW_S - 2.1, 1)], (False, "2.1 s old")),
        ("Home", [home(NOW_S - 9.9)], (True, "9.9 s old")),
        ("Home", [home(NOW_S - 10.1)], (False, "10.1 s old")),
        ("SystemStatus", [status(NOW_S - 2.9)], (True, "2.9 s old")),
        ("SystemStatus", [status(NOW_S - 3.1)], (False, "3.1 s old")),
        ("delay", [], (True, "0.00 s")),
        ("prearm", [], (True, "healthy")),
        ("prearm", [status(healthy=PREARM - 1)], (False, "the autopilot's own checks fail")),
        ("prearm", [status(present=0, healthy=PREARM)], (True, "healthy")),
        ("prearm", [status(present=0, healthy=0)], (False, "the autopilot's own checks fail")),
        ("battery", [status(battery=0.25)], (True, "25% left")),
        ("battery", [status(battery=0.24)], (False, "24% left")),
        ("battery", [status(battery=math.nan)], (True, "unknown")),
    ],
)
def test_a_check_says_what_it_found(name, changes, expected):
    assert row(name, well(*changes)) == expected


def test_px4_arming_checks_count_although_px4_never_reports_them_as_present():
    silent = well(status(present=0, healthy=0))
    assert not row("prearm", silent, PX4)[0]
    assert row("prearm", silent, ARDUCOPTER)[0]
    assert not row("prearm", well(status(healthy=0)), ARDUCOPTER)[0]


@pytest.mark.parametrize(("age_s", "passed"), [(1.0, True), (1.1, False)])
def test_a_position_that_is_a_second_old_is_too_old_to_start_with(age_s, passed):
    assert row("LocalPosition", observe(VehicleState(), [local(NOW_S - age_s)])) == (
        passed,
        f"{age_s:.1f} s old",
    )


@pytest.mark.parametrize(("delay_s", "passed"), [(0.49, True), (0.51, False)])
def test_telemetry_that_is_half_a_second_late_is_too_late_to_start_with(delay_s, passed):
    late = local()._replace(time_boot_s=NOW_S - delay_s)
    vehicle = observe(VehicleState(), [timesync(), late])
    assert row("delay", vehicle) == (passed, f"{delay_s:.2f} s")


@pytest.mark.parametrize(
    ("north_m", "found"),
    [
        (0.0, (True, "0.0 m from home")),
        (299.5, (True, "299.5 m from home")),
        (300.0, (True, "300.0 m from home")),
        (300.5, (False, "300.5 m from home, 0.5 m outside the fence of 300.0 m")),
    ],
)
def test_a_vehicle_is_inside_the_whole_fence_and_not_only_where_commands_stay(north_m, found):
    envelope = replace(ENVELOPE, fence_margin_m=2.0, home_ned_m=Ned((0.0, 0.0, HOME_DOWN_M)))
    position = Ned((north_m, 0.0, HOME_DOWN_M - 10.0))
    passed, value = row("fence", well(), envelope=envelope, position_ned_m=position)
    assert (passed, value.split(":")[0]) == found
    assert ("set home" in value) is not passed


def test_a_home_that_is_fixed_may_be_old_and_nothing_else():
    fixed = well(home(NOW_S - 99.0))._replace(home_fixed=True)
    assert fit(context(State.READY, vehicle=fixed))
    for old in (Attitude(NOW_S - 1.1, 0.0, 0.0), status(NOW_S - 3.1)):
        assert not fit(context(State.READY, vehicle=observe(fixed, [old])))


def arming(vehicle, autopilot=ARDUCOPTER, shown_s=NOW_S - 1.0):
    observed = observed_of(vehicle, autopilot)
    observed.mode_since_s = shown_s
    return arming_refusal(observed, autopilot, NOW_S)


def test_arming_needs_a_check_that_was_made_a_second_after_the_mode_was_shown():
    on_the_ground = well(heartbeat(mode=Mode.GUIDED, armed=False, autopilot=ARDUCOPTER))
    assert arming(on_the_ground) == ""
    assert "yet" in arming(on_the_ground, shown_s=NOW_S - 0.9)


def test_a_check_in_our_own_mode_that_misses_our_readiness_keeps_nobody_from_arming():
    for autopilot, bars in ((PX4.as_mode, False), (ARDUCOPTER, True)):
        beat = heartbeat(mode=Mode.GUIDED, armed=False, autopilot=autopilot)
        assert bool(arming(well(beat, status(healthy=0)), autopilot)) is bars


@pytest.mark.parametrize("state", sorted(set(State) - BEFORE_FLIGHT - FINAL))
def test_a_pilots_choice_of_our_mode_is_no_intervention_where_it_may_begin_the_game(state):
    ours = PX4.as_mode
    for mode in (Mode.GUIDED, Mode.HOLD, Mode.OTHER):
        beat = heartbeat(mode=mode, autopilot=ours)
        seen = happens(
            Event.PILOT, state, vehicle=well(beat), settings=settings_of(ours), left=frozenset()
        )
        chosen = state in {State.STANDING_BY, State.OUT_OF_CONTACT, State.HOLDING}
        asked = ours.arming_mode if state is State.ARMING else ASKED_MODES.get(state)
        climbs = state is State.CLIMBING and mode is Mode.HOLD
        assert seen is not (mode is asked or climbs or (mode is Mode.GUIDED and chosen))


def test_an_armed_vehicles_own_check_counts_in_every_mode():
    lost_gps = status(present=PREARM | GPS, healthy=PREARM)
    for armed in (True, False):
        vehicle = well(heartbeat(mode=Mode.OTHER, armed=armed), lost_gps)
        passed, value = row("prearm", vehicle)
        assert passed is armed
        assert (PX4.mode_title(Mode.HOLD) in value) is not armed


def test_values_as_old_as_is_allowed_bar_no_engagement():
    edge = well(status(NOW_S - STATUS_LIMIT_S), Attitude(NOW_S - TELEMETRY_LIMIT_S, 0.0, 0.0))
    assert telemetry_refusal(edge, NOW_S) == ""


def test_only_arming_that_takes_too_long_says_what_it_waited_for():
    waits = well(heartbeat(mode=Mode.OTHER, armed=False))
    for state in (State.ARMING, State.CLIMBING, State.POSITIONING):
        words = detail_of(Event.TIMED_OUT, context(state, vehicle=waits))
        assert bool(words) is (state is State.ARMING)


def test_a_delay_that_is_unknown_is_no_pass():
    found = row("delay", observe(VehicleState(), [local()]))
    assert found == (False, "unknown: TIMESYNC is not answered")


def test_what_was_never_heard_passes_no_check():
    rows = checks(observed_of(VehicleState()), PX4, NOW_S)
    kinds = [kind.__name__ for kind in NEEDED]
    assert [check.name for check in rows] == [
        "autopilot",
        *kinds,
        "fence",
        "sender",
        "delay",
        "prearm",
        "battery",
    ]
    unheard = [check for check in rows if check.name not in {"sender", "delay"}]
    assert {check.verdict for check in rows if check.name != "sender"} == {"refuse"}
    assert {check.value for check in unheard} == {"not heard"}


@pytest.mark.parametrize(
    ("autopilot", "mode", "armed", "passed"),
    [
        (PX4, Mode.GUIDED, False, True),
        (PX4, Mode.GUIDED, True, False),
        (PX4, Mode.HOLD, False, False),
        (ARDUCOPTER, Mode.GUIDED, False, False),
    ],
)
def test_checks_that_miss_our_setpoints_keep_nobody_on_the_ground(autopilot, mode, armed, passed):
    """A real PX4 stays in OFFBOARD after a landing, and its checks fail until it is asked for another mode."""
    vehicle = well(heartbeat(mode=mode, armed=armed, autopilot=autopilot), status(healthy=0))
    assert row("prearm", vehicle, autopilot)[0] is passed


@pytest.mark.parametrize(
    ("mode", "armed", "passed"),
    [(Mode.GUIDED, False, True), (Mode.GUIDED, True, False), (Mode.HOLD, False, False)],
)
def test_offboard_that_an_earlier_flight_left_keeps_no_flight_mode_on_the_ground(
    mode, armed, passed
):
    vehicle = well(heartbeat(mode=mode, armed=armed, autopilot=PX4), status(healthy=0))
    assert row("prearm", vehicle, PX4.as_mode)[0] is passed


CONTRADICTED = (NOW_S - 1.0, NOW_S - 0.5, NOW_S - 0.1)
LATE = BootClock(delay_s=0.6, late_since_s=NOW_S - 1.0)


def test_a_second_sender_ends_a_game_and_bars_an_engagement_until_it_is_gone():
    two = well()._replace(contradicted_s=CONTRADICTED)
    gone = well()._replace(contradicted_s=tuple(at_s - 4.0 for at_s in CONTRADICTED))
    assert happens(Event.SECOND_SENDER, State.ENGAGED, vehicle=two)
    assert not happens(Event.SECOND_SENDER, State.ENGAGED, vehicle=gone)
    assert row("sender", two)[0] is False
    assert row("sender", gone)[0] is True
    assert "two senders" in row("sender", two)[1]
    assert "two senders" in telemetry_refusal(two, NOW_S)
    assert telemetry_refusal(gone, NOW_S) == ""
    assert telemetry_refusal(well()._replace(clock=LATE), NOW_S) == (
        "telemetry is 0.6 s late; at most 0.5 s is allowed"
    )


def test_a_check_that_fails_says_what_to_do_and_one_that_passes_does_not():
    for vehicle in (VehicleState(), well(), well()._replace(contradicted_s=CONTRADICTED)):
        for check in checks(observed_of(vehicle), PX4, NOW_S):
            assert isinstance(check.advice, str)
            assert (check.advice == "") is (check.verdict == "pass")
            assert check.wanted == ""


def test_half_a_second_of_delay_is_the_most_that_counts_as_in_time():
    for delay_s, late in ((0.5, False), (0.51, True)):
        vehicle = observe(VehicleState(), [heartbeat(), local(NOW_S - 0.9)])
        vehicle = vehicle._replace(clock=BootClock(delay_s=delay_s))
        assert is_late(vehicle, NOW_S) is late
        assert row("delay", vehicle)[0] is not late
        assert happens(Event.TELEMETRY_LOST, State.ENGAGED, vehicle=vehicle) is not late
    # A position as old as is allowed is not too old, however late it came.
    vehicle = observe(VehicleState(), [heartbeat(), local(NOW_S - 0.25)])
    assert not is_late(vehicle._replace(clock=BootClock(delay_s=0.75)), NOW_S)


@pytest.mark.parametrize(
    ("beat_s", "local_s", "attitude_s", "words"),
    [
        (3.0, 1.0, 0.1, "telemetry is back"),
        (0.1, 1.5, 0.1, "no LOCAL_POSITION_NED for 1.5 s"),
        (3.5, 0.1, 0.1, "no HEARTBEAT for 3.5 s"),
        (3.5, 1.5, 0.5, "no HEARTBEAT for 3.5 s; no LOCAL_POSITION_NED for 1.5 s"),
        (4.0, 3.0, 2.0, "no telemetry for 2.0 s"),
        (4.0, 2.0, 3.0, "no telemetry for 2.0 s"),
        (2.0, 4.0, 3.0, "no telemetry for 2.0 s"),
        (9.0, 0.75, 9.0, "no telemetry for 0.8 s"),
    ],
)
def test_a_gap_of_telemetry_names_what_is_missing_and_for_how_long(
    beat_s, local_s, attitude_s, words
):
    messages = [heartbeat(NOW_S - beat_s), Attitude(NOW_S - attitude_s, 0.0, 0.0)]
    vehicle = observe(VehicleState(), [*messages, local(NOW_S - local_s)])
    assert telemetry_gap(vehicle, NOW_S) == words


@pytest.mark.parametrize(
    ("mode", "words"),
    [
        (Mode.LAND, f"the vehicle is in {PX4.mode_title(Mode.LAND)}: "),
        (Mode.OTHER, "the vehicle is in another mode: "),
        (None, "the vehicle is in another mode: "),
    ],
)
def test_a_takeover_names_the_mode(mode, words):
    moment = context(State.ENGAGED)
    moment.observed.mode = mode
    assert detail_of(Event.PILOT, moment) == f"{words}a pilot or the autopilot chose that mode"


def test_lost_telemetry_names_another_autopilot_that_is_heard_instead():
    moment = context(State.ENGAGED, vehicle=VehicleState())
    assert detail_of(Event.TELEMETRY_LOST, moment) == "no telemetry for inf s"
    for age_s, named in ((3.0, True), (3.1, False)):
        moment.observed.other_beat = heartbeat(NOW_S - age_s, autopilot=ARDUCOPTER)._replace(
            vehicle_type=1
        )
        other = "; MAV_AUTOPILOT 3, fixed wing (MAV_TYPE 1), is heard instead"
        words = f"no telemetry for inf s{other if named else ''}"
        assert detail_of(Event.TELEMETRY_LOST, moment) == words


def test_a_flight_begins_without_a_past():
    assert Stage() == Stage(
        State.CONNECTING, 0.0, 0, 0, False, frozenset(), 0.0, math.inf, False, False
    )


def test_a_policys_fault_is_the_detail_of_its_failure():
    for fault, words in (("has no value", "has no value"), ("", ""), (None, "")):
        certificate = QUIET._replace(policy_fault=fault)
        assert (
            detail_of(Event.POLICY_FAILED, context(State.ENGAGED, certificate=certificate)) == words
        )
    assert detail_of(Event.POLICY_FAILED, context(State.ENGAGED, certificate=None)) == ""


def test_every_detail_is_a_sentence_of_its_moment_and_most_events_need_none():
    moment = context(State.ENGAGED, vehicle=well()._replace(clock=LATE), dt_s=2.04)
    moment.observed.silent_mate = lambda now_s: "bravo" if now_s == NOW_S else ""
    assert detail_of(Event.REBOOTED, moment) == "the autopilot rebooted"
    assert detail_of(Event.LATE, moment) == telemetry_refusal(moment.observed.vehicle, NOW_S)
    assert "disarmed" in detail_of(Event.DISARMED, moment)
    assert detail_of(Event.DISARMED, context(State.LANDING)) == ""
    assert "stood still for 2.0 s" in detail_of(Event.LOOP_STOPPED, moment)
    assert detail_of(Event.MATE_SILENT, moment) == "bravo is near and was not heard for 2 s"
    assert detail_of(Event.ASSIGNED, moment) == "plays against red now"
    assert detail_of(Event.CAPTURED, moment) == ""


@pytest.mark.parametrize(
    ("silent_s", "lost", "gone"),
    [(5.0, False, False), (5.1, True, False), (35.0, True, False), (35.1, True, True)],
)
def test_an_operator_is_missed_after_the_configured_time_and_given_up_after_more(
    silent_s, lost, gone
):
    settings = settings_of(operator_timeout_s=5.0, operator_return_s=30.0)
    changes = {"settings": settings, "operator_s": NOW_S - silent_s}
    assert happens(Event.OPERATOR_LOST, State.ENGAGED, **changes) is lost
    assert happens(Event.OPERATOR_GONE, State.HOLDING, **changes) is gone


@pytest.mark.parametrize(("chased_s", "over"), [(60.0, False), (60.1, True)])
def test_a_chase_has_a_longest_time_where_one_is_configured(chased_s, over):
    chase = {"chase_began_s": NOW_S - chased_s, "vehicle": GUIDED}
    limited = settings_of(longest_chase_s=60.0)
    assert happens(Event.CHASE_TIMED_OUT, State.ENGAGED, settings=limited, **chase) is over
    assert not happens(Event.CHASE_TIMED_OUT, State.ENGAGED, **chase)


def silent(moment, name="bravo", mates=("bravo",)):
    """Return the moment with these mates, of which one is silent."""
    moment.observed.mates = dict.fromkeys(mates)
    moment.observed.view = lambda _: None
    moment.observed.silent_mate = lambda now_s: name if now_s == NOW_S else ""
    return moment


def test_a_silent_mate_pauses_a_game_and_keeps_it_paused():
    def engaged():
        return context(State.ENGAGED, vehicle=GUIDED)

    def paused():
        return context(State.PAUSED, vehicle=GUIDED, since_s=NOW_S - 5.0)

    assert Event.MATE_SILENT in set(events(silent(engaged())))
    assert Event.MATE_SILENT not in set(events(silent(engaged(), name="")))
    assert Event.MATE_SILENT not in set(events(silent(engaged(), mates=())))
    assert Event.CLEAR in set(events(silent(paused(), name="")))
    assert Event.CLEAR not in set(events(silent(paused())))


def test_rivals_end_a_game_where_that_is_configured():
    given = {"vehicle": GUIDED, "rival": "second source"}
    assert happens(Event.RIVAL, State.ENGAGED, **given)
    assert not happens(Event.RIVAL, State.ENGAGED, **(given | {"rival": ""}))
    assert not happens(
        Event.RIVAL, State.ENGAGED, settings=settings_of(hold_on_rival=False), **given
    )


@pytest.mark.parametrize(
    ("changes", "too_high", "invited"),
    [
        ({}, "", True),
        ({"refusals": ("COM_OF_LOSS_T",)}, "", False),
        ({"vehicle": GUIDED._replace(contradicted_s=CONTRADICTED)}, "", False),
        ({}, "9 m", False),
    ],
)
def test_what_bars_an_engagement_bars_a_pilots_too(changes, too_high, invited):
    given = {"settings": INVITING, "vehicle": GUIDED, "other_mode_seen": True}
    moment = context(State.STANDING_BY, **(given | changes))
    moment.observed.tracking.too_high = too_high
    assert (Event.INVITED in set(events(moment))) is invited


@pytest.mark.parametrize(
    ("changes", "contact"),
    [
        ({}, True),
        ({"since_s": NOW_S - 0.9}, False),
        ({"since_s": NOW_S - 0.9, "vehicle": VehicleState()}, False),
        ({"vehicle": VehicleState()}, False),
        ({"vehicle": well(local(NOW_S - 0.01), heartbeat(NOW_S - 3.1))}, False),
        ({"refusals": ("COM_OF_LOSS_T",)}, False),
        ({"vehicle": well(status(healthy=0))}, False),
    ],
)
def test_contact_is_back_once_telemetry_and_checks_were_good_for_a_while(changes, contact):
    moment = context(State.OUT_OF_CONTACT, **({"since_s": NOW_S - 1.0} | changes))
    assert (Event.CONTACT in set(events(moment))) is contact


def test_a_request_to_hand_over_without_contact_has_a_second_to_be_sent():
    for since_s, lost in ((0.99, False), (1.0, True)):
        vehicle = observe(VehicleState(), [heartbeat(NOW_S - 3.1)])
        changes = {"vehicle": vehicle, "since_s": NOW_S - since_s}
        for state in HANDING_OVER:
            assert happens(Event.TELEMETRY_LOST, state, **changes) is lost


def test_a_fence_is_left_beyond_the_fence_and_not_where_commands_end():
    margin = replace(ABOUT_HOME, fence_margin_m=50.0)
    for north_m, left in ((304.9, False), (305.0, False), (305.1, True)):
        place = (north_m, 0.0, HIGH_M)
        given = {"vehicle": GUIDED, "envelope": margin, "position_ned_m": Ned(place)}
        assert happens(Event.FENCE, State.ENGAGED, **given) is left


def test_the_floor_is_broken_below_the_floor_and_not_within_the_doubt_of_the_height():
    doubt = observe(GUIDED, [EstimatorStatus(NOW_S, 1.0)])
    envelope = replace(ABOUT_HOME, floor_margin_m=1.0)
    given = {"vehicle": doubt, "envelope": envelope}
    for height_m, broken in ((2.6, False), (2.4, True)):
        place = (0.0, 0.0, HOME_DOWN_M - height_m)
        assert happens(Event.FLOOR, State.ENGAGED, position_ned_m=Ned(place), **given) is broken
