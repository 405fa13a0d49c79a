"""The flight plan: made from a vehicle file, a scenario file, or a scenario on top of a vehicle file.

The vehicle file has links and limits. The scenario is an overlay with the game, the places and the duration. The
tighter limit of both applies. If the files contradict each other, nothing flies. A scenario alone becomes a vehicle
file with the scenario's own limits.
"""

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from guidance.autopilots import Wants, autopilot_named
from guidance.config import parse
from guidance.control import Speeds
from guidance.cycle import CycleSettings
from guidance.errors import ConfigError
from guidance.flight import FlightSettings, State
from guidance.flight.settings import LIMITS_S, FlightSection
from guidance.frames import Amsl
from guidance.game import Ball, Cylinder, Game, StandOff
from guidance.game.extent import POINT
from guidance.session.vehicle_file import Config, EvaderSection, GameSection, LogSection, Vehicle
from guidance.strategies import Strategy

if TYPE_CHECKING:
    from guidance.sim.scenario import Scenario

SIMULATED_URL: Final = "udpin://127.0.0.1:14541"
"""The URL of a simulated evader, and of a mock, in their vehicle file. Nothing opens it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightPlan:
    """Everything that defines a flight. It may be replaced on the ground.

    Attributes:
        flight: Settings of the flight.
        wants: What preflight demands of the autopilot; None for a mock, which is not judged.
        document: The configuration as JSON.
    """

    flight: FlightSettings
    wants: Wants | None = None
    document: str = ""


def plan_of(
    config: Config | None = None, scenario: "Scenario | None" = None, team: str | None = None
) -> FlightPlan:
    """Return the plan of a vehicle file, a scenario, or both.

    A scenario alone is flown by a mock: preflight does not judge it, and the flight fails if the mock does not become
    ready. With a scenario, the game frame's zero is the scenario's site. If the scenario names no site, it is the
    origin of the vehicle's local frame, so the scenario can be flown anywhere.

    Args:
        config: The vehicle file.
        scenario: The scenario.
        team: JSON of a scenario's team: the separation, `team`, and the speeds of the evaders by name, `evaders`.

    Raises:
        ConfigError: If the files contradict themselves or each other, or both are missing.
    """
    mates = {} if team is None else json.loads(team)
    if config is None:
        if scenario is None:
            raise ConfigError("neither a vehicle file nor a scenario: give at least one")
        config = _as_vehicle_file(
            scenario, Vehicle(autopilot=scenario.pursuer.autopilot, url=SIMULATED_URL)
        )
        return FlightPlan(
            flight=_settings(config, scenario, mates, mocked=True),
            document=scenario.model_dump_json(),
        )
    config = config if scenario is None else merged(scenario, config)
    settings = _settings(config, scenario, mates, mocked=False)
    reserve = config.flight.reserve
    needed = (
        None if reserve is None else reserve.needed(settings.farthest_m, settings.takeoff_height_m)
    )
    wants = Wants(config.preflight, config.limits, config.game.speeds, config.speed_limits, needed)
    return FlightPlan(flight=settings, wants=wants, document=config.model_dump_json())


def _settings(
    config: Config, scenario: "Scenario | None", mates: Mapping[str, Any], *, mocked: bool
) -> FlightSettings:
    autopilot = autopilot_named(config.vehicle.autopilot)
    own = config.game
    target = config.game.target
    handling = autopilot.handling
    standoff = StandOff(own.standoff_radius_m, own.standoff_height_m)
    speeds = Ball(own.speed_m_s) if own.speed_set == "ball" else Cylinder(*own.speeds)
    strategy = Strategy(own.policy, gain=own.navigation_gain)
    start_game_m = None
    target_game_m = None
    extent = POINT if target is None else target.extent
    site = None
    if scenario is not None:
        from guidance.sim import batch  # noqa: PLC0415 - a vehicle without a scenario needs no simulator

        x, y, z = scenario.pursuer.position_m
        start_game_m = (x, y, z - scenario.evader.height_m)
        target_game_m = batch.target_game_m(scenario)
        extent = batch.target_extent(scenario)
        strategy = batch.strategy_of(
            scenario, "pursuer", np.array(start_game_m), speeds, scenario.seed
        )
        site = batch.site(scenario) if mocked or "site" in scenario.model_fields_set else None
    elif target is not None:
        # The game frame's zero is the target; only height differences matter
        target_game_m = (
            0.0,
            0.0,
            0.0,
        )
        site = target.latitude_deg, target.longitude_deg, Amsl(target.altitude_amsl_m)
    # With a person a flight may take any time to begin.
    unlimited = () if mocked else (State.CONNECTING, State.CHECKING)
    moves_m_s = own.target_velocity_m_s
    declared_m_s = {} if config.team is None else {config.team.evader: own.evader_speed_m_s}
    declared_m_s |= (
        {}
        if config.team is None
        else {name: one.speed_m_s for name, one in config.team.evaders.items()}
    )
    cycle = CycleSettings(
        Game(
            speeds,
            own.evader_speed_m_s,
            standoff=standoff,
            target_velocity_m_s=moves_m_s,
            target_extent=extent,
        ),
        strategy,
        tolerance_m=own.tolerance_m,
        envelope=config.limits.envelope(config.speed_limits, handling.dynamics, standoff),
        handling=handling,
        target_game_m=target_game_m,
        site=site,
        evader_timeout_s=config.evader.timeout_s,
    )
    return FlightSettings(
        **dict(config.flight),
        **{"team": config.team, "evaders": declared_m_s, **mates},
        autopilot=autopilot,
        cycle=cycle,
        limits=config.limits,
        start_game_m=start_game_m,
        hold_on_rival=config.evader.second_source == "hold",
        limits_s={state: limit_s for state, limit_s in LIMITS_S.items() if state not in unlimited},
    )


def merged(scenario: "Scenario", config: Config) -> Config:
    """Return the vehicle file with the scenario's game and the tighter limits.

    Raises:
        ConfigError: If the two contradict each other. The message has one line for each contradiction, with both keys.
    """
    if contradictions := [*_players(scenario, config), *_places(scenario, config)]:
        lines = "\n".join(f"  {line}" for line in contradictions)
        raise ConfigError(f"{scenario.title!r} cannot be flown by {config.name!r}:\n{lines}")
    slower = Speeds(
        *(min(both) for both in zip(scenario.pursuer.speeds, config.game.speeds, strict=True))
    )
    own, theirs = (
        one.limits.model_copy(update=one.speed_limits._asdict()) for one in (config, scenario)
    )
    document = config.model_dump(mode="json")
    document["game"] = _game(scenario) | slower._asdict()
    document["limits"] = own.tighter(theirs).model_dump(mode="json")
    up = {"takeoff_height_m": scenario.pursuer.takeoff_height_m}
    document["flight"] |= {**up, "after_capture": "hold", "engage_on": "command"}
    return parse(Config, document, source=f"{scenario.title!r} on {config.name!r}")


def config_of(
    scenario: "Scenario", name: str, vehicle: Vehicle, team: Mapping[str, Any] | None = None
) -> Config:
    """Return the vehicle file that flies a scenario with the scenario's own limits.

    Args:
        scenario: Who plays what, where and within which limits.
        name: Of the vehicle.
        vehicle: Where it is.
        team: The section `[team]`.

    Raises:
        ConfigError: If the scenario asks for what no vehicle file may.
    """
    document = _as_vehicle_file(scenario, vehicle).model_dump(mode="json")
    return parse(
        Config,
        document | {"name": name, "team": team},
        source=f"{scenario.title!r} at {vehicle.url}",
    )


def _as_vehicle_file(scenario: "Scenario", vehicle: Vehicle) -> Config:
    """Return a vehicle file without its checks, which demand more than a mock needs."""
    from guidance.sim.scenario import EVADER_ID, PURSUER  # noqa: PLC0415 - as above

    return Config.model_construct(
        name=PURSUER,
        vehicle=vehicle,
        evader=EvaderSection(kind="global_position", url=SIMULATED_URL, system_id=EVADER_ID),
        game=GameSection.model_construct(**_game(scenario)),
        limits=scenario.limits,
        flight=FlightSection(
            takeoff_height_m=scenario.pursuer.takeoff_height_m, on_terminate="land"
        ),
        log=LogSection(level="error"),
    )


def _game(scenario: "Scenario") -> dict[str, Any]:
    pursuer = scenario.pursuer
    disc = scenario.standoff
    return {
        "speed_set": pursuer.speed_set,
        **pursuer.speeds._asdict(),
        "evader_speed_m_s": scenario.evader.believed_speed_m_s,
        "standoff_radius_m": disc.radius_m,
        "standoff_height_m": disc.height_m - scenario.evader.height_m,
        "tolerance_m": disc.tolerance_m,
    }


def _players(scenario: "Scenario", config: Config) -> Iterator[str]:
    pursuer = scenario.pursuer
    evader = scenario.evader
    disc = scenario.standoff
    game = config.game
    given = pursuer.model_fields_set
    if "autopilot" in given and pursuer.autopilot != config.vehicle.autopilot:
        yield f"pursuer.autopilot = {pursuer.autopilot!r}, but vehicle.autopilot = {config.vehicle.autopilot!r}"
    for key, speed_m_s in pursuer.speeds._asdict().items():
        if key in given and speed_m_s > (limit_m_s := getattr(game, key)):
            yield f"pursuer.{key} = {speed_m_s:g} is more than the vehicle's game.{key} = {limit_m_s:g}"
    declared_m_s = evader.believed_speed_m_s
    least_m_s = game.evader_speed_m_s
    if declared_m_s < least_m_s:
        key = "speed_m_s" if evader.declared_speed_m_s is None else "declared_speed_m_s"
        less = f"is less than game.evader_speed_m_s = {least_m_s:g}, the speed that the evader may reach"
        yield f"evader.{key} = {declared_m_s:g} {less}"
    above_m = disc.height_m - evader.height_m
    nearest = (
        ("radius_m", disc.radius_m, game.standoff_radius_m),
        ("height_m", above_m, game.standoff_height_m),
    )
    for key, near_m, least_m in nearest:
        if near_m < least_m:
            yield f"standoff.{key} = {near_m:g} is nearer to the evader than game.standoff_{key} = {least_m:g}"


def _places(scenario: "Scenario", config: Config) -> Iterator[str]:
    pursuer = scenario.pursuer
    limits = config.limits
    low = limits.floor_m
    high = limits.ceiling_m
    heights_m = {
        "pursuer.position_m": pursuer.position_m[2],
        "pursuer.takeoff_height_m": pursuer.takeoff_height_m,
        "standoff.height_m": scenario.standoff.height_m,
    }
    for key, height_m in heights_m.items():
        if not low <= height_m <= high:
            yield f"{key}: height {height_m:g} m is not within limits.floor_m = {low:g} to limits.ceiling_m = {high:g}"
    fence_m = limits.fence_radius_m
    out_m = math.hypot(*pursuer.position_m[:2])
    if fence_m is not None and "site" not in scenario.model_fields_set and out_m > fence_m:
        yield f"pursuer.position_m: {out_m:.0f} m out is beyond limits.fence_radius_m = {fence_m:g}"
