"""A rule about one parameter: how its value is read and judged, and what to set it to."""

from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple

from guidance.preflight.row import Finding, Verdict
from guidance.preflight.wants import Wants

Parameters = Mapping[str, float]

UPLOADED: Final = "uploaded fence"
"""Stands among the parameters for what was read of the uploaded fence: 1 if it holds the vehicle in, 0 if not."""


class Judgement(NamedTuple):
    """What a rule says of a value. `set_to` is a value that would pass, None where a person has to choose."""

    verdict: Verdict
    wanted: str
    set_to: float | None = None
    why: str = ""


class Rule(NamedTuple):
    """One parameter. Without `needed`, an autopilot that does not have it is only remarked on."""

    name: str
    judge: Callable[[float, Wants, Parameters], Judgement]
    read: Callable[[float], str] = "{:g}".format
    needed: bool = True


def judge(rules: Sequence[Rule], parameters: Parameters, wants: Wants) -> tuple[Finding, ...]:
    """Apply every rule."""
    return tuple(_row(rule, parameters, wants) for rule in rules)


def _row(rule: Rule, parameters: Parameters, wants: Wants) -> Finding:
    value = parameters.get(rule.name)
    if value is None:
        if rule.needed:
            return Finding(rule.name, "not read", "to be read", Verdict.REFUSE, "asked for again every few seconds")
        return Finding(rule.name, "not read", "to be read", Verdict.WARN, "this autopilot may not have it")
    verdict, wanted, set_to, why = rule.judge(value, wants, parameters)
    passed = verdict is Verdict.PASS
    command = "" if passed or set_to is None else f"param set {rule.name} {set_to:.9g}"
    return Finding(rule.name, rule.read(value), wanted, verdict, "; ".join(filter(None, (command, why))))


def passes(
    condition: bool,
    wanted: str,
    set_to: float | None = None,
    why: str = "",
    *,
    otherwise: Verdict = Verdict.REFUSE,
) -> Judgement:
    """Pass on a condition; `why` is said only where it fails."""
    return Judgement(Verdict.PASS, wanted) if condition else Judgement(otherwise, wanted, set_to, why)


def named(names: Mapping[int, str]) -> Callable[[float], str]:
    """Read an enumeration: `2 (Hold)`."""
    return lambda value: f"{value:g} ({names.get(round(value), 'unknown')})"


def bits(names: Mapping[int, str]) -> Callable[[float], str]:
    """Read a bit mask: `5 (Mission, Offboard)`."""

    def read(value: float) -> str:
        mask = round(value)
        listed = [names.get(bit, f"bit {bit}") for bit in range(32) if mask >> bit & 1]
        return f"{mask} ({', '.join(listed) or 'none'})"

    return read
