"""A scenario as a mission: it plays the evader, gives the orders that a person allowed, and ends the flight.

It orders and listens only; the flight's table decides. Without a person's permission it neither starts nor engages.
After the game it hands a vehicle over as the vehicle file says (flight.on_terminate). A mock, or a vehicle that the run
has for itself, is sent home or landed and watched until it is disarmed.
"""

import math
from collections.abc import Callable
from typing import Final, NamedTuple

from guidance.certificate import Certificate
from guidance.errors import FlightError
from guidance.flight import Authority, Event, Flight, State
from guidance.frames import Vector
from guidance.messages import CommandAck, Home, LocalPosition, StatusText
from guidance.preflight import advice, refusals
from guidance.session.answers import missing, next_words
from guidance.session.daemon import Daemon
from guidance.session.linked_flight import Stopped
from guidance.session.loop import PERIOD_S, World
from guidance.session.orders import ON_GROUND
from guidance.session.result import FlightResult, conclude, note
from guidance.session.sequencer import PATIENCE_S, MissionSequencer
from guidance.sim.scenario import Scenario
from guidance.sim.sensor import SensedEvader

READY_WITHIN_S: Final = 120.0
"""Longest wait for a vehicle to become ready; an ArduCopter takes 40 s from its start."""

JUDGED_FOR_S: Final = 3.0
"""The run ends after preflight has refused an otherwise ready vehicle for this long."""

ASK_EVERY_S: Final = 1.0
_ARM_DISARM: Final = 400
_WARNING: Final = 4
"""MAV_SEVERITY; lower numbers are more severe."""

MISSION_LIMIT_S: Final = 900.0
"""Longest mocked flight, not counting time in which an operator's order stands."""


class Progress(NamedTuple):
    """Contents of the live line.

    Attributes:
        now_s: The present.
        state: Of the flight.
        mode: The autopilot's, by its own name.
        certificate: Of the game; None outside of it.
        unit: Of the game's value.
        record_stopped: When and why the record stopped.
        waiting: Why a vehicle on the ground is not ready.
        why: The cause of this state.
        next: The orders that continue, if the flight waits for a person.
    """

    now_s: float
    state: State
    mode: str
    certificate: Certificate | None
    unit: str
    record_stopped: Stopped | None = None
    waiting: str = ""
    why: str = ""
    next: str = ""


class MissionPolicy(NamedTuple):
    """Which orders a mission may give, and how the vehicle is handed over.

    Attributes:
        engage: The mission may start and engage as soon as that can be done; else both wait for `guidance ctl start`
            and `guidance ctl engage`.
        end_with: The order that ends the game, where the run has the vehicle for itself: one that is armed already is
            refused then, and in the end it is watched until it is disarmed. None leaves it to `hand_over`.
        hand_over: The order that hands the vehicle over in the end; None for a mock.
    """

    engage: bool
    end_with: Event | None = None
    hand_over: Event | None = None


MOCKED: Final = MissionPolicy(engage=True, end_with=Event.LAND)


class Mission:
    """One scenario, around every cycle of the daemon that flies it: `before` and `after`.

    Args:
        scenario: The scenario.
        daemon: Flies the vehicle.
        world: The vehicle and the evader, which is moved from here if this process plays it.
        heard: The evader's reports.
        policy: Which orders the mission may give.
        show: Called in every cycle.
        ready_within_s: Longest wait for a vehicle that is fit to fly.

    Attributes:
        result: Of the flight so far.
    """

    def __init__(
        self,
        scenario: Scenario,
        daemon: Daemon,
        world: World,
        heard: SensedEvader,
        policy: MissionPolicy = MOCKED,
        *,
        show: Callable[[Progress], None] = lambda _: None,
        ready_within_s: float = READY_WITHIN_S,
    ) -> None:
        self.result = FlightResult(scenario, State.CONNECTING)
        self._over = False
        self._engaged_once = False
        self._limit_from_s = 0.0
        self._daemon = daemon
        self._world = world
        self._heard = heard
        self._policy = policy
        self._show = show
        self._ready_within_s = ready_within_s
        self._sequencer = MissionSequencer(
            hold_s=scenario.hold_s,
            time_limit_s=scenario.time_limit_s,
            # No time limits if a person gives the orders.
            patience_s=PATIENCE_S if policy.engage else {},
            end_with=policy.end_with or Event.LAND,
        )
        self._unit = "s" if scenario.target is None else "m"
        self._begun_s: float | None = None
        self._pursuer_game_m: Vector | None = None
        self._refused_s = math.inf
        self._asked_s = -math.inf

    @property
    def left(self) -> bool:
        """Whether the mission ended the run, and not a person."""
        return self._over or self._daemon.leaving is Authority.MISSION

    @property
    def finished(self) -> bool:
        """Whether a mock's flight is over. A vehicle's flight is ended by its daemon, which hands it over."""
        return self._over

    def before(self, now_s: float) -> None:
        """Move the evader to the present, and give the orders that are due."""
        self._begun_s = now_s if self._begun_s is None else self._begun_s
        flight, player = self._daemon.flight, self._world.player
        self._pursuer_game_m = pursuer_game_m(flight)
        if player is not None:
            player.step(now_s, self._pursuer_game_m, playing=self._sequencer.playing)
        fresh = flight.tracking.silence_s(now_s) < flight.settings.cycle.evader_timeout_s
        ready = player is None or player.ready
        for order in self._sequencer.orders(now_s, evader_ready=ready, evader_fresh=fresh):
            if order in {Event.START, Event.ENGAGE}:
                if self._policy.engage:
                    self._ask(order, now_s)
            elif self._policy.end_with is not None:
                self._ask(order, now_s)
            elif self._sequencer.engaged_s is not None:
                self._leave(now_s)

    def after(self, now_s: float, late_s: float = 0.0) -> None:
        """Follow a cycle.

        Raises:
            FlightError: If preflight refuses, the vehicle does not get ready, it is armed already, or the start
                is outside of its fence; on the ground, all of them.
        """
        flight, outputs, result = self._daemon.flight, self._daemon.outputs, self.result
        if outputs is None or self._begun_s is None:
            return
        self._sequencer.follow(now_s, outputs)
        if self._sequencer.by_operator or result.cycles == 0:
            self._limit_from_s = now_s
        if self._sequencer.engaged_s == now_s and not self._engaged_once:
            self._engaged_once = True
            self._heard.engage(now_s)
            self._world.engage()
        result.late_cycles += late_s > PERIOD_S
        result.record_stopped = self._daemon.record_stopped
        note(result, now_s, outputs, self._pursuer_game_m, self._evader_game_m(now_s))
        conclude(result, self._sequencer, now_s - self._begun_s)
        waiting = ""
        if self._daemon.judged:
            self._listen()
            if flight.state in ON_GROUND:
                self._judge(now_s, now_s - self._begun_s)
                waiting = self._waiting(now_s)
        given_up = self._policy.hand_over is None and now_s - self._limit_from_s >= MISSION_LIMIT_S
        if self._sequencer.finished or given_up:
            self._leave(now_s)
        self._show(
            Progress(
                now_s,
                outputs.state,
                flight.mode_title,
                outputs.certificate,
                self._unit,
                result.record_stopped,
                waiting,
                "" if outputs.cause is None else outputs.cause.words,
                next_words(flight),
            )
        )

    def _waiting(self, now_s: float) -> str:
        """Say briefly why a vehicle on the ground is not ready."""
        daemon = self._daemon
        if daemon.flight.state is State.READY:
            return ""
        failed = [f"{check.name} ({check.found})" for check in daemon.flight.checks(now_s) if not check.passed]
        if failed:
            return ", ".join(failed) + (f'; it says "{self.result.said}"' if self.result.said else "")
        if not daemon.surveyed:
            return "its parameters are being read"
        return f"preflight refuses {', '.join(refusals(daemon.rows)) or 'nothing any more'}"

    def _evader_game_m(self, now_s: float) -> Vector | None:
        if self._world.player is not None:
            return self._world.player.position_game_m()
        tracking = self._daemon.flight.tracking
        evader, frame = tracking.evader(now_s), tracking.game_frame
        return None if evader is None or frame is None else frame.position_from_ned(evader.position_ned_m)

    def _listen(self) -> None:
        """Keep the autopilot's last warning before the flight."""
        if self._daemon.flight.state not in ON_GROUND | {State.ARMING}:
            return
        for message in self._daemon.heard:
            if isinstance(message, StatusText) and message.severity <= _WARNING:
                self.result.said = message.text
            elif isinstance(message, CommandAck) and message.command == _ARM_DISARM and message.result != 0:
                self.result.said = self.result.said or f"arming refused (MAV_RESULT {message.result})"

    def _ask(self, order: Event, now_s: float) -> None:
        if now_s - self._asked_s >= ASK_EVERY_S:
            self._asked_s = now_s
            self._daemon.mailbox.ask(str(order), authority=Authority.MISSION)

    def _leave(self, now_s: float) -> None:
        if self._policy.hand_over is None:
            self._over = True
        elif self._daemon.leaving is None:
            self._daemon.leave(self._policy.hand_over, now_s, Authority.MISSION)

    def _judge(self, now_s: float, waited_s: float) -> None:
        daemon = self._daemon
        if self._policy.end_with is not None and daemon.flight.vehicle.armed:
            raise FlightError("the vehicle is armed already; disarm it and start again: no order was given")
        self._check_start()
        otherwise_fit = daemon.surveyed and all(check.passed for check in daemon.flight.checks(now_s))
        refused = otherwise_fit and bool(refusals(daemon.rows))
        self._refused_s = min(self._refused_s, now_s) if refused else math.inf
        if now_s - self._refused_s >= JUDGED_FOR_S:
            raise FlightError(f"preflight refuses: {advice(daemon.rows)}; see `guidance check`")
        if daemon.flight.state is not State.READY and waited_s > self._ready_within_s:
            said = f'; the autopilot says "{self.result.said}"' if self.result.said else ""
            raise FlightError(
                f"not ready to fly within {self._ready_within_s:g} s: "
                f"{missing(daemon.flight, now_s, daemon.rows)}{said}; nothing was armed"
            )

    def _check_start(self) -> None:
        """Refuse a start outside of the fence: to there the autopilot flies by itself, and our limits do not act."""
        flight = self._daemon.flight
        start, frame, home = flight.settings.start_game_m, flight.tracking.game_frame, flight.vehicle.last(Home)
        fence_m = flight.settings.cycle.envelope.fence_radius_m
        if start is None or frame is None or home is None or fence_m is None:
            return
        away_m = math.dist(frame.position_to_ned(start)[:2], home.position_ned_m[:2])
        if away_m > fence_m:
            raise FlightError(
                f"pursuer.position_m is {away_m:.0f} m from the vehicle's home; allowed is the fence's {fence_m:g} m. "
                "Does [site] of the scenario say where the vehicle is?"
            )


def pursuer_game_m(flight: Flight) -> Vector | None:
    """Return where the vehicle's own telemetry has it in the game frame, None until heard."""
    local, frame = flight.vehicle.last(LocalPosition), flight.tracking.game_frame
    return None if local is None or frame is None else frame.position_from_ned(local.position_ned_m)
