"""All rows of one vehicle: a pure function of what is known and what is wanted."""

from collections.abc import Mapping, Sequence
from typing import Final

from guidance.autopilots import AutopilotProfile
from guidance.preflight import arducopter, place, px4, streams
from guidance.preflight.row import Row, Verdict
from guidance.preflight.rule import Rule, judge
from guidance.preflight.wants import Facts, Wants

_RULES: Final[Mapping[str, Sequence[Rule]]] = {"px4": px4.RULES, "arducopter": arducopter.RULES}


def parameter_names(profile: AutopilotProfile) -> tuple[str, ...]:
    """Name the parameters that are judged."""
    return tuple(rule.name for rule in _RULES[profile.name])


def rows(facts: Facts, profile: AutopilotProfile, wants: Wants) -> tuple[Row, ...]:
    """Judge everything."""
    return (
        *judge(_RULES[profile.name], facts.parameters, wants),
        *place.rows(facts, profile.projection, wants),
        *streams.rows(facts, profile),
    )


def refusals(rows: Sequence[Row]) -> tuple[str, ...]:
    """Name the rows that keep the vehicle from becoming ready."""
    return tuple(row.name for row in rows if row.verdict is Verdict.REFUSE)


def advice(rows: Sequence[Row]) -> str:
    """Say in one line what is refused and how to mend it."""
    refused = (row for row in rows if row.verdict is Verdict.REFUSE)
    return "; ".join(f"{row.name} is {row.value}, wanted {row.wanted} ({row.advice})" for row in refused)
