"""The port between the core and a vehicle: a small contract that every link keeps, held by one contract test-suite.

A link never blocks, never resends a setpoint by itself and never interprets: what it hears from the one configured
system and component comes out of `receive` as typed values in order of arrival, and everything else is dropped and
counted. It is used from one thread, the loop's; whatever threads its library has stay inside.
"""

from collections.abc import Mapping, Sequence
from typing import Protocol

from guidance.telemetry import Message, Request, Setpoint, TargetReport


class VehicleLink(Protocol):
    """One vehicle, both directions.

    * `receive` returns all messages since the last call, oldest first, each stamped with the time it arrived on the
      injected clock. It returns an empty list when there is nothing and keeps at most a bounded number (oldest dropped,
      counted).
    * `send_setpoint` puts exactly one SET_POSITION_TARGET_LOCAL_NED frame on the wire, now, and keeps nothing: if it
      is not called again, nothing more is sent. A setpoint that is not finite raises ValueError and is not sent.
    * `request` sends a command or a parameter request; the library may repeat it until it is acknowledged, and the
      acknowledgement comes back through `receive`.
    * `send_heartbeat` sends our own HEARTBEAT (onboard computer), once.
    * `counters` names what was received, sent and dropped, for the log and the metrics.
    * `close` releases everything and may be called twice.
    """

    def receive(self) -> Sequence[Message]: ...

    def send_setpoint(self, setpoint: Setpoint) -> None: ...

    def request(self, request: Request) -> None: ...

    def send_heartbeat(self) -> None: ...

    def counters(self) -> Mapping[str, int]: ...

    def close(self) -> None: ...


class TargetSource(Protocol):
    """Where reports of the target come from. `receive` never blocks and returns them in order of arrival."""

    def receive(self) -> Sequence[TargetReport]: ...

    def counters(self) -> Mapping[str, int]: ...

    def close(self) -> None: ...


class Wire(Protocol):
    """Whole MAVLink frames to and from somewhere: Zenoh, UDP, TCP, serial, or the other side of a test.

    `receive` never blocks and returns (arrival time, frame or piece of a byte stream) pairs; `send` never blocks.
    """

    def receive(self) -> Sequence[tuple[float, bytes]]: ...

    def send(self, frame: bytes) -> None: ...

    def close(self) -> None: ...
