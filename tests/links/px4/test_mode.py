"""The protocol of a flight mode of PX4: what is sent for what PX4 says, with a clock that the tests move."""

import itertools

import pytest

from guidance.links.px4.messages import FROM_PX4, TYPES, name_bytes
from guidance.links.px4.mode import (
    ASK_EVERY_S,
    LOST_AFTER_S,
    READINESS_STALE_S,
    REGISTER_EVERY_S,
    Check,
    FlightMode,
    Outgoing,
    Readiness,
)

PURSUIT = 24
HOLD = 4
TAKEOFF = 17
SET_NAV_STATE = 100001


class Px4:
    """PX4's side of a mode, as calls of one line."""

    def __init__(self, name: str = "Pursuit") -> None:
        draws = itertools.count(1)
        self.mode = FlightMode(name, lambda: next(draws))
        self.now_s = 100.0
        self.stamp_us = 50_000_000

    def says(self, topic: str, **values) -> list[Outgoing]:
        kind = TYPES[FROM_PX4[topic]]
        fields = kind.decode(kind.encode(**{"timestamp": self.stamp_us, **values}))
        return self.mode.hear(topic, fields, self.now_s)

    def status(self, **values) -> list[Outgoing]:
        return self.says(
            "vehicle_status",
            **{"arming_state": 1, "nav_state": HOLD, "system_id": 3, "component_id": 1, **values},
        )

    def replies(self, request: Outgoing, *, success: bool = True, **values) -> list[Outgoing]:
        numbers = {"mode_id": PURSUIT, "arming_check_id": 2, "mode_executor_id": 1}
        if not success:
            numbers = dict.fromkeys(numbers, -1)
        asked = {key: request.values[key] for key in ("request_id", "name")}
        return self.says(
            "register_ext_component_reply", success=success, **{**asked, **numbers, **values}
        )

    def registered(self, **status) -> "Px4":
        self.status()
        (request,) = self.mode.due(self.now_s)
        self.replies(request)
        self.status(**status)
        return self

    def asks(self, request_id: int = 9, mask: int = 0b100) -> dict:
        (reply,) = self.says(
            "arming_check_request", request_id=request_id, valid_registrations_mask=mask
        )
        assert reply.topic == "arming_check_reply"
        return reply.values


@pytest.fixture
def px4():
    return Px4()


def test_the_mode_is_registered_with_its_arming_check_and_its_executor(px4):
    (request,) = px4.mode.due(px4.now_s)
    assert request.topic == "register_ext_component_request"
    assert request.values["name"] == name_bytes("Pursuit")
    wanted = ("register_mode", "register_arming_check", "register_mode_executor")
    assert all(request.values[key] for key in wanted)
    # What is not given is 0: no mode of PX4 is replaced, and nothing is entered by itself
    assert "enable_replace_internal_mode" not in request.values
    assert "activate_mode_immediately" not in request.values


def test_it_is_asked_for_again_until_it_is_answered(px4):
    assert px4.mode.due(px4.now_s)
    assert px4.mode.due(px4.now_s + REGISTER_EVERY_S - 0.01) == []
    (again,) = px4.mode.due(px4.now_s + REGISTER_EVERY_S)
    px4.replies(again)
    assert px4.mode.registration == (PURSUIT, 2, 1)


def test_controllers_are_not_configured_because_that_would_stop_the_motors_in_flight(px4):
    (request,) = px4.mode.due(px4.now_s)
    assert px4.replies(request) == []


@pytest.mark.parametrize("wrong", [{"request_id": 77}, {"name": name_bytes("Pursui")}])
def test_an_answer_to_another_program_changes_nothing(px4, wrong):
    (request,) = px4.mode.due(px4.now_s)
    assert px4.replies(request, **wrong) == []
    assert px4.mode.registration is None
    assert px4.mode.refused == ""


@pytest.mark.parametrize("wrong", [{"mode_id": 22}, {"mode_id": 31}, {"arming_check_id": -1}])
def test_impossible_numbers_are_refused(px4, wrong):
    (request,) = px4.mode.due(px4.now_s)
    px4.replies(request, **wrong)
    assert px4.mode.registration is None
    assert "impossible numbers" in px4.mode.refused


def test_a_refusal_says_whether_the_places_are_taken_or_the_vehicle_is_armed(px4):
    px4.status()
    (request,) = px4.mode.due(px4.now_s)
    px4.replies(request, success=False)
    assert "all eight modes are taken" in px4.mode.refused
    px4.status(arming_state=2)
    px4.now_s += REGISTER_EVERY_S
    (request,) = px4.mode.due(px4.now_s)
    px4.replies(request, success=False)
    assert "on the ground only" in px4.mode.refused


def test_every_arming_check_is_answered_by_the_last_readiness(px4):
    px4.registered()
    px4.mode.judge(Readiness(px4.now_s))
    answer = px4.asks(200)
    assert (answer["request_id"], answer["registration_id"]) == (200, 2)
    assert answer["can_arm_and_run"]
    assert answer["num_events"] == 0
    assert answer["mode_req_local_position"]
    assert answer["mode_req_home_position"]
    assert "mode_req_manual_control" not in answer


def test_what_is_missing_is_named_by_events_of_px4(px4):
    px4.registered()
    px4.mode.judge(Readiness(px4.now_s, (Check.EVADER, Check.FENCE)))
    answer = px4.asks()
    assert not answer["can_arm_and_run"]
    assert answer["num_events"] == 2
    ids = [answer["events_0_id"], answer["events_1_id"]]
    assert ids == [Check.EVADER.event_id, Check.FENCE.event_id]


def test_the_number_of_an_event_is_the_hash_of_its_name():
    # FNV-1a of this name, by another implementation, with the autopilot's component in the highest byte
    assert Check.HOME.event_id >> 24 == 1
    assert len({check.event_id for check in Check}) == len(Check)


def test_no_more_than_five_events_are_sent(px4):
    px4.registered()
    px4.mode.judge(Readiness(px4.now_s, tuple(Check)))
    assert px4.asks()["num_events"] == 5


def test_an_old_readiness_means_not_ready(px4):
    px4.registered()
    px4.mode.judge(Readiness(px4.now_s))
    px4.now_s += READINESS_STALE_S
    assert px4.asks()["can_arm_and_run"]
    px4.now_s += 0.01
    answer = px4.asks()
    assert not answer["can_arm_and_run"]
    assert answer["events_0_id"] == Check.SILENT.event_id


def test_a_change_is_told_at_once_as_another_answer_to_the_last_check(px4):
    px4.registered()
    assert px4.mode.judge(Readiness(px4.now_s)) == []  # PX4 has not asked yet
    px4.asks(41)
    assert px4.mode.judge(Readiness(px4.now_s)) == []
    (answer,) = px4.mode.judge(Readiness(px4.now_s, (Check.BUSY,)))
    assert (answer.topic, answer.values["request_id"]) == ("arming_check_reply", 41)
    assert not answer.values["can_arm_and_run"]
    (answer,) = px4.mode.judge(Readiness(px4.now_s))
    assert answer.values["can_arm_and_run"]


def test_before_anything_was_judged_it_is_not_ready(px4):
    assert not px4.registered().asks()["can_arm_and_run"]


def test_without_a_registration_no_check_is_answered(px4):
    assert px4.says("arming_check_request", request_id=1, valid_registrations_mask=1) == []


def test_a_mode_that_px4_no_longer_lists_is_registered_again_on_the_ground(px4):
    px4.registered()
    px4.asks(mask=0)
    px4.now_s += LOST_AFTER_S + 0.1
    (gone,) = px4.says("arming_check_request", request_id=1, valid_registrations_mask=0)
    assert gone.topic == "unregister_ext_component"
    assert gone.values["mode_id"] == PURSUIT
    assert [one.topic for one in px4.mode.due(px4.now_s)] == ["register_ext_component_request"]


def test_a_mode_that_was_unlisted_for_a_moment_stays(px4):
    px4.registered()
    px4.asks(mask=0)
    px4.now_s += LOST_AFTER_S - 0.1
    px4.asks()
    px4.now_s += 1.0
    px4.asks(mask=0)
    assert px4.mode.registration is not None


def test_in_flight_a_mode_that_is_not_listed_is_still_answered(px4):
    px4.registered(arming_state=2, nav_state=PURSUIT)
    px4.asks(mask=0)
    px4.now_s += LOST_AFTER_S + 1.0
    px4.asks(mask=0)
    assert px4.mode.registration is not None


def test_a_restarted_autopilot_is_asked_again(px4):
    px4.registered()
    px4.stamp_us = 2_000_000
    px4.status()
    assert px4.mode.registration is None
    (request,) = px4.mode.due(px4.now_s)
    assert request.values["register_mode"]


def test_commands_are_a_stations_until_the_executor_is_in_charge(px4):
    px4.registered()
    command = px4.mode.command(400, 1.0)
    assert command.topic == "vehicle_command"
    assert command.values["source_component"] < 1000
    assert (command.values["target_system"], command.values["param1"]) == (3, 1.0)
    px4.status(nav_state=PURSUIT, executor_in_charge=1)
    command = px4.mode.command(400, 1.0)
    assert command.topic == "vehicle_command_mode_executor"
    assert command.values["source_component"] == 1001


def test_after_a_pilots_switch_the_executor_is_not_in_charge(px4):
    px4.registered(nav_state=PURSUIT, executor_in_charge=1)
    px4.status(nav_state=2, executor_in_charge=0)
    assert not px4.mode.in_charge
    assert not px4.mode.entered


def test_entering_asks_for_the_number_that_px4_gave(px4):
    assert px4.mode.enter() is None
    px4.registered()
    command = px4.mode.enter()
    assert (command.values["command"], command.values["param1"]) == (SET_NAV_STATE, PURSUIT)


def test_a_take_off_of_the_executor_ends_in_hold(px4):
    px4.registered(nav_state=TAKEOFF, executor_in_charge=1, arming_state=2)
    (hold,) = px4.says("mode_completed", nav_state=TAKEOFF)
    assert hold.topic == "vehicle_command_mode_executor"
    assert (hold.values["command"], hold.values["param1"]) == (SET_NAV_STATE, HOLD)


@pytest.mark.parametrize(
    "status",
    [{"nav_state": TAKEOFF, "executor_in_charge": 0}, {"nav_state": 2, "executor_in_charge": 1}],
)
def test_the_end_of_a_take_off_that_is_not_ours_changes_nothing(px4, status):
    px4.registered(arming_state=2, **status)
    assert px4.says("mode_completed", nav_state=TAKEOFF) == []


def test_the_mode_says_that_it_is_done_only_while_it_flies(px4):
    px4.registered()
    assert px4.mode.completed() == []
    px4.status(nav_state=PURSUIT)
    (done,) = px4.mode.completed()
    assert (done.topic, done.values["nav_state"]) == ("mode_completed", PURSUIT)


def test_px4s_clock_is_asked_for_on_the_ground_only(px4):
    px4.registered()
    (question,) = px4.mode.due(px4.now_s + ASK_EVERY_S)
    assert "register_mode" not in question.values  # refused by PX4, and answered with its time
    kind = TYPES["RegisterExtComponentReply"]
    asked_s = px4.now_s + ASK_EVERY_S
    reply = kind.decode(
        kind.encode(
            timestamp=7_000_000,
            request_id=question.values["request_id"],
            name=question.values["name"],
        )
    )
    answer = px4.mode.clock_answer(reply, asked_s + 0.01)
    assert answer == (asked_s + 0.01, 7_000_000_000, round(asked_s * 1e9))
    px4.status(arming_state=2)
    assert px4.mode.due(px4.now_s + 10.0) == []


def test_an_answer_to_anothers_question_tells_no_time(px4):
    px4.registered()
    kind = TYPES["RegisterExtComponentReply"]
    reply = kind.decode(kind.encode(timestamp=7, request_id=555, name=name_bytes("Pursuit")))
    assert px4.mode.clock_answer(reply, 1.0) is None


def test_leaving_names_all_numbers(px4):
    assert px4.mode.farewell() == []
    (gone,) = px4.registered().mode.farewell()
    assert gone == Outgoing(
        "unregister_ext_component",
        {
            "name": name_bytes("Pursuit"),
            "arming_check_id": 2,
            "mode_id": PURSUIT,
            "mode_executor_id": 1,
        },
    )
