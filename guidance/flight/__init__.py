"""The flight's state machine: transition table, event detection, and the step of a cycle.

Flight: one flight of one vehicle. Its `step` maps `Inputs` to `Outputs`, with every `Transition`.
Authority: the cause of a change of state: an operator, a mission, or the flight itself.
FlightSettings: the settings. `EngageOn` selects the start of the game.
State, Event: states and events. ORDERS: the events that are orders.
is_done: checks whether an order is in effect.
BEFORE_FLIGHT, FINAL: states before take-off, and end states.
"""

from guidance.flight.machine import Flight
from guidance.flight.settings import (
    Authority,
    EngageOn,
    FlightSettings,
    Inputs,
    Outputs,
    Transition,
)
from guidance.flight.table import BEFORE_FLIGHT, FINAL, ORDERS, Event, State, is_done

__all__ = [
    "BEFORE_FLIGHT",
    "FINAL",
    "ORDERS",
    "Authority",
    "EngageOn",
    "Event",
    "Flight",
    "FlightSettings",
    "Inputs",
    "Outputs",
    "State",
    "Transition",
    "is_done",
]
