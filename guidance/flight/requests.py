"""Requests to the vehicle in each state and after an internal error, repeated until their effect is seen."""

import traceback
from collections.abc import Sequence
from typing import Final

from guidance.autopilots import Autopilot, Mode
from guidance.autopilots.description import GPS_GLOBAL_ORIGIN, HEARTBEAT, HOME_POSITION
from guidance.flight.heard import Heard
from guidance.flight.settings import EngageOn, FlightSettings
from guidance.flight.table import FINAL, SETPOINT_STATES, State
from guidance.frames import Amsl
from guidance.messages import Heartbeat, Home, Message, Request
from guidance.vehicle import VehicleState

REPEAT_S: Final = 1.5
"""Period of repeating a request without effect, and only in a cycle with a HEARTBEAT.

HEARTBEAT is up to a second old. A blind repetition could take the vehicle back from a pilot who has just taken over.
"""

BEAT_EVERY_S: Final = 0.1
"""Period of requesting a HEARTBEAT while entering the guided mode, or when foreign setpoints may be a pilot's.

HEARTBEAT shows the mode and otherwise arrives once per second.
"""

STREAM_FIRST_S: Final = 0.2
"""Time of streaming a hover before requesting the guided mode of an autopilot that needs a stream (PX4).

One setpoint is enough if it arrives.
"""

UNHEARD_S: Final = 0.4
"""After an engage order, the guided mode is requested after this time even without a new HEARTBEAT."""

_SAME_S: Final = 1e-6
"""Tolerance for rounding, since cycles fall exactly on these times."""

_MODE_OF_STATE = {
    State.ENTERING: Mode.GUIDED,
    State.HOLDING: Mode.HOLD,
    State.RETURNING: Mode.RETURN,
    State.LANDING: Mode.LAND,
}


def requests_in(
    state: State,
    settings: FlightSettings,
    vehicle: VehicleState,
    mode: Mode | None,
    start: tuple[float, float, Amsl] | None,
) -> tuple[Request, ...]:
    """Return the requests of a state; none if their effect is already there.

    Args:
        state: State of the flight.
        settings: Settings of the flight.
        vehicle: Last known state of the vehicle.
        mode: Mode in HEARTBEAT.
        start: Latitude and longitude in degrees and altitude of the stand-by position, if there is one.
    """
    autopilot = settings.autopilot
    match state:
        case State.CHECKING:
            origin = autopilot.request_message(GPS_GLOBAL_ORIGIN)
            return (*autopilot.stream_requests(), autopilot.request_message(HOME_POSITION), origin)
        case State.ARMING:
            return (autopilot.set_mode(autopilot.arming_mode), autopilot.arm())
        case State.CLIMBING:
            return _takeoff(settings, vehicle)
        case State.POSITIONING if start is not None:
            latitude_deg, longitude_deg, altitude = start
            return (
                autopilot.reposition(
                    latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude_amsl_m=altitude.metres
                ),
            )
        case _:
            return _mode_request(state, settings, mode)


def _mode_request(state: State, settings: FlightSettings, mode: Mode | None) -> tuple[Request, ...]:
    wanted = _MODE_OF_STATE.get(state)
    if state is State.STANDING_BY and settings.engage_on is EngageOn.PILOT_MODE and mode is Mode.HOLD:
        # PX4 returns to OFFBOARD by itself when setpoints return after a loss, unless Hold was requested.
        wanted = Mode.HOLD
    elif mode is wanted:
        return ()
    return () if wanted is None else (settings.autopilot.set_mode(wanted),)


def _takeoff(settings: FlightSettings, vehicle: VehicleState) -> tuple[Request, ...]:
    home = vehicle.last(Home)
    if home is None or not vehicle.on_ground:
        return ()
    return (settings.autopilot.takeoff(height_m=settings.takeoff_height_m, home_amsl_m=home.altitude_amsl_m),)


class HoldHandover:
    """Requests only the hold until a HEARTBEAT shows another mode than the guided one.

    Attributes:
        fault: The internal error that ended the flight. With it, the hold is requested immediately; without it, only
            when a HEARTBEAT shows that the vehicle still waits in the guided mode.
    """

    def __init__(self, autopilot: Autopilot, error: Exception | None = None, *, flown: bool = True) -> None:
        self._autopilot = autopilot
        self._asking = flown
        self._asked_s = float("-inf")
        self.fault = None if error is None else _described(error)

    def requests(self, now_s: float, messages: Sequence[Message]) -> tuple[Request, ...]:
        """Return the requests of one cycle."""
        at_once = self.fault is not None and self._asked_s == float("-inf")
        modes = [self._autopilot.mode_of(one.custom_mode) for one in messages if isinstance(one, Heartbeat)]
        if not at_once and any(mode is not Mode.GUIDED for mode in modes):
            self._asking = False
        due = at_once or (modes and now_s - self._asked_s >= REPEAT_S)
        if not (self._asking and due):
            return ()
        self._asked_s = now_s
        return (self._autopilot.set_mode(Mode.HOLD),)


class Asking:
    """The requests of each cycle: those of the state, repetitions, and requests for HEARTBEAT."""

    def __init__(self, settings: FlightSettings) -> None:
        self._settings = settings
        self._since_s = 0.0
        self._asked_s = self._beat_asked_s = float("-inf")
        self._handover: HoldHandover | None = None

    def begin(self, now_s: float) -> None:
        """Enter a state."""
        self._since_s, self._asked_s = now_s, float("-inf")

    def await_hold(self) -> None:
        """Request the hold after a loss, for an autopilot that would wait for setpoints in the guided mode."""
        self._handover = HoldHandover(self._settings.autopilot)

    def requests(self, state: State, heard: Heard, now_s: float, *, asked_once: bool) -> tuple[Request, ...]:
        """Return the requests of one cycle.

        Args:
            state: State of the flight.
            heard: Everything received so far.
            now_s: Time.
            asked_once: Whether the vehicle is in a pilot's mode, for which a request is made only once.
        """
        asked: tuple[Request, ...] = ()
        if state not in FINAL and self._is_due(state, now_s, fresh_heartbeat=bool(heard.beats), asked_once=asked_once):
            asked = self._of_state(state, heard)
        if state is State.ENTERING or (state in SETPOINT_STATES and heard.echo.suspicious):
            asked = (*asked, *self._beat(now_s))
        if self._handover is not None:
            fresh = [message for message in heard.messages if message.received_s > self._since_s]
            asked = (*asked, *self._handover.requests(now_s, fresh))
        return asked

    def _of_state(self, state: State, heard: Heard) -> tuple[Request, ...]:
        place, frame = None, heard.tracking.local_frame
        if heard.start_ned_m is not None and frame is not None:
            place = frame.wgs84_from_ned(heard.start_ned_m)
        return requests_in(state, self._settings, heard.vehicle, heard.mode, place)

    def _is_due(self, state: State, now_s: float, *, fresh_heartbeat: bool, asked_once: bool) -> bool:
        """Whether the state's requests are due now; if so, note them as made."""
        if now_s - self._asked_s < REPEAT_S:
            return False
        entering, repeated = state is State.ENTERING, self._asked_s >= self._since_s
        if repeated and (state is State.STANDING_BY or asked_once):
            return False  # the pilot's next switch is intended
        if (repeated or (entering and now_s - self._since_s < UNHEARD_S - _SAME_S)) and not fresh_heartbeat:
            return False
        streamed_s = STREAM_FIRST_S if self._settings.autopilot.stream_before_guided else 0.0
        if entering and now_s - self._since_s <= streamed_s + _SAME_S:
            return False  # the HEARTBEAT of the order's own cycle may be older than the order
        self._asked_s = now_s
        return True

    def _beat(self, now_s: float) -> tuple[Request, ...]:
        """Request a HEARTBEAT at most every `BEAT_EVERY_S`."""
        if now_s - self._beat_asked_s < BEAT_EVERY_S - _SAME_S:
            return ()
        self._beat_asked_s = now_s
        return (self._settings.autopilot.request_message(HEARTBEAT),)


def _described(error: Exception) -> str:
    frames = traceback.extract_tb(error.__traceback__)
    where = f" ({frames[-1].name}, line {frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}: {error}{where}"
