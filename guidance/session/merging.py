"""A scenario file and a vehicle file made one: the game of the one within the limits of the other.

The vehicle's file says how vehicle and evader are reached and what the flight may never do; the scenario what is
played, with which strategy, from where and for how long. Limits are the tighter of both. Where the files contradict
each other, nothing flies.
"""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from guidance.config import parse
from guidance.control import Speeds
from guidance.errors import ConfigError
from guidance.session.vehicle_file import Config
from guidance.sim.scenario import EVADER_ID, PURSUER, Scenario

if TYPE_CHECKING:
    from guidance.links.opening import Found


def merged(scenario: Scenario, config: Config) -> Config:
    """Return the vehicle's configuration with the scenario's game in it, and the tighter limits.

    Raises:
        ConfigError: If the two contradict each other: one line a contradiction, each with both keys and values.
    """
    contradictions = list(_contradictions(scenario, config))
    if contradictions:
        lines = "\n".join(f"  {line}" for line in contradictions)
        raise ConfigError(f"{scenario.title!r} cannot be flown by {config.name!r}:\n{lines}")
    pursuer, game, limits = scenario.pursuer, config.game, config.limits
    document = config.model_dump(mode="json")
    document["game"] = {
        **_game(scenario),
        "climb_m_s": min(pursuer.climb_m_s, game.climb_m_s),
        "descent_m_s": min(pursuer.descent_m_s, game.descent_m_s),
    }
    document["limits"] |= {
        **Speeds(*map(min, scenario.speed_limits, config.speed_limits))._asdict(),
        "floor_m": max(scenario.limits.floor_m, limits.floor_m),
        "ceiling_m": min(scenario.limits.ceiling_m, limits.ceiling_m),
        "fence_radius_m": _fence_m(scenario, config),
    }
    document["flight"] |= {
        "takeoff_height_m": pursuer.takeoff_height_m,
        "after_capture": "hold",
        "engage_on": "command",
    }
    return parse(Config, document, source=f"{scenario.title!r} on {config.name!r}")


def config_of(scenario: Scenario, *, url: str, link: str, autopilot: str, found: "Found", evader_url: str) -> Config:
    """Return the configuration that a vehicle's file would have been: the scenario's limits are the vehicle's own.

    Args:
        scenario: Who plays what, where and within which limits.
        url: Where the vehicle is.
        link: `mavsdk` or `pymavlink`.
        autopilot: Its name.
        found: The ids that it answered with.
        evader_url: Where the simulated evader reports.

    Raises:
        ConfigError: If the scenario asks for what no vehicle's file may.
    """
    vehicle = {"autopilot": autopilot, "link": link, "url": url}
    document = {
        "name": PURSUER,
        "vehicle": {**vehicle, "system_id": found.system_id, "component_id": found.component_id},
        "evader": {"kind": "global_position", "url": evader_url, "system_id": EVADER_ID},
        "game": _game(scenario),
        "limits": scenario.limits.model_dump(mode="json"),
        "flight": {"takeoff_height_m": scenario.pursuer.takeoff_height_m, "on_terminate": "land"},
        "log": {"level": "error"},
    }
    return parse(Config, document, source=f"{scenario.title!r} at {url}")


def _game(scenario: Scenario) -> dict[str, Any]:
    pursuer, disc = scenario.pursuer, scenario.standoff
    return {
        "speed_set": pursuer.speed_set,
        "speed_m_s": pursuer.speed_m_s,
        "climb_m_s": pursuer.climb_m_s,
        "descent_m_s": pursuer.descent_m_s,
        "evader_speed_m_s": scenario.evader.believed_speed_m_s,
        "standoff_radius_m": disc.radius_m,
        "standoff_height_m": disc.height_m - scenario.evader.height_m,
        "tolerance_m": disc.tolerance_m,
    }


def _contradictions(scenario: Scenario, config: Config) -> Iterator[str]:
    yield from _of_speeds(scenario, config)
    yield from _of_the_evader(scenario, config)
    yield from _of_places(scenario, config)


def _of_speeds(scenario: Scenario, config: Config) -> Iterator[str]:
    pursuer, given, game = scenario.pursuer, scenario.pursuer.model_fields_set, config.game
    if "autopilot" in given and pursuer.autopilot != config.vehicle.autopilot:
        yield f"pursuer.autopilot = {pursuer.autopilot!r}, but vehicle.autopilot = {config.vehicle.autopilot!r}"
    for key in ("speed_m_s", "climb_m_s", "descent_m_s"):
        asked, has = getattr(pursuer, key), getattr(game, key)
        if key in given and asked > has:
            yield f"pursuer.{key} = {asked:g} is more than game.{key} = {has:g}, which the vehicle is allowed"


def _of_the_evader(scenario: Scenario, config: Config) -> Iterator[str]:
    game = config.game
    believed_m_s = scenario.evader.believed_speed_m_s
    if believed_m_s < game.evader_speed_m_s:
        key = "speed_m_s" if scenario.evader.declared_speed_m_s is None else "declared_speed_m_s"
        yield (
            f"evader.{key} = {believed_m_s:g} is less than game.evader_speed_m_s = {game.evader_speed_m_s:g}, "
            "of which the evader is said to be capable"
        )
    above_m = scenario.standoff.height_m - scenario.evader.height_m
    for key, near_m, least_m in (
        ("radius_m", scenario.standoff.radius_m, game.standoff_radius_m),
        ("height_m", above_m, game.standoff_height_m),
    ):
        if near_m < least_m:
            yield f"standoff.{key} = {near_m:g} is nearer to the evader than game.standoff_{key} = {least_m:g}"


def _of_places(scenario: Scenario, config: Config) -> Iterator[str]:
    pursuer, limits = scenario.pursuer, config.limits
    low, high = limits.floor_m, limits.ceiling_m
    for key, height_m in (
        ("pursuer.position_m", pursuer.position_m[2]),
        ("pursuer.takeoff_height_m", pursuer.takeoff_height_m),
        ("standoff.height_m", scenario.standoff.height_m),
    ):
        if not low <= height_m <= high:
            yield f"{key}: height {height_m:g} m is not within limits.floor_m = {low:g} to limits.ceiling_m = {high:g}"
    fence_m, out_m = limits.fence_radius_m, math.hypot(*pursuer.position_m[:2])
    if fence_m is not None and "site" not in scenario.model_fields_set and out_m > fence_m:
        yield f"pursuer.position_m: {out_m:.0f} m out is beyond limits.fence_radius_m = {fence_m:g}"


def _fence_m(scenario: Scenario, config: Config) -> float:
    own_m = config.limits.fence_radius_m
    return scenario.limits.fence_radius_m if own_m is None else min(own_m, scenario.limits.fence_radius_m)
