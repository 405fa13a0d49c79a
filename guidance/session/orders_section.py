"""The section `[control]` of vehicle files: where orders arrive."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from pydantic import Field, field_validator

from guidance.config import Section

LOOPBACK_ENDPOINT: Final = re.compile(
    r"(tcp|udp|ws)/(127\.\d+\.\d+\.\d+|localhost|\[::1\]):\d+|unixsock-stream/.+"
)

BY_TLS: Final = re.compile(r"tls/[^\s/]+:\d+")


class Control(Section):
    """Where orders arrive: Zenoh queryables on loopback, or on a router that checks certificates."""

    endpoint: str = Field(
        "tcp/127.0.0.1:7448", description="Zenoh on loopback, or a router by TLS: docs/zenoh.md"
    )
    host: bool = Field(True, description="listen there; false connects to a running Zenoh router")
    token_file: Path | None = Field(
        None, description="secret of `guidance ctl`; default: runtime folder"
    )

    @field_validator("endpoint")
    @classmethod
    def _check_loopback(cls, endpoint: str) -> str:
        if LOOPBACK_ENDPOINT.fullmatch(endpoint) is None and BY_TLS.fullmatch(endpoint) is None:
            allowed = (
                "on loopback, as tcp/127.0.0.1:7448, or a router with TLS, as tls/192.168.1.10:7447"
            )
            raise ValueError(f"must be {allowed}: whoever can reach it commands the vehicle")
        return endpoint

    @property
    def by_tls(self) -> bool:
        """True if orders arrive through a router that checks certificates."""
        return BY_TLS.fullmatch(self.endpoint) is not None

    def _faults(self) -> Iterator[str]:
        if self.by_tls and self.host:
            yield f"control.endpoint = {self.endpoint!r}: is a router; set control.host = false"
        if self.by_tls and self.token_file is not None:
            yield f"control.token_file = {str(self.token_file)!r}: not allowed with TLS, where certificates identify us"
