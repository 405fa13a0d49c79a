"""Reports of an evader from a Zenoh key, whatever the payload: JSON, or ROS 2's CDR."""

import contextlib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence

import zenoh

from guidance.errors import ConfigError
from guidance.links.arrivals import Arrivals, Clock
from guidance.links.evaders.refusal import Refused
from guidance.links.zenoh_session import open_session
from guidance.messages import EvaderReport

Reader = Callable[[bytes, float], EvaderReport]


class ZenohEvader:
    """`EvaderSource` on one key expression. Opens its own session unless it is given one."""

    def __init__(
        self,
        clock: Clock,
        key: str,
        read: Reader,
        *,
        endpoint: str | None = None,
        session: "zenoh.Session | None" = None,
        timeout_s: float = 3.0,
    ) -> None:
        """Subscribe.

        Raises:
            ConfigError: If the key is not a Zenoh key expression, or neither or both of endpoint and session are given.
            LinkError: If there is no session to be had within `timeout_s`.
        """
        if (endpoint is None) == (session is None):
            raise ConfigError(f"endpoint = {endpoint!r}, session = {session!r}: give exactly one")
        try:
            expression = zenoh.KeyExpr(key)
        except zenoh.ZError as error:
            raise ConfigError(f"key = {key!r}: not a Zenoh key expression") from error
        self._read = read
        self._arrivals = Arrivals[bytes](clock)
        self._counts: Counter[str] = Counter()
        self._own = open_session(endpoint, timeout_s=timeout_s) if endpoint is not None else None
        used = session if session is not None else self._own
        assert used is not None
        self._subscriber = used.declare_subscriber(
            expression,
            lambda sample: self._arrivals.put(sample.payload.to_bytes()),
            allowed_origin=zenoh.Locality.REMOTE,
        )

    def receive(self) -> Sequence[EvaderReport]:
        """All reports since the last call, in order of arrival."""
        reports = []
        for received_s, payload in self._arrivals.take():
            try:
                reports.append(self._read(payload, received_s))
                self._counts["reports"] += 1
            except Refused as refused:
                self._counts[f"refused_{refused.reason}"] += 1
        return reports

    def counters(self) -> Mapping[str, int]:
        """Reports, and what was refused, by reason."""
        return {"reports": 0, "dropped": self._arrivals.dropped, **self._counts}

    def close(self) -> None:
        """Undeclare, and close the session if it is ours. May be called twice."""
        if self._arrivals.closed:
            return
        self._arrivals.close()
        with contextlib.suppress(zenoh.ZError):
            self._subscriber.undeclare()  # type: ignore[no-untyped-call]
        if self._own is not None:
            with contextlib.suppress(zenoh.ZError):
                self._own.close()  # type: ignore[no-untyped-call]
