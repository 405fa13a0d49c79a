"""Reports of an evader from a Zenoh key, whatever the payload: JSON as here, or ROS 2's CDR (`evaders.ros`).

The schema of the JSON is generated from the model below.
"""

import contextlib
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal

import zenoh
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from guidance.errors import ConfigError
from guidance.frames import Altitude, Amsl, Ellipsoid, LocalFrame, Relative
from guidance.links.arrivals import Arrivals, Clock
from guidance.links.evaders.carrier import UNKNOWN_VELOCITY, Refused
from guidance.links.wires.zenoh import open_session
from guidance.links.wires.zenoh_access import NO_CREDENTIALS, Credentials
from guidance.messages import AltitudeSaid, Datum, EvaderReport

Reader = Callable[[bytes, float], EvaderReport]


class ZenohEvader:
    """`EvaderSource` on one key expression. Opens its own session unless it is given one."""

    def __init__(
        self,
        clock: Clock,
        key: str,
        read: Reader,
        *,
        endpoint: str | None = None,
        session: "zenoh.Session | None" = None,
        credentials: Credentials = NO_CREDENTIALS,
        timeout_s: float = 3.0,
    ) -> None:
        """Subscribe.

        Raises:
            ConfigError: If the key is not a Zenoh key expression, or neither or both of endpoint and session are given.
            LinkError: If there is no session to be had within `timeout_s`.
        """
        if (endpoint is None) == (session is None):
            raise ConfigError(f"endpoint = {endpoint!r}, session = {session!r}: give exactly one")
        try:
            expression = zenoh.KeyExpr(key)
        except zenoh.ZError as error:
            raise ConfigError(f"key = {key!r}: not a Zenoh key expression") from error
        self._read = read
        self._arrivals = Arrivals[tuple[bytes, str]](clock)
        self._counts: Counter[str] = Counter()
        self._own = None if endpoint is None else open_session(endpoint, timeout_s=timeout_s, credentials=credentials)
        used = session if session is not None else self._own
        assert used is not None
        self._subscriber = used.declare_subscriber(
            expression,
            lambda sample: self._arrivals.put((sample.payload.to_bytes(), sender(sample))),
            allowed_origin=zenoh.Locality.REMOTE,
        )

    def receive(self) -> Sequence[EvaderReport]:
        """All reports since the last call, in order of arrival."""
        reports = []
        for received_s, (payload, peer) in self._arrivals.take():
            try:
                reports.append(self._read(payload, received_s)._replace(peer=peer))
                self._counts["reports"] += 1
            except Refused as refused:
                self._counts[f"refused_{refused.reason}"] += 1
        return reports

    def counters(self) -> Mapping[str, int]:
        """Reports, and what was refused, by reason."""
        return {"reports": 0, "dropped": self._arrivals.dropped, **self._counts}

    def close(self) -> None:
        """Undeclare, and close the session if it is ours. May be called twice."""
        if self._arrivals.closed:
            return
        self._arrivals.close()
        with contextlib.suppress(zenoh.ZError):
            self._subscriber.undeclare()  # type: ignore[no-untyped-call]
        if self._own is not None:
            with contextlib.suppress(zenoh.ZError):
                self._own.close()  # type: ignore[no-untyped-call]


def sender(sample: "zenoh.Sample") -> str:
    """Return who published a sample, as far as it tells: the key, and a publisher's identity of Zenoh or of ROS 2."""
    source, attachment = sample.source_info, sample.attachment
    if source is not None:
        return f"{sample.key_expr} {source.source_id}"
    told = b"" if attachment is None else attachment.to_bytes()
    return f"{sample.key_expr} {told[-_GID_BYTES:].hex()}" if len(told) == _RMW_BYTES else str(sample.key_expr)


ENCODING = "application/json"
_GID_BYTES, _RMW_BYTES = 16, 33
"""rmw_zenoh attaches a number, a time, and the publisher's identity with its length before it."""

_DATUMS: dict[str, type[Amsl] | type[Ellipsoid] | type[Relative]] = {
    "amsl": Amsl,
    "ellipsoid": Ellipsoid,
    "relative": Relative,
}


class JsonReport(BaseModel):
    """One report of an evader's position, and of its velocity where that is known."""

    model_config = ConfigDict(extra="forbid", frozen=True, title="guidance.EvaderReport", strict=True)

    sent_s: FiniteFloat | None = Field(
        default=None, description="When it was measured, seconds of the sender's own steady clock; null if it has none"
    )
    latitude_deg: float = Field(ge=-90.0, le=90.0, description="WGS-84 latitude, degrees")
    longitude_deg: float = Field(ge=-180.0, le=180.0, description="WGS-84 longitude, degrees")
    altitude_m: float = Field(gt=-1e5, lt=1e5, description="Altitude above the datum, metres")
    altitude_datum: Literal["amsl", "ellipsoid", "relative"] = Field(
        description="Mean sea level, the WGS-84 ellipsoid, or the pursuer's home"
    )
    velocity_ned_m_s: tuple[FiniteFloat, FiniteFloat, FiniteFloat] | None = Field(
        default=None, description="North, east, down, m/s; null if unknown (never zero for unknown)", strict=False
    )
    position_sd_m: float | None = Field(
        default=None, gt=0.0, lt=1e6, description="Standard deviation of the position, largest axis, metres"
    )
    velocity_sd_m_s: float | None = Field(
        default=None, gt=0.0, lt=1e6, description="Standard deviation of the velocity, largest axis, m/s"
    )


def json_schema() -> dict[str, Any]:
    """The JSON Schema (2020-12) that is published in `config/zenoh/evader_report.schema.json`."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **JsonReport.model_json_schema()}


def read_json(payload: bytes, received_s: float, *, frame: LocalFrame, source: str) -> EvaderReport:
    """Turn a payload into a report.

    Args:
        payload: The JSON text.
        received_s: By our clock.
        frame: The vehicle's local frame, by which an altitude above home or ellipsoid is made AMSL.
        source: Who said it, as the report names its source.

    Raises:
        Refused: If it does not keep the schema, or its altitude's datum cannot be made AMSL in this frame.
    """
    try:
        given = JsonReport.model_validate_json(payload)
    except ValidationError as error:
        raise Refused("schema") from error
    if given.latitude_deg == 0.0 and given.longitude_deg == 0.0:
        raise Refused("position")
    altitude: Altitude = _DATUMS[given.altitude_datum](given.altitude_m)
    try:
        above_sea = frame.amsl(altitude)
    except ConfigError as error:
        raise Refused("datum") from error
    return EvaderReport(
        received_s=received_s,
        sent_s=_or_nan(given.sent_s),
        source=source,
        latitude_deg=given.latitude_deg,
        longitude_deg=given.longitude_deg,
        altitude_amsl_m=above_sea.metres,
        velocity_ned_m_s=given.velocity_ned_m_s or UNKNOWN_VELOCITY,
        position_sd_m=_or_nan(given.position_sd_m),
        velocity_sd_m_s=_or_nan(given.velocity_sd_m_s),
        said=AltitudeSaid(given.altitude_m, Datum(given.altitude_datum)),
    )


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value
