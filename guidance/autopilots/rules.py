"""A rule about one parameter: how its value is read and judged by what the configuration asks, what to set it to."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, NamedTuple


class Verdict(StrEnum):
    """What a row means for the flight."""

    PASS = "pass"
    WARN = "warn"  # worth knowing; nothing is held up
    REFUSE = "refuse"  # the vehicle does not become ready


class Finding(NamedTuple):
    """One condition: what was found, what is wanted, and how to come from one to the other (empty if it is)."""

    name: str
    value: str
    wanted: str
    verdict: Verdict
    advice: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wants:
    """What the configuration asks of the autopilot.

    Attributes:
        speed_m_s: Horizontal speed of the game.
        limit_speed_m_s: Horizontal speed that our own limits allow (catching up is a little faster than the game).
        climb_m_s: Climb of the game.
        descent_m_s: Descent of the game.
        fence_required: Whether the autopilot's own fence must stand behind ours.
        fence_radius_m: How far from home our fence lets the vehicle go.
        ceiling_m: How high above home.
        fence_circle_m: Radius of our circle about home, where there is one.
        fence_corners_ne_m: Corners of our polygon, metres north and east of home, where there is one.
        fence_corners_deg: The same by latitude and longitude, as long as home is not known.
        battery_needed: Share of the charge to come home with from the edge of the fence, where that is reckoned.
        loss_time_limit_s: Longest time that an old setpoint may be flown when ours stop.
        origin_distance_limit_m: Farthest that the local frame's zero may be from home.
        evader_height_limit_m: Largest difference between the evader's altitude and home's.
    """

    speed_m_s: float
    limit_speed_m_s: float
    climb_m_s: float
    descent_m_s: float
    fence_required: bool
    fence_radius_m: float
    ceiling_m: float
    loss_time_limit_s: float = 1.5
    origin_distance_limit_m: float = 1000.0
    evader_height_limit_m: float = 30.0
    fence_circle_m: float | None = None
    fence_corners_ne_m: tuple[tuple[float, float], ...] | None = None
    fence_corners_deg: tuple[tuple[float, float], ...] | None = None
    battery_needed: float | None = None


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
    """Pass on a condition.

    Args:
        condition: Whether the value is as wanted.
        wanted: What is wanted, for people.
        set_to: What `guidance check --apply` sets instead; None where that is a person's to decide.
        why: What comes of it otherwise; said only where it fails.
        otherwise: The verdict where it fails.
    """
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
