"""The flight's state machine: transition table, event detection, and the step of a cycle.

Flight: one flight of one vehicle. Its `step` maps `Inputs` to `Outputs`, with every `Happening`.
Authority: the cause of a change of state: an operator, a mission, or the flight itself.
FlightSettings: the settings. `EngageOn` selects the start of the game, `AfterCapture` the action after capture.
State, Event: states and events. ORDERS: the events that are orders.
TRANSITIONS: the transition table. `next_state` looks up a transition; `is_done` checks whether an order is in effect.
BEFORE_FLIGHT, FINAL: states before take-off, and end states.
Check: one condition of arming and engaging.
"""

from guidance.flight.machine import Flight
from guidance.flight.readiness import Check
from guidance.flight.settings import (
    AfterCapture,
    Authority,
    EngageOn,
    FlightSettings,
    Happening,
    Inputs,
    Outputs,
)
from guidance.flight.table import BEFORE_FLIGHT, FINAL, ORDERS, TRANSITIONS, Event, State, is_done, next_state

__all__ = [
    "BEFORE_FLIGHT",
    "FINAL",
    "ORDERS",
    "TRANSITIONS",
    "AfterCapture",
    "Authority",
    "Check",
    "EngageOn",
    "Event",
    "Flight",
    "FlightSettings",
    "Happening",
    "Inputs",
    "Outputs",
    "State",
    "is_done",
    "next_state",
]
