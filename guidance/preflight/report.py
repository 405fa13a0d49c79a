"""All rows of one vehicle: a pure function of what is known and what is wanted."""

from collections.abc import Mapping, Sequence
from typing import Final

from guidance.autopilots import PX4, AutopilotProfile
from guidance.messages import Home
from guidance.preflight import arducopter, fence, place, px4, streams
from guidance.preflight.mending import ParameterChange, mend
from guidance.preflight.row import Finding, Verdict
from guidance.preflight.rule import UPLOADED, Rule, judge
from guidance.preflight.wants import Facts, Wants
from guidance.vehicle import local_frame

_RULES: Final[Mapping[str, Sequence[Rule]]] = {"px4": px4.RULES, "arducopter": arducopter.RULES}


def parameter_names(profile: AutopilotProfile) -> tuple[str, ...]:
    """Name the parameters that are judged."""
    return tuple(rule.name for rule in _RULES[profile.name])


def rows(facts: Facts, profile: AutopilotProfile, wants: Wants) -> tuple[Finding, ...]:
    """Judge everything."""
    home, frame = facts.vehicle.last(Home), local_frame(facts.vehicle, profile.projection)
    wants, parameters = fence.about_home(wants, home, frame), _judged(facts)
    px4_flown = profile.name == PX4.name
    in_use = px4_flown or bool(round(parameters.get("FENCE_TYPE", arducopter.POLYGON)) & arducopter.POLYGON)
    return (
        *judge(_RULES[profile.name], parameters, wants),
        fence.uploaded_row(facts.uploaded, wants, home, frame, in_use=in_use, any_inclusion=px4_flown),
        *fence.home_row(wants),
        *place.rows(facts, profile.projection, wants),
        *streams.rows(facts, profile),
    )


def changes(
    facts: Facts, profile: AutopilotProfile, wants: Wants, *, advised: bool = False
) -> tuple[ParameterChange, ...]:
    """Return the parameters to set so that no parameter is refused any more, as far as there is a value for it.

    One may ask for another (a return height below a fence that was off), so that all are judged again until nothing
    is left to change.

    Args:
        facts: What was read.
        profile: Which autopilot.
        wants: What it has to be set to.
        advised: Also change what is only warned of.
    """
    home, frame = facts.vehicle.last(Home), local_frame(facts.vehicle, profile.projection)
    wants, before = fence.about_home(wants, home, frame), _judged(facts)
    return mend(_RULES[profile.name], before, facts.parameter_types, wants, advised=advised)


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
