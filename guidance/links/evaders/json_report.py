"""An evader's report as JSON, for anyone who can publish on Zenoh. The schema is generated from the model below."""

import math
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from guidance.errors import ConfigError
from guidance.frames import Altitude, Amsl, Ellipsoid, LocalFrame, Relative
from guidance.links.evaders.refusal import UNKNOWN_VELOCITY, Refused
from guidance.messages import AltitudeSaid, Datum, EvaderReport

ENCODING = "application/json"
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


def schema() -> dict[str, Any]:
    """The JSON Schema (2020-12) that is published in `config/zenoh/evader_report.schema.json`."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **JsonReport.model_json_schema()}


def report(payload: bytes, received_s: float, *, frame: LocalFrame, source: str) -> EvaderReport:
    """Turn a payload into a report.

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
