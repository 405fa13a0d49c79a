"""The flight plan: made from a vehicle file, a scenario file, or a scenario on top of a vehicle file.

The vehicle file has links and limits. The scenario is an overlay with the game, the places and the duration. The
tighter limit of both applies. If the files contradict each other, nothing flies. A scenario alone becomes a vehicle
file with the scenario's own limits.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from guidance.autopilots import Autopilot, Wants, autopilot_named
from guidance.config import Section, parse_document
from guidance.control import Limits, Speeds
from guidance.cycle import CycleSettings
from guidance.errors import ConfigError
from guidance.flight import FlightSettings, State
from guidance.flight.settings import LIMITS_S, FlightSection, TeamSection
from guidance.frames import Amsl, Enu, Place
from guidance.game.arrays import FLOATS
from guidance.game.extent import POINT
from guidance.game.game import NO_WIND
from guidance.game.rules import Rules, game_by
from guidance.game.speed_sets import SpeedSet
from guidance.links.evaders.section import EvaderSection
from guidance.links.section import Vehicle
from guidance.session.vehicle_file import Config
from guidance.strategies import Strategy

if TYPE_CHECKING:
    from guidance.sim.scenario import Scenario

SIMULATED_URL: Final = "udpin://127.0.0.1:14541"
"""The URL of a simulated evader in a vehicle file. Nothing opens it."""


class TeamPlan(Section):
    """The team of a scenario, which all its vehicles share. A record keeps it as JSON.

    Attributes:
        team: How far the vehicles stay from each other.
        evaders: Declared speeds of all evaders by name, m/s.
    """

    team: TeamSection
    evaders: dict[str, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightPlan:
    """Everything that defines a flight. It may be replaced on the ground.

    Attributes:
        flight: Settings of the flight.
        wants: Preflight's demands on the autopilot; None for a mock, which is not judged.
        document: The configuration as JSON.
    """

    flight: FlightSettings
    wants: Wants | None = None
    document: str = ""


def plan_of(
    config: Config | None = None,
    scenario: "Scenario | None" = None,
    team: TeamPlan | None = None,
) -> FlightPlan:
    """Return the plan of a vehicle file, a scenario, or both.

    A scenario alone is flown by a mock: preflight does not judge it, and the flight fails if the mock does not become
    ready. With a scenario, the game frame's zero is the scenario's site. If the scenario names no site, it is the
    origin of the vehicle's local frame, so the scenario can be flown anywhere.

    Args:
        config: The vehicle file.
        scenario: The scenario.
        team: The scenario's team; None if it has none.

    Raises:
        ConfigError: If the files contradict themselves or each other, both are missing, or the game asks for speeds
            that the vehicle does not fly.
    """
    if config is not None and scenario is not None:
        config = merged(scenario, config)
    terms = _terms(config, scenario)
    _require_flown(terms)
    flight = _settings(terms, team)
    if config is None:
        document = "" if scenario is None else scenario.model_dump_json()
        return FlightPlan(flight=flight, document=document)
    reserve = config.flight.reserve
    needed = None
    if reserve is not None:
        needed = reserve.needed(flight.farthest_m, flight.takeoff_height_m)
    wants = Wants(
        config.preflight,
        config.limits,
        config.game.speeds,
        config.speed_limits,
        needed,
        config.evader_height_limit_m,
        config.vehicle.announce,
        config.game.evader_speed_m_s,
        config.game.standoff_radius_m,
    )
    return FlightPlan(flight=flight, wants=wants, document=config.model_dump_json())


def settings_of(
    config: Config | None, scenario: "Scenario | None", team: TeamPlan | None
) -> FlightSettings:
    """Return the settings of a flight that was flown already, as recorded; arguments as of `plan_of`.

    Raises:
        ConfigError: If the files contradict themselves or each other, or both are missing.
    """
    if config is not None and scenario is not None:
        config = merged(scenario, config)
    return _settings(_terms(config, scenario), team)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Terms:
    """Settings of a flight, the same for files of any kind.

    Attributes:
        source: Section of the pursuer's speeds.
        autopilot: Of the vehicle.
        rules: The game, with the declared speed of the evader and capture on the stand-off disc.
        policy: Of the pursuer.
        tolerance_m: Distance from the disc that counts as captured.
        target_game_m: The evader's target; None in PE.
        site: Zero of the game frame; None for home.
        start_game_m: Where the vehicle stands by; None above the take-off.
        limits: The limits.
        speed_limits: Speeds of every command.
        flight: The section of the flight.
        evader_timeout_s: The evader is lost after so long without a report.
        hold_on_rival: Whether a second source of the evader holds the vehicle.
        unlimited: States that may last as long as they like.
        team: Separation from mates; None without a team.
        evaders: Declared speeds of evaders by name, m/s.
        evader_height_limit_m: Greatest height of the evader above or below home's ground; None without a limit.
    """

    source: str
    autopilot: Autopilot
    rules: Rules
    policy: Strategy
    tolerance_m: float
    target_game_m: Enu | None
    site: Place | None
    start_game_m: Enu | None
    limits: Limits
    speed_limits: Speeds
    flight: FlightSection
    evader_timeout_s: float
    hold_on_rival: bool
    unlimited: frozenset[State]
    team: TeamSection | None
    evaders: Mapping[str, float]
    evader_height_limit_m: float | None


class _ScenarioGame(NamedTuple):
    """A scenario's part of a flight: policy, start and target of the game."""

    policy: Strategy
    start_game_m: Enu
    target_game_m: Enu | None


_WITH_A_PERSON: Final = frozenset({State.CONNECTING, State.CHECKING})
"""With a person a flight may take any time to begin."""


def _terms(config: Config | None, scenario: "Scenario | None") -> _Terms:
    if config is None:
        if scenario is None:
            raise ConfigError("neither a vehicle file nor a scenario: give at least one")
        from guidance.sim import batch  # noqa: PLC0415 - a vehicle without a scenario needs no simulator
        from guidance.sim.scenario import EVADER_ID  # noqa: PLC0415

        rules = batch.true_rules([scenario.as_flown()])._replace(
            evader_speed_m_s=scenario.evader.believed_speed_m_s, capture_radius_m=0.0
        )
        game = _scenario_game(scenario, rules.pursuer)
        takeoff_height_m = scenario.pursuer.takeoff_height_m
        evader = EvaderSection(kind="global_position", url=SIMULATED_URL, system_id=EVADER_ID)
        return _Terms(
            source="pursuer",
            autopilot=autopilot_named(scenario.pursuer.autopilot),
            rules=rules,
            policy=game.policy,
            tolerance_m=scenario.standoff.tolerance_m,
            target_game_m=game.target_game_m,
            site=batch.site(scenario),
            start_game_m=game.start_game_m,
            limits=scenario.limits,
            speed_limits=scenario.speed_limits,
            flight=FlightSection(takeoff_height_m=takeoff_height_m, on_terminate="land"),
            evader_timeout_s=evader.timeout_s,
            hold_on_rival=evader.second_source == "hold",
            unlimited=frozenset(),
            team=None,
            evaders={},
            evader_height_limit_m=None,
        )
    return _by_file(config) if scenario is None else _by_both(config, scenario)


def _by_file(config: Config) -> _Terms:
    """Return the terms of a vehicle file."""
    game = config.game
    target = game.target
    target_game_m = None
    site = None
    extent = POINT
    if target is not None:
        # The game frame's zero is the target; only height differences matter
        target_game_m = Enu((0.0, 0.0, 0.0))
        site = target.latitude_deg, target.longitude_deg, Amsl(target.altitude_amsl_m)
        extent = target.extent
    evaders = {}
    if config.team is not None:
        evaders[config.team.evader] = game.evader_speed_m_s
        for name, evader in config.team.evaders.items():
            evaders[name] = evader.speed_m_s
    return _Terms(
        source="game",
        autopilot=config.vehicle.profile,
        rules=Rules(
            speed_set=game.speed_set,
            speeds_m_s=game.speeds,
            evader_speed_m_s=game.evader_speed_m_s,
            capture_radius_m=0.0,
            standoff_radius_m=game.standoff_radius_m,
            standoff_height_m=game.standoff_height_m,
            wind_m_s=NO_WIND,
            target_velocity_m_s=game.target_velocity_m_s,
            target_extent=extent,
        ),
        policy=Strategy(game.policy, gain=game.navigation_gain),
        tolerance_m=game.tolerance_m,
        target_game_m=target_game_m,
        site=site,
        start_game_m=None,
        limits=config.limits,
        speed_limits=config.speed_limits,
        flight=config.flight,
        evader_timeout_s=config.evader.timeout_s,
        hold_on_rival=config.evader.second_source == "hold",
        unlimited=_WITH_A_PERSON,
        team=config.team,
        evaders=evaders,
        evader_height_limit_m=config.evader_height_limit_m,
    )


def _by_both(config: Config, scenario: "Scenario") -> _Terms:
    """Return the terms of a vehicle file that has a scenario's game already, see `merged`."""
    from guidance.sim import batch  # noqa: PLC0415 - as above

    terms = _by_file(config)
    rules = terms.rules._replace(target_extent=batch.target_extent(scenario))
    game = _scenario_game(scenario, rules.pursuer)
    return replace(
        terms,
        rules=rules,
        policy=game.policy,
        target_game_m=game.target_game_m,
        site=batch.site(scenario) if "site" in scenario.model_fields_set else None,
        start_game_m=game.start_game_m,
    )


def _scenario_game(scenario: "Scenario", pursuer: SpeedSet) -> _ScenarioGame:
    from guidance.sim import batch  # noqa: PLC0415 - as above

    x, y, z = scenario.pursuer.position_m
    start_game_m = Enu((x, y, z - scenario.evader.height_m))
    start = np.array(start_game_m)
    policy = batch.policy_for(scenario, "pursuer", start, pursuer, scenario.seed)
    return _ScenarioGame(policy, start_game_m, batch.target_game_m(scenario))


def _require_flown(terms: _Terms) -> None:
    """Refuse a game that its speed set cannot play, or whose pursuer climbs or descends faster than the vehicle."""
    rules = terms.rules
    pursuer = rules.pursuer
    if terms.target_game_m is not None:
        # A speed set without the evader's region says so
        pursuer.planar(FLOATS, rules.standoff_radius_m, rules.capture_radius_m, 0.0)
    level_m_s, climb_m_s, descent_m_s = rules.speeds_m_s
    if climb_m_s >= pursuer.climb_m_s and descent_m_s >= pursuer.descent_m_s:
        return
    section = terms.source
    speeds_words = (
        f"{section}.climb_m_s = {climb_m_s:g} and {section}.descent_m_s = {descent_m_s:g}"
    )
    fastest_m_s = max(pursuer.climb_m_s, pursuer.descent_m_s)
    raise ConfigError(
        f'{section}.speed_set = "{rules.speed_set}": its game climbs and descends at up to '
        f"{section}.speed_m_s = {level_m_s:g}, but the vehicle flies {speeds_words}; what it could not keep would be "
        f'promised. Use "cylinder", or raise both to {fastest_m_s:g} if the autopilot flies that'
    )


def _settings(terms: _Terms, team: TeamPlan | None) -> FlightSettings:
    game = game_by(terms.rules)
    handling = terms.autopilot.handling
    cycle = CycleSettings(
        game,
        terms.policy,
        tolerance_m=terms.tolerance_m,
        envelope=terms.limits.envelope(terms.speed_limits, handling.dynamics, game.standoff),
        handling=handling,
        target_game_m=terms.target_game_m,
        site=terms.site,
        evader_timeout_s=terms.evader_timeout_s,
    )
    limits_s = {state: limit for state, limit in LIMITS_S.items() if state not in terms.unlimited}
    return FlightSettings(
        **dict(terms.flight),
        team=terms.team if team is None else team.team,
        evaders=terms.evaders if team is None else team.evaders,
        autopilot=terms.autopilot,
        cycle=cycle,
        limits=terms.limits,
        start_game_m=terms.start_game_m,
        hold_on_rival=terms.hold_on_rival,
        limits_s=limits_s,
        evader_height_limit_m=terms.evader_height_limit_m,
    )


def merged(scenario: "Scenario", config: Config) -> Config:
    """Return the vehicle file with the scenario's game and the tighter limits.

    Raises:
        ConfigError: If the two contradict each other. The message has one line for each contradiction, with both keys.
    """
    if contradictions := list(_contradictions(scenario, config)):
        lines = "\n".join(f"  {line}" for line in contradictions)
        raise ConfigError(f"{scenario.title!r} cannot be flown by {config.name!r}:\n{lines}")
    speeds = zip(scenario.pursuer.speeds, config.game.speeds, strict=True)
    slower = Speeds(*(min(pair) for pair in speeds))
    vehicle_limits, scenario_limits = (
        file.limits.model_copy(update=file.speed_limits._asdict()) for file in (config, scenario)
    )
    document = config.model_dump(mode="json")
    document["game"] = {"speed_set": config.game.speed_set, **_game(scenario), **slower._asdict()}
    document["limits"] = vehicle_limits.tighter(scenario_limits).model_dump(mode="json")
    document["flight"]["takeoff_height_m"] = scenario.pursuer.takeoff_height_m
    document["flight"]["after_capture"] = "hold"
    document["flight"]["engage_on"] = "command"
    return parse_document(Config, document, source=f"{scenario.title!r} on {config.name!r}")


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
    from guidance.sim.scenario import EVADER_ID  # noqa: PLC0415 - as above

    document = {
        "name": name,
        "vehicle": vehicle.model_dump(mode="json"),
        "evader": {"kind": "global_position", "url": SIMULATED_URL, "system_id": EVADER_ID},
        "game": _game(scenario),
        "limits": scenario.limits.model_dump(mode="json"),
        "flight": {
            "takeoff_height_m": scenario.pursuer.takeoff_height_m,
            "on_terminate": "land",
        },
        "log": {"level": "error"},
        "team": team,
    }
    return parse_document(Config, document, source=f"{scenario.title!r} at {vehicle.url}")


def _game(scenario: "Scenario") -> dict[str, Any]:
    """Return a vehicle file's section of the game; the speed set is the vehicle's if the scenario names none."""
    pursuer = scenario.pursuer
    disc = scenario.standoff
    game = {
        **pursuer.speeds._asdict(),
        "evader_speed_m_s": scenario.evader.believed_speed_m_s,
        "standoff_radius_m": disc.radius_m,
        "standoff_height_m": disc.height_m - scenario.evader.height_m,
        "tolerance_m": disc.tolerance_m,
    }
    if pursuer.speed_set is not None:
        game["speed_set"] = pursuer.speed_set
    return game


def _contradictions(scenario: "Scenario", config: Config) -> Iterator[str]:
    pursuer = scenario.pursuer
    evader = scenario.evader
    disc = scenario.standoff
    game = config.game
    limits = config.limits
    named = pursuer.model_fields_set
    if "autopilot" in named and pursuer.autopilot != config.vehicle.autopilot:
        yield f"pursuer.autopilot = {pursuer.autopilot!r}, but vehicle.autopilot = {config.vehicle.autopilot!r}"
    for key, speed_m_s in pursuer.speeds._asdict().items():
        if key in named and speed_m_s > (limit_m_s := getattr(game, key)):
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

    low = limits.floor_m
    high = limits.ceiling_m
    heights_m = {
        "pursuer.position_m": pursuer.position_m[2],
        "pursuer.takeoff_height_m": pursuer.takeoff_height_m,
        "standoff.height_m": disc.height_m,
    }
    for key, height_m in heights_m.items():
        if not low <= height_m <= high:
            yield f"{key}: height {height_m:g} m is not within limits.floor_m = {low:g} to limits.ceiling_m = {high:g}"
    fence_m = limits.fence_radius_m
    out_m = math.hypot(*pursuer.position_m[:2])
    if fence_m is not None and "site" not in scenario.model_fields_set and out_m > fence_m:
        yield f"pursuer.position_m: {out_m:.0f} m out is beyond limits.fence_radius_m = {fence_m:g}"
