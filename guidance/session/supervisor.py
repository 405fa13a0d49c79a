"""Who watches a scenario on a real vehicle: gives the orders that a person allowed, and ends the run when it is over.

It only orders and listens, as `guidance ctl` does; what may happen is the flight's own table. Without a person's word
nothing starts and nothing engages. When the game is over the vehicle goes to its autopilot, in the way that its file
says (flight.on_terminate); a vehicle that the run has for itself is sent home and watched until it is down.
"""

import math
from collections.abc import Callable
from typing import Final

from guidance.errors import FlightError
from guidance.flight import Event, State
from guidance.frames import Vector
from guidance.messages import CommandAck, Home, StatusText
from guidance.preflight import advice, refusals
from guidance.session.daemon import Daemon
from guidance.session.fly import CYCLE_S, FlightResult, Progress, conclude, note, pursuer_game_m
from guidance.session.handover import ON_GROUND
from guidance.session.orders import Mailbox
from guidance.session.reasons import missing
from guidance.session.sequencer import PATIENCE_S, MissionSequencer
from guidance.sim.evader_here import EvaderPlayer
from guidance.sim.scenario import Scenario
from guidance.sim.sensed_evader import SensedEvader

READY_WITHIN_S: Final = 120.0
"""Longest wait for a vehicle that is fit to fly; an ArduCopter takes 40 s from its start."""

JUDGED_FOR_S: Final = 3.0
"""So long preflight must refuse a vehicle that is fit otherwise before the run is given up."""

ASK_EVERY_S: Final = 1.0
_ARM_DISARM: Final = 400
_WARNING: Final = 4
"""MAV_SEVERITY: what is graver has a lower number."""


class Supervisor:
    """One scenario on one vehicle. `watch` is called after every cycle of the daemon.

    `left` is True once it has ended the run itself; a person may have ended it sooner.

    Args:
        scenario: What is flown.
        daemon: What flies it.
        mailbox: Its orders.
        heard: Where it hears of the evader.
        engage: A person allowed to start and to engage as soon as that can be done; else both wait for
            `guidance ctl start` and `guidance ctl engage`.
        on_terminate: The order that hands the vehicle over in the end.
        evader: Played by the run itself, where it is not somebody else's.
        end_with: The order that ends the game, where the run has the vehicle for itself: one that is armed already is
            refused then, and in the end it is watched until it is disarmed. None leaves it to `on_terminate`.
        show: Is told of every cycle.
        ready_within_s: Longest wait for a vehicle that is fit to fly.
    """

    def __init__(
        self,
        scenario: Scenario,
        daemon: Daemon,
        mailbox: Mailbox,
        heard: SensedEvader,
        *,
        engage: bool,
        on_terminate: Event,
        evader: EvaderPlayer | None = None,
        end_with: Event | None = None,
        show: Callable[[Progress], None] = lambda _: None,
        ready_within_s: float = READY_WITHIN_S,
    ) -> None:
        self.result = FlightResult(scenario, State.CONNECTING)
        self._daemon = daemon
        self._mailbox = mailbox
        self._heard = heard
        self._engage = engage
        self._on_terminate = on_terminate
        self._evader = evader
        self._alone = end_with is not None
        self._show = show
        self._ready_within_s = ready_within_s
        # Who waits for a person has all the time there is.
        patience_s = PATIENCE_S if engage else {}
        self._director = MissionSequencer(
            hold_s=scenario.hold_s,
            time_limit_s=scenario.time_limit_s,
            patience_s=patience_s,
            end_with=end_with or Event.LAND,
        )
        self._unit = "s" if scenario.target is None else "m"
        self._begun_s: float | None = None
        self._last_s = math.inf
        self._refused_s = math.inf
        self._asked_s = -math.inf
        self.left = False

    def watch(self, now_s: float) -> None:
        """Follow a cycle.

        Raises:
            FlightError: If preflight refuses, the vehicle does not get ready, it is armed by another hand, or the start
                is outside of its fence; on the ground, all of them.
        """
        self._begun_s = now_s if self._begun_s is None else self._begun_s
        flight, outputs = self._daemon.flight, self._daemon.outputs
        if outputs is None:
            return
        self._director.follow(now_s, outputs)
        pursuer_m = pursuer_game_m(flight)
        if self._evader is not None:
            self._evader.step(now_s, pursuer_m, playing=self._director.playing)
        if self._director.engaged_s == now_s:
            self._heard.engage(now_s)
            if self._evader is not None:
                self._evader.engage()
        self.result.late_cycles += now_s - self._last_s > 2.0 * CYCLE_S
        self._last_s = now_s
        note(self.result, now_s, outputs, pursuer_m, self._evader_game_m(now_s))
        conclude(self.result, self._director, now_s - self._begun_s)
        self._listen()
        waiting = ""
        if flight.state in ON_GROUND:
            self._judge(now_s, now_s - self._begun_s)
            waiting = self._waiting(now_s)
        self._order(now_s)
        self._show(Progress(now_s, outputs.state, flight.mode_name, outputs.certificate, self._unit, None, waiting))

    def _waiting(self, now_s: float) -> str:
        """Say in a few words what a vehicle on the ground is waited for."""
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
        if self._evader is not None:
            return self._evader.position_game_m()
        tracking = self._daemon.flight.tracking
        evader, frame = tracking.evader(now_s), tracking.game_frame
        return None if evader is None or frame is None else frame.position_from_ned(evader.position_ned_m)

    def _listen(self) -> None:
        """Keep what the autopilot says against flying, until it flies."""
        if self._daemon.flight.state not in ON_GROUND | {State.ARMING}:
            return
        for message in self._daemon.heard:
            if isinstance(message, StatusText) and message.severity <= _WARNING:
                self.result.said = message.text
            elif isinstance(message, CommandAck) and message.command == _ARM_DISARM and message.result != 0:
                self.result.said = self.result.said or f"arming refused (MAV_RESULT {message.result})"

    def _order(self, now_s: float) -> None:
        fresh = self._daemon.flight.tracking.silence_s(now_s) < self._daemon.flight.settings.cycle.evader_timeout_s
        ready = self._evader is None or self._evader.ready
        for order in self._director.orders(now_s, evader_ready=ready, evader_fresh=fresh):
            if order in {Event.START, Event.ENGAGE}:
                if self._engage:
                    self._ask(order, now_s)
            elif self._alone:
                self._ask(order, now_s)
            elif self._director.engaged_s is not None:
                self._leave(now_s)
        if self._director.finished:
            self._leave(now_s)

    def _ask(self, order: Event, now_s: float) -> None:
        if now_s - self._asked_s >= ASK_EVERY_S:
            self._asked_s = now_s
            self._mailbox.ask(str(order))

    def _leave(self, now_s: float) -> None:
        if not self.left:
            self.left = True
            self._daemon.leave(self._on_terminate, now_s)

    def _judge(self, now_s: float, waited_s: float) -> None:
        daemon = self._daemon
        if self._alone and daemon.flight.vehicle.armed:
            raise FlightError("armed by another hand; disarm it, and begin again: nothing was ordered")
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
