"""The flight: maps received messages and orders to setpoints and requests. It has no clock and no I/O.

Each cycle has four steps: update with the inputs (`heard`), detect events (`detection`), follow the transition table
(`table`), and compute the setpoint and the requests of the state (`sending`). The steps are the same in real
time, in virtual time and in replay.
"""

import math
import traceback
from collections.abc import Iterator, Sequence

from guidance.autopilots import Finding, Mode
from guidance.flight import detection, table
from guidance.flight.detection import TELEMETRY_LIMIT_S, Moment, Stage
from guidance.flight.heard import Heard
from guidance.flight.sending import Asking, Playing
from guidance.flight.settings import Authority, EngageOn, FlightSettings, Happening, Inputs, Outputs
from guidance.flight.table import BEFORE_FLIGHT, HANDING_OVER, OUR_MODES, SETPOINT_STATES, Event, State
from guidance.flight.tracking import NOWHERE, Tracking
from guidance.messages import LocalPosition, Setpoint
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
        self._stage = Stage()
        self.heard = Heard(settings)
        """Everything received."""
        self.tracking: Tracking = self.heard.tracking
        """The evader's track, home and the frames."""
        self._playing = Playing(settings)
        self._asking = Asking(settings)
        self._last_s: float | None = None
        self._rival = ""
        self._claimed = False
        self.fault: str | None = None
        """The internal error that ended the flight, if any."""
        self.checked = False
        """True if all checks had passed at the start; if not, they are repeated before engaging."""
        self.cause: Happening | None = None

    @property
    def state(self) -> State:
        """State of the flight."""
        return self._stage.state

    @property
    def ordered_by_operator(self) -> bool:
        """True if an operator's order led to the present state. A mission cannot change it then."""
        return self.cause is not None and self.cause.by is Authority.OPERATOR

    @property
    def vehicle(self) -> VehicleState:
        """Last known state of the vehicle."""
        return self.heard.vehicle

    @property
    def leaving_mode(self) -> bool:
        """Whether HEARTBEAT still shows a foreign mode that an order is ending."""
        left = self._stage.mode_left
        return left is not None and left not in OUR_MODES[State.ENTERING]

    @property
    def mode_name(self) -> str:
        """Name of the mode in HEARTBEAT."""
        return "unknown" if self.heard.mode is None else str(self.heard.mode)

    @property
    def mode_title(self) -> str:
        """Name of the mode in a ground station: OFFBOARD, GUIDED, RTL."""
        mode = self.heard.mode
        return "unknown" if mode is None else self.settings.autopilot.mode_title(mode)

    @property
    def battery_needed(self) -> float:
        """Share of the charge below which it returns: on the ground for the whole fence, in flight from here."""
        if self.settings.reserve is None:
            return self.settings.battery_minimum
        here, home = self.heard.position_ned_m, self.heard.tracking.home_ned_m
        if self.state in BEFORE_FLIGHT or here is None or home is None:
            return self.settings.reserve.needed(self.settings.farthest_m, self.settings.takeoff_height_m)
        return self.settings.reserve.needed(math.dist(here[:2], home[:2]), home[2] - here[2])

    def operator_silence_s(self, now_s: float) -> float:
        """Seconds since the operator's last order or sign of life; 0 before the first one."""
        return max(0.0, now_s - self._stage.operator_s)

    def checks(self, now_s: float) -> tuple[Finding, ...]:
        """Return the readiness checks."""
        return detection.checks(self.vehicle, self.settings.autopilot, now_s, battery_minimum=self.battery_needed)

    def evader_refusal(self, now_s: float) -> str:
        """Return why this evader may not be engaged now; empty if it may."""
        return detection.evader_refusal(self.tracking, self.settings, now_s)

    def follows(self, order: Event, now_s: float, refusals: Sequence[str] = ()) -> bool:
        """Return whether an order would change the state now."""
        if self.fault is not None:
            return False
        event = self._meant(order, self._moment(now_s, refusals))
        return event is not None and table.next_state(self.state, event) is not self.state

    def step(self, now_s: float, inputs: Inputs) -> Outputs:
        """Run one cycle. An exception hands the vehicle to the autopilot's hold and ends the flight.

        Raises:
            ValueError: If an order is unknown.
        """
        for order in (*inputs.orders, *inputs.mission):
            if order not in table.ORDERS:
                raise ValueError(f"order = {order!r}: allowed are {', '.join(sorted(table.ORDERS))}")
        try:
            if self.fault is not None:
                self.heard.vehicle_says(inputs.messages)  # for display
                return self._hand_over(now_s, inputs)
            self._take_in(now_s, inputs)
            happenings = tuple(self._follow(now_s, inputs))
            requests = self._asking.requests(self._stage, self.heard, now_s)
            setpoint = self._setpoint(now_s)
        except Exception as error:  # guidance must not leave the vehicle without a command
            return self.give_up(now_s, inputs, error)
        certificate, alarm = self._playing.certificate, self._playing.alarm
        return Outputs(self._stage.state, setpoint, requests, happenings, certificate, alarm, cause=self.cause)

    def give_up(self, now_s: float, inputs: Inputs, error: Exception) -> Outputs:
        """End the flight after an internal error: request the hold if the vehicle follows our setpoints, and yield.

        Args:
            now_s: Time of the failed cycle.
            inputs: Its inputs.
            error: The exception.
        """
        if self.fault is not None:
            return self._hand_over(now_s, inputs)
        frames = traceback.extract_tb(error.__traceback__)
        where = f" ({frames[-1].name}, line {frames[-1].lineno})" if frames else ""
        self.fault = f"{type(error).__name__}: {error}{where}"
        before, after = self._stage.state, table.next_state(self._stage.state, Event.FAULT)
        ours = before in SETPOINT_STATES or (before is not after and self.heard.mode is Mode.GUIDED)
        self._stage.state = after
        self._asking.hand_over(flown=ours and after is State.YIELDED, at_once=True)
        outputs = self._hand_over(now_s, inputs)
        self.cause = Happening(now_s, Event.FAULT, before, after, detail=self.fault)
        return outputs._replace(happenings=(*outputs.happenings, self.cause), fault=self.fault, cause=self.cause)

    def _hand_over(self, now_s: float, inputs: Inputs) -> Outputs:
        state = self._stage.state
        unheeded = tuple(Happening(now_s, order, state, state, by) for by, order in _orders(inputs))
        requests = self._asking.hold_requests(now_s, inputs.messages)
        return Outputs(state, None, requests, unheeded, None, cause=self.cause)

    def _take_in(self, now_s: float, inputs: Inputs) -> None:
        """Update with the inputs."""
        heard, stage = self.heard, self._stage
        if self._last_s is None:
            self._last_s = stage.since_s = now_s
        dt_s, self._last_s = now_s - self._last_s, now_s
        if inputs.alive or inputs.orders or stage.operator_s == math.inf:
            stage.operator_s = now_s
        heard.take_in(inputs, dt_s, in_flight=stage.state not in BEFORE_FLIGHT)
        if heard.switched:
            self._playing.switch()
        if heard.moved_ned_m != NOWHERE:
            self._playing.move(heard.moved_ned_m)
        for beat in heard.beats:
            if beat.received_s > stage.since_s:
                mode = self.settings.autopilot.mode_of(beat.custom_mode)
                stage.other_mode_seen |= mode is not Mode.GUIDED
                stage.mode_left = stage.mode_left if mode is stage.mode_left else None

    def _follow(self, now_s: float, inputs: Inputs) -> Iterator[Happening]:
        for by, order in _orders(inputs):
            event = None
            if by is Authority.OPERATOR or not self.ordered_by_operator:
                event = self._meant(order, self._moment(now_s, inputs.refusals))
            refused = Happening(now_s, order, self._stage.state, self._stage.state, by)
            yield refused if event is None else self._change(now_s, event, by)
        now = self._moment(now_s, inputs.refusals)
        before, self._rival = self._rival, self.tracking.rival(now_s)
        if self._rival and not before and not self.settings.hold_on_rival:
            yield Happening(now_s, Event.RIVAL, self._stage.state, self._stage.state)
        for event in detection.events(now):
            yield self._change(now_s, event, detail=detection.detail_of(event, now))
            return  # only the most severe event; the next cycle judges the new state

    def _meant(self, order: Event, now: Moment) -> Event | None:
        """Return the event of an order in the present situation, None if it must not be followed."""
        vehicle = self.heard.vehicle
        if order is Event.START and vehicle.armed and not vehicle.on_ground:
            # An airborne vehicle is taken over in its hold, without arming or climbing.
            piloted = self.settings.engage_on is EngageOn.PILOT_MODE
            return Event.ALOFT if piloted or self.heard.mode in OUR_MODES[State.STANDING_BY] else None
        if order is Event.ENGAGE:
            barred = self.leaving_mode or now.refusals or self.evader_refusal(now.now_s)
            if barred or not (self.checked or detection.fit(now)):
                return None
        if self._stage.state in BEFORE_FLIGHT and vehicle.armed:
            return _FOUND_ARMED.get(order, order)
        return order

    def _change(self, now_s: float, event: Event, by: Authority = Authority.FLIGHT, detail: str = "") -> Happening:
        stage, before, after = self._stage, self._stage.state, table.next_state(self._stage.state, event)
        happening = Happening(now_s, event, before, after, by, detail)
        ordered = by is Authority.OPERATOR and table.is_done(event, after)
        if after is not before or ordered:
            self.cause = happening
            # A hold ordered while the battery is already low stands.
            low = detection.is_low(self.heard.vehicle, self.battery_needed)
            stage.battery_was_low = low and ordered and after is State.HOLDING
        if after is not before:
            stage.state, stage.since_s, stage.other_mode_seen = after, now_s, False
            stage.resets_seen, stage.reboots_seen = self.heard.vehicle.resets, self.heard.vehicle.reboots
            if after is State.ENGAGED and before is not State.PAUSED:
                stage.chase_began_s = now_s
            self.checked |= before is State.READY and after is not State.CHECKING
            self._claimed |= after not in BEFORE_FLIGHT | HANDING_OVER | table.FINAL
            known = before in BEFORE_FLIGHT or self.heard.mode in OUR_MODES[before]
            stage.mode_left = self.heard.mode if known and after in HANDING_OVER else None
            self._playing.change(before, after)
            lost = after is State.YIELDED and event in {Event.TELEMETRY_LOST, Event.LOOP_STOPPED}
            if lost and before in SETPOINT_STATES and self.settings.autopilot.waits_in_guided:
                self._asking.hand_over()
        return happening

    def _moment(self, now_s: float, refusals: Sequence[str]) -> Moment:
        certificate, needed = self._playing.certificate, self.battery_needed
        return Moment(now_s, self.settings, self.heard, self._stage, certificate, refusals, needed)

    def _setpoint(self, now_s: float) -> Setpoint | None:
        """Return a setpoint: to command, to hover until the guided mode is left, or to invite a pilot.

        Never from an old position: an order given without contact does not end the flight at once.
        """
        state, heard = self._stage.state, self.heard
        inviting = state is State.STANDING_BY and self.settings.engage_on is EngageOn.PILOT_MODE
        leaving = state in HANDING_OVER and heard.mode is Mode.GUIDED and self._claimed
        due = state in SETPOINT_STATES or leaving or (inviting and now_s - self._stage.since_s > INVITE_AFTER_S)
        setpoint, self._playing.alarm = None, None
        seen = (heard.seen or heard.view(now_s)) if due else None
        if seen is not None and heard.vehicle.age_s(LocalPosition, now_s) <= TELEMETRY_LIMIT_S:
            needed = math.nan if self.settings.reserve is None else self.battery_needed
            setpoint = self._playing.setpoint(seen, heard.cycle, state, now_s, battery_needed=needed)
        if setpoint is None or inviting:
            heard.echo.silent()  # while inviting, the autopilot reports setpoints of its own mode
        else:
            heard.echo.sent(now_s, setpoint)
        return setpoint


def _orders(inputs: Inputs) -> list[tuple[Authority, Event]]:
    """Return all orders of a cycle, people's first."""
    given = (Authority.OPERATOR, inputs.orders), (Authority.MISSION, inputs.mission)
    return [(by, order) for by, orders in given for order in orders]
