"""The descriptions of the autopilots: each whole, and another one is one more description."""

import re
from dataclasses import replace

import pytest

from guidance.autopilots import ARDUCOPTER, AUTOPILOTS, PX4, Verdict, Wants, autopilot_named
from guidance.autopilots.rules import Judgement, Rule
from guidance.control import Envelope
from guidance.errors import ConfigError
from guidance.preflight import Facts, changes, parameter_names, rows

WANTS = Wants(
    speed_m_s=6.0,
    limit_speed_m_s=6.6,
    climb_m_s=1.5,
    descent_m_s=1.0,
    fence_required=True,
    fence_radius_m=100.0,
    ceiling_m=60.0,
)


def test_every_autopilot_has_a_handling_that_its_own_limits_allow():
    for one in (autopilot.handling for autopilot in AUTOPILOTS.values()):
        servo, approach = one.following.servo, one.following.approach
        assert servo.acceleration_m_s2 <= one.acceleration_m_s2
        assert servo.vertical_acceleration_m_s2 <= one.vertical_acceleration_m_s2
        assert servo.jerk_m_s3 <= one.jerk_m_s3
        assert approach.braking_m_s2 <= servo.acceleration_m_s2
        assert approach.vertical_braking_m_s2 <= servo.vertical_acceleration_m_s2
        Envelope(
            floor_m=3.0,
            ceiling_m=100.0,
            speed_m_s=9.0,
            climb_m_s=3.0,
            descent_m_s=1.5,
            acceleration_m_s2=one.acceleration_m_s2,
            vertical_acceleration_m_s2=one.vertical_acceleration_m_s2,
            jerk_m_s3=one.jerk_m_s3,
            yaw_rate_rad_s=0.8,
            braking_m_s2=one.braking_m_s2,
            vertical_braking_m_s2=one.vertical_braking_m_s2,
            reaction_s=one.reaction_s,
        )


def test_an_autopilot_that_is_not_known_is_refused_by_name():
    with pytest.raises(ConfigError, match=re.escape("autopilot = 'rover': allowed are px4, arducopter")):
        autopilot_named("rover")


@pytest.mark.parametrize("autopilot", AUTOPILOTS.values(), ids=AUTOPILOTS)
def test_every_mode_of_ours_is_told_from_its_number_and_asked_for_by_it(autopilot):
    assert set(autopilot.custom_modes) == set(autopilot.mode_parameters)
    assert autopilot.arming_mode in autopilot.custom_modes
    for mode, number in autopilot.custom_modes.items():
        assert autopilot.mode_of(number) is mode
        assert autopilot.set_mode(mode).params[1:3] == tuple(map(float, autopilot.mode_parameters[mode]))


def _slow_enough(value, wants, _):
    return Judgement(Verdict.PASS if value >= wants.speed_m_s else Verdict.REFUSE, "the game's speed", wants.speed_m_s)


@pytest.fixture
def third():
    """An autopilot that nobody makes: ArduCopter's modes, vehicle of PX4, one parameter."""
    return replace(
        ARDUCOPTER,
        name="paper",
        autopilot_id=99,
        handling=PX4.handling,
        rules=(Rule("TOP_SPEED", _slow_enough, "{:g} m/s".format),),
        uploaded_fence_counts=lambda _: False,
        tells_setpoint_always=True,
    )


def test_a_third_autopilot_is_judged_by_its_own_description_alone(third):
    assert parameter_names(third) == ("TOP_SPEED",)
    facts = Facts(parameters={"TOP_SPEED": 4.0})
    by_name = {row.name: row for row in rows(facts, third, WANTS)}
    assert by_name["TOP_SPEED"].verdict is Verdict.REFUSE
    assert not {"COM_OF_LOSS_T", "GUID_TIMEOUT"} & set(by_name)
    (change,) = changes(facts, third, WANTS)
    assert (change.name, change.now, change.then) == ("TOP_SPEED", "4 m/s", "6 m/s")


def test_a_third_autopilot_is_found_by_its_name_once_it_is_listed(third, monkeypatch):
    monkeypatch.setattr("guidance.autopilots.AUTOPILOTS", {**AUTOPILOTS, third.name: third})
    assert autopilot_named("paper") is third
