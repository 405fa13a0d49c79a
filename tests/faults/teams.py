"""`python -m tests faults --teams`: random team flights in virtual time, with one to three faults each.

Geometry, game, speeds, wind, noise and faults are drawn from the seed and the flight's number. The judge knows the true
state of the mocks. It checks the separation of vehicles that both fly our setpoints, promises and their causes, the
captures that were guaranteed at engagement, and the invariants of `docs/faults.md` for each vehicle.
"""

import contextlib
import json
import math
import random
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations, permutations
from typing import Any, Final, NamedTuple, cast

from guidance.clock import VirtualClock
from guidance.control.follow import gaps_to_disc
from guidance.cycle import Capability, Players, certify
from guidance.flight import Event, State
from guidance.flight.table import SETPOINT_STATES
from guidance.frames import Enu, ned_from_game
from guidance.game import Game, Winner
from guidance.links.port import EvaderSource
from guidance.messages import EvaderReport
from guidance.session.fly.daemon import Daemon, Equipment
from guidance.session.fly.loop import run
from guidance.session.fly.mission import Mission, MissionPolicy
from guidance.session.plan import plan_of
from guidance.session.recorded_flight import team_plan
from guidance.sim.scenario import EVADER, PURSUER, Pursuit, Wind
from guidance.sim.stepped import SteppedWorld
from guidance.sim.team_flight import pursuits_of_team
from guidance.sim.teams import TeamScenario
from guidance.team import Member
from tests.faults.disturbances import DISTURBANCES, Disturbance, Disturbed, set_up, wants_of
from tests.faults.drawing import Case
from tests.faults.invariants import Violation, Watch
from tests.team.lossy import LossyNetwork

SIZES: Final = ((2, 1), (2, 2), (3, 2), (3, 3))
LONGEST_S = 75.0
AFTER_S = 3.0
ON_GROUND_S = 120.0
UNDISTURBED: Final = frozenset({"home_moved"})
"""Disturbances that keep no vehicle from its game."""

NEVER_S: Final = 50.0
"""A team with a disturbed vehicle that has not engaged by then is not watched longer: its mates wait for it."""

PLAYED: Final = frozenset({State.ENGAGED, State.ON_STATION})
"""A vehicle is able while it is in one of these states. In PE a pause only delays the capture."""

NEAR_M: Final = 0.5
"""Allowed below the separation, besides the true errors of both estimates."""

STILL: Final = (0.0, 0.0, 0.0)

KINDS: Final = (
    "mate killed", "coordinator killed", "cut 1 s", "cut 3 s", "cut 10 s", "loss", "clock", "forged", "misreport",
    "heard by one", "crossing", "pilot lands", "late", "estimate jumps", "position forged", "mate forged",
    "mate swings", "mate hurries", "mate misnumbers", "telemetry lost", *DISTURBANCES,
)  # fmt: skip
PAIR: Final = ("misreport", "telemetry lost")
"""Of one mate: it is elsewhere than it says, and then its cylinder grows. Floor, ceiling and fence rank before it."""

PAIR_EVERY: Final = 7
"""Every seventh flight has the pair, and so teams of every size."""

EXPLAINED: Final = frozenset(KINDS) - {
    "forged", "crossing", "heard by one", "misreport", "mate swings", "mate hurries", "home_moved",
}  # fmt: skip
"""Faults after which a vehicle is lost to its coordinator, or seems to be."""

POSITION_LOST: Final = {
    "kind": "loss",
    "messages": ["LOCAL_POSITION_NED"],
    "probability": 1.0,
    "direction": "out",
    "at_s": 0.0,
}
MATE_FORGED_S: Final = 6.0
LATEST_S: Final = 3.0


class TeamCase(NamedTuple):
    """One flight: the scenario, the wind, and the faults with their times after engagement, s, and the vehicle.

    `disturbances` are what people and other programs do to the vehicle `disturbed`, with times of their own.
    """

    seed: int
    number: int
    scenario: TeamScenario
    wind_m_s: tuple[float, float]
    faults: tuple[tuple[str, float, str], ...]
    disturbed: str
    disturbances: tuple[Disturbance, ...]

    @property
    def kinds(self) -> tuple[str, ...]:
        """Names of the faults."""
        disturbed = dict.fromkeys(one.kind for one in self.disturbances)
        return (*(kind for kind, *_ in self.faults), *disturbed)


class TeamRow(NamedTuple):
    """Result of one flight."""

    case: TeamCase
    least_m: float
    captured: int
    guaranteed: int
    processor_s: float
    violations: tuple[Violation, ...]


def draw(seed: int, number: int) -> TeamCase:
    """Draw a flight."""
    chance = random.Random(f"teams {seed} {number}")
    vehicles, evaders = SIZES[number % len(SIZES)]
    game = chance.choice(("pe", "tad"))
    has_pair = number % PAIR_EVERY == PAIR_EVERY - 1
    kinds = PAIR if has_pair else chance.sample(KINDS, chance.randint(1, 3))
    turn = chance.uniform(0.0, 2.0 * math.pi)
    pursuers = []
    for index in range(vehicles):
        angle = turn + 2.0 * math.pi * index / vehicles
        away_m = chance.uniform(12.0, 22.0)
        position_m = (away_m * math.cos(angle), away_m * math.sin(angle), 12.0)
        pursuers.append({"position_m": position_m, "speed_m_s": chance.uniform(5.0, 7.0)})
    rovers = []
    bearing = chance.uniform(0.0, 2.0 * math.pi)
    for index in range(evaders):
        apart = 0.25 if "crossing" in kinds else chance.uniform(0.6, 2.0)
        angle = bearing + index * apart
        away_m = chance.uniform(35.0, 60.0)
        position_m = (away_m * math.cos(angle), away_m * math.sin(angle))
        rovers.append({"position_m": position_m, "speed_m_s": chance.uniform(1.5, 3.0)})
    noise = {
        "position_noise_m": chance.uniform(0.0, 0.5),
        "velocity_noise_m_s": chance.uniform(0.0, 0.2),
    }
    scenario = TeamScenario.model_validate(
        {
            "title": f"team {seed} {number}", "game": game, "pursuer": pursuers, "evader": rovers, "seed": number,
            "target": {"position_m": (0.0, 0.0)} if game == "tad" else None, "time_limit_s": 90.0,
            "flight": {
                "separation_m": chance.uniform(6.0, 10.0), "takeoff_height_m": 12.0, "sensor": noise, "hold_s": 20.0,
                "standoff": {"radius_m": 3.0, "height_m": 8.0},
            },
        }
    )  # fmt: skip
    names = [f"uav{index + 1}" for index in range(vehicles)]
    faults = []
    disturbances: list[Disturbance] = []
    disturbed = chance.choice(names)
    for kind in kinds:
        if kind in DISTURBANCES:
            disturbances += DISTURBANCES[kind](chance, scenario.flight.autopilot)
        else:
            vehicle = disturbed if has_pair else chance.choice(names)
            faults.append((kind, chance.uniform(0.5, 4.0), vehicle))
    wind = (
        tuple(chance.uniform(-3.0, 3.0) for _ in range(2)) if chance.random() < 0.5 else (0.0, 0.0)
    )
    wind_m_s = cast("tuple[float, float]", wind)
    return TeamCase(seed, number, scenario, wind_m_s, tuple(faults), disturbed, tuple(disturbances))


class Deaf(EvaderSource):
    """An evader source that reports nothing."""

    def receive(self) -> Sequence[EvaderReport]:
        """Nothing."""
        return ()

    def counters(self) -> Mapping[str, int]:
        """None."""
        return {}

    def close(self) -> None:
        """Nothing."""


class Bent:
    """A transport that changes its vehicle's reports about itself after a fault begins."""

    def __init__(self, transport: Any) -> None:
        self._transport = transport
        self.change: Callable[[dict[str, Any]], None] | None = None
        self.last: dict[str, Any] = {}
        self.receive = transport.receive
        self.present = transport.present
        self.close = transport.close

    def publish(self, key: str, payload: bytes) -> None:
        """Send, changed if it is a state."""
        if key.startswith("state/"):
            state = json.loads(payload)
            if self.change is not None:
                self.change(state)
                payload = json.dumps(state).encode()
            self.last = state
        self._transport.publish(key, payload)


class Sortie:
    """A mission of a team with its faults and its judge."""

    def __init__(self, case: TeamCase) -> None:
        self.case = case
        self.clock = VirtualClock()
        wind = Wind(velocity_m_s=case.wind_m_s)
        self.pursuits = [
            pursuit._replace(scenario=pursuit.scenario.model_copy(update={"wind": wind}))
            for pursuit in pursuits_of_team(case.scenario)
        ]
        self.world = SteppedWorld(tuple(self.pursuits), self.clock)
        self.network = LossyNetwork(self.clock.now_s, delay_s=0.03, jitter_s=0.03, seed=case.number)
        names = [pursuit.vehicle for pursuit in self.pursuits]
        evaders = sorted(self.world.players)
        if "heard by one" in case.kinds:
            for name in names[1:]:
                self.world.evaders[name][evaders[0]] = Deaf()
        self.bent = {name: Bent(self.network.join(name)) for name in names}
        self.members = {
            pursuit.vehicle: Member(
                pursuit.vehicle,
                names,
                sorted(evaders, key=lambda name: name != pursuit.evader),
                self.bent[pursuit.vehicle],
                epoch=number,
                separation_height_m=case.scenario.flight.separation_height_m,
            )
            for number, pursuit in enumerate(self.pursuits)
        }
        team = team_plan(case.scenario, self.pursuits)
        plans = {
            pursuit.vehicle: plan_of(None, pursuit.scenario, team) for pursuit in self.pursuits
        }
        disturbed = self.pursuits[names.index(case.disturbed)]
        if "parameter_changed" in case.kinds:  # of a vehicle that preflight judges
            planned = plans[disturbed.vehicle]
            wants = wants_of(disturbed.scenario, planned)
            plans[disturbed.vehicle] = replace(planned, wants=wants)
            set_up(self.world.vehicles[disturbed.vehicle], disturbed.scenario)
        self.mission = Mission(
            tuple(self.pursuits),
            self.world,
            self.clock,
            plans=plans,
            equipment={name: Equipment(team=member) for name, member in self.members.items()},
            policy=MissionPolicy(engage=True, end_with=Event.HOLD),
        )
        self.daemons: dict[str, Daemon] = {daemon.name: daemon for daemon in self.mission.daemons}
        self.watches = {
            pursuit.vehicle: Watch(_case_of(case, pursuit), _Named(self.world, pursuit))
            for pursuit in self.pursuits
        }
        self.disturbed = Disturbed(
            case.disturbances,
            disturbed,
            self.world,
            self.clock,
            self.daemons[case.disturbed],
            self.watches[case.disturbed].wrong,
            alone=len(case.kinds) == 1,
        )
        self.engaged_s = self.over_s = math.inf
        self.due = sorted(case.faults, key=lambda fault: fault[1])
        self.later: list[tuple[float, Callable[[], None]]] = []
        self.forger: _Forger | None = None
        self.unable: set[str] = set()
        self.stopped: set[str] = set()
        self.unseen: set[str] = set()
        self.promised: set[str] = set()
        self.wrongs: list[Violation] = []
        self.least_m = math.inf
        self.guaranteed = 0
        self.first: dict[str, str] = {}
        self.winning: set[tuple[str, str]] = set()

    def fly(self) -> None:
        """Fly to the end."""
        try:
            run(self.mission.daemons, self.world, self.clock, mission=self)
        except Exception as error:  # the loop must not raise
            self.wrong("nothing ends the loop", 1.0, f"{type(error).__name__}: {error}")
        self.world.close()
        self._judge_end()

    def _judge_forger(self, cut_off: set[str]) -> None:
        """Check that every mate noticed two senders in one name."""
        if self.forger is None or self.clock.now_s() - self.forger.begun_s < 3.0:
            return
        if {"loss", "mate misnumbers"} & set(self.case.kinds):
            return
        if self.forger.mate in cut_off | self.unable:
            return  # then only one sender is heard
        for name in self.members.keys() - self.unable - cut_off - {self.forger.mate}:
            if not self.members[name].board.counts["refused_two senders"]:
                self.wrong("two senders in one name are noticed", 1.0, name)

    def wrong(self, invariant: str, amount: float, words: str = "") -> None:
        """Note a violation."""
        if all(violation.invariant != invariant for violation in self.wrongs):
            self.wrongs.append(
                Violation(invariant, self.clock.now_s() - self.engaged_s, amount, words)
            )

    @property
    def finished(self) -> bool:
        """True some seconds after all evaders are out of play, or when it took too long."""
        now_s = self.clock.now_s()
        return bool(
            now_s - self.over_s > AFTER_S
            or now_s - self.engaged_s > LONGEST_S
            or now_s > ON_GROUND_S + LONGEST_S
            or (self.disturbed.begun and self.engaged_s == math.inf and now_s > NEVER_S)
        )

    def before(self, now_s: float) -> None:
        """Let the mission give its orders."""
        self.disturbed.before(now_s)
        if not self.disturbed.holds_back_start(now_s):
            self.mission.before(now_s)

    def _disturb(self, now_s: float) -> None:
        """Start the faults that are due; they act in the next cycle."""
        for delayed in [entry for entry in self.later if entry[0] <= now_s]:
            self.later.remove(delayed)
            delayed[1]()
        if self.forger is not None:
            self.forger.speak(now_s, self.network, self.bent[self.forger.mate].last)
        while self.due and now_s - self.engaged_s >= self.due[0][1]:
            kind, _, vehicle = self.due.pop(0)
            self._begin(kind, vehicle, now_s)

    def _begin(self, kind: str, vehicle: str, now_s: float) -> None:
        """Begin a fault. One vehicle at least stays able."""
        some_left = len(self.unable) + 2 <= len(self.members)
        match kind:
            case "mate killed" | "coordinator killed" if some_left:
                self._kill(self._victim(kind, vehicle))
            case "pilot lands" if some_left:
                self.unable.add(vehicle)
                self.world.faulted[vehicle].inject(
                    {"kind": "pilot_mode", "mode": "LAND", "at_s": 0.0}
                )
            case "telemetry lost" if some_left:
                self.unable.add(vehicle)
                self.world.faulted[vehicle].inject(POSITION_LOST)
            case "cut 1 s" | "cut 3 s" | "cut 10 s":
                self.network.cut.add(vehicle)
                self.later.append(
                    (now_s + float(kind.split()[1]), lambda: self.network.cut.discard(vehicle))
                )
            case "loss":
                self.network.loss = 0.3
            case "clock":
                self.bent[vehicle].change = lambda state: state.update(sent_s=state["sent_s"] + 5.0)
            case "misreport":
                # Motion may explain a jump that was not seen
                self.unseen |= {vehicle} if self.network.cut else set()
                off_deg = 20.0 / 111_195.0
                self.bent[vehicle].change = lambda state: state.update(
                    latitude_deg=state["latitude_deg"] + off_deg
                )
            case "forged":
                self._forge(now_s)
            case _:
                self._begin_drawn(kind, vehicle, now_s)

    def _begin_drawn(self, kind: str, vehicle: str, now_s: float) -> None:
        """Begin a fault whose size is drawn."""
        chance = random.Random(f"{kind} {self.case.seed} {self.case.number}")
        match kind:
            case "mate forged":
                self.forger = _Forger(vehicle, now_s, chance)
            case "mate swings" | "mate hurries" | "mate misnumbers":
                self.bent[vehicle].change = _lie(kind, chance)
            case "late" | "estimate jumps" | "position forged":
                self.world.faulted[vehicle].inject(_own_fault(kind, chance))
                self.watches[vehicle].is_forged |= kind == "position forged"

    def _victim(self, kind: str, vehicle: str) -> str:
        """Return the coordinator, or another vehicle that still flies."""
        roles = self.members[vehicle].board.roles
        leader = vehicle if roles is None else roles.vehicle
        if kind == "coordinator killed" and leader not in self.unable:
            return leader
        return next(name for name in self.members if name not in {leader, *self.unable})

    def _kill(self, vehicle: str) -> None:
        self.unable.add(vehicle)
        self.daemons[vehicle].finished = True
        self.network.leave(vehicle)
        next(
            vehicle_of_mission
            for vehicle_of_mission in self.mission.vehicles
            if vehicle_of_mission.daemon.name == vehicle
        ).over = True

    def _forge(self, now_s: float) -> None:
        """A stranger speaks under its own name, and for a mate under its own key, for ten seconds."""
        state = next(
            member.board.own for member in self.members.values() if member.board.own is not None
        )
        forged = json.loads(state.model_dump_json()) | {
            "seq": 10**9,
            "latitude_deg": state.latitude_deg + 0.01,
        }
        self.network.send(
            "stranger", "state/stranger", json.dumps(forged | {"vehicle": "stranger"}).encode()
        )
        self.network.send("stranger", "state/stranger", json.dumps(forged).encode())
        if now_s - self.engaged_s < 10.0:
            self.later.append((now_s + 0.1, lambda: self._forge(now_s + 0.1)))

    def after(self, now_s: float, late_s: float = 0.0) -> None:
        """Judge a cycle."""
        self.mission.after(now_s, late_s)
        passed = self.world.drain()
        if self.disturbed.begun - UNDISTURBED:
            self.unable.add(self.case.disturbed)
        if "second_daemon" in self.disturbed.begun:
            self.unseen.add(self.case.disturbed)  # the other program knows of no mates
        if self.engaged_s == math.inf and all(
            daemon.outputs is not None and daemon.outputs.state is State.ENGAGED
            for name, daemon in self.daemons.items()
            if name not in self.unable
        ):
            self.engaged_s = now_s
            self._note_guarantees()
        for name, daemon in self.daemons.items():
            if daemon.outputs is None or daemon.finished:
                continue
            paused = daemon.flight.state is State.PAUSED and self.case.scenario.target is None
            if (
                self.engaged_s < now_s < self.over_s
                and not paused
                and daemon.flight.state not in PLAYED
            ):
                self.stopped.add(name)
            watch = self.watches[name]
            frames = f"{name}/mavlink_raw/in"
            role = daemon.flight.observed.role
            if role is not None:
                watch.rover = self.world.vehicles[role.evader]
            watch.sent(
                now_s,
                [entry.frame for entry in passed if entry.topic == frames],
                daemon.outputs,
                daemon.flight,
            )
            watch.followed(now_s, daemon.outputs, daemon.flight)
            if name == self.case.disturbed:
                self.disturbed.after(now_s, daemon.outputs)
            if watch.engaged_s is not None:
                watch.see(now_s, daemon.flight)
        self._separated()
        if self.engaged_s < math.inf:
            self._follow_promises()
            evaders_over = [
                member.board.over
                for name, member in self.members.items()
                if name not in self.unable
            ]
            all_over = all(len(evaders) == len(self.world.players) for evaders in evaders_over)
            self.over_s = min(self.over_s, now_s) if all_over else math.inf
        self._disturb(now_s)

    def _separated(self) -> None:
        """Compare the true distances of vehicles that both fly our setpoints with the separation."""
        flight = self.case.scenario.flight
        flying = []
        for name, daemon in self.daemons.items():
            commanded = not daemon.finished and daemon.flight.state in SETPOINT_STATES - {
                State.ENTERING
            }
            if commanded and name not in self.unseen:
                vehicle = self.world.vehicles[name]
                position_ned_m = vehicle.truth.position_ned_m
                frame = vehicle.autopilot.frame
                flying.append((name, frame.to_geodetic(*position_ned_m), vehicle))
        for (vehicle_name, vehicle_wgs84, vehicle), (mate_name, mate_wgs84, mate) in combinations(
            flying, 2
        ):
            north, east, down = vehicle.autopilot.frame.to_local(*mate_wgs84)
            n, e, d = vehicle.autopilot.frame.to_local(*vehicle_wgs84)
            errors_m = sum(
                math.hypot(*flown_vehicle.autopilot.state.estimator.position_error_m)
                for flown_vehicle in (vehicle, mate)
            )
            level_m = math.hypot(north - n, east - e)
            height_m = abs(down - d)
            if height_m < flight.separation_height_m - NEAR_M - errors_m:
                self.least_m = min(self.least_m, level_m)
                missing_m = flight.separation_m - level_m - errors_m
                if missing_m > NEAR_M:
                    self.wrong(
                        "separation", missing_m, f"{vehicle_name} and {mate_name} {level_m:.1f} m"
                    )

    def _note_guarantees(self) -> None:
        """Note which vehicle wins against which evader by its own certificate, from where both are now."""
        target = None if self.case.scenario.target is None else Enu((0.0, 0.0, 0.0))
        for pursuer in self.mission.vehicles:
            name = pursuer.daemon.name
            flight = pursuer.daemon.flight
            cycle = flight.settings.cycle
            pursuer_m = pursuer.position_game_m
            self.first[name] = pursuer.evader
            vehicle = Capability(
                cycle.handling.acceleration,
                cycle.envelope,
                cycle.handling.approach,
                cycle.game.pursuer.horizontal_m_s,
                cycle.tolerance_m,
            )
            for evader, speed_m_s in flight.settings.evaders.items():
                evader_m = self.world.players[evader].position_game_m
                if pursuer_m is None or evader_m is None:
                    continue
                game = Game(cycle.game.pursuer, speed_m_s, standoff=cycle.game.standoff)
                evader_m = evader_m.level()
                gaps = gaps_to_disc(
                    ned_from_game(pursuer_m), ned_from_game(evader_m), cycle.game.standoff
                )
                players = Players(pursuer_m, Enu(STILL), evader_m, Enu(STILL), target, gaps, 0.0)
                certificate = certify(game, players, vehicle, None).certificate
                if certificate.vehicle_winner == Winner.PURSUER:
                    self.winning.add((name, evader))

    def _guaranteed(self) -> int:
        """Return how many captures were guaranteed at engagement by the vehicles that were able to the end.

        All together guarantee as many as they could share among them; without the others, each its first evader.
        """
        able = self.members.keys() - self.unable - self.stopped
        if able != self.members.keys():
            return len(
                {
                    evader
                    for name, evader in self.first.items()
                    if name in able and (name, evader) in self.winning
                }
            )
        shares = permutations([*self.world.players, *[""] * len(able)], len(able))
        return max(
            sum(pair in self.winning for pair in zip(self.members, share, strict=True))
            for share in shares
        )

    def _follow_promises(self) -> None:
        """Check that no promise of the game is withdrawn without a cause, nor with one that no fault explains."""
        for member in self.members.values():
            roles = member.board.roles
            for promise in () if roles is None else roles.promises:
                if promise.value is not None:
                    self.promised.add(promise.evader)
                if promise.value is None and not promise.cause and promise.evader in self.promised:
                    self.wrong(
                        "no promise lost without a cause",
                        1.0,
                        f"{promise.evader}, by {roles and roles.vehicle}",
                    )
                if promise.cause == "vehicle lost" and not EXPLAINED & set(self.case.kinds):
                    self.wrong(
                        "a cause among the faults", 1.0, f"{promise.evader}: {promise.cause}"
                    )

    def _judge_end(self) -> None:
        captured = [
            name
            for name, evader in self.mission.result.evaders.items()
            if evader.capture is not None
        ]
        if self.engaged_s == math.inf and not self.disturbed.begun:
            self.wrong(
                "all engage",
                1.0,
                str({name: str(daemon.flight.state) for name, daemon in self.daemons.items()}),
            )
        self.guaranteed = self._guaranteed()
        if len(captured) < self.guaranteed:
            self.wrong(
                "guaranteed captures",
                self.guaranteed - len(captured),
                f"{len(captured)} of {self.guaranteed}",
            )
        forged_s = next((at_s for kind, at_s, _ in self.case.faults if kind == "forged"), math.inf)
        cut_off = {name for kind, _, name in self.case.faults if kind.startswith("cut")}
        if self.clock.now_s() - self.engaged_s > forged_s + 1.0:
            for name in self.members.keys() - self.unable - cut_off:
                if not self.members[name].board.counts["refused_identity"]:
                    self.wrong("forged messages are refused and counted", 1.0, name)
        self._judge_forger(cut_off)
        for name, watch in self.watches.items():
            for violation in watch.worst.values():
                self.wrongs.append(violation._replace(said=f"{name} {violation.said}"))


class _Forger:
    """A stranger without a certificate that speaks for a mate and continues its numbers."""

    def __init__(self, mate: str, now_s: float, chance: random.Random) -> None:
        self.mate = mate
        self.begun_s = now_s
        self.spoken = 0
        self._ahead = chance.choice((1, 1, 5, 15))
        self._step = chance.choice((1, 1, 2, 4))
        self._off_deg = chance.uniform(5.0, 60.0) / 111_195.0
        self._airborne = chance.random() < 0.5

    def speak(self, now_s: float, network: LossyNetwork, last: Mapping[str, Any]) -> None:
        """Send the next message when it is due."""
        since_s = now_s - self.begun_s
        if not last or since_s > MATE_FORGED_S or since_s < 0.1 * self.spoken:
            return
        if self.spoken == 0:
            self._first = last["seq"] + self._ahead
        forged = {
            **last,
            "seq": self._first + self._step * self.spoken,
            "latitude_deg": last["latitude_deg"] + self._off_deg,
            "airborne": self._airborne,
        }
        self.spoken += 1
        network.send("stranger", f"state/{self.mate}", json.dumps(forged).encode())


def _lie(kind: str, chance: random.Random) -> Callable[[dict[str, Any]], None]:
    """Return how a mate changes its own state: it jumps to and fro, or lies about its velocity or numbers."""
    off_deg = chance.uniform(5.0, 40.0) / 111_195.0
    off_m_s = chance.uniform(-6.0, 6.0)
    period = chance.randint(2, 12)
    numbers = chance.choice(("huge", "epochs"))

    def swing(state: dict[str, Any]) -> None:
        if state["seq"] // period % 2:
            state["longitude_deg"] += off_deg

    def hurry(state: dict[str, Any]) -> None:
        north, east, down = state["velocity_ned_m_s"]
        state["velocity_ned_m_s"] = (north + off_m_s, east - off_m_s, down)

    def misnumber(state: dict[str, Any]) -> None:
        if state["seq"] % period == 0:
            state["seq" if numbers == "huge" else "epoch"] += 10**9

    return {"mate swings": swing, "mate hurries": hurry, "mate misnumbers": misnumber}[kind]


def _own_fault(kind: str, chance: random.Random) -> dict[str, Any]:
    """Return a fault of one vehicle or its link, as the mock takes it."""
    bearing = chance.uniform(-math.pi, math.pi)
    jump_m = chance.uniform(0.5, 8.0)
    jump = {"north": jump_m * math.cos(bearing), "east": jump_m * math.sin(bearing)}
    if kind == "estimate jumps":
        return {"kind": "ekf_jump", "at_s": 0.0, **jump}
    if kind == "position forged":
        ahead_s = chance.uniform(0.0, 1.0)
        return {"kind": "position_forger", "at_s": 0.0, "ahead_s": ahead_s, **jump}
    late = {"kind": "delay", "at_s": 0.0, "delay_s": chance.uniform(0.1, LATEST_S)}
    if chance.random() < 0.5:
        late["grows_s"] = chance.uniform(0.5, 15.0)
    return {**late, "direction": chance.choice(("out", "both"))}


class _Named:
    """One vehicle's world as its watch names it."""

    def __init__(self, world: SteppedWorld, pursuit: Pursuit) -> None:
        self.vehicles = {
            PURSUER: world.vehicles[pursuit.vehicle],
            EVADER: world.vehicles[pursuit.evader],
        }


def _case_of(case: TeamCase, pursuit: Pursuit) -> Case:
    return Case(case.seed, case.number, pursuit.scenario)


def fly(seed: int, number: int) -> TeamRow:
    """Fly one by its number."""
    begun_s = time.process_time()
    sortie = Sortie(draw(seed, number))
    sortie.fly()
    captured = sum(evader.capture is not None for evader in sortie.mission.result.evaders.values())
    spent_s = time.process_time() - begun_s
    return TeamRow(
        sortie.case, sortie.least_m, captured, sortie.guaranteed, spent_s, tuple(sortie.wrongs)
    )


def fly_all(seed: int, numbers: Sequence[int], pool: Any, say: Callable[[str], None]) -> int:
    """Fly, print the violations; return 0 if there are none."""
    rows = []
    began_s = time.monotonic()
    for row in pool.map(fly, [seed] * len(numbers), numbers):
        rows.append(row)
        for violation in row.violations:
            command = f"python -m tests faults --teams --seed {seed} --only {row.case.number}"
            words = f"{violation.invariant}: {violation.amount:.2f} at {violation.at_s:.2f} s ({violation.said})"
            say(f"NO {words}; {', '.join(row.case.kinds)}; {command}")
        if len(rows) % 10 == 0:
            say(f"{len(rows)} of {len(numbers)} flights")
    with contextlib.suppress(ValueError):
        say(
            f"least distance of two vehicles at one height {min(row.least_m for row in rows):.2f} m"
        )
    wrong = sum(bool(row.violations) for row in rows)
    captured = sum(row.captured for row in rows)
    guaranteed = sum(row.guaranteed for row in rows)
    say(
        f"{captured} captured, {guaranteed} guaranteed at engagement; {time.monotonic() - began_s:.0f} s"
    )
    spent_s = sum(row.processor_s for row in rows)
    say(
        f"{len(rows) - wrong} of {len(rows)} team flights as wanted; {spent_s:.0f} s of processor time"
    )
    return 1 if wrong else 0
