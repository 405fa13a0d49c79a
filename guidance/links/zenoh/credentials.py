"""Credentials for a Zenoh router, read and checked. Imports nothing heavy: orders by a router use it."""

import ssl
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

from guidance.errors import ConfigError
from guidance.files import text_of
from guidance.toml_files import read

AUTHORITY: Final = "ca"
ROUTER: Final = "router"
"""Names of files of `guidance zenoh keys` that belong to no party: AUTHORITY.pem, ROUTER.pem."""


class Credentials(NamedTuple):
    """Zenoh's `transport.auth` and `transport.link.tls`; None for neither."""

    auth: Mapping[str, Any] | None = None
    tls: Mapping[str, Any] | None = None


NO_CREDENTIALS: Final = Credentials()

_CERTIFICATE_KEYS: Final = {"tls_ca_file", "tls_certificate_file", "tls_key_file"}


def certificate_credentials(path: Path) -> Credentials | None:
    """Read a file that names an authority, a certificate and its key, as `guidance zenoh keys` writes it.

    It reads and checks as `zenoh_access.read_credentials` does, without the import of pydantic.

    Returns:
        None if the file has other keys or values, right or wrong.

    Raises:
        ConfigError: As `zenoh_access.read_credentials`.
    """
    _, keys = read(path)
    if keys.keys() != _CERTIFICATE_KEYS:
        return None
    if not all(isinstance(value, str) for value in keys.values()):
        return None
    folder = path.parent
    tls = tls_of(
        folder / keys["tls_ca_file"],
        folder / keys["tls_certificate_file"],
        folder / keys["tls_key_file"],
    )
    return Credentials(tls=tls)


def auth_of(user: str, password_file: Path) -> Mapping[str, Any]:
    """Return Zenoh's `transport.auth` of a user whose password is in a file.

    Raises:
        ConfigError: If the file cannot be read, others may read it, or it has not one line.
    """
    password = _read("password_file", password_file, secret=True).rstrip("\n")
    if not password or "\n" in password:
        raise ConfigError(
            f"zenoh.password_file = {str(password_file)!r}: it must have one line, the password"
        )
    return {"usrpwd": {"user": user, "password": password}}


def tls_of(authority: Path, certificate: Path | None, key: Path | None) -> Mapping[str, Any]:
    """Return Zenoh's `transport.link.tls` for a router whose certificate `authority` has signed.

    Args:
        authority: PEM.
        certificate: PEM, for mutual TLS; None for none.
        key: PEM, of the certificate.

    Raises:
        ConfigError: If a file cannot be read or has the wrong content, others may read the key, or it does not
            belong to its certificate.
    """
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
