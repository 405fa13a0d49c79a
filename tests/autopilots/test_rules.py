"""What each kind of rule promises, whatever autopilot uses it."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from guidance.autopilots import Finding, Preflight, Verdict
from guidance.autopilots.rules import (
    Judgement,
    Quantity,
    Rule,
    bits,
    fence_size,
    finding_of,
    loss_time,
    mask,
    named,
    one_of,
    passes,
    return_height,
)
from tests.preflight.wants import wants_of

WANTS = wants_of()
LENIENT = wants_of(fence_required=False)
masks = st.integers(0, 2**16 - 1)


@given(masks, masks, masks)
def test_a_mask_is_right_if_its_bits_are_and_the_mended_one_differs_in_wrong_bits_only(
    value, set_bits, clear_bits
):
    clear_bits &= ~set_bits
    judge = mask("some bits", "a reason", set_bits=set_bits, clear_bits=clear_bits)
    judgement = judge(float(value), WANTS, {})
    wrong = (set_bits & ~value) | (clear_bits & value)
    if wrong:
        assert judgement == Judgement(Verdict.WARN, "some bits", value ^ wrong, "a reason")
    else:
        assert judgement == Judgement(Verdict.PASS, "some bits")


def test_a_mask_without_demands_is_right_and_a_wrong_one_may_refuse():
    for value in range(8):
        assert mask("", "")(float(value), WANTS, {}).verdict is Verdict.PASS
    refusing = mask("", "", set_bits=1, otherwise=Verdict.REFUSE)
    assert refusing(0.0, WANTS, {}).verdict is Verdict.REFUSE


def test_one_of_several_values_is_right_and_only_a_fences_setting_may_be_configured():
    judge = one_of({1, 3}, "1 or 3", 3, "a reason", otherwise=Verdict.WARN)
    assert judge(1.0, WANTS, {}) == Judgement(Verdict.PASS, "1 or 3")
    assert judge(2.0, WANTS, {}) == Judgement(Verdict.WARN, "1 or 3", 3, "a reason")
    of_the_fence = one_of({1}, "1", 1)
    assert of_the_fence(2.0, WANTS, {}) == Judgement(Verdict.REFUSE, "1", 1)
    assert of_the_fence(2.0, LENIENT, {}).verdict is Verdict.WARN


def test_a_condition_that_holds_proposes_nothing():
    assert passes(True, "this", 5.0, "a reason") == Judgement(Verdict.PASS, "this")
    assert passes(False, "this") == Judgement(Verdict.REFUSE, "this", None, "")


@pytest.mark.parametrize(
    ("limit_s", "value", "passed", "set_to"),
    [
        (1.5, 0.19, False, 1.0),
        (1.5, 0.2, True, None),
        (1.5, 1.5, True, None),
        (1.5, 1.51, False, 1.0),
        (0.5, 0.51, False, 0.5),
        (3.0, 3.01, False, 1.0),
    ],
)
def test_a_lost_setpoint_is_noticed_soon_but_not_at_once(limit_s, value, passed, set_to):
    preflight = WANTS.preflight.model_copy(update={"loss_time_limit_s": limit_s})
    judgement = loss_time(" (usual)")(value, WANTS._replace(preflight=preflight), {})
    assert (judgement.verdict is Verdict.PASS) is passed
    assert judgement.verdict is not Verdict.WARN
    assert judgement.set_to == set_to
    assert judgement.wanted == f"0.2 to {limit_s:g} s"
    assert passed or judgement.why.endswith("when setpoints stop (usual)")
    assert loss_time()(9.0, WANTS, {}).why.endswith("when setpoints stop")


@pytest.mark.parametrize(
    ("fence_m", "height_m", "verdict", "set_to"),
    [
        (None, 0.0, Verdict.REFUSE, None),
        (-1.0, 60.0, Verdict.PASS, None),
        (0.0, 60.0, Verdict.PASS, None),
        (0.0, 60.000004, Verdict.PASS, None),  # 60 m in single precision, or less
        (0.0, 60.1, Verdict.REFUSE, 60.0),
        (0.5, 59.0, Verdict.WARN, 0.25),
        (60.0, 59.9, Verdict.PASS, None),
        (60.0, 60.0, Verdict.WARN, 55.0),
        (60.0, 60.1, Verdict.REFUSE, 55.0),
        (80.0, 60.0, Verdict.PASS, None),
        (80.0, 60.1, Verdict.REFUSE, 60.0),
    ],
)
def test_a_return_stays_below_our_ceiling_and_the_fence_and_an_unknown_fence_refuses(
    fence_m, height_m, verdict, set_to
):
    quantities = {} if fence_m is None else {Quantity.FENCE_HEIGHT: fence_m}
    judgement = return_height("FENCE", "the return")(height_m, WANTS, quantities)
    assert (judgement.verdict, judgement.set_to) == (verdict, set_to)
    wanted = "at most limits.ceiling_m = 60 m"
    if fence_m is None:
        wanted = "below FENCE, which is unknown"
    elif 0.0 < fence_m <= 60.0:
        wanted = f"below FENCE = {fence_m:g} m"
    assert judgement.wanted == wanted
    if verdict is Verdict.REFUSE and fence_m is not None:
        assert judgement.why == "the return would climb above our ceiling"
    if verdict is Verdict.WARN:
        assert judgement.why == "the return would climb through the fence"


@pytest.mark.parametrize(
    ("size_m", "passed", "why"),
    [(0.0, False, "it is off"), (199.9, False, "it would act inside ours"), (200.0, True, "")],
)
def test_the_autopilots_fence_is_at_least_as_large_as_ours(size_m, passed, why):
    judgement = fence_size("fence_radius_m", off="it is off")(size_m, WANTS, {})
    assert judgement.verdict is (Verdict.PASS if passed else Verdict.REFUSE)
    assert (judgement.wanted, judgement.why) == ("at least 200 m, ours", why)
    assert judgement.set_to == (None if passed else 205.0)
    lenient = fence_size("fence_radius_m")(size_m, LENIENT, {})
    assert lenient.verdict is (Verdict.PASS if passed else Verdict.WARN)
    assert passed or lenient.why == "it would act inside ours"


def test_enumerations_and_masks_are_shown_by_number_and_name():
    assert named({2: "Hold"})(2.0) == "2 (Hold)"
    assert named({2: "Hold"})(3.0) == "3 (unknown)"
    shown = bits({0: "Mission", 2: "Offboard"})
    assert shown(5.0) == "5 (Mission, Offboard)"
    assert shown(6.0) == "6 (bit 1, Offboard)"
    assert shown(0.0) == "0 (none)"
    assert shown(2.0**31) == "2147483648 (bit 31)"
    assert shown(2.0**32) == "4294967296 (none)"


def test_a_finding_that_passes_has_no_advice():
    assert Finding.of(True, "name", "5", "4", "do this") == ("name", "5", "4", Verdict.PASS, "")
    failed = Finding.of(False, "name", "5", "4", "do this")
    assert failed == ("name", "5", "4", Verdict.REFUSE, "do this")


def at_most_two(value, _wants, _quantities):
    return passes(value <= 2.0, "at most 2", 2.0, otherwise=Verdict.WARN)


IN_CENTIMETRES = Rule("a height", "HEIGHT", at_most_two, unit=0.01)


def test_a_rule_judges_in_metres_and_proposes_in_the_parameters_unit():
    assert IN_CENTIMETRES.judged(200.0, WANTS, {}).verdict is Verdict.PASS
    assert IN_CENTIMETRES.judged(201.0, WANTS, {}).set_to == pytest.approx(200.0)


@pytest.mark.parametrize(
    ("why", "advice"),
    [("", "param set HEIGHT 200"), ("too high", "param set HEIGHT 200; too high")],
)
def test_a_row_proposes_a_command_and_says_why(why, advice):
    def judge(*arguments):
        return at_most_two(*arguments)._replace(why=why)

    rule = IN_CENTIMETRES._replace(judge=judge)
    row = finding_of(rule, {"HEIGHT": 300.0}, WANTS, {})
    assert row == ("HEIGHT", "300", "at most 2", Verdict.WARN, advice)

    def decided_by_a_person(*arguments):
        return judge(*arguments)._replace(set_to=None)

    row = finding_of(rule._replace(judge=decided_by_a_person), {"HEIGHT": 300.0}, WANTS, {})
    assert row.advice == why


@pytest.mark.parametrize(("needed", "verdict"), [(True, Verdict.REFUSE), (False, Verdict.WARN)])
def test_a_value_that_was_not_read_refuses_if_it_is_needed(needed, verdict):
    row = finding_of(IN_CENTIMETRES._replace(needed=needed), {}, WANTS, {})
    assert row[:4] == ("HEIGHT", "not read", "a value", verdict)
    assert row.advice.startswith("a height is unknown")


def test_a_rule_that_says_nothing_else_matters_for_safety():
    assert Rule("a height", "HEIGHT", at_most_two).needed


def test_preflight_demands_a_fence_and_a_short_wait_unless_it_is_told_otherwise():
    usual = Preflight()
    assert usual.fence_required is True
    assert usual.loss_time_limit_s == 1.5
    assert usual.origin_distance_limit_m == 1000.0
    assert usual.evader_height_limit_m is None
    assert all(field.description for field in Preflight.model_fields.values())


@pytest.mark.parametrize(
    ("key", "allowed", "refused"),
    [
        ("loss_time_limit_s", [0.21, 5.0], [0.2, 5.01]),
        ("origin_distance_limit_m", [0.1, 1e4], [0.0, -1.0]),
        ("evader_height_limit_m", [0.1, 1e3], [0.0, -1.0]),
    ],
)
def test_what_preflight_demands_has_a_range(key, allowed, refused):
    for value in allowed:
        assert getattr(Preflight(**{key: value}), key) == value
    for value in refused:
        with pytest.raises(ValidationError):
            Preflight(**{key: value})
