"""Who we are to a Zenoh router, and which router we believe: TLS, mutual TLS, user and password.

The same keys are the section `[zenoh]` of a vehicle file and the file that `guidance zenoh keys` writes for each party.
"""

import ssl
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple, Self

from pydantic import Field, model_validator

from guidance.config import Section, load
from guidance.errors import ConfigError

AUTHORITY: Final = "ca"
ROUTER: Final = "router"
"""Names of the files of `guidance zenoh keys` that are nobody's: AUTHORITY.pem, ROUTER.pem."""

_PATHS: Final = ("tls_ca_file", "tls_certificate_file", "tls_key_file", "password_file")


class ZenohSection(Section):
    """How a Zenoh router is reached beyond this computer. Without it Zenoh goes over plain TCP."""

    tls_ca_file: Path | None = Field(None, description="PEM; TLS, with routers whose certificate this authority signed")
    tls_certificate_file: Path | None = Field(None, description="PEM; mutual TLS: its common name is who we are")
    tls_key_file: Path | None = Field(None, description="PEM, of the certificate; readable by nobody else")
    user: str | None = Field(None, pattern=r"^[^\s:]{1,64}$", description="who we are, to a router that asks for it")
    password_file: Path | None = Field(None, description="one line; readable by nobody else")

    @model_validator(mode="after")
    def _check_together(self) -> Self:
        for one, other in (
            ("tls_certificate_file", "tls_key_file"),
            ("tls_key_file", "tls_certificate_file"),
            ("tls_certificate_file", "tls_ca_file"),
            ("user", "password_file"),
            ("password_file", "user"),
        ):
            if getattr(self, one) is not None and getattr(self, other) is None:
                raise ValueError(f"zenoh.{other}: missing; zenoh.{one} = {str(getattr(self, one))!r} needs it")
        return self

    def beside(self, folder: Path) -> Self:
        """Return the same with relative paths counted from a folder."""
        given = {name: getattr(self, name) for name in _PATHS}
        return self.model_copy(update={name: folder / path for name, path in given.items() if path is not None})


class Credentials(NamedTuple):
    """What a session shows and asks for: Zenoh's `transport.auth` and `transport.link.tls`; None for neither."""

    auth: Mapping[str, Any] | None = None
    tls: Mapping[str, Any] | None = None

    def endpoint(self, host: str, port: int) -> str:
        """Return the endpoint of a router, by TLS where we have an authority to judge it by."""
        return f"{'tcp' if self.tls is None else 'tls'}/{host}:{port}"


NO_CREDENTIALS: Final = Credentials()


def credentials_of(section: ZenohSection) -> Credentials:
    """Read what a section names, and see that it fits together before anything is connected.

    Raises:
        ConfigError: If a file cannot be read, is no certificate, key or password, others may read a secret, or a key is
            not its certificate's; the message names the key and the file.
    """
    return Credentials(_auth(section), _tls(section))


def read_credentials(path: Path | None) -> Credentials:
    """Read a file that has the keys of `[zenoh]`; relative names in it count from its folder. None has none.

    Raises:
        ConfigError: If it is wrong, or as `credentials_of`.
    """
    return NO_CREDENTIALS if path is None else credentials_of(load(ZenohSection, path).beside(path.parent))


def _auth(section: ZenohSection) -> Mapping[str, Any] | None:
    if section.user is None or section.password_file is None:
        return None
    password = _read("password_file", section.password_file, secret=True).rstrip("\n")
    if not password or "\n" in password:
        raise ConfigError(f"zenoh.password_file = {str(section.password_file)!r}: must have one line, the password")
    return {"usrpwd": {"user": section.user, "password": password}}


def _tls(section: ZenohSection) -> Mapping[str, Any] | None:
    authority, certificate, key = section.tls_ca_file, section.tls_certificate_file, section.tls_key_file
    if authority is None:
        return None
    _read("tls_ca_file", authority)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    try:
        context.load_verify_locations(authority)
    except ssl.SSLError as error:
        raise ConfigError(
            f"zenoh.tls_ca_file = {str(authority)!r}: is no certificate in PEM ({error.reason})"
        ) from error
    tls = {"root_ca_certificate": str(authority), "verify_name_on_connect": True, "close_link_on_expiration": True}
    if certificate is None or key is None:
        return tls
    _read("tls_certificate_file", certificate)
    _read("tls_key_file", key, secret=True)
    try:
        context.load_cert_chain(certificate, key, password=str)  # no password: Zenoh could not ask for one either
    except ssl.SSLError as error:
        raise ConfigError(
            f"zenoh.tls_certificate_file = {str(certificate)!r} with zenoh.tls_key_file = {str(key)!r}: are no pair in "
            f"PEM ({error.reason or error})"
        ) from error
    return {**tls, "enable_mtls": True, "connect_certificate": str(certificate), "connect_private_key": str(key)}


def _read(name: str, path: Path, *, secret: bool = False) -> str:
    try:
        mode, text = path.stat().st_mode, path.read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"zenoh.{name} = {str(path)!r}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"zenoh.{name} = {str(path)!r}: is no text") from error
    if secret and mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise ConfigError(f"zenoh.{name} = {str(path)!r}: others may read it; chmod 600 it")
    return text
