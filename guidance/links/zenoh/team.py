"""A team's messages over Zenoh: `guidance/team/TEAM/KIND/...`, with a liveliness token for each vehicle.

Messages are dropped rather than delayed. A token vanishes with its process; a frozen process keeps its token for up to
10 s, so the age of the states decides too (`guidance.team.board`).
"""

import contextlib
import math
from collections.abc import Collection
from functools import partial
from typing import Any, Final

import zenoh

from guidance.links.port import Clock
from guidance.links.zenoh.session import Session
from guidance.links.zenoh.wire import Subscription

MOST_TEAM_MESSAGE_BYTES: Final = 16384
"""A larger message of a team is dropped unread."""


class ZenohTeam:
    """`Transport` of `guidance.team` on a session, which stays open when it is closed."""

    def __init__(
        self, clock: Clock, session: Session, team: str, vehicle: str, mates: Collection[str]
    ) -> None:
        """Declare the token, and subscribe to the messages and tokens of these mates."""
        self._prefix = f"guidance/team/{team}/"
        self._session = session
        self._mates = frozenset(mates)
        # Its keys stay, as two threads use it
        self._alive = {
            **dict.fromkeys(mates, False),
            vehicle: True,
        }
        liveliness: Any = session.liveliness()
        token = liveliness.declare_token(f"{self._prefix}alive/{vehicle}")
        tokens = liveliness.declare_subscriber(f"{self._prefix}alive/*", self._note, history=True)
        ends = tokens.undeclare, token.undeclare
        self._arrivals = Subscription(
            session,
            f"{self._prefix}**",
            partial(self._read, clock),
            *ends,
            most_bytes=math.inf,
        )
        self.receive = self._arrivals.take
        self.close = self._arrivals.close

    def _read(self, clock: Clock, sample: "zenoh.Sample") -> tuple[float, str, bytes]:
        """Read a sample; of one that is too large the key only, so that the board refuses and counts it."""
        payload = b""
        if len(sample.payload) <= MOST_TEAM_MESSAGE_BYTES:
            payload = sample.payload.to_bytes()
        return clock(), str(sample.key_expr).removeprefix(self._prefix), payload

    def publish(self, key: str, payload: bytes) -> None:
        """Send to all mates; a message that cannot be sent now is lost."""
        with contextlib.suppress(zenoh.ZError):
            self._session.put(
                self._prefix + key,
                payload,
                encoding=zenoh.Encoding.APPLICATION_JSON,
                congestion_control=zenoh.CongestionControl.DROP,
                express=True,
            )

    def present(self) -> Collection[str]:
        """Return the names of the vehicles whose token is there."""
        return frozenset(name for name, alive in self._alive.items() if alive)

    def _note(self, sample: "zenoh.Sample") -> None:
        name = str(sample.key_expr).rpartition("/")[2]
        if name in self._mates:
            self._alive[name] = sample.kind == zenoh.SampleKind.PUT
