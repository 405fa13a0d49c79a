"""The contracts between the core and the links: `VehicleLink`, `EvaderSource` and `Wire`, and the URLs of links.

One contract test suite checks every adapter. A link never blocks and never repeats a setpoint. It accepts messages of
one configured system and component, converts them to typed values in order of arrival, and drops and counts the rest.
Use a link from one thread only; threads of its libraries stay inside it.
"""

import ipaddress
from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple, Protocol, runtime_checkable
from urllib.parse import urlsplit

from guidance.errors import ConfigError
from guidance.messages import EvaderReport, Message, Request, Setpoint

Clock = Callable[[], float]
"""Returns monotonic seconds."""


class VehicleLink(Protocol):
    """One vehicle, both directions."""

    def receive(self) -> Sequence[Message]:
        """Return all messages since the last call, oldest first, stamped with their arrival on the injected clock.

        The queue is bounded: when it is full, the oldest message is dropped and counted. Implausible messages are
        dropped and counted too (a position that is not finite, latitude and longitude both 0). Call this every cycle:
        it also repeats unanswered requests, and sends and answers TIMESYNC.
        """

    def send_setpoint(self, setpoint: Setpoint) -> None:
        """Send one SET_POSITION_TARGET_LOCAL_NED frame now, and never repeat it.

        Raises:
            ValueError: If the setpoint is not finite; it is not sent then.
        """

    def request(self, request: Request) -> None:
        """Send a command or a parameter request. The answer (COMMAND_ACK, PARAM_VALUE) arrives through `receive`.

        Requests that are safe to repeat (read or set a parameter, read the uploaded fence, commands 511 and 512) are
        sent up to 4 times, 0.5 s apart, until they are answered. Of each command number only one is in flight. A
        command that acts on the vehicle is sent once: a blind repeat could take the vehicle back from a pilot. To
        repeat it, look at a HEARTBEAT first.

        Raises:
            ValueError: If it cannot be encoded (an infinite parameter, a latitude out of range).
        """

    def send_heartbeat(self) -> None:
        """Send our own HEARTBEAT (onboard computer) once. Does nothing if the library sends it."""

    def counters(self) -> Mapping[str, int]:
        """Return how many messages were received, sent and dropped, by reason, for log and metrics."""

    def close(self) -> None:
        """Release everything. May be called twice; a closed link neither receives nor sends."""


class EvaderSource(Protocol):
    """Reports of the evader."""

    def receive(self) -> Sequence[EvaderReport]:
        """Return all reports since the last call, in order of arrival. Never blocks.

        Every report must be plausible (`guidance.vehicle.is_plausible`): nothing behind the source checks it again.
        """

    def counters(self) -> Mapping[str, int]:
        """Return how many reports were received and refused, by reason."""

    def close(self) -> None:
        """Release everything. May be called twice."""


@runtime_checkable
class TellsProblem(Protocol):
    """A source or a link that knows why nothing arrives; not every one does."""

    def problem(self) -> str:
        """Return why no report can arrive, for people; empty if one can."""


class Wire(Protocol):
    """Carries MAVLink bytes: Zenoh, UDP, TCP, serial, or memory in tests."""

    def receive(self) -> Sequence[tuple[float, bytes]]:
        """Return (arrival time, frame or piece of a stream) since the last call, oldest first. Never blocks."""

    def impostors(self) -> Sequence[bytes]:
        """Return datagrams since the last call that have a pinned system's id but come from another address.

        They are not part of `receive`. Their rate is bounded. Wires without addresses return none.
        """

    def impostors_of(self, system_id: int, /) -> int:
        """Return how many frames with a system's id were refused, because they came from another address."""

    def send(self, frame: bytes) -> None:
        """Send one whole frame, from any thread. Never blocks; frames that cannot be sent are counted, not raised."""

    def counters(self) -> Mapping[str, int]:
        """Return how many frames were sent, not sent, and dropped because the queue was full."""

    def close(self) -> None:
        """Release everything. May be called twice."""


_FORMS: Final = (
    "udpin://host:port, udpout://host:port, tcpin://host:port, tcpout://host:port, serial:///dev/name:baud, "
    "zenoh://host:port/namespace, and for PX4's flight modes zenoh+tcp://host:port or zenoh+tls://host:port"
)
PX4_SCHEMES: Final = ("zenoh+tcp", "zenoh+tls")
"""Schemes of a router for PX4's own Zenoh module; the path is its ZENOH_DOMAIN_ID, 0 without one."""

_HOSTS_AND_PORTS: Final = ("udpin", "udpout", "tcpin", "tcpout", "zenoh", *PX4_SCHEMES)
_LAST_DOMAIN: Final = 232


class Endpoint(NamedTuple):
    """A parsed URL: host and port, or for serial the device (`host`) and baud rate (`port`).

    `namespace` is Zenoh's; of PX4's own Zenoh it is the number of the ROS domain.
    """

    scheme: str
    host: str
    port: int
    namespace: str = ""

    @property
    def on_loopback(self) -> bool:
        """True if the other end is on this computer, so most likely a simulator."""
        return self.scheme != "serial" and is_loopback(self.host)


def scheme_of(url: str) -> str:
    """Return the scheme of a URL, which need not be one of ours."""
    return url.partition("://")[0]


def is_px4(url: str) -> bool:
    """True if a URL is of a router for PX4's own Zenoh module."""
    return scheme_of(url) in PX4_SCHEMES


def is_loopback(host: str) -> bool:
    """True if only this computer can reach the host."""
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def parse(url: str) -> Endpoint:
    """Parse a URL.

    Raises:
        ConfigError: If it has none of the allowed forms.
    """
    try:
        return taken_apart(url)
    except ValueError as error:
        raise ConfigError(f"url = {url!r}: {error}") from error


def taken_apart(url: str) -> Endpoint:
    """Parse a URL for a configuration, whose own error names the key and the value.

    Raises:
        ValueError: If it has none of the allowed forms.
    """
    scheme, separator, rest = url.partition("://")
    if separator and scheme in ("udp", "tcp"):
        allowed = f"{scheme}in://host:port waits for the vehicle, {scheme}out://host:port calls it"
        raise ValueError(f"{scheme}:// does not say who calls whom: {allowed}")
    if not separator or scheme not in (*_HOSTS_AND_PORTS, "serial"):
        raise ValueError(f"allowed are {_FORMS}")
    if scheme == "serial":
        device, _, baud = rest.rpartition(":")
        if not device or not baud.isdecimal() or int(baud) == 0:
            raise ValueError(
                "a device and a baud rate are needed, as in serial:///dev/ttyACM0:57600"
            )
        return Endpoint(scheme, device, int(baud))
    parts = urlsplit(url)
    host = parts.hostname
    port = parts.port
    namespace = parts.path.strip("/")
    if not host or not port or parts.query or parts.fragment or parts.username:
        raise ValueError(f"a host and a port are needed, as in {scheme}://127.0.0.1:14540")
    # Of PX4's own Zenoh the namespace is the number of its ROS domain.
    if scheme in PX4_SCHEMES:
        domain = namespace or "0"
        if not (domain.isascii() and domain.isdecimal() and int(domain) <= _LAST_DOMAIN):
            raise ValueError(f"the path is PX4's ZENOH_DOMAIN_ID, 0 to {_LAST_DOMAIN}")
        namespace = str(int(domain))
    elif namespace and scheme != "zenoh":
        raise ValueError("only zenoh:// takes a path (its namespace)")
    elif set(namespace) & set("*$#?") or "//" in namespace:
        raise ValueError("a namespace is a plain key such as uav1, without wildcards")
    return Endpoint(scheme, host, port, namespace)
