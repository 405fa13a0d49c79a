"""What one cycle of a flight takes in and gives out."""

from collections.abc import Sequence
from typing import NamedTuple

from guidance.certificate import Certificate
from guidance.flight.table import Event, State
from guidance.messages import EvaderReport, Message, Request, Setpoint
from guidance.monitor import Alarm

ORDERS = frozenset({Event.START, Event.ENGAGE, Event.HOLD, Event.RETURN, Event.LAND, Event.ABORT})


class Inputs(NamedTuple):
    """All that one cycle sees, read once. `now_s` is the injected clock's; orders are of `ORDERS`.

    `refusals` names what preflight refuses: the vehicle is not ready while there is any. `alive` is True where a person
    gave a sign of life since the last cycle, None otherwise.
    """

    now_s: float
    messages: Sequence[Message] = ()
    reports: Sequence[EvaderReport] = ()
    orders: Sequence[Event] = ()
    refusals: Sequence[str] = ()
    alive: bool | None = None


class Happening(NamedTuple):
    """An event and what it did: `before` and `after` are equal where an order had no effect."""

    now_s: float
    event: Event
    before: State
    after: State


class Outputs(NamedTuple):
    """What one cycle decided. No setpoint means silence; a fault is an error of our own, which ends the flight."""

    state: State
    setpoint: Setpoint | None
    requests: tuple[Request, ...]
    happenings: tuple[Happening, ...]
    certificate: Certificate | None
    alarm: Alarm | None = None
    fault: str | None = None
