"""Scenarios as a mission: it plays the evaders, gives the orders that a person allowed, and ends the flight.

It orders and listens only; the flight's table decides. Without a person's permission it neither starts nor engages.
After the game it hands a vehicle over as the vehicle file says (flight.on_terminate). A mock, or a vehicle that the run
has for itself, is sent home or landed and watched until it is disarmed.
"""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, field
from typing import Final, NamedTuple

from guidance.autopilots.description import MAV_CMD_COMPONENT_ARM_DISARM
from guidance.clock import Clock
from guidance.cycle import Certificate
from guidance.errors import FlightError
from guidance.flight import BEFORE_FLIGHT, FINAL, Authority, Event, State
from guidance.frames import Enu
from guidance.links.world import World
from guidance.messages import CommandAck, Home, LocalPosition, StatusText
from guidance.preflight import advice, refusals
from guidance.session.fly.daemon import Daemon, Equipment
from guidance.session.fly.loop import PERIOD_S, CycleHooks, Signals, run
from guidance.session.fly.result import (
    PLAYING,
    Capture,
    EvaderResult,
    FlightResult,
    MissionResult,
    begins_game,
)
from guidance.session.orders.answers import failed_checks, missing, next_words
from guidance.session.plan import FlightPlan, plan_of
from guidance.sim.scenario import Flown, Pursuit, pursuits_of
from guidance.sim.sensor import SensedEvader

READY_WITHIN_S: Final = 120.0
"""Longest wait for a vehicle to become ready; an ArduCopter takes 40 s from its start."""

JUDGED_FOR_S: Final = 3.0
"""The run ends after preflight has refused an otherwise ready vehicle for this long."""

_ASK_EVERY_S: Final = 1.0
_SHOWN_EVERY_S: Final = 0.1
"""Period of the live line; events are shown at once."""

_WARNING: Final = 4
"""MAV_SEVERITY; lower numbers are more severe."""

MISSION_LIMIT_S: Final = 900.0
"""Longest mocked flight, not counting the time under an operator's order."""


class Progress(NamedTuple):
    """Contents of the live line.

    Attributes:
        now_s: The present.
        state: Of the flight.
        mode: The autopilot's, by its own name.
        certificate: Of the game; None outside of it.
        unit: Of the game's value.
        record_stopped: When and why the record stopped; empty before.
        waiting: Why a vehicle on the ground is not ready.
        why: The cause of this state.
        next: The orders that continue, if the flight waits for a person.
        vehicle: Its name; empty before it is known.
        evader: In a team, its evader.
        promise: In a team, the promise about that evader, and its status.
    """

    now_s: float
    state: State
    mode: str
    certificate: Certificate | None
    unit: str
    record_stopped: str = ""
    waiting: str = ""
    why: str = ""
    next: str = ""
    vehicle: str = ""
    evader: str = ""
    promise: str = ""


Show = Callable[[Progress], None]

LINGER_S: Final = 2.0
"""Wait of a mission after the flight held or yielded by itself."""

CONTACT_PATIENCE_S: Final = 60.0
"""Wait of a mission for a person's engage order after a telemetry gap."""

PATIENCE_S: Final = {
    State.READY: 60.0,
    State.RETURNING: 300.0,
    State.LANDING: 300.0,
    State.OUT_OF_CONTACT: 60.0,
}
"""Longest stay in states without a limit of their own; then the run ends."""


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


@dataclass(eq=False)
class Mission(CycleHooks):
    """The mission of all vehicles of a flight, around every cycle of their daemons: `before` and `after`.

    Args:
        flown: Who pursues whom.
        world: All vehicles and evaders; those that this process plays are moved from here.
        clock: The world's time.
        plans: Flight plans by vehicle; by default the scenario's own.
        equipment: Of the daemons, by vehicle.
        policy: Which orders the mission may give.
        show: Called for each vehicle ten times a second and at every event; None shows nothing.

    Attributes:
        daemons: One for each vehicle.
        result: Of the flight so far.

    Raises:
        ConfigError: If a scenario names what does not exist.
    """

    flown: Flown
    world: World
    clock: Clock
    _: KW_ONLY
    plans: Mapping[str, FlightPlan] = field(default_factory=dict)
    equipment: Mapping[str, Equipment] = field(default_factory=dict)
    policy: MissionPolicy = MOCKED
    show: Show | None = None

    def __post_init__(self) -> None:
        """Begin with nothing flown."""
        self.vehicles = [VehicleMission(self, pursuit) for pursuit in pursuits_of(self.flown)]
        self.daemons = [vehicle.daemon for vehicle in self.vehicles]
        self.result = MissionResult(
            {vehicle.pursuit.vehicle: vehicle.result for vehicle in self.vehicles},
            {vehicle.pursuit.evader: EvaderResult() for vehicle in self.vehicles},
            {daemon.name: daemon.team for daemon in self.daemons if daemon.team is not None},
        )
        # In a team all vehicles may play against an evader.
        self._pursuers = {
            evader: [
                vehicle
                for vehicle in self.vehicles
                if self.result.members or vehicle.pursuit.evader == evader
            ]
            for evader in self.world.players
        }

    def fly(self, signals: Signals | None = None) -> MissionResult:
        """Fly to the end. The caller closes the world.

        Args:
            signals: Of the operating system; None leaves them to the process.

        Raises:
            FlightError: If a vehicle may not fly, or does not get ready.
            LinkError: If the world ends before the flight does.
        """
        begun_s = time.perf_counter()
        run(self.daemons, self.world, self.clock, mission=self, signals=signals)
        return self.stop(time.perf_counter() - begun_s)

    @property
    def finished(self) -> bool:
        """True when the flights of all mocks are over. A real vehicle's flight ends when its daemon hands it over."""
        return all(vehicle.over for vehicle in self.vehicles)

    def before(self, now_s: float) -> None:
        """Move the evaders to the present, and give the orders that are due."""
        for vehicle in self.vehicles:
            vehicle.locate()
        for name, player in self.world.players.items():
            positions_game_m = []
            playing = False
            for pursuer in self._pursuers[name]:
                playing |= pursuer.playing
                if pursuer.position_game_m is not None:
                    positions_game_m.append(pursuer.position_game_m)
            # A member of the team knows when an evader has reached its target.
            player.step(
                now_s,
                positions_game_m,
                playing=playing
                and not any(name in member.board.over for member in self.result.members.values()),
            )
        states: set[State] = set()
        if self.result.members:
            states = {vehicle.daemon.flight.state for vehicle in self.vehicles}
        for vehicle in self.vehicles:
            if not states & _WAITS_FOR.get(vehicle.daemon.flight.state, frozenset()):
                vehicle.before(now_s)

    def after(self, now_s: float, late_s: float = 0.0) -> None:
        """Follow a cycle.

        Raises:
            FlightError: As `VehicleMission.after`.
        """
        for vehicle in self.vehicles:
            if vehicle.over:
                continue
            evader_m = vehicle.evader_game_m(now_s)
            evader = self.result.evaders[vehicle.evader]
            vehicle.after(now_s, late_s, evader_m)
            # Others may chase it too
            if evader_m is not None and (not evader.track or evader.track[-1][0] < now_s):
                evader.track.append((now_s, evader_m))
            captures = any(
                transition.event is Event.CAPTURED
                for transition in vehicle.daemon.outputs.transitions
            )
            certificate = vehicle.result.latest
            if captures and certificate is not None and evader.capture is None:
                evader.capture = Capture(vehicle.pursuit.vehicle, now_s, certificate.evader_game_m)

    def stop(self, wall_s: float) -> MissionResult:
        """Stop the evaders that this process plays, and return the result of the run, which took `wall_s`."""
        for player in self.world.players.values():
            player.stop()
        for vehicle in self.vehicles:
            vehicle.result.interrupted = not (
                vehicle.over or vehicle.daemon.leaving is Authority.MISSION
            )
            vehicle.result.wall_s = wall_s
        return self.result


_UNFIT: Final = frozenset({State.CONNECTING, State.CHECKING})
_WAITS_FOR: Final[Mapping[State, frozenset[State]]] = {
    State.READY: _UNFIT,
    State.STANDING_BY: _UNFIT | {State.READY, State.ARMING, State.CLIMBING, State.POSITIONING},
}
"""In a team, a vehicle in one of these states gets no order while another one is in one of those."""


class VehicleMission:
    """One vehicle's part of a mission, with its daemon.

    It starts when everything is ready, engages when both stand by, and ends after the game or its time limit. Under
    an operator's order it orders nothing and does not end.

    Attributes:
        engaged_s: When the game began; anew if an operator engages again after a hold. None before.
        over: True when the flight of a mock is over.
        position_game_m: The vehicle's position in the game frame from its own telemetry, None until heard.
    """

    def __init__(self, mission: Mission, pursuit: Pursuit) -> None:
        scenario, vehicle, evader = self.pursuit = pursuit
        equipment = mission.equipment.get(vehicle, Equipment())
        self._mission = mission
        self._policy = mission.policy
        world = mission.world
        plan = mission.plans.get(vehicle)
        if plan is None:
            plan = plan_of(scenario=scenario)
        self.result = FlightResult(scenario, plan.flight.cycle, State.CONNECTING)
        self.over = False
        self.engaged_s: float | None = None
        self.position_game_m: Enu | None = None
        self._heard = {
            name: SensedEvader(source, scenario.sensor, scenario.seed, mission.clock.now_s)
            for name, source in world.evaders[vehicle].items()
            if equipment.team is not None or name == evader
        }
        self.daemon = Daemon(vehicle, plan, world.links[vehicle], self._heard, equipment)
        self._begun_s = mission.clock.now_s()
        self._limit_from_s = 0.0
        self._refused_s = math.inf
        self._asked_s = -math.inf
        self._shown_s = -math.inf

    @property
    def playing(self) -> bool:
        """From engagement until capture. The evader plays in this time, also while the pursuer pauses."""
        return self.engaged_s is not None and self.daemon.flight.state in PLAYING

    @property
    def evader(self) -> str:
        """The evader that it plays against now."""
        role = self.daemon.flight.observed.role
        return self.pursuit.evader if role is None else role.evader

    def locate(self) -> None:
        """Note the vehicle's position in the game frame from its own telemetry, None until heard."""
        local = self.daemon.flight.vehicle.latest.get(LocalPosition)
        frame = self.daemon.flight.tracking.game_frame
        self.position_game_m = (
            None
            if local is None or frame is None
            else frame.position_from_ned(local.position_ned_m)
        )

    def before(self, now_s: float) -> None:
        """Give the order that is due."""
        order = self._due(now_s)
        if order is None:
            return
        begins = order in {Event.START, Event.ENGAGE}
        allowed = self._policy.engage if begins else self._policy.end_with is not None
        if allowed:
            if now_s - self._asked_s >= _ASK_EVERY_S:
                self._asked_s = now_s
                self.daemon.mailbox.ask(str(order), authority=Authority.MISSION)
        elif not begins and self.engaged_s is not None:
            self._leave(now_s)

    def _due(self, now_s: float) -> Event | None:
        """Return the order that is due, if there is one."""
        flight = self.daemon.flight
        state = flight.state
        if flight.ordered_by_operator:
            return None
        back = flight.cause is not None and flight.cause.event is Event.CONTACT
        player = self._mission.world.players.get(self.evader)
        if player is None or player.ready:
            if state is State.READY:
                return Event.START
            if state is State.STANDING_BY and self.engaged_s is None and not back:
                silence_s = flight.tracking.silence_s(now_s)
                if silence_s < flight.settings.cycle.evader_timeout_s:
                    return Event.ENGAGE
        if self.engaged_s is not None and state in PLAYING:
            time_is_up = now_s - self.engaged_s > self.pursuit.scenario.time_limit_s
        else:
            # Longest time in the state.
            if state is State.ON_STATION:
                stay_s = self.pursuit.scenario.hold_s
            elif state is State.STANDING_BY and back:
                stay_s = CONTACT_PATIENCE_S
            else:
                stay_s = LINGER_S if state in {State.HOLDING, State.STANDING_BY} else math.inf
            time_is_up = self._in_state_s(now_s) >= stay_s
        if not time_is_up:
            return None
        return Event.LAND if self._policy.end_with is None else self._policy.end_with

    def _in_state_s(self, now_s: float) -> float:
        """Return how long the flight has been in its state, s; if an operator ordered it again, since then."""
        cause = self.daemon.flight.cause
        return 0.0 if cause is None else now_s - cause.now_s

    def after(self, now_s: float, late_s: float, evader_game_m: Enu | None) -> None:
        """Follow a cycle.

        Raises:
            FlightError: On the ground, if preflight refuses, the vehicle does not get ready, it is armed already,
                or the start is outside of its fence.
        """
        outputs = self.daemon.outputs
        result = self.result
        if self.daemon.flight.ordered_by_operator or result.cycles == 0:
            self._limit_from_s = now_s
        if any(map(begins_game, outputs.transitions)):
            # The times of the sensor and of the faults count from the first game.
            if self.engaged_s is None:
                for source in self._heard.values():
                    source.engage(now_s)
                self._mission.world.engage(self.pursuit.vehicle)
            self.engaged_s = now_s
        result.late_cycles += late_s > PERIOD_S
        result.record_stopped = self.daemon.recording.stopped
        result.note(now_s, outputs, self.position_game_m, evader_game_m)
        result.duration_s = now_s - self._begun_s
        if self.daemon.survey.judges:
            self._listen()
            if outputs.state in BEFORE_FLIGHT:
                self._judge(now_s)
        given_up = self._policy.hand_over is None and now_s - self._limit_from_s >= MISSION_LIMIT_S
        flight = self.daemon.flight
        lasts_s = self._in_state_s(now_s)
        if flight.state is State.YIELDED:
            ended = lasts_s >= LINGER_S  # the record then shows the silence
        else:
            limit_s = PATIENCE_S.get(flight.state, math.inf) if self._policy.engage else math.inf
            ended = flight.state in FINAL or (lasts_s > limit_s and not flight.ordered_by_operator)
        if ended or given_up:
            self._leave(now_s)
        if self._mission.show is not None and (
            outputs.transitions or now_s - self._shown_s >= _SHOWN_EVERY_S
        ):
            self._shown_s = now_s
            team = self.daemon.team
            unit = "s" if self.pursuit.scenario.target is None else "m"
            promise_words = ""
            if team is not None and team.board.roles is not None:
                promises = team.board.roles.promises
                promise_words = next(
                    (promise.words(unit) for promise in promises if promise.evader == self.evader),
                    "",
                )
            cause = "" if outputs.cause is None else outputs.cause.words
            against = "" if team is None else self.evader
            progress = Progress(
                now_s,
                outputs.state,
                flight.mode_title,
                outputs.certificate,
                unit,
                self.result.record_stopped,
                self._waiting(now_s),
                cause,
                next_words(flight),
                self.pursuit.vehicle,
                against,
                promise_words,
            )
            self._mission.show(progress)

    def _waiting(self, now_s: float) -> str:
        """Say briefly why a vehicle that preflight judges is not ready; empty if it is, and for any other."""
        flight = self.daemon.flight
        if not self.daemon.survey.judges or flight.state not in _UNFIT:
            return ""
        if failed := failed_checks(flight, now_s):
            return failed + self._said("it says")
        if not self.daemon.survey.memory.complete:
            return "its parameters are being read"
        refused = ", ".join(refusals(self.daemon.survey.rows))
        return f"preflight refuses {refused if refused else 'nothing any more'}"

    def _said(self, speaker: str) -> str:
        return f'; {speaker} "{self.result.said}"' if self.result.said else ""

    def evader_game_m(self, now_s: float) -> Enu | None:
        """Return the evader's position in the game frame: the true one, or as the vehicle estimates it."""
        if (player := self._mission.world.players.get(self.evader)) is not None:
            return player.position_game_m
        tracking = self.daemon.flight.tracking
        evader = tracking.evader(now_s)
        frame = tracking.game_frame
        return (
            None
            if evader is None or frame is None
            else frame.position_from_ned(evader.position_ned_m)
        )

    def _listen(self) -> None:
        """Keep the autopilot's last warning before the flight."""
        if self.daemon.flight.state not in BEFORE_FLIGHT | {State.ARMING}:
            return
        for message in self.daemon.inputs.messages:
            if isinstance(message, StatusText) and message.severity <= _WARNING:
                self.result.said = message.text
            elif (
                isinstance(message, CommandAck)
                and message.command == MAV_CMD_COMPONENT_ARM_DISARM
                and message.result
                and not self.result.said
            ):
                self.result.said = f"arming refused (MAV_RESULT {message.result})"

    def _leave(self, now_s: float) -> None:
        if self._policy.hand_over is None:
            self.over = True
        elif self.daemon.leaving is None:
            self.daemon.leave(self._policy.hand_over, now_s, Authority.MISSION)

    def _judge(self, now_s: float) -> None:
        daemon = self.daemon
        flight = self.daemon.flight
        if self._policy.end_with is not None and flight.vehicle.armed:
            raise FlightError(
                "the vehicle is armed already; disarm it and start again: no order was given"
            )
        start = flight.settings.start_game_m
        frame = flight.tracking.game_frame
        home = flight.vehicle.latest.get(Home)
        fence_m = flight.settings.cycle.envelope.fence_radius_m
        if start is not None and frame is not None and home is not None and fence_m is not None:
            # To the start the autopilot flies by itself, and our limits do not act.
            away_m = math.dist(frame.position_to_ned(Enu(start))[:2], home.position_ned_m[:2])
            if away_m > fence_m:
                allowed = f"allowed is the fence's {fence_m:g} m. Does [site] of the scenario say where the vehicle is?"
                raise FlightError(
                    f"pursuer.position_m is {away_m:.0f} m from the vehicle's home; {allowed}"
                )
        refused = (
            daemon.survey.memory.complete
            and not failed_checks(flight, now_s)
            and bool(refusals(daemon.survey.rows))
        )
        self._refused_s = min(self._refused_s, now_s) if refused else math.inf
        if now_s - self._refused_s >= JUDGED_FOR_S:
            raise FlightError(
                f"preflight refuses: {advice(daemon.survey.rows)}; see `guidance check`"
            )
        if flight.state is not State.READY and self.result.duration_s > READY_WITHIN_S:
            lacking = missing(flight, now_s, daemon.survey.rows) + self._said("the autopilot says")
            raise FlightError(
                f"not ready to fly within {READY_WITHIN_S:g} s: {lacking}; nothing was armed"
            )
