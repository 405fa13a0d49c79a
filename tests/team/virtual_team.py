"""A team of point masses on a virtual network: boards and coordinators, without flights."""

import math

from guidance.clock import VirtualClock
from guidance.frames import Amsl, Enu, LocalFrame, Ned
from guidance.game import Cylinder, Game, StandOff
from guidance.team.board import Board
from guidance.team.coordinator import Coordinator, CoordinatorView, EvaderSeen
from guidance.team.messages import RolesMessage, StateMessage, write_message
from tests.team.lossy import LossyNetwork

SITE = LocalFrame(47.4, 8.5, Amsl(488.0))
DISC = StandOff(0.0, 8.0)
GAME = Game(Cylinder(6.0, 3.0, 1.5), 3.0, standoff=DISC)
STEP_S = 0.02


def state_of(vehicle, ned_m, velocity=(0.0, 0.0, 0.0), *, sent_s=0.0, seq=0, epoch=1, **more):
    """The state of a vehicle at a place about the site."""
    latitude, longitude, altitude = SITE.wgs84_from_ned(Ned(ned_m))
    known = {"state": "engaged", "part": "playing", "airborne": True, "speed_m_s": 6.0}
    known |= {"climb_m_s": 3.0, "descent_m_s": 1.5}
    place = {
        "latitude_deg": latitude,
        "longitude_deg": longitude,
        "altitude_amsl_m": altitude.metres,
    }
    common = {
        "vehicle": vehicle,
        "epoch": epoch,
        "seq": seq,
        "sent_s": sent_s,
        "velocity_ned_m_s": velocity,
    }
    return StateMessage(**(common | place | known | more))


class Point:
    """One vehicle: its place, its clock, its board and its coordinator."""

    def __init__(self, name, names, evaders, network, place_m, *, clock_s=0.0, epoch=1):
        self.name = name
        self.place_m = place_m
        self.clock_s = clock_s
        self.epoch = epoch
        self.board = Board(name, names, evaders)
        self.coordinator = Coordinator(self.board, epoch, 4.0)
        self.transport = network.join(name)
        self.made: list[RolesMessage] = []
        self.killed = False
        self.seq = 0

    def step(self, now_s, evaders, target_m):
        """Hear, tell ten times per second, and assign."""
        for one in self.transport.receive():
            self.board.hear(*one)
        if self.killed:
            return
        x, y, z = self.place_m
        if round(now_s / STEP_S) % 5 == 0:
            self.seq += 1
            state = state_of(
                self.name,
                (y, x, -z),
                sent_s=now_s + self.clock_s,
                seq=self.seq,
                epoch=self.epoch,
                term=self.board.term,
                over=tuple(self.board.over),
            )
            self.board.own = state
            self.transport.publish(state.key, write_message(state))
        alive = self.board.alive(now_s)
        if self.board.own is not None and self.coordinator.elect(now_s, alive):
            made = self.coordinator.assign(now_s, self.scene(alive, evaders, target_m))
            if made is not None:
                self.made.append(made)
                self.transport.publish(made.key, write_message(made))

    def scene(self, alive, evaders, target_m):
        """The players as this vehicle knows them."""
        states = {name: mate.state for name, mate in self.board.mates.items() if name in alive}
        vehicles = {}
        for name, state in (states | {self.name: self.board.own}).items():
            north, east, down = SITE.ned_from_wgs84(*state.place)
            vehicles[name] = (east, north, -down), state
        seen = {name: EvaderSeen(Enu(place), 3.0, 3.0, 0.1) for name, place in evaders.items()}
        return CoordinatorView(
            vehicles,
            {name: one for name, one in seen.items() if name not in self.board.over},
            target_m,
            GAME,
        )


class VirtualTeam:
    """Several points that fly as they are assigned, straight below their evaders."""

    def __init__(self, places, evaders, target_m, **network):
        self.clock = VirtualClock()
        self.network = LossyNetwork(self.clock.now_s, **network)
        self.points = {}
        self._names = list(places)
        for number, (name, place) in enumerate(places.items()):
            self.points[name] = Point(
                name, self._names, list(evaders), self.network, place, clock_s=100.0 * number
            )
        self.evaders = dict(evaders)
        self.target_m = target_m

    def run(self, seconds, *, moving=True):
        """Let time pass."""
        for _ in range(round(seconds / STEP_S)):
            self.clock.sleep_until(self.clock.now_s() + STEP_S)
            now_s = self.clock.now_s()
            for point in self.points.values():
                point.step(now_s, self.evaders, self.target_m)
            if moving:
                self.move()

    def move(self):
        """Every vehicle flies to a place above its evader; evaders stand still."""
        for point in self.points.values():
            roles = () if point.board.roles is None else point.board.roles.roles
            mine = next(
                (self.evaders[role.evader] for role in roles if role.vehicle == point.name), None
            )
            if mine is None or point.killed:
                continue
            goal = (mine[0], mine[1], DISC.height_m)
            away_m = math.dist(goal, point.place_m)
            share = min(1.0, 6.0 * STEP_S / away_m) if away_m > 0.0 else 0.0
            point.place_m = tuple(
                at + share * (to - at) for at, to in zip(point.place_m, goal, strict=True)
            )

    @property
    def alive(self):
        """The points whose process runs."""
        return [point for point in self.points.values() if not point.killed]

    @property
    def made(self):
        """All assignments, in the order in which they win."""
        made = [one for point in self.points.values() for one in point.made]
        return sorted(made, key=lambda one: (one.term, -ord(one.vehicle[0]), one.seq))
