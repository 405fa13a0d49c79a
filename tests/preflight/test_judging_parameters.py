import pytest
from hypothesis import given
from hypothesis import strategies as st

from guidance.autopilots import Verdict, autopilot_named
from guidance.preflight import Facts, parameter_names, refusals, rows
from sitl_mock import MockVehicle
from tests.preflight.wants import wants_of

WANTS = wants_of()
SAFE = {
    "px4": {
        "COM_OF_LOSS_T": 1.0, "COM_OBL_RC_ACT": 5, "COM_RCL_EXCEPT": 0, "COM_RC_OVERRIDE": 3, "NAV_RCL_ACT": 2,
        "COM_LOW_BAT_ACT": 3, "GF_ACTION": 2, "GF_MAX_HOR_DIST": 205.0, "GF_MAX_VER_DIST": 65.0,
        "RTL_RETURN_ALT": 50.0, "MPC_XY_VEL_MAX": 12.0, "MPC_Z_VEL_MAX_UP": 3.0, "MPC_Z_VEL_MAX_DN": 1.5,
    },
    "arducopter": {
        "GUID_TIMEOUT": 1.0, "GUID_OPTIONS": 0, "FENCE_ENABLE": 1, "FENCE_ACTION": 1, "FENCE_TYPE": 7,
        "FENCE_RADIUS": 300.0, "FENCE_ALT_MAX": 100.0, "FENCE_ALT_MIN": -10.0, "BATT_FS_LOW_ACT": 2,
        "BATT_FS_CRT_ACT": 1, "RTL_ALT": 1500, "FS_THR_ENABLE": 1, "FS_EKF_ACTION": 1,
        "WPNAV_SPEED": 1000.0, "WPNAV_SPEED_UP": 250.0, "WPNAV_SPEED_DN": 150.0, "ANGLE_MAX": 3000,
    },
}  # fmt: skip


def row_of(autopilot, name, value, wants=WANTS, **others):
    parameters = {**SAFE[autopilot], **others}
    if value is None:
        del parameters[name]
    else:
        parameters[name] = value
    judged = rows(Facts(parameters=parameters), autopilot_named(autopilot), wants)
    return next(row for row in judged if row.name == name)


@pytest.mark.parametrize("autopilot", ["px4", "arducopter"])
def test_a_safe_set_passes_in_every_row(autopilot):
    judged = rows(Facts(parameters=SAFE[autopilot]), autopilot_named(autopilot), WANTS)
    by_name = {row.name: row.verdict for row in judged}
    assert {by_name[name] for name in parameter_names(autopilot_named(autopilot).versions[0])} == {
        Verdict.PASS
    }
    assert all(row.advice == "" for row in judged if row.name in SAFE[autopilot])


@pytest.mark.parametrize(
    ("autopilot", "name", "value", "verdict", "words"),
    [
        ("px4", "COM_OBL_RC_ACT", -1, "refuse", "nothing would be done when setpoints stop"),
        ("px4", "COM_OBL_RC_ACT", 0, "warn", "without one PX4 returns"),
        ("px4", "COM_OBL_RC_ACT", 1, "refuse", "drifts on"),
        ("px4", "COM_OBL_RC_ACT", 2, "refuse", "flies on"),
        ("px4", "COM_OBL_RC_ACT", 3, "pass", ""),
        ("px4", "COM_OBL_RC_ACT", 4, "pass", ""),
        ("px4", "COM_OBL_RC_ACT", 6, "refuse", "fall"),
        ("px4", "COM_OBL_RC_ACT", 7, "refuse", "param set COM_OBL_RC_ACT 5"),
        ("px4", "COM_OF_LOSS_T", 0.1, "refuse", "param set COM_OF_LOSS_T 1"),
        ("px4", "COM_OF_LOSS_T", 0.2, "pass", ""),
        ("px4", "COM_OF_LOSS_T", 1.5, "pass", ""),
        ("px4", "COM_OF_LOSS_T", 5.0, "refuse", "param set COM_OF_LOSS_T 1"),
        ("px4", "COM_RCL_EXCEPT", 3, "pass", ""),
        ("px4", "COM_RCL_EXCEPT", 4, "warn", "radio loss is ignored in OFFBOARD"),
        ("px4", "COM_RC_OVERRIDE", 1, "warn", "param set COM_RC_OVERRIDE 3"),
        ("px4", "NAV_RCL_ACT", 0, "warn", "param set NAV_RCL_ACT 2"),
        ("px4", "COM_LOW_BAT_ACT", 0, "warn", "param set COM_LOW_BAT_ACT 3"),
        ("px4", "GF_ACTION", 0, "refuse", "would not act"),
        ("px4", "GF_ACTION", 1, "refuse", "param set GF_ACTION 2"),
        ("px4", "GF_ACTION", 4, "refuse", "fall"),
        ("px4", "GF_ACTION", 5, "pass", ""),
        ("px4", "GF_MAX_HOR_DIST", 0.0, "refuse", "param set GF_MAX_HOR_DIST 205"),
        ("px4", "GF_MAX_HOR_DIST", 199.0, "refuse", "inside ours"),
        ("px4", "GF_MAX_VER_DIST", 0.0, "refuse", "param set GF_MAX_VER_DIST 65"),
        ("px4", "RTL_RETURN_ALT", 60.0, "pass", ""),
        ("px4", "RTL_RETURN_ALT", 61.0, "refuse", "above our ceiling"),
        ("px4", "RTL_RETURN_ALT", 65.0, "refuse", "param set RTL_RETURN_ALT 60"),
        ("px4", "MPC_XY_VEL_MAX", 5.9, "refuse", "param set MPC_XY_VEL_MAX 9"),
        ("px4", "MPC_XY_VEL_MAX", 7.0, "warn", "param set MPC_XY_VEL_MAX 9"),
        ("px4", "MPC_Z_VEL_MAX_UP", 1.9, "refuse", "param set MPC_Z_VEL_MAX_UP 2"),
        ("px4", "MPC_Z_VEL_MAX_DN", 1.0, "refuse", "param set MPC_Z_VEL_MAX_DN 1.5"),
        ("arducopter", "GUID_TIMEOUT", 3.0, "refuse", "param set GUID_TIMEOUT 1"),
        ("arducopter", "GUID_TIMEOUT", 0.1, "refuse", "param set GUID_TIMEOUT 1"),
        ("arducopter", "GUID_OPTIONS", 16, "refuse", "param set GUID_OPTIONS 0"),
        ("arducopter", "GUID_OPTIONS", 1, "pass", ""),
        ("arducopter", "FENCE_ENABLE", 0, "refuse", "param set FENCE_ENABLE 1"),
        ("arducopter", "FENCE_ACTION", 0, "refuse", "only report"),
        ("arducopter", "FENCE_TYPE", 4, "refuse", "param set FENCE_TYPE 7"),
        ("arducopter", "FENCE_RADIUS", 150.0, "refuse", "param set FENCE_RADIUS 205"),
        ("arducopter", "FENCE_ALT_MAX", 50.0, "refuse", "param set FENCE_ALT_MAX 65"),
        ("arducopter", "RTL_ALT", 6000, "pass", ""),
        ("arducopter", "RTL_ALT", 15000, "refuse", "above our ceiling"),
        ("arducopter", "BATT_FS_LOW_ACT", 0, "warn", "only our own limit returns"),
        ("arducopter", "BATT_FS_LOW_ACT", 2, "pass", ""),
        ("arducopter", "BATT_FS_LOW_ACT", 5, "refuse", "fall"),
        ("arducopter", "BATT_FS_LOW_ACT", 8, "warn", "param set BATT_FS_LOW_ACT 2"),
        ("arducopter", "BATT_FS_LOW_ACT", None, "warn", "unknown"),
        ("arducopter", "BATT_FS_CRT_ACT", 0, "pass", ""),
        ("arducopter", "BATT_FS_CRT_ACT", 5, "refuse", "fall"),
        ("arducopter", "BATT_FS_CRT_ACT", None, "warn", "unknown"),
        ("arducopter", "FS_THR_ENABLE", 0, "warn", "radio loss"),
        ("arducopter", "FS_EKF_ACTION", 0, "warn", "estimator fails"),
        ("arducopter", "ANGLE_MAX", 1000, "warn", "too flat"),
        ("arducopter", "WPNAV_SPEED", 100.0, "pass", ""),
    ],
)  # fmt: skip
def test_every_rule(autopilot, name, value, verdict, words):
    row = row_of(autopilot, name, value)
    assert str(row.verdict) == verdict
    assert words in row.advice


@pytest.mark.parametrize(
    ("kinds", "lowest_m", "verdict"),
    [
        (15, WANTS.limits.floor_m, "pass"),
        (15, WANTS.limits.floor_m + 0.1, "refuse"),
        (7, WANTS.limits.floor_m + 0.1, "pass"),
    ],
)
def test_a_floor_of_arducopters_fence_that_is_in_use_lies_below_ours(kinds, lowest_m, verdict):
    row = row_of("arducopter", "FENCE_ALT_MIN", lowest_m, FENCE_TYPE=kinds)
    assert str(row.verdict) == verdict
    if verdict == "refuse":
        assert row.advice == "param set FENCE_ALT_MIN 4; it would act inside ours"


@pytest.mark.parametrize(
    ("autopilot", "name", "good", "bad"),
    [("px4", "NAV_TRAFF_AVOID", {0, 1}, {2, 3, 4, 5}), ("arducopter", "AVD_ENABLE", {0}, {1, 2})],
)
def test_an_autopilot_that_would_avoid_the_announced_evader_is_refused(autopilot, name, good, bad):
    announcing = wants_of(announces=True)
    for value in good | bad:
        row = row_of(autopilot, name, value, announcing)
        assert row.verdict is (Verdict.PASS if value in good else Verdict.REFUSE)
    assert row_of(autopilot, name, None, announcing, **{name: 0}).verdict is Verdict.REFUSE
    judged = rows(Facts({name: max(bad)}), autopilot_named(autopilot), WANTS)
    assert name not in {row.name for row in judged}


@pytest.mark.parametrize(
    ("autopilot", "name", "value"),
    [
        ("px4", "GF_ACTION", 0),
        ("px4", "GF_MAX_HOR_DIST", 0.0),
        ("px4", "GF_MAX_VER_DIST", 0.0),
        ("arducopter", "FENCE_ENABLE", 0),
        ("arducopter", "FENCE_ACTION", 0),
        ("arducopter", "FENCE_TYPE", 0),
        ("arducopter", "FENCE_RADIUS", 30.0),
    ],
)
def test_a_fence_that_is_not_required_is_warned_of_and_not_refused(autopilot, name, value):
    assert row_of(autopilot, name, value, wants_of(fence_required=False)).verdict is Verdict.WARN


@pytest.mark.parametrize("autopilot", ["px4", "arducopter"])
def test_what_could_not_be_read_is_never_taken_for_safe(autopilot):
    judged = rows(Facts(), autopilot_named(autopilot), WANTS)
    for name in parameter_names(autopilot_named(autopilot).versions[0]):
        row = next(row for row in judged if row.name == name)
        assert row.verdict is not Verdict.PASS
        assert row.value == "not read"
    assert len(refusals(judged)) >= 5


def test_bits_and_enumerations_are_spelled_out():
    assert row_of("px4", "COM_RCL_EXCEPT", 5).value == "5 (Mission, Offboard)"
    assert row_of("px4", "COM_RCL_EXCEPT", 0).value == "0 (none)"
    assert row_of("px4", "COM_RCL_EXCEPT", 16).value == "16 (bit 4)"
    assert row_of("px4", "COM_OBL_RC_ACT", 3).value == "3 (Return)"
    assert row_of("px4", "COM_OBL_RC_ACT", 99).value == "99 (unknown)"
    assert row_of("arducopter", "FENCE_TYPE", 3).value == "3 (height, circle)"


def test_arducopters_speed_parameters_are_said_not_to_bind_guided_velocities():
    row = row_of("arducopter", "WPNAV_SPEED", 500.0)
    assert row.value == "500 cm/s"
    assert "not enforced on GUIDED velocities" in row.wanted


def test_advice_keeps_every_digit_of_a_mask():
    assert row_of("px4", "COM_RC_OVERRIDE", 1e6).advice.startswith(
        "param set COM_RC_OVERRIDE 1000002"
    )


@given(st.sampled_from(["px4", "arducopter"]), st.data())
def test_no_value_whatever_breaks_the_report_and_advice_that_is_followed_passes(autopilot, data):
    name = data.draw(st.sampled_from(parameter_names(autopilot_named(autopilot).versions[0])))
    row = row_of(autopilot, name, data.draw(st.floats(-1e6, 1e6, width=32)))
    command, _, _ = row.advice.partition(";")
    if command.startswith("param set "):
        _, _, mended, value = command.split()
        assert mended == name
        assert row_of(autopilot, name, float(value)).verdict is Verdict.PASS


@pytest.mark.parametrize(
    ("autopilot", "refused"),
    [
        ("px4", ["GF_MAX_HOR_DIST", "GF_MAX_VER_DIST"]),
        ("arducopter", ["GUID_TIMEOUT", "FENCE_ENABLE", "FENCE_RADIUS"]),
    ],
)
def test_the_autopilots_defaults_are_refused_for_these_reasons_only(autopilot, refused):
    mock = MockVehicle(autopilot, noise=False)
    mock.step(0.0, [])
    parameters = {
        name: float(mock.autopilot.parameters[name])
        for name in parameter_names(autopilot_named(autopilot).versions[0])
    }
    judged = rows(Facts(parameters=parameters), autopilot_named(autopilot), WANTS)
    assert [name for name in refusals(judged) if name in parameters] == refused
