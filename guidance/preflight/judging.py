"""All rows of one vehicle, and what would have to be set so that they pass: functions of what is known and wanted."""

import struct
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from guidance.autopilots import AUTOPILOTS, Autopilot, Finding, Verdict, Wants
from guidance.autopilots.rules import UPLOADED, Judgement, Parameters, Rule, judge
from guidance.messages import Heartbeat, Home, ParameterSet
from guidance.preflight import fence, telemetry
from guidance.preflight.survey import Facts
from guidance.vehicle import local_frame

_MOST_ROUNDS: Final = 4
_REAL32: Final = 9


class ParameterChange(NamedTuple):
    """One parameter: value now and then as its rule reads them, why, and how severe it is as it stands."""

    name: str
    now: str
    then: str
    why: str
    verdict: Verdict
    request: ParameterSet


def parameter_names(autopilot: Autopilot) -> tuple[str, ...]:
    """Name the parameters that are judged."""
    return tuple(rule.name for rule in autopilot.rules)


def rows(facts: Facts, autopilot: Autopilot, wants: Wants) -> tuple[Finding, ...]:
    """Judge everything; of another autopilot than was configured nothing else is worth a row."""
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
    """Name the parameters that are read again before the game begins: those that the vehicle may not fly without."""
    return tuple(rule.name for rule in autopilot.rules if rule.needed)


def engage_rows(facts: Facts, autopilot: Autopilot, wants: Wants) -> tuple[Finding, ...]:
    """Judge them; one that is not known has not answered."""
    wants = fence.about_home(wants, facts.vehicle.last(Home), local_frame(facts.vehicle, autopilot.projection))
    judged = judge([rule for rule in autopilot.rules if rule.needed], _judged(facts), wants)
    return tuple(
        row if row.name in facts.parameters else row._replace(value="not answered", advice="is the link well?")
        for row in judged
    )


def another_autopilot(facts: Facts, autopilot: Autopilot) -> Finding | None:
    """Return the row that refuses an autopilot of another kind than the configured one; None where there is none."""
    heartbeat = facts.vehicle.last(Heartbeat)
    if heartbeat is None or heartbeat.autopilot == autopilot.autopilot_id:
        return None
    found = next((one.name for one in AUTOPILOTS.values() if one.autopilot_id == heartbeat.autopilot), None)
    advice = "another system's HEARTBEAT? check vehicle.url, vehicle.system_id and vehicle.component_id"
    if found is not None:
        advice = f'set vehicle.autopilot = "{found}", or check vehicle.url and vehicle.system_id'
    was = f"{found or 'unknown'} (MAV_AUTOPILOT {heartbeat.autopilot})"
    return Finding("autopilot", was, f"{autopilot.name} ({autopilot.autopilot_id})", Verdict.REFUSE, advice)


def changes(facts: Facts, autopilot: Autopilot, wants: Wants, *, advised: bool = False) -> tuple[ParameterChange, ...]:
    """Return the parameters to set so that no parameter is refused any more, as far as there is a value for it.

    One may ask for another (a return height below a fence that was off), so that all are judged again until nothing
    is left to change.

    Args:
        facts: What was read.
        autopilot: Which one.
        wants: What it has to be set to.
        advised: Also change what is only warned of.
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
    """Name the rows that keep the vehicle from becoming ready."""
    return tuple(row.name for row in rows if row.verdict is Verdict.REFUSE)


def advice(rows: Sequence[Finding]) -> str:
    """Say in one line what is refused and how to mend it."""
    refused = (row for row in rows if row.verdict is Verdict.REFUSE)
    return "; ".join(f"{row.name} is {row.value}, wanted {row.wanted} ({row.advice})" for row in refused)


def mend(
    rules: Sequence[Rule], before: Parameters, types: Mapping[str, int], wants: Wants, *, advised: bool
) -> tuple[ParameterChange, ...]:
    """Return what to set, in the rules' order; a rule without a value to set leaves its parameter alone.

    Args:
        rules: In the order in which they are judged and told.
        before: The parameters as read.
        types: MAV_PARAM_TYPE of each.
        wants: What the flight wants of the autopilot.
        advised: Whether what is only advised is set, too.
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
    """Return the nearest number that a parameter can be on the wire: single precision."""
    (nearest,) = struct.unpack("<f", struct.pack("<f", value))
    return float(nearest)


def _to_mend(judgement: Judgement, *, advised: bool) -> bool:
    if judgement.set_to is None:
        return False
    return judgement.verdict is Verdict.REFUSE or (advised and judgement.verdict is Verdict.WARN)
