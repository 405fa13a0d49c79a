"""Proposed parameter changes that make preflight pass: as few as possible, and checked again until none remains."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from guidance.autopilots import AUTOPILOTS, PX4, Verdict, autopilot_named
from guidance.preflight import Facts, changes, parameter_names, rows
from guidance.preflight.fence import Uploaded
from sitl_mock import MockVehicle
from tests.preflight.wants import wants_of

WANTS = wants_of(limit_speed_m_s=6.6)


def defaults(autopilot):
    parameters = MockVehicle(autopilot).autopilot.parameters
    return {
        name: float(parameters[name])
        for name in parameter_names(autopilot_named(autopilot).versions[0])
        if name in parameters
    }


def after(parameters, wanted):
    return parameters | {one.request.name: one.request.value for one in wanted}


def verdicts(autopilot, parameters):
    judged = rows(Facts(parameters=parameters), autopilot_named(autopilot), WANTS)
    return {row.name: row.verdict for row in judged if row.name in parameters}


def test_px4s_defaults_need_two_parameters_and_the_table_says_why():
    facts = Facts(
        parameters=defaults("px4"),
        parameter_types={"GF_MAX_HOR_DIST": 9},
        uploaded=Uploaded(areas=()),
    )
    horizontal, vertical = changes(facts, PX4, WANTS)
    assert (horizontal.name, horizontal.now, horizontal.then) == ("GF_MAX_HOR_DIST", "0 m", "205 m")
    assert (
        horizontal.why == "at least 200 m, ours; 0 disables it, and no inclusion fence is uploaded"
    )
    assert horizontal.verdict is Verdict.REFUSE
    assert (vertical.request.name, vertical.request.value, vertical.request.param_type) == (
        "GF_MAX_VER_DIST",
        65.0,
        9,
    )


@pytest.mark.parametrize("autopilot", sorted(AUTOPILOTS))
@pytest.mark.parametrize("advised", [False, True])
def test_with_them_nothing_is_refused_and_where_advice_is_taken_nothing_is_warned_of(
    autopilot, advised
):
    parameters = defaults(autopilot)
    wanted = changes(
        Facts(parameters=parameters), autopilot_named(autopilot), WANTS, advised=advised
    )
    left = set(verdicts(autopilot, after(parameters, wanted)).values())
    assert left == {Verdict.PASS} if advised else Verdict.REFUSE not in left
    assert (
        changes(
            Facts(parameters=after(parameters, wanted)),
            autopilot_named(autopilot),
            WANTS,
            advised=advised,
        )
        == ()
    )


def test_what_one_change_makes_wrong_is_changed_too():
    # A fence of 30 m becomes one of 65 m, and a return above it one below our ceiling, not below the old fence.
    parameters = defaults("px4") | {"RTL_RETURN_ALT": 70.0, "GF_MAX_VER_DIST": 30.0}
    wanted = {
        change.name: change
        for change in changes(Facts(parameters=parameters), PX4, WANTS, advised=True)
    }
    assert wanted["RTL_RETURN_ALT"].then == "60 m"
    assert wanted["GF_MAX_VER_DIST"].then == "65 m"
    assert "at most limits.ceiling_m = 60 m" in wanted["RTL_RETURN_ALT"].why


def test_what_was_not_read_is_not_set():
    assert changes(Facts(), PX4, WANTS) == ()


@given(st.data(), st.sampled_from(sorted(AUTOPILOTS)))
def test_any_values_are_mended_until_nothing_that_has_a_value_to_set_is_refused(data, autopilot):
    parameters = {
        name: data.draw(st.sampled_from([value, 0.0, -1.0, 1.0, 7.0, 250.0, 1e4]))
        for name, value in defaults(autopilot).items()
    }
    wanted = changes(Facts(parameters=parameters), autopilot_named(autopilot), WANTS, advised=True)
    judged = rows(Facts(parameters=after(parameters, wanted)), autopilot_named(autopilot), WANTS)
    refused = [row for row in judged if row.name in parameters and row.verdict is Verdict.REFUSE]
    assert refused == []
