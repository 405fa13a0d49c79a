"""The autopilot's fence and loss parameters are read again before the game begins, because they may have changed."""

import logging

import pytest
from pymavlink.dialects.v20 import common as mavlink

from guidance.autopilots import AUTOPILOTS
from guidance.flight import Authority, State
from guidance.preflight import parameter_names
from guidance.session.orders.mailbox import READ_WITHIN_S

SET_UP = {"GUID_TIMEOUT": 1.0, "FENCE_ENABLE": 1}
CHANGED = {
    "px4": [
        ("COM_OF_LOSS_T", 5.0),
        ("COM_OBL_RC_ACT", -1.0),
        ("GF_ACTION", 0.0),
        ("GF_MAX_HOR_DIST", 40.0),
        ("NAV_TRAFF_AVOID", 2.0),
    ],
    "arducopter": [
        ("GUID_TIMEOUT", 5.0),
        ("FENCE_ENABLE", 0.0),
        ("FENCE_ACTION", 0.0),
        ("FENCE_RADIUS", 40.0),
        ("AVD_ENABLE", 1.0),
    ],
}


def standing_by(base, autopilot):
    vehicle = {"autopilot": autopilot, "announce": True}
    given = {"parameters": SET_UP} if autopilot == "arducopter" else {}
    return base.standing_by(vehicle=vehicle, **given)


def change(one, name, value):
    """Set a parameter without an announcement, because an announcement can be lost."""
    one.vehicle.autopilot.parameters.set(name, value)


def read_since(one, since_s):
    return {
        sent.message.param_id
        for sent in one.sent
        if sent.now_s >= since_s and sent.name == "PARAM_REQUEST_READ"
    }


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_a_failing_check_refuses_by_name_until_it_passes_without_a_long_wait(base, autopilot):
    """Catches a parameter that changed after the start and is not read again."""
    one = standing_by(base, autopilot)
    for name, value in CHANGED[autopilot]:
        before = one.vehicle.autopilot.parameters[name]
        change(one, name, value)
        answer = one.order("engage")
        assert not answer["accepted"]
        assert answer["reason"].startswith(f"not ready: {name} is ")
        assert f"param set {name} " in answer["reason"]
        assert one.state is State.STANDING_BY
        assert one.order("status")["preflight_refused"] == [name]
        change(one, name, before)
    one.run(0.5)
    asked_s = one.now_s
    assert one.order("engage")["accepted"]
    assert one.now_s - asked_s < 0.1
    assert one.order("status")["preflight_refused"] == []
    assert read_since(one, asked_s) == set(
        parameter_names(AUTOPILOTS[autopilot].versions[0], announces=True, only_needed=True)
    )
    assert {name for name, _ in CHANGED[autopilot]} < read_since(one, asked_s)
    one.until(State.ENGAGED)
    flown_s = one.now_s
    one.run(1.0)
    assert read_since(one, flown_s + 0.001) == set()


def test_who_asks_again_and_again_is_refused_in_a_line_for_each_reason(base):
    """Catches a log that a repeated order fills."""
    one = base.standing_by()

    def refused():
        said = [
            fields["reason"]
            for _, message, fields in one.log.lines
            if message == "order" and "reason" in fields
        ]
        one.log.lines.clear()
        return [reason.split()[2] for reason in said]

    refused()
    for value in (5.0, 5.0, 6.0):  # another number is no other reason
        change(one, "COM_OF_LOSS_T", value)
        assert not one.order("engage", Authority.MISSION)["accepted"]
    assert refused() == ["COM_OF_LOSS_T"]
    one.mailbox.ask("engage", "a person")
    one.run(2.0)
    assert refused() == ["COM_OF_LOSS_T"]
    change(one, "COM_OF_LOSS_T", 0.5)
    change(one, "GF_ACTION", 0.0)
    for _ in range(3):
        one.order("engage", Authority.MISSION)
    assert refused() == ["GF_ACTION"]


def unanswered(one, name):
    """From now on one parameter is not answered."""
    step = one.vehicle.step

    def heard(frame):
        message = mavlink.MAVLink(None).decode(bytearray(frame))
        return message.get_type() != "PARAM_REQUEST_READ" or message.param_id != name

    one.vehicle.step = lambda now_s, frames=(): step(
        now_s, [frame for frame in frames if heard(frame)]
    )


def test_an_unanswered_parameter_refuses_in_time_and_delays_no_other_order(base):
    """Catches a hold that waits for the parameters of an engagement."""
    one = base.standing_by()
    unanswered(one, "GF_ACTION")
    asked_s = one.now_s
    answer = one.order("engage")
    assert answer["reason"].startswith("not ready: GF_ACTION is not answered")
    assert READ_WITHIN_S <= one.now_s - asked_s < READ_WITHIN_S + 0.1
    assert one.state is State.STANDING_BY
    assert one.setpoints_since(asked_s) == []

    engage = one.mailbox.ask("engage")
    one.run(0.2)
    hold = one.mailbox.ask("hold")
    one.cycle()
    assert hold.result(0.0)["accepted"]
    assert engage.result(0.0)["reason"] == "hold was ordered meanwhile"
    one.run(2.0)
    assert one.state is State.HOLDING

    engage = one.mailbox.ask("engage")
    one.run(0.2)
    by_pilot(one, "POSCTL")
    one.run(2.0)
    assert "a pilot or the autopilot chose that mode" in engage.result(0.0)["reason"]
    assert one.state is State.YIELDED
    assert one.setpoints_since(asked_s) == []


def by_pilot(one, mode):
    one.vehicle.inject("rc", True)
    one.run(0.5)
    one.vehicle.inject("pilot_mode", mode)


def test_a_pilots_switch_engages_only_what_still_passes(base):
    """Catches a switch that passes by the checks before a game."""
    one = base.standing_by(flight={"engage_on": "pilot_mode"}).run(1.0)
    by_pilot(one, "POSCTL")
    one.run(1.2)
    change(one, "GF_ACTION", 0.0)
    by_pilot(one, "OFFBOARD")
    one.run(2.0)
    assert one.state is State.STANDING_BY
    (refused,) = [
        fields
        for level, message, fields in one.log.lines
        if level >= logging.WARNING and message == "not engaged"
    ]
    assert "GF_ACTION is 0 (none)" in refused["reason"]
    change(one, "GF_ACTION", 2.0)  # fence and loss parameters are read at each switch
    by_pilot(one, "POSCTL")
    one.run(1.2)
    by_pilot(one, "OFFBOARD")
    one.until(State.ENGAGED, limit_s=3.0)
