"""One flight from its files: a vehicle file, a scenario file, or both become one specification, and that a flight plan.

What a scenario does not say is as in a vehicle file that does not say it either. Where both are given, the vehicle's
file says how vehicle and evader are reached and what the flight may never do, and the scenario what is played
(`guidance.session.merging`).
"""

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from guidance.autopilots import autopilot_named
from guidance.control import Envelope, Polygon, Speeds, StandOffLimit
from guidance.cycle import CycleSettings
from guidance.errors import ConfigError
from guidance.flight import AfterCapture, EngageOn, FlightSettings, State
from guidance.flight.settings import LIMITS_S, Reserve
from guidance.frames import Amsl, Vector
from guidance.game import Ball, Cylinder, SpeedSet, StandOff
from guidance.preflight import Wants
from guidance.session.merging import merged
from guidance.session.sections import EvaderSection, LimitsSection
from guidance.session.vehicle_file import Config, FlightSection, Preflight
from guidance.sim import players
from guidance.sim.scenario import Scenario
from guidance.strategies import COURSES, PURSUER_STRATEGIES, Strategy

_STANDOFF_SLACK_M: Final = 1.0
"""The limits stay this far from the disc that the game is played to: they bind when something is wrong."""

_WAIT_FOR_A_PERSON: Final = (State.CONNECTING, State.CHECKING)

_LIMITS, _FLIGHT = LimitsSection(), FlightSection()
_EVADER_TIMEOUT_S: Final = float(EvaderSection.model_fields["timeout_s"].default)


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightPlan:
    """What a flight is flown by; may be exchanged on the ground.

    Attributes:
        flight: Its settings.
        wants: What preflight judges the autopilot by; None where nothing is judged, as a mock of our own.
        document: Its configuration, as JSON.
    """

    flight: FlightSettings
    wants: Wants | None = None
    document: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Specification:
    """One flight, in whichever file it was said. Places are in the game frame, heights of limits above home.

    Attributes:
        autopilot: Its name, as `guidance.autopilots` lists it.
        speed_set: "ball" or "cylinder".
        speeds: Of the pursuer in the game.
        strategy: What the pursuer plays.
        evader_speed_m_s: Bound on the evader's speed that the pursuer plays against.
        standoff: The terminal disc, its height above the evader's plane.
        tolerance_m: How near to the disc counts as reached.
        limits: Floor, ceiling, fence and yaw rate.
        speed_limits: What no command exceeds.
        flight: How the flight goes around the game.
        evader_timeout_s: Silence after which the evader counts as lost.
        hold_on_rival: Whether two sources of the evader's reports hand the vehicle to its hold.
        start_game_m: Where the vehicle stands by; None above its take-off.
        target_game_m: TAD: the place that the evader wants to reach.
        target_velocity_m_s: TAD: east and north.
        site: Latitude and longitude in degrees and altitude of the game frame's zero; None puts it at home.
        preflight: What the autopilot has to be set to; None where that is not judged.
        patient: Whether a person waits for the vehicle: without one the flight fails when it is not heard or not ready.
    """

    autopilot: str
    speed_set: str
    speeds: Speeds
    strategy: Strategy
    evader_speed_m_s: float
    standoff: StandOff
    tolerance_m: float
    limits: LimitsSection
    speed_limits: Speeds
    flight: FlightSection
    evader_timeout_s: float = _EVADER_TIMEOUT_S
    hold_on_rival: bool = True
    start_game_m: Vector | None = None
    target_game_m: Vector | None = None
    target_velocity_m_s: tuple[float, float] = (0.0, 0.0)
    site: tuple[float, float, Amsl] | None = None
    preflight: Preflight | None = None
    patient: bool = True

    def settings(self) -> FlightSettings:
        """Return what the flight, its cycle and its limits need.

        Raises:
            ConfigError: If the limits contradict each other.
        """
        flown = autopilot_named(self.autopilot).handling
        return FlightSettings(
            autopilot=autopilot_named(self.autopilot),
            cycle=CycleSettings(
                speed_set=self._speed_set(),
                strategy=self.strategy,
                declared_evader_speed_m_s=self.evader_speed_m_s,
                standoff=self.standoff,
                tolerance_m=self.tolerance_m,
                envelope=self._envelope(),
                following=flown.following,
                acceleration=flown.acceleration,
                target_game_m=self.target_game_m,
                site=self.site,
                evader_timeout_s=self.evader_timeout_s,
                target_velocity_m_s=self.target_velocity_m_s,
            ),
            takeoff_height_m=self.flight.takeoff_height_m,
            start_game_m=self.start_game_m,
            after_capture=AfterCapture(self.flight.after_capture),
            engage_on=EngageOn(self.flight.engage_on),
            battery_minimum=self.flight.battery_minimum,
            hold_on_rival=self.hold_on_rival,
            reserve=self._reserve(),
            operator_timeout_s=math.inf if self.flight.operator_timeout_s is None else self.flight.operator_timeout_s,
            operator_return_s=self.flight.operator_return_s,
            farthest_m=self._farthest_m(),
            longest_chase_s=math.inf if self.flight.longest_chase_s is None else self.flight.longest_chase_s,
            fence_corners_deg=self.limits.fence_polygon_deg,
            limits_s={
                state: limit_s
                for state, limit_s in LIMITS_S.items()
                if not (self.patient and state in _WAIT_FOR_A_PERSON)
            },
        )

    def wants(self) -> Wants | None:
        """Return what the autopilot has to be set to."""
        if self.preflight is None:
            return None
        reserve = self._reserve()
        return Wants(
            speed_m_s=self.speeds.speed_m_s,
            limit_speed_m_s=self.speed_limits.speed_m_s,
            climb_m_s=self.speeds.climb_m_s,
            descent_m_s=self.speeds.descent_m_s,
            fence_required=self.preflight.fence_required,
            fence_radius_m=self.limits.reach_m,
            fence_circle_m=self.limits.fence_radius_m,
            fence_corners_ne_m=self.limits.fence_polygon_ne_m,
            fence_corners_deg=self.limits.fence_polygon_deg,
            ceiling_m=self.limits.ceiling_m,
            loss_time_limit_s=self.preflight.loss_time_limit_s,
            origin_distance_limit_m=self.preflight.origin_distance_limit_m,
            evader_height_limit_m=self.preflight.evader_height_limit_m,
            battery_needed=None
            if reserve is None
            else reserve.needed(self._farthest_m(), self.flight.takeoff_height_m),
        )

    def _reserve(self) -> Reserve | None:
        given = self.flight.reserve
        return None if given is None else Reserve(**given.model_dump())

    def _farthest_m(self) -> float:
        """How far from home the fence lets the vehicle go; 0 where only home will tell, for corners in degrees."""
        return self.limits.reach_m if math.isfinite(self.limits.reach_m) else 0.0

    def _speed_set(self) -> SpeedSet:
        return Ball(self.speeds.speed_m_s) if self.speed_set == "ball" else Cylinder(*self.speeds)

    def _envelope(self) -> Envelope:
        """Return the limits, about a home that is not known yet."""
        limits, flown = self.limits, autopilot_named(self.autopilot).handling
        corners = limits.fence_polygon_ne_m
        return Envelope(
            floor_m=limits.floor_m,
            ceiling_m=limits.ceiling_m,
            **self.speed_limits._asdict(),
            acceleration_m_s2=flown.acceleration_m_s2,
            vertical_acceleration_m_s2=flown.vertical_acceleration_m_s2,
            jerk_m_s3=flown.jerk_m_s3,
            braking_m_s2=flown.braking_m_s2,
            vertical_braking_m_s2=flown.vertical_braking_m_s2,
            reaction_s=flown.reaction_s,
            easing_m_s3=flown.easing_m_s3,
            yaw_rate_rad_s=math.radians(limits.yaw_rate_deg_s),
            fence_radius_m=limits.fence_radius_m,
            fence_polygon=None if corners is None else Polygon(corners),
            fence_margin_m=limits.fence_margin_m,
            stand_off=StandOffLimit(
                radius_m=max(0.5, self.standoff.radius_m - _STANDOFF_SLACK_M),
                height_m=max(0.5, self.standoff.height_m - _STANDOFF_SLACK_M),
            ),
        )


def plan_of(config: Config | None = None, scenario: Scenario | None = None) -> FlightPlan:
    """Return what is flown by a vehicle file, a scenario file, or both.

    Raises:
        ConfigError: If something contradicts itself, the files contradict each other, or there is none.
    """
    if config is None:
        if scenario is None:
            raise ConfigError("neither a vehicle file nor a scenario: nothing says what to fly")
        return FlightPlan(flight=of_scenario(scenario).settings(), document=scenario.model_dump_json())
    if scenario is None:
        spec, document = of_vehicle(config), config
    else:
        document = merged(scenario, config)
        spec = of_both(scenario, document)
    return FlightPlan(flight=spec.settings(), wants=spec.wants(), document=document.model_dump_json())


def of_vehicle(config: Config) -> Specification:
    """Return the flight of a vehicle file: its game, until a person orders otherwise.

    Raises:
        ConfigError: If the policy is not in the catalogue.
    """
    game, target = config.game, config.game.target
    policies = sorted(name for name in PURSUER_STRATEGIES if name not in COURSES)
    if game.policy not in policies:
        raise ConfigError(f"game.policy = {game.policy!r}: allowed are {', '.join(policies)}")
    return Specification(
        autopilot=config.vehicle.autopilot,
        speed_set=game.speed_set,
        speeds=game.speeds,
        strategy=Strategy(game.policy, gain=game.navigation_gain),
        evader_speed_m_s=game.evader_speed_m_s,
        standoff=StandOff(game.standoff_radius_m, game.standoff_height_m),
        tolerance_m=game.tolerance_m,
        limits=config.limits,
        speed_limits=config.speed_limits,
        flight=config.flight,
        evader_timeout_s=config.evader.timeout_s,
        hold_on_rival=config.evader.second_source == "hold",
        # The game frame has its zero at the target; heights in a game are differences only.
        target_game_m=None if target is None else (0.0, 0.0, 0.0),
        target_velocity_m_s=game.target_velocity_m_s,
        site=None if target is None else (target.latitude_deg, target.longitude_deg, Amsl(target.altitude_amsl_m)),
        preflight=config.preflight,
    )


def of_scenario(scenario: Scenario) -> Specification:
    """Return the flight of a scenario by itself, which a mock flies: nobody waits for it and nothing judges it."""
    pursuer, limits = scenario.pursuer, scenario.limits
    start = _start_game_m(scenario)
    return Specification(
        autopilot=pursuer.autopilot,
        speed_set=pursuer.speed_set,
        speeds=pursuer.speeds,
        strategy=players.pursuer_strategy(scenario, np.array(start), players.speed_set(scenario), scenario.seed),
        evader_speed_m_s=scenario.evader.believed_speed_m_s,
        standoff=players.standoff(scenario),
        tolerance_m=scenario.standoff.tolerance_m,
        limits=_LIMITS.model_copy(
            update={
                "floor_m": limits.floor_m,
                "ceiling_m": limits.ceiling_m,
                "fence_radius_m": limits.fence_radius_m,
            }
        ),
        speed_limits=scenario.speed_limits,
        flight=_FLIGHT.model_copy(update={"takeoff_height_m": pursuer.takeoff_height_m}),
        start_game_m=start,
        target_game_m=players.target_game_m(scenario),
        site=players.site(scenario),
        patient=False,
    )


def of_both(scenario: Scenario, config: Config) -> Specification:
    """Return the flight of a scenario on a vehicle, whose file the scenario was merged into.

    The game frame has its zero at the scenario's site where the file gives one, else where the vehicle's own local
    frame has its: so a scenario without a site can be flown anywhere.
    """
    of_file, start = of_vehicle(config), _start_game_m(scenario)
    speed_set = of_file.settings().cycle.speed_set
    return replace(
        of_file,
        strategy=players.pursuer_strategy(scenario, np.array(start), speed_set, scenario.seed),
        start_game_m=start,
        target_game_m=players.target_game_m(scenario),
        site=players.site(scenario) if "site" in scenario.model_fields_set else None,
    )


def _start_game_m(scenario: Scenario) -> Vector:
    x, y, z = scenario.pursuer.position_m
    return (x, y, z - scenario.evader.height_m)
