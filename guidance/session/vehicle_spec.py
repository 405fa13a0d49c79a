"""From a vehicle's configuration to what the flight and its preflight need."""

import math
from collections.abc import Collection

from guidance.autopilots import profile
from guidance.control import Envelope, Polygon, StandOffLimit
from guidance.control.handling import handling
from guidance.cycle import CycleSettings
from guidance.errors import ConfigError
from guidance.flight import AfterCapture, EngageOn, FlightSettings, State
from guidance.flight.settings import LIMITS_S
from guidance.frames import Amsl
from guidance.game import Ball, Cylinder, SpeedSet, StandOff
from guidance.preflight import Wants
from guidance.session.vehicle_file import Config, GameSection
from guidance.strategies import COURSES, PURSUER_STRATEGIES, Strategy

# The limits keep this much out of the way of the disc that the game is played to, so that they bind only when something
# is wrong.
_STANDOFF_SLACK_M = 1.0

_WAITS_FOR_EVER = (State.CONNECTING, State.CHECKING)


def flight_settings(config: Config) -> FlightSettings:
    """Return the flight of a configuration.

    Raises:
        ConfigError: If the policy is not in the catalogue, or the limits contradict each other.
    """
    game, flight = config.game, config.flight
    _check_policy(game.policy, [name for name in PURSUER_STRATEGIES if name not in COURSES])
    flown = handling(config.vehicle.autopilot)
    target = game.target
    return FlightSettings(
        profile=profile(config.vehicle.autopilot),
        cycle=CycleSettings(
            speed_set=_speed_set(game),
            strategy=Strategy(game.policy, gain=game.navigation_gain),
            declared_evader_speed_m_s=game.evader_speed_m_s,
            standoff=StandOff(game.standoff_radius_m, game.standoff_height_m),
            tolerance_m=game.tolerance_m,
            envelope=envelope(config),
            following=flown.following,
            acceleration=flown.acceleration,
            # The game frame has its zero at the target; heights in a game are differences only.
            target_game_m=None if target is None else (0.0, 0.0, 0.0),
            site=None if target is None else (target.latitude_deg, target.longitude_deg, Amsl(target.altitude_amsl_m)),
            evader_timeout_s=config.evader.timeout_s,
            target_velocity_m_s=game.target_velocity_m_s,
        ),
        takeoff_height_m=flight.takeoff_height_m,
        after_capture=AfterCapture(flight.after_capture),
        engage_on=EngageOn(flight.engage_on),
        battery_minimum=flight.battery_minimum,
        fence_corners_deg=config.limits.fence_polygon_deg,
        limits_s={state: limit_s for state, limit_s in LIMITS_S.items() if state not in _WAITS_FOR_EVER},
    )


def envelope(config: Config) -> Envelope:
    """Return the limits of a configuration, about a home that is not known yet.

    Raises:
        ConfigError: If they contradict each other.
    """
    game, limits = config.game, config.limits
    flown = handling(config.vehicle.autopilot)
    corners = limits.fence_polygon_ne_m
    return Envelope(
        floor_m=limits.floor_m,
        ceiling_m=limits.ceiling_m,
        **config.speed_limits._asdict(),
        acceleration_m_s2=flown.acceleration_m_s2,
        vertical_acceleration_m_s2=flown.vertical_acceleration_m_s2,
        jerk_m_s3=flown.jerk_m_s3,
        braking_m_s2=flown.braking_m_s2,
        vertical_braking_m_s2=flown.vertical_braking_m_s2,
        reaction_s=flown.reaction_s,
        yaw_rate_rad_s=math.radians(limits.yaw_rate_deg_s),
        fence_radius_m=limits.fence_radius_m,
        fence_polygon=None if corners is None else Polygon(corners),
        fence_margin_m=limits.fence_margin_m,
        stand_off=StandOffLimit(
            radius_m=max(0.5, game.standoff_radius_m - _STANDOFF_SLACK_M),
            height_m=max(0.5, game.standoff_height_m - _STANDOFF_SLACK_M),
        ),
    )


def wants(config: Config) -> Wants:
    """Return what the autopilot has to be set to."""
    return Wants(
        speed_m_s=config.game.speed_m_s,
        limit_speed_m_s=config.speed_limits.speed_m_s,
        climb_m_s=config.game.climb_m_s,
        descent_m_s=config.game.descent_m_s,
        fence_required=config.preflight.fence_required,
        fence_radius_m=config.limits.reach_m,
        fence_circle_m=config.limits.fence_radius_m,
        fence_corners_ne_m=config.limits.fence_polygon_ne_m,
        fence_corners_deg=config.limits.fence_polygon_deg,
        ceiling_m=config.limits.ceiling_m,
        loss_time_limit_s=config.preflight.loss_time_limit_s,
        origin_distance_limit_m=config.preflight.origin_distance_limit_m,
        evader_height_limit_m=config.preflight.evader_height_limit_m,
    )


def _speed_set(game: GameSection) -> SpeedSet:
    if game.speed_set == "ball":
        return Ball(game.speed_m_s)
    return Cylinder(game.speed_m_s, game.climb_m_s, game.descent_m_s)


def _check_policy(name: str, catalogue: Collection[str]) -> None:
    if name not in catalogue:
        raise ConfigError(f"game.policy = {name!r}: allowed are {', '.join(sorted(catalogue))}")
