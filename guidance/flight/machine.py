"""The flight: maps received messages and orders to setpoints and requests. It has no clock and no I/O.

Each cycle has four steps: update with the inputs (`heard`), detect events (`detection`), follow the transition table
(`table`), and compute the setpoint (`playing`) and requests (`requests`) of the state. The steps are the same in real
time, in virtual time and in replay.
"""

import math
from collections.abc import Iterator, Sequence

from guidance.autopilots import Mode
from guidance.flight.detection import EventContext, battery_low, detail_of, events, fit
from guidance.flight.heard import Heard
from guidance.flight.inputs_outputs import ORDERS, Authority, Happening, Inputs, Outputs
from guidance.flight.playing import Playing
from guidance.flight.readiness import TELEMETRY_LIMIT_S, Check, checks, evader_refusal
from guidance.flight.requests import Asking, HoldHandover
from guidance.flight.settings import EngageOn, FlightSettings
from guidance.flight.table import (
    BEFORE_FLIGHT,
    FINAL,
    HANDING_OVER,
    OUR_MODES,
    SETPOINT_STATES,
    Event,
    State,
    is_done,
    next_state,
)
from guidance.flight.tracking import NOWHERE, Tracking
from guidance.messages import LocalPosition, Setpoint, SystemStatus
from guidance.vehicle import VehicleState

INVITE_AFTER_S = 1.0
"""Time after standing by until the neutral stream for a pilot's engagement begins; the hold comes first."""

_FOUND_ARMED = {
    Event.HOLD: Event.HOLD_ARMED,
    Event.RETURN: Event.RETURN_ARMED,
    Event.LAND: Event.LAND_ARMED,
    Event.ABORT: Event.LAND_ARMED,
}
"""Events of orders to a vehicle that was armed before guidance started."""


class Flight:
    """One flight of one vehicle."""

    def __init__(self, settings: FlightSettings) -> None:
        self.settings = settings
        self.state = State.CONNECTING
        self._heard = Heard(settings)
        self._playing = Playing(settings)
        self._asking = Asking(settings)
        self._last_s: float | None = None
        self._since_s = 0.0
        self._operator_s = math.inf
        self._chase_began_s = 0.0
        self._rival = ""
        self._other_mode_seen = False
        self._mode_left: Mode | None = None
        self._claimed = False
        self._checked = False
        self._resets_seen = 0
        self._reboots_seen = 0
        self._fault_handover: HoldHandover | None = None
        self._battery_was_low = False
        self.cause: Happening | None = None

    @property
    def ordered_by_operator(self) -> bool:
        """Whether an operator's order led to the present state. A mission cannot change it then."""
        return self.cause is not None and self.cause.by is Authority.OPERATOR

    @property
    def vehicle(self) -> VehicleState:
        """Last known state of the vehicle."""
        return self._heard.vehicle

    @property
    def tracking(self) -> Tracking:
        """The evader's track, home and the frames."""
        return self._heard.tracking

    @property
    def fault(self) -> str | None:
        """The internal error that ended the flight, if any."""
        return None if self._fault_handover is None else self._fault_handover.fault

    @property
    def checked(self) -> bool:
        """Whether all checks had passed at the start; if not, they are repeated before engaging."""
        return self._checked

    @property
    def leaving_mode(self) -> bool:
        """Whether HEARTBEAT still shows a foreign mode that an order is ending."""
        return self._mode_left is not None and self._mode_left not in OUR_MODES[State.ENTERING]

    @property
    def mode_name(self) -> str:
        """Name of the mode in HEARTBEAT."""
        return "unknown" if self._heard.mode is None else str(self._heard.mode)

    @property
    def mode_title(self) -> str:
        """Name of the mode in a ground station: OFFBOARD, GUIDED, RTL."""
        mode = self._heard.mode
        return "unknown" if mode is None else self.settings.autopilot.mode_title(mode)

    @property
    def battery_needed(self) -> float:
        """Share of the charge below which it returns: on the ground for the whole fence, in flight from here."""
        if self.settings.reserve is None:
            return self.settings.battery_minimum
        here, home = self._heard.position_ned_m, self._heard.tracking.home_ned_m
        if self.state in BEFORE_FLIGHT or here is None or home is None:
            return self.settings.reserve.needed(self.settings.farthest_m, self.settings.takeoff_height_m)
        return self.settings.reserve.needed(math.dist(here[:2], home[:2]), home[2] - here[2])

    def operator_silence_s(self, now_s: float) -> float:
        """Seconds since the operator's last order or sign of life; 0 before the first one."""
        return max(0.0, now_s - self._operator_s)

    def checks(self, now_s: float) -> tuple[Check, ...]:
        """Return the readiness checks."""
        return checks(self.vehicle, self.settings.autopilot, now_s, battery_minimum=self.battery_needed)

    def evader_refusal(self, now_s: float) -> str:
        """Return why this evader may not be engaged now; empty if it may."""
        return evader_refusal(self.tracking, self.settings, now_s)

    def follows(self, order: Event, now_s: float, refusals: Sequence[str] = ()) -> bool:
        """Whether an order would change the state now."""
        if self._fault_handover is not None:
            return False
        event = self._meant(order, self._context(now_s, 0.0, refusals))
        return event is not None and next_state(self.state, event) is not self.state

    def step(self, inputs: Inputs) -> Outputs:
        """Run one cycle. An exception hands the vehicle to the autopilot's hold and ends the flight.

        Raises:
            ValueError: If an order is unknown.
        """
        for order in (*inputs.orders, *inputs.mission):
            if order not in ORDERS:
                raise ValueError(f"order = {order!r}: allowed are {', '.join(sorted(ORDERS))}")
        try:
            if self._fault_handover is not None:
                self._heard.vehicle_says(inputs.messages)  # for display
                return self._hand_over(inputs, self._fault_handover)
            dt_s = self._take_in(inputs)
            happenings = tuple(self._follow(inputs, dt_s))
            pilots = self._mode_left is Mode.OTHER
            requests = self._asking.requests(self.state, self._heard, inputs.now_s, asked_once=pilots)
            setpoint = None
            if self._sends(inputs.now_s):
                needed = math.nan if self.settings.reserve is None else self.battery_needed
                setpoint = self._playing.setpoint(self._heard, self.state, inputs.now_s, dt_s, battery_needed=needed)
            self._note_setpoint(setpoint, inputs.now_s)
        except Exception as error:  # no one else flies this vehicle
            return self.give_up(inputs, error)
        certificate, alarm = self._playing.certificate, self._playing.alarm
        return Outputs(self.state, setpoint, requests, happenings, certificate, alarm, cause=self.cause)

    def give_up(self, inputs: Inputs, error: Exception) -> Outputs:
        """End the flight after an internal error: request the hold if the vehicle follows our setpoints, and yield.

        Args:
            inputs: Inputs of the failed cycle.
            error: The exception.
        """
        before, self.state = self.state, next_state(self.state, Event.FAULT)
        begun = self._fault_handover is None
        if self._fault_handover is None:
            ours = before in SETPOINT_STATES or (before is not self.state and self._heard.mode is Mode.GUIDED)
            self._fault_handover = HoldHandover(
                self.settings.autopilot, error, flown=ours and self.state is State.YIELDED
            )
        outputs = self._hand_over(inputs, self._fault_handover)
        if not begun:
            return outputs
        failed = Happening(inputs.now_s, Event.FAULT, before, self.state, detail=self._fault_handover.fault or "")
        self.cause = failed
        return outputs._replace(
            happenings=(*outputs.happenings, failed), fault=self._fault_handover.fault, cause=self.cause
        )

    def _hand_over(self, inputs: Inputs, handover: HoldHandover) -> Outputs:
        unheeded = tuple(Happening(inputs.now_s, order, self.state, self.state, by) for by, order in _orders(inputs))
        requests = handover.requests(inputs.now_s, inputs.messages)
        return Outputs(self.state, None, requests, unheeded, None, cause=self.cause)

    def _take_in(self, inputs: Inputs) -> float:
        """Update with the inputs; return the time since the last cycle."""
        now_s, heard = inputs.now_s, self._heard
        dt_s = 0.0 if self._last_s is None else now_s - self._last_s
        if self._last_s is None:
            self._since_s = now_s
        self._last_s = now_s
        if inputs.alive or inputs.orders or self._operator_s == math.inf:
            self._operator_s = now_s
        heard.take_in(inputs, in_flight=self.state not in BEFORE_FLIGHT)
        if heard.moved_ned_m != NOWHERE:
            self._playing.move(heard.moved_ned_m)
        if heard.beats:
            self._note_modes()
        return dt_s

    def _note_modes(self) -> None:
        """Note the modes in HEARTBEAT since the state was entered."""
        for beat in self._heard.beats:
            if beat.received_s > self._since_s:
                mode = self.settings.autopilot.mode_of(beat.custom_mode)
                self._other_mode_seen |= mode is not Mode.GUIDED
                if mode is not self._mode_left:
                    self._mode_left = None

    def _follow(self, inputs: Inputs, dt_s: float) -> Iterator[Happening]:
        for by, order in _orders(inputs):
            event = None
            if by is Authority.OPERATOR or not self.ordered_by_operator:
                event = self._meant(order, self._context(inputs.now_s, dt_s, inputs.refusals))
            refused = Happening(inputs.now_s, order, self.state, self.state, by)
            yield refused if event is None else self._change(inputs.now_s, event, by)
        context = self._context(inputs.now_s, dt_s, inputs.refusals)
        before, self._rival = self._rival, context.rival
        if context.rival and not before and not self.settings.hold_on_rival:
            yield Happening(inputs.now_s, Event.RIVAL, self.state, self.state)
        for event in events(context):
            yield self._change(inputs.now_s, event, detail=detail_of(event, context))
            return  # only the most severe event; the next cycle judges the new state

    def _meant(self, order: Event, context: EventContext) -> Event | None:
        """Return the event of an order in the present situation, None if it must not be followed."""
        vehicle = context.vehicle
        if order is Event.START and vehicle.armed and not vehicle.on_ground:
            # An airborne vehicle is taken over in its hold, without arming or climbing.
            piloted = self.settings.engage_on is EngageOn.PILOT_MODE
            return Event.ALOFT if piloted or context.mode in OUR_MODES[State.STANDING_BY] else None
        if order is Event.ENGAGE and not self._may_engage(context):
            return None
        if self.state in BEFORE_FLIGHT and vehicle.armed:
            return _FOUND_ARMED.get(order, order)
        return order

    def _may_engage(self, context: EventContext) -> bool:
        if self.leaving_mode or context.refusals or self.evader_refusal(context.now_s):
            return False
        return self._checked or fit(context)

    def _change(self, now_s: float, event: Event, by: Authority = Authority.FLIGHT, detail: str = "") -> Happening:
        before, after = self.state, next_state(self.state, event)
        happening = Happening(now_s, event, before, after, by, detail)
        ordered = by is Authority.OPERATOR and is_done(event, after)
        if after is not before or ordered:
            self.cause = happening
            # A hold ordered while the battery is already low stands.
            low = battery_low(self.vehicle.last(SystemStatus), self.battery_needed)
            self._battery_was_low = low and ordered and after is State.HOLDING
        if after is not before:
            self.state, self._since_s = after, now_s
            self._resets_seen, self._reboots_seen = self.vehicle.resets, self.vehicle.reboots
            self._other_mode_seen = False
            self._note_handover(before, after)
            self._playing.change(before, after)
            self._asking.begin(now_s)
            lost = after is State.YIELDED and event in {Event.TELEMETRY_LOST, Event.LOOP_STOPPED}
            if lost and before in SETPOINT_STATES and self.settings.autopilot.waits_in_guided:
                self._asking.await_hold()
            if after is State.ENGAGED and before is not State.PAUSED:
                self._chase_began_s = now_s
        return happening

    def _note_handover(self, before: State, after: State) -> None:
        self._checked |= before is State.READY and after is not State.CHECKING
        self._claimed |= after not in BEFORE_FLIGHT | HANDING_OVER | FINAL
        mode = self._heard.mode
        known = before in BEFORE_FLIGHT or mode in OUR_MODES[before]
        self._mode_left = mode if known and after in HANDING_OVER else None

    def _context(self, now_s: float, dt_s: float, refusals: Sequence[str]) -> EventContext:
        heard, playing = self._heard, self._playing
        return EventContext(
            now_s=now_s,
            dt_s=dt_s,
            state=self.state,
            since_s=self._since_s,
            settings=self.settings,
            vehicle=heard.vehicle,
            mode=heard.mode,
            resets_seen=self._resets_seen,
            reboots_seen=self._reboots_seen,
            evader_silence_s=heard.tracking.silence_s(now_s),
            envelope=heard.cycle.envelope,
            position_ned_m=heard.position_ned_m,
            fence=heard.fence,
            evader_ned_m=None if playing.evader is None else playing.evader.position_ned_m,
            start_ned_m=heard.start_ned_m,
            home_ned_m=heard.tracking.home_ned_m,
            certificate=playing.certificate,
            refusals=refusals,
            foreign=heard.foreign,
            other_mode_seen=self._other_mode_seen,
            mode_left=self._mode_left,
            chase_s=now_s - self._chase_began_s,
            rival=heard.tracking.rival(now_s),
            battery_needed=self.battery_needed,
            operator_silence_s=self.operator_silence_s(now_s),
            battery_was_low=self._battery_was_low,
        )

    def _sends(self, now_s: float) -> bool:
        """Whether to send a setpoint: to command, to hover until the guided mode is left, or to invite a pilot.

        Never from an old position: an order given without contact does not end the flight at once.
        """
        leaving = self.state in HANDING_OVER and self._heard.mode is Mode.GUIDED and self._claimed
        inviting = self._invites and now_s - self._since_s > INVITE_AFTER_S
        fresh = self._heard.vehicle.age_s(LocalPosition, now_s) <= TELEMETRY_LIMIT_S
        return fresh and (self.state in SETPOINT_STATES or leaving or inviting)

    @property
    def _invites(self) -> bool:
        return self.state is State.STANDING_BY and self.settings.engage_on is EngageOn.PILOT_MODE

    def _note_setpoint(self, setpoint: Setpoint | None, now_s: float) -> None:
        if setpoint is None:
            self._playing.silent()
        if setpoint is None or self._invites:
            self._heard.echo.silent()  # while inviting, the autopilot reports setpoints of its own mode
        else:
            self._heard.echo.sent(now_s, setpoint)


def _orders(inputs: Inputs) -> Iterator[tuple[Authority, Event]]:
    """Yield all orders of a cycle, people's first."""
    for order in inputs.orders:
        yield Authority.OPERATOR, order
    for order in inputs.mission:
        yield Authority.MISSION, order
