"""From a fleet's configuration to its vehicles."""

from collections.abc import Mapping

from sitl_mock.config import FleetConfig, VehicleConfig
from sitl_mock.mavlink import Signing
from sitl_mock.vehicle import MockVehicle

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
