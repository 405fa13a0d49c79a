"""Fleets: checked files and command-line arguments, and the vehicles built from them."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from sitl_mock.errors import ConfigError
from sitl_mock.flavours import flavour_named
from sitl_mock.installation import installed_versions, require_one_version
from sitl_mock.logs import LOG_BYTES
from sitl_mock.mavlink import Signing
from sitl_mock.tables import (
    REQUIRED,
    Option,
    choice,
    flag,
    integer,
    matching,
    number,
    numbers,
    place,
    read_toml,
    table,
)
from sitl_mock.tables import checked as checked_value
from sitl_mock.vehicle.link import TOPICS
from sitl_mock.vehicle.mock_vehicle import DEFAULT_LINKS, MockVehicle
from sitl_mock.versions import SPECS
from sitl_mock.world import DEFAULT_HOME, Home

_FOREVER_S: Final = 1e9
_MOST: Final = 255
_LOGS_BYTES: Final = 80 << 20
"""Most bytes of a fleet's flight logs: the whole limit of 20 vehicles."""


@dataclass(frozen=True)
class SigningConfig:
    """MAVLink 2 signing of a vehicle: its key, and whether unsigned frames are refused."""

    key_hex: str
    required: bool = True


@dataclass(frozen=True)
class VehicleConfig:
    """One vehicle; `MockVehicle` describes the keys."""

    name: str
    flavour: str = "px4"
    system_id: int | None = None
    start_ned_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    yaw_deg: float = 0.0
    noise: bool = True
    ready_after_s: float | None = None
    texts: bool | None = None
    origin: Home | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)
    signing: SigningConfig | None = None


@dataclass(frozen=True)
class FleetConfig:
    """A fleet."""

    vehicle: tuple[VehicleConfig, ...]
    seed: int = 0
    home: Home = DEFAULT_HOME


def _optional(check: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Also accept None (not given)."""
    return lambda value: None if value is None else check(value)


def _any(value: Any) -> Any:  # noqa: ANN401 - checked as a table of its own
    return value


_HOME: Final = {
    "lat_deg": Option("degrees", REQUIRED, number(-90.0, 90.0)),
    "lon_deg": Option("degrees", REQUIRED, number(-180.0, 180.0)),
    "alt_amsl_m": Option("metres above mean sea level", REQUIRED, number(-500.0, 9000.0)),
}
_SIGNING: Final = {
    "key_hex": Option("32 bytes", REQUIRED, matching("[0-9A-Fa-f]{64}", "64 hexadecimal digits")),
    "required": Option("whether unsigned frames are refused", True, flag),
}
_VEHICLE: Final = {
    "name": Option(
        "its name", REQUIRED, matching("[A-Za-z0-9_-]{1,32}", "1 to 32 letters, digits, - and _")
    ),
    "flavour": Option("its kind", "px4", choice(*SPECS)),
    "system_id": Option("MAVLink system id", None, _optional(integer(1, _MOST))),
    "start_ned_m": Option("metres north, east, down of home", (0.0, 0.0, 0.0), place),
    "yaw_deg": Option("degrees", 0.0, number(-360.0, 360.0)),
    "noise": Option("whether it has the real estimator's errors", True, flag),
    "ready_after_s": Option("seconds", None, _optional(number(0.0, _FOREVER_S))),
    "texts": Option("whether it sends STATUSTEXT", None, _optional(flag)),
    "origin": Option("of the local frame", None, _any),
    "parameters": Option("values by name", {}, numbers),
    "signing": Option("of all links", None, _any),
}
_FLEET: Final = {
    "seed": Option("of all randomness", 0, integer(0, 2**63)),
    "home": Option("where start_ned_m counts from", None, _any),
    "vehicle": Option("written as [[vehicle]]", REQUIRED, _any),
}


def read_fleet(path: Path) -> FleetConfig:
    """Read a fleet from a TOML file.

    Raises:
        ConfigError: The file cannot be read, or a key is unknown or wrong.
    """
    return checked_fleet(read_toml(path, "fleet file"), str(path))


def checked_fleet(values: object, source: str) -> FleetConfig:
    """Turn plain values into a fleet.

    Raises:
        ConfigError: A key is unknown or wrong; the message has the key, its value and the allowed ones.
    """
    document = table(values, _FLEET, source)
    entries = document["vehicle"]
    if not isinstance(entries, (list, tuple)) or not 1 <= len(entries) <= _MOST:
        raise ConfigError(
            f"{source}: vehicle = {entries!r}: allowed are 1 to {_MOST} tables, written as [[vehicle]]"
        )
    vehicles = []
    for index, entry in enumerate(entries):
        where = f"{source}: vehicle.{index}"
        keys = table(entry, _VEHICLE, where)
        origin = keys["origin"]
        if origin is not None:
            keys["origin"] = Home(**table(origin, _HOME, f"{where}.origin"))
        signing = keys["signing"]
        if signing is not None:
            keys["signing"] = SigningConfig(**table(signing, _SIGNING, f"{where}.signing"))
        vehicles.append(VehicleConfig(**keys))
    names = [vehicle.name for vehicle in vehicles]
    doubled = sorted({name for name in names if names.count(name) > 1})
    if doubled:
        raise ConfigError(
            f"{source}: vehicle.name = {doubled[0]!r} is given twice; every vehicle needs its own"
        )
    home = (
        DEFAULT_HOME
        if document["home"] is None
        else Home(**table(document["home"], _HOME, f"{source}: home"))
    )
    return FleetConfig(tuple(vehicles), document["seed"], home)


def parse_vehicles(specs: list[str], flavour: str) -> list[dict[str, object]]:
    """Read `--vehicles`: a number, flavours, or `flavour:name` and `flavour:name@north,east,down` for each vehicle.

    A flavour may have a version, as px4@1.18. Flavours without names stand between commas; they become uav1, uav2, ...

    Raises:
        ConfigError: A value has no such form.
    """
    if len(specs) == 1 and specs[0].isdigit():
        return [
            {"name": f"uav{number}", "flavour": flavour} for number in range(1, int(specs[0]) + 1)
        ]
    vehicles: list[dict[str, object]] = []
    for spec in specs:
        if set(spec.split(",")) <= set(SPECS):
            for kind in spec.split(","):
                vehicles.append({"name": f"uav{len(vehicles) + 1}", "flavour": kind})
            continue
        # Commas separate flavours, and the three numbers of a place, but not named vehicles.
        parts = re.split(r",(?=[^,:@]+:)", spec)
        if len(parts) > 1:
            raise ConfigError(
                f"--vehicles {spec}: named vehicles are given one by one: "
                + " ".join(f"--vehicles {part}" for part in parts)
            )
        kind, _, rest = spec.partition(":")
        name, _, start = rest.partition("@")
        if not name:
            raise ConfigError(
                f"--vehicles {spec}: allowed are a number, flavours such as px4,px4@1.18, or flavour:name such as "
                f"px4:uav1 or rover:evader@30,0,0; flavours are {', '.join(SPECS)}"
            )
        vehicle: dict[str, object] = {"name": name, "flavour": kind}
        if start:
            place: list[float | str] = []
            for part in start.split(","):
                try:
                    place.append(float(part))
                except ValueError:  # the key's check refuses a text
                    place.append(part)
            vehicle["start_ned_m"] = place
        vehicles.append(vehicle)
    return vehicles


def with_settings(
    config: FleetConfig, settings: Mapping[str, object], seed: int | None = None
) -> FleetConfig:
    """Return the fleet with keys of every vehicle and the seed replaced by command-line options."""
    values = {
        name: checked_value(f"--{name.replace('_', '-')}", value, _VEHICLE[name])
        for name, value in settings.items()
    }
    vehicles = tuple(replace(vehicle, **values) for vehicle in config.vehicle)
    return replace(config, vehicle=vehicles, seed=config.seed if seed is None else seed)


def with_zenoh(config: FleetConfig) -> FleetConfig:
    """Return the fleet with PX4's module `zenoh` in every PX4, as ZENOH_ENABLE says.

    Raises:
        ConfigError: There is no PX4, or two have the same ZENOH_DOMAIN_ID and so the same keys.
    """
    domains: dict[int, str] = {}
    vehicles = []
    for vehicle in config.vehicle:
        if flavour_named(vehicle.flavour).topics is None:
            vehicles.append(vehicle)
            continue
        domain = int(vehicle.parameters.get("ZENOH_DOMAIN_ID", 0))
        if domain in domains:
            raise ConfigError(
                f"--px4-zenoh: {domains[domain]} and {vehicle.name} have ZENOH_DOMAIN_ID = {domain}, so their topics "
                f"would be the same; give each its own: --param {vehicle.name}:ZENOH_DOMAIN_ID={domain + 1}"
            )
        domains[domain] = vehicle.name
        parameters = {**vehicle.parameters, "ZENOH_ENABLE": 1.0}
        vehicles.append(replace(vehicle, parameters=parameters))
    if not domains:
        raise ConfigError(
            "--px4-zenoh: there is no PX4 among the vehicles; add one: --vehicles px4"
        )
    return replace(config, vehicle=tuple(vehicles))


def with_parameters(config: FleetConfig, assignments: Sequence[str]) -> FleetConfig:
    """Return the fleet with the parameters of `--param`: `NAME=VALUE` for all vehicles, `vehicle:NAME=VALUE` for one.

    Raises:
        ConfigError: The form is wrong, the vehicle is not in the fleet, the value is not a number, or a vehicle has no
            such parameter.
    """
    vehicles = {vehicle.name: vehicle for vehicle in config.vehicle}
    for text in assignments:
        target, sign, number = text.partition("=")
        vehicle_name, _, name = (part.strip() for part in target.rpartition(":"))
        try:
            value = float(number)
        except ValueError:
            value = math.nan
        if not (sign and name and math.isfinite(value)):
            raise ConfigError(
                f"--param {text}: allowed is NAME=VALUE or vehicle:NAME=VALUE, as MPC_XY_VEL_MAX=8"
            )
        if vehicle_name and vehicle_name not in vehicles:
            raise ConfigError(
                f"--param {text}: there is no vehicle {vehicle_name!r}; allowed are {', '.join(vehicles)}"
            )
        chosen = [vehicle_name] if vehicle_name else list(vehicles)
        lacking = [
            each
            for each in chosen
            if all(item.name != name for item in flavour_named(vehicles[each].flavour).parameters)
        ]
        if lacking:
            flavour = vehicles[lacking[0]].flavour
            hint = f"`sitl-mock list parameters --flavour {flavour}` names them"
            others = [each for each in chosen if each not in lacking]
            if others:
                # In a fleet of several flavours each vehicle that has it is named.
                given = " ".join(f"--param {each}:{name}={number}" for each in others)
                hint = f"write {given}"
            raise ConfigError(
                f"--param {text}: {lacking[0]} is of flavour {flavour}, which has no such parameter; {hint}"
            )
        for vehicle in chosen:
            parameters = {**vehicles[vehicle].parameters, name: value}
            vehicles[vehicle] = replace(vehicles[vehicle], parameters=parameters)
    return replace(config, vehicle=tuple(vehicles.values()))


def build(
    config: FleetConfig,
    *,
    unix_us: int | None = None,
    links: Mapping[str, str] = DEFAULT_LINKS,
    log_bytes: int = _LOGS_BYTES,
) -> dict[str, MockVehicle]:
    """Make every vehicle of a fleet, each with its own seed.

    Vehicles without a system id get free ids in order. Given ids may be equal, as for ArduPilot's instances, because
    each vehicle has its own links.

    Args:
        config: The fleet.
        unix_us: Microseconds since 1970 at time 0 of the clock; None for a fixed date.
        links: Name of each link to its kind (see `MockVehicle`).
        log_bytes: Most bytes of the flight logs of all vehicles, equally divided; 0 for none.

    Raises:
        ConfigError: A vehicle has a parameter that its flavour lacks, or the mock is installed in two versions.
    """
    require_one_version(installed_versions())
    taken = {vehicle.system_id for vehicle in config.vehicle}
    free = iter([number for number in range(1, 256) if number not in taken])
    vehicles = {}
    for index, each in enumerate(config.vehicle):
        own_links = links
        if flavour_named(each.flavour).topics is None:
            own_links = {name: kind for name, kind in links.items() if kind != TOPICS}
        signing = None
        if each.signing is not None:
            key = bytes.fromhex(each.signing.key_hex)
            signing = Signing(key, require=each.signing.required)
        system_id = next(free) if each.system_id is None else each.system_id
        vehicles[each.name] = MockVehicle(
            each.flavour,
            system_id=system_id,
            home=config.home,
            start_ned=each.start_ned_m,
            yaw_deg=each.yaw_deg,
            seed=config.seed * 1000 + index,
            noise=each.noise,
            parameters=each.parameters,
            ready_after_s=each.ready_after_s,
            texts=each.texts,
            origin=each.origin,
            links=own_links,
            signing=signing,
            unix_us=unix_us,
            log_bytes=min(LOG_BYTES, log_bytes // len(config.vehicle)),
        )
    return vehicles
