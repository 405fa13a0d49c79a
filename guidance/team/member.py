"""One vehicle's part in its team: inputs of a cycle from the mates, and messages to them.

A cycle begins with `hear`, which returns the mates and the role for its inputs, and ends with `tell`. Both take the
time from the caller. A wrong assignment costs captures, never distance: the vehicle's own limits keep the separation.
"""

import math
from collections.abc import Collection, Sequence
from typing import Any, Final, Literal

from guidance.flight import Event, Flight, Outputs, State
from guidance.frames import Amsl, Enu, Ned
from guidance.messages import EvaderReport, LocalPosition, MateState, Role
from guidance.team.board import Board
from guidance.team.coordinator import (
    ROUNDING_S,
    SLOT_MARGIN_M,
    Coordinator,
    CoordinatorView,
    EvaderSeen,
)
from guidance.team.messages import (
    EvaderMessage,
    RolesMessage,
    StateMessage,
    Transport,
    VehicleRole,
    write_message,
)

_EVERY_S: Final = 0.1
"""Period of the states, and least time between reports of one evader."""

STAYS_S: Final = 2.0
"""After a capture no vehicle changes its evader for so long."""

_RELAYED_S: Final = 0.5
"""A mate's report of an evader is used if the vehicle has not heard the evader itself for so long."""

_PLAYING: Final = frozenset({State.ENGAGED, State.PAUSED, State.ON_STATION})
_READY: Final = frozenset({State.STANDING_BY, State.ENTERING})


class Member:
    """One vehicle of a team.

    Args:
        vehicle: Its name.
        mates: Names of the others.
        evaders: Names of the evaders; before the first assignment it plays against the first one.
        transport: To the mates.
        epoch: A random number of this start.
        separation_height_m: Least height between vehicles.

    Attributes:
        board: Its knowledge.
        coordinator: Its part in the election.
    """

    def __init__(
        self,
        vehicle: str,
        mates: Collection[str],
        evaders: Sequence[str],
        transport: Transport,
        *,
        epoch: int,
        separation_height_m: float,
    ) -> None:
        self.vehicle = vehicle
        self._mates = tuple(mates)
        self._first = Role(evaders[0])
        self._slot_m = separation_height_m + SLOT_MARGIN_M
        self._transport = transport
        self._evaders = sorted({*evaders})
        self._epoch = epoch
        self.begin()

    def begin(self) -> None:
        """Forget the last flight; mates take this for a new start."""
        self._epoch += 1
        self.board = Board(self.vehicle, self._mates, self._evaders)
        self.coordinator = Coordinator(self.board, self._epoch, self._slot_m)
        self._noted: RolesMessage | None = None
        self._seq = 0
        self._sent_s = -math.inf
        self._heard_s = dict[str, float]()
        self._reports = dict[str, EvaderReport]()

    def hear(
        self, now_s: float, flight: Flight, reports: Sequence[EvaderReport]
    ) -> tuple[Sequence[MateState] | None, Role | None, list[EvaderReport]]:
        """Read the messages of the mates: new states of mates, a new role if any, and reports of evaders.

        Args:
            now_s: The present.
            flight: The vehicle's.
            reports: Of evaders that the vehicle heard itself in this cycle.
        """
        mates = dict[str, MateState]()
        relayed = list[EvaderReport]()
        for message in self._transport.receive():
            news = self.board.hear(*message)
            if isinstance(news, MateState):
                mates[news.name] = news
            elif isinstance(news, EvaderReport):
                relayed.append(news)
        for report in reports:
            if report.evader is not None:
                self._heard_s[report.evader] = now_s
                self._reports[report.evader] = report
        # Reports that the vehicle itself received lately need no relay.
        unheard = [
            report
            for report in relayed
            if report.evader is None
            or now_s - self._heard_s.get(report.evader, -math.inf) > _RELAYED_S
        ]
        states = tuple(mates.values()) if mates else None
        assigned: tuple[VehicleRole, ...] = ()
        if self.board.roles is not None:
            assigned = self.board.roles.roles
        own_role = next((role for role in assigned if role.vehicle == self.vehicle), None)
        before = flight.observed.role
        if before is None:
            before = self._first
        role = before if own_role is None else Role(own_role.evader, own_role.above_m)
        if role == flight.observed.role:
            new_role = None
        elif role.evader == before.evader:
            new_role = role
        else:
            silence_s = flight.tracking.silence_s(now_s, role.evader)
            is_unseen = silence_s > flight.settings.cycle.evader_timeout_s
            last_end_s = max(self.board.over.values(), default=-math.inf)
            waits = now_s - last_end_s < STAYS_S
            if waits or is_unseen or role.evader in self.board.over:
                self.board.counts["roles_left_out"] += not waits
                new_role = before if flight.observed.role is None else None
            else:
                new_role = role
        return states, new_role, unheard

    def changed(self, outputs: Outputs) -> RolesMessage | None:
        """Return the assignment if it differs from that of the last call, or if the vehicle begins to play."""
        roles = self.board.roles
        begins = any(
            transition.after is State.ENGAGED and transition.before is not State.ENGAGED
            for transition in outputs.transitions
        )
        if roles is None or (roles is self._noted and not begins):
            return None
        before = self._noted
        self._noted = roles
        if begins or before is None or _contents(before) != _contents(roles):
            return roles
        return None

    def assignment(self, flight: Flight) -> dict[str, Any]:
        """Return its role, the coordinator, all promises and the evaders out of play, for displays."""
        roles = self.board.roles
        role = flight.observed.role
        if role is None:
            role = self._first
        unit = "s" if flight.settings.cycle.target_game_m is None else "m"
        if roles is None:
            promises = []
        else:
            promises = [
                {
                    "evader": promise.evader,
                    "first": promise.first,
                    "second": promise.second,
                    "standing": promise.standing,
                    "words": promise.words(unit),
                }
                for promise in roles.promises
            ]
        return {
            "evader": role.evader,
            "above_m": role.above_m,
            "coordinator": "" if roles is None else roles.vehicle,
            "over": sorted(self.board.over),
            "promises": promises,
        }

    def tell(self, now_s: float, flight: Flight, outputs: Outputs) -> None:
        """Tell the mates about the vehicle and the evaders, and assign roles as the coordinator."""
        ends = {Event.CAPTURED, Event.ESCAPED}
        has_ended = any(
            transition.event in ends and transition.after is not transition.before
            for transition in outputs.transitions
        )
        if has_ended and flight.observed.role is not None:
            self.board.close((flight.observed.role.evader,), now_s)
        if now_s - self._sent_s >= _EVERY_S - ROUNDING_S:
            self._sent_s = now_s
            self._publish(flight, outputs)
        elif not has_ended:
            return
        alive = self.board.alive(now_s, self._transport.present())
        if not self.coordinator.elect(now_s, alive):
            return
        scene = self._scene(now_s, flight, alive)
        assignment = None if scene is None else self.coordinator.assign(now_s, scene)
        if assignment is not None:
            self._transport.publish(assignment.key, write_message(assignment))

    def _publish(self, flight: Flight, outputs: Outputs) -> None:
        """Send the vehicle's state, and the newest report of each evader that it heard since the last time."""
        self._seq += 1
        sender: dict[str, Any] = {"vehicle": self.vehicle, "epoch": self._epoch, "seq": self._seq}
        local = flight.vehicle.latest.get(LocalPosition)
        frame = flight.tracking.local_frame
        if local is not None and frame is not None:
            measured_s = local.received_s - flight.vehicle.delay_s
            position = _position_fields(measured_s, frame.wgs84_from_ned(local.position_ned_m))
            vehicle = flight.vehicle
            is_airborne = vehicle.armed and not vehicle.on_ground
            role = flight.observed.role
            part: Literal["out", "ready", "playing"] = "out"
            if flight.state in _PLAYING:
                part = "playing"
            elif flight.state in _READY:
                part = "ready"
            value = None
            if outputs.certificate is not None and 0.0 <= outputs.certificate.value < math.inf:
                value = outputs.certificate.value
            speeds = flight.settings.cycle.game.pursuer
            state = StateMessage(
                **sender,
                **position,
                speed_m_s=float(speeds.horizontal_m_s),
                climb_m_s=float(speeds.climb_m_s),
                descent_m_s=float(speeds.descent_m_s),
                velocity_ned_m_s=local.velocity_ned_m_s,
                state=str(flight.state),
                part=part,
                airborne=is_airborne,
                evader=None if role is None else role.evader,
                value=value,
                term=self.board.term,
                over=tuple(sorted(self.board.over)),
            )
            self.board.own = state
            self._transport.publish(state.key, write_message(state))
        for name, report in self._reports.items():
            altitude = Amsl(report.altitude_amsl_m)
            place = (report.latitude_deg, report.longitude_deg, altitude)
            position = _position_fields(report.received_s, place)
            velocity = report.velocity_ned_m_s
            is_known = all(map(math.isfinite, velocity))
            message = EvaderMessage(
                **sender,
                **position,
                evader=name,
                source=report.source[:120],
                velocity_ned_m_s=velocity if is_known else None,
            )
            self._transport.publish(message.key, write_message(message))
        self._reports.clear()

    def _scene(
        self, now_s: float, flight: Flight, alive: Collection[str]
    ) -> CoordinatorView | None:
        """Return all players that are there and in play, None before the frames are known."""
        tracking = flight.tracking
        cycle = flight.settings.cycle
        own_state = self.board.own
        frame = tracking.local_frame
        game_frame = tracking.game_frame
        if frame is None or game_frame is None or own_state is None:
            return None
        # The evaders in play that are heard, on their plane, and the height of this plane.
        evaders = {}
        heights_m = []
        for name in self._evaders:
            estimate = tracking.evader(now_s, name)
            if estimate is None or name in self.board.over:
                continue
            x, y, z = game_frame.position_from_ned(estimate.position_ned_m)
            declared_m_s = flight.settings.evaders.get(name, cycle.game.evader_speed_m_s)
            evaders[name] = EvaderSeen(
                Enu((x, y, 0.0)), estimate.speed_bound_m_s, declared_m_s, estimate.age_s
            )
            heights_m.append(z)
        plane_m = sum(heights_m) / len(heights_m) if heights_m else 0.0
        vehicles = {}
        states = []
        for name, mate in self.board.mates.items():
            if name in alive and mate.state is not None and mate.state.part != "out":
                states.append((mate.state, mate.at_s))
        if own_state.part != "out":
            states.append((own_state, own_state.sent_s))
        for state, at_s in states:
            # The mate has kept its velocity since it said so.
            position_ned_m = frame.ned_from_wgs84(*state.place) + (now_s - at_s) * Ned(
                state.velocity_ned_m_s
            )
            x, y, z = game_frame.position_from_ned(position_ned_m)
            vehicles[state.vehicle] = Enu((x, y, z - plane_m)), state
        return CoordinatorView(vehicles, evaders, cycle.target_game_m, cycle.game)


def _contents(roles: RolesMessage) -> tuple[Any, ...]:
    """The parts of an assignment worth a note: not the values, which change all the time until the game begins."""
    promises = [
        (promise.evader, promise.first, promise.second, promise.cause, promise.value is None)
        for promise in roles.promises
    ]
    return roles.term, roles.roles, promises


def _position_fields(sent_s: float, place: tuple[float, float, Amsl]) -> dict[str, Any]:
    latitude_deg, longitude_deg, altitude = place
    named = {
        "latitude_deg": latitude_deg,
        "longitude_deg": longitude_deg,
        "altitude_amsl_m": altitude.metres,
    }
    return {"sent_s": sent_s, **named}
