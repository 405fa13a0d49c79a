"""What happens to a flight besides the faults of its vehicle and links: people, other programs, changed settings.

Each disturbance has a time after the vehicle became ready, after the start order or after the game began. The judge of
disturbances checks what an operator, a pilot and another program are promised.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from random import Random
from typing import Any, Final

from guidance.autopilots import Preflight, Wants
from guidance.clock import VirtualClock
from guidance.flight import BEFORE_FLIGHT, FINAL, Authority, Event, Outputs, State
from guidance.flight.freshness import CHARGE_LIMIT_S, STATUS_LIMIT_S
from guidance.flight.table import HANDING_OVER, SETPOINT_STATES, TRANSITIONS
from guidance.links.evaders.carriers import GLOBAL_POSITION
from guidance.links.evaders.mavlink import MavlinkEvader
from guidance.links.mavlink.pymavlink_link import PymavlinkLink
from guidance.session.fly.daemon import Daemon, Equipment
from guidance.session.plan import FlightPlan
from guidance.sim.scenario import Pursuit, Scenario
from guidance.sim.stepped import SteppedWorld
from sitl_mock import MockVehicle
from sitl_mock.protocols.command import Command

DO_SET_HOME: Final = 179
ARM: Final = 400
GUIDED: Final = frozenset({"OFFBOARD", "GUIDED"})
HOLD_MODES: Final = frozenset({"HOLD", "BRAKE"})
SOMEBODY: Final = (255, 190)

ORDERS: Final = (Event.HOLD, Event.LAND, Event.RETURN, Event.ABORT)
ENDING: Final = frozenset(ORDERS)
STATUS_LOST: Final = {
    "kind": "loss",
    "messages": ["SYS_STATUS"],
    "probability": 1.0,
    "direction": "out",
    "at_s": 0.0,
}

HEARTBEAT_S: Final = 1.2
"""HEARTBEAT shows a mode and arming so late at most, if no frame is lost."""

READ_S: Final = 2.5
"""Parameters that change while they are read for an order to engage need not be noticed."""

TOGETHER_S: Final = 3.3
"""Two programs in the guided mode are told apart by their setpoints: within two seconds and a HEARTBEAT."""

APART_M_S: Final = 1.5
"""Setpoints that differ by less may resemble each other."""

BARRED_S: Final = 12.0

RISEN_M: Final = 2.5

UNSAFE: Final[Mapping[str, tuple[tuple[str, float], ...]]] = {
    "px4": (("COM_OF_LOSS_T", 4.0), ("COM_OBL_RC_ACT", 7.0), ("GF_ACTION", 0.0), ("GF_MAX_VER_DIST", 3.0)),
    "arducopter": (("GUID_TIMEOUT", 5.0), ("FENCE_ENABLE", 0.0), ("FENCE_ACTION", 0.0), ("FENCE_ALT_MAX", 3.0)),
}  # fmt: skip
"""Values that preflight refuses; nobody announces the change."""


@dataclass(frozen=True)
class Disturbance:
    """One disturbance: its kind, its time after "ready", "start" or "engaged", and its size."""

    kind: str
    at_s: float
    after: str
    what: Any = None


def orders(chance: Random, _autopilot: str) -> tuple[Disturbance, ...]:
    """Draw one or two orders of a person, from the start order on."""
    after = chance.choice(("start", "start", "engaged"))
    longest_s = 25.0 if after == "start" else 6.0
    given = [(round(chance.uniform(0.0, longest_s), 2), chance.choice(ORDERS))]
    if chance.random() < 0.5:
        later_s = round(given[0][0] + chance.uniform(0.1, 4.0), 2)
        given.append((later_s, chance.choice((*ORDERS, Event.ENGAGE))))
    return tuple(Disturbance("orders", at_s, after, order) for at_s, order in given)


def home_moved(chance: Random, _autopilot: str) -> tuple[Disturbance, ...]:
    """Draw one or two places where home is set, before the start and in flight."""
    moves = [("ready", 0.1), ("start", 20.0), ("engaged", 6.0)]
    return tuple(
        Disturbance(
            "home_moved",
            round(chance.uniform(0.0, longest_s), 2),
            after,
            (round(chance.uniform(-40.0, 40.0), 1), round(chance.uniform(-40.0, 40.0), 1)),
        )
        for after, longest_s in chance.sample(moves[1:], chance.choice((1, 2)))
    )


def status_stops(chance: Random, _autopilot: str) -> tuple[Disturbance, ...]:
    """Draw when SYS_STATUS stops."""
    after = chance.choice(("ready", "start", "start", "engaged"))
    longest_s = {"ready": 0.0, "start": 15.0, "engaged": 3.0}[after]
    return (Disturbance("status_stops", round(chance.uniform(0.0, longest_s), 2), after),)


def parameter_changed(chance: Random, autopilot: str) -> tuple[Disturbance, ...]:
    """Draw a parameter that becomes unsafe between the check and the game."""
    changed = chance.choice(UNSAFE[autopilot])
    return (
        Disturbance("parameter_changed", round(chance.uniform(0.0, 15.0), 2), "start", changed),
    )


def armed_by_pilot(chance: Random, autopilot: str) -> tuple[Disturbance, ...]:
    """Draw the mode in which a pilot arms on the ground, before or just after the start order would come."""
    mode = chance.choice(
        {"px4": ("POSCTL", "HOLD"), "arducopter": ("LOITER", "STABILIZE")}[autopilot]
    )
    return (Disturbance("armed_by_pilot", round(chance.uniform(0.0, 2.0), 2), "ready", mode),)


def second_daemon(chance: Random, _autopilot: str) -> tuple[Disturbance, ...]:
    """Draw when another daemon begins to order start and engage."""
    after = chance.choice(("start", "engaged"))
    longest_s = 20.0 if after == "start" else 4.0
    return (Disturbance("second_daemon", round(chance.uniform(0.0, longest_s), 2), after),)


DISTURBANCES: Final[Mapping[str, Callable[[Random, str], tuple[Disturbance, ...]]]] = {
    "orders": orders,
    "home_moved": home_moved,
    "status_stops": status_stops,
    "parameter_changed": parameter_changed,
    "armed_by_pilot": armed_by_pilot,
    "second_daemon": second_daemon,
}

START_AFTER_S: Final = {"armed_by_pilot": 2.2}
"""The start order waits for so long after the vehicle became ready, so that something can happen before it."""


def wants_of(scenario: Scenario, planned: FlightPlan) -> Wants:
    """Return what preflight demands of a vehicle whose parameters will change."""
    return Wants(
        Preflight(),
        planned.flight.limits,
        scenario.pursuer.speeds,
        scenario.speed_limits,
        battery_needed=None,
        evader_height_limit_m=30.0,
        announces=False,
        evader_speed_m_s=scenario.evader.speed_m_s,
        standoff_radius_m=scenario.standoff.radius_m,
    )


def set_up(vehicle: MockVehicle, scenario: Scenario) -> None:
    """Give a vehicle the parameters that preflight passes."""
    limits = scenario.limits
    radius_m = limits.fence_radius_m + 10.0
    height_m = limits.ceiling_m + 10.0
    speed_m_s = max(12.0, scenario.speed_limits.speed_m_s)
    values = {
        "px4": {
            "COM_OBL_RC_ACT": 5,
            "GF_ACTION": 2,
            "GF_MAX_HOR_DIST": radius_m,
            "GF_MAX_VER_DIST": height_m,
            "RTL_RETURN_ALT": limits.ceiling_m,
            "MPC_XY_VEL_MAX": speed_m_s,
        },
        "arducopter": {
            "GUID_TIMEOUT": 1.0,
            "FENCE_ENABLE": 1,
            "FENCE_TYPE": 7,
            "FENCE_RADIUS": radius_m,
            "FENCE_ALT_MAX": height_m,
            "RTL_ALT": 100.0 * limits.ceiling_m,
        },
    }[scenario.pursuer.autopilot]
    for name, value in values.items():
        vehicle.autopilot.parameters.set(name, value)


class Disturbed:
    """Brings a flight's disturbances about, and checks what is promised then.

    Args:
        disturbances: Of the vehicle.
        pursuit: The vehicle, and the evader that it plays against.
        world: Its world.
        clock: Its clock.
        daemon: Its daemon.
        wrong: Called with the name of a violated promise, the time, its amount, and words.
        alone: Whether nothing else goes wrong in this flight.
    """

    def __init__(
        self,
        disturbances: tuple[Disturbance, ...],
        pursuit: Pursuit,
        world: SteppedWorld,
        clock: VirtualClock,
        daemon: Daemon,
        wrong: Callable[[str, float, float, str], None],
        *,
        alone: bool,
    ) -> None:
        self._due = list(disturbances)
        self._kinds = set[str]()
        self._pursuit = pursuit
        self._world = world
        self._clock = clock
        self._vehicle = world.vehicles[pursuit.vehicle]
        self._daemon = daemon
        self._wrong = wrong
        self._alone = alone
        self._began_s: dict[str, float] = {}
        self._asked: list[Any] = []
        self._order: Event | None = None
        self._order_height_m: float | None = None
        self._status_s: float | None = None
        self._unsafe_s: float | None = None
        self._armed_s: float | None = None
        self._guided_s: float | None = None
        self._pilots_s: float | None = None
        self._second: Daemon | None = None
        self._second_asked_s = 0.0
        self._together_s: float | None = None

    @property
    def begun(self) -> frozenset[str]:
        """Kinds of the disturbances that have begun."""
        return frozenset(self._kinds)

    @property
    def ended_by_order(self) -> bool:
        """Whether an operator's order to end the flight stands."""
        return self._order is not None

    def barred(self, now_s: float) -> bool:
        """Whether the vehicle stands by for good, because an unsafe parameter bars the game."""
        waiting = self._daemon.flight.state is State.STANDING_BY
        return waiting and self._unsafe_s is not None and now_s - self._unsafe_s > BARRED_S

    def holds_back_start(self, now_s: float) -> bool:
        """Whether the mission may not give its start order yet."""
        waits_s = max((START_AFTER_S.get(one.kind, 0.0) for one in self._due), default=0.0)
        ready_s = self._began_s.get("ready")
        return waits_s > 0.0 and (ready_s is None or now_s - ready_s < waits_s)

    def before(self, now_s: float) -> None:
        """Bring about what is due before a cycle."""
        state = self._daemon.flight.state
        if state is State.READY:
            self._began_s.setdefault("ready", now_s)
        if state not in BEFORE_FLIGHT:
            self._began_s.setdefault("start", now_s)
        if state is State.ENGAGED:
            self._began_s.setdefault("engaged", now_s)
        for one in list(self._due):
            if now_s >= self._began_s.get(one.after, now_s + 1.0) + one.at_s:
                self._due.remove(one)
                self._bring_about(one, now_s)
        if self._second is not None:
            self._step_second(self._second, now_s)

    def _bring_about(self, one: Disturbance, now_s: float) -> None:
        autopilot = self._vehicle.autopilot
        self._kinds.add(one.kind)
        match one.kind:
            case "orders":
                begun = self._daemon.flight.state not in BEFORE_FLIGHT | FINAL
                question = self._daemon.mailbox.ask(str(one.what), "a person")
                self._asked.append((now_s, one.what, begun, question))
            case "home_moved":
                place = autopilot.frame.to_geodetic(*one.what, 0.0)
                self._command(now_s, DO_SET_HOME, 0.0, 0.0, 0.0, 0.0, *place)
            case "status_stops":
                self._world.faulted[self._pursuit.vehicle].inject(STATUS_LOST)
                self._status_s = now_s
            case "parameter_changed":
                autopilot.parameters.set(*one.what)
                self._unsafe_s = now_s
            case "armed_by_pilot":
                self._vehicle.inject("rc", True)
                self._vehicle.inject("pilot_mode", one.what)
                self._command(now_s, ARM, 1.0)
                if self._daemon.flight.state in BEFORE_FLIGHT:
                    self._pilots_s = now_s
            case "second_daemon":
                self._second = self._another_daemon()

    def _command(self, now_s: float, number: int, *params: float) -> None:
        """Command the autopilot as somebody else does."""
        filled = [*params, *[0.0] * (7 - len(params))]
        p1, p2, p3, p4, p5, p6, p7 = filled
        command = Command(number, (p1, p2, p3, p4, p5, p6, p7), 0, True, SOMEBODY, 0)
        self._vehicle.autopilot.commander.execute(now_s, command)

    def _another_daemon(self) -> Daemon:
        world = self._world
        _, vehicle, evader = self._pursuit
        link = PymavlinkLink(
            world.wire(vehicle), self._clock.now_s, system_id=self._vehicle.system_id
        )
        source = MavlinkEvader(
            world.wire(evader), GLOBAL_POSITION, system_id=world.vehicles[evader].system_id
        )
        return Daemon("second", self._daemon.plan, link, {evader: source}, Equipment())

    def _step_second(self, second: Daemon, now_s: float) -> None:
        """The other daemon's person orders start and engage every second."""
        if now_s - self._second_asked_s >= 1.0:
            self._second_asked_s = now_s
            second.mailbox.ask(str(Event.START), "another person")
            second.mailbox.ask(str(Event.ENGAGE), "another person")
        second.step(now_s)
        self._judge_start(now_s, second.outputs, "the second daemon")
        ours = self._daemon.outputs.setpoint
        theirs = second.outputs.setpoint
        both = {self._daemon.flight.state, second.flight.state} <= SETPOINT_STATES
        apart_m_s = 0.0
        if both and ours is not None and theirs is not None:
            apart_m_s = math.dist(ours.velocity_ned_m_s, theirs.velocity_ned_m_s)
        if apart_m_s < APART_M_S:
            self._together_s = None
        elif self._together_s is None:
            self._together_s = now_s
        elif now_s - self._together_s > TOGETHER_S:
            self._wrong("two programs never command together", now_s, now_s - self._together_s, "")

    def after(self, now_s: float, outputs: Outputs) -> None:
        """Check a cycle."""
        self._judge_start(now_s, outputs, "the first daemon")
        if not self._vehicle.armed:
            self._armed_s = None
            self._pilots_s = None
        elif self._armed_s is None:
            self._armed_s = now_s
        if self._vehicle.mode not in GUIDED:
            self._guided_s = None
        elif self._guided_s is None:
            self._guided_s = now_s
        self._judge_orders(now_s, outputs)
        self._judge_status(now_s, outputs)
        engaged = any(one.after is State.ENTERING for one in outputs.transitions)
        if engaged and self._unsafe_s is not None and now_s - self._unsafe_s > READ_S:
            self._wrong("no game with an unsafe parameter", now_s, now_s - self._unsafe_s, "")

    def _judge_start(self, now_s: float, outputs: Outputs, who: str) -> None:
        """Nobody else's vehicle is taken: armed on the ground, or in its guided mode."""
        for one in outputs.transitions:
            if one.event not in {Event.START, Event.ALOFT} or one.after is one.before:
                continue
            armed_s = self._armed_s
            if one.after is State.ARMING and armed_s is not None and now_s - armed_s > HEARTBEAT_S:
                self._wrong(
                    "nobody else's vehicle is taken", now_s, now_s - armed_s, f"{who}: armed"
                )
            guided_s = self._guided_s
            if guided_s is not None and now_s - guided_s > HEARTBEAT_S and self._vehicle.armed:
                words = f"{who}: {self._vehicle.mode}"
                self._wrong("nobody else's vehicle is taken", now_s, now_s - guided_s, words)

    def _judge_orders(self, now_s: float, outputs: Outputs) -> None:
        """An order to end the flight is accepted from the start order on, and stands."""
        for asked in list(self._asked):
            asked_s, order, begun, question = asked
            if not question.done():
                continue
            self._asked.remove(asked)
            accepted = question.result()["accepted"]
            gone = outputs.state in FINAL
            if order in ENDING and begun and not accepted and not gone:
                self._wrong("an order is obeyed", asked_s, 1.0, f"{order}: {question.result()}")
        for one in outputs.transitions:
            if one.by is not Authority.OPERATOR:
                continue
            if one.event in ENDING and one.after in HANDING_OVER:
                self._order = one.event
                grounded = one.before in {State.ARMING, State.CLIMBING}
                self._order_height_m = -self._vehicle.truth.position_ned_m[2] if grounded else None
            elif one.event is Event.ENGAGE and one.after is State.ENTERING:
                self._order = None
        if self._order is None:
            return
        if outputs.state not in HANDING_OVER | FINAL:
            self._wrong("an order stands", now_s, 1.0, f"{self._order}: {outputs.state}")
        if self._order_height_m is None or self._order is Event.RETURN or not self._alone:
            return
        risen_m = -self._vehicle.truth.position_ned_m[2] - self._order_height_m
        if risen_m > RISEN_M:
            self._wrong("an order ends the take-off", now_s, risen_m, str(self._order))

    def _judge_status(self, now_s: float, outputs: Outputs) -> None:
        """Without SYS_STATUS no flight begins, and one in the air ends."""
        if self._status_s is None:
            return
        silent_s = now_s - self._status_s
        began = any(
            one.event is Event.START and one.after is not one.before for one in outputs.transitions
        )
        if began and silent_s > STATUS_LIMIT_S + 1.2:
            self._wrong("no start by an old status", now_s, silent_s, "")
        # One transition a cycle: the climb has begun in this one, or has ended in it.
        stays = all(one.after is one.before for one in outputs.transitions)
        plays_on = stays and (outputs.state, Event.BATTERY_UNKNOWN) in TRANSITIONS
        if plays_on and silent_s > CHARGE_LIMIT_S + 1.2 and not self.ended_by_order:
            self._wrong("no flight by an old charge", now_s, silent_s, str(outputs.state))
