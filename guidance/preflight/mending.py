"""What would have to be set so that the rules are content: parameters, from their values now to others."""

import struct
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from guidance.messages import ParameterSet
from guidance.preflight.row import Verdict
from guidance.preflight.rule import Judgement, Parameters, Rule
from guidance.preflight.wants import Wants

_MOST_ROUNDS: Final = 4
_REAL32: Final = 9


class ParameterChange(NamedTuple):
    """One parameter: value now and then as its rule reads them, why, and how grave it is as it stands."""

    name: str
    now: str
    then: str
    why: str
    verdict: Verdict
    request: ParameterSet


def mend(
    rules: Sequence[Rule], before: Parameters, types: Mapping[str, int], wants: Wants, *, advised: bool
) -> tuple[ParameterChange, ...]:
    """Return what to set, in the rules' order; a rule without a value to set leaves its parameter alone."""
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
