"""Ending in an orderly way: hand the vehicle to the autopilot, see it taken, then go."""

from typing import Final

from guidance.autopilots import Mode
from guidance.flight import FINAL, Event, Flight, State

ON_GROUND: Final = frozenset({State.CONNECTING, State.CHECKING, State.READY})
LIMIT_S: Final = 12.0
"""After this the daemon goes anyway: its stream ends, and the autopilot's own failsafe acts."""

ORDER_OF: Final = {"hold": Event.HOLD, "land": Event.LAND, "return": Event.RETURN}

_TAKEN: Final = {State.HOLDING: Mode.HOLD, State.RETURNING: Mode.RETURN, State.LANDING: Mode.LAND}


class ShutdownHandover:
    """The memory of an ending: which order was meant, whether it was given, and since when."""

    def __init__(self, order: Event, now_s: float) -> None:
        self._order = order
        self._since_s = now_s
        self._given = False

    def orders(self, flight: Flight) -> tuple[Event, ...]:
        """The order that hands the vehicle over, once."""
        if self._given or flight.state in FINAL | ON_GROUND:
            return ()
        self._given = True
        # What is just arming has not left the ground: nothing is to be handed over, only called off.
        return (Event.ABORT if flight.state is State.ARMING else self._order,)

    def finished(self, flight: Flight, now_s: float) -> bool:
        """True once there is nothing more to hand over, or no more time."""
        if flight.state in FINAL | ON_GROUND or now_s - self._since_s > LIMIT_S:
            return True
        taken = _TAKEN.get(flight.state)
        return taken is not None and flight.mode_name == str(taken)
