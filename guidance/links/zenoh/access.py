"""Credentials for a Zenoh router and the check of its identity: TLS, mutual TLS, user and password.

The keys are the same in the section `[zenoh]` of a vehicle file and in the files that `guidance zenoh keys` writes.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Final, Self

from pydantic import Field

from guidance.config import Section, load
from guidance.links.zenoh.credentials import NO_CREDENTIALS, Credentials, auth_of, tls_of

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


def credentials_of(section: ZenohSection) -> Credentials:
    """Read and check the files of a section before anything is connected.

    Raises:
        ConfigError: If a file cannot be read or is not what its key says, others may read a secret, or a key does not
            belong to its certificate. The message names the key and the file.
    """
    auth = None
    if section.user is not None and section.password_file is not None:
        auth = auth_of(section.user, section.password_file)
    tls = None
    if section.tls_ca_file is not None:
        tls = tls_of(section.tls_ca_file, section.tls_certificate_file, section.tls_key_file)
    return Credentials(auth, tls)


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
