"""The sections of a flight's outputs in vehicle files: `[log]`, `[metrics]`, `[record]` and `[ros]`."""

from collections.abc import Iterator
from pathlib import Path
from typing import Literal

from pydantic import Field

from guidance.config import Section
from guidance.links.zenoh.access import ZenohSection
from guidance.session.orders_section import BY_TLS, LOOPBACK_ENDPOINT


class LogSection(Section):
    """The log, on standard error."""

    format: Literal["console", "json"] = Field(
        "console", description="readable lines, or one JSON object per line"
    )
    level: Literal["debug", "info", "warning", "error"] = Field(
        "info", description="lowest level that is logged"
    )


class MetricsSection(Section):
    """The Prometheus endpoint, on loopback."""

    port: int | None = Field(
        None, ge=1, le=65535, description="port on 127.0.0.1; default: no metrics"
    )


class RecordSection(Section):
    """The flight record."""

    folder: Path | None = Field(
        None, description="folder of the MCAP records, one per start; default: no records"
    )
    required: bool = Field(
        True, description="whether an unwritable record keeps the vehicle on the ground"
    )
    rotate_s: float = Field(600.0, ge=10.0, description="a new file begins after this time")
    rotate_mb: float = Field(256.0, ge=1.0, description="a new file begins at this size")


class RosSection(Section):
    """The flight as ROS 2 topics, through a Zenoh router as rmw_zenoh uses it."""

    endpoint: str = Field(
        "tcp/127.0.0.1:7447",
        pattern=r"^(tcp|tls)/[^\s/]+:\d+$",
        description="the Zenoh router of the ROS graph, such as rmw_zenohd; with tls/ by [zenoh]",
    )
    domain_id: int = Field(0, ge=0, le=232, description="ROS_DOMAIN_ID")
    orders: bool = Field(
        False,
        description="services hold, land, return and engage: whoever reaches the router may order; "
        "only on loopback, or by TLS with a certificate",
    )

    @property
    def by_tls(self) -> bool:
        """True if the router is reached by TLS."""
        return BY_TLS.fullmatch(self.endpoint) is not None

    def faults_beside(self, zenoh: ZenohSection) -> Iterator[str]:
        """Yield its faults in combination with a file's `[zenoh]`."""
        key = f"ros.endpoint = {self.endpoint!r}"
        if self.by_tls and zenoh.tls_ca_file is None:
            yield f"{key}: needs zenoh.tls_ca_file, which signed the router's certificate"
        proven = self.by_tls and zenoh.tls_certificate_file is not None
        if self.orders and not proven and LOOPBACK_ENDPOINT.fullmatch(self.endpoint) is None:
            allowed = "a router on loopback, or tls/ with zenoh.tls_certificate_file"
            yield f"{key}: with ros.orders = true must be {allowed}; else anyone could command the vehicle"
