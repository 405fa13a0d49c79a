"""The ports between the core and the world: small contracts that every adapter keeps, held by one contract test-suite.

A link never blocks, never resends a setpoint by itself and never interprets: what it hears from the one configured
system and component comes out of `receive` as typed values in order of arrival, and everything else is dropped and
counted. It is used from one thread, the loop's; whatever threads its library has stay inside.
"""

from collections.abc import Mapping, Sequence
from typing import Protocol

from guidance.messages import EvaderReport, Message, Request, Setpoint


class VehicleLink(Protocol):
    """One vehicle, both directions."""

    def receive(self) -> Sequence[Message]:
        """All messages since the last call, oldest first, each stamped with its arrival on the injected clock.

        Empty when there is nothing. A bounded number is kept (oldest dropped, counted). Messages whose values cannot
        be meant (a position that is not finite, latitude and longitude both 0) are dropped and counted. Call it every
        cycle: what asks is repeated, and TIMESYNC is asked and answered, from in here.
        """

    def wait(self, timeout_s: float) -> None:
        """Wait until something has arrived, at most this long in real time; what, `receive` says.

        For a loop that answers what it hears at once. One that keeps its own rate has no need of it.
        """

    def send_setpoint(self, setpoint: Setpoint) -> None:
        """Put exactly one SET_POSITION_TARGET_LOCAL_NED frame on the wire, now, and keep nothing.

        If it is not called again, nothing more is sent.

        Raises:
            ValueError: If the setpoint is not finite; nothing is sent then.
        """

    def request(self, request: Request) -> None:
        """Send a command or a parameter request; the answer (COMMAND_ACK, PARAM_VALUE) comes back through `receive`.

        What may be repeated (parameters, read or set; the uploaded fence; streams and messages, 511 and 512) is
        repeated every 0.5 s, 4 times in all, until it is answered, one command of a number at a time. A command that
        acts on the vehicle is sent exactly once: if it is to be repeated, then by someone who looked at a HEARTBEAT
        first, lest it is taken back from a pilot.

        Raises:
            ValueError: If it cannot be sent as it is (an infinite parameter, a latitude that is none).
        """

    def send_heartbeat(self) -> None:
        """Send our own HEARTBEAT (onboard computer), once; nothing where the library sends them by itself."""

    def counters(self) -> Mapping[str, int]:
        """What was received, sent and dropped, by reason, for the log and the metrics."""

    def close(self) -> None:
        """Release everything. May be called twice; afterwards nothing is received and nothing is sent."""


class EvaderSource(Protocol):
    """Where reports of the evader come from."""

    def receive(self) -> Sequence[EvaderReport]:
        """All reports since the last call, in order of arrival. Never blocks."""

    def counters(self) -> Mapping[str, int]:
        """What was received and what was refused, by reason."""

    def close(self) -> None:
        """Release everything. May be called twice."""


class Wire(Protocol):
    """MAVLink frames to and from somewhere: Zenoh, UDP, TCP, serial, or the other side of a test."""

    @property
    def stream(self) -> bool:
        """Whether a frame may be split between two pieces."""

    def receive(self) -> Sequence[tuple[float, bytes]]:
        """(arrival time, frame or piece of a byte stream) since the last call, oldest first, bounded. Never blocks."""

    def wait(self, timeout_s: float) -> None:
        """Wait until something has arrived, at most this long in real time. It may return early, with nothing."""

    def send(self, frame: bytes) -> None:
        """Send one whole frame, from any thread.

        Never blocks and never raises for a peer that is gone: what cannot be sent is counted.
        """

    def counters(self) -> Mapping[str, int]:
        """Frames sent, not sent, and pieces dropped for want of room."""

    def close(self) -> None:
        """Release everything. May be called twice."""
