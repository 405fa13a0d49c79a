"""Who watches a scenario on a real vehicle: gives the orders that a person allowed, and ends the run when it is over.

It only orders and listens, as `guidance ctl` does; what may happen is the flight's own table. Without a person's word
nothing starts and nothing engages. When the game is over the vehicle goes to its autopilot, in the way that its file
says (flight.on_terminate).
"""

import math
from typing import Final

from guidance.errors import FlightError
from guidance.flight import Event, State
from guidance.frames import Vector
from guidance.preflight import advice, refusals
from guidance.scenarios.director import PATIENCE_S, Director
from guidance.scenarios.fly import FlightResult, conclude, note, pursuer_game_m
from guidance.scenarios.impaired import ImpairedTarget
from guidance.scenarios.model import Scenario
from guidance.service.daemon import Daemon
from guidance.service.leaving import ON_GROUND
from guidance.service.mailbox import Mailbox
from guidance.service.reasons import missing
from guidance.telemetry import Home

READY_WITHIN_S: Final = 120.0
"""Longest wait for a vehicle that is fit to fly; an ArduCopter takes 40 s from its start."""

JUDGED_FOR_S: Final = 3.0
"""So long preflight must refuse a vehicle that is fit otherwise before the run is given up."""

ASK_EVERY_S: Final = 1.0


class Supervisor:
    """One scenario on one vehicle. `watch` is called after every cycle of the daemon.

    Args:
        scenario: What is flown.
        daemon: What flies it.
        mailbox: Its orders.
        target: Where it hears of the target.
        engage: A person allowed to start and to engage as soon as that can be done; else both wait for
            `guidance ctl start` and `guidance ctl engage`.
        on_terminate: The order that hands the vehicle over in the end.
    """

    def __init__(
        self,
        scenario: Scenario,
        daemon: Daemon,
        mailbox: Mailbox,
        target: ImpairedTarget,
        *,
        engage: bool,
        on_terminate: Event,
    ) -> None:
        self.result = FlightResult(scenario, State.CONNECTING)
        self._daemon = daemon
        self._mailbox = mailbox
        self._target = target
        self._engage = engage
        self._on_terminate = on_terminate
        # Who waits for a person has all the time there is.
        patience_s = PATIENCE_S if engage else {}
        self._director = Director(hold_s=scenario.hold_s, time_limit_s=scenario.time_limit_s, patience_s=patience_s)
        self._begun_s: float | None = None
        self._refused_s = math.inf
        self._asked_s = -math.inf
        self._left = False

    def watch(self, now_s: float) -> None:
        """Follow a cycle.

        Raises:
            FlightError: If preflight refuses, the vehicle does not get ready, or the start is outside of its fence;
                on the ground, all of them.
        """
        self._begun_s = now_s if self._begun_s is None else self._begun_s
        flight, outputs = self._daemon.flight, self._daemon.outputs
        if outputs is None:
            return
        self._director.follow(now_s, outputs)
        if self._director.engaged_s == now_s:
            self._target.engage(now_s)
        note(self.result, now_s, outputs, pursuer_game_m(flight), self._evader_game_m(now_s))
        conclude(self.result, self._director, now_s - self._begun_s)
        if flight.state in ON_GROUND:
            self._judge(now_s, now_s - self._begun_s)
        self._order(now_s)

    def _evader_game_m(self, now_s: float) -> Vector | None:
        tracking = self._daemon.flight.tracking
        target, frame = tracking.target(now_s), tracking.game_frame
        return None if target is None or frame is None else frame.position_from_ned(target.position_ned_m)

    def _order(self, now_s: float) -> None:
        fresh = self._daemon.flight.tracking.silence_s(now_s) < self._daemon.flight.settings.tick.target_timeout_s
        for order in self._director.orders(now_s, evader_ready=True, target_fresh=fresh):
            if order in {Event.START, Event.ENGAGE}:
                if self._engage and now_s - self._asked_s >= ASK_EVERY_S:
                    self._asked_s = now_s
                    self._mailbox.ask(str(order))
            elif self._director.engaged_s is not None:
                self._leave(now_s)
        if self._director.finished:
            self._leave(now_s)

    def _leave(self, now_s: float) -> None:
        if not self._left:
            self._left = True
            self._daemon.leave(self._on_terminate, now_s)

    def _judge(self, now_s: float, waited_s: float) -> None:
        daemon = self._daemon
        self._check_start()
        otherwise_fit = daemon.surveyed and all(check.passed for check in daemon.flight.checks(now_s))
        refused = otherwise_fit and bool(refusals(daemon.rows))
        self._refused_s = min(self._refused_s, now_s) if refused else math.inf
        if now_s - self._refused_s >= JUDGED_FOR_S:
            raise FlightError(f"preflight refuses: {advice(daemon.rows)}; see `guidance check`")
        if daemon.flight.state is not State.READY and waited_s > READY_WITHIN_S:
            raise FlightError(
                f"not ready to fly within {READY_WITHIN_S:g} s: {missing(daemon.flight, now_s, daemon.rows)}"
            )

    def _check_start(self) -> None:
        """Refuse a start outside of the fence: to there the autopilot flies by itself, and our limits do not act."""
        flight = self._daemon.flight
        start, frame, home = flight.settings.start_game_m, flight.tracking.game_frame, flight.vehicle.last(Home)
        fence_m = flight.settings.tick.envelope.fence_radius_m
        if start is None or frame is None or home is None or fence_m is None:
            return
        away_m = math.dist(frame.position_to_ned(start)[:2], home.position_ned_m[:2])
        if away_m > fence_m:
            raise FlightError(
                f"pursuer.position_m is {away_m:.0f} m from the vehicle's home; allowed is the fence's {fence_m:g} m. "
                "Does [site] of the scenario say where the vehicle is?"
            )
