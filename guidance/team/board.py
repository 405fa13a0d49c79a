"""The knowledge of a vehicle about its team: the mates' states, the newest assignment, the evaders out of play.

Bytes are never trusted. A message is used only if it matches its schema, names the vehicle of its key, and continues
the stream of its sender (`guidance.team.senders`). A mate whose messages are refused counts as silent. The time of a
state is the sender's; it is converted to our clock by arrival times and the smallest difference seen. A jump that no
motion explains is doubt: the mate may be at either end of it. A mate for whom two senders speak counts as silent while
both do, and its doubt covers every place that either of them reports.
"""

import math
from collections import Counter
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from guidance.estimation.measurement import ClockOffset, hear
from guidance.frames import STILL, LocalFrame, Ned
from guidance.messages import UNKNOWN_VELOCITY, EvaderReport, MateState
from guidance.team.messages import (
    STATE,
    EvaderMessage,
    RefusedMessage,
    RolesMessage,
    StateMessage,
    TeamMessage,
    read_message,
)
from guidance.team.senders import TWO_SENDERS, Sender

TEAM_SILENT_S: Final = 1.0
"""A mate or a coordinator that was silent for so long counts as absent."""

MOST_TERMS: Final = 1000
"""A message's term may exceed the last known one by this; there is at most one election a second."""

NOTE_EVERY_S: Final = 10.0
"""Least time between two notes about refused messages in one mate's name."""

DISPUTED_AGE_S: Final = 5.0
"""Largest age of a mate for whom two senders speak: a flight counts it as silent, and does not forget it."""

_MOVED_S: Final = 0.5
"""For this time a flight moves a silent mate's disc by the mate's velocity; then the disc grows."""

_ORDINARY: Final = frozenset({"order", "evader"})

_SLACK_M: Final = 3.0
_SWERVE_M_S2: Final = 5.0
"""Largest error of a position, and largest acceleration, that count as motion."""

BoardNews = MateState | EvaderReport | None
"""News of a message for the flight."""


@dataclass(slots=True)
class Mate:
    """The state of one mate.

    Attributes:
        state: Its last state; None before the first one.
        at_s: When that was true, on our clock.
        heard_s: When it arrived.
        doubt_ned_m: Sum of its jumps that no motion explains.
        senders: Its streams, by the key.
        refused_s: When people were last told that a message in its name was refused.
        disputed_s: When people were last told that two senders speak for it.
        claims_m: While two senders speak for it, the largest distance of a place that either reported from the last
            accepted one.
        fastest_m_s: While two senders speak for it, the largest speed that either reported.
    """

    state: StateMessage | None = None
    at_s: float = -math.inf
    heard_s: float = -math.inf
    doubt_ned_m: Ned = STILL
    clock: ClockOffset | None = None
    senders: dict[str, Sender] = field(default_factory=dict)
    refused_s: float = -math.inf
    disputed_s: float = -math.inf
    claims_m: float = 0.0
    fastest_m_s: float = 0.0


class Board:
    """The knowledge of one vehicle.

    Args:
        vehicle: Its name.
        mates: Names of the others; other senders are refused.
        evaders: Names of the evaders.

    Attributes:
        own: The state that the vehicle published last.
        over: Evaders out of play, with the time when that became known.
        roles: The newest assignment; `roles_s` is its arrival.
        term: The latest term in any message.
        counts: Numbers of accepted messages, and of refused ones by reason.
        news: Notes for people, since it was last cleared.
    """

    def __init__(self, vehicle: str, mates: Collection[str], evaders: Collection[str]) -> None:
        self.vehicle = vehicle
        self._evaders = frozenset(evaders)
        self.mates = {name: Mate() for name in sorted(mates) if name != vehicle}
        self.own: StateMessage | None = None
        self.over: dict[str, float] = {}
        self.roles: RolesMessage | None = None
        self.roles_s = -math.inf
        self.term = 0
        self.counts = Counter[str]()
        self.news = list[str]()

    def hear(self, arrived_s: float, key: str, payload: bytes) -> BoardNews:
        """Take a message, or count why it is refused; return the mate's state or the evader's report that it tells.

        Args:
            arrived_s: On our clock.
            key: Without the prefix: `state/alpha`.
            payload: Untrusted bytes.
        """
        takes: Mapping[type, Callable[[float, Any], BoardNews]]
        takes = {
            StateMessage: self._take_state,
            EvaderMessage: self._take_report,
            RolesMessage: self.take_roles,
        }
        try:
            message = self._read(arrived_s, key, payload)
            news = takes[type(message)](arrived_s, message)
        except RefusedMessage as refused:
            self.counts[f"refused_{refused}"] += 1
            self._note_refused(arrived_s, key, str(refused))
            # For a mate with two senders only this is sure: its age grows to `DISPUTED_AGE_S`, and
            # then its doubt grows as fast as it may fly.
            kind, _, name = key.partition("/")
            mate = self.mates.get(name)
            if kind != STATE or mate is None or mate.state is None:
                return None
            if not mate.senders[key].is_disputed(arrived_s):
                return None
            state = mate.state
            fastest_m_s = max(_fastest_m_s(state), mate.fastest_m_s)
            at_s = max(mate.at_s, arrived_s - DISPUTED_AGE_S)
            unseen_s = at_s - mate.at_s + _MOVED_S
            jumps_m = math.hypot(*mate.doubt_ned_m)
            doubt_m = jumps_m + mate.claims_m + fastest_m_s * unseen_s
            position = (state.latitude_deg, state.longitude_deg, state.altitude_amsl_m)
            return MateState(name, at_s, *position, STILL, fastest_m_s, doubt_m, airborne=True)
        self.counts["accepted"] += 1
        return news

    def _note_refused(self, now_s: float, key: str, reason: str) -> None:
        """Tell people about refused messages in a mate's name; late and repeated ones are ordinary."""
        name = key.rpartition("/")[2]
        mate = self.mates.get(name)
        if mate is None or reason in _ORDINARY:
            return
        if reason == TWO_SENDERS:
            if now_s - mate.disputed_s >= NOTE_EVERY_S:
                mate.disputed_s = now_s
                self.news.append(f"{name}: two senders speak in its name; it counts as silent")
        elif now_s - mate.refused_s >= NOTE_EVERY_S:
            mate.refused_s = now_s
            self.news.append(f"{name}: a message in its name was refused ({reason})")

    def _read(self, now_s: float, key: str, payload: bytes) -> TeamMessage:
        """Read a message. Strangers, old messages and those of another stream are refused."""
        mate = self.mates.get(key.rpartition("/")[2])
        if mate is None:
            raise RefusedMessage("identity")
        message = read_message(key.partition("/")[0], payload)
        if message.key != key:
            raise RefusedMessage("identity")
        if isinstance(message, EvaderMessage) and message.evader not in self._evaders:
            raise RefusedMessage("evader")
        sender = mate.senders.setdefault(key, Sender())
        reason = sender.refuses(now_s, message.epoch, message.seq, hash(payload))
        if reason == TWO_SENDERS and isinstance(message, StateMessage):
            # Either of two senders may be the mate, so its place and speed count too.
            mate.fastest_m_s = max(mate.fastest_m_s, _fastest_m_s(message))
            if mate.state is not None:
                frame = LocalFrame(*mate.state.place)
                claim_ned_m = frame.ned_from_wgs84(*message.place)
                mate.claims_m = max(mate.claims_m, math.hypot(*claim_ned_m))
        if reason:
            raise RefusedMessage(reason)
        return message

    def _take_state(self, arrived_s: float, state: StateMessage) -> MateState:
        mate = self.mates[state.vehicle]
        before = mate.state
        if before is None or before.epoch != state.epoch:
            before = None
            mate.clock = None
            mate.doubt_ned_m = STILL
        mate.clock = hear(mate.clock, state.sent_s, arrived_s)
        at_s = arrived_s if mate.clock is None else min(arrived_s, mate.clock.ours(state.sent_s))
        if before is not None:
            # Doubt is the part of a step that no motion explains.
            dt_s = at_s - mate.at_s
            reported_ned_m = LocalFrame(*before.place).ned_from_wgs84(*state.place)
            expected_ned_m = dt_s * Ned(before.velocity_ned_m_s)
            apart_ned_m = reported_ned_m - expected_ned_m
            apart_m = math.hypot(*apart_ned_m)
            if apart_m > 0.0:
                accelerated_m = 0.5 * _SWERVE_M_S2 * dt_s * dt_s
                reversed_m = 2.0 * (state.speed_m_s + state.climb_m_s) * max(0.0, dt_s)
                swerved_m = min(accelerated_m, reversed_m)
                excess = 1.0 - (_SLACK_M + swerved_m) / apart_m
                if excess > 0.0:
                    mate.doubt_ned_m += excess * apart_ned_m
                    self.counts["jumps"] += 1
                    self.news.append(f"{state.vehicle} jumped by {apart_m:.0f} m")
        mate.state = state
        mate.at_s = at_s
        mate.heard_s = arrived_s
        if state.term <= self.term + MOST_TERMS:
            self.term = max(self.term, state.term)
        else:
            self._note_refused(arrived_s, state.key, "term")
        if state.airborne:  # on the ground a mate may still know the last game's
            self.close(state.over, arrived_s)
        mate.claims_m = 0.0
        mate.fastest_m_s = 0.0
        position = (state.latitude_deg, state.longitude_deg, state.altitude_amsl_m)
        velocity_ned_m_s = Ned(state.velocity_ned_m_s)
        doubt_m = math.hypot(*mate.doubt_ned_m)
        return MateState(
            state.vehicle,
            at_s,
            *position,
            velocity_ned_m_s,
            _fastest_m_s(state),
            doubt_m,
            state.airborne,
        )

    def _take_report(self, arrived_s: float, message: EvaderMessage) -> EvaderReport:
        clock = self.mates[message.vehicle].clock
        at_s = arrived_s if clock is None else min(arrived_s, clock.ours(message.sent_s))
        position = (message.latitude_deg, message.longitude_deg, message.altitude_amsl_m)
        velocity = UNKNOWN_VELOCITY
        if message.velocity_ned_m_s is not None:
            velocity = Ned(message.velocity_ned_m_s)
        source = f"{message.vehicle}: {message.source}"
        return EvaderReport(at_s, math.nan, source, *position, velocity, evader=message.evader)

    def take_roles(self, now_s: float, roles: RolesMessage) -> None:
        """Take an assignment if it is newer: by its term, then the lower name, then its number.

        Raises:
            RefusedMessage: If it is older than the last one, or its term is beyond all elections.
        """
        last = self.roles
        if roles.term > self.term + MOST_TERMS:
            raise RefusedMessage("term")
        if last is not None:
            # Of one term, the lower name counts as newer
            new_rank = (roles.term, last.vehicle, roles.seq)
            last_rank = (last.term, roles.vehicle, last.seq)
            if new_rank <= last_rank:
                raise RefusedMessage("term")
        self.roles = roles
        self.roles_s = now_s
        self.term = max(self.term, roles.term)

    def close(self, evaders: Collection[str], now_s: float) -> None:
        """Note evaders that are out of play."""
        for name in self._evaders.intersection(evaders):
            self.over.setdefault(name, now_s)

    def alive(self, now_s: float, present: Collection[str] | None = None) -> list[str]:
        """Return the names of the vehicles that are there, this one included.

        Args:
            now_s: The present.
            present: Names with a liveliness token; None if the transport has none.
        """
        names = [self.vehicle]
        for name, mate in self.mates.items():
            is_silent = now_s - mate.heard_s > TEAM_SILENT_S
            if not is_silent and (present is None or name in present):
                names.append(name)
        return sorted(names)


def _fastest_m_s(state: StateMessage) -> float:
    """Return the largest speed that a vehicle may have, by its own state."""
    game_m_s = math.hypot(state.speed_m_s, max(state.climb_m_s, state.descent_m_s))
    return max(game_m_s, math.hypot(*state.velocity_ned_m_s))
