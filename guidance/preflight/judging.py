"""Judges the facts of one vehicle as rows, and computes the parameter changes that make the rows pass."""

import struct
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from guidance.autopilots import Autopilot, Finding, Verdict, Wants, autopilots_of
from guidance.autopilots.rules import UPLOADED, Judgement, Parameters, Rule, judge
from guidance.messages import Heartbeat, Home, ParameterSet
from guidance.preflight import fence, telemetry
from guidance.preflight.survey import Facts
from guidance.vehicle import local_frame

_MOST_ROUNDS: Final = 4
_REAL32: Final = 9


class ParameterChange(NamedTuple):
    """A parameter to set: formatted values before and after, the reason, and the verdict on the present value."""

    name: str
    now: str
    then: str
    why: str
    verdict: Verdict
    request: ParameterSet


def parameter_names(autopilot: Autopilot) -> tuple[str, ...]:
    """Return the names of the judged parameters."""
    return tuple(rule.name for rule in autopilot.rules)


def rows(facts: Facts, autopilot: Autopilot, wants: Wants) -> tuple[Finding, ...]:
    """Judge everything. For a wrong autopilot, return that row only."""
    other = another_autopilot(facts, autopilot)
    if other is not None:
        return (other,)
    home, frame = facts.vehicle.last(Home), local_frame(facts.vehicle, autopilot.projection)
    wants, parameters = fence.about_home(wants, home, frame), _judged(facts)
    return (
        *judge(autopilot.rules, parameters, wants),
        fence.uploaded_row(
            facts.uploaded,
            wants,
            home,
            frame,
            in_use=autopilot.uploaded_fence_counts(parameters),
            any_inclusion=autopilot.one_inclusion_is_enough,
        ),
        *fence.home_row(wants),
        *telemetry.position_rows(facts, autopilot.projection, wants),
        *telemetry.stream_rows(facts, autopilot),
    )


def engage_names(autopilot: Autopilot) -> tuple[str, ...]:
    """Return the names of the needed parameters, which are read again before every engagement."""
    return tuple(rule.name for rule in autopilot.rules if rule.needed)


def engage_rows(facts: Facts, autopilot: Autopilot, wants: Wants) -> tuple[Finding, ...]:
    """Judge the needed parameters; an unknown one has not been answered."""
    wants = fence.about_home(wants, facts.vehicle.last(Home), local_frame(facts.vehicle, autopilot.projection))
    judged = judge([rule for rule in autopilot.rules if rule.needed], _judged(facts), wants)
    return tuple(
        row if row.name in facts.parameters else row._replace(value="not answered", advice="check the link")
        for row in judged
    )


def another_autopilot(facts: Facts, autopilot: Autopilot) -> Finding | None:
    """Return the row that refuses an autopilot other than the configured one, or None."""
    heartbeat = facts.vehicle.last(Heartbeat)
    if heartbeat is None or heartbeat.autopilot == autopilot.autopilot_id:
        return None
    found = next((one.name for one in autopilots_of(heartbeat.autopilot)), None)
    advice = "another system's HEARTBEAT? check vehicle.url, vehicle.system_id and vehicle.component_id"
    if found is not None:
        advice = f'set vehicle.autopilot = "{found}", or check vehicle.url and vehicle.system_id'
    was = f"{found or 'unknown'} (MAV_AUTOPILOT {heartbeat.autopilot})"
    return Finding("autopilot", was, f"{autopilot.name} ({autopilot.autopilot_id})", Verdict.REFUSE, advice)


def changes(facts: Facts, autopilot: Autopilot, wants: Wants, *, advised: bool = False) -> tuple[ParameterChange, ...]:
    """Return the parameters to set so that none is refused any more, where a rule has a value to set.

    One change can require another (a return height below a fence that was off), so the rules are applied repeatedly.

    Args:
        facts: What was read.
        autopilot: The vehicle's autopilot.
        wants: What the configuration demands.
        advised: Whether to change parameters with a warning, too.
    """
    home, frame = facts.vehicle.last(Home), local_frame(facts.vehicle, autopilot.projection)
    wants, before = fence.about_home(wants, home, frame), _judged(facts)
    return mend(autopilot.rules, before, facts.parameter_types, wants, advised=advised)


def _judged(facts: Facts) -> dict[str, float]:
    parameters = dict(facts.parameters)
    if facts.uploaded.areas is not None:
        parameters[UPLOADED] = float(facts.uploaded.holds_in)
    return parameters


def refusals(rows: Sequence[Finding]) -> tuple[str, ...]:
    """Return the names of the refused rows."""
    return tuple(row.name for row in rows if row.verdict is Verdict.REFUSE)


def advice(rows: Sequence[Finding]) -> str:
    """Return one line with every refused row and its fix."""
    refused = (row for row in rows if row.verdict is Verdict.REFUSE)
    return "; ".join(f"{row.name} is {row.value}, expected {row.wanted} ({row.advice})" for row in refused)


def mend(
    rules: Sequence[Rule], before: Parameters, types: Mapping[str, int], wants: Wants, *, advised: bool
) -> tuple[ParameterChange, ...]:
    """Return the parameters to set, in the rules' order; a rule without a value leaves its parameter alone.

    Args:
        rules: The rules.
        before: The parameters as read.
        types: MAV_PARAM_TYPE of each.
        wants: What the configuration demands.
        advised: Whether to change parameters with a warning, too.
    """
    after = dict(before)
    wrong: dict[str, Judgement] = {}
    for _ in range(_MOST_ROUNDS):
        found = {
            rule.name: judgement
            for rule in rules
            if rule.name in after and _to_mend(judgement := rule.judge(after[rule.name], wants, after), advised=advised)
        }
        if not found:
            break
        wrong |= {name: judgement for name, judgement in found.items() if name not in wrong}
        after |= {name: single(judgement.set_to) for name, judgement in found.items() if judgement.set_to is not None}
    return tuple(
        ParameterChange(
            rule.name,
            rule.read(before[rule.name]),
            rule.read(after[rule.name]),
            f"{wrong[rule.name].wanted}" + (f"; {wrong[rule.name].why}" if wrong[rule.name].why else ""),
            wrong[rule.name].verdict,
            ParameterSet(rule.name, after[rule.name], types.get(rule.name, _REAL32)),
        )
        for rule in rules
        if rule.name in wrong and after[rule.name] != before[rule.name]
    )


def single(value: float) -> float:
    """Round to single precision, as parameters have on the wire."""
    (nearest,) = struct.unpack("<f", struct.pack("<f", value))
    return float(nearest)


def _to_mend(judgement: Judgement, *, advised: bool) -> bool:
    if judgement.set_to is None:
        return False
    return judgement.verdict is Verdict.REFUSE or (advised and judgement.verdict is Verdict.WARN)
