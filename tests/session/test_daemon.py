import logging

import pytest
from pymavlink.dialects.v20 import common as mavlink

from guidance.autopilots.description import MAV_CMD_DO_SET_MODE
from guidance.config import parse_document
from guidance.cycle import Alarm, Violation
from guidance.errors import ConfigError
from guidance.flight import Event, State
from guidance.log.writer import Record
from guidance.session.fly.daemon import Daemon, Equipment
from guidance.session.orders.words import WORDS
from guidance.session.plan import plan_of
from guidance.session.vehicle_file import Config
from tests.harness.vehicle import FENCED

SET_UP = {"GUID_TIMEOUT": 1.0, "FENCE_ENABLE": 1}


def pilot(base, mode):
    base.vehicle.inject("rc", True)
    base.run(0.5)
    base.vehicle.inject("pilot_mode", mode)


ENDED_BY = [
    ("hold", State.HOLDING, "HOLD"),
    ("return", State.RETURNING, "RTL"),
    ("land", State.LANDING, "LAND"),
    ("abort", State.LANDING, "LAND"),
]


def test_a_daemon_restarted_in_the_air_does_not_say_that_its_vehicle_is_ready(base):
    """Catches a restarted daemon that takes a flying vehicle for its own."""
    base = base.standing_by()
    used = Equipment(mailbox=base.mailbox, sinks=[base.log])
    base.daemon = base.pilot = Daemon(
        base.config.name, plan_of(base.config), base.link, {"evader": base.evader}, used
    )
    base.until(State.READY)
    assert base.order("status")["state"] == "not taken over"
    refused = base.order("engage")
    assert (refused["accepted"], refused["state"]) == (False, "not taken over")
    assert base.order("hold")["state"] == "holding"


def test_nothing_arms_and_nothing_engages_without_an_order(base):
    """Catches a daemon that begins by itself."""
    base = base.ready().run(5.0)
    assert base.state is State.READY
    assert not base.vehicle.armed
    assert base.setpoints_since(0.0) == []


def test_orders_fly_a_pursuit_from_the_ground_to_the_hold(base):
    """Catches a break between the orders of a whole flight."""
    base = base.engaged()
    base.until(State.ON_STATION)
    assert base.order("hold") == {
        "accepted": True,
        "order": "hold",
        "name": "uav1",
        "state": "holding",
    }
    base.run(2.0)
    assert base.vehicle.mode == "HOLD"
    assert base.order("land")["accepted"]
    base.until(State.LANDED)
    assert not base.vehicle.armed


def test_an_order_that_changes_nothing_is_refused_with_what_to_do_next(base):
    base = base.ready()
    answer = base.order("engage")
    assert not answer["accepted"]
    assert "order start first" in answer["reason"]
    answer = base.order("hold")
    assert "there is no flight to end" in answer["reason"]


@pytest.mark.parametrize(("order", "state", "mode"), ENDED_BY)
def test_a_vehicle_that_was_flying_when_the_daemon_began_is_handed_over_on_an_order(
    base, order, state, mode
):
    """Catches an order that a daemon refuses because the flight is not its own."""
    base = aloft(base.standing_by())
    base.until(State.CHECKING, State.READY)
    assert base.order(order)["accepted"]
    assert base.state is state
    base.run(3.0)
    assert base.vehicle.mode == mode
    assert "in flight" in base.order("reset")["reason"]


def aloft(base):
    """End the daemon of a vehicle in the air, and begin another flight of it at once."""
    base.daemon.begin(base.daemon.plan)
    return base


def test_answers_about_a_vehicle_that_is_up_already_are_true(base):
    """Catches a start in somebody else's mode, or a refusal for a wrong reason."""
    assert "not heard" in base().order("start")["reason"]
    base = aloft(base.standing_by()).until(State.READY)
    assert (
        base.order("engage")["reason"]
        == "airborne, and not taken over yet: order start first, then engage"
    )
    pilot(base, "POSCTL")
    base.run(2.0)
    assert "order hold, then engage" in base.order("start")["reason"]
    assert base.state is State.READY
    pilot(base, "HOLD")
    base.run(2.0)
    assert "had it armed, in another mode, less than 2.5 s" in base.order("start")["reason"]
    base.run(2.0)
    assert base.order("start")["accepted"]
    assert base.order("engage")["accepted"]
    base.until(State.ENGAGED)


BOTH = [({}, "px4", "POSCTL"), ({"parameters": SET_UP}, "arducopter", "LOITER")]


@pytest.mark.parametrize(("given", "autopilot", "sticks"), BOTH)
def test_a_vehicle_that_a_pilot_armed_on_the_ground_is_refused_with_the_reason(
    base, given, autopilot, sticks
):
    base = base.ready(**given, vehicle={"autopilot": autopilot})
    pilot(base, sticks)
    base.run(0.5)
    base.vehicle.autopilot.state.arm()
    base.run(1.5)
    answer = base.order("start")
    assert (answer["accepted"], answer["state"]) == (False, "ready")
    assert (
        answer["reason"] == f"somebody else armed it, in {mode_title(base)}: "
        "disarm it, then order start"
    )
    base.run(2.0)
    assert (base.vehicle.mode, base.vehicle.armed) == (sticks, True)


@pytest.mark.parametrize(("given", "autopilot", "sticks"), BOTH)
def test_a_start_right_after_somebody_disarmed_the_vehicle_is_refused_with_the_reason(
    base, given, autopilot, sticks
):
    """Catches a start that arms a vehicle which somebody has just disarmed."""
    base = base.ready(**given, vehicle={"autopilot": autopilot})
    pilot(base, sticks)
    base.run(0.5)
    base.vehicle.autopilot.state.arm()
    base.run(2.0)
    title = mode_title(base)
    base.vehicle.autopilot.state.disarm()
    base.run(1.1)
    answer = base.order("start")
    assert (answer["accepted"], answer["state"]) == (False, "ready")
    assert f"somebody else had it armed, in {title}, less than 2.5 s" in answer["reason"]
    base.run(3.5)
    assert base.order("start")["accepted"]


def mode_title(base):
    return base.order("status")["autopilot_mode"]


@pytest.mark.parametrize(("given", "autopilot"), [one[:2] for one in BOTH])
@pytest.mark.parametrize("order", ["hold", "return", "land", "abort"])
def test_an_order_right_after_the_start_is_accepted_and_leaves_the_vehicle_on_the_ground(
    base, given, autopilot, order
):
    base = base.ready(**given, vehicle={"autopilot": autopilot})
    assert base.order("start")["accepted"]
    assert base.order(order)["accepted"]
    assert "it stands on the ground" in base.order("engage")["reason"] or order != "hold"
    base.until(State.LANDED)
    assert not base.vehicle.armed
    assert base.vehicle.truth.on_ground


def test_abort_lands_a_vehicle_found_in_the_air_and_cancels_one_on_the_ground(base):
    """Catches an abort that commands a vehicle on the ground."""
    up = aloft(base.standing_by()).until(State.READY)
    down = base.ready()
    assert up.order("abort")["state"] == "landing"
    up.until(State.LANDED)
    assert down.order("abort")["state"] == "failed"
    assert not down.commands_since(0.0).count(MAV_CMD_DO_SET_MODE)


def test_an_order_that_is_done_already_is_accepted(base):
    base = base.standing_by()
    assert base.order("hold")["accepted"]
    assert base.state is State.HOLDING
    assert base.order("hold")["accepted"]
    assert "under way already" in base.order("start")["reason"]


def test_what_is_not_an_order_is_told_what_is(base):
    base = base.ready()
    answer = base.order("loop-the-loop")
    assert not answer["accepted"]
    assert all(word in answer["reason"] for word in WORDS)


def test_engaging_is_refused_while_the_evader_is_silent(base):
    base = base.standing_by()
    base.prey_silent = True
    base.run(3.0)
    answer = base.order("engage")
    assert "the evader was last heard 3." in answer["reason"]
    assert base.state is State.STANDING_BY
    base.prey_silent = False
    base.run(1.0)
    assert base.order("engage")["accepted"]


def test_the_status_is_plain_json_with_the_certificate_in_it(base):
    """Catches a certificate of the status that no client can read."""
    base = base.ready()
    status = base.order("status")
    assert status["state"] == "ready"
    assert status["certificate"] is None
    assert not status["streaming"]
    status = base.engaged().run(1.0).order("status")
    assert status["streaming"]
    assert status["certificate"]["value"] > 0.0
    assert status["certificate"]["winner"] == "pursuer"


def test_an_unsafe_autopilot_does_not_become_ready_until_what_it_says_is_mended(base):
    base = base(parameters={}).run(8.0)
    assert base.state is State.CHECKING
    answer = base.order("start")
    assert not answer["accepted"]
    assert "param set GF_MAX_HOR_DIST" in answer["reason"]
    assert base.order("status")["preflight_refused"] == ["GF_MAX_HOR_DIST", "GF_MAX_VER_DIST"]
    assert "not ready" in base.log.messages(logging.WARNING)
    base.order("reset")  # reads everything anew
    gcs = mavlink.MAVLink(None, 255, 190)
    for name, value in (("GF_MAX_HOR_DIST", 150.0), ("GF_MAX_VER_DIST", 80.0)):
        base.injected.append(
            mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, 9).pack(gcs)
        )
    base.until(State.READY, limit_s=10.0)


def test_a_fence_that_is_not_required_is_only_warned_of(base):
    base = base.ready(parameters={}, preflight={"fence_required": False})
    verdicts = {row.name: str(row.verdict) for row in base.daemon.survey.rows}
    assert verdicts["GF_MAX_HOR_DIST"] == "warn"


def test_arducopter_is_refused_for_its_three_second_timeout_and_its_open_fence(base):
    base = base(parameters={}, vehicle={"autopilot": "arducopter"}).run(8.0)
    assert base.order("status")["preflight_refused"] == ["GUID_TIMEOUT", "FENCE_ENABLE"]


def test_after_capture_return_flies_home(base):
    """Catches a configured end of a game that is not flown."""
    base = base.engaged(flight={"after_capture": "return"})
    base.until(State.RETURNING)
    base.run(2.0)
    assert base.vehicle.mode == "RTL"


@pytest.mark.parametrize(
    ("order", "state", "mode"),
    [
        (Event.HOLD, State.HOLDING, "HOLD"),
        (Event.LAND, State.LANDING, "LAND"),
        (Event.RETURN, State.RETURNING, "RTL"),
    ],
)
def test_sigterm_in_flight_hands_the_vehicle_over_before_the_daemon_ends(base, order, state, mode):
    base = base.engaged()
    base.daemon.leave(order, base.now_s)
    left_s = base.now_s
    while not base.daemon.finished:
        base.cycle()
        assert base.now_s - left_s < 5.0
    assert base.state is state
    assert base.vehicle.mode == mode
    assert "STOPPING=1" in base.notifier.said


def test_sigterm_on_the_ground_ends_at_once_and_commands_nothing(base):
    base = base.ready()
    before_s = base.now_s
    base.daemon.leave(Event.HOLD, base.now_s)
    base.cycle()
    assert base.daemon.finished
    assert set(base.commands_since(before_s + 0.001)) <= {512}  # it asks for messages only


def test_sigterm_to_a_vehicle_that_does_not_answer_ends_within_its_limit(base):
    """Catches a daemon that waits for ever for a silent vehicle."""
    base = base.engaged()
    base.link.request = lambda request: None
    base.daemon.leave(Event.LAND, base.now_s)
    left_s = base.now_s
    while not base.daemon.finished:
        base.cycle()
    assert 10.0 < base.now_s - left_s < 15.0


def test_a_second_sigterm_ends_at_once(base):
    base = base.engaged()
    base.daemon.leave(Event.HOLD, base.now_s)
    base.daemon.leave(Event.HOLD, base.now_s)
    assert base.daemon.finished


def test_orders_are_refused_while_the_daemon_is_ending(base):
    base = base.engaged()
    base.daemon.leave(Event.HOLD, base.now_s)
    assert base.order("engage")["reason"] == "the daemon is ending"


def test_a_pilot_takes_over_and_only_a_reset_on_a_persons_word_begins_again(base):
    """Catches a setpoint or command after a pilot has taken over."""
    base = base.engaged()
    pilot(base, "POSCTL")
    base.until(State.YIELDED)
    silent_s = base.now_s
    base.run(5.0)
    assert base.setpoints_since(silent_s + 0.001) == []
    assert base.commands_since(silent_s + 0.001) == []
    assert "order reset to begin another" in base.order("engage")["reason"]
    pilot(base, "HOLD")
    base.run(2.0)
    assert base.order("reset")["accepted"]
    base.until(State.READY)
    # In the air already: nothing arms, nothing climbs
    assert base.order("start")["state"] == "standing by"
    assert base.order("engage")["accepted"]


def test_a_reset_in_flight_is_refused(base):
    base = base.engaged()
    assert "in flight" in base.order("reset")["reason"]
    assert base.state is State.ENGAGED


def test_a_configuration_is_read_again_on_the_ground_only(base):
    """Catches settings that change under a flying vehicle."""
    base = base.ready()
    slower = parse_document(
        Config, {**base.config.model_dump(), "flight": {"takeoff_height_m": 7.0}}, source="again"
    )
    base.daemon.exchange(lambda: plan_of(slower), base.now_s)
    assert base.daemon.flight.settings.takeoff_height_m == 7.0
    base.standing_by()
    base.daemon.exchange(lambda: plan_of(base.config), base.now_s)
    assert base.daemon.flight.settings.takeoff_height_m == 7.0
    assert "configuration not read again: refused in flight" in base.log.messages(logging.WARNING)


def test_a_configuration_that_became_wrong_leaves_the_old_one_in_force(base):
    base = base.ready()

    def wrong():
        raise ConfigError("game.speed_m_s = 0.0: must be greater than 0")

    base.daemon.exchange(wrong, base.now_s)
    assert base.state is State.READY
    level, message, fields = base.log.lines[-1]
    assert (level, message) == (logging.ERROR, "configuration not read again: the old one stays")
    assert "speed_m_s" in fields["error"]


def test_setpoints_of_another_source_are_detected_and_the_vehicle_is_set_to_hold(base):
    base = base.engaged().run(2.0)
    begun_s = base.now_s
    while base.state is State.ENGAGED and base.now_s - begun_s < 5.0:
        base.cycle()
        base.inject_setpoint((-3.0, 3.0, 0.0))
    assert base.state is State.HOLDING
    assert "setpoints of another source" in base.log.messages(logging.WARNING)
    base.run(2.0)
    assert base.vehicle.mode == "HOLD"


def test_signs_of_life_come_from_the_loop_and_stop_with_it(base):
    base = base.ready()
    base.notifier.said.clear()
    base.run(2.0)
    assert 3 <= base.notifier.said.count("WATCHDOG=1") <= 4  # a third of two seconds apart
    base.notifier.said.clear()
    base.frozen = True  # the loop hangs
    base.run(2.0)
    assert base.notifier.said == []


def test_a_frozen_loop_stops_the_stream_and_the_autopilot_takes_over(base):
    """Catches setpoints that go on while the loop stands still."""
    base = base.engaged(parameters={**FENCED, "COM_OBL_RC_ACT": 5})
    base.run(1.0)
    base.frozen = True
    base.run(1.5)
    base.frozen = False
    assert base.vehicle.mode == "HOLD"
    base.cycle()
    assert base.state is State.YIELDED  # whatever the HEARTBEATs of the time between show


def test_the_metrics_follow_the_flight(base):
    base = base.engaged().run(1.5)
    read = base.metrics.registry.get_sample_value
    labels = {"vehicle": "uav1"}
    assert read("guidance_state", {**labels, "state": "engaged"}) == 1.0
    assert read("guidance_state", {**labels, "state": "ready"}) == 0.0
    assert read("guidance_setpoints_total", labels) == len(base.setpoints_since(0.0))
    assert read("guidance_orders_total", {**labels, "order": "start", "accepted": "true"}) == 1.0
    assert read("guidance_age_seconds", {**labels, "what": "evader"}) < 0.2
    assert read("guidance_game", {**labels, "what": "value"}) > 0.0
    assert read("guidance_events_total", {**labels, "event": "armed"}) == 1.0


class CountingRecord(Record):
    """A record that counts its rows."""

    def __init__(self):
        super().__init__()
        self.rows = 0

    def frames(self, passed):
        self.rows += len(passed)


def test_every_cycle_and_event_is_recorded(base):
    record = CountingRecord()
    base(record=record).until(State.READY)
    assert record.rows > 25


def test_a_pilots_switch_to_the_guided_mode_engages_where_that_is_configured(base):
    """Catches a pilot's switch that the daemon does not follow."""
    base = base.standing_by(flight={"engage_on": "pilot_mode"}).run(1.0)
    pilot(base, "POSCTL")
    base.run(2.0)
    assert base.state is State.STANDING_BY  # who is to engage may fly in any mode before
    base.vehicle.inject("pilot_mode", "OFFBOARD")
    base.until(State.ENGAGED, limit_s=3.0)
    assert base.commands_since(base.now_s - 3.0) == []  # nobody but the pilot asked for the mode


def test_while_a_pilot_is_waited_for_the_stream_is_still_and_current(base):
    """Catches a stream that moves the vehicle, or grows old, before the pilot's switch."""
    base = base.standing_by(flight={"engage_on": "pilot_mode"}).run(2.0)
    since_s = base.now_s
    base.run(1.0)
    stream = base.setpoints_since(since_s + 0.001)
    assert len(stream) == 50
    assert all(abs(value) < 0.05 for m in stream for value in (m.vx, m.vy, m.vz))


def test_a_pilot_takes_back_what_he_engaged_and_his_switch_does_not_engage_again(base):
    """Catches a second engagement by the switch of a pilot who took over."""
    base = base.standing_by(flight={"engage_on": "pilot_mode"}).run(1.0)
    pilot(base, "POSCTL")
    base.run(2.0)
    base.vehicle.inject("pilot_mode", "OFFBOARD")
    base.until(State.ENGAGED)
    pilot(base, "POSCTL")
    base.until(State.YIELDED)
    silent_s = base.now_s
    base.vehicle.inject("pilot_mode", "OFFBOARD")
    base.run(4.0)
    assert base.state is State.YIELDED
    assert base.setpoints_since(silent_s + 0.001) == []


def test_waiting_for_a_pilot_starts_with_one_hold_request_and_then_the_stream(base):
    # A PX4 that lost its setpoints in OFFBOARD would take the new stream for the old wish.
    """Catches a stream that PX4 takes for its old wish to fly OFFBOARD."""
    base = base.standing_by(flight={"engage_on": "pilot_mode"})
    begun_s = base.now_s
    base.run(0.9)
    assert base.commands_since(begun_s) == [MAV_CMD_DO_SET_MODE]
    assert base.setpoints_since(begun_s) == []
    base.run(5.0)
    assert base.commands_since(begun_s) == [MAV_CMD_DO_SET_MODE]
    assert len(base.setpoints_since(begun_s)) > 200


def test_without_that_configuration_a_pilots_switch_engages_nothing(base):
    base = base.standing_by()
    assert base.setpoints_since(0.0) == []
    pilot(base, "POSCTL")
    base.until(State.YIELDED)


def test_an_order_out_of_its_time_is_refused_with_what_the_flight_is_doing(base):
    """Catches an order that is taken in a state that does not have it."""
    base = base.ready()
    assert base.order("start")["accepted"]
    base.until(State.CLIMBING)
    assert "it is taking off" in base.order("engage")["reason"]
    base.until(State.STANDING_BY)
    base.order("land")
    base.until(State.LANDED)
    assert "the flight is over: order reset" in base.order("start")["reason"]


def test_a_broken_guarantee_is_said_and_counted(base):
    base = base.engaged()
    step = base.daemon.flight.step
    alarm = Alarm(Violation.CAPTURE_LATER, 1.5)
    base.daemon.flight.step = lambda *read: step(*read)._replace(alarm=alarm)
    base.run(0.1)
    said = base.log.messages(logging.WARNING).count(str(Violation.CAPTURE_LATER))
    labels = {"vehicle": "uav1", "broken": str(Violation.CAPTURE_LATER)}
    assert said == base.metrics.registry.get_sample_value("guidance_alarms_total", labels) == 5


def test_a_record_that_stops_is_said_once(base):
    record = CountingRecord()
    base = base(record=record).run(1.0)
    record.failed = "No space left on device"
    base.run(1.0)
    assert (
        base.log.messages(logging.WARNING).count("recording has stopped; the flight goes on") == 1
    )
    base.until(State.READY)


def test_a_sign_of_life_is_answered_with_where_it_stands_and_is_nothing_else(base):
    base = base.standing_by()
    before = base.daemon.flight.state
    base.run(2.0)
    assert base.daemon.flight.operator_silence_s(base.now_s) > 1.5
    answer = base.order("alive")
    assert answer["accepted"]
    assert answer["state"] == str(before)
    assert base.daemon.flight.operator_silence_s(base.now_s) < 0.2
