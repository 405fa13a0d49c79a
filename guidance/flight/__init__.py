"""The flight's state machine: a table of transitions, what an event is read from, and the step that joins them."""

from guidance.flight.inputs_outputs import ORDERS, Happening, Inputs, Outputs
from guidance.flight.machine import Flight
from guidance.flight.readiness import Check
from guidance.flight.settings import AfterCapture, EngageOn, FlightSettings
from guidance.flight.table import BEFORE_FLIGHT, FINAL, TRANSITIONS, Event, State, next_state

__all__ = [
    "BEFORE_FLIGHT",
    "FINAL",
    "ORDERS",
    "TRANSITIONS",
    "AfterCapture",
    "Check",
    "EngageOn",
    "Event",
    "Flight",
    "FlightSettings",
    "Happening",
    "Inputs",
    "Outputs",
    "State",
    "next_state",
]
