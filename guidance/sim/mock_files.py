"""Translates a flight for the mock: the fleet of all players, the faults and the wind.

Faults that count from the start form a script. Faults that count from engagement are added when the game begins.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from guidance.autopilots import autopilot_named
from guidance.errors import ConfigError
from guidance.sim.scenario import EVADER, PURSUER, Flown, Point2, pursuits_of
from sitl_mock.errors import ConfigError as MockConfigError
from sitl_mock.faults import Faulted, parse_script
from sitl_mock.serving.fleet import build, checked_fleet


def fleet(flight_scenario: Flown) -> dict[str, Any]:
    """Return the fleet: every pursuer on the ground near its start, with its speeds, and every evader at its start."""
    pursuits = pursuits_of(flight_scenario)
    site = pursuits[0].scenario.site
    vehicles = dict[str, dict[str, Any]]()
    for scenario, vehicle, evader in pursuits:
        autopilot = autopilot_named(scenario.pursuer.autopilot)
        speeds = scenario.pursuer.speeds
        rover = scenario.evader
        speed_parameters = autopilot.mock_speeds(speeds)
        vehicles[vehicle] = _parked(autopilot.mock, scenario.home_m, 0.0, speed_parameters)
        parameters = dict[str, float]()
        if rover.acceleration_m_s2 is not None:
            parameters["ATC_ACCEL_MAX"] = rover.acceleration_m_s2
        parked = _parked("rover", rover.position_m, -rover.height_m, parameters)
        vehicles.setdefault(evader, parked)
    home = {
        "lat_deg": site.latitude_deg,
        "lon_deg": site.longitude_deg,
        "alt_amsl_m": site.altitude_amsl_m,
    }
    seed = pursuits[0].scenario.seed
    tables = list[dict[str, Any]]()
    for number, (name, keys) in enumerate(vehicles.items(), start=1):
        # ready sooner than a real ArduCopter, which takes 39 s
        table = {"name": name, "system_id": number, **keys, "ready_after_s": 3.0}
        tables.append(table)
    return {"seed": seed, "home": home, "vehicle": tables}


def _parked(
    flavour: str, place_m: Point2, down_m: float, parameters: Mapping[str, float]
) -> dict[str, Any]:
    """Return the keys of a player that waits at a place; its autopilot has these parameters."""
    east_m, north_m = place_m
    return {
        "flavour": flavour,
        "start_ned_m": [north_m, east_m, down_m],
        "parameters": dict(parameters),
    }


def faults_after(flight_scenario: Flown, *events: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield vehicle and keys of every fault that counts from one of `events`: "start" and "engaged"."""
    for scenario, vehicle, evader in pursuits_of(flight_scenario):
        names = {PURSUER: vehicle, EVADER: evader}
        for fault in scenario.fault:
            if fault.after in events:
                keys = fault.model_dump(exclude={"vehicle", "after"}, exclude_none=True)
                yield names[fault.vehicle], keys


def script(flight_scenario: Flown, events: Sequence[str] = ("start",)) -> dict[str, Any]:
    """Return the fault script with the faults that count from one of `events`, and the wind."""
    faults = [
        {**keys, "vehicle": vehicle} for vehicle, keys in faults_after(flight_scenario, *events)
    ]
    for scenario, vehicle, _ in pursuits_of(flight_scenario):
        east, north = scenario.wind.velocity_m_s
        if east or north:
            wind = {
                "kind": "wind_gust",
                "north": north,
                "east": east,
                "for_s": 1e9,  # for the whole flight
                "vehicle": vehicle,
            }
            faults.append(wind)
    first = pursuits_of(flight_scenario)[0].scenario
    return {"seed": first.seed, "fault": faults}


def faulted_fleet(scenario: Flown) -> dict[str, Faulted]:
    """Make all vehicles, with the faults that count from the start.

    Raises:
        ConfigError: If a vehicle cannot have one of its faults: with the key, the value and the allowed values.
    """
    title = pursuits_of(scenario)[0].scenario.title
    faulted = dict[str, Faulted]()
    try:
        # Those that count from engagement are only checked
        for events in (
            ("start", "engaged"),
            ("start",),
        ):
            players = checked_fleet(fleet(scenario), title)
            vehicles = build(players, links={"onboard": "quiet"}, log_bytes=0)
            faults = parse_script(script(scenario, events), title)
            faulted = {name: Faulted(vehicle, name, faults) for name, vehicle in vehicles.items()}
    except MockConfigError as error:
        raise ConfigError(str(error)) from error
    return faulted
