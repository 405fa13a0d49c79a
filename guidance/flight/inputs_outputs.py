"""Inputs and outputs of one cycle of a flight."""

from collections.abc import Sequence
from enum import StrEnum
from typing import NamedTuple

from guidance.certificate import Certificate
from guidance.flight.table import Event, State
from guidance.messages import EvaderReport, Message, Request, Setpoint
from guidance.monitor import Alarm

ORDERS = frozenset({Event.START, Event.ENGAGE, Event.HOLD, Event.RETURN, Event.LAND, Event.ABORT})


class Authority(StrEnum):
    """The cause of a change of state."""

    OPERATOR = "operator"  # an order of a person; it stands until the next one
    MISSION = "mission"  # an order of the program that flies a scenario
    FLIGHT = "flight"  # an event that the flight detected itself


class Inputs(NamedTuple):
    """Everything that one cycle reads.

    Attributes:
        now_s: Time of the injected clock.
        messages: From the vehicle, since the last cycle.
        reports: Of the evader, since the last cycle.
        orders: Orders of people, oldest first; each one of `ORDERS`.
        refusals: Names of what preflight refuses. The vehicle is not ready while there is any.
        alive: True if a person gave a sign of life since the last cycle, else None.
        mission: Orders of a mission. They have no effect while a person's order stands.
    """

    now_s: float
    messages: Sequence[Message] = ()
    reports: Sequence[EvaderReport] = ()
    orders: Sequence[Event] = ()
    refusals: Sequence[str] = ()
    alive: bool | None = None
    mission: Sequence[Event] = ()


class Happening(NamedTuple):
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
        return self.detail or str(self.event)


class Outputs(NamedTuple):
    """Decisions of one cycle.

    Attributes:
        state: The flight's, after this cycle.
        setpoint: To send now; None sends nothing.
        requests: To send to the vehicle.
        happenings: One for each order, then the detected events.
        certificate: Of the game, if it was played in this cycle.
        alarm: If the game's promise was broken in this cycle.
        fault: An error of guidance itself. It ends the flight.
        cause: The happening that led to the present state; None in the first state.
    """

    state: State
    setpoint: Setpoint | None
    requests: tuple[Request, ...]
    happenings: tuple[Happening, ...]
    certificate: Certificate | None
    alarm: Alarm | None = None
    fault: str | None = None
    cause: Happening | None = None
