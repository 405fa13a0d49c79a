"""Messages that a flight sends in a cycle: the setpoint of its state, and requests until their effect is seen."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from guidance.autopilots import Autopilot, Mode
from guidance.autopilots.description import GPS_GLOBAL_ORIGIN, HEARTBEAT, HOME_POSITION
from guidance.cycle import Alarm, CycleInputs, CycleMemory, MonitorMemory, hover, play, watch
from guidance.flight.detection import Stage, arming_refusal
from guidance.flight.observed import Observed
from guidance.flight.settings import AfterCapture, EngageOn, FlightSettings
from guidance.flight.table import ASKED_MODES, FINAL, HANDING_OVER, SETPOINT_STATES, State
from guidance.frames import Ned
from guidance.game.arrays import FloatArray
from guidance.messages import Heartbeat, Home, Message, ParameterRequest, Request, Setpoint
from guidance.strategies.own import Answer, Ask

if TYPE_CHECKING:
    from guidance.cycle import Certificate

REPEAT_S: Final = 1.5
"""Period of repeating a request without effect, and only in a cycle with a HEARTBEAT.

HEARTBEAT is up to a second old. A blind repetition could take the vehicle back from a pilot who has just taken over.
"""

BEAT_EVERY_S: Final = 0.1
"""Period of requesting a HEARTBEAT while arming, entering the guided mode, or suspecting a pilot's setpoints.

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


def requests_in(
    state: State, settings: FlightSettings, observed: Observed, *, arms: bool = False
) -> tuple[Request, ...]:
    """Return the requests of a state.

    They include a mode that HEARTBEAT shows already: it is up to a second old, and another one may have been requested.

    Args:
        state: The state.
        settings: Of the flight.
        observed: Everything received so far.
        arms: Whether the vehicle may be armed, see `detection.arming_refusal`.
    """
    autopilot = settings.autopilot
    home = observed.vehicle.latest.get(Home)
    frame = observed.tracking.local_frame
    asked: tuple[Request, ...] = ()
    match state:
        case State.CHECKING | State.READY:
            # Both are sent once, or when they change: a lost message would leave an old place.
            places = tuple(
                autopilot.request_message(message) for message in (HOME_POSITION, GPS_GLOBAL_ORIGIN)
            )
            loss_times = tuple(ParameterRequest(name) for name in autopilot.loss_times)
            streams = autopilot.stream_requests()
            asked = places if state is State.READY else (*streams, *places, *loss_times)
        case State.ARMING if arms or observed.mode is not autopilot.arming_mode:
            asked = (autopilot.arm() if arms else autopilot.set_mode(autopilot.arming_mode),)
        case State.CLIMBING if home is not None and observed.on_ground:
            asked = (
                autopilot.takeoff(
                    height_m=settings.takeoff_height_m, home_amsl_m=home.altitude_amsl_m
                ),
            )
        case State.POSITIONING if observed.start_ned_m is not None and frame is not None:
            latitude, longitude, amsl = frame.wgs84_from_ned(observed.start_ned_m)
            asked = (
                autopilot.reposition(
                    latitude_deg=latitude, longitude_deg=longitude, altitude_amsl_m=amsl.metres
                ),
            )
        case State.STANDING_BY if (
            settings.engage_on is EngageOn.PILOT_MODE and observed.mode is Mode.HOLD
        ):
            # PX4 returns to OFFBOARD by itself when setpoints return after a loss, unless Hold was requested.
            asked = (autopilot.set_mode(Mode.HOLD),)
        case State.ENTERING:
            asked = (autopilot.set_mode(Mode.GUIDED),)
        case State.HOLDING | State.RETURNING | State.LANDING:
            asked = ending_requests(ASKED_MODES[state], autopilot, observed)
    return asked


def ending_requests(mode: Mode, autopilot: Autopilot, observed: Observed) -> tuple[Request, ...]:
    """Return the requests that end a flight by a mode, or that undo its start if it has not left the ground."""
    if not observed.has_flown:
        # In case it leaves the ground just now, it is to hold.
        return (autopilot.set_mode(Mode.HOLD), autopilot.disarm())
    if observed.mode is mode is autopilot.arming_mode:
        # It flies to the start in its hold too.
        return (autopilot.set_mode(mode), autopilot.stop())
    return (autopilot.set_mode(mode),)


class Asking:
    """The requests of each cycle: those of the state, repetitions, requests for HEARTBEAT, the hold of a handover."""

    def __init__(self, settings: FlightSettings) -> None:
        self._settings = settings
        self._asked_s = float("-inf")
        self._beat_asked_s = self._hold_asked_s = float("-inf")
        self._handing_over = self._at_once = False

    def hand_over(self, *, flown: bool = True, at_once: bool = False) -> None:
        """Request the hold until a HEARTBEAT shows another mode than the guided one.

        Args:
            flown: Whether the vehicle follows our setpoints; if not, there are no requests.
            at_once: Whether the first request goes immediately; if not, when a HEARTBEAT shows that the vehicle still
                waits for setpoints in the guided mode.
        """
        self._handing_over = flown
        self._at_once = at_once

    def requests(self, stage: Stage, observed: Observed, now_s: float) -> tuple[Request, ...]:
        """Return the requests of one cycle.

        Args:
            stage: State of the flight.
            observed: Everything received so far.
            now_s: Time.
        """
        requests: tuple[Request, ...] = ()
        arms = (
            stage.state is State.ARMING
            and bool(observed.beats)
            and not arming_refusal(observed, self._settings.autopilot, now_s)
        )
        # A request is repeated only in a cycle with a HEARTBEAT.
        if (
            (observed.beats or self._asked_s < stage.since_s)
            and stage.state not in FINAL
            and self._is_due(stage, observed, now_s, arms=arms)
        ):
            self._asked_s = now_s
            requests = requests_in(stage.state, self._settings, observed, arms=arms)
            stage.may_be_armed |= arms
        uncertain = stage.state in {State.ARMING, State.ENTERING}
        if stage.state in SETPOINT_STATES and observed.echo.strange_s:
            uncertain = True
        if uncertain and now_s - self._beat_asked_s >= BEAT_EVERY_S - _SAME_S:
            self._beat_asked_s = now_s
            requests = (*requests, self._settings.autopilot.request_message(HEARTBEAT))
        if self._handing_over:
            fresh = [message for message in observed.messages if message.received_s > stage.since_s]
            requests = (*requests, *self.hold_requests(now_s, fresh))
        return requests

    def hold_requests(self, now_s: float, messages: Sequence[Message]) -> tuple[Request, ...]:
        """Return the requests of a handover in one cycle."""
        modes = [
            self._settings.autopilot.mode_of(message.custom_mode)
            for message in messages
            if isinstance(message, Heartbeat)
        ]
        if not self._at_once and any(mode is not Mode.GUIDED for mode in modes):
            self._handing_over = False
        if not self._handing_over:
            return ()
        if not self._at_once and (not modes or now_s - self._hold_asked_s < REPEAT_S):
            return ()
        self._at_once = False
        self._hold_asked_s = now_s
        return (self._settings.autopilot.set_mode(Mode.HOLD),)

    def _is_due(self, stage: Stage, observed: Observed, now_s: float, *, arms: bool) -> bool:
        """True if the state's requests are due now, for the first time or again."""
        if arms and not stage.may_be_armed:
            return True
        if self._asked_s >= stage.since_s:
            # After a repetition the pilot's next switch is intended.
            if stage.state is State.STANDING_BY or now_s - self._asked_s < REPEAT_S:
                return False
            piloted = stage.state in HANDING_OVER and Mode.OTHER in stage.left
            done = observed.mode is ASKED_MODES.get(stage.state)
            if observed.has_flown and (piloted or done):
                return False
        if stage.state is not State.ENTERING:
            return True
        # The HEARTBEAT of the order's own cycle may be older than the order.
        streamed_s = STREAM_FIRST_S if self._settings.autopilot.stream_before_guided else 0.0
        in_state_s = now_s - stage.since_s
        if in_state_s <= streamed_s + _SAME_S:
            return False
        return True if observed.beats else in_state_s >= UNHEARD_S - _SAME_S


class Playing:
    """State of the game between cycles.

    Attributes:
        certificate: The last one of the present state.
        alarm: This cycle's.
        recorded: The action that was recorded in this cycle, if it is replayed.
        answer: The action of the user's policy in this cycle.
    """

    def __init__(self, settings: FlightSettings, ask: Ask | None = None) -> None:
        self._settings = settings
        self._ask = ask
        self.recorded: tuple[float, ...] | None = None
        self.answer: tuple[float, ...] | None = None
        self.memory = CycleMemory()
        self.monitor = MonitorMemory()
        self.certificate: Certificate | None = None
        self.alarm: Alarm | None = None

    def _asked(self, observation: FloatArray) -> Answer:
        """Ask the user's policy. A replay runs no user's code: it has the recorded answers."""
        if self.recorded is not None:
            return self.recorded
        if self._ask is None:
            return "there is no policy here to ask"
        answer = self._ask(observation)
        if not isinstance(answer, str):
            self.answer = answer
        return answer

    def change(self, before: State, after: State) -> None:
        """Enter a state and drop the certificate of the last one."""
        self.certificate = None
        if after not in SETPOINT_STATES or before not in SETPOINT_STATES:
            self.memory = CycleMemory()
            self.monitor = self.monitor.anew()
        if after is State.ON_STATION:
            # The promise is kept: an evader that gets away begins a new one
            self.monitor = self.monitor.anew()
        if after is State.PAUSED:
            self.monitor = self.monitor.restarted()  # no promise covers a pause

    def switch(self) -> None:
        """Play against another evader: no promise covers that one."""
        self.certificate = None
        self.monitor = self.monitor.anew()
        self.memory = self.memory._replace(optimal_game_m_s=None)

    def move(self, by_ned_m: Ned) -> None:
        """Move the remembered positions (of the hover and the drift estimate) with the local frame.

        The vehicle is then held where it is, not sent to where it now believes that it was.
        """
        memory = self.memory
        drift = memory.follow.drift
        if drift.position_ned_m is not None:
            drift = drift._replace(position_ned_m=drift.position_ned_m + by_ned_m)
        place_m = memory.place
        if place_m is not None:
            place_m = (place_m[0] + by_ned_m.north, place_m[1] + by_ned_m.east)
        height = memory.height
        if height is not None:
            height = height._replace(down_m=height.down_m + by_ned_m.down)
        self.memory = memory._replace(
            follow=memory.follow._replace(drift=drift), place=place_m, height=height
        )

    def setpoint(
        self, inputs: CycleInputs, observed: Observed, state: State, now_s: float
    ) -> Setpoint:
        """Make this cycle's setpoint.

        Args:
            inputs: Of the guidance in this cycle.
            observed: Everything received so far.
            state: State of the flight.
            now_s: Time.
        """
        settings = self._settings
        if state is State.STANDING_BY:
            # Neutral stream: do not remember a height while the pilot flies.
            self.memory = CycleMemory(limits=self.memory.limits)
        shadowing = state is State.ON_STATION and settings.after_capture is AfterCapture.SHADOW
        guide = (
            play if (state is State.ENGAGED or shadowing) and inputs.evader is not None else hover
        )
        output = guide(inputs._replace(ask=self._asked), observed.cycle, self.memory)
        self.memory = output.memory
        if (certificate := output.certificate) is not None:
            if settings.reserve is not None:
                certificate = certificate._replace(battery_needed=observed.battery_needed)
            self.certificate = certificate
            if state is State.ENGAGED:
                aimed = settings.cycle.target_game_m is not None
                speed_m_s = settings.cycle.game.pursuer.horizontal_m_s
                slack_s = settings.guarantee_slack_s
                self.monitor, self.alarm = watch(
                    self.monitor,
                    now_s,
                    certificate,
                    with_target=aimed,
                    speed_m_s=speed_m_s,
                    slack_s=slack_s,
                )
        return output.setpoint
