"""Rules that judge the autopilot's parameters before a flight: what a value means, and what to set instead.

A rule judges a quantity: the height of the return, the action on lost setpoints. Each version of an autopilot names
the parameter that has it, and its unit (`guidance.autopilots.description.Version`).
"""

import math
from collections.abc import Callable, Container, Mapping
from enum import StrEnum
from typing import Final, NamedTuple

from pydantic import Field

from guidance.config import Section
from guidance.control import Limits, Speeds


class Verdict(StrEnum):
    """Consequence of a finding for the flight."""

    PASS = "pass"
    WARN = "warn"  # worth knowing; the flight may start
    REFUSE = "refuse"  # the vehicle does not become ready


class Finding(NamedTuple):
    """One condition: the value found, the value expected, and how to fix it (empty if it passes)."""

    name: str
    value: str
    wanted: str
    verdict: Verdict
    advice: str = ""

    @classmethod
    def of(
        cls,
        passed: bool,
        name: str,
        value: str,
        wanted: str,
        advice: str,
        otherwise: Verdict = Verdict.REFUSE,
    ) -> "Finding":
        """Return a condition that passes without advice, or else has the verdict `otherwise`."""
        return cls(
            name, value, wanted, Verdict.PASS if passed else otherwise, "" if passed else advice
        )


class Preflight(Section):
    """The `[preflight]` section of a vehicle file: what preflight demands of the autopilot."""

    fence_required: bool = Field(
        True, description="whether the autopilot's own fence must enclose ours"
    )
    loss_time_limit_s: float = Field(
        1.5, gt=0.2, le=5.0, description="longest time that the autopilot may fly an old setpoint"
    )
    origin_distance_limit_m: float = Field(
        1000.0, gt=0.0, description="greatest distance of the local frame's origin from home"
    )
    evader_height_limit_m: float | None = Field(
        None,
        gt=0.0,
        description="greatest height difference between the evader and home's ground, below "
        "game.standoff_height_m; default: half of it",
    )


class Wants(NamedTuple):
    """Requirements of the configuration on the autopilot.

    Attributes:
        preflight: The `[preflight]` section.
        limits: The `[limits]` section.
        game_speeds: Speeds of the game.
        limit_speeds: Speed limits of our commands; the excess over the game's speeds recovers a late start.
        battery_needed: Share of the charge needed to fly home from the fence; None without `[flight.reserve]`.
        evader_height_limit_m: Greatest height difference between the evader and home's ground.
        announces: Whether the evader is announced as traffic, which the autopilot hears too.
        evader_speed_m_s: The evader's declared speed.
        standoff_radius_m: Of the game's disc.
    """

    preflight: Preflight
    limits: Limits
    game_speeds: Speeds
    limit_speeds: Speeds
    battery_needed: float | None
    evader_height_limit_m: float
    announces: bool
    evader_speed_m_s: float
    standoff_radius_m: float


class Quantity(StrEnum):
    """Quantities that rules judge. An autopilot of another make may have more, with names of its own."""

    LOSS_TIME = "time until lost setpoints are noticed"
    LOSS_ACTION = "action on lost setpoints"
    RADIO_LOSS_ACTION = "action on radio loss"
    RADIO_LOSS_EXCEPTIONS = "modes that ignore radio loss"
    STICKS_TAKE_OVER = "the pilot's sticks take over"
    BATTERY_ACTION = "action on a low battery"
    CRITICAL_BATTERY_ACTION = "action on a critical battery"
    ESTIMATOR_ACTION = "action on an estimator failure"
    GUIDED_OPTIONS = "options of the guided mode"
    FENCE_ENABLED = "fence enabled"
    FENCE_ACTION = "action of the fence"
    FENCE_TYPE = "kinds of fences in use"
    FENCE_RADIUS = "radius of the fence"
    FENCE_HEIGHT = "height of the fence"
    FENCE_FLOOR = "floor of the fence"
    RETURN_HEIGHT = "height of the return"
    SPEED = "horizontal speed"
    CLIMB = "climb rate"
    DESCENT = "descent rate"
    LEAN = "largest lean angle"
    TRAFFIC_ACTION = "action on traffic"
    UPLOADED_INCLUSION = "an uploaded fence encloses the vehicle"  # 1 or 0; missing if unknown


Quantities = Mapping[str, float]
"""The values that were read, by quantity: m, m/s, s and degrees; enumerations and bit masks as they are."""

SHORTEST_LOSS_S: Final = 0.2

_ROUNDING_M: Final = 1e-3
"""A parameter is single precision on the wire."""


class Judgement(NamedTuple):
    """Result of a rule. `set_to` is a value of the quantity that passes; None if a person has to choose one."""

    verdict: Verdict
    wanted: str
    set_to: float | None = None
    why: str = ""


Judge = Callable[[float, Wants, Quantities], Judgement]
"""Judges a value, in the quantity's unit. The quantities are all that were read."""


class Rule(NamedTuple):
    """Judges one quantity.

    Attributes:
        quantity: The quantity, the same in every version of the autopilot.
        name: The parameter that has it.
        judge: Judges it.
        read: Formats the parameter's value, with its unit.
        unit: One unit of the parameter in the quantity's unit: 0.01 for a height in centimetres.
        needed: Whether it matters for safety. Then an unknown value refuses; otherwise it is a warning.
        of_announced: Whether it is judged only if the evader is announced as traffic.
    """

    quantity: str
    name: str
    judge: Judge
    read: Callable[[float], str] = "{:g}".format
    unit: float = 1.0
    needed: bool = True
    of_announced: bool = False

    def judged(self, value: float, wants: Wants, quantities: Quantities) -> Judgement:
        """Judge a value of the parameter; `set_to` is one of the parameter too."""
        judgement = self.judge(value * self.unit, wants, quantities)
        if judgement.set_to is None:
            return judgement
        return judgement._replace(set_to=judgement.set_to / self.unit)


def finding_of(
    rule: Rule, parameters: Mapping[str, float], wants: Wants, quantities: Quantities
) -> Finding:
    """Apply a rule to the parameters that were read."""
    value = parameters.get(rule.name)
    if value is None:
        verdict = Verdict.REFUSE if rule.needed else Verdict.WARN
        advice = f"{rule.quantity} is unknown; requested again every few seconds"
        return Finding(rule.name, "not read", "a value", verdict, advice)
    judgement = rule.judged(value, wants, quantities)
    advice = judgement.why
    if judgement.verdict is not Verdict.PASS and judgement.set_to is not None:
        command = f"param set {rule.name} {judgement.set_to:.9g}"
        advice = f"{command}; {advice}" if advice else command
    return Finding(rule.name, rule.read(value), judgement.wanted, judgement.verdict, advice)


def passes(
    condition: bool,
    wanted: str,
    set_to: float | None = None,
    why: str = "",
    *,
    otherwise: Verdict = Verdict.REFUSE,
) -> Judgement:
    """Pass if the condition holds.

    Args:
        condition: Whether the value passes.
        wanted: The expected value, for people.
        set_to: Value that `guidance check --apply` sets instead; None if a person has to choose.
        why: The consequence of failing.
        otherwise: The verdict of failing.
    """
    return (
        Judgement(Verdict.PASS, wanted) if condition else Judgement(otherwise, wanted, set_to, why)
    )


def one_of(
    good: Container[int],
    wanted: str,
    set_to: int,
    why: str = "",
    *,
    otherwise: Verdict | None = None,
) -> Judge:
    """Judge an enumeration.

    Args:
        good: The values that pass.
        wanted: The same for people.
        set_to: The value to set instead.
        why: The consequence of failing.
        otherwise: The verdict of failing; None for a setting of the autopilot's fence, see `fence_verdict`.
    """

    def judged(value: float, wants: Wants, _: Quantities) -> Judgement:
        failed = fence_verdict(wants) if otherwise is None else otherwise
        return passes(round(value) in good, wanted, set_to, why, otherwise=failed)

    return judged


def mask(
    wanted: str,
    why: str,
    *,
    set_bits: int = 0,
    clear_bits: int = 0,
    otherwise: Verdict = Verdict.WARN,
) -> Judge:
    """Judge a bit mask: some bits must be set, others cleared."""

    def judged(value: float, _: Wants, __: Quantities) -> Judgement:
        right = (round(value) | set_bits) & ~clear_bits
        return passes(round(value) == right, wanted, right, why, otherwise=otherwise)

    return judged


def loss_time(usual: str = "") -> Judge:
    """Judge how long the last setpoint is flown when setpoints stop; `usual` adds the default."""
    consequence = f"the last velocity is flown for this long when setpoints stop{usual}"

    def judged(value: float, wants: Wants, _: Quantities) -> Judgement:
        limit_s = wants.preflight.loss_time_limit_s
        expected = f"{SHORTEST_LOSS_S:g} to {limit_s:g} s"
        within = SHORTEST_LOSS_S <= value <= limit_s
        return passes(within, expected, min(1.0, limit_s), consequence)

    return judged


def return_height(fence: str, action: str) -> Judge:
    """Judge the height of the autopilot's return: at most our ceiling, and below its fence.

    The autopilot also returns when guidance is silent: when setpoints stop, and after telemetry was lost.

    Args:
        fence: Name of the parameter of the fence's height.
        action: Name of the return.
    """

    def judged(height_m: float, wants: Wants, quantities: Quantities) -> Judgement:
        fence_m = quantities.get(Quantity.FENCE_HEIGHT)
        if fence_m is None:
            return Judgement(Verdict.REFUSE, f"below {fence}, which is unknown")
        ceiling_m = wants.limits.ceiling_m
        fenced = fence_m > 0.0
        set_to = min(ceiling_m, max(fence_m - 5.0, 0.5 * fence_m)) if fenced else ceiling_m
        expected = f"at most limits.ceiling_m = {ceiling_m:g} m"
        if fenced and fence_m <= ceiling_m:
            expected = f"below {fence} = {fence_m:g} m"
        if height_m > ceiling_m + _ROUNDING_M:
            consequence = f"{action} would climb above our ceiling"
            return Judgement(Verdict.REFUSE, expected, set_to, consequence)
        consequence = f"{action} would climb through the fence"
        below = height_m < fence_m or not fenced
        return passes(below, expected, set_to, consequence, otherwise=Verdict.WARN)

    return judged


def fence_verdict(wants: Wants) -> Verdict:
    """Return the verdict on an autopilot's fence that does not enclose ours."""
    return Verdict.REFUSE if wants.preflight.fence_required else Verdict.WARN


def fence_size(ours: str, off: str = "") -> Judge:
    """Judge the radius or height of the autopilot's fence.

    Args:
        ours: Name of the same size in `Limits`.
        off: The consequence of zero.
    """

    def judged(size_m: float, wants: Wants, _: Quantities) -> Judgement:
        least_m = getattr(wants.limits, ours)
        consequence = off if off and size_m == 0.0 else "it would act inside ours"
        expected = f"at least {least_m:g} m, ours"
        set_to = math.ceil(least_m + 5.0)
        encloses = size_m >= least_m
        return passes(encloses, expected, set_to, consequence, otherwise=fence_verdict(wants))

    return judged


def named(names: Mapping[int, str]) -> Callable[[float], str]:
    """Format an enumeration: `2 (Hold)`."""
    return lambda value: f"{value:g} ({names.get(round(value), 'unknown')})"


def bits(names: Mapping[int, str]) -> Callable[[float], str]:
    """Format a bit mask: `5 (Mission, Offboard)`."""

    def read(value: float) -> str:
        mask = round(value)
        listed = [names.get(bit, f"bit {bit}") for bit in range(32) if mask >> bit & 1]
        words = ", ".join(listed) if listed else "none"
        return f"{mask} ({words})"

    return read
