"""Inputs, outputs and settings of a flight, and the `[flight]` section of a vehicle file."""

import math
from collections.abc import Iterator, Mapping, Sequence
from enum import StrEnum
from typing import Final, Literal, NamedTuple

from pydantic import Field, InstanceOf

from guidance.autopilots import Autopilot
from guidance.config import Section
from guidance.control import Limits
from guidance.cycle import Alarm, Certificate, CycleSettings
from guidance.flight.table import Event, State
from guidance.messages import EvaderReport, MateState, Message, Request, Role, Setpoint


class AfterCapture(StrEnum):
    """Action at the stand-off disc."""

    HOLD = "hold"  # hover there
    SHADOW = "shadow"  # follow the moving evader
    RETURN = "return"  # fly home


class EngageOn(StrEnum):
    """Start of the game, in the stand-by position."""

    COMMAND = "command"  # an order
    PILOT_MODE = "pilot_mode"  # the pilot's switch to the guided mode; a neutral setpoint stream makes it possible


LIMITS_S: Final[Mapping[State, float]] = {
    State.CONNECTING: 30.0,
    State.CHECKING: 90.0,
    State.ARMING: 15.0,
    State.CLIMBING: 90.0,
    State.POSITIONING: 180.0,
    State.ENTERING: 10.0,
    State.PAUSED: 10.0,
}
"""Longest stay in a state."""


class Reserve(Section):
    """Computes the battery needed to fly home from distance, height, wind and speed."""

    endurance_s: float = Field(gt=0.0, le=1e5, description="flight time of a full charge")
    left: float = Field(
        0.1, ge=0.0, lt=1.0, description="share of the charge that must be left on the ground"
    )
    return_speed_m_s: float = Field(
        5.0, gt=0.0, le=30.0, description="airspeed of the autopilot's return"
    )
    landing_speed_m_s: float = Field(
        0.7, gt=0.0, le=5.0, description="descent rate of the autopilot's landing"
    )
    wind_m_s: float = Field(0.0, ge=0.0, lt=30.0, description="strongest headwind")

    def _faults(self) -> Iterator[str]:
        if self.wind_m_s >= self.return_speed_m_s:
            allowed = f"must be below flight.reserve.return_speed_m_s = {self.return_speed_m_s:g}"
            reason = "otherwise the vehicle cannot fly home against the wind"
            yield f"flight.reserve.wind_m_s = {self.wind_m_s:g}: {allowed}; {reason}"

    def needed(self, away_m: float, height_m: float) -> float:
        """Return the share of the charge, 0 to 1, needed to fly home and land.

        Args:
            away_m: Horizontal distance from home.
            height_m: Height above home.
        """
        home_s = away_m / (self.return_speed_m_s - self.wind_m_s)
        down_s = max(0.0, height_m) / self.landing_speed_m_s
        share = self.left + (home_s + down_s) / self.endurance_s
        return min(1.0, share) if math.isfinite(share) else 1.0


class FlightSection(Section):
    """Settings of a flight, before and after the game."""

    takeoff_height_m: float = Field(15.0, ge=2.0, le=120.0, description="above home")
    after_capture: AfterCapture = Field(
        AfterCapture.HOLD, description="hover there, follow the moving evader, or fly home"
    )
    engage_on: EngageOn = Field(
        EngageOn.COMMAND,
        description="what engages: an order, or the pilot's switch to the guided mode",
    )
    on_terminate: Literal["hold", "land", "return"] = Field(
        "hold", description="order given to the vehicle on SIGTERM"
    )
    battery_minimum: float = Field(
        0.25, ge=0.0, le=1.0, description="share of the charge below which it returns"
    )
    reserve: Reserve | None = Field(
        None,
        description="return when the charge just suffices to fly home; replaces battery_minimum",
    )
    operator_timeout_s: float | None = Field(
        None,
        ge=1.0,
        le=3600.0,
        description="hold after this long without an order, `guidance ctl alive` or an open operator's page; "
        "default: never",
    )
    operator_return_s: float = Field(
        30.0, gt=0.0, le=3600.0, description="return after this much longer"
    )
    longest_chase_s: float | None = Field(
        None,
        gt=0.0,
        le=7200.0,
        description="hold when a chase, pauses included, lasts longer; default: never",
    )


class TeamSection(Section):
    """Separation from the mates of a team: it holds horizontally or vertically."""

    separation_m: float = Field(
        8.0, ge=2.0, le=1000.0, description="least horizontal distance between vehicles"
    )
    separation_height_m: float = Field(
        3.0, ge=1.0, le=100.0, description="or least difference of their heights"
    )


class FlightSettings(FlightSection):
    """Settings of one running flight: the `[flight]` section, extended from the other sections and the scenario.

    Attributes:
        autopilot: The vehicle's autopilot.
        cycle: Settings of the guidance cycle.
        limits: The `[limits]` section.
        start_game_m: Stand-by position in the game frame; None stays above the take-off.
        hold_on_rival: Whether the vehicle holds when two sources report as the evader.
        guarantee_slack_s: Tolerated loss of the promised value before an alarm, in s of capture time (PE) or of the
            evader's way (TAD), in addition to the allowance of `guidance.cycle.monitor`.
        settle_s: How long all inputs must be good before a paused game continues.
        limits_s: Longest stay in each state that has a limit.
        team: Separation from mates; None for a vehicle without a team.
        evaders: Declared speeds of the evaders by name, m/s; empty for one evader without a name.
        evader_height_limit_m: Greatest height difference between the evader and home's ground for an engagement;
            None is no limit, for a mock.
    """

    autopilot: InstanceOf[Autopilot]
    cycle: InstanceOf[CycleSettings]
    limits: Limits = Limits()
    start_game_m: tuple[float, float, float] | None = None
    hold_on_rival: bool = True
    guarantee_slack_s: float = 0.3
    settle_s: float = 1.0
    limits_s: Mapping[State, float] = Field(default_factory=lambda: LIMITS_S)
    team: TeamSection | None = None
    evaders: Mapping[str, float] = Field(default_factory=dict)
    evader_height_limit_m: float | None = None

    @property
    def farthest_m(self) -> float:
        """Greatest distance from home that the fence allows; 0 while it is unknown (corners in degrees)."""
        return self.limits.reach_m if math.isfinite(self.limits.reach_m) else 0.0


class Authority(StrEnum):
    """The cause of a change of state."""

    OPERATOR = "operator"  # an order of a person; it stands until the next one
    MISSION = "mission"  # an order of the program that flies a scenario
    FLIGHT = "flight"  # an event that the flight detected itself


class Inputs(NamedTuple):
    """Everything that one cycle reads, except for the time.

    Attributes:
        messages: From the vehicle, since the last cycle.
        reports: Of the evader, since the last cycle.
        orders: Orders of people, oldest first; each one of `ORDERS`.
        refusals: Names of what preflight refuses. The vehicle is not ready while there is any.
        alive: True if a person gave a sign of life since the last cycle, else None.
        mission: Orders of a mission. They have no effect while a person's order stands.
        mates: States of other vehicles of the team since the last cycle; None for none.
        role: A new role in the team, from this cycle on; None for no change.
        answer: The action of the user's policy in this cycle, if it is one of an earlier flight that is replayed.
    """

    messages: Sequence[Message] = ()
    reports: Sequence[EvaderReport] = ()
    orders: Sequence[Event] = ()
    refusals: Sequence[str] = ()
    alive: bool | None = None
    mission: Sequence[Event] = ()
    mates: Sequence[MateState] | None = None
    role: Role | None = None
    answer: tuple[float, ...] | None = None


class Transition(NamedTuple):
    """An event and its effect.

    Attributes:
        now_s: When.
        event: What happened.
        before: The state before.
        after: The state after; equal to `before` if an order had no effect.
        by: Its cause: an operator, a mission or the flight itself.
        detail: The measurement in words: "no telemetry for 1.2 s". Empty if the event's name is enough.
    """

    now_s: float
    event: Event
    before: State
    after: State
    by: Authority = Authority.FLIGHT
    detail: str = ""

    @property
    def words(self) -> str:
        """The cause for people: the detail if there is one, else the event."""
        return self.detail if self.detail else str(self.event)


class Outputs(NamedTuple):
    """Decisions of one cycle.

    Attributes:
        state: The flight's, after this cycle.
        setpoint: To send now; None sends nothing.
        requests: To send to the vehicle.
        transitions: One for each order, then the detected events.
        certificate: Of the game, if it was played in this cycle.
        alarm: If the game's promise was broken in this cycle.
        fault: An error of guidance itself. It ends the flight.
        cause: The transition that led to the present state; None in the first state.
        answer: The action of the user's policy in this cycle; None without one.
    """

    state: State
    setpoint: Setpoint | None
    requests: tuple[Request, ...]
    transitions: tuple[Transition, ...]
    certificate: Certificate | None
    alarm: Alarm | None = None
    fault: str | None = None
    cause: Transition | None = None
    answer: tuple[float, ...] | None = None
