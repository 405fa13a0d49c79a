"""The coordinator of a team: who it is, and which vehicle plays against which evader.

The coordinator is elected without votes. When no assignment has been heard for 1 s, the lowest name that is alive
takes the next term. Of two coordinators the later term wins, then the lower name. A coordinator stays until it is
silent, so a vehicle that comes back changes nothing.

The assignment is `match_teams` with this vehicle's game and every vehicle's own speeds. A promise is
changed only with a cause, which the assignment names. It carries all promises, so the next coordinator keeps them.
"""

import math
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np

from guidance.errors import ConfigError
from guidance.frames import Enu
from guidance.game import Game
from guidance.game.team import Matching, between, match_teams
from guidance.team.board import TEAM_SILENT_S, Board
from guidance.team.messages import Promise, RolesMessage, StateMessage, VehicleRole

_EVERY_S: Final = 0.5
"""Period of the matching; events come at once."""

SENT_EVERY_S: Final = 0.1
"""Period of sending the assignment: losses are then no silence."""

ROUNDING_S: Final = 1e-6

SLOT_MARGIN_M: Final = 1.0
"""Vehicles at one evader are stacked by the vertical separation and this."""

HYSTERESIS: Final = 0.5
_NOISE: Final = 0.5
"""Least improvement for another pair, least loss that needs a cause, and least value promised: m in TAD, s in PE."""

_STALE_S: Final = 1.0
_NOTHING: Final = Matching(*(np.empty(0) for _ in Matching._fields))


class EvaderSeen(NamedTuple):
    """An evader: place in the game frame, m, bound of its speed, declared speed, and age of the last report."""

    position_m: Enu
    speed_m_s: float
    declared_m_s: float
    age_s: float


class CoordinatorView(NamedTuple):
    """The players as the coordinator sees them; places in the game frame, m.

    Attributes:
        vehicles: Place and last state of each vehicle.
        evaders: Last known state of each evader.
        target_m: Where the evaders' target is now; None in PE.
        game: The game of this vehicle, which is the team's but for the speeds.
    """

    vehicles: Mapping[str, tuple[Enu, StateMessage]]
    evaders: Mapping[str, EvaderSeen]
    target_m: Enu | None
    game: Game


class Coordinator:
    """One vehicle's part in the election, and the assignment while it is elected.

    Args:
        board: Knowledge of the vehicle; it takes the vehicle's own assignments too.
        epoch: Of the vehicle.
        slot_m: Height between vehicles at one evader.
    """

    def __init__(self, board: Board, epoch: int, slot_m: float) -> None:
        self._board = board
        self._epoch = epoch
        self._slot_m = slot_m
        self._seq = 0
        self._begun_s: float | None = None
        self._players: tuple[list[str], list[str]] | None = None
        self._matched_s = -math.inf

    @property
    def leading(self) -> bool:
        """True if this vehicle is the coordinator."""
        roles = self._board.roles
        if roles is None:
            return False
        this_vehicle = (self._board.vehicle, self._epoch)
        return (roles.vehicle, roles.epoch) == this_vehicle

    def elect(self, now_s: float, alive: list[str]) -> bool:
        """Take part in the election; return whether this vehicle is to make assignments.

        Args:
            now_s: The present.
            alive: Names of the vehicles that are there, in order.
        """
        self._begun_s = now_s if self._begun_s is None else self._begun_s
        last_s = max(self._board.roles_s, self._begun_s)
        is_silent = now_s - last_s >= TEAM_SILENT_S
        return self.leading or (is_silent and alive[0] == self._board.vehicle)

    def assign(self, now_s: float, scene: CoordinatorView) -> RolesMessage | None:
        """Return a new assignment when one is due, and put it on the board.

        Args:
            now_s: The present.
            scene: All players that are there and in play.
        """
        players = sorted(scene.vehicles), sorted(scene.evaders)
        last = self._board.roles if self.leading else None
        is_new = last is None or players != self._players
        match_is_due = is_new or now_s - self._matched_s >= _EVERY_S - ROUNDING_S
        message_is_due = now_s - self._board.roles_s >= SENT_EVERY_S - ROUNDING_S
        if not match_is_due and not message_is_due:
            return None
        roles: tuple[VehicleRole, ...] = ()
        if last is not None:
            roles = last.roles
        matching = None
        if match_is_due:
            self._players = players
            self._matched_s = now_s
            matching = self._match(scene, *players)
            roles = self._roles(matching, *players)
        self._seq += 1
        sent: dict[str, Any] = {
            "vehicle": self._board.vehicle,
            "epoch": self._epoch,
            "seq": self._seq,
        }
        promises = self._promises(now_s, scene, matching, *players)
        term = self._board.term + 1 if last is None else last.term
        assignment = RolesMessage(**sent, term=term, roles=roles, promises=promises)
        self._board.take_roles(now_s, assignment)
        return assignment

    def _match(
        self, scene: CoordinatorView, vehicles: list[str], evaders: list[str]
    ) -> Matching | None:
        if not vehicles or not evaders:
            return None
        states = [scene.vehicles[name] for name in vehicles]
        seen_evaders = [scene.evaders[name] for name in evaders]
        of = type(scene.game.pursuer).of
        pursuers = [of(state.speed_m_s, state.climb_m_s, state.descent_m_s) for _, state in states]
        evader_speeds_m_s = [evader.speed_m_s for evader in seen_evaders]
        game = between(scene.game, pursuers, evader_speeds_m_s)
        # Offers do not bind: a vehicle that was ready first shall not cross the way of later ones
        has_begun = any(state.part == "playing" for _, state in states)
        vehicles_m = np.array([position_m for position_m, _ in states])
        evaders_m = np.array([evader.position_m for evader in seen_evaders])
        # The vehicles that have promised an evader, by their present numbers; −1 for none.
        numbers = {name: number for number, name in enumerate(vehicles)}
        promises = {
            promise.evader: promise for promise in self._promised if promise.value is not None
        }
        first = np.full(len(evaders), -1)
        second = np.full(len(evaders), -1)
        for number, evader in enumerate(evaders):
            promise = promises.get(evader)
            if promise is None:
                continue
            if promise.first is not None:
                first[number] = numbers.get(promise.first, -1)
            if promise.second is not None:
                second[number] = numbers.get(promise.second, -1)
        previous = _NOTHING._replace(first=first, second=second) if has_begun else None
        try:
            return match_teams(
                game,
                vehicles_m,
                evaders_m,
                scene.target_m,
                previous=previous,
                hysteresis=HYSTERESIS,
            )
        except ConfigError:
            # A state without an answer: no roles are sent, and every vehicle keeps its evader
            self._board.counts["unmatched"] += 1
            return None

    def _roles(
        self, matching: Matching | None, vehicles: list[str], evaders: list[str]
    ) -> tuple[VehicleRole, ...]:
        if matching is None:
            return ()
        roles = []
        everybody = range(len(vehicles))
        for number, evader in enumerate(evaders):
            first = int(matching.first[number])
            second = int(matching.second[number])
            leaders_first = dict.fromkeys((first, second, *everybody))
            pursuers = [
                index
                for index in leaders_first
                if index in everybody and matching.evader_of[index] == number
            ]
            for rank, index in enumerate(pursuers):
                above_m = rank * self._slot_m
                role = VehicleRole(vehicle=vehicles[index], evader=evader, above_m=above_m)
                roles.append(role)
        return tuple(roles)

    @property
    def _promised(self) -> tuple[Promise, ...]:
        if self._board.roles is None:
            return ()
        return self._board.roles.promises

    def _promises(
        self,
        now_s: float,
        scene: CoordinatorView,
        matching: Matching | None,
        vehicles: list[str],
        evaders: list[str],
    ) -> tuple[Promise, ...]:
        """Return all promises; before the first vehicle plays, they are only offers."""
        has_begun = any(state.part == "playing" for _, state in scene.vehicles.values())
        passed_s = 0.0
        if scene.target_m is None and has_begun:
            passed_s = now_s - self._board.roles_s
        # The promises so far; those about evaders in play with the time that is left.
        promises = {promise.evader: promise for promise in self._promised}
        for name, promise in promises.items():
            if promise.value is not None and name in evaders:
                value_left = promise.value - passed_s
                promises[name] = promise.model_copy(update={"value": value_left})
        if matching is None:
            return tuple(promises.values())
        numbered = [*vehicles, None]  # -1 gives None
        for number, evader in enumerate(evaders):
            first = numbered[int(matching.first[number])]
            second = numbered[int(matching.second[number])]
            value = None if first is None else float(matching.value[number])
            before = promises.get(evader) if has_begun else None
            cause = ""
            if before is None:
                if value is None or (scene.target_m is not None and value < _NOISE):
                    promises.pop(evader, None)  # an offer ends with its reason
                    continue
            else:
                value, cause = self._kept_or_broken(scene, before, value, vehicles)
            promises[evader] = Promise(
                evader=evader, value=value, first=first, second=second, cause=cause
            )
        return tuple(promises.values())

    def _kept_or_broken(
        self, scene: CoordinatorView, before: Promise, value: float | None, vehicles: list[str]
    ) -> tuple[float | None, str]:
        """Return the value and cause of a promise that was given: it stands until a cause explains a worse value."""
        if before.value is None:
            return value, before.cause
        # A value is worse for the team if it is later (PE), or nearer the target.
        if value is None:
            is_worse = True
        else:
            loss = before.value - value if scene.target_m is not None else value - before.value
            is_worse = loss > _NOISE
        if not is_worse:
            return before.value, before.cause
        roles = self._board.roles
        evader = scene.evaders[before.evader]
        if roles is not None and any(role.vehicle not in vehicles for role in roles.roles):
            return value, "vehicle lost"
        if evader.speed_m_s > evader.declared_m_s + _NOISE:
            return value, "faster evader"
        if evader.age_s > _STALE_S:
            return value, "stale data"
        return before.value, before.cause
