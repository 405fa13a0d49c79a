"""Credentials for a Zenoh router and the check of its identity: TLS, mutual TLS, user and password.

The keys are the same in the section `[zenoh]` of a vehicle file and in the files that `guidance zenoh keys` writes.
"""

import ssl
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple, Self

from pydantic import Field

from guidance.config import Section, load
from guidance.errors import ConfigError
from guidance.files import text_of

AUTHORITY: Final = "ca"
ROUTER: Final = "router"
"""Names of files of `guidance zenoh keys` that belong to no party: AUTHORITY.pem, ROUTER.pem."""

_PATHS: Final = ("tls_ca_file", "tls_certificate_file", "tls_key_file", "password_file")


class ZenohSection(Section):
    """Access to a Zenoh router on another computer. Without this section Zenoh uses plain TCP."""

    tls_ca_file: Path | None = Field(
        None, description="PEM; use TLS, with routers whose certificate it has signed"
    )
    tls_certificate_file: Path | None = Field(
        None, description="PEM; mutual TLS: its common name is our identity"
    )
    tls_key_file: Path | None = Field(
        None, description="PEM, of the certificate; only you may read it"
    )
    user: str | None = Field(
        None, pattern=r"^[^\s:]{1,64}$", description="our name at a router that asks for one"
    )
    password_file: Path | None = Field(None, description="one line; only you may read it")

    def _faults(self) -> Iterator[str]:
        authority, certificate, key, password = _PATHS
        pairs = (
            (certificate, key),
            (key, certificate),
            (certificate, authority),
            ("user", password),
            (password, "user"),
        )
        for one, other in pairs:
            if getattr(self, one) is not None and getattr(self, other) is None:
                yield f"zenoh.{other}: missing; zenoh.{one} = {str(getattr(self, one))!r} needs it"

    def beside(self, folder: Path) -> Self:
        """Return a copy whose relative paths are relative to a folder."""
        given = {
            name: folder / path for name in _PATHS if (path := getattr(self, name)) is not None
        }
        return self.model_copy(update=given)


class Credentials(NamedTuple):
    """Zenoh's `transport.auth` and `transport.link.tls`; None for neither."""

    auth: Mapping[str, Any] | None = None
    tls: Mapping[str, Any] | None = None


NO_CREDENTIALS: Final = Credentials()


def credentials_of(section: ZenohSection) -> Credentials:
    """Read and check the files of a section before anything is connected.

    Raises:
        ConfigError: If a file cannot be read or is not what its key says, others may read a secret, or a key does not
            belong to its certificate. The message names the key and the file.
    """
    return Credentials(_auth(section), _tls(section))


def read_credentials(path: Path | None) -> Credentials:
    """Read a file with the keys of `[zenoh]`; its relative paths are relative to its folder. None reads nothing.

    Raises:
        ConfigError: If it is wrong, or as `credentials_of`.
    """
    return (
        NO_CREDENTIALS
        if path is None
        else credentials_of(load(ZenohSection, path).beside(path.parent))
    )


def _auth(section: ZenohSection) -> Mapping[str, Any] | None:
    if section.user is None or section.password_file is None:
        return None
    password = _read("password_file", section.password_file, secret=True).rstrip("\n")
    if not password or "\n" in password:
        raise ConfigError(
            f"zenoh.password_file = {str(section.password_file)!r}: it must have one line, the password"
        )
    return {"usrpwd": {"user": section.user, "password": password}}


def _tls(section: ZenohSection) -> Mapping[str, Any] | None:
    authority = section.tls_ca_file
    certificate = section.tls_certificate_file
    key = section.tls_key_file
    if authority is None:
        return None
    _read("tls_ca_file", authority)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    try:
        context.load_verify_locations(authority)
    except ssl.SSLError as error:
        raise ConfigError(
            f"zenoh.tls_ca_file = {str(authority)!r}: not a PEM certificate ({error.reason})"
        ) from error
    tls = {
        "root_ca_certificate": str(authority),
        "verify_name_on_connect": True,
        "close_link_on_expiration": True,
    }
    if certificate is None or key is None:
        return tls
    _read("tls_certificate_file", certificate)
    _read("tls_key_file", key, secret=True)
    try:
        # Zenoh cannot ask for a password either
        context.load_cert_chain(certificate, key, password=str)
    except ssl.SSLError as error:
        files = (
            f"zenoh.tls_certificate_file = {str(certificate)!r}, zenoh.tls_key_file = {str(key)!r}"
        )
        raise ConfigError(
            f"{files}: not a certificate and its key in PEM ({error.reason or error})"
        ) from error
    return {
        **tls,
        "enable_mtls": True,
        "connect_certificate": str(certificate),
        "connect_private_key": str(key),
    }


def _read(name: str, path: Path, *, secret: bool = False) -> str:
    return text_of(path, f"zenoh.{name} = {str(path)!r}", secret=secret)
