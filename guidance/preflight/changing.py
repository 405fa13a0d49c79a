"""The parameters to set so that no row is refused any more."""

from typing import Final, NamedTuple

from guidance.autopilots import Autopilot, Verdict, Wants
from guidance.autopilots.rules import Judgement
from guidance.messages import ParameterSet
from guidance.preflight import fence
from guidance.preflight.parameters import quantities_read, rules_of, single, version_of
from guidance.preflight.reading import Facts

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


def changes(
    facts: Facts, autopilot: Autopilot, wants: Wants, *, advised: bool = False
) -> tuple[ParameterChange, ...]:
    """Return the parameters to set so that none is refused any more, where a rule has a value to set.

    One change can require another, so each is judged with those before it, and the rules are applied repeatedly.

    Args:
        facts: The answers so far.
        autopilot: The vehicle's autopilot.
        wants: The configuration's demands.
        advised: Whether to change parameters with a warning, too.
    """
    version = version_of(autopilot, facts.version)
    wants = fence.about_home(wants, facts.vehicle, autopilot.projection)
    fit = {Verdict.PASS}
    if not advised:
        fit.add(Verdict.WARN)
    concerned = rules_of(version, wants.announces)
    rules = [rule for rule in concerned if rule.name in facts.parameters]
    after = dict(facts.parameters)
    wrong = dict[str, Judgement]()
    for _ in range(_MOST_ROUNDS):
        for rule in rules:
            quantities = quantities_read(after, version, facts.uploaded)
            judgement = rule.judged(after[rule.name], wants, quantities)
            if judgement.verdict not in fit and judgement.set_to is not None:
                after[rule.name] = single(judgement.set_to)
                wrong.setdefault(rule.name, judgement)
    changed = []
    for rule in rules:
        if after[rule.name] != facts.parameters[rule.name]:
            value = after[rule.name]
            judgement = wrong[rule.name]
            reason = judgement.wanted
            if judgement.why:
                reason = f"{reason}; {judgement.why}"
            changed.append(
                ParameterChange(
                    rule.name,
                    rule.read(facts.parameters[rule.name]),
                    rule.read(value),
                    reason,
                    judgement.verdict,
                    ParameterSet(rule.name, value, facts.parameter_types.get(rule.name, _REAL32)),
                )
            )
    return tuple(changed)
