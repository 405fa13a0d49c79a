"""State of ArduPilot's flown mode, and the setpoints of GUIDED."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

from sitl_mock.ardupilot import guided
from sitl_mock.ardupilot.legs import Legs
from sitl_mock.ardupilot.maneuvers import Speeds
from sitl_mock.ardupilot.plans import avoiding
from sitl_mock.dynamics import Kind, Setpoint
from sitl_mock.vector import UNSET, Vector

if TYPE_CHECKING:
    from sitl_mock.ardupilot.maneuvers import Circle, Turn
    from sitl_mock.ardupilot.modes import Firmware
    from sitl_mock.protocols import PlanStore
    from sitl_mock.vehicle.state import VehicleState

DECIDE_S: Final = 0.02
IDLING: Final = Setpoint(Kind.IDLING)
"""Motors turning on the ground."""
_TRAVEL = Kind.TRAVEL
_STREAM = Kind.STREAM


@dataclass(slots=True)
class ModeFlight:
    """State of the flown mode; new whenever a mode begins.

    Attributes:
        entered_m: Where the mode began.
        entered_yaw_rad: The heading then.
        guided: Last setpoint in GUIDED, None before the first.
        stream_s: Arrival of the last streamed setpoint.
        takeoff_m: Down coordinate of the take-off in GUIDED, NaN when it is over.
        takeoff_s: Time of its command.
        just_taken_off: There has been no setpoint since the take-off in GUIDED.
        paused: DO_PAUSE_CONTINUE has paused the flight.
        turn: The turn of CONDITION_YAW, None without one.
        speeds: Speeds set by DO_CHANGE_SPEED; reset when the kind of setpoint changes.
        legs: The legs being flown in AUTO or RTL.
        stage: Part of RTL (also used in AUTO).
        stage_s: When it began.
        goal_m: Destination of RTL: north, east and the down coordinate of the flight there.
        circle: The circle of CIRCLE, or of LOITER_TURNS in AUTO.
        edge_m: Where LOITER_TURNS meets its circle, None before.
        turn_item: Mission item during which CONDITION_YAW began its turn in AUTO.
        may_lift: MISSION_START allows AUTO to take off; otherwise it waits for the throttle stick.
    """

    entered_m: Vector
    entered_yaw_rad: float
    guided: Setpoint | None = None
    stream_s: float = -math.inf
    takeoff_m: float = math.nan
    takeoff_s: float = -math.inf
    just_taken_off: bool = False
    paused: bool = False
    turn: Turn | None = None
    speeds: Speeds = field(default_factory=Speeds)
    legs: Legs = field(default_factory=Legs)
    stage: str = ""
    stage_s: float = 0.0
    goal_m: Vector = UNSET
    circle: Circle | None = None
    edge_m: Vector | None = None
    turn_item: int = 0
    may_lift: bool = False

    @property
    def taking_off(self) -> bool:
        """True if a take-off in GUIDED is in progress."""
        return math.isfinite(self.takeoff_m)

    def take_off(self, now_s: float, here_m: Vector, down_m: float) -> None:
        """Begin a take-off in GUIDED from here to a down coordinate."""
        self.takeoff_m = down_m
        self.takeoff_s = now_s
        self.guided = None
        self.entered_m = here_m

    def follow(self, setpoint: Setpoint) -> None:
        """Fly a guided setpoint; another kind of setpoint resets DO_CHANGE_SPEED, as on the real autopilot."""
        if self.guided is None or self.guided.kind is not setpoint.kind or self.just_taken_off:
            self.speeds = Speeds()
        self.just_taken_off = False
        self.guided = setpoint
        self.turn = None
        self.takeoff_m = math.nan

    def guided_setpoint(
        self, state: VehicleState, plans: PlanStore, firmware: Firmware[Any]
    ) -> Setpoint:
        """Return GUIDED's setpoint: the last one, or a stop when it is older than the timeout."""
        if self.guided is None:
            return Setpoint(Kind.BRAKE)
        if self.paused:
            return guided.STOP
        kind = self.guided.kind
        if kind is _TRAVEL:
            return self.speeds.applied(self.guided)
        timeout_s = (
            float(state.parameters[firmware.guided_timeout])
            if firmware.guided_timeout
            else firmware.guided_timeout_s
        )
        if state.now_s - self.stream_s > timeout_s:
            return guided.STOP if kind is _STREAM else guided.LEVEL
        if kind is _STREAM and firmware.flies and plans.fence.items:
            return avoiding(state, plans, self.guided)
        return self.guided

    def with_turn(self, setpoint: Setpoint) -> Setpoint:
        """Return the setpoint with the heading of CONDITION_YAW, if any."""
        if self.turn is None:
            return setpoint
        return setpoint._replace(yaw_rad=self.turn.advance(DECIDE_S), yaw_rate_rad_s=math.nan)
