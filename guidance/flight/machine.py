"""The flight: what was heard and ordered goes in, what to say to the vehicle comes out. No clock, no I/O.

One step a guidance cycle: fold what was heard, find what happened, follow the table, and let the state say what goes
out. The step is the same in real time, in virtual time and in replay.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from guidance.autopilots import HEARTBEAT, Mode
from guidance.control import Envelope, FenceGeometry, Situation, measure_fence
from guidance.cycle import CycleInputs, CycleMemory, EvaderEstimate, hover, play
from guidance.flight.detection import EventContext, events, fit
from guidance.flight.echo import Echo
from guidance.flight.inputs_outputs import ORDERS, Happening, Inputs, Outputs
from guidance.flight.local_frame import difference, polygon_about_home, shifted
from guidance.flight.readiness import Check, checks
from guidance.flight.requests import HoldHandover, Pacing, requests_in
from guidance.flight.settings import AfterCapture, EngageOn, FlightSettings
from guidance.flight.table import (
    BEFORE_FLIGHT,
    FINAL,
    HANDING_OVER,
    OUR_MODES,
    SETPOINT_STATES,
    Event,
    State,
    next_state,
)
from guidance.flight.tracking import Tracking
from guidance.frames import LocalFrame, Vector
from guidance.game import horizontal_speed
from guidance.messages import Heartbeat, LocalPosition, Request, Setpoint
from guidance.monitor import Alarm, MonitorMemory, watch
from guidance.vehicle import VehicleState, observe

if TYPE_CHECKING:
    from guidance.certificate import Certificate

INVITE_AFTER_S = 1.0
"""How long after standing by a neutral stream begins, where a pilot is to engage: the hold comes first."""

_FOUND_ARMED = {
    Event.HOLD: Event.HOLD_ARMED,
    Event.RETURN: Event.RETURN_ARMED,
    Event.LAND: Event.LAND_ARMED,
    Event.ABORT: Event.LAND_ARMED,
}
"""What an order is to a vehicle that was armed already when guidance was started."""


class Flight:
    """One flight of one vehicle."""

    def __init__(self, settings: FlightSettings) -> None:
        self.settings = settings
        self.state = State.CONNECTING
        self.vehicle = VehicleState()
        self.tracking = Tracking(settings.cycle, settings.autopilot)
        self._cycle = settings.cycle
        self._home_in: tuple[Vector, LocalFrame] | None = None
        self._taken_up_ned_m: Vector = (0.0, 0.0, 0.0)
        self._position_ned_m: Vector | None = None
        self._fence: FenceGeometry | None = None
        self._evader: EvaderEstimate | None = None
        self._echo = Echo()
        self._foreign = False
        self._rival = ""
        self._operator_s = math.inf
        self._memory = CycleMemory()
        self._certificate: Certificate | None = None
        self._monitor = MonitorMemory()
        self._alarm: Alarm | None = None
        self._other_mode_seen = False
        self._mode_left: Mode | None = None
        self._claimed = False
        self._chase_began_s = 0.0
        self._waits_for_us: HoldHandover | None = None
        self._checked = False
        self._last_s: float | None = None
        self._since_s = 0.0
        self._pacing = Pacing()
        self._resets_seen = 0
        self._reboots_seen = 0
        self._fault_handover: HoldHandover | None = None

    @property
    def fault(self) -> str | None:
        """The error of our own that ended the flight, if one did."""
        return None if self._fault_handover is None else self._fault_handover.fault

    @property
    def checked(self) -> bool:
        """Whether every check had passed when the vehicle was taken; if not, it is asked again before engaging."""
        return self._checked

    @property
    def leaving_mode(self) -> bool:
        """Whether HEARTBEAT still shows a mode that is not ours and that an order is to end."""
        return self._mode_left is not None and self._mode_left not in OUR_MODES[State.ENTERING]

    def follows(self, order: Event, now_s: float, refusals: Sequence[str] = ()) -> bool:
        """Whether an order would change the state now. Nothing is changed by asking."""
        if self._fault_handover is not None:
            return False
        event = self._meant(order, self._context(now_s, 0.0, refusals))
        return event is not None and next_state(self.state, event) is not self.state

    def checks(self, now_s: float) -> tuple[Check, ...]:
        """Show the readiness rows as they stand."""
        return checks(self.vehicle, self.settings.autopilot, now_s, battery_minimum=self._battery_needed())

    def _battery_needed(self) -> float:
        """The share of the charge that the checks ask for: before a flight to the fence and back, in it from here."""
        away = self._away_m()
        if self.state in BEFORE_FLIGHT or away is None:
            return self.settings.battery_to_start
        return self.settings.battery_needed(*away)

    @property
    def battery_needed(self) -> float:
        """The share of the charge below which the vehicle returns (in flight), or does not start (before it)."""
        return self._battery_needed()

    def operator_silence_s(self, now_s: float) -> float:
        """Seconds since a person's last order or sign of life; 0 before the first one."""
        return max(0.0, now_s - self._operator_s)

    def _away_m(self) -> tuple[float, float] | None:
        """How far from home, and how high above it."""
        here, home = self._position_ned_m, self.tracking.home_ned_m
        return None if here is None or home is None else (math.dist(here[:2], home[:2]), home[2] - here[2])

    @property
    def mode_name(self) -> str:
        """The autopilot's mode as HEARTBEAT shows it, for people."""
        mode = self._mode()
        return "unknown" if mode is None else str(mode)

    @property
    def mode_title(self) -> str:
        """The same as the autopilot's own pilots call it: OFFBOARD, GUIDED, RTL."""
        mode = self._mode()
        return "unknown" if mode is None else self.settings.autopilot.mode_title(mode)

    def step(self, inputs: Inputs) -> Outputs:
        """Run one cycle. Whatever goes wrong in it hands the vehicle to the autopilot's hold, and is the last.

        Raises:
            ValueError: If an order is none.
        """
        for order in inputs.orders:
            if order not in ORDERS:
                raise ValueError(f"order = {order!r}: allowed are {', '.join(sorted(ORDERS))}")
        try:
            if self._fault_handover is None:
                return self._step(inputs)
            self.vehicle = observe(self.vehicle, inputs.messages)  # for people to see
            return self._hand_over(inputs, self._fault_handover)
        except Exception as error:  # whatever it was: nobody else flies this vehicle
            return self.give_up(inputs, error)

    def give_up(self, inputs: Inputs, error: Exception) -> Outputs:
        """End the flight for an error of our own: hand a vehicle that flies by our setpoints to its hold, and yield.

        Args:
            inputs: Of the cycle that failed.
            error: What went wrong.
        """
        before, self.state = self.state, next_state(self.state, Event.FAULT)
        begun = self._fault_handover is None
        if self._fault_handover is None:
            ours = before in SETPOINT_STATES or (before is not self.state and self._mode() is Mode.GUIDED)
            self._fault_handover = HoldHandover(
                self.settings.autopilot, error, flown=ours and self.state is State.YIELDED
            )
        outputs = self._hand_over(inputs, self._fault_handover)
        if not begun:
            return outputs
        failed = Happening(inputs.now_s, Event.FAULT, before, self.state)
        return outputs._replace(happenings=(*outputs.happenings, failed), fault=self._fault_handover.fault)

    def _hand_over(self, inputs: Inputs, handover: HoldHandover) -> Outputs:
        unheeded = tuple(Happening(inputs.now_s, order, self.state, self.state) for order in inputs.orders)
        return Outputs(self.state, None, handover.requests(inputs.now_s, inputs.messages), unheeded, None)

    def _step(self, inputs: Inputs) -> Outputs:
        now_s = inputs.now_s
        dt_s = 0.0 if self._last_s is None else now_s - self._last_s
        if self._last_s is None:
            self._since_s = now_s
        self._last_s = now_s
        self._alarm = None
        if inputs.alive or inputs.orders or self._operator_s == math.inf:
            self._operator_s = now_s

        self.vehicle = observe(self.vehicle, inputs.messages)
        self.tracking.observe(self.vehicle, inputs.reports, in_flight=self.state not in BEFORE_FLIGHT)
        self._hear(inputs)
        happenings = tuple(self._follow(inputs, dt_s))
        requests = (
            *self._requests(now_s, fresh_heartbeat=_beat(inputs)),
            *self._beat_requests(now_s),
            *self._yielded_requests(inputs),
        )
        setpoint = self._setpoint(now_s, dt_s)
        if setpoint is None or self.state is State.STANDING_BY:
            self._echo.silent()
        else:
            self._echo.sent(now_s, setpoint)
        return Outputs(self.state, setpoint, requests, happenings, self._certificate, self._alarm)

    def _hear(self, inputs: Inputs) -> None:
        strange = self._echo.foreign
        self._echo.hear(inputs.messages, guided=self._mode() is Mode.GUIDED)
        # A pilot's takeover shows as strange setpoints before a HEARTBEAT tells of it: the next one must not.
        self._foreign = strange and self._echo.foreign and _beat(inputs)
        taken_up = difference(self.vehicle.jumped_ned_m, self.tracking.held_back_ned_m)
        self._memory = shifted(self._memory, difference(taken_up, self._taken_up_ned_m))
        self._taken_up_ned_m = taken_up
        home_ned_m, frame = self.tracking.home_ned_m, self.tracking.local_frame
        if home_ned_m is not None and frame is not None and (home_ned_m, frame) != self._home_in:
            self._home_in = home_ned_m, frame
            self._cycle = replace(self._cycle, envelope=self._about(home_ned_m, frame))
        local = self.vehicle.last(LocalPosition)
        if local is not None:
            self._position_ned_m = difference(local.position_ned_m, self.tracking.held_back_ned_m)
            self._fence = measure_fence(self._position_ned_m, self._cycle.envelope)
        for message in inputs.messages:
            if isinstance(message, Heartbeat) and message.received_s > self._since_s:
                mode = self.settings.autopilot.mode_of(message.custom_mode)
                self._other_mode_seen |= mode is not Mode.GUIDED
                if mode is not self._mode_left:
                    self._mode_left = None

    def _about(self, home_ned_m: Vector, frame: LocalFrame) -> Envelope:
        """Heights and fences count from home, which need not be the origin of the local frame."""
        envelope, corners_deg = self._cycle.envelope, self.settings.fence_corners_deg
        if corners_deg is not None:
            envelope = replace(envelope, fence_polygon=polygon_about_home(corners_deg, home_ned_m, frame))
        return replace(envelope, home_ned_m=home_ned_m)

    def _follow(self, inputs: Inputs, dt_s: float) -> Iterator[Happening]:
        for order in inputs.orders:
            event = self._meant(order, self._context(inputs.now_s, dt_s, inputs.refusals))
            refused = Happening(inputs.now_s, order, self.state, self.state)
            yield refused if event is None else self._change(inputs.now_s, event)
        context = self._context(inputs.now_s, dt_s, inputs.refusals)
        before, self._rival = self._rival, context.rival
        if context.rival and not before and not self.settings.hold_on_rival:
            yield Happening(inputs.now_s, Event.RIVAL, self.state, self.state)
        for event in events(context):
            yield self._change(inputs.now_s, event)
            return  # the most severe only: the state it leads to is judged by the next cycle

    def _meant(self, order: Event, context: EventContext) -> Event | None:
        """Return what an order is to this vehicle as it is now, None where it must not be followed."""
        if order is Event.START and self.vehicle.armed and not self.vehicle.on_ground:
            # A vehicle that is up already is taken over in its hold, without arming or climbing.
            piloted = self.settings.engage_on is EngageOn.PILOT_MODE
            return Event.ALOFT if piloted or self._mode() in OUR_MODES[State.STANDING_BY] else None
        if order is Event.ENGAGE and (self.leaving_mode or not (self._checked or fit(context))):
            return None
        if self.state in BEFORE_FLIGHT and self.vehicle.armed:
            return _FOUND_ARMED.get(order, order)
        return order

    def _change(self, now_s: float, event: Event) -> Happening:
        before, after = self.state, next_state(self.state, event)
        if after is not before:
            self.state, self._since_s = after, now_s
            self._pacing.begin(now_s)
            self._resets_seen, self._reboots_seen = self.vehicle.resets, self.vehicle.reboots
            self._certificate, self._other_mode_seen = None, False
            self._note_handover(before, after)
            lost = after is State.YIELDED and event in {Event.TELEMETRY_LOST, Event.LOOP_STOPPED}
            if lost and before in SETPOINT_STATES and self.settings.autopilot.waits_in_guided:
                self._waits_for_us = HoldHandover(self.settings.autopilot)
            if after not in SETPOINT_STATES or before not in SETPOINT_STATES:
                self._memory, self._monitor = CycleMemory(), MonitorMemory()
            if after is State.ENGAGED and before is not State.PAUSED:
                self._chase_began_s = now_s
            if after is State.ON_STATION:
                self._monitor = MonitorMemory()  # the promise is kept: an evader that gets away begins a new one
        return Happening(now_s, event, before, after)

    def _note_handover(self, before: State, after: State) -> None:
        self._checked |= before is State.READY and after is not State.CHECKING
        self._claimed |= after not in BEFORE_FLIGHT | HANDING_OVER | FINAL
        known = before in BEFORE_FLIGHT or self._mode() in OUR_MODES[before]
        self._mode_left = self._mode() if known and after in HANDING_OVER else None

    def _context(self, now_s: float, dt_s: float, refusals: Sequence[str]) -> EventContext:
        return EventContext(
            now_s=now_s,
            dt_s=dt_s,
            state=self.state,
            since_s=self._since_s,
            settings=self.settings,
            vehicle=self.vehicle,
            mode=self._mode(),
            resets_seen=self._resets_seen,
            reboots_seen=self._reboots_seen,
            evader_silence_s=self.tracking.silence_s(now_s),
            envelope=self._cycle.envelope,
            position_ned_m=self._position_ned_m,
            fence=self._fence,
            evader_ned_m=None if self._evader is None else self._evader.position_ned_m,
            start_ned_m=self._start_ned_m(),
            home_ned_m=self.tracking.home_ned_m,
            certificate=self._certificate,
            refusals=refusals,
            foreign=self._foreign,
            other_mode_seen=self._other_mode_seen,
            mode_left=self._mode_left,
            chase_s=now_s - self._chase_began_s,
            rival=self.tracking.rival(now_s),
            battery_needed=self._battery_needed(),
            operator_silence_s=self.operator_silence_s(now_s),
        )

    def _start_ned_m(self) -> tuple[float, float, float] | None:
        start, frame = self.settings.start_game_m, self.tracking.game_frame
        return None if start is None or frame is None else frame.position_to_ned(start)

    def _mode(self) -> Mode | None:
        heartbeat = self.vehicle.last(Heartbeat)
        return None if heartbeat is None else self.settings.autopilot.mode_of(heartbeat.custom_mode)

    def _requests(self, now_s: float, *, fresh_heartbeat: bool) -> tuple[Request, ...]:
        if self.state in FINAL or not self._pacing.is_due(
            self.state,
            now_s,
            fresh_heartbeat=fresh_heartbeat,
            asked_once=self._mode_left is Mode.OTHER,
            streamed_first=self.settings.autopilot.stream_before_guided,
        ):
            return ()
        place = None
        start_ned_m, frame = self._start_ned_m(), self.tracking.local_frame
        if start_ned_m is not None and frame is not None:
            place = frame.wgs84_from_ned(start_ned_m)
        return requests_in(self.state, self.settings, self.vehicle, self._mode(), place)

    def _yielded_requests(self, inputs: Inputs) -> tuple[Request, ...]:
        """Ask for the hold after a loss where the autopilot would else wait for our setpoints for ever."""
        if self._waits_for_us is None:
            return ()
        fresh = [message for message in inputs.messages if message.received_s > self._since_s]
        return self._waits_for_us.requests(inputs.now_s, fresh)

    def _beat_requests(self, now_s: float) -> tuple[Request, ...]:
        wanted = self.state is State.ENTERING or (self.state in SETPOINT_STATES and self._echo.suspicious)
        if not wanted or not self._pacing.is_beat_due(now_s):
            return ()
        return (self.settings.autopilot.request_message(HEARTBEAT),)

    def _setpoint(self, now_s: float, dt_s: float) -> Setpoint | None:
        leaving = self.state in HANDING_OVER and self._mode() is Mode.GUIDED and self._claimed
        self._evader = None
        local, position_ned_m = self.vehicle.last(LocalPosition), self._position_ned_m
        inviting = self.state is State.STANDING_BY and self.settings.engage_on is EngageOn.PILOT_MODE
        inviting = inviting and now_s - self._since_s > INVITE_AFTER_S
        if local is None or position_ned_m is None or not (self.state in SETPOINT_STATES or leaving or inviting):
            return None
        if inviting:
            # Neutral: what a pilot flies into meanwhile must not be remembered as a height to go back to.
            self._memory = CycleMemory(limits=self._memory.limits)
        evader = self._evader = self.tracking.evader(now_s)
        here = Situation(
            position_ned_m,
            local.velocity_ned_m_s,
            self.vehicle.yaw_rad,
            None if evader is None else evader.position_ned_m,
            None if evader is None else evader.velocity_ned_m_s,
            self.vehicle.acceleration_ned_m_s2,
        )
        inputs = CycleInputs(dt_s, here, evader, self.tracking.game_frame, self._fence)
        playing = self.state is State.ENGAGED or (
            self.state is State.ON_STATION and self.settings.after_capture is AfterCapture.SHADOW
        )
        played = play if playing and inputs.evader is not None else hover
        output = played(inputs, self._cycle, self._memory)
        self._memory = output.memory
        if output.certificate is not None and self.settings.reserve is not None:
            output = output._replace(certificate=output.certificate._replace(battery_needed=self._battery_needed()))
        if output.certificate is not None:
            self._certificate = output.certificate
        if output.certificate is not None and self.state is State.ENGAGED:
            self._monitor, self._alarm = watch(
                self._monitor,
                now_s,
                output.certificate,
                with_target=self._cycle.target_game_m is not None,
                speed_m_s=float(horizontal_speed(self._cycle.speed_set)),
                slack_s=self.settings.guarantee_slack_s,
            )
        return output.setpoint


def _beat(inputs: Inputs) -> bool:
    """Whether a HEARTBEAT came in this cycle."""
    return any(isinstance(message, Heartbeat) for message in inputs.messages)
