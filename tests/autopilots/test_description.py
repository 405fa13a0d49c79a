"""Descriptions of autopilots: complete, consistent, and one module is enough to add another autopilot."""

import json
import re
from dataclasses import replace

import pytest

from guidance.autopilots import ARDUCOPTER, AUTOPILOTS, PX4, Verdict, autopilot_named, register
from guidance.autopilots.description import Version
from guidance.autopilots.rules import Judgement, Rule
from guidance.control import Limits, Speeds
from guidance.errors import ConfigError
from guidance.game import StandOff
from guidance.links.opening import Found
from guidance.preflight import Facts, changes, parameter_names, rows
from guidance.session.open.discovery import identify, vehicle_file
from guidance.session.open.mock import MockOptions
from guidance.session.plan import plan_of
from guidance.session.recorded_flight import fly_recorded
from guidance.session.vehicle_file import Config, load_vehicle
from guidance.sim.scenario import Scenario
from guidance.sim.scenario_file import load_scenario
from tests.preflight.wants import wants_of

WANTS = wants_of(limit_speed_m_s=6.6, fence_radius_m=100.0)


def test_every_handling_fits_its_own_limits():
    for handling in (autopilot.handling for autopilot in AUTOPILOTS.values()):
        servo = handling.servo
        approach = handling.approach
        dynamics = handling.dynamics
        assert servo.acceleration_m_s2 <= dynamics.acceleration_m_s2
        assert servo.vertical_acceleration_m_s2 <= dynamics.vertical_acceleration_m_s2
        assert servo.jerk_m_s3 <= dynamics.jerk_m_s3
        assert approach.braking_m_s2 <= servo.acceleration_m_s2
        assert approach.vertical_braking_m_s2 <= servo.vertical_acceleration_m_s2
        Limits().envelope(Speeds(9.0, 3.0, 1.5), dynamics, StandOff(3.0, 5.0))


def test_an_autopilot_that_is_not_known_is_refused_by_name():
    with pytest.raises(
        ConfigError, match=re.escape("autopilot = 'rover': allowed are px4, arducopter")
    ):
        autopilot_named("rover")


@pytest.mark.parametrize("autopilot", AUTOPILOTS.values(), ids=AUTOPILOTS)
def test_every_mode_of_ours_is_told_from_its_number_and_asked_for_by_it(autopilot):
    assert autopilot.arming_mode in autopilot.custom_modes
    for mode, number in autopilot.custom_modes.items():
        assert autopilot.mode_of(number) is mode
        main, sub = map(int, autopilot.set_mode(mode).params[1:3])
        assert number == (main << 16 | sub << 24 if autopilot is PX4 else main)


def _slow_enough(value, wants, _):
    asked_m_s = wants.game_speeds.speed_m_s
    return Judgement(
        Verdict.PASS if value >= asked_m_s else Verdict.REFUSE, "the game's speed", asked_m_s
    )


@pytest.fixture
def third():
    """An autopilot that nobody makes: ArduCopter's modes, vehicle of PX4, one parameter."""
    return replace(
        ARDUCOPTER,
        name="paper",
        autopilot_id=99,
        handling=PX4.handling,
        versions=(Version((1, 0), (Rule("speed", "TOP_SPEED", _slow_enough, "{:g} m/s".format),)),),
        uploaded_fence_counts=lambda _: False,
        tells_setpoint_always=True,
    )


def test_a_third_autopilot_is_judged_by_its_own_description_alone(third):
    assert parameter_names(third.version_of(None)) == ("TOP_SPEED",)
    facts = Facts(parameters={"TOP_SPEED": 4.0})
    by_name = {row.name: row for row in rows(facts, third, WANTS)}
    assert by_name["TOP_SPEED"].verdict is Verdict.REFUSE
    assert not {"COM_OF_LOSS_T", "GUID_TIMEOUT"} & set(by_name)
    (change,) = changes(facts, third, WANTS)
    assert (change.name, change.now, change.then) == ("TOP_SPEED", "4 m/s", "6 m/s")


@pytest.fixture
def vtol():
    """A third autopilot, registered from outside the package: PX4's protocol with a name and parameters of its own."""
    described = replace(PX4, name="px4_vtol", vehicle_types=frozenset({19, 22}))
    register(described)
    yield described
    del AUTOPILOTS["px4_vtol"]


def test_a_registered_autopilot_is_known_everywhere(vtol, tmp_path):
    assert autopilot_named("px4_vtol") is vtol
    text = vehicle_file("px4_vtol", name="uav1", url="udpin://127.0.0.1:14540")
    path = tmp_path / "vtol.toml"
    path.write_text(text)
    assert plan_of(load_vehicle(path)).flight.autopilot is vtol
    assert "px4_vtol" in json.dumps(Config.model_json_schema())
    assert "px4_vtol" in json.dumps(Scenario.model_json_schema())
    assert identify(Found(1, 1, 12, 22), "udpin://", None) is vtol
    assert identify(Found(1, 1, 12, 2), "udpin://", None) is PX4
    with pytest.raises(ConfigError, match="is px4, not --autopilot px4_vtol"):
        identify(Found(1, 1, 12, 2), "udpin://", "px4_vtol")


@pytest.fixture
def copter():
    """A third autopilot that flies what the mock is."""
    described = replace(PX4, name="px4_copter")
    register(described)
    yield described
    del AUTOPILOTS["px4_copter"]


@pytest.mark.flight
def test_a_registered_autopilot_flies_the_mock(copter, tmp_path):
    _, scenario = load_scenario("hover_chase")
    pursuer = scenario.pursuer.model_copy(update={"autopilot": copter.name})
    flown = scenario.model_copy(update={"pursuer": pursuer})
    (result,) = fly_recorded(flown, tmp_path, MockOptions(fast=True)).vehicles.values()
    assert result.captured


def test_a_second_autopilot_of_the_same_name_is_refused(vtol):
    with pytest.raises(ConfigError, match="'px4_vtol': another one has this name"):
        register(replace(vtol, autopilot_id=99))
