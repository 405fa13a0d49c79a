"""The configuration of a vehicle: how it is reached, whom it pursues, which game it plays and within which limits.

Its fence may be that of a QGroundControl plan, whose inclusion polygon takes the place of the file's name. Format of
plans: https://docs.qgroundcontrol.com/master/en/qgc-dev-guide/file_formats/plan.html. The corners are in the
configuration from then on, and so in the record of every flight, wherever the file goes.
"""

import json
import re
from pathlib import Path
from typing import Any, Final, Literal, Self

from pydantic import Field, field_validator, model_validator

from guidance.config import Section, load, parse
from guidance.control import Speeds
from guidance.errors import ConfigError
from guidance.links.wires.zenoh_access import ZenohSection
from guidance.session.sections import EvaderSection, GameSection, LimitsSection, SystemId, Url

_ABOVE_THE_FLOOR_M: Final = 1.0
"""Take-off ends up to 0.7 m low, and a hover wanders by some decimetres."""

_LOOPBACK = re.compile(r"(tcp|udp|ws)/(127\.\d+\.\d+\.\d+|localhost|\[::1\]):\d+|unixsock-stream/.+")
_BY_TLS = re.compile(r"tls/[^\s/]+:\d+")

_KEY: Final = "limits.fence_plan_file"


class Vehicle(Section):
    """How the autopilot is reached."""

    autopilot: Literal["px4", "arducopter"] = Field(description="which autopilot is there")
    link: Literal["mavsdk", "pymavlink"] = Field(
        "pymavlink", description="which client speaks to it; only pymavlink signs"
    )
    url: Url = Field(description="udpin:// udpout:// tcpin:// tcpout:// serial:// or zenoh://")
    system_id: SystemId = Field(1, description="MAVLink system id of the vehicle")
    component_id: SystemId = Field(1, description="MAVLink component id of its autopilot")
    connect_timeout_s: float = Field(60.0, gt=0.0, le=3600.0, description="how long the first HEARTBEAT is waited for")
    signing_key_file: Path | None = Field(None, description="64 hexadecimal digits, readable by nobody else")

    @model_validator(mode="after")
    def _check_signing(self) -> Self:
        if self.signing_key_file is not None and self.link == "mavsdk":
            raise ValueError('vehicle.signing_key_file with link = "mavsdk": MAVSDK does not sign; use "pymavlink"')
        return self


class ReserveSection(Section):
    """By what the battery that is needed to fly home is reckoned: how far it is, how fast, and against which wind."""

    endurance_s: float = Field(gt=0.0, le=1e5, description="that a full charge lasts in flight")
    left: float = Field(0.1, ge=0.0, lt=1.0, description="share of the charge that is to be left on the ground")
    return_speed_m_s: float = Field(5.0, gt=0.0, le=30.0, description="the autopilot's own, through the air")
    landing_speed_m_s: float = Field(0.7, gt=0.0, le=5.0, description="the autopilot's own, downwards")
    wind_m_s: float = Field(0.0, ge=0.0, lt=30.0, description="that is against it at worst")

    @model_validator(mode="after")
    def _check_wind(self) -> Self:
        if self.wind_m_s >= self.return_speed_m_s:
            raise ValueError(
                f"flight.reserve.wind_m_s = {self.wind_m_s:g}: must be below flight.reserve.return_speed_m_s = "
                f"{self.return_speed_m_s:g}: against such a wind nothing comes home"
            )
        return self


class FlightSection(Section):
    """How the flight goes around the game."""

    takeoff_height_m: float = Field(15.0, ge=2.0, le=120.0, description="above home")
    after_capture: Literal["hold", "shadow", "return"] = Field(
        "hold", description="stay, keep station on the moving evader, or fly home"
    )
    engage_on: Literal["command", "pilot_mode"] = Field(
        "command", description="who engages: an order, or the pilot's switch to the guided mode once standing by"
    )
    on_terminate: Literal["hold", "land", "return"] = Field("hold", description="what SIGTERM hands the vehicle to")
    battery_minimum: float = Field(0.25, ge=0.0, le=1.0, description="share of the charge below which it returns")
    reserve: ReserveSection | None = Field(
        None, description="returns by what it takes to come home from where it is, in place of battery_minimum"
    )
    operator_timeout_s: float | None = Field(
        None,
        ge=1.0,
        le=3600.0,
        description="without an order, `guidance ctl alive` or an operator's page in view for so long it holds; "
        "no sign of life asked if not given",
    )
    operator_return_s: float = Field(30.0, gt=0.0, le=3600.0, description="for so much longer: it returns")
    longest_chase_s: float | None = Field(
        None,
        gt=0.0,
        le=7200.0,
        description="of one chase with its pauses, then the autopilot's hold; unlimited if not given",
    )


class Preflight(Section):
    """What the autopilot has to be set to."""

    fence_required: bool = Field(True, description="whether the autopilot's own fence must stand behind ours")
    loss_time_limit_s: float = Field(
        1.5, gt=0.2, le=5.0, description="longest time that it may fly an old setpoint when ours stop"
    )
    origin_distance_limit_m: float = Field(
        1000.0, gt=0.0, description="farthest that its local frame's zero may be from home"
    )
    evader_height_limit_m: float = Field(30.0, gt=0.0, description="largest height of the evader above or below home")


class Control(Section):
    """Where orders come from: Zenoh queryables on loopback, or on a router that knows who may order by certificates."""

    endpoint: str = Field(
        "tcp/127.0.0.1:7448", description="Zenoh endpoint, on loopback; or a router's by TLS: docs/zenoh.md"
    )
    host: bool = Field(True, description="listen there; false connects to a Zenoh router that is there already")
    token_file: Path | None = Field(
        None, description="the secret that lets `guidance ctl` in; by default in the runtime folder, for its owner only"
    )

    @field_validator("endpoint")
    @classmethod
    def _check_loopback(cls, endpoint: str) -> str:
        if _LOOPBACK.fullmatch(endpoint) is None and _BY_TLS.fullmatch(endpoint) is None:
            raise ValueError(
                "must be on loopback, as tcp/127.0.0.1:7448, or a router by TLS, as tls/192.168.1.10:7447: who "
                "reaches it commands the vehicle"
            )
        return endpoint

    @property
    def by_tls(self) -> bool:
        """Whether orders come by a router that judges certificates."""
        return _BY_TLS.fullmatch(self.endpoint) is not None

    @model_validator(mode="after")
    def _check_host(self) -> Self:
        if self.by_tls and self.host:
            raise ValueError(
                f"control.endpoint = {self.endpoint!r}: a router of its own; control.host = false goes with it"
            )
        if self.by_tls and self.token_file is not None:
            raise ValueError(
                f"control.token_file = {str(self.token_file)!r}: not by TLS, where certificates say who we are"
            )
        return self


class LogSection(Section):
    """The log, on standard error."""

    format: Literal["console", "json"] = Field("console", description="lines for people, or a JSON object each")
    level: Literal["debug", "info", "warning", "error"] = Field("info", description="what is worth a line")


class MetricsSection(Section):
    """Prometheus, on loopback."""

    port: int | None = Field(None, ge=1, le=65535, description="of 127.0.0.1; none by default")


class RecordSection(Section):
    """The flight record."""

    folder: Path | None = Field(None, description="where each start begins an MCAP record; none by default")
    required: bool = Field(True, description="whether a record that cannot be written keeps the vehicle on the ground")
    rotate_s: float = Field(600.0, ge=10.0, description="a longer flight goes on in a next file")
    rotate_mb: float = Field(256.0, ge=1.0, description="so does a larger one")


class Config(Section):
    """A whole vehicle file."""

    name: str = Field(pattern=r"^[A-Za-z0-9_-]{1,32}$", description="of the vehicle, in orders, metrics and records")
    vehicle: Vehicle
    evader: EvaderSection
    game: GameSection
    limits: LimitsSection = LimitsSection()
    flight: FlightSection = FlightSection()
    preflight: Preflight = Preflight()
    control: Control = Control()
    zenoh: ZenohSection = ZenohSection()
    log: LogSection = LogSection()
    metrics: MetricsSection = MetricsSection()
    record: RecordSection = RecordSection()

    @property
    def speed_limits(self) -> Speeds:
        """What no command exceeds."""
        return self.limits.speeds(self.game.speeds, section="game")

    @model_validator(mode="after")
    def _check_together(self) -> Self:
        _ = self.speed_limits
        if self.control.by_tls and self.zenoh.tls_certificate_file is None:
            raise ValueError(
                f"control.endpoint = {self.control.endpoint!r}: needs zenoh.tls_certificate_file; without mutual TLS "
                "anybody could command the vehicle"
            )
        low, high = self.limits.floor_m, self.limits.ceiling_m
        if low <= self.flight.takeoff_height_m < low + _ABOVE_THE_FLOOR_M:
            raise ValueError(
                f"flight.takeoff_height_m = {self.flight.takeoff_height_m:g}: must be {_ABOVE_THE_FLOOR_M:g} m above "
                f"limits.floor_m = {low:g} at least: a vehicle sinks a little as the game begins"
            )
        for key, height_m in (
            ("flight.takeoff_height_m", self.flight.takeoff_height_m),
            ("game.standoff_height_m", self.game.standoff_height_m),
        ):
            if not low <= height_m <= high:
                raise ValueError(
                    f"{key} = {height_m:g}: allowed is limits.floor_m = {low:g} to limits.ceiling_m = {high:g}"
                )
        return self


def load_vehicle(path: Path) -> Config:
    """Read a vehicle file, and the plan that it names; relative names of both count from the vehicle file's folder.

    Raises:
        ConfigError: If either cannot be read or is wrong.
    """
    config = load(Config, path)
    config = config.model_copy(update={"zenoh": config.zenoh.beside(path.parent.absolute())})
    named = config.limits.fence_plan_file
    if named is None:
        return config
    document = config.model_dump(mode="json")
    corners = corners_deg(path.parent / named)
    document["limits"] |= {"fence_plan_file": None, "fence_polygon_deg": corners}
    return parse(Config, document, source=f"{path} with the fence of {named}")


def corners_deg(path: Path) -> list[tuple[float, float]]:
    """Read the one inclusion polygon of a plan: latitude and longitude of each corner.

    Raises:
        ConfigError: If the file is no plan, or its fence is anything but one inclusion polygon.
    """
    said = f"{_KEY} = {str(path)!r}"
    try:
        plan = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{said}: cannot be read ({error.strerror})") from error
    except ValueError as error:
        raise ConfigError(f"{said}: not JSON ({error})") from error
    fence = plan.get("geoFence") if isinstance(plan, dict) else None
    if not isinstance(fence, dict):
        raise ConfigError(f"{said}: has no geoFence; save it from QGroundControl's Plan view with a fence drawn")
    polygons, circles = (fence.get(key) or [] for key in ("polygons", "circles"))
    excluded = [one for one in polygons if not (isinstance(one, dict) and one.get("inclusion") is True)]
    if len(polygons) != 1 or excluded or circles:
        raise ConfigError(
            f"{said}: its fence has {len(polygons)} polygons ({len(excluded)} of them not for inclusion) and "
            f"{len(circles)} circles; exactly one inclusion polygon is wanted (a circle about home is "
            "limits.fence_radius_m)"
        )
    corners: Any = polygons[0].get("polygon")
    try:
        return [(float(latitude), float(longitude)) for latitude, longitude in corners]
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{said}: its polygon is no list of latitude and longitude ({error})") from error
