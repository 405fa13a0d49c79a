"""The tables of modes: complete, closed, and used by the code."""

import pytest

from sitl_mock.ardupilot.copter import COPTER
from sitl_mock.ardupilot.modes import COPTER_MODES, ROVER_MODES
from sitl_mock.ardupilot.rover import ROVER
from sitl_mock.flavours import NAMES, flavour_named
from sitl_mock.px4.modes import AFTER, BY_NAME, MODES
from sitl_mock.px4.safety import MODE_OF

TABLES = {name: flavour_named(name).modes for name in NAMES}


@pytest.mark.parametrize("name", NAMES)
def test_every_transition_is_between_modes_of_the_table(name):
    table = TABLES[name]
    known = set(table.by_name()) | {"any", "disarmed"}
    for row in table.transitions:
        assert row.mode in known
        assert row.after in known


@pytest.mark.parametrize("name", NAMES)
def test_names_are_unique_and_numbers_too_but_for_px4s_descend(name):
    modes = TABLES[name].modes
    assert len({mode.name for mode in modes}) == len(modes)
    shared = {mode.name for mode in modes if [m.number for m in modes].count(mode.number) > 1}
    assert shared == ({"LAND", "DESCEND"} if name == "px4" else set())


@pytest.mark.parametrize("name", NAMES)
def test_no_state_and_event_has_two_outcomes(name):
    pairs = [(row.mode, row.event) for row in TABLES[name].transitions]
    assert len(set(pairs)) == len(pairs)


@pytest.mark.parametrize("name", NAMES)
def test_the_drawn_table_names_every_mode_and_transition(name):
    drawn = "\n".join(TABLES[name].markdown())
    for mode in TABLES[name].modes:
        assert f"| {mode.name} |" in drawn
    for row in TABLES[name].transitions:
        assert f"| {row.mode} | {row.event} | {row.after} |" in drawn


def test_what_cannot_run_steps_down_to_a_mode_without_needs():
    for first in BY_NAME:
        mode = first
        seen = []
        while BY_NAME[mode].needs:
            assert mode not in seen
            seen.append(mode)
            event = "stream lost, COM_OBL_RC_ACT = 0" if mode == "OFFBOARD" else "cannot run"
            mode = AFTER[mode, event]
        assert mode == "TERMINATION"


def test_every_value_of_com_obl_rc_act_has_its_row():
    assert {f"stream lost, COM_OBL_RC_ACT = {value}" for value in range(8)} == {
        row.event for row in MODES.transitions if row.mode == "OFFBOARD"
    }


def test_failsafe_actions_lead_to_modes_of_the_table():
    assert set(MODE_OF.values()) <= set(BY_NAME)


@pytest.mark.parametrize(
    ("table", "rig"), [(COPTER_MODES, COPTER), (ROVER_MODES, ROVER)], ids=["copter", "rover"]
)
def test_every_ardupilot_mode_flies_something(table, rig):
    assert set(rig.flights) == set(table.by_name())
    assert {rig.first_mode, rig.hold_mode} <= set(table.by_name())


@pytest.mark.parametrize(
    "mode", [mode for mode in BY_NAME if mode not in {"DESCEND", "ORBIT", "TERMINATION"}]
)
def test_disarmed_px4_takes_every_mode_as_its_intention(fly, mode):
    flight = fly("px4").run(1.0)
    number = BY_NAME[mode].number
    assert flight.command(176, 1, number >> 16 & 0xFF, number >> 24) == [0, 0]
    assert flight.mode == mode
    flight.run(1.1)
    assert flight.last("HEARTBEAT").custom_mode == number


@pytest.mark.parametrize(
    "mode", ["MANUAL", "ALTCTL", "POSCTL", "ACRO", "STABILIZED", "MISSION", "OFFBOARD"]
)
def test_armed_px4_refuses_what_cannot_run(fly, mode):
    flight = fly.airborne("px4", texts=True, height=5.0)
    number = BY_NAME[mode].number
    assert flight.command(176, 1, number >> 16 & 0xFF, number >> 24) == [0, 1]
    assert flight.mode == "HOLD"
    assert not any(text.startswith("Switching to") for text in flight.texts())


def test_px4_says_which_mode_a_command_of_its_own_cannot_enter(fly):
    flight = fly.airborne("px4", texts=True, height=5.0)
    flight.vehicle.autopilot.state.home_m = None
    assert flight.command(20) == [1]
    flight.run(0.1)
    assert "Switching to Return is currently not available" in flight.texts()


@pytest.mark.parametrize("mode", COPTER_MODES.by_name())
def test_armed_arducopter_takes_every_mode_that_needs_no_mission(fly, mode):
    flight = fly.airborne("arducopter", height=10.0)
    refused = mode in {"AUTO", "THROW"}
    expected = 4 if refused else 0
    assert flight.command(176, 1, COPTER_MODES.by_name()[mode].number) == [expected]
    flight.run(1.1)
    if not refused:
        assert flight.mode == mode
        assert flight.last("HEARTBEAT").custom_mode == COPTER_MODES.by_name()[mode].number
