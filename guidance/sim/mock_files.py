"""Translates a scenario for the mock: the fleet of two vehicles, the faults and the wind.

Faults that count from the start form a script. Faults that count from engagement are added when the game begins.
"""

import math
from collections.abc import Iterator
from typing import Any, Final

from guidance.autopilots import autopilot_named
from guidance.errors import ConfigError
from guidance.sim.scenario import EVADER, EVADER_ID, PURSUER, PURSUER_ID, Fault, Scenario
from sitl_mock.errors import ConfigError as MockConfigError
from sitl_mock.faults import Faulted, parse_script
from sitl_mock.fleet import build, checked

_WHOLE_FLIGHT_S: Final = 1e9

READY_AFTER_S: Final = 3.0
"""Shortened boot time of the mocks; a real ArduCopter takes 39 s."""


def fleet(scenario: Scenario) -> dict[str, Any]:
    """Return the fleet: the pursuer on the ground near its start, and the evader at its start.

    The pursuer's autopilot gets the vertical speeds of the scenario.
    """
    site, pursuer, evader = scenario.site, scenario.pursuer, scenario.evader
    home_x, home_y = scenario.home_m
    ex, ey = evader.position_m
    autopilot = autopilot_named(pursuer.autopilot)
    own = _vehicle(PURSUER, autopilot.mock, PURSUER_ID, (home_y, home_x, 0.0))
    if parameters := autopilot.mock_speeds(pursuer.speeds):
        own["parameters"] = dict(parameters)
    rover = _vehicle(EVADER, "rover", EVADER_ID, (ey, ex, -evader.height_m))
    if evader.acceleration_m_s2 is not None:
        rover["parameters"] = {"ATC_ACCEL_MAX": evader.acceleration_m_s2}
    return {
        "seed": scenario.seed,
        "home": {
            "lat_deg": site.latitude_deg,
            "lon_deg": site.longitude_deg,
            "alt_amsl_m": site.altitude_amsl_m,
        },
        "vehicle": [own, rover],
    }


def _vehicle(name: str, flavour: str, system_id: int, start_ned_m: tuple[float, float, float]) -> dict[str, Any]:
    return {
        "name": name,
        "flavour": flavour,
        "system_id": system_id,
        "start_ned_m": [float(part) for part in start_ned_m],
        "ready_after_s": READY_AFTER_S,
    }


def faults_after(scenario: Scenario, event: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield vehicle and keys of every fault that counts from `event`, "start" or "engaged"."""
    for fault in scenario.fault:
        if fault.after == event:
            yield fault.vehicle, _keys(fault)


def script(scenario: Scenario) -> dict[str, Any]:
    """Return the fault script with the faults that count from the start, and the wind."""
    faults = [{**keys, "vehicle": vehicle} for vehicle, keys in faults_after(scenario, "start")]
    east, north = scenario.wind.velocity_m_s
    if math.hypot(east, north) > 0.0:
        wind = {"kind": "wind_gust", "vehicle": PURSUER, "north": north, "east": east, "for_s": _WHOLE_FLIGHT_S}
        faults.append(wind)
    return {"seed": scenario.seed, "fault": faults}


def faulted_fleet(scenario: Scenario) -> dict[str, Faulted]:
    """Make both vehicles, with the faults that count from the start.

    Raises:
        ConfigError: If a vehicle cannot have one of its faults.
    """
    check_faults(scenario)
    vehicles = build(checked(fleet(scenario), scenario.title), links={"onboard": "quiet"})
    begun = parse_script(script(scenario), scenario.title)
    return {name: Faulted(vehicle, name, begun) for name, vehicle in vehicles.items()}


def check_faults(scenario: Scenario) -> None:
    """Refuse faults that a vehicle cannot have.

    Raises:
        ConfigError: With the key, the value and what is allowed.
    """
    if not scenario.fault:
        return
    everything = [{**_keys(fault), "vehicle": fault.vehicle} for fault in scenario.fault]
    try:
        parsed = parse_script({"seed": scenario.seed, "fault": everything}, scenario.title)
        for name, vehicle in build(checked(fleet(scenario), scenario.title)).items():
            Faulted(vehicle, name, parsed)
    except MockConfigError as error:
        raise ConfigError(str(error)) from error


def _keys(fault: Fault) -> dict[str, Any]:
    times = {"at_s": fault.at_s} | ({} if fault.for_s is None else {"for_s": fault.for_s})
    return {"kind": fault.kind, **times, **fault.keys()}
