"""The flight's state machine: a table of transitions, what an event is read from, and the step that joins them.

What it offers:
    Flight: one flight of one vehicle; its `step` takes `Inputs` and returns `Outputs`, with every `Happening`.
    Authority: who caused a change of state: an operator, a mission, or the flight itself.
    FlightSettings: what it is of; `EngageOn` says what begins the game, `AfterCapture` what follows it.
    State, Event: where a flight stands, and what may happen. ORDERS: the events that a person orders.
    TRANSITIONS: the table, which `next_state` looks a pair up in. `is_done` tells whether an order is in effect.
    BEFORE_FLIGHT, FINAL: states in which nothing is flown yet, and those that nothing leads out of.
    Check: one condition for arming and engaging, and what was found.
"""

from guidance.flight.inputs_outputs import ORDERS, Authority, Happening, Inputs, Outputs
from guidance.flight.machine import Flight
from guidance.flight.readiness import Check
from guidance.flight.settings import AfterCapture, EngageOn, FlightSettings
from guidance.flight.table import BEFORE_FLIGHT, FINAL, TRANSITIONS, Event, State, is_done, next_state

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
