"""Who may open the page: on loopback whoever has the URL with its token, elsewhere who knows a password, over TLS.

Both are exchanged for one cookie, which scripts cannot read and other sites' pages cannot send. Every request shows it;
whatever changes something, and the socket, must also come from a page of ours.
"""

import hmac
import ipaddress
import re
import secrets
import ssl
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple
from urllib.parse import urlsplit

from guidance.errors import ConfigError

SHORTEST_PASSWORD: Final = 12
_LOCAL: Final = ("127.0.0.1", "localhost", "[::1]")


class Secured(NamedTuple):
    """What a panel that others than this computer may reach has to have."""

    tls: ssl.SSLContext
    password: str


class Access:
    """The rules of one panel.

    Args:
        port: Where it is served.
        secured: TLS and password; None for loopback.
    """

    def __init__(self, port: int, secured: Secured | None) -> None:
        self.token = secrets.token_urlsafe(24)
        self.cookie = f"guidance-panel-{port}"
        self._session = secrets.token_urlsafe(24)
        self._secured = secured
        self._hosts = frozenset(f"{name}:{port}" for name in _LOCAL)

    @property
    def scheme(self) -> str:
        """Http or https."""
        return "http" if self._secured is None else "https"

    @property
    def with_password(self) -> bool:
        """Whether a password opens it, in place of the token."""
        return self._secured is not None

    @property
    def tls(self) -> ssl.SSLContext | None:
        """What it is served with."""
        return None if self._secured is None else self._secured.tls

    @property
    def session(self) -> str:
        """The cookie's value for who is let in."""
        return self._session

    def opens(self, given: str) -> bool:
        """Whether a token, or a password where there is one, is the right one."""
        wanted = self.token if self._secured is None else self._secured.password
        return hmac.compare_digest(given.encode(), wanted.encode())

    def is_let_in(self, cookies: Mapping[str, str]) -> bool:
        """Whether a request shows the cookie."""
        return hmac.compare_digest(cookies.get(self.cookie, "").encode(), self._session.encode())

    def is_for_us(self, host: str) -> bool:
        """Whether a request names us as its host: a name that leads here by somebody else's doing is not ours.

        Over TLS the certificate says so already, and the names are many.
        """
        return self._secured is not None or host in self._hosts

    def is_from_us(self, host: str, origin: str) -> bool:
        """Whether a request comes from a page of this panel."""
        return bool(host) and origin == f"{self.scheme}://{host}"


def secured(host: str, certificate: Path | None, key: Path | None, password_file: Path | None) -> Secured | None:
    """Return what a host needs: nothing on loopback, TLS and a password anywhere else.

    Args:
        host: Where the page is served.
        certificate: Chain, PEM.
        key: Its private key, PEM.
        password_file: With the password in its first line.

    Raises:
        ConfigError: If something is missing there, or cannot be used.
    """
    if certificate is None and key is None and password_file is None and is_loopback(host):
        return None
    if certificate is None or key is None or password_file is None:
        raise ConfigError(
            f"--host {host}: who reaches the page commands the vehicle. Anything else than loopback needs "
            "--certificate, --key and --password-file, all three. A certificate of your own: openssl req -x509 "
            "-newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 365 -keyout key.pem -out cert.pem "
            f"-subj /CN={host}"
        )
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        context.load_cert_chain(certificate, key)
    except (OSError, ssl.SSLError) as error:
        raise ConfigError(
            f"--certificate {certificate}, --key {key}: cannot be used ({error}); give PEM files"
        ) from error
    return Secured(context, read_password(password_file))


def is_loopback(host: str) -> bool:
    """Whether only this computer reaches a host."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def read_password(path: Path) -> str:
    """Read the first line of a file that nobody else can read.

    Raises:
        ConfigError: If it cannot be read, others can, or it is short.
    """
    try:
        words = path.read_text(encoding="utf-8").splitlines()
        mode = stat.S_IMODE(path.stat().st_mode)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"--password-file {path}: cannot be read ({error})") from error
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise ConfigError(f"--password-file {path}: others can read it; chmod 600 it")
    password = words[0].strip() if words else ""
    if len(password) < SHORTEST_PASSWORD:
        raise ConfigError(f"--password-file {path}: its first line has {len(password)} characters; give at least 12")
    return password


def origin_of(tiles: str) -> str:
    """Return scheme://host[:port] of a tile server's address.

    Raises:
        ConfigError: If it is no such address.
    """
    parts = urlsplit(tiles)
    host = re.fullmatch(r"[A-Za-z0-9.-]+(:\d+)?", parts.netloc)
    if parts.scheme not in {"http", "https"} or host is None or any(key not in tiles for key in ("{z}", "{x}", "{y}")):
        raise ConfigError(f"--tiles {tiles}: must be as https://tiles.example/{{z}}/{{x}}/{{y}}.png")
    return f"{parts.scheme}://{parts.netloc}"
