"""URLs of links: parsed and checked."""

import ipaddress
from typing import NamedTuple
from urllib.parse import urlsplit

from guidance.errors import ConfigError

FORMS = (
    "udpin://host:port, udpout://host:port, tcpin://host:port, tcpout://host:port, serial:///dev/name:baud, "
    "zenoh://host:port/namespace"
)
_HOSTS_AND_PORTS = ("udpin", "udpout", "tcpin", "tcpout", "zenoh")


class Endpoint(NamedTuple):
    """A parsed URL: host and port, or for serial the device (`host`) and baud rate (`port`); `namespace` is Zenoh's."""

    url: str
    scheme: str
    host: str
    port: int
    namespace: str = ""

    @property
    def on_loopback(self) -> bool:
        """True if the other end is on this computer, so most likely a simulator."""
        if self.scheme == "serial":
            return False
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return self.host == "localhost"


def parse(url: str) -> Endpoint:
    """Parse a URL.

    Raises:
        ConfigError: If it has none of `FORMS`.
    """
    try:
        return taken_apart(url)
    except ValueError as error:
        raise ConfigError(f"url = {url!r}: {error}") from error


def taken_apart(url: str) -> Endpoint:
    """Parse a URL for a configuration, whose own error names the key and the value.

    Raises:
        ValueError: If it has none of `FORMS`.
    """
    scheme, separator, rest = url.partition("://")
    if separator and scheme in ("udp", "tcp"):
        raise ValueError(
            f"{scheme}:// does not say who calls whom: {scheme}in://host:port waits for the vehicle, "
            f"{scheme}out://host:port calls it"
        )
    if not separator or scheme not in (*_HOSTS_AND_PORTS, "serial"):
        raise ValueError(f"allowed are {FORMS}")
    if scheme == "serial":
        device, _, baud = rest.rpartition(":")
        if not device or not baud.isdecimal() or int(baud) == 0:
            raise ValueError("a device and a baud rate are needed, as in serial:///dev/ttyACM0:57600")
        return Endpoint(url, scheme, device, int(baud))
    return _host_and_port(url, scheme)


def _host_and_port(url: str, scheme: str) -> Endpoint:
    parts = urlsplit(url)
    host, port = parts.hostname, parts.port
    namespace = parts.path.strip("/")
    if not host or not port or parts.query or parts.fragment or parts.username:
        raise ValueError(f"a host and a port are needed, as in {scheme}://127.0.0.1:14540")
    if namespace and scheme != "zenoh":
        raise ValueError("only zenoh:// takes a path (its namespace)")
    if any(character in namespace for character in "*$#?") or "//" in namespace:
        raise ValueError("a namespace is a plain key such as uav1, without wildcards")
    return Endpoint(url, scheme, host, port, namespace)
