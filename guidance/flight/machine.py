"""The flight: maps received messages and orders to setpoints and requests. It has no clock and no I/O.

Each cycle has four steps: update with the inputs (`observed`), detect events (`detection`), follow the transition table
(`table`), and compute the setpoint and the requests of the state (`sending`). The steps are the same in real
time, in virtual time and in replay.
"""

import math
import traceback
from collections.abc import Iterator, Sequence

from guidance.autopilots import Finding, Mode, Verdict
from guidance.flight import detection, table
from guidance.flight.detection import LEFT_WITHIN_S, Moment, Stage
from guidance.flight.freshness import TELEMETRY_LIMIT_S
from guidance.flight.observed import Observed
from guidance.flight.sending import Asking, Playing
from guidance.flight.settings import (
    Authority,
    EngageOn,
    FlightSettings,
    Inputs,
    Outputs,
    Transition,
)
from guidance.flight.table import (
    ASKED_MODES,
    BEFORE_FLIGHT,
    HANDING_OVER,
    SETPOINT_STATES,
    Event,
    State,
)
from guidance.messages import Setpoint
from guidance.strategies.own import Ask
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
    """One flight of one vehicle.

    Args:
        settings: Of the flight.
        ask: Asks the user's policy, if one is flown; None flies recorded answers only.
    """

    def __init__(self, settings: FlightSettings, ask: Ask | None = None) -> None:
        self.settings = settings
        self.stage = Stage()
        self.observed = Observed(settings)
        """Everything received."""
        self.tracking = self.observed.tracking
        """The evader's track, home and the frames."""
        self._playing = Playing(settings, ask)
        self._asking = Asking(settings)
        self._last_s: float | None = None
        self._rival = ""
        self._claimed = False
        self._stream_ended = False
        self.fault: str | None = None
        """The internal error that ended the flight, if any."""
        self.checked = False
        """True if all checks had passed at the start; if not, they are repeated before engaging."""
        self.cause: Transition | None = None

    @property
    def state(self) -> State:
        """State of the flight."""
        return self.stage.state

    @property
    def ordered_by_operator(self) -> bool:
        """True if an operator's order led to the present state. A mission cannot change it then."""
        return self.cause is not None and self.cause.by is Authority.OPERATOR

    @property
    def vehicle(self) -> VehicleState:
        """Last known state of the vehicle."""
        return self.observed.vehicle

    @property
    def leaving_modes(self) -> tuple[Mode, ...]:
        """Foreign modes that an order is ending and HEARTBEATs still show.

        If the vehicle was found armed, all HEARTBEATs of the last `AGREEING_S` count: another sender with the same
        system id may have sent the last one.
        """
        shown = self.observed.mode
        if self._claimed:
            left = shown in self.stage.left - {Mode.HOLD, Mode.GUIDED}
            return (shown,) if left and shown is not None else ()
        if (
            shown is Mode.GUIDED
            and self.settings.autopilot.guided_is_ours
            and shown not in self.stage.left
        ):
            return ()  # only who wants guidance to fly it chooses this mode
        return tuple(mode for mode in self.observed.armed_in if mode is not Mode.HOLD)

    @property
    def barring_modes(self) -> tuple[Mode, ...]:
        """Modes that bar a start: somebody else has armed the vehicle, and the last HEARTBEATs show it in them.

        One HEARTBEAT does not decide: another sender with the same system id may have sent it.
        """
        vehicle = self.observed.vehicle
        in_our_mode = self.observed.mode is Mode.GUIDED and self.settings.autopilot.guided_is_ours
        if vehicle.armed and in_our_mode:
            return ()  # only who wants guidance to fly it chooses this mode
        allowed = set[Mode]()
        if vehicle.armed and vehicle.in_air:
            # It is taken over in its hold, without arming or climbing, or from the pilot who will engage. In its guided
            # mode another program flies it.
            piloted = self.settings.engage_on is EngageOn.PILOT_MODE
            allowed = set(Mode) - {Mode.GUIDED} if piloted else {Mode.HOLD}
        return tuple(mode for mode in self.observed.armed_in if mode not in allowed)

    @property
    def mode_name(self) -> str:
        """Name of the mode in HEARTBEAT."""
        return "unknown" if self.observed.mode is None else str(self.observed.mode)

    @property
    def mode_title(self) -> str:
        """Name of the mode in a ground station: OFFBOARD, GUIDED, RTL."""
        mode = self.observed.mode
        return "unknown" if mode is None else self.settings.autopilot.mode_title(mode)

    def operator_silence_s(self, now_s: float) -> float:
        """Seconds since the operator's last order or sign of life; 0 before the first one."""
        return max(0.0, now_s - self.stage.operator_s)

    def checks(self, now_s: float) -> tuple[Finding, ...]:
        """Return the readiness checks."""
        return detection.checks(self.observed, self.settings.autopilot, now_s)

    def evader_refusal(self, now_s: float) -> str:
        """Return why this evader may not be engaged now; empty if it may."""
        silence_s = self.tracking.silence_s(now_s)
        limit_s = self.settings.cycle.evader_timeout_s
        if silence_s > limit_s:
            last_report = (
                "was never heard"
                if math.isinf(silence_s)
                else f"was last heard {silence_s:.1f} s ago"
            )
            dropped = self.tracking.unusable_words(now_s)
            allowed = f"at most {limit_s:g} s is allowed"
            return "; ".join(filter(None, (f"the evader {last_report}", dropped, allowed)))
        rival = self.tracking.rival(now_s)
        if rival and self.settings.hold_on_rival:
            return f"two sources report as the evader (told apart by {rival}); silence one, or set evader.second_source"
        too_far = self.observed.distance_refusal(now_s)
        return too_far if too_far else self.tracking.height_refusal(now_s)

    def _passes(self, now_s: float) -> bool:
        return all(check.verdict is Verdict.PASS for check in self.checks(now_s))

    def telemetry_refusal(self, now_s: float) -> str:
        """Return why the vehicle's telemetry bars an engagement now; empty if it does not."""
        return detection.telemetry_refusal(self.vehicle, now_s)

    def follows(self, order: Event, now_s: float, refusals: Sequence[str] = ()) -> bool:
        """Return whether an order would change the state now."""
        if self.fault is not None:
            return False
        event = self._meant(order, now_s, refusals)
        return event is not None and table.next_state(self.state, event) is not self.state

    def step(self, now_s: float, inputs: Inputs) -> Outputs:
        """Run one cycle. An exception hands the vehicle to the autopilot's hold and ends the flight.

        Raises:
            ValueError: If an order is unknown.
        """
        for order in (*inputs.orders, *inputs.mission):
            if order not in table.ORDERS:
                raise ValueError(
                    f"order = {order!r}: allowed are {', '.join(sorted(table.ORDERS))}"
                )
        try:
            if self.fault is not None:
                self.observed.vehicle_says(inputs.messages)  # for display
                return self._hand_over(now_s, inputs)
            self._playing.recorded = inputs.answer
            self._playing.answer = None
            self._playing.alarm = None
            observed = self.observed
            stage = self.stage
            if self._last_s is None:
                self._last_s = stage.since_s = now_s
            dt_s = now_s - self._last_s
            self._last_s = now_s
            if inputs.alive or inputs.orders or stage.operator_s == math.inf:
                stage.operator_s = now_s
            observed.take_in(now_s, inputs, dt_s, in_flight=stage.state not in BEFORE_FLIGHT)
            self._stream_ended |= detection.has_stopped(observed)
            if observed.switched:
                self._playing.switch()
            self._playing.move(observed.moved_ned_m)
            for beat in observed.beats:
                if beat.received_s > stage.since_s:
                    mode = self.settings.autopilot.mode_of(beat.custom_mode)
                    stage.other_mode_seen |= mode is not Mode.GUIDED
                    if mode not in stage.left or now_s - stage.since_s > LEFT_WITHIN_S:
                        stage.left &= {mode}
            transitions = tuple(self._follow(now_s, inputs))
            requests = self._asking.requests(self.stage, self.observed, now_s)
            setpoint = self._setpoint(now_s)
        except Exception as error:  # guidance must not leave the vehicle without a command
            return self.give_up(now_s, inputs, error)
        certificate = self._playing.certificate
        alarm = self._playing.alarm
        return Outputs(
            self.stage.state,
            setpoint,
            requests,
            transitions,
            certificate,
            alarm,
            cause=self.cause,
            answer=self._playing.answer,
        )

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
        location = f" ({frames[-1].name}, line {frames[-1].lineno})" if frames else ""
        self.fault = f"{type(error).__name__}: {error}{location}"
        before = self.stage.state
        after = table.next_state(self.stage.state, Event.FAULT)
        follows_us = after is State.YIELDED and (
            before in SETPOINT_STATES or (before is not after and self.observed.mode is Mode.GUIDED)
        )
        self.stage.state = after
        self._asking.hand_over(flown=follows_us, at_once=True)
        outputs = self._hand_over(now_s, inputs)
        self.cause = Transition(now_s, Event.FAULT, before, after, detail=self.fault)
        return outputs._replace(
            transitions=(*outputs.transitions, self.cause), fault=self.fault, cause=self.cause
        )

    def _hand_over(self, now_s: float, inputs: Inputs) -> Outputs:
        state = self.stage.state
        unheeded = [
            Transition(now_s, order, state, state, Authority.OPERATOR) for order in inputs.orders
        ]
        unheeded.extend(
            Transition(now_s, order, state, state, Authority.MISSION) for order in inputs.mission
        )
        requests = self._asking.hold_requests(now_s, inputs.messages)
        return Outputs(state, None, requests, tuple(unheeded), None, cause=self.cause)

    def _follow(self, now_s: float, inputs: Inputs) -> Iterator[Transition]:
        stage = self.stage
        refusals = inputs.refusals
        for by, orders in (
            (Authority.OPERATOR, inputs.orders),
            (Authority.MISSION, inputs.mission),
        ):
            for order in orders:
                event = None
                if by is not Authority.MISSION or not self.ordered_by_operator:
                    event = self._meant(order, now_s, refusals)
                refused = Transition(now_s, order, stage.state, stage.state, by)
                yield refused if event is None else self._change(now_s, event, by)
        for event, words in self.observed.notes:
            yield Transition(now_s, event, stage.state, stage.state, detail=words)
        if not self.settings.hold_on_rival:
            before = self._rival
            self._rival = self.tracking.rival(now_s)
            if self._rival and not before:
                yield Transition(now_s, Event.RIVAL, stage.state, stage.state)
        now = Moment(
            now_s, self.settings, self.observed, stage, self._playing.certificate, refusals
        )
        if (
            event := next(detection.events(now), None)
        ) is not None:  # the next cycle judges the new state
            yield self._change(now_s, event, detail=detection.detail_of(event, now))

    def _meant(self, order: Event, now_s: float, refusals: Sequence[str]) -> Event | None:
        """Return the event of an order in the present situation, None if it must not be followed."""
        vehicle = self.observed.vehicle
        if order is Event.START:
            if self.barring_modes or refusals or not self._passes(now_s):
                return None
            return Event.ALOFT if vehicle.armed and vehicle.in_air else order
        if order is Event.ENGAGE:
            # Telemetry, evader, mode, preflight and checks may bar an engagement.
            barred = (
                self.telemetry_refusal(now_s)
                or self.evader_refusal(now_s)
                or self.leaving_modes
                or refusals
                or not self.observed.has_flown
            )
            if barred or not (self.checked or self._passes(now_s)):
                return None
        if self.stage.state in BEFORE_FLIGHT and vehicle.armed:
            return _FOUND_ARMED.get(order)
        return order

    def _change(
        self, now_s: float, event: Event, by: Authority = Authority.FLIGHT, detail: str = ""
    ) -> Transition:
        stage = self.stage
        before = self.stage.state
        after = table.next_state(self.stage.state, event)
        transition = Transition(now_s, event, before, after, by, detail)
        ordered = table.is_done(event, after) if by is Authority.OPERATOR else False
        if after is not before or ordered:
            self.cause = transition
            stage.battery_was_low = False
            if ordered and after is State.HOLDING:
                # A hold ordered while the battery is already low, or not known, stands.
                stage.battery_was_low = self.observed.battery_is_low or self.observed.charge_is_old
        if after is not before:
            left = set[Mode]()
            now = Moment(now_s, self.settings, self.observed, stage, None, ())
            if self.observed.mode is not None and not detection.shows_strange_mode(now):
                left.add(self.observed.mode)
            if after in HANDING_OVER or after is State.ENTERING:
                # A request sent before the order may still be on its way.
                left |= stage.left | ({ASKED_MODES[before]} if before in ASKED_MODES else set())
            stage.left = frozenset(left)
            stage.state = after
            stage.since_s = now_s
            stage.other_mode_seen = False
            stage.may_be_armed = self.observed.vehicle.armed
            stage.resets_seen = self.observed.vehicle.resets
            stage.reboots_seen = self.observed.vehicle.reboots
            if after is State.ENGAGED and before is not State.PAUSED:
                stage.chase_began_s = now_s
            if after in table.ACCEPTED:
                self.observed.fix_home()
            self.checked |= before is State.READY and after is not State.CHECKING
            self._claimed |= after not in BEFORE_FLIGHT | HANDING_OVER | table.FINAL
            if after in SETPOINT_STATES and before not in SETPOINT_STATES:
                self._stream_ended = False
            self._playing.change(before, after)
            lost = after is State.YIELDED and event in {Event.TELEMETRY_LOST, Event.LOOP_STOPPED}
            if lost and before in SETPOINT_STATES and self.settings.autopilot.waits_in_guided:
                self._asking.hand_over()
        return transition

    def _setpoint(self, now_s: float) -> Setpoint | None:
        """Return a setpoint: to command, to hover until the guided mode is left, or to invite a pilot.

        Never from an old position: an order given without contact does not end the flight at once.
        """
        state = self.stage.state
        observed = self.observed
        inviting = state is State.STANDING_BY and self.settings.engage_on is EngageOn.PILOT_MODE
        needs_setpoint = state in SETPOINT_STATES
        if state in HANDING_OVER and observed.mode is Mode.GUIDED and self._claimed:
            # A stream that the autopilot stopped waiting for would take the vehicle back from its failsafe.
            needs_setpoint = observed.has_flown and not self._stream_ended
        if inviting and now_s - self.stage.since_s > INVITE_AFTER_S:
            needs_setpoint = True
        chosen = state is State.STANDING_BY and observed.mode is Mode.GUIDED
        if chosen and self.settings.autopilot.guided_is_ours:
            # Else the vehicle would fly on by the last setpoint of the mode before
            needs_setpoint = True
        setpoint = None
        view = observed.seen
        if view is None and needs_setpoint:
            view = observed.view(now_s)
        is_fresh = observed.position_age_s <= TELEMETRY_LIMIT_S
        if needs_setpoint and view is not None and is_fresh:
            setpoint = self._playing.setpoint(view, observed, state, now_s)
        if setpoint is None or inviting:
            observed.echo.silent()  # while inviting, the autopilot reports setpoints of its own mode
        else:
            observed.echo.sent(now_s, setpoint)
        return setpoint
