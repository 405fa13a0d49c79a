"""A fleet: its file and its arguments, checked, and the vehicles made of them."""

import math
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from sitl_mock.errors import ConfigError
from sitl_mock.mavlink import Signing
from sitl_mock.vehicle import MockVehicle
from sitl_mock.world import DEFAULT_HOME, Home

FlavourName = Literal["px4", "arducopter", "rover"]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,32}$")]


class HomeConfig(BaseModel):
    """A place on Earth."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    lat_deg: float = Field(ge=-90.0, le=90.0)
    lon_deg: float = Field(ge=-180.0, le=180.0)
    alt_amsl_m: float = Field(ge=-500.0, le=9000.0)

    def place(self) -> Home:
        """The same as a value."""
        return Home(self.lat_deg, self.lon_deg, self.alt_amsl_m)


_DEFAULT_HOME = HomeConfig(
    lat_deg=DEFAULT_HOME.lat_deg, lon_deg=DEFAULT_HOME.lon_deg, alt_amsl_m=DEFAULT_HOME.alt_amsl_m
)


class SigningConfig(BaseModel):
    """MAVLink 2 signing of a vehicle: its key, and whether unsigned frames are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    key_hex: str = Field(pattern=r"^[0-9A-Fa-f]{64}$")
    required: bool = True


class VehicleConfig(BaseModel):
    """One vehicle; see `MockVehicle` for what the keys mean."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: Name
    flavour: FlavourName = "px4"
    system_id: int | None = Field(default=None, ge=1, le=255)
    start_ned_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    yaw_deg: float = Field(default=0.0, ge=-360.0, le=360.0)
    noise: bool = True
    ready_after_s: float | None = Field(default=None, ge=0.0)
    texts: bool | None = None
    origin: HomeConfig | None = None
    parameters: dict[str, float] = Field(default_factory=dict)
    signing: SigningConfig | None = None


class FleetConfig(BaseModel):
    """A fleet."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    seed: int = Field(default=0, ge=0)
    home: HomeConfig = _DEFAULT_HOME
    vehicle: tuple[VehicleConfig, ...] = Field(min_length=1, max_length=255)

    @model_validator(mode="after")
    def _different(self) -> "FleetConfig":
        names = [each.name for each in self.vehicle]
        doubled = sorted({name for name in names if names.count(name) > 1})
        if doubled:
            raise ValueError(f"vehicle.name = {doubled[0]!r} is given twice; every vehicle needs its own")
        return self


def read_fleet(path: Path) -> FleetConfig:
    """Read a fleet from a TOML file.

    Raises:
        ConfigError: The file cannot be read, or a key is unknown or wrong.
    """
    try:
        return checked(tomllib.loads(path.read_text(encoding="utf-8")), str(path))
    except OSError as error:
        raise ConfigError(f"fleet file {path}: {error.strerror}") from None
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"fleet file {path}: {error}") from None


def checked(values: object, source: str) -> FleetConfig:
    """Turn plain values into a fleet.

    Raises:
        ConfigError: A key is unknown or wrong; the message names it, its value and what is allowed.
    """
    try:
        return FleetConfig.model_validate(values)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"]) or "fleet"
        raise ConfigError(f"{source}: {key} = {first['input']!r}: {first['msg']}") from None


def parse_vehicles(specs: list[str], flavour: str) -> list[dict[str, object]]:
    """Read `--vehicles`: a number, or `flavour:name` and `flavour:name@north,east,down` for each vehicle.

    Raises:
        ConfigError: A value is neither.
    """
    if len(specs) == 1 and specs[0].isdigit():
        return [{"name": f"uav{number}", "flavour": flavour} for number in range(1, int(specs[0]) + 1)]
    vehicles: list[dict[str, object]] = []
    for spec in specs:
        kind, _, rest = spec.partition(":")
        name, _, place = rest.partition("@")
        if not name:
            raise ConfigError(
                f"--vehicles {spec}: allowed are a number, or flavour:name such as px4:uav1 or rover:evader@30,0,0"
            )
        vehicle: dict[str, object] = {"name": name, "flavour": kind}
        if place:
            vehicle["start_ned_m"] = place.split(",")
        vehicles.append(vehicle)
    return vehicles


def with_settings(config: FleetConfig, settings: Mapping[str, object], seed: int | None = None) -> FleetConfig:
    """The same fleet with some keys of every vehicle, and the seed, as the command line has them."""
    plain = config.model_dump(exclude_none=True)
    vehicles = [{**each, **settings} for each in plain["vehicle"]]
    return checked({**plain, **({} if seed is None else {"seed": seed}), "vehicle": vehicles}, "the command line")


def with_parameters(config: FleetConfig, assignments: Sequence[str]) -> FleetConfig:
    """The same fleet with parameters of `--param`: `NAME=VALUE` for every vehicle, `vehicle:NAME=VALUE` for one.

    Raises:
        ConfigError: It is neither, the vehicle is not in the fleet, or the value is no number.
    """
    vehicles = {each.name: each for each in config.vehicle}
    for text in assignments:
        where, name, value = _assignment(text)
        if where and where not in vehicles:
            raise ConfigError(f"--param {text}: there is no vehicle {where!r}; allowed are {', '.join(vehicles)}")
        for each in [where] if where else list(vehicles):
            parameters = {**vehicles[each].parameters, name: value}
            vehicles[each] = vehicles[each].model_copy(update={"parameters": parameters})
    return config.model_copy(update={"vehicle": tuple(vehicles.values())})


def _assignment(text: str) -> tuple[str, str, float]:
    """Vehicle ("" for all), name and value of a `--param`."""
    target, sign, value = text.partition("=")
    vehicle, _, name = target.rpartition(":")
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not (sign and name and math.isfinite(number)):
        raise ConfigError(f"--param {text}: allowed is NAME=VALUE or vehicle:NAME=VALUE, as MPC_XY_VEL_MAX=8")
    return vehicle.strip(), name.strip(), number


FLEET_LINKS: Mapping[str, str] = {"onboard": "onboard", "gcs": "gcs"}


def build(config: FleetConfig, *, unix_us: int | None = None, ground_link: bool = False) -> dict[str, MockVehicle]:
    """Make every vehicle of a fleet, each with its own seed.

    Vehicles without a system id get the free ones in order; ids that are given may be equal, as those of ArduPilot's
    instances are, for vehicles are told apart by their links.

    Args:
        config: The fleet.
        unix_us: Microseconds since 1970 at time 0 of the clock, None for a fixed date.
        ground_link: Give each vehicle a link with a ground station's rates as well.

    Raises:
        ConfigError: A vehicle's parameters are not those of its flavour.
    """
    ids = _system_ids(config)
    return {
        each.name: _vehicle(config, each, ids[each.name], index, unix_us, ground_link=ground_link)
        for index, each in enumerate(config.vehicle)
    }


def _system_ids(config: FleetConfig) -> dict[str, int]:
    given = {each.system_id for each in config.vehicle}
    free = iter([number for number in range(1, 256) if number not in given])
    return {each.name: each.system_id or next(free) for each in config.vehicle}


def _vehicle(
    config: FleetConfig, each: VehicleConfig, system_id: int, index: int, unix_us: int | None, *, ground_link: bool
) -> MockVehicle:
    return MockVehicle(
        each.flavour,
        system_id=system_id,
        home=config.home.place(),
        start_ned=each.start_ned_m,
        yaw_deg=each.yaw_deg,
        seed=config.seed * 1000 + index,
        noise=each.noise,
        parameters=each.parameters,
        ready_after_s=each.ready_after_s,
        texts=each.texts,
        origin=each.origin.place() if each.origin else None,
        links=FLEET_LINKS if ground_link else None,
        signing=Signing(bytes.fromhex(each.signing.key_hex), require=each.signing.required) if each.signing else None,
        unix_us=unix_us,
    )
