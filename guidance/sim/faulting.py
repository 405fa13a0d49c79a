"""What goes wrong in a mocked flight, and the wind that blows in it: the scenario's faults in the mock's own words.

Faults that count from the start are a script, in place before the vehicles are switched on. Those that count from
engagement are put in place when the game begins: a rover, or an ArduCopter, is in its guided mode long before.
"""

import json
import math
import tomllib
from collections.abc import Iterator
from typing import Any, Final

from guidance.errors import ConfigError
from guidance.sim.fleet import PURSUER, fleet_toml
from guidance.sim.scenario import Fault, Scenario
from sitl_mock.errors import ConfigError as MockConfigError
from sitl_mock.faults import Faulted, parse_script
from sitl_mock.fleet import build, checked

_WHOLE_FLIGHT_S: Final = 1e9


def faults_after(scenario: Scenario, event: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield vehicle and keys of every fault whose time counts from `event`, "start" or "engaged"."""
    for fault in scenario.fault:
        if fault.after == event:
            yield fault.vehicle, _keys(fault)


def script(scenario: Scenario) -> dict[str, Any]:
    """Return the script of what counts from the start, and of the wind, as the mock reads it from a file."""
    faults = [{**keys, "vehicle": vehicle} for vehicle, keys in faults_after(scenario, "start")]
    east, north = scenario.wind.velocity_m_s
    if math.hypot(east, north) > 0.0:
        wind = {"kind": "wind_gust", "vehicle": PURSUER, "north": north, "east": east, "for_s": _WHOLE_FLIGHT_S}
        faults.append(wind)
    return {"seed": scenario.seed, "fault": faults}


def script_toml(scenario: Scenario) -> str:
    """Return the script as a file's text."""
    lines = [f"seed = {scenario.seed}"]
    for fault in script(scenario)["fault"]:
        lines += ["[[fault]]", *(f"{json.dumps(key)} = {json.dumps(value)}" for key, value in fault.items())]
    return "\n".join(lines) + "\n"


def faulted_fleet(scenario: Scenario) -> dict[str, Faulted]:
    """Make both vehicles with the faults that count from the start.

    Raises:
        ConfigError: If a fault is none that its vehicle can have, whenever it is due: with key, value and allowed.
    """
    check_faults(scenario)
    vehicles = build(checked(tomllib.loads(fleet_toml(scenario)), scenario.title))
    begun = parse_script(script(scenario), scenario.title)
    return {name: Faulted(vehicle, name, begun) for name, vehicle in vehicles.items()}


def check_faults(scenario: Scenario) -> None:
    """Refuse a fault that its vehicle cannot have, before anything is started.

    Raises:
        ConfigError: With key, value and what is allowed.
    """
    if not scenario.fault:
        return
    everything = [{**_keys(fault), "vehicle": fault.vehicle} for fault in scenario.fault]
    try:
        parsed = parse_script({"seed": scenario.seed, "fault": everything}, scenario.title)
        for name, vehicle in build(checked(tomllib.loads(fleet_toml(scenario)), scenario.title)).items():
            Faulted(vehicle, name, parsed)
    except MockConfigError as error:
        raise ConfigError(str(error)) from error


def _keys(fault: Fault) -> dict[str, Any]:
    times = {"at_s": fault.at_s} | ({} if fault.for_s is None else {"for_s": fault.for_s})
    return {"kind": fault.kind, **times, **fault.keys()}
